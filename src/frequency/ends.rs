//! End terms: what the transform of a derivative has besides j w times the transform of its state.
//!
//! `x'(w) = j w x(w) + e1 x(T - dt/2) - e0 x(-dt/2)` (Marchand and Fu 1985) with the factors of [`Spectrum::end_factors`]; on
//! the grid of the record, w = 2 pi i/T, both are equal and the difference of the end values alone counts. The end values of
//! a state that an output shows are known, those of others are unknowns of the run, in which the response is linear.
//!
//! A delayed state brings into the record what it did before, and moves the last of it out. With D = exp(-j w tau) and a state that
//! goes straight on at both ends, integrals over these two strips give
//! `x_d(w) = D x(w) + (D - 1)/(j w) E + (D - 1 + j w tau)/(j w)^2 S`: E is the end term of the state, S that of its rate,
//! `S = A E + B E_u` by its own equation, in which delays count for nothing at this order. What is left is of third order in tau.

use crate::linear::{Structure, Values};
use crate::spectrum::Spectrum;
use fdm_grammar::graph::Signal;
use fdm_grammar::math;
use num_complex::Complex64;

/// What is done about the end terms.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum EndTerms {
    /// Taken from the record for states that an output shows with known coefficients, unknown for all others.
    #[default]
    Known,
    /// Unknown for all states.
    Unknown,
    /// Left out, as if the record began and ended alike.
    Omitted,
    /// Given for all states and frequencies (n by M). Here and where they are left out, a delay is `exp(-j w tau)` and nothing else.
    Given(Vec<Complex64>),
}

/// Which end value an unknown is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EndPoint {
    /// The state half an interval behind the last sample less that half an interval before the first.
    Difference,
    /// The state half an interval before the first sample.
    First,
    /// The state half an interval behind the last sample.
    Last,
}

/// An end value that is not known: a column behind those of the model's parameters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EndColumn {
    /// The state.
    pub state: usize,
    /// Which of its end values.
    pub point: EndPoint,
}

impl EndColumn {
    /// What a table calls the column: `end(x)`, or off the grid `first(x)` and `last(x)`.
    pub fn name(&self, state: &str) -> String {
        match self.point {
            EndPoint::Difference => format!("end({state})"),
            EndPoint::First => format!("first({state})"),
            EndPoint::Last => format!("last({state})"),
        }
    }
}

/// End terms of one run.
#[derive(Debug, Clone, Default)]
pub(super) struct Ends {
    /// Whether delayed signals have ends too: not where these are left out or given, which is about states alone.
    pub(super) delayed: bool,
    /// States whose end terms are known, and these (by M).
    pub(super) known: Vec<(usize, Vec<Complex64>)>,
    /// What is unknown.
    pub(super) unknown: Vec<EndColumn>,
    /// What one unit of an unknown adds to the end term of its state (by M): on the grid of differences, else of last and first
    /// values.
    pub(super) factors: Vec<Vec<Complex64>>,
    /// End terms of the inputs (by M); nothing where no delayed state asks for them.
    pub(super) inputs: Vec<Vec<Complex64>>,
}

impl Ends {
    pub(super) fn new(structure: &Structure, values: &Values, spectrum: &Spectrum, terms: &EndTerms) -> Self {
        let delayed = matches!(terms, EndTerms::Known | EndTerms::Unknown) && !structure.delayed.is_empty();
        let mut ends = Self { delayed, ..Self::default() };
        let states = 0..structure.states;
        if let EndTerms::Omitted = terms {
            return ends;
        }
        if let EndTerms::Given(given) = terms {
            let rows = given.chunks(spectrum.omega.len().max(1)).map(<[Complex64]>::to_vec);
            ends.known = states.zip(rows).collect();
            return ends;
        }
        let factors = (0..spectrum.omega.len()).map(|k| spectrum.end_factors(k));
        let (first, last): (Vec<Complex64>, Vec<Complex64>) = factors.map(|[before, behind]| (-before, behind)).unzip();
        let term = |[x0, x1]: [f64; 2]| first.iter().zip(&last).map(|(f, l)| x0 * f + x1 * l).collect();
        if delayed && structure.delayed.iter().any(|signal| matches!(signal, Signal::State(_))) {
            let value = |end: usize, j: usize| spectrum.input_ends[end].get(j).copied().unwrap_or(0.0);
            ends.inputs = (0..structure.inputs).map(|j| term([value(0, j), value(1, j)])).collect();
        }
        let unknown: Vec<usize> = match terms {
            EndTerms::Known => {
                let shown = |state: &usize| shown(structure, values, spectrum, *state);
                ends.known = states.clone().filter_map(|s| shown(&s).map(|x| (s, term(x)))).collect();
                states.filter(|s| shown(s).is_none()).collect()
            }
            _ => states.collect(),
        };
        let points: &[EndPoint] = match on_grid(spectrum) {
            true => &[EndPoint::Difference],
            false => &[EndPoint::First, EndPoint::Last],
        };
        ends.unknown = unknown.iter().flat_map(|s| points.iter().map(|p| EndColumn { state: *s, point: *p })).collect();
        if !ends.unknown.is_empty() {
            // on the grid both are equal but for their sign
            ends.factors = if points.len() == 1 { vec![last] } else { vec![first, last] };
        }
        ends
    }

    /// Which of the factors belongs to an unknown.
    pub(super) fn factor(&self, column: usize) -> usize {
        match self.unknown[column].point {
            EndPoint::Difference | EndPoint::First => 0,
            EndPoint::Last => 1,
        }
    }
}

/// Whether all frequencies are multiples of 2 pi/T.
fn on_grid(spectrum: &Spectrum) -> bool {
    let turns = spectrum.omega.iter().map(|w| w * spectrum.duration() / std::f64::consts::TAU);
    turns.into_iter().all(|turns| (turns - turns.round()).abs() < 1e-9 * turns.max(1.0))
}

/// Both end values of a state that an output shows: `y = c x + inputs` with coefficients that no parameter moves.
fn shown(structure: &Structure, values: &Values, spectrum: &Spectrum, state: usize) -> Option<[f64; 2]> {
    (0..structure.outputs).find_map(|o| {
        let row = (structure.states + o) as u32;
        let terms = || structure.terms.iter().enumerate().filter(|(_, t)| t.row == row);
        let constant = |k: usize| structure.slopes.iter().all(|s| s.term as usize != k);
        let inputs = structure.states..structure.states + structure.inputs;
        let suits = |(k, t): (usize, &crate::linear::Term)| {
            constant(k) && (t.signal as usize == state || inputs.contains(&(t.signal as usize)))
        };
        let (at, _) = terms().find(|(_, t)| t.signal as usize == state)?;
        if !terms().all(suits) || values.terms[at] == 0.0 {
            return None;
        }
        let end = |end: usize| {
            let drawn = terms().filter(|(k, _)| *k != at);
            let input = |signal: u32| spectrum.input_ends[end].get(signal as usize - structure.states).copied();
            let inputs: f64 = drawn.map(|(k, t)| values.terms[k] * input(t.signal).unwrap_or(f64::NAN)).sum();
            (spectrum.output_ends[end].get(o).copied().unwrap_or(f64::NAN) - inputs) / values.terms[at]
        };
        Some([end(0), end(1)]).filter(|ends| ends.iter().all(|x| x.is_finite()))
    })
}

/// exp(j angle).
pub(super) fn turn(angle: f64) -> Complex64 {
    Complex64::new(math::cos(angle), math::sin(angle))
}
