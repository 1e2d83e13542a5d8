//! Frequency responses that records show: a table, JSON, and a picture of magnitude, phase and coherence.

use super::plot::PlotError;
use super::table::{aligned_right, digits, plain, trimmed};
use crate::spectrum::FrequencyResponseEstimate;
use plotters::coord::Shift;
use plotters::prelude::*;
use serde_json::{Value, json};
use std::f64::consts::TAU;

/// Names of the channels and of the unit of frequency.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ResponseNames {
    /// Inputs (m).
    pub inputs: Vec<String>,
    /// Outputs (q).
    pub outputs: Vec<String>,
    /// `Hz`, or cycles per another unit of time.
    pub frequency: String,
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
            phase: unwrapped(response.iter().map(|h| h.arg().to_degrees())),
            coherence: &found.partial_coherence[at.clone()],
            multiple: &found.coherence[o * count..(o + 1) * count],
            error: &found.error[at],
        }
    };
    (0..found.outputs).flat_map(|o| (0..found.inputs).map(move |i| (o, i))).map(|(o, i)| one(o, i)).collect()
}

/// Angles in degrees, each within half a turn of the last that is a number.
fn unwrapped(angles: impl Iterator<Item = f64>) -> Vec<f64> {
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

/// The same for other programs; what is not known is null.
pub fn response_json(found: &FrequencyResponseEstimate, names: &ResponseNames) -> Value {
    let of = |o: usize, i: usize| {
        let at = found.pair(o, i);
        let response = &found.response[at.clone()];
        json!({
            "input": names.inputs[i],
            "output": names.outputs[o],
            "re": response.iter().map(|h| h.re).collect::<Vec<_>>(),
            "im": response.iter().map(|h| h.im).collect::<Vec<_>>(),
            "coherence": &found.partial_coherence[at.clone()],
            "random_error": &found.error[at],
        })
    };
    let count = found.omega.len();
    let multiple = names.outputs.iter().zip(found.coherence.chunks(count.max(1)));
    json!({
        "frequency": found.omega.iter().map(|w| w / TAU).collect::<Vec<_>>(),
        "unit": names.frequency,
        "averages": found.averages,
        "responses": (0..found.outputs).flat_map(|o| (0..found.inputs).map(move |i| (o, i))).map(|(o, i)| of(o, i)).collect::<Vec<_>>(),
        "multiple_coherence": multiple.map(|(name, c)| json!({ "output": name, "coherence": c })).collect::<Vec<_>>(),
    })
}

const PANEL: (u32, u32) = (720, 520);
const LINE: RGBColor = RGBColor(0x1d, 0x5f, 0xa8);
const ERROR: RGBColor = RGBColor(0xa8, 0xa8, 0xa8);

/// Magnitude and phase with the band of one random error, and coherence, over the logarithm of frequency: one block for every pair.
///
/// # Errors
/// [`PlotError`] when the drawing library refuses.
pub fn response_svg(found: &FrequencyResponseEstimate, names: &ResponseNames) -> Result<String, PlotError> {
    let pairs = pairs(found, names);
    let mut text = String::new();
    {
        let blocks = pairs.len().max(1);
        let area = SVGBackend::with_string(&mut text, (PANEL.0, PANEL.1 * blocks as u32)).into_drawing_area();
        area.fill(&WHITE).map_err(PlotError::refused)?;
        for (block, pair) in area.split_evenly((blocks, 1)).iter().zip(&pairs) {
            draw(block, pair, &names.frequency)?;
        }
        area.present().map_err(PlotError::refused)?;
    }
    Ok(text)
}

fn draw(block: &DrawingArea<SVGBackend<'_>, Shift>, pair: &Pair<'_>, unit: &str) -> Result<(), PlotError> {
    let parts = block.split_evenly((3, 1));
    let title = format!("{} to {}", pair.input, pair.output);
    let decibels: Vec<f64> = pair.error.iter().map(|e| 20.0 * (1.0 + e).log10()).collect();
    let degrees: Vec<f64> = pair.error.iter().map(|e| e.to_degrees()).collect();
    chart(&parts[0], (Some(&title), None), "magnitude [dB]", &pair.frequency, &pair.magnitude, Some(&decibels))?;
    chart(&parts[1], (None, None), "phase [deg]", &pair.frequency, &pair.phase, Some(&degrees))?;
    let below = format!("frequency [{unit}]");
    chart(&parts[2], (None, Some(&below)), "coherence", &pair.frequency, pair.coherence, None)
}

/// One curve; `error` is drawn as lines on both sides. Without it the axis is that of a part of one.
fn chart(
    area: &DrawingArea<SVGBackend<'_>, Shift>,
    (above, below): (Option<&str>, Option<&str>),
    label: &str,
    frequency: &[f64],
    values: &[f64],
    error: Option<&[f64]>,
) -> Result<(), PlotError> {
    let (Some(first), Some(last)) = (frequency.first(), frequency.last()) else { return Ok(()) };
    let values_range = if error.is_none() { 0.0..1.0 } else { range(values) };
    let mut builder = ChartBuilder::on(area);
    builder.margin(8).set_label_area_size(LabelAreaPosition::Left, 72);
    builder.set_label_area_size(LabelAreaPosition::Bottom, if below.is_some() { 36 } else { 20 });
    if let Some(above) = above {
        builder.caption(above, ("sans-serif", 16));
    }
    let ends = (*first..last.max(first * 1.01)).log_scale();
    let mut chart = builder.build_cartesian_2d(ends, values_range.clone()).map_err(PlotError::refused)?;
    let mut mesh = chart.configure_mesh();
    mesh.light_line_style(WHITE).y_desc(label).y_labels(5);
    if let Some(below) = below {
        mesh.x_desc(below);
    }
    mesh.draw().map_err(PlotError::refused)?;
    let limited = |v: f64| v.clamp(values_range.start, values_range.end);
    let mut line = |shift: f64, colour: RGBColor, width: u32| {
        let points = (0..frequency.len()).map(|k| {
            let by = error.map_or(0.0, |e| shift * e[k].min(f64::MAX));
            (frequency[k], values[k] + by)
        });
        let points: Vec<(f64, f64)> = points.filter(|(_, v)| v.is_finite()).map(|(f, v)| (f, limited(v))).collect();
        chart.draw_series(LineSeries::new(points, colour.stroke_width(width))).map(|_| ()).map_err(PlotError::refused)
    };
    if error.is_some() {
        line(-1.0, ERROR, 1)?;
        line(1.0, ERROR, 1)?;
    }
    line(0.0, LINE, 2)
}

/// From the least to the greatest finite value with a margin, never empty.
fn range(values: &[f64]) -> std::ops::Range<f64> {
    let finite = values.iter().filter(|v| v.is_finite());
    let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
    if low > high {
        return 0.0..1.0;
    }
    let margin = (0.1 * (high - low)).max(1.0);
    low - margin..high + margin
}

#[cfg(test)]
mod tests {
    use super::*;
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
        let json = response_json(&found, &names);
        assert_eq!(json["responses"][0]["re"].as_array().map(Vec::len), Some(40));
        assert!(json["responses"][0]["re"][3].is_null() && json["responses"][0]["random_error"][3].is_null());
        let svg = response_svg(&found, &names).unwrap();
        assert!(svg.contains("u to y") && svg.contains("coherence") && svg.matches("<polyline").count() >= 7);
    }
}
