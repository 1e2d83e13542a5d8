//! Products of columns in bands: what is left of all samples.
//!
//! A run's columns are its own (initial values, biases), its residual, and those that all runs share (parameters, amounts of effects), in this
//! order, so that a run's own unknowns are eliminated first. For every output and band the matrix of their products is kept; everything
//! that is asked of a linearised model is a sum of these matrices.

use crate::evidence::bands::Bands;
use fdm_numeric::lanes::widest;

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

/// Those of one run: for every output and band the lower triangle, row by row, of a symmetric matrix over own columns, residual, shared columns.
#[derive(Debug, Clone, Default)]
pub(crate) struct RunGrams {
    pub(crate) own: usize,
    /// Own, residual and shared columns.
    pub(crate) width: usize,
    /// outputs x bands triangles.
    pub(crate) products: Vec<f64>,
}

/// Numbers in the lower triangle of so many rows: where the next row begins.
fn triangle(rows: usize) -> usize {
    rows * (rows + 1) / 2
}

impl RunGrams {
    /// The triangles of all outputs and bands.
    fn triangles(&self) -> impl Iterator<Item = &[f64]> {
        self.products.chunks_exact(triangle(self.width))
    }

    /// Power of a column in every output and band.
    pub(crate) fn powers_of(&self, column: usize) -> impl Iterator<Item = f64> {
        self.triangles().map(move |products| products[triangle(column) + column])
    }

    /// The sum of the matrices with these weights (width x width).
    pub(crate) fn weighted(&self, weights: &[f64], matrix: &mut Vec<f64>) {
        let width = self.width;
        let mut sum = vec![0.0; triangle(width)];
        widest(
            #[inline(always)]
            || {
                for (weight, products) in weights.iter().zip(self.triangles()) {
                    sum.iter_mut().zip(products).for_each(|(sum, product)| *sum += weight * product);
                }
            },
        );
        matrix.clear();
        matrix.resize(width * width, 0.0);
        for i in 0..width {
            for j in 0..=i {
                let value = sum[triangle(i) + j];
                matrix[i * width + j] = value;
                matrix[j * width + i] = value;
            }
        }
    }

    /// Adds to the power of every output and band what its matrix is by these second moments of the columns' coefficients (width x width, symmetric).
    pub(crate) fn add_powers(&self, moments: &[f64], powers: &mut [f64]) {
        let width = self.width;
        let twice = |i: usize, j: usize| if i == j { 1.0 } else { 2.0 };
        let factors: Vec<f64> =
            (0..width).flat_map(|i| (0..=i).map(move |j| twice(i, j) * moments[i * width + j])).collect();
        widest(
            #[inline(always)]
            || powers.iter_mut().zip(self.triangles()).for_each(|(power, products)| *power += dot(products, &factors)),
        );
    }
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
        let size = triangle(width);
        let mut products = vec![0.0; self.outputs * self.bands * size];
        widest(
            #[inline(always)]
            || {
                for Segment { place, begin, end } in segments {
                    let matrix = &mut products[place * size..][..size];
                    for (i, a) in columns.iter().enumerate() {
                        for (sum, b) in matrix[triangle(i)..].iter_mut().zip(&columns[..=i]) {
                            *sum += dot(&a[*begin..*end], &b[*begin..*end]);
                        }
                    }
                }
            },
        );
        self.runs.push(RunGrams { own, width, products });
    }

    /// What one more shared column adds, of which `column` are the bins in each run beside those of the others.
    pub(crate) fn border<'c>(
        &self,
        segments: impl Iterator<Item = &'c [Segment]>,
        columns: &[Vec<Vec<f64>>],
        column: &[Vec<f64>],
    ) -> Border {
        let of = |run: &RunGrams, segments: &[Segment], columns: &[Vec<f64>], own: &[f64]| {
            let width = run.width + 1;
            let mut products = vec![0.0; self.outputs * self.bands * width];
            widest(
                #[inline(always)]
                || {
                    for Segment { place, begin, end } in segments {
                        let row = &mut products[place * width..][..width];
                        let part = &own[*begin..*end];
                        for (sum, other) in row.iter_mut().zip(columns) {
                            *sum += dot(part, &other[*begin..*end]);
                        }
                        row[run.width] += dot(part, part);
                    }
                },
            );
            products
        };
        let runs = self.runs.iter().zip(segments).zip(columns.iter().zip(column));
        Border { runs: runs.map(|((run, segments), (columns, own))| of(run, segments, columns, own)).collect() }
    }

    /// With more shared columns behind those that are there; `cross` are the products of each of them with those before it, run by run (outputs x bands).
    pub(crate) fn bordered(&self, borders: &[&Border], cross: &dyn Fn(usize, usize, usize) -> Vec<f64>) -> Self {
        let more = borders.len();
        let one = |(r, run): (usize, &RunGrams)| {
            let (old, width) = (run.width, run.width + more);
            let size = triangle(width);
            let mut products = Vec::with_capacity(self.outputs * self.bands * size);
            for (place, from) in run.triangles().enumerate() {
                products.extend_from_slice(from);
                for (k, border) in borders.iter().enumerate() {
                    let row = &border.runs[r][place * (old + 1)..][..old + 1];
                    products.extend_from_slice(&row[..old]);
                    products.resize(products.len() + k, 0.0);
                    products.push(row[old]);
                }
            }
            for a in 1..more {
                for b in 0..a {
                    for (place, v) in cross(r, a, b).into_iter().enumerate() {
                        products[place * size + triangle(old + a) + old + b] = v;
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
            let matrices = run.triangles().skip(output * self.bands).take(self.bands);
            let row = |m: &[f64], i: usize| -> f64 {
                let products = m[triangle(i)..].iter().zip(&v[..=i]).map(|(a, b)| a * b).sum::<f64>();
                v[i] * (2.0 * products - m[triangle(i) + i] * v[i])
            };
            matrices.map(|m| (0..run.width).map(|i| row(m, i)).sum::<f64>()).sum()
        };
        self.runs.iter().zip(own).map(of).sum()
    }

    /// Powers of the residual in the bands of an output.
    pub(crate) fn residual_powers(&self, output: usize) -> Vec<f64> {
        let power = |run: &RunGrams, band: usize| run.powers_of(run.own).nth(output * self.bands + band).unwrap_or(0.0);
        let of = |band: usize| self.runs.iter().map(|run| power(run, band)).sum();
        (0..self.bands).map(of).collect()
    }
}

#[cfg(test)]
impl RunGrams {
    fn chosen(&self, shared: &[usize], matrices: usize) -> Self {
        let kept: Vec<usize> = (0..=self.own).chain(shared.iter().map(|k| self.own + 1 + k)).collect();
        let width = kept.len();
        let mut products = Vec::with_capacity(matrices * triangle(width));
        for matrix in self.triangles() {
            for (k, i) in kept.iter().enumerate() {
                products.extend(kept[..=k].iter().map(|j| matrix[triangle(*i.max(j)) + i.min(j)]));
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

/// Chains of a sum of products: the order is fixed whatever the width of registers.
const CHAINS: usize = 8;

/// Sum of products.
#[inline(always)]
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; CHAINS];
    let (left, right) = (a.as_chunks::<CHAINS>(), b.as_chunks::<CHAINS>());
    for (x, y) in left.0.iter().zip(right.0) {
        for k in 0..CHAINS {
            sums[k] += x[k] * y[k];
        }
    }
    let rest: f64 = left.1.iter().zip(right.1).map(|(x, y)| x * y).sum();
    sums.iter().sum::<f64>() + rest
}
