//! A program over one block of frequencies, in the processor's widest registers.
//!
//! A plane is a block of real parts and a block of imaginary parts. Every instruction sweeps over its planes; what it costs
//! to find the next instruction is shared by all frequencies of the block. Lanes do not mix, so that every width gives the
//! same bits.

use super::program::{DATA, FLAGS, Op, Plane, Program};
use crate::simulate::Planes;
use pulp::{Simd, WithSimd};
use std::cell::Cell;

/// Frequencies in a block.
pub(super) const BLOCK: usize = Planes::HALF;
/// Numbers of a plane.
pub(super) const PLANE: usize = Planes::LENGTH;
/// The leaf 1/(j w), whose imaginary part is -1/w.
pub(super) const INVERSE: u32 = 0;
/// The leaf j w.
pub(super) const OMEGA: u32 = 1;
/// The first leaf behind these.
pub(super) const BEHIND: u32 = 2;

/// A pivot may be smaller or larger than its diagonal was by the root of this before another order is asked for.
const TRUST: f64 = 1e10;

/// A program and its memory: the leaves of all blocks, then registers and planes of derivatives.
pub(super) struct Execution<'e> {
    pub(super) program: &'e Program,
    pub(super) scalars: &'e [f64],
    pub(super) memory: &'e mut [f64],
    /// Where the leaves of this block begin, in planes.
    pub(super) leaves: usize,
    /// Where the registers begin.
    pub(super) registers: usize,
    /// Frequencies, a multiple of 8.
    pub(super) lanes: usize,
}

impl Execution<'_> {
    pub(super) fn run(self) {
        pulp::Arch::new().dispatch(self);
    }
}

/// Where one instruction reads and writes.
struct Memory<'m, V> {
    cells: &'m [Cell<V>],
    /// Vectors of a plane's real parts.
    half: usize,
    /// How many of them are in use.
    count: usize,
    leaves: usize,
    registers: usize,
}

type Pair<'m, V> = (&'m [Cell<V>], &'m [Cell<V>]);

impl<'m, V> Memory<'m, V> {
    #[inline(always)]
    fn at(&self, plane: Plane) -> Pair<'m, V> {
        let first = if plane & DATA == 0 { self.registers } else { self.leaves };
        let index = (plane & !DATA) as usize + first;
        let (re, im) = self.cells[2 * index * self.half..][..2 * self.half].split_at(self.half);
        (&re[..self.count], &im[..self.count])
    }
}

/// (re, im) += sign (a b).
#[inline(always)]
fn multiply_add<S: Simd>(
    simd: S,
    (ar, ai): (S::f64s, S::f64s),
    (br, bi): (S::f64s, S::f64s),
    (re, im): (S::f64s, S::f64s),
) -> (S::f64s, S::f64s) {
    let re = simd.negate_mul_add_f64s(ai, bi, simd.mul_add_f64s(ar, br, re));
    (re, simd.mul_add_f64s(ai, br, simd.mul_add_f64s(ar, bi, im)))
}

#[inline(always)]
fn multiply_subtract<S: Simd>(
    simd: S,
    (ar, ai): (S::f64s, S::f64s),
    (br, bi): (S::f64s, S::f64s),
    (re, im): (S::f64s, S::f64s),
) -> (S::f64s, S::f64s) {
    let re = simd.mul_add_f64s(ai, bi, simd.negate_mul_add_f64s(ar, br, re));
    (re, simd.negate_mul_add_f64s(ai, br, simd.negate_mul_add_f64s(ar, bi, im)))
}

#[inline(always)]
fn multiply<S: Simd>(simd: S, (ar, ai): (S::f64s, S::f64s), (br, bi): (S::f64s, S::f64s)) -> (S::f64s, S::f64s) {
    let re = simd.negate_mul_add_f64s(ai, bi, simd.mul_f64s(ar, br));
    (re, simd.mul_add_f64s(ai, br, simd.mul_f64s(ar, bi)))
}

#[inline(always)]
fn get<V: Copy>(pair: Pair<'_, V>, v: usize) -> (V, V) {
    (pair.0[v].get(), pair.1[v].get())
}

#[inline(always)]
fn set<V: Copy>(pair: Pair<'_, V>, v: usize, (re, im): (V, V)) {
    pair.0[v].set(re);
    pair.1[v].set(im);
}

impl WithSimd for Execution<'_> {
    type Output = ();

    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "all planes of an instruction are indexed alike")]
    fn with_simd<S: Simd>(self, simd: S) {
        let cells = Cell::from_mut(S::as_mut_simd_f64s(self.memory).0).as_slice_of_cells();
        let (half, count) = (BLOCK / S::F64_LANES, self.lanes / S::F64_LANES);
        let planes = Memory { cells, half, count, leaves: self.leaves, registers: self.registers };
        let k = |s: super::scalar::Scalar| self.scalars[s.0 as usize];
        let zero = simd.splat_f64s(0.0);
        let omega = planes.at(DATA | OMEGA).1;
        let flags = planes.at(FLAGS);
        (0..count).for_each(|v| set(flags, v, (zero, zero)));
        for op in &self.program.ops {
            match *op {
                Op::Product(d, a, b) => {
                    let (d, a, b) = (planes.at(d), planes.at(a), planes.at(b));
                    for v in 0..count {
                        set(d, v, multiply(simd, get(a, v), get(b, v)));
                    }
                }
                Op::NegativeProduct(d, a, b) => {
                    let (d, a, b) = (planes.at(d), planes.at(a), planes.at(b));
                    for v in 0..count {
                        let (re, im) = get(b, v);
                        set(d, v, multiply(simd, get(a, v), (simd.neg_f64s(re), simd.neg_f64s(im))));
                    }
                }
                Op::ImaginaryProduct(d, a, b) => {
                    let (d, a, b) = (planes.at(d), planes.at(a), planes.at(b));
                    for v in 0..count {
                        let (ai, (br, bi)) = (a.1[v].get(), get(b, v));
                        set(d, v, (simd.neg_f64s(simd.mul_f64s(ai, bi)), simd.mul_f64s(ai, br)));
                    }
                }
                Op::ProductAdd(d, a, b, c) => {
                    let (d, a, b, c) = (planes.at(d), planes.at(a), planes.at(b), planes.at(c));
                    for v in 0..count {
                        set(d, v, multiply_add(simd, get(a, v), get(b, v), get(c, v)));
                    }
                }
                Op::ProductSubtract(d, a, b, c) => {
                    let (d, a, b, c) = (planes.at(d), planes.at(a), planes.at(b), planes.at(c));
                    for v in 0..count {
                        set(d, v, multiply_subtract(simd, get(a, v), get(b, v), get(c, v)));
                    }
                }
                Op::Scale(d, f, a) => {
                    let (d, a, f) = (planes.at(d), planes.at(a), simd.splat_f64s(k(f)));
                    for v in 0..count {
                        let (re, im) = get(a, v);
                        set(d, v, (simd.mul_f64s(f, re), simd.mul_f64s(f, im)));
                    }
                }
                Op::Combine(d, (f, a), (h, b)) => {
                    let (d, a, b) = (planes.at(d), planes.at(a), planes.at(b));
                    let (f, h) = (simd.splat_f64s(k(f)), simd.splat_f64s(k(h)));
                    for v in 0..count {
                        let ((ar, ai), (br, bi)) = (get(a, v), get(b, v));
                        let re = simd.mul_add_f64s(h, br, simd.mul_f64s(f, ar));
                        set(d, v, (re, simd.mul_add_f64s(h, bi, simd.mul_f64s(f, ai))));
                    }
                }
                Op::ScaleAdd(d, f, a, c) => {
                    let (d, a, c, f) = (planes.at(d), planes.at(a), planes.at(c), simd.splat_f64s(k(f)));
                    for v in 0..count {
                        let ((ar, ai), (cr, ci)) = (get(a, v), get(c, v));
                        set(d, v, (simd.mul_add_f64s(f, ar, cr), simd.mul_add_f64s(f, ai, ci)));
                    }
                }
                Op::Constant(d, c, jw) => {
                    let (d, c) = (planes.at(d), simd.splat_f64s(k(c)));
                    for v in 0..count {
                        set(d, v, (c, if jw { omega[v].get() } else { zero }));
                    }
                }
                Op::ConstantAdd(d, c, jw, f, a) => {
                    let (d, a) = (planes.at(d), planes.at(a));
                    let (c, f) = (simd.splat_f64s(k(c)), simd.splat_f64s(k(f)));
                    for v in 0..count {
                        let ((ar, ai), w) = (get(a, v), if jw { omega[v].get() } else { zero });
                        set(d, v, (simd.mul_add_f64s(f, ar, c), simd.mul_add_f64s(f, ai, w)));
                    }
                }
                Op::Lag(d, a) => {
                    let (d, a) = (planes.at(d), planes.at(a));
                    for v in 0..count {
                        let ((re, im), w) = (get(a, v), omega[v].get());
                        set(d, v, (simd.mul_f64s(w, im), simd.neg_f64s(simd.mul_f64s(w, re))));
                    }
                }
                Op::Pole(d, c) => {
                    let (d, c) = (planes.at(d), simd.splat_f64s(k(c)));
                    for v in 0..count {
                        let w = omega[v].get();
                        let square = simd.mul_add_f64s(w, w, simd.mul_f64s(c, c));
                        let one = simd.div_f64s(simd.splat_f64s(1.0), square);
                        set(d, v, (simd.mul_f64s(c, one), simd.neg_f64s(simd.mul_f64s(w, one))));
                    }
                }
                Op::Pivot(d, a, c, seen) => {
                    let (d, a, c) = (planes.at(d), planes.at(a), simd.splat_f64s(k(c)));
                    let (low, high) = (simd.splat_f64s(1.0 / TRUST), simd.splat_f64s(TRUST));
                    for v in 0..count {
                        let ((re, im), w) = (get(a, v), omega[v].get());
                        let square = simd.mul_add_f64s(re, re, simd.mul_f64s(im, im));
                        let before = simd.mul_add_f64s(w, w, simd.mul_f64s(c, c));
                        let above = simd.less_than_f64s(simd.mul_f64s(low, before), square);
                        let below = simd.less_than_f64s(square, simd.mul_f64s(high, before));
                        let flag = |flag: S::f64s| {
                            let one = simd.splat_f64s(1.0);
                            simd.select_f64s(above, simd.select_f64s(below, flag, one), one)
                        };
                        flags.1[v].set(flag(flags.1[v].get()));
                        if seen {
                            flags.0[v].set(flag(flags.0[v].get()));
                        }
                        let one = simd.div_f64s(simd.splat_f64s(1.0), square);
                        set(d, v, (simd.mul_f64s(re, one), simd.neg_f64s(simd.mul_f64s(im, one))));
                    }
                }
            }
        }
    }
}
