//! The straight-line programs, operation by operation, in the names of the model.

use super::Shown;
use fdm_grammar::emit::{Notation, statements};
use fdm_grammar::graph::{Leaf, Names};
use fdm_grammar::schedule::Operand;
use fdm_grammar::{Layout, Pattern, Program};
use fdm_results::documents::stages::{ProgramText, ScheduleStage, StageDocument};
use fdm_system::Model;

/// The language's own notation.
struct Own;

impl Notation for Own {
    fn number(&self, value: f64) -> String {
        value.to_string()
    }

    fn call(&self, name: &str, operands: &[String]) -> String {
        match (name, operands) {
            ("pow", [a, b]) => format!("{a}^{b}"),
            ("less", [a, b]) => format!("{a} < {b}"),
            ("less_equal", [a, b]) => format!("{a} <= {b}"),
            ("equal", [a, b]) => format!("{a} == {b}"),
            ("select", [c, a, b]) => format!("if {c} then {a} else {b}"),
            _ => format!("{name}({})", operands.join(", ")),
        }
    }

    fn define(&self, k: usize, expression: &str) -> String {
        format!("v{k} = {expression}")
    }
}

pub(super) fn schedule(model: &Model) -> Shown {
    let schedule = model.schedule();
    let labels = Labels { model, layout: &schedule.layout };
    let programs = [
        ("prepare", &schedule.prepare, labels.known()),
        ("rates", &schedule.rates, labels.rates()),
        ("rates_and_partials", &schedule.rates_and_partials, labels.stage()),
        ("outputs", &schedule.outputs, labels.outputs()),
        ("outputs_and_partials", &schedule.outputs_and_partials, labels.output_row()),
        ("by_input", &schedule.by_input, labels.input_row()),
    ];
    let (mut text, mut list) = (String::new(), Vec::new());
    for (name, program, slots) in programs {
        let (operations, results) = lines(model, name == "prepare", program, &slots);
        let count = |n: usize, what: &str| format!("{n} {what}{}", if n == 1 { "" } else { "s" });
        let head = [count(operations.len(), "operation"), count(results.len(), "result")].join(", ");
        text += &format!("{name}: {head}\n");
        operations.iter().chain(&results).for_each(|line| text += &format!("  {line}\n"));
        text.push('\n');
        list.push(ProgramText { operations, program: name.into(), results });
    }
    text.pop();
    let stage = ScheduleStage { model: model.name().into(), programs: list };
    Shown { text, document: StageDocument::Schedule(stage) }
}

/// Operations, and what becomes of their values.
fn lines(model: &Model, prepare: bool, program: &Program, slots: &[String]) -> (Vec<String>, Vec<String>) {
    let m = model.definition();
    let inputs = model.layout().inputs as u32;
    let place = |operand: Operand| match operand {
        Operand::Value(k) => format!("v{k}"),
        Operand::Constant(k) => program.constants[k as usize].to_string(),
        Operand::Time => "t".into(),
        Operand::State(k) => m.leaf(Leaf::State(k)),
        Operand::Drive(k) if k < inputs => m.leaf(Leaf::Input(k)),
        Operand::Drive(k) => m.leaf(Leaf::Delayed(k - inputs)),
        Operand::Known(k) if prepare => m.leaf(Leaf::Param(k)),
        Operand::Known(k) => format!("known[{k}]"),
    };
    let operations = statements(&Own, program, 0..program.instructions.len(), &place);
    let results = program.results.iter().map(|r| match (slots.get(r.slot as usize), prepare) {
        (Some(name), true) => format!("known[{}] = {}   {name}", r.slot, place(r.operand)),
        (Some(name), false) => format!("{name} = {}", place(r.operand)),
        (None, _) => format!("known[{}] = {}", r.slot, place(r.operand)),
    });
    (operations, results.collect())
}

/// What stands in each slot of the results.
struct Labels<'a> {
    model: &'a Model,
    layout: &'a Layout,
}

impl Labels<'_> {
    fn rates(&self) -> Vec<String> {
        self.model.definition().states.iter().map(|s| format!("der({})", s.quantity.name)).collect()
    }

    fn outputs(&self) -> Vec<String> {
        self.model.definition().outputs.iter().map(|o| o.quantity.name.clone()).collect()
    }

    fn entries(&self, rows: &[String], pattern: &Pattern, leaf: fn(u32) -> Leaf) -> Vec<String> {
        let name = |(_, i, j): (usize, usize, usize)| {
            format!("{} by {}", rows[i], self.model.definition().leaf(leaf(j as u32)))
        };
        pattern.entries().map(name).collect()
    }

    /// What the first results of `prepare` are called; behind them stand parts of expressions.
    fn known(&self) -> Vec<String> {
        let (m, p) = (self.model.definition(), &self.layout.patterns);
        let initial: Vec<String> = m.states.iter().map(|s| format!("{}(0)", s.quantity.name)).collect();
        let delayed = 0..self.layout.delayed.len() as u32;
        let tau: Vec<String> = delayed.map(|k| format!("tau of {}", m.leaf(Leaf::Delayed(k)))).collect();
        let by_param = self.entries(&initial, &p.initial_by_param, Leaf::Param);
        let tau_by_param = self.entries(&tau, &p.tau_by_param, Leaf::Param);
        let derived = m.derived.iter().map(|d| d.quantity.name.clone());
        let bounds = |(k, _): (usize, fdm_grammar::model::Limits)| {
            let name = &m.states[k].quantity.name;
            [format!("lower limit of {name}"), format!("upper limit of {name}")]
        };
        let limits: Vec<String> = m.limits().flat_map(bounds).collect();
        let limits_by_param = self.entries(&limits, &p.limits_by_param, Leaf::Param);
        let named: Vec<String> = initial
            .into_iter()
            .chain(tau)
            .chain(by_param)
            .chain(tau_by_param)
            .chain(derived)
            .chain(limits)
            .chain(limits_by_param)
            .collect();
        named
    }

    fn stage(&self) -> Vec<String> {
        let (stage, p, rates) = (&self.layout.stage, &self.layout.patterns, self.rates());
        let mut slots = vec![String::new(); stage.width];
        rates.iter().enumerate().for_each(|(k, name)| slots[k].clone_from(name));
        let mut put = |slot: usize, name: String| slots[slot] = name;
        let by_state = self.entries(&rates, &p.rates_by_state, Leaf::State);
        stage.by_state.iter().zip(by_state).for_each(|(slot, name)| put(*slot as usize, name));
        let by_delayed = self.entries(&rates, &p.rates_by_delayed, Leaf::Delayed).into_iter().enumerate();
        by_delayed.for_each(|(k, name)| put(stage.by_delayed + k, name));
        for ((_, i, j), name) in p.rates_by_param.entries().zip(self.entries(&rates, &p.rates_by_param, Leaf::Param)) {
            stage.by_param(i, j).into_iter().for_each(|slot| put(slot, name.clone()));
        }
        slots
    }

    fn output_row(&self) -> Vec<String> {
        let (p, outputs) = (&self.layout.patterns, self.outputs());
        let by_state = self.entries(&outputs, &p.outputs_by_state, Leaf::State);
        let by_delayed = self.entries(&outputs, &p.outputs_by_delayed, Leaf::Delayed);
        let by_param = self.entries(&outputs, &p.outputs_by_param, Leaf::Param);
        outputs.into_iter().chain(by_state).chain(by_delayed).chain(by_param).collect()
    }

    fn input_row(&self) -> Vec<String> {
        let p = &self.layout.patterns;
        let mut slots = self.entries(&self.rates(), &p.rates_by_input, Leaf::Input);
        slots.extend(self.entries(&self.outputs(), &p.outputs_by_input, Leaf::Input));
        slots
    }
}
