//! A run cut into segments with initial states of their own, as one response: behind the model's outputs stand the gaps
//! at the cuts, one for each state, which are to be zero.
//!
//! Free responses that grow beyond all that a fit of them could hold on to: an unstable plant that something outside the model keeps in place.

use super::continuation::Length;
use crate::estimation::Estimate;
use crate::problem::response::{Response, TimeResponse};
use crate::work::Termination;
use fdm_grammar::graph::{Leaf, Signal};
use fdm_grammar::model::{Origin, Output, Param, Quantity};
use fdm_numeric::eigen::eigenvalues;
use fdm_system::dynamics::{Point, Workspace};
use fdm_system::linear::{LinearModel, Mode, Modes, Recorded, Values};
use fdm_system::model::Model;
use fdm_system::record::Run;
use fdm_system::simulate::{Block, Divergence, RowLayout, Simulator, Sink};
use nalgebra::DMatrix;

/// Models of the segments: the first begins as the model does, the others with initial states that are parameters
/// behind the model's own; both show all states behind the outputs.
pub(crate) struct SegmentModels {
    pub(crate) first: Model,
    pub(crate) later: Model,
}

impl SegmentModels {
    pub(crate) fn new(model: &Model) -> Self {
        let mut shown = model.definition().clone();
        for j in 0..shown.states.len() {
            let (quantity, expr) = (shown.states[j].quantity.clone(), shown.graph.leaf(Leaf::State(j as u32)));
            shown.outputs.push(Output::new(quantity, expr));
        }
        let mut freed = shown.clone();
        for j in 0..freed.states.len() {
            let place = freed.params.len() as u32;
            freed.params.push(initial_state(&freed.states[j].quantity, j, 0));
            freed.states[j].initial = freed.graph.leaf(Leaf::Param(place));
        }
        Self { first: model.altered(shown), later: model.altered(freed) }
    }

    /// The model of a segment by its number.
    pub(crate) fn of(&self, segment: usize) -> &Model {
        if segment == 0 { &self.first } else { &self.later }
    }
}

/// The initial state behind a cut as a parameter of each run; NaN until it is guessed.
pub(crate) fn initial_state(state: &Quantity, index: usize, cut: usize) -> Param {
    let quantity = Quantity { name: format!("{} behind cut {}", state.name, cut + 1), ..state.clone() };
    Param {
        quantity,
        origin: Origin::FreeInitial(index as u32),
        value: f64::NAN,
        lower: f64::NEG_INFINITY,
        upper: f64::INFINITY,
        fixed: false,
        per_run: true,
        group: None,
        logarithmic: false,
        prior: None,
    }
}

/// One segment of a run.
pub(crate) struct Segment<'a> {
    pub(crate) simulator: Simulator<'a>,
    /// Its first sample in the run.
    pub(crate) begin: usize,
}

/// Sizes of the model that was cut.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sizes {
    pub(crate) params: usize,
    pub(crate) states: usize,
    pub(crate) outputs: usize,
}

/// The response of a run by its segments. Parameters are the model's, then the initial states behind each cut.
pub(crate) struct SegmentedResponse<'a> {
    segments: Vec<Segment<'a>>,
    sizes: Sizes,
    samples: usize,
    theta: Vec<f64>,
    y: Vec<f64>,
    jacobian: Vec<f64>,
    /// Outputs and rows of the whole run.
    whole: (Vec<f64>, Vec<f64>),
}

impl<'a> SegmentedResponse<'a> {
    /// `samples` of the whole run.
    pub(crate) fn new(segments: Vec<Segment<'a>>, sizes: Sizes, samples: usize) -> Self {
        let longest = segments.iter().map(|s| s.simulator.samples()).max().unwrap_or(0);
        let y = vec![0.0; longest * (sizes.outputs + sizes.states)];
        Self {
            segments,
            sizes,
            samples,
            theta: vec![0.0; sizes.params + sizes.states],
            y,
            jacobian: Vec::new(),
            whole: Default::default(),
        }
    }

    /// Where the initial states of a segment (not the first) stand in the parameters.
    fn own(&self, segment: usize) -> usize {
        self.sizes.params + (segment - 1) * self.sizes.states
    }

    /// Writes the parameters of a segment and says how many there are.
    fn assemble(&mut self, segment: usize, theta: &[f64]) -> usize {
        let Sizes { params, states, .. } = self.sizes;
        self.theta[..params].copy_from_slice(&theta[..params]);
        if segment == 0 {
            return params;
        }
        let own = self.own(segment);
        self.theta[params..].copy_from_slice(&theta[own..own + states]);
        params + states
    }

    /// Copies a segment's outputs to their rows; the sample at its end is the next one's first, and shows the gap there.
    fn place(&self, segment: usize, theta: &[f64], y: &mut [f64]) {
        let Sizes { states, outputs: q, .. } = self.sizes;
        let width = q + states;
        let Segment { simulator, begin } = &self.segments[segment];
        let rows = simulator.samples();
        let last = segment + 1 == self.segments.len();
        for row in 0..if last { rows } else { rows - 1 } {
            y[(begin + row) * width..][..q].copy_from_slice(&self.y[row * width..][..q]);
        }
        if !last {
            let (end, next) = ((rows - 1) * width + q, self.own(segment + 1));
            for j in 0..states {
                y[(begin + rows - 1) * width + q + j] = self.y[end + j] - theta[next + j];
            }
        }
    }

    fn blame(&self, segment: usize, d: Divergence) -> Divergence {
        Divergence { sample: d.sample + self.segments[segment].begin, ..d }
    }
}

impl Response for SegmentedResponse<'_> {
    fn samples(&self) -> usize {
        self.samples
    }

    fn outputs(&self) -> usize {
        self.sizes.outputs + self.sizes.states
    }

    fn simulate(&mut self, theta: &[f64], y: &mut [f64]) -> Result<(), Divergence> {
        y.fill(0.0);
        for k in 0..self.segments.len() {
            let count = self.assemble(k, theta);
            let result = self.segments[k].simulator.simulate(&self.theta[..count], &mut self.y);
            result.map_err(|d| self.blame(k, d))?;
            self.place(k, theta, y);
        }
        Ok(())
    }

    fn sensitivities(&mut self, theta: &[f64], columns: &[usize], sink: &mut Sink<'_>) -> Result<(), Divergence> {
        let (mut y, mut jacobian) = (std::mem::take(&mut self.whole.0), std::mem::take(&mut self.whole.1));
        let layout = RowLayout::full(self.outputs(), columns.len());
        y.resize(self.samples * self.outputs(), 0.0);
        jacobian.resize(self.samples * layout.length, 0.0);
        let stride = layout.length / self.outputs();
        let result = self.linearise(theta, columns, &mut y, (&mut jacobian, stride));
        if result.is_ok() {
            sink(Block { first: 0, y: &y, rows: &mut jacobian, layout: &layout });
        }
        self.whole = (y, jacobian);
        result
    }
}

impl TimeResponse for SegmentedResponse<'_> {}

impl SegmentedResponse<'_> {
    /// Outputs and their partials by the columns, N by (q + n) rows of `stride`.
    fn linearise(
        &mut self,
        theta: &[f64],
        columns: &[usize],
        y: &mut [f64],
        (jacobian, stride): (&mut [f64], usize),
    ) -> Result<(), Divergence> {
        y.fill(0.0);
        jacobian.fill(0.0);
        let Sizes { params, states, outputs: q } = self.sizes;
        let width = q + states;
        for k in 0..self.segments.len() {
            let count = self.assemble(k, theta);
            let own = if k == 0 { params..params } else { self.own(k)..self.own(k) + states };
            // position among the columns, and the parameter that it is to the segment
            let local = columns.iter().enumerate().filter_map(|(place, c)| match *c {
                c if c < params => Some((place, c)),
                c if own.contains(&c) => Some((place, params + c - own.start)),
                _ => None,
            });
            let (places, wanted): (Vec<usize>, Vec<usize>) = local.unzip();
            let narrow = wanted.len().next_multiple_of(8);
            let rows = self.segments[k].simulator.samples();
            self.jacobian.resize(rows * width * narrow, 0.0);
            let part = &mut self.jacobian[..rows * width * narrow];
            let simulator = &mut self.segments[k].simulator;
            let result = simulator.sensitivities(&self.theta[..count], &wanted, &mut self.y[..rows * width], part);
            result.map_err(|d| self.blame(k, d))?;
            self.place(k, theta, y);
            let begin = self.segments[k].begin;
            let mut copy = |from: usize, to: usize| {
                let (from, to) = (&self.jacobian[from * narrow..][..narrow], &mut jacobian[to * stride..][..stride]);
                places.iter().zip(from).for_each(|(place, v)| to[*place] = *v);
            };
            let last = k + 1 == self.segments.len();
            for row in 0..if last { rows } else { rows - 1 } {
                (0..q).for_each(|o| copy(row * width + o, (begin + row) * width + o));
            }
            if !last {
                let (from, to) = ((rows - 1) * width + q, (begin + rows - 1) * width + q);
                (0..states).for_each(|j| copy(from + j, to + j));
                let next = self.own(k + 1);
                for (place, c) in columns.iter().enumerate().filter(|(_, c)| (next..next + states).contains(*c)) {
                    jacobian[(to + c - next) * stride + place] = -1.0;
                }
            }
        }
        Ok(())
    }
}

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

#[cfg(test)]
mod tests {
    use super::*;
    use fdm_system::record::Run;

    #[test]
    fn sensitivities_are_those_of_the_outputs_and_of_the_gaps() {
        let text = "model m { input u; state x = x0, v; param k = 3, c = 0.2, x0 = 0.5;
            der(x) = v; der(v) = u - k*x - c*v*abs(v) - 0.1*k*x^3; output y = x + 0.1*u*v; }";
        let model = Model::from_text("m.fdm", text).expect("a model");
        let run = Run {
            name: "run".into(),
            time: (0..13).map(|k| 0.2 * f64::from(k)).collect(),
            inputs: (0..13).map(|k| f64::from(k).cos()).collect(),
            held: vec![false],
            measured: vec![f64::NAN; 13],
            input_gaps: vec![0],
            stated: Vec::new(),
            output_gaps: vec![0],
        };
        let models = SegmentModels::new(&model);
        let ranges = [0..5, 4..9, 8..13];
        let pieces: Vec<Run> = ranges.iter().map(|r| run.part(r.clone())).collect();
        let sizes = Sizes { params: 3, states: 2, outputs: 1 };
        let segment = |(k, piece): (usize, _)| Segment {
            simulator: Simulator::new(models.of(k).dynamics(), piece, 4).expect("suited"),
            begin: 4 * k,
        };
        let mut response = SegmentedResponse::new(pieces.iter().enumerate().map(segment).collect(), sizes, 13);
        let theta = [3.0, 0.2, 0.5, 0.3, -0.4, -0.2, 0.6];
        // not every parameter, and not in order
        let columns = [6, 0, 3, 2, 4];
        let (mut y, mut jacobian) = (vec![0.0; 39], vec![f64::NAN; 39 * 8]);
        response
            .sensitivities(&theta, &columns, &mut |block: Block<'_>| block.copy_to(&mut y, &mut jacobian, 8))
            .expect("finite");
        let mut again = vec![f64::NAN; 39];
        response.simulate(&theta, &mut again).expect("finite");
        assert_eq!(y, again);
        assert!(y[4 * 3 + 1] != 0.0 && y[4 * 3 + 2] != 0.0 && y[5 * 3 + 1] == 0.0, "gaps stand at the cuts only");
        for (place, column) in columns.iter().enumerate() {
            let moved = |step: f64| {
                let (mut theta, mut y) = (theta, vec![0.0; 39]);
                theta[*column] += step;
                let mut response = SegmentedResponse::new(pieces.iter().enumerate().map(segment).collect(), sizes, 13);
                response.simulate(&theta, &mut y).expect("finite");
                y
            };
            let (up, down) = (moved(1e-5), moved(-1e-5));
            for row in 0..39 {
                let difference = (up[row] - down[row]) / 2e-5;
                assert!((jacobian[row * 8 + place] - difference).abs() < 1e-8, "row {row}, parameter {column}");
            }
        }
        assert!(jacobian.chunks(8).all(|lanes| lanes[5..].iter().all(|v| *v == 0.0)));
    }
}
