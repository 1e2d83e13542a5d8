//! A model and a run to the model's response and its exact sensitivities. Start at [`Simulator`].
//!
//! Method and steps are chosen once ([`choose_steps`]) and then kept, so that the sensitivities are the exact derivative of the discrete
//! response, not an approximation of the derivative of something else. A `Trajectory` is what every integrator advances: explicit
//! steps (`tangent.rs`; across events `events.rs`, cut at limits and kinks `cuts.rs`), implicit ones for stiff models (`stiff`), models with delayed states (`delayed`), and linear models by exact
//! discretisation (`discrete`).

mod blocks;
mod choice;
mod cuts;
mod delayed;
mod delayed_inputs;
mod discrete;
mod drive;
mod error;
mod event_steps;
mod events;
mod simulator;
mod step_control;
mod steps;
mod stiff;
mod tangent;
mod trajectory;

pub use blocks::{Block, OutputRow, PlaneSink, Planes, RowLayout, Sink};
pub use choice::{Accuracy, StepOptions, choose_steps};
pub use cuts::{rests, take_back};
pub use drive::Course;
pub use error::{Divergence, EventFault, Unsuited};
pub use simulator::{Simulator, SingleStep};
pub use step_control::{
    SOUND, UNSOUND, WorstError, error_of, integration_error, output_range, shortened, step_factor, worst_errors,
};
pub use steps::{Grid, Scheme, Steps};
