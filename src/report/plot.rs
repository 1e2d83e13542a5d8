//! Time histories as a picture: measured beside modelled, the residual below on the same time axis.

use crate::page::Paper;
use crate::page::drawing::stacked;
use crate::page::figure::{Figure, Look, Mark, Panel};

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

/// The histories below each other as SVG text; the same input gives the same text.
pub fn svg(histories: &[TimeHistory<'_>]) -> String {
    let figures: Vec<Figure> = histories.iter().enumerate().map(|(k, history)| figure(k, history)).collect();
    stacked(&figures, Paper::Light)
}

fn figure(k: usize, history: &TimeHistory<'_>) -> Figure {
    let residual = history.measured.iter().zip(&history.modelled).map(|(z, y)| z - y).collect();
    let lines = vec![
        Mark::line("measured", Look::Measured, history.measured.clone()),
        Mark::line("model", Look::Model, history.modelled.clone()),
    ];
    let rest = vec![Mark::line("measured - model", Look::Residual, residual)];
    Figure::new(format!("history-{}", k + 1), history.title.clone(), history.time_label.clone(), history.time.to_vec())
        .in_group("histories")
        .with(Panel::new(&history.value_label, 220, lines))
        .with(Panel::new("measured - model", 110, rest))
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
    fn draws_measured_model_and_residual() {
        let time: Vec<f64> = (0..50).map(|k| 0.1 * f64::from(k)).collect();
        let measured = time.iter().map(|t| t.sin() + 0.01).collect();
        let text = svg(&[history(&time, measured)]);
        assert!(text.starts_with("<svg") && text.contains("measured - model") && text.contains("t [s]"));
        assert_eq!(text.matches("<path class=").count(), 3);
    }

    #[test]
    fn nothing_measured_is_still_a_picture() {
        assert!(svg(&[history(&[0.0, 1.0], vec![f64::NAN, f64::NAN])]).ends_with("</svg>\n"));
        assert!(svg(&[]).ends_with("</svg>\n"));
    }
}
