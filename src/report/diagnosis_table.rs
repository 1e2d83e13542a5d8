//! A diagnosis as people read it: the verdict, the causes, what they explain, what was ruled out.

use super::table::{aligned_right, plain, trimmed};
use fdm_discover::{Cause, Diagnosis, FrontModel, OutputGain, Verdict};
use fdm_results::documents::{digits, fixed};
use std::fmt::Write;

/// Rows of the table of what would have been seen.
const SHOWN: usize = 12;
/// Standard errors by which a parameter has moved before it is shown.
const MOVED: f64 = 1.0;

/// Sentences and tables.
pub fn diagnosis_text(d: &Diagnosis) -> String {
    let mut text = unexplained(d);
    text.push_str(&verdict(d));
    text.push_str(&wrong(d));
    for (k, cause) in d.causes.iter().enumerate() {
        text.push_str(&one(k + 1, cause));
    }
    if d.causes.is_empty() {
        text.push_str(&leading(d));
    }
    text.push_str(&front(d));
    text.push_str(&matches(d));
    text.push_str(&moved(d));
    text.push_str(&ruled_out(d));
    if d.causes.is_empty() {
        text.push_str(&detectable(d));
    }
    text.push_str(&feedback(d));
    let _ = writeln!(text, "\nThe search ended: {}.", d.ended);
    d.notes.iter().for_each(|note| _ = writeln!(text, "{note}"));
    if let Some(spectral) = &d.spectral {
        let (low, high) = spectral.band;
        let _ = writeln!(
            text,
            "In the frequency domain, from {} to {} cycles per unit of time.",
            digits(low, 3),
            digits(high, 3)
        );
        spectral.notes.iter().for_each(|note| _ = writeln!(text, "{note}"));
    }
    if !d.left_out.is_empty() {
        let _ =
            writeln!(text, "{} candidates could not be tried (--json lists them with the reasons).", d.left_out.len());
    }
    text
}

/// Outputs of which the model explains nothing: what is found beside such a fit may be about the fit.
fn unexplained(d: &Diagnosis) -> String {
    let mut text = String::new();
    for (output, r2) in OutputGain::unexplained(&d.outputs) {
        let _ = writeln!(
            text,
            "The model as it was given explains nothing of {output} (R^2 {}): look at its structure and its start values first.",
            fixed(Some(r2), 2)
        );
    }
    text
}

fn verdict(d: &Diagnosis) -> String {
    let p = chance(d.family_wise_p);
    let text = match d.verdict {
        Verdict::EffectFound => format!("Something is missing from the model (family-wise p = {p}).\n"),
        Verdict::Disturbance => {
            format!("A disturbance (process noise) acts on the model (family-wise p = {p}).\n")
        }
        Verdict::UnknownCause if d.stopped => {
            format!("The model is wrong; the search for the cause was stopped (family-wise p = {p}).\n")
        }
        Verdict::UnknownCause => {
            format!("The model is wrong, but no effect of the catalogue explains how (family-wise p = {p}).\n")
        }
        Verdict::NoEffectFound if d.stopped => {
            format!("Nothing was found before the search was stopped (family-wise p = {p}).\n")
        }
        Verdict::NoEffectFound => format!("No missing effect detected (family-wise p = {p}).\n"),
    };
    let found = matches!(d.verdict, Verdict::EffectFound | Verdict::Disturbance);
    if d.stopped && found { format!("{text}The search was stopped before its end.\n") } else { text }
}

/// What is wrong, where, and what is left, in words.
fn wrong(d: &Diagnosis) -> String {
    let mut text = String::new();
    if d.verdict != Verdict::NoEffectFound {
        for sentence in d.lack_of_fit.iter().flat_map(|m| &m.sentences) {
            let _ = writeln!(text, "  {sentence}");
        }
    }
    for site in d.attribution.iter().flat_map(|a| &a.places).take(3) {
        let _ = writeln!(text, "something unknown at {}: the odds are e^{:.0} to 1", site.place, site.evidence);
    }
    for s in d.suggestions.iter().flat_map(|s| &s.list).take(3) {
        let _ = writeln!(text, "it looks like {:.4} * {} in {}", s.coefficient, s.function, s.place);
    }
    for warning in d.attribution.iter().flat_map(|a| &a.warnings) {
        let _ = writeln!(text, "{warning}");
    }
    text
}

fn chance(p: f64) -> String {
    if p < 1e-4 { format!("{p:.0e}") } else { format!("{p:.3}") }
}

fn one(number: usize, c: &Cause) -> String {
    let mut text = format!("\n{number}. {}: {}\n", c.place, c.doc);
    for p in &c.parameters {
        let unit = p.unit.as_ref().map_or(String::new(), |u| format!(" {u}"));
        let error = p.standard_error.map_or(String::new(), |e| format!(" +- {}", digits(e, 2)));
        let _ = writeln!(text, "   {} = {}{error}{unit}", p.name, digits(p.value, 5));
    }
    let held = c.gain_validation.map_or(String::new(), |g| format!(", {g:.1} on the validation runs"));
    let _ = writeln!(text, "   gain in log-likelihood {:.1}{held}; p {}", c.gain_training, chance(c.p));
    if c.group.len() > 1 {
        let others: Vec<String> =
            c.group[1..].iter().map(|r| format!("{} (score {:.1} to {:.1})", r.place, r.score, c.score)).collect();
        let _ = writeln!(text, "   these records cannot tell it from {}", others.join(", "));
    }
    if let Some(experiment) = &c.separating_experiment {
        let _ = writeln!(text, "   to tell apart {experiment}");
    }
    text
}

/// The candidates that came nearest.
fn leading(d: &Diagnosis) -> String {
    let Some(round) = d.steps.first() else { return String::new() };
    let mut table = plain(&["nearest candidates", "promised gain", "chance by itself"]);
    for s in round.ranking.iter().take(5) {
        table.add_row([s.place.to_string(), format!("{:.1}", s.gain), chance(s.chance)]);
    }
    (1..3).for_each(|column| aligned_right(&mut table, column));
    format!("\n{}", trimmed(&table))
}

/// Outputs whose errors have columns of their own.
const OUTPUTS: usize = 2;

/// The best models by number of effects, by what their texts do when they are simulated.
fn front(d: &Diagnosis) -> String {
    if d.front.len() < 2 {
        return String::new();
    }
    let validated = d.front.iter().any(|m| m.error_validation.is_some());
    let outputs = &d.front[0].outputs;
    let shown = if outputs.len() <= OUTPUTS { outputs.len() } else { 0 };
    let mut headings: Vec<String> = ["best models by size", "parameters", "error, fitted"].map(String::from).to_vec();
    let crossed = d.front.iter().any(|m| m.error_cross_validated.is_some());
    if validated {
        headings.push("validation".into());
    } else if crossed {
        headings.push("predicted".into());
    }
    for output in &outputs[..shown] {
        headings.push(format!("RMS {}", output.output));
        if validated {
            headings.push("validation".into());
        }
    }
    headings.push(String::new());
    let mut table = plain(&headings.iter().map(String::as_str).collect::<Vec<_>>());
    let percent = |v: f64| if v.is_finite() { format!("{:.1} %", 100.0 * v) } else { "-".into() };
    let number = |v: Option<f64>| v.map_or("-".to_string(), |v| digits(v, 3));
    for model in &d.front {
        let mut row = vec![named(model), format!("+{}", model.parameters), percent(model.error_training)];
        if validated {
            row.push(percent(model.error_validation.unwrap_or(f64::NAN)));
        } else if crossed {
            row.push(percent(model.error_cross_validated.unwrap_or(f64::NAN)));
        }
        for output in &model.outputs[..shown] {
            row.push(number(output.rms_training));
            if validated {
                row.push(number(output.rms_validation));
            }
        }
        row.push(if model.recommended { "recommended".into() } else { model.objection.clone().unwrap_or_default() });
        table.add_row(row);
    }
    (1..headings.len() - 1).for_each(|column| aligned_right(&mut table, column));
    format!("\n{}", trimmed(&table))
}

/// The effects of a model of the front.
fn named(model: &FrontModel) -> String {
    if model.effects.is_empty() {
        return "as given".into();
    }
    model.effects.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")
}

/// How outputs are matched before and after.
fn matches(d: &Diagnosis) -> String {
    let mut table =
        plain(&["", "run", "output", "RMS before", "after", "noise", "TIC before", "after", "R^2 before", "after"]);
    let number = |v: Option<f64>| v.map_or("-".to_string(), |v| digits(v, 3));
    for o in &d.outputs {
        let role = if o.validation { "validation" } else { "training" };
        table.add_row([
            role.to_string(),
            o.run.clone(),
            o.output.clone(),
            number(o.rms_before),
            number(o.rms_after),
            digits(o.noise_level, 3),
            fixed(o.tic_before, 4),
            fixed(o.tic_after, 4),
            fixed(o.r2_before, 4),
            fixed(o.r2_after, 4),
        ]);
    }
    (3..10).for_each(|column| aligned_right(&mut table, column));
    let mut text = format!("\n{}", trimmed(&table));
    for g in &d.gains {
        let role = if g.validation { "validation" } else { "training" };
        let _ = writeln!(text, "{} ({role}): log-likelihood gains {:.1} +- {:.1}", g.run, g.gain, g.deviation);
    }
    text
}

/// Parameters that the missing effects had moved.
fn moved(d: &Diagnosis) -> String {
    let shown: Vec<_> = d.biased.iter().filter(|b| b.moved.is_some_and(|m| m.abs() >= MOVED)).collect();
    if shown.is_empty() {
        return String::new();
    }
    let mut table = plain(&["what the missing effect had moved", "before", "", "after", "", "moved by"]);
    for b in shown {
        let error = |e: Option<f64>| e.map_or(String::new(), |e| format!("+- {}", digits(e, 2)));
        let name = b.run.as_ref().map_or(b.name.clone(), |run| format!("{} ({run})", b.name));
        table.add_row([
            name,
            digits(b.before, 5),
            error(b.before_error),
            digits(b.after, 5),
            error(b.after_error),
            format!("{:.1} standard errors", b.moved.unwrap_or_default()),
        ]);
    }
    (1..6).for_each(|column| aligned_right(&mut table, column));
    format!("\n{}", trimmed(&table))
}

/// Inputs that move with the states, and what that hides.
fn feedback(d: &Diagnosis) -> String {
    let Some(feedback) = &d.feedback else { return String::new() };
    let mut text = String::from("\n");
    for input in &feedback.inputs {
        let own = 100.0 * (1.0 - input.explained);
        let _ = match input.feedback {
            true => writeln!(
                text,
                "{} follows the states, as under a controller or a pilot: {own:.0} % of it is its own",
                input.input
            ),
            false => writeln!(text, "{} moves with the states: {own:.0} % of it is its own", input.input),
        };
    }
    if feedback.hidden.is_empty() {
        let _ = writeln!(text, "nothing that was tried is hidden by that");
        return text;
    }
    let hidden: Vec<String> = feedback.hidden.iter().take(SHOWN).map(ToString::to_string).collect();
    let more = feedback.hidden.len() - hidden.len();
    let more = if more > 0 { format!(" and {more} more (--json)") } else { String::new() };
    let _ = writeln!(
        text,
        "what these records hide, as the fitted parameters make up for nearly all of it: {}{more}; inputs that do not \
         move with the states would show it",
        hidden.join(", ")
    );
    text
}

fn ruled_out(d: &Diagnosis) -> String {
    if d.rejected.is_empty() {
        return String::new();
    }
    let mut table = plain(&["not accepted", "step", "gain", "validation", "because"]);
    for r in &d.rejected {
        let held = r.gain_validation.map_or("-".to_string(), |g| format!("{g:.1}"));
        table.add_row([
            r.place.to_string(),
            r.step.to_string(),
            format!("{:.1}", r.gain_training),
            held,
            r.reason.clone(),
        ]);
    }
    (1..4).for_each(|column| aligned_right(&mut table, column));
    format!("\n{}", trimmed(&table))
}

/// How small effects could have been.
fn detectable(d: &Diagnosis) -> String {
    let mut table = plain(&["would have been seen", "from", ""]);
    for s in d.detectable.iter().filter(|s| s.smallest.is_some()).take(SHOWN) {
        let value = s.smallest.map_or(String::new(), |v| format!("{} = {}", s.parameter, digits(v, 3)));
        table.add_row([s.place.to_string(), value, s.unit.clone().unwrap_or_default()]);
    }
    let hidden: Vec<String> =
        d.detectable.iter().filter(|s| s.smallest.is_none()).map(|s| s.place.to_string()).collect();
    let mut text = format!("\n{}", trimmed(&table));
    let more = d.detectable.len().saturating_sub(hidden.len() + SHOWN);
    if more > 0 {
        let _ = writeln!(text, "and {more} more (--json)");
    }
    if !hidden.is_empty() {
        let _ =
            writeln!(text, "could not be seen, because the fitted parameters make up for it: {}", hidden.join(", "));
    }
    text
}
