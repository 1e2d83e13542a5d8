//! Sums `sum_k x_k exp(-j w k dt)` of many channels, planned once and by the cheapest way.

use super::chirp::{ChirpSum, fft_cost};
use super::decimation::{Decimation, Design};
use super::direct_sum::DirectSum;
use super::fft::RealFft;
use super::frequencies::Comb;
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
