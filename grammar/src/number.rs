//! Numbers as they are written, and what double precision cannot hold of them.

use std::fmt;

/// Why written digits are no number here.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unheld {
    /// They are no number in any form.
    Malformed,
    /// They stand for more than the largest number.
    TooLarge,
    /// They stand for less than the smallest number but not for zero, or for one that is held with fewer digits than others.
    TooSmall,
}

impl Unheld {
    /// What would mend it.
    pub fn hint(self) -> &'static str {
        match self {
            Self::Malformed => "write a number such as 0.1 or 1e-3",
            Self::TooLarge => "the largest number is about 1.8e308",
            Self::TooSmall => {
                "the smallest number with all its digits is about 2.2e-308; write 0, or take a smaller unit"
            }
        }
    }
}

impl fmt::Display for Unheld {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Malformed => "is not a number",
            Self::TooLarge => "is too large",
            Self::TooSmall => "is too small",
        })
    }
}

/// The value of a written number; words such as `inf` and `nan` are their values.
///
/// # Errors
/// [`Unheld`]: the value would be infinite, zero or of fewer digits though something else is written.
pub fn held(text: &str) -> Result<f64, Unheld> {
    let value: f64 = text.parse().map_err(|_| Unheld::Malformed)?;
    let mantissa = text.split(['e', 'E']).next().unwrap_or_default();
    if value.is_infinite() && mantissa.contains(|c: char| c.is_ascii_digit()) {
        return Err(Unheld::TooLarge);
    }
    let written = mantissa.contains(|c: char| ('1'..='9').contains(&c));
    if written && value.abs() < f64::MIN_POSITIVE { Err(Unheld::TooSmall) } else { Ok(value) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_would_be_zero_or_infinite_is_told() {
        for (text, value) in [("0", 0.0), ("-0.0e99", 0.0), ("0e-400", 0.0), ("1e-300", 1e-300), ("-2.5", -2.5)] {
            assert_eq!(held(text), Ok(value), "{text}");
        }
        assert_eq!(held("inf"), Ok(f64::INFINITY));
        for small in ["1e-400", "-0.1e-330", "1e-310", "0.00001e-320"] {
            assert_eq!(held(small), Err(Unheld::TooSmall), "{small}");
        }
        assert_eq!((held("1e400"), held("-1e400")), (Err(Unheld::TooLarge), Err(Unheld::TooLarge)));
        assert_eq!((held("1e"), held("")), (Err(Unheld::Malformed), Err(Unheld::Malformed)));
    }
}
