//! The chance that noise makes the best candidate look as good as it does, once the best have been fitted.
//!
//! Screening predicts a gain; what the joint fit gains on the training runs may be less. The statistic of a fitted candidate is
//! then the lesser of both. It is judged by the distribution that the predicted gain has under noise: what is never larger than another
//! statistic is large no more often. What the leader by these runs does on the validation ones is a second chance beside
//! it ([`validation_chance`]). So it is with the candidate without which the residual is likelier as noise of any smooth
//! spectrum (`unlikely` of [`Comparison`]), where predicted gains say nothing. A gain far beyond all that speaks for itself.
//!
//! What validation runs say of an effect by themselves, and what they and the first runs say together.
//!
//! Fitted to noise, an effect adds d to the base model's answer to a validation run, in bins of unit noise. Of what the base model leaves
//! there, r, it gains r'd - d'd/2. Noise gives r'd a mean of zero and the variance d'd; the error of the base model's parameters, of covariance C
//! from the first runs, adds d'J C J'd. As the run took no part in the fit, this chance is independent of the one that the first runs
//! give, and both are one by the sum of their normal deviates (Stouffer). Their product (Fisher) forgets a validation run that contradicts: a first
//! chance of 0.001 would stay below 0.01 whatever the run says, and first chances that small are known least well.

use super::candidate_model::CandidateModel;
use super::comparison::Comparison;
use super::fitted_model::records;
use super::forward_step::ForwardStep;
use super::predictor::responses;
use super::projection::{Projection, dot};
use fdm_numeric::statistics::{normal_quantile, normal_tail};

/// A score that noise gives to no candidate, whatever its nuisances: what is beyond it counts although nothing was predicted, as where a
/// model is so far off that a small step says little of a large one.
const SURE: f64 = 25.0;

/// The family-wise chance of the best candidate by what it gained in fact.
pub(super) fn confirmed(step: &ForwardStep<'_>, comparison: &Comparison) -> f64 {
    let candidates = &step.screening.candidates;
    let p = step.screening.family_wise;
    let Some(lead) = step.screening.ranking.first().map(|t| candidates[*t].lead) else { return p };
    let fitted = || comparison.models.iter().chain(&comparison.far);
    let of = |t: &usize| match fitted().find(|c| c.candidate == *t) {
        Some(c) => (candidates[*t].lead - 2.0 * (c.predicted - c.gain).max(0.0), Some(c)),
        None => (candidates[*t].lead, None),
    };
    let leads = step.screening.ranking.iter().map(of);
    let (left, leader) = leads.fold((f64::NEG_INFINITY, None), |best, own| if own.0 > best.0 { own } else { best });
    // beyond what noise gives once in a hundred times, chances fall like that of chi-square
    let first = weakened(p, 0.5 * (lead - left).max(0.0));
    let with_held = |leader: Option<&CandidateModel>, first: f64| {
        leader.and_then(|c| validation_chance(step, comparison, c)).map_or(first, |second| both(first, second))
    };
    let promised = with_held(leader, first);
    let as_noise = comparison
        .unlikely
        .and_then(|u| Some(with_held(Some(fitted().find(|c| c.candidate == u.candidate)?), u.chance)));
    let beyond = fitted().map(|c| c.score() - SURE).fold(f64::NEG_INFINITY, f64::max);
    promised.min(as_noise.unwrap_or(1.0)).min(candidates.len() as f64 * (-beyond).exp())
}

/// A chance among many, when each of them is so many times (by its logarithm) larger.
fn weakened(p: f64, nats: f64) -> f64 {
    -(nats.min(700.0).exp() * (-p.clamp(0.0, 1.0 - 1e-12)).ln_1p()).exp_m1()
}

/// Least square of an effect's answer in units of noise, below which validation runs say nothing of it.
const INFORMATIVE: f64 = 1.0;
/// Held-out runs are believed down to this chance, and up to one less it: their noise is known from other runs.
const LEAST: f64 = 0.001;

/// The chance that noise makes an effect match the validation runs as well as it does; none without such runs, or where they say nothing
/// of it.
pub(super) fn validation_chance(
    step: &ForwardStep<'_>,
    comparison: &Comparison,
    candidate: &CandidateModel,
) -> Option<f64> {
    let (validation, train) = (step.runs.validation(), step.runs.train);
    let (base, (_, extended)) = (comparison.base_validation.as_ref()?, candidate.validation.as_ref()?);
    let (current, noise) = (&step.current, comparison.noise.for_validation());
    let (predictors, q) = (&current.predictors[train..], current.outputs());
    let own = records(&current.model, validation, predictors, &base.theta).ok()?;
    let after = responses(&candidate.model, validation, &candidate.predictors[train..], &extended.theta)?;
    let projection = Projection::new(&step.records, step.runs.train(), &current.predictors, q, &comparison.noise);
    let mut along = vec![0.0; step.free.0.len()];
    let (mut product, mut square, mut left, mut count) = (0.0, 0.0, 0.0, 0);
    for (((run, predictor), record), after) in validation.iter().zip(predictors).zip(&own).zip(&after) {
        let mut whitener = predictor.whitener(run, q, noise);
        let residual = whitener.whitened(&record.residual);
        let rest = whitener.whitened(&predictor.left_by(run, after));
        let added: Vec<f64> = residual.iter().zip(&rest).map(|(before, after)| before - after).collect();
        product += dot(&residual, &added);
        square += dot(&added, &added);
        left += dot(&rest, &rest);
        count += rest.len();
        for (along, column) in along.iter_mut().zip(&record.fitted) {
            *along += column.as_ref().map_or(0.0, |column| dot(&whitener.whitened(column), &added));
        }
    }
    if !(square > INFORMATIVE && product.is_finite()) {
        return None;
    }
    // where even the effect leaves more than that noise, there is more of it
    let noise = (left / count.max(1) as f64).max(1.0);
    let z = product / (noise * (square + projection.variance(&along))).sqrt();
    Some(normal_tail(z).clamp(LEAST, 1.0 - LEAST))
}

/// Two independent chances as one.
pub(super) fn both(first: f64, second: f64) -> f64 {
    let deviate = |p: f64| -normal_quantile(p.clamp(f64::MIN_POSITIVE, 1.0));
    normal_tail((deviate(first) + deviate(second)) / std::f64::consts::SQRT_2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chances_grow_with_what_is_lost_and_stay_chances() {
        assert!((weakened(1e-6, 0.0) - 1e-6).abs() < 1e-18);
        assert!((weakened(1e-6, 2.0) / (1e-6 * 2.0_f64.exp()) - 1.0).abs() < 1e-4);
        assert!(weakened(0.004, 5.0) > 0.4 && weakened(0.004, 50.0) <= 1.0 && weakened(1.0, 1.0) <= 1.0);
    }

    #[test]
    fn two_chances_are_one() {
        assert!((both(0.5, 0.5) - 0.5).abs() < 1e-12 && both(1e-300, 0.99) < 1e-100 && both(0.0, 0.5) < 1e-100);
        assert_eq!((both(1.0, 0.01), both(0.03, 0.2)), (1.0, both(0.2, 0.03)));
        // what is confirmed is less likely, what is contradicted more
        assert!(both(0.05, 0.01) < 0.004 && both(0.001, 0.99) > 0.2);
        assert!(both(0.17, LEAST) < 0.005);
    }

    /// Chances of noise alone stay what they say.
    #[test]
    fn chances_of_noise_are_evenly_spread() {
        let even = |k: usize| (k as f64 + 0.5) / 400.0;
        let below = |level: f64| {
            let pairs = (0..400).flat_map(|a| (0..400).map(move |b| both(even(a), even(b).clamp(LEAST, 1.0 - LEAST))));
            pairs.filter(|p| *p < level).count() as f64 / 160_000.0
        };
        for level in [0.01, 0.05, 0.5] {
            let share = below(level);
            assert!(share < 1.02 * level && share > 0.6 * level, "{level} {share}");
        }
    }
}
