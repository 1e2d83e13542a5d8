//! Modes of motion: eigenvalues, the states that dominate them, damping, frequency, time to half or double.

use super::coefficients::{Structure, Values};
use super::roots;
use super::roots::Characteristic;
use fdm_grammar::graph::Signal;
use fdm_numeric::eigen::{Root, eigen};
use num_complex::Complex64;
use serde::{Deserialize, Serialize};
use std::f64::consts::LN_2;

/// A root s of the characteristic equation: the motion exp(s t).
#[derive(Debug, Clone, PartialEq)]
pub struct Mode {
    /// The root, in rad per unit of the model's time.
    pub s: Complex64,
    /// (state, share) of the states that take part, the greatest first: right times left eigenvector, which no unit changes, as parts
    /// of one.
    pub states: Vec<(usize, f64)>,
    /// What the states (n) do in it: the right eigenvector, each component in its state's unit over the greatest, which is 1.
    pub shape: Vec<Complex64>,
    /// Whether an output shows it; taken for granted where the root is not simple.
    pub shown: bool,
    /// Whether an input moves it; taken for granted where the root is not simple.
    pub moved: bool,
    /// The derivatives of s by all parameters (p); none for a root that is not simple.
    pub slopes: Option<Vec<Complex64>>,
}

/// All modes of a model, or the rightmost of infinitely many.
#[derive(Debug, Clone, PartialEq)]
pub struct Modes {
    /// Rightmost first; of a pair first the one with positive imaginary part.
    pub modes: Vec<Mode>,
    /// Delayed states give a model infinitely many modes, of which these are the rightmost.
    pub infinite: bool,
}

/// Why there are no modes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum ModesError {
    /// The model has no states.
    #[error("the model has no states, and so no modes")]
    NoStates,
    /// The QR algorithm gave up.
    #[error(
        "the eigenvalues could not be computed: the coefficients are too large or differ by too many orders of magnitude"
    )]
    NotFound,
    /// A delay is negative.
    #[error("a delay of a state is negative: such a model has no modes")]
    Advanced,
}

impl Modes {
    /// The modes of a linear model.
    ///
    /// # Errors
    /// [`ModesError`].
    pub fn new(structure: &Structure, values: &Values) -> Result<Self, ModesError> {
        if structure.states == 0 {
            return Err(ModesError::NoStates);
        }
        let mut equation = Characteristic::new(structure, values);
        if equation.late.iter().any(|l| l.tau < 0.0) {
            return Err(ModesError::Advanced);
        }
        let infinite = equation.has_delayed_states();
        let roots = if infinite {
            roots::rightmost(&equation)
        } else {
            for l in &equation.late {
                l.column.iter().for_each(|(row, value)| equation.a[(*row, l.state)] += value);
            }
            let roots = eigen(&equation.a);
            equation = Characteristic::new(structure, values);
            roots
        };
        let mut modes = Vec::new();
        let roots = roots.ok_or(ModesError::NotFound)?;
        let largest = roots.iter().map(|r| r.s.norm()).fold(0.0, f64::max);
        for root in roots {
            let mode = mode(&equation, structure, values, (&root, largest));
            let mirror = (root.s.im != 0.0).then(|| mode.conjugate());
            modes.push(mode);
            modes.extend(mirror);
        }
        let order = |m: &Mode| (m.s.re, m.s.im.abs(), m.s.im);
        modes.sort_by(|a, b| {
            let (a, b) = (order(a), order(b));
            b.0.total_cmp(&a.0).then(a.1.total_cmp(&b.1)).then(b.2.total_cmp(&a.2))
        });
        Ok(Self { modes, infinite })
    }
}

/// The mode of a root; `largest` is the size of the largest root, of whose rounding a root at zero is made.
fn mode(equation: &Characteristic, structure: &Structure, values: &Values, (root, largest): (&Root, f64)) -> Mode {
    let slopes = root.simple.then(|| equation.root_slopes(structure, values, root.s, &root.x, &root.y));
    let shares: Vec<f64> = root.x.iter().zip(&root.y).map(|(x, y)| (y.conj() * x).norm()).collect();
    let sum: f64 = shares.iter().sum();
    let mut states: Vec<(usize, f64)> = shares.into_iter().map(|v| v / sum).enumerate().collect();
    // of two eigenvectors that are orthogonal nothing can be said
    states.retain(|(_, share)| share.is_finite());
    states.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    // what rounding leaves of a part that is zero
    let rounding = f64::EPSILON * (4.0 * root.s.norm()).max(largest);
    let part = |v: f64| if v.abs() <= rounding { 0.0 } else { v };
    let shape = scaled(&root.x);
    let [shown, moved] = [shown(structure, values, root), moved(structure, values, root)].map(|v| v || !root.simple);
    Mode { s: Complex64::new(part(root.s.re), part(root.s.im)), states, shape, shown, moved, slopes }
}

/// The vector whose greatest component is 1; of equal ones the first.
fn scaled(x: &[Complex64]) -> Vec<Complex64> {
    let greatest = x.iter().fold(Complex64::ZERO, |g, v| if v.norm() > g.norm() { *v } else { g });
    let part = |v: &Complex64| if *v == greatest { Complex64::ONE } else { v / greatest };
    x.iter().map(part).collect()
}

/// Size of what is shown or moved, relative to what could be, that is rounding.
const NOTHING: f64 = 1e-11;

/// Whether C x has an output that is not zero.
fn shown(structure: &Structure, values: &Values, root: &Root) -> bool {
    let n = structure.states;
    let largest = root.x.iter().map(|x| x.norm()).fold(0.0, f64::max);
    (n..n + structure.outputs).any(|row| {
        let (mut sum, mut size) = (Complex64::ZERO, 0.0_f64);
        let own = structure.terms.iter().zip(&values.terms).filter(|(t, _)| t.row as usize == row);
        for (term, value) in own {
            let (signal, factor) = undelayed(structure, values, term.signal as usize, root.s);
            if let Signal::State(k) = signal {
                sum += factor * root.x[k as usize] * *value;
                size = size.max((factor * *value).norm() * largest);
            }
        }
        sum.norm() > NOTHING * size
    })
}

/// Whether y* B has an input that is not zero.
fn moved(structure: &Structure, values: &Values, root: &Root) -> bool {
    let largest = root.y.iter().map(|y| y.norm()).fold(0.0, f64::max);
    (0..structure.inputs).any(|input| {
        let (mut sum, mut size) = (Complex64::ZERO, 0.0_f64);
        for (term, value) in
            structure.terms.iter().zip(&values.terms).filter(|(t, _)| (t.row as usize) < structure.states)
        {
            let (signal, factor) = undelayed(structure, values, term.signal as usize, root.s);
            if signal == Signal::Input(input as u32) {
                sum += root.y[term.row as usize].conj() * factor * *value;
                size = size.max((factor * *value).norm() * largest);
            }
        }
        sum.norm() > NOTHING * size
    })
}

/// What a signal is a delayed version of, and the factor exp(-s tau).
fn undelayed(structure: &Structure, values: &Values, signal: usize, s: Complex64) -> (Signal, Complex64) {
    let n = structure.states;
    match signal.checked_sub(n + structure.inputs) {
        Some(d) => (structure.delayed[d], (-s * values.tau[d]).exp()),
        None if signal < n => (Signal::State(signal as u32), Complex64::ONE),
        None => (Signal::Input((signal - n) as u32), Complex64::ONE),
    }
}

impl Mode {
    /// A state takes part when its share is at least this part of the greatest.
    const DOMINANT: f64 = 0.25;

    fn conjugate(&self) -> Self {
        let slopes = self.slopes.as_ref().map(|s| s.iter().map(Complex64::conj).collect());
        let shape = self.shape.iter().map(Complex64::conj).collect();
        Self { s: self.s.conj(), shape, slopes, ..self.clone() }
    }

    /// The states that dominate the mode, the greatest share first.
    pub fn dominant(&self) -> impl Iterator<Item = usize> + '_ {
        let least = self.states.first().map_or(0.0, |(_, share)| Self::DOMINANT * share);
        self.states.iter().filter(move |(_, share)| *share >= least).map(|(state, _)| *state)
    }

    /// Damping ratio -re/|s|: 1 for a subsidence, -1 for a divergence, none at zero.
    pub fn damping(&self) -> Option<f64> {
        let size = self.frequency();
        (size > 0.0).then(|| 0.0 - self.s.re / size)
    }

    /// Undamped natural frequency |s| in rad per unit of time.
    pub fn frequency(&self) -> f64 {
        self.s.norm()
    }

    /// Time in which a decaying mode loses half of its amplitude.
    pub fn time_to_half(&self) -> Option<f64> {
        (self.s.re < 0.0).then(|| LN_2 / -self.s.re)
    }

    /// Time in which a growing mode doubles its amplitude.
    pub fn time_to_double(&self) -> Option<f64> {
        (self.s.re > 0.0).then(|| LN_2 / self.s.re)
    }

    /// Standard errors from the covariance of the parameters, (i, j) of all parameters (zero for those that are known).
    /// None for a root that is not simple.
    pub fn errors(&self, covariance: impl Fn(usize, usize) -> f64) -> Option<ModeErrors> {
        let slopes = self.slopes.as_ref()?;
        let (re, im, size) = (self.s.re, self.s.im, self.s.norm());
        let size_slope = |d: &Complex64| if size > 0.0 { (re * d.re + im * d.im) / size } else { 0.0 };
        let joint = |one: &dyn Fn(&Complex64) -> f64, other: &dyn Fn(&Complex64) -> f64| {
            let [g, h] = [one, other].map(|of| slopes.iter().map(of).collect::<Vec<f64>>());
            let terms = |i: usize| (0..h.len()).map(|j| g[i] * h[j] * covariance(i, j)).sum::<f64>();
            (0..g.len()).filter(|i| g[*i] != 0.0).map(terms).sum::<f64>()
        };
        let error = |slope: &dyn Fn(&Complex64) -> f64| joint(slope, slope).max(0.0).sqrt();
        Some(ModeErrors {
            re: error(&|d| d.re),
            im: error(&|d| d.im),
            covariance: joint(&|d| d.re, &|d| d.im),
            // |damping| is 1 on the whole real axis
            damping: if im == 0.0 { 0.0 } else { error(&|d| (re * size_slope(d) / size - d.re) / size) },
            frequency: if size > 0.0 { error(&size_slope) } else { error(&|d| d.norm()) },
        })
    }
}

/// Standard errors of a mode.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ModeErrors {
    /// Of the real part.
    pub re: f64,
    /// Of the imaginary part.
    pub im: f64,
    /// Covariance of both.
    pub covariance: f64,
    /// Of the damping ratio.
    pub damping: f64,
    /// Of the natural frequency.
    pub frequency: f64,
}
