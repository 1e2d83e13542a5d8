//! From one node to the next: `x+ = F x + G0 u0 + Gm um + G1 u1` for an input that is u0, um, u1 at the beginning, middle and
//! end of a step, with the derivatives of all coefficients ([`Jet`]), for each of a run's few lengths of a step ([`Intervals`]).
//!
//! Exactly, for inputs that are the parabola through these values: F = e^z with z = A h, and the weights of the inputs from
//! the functions phi_k(z) = sum of z^i/(i + k)!, by scaling and squaring (Higham, Functions of Matrices, 10.7.4; Skaflestad
//! and Wright, 2009). Or as the classical Runge-Kutta step does it, whose coefficients are the polynomials in z below.

use crate::simulate::steps::Grid;
use fdm_numeric::lanes::{Aligned, VECTOR, accumulate};

/// Whose recursion it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::simulate) enum Method {
    /// The solution of the differential equation.
    Exact,
    /// The classical Runge-Kutta step.
    RungeKutta,
}

/// F and the weights W with `G = h W B`, for one length of a step; with the memory for computing them.
pub(super) struct Transition {
    z: Jet,
    pub(super) flow: Jet,
    /// At the beginning, in the middle, at the end.
    pub(super) weights: [Jet; 3],
    /// phi_1 to phi_3, or powers of z.
    phi: [Jet; 3],
    spare: Jet,
}

/// Norm below which the series converges within its terms.
const SMALL: f64 = 0.5;
/// Terms of the series for phi_3: 0.5^13 3!/16! is below rounding.
const TERMS: usize = 12;

impl Transition {
    pub(super) fn new(states: usize, lanes: usize) -> Self {
        let zero = || Jet::zero(states, states, lanes);
        let three = || [zero(), zero(), zero()];
        Self { z: zero(), flow: zero(), weights: three(), phi: three(), spare: zero() }
    }

    /// Computes them for `x' = A x` and steps of length h.
    #[inline(always)]
    pub(super) fn compute(&mut self, method: Method, a: &Jet, h: f64) {
        match method {
            Method::Exact => self.exact(a, h),
            Method::RungeKutta => self.runge_kutta(a, h),
        }
    }

    #[inline(always)]
    fn exact(&mut self, a: &Jet, h: f64) {
        let norm = a.norm() * h.abs();
        // halvings beyond which nothing finite comes of it
        let halvings = if norm > SMALL { ((norm / SMALL).log2().ceil() as i32).min(1000) } else { 0 };
        self.z.scale_of(h * 0.5f64.powi(halvings), a);
        self.series();
        for _ in 0..halvings {
            self.double();
        }
        let [start, middle, end] = &mut self.weights;
        let [one, two, three] = &self.phi;
        start.scale_of(1.0, one);
        start.add(-3.0, two);
        start.add(4.0, three);
        middle.scale_of(4.0, two);
        middle.add(-8.0, three);
        end.scale_of(-1.0, two);
        end.add(4.0, three);
    }

    /// phi_3 by Horner's rule, then phi_k = z phi_{k + 1} + 1/k!.
    #[inline(always)]
    fn series(&mut self) {
        let Self { z, flow, phi: [one, two, three], spare, .. } = self;
        let factorial = |k: usize| (1..=k).map(|i| i as f64).product::<f64>();
        three.clear();
        three.add_unit(1.0 / factorial(TERMS + 3));
        for i in (0..TERMS).rev() {
            spare.product_of(z, three);
            spare.add_unit(1.0 / factorial(i + 3));
            std::mem::swap(spare, three);
        }
        two.product_of(z, three);
        two.add_unit(0.5);
        one.product_of(z, two);
        one.add_unit(1.0);
        flow.product_of(z, one);
        flow.add_unit(1.0);
    }

    /// From z to 2 z: `2^k phi_k(2z) = e^z phi_k(z) + sum over j of phi_j(z)/(k - j)!`.
    #[inline(always)]
    fn double(&mut self) {
        let Self { flow, phi: [one, two, three], spare, .. } = self;
        spare.product_of(flow, three);
        spare.add(0.5, one);
        spare.add(1.0, two);
        spare.add(1.0, three);
        three.scale_of(0.125, spare);
        spare.product_of(flow, two);
        spare.add(1.0, one);
        spare.add(1.0, two);
        two.scale_of(0.25, spare);
        spare.product_of(flow, one);
        spare.add(1.0, one);
        one.scale_of(0.5, spare);
        spare.product_of(flow, flow);
        std::mem::swap(spare, flow);
    }

    #[inline(always)]
    fn runge_kutta(&mut self, a: &Jet, h: f64) {
        self.z.scale_of(h, a);
        let Self { z, flow, weights: [start, middle, end], phi: [square, cube, fourth], .. } = self;
        square.product_of(z, z);
        cube.product_of(square, z);
        fourth.product_of(cube, z);
        let powers: [&Jet; 4] = [z, square, cube, fourth];
        polynomial(flow, 1.0, &[1.0, 1.0 / 2.0, 1.0 / 6.0, 1.0 / 24.0], powers);
        polynomial(start, 1.0 / 6.0, &[1.0 / 6.0, 1.0 / 12.0, 1.0 / 24.0], powers);
        polynomial(middle, 2.0 / 3.0, &[1.0 / 3.0, 1.0 / 12.0], powers);
        polynomial(end, 1.0 / 6.0, &[], powers);
    }
}

/// `unit I + sum of factors times powers`.
#[inline(always)]
fn polynomial(sum: &mut Jet, unit: f64, factors: &[f64], powers: [&Jet; 4]) {
    sum.clear();
    for (factor, power) in factors.iter().zip(powers) {
        sum.add(*factor, power);
    }
    sum.add_unit(unit);
}

/// A matrix and its exact derivatives.
pub(super) struct Jet {
    pub(super) rows: usize,
    pub(super) columns: usize,
    /// Lanes of each entry's derivatives, whole vectors.
    pub(super) lanes: usize,
    /// Rows by columns.
    pub(super) value: Vec<f64>,
    /// Rows by columns by lanes.
    pub(super) slope: Aligned,
}

impl Jet {
    pub(super) fn zero(rows: usize, columns: usize, lanes: usize) -> Self {
        let size = rows * columns;
        Self { rows, columns, lanes, value: vec![0.0; size], slope: Aligned::new(size * lanes) }
    }

    /// Derivatives of an entry.
    #[inline(always)]
    pub(super) fn slope_of(&self, i: usize, j: usize) -> &[f64] {
        &self.slope[(i * self.columns + j) * self.lanes..][..self.lanes]
    }

    /// Becomes zero.
    pub(super) fn clear(&mut self) {
        self.value.fill(0.0);
        self.slope.fill(0.0);
    }

    /// Becomes `factor` times another.
    #[inline(always)]
    pub(super) fn scale_of(&mut self, factor: f64, other: &Self) {
        self.clear();
        self.add(factor, other);
    }

    /// Adds `factor` times another.
    #[inline(always)]
    pub(super) fn add(&mut self, factor: f64, other: &Self) {
        self.value.iter_mut().zip(&other.value).for_each(|(s, o)| *s += factor * o);
        accumulate(factor, &other.slope, &mut self.slope);
    }

    /// Adds a multiple of the unit matrix.
    pub(super) fn add_unit(&mut self, factor: f64) {
        (0..self.rows).for_each(|i| self.value[i * self.columns + i] += factor);
    }

    /// Becomes the product `a b`, derivatives by the product rule.
    #[inline(always)]
    pub(super) fn product_of(&mut self, a: &Self, b: &Self) {
        let inner = a.columns;
        for i in 0..self.rows {
            for j in 0..self.columns {
                let mut sum = 0.0;
                for k in 0..inner {
                    sum += a.value[i * inner + k] * b.value[k * b.columns + j];
                }
                self.value[i * self.columns + j] = sum;
            }
        }
        // numbers of a matrix's derivatives that stay in the innermost cache while they are multiplied
        if self.slope.len() > 4096 { self.row_by_row(a, b) } else { self.entry_by_entry(a, b) }
    }

    /// Derivatives of few entries: each in registers.
    #[inline(always)]
    fn entry_by_entry(&mut self, a: &Self, b: &Self) {
        let (inner, lanes) = (a.columns, self.lanes);
        for i in 0..self.rows {
            for j in 0..self.columns {
                let to = &mut self.slope[(i * self.columns + j) * lanes..][..lanes];
                for (v, to) in to.as_chunks_mut::<VECTOR>().0.iter_mut().enumerate() {
                    let mut total = [0.0; VECTOR];
                    for k in 0..inner {
                        let (x, y) = (a.value[i * inner + k], b.value[k * b.columns + j]);
                        let Some(dx) = a.slope[(i * inner + k) * lanes + v * VECTOR..].first_chunk::<VECTOR>() else {
                            return;
                        };
                        let Some(dy) = b.slope[(k * b.columns + j) * lanes + v * VECTOR..].first_chunk::<VECTOR>()
                        else {
                            return;
                        };
                        for l in 0..VECTOR {
                            total[l] = y.mul_add(dx[l], total[l]);
                            total[l] = x.mul_add(dy[l], total[l]);
                        }
                    }
                    *to = total;
                }
            }
        }
    }

    /// Derivatives of many entries: a row of them stays in the cache while the other factor streams by. The same sums in the same order;
    /// zeros that are left out change none of them.
    #[inline(always)]
    fn row_by_row(&mut self, a: &Self, b: &Self) {
        let (inner, lanes, row) = (a.columns, self.lanes, self.columns * self.lanes);
        for (i, to) in self.slope.chunks_exact_mut(row).enumerate() {
            to.fill(0.0);
            for k in 0..inner {
                let (x, dx) = (a.value[i * inner + k], a.slope_of(i, k));
                let (y, dy) = (&b.value[k * b.columns..][..b.columns], &b.slope[k * row..][..row]);
                let moves = dx.iter().any(|d| *d != 0.0);
                if x == 0.0 && !moves {
                    continue;
                }
                for ((to, dy), y) in to.chunks_exact_mut(lanes).zip(dy.chunks_exact(lanes)).zip(y) {
                    if moves {
                        accumulate(*y, dx, to);
                    }
                    accumulate(x, dy, to);
                }
            }
        }
    }

    /// Largest sum of magnitudes in a column.
    pub(super) fn norm(&self) -> f64 {
        let column = |j: usize| (0..self.rows).map(|i| self.value[i * self.columns + j].abs()).sum::<f64>();
        (0..self.columns).map(column).fold(0.0, f64::max)
    }
}

/// Lengths of steps, and which one each step has.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::simulate) struct Intervals {
    /// The different lengths.
    pub(super) lengths: Vec<f64>,
    /// For each step the position of its length; empty when there is only one.
    of_step: Vec<u8>,
}

impl Intervals {
    /// Lengths that differ by the rounding of times count as one, their mean; none when there are too many.
    pub(in crate::simulate) fn of(grid: &Grid) -> Option<Self> {
        let times = grid.samples();
        let rounding = 8.0 * f64::EPSILON * times.iter().fold(0.0_f64, |m, t| m.max(t.abs()));
        // first and sum of the lengths, and how many there are
        let mut kinds: Vec<(f64, f64, usize)> = Vec::new();
        let mut of_step = Vec::with_capacity(grid.steps());
        for k in 0..grid.steps() {
            let h = grid.step(k).1;
            let kind = match kinds.iter().position(|(first, ..)| (first - h).abs() <= rounding) {
                Some(kind) => kind,
                // more different lengths than this are no sampling that recursions are worth their coefficients for
                None if kinds.len() == 16 => return None,
                None => {
                    kinds.push((h, 0.0, 0));
                    kinds.len() - 1
                }
            };
            kinds[kind].1 += h - kinds[kind].0;
            kinds[kind].2 += 1;
            of_step.push(kind as u8);
        }
        if kinds.len() <= 1 {
            of_step.clear();
        }
        let lengths = kinds.iter().map(|(first, sum, count)| first + sum / *count as f64).collect();
        Some(Self { lengths, of_step })
    }

    /// Which length a step has, and the first step behind it, at most `end`, of another length.
    #[inline(always)]
    pub(super) fn alike(&self, from: usize, end: usize) -> (usize, usize) {
        let kind = self.of_step(from);
        let mut to = from + 1;
        while to < end && self.of_step(to) == kind {
            to += 1;
        }
        (kind, to)
    }

    /// Which length a step has.
    #[inline(always)]
    pub(super) fn of_step(&self, k: usize) -> usize {
        self.of_step.get(k).map_or(0, |kind| *kind as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A 1 by 1 system with the rate itself as its parameter.
    fn scalar(rate: f64, h: f64, method: Method) -> Transition {
        let mut a = Jet::zero(1, 1, 8);
        a.value[0] = rate;
        a.slope[0] = 1.0;
        let mut transition = Transition::new(1, 8);
        transition.compute(method, &a, h);
        transition
    }

    #[test]
    fn exponential_and_weights_have_their_closed_forms() {
        for (rate, h) in [(-3.0, 0.4), (0.7, 2.5), (-40.0, 1.0), (-1e-9, 1.0)] {
            let t = scalar(rate, h, Method::Exact);
            let z: f64 = rate * h;
            assert!((t.flow.value[0] / z.exp() - 1.0).abs() < 1e-12, "{z}");
            assert!((t.flow.slope[0] / (h * z.exp()) - 1.0).abs() < 1e-12, "{z}");
            // a constant input: phi_1 = (e^z - 1)/z, and its derivative
            let sum: f64 = t.weights.iter().map(|w| w.value[0]).sum();
            let slope: f64 = t.weights.iter().map(|w| w.slope[0]).sum();
            let want = z.exp_m1() / z;
            let by_rate = if z.abs() < 1e-6 { h * (0.5 + z / 3.0) } else { h * (z.exp() - want) / z };
            assert!((sum / want - 1.0).abs() < 1e-13 && (slope / by_rate - 1.0).abs() < 1e-12, "{z} {sum} {slope}");
            // a ramp from 0 to 1: phi_2 = (e^z - 1 - z)/z^2
            let ramp = 0.5 * t.weights[1].value[0] + t.weights[2].value[0];
            let want = if z.abs() < 1e-6 { 0.5 + z / 6.0 } else { (z.exp_m1() - z) / (z * z) };
            assert!((ramp / want - 1.0).abs() < 1e-12, "{z} {ramp}");
        }
    }

    #[test]
    fn the_classical_step_is_the_start_of_the_same_series() {
        for h in [0.1, 0.05] {
            let (exact, step) = (scalar(-2.0, h, Method::Exact), scalar(-2.0, h, Method::RungeKutta));
            let z: f64 = -2.0 * h;
            assert!((exact.flow.value[0] - step.flow.value[0]).abs() < 1.1 * z.abs().powi(5) / 120.0);
            assert!((exact.weights[0].value[0] - step.weights[0].value[0]).abs() < z.abs().powi(4));
            let want = 1.0 + z + z * z / 2.0 + z * z * z / 6.0 + z * z * z * z / 24.0;
            assert!((step.flow.value[0] - want).abs() <= f64::EPSILON);
        }
    }

    #[test]
    fn a_rotation_keeps_its_length_and_its_derivative_turns_with_it() {
        let (mut a, omega, h) = (Jet::zero(2, 2, 8), 3.0, 1.7);
        a.value.copy_from_slice(&[0.0, omega, -omega, 0.0]);
        (a.slope[8], a.slope[16]) = (1.0, -1.0);
        let mut t = Transition::new(2, 8);
        t.compute(Method::Exact, &a, h);
        let (sin, cos) = (omega * h).sin_cos();
        for (got, want) in t.flow.value.iter().zip([cos, sin, -sin, cos]) {
            assert!((got - want).abs() < 1e-14);
        }
        for (k, want) in [-h * sin, h * cos, -h * cos, -h * sin].into_iter().enumerate() {
            assert!((t.flow.slope[8 * k] - want).abs() < 1e-13);
        }
    }

    #[test]
    fn rounding_of_times_is_no_difference_and_jitter_is() {
        let even: Vec<f64> = (0..5000).map(|k| k as f64 * 0.1).collect();
        let intervals = Intervals::of(&Grid::new(&even, &2.into())).expect("one length");
        assert!((intervals.lengths[0] - 0.05).abs() < 1e-14 && intervals.lengths.len() == 1);
        let rounded: Vec<f64> = (0..50).map(|k| (k as f64 * 1000.0 / 350.0).round() / 1000.0).collect();
        let intervals = Intervals::of(&Grid::new(&rounded, &1.into())).expect("two lengths");
        assert_eq!(intervals.lengths.len(), 2);
        assert!((intervals.lengths[intervals.of_step(0)] - 0.003).abs() < 1e-15);
        let uneven: Vec<f64> = (0..50).map(|k| (k * k) as f64).collect();
        assert!(Intervals::of(&Grid::new(&uneven, &1.into())).is_none());
    }
}
