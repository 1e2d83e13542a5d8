//! What a model answers in one run, and what its numbers are: samples in time, coefficients of a whole record, or numbers whose noise
//! is known.
//!
//! Parameters in which the whole response is affine: the best values of these are known as soon as the others are.

use fdm_grammar::graph::{Graph, Leaf, Node, Signal};
use fdm_grammar::model::Model;
use fdm_grammar::op::{ExprId, Op};
use fdm_system::simulate::{Divergence, PlaneSink, Simulator, Sink};
use fdm_system::spectrum::independent;
use std::f64::consts::TAU;
use std::ops::{Deref, DerefMut};

/// One run's model response and its exact sensitivities.
///
/// Equal parameters must give equal bits, with and without sensitivities and in whatever order they are asked.
pub trait Response: Send {
    /// Number of samples N.
    fn samples(&self) -> usize;

    /// Number of outputs q.
    fn outputs(&self) -> usize;

    /// Outputs, N by q row-major, at the parameters `theta` (p, in the model's order).
    ///
    /// # Errors
    /// [`Divergence`] when the simulation cannot reach the end of the run; `y` is then of no use.
    fn simulate(&mut self, theta: &[f64], y: &mut [f64]) -> Result<(), Divergence>;

    /// Outputs and their partials by `theta[columns[j]]`, all samples in blocks to `sink`.
    ///
    /// # Errors
    /// As [`Response::simulate`]; blocks before the failure may have been handed over.
    fn sensitivities(&mut self, theta: &[f64], columns: &[usize], sink: &mut Sink<'_>) -> Result<(), Divergence>;

    /// The response in planes, where it is one of frequencies, of which real and imaginary part are two samples one after the other.
    fn planar(&mut self) -> Option<&mut dyn PlanarResponse> {
        None
    }
}

/// A response of frequencies that is handed over in planes.
pub trait PlanarResponse: Response {
    /// As [`Response::sensitivities`], in planes.
    ///
    /// # Errors
    /// As [`Response::simulate`].
    fn planes(&mut self, theta: &[f64], columns: &[usize], sink: &mut PlaneSink<'_>) -> Result<(), Divergence>;
}

/// A response of samples in time, whose noise is estimated.
pub trait TimeResponse: Response {
    /// Time of each sample (N), rising; none when only their order is known.
    fn time(&self) -> Option<&[f64]> {
        None
    }
}

/// A response of samples in time over the deviations that the model states for their noise.
pub trait StandardisedResponse: TimeResponse {
    /// What the last evaluation adds to the cost beside half the squares of the residuals: rows and residuals then give its gradient and
    /// its information.
    fn surcharge(&self) -> f64;
}

/// A response of Fourier coefficients of a whole record: sample 2 k is the real part at frequency k, 2 k + 1 the imaginary part.
pub trait CoefficientResponse: Response {
    /// What the samples are coefficients of.
    fn coefficients(&self) -> Coefficients<'_>;
}

/// A response with one output, of whose measured numbers the noise is known from another source than the residuals.
pub trait KnownNoiseResponse: Response {
    /// The noise of the measured numbers.
    fn noise(&self) -> &KnownNoise;

    /// The frequency, in cycles per unit of time, that a number belongs to.
    fn frequency(&self, sample: usize) -> Option<f64>;
}

/// The response of a run, by what its numbers are.
pub enum RunResponse<'a> {
    /// Samples in time.
    InTime(Box<dyn TimeResponse + 'a>),
    /// Samples in time over their stated deviations.
    Standardised(Box<dyn StandardisedResponse + 'a>),
    /// Coefficients of the whole record.
    Coefficients(Box<dyn CoefficientResponse + 'a>),
    /// Numbers of known noise.
    KnownNoise(Box<dyn KnownNoiseResponse + 'a>),
}

impl<'a> RunResponse<'a> {
    /// Of samples in time.
    pub fn in_time(response: impl TimeResponse + 'a) -> Self {
        Self::InTime(Box::new(response))
    }

    /// Time of each sample (N), rising; none when only their order is known, or they are no samples in time.
    pub(crate) fn time(&self) -> Option<&[f64]> {
        match self {
            Self::InTime(response) => response.time(),
            Self::Standardised(response) => response.time(),
            Self::Coefficients(_) | Self::KnownNoise(_) => None,
        }
    }

    /// The frequency, in cycles per unit of time, that a sample belongs to, when it is not one in time.
    pub(crate) fn frequency(&self, sample: usize) -> Option<f64> {
        match self {
            Self::InTime(_) | Self::Standardised(_) => None,
            Self::Coefficients(response) => Some(response.coefficients().omega.get(sample / 2)? / TAU),
            Self::KnownNoise(response) => response.frequency(sample),
        }
    }
}

impl<'a> Deref for RunResponse<'a> {
    type Target = dyn Response + 'a;

    fn deref(&self) -> &Self::Target {
        match self {
            Self::InTime(response) => &**response,
            Self::Standardised(response) => &**response,
            Self::Coefficients(response) => &**response,
            Self::KnownNoise(response) => &**response,
        }
    }
}

impl DerefMut for RunResponse<'_> {
    fn deref_mut(&mut self) -> &mut Self::Target {
        match self {
            Self::InTime(response) => &mut **response,
            Self::Standardised(response) => &mut **response,
            Self::Coefficients(response) => &mut **response,
            Self::KnownNoise(response) => &mut **response,
        }
    }
}

/// Noise that is known beforehand, from another source than the residuals.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct KnownNoise {
    /// Standard deviation of each number (N).
    pub deviations: Vec<f64>,
    /// Pairs of numbers (the first one before the second) whose noise correlates, with the correlation.
    pub correlations: Vec<(u32, u32, f64)>,
}

/// Fourier coefficients as the samples of a response.
#[derive(Debug, Clone, Copy)]
pub struct Coefficients<'a> {
    /// Angular frequencies (M), rising.
    pub omega: &'a [f64],
    /// Samples in time that were transformed.
    pub samples: usize,
    /// Time between them.
    pub dt: f64,
}

impl Coefficients<'_> {
    /// How many independent frequencies these are worth: closer than one cycle in the record they repeat each other.
    pub fn independent(&self) -> f64 {
        independent(self.omega, self.samples as f64 * self.dt)
    }
}

impl Response for Simulator<'_> {
    fn samples(&self) -> usize {
        self.samples()
    }

    fn outputs(&self) -> usize {
        self.outputs()
    }

    fn simulate(&mut self, theta: &[f64], y: &mut [f64]) -> Result<(), Divergence> {
        self.simulate(theta, y)
    }

    fn sensitivities(&mut self, theta: &[f64], columns: &[usize], sink: &mut Sink<'_>) -> Result<(), Divergence> {
        self.stream(theta, columns, sink)
    }
}

impl TimeResponse for Simulator<'_> {
    fn time(&self) -> Option<&[f64]> {
        Some(&self.run().time)
    }
}

/// How an expression depends on the chosen parameters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Degree {
    /// Not at all.
    Constant,
    /// As a sum of constants times parameters.
    Affine,
    /// In any other way.
    Curved,
}

/// A set of free parameters, gathered in their order, in which all outputs are jointly affine. A state is affine when
/// its equation and its initial value are: the states of linear equations are affine in what multiplies their inputs,
/// not in what multiplies their states.
pub(crate) fn affine(model: &Model) -> Vec<usize> {
    let mut chosen = vec![false; model.params.len()];
    let mut visits = 0;
    for k in (0..chosen.len()).filter(|k| !model.params[*k].fixed) {
        // visits of expressions after which no further parameter is tried: giant models are not worth more
        if visits > 20_000_000 {
            break;
        }
        chosen[k] = true;
        chosen[k] = outputs_are_affine(model, &chosen, &mut visits);
    }
    (0..chosen.len()).filter(|k| chosen[*k]).collect()
}

fn outputs_are_affine(model: &Model, chosen: &[bool], visits: &mut usize) -> bool {
    let mut states = vec![Degree::Constant; model.states.len()];
    loop {
        let degrees = degrees(&model.graph, chosen, &states);
        *visits += degrees.len();
        let of = |e: ExprId| degrees[e.index()];
        if model.outputs.iter().any(|o| of(o.expr) == Degree::Curved) {
            return false;
        }
        // degrees only rise, so this ends
        let raised = model.states.iter().zip(&states).map(|(s, d)| of(s.rate).max(of(s.initial)).max(*d)).collect();
        if raised == states {
            return true;
        }
        states = raised;
    }
}

/// The degree of every expression, for the given degrees of the states.
fn degrees(graph: &Graph, chosen: &[bool], states: &[Degree]) -> Vec<Degree> {
    let mut degrees: Vec<Degree> = Vec::with_capacity(graph.nodes().len());
    for node in graph.nodes() {
        let degree = match node {
            Node::Constant(_) => Degree::Constant,
            Node::Leaf(leaf) => of_leaf(graph, *leaf, chosen, states, &degrees),
            Node::Apply(op, args) => of_operation(*op, args.map(|a| degrees.get(a.index()).copied())),
        };
        degrees.push(degree);
    }
    degrees
}

fn of_leaf(graph: &Graph, leaf: Leaf, chosen: &[bool], states: &[Degree], degrees: &[Degree]) -> Degree {
    match leaf {
        Leaf::Param(k) if chosen[k as usize] => Degree::Affine,
        Leaf::Time | Leaf::Input(_) | Leaf::Param(_) => Degree::Constant,
        Leaf::State(k) => states[k as usize],
        Leaf::Delayed(k) => {
            let delayed = graph.delayed()[k as usize];
            match (degrees.get(delayed.tau.index()), delayed.signal) {
                (Some(Degree::Constant), Signal::State(k)) => states[k as usize],
                (Some(Degree::Constant), Signal::Input(_)) => Degree::Constant,
                _ => Degree::Curved,
            }
        }
    }
}

/// Operands that an operation does not have are none.
fn of_operation(op: Op, args: [Option<Degree>; 3]) -> Degree {
    use Degree::{Constant, Curved};
    let [a, b, c] = args.map(|d| d.unwrap_or(Constant));
    match op {
        _ if a.max(b).max(c) == Constant => Constant,
        Op::Add | Op::Sub | Op::Neg => a.max(b),
        Op::Mul if a == Constant || b == Constant => a.max(b),
        Op::Div if b == Constant => a,
        Op::Select if a == Constant => b.max(c),
        _ => Curved,
    }
}

#[cfg(test)]
mod affine_tests {
    use super::*;
    use fdm_system::Model;

    fn names(text: &str) -> Vec<String> {
        let model = Model::from_text("test.fdm", text).expect("a model");
        let definition = model.definition();
        affine(definition).into_iter().map(|k| definition.params[k].quantity.name.clone()).collect()
    }

    #[test]
    fn factors_of_curved_terms_are_affine_together() {
        let text = "model m { input x; param a = 1, b = 1, c = 1, d = 1, e = 1 fixed, f = 1;
            output y = a + b*exp(-x*c) + (d*b)*x + e; output z = if x > 0 then f*x else 2*f; }";
        assert_eq!(names(text), ["a", "b", "f"]);
        let ratio = "model m { input x; param a = 1, b = 1, c = 1; output y = (a + b*x)/(1 + c*x); }";
        assert_eq!(names(ratio), ["a", "b"]);
        assert!(names("model m { input x; param a = 1; output y = sin(a*x) + a^2; }").is_empty());
    }

    #[test]
    fn linear_equations_are_affine_in_their_inputs_effectiveness_and_initial_values() {
        let text = "model m { input u; state x = x0, v; param x0 = 1, k = 1, b = 1, g = 1, tau = 0.1 in [0, 1], s = 1;
            der(x) = v; der(v) = -k*x + b*u + g; output y = x + s*t; output w = delay(v, tau); }";
        assert_eq!(names(text), ["x0", "b", "g", "s"]);
        let curved =
            "model m { input u; state x = x0; param x0 = 1, k = 1, b = 1; der(x) = -k*x*abs(x) + b*u; output y = x; }";
        assert!(names(curved).is_empty());
        let decay = "model m { state x = x0; param k = 1, x0 = 1; der(x) = -k*x; output y = x; }";
        assert!(names(decay) == ["x0"], "{:?}", names(decay));
    }
}
