//! Draws from a posterior: what they say of every parameter, whether the chains agree, and what they predict.

use super::section::{Cell, Part, Report, Rows, Section, Trust, Verdict, capital, sentence};
use crate::page::figure::{Figure, Look, Mark, Panel, Shape};
use crate::page::number::bracketed;
use crate::page::thinning::Kept;
use crate::{html, regions, text};
use fdm_results::documents::sample::{ArvizDocument, PredictiveBand, SampleDocument, SampledParameter};
use fdm_results::documents::{digits, digits_by_error, digits_of_end, with_run};

/// Parameters whose traces are drawn, and bands of outputs.
const DRAWN: usize = 12;
/// Points of a trace and of a band.
const POINTS: usize = 800;
/// Columns of the histograms of ranks.
const COLUMNS: usize = 20;
/// R-hat from which chains disagree.
const APART: f64 = 1.01;
/// Colours of the chains, in turn.
const LOOKS: [Look; 4] = [Look::Model, Look::Residual, Look::Input, Look::Other];

/// Verdict, parameters, chains.
pub fn sample_text(found: &SampleDocument) -> String {
    let head =
        format!("{}: posterior of the result in {}\n{}\n{}\n", found.model, found.result, clause(found), facts(found));
    text::below(head, &[parameters(found), sampler(found)])
}

/// A page of draws, with the draws themselves.
pub fn sample_page(found: &SampleDocument, draws: &ArvizDocument) -> String {
    let trust = if found.is_good() { Trust::Good } else { Trust::Reserved };
    let remark = |r: &String| capital(r.strip_prefix("note: ").unwrap_or(r));
    let verdict = Verdict::new(trust, sentence(clause(found)))
        .with_facts(format!("{}.", facts(found)))
        .with_points(found.remarks.iter().map(remark), "sampler");
    let pairs = regions::of_draws(found, draws).map(|picture| {
        let note = "Dashed: the interval of 95 % of each parameter by itself.";
        Section::drawn("pairs", "Pairs of parameters", picture.markup()).note(note)
    });
    let all = [Some(parameters(found)), pairs, chains(found, draws), predictions(found, draws), Some(sampler(found))];
    let sections = all.into_iter().flatten().collect();
    html::page(&Report { kind: "posterior".into(), name: found.model.clone(), doc: None, verdict, sections })
}

/// Whether the draws can be used.
fn clause(found: &SampleDocument) -> &'static str {
    match (found.is_good(), found.remarks.is_empty()) {
        (true, true) => "the chains agree, and nothing speaks against the draws",
        (true, false) => "the chains agree; what the draws take for granted is noted below",
        (false, _) => "not to be used yet: what speaks against the draws is said below",
    }
}

fn facts(found: &SampleDocument) -> String {
    let (chains, draws) = (found.chains.len(), found.draws);
    format!(
        "{chains} chains of {draws} draws ({} in all), {} before them, seed {}",
        draws * chains,
        found.warmup,
        found.seed
    )
}

fn parameters(found: &SampleDocument) -> Section {
    let shown = |p: &SampledParameter, v: f64| digits(v, digits_by_error(p.mean, p.deviation, 3).unwrap_or(4));
    let count = |v: Option<f64>| v.map_or("-".into(), |v| format!("{v:.0}"));
    let mut table = Rows::over(&found.parameters);
    table.name("parameter", |p| p.name.clone());
    table.runs(|p| p.run.as_deref());
    table.number("mean", |p| shown(p, p.mean));
    table.number("deviation", |p| digits(p.deviation, 3));
    table.number("2.5 %", |p| digits_of_end(p.interval[0], p.deviation));
    table.number("median", |p| shown(p, p.median));
    table.number("97.5 %", |p| digits_of_end(p.interval[1], p.deviation));
    table.number("R-hat", |p| {
        Cell::coloured(p.r_hat.map_or("-".into(), |r| format!("{r:.3}")), p.r_hat.is_none_or(|r| r > APART))
    });
    table.number("bulk", |p| count(p.bulk));
    table.number("tail", |p| count(p.tail));
    table.unit(|p| p.unit.clone());
    let note = "R-hat is 1 where the chains agree. Bulk and tail are effective numbers of draws, for the middle and for the ends of the interval.";
    Section::new("parameters", "Parameters").with(table).explained(note)
}

fn chains(found: &SampleDocument, draws: &ArvizDocument) -> Option<Section> {
    let known = |p: &'_ SampledParameter| draws.posterior.get(&key(&p.name, p.run.as_deref())).cloned();
    let drawn = found.parameters.iter().filter_map(|p| Some((p, known(p)?))).take(DRAWN).enumerate();
    let pairs: Vec<Part> =
        drawn.map(|(k, (p, chains))| Part::Pair(vec![trace(k, p, &chains), ranks(k, p, &chains)])).collect();
    let more = found.parameters.len().saturating_sub(pairs.len());
    let agree = "Chains that agree look alike: their traces cross each other all the time, and each has all ranks equally often.";
    (!pairs.is_empty()).then(|| {
        Section::new("chains", "Traces and ranks")
            .line(agree)
            .with_all(pairs)
            .notes((more > 0).then(|| format!("{more} more are in the file of `--arviz`.")))
    })
}

fn predictions(found: &SampleDocument, draws: &ArvizDocument) -> Option<Section> {
    let runs = found.bands.iter().any(|b| b.run != found.bands[0].run);
    let figures = found.bands.iter().take(DRAWN).enumerate().map(|(k, band)| predictive(k, band, draws, runs));
    let more = found.bands.len().saturating_sub(DRAWN);
    let within =
        "Of the draws 95 % have their response within the darker band, and a new measurement within the lighter one.";
    (!found.bands.is_empty()).then(|| {
        Section::new("predictions", "Posterior predictive bands")
            .line(within)
            .with_all(figures)
            .notes((more > 0).then(|| format!("{more} more are in the JSON of `--bands`.")))
    })
}

fn sampler(found: &SampleDocument) -> Section {
    let mut table = Rows::over(found.chains.iter().enumerate());
    table.number("chain", |(k, _)| k + 1);
    table.number("divergent", |(_, c)| Cell::coloured(c.divergent.to_string(), c.divergent > 0));
    table.number("step", |(_, c)| digits(c.step, 3));
    table.number("acceptance", |(_, c)| format!("{:.2}", c.accepted));
    table.number("steps a draw", |(_, c)| format!("{:.1}", c.steps));
    table.number("gradients", |(_, c)| c.evaluations);
    Section::new("sampler", "How the chains went")
        .with(table)
        .with_all((!found.remarks.is_empty()).then(|| Part::List(found.remarks.clone()).on_page()))
        .explained(format!("From the result in `{}`.", found.result))
}

/// The name of a variable in the file for ArviZ.
fn key(name: &str, run: Option<&str>) -> String {
    run.map_or_else(|| name.to_string(), |run| format!("{name}[{run}]"))
}

fn look(chain: usize) -> Look {
    LOOKS[chain % LOOKS.len()]
}

/// The values of every chain in their order.
fn trace(k: usize, p: &SampledParameter, chains: &[Vec<f64>]) -> Figure {
    let lines: Vec<&[f64]> = chains.iter().map(Vec::as_slice).collect();
    let kept = Kept::new(&lines, POINTS);
    let line = |(c, chain): (usize, &&[f64])| {
        Mark::line(&format!("chain {}", c + 1), look(c), kept.indices().iter().map(|k| chain[*k]).collect())
    };
    let name = with_run(&p.name, p.run.as_deref());
    Figure::new(
        format!("trace-{}", k + 1),
        format!("{name}: trace"),
        "draw",
        kept.indices().iter().map(|k| (k + 1) as f64).collect(),
    )
    .in_group("traces")
    .with(Panel::new(
        format!("{}{}", p.name, bracketed(p.unit.as_deref())),
        150,
        lines.iter().enumerate().map(line).collect(),
    ))
    .half()
    .thinned(kept.samples())
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
    Figure::new(
        format!("ranks-{}", k + 1),
        format!("{}: ranks", with_run(&p.name, p.run.as_deref())),
        "rank among all draws [%]",
        (0..COLUMNS).map(|c| (c as f64 + 0.5) * 100.0 / COLUMNS as f64).collect(),
    )
    .in_group("ranks")
    .with(Panel::new("part of its share", 150, marks))
    .half()
}

/// Measurement of an output within its bands.
fn predictive(k: usize, band: &PredictiveBand, draws: &ArvizDocument, runs: bool) -> Figure {
    let numbers = |values: &[Option<f64>]| values.iter().map(|v| v.unwrap_or(f64::NAN)).collect::<Vec<f64>>();
    let observed = draws.observed_data.get(&key(&band.name, Some(band.run.as_str()).filter(|_| runs)));
    let measured = observed.map_or_else(|| vec![f64::NAN; band.time.len()], |o| numbers(o));
    let [low, middle, high] = band.response.each_ref().map(|v| numbers(v));
    let [least, _, most] = band.measurement.each_ref().map(|v| numbers(v));
    let kept = Kept::new(&[&measured, &low, &high], POINTS);
    let pick = |values: &[f64]| kept.pick(values);
    let marks = vec![
        Mark::between("95 % of measurements", Look::Bound, Shape::Band, pick(&least), pick(&most)),
        Mark::between("95 % of the response", Look::Model, Shape::Band, pick(&low), pick(&high)),
        Mark::dots("measured", Look::Measured, pick(&measured)),
        Mark::line("median", Look::Model, pick(&middle)),
    ];
    Figure::new(format!("prediction-{}", k + 1), format!("{} in {}", band.name, band.run), "time", pick(&band.time))
        .in_group(format!("run-{}", band.run))
        .with(Panel::new(format!("{}{}", band.name, bracketed(band.unit.as_deref())), 190, marks))
        .thinned(kept.samples())
}
