//! Profiles of the likelihood: a table, the same for programs, and a picture.

use super::plot::PlotError;
use super::table::{aligned_right, digits, plain, trimmed};
use crate::study::{End, Profile};
use plotters::prelude::*;
use serde_json::{Value, json};

/// One row for each parameter: the interval by the cost beside that by the error.
pub fn profile_table(profiles: &[Profile]) -> String {
    let header = ["parameter", "value", "error", "95 % by error", "95 % by cost", "below", "above", "refits", "unit"];
    let mut table = plain(&header);
    [1, 2, 5, 6, 7].into_iter().for_each(|k| aligned_right(&mut table, k));
    for p in profiles {
        let half = p.reach();
        let settled = ((p.value / p.error).abs().log10().floor() as i64 + 3).clamp(3, 12) as usize;
        let shown = |v: f64| digits(v, settled);
        let [low, high] = p.ends;
        table.add_row([
            p.name.clone(),
            shown(p.value),
            digits(p.error, 3),
            format!("{} to {}", shown(p.value - half), shown(p.value + half)),
            format!("{} to {}", told(low, settled), told(high, settled)),
            format!("{:.2}", (p.value - low.value()) / half),
            format!("{:.2}", (high.value() - p.value) / half),
            p.refits.to_string(),
            p.unit.clone().unwrap_or_default(),
        ]);
    }
    let mut text = trimmed(&table);
    text.push_str("\nbelow, above: how far the interval by the cost reaches, over that by the error\n");
    for p in profiles {
        for (end, side) in p.ends.iter().zip(["left", "right"]) {
            text.push_str(&remark(p, *end, side));
        }
        if p.factor > 1.05 {
            let (name, factor) = (&p.name, p.factor);
            text.push_str(&format!(
                "{name}: the residuals are coloured; the cost may rise {:.1} times as far as under white noise\n",
                factor * factor
            ));
        }
    }
    text
}

fn told(end: End, settled: usize) -> String {
    let value = digits(end.value(), settled);
    match end {
        End::At(_) => value,
        End::Bound(_) => format!("{value} (bound)"),
        End::Open(_) => "open".into(),
        End::Astray(_) | End::Interrupted(_) => format!("{value} or further"),
    }
}

fn remark(p: &Profile, end: End, side: &str) -> String {
    let (name, value) = (&p.name, digits(end.value(), 4));
    match end {
        End::At(_) => String::new(),
        End::Open(_) => format!("{name} is open to the {side}: the cost has not risen enough at {value}\n"),
        End::Bound(_) => format!("{name}: its bound {value} stands inside the interval\n"),
        End::Astray(_) => format!("{name}: no minimum is found to the {side} of {value}\n"),
        End::Interrupted(_) => format!("{name}: interrupted at {value}, to the {side}\n"),
    }
}

/// The same for programs, with every point.
pub fn profile_json(profiles: &[Profile]) -> Value {
    let one = |p: &Profile| {
        let mut document = json!(p);
        document["by_error"] = json!([p.value - p.reach(), p.value + p.reach()]);
        document
    };
    profiles.iter().map(one).collect::<Vec<Value>>().into()
}

const PANEL: (u32, u32) = (920, 300);
const COST: RGBColor = RGBColor(0xc4, 0x3b, 0x1d);
const PARABOLA: RGBColor = RGBColor(0xa8, 0xa8, 0xa8);
const LIMIT: RGBColor = RGBColor(0x1d, 0x5f, 0xa8);

/// A panel for each parameter: the cost beside the parabola of the printed error, and what it may rise.
///
/// # Errors
/// [`PlotError`] when the drawing library refuses.
pub fn profile_svg(profiles: &[Profile]) -> Result<String, PlotError> {
    let mut text = String::new();
    {
        let size = (PANEL.0, PANEL.1 * (profiles.len().max(1) as u32));
        let area = SVGBackend::with_string(&mut text, size).into_drawing_area();
        area.fill(&WHITE).map_err(PlotError::refused)?;
        for (panel, profile) in area.split_evenly((profiles.len().max(1), 1)).iter().zip(profiles) {
            let values = profile.points.iter().map(|p| p.value);
            let (low, high) = values.fold((profile.value, profile.value), |(a, b), v| (a.min(v), b.max(v)));
            let top = 1.6 * profile.rise;
            let mut builder = ChartBuilder::on(panel);
            builder.margin(8).set_label_area_size(LabelAreaPosition::Left, 60);
            builder.set_label_area_size(LabelAreaPosition::Bottom, 36);
            let margin = 0.02 * (high - low).max(f64::MIN_POSITIVE);
            let mut chart =
                builder.build_cartesian_2d(low - margin..high + margin, 0.0..top).map_err(PlotError::refused)?;
            let unit = profile.unit.as_ref().map_or(String::new(), |u| format!(" [{u}]"));
            let mut mesh = chart.configure_mesh();
            mesh.light_line_style(WHITE).x_desc(format!("{}{unit}", profile.name)).y_desc("rise of the cost");
            mesh.draw().map_err(PlotError::refused)?;
            let parabola = (0..=100).map(|k| {
                let value = low + (high - low) * f64::from(k) / 100.0;
                (value, profile.rise * ((value - profile.value) / profile.reach()).powi(2))
            });
            let shown = |points: Vec<(f64, f64)>| points.into_iter().filter(|p| p.1 <= top).collect::<Vec<_>>();
            let cost = profile.points.iter().map(|p| (p.value, p.rise.max(0.0))).collect();
            for (points, colour, width) in [
                (shown(parabola.collect()), PARABOLA, 2),
                (vec![(low, profile.rise), (high, profile.rise)], LIMIT, 1),
                (shown(cost), COST, 2),
            ] {
                chart.draw_series(LineSeries::new(points, colour.stroke_width(width))).map_err(PlotError::refused)?;
            }
        }
        area.present().map_err(PlotError::refused)?;
    }
    Ok(text)
}
