//! Cholesky factors of small symmetric matrices, row-major.
//!
//! The factor is kept as the upper triangle U of U'U, so that all inner loops run along rows. Sums are taken in the order of a
//! textbook's dot products, several of them side by side.

/// The factor of a positive definite matrix.
#[derive(Debug, Clone, Default)]
pub struct Cholesky {
    size: usize,
    /// U, rows by columns; what is below the diagonal is not meant.
    upper: Vec<f64>,
    sums: Vec<f64>,
}

impl Cholesky {
    /// The factor of a matrix (n by n, its upper triangle); none when it is not positive definite.
    pub fn new(matrix: Vec<f64>, n: usize) -> Option<Self> {
        let mut factor = Self { size: n, upper: matrix, sums: Vec::new() };
        factor.decompose().then_some(factor)
    }

    /// The same in the memory of this one, which is of no use when the matrix is not positive definite: false then.
    pub fn renew(&mut self, matrix: &[f64], n: usize) -> bool {
        self.size = n;
        self.upper.clear();
        self.upper.extend_from_slice(matrix);
        self.decompose()
    }

    fn decompose(&mut self) -> bool {
        let Self { size: n, upper, sums } = self;
        let n = *n;
        sums.resize(n, 0.0);
        for j in 0..n {
            let (above, rest) = upper.split_at_mut(j * n);
            sums[j..].fill(0.0);
            for row in above.chunks_exact(n) {
                let factor = row[j];
                sums[j..].iter_mut().zip(&row[j..]).for_each(|(sum, u)| *sum += factor * u);
            }
            let row = &mut rest[j..n];
            row.iter_mut().zip(&sums[j..]).for_each(|(u, sum)| *u -= sum);
            let square = row[0];
            if square.is_nan() || square <= 0.0 {
                return false;
            }
            let pivot = square.sqrt();
            row[0] = pivot;
            row[1..].iter_mut().for_each(|u| *u /= pivot);
        }
        true
    }

    /// Replaces b by the solution of U'U x = b.
    pub fn solve(&self, x: &mut [f64]) {
        let n = self.size;
        for i in 0..n {
            let sum: f64 = (0..i).map(|k| self.upper[k * n + i] * x[k]).sum();
            x[i] = (x[i] - sum) / self.upper[i * n + i];
        }
        for i in (0..n).rev() {
            let row = &self.upper[i * n..][..n];
            let sum: f64 = row[i + 1..].iter().zip(&x[i + 1..]).map(|(u, x)| u * x).sum();
            x[i] = (x[i] - sum) / row[i];
        }
    }

    /// Writes the inverse (n by n) to `inverse`; all columns are solved for at once.
    pub fn invert(&mut self, inverse: &mut Vec<f64>) {
        let Self { size: n, upper, sums } = self;
        let n = *n;
        inverse.clear();
        inverse.resize(n * n, 0.0);
        for i in 0..n {
            // columns from i + 1 on begin below
            let (above, rest) = inverse.split_at_mut(i * n);
            sums[..=i].fill(0.0);
            for (k, row) in above.chunks_exact(n).enumerate() {
                let factor = upper[k * n + i];
                sums[..=k].iter_mut().zip(row).for_each(|(sum, x)| *sum += factor * x);
            }
            let row = &mut rest[..=i];
            row[i] = 1.0;
            let pivot = upper[i * n + i];
            row.iter_mut().zip(&*sums).for_each(|(x, sum)| *x = (*x - sum) / pivot);
        }
        for i in (0..n).rev() {
            let (before, below) = inverse.split_at_mut((i + 1) * n);
            let row = &mut before[i * n..];
            sums.fill(0.0);
            for (factor, other) in upper[i * n + i + 1..(i + 1) * n].iter().zip(below.chunks_exact(n)) {
                sums.iter_mut().zip(other).for_each(|(sum, x)| *sum += factor * x);
            }
            let pivot = upper[i * n + i];
            row.iter_mut().zip(&*sums).for_each(|(x, sum)| *x = (*x - sum) / pivot);
        }
        for i in 0..n {
            for j in 0..i {
                let mean = 0.5 * (inverse[i * n + j] + inverse[j * n + i]);
                (inverse[i * n + j], inverse[j * n + i]) = (mean, mean);
            }
        }
    }
}

/// Largest sum of magnitudes of a row.
pub fn norm(matrix: &[f64], n: usize) -> f64 {
    matrix.chunks(n).map(|row| row.iter().map(|v| v.abs()).sum()).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factors_solve_and_invert() {
        for n in 1..9 {
            let entry =
                |i: usize, j: usize| ((i * 7 + j * 7 + i * j) % 5) as f64 * 0.2 + if i == j { 4.0 } else { 0.0 };
            let matrix: Vec<f64> = (0..n * n).map(|k| entry(k / n, k % n)).collect();
            let mut factor = Cholesky::new(matrix.clone(), n).expect("positive definite");
            let mut inverse = vec![f64::NAN; 3];
            factor.invert(&mut inverse);
            for i in 0..n {
                let mut column: Vec<f64> = (0..n).map(|j| matrix[j * n + i]).collect();
                factor.solve(&mut column);
                for j in 0..n {
                    let unit = if i == j { 1.0 } else { 0.0 };
                    let product: f64 = (0..n).map(|k| inverse[i * n + k] * matrix[k * n + j]).sum();
                    assert!((column[j] - unit).abs() < 1e-14 && (product - unit).abs() < 1e-14, "{n} {i} {j}");
                }
            }
        }
        assert!(Cholesky::new(vec![1.0, 2.0, 2.0, 1.0], 2).is_none());
        assert!(Cholesky::new(vec![f64::NAN], 1).is_none());
    }
}
