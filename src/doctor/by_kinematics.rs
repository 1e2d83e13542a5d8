//! Faults as kinematics tell them, where no model does: forward selection of edits by what the equations leave.

use crate::catalogue::{Estimated, Hypothesis, discrete};
use crate::edit::{Channels, Edit, Slot};
use crate::finding::{Fault, Finding};
use crate::independent::variance;
use crate::kinematics::{Balance, Kinematics};
use crate::record::Record;
use fdm_numeric::parallel;

/// Faults that are told at most.
const MOST: usize = 3;
/// Odds that a fault must have.
const ODDS: f64 = 20.0;
/// Errors that an estimated size must have.
const SIGMAS: f64 = 4.0;
/// Part of every equation's error that may be left by an estimated fault.
const LEFT: f64 = 0.9;
/// Kinds of estimated faults for each channel, with their shares of the prior probability.
const SHARE: f64 = 3.0;

/// Records beside the equations that hold between their channels.
pub struct Witness<'a> {
    /// The equations.
    pub kinematics: &'a Kinematics,
    /// The records.
    pub records: &'a [Record],
    /// Their channels.
    pub channels: &'a Channels,
}

/// A size with its error, and what is gained by it.
#[derive(Debug, Clone, Copy)]
pub struct Sized {
    /// The size.
    pub size: f64,
    /// Its standard error.
    pub error: f64,
    /// Nats over none.
    pub gain: f64,
}

impl Witness<'_> {
    /// What the equations leave.
    pub fn balances(&self, edits: &[Edit]) -> Vec<Balance> {
        self.kinematics.balances(self.records, self.channels, edits)
    }

    /// What edits gain in log-likelihood over these balances, in nats.
    pub fn gain(&self, edits: &[Edit], over: &[Balance]) -> f64 {
        gain(&self.balances(edits), over)
    }

    /// Faults as these equations alone tell them, the surest first.
    pub fn faults(&self) -> Vec<Finding> {
        if self.kinematics.is_empty() { Vec::new() } else { faults(self).0 }
    }

    /// Whether a channel stands in one of the equations.
    pub fn reads(&self, slot: Slot) -> bool {
        self.kinematics.reads(self.channels.place(slot))
    }

    /// Time between samples, on average, and the length of the longest record.
    pub fn times(&self) -> (f64, f64) {
        let steps = || self.records.iter().flat_map(|r| r.time.windows(2).map(|w| w[1] - w[0]));
        let span = self.records.iter().filter_map(|r| r.time.last()).copied().fold(0.0, f64::max);
        (steps().sum::<f64>() / steps().count().max(1) as f64, span)
    }

    /// The size of a fault that these equations want beside other edits, by which something is gained at all.
    pub fn size(&self, fault: Estimated, factor: f64, accepted: &[Edit]) -> Option<Sized> {
        let before = self.balances(accepted);
        let (interval, span) = self.times();
        let place = self.channels.place(fault.slot);
        let deviation = variance(self.records.iter().flat_map(|r| r.channels[place].values.iter().copied())).sqrt();
        let first = match fault.fault {
            Fault::Delay | Fault::Filtered => 2.0 * factor * interval,
            Fault::Drift => 4.0 * interval / span,
            Fault::Offset => 0.2 * deviation,
            _ => 0.1,
        };
        let least = if fault.fault == Fault::Filtered { 0.0 } else { f64::NEG_INFINITY };
        let at = |size: f64| {
            let edits: Vec<Edit> = accepted.iter().copied().chain([fault.edit(size)]).collect();
            if size > least { self.gain(&edits, &before) } else { f64::NEG_INFINITY }
        };
        if first > 0.0 { climbed(first, &at) } else { None }
    }
}

/// The likeliest size: uphill from none with steps that grow, then the vertex of the parabola through three sizes.
fn climbed(first: f64, at: &dyn Fn(f64) -> f64) -> Option<Sized> {
    const ROUNDS: usize = 8;
    let (mut size, mut best, mut width, mut error) = (0.0, 0.0, first, f64::INFINITY);
    for _ in 0..ROUNDS {
        let (l, r) = (at(size - width) - best, at(size + width) - best);
        if l > 0.0 || r > 0.0 {
            let side = if l > r { -width } else { width };
            (size, best) = (size + side, best + l.max(r));
            width *= 1.7;
            continue;
        }
        if !l.is_finite() || !r.is_finite() {
            width *= 0.5;
            continue;
        }
        let curvature = -(l + r) / (width * width);
        if curvature <= 0.0 {
            break;
        }
        error = 1.0 / curvature.sqrt();
        let vertex = size + 0.5 * (r - l) / width / curvature;
        let there = at(vertex);
        if there > best {
            (size, best) = (vertex, there);
        }
        if width < 2.0 * error {
            break;
        }
        width = (0.25 * width).max(error);
    }
    (size != 0.0 && best > 0.0).then_some(Sized { size, error, gain: best })
}

/// Gain in log-likelihood of balances over others, by the independent windows of those that leave less.
fn gain(own: &[Balance], others: &[Balance]) -> f64 {
    let of = |(own, other): (&Balance, &Balance)| {
        let (a, b) = (own.unexplained, other.unexplained);
        if a.is_nan() || b.is_nan() {
            return other.cost - own.cost;
        }
        let worth = if a < b { own.independent } else { other.independent };
        0.5 * worth * (b.max(f64::MIN_POSITIVE) / a.max(f64::MIN_POSITIVE)).ln() + other.cost - own.cost
    };
    own.iter().zip(others).map(of).sum()
}

/// A hypothesis that was weighed.
struct Weighed {
    hypothesis: Hypothesis,
    log_odds: f64,
}

/// All faults that are likely, the surest first, and what mends them.
pub(crate) fn faults(witness: &Witness<'_>) -> (Vec<Finding>, Vec<Edit>) {
    let (mut findings, mut accepted): (Vec<Finding>, Vec<Edit>) = (Vec::new(), Vec::new());
    while findings.len() < MOST {
        let mut all = round(witness, &accepted);
        all.sort_by(|a, b| b.log_odds.total_cmp(&a.log_odds));
        let Some(best) = all.first().filter(|b| b.log_odds > ODDS.ln()) else { break };
        let mut finding = best.hypothesis.finding(witness.records, witness.channels, best.log_odds);
        let near = all[1..].iter().filter(|j| j.log_odds > best.log_odds - 10f64.ln()).take(3);
        let list: Vec<String> = near.map(|j| j.hypothesis.sentence(witness.channels)).collect();
        if !list.is_empty() {
            finding.what.push_str(&format!("; nearly as likely: {}", list.join(", or ")));
        }
        accepted.extend(best.hypothesis.edits.iter().copied());
        findings.push(finding);
    }
    (findings, accepted)
}

fn round(witness: &Witness<'_>, accepted: &[Edit]) -> Vec<Weighed> {
    let Witness { channels, .. } = *witness;
    let slots: Vec<Slot> = channels.slots().filter(|s| witness.reads(*s)).collect();
    let before = witness.balances(accepted);
    let fresh = |h: &Hypothesis| !h.edits.iter().all(|e| accepted.contains(e));
    let tried: Vec<Hypothesis> = discrete(channels, &slots, true).into_iter().filter(fresh).collect();
    let whole = (tried.iter().map(|h| h.weight).sum::<f64>() + SHARE * slots.len() as f64).ln();
    let factor = crate::edit::time_factor(accepted);
    let (interval, span) = witness.times();
    let weigh = |hypothesis: Hypothesis| {
        let edits: Vec<Edit> = accepted.iter().chain(&hypothesis.edits).copied().collect();
        Weighed { log_odds: witness.gain(&edits, &before) + hypothesis.weight.ln() - whole, hypothesis }
    };
    let mut all: Vec<Weighed> = parallel::map(tried, weigh);
    let kinds = [Fault::Delay, Fault::Drift, Fault::Filtered, Fault::Offset, Fault::Scale];
    let exact = witness.kinematics.clone().exact();
    let witness = &Witness { kinematics: &exact, ..*witness };
    let before = witness.balances(accepted);
    let sized = slots.iter().filter(|s| witness.reads(**s));
    let pairs: Vec<Estimated> = sized.flat_map(|slot| kinds.map(|fault| Estimated::new(fault, *slot))).collect();
    // an estimated number costs half the logarithm of the independent windows (Schwarz 1978)
    let worth = before.iter().map(|b| b.independent).sum::<f64>().max(1.0);
    let estimate = |fault: Estimated| {
        let Sized { size, error, gain } = witness.size(fault, factor, accepted)?;
        let error = if fault.fault == Fault::Delay { error.max(interval / 12f64.sqrt()) } else { error };
        let matters = match fault.fault {
            Fault::Delay => size.abs() - 2.0 * error >= interval,
            Fault::Filtered => size - 2.0 * error >= 0.5 * interval,
            Fault::Drift => size.abs() * span >= 2.0 * interval,
            _ => true,
        };
        let edits: Vec<Edit> = accepted.iter().copied().chain([fault.edit(size)]).collect();
        let left = witness
            .balances(&edits)
            .iter()
            .zip(&before)
            .map(|(own, other)| own.unexplained / other.unexplained)
            .fold(1.0, f64::min);
        if !matters || size.abs() < SIGMAS * error || left > LEFT {
            return None;
        }
        let hypothesis = fault.told((size, error), channels, factor * span);
        Some(Weighed { log_odds: gain + hypothesis.weight.ln() - 0.5 * worth.ln() - whole, hypothesis })
    };
    all.extend(parallel::filter_map(pairs, estimate));
    all
}
