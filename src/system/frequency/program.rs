//! Expressions as a straight-line program over planes of frequencies: what is asked for, in order, in few registers; and its execution over
//! one block of frequencies, in the processor's widest registers.
//!
//! A plane is a block of real parts and a block of imaginary parts. Every instruction sweeps over its planes; what it costs
//! to find the next instruction is shared by all frequencies of the block. Lanes do not mix, so that every width gives the
//! same bits.

use super::elimination::{Expression, Expressions, INTEGRAL, Node, Scalar, Scalars};
use crate::simulate::Planes;
use fdm_numeric::lanes::{Simd, WithSimd, dispatch};
use std::cell::Cell;

/// A complex plane: a register of the block at hand, or with [`DATA`] a leaf.
pub(super) type Plane = u32;
/// Marks a plane that is read only.
pub(super) const DATA: Plane = 1 << 31;
/// The register that is other than zero at frequencies where a pivot was not to be trusted: the real part where outputs
/// depend on it, the imaginary part for any pivot.
pub(super) const FLAGS: Plane = 0;

/// One instruction; the first plane takes the result.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Op {
    /// 1/(j w + k).
    Pole(Plane, Scalar),
    /// 1/a, flagged where a is too far below or above j w + k; whether outputs depend on it.
    Pivot(Plane, Plane, Scalar, bool),
    /// a b.
    Product(Plane, Plane, Plane),
    /// -a b.
    NegativeProduct(Plane, Plane, Plane),
    /// a b where a is imaginary.
    ImaginaryProduct(Plane, Plane, Plane),
    /// c + a b.
    ProductAdd(Plane, Plane, Plane, Plane),
    /// c - a b.
    ProductSubtract(Plane, Plane, Plane, Plane),
    /// k a.
    Scale(Plane, Scalar, Plane),
    /// k a + l b.
    Combine(Plane, (Scalar, Plane), (Scalar, Plane)),
    /// c + k a.
    ScaleAdd(Plane, Scalar, Plane, Plane),
    /// k, and j w or not.
    Constant(Plane, Scalar, bool),
    /// k, j w or not, and l a.
    ConstantAdd(Plane, Scalar, bool, Scalar, Plane),
    /// -j w a.
    Lag(Plane, Plane),
}

/// What is computed for a block of frequencies.
#[derive(Debug, Clone)]
pub(super) struct Program {
    pub(super) ops: Vec<Op>,
    pub(super) scalars: Scalars,
    /// Registers, before the planes of derivatives.
    pub(super) registers: usize,
    /// The plane of each output (q); none for an output that is zero.
    pub(super) outputs: Vec<Option<Plane>>,
}

/// The places of results: outputs stay in registers, derivatives have planes of their own behind them.
pub(super) struct Results {
    /// The node of each output.
    pub(super) outputs: Vec<Option<Node>>,
    /// Nodes and the positions of their planes behind the registers.
    pub(super) derivatives: Vec<(Node, u32)>,
}

impl Program {
    pub(super) fn new(g: Expressions, results: &Results) -> Self {
        let mut emission = Emission::new(&g, results);
        for node in 0..g.nodes.len() {
            if emission.uses[1][node] > 0 && emission.apart[node] {
                emission.emit(node as Node);
            }
        }
        let mut allocation = Allocation::new(&g, results, emission.ops);
        allocation.run();
        let Allocation { ops, registers, home, .. } = allocation;
        let plane = |node: &Node| match g.nodes[*node as usize] {
            Expression::Leaf(leaf) => DATA | leaf,
            _ => home[*node as usize],
        };
        let outputs = results.outputs.iter().map(|o| o.as_ref().map(plane)).collect();
        Self { ops, scalars: g.scalars, registers, outputs }
    }
}

/// Nodes as instructions on virtual registers, one for each node.
struct Emission<'g> {
    g: &'g Expressions,
    /// How often each node is needed, for outputs alone and for everything.
    uses: [Vec<u32>; 2],
    /// Nodes that are computed by themselves.
    apart: Vec<bool>,
    ops: Vec<Op>,
}

impl<'g> Emission<'g> {
    fn new(g: &'g Expressions, results: &Results) -> Self {
        let outputs: Vec<Node> = results.outputs.iter().flatten().copied().collect();
        let all: Vec<Node> = outputs.iter().copied().chain(results.derivatives.iter().map(|d| d.0)).collect();
        let uses = [&outputs, &all].map(|roots| {
            let mut uses = vec![0u32; g.nodes.len()];
            roots.iter().for_each(|root| uses[*root as usize] += 1);
            for node in (0..g.nodes.len()).rev() {
                if uses[node] > 0 {
                    each_operand(&g.nodes[node], |operand| uses[operand as usize] += 1);
                }
            }
            // a result must be there by itself
            roots.iter().for_each(|root| uses[*root as usize] += 1);
            uses
        });
        let mut emission = Self { g, uses, apart: vec![false; g.nodes.len()], ops: Vec::new() };
        all.iter().for_each(|root| emission.apart[*root as usize] = true);
        for (node, expression) in
            g.nodes.iter().enumerate().filter(|(n, _)| emission.uses[1][*n] > 0).collect::<Vec<_>>()
        {
            match expression {
                Expression::Sum { terms, .. } => {
                    for (factor, term) in terms {
                        let taken = emission.factors(node as Node, *factor, *term).is_some();
                        emission.apart[*term as usize] |= !taken;
                    }
                }
                _ => each_operand(expression, |operand| emission.apart[operand as usize] = true),
            }
        }
        emission
    }

    /// The factors of a product that a sum takes in because it is the only one to need it. What outputs need is computed in
    /// the same way whatever else is asked for, so that they have the same bits.
    fn factors(&self, sum: Node, factor: Scalar, term: Node) -> Option<(Plane, Plane)> {
        let kind = usize::from(self.uses[0][sum as usize] == 0);
        match self.g.nodes[term as usize] {
            Expression::Product(a, b)
                if self.uses[kind][term as usize] == 1 && (factor == Scalar::ONE || factor == Scalar::MINUS) =>
            {
                Some((self.plane(a), self.plane(b)))
            }
            _ => None,
        }
    }

    fn plane(&self, node: Node) -> Plane {
        match self.g.nodes[node as usize] {
            Expression::Leaf(leaf) => DATA | leaf,
            _ => node,
        }
    }

    fn emit(&mut self, node: Node) {
        let op = match &self.g.nodes[node as usize] {
            Expression::Leaf(_) => return,
            Expression::Pole(k) => Op::Pole(node, *k),
            Expression::Pivot(a, k) => Op::Pivot(node, self.plane(*a), *k, self.uses[0][node as usize] > 0),
            Expression::Lag(a) => Op::Lag(node, self.plane(*a)),
            Expression::Product(a, b) => match (self.plane(*a), self.plane(*b)) {
                (a, b) if a == DATA | INTEGRAL => Op::ImaginaryProduct(node, a, b),
                (a, b) if b == DATA | INTEGRAL => Op::ImaginaryProduct(node, b, a),
                (a, b) => Op::Product(node, a, b),
            },
            Expression::Sum { jw, constant, terms } => return self.emit_sum(node, (*jw, *constant), terms),
        };
        self.ops.push(op);
    }

    fn emit_sum(&mut self, to: Node, (jw, constant): (bool, Scalar), terms: &[(Scalar, Node)]) {
        let apart =
            |k: usize| terms.get(k).filter(|t| self.factors(to, t.0, t.1).is_none()).map(|t| (t.0, self.plane(t.1)));
        let taken = terms.first().and_then(|t| self.factors(to, t.0, t.1).map(|f| (t.0, f)));
        let (op, done) = match (apart(0), apart(1)) {
            (Some((k, a)), _) if jw || constant != Scalar::ZERO => (Op::ConstantAdd(to, constant, jw, k, a), 1),
            _ if jw || constant != Scalar::ZERO => (Op::Constant(to, constant, jw), 0),
            (Some(a), Some(b)) => (Op::Combine(to, a, b), 2),
            (Some((k, a)), None) => (Op::Scale(to, k, a), 1),
            (None, _) => match taken {
                Some((Scalar::MINUS, (a, b))) => (Op::NegativeProduct(to, a, b), 1),
                Some((_, (a, b))) => (Op::Product(to, a, b), 1),
                None => (Op::Constant(to, constant, jw), 0),
            },
        };
        self.ops.push(op);
        for (factor, term) in &terms[done..] {
            let op = match self.factors(to, *factor, *term) {
                Some((a, b)) if *factor == Scalar::MINUS => Op::ProductSubtract(to, a, b, to),
                Some((a, b)) => Op::ProductAdd(to, a, b, to),
                None => Op::ScaleAdd(to, *factor, self.plane(*term), to),
            };
            self.ops.push(op);
        }
    }
}

fn each_operand(expression: &Expression, mut visit: impl FnMut(Node)) {
    match expression {
        Expression::Leaf(_) | Expression::Pole(_) => {}
        Expression::Pivot(a, _) | Expression::Lag(a) => visit(*a),
        Expression::Product(a, b) => {
            visit(*a);
            visit(*b);
        }
        Expression::Sum { terms, .. } => terms.iter().for_each(|t| visit(t.1)),
    }
}

impl Op {
    /// The planes of the instruction, that of the result first.
    fn planes(&mut self) -> [Option<&mut Plane>; 4] {
        match self {
            Self::Pole(d, _) | Self::Constant(d, ..) => [Some(d), None, None, None],
            Self::Pivot(d, a, ..) | Self::Scale(d, _, a) | Self::ConstantAdd(d, _, _, _, a) | Self::Lag(d, a) => {
                [Some(d), Some(a), None, None]
            }
            Self::Product(d, a, b) | Self::NegativeProduct(d, a, b) | Self::ImaginaryProduct(d, a, b) => {
                [Some(d), Some(a), Some(b), None]
            }
            Self::Combine(d, (_, a), (_, b)) => [Some(d), Some(a), Some(b), None],
            Self::ProductAdd(d, a, b, c) | Self::ProductSubtract(d, a, b, c) => [Some(d), Some(a), Some(b), Some(c)],
            Self::ScaleAdd(d, _, a, c) => [Some(d), Some(a), Some(c), None],
        }
    }
}

/// Registers of the block for virtual ones, each free again behind its last use.
struct Allocation {
    ops: Vec<Op>,
    registers: usize,
    /// Where each node stands; planes of derivatives are marked until the number of registers is known.
    home: Vec<Plane>,
    /// The last instruction that needs it.
    last: Vec<usize>,
    free: Vec<Plane>,
}

const UNPLACED: Plane = DATA - 1;
/// Marks planes of derivatives during the allocation.
const DERIVATIVE: Plane = 1 << 30;

impl Allocation {
    fn new(g: &Expressions, results: &Results, mut ops: Vec<Op>) -> Self {
        let (mut home, mut last) = (vec![UNPLACED; g.nodes.len()], vec![0; g.nodes.len()]);
        // a derivative that is another one's, or given, is copied
        for (node, place) in &results.derivatives {
            let place = DERIVATIVE | place;
            match g.nodes[*node as usize] {
                Expression::Leaf(leaf) => ops.push(Op::Scale(place, Scalar::ONE, DATA | leaf)),
                _ if home[*node as usize] == UNPLACED => home[*node as usize] = place,
                _ => ops.push(Op::Scale(place, Scalar::ONE, *node)),
            }
        }
        for (at, op) in ops.iter_mut().enumerate() {
            for plane in op.planes().into_iter().flatten().filter(|p| **p < DERIVATIVE) {
                last[*plane as usize] = at;
            }
        }
        for output in results.outputs.iter().flatten() {
            last[*output as usize] = usize::MAX;
        }
        Self { ops, registers: FLAGS as usize + 1, home, last, free: Vec::new() }
    }

    fn run(&mut self) {
        let mut ops = std::mem::take(&mut self.ops);
        for (at, op) in ops.iter_mut().enumerate() {
            let mut over = Vec::new();
            for plane in op.planes().into_iter().flatten().filter(|p| **p < DERIVATIVE) {
                let node = *plane as usize;
                if self.home[node] == UNPLACED {
                    self.home[node] = self.free.pop().unwrap_or_else(|| {
                        self.registers += 1;
                        (self.registers - 1) as Plane
                    });
                }
                *plane = self.home[node];
                if self.last[node] == at && self.home[node] < DERIVATIVE && !over.contains(&self.home[node]) {
                    over.push(self.home[node]);
                }
            }
            self.free.append(&mut over);
        }
        let first = self.registers as Plane;
        let settle = |plane: &mut Plane| {
            if *plane & (DATA | DERIVATIVE) == DERIVATIVE && *plane != UNPLACED {
                *plane = (*plane & !DERIVATIVE) + first;
            }
        };
        ops.iter_mut().for_each(|op| op.planes().into_iter().flatten().for_each(settle));
        self.home.iter_mut().for_each(settle);
        self.ops = ops;
    }
}

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
        dispatch(self);
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
        let k = |s: Scalar| self.scalars[s.0 as usize];
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
