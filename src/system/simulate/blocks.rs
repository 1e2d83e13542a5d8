//! Responses with their sensitivities, handed over a cache-full at a time: the whole Jacobian is never stored.
//!
//! In the time domain a [`Block`] holds consecutive samples. In the frequency domain [`Planes`] hold consecutive frequencies, one output
//! and one column after the other; estimation counts real and imaginary parts as samples of their own: frequency k is samples
//! 2 k and 2 k + 1.

use fdm_numeric::lanes::{Aligned, VECTOR, copy_vectors};

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
    /// The row of each output (q); between them there may be others.
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

    /// What an output at a sample of the block leaves of `measured` (N by q, all samples); NaN where nothing was measured.
    pub fn residual(&self, measured: &[f64], sample: usize, output: usize) -> f64 {
        let q = self.layout.outputs.len();
        measured[(self.first + sample) * q + output] - self.y[sample * q + output]
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

/// Numbers of rows in a block where they are computed where they are handed over: as no second array of them passes
/// through that cache, what is done once for each block decides.
const CONTINUED: usize = 8192;

/// Gathers samples until a block is full.
pub(super) struct Gathering {
    layout: RowLayout,
    y: Vec<f64>,
    rows: Aligned,
    first: usize,
    filled: usize,
    capacity: usize,
    /// Samples whose room is before those of a block: one where rows are continued from those before them, or none.
    lead: usize,
}

impl Gathering {
    pub(super) fn new(layout: RowLayout) -> Self {
        // numbers of rows in a block: what stays in the cache nearest to the processor, or hardly leaves it; sums are
        // fetched and put back once for each block
        let capacity = (4096 / layout.length.max(1)).clamp(4, 128);
        Self::of(layout, capacity, 0)
    }

    /// Of rows that are continued from those of the sample before, which have room before those of every block.
    pub(super) fn continued(layout: RowLayout) -> Self {
        let capacity = (CONTINUED / layout.length.max(1)).clamp(16, 128);
        Self::of(layout, capacity, 1)
    }

    fn of(layout: RowLayout, capacity: usize, lead: usize) -> Self {
        let (y, rows) = (vec![0.0; capacity * layout.outputs.len()], Aligned::new((capacity + lead) * layout.length));
        Self { layout, y, rows, first: 0, filled: 0, capacity, lead }
    }

    /// Most samples of a block.
    pub(super) fn capacity(&self) -> usize {
        self.capacity
    }

    /// Begins a run.
    pub(super) fn begin(&mut self) {
        (self.first, self.filled) = (0, 0);
    }

    /// Outputs and rows of the next sample, to be filled.
    #[inline(always)]
    pub(super) fn next(&mut self) -> (&mut [f64], &mut [f64]) {
        let (q, length) = (self.layout.outputs.len(), self.layout.length);
        (&mut self.y[self.filled * q..][..q], &mut self.rows[(self.filled + self.lead) * length..][..length])
    }

    /// Outputs and rows of the next samples, at most `count` of them: arrangement, outputs, rows (continued ones with the room before them),
    /// and how many these are.
    #[inline(always)]
    pub(super) fn several(&mut self, count: usize) -> (&RowLayout, &mut [f64], &mut [f64], usize) {
        let (q, length, room) = (self.layout.outputs.len(), self.layout.length, self.capacity - self.filled);
        let count = count.min(room);
        let y = &mut self.y[self.filled * q..][..count * q];
        (&self.layout, y, &mut self.rows[self.filled * length..][..(count + self.lead) * length], count)
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
            let length = self.layout.length;
            let (y, rows) =
                (&self.y[..count * self.layout.outputs.len()], &mut self.rows[self.lead * length..][..count * length]);
            sink(Block { first: self.first, y, rows, layout: &self.layout });
            self.first += count;
        }
    }
}

/// Takes the blocks of a response at frequencies, in their order.
pub type PlaneSink<'s> = dyn FnMut(Planes<'_>) + 's;

/// Consecutive frequencies of a response with their sensitivities.
///
/// A plane is [`Planes::HALF`] real parts and as many imaginary parts. Behind the frequencies that there are everything is
/// zero up to `lanes`.
pub struct Planes<'b> {
    /// The first of the frequencies.
    pub first: usize,
    /// How many there are.
    pub count: usize,
    /// The number of frequencies rounded up to a multiple of 8.
    pub lanes: usize,
    /// A plane for each output (q).
    pub y: &'b [f64],
    /// For each output a plane for each of its columns, then one that is free (for a residual); whoever takes the block may
    /// write to all of them.
    pub derivatives: &'b mut [f64],
    /// The columns of each output.
    pub layout: &'b RowLayout,
}

impl Planes<'_> {
    /// Most frequencies of a block.
    pub const HALF: usize = 64;
    /// Numbers of a plane.
    pub const LENGTH: usize = 2 * Self::HALF;

    /// Samples (rows of q, two for each frequency) as planes: for each block of frequencies one plane for each output.
    pub fn of_samples(samples: &[f64], outputs: usize) -> Vec<f64> {
        let mut planes = Vec::new();
        for block in samples.chunks(Self::LENGTH * outputs.max(1)) {
            let start = planes.len();
            planes.resize(start + outputs * Self::LENGTH, 0.0);
            for (sample, row) in block.chunks_exact(outputs.max(1)).enumerate() {
                for (o, value) in row.iter().enumerate() {
                    planes[start + o * Self::LENGTH + sample % 2 * Self::HALF + sample / 2] = *value;
                }
            }
        }
        planes
    }

    /// Writes the outputs of the block to their samples (all samples, by q).
    pub fn copy_outputs(&self, samples: &mut [f64]) {
        let q = self.layout.outputs.len();
        let rows = &mut samples[2 * self.first * q..][..2 * self.count * q];
        for (o, plane) in self.y.chunks_exact(Self::LENGTH).enumerate() {
            let (re, im) = plane.split_at(Self::HALF);
            for (row, (re, im)) in rows.chunks_exact_mut(2 * q).zip(re.iter().zip(im)) {
                (row[o], row[q + o]) = (*re, *im);
            }
        }
    }

    /// Writes outputs (samples by q) and rows of sensitivities (samples by `layout.length`) of the block.
    pub fn copy_to(&self, y: &mut [f64], rows: &mut [f64]) {
        let (q, length) = (self.layout.outputs.len(), self.layout.length);
        let mut planes = self.derivatives.chunks_exact(Self::LENGTH);
        for (o, output) in self.layout.outputs.iter().enumerate() {
            let values = &self.y[o * Self::LENGTH..][..Self::LENGTH];
            (0..2 * self.count).for_each(|s| y[s * q + o] = values[s % 2 * Self::HALF + s / 2]);
            for lane in 0..=output.columns.len() {
                let Some(plane) = planes.next() else { return };
                (0..2 * self.count)
                    .for_each(|s| rows[s * length + output.start + lane] = plane[s % 2 * Self::HALF + s / 2]);
            }
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
