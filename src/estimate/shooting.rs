//! Multiple shooting (Bock 1981): the record cut into segments whose initial states are free, with continuity as a
//! constraint, so that an unstable model cannot run away from the measurement.

/// How the record is cut.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shooting {
    /// So many segments in each run.
    Segments(usize),
    /// Segments of this length, in the model's time unit.
    Length(f64),
}
