//! One recorded manoeuvre, in the model's own channels, order and units; its inputs between samples, linear or held, with their slopes.

use std::ops::Range;

/// A record ready for simulation: what drove the vehicle and what was measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    /// Name that tables show, unique among the runs of a problem.
    pub name: String,
    /// Time since the run began (N), in the model's time unit, strictly rising from 0. For a model without states
    /// and without explicit time it counts samples where the file has no time that rises.
    pub time: Vec<f64>,
    /// Inputs, one row per sample (N by m), in the model's units, hidden ones (records of outputs) behind the declared
    /// ones; gaps are bridged linearly and counted.
    pub inputs: Vec<f64>,
    /// Whether an input keeps its value until the next sample (m); otherwise it is linear between samples.
    pub held: Vec<bool>,
    /// Whether somebody said how an input goes between samples (m): the model's text, a map or an option. Where nobody did (all that are missing
    /// here), [`Self::held`] is what was assumed.
    pub stated: Vec<bool>,
    /// Measured outputs, one row per sample (N by q), in the model's units; NaN where nothing is to be compared.
    pub measured: Vec<f64>,
    /// Cells of each input that were empty (m).
    pub input_gaps: Vec<usize>,
    /// Cells of each output that were empty (q); not those of samples at the times of other sensors, or at the edges of commands.
    pub output_gaps: Vec<usize>,
}

impl Run {
    /// Number of samples N.
    pub fn len(&self) -> usize {
        self.time.len()
    }

    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.time.is_empty()
    }

    /// Whether somebody said how an input (by index) goes between samples.
    pub fn is_stated(&self, input: usize) -> bool {
        self.stated.get(input).is_some_and(|stated| *stated)
    }

    /// Whether any output has a value in a sample (by index).
    pub fn is_compared(&self, sample: usize) -> bool {
        let q = self.output_gaps.len();
        self.measured[sample * q..(sample + 1) * q].iter().any(|v| !v.is_nan())
    }

    /// Whether an output (by index) has a value in any sample.
    pub fn measures(&self, output: usize) -> bool {
        self.measured.iter().skip(output).step_by(self.output_gaps.len().max(1)).any(|v| !v.is_nan())
    }

    /// Turns outputs of a model from sample `first` on (samples by q) by whole periods towards what was measured: where values a period
    /// apart are the same, the residual is the short way round. Its derivatives by anything are those of the outputs.
    pub fn turn(&self, wraps: &[(u32, f64)], first: usize, y: &mut [f64]) {
        let q = self.output_gaps.len();
        for (output, period) in wraps.iter().filter(|(output, _)| (*output as usize) < q) {
            let measured = self.measured.iter().skip(first * q + *output as usize).step_by(q);
            for (y, z) in y.iter_mut().skip(*output as usize).step_by(q).zip(measured) {
                let turns = ((z - *y) / period).round();
                if turns != 0.0 && turns.is_finite() {
                    *y += turns * period;
                }
            }
        }
    }

    /// Some neighbouring samples as a run of the same name; their times stay those of the whole record, so that a part that
    /// does not begin with the first sample begins later than 0.
    ///
    /// # Panics
    /// When there are fewer samples than the range wants.
    pub fn part(&self, samples: Range<usize>) -> Self {
        let n = self.len().max(1);
        let (m, q) = (self.inputs.len() / n, self.measured.len() / n);
        let rows = |values: &[f64], width: usize| values[samples.start * width..samples.end * width].to_vec();
        Self {
            time: self.time[samples.clone()].to_vec(),
            inputs: rows(&self.inputs, m),
            measured: rows(&self.measured, q),
            ..self.clone()
        }
    }

    /// The run with every interval between samples in so many equal parts: inputs as they move or are held, nothing measured.
    pub fn with_parts(&self, parts: usize) -> Self {
        let (parts, n) = (parts.max(1), self.len());
        let (m, q) = (self.held.len(), self.output_gaps.len());
        let (mut time, mut inputs) = (Vec::with_capacity(n * parts), Vec::with_capacity(n * parts * m));
        for k in 0..n {
            let next = (k + 1).min(n - 1);
            for part in 0..if next > k { parts } else { 1 } {
                let share = part as f64 / parts as f64;
                let between = |a: f64, b: f64| if part == 0 { a } else { a + share * (b - a) };
                time.push(between(self.time[k], self.time[next]));
                let (from, to) = (&self.inputs[k * m..][..m], &self.inputs[next * m..][..m]);
                let moved = from.iter().zip(to).zip(&self.held);
                inputs.extend(moved.map(|((a, b), held)| if *held { *a } else { between(*a, *b) }));
            }
        }
        let measured = vec![f64::NAN; time.len() * q];
        Self { time, inputs, measured, ..self.clone() }
    }

    /// Every `k`-th sample from the first one on.
    pub fn every(&self, k: usize) -> Self {
        let (k, n) = (k.max(1), self.len().max(1));
        let (m, q) = (self.inputs.len() / n, self.measured.len() / n);
        let rows = |values: &[f64], width: usize| -> Vec<f64> {
            values.chunks_exact(width.max(1)).step_by(k).flatten().copied().collect()
        };
        Self {
            time: self.time.iter().step_by(k).copied().collect(),
            inputs: rows(&self.inputs, m),
            measured: rows(&self.measured, q),
            ..self.clone()
        }
    }

    /// The run with these inputs and outputs only, in this order.
    ///
    /// # Panics
    /// When there is no such channel.
    pub fn with_channels(&self, inputs: &[usize], outputs: &[usize]) -> Self {
        let (m, q) = (self.held.len(), self.output_gaps.len());
        let columns = |values: &[f64], width: usize, chosen: &[usize]| -> Vec<f64> {
            values.chunks_exact(width.max(1)).flat_map(|row| chosen.iter().map(|c| row[*c])).collect()
        };
        Self {
            name: self.name.clone(),
            time: self.time.clone(),
            inputs: columns(&self.inputs, m, inputs),
            held: inputs.iter().map(|i| self.held[*i]).collect(),
            stated: inputs.iter().map(|i| self.is_stated(*i)).collect(),
            measured: columns(&self.measured, q, outputs),
            input_gaps: inputs.iter().map(|i| self.input_gaps[*i]).collect(),
            output_gaps: outputs.iter().map(|o| self.output_gaps[*o]).collect(),
        }
    }
}

/// A time's place among the samples: at or behind sample `left`, `part` of the way to the next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// The sample at or before the time; 0 before the record.
    pub left: usize,
    /// Part of the interval that has passed, in [0, 1]; 0 outside the record.
    pub part: f64,
    /// One over the length of the interval; 0 outside the record, where nothing changes.
    pub rate: f64,
}

impl Place {
    /// The place of `t` in rising times (at least one). At a sample the interval to its right counts; before the
    /// first and from the last sample on, values stay.
    pub fn new(time: &[f64], t: f64) -> Self {
        Self::after(time, time.partition_point(|s| *s <= t), t)
    }

    /// The place of `t` taken as if `count` samples were at or before it: which side of a sample counts is the
    /// caller's choice.
    pub fn after(time: &[f64], count: usize, t: f64) -> Self {
        if count == 0 || count >= time.len() {
            return Self { left: count.saturating_sub(1), part: 0.0, rate: 0.0 };
        }
        let left = count - 1;
        let rate = 1.0 / (time[count] - time[left]);
        Self { left, part: (t - time[left]) / (time[count] - time[left]), rate }
    }
}

/// Finds places of times that rise, or seldom fall, without searching the whole record each time.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Cursor {
    /// Samples at or before the time asked last.
    count: usize,
}

impl Cursor {
    /// Samples at or before the time that was asked last.
    pub fn count(&self) -> usize {
        self.count
    }

    /// The place of a time, as [`Place::new`] has it; costs one or two comparisons when `t` is in the last interval or
    /// the next, and the logarithm of the distance otherwise.
    pub fn at(&mut self, time: &[f64], t: f64) -> Place {
        let mut low = self.count.min(time.len());
        let mut high = low;
        let mut reach = 1;
        // samples before `low` are at or before t, samples from `high` on are behind it
        while low > 0 && time[low - 1] > t {
            high = low - 1;
            low = low.saturating_sub(reach);
            reach *= 2;
        }
        while high < time.len() && time[high] <= t {
            low = high + 1;
            high = (high + reach).min(time.len());
            reach *= 2;
        }
        self.count = low + time[low..high].partition_point(|s| *s <= t);
        Place::after(time, self.count, t)
    }
}

impl Run {
    /// Value and slope of an input at a place.
    pub fn input(&self, input: usize, place: Place) -> (f64, f64) {
        let width = self.held.len();
        let left = self.inputs[place.left * width + input];
        if place.rate == 0.0 || self.held[input] {
            return (left, 0.0);
        }
        let rise = self.inputs[(place.left + 1) * width + input] - left;
        (left + place.part * rise, place.rate * rise)
    }

    /// Value and slope of an input at any time; slope of the right side at a sample, 0 outside the record.
    pub fn input_at(&self, input: usize, t: f64) -> (f64, f64) {
        self.input(input, Place::new(&self.time, t))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn run() -> Run {
        Run {
            name: "r".into(),
            time: vec![0.0, 1.0, 3.0],
            inputs: vec![1.0, 10.0, 2.0, 20.0, 6.0, 30.0],
            held: vec![false, true],
            stated: Vec::new(),
            measured: Vec::new(),
            input_gaps: vec![0, 0],
            output_gaps: Vec::new(),
        }
    }

    #[test]
    fn linear_and_held_values_have_the_slope_of_the_right_side() {
        let run = run();
        let cases = [
            (-1.0, (1.0, 0.0), 10.0),
            (0.0, (1.0, 1.0), 10.0),
            (0.25, (1.25, 1.0), 10.0),
            (1.0, (2.0, 2.0), 20.0),
            (2.5, (5.0, 2.0), 20.0),
            (3.0, (6.0, 0.0), 30.0),
            (9.0, (6.0, 0.0), 30.0),
        ];
        for (t, linear, held) in cases {
            assert_eq!(run.input_at(0, t), linear, "{t}");
            assert_eq!(run.input_at(1, t), (held, 0.0), "{t}");
        }
        let single = Run { time: vec![0.0], inputs: vec![4.0, 5.0], ..run };
        assert_eq!((single.input_at(0, -1.0), single.input_at(0, 0.0)), ((4.0, 0.0), (4.0, 0.0)));
    }

    proptest! {
        #[test]
        fn the_cursor_finds_what_a_search_finds(
            steps in prop::collection::vec(0.01..2.0_f64, 1..40),
            queries in prop::collection::vec(-3.0..60.0_f64, 1..60),
        ) {
            let time: Vec<f64> = steps.iter().scan(0.0, |t, s| { *t += s; Some(*t) }).collect();
            let mut cursor = Cursor::default();
            for t in queries.iter().chain(&time).chain(time.iter().rev()) {
                prop_assert_eq!(cursor.at(&time, *t), Place::new(&time, *t));
            }
        }
    }
}
