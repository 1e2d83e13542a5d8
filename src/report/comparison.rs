//! Several results beside each other: costs and criteria, parameters, outputs, predictions.

use super::table::{aligned_right, plain, trimmed};
use comfy_table::Table;
use fdm_estimate::Status;
use fdm_estimate::residuals::OutputFit;
use fdm_results::comparison::{Averaged, Candidate, Comparison, Edge, Nesting, Prediction, WeightedBy};
use fdm_results::documents::{KeptParameter, OutputDocument, digits, digits_by_error, digits_of_end};

/// Columns of results that fit beside the names of rows.
const ABREAST: usize = 4;
/// P-values below this are no chance.
const SIGNIFICANT: f64 = 0.01;
/// A weight that decides where no test can be made.
const DECIDED: f64 = 0.95;

/// Verdict, tables and sentences.
pub fn comparison_table(comparison: &Comparison) -> String {
    let mut text = format!("{}\n\n{}", verdict(comparison).sentence, criteria(comparison));
    comparison.nestings.iter().for_each(|n| text.push_str(&format!("{}\n", nesting(n))));
    let names: Vec<&str> = comparison.candidates.iter().map(|c| c.name.as_str()).collect();
    for begin in (0..names.len()).step_by(ABREAST) {
        let end = (begin + ABREAST).min(names.len());
        text.push_str(&format!("\n{}", parameters(&comparison.candidates[begin..end])));
        let fitted: Vec<Vec<Row>> =
            comparison.candidates[begin..end].iter().map(|c| rows(c.outputs.as_ref())).collect();
        text.push_str(&format!("\n{}", outputs("fitted", &names[begin..end], &fitted)));
        if !comparison.predictions.is_empty() {
            let held: Vec<Vec<Row>> = comparison.predictions[begin..end].iter().map(predicted).collect();
            text.push_str(&format!("\n{}", outputs("validation", &names[begin..end], &held)));
        }
    }
    for prediction in comparison.predictions.iter().filter(|p| !p.converged) {
        let name = &prediction.name;
        text.push_str(&format!("{name}: initial states and biases of the held-out runs were not found\n"));
    }
    comparison.edges.iter().for_each(|e| text.push_str(&format!("{}\n", edge(e))));
    if let Some(averaged) = &comparison.averaged {
        text.push_str(&format!("\n{}", average(&comparison.candidates, averaged)));
    }
    text.push_str(&assumed(comparison));
    text
}

/// Which result is to be believed.
pub(crate) struct Verdict {
    /// Whether the tests bear it out.
    pub(crate) settled: bool,
    pub(crate) sentence: String,
}

/// The result of the greatest weight, and whether that is more than chance: weights lean to one side where residuals are coloured, the tests do not.
pub(crate) fn verdict(comparison: &Comparison) -> Verdict {
    let names: Vec<&str> = comparison.candidates.iter().map(|c| c.name.as_str()).collect();
    judged(&names, comparison.averaged.as_ref(), &comparison.edges, &comparison.nestings)
}

fn judged(names: &[&str], averaged: Option<&Averaged>, edges: &[Edge], nestings: &[Nesting]) -> Verdict {
    let found = |settled: bool, sentence: String| Verdict { settled, sentence };
    let leading = averaged.and_then(|averaged| {
        let (k, weight) = averaged.weights.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1))?;
        Some((*names.get(k)?, *weight, weighted_by(averaged)))
    });
    let Some((first, weight, by)) = leading else {
        return found(false, "The costs of these results cannot be compared.".into());
    };
    let has = format!("{first} has {:.0} % of the weight, {by}", 100.0 * weight);
    let sure = |e: &&Edge| e.advantage.as_ref().is_some_and(|a| a.p_value < SIGNIFICANT);
    let better: Vec<&Edge> = edges.iter().filter(sure).filter(|e| e.other == first).collect();
    if let Some(e) = better.first() {
        let sentence =
            format!("No result predicts everything best: {} predicts {} better than {first}; {has}.", e.best, e.output);
        return found(false, sentence);
    }
    let beaten = |other: &str| edges.iter().filter(sure).any(|e| e.best == first && e.other == other);
    let open: Vec<&str> = names.iter().copied().filter(|other| *other != first && !beaten(other)).collect();
    if !edges.is_empty() {
        return match &open[..] {
            [] => found(
                true,
                format!(
                    "{first} predicts better than the others, beyond chance; it has {:.0} % of the weight.",
                    100.0 * weight
                ),
            ),
            _ => found(false, format!("That {first} predicts better than {} could be chance; {has}.", open.join(", "))),
        };
    }
    let p = |n: &Nesting| if n.p_value < 1e-3 { "p < 0.001".to_string() } else { format!("p = {:.3}", n.p_value) };
    let tested = || nestings.iter().filter(|n| n.likelihood_ratio >= 0.0);
    if let Some(n) = tested().find(|n| n.richer == first && n.p_value >= SIGNIFICANT) {
        let sentence = format!("What {first} gains beside {} could be chance ({}); {has}.", n.poorer, p(n));
        return found(false, sentence);
    }
    if let Some(n) = tested().find(|n| n.poorer == first && n.p_value < SIGNIFICANT) {
        return found(
            false,
            format!("What {} gains beside {first} is more than chance ({}), and yet {has}.", n.richer, p(n)),
        );
    }
    match tested().find(|n| n.richer == first) {
        Some(n) => {
            found(true, format!("What {first} gains beside {} is more than chance ({}); {has}.", n.poorer, p(n)))
        }
        None => found(weight >= DECIDED, format!("{has}.")),
    }
}

/// What was assumed about the records: once where all results assume the same, by result otherwise.
fn assumed(comparison: &Comparison) -> String {
    let all = &comparison.candidates;
    let same = all.windows(2).all(|w| w[0].assumed == w[1].assumed);
    let told: Vec<(&str, &[String])> = match (same, all.first()) {
        (true, Some(first)) => vec![("all results", &first.assumed)],
        _ => all.iter().map(|c| (c.name.as_str(), &c.assumed[..])).collect(),
    };
    let lines =
        told.iter().flat_map(|(name, assumed)| assumed.iter().map(move |a| format!("assumed by {name}: {a}\n")));
    lines.collect()
}

/// Costs, and what they say.
fn criteria(comparison: &Comparison) -> String {
    let coloured = comparison.inflation.is_some();
    let mut header = vec!["result", "model", "parameters", "cost", "AIC", "BIC"];
    header.extend(coloured.then_some(["coloured AIC", "coloured BIC"]).into_iter().flatten());
    let mut table = plain(&header);
    for c in &comparison.candidates {
        let cost = c.cost.map_or("-".into(), |v| digits(v, 8));
        let mut row = vec![c.name.clone(), c.model.clone(), c.unknowns.to_string(), cost];
        let own = |of: fn(&fdm_results::comparison::Criteria) -> Option<f64>| {
            c.criteria.as_ref().and_then(of).map_or("-".into(), |v| format!("{v:+.1}"))
        };
        row.extend([own(|c| Some(c.aic)), own(|c| Some(c.bic))]);
        row.extend(coloured.then(|| [own(|c| c.coloured_aic), own(|c| c.coloured_bic)]).into_iter().flatten());
        table.add_row(row);
    }
    (2..header.len()).for_each(|k| aligned_right(&mut table, k));
    let mut text = trimmed(&table);
    text.push_str("criteria as differences to the least\n");
    if let Some(inflation) = comparison.inflation.filter(|c| *c > 1.0) {
        text.push_str(&format!(
            "coloured residuals: {} values are worth as many as {} white ones; believe the coloured criteria\n",
            comparison.candidates.first().map_or(0, |c| c.samples),
            comparison.candidates.first().map_or(0, |c| (c.samples as f64 / inflation).round() as usize),
        ));
    }
    for c in &comparison.candidates {
        if let Some(reason) = &c.incomparable {
            text.push_str(&format!("{}: no criteria: {reason}\n", c.name));
        }
    }
    text
}

/// What the weights of models rest on.
pub(crate) fn weighted_by(averaged: &Averaged) -> &'static str {
    match averaged.by {
        WeightedBy::Validation => "weighted by their predictions of the validation data",
        WeightedBy::Criterion => "weighted by AIC, since there are no validation data",
    }
}

/// Weights, and averages over the models.
fn average(candidates: &[Candidate], averaged: &Averaged) -> String {
    let weights = candidates.iter().zip(&averaged.weights).map(|(c, w)| format!("{} {:.1} %", c.name, 100.0 * w));
    let mut text =
        format!("averaged over the models, {}: {}\n", weighted_by(averaged), weights.collect::<Vec<_>>().join(", "));
    let mut table = plain(&["averaged", "run", "value", "error", "95 % interval", "in models of", "unit"]);
    for p in &averaged.parameters {
        let settled = digits_by_error(p.value, p.error, 3).unwrap_or(4);
        table.add_row([
            p.name.clone(),
            p.run.clone().unwrap_or_default(),
            digits(p.value, settled),
            digits(p.error, 3),
            format!("{} to {}", digits_of_end(p.interval[0], p.error), digits_of_end(p.interval[1], p.error)),
            format!("{:.0} %", 100.0 * p.weight),
            p.unit.clone().unwrap_or_default(),
        ]);
    }
    [2, 3, 5].into_iter().for_each(|k| aligned_right(&mut table, k));
    text.push_str(&trimmed(&table));
    if !averaged.outputs.is_empty() {
        let mut table = plain(&["averaged prediction", "output", "RMS", "95 % band ±", "within"]);
        for o in &averaged.outputs {
            let number = |v: Option<f64>| v.map_or("-".into(), |v| digits(v, 4));
            let within = o.within.map_or("-".into(), |w| format!("{:.1} %", 100.0 * w));
            table.add_row([o.run.clone(), o.name.clone(), number(o.rms), number(o.band), within]);
        }
        (2..5).for_each(|k| aligned_right(&mut table, k));
        text.push_str(&format!("\n{}", trimmed(&table)));
    }
    text
}

pub(crate) fn nesting(n: &Nesting) -> String {
    let (further, (_, left)) = (n.further, n.degrees);
    let plural = if further == 1 { "parameter" } else { "parameters" };
    let pair = format!("{} beside {}: {further} further {plural}", n.richer, n.poorer);
    if n.likelihood_ratio < 0.0 {
        return format!(
            "{pair}, and yet a higher cost: if one model holds the other, the richer fit missed the minimum"
        );
    }
    let gain = if n.p_value < SIGNIFICANT { "a gain beyond chance" } else { "no gain beyond chance" };
    let p = if n.p_value < 1e-3 { "p < 0.001".into() } else { format!("p = {:.3}", n.p_value) };
    format!("{pair}, F({further}, {left:.0}) = {}, {p}: {gain}, if one model holds the other", digits(n.f, 3))
}

fn beside(first: &[&str], names: impl Iterator<Item = String>) -> Table {
    let mut header: Vec<String> = first.iter().map(ToString::to_string).collect();
    header.extend(names);
    let mut table = plain(&header.iter().map(String::as_str).collect::<Vec<_>>());
    (first.len()..header.len()).for_each(|k| aligned_right(&mut table, k));
    table
}

/// Every parameter of any result, with the errors to be trusted.
fn parameters(candidates: &[Candidate]) -> String {
    let mut known: Vec<(&str, Option<&str>)> = Vec::new();
    for p in candidates.iter().flat_map(|c| &c.parameters) {
        let name = (p.name.as_str(), p.run.as_deref());
        if !known.contains(&name) {
            known.push(name);
        }
    }
    let runs = known.iter().any(|(_, run)| run.is_some());
    let first: &[&str] = if runs { &["parameter", "run", "unit"] } else { &["parameter", "unit"] };
    let mut table = beside(first, candidates.iter().map(|c| c.name.clone()));
    for (name, run) in known {
        let own = |c: &Candidate| c.parameters.iter().find(|p| p.name == name && p.run.as_deref() == run).cloned();
        let unit = candidates.iter().find_map(own).and_then(|p| p.unit).unwrap_or_default();
        let mut row = vec![name.to_string()];
        row.extend(runs.then(|| run.unwrap_or_default().to_string()));
        row.push(unit);
        row.extend(candidates.iter().map(|c| own(c).map_or("-".into(), |p| value(&p))));
        table.add_row(row);
    }
    trimmed(&table)
}

pub(crate) fn value(p: &KeptParameter) -> String {
    match (p.error(), p.status) {
        (Some(error), _) => {
            let settled = digits_by_error(p.value, error, 3).unwrap_or(4);
            format!("{} ± {}", digits(p.value, settled), digits(error, 3))
        }
        (None, Status::Estimated | Status::Derived) => digits(p.value, 5),
        (None, status) => format!("{} ({})", digits(p.value, 5), status),
    }
}

/// A run and an output, its root mean square and Theil's coefficient.
type Row = (String, String, Option<f64>, Option<f64>);

fn rows(outputs: Option<&Vec<OutputDocument>>) -> Vec<Row> {
    outputs.into_iter().flatten().map(|o| (o.run.clone(), o.name.clone(), o.rms, o.tic)).collect()
}

fn predicted(prediction: &Prediction) -> Vec<Row> {
    let row = |o: &OutputFit| (o.run.clone(), o.name.clone(), o.rms, o.tic);
    prediction.outputs.iter().map(row).collect()
}

fn outputs(what: &str, names: &[&str], all: &[Vec<Row>]) -> String {
    let mut known: Vec<(&str, &str)> = Vec::new();
    for (run, name, ..) in all.iter().flatten() {
        if !known.contains(&(run, name)) {
            known.push((run, name));
        }
    }
    let mut table = beside(&[what, "output"], names.iter().map(|n| format!("RMS (TIC) {n}")));
    for (run, name) in known {
        let cell = |rows: &Vec<Row>| {
            let row = rows.iter().find(|(r, n, ..)| r == run && n == name)?;
            Some(format!("{} ({})", digits(row.2?, 4), row.3.map_or("-".into(), |t| format!("{t:.3}"))))
        };
        let mut row = vec![run.to_string(), name.to_string()];
        row.extend(all.iter().map(|rows| cell(rows).unwrap_or_else(|| "-".into())));
        table.add_row(row);
    }
    trimmed(&table)
}

pub(crate) fn edge(e: &Edge) -> String {
    let Edge { output, best, other, advantage } = e;
    let Some(a) = advantage else {
        return format!(
            "{output}: whether {best} predicts better than {other} cannot be told: too little is independent"
        );
    };
    let size =
        format!("leaves {:.1} ± {:.1} % less of the mean square than {other}", 100.0 * a.reduction, 100.0 * a.error);
    let p = if a.p_value < 1e-3 { "p < 0.001".into() } else { format!("p = {:.3}", a.p_value) };
    let verdict = if a.p_value < SIGNIFICANT { "predicts better" } else { "may predict as well: this could be chance" };
    let who = if a.p_value < SIGNIFICANT { best.clone() } else { other.clone() };
    format!("{output}: {best} {size} ({p}); {who} {verdict}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use fdm_estimate::residuals::Advantage;

    #[test]
    fn a_weight_is_believed_where_a_test_bears_it_out() {
        let advantage = Advantage { reduction: 0.25, error: 0.13, independent: 40.0, p_value: 0.052 };
        let edge = |best: &str, other: &str, p_value: f64| Edge {
            output: "y".into(),
            best: best.into(),
            other: other.into(),
            advantage: Some(Advantage { p_value, ..advantage }),
        };
        let nesting = |p_value: f64| Nesting {
            poorer: "a".into(),
            richer: "b".into(),
            further: 1,
            likelihood_ratio: 3.0,
            f: 3.0,
            degrees: (1.0, 90.0),
            p_value,
        };
        let said = |weights: [f64; 2], edges: Vec<Edge>, nestings: Vec<Nesting>| {
            let by = if edges.is_empty() { WeightedBy::Criterion } else { WeightedBy::Validation };
            let averaged = Averaged { by, weights: weights.to_vec(), parameters: Vec::new(), outputs: Vec::new() };
            let found = judged(&["a", "b"], Some(&averaged), &edges, &nestings);
            (found.settled, found.sentence)
        };
        let (settled, sentence) = said([0.999, 0.001], vec![edge("b", "a", 1e-4)], Vec::new());
        assert!(
            !settled && sentence.starts_with("No result predicts everything best: b predicts y better"),
            "{sentence}"
        );
        let (settled, sentence) = said([0.001, 0.999], Vec::new(), vec![nesting(0.052)]);
        assert!(!settled && sentence.starts_with("What b gains beside a could be chance (p = 0.052)"), "{sentence}");
        assert!(said([0.001, 0.999], Vec::new(), vec![nesting(1e-5)]).0);
        let (settled, sentence) = said([1.0, 0.0], vec![edge("a", "b", 0.052)], Vec::new());
        assert!(
            !settled && sentence.starts_with("That a predicts better than b could be chance; a has 100 %"),
            "{sentence}"
        );
        assert!(said([1.0, 0.0], vec![edge("a", "b", 1e-4)], Vec::new()).0);
        assert!(said([0.001, 0.999], Vec::new(), Vec::new()).0 && !said([0.4, 0.6], Vec::new(), Vec::new()).0);
        assert!(!said([0.999, 0.001], Vec::new(), vec![nesting(1e-5)]).0);
    }

    #[test]
    fn chance_is_called_chance() {
        let advantage = Advantage { reduction: 0.25, error: 0.2, independent: 40.0, p_value: 0.2 };
        let of = |advantage| Edge { output: "y".into(), best: "a".into(), other: "b".into(), advantage };
        let said = edge(&of(Some(advantage)));
        assert!(said.starts_with("y: a leaves 25.0 ± 20.0 % less") && said.ends_with("could be chance"), "{said}");
        let said = edge(&of(Some(Advantage { p_value: 1e-9, ..advantage })));
        assert!(said.ends_with("(p < 0.001); a predicts better"), "{said}");
        assert!(edge(&of(None)).contains("cannot be told"));
    }

    #[test]
    fn a_richer_fit_with_a_higher_cost_is_told() {
        let n = Nesting {
            poorer: "a".into(),
            richer: "b".into(),
            further: 1,
            likelihood_ratio: -3.0,
            f: 0.0,
            degrees: (1.0, 90.0),
            p_value: 1.0,
        };
        assert!(nesting(&n).contains("missed the minimum"));
        assert!(
            nesting(&Nesting { likelihood_ratio: 3.0, f: 3.0, p_value: 0.087, ..n }).contains("p = 0.087: no gain")
        );
    }
}
