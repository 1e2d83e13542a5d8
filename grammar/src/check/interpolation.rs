//! Curves through points as expressions: polynomials between neighbouring points, linear in their coefficients.
//!
//! A table is the sum of what the pieces add, `y0 + sum s*(b + s*(c + s*d))`, where `s` is the part of a piece that the argument has
//! passed: `clip(x - x_k, 0, h_k)`. No branch is left out of account and none can be NaN beside the others, the end values
//! hold outside the range, and ordinates enter linearly, so that regression finds them in one step. The coefficients depend on parameters
//! alone and are computed once per parameter vector.

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
            let [from, length] = [*from, *length].map(|v| graph.number(v));
            let beyond = graph.apply(Op::Sub, &[x, from]);
            let above = graph.apply(Op::Max, &[beyond, zero]);
            let s = graph.apply(Op::Min, &[above, length]);
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

/// The pieces between points; `None` unless the abscissae are finite numbers that increase.
pub(super) fn pieces(graph: &mut Graph, method: Method, points: &[(ExprId, ExprId)]) -> Option<Pieces> {
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
