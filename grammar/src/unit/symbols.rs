//! THE table of unit symbols and prefixes.

use super::spelled;

/// What a row of the table says: symbol, size in SI units, dimension, value of its zero, whether it takes prefixes.
struct Row {
    name: &'static str,
    factor: f64,
    dimension: [i8; 7],
    offset: f64,
    prefixed: bool,
}

/// A symbol of the table with its prefix.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Symbol {
    prefix: Option<u8>,
    row: u8,
}

/// Standard gravity in m/s^2.
const GRAVITY: f64 = 9.80665;
const INCH: f64 = 0.0254;
const FOOT: f64 = 0.3048;
const POUND: f64 = 0.45359237;
const DEGREE: f64 = std::f64::consts::PI / 180.0;
const TURN: f64 = 2.0 * std::f64::consts::PI;

const NUMBER: [i8; 7] = [0; 7];
const LENGTH: [i8; 7] = [1, 0, 0, 0, 0, 0, 0];
const MASS: [i8; 7] = [0, 1, 0, 0, 0, 0, 0];
const TIME: [i8; 7] = [0, 0, 1, 0, 0, 0, 0];
const RATE: [i8; 7] = [0, 0, -1, 0, 0, 0, 0];
const CURRENT: [i8; 7] = [0, 0, 0, 1, 0, 0, 0];
const TEMPERATURE: [i8; 7] = [0, 0, 0, 0, 1, 0, 0];
const AMOUNT: [i8; 7] = [0, 0, 0, 0, 0, 1, 0];
const SPEED: [i8; 7] = [1, 0, -1, 0, 0, 0, 0];
const ACCELERATION: [i8; 7] = [1, 0, -2, 0, 0, 0, 0];
const VOLUME: [i8; 7] = [3, 0, 0, 0, 0, 0, 0];
const FORCE: [i8; 7] = [1, 1, -2, 0, 0, 0, 0];
const ENERGY: [i8; 7] = [2, 1, -2, 0, 0, 0, 0];
const POWER: [i8; 7] = [2, 1, -3, 0, 0, 0, 0];
const PRESSURE: [i8; 7] = [-1, 1, -2, 0, 0, 0, 0];

const fn plain(name: &'static str, factor: f64, dimension: [i8; 7]) -> Row {
    Row { name, factor, dimension, offset: 0.0, prefixed: false }
}

const fn si(name: &'static str, factor: f64, dimension: [i8; 7]) -> Row {
    Row { name, factor, dimension, offset: 0.0, prefixed: true }
}

const fn scale(name: &'static str, factor: f64, offset: f64) -> Row {
    Row { name, factor, dimension: TEMPERATURE, offset, prefixed: false }
}

/// Rows with a symbol of their own come before prefixed ones: `min`, `kt`, `cd` are no milli-inch, kilotonne, centiday.
static ROWS: &[Row] = &[
    // angles and ratios
    si("rad", 1.0, NUMBER),
    plain("deg", DEGREE, NUMBER),
    plain("°", DEGREE, NUMBER),
    plain("arcmin", DEGREE / 60.0, NUMBER),
    plain("arcsec", DEGREE / 3600.0, NUMBER),
    plain("rev", TURN, NUMBER),
    plain("grad", DEGREE * 0.9, NUMBER),
    si("sr", 1.0, NUMBER),
    plain("%", 0.01, NUMBER),
    plain("percent", 0.01, NUMBER),
    plain("ppm", 1e-6, NUMBER),
    // length, area, volume
    si("m", 1.0, LENGTH),
    plain("ft", FOOT, LENGTH),
    plain("in", INCH, LENGTH),
    plain("inch", INCH, LENGTH),
    plain("yd", 0.9144, LENGTH),
    plain("mi", 1609.344, LENGTH),
    plain("nmi", 1852.0, LENGTH),
    plain("ha", 1e4, [2, 0, 0, 0, 0, 0, 0]),
    si("L", 1e-3, VOLUME),
    si("l", 1e-3, VOLUME),
    plain("cc", 1e-6, VOLUME),
    plain("gal", 231.0 * INCH * INCH * INCH, VOLUME),
    // mass
    si("g", 1e-3, MASS),
    plain("t", 1e3, MASS),
    plain("lb", POUND, MASS),
    plain("lbm", POUND, MASS),
    plain("oz", POUND / 16.0, MASS),
    plain("slug", POUND * GRAVITY / FOOT, MASS),
    // time and rates
    si("s", 1.0, TIME),
    plain("sec", 1.0, TIME),
    plain("min", 60.0, TIME),
    plain("h", 3600.0, TIME),
    plain("hr", 3600.0, TIME),
    plain("day", 86400.0, TIME),
    plain("d", 86400.0, TIME),
    si("Hz", 1.0, RATE),
    plain("rpm", TURN / 60.0, RATE),
    // speed and acceleration
    plain("kn", 1852.0 / 3600.0, SPEED),
    plain("kt", 1852.0 / 3600.0, SPEED),
    plain("kts", 1852.0 / 3600.0, SPEED),
    plain("knot", 1852.0 / 3600.0, SPEED),
    plain("mph", 1609.344 / 3600.0, SPEED),
    plain("g0", GRAVITY, ACCELERATION),
    // force, energy, power, pressure
    si("N", 1.0, FORCE),
    plain("lbf", POUND * GRAVITY, FORCE),
    plain("kgf", GRAVITY, FORCE),
    si("J", 1.0, ENERGY),
    si("cal", 4.184, ENERGY),
    plain("BTU", 1_055.055_852_62, ENERGY),
    si("eV", 1.602_176_634e-19, ENERGY),
    si("W", 1.0, POWER),
    plain("hp", 550.0 * FOOT * POUND * GRAVITY, POWER),
    si("Pa", 1.0, PRESSURE),
    si("bar", 1e5, PRESSURE),
    plain("psi", POUND * GRAVITY / (INCH * INCH), PRESSURE),
    plain("psf", POUND * GRAVITY / (FOOT * FOOT), PRESSURE),
    plain("atm", 101_325.0, PRESSURE),
    plain("torr", 101_325.0 / 760.0, PRESSURE),
    plain("mmHg", 133.322_387_415, PRESSURE),
    plain("inHg", 3_386.388_640_341, PRESSURE),
    // electricity and light
    si("A", 1.0, CURRENT),
    si("C", 1.0, [0, 0, 1, 1, 0, 0, 0]),
    si("V", 1.0, [2, 1, -3, -1, 0, 0, 0]),
    si("ohm", 1.0, [2, 1, -3, -2, 0, 0, 0]),
    si("Ω", 1.0, [2, 1, -3, -2, 0, 0, 0]),
    si("S", 1.0, [-2, -1, 3, 2, 0, 0, 0]),
    si("F", 1.0, [-2, -1, 4, 2, 0, 0, 0]),
    // no prefixes: pH is no picohenry
    plain("H", 1.0, [2, 1, -2, -2, 0, 0, 0]),
    plain("mH", 1e-3, [2, 1, -2, -2, 0, 0, 0]),
    plain("uH", 1e-6, [2, 1, -2, -2, 0, 0, 0]),
    si("Wb", 1.0, [2, 1, -2, -1, 0, 0, 0]),
    si("T", 1.0, [0, 1, -2, -1, 0, 0, 0]),
    plain("cd", 1.0, [0, 0, 0, 0, 0, 0, 1]),
    // temperature
    si("K", 1.0, TEMPERATURE),
    scale("degC", 1.0, 273.15),
    scale("°C", 1.0, 273.15),
    scale("degF", 5.0 / 9.0, 459.67 * 5.0 / 9.0),
    scale("°F", 5.0 / 9.0, 459.67 * 5.0 / 9.0),
    plain("degR", 5.0 / 9.0, TEMPERATURE),
    // amount of substance; M is mol/L, as chemists write it
    si("mol", 1.0, AMOUNT),
    si("M", 1e3, [-3, 0, 0, 0, 0, 1, 0]),
];

/// SI prefixes that occur beside models; larger and smaller ones would only turn slips into units.
static PREFIXES: &[(&str, f64)] = &[
    ("da", 1e1),
    ("G", 1e9),
    ("M", 1e6),
    ("k", 1e3),
    ("h", 1e2),
    ("d", 1e-1),
    ("c", 1e-2),
    ("m", 1e-3),
    ("u", 1e-6),
    ("µ", 1e-6),
    ("μ", 1e-6),
    ("n", 1e-9),
    ("p", 1e-12),
];

/// Prefixed symbols that are offered when a symbol is unknown.
static COMMON: &[&str] = &[
    "km", "cm", "mm", "kg", "mg", "ms", "us", "kN", "kJ", "kW", "MW", "kPa", "hPa", "MPa", "kHz", "mV", "mA", "kmol",
    "mmol", "mL", "mM", "mrad", "kcal",
];

/// The symbols that editors offer: every symbol of the table, and common ones with a prefix.
pub fn names() -> impl Iterator<Item = &'static str> {
    ROWS.iter().map(|r| r.name).chain(COMMON.iter().copied())
}

impl Symbol {
    fn row(self) -> &'static Row {
        &ROWS[usize::from(self.row)]
    }

    fn prefix(self) -> (&'static str, f64) {
        self.prefix.map_or(("", 1.0), |p| PREFIXES[usize::from(p)])
    }

    pub(super) fn text(self) -> String {
        format!("{}{}", self.prefix().0, self.row().name)
    }

    pub(super) fn factor(self) -> f64 {
        self.prefix().1 * self.row().factor
    }

    pub(super) fn dimension(self) -> [i8; 7] {
        self.row().dimension
    }

    pub(super) fn offset(self) -> f64 {
        self.row().offset
    }
}

/// The symbol with this text; exact symbols win over prefixed ones.
pub(super) fn find(text: &str) -> Option<Symbol> {
    let row = |name: &str, prefixed: bool| {
        ROWS.iter().position(|r| r.name == name && (r.prefixed || !prefixed)).and_then(|k| u8::try_from(k).ok())
    };
    if let Some(row) = row(text, false) {
        return Some(Symbol { prefix: None, row });
    }
    PREFIXES.iter().enumerate().find_map(|(k, (prefix, _))| {
        let row = row(text.strip_prefix(prefix)?, true)?;
        Some(Symbol { prefix: u8::try_from(k).ok(), row })
    })
}

/// The known symbol that is nearest to an unknown one, or the product or quotient that is meant by it.
pub(super) fn nearest(text: &str) -> Option<String> {
    if text.chars().count() > 12 {
        return None;
    }
    let lower = text.to_lowercase();
    let singular = lower.strip_suffix('s').unwrap_or(&lower);
    let word = spelled::word(text);
    let symbols = names;
    let other_case = || symbols().find(|s| s.to_lowercase() == lower);
    if let Some(known) = word.or_else(other_case) {
        return Some(known.into());
    }
    // a slip of a word that is written out, but not of a short one, which would be any symbol
    let written = || {
        let long = spelled::words().filter(|w| w.len() >= 4 && lower.len() >= 4);
        let near = crate::diagnostic::nearest(singular, long)?;
        spelled::word(near).map(String::from)
    };
    product(text).or_else(|| crate::diagnostic::nearest(text, symbols()).map(String::from)).or_else(written)
}

/// `N*m` for `Nm`, `kW*h` for `kWh`: up to four symbols of one letter each, or three letters that are two symbols.
fn product(text: &str) -> Option<String> {
    let letters: Vec<String> = text.chars().map(String::from).collect();
    let known = |symbol: &str| find(symbol).is_some();
    if letters.len() <= 4 && letters.iter().all(|l| known(l)) {
        return Some(letters.join("*"));
    }
    let ends = (1..letters.len()).rev().map(|k| (letters[..k].concat(), letters[k..].concat()));
    ends.filter(|_| letters.len() <= 3).find(|(a, b)| known(a) && known(b)).map(|(a, b)| format!("{a}*{b}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn symbols_are_unique_and_sound() {
        let mut names: Vec<_> = ROWS.iter().map(|r| r.name).collect();
        assert!(names.len() < 256);
        assert!(ROWS.iter().all(|r| r.factor.is_normal() && r.factor > 0.0));
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), ROWS.len());
    }

    #[test]
    fn own_symbols_win_over_prefixed_ones() {
        for (text, factor) in [
            ("min", 60.0),
            ("kt", 1852.0 / 3600.0),
            ("cd", 1.0),
            ("mm", 1e-3),
            ("kg", 1.0),
            ("mg", 1e-6),
            ("g0", 9.80665),
        ] {
            let got = find(text).unwrap_or_else(|| panic!("{text}")).factor();
            assert!((got - factor).abs() <= 1e-15 * factor, "{text}: {got}");
        }
        for text in ["pH", "kft", "mmin", "kdeg", "", "k"] {
            assert_eq!(find(text), None, "{text}");
        }
    }

    #[test]
    fn the_nearest_symbol_is_offered() {
        for (text, near) in [
            ("Kg", "kg"),
            ("KPA", "kPa"),
            ("meters", "m"),
            ("feet", "ft"),
            ("degg", "deg"),
            ("radd", "rad"),
            ("metr", "m"),
            ("kelvins", "K"),
            ("newtn", "N"),
        ] {
            assert_eq!(nearest(text).as_deref(), Some(near), "{text}");
        }
        for (text, product) in [("Nm", "N*m"), ("Nms", "N*m*s"), ("kWh", "kW*h"), ("kgm", "kg*m"), ("mps", "m/s")] {
            assert_eq!(nearest(text).as_deref(), Some(product), "{text}");
        }
        assert_eq!(nearest("furlongs"), None);
    }
}
