//! Products of columns in bands: what is left of all samples.
//!
//! A run's columns are its own (initial values, biases), its residual, and those that all runs share (parameters, amounts of effects), in this
//! order, so that a run's own unknowns are eliminated first. For every output and band the matrix of their products is kept; everything
//! that is asked of a linearised model is a sum of these matrices.

use crate::evidence::bands::Bands;

/// Bins of an output of a run that lie in one band.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Segment {
    /// Where the powers of this output and band stand among all (outputs by bands).
    pub(crate) place: usize,
    /// The bins: from, up to.
    pub(crate) begin: usize,
    pub(crate) end: usize,
}

/// The segments of bins with these frequencies (in that of the first bin of the longest record), the first at `offset` in a column.
pub(crate) fn segments(bands: &Bands, output: usize, frequency: &[f64], offset: usize) -> Vec<Segment> {
    let (mut found, mut begin) = (Vec::new(), 0);
    while begin < frequency.len() {
        let band = bands.of(frequency[begin]);
        let end = begin + frequency[begin..].partition_point(|f| bands.of(*f) == band);
        found.push(Segment { place: output * bands.count() + band, begin: offset + begin, end: offset + end });
        begin = end;
    }
    found
}

/// Band Grams of all runs.
#[derive(Debug, Clone, Default)]
pub(crate) struct Grams {
    outputs: usize,
    bands: usize,
    shared: usize,
    runs: Vec<RunGrams>,
}

/// Those of one run: for every output and band a matrix over own columns, residual, shared columns.
#[derive(Debug, Clone, Default)]
pub(crate) struct RunGrams {
    pub(crate) own: usize,
    /// Own, residual and shared columns.
    pub(crate) width: usize,
    /// outputs x bands matrices of width x width.
    pub(crate) products: Vec<f64>,
}

/// Products of one more shared column with all others and itself, run by run: outputs x bands rows of width + 1.
#[derive(Debug, Clone, Default)]
pub(crate) struct Border {
    pub(crate) runs: Vec<Vec<f64>>,
}

impl Grams {
    /// Of models with so many outputs and shared columns; runs are added.
    pub(crate) fn new(outputs: usize, bands: usize, shared: usize) -> Self {
        Self { outputs, bands, shared, runs: Vec::new() }
    }

    /// Adds a run with so many columns of its own: all columns (own, residual, shared) in its bins.
    pub(crate) fn add(&mut self, own: usize, segments: &[Segment], columns: &[Vec<f64>]) {
        let width = own + 1 + self.shared;
        let mut products = vec![0.0; self.outputs * self.bands * width * width];
        for Segment { place, begin, end } in segments {
            let matrix = &mut products[place * width * width..][..width * width];
            for (i, a) in columns.iter().enumerate() {
                for (j, b) in columns.iter().enumerate().take(i + 1) {
                    let product = dot(&a[*begin..*end], &b[*begin..*end]);
                    matrix[i * width + j] += product;
                    if i != j {
                        matrix[j * width + i] += product;
                    }
                }
            }
        }
        self.runs.push(RunGrams { own, width, products });
    }

    /// What one more shared column adds, of which `column` are the bins in each run beside those of the others.
    pub(crate) fn border<'c>(
        &self,
        segments: impl Iterator<Item = &'c [Segment]>,
        columns: &[Vec<Vec<f64>>],
        column: &[Vec<f64>],
    ) -> Border {
        let of = |(((run, segments), columns), own): (((&RunGrams, &[Segment]), &Vec<Vec<f64>>), &Vec<f64>)| {
            let width = run.width + 1;
            let mut products = vec![0.0; self.outputs * self.bands * width];
            for Segment { place, begin, end } in segments {
                let row = &mut products[place * width..][..width];
                let part = &own[*begin..*end];
                for (sum, other) in row.iter_mut().zip(columns) {
                    *sum += dot(part, &other[*begin..*end]);
                }
                row[run.width] += dot(part, part);
            }
            products
        };
        Border { runs: self.runs.iter().zip(segments).zip(columns).zip(column).map(of).collect() }
    }

    /// With more shared columns behind those that are there; `cross` are the products of each of them with those before it, run by run (outputs x bands).
    pub(crate) fn bordered(&self, borders: &[&Border], cross: &dyn Fn(usize, usize, usize) -> Vec<f64>) -> Self {
        let more = borders.len();
        let one = |(r, run): (usize, &RunGrams)| {
            let (old, width) = (run.width, run.width + more);
            let mut products = vec![0.0; self.outputs * self.bands * width * width];
            for (place, matrix) in products.chunks_exact_mut(width * width).enumerate() {
                let from = &run.products[place * old * old..][..old * old];
                for i in 0..old {
                    matrix[i * width..][..old].copy_from_slice(&from[i * old..][..old]);
                }
                for (k, border) in borders.iter().enumerate() {
                    let row = &border.runs[r][place * (old + 1)..][..old + 1];
                    for (i, v) in row[..old].iter().enumerate() {
                        matrix[i * width + old + k] = *v;
                        matrix[(old + k) * width + i] = *v;
                    }
                    matrix[(old + k) * width + old + k] = row[old];
                }
            }
            for a in 1..more {
                for b in 0..a {
                    for (place, v) in cross(r, a, b).into_iter().enumerate() {
                        let matrix = &mut products[place * width * width..][..width * width];
                        matrix[(old + a) * width + old + b] = v;
                        matrix[(old + b) * width + old + a] = v;
                    }
                }
            }
            RunGrams { own: run.own, width, products }
        };
        Self { shared: self.shared + more, runs: self.runs.iter().enumerate().map(one).collect(), ..*self }
    }

    /// Outputs.
    pub(crate) fn outputs(&self) -> usize {
        self.outputs
    }

    /// Bands.
    pub(crate) fn bands(&self) -> usize {
        self.bands
    }

    /// Shared columns.
    pub(crate) fn shared(&self) -> usize {
        self.shared
    }

    pub(crate) fn runs(&self) -> &[RunGrams] {
        &self.runs
    }

    /// The Grams of these shared columns alone, in this order.
    #[cfg(test)]
    pub(crate) fn chosen(&self, shared: &[usize]) -> Self {
        let runs = self.runs.iter().map(|run| run.chosen(shared, self.outputs * self.bands)).collect();
        Self { shared: shared.len(), runs, ..*self }
    }

    /// Power of an output that is left beside these shares of its columns (shared ones, and each run's own).
    pub(crate) fn left(&self, output: usize, shared: &[f64], own: &[Vec<f64>]) -> f64 {
        let of = |(run, own): (&RunGrams, &Vec<f64>)| -> f64 {
            let v: Vec<f64> = own.iter().map(|m| -m).chain([1.0]).chain(shared.iter().map(|m| -m)).collect();
            let square = run.width * run.width;
            let matrices = run.products[output * self.bands * square..][..self.bands * square].chunks_exact(square);
            let row = |row: &[f64]| row.iter().zip(&v).map(|(a, b)| a * b).sum::<f64>();
            matrices.map(|m| m.chunks_exact(run.width).zip(&v).map(|(r, v)| v * row(r)).sum::<f64>()).sum()
        };
        self.runs.iter().zip(own).map(of).sum()
    }

    /// Powers of the residual in the bands of an output.
    pub(crate) fn residual_powers(&self, output: usize) -> Vec<f64> {
        let of = |band: usize| {
            let power = |run: &RunGrams| {
                let at = (output * self.bands + band) * run.width * run.width;
                run.products[at + run.own * run.width + run.own]
            };
            self.runs.iter().map(power).sum()
        };
        (0..self.bands).map(of).collect()
    }
}

#[cfg(test)]
impl RunGrams {
    fn chosen(&self, shared: &[usize], matrices: usize) -> Self {
        let kept: Vec<usize> = (0..=self.own).chain(shared.iter().map(|k| self.own + 1 + k)).collect();
        let width = kept.len();
        let mut products = Vec::with_capacity(matrices * width * width);
        for matrix in self.products.chunks_exact(self.width * self.width) {
            for i in &kept {
                let row = &matrix[i * self.width..][..self.width];
                products.extend(kept.iter().map(|j| row[*j]));
            }
        }
        Self { own: self.own, width, products }
    }
}

/// Products of two columns in every output and band.
pub(crate) fn products(segments: &[Segment], places: usize, a: &[f64], b: &[f64]) -> Vec<f64> {
    let mut sums = vec![0.0; places];
    for Segment { place, begin, end } in segments {
        sums[*place] += dot(&a[*begin..*end], &b[*begin..*end]);
    }
    sums
}

/// Sum of products in four chains: the order is fixed whatever the width of registers.
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 4];
    let (mut left, mut right) = (a.chunks_exact(4), b.chunks_exact(4));
    for (x, y) in left.by_ref().zip(right.by_ref()) {
        for k in 0..4 {
            sums[k] += x[k] * y[k];
        }
    }
    let rest: f64 = left.remainder().iter().zip(right.remainder()).map(|(x, y)| x * y).sum();
    (sums[0] + sums[1]) + (sums[2] + sums[3]) + rest
}
