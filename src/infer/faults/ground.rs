//! What hypotheses about a record are judged on: the responses of a model to the runs as edits make them, linearised, in bins.

use super::output_edits::{is_of_others, is_of_outputs, touched, undone};
use crate::bins::Signals;
use crate::candidates::fitted_model::FittedModel;
use crate::candidates::runs::Runs;
use crate::evidence::binning::{Binning, RunBins};
use crate::evidence::gram::Grams;
use fdm_doctor::{Balance, Channels, Edit, Estimated, Fault, Hypothesis, Record, Slot, Witness, edited, time_factor};
use fdm_estimate::residuals::residuals;
use fdm_estimate::{Changes, Work, starts, with_initials};
use fdm_grammar::graph::Leaf;
use fdm_grammar::model::Origin;
use fdm_numeric::parallel;
use fdm_system::model::Model;
use fdm_system::record::Run;
use fdm_system::simulate::{Scheme, Simulator, StepOptions, Steps, choose_steps};
use std::collections::BTreeMap;
use std::sync::{Mutex, OnceLock, PoisonError};

/// Part of an output's deviation by which its zero is moved for a derivative; of offsets the derivative is exact.
const SMALL: f64 = 1e-3;

/// A fault in a record: what it is, and its size where that is estimated.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Planted {
    /// With nothing to be estimated.
    Discrete(Hypothesis),
    /// Of this size.
    Sized(Estimated, f64),
    /// A state (its place among [`Ground::stated`]) begins in each run where the record has it, and not where the model says.
    Beginning(usize),
}

impl Planted {
    /// What mends it.
    pub(crate) fn edits(&self) -> Vec<Edit> {
        match self {
            Self::Discrete(hypothesis) => hypothesis.edits.clone(),
            Self::Sized(fault, size) => vec![fault.edit(*size)],
            Self::Beginning(_) => Vec::new(),
        }
    }

    /// Its share of the prior probability.
    pub(crate) fn weight(&self) -> f64 {
        match self {
            Self::Discrete(hypothesis) => hypothesis.weight,
            Self::Sized(fault, size) => fault.weight(*size),
            Self::Beginning(_) => 1.0,
        }
    }

    pub(crate) fn fault(&self) -> Fault {
        match self {
            Self::Discrete(hypothesis) => hypothesis.fault,
            Self::Sized(fault, _) => fault.fault,
            Self::Beginning(_) => Fault::Beginning,
        }
    }

    pub(crate) fn slots(&self) -> Vec<Slot> {
        match self {
            Self::Discrete(hypothesis) => hypothesis.slots.clone(),
            Self::Sized(fault, _) => vec![fault.slot],
            Self::Beginning(_) => Vec::new(),
        }
    }

    /// Whether it is the same kind at the same channels.
    pub(crate) fn is_like(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Discrete(a), Self::Discrete(b)) => a.edits == b.edits,
            (Self::Sized(a, _), Self::Sized(b, _)) => a == b,
            (Self::Beginning(a), Self::Beginning(b)) => a == b,
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
}

/// Responses of all runs with their derivatives, as the inputs of some edits make them, before what edits do to outputs.
pub(crate) struct Responses {
    time: Vec<Vec<f64>>,
    y: Vec<Signals>,
    /// Of each run, the derivatives by these parameters.
    asked: Vec<usize>,
    columns: Vec<Vec<Signals>>,
    /// The same in bins, once they are needed.
    bins: OnceLock<Vec<Vec<Vec<f64>>>>,
}

/// A state whose initial value the model states as a constant.
pub(crate) struct Stated {
    /// The parameter of each run that stands in its place.
    pub(crate) param: usize,
    pub(crate) name: String,
    pub(crate) unit: Option<String>,
}

/// The model with the stated constants as parameters, and what it states.
pub(crate) fn doubted(model: &Model, theta: &[f64]) -> (Model, Vec<Stated>) {
    let definition = model.definition();
    let computed =
        definition.graph.depends(|leaf| !matches!(leaf, Leaf::Param(k) if definition.params[k as usize].fixed));
    let extended = with_initials(model, theta, &|state| !computed[definition.states[state].initial.index()]);
    let own = extended.definition().params.iter().enumerate().skip(definition.params.len());
    let stated = own.filter_map(|(param, own)| match own.origin {
        Origin::FreeInitial(state) => {
            let state = &definition.states[state as usize].quantity;
            Some(Stated { param, name: state.name.clone(), unit: state.unit.as_ref().map(ToString::to_string) })
        }
        _ => None,
    });
    let stated = stated.collect();
    (extended, stated)
}

/// Values in the text, with the beginnings that runs show where the text states none.
fn begun(model: &Model, runs: &[Run], stated: &[Stated]) -> Vec<Vec<f64>> {
    let mut text = starts(model, runs, &Changes::default());
    let params = &model.definition().params;
    text.iter_mut().for_each(|theta| stated.iter().for_each(|s| theta[s.param] = params[s.param].value));
    text
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
    pub(crate) binning: Binning,
    steps: Vec<Steps>,
    /// Values at the fit, and the steps of each run in another unit of time (the bits of its factor), once they are needed.
    reached: Vec<Vec<f64>>,
    paced: Mutex<BTreeMap<(usize, u64), Option<Steps>>>,
    pub(crate) shared: Vec<usize>,
    /// Parameters of each run, without those of `stated`.
    pub(crate) own: Vec<usize>,
    pub(crate) stated: Vec<Stated>,
    /// Values in the text.
    pub(crate) text: Vec<Vec<f64>>,
    /// Deviation of each output, and the mean interval between samples that are compared.
    pub(crate) deviations: Vec<f64>,
    pub(crate) interval: f64,
    pub(crate) span: f64,
    pub(crate) work: &'a Work<'a>,
}

impl<'a> Ground<'a> {
    /// Of a model (of [`doubted`]) at its fit (of `every`-th samples of the runs) and its values there, with the records of the runs.
    pub(crate) fn new(
        (model, stated): (&'a Model, Vec<Stated>),
        (fitted, compared, every): (&FittedModel, &[Run], usize),
        reached: Vec<Vec<f64>>,
        (runs, witness): (&'a [Run], &'a Witness<'a>),
        work: &'a Work<'a>,
    ) -> Option<Self> {
        let domain = crate::candidates::Domain::Time;
        let all = Runs { all: compared, train: compared.len(), domain: &domain };
        let binning = Binning::new(fitted, all);
        let params = &model.definition().params;
        let known = |k: &usize| stated.iter().any(|s| s.param == *k);
        let pick = |own: bool| -> Vec<usize> {
            (0..params.len()).filter(|k| !params[*k].fixed && params[*k].per_run == own && !known(k)).collect()
        };
        let (shared, own) = (pick(false), pick(true));
        let text = begun(model, runs, &stated);
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
            reached,
            paced: Mutex::default(),
            shared,
            own,
            stated,
            text,
            deviations: (0..q).map(deviation).collect(),
            interval,
            span,
            work,
        })
    }

    pub(crate) fn outputs(&self) -> usize {
        self.deviations.len()
    }

    /// A point without one of its faults: a state begins where the model says again.
    pub(crate) fn without(&self, point: &Point, k: usize) -> Point {
        let mut without = point.clone();
        if let Planted::Beginning(state) = without.faults.remove(k) {
            let param = self.stated[state].param;
            without.theta.iter_mut().zip(&self.text).for_each(|(theta, text)| theta[param] = text[param]);
        }
        without
    }

    /// The unknowns of each run beside these faults.
    pub(crate) fn own(&self, faults: &[Planted]) -> Vec<usize> {
        let begun = faults
            .iter()
            .filter_map(|f| if let Planted::Beginning(k) = f { Some(self.stated[*k].param) } else { None });
        self.own.iter().copied().chain(begun).collect()
    }

    /// All unknowns of a point but sizes: shared ones, then those of each run.
    pub(crate) fn unknowns(&self, faults: &[Planted]) -> Vec<usize> {
        [&self.shared[..], &self.own(faults)].concat()
    }

    /// As [`Self::unknowns`], with all initial values that the model states.
    pub(crate) fn all_unknowns(&self, faults: &[Planted]) -> Vec<usize> {
        let mut all = self.unknowns(faults);
        all.extend(self.stated.iter().map(|s| s.param).filter(|p| !all.contains(p)).collect::<Vec<_>>());
        all
    }

    /// Whether edits leave all inputs, times and parameters as they are.
    pub(crate) fn keeps_inputs(&self, edit: &Edit) -> bool {
        let hidden = self.model.definition().inputs.len() > self.channels.inputs;
        is_of_others(edit) || is_of_outputs(edit) && !hidden
    }

    /// Values in the text, beside runs as edits make them.
    pub(crate) fn text_of(&self, edits: &[Edit]) -> Vec<Vec<f64>> {
        let of_outputs = |e: &Edit| matches!(e, Edit::Affine(Slot::Output(_), ..) | Edit::Swap(Slot::Output(_), _));
        if !edits.iter().any(of_outputs) {
            return self.text.clone();
        }
        let of = |r: usize| edited(&self.runs[r], &self.records[r], self.channels, edits, self.model.definition()).ok();
        let runs: Option<Vec<Run>> = (0..self.runs.len()).map(of).collect();
        runs.map_or_else(|| self.text.clone(), |runs| begun(self.model, &runs, &self.stated))
    }

    /// The edits that change what is simulated.
    fn simulated(&self, edits: &[Edit]) -> Vec<Edit> {
        if edits.iter().all(|e| self.keeps_inputs(e)) { Vec::new() } else { edits.to_vec() }
    }

    /// A run as edits make it, at the samples that are compared.
    fn run(&self, r: usize, edits: &[Edit]) -> Option<Run> {
        let run = match edits.is_empty() {
            true => self.runs[r].clone(),
            false => edited(&self.runs[r], &self.records[r], self.channels, edits, self.model.definition()).ok()?,
        };
        Some(if self.every > 1 { run.every(self.every) } else { run })
    }

    /// The steps of a run whose times edits multiply. Those of shorter intervals are good enough for them; in longer ones motion decays within a step,
    /// which implicit steps bear: chosen once, where the text begins, or where that has no response at the fit.
    fn steps(&self, r: usize, edits: &[Edit]) -> Option<Steps> {
        let factor = time_factor(edits);
        if factor <= 1.0 {
            return Some(self.steps[r].clone());
        }
        let known = || self.paced.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(chosen) = known().get(&(r, factor.to_bits())) {
            return chosen.clone();
        }
        let scheme = (!self.model.layout().affine.rates).then_some(Scheme::Radau);
        let options = StepOptions { scheme, ..StepOptions::default() }.to(Some(1e-4));
        let chosen = self.run(r, &[Edit::Time(factor)]).and_then(|run| {
            let at = |theta: &[f64]| {
                let theta = self.values(&run, theta);
                choose_steps(self.model.dynamics(), &run, &theta, &options).ok()
            };
            let first = at(&self.text[r])?;
            Some(if first.error.is_finite() { first.steps } else { at(&self.reached[r])?.steps })
        });
        known().insert((r, factor.to_bits()), chosen.clone());
        chosen
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

    /// Responses, with derivatives by these parameters.
    pub(crate) fn responses(&self, theta: &[Vec<f64>], edits: &[Edit], asked: &[usize]) -> Option<Responses> {
        let (dynamics, q, edits) = (self.model.dynamics(), self.outputs(), self.simulated(edits));
        let of = |r: usize| -> Option<(Vec<f64>, Signals, Vec<Signals>)> {
            let run = self.run(r, &edits)?;
            let theta = self.values(&run, &theta[r]);
            let mut simulator = Simulator::new(dynamics, &run, self.steps(r, &edits)?).ok()?;
            simulator.suits(&theta).ok()?;
            let mut y = vec![0.0; run.len() * q];
            if asked.is_empty() {
                simulator.simulate(&theta, &mut y).ok()?;
                return Some((run.time.clone(), y, Vec::new()));
            }
            let stride = asked.len().next_multiple_of(fdm_numeric::lanes::VECTOR);
            let mut jacobian = vec![0.0; y.len() * stride];
            simulator.sensitivities(&theta, asked, &mut y, &mut jacobian).ok()?;
            let column = |c: usize| -> Signals { jacobian.chunks_exact(stride.max(1)).map(|row| row[c]).collect() };
            Some((run.time.clone(), y, (0..asked.len()).map(column).collect()))
        };
        let all = parallel::map(0..self.runs.len(), of).into_iter().collect::<Option<Vec<_>>>()?;
        let mut found = Responses {
            time: Vec::new(),
            y: Vec::new(),
            asked: asked.to_vec(),
            columns: Vec::new(),
            bins: OnceLock::new(),
        };
        for (time, y, columns) in all {
            found.time.push(time);
            found.y.push(y);
            found.columns.push(columns);
        }
        Some(found)
    }

    /// What responses leave of a run's record, as edits have its outputs.
    pub(crate) fn residual(&self, r: usize, responses: &Responses, edits: &[Edit]) -> Signals {
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

    /// Columns of a point in bins, run by run: its own, the residual, parameters, and sizes of faults in their order.
    pub(crate) fn columns(&self, point: &Point, responses: &Responses) -> Option<Vec<Vec<Vec<f64>>>> {
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
                    own = self.responses(&point.theta, &edits, &[])?;
                    &own
                }
            };
            let of = |r: usize| -> Signals {
                let moved = self.residual(r, there, &edits);
                residuals[r].iter().zip(moved).map(|(a, b)| (a - b) / step).collect()
            };
            sizes.push((0..self.runs.len()).map(of).collect());
        }
        let places = |params: &[usize]| -> Option<Vec<usize>> {
            params.iter().map(|p| responses.asked.iter().position(|a| a == p)).collect()
        };
        let (own, shared) = (places(&self.own(&point.faults))?, places(&self.shared)?);
        let whole = responses.bins.get_or_init(|| {
            let of = |(bins, columns): (&RunBins, &Vec<Signals>)| columns.iter().map(|c| bins.of(c, false)).collect();
            self.binning.runs.iter().zip(&responses.columns).map(of).collect()
        });
        let touched = touched(&edits, q);
        let of = |r: usize| {
            let bins = &self.binning.runs[r];
            let behind = |place: &usize| {
                let mut found = whole[r][*place].clone();
                if touched.contains(&true) {
                    let mut column = responses.columns[r][*place].clone();
                    undone(&edits, &responses.time[r], q, true, &mut column);
                    bins.put(&column, false, &|output| touched[output], &mut found);
                }
                found
            };
            let mut columns: Vec<Vec<f64>> = own.iter().map(behind).collect();
            columns.push(bins.of(&residuals[r], false));
            columns.extend(shared.iter().map(behind));
            columns.extend(sizes.iter().map(|s| bins.of(&s[r], false)));
            columns.iter().flatten().all(|v| v.is_finite()).then_some(columns)
        };
        (0..self.runs.len()).map(of).collect()
    }

    /// Products of columns (of [`Self::columns`]), so many of which belong to each run.
    pub(crate) fn grams(&self, columns: &[Vec<Vec<f64>>], own: usize) -> Grams {
        let shared = columns.first().map_or(0, |c| c.len() - own - 1);
        let mut grams = Grams::new(self.binning.outputs, self.binning.bands, shared);
        columns.iter().zip(&self.binning.runs).for_each(|(columns, bins)| grams.add(own, &bins.segments, columns));
        grams
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
}
