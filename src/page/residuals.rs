//! Whether the residuals are noise: their autocorrelation, their spectrum, their distribution, and their correlation with every input, with
//! bounds.

use super::document::Section;
use super::figure::{Figure, Look, Mark, Panel, Shape};
use super::number::{probability, shown};
use super::subject::{Subject, list, numbers};
use maud::{Markup, html};
use serde_json::Value;

/// Outputs whose figures stand open.
const OPEN: usize = 4;

pub(super) fn section(subject: &Subject) -> Option<Section> {
    let outputs = outputs(subject);
    if outputs.is_empty() {
        return None;
    }
    let time = subject.time();
    let content = html! {
        (table(outputs))
        p.note {
            "Bias, size and rest are the parts of the mean square residual (Theil): a good model leaves only the rest. White residuals have a Durbin–Watson "
            "statistic near 2 and a large p. Bands are two standard deviations, of spectra 95 %: at one of twenty lags, and in one of twenty bands, chance "
            "leads beyond them. Errors of estimates hold for other distributions than the normal one too; outliers cost precision."
        }
        @for (k, o) in outputs.iter().enumerate() {
            @if o["whiteness"].is_object() {
                details.run open[k < OPEN] {
                    summary { (o["name"].as_str().unwrap_or_default()) " in " (o["run"].as_str().unwrap_or_default()) }
                    div.pair { @for figure in figures_of(k, o, &time) { (figure.markup()) } }
                }
            }
        }
    };
    Some(Section::new("residuals", "Residuals", content))
}

/// Those in time, where the fit was one of spectra.
fn outputs(subject: &Subject) -> &[Value] {
    match list(&subject.result["time_domain"]["outputs"]) {
        [] => subject.list("outputs"),
        found => found,
    }
}

fn table(outputs: &[Value]) -> Markup {
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
                        @let share = |part: &str| o["tic_parts"][part].as_f64().map_or("–".into(), |v| format!("{v:.2}"));
                        tr {
                            th scope="row" { code { (o["name"].as_str().unwrap_or_default()) } }
                            td { (o["run"].as_str().unwrap_or_default()) }
                            td.number { (shown(&o["rms"], 4)) }
                            td { (o["unit"].as_str().unwrap_or_default()) }
                            td.number { (shown(&o["mean"], 2)) }
                            td.number { (shown(&o["r2"], 5)) }
                            td.number { (shown(&o["tic"], 3)) }
                            td.number.large[o["tic_parts"]["bias"].as_f64().is_some_and(|v| v > 0.2)] { (share("bias")) }
                            td.number { (share("variance")) }
                            td.number { (share("covariance")) }
                            td.number { (probability(&o["whiteness"]["p_value"])) }
                            td.number { (shown(&o["whiteness"]["durbin_watson"], 3)) }
                            td.number { (o["compared"].as_u64().unwrap_or(0)) }
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
    let tested = outputs(subject).iter().enumerate().filter(|(_, o)| o["whiteness"].is_object());
    tested.flat_map(|(k, o)| figures_of(k, o, &time)).collect()
}

fn figures_of(k: usize, output: &Value, time: &str) -> Vec<Figure> {
    let inputs = list(&output["inputs"]).iter().enumerate().map(|(i, input)| with_input(k, i, input, time));
    let own = [Some(autocorrelation(k, output, time)), spectrum(k, output, time), histogram(k, output)];
    own.into_iter().flatten().chain(inputs).collect()
}

fn autocorrelation(k: usize, output: &Value, time: &str) -> Figure {
    let white = &output["whiteness"];
    let values = numbers(&white["autocorrelation"]);
    let interval = white["interval"].as_f64().unwrap_or(1.0);
    let caption = format!("autocorrelation of the residual; {} of {} lags outside", white["outside"], values.len());
    Figure {
        id: format!("autocorrelation-{}", k + 1),
        group: format!("autocorrelation-{}", k + 1),
        caption,
        label: format!("lag [{time}]"),
        logarithmic: false,
        at: (1..=values.len()).map(|lag| lag as f64 * interval).collect(),
        panels: vec![correlation(values, &numbers(&white["bounds"]))],
        names: Vec::new(),
        half: true,
        samples: None,
    }
}

/// Where in frequency something is left.
fn spectrum(k: usize, output: &Value, time: &str) -> Option<Figure> {
    let found = output["spectrum"].as_object()?;
    let column = |name: &str| numbers(&found[name]);
    let (at, density) = (column("frequency"), column("density"));
    let unit = if time == "s" { "Hz".to_string() } else { format!("cycles per {time}") };
    let id = format!("residual-spectrum-{}", k + 1);
    let marks = vec![
        Mark::between("of white noise", Look::Bound, Shape::Band, column("low"), column("high")),
        Mark::line("of the residual", Look::Residual, density.clone()),
        Mark::dots("", Look::Residual, density),
    ];
    Some(Figure {
        group: id.clone(),
        id,
        caption: format!("spectrum of the residual; {} of {} bands outside", found["outside"], at.len()),
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
fn histogram(k: usize, output: &Value) -> Option<Figure> {
    let found = output["distribution"].as_object()?;
    let edges = numbers(&found["edges"]);
    let counts = numbers(&found["counts"]);
    let unit = output["unit"].as_str().map_or(String::new(), |u| format!(" {u}"));
    let id = format!("residual-histogram-{}", k + 1);
    let zeros = vec![0.0; counts.len()];
    let marks = vec![
        Mark::between("residuals", Look::Measured, Shape::Columns, zeros, counts),
        Mark::line("normal", Look::Model, numbers(&found["expected"])),
    ];
    Some(Figure {
        group: id.clone(),
        id,
        caption: format!(
            "distribution of the residual; {} beyond 3 σ, of a normal one {}",
            found["far"][0],
            shown(&found["far"][1], 2)
        ),
        label: format!("deviation from the mean [σ = {}{unit}]", shown(&found["deviation"], 3)),
        logarithmic: false,
        at: edges.windows(2).map(|e| 0.5 * (e[0] + e[1])).collect(),
        panels: vec![Panel { label: "residuals".into(), height: 150, logarithmic: false, marks }],
        names: Vec::new(),
        half: true,
        samples: None,
    })
}

fn with_input(k: usize, i: usize, input: &Value, time: &str) -> Figure {
    let values = numbers(&input["correlation"]);
    let name = input["input"].as_str().unwrap_or_default();
    let caption = format!(
        "with input {name}; {} of {} lags outside, chance of the largest {}",
        input["outside"],
        values.len(),
        probability(&input["p_value"])
    );
    Figure {
        id: format!("with-input-{}-{}", k + 1, i + 1),
        group: format!("with-input-{}-{}", k + 1, i + 1),
        caption,
        label: format!("time by which the residual follows {name} [{time}]"),
        logarithmic: false,
        at: numbers(&input["lags"]),
        panels: vec![correlation(values, &numbers(&input["bounds"]))],
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
