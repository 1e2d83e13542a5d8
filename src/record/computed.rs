//! Inputs that are computed from what was recorded: nonlinear terms that a model takes as known.

use super::bridge::bridge;
use super::input::Place;
use super::run::Run;
use crate::code::Expressions;
use crate::dynamics::Point;
use fdm_grammar::Model;
use fdm_grammar::graph::{Graph, Leaf, Node, Signal};
use fdm_grammar::model::Computed;
use fdm_grammar::op::ExprId;

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::Incomplete;
    use fdm_grammar::{Source, compile};

    const NAN: f64 = f64::NAN;

    fn carried(text: &str) -> Model {
        compile(&Source::new("m.fdm", text)).unwrap_or_else(|e| panic!("{e:?}")).model.carried().unwrap().model
    }

    fn run(held: bool) -> Run {
        Run {
            name: "r".into(),
            time: vec![0.0, 1.0, 2.0, 4.0],
            inputs: vec![1.0, 2.0, -3.0, 4.0],
            held: vec![held],
            measured: vec![10.0, 1.0, NAN, 2.0, 30.0, 3.0, 40.0, 4.0],
            input_gaps: vec![0],
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
        let done = run(true).with_measured(&model).unwrap();
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
        assert!(!run(false).with_measured(&model).unwrap().held[square]);
        assert_eq!(done.with_measured(&model).unwrap().inputs, done.inputs, "again is the same");
    }

    #[test]
    fn values_that_do_not_exist_are_bridged_and_none_at_all_is_told() {
        let text =
            "model m { input u; state x, z; param a = 1; der(x) = a*sqrt(u); der(z) = -z; output x_m = x, z_m = z; }";
        let done = run(false).with_measured(&carried(text)).unwrap();
        let root = column(&done, 1);
        assert!((root[2] - (2f64.sqrt() + (2.0 - 2f64.sqrt()) / 3.0)).abs() < 1e-12, "{root:?}");
        assert_eq!(done.input_gaps[1], 1);
        let never = carried(&text.replace("sqrt(u)", "log(-u^2)"));
        let said = run(false).with_measured(&never).unwrap_err();
        assert!(matches!(&said, Incomplete::NotComputed { .. }), "{said}");
        assert_eq!(said.to_string(), "the term `log(-u^2)` has no finite value in the run `r`, and drives the model");
    }
}
