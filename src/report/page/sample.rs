//! The page of draws from a posterior: what they say of every parameter, whether the chains agree, and what they predict.

use super::document::{Head, frame};
use super::figure::{Figure, Look, Mark, Panel, Shape};
use super::headline::{capital, judgement};
use super::number::{bracketed, shown};
use super::section::{Section, Trust};
use super::subject::called;
use super::thinning::kept;
use fdm_results::documents::digits_by_error;
use fdm_results::documents::sample::{ArvizDocument, PredictiveBand, SampleDocument, SampledParameter};
use maud::{Markup, html};

/// Parameters whose traces are drawn, and bands of outputs.
const DRAWN: usize = 12;
/// Points of a trace and of a band.
const POINTS: usize = 800;
/// Columns of the histograms of ranks.
const COLUMNS: usize = 20;
/// Colours of the chains, in turn.
const LOOKS: [Look; 4] = [Look::Model, Look::Residual, Look::Input, Look::Other];

/// A page of draws, with the draws themselves.
pub fn sample_page(found: &SampleDocument, draws: &ArvizDocument) -> String {
    let mut sections = vec![Section::new("parameters", "Parameters", parameters(found))];
    let traces: Vec<[Figure; 2]> = found
        .parameters
        .iter()
        .filter_map(|p| Some((p, draws.posterior.get(&key(&p.name, p.run.as_deref()))?)))
        .take(DRAWN)
        .enumerate()
        .map(|(k, (p, chains))| [trace(k, p, chains), ranks(k, p, chains)])
        .collect();
    if !traces.is_empty() {
        let more = found.parameters.len().saturating_sub(traces.len());
        let content = html! {
            p { "Chains that agree look alike: their traces cross each other all the time, and each has all ranks equally often." }
            @for [trace, ranks] in &traces { div.pair { (trace.markup()) (ranks.markup()) } }
            @if more > 0 { p.note { (more) " more are in the file of " code { "--arviz" } "." } }
        };
        sections.push(Section::new("chains", "Traces and ranks", content));
    }
    if !found.bands.is_empty() {
        let runs = found.bands.iter().any(|b| b.run != found.bands[0].run);
        let figures = found.bands.iter().take(DRAWN).enumerate();
        let figures: Vec<Figure> = figures.map(|(k, band)| predictive(k, band, draws, runs)).collect();
        let content = html! {
            p { "Of the draws 95 % have their response within the darker band, and a new measurement within the lighter one." }
            @for figure in &figures { (figure.markup()) }
            @if found.bands.len() > DRAWN { p.note { (found.bands.len() - DRAWN) " more are in the JSON of " code { "--bands" } "." } }
        };
        sections.push(Section::new("predictions", "Posterior predictive bands", content));
    }
    sections.push(Section::new("sampler", "How the chains went", sampler(found)));
    let trust = if found.is_good() { Trust::Good } else { Trust::Reserved };
    let (first, rest) = crate::sample::verdict(found).split_at(1);
    let sentence = format!("{}{rest}.", first.to_uppercase());
    let point = |r: &String| (capital(r.strip_prefix("note: ").unwrap_or(r)), "sampler");
    let points = found.remarks.iter().map(point).collect();
    let facts = format!(
        "{} chains of {} draws, {} before them, seed {}.",
        found.chains.len(),
        found.draws,
        found.warmup,
        found.seed
    );
    let verdict = judgement((trust, sentence, points), Some(facts), &["sampler"]);
    frame(&Head { kind: "posterior", name: &found.model, doc: None, verdict }, &sections)
}

/// The name of a variable in the file for ArviZ.
fn key(name: &str, run: Option<&str>) -> String {
    run.map_or_else(|| name.to_string(), |run| format!("{name}[{run}]"))
}

fn parameters(found: &SampleDocument) -> Markup {
    let count = |v: Option<f64>| v.map_or("–".into(), |v| format!("{v:.0}"));
    let units = found.parameters.iter().any(|p| p.unit.as_deref().is_some_and(|u| u != "1"));
    html! {
        div.scroll { table {
            thead { tr {
                th { "parameter" } th.number { "mean" } th.number { "deviation" } th.number { "2.5 %" } th.number { "median" } th.number { "97.5 %" }
                @if units { th { "unit" } }
                th.number { "R-hat" } th.number { "bulk" } th.number { "tail" }
            } }
            tbody { @for p in &found.parameters {
                @let digits = digits_by_error(p.mean, p.deviation, 3).unwrap_or(4);
                tr {
                    th scope="row" { code { (called(&p.name, p.run.as_deref())) } }
                    td.number { (shown(p.mean, digits)) } td.number { (shown(p.deviation, 3)) }
                    td.number { (shown(p.interval[0], digits)) } td.number { (shown(p.median, digits)) } td.number { (shown(p.interval[1], digits)) }
                    @if units { td { (p.unit.as_deref().unwrap_or_default()) } }
                    td.number.large[p.r_hat.is_none_or(|r| r > 1.01)] { (p.r_hat.map_or("–".into(), |r| format!("{r:.3}"))) }
                    td.number { (count(p.bulk)) } td.number { (count(p.tail)) }
                }
            } }
        } }
        p.note { "R-hat is 1 where the chains agree. Bulk and tail are effective numbers of draws, for the middle and for the ends of the interval." }
    }
}

fn look(chain: usize) -> Look {
    LOOKS[chain % LOOKS.len()]
}

/// The values of every chain in their order.
fn trace(k: usize, p: &SampledParameter, chains: &[Vec<f64>]) -> Figure {
    let lines: Vec<&[f64]> = chains.iter().map(Vec::as_slice).collect();
    let indices = kept(&lines, POINTS);
    let draws = lines.first().map_or(0, |l| l.len());
    let line = |(c, chain): (usize, &&[f64])| {
        Mark::line(&format!("chain {}", c + 1), look(c), indices.iter().map(|k| chain[*k]).collect())
    };
    let name = called(&p.name, p.run.as_deref());
    Figure {
        id: format!("trace-{}", k + 1),
        group: "traces".into(),
        caption: format!("{name}: trace"),
        label: "draw".into(),
        logarithmic: false,
        at: indices.iter().map(|k| (k + 1) as f64).collect(),
        panels: vec![Panel {
            label: format!("{}{}", p.name, bracketed(p.unit.as_deref())),
            height: 150,
            logarithmic: false,
            marks: lines.iter().enumerate().map(line).collect(),
        }],
        names: Vec::new(),
        half: true,
        samples: (indices.len() < draws).then_some(draws),
    }
}

/// How often each chain has ranks of each twentieth among all draws, over what equal chains have.
fn ranks(k: usize, p: &SampledParameter, chains: &[Vec<f64>]) -> Figure {
    let mut order: Vec<(usize, f64)> =
        chains.iter().enumerate().flat_map(|(c, v)| v.iter().map(move |v| (c, *v))).collect();
    order.sort_by(|a, b| a.1.total_cmp(&b.1));
    let mut counts = vec![vec![0.0; COLUMNS]; chains.len()];
    for (rank, (chain, _)) in order.iter().enumerate() {
        counts[*chain][rank * COLUMNS / order.len()] += 1.0;
    }
    let expected = order.len() as f64 / (COLUMNS * chains.len().max(1)) as f64;
    let line = |(c, own): (usize, &Vec<f64>)| {
        Mark::line(&format!("chain {}", c + 1), look(c), own.iter().map(|n| n / expected).collect())
    };
    let mut marks: Vec<Mark> = counts.iter().enumerate().map(line).collect();
    marks.push(Mark::line("equal", Look::Measured, vec![1.0; COLUMNS]));
    Figure {
        id: format!("ranks-{}", k + 1),
        group: "ranks".into(),
        caption: format!("{}: ranks", called(&p.name, p.run.as_deref())),
        label: "rank among all draws [%]".into(),
        logarithmic: false,
        at: (0..COLUMNS).map(|c| (c as f64 + 0.5) * 100.0 / COLUMNS as f64).collect(),
        panels: vec![Panel { label: "part of its share".into(), height: 150, logarithmic: false, marks }],
        names: Vec::new(),
        half: true,
        samples: None,
    }
}

/// Measurement of an output within its bands.
fn predictive(k: usize, band: &PredictiveBand, draws: &ArvizDocument, runs: bool) -> Figure {
    let numbers = |values: &[Option<f64>]| values.iter().map(|v| v.unwrap_or(f64::NAN)).collect::<Vec<f64>>();
    let observed = draws.observed_data.get(&key(&band.name, Some(band.run.as_str()).filter(|_| runs)));
    let measured = observed.map_or_else(|| vec![f64::NAN; band.time.len()], |o| numbers(o));
    let [low, middle, high] = band.response.each_ref().map(|v| numbers(v));
    let [least, _, most] = band.measurement.each_ref().map(|v| numbers(v));
    let indices = kept(&[&measured, &low, &high], POINTS);
    let pick = |values: &[f64]| indices.iter().filter_map(|k| values.get(*k).copied()).collect::<Vec<f64>>();
    let marks = vec![
        Mark::between("95 % of measurements", Look::Bound, Shape::Band, pick(&least), pick(&most)),
        Mark::between("95 % of the response", Look::Model, Shape::Band, pick(&low), pick(&high)),
        Mark::dots("measured", Look::Measured, pick(&measured)),
        Mark::line("median", Look::Model, pick(&middle)),
    ];
    Figure {
        id: format!("prediction-{}", k + 1),
        group: format!("run-{}", band.run),
        caption: format!("{} in {}", band.name, band.run),
        label: "time".into(),
        logarithmic: false,
        at: pick(&band.time),
        panels: vec![Panel {
            label: format!("{}{}", band.name, bracketed(band.unit.as_deref())),
            height: 190,
            logarithmic: false,
            marks,
        }],
        names: Vec::new(),
        half: false,
        samples: (indices.len() < band.time.len()).then_some(band.time.len()),
    }
}

fn sampler(found: &SampleDocument) -> Markup {
    html! {
        div.scroll { table {
            thead { tr {
                th.number { "chain" } th.number { "divergent" } th.number { "step" } th.number { "acceptance" } th.number { "steps a draw" } th.number { "gradients" }
            } }
            tbody { @for (k, c) in found.chains.iter().enumerate() { tr {
                td.number { (k + 1) }
                td.number.large[c.divergent > 0] { (c.divergent) }
                td.number { (shown(c.step, 3)) } td.number { (format!("{:.2}", c.accepted)) } td.number { (format!("{:.1}", c.steps)) } td.number { (c.evaluations) }
            } } }
        } }
        @if !found.remarks.is_empty() { ul { @for r in &found.remarks { li { (r) } } } }
        p.note { "From the result in " code { (found.result) } "." }
    }
}
