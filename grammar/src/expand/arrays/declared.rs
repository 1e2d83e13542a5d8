//! What is declared as a vector or a matrix.

use super::shape::{Dims, MOST_ELEMENTS, Outside, Selection, select};
use crate::diagnostic::{Code, Diagnostic, nearest};
use crate::source::Span;
use crate::syntax::{Declaration, Expr, ExprRef, Name, Nodes, Role, Slice, StatementKind, SyntaxTree, Table, Value};
use std::collections::{HashMap, HashSet};

/// A vector or a matrix.
pub(super) struct Array {
    pub(super) dims: Dims,
    /// By element: 0 by structure; empty when none is.
    zeros: Vec<bool>,
    pub(super) role: Role,
    pub(super) span: Span,
}

impl Array {
    /// Whether an element is 0 by structure.
    pub(super) fn is_zero(&self, at: usize) -> bool {
        self.zeros.get(at).copied().unwrap_or(false)
    }

    /// Elements that are not 0 by structure.
    pub(super) fn present(&self) -> usize {
        self.dims.count() - self.zeros.iter().filter(|z| **z).count()
    }
}

/// All names of a model by what they are.
#[derive(Default)]
pub(super) struct Declared<'a> {
    arrays: HashMap<&'a str, Array>,
    scalars: HashMap<&'a str, Role>,
    /// Names whose declaration was refused, and told.
    pub(super) refused: HashSet<&'a str>,
    /// Declarations that were refused, by their places.
    dropped: HashSet<Span>,
}

impl<'a> Declared<'a> {
    pub(super) fn new(tree: &'a SyntaxTree, findings: &mut Vec<Diagnostic>) -> Self {
        let mut declared = Self::default();
        let mut first: HashMap<&str, (Span, bool)> = HashMap::new();
        for statement in &tree.statements {
            let StatementKind::Declare(role, list) = &statement.kind else { continue };
            for d in list {
                let name = d.name.text.as_str();
                match first.get(name) {
                    // two numbers are told by the checker
                    Some((earlier, array)) if *array || d.shape.is_some() => {
                        let message = format!("`{name}` is declared a second time");
                        let finding = Diagnostic::new(Code::DeclaredTwice, d.name.span, message);
                        let finding = finding.label(*earlier, "first declared here");
                        findings.push(finding.hint("remove one of them or choose another name"));
                        declared.dropped.insert(d.name.span);
                        continue;
                    }
                    Some(_) => {}
                    None => drop(first.insert(name, (d.name.span, d.shape.is_some()))),
                }
                declared.add(tree, *role, d, findings);
            }
        }
        let length = |name: &str| declared.arrays.get(name).map(|a| a.dims.count());
        for (name, dims, span) in free_nodes(tree, length) {
            let taken = declared.arrays.contains_key(name) || declared.scalars.contains_key(name);
            if !taken && (1..=MOST_ELEMENTS).contains(&dims.count()) {
                declared.arrays.insert(name, Array { dims, zeros: Vec::new(), role: Role::Param, span });
            }
        }
        declared
    }

    fn add(&mut self, tree: &SyntaxTree, role: Role, d: &'a Declaration, findings: &mut Vec<Diagnostic>) {
        let name = d.name.text.as_str();
        let Some(shape) = d.shape else {
            self.scalars.entry(name).or_insert(role);
            return;
        };
        let dims = Dims::of(shape);
        let refused = if matches!(name, "t" | "pi" | "inf") {
            let message = format!("`{name}` has a meaning of its own and cannot be declared");
            Some(Diagnostic::new(Code::ReservedName, d.name.span, message).hint("choose another name"))
        } else if dims.count() == 0 {
            let message = format!("`{name}{dims}` has no elements");
            Some(Diagnostic::new(Code::OutsideShape, shape.span, message).hint("sizes count from 1"))
        } else if dims.count() > MOST_ELEMENTS {
            let message =
                format!("`{name}` has more elements than the limit of {MOST_ELEMENTS} for a vector or matrix");
            Some(Diagnostic::new(Code::TooLarge, shape.span, message))
        } else {
            None
        };
        if let Some(finding) = refused {
            findings.push(finding);
            self.refused.insert(name);
            self.dropped.insert(d.name.span);
            return;
        }
        let zeros = match d.value {
            Some(Value::Expr(root)) if matches!(role, Role::Param | Role::Const | Role::Let) => zeros(tree, root, dims),
            _ => Vec::new(),
        };
        self.arrays.insert(name, Array { dims, zeros, role, span: d.name.span });
    }

    /// The vector or matrix of that name.
    pub(super) fn array(&self, name: &str) -> Option<&Array> {
        self.arrays.get(name)
    }

    /// Every vector and matrix; in no order.
    pub(super) fn arrays(&self) -> impl Iterator<Item = (&'a str, &Array)> {
        self.arrays.iter().map(|(name, array)| (*name, array))
    }

    /// Whether the declaration with its name at this place was refused.
    pub(super) fn is_dropped(&self, place: Span) -> bool {
        self.dropped.contains(&place)
    }

    /// Whether a name of the flattened model is a const.
    pub(super) fn is_const(&self, name: &str) -> bool {
        let own = name.split('[').next().unwrap_or(name);
        let array = self.arrays.get(own).map(|a| a.role);
        array.or_else(|| self.scalars.get(name).copied()) == Some(Role::Const)
    }

    /// The elements that indices of a name choose; `Err(None)` when its mistake has been told.
    pub(super) fn select(&self, name: &str, slices: &[Slice], span: Span) -> Result<Selection, Option<Diagnostic>> {
        let told = |code, message: String, hint: String| Some(Diagnostic::new(code, span, message).hint(hint));
        let Some(array) = self.arrays.get(name) else {
            if self.refused.contains(name) {
                return Err(None);
            }
            if self.scalars.contains_key(name) {
                let message = format!("`{name}` is a number and has no elements");
                let hint = format!("`{name}[3]` in its declaration makes it a vector of 3");
                return Err(told(Code::WrongShape, message, hint));
            }
            let mut names: Vec<&str> = self.arrays.keys().copied().collect();
            names.sort_unstable();
            let finding = Diagnostic::new(Code::UnknownName, span, format!("`{name}` is not declared"));
            let near = nearest(name, names).map(|near| format!("did you mean `{near}`?"));
            return Err(Some(near.into_iter().fold(finding, Diagnostic::hint)));
        };
        let dims = array.dims;
        select(dims, slices).map_err(|outside| match outside {
            Outside::Count(wanted) => {
                let needed = if wanted == 1 { "1 index is" } else { "2 indices are" };
                let message = format!("`{name}` is {dims}: {needed} needed, {} given", slices.len());
                let hint = if wanted == 1 { format!("`{name}[1]`") } else { format!("`{name}[1,2]`, `{name}[1,:]`") };
                told(Code::WrongShape, message, hint)
            }
            Outside::Index(k, count) => {
                let message = format!("`{name}` is {dims} and has no index {k} there");
                told(Code::OutsideShape, message, format!("it counts from 1 to {count}"))
            }
            Outside::Empty(first, last) => {
                let message = format!("the range {first}:{last} is empty");
                told(Code::OutsideShape, message, format!("`{last}:{first}`; both ends belong to a range"))
            }
        })
    }
}

/// Which entries of a literal are written as plain `0`.
fn zeros(tree: &SyntaxTree, root: ExprRef, dims: Dims) -> Vec<bool> {
    let Expr::Vector(rows) = tree.expr(root) else { return Vec::new() };
    let mut zeros = Vec::with_capacity(dims.count().min(rows.len()));
    for row in rows {
        match tree.expr(*row) {
            Expr::Vector(entries) => zeros.extend(entries.iter().map(|e| *tree.expr(*e) == Expr::Number(0.0))),
            entry => zeros.push(dims.columns.is_none() && *entry == Expr::Number(0.0)),
        }
    }
    // what does not fit is told where the value is compared with the shape
    if zeros.len() == dims.count() && zeros.contains(&true) { zeros } else { Vec::new() }
}

/// Names and shapes of the free values of tables of one or two arguments, which other statements may name.
fn free_nodes<'a>(tree: &'a SyntaxTree, length_of: impl Fn(&str) -> Option<usize>) -> Vec<(&'a str, Dims, Span)> {
    let shape = |table: &'a Table| {
        let Nodes::Written(axes) = &table.nodes else { return None };
        axes.iter().find(|a| a.name.text == table.name.text)?.free?;
        let length = |name: &Name| match tree.expr(axes.iter().find(|a| a.name.text == name.text)?.values?) {
            Expr::Vector(list) => Some(list.len()),
            Expr::Name(name) => length_of(name),
            _ => None,
        };
        let lengths: Option<Vec<usize>> = table.arguments.iter().map(|a| length(&a.name)).collect();
        let dims = match lengths?[..] {
            [rows] => Dims::vector(rows),
            [rows, columns] => Dims::matrix(rows, columns),
            _ => return None,
        };
        Some((table.name.text.as_str(), dims, table.name.span))
    };
    let tables = tree.statements.iter().filter_map(|s| match &s.kind {
        StatementKind::Table(table) => shape(table),
        _ => None,
    });
    tables.collect()
}
