//! How large an effect must be for a gain in log-likelihood that was asked for.

/// The size at which `gain`, which grows with the size, is `target`; found on a logarithmic scale by steps as if the gain were
/// quadratic, then between what is too small and what is too large. `gain` gives nothing where the model no longer
/// responds. Nothing where the target is not reached.
pub(crate) fn size_for(target: f64, begin: f64, mut gain: impl FnMut(f64) -> Option<f64>) -> Option<f64> {
    let (mut small, mut large): (Option<f64>, Option<f64>) = (None, None);
    let mut size = begin;
    for _ in 0..24 {
        let found = gain(size);
        match found {
            Some(g) if (g / target).ln().abs() < 0.05 => return Some(size),
            Some(g) if g < target => small = Some(size),
            _ => large = Some(size),
        }
        let guess = match found {
            Some(g) if g > 1e-12 * target => size * (target / g).sqrt().clamp(1.0 / 30.0, 30.0),
            Some(_) => size * 10.0,
            None => size / 5.0,
        };
        size = match (small, large) {
            (Some(a), Some(b)) if !(guess > a.min(b) * 1.0001 && guess < a.max(b) * 0.9999) => (a * b).sqrt(),
            (Some(a), Some(b)) if (b / a).ln().abs() < 1e-6 => return None,
            _ => guess,
        };
        if !(1e-14..1e14).contains(&size) {
            return None;
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quadratic_saturating_and_bounded_gains_are_met() {
        let near = |size: Option<f64>, want: f64| assert!((size.unwrap() / want - 1.0).abs() < 0.05, "{size:?} {want}");
        near(size_for(50.0, 1.0, |s| Some(2.0 * s * s)), 5.0);
        near(size_for(50.0, 1e-6, |s| Some(100.0 * s.powi(4) / (1.0 + s.powi(4)))), 1.0);
        // nothing below a threshold, no response above a limit
        near(size_for(20.0, 0.01, |s| (s < 8.0).then(|| 5.0 * (s - 1.0).max(0.0))), 5.0);
        assert_eq!(size_for(20.0, 0.01, |s| (s < 4.0).then(|| 5.0 * (s - 1.0).max(0.0))), None);
    }
}
