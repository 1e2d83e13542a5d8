//! What hypotheses about a record are judged on: the responses of a model to the runs as edits make them, linearised, in bins.

use super::output_edits::{is_of_others, is_of_outputs, undone};
use crate::bins::Signals;
use crate::candidates::fitted_model::FittedModel;
use crate::candidates::runs::Runs;
use crate::evidence::binning::Binning;
use crate::evidence::gram::Grams;
use crate::evidence::prior::{Sign, of_amount};
use crate::evidence::question::{Evidence, Question};
use fdm_doctor::{Balance, Channels, Edit, Estimated, Fault, Hypothesis, Record, Slot, Witness, edited};
use fdm_estimate::residuals::residuals;
use fdm_estimate::{Changes, Work, starts};
use fdm_numeric::parallel;
use fdm_numeric::statistics::log_normal_cdf;
use fdm_system::model::Model;
use fdm_system::record::Run;
use fdm_system::simulate::{Simulator, StepOptions, Steps, choose_steps};

/// Gauss-Newton steps of a refit, and the promised gain (nats) at which none is worth making.
const STEPS: usize = 10;
const SETTLED: f64 = 0.05;
/// Promised gain (nats of white noise) at which a plain fit is near enough.
const PLAINLY: f64 = 0.5;
/// Parts of a step that are tried.
const PARTS: [f64; 4] = [1.0, 0.5, 0.2, 0.05];
/// Half of all values of parameters are within this factor of the value in the text, and one in so many has another sign.
const USUAL: f64 = std::f64::consts::LN_2;
const TURNED: f64 = 1000.0;
/// Part of an output's deviation by which its zero is moved for a derivative; of offsets the derivative is exact.
const SMALL: f64 = 1e-3;

/// A fault in a record: what it is, and its size where that is estimated.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Planted {
    /// With nothing to be estimated.
    Discrete(Hypothesis),
    /// Of this size.
    Sized(Estimated, f64),
}

impl Planted {
    /// What mends it.
    pub(crate) fn edits(&self) -> Vec<Edit> {
        match self {
            Self::Discrete(hypothesis) => hypothesis.edits.clone(),
            Self::Sized(fault, size) => vec![fault.edit(*size)],
        }
    }

    /// Its share of the prior probability.
    pub(crate) fn weight(&self) -> f64 {
        match self {
            Self::Discrete(hypothesis) => hypothesis.weight,
            Self::Sized(fault, size) => fault.weight(*size),
        }
    }

    pub(crate) fn fault(&self) -> Fault {
        match self {
            Self::Discrete(hypothesis) => hypothesis.fault,
            Self::Sized(fault, _) => fault.fault,
        }
    }

    pub(crate) fn slots(&self) -> Vec<Slot> {
        match self {
            Self::Discrete(hypothesis) => hypothesis.slots.clone(),
            Self::Sized(fault, _) => vec![fault.slot],
        }
    }

    /// Whether it is the same kind at the same channels.
    pub(crate) fn is_like(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Discrete(a), Self::Discrete(b)) => a.edits == b.edits,
            (Self::Sized(a, _), Self::Sized(b, _)) => a == b,
            _ => false,
        }
    }
}

/// Values of the parameters of each run, and faults of the record.
#[derive(Debug, Clone)]
pub(crate) struct Point {
    pub(crate) theta: Vec<Vec<f64>>,
    pub(crate) faults: Vec<Planted>,
}

impl Point {
    pub(crate) fn edits(&self) -> Vec<Edit> {
        self.faults.iter().flat_map(Planted::edits).collect()
    }

    pub(crate) fn with(&self, fault: Planted) -> Self {
        let mut faults = self.faults.clone();
        faults.push(fault);
        Self { faults, ..self.clone() }
    }

    pub(crate) fn without(&self, k: usize) -> Self {
        let mut faults = self.faults.clone();
        faults.remove(k);
        Self { faults, ..self.clone() }
    }
}

/// Responses of all runs with their derivatives, as the inputs of some edits make them, before what edits do to outputs.
pub(crate) struct Responses {
    time: Vec<Vec<f64>>,
    y: Vec<Signals>,
    /// Shared columns, then those of each run.
    columns: Vec<Vec<Signals>>,
}

/// A point judged.
#[derive(Clone)]
pub(crate) struct Judged {
    pub(crate) evidence: Evidence,
    /// Log evidence and log prior as the point stands.
    pub(crate) log: f64,
    /// As it would be after the step that is promised.
    pub(crate) promised: f64,
}

/// See the module.
pub(crate) struct Ground<'a> {
    pub(crate) model: &'a Model,
    pub(crate) runs: &'a [Run],
    pub(crate) records: &'a [Record],
    pub(crate) channels: &'a Channels,
    pub(crate) witness: &'a Witness<'a>,
    /// What kinematics leave of the records as they are.
    pub(crate) balances: Vec<Balance>,
    /// Every how many samples are compared.
    pub(crate) every: usize,
    /// Measured outputs of each run at these samples.
    measured: Vec<Signals>,
    binning: Binning,
    steps: Vec<Steps>,
    shared: Vec<usize>,
    own: Vec<usize>,
    /// Values in the text.
    pub(crate) text: Vec<Vec<f64>>,
    /// Deviation of each output, and the mean interval between samples that are compared.
    pub(crate) deviations: Vec<f64>,
    pub(crate) interval: f64,
    pub(crate) span: f64,
    pub(crate) work: &'a Work<'a>,
}

impl<'a> Ground<'a> {
    /// Of a model at its fit (of `every`-th samples of the runs), with the records of the runs.
    pub(crate) fn new(
        model: &'a Model,
        (fitted, compared, every): (&FittedModel, &[Run], usize),
        (runs, witness): (&'a [Run], &'a Witness<'a>),
        work: &'a Work<'a>,
    ) -> Option<Self> {
        let domain = crate::candidates::Domain::Time;
        let all = Runs { all: compared, train: compared.len(), domain: &domain };
        let binning = Binning::new(fitted, all);
        let params = &model.definition().params;
        let pick = |own: bool| (0..params.len()).filter(|k| !params[*k].fixed && params[*k].per_run == own).collect();
        let steps: Vec<Steps> = fitted.predictors.iter().filter_map(|p| p.steps().cloned()).collect();
        let q = fitted.outputs();
        let deviation = |o: usize| {
            let values = compared.iter().flat_map(|r| r.measured.iter().skip(o).step_by(q)).filter(|v| v.is_finite());
            let (n, sum, squares) = values.fold((0.0, 0.0, 0.0), |(n, s, q), v| (n + 1.0, s + v, q + v * v));
            ((squares - sum * sum / n) / n).max(0.0).sqrt()
        };
        let interval = compared.iter().map(crate::candidates::runs::interval).fold(0.0, f64::max);
        let span = compared.iter().filter_map(|r| r.time.last()).copied().fold(0.0, f64::max);
        (steps.len() == runs.len() && interval > 0.0).then(|| Self {
            model,
            runs,
            records: witness.records,
            channels: witness.channels,
            witness,
            balances: witness.balances(&[]),
            every,
            measured: compared.iter().map(|r| r.measured.clone()).collect(),
            binning,
            steps,
            shared: pick(false),
            own: pick(true),
            text: starts(model, runs, &Changes::default()),
            deviations: (0..q).map(deviation).collect(),
            interval,
            span,
            work,
        })
    }

    fn outputs(&self) -> usize {
        self.deviations.len()
    }

    /// Whether edits leave all inputs, times and parameters as they are.
    pub(crate) fn keeps_inputs(&self, edit: &Edit) -> bool {
        let hidden = self.model.definition().inputs.len() > self.channels.inputs;
        is_of_others(edit) || is_of_outputs(edit) && !hidden
    }

    /// The edits that change what is simulated.
    fn simulated(&self, edits: &[Edit]) -> Vec<Edit> {
        if edits.iter().all(|e| self.keeps_inputs(e)) { Vec::new() } else { edits.to_vec() }
    }

    /// A run as edits make it, at the samples that are compared, and its steps.
    fn run(&self, r: usize, edits: &[Edit]) -> Option<(Run, Steps, bool)> {
        let run = match edits.is_empty() {
            true => self.runs[r].clone(),
            false => edited(&self.runs[r], &self.records[r], self.channels, edits, self.model.definition()).ok()?,
        };
        let run = if self.every > 1 { run.every(self.every) } else { run };
        let paced = edits.iter().any(|e| matches!(e, Edit::Time(_)));
        Some((run, self.steps[r].clone(), paced))
    }

    /// Values of a run's parameters, those that are first values of inputs as these have them.
    fn values(&self, run: &Run, theta: &[f64]) -> Vec<f64> {
        let mut theta = theta.to_vec();
        for (param, input) in &self.model.layout().first {
            if let Some(value) = run.inputs.get(*input as usize) {
                theta[*param as usize] = *value;
            }
        }
        theta
    }

    /// Responses, with derivatives or without.
    pub(crate) fn responses(&self, theta: &[Vec<f64>], edits: &[Edit], derivatives: bool) -> Option<Responses> {
        let (dynamics, q, edits) = (self.model.dynamics(), self.outputs(), self.simulated(edits));
        let of = |r: usize| -> Option<(Vec<f64>, Signals, Vec<Signals>)> {
            let (run, steps, paced) = self.run(r, &edits)?;
            let theta = self.values(&run, &theta[r]);
            let steps = match paced {
                false => steps,
                true => choose_steps(dynamics, &run, &theta, &StepOptions::default().to(Some(1e-4))).ok()?.steps,
            };
            let mut simulator = Simulator::new(dynamics, &run, steps).ok()?;
            simulator.suits(&theta).ok()?;
            let mut y = vec![0.0; run.len() * q];
            if !derivatives {
                simulator.simulate(&theta, &mut y).ok()?;
                return Some((run.time.clone(), y, Vec::new()));
            }
            let asked = [&self.shared[..], &self.own].concat();
            let stride = asked.len().next_multiple_of(fdm_numeric::lanes::VECTOR);
            let mut jacobian = vec![0.0; y.len() * stride];
            simulator.sensitivities(&theta, &asked, &mut y, &mut jacobian).ok()?;
            let column = |c: usize| -> Signals { jacobian.chunks_exact(stride.max(1)).map(|row| row[c]).collect() };
            Some((run.time.clone(), y, (0..asked.len()).map(column).collect()))
        };
        let all = parallel::map(0..self.runs.len(), of).into_iter().collect::<Option<Vec<_>>>()?;
        let mut found = Responses { time: Vec::new(), y: Vec::new(), columns: Vec::new() };
        for (time, y, columns) in all {
            found.time.push(time);
            found.y.push(y);
            found.columns.push(columns);
        }
        Some(found)
    }

    /// What responses leave of a run's record, as edits have its outputs.
    fn residual(&self, r: usize, responses: &Responses, edits: &[Edit]) -> Signals {
        let mut y = responses.y[r].clone();
        undone(edits, &responses.time[r], self.outputs(), false, &mut y);
        let turned = &self.model.layout().wraps;
        if !turned.is_empty() {
            let run = Run { measured: self.measured[r].clone(), ..self.runs[r].clone() };
            run.turn(turned, 0, &mut y);
        }
        residuals(&self.measured[r], &y)
    }

    /// What responses leave of a run, and the times of its samples as edits have them.
    pub(crate) fn left(&self, r: usize, responses: &Responses, edits: &[Edit]) -> (Signals, Vec<f64>) {
        (self.residual(r, responses, edits), responses.time[r].clone())
    }

    /// Residual and columns of a point in bins; the last shared columns are the sizes of faults, in their order.
    pub(crate) fn grams(&self, point: &Point, responses: &Responses) -> Option<Grams> {
        let (q, edits) = (self.outputs(), point.edits());
        let residuals: Vec<Signals> = (0..self.runs.len()).map(|r| self.residual(r, responses, &edits)).collect();
        let mut sizes: Vec<Vec<Signals>> = Vec::new();
        for (k, fault) in point.faults.iter().enumerate() {
            let Planted::Sized(fault, size) = fault else { continue };
            let step = self.small(*fault, *size);
            let mut moved = point.clone();
            moved.faults[k] = Planted::Sized(*fault, size + step);
            let edits = moved.edits();
            let own;
            let there = match self.keeps_inputs(&fault.edit(*size)) {
                true => responses,
                false => {
                    own = self.responses(&point.theta, &edits, false)?;
                    &own
                }
            };
            let of = |r: usize| -> Signals {
                let moved = self.residual(r, there, &edits);
                residuals[r].iter().zip(moved).map(|(a, b)| (a - b) / step).collect()
            };
            sizes.push((0..self.runs.len()).map(of).collect());
        }
        let common = self.shared.len();
        let mut grams = Grams::new(self.binning.outputs, self.binning.bands, common + sizes.len());
        for r in 0..self.runs.len() {
            let bins = &self.binning.runs[r];
            let behind = |column: &Signals| {
                let mut column = column.clone();
                undone(&edits, &responses.time[r], q, true, &mut column);
                bins.of(&column, false)
            };
            let (shared, own) = responses.columns[r].split_at(common);
            let mut columns: Vec<Vec<f64>> = own.iter().map(behind).collect();
            columns.push(bins.of(&residuals[r], false));
            columns.extend(shared.iter().map(behind));
            columns.extend(sizes.iter().map(|s| bins.of(&s[r], false)));
            if !columns.iter().flatten().all(|v| v.is_finite()) {
                return None;
            }
            grams.add(self.own.len(), &bins.segments, &columns);
        }
        Some(grams)
    }

    /// A step of a size for its derivative.
    fn small(&self, fault: Estimated, size: f64) -> f64 {
        let deviation = match fault.slot {
            Slot::Output(o) => self.deviations[o],
            slot => {
                let place = self.channels.place(slot);
                let values = self.records.iter().flat_map(|r| &r.channels[place].values).filter(|v| v.is_finite());
                let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
                (high - low).abs()
            }
        };
        match fault.fault {
            Fault::Delay => 0.3 * self.interval,
            Fault::Drift => 0.3 * self.interval / self.span,
            Fault::Filtered => 0.1 * size.max(self.interval),
            Fault::Offset => SMALL * deviation.max(f64::MIN_POSITIVE),
            _ => SMALL,
        }
    }

    /// The evidence of a point whose responses these are, by so many rounds, its noise begun at these weights.
    pub(crate) fn judged(&self, point: &Point, responses: &Responses, rounds: Option<usize>, weights: Option<&[f64]>) -> Option<Judged> {
        let grams = self.grams(point, responses)?;
        let precision = vec![0.0; grams.shared()];
        let question = Question { grams: &grams, noise: &self.binning.noise, precision: &precision, own: &[] };
        let evidence = match rounds {
            Some(rounds) => question.answer_within(rounds, weights)?,
            None => question.answer(weights)?,
        };
        let prior = self.log_prior(point, &grams, &evidence);
        let promised = evidence.log + prior;
        let log = promised - evidence.gain;
        log.is_finite().then_some(Judged { evidence, log, promised })
    }

    /// The evidence of a point.
    pub(crate) fn judge(&self, point: &Point, weights: Option<&[f64]>) -> Option<Judged> {
        if !self.work.goes_on() {
            return None;
        }
        let responses = self.responses(&point.theta, &point.edits(), true)?;
        self.judged(point, &responses, None, weights)
    }

    /// Log prior of sizes and of values of parameters; that of kinds and places is the search's.
    fn log_prior(&self, point: &Point, grams: &Grams, evidence: &Evidence) -> f64 {
        let q = evidence.mean.len();
        let error = |k: usize| evidence.covariance[k * q + k].max(0.0).sqrt();
        let (mut sum, mut at) = (0.0, self.shared.len());
        for fault in &point.faults {
            let Planted::Sized(fault, size) = fault else { continue };
            let sign = if fault.fault == Fault::Filtered { Sign::Positive } else { Sign::Either };
            sum += of_amount(size + evidence.mean[at], error(at), sign);
            at += 1;
        }
        let params = &self.model.definition().params;
        // the density over the logarithm of each value, about the one in the text: no unit of a parameter enters
        for (k, param) in self.shared.iter().enumerate().filter(|(_, p)| params[**p].value != 0.0) {
            let (start, found) = (params[*param].value, point.theta[0][*param] + evidence.mean[k]);
            let size = found.hypot(error(k)).max(f64::MIN_POSITIVE);
            let ratio = size / start.abs();
            let turned = log_normal_cdf(found * start.signum() / error(k).max(f64::MIN_POSITIVE)).max(-TURNED.ln());
            sum += turned - ratio.ln() - (1.0 + (ratio.ln() / USUAL).powi(2)).ln();
        }
        sum += self.log_prior_of_runs(point, grams, evidence);
        sum + if point.faults.is_empty() { 0.0 } else { self.witness.gain(&point.edits(), &self.balances) }
    }

    /// What belongs to a run is log-uniform, smoothed within its error: no unit of a state enters.
    fn log_prior_of_runs(&self, point: &Point, grams: &Grams, evidence: &Evidence) -> f64 {
        let mut sum = 0.0;
        for ((run, theta), own) in grams.runs().iter().zip(&point.theta).zip(&evidence.own) {
            for (k, (param, step)) in self.own.iter().zip(own).enumerate() {
                let diagonal = run.products.chunks_exact(run.width * run.width).map(|matrix| matrix[k * run.width + k]);
                let information: f64 = diagonal.zip(&evidence.weights).map(|(v, w)| v * w).sum();
                let value = theta[*param] + step;
                sum -= value.hypot(information.powf(-0.5).min(f64::MAX)).max(f64::MIN_POSITIVE).ln();
            }
        }
        sum
    }

    /// The sum over outputs of what a point leaves, in half of the logarithms of its squares: the likelihood of white noise, turned round. Its columns
    /// go where they leave least.
    fn plain(&self, grams: &Grams) -> Option<(f64, Evidence)> {
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
        let left = (0..q).filter(|o| powers[*o] > 0.0).map(|o| 0.5 * bins(o) * (powers[o] / bins(o)).ln()).sum();
        Some((left, evidence?))
    }

    /// What a point leaves by white noise, after a step to where that is least.
    pub(crate) fn plainly_left(&self, point: &Point, responses: &Responses) -> Option<f64> {
        Some(self.plain(&self.grams(point, responses)?)?.0)
    }

    /// A point after a few steps of a plain fit: where a phase is off by periods, or the fit was led astray, the noise that is found beside it hides the
    /// way.
    pub(crate) fn plainly(&self, mut point: Point) -> Option<Point> {
        for _ in 0..STEPS {
            if !self.work.goes_on() {
                return None;
            }
            let grams = self.grams(&point, &self.responses(&point.theta, &point.edits(), true)?)?;
            let (_, step) = self.plain(&grams)?;
            if step.gain < PLAINLY {
                break;
            }
            let before = self.weighted(&point, &step.weights);
            let mut tried = PARTS.iter().map(|part| self.moved(&point, &step, *part));
            match tried.find(|next| self.weighted(next, &step.weights) < before) {
                Some(next) => point = next,
                None => break,
            }
        }
        Some(point)
    }

    /// A part of the step that the evidence proposes, within bounds.
    fn moved(&self, point: &Point, evidence: &Evidence, part: f64) -> Point {
        let (mut moved, params) = (point.clone(), &self.model.definition().params);
        for (k, step) in self.shared.iter().zip(&evidence.mean) {
            let value = (point.theta[0][*k] + part * step).clamp(params[*k].lower, params[*k].upper);
            moved.theta.iter_mut().for_each(|theta| theta[*k] = value);
        }
        for (theta, own) in moved.theta.iter_mut().zip(&evidence.own) {
            for (k, step) in self.own.iter().zip(own) {
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

    /// Weighted squares of what a point leaves; infinite where it has no response.
    fn weighted(&self, point: &Point, weights: &[f64]) -> f64 {
        let edits = point.edits();
        let Some(responses) = self.responses(&point.theta, &edits, false) else { return f64::INFINITY };
        let of = |r: usize| -> f64 {
            let bins = &self.binning.runs[r];
            let left = bins.of(&self.residual(r, &responses, &edits), false);
            let power = |begin: usize, end: usize| left[begin..end].iter().map(|v| v * v).sum::<f64>();
            bins.segments.iter().map(|s| weights[s.place] * power(s.begin, s.end)).sum()
        };
        let sum: f64 = (0..self.runs.len()).map(of).sum();
        if sum.is_finite() { sum } else { f64::INFINITY }
    }

    /// A point fitted by its own noise, with the greatest evidence on the way; none where it has no response.
    pub(crate) fn refit(&self, point: Point, weights: Option<&[f64]>) -> Option<(Point, Judged)> {
        let mut judged = self.judge(&point, weights)?;
        let mut point = point;
        let mut best: Option<(Point, Judged)> = None;
        for _ in 0..STEPS {
            if judged.evidence.gain < SETTLED || !self.work.goes_on() {
                break;
            }
            let own = judged.evidence.weights.clone();
            let before = self.weighted(&point, &own);
            let mut tried = PARTS.iter().map(|part| self.moved(&point, &judged.evidence, *part));
            let Some(next) = tried.find(|next| self.weighted(next, &own) < before) else { break };
            let Some(found) = self.judge(&next, Some(&own)) else { break };
            if best.as_ref().is_none_or(|(_, b)| judged.log > b.log) {
                best = Some((point, judged));
            }
            (point, judged) = (next, found);
        }
        match best {
            Some(best) if best.1.log > judged.log => Some(best),
            _ => Some((point, judged)),
        }
    }

    /// Standard error of the size of a fault of a point.
    pub(crate) fn error_of(&self, point: &Point, judged: &Judged, k: usize) -> f64 {
        let q = judged.evidence.mean.len();
        let before = point.faults[..k].iter().filter(|f| matches!(f, Planted::Sized(..))).count();
        let at = self.shared.len() + before;
        judged.evidence.covariance.get(at * q + at).map_or(f64::INFINITY, |v| v.max(0.0).sqrt())
    }

    /// What leaves of the parameters a point has, beside another one, in standard errors of that.
    pub(crate) fn biases(&self, without: &Point, (with, judged): (&Point, &Judged)) -> Vec<fdm_doctor::Bias> {
        const LEAST: f64 = 0.1;
        let q = judged.evidence.mean.len();
        let params = &self.model.definition().params;
        let of = |(k, param): (usize, &usize)| {
            let error = judged.evidence.covariance[k * q + k].max(0.0).sqrt();
            let standard_errors = (without.theta[0][*param] - with.theta[0][*param]) / error;
            let parameter = params[*param].quantity.name.clone();
            standard_errors.is_finite().then_some(fdm_doctor::Bias { parameter, standard_errors })
        };
        let mut all: Vec<fdm_doctor::Bias> = self.shared.iter().enumerate().filter_map(of).collect();
        all.retain(|b| b.standard_errors.abs() >= LEAST);
        all.sort_by(|a, b| b.standard_errors.abs().total_cmp(&a.standard_errors.abs()));
        all
    }
}
