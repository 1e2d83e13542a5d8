//! How likely a record is beside a model and beside kinematics: the concentrated likelihood of Gaussian noise, less what the values of
//! parameters would have to be.

use crate::filtered::Filtered;
use crate::hypothesis::{Channels, Edit, Slot, between_samples, edited, edited_record, lags_of, time_factor};
use crate::kinematics::Kinematics;
use crate::record::Record;
use crate::spectrum::{Bands, interpolated};
use fdm_estimate::{
    Changes, Continuation, DerivedQuantities, Estimate, FitOptions, Options, Problem, ProblemRun, RunResponse,
    SharedSteps, Termination, Work, estimate, fit, is_lost_at_start, starts,
};
use fdm_system::Model;
use fdm_system::record::Run;
use fdm_system::simulate::{Simulator, Steps};

/// What hypotheses are judged by: the runs beside their model, where there is one, and the records beside kinematics.
pub(crate) struct Evidence<'a> {
    pub(crate) model: Option<&'a Model>,
    pub(crate) runs: &'a [Run],
    pub(crate) records: &'a [Record],
    pub(crate) channels: &'a Channels,
    pub(crate) kinematics: Kinematics,
    /// Magnitude of the model's fastest mode times the usual interval, where that is known.
    pub(crate) pace: Option<f64>,
    /// When there is no more time for fits; asked while they work.
    pub(crate) work: &'a Work<'a>,
}

/// Radians of the fastest mode between two samples, beyond which no motion could be fitted.
pub(crate) const FASTEST: f64 = 30.0;

/// Parts of all records together in which a fault has to hold up.
const LEAST_BLOCKS: usize = 4;

/// Of what is no gap.
fn mean_square(e: &[f64]) -> f64 {
    let known = e.iter().filter(|v| !v.is_nan());
    let (sum, count) = known.fold((0.0, 0.0), |(s, n), v| (s + v * v, n + 1.0));
    sum / count
}

/// Iterations of the fits that count.
pub(crate) const THOROUGH: usize = 40;

/// A fit of the edited record.
#[derive(Debug, Clone, Default)]
pub(crate) struct Trial {
    /// Sum of squares over that of the measured values about their mean: one for each output, then one for each equation of kinematics. NaN
    /// where nothing was measured. Exchanged and rescaled columns compare by these parts, as the factor drops out.
    parts: Vec<f64>,
    /// Independent samples that the residuals are worth, for each part.
    independent: Vec<f64>,
    /// The sums of squares of the outputs in bands of frequency; none where nothing was measured.
    bands: Vec<Option<Bands>>,
    /// Mean squares of the outputs in parts of the records, over the variance: those of each output one behind the other.
    blocks: Vec<f64>,
    /// What the values of parameters cost, and the gains of kinematics, in nats.
    values: [f64; 2],
    /// None where nothing could be simulated, or nothing was fitted.
    pub(crate) estimate: Option<Estimate>,
    /// Residuals of each run (N by q) where there is no estimate to hold them.
    residuals: Vec<Vec<f64>>,
    /// The steps of the simulation, which fits that are near share.
    pub(crate) steps: ChosenSteps,
}

/// Steps that were chosen for a fit.
#[derive(Debug, Clone, Default)]
pub(crate) struct ChosenSteps {
    shared: SharedSteps,
    /// Of each run; empty where nothing was chosen.
    pub(crate) of_runs: Vec<Steps>,
    /// What the times had been multiplied by.
    factor: f64,
}

/// Where a fit begins.
#[derive(Clone, Copy)]
pub(crate) struct Begin<'a> {
    /// Start values other than those of the text.
    pub(crate) model: Option<&'a Model>,
    /// A fit whose steps are fine enough for this one too; without one they are chosen anew.
    pub(crate) steps: Option<&'a Trial>,
}

impl Begin<'_> {
    /// At the values of the text, with steps of its own.
    pub(crate) const TEXT: Self = Self { model: None, steps: None };
}

impl Evidence<'_> {
    /// Outputs of the model.
    fn outputs(&self) -> usize {
        self.model.map_or(0, |m| m.layout().outputs)
    }

    /// Gaussian-noise fit of the runs with some edits; none where nothing can be simulated.
    pub(crate) fn trial(&self, begin: Begin<'_>, edits: &[Edit], iterations: usize) -> Option<Trial> {
        let beside = match self.model {
            Some(model) => self.beside(model, begin, edits, Self::options(model, iterations))?,
            None => Trial::default(),
        };
        Some(self.with_kinematics(beside, edits))
    }

    /// The runs as they are. Where the start values lead to no minimum, by way of the beginnings of the runs: what is not reached otherwise is no
    /// fault of the record. Other fallbacks of a fit would swallow faults: segments have initial values of their own, substituted states
    /// are the record itself.
    pub(crate) fn base(&self) -> Option<Trial> {
        /// Times the iterations of a fit that its parts may take together.
        const MOST: usize = 4;
        /// Parts of the runs that are fitted first.
        const BEGINNINGS: [f64; 2] = [0.25, 0.5];
        // a plain fit of a response that is lost settles anywhere
        let lost_at_start = self.model.is_some_and(|model| is_lost_at_start(model, self.runs));
        let plain = if lost_at_start { None } else { self.trial(Begin::TEXT, &[], THOROUGH) };
        let has = |trial: &Trial, ended: fn(&Termination) -> bool| {
            trial.estimate.as_ref().is_some_and(|e| ended(&e.termination))
        };
        let settled = plain.as_ref().is_some_and(|plain| has(plain, Termination::is_good));
        let Some(model) = self.model.filter(|_| !settled) else { return plain };
        // a fit itself looks first how far a response that is lost can be followed
        let continuation = if lost_at_start { Continuation::Auto } else { Continuation::Shares(BEGINNINGS.to_vec()) };
        let mut options = FitOptions { continuation, ..Self::options(model, THOROUGH) };
        options.options.total = Some(MOST * THOROUGH);
        let led = self.beside(model, Begin::TEXT, &[], options).map(|beside| self.with_kinematics(beside, &[]));
        let lost = |ended: &Termination| matches!(ended, Termination::Unstable { .. });
        match (plain, led) {
            (Some(plain), Some(led)) if !has(&led, lost) && plain.gain_over(&led) > 0.0 => Some(plain),
            (plain, led) => led.or(plain),
        }
    }

    /// What residuals of the edited runs (N by q each) are worth, with no estimate behind them. The values of parameters cost as in `near`.
    pub(crate) fn unestimated(
        &self,
        residuals: Vec<Vec<f64>>,
        runs: &[Run],
        edits: &[Edit],
        near: &Trial,
    ) -> Option<Trial> {
        let left: Vec<&[f64]> = residuals.iter().map(|r| &r[..]).collect();
        let judged = self.judged(&left, runs, edits)?;
        let (values, steps) = ([near.values[0], 0.0], near.steps.clone());
        Some(self.with_kinematics(Trial { values, steps, residuals, ..judged }, edits))
    }

    /// The trial where the edits behind `current` leave the runs of the model as they are: nothing is fitted.
    pub(crate) fn unfitted(&self, current: &Trial, edits: &[Edit]) -> Trial {
        self.with_kinematics(current.clone(), edits)
    }

    /// Whether these edits change what the model is compared with.
    pub(crate) fn touches_model(&self, edits: &[Edit]) -> bool {
        let other = |s: Slot| matches!(s, Slot::Other(_));
        self.model.is_some()
            && !edits.iter().all(|edit| match *edit {
                Edit::Affine(s, ..)
                | Edit::Delay(s, _)
                | Edit::Drift(s, _)
                | Edit::Step(s, ..)
                | Edit::Filter(s, _) => other(s),
                Edit::Swap(a, b) => other(a) && other(b),
                Edit::Time(_) => false,
            })
    }

    /// With the part of kinematics anew.
    fn with_kinematics(&self, mut trial: Trial, edits: &[Edit]) -> Trial {
        let q = self.outputs();
        trial.parts.truncate(q);
        trial.independent.truncate(q);
        trial.values[1] = 0.0;
        for balance in self.kinematics.balances(self.records, self.channels, edits) {
            trial.parts.push(balance.unexplained);
            trial.independent.push(balance.independent);
            trial.values[1] += balance.cost;
        }
        trial
    }

    /// Leaves out the equations of kinematics that the model itself breaks, as its outputs are late or scaled by intent.
    pub(crate) fn without_broken_equations(&mut self, current: Trial) -> Trial {
        // between samples that are so far apart the response says nothing of its derivatives: the times may be in another unit
        let resolved = self.pace.is_none_or(|pace| pace <= FASTEST);
        if let Some(estimate) = current.estimate.as_ref().filter(|_| resolved) {
            let mut response: Vec<Record> = self.records.to_vec();
            let q = self.outputs();
            let mut foreign = vec![true; self.channels.slots().count()];
            for (record, fit) in response.iter_mut().zip(&estimate.runs) {
                for output in 0..q {
                    let place = self.channels.place(Slot::Output(output));
                    foreign[place] = false;
                    record.channels[place].values = fit.response.iter().skip(output).step_by(q).copied().collect();
                }
            }
            self.kinematics = std::mem::take(&mut self.kinematics).held_by(&response, &foreign, self.channels);
        }
        self.with_kinematics(current, &[])
    }

    fn beside(&self, model: &Model, begin: Begin<'_>, edits: &[Edit], options: FitOptions) -> Option<Trial> {
        if !self.work.goes_on() {
            return None;
        }
        let new = self.edited_runs(model, edits)?;
        let lags = lags_of(edits);
        let begun = begin.model.unwrap_or(model);
        let near = begin.steps.filter(|near| near.steps.suit(edits, new.len()));
        let on = |near: &Trial| on_steps(begun, &near.steps.of_runs, &new, &lags, &options, self.work);
        let again = near.filter(|_| is_plain(model)).and_then(on);
        let (estimate, steps) = match (again, near) {
            (Some(estimate), Some(near)) => (estimate, near.steps.clone()),
            // a model with a lag behind it is no model of this package
            _ if !lags.is_empty() => return None,
            _ => {
                let shared_steps = near.map_or_else(SharedSteps::default, |t| t.steps.shared.clone());
                let options = FitOptions { shared_steps, ..options };
                let found = fit(begun, &new, &options, &self.work.quiet()).ok()?;
                let of_runs = found.integration.iter().map(|a| a.steps.clone()).collect();
                let (shared, factor) = (SharedSteps::of(found.integration), time_factor(edits));
                (found.estimate, ChosenSteps { shared, of_runs, factor })
            }
        };
        // a fit that was ended early says nothing beside one that was not
        if !self.work.goes_on() {
            return None;
        }
        let left: Vec<&[f64]> = estimate.runs.iter().map(|r| &r.residuals[..]).collect();
        let judged = self.judged(&left, &new, edits)?;
        let values = [cost_of_values(model, &estimate), 0.0];
        Some(Trial { values, estimate: Some(estimate), steps, ..judged })
    }

    /// How a model is fitted.
    pub(crate) fn options(model: &Model, iterations: usize) -> FitOptions {
        FitOptions {
            options: Options {
                iterations,
                total: Some(2 * iterations),
                colour: false,
                tolerance: 1e-5,
                ..Options::default()
            },
            accuracy: Some(1e-5),
            continuation: Continuation::Never,
            bare: true,
            ..FitOptions::default()
        }
        .with_declared_noise(model)
    }

    /// The runs as edits of their records make them; none where that cannot be.
    pub(crate) fn edited_runs(&self, model: &Model, edits: &[Edit]) -> Option<Vec<Run>> {
        let pairs = self.runs.iter().zip(self.records);
        let new = pairs.map(|(run, record)| edited(run, record, self.channels, edits, model.definition()));
        new.collect::<Result<Vec<_>, _>>().ok()
    }

    /// What residuals of the edited runs are worth: the part of a trial that they determine.
    fn judged(&self, residuals: &[&[f64]], new: &[Run], edits: &[Edit]) -> Option<Trial> {
        let q = self.outputs();
        if residuals.iter().all(|r| r.is_empty()) {
            return None;
        }
        let (mut parts, mut independent, mut bands) = (vec![f64::NAN; q], vec![0.0; q], vec![None; q]);
        let mut blocks = Vec::new();
        let pieces = LEAST_BLOCKS.div_ceil(self.runs.len().max(1));
        for output in 0..q {
            let begun = blocks.len();
            let (mut sum, mut count, mut worth) = (0.0, 0usize, 0.0);
            let mut spectrum = self.no_bands();
            for (left, record) in residuals.iter().zip(self.records) {
                let all: Vec<f64> = left.iter().skip(output).step_by(q).copied().collect();
                blocks.extend(all.chunks(all.len().div_ceil(pieces).max(1)).map(mean_square));
                let mut e: Vec<f64> = all.into_iter().filter(|v| !v.is_nan()).collect();
                sum += e.iter().map(|v| v * v).sum::<f64>();
                count += e.len();
                worth += independent_samples(&e);
                let left = left_of_noise(record, edits, Slot::Output(output));
                spectrum.add(&mut e, left);
            }
            let measured = new.iter().flat_map(|r| r.measured.iter().skip(output).step_by(q).copied());
            let variance = variance(measured);
            if count > 0 && variance > 0.0 {
                parts[output] = sum / count as f64 / variance;
                independent[output] = worth;
                bands[output] = Some(spectrum.relative_to(&self.measured(edits, Slot::Output(output)), variance));
                blocks[begun..].iter_mut().for_each(|b| *b /= variance);
            }
        }
        Some(Trial { parts, independent, bands, blocks, ..Trial::default() })
    }

    /// The bands of the column that edits put in the place of a channel, about the mean of each record, before it is moved in time or filtered.
    fn measured(&self, edits: &[Edit], slot: Slot) -> Bands {
        let placed = |e: &&Edit| matches!(e, Edit::Affine(..) | Edit::Swap(..));
        let placed: Vec<Edit> = edits.iter().filter(placed).copied().collect();
        let mut bands = self.no_bands();
        for record in self.records {
            let edited = edited_record(record, self.channels, &placed, &[]);
            let column = edited.columns[self.channels.place(slot)].iter().copied();
            let mut values: Vec<f64> = column.filter(|v| v.is_finite()).collect();
            let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
            values.iter_mut().for_each(|v| *v -= mean);
            bands.add(&mut values, |_| 1.0);
        }
        bands
    }

    /// Bands of the longest record, which those of all others fit into.
    fn no_bands(&self) -> Bands {
        Bands::new(self.records.iter().map(|r| r.time.len()).max().unwrap_or(0))
    }

    /// The outputs about their means: what a model that explains nothing leaves. None where nothing was measured.
    pub(crate) fn unexplained(&self, edits: &[Edit]) -> Option<Trial> {
        let q = self.outputs();
        let (mut parts, mut independent, mut bands) = (vec![f64::NAN; q], vec![0.0; q], vec![None; q]);
        for output in 0..q {
            let slot = Slot::Output(output);
            let place = self.channels.place(slot);
            let columns = self.records.iter().flat_map(|r| {
                let edited = edited_record(r, self.channels, edits, &[]);
                edited.columns[place].iter().copied().filter(|v| v.is_finite()).collect::<Vec<f64>>()
            });
            let values: Vec<f64> = columns.collect();
            let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
            let mut e: Vec<f64> = values.iter().map(|v| v - mean).collect();
            let variance = variance(values.iter().copied());
            if variance > 0.0 {
                parts[output] = 1.0;
                independent[output] = independent_samples(&e);
                let mut spectrum = self.no_bands();
                spectrum.add(&mut e, |_| 1.0);
                bands[output] = Some(spectrum.relative_to(&self.measured(edits, slot), variance));
            }
        }
        let measured = parts.iter().any(|s| !s.is_nan());
        let trial = Trial { parts, independent, bands, ..Trial::default() };
        measured.then(|| self.with_kinematics(trial, edits))
    }
}

/// About the mean, of finite numbers.
pub(crate) fn variance(values: impl Iterator<Item = f64>) -> f64 {
    let (mut n, mut mean, mut squares) = (0.0, 0.0, 0.0);
    for v in values.filter(|v| v.is_finite()) {
        n += 1.0;
        let d = v - mean;
        mean += d / n;
        squares += d * (v - mean);
    }
    squares / f64::max(n, 1.0)
}

/// Whether its fit is one of squares alone: no parameter stands in a noise.
pub(crate) fn is_plain(model: &Model) -> bool {
    let definition = model.definition();
    !definition.only_in_noise().contains(&true) && definition.outputs.iter().all(|o| o.noise_model.is_none())
}

impl ChosenSteps {
    /// Whether so many runs can be simulated on them as edits make the runs.
    fn suit(&self, edits: &[Edit], runs: usize) -> bool {
        self.of_runs.len() == runs && runs > 0 && (self.factor / time_factor(edits) - 1.0).abs() < 1e-9
    }
}

/// All parameters of each run: the estimates, and what the model and the run say of the others.
pub(crate) fn parameters_of_runs(model: &Model, runs: &[Run], estimate: &Estimate) -> Vec<Vec<f64>> {
    let mut all = starts(model, runs, &Changes::default());
    for (run, theta) in runs.iter().zip(&mut all) {
        for (value, param) in theta.iter_mut().zip(&model.definition().params) {
            let owner = param.per_run.then_some(run.name.as_str());
            let found = estimate.parameter(&param.quantity.name, owner).filter(|_| !param.fixed);
            *value = found.map_or(*value, |p| p.value);
        }
    }
    all
}

/// A fit on steps that are known to be fine enough, with lags behind outputs. None where it cannot be simulated from its start.
fn on_steps(
    model: &Model,
    steps: &[Steps],
    runs: &[Run],
    lags: &[(usize, f64)],
    options: &FitOptions,
    work: &Work<'_>,
) -> Option<Estimate> {
    let starts = starts(model, runs, &Changes::default());
    let mut prepared = Vec::with_capacity(runs.len());
    for ((run, start), steps) in runs.iter().zip(&starts).zip(steps) {
        let mut simulator = Simulator::new(model.dynamics(), run, steps.clone()).ok()?;
        simulator.suits(start).ok()?;
        let response = match lags.is_empty() {
            true => RunResponse::in_time(simulator),
            false => RunResponse::in_time(Filtered::new(simulator, lags)),
        };
        let (name, measured, start) = (run.name.clone(), run.measured.clone(), start.clone());
        prepared.push(ProblemRun { name, response, measured, start });
    }
    let derived = DerivedQuantities::of(model.definition(), model.dynamics());
    let mut problem = Problem::new(model.definition(), prepared, derived);
    let found = estimate(&mut problem, &options.options, &work.quiet()).ok()?;
    Some(found).filter(|e| !e.runs.is_empty())
}

/// The part of noise that edits leave of a channel at an angle per sample, as they read it between samples.
fn left_of_noise(record: &Record, edits: &[Edit], slot: Slot) -> impl Fn(f64) -> f64 {
    let between = between_samples(record, edits, slot);
    move |angle| interpolated(between, angle)
}

/// Samples over the sum of autocorrelations up to the first that is not above chance: white residuals count in full.
pub(crate) fn independent_samples(e: &[f64]) -> f64 {
    const LONGEST: usize = 400;
    let n = e.len();
    let power: f64 = e.iter().map(|v| v * v).sum();
    if n < 4 || power <= 0.0 {
        return n as f64;
    }
    let chance = 2.0 / (n as f64).sqrt();
    let mut sum = 1.0;
    for lag in 1..LONGEST.min(n / 3 + 1) {
        let r: f64 = e.iter().zip(&e[lag..]).map(|(a, b)| a * b).sum::<f64>() / power;
        if r < chance {
            break;
        }
        sum += 2.0 * r;
    }
    n as f64 / sum
}

/// What it costs in nats that parameters are away from where the text says they start. A Cauchy law over the logarithm of the factor (half of
/// all within a factor of two), and one start in a thousand has the wrong sign.
fn cost_of_values(model: &Model, estimate: &Estimate) -> f64 {
    const USUAL: f64 = std::f64::consts::LN_2;
    let free = model.definition().params.iter().filter(|p| !p.fixed && p.value != 0.0 && !p.per_run);
    let cost = |p: &fdm_grammar::model::Param| {
        let Some(found) = estimate.parameter(&p.quantity.name, None) else { return 0.0 };
        // a value that the record hardly determines says nothing
        if found.standard_error.is_none_or(|e| 2.0 * e > found.value.abs().max(p.value.abs())) {
            return 0.0;
        }
        let ratio = found.value / p.value;
        let size = if ratio == 0.0 { 0.0 } else { (1.0 + (ratio.abs().ln() / USUAL).powi(2)).ln() };
        size + if ratio < 0.0 { 1000f64.ln() } else { 0.0 }
    };
    free.map(cost).sum()
}

impl Trial {
    /// Measured minus model of each run (N by q).
    pub(crate) fn residuals(&self) -> Vec<&[f64]> {
        match &self.estimate {
            Some(estimate) => estimate.runs.iter().map(|r| &r.residuals[..]).collect(),
            None => self.residuals.iter().map(|r| &r[..]).collect(),
        }
    }

    /// The model with these estimates as start values; those of each run begin as the text says.
    pub(crate) fn begun(&self, model: &Model) -> Model {
        let Some(estimate) = &self.estimate else { return model.clone() };
        let mut params = model.definition().params.clone();
        for param in params.iter_mut().filter(|p| !p.fixed && !p.per_run) {
            let found = estimate.parameter(&param.quantity.name, None).map(|p| p.value);
            let found = found.filter(|v| v.is_finite() && *v >= param.lower && *v <= param.upper);
            param.value = found.filter(|v| !param.logarithmic || *v > 0.0).unwrap_or(param.value);
        }
        model.with_params(params)
    }

    /// Gain in log-likelihood over another trial of the same record, in nats, beside noise that is alike in all frequencies. Outputs count by
    /// independent samples, equations of kinematics by independent windows.
    pub(crate) fn gain_over(&self, other: &Self) -> f64 {
        let outputs = (0..self.bands.len()).map(|k| self.gain_of_part(other, k)).sum::<f64>();
        outputs + self.gain_of_kinematics(other) + other.values[0] - self.values[0]
    }

    /// Gain in log-likelihood of a fault with an estimated number, which a model error may be mistaken for: no more
    /// than beside noise, and error, of any spectrum, in bands of frequency. A fit that trades one band for another is
    /// no likelier.
    pub(crate) fn cautious_gain_over(&self, other: &Self) -> f64 {
        let pairs = self.bands.iter().zip(&other.bands);
        let bands = pairs.filter_map(|(own, other)| Some(own.as_ref()?.gain_over(other.as_ref()?))).sum::<f64>();
        let alike = (0..self.bands.len()).map(|k| self.gain_of_part(other, k)).sum::<f64>();
        self.gain_over(other) + (bands - alike).min(0.0) - self.merit_of_gaps(other)
    }

    /// What a trial gains over another one, in nats, because it is not compared at samples that the other one fits badly: a channel that is
    /// moved in time leaves its ends open.
    fn merit_of_gaps(&self, other: &Self) -> f64 {
        let (own, others) = (self.residuals(), other.residuals());
        let q = self.bands.len();
        let merit = |output: usize| {
            let rows = own.iter().zip(&others);
            let pairs = rows.flat_map(|(a, b)| a.iter().zip(b.iter()).skip(output).step_by(q));
            let ([mut all, mut common], mut counts) = ([0.0; 2], [0.0; 2]);
            for (own, other) in pairs.filter(|(_, other)| !other.is_nan()) {
                (all, counts[0]) = (all + other * other, counts[0] + 1.0);
                if !own.is_nan() {
                    (common, counts[1]) = (common + other * other, counts[1] + 1.0);
                }
            }
            if counts[0] == counts[1] || common <= 0.0 {
                return 0.0;
            }
            (0.5 * counts[1] * (all / counts[0] / (common / counts[1])).ln()).max(0.0)
        };
        (0..q).map(merit).sum()
    }

    /// Gain in one sum of squares, by the independent samples of the trial with the smaller one: what the other leaves is its own error.
    fn gain_of_part(&self, other: &Self, k: usize) -> f64 {
        let (own, others) = (self.parts[k], other.parts[k]);
        if own.is_nan() || others.is_nan() {
            return 0.0;
        }
        let worth = if own < others { self.independent[k] } else { other.independent[k] };
        let floor = f64::MIN_POSITIVE;
        0.5 * worth * (others.max(floor) / own.max(floor)).ln()
    }

    /// Gain over another trial of the same record in each part of it, by the independent samples of the outputs.
    pub(crate) fn gains_by_part(&self, other: &Self) -> Vec<f64> {
        let outputs = self.bands.len().max(1);
        let parts = self.blocks.len() / outputs;
        if parts == 0 || other.blocks.len() != self.blocks.len() {
            return Vec::new();
        }
        let gain = |part: usize| {
            let of = |output: usize| {
                let (own, others) = (self.blocks[output * parts + part], other.blocks[output * parts + part]);
                let worth = self.independent[output].min(other.independent[output]) / parts as f64;
                let gain = 0.5 * worth * (others.max(f64::MIN_POSITIVE) / own.max(f64::MIN_POSITIVE)).ln();
                if gain.is_nan() { 0.0 } else { gain }
            };
            (0..outputs).map(of).sum()
        };
        (0..parts).map(gain).collect()
    }

    /// Gain over another trial of the same record by kinematics alone.
    pub(crate) fn gain_of_kinematics(&self, other: &Self) -> f64 {
        let equations = self.bands.len()..self.parts.len();
        equations.map(|k| self.gain_of_part(other, k)).sum::<f64>() + other.values[1] - self.values[1]
    }

    /// Part of the sums of squares that is left of another's, the least over outputs and equations.
    pub(crate) fn least_left(&self, other: &Self) -> f64 {
        let parts = self.parts.iter().zip(&other.parts).map(|(own, other)| own / other);
        parts.filter(|p| p.is_finite()).fold(1.0, f64::min)
    }

    /// Independent samples of all outputs and equations.
    pub(crate) fn worth(&self) -> f64 {
        self.independent.iter().sum()
    }
}

/// The best value of one number.
pub(crate) struct Searched {
    pub(crate) value: f64,
    pub(crate) error: f64,
    pub(crate) trial: Trial,
}

/// By fits at three places about 0, then at the vertex of the parabola through their likelihoods, from where it goes on while it gains. It ends at
/// once where the parabola promises less than half of the gain that is `needed`.
pub(crate) fn search(
    step: f64,
    base: &Trial,
    needed: f64,
    at: &(dyn Fn(f64) -> Option<Trial> + Sync),
) -> Option<Searched> {
    const ROUNDS: usize = 8;
    let (mut middle, mut width) = ((0.0, base.clone()), step);
    let mut error = f64::INFINITY;
    for round in 0..ROUNDS {
        let (left, right) = (at(middle.0 - width), at(middle.0 + width));
        let gain = |t: &Option<Trial>| t.as_ref().map_or(f64::NEG_INFINITY, |t| t.cautious_gain_over(&middle.1));
        let (l, r) = (gain(&left), gain(&right));
        if l <= 0.0 && r <= 0.0 {
            // within the bracket: the vertex
            if !l.is_finite() || !r.is_finite() {
                // beyond what the number may be: nearer, where anything was gained at all
                if middle.0 == 0.0 {
                    break;
                }
                width *= 0.5;
                continue;
            }
            let curvature = -(l + r) / (width * width);
            if curvature <= 0.0 || round == 0 && (r - l).powi(2) < -8.0 * (l + r) * 0.5 * needed {
                break;
            }
            error = 1.0 / curvature.sqrt();
            let vertex = middle.0 + 0.5 * (r - l) / width / curvature;
            if let Some(better) = at(vertex).filter(|t| t.cautious_gain_over(&middle.1) > 0.0) {
                middle = (vertex, better);
            }
            if width < 2.0 * error {
                break;
            }
            width = (0.25 * width).max(error);
        } else {
            // uphill, with longer steps
            let side = if l > r { -width } else { width };
            if let Some(better) = if l > r { left } else { right } {
                middle = (middle.0 + side, better);
            }
            width *= 1.7;
        }
    }
    (middle.0 != 0.0).then_some(Searched { value: middle.0, error, trial: middle.1 })
}
