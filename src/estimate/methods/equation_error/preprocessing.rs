//! What is done to a record before it is regressed: a low-pass filter without phase, trends and smoothing, on all channels alike, so that equations that are
//! linear in them still hold.

use super::differentiation::smoothed;
use super::error::RegressionError;
use super::options::Detrend;
use fdm_system::record::Run;
use std::f64::consts::{FRAC_1_SQRT_2, PI};

/// Steps in the order in which they are taken; none by default.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Preprocessing {
    /// Cut-off of a low-pass filter without phase, in cycles per unit of time: Butterworth's of second order, there and back.
    pub cutoff: Option<f64>,
    /// Mean or line to be removed from every channel; what remains of a model is its linear part.
    pub detrend: Detrend,
    /// Samples of a window (odd, at least 5) whose polynomial of degree four replaces its middle.
    pub points: Option<usize>,
}

impl Preprocessing {
    /// Whether nothing is to be done.
    pub fn is_idle(&self) -> bool {
        *self == Self::default()
    }

    /// A run with these steps taken; gaps stay gaps.
    ///
    /// # Errors
    /// [`RegressionError`] for a window or a cut-off that has no meaning, and for a cut-off where samples are uneven.
    pub fn of(&self, run: &Run) -> Result<Run, RegressionError> {
        if let Some(points) = self.points.filter(|p| *p < 5 || p.is_multiple_of(2)) {
            return Err(RegressionError::Window(points));
        }
        let filter = self.cutoff.map(|cutoff| LowPass::new(cutoff, run)).transpose()?;
        let mut run = run.clone();
        let time = run.time.clone();
        for width_and_values in [(run.held.len(), &mut run.inputs), (run.output_gaps.len(), &mut run.measured)] {
            let (width, values) = width_and_values;
            for k in 0..width {
                let column: Vec<f64> = values.iter().skip(k).step_by(width).copied().collect();
                let there: Vec<usize> = (0..column.len()).filter(|i| !column[*i].is_nan()).collect();
                if there.is_empty() {
                    continue;
                }
                let mut whole = column.clone();
                fdm_system::record::bridge(&time, &mut whole, 1, 0, false);
                if let Some(filter) = &filter {
                    whole = filter.there_and_back(&whole);
                }
                detrend(&time, &mut whole, self.detrend);
                if let Some(points) = self.points {
                    whole = smoothed(&time, &whole, points);
                }
                there.iter().for_each(|i| values[i * width + k] = whole[*i]);
            }
        }
        Ok(run)
    }
}

/// Butterworth's filter of second order by the bilinear transform.
struct LowPass {
    /// Of the input at the last three samples.
    ahead: [f64; 3],
    /// Of the output at the last two.
    back: [f64; 2],
    /// Samples that are added at both ends, so that the filter is at rest when the record begins.
    margin: usize,
}

impl LowPass {
    fn new(cutoff: f64, run: &Run) -> Result<Self, RegressionError> {
        let mean = (run.time[run.len() - 1] - run.time[0]) / (run.len().max(2) - 1) as f64;
        let uneven = run.time.windows(2).any(|w| ((w[1] - w[0]) / mean - 1.0).abs() > 1e-3);
        if uneven {
            return Err(RegressionError::UnevenFilter { run: run.name.clone() });
        }
        if !(cutoff > 0.0 && cutoff * mean < 0.5) {
            return Err(RegressionError::Cutoff(cutoff));
        }
        let k = (PI * cutoff * mean).tan();
        let whole = 1.0 + 2.0 * FRAC_1_SQRT_2 * k + k * k;
        let b = k * k / whole;
        Ok(Self {
            ahead: [b, 2.0 * b, b],
            back: [2.0 * (k * k - 1.0) / whole, (1.0 - 2.0 * FRAC_1_SQRT_2 * k + k * k) / whole],
            margin: (3.0 / (cutoff * mean)).ceil() as usize,
        })
    }

    fn along(&self, values: &mut [f64]) {
        let Some(first) = values.first().copied() else { return };
        let (mut x, mut y) = ([first; 2], [first; 2]);
        for v in values {
            let input = *v;
            let [a, b, c] = self.ahead;
            *v = a * input + b * x[0] + c * x[1] - self.back[0] * y[0] - self.back[1] * y[1];
            (x, y) = ([input, x[0]], [*v, y[0]]);
        }
    }

    /// Without phase; the record goes on beyond its ends as its own image turned about them.
    fn there_and_back(&self, values: &[f64]) -> Vec<f64> {
        let n = values.len();
        let margin = self.margin.min(n.saturating_sub(1));
        let (first, last) = (values[0], values[n - 1]);
        let front = (1..=margin).rev().map(|k| 2.0 * first - values[k]);
        let behind = (1..=margin).map(|k| 2.0 * last - values[n - 1 - k]);
        let mut whole: Vec<f64> = front.chain(values.iter().copied()).chain(behind).collect();
        for _ in 0..2 {
            self.along(&mut whole);
            whole.reverse();
        }
        whole[margin..margin + n].to_vec()
    }
}

/// Takes the trend off; `time` belongs to the values.
pub(super) fn detrend(time: &[f64], values: &mut [f64], what: Detrend) {
    if what == Detrend::None || values.is_empty() {
        return;
    }
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    let level = mean(values);
    values.iter_mut().for_each(|v| *v -= level);
    if what == Detrend::Mean {
        return;
    }
    let middle = mean(time);
    let above: f64 = time.iter().zip(values.iter()).map(|(t, v)| (t - middle) * v).sum();
    let below: f64 = time.iter().map(|t| (t - middle).powi(2)).sum();
    if below > 0.0 {
        let slope = above / below;
        values.iter_mut().zip(time).for_each(|(v, t)| *v -= slope * (t - middle));
    }
}

impl Detrend {
    /// Degrees of freedom that each run loses.
    pub(super) fn taken(self) -> usize {
        match self {
            Self::None => 0,
            Self::Mean => 1,
            Self::Line => 2,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(values: Vec<f64>, dt: f64) -> Run {
        Run {
            name: "r".into(),
            time: (0..values.len()).map(|k| dt * k as f64).collect(),
            inputs: values.clone(),
            held: vec![false],
            measured: values,
            input_gaps: vec![0],
            stated: Vec::new(),
            output_gaps: vec![0],
        }
    }

    /// At the cut-off the filter, gone twice, leaves a half, without any delay; well below it everything.
    #[test]
    fn the_filter_has_the_gain_of_its_order_and_no_phase() {
        let dt = 0.01;
        for (frequency, gain) in [(0.2f64, 1.0f64), (2.0, 0.5), (20.0, 1e-4)] {
            let wave = |k: usize| (2.0 * PI * frequency * dt * k as f64).sin();
            let found = Preprocessing { cutoff: Some(2.0), ..Preprocessing::default() }
                .of(&run((0..2000).map(wave).collect(), dt))
                .expect("even");
            let middle = 500..1500;
            let (mut by, mut beside) = (0.0, 0.0);
            for k in middle {
                by += 2.0 * found.measured[k] * wave(k) / 1000.0;
                beside += 2.0 * found.measured[k] * (2.0 * PI * frequency * dt * k as f64).cos() / 1000.0;
            }
            assert!((by - gain).abs() < 0.01 * gain.max(0.01) && beside.abs() < 1e-3, "{frequency}: {by} {beside}");
            assert_eq!(found.measured, found.inputs, "all channels alike");
        }
    }

    #[test]
    fn trends_go_gaps_stay_and_nonsense_is_refused() {
        let mut record = run((0..50).map(|k| 3.0 + 0.5 * f64::from(k)).collect(), 0.1);
        record.measured[7] = f64::NAN;
        let steps = Preprocessing { detrend: Detrend::Line, points: Some(7), ..Preprocessing::default() };
        let found = steps.of(&record).expect("possible");
        assert!(found.measured[7].is_nan() && found.measured.iter().filter(|v| !v.is_nan()).all(|v| v.abs() < 1e-9));
        let refused = |steps: Preprocessing| steps.of(&record).expect_err("refused");
        assert_eq!(refused(Preprocessing { points: Some(4), ..steps }), RegressionError::Window(4));
        assert_eq!(refused(Preprocessing { cutoff: Some(5.0), ..steps }), RegressionError::Cutoff(5.0));
        record.time[20] += 0.03;
        let uneven = Preprocessing { cutoff: Some(1.0), ..steps }.of(&record);
        assert_eq!(uneven, Err(RegressionError::UnevenFilter { run: "r".into() }));
    }
}

#[cfg(test)]
mod detrend_tests {
    use super::*;

    #[test]
    fn means_and_lines_are_taken_off() {
        let time = [0.0, 1.0, 3.0, 4.0];
        let mut line = time.map(|t| 2.0 - 3.0 * t);
        detrend(&time, &mut line, Detrend::Line);
        assert!(line.iter().all(|v| v.abs() < 1e-14));
        let mut values = [1.0, 2.0, 3.0, 6.0];
        detrend(&time, &mut values, Detrend::Mean);
        assert_eq!(values, [-2.0, -1.0, 0.0, 3.0]);
    }
}
