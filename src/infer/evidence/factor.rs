//! A symmetric matrix whose unknowns have any units, as a factor.

use fdm_numeric::dense::cholesky::Cholesky;

/// Part of its diagonal that is added to a matrix: what is not determined stays finite.
const RIDGE: f64 = 1e-10;
/// How much more where rounding has made a matrix indefinite, and how much is too much.
const MORE: f64 = 1e3;
const TOO_MUCH: f64 = 1e-3;

/// The factor of a matrix after its diagonal was brought to one.
#[derive(Debug, Clone, Default)]
pub(crate) struct Factor {
    scale: Vec<f64>,
    scaled: Vec<f64>,
    with: Vec<f64>,
    factor: Cholesky,
    log_root: f64,
}

impl Factor {
    /// Of a matrix (rows of `stride`, of which the first `size` by `size` are meant); false where it is not finite.
    pub(crate) fn renew(&mut self, matrix: &[f64], size: usize, stride: usize) -> bool {
        self.scale.clear();
        self.scale.extend((0..size).map(|j| matrix[j * stride + j].max(f64::MIN_POSITIVE).sqrt()));
        self.scaled.clear();
        for i in 0..size {
            let row = matrix[i * stride..][..size].iter().zip(&self.scale);
            self.scaled.extend(row.map(|(v, scale)| v / (scale * self.scale[i])));
            self.scaled[i * size + i] = 1.0;
        }
        let mut ridge = RIDGE;
        while ridge < TOO_MUCH {
            self.with.clone_from(&self.scaled);
            (0..size).for_each(|i| self.with[i * size + i] += ridge);
            if self.factor.renew(&self.with, size) {
                self.log_root = self.factor.log_root() + self.scale.iter().map(|s| s.ln()).sum::<f64>();
                return self.log_root.is_finite();
            }
            ridge *= MORE;
        }
        false
    }

    /// Half the logarithm of the determinant.
    pub(crate) fn log_root(&self) -> f64 {
        self.log_root
    }

    /// Replaces b by the solution of A x = b.
    pub(crate) fn solve(&self, b: &mut [f64]) {
        b.iter_mut().zip(&self.scale).for_each(|(b, scale)| *b /= scale);
        self.factor.solve(b);
        b.iter_mut().zip(&self.scale).for_each(|(b, scale)| *b /= scale);
    }

    /// Replaces b by `L^-1 b`, `L L' = A`: products of two such vectors are those of `b' A^-1 c`.
    pub(crate) fn whiten(&self, b: &mut [f64]) {
        b.iter_mut().zip(&self.scale).for_each(|(b, scale)| *b /= scale);
        self.factor.forward(b);
    }

    /// Writes the inverse (size by size).
    pub(crate) fn invert(&mut self, inverse: &mut Vec<f64>) {
        self.factor.invert(inverse);
        let size = self.scale.len();
        for (i, row) in inverse.chunks_exact_mut(size.max(1)).enumerate() {
            row.iter_mut().zip(&self.scale).for_each(|(v, scale)| *v /= scale * self.scale[i]);
        }
    }
}
