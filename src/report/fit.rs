//! A fit: how it ended and whether it can be trusted, its parameters and residuals, what should not be overlooked, and how it came about.

use super::section::{Part, Point, Section, Trust, Verdict, capital};
use super::words::Words;
use crate::page::number::{behind, shown, text as number};
use crate::{parameters, remarks, residuals, text};
use fdm_estimate::Estimate;
use fdm_results::documents::{About, FitDocument, OutputDocument, Remark, Terminated, estimate_remarks};

/// How much a table shows.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Detail {
    /// The interval of 95 % of each parameter.
    pub intervals: bool,
    /// Every remark, not only the five that speak most against the result.
    pub verbose: bool,
    /// The words of the model's field.
    pub words: Words,
}

/// Parameters with standard errors, then the quality of each output, then what should not be overlooked.
pub fn estimate_table(estimate: &Estimate) -> String {
    estimate_text(estimate, Detail { verbose: true, ..Detail::default() })
}

/// Parameters with standard errors, the quality of each output and remarks, with so much detail.
pub fn estimate_text(estimate: &Estimate, detail: Detail) -> String {
    let outputs: Vec<OutputDocument> = estimate.outputs.iter().map(OutputDocument::from).collect();
    let section = Section::new("fit", "Fit").with(parameters::table(&estimate.parameters, false));
    let section = section.with_all((!outputs.is_empty()).then(|| residuals::table(&outputs)));
    closed(section, remark_lines(&estimate_remarks(estimate), detail), detail.words)
}

/// Tables of a fit in the time domain: parameters with standard errors, each output with the tests of its residuals, and remarks, with so
/// much detail; of a filter the measurement noise too.
pub fn fit_table(fit: &FitDocument, detail: Detail) -> String {
    let tested = fit.outputs.iter().any(|o| o.whiteness.is_some());
    let mut last = remark_lines(&fit.remarks, detail);
    if let Some(deviations) = &fit.deviations {
        let innovations = "residuals are innovations: measured minus predicted from the sample before";
        if tested {
            last.push(Part::Line(innovations.into()));
        }
        if tested && !deviations.is_empty() {
            last.push(parameters::table(deviations, detail.intervals).into());
        }
    }
    let silent = fit.not_identifiable.iter().flatten();
    last.extend(silent.map(|name| Part::Line(format!("`{name}` stands at 0: the records show no noise there"))));
    let section = Section::new("fit", "Fit").with(parameters::table(&fit.parameters, detail.intervals && tested));
    let section = section.with_all((!fit.outputs.is_empty()).then(|| residuals::table(&fit.outputs)));
    closed(section, last, detail.words)
}

/// Remarks as lines.
pub(crate) fn remark_lines(remarks: &[Remark], detail: Detail) -> Vec<Part> {
    remarks::lines(remarks, detail.verbose).into_iter().map(Part::Line).collect()
}

/// With what is said last; its last line is left open.
pub(crate) fn closed(section: Section, last: Vec<Part>, words: Words) -> String {
    if last.is_empty() {
        return text::sections(&[words.section(section)]);
    }
    let text = text::sections(&[words.section(section.with(Part::Gap).with_all(last))]);
    text.trim_end_matches('\n').into()
}

/// One line on every strategy that led to the estimates; empty when the plain iteration did.
pub fn way(fit: &FitDocument) -> String {
    let substituted = fit.substituted.as_deref().filter(|states| !states.is_empty());
    let substituted = substituted
        .map(|states| format!("started from a fit with the measured {} in the equations", states.join(", ")));
    let fallback = fit.fallback_message.clone().flatten();
    let shooting = fit.shooting.as_ref().and_then(|cut| cut.as_ref()).map(|cut| {
        let end = match cut.polished {
            true => "the whole model went on from there without cuts".to_string(),
            false => format!("largest gap left {:.0e} of the state's size", cut.largest_gap),
        };
        format!("multiple shooting in {} segments; {end}", cut.segments)
    });
    [substituted, fallback, shooting].into_iter().flatten().map(|line| format!("{line}\n")).collect()
}

/// What speaks against a result, the heaviest first, each with the section that shows it.
pub(crate) fn points(fit: &FitDocument) -> Vec<Point> {
    let mut remarks: Vec<&Remark> = fit.remarks.iter().collect();
    remarks.sort_by_key(|r| r.about.rank());
    remarks.iter().map(|r| Point { sentence: capital(&r.sentence), anchor: place(r.about) }).collect()
}

/// How a fit ended and whether anything speaks against it, in a sentence.
pub fn fit_verdict(fit: &FitDocument) -> String {
    verdict(fit).sentence
}

pub(crate) fn verdict(fit: &FitDocument) -> Verdict {
    let what = if fit.validation.is_some() { "The validation" } else { "The fit" };
    if fit.termination != Terminated::Converged {
        return Verdict::new(Trust::Bad, format!("{what} did not end well: {}.", fit.message));
    }
    if let Some(first) = fit.remarks.iter().find(|r| r.about == About::Unexplained) {
        return Verdict::new(Trust::Bad, format!("{what} converged, but {}.", first.sentence));
    }
    if !fit.undetermined.is_empty() {
        let said = format!(
            "{what} converged, but the data do not determine every parameter: errors and values below hold only where they are shown."
        );
        return Verdict::new(Trust::Bad, said);
    }
    if fit.remarks.iter().any(|r| r.about == About::Likelihood) {
        let said =
            format!("{what} converged, but the likelihood has no maximum: values and errors below mean nothing.");
        return Verdict::new(Trust::Bad, said);
    }
    let bounds = fit.remarks.iter().filter(|r| r.about == About::Bound).count();
    let against = fit.remarks.iter().filter(|r| r.about.speaks_against()).count();
    let (trust, said) = match (bounds, against) {
        (0, 0) => (Trust::Good, format!("{what} converged, and nothing speaks against the result.")),
        (0, _) => (Trust::Reserved, format!("{what} converged; read the remarks below before the numbers are used.")),
        (1, _) => (Trust::Reserved, format!("{what} converged with a parameter at its bound.")),
        (n, _) => (Trust::Reserved, format!("{what} converged with {n} parameters at their bounds.")),
    };
    Verdict::new(trust, said)
}

/// How much was fitted to how much, and which output is matched worst.
pub(crate) fn facts(fit: &FitDocument) -> Option<String> {
    let outputs = fit.outputs_in_time();
    let parameters = fit.parameters.iter().filter(|p| p.standard_error.is_some()).count();
    let mut runs: Vec<&str> = outputs.iter().map(|o| o.run.as_str()).collect();
    runs.sort_unstable();
    runs.dedup();
    let compared: usize = outputs.iter().map(|o| o.compared).sum();
    let below = match outputs.iter().map(|o| o.censored).sum() {
        0usize => String::new(),
        below => format!(", {below} below their limit"),
    };
    let explained = outputs.iter().filter_map(|o| Some((o, o.r2?)));
    let (worst, r2) = explained.min_by(|a, b| a.1.total_cmp(&b.1))?;
    let place = if runs.len() > 1 { format!(" in {}", worst.run) } else { String::new() };
    let count = |n: usize, what: &str| format!("{n} {what}{}", if n == 1 { "" } else { "s" });
    Some(format!(
        "{} estimated from {} ({compared} measured values{below}). Matched worst: {}{place}, of whose variance the model explains {} % (RMS of the residual {}{}).",
        count(parameters, "parameter"),
        count(runs.len(), "run"),
        worst.name,
        number(100.0 * r2, 4),
        shown(worst.rms, 3),
        behind(worst.unit.as_deref()),
    ))
}

/// The section where what a remark is about can be seen.
fn place(about: About) -> &'static str {
    match about {
        About::Initial
        | About::Undetermined
        | About::Likelihood
        | About::Minima
        | About::Bound
        | About::Few
        | About::Short
        | About::Biased
        | About::Intervals
        | About::Prior => "parameters",
        About::Correlated => "correlations",
        About::Table => "tables",
        About::Iteration => "convergence",
        About::Unexplained
        | About::Offset
        | About::Input
        | About::Interpolation
        | About::InterpolationUnknown
        | About::Colour
        | About::Noise
        | About::NoNoise
        | About::Untested
        | About::NotMeasured
        | About::Bridged
        | About::Regressors => "residuals",
    }
}
