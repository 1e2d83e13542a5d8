//! The transform of one run, of what its signals are between their samples.
//!
//! The sum over samples is the integral over the record by the midpoint rule. What a simulation integrates is not the samples but
//! what lies between them, and that has an exact transform: the sum times a factor, and something for the two half intervals at the ends.

use super::cross_spectra::NO_POWER;
use super::cross_spectra::independent;
use super::even_rows::EvenRows;
use super::even_rows::{Bridge, trust};
use super::frequencies::Frequencies;
use super::frequencies::{ChannelName, SpectrumError};
use super::held_edges::{self, HeldEdge};
use super::transform::Transform;
use crate::record::Run;
use num_complex::Complex64;
use std::f64::consts::TAU;

/// Fourier coefficients of one run, `x(w) = (1/N) sum_k x_k exp(-j w k dt)` (Marchand and Fu 1985), zero frequency left out: every channel
/// is transformed without its mean. Time begins with the first transformed sample.
///
/// The transform of a derivative is `x'(w) = j w x(w) + e1 x(T - dt/2) - e0 x(-dt/2)`, T = N dt, with [`Self::end_factors`] e0 and e1 and
/// end values by interpolation with one more sample on each side of what is transformed. Multiplied by T, x(w) is the Fourier integral over the
/// record; of what, says [`Interpolant`].
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Spectrum {
    /// Name of the run.
    pub name: String,
    /// Angular frequencies (M), rising, above 0, in radians per unit of time.
    pub omega: Vec<f64>,
    /// Sampling interval.
    pub dt: f64,
    /// Number of samples N that were transformed.
    pub samples: usize,
    /// Inputs as they drive states, m by M.
    pub inputs: Vec<Complex64>,
    /// Mean squares of the inputs, their means taken off (m).
    pub input_power: Vec<f64>,
    /// Inputs as outputs see them that show them directly, m by M: sums of their samples, transformed as outputs are.
    pub sampled_inputs: Vec<Complex64>,
    /// Samples of the inputs, m by N + 1: what an input is before the record, then those that were transformed; of one that was held on another
    /// clock means over the intervals behind them. Nothing where they are not known.
    pub input_samples: Vec<f64>,
    /// Whether each input is held between samples (m).
    pub input_held: Vec<bool>,
    /// What each input is before the record (m): the first of its samples, or zero less the mean that was taken off. Nothing where that is not known.
    pub input_before: Vec<f64>,
    /// Measured outputs, q by M; NaN for one that was never measured, where that was allowed, and where gaps leave too much in doubt.
    pub outputs: Vec<Complex64>,
    /// Channels with long gaps, and what was done about them.
    pub bridged: Vec<Bridge>,
    /// Values of the inputs half an interval before the first transformed sample, and half an interval behind the last (m each).
    pub input_ends: [Vec<f64>; 2],
    /// Values of the outputs half an interval before the first transformed sample, and half an interval behind the last
    /// (q each).
    pub output_ends: [Vec<f64>; 2],
}

/// How a run is transformed.
#[derive(Debug, Clone, Default)]
pub struct SpectrumOptions {
    /// What a signal is between its samples.
    pub interpolant: Interpolant,
    /// Where the end values come from.
    pub ends: Ends,
    /// Coefficients of an output that was never measured are NaN, and no error.
    pub allow_unmeasured: bool,
    /// Inputs (by index) that are zero outside the record.
    pub vanishing: Vec<u32>,
    /// Names of the inputs, for messages; numbers where there are none.
    pub inputs: Vec<String>,
    /// Names of the outputs.
    pub outputs: Vec<String>,
}

/// Where end values come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Ends {
    /// The first and the last sample are not transformed and give the end values with their neighbours.
    #[default]
    Interpolated,
    /// All samples are transformed; end values are extrapolated from two samples, for use where they are estimated or left out.
    Extrapolated,
}

/// Samples of the inputs (m by N + 1), where `outer` samples on each side are not transformed; `before` is what they are before the record.
fn input_samples(even: &EvenRows, outer: usize, before: &[f64], edges: &[Vec<HeldEdge>]) -> Vec<f64> {
    let (m, samples) = (before.len(), even.places - 2 * outer);
    let samples_of = |c: usize| std::iter::once(0).chain(outer..outer + samples).map(move |k| k * even.width + c);
    let mut found: Vec<f64> = (0..m).flat_map(samples_of).map(|at| even.rows[at]).collect();
    if outer == 0 {
        found.chunks_mut(samples + 1).zip(before).for_each(|(row, before)| row[0] = *before);
    }
    // a delay moves what an input is in an interval, in the mean
    for (c, (interval, area)) in (0..m).flat_map(|c| edges[c].iter().map(move |edge| (c, edge.area()))) {
        // the first is the sample before
        let at = (interval + 1).checked_sub(outer).filter(|at| (1 - outer..=samples).contains(at));
        at.into_iter().for_each(|at| found[c * (samples + 1) + at] += area);
    }
    found
}

impl Spectrum {
    /// Transforms a run at the chosen frequencies.
    ///
    /// # Errors
    /// [`SpectrumError`]: uneven sampling, gaps that leave no output at any frequency, channels without values, and bands that the record cannot
    /// show.
    pub fn of(run: &Run, choice: &Frequencies, options: &SpectrumOptions) -> Result<Self, SpectrumError> {
        let mut even = EvenRows::of(run)?;
        let outer = usize::from(options.ends == Ends::Interpolated);
        let samples = even.places - 2 * outer;
        let comb = choice.of(samples, even.dt, even.width)?;
        let m = run.inputs.len() / run.len();
        let highest = comb.omega.last().map_or(0.0, |w| w / TAU);
        let mut long = Vec::new();
        for c in 0..even.width {
            let name = options.name(c, m);
            if !even.never_measured(c) {
                long.extend(even.check_gap(c, highest, name).err().map(|error| (c, error)));
            } else if c < m || !options.allow_unmeasured {
                return Err(SpectrumError::NeverMeasured(name));
            }
        }
        let courses: Vec<Course> = (0..even.width).map(|c| options.course(c, m, &run.held)).collect();
        let first: Vec<f64> = even.rows[..m].to_vec();
        let vanishes = |c: usize| c < m && options.vanishing.contains(&(c as u32));
        let inside = outer..outer + samples;
        let edges: Vec<Vec<HeldEdge>> =
            courses.iter().enumerate().map(|(c, course)| course.edges(even.edges_of(c))).collect();
        // what the mean over the record is more than that of samples, times their number
        let missed: Vec<f64> = edges.iter().map(|edges| held_edges::excess(edges, &inside)).collect();
        let sides: Vec<Sides> = courses
            .iter()
            .enumerate()
            .map(|(c, kind)| centre(&mut even, (c, *kind, missed[c]), outer, vanishes(c)))
            .collect();
        let inner = outer * even.width..(outer + samples) * even.width;
        let before = |c: usize| even.rows[c] - if vanishes(c) { first[c] } else { 0.0 };
        let input_before: Vec<f64> = (0..m).map(before).collect();
        let input_samples = input_samples(&even, outer, &input_before, &edges);
        let input_held = courses[..m].iter().map(|c| *c == Course::Held).collect();
        let squares =
            |c: usize| even.rows[inner.clone()].iter().skip(c).step_by(even.width).map(|v| v * v).sum::<f64>();
        let input_power = (0..m).map(|c| squares(c) / samples as f64).collect();
        let sums = Transform::new(samples, even.width, &comb).apply(&even.rows[inner.clone()]);
        let scale = 1.0 / samples as f64;
        let mut transforms: Vec<Complex64> = sums.iter().map(|s| s * scale).collect();
        let mut sampled_inputs = transforms[..m * comb.len()].to_vec();
        let more: Vec<Vec<Complex64>> =
            edges[..m].iter().map(|edges| held_edges::sums(edges, &inside, &comb)).collect();
        for (k, cycles) in comb.cycles.iter().enumerate() {
            let correction = Correction::new(TAU * cycles.value(), cycles.turned((samples - 1) as f64));
            for (c, (course, sides)) in courses.iter().zip(&sides).enumerate() {
                let at = c * comb.len() + k;
                transforms[at] = correction.apply(*course, sums[at], *sides) * scale;
                if c < m {
                    transforms[at] += more[c][k] * scale;
                    // the mean that an output would lose is another one: a constant is left
                    let seen = options.output_course();
                    let left = (seen.excess(*sides) - course.excess(*sides) - missed[c]) * scale;
                    sampled_inputs[at] = correction.apply(seen, sums[at], *sides) * scale
                        - left * constant(comb.omega[k], even.dt, samples);
                }
            }
        }
        let mut outputs = transforms.split_off(m * comb.len());
        let mut bridged = Vec::with_capacity(long.len());
        for (c, _) in &long {
            let trust = trust(&even, *c, &comb.omega, &sums[c * comb.len()..][..comb.len()]);
            let told = if *c < m { 0..even.width - m } else { c - m..c - m + 1 };
            for (k, _) in trust.kept.iter().enumerate().filter(|(_, kept)| !**kept) {
                told.clone().for_each(|o| outputs[o * comb.len() + k] = Complex64::new(f64::NAN, f64::NAN));
            }
            bridged.push(Bridge::new(options.name(*c, m), &even, *c, &trust));
        }
        if let Some((_, error)) = long.into_iter().next()
            && outputs.iter().all(|v| v.is_nan())
        {
            return Err(error);
        }
        let half = [outer as f64 - 0.5, (outer + samples) as f64 - 0.5];
        let ends_of = |(course, sides, edges): (&Course, Sides, &[HeldEdge])| {
            let [first, last] = course.ends(sides);
            let missed = half.map(|time| edges.iter().map(|edge| edge.at(time)).sum::<f64>());
            [first + missed[0], last + missed[1]]
        };
        let ends: Vec<[f64; 2]> = (0..even.width).map(|c| ends_of((&courses[c], sides[c], &edges[c]))).collect();
        let pick = |channels: std::ops::Range<usize>| {
            [0, 1].map(|side| ends[channels.clone()].iter().map(|e| e[side]).collect())
        };
        Ok(Self {
            name: run.name.clone(),
            dt: even.dt,
            samples,
            inputs: transforms,
            input_power,
            sampled_inputs,
            input_samples,
            input_held,
            input_before,
            outputs,
            bridged,
            input_ends: pick(0..m),
            output_ends: pick(m..even.width),
            omega: comb.omega,
        })
    }

    /// Length of what was transformed, T = N dt.
    pub fn duration(&self) -> f64 {
        self.samples as f64 * self.dt
    }

    /// How many independent frequencies the chosen ones are worth: closer than `1/T` to each other they are interpolated, and their noise is
    /// correlated.
    pub fn independent(&self) -> f64 {
        independent(&self.omega, self.duration())
    }

    /// The inputs that do not move in the band: their coefficients hold less than 1e-12 of their power.
    pub fn inputs_without_power(&self) -> Vec<usize> {
        let count = self.omega.len();
        let silent = |i: &usize| {
            // what neighbours share is counted once
            let power: f64 = self.inputs[i * count..][..count].iter().map(|c| 2.0 * c.norm_sqr()).sum();
            power * self.independent() / count as f64 <= NO_POWER * self.input_power[*i]
        };
        (0..self.input_power.len()).filter(silent).collect()
    }

    /// What the end values are multiplied with at frequency `k`, before the record and behind it: `exp(-j w t)/T` less its mean over the record,
    /// which takes out what is constant. On the record's own grid both are `exp(j w dt/2)/T`; elsewhere a constant rate has a transform, and
    /// what a constant bias of a state equation leaves behind is known from the end values.
    ///
    /// # Panics
    /// When there is no frequency `k`.
    pub fn end_factors(&self, k: usize) -> [Complex64; 2] {
        let (w, duration) = (self.omega[k], self.duration());
        let ends = [0.5 * self.dt, 0.5 * self.dt - duration].map(|t| Complex64::cis(w * t));
        let mean = constant(w, self.dt, self.samples);
        ends.map(|end| (end - mean) / duration)
    }
}

impl SpectrumOptions {
    pub(super) fn name(&self, channel: usize, inputs: usize) -> ChannelName {
        let (role, names, k) = if channel < inputs {
            ("input", &self.inputs, channel)
        } else {
            ("output", &self.outputs, channel - inputs)
        };
        ChannelName { role, name: names.get(k).cloned().unwrap_or_else(|| (k + 1).to_string()) }
    }

    /// What outputs are between their samples.
    fn output_course(&self) -> Course {
        self.course(1, 0, &[])
    }

    pub(super) fn course(&self, channel: usize, inputs: usize, held: &[bool]) -> Course {
        match self.interpolant {
            Interpolant::Samples => Course::Sampled,
            Interpolant::Linear => Course::Linear,
            Interpolant::AsIntegrated if channel >= inputs => Course::Smooth,
            Interpolant::AsIntegrated if held.get(channel) == Some(&true) => Course::Held,
            Interpolant::AsIntegrated => Course::Linear,
        }
    }
}

/// The transform of a constant 1; zero on the record's own grid.
fn constant(w: f64, dt: f64, samples: usize) -> Complex64 {
    let duration = samples as f64 * dt;
    (Complex64::cis(0.5 * w * dt) - Complex64::cis(w * (0.5 * dt - duration))) / Complex64::new(0.0, w * duration)
}

/// Takes off the mean over the record of a channel that edges between its samples make so much more; gives the samples at both ends. One that
/// vanishes does so before its first sample.
fn centre(
    even: &mut EvenRows,
    (channel, course, missed): (usize, Course, f64),
    outer: usize,
    vanishing: bool,
) -> Sides {
    let (width, places) = (even.width, even.places);
    let inner = places - 2 * outer;
    let at = |rows: &[f64], k: usize| rows[k * width + channel];
    let begin = at(&even.rows, 0);
    let sides = |rows: &[f64]| {
        let (first, last) = (at(rows, outer), at(rows, outer + inner - 1));
        if outer == 1 {
            return [[at(rows, 0), first], [last, at(rows, places - 1)]];
        }
        let line = |near: f64, next: f64| if course == Course::Held { near } else { 2.0 * near - next };
        let before = if vanishing { first - begin } else { line(first, at(rows, 1)) };
        [[before, first], [last, line(last, at(rows, places - 2))]]
    };
    // the mean in two steps, so that a large offset leaves no rounding behind
    for _ in 0..2 {
        let sum: f64 = even.rows[outer * width..].iter().skip(channel).step_by(width).take(inner).sum();
        let mean = (sum + course.excess(sides(&even.rows)) + missed) / inner as f64;
        even.rows.iter_mut().skip(channel).step_by(width).for_each(|v| *v -= mean);
    }
    sides(&even.rows)
}

/// What the transforms of a run are transforms of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Interpolant {
    /// What the time domain integrates: inputs held, with edges of their own, or linear between samples, by their exact transform; outputs smooth, by the sum and the
    /// first term of Euler and Maclaurin at the ends. The same linear model has the same response in both domains, up to (w dt)^4/240
    /// (inputs linear) or, for rates that held inputs drive directly, (w dt)^2/12.
    #[default]
    AsIntegrated,
    /// Every channel linear between its samples, with exact ends (the rule of a low-order interpolant; Morelli 1997).
    Linear,
    /// The samples themselves: plain sums for every channel (Marchand and Fu 1985).
    Samples,
}

/// The kind of one channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Course {
    Sampled,
    Held,
    Linear,
    Smooth,
}

/// Two samples on both sides of an end: of the left end those before and at the first sample that is transformed, of the right one the last
/// that is transformed and the one behind it.
pub(super) type Sides = [[f64; 2]; 2];

impl Course {
    /// Edges between samples, which a held channel alone has.
    pub(super) fn edges(self, edges: Vec<HeldEdge>) -> Vec<HeldEdge> {
        if self == Self::Held { edges } else { Vec::new() }
    }

    /// What the mean over the record is more than the mean of the samples, times their number.
    pub(super) fn excess(self, [left, right]: Sides) -> f64 {
        match self {
            Self::Sampled => 0.0,
            Self::Held => 0.5 * (left[0] - right[0]),
            Self::Linear => 0.125 * (left[0] - left[1] + right[1] - right[0]),
            Self::Smooth => ((right[1] - right[0]) - (left[1] - left[0])) / 24.0,
        }
    }

    /// What the transform of the samples far from ends is multiplied with to be that of what lies between them.
    pub(super) fn factor(self, theta: f64) -> Complex64 {
        let half = 0.5 * theta;
        let sinc = if half == 0.0 { 1.0 } else { half.sin() / half };
        match self {
            Self::Sampled | Self::Smooth => Complex64::ONE,
            Self::Held => Complex64::cis(-half) * sinc,
            Self::Linear => Complex64::from(sinc * sinc),
        }
    }

    /// Values half an interval outside.
    pub(super) fn ends(self, [left, right]: Sides) -> [f64; 2] {
        match self {
            Self::Held => [left[0], right[0]],
            _ => [0.5 * (left[0] + left[1]), 0.5 * (right[0] + right[1])],
        }
    }
}

/// The turns that corrections at one frequency are made of.
#[derive(Debug, Clone, Copy)]
pub(super) struct Correction {
    /// `w dt`.
    theta: f64,
    /// `exp(-j w dt (N - 1))`.
    last: Complex64,
    /// Integral of `-s exp(-j theta s)` from -1/2 to 0: the sample before, on its way into the record.
    before: Complex64,
    /// Integral of `(1 + s) exp(-j theta s)` from -1 to -1/2: what the factor takes of the first sample outside of the record.
    outside: Complex64,
    /// Integral of `exp(-j theta s)` from 0 to 1/2.
    half: Complex64,
}

impl Correction {
    pub(super) fn new(theta: f64, last: Complex64) -> Self {
        let before = integral(-0.5, |s| Complex64::cis(-theta * s) * -s);
        let outside = integral(-1.0, |s| Complex64::cis(-theta * s) * (1.0 + s));
        let half = integral(0.0, |s| Complex64::cis(-theta * s));
        Self { theta, last, before, outside, half }
    }

    /// The transform of what lies between the samples from their sum, in intervals.
    pub(super) fn apply(&self, course: Course, sum: Complex64, [left, right]: Sides) -> Complex64 {
        let whole = Complex64::cis(-0.5 * self.theta);
        let factor = course.factor(self.theta);
        match course {
            Course::Sampled => sum,
            Course::Held => {
                // the last sample reaches half an interval beyond the record, the one before the first half an interval into it
                factor * sum + self.half * whole.conj() * left[0] - self.half * whole * self.last * right[0]
            }
            Course::Linear => {
                let at = |samples: [f64; 2], before: Complex64, outside: Complex64| {
                    samples[0] * before - samples[1] * outside
                };
                factor * sum
                    + at(left, self.before, self.outside)
                    + self.last * at([right[1], right[0]], self.before.conj(), self.outside.conj())
            }
            Course::Smooth => {
                // Euler and Maclaurin: (1/24) of the slope of x exp(-j w t) at the right end less that at the left one
                let slope = |[a, b]: [f64; 2]| Complex64::new(b - a, -self.theta * 0.5 * (a + b));
                sum + (slope(right) * whole * self.last - slope(left) * whole.conj()) / 24.0
            }
        }
    }
}

/// Integral over half an interval from `start` on, by Gauss's eight points: exact to rounding up to Nyquist.
fn integral(start: f64, f: impl Fn(f64) -> Complex64) -> Complex64 {
    const POINTS: [(f64, f64); 4] = [
        (0.183_434_642_495_649_8, 0.362_683_783_378_362),
        (0.525_532_409_916_329, 0.313_706_645_877_887_3),
        (0.796_666_477_413_626_7, 0.222_381_034_453_374_48),
        (0.960_289_856_497_536_3, 0.101_228_536_290_376_26),
    ];
    let middle = start + 0.25;
    POINTS.iter().map(|(x, weight)| (f(middle - 0.25 * x) + f(middle + 0.25 * x)) * (0.25 * weight)).sum()
}
