//! Time histories as a picture: measured beside modelled, the residual below on the same time axis.

use plotters::coord::Shift;
use plotters::prelude::*;
use std::ops::Range;

/// One output of one run.
#[derive(Debug, Clone)]
pub struct TimeHistory<'a> {
    /// What stands above the panel.
    pub title: String,
    /// Label of the time axis.
    pub time_label: String,
    /// Label of the value axis.
    pub value_label: String,
    /// Time of each sample.
    pub time: &'a [f64],
    /// Measured values; NaN where there is none.
    pub measured: Vec<f64>,
    /// Modelled values.
    pub modelled: Vec<f64>,
}

/// The picture could not be drawn.
#[derive(Debug, thiserror::Error)]
#[error("the picture cannot be drawn: {0}")]
pub struct PlotError(String);

impl PlotError {
    /// What the drawing library says.
    pub(super) fn refused(e: impl std::fmt::Display) -> Self {
        Self(e.to_string())
    }
}

/// Points drawn per line; longer records are reduced to the extremes of equal parts, so that no peak is lost.
const MOST_POINTS: usize = 2000;
const PANEL: (u32, u32) = (920, 380);

const MEASURED: RGBColor = RGBColor(0xa8, 0xa8, 0xa8);
const MODELLED: RGBColor = RGBColor(0xc4, 0x3b, 0x1d);
const RESIDUAL: RGBColor = RGBColor(0x1d, 0x5f, 0xa8);

/// The panels below each other as SVG text; the same input gives the same text.
///
/// # Errors
/// [`PlotError`] when the drawing library refuses.
pub fn svg(histories: &[TimeHistory<'_>]) -> Result<String, PlotError> {
    let mut text = String::new();
    {
        let size = (PANEL.0, PANEL.1 * (histories.len().max(1) as u32));
        let area = SVGBackend::with_string(&mut text, size).into_drawing_area();
        area.fill(&WHITE).map_err(PlotError::refused)?;
        for (panel, history) in area.split_evenly((histories.len().max(1), 1)).iter().zip(histories) {
            draw(panel, history)?;
        }
        area.present().map_err(PlotError::refused)?;
    }
    Ok(text)
}

fn draw(panel: &DrawingArea<SVGBackend<'_>, Shift>, history: &TimeHistory<'_>) -> Result<(), PlotError> {
    let (upper, lower) = panel.split_vertically((65).percent_height());
    let residual: Vec<f64> = history.measured.iter().zip(&history.modelled).map(|(z, y)| z - y).collect();
    let values = range(history.measured.iter().chain(&history.modelled));
    let label = &history.value_label;
    let lines = [("measured", MEASURED, 3, &history.measured), ("model", MODELLED, 1, &history.modelled)];
    chart(&upper, Some(&history.title), history, values, label, &lines)?;
    let lines = [("measured - model", RESIDUAL, 1, &residual)];
    chart(&lower, None, history, range(residual.iter()), "measured - model", &lines)
}

fn chart(
    area: &DrawingArea<SVGBackend<'_>, Shift>,
    title: Option<&str>,
    history: &TimeHistory<'_>,
    values: Range<f64>,
    label: &str,
    lines: &[(&str, RGBColor, u32, &Vec<f64>)],
) -> Result<(), PlotError> {
    let mut builder = ChartBuilder::on(area);
    builder.margin(8).set_label_area_size(LabelAreaPosition::Left, 72);
    builder.set_label_area_size(LabelAreaPosition::Bottom, if title.is_none() { 36 } else { 20 });
    if let Some(title) = title {
        builder.caption(title, ("sans-serif", 16));
    }
    let smallest = 1e-9 * (values.end - values.start);
    let mut chart = builder.build_cartesian_2d(range(history.time.iter()), values).map_err(PlotError::refused)?;
    let mut mesh = chart.configure_mesh();
    mesh.light_line_style(WHITE).y_desc(label).y_labels(if title.is_none() { 4 } else { 6 });
    let label_of = |v: &f64| if v.abs() < smallest { short(0.0) } else { short(*v) };
    mesh.y_label_formatter(&label_of).x_label_formatter(&|v| short(*v));
    if title.is_none() {
        mesh.x_desc(history.time_label.as_str());
    }
    mesh.draw().map_err(PlotError::refused)?;
    for (name, colour, width, values) in lines {
        let mut series = Vec::new();
        for piece in pieces(history.time, values) {
            series.push(LineSeries::new(piece, colour.stroke_width(*width)));
        }
        for (k, line) in series.into_iter().enumerate() {
            let drawn = chart.draw_series(line).map_err(PlotError::refused)?;
            if k == 0 && lines.len() > 1 {
                let (colour, width) = (*colour, *width);
                drawn
                    .label(*name)
                    .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(width + 1)));
            }
        }
    }
    if lines.len() == 1 {
        return Ok(());
    }
    let mut legend = chart.configure_series_labels();
    legend.background_style(WHITE.mix(0.8)).position(SeriesLabelPosition::UpperRight).draw().map_err(PlotError::refused)
}

/// Lines without their gaps, each reduced to what can be seen.
fn pieces(time: &[f64], values: &[f64]) -> Vec<Vec<(f64, f64)>> {
    let mut found = Vec::new();
    let mut piece = Vec::new();
    for (t, v) in time.iter().zip(values) {
        if v.is_finite() {
            piece.push((*t, *v));
        } else if !piece.is_empty() {
            found.push(std::mem::take(&mut piece));
        }
    }
    found.push(piece);
    let part = (values.len() / (MOST_POINTS / 2)).max(1);
    found.into_iter().filter(|p| !p.is_empty()).map(|p| extremes(&p, part)).collect()
}

/// The least and the greatest of every `part` neighbouring points, in the order of time.
fn extremes(points: &[(f64, f64)], part: usize) -> Vec<(f64, f64)> {
    if part < 3 {
        return points.to_vec();
    }
    let mut kept = Vec::new();
    for chunk in points.chunks(part) {
        let by_value = |a: &&(f64, f64), b: &&(f64, f64)| a.1.total_cmp(&b.1);
        let (Some(low), Some(high)) = (chunk.iter().min_by(by_value), chunk.iter().max_by(by_value)) else { continue };
        kept.extend(if low.0 <= high.0 { [*low, *high] } else { [*high, *low] });
    }
    kept
}

/// From the least to the greatest finite value, never empty.
fn range<'a>(values: impl Iterator<Item = &'a f64>) -> Range<f64> {
    let finite = values.filter(|v| v.is_finite());
    let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
    if low > high {
        return 0.0..1.0;
    }
    let margin = if high > low { 0.0 } else { high.abs().max(1.0) * 0.5 };
    low - margin..high + margin
}

/// Four significant digits, without a tail of zeros.
fn short(v: f64) -> String {
    if v == 0.0 {
        return "0".into();
    }
    let rounded: f64 = format!("{v:.3e}").parse().unwrap_or(v);
    if (1e-3..1e5).contains(&rounded.abs()) { format!("{rounded}") } else { format!("{rounded:e}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn history(time: &[f64], measured: Vec<f64>) -> TimeHistory<'_> {
        let modelled = time.iter().map(|t| t.sin()).collect();
        let label = |s: &str| String::from(s);
        TimeHistory {
            title: label("run"),
            time_label: label("t [s]"),
            value_label: label("y"),
            time,
            measured,
            modelled,
        }
    }

    #[test]
    fn peaks_survive_the_reduction_and_gaps_split_lines() {
        let time: Vec<f64> = (0..100_000).map(f64::from).collect();
        let mut values = vec![0.0; time.len()];
        values[54_321] = 9.0;
        values[70_000] = f64::NAN;
        let pieces = pieces(&time, &values);
        assert_eq!(pieces.len(), 2);
        assert!(pieces[0].iter().any(|(t, v)| *t == 54_321.0 && *v == 9.0));
        assert!(pieces.iter().map(Vec::len).sum::<usize>() <= MOST_POINTS + 4);
    }

    #[test]
    fn draws_measured_model_and_residual() {
        let time: Vec<f64> = (0..50).map(|k| 0.1 * f64::from(k)).collect();
        let measured = time.iter().map(|t| t.sin() + 0.01).collect();
        let text = svg(&[history(&time, measured)]).unwrap();
        assert!(text.starts_with("<svg") && text.contains("measured - model") && text.contains("t [s]"));
        assert!(text.matches("<polyline").count() >= 3);
    }

    #[test]
    fn nothing_measured_is_still_a_picture() {
        assert!(svg(&[history(&[0.0, 1.0], vec![f64::NAN, f64::NAN])]).is_ok());
        assert!(svg(&[]).is_ok());
    }
}
