//! Requirements: `requirement name = expression in [lower, upper];`, numbers that an estimated model is used for.
//!
//! **In** an expanded tree and the model that it was checked to. **Out** [`Requirements`]: what must be measured at the model ([`Measure`]: of its
//! modes, its linear responses, its responses to standard inputs), and a model without states whose inputs are these measures and whose outputs are
//! the requirements. So names, units and derivatives of the expressions are those of the language. **Never** computes a measure: that is for
//! whoever has numbers. **Start** at [`Requirements`]; the functions are in its table.
//!
//! The functions that stand in requirements: one table for the reader, messages and documentation.

use crate::model::{Model, Quantity};
use crate::unit::Unit;

mod read;

pub(crate) use read::{mentioned, requirements, taken};

/// The requirements of a model.
#[derive(Debug, Clone)]
pub struct Requirements {
    /// In the order of the text.
    pub list: Vec<Requirement>,
    /// What stands in them, each once for every place.
    pub measures: Vec<Measure>,
    /// A model without states: its first inputs are the measures, its first outputs the values of the requirements; parameters have the names
    /// that they have in the model itself. Its ties are open.
    pub model: Model,
}

/// One requirement.
#[derive(Debug, Clone)]
pub struct Requirement {
    /// Name, doc, unit.
    pub quantity: Quantity,
    /// Its expression, as it was written.
    pub text: String,
    /// Least value that is wanted, `-inf` when none is given.
    pub lower: f64,
    /// Greatest value that is wanted, `inf` when none is given.
    pub upper: f64,
}

impl Requirement {
    /// Whether a value is wanted or not; without limits it is reported only.
    pub fn has_limits(&self) -> bool {
        self.lower > f64::NEG_INFINITY || self.upper < f64::INFINITY
    }

    /// Whether a value lies between the limits; one that does not exist does not.
    pub fn holds(&self, value: f64) -> bool {
        value >= self.lower && value <= self.upper
    }
}

/// A state or an output.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Target {
    /// A state, by index.
    State(u32),
    /// An output, by index.
    Output(u32),
}

/// A state or an output, as it is or with the other sign.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Observed {
    /// Which.
    pub target: Target,
    /// Whether a minus stands before it.
    pub negative: bool,
}

/// An input during a standard manoeuvre, from the moment in which that begins; inputs that are not named stay where they are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drive {
    /// The input, by index.
    pub input: u32,
    /// What it does.
    pub form: Form,
}

/// The forms of standard inputs, in the unit of the input and in the model's time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Form {
    /// This much off its trim all the time, before the manoeuvre too.
    Hold(f64),
    /// A step from the trim.
    Step(f64),
    /// A step that is taken back after a time.
    Pulse(f64, f64),
    /// A pulse of each sign, one behind the other, each of this length.
    Doublet(f64, f64),
}

/// What is asked of a mode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OfMode {
    /// Undamped natural frequency, in rad per time.
    Frequency,
    /// Damping ratio.
    Damping,
    /// Real part.
    Real,
    /// Time to half the amplitude.
    TimeToHalf,
    /// Time to twice the amplitude.
    TimeToDouble,
}

/// What is asked of a frequency response.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum OfResponse {
    /// Size at a frequency.
    Gain(f64),
    /// Phase at a frequency, in deg.
    Phase(f64),
    /// Response to a constant input.
    Steady,
    /// The lesser of both bandwidths (ADS-33E-PRF, 3.3.2.1).
    Bandwidth,
    /// Frequency of a phase of -135 deg.
    PhaseBandwidth,
    /// Frequency at which the gain is 6 dB above that at a phase of -180 deg.
    GainBandwidth,
    /// Phase behind -180 deg at twice the frequency of -180 deg, over that frequency (ADS-33E-PRF).
    PhaseDelay,
    /// Frequency of unit gain.
    Crossover,
    /// Factor to unit gain at -180 deg, in dB.
    GainMargin,
    /// Phase above -180 deg at unit gain, in deg.
    PhaseMargin,
}

/// What is asked of a response over time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum OfCourse {
    /// Value at the end.
    At,
    /// Greatest value.
    Maximum,
    /// Least value.
    Minimum,
    /// Greatest excess over the end value, as a part of the change from start to end.
    Overshoot,
    /// From 10 % to 90 % of the change from start to end.
    RiseTime,
    /// Time behind which the response stays within 5 % of the change from the end value.
    SettlingTime,
    /// Integral over time.
    Integral,
    /// Time at which the signal first passes a level.
    When(f64),
    /// Value at the time at which another signal first passes a level.
    Reached(Observed, f64),
}

/// What is measured at a model.
#[derive(Debug, Clone, PartialEq)]
pub enum What {
    /// Of the mode in which a state has its greatest share.
    Mode {
        /// The state.
        state: u32,
        /// What of it.
        of: OfMode,
    },
    /// The coefficient of a state or an input in the linear equation of a state or an output.
    Coefficient {
        /// The equation.
        row: Target,
        /// The state or input: its place among the states, then the inputs.
        column: u32,
    },
    /// Of the frequency response of a signal to an input.
    Response {
        /// The signal.
        signal: Observed,
        /// The input.
        input: u32,
        /// What of it.
        of: OfResponse,
    },
    /// Of the response to standard inputs.
    Course {
        /// The signal.
        signal: Observed,
        /// How long it is followed.
        duration: f64,
        /// The inputs.
        drives: Vec<Drive>,
        /// What of it.
        of: OfCourse,
    },
    /// How far the signal goes on behind the level at which an input was put over: the overshoot of this number of a zigzag manoeuvre.
    Zigzag {
        /// The signal that decides when the input is put over.
        signal: Observed,
        /// The input.
        input: u32,
        /// The size of the input.
        size: f64,
        /// The level.
        level: f64,
        /// Which overshoot, from 1.
        number: u32,
        /// How long the manoeuvre lasts at most.
        duration: f64,
    },
}

/// A number that is measured at a model.
#[derive(Debug, Clone)]
pub struct Measure {
    /// As it was written.
    pub text: String,
    /// Its unit, where it is known.
    pub unit: Option<Unit>,
    /// What it is.
    pub what: What,
}

/// What an argument is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Argument {
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
enum Asks {
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
struct Function {
    name: &'static str,
    form: &'static str,
    asks: Asks,
}

const fn row(name: &'static str, form: &'static str, asks: Asks) -> Function {
    Function { name, form, asks }
}

/// Every function. A number that an argument gives stands as zero here.
const FUNCTIONS: &[Function] = &[
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
const DRIVES: &[(&str, &str, usize)] = &[
    ("hold", "hold(u, size)", 1),
    ("step", "step(u, size)", 1),
    ("pulse", "pulse(u, size, length)", 2),
    ("doublet", "doublet(u, size, length)", 2),
];

impl Function {
    fn find(name: &str) -> Option<Self> {
        FUNCTIONS.iter().find(|f| f.name == name).copied()
    }

    /// What its arguments are.
    fn arguments(self) -> &'static [Argument] {
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
