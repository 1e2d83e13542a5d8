//! Requirements: `requirement name = expression in [lower, upper];`, numbers that an estimated model is used for.
//!
//! **In** an expanded tree and the model that it was checked to. **Out** [`Requirements`]: what must be measured at the model ([`Measure`]: of its
//! modes, its linear responses, its responses to standard inputs), and a model without states whose inputs are these measures and whose outputs are
//! the requirements. So names, units and derivatives of the expressions are those of the language. **Never** computes a measure: that is for
//! whoever has numbers. **Start** at [`Requirements`]; the functions are in `forms.rs`.

mod forms;
mod read;

pub use forms::{forms, is_measure};
pub(crate) use read::{mentioned, requirements, taken};

use crate::model::{Model, Quantity};
use crate::unit::Unit;

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
