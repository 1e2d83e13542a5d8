//! What a file computes beside what its model computes ([`Verification`]).
//!
//! A unit is loaded as a simulator would; source is compiled by the system's compiler. Values and derivatives are compared with those of
//! the tape at points that nobody chose: around the initial values, inputs and parameters moved at random, always the same ones.
//! An estimator follows a record of random numbers beside the recursion of `fdm`, and both are compared at every sample.
//! **Start** at [`Artefact::read`]; whoever calls writes its [`files`](Artefact::files) to a folder, and then asks
//! for [`Artefact::compare`] there.

mod compiled;
mod error;
mod recursion;
mod site;
mod unit;

use crate::Stamp;
use crate::fmu::{DESCRIPTION, Files, Version, unpacked};
use crate::recursive::MARK;
use fdm_system::Model;
use site::{Numbers, Site};
use std::path::Path;

pub use error::VerifyError;

/// What is verified.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Artefact {
    /// C99.
    C(String),
    /// An estimator in C99.
    Estimator(String),
    /// Rust.
    Rust(String),
    /// A functional mock-up unit: its files.
    Unit(Version, Files),
}

/// One kind of number, compared at all points.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// What it is.
    pub what: &'static str,
    /// Numbers that were compared.
    pub count: usize,
    /// Largest difference, as a part of the larger number; infinite where one is not finite and the other is.
    pub difference: f64,
    /// Numbers whose bits differ.
    pub other_bits: usize,
}

/// What a comparison found.
#[derive(Debug, Clone, PartialEq)]
pub struct Verification {
    /// By kind of number.
    pub rows: Vec<Row>,
    /// Points.
    pub points: usize,
}

/// Largest difference that another library of elementary functions may make.
pub const TOLERANCE: f64 = 1e-9;
/// Points at which values are compared.
const POINTS: u64 = 8;

impl Verification {
    /// Whether all numbers are the model's.
    pub fn is_good(&self) -> bool {
        self.rows.iter().all(|row| row.difference <= TOLERANCE)
    }

    fn add(&mut self, expected: &Numbers, found: &Numbers) {
        for ((what, expected), (_, found)) in expected.iter().zip(found) {
            let place = self.rows.iter().position(|row| row.what == *what).unwrap_or_else(|| {
                self.rows.push(Row { what, count: 0, difference: 0.0, other_bits: 0 });
                self.rows.len() - 1
            });
            let row = &mut self.rows[place];
            // what is small beside its neighbours is what their cancellation left
            let scale = expected.iter().filter(|v| v.is_finite()).fold(0.0_f64, |s, v| s.max(v.abs()));
            for (a, b) in expected.iter().zip(found) {
                row.count += 1;
                if a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan() {
                    continue;
                }
                row.other_bits += 1;
                let part = (a - b).abs() / a.abs().max(b.abs()).max(1e-6 * scale).max(f64::MIN_POSITIVE);
                let part = if a == b {
                    0.0
                } else if part.is_nan() {
                    f64::INFINITY
                } else {
                    part
                };
                row.difference = row.difference.max(part);
            }
            row.difference = if expected.len() == found.len() { row.difference } else { f64::INFINITY };
        }
    }
}

impl Artefact {
    /// A file by its name.
    ///
    /// # Errors
    /// [`VerifyError::Kind`], [`VerifyError::Unit`], [`VerifyError::Text`].
    pub fn read(name: &str, bytes: &[u8]) -> Result<Self, VerifyError> {
        let text = || String::from_utf8(bytes.to_vec()).map_err(|_| VerifyError::Text);
        match Path::new(name).extension().and_then(|e| e.to_str()) {
            Some("c" | "h") => {
                let text = text()?;
                Ok(if text.contains(MARK) { Self::Estimator(text) } else { Self::C(text) })
            }
            Some("rs") => Ok(Self::Rust(text()?)),
            Some("fmu") => {
                let files = unpacked(bytes)?;
                let three = description(&files).contains("fmiVersion=\"3");
                Ok(Self::Unit(if three { Version::Three } else { Version::Two }, files))
            }
            _ => Err(VerifyError::Kind(name.into())),
        }
    }

    /// Whether it was made from this model.
    ///
    /// # Errors
    /// [`VerifyError::Unstamped`], [`VerifyError::Other`].
    pub fn belongs_to(&self, model: &Model) -> Result<(), VerifyError> {
        let found = match self {
            Self::C(text) | Self::Rust(text) | Self::Estimator(text) => Stamp::find(text),
            Self::Unit(_, files) => Stamp::find(&description(files)),
        };
        let (found, expected) = (found.ok_or(VerifyError::Unstamped)?, Stamp::of(model));
        if found == expected { Ok(()) } else { Err(VerifyError::Other { found, expected }) }
    }

    /// What has to stand in a folder to be compared.
    pub fn files(&self, model: &Model) -> Files {
        match self {
            Self::C(text) => compiled::c_files(model, text),
            Self::Rust(text) => compiled::rust_files(text),
            Self::Estimator(text) => recursion::files(model, text),
            Self::Unit(_, files) => files.clone(),
        }
    }

    /// Compares with the model, in a folder that holds [`Self::files`].
    ///
    /// # Errors
    /// [`VerifyError`] where the file cannot be compiled, loaded or asked.
    pub fn compare(&self, model: &Model, folder: &Path) -> Result<Verification, VerifyError> {
        let mut found = Verification { rows: Vec::new(), points: POINTS as usize };
        match self {
            Self::C(_) | Self::Rust(_) => {
                let library = match self {
                    Self::C(_) => compiled::c_library(folder)?,
                    _ => compiled::rust_library(folder)?,
                };
                for point in 0..POINTS {
                    let site = Site::new(model, point);
                    let expected = site.expected(model);
                    found.add(&expected, &compiled::numbers(&library, &site, &expected)?);
                }
            }
            Self::Estimator(_) => {
                let samples = recursion::numbers(model, folder)?;
                found.points = samples.len();
                samples.iter().for_each(|(expected, told)| found.add(expected, told));
            }
            Self::Unit(version, _) => {
                let mut unit = unit::Unit::load(*version, model, folder)?;
                for point in 0..POINTS {
                    let (expected, got) = unit.at(point)?;
                    found.add(&expected, &got);
                }
            }
        }
        Ok(found)
    }
}

/// The description of a unit.
fn description(files: &Files) -> String {
    let file = files.iter().find(|(name, _)| name == DESCRIPTION);
    file.map(|(_, bytes)| String::from_utf8_lossy(bytes).into_owned()).unwrap_or_default()
}
