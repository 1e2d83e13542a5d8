//! Grids of tables: axes and values at their crossings as single expressions; `free` values as params of their own.

use super::super::tables::MOST_TABLE_NODES;
use super::declared::Dims;
use super::value::{Evaluator, Val, dims_of};
use super::writer::BROKEN;
use crate::diagnostic::{Code, Diagnostic, nearest};
use crate::source::Span;
use crate::syntax::{Axis, Bounds, Declaration, Expr, ExprRef, Name, Nodes, Table, Value};

/// Most arguments of one table.
const MOST_ARGUMENTS: usize = 3;

/// A node of a table as it is called, counted from 1 along each axis: `CL[2,3]`.
fn element(name: &str, lengths: &[usize], place: usize) -> String {
    let mut rest = place;
    let mut indices: Vec<String> = Vec::new();
    for length in lengths.iter().rev() {
        indices.push((rest % length + 1).to_string());
        rest /= length;
    }
    indices.reverse();
    format!("{name}[{}]", indices.join(","))
}

impl Evaluator<'_, '_> {
    /// A table with its nodes written out, and the params that are its free values; none when a mistake has been told.
    pub(super) fn table(&mut self, table: &Table) -> Option<(Table, Vec<Declaration>)> {
        match &table.nodes {
            Nodes::Written(axes) => self.grid(table, axes),
            nodes => {
                let nodes = nodes.moved(|e| self.scalar(e, "a point of a table is made of"));
                Some((Table { nodes, ..table.clone() }, Vec::new()))
            }
        }
    }

    fn bad(&mut self, span: Span, message: String, hint: impl Into<String>) {
        self.wrong(Code::BadTable, span, message, hint);
    }

    /// What stands between the braces of a table with these arguments.
    fn form(table: &Table) -> String {
        let axes = table.arguments.iter().map(|a| format!("{}: [...], ", a.name.text)).collect::<String>();
        let (open, close) = ("[".repeat(table.arguments.len()), "]".repeat(table.arguments.len()));
        format!("`{{ {axes}{}: {open}...{close} }}`", table.name.text)
    }

    /// Whether the arguments are few enough and have names of their own.
    fn arguments(&mut self, table: &Table) -> bool {
        let (own, arguments) = (&table.name.text, &table.arguments);
        if let Some(further) = arguments.get(MOST_ARGUMENTS) {
            let count = arguments.len();
            let message = format!("the table `{own}` has {count} arguments, more than the limit of {MOST_ARGUMENTS}");
            self.bad(further.name.span, message, "a product or a sum of tables takes more");
            return false;
        }
        for (k, argument) in arguments.iter().enumerate() {
            if let Some(first) = arguments[..k].iter().find(|a| a.name.text == argument.name.text) {
                let message = format!("two arguments of the table `{own}` have the name `{}`", argument.name.text);
                let finding = Diagnostic::new(Code::BadTable, argument.name.span, message);
                self.out.tell(finding.label(first.name.span, "the first is here").hint("give each a name of its own"));
                return false;
            }
        }
        true
    }

    fn grid(&mut self, table: &Table, axes: &[Axis]) -> Option<(Table, Vec<Declaration>)> {
        let own = &table.name.text;
        if !self.arguments(table) {
            return None;
        }
        let wanted: Vec<&str> = table.arguments.iter().map(|a| a.name.text.as_str()).chain([own.as_str()]).collect();
        for (k, axis) in axes.iter().enumerate() {
            let name = axis.name.text.as_str();
            if !wanted.contains(&name) {
                let message = format!("`{name}` is no argument of the table `{own}`");
                let near = nearest(name, wanted.iter().copied()).map(|near| format!("did you mean `{near}`?"));
                self.bad(axis.name.span, message, near.unwrap_or_else(|| Self::form(table)));
                return None;
            }
            if let Some(first) = axes[..k].iter().find(|a| a.name.text == name) {
                let message = format!("`{name}` is given a second time");
                let finding = Diagnostic::new(Code::BadTable, axis.name.span, message);
                self.out.tell(finding.label(first.name.span, "first given here").hint("remove one of them"));
                return None;
            }
            if let Some(free) = axis.free.filter(|_| name != own) {
                self.bad(
                    free,
                    format!("the axis `{name}` of a table is known"),
                    format!("`{own}: free` estimates its values"),
                );
                return None;
            }
        }
        let find = |name: &str| axes.iter().find(|a| a.name.text == name);
        if let Some(missing) = wanted.iter().find(|name| find(name).is_none()) {
            let what = if *missing == own { "the values".into() } else { format!("the axis `{missing}`") };
            self.bad(table.name.span, format!("the table `{own}` lacks {what}"), Self::form(table));
            return None;
        }
        let mut written: Vec<Vec<ExprRef>> = Vec::new();
        for argument in &table.arguments {
            let e = find(&argument.name.text)?.values?;
            written.push(self.axis(e, &argument.name.text)?);
        }
        let lengths: Vec<usize> = written.iter().map(Vec::len).collect();
        let count = lengths.iter().fold(1_usize, |a, b| a.saturating_mul(*b));
        if count > MOST_TABLE_NODES {
            let message = format!("the table `{own}` has {count} nodes, more than the limit of {MOST_TABLE_NODES}");
            self.wrong(Code::TooLarge, table.name.span, message, "thin it out");
            return None;
        }
        let values = find(own)?;
        let numbers = match values.values {
            Some(e) => Some(self.values(e, table, &lengths, values.free.is_some())?),
            None => None,
        };
        let (values, params) = match values.free {
            None => (numbers?, Vec::new()),
            Some(span) => self.free(table, &lengths, numbers, span)?,
        };
        Some((Table { nodes: Nodes::Grid(written, values), ..table.clone() }, params))
    }

    /// The values of an argument at the nodes.
    fn axis(&mut self, e: ExprRef, name: &str) -> Option<Vec<ExprRef>> {
        let span = self.span(e);
        match self.take(e) {
            Val::Broken => None,
            Val::Array(dims, items) if dims.width() == 1 => {
                Some(items.into_iter().map(|item| self.out.item(item, span)).collect())
            }
            value => {
                let what =
                    if matches!(value, Val::Scalar(_)) { "a number".to_string() } else { dims_of(&value).to_string() };
                self.bad(
                    span,
                    format!("the axis `{name}` of a table is a vector, this is {what}"),
                    format!("`{name}: [0, 1, 2]`"),
                );
                None
            }
        }
    }

    /// The values at all crossings: lists in lists, a declared vector or matrix, or one number for free values.
    fn values(&mut self, e: ExprRef, table: &Table, lengths: &[usize], one_for_all: bool) -> Option<Vec<ExprRef>> {
        let (own, span, count) = (&table.name.text, self.span(e), lengths.iter().product::<usize>());
        if matches!(self.tree.expr(e), Expr::Vector(list) if !list.is_empty()) {
            let mut all = Vec::with_capacity(count);
            return self.list(e, table, lengths, &mut all).then_some(all);
        }
        match self.take(e) {
            Val::Broken => None,
            Val::Array(dims, items) if items.len() == count && fits(dims, lengths) => {
                Some(items.into_iter().map(|item| self.out.item(item, span)).collect())
            }
            Val::Scalar(number) if one_for_all => {
                Some(std::iter::once(number).chain((1..count).map(|_| self.out.copy(number))).collect())
            }
            value => {
                let what =
                    if matches!(value, Val::Scalar(_)) { "a number".to_string() } else { dims_of(&value).to_string() };
                let message = format!("the values of the table `{own}` are {}, this is {what}", shown(lengths));
                self.bad(span, message, Self::form(table));
                None
            }
        }
    }

    /// A list of as many entries as the first axis is long, each a list along the others.
    fn list(&mut self, e: ExprRef, table: &Table, lengths: &[usize], into: &mut Vec<ExprRef>) -> bool {
        let Some((length, rest)) = lengths.split_first() else {
            into.push(self.scalar(e, "a node of a table is made of"));
            return true;
        };
        let argument = &table.arguments[table.arguments.len() - lengths.len()].name.text;
        let own = &table.name.text;
        let tree = self.tree;
        let Expr::Vector(list) = tree.expr(e) else {
            let message = format!("a list of {length} values of `{own}` along `{argument}` is needed here");
            self.bad(self.span(e), message, Self::form(table));
            return false;
        };
        if list.len() != *length {
            let plural = if list.len() == 1 { "" } else { "s" };
            let message =
                format!("`{own}` has {} value{plural} along `{argument}` here, its axis has {length}", list.len());
            self.bad(self.span(e), message, "a table has a value at every crossing of its axes");
            return false;
        }
        list.iter().all(|e| self.list(*e, table, rest, into))
    }

    /// Params as values, with what they start at.
    fn free(
        &mut self,
        table: &Table,
        lengths: &[usize],
        starts: Option<Vec<ExprRef>>,
        span: Span,
    ) -> Option<(Vec<ExprRef>, Vec<Declaration>)> {
        let (mut values, mut params) = (Vec::new(), Vec::new());
        let bounds = table.bounds.map(|b| {
            let what = "bounds of the nodes of a table are";
            Bounds { lower: self.scalar(b.lower, what), upper: self.scalar(b.upper, what), span: b.span }
        });
        for place in 0..lengths.iter().product() {
            let start = match &starts {
                Some(starts) => starts[place],
                None => self.out.number(0.0, span),
            };
            if start != BROKEN && !self.out.is_constant(start) {
                let message = format!("the free values of the table `{}` start at numbers", table.name.text);
                let hint = "without `free` the values may be params and what is made of them";
                self.bad(self.out.expressions[start.0 as usize].1, message, hint);
                return None;
            }
            let name = Name { text: element(table.stem(), lengths, place), span: table.name.span };
            if !self.out.budget.spend(1, name.text.len()) {
                let finding = self.out.budget.finding(table.name.span);
                self.out.findings.extend(finding);
                return None;
            }
            values.push(self.out.push(Expr::Name(name.text.clone()), span));
            let (doc, unit) = (table.doc.clone(), table.unit.clone());
            let bounds = bounds.filter(|b| b.lower != BROKEN && b.upper != BROKEN).map(|b| match place {
                0 => b,
                _ => Bounds { lower: self.out.copy(b.lower), upper: self.out.copy(b.upper), ..b },
            });
            params.push(Declaration {
                doc,
                unit,
                value: Some(Value::Expr(start)),
                bounds,
                ..Declaration::new(name, table.name.span)
            });
        }
        Some((values, params))
    }
}

/// Whether the elements of a vector or matrix are the values along these axes.
fn fits(dims: Dims, lengths: &[usize]) -> bool {
    match *lengths {
        [n] => dims.count() == n && dims.width() == 1,
        [n, m] => (dims.rows, dims.width()) == (n, m),
        _ => false,
    }
}

/// `[4, 3]`
fn shown(lengths: &[usize]) -> String {
    format!("[{}]", lengths.iter().map(usize::to_string).collect::<Vec<_>>().join(", "))
}
