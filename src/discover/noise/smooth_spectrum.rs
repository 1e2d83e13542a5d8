//! The noise of one output as a smooth logarithm of its spectrum with as few hat functions as its likelihood is content with.
//!
//! A disturbance is weighed against noise of any smooth spectrum; each hat function has a penalty, so that both pay for what they
//! are free to do. log S is a sum of hats over log f; what is left of n bins beside a leverage h has the mean S (n - h): gamma
//! variates (Whittle), solved by reweighted least squares.
//!
//! A resonance is narrower than any hat. One is fitted beside the hats from the poles of autoregressive noise of order 2, and from a narrow band that
//! stands out of the smooth spectrum, and kept where that is likelier with its own penalty: a resonance of the noise is then no disturbance,
//! and no mode of the model.

use super::parametric::second_order;
use super::residual_power::ResidualPower;
use super::resonance::{Form, Resonance};
use nalgebra::{DMatrix, DVector};

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
/// Forms of a resonance, with numbers of hat functions beside them.
const RESONANT: [(Form, usize); 7] = [
    (Form::Poles, 1),
    (Form::Poles, 2),
    (Form::Poles, 3),
    (Form::Peak, 1),
    (Form::Peak, 2),
    (Form::Peak, 3),
    (Form::Peak, 5),
];
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
    /// The spectrum of the least penalty and loss.
    pub(crate) fn fit(left: &BandedPower) -> Self {
        let BandedPower { wide, narrow, highest } = left;
        let tried = SIZES.iter().filter_map(|size| Self::of_size(wide, *size));
        let penalised = tried.map(|s| (s.twice_loss(wide) + 2.0 * s.penalty(), s));
        let best = penalised.min_by(|a, b| a.0.total_cmp(&b.0));
        let smooth = best.map_or_else(|| Self::level(wide), |(_, spectrum)| spectrum);
        let Some((first, last)) = narrow.first().zip(narrow.last()) else { return smooth };
        let within = (last.log_frequency - first.log_frequency, *highest);
        let (poles, band) = (second_order(narrow, *highest), smooth.narrow_band(narrow));
        let starts = |form: Form| -> Vec<Resonance> {
            let begun = Resonance::of_poles(poles, form, within);
            begun.into_iter().chain(band.iter().flat_map(|band| Resonance::starts(*band, form, within))).collect()
        };
        let fits = |(form, size): &(Form, usize)| -> Vec<Self> {
            starts(*form).into_iter().filter_map(|start| Self::with_resonance(narrow, *size, start)).collect()
        };
        let resonant = RESONANT.iter().flat_map(fits);
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

    /// So many hats with a resonance, from where it is to begin; none where these bands do not determine it.
    fn with_resonance(left: &[ResidualPower], size: usize, mut resonance: Resonance) -> Option<Self> {
        let (low, high) = (left.first()?.log_frequency, left.last()?.log_frequency);
        let own = resonance.size();
        let freedom: f64 = left.iter().map(|l| l.freedom).sum();
        if left.len() < 2 * (size + own) || freedom < 8.0 * (size + own) as f64 || low >= high {
            return None;
        }
        let step = (high - low) / size.saturating_sub(1).max(1) as f64;
        let knots: Vec<f64> = (0..size).map(|k| low + k as f64 * step).collect();
        let level = left.iter().map(|l| l.freedom * l.power / resonance.at(l.log_frequency).0.exp()).sum::<f64>();
        let mut values = DVector::from_element(size, (level / freedom).ln());
        let whole = |values: &DVector<f64>, resonance: Resonance| Self {
            knots: knots.clone(),
            values: values.as_slice().to_vec(),
            resonance: Some(resonance),
        };
        let mut loss = whole(&values, resonance).twice_loss(left) + resonance.prior();
        for _ in 0..PASSES {
            let (mut gradient, mut information) = (DVector::zeros(size + own), DMatrix::zeros(size + own, size + own));
            for cell in left {
                let (peak, slopes) = resonance.at(cell.log_frequency);
                let mut slope = DVector::zeros(size + own);
                let mut log = peak;
                for k in 0..size {
                    slope[k] = tent(&knots, cell.log_frequency, k);
                    log += slope[k] * values[k];
                }
                slope.rows_mut(size, own).copy_from_slice(&slopes[..own]);
                gradient.axpy(cell.freedom * (1.0 - cell.power * (-log).exp()), &slope, 1.0);
                information.ger(cell.freedom, &slope, &slope, 1.0);
            }
            resonance.add_prior(size, &mut gradient, &mut information);
            let mut change = information.cholesky()?.solve(&gradient);
            let mut better = None;
            for _ in 0..HALVINGS {
                let (next, moved) = (&values - change.rows(0, size), resonance.moved(&change.rows(size, own)));
                let there = whole(&next, moved).twice_loss(left) + moved.prior();
                if there < loss {
                    better = Some((next, moved, there));
                    break;
                }
                change *= 0.4;
            }
            let Some((next, moved, there)) = better else { break };
            let gained = loss - there;
            (values, resonance, loss) = (next, moved, there);
            if gained < SETTLED {
                break;
            }
        }
        (loss.is_finite() && resonance.is_one((low, high))).then(|| whole(&values, resonance))
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
        let hats = DMatrix::from_fn(left.len(), size, |i, k| tent(&knots, left[i].log_frequency, k));
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

    /// S at a frequency given by its logarithm.
    pub fn at(&self, log_frequency: f64) -> f64 {
        let hats = self.values.iter().enumerate().map(|(k, v)| v * tent(&self.knots, log_frequency, k));
        let smooth = hats.sum::<f64>();
        self.resonance.map_or(smooth, |resonance| smooth + resonance.at(log_frequency).0).exp()
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
            let density = self.at(l.log_frequency);
            l.freedom * (density.ln() + l.power / density)
        };
        left.iter().map(loss).sum()
    }
}

/// The k-th hat function, constant beyond the outer knots.
fn tent(knots: &[f64], log_frequency: f64, k: usize) -> f64 {
    let last = knots.len() - 1;
    if last == 0 {
        return 1.0;
    }
    let place = ((log_frequency - knots[0]) / (knots[1] - knots[0])).clamp(0.0, last as f64);
    (1.0 - (place - k as f64).abs()).max(0.0)
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
            let found = [SmoothSpectrum::fit(&left(seed, 360, poles)), SmoothSpectrum::fit(&left(seed, 360, peak))];
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
        let found = (0..100).map(|seed| SmoothSpectrum::fit(&left(seed, 360, |_| 3.0)));
        let resonant = found.chain((0..100).map(|seed| SmoothSpectrum::fit(&left(200 + seed, 360, pink))));
        let count = resonant.filter(|s| s.resonance().is_some()).count();
        assert!(count < 10, "{count} of 200");
    }
}
