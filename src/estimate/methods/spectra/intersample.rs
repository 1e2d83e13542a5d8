//! Measured regressors between their samples.
//!
//! The transform of an input takes it for straight lines between samples. A product of an input and a state, or the square of a state, is
//! bent there, by `dt^2 f''/8` in the middle: enough to bias what little noise hides. What lies between two samples of what a term is made of
//! is known well, inputs straight and records smooth, and so is the term in the middle. Its samples are changed so that straight lines between
//! them have the area of parabolas through all three.

use fdm_grammar::Model;
use fdm_system::record::Run;

/// Part of an interval by which one may differ from the usual one.
const JITTER: f64 = 0.3;

/// A run, complete with its computed inputs, with these changed so; none when there is nothing to change.
pub(super) fn with_areas(run: &Run, model: &Model) -> Option<Run> {
    if run.held.len() != model.inputs.len() {
        return None;
    }
    let bent = |k: &usize| model.inputs[*k].computed.as_ref().is_some_and(|c| c.graph.delayed().is_empty());
    let bent: Vec<usize> = (0..model.inputs.len()).filter(bent).filter(|k| !run.held[*k]).collect();
    if bent.is_empty() || run.len() < 4 {
        return None;
    }
    let middles = middles(run).with_measured(model).ok()?;
    let usual = usual_intervals(run);
    let (mut changed, m) = (run.clone(), run.held.len());
    for k in bent {
        let bend = |i: usize| {
            let ends = 0.5 * (run.inputs[i * m + k] + run.inputs[(i + 1) * m + k]);
            let bend = middles.inputs[i * m + k] - ends;
            if usual[i] && bend.is_finite() { bend } else { 0.0 }
        };
        let last = run.len() - 1;
        for sample in 0..=last {
            // two thirds of the bend are its mean; each end of the interval takes half of that
            let (before, behind) = (bend(sample.max(1) - 1), bend(sample.min(last - 1)));
            changed.inputs[sample * m + k] += (before + behind) / 3.0;
        }
    }
    Some(changed)
}

/// The run halfway between its samples: inputs straight or held, records by the cubic through four samples.
fn middles(run: &Run) -> Run {
    let (n, m, q) = (run.len(), run.held.len(), run.output_gaps.len());
    let input = |(i, k): (usize, usize)| {
        let (a, b) = (run.inputs[i * m + k], run.inputs[(i + 1) * m + k]);
        if run.held[k] { a } else { 0.5 * (a + b) }
    };
    let record = |(i, o): (usize, usize)| {
        let at = |i: usize| run.measured[i * q + o];
        let straight = 0.5 * (at(i) + at(i + 1));
        let cubic = |i: usize| straight + (at(i) + at(i + 1) - at(i - 1) - at(i + 2)) / 16.0;
        Some(i).filter(|i| (1..n - 2).contains(i)).map(cubic).filter(|v| v.is_finite()).unwrap_or(straight)
    };
    let cells = |width: usize| (0..n - 1).flat_map(move |i| (0..width).map(move |k| (i, k)));
    Run {
        time: run.time.windows(2).map(|pair| 0.5 * (pair[0] + pair[1])).collect(),
        inputs: cells(m).map(input).collect(),
        measured: cells(q).map(record).collect(),
        ..run.clone()
    }
}

/// For each interval whether it is as long as most are.
fn usual_intervals(run: &Run) -> Vec<bool> {
    let each: Vec<f64> = run.time.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let mut sorted = each.clone();
    sorted.sort_by(f64::total_cmp);
    let middle = sorted[sorted.len() / 2];
    each.iter().map(|dt| (dt - middle).abs() <= JITTER * middle).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use fdm_system::model::Model;

    /// Areas under straight lines between changed samples are those under the curve.
    #[test]
    fn straight_lines_have_the_area_of_what_is_bent() {
        let text = "model m { input u; state x; param a = 1; der(x) = a*x*x*u - x; output x_m = x; }";
        let model = Model::from_text("m.fdm", text).expect("a model");
        let carried = model.definition().carried().expect("carried").model;
        let (dt, n) = (0.1, 200);
        let x = |t: f64| 2.0 + (1.1 * t).sin();
        // up and down with kinks at samples
        let u = |t: f64| (3.0 - (t - 8.0).abs()).max(0.0);
        let time: Vec<f64> = (0..n).map(|k| k as f64 * dt).collect();
        let run = Run {
            name: "r".into(),
            inputs: time.iter().map(|t| u(*t)).collect(),
            measured: time.iter().map(|t| x(*t)).collect(),
            time,
            held: vec![false],
            input_gaps: vec![0],
            stated: Vec::new(),
            output_gaps: vec![0],
        };
        let run = run.with_measured(&carried).expect("complete");
        let m = carried.inputs.len();
        let changed = with_areas(&run, &carried).expect("something is bent");
        let exact = |from: usize, to: usize| -> f64 {
            let fine = 4000;
            let h = (to - from) as f64 * dt / fine as f64;
            (0..fine).map(|k| from as f64 * dt + (k as f64 + 0.5) * h).map(|t| h * x(t).powi(2) * u(t)).sum()
        };
        let straight = |run: &Run, from: usize, to: usize| -> f64 {
            let at = |k: usize| run.inputs[k * m + m - 1];
            (from..to).map(|k| 0.5 * dt * (at(k) + at(k + 1))).sum()
        };
        let [before, after] = [&run, &changed].map(|run| (straight(run, 20, 130) - exact(20, 130)).abs());
        assert!(before > 3e-4 && after < 0.03 * before, "{before:e} {after:e}");
    }
}
