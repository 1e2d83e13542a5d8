//! Derivatives of inputs, as their records are interpolated: `der(u)`.
//!
//! Between samples a recorded input is linear, so that its derivative is held: an integrator that sees these slopes integrates them back to
//! the input exactly, and their Fourier integral is `j w U` with the input's own end terms. At a sample the derivative is the mean of both sides.

use super::run::Run;
use fdm_grammar::model::Slope;

/// Fills input `k` of `width` with the slopes of another; zero for a single sample.
pub(super) fn fill(time: &[f64], inputs: &mut [f64], width: usize, k: usize, slope: Slope) {
    let of = slope.of as usize;
    let rise =
        |inputs: &[f64], s: usize| (inputs[(s + 1) * width + of] - inputs[s * width + of]) / (time[s + 1] - time[s]);
    let last = time.len().saturating_sub(1);
    let mut before = None;
    for s in 0..time.len() {
        let after = (s < last).then(|| rise(inputs, s));
        inputs[s * width + k] = match (before, after) {
            (Some(before), Some(after)) if slope.shown => 0.5 * (before + after),
            (_, Some(one)) | (Some(one), None) => one,
            (None, None) => 0.0,
        };
        before = after;
    }
}

impl Run {
    /// The derivative of an input at a sample, where input `k` holds its slopes: the mean of both sides.
    pub(crate) fn slope_at(&self, k: usize, sample: usize) -> f64 {
        let at = |s: usize| self.inputs[s * self.held.len() + k];
        0.5 * (at(sample.saturating_sub(1)) + at(sample))
    }
}

/// Rows with more places behind each, NaN.
pub(super) fn widened(inputs: &[f64], n: usize, width: usize, more: usize) -> Vec<f64> {
    let rows =
        (0..n).flat_map(|s| inputs[s * width..][..width].iter().copied().chain(std::iter::repeat_n(f64::NAN, more)));
    rows.collect()
}

#[cfg(test)]
mod tests {
    use crate::record::{Incomplete, Run};
    use fdm_grammar::{Model, Source, compile};

    fn model(text: &str) -> Model {
        compile(&Source::new("m.fdm", text)).unwrap_or_else(|e| panic!("{e:?}")).model
    }

    fn run(held: bool) -> Run {
        Run {
            name: "r".into(),
            time: vec![0.0, 1.0, 3.0],
            inputs: vec![1.0, 2.0, 6.0],
            held: vec![held],
            measured: vec![0.0, f64::NAN, 3.0],
            input_gaps: vec![0],
            output_gaps: vec![1],
        }
    }

    #[test]
    fn slopes_are_held_where_they_drive_and_means_where_they_are_shown() {
        let model = model("model m { input u; state x; der(x) = der(u) - x; output y = x + 2*der(u); }");
        let names: Vec<&str> = model.inputs.iter().map(|i| i.quantity.name.as_str()).collect();
        assert_eq!(names, ["u", "der(u)", "der(u) at samples"]);
        let done = run(false).with_measured(&model).unwrap();
        assert_eq!(done.inputs, [1.0, 1.0, 1.0, 2.0, 2.0, 1.5, 6.0, 2.0, 2.0]);
        assert_eq!(done.held, [false, true, false]);
        assert_eq!(done.with_measured(&model).unwrap().inputs, done.inputs, "again is the same");
        let said = run(true).with_measured(&model).unwrap_err();
        assert!(matches!(said, Incomplete::Held { .. }), "{said}");
        assert_eq!(
            said.to_string(),
            "the input `u` is held between samples in the run `r`, so that it jumps and `der(u)` does not exist"
        );
    }

    #[test]
    fn what_is_shown_only_needs_no_drive_and_records_have_derivatives_too() {
        let shown = model("model m { input u; output y = der(u)*2; }");
        assert_eq!(shown.inputs.len(), 2);
        assert!(shown.inputs[1].slope.is_some_and(|s| s.shown));
        let record = model("model m { input u; state x; der(x) = u + der(measured(y)); output y = x; }");
        let done = run(false).with_measured(&record).unwrap();
        assert_eq!(done.inputs[1..3], [0.0, 1.0], "0, 1 (bridged), 3");
        assert_eq!((done.inputs[5], done.input_gaps), (1.0, vec![0, 1, 1]));
    }
}
