//! Effects that are the truth in another name, or nearly: each of the catalogue is fitted to what the truth does without noise.

use crate::hidden::{INSIDE, Place, Structure};
use crate::oracle::{Oracle, Projection, dot, free};
use crate::scales::Known;
use fdm::Model;
use fdm::effect::{Candidate, Choice, Extension, Kind, Subject};
use fdm::record::Run;

/// What a rival may lack, in nats over all manoeuvres, and be the same model in another name.
pub(crate) const SAME: f64 = 0.05;
/// What is written down.
pub(crate) const NEAR: f64 = 6.0;
/// Share of the truth's effect that a rival's direction must explain for being fitted at all.
const ALIKE: f64 = 0.5;
/// Rivals that are fitted, the most alike, each from its two best points.
const FITTED: usize = 16;
/// Points of a grid that are looked at.
const POINTS: usize = 24;

/// Rivals of a single effect, and what they lack of explaining the noise-free records, best first.
pub(crate) fn rivals(
    base: &Model,
    known: &Known,
    oracle: &Oracle<'_>,
    truth: &Structure,
    clean: &[Run],
    start: &[f64],
) -> Vec<(Place, f64)> {
    if truth.places.len() != 1 || cfg!(debug_assertions) {
        // in a debug build a case would take minutes
        return Vec::new();
    }
    let Some(fitted) = oracle.fit(base, clean, start) else { return Vec::new() };
    let columns = free(base);
    let Some((residual, jacobian)) = oracle.linearised(base, clean, &fitted.theta, &columns) else { return Vec::new() };
    let projection = Projection::new(&jacobian);
    let left = projection.apply(residual);
    let total = dot(&left, &left);
    let subject = Subject::new(base.source(), base.definition()).expect("a text that compiles");
    let places = INSIDE.places(&subject).candidates;
    let others = places.iter().filter(|c| c.kind() != Kind::Variance && Place::of(c) != truth.places[0]);
    let look = Look { base, oracle, clean, theta: &fitted.theta, projection: &projection, left: &left, total };
    let mut alike: Vec<Alike> = others.filter_map(|c| look.alike(c, known, &subject)).collect();
    alike.sort_by(|a, b| b.share.total_cmp(&a.share));
    alike.truncate(FITTED);
    let nearest = |a: Alike| {
        let fits = a.starts.iter().filter_map(|start| oracle.fit(&a.model, clean, start));
        (fits.map(|f| 0.5 * f.cost).fold(f64::INFINITY, f64::min), a.place)
    };
    let mut found: Vec<(Place, f64)> =
        alike.into_iter().map(nearest).filter(|(l, _)| *l < NEAR).map(|(l, p)| (p, l)).collect();
    found.sort_by(|a, b| a.1.total_cmp(&b.1));
    found
}

struct Look<'a> {
    base: &'a Model,
    oracle: &'a Oracle<'a>,
    clean: &'a [Run],
    theta: &'a [f64],
    projection: &'a Projection,
    /// What the base model leaves, beside its own parameters, and its square.
    left: &'a [f64],
    total: f64,
}

/// An effect that could be taken for the truth.
struct Alike {
    place: Place,
    model: Model,
    /// The largest share of the truth's effect that one of its points explains.
    share: f64,
    /// Its parameters at the best points.
    starts: Vec<Vec<f64>>,
}

impl Look<'_> {
    /// A candidate at its best points; nothing where its direction is quite another.
    fn alike(&self, candidate: &Candidate, known: &Known, subject: &Subject) -> Option<Alike> {
        let extension = candidate.apply(subject, known, &Choice::new()).ok()?;
        let model = Model::compiled(extension.source().clone(), extension.compile()).ok()?;
        let mut found: Vec<(f64, Vec<f64>)> = Vec::new();
        for point in points(&extension) {
            let mut theta = model.definition().start();
            theta[..self.theta.len()].copy_from_slice(self.theta);
            for (name, value) in &point {
                theta[model.definition().param(name)?] = *value;
            }
            found.extend(self.share(&model, &extension, theta));
        }
        found.sort_by(|a, b| b.0.total_cmp(&a.0));
        let share = found.first()?.0;
        let starts = found.into_iter().take(2).map(|(_, theta)| theta).collect();
        (share >= ALIKE).then(|| Alike { place: Place::of(candidate), model, share, starts })
    }

    /// The share of what is left that the effect explains at these values, and the values at which it does.
    fn share(&self, model: &Model, extension: &Extension, mut theta: Vec<f64>) -> Option<(f64, Vec<f64>)> {
        let sizes: Vec<&fdm::effect::NewParam> =
            extension.params().iter().filter(|p| !p.nuisance && p.begins_as.is_none()).collect();
        let smooth = sizes.iter().all(|p| p.trials.is_empty() && p.null == 0.0);
        if smooth {
            let columns: Vec<usize> = sizes.iter().filter_map(|p| model.definition().param(&p.name)).collect();
            columns.iter().for_each(|k| theta[*k] = 0.0);
            let (_, directions) = self.oracle.linearised(model, self.clean, &theta, &columns)?;
            let (mut left, before) = (self.left.to_vec(), self.total);
            for (k, direction) in columns.iter().zip(directions) {
                let direction = self.projection.apply(direction);
                let power = dot(&direction, &direction);
                if power > 0.0 {
                    let amount = dot(&direction, &left) / power;
                    left.iter_mut().zip(&direction).for_each(|(l, d)| *l -= amount * d);
                    let p = &model.definition().params[*k];
                    theta[*k] = amount.clamp(p.lower, p.upper);
                }
            }
            return Some((1.0 - dot(&left, &left) / before, theta));
        }
        let residual = self.oracle.residual(model, self.clean, &theta)?;
        let base = self.oracle.residual(self.base, self.clean, self.theta)?;
        let step: Vec<f64> = base.iter().zip(&residual).map(|(a, b)| a - b).collect();
        let direction = self.projection.apply(step);
        let power = dot(&direction, &direction);
        (power > 0.0).then(|| (dot(&direction, self.left).powi(2) / (power * self.total), theta))
    }
}

/// Combinations of trial values by name.
fn points(extension: &Extension) -> Vec<Vec<(String, f64)>> {
    let mut points: Vec<Vec<(String, f64)>> = vec![Vec::new()];
    for p in extension.params().iter().filter(|p| !p.trials.is_empty()) {
        let with = |point: &Vec<(String, f64)>| {
            let one = |v: &f64| point.iter().cloned().chain([(p.name.clone(), *v)]).collect();
            p.trials.iter().map(one).collect::<Vec<Vec<_>>>()
        };
        points = points.iter().flat_map(with).collect();
    }
    points.truncate(POINTS);
    points
}
