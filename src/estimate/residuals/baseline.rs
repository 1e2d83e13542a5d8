//! What predictions without any model miss by: a model that does no better than these says nothing of a run.

use fdm_system::record::Run;

/// How far trivial predictions of an output of a run are off, beside that of a model.
#[derive(Debug, Clone, PartialEq)]
pub struct Baseline {
    /// The output.
    pub output: String,
    /// The run.
    pub run: String,
    /// Root mean square of the model's residual.
    pub rms: f64,
    /// Root mean square of the residual of the value measured last before the prediction begins, held to the end.
    pub last_value: f64,
    /// Root mean square of the residual of the straight line through the predicted samples themselves, by least
    /// squares.
    pub straight_line: f64,
}

impl Baseline {
    /// Of every output (q names) of runs with these residuals (N by q each), over the samples later than `from` after the beginning of a run,
    /// in its unit of time.
    pub fn of(outputs: &[&str], runs: &[Run], residuals: &[&[f64]], from: f64) -> Vec<Self> {
        let mut found = Vec::new();
        for (run, residuals) in runs.iter().zip(residuals) {
            let own = outputs.iter().enumerate().filter_map(|(o, name)| Self::new(name, run, o, residuals, from));
            found.extend(own);
        }
        found
    }

    fn new(output: &str, run: &Run, o: usize, residuals: &[f64], from: f64) -> Option<Self> {
        let (q, begin) = (run.output_gaps.len(), run.time.first()? + from);
        let samples = run.time.iter().enumerate().map(|(k, t)| (*t, run.measured[k * q + o], residuals[k * q + o]));
        let all: Vec<(f64, f64, f64)> = samples.filter(|(_, z, _)| !z.is_nan()).collect();
        let (known, ahead) = all.split_at(all.partition_point(|(t, ..)| *t <= begin).max(1).min(all.len()));
        let (held, n) = (known.last()?.1, ahead.len() as f64);
        let mean = |of: &dyn Fn(&(f64, f64, f64)) -> f64| ahead.iter().map(of).sum::<f64>() / n;
        let (middle, centre) = (mean(&|(t, ..)| *t), mean(&|(_, z, _)| *z));
        let spread = mean(&|(t, ..)| (t - middle) * (t - middle));
        let slope = mean(&|(t, z, _)| (t - middle) * (z - centre)) / spread;
        let line = |t: f64, z: f64| z - centre - slope * (t - middle);
        let found = Self {
            output: output.into(),
            run: run.name.clone(),
            rms: mean(&|(.., e)| e * e).sqrt(),
            last_value: mean(&|(_, z, _)| (z - held) * (z - held)).sqrt(),
            straight_line: mean(&|(t, z, _)| line(*t, *z).powi(2)).sqrt(),
        };
        (ahead.len() > 2 && found.rms.is_finite()).then_some(found)
    }

    /// What the model does worse than, in words; none where it does better than both.
    pub fn beaten(&self) -> Option<String> {
        let by = match (self.rms >= self.last_value, self.rms >= self.straight_line) {
            (true, true) => "its last value held and a straight line",
            (true, false) => "its last value held",
            (false, true) => "a straight line",
            (false, false) => return None,
        };
        Some(format!("the prediction of `{}` in run `{}` is no better than {by}", self.output, self.run))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn trivial_predictions_of_a_ramp_with_a_bump() {
        let time: Vec<f64> = (0..5).map(f64::from).collect();
        // 1 + 2 t, and 3 more in the middle
        let measured = vec![1.0, 3.0, 8.0, 7.0, 9.0];
        let (name, held, gaps) = ("r".into(), Vec::new(), vec![0]);
        let run = Run {
            name,
            inputs: Vec::new(),
            held,
            measured,
            input_gaps: Vec::new(),
            stated: Vec::new(),
            output_gaps: gaps,
            time,
        };
        let found = &Baseline::of(&["y"], &[run], &[&[0.0, 0.0, 3.0, 0.0, 0.0]], 0.0)[0];
        assert!((found.last_value - ((4.0 + 49.0 + 36.0 + 64.0) / 4.0_f64).sqrt()).abs() < 1e-12, "{found:?}");
        // the line through (1, 3), (2, 8), (3, 7), (4, 9) is 2.5 + 1.7 t
        let off: [f64; 4] = [3.0 - 4.2, 8.0 - 5.9, 7.0 - 7.6, 9.0 - 9.3];
        let line = (off.iter().map(|e| e * e).sum::<f64>() / 4.0).sqrt();
        assert!((found.straight_line - line).abs() < 1e-12, "{found:?}");
        assert!((found.rms - 1.5).abs() < 1e-12);
        assert_eq!(
            found.beaten().as_deref(),
            Some("the prediction of `y` in run `r` is no better than a straight line")
        );
    }
}
