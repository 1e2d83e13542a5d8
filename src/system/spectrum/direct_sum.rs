//! The sum itself, frequencies in lanes: turned by a table within a block of samples, and once per block.
#![expect(
    clippy::needless_range_loop,
    reason = "iterators are not always inlined where the processor's features are chosen"
)]

use super::frequencies::Cycles;
use fdm_numeric::lanes::{Simd, VECTOR, WithSimd, dispatch};
use num_complex::Complex64;

/// Turned blocks follow each other by multiplication this often before the exact phase is taken again.
const SEED: usize = 16;

/// Turns of `exp(-j w k)` for sums of `samples` samples at M frequencies.
#[derive(Debug)]
pub(super) struct DirectSum {
    samples: usize,
    frequencies: usize,
    /// Frequencies padded to whole vectors.
    width: usize,
    /// Samples in a block.
    block: usize,
    /// Turns of the samples of a block (block by width): real parts, imaginary parts.
    table: [Vec<f64>; 2],
    /// Turn of a whole block (width).
    stride: [Vec<f64>; 2],
    /// Exact turns of every [`SEED`]th block (by width).
    seeds: [Vec<f64>; 2],
}

impl DirectSum {
    /// Sample k is turned by `origin + k step` times the frequency.
    pub(super) fn new(samples: usize, origin: f64, step: f64, cycles: &[Cycles]) -> Self {
        let width = cycles.len().next_multiple_of(VECTOR);
        // the table stays in the second-level cache
        let block = (32_768 / width).clamp(8, 128).min(samples.max(1));
        let seeds = samples.div_ceil(block * SEED);
        let reach = step * block as f64;
        Self {
            samples,
            frequencies: cycles.len(),
            width,
            block,
            table: turns(cycles, width, 0.0, step, block),
            stride: turns(cycles, width, reach, 0.0, 1),
            seeds: turns(cycles, width, origin, reach * SEED as f64, seeds),
        }
    }

    /// What the sums of `channels` channels are worth, in multiply-adds of whole vectors in registers: these load as much as they compute.
    pub(super) fn cost(samples: usize, frequencies: usize, channels: usize) -> f64 {
        4.5 * samples as f64 * frequencies.div_ceil(VECTOR) as f64 * channels as f64
    }

    /// The sums of the first `channels` numbers of rows of `stride` numbers: channels by frequencies.
    pub(super) fn sum(&self, rows: &[f64], stride: usize, channels: usize, out: &mut [Complex64]) {
        let mut sums = vec![0.0; 2 * self.width * channels];
        let mut turn = self.seeds.clone().map(|s| s[..self.width.min(s.len())].to_vec());
        for (b, rows) in rows[..self.samples * stride].chunks(self.block * stride).enumerate() {
            if b % SEED == 0 {
                let at = b / SEED * self.width;
                turn.iter_mut().zip(&self.seeds).for_each(|(t, s)| t.copy_from_slice(&s[at..at + self.width]));
            }
            let task = Block { plan: self, rows, row: stride, channels, turn: &mut turn, sums: &mut sums };
            dispatch(task);
        }
        for (out, sums) in out.chunks_exact_mut(self.frequencies).zip(sums.chunks_exact(2 * self.width)) {
            let (re, im) = sums.split_at(self.width);
            for (k, out) in out.iter_mut().enumerate() {
                *out = Complex64::new(re[k], im[k]);
            }
        }
    }
}

/// Turns at `origin + k step` for k below `count`, one row after the other, real parts and imaginary parts. Exact ones are those of powers of two,
/// the others are products of few.
fn turns(cycles: &[Cycles], width: usize, origin: f64, step: f64, count: usize) -> [Vec<f64>; 2] {
    // padded lanes repeat the last frequency
    let row = |place: f64| (0..width).map(move |k| cycles[k.min(cycles.len() - 1)].turned(place));
    let mut all: Vec<Complex64> = Vec::with_capacity(count * width);
    if count > 0 && !cycles.is_empty() {
        all.extend(row(origin));
    }
    let mut half = 1;
    while half < count && !cycles.is_empty() {
        let power: Vec<Complex64> = row(step * half as f64).collect();
        for k in 0..half.min(count - half) * width {
            all.push(all[k] * power[k % width]);
        }
        half *= 2;
    }
    [all.iter().map(|t| t.re).collect(), all.iter().map(|t| t.im).collect()]
}

/// One block of samples to add to the sums.
struct Block<'a> {
    plan: &'a DirectSum,
    rows: &'a [f64],
    row: usize,
    channels: usize,
    /// The turn of the block's first sample; left for the next block.
    turn: &'a mut [Vec<f64>; 2],
    /// For each channel the real parts, then the imaginary ones (width each).
    sums: &'a mut [f64],
}

impl WithSimd for Block<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let most = if S::REGISTER_COUNT >= 32 { 13 } else { 6 };
        let tiles = self.channels.div_ceil(most).max(1);
        for tile in 0..tiles {
            let (first, end) = (tile * self.channels / tiles, (tile + 1) * self.channels / tiles);
            match end - first {
                0 => {}
                1 => self.tile::<S, 1>(simd, first),
                2 => self.tile::<S, 2>(simd, first),
                3 => self.tile::<S, 3>(simd, first),
                4 => self.tile::<S, 4>(simd, first),
                5 => self.tile::<S, 5>(simd, first),
                6 => self.tile::<S, 6>(simd, first),
                7 => self.tile::<S, 7>(simd, first),
                8 => self.tile::<S, 8>(simd, first),
                9 => self.tile::<S, 9>(simd, first),
                10 => self.tile::<S, 10>(simd, first),
                11 => self.tile::<S, 11>(simd, first),
                12 => self.tile::<S, 12>(simd, first),
                _ => self.tile::<S, 13>(simd, first),
            }
        }
        self.advance(simd);
    }
}

impl Block<'_> {
    /// C channels from `first` on, sums of the block in registers.
    #[inline(always)]
    fn tile<S: Simd, const C: usize>(&mut self, simd: S, first: usize) {
        let vectors = self.plan.width / S::F64_LANES;
        let [re, im] = [0, 1].map(|part| S::as_simd_f64s(&self.plan.table[part]).0);
        let [turn_re, turn_im] = [0, 1].map(|part| S::as_simd_f64s(&self.turn[part]).0);
        let sums = S::as_mut_simd_f64s(self.sums).0;
        for v in 0..vectors {
            let mut sum = [[simd.splat_f64s(0.0); 2]; C];
            for (k, row) in self.rows.chunks_exact(self.row).enumerate() {
                let Some(x) = row[first..].first_chunk::<C>() else { return };
                let (c, s) = (re[k * vectors + v], im[k * vectors + v]);
                for q in 0..C {
                    let x = simd.splat_f64s(x[q]);
                    sum[q][0] = simd.mul_add_f64s(x, c, sum[q][0]);
                    sum[q][1] = simd.mul_add_f64s(x, s, sum[q][1]);
                }
            }
            let (c, s) = (turn_re[v], turn_im[v]);
            for q in 0..C {
                let at = 2 * vectors * (first + q) + v;
                let [a, b] = sum[q];
                sums[at] = simd.add_f64s(sums[at], simd.negate_mul_add_f64s(s, b, simd.mul_f64s(c, a)));
                let at = at + vectors;
                sums[at] = simd.add_f64s(sums[at], simd.mul_add_f64s(s, a, simd.mul_f64s(c, b)));
            }
        }
    }

    /// Turns on to the next block.
    #[inline(always)]
    fn advance<S: Simd>(&mut self, simd: S) {
        let [re, im] = self.turn;
        let (re, im) = (S::as_mut_simd_f64s(re).0, S::as_mut_simd_f64s(im).0);
        let [by_re, by_im] = [0, 1].map(|part| S::as_simd_f64s(&self.plan.stride[part]).0);
        for v in 0..re.len() {
            let (c, s) = (re[v], im[v]);
            re[v] = simd.negate_mul_add_f64s(s, by_im[v], simd.mul_f64s(c, by_re[v]));
            im[v] = simd.mul_add_f64s(s, by_re[v], simd.mul_f64s(c, by_im[v]));
        }
    }
}
