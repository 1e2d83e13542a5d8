//! GaussJordan with complete pivoting of a matrix that may be of any rank, with right sides.

/// A matrix with right sides, row by row: which columns can be solved for, and their solution with the other unknowns at zero.
#[derive(Debug, Clone, Default)]
pub struct GaussJordan {
    /// Rows by (unknowns + right sides).
    entries: Vec<f64>,
    rows: usize,
    unknowns: usize,
    sides: usize,
    /// (row, column) of the pivots, in the order of elimination.
    pivots: Vec<(usize, usize)>,
    taken: Vec<bool>,
    scales: Vec<f64>,
}

impl GaussJordan {
    /// A pivot below this part of the largest entry that its row had is rounding.
    const SINGULAR: f64 = 1e-11;

    /// Makes a matrix of zeros.
    pub fn clear(&mut self, rows: usize, unknowns: usize, sides: usize) {
        (self.rows, self.unknowns, self.sides) = (rows, unknowns, sides);
        self.entries.clear();
        self.entries.resize(rows * (unknowns + sides), 0.0);
    }

    /// An entry of the matrix.
    pub fn set(&mut self, row: usize, column: usize, value: f64) {
        self.entries[row * (self.unknowns + self.sides) + column] = value;
    }

    /// An entry of a right side.
    pub fn set_side(&mut self, row: usize, side: usize, value: f64) {
        self.set(row, self.unknowns + side, value);
    }

    /// Eliminates; afterwards [`GaussJordan::solution`] has values. Returns the rank.
    pub fn eliminate(&mut self) -> usize {
        let width = self.unknowns + self.sides;
        self.pivots.clear();
        self.taken.clear();
        self.taken.resize(self.rows, false);
        self.scales.clear();
        for row in self.entries.chunks_exact(width.max(1)).take(self.rows) {
            self.scales.push(row[..self.unknowns].iter().fold(0.0_f64, |a, b| a.max(b.abs())));
        }
        while let Some((row, column)) = self.pivot() {
            self.taken[row] = true;
            self.pivots.push((row, column));
            let pivot = self.entries[row * width + column];
            for other in (0..self.rows).filter(|r| *r != row) {
                let factor = self.entries[other * width + column] / pivot;
                if factor != 0.0 {
                    for k in 0..width {
                        self.entries[other * width + k] -= factor * self.entries[row * width + k];
                    }
                    self.entries[other * width + column] = 0.0;
                }
            }
        }
        self.pivots.len()
    }

    /// The largest entry, relative to its row, of what is left.
    fn pivot(&self) -> Option<(usize, usize)> {
        let width = self.unknowns + self.sides;
        let (mut best, mut place) = (Self::SINGULAR, None);
        for row in (0..self.rows).filter(|r| !self.taken[*r]) {
            for column in 0..self.unknowns {
                let size = (self.entries[row * width + column] / self.scales[row]).abs();
                if size > best && size.is_finite() {
                    (best, place) = (size, Some((row, column)));
                }
            }
        }
        place
    }

    /// The columns that were solved for, in the order of elimination.
    pub fn columns(&self) -> impl Iterator<Item = usize> + '_ {
        self.pivots.iter().map(|(_, column)| *column)
    }

    /// The rows that were solved, in the order of elimination.
    pub fn rows(&self) -> impl Iterator<Item = usize> + '_ {
        self.pivots.iter().map(|(row, _)| *row)
    }

    /// (unknown, value) of the solution with one right side; the unknowns that are not named are zero.
    pub fn solution(&self, side: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        let width = self.unknowns + self.sides;
        self.pivots.iter().map(move |(row, column)| {
            let row = &self.entries[row * width..][..width];
            (*column, row[self.unknowns + side] / row[*column])
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn solve(rows: &[&[f64]], sides: &[f64]) -> (usize, Vec<(usize, f64)>) {
        let mut e = GaussJordan::default();
        e.clear(rows.len(), rows[0].len(), 1);
        for (i, row) in rows.iter().enumerate() {
            row.iter().enumerate().for_each(|(j, v)| e.set(i, j, *v));
            e.set_side(i, 0, sides[i]);
        }
        let rank = e.eliminate();
        let mut found: Vec<_> = e.solution(0).collect();
        found.sort_by_key(|(k, _)| *k);
        (rank, found)
    }

    #[test]
    fn full_rank_is_solved() {
        let (rank, found) = solve(&[&[0.0, 2.0], &[4.0, 1.0]], &[6.0, 11.0]);
        assert_eq!((rank, found), (2, vec![(0, 2.0), (1, 3.0)]));
    }

    #[test]
    fn what_the_rows_do_not_determine_stays_at_zero() {
        let (rank, found) = solve(&[&[1.0, 0.0, 5.0], &[2.0, 0.0, 10.0]], &[10.0, 20.0]);
        assert_eq!((rank, found), (1, vec![(2, 2.0)]), "the largest of the row, the empty column never");
        assert_eq!(solve(&[&[0.0, 0.0]], &[1.0]), (0, Vec::new()));
    }
}
