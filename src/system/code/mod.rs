//! Programs made runnable: a schedule to [`Dynamics`], by machine code or by the bytecode that it must equal to the bit ([`compile`]).
//!
//! Nothing is reordered, contracted or approximated: a result has one value, whoever computes it. The reference is `tape.rs`, the fast
//! path `jit/`; [`verify`] compares every partial with a numerical derivative.

mod expressions;
#[cfg(feature = "jit")]
mod jit;
#[doc(hidden)]
pub mod sized;
#[cfg(test)]
mod specimen;
mod tape;
mod verification;

use crate::dynamics::Dynamics;
use fdm_grammar::Schedule;

pub use expressions::Expressions;
#[cfg(feature = "jit")]
pub use jit::Jit;
pub(crate) use tape::Bytecode;
pub use tape::Tape;
pub use verification::{Discrepancy, Nominal, TOLERANCE, Verification, verify};

/// Who evaluates a model. The results are the same bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Engine {
    /// Native code, made by Cranelift (feature `jit`); without the feature, or where no native code can be made, the tape.
    #[default]
    Jit,
    /// An interpreter: slower, on every machine.
    Tape,
}

/// Why there is no machine code.
#[derive(Debug, thiserror::Error)]
pub enum JitError {
    /// The compiler refused: this machine is not supported, or memory could not be made executable.
    #[error("no machine code can be made here: {0}")]
    #[cfg(feature = "jit")]
    Module(#[from] Box<cranelift_module::ModuleError>),
    /// The compiler stopped in the middle, or this machine is unknown to it.
    #[error("the compiler of machine code stopped unexpectedly")]
    Panicked,
    /// There is no thread to compile on.
    #[error("no thread to compile on: {0}")]
    Thread(#[from] std::io::Error),
    /// This build has no compiler of machine code.
    #[error("fdm was built without the feature `jit`")]
    NotBuilt,
}

/// The schedule as something that can be evaluated; where no native code can be made, the tape does it.
pub fn compile(schedule: &Schedule, engine: Engine) -> Box<dyn Dynamics> {
    #[cfg(feature = "jit")]
    if engine == Engine::Jit
        && let Ok(jit) = Jit::new(schedule)
    {
        return Box::new(jit);
    }
    #[cfg(not(feature = "jit"))]
    let _ = engine;
    Box::new(Tape::new(schedule))
}

/// The machine code of a model's programs, by name; none for a program that is too long to be compiled.
///
/// # Errors
/// [`JitError`] when no machine code can be made here.
pub fn listing(schedule: &Schedule) -> Result<Vec<(&'static str, Option<String>)>, JitError> {
    #[cfg(feature = "jit")]
    return Jit::new(schedule).map(|jit| jit.listing());
    #[cfg(not(feature = "jit"))]
    {
        let _ = schedule;
        Err(JitError::NotBuilt)
    }
}

#[cfg(test)]
mod tests {
    use super::specimen::{Xorshift, blank, random, ship};
    use super::*;
    use crate::dynamics::{Point, Step, Workspace, by_stages, by_stages_with_partials};
    use fdm_grammar::derive::{Jacobian, differentiate};
    use fdm_grammar::graph::{Leaf, Node};
    use fdm_grammar::op::{Build, ExprId, Op};
    use fdm_grammar::{Layout, Model};

    /// Bits, with one NaN: which NaN an operation makes is not ours to say.
    fn bits(values: &[f64]) -> Vec<u64> {
        values.iter().map(|v| if v.is_nan() { f64::NAN.to_bits() } else { v.to_bits() }).collect()
    }

    fn numbers(count: usize, random: &mut Xorshift) -> Vec<f64> {
        (0..count).map(|_| random.number()).collect()
    }

    /// The value of every node, straight from the table of operations.
    fn nodes(model: &Model, leaf: impl Fn(Leaf) -> f64) -> Vec<f64> {
        let mut values: Vec<f64> = Vec::new();
        for node in model.graph.nodes() {
            let value = match node {
                Node::Constant(bits) => f64::from_bits(*bits),
                Node::Leaf(l) => leaf(*l),
                Node::Apply(op, args) => {
                    let [a, b, c] = args.map(|a| values.get(a.index()).copied().unwrap_or(f64::NAN));
                    (op.row().value)(a, b, c)
                }
            };
            values.push(value);
        }
        values
    }

    const UNTOUCHED: f64 = 7.25;

    fn run(count: usize, program: impl FnOnce(&mut [f64])) -> Vec<f64> {
        let mut out = vec![UNTOUCHED; count + 2];
        program(&mut out[..count]);
        assert_eq!(out[count..], [UNTOUCHED; 2], "nothing is written behind the results");
        out.truncate(count);
        out
    }

    /// Numbers in the order rates, f_x, f_delay, f_theta as a row; the rest of it keeps what [`run`] put there.
    fn in_row(numbers: &[u64], layout: &Layout) -> Vec<u64> {
        let (stage, patterns) = (&layout.stage, &layout.patterns);
        let rates = 0..layout.states;
        let by_state = stage.by_state.iter().map(|slot| *slot as usize);
        let by_delayed = (0..patterns.rates_by_delayed.len()).map(|k| stage.by_delayed + k);
        let by_param =
            patterns.rates_by_param.entries().map(|(_, i, j)| stage.by_param(i, j).expect("no parameter is fixed"));
        let mut row = vec![UNTOUCHED.to_bits(); stage.width];
        for (slot, number) in rates.chain(by_state).chain(by_delayed).chain(by_param).zip(numbers) {
            row[slot] = *number;
        }
        row
    }

    /// Both engines give what the graph says, in all programs and in steps.
    fn agree(mut model: Model, seed: u64) {
        let schedule = Schedule::new(&mut model);
        let d = differentiate(&mut model);
        let layout = &schedule.layout;
        let mut random = Xorshift(seed * 2 + 1);
        let theta = model.start();
        let (t, x) = (random.number(), numbers(layout.states, &mut random));
        let drive = numbers(3 * layout.drive(), &mut random);
        let values = nodes(&model, |leaf| match leaf {
            Leaf::Time => t,
            Leaf::State(k) => x[k as usize],
            Leaf::Input(k) => drive[k as usize],
            Leaf::Delayed(k) => drive[layout.inputs + k as usize],
            Leaf::Param(k) => theta[k as usize],
        });
        let of = |roots: Vec<ExprId>, jacobians: [&Jacobian; 3]| -> Vec<u64> {
            let entries = jacobians.into_iter().flat_map(|j| j.entries.clone());
            bits(&roots.into_iter().chain(entries).map(|e| values[e.index()]).collect::<Vec<_>>())
        };
        let rates =
            of(model.states.iter().map(|s| s.rate).collect(), [&d.rates.state, &d.rates.delayed, &d.rates.param]);
        let outputs = of(
            model.outputs.iter().map(|o| o.expr).collect(),
            [&d.outputs.state, &d.outputs.delayed, &d.outputs.param],
        );
        let by_input = of(Vec::new(), [&d.rates.input, &d.outputs.input, &Jacobian::default()]);
        let initial = of(model.states.iter().map(|s| s.initial).collect(), [&Jacobian::default(); 3]);
        let mut steps: Vec<Vec<u64>> = Vec::new();
        for engine in [Engine::Tape, Engine::Jit] {
            let dynamics = compile(&schedule, engine);
            let mut work = Workspace::new(&*dynamics);
            let known = run(layout.known, |out| dynamics.prepare(&theta, out, &mut work));
            assert_eq!(bits(&known[layout.initial.clone()]), initial, "{engine:?} {seed}: initial values");
            let at = Point { t, x: &x, drive: &drive, known: &known };
            let got = run(layout.states, |out| dynamics.rates(at, out, &mut work));
            assert_eq!(bits(&got), rates[..layout.states], "{engine:?} {seed}: rates");
            let got = run(layout.rate_slots(), |out| dynamics.rates_and_partials(at, out, &mut work));
            assert_eq!(bits(&got), in_row(&rates, layout), "{engine:?} {seed}: rates and partials");
            let got = run(layout.outputs, |out| dynamics.outputs(at, out, &mut work));
            assert_eq!(bits(&got), outputs[..layout.outputs], "{engine:?} {seed}: outputs");
            let got = run(layout.output_slots(), |out| dynamics.outputs_and_partials(at, out, &mut work));
            assert_eq!(bits(&got), outputs, "{engine:?} {seed}: outputs and partials");
            let got = run(layout.input_slots(), |out| dynamics.by_input(at, out, &mut work));
            assert_eq!(bits(&got), by_input, "{engine:?} {seed}: partials by inputs");

            let step = Step { t, h: 0.125, x: &x, drive: &drive, known: &known };
            let mut rows = Vec::new();
            steps.push(bits(&run(layout.states, |out| dynamics.step(step, out, &mut work))));
            steps.push(bits(&run(layout.states, |out| by_stages(&*dynamics, step, out, &mut work))));
            steps.push(bits(&run(layout.states, |out| {
                rows = run(4 * layout.rate_slots(), |r| dynamics.step_with_partials(step, out, r, &mut work));
            })));
            let mut expected = Vec::new();
            run(layout.states, |out| {
                expected =
                    run(4 * layout.rate_slots(), |r| by_stages_with_partials(&*dynamics, step, out, r, &mut work));
            });
            assert_eq!(bits(&rows), bits(&expected), "{engine:?} {seed}: rows of a step");
        }
        assert!(steps.iter().all(|s| *s == steps[0]), "{seed}: states after a step {steps:?}");
    }

    #[test]
    fn engines_agree_with_the_graph_on_models_that_nobody_would_write() {
        (0..60).for_each(|seed| agree(random(seed, true), seed));
    }

    #[test]
    fn engines_agree_on_the_ship() {
        agree(ship(), 1);
    }

    #[test]
    fn nothing_is_a_model_too() {
        agree(blank(0, 0, &[]), 1);
        agree(blank(2, 1, &[1.0]), 2);
    }

    #[test]
    fn a_long_program_runs_at_once() {
        let mut model = blank(1, 0, &[]);
        let x = model.graph.leaf(Leaf::State(0));
        let mut e = x;
        for k in 0..100_000 {
            let op = [Op::Add, Op::Mul, Op::Sub][k % 3];
            let c = model.graph.number(1.0 + (k % 7) as f64);
            let left = model.graph.apply(op, &[e, c]);
            e = model.graph.apply(Op::Atan, &[left]);
        }
        model.states[0].rate = e;
        let schedule = Schedule::new(&mut model);
        assert!(schedule.rates.instructions.len() > 100_000);
        let (jit, tape) = (compile(&schedule, Engine::Jit), Tape::new(&schedule));
        let (mut a, mut b) = (vec![0.0; tape.layout().rate_slots()], vec![0.0; tape.layout().rate_slots()]);
        let at = Point { t: 0.0, x: &[0.3], drive: &[], known: &[] };
        jit.rates_and_partials(at, &mut a, &mut Workspace::new(&*jit));
        tape.rates_and_partials(at, &mut b, &mut Workspace::new(&tape));
        assert_eq!(bits(&a), bits(&b));
        assert!(a[0].is_finite());
    }
}
