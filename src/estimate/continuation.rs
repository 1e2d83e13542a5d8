//! Record-length continuation (Goodman & Sargent 1971, section III): a short record first, then longer ones, each from
//! the result of the one before.

/// Whether and how the record is lengthened.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum Continuation {
    /// Only as a rescue, when the start values cannot be used or lead astray.
    #[default]
    Auto,
    /// Never.
    Never,
    /// These shares of every run, rising; the whole record comes last without being asked for.
    Shares(Vec<f64>),
    /// Up to these times since the run began, in the model's time unit, rising; the whole record comes last.
    Times(Vec<f64>),
}
