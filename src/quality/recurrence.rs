//! Linear recurrences over long lists of rows, column beside column in the processor's widest registers.

use pulp::{Simd, WithSimd};

/// From which side a recurrence runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Direction {
    Forward,
    Backward,
}

/// Adds to each row the rows before it (behind it, when run backward), weighed by the coefficients, the nearest by the first.
/// Rows have `width` numbers, a multiple of 8.
pub(super) fn recur(coefficients: &[f64], rows: &mut [f64], width: usize, direction: Direction) {
    if width > 0 && !coefficients.is_empty() {
        pulp::Arch::new().dispatch(Recurrence { coefficients, rows, width, direction });
    }
}

struct Recurrence<'a> {
    coefficients: &'a [f64],
    rows: &'a mut [f64],
    width: usize,
    direction: Direction,
}

impl WithSimd for Recurrence<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let across = self.width / S::F64_LANES;
        let mut vector = 0;
        while vector < across {
            let tile = (across - vector).min(4);
            match tile {
                1 => self.tile::<S, 1>(simd, vector),
                2 => self.tile::<S, 2>(simd, vector),
                3 => self.tile::<S, 3>(simd, vector),
                _ => self.tile::<S, 4>(simd, vector),
            }
            vector += tile;
        }
    }
}

impl Recurrence<'_> {
    /// All rows of C vectors. The far rows are added first, since the nearest one has only just been computed.
    #[inline(always)]
    fn tile<S: Simd, const C: usize>(&mut self, simd: S, vector: usize) {
        let across = self.width / S::F64_LANES;
        let rows = S::as_mut_simd_f64s(self.rows).0;
        let count = rows.len() / across;
        for step in 0..count {
            let row = if self.direction == Direction::Forward { step } else { count - 1 - step };
            let (mut even, mut odd) = ([simd.splat_f64s(0.0); C], [simd.splat_f64s(0.0); C]);
            let reach = self.coefficients.len().min(step);
            for (k, a) in self.coefficients[..reach].iter().enumerate().rev() {
                let from = if self.direction == Direction::Forward { row - 1 - k } else { row + 1 + k };
                let Some(from) = rows[from * across + vector..].first_chunk::<C>() else { return };
                let (a, sums) = (simd.splat_f64s(*a), if k % 2 == 0 { &mut even } else { &mut odd });
                for c in 0..C {
                    sums[c] = simd.mul_add_f64s(a, from[c], sums[c]);
                }
            }
            let Some(to) = rows[row * across + vector..].first_chunk_mut::<C>() else { return };
            for c in 0..C {
                to[c] = simd.add_f64s(to[c], simd.add_f64s(odd[c], even[c]));
            }
        }
    }
}
