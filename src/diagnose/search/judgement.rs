//! Which effect is named: scores, the group that cannot be told apart, and what makes an effect acceptable.

use super::beside::cosine;
use super::contender::Contender;
use super::contest::Contest;
use super::experiment::separating;
use super::own_motion::repeated;
use super::round::{PRICE, Round, place};
use crate::diagnose::diagnosis::{Cause, NewValue, Rejected, Rival};
use crate::estimate::ParameterEstimate;
use fdm_grammar::effect::NewParam;

/// Scores that differ by less cannot be told apart: odds of 100 : 1, as a cause is believed at a chance of 0.01.
pub(super) const LEAD: f64 = 4.6;
/// Least score of an effect that is named.
const LEAST: f64 = 3.0;
/// Least gain on the runs that are learned from: that of a size of two standard errors. (Wald's size itself says little where an
/// effect has parameters of its own that correlate with it.)
const SIZE: f64 = 2.0;
/// Loss on held-out runs below which they say nothing.
const HEARD: f64 = 0.5;

/// Why a contender is not accepted; none when it is.
pub(super) fn objection(round: &Round<'_>, contender: &Contender) -> Option<String> {
    if contender.score() < LEAST {
        return Some(format!(
            "the gain of {:.1} does not pay for {} (3 each)",
            contender.score() + PRICE * contender.cost as f64,
            if contender.cost == 1 { "its parameter".into() } else { format!("its {} parameters", contender.cost) }
        ));
    }
    if let Some((gain, _)) = &contender.held
        && *gain <= 0.0
    {
        return Some(match *gain > -HEARD {
            true => {
                "the held-out runs are matched as well without it; one that moves what it acts on would tell".into()
            }
            false => format!("on the held-out runs it loses {:.1} in log-likelihood", -gain),
        });
    }
    if let Some(frequency) = repeated(round, contender) {
        return Some(format!(
            "its mode ({frequency:.3} rad per unit of time) is the model's own motion once more, and nothing else drives it: it \
             stands for damping or stiffness that changes with the amplitude"
        ));
    }
    (contender.gain < SIZE).then(|| {
        format!(
            "it gains {:.1} on the runs that were fitted, what two standard errors are worth is {SIZE}",
            contender.gain
        )
    })
}

/// The contender as a cause, accepted at a chance, with the group of those that score about as much.
pub(super) fn cause(round: &Round<'_>, contest: &Contest, (chosen, p): (usize, f64)) -> Cause {
    let contender = &contest.contenders[chosen];
    let attached = &round.traces[contender.trace].attached;
    let least = contender.score() - LEAD;
    let others = contest.contenders.iter().enumerate();
    let close = others.filter(|(k, c)| *k == chosen || c.score() > least.max(0.0));
    let rival = |(_, c): (usize, &Contender)| Rival {
        place: place(&round.traces[c.trace].attached.candidate),
        gain_train: c.gain,
        gain_holdout: c.held.as_ref().map(|(gain, _)| *gain),
        score: c.score(),
        cosine: cosine(&c.direction, &contender.direction).abs(),
    };
    let mut group: Vec<Rival> = close.map(rival).collect();
    let own = place(&attached.candidate);
    group.sort_by_key(|r| r.place != own);
    let separating_experiment = group.get(1).map(|other| separating(&own, &other.place));
    Cause {
        place: own,
        doc: attached.candidate.doc(),
        parameters: attached.params().iter().filter_map(|p| new_value(p, contender)).collect(),
        gain_train: contender.gain,
        gain_holdout: contender.held.as_ref().map(|(gain, _)| *gain),
        gain_predicted: contender.predicted,
        score: contender.score(),
        p,
        group,
        separating_experiment,
    }
}

fn new_value(param: &NewParam, contender: &Contender) -> Option<NewValue> {
    if param.begins_as.is_some() {
        return None;
    }
    let estimate = contender.fitting.shared(&param.name)?;
    Some(value_of(param, estimate))
}

/// A new parameter with its estimate.
pub(super) fn value_of(param: &NewParam, estimate: &ParameterEstimate) -> NewValue {
    NewValue {
        name: param.name.clone(),
        doc: param.doc.clone(),
        value: estimate.value,
        standard_error: estimate.error(),
        unit: param.unit.as_ref().map(|u| u.text().to_string()),
        null: (!param.nuisance).then_some(param.null),
    }
}

/// A contender that was not taken.
pub(super) fn rejected(round: &Round<'_>, number: usize, contender: &Contender, reason: String) -> Rejected {
    Rejected {
        place: place(&round.traces[contender.trace].attached.candidate),
        round: number,
        gain_train: contender.gain,
        gain_holdout: contender.held.as_ref().map(|(gain, _)| *gain),
        reason,
    }
}
