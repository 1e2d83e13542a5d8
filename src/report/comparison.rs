//! Several results beside each other: costs and criteria, parameters and their averages, outputs, predictions.

use super::section::{Part, Report, Rows, Section, Trust, Verdict};
use crate::{html, text};
use fdm_estimate::Status;
use fdm_results::comparison::{Averaged, Candidate, Comparison, Criteria, Edge, Nesting, WeightedBy};
use fdm_results::documents::{KeptParameter, digits, digits_by_error, digits_of_end, p_value};

/// P-values below this are no chance.
const SIGNIFICANT: f64 = 0.01;
/// A weight that decides where no test can be made.
const DECIDED: f64 = 0.95;

/// Verdict, tables and sentences.
pub fn comparison_table(comparison: &Comparison) -> String {
    text::below(format!("{}\n", verdict(comparison).sentence), &sections(comparison))
}

/// A page of a comparison.
pub fn comparison_page(comparison: &Comparison) -> String {
    let incomparable = comparison.candidates.iter().filter_map(incomparable);
    html::page(&Report {
        kind: "comparison".into(),
        name: comparison.candidates.iter().map(|c| c.name.as_str()).collect::<Vec<_>>().join(", "),
        doc: None,
        verdict: verdict(comparison)
            .with_points(comparison.edges.iter().map(edge), "predictions")
            .with_points(comparison.nestings.iter().map(nesting), "criteria")
            .with_points(incomparable, "criteria"),
        sections: sections(comparison),
    })
}

fn sections(comparison: &Comparison) -> Vec<Section> {
    let all = [
        Some(criteria(comparison)),
        Some(Section::new("parameters", "Parameters").with(parameters(&comparison.candidates))),
        Some(Section::new("outputs", "Fitted outputs").with(fitted(&comparison.candidates))),
        predictions(comparison),
        comparison.averaged.as_ref().map(|averaged| average(&comparison.candidates, averaged)),
        Some(assumed(comparison)).filter(|s| !s.parts.is_empty()),
    ];
    all.into_iter().flatten().collect()
}

/// The result of the greatest weight, and whether that is more than chance: weights lean to one side where residuals are coloured, the tests do not.
fn verdict(comparison: &Comparison) -> Verdict {
    let names: Vec<&str> = comparison.candidates.iter().map(|c| c.name.as_str()).collect();
    judged(&names, comparison.averaged.as_ref(), &comparison.edges, &comparison.nestings)
}

fn judged(names: &[&str], averaged: Option<&Averaged>, edges: &[Edge], nestings: &[Nesting]) -> Verdict {
    let found =
        |settled: bool, sentence: String| Verdict::new(if settled { Trust::Good } else { Trust::Reserved }, sentence);
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
    let tested = || nestings.iter().filter(|n| n.likelihood_ratio >= 0.0);
    if let Some(n) = tested().find(|n| n.richer == first && n.p_value >= SIGNIFICANT) {
        let sentence =
            format!("What {first} gains beside {} could be chance ({}); {has}.", n.poorer, p_value(n.p_value));
        return found(false, sentence);
    }
    if let Some(n) = tested().find(|n| n.poorer == first && n.p_value < SIGNIFICANT) {
        return found(
            false,
            format!(
                "What {} gains beside {first} is more than chance ({}), and yet {has}.",
                n.richer,
                p_value(n.p_value)
            ),
        );
    }
    match tested().find(|n| n.richer == first) {
        Some(n) => found(
            true,
            format!("What {first} gains beside {} is more than chance ({}); {has}.", n.poorer, p_value(n.p_value)),
        ),
        None => found(weight >= DECIDED, format!("{has}.")),
    }
}

/// What was assumed about the records: once where all results assume the same, by result otherwise.
fn assumed(comparison: &Comparison) -> Section {
    let all = &comparison.candidates;
    let same = all.windows(2).all(|w| w[0].assumed == w[1].assumed);
    let by_result: Vec<(&str, &[String])> = match (same, all.first()) {
        (true, Some(first)) => vec![("all results", &first.assumed)],
        _ => all.iter().map(|c| (c.name.as_str(), &c.assumed[..])).collect(),
    };
    let line = |(name, assumed): (&str, &[String])| {
        assumed.iter().map(|a| Part::Line(format!("assumed by {name}: {a}"))).collect::<Vec<_>>()
    };
    Section::new("records", "Assumed about the records").with_all(by_result.into_iter().flat_map(line))
}

/// Costs, and what they say.
fn criteria(comparison: &Comparison) -> Section {
    let mut table = Rows::over(&comparison.candidates);
    table.name("result", |c| c.name.clone());
    table.words("model", |c| c.model.clone());
    table.number("parameters", |c| c.unknowns);
    table.number("cost", |c| c.cost.map_or("-".into(), |v| digits(v, 8)));
    let mut difference = |title: &str, of: fn(&Criteria) -> Option<f64>| {
        table.number(title, |c| c.criteria.as_ref().and_then(of).map_or("-".into(), |v| format!("{v:+.1}")));
    };
    difference("AIC", |c| Some(c.aic));
    difference("BIC", |c| Some(c.bic));
    if comparison.inflation.is_some() {
        difference("coloured AIC", |c| c.coloured_aic);
        difference("coloured BIC", |c| c.coloured_bic);
    }
    let samples = comparison.candidates.first().map_or(0, |c| c.samples);
    let coloured = comparison.inflation.filter(|c| *c > 1.0).map(|inflation| {
        let white = (samples as f64 / inflation).round() as usize;
        format!(
            "coloured residuals: {samples} values are worth as many as {white} white ones; believe the coloured criteria"
        )
    });
    Section::new("criteria", "Criteria")
        .with(table)
        .note("criteria as differences to the least")
        .notes(coloured)
        .lines(comparison.candidates.iter().filter_map(incomparable))
        .with_all(comparison.nestings.iter().map(|n| Part::Line(nesting(n))))
}

/// Why a result has no criteria.
fn incomparable(candidate: &Candidate) -> Option<String> {
    candidate.incomparable.as_ref().map(|reason| format!("{}: no criteria: {reason}", candidate.name))
}

/// What the weights of models rest on.
fn weighted_by(averaged: &Averaged) -> &'static str {
    match averaged.by {
        WeightedBy::Validation => "weighted by their predictions of the validation data",
        WeightedBy::Criterion => "weighted by AIC, since there are no validation data",
    }
}

/// Weights, and averages over the models.
fn average(candidates: &[Candidate], averaged: &Averaged) -> Section {
    let weights = candidates.iter().zip(&averaged.weights).map(|(c, w)| format!("{} {:.1} %", c.name, 100.0 * w));
    let weights = weights.collect::<Vec<_>>().join(", ");
    let mut table = Rows::over(&averaged.parameters);
    table.name("averaged", |p| p.name.clone());
    table.words("run", |p| p.run.clone().unwrap_or_default());
    table.number("value", |p| digits(p.value, digits_by_error(p.value, p.error, 3).unwrap_or(4)));
    table.number("error", |p| digits(p.error, 3));
    table.span("95 % interval", |p| {
        let [low, high] = p.interval.map(|end| digits_of_end(end, p.error));
        format!("{low} to {high}")
    });
    table.number("in models of", |p| format!("{:.0} %", 100.0 * p.weight));
    table.unit(|p| p.unit.clone());
    let table = table.below(format!("averaged over the models, {}: {weights}", weighted_by(averaged)));
    let number = |v: Option<f64>| v.map_or("-".into(), |v| digits(v, 4));
    let mut outputs = Rows::over(&averaged.outputs);
    outputs.words("averaged prediction", |o| o.run.clone());
    outputs.name("output", |o| o.name.clone());
    outputs.number("RMS", |o| number(o.rms));
    outputs.number("95 % band ±", |o| number(o.band));
    outputs.number("within", |o| o.within.map_or("-".into(), |w| format!("{:.1} %", 100.0 * w)));
    Section::new("average", "Averaged over the models")
        .with(table)
        .with_all((!averaged.outputs.is_empty()).then_some(outputs))
        .explained("Errors hold the scatter between models: these intervals know that the structure was chosen.")
}

fn nesting(n: &Nesting) -> String {
    let (further, (_, left)) = (n.further, n.degrees);
    let plural = if further == 1 { "parameter" } else { "parameters" };
    let pair = format!("{} beside {}: {further} further {plural}", n.richer, n.poorer);
    if n.likelihood_ratio < 0.0 {
        return format!(
            "{pair}, and yet a higher cost: if one model holds the other, the richer fit missed the minimum"
        );
    }
    let gain = if n.p_value < SIGNIFICANT { "a gain beyond chance" } else { "no gain beyond chance" };
    let p = p_value(n.p_value);
    format!("{pair}, F({further}, {left:.0}) = {}, {p}: {gain}, if one model holds the other", digits(n.f, 3))
}

/// What stands in several lists, each once, in the order of their first appearance.
fn distinct<T: PartialEq>(all: impl Iterator<Item = T>) -> Vec<T> {
    let mut known = Vec::new();
    for one in all {
        if !known.contains(&one) {
            known.push(one);
        }
    }
    known
}

/// Every parameter of any result, with the errors to be trusted.
fn parameters(candidates: &[Candidate]) -> Rows<(&str, Option<&str>)> {
    let all = candidates.iter().flat_map(|c| &c.parameters).map(|p| (p.name.as_str(), p.run.as_deref()));
    let mut table = Rows::over(distinct(all));
    let find = |c: &Candidate, (name, run): &(&str, Option<&str>)| {
        c.parameters.iter().find(|p| p.name == *name && p.run.as_deref() == *run).cloned()
    };
    table.name("parameter", |(name, _)| *name);
    table.runs(|(_, run)| *run);
    table.unit(|row| candidates.iter().find_map(|c| find(c, row)).and_then(|p| p.unit));
    for c in candidates {
        table.number(&c.name, |row| find(c, row).map_or("-".into(), |p| value_with_error(&p)));
    }
    table
}

fn value_with_error(p: &KeptParameter) -> String {
    match (p.error(), p.status) {
        (Some(error), _) => {
            let settled = digits_by_error(p.value, error, 3).unwrap_or(4);
            format!("{} ± {}", digits(p.value, settled), digits(error, 3))
        }
        (None, Status::Estimated | Status::Derived) => digits(p.value, 5),
        (None, status) => format!("{} ({})", digits(p.value, 5), status),
    }
}

/// How an output of a run is met by one of the results.
struct Match<'a> {
    run: &'a str,
    output: &'a str,
    rms: Option<f64>,
    tic: Option<f64>,
}

fn fitted(candidates: &[Candidate]) -> Rows<(&str, &str)> {
    let matches = candidates.iter().map(|c| {
        let of = c.outputs.iter().flatten().map(|o| Match { run: &o.run, output: &o.name, rms: o.rms, tic: o.tic });
        (c.name.as_str(), of.collect())
    });
    outputs("fitted", matches.collect())
}

fn predictions(comparison: &Comparison) -> Option<Section> {
    if comparison.predictions.is_empty() {
        return None;
    }
    let matches = comparison.predictions.iter().map(|p| {
        let of = p.outputs.iter().map(|o| Match { run: &o.run, output: &o.name, rms: o.rms, tic: o.tic });
        (p.name.as_str(), of.collect())
    });
    let lost = comparison.predictions.iter().filter(|p| !p.converged);
    let lost = lost.map(|p| format!("{}: initial states and biases of the validation runs were not found", p.name));
    let section = Section::new("predictions", "Validation data").with(outputs("validation", matches.collect()));
    Some(section.lines(lost).with_all(comparison.edges.iter().map(|e| Part::Line(edge(e)))))
}

/// Size of the residual of every output of any result.
fn outputs<'a>(what: &str, results: Vec<(&str, Vec<Match<'a>>)>) -> Rows<(&'a str, &'a str)> {
    let mut table = Rows::over(distinct(results.iter().flat_map(|(_, all)| all).map(|m| (m.run, m.output))));
    table.words(what, |(run, _)| *run);
    table.name("output", |(_, output)| *output);
    for (name, all) in &results {
        table.number(&format!("RMS (TIC) {name}"), |(run, output)| {
            let found = all.iter().find(|m| m.run == *run && m.output == *output);
            let cell = found.and_then(|m| {
                Some(format!("{} ({})", digits(m.rms?, 4), m.tic.map_or("-".into(), |t| format!("{t:.3}"))))
            });
            cell.unwrap_or_else(|| "-".into())
        });
    }
    table
}

fn edge(e: &Edge) -> String {
    let Edge { output, best, other, advantage } = e;
    let Some(a) = advantage else {
        return format!(
            "{output}: whether {best} predicts better than {other} cannot be determined: too little is independent"
        );
    };
    let size =
        format!("leaves {:.1} ± {:.1} % less of the mean square than {other}", 100.0 * a.reduction, 100.0 * a.error);
    let p = p_value(a.p_value);
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
            (found.trust == Trust::Good, found.sentence)
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
        assert!(said.ends_with("(p = 1e-9); a predicts better"), "{said}");
        assert!(edge(&of(None)).contains("cannot be determined"));
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
