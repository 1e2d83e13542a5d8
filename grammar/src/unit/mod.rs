//! Units of measurement: parsed, multiplied, compared, converted.
//!
//! **In** text between brackets, `m/s^2`. **Out** [`Unit`]: dimension, size in SI units, zero; or a [`UnitError`].
//! **Never** converts anything by itself: a unit only says what it measures and how large it is.
//! **Start** at [`Unit::parse`]; `symbols.rs` is THE table of symbols.
//!
//! Angles are pure numbers: `rad` is 1, `deg` is pi/180, so `rad/s` and `1/s` agree and `deg/s` and `rad/s` do not.
//! The zero of `degC` and `degF` counts when the unit stands alone; in products they are differences.

mod parse;
mod spelled;
mod symbols;

pub use parse::UnitError;
pub use spelled::Spelled;
pub use symbols::names as symbols;

use symbols::Symbol;

/// A unit: what it measures and how large it is in SI units.
#[derive(Debug, Clone, PartialEq)]
pub struct Unit {
    text: String,
    parts: Vec<Part>,
    /// Exponents of m, kg, s, A, K, mol, cd; angles are pure numbers, `deg` a pure number of size pi/180.
    pub dimension: [i8; 7],
    /// Size in SI units.
    pub factor: f64,
    /// Value of the unit's zero in SI units (temperatures in degC and degF).
    pub offset: f64,
}

/// A symbol with its exponent, from which the text of a product is composed.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Part {
    symbol: Symbol,
    exponent: i8,
}

impl Unit {
    /// Reads a unit: `m/s^2`, `kg m^2`, `1/(s*rad)`, `deg`, `%`; `1` and `-` are pure numbers.
    ///
    /// # Errors
    /// The place in the text, what is wrong there and, for an unknown symbol, the nearest known one.
    pub fn parse(text: &str) -> Result<Self, UnitError> {
        parse::parse(text)
    }

    /// Reads a unit as loggers and people spell it, as [`Unit::parse`] does and beyond: `RPM`, `Nm`, `knots`, `degrees per second`, `Deg C`.
    ///
    /// # Errors
    /// As [`Unit::parse`].
    pub fn spelled(text: &str) -> Result<Spelled, UnitError> {
        spelled::spelled(text)
    }

    /// The unit that is meant by a sign of two meanings where numbers are wanted in `to`, and its first meaning is no such thing: `g` of an
    /// acceleration (`g0`) or a load factor, `C` of a temperature, `lb` of a force.
    pub fn meant(text: &str, to: &Self) -> Option<Spelled> {
        spelled::meant(text, to)
    }

    /// The second.
    pub fn second() -> Self {
        Self { text: "s".into(), dimension: [0, 0, 1, 0, 0, 0, 0], ..Self::known("s") }
    }

    /// A pure number.
    pub fn one() -> Self {
        Self { text: "1".into(), parts: Vec::new(), dimension: [0; 7], factor: 1.0, offset: 0.0 }
    }

    /// The radian: a pure number with a name.
    pub fn radian() -> Self {
        Self::known("rad")
    }

    /// The degree of arc.
    pub fn degree() -> Self {
        Self::known("deg")
    }

    /// As the user wrote it, or composed from the symbols of the factors; [`Unit::parse`] reads it back.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Whether it is a pure number of size 1 (`1`, `rad`, `m/m`), as the sine and the exponential need it.
    pub fn is_one(&self) -> bool {
        self.same_size(&Self::one())
    }

    /// The product; `None` when an exponent or the size leaves its range.
    pub fn product(&self, other: &Self) -> Option<Self> {
        self.times(other, 1)
    }

    /// The quotient; `None` when an exponent or the size leaves its range.
    pub fn quotient(&self, other: &Self) -> Option<Self> {
        self.times(other, -1)
    }

    /// The n-th power; `None` when an exponent or the size leaves its range.
    pub fn power(&self, n: i32) -> Option<Self> {
        let scaled = |e: i8| i32::from(e).checked_mul(n).and_then(|e| i8::try_from(e).ok());
        self.with_exponents(scaled, self.factor.powi(n))
    }

    /// The n-th root; `None` when n is zero or does not divide every exponent (`m^2` has a square root, `m` has none).
    pub fn root(&self, n: i32) -> Option<Self> {
        let divided = |e: i8| {
            let e = i32::from(e);
            if n != 0 && e % n == 0 { i8::try_from(e / n).ok() } else { None }
        };
        // the symbols may resist where the dimension does not (N*kg*m has the root kg*m/s): then SI symbols serve
        let factor = if n == 2 { self.factor.sqrt() } else { self.factor.powf(1.0 / f64::from(n)) };
        self.with_exponents(divided, factor).or_else(|| {
            let si = self.in_si()?;
            si.with_exponents(divided, factor).filter(|_| (self.factor - 1.0).abs() < 1e-9)
        })
    }

    /// Whether both measure the same thing in the same size; zeros (degC, K) are not compared.
    pub fn same_size(&self, other: &Self) -> bool {
        self.same_dimension(other) && (self.factor - other.factor).abs() <= 1e-9 * self.factor.abs()
    }

    /// Whether both measure the same thing.
    pub fn same_dimension(&self, other: &Self) -> bool {
        self.dimension == other.dimension
    }

    /// `(scale, offset)` such that a value v of this unit is `scale*v + offset` in the other; `None` when they
    /// measure different things.
    pub fn conversion(&self, to: &Self) -> Option<(f64, f64)> {
        self.same_dimension(to).then(|| {
            let scale = if self.factor == to.factor { 1.0 } else { self.factor / to.factor };
            let offset = if self.offset == to.offset { 0.0 } else { (self.offset - to.offset) / to.factor };
            (scale, offset)
        })
    }

    /// The unit with a degree of arc replaced by a radian (`deg/s` gives `rad/s`); `None` when no `deg` stands in
    /// its numerator.
    pub fn degree_to_radian(&self) -> Option<Self> {
        self.replaced(&Self::degree(), &Self::radian())
    }

    /// The unit with a radian replaced by a degree of arc. A pure number counts as an angle in radians, `1/s` as
    /// `rad/s`; `None` when degrees stand there already.
    pub fn radian_to_degree(&self) -> Option<Self> {
        let has = |unit: &Self, sign: i8| {
            unit.parts.first().is_some_and(|p| self.parts.iter().any(|q| q.symbol == p.symbol && q.exponent * sign > 0))
        };
        if has(&Self::degree(), 1) {
            return None;
        }
        self.replaced(&Self::radian(), &Self::degree()).or_else(|| self.product(&Self::degree()))
    }

    fn replaced(&self, from: &Self, to: &Self) -> Option<Self> {
        let symbol = from.parts.first()?.symbol;
        let found = self.parts.iter().any(|p| p.symbol == symbol && p.exponent > 0);
        if found { self.quotient(from)?.product(to) } else { None }
    }

    /// A unit of one symbol of the table.
    fn known(name: &str) -> Self {
        symbols::find(name).map_or_else(Self::one, Self::of)
    }

    fn of(symbol: Symbol) -> Self {
        Self {
            text: symbol.text(),
            dimension: symbol.dimension(),
            factor: symbol.factor(),
            offset: symbol.offset(),
            parts: vec![Part { symbol, exponent: 1 }],
        }
    }

    fn in_si(&self) -> Option<Self> {
        let base = ["m", "kg", "s", "A", "K", "mol", "cd"];
        base.iter()
            .zip(self.dimension)
            .try_fold(Self::one(), |unit, (name, e)| unit.product(&Self::known(name).power(i32::from(e))?))
    }

    fn times(&self, other: &Self, sign: i8) -> Option<Self> {
        let mut dimension = self.dimension;
        for (d, e) in dimension.iter_mut().zip(other.dimension) {
            *d = d.checked_add(e.checked_mul(sign)?)?;
        }
        let mut parts = self.parts.clone();
        for part in &other.parts {
            let exponent = part.exponent.checked_mul(sign)?;
            match parts.iter_mut().find(|p| p.symbol == part.symbol) {
                Some(p) => p.exponent = p.exponent.checked_add(exponent)?,
                None => parts.push(Part { exponent, ..*part }),
            }
        }
        let factor = if sign > 0 { self.factor * other.factor } else { self.factor / other.factor };
        Self::composed(parts, dimension, factor)
    }

    fn with_exponents(&self, map: impl Fn(i8) -> Option<i8>, factor: f64) -> Option<Self> {
        let mut dimension = self.dimension;
        for d in &mut dimension {
            *d = map(*d)?;
        }
        let mut parts = self.parts.clone();
        for p in &mut parts {
            p.exponent = map(p.exponent)?;
        }
        Self::composed(parts, dimension, factor)
    }

    fn composed(mut parts: Vec<Part>, dimension: [i8; 7], factor: f64) -> Option<Self> {
        parts.retain(|p| p.exponent != 0);
        // most symbols in one unit, so that arithmetic with units takes bounded time on any text
        let sound = factor.is_normal() && factor > 0.0 && parts.len() <= 32;
        sound.then(|| Self { text: compose(&parts), parts, dimension, factor, offset: 0.0 })
    }
}

impl std::fmt::Display for Unit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.text)
    }
}

/// `kg*m^2/s^2`, `1/s`, `J/(kg*K)`; `1` when nothing is left.
fn compose(parts: &[Part]) -> String {
    let side = |sign: i8| {
        let one = |p: &Part| match p.exponent.unsigned_abs() {
            1 => p.symbol.text(),
            n => format!("{}^{n}", p.symbol.text()),
        };
        let chosen = parts.iter().filter(|p| p.exponent.signum() == sign);
        chosen.map(one).collect::<Vec<_>>()
    };
    let (over, under) = (side(1), side(-1));
    let over = if over.is_empty() { "1".into() } else { over.join("*") };
    match under.len() {
        0 => over,
        1 => format!("{over}/{}", under[0]),
        _ => format!("{over}/({})", under.join("*")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unit(text: &str) -> Unit {
        Unit::parse(text).unwrap_or_else(|e| panic!("{text}: {e}"))
    }

    #[test]
    fn products_compose_readable_texts_that_parse_back() {
        let table = [
            (unit("kg").product(&unit("m/s^2")), "kg*m/s^2"),
            (unit("m/s").quotient(&unit("s")), "m/s^2"),
            (unit("m/s").product(&unit("s")), "m"),
            (unit("rad").quotient(&unit("rad")), "1"),
            (unit("1").quotient(&unit("s")), "1/s"),
            (unit("J").quotient(&unit("kg*K")), "J/(kg*K)"),
            (unit("ft/s").power(2), "ft^2/s^2"),
            (unit("ft/s").power(-1), "s/ft"),
            (unit("m^2/s^4").root(2), "m/s^2"),
            (unit("N*kg*m").root(2), "m*kg/s"),
            (unit("degC").quotient(&unit("s")), "degC/s"),
        ];
        for (got, text) in table {
            let got = got.unwrap_or_else(|| panic!("{text}"));
            assert_eq!(got.text(), text);
            assert!(unit(text).same_size(&got), "{text}");
        }
    }

    #[test]
    fn sizes_and_dimensions_are_compared() {
        for (a, b, size, dimension) in [
            ("m", "ft", false, true),
            ("deg", "rad", false, true),
            ("rad/s", "1/s", true, true),
            ("N", "kg*m/s^2", true, true),
            ("kt", "nmi/h", true, true),
            ("m", "s", false, false),
            ("lbf", "slug*ft/s^2", true, true),
            ("rpm", "rev/min", true, true),
            ("%", "1", false, true),
        ] {
            assert_eq!((unit(a).same_size(&unit(b)), unit(a).same_dimension(&unit(b))), (size, dimension), "{a} {b}");
        }
    }

    #[test]
    fn conversions_reproduce_known_numbers() {
        for (value, from, to, want) in [
            (1.0, "ft", "m", 0.3048),
            (180.0, "deg", "rad", std::f64::consts::PI),
            (25.0, "degC", "K", 298.15),
            (212.0, "degF", "degC", 100.0),
            (1.0, "kt", "km/h", 1.852),
            (1.0, "atm", "psi", 14.695_948_775_513_45),
            (1.0, "hp", "W", 745.699_871_582_270_2),
            (9.0, "degF/min", "K/s", 9.0 * 5.0 / 9.0 / 60.0),
        ] {
            let (scale, offset) = unit(from).conversion(&unit(to)).unwrap();
            let got = scale * value + offset;
            assert!((got - want).abs() < 1e-12 * want.abs().max(1.0), "{value} {from} = {got} {to}, not {want}");
        }
        assert_eq!(unit("m").conversion(&unit("s")), None);
        assert_eq!(unit("m/s").conversion(&unit("m/s")), Some((1.0, 0.0)));
    }

    #[test]
    fn exponents_and_sizes_beyond_the_range_are_refused() {
        assert_eq!(unit("m^100").product(&unit("m^100")), None);
        assert_eq!(unit("m").power(128), None);
        assert_eq!(unit("m").power(i32::MIN), None);
        assert_eq!(unit("m").root(2), None);
        assert_eq!(unit("m").root(0), None);
        assert_eq!(unit("Gm^30").power(2), None, "10^540 is not a size");
    }

    #[test]
    fn degrees_become_radians_within_a_unit() {
        let text = |u: Option<Unit>| u.map(|u| u.text().to_string());
        assert_eq!(text(unit("deg/s").degree_to_radian()).as_deref(), Some("rad/s"));
        assert_eq!(text(unit("m").degree_to_radian()), None);
        assert_eq!(text(unit("rad/s").radian_to_degree()).as_deref(), Some("deg/s"));
        assert_eq!(text(unit("1/s").radian_to_degree()).as_deref(), Some("deg/s"));
        assert_eq!(text(unit("deg").radian_to_degree()), None);
        let (deg, rad) = (unit("deg"), unit("rad"));
        assert!(deg.degree_to_radian().is_some_and(|u| u.same_size(&rad)));
        assert!(rad.radian_to_degree().is_some_and(|u| u.same_size(&deg)));
    }
}
