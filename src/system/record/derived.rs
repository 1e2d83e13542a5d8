//! Inputs that a run gets from its own records: outputs that drive the model (measured regressors), nonlinear terms computed from
//! them, derivatives `der(u)`, and gaps bridged, since a simulation needs a value at every sample.
//!
//! Between samples a recorded input is linear, so that its derivative is held: an integrator that sees these slopes integrates them back to
//! the input exactly, and their Fourier integral is `j w U` with the input's own end-point terms. At a sample the derivative is the mean
//! of both sides.

use super::channel::channels;
use super::run::{Place, Run};
use crate::code::Expressions;
use crate::dynamics::Point;
use fdm_grammar::Model;
use fdm_grammar::graph::{Graph, Leaf, Node, Signal};
use fdm_grammar::model::{Computed, Slope};
use fdm_grammar::op::ExprId;

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
    /// This run with the inputs that this model takes from the records of its outputs, or computes from them (at the
    /// values that the model gives its parameters): hidden inputs that the run has are replaced. Gaps of the record are bridged linearly and counted, as those of other inputs; the outputs
    /// stay as they are. In a model that knows no time, a sample with a gap is not compared.
    ///
    /// # Errors
    /// [`Incomplete`] when the run belongs to another model, an output that drives the model was never measured, or a term
    /// that drives it has no finite value, or an input is held whose derivative drives it.
    pub fn with_measured(&self, model: &Model) -> Result<Run, Incomplete> {
        self.clone().completed(model)
    }

    /// A run that is not needed any more with the inputs that this model takes from the records of its outputs.
    pub(super) fn completed(self, model: &Model) -> Result<Run, Incomplete> {
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
        let mut run = self;
        if (m, width) == (declared, declared) {
            return Ok(run);
        }
        run.held.truncate(declared);
        run.held.resize(m, false);
        run.stated.resize(declared, false);
        run.stated.resize(m, true);
        run.input_gaps.truncate(declared);
        let hidden = vec![f64::NAN; m - declared];
        run.inputs =
            run.inputs.chunks(width.max(1)).flat_map(|row| row[..declared].iter().chain(&hidden)).copied().collect();
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
                    fill_slopes(&run.time, &mut run.inputs, m, k, slope);
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

/// An expression with the inputs that it reads.
struct Source<'a> {
    computed: &'a Computed,
    nodes: Vec<ExprId>,
}

impl Run {
    /// Fills input `k` from the inputs in front of it and says where something was missing: a source, or a finite value.
    /// `gaps` are those of all inputs so far. There the value is bridged, as in a record; NaN stays where no sample has one.
    pub(super) fn compute(&mut self, model: &Model, k: usize, computed: &Computed, gaps: &[Vec<bool>]) -> Vec<bool> {
        let m = self.held.len();
        let source = Source { computed, nodes: computed.graph.reachable([computed.expr]) };
        let theta = model.start();
        let mut code = Expressions::new(&computed.graph, &[computed.expr], 0, m);
        let taus = source.delays(&theta);
        let mut missing = vec![false; self.len()];
        source.inputs().filter_map(|i| gaps.get(i)).for_each(|gaps| {
            missing.iter_mut().zip(gaps).for_each(|(missing, gap)| *missing |= gap);
        });
        // a product of steps is a step
        let held = !source.knows_time() && source.inputs().count() > 0 && source.inputs().all(|i| self.held[i]);
        let vanishing: Vec<bool> = (0..m as u32).map(|k| model.vanishing().any(|v| v == k)).collect();
        let (first, last) = (self.time.first().copied(), self.time.last().copied());
        let within = |t: f64| first.is_some_and(|first| first <= t) && last.is_some_and(|last| t < last);
        let (mut drive, mut value) = (vec![0.0; m + taus.len()], [0.0]);
        for (sample, missing) in missing.iter_mut().enumerate() {
            let t = self.time[sample];
            drive[..m].copy_from_slice(&self.inputs[sample * m..][..m]);
            if !held {
                (0..m).filter(|k| vanishing[*k]).for_each(|k| drive[k] = self.slope_at(k, sample));
            }
            for (place, (input, tau)) in drive[m..].iter_mut().zip(&taus) {
                *place = match vanishing[*input] && !within(t - tau) {
                    true => 0.0,
                    false => self.input(*input, Place::new(&self.time, t - tau)).0,
                };
            }
            code.evaluate(Point { t, x: &[], drive: &drive, known: &theta }, &mut value);
            let finite = value[0].is_finite();
            *missing |= !finite;
            self.inputs[sample * m + k] = if finite { value[0] } else { f64::NAN };
        }
        self.held[k] = held;
        bridge(&self.time, &mut self.inputs, m, k, self.held[k]);
        missing
    }
}

impl Source<'_> {
    fn graph(&self) -> &Graph {
        &self.computed.graph
    }

    fn leaves(&self) -> impl Iterator<Item = Leaf> + '_ {
        self.nodes.iter().filter_map(|e| if let Node::Leaf(leaf) = self.graph().node(*e) { Some(leaf) } else { None })
    }

    /// The inputs that are read, now or earlier.
    fn inputs(&self) -> impl Iterator<Item = usize> + '_ {
        self.leaves().filter_map(|leaf| match leaf {
            Leaf::Input(k) => Some(k as usize),
            Leaf::Delayed(k) => Some(delayed_input(self.graph().delayed()[k as usize].signal)),
            _ => None,
        })
    }

    fn knows_time(&self) -> bool {
        self.leaves().any(|leaf| matches!(leaf, Leaf::Time | Leaf::Delayed(_)))
    }

    /// Input and delay of every delayed signal.
    fn delays(&self, theta: &[f64]) -> Vec<(usize, f64)> {
        let parameter = |leaf| if let Leaf::Param(k) = leaf { theta[k as usize] } else { f64::NAN };
        let delayed = self.graph().delayed().iter();
        delayed.map(|d| (delayed_input(d.signal), self.graph().evaluate(d.tau, parameter))).collect()
    }
}

/// States were replaced by their records when the expression was made.
fn delayed_input(signal: Signal) -> usize {
    match signal {
        Signal::Input(k) | Signal::State(k) => k as usize,
    }
}

/// Fills input `k` of `width` with the slopes of another; zero for a single sample.
pub(super) fn fill_slopes(time: &[f64], inputs: &mut [f64], width: usize, k: usize, slope: Slope) {
    let of = slope.of as usize;
    let rise =
        |inputs: &[f64], s: usize| (inputs[(s + 1) * width + of] - inputs[s * width + of]) / (time[s + 1] - time[s]);
    let last = time.len().saturating_sub(1);
    let mut before = None;
    for s in 0..time.len() {
        let after = (s < last).then(|| rise(inputs, s));
        inputs[s * width + k] = match (before, after) {
            (Some(before), Some(after)) if slope.shown => 0.5 * (before + after),
            (_, Some(one)) | (Some(one), None) => one,
            (None, None) => 0.0,
        };
        before = after;
    }
}

impl Run {
    /// The derivative of an input at a sample, where input `k` holds its slopes: the mean of both sides.
    pub fn slope_at(&self, k: usize, sample: usize) -> f64 {
        let at = |s: usize| self.inputs[s * self.held.len() + k];
        0.5 * (at(sample.saturating_sub(1)) + at(sample))
    }
}

/// Rows with more places behind each, NaN.
pub(super) fn widened(inputs: &[f64], n: usize, width: usize, more: usize) -> Vec<f64> {
    let rows =
        (0..n).flat_map(|s| inputs[s * width..][..width].iter().copied().chain(std::iter::repeat_n(f64::NAN, more)));
    rows.collect()
}

/// Fills the gaps (NaN) of input `k` of `width` and gives their number. Between two values linearly in time, or with
/// the value before when the input is held; before the first and after the last value with that value. Samples
/// stay NaN when there is no value at all.
pub fn bridge(time: &[f64], inputs: &mut [f64], width: usize, k: usize, held: bool) -> usize {
    let mut gaps = 0;
    let mut before: Option<usize> = None;
    let mut sample = 0;
    while sample < time.len() {
        if !inputs[sample * width + k].is_nan() {
            before = Some(sample);
            sample += 1;
            continue;
        }
        let after = (sample..time.len()).find(|s| !inputs[s * width + k].is_nan());
        let end = after.unwrap_or(time.len());
        for s in sample..end {
            let value = |s: usize| inputs[s * width + k];
            inputs[s * width + k] = match (before, after) {
                (Some(b), Some(a)) if !held => {
                    let part = (time[s] - time[b]) / (time[a] - time[b]);
                    value(b) + part * (value(a) - value(b))
                }
                (Some(b), _) => value(b),
                (None, Some(a)) => value(a),
                (None, None) => f64::NAN,
            };
        }
        gaps += end - sample;
        sample = end;
    }
    gaps
}

/// Where samples have no neighbours in time, a value of an input cannot be bridged: such samples are not compared.
pub(super) fn compare_not(inputs: &[f64], width: usize, measured: &mut [f64], outputs: usize) {
    if width == 0 || outputs == 0 {
        return;
    }
    for (row, compared) in inputs.chunks_exact(width).zip(measured.chunks_exact_mut(outputs)) {
        if row.iter().any(|v| v.is_nan()) {
            compared.fill(f64::NAN);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::{Incomplete, Run};
    use fdm_grammar::{Model, Source, compile};

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
            stated: Vec::new(),
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

    fn carried(text: &str) -> Model {
        compile(&Source::new("m.fdm", text)).unwrap_or_else(|e| panic!("{e:?}")).model.carried().unwrap().model
    }

    fn four_samples(held: bool) -> Run {
        Run {
            name: "r".into(),
            time: vec![0.0, 1.0, 2.0, 4.0],
            inputs: vec![1.0, 2.0, -3.0, 4.0],
            held: vec![held],
            measured: vec![10.0, 1.0, NAN, 2.0, 30.0, 3.0, 40.0, 4.0],
            input_gaps: vec![0],
            stated: Vec::new(),
            output_gaps: vec![1, 0],
        }
    }

    fn column(run: &Run, k: usize) -> Vec<f64> {
        run.inputs.iter().skip(k).step_by(run.held.len()).copied().collect()
    }

    #[test]
    fn terms_are_computed_from_inputs_records_time_and_known_parameters() {
        let model = carried(
            "model m { input u; state x, z; param a = 1, s = 4 fixed; der(x) = a*x*u*t + tanh(z/s); \
             der(z) = u^2 + u*delay(x, 0.5); output x_m = 10*x, z_m = z + 1; }",
        );
        let names: Vec<&str> = model.inputs.iter().map(|i| i.quantity.name.as_str()).collect();
        assert_eq!(&names[..3], ["u", "measured(x_m)", "measured(z_m)"]);
        let done = four_samples(true).with_measured(&model).unwrap();
        let at =
            |name: &str| column(&done, names.iter().position(|n| *n == name).unwrap_or_else(|| panic!("{names:?}")));
        assert_eq!(at("u^2"), [1.0, 4.0, 9.0, 16.0]);
        let near =
            |a: Vec<f64>, b: [f64; 4]| assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12), "{a:?} {b:?}");
        near(at("measured(tanh(z/s))"), [0.0, 0.25, 0.5, 0.75].map(f64::tanh));
        // x is 1, 2 (bridged), 3, 4; half a unit earlier 1, 1.5, 2.5, 3.75
        near(at("measured(u*delay(x, 0.5))"), [1.0, 3.0, -7.5, 15.0]);
        let triple = names.iter().position(|n| n.contains("t*") || n.contains("*t)")).unwrap();
        near(column(&done, triple), [0.0, 4.0, -18.0, 64.0]);
        assert_eq!(done.input_gaps[triple], 1, "the gap of the record is one here too");
        let square = names.iter().position(|n| *n == "u^2").unwrap();
        assert!(done.held[square] && !done.held[triple], "what is made of held inputs is held");
        assert!(!four_samples(false).with_measured(&model).unwrap().held[square]);
        assert_eq!(done.with_measured(&model).unwrap().inputs, done.inputs, "again is the same");
    }

    #[test]
    fn values_that_do_not_exist_are_bridged_and_none_at_all_is_told() {
        let text =
            "model m { input u; state x, z; param a = 1; der(x) = a*sqrt(u); der(z) = -z; output x_m = x, z_m = z; }";
        let done = four_samples(false).with_measured(&carried(text)).unwrap();
        let root = column(&done, 1);
        assert!((root[2] - (2f64.sqrt() + (2.0 - 2f64.sqrt()) / 3.0)).abs() < 1e-12, "{root:?}");
        assert_eq!(done.input_gaps[1], 1);
        let never = carried(&text.replace("sqrt(u)", "log(-u^2)"));
        let said = four_samples(false).with_measured(&never).unwrap_err();
        assert!(matches!(&said, Incomplete::NotComputed { .. }), "{said}");
        assert_eq!(said.to_string(), "the term `log(-u^2)` has no finite value in the run `r`, and drives the model");
    }

    fn three_samples(held: bool) -> Run {
        Run {
            name: "r".into(),
            time: vec![0.0, 1.0, 3.0],
            inputs: vec![1.0, 2.0, 6.0],
            held: vec![held],
            measured: vec![0.0, f64::NAN, 3.0],
            input_gaps: vec![0],
            stated: Vec::new(),
            output_gaps: vec![1],
        }
    }

    #[test]
    fn slopes_are_held_where_they_drive_and_means_where_they_are_shown() {
        let model = model("model m { input u; state x; der(x) = der(u) - x; output y = x + 2*der(u); }");
        let names: Vec<&str> = model.inputs.iter().map(|i| i.quantity.name.as_str()).collect();
        assert_eq!(names, ["u", "der(u)", "der(u) at samples"]);
        let done = three_samples(false).with_measured(&model).unwrap();
        assert_eq!(done.inputs, [1.0, 1.0, 1.0, 2.0, 2.0, 1.5, 6.0, 2.0, 2.0]);
        assert_eq!(done.held, [false, true, false]);
        assert_eq!(done.with_measured(&model).unwrap().inputs, done.inputs, "again is the same");
        let said = three_samples(true).with_measured(&model).unwrap_err();
        assert!(matches!(said, Incomplete::Held { .. }), "{said}");
        assert_eq!(
            said.to_string(),
            "the input `u` is held between samples in the run `r`, so that it jumps and `der(u)` does not exist"
        );
    }

    #[test]
    fn what_is_shown_only_needs_no_drive_and_records_have_derivatives_too() {
        let shown = model("model m { input u; output y = der(u)*2; }");
        assert_eq!(shown.inputs.len(), 2);
        assert!(shown.inputs[1].slope.is_some_and(|s| s.shown));
        let record = model("model m { input u; state x; der(x) = u + der(measured(y)); output y = x; }");
        let done = three_samples(false).with_measured(&record).unwrap();
        assert_eq!(done.inputs[1..3], [0.0, 1.0], "0, 1 (bridged), 3");
        assert_eq!((done.inputs[5], done.input_gaps), (1.0, vec![0, 1, 1]));
    }

    #[test]
    fn gaps_are_bridged_between_neighbours_and_filled_at_the_ends() {
        const NAN: f64 = f64::NAN;
        let time = [0.0, 1.0, 2.0, 4.0, 5.0, 6.0];
        let both = [NAN, NAN, 1.0, 7.0, NAN, 7.0, NAN, 9.0, 4.0, NAN, NAN, NAN];
        let mut inputs = both;
        assert_eq!(bridge(&time, &mut inputs, 2, 0, false), 4);
        assert_eq!(inputs.iter().step_by(2).copied().collect::<Vec<_>>(), [1.0, 1.0, 1.75, 3.25, 4.0, 4.0]);
        assert_eq!(bridge(&time, &mut inputs, 2, 1, true), 3);
        assert_eq!(inputs.iter().skip(1).step_by(2).copied().collect::<Vec<_>>(), [7.0, 7.0, 7.0, 9.0, 9.0, 9.0]);
        let mut held = both;
        bridge(&time, &mut held, 2, 0, true);
        assert_eq!(held.iter().step_by(2).copied().collect::<Vec<_>>(), [1.0, 1.0, 1.0, 1.0, 4.0, 4.0]);
    }
}
