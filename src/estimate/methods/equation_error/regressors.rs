//! Rates and regressors of a run: its measured states, their rates and the columns of every equation, as rows at samples or at frequencies.

use super::differentiation::{FEWEST_SAMPLES, Smoothed, derivatives, smooth};
use super::equations::Left;
use super::error::RegressionError;
use super::options::{Domain, RegressionOptions, Smoothing};
use super::preprocessing::detrend;
use fdm_grammar::Model;
use fdm_grammar::graph::{Graph, Leaf, Signal};
use fdm_grammar::model::reading::Reading;
use fdm_grammar::model::{Origin, Param};
use fdm_grammar::op::ExprId;
use fdm_system::code::Expressions;
use fdm_system::dynamics::Point;
use fdm_system::record::even_grid::EvenGrid;
use fdm_system::record::{Place, Run};
use fdm_system::spectrum::{Frequencies, Spectrum, SpectrumOptions};
use num_complex::Complex64;
use std::f64::consts::TAU;

/// One run, with the states that are measured.
#[derive(Debug, Clone)]
pub(super) struct Signals<'a> {
    pub(super) run: &'a Run,
    /// Values of the states that are shown by an output, NaN in gaps (n).
    pub(super) states: Vec<Option<Vec<f64>>>,
    /// Their rates; none in the frequency domain.
    pub(super) rates: Vec<Option<Vec<f64>>>,
    /// What is measured of each output that no state is read from (q).
    pub(super) outputs: Vec<Vec<f64>>,
    /// What the smoothing found about each state.
    pub(super) smoothed: Vec<Option<(f64, f64)>>,
    /// Values of all parameters: those of the model, and what the run brings (`known T0 per run`, `initial(u)`).
    theta: Vec<f64>,
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
        let brought = |p: &Param| match p.origin {
            Origin::FirstSample(input) => run.inputs.get(input as usize).copied().unwrap_or(f64::NAN),
            _ => p.value,
        };
        let theta: Vec<f64> = model.params.iter().map(brought).collect();
        let value = |e: ExprId| {
            graph.evaluate(e, |leaf| match leaf {
                Leaf::Param(k) => theta[k as usize],
                _ => f64::NAN,
            })
        };
        let read = |r: &Reading| {
            let (slope, offset) = (value(r.slope), value(r.offset));
            run.measured.iter().skip(r.output).step_by(q).map(|z| (z - offset) / slope).collect::<Vec<f64>>()
        };
        let states: Vec<Option<Vec<f64>>> = readings.iter().map(|r| r.as_ref().map(read)).collect();
        let none = vec![None; states.len()];
        let outputs = (0..q).map(|o| run.measured.iter().skip(o).step_by(q).copied().collect()).collect();
        let mut signals = Self { run, rates: none, smoothed: vec![None; states.len()], states, outputs, theta };
        if options.domain == Domain::Time {
            signals.differentiate(model, options.smoothing)?;
        }
        Ok(signals)
    }

    /// What an equation explains, `none` standing for a rate that is not known; none of a state that is not measured.
    pub(super) fn explained<'s>(&'s self, left: Left, none: &'s [f64]) -> Option<Explained<'s>> {
        match left {
            Left::Output(output) => Some(Explained::Output(&self.outputs[output])),
            Left::Rate(state) => {
                let rate = self.rates[state].as_deref().unwrap_or(none);
                self.states[state].as_deref().map(|values| Explained::Rate(values, rate))
            }
        }
    }

    fn differentiate(&mut self, model: &Model, smoothing: Smoothing) -> Result<(), RegressionError> {
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
        let samples = self.run.len();
        if let Some(cutoff) = cutoff {
            let (least, most) = (0.5 / (grid.interval * (samples.max(2) - 1) as f64), 0.5 / grid.interval);
            if !(least..=most).contains(&cutoff) {
                return Err(RegressionError::CutoffOutside { run: self.run.name.clone(), cutoff, least, most });
            }
        }
        for k in 0..self.states.len() {
            let Some(values) = &self.states[k] else { continue };
            let bridged = bridged(&self.run.time, values);
            if bridged.iter().any(|v| v.is_nan()) {
                continue;
            }
            let (present, least) = (values.iter().filter(|v| !v.is_nan()).count(), FEWEST_SAMPLES);
            if present < least || 2 * present < samples {
                let (run, state) = (self.run.name.clone(), model.states[k].quantity.name.clone());
                return Err(RegressionError::Gaps { run, state, present, samples, least });
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

    /// Expressions at every sample, one series each; `ending` at the end of the interval before each sample, where
    /// inputs that are held have the values of the sample before.
    pub(super) fn evaluate_at(&self, model: &Model, graph: &Graph, roots: &[ExprId], ending: bool) -> Vec<Vec<f64>> {
        let (n, m) = (self.states.len(), self.run.held.len());
        let theta = &self.theta;
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
            code.evaluate(Point { t: *t, x: &x, drive: &drive, known: theta }, &mut row);
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
    fdm_system::record::bridge(time, &mut filled, 1, 0, false);
    filled
}

/// One equation in one run. At frequencies every coefficient is two rows, all real parts in front.
#[derive(Debug, Clone)]
pub(super) struct Rows {
    /// What was measured less what is known of it.
    pub(super) left: Vec<f64>,
    /// What was measured: a rate, or an output.
    pub(super) measured: Vec<f64>,
    pub(super) columns: Vec<Vec<f64>>,
    /// Places of the rows: samples, or frequencies in cycles per unit of time.
    pub(super) places: Places,
    /// Part of the rows that are independent: frequencies nearer than one over the record's length repeat each other.
    pub(super) independent: f64,
}

/// Where rows belong.
#[derive(Debug, Clone)]
pub(super) enum Places {
    Samples(Vec<usize>),
    Frequencies(Vec<f64>),
}

impl Places {
    /// The sample of the k-th row.
    pub(super) fn sample(&self, k: usize) -> Option<usize> {
        match self {
            Self::Samples(samples) => samples.get(k).copied(),
            Self::Frequencies(_) => None,
        }
    }
}

/// What is explained, over the samples of a run.
#[derive(Clone, Copy)]
pub(super) enum Explained<'a> {
    /// The rate of a state: the state, and its rate, which is not read in the frequency domain.
    Rate(&'a [f64], &'a [f64]),
    /// An output.
    Output(&'a [f64]),
}

/// Series over the samples of a run that make an equation.
pub(super) struct Series<'a> {
    pub(super) explained: Explained<'a>,
    pub(super) known: &'a [f64],
    pub(super) columns: &'a [Vec<f64>],
}

/// Makes the rows as the options say.
pub(super) fn rows(run: &Run, series: &Series<'_>, options: &RegressionOptions) -> Result<Rows, RegressionError> {
    match &options.domain {
        Domain::Time => Ok(at_samples(run, series, options)),
        Domain::Frequency(choice) => at_frequencies(run, series, choice),
    }
}

fn at_samples(run: &Run, series: &Series<'_>, options: &RegressionOptions) -> Rows {
    let (Explained::Rate(_, measured) | Explained::Output(measured)) = series.explained;
    let whole = |k: &usize| {
        let own = [measured[*k], series.known[*k]];
        own.iter().all(|v| !v.is_nan()) && series.columns.iter().all(|c| !c[*k].is_nan())
    };
    let used: Vec<usize> = (0..run.len()).filter(whole).collect();
    let time: Vec<f64> = used.iter().map(|k| run.time[*k]).collect();
    let pick = |value: &dyn Fn(usize) -> f64| {
        let mut values: Vec<f64> = used.iter().map(|k| value(*k)).collect();
        detrend(&time, &mut values, options.detrend);
        values
    };
    Rows {
        left: pick(&|k| measured[k] - series.known[k]),
        measured: pick(&|k| measured[k]),
        columns: series.columns.iter().map(|c| pick(&|k| c[k])).collect(),
        places: Places::Samples(used),
        independent: 1.0,
    }
}

fn at_frequencies(run: &Run, series: &Series<'_>, choice: &Frequencies) -> Result<Rows, RegressionError> {
    let spectrum = transformed(run, series, choice)?;
    let count = spectrum.omega.len();
    let channel = |k: usize| &spectrum.outputs[k * count..(k + 1) * count];
    // x'(w) = j w x(w) + e1 x(T - dt/2) - e0 x(-dt/2)
    let ends = [spectrum.output_ends[0][0], spectrum.output_ends[1][0]];
    let rate = |k: usize| {
        let [before, behind] = spectrum.end_factors(k);
        Complex64::new(0.0, spectrum.omega[k]) * channel(0)[k] + behind * ends[1] - before * ends[0]
    };
    let measured: Vec<Complex64> = match series.explained {
        Explained::Rate(..) => (0..count).map(rate).collect(),
        Explained::Output(_) => channel(0).to_vec(),
    };
    let left: Vec<Complex64> = measured.iter().zip(channel(1)).map(|(measured, known)| measured - known).collect();
    // nothing in a run that does not measure a signal; not where its gaps leave too much in doubt
    let whole = |k: &usize| left[*k].is_finite() && (0..series.columns.len()).all(|c| channel(c + 2)[*k].is_finite());
    let whole: Vec<usize> = (0..count).filter(whole).collect();
    let stacked = |c: &[Complex64]| {
        let at = || whole.iter().map(|k| c[*k]);
        at().map(|c| c.re).chain(at().map(|c| c.im)).collect::<Vec<f64>>()
    };
    Ok(Rows {
        left: stacked(&left),
        measured: stacked(&measured),
        columns: (0..series.columns.len()).map(|c| stacked(channel(c + 2))).collect(),
        places: Places::Frequencies(whole.iter().map(|k| spectrum.omega[*k] / TAU).collect()),
        independent: spectrum.independent() / count.max(1) as f64,
    })
}

/// State or output, known part and columns as channels of one spectrum.
fn transformed(run: &Run, series: &Series<'_>, choice: &Frequencies) -> Result<Spectrum, RegressionError> {
    let width = 2 + series.columns.len();
    let (Explained::Rate(first, _) | Explained::Output(first)) = series.explained;
    let mut measured = Vec::with_capacity(run.len() * width);
    for k in 0..run.len() {
        measured.extend([first[k], series.known[k]]);
        measured.extend(series.columns.iter().map(|c| c[k]));
    }
    let channels = Run {
        name: run.name.clone(),
        time: run.time.clone(),
        inputs: Vec::new(),
        held: Vec::new(),
        measured,
        input_gaps: Vec::new(),
        stated: Vec::new(),
        output_gaps: vec![0; width],
    };
    let options = SpectrumOptions { allow_unmeasured: true, ..SpectrumOptions::default() };
    Spectrum::of(&channels, choice, &options)
        .map_err(|error| RegressionError::Spectrum { run: run.name.clone(), error })
}
