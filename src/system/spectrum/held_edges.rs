//! Inputs that were held on another clock than the outputs': they change between the samples, and the transform knows when.
//!
//! What is held is a sum of steps. The transform of samples has every step at a sample; one at an edge between two samples is there earlier by a
//! box that reaches from the edge to the next place of the grid. The boxes' integrals of `exp(-j w t)` are exact: about each sample
//! they are `sum_m (-j w dt)^m/m! M_m` with the moments `M_m` of what lies within half an interval of it, and sums of moments over samples are taken by the
//! transform of the record itself.

use super::frequencies::Comb;
use super::transform::Transform;
use crate::record::Run;
use crate::record::even_grid::{EvenGrid, NotEven};
use num_complex::Complex64;
use std::borrow::Cow;
use std::f64::consts::TAU;
use std::ops::Range;

/// What is left of an expansion whose further terms do not count: the rounding of sums.
const NEGLIGIBLE: f64 = 1e-16;

/// A change of a held input between two samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct HeldEdge {
    /// The input.
    pub(super) input: usize,
    /// Where it changes, in places of the grid; the next place is where samples show it.
    at: f64,
    /// By how much.
    change: f64,
}

/// A run on the samples of its outputs, and what its held inputs do between these.
pub(super) struct AtOutputs<'r> {
    /// The run, without samples in which nothing was measured where these are edges of held inputs.
    pub(super) run: Cow<'r, Run>,
    /// Its grid.
    pub(super) grid: EvenGrid,
    /// The edges that are between its places.
    pub(super) edges: Vec<HeldEdge>,
    /// What held inputs are at places without a sample, between samples that were left out: place, input, value.
    pub(super) known: Vec<(usize, usize, f64)>,
}

impl<'r> AtOutputs<'r> {
    /// Samples in which nothing was measured are left out where the others are sampled evenly, and all together are not, or are so more finely
    /// for the sake of held inputs alone.
    ///
    /// # Errors
    /// [`NotEven`], as of [`EvenGrid::of`].
    pub(super) fn of(run: &'r Run) -> Result<Self, NotEven> {
        let whole = EvenGrid::of(&run.time);
        let n = run.len();
        let kept: Vec<usize> = (0..n).filter(|k| run.is_compared(*k)).collect();
        let as_it_is = |grid| Self { run: Cow::Borrowed(run), grid, edges: Vec::new(), known: Vec::new() };
        if kept.len() == n || whole == Err(NotEven::TooFew) {
            return whole.map(as_it_is);
        }
        let times: Vec<f64> = kept.iter().map(|k| run.time[*k]).collect();
        let alone = EvenGrid::of(&times);
        match (whole, alone) {
            (Err(_), Ok(grid)) => Ok(Self::without(run, &kept, times, grid)),
            // outputs would have to be bridged at every edge
            (Ok(fine), Ok(grid)) if run.held.iter().all(|held| *held) && grid.interval > 1.5 * fine.interval => {
                Ok(Self::without(run, &kept, times, grid))
            }
            (whole, _) => whole.map(as_it_is),
        }
    }

    fn without(run: &Run, kept: &[usize], time: Vec<f64>, grid: EvenGrid) -> AtOutputs<'static> {
        let n = run.len();
        let rows = |values: &[f64], width: usize| -> Vec<f64> {
            kept.iter().flat_map(|k| values[k * width..(k + 1) * width].iter().copied()).collect()
        };
        let (m, q) = (run.inputs.len() / n, run.measured.len() / n);
        let new = Run { time, inputs: rows(&run.inputs, m), measured: rows(&run.measured, q), ..run.clone() };
        let held: Vec<usize> = (0..m).filter(|input| run.held[*input]).collect();
        let (mut edges, mut known) = (Vec::new(), Vec::new());
        for (left, pair) in kept.windows(2).enumerate().filter(|(_, pair)| pair[1] - pair[0] > 1) {
            let (from, to) = (new.time[left], new.time[left + 1]);
            let (first, next) = (grid.place[left], grid.place[left + 1]);
            let place = |k: usize| first as f64 + (run.time[k] - from) / (to - from) * (next - first) as f64;
            let between = pair[0] + 1..pair[1];
            for input in &held {
                let value = |k: usize| run.inputs[k * m + input];
                let changes =
                    between.clone().map(|k| HeldEdge { input: *input, at: place(k), change: value(k) - value(k - 1) });
                edges.extend(changes.filter(|edge| edge.change != 0.0));
                let before = |at: usize| between.clone().rev().find(|k| place(*k) <= at as f64).unwrap_or(pair[0]);
                known.extend((first + 1..next).map(|at| (at, *input, value(before(at)))));
            }
        }
        AtOutputs { run: Cow::Owned(new), grid, edges, known }
    }
}

impl HeldEdge {
    /// The box that the samples miss: from the edge to the place that shows it, in intervals.
    fn missed(&self) -> Range<f64> {
        self.at..self.at.ceil()
    }

    /// What the input is more than its samples say at a time, in places of the grid.
    pub(super) fn at(&self, time: f64) -> f64 {
        if self.missed().contains(&time) { self.change } else { 0.0 }
    }

    /// Its interval, and what the mean over that is more than the sample at its beginning.
    pub(super) fn area(&self) -> (usize, f64) {
        (self.at.floor() as usize, self.change * (self.at.ceil() - self.at))
    }

    /// The parts within half an interval of the samples beside it: place, and where the part begins and ends about it.
    fn parts(&self) -> impl Iterator<Item = (usize, Range<f64>)> {
        let missed = self.missed();
        let begin = self.at.floor();
        [begin, begin + 1.0].into_iter().map(move |place| {
            let about = (missed.start - place).max(-0.5)..(missed.end - place).min(0.5);
            (place as usize, about)
        })
    }
}

/// Moments about the samples of a record (`range` of places) of what an input is more than its samples say, of one order: integrals of
/// `s^order`, s in intervals.
fn moments(edges: &[HeldEdge], range: &Range<usize>, order: usize) -> Vec<f64> {
    let mut moments = vec![0.0; range.len()];
    let power = order as i32 + 1;
    for edge in edges {
        for (place, about) in edge.parts().filter(|(place, about)| range.contains(place) && about.start < about.end) {
            moments[place - range.start] +=
                edge.change * (about.end.powi(power) - about.start.powi(power)) / f64::from(power);
        }
    }
    moments
}

/// Sum over the samples of a record (`range` of places) of what an input is more than they say.
pub(super) fn excess(edges: &[HeldEdge], range: &Range<usize>) -> f64 {
    moments(edges, range, 0).iter().sum()
}

/// What edges (of one input) add to the sums over the samples of a record (`range` of places), at all frequencies.
pub(super) fn sums(edges: &[HeldEdge], range: &Range<usize>, comb: &Comb) -> Vec<Complex64> {
    let mut sums = vec![Complex64::ZERO; comb.len()];
    if edges.is_empty() {
        return sums;
    }
    let mut transform = Transform::new(range.len(), 1, comb);
    let theta: Vec<f64> = comb.cycles.iter().map(|cycles| TAU * cycles.value()).collect();
    let half = 0.5 * theta.iter().copied().fold(0.0, f64::max);
    let mut factors = vec![Complex64::ONE; comb.len()];
    let (mut order, mut size) = (0, 1.0);
    while size > NEGLIGIBLE {
        let of_moments = transform.apply(&moments(edges, range, order));
        sums.iter_mut().zip(&factors).zip(of_moments).for_each(|((sum, factor), moment)| *sum += factor * moment);
        order += 1;
        size *= half / order as f64;
        let by = |theta: &f64| Complex64::new(0.0, -theta / order as f64);
        factors.iter_mut().zip(&theta).for_each(|(factor, theta)| *factor *= by(theta));
    }
    sums
}
