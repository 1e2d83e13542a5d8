//! Units as loggers, laboratories and people spell them: words written out, capitals, one sign for two units. The language knows symbols alone;
//! the columns of a record are read by these.

use super::symbols;
use super::{Unit, UnitError};

/// A unit as it was spelled.
#[derive(Debug, Clone, PartialEq)]
pub struct Spelled {
    /// The unit.
    pub unit: Unit,
    /// What the spelling was taken for, where it is no symbol.
    pub taken_for: Option<String>,
}

/// Words, in small letters, and the unit that is meant by each.
static WORDS: &[(&str, &str)] = &[
    ("meter", "m"),
    ("metre", "m"),
    ("mtr", "m"),
    ("feet", "ft"),
    ("foot", "ft"),
    ("inches", "in"),
    ("mile", "mi"),
    ("second", "s"),
    ("seconds", "s"),
    ("secs", "s"),
    ("millisecond", "ms"),
    ("msec", "ms"),
    ("millis", "ms"),
    ("microsecond", "us"),
    ("usec", "us"),
    ("µsec", "us"),
    ("micros", "us"),
    ("nanosecond", "ns"),
    ("nsec", "ns"),
    ("minute", "min"),
    ("mins", "min"),
    ("hour", "h"),
    ("hrs", "h"),
    ("mps", "m/s"),
    ("fps", "ft/s"),
    ("fpm", "ft/min"),
    ("kmh", "km/h"),
    ("kph", "km/h"),
    ("kmph", "km/h"),
    ("knots", "kt"),
    ("dps", "deg/s"),
    ("rps", "rev/s"),
    ("gpm", "gal/min"),
    ("gph", "gal/h"),
    ("lpm", "L/min"),
    ("pph", "lb/h"),
    ("kilogram", "kg"),
    ("gram", "g"),
    ("mcg", "ug"),
    ("newton", "N"),
    ("pound", "lb"),
    ("pascal", "Pa"),
    ("joule", "J"),
    ("watt", "W"),
    ("hertz", "Hz"),
    ("amp", "A"),
    ("ampere", "A"),
    ("volt", "V"),
    ("ohm", "ohm"),
    ("mole", "mol"),
    ("molar", "M"),
    ("dimensionless", "1"),
    ("unitless", "1"),
    ("none", "1"),
    ("ratio", "1"),
    ("count", "1"),
    ("raw", "1"),
    ("degree", "deg"),
    ("degrees", "deg"),
    ("degs", "deg"),
    ("radian", "rad"),
    ("radians", "rad"),
    ("revolution", "rev"),
    ("kelvin", "K"),
    ("celsius", "degC"),
    ("fahrenheit", "degF"),
    ("gee", "g0"),
    ("liter", "L"),
    ("litre", "L"),
    ("gallon", "gal"),
];

/// Whole texts, in small letters without blanks, of which a part alone would say something else.
static WHOLE: &[(&str, &str)] = &[
    ("nm", "N*m"),
    ("knm", "kN*m"),
    ("mnm", "mN*m"),
    ("nms", "N*m*s"),
    ("ft-lb", "ft*lbf"),
    ("ft*lb", "ft*lbf"),
    ("ftlb", "ft*lbf"),
    ("lb-ft", "ft*lbf"),
    ("lbft", "ft*lbf"),
    ("in-lb", "in*lbf"),
    ("inlb", "in*lbf"),
    ("lb-in", "in*lbf"),
    ("u/min", "rpm"),
    ("r/min", "rpm"),
    ("revs/min", "rpm"),
    ("degc", "degC"),
    ("deg.c", "degC"),
    ("degreesc", "degC"),
    ("degreec", "degC"),
    ("c°", "degC"),
    ("°c", "degC"),
    ("degf", "degF"),
    ("deg.f", "degF"),
    ("degreesf", "degF"),
    ("f°", "degF"),
    ("°f", "degF"),
    ("%rh", "%"),
    ("rh%", "%"),
    ("inchhg", "inHg"),
    ("in.hg", "inHg"),
    ("inhg", "inHg"),
    ("mmhg", "mmHg"),
    ("ah", "A*h"),
    ("mah", "mA*h"),
    ("wh", "W*h"),
    ("mwh", "mW*h"),
    ("kwh", "kW*h"),
    ("mps2", "m/s^2"),
    ("mpss", "m/s^2"),
    ("g's", "g0"),
    ("gs", "g0"),
];

/// The unit that a word written out stands for.
pub(super) fn word(word: &str) -> Option<&'static str> {
    let lower = word.to_lowercase();
    let singular = lower.strip_suffix('s').unwrap_or(&lower);
    WORDS.iter().find(|(w, _)| *w == lower || *w == singular).map(|(_, unit)| *unit)
}

/// All words written out.
pub(super) fn words() -> impl Iterator<Item = &'static str> {
    WORDS.iter().map(|(w, _)| *w)
}

/// The unit that is meant, as text; none where nothing is known of it.
fn respelled(text: &str) -> Option<String> {
    // nautical miles or newton metres: what is wanted decides
    if text.trim() == "NM" {
        return None;
    }
    let text = text.trim().replace('º', "°").replace(" per ", "/").replace("(US)", "");
    let close: String = text.to_lowercase().chars().filter(|c| !c.is_whitespace()).collect();
    let singular = close.strip_suffix('s').unwrap_or(&close);
    if let Some((_, unit)) = WHOLE.iter().find(|(w, _)| *w == close || *w == singular) {
        return Some((*unit).into());
    }
    let (mut out, mut rest) = (String::new(), text.as_str());
    while let Some(first) = rest.chars().next() {
        let is_letter = |c: char| c.is_alphabetic() || matches!(c, '%' | '°' | '_');
        let length =
            if is_letter(first) { rest.find(|c| !is_letter(c)).unwrap_or(rest.len()) } else { first.len_utf8() };
        let (part, behind) = rest.split_at(length);
        // digits at once behind a symbol belong to it: g0
        let known = !is_letter(first) || symbols::find(part).is_some() || Unit::parse(part).is_ok();
        if known {
            out.push_str(part);
        } else {
            let other_case = || symbols::names().find(|s| s.len() > 1 && s.eq_ignore_ascii_case(part));
            let unit = word(part).or_else(other_case)?;
            out.push_str(&if unit.contains('/') { format!("({unit})") } else { unit.to_string() });
        }
        rest = behind;
    }
    Some(out)
}

/// Reads a unit as people spell it.
pub(super) fn spelled(text: &str) -> Result<Spelled, UnitError> {
    // a degree times a coulomb is not what is meant by `deg C`
    let degrees = text.trim().to_lowercase().starts_with("deg") && text.trim().contains(char::is_whitespace);
    let error = match Unit::parse(text) {
        Ok(unit) if !degrees => return Ok(Spelled { unit, taken_for: None }),
        Ok(_) => UnitError { range: 0..text.len(), message: format!("`{text}` is not a known unit"), nearest: None },
        Err(error) => error,
    };
    let known = respelled(text).and_then(|known| Some((Unit::parse(&known).ok()?, known)));
    known.map(|(unit, known)| Spelled { unit, taken_for: Some(known) }).ok_or(error)
}

/// The unit that is meant by a sign that has two meanings, where numbers are wanted in `to` and the other meaning is no such thing: `g` of an
/// acceleration or a load factor, `C` of a temperature, `lb` of a force.
pub(super) fn meant(text: &str, to: &Unit) -> Option<Spelled> {
    let same = |unit: &str| Unit::parse(unit).is_ok_and(|u| u.same_dimension(to));
    let candidates: &[&str] = match text.trim() {
        "g" | "G" | "gs" | "Gs" | "g's" | "G's" | "g0" | "gee" => &["g0", "1"],
        "C" => &["degC"],
        "F" => &["degF"],
        "lb" | "lbs" | "LBS" | "pounds" => &["lbf"],
        "kg" => &["kgf"],
        "nm" | "NM" => &["nmi", "N*m"],
        _ => return None,
    };
    let unit = candidates.iter().find(|unit| same(unit))?;
    Some(Spelled { unit: Unit::parse(unit).ok()?, taken_for: Some((*unit).into()) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_read_as_loggers_spell_them() {
        for (text, unit) in [
            ("Nm", "N*m"),
            ("RPM", "rpm"),
            ("U/min", "rpm"),
            ("knots", "kt"),
            ("KTS", "kt"),
            ("kph", "km/h"),
            ("feet", "ft"),
            ("fps", "ft/s"),
            ("fpm", "ft/min"),
            ("ft-lbs", "ft*lbf"),
            ("secs", "s"),
            ("usec", "us"),
            ("msec", "ms"),
            ("degrees", "deg"),
            ("degrees per second", "deg/s"),
            ("Degrees/Sec", "deg/s"),
            ("radians", "rad"),
            ("rad/sec", "rad/s"),
            ("meters", "m"),
            ("meters/second", "m/s"),
            ("volts", "V"),
            ("Volts", "V"),
            ("dps", "deg/s"),
            ("Deg C", "degC"),
            ("ºC", "degC"),
            ("deg F", "degF"),
            ("%RH", "%"),
            ("PSI", "psi"),
            ("mAh", "mA*h"),
            ("m/sec^2", "m/s^2"),
            ("kPA", "kPa"),
            ("in Hg", "inHg"),
            ("minutes", "min"),
            ("counts", "1"),
            ("g's", "g0"),
        ] {
            let found = spelled(text).unwrap_or_else(|e| panic!("{text}: {e}"));
            let unit = Unit::parse(unit).unwrap();
            assert!(found.unit.same_size(&unit) && found.unit.offset == unit.offset, "{text}: {:?}", found.taken_for);
        }
        assert_eq!(spelled("m/s^2").unwrap().taken_for, None);
        for text in ["furlongs", "ident", "bool", "dge"] {
            assert!(spelled(text).is_err(), "{text}");
        }
    }

    #[test]
    fn a_sign_of_two_meanings_is_read_by_what_is_wanted() {
        let read = |text, to| meant(text, &Unit::parse(to).unwrap()).and_then(|s| s.taken_for);
        assert_eq!(read("g", "m/s^2").as_deref(), Some("g0"));
        assert_eq!(read("G", "1").as_deref(), Some("1"));
        assert_eq!(read("g", "kg"), None);
        assert_eq!(read("C", "K").as_deref(), Some("degC"));
        assert_eq!(read("lb", "N").as_deref(), Some("lbf"));
    }
}
