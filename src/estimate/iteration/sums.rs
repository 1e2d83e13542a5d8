//! Sums over the samples of one run: products of the rows [J v], or their triangle, and moments of the residuals.
//!
//! Rows come in blocks, and the residual goes to their free lane, so that one sweep gives J'J, J'v and v'v of an output
//! without copying anything. Lanes do not mix and every product is fused with its sum, so that every width of the
//! processor's registers gives the same bits, and so does every division into blocks.

use super::products::{PlaneSums, WIDE, accumulate};
use fdm_numeric::dense::panels;
use fdm_numeric::lanes::VECTOR;
use fdm_system::simulate::{Block, Planes};

/// Rows that are worked off together where they must be copied first.
const ROWS: usize = 32;
/// Order from which sums do not stay in the innermost cache between two blocks: rows wait until there are some.
const LARGE: usize = 48;
const SOME_ROWS: usize = 64;

/// The sums of one run, one group for every output (full noise: one group for all, of whitened rows), so that
/// weights can be applied afterwards.
#[derive(Debug, Clone)]
pub(crate) struct Sums {
    /// Columns of the Jacobian.
    columns: usize,
    /// Whether the groups are triangles instead of products.
    pub(crate) precise: bool,
    pub(crate) groups: Vec<Group>,
    /// Whether sums of planes come instead of rows: these replace what stands in the groups, so that nothing is cleared for them.
    planar: bool,
    /// Whether all sums of planes are finite.
    finite: bool,
    /// Rows waiting to be worked off.
    waiting: Vec<f64>,
    filled: usize,
    work: Vec<f64>,
}

/// The sums of one output, of the columns alone that it depends on: a model of many outputs needs no more memory than it has
/// sensitivities.
#[derive(Debug, Clone, Default)]
pub(crate) struct Group {
    /// The columns, rising; behind them stands the residual.
    pub(crate) columns: Vec<u32>,
    /// Row length: the columns and the residual, rounded up.
    pub(crate) width: usize,
    /// (Columns + 1) by width; only the upper triangle is meant.
    pub(crate) values: Vec<f64>,
    planes: PlaneSums,
    /// Long rows, waiting until they are many enough to be worth a walk through the sums.
    waiting: Vec<f64>,
}

impl Group {
    /// Works off the rows that are waiting.
    fn settle(&mut self) {
        let (order, rows) = (self.columns.len() + 1, self.waiting.len() / self.width.max(1));
        accumulate(&self.waiting, self.width, rows, self.width, order, &mut self.values);
        self.waiting.clear();
    }

    /// Takes other columns, if they are others; sums begin at zero then.
    fn lay_out(&mut self, columns: &[u32], width: usize) {
        if self.columns != columns || self.width != width {
            self.columns = columns.to_vec();
            self.width = width;
            self.values.clear();
            self.values.resize((columns.len() + 1) * width, 0.0);
        }
    }

    /// Each column with its row of products from the diagonal on, and what it has with the residual.
    pub(crate) fn rows(&self) -> impl Iterator<Item = (usize, &[u32], &[f64], f64)> {
        let n = self.columns.len();
        self.columns
            .iter()
            .zip(self.values.chunks_exact(self.width.max(1)))
            .enumerate()
            .map(move |(k, (column, row))| (*column as usize, &self.columns[k..], &row[k..n], row[n]))
    }

    /// The sum of squares of the residuals, where sums are products.
    pub(crate) fn square(&self) -> f64 {
        let n = self.columns.len();
        self.values.get(n * self.width + n).copied().unwrap_or(0.0)
    }
}

impl Sums {
    pub(crate) fn new(columns: usize, groups: usize) -> Self {
        let groups = vec![Group::default(); groups];
        Self {
            columns,
            precise: false,
            groups,
            planar: false,
            finite: true,
            waiting: Vec::new(),
            filled: 0,
            work: Vec::new(),
        }
    }

    /// Whether all sums are finite.
    pub(crate) fn is_finite(&self) -> bool {
        if self.planar { self.finite } else { self.groups.iter().all(|group| finite(&group.values)) }
    }

    /// Begins a run.
    pub(crate) fn begin(&mut self) {
        if !self.planar {
            self.clear();
        }
        self.filled = 0;
    }

    fn clear(&mut self) {
        for group in &mut self.groups {
            group.values.fill(0.0);
            group.waiting.clear();
        }
    }

    /// Adds a block; `measured` belongs to its samples (by q). `whitener` (q by q) mixes the outputs of a sample into one
    /// group.
    pub(crate) fn add(&mut self, block: &mut Block<'_>, measured: &[f64], whitener: Option<&[f64]>) {
        let outputs = block.layout.outputs.len();
        place_residuals(block, measured);
        if self.planar {
            self.planar = false;
            self.clear();
        }
        match whitener {
            None if !self.precise => (0..outputs).for_each(|o| self.add_products(block, o)),
            None => (0..outputs).for_each(|o| self.add_rows(block, o)),
            Some(whitener) => self.add_mixed(block, whitener),
        }
    }

    /// Adds a block of planes; `measured` are the planes of its outputs, with `gaps` or without.
    pub(crate) fn add_planes(&mut self, block: &mut Planes<'_>, measured: &[f64], gaps: bool) {
        self.planar = true;
        if block.first == 0 {
            for (group, output) in self.groups.iter_mut().zip(&block.layout.outputs) {
                group.lay_out(&output.columns, output.width);
                group.planes.begin(output.columns.len() + 1);
            }
        }
        let mut rest = &mut *block.derivatives;
        let cells = block.y.chunks_exact(Planes::LENGTH).zip(measured.chunks_exact(Planes::LENGTH));
        for ((y, z), group) in cells.zip(&mut self.groups) {
            let columns = group.columns.len();
            let (planes, behind) = std::mem::take(&mut rest).split_at_mut((columns + 1) * Planes::LENGTH);
            rest = behind;
            let (derivatives, residuals) = planes.split_at_mut(columns * Planes::LENGTH);
            residuals.iter_mut().zip(z.iter().zip(y)).for_each(|(v, (z, y))| *v = z - y);
            if gaps {
                for (k, v) in residuals.iter_mut().enumerate().filter(|(k, _)| z[*k].is_nan()) {
                    *v = 0.0;
                    derivatives.iter_mut().skip(k).step_by(Planes::LENGTH).for_each(|d| *d = 0.0);
                }
            }
            group.planes.add(planes, block.lanes, block.first == 0);
        }
    }

    /// Ends a run.
    pub(crate) fn end(&mut self) {
        self.groups.iter_mut().filter(|group| !group.waiting.is_empty()).for_each(Group::settle);
        if !self.planar {
            return;
        }
        // zero, or no number
        let mut rest = 0.0;
        for Group { columns, width, values, planes, .. } in &mut self.groups {
            for i in 0..=columns.len() {
                for j in i..=columns.len() {
                    let sum = planes.sum(i, j);
                    rest += 0.0 * sum;
                    values[i * *width + j] = sum;
                }
            }
        }
        self.finite = rest == 0.0;
    }

    /// Products of one output's rows, where they stand.
    fn add_products(&mut self, block: &Block<'_>, output: usize) {
        let (row, group) = (&block.layout.outputs[output], &mut self.groups[output]);
        group.lay_out(&row.columns, row.width);
        let (rows, order) = (&block.rows[row.start..], row.columns.len() + 1);
        // rows that are worked off together where they are long and must be copied first
        let enough = if order >= WIDE { 256 } else { SOME_ROWS };
        if order >= WIDE || order >= LARGE && block.samples() < ROWS {
            let samples = block.rows.chunks_exact(block.layout.length).take(block.samples());
            samples.for_each(|lanes| group.waiting.extend_from_slice(&lanes[row.start..][..row.width]));
            if group.waiting.len() >= enough * row.width {
                group.settle();
            }
            return;
        }
        accumulate(rows, block.layout.length, block.samples(), row.width, order, &mut group.values);
    }

    fn add_rows(&mut self, block: &Block<'_>, output: usize) {
        let Self { groups, waiting, work, .. } = self;
        let (row, group) = (&block.layout.outputs[output], &mut groups[output]);
        group.lay_out(&row.columns, row.width);
        let rows = &block.rows[..block.samples() * block.layout.length];
        for samples in rows.chunks(ROWS * block.layout.length) {
            waiting.clear();
            samples.chunks(block.layout.length).for_each(|s| waiting.extend_from_slice(&s[row.start..][..row.width]));
            panels::reduce(&mut group.values, row.columns.len() + 1, waiting, row.width, work);
        }
    }

    fn add_mixed(&mut self, block: &Block<'_>, whitener: &[f64]) {
        if self.groups[0].columns.len() != self.columns || self.groups[0].width == 0 {
            let all: Vec<u32> = (0..self.columns as u32).collect();
            self.groups[0].lay_out(&all, (self.columns + 1).next_multiple_of(VECTOR));
        }
        let width = self.groups[0].width;
        self.waiting.resize(ROWS * width, 0.0);
        for sample in 0..block.samples() {
            for mix in whitener.chunks(block.layout.outputs.len()) {
                let row = &mut self.waiting[self.filled * width..][..width];
                row.fill(0.0);
                mix.iter().enumerate().for_each(|(o, f)| spread(block, (sample, o), *f, row, self.columns));
                self.filled += 1;
                if self.filled == ROWS {
                    self.reduce_mixed();
                }
            }
        }
        self.reduce_mixed();
    }

    /// Works off the mixed rows that are waiting.
    fn reduce_mixed(&mut self) {
        let (order, filled) = (self.columns + 1, std::mem::take(&mut self.filled));
        let Group { width, values, .. } = &mut self.groups[0];
        let rows = &mut self.waiting[..filled * *width];
        if self.precise {
            panels::reduce(values, order, rows, *width, &mut self.work);
        } else {
            accumulate(rows, *width, filled, *width, order, values);
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
        let width = outputs.next_multiple_of(VECTOR);
        Self { outputs, width, sums: vec![0.0; outputs * width], residuals: vec![0.0; ROWS * width] }
    }

    /// Begins a run.
    pub(crate) fn begin(&mut self) {
        self.sums.fill(0.0);
    }

    /// Takes the squares from the sums of a run whose outputs are apart; products of different outputs stay zero.
    pub(crate) fn take_squares(&mut self, sums: &Sums) {
        for o in 0..self.outputs {
            self.sums[o * self.width + o] = sums.groups[o].square();
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
            let group = &products.groups[o];
            let place = |lane: usize| group.columns.get(lane).map_or(columns, |c| *c as usize);
            for (a, i) in (0..=group.columns.len()).map(|a| (a, place(a))) {
                for (b, j) in (a..=group.columns.len()).map(|b| (b, place(b))) {
                    let cells = (o..n * q).step_by(q).filter(|k| *k != 6);
                    let want: f64 = cells.map(|k| cell(k, i) * cell(k, j)).sum();
                    let product = group.values[a * group.width + b];
                    let Group { values: t, width, .. } = &sums.groups[o];
                    let triangle: f64 = (0..=a).map(|r| t[r * width + a] * t[r * width + b]).sum();
                    assert!((product - want).abs() < 1e-12 && (triangle - want).abs() < 1e-12, "{o} {i} {j}");
                }
            }
            assert_eq!(group.columns.len(), if o == 0 { columns } else { 3 });
            assert_eq!(group.square(), moments.at(o, o), "the same residuals in the same order");
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
        let at = |i: usize, j: usize| sums.groups[0].values[i * sums.groups[0].width + j];
        assert_eq!((at(0, 0), at(0, 1), at(0, 2)), (4.0, 14.0, 34.0));
        assert_eq!((at(1, 1), at(1, 2), at(2, 2)), (49.0 + 144.0, 119.0 + 336.0, 289.0 + 784.0));
    }
}
