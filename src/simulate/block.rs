//! A response with its sensitivities, handed over a cache-full of samples at a time: the whole Jacobian is never stored.

use super::vectors::{Aligned, VECTOR, copy_vectors};

/// Takes the blocks of a response, in the order of the samples.
pub type Sink<'s> = dyn FnMut(Block<'_>) + 's;

/// Consecutive samples of a response with their sensitivities.
pub struct Block<'b> {
    /// The first of the samples.
    pub first: usize,
    /// Outputs, samples by q.
    pub y: &'b [f64],
    /// Rows of sensitivities, samples by `layout.length`; whoever takes the block may write to the free lanes.
    pub rows: &'b mut [f64],
    /// Where the row of each output stands.
    pub layout: &'b RowLayout,
}

/// How the sensitivities of a sample are arranged: one row for each output.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct RowLayout {
    /// The row of each output (q).
    pub outputs: Vec<OutputRow>,
    /// Numbers from one sample to the next, a multiple of 8.
    pub length: usize,
}

/// The row of one output: a lane for each column that it can depend on; then one lane that is free (for a residual),
/// and zeros up to a multiple of 8.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OutputRow {
    /// First number of the row within its sample.
    pub start: usize,
    /// Length, a multiple of 8.
    pub width: usize,
    /// The column of each lane, rising, as positions in the `columns` that were asked for; derivatives by all others are
    /// zero. The lane behind them is the free one.
    pub columns: Vec<u32>,
}

impl RowLayout {
    /// Rows one after the other, with the columns given for each output.
    pub fn new(columns: impl IntoIterator<Item = Vec<u32>>) -> Self {
        let mut layout = Self::default();
        for columns in columns {
            let (start, width) = (layout.length, (columns.len() + 1).next_multiple_of(VECTOR));
            layout.outputs.push(OutputRow { start, width, columns });
            layout.length += width;
        }
        layout
    }

    /// All columns for every output.
    pub fn full(outputs: usize, columns: usize) -> Self {
        Self::new((0..outputs).map(|_| (0..columns as u32).collect()))
    }
}

impl Block<'_> {
    /// Number of samples.
    pub fn samples(&self) -> usize {
        self.y.len() / self.layout.outputs.len().max(1)
    }

    /// The derivatives of an output at a sample of the block, one for each of `layout.outputs[output].columns`.
    pub fn row(&self, sample: usize, output: usize) -> &[f64] {
        let place = &self.layout.outputs[output];
        &self.rows[sample * self.layout.length + place.start..][..place.columns.len()]
    }

    /// Copies outputs (N by q) and derivatives (N q rows of `stride`) to their places among all samples.
    pub fn copy_to(&self, y: &mut [f64], jacobian: &mut [f64], stride: usize) {
        let q = self.layout.outputs.len();
        y[self.first * q..][..self.y.len()].copy_from_slice(self.y);
        for sample in 0..self.samples() {
            for (o, output) in self.layout.outputs.iter().enumerate() {
                let row = &mut jacobian[((self.first + sample) * q + o) * stride..][..stride];
                let lanes = &self.rows[sample * self.layout.length + output.start..][..output.width];
                // rising columns of which the last one is the length less one are all of them
                if output.columns.last().is_some_and(|last| *last as usize + 1 == output.columns.len()) {
                    copy_vectors(lanes, row);
                    row[output.columns.len()..].fill(0.0);
                    continue;
                }
                row.fill(0.0);
                output.columns.iter().zip(lanes).for_each(|(c, value)| row[*c as usize] = *value);
            }
        }
    }
}

/// Numbers of rows in a block: what stays in the cache nearest to the processor, or hardly leaves it; sums are fetched and put
/// back once for each block.
const NUMBERS: usize = 4096;

/// Gathers samples until a block is full.
pub(super) struct Gathering {
    layout: RowLayout,
    y: Vec<f64>,
    rows: Aligned,
    first: usize,
    filled: usize,
    capacity: usize,
}

impl Gathering {
    pub(super) fn new(layout: RowLayout) -> Self {
        let capacity = (NUMBERS / layout.length.max(1)).clamp(4, 128);
        let (y, rows) = (vec![0.0; capacity * layout.outputs.len()], Aligned::new(capacity * layout.length));
        Self { layout, y, rows, first: 0, filled: 0, capacity }
    }

    /// Begins a run.
    pub(super) fn begin(&mut self) {
        (self.first, self.filled) = (0, 0);
    }

    /// Outputs and rows of the next sample, to be filled.
    #[inline(always)]
    pub(super) fn next(&mut self) -> (&mut [f64], &mut [f64]) {
        let (q, length) = (self.layout.outputs.len(), self.layout.length);
        (&mut self.y[self.filled * q..][..q], &mut self.rows[self.filled * length..][..length])
    }

    /// Outputs and rows of the next samples, at most `count` of them: arrangement, outputs, rows, and how many these are.
    #[inline(always)]
    pub(super) fn several(&mut self, count: usize) -> (&RowLayout, &mut [f64], &mut [f64], usize) {
        let (q, length, room) = (self.layout.outputs.len(), self.layout.length, self.capacity - self.filled);
        let count = count.min(room);
        let y = &mut self.y[self.filled * q..][..count * q];
        (&self.layout, y, &mut self.rows[self.filled * length..][..count * length], count)
    }

    /// The next `count` samples have been filled.
    #[inline(always)]
    pub(super) fn filled(&mut self, count: usize, sink: &mut Sink<'_>) {
        self.filled += count;
        if self.filled == self.capacity {
            self.flush(sink);
        }
    }

    /// Hands over what has been gathered.
    pub(super) fn flush(&mut self, sink: &mut Sink<'_>) {
        let count = std::mem::take(&mut self.filled);
        if count > 0 {
            let (y, rows) =
                (&self.y[..count * self.layout.outputs.len()], &mut self.rows[..count * self.layout.length]);
            sink(Block { first: self.first, y, rows, layout: &self.layout });
            self.first += count;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_come_in_order_and_leave_a_lane_free() {
        let layout = RowLayout::new([vec![0, 2], (0..8).collect()]);
        assert_eq!((layout.outputs[0].width, layout.outputs[1].width, layout.length), (8, 16, 24));
        let mut gathering = Gathering::new(layout);
        let (samples, mut seen) = (300, 0);
        let (mut y, mut jacobian) = (vec![0.0; 2 * samples], vec![f64::NAN; 2 * samples * 8]);
        let mut sink = |block: Block<'_>| {
            assert_eq!(block.first, seen);
            seen += block.samples();
            block.copy_to(&mut y, &mut jacobian, 8);
        };
        gathering.begin();
        for k in 0..samples {
            let (y, rows) = gathering.next();
            y.copy_from_slice(&[k as f64, -(k as f64)]);
            rows.iter_mut().enumerate().for_each(|(l, r)| *r = (k * 100 + l) as f64);
            gathering.filled(1, &mut sink);
        }
        gathering.flush(&mut sink);
        assert_eq!(seen, samples);
        assert_eq!(&y[2 * 299..], &[299.0, -299.0]);
        assert_eq!(&jacobian[2 * 299 * 8..][..3], &[29_900.0, 0.0, 29_901.0]);
        assert_eq!(jacobian[(2 * 299 + 1) * 8 + 7], 29_915.0);
    }
}
