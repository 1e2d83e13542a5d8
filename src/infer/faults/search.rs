//! Which faults make a record likeliest together: forward selection by evidence, after each step of which every accepted fault must still be needed.

use super::ground::{Ground, Planted, Point, Responses};
use super::output_edits::is_of_others;
use super::shifts::shifts_of_zero;
use super::weighing::Judged;
use crate::evidence::climb::Climb;
use crate::evidence::parts::Parts;
use fdm_doctor::{Edit, Estimated, Fault, Hypothesis, Slot, Witness, discrete, time_factor};
use fdm_numeric::parallel;

/// Kinds of estimated faults for each channel, with their shares of the prior probability.
const SHARE: f64 = 3.0;
/// Hypotheses that are refitted, from each of the places where they begin.
const REFITTED: usize = 4;
/// Rounds of noise and unknowns by which hypotheses are ranked.
const ROUNDS: usize = 2;
/// Errors that a size must have.
const SIGMAS: f64 = 4.0;
/// Gain of the fit without faults (nats) that is worth another round: less moves no odds that are told.
const BETTER: f64 = 1.0;
/// Radians of the fastest mode between two samples, beyond which no motion could be fitted.
pub(crate) const FASTEST: f64 = 30.0;
/// Longest delay that is looked for, as a part of the record, and of inputs.
const FARTHEST: [f64; 2] = [0.25, 0.1];

/// A hypothesis that was refitted.
#[derive(Clone)]
pub(crate) struct Weighed {
    pub(crate) planted: Planted,
    /// Log evidence and log prior, beside those of the faults accepted before, as far as the parts of the record agree.
    pub(crate) log: f64,
    /// Log evidence as the noise alone lets it be, and the part of it on which the parts of the record agree.
    gain: f64,
    agreed: f64,
    /// Logarithm of its share of the prior probability.
    pub(crate) prior: f64,
    pub(crate) point: Point,
    pub(crate) judged: Judged,
}

/// What a search ends with.
pub(crate) struct Found {
    /// The likeliest point without faults, and its log evidence and log prior.
    pub(crate) null: Point,
    null_log: f64,
    pub(crate) accepted: Vec<Accepted>,
    pub(crate) point: Point,
    pub(crate) judged: Judged,
    /// The hypotheses of the first round.
    pub(crate) first: Vec<Weighed>,
    /// Points that were judged.
    pub(crate) fits: usize,
}

impl Found {
    /// Evidence of all accepted faults together beside records as they are, by the same measure as that of effects.
    pub(crate) fn evidence(&self) -> f64 {
        self.judged.log - self.null_log + self.prior()
    }

    /// Log prior of their kinds and places.
    pub(crate) fn prior(&self) -> f64 {
        self.accepted.iter().map(|a| a.prior).sum()
    }
}

/// A fault, with those that were nearly as likely.
pub(crate) struct Accepted {
    pub(crate) prior: f64,
    /// What is lost without it, prior odds included.
    pub(crate) log_odds: f64,
    pub(crate) near: Vec<Weighed>,
    pub(crate) without: Option<Point>,
}

/// Searches for faults of records beside a model.
pub(crate) struct Search<'a> {
    pub(crate) ground: &'a Ground<'a>,
    /// Whether the model knows the time.
    pub(crate) timed: bool,
    /// Whether sizes are estimated.
    pub(crate) estimated: bool,
    /// Faults that are looked for at most, and the log odds that each must have.
    pub(crate) most: usize,
    pub(crate) needed: f64,
    /// Magnitude of the model's fastest mode times the usual interval, where that is known.
    pub(crate) pace: Option<f64>,
}

impl Search<'_> {
    /// Looks for faults as long as there is a likely one, from a fit on.
    pub(crate) fn run(&self, (mut point, mut judged): (Point, Judged)) -> Found {
        let (mut accepted, mut first, mut fits): (Vec<Accepted>, Vec<Weighed>, usize) = (Vec::new(), Vec::new(), 1);
        let (mut null, mut null_log) = (point.clone(), judged.log);
        while accepted.len() < self.most && self.ground.work.goes_on() {
            let (all, tried) = self.round(&point, &judged);
            fits += tried;
            if !self.ground.work.goes_on() {
                break;
            }
            if accepted.is_empty() {
                first = all.clone();
            }
            let Some(best) = all.first().filter(|b| b.log > self.needed).cloned() else { break };
            if accepted.is_empty()
                && let Some(better) = self.better_null(&best, judged.log)
            {
                (point, judged) = better;
                (null, null_log) = (point.clone(), judged.log);
                continue;
            }
            (point, judged) = (best.point, best.judged);
            accepted.push(Accepted { prior: best.prior, log_odds: best.log, near: all, without: None });
            fits += self.needed_still(&mut accepted, &mut point, &mut judged);
        }
        Found { null, null_log, accepted, point, judged, first, fits }
    }

    /// The fit without faults that begins where the first fault led, where it is likelier than the one known: a fit that had stopped on its way is no
    /// evidence for a fault.
    fn better_null(&self, first: &Weighed, known: f64) -> Option<(Point, Judged)> {
        let begun = self.ground.without(&first.point, 0);
        let weights = [Some(&first.judged.evidence.weights[..]), None];
        let all = weights.into_iter().filter_map(|weights| self.ground.climbed(begun.clone(), weights));
        all.filter(|(_, judged)| judged.log > known + BETTER).max_by(|a, b| a.1.log.total_cmp(&b.1.log))
    }

    /// Each accepted fault with what is lost without it, given all others; one that is not needed any more is dropped.
    fn needed_still(&self, accepted: &mut Vec<Accepted>, point: &mut Point, judged: &mut Judged) -> usize {
        let (mut fits, mut k) = (0, 0);
        while k < accepted.len() && accepted.len() > 1 {
            let begun = self.ground.without(point, k);
            let own = self.ground.climbed(begun.clone(), Some(&judged.evidence.weights));
            let text = Point { theta: self.ground.text.clone(), ..begun };
            let from_text = self.ground.climbed(text, None);
            let without = [own, from_text].into_iter().flatten().max_by(|a, b| a.1.log.total_cmp(&b.1.log));
            fits += 2;
            let Some(without) = without else {
                k += 1;
                continue;
            };
            accepted[k].log_odds = self.gained((point, judged), (&without.0, &without.1), k) + accepted[k].prior;
            accepted[k].without = Some(without.0.clone());
            if accepted[k].log_odds > self.needed {
                k += 1;
                continue;
            }
            accepted.remove(k);
            (*point, *judged) = without;
        }
        fits
    }

    /// The channels about which there is evidence.
    fn slots(&self) -> Vec<Slot> {
        let Witness { channels, .. } = *self.ground.witness;
        let known = |s: &Slot| !matches!(s, Slot::Other(_)) || self.ground.witness.reads(*s);
        channels.slots().filter(known).collect()
    }

    /// All hypotheses beside those of a point, the likeliest first, and how many points were judged.
    fn round(&self, point: &Point, judged: &Judged) -> (Vec<Weighed>, usize) {
        let ground = self.ground;
        let (slots, accepted) = (self.slots(), point.edits());
        ground.work.stage(&format!("a fault beside {} others", point.faults.len()));
        let fresh = |h: &Hypothesis| {
            let known = h.edits.iter().all(|e| accepted.contains(e));
            let wild = |e: &Edit| matches!(*e, Edit::Time(f) if self.pace.is_some_and(|p| f * p > FASTEST));
            !known && !h.edits.iter().any(wild)
        };
        let mut list: Vec<Hypothesis> =
            discrete(ground.channels, &slots, self.timed).into_iter().chain(self.holds()).filter(fresh).collect();
        list.retain(|h| ground.balances.iter().any(|b| b.unexplained.is_finite()) || !h.edits.iter().all(is_of_others));
        let shares = if self.estimated { SHARE * slots.len() as f64 } else { 0.0 };
        let whole = list.iter().map(|h| h.weight).sum::<f64>() + shares + ground.stated.len() as f64;
        let mut tried: Vec<(usize, Planted)> = list.into_iter().map(Planted::Discrete).enumerate().collect();
        let mut count = tried.len();
        for fault in self.kinds(&slots, point) {
            tried.extend(self.sizes(fault, &accepted).into_iter().map(|size| (count, Planted::Sized(fault, size))));
            count += 1;
        }
        for k in 0..ground.stated.len() {
            if !point.faults.contains(&Planted::Beginning(k)) {
                tried.push((count, Planted::Beginning(k)));
                count += 1;
            }
        }
        let matched = self.matched(point);
        let Some(matched) = matched else { return (Vec::new(), 0) };
        let mut begun: Vec<(bool, Point)> = Vec::new();
        for from_text in [false, true] {
            begun.extend(self.ranked(point, from_text, (judged, matched), &tried, count));
        }
        let fits = tried.len() + begun.len();
        let refitted = |(plainly, begun): (bool, Point)| {
            let begun = if plainly { ground.plainly(begun)? } else { begun };
            self.weighed(begun, whole, (point, judged, matched))
        };
        let mut found: Vec<Weighed> = parallel::map(begun, refitted).into_iter().flatten().collect();
        tempered(&mut found);
        let mut known: Vec<Planted> = Vec::new();
        found.retain(|w| {
            let new = !known.iter().any(|k| k.is_like(&w.planted));
            known.push(w.planted.clone());
            new
        });
        (found, fits)
    }

    /// Inputs that may be held between samples, or go in straight lines, where nobody said which: in all runs alike, as one logger writes them.
    fn holds(&self) -> Vec<Hypothesis> {
        let runs = self.ground.runs;
        let of = |(k, held): (usize, bool)| {
            let words = if held {
                "keeps its value between samples, where straight lines were assumed"
            } else {
                "goes in straight lines between samples, where it was held"
            };
            let (slot, weight) = (Slot::Input(k), 1.0);
            let some = if runs.iter().all(|r| r.held[k] != held) { "" } else { " in some runs" };
            Hypothesis {
                fault: Fault::Hold,
                slots: vec![slot],
                edits: vec![Edit::Hold(slot, held)],
                what: format!("{words}{some}"),
                weight,
                frame: None,
            }
        };
        let inputs = (0..self.ground.channels.inputs).filter(|k| runs.iter().all(|r| !r.is_stated(*k)));
        let ways = inputs.flat_map(|k| [(k, true), (k, false)]);
        ways.filter(|(k, held)| runs.iter().any(|r| r.held[*k] != *held)).map(of).collect()
    }

    /// Faults with a size.
    fn kinds(&self, slots: &[Slot], point: &Point) -> Vec<Estimated> {
        let ground = self.ground;
        if !self.estimated {
            return Vec::new();
        }
        let mut kinds = Vec::new();
        for slot in slots {
            let turns = |k: usize| ground.model.layout().wraps.iter().any(|(o, _)| *o as usize == k);
            let mut own = vec![Fault::Offset, Fault::Scale];
            if self.timed {
                own.extend([Fault::Delay, Fault::Drift]);
                if !matches!(slot, Slot::Input(_)) && !matches!(slot, Slot::Output(k) if turns(*k)) {
                    own.push(Fault::Filtered);
                }
            }
            kinds.extend(own.into_iter().map(|fault| Estimated::new(fault, *slot)));
        }
        kinds.extend(shifts_of_zero(ground, point));
        kinds.retain(|kind| !point.faults.iter().any(|f| matches!(f, Planted::Sized(known, _) if known == kind)));
        kinds
    }

    /// Sizes at which a fault is tried first.
    fn sizes(&self, fault: Estimated, accepted: &[Edit]) -> Vec<f64> {
        let ground = self.ground;
        let factor = time_factor(accepted);
        let (interval, span) = (factor * ground.interval, factor * ground.span);
        let up_to = |most: f64| {
            let mut sizes = vec![1.0_f64, 2.0, 3.0];
            while let Some(last) = sizes.last().filter(|last| 1.3 * **last < most / interval) {
                sizes.push((1.3 * last).max(last + 1.0));
            }
            sizes
        };
        let both = |sizes: Vec<f64>| sizes.iter().flat_map(|s| [*s, -s]).collect::<Vec<f64>>();
        let input = matches!(fault.slot, Slot::Input(_));
        let mut sizes = match fault.fault {
            Fault::Delay => both(up_to(FARTHEST[usize::from(input)] * span)).iter().map(|k| k * interval).collect(),
            Fault::Drift => both(vec![2.0, 4.0, 8.0, 16.0, 32.0]).iter().map(|k| k * interval / span).collect(),
            Fault::Filtered => [0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0].map(|k| k * interval).to_vec(),
            _ => vec![0.0],
        };
        if ground.witness.reads(fault.slot) {
            sizes.extend(ground.witness.size(fault, factor, accepted).map(|s| s.size));
        }
        sizes
    }

    /// The log evidence of a point by white noise.
    fn matched(&self, point: &Point) -> Option<f64> {
        let ground = self.ground;
        ground.matched(point, &ground.grams_of(point, &ground.responses_of(point)?)?)
    }

    /// The likeliest hypotheses from a start, to first order, each at its likeliest size: by their own noise, by white noise, and by kinematics alone, which a
    /// model that lacks something may contradict. Those that are no likelier by white noise are none but for kinematics: noise of any colour would take the
    /// place of the motion.
    fn ranked(
        &self,
        beside: &Point,
        from_text: bool,
        (judged, matched): (&Judged, f64),
        tried: &[(usize, Planted)],
        count: usize,
    ) -> Vec<(bool, Point)> {
        let ground = self.ground;
        let all = ground.all_unknowns(&beside.faults);
        let text;
        let start = match from_text {
            false => beside,
            true => {
                text = Point { theta: ground.text.clone(), ..beside.clone() };
                &text
            }
        };
        // records in another unit of time may leave the text without a response, and are what is asked about
        let base = ground.responses(&start.theta, &start.edits(), &all);
        let known = ground.witnessed(start);
        let promise = |(kind, planted): &(usize, Planted)| -> Option<(usize, [f64; 3], Point)> {
            if !ground.work.goes_on() {
                return None;
            }
            let mut point = start.with(planted.clone());
            // a run begins where the record says, as the edits have it
            point.theta = if from_text { ground.text_of(&point.edits()) } else { point.theta };
            let own: Responses;
            let kept = planted.edits().iter().all(|e| ground.keeps_inputs(e)) && point.theta == start.theta;
            let responses = match kept {
                true => base.as_ref()?,
                false => {
                    own = ground.responses_of(&point)?;
                    &own
                }
            };
            let (weight, grams) = (planted.weight().ln(), ground.grams_of(&point, responses)?);
            let gained = ground.matched(&point, &grams)? - matched + weight;
            let promised = match gained > 0.0 {
                true => ground.judged(&point, &grams, Some(ROUNDS), None)?.promised + weight - judged.log,
                false => f64::NEG_INFINITY,
            };
            let witnessed = ground.witnessed(&point) - known + weight - self.needed;
            Some((*kind, [promised, gained, witnessed], point))
        };
        let all: Vec<(usize, [f64; 3], Point)> = parallel::map(tried.iter(), promise).into_iter().flatten().collect();
        let mut begun = Vec::new();
        for by in 0..3 {
            let mut best: Vec<Option<&(usize, [f64; 3], Point)>> = vec![None; count];
            for found in all.iter().filter(|f| f.1[by] > 0.0) {
                let own = &mut best[found.0];
                if own.is_none_or(|known| found.1[by] > known.1[by]) {
                    *own = Some(found);
                }
            }
            let mut best: Vec<&(usize, [f64; 3], Point)> = best.into_iter().flatten().collect();
            best.sort_by(|a, b| b.1[by].total_cmp(&a.1[by]));
            begun.extend(best.into_iter().take(REFITTED).map(|(_, _, point)| (by == 1, point.clone())));
        }
        begun
    }

    /// A hypothesis refitted; none where its size says nothing.
    fn weighed(&self, begun: Point, whole: f64, (before, than, matched): (&Point, &Judged, f64)) -> Option<Weighed> {
        let ground = self.ground;
        let (point, judged) = ground.climbed(begun, None)?;
        let k = before.faults.len();
        let planted = point.faults[k].clone();
        let parts = ground.parts(&point, &judged, k);
        if let Planted::Sized(fault, size) = planted {
            let error = ground.error_of(&point, &judged, k) * parts.as_ref().map_or(1.0, |p| p.dispersion().sqrt());
            let interval = time_factor(&point.edits()) * ground.interval / ground.every as f64;
            let error = if fault.fault == Fault::Delay { error.max(interval / 12f64.sqrt()) } else { error };
            // a delay that may be one sample is a matter of stamps
            let matters = match fault.fault {
                Fault::Delay => size.abs() - 2.0 * error >= interval,
                Fault::Filtered => size - 2.0 * error >= 0.5 * interval,
                Fault::Drift => size.abs() * ground.span >= 2.0 * interval,
                _ => true,
            };
            if !matters || size.abs() < SIGMAS * error {
                return None;
            }
        }
        let witnessed = ground.witnessed(&point) - ground.witnessed(before);
        if witnessed < self.needed && self.matched(&point)? < matched {
            return None;
        }
        let prior = planted.weight().ln() - whole.ln();
        let gain = judged.log - than.log;
        let agreed = self.bounded((&point, &judged), (before, than), parts.as_ref());
        Some(Weighed { log: gain + prior, gain, agreed, planted, prior, point, judged })
    }

    /// What a point gains by one of its faults over another point without it.
    fn gained(&self, with: (&Point, &Judged), without: (&Point, &Judged), k: usize) -> f64 {
        self.bounded(with, without, self.ground.parts(with.0, with.1, k).as_ref())
    }

    /// The gain of a point over another one: what the record says for a fault or against it is no more than its parts say together.
    fn bounded(
        &self,
        (point, judged): (&Point, &Judged),
        (before, than): (&Point, &Judged),
        parts: Option<&Parts>,
    ) -> f64 {
        let whole = judged.log - than.log;
        // what kinematics and the values in the text say stands beside it
        let beside = self.ground.witnessed(point) - self.ground.witnessed(before) + judged.values - than.values;
        let own = whole - beside;
        let agreed = |parts: &Parts| if own > 0.0 { own.min(parts.gain()) } else { own.max(parts.gain()).min(0.0) };
        parts.map_or(whole, |parts| agreed(parts) + beside)
    }
}

/// Hypotheses by what the record says of them, the likeliest first: where the parts of the record agree on a part alone of what the noise lets the likeliest
/// one gain, the likelihood counts to that power (Bissiri, Holmes and Walker 2016).
fn tempered(found: &mut [Weighed]) {
    found.iter_mut().for_each(|f| f.log = f.gain.max(f.agreed) + f.prior);
    found.sort_by(|a, b| b.log.total_cmp(&a.log));
    let Some(power) = found.first().filter(|b| b.gain > 0.0).map(|b| (b.agreed / b.gain).clamp(0.0, 1.0)) else {
        return;
    };
    let counted = |f: &Weighed| if f.agreed > f.gain { f.agreed } else { power * f.gain };
    found.iter_mut().for_each(|f| f.log = counted(f) + f.prior);
    found.sort_by(|a, b| b.log.total_cmp(&a.log));
}
