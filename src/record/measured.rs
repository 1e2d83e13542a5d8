//! Records of outputs that drive a model: the hidden inputs behind those that were declared.

use super::bridge;
use super::channel::channels;
use super::run::Run;
use super::slope;
use fdm_grammar::Model;

/// Why a run cannot drive a model.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Incomplete {
    /// The run was made for another model.
    #[error("the run `{run}` has {found} {what}, the model has {expected}")]
    OtherModel {
        /// Name of the run.
        run: String,
        /// `inputs` or `outputs`.
        what: &'static str,
        /// How many the run has.
        found: usize,
        /// How many the model declares.
        expected: usize,
    },
    /// An output that drives the model was never measured.
    #[error("the output `{output}` has no value in the run `{run}`, and `measured({output})` drives the model")]
    NotMeasured {
        /// Name of the run.
        run: String,
        /// Name of the output.
        output: String,
    },
    /// A nonlinear term that drives the model has no finite value.
    #[error("the term `{term}` has no finite value in the run `{run}`, and drives the model")]
    NotComputed {
        /// Name of the run.
        run: String,
        /// The term.
        term: String,
    },
    /// A derivative is wanted of an input that jumps.
    #[error(
        "the input `{input}` is held between samples in the run `{run}`, so that it jumps and `der({input})` does not exist"
    )]
    Held {
        /// Name of the run.
        run: String,
        /// Name of the input.
        input: String,
    },
}

impl Run {
    /// The same run with the inputs that this model takes from the records of its outputs, or computes from them (at the
    /// values that the model gives its parameters): hidden inputs that the run has are replaced. Gaps of the record are bridged linearly and counted, as those of other inputs; the outputs
    /// stay as they are. In a model that knows no time, a sample with a gap is not compared.
    ///
    /// # Errors
    /// [`Incomplete`] when the run belongs to another model, an output that drives the model was never measured, or a term
    /// that drives it has no finite value, or an input is held whose derivative drives it.
    pub fn with_measured(&self, model: &Model) -> Result<Run, Incomplete> {
        let channels = channels(model);
        let (declared, q, n) = (channels.inputs.len(), channels.outputs.len(), self.len());
        let other = |what, found, expected| Incomplete::OtherModel { run: self.name.clone(), what, found, expected };
        let width = self.held.len();
        if width < declared || self.inputs.len() != n * width || self.input_gaps.len() != width {
            return Err(other("inputs", width, declared));
        }
        if self.output_gaps.len() != q || self.measured.len() != n * q {
            return Err(other("outputs", self.output_gaps.len(), q));
        }
        let never = |k: &&usize| self.measured.iter().skip(**k).step_by(q).all(|v| v.is_nan());
        if let Some(k) = channels.driving.iter().find(never) {
            return Err(Incomplete::NotMeasured { run: self.name.clone(), output: channels.outputs[*k].name.clone() });
        }
        let m = model.inputs.len();
        let mut run = self.clone();
        run.held.truncate(declared);
        run.held.resize(m, false);
        run.input_gaps.truncate(declared);
        let hidden = vec![f64::NAN; m - declared];
        run.inputs =
            self.inputs.chunks(width.max(1)).flat_map(|row| row[..declared].iter().chain(&hidden)).copied().collect();
        if width == 0 {
            run.inputs = vec![f64::NAN; n * m];
        }
        let mut gaps: Vec<Vec<bool>> = vec![vec![false; n]; declared];
        for (k, input) in model.inputs.iter().enumerate().skip(declared) {
            let found = match (&input.computed, input.slope) {
                (Some(computed), _) => run.compute(model, k, computed, &gaps),
                (None, Some(slope)) => {
                    let of = slope.of as usize;
                    if run.held[of] {
                        let input = model.inputs[of].quantity.name.clone();
                        return Err(Incomplete::Held { run: run.name, input });
                    }
                    slope::fill(&run.time, &mut run.inputs, m, k, slope);
                    run.held[k] = !slope.shown;
                    gaps[of].clone()
                }
                (None, None) => run.record(k, input.measured.unwrap_or_default() as usize),
            };
            if run.inputs.iter().skip(k).step_by(m).all(|v| v.is_nan()) && n > 0 {
                let term = input.quantity.name.clone();
                return Err(Incomplete::NotComputed { run: run.name, term });
            }
            run.input_gaps.push(found.iter().filter(|gap| **gap).count());
            gaps.push(found);
        }
        if !channels.timed {
            // a sample without neighbours can not be bridged
            for (sample, row) in run.measured.chunks_mut(q.max(1)).enumerate() {
                if gaps.iter().any(|g| g[sample]) {
                    row.fill(f64::NAN);
                }
            }
        }
        Ok(run)
    }

    /// Fills input `k` from the record of an output, and says where it has gaps.
    fn record(&mut self, k: usize, output: usize) -> Vec<bool> {
        let (m, q) = (self.held.len(), self.output_gaps.len());
        for (inputs, measured) in self.inputs.chunks_mut(m).zip(self.measured.chunks(q)) {
            inputs[k] = measured[output];
        }
        let gaps = self.inputs.iter().skip(k).step_by(m).map(|v| v.is_nan()).collect();
        bridge(&self.time, &mut self.inputs, m, k, false);
        gaps
    }
}

/// Inputs of n samples: the first `declared` of each row, behind them the chosen columns of what was measured.
pub(super) fn beside(
    n: usize,
    (inputs, width): (&[f64], usize),
    declared: usize,
    (measured, outputs): (&[f64], usize),
    driving: &[usize],
) -> Vec<f64> {
    let mut rows = Vec::with_capacity(n * (declared + driving.len()));
    for sample in 0..n {
        rows.extend_from_slice(&inputs[sample * width..][..declared]);
        rows.extend(driving.iter().map(|k| measured[sample * outputs + k]));
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;
    use fdm_grammar::{Source, compile};

    const NAN: f64 = f64::NAN;

    fn model(text: &str) -> Model {
        compile(&Source::new("m.fdm", text)).unwrap_or_else(|e| panic!("{e:?}")).model
    }

    fn run() -> Run {
        Run {
            name: "r".into(),
            time: vec![0.0, 1.0, 3.0],
            inputs: vec![1.0, 2.0, 3.0],
            held: vec![true],
            measured: vec![10.0, NAN, NAN, 5.0, 40.0, 7.0],
            input_gaps: vec![0],
            output_gaps: vec![1, 1],
        }
    }

    #[test]
    fn records_stand_behind_the_declared_inputs() {
        let model =
            model("model m { input u; state x, z; der(x) = u*x; der(z) = z*x - u; output x_m = x, z_m = z + 2; }");
        let both = run().with_measured(&model.substituted(&[1, 0]).unwrap()).unwrap();
        assert_eq!(both.inputs, [1.0, 10.0, 5.0, 2.0, 20.0, 5.0, 3.0, 40.0, 7.0], "linear, and the first value before");
        assert_eq!((both.held, both.input_gaps), (vec![true, false, false], vec![0, 1, 1]));
        let same = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits());
        assert!(same(&both.measured, &run().measured), "what is compared has its gaps");

        let second = model.substituted(&[1]).unwrap();
        let again = run().with_measured(&model.substituted(&[0]).unwrap()).unwrap().with_measured(&second).unwrap();
        assert_eq!(again.inputs, run().with_measured(&second).unwrap().inputs, "hidden inputs are replaced");
        assert_eq!(again.with_measured(&model).unwrap().inputs, run().inputs);
    }

    #[test]
    fn runs_that_cannot_drive_the_model_are_refused() {
        let model = model("model m { input u; state x; der(x) = u*x; output x_m = x, z_m = u; }");
        let model = model.substituted(&[0]).unwrap();
        let silent = Run { measured: vec![NAN, 1.0, NAN, 2.0, NAN, 3.0], ..run() };
        let said = silent.with_measured(&model).unwrap_err().to_string();
        assert_eq!(said, "the output `x_m` has no value in the run `r`, and `measured(x_m)` drives the model");
        let none = Run { inputs: Vec::new(), held: Vec::new(), input_gaps: Vec::new(), ..run() };
        assert_eq!(none.with_measured(&model).unwrap_err().to_string(), "the run `r` has 0 inputs, the model has 1");
        let fewer = Run { measured: vec![1.0; 3], output_gaps: vec![0], ..run() };
        assert_eq!(fewer.with_measured(&model).unwrap_err().to_string(), "the run `r` has 1 outputs, the model has 2");
    }
}
