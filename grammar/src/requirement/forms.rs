//! The functions that stand in requirements: one table for the reader, messages and documentation.

use super::{OfCourse, OfMode, OfResponse};

/// What an argument is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Argument {
    /// A state.
    State,
    /// A state or an output, perhaps with a minus.
    Signal,
    /// A state or an output, without a minus.
    Row,
    /// A state or an input.
    Column,
    /// An input.
    Input,
    /// A number: a time, above 0.
    Duration,
    /// A number: a frequency, above 0.
    Frequency,
    /// A number in the unit of the signal that was named last.
    Level,
    /// A number in the unit of the input that was named last.
    Size,
    /// A whole number from 1.
    Count,
    /// Standard inputs, one or more.
    Drives,
}

/// What a function asks for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Asks {
    Mode(OfMode),
    Coefficient,
    Response(OfResponse),
    Course(OfCourse),
    /// The value of a first signal when a second one passes a level.
    Reached,
    Zigzag,
}

/// A function.
#[derive(Debug, Clone, Copy)]
pub(super) struct Function {
    pub(super) name: &'static str,
    pub(super) form: &'static str,
    pub(super) asks: Asks,
}

const fn row(name: &'static str, form: &'static str, asks: Asks) -> Function {
    Function { name, form, asks }
}

/// Every function. A number that an argument gives stands as zero here.
pub(super) const FUNCTIONS: &[Function] = &[
    row("mode_frequency", "mode_frequency(x)", Asks::Mode(OfMode::Frequency)),
    row("mode_damping", "mode_damping(x)", Asks::Mode(OfMode::Damping)),
    row("mode_real", "mode_real(x)", Asks::Mode(OfMode::Real)),
    row("time_to_half", "time_to_half(x)", Asks::Mode(OfMode::TimeToHalf)),
    row("time_to_double", "time_to_double(x)", Asks::Mode(OfMode::TimeToDouble)),
    row("coefficient", "coefficient(x, u)", Asks::Coefficient),
    row("gain", "gain(y, u, frequency)", Asks::Response(OfResponse::Gain(0.0))),
    row("phase", "phase(y, u, frequency)", Asks::Response(OfResponse::Phase(0.0))),
    row("steady", "steady(y, u)", Asks::Response(OfResponse::Steady)),
    row("bandwidth", "bandwidth(y, u)", Asks::Response(OfResponse::Bandwidth)),
    row("phase_bandwidth", "phase_bandwidth(y, u)", Asks::Response(OfResponse::PhaseBandwidth)),
    row("gain_bandwidth", "gain_bandwidth(y, u)", Asks::Response(OfResponse::GainBandwidth)),
    row("phase_delay", "phase_delay(y, u)", Asks::Response(OfResponse::PhaseDelay)),
    row("crossover", "crossover(y, u)", Asks::Response(OfResponse::Crossover)),
    row("gain_margin", "gain_margin(y, u)", Asks::Response(OfResponse::GainMargin)),
    row("phase_margin", "phase_margin(y, u)", Asks::Response(OfResponse::PhaseMargin)),
    row("at", "at(y, time, step(u, size))", Asks::Course(OfCourse::At)),
    row("maximum", "maximum(y, duration, step(u, size))", Asks::Course(OfCourse::Maximum)),
    row("minimum", "minimum(y, duration, step(u, size))", Asks::Course(OfCourse::Minimum)),
    row("overshoot", "overshoot(y, duration, step(u, size))", Asks::Course(OfCourse::Overshoot)),
    row("rise_time", "rise_time(y, duration, step(u, size))", Asks::Course(OfCourse::RiseTime)),
    row("settling_time", "settling_time(y, duration, step(u, size))", Asks::Course(OfCourse::SettlingTime)),
    row("integral", "integral(y, duration, step(u, size))", Asks::Course(OfCourse::Integral)),
    row("when", "when(y, level, duration, step(u, size))", Asks::Course(OfCourse::When(0.0))),
    row("reached", "reached(x, y, level, duration, step(u, size))", Asks::Reached),
    row("zigzag_overshoot", "zigzag_overshoot(y, u, size, level, number, duration)", Asks::Zigzag),
];

/// The standard inputs.
pub(super) const DRIVES: &[(&str, &str, usize)] = &[
    ("hold", "hold(u, size)", 1),
    ("step", "step(u, size)", 1),
    ("pulse", "pulse(u, size, length)", 2),
    ("doublet", "doublet(u, size, length)", 2),
];

impl Function {
    pub(super) fn find(name: &str) -> Option<Self> {
        FUNCTIONS.iter().find(|f| f.name == name).copied()
    }

    /// What its arguments are.
    pub(super) fn arguments(self) -> &'static [Argument] {
        use Argument::{Column, Count, Drives, Duration, Frequency, Input, Level, Row, Signal, Size, State};
        match self.asks {
            Asks::Mode(_) => &[State],
            Asks::Coefficient => &[Row, Column],
            Asks::Response(OfResponse::Gain(_) | OfResponse::Phase(_)) => &[Signal, Input, Frequency],
            Asks::Response(_) => &[Signal, Input],
            Asks::Course(OfCourse::When(_)) => &[Signal, Level, Duration, Drives],
            Asks::Course(_) => &[Signal, Duration, Drives],
            Asks::Reached => &[Signal, Signal, Level, Duration, Drives],
            Asks::Zigzag => &[Signal, Input, Size, Level, Count, Duration],
        }
    }
}

/// Every function of requirements and how a call is written, standard inputs behind them.
pub fn forms() -> impl Iterator<Item = (&'static str, &'static str)> {
    FUNCTIONS.iter().map(|f| (f.name, f.form)).chain(DRIVES.iter().map(|(name, form, _)| (*name, *form)))
}

/// Whether a function measures something at a model.
pub fn is_measure(name: &str) -> bool {
    Function::find(name).is_some()
}
