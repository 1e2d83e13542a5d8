//! The noise of one output as a smooth logarithm of its spectrum with as few hat functions as its likelihood is content with.
//!
//! A disturbance is weighed against noise of any smooth spectrum; each hat function has a penalty, so that both pay for what they
//! are free to do. log S is a sum of hats over log f; what is left of n bins beside a leverage h has the mean S (n - h): gamma
//! variates (Whittle), solved by reweighted least squares.
//!
//! A resonance is narrower than any hat. One is fitted beside the hats from the poles of autoregressive noise of order 2, and from a narrow band that
//! stands out of the smooth spectrum, and kept where that is likelier with its own penalty: a resonance of the noise is then no disturbance,
//! and no mode of the model.

use super::hat::Hat;
use super::parametric::second_order;
use super::residual_power::ResidualPower;
use super::resonance::{Form, NUMBERS, Resonance};
use nalgebra::{DMatrix, DVector, SMatrix, SVector};

/// Numbers of hat functions that are tried.
const SIZES: [usize; 6] = [1, 2, 3, 5, 8, 12];
/// What a hat function costs in log-likelihood.
pub(crate) const PENALTY: f64 = 1.5;
const PASSES: usize = 60;
/// Change of the log-spectrum below which the iteration ends.
const CONVERGED: f64 = 1e-9;
/// Numbers of narrow bands that are looked at together for a resonance, and what a level of their own must gain.
const WINDOWS: [usize; 5] = [1, 2, 4, 8, 16];
const STANDS_OUT: f64 = 6.0;
/// Forms of a resonance, with numbers of hat functions beside them; the most of these, and most numbers of both.
const RESONANT: [(Form, &[usize]); 2] = [(Form::Poles, &[1, 2, 3]), (Form::Peak, &[1, 2, 3, 5])];
const HATS: usize = 5;
const ALL: usize = HATS + NUMBERS;
const HALVINGS: usize = 8;
/// Decrease of twice the loss that is not worth another pass.
const SETTLED: f64 = 1e-4;

/// A smooth spectrum.
#[derive(Debug, Clone, PartialEq)]
pub struct SmoothSpectrum {
    /// Logarithms of frequencies, evenly spaced; one for white noise.
    knots: Vec<f64>,
    /// log S at the knots, less what a resonance adds.
    values: Vec<f64>,
    /// A resonance on top.
    resonance: Option<Resonance>,
}

/// What is left of one output's bins in bands: wide ones, by which hats are fitted, and narrow ones, in which a resonance is seen.
pub(crate) struct BandedPower {
    pub(crate) wide: Vec<ResidualPower>,
    pub(crate) narrow: Vec<ResidualPower>,
    /// The Nyquist frequency.
    pub(crate) highest: f64,
}

impl SmoothSpectrum {
    /// The spectrum of the least penalty and loss. Where a spectrum of what was left before has a resonance, the resonance is looked for there.
    pub(crate) fn fit(left: &BandedPower, like: Option<&Self>) -> Self {
        let BandedPower { wide, narrow, highest } = left;
        let tried = SIZES.iter().filter_map(|size| Self::of_size(wide, *size));
        let penalised = tried.map(|s| (s.twice_loss(wide) + 2.0 * s.penalty(), s));
        let best = penalised.min_by(|a, b| a.0.total_cmp(&b.0));
        let smooth = best.map_or_else(|| Self::level(wide), |(_, spectrum)| spectrum);
        let Some((first, last)) = narrow.first().zip(narrow.last()) else { return smooth };
        let within = (last.log_frequency - first.log_frequency, *highest);
        let known = like.and_then(|like| like.resonance);
        let sought = known.is_none().then(|| (second_order(narrow, *highest), smooth.narrow_band(narrow)));
        let starts = |form: Form| -> Vec<Resonance> {
            let known = known.map(|resonance| resonance.in_form(form));
            let begun = sought.and_then(|(poles, _)| Resonance::of_poles(poles, form, within));
            let bands = sought.iter().filter_map(|(_, band)| *band);
            known.into_iter().chain(begun).chain(bands.flat_map(|band| Resonance::starts(band, form, within))).collect()
        };
        let places: Vec<f64> = narrow.iter().map(|l| Resonance::place(l.log_frequency, *highest)).collect();
        let mut resonant = Vec::new();
        for (form, sizes) in RESONANT {
            let mut starts = starts(form);
            for size in sizes {
                let fits = starts.iter().filter_map(|start| Self::with_resonance((narrow, &places), *size, *start));
                let Some((_, best)) = fits.min_by(|a, b| a.0.total_cmp(&b.0)) else { continue };
                // more hats beside the resonance that few have found
                starts = best.resonance.into_iter().collect();
                resonant.push(best);
            }
        }
        let penalised =
            std::iter::once(smooth.clone()).chain(resonant).map(|s| (s.twice_loss(narrow) + 2.0 * s.penalty(), s));
        penalised.min_by(|a, b| a.0.total_cmp(&b.0)).map_or(smooth, |(_, spectrum)| spectrum)
    }

    /// The narrow band that stands out most, as its ends in log f; none where none stands out.
    fn narrow_band(&self, narrow: &[ResidualPower]) -> Option<(f64, f64)> {
        let excess: Vec<(f64, f64)> =
            narrow.iter().map(|cell| (cell.freedom, cell.freedom * cell.power / self.at(cell.log_frequency))).collect();
        let mut best: Option<(f64, (f64, f64))> = None;
        for cells in WINDOWS {
            for (k, window) in excess.windows(cells).enumerate() {
                let (freedom, power) = window.iter().fold((0.0, 0.0), |(n, p), own| (n + own.0, p + own.1));
                let ratio = power / freedom;
                // what a level of its own would gain there
                let gain = 0.5 * freedom * (ratio - 1.0 - ratio.ln());
                if ratio > 1.0 && gain > STANDS_OUT && best.is_none_or(|(other, _)| gain > other) {
                    best = Some((gain, (narrow[k].log_frequency, narrow[k + cells - 1].log_frequency)));
                }
            }
        }
        best.map(|(_, band)| band)
    }

    /// Twice the loss, its prior included, and so many hats with a resonance, from where it is to begin; none where these bands (with their
    /// places) do not determine it.
    fn with_resonance(
        (left, places): (&[ResidualPower], &[f64]),
        size: usize,
        resonance: Resonance,
    ) -> Option<(f64, Self)> {
        let (low, high) = (left.first()?.log_frequency, left.last()?.log_frequency);
        let own = resonance.size();
        let freedom: f64 = left.iter().map(|l| l.freedom).sum();
        if left.len() < 2 * (size + own) || freedom < 8.0 * (size + own) as f64 || low >= high {
            return None;
        }
        let step = (high - low) / size.saturating_sub(1).max(1) as f64;
        let knots: Vec<f64> = (0..size).map(|k| low + k as f64 * step).collect();
        let hats: Vec<Hat> = left.iter().map(|l| Hat::at(&knots, l.log_frequency)).collect();
        let bands = Bands { left, places, hats: &hats, size };
        let shape = resonance.shape();
        let level =
            left.iter().zip(places).map(|(l, place)| l.freedom * l.power / shape.at(*place).0.exp()).sum::<f64>();
        let mut values = [0.0; HATS];
        values[..size].fill((level / freedom).ln());
        let mut at = bands.scored(values, resonance);
        for _ in 0..PASSES {
            let mut change = at.information.cholesky()?.solve(&at.gradient);
            let mut better = None;
            for _ in 0..HALVINGS {
                let mut next = at.values;
                next.iter_mut().zip(change.iter()).take(size).for_each(|(value, change)| *value -= change);
                let there = bands.scored(next, at.resonance.moved(&change.as_slice()[size..size + own]));
                if there.twice_loss < at.twice_loss {
                    better = Some(there);
                    break;
                }
                change *= 0.4;
            }
            let Some(there) = better else { break };
            let gained = at.twice_loss - there.twice_loss;
            at = there;
            if gained < SETTLED {
                break;
            }
        }
        let found = at.twice_loss.is_finite() && at.resonance.is_one((low, high));
        found
            .then(|| (at.twice_loss, Self { knots, values: at.values[..size].to_vec(), resonance: Some(at.resonance) }))
    }

    /// White noise of a given density.
    pub(crate) fn white(density: f64) -> Self {
        Self { knots: vec![0.0], values: vec![density.max(f64::MIN_POSITIVE).ln()], resonance: None }
    }

    /// White noise as strong as what is left.
    pub(crate) fn level(left: &[ResidualPower]) -> Self {
        let freedom: f64 = left.iter().map(|l| l.freedom).sum();
        Self::white(left.iter().map(|l| l.freedom * l.power).sum::<f64>() / freedom.max(f64::MIN_POSITIVE))
    }

    /// The spectrum with so many hat functions; none where the bins do not determine it.
    fn of_size(left: &[ResidualPower], size: usize) -> Option<Self> {
        let logs = || left.iter().map(|l| l.log_frequency);
        let (low, high) = (logs().fold(f64::INFINITY, f64::min), logs().fold(f64::NEG_INFINITY, f64::max));
        let step = if size > 1 { (high - low) / (size - 1) as f64 } else { 0.0 };
        let freedom: f64 = left.iter().map(|l| l.freedom).sum();
        let mean = left.iter().map(|l| l.freedom * l.power).sum::<f64>() / freedom;
        let told = left.len() >= 2 * size && freedom >= 8.0 * size as f64 && (size == 1 || step > 0.0);
        if !told || mean <= 0.0 || !mean.is_finite() {
            return None;
        }
        let knots: Vec<f64> = (0..size).map(|k| low + k as f64 * step).collect();
        let mut hats = DMatrix::zeros(left.len(), size);
        for (i, l) in left.iter().enumerate() {
            Hat::at(&knots, l.log_frequency).parts().for_each(|(k, part)| hats[(i, k)] = part);
        }
        let mut values = DVector::from_element(size, mean.ln());
        for _ in 0..PASSES {
            let logs = &hats * &values;
            let weighed = DMatrix::from_fn(left.len(), size, |i, k| left[i].freedom * hats[(i, k)]);
            let excess = DVector::from_fn(left.len(), |i, _| left[i].power * (-logs[i]).exp() - 1.0);
            let mut change = weighed.tr_mul(&hats).cholesky()?.solve(&weighed.tr_mul(&excess));
            // a knot that starts far too high overshoots: at most one step in the logarithm at once
            let largest = change.amax();
            if largest > 1.0 {
                change /= largest;
            }
            values += &change;
            if largest < CONVERGED {
                break;
            }
        }
        Some(Self { knots, values: values.as_slice().to_vec(), resonance: None })
    }

    /// log S at a frequency given by its logarithm.
    fn log_at(&self, log_frequency: f64) -> f64 {
        let smooth = Hat::at(&self.knots, log_frequency).of(&self.values);
        self.resonance.map_or(smooth, |resonance| smooth + resonance.at(log_frequency).0)
    }

    /// S at a frequency given by its logarithm.
    pub fn at(&self, log_frequency: f64) -> f64 {
        self.log_at(log_frequency).exp()
    }

    /// Number of hat functions, and of what a resonance has; 1 is white.
    pub fn size(&self) -> usize {
        self.knots.len() + self.resonance.map_or(0, |resonance| resonance.size())
    }

    /// What its numbers cost in log-likelihood.
    pub(crate) fn penalty(&self) -> f64 {
        let resonance = self.resonance.map_or(0.0, |resonance| resonance.penalty(PENALTY));
        PENALTY * self.knots.len() as f64 + resonance
    }

    /// The resonance on top; none of noise without one.
    pub(crate) fn resonance(&self) -> Option<&Resonance> {
        self.resonance.as_ref()
    }

    /// Minus twice the logarithm of the likelihood of what is left.
    pub(crate) fn twice_loss(&self, left: &[ResidualPower]) -> f64 {
        let loss = |l: &ResidualPower| {
            let log = self.log_at(l.log_frequency);
            l.freedom * (log + l.power * (-log).exp())
        };
        left.iter().map(loss).sum()
    }
}

/// What fits of a resonance ask of every band.
struct Bands<'a> {
    left: &'a [ResidualPower],
    /// Where each lies for a resonance, and between the knots.
    places: &'a [f64],
    hats: &'a [Hat],
    /// Hat functions.
    size: usize,
}

/// Hats beside a resonance and the resonance, with twice their loss, its gradient and information; identity where there is no number.
struct Scored {
    values: [f64; HATS],
    resonance: Resonance,
    twice_loss: f64,
    gradient: SVector<f64, ALL>,
    information: SMatrix<f64, ALL, ALL>,
}

impl Bands<'_> {
    fn scored(&self, values: [f64; HATS], resonance: Resonance) -> Scored {
        let (size, own, shape) = (self.size, resonance.size(), resonance.shape());
        let mut found = Scored {
            values,
            resonance,
            twice_loss: resonance.prior(),
            gradient: SVector::zeros(),
            information: SMatrix::identity(),
        };
        for (k, (slope, curvature)) in resonance.prior_slopes().into_iter().enumerate().take(own) {
            (found.gradient[size + k], found.information[(size + k, size + k)]) = (slope, curvature);
        }
        (0..size).for_each(|k| found.information[(k, k)] = 0.0);
        for ((cell, place), hat) in self.left.iter().zip(self.places).zip(self.hats) {
            let (peak, slopes) = shape.at(*place);
            let log = peak + hat.of(&values);
            let ratio = cell.power * (-log).exp();
            found.twice_loss += cell.freedom * (log + ratio);
            let numbers = slopes.into_iter().take(own).enumerate().map(|(k, slope)| (size + k, slope));
            // the lower half, each number before those behind it
            let mut known = [(0, 0.0); 2 + NUMBERS];
            for (last, (k, slope)) in hat.parts().chain(numbers).enumerate() {
                known[last] = (k, slope);
                found.gradient[k] += cell.freedom * (1.0 - ratio) * slope;
                for (other, its) in &known[..=last] {
                    found.information[(k, *other)] += cell.freedom * slope * its;
                }
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fdm_numeric::random::Stream;

    /// What noise of a spectrum over frequencies up to 1 leaves of three runs of so many bins, in the bands of a fit.
    fn left(seed: u64, bins: usize, spectrum: impl Fn(f64) -> f64) -> BandedPower {
        let mut normal = Stream::seeded(seed);
        let each: Vec<(f64, f64)> = (1..=bins)
            .map(|k| {
                let f = k as f64 / bins as f64;
                (f, (0..3).map(|_| normal.normal_of_pair().powi(2)).sum::<f64>() * spectrum(f))
            })
            .collect();
        let banded = |width: f64, fewest: usize| {
            let (mut cells, mut first) = (Vec::new(), 0);
            while first < each.len() {
                let end = each.partition_point(|(f, _)| *f < each[first].0 * width).max(first + fewest).min(each.len());
                let own = &each[first..end];
                let freedom = 3.0 * own.len() as f64;
                cells.push(ResidualPower {
                    log_frequency: own.iter().map(|(f, _)| f.ln()).sum::<f64>() / own.len() as f64,
                    power: own.iter().map(|(_, p)| p).sum::<f64>() / freedom,
                    freedom,
                });
                first = end;
            }
            cells
        };
        BandedPower { wide: banded(1.25, 4), narrow: banded(1.02, 1), highest: 1.0 }
    }

    fn fit(left: &BandedPower) -> SmoothSpectrum {
        SmoothSpectrum::fit(left, None)
    }

    /// (1 - x^2)^2 + (2 z x)^2 over the sine of half the phase.
    fn square(f: f64, at: f64, damping: f64) -> f64 {
        let half = |f: f64| (0.5 * std::f64::consts::PI * f).sin();
        let x = half(f) / half(at);
        (1.0 - x * x).powi(2) + (2.0 * damping * x).powi(2)
    }

    #[test]
    fn a_resonance_is_found_where_it_is() {
        for seed in 0..20 {
            let poles = |f: f64| 2.0 / square(f, 0.15, 0.05);
            let peak = |f: f64| 0.5 + 0.2 / square(f, 0.3, 0.02) * f.powi(2);
            let found = [fit(&left(seed, 360, poles)), fit(&left(seed, 360, peak))];
            let truth: [&dyn Fn(f64) -> f64; 2] = [&poles, &peak];
            for (found, truth) in found.iter().zip(truth) {
                assert!(found.resonance().is_some(), "{seed}: {found:?}");
                let off = |f: f64| (found.at(f.ln()) / truth(f)).ln();
                let bins: Vec<f64> = (4..=360).map(|k| off(k as f64 / 360.0).powi(2)).collect();
                let mean = (bins.iter().sum::<f64>() / bins.len() as f64).sqrt();
                assert!(mean < 0.3, "{seed}: {mean} {found:?}");
            }
        }
    }

    #[test]
    fn smooth_noise_has_none() {
        let pink = |f: f64| 1.0 / f;
        let found = (0..100).map(|seed| fit(&left(seed, 360, |_| 3.0)));
        let resonant = found.chain((0..100).map(|seed| fit(&left(200 + seed, 360, pink))));
        let count = resonant.filter(|s| s.resonance().is_some()).count();
        assert!(count < 10, "{count} of 200");
    }
}
