//! End-point (leakage) terms: what the transform of a derivative has besides j w times the transform of its state.
//!
//! `x'(w) = j w x(w) + e1 x(T - dt/2) - e0 x(-dt/2)` (Marchand and Fu 1985) with the factors of [`Spectrum::end_factors`]; on
//! the grid of the record, w = 2 pi i/T, both are equal and the difference of the end values alone counts. The end values of
//! a state that an output shows are known, those of others are unknowns of the run, in which the response is linear.
//!
//! A delayed state brings into the record what it did before, and moves the last of it out. With D = exp(-j w tau) and a state that
//! goes straight on at both ends, integrals over these two strips give
//! `x_d(w) = D x(w) + (D - 1)/(j w) E + (D - 1 + j w tau)/(j w)^2 S`: E is the end term of the state, S that of its rate,
//! `S = A E + B E_u` by its own equation, in which delays count for nothing at this order. What is left is of third order in tau.
//!
//! The transform of a delayed input, exact between samples: what a delay brings into the record and what it moves out of it
//! is known, since inputs are.
//!
//! With u held before the record, `u_d(w) = D (u(w) + [e0 H - e1 L]/T) - c m`: D is exp(-j w tau), H and L are integrals of
//! `u exp(j w o)` over offsets o from 0 to tau back from both ends of the record, e0 and e1 the turns of these ends, m the mean of
//! the delayed input and c the transform of a constant.

use crate::linear::{Structure, Values};
use crate::spectrum::Spectrum;
use fdm_grammar::graph::Signal;
use fdm_grammar::math;
use num_complex::Complex64;
use serde::Serialize;

/// What is done about the end-point terms.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub enum EndTerms {
    /// Taken from the record for states that an output shows with known coefficients, unknown for all others.
    #[default]
    Known,
    /// Unknown for all states.
    Unknown,
    /// Left out, as if the record began and ended alike.
    Omitted,
    /// Given for all states and frequencies (n by M). Here and where they are left out, a delay is `exp(-j w tau)` and nothing else.
    Given(#[serde(serialize_with = "pairs")] Vec<Complex64>),
}

/// Real and imaginary parts.
fn pairs<S: serde::Serializer>(values: &[Complex64], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_seq(values.iter().map(|v| (v.re, v.im)))
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

/// End-point terms of one run.
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

/// An input on its way into the past: linear pieces of one interval, the first of half of one, then constant.
#[derive(Debug, Clone)]
struct Past {
    dt: f64,
    pieces: Vec<[f64; 2]>,
    beyond: f64,
    /// For each boundary of pieces so far reached (by M): exp(j w o), and the integral up to it.
    reached: Vec<Vec<[Complex64; 2]>>,
}

impl Past {
    fn new(dt: f64, pieces: Vec<[f64; 2]>, beyond: f64, frequencies: usize) -> Self {
        let first = vec![[Complex64::ONE, Complex64::ZERO]; frequencies];
        Self { dt, pieces, beyond, reached: vec![first] }
    }

    /// Offset at which a piece begins.
    fn boundary(&self, piece: usize) -> f64 {
        if piece == 0 { 0.0 } else { (piece as f64 - 0.5) * self.dt }
    }

    /// The piece at an offset, its value there and at its beginning, and the integral of all before.
    fn at(&self, tau: f64) -> Place {
        let piece = if tau > 0.5 * self.dt { (tau / self.dt + 0.5) as usize } else { 0 }.min(self.pieces.len());
        let begin = self.boundary(piece);
        let [a, b] = self.pieces.get(piece).copied().unwrap_or([self.beyond; 2]);
        // a negative delay looks ahead: nothing is known there
        let slope = if tau > 0.0 { (b - a) / (self.boundary(piece + 1) - begin) } else { 0.0 };
        let value = a + slope * (tau - begin);
        let before: f64 = (0..piece)
            .map(|k| 0.5 * (self.pieces[k][0] + self.pieces[k][1]) * (self.boundary(k + 1) - self.boundary(k)))
            .sum();
        Place { piece, begin: a, value, slope, mean: before + 0.5 * (a + value) * (tau - begin) }
    }

    /// Calls `each` with the turn at the beginning of a piece and the integral up to it, for all frequencies.
    fn walk(&mut self, piece: usize, omega: &[f64], mut each: impl FnMut(usize, [Complex64; 2])) {
        // numbers that are kept of boundaries; what lies further back is summed up every time
        while self.reached.len() <= piece && self.reached.len() * omega.len() < (1 << 21) {
            let next = self.next(self.reached.len() - 1, omega, &self.reached[self.reached.len() - 1]);
            self.reached.push(next);
        }
        let last = piece.min(self.reached.len() - 1);
        if last == piece {
            return self.reached[piece].iter().enumerate().for_each(|(k, at)| each(k, *at));
        }
        let mut at = self.reached[last].clone();
        (last..piece).for_each(|k| at = self.next(k, omega, &at));
        at.iter().enumerate().for_each(|(k, at)| each(k, *at));
    }

    fn next(&self, piece: usize, omega: &[f64], at: &[[Complex64; 2]]) -> Vec<[Complex64; 2]> {
        let [a, b] = self.pieces.get(piece).copied().unwrap_or([self.beyond; 2]);
        let end = self.boundary(piece + 1);
        let slope = (b - a) / (end - self.boundary(piece));
        let one = |(w, [begin, sum]): (&f64, &[Complex64; 2])| {
            let turned = turn(w * end);
            [turned, sum + integral(*w, slope, (a, *begin), (b, turned))]
        };
        omega.iter().zip(at).map(one).collect()
    }
}

/// Where a delay reaches to.
struct Place {
    piece: usize,
    begin: f64,
    value: f64,
    slope: f64,
    /// Integral of the input up to there.
    mean: f64,
}

/// Integral of `u exp(j w o)`, u linear between two values with the turns there.
fn integral(w: f64, slope: f64, (a, begin): (f64, Complex64), (b, end): (f64, Complex64)) -> Complex64 {
    (end * b - begin * a) * Complex64::new(0.0, -1.0 / w) + (end - begin) * (slope / (w * w))
}

/// A delayed input at the frequencies of a run.
#[derive(Debug, Clone)]
pub(super) struct DelayedInput {
    duration: f64,
    /// Before the record and back from its end.
    pasts: [Past; 2],
    /// Turns of both ends (by M).
    turns: Vec<[Complex64; 2]>,
    dt: f64,
    held: bool,
    /// The input (by M).
    input: Vec<Complex64>,
    /// The input as outputs see it: sums of samples; nothing where that is the same, or no output sees it.
    seen: Vec<Complex64>,
    /// What is brought in less what is moved out, divided by exp(j w tau) (by M).
    change: Vec<Complex64>,
}

/// A delayed input at one frequency, with its derivative by the delay: as states see it, and as outputs do.
pub(super) type Delayed = [Complex64; 4];

impl DelayedInput {
    /// Where a spectrum has no samples of its inputs they stay what they are at the ends; `shown`: an output sees the signal.
    pub(super) fn new(spectrum: &Spectrum, input: usize, shown: bool) -> Self {
        let (count, dt, duration) = (spectrum.omega.len(), spectrum.dt, spectrum.duration());
        let held = spectrum.input_held.get(input) == Some(&true);
        let each = spectrum.input_samples.len() / spectrum.input_ends[0].len().max(1);
        let samples = &spectrum.input_samples[input * each..][..each];
        let ends = [0, 1].map(|end: usize| spectrum.input_ends[end].get(input).copied().unwrap_or(0.0));
        let piece = |a: f64, b: f64| if held { [a, a] } else { [a, b] };
        let (mut head, mut tail) = (Vec::new(), Vec::new());
        if let Some((first, last)) = samples.first().zip(samples.last()) {
            head.push(piece(ends[0], *first));
            tail.push(if held { [*last; 2] } else { [ends[1], *last] });
            tail.extend(samples.windows(2).rev().map(|pair| if held { [pair[0]; 2] } else { [pair[1], pair[0]] }));
        }
        let before = spectrum.input_before.get(input).or(samples.first());
        let beyond = [0, 1].map(|end| before.copied().unwrap_or(ends[end]));
        let pasts = [Past::new(dt, head, beyond[0], count), Past::new(dt, tail, beyond[1], count)];
        let turns = spectrum.omega.iter().map(|w| [0.5 * dt, 0.5 * dt - duration].map(|t| turn(w * t))).collect();
        let plane = |all: &[Complex64]| all.get(input * count..(input + 1) * count).map_or(Vec::new(), <[_]>::to_vec);
        let seen = if shown { plane(&spectrum.sampled_inputs) } else { Vec::new() };
        let (input, change) = (plane(&spectrum.inputs), vec![Complex64::ZERO; count]);
        Self { duration, pasts, turns, dt, held, input, seen, change }
    }

    /// Calls `put` for every frequency; `delay` is exp(-j w tau) of each.
    pub(super) fn at(&mut self, tau: f64, omega: &[f64], delay: &[Complex64], mut put: impl FnMut(usize, Delayed)) {
        let Self { duration, pasts, turns, input, change, .. } = self;
        let places = pasts.each_ref().map(|past| past.at(tau));
        change.fill(Complex64::ZERO);
        for (end, sign) in [(0, 1.0), (1, -1.0)] {
            let place = &places[end];
            pasts[end].walk(place.piece, omega, |k, [begin, sum]| {
                let last = integral(omega[k], place.slope, (place.begin, begin), (place.value, delay[k].conj()));
                change[k] += turns[k][end] * (sum + last) * (sign / *duration);
            });
        }
        let mean = (places[0].mean - places[1].mean) / *duration;
        let rate = (places[0].value - places[1].value) / *duration;
        for (k, w) in omega.iter().enumerate() {
            let (delay, [before, behind], lag) = (delay[k], turns[k], Complex64::new(0.0, -w));
            let constant = (before - behind) / Complex64::new(0.0, w * *duration);
            let turned = delay * (input[k] + change[k]);
            let jump = (before * places[0].value - behind * places[1].value) / *duration;
            let (drives, moved) = (turned - constant * mean, lag * turned + jump - constant * rate);
            let [more, more_moved] = self.seen.get(k).map_or([Complex64::ZERO; 2], |seen| {
                let [sampled, slope] = sampled(tau, self.dt, *w, delay, self.held);
                [sampled * seen - delay * input[k], slope * seen - lag * delay * input[k]]
            });
            put(k, [drives, moved, drives + more, moved + more_moved]);
        }
    }
}

/// What samples of a delayed signal are besides those of the signal: exp(-j w tau), or where it is linear between its samples
/// the mean of those of both samples beside; and its derivative by the delay.
fn sampled(tau: f64, dt: f64, w: f64, delay: Complex64, held: bool) -> [Complex64; 2] {
    if held {
        return [delay, Complex64::new(0.0, -w) * delay];
    }
    let part = tau / dt - (tau / dt).floor();
    let (near, next) = (delay * turn(part * w * dt), turn(-w * dt));
    [near * ((1.0 - part) + part * next), near * (next - 1.0) / dt]
}
