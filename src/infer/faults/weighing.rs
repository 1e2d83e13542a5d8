//! The log evidence and log prior of a point, and where they are greatest.

use super::ground::{Ground, Planted, Point, Responses};
use crate::evidence::climb::{Climb, Judgement};
use crate::evidence::gram::Grams;
use crate::evidence::parts::{Linearised, Parts};
use crate::evidence::prior::{Sign, of_amount};
use crate::evidence::question::{Evidence, Question};
use fdm_doctor::{Bias, Fault};
use fdm_numeric::statistics::log_normal_cdf;

/// Half of all values of parameters are within this factor of the value in the text, and one in so many has another sign.
const USUAL: f64 = std::f64::consts::LN_2;
const TURNED: f64 = 1000.0;
/// A point judged.
#[derive(Clone)]
pub(crate) struct Judged {
    pub(crate) evidence: Evidence,
    /// Log evidence and log prior as the point stands.
    pub(crate) log: f64,
    /// As it would be after the step that is promised.
    pub(crate) promised: f64,
    /// Log prior of the values of parameters.
    pub(crate) values: f64,
}

impl Ground<'_> {
    /// The evidence of a point with these products of columns, by so many rounds, its noise begun at these weights.
    pub(crate) fn judged(
        &self,
        point: &Point,
        grams: &Grams,
        rounds: Option<usize>,
        weights: Option<&[f64]>,
    ) -> Option<Judged> {
        let precision = vec![0.0; grams.shared()];
        let question = Question { grams, noise: &self.binning.noise, precision: &precision, own: &[] };
        let evidence = match rounds {
            Some(rounds) => question.answer_within(rounds, weights)?,
            None => question.answer(weights)?,
        };
        let values = self.log_prior_of_values(point, &evidence);
        let promised = evidence.log + values + self.log_prior_of_faults(point, grams, &evidence);
        let log = promised - evidence.gain;
        log.is_finite().then_some(Judged { evidence, log, promised, values })
    }

    /// Products of all columns of a point whose responses these are.
    pub(crate) fn grams_of(&self, point: &Point, responses: &Responses) -> Option<Grams> {
        Some(self.grams(&self.columns(point, responses)?, self.own(&point.faults).len()))
    }

    /// Responses of a point with all derivatives that are asked of it.
    pub(crate) fn responses_of(&self, point: &Point) -> Option<Responses> {
        self.responses(&point.theta, &point.edits(), &self.unknowns(&point.faults))
    }

    /// Log prior of the values of parameters that all runs share: the density over the logarithm of each, about the one in the text, so that no unit
    /// enters.
    fn log_prior_of_values(&self, point: &Point, evidence: &Evidence) -> f64 {
        let params = &self.model.definition().params;
        let of = |(k, param): (usize, &usize)| {
            let (start, found) = (params[*param].value, point.theta[0][*param] + evidence.mean[k]);
            let error = error_of(evidence, k);
            let ratio = found.hypot(error).max(f64::MIN_POSITIVE) / start.abs();
            let turned = log_normal_cdf(found * start.signum() / error.max(f64::MIN_POSITIVE)).max(-TURNED.ln());
            turned - ratio.ln() - (1.0 + (ratio.ln() / USUAL).powi(2)).ln()
        };
        self.shared.iter().enumerate().filter(|(_, p)| params[**p].value != 0.0).map(of).sum()
    }

    /// Log prior of all that belongs to runs and of the sizes of faults, with what kinematics say of these; that of kinds and places is the search's.
    fn log_prior_of_faults(&self, point: &Point, grams: &Grams, evidence: &Evidence) -> f64 {
        let (mut sum, mut at) = (0.0, self.shared.len());
        for fault in &point.faults {
            let Planted::Sized(fault, size) = fault else { continue };
            let sign = if fault.fault == Fault::Filtered { Sign::Positive } else { Sign::Either };
            sum += of_amount(size + evidence.mean[at], error_of(evidence, at), sign);
            at += 1;
        }
        let (own, params) = (self.own(&point.faults), &self.model.definition().params);
        for ((run, theta), steps) in grams.runs().iter().zip(&point.theta).zip(&evidence.own) {
            for (k, (param, step)) in own.iter().zip(steps).enumerate() {
                let information: f64 = run.powers_of(k).zip(&evidence.weights).map(|(v, w)| v * w).sum();
                let (value, error) = (theta[*param] + step, information.powf(-0.5).min(f64::MAX));
                sum += match k < self.own.len() {
                    // log-uniform, smoothed within its error: no unit of a state enters
                    true => -value.hypot(error).max(f64::MIN_POSITIVE).ln(),
                    false => of_amount(value - params[*param].value, error, Sign::Either),
                };
            }
        }
        sum + self.witnessed(point)
    }

    /// What kinematics say of the faults of a point, in nats.
    pub(crate) fn witnessed(&self, point: &Point) -> f64 {
        let edits = point.edits();
        if edits.is_empty() { 0.0 } else { self.witness.gain(&edits, &self.balances) }
    }

    /// The evidence of a point by white noise, after a step to where its columns leave least.
    fn plain(&self, point: &Point, grams: &Grams) -> Option<(f64, Evidence)> {
        let q = self.outputs();
        let precision = vec![0.0; grams.shared()];
        let question = Question { grams, noise: &self.binning.noise, precision: &precision, own: &[] };
        let bins = |o: usize| self.binning.noise_bins(o);
        let mut powers: Vec<f64> = (0..q).map(|o| grams.residual_powers(o).iter().sum()).collect();
        let mut evidence = None;
        for _ in 0..2 {
            let weights: Vec<f64> = (0..q)
                .flat_map(|o| std::iter::repeat_n(bins(o) / powers[o].max(f64::MIN_POSITIVE), self.binning.bands))
                .collect();
            let found = question.step(&weights)?;
            powers = (0..q).map(|o| grams.left(o, &found.mean, &found.own)).collect();
            evidence = Some(found);
        }
        let evidence = evidence?;
        let left: f64 = (0..q).filter(|o| powers[*o] > 0.0).map(|o| 0.5 * bins(o) * (powers[o] / bins(o)).ln()).sum();
        let prior = self.log_prior_of_values(point, &evidence) + self.log_prior_of_faults(point, grams, &evidence);
        Some((evidence.log - left + prior, evidence))
    }

    /// The log evidence of a point by white noise: by how much its response matches.
    pub(crate) fn matched(&self, point: &Point, grams: &Grams) -> Option<f64> {
        Some(self.plain(point, grams)?.0)
    }

    /// What parts of the records say of the size of a fault; none where it has none, or moves no response.
    pub(crate) fn parts(&self, point: &Point, judged: &Judged, k: usize) -> Option<Parts> {
        let Planted::Sized(_, size) = point.faults[k] else { return None };
        let columns = self.columns(point, &self.responses_of(point)?)?;
        let (own, evidence, binning) = (self.own(&point.faults).len(), &judged.evidence, &self.binning);
        Linearised { columns: &columns, own, evidence, binning }.parts(self.place_of(point, k), size)
    }

    /// Place of the size of a fault among the shared unknowns of a point.
    pub(crate) fn place_of(&self, point: &Point, k: usize) -> usize {
        self.shared.len() + point.faults[..k].iter().filter(|f| matches!(f, Planted::Sized(..))).count()
    }

    /// Standard error of the size of a fault of a point.
    pub(crate) fn error_of(&self, point: &Point, judged: &Judged, k: usize) -> f64 {
        match point.faults[k] {
            Planted::Sized(..) => error_of(&judged.evidence, self.place_of(point, k)),
            _ => f64::INFINITY,
        }
    }

    /// What leaves of the parameters a point has, beside another one, in standard errors of that.
    pub(crate) fn biases(&self, without: &Point, (with, judged): (&Point, &Judged)) -> Vec<Bias> {
        const LEAST: f64 = 0.1;
        let q = judged.evidence.mean.len();
        let params = &self.model.definition().params;
        let of = |(k, param): (usize, &usize)| {
            let error = judged.evidence.covariance[k * q + k].max(0.0).sqrt();
            let standard_errors = (without.theta[0][*param] - with.theta[0][*param]) / error;
            let parameter = params[*param].quantity.name.clone();
            standard_errors.is_finite().then_some(Bias { parameter, standard_errors })
        };
        let mut all: Vec<Bias> = self.shared.iter().enumerate().filter_map(of).collect();
        all.retain(|b| b.standard_errors.abs() >= LEAST);
        all.sort_by(|a, b| b.standard_errors.abs().total_cmp(&a.standard_errors.abs()));
        all
    }
}

impl Judgement for Judged {
    fn evidence(&self) -> &Evidence {
        &self.evidence
    }

    fn log(&self) -> f64 {
        self.log
    }
}

impl Climb for Ground<'_> {
    type Point = Point;
    type Judged = Judged;

    fn judge(&self, point: &Point, weights: Option<&[f64]>) -> Option<Judged> {
        if !self.work.goes_on() {
            return None;
        }
        self.judged(point, &self.grams_of(point, &self.responses_of(point)?)?, None, weights)
    }

    fn plain_step(&self, point: &Point) -> Option<Evidence> {
        Some(self.plain(point, &self.grams_of(point, &self.responses_of(point)?)?)?.1)
    }

    fn moved(&self, point: &Point, evidence: &Evidence, part: f64) -> Point {
        let (mut moved, params) = (point.clone(), &self.model.definition().params);
        for (k, step) in self.shared.iter().zip(&evidence.mean) {
            let value = (point.theta[0][*k] + part * step).clamp(params[*k].lower, params[*k].upper);
            moved.theta.iter_mut().for_each(|theta| theta[*k] = value);
        }
        let own = self.own(&point.faults);
        for (theta, steps) in moved.theta.iter_mut().zip(&evidence.own) {
            for (k, step) in own.iter().zip(steps) {
                theta[*k] = (theta[*k] + part * step).clamp(params[*k].lower, params[*k].upper);
            }
        }
        let mut at = self.shared.len();
        for fault in &mut moved.faults {
            let Planted::Sized(fault, size) = fault else { continue };
            let mut step = part * evidence.mean[at];
            at += 1;
            match fault.fault {
                Fault::Delay => step = step.clamp(-4.0 * self.interval, 4.0 * self.interval),
                Fault::Filtered => step = step.clamp(-0.7 * *size, 2.0 * size.max(self.interval)),
                Fault::Scale => step = step.clamp(-1.0, 1.0),
                _ => (),
            }
            *size += step;
        }
        moved
    }

    fn weighted(&self, point: &Point, weights: &[f64]) -> f64 {
        let edits = point.edits();
        let Some(responses) = self.responses(&point.theta, &edits, &[]) else { return f64::INFINITY };
        let of = |r: usize| -> f64 {
            let bins = &self.binning.runs[r];
            let left = bins.of(&self.residual(r, &responses, &edits), false);
            let power = |begin: usize, end: usize| left[begin..end].iter().map(|v| v * v).sum::<f64>();
            bins.segments.iter().map(|s| weights[s.place] * power(s.begin, s.end)).sum()
        };
        let sum: f64 = (0..self.runs.len()).map(of).sum();
        if sum.is_finite() { sum } else { f64::INFINITY }
    }

    fn goes_on(&self) -> bool {
        self.work.goes_on()
    }
}

/// Standard error of a shared unknown.
fn error_of(evidence: &Evidence, k: usize) -> f64 {
    let q = evidence.mean.len();
    evidence.covariance.get(k * q + k).map_or(f64::INFINITY, |v| v.max(0.0).sqrt())
}
