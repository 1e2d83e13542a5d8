//! From runs and a catalogue to a diagnosis: the search, what has no name, and what is told of both.

use super::curve::curve;
use super::feedback::feedback;
use super::random_effect::{Unnamed, log_sum};
use super::separating::separating;
use super::sets::{self, Fitted, GROUP, Search};
use super::state::{Ground, State};
use crate::bins::Signals;
use crate::candidates::DiagnosisError;
use crate::candidates::extended_model::place;
use crate::candidates::fitted_model::FittedModel;
use crate::candidates::initial_fit::initial_fits;
use crate::candidates::place::PlaceKind;
use crate::candidates::runs::{DiagnosisOptions, Domain, Runs, apart, interval, keeps_inputs, prepared, thinned};
use crate::candidates::written_model::{WrittenModel, squares, written_model};
use crate::diagnosis::{
    Alternative, Biased, Cause, Diagnosis, Explanation, FrontModel, FrontOutput, MendedOutput, MendedRecords, NewValue,
    OutputGain, Overlay, UnnamedCause, Verdict,
};
use crate::evidence::binning::Binning;
use crate::evidence::decimation::decimation;
use crate::faults::{Mended, mended};
use crate::lack_of_fit::{BinnedResidual, LackOfFit, RunResidual, lack_of_fit, lack_of_fit_of_bins};
use fdm_effects::{Candidate, Catalogue, Subject};
use fdm_estimate::residuals::OutputFit;
use fdm_estimate::{Work, changed};
use fdm_system::model::Model;
use fdm_system::record::Run;
use std::collections::BTreeSet;
use std::ops::Range;

/// Finds what is missing from a model: fits it as it stands, and goes from set of effects to set by the evidence of the written model.
///
/// `validation` are runs that take no part in plain fits: effects must predict them as well. Work that is to end begins nothing any more: what was
/// accepted by then is the result, and it says that it was stopped.
///
/// # Errors
/// [`DiagnosisError`]; a search that finds nothing is a [`Diagnosis`]. [`DiagnosisError::Stopped`] before the base model is fitted.
pub fn diagnose(
    model: &Model,
    runs: &[Run],
    validation: &[Run],
    catalogue: &Catalogue,
    options: &DiagnosisOptions,
    work: &Work<'_>,
) -> Result<Diagnosis, DiagnosisError> {
    apart(runs, validation)?;
    let of = |run: &Run| prepared(run, &options.domain);
    let found: Vec<(Run, Option<String>)> = runs.iter().chain(validation).map(of).collect::<Result<_, _>>()?;
    let (all, notes): (Vec<Run>, Vec<Option<String>>) = found.into_iter().unzip();
    let mut notes: Vec<String> = notes.into_iter().flatten().collect();
    let subject = Subject::new(model.source(), model.definition()).map_err(DiagnosisError::Text)?;
    let candidates = catalogue.places(&subject).candidates.len();
    let (all, fewer) = thinned(all, model.layout().outputs, candidates, &options.domain);
    notes.extend(fewer);
    let domain = options.domain.settled(&changed(model, &options.fit.changes)?, &all[..runs.len()])?;
    let runs = Runs { all: &all, train: runs.len(), domain: &domain };
    if runs.train().iter().all(|run| run.measured.iter().all(|z| z.is_nan())) {
        return Err(DiagnosisError::NothingMeasured);
    }
    if runs.train().iter().all(|run| is_still(run, model.layout().outputs)) {
        return Err(DiagnosisError::Still);
    }
    let asked = Asked { catalogue, options, work };
    work.stage("fitting the base model");
    let first = asked.fitted(model, runs)?;
    // faults of records that take part in the search have no size, and are weighed in time alone
    let (mended, faults) = match domain {
        Domain::Time if work.goes_on() => mended(&first, &all, work),
        _ => (None, f64::NEG_INFINITY),
    };
    let given = AsGiven { text: model.source().text(), rms: rms(&first, &first.response, runs, 0..runs.train) };
    let judged_mended = |mended: &Mended| -> Option<(Diagnosis, Null)> {
        let runs = Runs { all: &mended.runs, ..runs };
        asked.judged(asked.fitted(&mended.model, runs).ok()?, runs).ok()
    };
    // how inputs go between samples where nobody said so is the reader's guess: where the other one leaves nothing to be explained, no effect is to
    // explain that it was wrong. Where something is left, a delay may be what the other guess imitates
    let mut asked_mended = None;
    if let Some(mended) = mended.as_ref().filter(|m| m.assumed && m.evidence > GROUP)
        && let Some((own, null)) = judged_mended(mended)
    {
        if own.verdict == Verdict::NoEffectFound {
            let evidence = mended.evidence + best(&own);
            let mut found = with_mended(of_record(evidence, vec![nothing()]), given, mended, own);
            found.notes.splice(0..0, notes);
            return Ok(found);
        }
        asked_mended = Some((own, null));
    }
    let (mut found, null) = asked.judged(first, runs)?;
    let beside = mended.filter(|_| work.goes_on()).and_then(|mut mended| {
        let same = |(a, b): (&Run, &Run)| a.measured.iter().zip(&b.measured).all(|(a, b)| a.to_bits() == b.to_bits());
        let measured_alike = runs.all.iter().zip(&mended.runs).all(same);
        let (own, mended_null) = asked_mended.or_else(|| judged_mended(&mended))?;
        // of the same samples both are asked alike, growing noise included
        if measured_alike && mended_null.every == null.every {
            mended.evidence = mended.prior + mended_null.log - null.log;
        }
        Some((mended, own))
    });
    let own = beside.as_ref().map_or(f64::NEG_INFINITY, |(mended, own)| mended.evidence + best(own));
    found.explanations = of_record(faults.max(own), found.explanations);
    if let Some((mended, own)) = beside.filter(|_| found.explanations[0].verdict == Verdict::RecordFault) {
        found = with_mended(found.explanations, given, &mended, own);
    }
    found.notes.splice(0..0, notes);
    Ok(found)
}

/// Evidence of the likeliest explanation.
fn best(found: &Diagnosis) -> f64 {
    found.explanations.iter().map(|e| e.evidence).fold(0.0, f64::max)
}

/// Explanations with their probabilities; those of no evidence are none. A function of one signal contains what is named as a special case: where that is
/// as likely it says no more.
fn weighed(all: &mut Vec<Explanation>) {
    all.retain(|e| e.evidence.is_finite());
    let whole = log_sum(&all.iter().map(|e| e.evidence).collect::<Vec<f64>>());
    all.iter_mut().for_each(|e| e.probability = (e.evidence - whole).exp());
    all.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
    let place = |verdict: Verdict| all.iter().position(|e| e.verdict == verdict);
    if let (Some(0), Some(named)) = (place(Verdict::Law), place(Verdict::EffectFound))
        && all[named].evidence > all[0].evidence - GROUP
    {
        all[..=named].rotate_right(1);
    }
}

/// Explanations with faults of the record of this evidence among them.
fn of_record(evidence: f64, mut others: Vec<Explanation>) -> Vec<Explanation> {
    others.push(Explanation { verdict: Verdict::RecordFault, evidence, probability: 0.0 });
    weighed(&mut others);
    others
}

fn nothing() -> Explanation {
    Explanation { verdict: Verdict::NoEffectFound, evidence: 0.0, probability: 0.0 }
}

/// A model as it was given, beside records as they are.
struct AsGiven<'a> {
    text: &'a str,
    /// Root mean square residual of each output on the training runs.
    rms: Vec<Option<f64>>,
}

/// A diagnosis of mended records, in the place of that of records as they are, whose explanations these are.
fn with_mended(explanations: Vec<Explanation>, given: AsGiven<'_>, mended: &Mended, mut own: Diagnosis) -> Diagnosis {
    let outputs = given.rms.into_iter().zip(&own.front[0].outputs).map(|(before, after)| MendedOutput {
        output: after.output.clone(),
        unit: after.unit.clone(),
        before,
        after: after.rms_training,
    });
    let Explanation { evidence, probability, .. } = explanations[0].clone();
    let (faults, outputs) = (mended.findings.clone(), outputs.collect());
    own.mended = Some(MendedRecords { faults, evidence, probability, outputs });
    if own.verdict == Verdict::NoEffectFound {
        own.verdict = Verdict::RecordFault;
        own.explanations = explanations;
        // with initial values that are free now, and how inputs go between samples
        own.extended = Some(mended.model.source().text().to_string()).filter(|text| text != given.text);
    }
    own
}

/// Root mean square residual of each output on these runs.
fn rms(fitted: &FittedModel, responses: &[Signals], runs: Runs<'_>, of: Range<usize>) -> Vec<Option<f64>> {
    let all = squares(fitted, responses, runs, of).into_iter();
    all.map(|(sum, n)| (n > 0).then(|| (sum / n as f64).sqrt())).collect()
}

/// A model as it was given, judged.
struct Null {
    /// Its log evidence on every so manyth sample.
    log: f64,
    every: usize,
}

/// What is asked of every model.
struct Asked<'a> {
    catalogue: &'a Catalogue,
    options: &'a DiagnosisOptions,
    work: &'a Work<'a>,
}

impl Asked<'_> {
    fn fitted(&self, model: &Model, runs: Runs<'_>) -> Result<FittedModel, DiagnosisError> {
        let first = initial_fits(model, runs, self.options, self.work)?.into_iter().next();
        first.ok_or_else(|| DiagnosisError::NoFit("it has no end".into()))
    }

    /// What a fitted model lacks, and its own evidence.
    fn judged(&self, first: FittedModel, runs: Runs<'_>) -> Result<(Diagnosis, Null), DiagnosisError> {
        let Self { catalogue, options, work } = *self;
        let mut notes = Vec::new();
        let mut every = decimation(&first, runs, true);
        while every > 1 && !runs.all.iter().all(|run| keeps_inputs(run, every)) {
            every -= (every / 4).max(1);
        }
        let fewer: Vec<Run> =
            if every > 1 { runs.all.iter().map(|run| run.every(every)).collect() } else { Vec::new() };
        let (first, runs) = match every > 1 {
            false => (first, runs),
            true => {
                notes.push(format!(
                    "every {every}th sample is used: what is above the band of the model and all its derivatives is noise; all errors are those of \
                     what is left"
                ));
                let runs = Runs { all: &fewer, ..runs };
                (FittedModel::new(first.model.clone(), runs, first.theta.clone())?, runs)
            }
        };
        let names = names(&first.model);
        let fresh = |c: &Candidate| c.targets().iter().all(|t| names.contains(t));
        let candidates: Vec<Candidate> =
            catalogue.places(&first.subject).candidates.into_iter().filter(fresh).collect();
        if candidates.is_empty() {
            return Err(DiagnosisError::NoPlaces);
        }
        let searched = Runs { train: runs.all.len(), ..runs };
        let ground = Ground {
            runs: searched,
            binning: Binning::new(&first, searched),
            candidates: candidates.len(),
            deviations: deviations(&first, runs),
            work,
        };
        let judge = Judge { first: &first, runs, options, work };
        let (mut found, log) = judge.diagnosis(&ground, &candidates)?;
        found.notes.splice(0..0, notes);
        Ok((found, Null { log, every }))
    }
}

/// Whether every one of the `q` outputs has one value wherever it was measured.
fn is_still(run: &Run, q: usize) -> bool {
    (0..q).all(|k| {
        let mut values = run.measured.iter().skip(k).step_by(q).filter(|z| !z.is_nan());
        values.next().is_none_or(|first| values.all(|z| z == first))
    })
}

/// Everything that the user gave a name.
fn names(model: &Model) -> BTreeSet<String> {
    let definition = model.definition();
    let inputs = definition.inputs.iter().map(|i| &i.quantity);
    let states = definition.states.iter().map(|s| &s.quantity);
    let outputs = definition.outputs.iter().map(|o| &o.quantity);
    let params = definition.params.iter().map(|p| &p.quantity);
    inputs.chain(states).chain(outputs).chain(params).map(|q| q.name.clone()).collect()
}

/// Standard deviation of what was measured of each output.
fn deviations(first: &FittedModel, runs: Runs<'_>) -> Vec<f64> {
    let q = first.outputs();
    let of = |o: usize| {
        let measured = runs.all.iter().flat_map(|run| run.measured.iter().skip(o).step_by(q));
        let values: Vec<f64> = measured.copied().filter(|z| !z.is_nan()).collect();
        let n = values.len().max(1) as f64;
        let mean = values.iter().sum::<f64>() / n;
        (values.iter().map(|z| (z - mean).powi(2)).sum::<f64>() / n).sqrt().max(f64::MIN_POSITIVE)
    };
    (0..q).map(of).collect()
}

/// What a search is judged with.
struct Judge<'a> {
    first: &'a FittedModel,
    runs: Runs<'a>,
    options: &'a DiagnosisOptions,
    work: &'a Work<'a>,
}

impl Judge<'_> {
    /// The text of a state fitted plainly to the training runs, at the values that stand in it.
    fn plain(&self, state: &State) -> Option<WrittenModel> {
        let fitted = state.fitted(self.runs)?;
        written_model(&fitted, &state.theta, &self.first.response, (self.runs, self.options, self.work)).ok()
    }

    /// With the log evidence of the model as it was given.
    fn diagnosis(&self, ground: &Ground<'_>, candidates: &[Candidate]) -> Result<(Diagnosis, f64), DiagnosisError> {
        let Self { first, runs, options, work } = *self;
        let base = State::base(first, ground.runs).ok_or_else(|| DiagnosisError::NoFit("it has no response".into()))?;
        work.stage(&format!("searching among {} candidates", candidates.len()));
        // without runs that were not fitted, those that were: a text with one effect more that does worse there was lost on its way
        let error = |state: &State| match state.effects.is_empty() {
            true => 1.0,
            false => self.plain(state).map_or(f64::INFINITY, |w| w.ratio()),
        };
        let none = || DiagnosisError::NoFit("it has no derivatives at the estimates".into());
        let (ground, null) = ground.clone().with_growing_noise(base.clone()).ok_or_else(none)?;
        let search = Search { ground, base, null, candidates, most: options.most, error: &error };
        let found = search.run().ok_or_else(none)?;
        let ground = &found.ground;
        work.stage("looking for what has no name");
        let asked = *runs.domain == Domain::Time;
        let unnamed_beside = |(state, judged): &Fitted| match asked && work.goes_on() {
            true => Beside { courses: ground.disturbances((state, judged)), laws: ground.laws((state, judged)) },
            false => Beside::default(),
        };
        let beside = unnamed_beside(&found.null);
        // what explains the runs without effects may do so beside them too
        let left = match found.best.0.effects.is_empty() || beside.best() <= 0.0 {
            true => Beside::default(),
            false => unnamed_beside(&found.best),
        };
        let explanations = explanations(&found, &beside, &left);
        let verdict = explanations.first().map_or(Verdict::NoEffectFound, |e| e.verdict);
        // what errs in the direction of the effects, and is none of them, has them nearest
        let resembled = verdict == Verdict::UnknownCause && misfit(&found) > beside.best();
        let named = verdict == Verdict::EffectFound || resembled;
        let Beside { courses, laws } = if named { left } else { beside };
        let state = &found.best.0;
        let written = if named { self.plain(state) } else { None };
        let law = laws.first().filter(|_| verdict == Verdict::Law);
        let curve = law.and_then(|law| curve(law, &found.null.0, (runs, options, work)));
        let mut unnamed: Vec<UnnamedCause> = courses.into_iter().chain(laws).map(unnamed).collect();
        unnamed.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
        let mut front = self.front(&found, written.as_ref());
        if let Some(curve) = &curve {
            let evidence = unnamed.iter().find(|u| u.signal.is_some()).map_or(f64::NAN, |u| u.evidence);
            let described = self.described(&found.null.0, evidence, Some(&curve.written), true);
            front.push(FrontModel { effects: vec![curve.place.clone()], parameters: curve.parameters, ..described });
        }
        let causes = found.causes.iter().filter(|_| named).map(|cause| told(&found.best, cause, written.as_ref()));
        let causes = causes.collect();
        let written = written.or(curve.map(|c| c.written));
        let lack_of_fit = self.lack_of_fit();
        let after = written.as_ref().map_or(&first.response, |w| &w.fitted.response);
        let null = found.null.1.log;
        let diagnosis = Diagnosis {
            verdict,
            mended: None,
            causes,
            explanations,
            unnamed,
            front,
            steps: found.steps,
            left_out: found.seen.left_out,
            feedback: feedback(first, runs, found.seen.hidden),
            biased: if named { biased(&found.null, &found.best) } else { Vec::new() },
            outputs: self.outputs(after, &lack_of_fit),
            overlays: self.overlays(after),
            extended: written.map(|w| w.text),
            ended: if found.stopped { "it was stopped".into() } else { "no further set of effects is likelier".into() },
            stopped: found.stopped,
            lack_of_fit,
            notes: Vec::new(),
            spectral: first.spectral(),
        };
        Ok((diagnosis, null))
    }

    /// What is wrong with the model as it was given.
    fn lack_of_fit(&self) -> Vec<LackOfFit> {
        let Self { first, runs, .. } = self;
        let binned = first.predictors.iter().zip(&first.response).take(runs.train);
        let binned: Vec<BinnedResidual> = binned.filter_map(|(p, response)| p.binned(response)).collect();
        if !binned.is_empty() {
            return lack_of_fit_of_bins(&first.model, &binned);
        }
        let residuals: Vec<Vec<f64>> = runs
            .train()
            .iter()
            .enumerate()
            .map(|(r, run)| first.predictors[r].left_by(run, &first.response[r]))
            .collect();
        let mut left = Vec::new();
        for (run, residual) in runs.train().iter().zip(&residuals) {
            left.push(RunResidual { run, residual, interval: interval(run) });
        }
        lack_of_fit(&first.model, &left)
    }

    /// Stages of the search as they are written.
    fn front(&self, found: &sets::Found, last: Option<&WrittenModel>) -> Vec<FrontModel> {
        let null = found.null.1.log;
        let stages = if last.is_some() { &found.stages[..] } else { &found.stages[..1] };
        let end = stages.len() - 1;
        let of = |(k, (state, log)): (usize, &(State, f64))| -> Option<FrontModel> {
            let own;
            let written = match last.filter(|_| k == end && k > 0) {
                Some(last) => Some(last),
                None if k == 0 => None,
                None => {
                    own = self.plain(state)?;
                    Some(&own)
                }
            };
            Some(self.described(state, log - null, written, k == end && last.is_some()))
        };
        stages.iter().enumerate().filter_map(of).collect()
    }

    fn described(&self, state: &State, evidence: f64, written: Option<&WrittenModel>, recommended: bool) -> FrontModel {
        let Self { first, runs, .. } = self;
        let response = written.map_or(&first.response, |w| &w.fitted.response);
        let of = |range: Range<usize>| rms(first, response, *runs, range);
        let (training, validation) = (of(0..runs.train), of(runs.train..runs.all.len()));
        let outputs = first.model.definition().outputs.iter().enumerate().map(|(o, output)| FrontOutput {
            output: output.quantity.name.clone(),
            unit: output.quantity.unit.as_ref().map(ToString::to_string),
            rms_training: training[o],
            rms_validation: validation[o],
        });
        let validated = !runs.validation().is_empty();
        FrontModel {
            effects: state.effects.iter().map(|e| place(&e.candidate)).collect(),
            parameters: state.effects.iter().map(super::state::Placed::numbers).sum(),
            evidence,
            error_training: written.map_or(1.0, |w| w.training.sqrt()),
            error_validation: validated.then(|| written.map_or(Some(1.0), |w| w.validation.map(f64::sqrt))).flatten(),
            outputs: outputs.collect(),
            recommended,
        }
    }

    /// How outputs are matched before and after.
    fn outputs(&self, after: &[Vec<f64>], wrong: &[LackOfFit]) -> Vec<OutputGain> {
        let Self { first, runs, .. } = self;
        let outputs = &first.model.definition().outputs;
        let mut found = Vec::new();
        for (r, run) in runs.all.iter().enumerate() {
            let measured = first.predictors[r].measured(run);
            // bins of a band: what they have together is spread over all samples
            let spread = first.predictors[r].frequencies().map_or(1.0, |f| (f.len() as f64 / run.len() as f64).sqrt());
            for (o, output) in outputs.iter().enumerate() {
                let name = &output.quantity.name;
                let fit = |response: &[f64]| OutputFit::new(name, &run.name, &measured, response, o, outputs.len());
                let (a, b) = (fit(&first.response[r]), fit(&after[r]));
                found.push(OutputGain {
                    run: run.name.clone(),
                    validation: r >= runs.train,
                    output: name.clone(),
                    unit: output.quantity.unit.as_ref().map(ToString::to_string),
                    rms_before: a.rms.map(|rms| spread * rms),
                    rms_after: b.rms.map(|rms| spread * rms),
                    noise_level: wrong.iter().find(|w| w.output == *name).map_or(f64::NAN, |w| w.noise_level),
                    tic_before: a.tic,
                    tic_after: b.tic,
                    r2_before: a.r2,
                    r2_after: b.r2,
                });
            }
        }
        found
    }

    /// Both responses of every run over time; none in the frequency domain.
    fn overlays(&self, after: &[Vec<f64>]) -> Vec<Overlay> {
        let Self { first, runs, .. } = self;
        let in_time = runs.all.iter().enumerate().filter(|(r, _)| first.predictors[*r].frequencies().is_none());
        let of = |(r, run): (usize, &Run)| Overlay {
            run: run.name.clone(),
            validation: r >= runs.train,
            time: run.time.clone(),
            measured: run.measured.clone(),
            before: first.response[r].clone(),
            after: after[r].clone(),
        };
        in_time.map(of).collect()
    }
}

/// What has no name beside a state: courses of each run, and functions of a signal.
#[derive(Default)]
struct Beside {
    courses: Vec<Unnamed>,
    laws: Vec<Unnamed>,
}

impl Beside {
    fn all(&self) -> impl Iterator<Item = &Unnamed> {
        self.courses.iter().chain(&self.laws)
    }

    fn best(&self) -> f64 {
        self.all().map(|u| u.log).fold(f64::NEG_INFINITY, f64::max)
    }

    /// Evidence of all of a kind together.
    fn of(&self, is_it: impl Fn(&Unnamed) -> bool) -> f64 {
        log_sum(&self.all().filter(|u| is_it(u)).map(|u| u.log).collect::<Vec<f64>>())
    }
}

/// Every kind of explanation with its probability, the likeliest first. Effects may be there alone, or with something unnamed beside them (`left`).
fn explanations(found: &sets::Found, beside: &Beside, left: &Beside) -> Vec<Explanation> {
    let gained = found.best.1.log - found.null.1.log;
    // sets that are likelier than nothing and predict worse have no name that can be told
    let (effects, nameless) = match found.best.0.effects.is_empty() {
        true if found.together > 0.0 => (f64::NEG_INFINITY, found.together),
        true => (found.together, f64::NEG_INFINITY),
        false => (log_sum(&[gained, found.together.min(gained), gained + left.best()]), f64::NEG_INFINITY),
    };
    let is_output = |u: &Unnamed| u.signal.is_none() && u.place.kind == PlaceKind::Output;
    let of = [
        (Verdict::NoEffectFound, 0.0),
        (Verdict::EffectFound, effects),
        (Verdict::Disturbance, beside.of(|u| u.signal.is_none() && !is_output(u))),
        (Verdict::Law, beside.of(|u| u.signal.is_some())),
        (Verdict::UnknownCause, log_sum(&[beside.of(is_output), nameless, misfit(found)])),
    ];
    let of = of.into_iter().map(|(verdict, evidence)| Explanation { verdict, evidence, probability: 0.0 });
    let mut found = of.collect();
    weighed(&mut found);
    found
}

/// Evidence that the model errs by more than noise where the effects act: that each is there and the parts of the records disagree on it beyond noise, or
/// that it is not and they disagree so.
fn misfit(found: &sets::Found) -> f64 {
    let (gained, candidates) = (found.best.1.log - found.null.1.log, found.ground.candidates as f64);
    let of = |cause: &sets::Cause| {
        let with = cause.disagreement?;
        let without = with.without(cause.loss + candidates.ln());
        Some([gained + with.of_misfit(), gained - cause.loss + without.of_misfit()])
    };
    // one of the causes, whichever
    log_sum(&found.causes.iter().filter_map(of).flatten().collect::<Vec<f64>>())
        - (found.causes.len().max(1) as f64).ln()
}

fn unnamed(found: Unnamed) -> UnnamedCause {
    UnnamedCause { place: found.place, signal: found.signal, evidence: found.log }
}

/// A cause as it is told.
fn told((state, judged): &Fitted, cause: &sets::Cause, written: Option<&WrittenModel>) -> Cause {
    let placed = &state.effects[cause.effect];
    let own = place(&placed.candidate);
    let q = judged.evidence.mean.len();
    let parameters = placed.params.iter().zip(&placed.at).filter(|(p, _)| p.begins_as.is_none()).map(|(p, at)| {
        let column = state.text.shared.iter().position(|s| s == at);
        NewValue {
            name: p.name.clone(),
            doc: p.doc.clone(),
            value: state.theta[0][*at],
            standard_error: column.map(|c| judged.evidence.covariance[c * q + c].max(0.0).sqrt()),
            written: written.and_then(|w| w.value(&p.name)),
            unit: p.unit.as_ref().map(|u| u.text().to_string()),
            null: (!p.nuisance).then_some(p.null),
        }
    });
    let whole = 1.0 + cause.group.iter().map(|(_, evidence)| evidence.exp()).sum::<f64>();
    let alternative = |(candidate, evidence): &(Candidate, f64)| Alternative {
        place: place(candidate),
        evidence: *evidence,
        probability: evidence.exp() / whole,
    };
    let group: Vec<Alternative> = cause.group.iter().map(alternative).collect();
    Cause {
        doc: placed.candidate.doc(),
        parameters: parameters.collect(),
        loss: cause.loss,
        scatter: cause.disagreement.map(|d| d.scatter.sqrt()),
        probability: 1.0 / whole,
        separating_experiment: group.first().map(|other| separating(&own, &other.place)),
        group,
        place: own,
    }
}

/// Parameters of the base model before and after.
fn biased(null: &Fitted, best: &Fitted) -> Vec<Biased> {
    let error = |(state, judged): &Fitted, k: usize| {
        let q = judged.evidence.mean.len();
        let column = state.text.shared.iter().position(|s| *s == k);
        column.map(|c| judged.evidence.covariance[c * q + c].max(0.0).sqrt())
    };
    let (from, to) = (null.0.text.model.definition(), best.0.text.model.definition());
    let of = |(k, param): (usize, &fdm_grammar::model::Param)| {
        if param.fixed || param.per_run {
            return None;
        }
        let at = to.param(&param.quantity.name)?;
        let (before, after) = (null.0.theta[0][k], best.0.theta[0][at]);
        let before_error = error(null, k);
        Some(Biased {
            name: param.quantity.name.clone(),
            run: None,
            unit: param.quantity.unit.as_ref().map(ToString::to_string),
            before,
            before_error,
            after,
            after_error: error(best, at),
            moved: before_error.filter(|e| *e > 0.0).map(|e| (after - before) / e),
        })
    };
    from.params.iter().enumerate().filter_map(of).collect()
}
