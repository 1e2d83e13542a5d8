//! Bars over a logarithmic scale, as in figure 2 of Marchand and Fu (1985).

use std::fmt::Write;

const HEIGHT: f64 = 240.0;
const TOP: f64 = 46.0;
const PANEL: f64 = 290.0;

/// Panels side by side, each with a title and named bars, in percent; decades are powers of ten from the lowest to the highest.
pub(crate) fn bars(title: &str, panels: &[(&str, Vec<(&str, f64)>)], decades: (i32, i32)) -> String {
    let (width, below) = (40.0 + PANEL * panels.len() as f64, TOP + HEIGHT + 36.0);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {below}\" font-family=\"sans-serif\" font-size=\"12\">\n\
         <rect width=\"{width}\" height=\"{below}\" fill=\"white\"/>\n<text x=\"20\" y=\"18\" font-size=\"14\">{title}</text>\n"
    );
    let (low, high) = decades;
    let level = |percent: f64| {
        let part = (percent.log10() - f64::from(low)) / f64::from(high - low);
        TOP + HEIGHT * (1.0 - part.clamp(0.0, 1.0))
    };
    for (k, (name, values)) in panels.iter().enumerate() {
        let left = 60.0 + PANEL * k as f64;
        let right = left + PANEL - 60.0;
        let _ = writeln!(svg, "<text x=\"{left}\" y=\"{}\">{name}</text>", TOP - 8.0);
        for decade in low..=high {
            let y = level(10f64.powi(decade));
            let label = 10f64.powi(decade);
            let _ = writeln!(
                svg,
                "<path d=\"M{left} {y:.1}H{right}\" stroke=\"#bbb\"/><text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{label}</text>",
                left - 6.0,
                y + 4.0
            );
        }
        let step = (right - left) / values.len() as f64;
        for (b, (label, value)) in values.iter().enumerate() {
            let (x, y) = (left + step * (b as f64 + 0.2), level(*value));
            let (middle, wide) = (x + 0.3 * step, 0.6 * step);
            let _ = writeln!(
                svg,
                "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{wide:.1}\" height=\"{:.1}\" fill=\"#47a\"/>\
                 <text x=\"{middle:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{value:.2} %</text>\
                 <text x=\"{middle:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{label}</text>",
                TOP + HEIGHT - y,
                y - 4.0,
                TOP + HEIGHT + 18.0
            );
        }
    }
    svg.push_str("</svg>\n");
    svg
}
