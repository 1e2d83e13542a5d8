//! What a run says about states, their rates and everything that the columns of a regression are made of.

use super::local::derivatives;
use super::options::{Domain, RegressionOptions, Smoothing};
use super::refusal::RegressionError;
use super::sine::{Smoothed, smooth};
use crate::code::Expressions;
use crate::dynamics::Point;
use crate::record::even_grid::EvenGrid;
use crate::record::{Place, Run};
use fdm_grammar::Model;
use fdm_grammar::graph::{Graph, Leaf, Signal};
use fdm_grammar::model::reading::Reading;
use fdm_grammar::op::ExprId;

/// One run, with the states that are measured.
#[derive(Debug, Clone)]
pub(super) struct Signals<'a> {
    pub(super) run: &'a Run,
    /// Values of the states that are shown by an output, NaN in gaps (n).
    pub(super) states: Vec<Option<Vec<f64>>>,
    /// Their rates; none in the frequency domain.
    pub(super) rates: Vec<Option<Vec<f64>>>,
    /// What the smoothing found about each state.
    pub(super) smoothed: Vec<Option<(f64, f64)>>,
}

impl<'a> Signals<'a> {
    /// Reads the states and differentiates them as the options say.
    pub(super) fn new(
        model: &Model,
        graph: &Graph,
        readings: &[Option<Reading>],
        run: &'a Run,
        options: &RegressionOptions,
    ) -> Result<Self, RegressionError> {
        let q = model.outputs.len();
        let value = |e: ExprId| {
            graph.evaluate(e, |leaf| match leaf {
                Leaf::Param(k) => model.params[k as usize].value,
                _ => f64::NAN,
            })
        };
        let read = |r: &Reading| {
            let (slope, offset) = (value(r.slope), value(r.offset));
            run.measured.iter().skip(r.output).step_by(q).map(|z| (z - offset) / slope).collect::<Vec<f64>>()
        };
        let states: Vec<Option<Vec<f64>>> = readings.iter().map(|r| r.as_ref().map(read)).collect();
        let none = vec![None; states.len()];
        let mut signals = Self { run, rates: none, smoothed: vec![None; states.len()], states };
        if options.domain == Domain::Time {
            signals.differentiate(options.smoothing)?;
        }
        Ok(signals)
    }

    fn differentiate(&mut self, smoothing: Smoothing) -> Result<(), RegressionError> {
        let cutoff = match smoothing {
            Smoothing::Local { points } => {
                let rates = self.states.iter().map(|s| s.as_ref().map(|s| derivatives(&self.run.time, s, points)));
                self.rates = rates.collect();
                return Ok(());
            }
            Smoothing::Fixed { cutoff } => Some(cutoff),
            Smoothing::Optimal => None,
        };
        let uneven = || RegressionError::Uneven { run: self.run.name.clone() };
        let grid = EvenGrid::of(&self.run.time).map_err(|_| uneven())?;
        if grid.place.last().is_none_or(|last| last + 1 != self.run.len()) {
            return Err(uneven());
        }
        for k in 0..self.states.len() {
            let Some(values) = &self.states[k] else { continue };
            let bridged = bridged(&self.run.time, values);
            if bridged.iter().any(|v| v.is_nan()) {
                continue;
            }
            let Smoothed { values, derivatives, noise, cutoff } = smooth(&bridged, grid.interval, cutoff);
            self.rates[k] = Some(derivatives);
            self.states[k] = Some(values);
            self.smoothed[k] = Some((noise, cutoff));
        }
        Ok(())
    }

    /// Expressions at every sample, one series each; NaN where a state that they need has a gap.
    pub(super) fn evaluate(&self, model: &Model, graph: &Graph, roots: &[ExprId]) -> Vec<Vec<f64>> {
        self.evaluate_at(model, graph, roots, false)
    }

    /// The same; `ending` at the end of the interval before each sample, where inputs that are held have the values of the sample before.
    pub(super) fn evaluate_at(&self, model: &Model, graph: &Graph, roots: &[ExprId], ending: bool) -> Vec<Vec<f64>> {
        let (n, m) = (self.states.len(), self.run.held.len());
        let theta = model.start();
        let tau = |e: ExprId| graph.evaluate(e, |l| if let Leaf::Param(k) = l { theta[k as usize] } else { f64::NAN });
        let delayed: Vec<(Signal, f64)> = graph.delayed().iter().map(|d| (d.signal, tau(d.tau))).collect();
        let past: Vec<Option<Vec<f64>>> = match delayed.iter().any(|(s, _)| matches!(s, Signal::State(_))) {
            true => self.states.iter().map(|s| s.as_ref().map(|s| bridged(&self.run.time, s))).collect(),
            false => Vec::new(),
        };
        let mut code = Expressions::new(graph, roots, n, m);
        let (mut x, mut drive) = (vec![f64::NAN; n], vec![0.0; m + delayed.len()]);
        let mut row = vec![0.0; roots.len()];
        let mut series = vec![Vec::with_capacity(self.run.len()); roots.len()];
        for (sample, t) in self.run.time.iter().enumerate() {
            for (x, state) in x.iter_mut().zip(&self.states) {
                *x = state.as_ref().map_or(f64::NAN, |s| s[sample]);
            }
            drive[..m].copy_from_slice(&self.run.inputs[sample * m..][..m]);
            for k in (0..m).filter(|k| ending && sample > 0 && self.run.held[*k]) {
                drive[k] = self.run.inputs[(sample - 1) * m + k];
            }
            // where rates are differences over both sides, so are the derivatives of inputs
            model.vanishing().for_each(|k| drive[k as usize] = self.run.slope_at(k as usize, sample));
            for (place, (signal, tau)) in drive[m..].iter_mut().zip(&delayed) {
                let at = Place::new(&self.run.time, t - tau);
                *place = match signal {
                    Signal::Input(k) => self.run.input(*k as usize, at).0,
                    Signal::State(k) => past[*k as usize].as_ref().map_or(f64::NAN, |s| between(s, at)),
                };
            }
            code.evaluate(Point { t: *t, x: &x, drive: &drive, known: &theta }, &mut row);
            series.iter_mut().zip(&row).for_each(|(series, v)| series.push(*v));
        }
        series
    }
}

fn between(values: &[f64], at: Place) -> f64 {
    let left = values[at.left];
    if at.rate == 0.0 { left } else { left + at.part * (values[at.left + 1] - left) }
}

/// Gaps filled linearly.
fn bridged(time: &[f64], values: &[f64]) -> Vec<f64> {
    let mut filled = values.to_vec();
    crate::record::bridge(time, &mut filled, 1, 0, false);
    filled
}
