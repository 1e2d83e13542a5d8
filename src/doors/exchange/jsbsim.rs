//! A model as a system of JSBSim: the model's equations as functions of properties, its states as integrators ([`system`]).
//!
//! Nothing of JSBSim's own flight mechanics is used: the system works in any aircraft that names it (`<system file="..."/>`), on properties
//! below `fdm/MODEL/`. States are integrated by the method of Adams and Bashforth of order 2 at JSBSim's rate.
//! Source: JSBSim Reference Manual, flight control components and functions.

use crate::Stamp;
use crate::xml::lines;
use fdm_grammar::graph::Signal;
use fdm_grammar::model::{Origin, Quantity};
use fdm_grammar::op::Op;
use fdm_grammar::schedule::{Operand, Program};
use fdm_system::Model;
use fdm_system::dynamics::Workspace;
use maud::{Markup, html};
use std::collections::BTreeSet;

/// What a system of JSBSim cannot be.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Unsuited {
    /// A state with hard limits, which the integrators do not know.
    #[error("`{0}` has limits, which JSBSim's integrators do not know: write `limit {0} in [a, b] smooth w;`")]
    Limited(String),
    /// Events, which a system of JSBSim has no place for.
    #[error("the model has events (`when`), for which a system of JSBSim has no place")]
    Events,
    /// A first sample, which JSBSim does not keep.
    #[error("the model takes `initial({0})`: JSBSim does not keep first samples; make it a param")]
    First(String),
    /// A delay that looks ahead.
    #[error("the delay of `{0}` is negative: a system cannot look ahead")]
    Ahead(String),
}

/// The names of properties.
struct Names {
    root: String,
    params: Vec<String>,
    inputs: Vec<String>,
    states: Vec<String>,
    outputs: Vec<String>,
}

impl Names {
    fn of(model: &Model) -> Self {
        let definition = model.definition();
        let root = format!("fdm/{}", plain(model.name()));
        let mut taken = BTreeSet::new();
        let mut one = |quantity: &Quantity| {
            let mut name = format!("{root}/{}", plain(&quantity.name));
            while !taken.insert(name.clone()) {
                name.push('_');
            }
            name
        };
        let inputs: Vec<String> = definition.inputs.iter().map(|i| one(&i.quantity)).collect();
        let params = definition.params.iter().map(|p| match p.origin {
            // a value of the run is its input
            Origin::FirstSample(input) => inputs[input as usize].clone(),
            _ => one(&p.quantity),
        });
        let params = params.collect();
        let states = definition.states.iter().map(|s| one(&s.quantity)).collect();
        let outputs = definition.outputs.iter().map(|o| one(&o.quantity)).collect();
        Self { root, params, inputs, states, outputs }
    }
}

/// A name as properties may have it.
fn plain(name: &str) -> String {
    let plain: String = name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    if plain.starts_with(|c: char| c.is_ascii_alphabetic()) { plain } else { format!("m{plain}") }
}

/// The file of a system.
///
/// # Errors
/// [`Unsuited`].
pub fn system(model: &Model) -> Result<String, Unsuited> {
    let (definition, layout, schedule) = (model.definition(), model.layout(), model.schedule());
    if let Some(state) = layout.limited.first() {
        return Err(Unsuited::Limited(definition.states[*state as usize].quantity.name.clone()));
    }
    if definition.has_events() {
        return Err(Unsuited::Events);
    }
    if let Some((_, input)) = layout.first.iter().find(|(_, input)| !definition.inputs[*input as usize].known) {
        return Err(Unsuited::First(definition.inputs[*input as usize].quantity.name.clone()));
    }
    let mut known = vec![0.0; layout.known];
    let theta = definition.start().iter().map(|v| if v.is_finite() { *v } else { 0.0 }).collect::<Vec<_>>();
    model.dynamics().prepare(&theta, &mut known, &mut Workspace::new(model.dynamics()));
    let names = Names::of(model);
    let signal = |d: usize| match layout.delayed[d] {
        Signal::Input(k) => &definition.inputs[k as usize].quantity.name,
        Signal::State(k) => &definition.states[k as usize].quantity.name,
    };
    if let Some(d) = known[layout.tau.clone()].iter().position(|tau| *tau < 0.0) {
        return Err(Unsuited::Ahead(signal(d).clone()));
    }
    let writer = Writer { model, names: &names, scale: definition.time.factor };
    let wanted = writer.wanted();
    let values = definition.params.iter().zip(&names.params).filter(|(p, _)| !p.is_recorded());
    let (stamp, at_start) = (Stamp::of(model), format!("{}/at-start", names.root));
    let body = html! {
        system name=(plain(model.name())) {
            @for (param, name) in values { property value=(number(param.value)) { (name) } }
            @for name in &names.inputs { property value="0" { (name) } }
            @for name in &names.states { property value="0" { (name) } }
            channel name=(format!("{} parameters", plain(model.name()))) {
                (writer.program(&schedule.prepare, "p", &wanted, &|slot| writer.known(slot)))
            }
            @for name in &names.states { property value="0" { (format!("{name}-rate")) } }
            @for k in writer.delayed_inputs() { property value="0" { (writer.before(Signal::Input(k))) } }
            channel name=(format!("{} states", plain(model.name()))) {
                // the passes that JSBSim makes before the start move nothing
                (defined(&at_start, &html! {
                    product { value { "-1" } le { property { "simulation/sim-time-sec" } value { "0" } } }
                }))
                (writer.delays(&known[layout.tau.clone()]))
                @for state in &names.states {
                    pid name=(format!("{state}-moved")) {
                        input { (format!("{state}-rate")) }
                        kp { "0" }
                        ki type="ab2" { (number(1.0 / writer.scale)) }
                        kd { "0" }
                        trigger { (at_start) }
                    }
                }
                @for (k, state) in names.states.iter().enumerate() {
                    (defined(state, &html! { sum { property { (writer.initial(k)) } property { (format!("{state}-moved")) } } }))
                }
                (writer.seen())
                (writer.program(&schedule.rates, "f", &all(&schedule.rates), &|slot| format!("{}-rate", names.states[slot as usize])))
            }
            channel name=(format!("{} outputs", plain(model.name()))) {
                (writer.program(&schedule.outputs, "y", &all(&schedule.outputs), &|slot| names.outputs[slot as usize].clone()))
            }
        }
    };
    let said = format!("Written by fdm {}; {stamp}", env!("CARGO_PKG_VERSION"));
    Ok(format!("<?xml version=\"1.0\"?>\n<!-- {said} -->\n{}\n", lines(&body.into_string())))
}

fn number(value: f64) -> String {
    format!("{value:?}")
}

/// A delay of whole frames stays that, whatever rounding makes of its division by the length of a frame.
const WHOLE: f64 = 1.0 + 1e-9;

/// A function that sets a property.
fn defined(name: &str, value: &Markup) -> Markup {
    html! { fcs_function name=(name) { function { (value) } } }
}

/// Slots of all results.
fn all(program: &Program) -> BTreeSet<u32> {
    program.results.iter().map(|r| r.slot).collect()
}

struct Writer<'a> {
    model: &'a Model,
    names: &'a Names,
    /// The model's unit of time in seconds.
    scale: f64,
}

impl Writer<'_> {
    /// Results of `prepare` that are needed: initial values, and what rates and outputs read.
    fn wanted(&self) -> BTreeSet<u32> {
        let schedule = self.model.schedule();
        let mut wanted: BTreeSet<u32> = schedule.layout.initial.clone().map(|k| k as u32).collect();
        for program in [&schedule.rates, &schedule.outputs] {
            let arguments = program.instructions.iter().flat_map(|i| i.args[..i.op.row().arity].iter());
            for operand in arguments.chain(program.results.iter().map(|r| &r.operand)) {
                if let Operand::Known(k) = operand {
                    wanted.insert(*k);
                }
            }
        }
        wanted
    }

    /// The property of a number that depends on parameters alone. A dash stands in the name of no model's variable.
    fn known(&self, slot: u32) -> String {
        format!("{}/known-{slot}", self.names.root)
    }

    /// That of a delayed signal.
    fn late(&self, d: usize) -> String {
        format!("{}/delayed-{d}", self.names.root)
    }

    /// The property of an initial value.
    fn initial(&self, state: usize) -> String {
        self.known((self.model.layout().initial.start + state) as u32)
    }

    /// The property that a delay reads, in the frame before: what a state has moved since the start, or an input.
    fn before(&self, signal: Signal) -> String {
        match signal {
            Signal::Input(k) => format!("{}-before", self.names.inputs[k as usize]),
            Signal::State(k) => format!("{}-moved", self.names.states[k as usize]),
        }
    }

    /// Delays, in front of all that moves: JSBSim's delay of n frames reaches back n - 1 frames behind what it reads, and this is of the
    /// frame before. Before the start a state has its initial value, and an input is 0.
    fn delays(&self, tau: &[f64]) -> Markup {
        let delayed = &self.model.layout().delayed;
        html! {
            @for (d, signal) in delayed.iter().enumerate() {
                actuator name=(format!("{}-moved", self.late(d))) {
                    input { (self.before(*signal)) }
                    @if tau[d] > 0.0 { delay type="time" { (number(tau[d] * self.scale * WHOLE)) } }
                }
            }
            @for k in self.delayed_inputs() {
                (defined(&self.before(Signal::Input(k)), &html! { sum { property { (self.names.inputs[k as usize]) } value { "0" } } }))
            }
        }
    }

    /// Inputs that are seen delayed, each once.
    fn delayed_inputs(&self) -> BTreeSet<u32> {
        let delayed = self.model.layout().delayed.iter();
        delayed.filter_map(|s| if let Signal::Input(k) = s { Some(*k) } else { None }).collect()
    }

    /// Delayed signals as the equations see them.
    fn seen(&self) -> Markup {
        let delayed = &self.model.layout().delayed;
        html! {
            @for (d, signal) in delayed.iter().enumerate() {
                @let moved = html! { property { (format!("{}-moved", self.late(d))) } };
                @match signal {
                    Signal::Input(_) => { (defined(&self.late(d), &html! { sum { (moved) value { "0" } } })) },
                    Signal::State(k) => {
                        (defined(&self.late(d), &html! { sum { (moved) property { (self.initial(*k as usize)) } } }))
                    },
                }
            }
        }
    }

    /// A program: a property for every instruction that these results need, and one for each of them.
    fn program(
        &self,
        program: &Program,
        letter: &str,
        wanted: &BTreeSet<u32>,
        named: &dyn Fn(u32) -> String,
    ) -> Markup {
        let mut needed = vec![false; program.instructions.len()];
        let results = || program.results.iter().filter(|r| wanted.contains(&r.slot));
        let mark = |operand: Operand, needed: &mut Vec<bool>| {
            if let Operand::Value(k) = operand {
                needed[k as usize] = true;
            }
        };
        results().for_each(|r| mark(r.operand, &mut needed));
        for k in (0..needed.len()).rev() {
            if needed[k] {
                let instruction = &program.instructions[k];
                instruction.args[..instruction.op.row().arity].iter().for_each(|a| mark(*a, &mut needed));
            }
        }
        let is_prepare = std::ptr::eq(program, &self.model.schedule().prepare);
        let read = |operand: Operand| -> Markup {
            let property = match operand {
                Operand::Constant(k) => return html! { value { (number(program.constants[k as usize])) } },
                Operand::Time => {
                    let time = html! { property { "simulation/sim-time-sec" } };
                    let same = self.scale == 1.0;
                    return if same {
                        time
                    } else {
                        html! { quotient { (time) value { (number(self.scale)) } } }
                    };
                }
                Operand::Value(k) => format!("{}/{letter}-{k}", self.names.root),
                Operand::State(k) => self.names.states[k as usize].clone(),
                Operand::Drive(k) => match (k as usize).checked_sub(self.names.inputs.len()) {
                    None => self.names.inputs[k as usize].clone(),
                    Some(d) => self.late(d),
                },
                Operand::Known(k) if is_prepare => self.names.params[k as usize].clone(),
                Operand::Known(k) => self.known(k),
            };
            html! { property { (property) } }
        };
        html! {
            @for (k, instruction) in program.instructions.iter().enumerate().filter(|(k, _)| needed[*k]) {
                (defined(&format!("{}/{letter}-{k}", self.names.root), &operation(instruction.op, &instruction.args.map(read))))
            }
            @for result in results() {
                (defined(&named(result.slot), &html! { sum { (read(result.operand)) value { "0" } } }))
            }
        }
    }
}

/// An operation as JSBSim has it.
fn operation(op: Op, [a, b, c]: &[Markup; 3]) -> Markup {
    let square = |x: &Markup| html! { product { (x) (x) } };
    // (e^x - e^-x)/2 and the like
    let exponentials = |x: &Markup| {
        let minus = html! { product { value { "-1" } (x) } };
        [html! { exp { (x) } }, html! { exp { (minus) } }]
    };
    match op {
        Op::Add => html! { sum { (a) (b) } },
        Op::Sub => html! { difference { (a) (b) } },
        Op::Mul => html! { product { (a) (b) } },
        Op::Div => html! { quotient { (a) (b) } },
        Op::Neg => html! { product { value { "-1" } (a) } },
        Op::Pow => html! { pow { (a) (b) } },
        Op::Sin => html! { sin { (a) } },
        Op::Cos => html! { cos { (a) } },
        Op::Tan => html! { tan { (a) } },
        Op::Asin => html! { asin { (a) } },
        Op::Acos => html! { acos { (a) } },
        Op::Atan => html! { atan { (a) } },
        Op::Atan2 => html! { atan2 { (a) (b) } },
        Op::Exp => html! { exp { (a) } },
        Op::Log => html! { ln { (a) } },
        Op::Log10 => html! { log10 { (a) } },
        Op::Sqrt => html! { pow { (a) value { "0.5" } } },
        Op::Hypot => html! { pow { sum { (square(a)) (square(b)) } value { "0.5" } } },
        Op::Abs => html! { abs { (a) } },
        Op::Min => html! { min { (a) (b) } },
        Op::Max => html! { max { (a) (b) } },
        Op::Sinh => {
            let [e, f] = exponentials(a);
            html! { product { value { "0.5" } difference { (e) (f) } } }
        }
        Op::Cosh => {
            let [e, f] = exponentials(a);
            html! { product { value { "0.5" } sum { (e) (f) } } }
        }
        // 1 - 2/(e^2x + 1), which is 1 where e^2x has left the numbers
        Op::Tanh => {
            let twice = html! { exp { product { value { "2" } (a) } } };
            html! { difference { value { "1" } quotient { value { "2" } sum { (twice) value { "1" } } } } }
        }
        Op::Sign => html! {
            difference { gt { (a) value { "0" } } lt { (a) value { "0" } } }
        },
        Op::Less => html! { lt { (a) (b) } },
        Op::LessEqual => html! { le { (a) (b) } },
        Op::Equal => html! { eq { (a) (b) } },
        Op::Select => html! { ifthen { (a) (b) (c) } },
        // models with foreign code are refused before
        Op::List | Op::External | Op::ExternalSlope | Op::ExternalCurvature => html! { value { "NaN" } },
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn equations_stand_in_functions_and_what_cannot_be_is_said() {
        let model = |text: &str| Model::from_text("m.fdm", text).unwrap();
        let text = system(&model(
            "model m { input u; param k = 2; state x = 1; der(x) = -k*x + tanh(u); output y = delay(x, 0.1); }",
        ));
        let text = text.unwrap();
        for part in
            ["<property value=\"2.0\">fdm/m/k</property>", "<ki type=\"ab2\">1.0</ki>", "fdm/m/x-moved", "fdm/m/y"]
        {
            assert!(text.contains(part), "{part}: {text}");
        }
        assert!(Stamp::find(&text).is_some());
        let limited = "model m { input u; state x = 0; limit x in [-1, 1]; der(x) = u; output y = x; }";
        assert_eq!(system(&model(limited)), Err(Unsuited::Limited("x".into())));
        let first = "model m { input u; state x = initial(u); der(x) = -x; output y = x; }";
        assert_eq!(system(&model(first)), Err(Unsuited::First("u".into())));
    }
}
