//! A checked model as SBML core, level 3 version 1: states as parameters with rate rules, everything else as rules, events as events.

use crate::expression::Names;
use crate::problem::{Piece, Unsuited};
use fdm_grammar::Model;
use fdm_grammar::graph::{Leaf, Node};
use fdm_grammar::op::{ExprId, Op};
use std::collections::BTreeMap;
use std::fmt::Write;

/// What everything is called there.
pub(crate) struct Identifiers {
    pub(crate) model: String,
    /// Which run is simulated.
    pub(crate) run: String,
    pub(crate) params: Vec<String>,
    pub(crate) states: Vec<String>,
    /// None for what a run brings: that is a parameter.
    pub(crate) inputs: Vec<Option<String>>,
    pub(crate) outputs: Vec<String>,
    names: std::cell::RefCell<Names>,
}

pub(crate) fn identifiers(model: &Model) -> Identifiers {
    let mut names = Names::default();
    let mut one = |name: &str| names.fresh(name);
    let outputs = model.outputs.iter().map(|o| one(&o.quantity.name)).collect();
    let states = model.states.iter().map(|s| one(&s.quantity.name)).collect();
    let params = model.params.iter().map(|p| one(&p.quantity.name)).collect();
    let inputs = model.inputs.iter().map(|i| (!i.known).then(|| one(&i.quantity.name))).collect();
    let (run, model) = (one("run_number"), one(&model.name));
    Identifiers { model, run, params, states, inputs, outputs, names: names.into() }
}

impl Identifiers {
    /// A name that nothing has yet.
    pub(crate) fn fresh(&self, wanted: &str) -> String {
        self.names.borrow_mut().fresh(wanted)
    }
}

/// A model on its way to text.
pub(crate) struct Sbml<'a> {
    model: &'a Model,
    ids: &'a Identifiers,
    parameters: String,
    rules: String,
    /// Expressions that have a name.
    named: BTreeMap<ExprId, String>,
    /// How often each node is read, and how deep it is.
    readers: Vec<u32>,
    depths: Vec<u32>,
}

impl<'a> Sbml<'a> {
    pub(crate) fn new(model: &'a Model, ids: &'a Identifiers) -> Self {
        let mut readers = vec![0_u32; model.graph.nodes().len()];
        let states = model.states.iter().flat_map(|s| {
            let resets = s.resets.iter().flat_map(|r| [r.guard, r.value]);
            [s.rate, s.initial].into_iter().chain(resets)
        });
        let roots: Vec<ExprId> = states.chain(model.outputs.iter().flat_map(|o| o.expressions())).collect();
        for e in model.graph.reachable(roots.clone()) {
            let twice = matches!(model.graph.node(e), Node::Apply(Op::Min | Op::Max | Op::Sign, _));
            for operand in model.graph.operands(e) {
                readers[operand.index()] += if twice { 2 } else { 1 };
            }
        }
        let depths = vec![0; readers.len()];
        Self { model, ids, parameters: String::new(), rules: String::new(), named: BTreeMap::new(), readers, depths }
    }

    /// A parameter that does not change.
    pub(crate) fn constant(&mut self, id: &str, value: f64) {
        let value = if value.is_nan() { String::new() } else { format!(" value=\"{}\"", sbml_number(value)) };
        let _ = writeln!(self.parameters, "      <parameter id=\"{id}\"{value} constant=\"true\"/>");
    }

    fn variable(&mut self, id: &str) {
        let _ = writeln!(self.parameters, "      <parameter id=\"{id}\" constant=\"false\"/>");
    }

    fn assign(&mut self, id: &str, math: &str) {
        self.variable(id);
        let _ = writeln!(self.rules, "      <assignmentRule variable=\"{id}\">{}</assignmentRule>", whole(math));
    }

    /// An input as a choice by time, and by the run where there are several.
    pub(crate) fn input(&mut self, id: &str, runs: &[Vec<Piece>], run: Option<&str>) {
        let mut list = Vec::new();
        for (number, pieces) in runs.iter().enumerate() {
            for (k, piece) in pieces.iter().enumerate() {
                let line = match piece.slope {
                    0.0 => constant(piece.value),
                    slope => {
                        let since = apply("minus", &[TIME.into(), constant(piece.from)]);
                        apply("plus", &[constant(piece.value), apply("times", &[constant(slope), since])])
                    }
                };
                let mut conditions = Vec::new();
                conditions.extend(run.map(|id| apply("eq", &[name(id), constant((number + 1) as f64)])));
                if k > 0 {
                    conditions.push(apply("geq", &[TIME.into(), constant(piece.from)]));
                }
                conditions.extend(pieces.get(k + 1).map(|next| apply("lt", &[TIME.into(), constant(next.from)])));
                list.push((line, conditions));
            }
        }
        let last = list.pop().map_or_else(|| constant(0.0), |(line, _)| line);
        let math = match list.is_empty() {
            true => last,
            false => {
                let piece = |(line, conditions): &(String, Vec<String>)| {
                    let condition = match &conditions[..] {
                        [one] => one.clone(),
                        all => apply("and", all),
                    };
                    format!("<piece>{line}{condition}</piece>")
                };
                let pieces: String = list.iter().map(piece).collect();
                format!("<piecewise>{pieces}<otherwise>{last}</otherwise></piecewise>")
            }
        };
        self.assign(id, &math);
    }

    /// The name of an output, made a rule.
    pub(crate) fn output(&mut self, output: usize) -> Result<String, Unsuited> {
        let expr = self.model.outputs[output].expr;
        self.ruled(expr, &format!("value_of_{}", self.ids.outputs[output]))
    }

    /// The name of an output's noise, made a rule.
    pub(crate) fn noise(&mut self, output: usize) -> Result<String, Unsuited> {
        let own = format!("noise_of_{}", self.ids.outputs[output]);
        match self.model.outputs[output].noise_model {
            Some(expr) => self.ruled(expr, &own),
            None => Ok("1".into()),
        }
    }

    fn ruled(&mut self, expr: ExprId, wanted: &str) -> Result<String, Unsuited> {
        if let Node::Leaf(leaf) = self.model.graph.node(expr)
            && let Some(id) = self.leaf(leaf)
        {
            return Ok(id);
        }
        let (math, own) = (self.math(expr)?, self.ids.fresh(wanted));
        self.assign(&own, &math);
        Ok(own)
    }

    fn leaf(&self, leaf: Leaf) -> Option<String> {
        Some(match leaf {
            Leaf::State(k) => self.ids.states[k as usize].clone(),
            Leaf::Input(k) => self.ids.inputs[k as usize].clone()?,
            Leaf::Param(k) => self.ids.params[k as usize].clone(),
            Leaf::Time | Leaf::Delayed(_) => return None,
        })
    }

    /// An expression; what is read twice, or stands deep, becomes a rule of its own first.
    fn math(&mut self, root: ExprId) -> Result<String, Unsuited> {
        let mut order: Vec<ExprId> = self.model.graph.reachable([root]).into_iter().collect();
        order.sort_unstable();
        let mut made: BTreeMap<ExprId, String> = BTreeMap::new();
        for e in order {
            if let Some(own) = self.named.get(&e) {
                made.insert(e, name(own));
                continue;
            }
            let node = self.model.graph.node(e);
            let math = match node {
                Node::Constant(bits) => constant(f64::from_bits(bits)),
                Node::Leaf(leaf) => self.leaf(leaf).map_or_else(|| TIME.to_string(), |id| name(&id)),
                Node::Apply(op, args) => self.applied(op, &args[..op.row().arity], &made)?,
            };
            let operands = self.model.graph.operands(e);
            self.depths[e.index()] = operands.iter().map(|a| self.depths[a.index()] + 1).max().unwrap_or(0);
            // levels of an expression that stand in one formula
            let shared = self.readers[e.index()] > 1 || self.depths[e.index()] > 30;
            if e != root && shared && matches!(node, Node::Apply(..)) && !self.is_condition(e) {
                let own = self.ids.fresh("part");
                self.assign(&own, &math);
                self.depths[e.index()] = 0;
                made.insert(e, name(&own));
                self.named.insert(e, own);
            } else {
                made.insert(e, math);
            }
        }
        Ok(made.remove(&root).unwrap_or_default())
    }

    /// Whether a node is a comparison, or made of such.
    fn is_condition(&self, e: ExprId) -> bool {
        match self.model.graph.node(e) {
            Node::Apply(op, _) if op.is_condition() => true,
            Node::Apply(Op::Select, [c, a, b]) => {
                let truth = |e: ExprId| self.is_condition(e) || matches!(self.model.graph.constant(e), Some(0.0 | 1.0));
                self.is_condition(c) && truth(a) && truth(b)
            }
            _ => false,
        }
    }

    /// A node as something that is true or false.
    fn condition(&self, e: ExprId, made: &BTreeMap<ExprId, String>) -> String {
        let of = |e: &ExprId| made.get(e).cloned().unwrap_or_default();
        match self.model.graph.node(e) {
            Node::Apply(Op::Less, [a, b, _]) => apply("lt", &[of(&a), of(&b)]),
            Node::Apply(Op::LessEqual, [a, b, _]) => apply("leq", &[of(&a), of(&b)]),
            Node::Apply(Op::Equal, [a, b, _]) => match (self.is_condition(a), self.model.graph.constant(b)) {
                (true, Some(0.0)) => apply("not", &[self.condition(a, made)]),
                _ => apply("eq", &[of(&a), of(&b)]),
            },
            Node::Apply(Op::Select, [c, a, b]) if self.is_condition(e) => {
                let (c, constant) = (self.condition(c, made), |e: ExprId| self.model.graph.constant(e));
                match (constant(a), constant(b)) {
                    (_, Some(0.0)) => apply("and", &[c, self.condition(a, made)]),
                    (Some(1.0), _) => apply("or", &[c, self.condition(b, made)]),
                    _ => {
                        let (then, otherwise) = (self.condition(a, made), self.condition(b, made));
                        let not = apply("not", std::slice::from_ref(&c));
                        apply("or", &[apply("and", &[c, then]), apply("and", &[not, otherwise])])
                    }
                }
            }
            _ => apply("neq", &[of(&e), constant(0.0)]),
        }
    }

    fn applied(&self, op: Op, args: &[ExprId], made: &BTreeMap<ExprId, String>) -> Result<String, Unsuited> {
        let list: Vec<String> = args.iter().map(|a| made.get(a).cloned().unwrap_or_default()).collect();
        let choice = |then: &str, condition: String, otherwise: &str| {
            format!("<piecewise><piece>{then}{condition}</piece><otherwise>{otherwise}</otherwise></piecewise>")
        };
        Ok(match op {
            Op::Add => apply("plus", &list),
            Op::Sub | Op::Neg => apply("minus", &list),
            Op::Mul => apply("times", &list),
            Op::Div => apply("divide", &list),
            Op::Pow => apply("power", &list),
            Op::Sin => apply("sin", &list),
            Op::Cos => apply("cos", &list),
            Op::Tan => apply("tan", &list),
            Op::Asin => apply("arcsin", &list),
            Op::Acos => apply("arccos", &list),
            Op::Atan => apply("arctan", &list),
            Op::Sinh => apply("sinh", &list),
            Op::Cosh => apply("cosh", &list),
            Op::Tanh => apply("tanh", &list),
            Op::Exp => apply("exp", &list),
            Op::Log => apply("ln", &list),
            Op::Log10 => format!("<apply><log/><logbase>{}</logbase>{}</apply>", constant(10.0), list[0]),
            Op::Sqrt => apply("root", &list),
            Op::Abs => apply("abs", &list),
            Op::Hypot => {
                let square = |e: &String| apply("power", &[e.clone(), constant(2.0)]);
                apply("root", &[apply("plus", &[square(&list[0]), square(&list[1])])])
            }
            Op::Sign => {
                let (zero, x) = (constant(0.0), &list[0]);
                let below = choice(&constant(-1.0), apply("lt", &[x.clone(), zero.clone()]), &zero);
                choice(&constant(1.0), apply("gt", &[x.clone(), zero]), &below)
            }
            Op::Min => choice(&list[0], apply("leq", &list), &list[1]),
            Op::Max => choice(&list[0], apply("geq", &list), &list[1]),
            Op::Select => choice(&list[1], self.condition(args[0], made), &list[2]),
            // models with foreign code are refused before
            Op::List | Op::External | Op::ExternalSlope | Op::ExternalCurvature => "<notanumber/>".into(),
            Op::Less | Op::LessEqual | Op::Equal => {
                let sign = [(Op::Less, "lt"), (Op::LessEqual, "leq"), (Op::Equal, "eq")];
                let sign = sign.iter().find(|(own, _)| *own == op).map_or("eq", |(_, sign)| sign);
                choice(&constant(1.0), apply(sign, &list), &constant(0.0))
            }
            Op::Atan2 => return Err(Unsuited::Function("atan2")),
        })
    }

    /// The whole file.
    pub(crate) fn text(mut self) -> Result<String, Unsuited> {
        let (model, ids) = (self.model, self.ids);
        let mut initial = String::new();
        for (state, id) in model.states.iter().zip(&ids.states) {
            match model.graph.constant(state.initial) {
                Some(value) => {
                    let _ = writeln!(
                        self.parameters,
                        "      <parameter id=\"{id}\" value=\"{}\" constant=\"false\"/>",
                        sbml_number(value)
                    );
                }
                None => {
                    self.variable(id);
                    let math = self.math(state.initial)?;
                    let _ = writeln!(
                        initial,
                        "      <initialAssignment symbol=\"{id}\">{}</initialAssignment>",
                        whole(&math)
                    );
                }
            }
            let math = self.math(state.rate)?;
            let _ = writeln!(self.rules, "      <rateRule variable=\"{id}\">{}</rateRule>", whole(&math));
        }
        let mut events = String::new();
        for (k, event) in model.events().into_iter().enumerate() {
            let guard = self.math(event.guard)?;
            let trigger = whole(&apply("gt", &[guard, constant(0.0)]));
            let _ = write!(
                events,
                "      <event id=\"event_{}\" useValuesFromTriggerTime=\"true\"><trigger initialValue=\"true\" persistent=\"true\">{trigger}</trigger><listOfEventAssignments>",
                k + 1
            );
            for (state, value) in event.resets {
                let math = whole(&self.math(value)?);
                let id = &ids.states[state as usize];
                let _ = write!(events, "<eventAssignment variable=\"{id}\">{math}</eventAssignment>");
            }
            events.push_str("</listOfEventAssignments></event>\n");
        }
        let list = |name: &str, items: &str| match items.is_empty() {
            true => String::new(),
            false => format!("    <{name}>\n{items}    </{name}>\n"),
        };
        let title = escaped(&model.doc);
        let title = if title.is_empty() { String::new() } else { format!(" name=\"{title}\"") };
        Ok(format!(
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<sbml xmlns=\"http://www.sbml.org/sbml/level3/version1/core\" level=\"3\" version=\"1\">\n  <model id=\"{}\"{title}>\n{}{}{}{}  </model>\n</sbml>\n",
            ids.model,
            list("listOfParameters", &self.parameters),
            list("listOfInitialAssignments", &initial),
            list("listOfRules", &self.rules),
            list("listOfEvents", &events),
        ))
    }
}

const TIME: &str = "<csymbol encoding=\"text\" definitionURL=\"http://www.sbml.org/sbml/symbols/time\">t</csymbol>";

fn whole(math: &str) -> String {
    format!("<math xmlns=\"http://www.w3.org/1998/Math/MathML\">{math}</math>")
}

fn apply(function: &str, list: &[String]) -> String {
    format!("<apply><{function}/>{}</apply>", list.concat())
}

fn name(id: &str) -> String {
    format!("<ci>{id}</ci>")
}

fn constant(value: f64) -> String {
    if value == f64::INFINITY {
        return "<infinity/>".into();
    }
    if value == f64::NEG_INFINITY {
        return apply("minus", &["<infinity/>".into()]);
    }
    let text = crate::problem::number(value);
    match text.split_once('e') {
        Some((mantissa, exponent)) => format!("<cn type=\"e-notation\">{mantissa}<sep/>{exponent}</cn>"),
        None => format!("<cn>{text}</cn>"),
    }
}

/// As XML Schema writes doubles.
fn sbml_number(value: f64) -> String {
    match value {
        f64::INFINITY => "INF".into(),
        f64::NEG_INFINITY => "-INF".into(),
        value => crate::problem::number(value),
    }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;")
}
