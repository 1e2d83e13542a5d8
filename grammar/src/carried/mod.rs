//! Nonlinear terms carried in as known inputs, so that what remains is linear (`F(theta) z` of the frequency-domain methods).
//!
//! **In** a checked [`Model`]. **Out** [`Carried`]: the same model, affine in states and inputs, in which every other
//! regressor is a hidden input computed from records, and what was carried in the user's words; or [`NotCarried`].
//! **Never** approximates, and never touches an equation that is affine already. **Start** at [`Model::carried`].

mod build;
mod obstacle;
mod plan;
#[cfg(test)]
mod tests;

pub use obstacle::{NotCarried, Obstacle};

use crate::model::Model;

/// A model whose nonlinear terms are inputs.
#[derive(Debug, Clone)]
pub struct Carried {
    /// Affine in states, inputs and delayed signals; its coefficients are those of the original. Nothing is changed in a
    /// model that was affine.
    pub model: Model,
    /// What became an input.
    pub terms: Vec<CarriedTerm>,
}

/// One regressor that became a hidden input.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CarriedTerm {
    /// The hidden input, by index.
    pub input: usize,
    /// What is computed, as it stands in the equations (`p*abs(p)`), without a delay that all of it has.
    pub text: String,
    /// The equations in which it stands: `der(p)`, `a_m`.
    pub equations: Vec<String>,
    /// The outputs whose records it is computed from.
    pub records: Vec<String>,
}

impl Model {
    /// The model with its nonlinear terms carried in as known inputs. Every rate and output that is not affine in states,
    /// inputs and delayed signals becomes a sum of coefficients (of parameters) times regressors: linear ones stay
    /// dynamic, of the others each is a hidden input (`Input::computed`), in which a state is its measured reading,
    /// `(record - b)/a` of the output that is `a*state + b` with known `a` and `b`. A term of signals that share one delay is
    /// the delayed input, so that the delay can be estimated.
    ///
    /// # Errors
    /// [`NotCarried`] with every term that can not be computed from records, and what would help.
    pub fn carried(&self) -> Result<Carried, NotCarried> {
        let plan = plan::Plan::new(self)?;
        Ok(build::build(self, plan))
    }
}
