//! Fewer rows that say of signals what all lines say: in every band some sums with random signs, whose products are on
//! average those of the lines (Charikar, Chen & Farach-Colton 2002; Clarkson & Woodruff 2013).

use nalgebra::DMatrix;

/// Rows of a band; one of fewer lines is kept as it is.
const ROWS: usize = 32;
/// Ratio of the frequencies at which neighbouring bands begin.
const WIDTH: f64 = 1.18;

/// Where each line goes, and with which weight.
#[derive(Debug, Clone)]
pub(super) struct Sketch {
    places: Vec<(usize, f64)>,
    rows: usize,
}

impl Sketch {
    /// Of lines at rising frequencies with these weights; `seed` tells outputs and runs apart.
    pub(super) fn new(frequency: &[f64], weight: impl Fn(f64) -> f64, seed: u64) -> Self {
        let (mut places, mut rows, mut first) = (Vec::with_capacity(frequency.len()), 0, 0);
        while first < frequency.len() {
            let wide = frequency.partition_point(|f| *f < frequency[first] * WIDTH);
            let end = wide.max(first + ROWS).min(frequency.len());
            let exact = end - first <= ROWS;
            for (k, own) in frequency.iter().enumerate().take(end).skip(first) {
                let random = mixed(seed.wrapping_mul(0x1_0000_0001).wrapping_add(k as u64));
                let sign = if exact || random & 1 == 0 { 1.0 } else { -1.0 };
                let row = if exact { k - first } else { (random >> 32) as usize % ROWS };
                places.push((rows + row, sign * weight(*own)));
            }
            rows += ROWS.min(end - first);
            first = end;
        }
        Self { places, rows }
    }

    /// The rows of signals (lines by columns).
    pub(super) fn of(&self, columns: &DMatrix<f64>) -> DMatrix<f64> {
        let mut rows = DMatrix::zeros(self.rows, columns.ncols());
        for (column, mut own) in columns.column_iter().zip(rows.column_iter_mut()) {
            column.iter().zip(&self.places).for_each(|(value, (row, weight))| own[*row] += value * weight);
        }
        rows
    }
}

/// Bits that look random (Steele, Lea & Flood 2014, the finaliser of SplitMix).
pub(super) fn mixed(seed: u64) -> u64 {
    let mut bits = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    bits ^ (bits >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_of_rows_are_those_of_lines() {
        let count = 4000;
        let frequency: Vec<f64> = (1..=count).map(|k| k as f64).collect();
        let sketch = Sketch::new(&frequency, |f| 1.0 + 1.0 / f, 3);
        assert!(sketch.rows < count / 4);
        let phase = |i: usize, k: usize| (i as f64 * (0.7 + 0.01 * k as f64) + k as f64).sin();
        let columns = DMatrix::from_fn(count, 3, |i, k| phase(i, k) / (1.0 + i as f64 / 400.0));
        let weighed = DMatrix::from_fn(count, 3, |i, k| columns[(i, k)] * (1.0 + 1.0 / frequency[i]));
        let (near, all) = (sketch.of(&columns), weighed.transpose() * &weighed);
        let near = near.transpose() * &near;
        for i in 0..3 {
            for j in 0..3 {
                let size = (all[(i, i)] * all[(j, j)]).sqrt();
                assert!((near[(i, j)] - all[(i, j)]).abs() < 0.15 * size, "{near} {all}");
            }
        }
    }
}
