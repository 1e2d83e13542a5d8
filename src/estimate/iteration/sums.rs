//! Sums over the samples of one run: products of the rows [J v], or their triangle, and moments of the residuals.
//!
//! Rows come in blocks, and the residual goes to their free lane, so that one sweep gives J'J, J'v and v'v of an output
//! without copying anything. Lanes do not mix and every product is fused with its sum, so that every width of the
//! processor's registers gives the same bits, and so does every division into blocks.

use super::products::{PlaneSums, accumulate};
use fdm_numeric::dense::triangle;
use fdm_system::simulate::{Block, OutputRow, Planes};

/// Lanes of the longest vector that the loops are laid out for.
const LANES: usize = 8;
/// Rows that are worked off together where they must be copied first.
const ROWS: usize = 32;

/// The sums of one run, one group for every output (full noise: one group for all, of whitened rows), so that
/// weights can be applied afterwards.
#[derive(Debug, Clone)]
pub(crate) struct Sums {
    /// Columns of the Jacobian.
    pub(crate) columns: usize,
    /// Row length: the columns and the residual, rounded up.
    pub(crate) width: usize,
    /// Whether the groups are triangles instead of products.
    pub(crate) precise: bool,
    /// Groups of (columns + 1) by width; only the upper triangle is meant.
    values: Vec<f64>,
    /// The columns of each output that does not depend on all of them, and the products of these alone.
    own: Vec<Option<(OutputRow, Vec<f64>)>>,
    /// The columns of each output and the sums of their planes, where these come instead of rows.
    planes: Vec<(Vec<u32>, PlaneSums)>,
    /// Whether all sums of planes are finite.
    finite: bool,
    /// Rows of all columns, waiting to be worked off.
    waiting: Vec<f64>,
    filled: usize,
    work: Vec<f64>,
}

impl Sums {
    pub(crate) fn new(columns: usize, groups: usize) -> Self {
        let width = (columns + 1).next_multiple_of(LANES);
        let (values, own) = (vec![0.0; groups * (columns + 1) * width], vec![None; groups]);
        let (planes, waiting, work) = (Vec::new(), Vec::new(), Vec::new());
        Self { columns, width, precise: false, values, own, planes, finite: true, waiting, filled: 0, work }
    }

    /// One group, (columns + 1) by width.
    pub(crate) fn group(&self, group: usize) -> &[f64] {
        let size = (self.columns + 1) * self.width;
        &self.values[group * size..(group + 1) * size]
    }

    /// The columns of a group that can be other than zero, where that is less than all.
    pub(crate) fn columns_of(&self, group: usize) -> Option<&[u32]> {
        self.planes.get(group).map(|(columns, _)| &columns[..])
    }

    /// Whether all sums are finite.
    pub(crate) fn is_finite(&self) -> bool {
        if self.planes.is_empty() { finite(&self.values) } else { self.finite }
    }

    /// Begins a run.
    pub(crate) fn begin(&mut self) {
        if self.precise {
            self.planes.clear();
        }
        if self.planes.is_empty() {
            self.values.fill(0.0);
        }
        self.own.iter_mut().flatten().for_each(|(_, products)| products.fill(0.0));
        self.filled = 0;
    }

    /// Adds a block; `measured` belongs to its samples (by q). `whitener` (q by q) mixes the outputs of a sample into one
    /// group.
    pub(crate) fn add(&mut self, block: &mut Block<'_>, measured: &[f64], whitener: Option<&[f64]>) {
        let outputs = block.layout.outputs.len();
        place_residuals(block, measured);
        match whitener {
            None if !self.precise => (0..outputs).for_each(|o| self.add_products(block, o)),
            None => (0..outputs).for_each(|o| self.add_rows(block, o)),
            Some(whitener) => self.add_mixed(block, whitener),
        }
    }

    /// Adds a block of planes; `measured` are the planes of its outputs, with `gaps` or without.
    pub(crate) fn add_planes(&mut self, block: &mut Planes<'_>, measured: &[f64], gaps: bool) {
        let outputs = &block.layout.outputs;
        if block.first == 0 {
            if !self.planes.iter().map(|p| &p.0).eq(outputs.iter().map(|o| &o.columns)) {
                self.values.fill(0.0);
                self.planes = outputs.iter().map(|o| (o.columns.clone(), PlaneSums::default())).collect();
            }
            self.planes.iter_mut().for_each(|(columns, sums)| sums.begin(columns.len() + 1));
        }
        let mut rest = &mut *block.derivatives;
        let cells = block.y.chunks_exact(Planes::LENGTH).zip(measured.chunks_exact(Planes::LENGTH));
        for ((y, z), (columns, sums)) in cells.zip(&mut self.planes) {
            let (planes, behind) = std::mem::take(&mut rest).split_at_mut((columns.len() + 1) * Planes::LENGTH);
            rest = behind;
            let (derivatives, residuals) = planes.split_at_mut(columns.len() * Planes::LENGTH);
            residuals.iter_mut().zip(z.iter().zip(y)).for_each(|(v, (z, y))| *v = z - y);
            if gaps {
                for (k, v) in residuals.iter_mut().enumerate().filter(|(k, _)| z[*k].is_nan()) {
                    *v = 0.0;
                    derivatives.iter_mut().skip(k).step_by(Planes::LENGTH).for_each(|d| *d = 0.0);
                }
            }
            sums.add(planes, block.lanes, block.first == 0);
        }
    }

    /// Ends a run: products of outputs with columns of their own go to their places among all columns.
    pub(crate) fn end(&mut self) {
        let (size, width) = ((self.columns + 1) * self.width, self.width);
        // zero, or no number
        let mut rest = 0.0;
        for (values, (columns, sums)) in self.values.chunks_exact_mut(size).zip(&self.planes) {
            let place = |lane: usize| columns.get(lane).map_or(self.columns, |c| *c as usize);
            for i in 0..=columns.len() {
                let row = &mut values[place(i) * width..][..width];
                for j in i..=columns.len() {
                    let sum = sums.sum(i, j);
                    rest += 0.0 * sum;
                    row[place(j)] = sum;
                }
            }
        }
        self.finite = rest == 0.0;
        for (values, own) in self.values.chunks_exact_mut(size).zip(&self.own) {
            let Some((row, products)) = own.as_ref().filter(|_| !self.precise) else { continue };
            let place = |lane: usize| row.columns.get(lane).map_or(self.columns, |c| *c as usize);
            for i in 0..=row.columns.len() {
                for j in i..=row.columns.len() {
                    values[place(i) * width + place(j)] = products[i * row.width + j];
                }
            }
        }
    }

    /// Products of one output's rows, where they stand.
    fn add_products(&mut self, block: &Block<'_>, output: usize) {
        let (row, stride) = (&block.layout.outputs[output], block.layout.length);
        let (order, rows) = (row.columns.len() + 1, &block.rows[row.start..]);
        if row.columns.len() == self.columns {
            let size = (self.columns + 1) * self.width;
            let sums = &mut self.values[output * size..][..size];
            return accumulate(rows, stride, block.samples(), self.width, order, sums);
        }
        let own = &mut self.own[output];
        if own.is_none() || block.first == 0 && own.as_ref().is_some_and(|(known, _)| known != row) {
            *own = Some((row.clone(), vec![0.0; order * row.width]));
        }
        if let Some((_, sums)) = own {
            accumulate(rows, stride, block.samples(), row.width, order, sums);
        }
    }

    fn add_rows(&mut self, block: &Block<'_>, output: usize) {
        for sample in 0..block.samples() {
            self.add_row(output, |row, residual| spread(block, (sample, output), 1.0, row, residual));
        }
        self.reduce(output);
    }

    fn add_mixed(&mut self, block: &Block<'_>, whitener: &[f64]) {
        for sample in 0..block.samples() {
            for mix in whitener.chunks(block.layout.outputs.len()) {
                self.add_row(0, |row, residual| {
                    mix.iter().enumerate().for_each(|(o, f)| spread(block, (sample, o), *f, row, residual));
                });
            }
        }
        self.reduce(0);
    }

    fn add_row(&mut self, group: usize, fill: impl FnOnce(&mut [f64], usize)) {
        self.waiting.resize(ROWS * self.width, 0.0);
        let row = &mut self.waiting[self.filled * self.width..(self.filled + 1) * self.width];
        row.fill(0.0);
        fill(row, self.columns);
        self.filled += 1;
        if self.filled == ROWS {
            self.reduce(group);
        }
    }

    /// Works off the rows that are waiting.
    fn reduce(&mut self, group: usize) {
        let (width, order, filled) = (self.width, self.columns + 1, std::mem::take(&mut self.filled));
        let sums = &mut self.values[group * order * width..(group + 1) * order * width];
        let rows = &mut self.waiting[..filled * width];
        if self.precise {
            triangle::reduce(sums, order, rows, width, &mut self.work);
        } else {
            accumulate(rows, width, filled, width, order, sums);
        }
    }
}

/// Whether all numbers are finite.
fn finite(values: &[f64]) -> bool {
    // exponents all ones are no numbers; the largest of all is found in vectors
    let largest = values.iter().fold(0, |largest: u64, v| largest.max(v.to_bits() & (u64::MAX >> 1)));
    f64::from_bits(largest).is_finite()
}

/// Writes the residuals to the free lanes of the rows; where nothing was measured a row becomes zero.
fn place_residuals(block: &mut Block<'_>, measured: &[f64]) {
    let (outputs, length) = (&block.layout.outputs[..], block.layout.length);
    let cells = measured.chunks_exact(outputs.len()).zip(block.y.chunks_exact(outputs.len()));
    for ((z, y), lanes) in cells.zip(block.rows.chunks_exact_mut(length)) {
        for ((z, y), row) in z.iter().zip(y).zip(outputs) {
            if z.is_nan() {
                lanes[row.start..][..row.width].fill(0.0);
            } else {
                lanes[row.start + row.columns.len()] = z - y;
            }
        }
    }
}

/// Adds `factor` times the row [J v] of an output to a row of all columns.
fn spread(block: &Block<'_>, (sample, output): (usize, usize), factor: f64, row: &mut [f64], residual: usize) {
    let place = &block.layout.outputs[output];
    let lanes = &block.rows[sample * block.layout.length + place.start..][..place.width];
    for (column, value) in place.columns.iter().zip(lanes) {
        row[*column as usize] += factor * value;
    }
    row[residual] += factor * lanes[place.columns.len()];
}

/// Sums of products of residuals of different outputs, q by q.
#[derive(Debug, Clone)]
pub(crate) struct Moments {
    outputs: usize,
    width: usize,
    sums: Vec<f64>,
    residuals: Vec<f64>,
}

impl Moments {
    pub(crate) fn new(outputs: usize) -> Self {
        let width = outputs.next_multiple_of(LANES);
        Self { outputs, width, sums: vec![0.0; outputs * width], residuals: vec![0.0; ROWS * width] }
    }

    /// Begins a run.
    pub(crate) fn begin(&mut self) {
        self.sums.fill(0.0);
    }

    /// Takes the squares from the sums of a run whose outputs are apart; products of different outputs stay zero.
    pub(crate) fn take_squares(&mut self, sums: &Sums) {
        for o in 0..self.outputs {
            self.sums[o * self.width + o] = sums.group(o)[sums.columns * sums.width + sums.columns];
        }
    }

    /// Adds consecutive samples of a response and its measurement (by q); cells that were not measured count nothing.
    pub(crate) fn add(&mut self, y: &[f64], measured: &[f64]) {
        let (q, width) = (self.outputs, self.width);
        for (y, z) in y.chunks(ROWS * q).zip(measured.chunks(ROWS * q)) {
            let rows = self.residuals.chunks_exact_mut(width);
            for ((row, y), z) in rows.zip(y.chunks_exact(q)).zip(z.chunks_exact(q)) {
                for o in 0..q {
                    row[o] = if z[o].is_nan() { 0.0 } else { z[o] - y[o] };
                }
            }
            accumulate(&self.residuals, width, y.len() / q, width, q, &mut self.sums);
        }
    }

    /// The sum of products of the residuals of two outputs.
    pub(crate) fn at(&self, a: usize, b: usize) -> f64 {
        self.sums[a.min(b) * self.width + a.max(b)]
    }

    /// Whether all sums are finite.
    pub(crate) fn is_finite(&self) -> bool {
        (0..self.outputs).all(|a| (a..self.outputs).all(|b| self.at(a, b).is_finite()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fdm_system::simulate::RowLayout;

    /// Two outputs of which the second depends on some columns only, in blocks of uneven length, with an empty cell.
    #[test]
    fn products_and_triangle_agree_and_skip_empty_cells() {
        let (n, q, columns) = (37, 2, 8);
        let layout = RowLayout::new([(0..8).collect(), vec![1, 4, 7]]);
        let depends = |o: usize, c: usize| o == 0 || [1, 4, 7].contains(&c);
        let entry = |k: usize, c: usize| (((k * 8 + c) * (k * 8 + c) % 97) as f64 / 97.0 - 0.5).sin();
        let jacobian = |k: usize, c: usize| if depends(k % q, c) { entry(k, c) } else { 0.0 };
        let y: Vec<f64> = (0..n * q).map(|k| (k as f64).cos()).collect();
        let mut measured: Vec<f64> = (0..n * q).map(|k| (k as f64).cos() + 0.1 * (k % 5) as f64).collect();
        measured[6] = f64::NAN;
        let sum = |sums: &mut Sums, moments: &mut Moments| {
            sums.begin();
            moments.begin();
            for (first, end) in [(0, 5), (5, 6), (6, n)] {
                let mut rows = vec![0.0; (end - first) * layout.length];
                for sample in first..end {
                    for (o, output) in layout.outputs.iter().enumerate() {
                        for (lane, c) in output.columns.iter().enumerate() {
                            rows[(sample - first) * layout.length + output.start + lane] =
                                jacobian(sample * q + o, *c as usize);
                        }
                    }
                }
                let (y, measured) = (&y[first * q..end * q], &measured[first * q..end * q]);
                sums.add(&mut Block { first, y, rows: &mut rows, layout: &layout }, measured, None);
                moments.add(y, measured);
            }
            sums.end();
        };
        let (mut sums, mut moments) = (Sums::new(columns, q), Moments::new(q));
        sum(&mut sums, &mut moments);
        let products = sums.clone();
        sums.precise = true;
        sum(&mut sums, &mut moments);
        for o in 0..q {
            let cell = |k: usize, c: usize| if c < columns { jacobian(k, c) } else { measured[k] - y[k] };
            for i in 0..=columns {
                for j in i..=columns {
                    let cells = (o..n * q).step_by(q).filter(|k| *k != 6);
                    let want: f64 = cells.map(|k| cell(k, i) * cell(k, j)).sum();
                    let product = products.group(o)[i * products.width + j];
                    let t = sums.group(o);
                    let triangle: f64 = (0..=i).map(|r| t[r * sums.width + i] * t[r * sums.width + j]).sum();
                    assert!((product - want).abs() < 1e-12 && (triangle - want).abs() < 1e-12, "{o} {i} {j}");
                }
            }
            let square = products.group(o)[columns * products.width + columns];
            assert_eq!(square, moments.at(o, o), "the same residuals in the same order");
        }
        let mixed: f64 = (0..n)
            .filter(|s| *s != 3)
            .map(|s| (measured[2 * s] - y[2 * s]) * (measured[2 * s + 1] - y[2 * s + 1]))
            .sum();
        assert!((moments.at(0, 1) - mixed).abs() < 1e-12 && moments.at(0, 1) == moments.at(1, 0));
    }

    #[test]
    fn a_whitener_mixes_outputs() {
        let layout = RowLayout::new([vec![0, 1], vec![1]]);
        let mut rows = vec![0.0; layout.length];
        (rows[0], rows[1], rows[layout.outputs[1].start]) = (1.0, 2.0, 3.0);
        let mut sums = Sums::new(2, 1);
        sums.begin();
        let mut block = Block { first: 0, y: &[0.0, 0.0], rows: &mut rows, layout: &layout };
        sums.add(&mut block, &[5.0, 7.0], Some(&[2.0, 1.0, 0.0, 4.0]));
        sums.end();
        // rows: 2 (1, 2, 5) + (0, 3, 7) = (2, 7, 17) and 4 (0, 3, 7) = (0, 12, 28)
        let at = |i: usize, j: usize| sums.group(0)[i * sums.width + j];
        assert_eq!((at(0, 0), at(0, 1), at(0, 2)), (4.0, 14.0, 34.0));
        assert_eq!((at(1, 1), at(1, 2), at(2, 2)), (49.0 + 144.0, 119.0 + 336.0, 289.0 + 784.0));
    }
}
