//! Modes of motion: eigenvalues, the states that dominate them, damping, frequency, time to half or double.
//!
//! The characteristic equation `M(s) x = 0`, `M(s) = s - A - sum of A_d exp(-s tau_d)`, of a linear model, and its rightmost roots where
//! states are delayed: then there are infinitely many.
//!
//! First guesses are the eigenvalues of the solution operator's generator, discretised on Chebyshev nodes over the longest delay
//! (Breda, Maset, Vermiglio, SIAM J. Sci. Comput. 27, 2005); each is brought to rounding by Newton's method on the exact equation.

use super::coefficients::{Structure, Values};
use fdm_grammar::graph::Signal;
use fdm_numeric::eigen::{Root, eigen, eigenvalues};
use nalgebra::DMatrix;
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
            rightmost(&equation)
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

/// A delayed state in the equations of the states.
#[derive(Debug, Clone)]
pub(super) struct Late {
    /// Position among the delayed signals.
    pub(super) delayed: usize,
    /// The delay.
    pub(super) tau: f64,
    /// The state.
    pub(super) state: usize,
    /// (equation, coefficient).
    pub(super) column: Vec<(usize, f64)>,
}

/// A and A_d of a linear model at one vector of parameters.
#[derive(Debug, Clone)]
pub(super) struct Characteristic {
    pub(super) a: DMatrix<f64>,
    pub(super) late: Vec<Late>,
}

impl Characteristic {
    pub(super) fn new(structure: &Structure, values: &Values) -> Self {
        let n = structure.states;
        let mut a = DMatrix::zeros(n, n);
        let states = structure.delayed.iter().enumerate().filter_map(|(d, signal)| match signal {
            Signal::State(k) => Some(Late { delayed: d, tau: values.tau[d], state: *k as usize, column: Vec::new() }),
            Signal::Input(_) => None,
        });
        let mut late: Vec<Late> = states.collect();
        for (term, value) in structure.terms.iter().zip(&values.terms) {
            let (row, signal) = (term.row as usize, term.signal as usize);
            if row >= n {
                break;
            }
            let delayed = signal.checked_sub(n + structure.inputs);
            if signal < n {
                a[(row, signal)] = *value;
            } else if let Some(l) = late.iter_mut().find(|l| Some(l.delayed) == delayed) {
                l.column.push((row, *value));
            }
        }
        late.retain(|l| !l.column.is_empty());
        Self { a, late }
    }

    /// Whether there are infinitely many roots.
    pub(super) fn has_delayed_states(&self) -> bool {
        self.late.iter().any(|l| l.tau > 0.0)
    }

    /// M(s).
    pub(super) fn at(&self, s: Complex64) -> DMatrix<Complex64> {
        let n = self.a.nrows();
        let mut m = DMatrix::from_fn(n, n, |i, j| Complex64::from(-self.a[(i, j)]));
        (0..n).for_each(|i| m[(i, i)] += s);
        for l in &self.late {
            let factor = (-s * l.tau).exp();
            l.column.iter().for_each(|(row, value)| m[(*row, l.state)] -= factor * *value);
        }
        m
    }

    /// y* M(s) x.
    pub(super) fn form(&self, s: Complex64, x: &[Complex64], y: &[Complex64]) -> Complex64 {
        let n = x.len();
        let mut sum = Complex64::ZERO;
        for i in 0..n {
            let row: Complex64 = (0..n).map(|j| x[j] * self.a[(i, j)]).sum();
            sum += y[i].conj() * (s * x[i] - row);
        }
        for l in &self.late {
            let factor = (-s * l.tau).exp() * x[l.state];
            l.column.iter().for_each(|(row, value)| sum -= y[*row].conj() * factor * *value);
        }
        sum
    }

    /// y* M'(s) x.
    pub(super) fn slope(&self, s: Complex64, x: &[Complex64], y: &[Complex64]) -> Complex64 {
        let mut sum: Complex64 = x.iter().zip(y).map(|(x, y)| y.conj() * x).sum();
        for l in &self.late {
            let factor = (-s * l.tau).exp() * x[l.state] * l.tau;
            l.column.iter().for_each(|(row, value)| sum += y[*row].conj() * factor * *value);
        }
        sum
    }

    /// The derivatives of a simple root by all parameters (p): `s_theta = -(y* M_theta x)/(y* M' x)`.
    pub(super) fn root_slopes(
        &self,
        structure: &Structure,
        values: &Values,
        s: Complex64,
        x: &[Complex64],
        y: &[Complex64],
    ) -> Vec<Complex64> {
        let (n, scale) = (structure.states, self.slope(s, x, y));
        let mut slopes = vec![Complex64::ZERO; structure.params];
        for (slope, value) in structure.slopes.iter().zip(&values.slopes) {
            let term = structure.terms[slope.term as usize];
            let (row, signal) = (term.row as usize, term.signal as usize);
            if row >= n {
                break;
            }
            let delayed = signal.checked_sub(n + structure.inputs);
            let seen = match self.late.iter().find(|l| Some(l.delayed) == delayed) {
                Some(l) => x[l.state] * (-s * l.tau).exp(),
                None if signal < n => x[signal],
                None => continue,
            };
            slopes[slope.param as usize] += y[row].conj() * seen * *value / scale;
        }
        for (slope, value) in structure.tau_slopes.iter().zip(&values.tau_slopes) {
            for l in self.late.iter().filter(|l| l.delayed == slope.delayed as usize) {
                let factor = -s * (-s * l.tau).exp() * x[l.state] * *value / scale;
                let column = l.column.iter().map(|(row, a)| y[*row].conj() * factor * *a);
                slopes[slope.param as usize] += column.sum::<Complex64>();
            }
        }
        slopes
    }
}

/// Intervals between the nodes, unless the matrix would outgrow [`LARGEST`].
const INTERVALS: usize = 40;
const FEWEST: usize = 6;
/// Rows of the discretised generator.
const LARGEST: usize = 300;
/// A guess that is off by more than this part was not resolved by the nodes.
const RESOLVED: f64 = 1e-4;
/// Roots beyond the number of states that are looked for, and how many at most.
const MORE: usize = 10;
const MOST: usize = 60;

/// The rightmost roots with their vectors; as many as there are states and some more. Only those in the upper half plane.
pub(super) fn rightmost(equation: &Characteristic) -> Option<Vec<Root>> {
    let n = equation.a.nrows();
    let mut guesses = eigenvalues(&generator(equation))?;
    guesses.retain(|s| s.im >= 0.0 && s.re.is_finite() && s.im.is_finite());
    guesses.sort_by(|a, b| b.re.total_cmp(&a.re).then(a.im.total_cmp(&b.im)));
    let wanted = (n + MORE).min(MOST.max(n.min(2 * MOST)));
    let mut found: Vec<Root> = Vec::new();
    // left of a root that the nodes do not resolve others may have been missed
    let mut limit = f64::NEG_INFINITY;
    for guess in guesses.into_iter().take(4 * wanted) {
        let Some(root) = refined(equation, guess) else { continue };
        if (root.s - guess).norm() > RESOLVED * (1.0 + guess.norm()) {
            limit = limit.max(root.s.re);
            continue;
        }
        let same = |r: &Root| (r.s - root.s).norm() <= 1e-7 * (1.0 + root.s.norm());
        if !found.iter().any(same) {
            found.push(root);
        }
    }
    found.retain(|r| r.s.re > limit);
    found.sort_by(|a, b| b.s.re.total_cmp(&a.s.re).then(a.s.im.total_cmp(&b.s.im)));
    let mut count = 0;
    found.retain(|r| {
        let room = count < wanted;
        count += if r.s.im == 0.0 { 1 } else { 2 };
        room
    });
    Some(found)
}

/// The generator on polynomials through the nodes: the present state, then the past of the states that are delayed.
fn generator(equation: &Characteristic) -> DMatrix<f64> {
    let n = equation.a.nrows();
    let longest = equation.late.iter().fold(0.0_f64, |t, l| t.max(l.tau));
    let mut past: Vec<usize> = equation.late.iter().filter(|l| l.tau > 0.0).map(|l| l.state).collect();
    past.sort_unstable();
    past.dedup();
    let intervals = (LARGEST.saturating_sub(n) / past.len().max(1)).clamp(FEWEST, INTERVALS);
    let nodes: Vec<f64> = (0..=intervals)
        .map(|k| 0.5 * longest * ((std::f64::consts::PI * k as f64 / intervals as f64).cos() - 1.0))
        .collect();
    let weights: Vec<f64> = (0..=intervals)
        .map(|k| (if k % 2 == 0 { 1.0 } else { -1.0 }) * (if k == 0 || k == intervals { 0.5 } else { 1.0 }))
        .collect();
    let place = |p: usize, k: usize| if k == 0 { past[p] } else { n + p * intervals + k - 1 };
    let mut g = DMatrix::zeros(n + past.len() * intervals, n + past.len() * intervals);
    g.view_mut((0, 0), (n, n)).copy_from(&equation.a);
    for l in &equation.late {
        let p = past.iter().position(|s| *s == l.state);
        for (row, value) in &l.column {
            match p {
                Some(p) => {
                    for (k, share) in interpolation(&nodes, &weights, -l.tau).into_iter().enumerate() {
                        g[(*row, place(p, k))] += value * share;
                    }
                }
                None => g[(*row, l.state)] += value,
            }
        }
    }
    for p in 0..past.len() {
        for i in 1..=intervals {
            let mut own = 0.0;
            for j in (0..=intervals).filter(|j| *j != i) {
                let d = weights[j] / weights[i] / (nodes[i] - nodes[j]);
                g[(place(p, i), place(p, j))] = d;
                own -= d;
            }
            g[(place(p, i), place(p, i))] = own;
        }
    }
    g
}

/// What the values at the nodes contribute at `t` (barycentric).
fn interpolation(nodes: &[f64], weights: &[f64], t: f64) -> Vec<f64> {
    if let Some(k) = nodes.iter().position(|node| *node == t) {
        return (0..nodes.len()).map(|j| f64::from(u8::from(j == k))).collect();
    }
    let terms: Vec<f64> = nodes.iter().zip(weights).map(|(node, w)| w / (t - node)).collect();
    let sum: f64 = terms.iter().sum();
    terms.into_iter().map(|v| v / sum).collect()
}

/// Newton's method on the exact equation, with both vectors by inverse iteration at every step. None when it does not converge or
/// leaves for another root.
fn refined(equation: &Characteristic, guess: Complex64) -> Option<Root> {
    const STEPS: usize = 30;
    let n = equation.a.nrows();
    let (mut s, mut before) = (guess, f64::INFINITY);
    let mut x = start(n);
    let mut y = x.clone();
    for step in 0..STEPS {
        (x, y) = vectors(equation, s, &x, &y)?;
        let slope = equation.slope(s, &x, &y);
        let correction = equation.form(s, &x, &y) / slope;
        let length = correction.norm() / (1.0 + s.norm());
        if !length.is_finite() {
            return None;
        }
        if length <= 1e-15 || (step > 2 && length < 1e-10 && length >= 0.5 * before) {
            let simple = slope.norm() > 1e-8 * norm(&x) * norm(&y);
            return Some(Root { s, x, y, simple });
        }
        before = length;
        s -= correction;
        if guess.im == 0.0 {
            s.im = 0.0;
        }
        if s.im < 0.0 || (s - guess).norm() > 0.5 * (1.0 + guess.norm()) {
            return None;
        }
    }
    None
}

fn norm(v: &[Complex64]) -> f64 {
    v.iter().map(Complex64::norm_sqr).sum::<f64>().sqrt()
}

/// Not orthogonal to anything that is likely to be asked for.
fn start(n: usize) -> Vec<Complex64> {
    (0..n).map(|k| Complex64::from(1.0 + 0.37 * ((k * 7) % 11) as f64)).collect()
}

type Pair = (Vec<Complex64>, Vec<Complex64>);

/// One step of inverse iteration for the right and the left vector, of unit length.
fn vectors(equation: &Characteristic, s: Complex64, x: &[Complex64], y: &[Complex64]) -> Option<Pair> {
    let mut m = equation.at(s);
    let size = m.iter().fold(0.0_f64, |a, v| a.max(v.norm()));
    let solved = |m: &DMatrix<Complex64>, b: &[Complex64]| {
        let solution = m.clone().lu().solve(&nalgebra::DVector::from_column_slice(b))?;
        let length = solution.norm();
        (length.is_finite() && length > 0.0).then(|| solution.iter().map(|v| *v / length).collect::<Vec<_>>())
    };
    let both = |m: &DMatrix<Complex64>| Some((solved(m, x)?, solved(&m.adjoint(), y)?));
    both(&m).or_else(|| {
        // exactly singular: as good as any other last place
        (0..m.nrows()).for_each(|k| m[(k, k)] += size * 1e-15);
        both(&m)
    })
}

#[cfg(test)]
mod roots_tests {
    use super::{Late, *};

    #[test]
    fn no_root_is_missed() {
        let a = DMatrix::from_row_slice(2, 2, &[0.0, 1.0, 0.0, -0.2]);
        let late = Late { delayed: 0, tau: 2.1, state: 0, column: vec![(1, -0.0135)] };
        let equation = Characteristic { a, late: vec![late] };
        let found = rightmost(&equation).unwrap();
        assert!(found.len() >= 6, "{}", found.len());
        // the roots of a chain stand 2 pi/tau apart, more and more exactly
        for pair in found.windows(2).skip(1) {
            let apart = (pair[1].s.im - pair[0].s.im) * 2.1 / std::f64::consts::TAU;
            assert!((apart - 1.0).abs() < 0.15, "{} {}", pair[0].s, pair[1].s);
        }
        for root in &found {
            let s = root.s;
            let off = s * (s + 0.2) + 0.0135 * (-s * 2.1).exp();
            let slope = 2.0 * s + 0.2 - 2.1 * 0.0135 * (-s * 2.1).exp();
            assert!((off / slope).norm() < 1e-14 * (1.0 + s.norm()), "{s}");
        }
    }
}
