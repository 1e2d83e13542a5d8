//! Coordinates in which a chain moves: parameters without their bounds, and these in units in which they are about independent and of deviation 1.
//!
//! A parameter between two bounds is their logistic mean, one beside a single bound is at the distance of an exponential, as Stan has it; the logarithm of
//! the Jacobian belongs to the density. `u = centre + scale z` with a triangular `scale`, which is the root of a covariance.
#![allow(clippy::needless_range_loop, reason = "rows of a triangle and what they multiply are indexed alike")]

use fdm_numeric::dense::Cholesky;
use fdm_numeric::elementary::{exp, log};

/// How a parameter is freed of its bounds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Free {
    /// It has none.
    Line,
    /// `lower + e^u`
    Above(f64),
    /// `upper - e^u`
    Below(f64),
    /// `lower + (upper - lower)/(1 + e^-u)`
    Between(f64, f64),
}

/// A parameter with its derivatives by its coordinate.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Freed {
    pub(super) value: f64,
    /// By the coordinate.
    pub(super) slope: f64,
    /// Logarithm of the slope, and its derivative by the coordinate.
    pub(super) log_jacobian: f64,
    pub(super) jacobian_slope: f64,
}

impl Free {
    /// That of a parameter with these bounds.
    pub(super) fn of(lower: f64, upper: f64) -> Self {
        match (lower.is_finite(), upper.is_finite()) {
            (true, true) => Self::Between(lower, upper),
            (true, false) => Self::Above(lower),
            (false, true) => Self::Below(upper),
            (false, false) => Self::Line,
        }
    }

    pub(super) fn at(self, u: f64) -> Freed {
        match self {
            Self::Line => Freed { value: u, slope: 1.0, log_jacobian: 0.0, jacobian_slope: 0.0 },
            Self::Above(lower) => {
                let e = exp(u);
                Freed { value: lower + e, slope: e, log_jacobian: u, jacobian_slope: 1.0 }
            }
            Self::Below(upper) => {
                let e = exp(u);
                Freed { value: upper - e, slope: -e, log_jacobian: u, jacobian_slope: 1.0 }
            }
            Self::Between(lower, upper) => {
                // of the nearer end, so that nothing is lost
                let small = exp(-u.abs());
                let near = small / (1.0 + small);
                let range = upper - lower;
                let value = if u < 0.0 { lower + range * near } else { upper - range * near };
                let slope = range * near * (1.0 - near);
                let share = if u < 0.0 { near } else { 1.0 - near };
                let log_jacobian = log(range) - u.abs() - 2.0 * small.ln_1p();
                Freed { value, slope, log_jacobian, jacobian_slope: 1.0 - 2.0 * share }
            }
        }
    }

    /// The coordinate of a value; one on its bound, or nearer than a hundredth of a thousandth of the range or of its size, is moved inside.
    pub(super) fn coordinate(self, value: f64) -> f64 {
        const NEAR: f64 = 1e-5;
        let inside = |distance: f64, size: f64| distance.max(NEAR * size.max(1e-300));
        match self {
            Self::Line => value,
            Self::Above(lower) => log(inside(value - lower, value.abs().max(lower.abs()).max(1e-3))),
            Self::Below(upper) => log(inside(upper - value, value.abs().max(upper.abs()).max(1e-3))),
            Self::Between(lower, upper) => {
                let share = ((value - lower) / (upper - lower)).clamp(NEAR, 1.0 - NEAR);
                log(share / (1.0 - share))
            }
        }
    }
}

/// Where chains move: `u = centre + scale z`.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Units {
    pub(super) centre: Vec<f64>,
    /// Lower triangle (n by n, row-major).
    scale: Vec<f64>,
}

impl Units {
    /// Those of a covariance (n by n); none where it is not positive definite.
    pub(super) fn of_covariance(centre: Vec<f64>, covariance: &[f64]) -> Option<Self> {
        let n = centre.len();
        let scale = triangle(covariance, n)?;
        Some(Self { centre, scale })
    }

    /// Those of an information matrix (n by n); an unknown of which there is none has the deviation 1.
    pub(super) fn of_information(centre: Vec<f64>, information: &[f64]) -> Option<Self> {
        let n = centre.len();
        let mut matrix = information.to_vec();
        for own in (0..n).map(|k| k * n + k) {
            matrix[own] += if matrix[own] > 0.0 { 1e-9 * matrix[own] } else { 1.0 };
        }
        let mut factor = Cholesky::new(matrix, n)?;
        let mut covariance = Vec::new();
        factor.invert(&mut covariance);
        Self::of_covariance(centre, &covariance)
    }

    pub(super) fn to_u(&self, z: &[f64], u: &mut [f64]) {
        let n = z.len();
        for i in 0..n {
            let row = &self.scale[i * n..][..=i];
            u[i] = self.centre[i] + row.iter().zip(z).map(|(s, z)| s * z).sum::<f64>();
        }
    }

    /// A gradient by u becomes that by z.
    pub(super) fn pull(&self, by_u: &[f64], by_z: &mut [f64]) {
        let n = by_u.len();
        by_z.fill(0.0);
        for i in 0..n {
            let row = &self.scale[i * n..][..=i];
            by_z.iter_mut().zip(row).for_each(|(g, s)| *g += s * by_u[i]);
        }
    }

    /// Coordinates of a place.
    pub(super) fn to_z(&self, u: &[f64]) -> Vec<f64> {
        let n = u.len();
        let mut z = vec![0.0; n];
        for i in 0..n {
            let row = &self.scale[i * n..][..=i];
            let known: f64 = row[..i].iter().zip(&z).map(|(s, z)| s * z).sum();
            z[i] = (u[i] - self.centre[i] - known) / row[i];
        }
        z
    }
}

impl Units {
    /// Those in which a covariance of z (n by n) that was found here is that of independent units; none where it is not positive definite.
    pub(super) fn renewed(&self, covariance: &[f64]) -> Option<Self> {
        let n = self.centre.len();
        let own = triangle(covariance, n)?;
        let mut scale = vec![0.0; n * n];
        for i in 0..n {
            for j in 0..=i {
                scale[i * n + j] = (j..=i).map(|k| self.scale[i * n + k] * own[k * n + j]).sum();
            }
        }
        Some(Self { centre: self.centre.clone(), scale })
    }
}

/// The lower triangle whose square is a matrix; none where that is not positive definite.
fn triangle(matrix: &[f64], n: usize) -> Option<Vec<f64>> {
    let mut l = vec![0.0; n * n];
    for i in 0..n {
        for j in 0..=i {
            let sum: f64 = (0..j).map(|k| l[i * n + k] * l[j * n + k]).sum();
            let rest = matrix[i * n + j] - sum;
            if i == j {
                if !(rest > 0.0 && rest.is_finite()) {
                    return None;
                }
                l[i * n + i] = rest.sqrt();
            } else {
                l[i * n + j] = rest / l[j * n + j];
            }
        }
    }
    Some(l)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_are_left_and_come_back_with_their_derivatives() {
        for free in [Free::Line, Free::Above(-1.0), Free::Below(2.0), Free::Between(-1.0, 3.0)] {
            for u in [-8.0, -0.7, 0.3, 6.0] {
                let at = free.at(u);
                let h = 1e-6;
                let (above, below) = (free.at(u + h), free.at(u - h));
                let slope = (above.value - below.value) / (2.0 * h);
                assert!((at.slope - slope).abs() < 1e-7 * slope.abs().max(1.0), "{free:?} {u}");
                let bend = (above.log_jacobian - below.log_jacobian) / (2.0 * h);
                assert!((at.jacobian_slope - bend).abs() < 1e-7, "{free:?} {u}");
                assert!((at.log_jacobian - at.slope.abs().ln()).abs() < 1e-12, "{free:?} {u}");
                assert!((free.coordinate(at.value) - u).abs() < 1e-6, "{free:?} {u}");
            }
        }
    }

    #[test]
    fn units_go_to_and_fro() {
        let covariance = [4.0, 1.0, 0.5, 1.0, 2.0, -0.3, 0.5, -0.3, 1.0];
        let units = Units::of_covariance(vec![1.0, -2.0, 0.5], &covariance).unwrap();
        let z = [0.3, -1.2, 2.0];
        let mut u = [0.0; 3];
        units.to_u(&z, &mut u);
        units.to_z(&u).iter().zip(z).for_each(|(a, b)| assert!((a - b).abs() < 1e-14));
        // the gradient of a linear function
        let (g, mut by_z) = ([2.0, -1.0, 3.0], [0.0; 3]);
        units.pull(&g, &mut by_z);
        let of = |z: &[f64]| {
            let mut u = [0.0; 3];
            units.to_u(z, &mut u);
            u.iter().zip(g).map(|(u, g)| u * g).sum::<f64>()
        };
        for k in 0..3 {
            let mut moved = z;
            moved[k] += 1.0;
            assert!((of(&moved) - of(&z) - by_z[k]).abs() < 1e-12);
        }
    }
}
