//! Find the mathematical model of a moving vehicle or a chemical reaction from measured data.

pub use fdm_estimate as estimate;
pub use fdm_estimate::{equation_error, residuals};
pub use fdm_system::{code, dynamics, frequency, linear, record, simulate, spectrum};

#[cfg(feature = "cli")]
pub use fdm_cli::language_server as lsp;
#[cfg(feature = "discover")]
pub use fdm_discover as diagnose;
#[cfg(feature = "report")]
pub use fdm_lab::{design, experiment, study};
#[cfg(feature = "report")]
pub use fdm_report as report;
#[cfg(feature = "report")]
pub use fdm_report::page;
#[cfg(feature = "report")]
pub use fdm_results::{comparison, documents, store};

pub use fdm_grammar::{effect, math};
/// A model compiled with the Rust program that holds it: an expression of type [`Model`].
///
/// What stands between the braces is a model exactly as in a `.fdm` file. It is checked when the program is compiled:
/// every mistake is an error at its place. The numbers come from Rust code, equal to the bit to those of the same
/// model loaded by [`Model::from_file`]. Warnings have no place in a build of stable Rust;
/// [`Model::warnings`] has them.
///
/// ```
/// let roll = fdm::model! {
///     model roll "roll decay of a ship" {
///         state p "roll rate" [rad/s], phi "roll angle" [rad] = 0.2;
///         param d = 0.1 [1/s], k = 1.5 [1/s^2];
///         der(p) = -d*p - k*phi;
///         der(phi) = p;
///         output phi_m [rad] = phi;
///     }
/// };
/// assert_eq!(roll.name(), "roll");
/// assert_eq!(roll.layout().states, 2);
/// ```
pub use fdm_macros::model;
pub use fdm_system::{Model, ModelError, NotTied, read_source};

/// The README, whose Rust code is run by the tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
pub struct Readme;
