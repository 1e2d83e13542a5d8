//! The chance that noise makes the best candidate look as good as it does, once the best have been fitted.
//!
//! Screening promises a gain; what the joint fit gains on the runs that are learned from may be less. The statistic of a fitted candidate is
//! then the lesser of both. It is judged by the distribution that the promise has under noise: what is never larger than another
//! statistic is large no more often. What the leader by these runs does on the held-out ones is a second chance beside
//! it (`held_test`). So it is with the candidate without which the residual is likelier as noise of any smooth spectrum (`own_noise`), where
//! promises say nothing. A gain far beyond all that speaks for itself.

use super::contender::Contender;
use super::contest::Contest;
use super::held_test::{both, held_chance};
use super::round::Round;

/// A score that noise gives to no candidate, whatever its nuisances: what is beyond it counts although nothing was promised, as where a
/// model is so far off that a small step says little of a large one.
const SURE: f64 = 25.0;

/// The family-wise chance of the best candidate by what it gained in fact.
pub(super) fn confirmed(round: &Round<'_>, contest: &Contest) -> f64 {
    let candidates = &round.screening.candidates;
    let p = round.screening.family_wise;
    let Some(lead) = round.screening.ranking.first().map(|t| candidates[*t].lead) else { return p };
    let fitted = || contest.contenders.iter().chain(&contest.far);
    let of = |t: &usize| match fitted().find(|c| c.trace == *t) {
        Some(c) => (candidates[*t].lead - 2.0 * (c.predicted - c.gain).max(0.0), Some(c)),
        None => (candidates[*t].lead, None),
    };
    let leads = round.screening.ranking.iter().map(of);
    let (left, leader) = leads.fold((f64::NEG_INFINITY, None), |best, own| if own.0 > best.0 { own } else { best });
    // beyond what noise gives once in a hundred times, chances fall like that of chi-square
    let first = weakened(p, 0.5 * (lead - left).max(0.0));
    let with_held = |leader: Option<&Contender>, first: f64| {
        leader.and_then(|c| held_chance(round, contest, c)).map_or(first, |second| both(first, second))
    };
    let promised = with_held(leader, first);
    let as_noise =
        contest.unlikely.and_then(|u| Some(with_held(Some(fitted().find(|c| c.trace == u.trace)?), u.chance)));
    let beyond = fitted().map(|c| c.score() - SURE).fold(f64::NEG_INFINITY, f64::max);
    promised.min(as_noise.unwrap_or(1.0)).min(candidates.len() as f64 * (-beyond).exp())
}

/// A chance among many, when each of them is so many times (by its logarithm) larger.
fn weakened(p: f64, nats: f64) -> f64 {
    -(nats.min(700.0).exp() * (-p.clamp(0.0, 1.0 - 1e-12)).ln_1p()).exp_m1()
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
}
