//! `table CL(alpha, delta) = cubic from "cl.csv";`: the numbers of the file as if they stood between braces.
//!
//! Two layouts. A column for each argument and one for the values, a row for each crossing, in any order. Or, for two arguments,
//! a matrix: the values of the second argument stand in the first row, those of the first in the first column.

use super::files;
use crate::diagnostic::{Code, Diagnostic, nearest};
use crate::number::held;
use crate::source::{Source, Span, Text};
use crate::syntax::{
    Axis, Declaration, Expr, ExprRef, Name, Nodes, Role, Statement, StatementKind, SyntaxTree, Table, Value,
};
use crate::unit::Unit;

/// Most nodes of one table.
pub(super) const MOST_TABLE_NODES: usize = 10_000;

/// Reads the files of all tables of a tree.
pub(super) fn read(source: &Source, tree: &mut SyntaxTree, findings: &mut Vec<Diagnostic>) {
    scheduled(tree);
    for k in 0..tree.statements.len() {
        let StatementKind::Table(table) = &tree.statements[k].kind else { continue };
        let Nodes::File(path, free) = &table.nodes else { continue };
        let (table, path, free) = (table.clone(), path.clone(), *free);
        match of_file(source, &path, &table) {
            Ok(grid) => {
                let nodes = Nodes::Written(grid.written(&table, free, &mut tree.expressions));
                tree.statements[k].kind = StatementKind::Table(Table { nodes, ..table });
            }
            Err(finding) => {
                findings.push(finding);
                tree.suspended.push(table.name.text.clone());
                tree.statements[k].kind = StatementKind::Declare(Role::Const, Vec::new());
            }
        }
    }
    tree.suspended.sort_unstable();
    tree.suspended.dedup();
}

/// `param Mq(V) = -1.5 at [20, 40];` becomes the table `Mq(V)` with free nodes `Mq[1]`, `Mq[2]`, and `let Mq`, its value at `V`.
fn scheduled(tree: &mut SyntaxTree) {
    let is = |s: &Statement| matches!(&s.kind, StatementKind::Table(table) if table.scheduled);
    if !tree.statements.iter().any(is) {
        return;
    }
    let unit_of = |name: &str| {
        let declared = tree.statements.iter().filter_map(|s| match &s.kind {
            StatementKind::Declare(_, list) => list.iter().find(|d| d.name.text == name),
            _ => None,
        });
        declared.filter_map(|d| d.unit.clone()).next()
    };
    let units: Vec<Vec<Option<Name>>> = tree
        .statements
        .iter()
        .map(|s| match &s.kind {
            StatementKind::Table(t) if t.scheduled => t.arguments.iter().map(|a| unit_of(&a.name.text)).collect(),
            _ => Vec::new(),
        })
        .collect();
    let mut renamed: Vec<(String, String)> = Vec::new();
    let mut statements = Vec::with_capacity(tree.statements.len() + 1);
    for (Statement { kind, span }, units) in std::mem::take(&mut tree.statements).into_iter().zip(units) {
        let StatementKind::Table(mut table) = kind else {
            statements.push(Statement { kind, span });
            continue;
        };
        if !table.scheduled {
            statements.push(Statement { kind: StatementKind::Table(table), span });
            continue;
        }
        let mut push = |expr: Expr, span: Span| {
            tree.expressions.push((expr, span));
            ExprRef(tree.expressions.len() as u32 - 1)
        };
        let named: Vec<&str> = table.arguments.iter().map(|a| a.name.text.as_str()).collect();
        let name = Name { text: format!("{}({})", table.name.text, named.join(", ")), span: table.name.span };
        let arguments: Vec<ExprRef> =
            table.arguments.iter().map(|a| push(Expr::Name(a.name.text.clone()), a.name.span)).collect();
        let value = push(Expr::Call(name.clone(), arguments), name.span);
        let own = Declaration {
            doc: table.doc.clone(),
            unit: table.unit.clone(),
            value: Some(Value::Expr(value)),
            ..Declaration::new(table.name.clone(), span)
        };
        table.arguments.iter_mut().zip(units).for_each(|(a, unit)| a.unit = a.unit.take().or(unit));
        renamed.push((table.name.text.clone(), name.text.clone()));
        if let Nodes::Written(axes) = &mut table.nodes {
            axes.iter_mut().filter(|a| a.name.text == table.name.text).for_each(|a| a.name = name.clone());
        }
        (table.name, table.scheduled) = (name, false);
        statements.push(Statement { kind: StatementKind::Table(table), span });
        statements.push(Statement { kind: StatementKind::Declare(Role::Let, vec![own]), span });
    }
    for statement in &mut statements {
        if let StatementKind::Smooth(smooth) = &mut statement.kind
            && let Some((_, new)) = renamed.iter().find(|(old, _)| *old == smooth.table.text)
        {
            smooth.table.text.clone_from(new);
        }
    }
    tree.statements = statements;
}

/// A number and where it stands.
type Cell = (f64, Span);

/// Numbers on the crossings of axes.
struct Grid {
    axes: Vec<Vec<Cell>>,
    /// Those of the last argument next to each other.
    values: Vec<Cell>,
}

impl Grid {
    /// As if it had been written between braces.
    fn written(&self, table: &Table, free: Option<Span>, into: &mut Vec<(Expr, Span)>) -> Vec<Axis> {
        let mut push = |expr: Expr, span: Span| {
            into.push((expr, span));
            ExprRef(into.len() as u32 - 1)
        };
        let mut axes = Vec::new();
        for (argument, cells) in table.arguments.iter().zip(&self.axes) {
            let list: Vec<ExprRef> = cells.iter().map(|(v, span)| push(Expr::Number(*v), *span)).collect();
            let values = Some(push(Expr::Vector(list), table.name.span));
            axes.push(Axis { name: argument.name.clone(), free: None, values });
        }
        let mut parts: Vec<ExprRef> = self.values.iter().map(|(v, span)| push(Expr::Number(*v), *span)).collect();
        for cells in self.axes.iter().skip(1).rev() {
            let rows = parts.chunks(cells.len()).map(|row| row.to_vec()).collect::<Vec<_>>();
            parts = rows.into_iter().map(|row| push(Expr::Vector(row), table.name.span)).collect();
        }
        let values = Some(push(Expr::Vector(parts), table.name.span));
        axes.push(Axis { name: table.name.clone(), free, values });
        axes
    }
}

fn of_file(source: &Source, path: &Name, table: &Table) -> Result<Grid, Diagnostic> {
    let from = source.text_at(path.span.start).name();
    let name = files::name_of(from, path);
    let Some(text) = files::find(source, &name) else {
        let missing = source.missing().iter().find(|m| m.name == name);
        let reason = missing.map_or("no files are read here", |m| m.reason.as_str());
        let message = format!("the table `{}` cannot be read from `{name}`: {reason}", table.name.text);
        let finding = Diagnostic::new(Code::NoFile, path.span, message);
        return Err(finding.hint("paths are relative to the file that says `from`"));
    };
    let file = File { text: &source.texts()[text], table, path };
    let rows = file.rows();
    let Some((titles, rows)) = rows.split_first().filter(|(_, rows)| !rows.is_empty()) else {
        let message = format!("`{name}` holds no table: a row of titles and rows of numbers are needed");
        return Err(Diagnostic::new(Code::BadTable, path.span, message).hint(file.form()));
    };
    let is_number = |field: &(&str, Span)| field.0.parse::<f64>().is_ok();
    let is_matrix = table.arguments.len() == 2 && titles.len() > 1 && titles[1..].iter().all(is_number);
    if is_matrix { file.matrix(titles, rows) } else { file.list(titles, rows) }
}

struct File<'a> {
    text: &'a Text,
    table: &'a Table,
    path: &'a Name,
}

/// A field without its margins, and where it stands.
type Field<'a> = (&'a str, Span);

impl<'a> File<'a> {
    /// The titles that are expected.
    fn form(&self) -> String {
        let names = self.table.arguments.iter().map(|a| a.name.text.as_str()).chain([self.table.name.text.as_str()]);
        format!("its titles are {}", names.map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", "))
    }

    fn wrong(&self, span: Span, message: String) -> Diagnostic {
        Diagnostic::new(Code::BadTable, span, message).label(self.path.span, "read from here")
    }

    /// The fields of all lines that hold anything; `#` begins a comment.
    fn rows(&self) -> Vec<Vec<Field<'a>>> {
        let text = self.text.text();
        let first = text.lines().find(|l| !l.trim().is_empty() && !l.trim_start().starts_with('#')).unwrap_or("");
        let delimiter = [',', ';', '\t'].into_iter().find(|d| first.contains(*d)).unwrap_or(',');
        let mut rows = Vec::new();
        let mut offset = 0;
        for line in text.split_inclusive('\n') {
            let start = offset;
            offset += line.len();
            if line.trim().is_empty() || line.trim_start().starts_with('#') {
                continue;
            }
            let (mut fields, mut at) = (Vec::new(), start);
            for field in line.trim_end_matches(['\n', '\r']).split(delimiter) {
                let inner = field.trim().trim_matches('"').trim();
                let from = at + (inner.as_ptr() as usize - field.as_ptr() as usize);
                let span = Span::new(from, from + inner.len()).moved(self.text.start());
                fields.push((inner, span));
                at += field.len() + delimiter.len_utf8();
            }
            rows.push(fields);
        }
        rows
    }

    fn number(&self, (text, span): Field<'_>) -> Result<Cell, Diagnostic> {
        let (minus, digits) = match text.strip_prefix('-') {
            Some(rest) => (true, rest),
            None => (false, text.strip_prefix('+').unwrap_or(text)),
        };
        let plain = digits.starts_with(|c: char| c.is_ascii_digit() || c == '.');
        let value = if plain && digits.parse::<f64>().is_ok() { held(digits).ok() } else { None };
        match value {
            Some(value) => Ok((if minus { -value } else { value }, span)),
            None if text.is_empty() => Err(self.wrong(span, "a number is missing here".into())),
            None => Err(self.wrong(span, format!("`{}` is not a finite number", short(text)))),
        }
    }

    /// The numbers of a row, as many as there are titles.
    fn numbers(&self, row: &[Field<'_>], count: usize) -> Result<Vec<Cell>, Diagnostic> {
        if row.len() != count {
            let span = row.first().map_or(self.path.span, |(_, span)| span.to(row[row.len() - 1].1));
            return Err(self.wrong(span, format!("this row has {} fields, the titles {count}", row.len())));
        }
        row.iter().map(|field| self.number(*field)).collect()
    }

    /// `alpha\delta,-0.1,0,0.1`, and a row for each value of the first argument.
    fn matrix(&self, titles: &[Field<'_>], rows: &[Vec<Field<'_>>]) -> Result<Grid, Diagnostic> {
        let columns: Vec<Cell> = titles[1..].iter().map(|f| self.number(*f)).collect::<Result<_, _>>()?;
        let (mut first, mut values) = (Vec::new(), Vec::new());
        for row in rows {
            let cells = self.numbers(row, titles.len())?;
            first.push(cells[0]);
            values.extend_from_slice(&cells[1..]);
        }
        self.limited(values.len())?;
        Ok(Grid { axes: vec![first, columns], values })
    }

    fn limited(&self, count: usize) -> Result<(), Diagnostic> {
        if count <= MOST_TABLE_NODES {
            return Ok(());
        }
        let message = format!("the table has {count} nodes, more than the limit of {MOST_TABLE_NODES}");
        Err(Diagnostic::new(Code::TooLarge, self.path.span, message).hint("thin it out"))
    }

    /// A row for each crossing.
    fn list(&self, titles: &[Field<'_>], rows: &[Vec<Field<'_>>]) -> Result<Grid, Diagnostic> {
        let names: Vec<(&Name, Option<&Name>)> =
            self.table.arguments.iter().map(|a| (&a.name, a.unit.as_ref())).collect();
        let mut columns = Vec::new();
        for (name, unit) in names.into_iter().chain([(&self.table.name, self.table.unit.as_ref())]) {
            // a part of another model is called by its own name in its own file
            let own = name.text.rsplit('.').next().unwrap_or(&name.text);
            columns.push(self.column(titles, own, unit)?);
        }
        let d = self.table.arguments.len();
        let mut cells: Vec<Vec<Cell>> = Vec::with_capacity(rows.len());
        self.limited(rows.len())?;
        for row in rows {
            let numbers = self.numbers(row, titles.len())?;
            cells.push(
                columns
                    .iter()
                    .map(|(at, (factor, offset))| (numbers[*at].0 * factor + offset, numbers[*at].1))
                    .collect(),
            );
        }
        let mut axes: Vec<Vec<Cell>> = Vec::new();
        for k in 0..d {
            let mut axis: Vec<Cell> = cells.iter().map(|row| row[k]).collect();
            axis.sort_by(|a, b| a.0.total_cmp(&b.0));
            axis.dedup_by(|a, b| a.0 == b.0);
            axes.push(axis);
        }
        let count: usize = axes.iter().map(Vec::len).fold(1, usize::saturating_mul);
        self.limited(count)?;
        let mut values: Vec<Option<Cell>> = vec![None; count];
        for row in &cells {
            let place = axes
                .iter()
                .enumerate()
                .fold(0, |place, (k, axis)| place * axis.len() + axis.partition_point(|cell| cell.0 < row[k].0));
            if values[place].is_some() {
                return Err(self.wrong(row[d].1, format!("{} is given a second time", self.crossing(&axes, place))));
            }
            values[place] = Some(row[d]);
        }
        if let Some(place) = values.iter().position(Option::is_none) {
            let message = format!("`{}` lacks the value at {}", self.path.text, self.crossing(&axes, place));
            let finding = Diagnostic::new(Code::BadTable, self.path.span, message);
            return Err(finding.hint("a table has a value at every crossing of its axes"));
        }
        Ok(Grid { axes, values: values.into_iter().flatten().collect() })
    }

    /// `alpha = 0.1, delta = 0`
    fn crossing(&self, axes: &[Vec<Cell>], place: usize) -> String {
        let mut rest = place;
        let mut said: Vec<String> = Vec::new();
        for (argument, axis) in self.table.arguments.iter().zip(axes).rev() {
            said.push(format!("{} = {}", argument.name.text, axis[rest % axis.len()].0));
            rest /= axis.len();
        }
        said.reverse();
        said.join(", ")
    }

    /// The column of a name, and what makes its numbers those of the declared unit: factor and offset.
    fn column(&self, titles: &[Field<'_>], name: &str, unit: Option<&Name>) -> Result<(usize, (f64, f64)), Diagnostic> {
        let split: Vec<(&str, Option<&str>)> = titles
            .iter()
            .map(|(title, _)| match title.split_once('[') {
                Some((name, unit)) => (name.trim(), Some(unit.trim_end_matches(']').trim())),
                None => (*title, None),
            })
            .collect();
        let Some(at) = split.iter().position(|(own, _)| *own == name) else {
            let message = format!("`{}` has no column `{name}`", self.path.text);
            let finding = Diagnostic::new(Code::BadTable, self.path.span, message);
            let near = nearest(name, split.iter().map(|(own, _)| *own));
            return Err(finding.hint(match near {
                Some(near) => format!("{}; is it `{near}`?", self.form()),
                None => self.form(),
            }));
        };
        let same = (1.0, 0.0);
        let (Some(own), Some(declared)) = (split[at].1, unit) else { return Ok((at, same)) };
        let Ok(own) = Unit::parse(own) else {
            return Err(self.wrong(titles[at].1, format!("`{own}` is not a unit")));
        };
        let Ok(declared) = Unit::parse(&declared.text) else { return Ok((at, same)) };
        match own.conversion(&declared) {
            Some(conversion) => Ok((at, conversion)),
            None => Err(self.wrong(titles[at].1, format!("the column `{name}` is in {own}, the table in {declared}"))),
        }
    }
}

/// So much of a field that a message can show.
fn short(text: &str) -> String {
    text.chars().filter(|c| !c.is_control()).take(30).collect()
}
