//! Which faults make a record likeliest together: forward selection, after each step of which every accepted fault is examined again beside
//! what stood near it, so that one does not hide another.

use crate::beside::BesideOptions;
use crate::biases::biases_of;
use crate::far_delays::far_delays;
use crate::finding::{Fault, Finding, Place, Severity};
use crate::hypothesis::{Channels, Edit, Hypothesis, Slot, discrete, time_factor};
use crate::likelihood::{Begin, Evidence, FASTEST, Searched, THOROUGH, Trial, search as search_number, variance};
use crate::linearised::Linearised;
use crate::record::{Record, Role};
use crate::tail::Tail;
use fdm_numeric::parallel;
use fdm_system::Model;

/// What every round of the search has in common.
pub(crate) struct Search<'a> {
    pub(crate) evidence: &'a Evidence<'a>,
    /// Whether the model knows the time.
    pub(crate) timed: bool,
    pub(crate) options: &'a BesideOptions,
}

/// What speaks against a fault that is likely.
#[derive(Clone, Copy)]
struct Doubts {
    /// Whether all parts of the record speak for it.
    everywhere: bool,
    /// Whether what the model may lack does as well.
    doubted: bool,
}

/// A number to be estimated.
struct Number<'n> {
    /// The first step from 0.
    begin: f64,
    /// Gain in nats that it has to promise.
    needed: f64,
    /// It is above this.
    least: f64,
    /// The edits of a value.
    edits: &'n (dyn Fn(f64) -> Vec<Edit> + Sync),
}

impl Number<'_> {
    /// The edits of a value beside others; none where it cannot be.
    fn beside(&self, accepted: &[Edit], value: f64) -> Option<Vec<Edit>> {
        let all = || accepted.iter().copied().chain((self.edits)(value)).collect();
        (value > self.least).then(all)
    }
}

/// Where numbers are searched about.
struct Abouts<'a> {
    /// A fit at its estimates.
    fit: Option<Linearised<'a>>,
    /// The values of the text.
    text: Option<Linearised<'a>>,
    /// That fit.
    near: &'a Trial,
}

impl<'a> Abouts<'a> {
    fn of(evidence: &'a Evidence<'a>, fit: &'a Trial, edits: &[Edit]) -> Self {
        let text = Linearised::of_text(evidence, fit, edits);
        Self { fit: Linearised::of(evidence, fit, edits), text, near: fit }
    }
}

/// A hypothesis that was tried.
#[derive(Clone)]
struct Judged {
    hypothesis: Hypothesis,
    /// Logarithm of its share of the prior probability and, where a number was estimated, its penalty.
    prior: f64,
    log_odds: f64,
    trial: Trial,
}

impl Judged {
    /// Gain in log-likelihood over a trial without it.
    fn gain(&self, over: &Trial) -> f64 {
        gain(self.hypothesis.fault, &self.trial, over)
    }
}

/// Gain in log-likelihood that speaks for a fault: those with an estimated number are judged with caution.
fn gain(fault: Fault, with: &Trial, without: &Trial) -> f64 {
    match fault {
        Fault::Delay | Fault::Drift | Fault::Filtered | Fault::Scale | Fault::ZeroShift => {
            with.cautious_gain_over(without)
        }
        // a trim that the model lacks may cancel a zero: what the model says against one counts for that constant's penalty at most
        Fault::Offset => {
            let kinematics = with.gain_of_kinematics(without);
            let beside_model = with.cautious_gain_over(without) - kinematics;
            kinematics + beside_model.max(-0.5 * with.worth().max(1.0).ln())
        }
        _ => with.gain_over(without),
    }
}

/// An accepted fault, with those that were nearly as likely.
struct Accepted {
    judged: Judged,
    near: Vec<Judged>,
}

/// Hypotheses that are fitted to the end, and that an accepted one is compared with later.
const REFINED: usize = 4;

/// Remarks of what a model lacks that the search goes beyond.
const MOST_REMARKS: usize = 2;

/// Odds over what a model may lack, a constant or a lag, below which a fault is a remark.
const DOUBT: f64 = 20.0;

/// What a search ends with.
pub(crate) struct Found {
    /// The faults that make the records likeliest, each with its odds and biases given all the others.
    pub(crate) findings: Vec<Finding>,
    /// What mends them all.
    pub(crate) edits: Vec<Edit>,
    /// The fit of the mended records.
    pub(crate) last: Trial,
    /// Fits that were made.
    pub(crate) fits: usize,
}

/// Looks for faults as long as there is a likely one.
pub(crate) fn faults(search: &Search<'_>, start: Trial) -> Found {
    let mut accepted: Vec<Accepted> = Vec::new();
    let (mut current, mut fits) = (start.clone(), 0);
    let needed = search.options.odds.ln();
    // what the model lacks is a remark, and leaves faults behind it their place
    let remarks = |all: &[Accepted]| {
        all.iter().filter(|a| search.is_addition_for(&a.judged.hypothesis, &a.judged.hypothesis)).count()
    };
    while accepted.len() < search.options.most + remarks(&accepted).min(MOST_REMARKS) {
        let (mut all, tried) = round(search, &edits(&accepted, None), &current);
        fits += tried;
        // of a round that was not finished nobody knows which is the likeliest
        if !search.evidence.work.goes_on() {
            break;
        }
        if all.first().is_none_or(|b| b.log_odds <= needed) {
            break;
        }
        let best = search.settled(all.remove(0), &edits(&accepted, None), &current);
        // what a model may lack is remembered wherever it stands
        let rival = |j: &Judged| search.is_addition(&j.hypothesis) && j.log_odds > best.log_odds - DOUBT.ln();
        let (first, others) = all.split_at(all.len().min(REFINED));
        let mut all: Vec<Judged> = first.iter().chain(others.iter().filter(|j| rival(j))).cloned().collect();
        all.extend(lag_in_place(search, &best, &edits(&accepted, None), &current));
        fits += 8;
        current = best.trial.clone();
        accepted.push(Accepted { judged: best, near: all });
        if accepted.len() > 1 {
            search.evidence.work.stage("the faults that were found, each beside what stood near it");
            fits += examine_again(search, &mut accepted, &mut current);
        }
    }
    late_outputs(search, &mut accepted);
    let mut found = Vec::new();
    for k in 0..accepted.len() {
        let without =
            if accepted.len() == 1 { Some(start.clone()) } else { search.trial(&edits(&accepted, Some(k)), &current) };
        fits += 1;
        let own = &accepted[k];
        let log_odds = without
            .as_ref()
            .map_or(own.judged.log_odds, |w| gain(own.judged.hypothesis.fault, &current, w) + own.judged.prior);
        let everywhere = without.as_ref().is_none_or(|w| search.holds_everywhere(&own.judged, &current, w));
        let doubted = search.doubted(&accepted, k, log_odds, without.as_ref());
        fits += 2 * usize::from(doubted);
        let doubts = Doubts { everywhere, doubted };
        let mut finding = search.told(own, log_odds, doubts, time_factor(&edits(&accepted, None)));
        finding.biases = biases_of(without.as_ref().and_then(|w| w.estimate.as_ref()), current.estimate.as_ref());
        found.push(finding);
    }
    let edits = edits(&accepted, None);
    Found { findings: found, edits, last: current, fits }
}

/// Lags between inputs and the only output in the place of a fault that makes it late: one or two, about as long as that.
fn lag_in_place(search: &Search<'_>, fault: &Judged, accepted: &[Edit], current: &Trial) -> Option<Judged> {
    let [Edit::Delay(slot, by)] = fault.hypothesis.edits[..] else { return None };
    let output = Slot::Output(0);
    let late = matches!(slot, Slot::Output(_)) == (by > 0.0);
    if !late || !search.is_alone(output) {
        return None;
    }
    // a body and its sensor are two lags in a chain
    let tried = [1, 2].into_iter().filter_map(|count| {
        let number = Number {
            begin: 0.6 * by.abs() / count as f64,
            needed: 0.0,
            least: 0.0,
            edits: &|lag| vec![Edit::Filter(output, lag); count],
        };
        let Searched { value, trial, .. } = search.best(&number, accepted, current)?;
        let what = format!("went through {count} lag(s) of {value:.4}");
        let (edits, weight) = (vec![Edit::Filter(output, value); count], fault.hypothesis.weight);
        let hypothesis = Hypothesis { fault: Fault::Filtered, slots: vec![output], edits, what, weight };
        let (prior, log_odds) = (fault.prior, trial.cautious_gain_over(current) + fault.prior);
        Some(Judged { log_odds, hypothesis, prior, trial })
    });
    tried.max_by(|a, b| a.log_odds.total_cmp(&b.log_odds))
}

/// An input that is early is the same motion as outputs that are all late, and sensors are late: it is told of the outputs, with what was found
/// late of them beside it. Where other channels or inputs stand still the motion is another one.
fn late_outputs(search: &Search<'_>, accepted: &mut Vec<Accepted>) {
    let (evidence, channels) = (search.evidence, search.evidence.channels);
    let other = |s: Slot| matches!(s, Slot::Other(_)) && evidence.kinematics.reads(channels.place(s));
    if channels.inputs != 1 || channels.slots().any(other) {
        return;
    }
    let early = |a: &Accepted| match a.judged.hypothesis.edits[..] {
        [Edit::Delay(slot @ Slot::Input(_), by)] if by < 0.0 => Some((slot, -by)),
        _ => None,
    };
    let Some((k, (input, by))) = accepted.iter().enumerate().find_map(|(k, a)| Some((k, early(a)?))) else { return };
    let same = format!("the same as `{}` {by:.4} too early", channels.name(input));
    let mut alike: Vec<Slot> = channels.slots().filter(|s| matches!(s, Slot::Output(_))).collect();
    for accepted in accepted.iter_mut() {
        if let [Edit::Delay(slot @ Slot::Output(_), own)] = accepted.judged.hypothesis.edits[..] {
            alike.retain(|s| *s != slot);
            let hypothesis = &mut accepted.judged.hypothesis;
            hypothesis.edits = vec![Edit::Delay(slot, own + by)];
            let (size, word) = ((own + by).abs(), if own + by > 0.0 { "late" } else { "early" });
            hypothesis.what =
                format!("comes {size:.4} too {word}; with what is late beside it {same} and this one by {own:.4}");
        }
    }
    if alike.is_empty() {
        accepted.remove(k);
        return;
    }
    let hypothesis = &mut accepted[k].judged.hypothesis;
    let word = if alike.len() > 1 { "come together" } else { "comes" };
    hypothesis.what = format!("{word} {by:.4} too late, {same}");
    hypothesis.edits = alike.iter().map(|s| Edit::Delay(*s, by)).collect();
    hypothesis.slots = alike;
}

/// The edits of all accepted hypotheses but one.
fn edits(accepted: &[Accepted], without: Option<usize>) -> Vec<Edit> {
    let others = accepted.iter().enumerate().filter(|(k, _)| Some(*k) != without);
    others.flat_map(|(_, a)| a.judged.hypothesis.edits.iter().copied()).collect()
}

/// The edits of all accepted hypotheses, with another one in the place of one of them: a fault is as large as the edits before it have made it.
fn edits_with(accepted: &[Accepted], place: usize, other: &Hypothesis) -> Vec<Edit> {
    let of =
        |(k, a): (usize, &Accepted)| if k == place { other.edits.clone() } else { a.judged.hypothesis.edits.clone() };
    accepted.iter().enumerate().flat_map(of).collect()
}

/// Each accepted fault but the last beside what stood near it, given all others: the likelier one takes its place, and one that the others have made
/// unlikely is dropped.
fn examine_again(search: &Search<'_>, accepted: &mut Vec<Accepted>, current: &mut Trial) -> usize {
    let mut fits = 0;
    let mut k = 0;
    while k + 1 < accepted.len() {
        let others = edits(accepted, Some(k));
        let Some(without) = search.trial(&others, current) else {
            k += 1;
            continue;
        };
        fits += 1 + accepted[k].near.len();
        let own = &mut accepted[k].judged;
        own.log_odds = gain(own.hypothesis.fault, current, &without) + own.prior;
        let accepted_edits = &accepted[..];
        let again = |near: &Judged| {
            let trial = search.trial(&edits_with(accepted_edits, k, &near.hypothesis), &without)?;
            Some(Judged { log_odds: gain(near.hypothesis.fault, &trial, &without) + near.prior, trial, ..near.clone() })
        };
        let likelier = parallel::filter_map(accepted[k].near.iter(), again)
            .into_iter()
            .max_by(|a, b| a.log_odds.total_cmp(&b.log_odds));
        if let Some(better) = likelier.filter(|j| j.log_odds > accepted[k].judged.log_odds + 1.0) {
            *current = better.trial.clone();
            let before = std::mem::replace(&mut accepted[k].judged, better);
            let own = accepted[k].judged.hypothesis.clone();
            accepted[k].near.retain(|j| j.hypothesis != own);
            accepted[k].near.push(before);
        }
        if accepted[k].judged.log_odds <= search.options.odds.ln() {
            accepted.remove(k);
            *current = without;
        } else {
            k += 1;
        }
    }
    fits
}

/// One round: every hypothesis beside what was accepted, the likeliest first, and the number of fits.
fn round(search: &Search<'_>, accepted: &[Edit], current: &Trial) -> (Vec<Judged>, usize) {
    /// Of the fits that sort the hypotheses.
    const QUICK: usize = 6;
    /// Kinds of estimated faults for each channel, with their shares of the prior probability.
    const SHARE: f64 = 3.0;
    let channels = search.evidence.channels;
    let slots = search.slots();
    let fresh = |h: &Hypothesis| {
        let known = h.edits.iter().all(|e| accepted.contains(e));
        let wild = |e: &Edit| matches!(*e, Edit::Time(f) if search.evidence.pace.is_some_and(|p| f * p > FASTEST));
        !known && !h.edits.iter().any(wild)
    };
    let number = accepted.len() + 1;
    search.evidence.work.stage(&format!("a fault beside {} edits: units, signs, places, axes", number - 1));
    let tried: Vec<Hypothesis> = discrete(channels, &slots, search.timed).into_iter().filter(fresh).collect();
    let kinds = if search.options.estimated { SHARE * slots.len() as f64 } else { 0.0 };
    let whole = (tried.iter().map(|h| h.weight).sum::<f64>() + kinds).ln();
    let mut fits = tried.len();
    let judge = |hypothesis: Hypothesis| {
        let edits = with(accepted, &hypothesis.edits);
        let trial = if search.evidence.touches_model(&hypothesis.edits) {
            // another unit of time needs other steps
            let steps = Some(current).filter(|_| hypothesis.fault != Fault::TimeUnit);
            search.evidence.trial(Begin { model: None, steps }, &edits, QUICK)?
        } else {
            search.evidence.unfitted(current, &edits)
        };
        let prior = hypothesis.weight.ln() - whole;
        Some(Judged { log_odds: trial.gain_over(current) + prior, hypothesis, prior, trial })
    };
    let mut all: Vec<Judged> = parallel::filter_map(tried, judge);
    let far: Vec<(Slot, i64)> =
        if search.timed { far_delays(search.evidence, &slots, accepted, current) } else { Vec::new() };
    if (search.options.estimated || !far.is_empty()) && search.evidence.work.goes_on() {
        search
            .evidence
            .work
            .stage(&format!("a fault beside {} edits: delays, filters, zeros, factors, clocks", number - 1));
        let (found, tried) = estimated(search, &slots, accepted, (current, &far));
        fits += tried;
        let shifts = if search.options.estimated { shifts_of_zero(search, accepted, current) } else { Vec::new() };
        fits += shifts.len();
        all.extend(found.into_iter().chain(shifts).map(|judged| Judged {
            log_odds: judged.log_odds - whole,
            prior: judged.prior - whole,
            ..judged
        }));
    }
    let surest_first = |all: &mut Vec<Judged>| all.sort_by(|a, b| b.log_odds.total_cmp(&a.log_odds));
    surest_first(&mut all);
    // quick fits have sorted them; the first are fitted to the end
    for judged in all.iter_mut().take(REFINED).filter(|j| search.evidence.touches_model(&j.hypothesis.edits)) {
        let steps = Some(current).filter(|_| judged.hypothesis.fault != Fault::TimeUnit);
        let fitted =
            search.evidence.trial(Begin { model: None, steps }, &with(accepted, &judged.hypothesis.edits), THOROUGH);
        fits += 1;
        if let Some(trial) = fitted.filter(|t| t.gain_over(&judged.trial) > 0.0) {
            judged.trial = trial;
            judged.log_odds = judged.gain(current) + judged.prior;
        }
    }
    surest_first(&mut all);
    (all, fits)
}

/// Each fault that is estimated of a channel, with a first step of its size.
fn wanted(search_in: &Search<'_>, slots: &[Slot], interval: f64, span: f64) -> Vec<(Slot, Fault, f64)> {
    let (evidence, records) = (search_in.evidence, search_in.evidence.records);
    let mut wanted: Vec<(Slot, Fault, f64)> = Vec::new();
    for slot in slots.iter().copied() {
        let place = evidence.channels.place(slot);
        let deviation = variance(records.iter().flat_map(|r| r.channels[place].values.iter().copied())).sqrt();
        if deviation <= 0.0 || !deviation.is_finite() {
            continue;
        }
        if search_in.timed && interval > 0.0 {
            wanted.push((slot, Fault::Delay, 2.0 * interval));
            // what the clock of a channel has gained in the end, in intervals
            wanted.push((slot, Fault::Drift, 4.0 * interval / span));
            // a lag of an angle is not that of its turned values
            let turns =
                |k: usize| evidence.model.is_some_and(|m| m.layout().wraps.iter().any(|(o, _)| *o as usize == k));
            if !matches!(slot, Slot::Input(_)) && !matches!(slot, Slot::Output(k) if turns(k)) {
                wanted.push((slot, Fault::Filtered, 2.0 * interval));
            }
        }
        wanted.push((slot, Fault::Offset, 0.2 * deviation));
        wanted.push((slot, Fault::Scale, 0.1));
    }
    wanted
}

/// Delays, offsets, scale factors and drifts of each channel, with their best values; delays by many samples (`far`) alone where no others are wanted.
fn estimated(
    search_in: &Search<'_>,
    slots: &[Slot],
    accepted: &[Edit],
    (current, far): (&Trial, &[(Slot, i64)]),
) -> (Vec<Judged>, usize) {
    let evidence = search_in.evidence;
    let channels = evidence.channels;
    let (records, factor) = (evidence.records, time_factor(accepted));
    let intervals: Vec<f64> = records.iter().flat_map(|r| r.time.windows(2).map(|w| factor * (w[1] - w[0]))).collect();
    let interval = intervals.iter().sum::<f64>() / intervals.len().max(1) as f64;
    let span = factor * records.iter().filter_map(|r| r.time.last()).copied().fold(0.0, f64::max);
    let mut wanted = wanted(search_in, slots, interval, span);
    if !search_in.options.estimated {
        wanted.retain(|(slot, fault, _)| *fault == Fault::Delay && far.iter().any(|(late, _)| late == slot));
    }
    // one estimated number costs half the logarithm of the independent samples (Schwarz 1978)
    let needed = 0.5 * current.worth().max(1.0).ln() + search_in.options.odds.ln();
    let abouts = Abouts::of(evidence, current, accepted);
    let judge = |(slot, fault, step): &(Slot, Fault, f64), abouts: &Abouts<'_>| {
        let (slot, fault) = (*slot, *fault);
        let best = |fault: Fault, begin: f64, needed: f64| {
            let least = if fault == Fault::Filtered { 0.0 } else { f64::NEG_INFINITY };
            let edits = |value: f64| vec![edit(slot, fault, if fault == Fault::Scale { value.exp() } else { value })];
            search_in.best_about(&Number { begin, needed, least, edits: &edits }, accepted, current, abouts)
        };
        let found = best(fault, *step, needed);
        // the zero that kinematics want, whatever the model lacks
        let read = fault == Fault::Offset && evidence.touches_model(&[edit(slot, fault, *step)]);
        let of_kinematics = (read && evidence.kinematics.reads(channels.place(slot))).then(|| {
            let beside = |value: f64| -> Vec<Edit> { with(accepted, &[edit(slot, fault, value)]) };
            let at = |value: f64| Some(evidence.unfitted(current, &beside(value)));
            let Searched { value, error, trial } = search_number(*step, current, needed, &at)?;
            if trial.gain_of_kinematics(current) < needed {
                return None;
            }
            let trial = search_in.trial(&beside(value), current)?;
            Some(Searched { value, error, trial })
        });
        let lag = far.iter().find(|(late, _)| fault == Fault::Delay && *late == slot);
        let lag = lag.map(|(_, samples)| interval * *samples as f64);
        let far = lag.and_then(|lag| search_in.delay_about((slot, lag), *step, accepted, current));
        let all = found.into_iter().chain(of_kinematics.flatten()).chain(far);
        let of = |s: &Searched| gain(fault, &s.trial, current);
        let Searched { value, error, trial } = all.max_by(|a, b| of(a).total_cmp(&of(b)))?;
        // between samples a line stands for the motion: nothing is known more closely than the deviation of a place within an interval
        let error = if fault == Fault::Delay { error.max(interval / 12f64.sqrt()) } else { error };
        let penalty = 0.5 * trial.worth().max(1.0).ln();
        // a delay that may be one sample is a matter of stamps; what leaves more than nine tenths of every output's error is no fault either
        let matters = match fault {
            Fault::Delay => value.abs() - 2.0 * error >= interval,
            Fault::Filtered => value - 2.0 * error >= 0.5 * interval,
            Fault::Drift => value.abs() * span >= 2.0 * interval,
            _ => true,
        };
        if !matters || value.abs() < 4.0 * error || trial.least_left(current) > 0.9 {
            return None;
        }
        // a drift has to explain what a delay that stays does not
        if fault == Fault::Drift {
            let stays = best(Fault::Delay, 2.0 * interval, 0.0);
            if stays.is_some_and(|s| trial.cautious_gain_over(&s.trial) < search_in.options.odds.ln()) {
                return None;
            }
        }
        let unit = channels.unit(slot).map_or_else(String::new, |u| format!(" {u}"));
        let (value, error) = if fault == Fault::Scale { (value.exp(), value.exp() * error) } else { (value, error) };
        let (value, what) = told(fault, (value, error), &unit, span);
        // drifts and scale factors are rarer than delays and offsets. An input is early where all sensors are late together; one sensor is
        // early only where all others and the inputs are late alike
        let weight = match fault {
            Fault::Delay if value < 0.0 && matches!(slot, Slot::Input(_)) => 0.2,
            Fault::Delay if value < 0.0 => 0.01,
            Fault::Delay | Fault::Offset => 1.0,
            _ => 0.5,
        };
        let prior = f64::ln(weight) - penalty;
        let hypothesis = Hypothesis { fault, slots: vec![slot], edits: vec![edit(slot, fault, value)], what, weight };
        Some(Judged { log_odds: gain(fault, &trial, current) + prior, hypothesis, prior, trial })
    };
    let mut found: Vec<Judged> = parallel::filter_map(wanted.iter(), |w| judge(w, &abouts));
    // a fault leads the fit astray, and what is nearly the same fault leads back: all once more about the likeliest
    let likeliest =
        found.iter().max_by(|a, b| a.log_odds.total_cmp(&b.log_odds)).filter(|j| j.trial.estimate.is_some());
    if let Some(likeliest) = likeliest.filter(|j| evidence.touches_model(&j.hypothesis.edits)) {
        let fit = Linearised::of(evidence, &likeliest.trial, accepted);
        let about = Abouts { fit, text: None, near: &likeliest.trial };
        let known = |(slot, fault, _): &&(Slot, Fault, f64)| {
            found.iter().all(|j| j.hypothesis.fault != *fault || j.hypothesis.slots != [*slot])
        };
        let again: Vec<Judged> = parallel::filter_map(wanted.iter().filter(known), |w| judge(w, &about));
        found.extend(again);
    }
    // two fits at least for each
    (found, 2 * wanted.len())
}

/// What mends a fault of this size.
fn edit(slot: Slot, fault: Fault, value: f64) -> Edit {
    match fault {
        Fault::Delay => Edit::Delay(slot, value),
        Fault::Drift => Edit::Drift(slot, value),
        Fault::Filtered => Edit::Filter(slot, value),
        Fault::Offset => Edit::Affine(slot, 1.0, value),
        _ => Edit::Affine(slot, value, 0.0),
    }
}

/// A size as far as its error lets it be told, and the sentence about it.
fn told(fault: Fault, (value, error): (f64, f64), unit: &str, span: f64) -> (f64, String) {
    let places = places(value, error);
    let value: f64 = format!("{value:.places$}").parse().unwrap_or(value);
    let (size, error) = match error.is_finite() {
        true => (format!("{:.places$}", value.abs()), format!(" +- {error:.places$}")),
        false => (format!("{:.places$}", value.abs()), String::new()),
    };
    let what = match fault {
        Fault::Delay => format!("comes {size} too {}{error}", if value > 0.0 { "late" } else { "early" }),
        Fault::Drift => format!(
            "its clock {} {size} of every unit of time{error}, {:.4} over the record",
            if value > 0.0 { "gains" } else { "loses" },
            value.abs() * span
        ),
        Fault::Filtered => format!("went through a filter: a first-order lag of {size}{error}"),
        Fault::Offset => format!("is {size}{unit} too {}{error}", if value < 0.0 { "large" } else { "small" }),
        _ => format!("its numbers have to be multiplied by {size}{error}"),
    };
    (value, what)
}

/// Decimal places that leave a fifth of an error, or four digits where there is none.
fn places(value: f64, error: f64) -> usize {
    const MOST: f64 = 12.0;
    let least = if error.is_finite() && error > 0.0 { error / 5.0 } else { 1e-4 * value.abs() };
    (-least.log10().floor()).clamp(0.0, MOST) as usize
}

/// Outputs whose zero moves once, in one run: where the residuals before and behind differ most, and at once.
fn shifts_of_zero(search: &Search<'_>, accepted: &[Edit], current: &Trial) -> Vec<Judged> {
    /// Iterations of the fit that begins at the estimates.
    const NEAR: usize = 4;
    const FEWEST: usize = 20;
    let evidence = search.evidence;
    let [record] = evidence.records else { return Vec::new() };
    let (Some(model), Some(estimate)) = (evidence.model, &current.estimate) else { return Vec::new() };
    let q = model.layout().outputs;
    let Some(fit) = estimate.runs.first() else { return Vec::new() };
    let begun = current.begun(model);
    let judge = |output: usize| {
        let all = (0..record.time.len()).map(|k| (k, fit.residuals.get(k * q + output).copied().unwrap_or(f64::NAN)));
        let e: Vec<(usize, f64)> = all.filter(|(_, v)| v.is_finite()).collect();
        let n = e.len();
        if n < 4 * FEWEST {
            return None;
        }
        let total: f64 = e.iter().map(|(_, v)| v).sum();
        let (mut before, mut best) = (0.0, (0.0, 0, 0.0));
        for k in 1..=n - FEWEST {
            before += e[k - 1].1;
            let (left, right) = (k as f64, (n - k) as f64);
            let jump = (total - before) / right - before / left;
            let statistic = jump * jump * left * right;
            if k >= FEWEST && statistic > best.0 {
                best = (statistic, k, jump);
            }
        }
        let (_, k, jump) = best;
        // model error wanders; a zero that moves does so from one sample to the next, and not where an input jumps
        let (k, at_once) = jump_near(&e, k)?;
        if at_once / jump < 0.5 || input_jumps(record, e[k].0) {
            return None;
        }
        let (slot, at) = (Slot::Output(output), time_factor(accepted) * record.time[e[k].0]);
        let tried = |by: f64| {
            let all: Vec<Edit> = accepted.iter().copied().chain([Edit::Step(slot, at, by)]).collect();
            evidence.trial(Begin { model: Some(&begun), steps: Some(current) }, &all, NEAR)
        };
        // fitted parameters have taken some of the shift up: the size is searched from that of the residuals
        let sizes = [-jump, -1.5 * jump, -2.5 * jump];
        let trials = sizes.iter().filter_map(|by| Some((*by, tried(*by)?)));
        let (by, trial) =
            trials.max_by(|a, b| a.1.cautious_gain_over(current).total_cmp(&b.1.cautious_gain_over(current)))?;
        let worth = trial.worth().max(1.0).ln();
        // a size (Schwarz 1978), and a place among the independent samples
        let prior = 0.5f64.ln() - 1.5 * worth;
        // the jump that is seen at that sample is the one that was fitted
        if trial.least_left(current) > 0.9 || !(0.5..2.0).contains(&(-by / at_once)) {
            return None;
        }
        let unit = evidence.channels.unit(slot).map_or_else(String::new, |u| format!(" {u}"));
        let what = format!("its zero moves by {:.4}{unit} at {at:.4}", -by);
        let edits = vec![Edit::Step(slot, at, by)];
        let hypothesis = Hypothesis { fault: Fault::ZeroShift, slots: vec![slot], edits, what, weight: 0.5 };
        Some(Judged { log_odds: trial.cautious_gain_over(current) + prior, hypothesis, prior, trial })
    };
    parallel::filter_map(0..q, judge)
}

/// Samples on each side of a jump.
const SIDE: usize = 8;

/// How far lines through the samples before and behind each sample are apart halfway to the sample before it.
fn jumps(e: &[(usize, f64)]) -> Vec<f64> {
    // a line through SIDE samples, read half an interval beyond its end
    let n = SIDE as f64;
    let middle = 0.5 * (n - 1.0);
    let spread = n * (n * n - 1.0) / 12.0;
    let weight = |i: usize| 1.0 / n + (n - 0.5 - middle) * (i as f64 - middle) / spread;
    let at = |k: usize| {
        let before: f64 = (0..SIDE).map(|i| weight(i) * e[k - SIDE + i].1).sum();
        let behind: f64 = (0..SIDE).map(|i| weight(SIDE - 1 - i) * e[k + i].1).sum();
        behind - before
    };
    (SIDE..e.len().saturating_sub(SIDE - 1)).map(at).collect()
}

/// The sample near this one before which residuals jump, and how far, where that is far beyond all other places.
fn jump_near(e: &[(usize, f64)], k: usize) -> Option<(usize, f64)> {
    /// Of a jump as large by chance at any sample.
    const CHANCE: f64 = 0.01;
    let all = jumps(e);
    let places = k.saturating_sub(3).max(SIDE)..(k + 4).min(SIDE + all.len());
    let at = places.max_by(|a, b| all[a - SIDE].abs().total_cmp(&all[b - SIDE].abs()))?;
    // the jump itself is seen by all that are near
    let others = all.iter().enumerate().filter(|(i, _)| (i + SIDE).abs_diff(at) > 2 * SIDE);
    let mut sizes: Vec<f64> = others.map(|(_, v)| v.abs()).collect();
    let jump = all[at - SIDE];
    (Tail::new(&mut sizes)?.exceeded(jump.abs()) < CHANCE).then_some((at, jump))
}

/// Whether an input jumps within two samples of this one, beside what it does usually.
fn input_jumps(record: &Record, sample: usize) -> bool {
    record.channels.iter().filter(|c| c.role == Role::Input).any(|c| {
        let mut steps: Vec<f64> = c.values.windows(2).map(|w| (w[1] - w[0]).abs()).collect();
        let near = sample.saturating_sub(3)..(sample + 2).min(steps.len());
        let largest = steps[near].iter().copied().fold(0.0, f64::max);
        let at = steps.len() * 9 / 10;
        let usual = if steps.is_empty() { 0.0 } else { *steps.select_nth_unstable_by(at, f64::total_cmp).1 };
        largest > 2.0 * usual
    })
}

/// Edits beside those that were accepted before.
fn with(accepted: &[Edit], edits: &[Edit]) -> Vec<Edit> {
    accepted.iter().chain(edits).copied().collect()
}

impl Search<'_> {
    /// The channels about which there is evidence.
    fn slots(&self) -> Vec<Slot> {
        let (evidence, channels) = (self.evidence, self.evidence.channels);
        let known = |s: &Slot| {
            let compared = evidence.model.is_some() && !matches!(s, Slot::Other(_));
            compared || evidence.kinematics.reads(channels.place(*s))
        };
        channels.slots().filter(known).collect()
    }

    /// The best value of a number about a fit with these edits.
    fn best(&self, number: &Number<'_>, accepted: &[Edit], current: &Trial) -> Option<Searched> {
        self.best_about(number, accepted, current, &Abouts::of(self.evidence, current, accepted))
    }

    /// The best value of a number where the fit has been linearised: about its estimates, and about the values of the
    /// text, as a fault may have led the fit astray. Without derivatives, or where nothing of the model is touched,
    /// each value is tried as it is.
    fn best_about(
        &self,
        number: &Number<'_>,
        accepted: &[Edit],
        current: &Trial,
        abouts: &Abouts<'_>,
    ) -> Option<Searched> {
        let evidence = self.evidence;
        let touched = evidence.touches_model(&(number.edits)(number.begin));
        let Some(about) = abouts.fit.as_ref().filter(|_| touched) else {
            let at = |value: f64| match touched {
                true => self.fitted(number, value, accepted, Some(current), current),
                false => Some(evidence.unfitted(current, &number.beside(accepted, value)?)),
            };
            return search_number(number.begin, current, number.needed, &at);
        };
        let about_fit = self.best_from(number, accepted, current, about, Some(abouts.near));
        let about_text = abouts.text.as_ref().and_then(|text| self.best_from(number, accepted, current, text, None));
        match (about_fit, about_text) {
            (Some(fit), Some(text)) => Some(if text.trial.cautious_gain_over(&fit.trial) > 0.0 { text } else { fit }),
            (fit, text) => fit.or(text),
        }
    }

    /// The best delay of a channel about one that is far from 0.
    fn delay_about(&self, (slot, lag): (Slot, f64), step: f64, accepted: &[Edit], current: &Trial) -> Option<Searched> {
        let at = |more: f64| {
            let edits = with(accepted, &[Edit::Delay(slot, lag + more)]);
            self.evidence.trial(Begin { model: None, steps: Some(current) }, &edits, THOROUGH)
        };
        let there = at(0.0)?;
        let near = search_number(step, &there, 0.0, &at);
        // a sample it is, and no better one was found between its neighbours
        let on_the_spot = Searched { value: 0.0, error: 0.0, trial: there };
        near.or(Some(on_the_spot)).map(|found| Searched { value: lag + found.value, ..found })
    }

    /// A fit with a value of a number: from the estimates of a fit that is near, or from the text.
    fn fitted(
        &self,
        number: &Number<'_>,
        value: f64,
        accepted: &[Edit],
        near: Option<&Trial>,
        steps: &Trial,
    ) -> Option<Trial> {
        /// Iterations of fits that begin at the estimates of one that is near.
        const NEAR: usize = 8;
        let begun = near.and_then(|near| Some(near.begun(self.evidence.model?)));
        let iterations = if near.is_some() { NEAR } else { THOROUGH };
        let begin = Begin { model: begun.as_ref(), steps: Some(steps) };
        self.evidence.trial(begin, &number.beside(accepted, value)?, iterations)
    }

    /// The number is searched about a linearisation, the record is fitted there, and so on while that gains.
    fn best_from(
        &self,
        number: &Number<'_>,
        accepted: &[Edit],
        current: &Trial,
        about: &Linearised<'_>,
        near: Option<&Trial>,
    ) -> Option<Searched> {
        const ROUNDS: usize = 4;
        /// Nats that another round must gain.
        const WORTH: f64 = 0.5;
        let mut found = Searched { value: 0.0, error: f64::INFINITY, trial: current.clone() };
        for round in 0..ROUNDS {
            let begun = if round == 0 { accepted.to_vec() } else { number.beside(accepted, found.value)? };
            let anew = if round == 0 { None } else { Linearised::of(self.evidence, &found.trial, &begun) };
            let about = if round == 0 {
                about
            } else if let Some(anew) = &anew {
                anew
            } else {
                break;
            };
            // a fit that has not quite ended gains by the step alone
            let Some(here) = about.trial(&begun) else { break };
            let (step, needed) =
                if round == 0 { (number.begin, number.needed) } else { (0.1 * found.value.abs(), 0.0) };
            let at = |by: f64| about.trial(&number.beside(accepted, found.value + by)?);
            let Some(next) = search_number(step, &here, needed, &at) else { break };
            let promises = |over: &Trial| next.trial.cautious_gain_over(over) >= 0.5 * needed;
            // elsewhere than about the fit it has to be likelier than that as well
            if round == 0 && !(promises(&here) && promises(current)) {
                return None;
            }
            // a step that is too long for a nonlinear model is halved once
            let before = &found.trial;
            let begin = if round == 0 { near } else { Some(before) };
            let tried = [next.value, 0.5 * next.value].into_iter().find_map(|by| {
                let trial = self.fitted(number, found.value + by, accepted, begin, before)?;
                (trial.cautious_gain_over(before) > 0.0).then_some((by, trial))
            });
            let Some((by, trial)) = tried else { break };
            let gain = trial.cautious_gain_over(before);
            found = Searched { value: found.value + by, error: next.error, trial };
            if gain < WORTH || by.abs() < 0.25 * next.error {
                break;
            }
        }
        (found.value != 0.0).then_some(found)
    }

    /// A fault that is accepted, fitted on steps of its own.
    fn settled(&self, mut best: Judged, accepted: &[Edit], current: &Trial) -> Judged {
        let edits = with(accepted, &best.hypothesis.edits);
        if let Some(model) = self.evidence.model.filter(|_| self.evidence.touches_model(&best.hypothesis.edits)) {
            let begun = best.trial.begun(model);
            if let Some(trial) = self.evidence.trial(Begin { model: Some(&begun), steps: None }, &edits, THOROUGH) {
                best.log_odds = gain(best.hypothesis.fault, &trial, current) + best.prior;
                best.trial = trial;
            }
        }
        best
    }

    /// A fit to the end, or one from the estimates of another that is near, whichever is likelier.
    fn trial(&self, edits: &[Edit], near: &Trial) -> Option<Trial> {
        let begun: Option<Model> = self.evidence.model.map(|model| near.begun(model));
        let one = self.evidence.trial(Begin { model: None, steps: Some(near) }, edits, THOROUGH);
        let other = self.evidence.trial(Begin { model: begun.as_ref(), steps: Some(near) }, edits, THOROUGH);
        if !self.evidence.work.goes_on() {
            return None;
        }
        match (one, other) {
            (Some(one), Some(other)) => Some(if other.gain_over(&one) > 0.0 { other } else { one }),
            (one, other) => one.or(other).or_else(|| self.evidence.unexplained(edits)),
        }
    }

    /// Whether it is as well something that the model may lack: a constant that moves its inputs, or a lag between all inputs and all outputs.
    fn is_addition(&self, hypothesis: &Hypothesis) -> bool {
        match (hypothesis.fault, &hypothesis.slots[..]) {
            (Fault::Offset, [Slot::Input(_)]) => true,
            (Fault::Filtered, [slot]) => self.is_alone(*slot),
            _ => false,
        }
    }

    /// Whether what a model may lack does what the fault does: constants are constants, and lags are late.
    fn is_addition_for(&self, addition: &Hypothesis, fault: &Hypothesis) -> bool {
        let late = |h: &Hypothesis| match (h.fault, &h.slots[..], &h.edits[..]) {
            (Fault::Filtered, ..) => true,
            (Fault::Delay, [slot @ Slot::Output(_)], [Edit::Delay(_, by)]) => *by > 0.0 && self.is_alone(*slot),
            (Fault::Delay, [Slot::Input(_)], [Edit::Delay(_, by)]) => *by < 0.0,
            _ => false,
        };
        self.is_addition(addition)
            && match addition.fault {
                Fault::Offset => fault.fault == Fault::Offset,
                _ => late(fault),
            }
    }

    /// Whether a fault with an estimated number holds in all parts of the records: what is always there makes no part less likely, and what the
    /// model lacks is taken away in some parts at the cost of others. Kinematics knows no model that could lack anything.
    fn holds_everywhere(&self, judged: &Judged, with: &Trial, without: &Trial) -> bool {
        /// Of the evidence for it, that against it.
        const AGAINST: f64 = 0.25;
        let always = matches!(
            judged.hypothesis.fault,
            Fault::Delay | Fault::Offset | Fault::Scale | Fault::Filtered | Fault::Drift
        );
        if !always || with.gain_of_kinematics(without) > self.options.odds.ln() {
            return true;
        }
        let gains = with.gains_by_part(without);
        let sum = |side: f64| gains.iter().map(|g| (side * g).max(0.0)).sum::<f64>();
        sum(-1.0) <= AGAINST * sum(1.0)
    }

    /// Whether a channel is all that the model is compared with, and stands in no kinematics.
    fn is_alone(&self, slot: Slot) -> bool {
        let evidence = self.evidence;
        matches!(slot, Slot::Output(_))
            && evidence.model.is_some_and(|m| m.layout().outputs == 1)
            && !evidence.kinematics.reads(evidence.channels.place(slot))
    }

    /// Whether what the model may lack explains the evidence for an accepted fault. A lag and a delay exclude each other, and the likelier one counts.
    /// Constants add up, as a trim that the model lacks and the zero of a sensor may both be there: so the fault counts as it is beside
    /// the other one. What kinematics says of a zero no trim explains.
    fn doubted(&self, accepted: &[Accepted], k: usize, log_odds: f64, without: Option<&Trial>) -> bool {
        let own = &accepted[k];
        let hypothesis = &own.judged.hypothesis;
        own.near.iter().any(|near| {
            if !self.is_addition_for(&near.hypothesis, hypothesis) || near.log_odds <= own.judged.log_odds - DOUBT.ln()
            {
                return false;
            }
            let Some(without) = without.filter(|_| near.hypothesis.fault == Fault::Offset) else { return true };
            let beside = |edits: Vec<Edit>| self.trial(&with(&edits, &near.hypothesis.edits), without);
            let (alone, both) = (beside(edits(accepted, Some(k))), beside(edits(accepted, None)));
            let (Some(alone), Some(both)) = (alone, both) else { return true };
            let left = gain(hypothesis.fault, &both, &alone) + own.judged.prior;
            left.min(log_odds) < DOUBT.ln()
        })
    }

    fn told(&self, accepted: &Accepted, log_odds: f64, doubts: Doubts, factor: f64) -> Finding {
        let channels = self.evidence.channels;
        let hypothesis = &accepted.judged.hypothesis;
        let mut names: Vec<String> = hypothesis.slots.iter().map(|s| channels.name(*s).to_string()).collect();
        if names.is_empty() {
            names.push("t".into());
        }
        let mut what = hypothesis.what.clone();
        let near = accepted.near.iter().filter(|j| j.log_odds > accepted.judged.log_odds - 10f64.ln()).take(3);
        let list: Vec<String> = near.map(|j| sentence(channels, &j.hypothesis)).collect();
        if !list.is_empty() {
            what.push_str(&format!("; nearly as likely: {}", list.join(", or ")));
        }
        // a fault of the record is what nothing that the model may lack explains as well
        let Doubts { everywhere, doubted } = doubts;
        let lacking = self.is_addition_for(hypothesis, hypothesis) || doubted;
        if lacking {
            what.push_str(match hypothesis.fault {
                Fault::Offset => "; a constant that the model lacks, a trim, would do the same",
                _ => "; a lag that the model lacks would do the same",
            });
        }
        if !everywhere {
            what.push_str("; parts of the record contradict it, so that it may be what the model lacks");
        }
        let records = self.evidence.records;
        let run = if let [record] = records { record.run.clone() } else { "all".into() };
        let behind = hypothesis.edits.iter().find_map(|e| if let Edit::Step(_, at, _) = e { Some(*at) } else { None });
        // behind a unit of time that was mended, in the times of the record
        let place = behind.zip(records.first()).and_then(|(at, record)| {
            let first = record.time.iter().position(|t| factor * t >= at)?;
            let (from, samples) = (record.time[first], record.time.len() - first);
            Some(Place { from, to: record.time.last().copied().unwrap_or(from), samples })
        });
        Finding {
            run,
            channels: names,
            fault: hypothesis.fault,
            severity: if lacking || !everywhere { Severity::Remark } else { Severity::Finding },
            place,
            what,
            log_odds,
            biases: Vec::new(),
            repair: Some(channels.repair(&hypothesis.edits)),
            samples: Vec::new(),
        }
    }
}

fn sentence(channels: &Channels, hypothesis: &Hypothesis) -> String {
    let names: Vec<&str> = hypothesis.slots.iter().map(|s| channels.name(*s)).collect();
    match names[..] {
        [] => hypothesis.what.clone(),
        [first, ..] => format!("`{first}` {}", hypothesis.what),
    }
}
