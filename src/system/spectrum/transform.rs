//! Sums `sum_k x_k exp(-j w k dt)` of many channels, planned once and by the cheapest way; at equally spaced frequencies by Bluestein's
//! chirp, or by a fold where the spacing divides a whole number of turns.

use super::decimation::{Decimation, Design};
use super::direct_sum::DirectSum;
use super::frequencies::{Comb, Cycles};
use fdm_numeric::fourier::{ComplexFft, RealFft};
use num_complex::Complex64;

/// A planned transform of records of one length at one choice of frequencies.
///
/// Which way is taken depends on counted operations alone, so that it is the same on every machine: the fast transform of all samples, the sum
/// itself, Bluestein's chirp, or one of these behind a window that thins out a narrow band.
#[derive(Debug)]
pub struct Transform {
    samples: usize,
    channels: usize,
    comb: Comb,
    /// Thins out the record first, and what its sums are multiplied with then.
    decimation: Option<(Decimation, Vec<f64>)>,
    sum: Sum,
}

/// How sums are taken over a record, thinned out or not.
#[derive(Debug)]
enum Sum {
    Grid(RealFft),
    Direct(DirectSum),
    Chirp(ChirpSum),
}

/// A way from samples to sums, before it is prepared.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Way {
    pub(super) design: Option<Design>,
    pub(super) sum: Kind,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Kind {
    Grid,
    Direct,
    Chirp,
}

impl Transform {
    /// Plans sums of `samples` samples of `channels` channels.
    pub fn new(samples: usize, channels: usize, comb: &Comb) -> Self {
        Self::by(Way::cheapest(samples, channels, comb), samples, channels, comb)
    }

    pub(super) fn by(way: Way, samples: usize, channels: usize, comb: &Comb) -> Self {
        let decimation = way.design.map(|design| {
            let decimation = Decimation::new(design, samples, channels);
            let factors = decimation.factors(&comb.cycles);
            (decimation, factors)
        });
        let (terms, origin, stride) = way.terms(samples);
        let sum = match (way.sum, comb.step, comb.cycles.first()) {
            (Kind::Grid, _, _) => Sum::Grid(RealFft::new(samples)),
            (Kind::Chirp, Some(step), Some(first)) => {
                Sum::Chirp(ChirpSum::new(terms, comb.len(), *first, step, [origin, stride]))
            }
            _ => Sum::Direct(DirectSum::new(terms, origin, stride, &comb.cycles)),
        };
        Self { samples, channels, comb: comb.clone(), decimation, sum }
    }

    /// The frequencies.
    pub fn comb(&self) -> &Comb {
        &self.comb
    }

    /// Sums of `rows` (samples by channels), one channel after the other (channels by frequencies).
    ///
    /// # Panics
    /// When `rows` holds another number of samples or channels than was planned.
    pub fn apply(&mut self, rows: &[f64]) -> Vec<Complex64> {
        let mut sums = vec![Complex64::ZERO; self.channels * self.comb.len()];
        self.apply_to(rows, &mut sums);
        sums
    }

    /// As [`Self::apply`], into `sums`.
    ///
    /// # Panics
    /// When `rows` or `sums` are of another shape than was planned.
    pub fn apply_to(&mut self, rows: &[f64], sums: &mut [Complex64]) {
        let (channels, frequencies) = (self.channels, self.comb.len());
        assert_eq!(rows.len(), self.samples * channels, "rows of another shape than was planned");
        assert_eq!(sums.len(), channels * frequencies, "sums of another shape than was planned");
        if sums.is_empty() {
            return;
        }
        let (rows, parts, factors) = match &mut self.decimation {
            Some((decimation, factors)) => {
                let parts = decimation.parts();
                (decimation.apply(rows), parts, factors.as_slice())
            }
            None => (rows, 1, [].as_slice()),
        };
        self.sum.take(rows, [channels, parts], &self.comb, sums);
        for sums in sums.chunks_exact_mut(frequencies) {
            sums.iter_mut().zip(factors).for_each(|(sum, factor)| *sum *= factor);
        }
    }
}

impl Sum {
    /// Sums of rows of channels, each in one part or in a real and an imaginary one.
    fn take(&mut self, rows: &[f64], [channels, parts]: [usize; 2], comb: &Comb, sums: &mut [Complex64]) {
        let width = channels * parts;
        let column = |c: usize| rows.iter().skip(c).step_by(width).copied();
        match self {
            Self::Grid(plan) => {
                let Some(bins) = &comb.bins else { return };
                for (c, sums) in sums.chunks_exact_mut(bins.len()).enumerate() {
                    plan.transform(column(c), bins.clone(), sums);
                }
            }
            Self::Direct(plan) if parts == 1 => plan.sum(rows, width, width, sums),
            Self::Direct(plan) => {
                let mut both = vec![Complex64::ZERO; sums.len() * parts];
                plan.sum(rows, width, width, &mut both);
                let (re, im) = both.split_at(sums.len());
                sums.iter_mut().zip(re).zip(im).for_each(|((sum, re), im)| *sum = re + Complex64::I * im);
            }
            Self::Chirp(plan) => {
                for (c, sums) in sums.chunks_exact_mut(comb.len()).enumerate() {
                    let imaginary = column(c + channels).chain(std::iter::repeat(0.0));
                    match parts {
                        1 => plan.sum(column(c).map(Complex64::from), sums),
                        _ => plan.sum(column(c).zip(imaginary).map(|(re, im)| Complex64::new(re, im)), sums),
                    }
                }
            }
        }
    }
}

impl Way {
    /// The way of fewest operations.
    pub(super) fn cheapest(samples: usize, channels: usize, comb: &Comb) -> Self {
        let mut best = Self { design: None, sum: Kind::Direct };
        let mut least = best.cost(samples, channels, comb);
        let mut consider = |way: Self| {
            let cost = way.cost(samples, channels, comb);
            if cost < least {
                (best, least) = (way, cost);
            }
        };
        consider(Self { design: None, sum: Kind::Grid });
        consider(Self { design: None, sum: Kind::Chirp });
        if let Some((lowest, highest)) = comb.cycles.first().zip(comb.cycles.last()) {
            for design in Design::all(lowest.value(), highest.value()).filter(|d| d.step * 4 < samples) {
                for sum in [Kind::Direct, Kind::Chirp] {
                    consider(Self { design: Some(design), sum });
                }
            }
        }
        best
    }

    /// Rows to be summed, the place of the first and their distance, in samples.
    fn terms(&self, samples: usize) -> (usize, f64, f64) {
        self.design.map_or((samples, 0.0, 1.0), |d| (d.windows(samples), d.origin(), d.step as f64))
    }

    /// Multiply-adds of whole vectors that the way takes.
    fn cost(&self, samples: usize, channels: usize, comb: &Comb) -> f64 {
        let (terms, _, stride) = self.terms(samples);
        let parts = self.design.map_or(1, |d| d.parts());
        let first = self.design.map_or(0.0, |d| d.cost(samples, channels));
        first
            + match (self.sum, comb.step, &comb.bins) {
                (Kind::Direct, _, _) => DirectSum::cost(terms, comb.len(), channels * parts),
                (Kind::Chirp, Some(step), _) => ChirpSum::cost(terms, comb.len(), step, stride, channels),
                (Kind::Grid, _, Some(_)) => channels as f64 * 0.55 * fft_cost(samples),
                _ => f64::INFINITY,
            }
    }
}

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

    /// What the sums of `channels` series are worth, in multiply-adds of whole vectors.
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
    let plain = 2.5 * length as f64 * (length.max(2) as f64).log2();
    if is_smooth(length) { plain } else { 4.0 * plain }
}
