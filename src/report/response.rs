//! Frequency responses that records show: a table, and a picture of magnitude, phase and coherence of every pair.

use super::section::{Cell, Part, Report, Rows, Section, Trust, Verdict};
use crate::page::Paper;
use crate::page::drawing::stacked;
use crate::page::figure::{Figure, Look, Mark, Panel, Shape};
use crate::{html, text};
use fdm_results::documents::{ResponseNames, digits};
use fdm_system::spectrum::FrequencyResponseEstimate;
use std::f64::consts::TAU;

/// Coherence from which a response is believed.
const COHERENT: f64 = 0.6;
/// Pairs that are drawn on a page.
const DRAWN: usize = 40;

/// A table for every pair of an input and an output.
pub fn response_table(found: &FrequencyResponseEstimate, names: &ResponseNames) -> String {
    let tables = pairs(found, names).into_iter().map(|pair| {
        let caption = format!("{} to {}", pair.input, pair.output);
        values(&pair, &names.frequency).below(caption)
    });
    text::sections(&[Section::new("responses", "Frequency responses").with_all(tables)])
}

/// Magnitude and phase with the band of one random error, and coherence, over the logarithm of frequency: a figure for every pair.
pub fn response_svg(found: &FrequencyResponseEstimate, names: &ResponseNames) -> String {
    stacked(&figures(&pairs(found, names), names), Paper::Light)
}

/// A page of frequency responses of records.
pub fn responses_page(model: &str, found: &FrequencyResponseEstimate, names: &ResponseNames) -> String {
    let all = pairs(found, names);
    let counts: Vec<(String, usize, usize)> = all
        .iter()
        .map(|pair| (format!("`{}`/`{}`", pair.output, pair.input), pair.coherent().count(), pair.frequency.len()))
        .collect();
    let (trust, sentence, points) = coherence_verdict(&counts);
    let more = all.len().saturating_sub(DRAWN);
    let responses = Section::new("responses", "Frequency responses")
        .note("Bands are one random error, as the coherence tells it.")
        .with(Part::Pair(figures(&all[..all.len().min(DRAWN)], names)))
        .notes((more > 0).then(|| format!("{more} more pairs are in the JSON.")));
    html::page(&Report {
        kind: "frequency responses".into(),
        name: model.into(),
        doc: None,
        verdict: Verdict::new(trust, sentence).with_points(points, "pairs"),
        sections: vec![coherences(&all, &names.frequency), responses],
    })
}

/// One pair of channels as a reader wants it.
struct Pair<'a> {
    input: &'a str,
    output: &'a str,
    frequency: Vec<f64>,
    /// In decibels.
    magnitude: Vec<f64>,
    /// In degrees, without jumps.
    phase: Vec<f64>,
    /// With the other inputs taken out.
    coherence: &'a [f64],
    /// Of all inputs.
    multiple: &'a [f64],
    /// Random error of the magnitude as a part of it.
    error: &'a [f64],
}

fn pairs<'a>(found: &'a FrequencyResponseEstimate, names: &'a ResponseNames) -> Vec<Pair<'a>> {
    let count = found.omega.len();
    let one = |o: usize, i: usize| {
        let at = found.pair(o, i);
        let response = &found.response[at.clone()];
        Pair {
            input: &names.inputs[i],
            output: &names.outputs[o],
            frequency: found.omega.iter().map(|w| w / TAU).collect(),
            magnitude: response.iter().map(|h| 20.0 * h.norm().log10()).collect(),
            phase: unwrapped(
                response.iter().map(|h| h.arg().to_degrees()).zip(found.partial_coherence[at.clone()].iter().copied()),
            ),
            coherence: &found.partial_coherence[at.clone()],
            multiple: &found.coherence[o * count..(o + 1) * count],
            error: &found.error[at],
        }
    };
    (0..found.outputs).flat_map(|o| (0..found.inputs).map(move |i| (o, i))).map(|(o, i)| one(o, i)).collect()
}

/// Angles in degrees with their coherence, each within half a turn of the last before it that is coherent: noise counts no turns.
pub(crate) fn unwrapped(angles: impl Iterator<Item = (f64, f64)>) -> Vec<f64> {
    let mut last: f64 = 0.0;
    let continued = |(angle, coherence): (f64, f64)| {
        let near = angle - 360.0 * ((angle - last) / 360.0).round();
        last = if near.is_finite() && coherence >= COHERENT { near } else { last };
        near
    };
    angles.map(continued).collect()
}

impl Pair<'_> {
    /// Frequencies at which the response is believed.
    fn coherent(&self) -> impl DoubleEndedIterator<Item = f64> + '_ {
        self.frequency.iter().zip(self.coherence).filter(|(_, c)| **c >= COHERENT).map(|(f, _)| *f)
    }
}

/// Every frequency of a pair.
fn values(pair: &Pair<'_>, unit: &str) -> Rows<usize> {
    let mut table = Rows::over(0..pair.frequency.len());
    table.number(&format!("frequency [{unit}]"), |k| digits(pair.frequency[*k], 4));
    table.number("magnitude [dB]", |k| format!("{:.2}", pair.magnitude[*k]));
    table.number("phase [deg]", |k| format!("{:.1}", pair.phase[*k]));
    table.number("coherence", |k| format!("{:.3}", pair.coherence[*k]));
    table.number("multiple", |k| format!("{:.3}", pair.multiple[*k]));
    table.number("random error", |k| digits(pair.error[*k], 3));
    table.number("phase error [deg]", |k| digits(1f64.to_degrees() * pair.error[*k], 3));
    table
}

/// Where each pair is coherent.
fn coherences(all: &[Pair<'_>], unit: &str) -> Section {
    let shown = |f: Option<f64>| f.map_or("-".into(), |f| digits(f, 3));
    let mut table = Rows::over(all);
    table.name("response", |pair| format!("{}/{}", pair.output, pair.input));
    table.number("frequencies", |pair| pair.frequency.len());
    table.number("coherent", |pair| {
        let count = pair.coherent().count();
        Cell::coloured(count.to_string(), count == 0)
    });
    table.number(&format!("from [{unit}]"), |pair| shown(pair.coherent().next()));
    table.number(&format!("to [{unit}]"), |pair| shown(pair.coherent().next_back()));
    Section::new("pairs", "Pairs").with(table).note(format!(
        "Coherent: at so many frequencies the input explains {COHERENT} or more of what the other inputs leave of the output."
    ))
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

fn figures(pairs: &[Pair<'_>], names: &ResponseNames) -> Vec<Figure> {
    pairs.iter().enumerate().map(|(k, pair)| figure(k, pair, &names.frequency)).collect()
}

fn figure(k: usize, pair: &Pair<'_>, unit: &str) -> Figure {
    let band = |values: &[f64], error: &dyn Fn(f64) -> f64| {
        let edge = |sign: f64| values.iter().zip(pair.error).map(|(v, e)| v + sign * error(*e)).collect();
        Mark::between("one random error", Look::Bound, Shape::Band, edge(-1.0), edge(1.0))
    };
    let line = |name: &str, values: &[f64]| Mark::line(name, Look::Measured, values.to_vec());
    let decibels = band(&pair.magnitude, &|e| 20.0 * (1.0 + e).log10());
    let degrees = band(&pair.phase, &f64::to_degrees);
    // its least and its greatest value, so that the axis is the same for all
    let limit = |v: f64| Mark::line("", Look::Bound, vec![v; pair.frequency.len()]);
    Figure::new(
        format!("response-{}", k + 1),
        format!("{} to {}", pair.input, pair.output),
        format!("frequency [{unit}]"),
        pair.frequency.clone(),
    )
    .in_group("responses")
    .with(Panel::new("magnitude [dB]", 150, vec![decibels, line("magnitude", &pair.magnitude)]))
    .with(Panel::new("phase [deg]", 150, vec![degrees, line("phase", &pair.phase)]))
    .with(Panel::new("coherence", 90, vec![limit(0.0), limit(1.0), line("coherence", pair.coherence)]))
    .logarithmic()
}

#[cfg(test)]
mod tests {
    use super::*;
    use fdm_results::documents::{SpectraDocument, to_text};
    use num_complex::Complex64;

    fn found() -> (FrequencyResponseEstimate, ResponseNames) {
        let omega: Vec<f64> = (1..=40).map(|k| 0.1 * f64::from(k) * TAU).collect();
        let late = |w: &f64| Complex64::from_polar(1.0 / (1.0 + w), -0.4 * w);
        let found = FrequencyResponseEstimate {
            inputs: 1,
            outputs: 1,
            averages: vec![7.0; omega.len()],
            response: omega.iter().map(late).collect(),
            partial_coherence: vec![0.9; omega.len()],
            coherence: vec![0.9; omega.len()],
            error: vec![0.1; omega.len()],
            omega,
        };
        let names = ResponseNames { inputs: vec!["u".into()], outputs: vec!["y".into()], frequency: "Hz".into() };
        (found, names)
    }

    #[test]
    fn the_phase_of_a_delay_goes_on_behind_half_a_turn() {
        let (found, names) = found();
        let pairs = pairs(&found, &names);
        for (f, phase) in pairs[0].frequency.iter().zip(&pairs[0].phase) {
            assert!((phase + 0.4 * 360.0 * f).abs() < 1e-9, "{f}: {phase}");
        }
        let gap = unwrapped([(170.0, 0.9), (f64::NAN, 0.9), (-170.0, 0.9)].into_iter());
        assert_eq!((gap[0], gap[2]), (170.0, 190.0));
        // noise that turns and turns leaves what is coherent behind it where it was
        let noise = (1..40).map(|k| (f64::from(k * 100), 0.1));
        let through = unwrapped([(-80.0, 0.9)].into_iter().chain(noise).chain([(-90.0, 0.9)]));
        assert!(through.iter().all(|v| (v + 80.0).abs() <= 180.0) && through.last() == Some(&-90.0), "{through:?}");
    }

    #[test]
    fn table_json_and_picture_tell_of_every_pair() {
        let (mut found, names) = found();
        found.response[3] = Complex64::new(f64::NAN, f64::NAN);
        found.error[3] = f64::INFINITY;
        let table = response_table(&found, &names);
        assert!(table.starts_with("u to y\n") && table.contains("0.1000") && table.contains("5.73"), "{table}");
        let document = SpectraDocument::of(&found, &names);
        assert_eq!(document.responses[0].re.len(), 40);
        assert!(to_text(&document).unwrap().matches("null").count() == 3, "two parts and an error");
        let svg = response_svg(&found, &names);
        assert!(svg.contains("u to y") && svg.contains("coherence") && svg.matches("<path class=").count() >= 7);
    }

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
