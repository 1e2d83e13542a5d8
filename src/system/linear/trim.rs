//! Where a nonlinear model is looked at: the states and inputs at which its rates vanish, solved from the equations.

use crate::code::Bytecode;
use crate::dynamics::{Point, Workspace};
use fdm_grammar::graph::Signal;
use fdm_grammar::linearise::Balance;
use fdm_numeric::dense::GaussJordan;

/// Why a model has no linear model.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TrimError {
    /// Events have no part in a linear model.
    #[error(
        "the model has events (`when`), and no linear model has: fit in the time domain, or leave them out for this purpose"
    )]
    Events,
    /// The rates of these states cannot be made zero together.
    #[error("no trim was found: the rate{} of {} cannot be made zero{}; {}", if equations.len() == 1 { "" } else { "s" },
        listed(equations), held(given), wanted(open))]
    NotFound {
        /// The states, by name.
        equations: Vec<String>,
        /// What `trim` holds, by name.
        given: Vec<String>,
        /// States and inputs that it leaves open, with their start values: those first that these rates depend on most.
        open: Vec<(String, f64)>,
    },
    /// A coefficient is not a number at the trim.
    #[error("at the trim the equations have no derivative: {} of `{equation}` by `{signal}` is {value}",
        if *slope { "a second derivative" } else { "the derivative" })]
    NotFinite {
        /// The state or output whose equation it is.
        equation: String,
        /// The signal.
        signal: String,
        /// What it is instead.
        value: f64,
        /// Whether it is the derivative of the coefficient by a parameter.
        slope: bool,
    },
}

fn listed(names: &[String]) -> String {
    names.iter().map(|n| format!("`{n}`")).collect::<Vec<_>>().join(", ")
}

/// What would mend it.
fn wanted(open: &[(String, f64)]) -> String {
    const NAMED: usize = 4;
    let Some((name, value)) = open.first() else {
        return "`trim { x = value; u = value; }` in the model says where it is linearised".into();
    };
    let names: Vec<String> = open.iter().take(NAMED).map(|(name, _)| name.clone()).collect();
    let more = if open.len() > names.len() { ", ..." } else { "" };
    format!(
        "open are {}{more}: say in the model what is known of them, as in `trim {{ {name} = {value}; }}`",
        listed(&names)
    )
}

fn held(given: &[String]) -> String {
    if given.is_empty() {
        String::new()
    } else {
        format!(" while {} {} held", listed(given), if given.len() == 1 { "is" } else { "are" })
    }
}

/// The equations of the trim, ready to be solved.
#[derive(Debug, Clone)]
pub(super) struct Equations {
    pub(super) balance: Balance,
    program: Bytecode,
    out: Vec<f64>,
    work: Workspace,
    elimination: GaussJordan,
    trial: Vec<f64>,
    scales: Vec<f64>,
}

/// Which rows (positions in the balance) are not zero.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Unbalanced(pub(super) Vec<usize>);

impl Equations {
    /// Iterations of Newton's method.
    const MOST: usize = 100;
    /// Steps on the way to rest.
    const MOST_STEPS: usize = 1000;
    /// A rate below this part of the terms that it is made of is zero.
    const ZERO: f64 = 1e-9;

    pub(super) fn new(balance: Balance) -> Self {
        let program = Bytecode::new(&balance.program, balance.unknowns.len(), 0);
        let (out, work) = (vec![0.0; balance.program.width], Workspace::default());
        let scales = Vec::with_capacity(balance.rows.len());
        Self { balance, program, out, work, elimination: GaussJordan::default(), trial: Vec::new(), scales }
    }

    pub(super) fn evaluate(&mut self, theta: &[f64], z: &[f64]) {
        let at = Point { t: 0.0, x: z, drive: &[], known: theta };
        self.program.run(at, &mut self.out, &mut self.work);
    }

    fn rates(&self) -> &[f64] {
        &self.out[..self.balance.rows.len()]
    }

    fn by_unknown(&self) -> impl Iterator<Item = (usize, usize, f64)> + '_ {
        let places = self.balance.by_unknown.iter().map(|(i, j)| (*i as usize, *j as usize));
        places.zip(&self.out[self.balance.rows.len()..]).map(|((i, j), v)| (i, j, *v))
    }

    fn by_param(&self) -> impl Iterator<Item = (usize, usize, f64)> + '_ {
        let places = self.balance.by_param.iter().map(|(i, j)| (*i as usize, *j as usize));
        let first = self.balance.rows.len() + self.balance.by_unknown.len();
        places.zip(&self.out[first..]).map(|((i, j), v)| (i, j, *v))
    }

    /// How much each unknown moves these rates (states), as evaluated last, each rate by its largest derivative.
    pub(super) fn weights(&self, states: &[u32]) -> Vec<f64> {
        let mut largest = vec![0.0_f64; self.balance.rows.len()];
        self.by_unknown().for_each(|(i, _, d)| largest[i] = largest[i].max(d.abs()));
        let mut weights = vec![0.0_f64; self.balance.unknowns.len()];
        for (i, j, d) in
            self.by_unknown().filter(|(i, ..)| states.contains(&self.balance.rows[*i]) && largest[*i] > 0.0)
        {
            weights[j] = weights[j].max(d.abs() / largest[i]);
        }
        weights
    }

    /// The values of states and inputs that are known, as evaluated last.
    pub(super) fn known(&self) -> &[f64] {
        &self.out[self.balance.rows.len() + self.balance.by_unknown.len() + self.balance.by_param.len()..]
    }

    /// The rates that are not zero beside the terms that they are made of, as evaluated last.
    pub(super) fn unbalanced(&self, theta: &[f64], z: &[f64]) -> Vec<usize> {
        let mut terms = vec![0.0; self.balance.rows.len()];
        self.by_unknown().for_each(|(i, j, d)| terms[i] += (d * z[j]).abs());
        self.by_param().for_each(|(i, j, d)| terms[i] += (d * theta[j]).abs());
        let zero = |i: usize| {
            let rate = self.rates()[i];
            rate == 0.0 || rate.is_finite() && rate.abs() <= Self::ZERO * terms[i]
        };
        (0..terms.len()).filter(|i| !zero(*i)).collect()
    }

    /// Follows the states from `z` to where they come to rest: implicit Euler steps that grow as the rates get less (pseudo-transient
    /// continuation; Kelley and Keyes, SIAM J. Numer. Anal. 35, 1998). So a pendulum that is let go ends where it hangs, and not at some
    /// other zero that Newton's method happens to reach.
    pub(super) fn settle(&mut self, theta: &[f64], z: &mut [f64]) {
        let sizes = sizes(z);
        let of: Vec<Option<usize>> = self.balance.unknowns.iter().map(|u| self.row(*u)).collect();
        let (mut step, mut before) = (0.0, 0.0);
        for _ in 0..Self::MOST_STEPS {
            self.evaluate(theta, z);
            let length = self.speed(&of, &sizes);
            if length == 0.0 || !length.is_finite() {
                return;
            }
            step = if before == 0.0 { 0.1 / self.quickness(&sizes).max(length) } else { step * before / length };
            before = length;
            let correction = self.euler(&of, &sizes, step);
            correction.into_iter().for_each(|(k, d)| z[k] += d * sizes[k]);
            if step * self.quickness(&sizes) > 1e9 {
                return;
            }
        }
    }

    /// Position of the rate of an unknown state.
    fn row(&self, unknown: Signal) -> Option<usize> {
        self.balance.rows.iter().position(|k| Signal::State(*k) == unknown)
    }

    /// The quickest change of a state, in sizes per time.
    fn speed(&self, of: &[Option<usize>], sizes: &[f64]) -> f64 {
        let rates = of.iter().zip(sizes).filter_map(|(row, size)| row.map(|r| (self.rates()[r] / size).abs()));
        rates.fold(0.0, |a: f64, b| if b.is_nan() { b } else { a.max(b) })
    }

    /// The largest entry of the Jacobian in units of `sizes`, where it was evaluated last.
    fn quickness(&self, sizes: &[f64]) -> f64 {
        let unknown =
            |row: usize| self.balance.unknowns.iter().position(|u| *u == Signal::State(self.balance.rows[row]));
        let own = |(i, j, d): (usize, usize, f64)| unknown(i).map(|k| (d * sizes[j] / sizes[k]).abs());
        self.by_unknown().filter_map(own).fold(0.0, f64::max)
    }

    /// The step (1/h - J) d = f of the states, in units of `sizes`.
    fn euler(&mut self, of: &[Option<usize>], sizes: &[f64], step: f64) -> Vec<(usize, f64)> {
        let mut place = vec![None; self.balance.rows.len()];
        of.iter().enumerate().for_each(|(k, row)| row.iter().for_each(|r| place[*r] = Some(k)));
        let n = sizes.len();
        let mut matrix = vec![0.0; n * n];
        (0..n).for_each(|k| matrix[k * n + k] = 1.0 / step);
        for (i, j, d) in self.by_unknown() {
            if let Some(k) = place[i] {
                matrix[k * n + j] -= d * sizes[j] / sizes[k];
            }
        }
        let mut elimination = std::mem::take(&mut self.elimination);
        elimination.clear(n, n, 1);
        matrix.iter().enumerate().for_each(|(at, v)| elimination.set(at / n, at % n, *v));
        for (k, row) in of.iter().enumerate() {
            elimination.set_side(k, 0, row.map_or(0.0, |r| self.rates()[r] / sizes[k]));
        }
        elimination.eliminate();
        let found = elimination.solution(0).collect();
        self.elimination = elimination;
        found
    }

    /// Solves for the unknowns, starting at `z`; unknowns that the equations do not determine stay where they are.
    pub(super) fn solve(&mut self, theta: &[f64], z: &mut [f64]) -> Result<(), Unbalanced> {
        let sizes = sizes(z);
        let mut before = f64::INFINITY;
        self.evaluate(theta, z);
        for _ in 0..Self::MOST {
            self.correction(&sizes);
            let correction: Vec<(usize, f64)> = self.elimination.solution(0).collect();
            let size = |z: &[f64], k: usize| z[k].abs().max(sizes[k] * 1e-3);
            let length = correction.iter().fold(0.0_f64, |a, (k, d)| a.max((d * sizes[*k]).abs() / size(z, *k)));
            if !length.is_finite() {
                break;
            }
            if length <= 2.0 * f64::EPSILON || (length < 1e-8 && length >= 0.5 * before) {
                break;
            }
            before = length;
            if !self.step(theta, z, &sizes, &correction) {
                break;
            }
        }
        self.evaluate(theta, z);
        match self.unbalanced(theta, z) {
            rows if rows.is_empty() => Ok(()),
            rows => Err(Unbalanced(rows)),
        }
    }

    /// One correction, shortened until the rates that it is made for are less; false when they do not get less.
    fn step(&mut self, theta: &[f64], z: &mut [f64], sizes: &[f64], correction: &[(usize, f64)]) -> bool {
        self.trial.clear();
        self.trial.extend_from_slice(z);
        let scales = std::mem::take(&mut self.scales);
        let start = self.length(&scales);
        let mut gain = 1.0;
        let mut found = false;
        for _ in 0..40 {
            let mut trial = std::mem::take(&mut self.trial);
            trial.copy_from_slice(z);
            correction.iter().for_each(|(k, d)| trial[*k] += gain * d * sizes[*k]);
            self.evaluate(theta, &trial);
            self.trial = trial;
            let length = self.length(&scales);
            // at rounding the rates jump about
            if length < start * (1.0 - 0.1 * gain) || length <= 1e-13 {
                found = true;
                break;
            }
            gain *= 0.5;
        }
        self.scales = scales;
        if found {
            z.copy_from_slice(&self.trial);
        }
        found
    }

    /// The largest of the rates that the correction solves for.
    fn length(&self, scales: &[f64]) -> f64 {
        let rates = self.elimination.rows().map(|row| (self.rates()[row] / scales[row]).abs());
        rates.fold(0.0, |a, b| if b.is_nan() { f64::INFINITY } else { a.max(b) })
    }

    /// Newton's correction in units of `sizes`, as evaluated last.
    fn correction(&mut self, sizes: &[f64]) {
        let rows = self.balance.rows.len();
        let mut scales = std::mem::take(&mut self.scales);
        scales.clear();
        scales.resize(rows, 0.0);
        self.by_unknown().for_each(|(i, j, d)| scales[i] = scales[i].max((d * sizes[j]).abs()));
        scales.iter_mut().filter(|s| **s == 0.0).for_each(|s| *s = 1.0);
        let mut elimination = std::mem::take(&mut self.elimination);
        elimination.clear(rows, sizes.len(), 1);
        self.by_unknown().for_each(|(i, j, d)| elimination.set(i, j, d * sizes[j] / scales[i]));
        self.rates().iter().enumerate().for_each(|(i, f)| elimination.set_side(i, 0, -f / scales[i]));
        elimination.eliminate();
        (self.elimination, self.scales) = (elimination, scales);
    }

    /// The unknowns that the equations determine where they were evaluated last, rising.
    pub(super) fn determined(&mut self, sizes: &[f64]) -> Vec<usize> {
        self.correction(sizes);
        let mut columns: Vec<usize> = self.elimination.columns().collect();
        columns.sort_unstable();
        columns
    }

    /// The derivatives of the unknowns by all parameters (unknowns by p) where the equations were evaluated last: implicit
    /// function theorem. False when they are not determined.
    pub(super) fn slopes(&mut self, z: &[f64], slopes: &mut [f64]) -> bool {
        let (rows, unknowns) = (self.balance.rows.len(), z.len());
        let params = slopes.len() / unknowns.max(1);
        let mut elimination = std::mem::take(&mut self.elimination);
        elimination.clear(rows, unknowns, params);
        self.by_unknown().for_each(|(i, j, d)| elimination.set(i, j, d));
        self.by_param().for_each(|(i, j, d)| elimination.set_side(i, j, -d));
        let rank = elimination.eliminate();
        for side in 0..params {
            elimination.solution(side).for_each(|(k, d)| slopes[k * params + side] = d);
        }
        self.elimination = elimination;
        rank == unknowns
    }
}

/// How large unknowns are; one where nothing is known.
pub(super) fn sizes(z: &[f64]) -> Vec<f64> {
    z.iter().map(|v| if *v == 0.0 { 1.0 } else { v.abs() }).collect()
}
