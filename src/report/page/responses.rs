//! The page of frequency responses that records show: magnitude, phase and coherence of every pair.

use super::document::{Head, frame};
use super::headline::judgement;
use super::number::shown;
use super::section::{Section, Trust};
use crate::response::{figure, pairs};
use fdm_results::documents::ResponseNames;
use fdm_system::spectrum::FrequencyResponseEstimate;
use maud::html;

/// Coherence from which a response is believed.
const COHERENT: f64 = 0.6;
/// Pairs that are drawn.
const DRAWN: usize = 40;

/// A page of frequency responses of records.
pub fn responses_page(model: &str, found: &FrequencyResponseEstimate, names: &ResponseNames) -> String {
    let all = pairs(found, names);
    let coherent = |pair: &crate::response::Pair<'_>| {
        let good: Vec<f64> =
            pair.frequency.iter().zip(pair.coherence).filter(|(_, c)| **c >= COHERENT).map(|(f, _)| *f).collect();
        (good.len(), good.first().copied(), good.last().copied())
    };
    let table = html! {
        div.scroll { table {
            thead { tr { th { "response" } th.number { "frequencies" } th.number { "coherent" } th.number { "from" } th.number { "to" } th { (names.frequency) } } }
            tbody { @for pair in &all {
                @let (count, from, to) = coherent(pair);
                tr {
                    th scope="row" { code { (pair.output) "/" (pair.input) } }
                    td.number { (pair.frequency.len()) } td.number.large[count == 0] { (count) } td.number { (shown(from, 3)) } td.number { (shown(to, 3)) } td {}
                }
            } }
        } }
        p.note { "Coherent: at so many frequencies the input explains 0.6 or more of what the other inputs leave of the output." }
    };
    let figures: Vec<_> =
        all.iter().take(DRAWN).enumerate().map(|(k, pair)| figure(k, pair, &names.frequency)).collect();
    let content = html! {
        p.note { "Bands are one random error, as the coherence tells it." }
        div.pair { @for figure in &figures { (figure.markup()) } }
        @if all.len() > DRAWN { p.note { (all.len() - DRAWN) " more pairs are in the JSON." } }
    };
    let sections =
        vec![Section::new("pairs", "Pairs", table), Section::new("responses", "Frequency responses", content)];
    let lost: Vec<(String, &'static str)> = all
        .iter()
        .filter(|pair| coherent(pair).0 == 0)
        .map(|pair| (format!("`{}` shows no response to `{}`", pair.output, pair.input), "pairs"))
        .collect();
    let (trust, sentence) = match lost.len() {
        0 => (Trust::Good, "Every pair is coherent somewhere.".to_string()),
        n if n == all.len() => (Trust::Bad, "No pair is coherent anywhere: the records show no response.".into()),
        n => (Trust::Reserved, format!("{n} of {} pairs are coherent nowhere:", all.len())),
    };
    let verdict = judgement((trust, sentence, lost), None, &["pairs"]);
    frame(&Head { kind: "frequency responses", name: model, doc: None, verdict }, &sections)
}
