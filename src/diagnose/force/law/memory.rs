//! Functions of a signal's past: what lags, has play, or sticks.

/// First-order lag of a time constant, in samples.
pub(super) fn lag(signal: &[f64], samples: f64) -> Vec<f64> {
    let keep = fdm_grammar::math::exp(-1.0 / samples);
    let mut value = signal.first().copied().unwrap_or_default();
    let follow = |v: &f64| {
        value = keep * value + (1.0 - keep) * v;
        value
    };
    signal.iter().map(follow).collect()
}

/// Play: follows where the signal pushes it from either side (Prandtl's operator).
pub(super) fn play(signal: &[f64], half: f64) -> Vec<f64> {
    let mut value = signal.first().copied().unwrap_or_default();
    let follow = |v: &f64| {
        value = value.max(v - half).min(v + half);
        value
    };
    signal.iter().map(follow).collect()
}

/// An elastic force that yields at a limit while its foot point moves with this speed: hysteresis that does not depend on the
/// rate (Prandtl's stop operator).
pub(super) fn stop(speed: &[f64], limit: f64) -> Vec<f64> {
    let mut value = 0.0_f64;
    let follow = |v: &f64| {
        value = (value + v).clamp(-limit, limit);
        value / limit
    };
    speed.iter().map(follow).collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::float_cmp)]
    use super::*;

    #[test]
    fn operators_do_what_their_names_say() {
        let there_and_back = [0.0, 1.0, 2.0, 1.0, 0.0, -1.0];
        assert_eq!(play(&there_and_back, 0.5), [0.0, 0.5, 1.5, 1.5, 0.5, -0.5]);
        assert_eq!(
            stop(&[1.0, 1.0, 1.0, -1.0, -1.0, -1.0, -1.0, -1.0], 2.0)[..],
            [0.5, 1.0, 1.0, 0.5, 0.0, -0.5, -1.0, -1.0]
        );
        let late = lag(&[0.0, 1.0, 1.0, 1.0, 1.0], 2.0);
        assert!((late[4] - (1.0 - (-2.0_f64).exp())).abs() < 1e-12);
    }
}
