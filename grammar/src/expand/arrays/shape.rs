//! Sizes of vectors and matrices, and the elements that indices choose.

use crate::syntax::{Shape, Slice};
use std::fmt;

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
mod tests {
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
