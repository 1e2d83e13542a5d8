//! What says that a step is the minimum of its quadratic and that the end is a minimum of the cost, without asking the
//! solver: no unknown by itself may promise to lower the cost.

use crate::estimate::iteration::correction::Correction;

/// What an unknown by itself may still promise at the end (of the logarithm of the likelihood): its slope is then a
/// hundredth of its standard error.
const NEGLIGIBLE: f64 = 1e-4;
/// Noise relative to the measurement below which the rounding of the simulation is all that is left.
const NOISE_FREE: f64 = 1e-9;
/// Part of itself by which an unknown may then want to move.
const ROUNDED: f64 = 1e-6;

impl Correction<'_, '_, '_> {
    /// Whether the step in hand promises at least what every unknown promises by itself. A step that does not is no minimum,
    /// and the little it promises says nothing about convergence.
    pub(in crate::estimate) fn keeps_promise(&self) -> bool {
        let promise = self.quadratic.reduction(&self.step);
        let most = self.alone().map(|(_, _, gain)| gain).fold(0.0, f64::max);
        most <= 1.001 * promise + self.weights.rounding + 1e-9
    }

    /// Whether the cost is flat at the current estimates, which have just been linearised, in every direction that the
    /// bounds leave open: flat beside a standard error, beside the rounding of the cost, or beside the tolerance.
    pub(in crate::estimate) fn is_stationary(&self) -> bool {
        let noise_free = self.likelihood.relative_noise(&self.weights) <= NOISE_FREE;
        let tolerance = if noise_free { self.options.tolerance.max(ROUNDED) } else { self.options.tolerance };
        let least = NEGLIGIBLE.max(4.0 * self.weights.rounding);
        let flat = |(j, step, gain): (usize, f64, f64)| {
            gain <= least || (step / self.quadratic.scale[j]).abs() <= tolerance * self.values[j].abs()
        };
        self.alone().all(flat)
    }

    /// For every unknown with influence the (scaled) step down the slope that it can take by itself, and what that gains.
    fn alone(&self) -> impl Iterator<Item = (usize, f64, f64)> {
        let influential = (0..self.values.len()).filter(|j| self.quadratic.scale[*j] > 0.0);
        influential.map(|j| {
            let step = self.quadratic.rhs[j].max(self.room.down[j]).min(self.room.up[j]);
            (j, step, self.quadratic.reduction_along(j, step))
        })
    }
}

#[cfg(test)]
mod tests {
    use crate::estimate::specimen::{Normal, Sample, grid, param, problem, run};
    use crate::estimate::{Estimate, Options, estimate};

    /// y = a exp(-b x) + c
    const FALLING: Sample = |x, theta, y, d| {
        let e = (-theta[1] * x).exp();
        y[0] = theta[0] * e + theta[2];
        d.copy_from_slice(&[e, -theta[0] * x * e, 1.0]);
    };

    const STARTS: [f64; 6] = [0.0, 1e-14, 1e-4, 0.7, 8.0, 20.0];

    fn fits(mut judge: impl FnMut(&Estimate, &[f64])) {
        for k in 0..6 * 6 * 6 {
            let mut noise = Normal(k as u64);
            let data = run("r", grid(40, 3.0), 1, FALLING, &[2.0, 1.5, 0.1], |_, _| 0.05 * noise.next());
            let measured = data.measured.clone();
            let starts = [STARTS[k % 6], STARTS[k / 6 % 6], STARTS[k / 36]];
            let mut params: Vec<_> = ["a", "b", "c"].iter().zip(starts).map(|(n, v)| param(n, v)).collect();
            params.iter_mut().for_each(|p| (p.lower, p.upper) = (0.0, 20.0));
            let fit = estimate(&mut problem(params, vec![data]), &Options::default(), &mut ());
            judge(&fit.expect("a possible problem"), &measured);
        }
    }

    /// Minus the logarithm of the likelihood.
    fn cost(theta: &[f64], measured: &[f64]) -> f64 {
        let square = |(x, z): (f64, &f64)| (z - theta[0] * (-theta[1] * x).exp() - theta[2]).powi(2);
        let sum: f64 = grid(40, 3.0).into_iter().zip(measured).map(square).sum();
        0.5 * measured.len() as f64 * sum.ln()
    }

    /// No parameter by itself, moved inside its bounds by a part of its size or of its influence, lowers the cost.
    fn flat(fit: &Estimate, measured: &[f64]) -> bool {
        let values: Vec<f64> = fit.parameters.iter().map(|p| p.value).collect();
        let least = cost(&values, measured);
        let moves = [1e-3, 1e-4, 1e-5].into_iter().flat_map(|h| [h, -h]);
        moves.flat_map(|h| (0..3).map(move |j| (j, h))).all(|(j, h)| {
            let mut near = values.clone();
            near[j] = (near[j] + h).clamp(0.0, 20.0);
            cost(&near, measured) >= least - 1e-4
        })
    }

    #[test]
    fn what_converged_is_a_minimum_wherever_it_started() {
        let mut good = 0;
        fits(|fit, measured| {
            if fit.termination.is_good() {
                good += 1;
                assert!(flat(fit, measured), "{:?} at {:?}", fit.termination, fit.parameters);
            }
        });
        assert!(good > 200, "{good} of 216");
    }
}
