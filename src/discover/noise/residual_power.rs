//! What is left of bins when a part of them has been fitted away.

/// What is left of the bins of a cell.
#[derive(Debug, Clone, Copy)]
pub struct ResidualPower {
    /// log f
    pub log_frequency: f64,
    /// Mean square of what is left: its sum over `freedom`.
    pub power: f64,
    /// Bins less leverage, n - h.
    pub freedom: f64,
}
