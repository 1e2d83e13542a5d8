//! Time histories for a terminal: dots of braille, measured beside modelled, in 80 columns. And how a cost fell, in one line.

use super::plot::TimeHistory;
use textplots::{Chart, Plot, Shape};

/// Dots: two to a column, four to a row.
const WIDTH: u32 = 128;
const HEIGHT: u32 = 40;
/// Iterations that a line shows.
const LATEST: usize = 24;
const BARS: [char; 8] = ['▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];

/// The measured values as dots, the model as a line; one chart below the other.
pub fn overlays(histories: &[TimeHistory<'_>]) -> String {
    histories.iter().map(overlay).collect()
}

fn overlay(history: &TimeHistory<'_>) -> String {
    let points = |values: &[f64]| -> Vec<(f32, f32)> {
        let finite = history.time.iter().zip(values).filter(|(_, v)| v.is_finite());
        finite.map(|(t, v)| (*t as f32, *v as f32)).collect()
    };
    let (measured, modelled) = (points(&history.measured), points(&history.modelled));
    let range = |of: fn(&(f32, f32)) -> f32| {
        let values = measured.iter().chain(&modelled).map(of);
        values.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)))
    };
    let ((begin, end), (low, high)) = (range(|p| p.0), range(|p| p.1));
    let title = format!("{}\n", history.title);
    if !(end > begin && high >= low) {
        return title + "nothing to show\n";
    }
    // a constant stands in the middle
    let room = if high > low { 0.0 } else { high.abs().max(1.0) };
    let (line, dots) = (Shape::Lines(&modelled), Shape::Points(&measured));
    let mut chart = Chart::new_with_y_range(WIDTH, HEIGHT, begin, end, low - room, high + room);
    let chart = chart.lineplot(&line).lineplot(&dots);
    chart.figures();
    let shown: Vec<String> = chart.to_string().lines().map(|l| format!("{}\n", l.trim_end())).collect();
    format!("{title}{}", shown.concat())
}

/// The latest costs as bars, on a logarithmic scale of what is above the least.
pub fn sparkline(costs: &[f64]) -> String {
    let least = costs.iter().copied().filter(|c| c.is_finite()).fold(f64::INFINITY, f64::min);
    let above: Vec<f64> = costs.iter().map(|c| c - least).collect();
    let small = above.iter().copied().filter(|a| *a > 0.0).fold(f64::INFINITY, f64::min);
    let large = above.iter().copied().filter(|a| a.is_finite()).fold(0.0, f64::max);
    let span = (large / small).ln().max(1e-9);
    let bar = |a: &f64| match *a {
        a if !a.is_finite() => BARS[7],
        a if a <= 0.0 => BARS[0],
        a => BARS[1 + ((a / small).ln() / span * 6.0).round().clamp(0.0, 6.0) as usize],
    };
    above[above.len().saturating_sub(LATEST)..].iter().map(bar).collect()
}

/// Counts as bars over the largest.
pub(super) fn bars(counts: &[usize]) -> String {
    let largest = counts.iter().copied().max().unwrap_or(0).max(1);
    counts.iter().map(|n| BARS[(n * 7).div_ceil(largest)]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn history(time: &[f64], measured: Vec<f64>, modelled: Vec<f64>) -> TimeHistory<'_> {
        let label = String::new;
        TimeHistory { title: "roll".into(), time_label: label(), value_label: label(), time, measured, modelled }
    }

    #[test]
    fn charts_fit_eighty_columns_and_gaps_are_left_out() {
        let time: Vec<f64> = (0..500).map(|k| 0.1 * f64::from(k)).collect();
        let wave: Vec<f64> = time.iter().map(|t| -1234.5 * t.sin()).collect();
        let mut gappy = wave.clone();
        gappy[100..200].fill(f64::NAN);
        let text = overlays(&[history(&time, gappy, wave)]);
        assert_eq!(text.lines().count(), 13, "{text}");
        assert!(text.lines().all(|l| l.chars().count() <= 80), "{text}");
        assert!(text.contains("1234.5") && text.contains("49.9"), "{text}");
        let none = overlays(&[history(&time, vec![f64::NAN; 500], vec![f64::NAN; 500])]);
        assert!(none.contains("nothing to show"), "{none}");
        assert!(!overlays(&[history(&time, vec![3.0; 500], vec![3.0; 500])]).contains("nothing"));
    }

    #[test]
    fn costs_fall_from_left_to_right() {
        assert_eq!(sparkline(&[1e4, 1e2, 1.0, 0.0]), "█▅▂▁");
        assert_eq!(
            (sparkline(&[]), sparkline(&[5.0]), sparkline(&[f64::NAN, 1.0])),
            ("".into(), "▁".into(), "█▁".into())
        );
        assert_eq!(sparkline(&[1.0; 100]).chars().count(), LATEST);
    }
}
