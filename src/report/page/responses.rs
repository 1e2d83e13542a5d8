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
    let counts: Vec<(String, usize, usize)> = all
        .iter()
        .map(|pair| (format!("`{}`/`{}`", pair.output, pair.input), coherent(pair).0, pair.frequency.len()))
        .collect();
    let (trust, sentence, points) = coherence_verdict(&counts);
    let points = points.into_iter().map(|point| (point, "pairs")).collect();
    let verdict = judgement((trust, sentence, points), None, &["pairs"]);
    frame(&Head { kind: "frequency responses", name: model, doc: None, verdict }, &sections)
}

/// What is said of pairs by their names, coherent frequencies, and frequencies in all; the least coherent pair first.
fn coherence_verdict(pairs: &[(String, usize, usize)]) -> (Trust, String, Vec<String>) {
    let share = |(_, coherent, of): &(String, usize, usize)| *coherent as f64 / (*of).max(1) as f64;
    let mut weak: Vec<&(String, usize, usize)> = pairs.iter().filter(|pair| share(pair) < 0.5).collect();
    weak.sort_by(|a, b| share(a).total_cmp(&share(b)));
    let said = |(name, coherent, of): &(String, usize, usize)| match coherent {
        0 => format!("{name} shows no response: coherent at none of {of} frequencies"),
        n => format!("{name} is coherent at {n} of {of} frequencies"),
    };
    let least = pairs.iter().min_by(|a, b| share(a).total_cmp(&share(b)));
    let (trust, sentence) = match (weak.len(), least) {
        (_, None) => (Trust::Bad, "There is no pair.".to_string()),
        (0, Some((_, n, of))) if pairs.len() == 1 => {
            (Trust::Good, format!("The pair is coherent at {n} of {of} frequencies."))
        }
        (0, Some((name, n, of))) => (
            Trust::Good,
            format!("Every pair is coherent at half of the frequencies or more, {name} at the fewest: {n} of {of}.")
                .replace('`', ""),
        ),
        _ if pairs.iter().all(|(_, n, _)| *n == 0) => {
            (Trust::Bad, "No pair is coherent at any frequency: the records show no response.".into())
        }
        (n, _) if n == pairs.len() => {
            (Trust::Reserved, "No pair is coherent at half of the frequencies; fit only where they are:".into())
        }
        (n, _) => (
            Trust::Reserved,
            format!(
                "{n} of {} pairs are coherent at less than half of the frequencies; fit only where they are:",
                pairs.len()
            ),
        ),
    };
    (trust, sentence, weak.into_iter().map(said).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pair_that_is_coherent_at_one_frequency_is_not_praised() {
        let of = |n: [usize; 2]| {
            let pairs = [("`y`/`u`".to_string(), n[0], 82), ("`z`/`u`".to_string(), n[1], 82)];
            coherence_verdict(&pairs)
        };
        let (trust, sentence, points) = of([80, 1]);
        assert!(trust == Trust::Reserved && sentence.starts_with("1 of 2 pairs are coherent at less"), "{sentence}");
        assert_eq!(points, ["`z`/`u` is coherent at 1 of 82 frequencies"]);
        let (trust, sentence, points) = of([80, 60]);
        assert!(trust == Trust::Good && sentence.ends_with("z/u at the fewest: 60 of 82.") && points.is_empty());
        assert!(of([0, 0]).0 == Trust::Bad && of([3, 0]).0 == Trust::Reserved);
        assert!(of([3, 0]).2[0].contains("shows no response"));
    }
}
