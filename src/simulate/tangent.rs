//! One Runge-Kutta step of the sensitivities: `S' = f_x S + f_theta`, all parameters in lanes.
//!
//! The four stages' partials are known before (they do not depend on S), so the step is linear in S. Lanes never mix:
//! the result has the same bits whatever the width of the machine's registers, because every one of them is
//! computed by the same fused multiply-adds.

use fdm_grammar::Pattern;
use pulp::Simd;

/// The structure of f_x, with columns as offsets into rows of vectors.
#[derive(Debug, Clone)]
pub(super) struct TangentPlan {
    states: usize,
    rows: Vec<u32>,
    columns: Vec<u32>,
    /// First entry of f_x in a stage's row, and the length of that row.
    first: usize,
    slots: usize,
    /// Lanes of a sensitivity row, a multiple of 8.
    stride: usize,
}

/// What one step needs: partials (4 by slots) and forcing f_theta, scattered into lanes (4 by n by stride).
pub(super) struct Stages<'a> {
    pub(super) h: f64,
    pub(super) partials: &'a [f64],
    pub(super) forcing: &'a [f64],
}

impl TangentPlan {
    pub(super) fn new(states: usize, f_x: &Pattern, slots: usize, stride: usize) -> Self {
        Self { states, rows: f_x.rows.clone(), columns: f_x.columns.clone(), first: states, slots, stride }
    }

    /// Length of the scratch that [`TangentPlan::step`] needs: two stage tangents and the sum of the slopes.
    pub(super) fn scratch(&self) -> usize {
        3 * self.states * self.stride
    }

    /// Advances S (n by stride) by one step.
    #[inline(always)]
    pub(super) fn step<S: Simd>(&self, simd: S, stages: &Stages<'_>, s: &mut [f64], scratch: &mut [f64]) {
        let width = self.stride / S::F64_LANES;
        let mut tile = 0;
        while tile < width {
            tile += match width - tile {
                1 => self.tile::<S, 1>(simd, stages, tile, s, scratch),
                2 => self.tile::<S, 2>(simd, stages, tile, s, scratch),
                3 => self.tile::<S, 3>(simd, stages, tile, s, scratch),
                _ => self.tile::<S, 4>(simd, stages, tile, s, scratch),
            };
        }
    }

    /// Advances the L vectors from `tile` on of every row; columns of S do not depend on each other.
    #[inline(always)]
    fn tile<S: Simd, const L: usize>(
        &self,
        simd: S,
        stages: &Stages<'_>,
        tile: usize,
        s: &mut [f64],
        scratch: &mut [f64],
    ) -> usize {
        let width = self.stride / S::F64_LANES;
        let block = self.states * width;
        let s = S::as_mut_simd_f64s(s).0;
        let scratch = S::as_mut_simd_f64s(scratch).0;
        let (first, rest) = scratch.split_at_mut(block);
        let (second, sum) = rest.split_at_mut(block);
        let forcing = S::as_simd_f64s(stages.forcing).0;
        let stage = |k: usize| Stage {
            plan: self,
            entries: &stages.partials[k * self.slots + self.first..][..self.columns.len()],
            forcing: &forcing[k * block..(k + 1) * block],
            width,
            tile,
        };
        let h = stages.h;
        let (half, sixth, third) = (simd.splat_f64s(0.5 * h), simd.splat_f64s(h / 6.0), simd.splat_f64s(h / 3.0));
        let whole = simd.splat_f64s(h);
        for i in 0..self.states {
            let at = i * width + tile;
            let k = stage(0).slope::<S, L>(simd, i, s);
            let x: [S::f64s; L] = load(s, at);
            store(first, at, axpy(simd, half, k, x));
            store(sum, at, axpy(simd, sixth, k, x));
        }
        for i in 0..self.states {
            let at = i * width + tile;
            let k = stage(1).slope::<S, L>(simd, i, first);
            store(second, at, axpy(simd, half, k, load(s, at)));
            store(sum, at, axpy(simd, third, k, load(sum, at)));
        }
        for i in 0..self.states {
            let at = i * width + tile;
            let k = stage(2).slope::<S, L>(simd, i, second);
            store(first, at, axpy(simd, whole, k, load(s, at)));
            store(sum, at, axpy(simd, third, k, load(sum, at)));
        }
        for i in 0..self.states {
            let at = i * width + tile;
            let k = stage(3).slope::<S, L>(simd, i, first);
            store(s, at, axpy(simd, sixth, k, load(sum, at)));
        }
        L
    }
}

struct Stage<'a, V> {
    plan: &'a TangentPlan,
    entries: &'a [f64],
    forcing: &'a [V],
    width: usize,
    tile: usize,
}

impl<V: Copy> Stage<'_, V> {
    /// Row i of `f_x S + f_theta`, L vectors of it.
    #[inline(always)]
    fn slope<S: Simd<f64s = V>, const L: usize>(&self, simd: S, i: usize, s: &[V]) -> [V; L] {
        let mut k: [V; L] = load(self.forcing, i * self.width + self.tile);
        let range = self.plan.rows[i] as usize..self.plan.rows[i + 1] as usize;
        for (a, j) in self.entries[range.clone()].iter().zip(&self.plan.columns[range]) {
            k = axpy(simd, simd.splat_f64s(*a), load(s, *j as usize * self.width + self.tile), k);
        }
        k
    }
}

#[inline(always)]
fn load<V: Copy, const L: usize>(from: &[V], at: usize) -> [V; L] {
    let from = &from[at..at + L];
    std::array::from_fn(|l| from[l])
}

#[inline(always)]
fn store<V: Copy, const L: usize>(to: &mut [V], at: usize, v: [V; L]) {
    to[at..at + L].copy_from_slice(&v);
}

/// `a x + y`
#[inline(always)]
fn axpy<S: Simd, const L: usize>(simd: S, a: S::f64s, x: [S::f64s; L], y: [S::f64s; L]) -> [S::f64s; L] {
    std::array::from_fn(|l| simd.mul_add_f64s(a, x[l], y[l]))
}
