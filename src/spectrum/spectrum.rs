//! The transform of one run.

use super::cross_spectra::NO_POWER;
use super::error::{ChannelName, SpectrumError};
use super::even_rows::EvenRows;
use super::frequencies::Frequencies;
use super::interpolant::{Correction, Course, Interpolant, Sides};
use super::overlap::independent;
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
    /// Samples of the inputs, m by N + 1: what an input is before the record, then those that were transformed. Nothing where they are not known.
    pub input_samples: Vec<f64>,
    /// Whether each input is held between samples (m).
    pub input_held: Vec<bool>,
    /// What each input is before the record (m): the first of its samples, or zero less the mean that was taken off. Nothing where that is not known.
    pub input_before: Vec<f64>,
    /// Measured outputs, q by M; NaN for one that was never measured, where that was allowed.
    pub outputs: Vec<Complex64>,
    /// Values of the inputs half an interval before the first transformed sample, and half an interval behind the last (m each).
    pub input_ends: [Vec<f64>; 2],
    /// The same of the outputs (q each).
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

impl Spectrum {
    /// Transforms a run at the chosen frequencies.
    ///
    /// # Errors
    /// [`SpectrumError`]: uneven sampling, long gaps, channels without values, and bands that the record cannot show.
    pub fn of(run: &Run, choice: &Frequencies, options: &SpectrumOptions) -> Result<Self, SpectrumError> {
        let mut even = EvenRows::of(run)?;
        let outer = usize::from(options.ends == Ends::Interpolated);
        let samples = even.places - 2 * outer;
        let comb = choice.of(samples, even.dt, even.width)?;
        let m = run.inputs.len() / run.len();
        let highest = comb.omega.last().map_or(0.0, |w| w / TAU);
        for c in 0..even.width {
            let name = options.name(c, m);
            if !even.never_measured(c) {
                even.check_gap(c, highest, name)?;
            } else if c < m || !options.allow_unmeasured {
                return Err(SpectrumError::NeverMeasured(name));
            }
        }
        let courses: Vec<Course> = (0..even.width).map(|c| options.course(c, m, &run.held)).collect();
        let first: Vec<f64> = even.rows[..m].to_vec();
        let vanishes = |c: usize| c < m && options.vanishing.contains(&(c as u32));
        let sides: Vec<Sides> =
            courses.iter().enumerate().map(|(c, kind)| centre(&mut even, c, *kind, outer, vanishes(c))).collect();
        let inner = outer * even.width..(outer + samples) * even.width;
        let samples_of = |c: usize| std::iter::once(0).chain(outer..outer + samples).map(move |k| k * even.width + c);
        let mut input_samples: Vec<f64> = (0..m).flat_map(samples_of).map(|at| even.rows[at]).collect();
        let before = |c: usize| even.rows[c] - if vanishes(c) { first[c] } else { 0.0 };
        let input_before: Vec<f64> = (0..m).map(before).collect();
        if outer == 0 {
            input_samples.chunks_mut(samples + 1).zip(&input_before).for_each(|(row, before)| row[0] = *before);
        }
        let input_held = courses[..m].iter().map(|c| *c == Course::Held).collect();
        let squares =
            |c: usize| even.rows[inner.clone()].iter().skip(c).step_by(even.width).map(|v| v * v).sum::<f64>();
        let input_power = (0..m).map(|c| squares(c) / samples as f64).collect();
        let sums = Transform::new(samples, even.width, &comb).apply(&even.rows[inner.clone()]);
        let scale = 1.0 / samples as f64;
        let mut transforms: Vec<Complex64> = sums.iter().map(|s| s * scale).collect();
        let mut sampled_inputs = transforms[..m * comb.len()].to_vec();
        for (k, cycles) in comb.cycles.iter().enumerate() {
            let correction = Correction::new(TAU * cycles.value(), cycles.turned((samples - 1) as f64));
            for (c, (course, sides)) in courses.iter().zip(&sides).enumerate() {
                let at = c * comb.len() + k;
                transforms[at] = correction.apply(*course, sums[at], *sides) * scale;
                if c < m {
                    // the mean that an output would lose is another one: a constant is left
                    let seen = options.output_course();
                    let left = (seen.excess(*sides) - course.excess(*sides)) * scale;
                    sampled_inputs[at] = correction.apply(seen, sums[at], *sides) * scale
                        - left * constant(comb.omega[k], even.dt, samples);
                }
            }
        }
        let outputs = transforms.split_off(m * comb.len());
        let ends: Vec<[f64; 2]> = courses.iter().zip(&sides).map(|(course, sides)| course.ends(*sides)).collect();
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

/// Takes off a channel's mean over the record; gives the samples at both ends. One that vanishes does so before its first sample.
fn centre(even: &mut EvenRows, channel: usize, course: Course, outer: usize, vanishing: bool) -> Sides {
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
        let mean = (sum + course.excess(sides(&even.rows))) / inner as f64;
        even.rows.iter_mut().skip(channel).step_by(width).for_each(|v| *v -= mean);
    }
    sides(&even.rows)
}
