//! Modes that repeat the motion that a model has anyway.
//!
//! In a free motion every signal has the motion's own frequency. A second oscillator there is no other degree of freedom: it
//! bends the envelope and the phase of the first one, as damping and stiffness that change with the amplitude do.

use super::contender::Contender;
use super::round::Round;
use crate::linear::{LinearModel, Modes, Values};
use crate::model::Model;
use crate::record::Run;

/// Ratio of frequencies below which two oscillations are one.
const NEAR: f64 = 1.5;

/// The frequency of an oscillation that a contender adds beside one of the model's own, where nothing but the motion itself
/// drives it; none where there is none, or where the models cannot be linearised.
pub(super) fn repeated(round: &Round<'_>, contender: &Contender) -> Option<f64> {
    let grows = contender.model.layout().states > round.stage.model.layout().states;
    if !grows || round.runs.train().iter().any(is_driven) {
        return None;
    }
    let own = frequencies(&round.stage.model, round.stage.theta.first()?)?;
    let mut others = frequencies(&contender.model, contender.fitting.theta.first()?)?;
    for frequency in &own {
        // each of the model's own oscillations is the nearest of the extended model's
        let distance = |f: &f64| (f / frequency).ln().abs();
        let nearest = (0..others.len()).min_by(|a, b| distance(&others[*a]).total_cmp(&distance(&others[*b])))?;
        others.swap_remove(nearest);
    }
    let near = |f: &f64| own.iter().any(|o| (f / o).ln().abs() < NEAR.ln());
    others.into_iter().find(near)
}

/// Whether an input moves.
fn is_driven(run: &Run) -> bool {
    let m = run.held.len();
    run.inputs.chunks_exact(m.max(1)).any(|row| row != &run.inputs[..m])
}

/// Frequencies of the oscillations at the trim, in rad per unit of time, with the values of a fit.
fn frequencies(model: &Model, theta: &[f64]) -> Option<Vec<f64>> {
    let mut params = model.definition().params.clone();
    // what belongs to a run is where it began, not the trim
    params.iter_mut().zip(theta).filter(|(p, _)| !p.per_run).for_each(|(p, value)| p.value = *value);
    let model = model.with_params(params);
    let mut linear = LinearModel::new(&model).ok()?;
    let mut values = Values::default();
    linear.evaluate(&model.definition().start(), &mut values).ok()?;
    let modes = Modes::new(linear.structure(), &values).ok()?;
    Some(modes.modes.iter().map(|m| m.s.im).filter(|w| *w > 0.0).collect())
}
