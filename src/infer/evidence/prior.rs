//! What is believed of an effect before any record is seen: its amount, its sign, its kind, its place. Everything in nats.
//!
//! An amount a with standard error s is log-uniform over three decades, smoothed within its error: density `1 / (2 L sqrt(a^2 + s^2))`,
//! `L = log 1000`. In errors t = |a|/s an effect then costs `1.7 + log t` nats: 3.4 at a gain of 15 nats, 5 at 400; no unit and no scale
//! enters. Where physics knows the sign the density is twice that, times the probability `Phi(a/s)` that the record gives the sign.

use fdm_numeric::statistics::log_normal_cdf;

/// Natural logarithm of the range of an amount: three decades.
pub(crate) const DECADES: f64 = 6.907_755_278_982_137;

/// What physics knows of the sign of an amount.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Sign {
    /// Either.
    Either,
    /// Above its null: friction, a time constant.
    Positive,
}

/// Log prior density of an amount (its distance from where the effect vanishes) with this standard error.
pub(crate) fn of_amount(amount: f64, error: f64, sign: Sign) -> f64 {
    let size = amount.hypot(error).max(f64::MIN_POSITIVE);
    match sign {
        Sign::Either => -(2.0 * DECADES).ln() - size.ln(),
        Sign::Positive => -DECADES.ln() - size.ln() + log_normal_cdf(amount / error.max(f64::MIN_POSITIVE)),
    }
}

/// Log prior density of a limit, whose effect vanishes at infinity: log-uniform between nothing and all.
pub(crate) fn of_limit(value: f64, error: f64) -> f64 {
    -DECADES.ln() - value.hypot(error).max(f64::MIN_POSITIVE).ln()
}

/// Precision of a nuisance (frequency, damping, time constant) at a value: a Gaussian over the logarithm of its bounds, four deviations
/// wide; of one whose bounds have no logarithm half their distance is the deviation, and its own size where it has no bounds.
pub(crate) fn precision_of_nuisance(value: f64, lower: f64, upper: f64) -> f64 {
    let width = upper - lower;
    let deviation = if lower > 0.0 && width.is_finite() {
        value.abs() * (upper / lower).ln() / 12.0_f64.sqrt()
    } else if width.is_finite() && width > 0.0 {
        0.5 * width
    } else {
        value.abs()
    };
    1.0 / deviation.max(f64::MIN_POSITIVE.sqrt()).powi(2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_effect_costs_more_the_surer_it_is() {
        // the cost beside a likelihood of width s: log of the prior's height over the posterior's
        let cost = |t: f64| -(of_amount(t, 1.0, Sign::Either) + 0.5 * (2.0 * std::f64::consts::PI).ln());
        assert!((cost(30.0_f64.sqrt()) - 3.4).abs() < 0.1, "{}", cost(30.0_f64.sqrt()));
        assert!((cost(800.0_f64.sqrt()) - 5.0).abs() < 0.1, "{}", cost(800.0_f64.sqrt()));
        // no unit enters
        let in_thousandths = of_amount(3e-3, 1e-3, Sign::Either) + 1e-3_f64.ln();
        assert!((in_thousandths - of_amount(3.0, 1.0, Sign::Either)).abs() < 1e-12);
    }

    #[test]
    fn the_sign_of_physics_costs_its_probability() {
        let both = |a: f64| (of_amount(a, 1.0, Sign::Either), of_amount(a, 1.0, Sign::Positive));
        let (either, positive) = both(8.0);
        assert!((positive - either - 2.0_f64.ln()).abs() < 1e-9);
        let (either, positive) = both(-3.0);
        assert!((positive - either - 2.0_f64.ln() - 1.349_9e-3_f64.ln()).abs() < 1e-3);
        let (_, far) = both(-100.0);
        assert!(far < -5000.0 && far.is_finite());
    }
}
