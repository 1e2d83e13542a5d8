//! A model and a run to the model's response and its exact sensitivities.
//!
//! **In** a [`crate::dynamics::Dynamics`] and a [`crate::record::Run`]. **Out** outputs at the samples and their
//! derivatives by parameters, or a [`Divergence`]. **Never** compares with measurements: that is `estimate`.
//! **Start** at [`Simulator`]; method and steps are chosen in `choice.rs`, one step of the sensitivities is in `tangent.rs`.
//!
//! The steps are chosen once and then kept, so that the sensitivities are the exact derivative of the discrete
//! response, not an approximation of the derivative of something else.

mod accuracy;
mod block;
mod choice;
mod control;
mod course;
mod delay_filter;
mod drive;
mod grid;
mod implicit;
mod moments;
mod observation;
mod planes;
mod probe;
mod recursion;
mod retarded;
mod scheme;
mod sensitivity;
mod simulator;
mod steps;
mod tangent;
pub(crate) mod vectors;

pub use accuracy::{Accuracy, error_of, integration_error};
pub use block::{Block, OutputRow, RowLayout, Sink};
pub use choice::{choose_steps, choose_steps_by, choose_steps_within};
pub(crate) use course::Course;
pub use grid::Grid;
pub use planes::{PlaneSink, Planes};
pub use scheme::Scheme;
pub use simulator::{Divergence, Simulator, Unsuited};
pub use steps::Steps;
