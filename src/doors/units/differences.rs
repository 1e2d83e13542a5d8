//! Derivatives from values: differences of five values around a point ([`Stencil`]).

/// Which values a difference is made of: places in steps from the point, and their weights over the step.
pub(crate) struct Stencil {
    places: &'static [f64],
    weights: &'static [f64],
    step: f64,
}

/// Of fourth order; Abramowitz and Stegun (1972), table 25.2.
const CENTRAL: (&[f64], &[f64]) = (&[-2.0, -1.0, 1.0, 2.0], &[1.0 / 12.0, -2.0 / 3.0, 2.0 / 3.0, -1.0 / 12.0]);
const FORWARD: (&[f64], &[f64]) = (&[0.0, 1.0, 2.0, 3.0, 4.0], &[-25.0 / 12.0, 4.0, -3.0, 4.0 / 3.0, -1.0 / 4.0]);

impl Stencil {
    /// Around `at`, within bounds where there are any; steps become powers of two, so that they are exact.
    pub(crate) fn new(at: f64, step: f64, (lower, upper): (f64, f64)) -> Self {
        let step = step.abs().max(f64::MIN_POSITIVE).log2().round().exp2();
        if at - 2.0 * step >= lower && at + 2.0 * step <= upper {
            return Self { places: CENTRAL.0, weights: CENTRAL.1, step };
        }
        // away from the bound that is near, as far as there is room
        let (room, side) = if upper - at >= at - lower { (upper - at, 1.0) } else { (at - lower, -1.0) };
        let least = step.min((room / 4.0).max(f64::MIN_POSITIVE));
        Self { places: FORWARD.0, weights: FORWARD.1, step: side * least }
    }

    /// The derivative of several functions at once; `value` writes them for the argument that it is given.
    pub(crate) fn derivative(&self, at: f64, out: &mut [f64], mut value: impl FnMut(f64, &mut [f64])) {
        let mut values = vec![0.0; out.len()];
        out.fill(0.0);
        for (place, weight) in self.places.iter().zip(self.weights) {
            value(at + place * self.step, &mut values);
            out.iter_mut().zip(&values).for_each(|(o, v)| *o += weight * v);
        }
        out.iter_mut().for_each(|o| *o /= self.step);
    }
}

#[cfg(test)]
mod tests {
    use super::Stencil;

    fn of(at: f64, step: f64, bounds: (f64, f64), f: impl Fn(f64) -> f64) -> f64 {
        let mut out = [0.0];
        Stencil::new(at, step, bounds).derivative(at, &mut out, |x, values| {
            assert!(x >= bounds.0 && x <= bounds.1, "{x}");
            values[0] = f(x);
        });
        out[0]
    }

    #[test]
    fn differences_are_exact_for_polynomials_of_fourth_degree() {
        let all = (f64::NEG_INFINITY, f64::INFINITY);
        for bounds in [all, (1.5, f64::INFINITY), (0.0, 1.5), (1.5, 1.6)] {
            let d = of(1.5, 1e-2, bounds, |x| x.powi(4) - 3.0 * x);
            assert!((d - (4.0 * 1.5_f64.powi(3) - 3.0)).abs() < 1e-11, "{bounds:?} {d}");
        }
        assert!((of(0.3, 1e-3, all, f64::sin) - 0.3_f64.cos()).abs() < 1e-12);
    }
}
