//! Free responses that grow beyond all that a fit of them could hold on to: an unstable plant that something outside the model keeps in place.

use crate::estimation::estimate::Estimate;
use crate::recovery::continuation::Length;
use crate::work::termination::Termination;
use fdm_grammar::graph::Signal;
use fdm_numeric::eigen::eigenvalues;
use fdm_system::dynamics::{Point, Workspace};
use fdm_system::linear::{LinearModel, Mode, Modes, Recorded, Values};
use fdm_system::model::Model;
use fdm_system::record::Run;
use nalgebra::DMatrix;

/// Growth, in e-folds over a record, beyond which no free response follows it: the squares of sensitivities to the beginning then cover more
/// than the digits of a number, `e^(2 growth) > 1/epsilon`, so that the normal equations know the beginning or the end and not both.
fn limit() -> f64 {
    -0.5 * f64::EPSILON.ln()
}

/// Standard errors of a rate that count: by chance one in a thousand rates is as far above the truth.
const ERRORS: f64 = 3.09;
/// Outputs that stay in place widen by less than this part of the mode's growth.
const BOUNDED: f64 = 0.5;
/// Share of the record beside which its outputs are seen to widen, where nothing shorter was fitted.
const BEGINNING: f64 = 0.1;

/// The mode of a linear model that grows fastest where an output shows it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FreeResponse {
    /// E-folds in a unit of time, and the standard error of that where it is known.
    rate: f64,
    error: Option<f64>,
    /// What the longest run lasts.
    length: f64,
    /// A state of the mode in whose equation something is estimated.
    state: String,
    unit: String,
}

impl FreeResponse {
    /// At all parameters theta (p). None of models that are not linear, whose responses may grow and stay, and where no mode grows.
    pub(crate) fn at(
        model: &Model,
        runs: &[Run],
        theta: &[f64],
        covariance: impl Fn(usize, usize) -> f64,
    ) -> Option<Self> {
        let definition = model.definition();
        if !model.layout().affine.rates || model.layout().states == 0 {
            return None;
        }
        if !may_grow(model, theta) {
            return None;
        }
        let mut linear = LinearModel::near(model, &Recorded::of(definition, runs)).ok()?;
        let mut values = Values::default();
        linear.evaluate(theta, &mut values).ok()?;
        let modes = Modes::new(linear.structure(), &values).ok()?;
        let mode: &Mode = modes.modes.iter().find(|m| m.shown && m.s.re > 0.0)?;
        let estimated = |state: &usize| model.layout().patterns.rates_by_param.row(*state).next().is_some();
        let state = mode.dominant().find(estimated).or_else(|| mode.dominant().next())?;
        Some(Self {
            rate: mode.s.re,
            error: mode.errors(covariance).map(|e| e.re),
            length: runs.iter().filter_map(|r| r.time.last()).copied().fold(0.0, f64::max),
            state: definition.states[state].quantity.name.clone(),
            unit: definition.time.to_string(),
        })
    }

    /// At start values of the first run.
    pub(crate) fn at_start(model: &Model, runs: &[Run], starts: &[Vec<f64>]) -> Option<Self> {
        Self::at(model, runs, starts.first()?, |_, _| 0.0)
    }

    /// At the estimates of a shorter record, `theta` all parameters of the first run there.
    pub(crate) fn of(model: &Model, runs: &[Run], estimate: &Estimate, theta: &[f64]) -> Option<Self> {
        let place = |param: usize| {
            let name = &model.definition().params[param].quantity.name;
            let run = runs.first().map(|r| r.name.as_str());
            let own = |k: &usize| {
                let p = &estimate.parameters[*k];
                p.name == *name && (p.run.is_none() || p.run.as_deref() == run)
            };
            estimate.covered.iter().position(own)
        };
        let places: Vec<Option<usize>> = (0..model.layout().params).map(place).collect();
        let covariance = |i: usize, j: usize| match (places[i], places[j]) {
            (Some(i), Some(j)) if estimate.covariance.size == estimate.covered.len() => estimate.covariance.at(i, j),
            _ => 0.0,
        };
        Self::at(model, runs, theta, covariance)
    }

    /// Whether it grows beyond the limit over the record, while what was measured stays in place behind the first share of it.
    pub(crate) fn is_lost(&self, runs: &[Run], share: Option<f64>) -> bool {
        let share = share.unwrap_or(BEGINNING);
        self.growth() > limit() && widening(runs, share) < BOUNDED * self.growth() * (1.0 - share)
    }

    /// Whether it grows beyond the limit whatever the estimates of the first share of the record may be off by; the
    /// mode has grown there by an e-fold and more.
    pub(crate) fn is_surely_lost(&self, runs: &[Run], share: f64) -> bool {
        let Some(error) = self.error.filter(|e| *e > 0.0) else { return false };
        let least = Self { rate: self.rate - ERRORS * error, ..self.clone() };
        least.rate * share * least.length > 1.0 && least.is_lost(runs, Some(share))
    }

    /// E-folds over the longest run.
    pub(crate) fn growth(&self) -> f64 {
        self.rate * self.length
    }

    /// How a fit ends there.
    pub(crate) fn termination(self) -> Termination {
        let growth = self.growth();
        let Self { length, state, unit, .. } = self;
        Termination::Unstable { growth, length, state, unit }
    }
}

/// Whether a root of a model whose rates are affine lies in the right half plane; true where delayed states leave that open. Most models
/// do not grow, and this costs a hundredth of their linear model with its derivatives.
fn may_grow(model: &Model, theta: &[f64]) -> bool {
    let (layout, dynamics) = (model.layout(), model.dynamics());
    if layout.delayed.iter().any(|s| matches!(s, Signal::State(_))) {
        return true;
    }
    let n = layout.states;
    let (mut known, mut work) = (vec![0.0; layout.known], Workspace::new(dynamics));
    dynamics.prepare(theta, &mut known, &mut work);
    let (drive, mut x, mut rest) = (vec![0.0; layout.drive()], vec![0.0; n], vec![0.0; n]);
    dynamics.rates(Point { t: 0.0, x: &x, drive: &drive, known: &known }, &mut rest, &mut work);
    let (mut slopes, mut rates) = (DMatrix::zeros(n, n), vec![0.0; n]);
    for j in 0..n {
        x[j] = 1.0;
        dynamics.rates(Point { t: 0.0, x: &x, drive: &drive, known: &known }, &mut rates, &mut work);
        x[j] = 0.0;
        (0..n).for_each(|i| slopes[(i, j)] = rates[i] - rest[i]);
    }
    eigenvalues(&slopes).is_none_or(|roots| roots.iter().any(|s| s.re.is_nan() || s.re > 0.0))
}

/// Whether the free response at the model's start values is lost over the longest run, while the outputs stay in place. No plain fit leads anywhere
/// from there; [`Continuation::Auto`](crate::Continuation::Auto) begins with short records, and tells soon where these do not help.
pub fn is_lost_at_start(model: &Model, runs: &[Run]) -> bool {
    let starts = crate::starts(model, runs, &crate::Changes::default());
    FreeResponse::at_start(model, runs, &starts).is_some_and(|found| found.is_lost(runs, None))
}

/// How much wider outputs are in the whole of a run than in a first share of it: the logarithm, of the output that widens most.
fn widening(runs: &[Run], share: f64) -> f64 {
    let mut most = 0.0_f64;
    for (run, begun) in runs.iter().zip(Length::Share(share).cut(runs)) {
        let q = run.output_gaps.len();
        let range = |run: &Run, o: usize| {
            let values = run.measured.iter().skip(o).step_by(q).filter(|z| z.is_finite());
            let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), z| (l.min(*z), h.max(*z)));
            high - low
        };
        for o in 0..q {
            let ratio = range(run, o) / range(&begun, o);
            // outputs without values widen by nothing
            most = if ratio.is_nan() { most } else { most.max(ratio.ln()) };
        }
    }
    most
}
