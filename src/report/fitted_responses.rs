//! A fit of frequency responses as tables and sentences, and as tables of responses.

use super::estimate::{Detail, parameter_table, remark_lines};
use super::spectral::{first_values, prediction_table, trimmed_at};
use super::table::{aligned_right, plain, trimmed};
use fdm_estimate::{PairFit, ResponseFit};
use fdm_results::documents::{digits, estimate_remarks};
use std::f64::consts::TAU;

/// Cost up to which a model is good.
const GOOD: f64 = 100.0;
/// Cost up to which it cannot be told from the data.
const AS_DATA: f64 = 50.0;
/// Percent up to which a bound and an insensitivity are good.
const BOUND: f64 = 20.0;
const INSENSITIVE: f64 = 10.0;

/// Parameters with standard errors, bounds and insensitivities, what every pair costs, and how well time histories are matched.
pub fn fitted_response_table(fit: &ResponseFit, detail: Detail) -> String {
    let mut text = format!("{}\n", band(fit));
    text.push_str(&trimmed_at(&fit.model, fit.trim.as_ref()));
    text.push_str(&first_values(&fit.starting_values));
    text.push('\n');
    text.push_str(&parameter_table(&fit.parameters(), detail.intervals));
    if !fit.sensitivities.is_empty() {
        text.push_str(&format!("\n{}", sensitivity_table(fit)));
    }
    if !fit.pairs.is_empty() {
        text.push_str(&format!("\n{}", cost_table(fit)));
    }
    let left_out: usize = fit.pairs.iter().map(|p| p.left_out).sum();
    if left_out > 0 {
        let least = fit.least_coherence;
        text.push_str(&format!("\n{left_out} points with a coherence below {least} were left out"));
    }
    for (output, input) in &fit.incoherent {
        text.push_str(&format!(
            "\n{output}/{input} is nowhere coherent and was left out; sweeps that move {input} more would show it"
        ));
    }
    // outputs here are decibels and degrees, about which the rest is said above
    remark_lines(&estimate_remarks(&fit.estimate), detail).iter().for_each(|line| text.push_str(&format!("\n{line}")));
    if let Some(finish) = &fit.finish {
        text.push_str("\ntime histories, with initial states and biases of their own\n");
        text.push_str(&prediction_table(&finish.quality));
    }
    if let Some(why) = &fit.unfinished {
        text.push_str(&format!("\ninitial states and biases could not be found in the time domain: {why}\n"));
    }
    text
}

/// What was compared.
fn band(fit: &ResponseFit) -> String {
    let points: usize = fit.pairs.iter().map(|p| p.omega.len()).sum();
    let (time, (low, high)) = (&fit.model.definition().time, fit.band());
    let unit = if time.to_string() == "s" { "Hz".to_string() } else { format!("cycles per {time}") };
    let lengths: Vec<String> = fit.segments.iter().map(|l| digits(*l, 3)).collect();
    let mut text = format!("frequency responses from segments of {} {time}", lengths.join(", "));
    if points > 0 {
        let ends = format!("{} to {} {unit}", digits(low, 4), digits(high, 4));
        text.push_str(&format!("; {} pairs, {points} points, {ends}", fit.pairs.len()));
    }
    text
}

fn verdict(cost: f64) -> &'static str {
    match cost {
        c if c <= AS_DATA => "as good as the data",
        c if c <= GOOD => "good",
        _ => "does not match",
    }
}

fn cost_table(fit: &ResponseFit) -> String {
    let mut table = plain(&["response", "frequencies", "left out", "coherence", "cost", ""]);
    for p in &fit.pairs {
        let least = p.coherence.iter().copied().fold(1.0, f64::min);
        let (count, left_out) = (p.omega.len().to_string(), p.left_out.to_string());
        let range = format!("{least:.2} to {:.2}", p.coherence.iter().copied().fold(0.0, f64::max));
        let name = format!("{}/{}", p.output, p.input);
        table.add_row([name, count, left_out, range, digits(p.cost, 3), verdict(p.cost).to_string()]);
    }
    if let Some(cost) = fit.cost() {
        let blank = String::new;
        table.add_row(["average".into(), blank(), blank(), blank(), digits(cost, 3), verdict(cost).to_string()]);
    }
    [1, 2, 4].into_iter().for_each(|column| aligned_right(&mut table, column));
    trimmed(&table)
}

fn sensitivity_table(fit: &ResponseFit) -> String {
    let mut table = plain(&["parameter", "2 x Cramer-Rao %", "insensitivity %"]);
    let marked = |v: f64, limit: f64| format!("{}{}", digits(v, 3), if v > limit { "!" } else { "" });
    for s in &fit.sensitivities {
        table.add_row([s.parameter.clone(), marked(s.cramer_rao, BOUND), marked(s.insensitivity, INSENSITIVE)]);
    }
    (1..3).for_each(|column| aligned_right(&mut table, column));
    trimmed(&table)
}

/// A pair as columns: frequency, measured and modelled decibels and degrees, coherence.
pub fn fitted_response_columns(pair: &PairFit) -> Vec<(&'static str, Vec<f64>)> {
    let part = |of: &[[f64; 2]], k: usize| of.iter().map(|v| v[k]).collect();
    vec![
        ("frequency", pair.omega.iter().map(|w| w / TAU).collect()),
        ("decibels", part(&pair.measured, 0)),
        ("degrees", part(&pair.measured, 1)),
        ("decibels_model", part(&pair.modelled, 0)),
        ("degrees_model", part(&pair.modelled, 1)),
        ("coherence", pair.coherence.clone()),
        ("error", pair.error.clone()),
    ]
}
