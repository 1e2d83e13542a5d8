//! What should not be overlooked in a result, in plain words.

use super::digits::digits;
use fdm_estimate::residuals::{InputCorrelation, OutputQuality};
use fdm_estimate::{Estimate, Fit, ParameterEstimate, Status, Uncorrected};
use serde::{Deserialize, Serialize};
use std::fmt;

/// What a remark is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum About {
    /// Parameters that nothing determines.
    Undetermined,
    /// Parameters that priors determine, not data.
    Prior,
    /// Parameters that the data tell apart badly.
    Correlated,
    /// Parameters at their bounds.
    Bound,
    /// Parameters that noise in the equations had drawn.
    Drawn,
    /// Help that the iteration needed.
    Iteration,
    /// An output that is matched to rounding.
    NoNoise,
    /// The colour of the residuals, and what it does to standard errors.
    Colour,
    /// Residuals that are an offset.
    Offset,
    /// Residuals that follow or lead an input.
    Input,
    /// Residuals that could not be tested.
    Untested,
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

/// Correlations beyond this are worth a line.
const CORRELATED: f64 = 0.9;
/// Standard errors that a parameter was drawn, worth a line.
const DRAWN: f64 = 0.3;
/// Most lines about pairs of parameters.
const MOST_PAIRS: usize = 6;
/// Part of the mean square residual that makes an offset worth a line.
const OFFSET: f64 = 0.2;
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
    let mut say = |about, said: Vec<String>| remarks.extend(said.into_iter().map(|s| Remark::new(about, s)));
    say(About::Correlated, correlated(estimate));
    say(About::Bound, bounds(estimate));
    say(About::Drawn, drawn(estimate));
    say(About::Iteration, estimate.aids.iter().map(|aid| format!("the iteration needed help: {aid}")).collect());
    let rounding = |o: &String| format!("`{o}` is matched to rounding: its noise and the standard errors mean nothing");
    say(About::NoNoise, estimate.noise_free.iter().map(rounding).collect());
    if estimate.noise_free.is_empty() {
        say(About::Colour, colour(estimate));
    }
    remarks
}

/// Parameters that the noise of records in the equations had drawn far enough to be worth a line.
fn drawn(estimate: &Estimate) -> Vec<String> {
    let far = estimate.bias_corrections.iter().filter(|d| d.standard_errors.abs() > DRAWN);
    let far: Vec<String> = far
        .map(|d| format!("{} by {}", named(&d.name, d.run.as_deref()), digits(d.standard_errors.abs(), 2)))
        .collect();
    if far.is_empty() {
        return Vec::new();
    }
    let list = far.join(", ");
    vec![format!(
        "noise of records that stand in the equations had drawn {list} standard errors: that has been taken off"
    )]
}

/// Both, of a fit in the time domain.
pub fn fit_remarks(fit: &Fit) -> Vec<Remark> {
    let mut remarks = estimate_remarks(&fit.estimate);
    if fit.estimate.noise_free.is_empty() {
        remarks.extend(residual_remarks(&fit.quality, &fit.model.definition().time.to_string()));
    }
    remarks
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
        if let Some(parts) = q.fit.tic_parts.filter(|p| p.bias > OFFSET) {
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

/// Pairs that the data tell apart badly, the worst first.
fn correlated(estimate: &Estimate) -> Vec<String> {
    let name = |k: usize| called(&estimate.parameters[k]);
    let mut pairs = estimate.correlated(CORRELATED);
    pairs.sort_by(|a, b| b.2.abs().total_cmp(&a.2.abs()));
    let told =
        pairs.iter().take(MOST_PAIRS).map(|(a, b, r)| format!("correlated: {} and {} ({r:+.3})", name(*a), name(*b)));
    let more = pairs.len().saturating_sub(MOST_PAIRS);
    told.chain((more > 0).then(|| format!("{more} more pairs correlate by more than {CORRELATED}"))).collect()
}

/// A bound may hide a better value behind it, or be where a way downhill from the start values ends.
fn bounds(estimate: &Estimate) -> Vec<String> {
    let side = |p: &ParameterEstimate| match p.status {
        Status::AtLowerBound => Some("lower"),
        Status::AtUpperBound => Some("upper"),
        _ => None,
    };
    let held = estimate.parameters.iter().filter_map(|p| Some((called(p), side(p)?)));
    let told: Vec<String> = held.clone().take(MOST_BOUNDS).map(|(name, side)| {
        format!("{name} is at its {side} bound: the best value may lie beyond it, or far from these start values (try --starts 8)")
    }).collect();
    let more = held.count().saturating_sub(MOST_BOUNDS);
    told.into_iter().chain((more > 0).then(|| format!("{more} more parameters are at a bound"))).collect()
}

/// Whether the Cramer-Rao errors can be trusted.
fn colour(estimate: &Estimate) -> Vec<String> {
    if estimate.uncorrected == Some(Uncorrected::Innovations) {
        return Vec::new();
    }
    if let Some(reason) = estimate.uncorrected.as_ref().filter(|_| estimate.noise.is_some()) {
        return vec![format!("errors are not corrected for the colour of the residuals: {reason}")];
    }
    let mut coloured: Vec<String> = Vec::new();
    for c in estimate.colours.iter().filter(|c| !c.is_white()) {
        let name = format!("`{}`", c.output);
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

fn called(p: &ParameterEstimate) -> String {
    named(&p.name, p.run.as_deref())
}

/// The same by name and run.
fn named(name: &str, run: Option<&str>) -> String {
    run.map_or(name.to_string(), |run| format!("{name} ({run})"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use fdm_estimate::residuals::{OutputFit, Untested};

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
