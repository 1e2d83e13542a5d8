//! How a fit came about, and what speaks for and against its parameters, as text.

use super::table::{aligned_right, plain, trimmed};
use fdm_estimate::{Fit, LengthFit, ParameterEstimate, Reweighting, Weight, by_confidence};
use fdm_results::documents::digits;

/// Changes in standard errors beyond which a parameter hangs on the weights.
const MUCH: f64 = 2.0;
/// Doubt beyond which a parameter is of little worth.
const DOUBTFUL: f64 = 0.2;
/// Doubt beyond which the records hardly tell a parameter from zero.
const MINOR: f64 = 0.5;

/// One line on every strategy that led to the estimates; empty when the plain correction did.
pub fn way(fit: &Fit) -> String {
    let mut text = String::new();
    if !fit.substituted.is_empty() {
        let states = fit.substituted.join(", ");
        text.push_str(&format!("started from a fit with the measured {states} in the equations\n"));
    }
    if let Some(fallback) = &fit.fallback {
        text.push_str(&format!("{fallback}\n"));
    }
    if let Some(cut) = &fit.shooting {
        let end = match cut.polished {
            true => "the whole model went on from there without cuts".to_string(),
            false => format!("largest gap left {:.0e} of the state's size", cut.largest_gap),
        };
        text.push_str(&format!("multiple shooting in {} segments; {end}\n", cut.segments));
    }
    text
}

/// Estimates by length of the record with the parameters in order of confidence, and how they move with the weights of the
/// outputs; empty when nothing was asked.
pub fn confidence(fit: &Fit) -> String {
    let mut text = String::new();
    if fit.by_length.len() > 1 {
        text.push_str(&format!("\n{}", lengths(&fit.by_length)));
    }
    if let Some(reweighting) = &fit.reweighting {
        text.push_str(&format!("\n{}", weights(reweighting)));
    }
    if text.is_empty() { text } else { format!("{text}\n") }
}

fn name(name: &str, run: Option<&String>) -> String {
    run.map_or_else(|| name.to_string(), |run| format!("{name} ({run})"))
}

/// Parameters in order of confidence; their values by length; how far they wander.
fn lengths(lengths: &[LengthFit]) -> String {
    let shown = |l: &LengthFit| digits(l.length, 3);
    let mut header: Vec<String> = vec!["by confidence".into()];
    header.extend(lengths.iter().map(|l| format!("to {}", shown(l))));
    header.extend(["standard error", "wander", "doubt"].map(String::from));
    let mut table = plain(&header.iter().map(String::as_str).collect::<Vec<_>>());
    let mut minor = Vec::new();
    for s in by_confidence(lengths) {
        if s.doubt > MINOR {
            minor.push(name(&s.name, s.run.as_ref()));
        }
        let same = |p: &&ParameterEstimate| p.name == s.name && p.run == s.run;
        let mut row = vec![name(&s.name, s.run.as_ref())];
        row.extend(lengths.iter().map(|l| match l.parameters.iter().find(same) {
            Some(p) if p.standard_error.is_some() => digits(p.value, 4),
            _ => "-".into(),
        }));
        let mark = if s.doubt > DOUBTFUL { "!" } else { "" };
        let doubt = if s.doubt.is_finite() { format!("{}%{mark}", digits(100.0 * s.doubt, 2)) } else { "all!".into() };
        row.extend([s.standard_error.map_or("-".into(), |e| digits(e, 3)), digits(s.wander, 3), doubt]);
        table.add_row(row);
    }
    (1..lengths.len() + 4).for_each(|column| aligned_right(&mut table, column));
    let bad = lengths.iter().filter(|l| !l.termination.is_good()).map(shown).collect::<Vec<_>>();
    let bad = if bad.is_empty() { String::new() } else { format!("not converged: up to {}\n", bad.join(", ")) };
    let minor = match minor.is_empty() {
        true => String::new(),
        false => format!("of minor importance in these records, known to their size only: {}\n", minor.join(", ")),
    };
    format!("{}{minor}{bad}", trimmed(&table))
}

/// Changes of the parameters in standard errors, one column for each variation.
fn weights(reweighting: &Reweighting) -> String {
    let mut header: Vec<String> = vec!["by weights".into()];
    header.extend(reweighting.variations.iter().map(|v| match v.weight {
        Weight::NoiseHalved => format!("{} / 2", v.output),
        Weight::NoiseDoubled => format!("{} * 2", v.output),
        Weight::LeftOut => format!("without {}", v.output),
    }));
    header.push("largest".into());
    let mut table = plain(&header.iter().map(String::as_str).collect::<Vec<_>>());
    for (k, p) in reweighting.parameters.iter().enumerate() {
        let mut row = vec![name(&p.name, p.run.as_ref())];
        let change = |c: Option<f64>| c.map_or("lost".into(), |c| format!("{c:+.2}"));
        row.extend(reweighting.variations.iter().map(|v| change(v.changes[k])));
        let largest = reweighting.largest(k);
        let mark = if largest > MUCH { "!" } else { "" };
        row.push(if largest.is_finite() { format!("{largest:.2}{mark}") } else { "lost!".into() });
        table.add_row(row);
    }
    (1..reweighting.variations.len() + 2).for_each(|column| aligned_right(&mut table, column));
    format!(
        "{}changes in standard errors when the noise of an output counts for half or twice, or the output is left out\n",
        trimmed(&table)
    )
}
