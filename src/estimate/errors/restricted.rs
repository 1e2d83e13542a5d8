//! The restricted likelihood of the noise of several outputs (Patterson and Thompson 1971): that of what is left of the residuals
//! when the parameters are free, so that what fitting took off is not taken for quiet.

use nalgebra::{Cholesky, DMatrix, DVector};

/// Rounds in which the scales of the outputs find each other.
const ROUNDS: usize = 8;
/// Degrees of freedom below which an output says nothing of its scale.
const LEAST_FREEDOM: f64 = 0.5;
/// Part of the information that is added so that what is not determined does no harm.
const RIDGE: f64 = 1e-12;

/// Normal equations of one output under one belief about its noise.
#[derive(Debug, Clone)]
pub(super) struct Normal {
    /// `J' C^-1 J`, p by p.
    pub(super) matrix: DMatrix<f64>,
    /// `J' C^-1 e`, p.
    pub(super) vector: DVector<f64>,
    /// `e' C^-1 e`.
    pub(super) square: f64,
    /// Logarithm of the determinant of C.
    pub(super) logarithm: f64,
}

/// What all outputs say of their noise.
pub(super) struct Restricted {
    /// For each output its samples.
    pub(super) samples: Vec<f64>,
    /// For each output its normal equations under each belief.
    pub(super) normals: Vec<Vec<Normal>>,
    /// What else determines the parameters: other runs, priors (p by p).
    pub(super) others: DMatrix<f64>,
    /// Where it pulls (p).
    pub(super) pull: DVector<f64>,
}

/// What is likely under one belief for each output.
pub(super) struct Likely {
    /// Logarithm of the restricted likelihood, but for a constant.
    pub(super) logarithm: f64,
    /// The scale of each output's noise, as a variance over the one of the fit.
    pub(super) scales: Vec<f64>,
    /// The degrees of freedom of each scale.
    pub(super) freedom: Vec<f64>,
}

impl Restricted {
    /// The likelihood where the noise of each output is the belief of this number; none where the matrices are not finite.
    pub(super) fn likely(&self, beliefs: &[usize]) -> Option<Likely> {
        let normals: Vec<&Normal> = self.normals.iter().zip(beliefs).map(|(n, b)| &n[*b]).collect();
        let mut scales = vec![1.0; normals.len()];
        let mut freedom = self.samples.clone();
        let mut logarithm = 0.0;
        for _ in 0..ROUNDS {
            let (mut matrix, mut vector) = (self.others.clone(), self.pull.clone());
            for (n, scale) in normals.iter().zip(&scales) {
                matrix += &n.matrix / *scale;
                vector += &n.vector / *scale;
            }
            let ridge = RIDGE * matrix.diagonal().amax();
            (0..matrix.nrows()).for_each(|i| matrix[(i, i)] += ridge);
            let factor = Cholesky::new(matrix)?;
            let (moved, inverse) = (factor.solve(&vector), factor.inverse());
            logarithm = factor.l_dirty().diagonal().iter().map(|d| 2.0 * d.ln()).sum();
            logarithm += moved.dot(&(&self.others * &moved)) - 2.0 * moved.dot(&self.pull);
            for (k, n) in normals.iter().enumerate() {
                let left = n.square - 2.0 * moved.dot(&n.vector) + moved.dot(&(&n.matrix * &moved));
                logarithm += n.logarithm + self.samples[k] * scales[k].ln() + left / scales[k];
                freedom[k] = (self.samples[k] - inverse.dot(&n.matrix) / scales[k]).max(LEAST_FREEDOM);
                scales[k] = (left / freedom[k]).clamp(scales[k] * 1e-3, scales[k] * 1e3).max(f64::MIN_POSITIVE);
            }
        }
        let likely = Likely { logarithm: -0.5 * logarithm, scales, freedom };
        likely.logarithm.is_finite().then_some(likely)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Normal equations of a matrix of sensitivities in white noise.
    fn normal(j: &DMatrix<f64>, e: &DVector<f64>) -> Normal {
        Normal { matrix: j.transpose() * j, vector: j.transpose() * e, square: e.dot(e), logarithm: 0.0 }
    }

    #[test]
    fn one_output_is_known_in_closed_form() {
        let j = DMatrix::from_fn(9, 2, |i, k| (i as f64 + 1.0).powi(k as i32));
        let e = DVector::from_fn(9, |i, _| (1.9 * i as f64).cos());
        let of = |scale: f64| {
            let mut n = normal(&j, &e);
            (n.matrix, n.vector, n.square) = (n.matrix / scale, n.vector / scale, n.square / scale);
            n.logarithm = 9.0 * scale.ln();
            n
        };
        let restricted = Restricted {
            samples: vec![9.0],
            normals: vec![vec![of(1.0), of(7.0)]],
            others: DMatrix::zeros(2, 2),
            pull: DVector::zeros(2),
        };
        let left = (&e - &j * (j.transpose() * &j).try_inverse().expect("regular") * j.transpose() * &e).norm_squared();
        let [one, seven] = [0, 1].map(|b| restricted.likely(&[b]).expect("finite"));
        assert!((one.scales[0] / (left / 7.0) - 1.0).abs() < 1e-9 && (one.freedom[0] - 7.0).abs() < 1e-9);
        // in units seven times as large the scale is a seventh, and nothing else is said
        assert!((seven.scales[0] * 7.0 / one.scales[0] - 1.0).abs() < 1e-9);
        assert!((seven.logarithm - one.logarithm).abs() < 1e-8, "{} {}", seven.logarithm, one.logarithm);
    }

    #[test]
    fn two_outputs_find_their_scales() {
        let j = DMatrix::from_fn(400, 1, |i, _| (0.3 * i as f64).sin());
        // quiet and loud, and a parameter that both are wrong about by 0.3
        let noise =
            |seed: f64| DVector::from_fn(400, |i, _| 2.0_f64.sqrt() * (seed * (i * i) as f64).cos() + 0.3 * j[i]);
        let (quiet, loud) = (0.1 * noise(1.1), 3.0 * noise(2.3));
        let restricted = Restricted {
            samples: vec![400.0, 400.0],
            normals: vec![vec![normal(&j, &quiet)], vec![normal(&j, &loud)]],
            others: DMatrix::zeros(1, 1),
            pull: DVector::zeros(1),
        };
        let likely = restricted.likely(&[0, 0]).expect("finite");
        assert!((likely.scales[0] / 0.01 - 1.0).abs() < 0.2 && (likely.scales[1] / 9.0 - 1.0).abs() < 0.2);
        assert!(likely.freedom[0] < 399.1 && likely.freedom[1] > 399.9, "{:?}", likely.freedom);
    }
}
