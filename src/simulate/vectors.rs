//! Numbers in whole vectors: memory that begins on a cache line, and the few loops over rows of lanes.
//!
//! The loops are inlined into the one function that is compiled for the machine's widest registers; elsewhere a fused
//! multiply-add would be a call.

/// Numbers in the widest register, to which rows are padded.
pub(super) const VECTOR: usize = fdm_grammar::schedule::StageRow::VECTOR;

/// `to += a from`, whole vectors. Inlined where a fused multiply-add is one instruction.
#[inline(always)]
pub(super) fn accumulate(a: f64, from: &[f64], to: &mut [f64]) {
    for (t, f) in to.as_chunks_mut::<VECTOR>().0.iter_mut().zip(from.as_chunks::<VECTOR>().0) {
        for l in 0..VECTOR {
            t[l] = a.mul_add(f[l], t[l]);
        }
    }
}

/// The chosen lanes, then zeros.
#[inline(always)]
pub(super) fn gather(lane_of: &[u32], lanes: &[f64], row: &mut [f64]) {
    let (chosen, rest) = row.split_at_mut(lane_of.len());
    chosen.iter_mut().zip(lane_of).for_each(|(r, l)| *r = lanes[*l as usize]);
    rest.fill(0.0);
}

/// Copies whole vectors without a call.
#[inline(always)]
pub(super) fn copy_vectors(from: &[f64], to: &mut [f64]) {
    for (t, f) in to.as_chunks_mut::<VECTOR>().0.iter_mut().zip(from.as_chunks::<VECTOR>().0) {
        *t = *f;
    }
}

/// Numbers that begin on a cache line, so that no vector straddles two.
pub(crate) struct Aligned {
    numbers: Vec<f64>,
    start: usize,
    len: usize,
}

impl Aligned {
    pub(crate) fn new(len: usize) -> Self {
        let numbers = vec![0.0; len + VECTOR];
        // 64 bytes; an address that cannot be aligned only costs speed
        let start = numbers.as_ptr().align_offset(64);
        Self { numbers, start: if start < VECTOR { start } else { 0 }, len }
    }
}

impl std::ops::Deref for Aligned {
    type Target = [f64];

    #[inline(always)]
    fn deref(&self) -> &[f64] {
        &self.numbers[self.start..self.start + self.len]
    }
}

impl std::ops::DerefMut for Aligned {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut [f64] {
        &mut self.numbers[self.start..self.start + self.len]
    }
}
