//! Linear elements that repeat the motion that a model has anyway.
//!
//! In a free motion every signal has the motion's own frequency. A second oscillator there is no other degree of freedom: it bends the
//! envelope and the phase of the first one, as damping and stiffness that change with the amplitude do. A lag changes amplitude and phase, as
//! initial values do; of a single output nothing tells them apart, but for a transient that is as short as the lag.

use super::candidate_model::CandidateModel;
use super::forward_step::ForwardStep;
use fdm_grammar::model::Origin;
use fdm_grammar::syntax::Class;
use fdm_system::linear::{LinearModel, Modes, Values};
use fdm_system::model::Model;
use fdm_system::record::Run;
use std::f64::consts::TAU;

/// Ratio of frequencies below which two oscillations are one.
const NEAR: f64 = 1.5;

/// What an extended model says once more of a free motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Repeated {
    /// An oscillation near one of the model's own, by its frequency.
    Mode(f64),
    /// No oscillation, or one that has died out within a period of the model's own: a lag.
    Lag,
}

impl Repeated {
    /// Why such an effect is not accepted.
    pub(super) fn sentence(self) -> String {
        match self {
            Self::Mode(frequency) => format!(
                "its mode ({frequency:.3} rad per unit of time) is the model's own motion once more, and nothing else drives it: it stands \
                 for damping or stiffness that changes with the amplitude"
            ),
            Self::Lag => "nothing drives the oscillation, so that a lag is no more than another beginning of it: it stands for damping or \
                          stiffness that changes with the amplitude"
                .into(),
        }
    }
}

/// A model and its values.
type AtValues<'m> = (&'m Model, &'m [f64]);

/// What a candidate model adds to a motion that nothing but itself drives; none where that can be told from it, or where the models cannot be
/// linearised.
pub(super) fn repeated(step: &ForwardStep<'_>, candidate: &CandidateModel) -> Option<Repeated> {
    let (current, extended) = (&step.current, &candidate.model);
    let own = (&current.model, current.theta.first()?.as_slice());
    let grown = (extended, candidate.fitting.theta.first()?.as_slice());
    let added = added(step.runs.train(), own, grown)?;
    let lag = candidate.class != Class::Mechanism && added.may_be_lag;
    added.repeated.or((lag && added.left.is_empty()).then_some(Repeated::Lag)).filter(|r| lag || *r != Repeated::Lag)
}

/// What a model with several effects in the end, some of them stand-ins, says once more of the free motion.
pub(super) fn repeated_in_the_end(runs: &[Run], own: AtValues<'_>, extended: AtValues<'_>) -> Option<Repeated> {
    let added = added(runs, own, extended)?;
    added.repeated.filter(|r| added.may_be_lag || *r != Repeated::Lag)
}

/// What an extended model has beside the oscillations of another.
struct Added {
    /// Its other oscillations.
    left: Vec<Oscillation>,
    repeated: Option<Repeated>,
    /// Whether there is an oscillation of which a single output and free initial values tell all that a lag would change.
    may_be_lag: bool,
}

fn added(runs: &[Run], (model, start): AtValues<'_>, (extended, theta): AtValues<'_>) -> Option<Added> {
    if extended.layout().states <= model.layout().states || runs.iter().any(is_driven) {
        return None;
    }
    let (own, mut left) = (oscillations(model, start)?, oscillations(extended, theta)?);
    for Oscillation { frequency, .. } in &own {
        // each of the model's own oscillations is the nearest of the extended model's
        let distance = |o: &Oscillation| (o.frequency / frequency).ln().abs();
        let nearest = (0..left.len()).min_by(|a, b| distance(&left[*a]).total_cmp(&distance(&left[*b])));
        nearest.map(|k| left.swap_remove(k));
    }
    let near = |o: &&Oscillation| own.iter().any(|own| (o.frequency / own.frequency).ln().abs() < NEAR.ln());
    let slowest = own.iter().map(|o| o.frequency).fold(f64::INFINITY, f64::min);
    let mode = left.iter().find(near).map(|o| Repeated::Mode(o.frequency));
    let short = left.iter().any(|o| o.decay * TAU / slowest > 1.0).then_some(Repeated::Lag);
    let may_be_lag = !own.is_empty() && model.layout().outputs == 1 && begins(model) >= 2 * own.len();
    Some(Added { left, repeated: mode.or(short), may_be_lag })
}

/// How many initial values are estimated.
fn begins(model: &Model) -> usize {
    model.definition().params.iter().filter(|p| !p.fixed && matches!(p.origin, Origin::FreeInitial(_))).count()
}

/// Whether an input moves.
fn is_driven(run: &Run) -> bool {
    let m = run.held.len();
    run.inputs.chunks_exact(m.max(1)).any(|row| row != &run.inputs[..m])
}

/// An oscillation at the trim.
struct Oscillation {
    /// In rad per unit of time.
    frequency: f64,
    /// Its logarithm falls by so much in a unit of time.
    decay: f64,
}

/// The oscillations at the trim, with the values of a fit.
fn oscillations(model: &Model, theta: &[f64]) -> Option<Vec<Oscillation>> {
    let mut params = model.definition().params.clone();
    // what belongs to a run is where it began, not the trim
    params.iter_mut().zip(theta).filter(|(p, _)| !p.per_run).for_each(|(p, value)| p.value = *value);
    let model = model.with_params(params);
    let mut linear = LinearModel::new(&model).ok()?;
    let mut values = Values::default();
    linear.evaluate(&model.definition().start(), &mut values).ok()?;
    let modes = Modes::new(linear.structure(), &values).ok()?;
    let upper = modes.modes.iter().filter(|m| m.s.im > 0.0);
    Some(upper.map(|m| Oscillation { frequency: m.s.im, decay: -m.s.re }).collect())
}
