//! What is declared as a vector or a matrix.
//!
//! Sizes of vectors and matrices, and the elements that indices choose.

use crate::diagnostic::{Code, Diagnostic, nearest};
use crate::source::Span;
use crate::syntax::{
    Declaration, Expr, ExprRef, Name, Nodes, Role, Shape, Slice, StatementKind, SyntaxTree, Table, Value,
};
use std::collections::{HashMap, HashSet};
use std::fmt;

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

/// Most elements of a vector or matrix.
pub const MOST_ELEMENTS: usize = 1 << 18;

/// A vector, which is a column in products, or a matrix. Elements stand row by row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Dims {
    pub(super) rows: usize,
    /// `None` for a vector.
    pub(super) columns: Option<usize>,
}

impl Dims {
    pub(super) fn vector(rows: usize) -> Self {
        Self { rows, columns: None }
    }

    pub(super) fn matrix(rows: usize, columns: usize) -> Self {
        Self { rows, columns: Some(columns) }
    }

    pub(super) fn of(shape: Shape) -> Self {
        Self { rows: shape.rows as usize, columns: shape.columns.map(|c| c as usize) }
    }

    /// Columns; a vector has one.
    pub(super) fn width(self) -> usize {
        self.columns.unwrap_or(1)
    }

    /// Elements.
    pub(super) fn count(self) -> usize {
        self.rows.saturating_mul(self.width())
    }

    /// A vector agrees with a matrix of one column.
    pub(super) fn agrees(self, other: Self) -> bool {
        self.rows == other.rows && self.width() == other.width()
    }

    /// The element at a place, as it is called: `x[2]`, `A[1,2]`.
    pub(super) fn element(self, name: &str, at: usize) -> String {
        match self.columns {
            None => format!("{name}[{}]", at + 1),
            Some(columns) => format!("{name}[{},{}]", at / columns + 1, at % columns + 1),
        }
    }
}

impl fmt::Display for Dims {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.columns {
            None => write!(f, "[{}]", self.rows),
            Some(columns) => write!(f, "[{}, {columns}]", self.rows),
        }
    }
}

/// What indices choose.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Selection {
    /// `None` for a single element.
    pub(super) dims: Option<Dims>,
    /// Places of the elements.
    pub(super) places: Vec<usize>,
}

/// Why indices choose nothing.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Outside {
    /// Another number of indices is needed.
    Count(usize),
    /// An index that is not there, among so many.
    Index(u32, usize),
    /// The range ends before it begins.
    Empty(u32, u32),
}

/// The elements that indices choose: `A[i, :]` is a row, `A[:, j]` a vector.
pub(super) fn select(dims: Dims, slices: &[Slice]) -> Result<Selection, Outside> {
    match (dims.columns, slices) {
        (None, [rows]) => {
            let (first, last) = range(*rows, dims.rows)?;
            let dims = (!single(*rows)).then(|| Dims::vector(last - first));
            Ok(Selection { dims, places: (first..last).collect() })
        }
        (Some(width), [rows, columns]) => {
            let (top, bottom) = range(*rows, dims.rows)?;
            let (left, right) = range(*columns, width)?;
            let places = (top..bottom).flat_map(|i| (left..right).map(move |j| i * width + j)).collect();
            let dims = match (single(*rows), single(*columns)) {
                (true, true) => None,
                (false, true) => Some(Dims::vector(bottom - top)),
                _ => Some(Dims::matrix(bottom - top, right - left)),
            };
            Ok(Selection { dims, places })
        }
        (None, _) => Err(Outside::Count(1)),
        (Some(_), _) => Err(Outside::Count(2)),
    }
}

fn single(slice: Slice) -> bool {
    matches!(slice, Slice::At(_))
}

/// From which element to before which.
fn range(slice: Slice, count: usize) -> Result<(usize, usize), Outside> {
    let inside = |k: u32| {
        let at = (k as usize).checked_sub(1).filter(|at| *at < count);
        at.ok_or(Outside::Index(k, count))
    };
    match slice {
        Slice::All => Ok((0, count)),
        Slice::At(k) => inside(k).map(|at| (at, at + 1)),
        Slice::Range(first, last) if first > last => Err(Outside::Empty(first, last)),
        Slice::Range(first, last) => Ok((inside(first)?, inside(last)? + 1)),
    }
}

/// The name and the indices of `x[2]`, `A[1,2:3]`, as a target is written; what is no index is outside of everything.
pub(super) fn indexed(text: &str) -> (&str, Option<Vec<Slice>>) {
    let Some((name, index)) = text.split_once('[') else { return (text, None) };
    let count = |digits: &str| digits.trim().parse::<u32>().unwrap_or(u32::MAX);
    let slices = index.trim_end_matches(']').split(',').map(|part| match part.split_once(':') {
        None => Slice::At(count(part)),
        Some((first, _)) if first.trim().is_empty() => Slice::All,
        Some((first, last)) => Slice::Range(count(first), count(last)),
    });
    (name, Some(slices.collect()))
}

#[cfg(test)]
mod shape_tests {
    use super::*;

    #[test]
    fn indices_choose_elements_rows_and_columns() {
        let matrix = Dims::matrix(2, 3);
        let chosen = |text: &str| {
            let (_, slices) = indexed(text);
            select(matrix, &slices.unwrap()).map(|s| (s.dims, s.places))
        };
        assert_eq!(chosen("A[2,3]"), Ok((None, vec![5])));
        assert_eq!(chosen("A[2,:]"), Ok((Some(Dims::matrix(1, 3)), vec![3, 4, 5])));
        assert_eq!(chosen("A[:,2]"), Ok((Some(Dims::vector(2)), vec![1, 4])));
        assert_eq!(chosen("A[1:2,2:3]"), Ok((Some(Dims::matrix(2, 2)), vec![1, 2, 4, 5])));
        assert_eq!(chosen("A[3,1]"), Err(Outside::Index(3, 2)));
        assert_eq!(chosen("A[1,0]"), Err(Outside::Index(0, 3)));
        assert_eq!(chosen("A[1]"), Err(Outside::Count(2)));
        assert_eq!(chosen("A[2:1,1]"), Err(Outside::Empty(2, 1)));
        assert_eq!(chosen("A[99999999999,1]"), Err(Outside::Index(u32::MAX, 2)));
    }
}
