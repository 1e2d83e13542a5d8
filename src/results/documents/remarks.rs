//! What should not be overlooked in a result, in plain words.
//!
//! Initial values that the data contradict, in a sentence.
//!
//! Minima of many starts that are as good as the one that was kept.

use super::BridgeDocument;
use super::digits::{digits, digits_by_error, p_value};
use fdm_estimate::residuals::{Cause, InputCorrelation, NoiseVariation, OutputFit, OutputQuality, Trend};
use fdm_estimate::{
    Curvature, DoubtedInitial, DoubtedInitials, Estimate, Fit, InputInterpolation, LONG_RUN, MovedParameter,
    NoiseColour, ParameterEstimate, Smoothing, SpectralColour, SpectralFit, StartSummary, Status, Termination,
    Uncorrected, Unexplained,
};
use fdm_numeric::statistics::Student;
use serde::{Deserialize, Serialize};
use std::fmt;

/// What a remark is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum About {
    /// Inputs that were held between samples and are taken for straight lines, or the other way round.
    Interpolation,
    /// A likelihood that has no maximum.
    Likelihood,
    /// Other minima that are as good.
    Minima,
    /// Initial values that the model states and the data contradict.
    Initial,
    /// Outputs that the model does not explain, or whose mirror image it is.
    Unexplained,
    /// Parameters that nothing determines.
    Undetermined,
    /// Parameters that priors determine, not data.
    Prior,
    /// How smooth tables are, and which of their nodes are not known.
    Table,
    /// Parameters that the data hardly separate.
    Correlated,
    /// Parameters at their bounds.
    Bound,
    /// Inputs of which the record does not say whether they were held between samples, where that matters.
    InterpolationUnknown,
    /// Parameters that few samples moved far from their starts.
    Few,
    /// Intervals that may hold less often than in 95 of 100 cases.
    Intervals,
    /// Records too short to determine the colour of their noise.
    Short,
    /// Parameters that noise of measured regressors biases.
    Biased,
    /// Fallback strategies of the iteration.
    Iteration,
    /// An output that is matched to rounding.
    NoNoise,
    /// The colour of the residuals, and what it does to standard errors.
    Colour,
    /// Noise that is not of one size, and what that does to standard errors.
    Noise,
    /// Residuals that are an offset.
    Offset,
    /// Residuals that follow or lead an input.
    Input,
    /// Residuals that could not be tested.
    Untested,
    /// Outputs that some run, or every run, does not measure.
    NotMeasured,
    /// Channels whose gaps were bridged before they were transformed.
    Bridged,
    /// Measured records that drive the equations, whose noise the errors allow for.
    Regressors,
}

impl About {
    /// The order of remarks: what speaks most against a result first.
    pub fn rank(self) -> usize {
        match self {
            Self::Interpolation | Self::Likelihood | Self::Initial | Self::Unexplained => 0,
            Self::Undetermined => 1,
            Self::Minima | Self::Bound | Self::Few => 2,
            Self::Offset => 3,
            Self::Input | Self::InterpolationUnknown => 4,
            Self::Colour | Self::Noise => 5,
            Self::Biased | Self::Intervals => 6,
            Self::Correlated => 7,
            Self::Prior | Self::Table => 8,
            Self::Iteration => 9,
            Self::NoNoise | Self::Untested | Self::NotMeasured | Self::Bridged | Self::Short | Self::Regressors => 10,
        }
    }

    /// Whether it may change what is decided with a result. The others say how it came about, or what was not possible.
    pub fn speaks_against(self) -> bool {
        !matches!(self, Self::Table | Self::Iteration | Self::Untested | Self::Bridged | Self::Short | Self::Regressors)
    }

    /// What to do about it, where the sentence does not say so itself.
    pub fn advice(self) -> Option<&'static str> {
        Some(match self {
            Self::Unexplained => "`fdm doctor` looks for the cause in the record, `fdm diagnose` in the model",
            Self::Undetermined => "fix some of them, give a prior, or add a run that excites them",
            Self::Prior => "a run that excites it would determine it better (`fdm design`)",
            Self::Correlated => "fix one, give a prior, or add a run that tells them apart (`fdm design`)",
            Self::Offset => "declare one, `per run`",
            Self::Input => "`fdm diagnose` looks for what is missing",
            Self::Iteration => "better start values or bounds make it safer (`--starts 8` looks for others)",
            Self::NoNoise => "say what the noise is (`--noise OUTPUT=DEVIATION`)",
            Self::NotMeasured => "look at its column, its map and its mask",
            Self::Minima => "give bounds, or a start value with a prior, that say which is meant",
            Self::Likelihood
            | Self::Initial
            | Self::Interpolation
            | Self::InterpolationUnknown
            | Self::Table
            | Self::Bound
            | Self::Few
            | Self::Short
            | Self::Intervals
            | Self::Biased
            | Self::Colour
            | Self::Noise
            | Self::Untested
            | Self::Bridged
            | Self::Regressors => return None,
        })
    }
}

/// What should not be overlooked.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize, Serialize)]
pub struct Remark {
    /// What it is about.
    pub about: About,
    /// In words.
    pub sentence: String,
}

impl Remark {
    fn new(about: About, sentence: String) -> Self {
        Self { about, sentence }
    }
}

impl fmt::Display for Remark {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.sentence)
    }
}

/// Correlations beyond this are worth a line where an error suffers from them: with the partner known it would be less than half.
pub const CORRELATED: f64 = 0.9;
/// Standard error beside a value above which the value is not reliable (Tischler and Remple 2012: Cramer-Rao bounds of at most 20 %).
pub const RELIABLE: f64 = 0.2;
/// Bias that was removed, in standard errors, that is worth a line.
const BIASED: f64 = 0.3;
/// Most lines about pairs of parameters.
const MOST_PAIRS: usize = 6;
/// Part of the mean square residual that makes an offset worth a line.
pub const OFFSET: f64 = 0.2;
/// Probability of an offset as large by chance, below which it is remarked on.
const OFFSET_CHANCE: f64 = 0.01;
/// Samples that do not determine the colour of their noise: where neighbours correlate by 0.9 they are worth three independent ones.
const FEW_SAMPLES: usize = 60;
/// Most lines about correlations with inputs.
const MOST_INPUTS: usize = 6;
/// Most lines about parameters at their bounds.
const MOST_BOUNDS: usize = 4;

/// What a careful reader of the parameters would ask about.
pub fn estimate_remarks(estimate: &Estimate) -> Vec<Remark> {
    let undetermined = estimate.undetermined.iter().map(|d| format!("not determined: {}", d.sentence));
    let mut remarks: Vec<Remark> = undetermined.map(|s| Remark::new(About::Undetermined, s)).collect();
    for d in &estimate.determined_by_prior {
        let what = if d.moves.len() == 1 { "what is known of it is its prior" } else { "priors alone tell them apart" };
        remarks.push(Remark::new(About::Prior, format!("not determined by the data: {}; {what}", d.sentence)));
    }
    remarks.extend(tables(estimate).into_iter().map(|s| Remark::new(About::Table, s)));
    remarks.extend(estimate.degenerate.iter().map(|d| Remark::new(About::Likelihood, d.to_string())));
    let mut say = |about, said: Vec<String>| remarks.extend(said.into_iter().map(|s| Remark::new(about, s)));
    say(About::NotMeasured, not_measured(&estimate.outputs));
    say(About::Correlated, correlated(estimate));
    say(About::Bound, bounds(estimate));
    say(About::Biased, biased(estimate));
    say(
        About::Iteration,
        estimate.fallbacks.iter().map(|fallback| format!("fallback strategy of the iteration: {fallback}")).collect(),
    );
    let rounding = |o: &String| format!("`{o}` is matched to rounding: its noise and the standard errors mean nothing");
    say(About::NoNoise, estimate.noise_free.iter().map(rounding).collect());
    if estimate.noise_free.is_empty() {
        say(About::Colour, colour(estimate));
        say(About::Intervals, estimate.curvature.iter().map(|c| curved(estimate, c)).collect());
        say(About::Intervals, steep(estimate));
        remarks.extend(few(estimate));
        let mut say = |about, said: Vec<String>| remarks.extend(said.into_iter().map(|s| Remark::new(about, s)));
        say(About::Noise, varying(estimate));
    }
    remarks
}

/// The effective number of parameters of tables, and how many of their nodes no run visited.
fn tables(estimate: &Estimate) -> Vec<String> {
    let effective = estimate.smoothing.iter().map(smoothness);
    // of an estimation that was stopped that is no news
    let restless = estimate.smoothing.iter().filter(|s| !s.settled && estimate.termination.is_good()).map(|s| {
        format!(
            "`{}`: its smoothness did not settle in 40 rounds: the data hardly tell one weight from another; compare with given weights \
             (--smooth-by)",
            s.table
        )
    });
    let unvisited = estimate.tables.iter().filter_map(|t| {
        let count = t.unknown().count();
        (count > 0)
            .then(|| format!("`{}`: {count} of {} nodes are unknown: no run visits them", t.table, t.nodes.len()))
    });
    effective.chain(restless).chain(unvisited).collect()
}

/// How smooth a table is.
pub fn smoothness(s: &Smoothing) -> String {
    let weights = s.arguments.iter().zip(&s.weights);
    let weights: Vec<String> = weights.map(|(name, w)| format!("{} along {name}", digits(*w, 3))).collect();
    let (count, number) = (s.parameters, digits(s.effective_parameters, 3));
    format!("`{}`: {count} nodes, {number} effective parameters; weights {}", s.table, weights.join(", "))
}

/// Outputs of which runs hold no value, or none that can be used; one line for each output.
fn not_measured(outputs: &[OutputFit]) -> Vec<String> {
    let mut found: Vec<(&str, Vec<&str>)> = Vec::new();
    for fit in outputs.iter().filter(|fit| fit.compared == 0) {
        match found.iter_mut().find(|(name, _)| *name == fit.name) {
            Some((_, runs)) => runs.push(&fit.run),
            None => found.push((&fit.name, vec![&fit.run])),
        }
    }
    let line = |(name, runs): (&str, Vec<&str>)| {
        let measured = outputs.iter().any(|fit| fit.name == name && fit.compared > 0);
        let place = if measured { format!(" in {}, where", runs.join(", ")) } else { ":".into() };
        format!("`{name}` is not compared{place} no value of it can be used")
    };
    found.into_iter().map(line).collect()
}

/// Parameters whose bias by noise of measured regressors is large enough to be worth a line.
fn biased(estimate: &Estimate) -> Vec<String> {
    let far = estimate.bias_corrections.iter().filter(|d| d.standard_errors.abs() > BIASED);
    let far: Vec<String> = far
        .map(|d| format!("{} {} sigma", with_run(&d.name, d.run.as_deref()), digits(d.standard_errors.abs(), 2)))
        .collect();
    if far.is_empty() {
        return Vec::new();
    }
    let list = far.join(", ");
    vec![format!("bias from measured-regressor noise removed: {list}")]
}

/// What should not be overlooked in a fit of spectra, and what records and measured regressors mean for it.
pub fn spectral_remarks(fit: &SpectralFit) -> Vec<Remark> {
    let mut remarks = estimate_remarks(&fit.estimate);
    if !fit.measured_regressors.is_empty() {
        let (about, said) = regressors(&fit.estimate);
        remarks.push(Remark::new(about, said.into()));
    }
    let bridged = fit.bridged.iter().map(|b| Remark::new(About::Bridged, BridgeDocument::of(b).sentence()));
    remarks.extend(bridged);
    remarks
}

/// What it means that measured records stand in the equations: their noise is allowed for as far as it is white and of one size, as the residuals say.
fn regressors(estimate: &Estimate) -> (About, &'static str) {
    let varies = estimate.noise_variation.iter().any(NoiseVariation::is_significant);
    let white = estimate.uncorrected.is_none() && estimate.spectral_colours.iter().all(SpectralColour::is_white);
    match (varies, white) {
        (true, _) => (
            About::Intervals,
            "noise that varies stands in measured regressors too, for which the errors do not allow: intervals may hold much less often than in 95 of 100 cases; `--domain time` needs no such regressors",
        ),
        (false, false) => (
            About::Intervals,
            "the model's equations are driven by measured records, noise included: estimates are a little biased, and intervals hold in 95 of 100 cases only as far as that noise is small and white; `--domain time` needs no such regressors",
        ),
        (false, true) => (
            About::Regressors,
            "the model's equations are driven by measured records: their noise is white as far as the residuals tell, and errors allow for it",
        ),
    }
}

/// Remarks of a fit in the time domain: what should not be overlooked of its estimates and of its runs.
pub fn fit_remarks(fit: &Fit) -> Vec<Remark> {
    // a response that is lost explains nothing, whatever the record is
    let lost = matches!(fit.estimate.termination, Termination::Unstable { .. });
    let unexplained = if lost { Vec::new() } else { Unexplained::of(&fit.estimate) };
    let initial = fit.doubted_initials.as_ref().and_then(sentence);
    let mut remarks: Vec<Remark> = initial.into_iter().map(|said| Remark::new(About::Initial, said)).collect();
    remarks.extend(unexplained.iter().map(|u| Remark::new(About::Unexplained, not_explained(u))));
    remarks.extend(estimate_remarks(&fit.estimate));
    remarks.extend(equal_minima(fit).into_iter().map(|said| Remark::new(About::Minima, said)));
    remarks.extend(fit.interpolations.iter().filter_map(interpolation));
    remarks.extend(not_compared(&fit.uncompared_inputs));
    if !fit.loss.is_squares() {
        let said =
            format!("estimated by {} in place of squares: the noise covariance is that of pseudo-values", fit.loss);
        remarks.push(Remark::new(About::Noise, said));
    }
    remarks.extend(fit.few_samples.iter().map(|few| {
        let said = format!(
            "`{}` went from {} to {}, and about {} of {} samples say so: look at them, or give it bounds or a prior",
            few.parameter,
            digits(few.start, 3),
            digits(few.value, 3),
            digits(few.samples, 2),
            few.of
        );
        Remark::new(About::Few, said)
    }));
    if fit.estimate.noise_free.is_empty() {
        remarks.extend(residual_remarks(&fit.quality, &fit.model.definition().time.to_string()));
    }
    remarks
}

/// What is wrong with an output that is not explained.
fn not_explained(found: &Unexplained) -> String {
    let name = format!("`{}`", found.output);
    let r2 = found.r2.map(|r2| format!("R^2 {}", digits(r2, 3)));
    match (r2, found.correlation, found.line) {
        (Some(r2), Some(r), _) if found.is_mirrored() => {
            format!("{name} runs against the model ({r2}, correlation {r:+.2}), as with a wrong sign")
        }
        (Some(r2), _, Some((factor, offset))) => {
            let (times, more) = (digits(factor, 4), digits(offset, 4));
            format!(
                "{name} is not explained by the model ({r2}): the record is {times} times the response and {more}, as with another unit or offset"
            )
        }
        (Some(r2), Some(r), None) => {
            format!("{name} is not explained by the model ({r2}, correlation of record and response {r:+.2})")
        }
        (Some(r2), None, None) => format!("{name} is not explained by the model ({r2}): its response does not move"),
        (None, ..) => format!("{name} never changes in the record, and is not what the model says"),
    }
}

/// Inputs about which nobody said how they go between samples, where that was not compared.
fn not_compared(inputs: &[String]) -> Option<Remark> {
    let first = inputs.first()?;
    let names = inputs.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ");
    let said = format!(
        "whether {names} went held between samples or in straight lines was not compared: that is done by output error with squares and noise of one \
         size; say which: `--zoh {first}` or `--linear {first}`"
    );
    Some(Remark::new(About::Untested, said))
}

/// What the record says of an input about which nobody said how it goes between samples, where the fit has it the other way or it matters.
fn interpolation(found: &InputInterpolation) -> Option<Remark> {
    let input = &found.input;
    let (was, other) = match found.held {
        true => ("held between samples", "in straight lines"),
        false => ("in straight lines", "held between samples"),
    };
    let moved = found.moves.as_ref().map_or(String::new(), |m| {
        let (name, value) = (with_run(&m.parameter, m.run.as_deref()), digits(m.value, 4));
        format!("; {name} becomes {value}, {} standard errors away", digits(m.standard_errors.abs(), 2))
    });
    if found.is_otherwise() {
        let (option, attribute) = if found.held { ("linear", "linear") } else { ("zoh", "held") };
        let word = format!("`--{option} {input}`, `input {input} {attribute};`");
        let more = found.asked.map_or(String::new(), |times| {
            format!("; the residuals ask for {} times as much: look for a delay or lag too", digits(times, 2))
        });
        let nats = digits(found.evidence, 3);
        let said = format!(
            "the record says that `{input}` went {other}, not {was}: log-likelihood higher by {nats}{moved}; say so: {word}{more}"
        );
        return Some(Remark::new(About::Interpolation, said));
    }
    found.is_undecided().then(|| {
        let said = format!(
            "the record does not say whether `{input}` went {was} or {other}{moved}; say which: `--zoh {input}` or `--linear {input}`"
        );
        Remark::new(About::InterpolationUnknown, said)
    })
}

/// What a careful reader of the residuals would ask about; `time` is the unit of time.
pub fn residual_remarks(quality: &[OutputQuality], time: &str) -> Vec<Remark> {
    let several = quality.iter().any(|q| q.fit.run != quality[0].fit.run);
    let place = |q: &OutputQuality| {
        let run = if several { format!(" in {}", q.fit.run) } else { String::new() };
        format!("residual of `{}`{run}", q.fit.name)
    };
    let mut remarks: Vec<Remark> =
        untested(quality, several).into_iter().map(|s| Remark::new(About::Untested, s)).collect();
    for q in quality {
        if let Some(parts) = q.fit.tic_parts.filter(|p| p.bias > OFFSET && chance_of_offset(q) < OFFSET_CHANCE) {
            let share = 100.0 * parts.bias;
            let said = format!("{} is an offset for {share:.0} %: a bias parameter may be missing", place(q));
            remarks.push(Remark::new(About::Offset, said));
        }
    }
    let mut found: Vec<(&OutputQuality, &InputCorrelation)> =
        quality.iter().flat_map(|q| q.inputs.iter().map(move |i| (q, i))).filter(|(_, i)| i.is_significant()).collect();
    found.sort_by(|a, b| b.1.largest.abs().total_cmp(&a.1.largest.abs()));
    for (q, i) in found.iter().take(MOST_INPUTS) {
        let lag = format!("{} {time}", digits(i.largest_lag.abs(), 3));
        let meaning = match i.largest_lag {
            lag if lag < 0.0 => "the input follows the output: feedback, or clocks that differ",
            _ => "something the input does is missing",
        };
        let when = if i.largest_lag < 0.0 { format!("{lag} ahead of it") } else { format!("at lag {lag}") };
        let said = format!("{} correlates with input `{}` {when} ({:+.2}): {meaning}", place(q), i.input, i.largest);
        remarks.push(Remark::new(About::Input, said));
    }
    if found.len() > MOST_INPUTS {
        let said = format!("{} more correlations of residuals with inputs", found.len() - MOST_INPUTS);
        remarks.push(Remark::new(About::Input, said));
    }
    remarks
}

/// Probability of a mean residual as far from zero, were it zero: Student's law, with as many independent samples as the autocorrelation leaves. What is known
/// of that is summed as far as it is positive (Geyer's initial sequence).
fn chance_of_offset(q: &OutputQuality) -> f64 {
    let Some(share) = q.fit.tic_parts.map(|parts| parts.bias).filter(|share| *share < 1.0) else { return 0.0 };
    let lags = q.whiteness.as_ref().map_or(&[][..], |w| &w.autocorrelation);
    let n = q.fit.compared as f64;
    let positive = lags.iter().take_while(|r| **r > 0.0);
    // about their mean, residuals correlate by 1/n less than they do
    let alike = 1.0 + 2.0 * positive.map(|r| r + 1.0 / n).sum::<f64>();
    let independent = (n / alike).max(2.0);
    let deviate = (share / (1.0 - share) * (independent - 1.0)).sqrt();
    Student::new(independent - 1.0).map_or(1.0, |law| 2.0 * law.tail(deviate))
}

/// Residuals that no test was possible for: those of one run for one reason in one line.
fn untested(quality: &[OutputQuality], several: bool) -> Vec<String> {
    let mut found: Vec<(&str, String, Vec<String>)> = Vec::new();
    for q in quality.iter().filter(|q| q.fit.compared > 0) {
        let Some(reason) = q.untested.map(|r| r.to_string()) else { continue };
        let name = format!("`{}`", q.fit.name);
        match found.iter_mut().find(|(run, r, _)| *run == q.fit.run && *r == reason) {
            Some((_, _, names)) => names.push(name),
            None => found.push((&q.fit.run, reason, vec![name])),
        }
    }
    let line = |(run, reason, names): (&str, String, Vec<String>)| {
        let place = if several { format!(" in {run}") } else { String::new() };
        let (plural, verb) = if names.len() == 1 { ("", "was") } else { ("s", "were") };
        format!("residual{plural} of {}{place} {verb} not tested: {reason}", names.join(", "))
    };
    found.into_iter().map(line).collect()
}

/// Whether the error of a parameter is large beside its value. One that began at zero and may be zero has no size that an error could be large beside.
fn suffers(p: &ParameterEstimate) -> bool {
    let nothing = p.start == Some(0.0) && p.interval().is_some_and(|[low, high]| low <= 0.0 && high >= 0.0);
    p.status == Status::Estimated && !nothing && p.error().is_some_and(|error| error > RELIABLE * p.value.abs())
}

/// Pairs that the data hardly separate, where an error suffers from it, the worst first.
fn correlated(estimate: &Estimate) -> Vec<String> {
    let name = |k: usize| called(&estimate.parameters[k]);
    let mut pairs = estimate.correlated(CORRELATED);
    pairs.retain(|(a, b, _)| [a, b].into_iter().any(|k| suffers(&estimate.parameters[*k])));
    pairs.sort_by(|a, b| b.2.abs().total_cmp(&a.2.abs()));
    let shown =
        pairs.iter().take(MOST_PAIRS).map(|(a, b, r)| format!("correlated: {} and {} ({r:+.3})", name(*a), name(*b)));
    let more = pairs.len().saturating_sub(MOST_PAIRS);
    shown.chain((more > 0).then(|| format!("{more} more pairs correlate by more than {CORRELATED}"))).collect()
}

/// Of a parameter at its bound the value that it lies on this side of with 95 % probability, where that is a value that it may have:
/// beyond its other bound the limit says nothing.
pub fn limit_within_bounds(p: &ParameterEstimate) -> Option<f64> {
    let inside = |limit: &f64| p.lower.is_none_or(|l| *limit >= l) && p.upper.is_none_or(|u| *limit <= u);
    p.limit.filter(inside)
}

/// A bound may hide a better value behind it, or be where a way downhill from the start values ends.
fn bounds(estimate: &Estimate) -> Vec<String> {
    let side = |p: &ParameterEstimate| match p.status {
        Status::AtLowerBound => Some("lower"),
        Status::AtUpperBound => Some("upper"),
        _ => None,
    };
    let held = estimate.parameters.iter().filter_map(|p| Some((p, side(p)?)));
    let say = |(p, side): (&ParameterEstimate, &str)| {
        let errors = match limit_within_bounds(p) {
            None if p.limit.is_some() => {
                let (from, other) = if side == "lower" { ("above", "upper") } else { ("below", "lower") };
                format!(
                    "the data do not bound it from {from}: 95 % probability reaches beyond its {other} bound; errors of the others allow for that"
                )
            }
            Some(limit) => {
                let word = if limit > p.value { "below" } else { "above" };
                format!(
                    "with 95 % probability it is {word} {}, and errors of the others allow for that",
                    digits(limit, 3)
                )
            }
            None => "errors of the others hold only where that is the true value".into(),
        };
        let name = called(p);
        format!(
            "{name} is at its {side} bound: the best value may lie beyond it, or far from these start values (try --starts 8); {errors}"
        )
    };
    let shown: Vec<String> = held.clone().take(MOST_BOUNDS).map(say).collect();
    let more = held.count().saturating_sub(MOST_BOUNDS);
    shown.into_iter().chain((more > 0).then(|| format!("{more} more parameters are at a bound"))).collect()
}

/// Outputs of so few samples that the colour of their noise is not known, or not well; where it is known beforehand there is nothing to say.
fn few(estimate: &Estimate) -> Option<Remark> {
    if estimate.colours.is_empty() || estimate.parameters.iter().all(|p| p.degrees_of_freedom.is_none()) {
        return None;
    }
    let mut counts: Vec<(&str, usize)> = Vec::new();
    for o in estimate.outputs.iter().filter(|o| o.compared > 0) {
        match counts.iter_mut().find(|(name, _)| *name == o.name) {
            Some((_, count)) => *count += o.compared,
            None => counts.push((&o.name, o.compared)),
        }
    }
    let most = counts.iter().map(|(_, count)| *count).max().unwrap_or(0);
    let short = estimate.outputs.iter().any(|o| o.compared > 0 && o.compared < LONG_RUN);
    match most {
        0 => None,
        1..=FEW_SAMPLES => Some(Remark::new(
            About::Short,
            format!(
                "{most} samples do not determine the colour of their noise: if it drifts or oscillates slowly, fewer than 95 % of such intervals hold"
            ),
        )),
        _ if short && !estimate.colours.iter().all(NoiseColour::is_white) => Some(Remark::new(
            About::Intervals,
            format!(
                "{most} samples tell the colour of their noise only as one of a few kinds: of what is slower than the record they say nothing, and the errors are the least that agrees with it"
            ),
        )),
        _ => None,
    }
}

/// An interval that the likelihood contradicts, and of which other parameters that holds likewise.
fn curved(estimate: &Estimate, c: &Curvature) -> String {
    let end = |value: Option<f64>| value.map_or("no end".to_string(), |v| digits(v, 4));
    let own = |k: usize| estimate.parameters[k].name == c.parameter && estimate.parameters[k].run == c.run;
    let partner = |(a, b, _): &(usize, usize, f64)| if own(*a) { Some(*b) } else { own(*b).then_some(*a) };
    let pairs = estimate.correlated(CORRELATED);
    // what has a line of its own needs none here
    let has_line = |k: &usize| {
        let p = &estimate.parameters[*k];
        estimate.curvature.iter().any(|c| c.parameter == p.name && c.run == p.run)
    };
    let partners: Vec<String> = pairs
        .iter()
        .filter_map(partner)
        .filter(|k| !has_line(k))
        .take(MOST_PAIRS)
        .map(|k| called(&estimate.parameters[k]))
        .collect();
    let like = if partners.is_empty() { String::new() } else { format!("; {} likewise", partners.join(", ")) };
    let name = with_run(&c.parameter, c.run.as_deref());
    let wrong = match c.is_narrow() {
        true => format!("the interval of {name} holds in about {:.0} of 100 cases", 100.0 * c.holds),
        false => format!("the interval of {name} reaches much further than the data allow"),
    };
    let profile = match c.interval {
        [None, None] => "its profile has no end within twenty standard errors".to_string(),
        [low, high] => format!("its profile gives {} to {}", end(low), end(high)),
    };
    format!("the likelihood is curved: {wrong}; {profile}{like} (`fdm profile`)")
}

/// Noise of spectra that grows on towards frequencies below those that were compared is not known from them.
fn steep(estimate: &Estimate) -> Vec<String> {
    let rising = estimate.spectral_colours.iter().filter(|c| !c.is_white() && c.falls);
    let names: Vec<String> = rising.map(|c| format!("`{}`", c.output)).collect();
    if names.is_empty() {
        return Vec::new();
    }
    vec![format!(
        "noise of {} is stronger at low frequencies: its power within one bin is not known, and fewer than 95 % of such intervals hold",
        names.join(", ")
    )]
}

/// Whether the Cramer-Rao errors can be trusted.
fn colour(estimate: &Estimate) -> Vec<String> {
    if estimate.uncorrected == Some(Uncorrected::Innovations) {
        return Vec::new();
    }
    // where no parameter has an error there is none to correct
    let has_errors = estimate.parameters.iter().any(|p| p.standard_error.is_some());
    if let Some(reason) = estimate.uncorrected.as_ref().filter(|_| estimate.noise.is_some() && has_errors) {
        return vec![format!("errors are not corrected for the colour of the residuals: {reason}")];
    }
    let mut coloured: Vec<String> = Vec::new();
    let in_time = estimate.colours.iter().filter(|c| !c.is_white()).map(|c| &c.output);
    let in_spectra = estimate.spectral_colours.iter().filter(|c| !c.is_white()).map(|c| &c.output);
    for output in in_time.chain(in_spectra) {
        let name = format!("`{output}`");
        if !coloured.contains(&name) {
            coloured.push(name);
        }
    }
    let factors = estimate.correction_factors();
    let (Some(low), Some(high)) = (factors.first(), factors.last()) else { return Vec::new() };
    if coloured.is_empty() {
        return Vec::new();
    }
    let middle = factors[factors.len() / 2];
    let (size, middle, low, high) = match middle < 1.0 {
        true => ("large", 1.0 / middle, 1.0 / high, 1.0 / low),
        false => ("small", middle, *low, *high),
    };
    let range = if high > 1.2 * low && low >= 1.0 {
        format!(" ({} to {})", digits(low, 2), digits(high, 2))
    } else {
        String::new()
    };
    vec![format!(
        "residuals of {} are coloured: the Cramer-Rao errors are {} times too {size}{range}; trust the corrected ones",
        coloured.join(", "),
        digits(middle, 2)
    )]
}

/// Outputs whose noise varies, what with, and what was done about it.
fn varying(estimate: &Estimate) -> Vec<String> {
    let one = |v: &NoiseVariation| {
        let name = format!("`{}`", v.output);
        let grows = |trend: Option<Trend>| trend.is_some_and(|t| t.correlation > 0.0);
        let verb = |grows: bool| if grows { "grows" } else { "falls" };
        let cause = match v.causes().first()? {
            Cause::Response => format!("noise of {name} {} with the size of the signal", verb(grows(v.response))),
            Cause::Time => format!("noise of {name} {} with time", verb(grows(v.time))),
            Cause::Run => format!("noise of {name} differs from run to run"),
        };
        let [low, high] = v.deviations.map(|d| digits(d, 2));
        let range = if low == high { String::new() } else { format!(", from {low} to {high}") };
        let done = match estimate.noise.is_some() && estimate.uncorrected.is_none() && low != high {
            true => format!(
                ": the corrected errors allow for it; a model of the noise (`noise {} = ...;`, in the time domain) would use the data better",
                v.output
            ),
            // a noise model is there, and does not say it all
            false => ": what the model says of the noise is not all of it".into(),
        };
        Some(format!("{cause} ({}){range}{done}", p_value(v.p_value)))
    };
    estimate.noise_variation.iter().filter(|v| v.is_significant()).filter_map(one).collect()
}

fn called(p: &ParameterEstimate) -> String {
    with_run(&p.name, p.run.as_deref())
}

/// A name, and the run that it belongs to where there is one.
pub fn with_run(name: &str, run: Option<&str>) -> String {
    run.map_or_else(|| name.to_string(), |run| format!("{name} ({run})"))
}

/// Most states and parameters that are named.
const NAMED: usize = 3;

/// What the record says, what the text says, what to write, and what becomes of the parameters.
pub(super) fn sentence(doubted: &DoubtedInitials) -> Option<String> {
    let far = |v: &DoubtedInitial| v.error.map_or(f64::INFINITY, |error| ((v.found - v.stated) / error).abs());
    let mut states: Vec<&DoubtedInitial> = Vec::new();
    for value in &doubted.values {
        match states.iter_mut().find(|known| known.state == value.state) {
            Some(known) if far(value) > far(known) => *known = value,
            Some(_) => {}
            None => states.push(value),
        }
    }
    let first = states.first()?;
    let runs = doubted.values.iter().filter(|v| v.state == first.state).count();
    let one = |v: &&DoubtedInitial| {
        let unit = v.unit.as_ref().map_or(String::new(), |u| format!(" {u}"));
        let run = if runs > 1 { format!(" in {}", v.run) } else { String::new() };
        let (found, stated) = (by_error(v.found, v.error), digits(v.stated, 3));
        format!("with `{}` at {found}{unit}{run}, the text says {stated}", v.state)
    };
    let stated: Vec<String> = states.iter().take(NAMED).map(one).collect();
    let free: Vec<String> = states.iter().map(|v| format!("{} = free", v.state)).collect();
    let moved =
        |m: &MovedParameter| format!("{} {} in place of {}", m.name, by_error(m.value, m.error), digits(m.before, 3));
    let moved: Vec<String> = doubted.parameters.iter().take(NAMED).map(moved).collect();
    let then = if moved.is_empty() { String::new() } else { format!("; then {}", moved.join(", ")) };
    let gain = digits(doubted.gain, 3);
    Some(format!(
        "the record begins {}: write `state {};`, log-likelihood +{gain}{then}",
        stated.join("; "),
        free.join(", ")
    ))
}

/// A value with the digits that its error leaves.
fn by_error(value: f64, error: Option<f64>) -> String {
    let places = error.and_then(|error| digits_by_error(value, error, 3)).unwrap_or(3);
    digits(value, places)
}

/// Parameters that are named.
const NAMED_MINIMA: usize = 4;
/// Standard errors by which a parameter is elsewhere.
const ELSEWHERE: f64 = 1.0;

/// For each of them where it is, by the parameters that differ.
pub(super) fn equal_minima(fit: &Fit) -> Vec<String> {
    let estimated = |p: &&ParameterEstimate| !matches!(p.status, Status::Fixed | Status::Derived | Status::Tied);
    let free: Vec<&ParameterEstimate> = fit.estimate.parameters.iter().filter(estimated).collect();
    let line = |start: &StartSummary| {
        let elsewhere = |(p, value): &(&ParameterEstimate, &f64)| {
            let off = (p.value - **value).abs();
            p.standard_error.map_or(off > 1e-6 * p.value.abs(), |error| off > ELSEWHERE * error)
        };
        let all: Vec<String> = free
            .iter()
            .copied()
            .zip(&start.values)
            .filter(elsewhere)
            .map(|(p, value)| {
                let of = p.run.as_ref().map_or(String::new(), |run| format!(" of {run}"));
                format!("{}{of} {} in place of {}", p.name, digits(*value, 4), digits(p.value, 4))
            })
            .collect();
        let more = all.len().saturating_sub(NAMED_MINIMA);
        let rest = if more > 0 { format!(", and {more} more") } else { String::new() };
        let places = all[..all.len().min(NAMED_MINIMA)].join(", ");
        format!("another minimum is as good (start {}): {places}{rest}", start.number)
    };
    fit.equal_minima().into_iter().map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use fdm_estimate::residuals::Untested;

    #[test]
    fn an_offset_is_what_chance_does_not_explain() {
        let of = |values: &[f64]| OutputQuality {
            fit: OutputFit::new("y", "r", values, &vec![0.0; values.len()], 0, 1),
            untested: None,
            whiteness: None,
            spectrum: None,
            distribution: None,
            inputs: Vec::new(),
        };
        let noise = |n: usize, mean: f64| (0..n).map(|k| mean + (2.4 * k as f64 + 0.3).sin()).collect::<Vec<f64>>();
        // a quarter of the mean square: chance in eight samples, none in eighty
        for (n, offsets) in [(8, 0), (80, 1)] {
            let quality = of(&noise(n, 0.42));
            assert!(quality.fit.tic_parts.is_some_and(|p| p.bias > OFFSET), "{:?}", quality.fit);
            let said = residual_remarks(&[quality], "s");
            assert_eq!(said.iter().filter(|r| r.about == About::Offset).count(), offsets, "{n} samples: {said:?}");
        }
    }

    #[test]
    fn what_could_not_be_tested_is_said_once_for_each_run() {
        let of = |name: &str, run: &str| OutputQuality {
            fit: OutputFit::new(name, run, &[1.0, 2.0], &[1.0, 2.5], 0, 1),
            untested: Some(Untested::UnevenSampling),
            whiteness: None,
            spectrum: None,
            distribution: None,
            inputs: Vec::new(),
        };
        let said = residual_remarks(&[of("a", "r"), of("b", "r"), of("a", "s")], "s");
        let said: Vec<String> = said.iter().map(ToString::to_string).collect();
        let tests: Vec<&String> = said.iter().filter(|s| s.contains("not tested")).collect();
        assert!(tests.len() == 2 && tests[0].starts_with("residuals of `a`, `b` in r were not tested: "), "{said:?}");
        assert!(tests[1].starts_with("residual of `a` in s was not tested: "), "{said:?}");
    }
}
