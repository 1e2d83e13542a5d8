//! Chooses method and steps of a run: the least work that brings the integration error below 1e-8 of every output's range.
//!
//! The error of a response is what halving its steps says (`step_control.rs`). Explicit steps are doubled until it stands still.
//! When that takes more of them than an implicit step is worth, the model may be stiff, or quick in one place only: then both methods
//! are tried with steps as long as accuracy allows (`step_control.rs`), and the cheaper one is taken. Work is counted in operations, not in
//! seconds, so that the choice is always the same.

use super::discrete::{self, Intervals};
use super::error::{MOST_IMPLICIT, Unsuited};
use super::simulator::Simulator;
use super::step_control::{self, Probe, Scales};
use super::step_control::{SOUND, TOLERANCE, UNSOUND, difference, integration_error, remaining, response};
use super::steps::{Grid, Scheme, Steps};
use crate::dynamics::{Dynamics, Layout};
use crate::record::Run;
use fdm_grammar::graph::Signal;
use fdm_numeric::halt::Halt;
use fdm_numeric::lanes::VECTOR;

/// Steps per run beyond which halving stops: what remains is said, not hidden.
const MOST_STEPS: usize = 4_000_000;
const MOST_PER_INTERVAL: usize = 1024;
/// Local tolerance with which the sizes of states and outputs are found.
const ROUGH: f64 = 1e-4;
/// Ratio of the longest to the shortest interval from which derivatives by equal steps are asked as well (those by uneven ones always
/// are), and the part of their largest by which halved steps may move them.
const GRADED: f64 = 1000.0;
const ROUGH_SENSITIVITY: f64 = 1e-3;
/// Smallest local tolerance.
const FINEST: f64 = 1e-13;

/// How steps are chosen ([`choose_steps`]).
#[derive(Clone, Copy)]
pub struct StepOptions<'a> {
    /// The method, where it is the user's choice.
    pub scheme: Option<Scheme>,
    /// The integration error that is of no consequence, as a part of each output's range; 1e-8.
    pub accuracy: f64,
    /// Whether one response is looked at, not fitted: an error of 1e-6 of each output's range is good enough then where less is dear.
    pub once: bool,
    /// Asked before every step that is tried. Once it has ended, the answer is what was found by then, or one step per interval, and
    /// says nothing of the model.
    pub halt: Option<&'a Halt>,
}

impl Default for StepOptions<'_> {
    fn default() -> Self {
        Self { scheme: None, accuracy: TOLERANCE, once: false, halt: None }
    }
}

impl StepOptions<'_> {
    /// With the user's accuracy, where there is one.
    #[must_use]
    pub fn to(self, accuracy: Option<f64>) -> Self {
        Self { accuracy: accuracy.unwrap_or(self.accuracy), ..self }
    }

    fn aim(&self) -> Aim {
        let tolerance = self.accuracy.max(FINEST);
        Aim { tolerance, enough: if self.once { SOUND.max(tolerance) } else { tolerance } }
    }
}

/// Method and steps with which halving them moves no output by more than the accuracy that is asked for, or the best that was found.
/// A response between few samples looks wrong, and alike, until its steps resolve what happens between them: where it is still wrong by
/// more than [`UNSOUND`], and steps of other lengths cannot help (events, delayed states) or it is looked at only, steps are halved as far
/// as memory allows.
///
/// # Errors
/// [`Unsuited`] as for [`super::Simulator::new`]. A response that diverges with every step is not an error here: the answer has an
/// infinite error and one step per interval.
pub fn choose_steps(
    dynamics: &dyn Dynamics,
    run: &Run,
    theta: &[f64],
    options: &StepOptions<'_>,
) -> Result<Accuracy, Unsuited> {
    let (layout, scheme) = (dynamics.layout(), options.scheme);
    if layout.states == 0 || run.len() < 2 {
        return Ok(Accuracy { steps: 1.into(), error: 0.0 });
    }
    let (work, aim, halt) = (Work::of(layout), options.aim(), options.halt);
    let choice = Choice { dynamics, run, theta, work, aim, halt };
    let found = choice.by(scheme)?;
    let unsound = UNSOUND.max(aim.enough);
    let settled = !found.error.is_finite() || found.error <= unsound || scheme == Some(Scheme::Radau);
    if settled || choice.may_be_uneven() && !options.once {
        return Ok(found);
    }
    let finest = choice.equal(Scheme::RungeKutta, usize::MAX, true)?;
    Ok(if finest.error <= unsound { finest } else { found })
}

struct Choice<'a> {
    dynamics: &'a dyn Dynamics,
    run: &'a Run,
    theta: &'a [f64],
    work: Work,
    aim: Aim,
    /// When there is no time for more.
    halt: Option<&'a Halt>,
}

/// Integration errors that are aimed at, as parts of an output's range.
#[derive(Debug, Clone, Copy)]
struct Aim {
    /// Of no consequence: steps are not made shorter for less.
    tolerance: f64,
    /// Good enough where the first few halvings do not reach that.
    enough: f64,
}

/// Work of a step that is cut at kinks where there are some, in whole steps: beside the rates at its four stages those at both ends, and the
/// switching functions at five places.
const WORK_OF_CUTTING: usize = 2;

/// Halvings in a row that do not help, after which steps are not halved again: once is no rule, as a delayed kink that shares a
/// step with a sample leaves it when the step is halved again.
const STALLS: usize = 2;

impl Choice<'_> {
    /// By a method, or the cheapest one.
    fn by(&self, scheme: Option<Scheme>) -> Result<Accuracy, Unsuited> {
        match scheme {
            Some(Scheme::Radau) => {
                let least = Accuracy { steps: Steps::equal(Scheme::Radau, 1), error: f64::INFINITY };
                // asks whether the method suits the model at all
                drop(Simulator::new(self.dynamics, self.run, least.steps.clone())?);
                Ok(self.uneven(Scheme::Radau, self.most_uneven())?.unwrap_or(least))
            }
            Some(Scheme::RungeKutta) => {
                let explicit = self.explicit(MOST_STEPS)?;
                Ok(self.steadied(&explicit)?.unwrap_or(explicit))
            }
            None | Some(Scheme::ExactDiscretisation { .. }) => match self.linear() {
                Some(exact) if discrete::suits(self.dynamics.layout()) || scheme.is_some() => self.exact(exact),
                Some(exact) => {
                    let worth = discrete::work(self.dynamics.layout(), self.run.len()) / self.work.runge_kutta;
                    let most = (worth as usize).clamp(1, MOST_PER_INTERVAL);
                    let explicit = self.equal(Scheme::RungeKutta, most, false)?;
                    if explicit.error <= self.aim.tolerance { Ok(explicit) } else { self.exact(exact) }
                }
                None => self.cheapest(),
            },
        }
    }

    /// The exact recursion, where a model is linear and its samples stand in few different intervals.
    fn linear(&self) -> Option<Scheme> {
        let layout = self.dynamics.layout();
        let suited = discrete::possible(layout) && Intervals::of(&Grid::new(&self.run.time, &1.into())).is_some();
        suited.then(|| Scheme::ExactDiscretisation { subsystems: discrete::subsystems(layout) })
    }

    /// Steps of exact discretisation: only delayed inputs ask for more than one in an interval.
    fn exact(&self, scheme: Scheme) -> Result<Accuracy, Unsuited> {
        if self.dynamics.layout().delayed.is_empty() {
            return Ok(Accuracy { steps: Steps::equal(scheme, 1), error: 0.0 });
        }
        self.equal(scheme, MOST_PER_INTERVAL, false)
    }

    fn cheapest(&self) -> Result<Accuracy, Unsuited> {
        let samples = self.run.len();
        // implicit steps are at least one in every interval
        let enough = (self.work.radau / self.work.runge_kutta) as usize;
        let enough = enough.clamp(4, MOST_PER_INTERVAL);
        let equal = self.equal(Scheme::RungeKutta, enough, false)?;
        let good = equal.error <= self.aim.enough;
        let alone = !self.may_be_uneven() || self.dynamics.layout().states > MOST_IMPLICIT;
        if good && (alone || self.trusted(&equal.steps) || self.sensitivities_move(&equal.steps)? <= ROUGH_SENSITIVITY)
        {
            return Ok(equal);
        }
        if alone {
            let explicit = self.explicit(MOST_STEPS)?;
            return Ok(self.steadied(&explicit)?.unwrap_or(explicit));
        }
        let implicit = self.uneven(Scheme::Radau, self.most_uneven())?;
        let implicit = match implicit {
            Some(implicit) if implicit.error <= self.aim.enough => implicit,
            rough => return self.finest(rough),
        };
        let worth = implicit.steps.total(samples) as f64 * self.work.radau / self.work.runge_kutta;
        let explicit = self.explicit((worth as usize).min(MOST_STEPS))?;
        let fewer =
            |explicit: &Accuracy| explicit.error <= self.aim.enough && explicit.steps.total(samples) as f64 <= worth;
        if !fewer(&explicit) {
            let implicit = self.beside(implicit, &explicit)?;
            return if implicit.error <= self.aim.enough { Ok(implicit) } else { self.finest(Some(implicit)) };
        }
        if let Some(steady) = self.steadied(&explicit)? {
            return Ok(if fewer(&steady) { steady } else { implicit });
        }
        // what is rough by both methods is the model, not its stability
        let rough = self.sensitivities_move(&explicit.steps)? <= 2.0 * self.sensitivities_move(&implicit.steps)?;
        Ok(if rough { explicit } else { implicit })
    }

    /// The best explicit steps, or the implicit ones that were found where these are better.
    fn finest(&self, implicit: Option<Accuracy>) -> Result<Accuracy, Unsuited> {
        let explicit = self.explicit(MOST_STEPS)?;
        let explicit = self.steadied(&explicit)?.unwrap_or(explicit);
        Ok(implicit.filter(|implicit| implicit.error < explicit.error).unwrap_or(explicit))
    }

    /// Implicit steps with the error that explicit ones show as well. An implicit step across a jump of the rates, and its halves, may settle
    /// on one side of it and agree, far from the response; what two methods differ by, beyond what the other one may be wrong, is
    /// an error of the one.
    fn beside(&self, implicit: Accuracy, explicit: &Accuracy) -> Result<Accuracy, Unsuited> {
        if self.dynamics.layout().kinks == 0 || explicit.error > UNSOUND {
            return Ok(implicit);
        }
        let by = |steps: &Steps| response(self.dynamics, self.run, self.theta, steps);
        let (Ok(a), Ok(b)) = (by(&implicit.steps)?, by(&explicit.steps)?) else { return Ok(implicit) };
        let apart = difference(&a, &b, self.dynamics.layout().outputs);
        Ok(Accuracy { error: implicit.error.max(apart - explicit.error), ..implicit })
    }

    /// The best explicit steps that are not more than `most`.
    fn explicit(&self, most: usize) -> Result<Accuracy, Unsuited> {
        let most_equal = (most / self.run.len()).clamp(1, MOST_PER_INTERVAL);
        let equal = self.equal(Scheme::RungeKutta, most_equal, false)?;
        self.better_uneven(equal, most)
    }

    /// Explicit steps as long as accuracy allows, where they are fewer than the equal ones or reach what those do not.
    fn better_uneven(&self, equal: Accuracy, most: usize) -> Result<Accuracy, Unsuited> {
        let (samples, good) = (self.run.len(), equal.error <= self.aim.enough);
        if !self.may_be_uneven() || good && equal.steps.most() <= 2 {
            return Ok(equal);
        }
        let most = if good { equal.steps.total(samples).min(most) } else { most };
        let found = self.uneven(Scheme::RungeKutta, most.min(self.most_uneven()))?;
        let Some(uneven) = found else { return Ok(equal) };
        let better = if good {
            // as many steps of equal length are the simpler choice
            uneven.error <= self.aim.enough && 2 * uneven.steps.total(samples) <= equal.steps.total(samples)
        } else {
            uneven.error <= 0.7 * equal.error
        };
        Ok(if better { uneven } else { equal })
    }

    /// Explicit steps if derivatives by them stand, or else their halves if those do: steps at the edge of stability are well within it
    /// then.
    fn steadied(&self, explicit: &Accuracy) -> Result<Option<Accuracy>, Unsuited> {
        if self.trusted(&explicit.steps) || self.sensitivities_move(&explicit.steps)? <= ROUGH_SENSITIVITY {
            return Ok(Some(explicit.clone()));
        }
        let steps = explicit.steps.halved();
        if self.sensitivities_move(&steps)? > ROUGH_SENSITIVITY {
            return Ok(None);
        }
        let error = integration_error(self.dynamics, self.run, self.theta, steps.clone())?;
        Ok(Some(Accuracy { steps, error }))
    }

    /// Equal steps in all intervals, whole or cut at kinks: those that cost less, or reach more.
    fn equal(&self, scheme: Scheme, most: usize, unsound: bool) -> Result<Accuracy, Unsuited> {
        let (whole, layout) = (Steps::equal(scheme, 1), self.dynamics.layout());
        if scheme != Scheme::RungeKutta || layout.kinks == 0 {
            return self.doubled(&whole, most, unsound);
        }
        // whole steps are tried first as far as cut ones cannot cost less, and then as far as they do not cost more
        let cut = whole.clone().cut_at_kinks();
        let good = |found: &Accuracy| found.error <= self.aim.tolerance;
        let few = self.doubled(&whole, most.min(WORK_OF_CUTTING), unsound)?;
        if good(&few) || most <= WORK_OF_CUTTING {
            return Ok(few);
        }
        let cut = self.doubled(&cut, most / WORK_OF_CUTTING, unsound)?;
        let worth = if good(&cut) { WORK_OF_CUTTING * cut.steps.most() } else { most };
        let whole = self.doubled(&whole, worth, unsound)?;
        Ok(if good(&whole) || whole.error < cut.error { whole } else { cut })
    }

    /// Doubles the steps in all intervals until halving them moves nothing, or has not helped several times in a row: `unsound` responses
    /// do not count there where they are no reason to stop.
    fn doubled(&self, kind: &Steps, most: usize, unsound: bool) -> Result<Accuracy, Unsuited> {
        let scheme = kind.scheme();
        let at = |per: usize| response(self.dynamics, self.run, self.theta, &kind.with_equal(per));
        let mut coarse = at(1)?;
        let mut best = Accuracy { steps: kind.with_equal(1), error: f64::INFINITY };
        let (mut fine, mut stalls) = (2, 0);
        let (mut before, mut ratios) = (f64::INFINITY, [0.0; 2]);
        while fine / 2 <= most && fine * self.run.len() <= MOST_STEPS && self.halt.is_none_or(Halt::goes_on) {
            let next = at(fine)?;
            if let (Ok(a), Ok(b)) = (&coarse, &next) {
                let steps = kind.with_equal(fine / 2);
                let off = difference(a, b, self.dynamics.layout().outputs);
                ratios = [ratios[1], off / before];
                before = off;
                let error = remaining(scheme, off, &ratios);
                stalls = if error > 0.7 * best.error && (error <= UNSOUND || !unsound) { stalls + 1 } else { 0 };
                if error < best.error {
                    best = Accuracy { steps, error };
                }
                if error <= self.aim.tolerance || stalls == STALLS {
                    break;
                }
            } else {
                before = f64::INFINITY;
            }
            coarse = next;
            fine *= 2;
        }
        Ok(best)
    }

    /// Whether a good response vouches for the derivatives. It does not where it may stand still: a model at rest stays there whatever
    /// the step. Nor where steps were made for it: they lie at the edge of stability, where its decayed part hides a growth that any
    /// change of a parameter starts.
    fn trusted(&self, explicit: &Steps) -> bool {
        let intervals = || self.run.time.windows(2).map(|w| w[1] - w[0]);
        let (shortest, longest) = (intervals().fold(f64::INFINITY, f64::min), intervals().fold(0.0, f64::max));
        explicit.per_interval().is_some() && longest <= GRADED * shortest
    }

    /// By how much halving steps moves a derivative, as a part of the largest of its parameter; the largest over all samples, outputs
    /// and parameters. Infinite where there is none, or no time for it.
    fn sensitivities_move(&self, steps: &Steps) -> Result<f64, Unsuited> {
        let lanes = &self.dynamics.layout().stage.lane;
        let columns: Vec<usize> = (0..lanes.len()).filter(|param| lanes[*param].is_some()).collect();
        let rows = self.run.len() * self.dynamics.layout().outputs;
        // derivatives that are kept at once while they are compared
        let tile = ((1 << 24) / rows.max(1)).max(1).next_multiple_of(VECTOR);
        let mut worst = 0.0_f64;
        for columns in columns.chunks(tile) {
            if !self.halt.is_none_or(Halt::goes_on) {
                return Ok(f64::INFINITY);
            }
            let stride = columns.len().next_multiple_of(VECTOR);
            let at = |steps: Steps| -> Result<Option<Vec<f64>>, Unsuited> {
                let mut simulator = Simulator::new(self.dynamics, self.run, steps)?;
                let (mut y, mut jacobian) = (vec![0.0; rows], vec![0.0; rows * stride]);
                Ok(simulator.sensitivities(self.theta, columns, &mut y, &mut jacobian).is_ok().then_some(jacobian))
            };
            let (Some(coarse), Some(fine)) = (at(steps.clone())?, at(steps.halved())?) else {
                return Ok(f64::INFINITY);
            };
            for column in 0..columns.len() {
                let pairs = (column..fine.len()).step_by(stride).map(|at| (coarse[at], fine[at]));
                let largest = pairs.clone().fold(0.0, |largest: f64, (_, fine)| largest.max(fine.abs()));
                let off = pairs.fold(0.0, |off: f64, (coarse, fine)| {
                    // an infinite or undefined one is lost by any measure
                    if (coarse - fine).is_finite() { off.max((coarse - fine).abs()) } else { f64::INFINITY }
                });
                if off > 0.0 {
                    worst = worst.max(off / largest);
                }
            }
        }
        Ok(worst)
    }

    /// Steps as long as accuracy allows; none when there are no such steps, or more than `most`.
    fn uneven(&self, scheme: Scheme, most: usize) -> Result<Option<Accuracy>, Unsuited> {
        let layout = self.dynamics.layout();
        let at = |scheme| Probe::new(self.dynamics, self.run, self.theta, scheme).until(self.halt);
        let mut scales = Scales::new(layout.states, layout.outputs);
        if layout.states <= MOST_IMPLICIT {
            scales = step_control::measure(&mut at(Scheme::Radau), scales, self.most_uneven());
        }
        let mut probe = at(scheme);
        // sizes that are far too large let a state pass a point from which there is no way back; more explicit steps would be too many
        let finer: &[f64] = if scheme == Scheme::Radau { &[1.0, 1e-2, 1e-4] } else { &[1.0] };
        let tried = |finer: &f64| step_control::choose(&mut probe, scheme, ROUGH * finer, &scales, most);
        let Some((_, met)) = finer.iter().find_map(tried) else { return Ok(None) };
        scales = met;
        let (mut tolerance, mut best): (f64, Option<Accuracy>) = (self.aim.enough, None);
        // times that the local tolerance is lowered
        for _ in 0..6 {
            let Some((steps, met)) = step_control::choose(&mut probe, scheme, tolerance, &scales, most) else { break };
            scales = met;
            let error = integration_error(self.dynamics, self.run, self.theta, steps.clone())?;
            let before = best.as_ref().map_or(f64::INFINITY, |b| b.error);
            if error < before {
                best = Some(Accuracy { steps, error });
            }
            if error <= self.aim.enough || error > 0.7 * before || tolerance <= FINEST {
                break;
            }
            tolerance = (tolerance * (0.5 * self.aim.enough / error).clamp(1e-3, 0.3)).max(FINEST);
        }
        Ok(best)
    }

    fn most_uneven(&self) -> usize {
        // steps of different lengths beyond those of one per interval
        self.run.len() + 100_000
    }

    /// Delayed states want the grid that their history was made for, and events are beyond the probe.
    fn may_be_uneven(&self) -> bool {
        self.dynamics.layout().events.is_empty()
            && !self.dynamics.layout().delayed.iter().any(|s| matches!(s, Signal::State(_)))
    }
}

/// Operations of a step with its sensitivities, in those of an explicit step.
struct Work {
    runge_kutta: f64,
    radau: f64,
}

impl Work {
    fn of(layout: &Layout) -> Self {
        let (n, lanes) = (layout.states as f64, layout.stage.lanes as f64);
        let (f_x, f_theta) = (&layout.patterns.rates_by_state, &layout.patterns.rates_by_param);
        let (entries, band) =
            (f_x.len() as f64, 1.0 + f_x.entries().map(|(_, i, j)| i.abs_diff(j)).max().unwrap_or(0) as f64);
        let rates = 5.0 * (n + entries);
        let partials = rates + 5.0 * (entries + f_theta.len() as f64);
        let (size, band) = (3.0 * n, (3.0 * band).min(3.0 * n));
        // two factorisations, three solutions for the states and one for all parameters
        let factors = size * band * (band + 8.0);
        let solutions = 4.0 * size * band;
        Self {
            runge_kutta: 4.0 * (partials + 2.0 * (entries + 2.0 * n) * lanes),
            // an operation of an implicit step takes as long as this many of an explicit one, whose rows are longer
            // and known before; measured by `studies/stiff.rs` with 10 to 200 states
            radau: 6.0
                * (200.0
                    + 6.0 * partials
                    + 9.0 * rates
                    + 2.0 * factors
                    + 3.0 * solutions
                    + solutions * lanes
                    // times that an implicit step looks through its whole matrix
                    + 10.0 * size * size),
        }
    }
}

/// What was chosen for a run and what it is worth.
#[derive(Debug, Clone, PartialEq)]
pub struct Accuracy {
    /// How the run is integrated, and its steps.
    pub steps: Steps,
    /// Estimated integration error, as a part of each output's range, largest over outputs and samples; infinite when
    /// no step that was tried gave a finite response.
    pub error: f64,
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::model::Model;
    use crate::simulate::step_control::worst_errors;
    use fdm_numeric::halt::Stop;
    use std::sync::Arc;
    use std::sync::atomic::{AtomicUsize, Ordering};

    /// A pendulum driven by steps: what noise hides takes fewer steps, and they keep what was asked.
    #[test]
    fn a_larger_error_takes_fewer_steps_and_is_kept() {
        let text = "model pendulum { input u; state x = 0.4; state v; der(x) = v; der(v) = u - 9*sin(x) - 0.2*v; \
                    output angle = x; }";
        let model = Model::from_text("pendulum.fdm", text).unwrap();
        let time: Vec<f64> = (0..200).map(|k| 0.05 * f64::from(k)).collect();
        let inputs = time.iter().map(|t| if (t / 1.7).floor() % 2.0 < 1.0 { 2.0 } else { -1.0 }).collect();
        let run = Run {
            name: "a".into(),
            inputs,
            held: vec![false],
            measured: vec![0.0; time.len()],
            input_gaps: vec![0],
            stated: Vec::new(),
            output_gaps: vec![0],
            time,
        };
        let theta = model.definition().start();
        let exact = choose_steps(model.dynamics(), &run, &theta, &StepOptions::default()).unwrap();
        let rough = choose_steps(model.dynamics(), &run, &theta, &StepOptions::default().to(Some(1e-4))).unwrap();
        assert!(exact.error <= 1e-8 && rough.error <= 1e-4, "{exact:?} {rough:?}");
        assert!(2 * rough.steps.total(run.len()) <= exact.steps.total(run.len()), "{exact:?} {rough:?}");
    }

    /// What is at rest stays there whatever the step; its derivatives by parameters do not.
    #[test]
    fn sensitivities_at_rest_are_those_of_the_model() {
        let text = "model rest { param fixed_one = 1 fixed; param k = 0.15, l = 0.6; state a = 2; state b = 1; der(a) = l*b - k*a^2; der(b) = k*a^2 - l*b; output y = fixed_one*b; }";
        let model = Model::from_text("rest.fdm", text).unwrap();
        let time = vec![-1e5, -5e4, -1e3, 0.0, 0.5];
        let run = Run {
            name: "r".into(),
            measured: vec![1.0; time.len()],
            output_gaps: vec![0],
            time,
            inputs: Vec::new(),
            held: Vec::new(),
            input_gaps: Vec::new(),
            stated: Vec::new(),
        };
        let theta = model.definition().start();
        let chosen = choose_steps(model.dynamics(), &run, &theta, &StepOptions::default()).unwrap();
        assert_eq!(chosen.steps.scheme(), Scheme::Radau);
        let mut simulator = Simulator::new(model.dynamics(), &run, chosen.steps).unwrap();
        let (mut y, mut jacobian) = (vec![0.0; run.len()], vec![0.0; run.len() * 8]);
        simulator.sensitivities(&theta, &[1, 2], &mut y, &mut jacobian).unwrap();
        // k a^2 = l b with a + b = 3
        let (by_k, by_l) = (4.0 / 1.2, -1.0 / 1.2);
        let last = &jacobian[8 * (run.len() - 1)..];
        assert!((last[0] / by_k - 1.0).abs() < 1e-6 && (last[1] / by_l - 1.0).abs() < 1e-6, "{last:?}");
    }

    /// A quick state that has settled hides steps at the edge of their stability from the response; what moves it does not.
    #[test]
    fn steps_that_follow_a_response_keep_its_derivatives() {
        let text = "model quick { param a = 0.3, l = 60, z0 = 1; state x = 1; state z = z0; der(x) = -a*x*x; der(z) = l*(x - z); output y = z; }";
        let model = Model::from_text("quick.fdm", text).unwrap();
        let time: Vec<f64> = (0..12).map(|k| 5.0 * f64::from(k)).collect();
        let run = Run {
            name: "q".into(),
            measured: vec![0.0; time.len()],
            output_gaps: vec![0],
            time: time.clone(),
            inputs: Vec::new(),
            held: Vec::new(),
            input_gaps: Vec::new(),
            stated: Vec::new(),
        };
        let theta = model.definition().start();
        let dynamics = model.dynamics();
        let (work, aim) = (Work::of(dynamics.layout()), StepOptions::default().aim());
        let choice = Choice { dynamics, run: &run, theta: &theta, work, aim, halt: None };
        let followed = choice.explicit(MOST_STEPS).unwrap();
        let moved = choice.sensitivities_move(&followed.steps).unwrap();
        assert!(followed.error < 1e-8 && moved > ROUGH_SENSITIVITY, "{} {moved}", followed.error);
        for scheme in [None, Some(Scheme::RungeKutta)] {
            let chosen =
                choose_steps(dynamics, &run, &theta, &StepOptions { scheme, ..StepOptions::default() }).unwrap();
            let mut simulator = Simulator::new(dynamics, &run, chosen.steps).unwrap();
            let (mut y, mut jacobian) = (vec![0.0; run.len()], vec![0.0; run.len() * 8]);
            simulator.sensitivities(&theta, &[0, 1, 2], &mut y, &mut jacobian).unwrap();
            for (row, t) in jacobian.chunks(8).zip(&time).skip(1) {
                // z follows x = 1/(1 + a t) by 1/l
                let by_a = -t / (1.0 + 0.3 * t).powi(2);
                assert!(
                    (row[0] - by_a).abs() < 1e-2 && row[1].abs() < 1e-4 && row[2].abs() < 1e-3,
                    "{scheme:?} {t} {row:?}"
                );
            }
        }
    }

    /// Robertson's kinetics at times ever farther apart: with the sizes that steps of whole intervals show, the second state may become
    /// negative, and then runs away.
    #[test]
    fn a_state_that_would_run_away_is_followed() {
        let text = "model kinetics { param k = 0.05; state a = 1; state b = 0; state c = 0; der(a) = 1e4*b*c - k*a; \
                    der(b) = k*a - 1e4*b*c - 3e7*b*b; der(c) = 3e7*b*b; output y = a; output z = c; }";
        let model = Model::from_text("kinetics.fdm", text).unwrap();
        let time = vec![0.0, 0.04, 0.4, 4.0, 40.0, 400.0, 4e3, 4e4];
        let (measured, output_gaps) = (vec![0.0; 2 * time.len()], vec![0, 0]);
        let (name, inputs, held, input_gaps) = ("a".into(), Vec::new(), Vec::new(), Vec::new());
        let run = Run { name, inputs, held, measured, input_gaps, stated: Vec::new(), output_gaps, time };
        for k in [0.03, 0.04, 0.045, 0.05, 0.055, 0.06, 0.1] {
            let chosen = choose_steps(model.dynamics(), &run, &[k], &StepOptions::default()).unwrap();
            assert!(chosen.error < 1e-6 && chosen.steps.total(run.len()) < 500, "{k} {chosen:?}");
        }
    }

    /// Robertson's kinetics, whose steps are all chosen by trial: a search that is ended ends there, and leaves one step.
    #[test]
    fn a_choice_ends_when_it_is_told_to() {
        let text = "model kinetics { state a = 1; state b = 0; state c = 0; der(a) = 1e4*b*c - 0.04*a; \
                    der(b) = 0.04*a - 1e4*b*c - 3e7*b*b; der(c) = 3e7*b*b; output y = a; }";
        let model = Model::from_text("kinetics.fdm", text).unwrap();
        let time = vec![0.0, 1e2, 1e4];
        let (measured, output_gaps) = (vec![0.0; time.len()], vec![0]);
        let (name, inputs, held, input_gaps) = ("a".into(), Vec::new(), Vec::new(), Vec::new());
        let run = Run { name, inputs, held, measured, input_gaps, stated: Vec::new(), output_gaps, time };
        let theta = model.definition().start();
        let choose = |most: usize| {
            let asked = Arc::new(AtomicUsize::new(0));
            let count = Arc::clone(&asked);
            let halt = Halt::asking(move || (count.fetch_add(1, Ordering::Relaxed) >= most).then_some(Stop::TimeLimit));
            let options = StepOptions { halt: Some(&halt), ..StepOptions::default() };
            (choose_steps(model.dynamics(), &run, &theta, &options).unwrap(), asked.load(Ordering::Relaxed))
        };
        let (whole, all) = choose(usize::MAX);
        assert_eq!(whole, choose_steps(model.dynamics(), &run, &theta, &StepOptions::default()).unwrap());
        assert!(whole.error <= 1e-8 && all > 150, "{all} {whole:?}");
        for most in [0, 1, 20] {
            let (cut, asked) = choose(most);
            assert!(asked < most + 300 && cut.error > 1e-8, "{most}: {asked} {cut:?}");
        }
    }

    /// An oscillation of 5000 rad/s between samples of 0.1 s.
    #[test]
    fn an_oscillation_that_no_usual_step_resolves_is_resolved_where_one_response_is_looked_at() {
        let text =
            "model fast { input u; state x = 0.1; state v; der(x) = v; der(v) = -2.5e7*sin(x) - v + u; output y = x; }";
        let model = Model::from_text("fast.fdm", text).unwrap();
        let time: Vec<f64> = (0..3).map(|k| 0.1 * f64::from(k)).collect();
        let run = Run {
            name: "a".into(),
            inputs: vec![1.0; time.len()],
            held: vec![false],
            measured: vec![0.0; time.len()],
            input_gaps: vec![0],
            stated: Vec::new(),
            output_gaps: vec![0],
            time,
        };
        let theta = model.definition().start();
        let once = choose_steps(model.dynamics(), &run, &theta, &StepOptions { once: true, ..StepOptions::default() })
            .unwrap();
        assert!(once.error <= UNSOUND, "{once:?}");
        let mut y = vec![0.0; run.len()];
        Simulator::new(model.dynamics(), &run, once.steps).unwrap().simulate(&theta, &mut y).unwrap();
        assert!(y.iter().all(|y| y.abs() <= 1.0), "{y:?}");
        // where it is worst with steps that follow the swing, but not its phase
        let rough = Steps::from(1024);
        let worst = worst_errors(model.dynamics(), &run, &theta, &rough, UNSOUND).unwrap();
        assert!(worst[0].part > UNSOUND && worst[0].state.is_some() && worst[0].sample > 0, "{worst:?}");
        assert!(
            choose_steps(
                model.dynamics(),
                &run,
                &theta,
                &StepOptions { scheme: Some(Scheme::Radau), accuracy: 1e-2, ..StepOptions::default() }
            )
            .unwrap()
            .steps
            .scheme()
                == Scheme::Radau
        );
    }
}
