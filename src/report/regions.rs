//! What two parameters are together: joint confidence regions of every pair, by the covariance of a fit, by the profiles of its cost, or as draws.
//!
//! A region of 95 % holds both true values in 95 of 100 records. Its shadow on an axis is wider than the interval of that parameter alone,
//! and a narrow slanted one says what the two intervals hide: that one parameter makes up for the other.

use crate::page::number::bracketed;
use crate::page::picture::Picture;
use crate::page::scale::Scale;
use fdm_estimate::ParameterEstimate;
use fdm_results::documents::design::Experiments;
use fdm_results::documents::profile::{End, Profile};
use fdm_results::documents::sample::{ArvizDocument, SampleDocument};
use fdm_results::documents::{FitDocument, with_run};
use maud::{Markup, html};
use std::f64::consts::PI;

/// Parameters of a picture: more would be narrower than a sheet of paper lets them be.
const MOST: usize = 6;
/// Draws of a picture.
const DRAWS: usize = 400;
/// Corners of a region.
const CORNERS: usize = 72;
/// A side of a pair of axes, and what lies between two of them, in pixels.
const SIDE: f64 = 112.0;
const GAP: f64 = 10.0;
const LEFT: f64 = 68.0;
const TOP: f64 = 6.0;
const BOTTOM: f64 = 38.0;

/// The square of the radius of a region of 95 % of two parameters: the quantile of chi-squared with two degrees of freedom.
fn level() -> f64 {
    -2.0 * 0.05_f64.ln()
}

/// Half the interval of 95 % of a parameter alone in its standard errors, where the noise is known. Intervals of few independent values are
/// wider, and regions are widened as they are.
const ALONE: f64 = 1.959_963_985;

/// A parameter along an axis.
struct Axis {
    name: String,
    label: String,
    value: f64,
    /// Of 95 %, by itself.
    interval: Option<[f64; 2]>,
}

impl Axis {
    /// The length of a label that would be longer than its side: letters are six pixels wide in the mean.
    fn squeezed(&self) -> Option<f64> {
        (6 * self.label.chars().count() > SIDE as usize).then_some(SIDE)
    }
}

/// What is drawn of a pair, in values of the parameters.
#[derive(Default)]
struct Pair {
    region: Vec<(f64, f64)>,
    /// What it was before planned experiments.
    before: Vec<(f64, f64)>,
    /// Where the best fit goes when one of both is held.
    traces: Vec<Vec<(f64, f64)>>,
    draws: Vec<(f64, f64)>,
}

/// Ellipses of the covariance of a fit that is to be trusted; none of fewer than two parameters.
pub(crate) fn of_fit(fit: &FitDocument) -> Option<Picture> {
    let matrix = fit.trusted_covariance()?;
    let covered: Vec<(usize, &ParameterEstimate)> =
        matrix.parameters.iter().enumerate().filter_map(|(k, p)| Some((k, fit.parameters.get(*p)?))).collect();
    let covariance = |i: usize, j: usize| matrix.values.get(i).and_then(|row| row.get(j)).copied().unwrap_or(f64::NAN);
    let known =
        covered.into_iter().filter(|(k, p)| covariance(*k, *k) > 0.0 && p.value.is_finite()).collect::<Vec<_>>();
    let correlation = |i: usize, j: usize| {
        let (a, b) = (known[i].0, known[j].0);
        covariance(a, b) / (covariance(a, a) * covariance(b, b)).sqrt()
    };
    let shown = most_correlated(known.len(), correlation);
    let axes = shown.iter().map(|k| {
        let p = known[*k].1;
        axis(&with_run(&p.name, p.run.as_deref()), p.unit.as_deref(), p.value, p.interval())
    });
    let axes: Vec<Axis> = axes.collect();
    let pair = |i: usize, j: usize| {
        let (a, b) = (known[shown[i]].0, known[shown[j]].0);
        let [first, second] = [i, j].map(|k| widened(known[shown[k]].1));
        let spread =
            [covariance(a, a) * first * first, covariance(a, b) * first * second, covariance(b, b) * second * second];
        Pair { region: ellipse([axes[i].value, axes[j].value], spread), ..Pair::default() }
    };
    corner("regions", "joint confidence regions of 95 %, by the covariance", &axes, pair)
}

/// How much wider the interval of a parameter is than where the noise is known; 1 where its bounds cut it.
fn widened(p: &ParameterEstimate) -> f64 {
    let whole = p.interval().zip(p.error()).filter(|_| p.limit.is_none());
    let ratio = whole.map(|([low, high], error)| (high - low) / (2.0 * ALONE * error));
    ratio.filter(|r| r.is_finite() && *r >= 1.0).unwrap_or(1.0)
}

/// Ellipses before and after planned experiments.
pub(crate) fn of_experiments(found: &Experiments) -> Option<Picture> {
    let [before, after] = &found.covariance;
    let entry = |of: &[Vec<Option<f64>>], i: usize, j: usize| of.get(i).and_then(|row| row.get(j).copied().flatten());
    let known: Vec<usize> =
        (0..found.outlook.len()).filter(|k| entry(after, *k, *k).is_some_and(|v| v > 0.0)).collect();
    let spread = |of: &[Vec<Option<f64>>], i: usize, j: usize| {
        let (a, b) = (known[i], known[j]);
        Some([entry(of, a, a)?, entry(of, a, b)?, entry(of, b, b)?])
    };
    let correlation = |i: usize, j: usize| spread(after, i, j).map_or(0.0, |[a, b, c]| b / (a * c).sqrt());
    let shown = most_correlated(known.len(), correlation);
    let axes: Vec<Axis> = shown
        .iter()
        .map(|k| {
            let o = &found.outlook[known[*k]];
            axis(&o.parameter, o.unit.as_deref(), o.value, None)
        })
        .collect();
    let pair = |i: usize, j: usize| {
        let drawn = |of: &[Vec<Option<f64>>]| {
            let centre = [axes[i].value, axes[j].value];
            spread(of, shown[i], shown[j]).map_or_else(Vec::new, |spread| ellipse(centre, spread))
        };
        Pair { region: drawn(after), before: drawn(before), ..Pair::default() }
    };
    corner("regions", "joint confidence regions of 95 %: filled after these experiments, outlined before", &axes, pair)
}

/// Regions by the cost, from the profiles of both parameters and where the other goes along each.
pub(crate) fn of_profiles(profiles: &[Profile]) -> Option<Picture> {
    let known: Vec<&Profile> = profiles.iter().filter(|p| !p.bound && p.error > 0.0).take(MOST).collect();
    let axes: Vec<Axis> = known
        .iter()
        .map(|p| axis(&p.name, p.unit.as_deref(), p.value, Some([p.ends[0].value(), p.ends[1].value()])))
        .collect();
    let pair = |i: usize, j: usize| by_cost(known[i], known[j]);
    corner("regions", "joint confidence regions of 95 %, by the cost", &axes, pair)
}

/// The draws themselves.
pub(crate) fn of_draws(found: &SampleDocument, draws: &ArvizDocument) -> Option<Picture> {
    let values = |name: &str, run: Option<&str>| {
        let key = run.map_or_else(|| name.to_string(), |run| format!("{name}[{run}]"));
        draws.posterior.get(&key).map(|chains| chains.concat())
    };
    let known = found.parameters.iter().filter_map(|p| Some((p, values(&p.name, p.run.as_deref())?)));
    let known: Vec<_> = known.filter(|(p, _)| p.deviation > 0.0).collect();
    let correlation = |i: usize, j: usize| {
        let ((a, x), (b, y)) = (&known[i], &known[j]);
        let product = |(x, y): (&f64, &f64)| (x - a.mean) * (y - b.mean);
        x.iter().zip(y).map(product).sum::<f64>() / (x.len() as f64 * a.deviation * b.deviation)
    };
    let shown = most_correlated(known.len(), correlation);
    let of = |k: usize| &known[shown[k]];
    let axes: Vec<Axis> = (0..shown.len())
        .map(|k| {
            let p = &of(k).0;
            axis(&with_run(&p.name, p.run.as_deref()), p.unit.as_deref(), p.mean, Some(p.interval))
        })
        .collect();
    let pair = |i: usize, j: usize| {
        let (x, y) = (&of(i).1, &of(j).1);
        let every = x.len().div_ceil(DRAWS).max(1);
        let draws = x.iter().copied().zip(y.iter().copied()).step_by(every).collect();
        Pair { draws, ..Pair::default() }
    };
    corner("regions", "draws of every pair", &axes, pair)
}

fn axis(name: &str, unit: Option<&str>, value: f64, interval: Option<[f64; 2]>) -> Axis {
    let interval = interval.filter(|ends| ends.iter().all(|v| v.is_finite()));
    Axis { name: name.into(), label: format!("{name}{}", bracketed(unit)), value, interval }
}

/// Places of the parameters that are shown: all, or those that correlate most with any other, in their order.
fn most_correlated(count: usize, correlation: impl Fn(usize, usize) -> f64) -> Vec<usize> {
    let largest = |i: usize| {
        let others = (0..count).filter(|j| *j != i);
        others.map(|j| correlation(i, j).abs()).filter(|r| r.is_finite()).fold(0.0, f64::max)
    };
    let mut all: Vec<(usize, f64)> = (0..count).map(|k| (k, largest(k))).collect();
    all.sort_by(|a, b| b.1.total_cmp(&a.1));
    let mut shown: Vec<usize> = all.into_iter().take(MOST).map(|(k, _)| k).collect();
    shown.sort_unstable();
    shown
}

/// The ellipse of a covariance: of the first, of both, of the second.
fn ellipse(centre: [f64; 2], [a, b, c]: [f64; 3]) -> Vec<(f64, f64)> {
    // the square root of the covariance, lower triangle
    let first = a.sqrt();
    let (slant, rest) = (b / first, (c - b * b / a).max(0.0).sqrt());
    let radius = level().sqrt();
    let corner = |k: usize| {
        let (sine, cosine) = (2.0 * PI * k as f64 / CORNERS as f64).sin_cos();
        (centre[0] + radius * first * cosine, centre[1] + radius * (slant * cosine + rest * sine))
    };
    (0..CORNERS).map(corner).collect()
}

/// A region by the cost, from two profiles (Bates and Watts 1988, appendix 6): in signed roots of the rises it is a circle that is bent as
/// the paths of the best fits say.
fn by_cost(a: &Profile, b: &Profile) -> Pair {
    let (Some(first), Some(second)) = (Course::of(a, b), Course::of(b, a)) else { return Pair::default() };
    let trace = |course: &Course, turned: bool| {
        let place = |p: &[f64; 3]| if turned { (p[2], p[1]) } else { (p[1], p[2]) };
        course.points.iter().map(place).collect::<Vec<_>>()
    };
    let traces = vec![trace(&first, false), trace(&second, true)];
    let bounded = [a, b].iter().all(|p| p.ends.iter().all(|end| matches!(end, End::At(_))));
    if !bounded {
        return Pair { traces, ..Pair::default() };
    }
    // the root of one parameter where that of the other is the radius, over the radius
    let radius = level().sqrt();
    let seen = |along: &Course, of: &Course, side: f64| {
        (of.root(along.other(side * radius)) / (side * radius)).clamp(-1.0, 1.0).acos()
    };
    let [right, left] = [1.0, -1.0].map(|side| seen(&first, &second, side));
    let [above, below] = [1.0, -1.0].map(|side| seen(&second, &first, side));
    // where on the circle each of the four is, and by how much it is bent there
    let mut known = [(-right / 2.0, right), (above / 2.0, above), (PI - left / 2.0, left), (PI + below / 2.0, below)];
    known.sort_by(|a, b| a.0.total_cmp(&b.0));
    let corner = |k: usize| {
        let angle = 2.0 * PI * k as f64 / CORNERS as f64;
        let bend = around(&known, angle);
        (first.value(radius * (angle + bend / 2.0).cos()), second.value(radius * (angle - bend / 2.0).cos()))
    };
    let region: Vec<(f64, f64)> = (0..CORNERS).map(corner).collect();
    Pair { region, traces, ..Pair::default() }
}

/// A value between those that are known around a circle: cubic pieces with the slopes of their neighbours.
fn around(known: &[(f64, f64); 4], angle: f64) -> f64 {
    let whole = 2.0 * PI;
    let at = |k: i64| {
        let (place, value) = known[k.rem_euclid(4) as usize];
        (place + whole * k.div_euclid(4) as f64, value)
    };
    let angle = known[0].0 + (angle - known[0].0).rem_euclid(whole);
    let k = (0..4).rev().find(|k| at(*k).0 <= angle).unwrap_or(0);
    let [before, from, to, behind] = [k - 1, k, k + 1, k + 2].map(at);
    let step = to.0 - from.0;
    if step <= 0.0 {
        return from.1;
    }
    let slope = |a: (f64, f64), b: (f64, f64)| if b.0 > a.0 { (b.1 - a.1) / (b.0 - a.0) } else { 0.0 };
    let s = (angle - from.0) / step;
    let (lift, fall) = (slope(before, to) * step, slope(from, behind) * step);
    let rest = to.1 - from.1;
    from.1 + s * (lift + s * (3.0 * rest - 2.0 * lift - fall + s * (lift + fall - 2.0 * rest)))
}

/// A profile in signed roots of its rise, such that its own interval ends where it does for a known noise: root, value, and the value of another
/// parameter there.
struct Course {
    points: Vec<[f64; 3]>,
}

impl Course {
    /// None where the profile says nothing about the other.
    fn of(profile: &Profile, other: &Profile) -> Option<Self> {
        let root =
            |value: f64, rise: f64| ALONE * (rise.max(0.0) / profile.rise).sqrt().copysign(value - profile.value);
        let own = profile.points.iter().filter(|p| p.value != profile.value).filter_map(|p| {
            let (_, value) = p.others.iter().find(|(name, _)| *name == other.name)?;
            Some([root(p.value, p.rise), p.value, *value])
        });
        let mut points: Vec<[f64; 3]> = own.chain([[0.0, profile.value, other.value]]).collect();
        points.retain(|p| p.iter().all(|v| v.is_finite()));
        points.sort_by(|a, b| a[1].total_cmp(&b[1]));
        // roots rise with the values; what does not is noise of the refits
        points.dedup_by(|next, kept| next[0] <= kept[0]);
        (points.len() > 2).then_some(Self { points })
    }

    /// The value where the root is so large.
    fn value(&self, root: f64) -> f64 {
        self.along(0, 1, root)
    }

    /// The other parameter there.
    fn other(&self, root: f64) -> f64 {
        self.along(0, 2, root)
    }

    /// The root of a value.
    fn root(&self, value: f64) -> f64 {
        self.along(1, 0, value)
    }

    /// Straight between the refits, and on beyond the last of them.
    fn along(&self, from: usize, to: usize, at: f64) -> f64 {
        let k = self.points.partition_point(|p| p[from] < at).clamp(1, self.points.len() - 1);
        let (a, b) = (&self.points[k - 1], &self.points[k]);
        a[to] + (b[to] - a[to]) * (at - a[from]) / (b[from] - a[from])
    }
}

/// Pairs of axes in a triangle, one row and one column for each parameter; none of fewer than two.
fn corner(id: &str, caption: &str, axes: &[Axis], pair: impl Fn(usize, usize) -> Pair) -> Option<Picture> {
    if axes.len() < 2 {
        return None;
    }
    let count = axes.len() - 1;
    let pairs: Vec<Vec<Pair>> = (1..=count).map(|i| (0..i).map(|j| pair(j, i)).collect()).collect();
    let scale = |k: usize| {
        let across = pairs.iter().filter_map(|row| row.get(k)).flat_map(|p| all(p).map(|(x, _)| x));
        let down = k.checked_sub(1).map(|k| &pairs[k]).into_iter().flatten().flat_map(|p| all(p).map(|(_, y)| y));
        let ends = axes[k].interval.into_iter().flatten();
        let values: Vec<f64> = across.chain(down).chain(ends).chain([axes[k].value]).collect();
        Scale::around(values.iter(), 0.06, false)
    };
    let scales: Vec<Scale> = (0..axes.len()).map(scale).collect();
    let step = SIDE + GAP;
    let (width, height) = (LEFT + count as f64 * step, TOP + count as f64 * step - GAP + BOTTOM);
    let body = html! {
        @for (i, row) in pairs.iter().enumerate() { @for (j, own) in row.iter().enumerate() {
            @let frame = Frame { x: scales[j], y: scales[i + 1], left: LEFT + j as f64 * step, top: TOP + i as f64 * step };
            (drawn(own, &frame, [&axes[j], &axes[i + 1]]))
            @if j == 0 {
                @for (v, label) in frame.y.ticks(3) {
                    text.tick x=(LEFT - 5.0) y=(place(frame.down(v) + 4.0)) text-anchor="end" { (label) }
                }
                text.label transform={ "translate(12 " (place(frame.top + SIDE / 2.0)) ") rotate(-90)" } text-anchor="middle" textLength=[axes[i + 1].squeezed()] lengthAdjust="spacingAndGlyphs" { (axes[i + 1].label) }
            }
            @if i + 1 == count {
                @for (v, label) in frame.labels() {
                    text.tick x=(place(frame.across(v))) y=(place(frame.top + SIDE + 14.0)) text-anchor="middle" { (label) }
                }
                text.label x=(place(frame.left + SIDE / 2.0)) y=(place(frame.top + SIDE + 31.0)) text-anchor="middle" textLength=[axes[j].squeezed()] lengthAdjust="spacingAndGlyphs" { (axes[j].label) }
            }
        } }
    };
    Some(Picture { id: id.into(), caption: caption.into(), width, height, body })
}

/// Every point of a pair that has to be seen.
fn all(pair: &Pair) -> impl Iterator<Item = (f64, f64)> + '_ {
    let traces = pair.traces.iter().flatten().filter(|_| pair.region.is_empty());
    pair.region.iter().chain(&pair.before).chain(&pair.draws).chain(traces).copied()
}

/// A pair of axes on paper.
struct Frame {
    x: Scale,
    y: Scale,
    left: f64,
    top: f64,
}

impl Frame {
    /// The numbers below, those whose labels stay over this frame and apart: letters are seven pixels wide at most.
    fn labels(&self) -> Vec<(f64, String)> {
        let half = |label: &str| 3.5 * label.chars().count() as f64;
        let inside = |(v, label): &(f64, String)| {
            let from_the_middle = (self.across(*v) - self.left - SIDE / 2.0).abs();
            from_the_middle + half(label) <= (SIDE + GAP) / 2.0
        };
        let mut kept: Vec<(f64, String)> = Vec::new();
        for next in self.x.ticks(2).into_iter().filter(inside) {
            let touches =
                |(v, label): &(f64, String)| self.across(next.0) - self.across(*v) < half(label) + half(&next.1);
            if !kept.last().is_some_and(touches) {
                kept.push(next);
            }
        }
        kept
    }

    fn across(&self, v: f64) -> f64 {
        self.left + SIDE * self.x.share(v).clamp(0.0, 1.0)
    }

    fn down(&self, v: f64) -> f64 {
        self.top + SIDE * (1.0 - self.y.share(v).clamp(0.0, 1.0))
    }

    fn path(&self, points: &[(f64, f64)]) -> String {
        let point = |(k, (x, y)): (usize, &(f64, f64))| {
            format!("{}{} {}", if k == 0 { "M" } else { "L" }, place(self.across(*x)), place(self.down(*y)))
        };
        let inside = |scale: &Scale, v: f64| (0.0..=1.0).contains(&scale.share(v));
        points.iter().filter(|(x, y)| inside(&self.x, *x) && inside(&self.y, *y)).enumerate().map(point).collect()
    }
}

fn drawn(pair: &Pair, frame: &Frame, [a, b]: [&Axis; 2]) -> Markup {
    html! {
        rect.frame x=(place(frame.left)) y=(place(frame.top)) width=(SIDE) height=(SIDE) {}
        @if !pair.region.is_empty() {
            path class="bound band" d={ (frame.path(&pair.region)) "Z" } { title { (a.name) ", " (b.name) } }
        }
        @if !pair.before.is_empty() { path class="measured line" d={ (frame.path(&pair.before)) "Z" } {} }
        @for (x, y) in pair.draws.iter().filter(|(x, y)| x.is_finite() && y.is_finite()) {
            circle class="dot residual" cx=(place(frame.across(*x))) cy=(place(frame.down(*y))) r="1" {}
        }
        @for trace in &pair.traces { path class="model line" d=(frame.path(trace)) {} }
        @if let (Some(x), Some(y)) = (a.interval, b.interval) {
            rect class="box" x=(place(frame.across(x[0]))) y=(place(frame.down(y[1])))
                width=(place(frame.across(x[1]) - frame.across(x[0]))) height=(place(frame.down(y[0]) - frame.down(y[1]))) {}
        }
        path.root d={ "M" (place(frame.across(a.value) - 3.0)) " " (place(frame.down(b.value))) "h6m-3 -3v6" } {}
    }
}

fn place(v: f64) -> String {
    format!("{v:.1}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use fdm_results::documents::profile::Point;

    /// The profiles of a cost that is `(z'Rz)/2` in `z = bent(theta)`, with correlation `r`.
    fn profiles(r: f64, bent: impl Fn(f64) -> f64, back: impl Fn(f64) -> f64) -> [Profile; 2] {
        ["a", "b"].map(|name| {
            let other = if name == "a" { "b" } else { "a" };
            let point = |k: i32| {
                let z = 0.25 * f64::from(k);
                Point { value: back(z), rise: z * z / 2.0, others: vec![(other.into(), back(r * z))] }
            };
            let (centre, ends) = (back(0.0), [back(-1.96), back(1.96)]);
            assert!(bent(centre).abs() < 1e-12);
            Profile {
                name: name.into(),
                unit: None,
                value: centre,
                error: 1.0,
                factor: 1.0,
                rise: ALONE * ALONE / 2.0,
                bound: false,
                ends: ends.map(End::At),
                held: Default::default(),
                by_error: ends,
                points: (-9..=9).map(point).collect(),
                refits: 19,
            }
        })
    }

    /// On the edge of the region `z'inv([1 r; r 1])z` is the quantile.
    #[test]
    fn regions_of_straight_and_of_bent_costs_have_their_edges_at_the_level() {
        for r in [-0.95, 0.0, 0.6] {
            let rise = |x: f64, y: f64| (x * x - 2.0 * r * x * y + y * y) / (1.0 - r * r);
            let straight = profiles(r, |v| v, |z| z);
            for (x, y) in by_cost(&straight[0], &straight[1]).region {
                assert!((rise(x, y) / level() - 1.0).abs() < 1e-6, "{r}: {x} {y}");
            }
            // values that are exponentials of what the cost is square in, between refits that are joined by straight lines
            let bent = profiles(r, f64::ln, f64::exp);
            for (x, y) in by_cost(&bent[0], &bent[1]).region {
                assert!((rise(x.ln(), y.ln()) / level() - 1.0).abs() < 0.08 / (1.0 - r * r), "{r}: {x} {y}");
            }
            for (x, y) in ellipse([0.0, 0.0], [1.0, r, 1.0]) {
                assert!((rise(x, y) / level() - 1.0).abs() < 1e-9);
            }
        }
        assert!((level() - 5.991_464_547).abs() < 1e-9);
    }

    #[test]
    fn an_open_interval_has_no_region_and_few_parameters_no_picture() {
        let [a, mut b] = profiles(0.5, |v| v, |z| z);
        b.ends[1] = End::Open(3.0);
        let open = by_cost(&a, &b);
        assert!(open.region.is_empty() && open.traces.len() == 2);
        assert!(of_profiles(std::slice::from_ref(&a)).is_none());
        let text = of_profiles(&[a, b]).unwrap().body.into_string();
        assert_eq!((text.matches("<rect class=\"frame\"").count(), text.matches("bound band").count()), (1, 0));
    }

    #[test]
    fn of_many_parameters_those_are_shown_that_correlate_most() {
        let correlation =
            |i: usize, j: usize| if i.min(j) == 3 && i.max(j) == 8 { 0.99 } else { 0.01 * (i + j) as f64 };
        let shown = most_correlated(9, correlation);
        assert!(shown.len() == MOST && shown.contains(&3) && shown.contains(&8), "{shown:?}");
        assert!(shown.windows(2).all(|w| w[0] < w[1]));
    }

    #[test]
    fn labels_below_narrow_axes_stay_apart_and_over_their_frame() {
        let ends = |low: f64, high: f64| {
            let scale = |low, high| Scale { low, high, logarithmic: false };
            let frame = Frame { x: scale(low, high), y: scale(0.0, 1.0), left: 50.0, top: 0.0 };
            let end = |(v, label): &(f64, String)| {
                let half = 3.5 * label.chars().count() as f64;
                [frame.across(*v) - half, frame.across(*v) + half]
            };
            frame.labels().iter().map(end).collect::<Vec<_>>()
        };
        for (low, high) in [(-0.16565, -0.16435), (0.0019, 0.0045), (0.0, 1.0), (9.0, 11.0)] {
            let labels = ends(low, high);
            assert!(!labels.is_empty(), "{low} to {high}");
            assert!(labels.windows(2).all(|w| w[0][1] <= w[1][0]), "{labels:?}");
            assert!(labels.iter().all(|e| e[0] >= 45.0 && e[1] <= 50.0 + SIDE + 5.0), "{labels:?}");
        }
    }
}
