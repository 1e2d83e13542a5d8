//! The search: sets of effects by their evidence, one after the other, and what could stand in the place of each.

use super::proposals::{Proposal, Proposals};
use super::random_effect::log_sum;
use super::state::{Ground, Judged, State};
use crate::candidates::extended_model::place;
use crate::diagnosis::{EffectAt, LeftOut, SearchStep, Tried};
use crate::evidence::climb::Climb;
use crate::evidence::parts::Disagreement;
use fdm_effects::Candidate;
use fdm_numeric::parallel;
use std::collections::BTreeSet;

/// Sets that are refitted in a step: candidates, and pairs where the best of them is likelier or less likely than the best candidate.
const REFITTED: usize = 14;
const PAIRS: (usize, usize) = (6, 2);
/// Sets that are refitted from a plain fit too.
const AGAIN: usize = 4;
/// Sets that are asked whether they may be taken.
const ASKED: usize = 4;
/// Ratio of squared errors, on validation runs where there are any, up to which a set predicts as well.
const AS_WELL: f64 = 1.02;
/// Evidence (nats) by which another effect must be needed beside those that are there: odds of 3 : 1.
const NEEDED: f64 = 1.1;
/// Odds of 100 : 1, the group.
pub(crate) const GROUP: f64 = 4.6;

/// A state and what was made of it.
pub(crate) type Fitted = (State, Judged);

/// A cause of the result.
pub(crate) struct Cause {
    /// Its place in the state.
    pub(crate) effect: usize,
    /// Evidence that is lost without it.
    pub(crate) loss: f64,
    /// What could stand in its place, with evidence beside it, the likeliest first; itself left out.
    pub(crate) group: Vec<(Candidate, f64)>,
    /// How far parts of the records are apart on it; none in the frequency domain.
    pub(crate) disagreement: Option<Disagreement>,
}

/// What a search says of candidates that it could not judge.
#[derive(Default)]
pub(crate) struct Seen {
    /// Those that could not be tried.
    pub(crate) left_out: Vec<LeftOut>,
    /// Those that the fitted parameters make up for.
    pub(crate) hidden: Vec<EffectAt>,
}

/// What a search came to.
pub(crate) struct Found<'a> {
    /// What it was judged on at its end.
    pub(crate) ground: Ground<'a>,
    pub(crate) null: Fitted,
    pub(crate) best: Fitted,
    pub(crate) causes: Vec<Cause>,
    /// States that the search went on from, with their evidence, the null first.
    pub(crate) stages: Vec<(State, f64)>,
    pub(crate) steps: Vec<SearchStep>,
    /// Evidence of all sets of the first step together, beside the null.
    pub(crate) together: f64,
    /// What the first search saw of its candidates.
    pub(crate) seen: Seen,
    pub(crate) stopped: bool,
}

/// Effects of a state.
fn places(state: &State) -> Vec<EffectAt> {
    state.effects.iter().map(|e| place(&e.candidate)).collect()
}

/// Searches from a base.
pub(crate) struct Search<'a> {
    pub(crate) ground: Ground<'a>,
    pub(crate) base: State,
    /// The base at its fit.
    pub(crate) null: Fitted,
    pub(crate) candidates: &'a [Candidate],
    /// Most effects.
    pub(crate) most: usize,
    /// Squared error of the text of a state that is written and fitted plainly, beside that of the base.
    pub(crate) error: &'a (dyn Fn(&State) -> f64 + Sync),
}

/// What a search has seen on its way.
#[derive(Default)]
struct Way {
    stages: Vec<(State, f64)>,
    steps: Vec<SearchStep>,
    seen: Seen,
    /// The sets of the first step.
    first: Vec<(State, f64)>,
    together: f64,
    stopped: bool,
}

impl<'a> Search<'a> {
    /// None where the base has no evidence.
    pub(crate) fn run(mut self) -> Option<Found<'a>> {
        self.null = self.again(&self.null)?;
        let mut best: Fitted = self.again(&self.null)?;
        let mut way = Way { together: f64::NEG_INFINITY, ..Way::default() };
        way.stages.push((best.0.clone(), best.1.log));
        self.forward(&mut best, &mut way);
        if let Some(ground) = (!best.0.effects.is_empty()).then(|| self.ground.with_uneven_noise(&best)).flatten() {
            self.ground = ground;
            let weights = best.1.evidence.weights.clone();
            self.null = self.ground.refit(self.null.0.clone(), Some(&self.null.1.evidence.weights))?;
            best = self.ground.refit(best.0, Some(&weights))?;
            // what was seen on the way was judged by another noise
            way.stages = vec![(self.null.0.clone(), self.null.1.log)];
            way.first.clear();
            best = self.left_out_while_better(best);
            way.stages.push((best.0.clone(), best.1.log));
            self.forward(&mut best, &mut way);
        }
        let causes = self.causes(&mut best, &way.first);
        let Way { stages, steps, seen, together, stopped, .. } = way;
        Some(Found { ground: self.ground, null: self.null, best, causes, stages, steps, together, seen, stopped })
    }

    /// One set after the other, as long as another is likelier.
    fn forward(&self, best: &mut Fitted, way: &mut Way) {
        while best.0.effects.len() < self.most {
            let sets = if self.ground.work.goes_on() { self.sets((&best.0, &best.1), true) } else { None };
            let Some((sets, out)) = sets else {
                way.stopped = true;
                break;
            };
            let level = best.1.log;
            let tried = sets.iter().map(|(s, j)| Tried { effects: places(s), evidence: j.log - level }).collect();
            way.steps.push(SearchStep { tried, accepted: None });
            let begins = best.0.effects.is_empty();
            if begins {
                way.seen = out;
                way.first = sets.iter().map(|(s, j)| (s.clone(), j.log)).collect();
            }
            let mut physical: Vec<Fitted> = sets.into_iter().filter(|(s, _)| s.is_physical()).collect();
            // something is there where that is likelier than nothing, whatever it is; one more only where it is likelier itself
            let sum = log_sum(&physical.iter().map(|(_, j)| j.log - level).collect::<Vec<f64>>());
            if begins {
                way.together = sum;
            }
            if begins && sum < 0.0 {
                break;
            }
            physical.retain(|(_, j)| begins || j.log > level + NEEDED);
            let Some(next) = self.chosen(physical, &best.0) else { break };
            *best = self.left_out_while_better(next);
            if let Some(step) = way.steps.last_mut() {
                step.accepted = Some(places(&best.0));
            }
            way.stages.push((best.0.clone(), best.1.log));
        }
    }

    /// Of the likeliest sets the first that predicts as well as what is there.
    fn chosen(&self, sets: Vec<Fitted>, before: &State) -> Option<Fitted> {
        sets.into_iter().take(ASKED).find(|(set, _)| self.predicts(set, before))
    }

    fn predicts(&self, new: &State, old: &State) -> bool {
        (self.error)(new) <= AS_WELL * (self.error)(old)
    }

    fn again(&self, found: &Fitted) -> Option<Fitted> {
        let judged = self.ground.judge(&found.0, Some(&found.1.evidence.weights))?;
        Some((found.0.clone(), judged))
    }

    /// Refitted states with one or two more effects, the likeliest first; none where it was stopped.
    fn sets(&self, (state, judged): (&State, &Judged), pairs: bool) -> Option<(Vec<Fitted>, Seen)> {
        let mut proposals = Proposals::new(&self.ground, (state, judged), self.candidates)?;
        let hidden = if pairs && state.effects.is_empty() { proposals.hidden() } else { Vec::new() };
        let told = Seen { left_out: std::mem::take(&mut proposals.left_out), hidden };
        let ranked = proposals.likeliest(pairs);
        let (mut singles, mut more): (Vec<&Proposal>, Vec<&Proposal>) = ranked.iter().partition(|p| p.specs.len() == 1);
        let likelier = more.first().zip(singles.first()).is_some_and(|(pair, single)| pair.log > single.log);
        // of a candidate its best value, of a finite one the best two
        let mut seen: Vec<usize> = Vec::new();
        singles.retain(|p| {
            let (own, finite) = proposals.candidate(p.specs[0]);
            let fresh = seen.iter().filter(|s| **s == own).count() < if finite { 2 } else { 1 };
            seen.push(own);
            fresh
        });
        singles.truncate(REFITTED);
        more.truncate(if likelier { PAIRS.0 } else { PAIRS.1 });
        let todo: Vec<&Proposal> = singles.into_iter().chain(more).collect();
        let refitted = |proposal: &Proposal| -> Option<Fitted> {
            let begun = proposals.begun(proposal)?;
            self.ground.refit(begun, Some(&proposal.weights))
        };
        let mut found: Vec<Fitted> = parallel::map(todo, refitted).into_iter().flatten().collect();
        found.sort_by(|a, b| b.1.log.total_cmp(&a.1.log));
        // the likeliest once more from a plain fit
        let again = |state: State| -> Option<Fitted> { self.ground.refit(self.ground.plainly(state)?, None) };
        let first: Vec<State> = found.iter().take(AGAIN).map(|(s, _)| s.clone()).collect();
        for (k, other) in parallel::map(first, again).into_iter().enumerate() {
            if let Some(other) = other.filter(|other| other.1.log > found[k].1.log) {
                found[k] = other;
            }
        }
        found.sort_by(|a, b| b.1.log.total_cmp(&a.1.log));
        let mut known: Vec<BTreeSet<EffectAt>> = Vec::new();
        found.retain(|(s, _)| {
            let own: BTreeSet<EffectAt> = places(s).into_iter().collect();
            let fresh = !known.contains(&own);
            known.push(own);
            fresh
        });
        Some((found, told))
    }

    /// Members are left out as long as they are not needed.
    fn left_out_while_better(&self, mut best: Fitted) -> Fitted {
        while best.0.effects.len() > 1 {
            let without = |k: usize| self.without(&best, k).filter(|(_, judged)| judged.log > best.1.log - NEEDED);
            let found = (0..best.0.effects.len()).find_map(without);
            match found {
                Some(found) => best = found,
                None => break,
            }
        }
        best
    }

    fn without(&self, found: &Fitted, k: usize) -> Option<Fitted> {
        let kept: Vec<usize> = (0..found.0.effects.len()).filter(|e| *e != k).collect();
        let state = found.0.only(&self.base, &kept, &self.ground)?;
        self.ground.refit(state, Some(&found.1.evidence.weights))
    }

    /// Effects of the result, the dearest first, each with those that could stand in its place; one that stands there better takes it.
    fn causes(&self, best: &mut Fitted, first: &[(State, f64)]) -> Vec<Cause> {
        let mut causes = Vec::new();
        let mut k = 0;
        while k < best.0.effects.len() {
            let alone = best.0.effects.len() == 1;
            let without = if alone { None } else { self.without(best, k) };
            let (level, others): (f64, Vec<(State, f64)>) = match &without {
                Some((state, judged)) => {
                    let sets = self.sets((state, judged), false).map_or(Vec::new(), |(sets, _)| sets);
                    let mut better: Vec<Fitted> = Vec::new();
                    let mut list = Vec::new();
                    for (s, j) in sets {
                        list.push((s.clone(), j.log));
                        if s.is_physical() && j.log > best.1.log && self.predicts(&s, &best.0) {
                            better.push((s, j));
                        }
                    }
                    let level = judged.log;
                    if let Some(found) = better.into_iter().next() {
                        *best = found;
                        // it stands at the end now
                        let last = best.0.effects.len() - 1;
                        best.0.effects.swap(k, last);
                    }
                    (level, list)
                }
                None if first.is_empty() => {
                    let sets = self.sets((&self.null.0, &self.null.1), false).map_or(Vec::new(), |(sets, _)| sets);
                    (self.null.1.log, sets.into_iter().map(|(s, j)| (s, j.log)).collect())
                }
                None => (self.null.1.log, first.to_vec()),
            };
            let own = place(&best.0.effects[k].candidate);
            let told = best.1.log - best.0.effects[k].odds();
            let mut group: Vec<(Candidate, f64)> = Vec::new();
            for (s, log) in &others {
                let Some(last) = s.effects.last().filter(|_| s.effects.len() == best.0.effects.len()) else { continue };
                // what the records alone cannot tell from it, whatever its kind
                if place(&last.candidate) != own && s.is_physical() && log - last.odds() > told - GROUP {
                    group.push((last.candidate.clone(), log - best.1.log));
                }
            }
            causes.push(Cause { effect: k, loss: best.1.log - level, group, disagreement: None });
            k += 1;
        }
        causes.iter_mut().for_each(|cause| cause.disagreement = self.ground.disagreement(best, cause.effect));
        causes.sort_by(|a, b| b.loss.total_cmp(&a.loss));
        causes
    }
}
