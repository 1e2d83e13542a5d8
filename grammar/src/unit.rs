//! Units of measurement: parsed, multiplied, compared, converted.

/// A unit: what it measures and how large it is in SI units.
#[derive(Debug, Clone, PartialEq)]
pub struct Unit {
    text: String,
    /// Exponents of m, kg, s, A, K, mol, cd; angles are pure numbers, `deg` a pure number of size pi/180.
    pub dimension: [i8; 7],
    /// Size in SI units.
    pub factor: f64,
    /// Value of the unit's zero in SI units (temperatures in degC and degF).
    pub offset: f64,
}

impl std::fmt::Display for Unit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.text)
    }
}
