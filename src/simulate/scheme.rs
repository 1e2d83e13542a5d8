//! How the equations are integrated between samples.

/// How a run is integrated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Scheme {
    /// The classical Runge-Kutta method with a whole number of equal steps between neighbouring samples.
    #[default]
    RungeKutta,
}
