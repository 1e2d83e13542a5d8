//! A complex response with its sensitivities, a block of frequencies at a time, one output and one column after the other.
//!
//! Estimation counts real and imaginary parts as samples of their own: frequency k is samples 2 k and 2 k + 1.

use super::block::RowLayout;

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
    /// The same rounded up to a multiple of 8.
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
