//! Symmetric matrices with two diagonals beside the main one: second differences of values side by side.

use nalgebra::DVector;

/// Such a matrix by its lower half: a(i, i), a(i, i - 1), a(i, i - 2).
#[derive(Debug, Clone, PartialEq)]
pub struct Pentadiagonal {
    rows: Vec<[f64; 3]>,
}

/// L of a positive definite one, L L'.
#[derive(Debug, Clone, PartialEq)]
pub struct Factor {
    rows: Vec<[f64; 3]>,
}

impl Pentadiagonal {
    /// Multiples of the identity.
    pub fn diagonal(size: usize, value: f64) -> Self {
        Self { rows: vec![[value, 0.0, 0.0]; size] }
    }

    /// Adds to a(i, j) and a(j, i); |i - j| is 2 at most.
    pub fn add(&mut self, i: usize, j: usize, value: f64) {
        let (low, high) = (i.min(j), i.max(j));
        self.rows[high][high - low] += value;
    }

    /// Adds the square of a form of neighbouring values, v v'.
    pub fn add_square(&mut self, form: &[(usize, f64)], weight: f64) {
        for (n, (i, a)) in form.iter().enumerate() {
            for (j, b) in &form[..=n] {
                self.add(*i, *j, weight * a * b);
            }
        }
    }

    /// v' A v of a form v of neighbouring values.
    pub fn square(&self, form: &[(usize, f64)]) -> f64 {
        let mut sum = 0.0;
        for (n, (i, a)) in form.iter().enumerate() {
            for (j, b) in &form[..=n] {
                let (low, high) = (*i.min(j), *i.max(j));
                let own = self.rows[high][high - low] * a * b;
                sum += if i == j { own } else { 2.0 * own };
            }
        }
        sum
    }

    /// The product with a vector.
    pub fn times(&self, x: &DVector<f64>) -> DVector<f64> {
        let mut product = DVector::zeros(x.len());
        for (i, row) in self.rows.iter().enumerate() {
            product[i] += row[0] * x[i];
            for distance in 1..=i.min(2) {
                product[i] += row[distance] * x[i - distance];
                product[i - distance] += row[distance] * x[i];
            }
        }
        product
    }

    /// Its Cholesky factor; none where it is not positive definite.
    pub fn factor(&self) -> Option<Factor> {
        let mut rows: Vec<[f64; 3]> = Vec::with_capacity(self.rows.len());
        for (i, row) in self.rows.iter().enumerate() {
            let second = if i > 1 { row[2] / rows[i - 2][0] } else { 0.0 };
            let first = if i > 0 { (row[1] - second * rows[i - 1][1]) / rows[i - 1][0] } else { 0.0 };
            let square = row[0] - first * first - second * second;
            if !(square > 0.0 && square.is_finite()) {
                return None;
            }
            rows.push([square.sqrt(), first, second]);
        }
        Some(Factor { rows })
    }
}

impl Factor {
    /// Solves L y = x in its place.
    pub fn solve_lower(&self, x: &mut DVector<f64>) {
        for (i, row) in self.rows.iter().enumerate() {
            let known: f64 = (1..=i.min(2)).map(|distance| row[distance] * x[i - distance]).sum();
            x[i] = (x[i] - known) / row[0];
        }
    }

    /// Solves L' y = x in its place.
    pub fn solve_upper(&self, x: &mut DVector<f64>) {
        for i in (0..self.rows.len()).rev() {
            let near = self.rows[i + 1..].iter().take(2).enumerate();
            let known: f64 = near.map(|(n, row)| row[n + 1] * x[i + n + 1]).sum();
            x[i] = (x[i] - known) / self.rows[i][0];
        }
    }

    /// Solves L L' y = x in its place.
    pub fn solve(&self, x: &mut DVector<f64>) {
        self.solve_lower(x);
        self.solve_upper(x);
    }

    /// The inverse of L L' on the main diagonal and the two beside it, where nothing further away is needed (Takahashi, Fagan & Chin 1973).
    pub fn inverse_near(&self) -> Pentadiagonal {
        let size = self.rows.len();
        let mut rows = vec![[0.0; 3]; size];
        for i in (0..size).rev() {
            let below = |distance: usize| self.rows.get(i + distance).map_or(0.0, |row| row[distance]);
            let (one, two, own) = (below(1), below(2), self.rows[i][0]);
            // c(a, b) with a at least b, both beyond i
            let known = |rows: &[[f64; 3]], a: usize, b: usize| rows.get(a).map_or(0.0, |row| row[a - b]);
            let first = -(one * known(&rows, i + 1, i + 1) + two * known(&rows, i + 2, i + 1)) / own;
            let second = -(one * known(&rows, i + 2, i + 1) + two * known(&rows, i + 2, i + 2)) / own;
            rows[i][0] = (1.0 / own - one * first - two * second) / own;
            if i + 1 < size {
                rows[i + 1][1] = first;
            }
            if i + 2 < size {
                rows[i + 2][2] = second;
            }
        }
        Pentadiagonal { rows }
    }

    /// Half the logarithm of the determinant.
    pub fn log_root(&self) -> f64 {
        self.rows.iter().map(|row| row[0].ln()).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factors_solve_what_the_matrix_multiplies() {
        let size = 7;
        let mut matrix = Pentadiagonal::diagonal(size, 0.3);
        matrix.add_square(&[(3, -1.0), (4, 1.0)], 0.7);
        (1..size - 1).for_each(|k| matrix.add_square(&[(k - 1, 1.0), (k, -2.0), (k + 1, 1.0)], 2.0));
        let x = DVector::from_fn(size, |i, _| (i * i) as f64 - 3.0);
        let factor = matrix.factor().unwrap();
        let mut solved = matrix.times(&x);
        factor.solve(&mut solved);
        assert!((solved - &x).amax() < 1e-10);
        // the same from the full matrix, column by column
        let unit = |k: usize| DVector::from_fn(size, |i, _| f64::from(i == k));
        let full = nalgebra::DMatrix::from_columns(&(0..size).map(|k| matrix.times(&unit(k))).collect::<Vec<_>>());
        assert!((full.determinant().ln() / 2.0 - factor.log_root()).abs() < 1e-10);
        assert!((&full * &x - matrix.times(&x)).amax() < 1e-12);
        let inverse = full.clone().try_inverse().unwrap();
        let near = factor.inverse_near();
        for k in 0..size {
            for form in [
                vec![(k, 1.0)],
                vec![(k.max(1) - 1, 0.3), (k.max(1), 0.7)],
                vec![(k.max(2), -2.0), (k.max(2) - 2, 0.5)],
            ] {
                let mut v = DVector::zeros(size);
                form.iter().for_each(|(i, value)| v[*i] += value);
                let (own, expected) = (near.square(&form), (&inverse * &v).dot(&v));
                assert!((own - expected).abs() < 1e-10 * expected, "{form:?}: {own} {expected}");
            }
        }
        let mut indefinite = matrix;
        indefinite.add(2, 2, -100.0);
        assert!(indefinite.factor().is_none());
    }
}
