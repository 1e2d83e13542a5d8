//! Unstable modes that the frequency domain cannot see: what no output shows or no input moves is in no response, and grows all the same.

use fdm_system::linear::{LinearModel, Modes, Values};
use fdm_system::record::Run;
use num_complex::Complex64;

/// An unstable mode that is in no frequency response.
#[derive(Debug, Clone, PartialEq)]
pub struct UnobservableMode {
    /// The eigenvalue, in rad per unit of time.
    pub s: Complex64,
    /// Indices of the states that dominate it.
    pub states: Vec<usize>,
    /// Whether an output shows it.
    pub observable: bool,
    /// Whether an input moves it.
    pub controllable: bool,
}

/// The unstable modes without part in any response that grow e-fold within `duration`; one of a pair.
pub(crate) fn unobservable_modes(linear: &LinearModel, theta: &[f64], duration: f64) -> Vec<UnobservableMode> {
    let (mut linear, mut values) = (linear.clone(), Values::default());
    if theta.is_empty() || linear.evaluate(theta, &mut values).is_err() {
        return Vec::new();
    }
    let Ok(modes) = Modes::new(linear.structure(), &values) else { return Vec::new() };
    let unobservable = modes.modes.iter().filter(|m| m.s.re * duration > 1.0 && m.s.im >= 0.0 && !(m.shown && m.moved));
    let of = |m: &fdm_system::linear::Mode| UnobservableMode {
        s: m.s,
        states: m.dominant().collect(),
        observable: m.shown,
        controllable: m.moved,
    };
    unobservable.map(of).collect()
}

/// Length of the longest run.
pub(crate) fn longest(runs: &[Run]) -> f64 {
    let duration = |run: &Run| run.time.last().zip(run.time.first()).map_or(0.0, |(last, first)| last - first);
    runs.iter().map(duration).fold(0.0, f64::max)
}
