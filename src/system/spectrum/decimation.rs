//! Fewer samples for a narrow band: a smooth window of known response slides over the record in long steps, and what it does to a
//! frequency is divided out.
//!
//! With a window w of P steps of D samples, `g_m = sum_n x_n w(n - c_m)` has at frequency v the sum `X(v) W(v)/D`, and what the steps
//! fold into the band from 1/D cycles per sample away is as small as W is there.
#![expect(
    clippy::needless_range_loop,
    reason = "iterators are not always inlined where the processor's features are chosen"
)]

use super::direct_sum::DirectSum;
use super::frequencies::Cycles;
use fdm_grammar::math;
use fdm_numeric::lanes::{Simd, WithSimd, dispatch};
use num_complex::Complex64;
use std::f64::consts::TAU;

/// Natural logarithm of the response to the edge of the band over that to the nearest frequency that folds into it, but for a factor of
/// about 2 DEPTH: 2e-14 together.
const DEPTH: f64 = 36.0;
/// Part of the reach to the first fold at which the window's response has come down to the end: the edge of exp(beta sqrt(1 - x^2)).
const EDGE: f64 = 0.99;

/// Widest half band, as part of the distance to what is folded: there the window has come down to e^-4, and dividing by that costs two digits.
const WIDEST: f64 = 0.300_001;
/// Longest step that is considered: beyond, the window over all samples is what costs.
const LONGEST: usize = 1000;

/// How a band is thinned out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Design {
    /// Samples between windows D.
    pub(super) step: usize,
    /// Steps in a window P.
    pub(super) steps: usize,
    /// The frequency to which the window is tuned, 0 for one that is real.
    pub(super) centre: f64,
    /// Half the width of the band around the centre, in cycles per sample.
    half: f64,
}

impl Design {
    /// Designs with ever longer steps for a band: around zero, and around its centre, which takes a complex window.
    pub(super) fn all(lowest: f64, highest: f64) -> impl Iterator<Item = Self> {
        let bands = [(0.0, highest), (0.5 * (lowest + highest), 0.5 * (highest - lowest))];
        bands.into_iter().flat_map(|(centre, half)| (2..LONGEST).map_while(move |step| Self::of(step, centre, half)))
    }

    fn of(step: usize, centre: f64, half: f64) -> Option<Self> {
        let part = half * step as f64;
        let depth = (EDGE * (1.0 - part)).powi(2) - part * part;
        if part > WIDEST {
            return None;
        }
        let steps = (2.0 * DEPTH / (TAU * depth.sqrt())).ceil() as usize;
        Some(Self { step, steps, centre, half })
    }

    /// Real series for each channel.
    pub(super) fn parts(&self) -> usize {
        if self.centre > 0.0 { 2 } else { 1 }
    }

    /// Windows that reach into a record.
    pub(super) fn windows(&self, samples: usize) -> usize {
        samples.div_ceil(self.step) + self.steps - 1
    }

    /// The middle of the first window, in samples.
    pub(super) fn origin(&self) -> f64 {
        let (step, steps) = (self.step as f64, self.steps as f64);
        (1.0 - steps) * step + 0.5 * (steps * step - 1.0)
    }

    /// Multiply-adds of whole vectors of eight.
    pub(super) fn cost(&self, samples: usize, channels: usize) -> f64 {
        samples as f64 * (self.steps * self.parts() * channels.div_ceil(8)) as f64 * 1.2
    }
}

/// A window that slides over records.
#[derive(Debug)]
pub(super) struct Decimation {
    design: Design,
    samples: usize,
    channels: usize,
    /// Window values, real and imaginary: for each sample of a step those of all windows that see it (D by P).
    taps: Vec<Vec<f64>>,
    /// Windows by parts by channels.
    series: Vec<f64>,
}

impl Decimation {
    pub(super) fn new(design: Design, samples: usize, channels: usize) -> Self {
        let (step, steps) = (design.step, design.steps);
        let window = window(design);
        let middle = 0.5 * ((step * steps) as f64 - 1.0);
        let tuned = |part: usize, at: usize| {
            let phase = TAU * design.centre * (at as f64 - middle);
            window[at] * if part == 0 { math::cos(phase) } else { -math::sin(phase) }
        };
        // the window that begins last sees a sample with its first step
        let place = |k: usize| (steps - 1 - k % steps) * step + k / steps;
        let taps = (0..design.parts()).map(|part| (0..step * steps).map(|k| tuned(part, place(k))).collect());
        let series = vec![0.0; design.windows(samples) * design.parts() * channels];
        Self { design, samples, channels, taps: taps.collect(), series }
    }

    /// Real series for each channel.
    pub(super) fn parts(&self) -> usize {
        self.design.parts()
    }

    /// What sums over the windows are multiplied with to be sums over the samples.
    pub(super) fn factors(&self, cycles: &[Cycles]) -> Vec<f64> {
        let (window, centre) = (window(self.design), Cycles::of(self.design.centre, 0.0, 0, 1.0));
        let tuned: Vec<Cycles> = cycles.iter().map(|c| c.minus(centre)).collect();
        let middle = 0.5 * (window.len() as f64 - 1.0);
        let mut responses = vec![Complex64::ZERO; cycles.len()];
        DirectSum::new(window.len(), -middle, 1.0, &tuned).sum(&window, 1, 1, &mut responses);
        responses.iter().map(|r| self.design.step as f64 / r.re).collect()
    }

    /// Thins out rows of channels: rows of `parts` by channels, one per window.
    pub(super) fn apply(&mut self, rows: &[f64]) -> &[f64] {
        debug_assert_eq!(rows.len(), self.samples * self.channels);
        self.series.fill(0.0);
        let (design, channels) = (self.design, self.channels);
        for (part, taps) in self.taps.iter().enumerate() {
            let slide = Slide { design, taps, rows, channels, part, series: &mut self.series };
            dispatch(slide);
        }
        &self.series
    }
}

/// `exp(beta (sqrt(1 - x^2) - 1))`, whose response falls off as steeply as any of its length (Barnett, Magland and af Klinteberg 2019).
fn window(design: Design) -> Vec<f64> {
    let length = design.step * design.steps;
    let half = 0.5 * length as f64;
    let beta = EDGE * TAU * half * (1.0 / design.step as f64 - design.half);
    let value = |k: usize| {
        let x = (k as f64 + 0.5) / half - 1.0;
        math::exp(beta * (math::sqrt(1.0 - x * x) - 1.0))
    };
    (0..length).map(value).collect()
}

struct Slide<'a> {
    design: Design,
    taps: &'a [f64],
    rows: &'a [f64],
    channels: usize,
    part: usize,
    series: &'a mut [f64],
}

impl WithSimd for Slide<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let (step, channels) = (self.design.step, self.channels);
        let tallest = if S::REGISTER_COUNT >= 32 { 8 } else { 4 };
        let groups = self.design.steps.div_ceil(tallest);
        for (j, rows) in self.rows.chunks(step * channels).enumerate() {
            for group in 0..groups {
                let (first, end) = (group * self.design.steps / groups, (group + 1) * self.design.steps / groups);
                match end - first {
                    1 => self.windows::<S, 1>(simd, rows, j, first),
                    2 => self.windows::<S, 2>(simd, rows, j, first),
                    3 => self.windows::<S, 3>(simd, rows, j, first),
                    4 => self.windows::<S, 4>(simd, rows, j, first),
                    5 => self.windows::<S, 5>(simd, rows, j, first),
                    6 => self.windows::<S, 6>(simd, rows, j, first),
                    7 => self.windows::<S, 7>(simd, rows, j, first),
                    _ => self.windows::<S, 8>(simd, rows, j, first),
                }
            }
        }
    }
}

impl Slide<'_> {
    /// W windows of all channels over one step of rows. The last two vectors of channels may overlap: they are added to together.
    #[inline(always)]
    fn windows<S: Simd, const W: usize>(&mut self, simd: S, rows: &[f64], j: usize, first: usize) {
        let (lanes, channels) = (S::F64_LANES, self.channels);
        if channels < lanes {
            return self.narrow::<S, W>(simd, rows, j, first);
        }
        let vectors = channels.div_ceil(lanes);
        let mut v = 0;
        if vectors % 2 == 1 {
            let at = if vectors == 1 { channels - lanes } else { 0 };
            self.tile::<S, W, 1>(simd, rows, (j, first), [at]);
            v = 1;
        }
        while v < vectors {
            self.tile::<S, W, 2>(simd, rows, (j, first), [v * lanes, ((v + 1) * lanes).min(channels - lanes)]);
            v += 2;
        }
    }

    #[inline(always)]
    fn tile<S: Simd, const W: usize, const V: usize>(
        &mut self,
        simd: S,
        rows: &[f64],
        (j, first): (usize, usize),
        columns: [usize; V],
    ) {
        let (lanes, channels, steps) = (S::F64_LANES, self.channels, self.design.steps);
        let width = channels * self.design.parts();
        let start = (j + first) * width + self.part * channels;
        let mut sum = [[simd.splat_f64s(0.0); V]; W];
        for w in 0..W {
            for v in 0..V {
                sum[w][v] = S::as_simd_f64s(&self.series[start + w * width + columns[v]..][..lanes]).0[0];
            }
        }
        for (row, taps) in rows.chunks_exact(channels).zip(self.taps.chunks_exact(steps)) {
            let Some(taps) = taps[first..].first_chunk::<W>() else { return };
            let mut x = [simd.splat_f64s(0.0); V];
            for v in 0..V {
                x[v] = S::as_simd_f64s(&row[columns[v]..][..lanes]).0[0];
            }
            for w in 0..W {
                let tap = simd.splat_f64s(taps[w]);
                for v in 0..V {
                    sum[w][v] = simd.mul_add_f64s(tap, x[v], sum[w][v]);
                }
            }
        }
        for w in 0..W {
            for v in 0..V {
                S::as_mut_simd_f64s(&mut self.series[start + w * width + columns[v]..][..lanes]).0[0] = sum[w][v];
            }
        }
    }

    /// Fewer channels than lanes.
    #[inline(always)]
    fn narrow<S: Simd, const W: usize>(&mut self, simd: S, rows: &[f64], j: usize, first: usize) {
        let (channels, steps) = (self.channels, self.design.steps);
        let width = channels * self.design.parts();
        let start = (j + first) * width + self.part * channels;
        let mut sum = [simd.splat_f64s(0.0); W];
        for w in 0..W {
            sum[w] = simd.partial_load_f64s(&self.series[start + w * width..][..channels]);
        }
        for (row, taps) in rows.chunks_exact(channels).zip(self.taps.chunks_exact(steps)) {
            let Some(taps) = taps[first..].first_chunk::<W>() else { return };
            let x = simd.partial_load_f64s(row);
            for w in 0..W {
                sum[w] = simd.mul_add_f64s(simd.splat_f64s(taps[w]), x, sum[w]);
            }
        }
        for w in 0..W {
            simd.partial_store_f64s(&mut self.series[start + w * width..][..channels], sum[w]);
        }
    }
}
