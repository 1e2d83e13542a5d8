//! Reads the text of a unit from left to right, without recursion: brackets stand on a stack of their own.

use super::Unit;
use super::symbols;
use std::ops::Range;

/// Why a text is not a unit.
#[derive(Debug, Clone, PartialEq)]
pub struct UnitError {
    /// Where in the text, in bytes.
    pub range: Range<usize>,
    /// One sentence without a full stop.
    pub message: String,
    /// The known symbol that is nearest to an unknown one.
    pub nearest: Option<String>,
}

impl std::fmt::Display for UnitError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.message)?;
        self.nearest.iter().try_for_each(|n| write!(f, "; did you mean `{n}`?"))
    }
}

impl std::error::Error for UnitError {}

fn error<T>(range: Range<usize>, message: impl Into<String>) -> Result<T, UnitError> {
    Err(UnitError { range, message: message.into(), nearest: None })
}

const EXPONENT: &str = "the exponent of a unit is an integer";
const TOO_LARGE: &str = "this is beyond the range of units (exponents from -127 to 127, at most 32 symbols)";

/// One level of brackets.
struct Level {
    unit: Unit,
    /// Divide by what comes next.
    divide: bool,
    /// A `/` has been seen: `J/kg K` could mean two things.
    divided: bool,
    open: usize,
}

impl Level {
    fn new(open: usize) -> Self {
        Self { unit: Unit::one(), divide: false, divided: false, open }
    }

    fn take(&mut self, operand: &Unit, range: Range<usize>) -> Result<(), UnitError> {
        let joined = if self.divide { self.unit.quotient(operand) } else { self.unit.product(operand) };
        match joined {
            Some(unit) => self.unit = unit,
            None => return error(range, TOO_LARGE),
        }
        self.divide = false;
        Ok(())
    }
}

pub(super) fn parse(text: &str) -> Result<Unit, UnitError> {
    let trimmed = text.trim();
    match trimmed {
        "" => return error(0..text.len(), "the unit is missing; a pure number is `1`"),
        "-" | "1" => return Ok(Unit { text: trimmed.into(), ..Unit::one() }),
        _ => {}
    }
    let mut reader = Reader { text, at: 0, levels: vec![Level::new(0)], alone: None, operands: 0 };
    let mut unit = reader.read()?;
    if let (1, Some(symbol)) = (reader.operands, reader.alone) {
        unit.offset = symbol.offset();
    }
    Ok(Unit { text: trimmed.into(), ..unit })
}

struct Reader<'a> {
    text: &'a str,
    at: usize,
    levels: Vec<Level>,
    /// The last operand, when it is a symbol to the power one in a numerator.
    alone: Option<symbols::Symbol>,
    operands: usize,
}

impl Reader<'_> {
    fn read(&mut self) -> Result<Unit, UnitError> {
        loop {
            self.operand()?;
            if !self.operator()? {
                break;
            }
        }
        match (self.levels.pop(), self.levels.last()) {
            (Some(last), None) => Ok(last.unit),
            (Some(last), Some(_)) => error(last.open..last.open + 1, "this bracket is not closed"),
            (None, _) => error(0..self.text.len(), "the unit is missing"),
        }
    }

    /// A number, a symbol with its exponent, or brackets that open.
    fn operand(&mut self) -> Result<(), UnitError> {
        loop {
            self.spaces();
            let start = self.at;
            match self.peek() {
                Some('(') => {
                    self.at += 1;
                    self.levels.push(Level::new(start));
                }
                Some('1'..='9' | '0') => {
                    self.number(start)?;
                    return self.take(Unit::one(), start);
                }
                Some(c) if is_letter(c) => {
                    let unit = self.symbol(start)?;
                    return self.take(unit, start);
                }
                Some(c) => return error(start..start + c.len_utf8(), format!("a unit is expected here, not `{c}`")),
                None => return error(start..start, "the unit ends where a symbol is expected"),
            }
        }
    }

    /// What stands between operands; false at the end of the text.
    fn operator(&mut self) -> Result<bool, UnitError> {
        loop {
            let start = self.at;
            self.spaces();
            let spaced = self.at > start;
            let at = self.at;
            let Some(c) = self.peek() else { return Ok(false) };
            let next = self.text[at + c.len_utf8()..].chars().next();
            match c {
                '*' | '·' | '×' | '.' | '⋅' => self.at += c.len_utf8(),
                '/' => self.at += 1,
                // the hyphen of N-m and ft-lbf
                '-' if !spaced && next.is_some_and(is_letter) => self.at += 1,
                ')' => {
                    self.close(at)?;
                    continue;
                }
                c if spaced && (is_letter(c) || c == '(') => {
                    if self.levels.last().is_some_and(|l| l.divided) {
                        let message = "a product without a sign behind `/` can be read in two ways; write `*` or brackets, as in `J/(kg*K)`";
                        return error(at..at + c.len_utf8(), message);
                    }
                }
                c => return error(at..at + c.len_utf8(), format!("`{c}` does not belong into a unit")),
            }
            if let Some(level) = self.levels.last_mut() {
                level.divide = c == '/';
                level.divided |= c == '/';
            }
            return Ok(true);
        }
    }

    fn close(&mut self, at: usize) -> Result<(), UnitError> {
        if self.levels.len() < 2 {
            return error(at..at + 1, "this bracket was not opened");
        }
        self.at += 1;
        let Some(level) = self.levels.pop() else { return Ok(()) };
        let alone = self.alone;
        let exponent = self.join(level.unit, level.open)?;
        self.alone = alone.filter(|_| exponent == 1);
        Ok(())
    }

    /// Joins a number or symbol to the level and notes whether it is the only one.
    fn take(&mut self, operand: Unit, start: usize) -> Result<(), UnitError> {
        self.operands += 1;
        let alone = self.operands == 1 && self.levels.iter().all(|l| !l.divide);
        let symbol = operand.parts.first().map(|p| p.symbol);
        let exponent = self.join(operand, start)?;
        self.alone = symbol.filter(|_| alone && exponent == 1);
        Ok(())
    }

    /// Reads the exponent behind an operand or brackets and joins the power to the level.
    fn join(&mut self, operand: Unit, start: usize) -> Result<i32, UnitError> {
        let exponent = self.exponent()?;
        let Some(unit) = operand.power(exponent) else { return error(start..self.at, TOO_LARGE) };
        let end = self.at;
        self.levels.last_mut().map_or(Ok(()), |level| level.take(&unit, start..end))?;
        Ok(exponent)
    }

    fn number(&mut self, start: usize) -> Result<(), UnitError> {
        self.skip(|c| c.is_ascii_digit() || c == '.' || c == ',');
        if &self.text[start..self.at] == "1" {
            return Ok(());
        }
        error(start..self.at, "a unit has no numbers other than 1; bounds are written `in [lower, upper]`")
    }

    /// A symbol; digits behind it are its exponent (`m/s2`) unless they belong to it (`g0`).
    fn symbol(&mut self, start: usize) -> Result<Unit, UnitError> {
        self.skip(|c| is_letter(c) || c.is_ascii_digit());
        let word = &self.text[start..self.at];
        if let Some(symbol) = symbols::find(word) {
            return Ok(Unit::of(symbol));
        }
        let letters = word.trim_end_matches(|c: char| c.is_ascii_digit());
        match symbols::find(letters) {
            Some(symbol) => {
                self.at = start + letters.len();
                Ok(Unit::of(symbol))
            }
            None => Err(UnitError {
                range: start..self.at,
                message: format!("`{}` is not a known unit", shortened(word)),
                nearest: symbols::nearest(word),
            }),
        }
    }

    /// `^2`, `^-2`, `^(-2)`, `**2`, `²`, or digits at once behind a symbol (`s2`, `s-2`); 1 when there is none.
    fn exponent(&mut self) -> Result<i32, UnitError> {
        let start = self.at;
        let rest = &self.text[start..];
        let sign = if rest.starts_with("**") { 2 } else { usize::from(rest.starts_with('^')) };
        if sign > 0 {
            self.at += sign;
            return self.integer(start);
        }
        let glued = rest.strip_prefix('-').unwrap_or(rest).starts_with(|c: char| c.is_ascii_digit());
        if glued {
            return self.integer(start);
        }
        self.skip(|c| raised(c).is_some());
        let plain: String = self.text[start..self.at].chars().filter_map(raised).collect();
        if plain.is_empty() { Ok(1) } else { exponent_value(&plain, start..self.at) }
    }

    fn integer(&mut self, start: usize) -> Result<i32, UnitError> {
        self.spaces();
        let bracket = self.peek() == Some('(');
        if bracket {
            self.at += 1;
            self.spaces();
        }
        let digits = self.at;
        self.skip(|c| c.is_ascii_digit() || matches!(c, '-' | '+'));
        let number = digits..self.at;
        if bracket {
            self.spaces();
            if self.peek() != Some(')') {
                return error(start..self.at.max(start + 1), EXPONENT);
            }
            self.at += 1;
        }
        if matches!(self.peek(), Some('^')) || self.text[self.at..].starts_with("**") {
            return error(start..self.at + 1, "a power of a power needs brackets");
        }
        let fraction =
            !bracket && self.peek() == Some('.') && self.text[self.at + 1..].starts_with(|c: char| c.is_ascii_digit());
        if fraction {
            return error(start..self.at + 1, EXPONENT);
        }
        exponent_value(&self.text[number], start..self.at)
    }

    fn spaces(&mut self) {
        self.skip(char::is_whitespace);
    }

    fn skip(&mut self, accept: impl Fn(char) -> bool) {
        let rest = &self.text[self.at..];
        self.at += rest.find(|c| !accept(c)).unwrap_or(rest.len());
    }

    fn peek(&self) -> Option<char> {
        self.text[self.at..].chars().next()
    }
}

fn exponent_value(digits: &str, range: Range<usize>) -> Result<i32, UnitError> {
    let body = digits.strip_prefix(['-', '+']).unwrap_or(digits);
    if body.is_empty() || !body.bytes().all(|b| b.is_ascii_digit()) {
        return error(range, EXPONENT);
    }
    match digits.parse::<i8>() {
        Ok(value) if value > i8::MIN => Ok(i32::from(value)),
        _ => error(range, TOO_LARGE),
    }
}

fn is_letter(c: char) -> bool {
    c.is_alphabetic() && raised(c).is_none() || matches!(c, '%' | '°' | '_')
}

/// The plain form of a raised digit or sign.
fn raised(c: char) -> Option<char> {
    let k = "⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁺".chars().position(|r| r == c)?;
    "0123456789-+".chars().nth(k)
}

/// A word that a message can show.
fn shortened(word: &str) -> String {
    if word.chars().count() <= 24 { word.into() } else { word.chars().take(24).chain("...".chars()).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn units_are_read_as_people_write_them() {
        for (text, same) in [
            ("m/s/s", "m/s^2"),
            ("ft/s2", "ft/s^2"),
            ("m s-2", "m/s^2"),
            ("m·s⁻²", "m/s^2"),
            ("kg m^2", "kg*m^2"),
            ("N.m", "N*m"),
            ("ft-lbf", "ft*lbf"),
            ("(m/s)^2", "m^2/s^2"),
            ("1/(s*rad)", "1/s"),
            ("m^(-1)", "1/m"),
            ("m^-1", "1/m"),
            ("m**2", "m^2"),
            ("( ( m ) )", "m"),
            (" deg / s ", "deg/s"),
            ("°/s", "deg/s"),
            ("µm", "um"),
            ("W/(m^2*K)", "kg/s^3/K"),
            ("mL", "cc"),
            ("mol/L", "M"),
            ("%", "percent"),
            ("1", "-"),
            ("s^0", "1"),
        ] {
            let (a, b) = (parse(text), parse(same));
            assert!(matches!((&a, &b), (Ok(a), Ok(b)) if a.same_size(b)), "{text}: {a:?} {b:?}");
            assert_eq!(a.map(|a| a.text().to_string()).as_deref(), Ok(text.trim()));
        }
    }

    #[test]
    fn mistakes_have_a_place_and_a_reason() {
        for (text, range, part) in [
            ("", 0..0, "missing"),
            ("m/ss", 2..4, "`ss` is not a known unit"),
            ("m/", 2..2, "ends where a symbol"),
            ("(m/s", 0..1, "not closed"),
            ("m)", 1..2, "not opened"),
            ("m^x", 1..2, "integer"),
            ("Hz^0.5", 2..5, "integer"),
            ("Hz^(1/2)", 2..5, "integer"),
            ("m^2^3", 1..4, "power of a power"),
            ("m^999", 1..5, "beyond"),
            ("J/kg K", 5..6, "two ways"),
            ("0, 20", 0..2, "bounds"),
            ("20", 0..2, "bounds"),
            ("m+s", 1..2, "does not belong"),
            ("*m", 0..1, "expected here"),
            ("()", 1..2, "expected here"),
            ("m^100*m^100", 6..11, "beyond"),
        ] {
            match parse(text) {
                Err(e) => {
                    assert_eq!(e.range, range, "{text}: {e}");
                    assert!(e.message.contains(part), "{text}: {e}");
                }
                Ok(unit) => panic!("{text}: {unit}"),
            }
        }
        assert_eq!(parse("m/sce").map_err(|e| e.nearest), Err(Some("sec".into())));
    }

    #[test]
    fn temperatures_have_a_zero_only_when_alone() {
        let offset = |text| parse(text).map(|u| u.offset);
        assert_eq!(offset("degC"), Ok(273.15));
        assert_eq!(offset("(degC)"), Ok(273.15));
        for text in ["degC/s", "1/degC", "degC^2", "J/degC", "m*degC", "K"] {
            assert_eq!(offset(text), Ok(0.0), "{text}");
        }
    }

    #[test]
    fn deep_and_long_texts_are_no_trouble() {
        let deep = format!("{}m{}", "(".repeat(100_000), ")".repeat(100_000));
        assert!(parse(&deep).is_ok());
        let long = format!("m{}", "/m*m".repeat(20_000));
        assert!(parse(&long).is_ok());
    }

    proptest! {
        #[test]
        fn no_text_panics(text in "[ -~°²⁻µmskg/*^()0-9]{0,20}") {
            if let Ok(unit) = parse(&text) {
                prop_assert!(unit.factor.is_normal());
                prop_assert!(parse(unit.text()).is_ok());
            }
        }
    }
}
