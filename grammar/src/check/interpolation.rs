//! Curves through points, and surfaces through grids, as expressions: polynomials between neighbouring points, linear in their coefficients.
//!
//! A table is the sum of what the pieces add, `y0 + sum s*(b + s*(c + s*d))`, where `s` is the part of a piece that the argument has
//! passed: `clip(x - x_k, 0, h_k)`. No branch is left out of account and none can be NaN beside the others, the end values
//! hold outside the range, and ordinates enter linearly, so that regression finds them in one step. The coefficients depend on parameters
//! alone and are computed once per parameter vector.
//!
//! A surface of `linear` or `cubic` is the tensor product: each value times a cardinal curve along every axis, which is 1 at the
//! value's own place and 0 at the others (de Boor, A Practical Guide to Splines, 1978, XVII). `pchip` is no product,
//! since its slopes are no sums of ordinates: curves along the last axis give the points of curves along the one before it.

use crate::graph::Graph;
use crate::op::{Build, ExprId, Op};

/// How values between points are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Method {
    /// Straight lines.
    Linear,
    /// The cubic spline with continuous second derivatives whose third derivative is continuous at the second and the last but
    /// one point (not-a-knot; de Boor, A Practical Guide to Splines, 1978, IV).
    Cubic,
    /// Cubic Hermite pieces that are monotone where the points are (Fritsch and Carlson 1980, with the slopes of Fritsch and Butland 1984).
    Pchip,
}

impl Method {
    /// The words of the language.
    pub(super) const NAMES: [&'static str; 3] = ["linear", "cubic", "pchip"];

    /// The method with this name.
    pub(super) fn find(name: &str) -> Option<Self> {
        let all = [Self::Linear, Self::Cubic, Self::Pchip];
        Self::NAMES.iter().position(|n| *n == name).map(|k| all[k])
    }
}

/// One polynomial `s*(b + s*(c + s*d))` over `0 <= s <= h`.
#[derive(Debug, Clone, Copy)]
struct Piece {
    from: f64,
    length: f64,
    coefficients: [ExprId; 3],
}

/// A curve.
pub(super) struct Pieces {
    first: ExprId,
    list: Vec<Piece>,
    /// What a piece costs, its derivatives by the ordinates included.
    cost: usize,
}

impl Pieces {
    /// The pieces, each counted once more for every ordinate that moves it.
    pub(super) fn weight(&self) -> usize {
        self.list.len() * self.cost
    }

    /// The curve's value at `x`.
    pub(super) fn at(&self, graph: &mut Graph, x: ExprId) -> ExprId {
        let zero = graph.number(0.0);
        let mut sum = self.first;
        for Piece { from, length, coefficients: [b, c, d] } in &self.list {
            let s = passed(graph, zero, (*from, *length), x);
            let mut value = *d;
            for coefficient in [c, b] {
                let rest = graph.apply(Op::Mul, &[s, value]);
                value = graph.apply(Op::Add, &[*coefficient, rest]);
            }
            let value = graph.apply(Op::Mul, &[s, value]);
            sum = graph.apply(Op::Add, &[sum, value]);
        }
        sum
    }
}

/// The part of a piece that `x` has passed: `clip(x - from, 0, length)`. Where two pieces meet only the one before has a slope: of
/// equal operands of `max` and `min` the first one's derivative counts.
fn passed(graph: &mut Graph, zero: ExprId, (from, length): (f64, f64), x: ExprId) -> ExprId {
    let [from, length] = [from, length].map(|v| graph.number(v));
    let beyond = graph.apply(Op::Sub, &[x, from]);
    let above = graph.apply(Op::Max, &[zero, beyond]);
    graph.apply(Op::Min, &[above, length])
}

/// A function of one to three arguments through the values at the crossings of its axes.
pub(super) enum Interpolant {
    /// Of one argument.
    Curve(Pieces),
    /// Of several: values, those of the last argument next to each other.
    Surface { method: Method, axes: Vec<Axis>, values: Vec<ExprId>, moved: usize },
}

/// Where the values along an argument are known.
pub(super) struct Axis {
    at: Vec<(f64, ExprId)>,
}

impl Interpolant {
    /// `None` unless the axes are finite numbers that increase and every crossing has a value.
    pub(super) fn new(graph: &mut Graph, method: Method, axes: &[Vec<ExprId>], values: Vec<ExprId>) -> Option<Self> {
        if let [axis] = axes {
            let points: Vec<(ExprId, ExprId)> = axis.iter().copied().zip(values).collect();
            return pieces(graph, method, &points).map(Self::Curve);
        }
        let number = |e: &ExprId| graph.constant(*e).filter(|x| x.is_finite()).map(|x| (x, *e));
        let axes = axes.iter().map(|axis| Some(Axis { at: axis.iter().map(number).collect::<Option<_>>()? }));
        let axes: Vec<Axis> = axes.collect::<Option<_>>()?;
        let rising = |axis: &Axis| axis.at.len() > 1 && axis.at.windows(2).all(|pair| pair[0].0 < pair[1].0);
        let count: usize = axes.iter().map(|axis| axis.at.len()).product();
        if !axes.iter().all(rising) || count != values.len() {
            return None;
        }
        let moved = values.iter().filter(|y| graph.constant(**y).is_none()).count();
        Some(Self::Surface { method, axes, values, moved })
    }

    /// What it costs in pieces of curves, derivatives by the values included.
    pub(super) fn weight(&self) -> usize {
        match self {
            Self::Curve(pieces) => pieces.weight(),
            Self::Surface { method, axes, values, moved } => {
                let along = |axis: &Axis| match method {
                    Method::Linear => axis.at.len(),
                    Method::Cubic => axis.at.len() * axis.at.len(),
                    Method::Pchip => 0,
                };
                let of_each = if *method == Method::Pchip { 10 } else { 1 };
                axes.iter().map(along).sum::<usize>() + of_each * (values.len() + moved)
            }
        }
    }

    /// Its value.
    pub(super) fn at(&self, graph: &mut Graph, arguments: &[ExprId]) -> ExprId {
        match self {
            Self::Curve(pieces) => pieces.at(graph, arguments[0]),
            Self::Surface { method, axes, values, .. } => {
                let mut values = values.clone();
                for (axis, x) in axes.iter().zip(arguments).rev() {
                    values = axis.contracted(graph, *method, &values, *x);
                }
                values[0]
            }
        }
    }
}

impl Axis {
    /// Values along this axis, its own next to each other, to the one value at `x`.
    fn contracted(&self, graph: &mut Graph, method: Method, values: &[ExprId], x: ExprId) -> Vec<ExprId> {
        let rows = values.chunks_exact(self.at.len());
        let cardinals = match method {
            Method::Linear => self.hats(graph, x),
            Method::Cubic => self.cardinal_splines(graph, x),
            Method::Pchip => {
                let points = |row: &[ExprId]| self.at.iter().map(|(_, x)| *x).zip(row.iter().copied()).collect();
                let rows: Vec<Vec<(ExprId, ExprId)>> = rows.map(points).collect();
                let curve = |points: &Vec<_>| match pieces(graph, method, points) {
                    Some(pieces) => pieces.at(graph, x),
                    // no axis that `Interpolant::new` let pass
                    None => points[0].1,
                };
                return rows.iter().map(curve).collect();
            }
        };
        let mut sum = |row: &[ExprId]| {
            let mut sum = graph.number(0.0);
            for (cardinal, value) in cardinals.iter().zip(row) {
                let product = graph.apply(Op::Mul, &[*cardinal, *value]);
                sum = graph.apply(Op::Add, &[sum, product]);
            }
            sum
        };
        rows.map(&mut sum).collect()
    }

    /// Cardinal curves of straight lines; exactly 0 where another pair of neighbours holds the value, so that a node that no sample
    /// comes near has no influence.
    fn hats(&self, graph: &mut Graph, x: ExprId) -> Vec<ExprId> {
        let (zero, one) = (graph.number(0.0), graph.number(1.0));
        let mut left = one;
        let mut hats = Vec::with_capacity(self.at.len());
        for pair in self.at.windows(2) {
            let length = pair[1].0 - pair[0].0;
            let s = passed(graph, zero, (pair[0].0, length), x);
            let length = graph.number(length);
            let share = graph.apply(Op::Div, &[s, length]);
            hats.push(graph.apply(Op::Sub, &[left, share]));
            left = share;
        }
        hats.push(left);
        hats
    }

    /// Cardinal splines, each through 1 at its own place and through 0 elsewhere.
    fn cardinal_splines(&self, graph: &mut Graph, x: ExprId) -> Vec<ExprId> {
        let (zero, one) = (graph.number(0.0), graph.number(1.0));
        let mut splines = Vec::with_capacity(self.at.len());
        for k in 0..self.at.len() {
            let point = |(j, (_, x)): (usize, &(f64, ExprId))| (*x, if j == k { one } else { zero });
            let points: Vec<(ExprId, ExprId)> = self.at.iter().enumerate().map(point).collect();
            let spline = pieces(graph, Method::Cubic, &points);
            splines.push(spline.map_or(zero, |spline| spline.at(graph, x)));
        }
        splines
    }
}

/// The pieces between points; `None` unless the abscissae are finite numbers that increase.
fn pieces(graph: &mut Graph, method: Method, points: &[(ExprId, ExprId)]) -> Option<Pieces> {
    let x: Vec<f64> =
        points.iter().map(|(x, _)| graph.constant(*x).filter(|x| x.is_finite())).collect::<Option<_>>()?;
    if x.len() < 2 || x.windows(2).any(|pair| pair[0] >= pair[1]) {
        return None;
    }
    let moved = points.iter().filter(|(_, y)| graph.constant(*y).is_none()).count();
    let near = if method == Method::Linear { 2 } else { 4 };
    let mut curve = Curve::new(graph, &x, points);
    let list = match method {
        Method::Linear => curve.linear(),
        Method::Cubic => curve.cubic(),
        Method::Pchip => curve.pchip(),
    };
    let cost = 1 + if method == Method::Cubic { moved } else { moved.min(near) };
    Some(Pieces { first: points[0].1, list, cost })
}

/// Points with the slopes between them.
struct Curve<'a> {
    graph: &'a mut Graph,
    from: &'a [f64],
    /// Distances between abscissae.
    h: Vec<f64>,
    /// Slopes of the straight lines.
    slopes: Vec<ExprId>,
}

impl<'a> Curve<'a> {
    fn new(graph: &'a mut Graph, x: &'a [f64], points: &[(ExprId, ExprId)]) -> Self {
        let h: Vec<f64> = x.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let slope = |(pair, h): (&[(ExprId, ExprId)], &f64)| {
            let (rise, run) = (graph.apply(Op::Sub, &[pair[1].1, pair[0].1]), graph.number(*h));
            graph.apply(Op::Div, &[rise, run])
        };
        let slopes = points.windows(2).zip(&h).map(slope).collect();
        Self { graph, from: x, h, slopes }
    }

    fn scaled(&mut self, factor: f64, e: ExprId) -> ExprId {
        let factor = self.graph.number(factor);
        self.graph.apply(Op::Mul, &[factor, e])
    }

    fn add(&mut self, a: ExprId, b: ExprId) -> ExprId {
        self.graph.apply(Op::Add, &[a, b])
    }

    fn sub(&mut self, a: ExprId, b: ExprId) -> ExprId {
        self.graph.apply(Op::Sub, &[a, b])
    }

    fn piece(&self, k: usize, coefficients: [ExprId; 3]) -> Piece {
        Piece { from: self.from[k], length: self.h[k], coefficients }
    }

    fn linear(&mut self) -> Vec<Piece> {
        let zero = self.graph.number(0.0);
        (0..self.h.len()).map(|k| self.piece(k, [self.slopes[k], zero, zero])).collect()
    }

    fn cubic(&mut self) -> Vec<Piece> {
        let bends = self.second_derivatives();
        let mut list = Vec::new();
        for k in 0..self.h.len() {
            let (h, left, right) = (self.h[k], bends[k], bends[k + 1]);
            let twice = self.scaled(2.0, left);
            let sum = self.add(twice, right);
            let lowered = self.scaled(h / 6.0, sum);
            let b = self.sub(self.slopes[k], lowered);
            let change = self.sub(right, left);
            let (c, d) = (self.scaled(0.5, left), self.scaled(1.0 / (6.0 * h), change));
            list.push(self.piece(k, [b, c, d]));
        }
        list
    }

    /// The spline's second derivatives at all points: the tridiagonal equations of the inner points, into which those of
    /// the ends have been put. Its matrix holds numbers only, so that the solution is linear in the ordinates.
    fn second_derivatives(&mut self) -> Vec<ExprId> {
        let (h, n) = (self.h.clone(), self.h.len() + 1);
        if n == 2 {
            return vec![self.graph.number(0.0); 2];
        }
        let mut right: Vec<ExprId> = (1..n - 1).map(|k| self.sub(self.slopes[k], self.slopes[k - 1])).collect();
        if n == 3 {
            // one parabola
            return vec![self.scaled(2.0 / (h[0] + h[1]), right[0]); 3];
        }
        right.iter_mut().for_each(|e| *e = self.scaled(6.0, *e));
        let m = n - 2;
        let mut below: Vec<f64> = h[..m].to_vec();
        let mut diagonal: Vec<f64> = (0..m).map(|k| 2.0 * (h[k] + h[k + 1])).collect();
        let mut above: Vec<f64> = h[1..=m].to_vec();
        // M0 = (1 + r) M1 - r M2, and its mirror image
        let (first, last) = (h[0] / h[1], h[n - 2] / h[n - 3]);
        diagonal[0] += h[0] * (1.0 + first);
        above[0] -= h[0] * first;
        diagonal[m - 1] += h[n - 2] * (1.0 + last);
        below[m - 1] -= h[n - 2] * last;
        for k in 1..m {
            let w = below[k] / diagonal[k - 1];
            diagonal[k] -= w * above[k - 1];
            let carried = self.scaled(w, right[k - 1]);
            right[k] = self.sub(right[k], carried);
        }
        let mut inner = right;
        for k in (0..m).rev() {
            if k + 1 < m {
                let known = self.scaled(above[k], inner[k + 1]);
                inner[k] = self.sub(inner[k], known);
            }
            inner[k] = self.scaled(1.0 / diagonal[k], inner[k]);
        }
        let start = self.beyond(first, inner[0], inner[1]);
        let end = self.beyond(last, inner[m - 1], inner[m - 2]);
        std::iter::once(start).chain(inner).chain([end]).collect()
    }

    /// `(1 + r) near - r far`
    fn beyond(&mut self, r: f64, near: ExprId, far: ExprId) -> ExprId {
        let (near, far) = (self.scaled(1.0 + r, near), self.scaled(r, far));
        self.sub(near, far)
    }

    fn pchip(&mut self) -> Vec<Piece> {
        let count = self.h.len();
        if count == 1 {
            return self.linear();
        }
        let mut d = vec![self.end_slope(0, 1)];
        (1..count).for_each(|k| d.push(self.inner_slope(k)));
        d.push(self.end_slope(count - 1, count - 2));
        let mut list = Vec::new();
        for k in 0..count {
            let (h, slope, left, right) = (self.h[k], self.slopes[k], d[k], d[k + 1]);
            let both = self.add(left, right);
            let (three, once_more, two) = (self.scaled(3.0, slope), self.add(both, left), self.scaled(2.0, slope));
            let (c, d) = (self.sub(three, once_more), self.sub(both, two));
            let (c, d) = (self.scaled(1.0 / h, c), self.scaled(1.0 / (h * h), d));
            list.push(self.piece(k, [left, c, d]));
        }
        list
    }

    /// The weighted harmonic mean of the slopes on both sides; zero where they do not have one sign.
    fn inner_slope(&mut self, k: usize) -> ExprId {
        let (p, q) = (self.slopes[k - 1], self.slopes[k]);
        let (w, v) = (2.0 * self.h[k] + self.h[k - 1], self.h[k] + 2.0 * self.h[k - 1]);
        let product = self.graph.apply(Op::Mul, &[p, q]);
        let (wq, vp) = (self.scaled(w, q), self.scaled(v, p));
        let (over, under) = (self.scaled(w + v, product), self.add(wq, vp));
        let mean = self.graph.apply(Op::Div, &[over, under]);
        let zero = self.graph.number(0.0);
        let agree = self.graph.apply(Op::Less, &[zero, product]);
        self.graph.apply(Op::Select, &[agree, mean, zero])
    }

    /// The slope of the parabola through the three outermost points, kept from overshooting.
    fn end_slope(&mut self, at: usize, next: usize) -> ExprId {
        let (h, g, p, q) = (self.h[at], self.h[next], self.slopes[at], self.slopes[next]);
        let (near, far) = (self.scaled((2.0 * h + g) / (h + g), p), self.scaled(h / (h + g), q));
        let parabola = self.sub(near, far);
        let (zero, three) = (self.graph.number(0.0), self.scaled(3.0, p));
        let [size, most] = [parabola, three].map(|e| self.graph.apply(Op::Abs, &[e]));
        let product = self.graph.apply(Op::Mul, &[p, q]);
        let turns = self.graph.apply(Op::LessEqual, &[product, zero]);
        let steep = self.graph.apply(Op::Less, &[most, size]);
        let limited = self.graph.apply(Op::Select, &[steep, three, parabola]);
        let slope = self.graph.apply(Op::Select, &[turns, limited, parabola]);
        let product = self.graph.apply(Op::Mul, &[slope, p]);
        let agree = self.graph.apply(Op::Less, &[zero, product]);
        self.graph.apply(Op::Select, &[agree, slope, zero])
    }
}
