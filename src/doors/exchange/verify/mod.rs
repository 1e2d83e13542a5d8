//! What a file computes beside what its model computes ([`Verification`]).
//!
//! A unit is loaded as a simulator would; source is compiled by the system's compiler. Values and derivatives are compared with those of
//! the tape at points that nobody chose: around the initial values, inputs and parameters moved at random, always the same ones.
//! An estimator follows a record of random numbers beside the recursion of `fdm`, and both are compared at every sample.
//! **Start** at [`Artefact::read`]; whoever calls writes its [`files`](Artefact::files) to a folder, and then asks
//! for [`Artefact::compare`] there.
//!
//! Why a file is not compared ([`VerifyError`]).
//!
//! A point at which a model is looked at, and what the tape says there.

use crate::Stamp;
use crate::fmu::{DESCRIPTION, Files, Version, unpacked};
use crate::recursive::MARK;
use fdm_system::Model;
use fdm_system::code::Tape;
use fdm_system::dynamics::{Dynamics, Point, Workspace};
use fdm_units::UnitError;
use std::path::Path;

mod compiled;
mod recursion;
mod unit;

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

/// Why there is no comparison.
#[derive(Debug, thiserror::Error)]
pub enum VerifyError {
    /// Neither a unit nor source.
    #[error("`{0}` is neither a unit (.fmu) nor source (.c, .rs): of the others the stamp says all")]
    Kind(String),
    /// A unit that cannot be opened.
    #[error(transparent)]
    Unit(#[from] UnitError),
    /// The file is not text.
    #[error("is not UTF-8 text")]
    Text,
    /// Nothing says what the file was made from.
    #[error("has no stamp of fdm: it was not written by `fdm export`, or its last line was taken away")]
    Unstamped,
    /// The file was made from another model, or from other values.
    #[error(
        "was made from another model, or from other values of the parameters: it says {found}, and should say {expected}"
    )]
    Other {
        /// What stands in the file.
        found: Stamp,
        /// That of the model.
        expected: Stamp,
    },
    /// There is no compiler.
    #[error("no compiler `{0}` here: the stamp agrees, and values were not compared")]
    NoCompiler(String),
    /// The compiler refuses.
    #[error("`{compiler}` refuses the file: {said}")]
    Refused {
        /// Its name.
        compiler: String,
        /// Its first words.
        said: String,
    },
    /// An estimator that is none of this model.
    #[error("an estimator whose recursion cannot be repeated: {0}")]
    Estimator(String),
    /// The library cannot be loaded.
    #[error("its library cannot be loaded: {0}")]
    Unloadable(#[from] libloading::Error),
    /// A unit's function failed.
    #[error("`{function}` of the unit ends with status {status}")]
    Status {
        /// The function.
        function: &'static str,
        /// What it gave.
        status: i32,
    },
}

/// Names of arrays, each with its numbers.
type Numbers = Vec<(&'static str, Vec<f64>)>;

/// A point.
struct Site {
    t: f64,
    theta: Vec<f64>,
    x: Vec<f64>,
    drive: Vec<f64>,
}

/// Numbers between -1 and 1 (splitmix64).
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        (((z ^ (z >> 31)) >> 32) as f64) / f64::from(u32::MAX) * 2.0 - 1.0
    }

    /// Near given values, and not zero.
    fn around(&mut self, values: &[f64]) -> Vec<f64> {
        values.iter().map(|v| v + (0.05 * v.abs() + 0.001) * self.next()).collect()
    }
}

impl Site {
    /// The first one is that of the model's own values.
    fn new(model: &Model, seed: u64) -> Self {
        let (layout, mut noise) = (model.layout(), Noise(seed));
        let start: Vec<f64> = model.definition().start();
        let theta = if seed == 0 { start } else { noise.around(&start) };
        let mut known = vec![0.0; layout.known];
        model.dynamics().prepare(&theta, &mut known, &mut Workspace::new(model.dynamics()));
        Self {
            t: noise.next().abs(),
            x: noise.around(&known[layout.initial.clone()]),
            drive: (0..layout.drive()).map(|_| noise.next()).collect(),
            theta,
        }
    }

    /// What the tape says: everything that generated source computes.
    fn expected(&self, model: &Model) -> Numbers {
        let tape = Tape::new(model.schedule());
        let (layout, p) = (model.layout(), &model.layout().patterns);
        let (n, q, mut work) = (layout.states, layout.outputs, Workspace::new(&tape));
        let mut known = vec![0.0; layout.known];
        tape.prepare(&self.theta, &mut known, &mut work);
        let at = Point { t: self.t, x: &self.x, drive: &self.drive, known: &known };
        let mut row = vec![0.0; layout.rate_slots()];
        tape.rates_and_partials(at, &mut row, &mut work);
        let f_x = layout.stage.by_state.iter().map(|slot| row[*slot as usize]).collect();
        let f_delayed = row[layout.stage.by_delayed..][..p.rates_by_delayed.len()].to_vec();
        let f_theta = p.rates_by_param.entries().filter_map(|(_, i, j)| Some(row[layout.stage.by_param(i, j)?]));
        let mut out = vec![0.0; layout.output_slots()];
        tape.outputs_and_partials(at, &mut out, &mut work);
        let (y_x, rest) = out[q..].split_at(p.outputs_by_state.len());
        let (y_delayed, y_theta) = rest.split_at(p.outputs_by_delayed.len());
        let mut by_input = vec![0.0; layout.input_slots()];
        tape.by_input(at, &mut by_input, &mut work);
        let (f_u, y_u) = by_input.split_at(p.rates_by_input.len());
        vec![
            ("what parameters alone determine", known),
            ("derivatives of the states", row[..n].to_vec()),
            ("derivatives of the states", row[..n].to_vec()),
            ("their partials by states", f_x),
            ("their partials by delayed signals", f_delayed),
            ("their partials by parameters", f_theta.collect()),
            ("outputs", out[..q].to_vec()),
            ("outputs", out[..q].to_vec()),
            ("partials of outputs by states", y_x.to_vec()),
            ("partials of outputs by delayed signals", y_delayed.to_vec()),
            ("partials of outputs by parameters", y_theta.to_vec()),
            ("their partials by inputs", f_u.to_vec()),
            ("partials of outputs by inputs", y_u.to_vec()),
        ]
    }
}
