//! Frequency responses that records show: a table, and a picture of magnitude, phase and coherence.

use super::table::{aligned_right, plain, trimmed};
use crate::page::Paper;
use crate::page::drawing::stacked;
use crate::page::figure::{Figure, Look, Mark, Panel, Shape};
use fdm_results::documents::{ResponseNames, digits};
use fdm_system::spectrum::FrequencyResponseEstimate;
use std::f64::consts::TAU;

/// One pair of channels as a reader wants it.
pub(crate) struct Pair<'a> {
    pub(crate) input: &'a str,
    pub(crate) output: &'a str,
    pub(crate) frequency: Vec<f64>,
    /// In decibels.
    magnitude: Vec<f64>,
    /// In degrees, without jumps.
    phase: Vec<f64>,
    /// With the other inputs taken out.
    pub(crate) coherence: &'a [f64],
    /// Of all inputs.
    multiple: &'a [f64],
    /// Random error of the magnitude as a part of it.
    error: &'a [f64],
}

pub(crate) fn pairs<'a>(found: &'a FrequencyResponseEstimate, names: &'a ResponseNames) -> Vec<Pair<'a>> {
    let count = found.omega.len();
    let one = |o: usize, i: usize| {
        let at = found.pair(o, i);
        let response = &found.response[at.clone()];
        Pair {
            input: &names.inputs[i],
            output: &names.outputs[o],
            frequency: found.omega.iter().map(|w| w / TAU).collect(),
            magnitude: response.iter().map(|h| 20.0 * h.norm().log10()).collect(),
            phase: unwrapped(response.iter().map(|h| h.arg().to_degrees())),
            coherence: &found.partial_coherence[at.clone()],
            multiple: &found.coherence[o * count..(o + 1) * count],
            error: &found.error[at],
        }
    };
    (0..found.outputs).flat_map(|o| (0..found.inputs).map(move |i| (o, i))).map(|(o, i)| one(o, i)).collect()
}

/// Angles in degrees, each within half a turn of the last that is a number.
pub(crate) fn unwrapped(angles: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut last: f64 = 0.0;
    let continued = |angle: f64| {
        let near = angle - 360.0 * ((angle - last) / 360.0).round();
        last = if near.is_finite() { near } else { last };
        near
    };
    angles.map(continued).collect()
}

/// A table for every pair of an input and an output.
pub fn response_table(found: &FrequencyResponseEstimate, names: &ResponseNames) -> String {
    let one = |pair: Pair<'_>| {
        let frequency = format!("frequency [{}]", names.frequency);
        let header =
            [&frequency, "magnitude [dB]", "phase [deg]", "coherence", "multiple", "random error", "phase error [deg]"];
        let mut table = plain(&header);
        for k in 0..pair.frequency.len() {
            let error = |factor: f64| digits(factor * pair.error[k], 3);
            table.add_row([
                digits(pair.frequency[k], 4),
                format!("{:.2}", pair.magnitude[k]),
                format!("{:.1}", pair.phase[k]),
                format!("{:.3}", pair.coherence[k]),
                format!("{:.3}", pair.multiple[k]),
                error(1.0),
                error(1f64.to_degrees()),
            ]);
        }
        (0..header.len()).for_each(|column| aligned_right(&mut table, column));
        format!("{} to {}\n{}", pair.input, pair.output, trimmed(&table))
    };
    pairs(found, names).into_iter().map(one).collect::<Vec<_>>().join("\n")
}

/// Magnitude and phase with the band of one random error, and coherence, over the logarithm of frequency: a figure for every pair.
pub fn response_svg(found: &FrequencyResponseEstimate, names: &ResponseNames) -> String {
    let figures: Vec<Figure> =
        pairs(found, names).iter().enumerate().map(|(k, pair)| figure(k, pair, &names.frequency)).collect();
    stacked(&figures, Paper::Light)
}

pub(crate) fn figure(k: usize, pair: &Pair<'_>, unit: &str) -> Figure {
    let band = |values: &[f64], error: &dyn Fn(f64) -> f64| {
        let edge = |sign: f64| values.iter().zip(pair.error).map(|(v, e)| v + sign * error(*e)).collect();
        Mark::between("one random error", Look::Bound, Shape::Band, edge(-1.0), edge(1.0))
    };
    let line = |name: &str, values: &[f64]| Mark::line(name, Look::Measured, values.to_vec());
    let decibels = band(&pair.magnitude, &|e| 20.0 * (1.0 + e).log10());
    let degrees = band(&pair.phase, &f64::to_degrees);
    // its least and its greatest value, so that the axis is the same for all
    let limit = |v: f64| Mark::line("", Look::Bound, vec![v; pair.frequency.len()]);
    let panel =
        |label: &str, height: u32, marks: Vec<Mark>| Panel { label: label.into(), height, logarithmic: false, marks };
    Figure {
        id: format!("response-{}", k + 1),
        group: "responses".into(),
        caption: format!("{} to {}", pair.input, pair.output),
        label: format!("frequency [{unit}]"),
        logarithmic: true,
        at: pair.frequency.clone(),
        panels: vec![
            panel("magnitude [dB]", 150, vec![decibels, line("magnitude", &pair.magnitude)]),
            panel("phase [deg]", 150, vec![degrees, line("phase", &pair.phase)]),
            panel("coherence", 90, vec![limit(0.0), limit(1.0), line("coherence", pair.coherence)]),
        ],
        names: Vec::new(),
        half: false,
        samples: None,
    }
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
        let gap = unwrapped([170.0, f64::NAN, -170.0].into_iter());
        assert_eq!((gap[0], gap[2]), (170.0, 190.0));
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
}
