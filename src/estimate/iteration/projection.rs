//! Variable projection: unknowns in which the response is affine are set to their best values for every trial of the
//! others, and damping acts on the others alone (variable projection: Golub and Pereyra 1973, in the form of Ruhe and
//! Wedin 1980). What is left to iterate has fewer unknowns and a valley less curved.

use super::correction::Correction;
use super::quadratic::Quadratic;
use super::step::{Room, constrained, constrained_among};
use super::trial::Accepted;

/// One affine unknown in so many is worth an evaluation more for every trial.
const ENOUGH: usize = 4;
/// Damping that only keeps a singular block from failing.
const HARDLY: f64 = 1e-12;

/// The problem that is left when affine unknowns follow the others.
#[derive(Debug, Clone)]
pub(in crate::estimate) struct Projected {
    quadratic: Quadratic,
    room: Room,
}

impl Correction<'_, '_, '_> {
    /// Whether enough unknowns are affine to make the others' problem an easier one, but not all.
    pub(in crate::estimate) fn can_project(&self) -> bool {
        let (affine, all) = (self.unknowns.affine.len(), self.values.len());
        !self.attempts.unprojected && affine * ENOUGH >= all && affine < all
    }

    /// Begins to project: affine unknowns go to their best values here, which is a correction by itself when it gains
    /// anything.
    pub(in crate::estimate) fn begin_projection(&mut self, refused: usize) -> Option<Accepted> {
        self.refine();
        self.projecting = self.quadratic.is_precise();
        if !self.projecting {
            return None;
        }
        self.note_projection();
        self.step.fill(0.0);
        self.follow();
        if !self.set_trial() {
            return None;
        }
        let step = self.largest_in_errors();
        self.attempt(false, false)?;
        Some(Accepted { step, damping: self.level, refused, part: 1.0 })
    }

    /// Solves for the affine unknowns while the others keep their part of the step.
    fn follow(&mut self) {
        if !constrained_among(&self.quadratic, &self.room, &self.unknowns.affine, HARDLY, &mut self.step) {
            self.unknowns.affine.iter().for_each(|j| self.step[*j] = 0.0);
        }
    }

    /// The damped and bent step of the others, with the affine unknowns following it. Gives the bend relative to the
    /// step, infinite when there is no step.
    pub(in crate::estimate) fn projected_step(&mut self, bent: bool) -> f64 {
        let projected = self.projected.take().unwrap_or_else(|| self.project());
        let mut step = Vec::new();
        let mut bend = f64::INFINITY;
        if constrained(&projected.quadratic, &projected.room, self.damping, &mut step) {
            self.lift(&projected, &step);
            bend = if bent { self.bend_projected(&projected, &mut step) } else { 0.0 };
            self.lift(&projected, &step);
        }
        self.projected = Some(projected);
        bend
    }

    fn project(&self) -> Projected {
        let quadratic = self.quadratic.without(&self.unknowns.affine);
        let (lower, upper) = (&self.unknowns.lower, &self.unknowns.upper);
        let room = Room::at(&self.values, lower, upper, &quadratic.scale);
        Projected { quadratic, room }
    }

    /// The step of all unknowns that belongs to a step of the others.
    fn lift(&mut self, projected: &Projected, step: &[f64]) {
        let scales = self.quadratic.scale.iter().zip(&projected.quadratic.scale);
        self.step =
            step.iter().zip(scales).map(|(s, (all, own))| if *own > 0.0 { s * all / own } else { 0.0 }).collect();
        self.follow();
    }

    /// As [`Correction::bend`], seen by the others alone.
    fn bend_projected(&mut self, projected: &Projected, step: &mut [f64]) -> f64 {
        let Some(slope) = self.slope_of_bend() else { return f64::INFINITY };
        let affine = &self.unknowns.affine;
        let Some(taken) = self.quadratic.apply_inverse(affine, HARDLY, &slope) else { return f64::INFINITY };
        let explained = self.quadratic.times_scaled(&taken);
        let scales = self.quadratic.scale.iter().zip(&projected.quadratic.scale);
        let rest = slope.iter().zip(&explained).zip(scales);
        let rest: Vec<f64> =
            rest.map(|((s, e), (all, own))| if *own > 0.0 { (s - e) * all / own } else { 0.0 }).collect();
        projected.room.bend(&projected.quadratic, self.damping, &rest, step)
    }

    /// Moves the affine unknowns of a trial to their best values there; false when the trial cannot be evaluated.
    pub(in crate::estimate) fn follow_in_trial(&mut self, trial: &mut [f64]) -> bool {
        let Ok(weights) = self.linearise(trial, None) else { return false };
        let mut there = Quadratic::default();
        let factors = self.likelihood.factors(&weights);
        there.gather(self.unknowns, self.evaluator.sums(), &factors, self.priors.rows(trial));
        if !there.is_finite() || !weights.cost.is_finite() {
            return false;
        }
        let room = Room::at(trial, &self.unknowns.lower, &self.unknowns.upper, &there.scale);
        let mut step = vec![0.0; trial.len()];
        if constrained_among(&there, &room, &self.unknowns.affine, 0.0, &mut step) {
            for (j, s) in step.iter().enumerate().filter(|(_, s)| **s != 0.0) {
                trial[j] = (trial[j] + s / there.scale[j]).max(self.unknowns.lower[j]).min(self.unknowns.upper[j]);
            }
        }
        true
    }
}
