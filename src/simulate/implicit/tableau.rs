//! The three-stage Radau IIA method: order 5, stage order 3, L-stable (Hairer & Wanner, Solving ordinary differential equations II,
//! IV.5 and IV.8).

/// Stages.
pub(in crate::simulate) const STAGES: usize = 3;

const SQRT_6: f64 = 2.449_489_742_783_178;

/// Where the stages stand in a step; the last one is its end.
pub(in crate::simulate) const NODES: [f64; STAGES] = [(4.0 - SQRT_6) / 10.0, (4.0 + SQRT_6) / 10.0, 1.0];

/// Inverse of the Runge-Kutta matrix A: the stage equations are solved as `A^-1 Z = h F(x + Z)`, in which a stage's Jacobian
/// stands in that stage's rows only.
pub(super) const INVERSE: [[f64; STAGES]; STAGES] = [
    [2.0 + 0.5 * SQRT_6, (29.0 * SQRT_6 - 36.0) / 30.0, (6.0 - 4.0 * SQRT_6) / 15.0],
    [-(36.0 + 29.0 * SQRT_6) / 30.0, 2.0 - 0.5 * SQRT_6, (6.0 + 4.0 * SQRT_6) / 15.0],
    [(8.0 * SQRT_6 - 3.0) / 3.0, -(3.0 + 8.0 * SQRT_6) / 3.0, 5.0],
];

/// Weights of the stages' increments for the increment that the collocation polynomial has at `part` of the step; beyond 1 it
/// extrapolates.
pub(super) fn weights(part: f64) -> [f64; STAGES] {
    let mut weights = [0.0; STAGES];
    for (i, weight) in weights.iter_mut().enumerate() {
        let others = NODES.iter().enumerate().filter(|(j, _)| *j != i);
        // the increment is zero at the beginning
        *weight = others.fold(part / NODES[i], |w, (_, c)| w * (part - c) / (NODES[i] - c));
    }
    weights
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Collocation: the matrix integrates quadratics exactly, and so its inverse differentiates cubics that begin at zero.
    #[test]
    fn the_inverse_differentiates_cubics() {
        for power in 1..=3 {
            for (row, c) in INVERSE.iter().zip(NODES) {
                let got: f64 = row.iter().zip(NODES).map(|(w, c)| w * c.powi(power)).sum();
                let slope = f64::from(power) * c.powi(power - 1);
                assert!((got - slope).abs() < 1e-14, "{power}: {got} {slope}");
            }
        }
    }

    #[test]
    fn weights_continue_cubics() {
        for part in [0.0, 0.3, 1.0, 2.5] {
            for power in 1..=3 {
                let got: f64 = weights(part).iter().zip(NODES).map(|(w, c)| w * c.powi(power)).sum();
                assert!((got - part.powi(power)).abs() < 1e-13 * part.powi(3).max(1.0), "{part} {power}: {got}");
            }
        }
    }
}
