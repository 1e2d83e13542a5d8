//! Numbers as people write them: with a unit (`"35 deg"`), in percent (`"3 %"`), in standard errors (`"4 se"`).

use fdm_grammar::Unit;
use fdm_grammar::number::held;
use serde::{Deserialize, Deserializer, de};
use std::str::FromStr;

/// A number, possibly in a unit of its own.
#[derive(Debug, Clone, PartialEq)]
pub struct Amount {
    /// As written.
    pub value: f64,
    /// Its unit; none means that of the channel.
    pub unit: Option<Unit>,
}

impl Amount {
    /// The number in another unit; as written where one of the units is not known. None when the dimensions differ.
    pub fn within(&self, unit: Option<&Unit>) -> Option<f64> {
        match (&self.unit, unit) {
            (Some(own), Some(wanted)) => own.conversion(wanted).map(|(scale, _)| self.value * scale),
            _ => Some(self.value),
        }
    }
}

/// How far a figure may be from what was expected.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Tolerance {
    /// So many of its own standard errors.
    Errors(f64),
    /// A part of what was expected.
    Part(f64),
    /// In its own unit.
    Absolute(f64),
}

#[derive(Deserialize)]
#[serde(untagged)]
enum Written {
    Number(f64),
    Text(String),
}

impl<'de> Deserialize<'de> for Amount {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        match Written::deserialize(from)? {
            Written::Number(value) => Ok(Self { value, unit: None }),
            Written::Text(text) => match text.split_once(' ') {
                Some(_) => text.parse().map_err(de::Error::custom),
                None => format!("{text} 1").parse().map_err(de::Error::custom),
            },
        }
    }
}

impl FromStr for Amount {
    type Err = String;

    /// A number, and behind a space its unit; without one it is in that of the channel.
    fn from_str(text: &str) -> Result<Self, String> {
        let (number, unit) = text.split_once(' ').map_or((text, None), |(number, unit)| (number, Some(unit.trim())));
        let value = held(number).map_err(|unheld| format!("`{number}` {unheld}: {}", unheld.hint()))?;
        let unit = unit.map(|unit| Unit::parse(unit).map_err(|_| format!("`{unit}` is not a unit")));
        Ok(Self { value, unit: unit.transpose()? })
    }
}

impl<'de> Deserialize<'de> for Tolerance {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        let written = Written::deserialize(from)?;
        let Written::Text(text) = written else {
            let Written::Number(value) = written else {
                return Err(de::Error::custom("a tolerance is a number or a text"));
            };
            return Ok(Self::Absolute(value));
        };
        let wrong = || de::Error::custom(format!("`{text}` is no tolerance: write `4 se`, `3 %` or a number"));
        let (number, kind) = text.split_once(' ').ok_or_else(wrong)?;
        let value = held(number).map_err(|_| wrong())?;
        match kind.trim() {
            "se" => Ok(Self::Errors(value)),
            "%" => Ok(Self::Part(value / 100.0)),
            _ => Err(wrong()),
        }
    }
}
