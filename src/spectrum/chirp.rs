//! Sums at equally spaced frequencies by fast transforms: Bluestein's chirp, or a fold where the spacing divides a whole number of turns.

use super::cycles::Cycles;
use super::fft::ComplexFft;
use num_complex::Complex64;

/// Complex series `z_k` to `sum_k z_k exp(-j 2 pi (first + step i) (origin + k stride))`, i from 0.
#[derive(Debug)]
pub(super) struct ChirpSum {
    /// Factor of each term of the series.
    before: Vec<Complex64>,
    /// Factor of each frequency.
    behind: Vec<Complex64>,
    /// The transformed chirp; none where the series is folded.
    chirp: Option<Vec<Complex64>>,
    fft: ComplexFft,
    work: Vec<Complex64>,
}

impl ChirpSum {
    /// Plans sums over `terms` terms, `stride` samples apart, at `frequencies` frequencies.
    pub(super) fn new(
        terms: usize,
        frequencies: usize,
        first: Cycles,
        step: Cycles,
        [origin, stride]: [f64; 2],
    ) -> Self {
        let apart = step.times(stride);
        let start = |k: usize| first.turned(origin + k as f64 * stride);
        // step i origin
        let late = |i: usize| step.turned(origin * i as f64);
        if let Some(length) = fold(apart, frequencies) {
            return Self {
                before: (0..terms).map(start).collect(),
                behind: (0..frequencies).map(late).collect(),
                chirp: None,
                fft: ComplexFft::new(length),
                work: vec![Complex64::ZERO; length],
            };
        }
        // i k = (i^2 + k^2 - (i - k)^2)/2, squares below 2^53 without rounding (Bluestein 1970)
        let chirp = |k: usize| apart.times(0.5).turned((k as f64) * (k as f64));
        let length = fast_length(terms + frequencies - 1);
        let mut fft = ComplexFft::new(length);
        let mut spread = vec![Complex64::ZERO; length];
        for k in 0..frequencies.max(terms) {
            let back = chirp(k).conj() / length as f64;
            if k < frequencies {
                spread[k] = back;
            }
            if k > 0 && k < terms {
                spread[length - k] = back;
            }
        }
        fft.forward(&mut spread);
        Self {
            before: (0..terms).map(|k| start(k) * chirp(k)).collect(),
            behind: (0..frequencies).map(|i| late(i) * chirp(i)).collect(),
            chirp: Some(spread),
            fft,
            work: vec![Complex64::ZERO; length],
        }
    }

    /// Multiply-adds of whole vectors that the sums of `channels` series are worth.
    pub(super) fn cost(terms: usize, frequencies: usize, step: Cycles, stride: f64, channels: usize) -> f64 {
        let (length, transforms) = match fold(step.times(stride), frequencies) {
            Some(length) => (length, 1.0),
            None => (fast_length(terms + frequencies - 1), 2.0),
        };
        channels as f64 * (transforms * fft_cost(length) + terms as f64)
    }

    /// The sums of one series.
    pub(super) fn sum(&mut self, series: impl Iterator<Item = Complex64>, out: &mut [Complex64]) {
        let length = self.work.len();
        self.work.fill(Complex64::ZERO);
        let mut at = 0;
        for (z, factor) in series.zip(&self.before) {
            self.work[at] += z * factor;
            at = if at + 1 == length { 0 } else { at + 1 };
        }
        self.fft.forward(&mut self.work);
        if let Some(chirp) = &self.chirp {
            self.work.iter_mut().zip(chirp).for_each(|(w, c)| *w *= c);
            self.fft.backward(&mut self.work);
        }
        for ((out, sum), factor) in out.iter_mut().zip(&self.work).zip(&self.behind) {
            *out = sum * factor;
        }
    }
}

/// The number of frequencies in one turn, when it is whole to the last digit of the frequency and small.
fn fold(apart: Cycles, frequencies: usize) -> Option<usize> {
    const LONGEST: f64 = (1u64 << 27) as f64;
    let turns = 1.0 / apart.value();
    let whole = turns.round();
    let exact = (whole * apart.value() - 1.0).abs() <= 2.0 * f64::EPSILON && whole < LONGEST;
    (exact && whole as usize >= frequencies && is_smooth(whole as usize)).then_some(whole as usize)
}

/// The next length of factors 2, 3 and 5.
fn fast_length(least: usize) -> usize {
    (least..).find(|n| [2, 3, 5].iter().fold(*n, |n, p| without(n, *p)) == 1).unwrap_or(least)
}

fn is_smooth(length: usize) -> bool {
    [2, 3, 5, 7, 11, 13].iter().fold(length, |n, p| without(n, *p)) == 1
}

/// A number without its factors `p`.
fn without(mut n: usize, p: usize) -> usize {
    while n > 0 && n.is_multiple_of(p) {
        n /= p;
    }
    n
}

/// What a complex transform of a length is worth.
pub(super) fn fft_cost(length: usize) -> f64 {
    let plain = 4.0 * length as f64 * (length.max(2) as f64).log2();
    if is_smooth(length) { plain } else { 4.0 * plain }
}
