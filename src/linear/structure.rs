//! Which coefficients a linear model has, and which parameters move them.

use fdm_grammar::graph::Signal;

/// A coefficient that can be other than zero: of a signal in an equation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Term {
    /// The equation: rates of the states (0..n), then outputs (n..n + q).
    pub row: u32,
    /// The signal: states (0..n), inputs (n..n + m), then delayed signals.
    pub signal: u32,
}

/// The derivative of a coefficient by a parameter that can be other than zero.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Slope {
    /// Position in [`Structure::terms`].
    pub term: u32,
    /// Parameter, in the model's order.
    pub param: u32,
}

/// The derivative of a delay by a parameter that can be other than zero.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct TauSlope {
    /// Position in [`Structure::delayed`].
    pub delayed: u32,
    /// Parameter, in the model's order.
    pub param: u32,
}

/// The sparsity of a linear model and of its derivatives. Constants are left out: they are at zero frequency.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Structure {
    /// Number of states n.
    pub states: usize,
    /// Number of inputs m, hidden ones included.
    pub inputs: usize,
    /// Number of outputs q.
    pub outputs: usize,
    /// Number of parameters p, fixed ones included (these have no slopes).
    pub params: usize,
    /// What the delayed signals are delayed versions of.
    pub delayed: Vec<Signal>,
    /// Coefficients, rising.
    pub terms: Vec<Term>,
    /// Their derivatives, rising.
    pub slopes: Vec<Slope>,
    /// The derivatives of the delays, rising.
    pub tau_slopes: Vec<TauSlope>,
}

/// The numbers of a linear model at one vector of parameters, in the order of its [`Structure`].
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Values {
    /// Coefficients.
    pub terms: Vec<f64>,
    /// Their derivatives.
    pub slopes: Vec<f64>,
    /// Delays, one for each delayed signal.
    pub tau: Vec<f64>,
    /// Their derivatives.
    pub tau_slopes: Vec<f64>,
}
