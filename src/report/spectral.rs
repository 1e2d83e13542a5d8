//! A fit in the frequency domain as tables and sentences, and as a table of spectra.

use super::estimate::{Detail, output_table, parameter_table, remark_lines};
use super::table::{aligned_right, plain, trimmed};
use fdm_estimate::residuals::OutputQuality;
use fdm_estimate::{SpectralFit, StartingValue, UnobservableMode};
use fdm_grammar::graph::Signal;
use fdm_results::documents::{digits, spectral_remarks};
use fdm_system::linear::{Obtained, Trim};
use fdm_system::model::Model;
use std::f64::consts::TAU;

/// Parameters with standard errors, what became of nonlinear terms, and how well spectra and time histories are matched.
pub fn spectral_table(fit: &SpectralFit, detail: Detail) -> String {
    let mut text = format!("{}\n", band(fit));
    text.push_str(&nonlinear(fit));
    text.push_str(&first_values(&fit.starting_values));
    text.push('\n');
    text.push_str(&parameter_table(&fit.parameters(), detail.intervals));
    if !fit.end_points.is_empty() {
        text.push_str(&format!("({} end values of states in all runs were found with them)\n", fit.end_points.len()));
    }
    if !fit.estimate.outputs.is_empty() {
        text.push_str(&format!("\nspectra, real and imaginary parts\n{}", output_table(&fit.estimate.outputs)));
    }
    remark_lines(&spectral_remarks(fit), detail).iter().for_each(|line| text.push_str(&format!("\n{line}")));
    if !fit.dependent.is_empty() {
        let outputs = fit.dependent.join(", ");
        text.push_str(&format!(
            "\nthe residuals of {outputs} depend on each other linearly, so that their covariance S is singular: leave one of them out \
             of the model, or say --noise diagonal"
        ));
    }
    for input in &fit.unexcited {
        text.push_str(&format!("\nthe input {input} has no power in the band of any run; what it moves was not seen"));
    }
    if let Some(finish) = &fit.finish {
        text.push_str("\ntime histories, with initial states and biases of their own\n");
        text.push_str(&prediction_table(&finish.quality));
    }
    if let Some(why) = &fit.unfinished {
        text.push_str(&format!("\ninitial states and biases could not be found in the time domain: {why}\n"));
    }
    text
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

/// How well time histories are matched: size of the residual and Theil's coefficient of every output.
pub fn prediction_table(quality: &[OutputQuality]) -> String {
    let mut table = plain(&["output", "run", "RMS", "R^2", "TIC"]);
    for q in quality {
        let number = |v: Option<f64>, n: usize| v.map_or(String::new(), |v| digits(v, n));
        let fit = &q.fit;
        table.add_row([fit.name.clone(), fit.run.clone(), number(fit.rms, 4), number(fit.r2, 5), number(fit.tic, 3)]);
    }
    (2..5).for_each(|column| aligned_right(&mut table, column));
    trimmed(&table)
}

fn band(fit: &SpectralFit) -> String {
    let frequencies: usize = fit.spectra.iter().map(|s| s.omega.len()).sum();
    let (time, (low, high)) = (&fit.model.definition().time, fit.band);
    let unit = if time.to_string() == "s" { "Hz".to_string() } else { format!("cycles per {time}") };
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
pub(super) fn first_values(first: &[StartingValue]) -> String {
    let (regressed, own): (Vec<_>, Vec<_>) = first.iter().partition(|f| !f.equations.is_empty());
    if regressed.is_empty() {
        return String::new();
    }
    let values: Vec<String> = regressed.iter().map(|f| format!("{} = {}", f.parameter, digits(f.value, 4))).collect();
    let own: Vec<&str> = own.iter().map(|f| f.parameter.as_str()).collect();
    let rest = if own.is_empty() { String::new() } else { format!("; from the model: {}", own.join(", ")) };
    format!("first values from equation error: {}{rest}\n", values.join(", "))
}

/// What was done about nonlinear terms.
fn nonlinear(fit: &SpectralFit) -> String {
    let mut text = String::new();
    if !fit.measured_regressors.is_empty() {
        let terms: Vec<String> =
            fit.measured_regressors.iter().map(|t| format!("{} ({})", t.text, t.equations.join(", "))).collect();
        text.push_str(&format!("known inputs computed from records: {}\n", terms.join("; ")));
    }
    text.push_str(&trimmed_at(&fit.model, fit.trim.as_ref()));
    text
}

/// Where a model was linearised, when that matters.
pub(super) fn trimmed_at(model: &Model, trim: Option<&Trim>) -> String {
    let Some(trim) = trim.filter(|t| t.obtained != Obtained::NotNeeded) else { return String::new() };
    let how = match trim.obtained {
        Obtained::Given => "given by the model",
        Obtained::Initial => "the initial values",
        _ => "solved from the equations",
    };
    let definition = model.definition();
    let held = |s: &Signal| match s {
        Signal::State(k) => definition.states[*k as usize].quantity.name.as_str(),
        Signal::Input(k) => definition.inputs[*k as usize].quantity.name.as_str(),
    };
    let held: Vec<&str> = trim.assumed.iter().map(held).collect();
    let held = if held.is_empty() { String::new() } else { format!(", {} held", held.join(", ")) };
    let states = definition.states.iter().zip(&trim.states).map(|(s, v)| (&s.quantity.name, v));
    let inputs = definition.inputs.iter().zip(&trim.inputs).map(|(i, v)| (&i.quantity.name, v));
    let values: Vec<String> = states.chain(inputs).map(|(name, v)| format!("{name} = {}", digits(*v, 5))).collect();
    format!("linearised at the trim ({how}{held}): {}\n", values.join(", "))
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
