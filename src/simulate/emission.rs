//! Hands outputs and sensitivities of one sample after the other to whoever wants them, a block at a time.

use super::block::{Gathering, RowLayout, Sink};
use super::observation::Observation;
use super::simulator::{Divergence, Simulator};
use super::vectors::{VECTOR, copy_vectors};
use crate::dynamics::Layout;

/// Observes samples and gathers them.
pub(super) struct Emission {
    observation: Observation,
    gathering: Gathering,
    /// Rows of one sample without the free lane, when that is not merely padding.
    bare: Vec<f64>,
}

impl Emission {
    /// # Panics
    /// As [`Observation::new`].
    pub(super) fn new(layout: &Layout, columns: &[usize]) -> Self {
        let observation = Observation::new(layout, columns);
        let rows = RowLayout::full(layout.outputs, columns.len());
        let bare = if rows.length == layout.outputs * observation.stride { 0 } else { observation.stride };
        Self { observation, gathering: Gathering::new(rows), bare: vec![0.0; layout.outputs * bare] }
    }

    /// Begins a run.
    pub(super) fn begin(&mut self) {
        self.gathering.begin();
    }

    /// The sample that is node k, whose states have the sensitivities `s` (n rows of lanes).
    #[inline(always)]
    pub(super) fn sample(
        &mut self,
        simulator: &mut Simulator<'_>,
        (sample, k): (usize, usize),
        s: &[f64],
        sink: &mut Sink<'_>,
    ) -> Result<(), Divergence> {
        let (y, rows) = self.gathering.next();
        if self.bare.is_empty() {
            self.observation.observe(simulator, (sample, k), s, y, rows)?;
        } else {
            self.observation.observe(simulator, (sample, k), s, y, &mut self.bare)?;
            let stride = self.observation.stride;
            for (row, bare) in rows.chunks_exact_mut(stride + VECTOR).zip(self.bare.chunks_exact(stride.max(1))) {
                copy_vectors(bare, row);
            }
        }
        self.gathering.filled(1, sink);
        Ok(())
    }

    /// Hands over what is left at the end of a run.
    pub(super) fn flush(&mut self, sink: &mut Sink<'_>) {
        self.gathering.flush(sink);
    }
}
