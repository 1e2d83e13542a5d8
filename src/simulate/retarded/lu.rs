//! A small dense system of linear equations, factored once and solved for many right-hand sides in lanes.

use super::super::vectors::accumulate;

/// L U = P A with rows exchanged for the largest pivot.
#[derive(Debug, Clone, Default)]
pub(super) struct Lu {
    size: usize,
    /// Row by row; after [`Lu::factor`] the multipliers below the diagonal, U on and above it.
    pub(super) a: Vec<f64>,
    /// The row that was exchanged with row k at step k.
    exchange: Vec<usize>,
}

impl Lu {
    /// Room for `size` equations; allocates only when it must grow.
    pub(super) fn resize(&mut self, size: usize) {
        self.size = size;
        self.a.resize(size * size, 0.0);
        self.exchange.resize(size, 0);
    }

    /// Factors what stands in `a`; a singular matrix gives solutions that are not finite.
    pub(super) fn factor(&mut self) {
        let n = self.size;
        for k in 0..n {
            let size = |row: usize| self.a[row * n + k].abs();
            let pivot = (k + 1..n).fold(k, |best, row| if size(row) > size(best) { row } else { best });
            self.exchange[k] = pivot;
            for column in 0..n {
                self.a.swap(k * n + column, pivot * n + column);
            }
            for row in k + 1..n {
                let factor = self.a[row * n + k] / self.a[k * n + k];
                self.a[row * n + k] = factor;
                for column in k + 1..n {
                    self.a[row * n + column] -= factor * self.a[k * n + column];
                }
            }
        }
    }

    /// Solves for one right-hand side in place.
    pub(super) fn solve(&self, b: &mut [f64]) {
        let n = self.size;
        self.exchange.iter().enumerate().for_each(|(k, pivot)| b.swap(k, *pivot));
        for row in 1..n {
            b[row] -= (0..row).map(|k| self.a[row * n + k] * b[k]).sum::<f64>();
        }
        for row in (0..n).rev() {
            let rest = (row + 1..n).map(|k| self.a[row * n + k] * b[k]).sum::<f64>();
            b[row] = (b[row] - rest) / self.a[row * n + row];
        }
    }

    /// Solves for as many right-hand sides as there are lanes, in place (`size` rows of `lanes`).
    #[inline(always)]
    pub(super) fn solve_lanes(&self, b: &mut [f64], lanes: usize) {
        let n = self.size;
        for (k, pivot) in self.exchange.iter().enumerate().filter(|(k, pivot)| k != *pivot) {
            let (upper, lower) = b.split_at_mut(pivot * lanes);
            upper[k * lanes..][..lanes].swap_with_slice(&mut lower[..lanes]);
        }
        for row in 1..n {
            let (above, rest) = b.split_at_mut(row * lanes);
            for k in 0..row {
                accumulate(-self.a[row * n + k], &above[k * lanes..][..lanes], &mut rest[..lanes]);
            }
        }
        for row in (0..n).rev() {
            let (above, below) = b.split_at_mut((row + 1) * lanes);
            let own = &mut above[row * lanes..];
            for k in row + 1..n {
                accumulate(-self.a[row * n + k], &below[(k - row - 1) * lanes..][..lanes], own);
            }
            own.iter_mut().for_each(|v| *v /= self.a[row * n + row]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solutions_solve_the_equations_one_by_one_and_in_lanes() {
        let a = [0.0, 2.0, 1.0, 1.0, -1.0, 3.0, 4.0, 0.5, 0.0];
        let mut lu = Lu::default();
        lu.resize(3);
        lu.a.copy_from_slice(&a);
        lu.factor();
        let mut lanes: Vec<f64> = (0..24).map(|k| f64::from(k).sin()).collect();
        let right = lanes.clone();
        lu.solve_lanes(&mut lanes, 8);
        for lane in 0..8 {
            let mut one: Vec<f64> = (0..3).map(|row| right[row * 8 + lane]).collect();
            lu.solve(&mut one);
            for row in 0..3 {
                let product: f64 = (0..3).map(|k| a[row * 3 + k] * one[k]).sum();
                assert!((product - right[row * 8 + lane]).abs() < 1e-14);
                assert!((one[row] - lanes[row * 8 + lane]).abs() < 1e-14);
            }
        }
    }
}
