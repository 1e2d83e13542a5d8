//! The solution at one frequency by numbers: LU factors, for frequencies where the diagonal pivots of the program are not to be trusted, and
//! for models too full for a program. Where A does not depend on the frequency, one reduction to a Hessenberg matrix serves all of them with
//! n^2 operations each (Laub 1981).

use super::wiring::{Influence, Source, Wiring};
use crate::linear::Values;
use fdm_numeric::dense::ShiftedHessenberg;
use fdm_numeric::dense::lu::{Complex, Lu};
use nalgebra::DMatrix;
use nalgebra::linalg::{Hessenberg, balancing};
use num_complex::Complex64;

const ZERO: Complex64 = Complex64::new(0.0, 0.0);
/// The smallest pivot, in multiples of the rounding of a matrix of this size with rows and columns of unit size.
const SINGULAR: f64 = 4.0 * f64::EPSILON;

/// Memory of the solution at one frequency.
#[derive(Debug, Clone, Default)]
pub(super) struct Dense {
    matrix: Vec<Complex64>,
    factors: Lu<Complex>,
    rows: Vec<f64>,
    columns: Vec<f64>,
    /// States.
    x: Vec<Complex64>,
    /// Rows of C (j w - A)^-1 (q by n).
    weights: Vec<Complex64>,
    /// Outputs (q).
    pub(super) y: Vec<Complex64>,
    /// The state matrix, reduced once for many frequencies.
    reduction: Option<Reduction>,
    kept: Vec<Complex64>,
    /// Derivatives by what is asked for, arranged as the planes of the wiring are.
    pub(super) derivatives: Vec<Complex64>,
}

/// There is no solution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Singular;

impl Dense {
    pub(super) fn new(wiring: &Wiring) -> Self {
        let (n, q) = (wiring.structure.states, wiring.structure.outputs);
        Self {
            matrix: vec![ZERO; n * n],
            factors: Lu::new(n),
            rows: vec![0.0; n],
            columns: vec![0.0; n],
            x: vec![ZERO; n],
            weights: vec![ZERO; q * n],
            y: vec![ZERO; q],
            reduction: None,
            kept: Vec::new(),
            derivatives: vec![ZERO; wiring.planes()],
        }
    }

    /// Makes many frequencies cheap that are to be solved with these values.
    pub(super) fn prepare(&mut self, wiring: &Wiring, values: &Values) {
        self.reduction = Reduction::of(wiring, values);
    }

    /// Solves at `omega`; `leaves` are the planes of the wiring at this frequency, `ends` the unknown end values.
    pub(super) fn solve(
        &mut self,
        wiring: &Wiring,
        values: &Values,
        ends: &[f64],
        omega: f64,
        leaves: &[Complex64],
    ) -> Result<(), Singular> {
        let (s, n) = (&wiring.structure, wiring.structure.states);
        self.matrix.fill(ZERO);
        self.x.fill(ZERO);
        self.weights.fill(ZERO);
        for (i, row) in self.matrix.chunks_exact_mut(n.max(1)).enumerate() {
            row[i] = Complex64::new(0.0, omega);
        }
        for (term, a) in s.terms.iter().zip(&values.terms) {
            let (row, source) = (term.row as usize, wiring.source(term));
            let delay =
                if let Source::Delayed(d, _) = source { leaves[wiring.delay_leaf(d) as usize] } else { 1.0.into() };
            match (wiring.state(source), row.checked_sub(n)) {
                (Some(j), None) => {
                    self.matrix[row * n + j] -= a * delay;
                    self.x[row] += a * gap(wiring, (values, ends), leaves, source, j);
                }
                (Some(j), Some(o)) => self.weights[o * n + j] += a * delay,
                (None, None) => self.x[row] += a * signal(wiring, leaves, source),
                (None, Some(_)) => {}
            }
        }
        for (state, x) in self.x.iter_mut().enumerate() {
            *x -= end_term(wiring, ends, leaves, state);
        }
        if !self.solved_by_reduction(n, omega) {
            self.factor(n)?;
            self.substitute();
            self.substitute_left(n);
        }
        self.respond(wiring, (values, ends), omega, leaves);
        Ok(())
    }

    /// States and weights by the reduced matrix; where it is too close to singular nothing is changed.
    fn solved_by_reduction(&mut self, n: usize, omega: f64) -> bool {
        let Self { reduction, x, weights, kept, .. } = self;
        let Some(reduction) = reduction.as_mut() else { return false };
        if !reduction.factor(omega) {
            return false;
        }
        kept.clear();
        kept.extend(x.iter().chain(weights.iter()));
        let solved = reduction.solve(x) && weights.chunks_exact_mut(n).all(|w| reduction.solve_left(w));
        if !solved {
            x.copy_from_slice(&kept[..n]);
            weights.copy_from_slice(&kept[n..]);
        }
        solved
    }

    /// Scales rows and columns to unit size and eliminates.
    fn factor(&mut self, n: usize) -> Result<(), Singular> {
        let Self { matrix, factors, rows, columns, .. } = self;
        let size = |z: &Complex64| z.re.abs().max(z.im.abs());
        for i in 0..n {
            let row = &mut matrix[i * n..][..n];
            rows[i] = row.iter().map(size).fold(0.0, f64::max);
            row.iter_mut().for_each(|z| *z /= rows[i]);
        }
        for j in 0..n {
            columns[j] = (0..n).map(|i| size(&matrix[i * n + j])).fold(0.0, f64::max);
        }
        factors.clear();
        for (i, row) in matrix.chunks_exact(n.max(1)).enumerate() {
            row.iter().enumerate().for_each(|(j, z)| *factors.entry_mut(i, j) = z / columns[j]);
        }
        if factors.factorise(SINGULAR * n as f64) { Ok(()) } else { Err(Singular) }
    }

    fn substitute(&mut self) {
        let Self { factors, rows, columns, x, .. } = self;
        x.iter_mut().zip(&*rows).for_each(|(x, scale)| *x /= scale);
        factors.solve(x);
        x.iter_mut().zip(&*columns).for_each(|(x, scale)| *x /= scale);
    }

    fn substitute_left(&mut self, n: usize) {
        let Self { factors, rows, columns, weights, .. } = self;
        for w in weights.chunks_exact_mut(n.max(1)) {
            w.iter_mut().zip(&*columns).for_each(|(w, scale)| *w /= scale);
            factors.solve_left(w);
            w.iter_mut().zip(&*rows).for_each(|(w, scale)| *w /= scale);
        }
    }

    /// Outputs and derivatives from states and weights.
    fn respond(&mut self, wiring: &Wiring, (values, ends): (&Values, &[f64]), omega: f64, leaves: &[Complex64]) {
        let (s, n) = (&wiring.structure, wiring.structure.states);
        let Self { x, weights, y, derivatives, .. } = self;
        let of = |source: Source| match (source, wiring.state(source)) {
            (Source::Delayed(d, _), Some(j)) => {
                leaves[wiring.delay_leaf(d) as usize] * x[j] + gap(wiring, (values, ends), leaves, source, j)
            }
            (_, Some(j)) => x[j],
            _ => signal(wiring, leaves, source),
        };
        let moved = |source: Source| match (source, wiring.state(source)) {
            (Source::Delayed(d, _), Some(j)) => {
                let turned = -leaves[wiring.delay_leaf(d) as usize];
                let within = turned * Complex64::new(0.0, omega) * x[j];
                if !wiring.ended {
                    return within;
                }
                let gap = leaves[wiring.gap_leaf(d) as usize];
                within + turned * end_term(wiring, ends, leaves, j) - gap * rate_end(wiring, (values, ends), leaves, j)
            }
            (Source::Delayed(d, shown), None) if wiring.ended => leaves[wiring.moved_leaf(d, shown) as usize],
            _ => Complex64::new(0.0, -omega) * of(source),
        };
        y.fill(ZERO);
        for (term, a) in s.terms.iter().zip(&values.terms).filter(|(t, _)| t.row as usize >= n) {
            y[term.row as usize - n] += a * of(wiring.source(term));
        }
        let mut at = 0;
        for (o, row) in wiring.layout.outputs.iter().enumerate() {
            for column in &row.columns {
                let mut sum = ZERO;
                for (equation, influence) in &wiring.columns[*column as usize].influences {
                    let force = match *influence {
                        Influence::Slope(k, source) => values.slopes[k] * of(source),
                        Influence::Delay(term, k, source) => values.terms[term] * values.tau_slopes[k] * moved(source),
                        Influence::DelayedEnd(term, factor, d) => {
                            let [gap, factor] = [wiring.gap_leaf(d), wiring.factor_leaf(factor)];
                            values.terms[term] * leaves[gap as usize] * leaves[factor as usize]
                        }
                        Influence::DelayedRateEnd([seen, own], factor, d) => {
                            let [bow, factor] = [wiring.bow_leaf(d), wiring.factor_leaf(factor)];
                            values.terms[seen] * values.terms[own] * leaves[bow as usize] * leaves[factor as usize]
                        }
                        Influence::RateSlope(seen, slope, d, source) => {
                            let bow = leaves[wiring.bow_leaf(d) as usize];
                            values.terms[seen] * values.slopes[slope] * bow * end_of(wiring, ends, leaves, source)
                        }
                        Influence::End(factor) => -leaves[wiring.factor_leaf(factor) as usize],
                    };
                    match equation.checked_sub(n) {
                        None => sum += weights[o * n + equation] * force,
                        Some(output) if output == o => sum += force,
                        Some(_) => {}
                    }
                }
                derivatives[at] = sum;
                at += 1;
            }
            // the plane that is free
            derivatives[at] = ZERO;
            at += 1;
        }
    }
}

/// A state's end term.
fn end_term(wiring: &Wiring, ends: &[f64], leaves: &[Complex64], state: usize) -> Complex64 {
    let known = wiring.known_ends.iter().position(|known| *known == state);
    let known = known.map_or(ZERO, |known| leaves[wiring.end_leaf(known) as usize]);
    let own = wiring.unknown_ends.iter().zip(ends).filter(|((end, _), _)| end.state == state);
    own.fold(known, |sum, ((_, factor), z)| sum + z * leaves[wiring.factor_leaf(*factor) as usize])
}

/// The end term of a signal: that of a delayed one is that of the signal.
fn end_of(wiring: &Wiring, ends: &[f64], leaves: &[Complex64], source: Source) -> Complex64 {
    match (wiring.state(source), wiring.input(source)) {
        (Some(state), _) => end_term(wiring, ends, leaves, state),
        (None, Some(input)) => leaves[wiring.input_end_leaf(input) as usize],
        (None, None) => ZERO,
    }
}

/// The end term of the rate of a state, by its equation.
fn rate_end(wiring: &Wiring, (values, ends): (&Values, &[f64]), leaves: &[Complex64], state: usize) -> Complex64 {
    let terms = wiring.structure.terms.iter().zip(&values.terms).filter(|(t, _)| t.row as usize == state);
    terms.map(|(term, a)| a * end_of(wiring, ends, leaves, wiring.source(term))).sum()
}

/// What a delayed state has besides the turned state.
fn gap(
    wiring: &Wiring,
    (values, ends): (&Values, &[f64]),
    leaves: &[Complex64],
    source: Source,
    state: usize,
) -> Complex64 {
    match source {
        Source::Delayed(d, _) if wiring.ended => {
            let [gap, bow] = [wiring.gap_leaf(d), wiring.bow_leaf(d)].map(|leaf| leaves[leaf as usize]);
            gap * end_term(wiring, ends, leaves, state) + bow * rate_end(wiring, (values, ends), leaves, state)
        }
        _ => ZERO,
    }
}

/// An input, delayed or not.
fn signal(wiring: &Wiring, leaves: &[Complex64], source: Source) -> Complex64 {
    use fdm_grammar::graph::Signal;
    match source {
        Source::State(_) => ZERO,
        Source::Input(j, shown) => leaves[wiring.input_leaf(j, shown) as usize],
        Source::Delayed(d, shown) if wiring.ended => leaves[wiring.delayed_leaf(d, shown) as usize],
        Source::Delayed(d, shown) => match wiring.structure.delayed[d] {
            Signal::Input(j) => {
                leaves[wiring.delay_leaf(d) as usize] * leaves[wiring.input_leaf(j as usize, shown) as usize]
            }
            Signal::State(_) => ZERO,
        },
    }
}

/// `A = T H T^-1` with H a Hessenberg matrix: balanced, then turned.
#[derive(Debug, Clone, Default)]
pub(super) struct Reduction {
    n: usize,
    h: DMatrix<f64>,
    /// T and its inverse, row by row.
    to: Vec<f64>,
    from: Vec<f64>,
    /// Size of H, and rounding of j w - H.
    norm: f64,
    small: f64,
    shifted: ShiftedHessenberg,
    work: Vec<Complex64>,
}

impl Reduction {
    /// Reduces A; nothing where states are delayed in the equations, since A depends on the frequency then.
    pub(super) fn of(wiring: &Wiring, values: &Values) -> Option<Self> {
        let n = wiring.structure.states;
        let mut a = DMatrix::zeros(n, n);
        for (term, value) in wiring.structure.terms.iter().zip(&values.terms).filter(|(t, _)| (t.row as usize) < n) {
            match wiring.source(term) {
                Source::State(j) => a[(term.row as usize, j)] = *value,
                source if wiring.state(source).is_some() => return None,
                _ => {}
            }
        }
        // coefficients beyond this are left to the elimination, whose rows and columns are scaled
        if n < 2 || a.iter().any(|v| v.abs() > 1e150) {
            return None;
        }
        let scale = balancing::balance_parlett_reinsch(&mut a);
        let (q, h) = Hessenberg::new(a).unpack();
        let entries = || (0..n).flat_map(|i| (0..n).map(move |j| (i, j)));
        let to = entries().map(|(i, j)| scale[i] * q[(i, j)]).collect();
        let from = entries().map(|(i, j)| q[(j, i)] / scale[j]).collect();
        let norm = h.norm();
        Some(Self {
            n,
            h,
            to,
            from,
            norm,
            small: 0.0,
            shifted: ShiftedHessenberg::default(),
            work: vec![Complex64::ZERO; n],
        })
    }

    /// Factors j w - A; false where it is so close to singular, for the size of H, that only scaled elimination can tell.
    pub(super) fn factor(&mut self, omega: f64) -> bool {
        let small = 1e3 * f64::EPSILON * (self.norm + omega);
        self.small = 10.0 * f64::EPSILON * (self.norm + omega);
        !self.shifted.factor(&self.h, Complex64::new(0.0, omega), small)
    }

    /// x of (j w - A) x = b, in place; false where it is so large that nothing of it is right.
    pub(super) fn solve(&mut self, x: &mut [Complex64]) -> bool {
        let Self { n, to, from, shifted, work, small, .. } = self;
        multiply(from, x, work, *n);
        let before = largest(work);
        work.iter_mut().for_each(|v| *v = -*v);
        shifted.solve(work);
        multiply(to, work, x, *n);
        largest(work) * *small <= before
    }

    /// w of w (j w - A) = c, in place, as [`Self::solve`].
    pub(super) fn solve_left(&mut self, w: &mut [Complex64]) -> bool {
        let Self { n, to, from, shifted, work, small, .. } = self;
        multiply_left(w, to, work, *n);
        let before = largest(work);
        work.iter_mut().for_each(|v| *v = -v.conj());
        shifted.solve_adjoint(work);
        work.iter_mut().for_each(|v| *v = v.conj());
        multiply_left(work, from, w, *n);
        largest(work) * *small <= before
    }
}

fn largest(x: &[Complex64]) -> f64 {
    x.iter().fold(0.0, |largest, v| largest.max(v.re.abs()).max(v.im.abs()))
}

fn multiply(matrix: &[f64], x: &[Complex64], y: &mut [Complex64], n: usize) {
    for (y, row) in y.iter_mut().zip(matrix.chunks_exact(n)) {
        *y = row.iter().zip(x).fold(Complex64::ZERO, |sum, (a, x)| sum + x * a);
    }
}

fn multiply_left(x: &[Complex64], matrix: &[f64], y: &mut [Complex64], n: usize) {
    y.fill(Complex64::ZERO);
    for (x, row) in x.iter().zip(matrix.chunks_exact(n)) {
        y.iter_mut().zip(row).for_each(|(y, a)| *y += x * a);
    }
}
