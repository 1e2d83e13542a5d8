//! The processor's widest registers: the one choice of instructions, and memory and loops over whole vectors.
//!
//! What is [`dispatch`]ed is compiled once for every set of instructions that this processor family has, and the widest that is
//! there runs it. Everything below it must be inlined into it: elsewhere a fused multiply-add would be a call. Each dispatched task
//! is therefore compiled several times, so tasks are whole loops, not their bodies.

pub use pulp::{Simd, WithSimd};

/// Numbers in the widest register, to which rows are padded.
pub const VECTOR: usize = 8;

/// Runs a task with the widest instructions of this processor. A closure is none: see [`widest`].
#[inline(always)]
pub fn dispatch<T: WithSimd>(task: T) -> T::Output {
    pulp::Arch::new().dispatch(task)
}

/// Runs a closure, which says `#[inline(always)]` as what it calls does, with the widest instructions of this
/// processor. (As a task it would be called once by value, and for a closure that need not be that is a function of its
/// own, compiled for the least of processors.)
#[inline(always)]
pub fn widest<O>(work: impl FnMut() -> O) -> O {
    dispatch(Inlined(work))
}

struct Inlined<F>(F);

impl<O, F: FnMut() -> O> WithSimd for Inlined<F> {
    type Output = O;

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, _: S) -> O {
        (self.0)()
    }
}

/// `to += a from`, whole vectors.
#[inline(always)]
pub fn accumulate(a: f64, from: &[f64], to: &mut [f64]) {
    for (t, f) in to.as_chunks_mut::<VECTOR>().0.iter_mut().zip(from.as_chunks::<VECTOR>().0) {
        for l in 0..VECTOR {
            t[l] = a.mul_add(f[l], t[l]);
        }
    }
}

/// The chosen lanes, then zeros.
#[inline(always)]
pub fn gather(lane_of: &[u32], lanes: &[f64], row: &mut [f64]) {
    let (chosen, rest) = row.split_at_mut(lane_of.len());
    chosen.iter_mut().zip(lane_of).for_each(|(r, l)| *r = lanes[*l as usize]);
    rest.fill(0.0);
}

/// Copies whole vectors without a call.
#[inline(always)]
pub fn copy_vectors(from: &[f64], to: &mut [f64]) {
    for (t, f) in to.as_chunks_mut::<VECTOR>().0.iter_mut().zip(from.as_chunks::<VECTOR>().0) {
        *t = *f;
    }
}

/// Numbers that begin on a cache line, so that no vector straddles two.
#[derive(Debug, Default)]
pub struct Aligned<T = f64> {
    numbers: Vec<T>,
    start: usize,
    len: usize,
}

impl<T: Copy + Default> Aligned<T> {
    /// Zeros.
    pub fn new(len: usize) -> Self {
        let numbers = vec![T::default(); len + VECTOR];
        // 64 bytes; an address that cannot be aligned only costs speed
        let start = numbers.as_ptr().align_offset(64);
        Self { numbers, start: if start < VECTOR { start } else { 0 }, len }
    }
}

impl<T: Copy + Default> Clone for Aligned<T> {
    fn clone(&self) -> Self {
        let mut copy = Self::new(self.len);
        copy.copy_from_slice(self);
        copy
    }
}

impl<T> std::ops::Deref for Aligned<T> {
    type Target = [T];

    #[inline(always)]
    fn deref(&self) -> &[T] {
        &self.numbers[self.start..self.start + self.len]
    }
}

impl<T> std::ops::DerefMut for Aligned<T> {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut [T] {
        &mut self.numbers[self.start..self.start + self.len]
    }
}
