//! Numbers as people read them, in tables and on the page.

/// A number with this many significant digits, as a decimal where that is short.
pub fn digits(v: f64, significant: usize) -> String {
    if v.is_nan() {
        return "not determined".into();
    }
    if v == 0.0 || !v.is_finite() {
        // a zero below zero is none
        return format!("{}", v + 0.0);
    }
    let rounded = format!("{v:.*e}", significant.max(1) - 1);
    let exponent: i32 = rounded.split('e').nth(1).and_then(|e| e.parse().ok()).unwrap_or(0);
    if !(-4..7).contains(&exponent) {
        return rounded;
    }
    let decimals = (significant as i32 - 1 - exponent).max(0) as usize;
    format!("{v:.decimals$}")
}

/// A measure with so many decimals, `-` where it has no value; from a thousand on, as where a response is lost, with four significant digits.
pub fn fixed(value: Option<f64>, decimals: usize) -> String {
    match value.filter(|v| v.is_finite()) {
        None => "-".into(),
        Some(v) if v.abs() < 1000.0 => format!("{v:.decimals$}"),
        Some(v) => digits(v, 4),
    }
}

/// A probability of chance as sentences say it. What is too small for a number is told by a bound, and never as nothing.
pub fn p_value(p: f64) -> String {
    match p {
        p if p >= 1e-3 => format!("p = {p:.3}"),
        p if p >= 1e-300 => format!("p = {p:.0e}"),
        _ => "p < 1e-300".into(),
    }
}

/// Significant digits of a value that show two of its error: between `least` and 12; none without an error, or for a value of zero.
pub fn digits_by_error(value: f64, error: f64, least: usize) -> Option<usize> {
    let ratio = (value / error).abs();
    (ratio.is_finite() && ratio > 0.0)
        .then(|| ((ratio.log10().floor() as i64).saturating_add(3)).clamp(least as i64, 12) as usize)
}

/// The end of an interval, to the third digit of the error beside it: both ends stop at the same place.
pub fn digits_of_end(end: f64, error: f64) -> String {
    let places = end.abs().log10().floor() - error.log10().floor();
    // of an end at zero, or without an error
    if !places.is_finite() {
        return digits(end, 4);
    }
    digits(end, (places + 3.0).clamp(1.0, 12.0) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_number_is_not_printed_as_one() {
        assert_eq!(digits(f64::NAN, 3), "not determined");
        assert_eq!(digits(-0.0, 3), "0");
    }

    #[test]
    fn measures_have_their_decimals_until_they_are_lost() {
        let shown = [Some(0.99954), Some(-59.01239), Some(-2.056_457e72), Some(f64::NAN), None].map(|v| fixed(v, 4));
        assert_eq!(shown, ["0.9995", "-59.0124", "-2.056e72", "-", "-"]);
    }

    #[test]
    fn no_probability_is_nothing() {
        let said = [0.0516, 4e-4, 5e-46, 0.0].map(p_value);
        assert_eq!(said, ["p = 0.052", "p = 4e-4", "p = 5e-46", "p < 1e-300"]);
    }

    #[test]
    fn numbers_have_the_digits_that_are_asked_for() {
        let shown: Vec<String> = [(6.054_928, 5), (1.5e-7, 3), (123_456.7, 3), (-0.02, 2), (9.999_96, 5), (0.0, 3)]
            .iter()
            .map(|(v, n)| digits(*v, *n))
            .collect();
        assert_eq!(shown, ["6.0549", "1.50e-7", "123457", "-0.020", "10.000", "0"]);
    }

    #[test]
    fn both_ends_of_an_interval_stop_at_the_same_digit() {
        let shown = [(-0.000_472, 0.00189), (0.006_89, 0.00189), (12.3456, 0.189), (0.0, 0.1)];
        assert_eq!(shown.map(|(end, error)| digits_of_end(end, error)), ["-0.00047", "0.00689", "12.346", "0"]);
    }

    #[test]
    fn an_error_tells_how_many_digits_count() {
        assert_eq!([0.1, 5.0, 1e-20].map(|e| digits_by_error(1.0, e, 3)), [Some(4), Some(3), Some(12)]);
        assert_eq!([(1.0, 0.0), (0.0, 1.0), (1.0, f64::NAN)].map(|(v, e)| digits_by_error(v, e, 3)), [None; 3]);
    }
}
