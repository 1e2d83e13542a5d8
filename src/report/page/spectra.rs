//! What was compared in the frequency domain: frequency responses with coherence, or the spectra of the outputs.

use super::figure::{Figure, Look, Mark, Panel, Shape};
use super::number::{bracketed, shown};
use super::section::Section;
use super::subject::Subject;
use super::table::Table;
use fdm_results::documents::{FrequencyResponses, Pair};
use maud::{Markup, html};

/// Decibels of a relative error of one: 20/ln 10.
const DECIBELS: f64 = 8.685_889_638;
/// Degrees of a radian.
const DEGREES: f64 = 57.295_779_513;
/// Figures that are drawn.
const MOST: usize = 40;
/// Figures that are drawn behind time histories: paper is short.
const IN_TIME: usize = 16;

pub(super) fn section(subject: &Subject) -> Option<Section> {
    let figures = figures(subject);
    if figures.is_empty() {
        return None;
    }
    if let Some(fit) = subject.fit().filter(|fit| !fit.bode.is_empty()) {
        let content = html! {
            p { "What the runs show, and the model's response over the same time, estimated by the same windows. "
                "Bars are two random errors, as the coherence tells them." }
            div.pair { @for figure in &figures { (figure.markup()) } }
            @if fit.bode.len() > IN_TIME { p.note { (fit.bode.len() - IN_TIME) " more pairs are in " code { "result.json" } ", " code { "bode" } "." } }
        };
        return Some(Section::new("spectra", "Frequency responses", content));
    }
    let content = match compared(subject).filter(|document| !document.pairs.is_empty()) {
        None => html! {
            p.note { "Magnitudes of the spectra that were compared, and of what is left between them." }
            div.pair { @for figure in &figures { (figure.markup()) } }
        },
        Some(document) => responses(document, &figures),
    };
    Some(Section::new("spectra", "Frequency domain", content))
}

/// Of every pair, or of every output of every run.
pub(super) fn figures(subject: &Subject) -> Vec<Figure> {
    let unit = subject.frequency();
    let in_time = subject.fit().into_iter().flat_map(|fit| fit.bode.iter().take(IN_TIME));
    let of_pairs = compared(subject)
        .into_iter()
        .flat_map(|document| &document.pairs)
        .chain(in_time)
        .enumerate()
        .map(|(k, p)| response(k, p, &unit));
    let of_runs = subject.spectra.iter().enumerate().flat_map(|(k, (run, table))| of_run(k, run, table, &unit));
    of_pairs.chain(of_runs).take(MOST).collect()
}

/// The frequency responses that were compared, where it is such a fit.
fn compared(subject: &Subject) -> Option<&FrequencyResponses> {
    subject.fit()?.frequency_responses.as_ref()
}

fn responses(document: &FrequencyResponses, figures: &[Figure]) -> Markup {
    html! {
        div.scroll { table {
            thead { tr { th { "response" } th.number { "frequencies" } th.number { "left out" } th.number { "cost" } } }
            tbody {
                @for p in &document.pairs { tr {
                    th scope="row" { code { (p.output) "/" (p.input) } }
                    td.number { (p.frequency.len()) } td.number { (p.left_out) } td.number { (shown(p.cost, 3)) }
                } }
                tr { th scope="row" { "average" } td {} td {} td.number { (shown(document.cost, 3)) } }
            }
        } }
        p.note { "A cost up to 100 is good, and up to 50 as good as the data. Bars are two random errors, as the coherence tells them; frequencies "
            "with a coherence below " (shown(document.least_coherence, 2)) " are left out." }
        div.pair { @for figure in figures { (figure.markup()) } }
        @if !document.sensitivities.is_empty() {
            h3 { "Bounds and insensitivities" }
            div.scroll { table {
                thead { tr { th { "parameter" } th.number { "2 × Cramér–Rao %" } th.number { "insensitivity %" } } }
                tbody { @for s in &document.sensitivities { tr {
                    th scope="row" { code { (s.parameter) } }
                    td.number.large[s.cramer_rao > 20.0] { (shown(s.cramer_rao, 3)) }
                    td.number.large[s.insensitivity > 10.0] { (shown(s.insensitivity, 3)) }
                } } }
            } }
        }
    }
}

/// Magnitude, phase and coherence of a pair.
fn response(k: usize, p: &Pair, unit: &str) -> Figure {
    let panel = |label: &str, (values, modelled): (&Vec<f64>, &Vec<f64>), size: f64| {
        let edge =
            |sign: f64| values.iter().zip(&p.error).map(|(v, e)| v + sign * 2.0 * size * e).collect::<Vec<f64>>();
        let bars = Mark::between("", Look::Measured, Shape::Bars, edge(-1.0), edge(1.0));
        let dots = Mark {
            name: "measured".into(),
            look: Look::Measured,
            shape: Shape::Dots,
            values: values.clone(),
            low: Vec::new(),
        };
        let model = Mark::line("model", Look::Model, modelled.clone());
        Panel { label: label.into(), height: 130, logarithmic: false, marks: vec![bars, model, dots] }
    };
    let coherence = Mark::line("coherence", Look::Input, p.coherence.clone());
    let (degrees, model_degrees) = continued(&p.degrees, &p.model_degrees);
    Figure {
        id: format!("response-{}", k + 1),
        group: "responses".into(),
        caption: format!("{}/{}: cost {}", p.output, p.input, shown(p.cost, 3)),
        label: format!("frequency [{unit}], × 2π in rad"),
        logarithmic: true,
        at: p.frequency.clone(),
        panels: vec![
            panel("magnitude [dB]", (&p.decibels, &p.model_decibels), DECIBELS),
            panel("phase [deg]", (&degrees, &model_degrees), DEGREES),
            Panel { label: "coherence".into(), height: 70, logarithmic: false, marks: vec![coherence] },
        ],
        names: Vec::new(),
        half: true,
        samples: None,
    }
}

/// Measured degrees without jumps of a whole turn, and those of the model nearest to them.
fn continued(measured: &[f64], modelled: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let smooth = crate::response::unwrapped(measured.iter().copied());
    let nearest = |(v, to): (&f64, &f64)| v + 360.0 * ((to - v) / 360.0).round();
    let own = modelled.iter().zip(&smooth).map(nearest).collect();
    (smooth, own)
}

fn of_run(k: usize, run: &str, table: &Table, unit: &str) -> Vec<Figure> {
    let Some(frequency) = table.columns.first() else { return Vec::new() };
    let column = |name: String| table.column(&name).map_or(&[][..], |c| &c.values);
    let outputs = table.columns.iter().filter_map(|c| Some((c.name.strip_suffix("_model_re")?, c.unit.as_deref())));
    let figure = |(o, (name, own)): (usize, (&str, Option<&str>))| {
        let part = |kind: &str| column(format!("{name}{kind}")).to_vec();
        let [re, im, model_re, model_im] = ["_re", "_im", "_model_re", "_model_im"].map(part);
        let size = |re: &[f64], im: &[f64]| re.iter().zip(im).map(|(a, b)| a.hypot(*b)).collect::<Vec<f64>>();
        let less = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a - b).collect::<Vec<f64>>();
        let rest = size(&less(&re, &model_re), &less(&im, &model_im));
        let marks = vec![
            Mark::line("measured", Look::Measured, size(&re, &im)),
            Mark::line("model", Look::Model, size(&model_re, &model_im)),
            Mark::line("what is left", Look::Residual, rest),
        ];
        let label = format!("|{name}|{}", bracketed(own));
        Figure {
            id: format!("spectrum-{}-{}", k + 1, o + 1),
            group: format!("spectra-{k}"),
            caption: format!("{name} in {run}"),
            label: format!("frequency [{unit}]"),
            logarithmic: true,
            at: frequency.values.clone(),
            panels: vec![Panel { label, height: 190, logarithmic: true, marks }],
            names: Vec::new(),
            half: true,
            samples: None,
        }
    };
    outputs.enumerate().map(figure).collect()
}
