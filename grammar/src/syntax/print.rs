//! A tree back to text, in the form in which people write: as few parentheses as the meaning allows.
//!
//! An effect back to text, as people write it: a line for the header, a line for each statement.

use super::catalogue::{Class, EffectLine, EffectTree, Place, Tunable};
use super::expression::{CHOICE, strength, strength_of, strength_of_sign};
use super::tree::*;
use crate::source::Source;
use std::fmt::Write;

/// Prints the statements and expressions of one tree.
#[derive(Debug, Clone, Copy)]
pub struct Printer<'a> {
    tree: &'a SyntaxTree,
    source: Option<&'a Source>,
}

/// What is still to be written, last first.
enum Part {
    Text(&'static str),
    Sign(BinarySign),
    /// An expression that needs parentheses when it binds less strongly than this.
    Expr(ExprRef, u8),
}

impl<'a> Printer<'a> {
    /// Numbers are written in their shortest form.
    pub fn new(tree: &'a SyntaxTree) -> Self {
        Self { tree, source: None }
    }

    /// Numbers that stand in the source are written as they stand there (`1e-3`, `0.10`).
    pub fn with_source(tree: &'a SyntaxTree, source: &'a Source) -> Self {
        Self { tree, source: Some(source) }
    }

    /// One expression; does not recurse.
    pub fn expression(&self, e: ExprRef) -> String {
        let mut out = String::new();
        let mut parts = vec![Part::Expr(e, CHOICE)];
        while let Some(part) = parts.pop() {
            match part {
                Part::Text(text) => out.push_str(text),
                Part::Sign(sign) => out.push_str(written(sign)),
                Part::Expr(e, least) => {
                    let bracket = strength(self.tree, e) < least;
                    if bracket {
                        out.push('(');
                        parts.push(Part::Text(")"));
                    }
                    self.open(e, &mut out, &mut parts);
                }
            }
        }
        out
    }

    /// Writes the beginning of an expression and leaves the rest to `parts`.
    fn open(&self, e: ExprRef, out: &mut String, parts: &mut Vec<Part>) {
        match self.tree.expr(e) {
            Expr::Number(value) => out.push_str(&self.number(e, *value)),
            Expr::Name(name) => out.push_str(name),
            Expr::Unary(sign, a) => {
                out.push_str(match sign {
                    UnarySign::Minus => "-",
                    UnarySign::Plus => "+",
                    UnarySign::Not => "not ",
                });
                parts.push(Part::Expr(*a, strength_of_sign(*sign)));
            }
            Expr::Binary(sign, a, b, _) => {
                let own = strength_of(*sign);
                let (left, right) = match sign {
                    BinarySign::Power => (own + 1, own),
                    // a comparison of comparisons has no meaning without parentheses
                    sign if is_comparison(*sign) => (own + 1, own + 1),
                    _ => (own, own + 1),
                };
                // a sign before the right operand needs no parentheses behind `^` only
                let right = match (sign, self.tree.expr(*b)) {
                    (BinarySign::Power, Expr::Unary(UnarySign::Minus | UnarySign::Plus, _)) => CHOICE,
                    _ => right,
                };
                parts.extend([Part::Expr(*b, right), Part::Sign(*sign), Part::Expr(*a, left)]);
            }
            Expr::Call(name, arguments) => {
                out.push_str(&name.text);
                out.push('(');
                list(arguments, ")", parts);
            }
            Expr::If(c, a, b) => {
                out.push_str("if ");
                let branch = CHOICE + 1;
                parts.extend([Part::Expr(*b, CHOICE), Part::Text(" else ")]);
                parts.extend([Part::Expr(*a, branch), Part::Text(" then "), Part::Expr(*c, branch)]);
            }
            Expr::Vector(elements) => {
                out.push('[');
                list(elements, "]", parts);
            }
            Expr::Element(name, slices) => {
                out.push_str(&name.text);
                out.push('[');
                out.push_str(&index(slices));
                out.push(']');
            }
        }
    }

    fn number(&self, e: ExprRef, value: f64) -> String {
        let written = self.source.map(|s| s.slice(self.tree.span(e)));
        match written.filter(|w| w.parse() == Ok(value)) {
            Some(written) => written.into(),
            None if value == f64::INFINITY => "inf".into(),
            None if value != 0.0 && !(1e-4..1e15).contains(&value.abs()) => format!("{value:e}"),
            None => value.to_string(),
        }
    }

    /// One statement with its semicolon, on one line.
    pub fn statement(&self, statement: &Statement) -> String {
        let equalities = |word: &str, list: &[(Name, ExprRef)]| {
            let parts: Vec<_> = list.iter().map(|(n, e)| format!("{} = {}", n.text, self.expression(*e))).collect();
            format!("{word} {};", parts.join(", "))
        };
        match &statement.kind {
            StatementKind::Declare(role, list) => {
                let parts: Vec<_> = list.iter().map(|d| self.declaration(d)).collect();
                format!("{} {};", role.keyword(), parts.join(", "))
            }
            StatementKind::Equation(left, right) => {
                format!("{} = {};", self.expression(*left), self.expression(*right))
            }
            StatementKind::Requirement(list) => {
                let parts: Vec<_> = list.iter().map(|d| self.declaration(d)).collect();
                format!("requirement {};", parts.join(", "))
            }
            StatementKind::Time(unit) => format!("time [{}];", unit.text),
            StatementKind::Prior(list) => {
                let belief = |(a, b): &(ExprRef, ExprRef)| format!("{} ~ {}", self.expression(*a), self.expression(*b));
                format!("prior {};", list.iter().map(belief).collect::<Vec<_>>().join(", "))
            }
            StatementKind::Noise(list) => equalities("noise", list),
            StatementKind::Process(list) => {
                let one = |(n, e): &(Name, ExprRef)| format!("der({}) = {}", n.text, self.expression(*e));
                format!("noise {};", list.iter().map(one).collect::<Vec<_>>().join(", "))
            }
            StatementKind::Tie(list) => equalities("tie", list),
            StatementKind::Trim(list) => {
                let parts: Vec<_> =
                    list.iter().map(|(n, e)| format!("{} = {};", n.text, self.expression(*e))).collect();
                format!("trim {{ {} }}", parts.join(" "))
            }
            StatementKind::Table(table) => self.table(table),
            StatementKind::Smooth(smooth) => format!("smooth {} by order {};", smooth.table.text, smooth.order),
            StatementKind::When(event) => {
                let reset = |(n, e): &(Name, ExprRef)| format!("{} = {};", n.text, self.expression(*e));
                let resets: Vec<_> = event.resets.iter().map(reset).collect();
                format!("when {} {{ {} }}", self.expression(event.condition), resets.join(" "))
            }
            StatementKind::Limit(list) => {
                let one = |l: &Limited| {
                    let smooth = l.smooth.map_or(String::new(), |w| format!(" smooth {}", self.expression(w)));
                    let (lower, upper) = (self.expression(l.bounds.lower), self.expression(l.bounds.upper));
                    format!("{} in [{lower}, {upper}]{smooth}", l.state.text)
                };
                format!("limit {};", list.iter().map(one).collect::<Vec<_>>().join(", "))
            }
            StatementKind::Reactions(volume, list) => {
                let volume = volume.map_or(String::new(), |e| format!(" in {}", self.expression(e)));
                let parts: Vec<_> = list.iter().map(|r| self.reaction(r)).collect();
                format!("reactions{volume} {{ {} }}", parts.join(" "))
            }
            StatementKind::Use(submodel) => {
                let Use { path, alias, connections, foreign } = submodel;
                let parts: Vec<_> =
                    connections.iter().map(|(n, e)| format!("{} = {}", n.text, self.expression(*e))).collect();
                let connections = if parts.is_empty() { String::new() } else { format!("({})", parts.join(", ")) };
                let word = if *foreign { "fmu " } else { "" };
                format!("use {word}\"{}\" as {}{connections};", path.text, alias.text)
            }
        }
    }

    /// A declared name with its attributes in the usual order.
    pub fn declaration(&self, d: &Declaration) -> String {
        let mut out = d.name.text.clone();
        if let Some(shape) = d.shape {
            let _ = match shape.columns {
                Some(columns) => write!(out, "[{}, {columns}]", shape.rows),
                None => write!(out, "[{}]", shape.rows),
            };
        }
        if let Some(doc) = &d.doc {
            let _ = write!(out, " \"{}\"", doc.text);
        }
        match d.value {
            Some(Value::Expr(e)) => {
                let _ = write!(out, " = {}", self.expression(e));
            }
            Some(Value::Free(_)) => out.push_str(" = free"),
            None => {}
        }
        if let Some(bounds) = d.bounds {
            let _ = write!(out, " in [{}, {}]", self.expression(bounds.lower), self.expression(bounds.upper));
        }
        if let Some(unit) = &d.unit {
            let _ = write!(out, " [{}]", unit.text);
        }
        out.push_str(if d.fixed.is_some() { " fixed" } else { "" });
        out.push_str(if d.per_run.is_some() { " per run" } else { "" });
        if let Some(group) = &d.group {
            let _ = write!(out, " per group {}", group.text);
        }
        out.push_str(if d.log.is_some() { " log" } else { "" });
        out.push_str(d.hold.map_or("", |hold| if hold.held { " held" } else { " linear" }));
        if let Some(wrap) = &d.wrap {
            let _ = write!(out, " wrap {}", wrap.text);
        }
        out
    }

    fn reaction(&self, reaction: &Reaction) -> String {
        let one = |s: &Species| {
            let count = if s.count == 1.0 { String::new() } else { format!("{}*", s.count) };
            let factor = s.factor.as_ref().map_or(String::new(), |name| format!("{}*", name.text));
            format!("{count}{factor}{}", s.name.text)
        };
        let side = |list: &[Species], open: bool| {
            let nothing = (open || list.is_empty()).then(|| "0".to_string());
            nothing.into_iter().chain(list.iter().map(one)).collect::<Vec<_>>().join(" + ")
        };
        let (left, right) =
            (side(&reaction.left, reaction.is_open && !reaction.right.is_empty()), side(&reaction.right, false));
        let arrow = if reaction.reverse.is_some() { "<->" } else { "->" };
        let reverse = reaction.reverse.map_or(String::new(), |e| format!(", {}", self.expression(e)));
        format!("{left} {arrow} {right}: {}{reverse};", self.expression(reaction.forward))
    }

    fn table(&self, table: &Table) -> String {
        let unit = |unit: &Option<Name>| unit.as_ref().map_or(String::new(), |u| format!(" [{}]", u.text));
        let doc = table.doc.as_ref().map_or(String::new(), |d| format!(" \"{}\"", d.text));
        let arguments: Vec<String> =
            table.arguments.iter().map(|a| format!("{}{}", a.name.text, unit(&a.unit))).collect();
        if let (true, Nodes::Written(axes)) = (table.scheduled, &table.nodes) {
            let written = |axis: &Axis| axis.values.map_or(String::new(), |e| self.expression(e));
            let (start, along) = axes.split_last().map_or(Default::default(), |(own, along)| {
                (written(own), along.iter().map(written).collect::<Vec<_>>().join(", "))
            });
            let bounds = table
                .bounds
                .map_or(String::new(), |b| format!(" in [{}, {}]", self.expression(b.lower), self.expression(b.upper)));
            let method = if table.method.text == "linear" { "" } else { &format!("{} ", table.method.text) };
            let head = format!("param {}({}){doc}{}{bounds}", table.name.text, arguments.join(", "), unit(&table.unit));
            return format!("{head} = {method}{start} at {along};");
        }
        format!(
            "table {}({}){doc}{} = {} {};",
            table.name.text,
            arguments.join(", "),
            unit(&table.unit),
            table.method.text,
            self.nodes(table)
        )
    }

    fn nodes(&self, table: &Table) -> String {
        let list = |list: &[ExprRef]| list.iter().map(|e| self.expression(*e)).collect::<Vec<_>>().join(", ");
        let entries: Vec<String> = match &table.nodes {
            Nodes::File(path, free) => {
                let free = if free.is_some() { " free" } else { "" };
                return format!("from \"{}\"{free}", path.text);
            }
            Nodes::Points(points) => {
                points.iter().map(|(x, y)| format!("{}: {}", self.expression(*x), self.expression(*y))).collect()
            }
            Nodes::Written(axes) => {
                let one = |axis: &Axis| {
                    let free = axis.free.map(|_| "free".to_string());
                    let said: Vec<String> = free.into_iter().chain(axis.values.map(|e| self.expression(e))).collect();
                    format!("{}: {}", axis.name.text, said.join(" "))
                };
                axes.iter().map(one).collect()
            }
            Nodes::Grid(axes, values) if axes.len() == 1 => {
                let points = axes[0].iter().zip(values);
                points.map(|(x, y)| format!("{}: {}", self.expression(*x), self.expression(*y))).collect()
            }
            Nodes::Grid(axes, values) => {
                let axis = |(a, axis): (&Argument, &Vec<ExprRef>)| format!("{}: [{}]", a.name.text, list(axis));
                let mut entries: Vec<String> = table.arguments.iter().zip(axes).map(axis).collect();
                // brackets close wherever an axis begins anew
                let mut parts: Vec<String> = values.iter().map(|e| self.expression(*e)).collect();
                for axis in axes.iter().skip(1).rev() {
                    parts = parts.chunks(axis.len().max(1)).map(|part| format!("[{}]", part.join(", "))).collect();
                }
                entries.push(format!("{}: [{}]", table.name.text, parts.join(", ")));
                entries
            }
        };
        format!("{{ {} }}", entries.join(", "))
    }

    /// The whole model, a statement to a line.
    pub fn model(&self) -> String {
        let doc = self.tree.doc.as_ref().map_or(String::new(), |d| format!(" \"{}\"", d.text));
        let mut out = format!("model {}{doc} {{\n", self.tree.name.text);
        for statement in &self.tree.statements {
            let _ = writeln!(out, "  {}", self.statement(statement));
        }
        out + "}\n"
    }
}

/// The inside of brackets.
fn list(elements: &[ExprRef], close: &'static str, parts: &mut Vec<Part>) {
    parts.push(Part::Text(close));
    for (k, e) in elements.iter().enumerate().rev() {
        parts.push(Part::Expr(*e, CHOICE));
        if k > 0 {
            parts.push(Part::Text(", "));
        }
    }
}

fn index(slices: &[Slice]) -> String {
    let slice = |s: &Slice| match s {
        Slice::At(k) => k.to_string(),
        Slice::Range(first, last) => format!("{first}:{last}"),
        Slice::All => ":".into(),
    };
    slices.iter().map(slice).collect::<Vec<_>>().join(", ")
}

fn is_comparison(sign: BinarySign) -> bool {
    use BinarySign::*;
    matches!(sign, Less | LessEqual | Greater | GreaterEqual | Equal | NotEqual)
}

/// A sign with the spaces around it: sums and comparisons are spaced, products are not.
fn written(sign: BinarySign) -> &'static str {
    match sign {
        BinarySign::Add => " + ",
        BinarySign::Subtract => " - ",
        BinarySign::Multiply => "*",
        BinarySign::Divide => "/",
        BinarySign::Power => "^",
        BinarySign::Less => " < ",
        BinarySign::LessEqual => " <= ",
        BinarySign::Greater => " > ",
        BinarySign::GreaterEqual => " >= ",
        BinarySign::Equal => " == ",
        BinarySign::NotEqual => " != ",
        BinarySign::And => " and ",
        BinarySign::Or => " or ",
    }
}

/// The whole effect.
pub fn print_effect(effect: &EffectTree) -> String {
    let printer = Printer::new(&effect.pool);
    let slots: Vec<String> = effect
        .slots
        .iter()
        .map(|s| {
            let kinds: Vec<_> = s.kinds.iter().map(|k| k.word()).collect();
            format!("{}: {}", s.name.text, kinds.join(" | "))
        })
        .collect();
    let mut out = format!("effect {}({})", effect.name.text, slots.join(", "));
    for condition in &effect.conditions {
        let word = if condition.unless { "unless" } else { "when" };
        let _ = write!(out, " {word} {}", printer.expression(condition.test));
    }
    if effect.class != Class::Mechanism {
        let _ = write!(out, " as {}", effect.class.word());
    }
    if !effect.fields.is_empty() {
        let fields: Vec<_> = effect.fields.iter().map(|f| f.word()).collect();
        let _ = write!(out, " for {}", fields.join(", "));
    }
    if let Some(doc) = &effect.doc {
        let _ = write!(out, " \"{}\"", doc.text);
    }
    out.push_str(" {\n");
    for (line, _) in &effect.lines {
        let _ = writeln!(out, "  {};", statement(&printer, line));
    }
    out + "}\n"
}

fn statement(printer: &Printer<'_>, line: &EffectLine) -> String {
    let place = |p: &Place| if p.derivative { format!("der({})", p.name.text) } else { p.name.text.clone() };
    match line {
        EffectLine::Tunable(t) => tunable(printer, t),
        EffectLine::Own(role, list) => {
            let parts: Vec<_> = list.iter().map(|d| printer.declaration(d)).collect();
            format!("{} {}", role.keyword(), parts.join(", "))
        }
        EffectLine::Equation(left, right) => {
            format!("{} = {}", printer.expression(*left), printer.expression(*right))
        }
        EffectLine::Add(p, term) => format!("add {} += {}", place(p), printer.expression(*term)),
        EffectLine::Replace(name, with) => format!("replace {} with {}", name.text, printer.expression(*with)),
        EffectLine::Noise(p, intensity) => format!("noise {} = {}", place(p), printer.expression(*intensity)),
    }
}

fn tunable(printer: &Printer<'_>, tunable: &Tunable) -> String {
    let word = if tunable.nuisance { "nuisance" } else { "param" };
    let mut out = format!("{word} {}", printer.declaration(&tunable.declaration));
    if tunable.positive {
        out.push_str(" positive");
    }
    if !tunable.trials.is_empty() {
        let trials: Vec<_> = tunable.trials.iter().map(|e| printer.expression(*e)).collect();
        let _ = write!(out, " try {}", trials.join(", "));
    }
    out
}
