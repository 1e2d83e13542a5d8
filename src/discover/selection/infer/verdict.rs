//! From runs and a catalogue to a diagnosis by evidence.

use super::super::acceptance::separating;
use super::super::assessment::{output_gains, overlays, run_gains};

use super::super::error::DiagnosisError;
use super::super::extended_model::place;
use super::super::fitted_model::FittedModel;
use super::super::initial_fit::{Thoroughness, initial_fits, plain_fit};
use super::super::runs::{DiagnosisOptions, Runs};
use super::super::whitening::CommonNoise;
use super::super::written_model::{WrittenModel, at_values, written_model};
use super::binning::Binning;
use super::search::{Found, Search};
use super::state::{Ground, State};
use crate::diagnosis::{Alternative, Cause, Diagnosis, NewValue, Rejected, Screened, SelectionStep, Verdict};
use crate::noise::LogSpectrum;
use fdm_effects::{Candidate, Catalogue};
use fdm_estimate::Work;
use fdm_system::model::Model;
use std::collections::BTreeSet;

/// Ratio of squared errors on validation runs up to which a set predicts as well.
const AS_WELL: f64 = 1.02;

/// Finds what is missing by evidence.
pub(in super::super) fn diagnose(
    model: &Model,
    runs: Runs<'_>,
    catalogue: &Catalogue,
    (options, work): (&DiagnosisOptions, &Work<'_>),
    names: &BTreeSet<String>,
) -> Result<Diagnosis, DiagnosisError> {
    work.stage("fitting the base model");
    let first = initial_fits(model, runs, options, work)?.into_iter().next();
    let first = first.ok_or_else(|| DiagnosisError::NoFit("it has no end".into()))?;
    let places = catalogue.places(&first.subject);
    let fresh = |c: &Candidate| c.targets().iter().all(|t| names.contains(t));
    let candidates: Vec<Candidate> = places.candidates.into_iter().filter(fresh).collect();
    let all = Runs { train: runs.all.len(), ..runs };
    let binning = Binning::new(&first, all);
    let q = first.outputs();
    let deviation = |o: usize| {
        let values: Vec<f64> =
            runs.all.iter().flat_map(|run| run.measured.iter().skip(o).step_by(q)).copied().filter(|z| !z.is_nan()).collect();
        let n = values.len().max(1) as f64;
        let mean = values.iter().sum::<f64>() / n;
        (values.iter().map(|z| (z - mean).powi(2)).sum::<f64>() / n).sqrt().max(f64::MIN_POSITIVE)
    };
    let deviations = (0..q).map(deviation).collect();
    let ground = Ground { runs: all, binning, candidates: candidates.len(), deviations, work };
    let base = State::base(&first, all).ok_or_else(|| DiagnosisError::NoFit("it has no response".into()))?;
    work.stage(&format!("searching among {} candidates", candidates.len()));
    let naive = first.response.clone();
    let plain = |state: &State| -> Option<WrittenModel> {
        let fitted = state.fitted(runs)?;
        let found = plain_fit(&fitted, &state.theta, runs, (options, work), Thoroughness::Near).ok()?;
        at_values(&found, &found.theta, &naive, runs)
    };
    let predicts = |new: &State, old: &State| {
        if runs.validation().is_empty() {
            return true;
        }
        let ratio = |state: &State| plain(state).and_then(|w| w.validation).unwrap_or(f64::INFINITY);
        ratio(new) <= AS_WELL * ratio(old)
    };
    let search = Search { ground: &ground, base, candidates: &candidates, most: options.most, predicts: &predicts };
    let found = search.run().ok_or_else(|| DiagnosisError::NoFit("it has no derivatives at the estimates".into()))?;
    let (state, judged) = &found.best;
    let gained = judged.log - found.null.1.log;
    let timed = std::env::var_os("FDM_TIMES").map(|_| std::time::Instant::now());
    let disturbances = ground.disturbances((&found.null.0, &found.null.1));
    let laws = ground.laws((&found.null.0, &found.null.1));
    if let Some(begun) = timed {
        eprintln!("unnamed {:?} after", begun.elapsed());
        disturbances.iter().chain(&laws).take(12).for_each(|u| eprintln!("{} {:?} {:.1}", u.place, u.signal, u.log));
        eprintln!("effects {gained:.1}");
    }
    let best = |list: &[super::random_effect::Unnamed]| list.first().map_or(f64::NEG_INFINITY, |u| u.log);
    let named = if state.effects.is_empty() { 0.0 } else { gained };
    let verdict = match (best(&disturbances), best(&laws)) {
        (d, l) if d > named && d > l => Verdict::Disturbance,
        (_, l) if l > named => Verdict::UnknownCause,
        _ if state.effects.is_empty() => Verdict::NoEffectFound,
        _ => Verdict::EffectFound,
    };
    let written = if verdict != Verdict::EffectFound {
        None
    } else {
        let fitted = state.fitted(runs).ok_or_else(|| DiagnosisError::NoFit("the extended model has no response".into()))?;
        written_model(&fitted, &state.theta, &naive, (runs, options, work), Thoroughness::Once).ok()
    };
    let effect = verdict == Verdict::EffectFound;
    let told: Vec<Cause> = found.causes.iter().filter(|_| effect).map(|cause| told(&found.best, cause)).collect();
    let variance = |o: usize| {
        let left = runs.all.iter().enumerate().flat_map(|(r, run)| {
            let after = written.as_ref().map_or(&first.response[r], |w| &w.fitted.response[r]);
            first.predictors[r].left_by(run, after).into_iter().skip(o).step_by(q).collect::<Vec<_>>()
        });
        let left: Vec<f64> = left.filter(|v| !v.is_nan()).collect();
        left.iter().map(|v| v * v).sum::<f64>() / left.len().max(1) as f64
    };
    let spectra: Vec<LogSpectrum> = (0..q).map(|o| LogSpectrum::flat(variance(o).max(f64::MIN_POSITIVE))).collect();
    let noise = CommonNoise::new(&spectra, 0);
    let after = written.as_ref().map_or(&naive, |w| &w.fitted.response);
    let responses = (&naive[..], &after[..]);
    let outputs =
        output_gains(&first.model, (runs.all, runs.train), &first.predictors, responses, (&noise, runs.all));
    let gains = if written.is_some() { run_gains(runs.all, runs.train, &first.predictors, responses, &noise) } else { Vec::new() };
    let overlays = overlays(runs.all, runs.train, &first.predictors, responses);
    let steps = found.steps.iter().map(|step| SelectionStep {
        family_wise_p: 1.0,
        ranking: step.iter().filter_map(|(set, gain)| {
            let [place] = &set[..] else { return None };
            Some(Screened { place: place.clone(), gain: *gain, chance: 1.0, distinct: 1.0, size: None, parameter: String::new() })
        }).collect(),
        accepted: None,
    }).collect();
    let rejected: Vec<Rejected> = found.steps.iter().enumerate().flat_map(|(n, step)| {
        step.iter().filter_map(move |(set, gain)| Some(Rejected {
            place: set.last()?.clone(),
            step: n + 1,
            gain_training: *gain,
            gain_validation: None,
            reason: format!("evidence {gain:+.1} nats"),
        }))
    }).collect();
    let _ = judged;
    Ok(Diagnosis {
        verdict,
        family_wise_p: 1.0,
        causes: told,
        front: Vec::new(),
        rejected,
        steps,
        detectable: Vec::new(),
        left_out: found.left_out,
        biased: Vec::new(),
        outputs,
        gains,
        overlays,
        noise_knots: vec![1; q],
        extended: written.map(|w| w.text),
        ended: if found.stopped { "it was stopped".into() } else { "no further set of effects is likelier".into() },
        stopped: found.stopped,
        lack_of_fit: Vec::new(),
        attribution: None,
        places: None,
        suggestions: None,
        feedback: None,
        notes: Vec::new(),
        spectral: first.spectral(),
    })
}

/// A cause as it is told.
fn told((state, judged): &Found, cause: &super::search::Cause) -> Cause {
    let placed = &state.effects[cause.effect];
    let own = place(&placed.candidate);
    let q = judged.evidence.mean.len();
    let parameters = placed.params.iter().zip(&placed.at).filter(|(p, _)| p.begins_as.is_none()).map(|(p, at)| {
        let column = state.text.shared.iter().position(|s| s == at);
        let error = column.map(|c| judged.evidence.covariance[c * q + c].max(0.0).sqrt());
        NewValue {
            name: p.name.clone(),
            doc: p.doc.clone(),
            value: state.theta[0][*at],
            standard_error: error,
            unit: p.unit.as_ref().map(|u| u.text().to_string()),
            null: (!p.nuisance).then_some(p.null),
        }
    });
    let alternative = |candidate: &Candidate, log: f64| Alternative {
        place: place(candidate),
        gain_training: log,
        gain_validation: None,
        score: log,
        cosine: 1.0,
    };
    let mut group = vec![alternative(&placed.candidate, cause.loss)];
    group.extend(cause.group.iter().map(|(c, behind)| alternative(c, cause.loss + behind)));
    let separating_experiment = group.get(1).map(|other| separating(&own, &other.place));
    Cause {
        doc: placed.candidate.doc(),
        parameters: parameters.collect(),
        gain_training: cause.loss,
        gain_validation: None,
        gain_predicted: cause.loss,
        score: cause.loss,
        p: (-cause.loss).exp().min(1.0),
        group,
        separating_experiment,
        place: own,
    }
}
