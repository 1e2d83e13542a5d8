//! Whether the residuals are noise: their autocorrelation, their spectrum, their distribution, and their correlation with every input, with
//! bounds.

use super::figure::{Figure, Look, Mark, Panel, Shape};
use super::number::{probability, shown};
use super::section::Section;
use super::subject::Subject;
use fdm_estimate::residuals::{InputCorrelation, TicParts, Whiteness};
use fdm_results::documents::OutputDocument;
use maud::{Markup, html};

/// Outputs whose figures stand open.
const OPEN: usize = 4;

pub(super) fn section(subject: &Subject) -> Option<Section> {
    let outputs = subject.outputs();
    if outputs.is_empty() {
        return None;
    }
    let time = subject.time();
    let content = html! {
        (table(outputs))
        @let predicted = subject.predicted();
        @if !predicted.is_empty() {
            h3 { "Validation runs" }
            p.note { "Not fitted. What all runs share is held; initial states and biases are each run's own." }
            (table(predicted))
        }
        p.note {
            "Bias, size and rest are the parts of the mean square residual (Theil): a good model leaves only the rest. White residuals have a Durbin–Watson "
            "statistic near 2 and a large p. Bands are two standard deviations, of spectra 95 %: at one of twenty lags, and in one of twenty bands, chance "
            "leads beyond them. Errors of estimates hold for other distributions than the normal one too; outliers cost precision."
        }
        @for (k, o) in outputs.iter().enumerate() {
            @if let Some(white) = o.white() {
                details.run open[k < OPEN] {
                    summary { (o.name) " in " (o.run) }
                    div.pair { @for figure in figures_of(k, o, white, &time) { (figure.markup()) } }
                }
            }
        }
    };
    Some(Section::new("residuals", "Residuals", content))
}

fn table(outputs: &[OutputDocument]) -> Markup {
    html! {
        div.scroll {
            table {
                thead { tr {
                    th { "output" } th { "run" } th.number { "RMS" } th { "unit" } th.number { "mean" } th.number { "R²" } th.number { "TIC" }
                    th.number { "bias" } th.number { "size" } th.number { "rest" } th.number { "white p" } th.number { "D–W" }
                    th.number { "compared" }
                } }
                tbody {
                    @for o in outputs {
                        @let share = |part: fn(TicParts) -> f64| o.tic_parts.map(part).filter(|v| v.is_finite()).map_or("–".into(), |v| format!("{v:.2}"));
                        tr {
                            th scope="row" { code { (o.name) } }
                            td { (o.run) }
                            td.number { (shown(o.rms, 4)) }
                            td { (o.unit.as_deref().unwrap_or_default()) }
                            td.number { (shown(o.mean, 2)) }
                            td.number { (shown(o.r2, 5)) }
                            td.number { (shown(o.tic, 3)) }
                            td.number.large[o.tic_parts.is_some_and(|p| p.bias > 0.2)] { (share(|p| p.bias)) }
                            td.number { (share(|p| p.variance)) }
                            td.number { (share(|p| p.covariance)) }
                            td.number { (probability(o.white().map(|w| w.p_value))) }
                            td.number { (shown(o.white().and_then(|w| w.durbin_watson), 3)) }
                            td.number { (o.compared) }
                        }
                    }
                }
            }
        }
    }
}

/// All of them, output by output.
pub(super) fn figures(subject: &Subject) -> Vec<Figure> {
    let time = subject.time();
    let tested = subject.outputs().iter().enumerate().filter_map(|(k, o)| Some((k, o, o.white()?)));
    tested.flat_map(|(k, o, white)| figures_of(k, o, white, &time)).collect()
}

fn figures_of(k: usize, output: &OutputDocument, white: &Whiteness, time: &str) -> Vec<Figure> {
    let inputs = output.inputs().iter().enumerate().map(|(i, input)| with_input(k, i, input, time));
    let own = [Some(autocorrelation(k, white, time)), spectrum(k, output, time), histogram(k, output)];
    own.into_iter().flatten().chain(inputs).collect()
}

fn autocorrelation(k: usize, white: &Whiteness, time: &str) -> Figure {
    let (values, interval) = (white.autocorrelation.clone(), white.interval);
    let caption = format!("autocorrelation of the residual; {} of {} lags outside", white.outside, values.len());
    Figure {
        id: format!("autocorrelation-{}", k + 1),
        group: format!("autocorrelation-{}", k + 1),
        caption,
        label: format!("lag [{time}]"),
        logarithmic: false,
        at: (1..=values.len()).map(|lag| lag as f64 * interval).collect(),
        panels: vec![correlation(values, &white.bounds)],
        names: Vec::new(),
        half: true,
        samples: None,
    }
}

/// Where in frequency something is left.
fn spectrum(k: usize, output: &OutputDocument, time: &str) -> Option<Figure> {
    let found = output.spectrum.as_ref()?.as_ref()?;
    let (at, density) = (found.frequency.clone(), found.density.clone());
    let unit = if time == "s" { "Hz".to_string() } else { format!("cycles per {time}") };
    let id = format!("residual-spectrum-{}", k + 1);
    let marks = vec![
        Mark::between("of white noise", Look::Bound, Shape::Band, found.low.clone(), found.high.clone()),
        Mark::line("of the residual", Look::Residual, density.clone()),
        Mark::dots("", Look::Residual, density),
    ];
    Some(Figure {
        group: id.clone(),
        id,
        caption: format!("spectrum of the residual; {} of {} bands outside", found.outside, at.len()),
        label: format!("frequency [{unit}]"),
        logarithmic: true,
        at,
        panels: vec![Panel { label: "density over white".into(), height: 150, logarithmic: true, marks }],
        names: Vec::new(),
        half: true,
        samples: None,
    })
}

/// How residuals are distributed.
fn histogram(k: usize, output: &OutputDocument) -> Option<Figure> {
    let found = output.distribution.as_ref()?.as_ref()?;
    let counts: Vec<f64> = found.counts.iter().map(|n| *n as f64).collect();
    let unit = output.unit.as_ref().map_or(String::new(), |u| format!(" {u}"));
    let id = format!("residual-histogram-{}", k + 1);
    let zeros = vec![0.0; counts.len()];
    let marks = vec![
        Mark::between("residuals", Look::Measured, Shape::Columns, zeros, counts),
        Mark::line("normal", Look::Model, found.expected.clone()),
    ];
    Some(Figure {
        group: id.clone(),
        id,
        caption: format!(
            "distribution of the residual; {} beyond 3 σ, of a normal one {}",
            found.far.0,
            shown(found.far.1, 2)
        ),
        label: format!("deviation from the mean [σ = {}{unit}]", shown(found.deviation, 3)),
        logarithmic: false,
        at: found.edges.windows(2).map(|e| 0.5 * (e[0] + e[1])).collect(),
        panels: vec![Panel { label: "residuals".into(), height: 150, logarithmic: false, marks }],
        names: Vec::new(),
        half: true,
        samples: None,
    })
}

fn with_input(k: usize, i: usize, input: &InputCorrelation, time: &str) -> Figure {
    let (name, values) = (&input.input, input.correlation.clone());
    let caption = format!(
        "with input {name}; {} of {} lags outside, chance of the largest {}",
        input.outside,
        values.len(),
        probability(input.p_value)
    );
    Figure {
        id: format!("with-input-{}-{}", k + 1, i + 1),
        group: format!("with-input-{}-{}", k + 1, i + 1),
        caption,
        label: format!("time by which the residual follows {name} [{time}]"),
        logarithmic: false,
        at: input.lags.clone(),
        panels: vec![correlation(values, &input.bounds)],
        names: Vec::new(),
        half: true,
        samples: None,
    }
}

fn correlation(values: Vec<f64>, bounds: &[f64]) -> Panel {
    let zeros = vec![0.0; values.len()];
    let band =
        Mark::between("by chance", Look::Bound, Shape::Band, bounds.iter().map(|b| -b).collect(), bounds.to_vec());
    let stems = Mark::between("correlation", Look::Residual, Shape::Stems, zeros, values);
    Panel { label: "correlation".into(), height: 150, logarithmic: false, marks: vec![band, stems] }
}
