//! A fit in the frequency domain: what was compared, how well spectra and time histories are matched, and the spectra themselves.

use super::fit::{Detail, closed, remark_lines};
use super::fitted_responses;
use super::section::{Part, Section};
use crate::page::columns::Columns;
use crate::page::figure::Panel;
use crate::page::figure::{Figure, Look, Mark};
use crate::page::number::{bracketed, unit_of_frequency};
use crate::page::subject::Subject;
use crate::parameters;
use crate::residuals::{self, prediction_table};
use fdm_estimate::{Fit, SpectralFit, StartingValue, UnobservableMode};
use fdm_results::documents::{OutputDocument, digits, spectral_remarks, trim_sentence};
use fdm_system::linear::{Obtained, Trim};
use fdm_system::model::Model;
use std::f64::consts::TAU;
use std::fmt::Display;

/// Figures that are drawn.
const MOST: usize = 40;
/// Figures that are drawn behind time histories: paper is short.
const IN_TIME: usize = 16;

/// Parameters with standard errors, what became of nonlinear terms, and how well spectra and time histories are matched.
pub fn spectral_table(fit: &SpectralFit, detail: Detail) -> String {
    let regressors: Vec<String> =
        fit.measured_regressors.iter().map(|t| format!("{} ({})", t.text, t.equations.join(", "))).collect();
    let regressors =
        (!regressors.is_empty()).then(|| format!("known inputs computed from records: {}", regressors.join("; ")));
    let ends = (!fit.end_points.is_empty())
        .then(|| format!("({} end values of states in all runs were found with them)", fit.end_points.len()));
    let outputs: Vec<OutputDocument> = fit.estimate.outputs.iter().map(OutputDocument::from).collect();
    let spectra = (!outputs.is_empty()).then(|| residuals::table(&outputs).below("spectra, real and imaginary parts"));
    let mut last = remark_lines(&spectral_remarks(fit), detail);
    if !fit.dependent.is_empty() {
        last.push(Part::Line(format!(
            "the residuals of {} depend on each other linearly, so that their covariance S is singular: leave one of them out \
             of the model, or say --noise diagonal",
            fit.dependent.join(", ")
        )));
    }
    let unexcited = fit.unexcited.iter();
    last.extend(unexcited.map(|input| {
        Part::Line(format!("the input {input} has no power in the band of any run; what it moves was not seen"))
    }));
    let section = Section::new("fit", "Fit")
        .line(band(fit))
        .lines(regressors)
        .lines(trimmed_at(&fit.model, fit.trim.as_ref()))
        .lines(first_values(&fit.starting_values))
        .with(parameters::table(&fit.parameters(), detail.intervals))
        .lines(ends)
        .with_all(spectra);
    closed(section, last, detail.words) + &in_time(fit.finish.as_ref(), fit.unfinished.as_ref())
}

/// How well time histories are matched behind a fit in the frequency domain, or why that is not known.
pub(crate) fn in_time(finish: Option<&Fit>, unfinished: Option<&impl Display>) -> String {
    let finish = finish.map(|fit| {
        format!("\ntime histories, with initial states and biases of their own\n{}", prediction_table(&fit.quality))
    });
    let unfinished =
        unfinished.map(|why| format!("\ninitial states and biases could not be found in the time domain: {why}\n"));
    finish.unwrap_or_default() + &unfinished.unwrap_or_default()
}

/// What was compared in the frequency domain: frequency responses with coherence, or the spectra of the outputs; behind a fit in time what
/// its runs show.
pub(crate) fn section(subject: &Subject) -> Option<Section> {
    let (figures, fit) = (figures(subject), subject.fit());
    if figures.is_empty() {
        return None;
    }
    if let Some(fit) = fit.filter(|fit| !fit.bode.is_empty()) {
        let said = "What the runs show, and the model's response over the same time, estimated by the same windows. \
                    Bars are two random errors, as the coherence tells them.";
        let more = fit.bode.len().saturating_sub(IN_TIME);
        return Some(
            Section::new("spectra", "Frequency responses")
                .line(said)
                .with(Part::Pair(figures))
                .notes((more > 0).then(|| format!("{more} more pairs are in `result.json`, `bode`."))),
        );
    }
    let section = Section::new("spectra", "Frequency domain");
    let responses = fit.and_then(|fit| fit.frequency_responses.as_ref()).filter(|found| !found.pairs.is_empty());
    Some(match responses {
        Some(found) => section.with_all(fitted_responses::parts(found, figures)),
        None => section
            .note("Magnitudes of the spectra that were compared, and of what is left between them.")
            .with(Part::Pair(figures)),
    })
}

/// Of every pair, or of every output of every run.
pub(crate) fn figures(subject: &Subject) -> Vec<Figure> {
    let (unit, fit) = (subject.frequency(), subject.fit());
    let pairs = fit.and_then(|fit| fit.frequency_responses.as_ref()).into_iter().flat_map(|found| &found.pairs);
    let in_time = fit.into_iter().flat_map(|fit| fit.bode.iter().take(IN_TIME));
    let pairs = pairs.chain(in_time).enumerate().map(|(k, p)| fitted_responses::figure(k, p, &unit));
    let of_runs = subject.spectra.iter().enumerate().flat_map(|(k, (run, table))| of_run(k, run, table, &unit));
    pairs.chain(of_runs).take(MOST).collect()
}

fn of_run(k: usize, run: &str, table: &Columns, unit: &str) -> Vec<Figure> {
    let Some(frequency) = table.columns.first() else { return Vec::new() };
    let column = |name: String| table.column(&name).map_or(&[][..], |c| &c.values);
    let outputs = table.columns.iter().filter_map(|c| Some((c.name.strip_suffix("_model_re")?, c.unit.as_deref())));
    let figure = |(o, (name, own)): (usize, (&str, Option<&str>))| {
        let part = |kind: &str| column(format!("{name}{kind}")).to_vec();
        let [re, im, model_re, model_im] = ["_re", "_im", "_model_re", "_model_im"].map(part);
        let size = |re: &[f64], im: &[f64]| re.iter().zip(im).map(|(a, b)| a.hypot(*b)).collect::<Vec<f64>>();
        let less = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a - b).collect::<Vec<f64>>();
        let rest = size(&less(&re, &model_re), &less(&im, &model_im));
        let marks = vec![
            Mark::line("measured", Look::Measured, size(&re, &im)),
            Mark::line("model", Look::Model, size(&model_re, &model_im)),
            Mark::line("what is left", Look::Residual, rest),
        ];
        let label = format!("|{name}|{}", bracketed(own));
        Figure::new(
            format!("spectrum-{}-{}", k + 1, o + 1),
            format!("{name} in {run}"),
            format!("frequency [{unit}]"),
            frequency.values.clone(),
        )
        .in_group(format!("spectra-{k}"))
        .with(Panel::new(label, 190, marks).logarithmic())
        .logarithmic()
        .half()
    };
    outputs.enumerate().map(figure).collect()
}

/// What an unstable mode that no frequency response shows means.
pub fn hidden_mode(model: &Model, mode: &UnobservableMode) -> String {
    let states: Vec<&str> = mode.states.iter().map(|k| model.definition().states[*k].quantity.name.as_str()).collect();
    let s = match mode.s.im {
        0.0 => digits(mode.s.re, 4),
        im => format!("{} ± {}j", digits(mode.s.re, 4), digits(im, 4)),
    };
    let (why, help) = match (mode.observable, mode.controllable) {
        (false, false) => ("no output shows it and no input moves it", "leave its states out"),
        (false, true) => ("no output shows it", "measure what shows it, or leave its states out"),
        _ => ("no input moves it", "move it by an input, or leave its states out"),
    };
    format!(
        "the model has an unstable mode s = {s} of {} that the frequency domain cannot see, since {why}: the estimates say nothing about it, \
         and in the time domain it grows; {help}",
        states.join(", ")
    )
}

fn band(fit: &SpectralFit) -> String {
    let frequencies: usize = fit.spectra.iter().map(|s| s.omega.len()).sum();
    let (time, (low, high)) = (&fit.model.definition().time, fit.band);
    let unit = unit_of_frequency(&time.to_string());
    let worth = match fit.independent {
        worth if worth < 0.99 * frequencies as f64 => format!(
            "; closer than one cycle in the record they repeat each other and are worth {}, which all errors take into account",
            digits(worth, 3)
        ),
        _ => String::new(),
    };
    format!(
        "{frequencies} frequencies in {} run{}, {} to {} {unit}{worth}",
        fit.spectra.len(),
        if fit.spectra.len() == 1 { "" } else { "s" },
        digits(low, 4),
        digits(high, 4)
    )
}

/// What the estimation began with.
pub(crate) fn first_values(first: &[StartingValue]) -> Option<String> {
    let (regressed, own): (Vec<_>, Vec<_>) = first.iter().partition(|f| !f.equations.is_empty());
    if regressed.is_empty() {
        return None;
    }
    let values: Vec<String> = regressed.iter().map(|f| format!("{} = {}", f.parameter, digits(f.value, 4))).collect();
    let own: Vec<&str> = own.iter().map(|f| f.parameter.as_str()).collect();
    let rest = if own.is_empty() { String::new() } else { format!("; from the model: {}", own.join(", ")) };
    Some(format!("first values from equation error: {}{rest}", values.join(", ")))
}

/// Where a model was linearised, when that matters.
pub(crate) fn trimmed_at(model: &Model, trim: Option<&Trim>) -> Option<String> {
    trim.filter(|t| t.obtained != Obtained::NotNeeded).map(|trim| trim_sentence(model, trim))
}

/// Spectra of a run as columns: frequency, then for each output measured and modelled real and imaginary parts.
pub fn spectrum_columns(fit: &SpectralFit, run: usize) -> Vec<(String, Option<String>, Vec<f64>)> {
    let spectrum = &fit.spectra[run];
    let count = spectrum.omega.len();
    let mut columns = vec![("frequency".to_string(), None, spectrum.omega.iter().map(|w| w / TAU).collect())];
    for (o, output) in fit.model.definition().outputs.iter().enumerate() {
        let (name, unit) = (&output.quantity.name, output.quantity.unit.as_ref().map(ToString::to_string));
        for (kind, plane) in [("", &spectrum.measured), ("_model", &spectrum.modelled)] {
            let plane = &plane[o * count..(o + 1) * count];
            columns.push((format!("{name}{kind}_re"), unit.clone(), plane.iter().map(|v| v.re).collect()));
            columns.push((format!("{name}{kind}_im"), unit.clone(), plane.iter().map(|v| v.im).collect()));
        }
    }
    columns
}
