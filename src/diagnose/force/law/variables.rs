//! States and inputs of all runs, brought to one size.

use super::super::driven::Driven;
use super::super::place::{ForceError, Passage};
use crate::model::Model;

/// A state or an input.
pub(super) struct Variable {
    /// Runs by samples: from its middle, the largest distance 1.
    pub(super) centred: Vec<Vec<f64>>,
    /// From its zero where it has both signs, otherwise from its middle; the largest distance 1.
    pub(super) signed: Vec<Vec<f64>>,
    /// Whether it is a state.
    pub(super) state: bool,
}

impl Variable {
    /// None where it does not change.
    fn new(runs: Vec<Vec<f64>>, state: bool) -> Option<Self> {
        let all = || runs.iter().flatten().copied();
        let (low, high) = all().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
        let mean = all().sum::<f64>() / all().count().max(1) as f64;
        let scaled = |from: f64| -> Vec<Vec<f64>> {
            let size = (high - from).max(from - low);
            runs.iter().map(|run| run.iter().map(|v| (v - from) / size).collect()).collect()
        };
        let changes = high - low > 1e-9 * high.abs().max(low.abs());
        if !changes || !low.is_finite() || !high.is_finite() {
            return None;
        }
        let zero = if low < 0.0 && high > 0.0 { 0.0 } else { mean };
        Some(Self { centred: scaled(mean), signed: scaled(zero), state })
    }
}

/// All states and declared inputs that change.
pub(super) fn variables(model: &Model, driven: &Driven, passages: &[Passage<'_>]) -> Result<Vec<Variable>, ForceError> {
    let definition = model.definition();
    let (n, m) = (definition.states.len(), definition.inputs.len());
    let declared = definition.inputs.iter().take_while(|i| i.is_declared()).count();
    let mut courses = vec![Vec::with_capacity(passages.len()); n + declared];
    for (run, passage) in passages.iter().enumerate() {
        let states = driven.states(run, *passage)?;
        for (k, course) in courses.iter_mut().enumerate() {
            course.push(match k < n {
                true => states.iter().skip(k).step_by(n).copied().collect::<Vec<f64>>(),
                false => passage.run.inputs.iter().skip(k - n).step_by(m).copied().collect(),
            });
        }
    }
    let each = courses.into_iter().enumerate();
    Ok(each.filter_map(|(k, runs)| Variable::new(runs, k < n)).collect())
}
