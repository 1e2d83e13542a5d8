//! What is asked of a design: the model, what is known of it, and what the next run may be.

use fdm_grammar::diagnostic::nearest;
use fdm_system::Model;
use fdm_system::record::Run;

/// What is asked.
#[derive(Debug, Clone)]
pub struct Question<'a> {
    /// The model.
    pub model: &'a Model,
    /// All its parameters (p), as far as they are known; those of each run as the next run is expected to begin.
    pub theta: Vec<f64>,
    /// Standard deviation of the noise of each output (q).
    pub deviations: Vec<f64>,
    /// Runs that were made already, each with all its parameters.
    pub known: Vec<(Run, Vec<f64>)>,
    /// Where each input stands before it moves (m).
    pub rest: Vec<f64>,
    /// How far each input moves (m); none where it does not.
    pub heights: Vec<Option<f64>>,
    /// How fast each input may move (m), in its unit per unit of time; none where it may jump.
    pub rates: Vec<Option<f64>>,
    /// How far each output may move from where it begins (q); none where that does not matter.
    pub limits: Vec<Option<f64>>,
    /// Length of the next run.
    pub duration: f64,
    /// Time between its samples.
    pub dt: f64,
    /// How many runs are planned, one after the other.
    pub runs: usize,
}

/// What cannot be asked.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Asked {
    /// A model without inputs.
    #[error("model `{model}` has no input that could be moved")]
    NoInput {
        /// The model.
        model: String,
    },
    /// An input that is a record's derivative or an output's measurement.
    #[error("`{input}` follows from a record: what it will do cannot be planned")]
    Hidden {
        /// The input.
        input: String,
    },
    /// Nothing moves.
    #[error("nothing says how far inputs may move: say it with --amplitude {input}=VALUE, or give a run with --data")]
    Still {
        /// An input.
        input: String,
    },
    /// A name that is none.
    #[error("the model has no input `{name}`{hint}")]
    Unknown {
        /// The name.
        name: String,
        /// What may have been meant.
        hint: String,
    },
    /// Times that make no run.
    #[error(
        "a run of {duration} with {dt} between samples has {samples} samples; from {FEWEST} to {MOST} are possible"
    )]
    Samples {
        /// Its length.
        duration: f64,
        /// Between samples.
        dt: f64,
        /// How many that makes.
        samples: f64,
    },
    /// A height or deviation that is none.
    #[error("{what} is {value}; a finite number above 0 is needed")]
    Size {
        /// Of what.
        what: String,
        /// The number.
        value: f64,
    },
    /// An output whose noise is not known.
    #[error(
        "nothing says how large the noise of `{output}` is: say it with --noise {output}=DEVIATION, in the model \
         (`noise {output} = ...;`), or give a result with --from-result"
    )]
    Noise {
        /// The output.
        output: String,
    },
    /// A model all of whose shared parameters are fixed.
    #[error("model `{model}` has no free parameter that runs share: there is nothing to determine")]
    NothingFree {
        /// The model.
        model: String,
    },
}

/// Samples of a run.
const FEWEST: f64 = 20.0;
const MOST: f64 = 200_000.0;

impl Asked {
    /// An input that the model does not have.
    pub fn unknown(model: &Model, name: &str) -> Self {
        let names = model.definition().inputs.iter().map(|i| i.quantity.name.as_str());
        let hint = nearest(name, names).map_or(String::new(), |h| format!("; did you mean `{h}`?"));
        Self::Unknown { name: name.into(), hint }
    }
}

impl Question<'_> {
    /// Number of samples of the next run.
    pub(super) fn samples(&self) -> usize {
        (self.duration / self.dt).round() as usize + 1
    }

    /// Everything that makes it impossible to answer.
    ///
    /// # Errors
    /// All of [`Asked`] that holds.
    pub(super) fn examine(&self) -> Result<(), Vec<Asked>> {
        let definition = self.model.definition();
        let mut found = Vec::new();
        if definition.inputs.is_empty() {
            found.push(Asked::NoInput { model: definition.name.clone() });
        }
        let hidden = definition.inputs.iter().filter(|i| !i.is_declared());
        found.extend(hidden.map(|i| Asked::Hidden { input: i.quantity.name.clone() }));
        if let (Some(first), true) = (definition.inputs.first(), self.heights.iter().all(Option::is_none)) {
            found.push(Asked::Still { input: first.quantity.name.clone() });
        }
        let samples = self.duration / self.dt + 1.0;
        if !(FEWEST..=MOST).contains(&samples) {
            found.push(Asked::Samples { duration: self.duration, dt: self.dt, samples: samples.round() });
        }
        let bad = |v: f64| !(v.is_finite() && v > 0.0);
        for (input, rate) in definition.inputs.iter().zip(&self.rates) {
            let what = format!("the fastest motion of `{}`", input.quantity.name);
            found.extend(rate.filter(|v| bad(*v)).map(|value| Asked::Size { what, value }));
        }
        for (output, limit) in definition.outputs.iter().zip(&self.limits) {
            let what = format!("the limit of `{}`", output.quantity.name);
            found.extend(limit.filter(|v| bad(*v)).map(|value| Asked::Size { what, value }));
        }
        for (input, height) in definition.inputs.iter().zip(&self.heights) {
            let value = height.unwrap_or(1.0).abs();
            let what = format!("the height of `{}`", input.quantity.name);
            found.extend(bad(value).then_some(Asked::Size { what, value }));
        }
        for (output, value) in definition.outputs.iter().zip(&self.deviations) {
            let what = format!("the noise of `{}`", output.quantity.name);
            found.extend(bad(*value).then_some(Asked::Size { what, value: *value }));
        }
        if !definition.params.iter().any(|p| !p.fixed && !p.per_run) {
            found.push(Asked::NothingFree { model: definition.name.clone() });
        }
        if found.is_empty() { Ok(()) } else { Err(found) }
    }
}
