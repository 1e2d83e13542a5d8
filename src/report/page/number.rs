//! Numbers as they stand on the page.

use fdm_results::documents::digits;

/// A number with so many significant digits; a dash where there is none.
pub(crate) fn shown(value: impl Into<Option<f64>>, significant: usize) -> String {
    value.into().filter(|v| v.is_finite()).map_or_else(|| "–".into(), |v| text(v, significant))
}

/// A number that is there with so many significant digits.
pub(crate) fn text(v: f64, significant: usize) -> String {
    digits(v, significant).replace('-', "\u{2212}")
}

/// A number that somebody wrote, with the digits that it needs: six at most.
pub(crate) fn written(v: f64) -> String {
    let rounded = digits(v, 6);
    let short = rounded.parse::<f64>().map_or(rounded, |v| v.to_string());
    short.replace('-', "\u{2212}")
}

/// A probability; small ones by their bound.
pub(crate) fn probability(value: impl Into<Option<f64>>) -> String {
    match value.into().filter(|p| p.is_finite()) {
        None => "–".into(),
        Some(p) if p < 0.001 => "< 0.001".into(),
        Some(p) => format!("{p:.3}"),
    }
}

/// A unit in brackets behind a name, nothing where there is none.
pub(crate) fn bracketed(unit: Option<&str>) -> String {
    unit.filter(|u| !u.is_empty()).map_or(String::new(), |u| format!(" [{u}]"))
}

/// The unit of frequency that belongs to a unit of time.
pub(crate) fn unit_of_frequency(time: &str) -> String {
    if time == "s" { "Hz".to_string() } else { format!("cycles per {time}") }
}
