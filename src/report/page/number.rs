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

/// A unit as it is typeset, with raised powers and a dot between factors; nothing of a pure number.
pub(crate) fn unit(text: &str) -> String {
    let mut set = String::new();
    let mut rest = if text == "1" { "" } else { text };
    while let Some(sign) = rest.chars().next() {
        rest = &rest[sign.len_utf8()..];
        match sign {
            '*' => set.push('·'),
            '^' => {
                let power = rest.trim_start_matches('-').trim_start_matches(|c: char| c.is_ascii_digit());
                let (whole, behind) = rest.split_at(rest.len() - power.len());
                // a broken power stays as it was written
                let part = behind.strip_prefix('/').is_some_and(|rest| rest.starts_with(|c: char| c.is_ascii_digit()));
                let raised = whole.ends_with(|c: char| c.is_ascii_digit()) && !part && !behind.starts_with('.');
                if raised {
                    set.extend(whole.chars().map(superscript));
                    rest = behind;
                } else {
                    set.push('^');
                }
            }
            sign => set.push(sign),
        }
    }
    set
}

fn superscript(sign: char) -> char {
    const DIGITS: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    sign.to_digit(10).map_or('⁻', |digit| DIGITS[digit as usize])
}

/// A unit behind a number, nothing of a pure one.
pub(crate) fn behind(unit: Option<&str>) -> String {
    unit.map(self::unit).filter(|u| !u.is_empty()).map_or(String::new(), |u| format!(" {u}"))
}

/// A unit in brackets behind a name, nothing where there is none or the number is a pure one.
pub(crate) fn bracketed(unit: Option<&str>) -> String {
    unit.map(self::unit).filter(|u| !u.is_empty()).map_or(String::new(), |u| format!(" [{u}]"))
}

/// The unit of frequency that belongs to a unit of time.
pub(crate) fn unit_of_frequency(time: &str) -> String {
    if time == "s" { "Hz".to_string() } else { format!("cycles per {time}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_typeset_and_pure_numbers_have_none() {
        let set = ["1", "rad/s^2", "1/(s^2*rad^2)", "kg*m^-1", "V^0.5", "s^(1/2)", "s^1/2", "m/s^2/kg"].map(unit);
        assert_eq!(set, ["", "rad/s²", "1/(s²·rad²)", "kg·m⁻¹", "V^0.5", "s^(1/2)", "s^1/2", "m/s²/kg"]);
        assert_eq!((bracketed(Some("1")), bracketed(Some("m/s^2"))), (String::new(), " [m/s²]".into()));
        assert_eq!(behind(Some("N*m")), " N·m");
    }
}
