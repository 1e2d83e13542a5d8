//! How a model does on runs that it was not fitted to, beside those that it was.

use super::table::{aligned_right, plain, trimmed};
use fdm_discover::{LackOfFit, Window};
use fdm_estimate::residuals::{Baseline, OutputQuality, TicParts, Whiteness};
use fdm_results::documents::{BandCoverage, OutputDocument, digits, fixed};

/// One row for each output of each run: those that are validated first, then those of the fit. `fitted` is what the
/// fit said about its runs.
pub fn validation_table(validated: &[OutputQuality], fitted: &[OutputDocument]) -> String {
    let header =
        ["", "run", "output", "RMS of residual", "R^2", "TIC", "of it bias", "variance", "covariance", "residuals"];
    let mut table = plain(&header);
    let own = validated.iter().map(|q| {
        let (f, white) = (&q.fit, q.whiteness.as_ref());
        Row {
            role: "validated",
            run: &f.run,
            name: &f.name,
            rms: f.rms,
            r2: f.r2,
            tic: f.tic,
            parts: f.tic_parts,
            white,
        }
    });
    let other = fitted.iter().map(|o| {
        let white = o.white();
        Row { role: "fitted", run: &o.run, name: &o.name, rms: o.rms, r2: o.r2, tic: o.tic, parts: o.tic_parts, white }
    });
    own.chain(other).for_each(|row| {
        table.add_row(cells(&row));
    });
    (3..9).for_each(|column| aligned_right(&mut table, column));
    trimmed(&table)
}

/// The error of each prediction beside what no model at all would miss by.
pub fn baseline_table(baselines: &[Baseline]) -> String {
    let mut table = plain(&["without a model", "run", "RMS of residual", "last value held", "straight line"]);
    for b in baselines {
        let numbers = [b.rms, b.last_value, b.straight_line].map(|v| digits(v, 4));
        table.add_row([b.output.clone(), b.run.clone()].into_iter().chain(numbers));
    }
    (2..5).for_each(|column| aligned_right(&mut table, column));
    trimmed(&table)
}

/// What is told of an output of a run.
struct Row<'a> {
    role: &'static str,
    run: &'a str,
    name: &'a str,
    rms: Option<f64>,
    r2: Option<f64>,
    tic: Option<f64>,
    parts: Option<TicParts>,
    white: Option<&'a Whiteness>,
}

/// The root mean square of the error in each fifth of each run: whether a prediction runs away, and when.
pub fn validation_by_time(lack_of_fit: &[LackOfFit], time: &str) -> String {
    let mut table = plain(&["RMS of residual", "run", "fifth 1", "2", "3", "4", "5", &format!("ends at [{time}]")]);
    for m in lack_of_fit {
        for own in m.windows.chunk_by(|a, b| a.run == b.run) {
            let fifth = |windows: &[Window]| {
                let (share, samples) = windows.iter().fold((0.0, 0.0), |(e, n), w| (e + w.share, n + w.samples));
                if samples > 0.0 { digits(m.rms * f64::sqrt(share / samples), 3) } else { "-".into() }
            };
            let mut row = vec![m.output.clone(), own[0].run.clone()];
            row.extend((0..5).map(|k| fifth(&own[k * own.len() / 5..(k + 1) * own.len() / 5])));
            row.push(own.last().map_or(String::new(), |w| digits(w.to, 4)));
            table.add_row(row);
        }
    }
    (2..8).for_each(|column| aligned_right(&mut table, column));
    trimmed(&table)
}

/// The error by frequency, in octaves: its size, that of noise as strong as in the upper frequencies, and how much of the record is
/// explained there.
pub fn validation_by_frequency(lack_of_fit: &[LackOfFit], time: &str) -> String {
    let per = if time == "s" { "Hz".to_string() } else { format!("1/{time}") };
    let heads = ["output", &format!("from [{per}]"), "to", "RMS of residual", "noise alone", "of the record explained"];
    let mut table = plain(&heads);
    for m in lack_of_fit {
        for band in &m.bands {
            let part = |share: f64| digits(m.rms * share.sqrt(), 3);
            let explained = band.explained.map_or("-".into(), explained);
            let (low, high) = (digits(band.low, 3), digits(band.high, 3));
            table.add_row([m.output.clone(), low, high, part(band.share), part(band.noise), explained]);
        }
    }
    (1..6).for_each(|column| aligned_right(&mut table, column));
    trimmed(&table)
}

/// A part in percent; what is far worse than no model needs no digits.
fn explained(part: f64) -> String {
    if part < -9.99 { "< -999 %".into() } else { format!("{:.0} %", 100.0 * part) }
}

fn cells(row: &Row<'_>) -> Vec<String> {
    let rms = row.rms.filter(|v| v.is_finite()).map_or(String::from("-"), |v| digits(v, 4));
    let part = |of: fn(TicParts) -> f64| fixed(row.parts.map(of), 2);
    vec![
        row.role.into(),
        row.run.into(),
        row.name.into(),
        rms,
        fixed(row.r2, 4),
        fixed(row.tic, 4),
        part(|p| p.bias),
        part(|p| p.variance),
        part(|p| p.covariance),
        colour(row.white),
    ]
}

/// What the portmanteau test says.
fn colour(white: Option<&Whiteness>) -> String {
    match white.map(|w| w.p_value).filter(|p| p.is_finite()) {
        None => "not tested".into(),
        Some(p) if p < SIGNIFICANT => format!("coloured (p {p:.0e})"),
        Some(p) => format!("white (p {p:.2})"),
    }
}

/// Residuals count as coloured below this p-value, as in [`Whiteness::is_white`](fdm_estimate::residuals::Whiteness::is_white).
const SIGNIFICANT: f64 = 0.01;

/// Below this part within its 95 % band a measurement is not predicted as well as the fit says.
const TOO_FEW: f64 = 0.85;

/// Whether measurements lie within their bands, in a sentence; none where there are none.
pub fn band_verdict(bands: &[BandCoverage]) -> Option<String> {
    let known = || bands.iter().filter_map(|b| Some((b, b.within?)));
    let (worst, least) = known().min_by(|a, b| a.1.total_cmp(&b.1))?;
    let most = known().map(|(_, within)| within).fold(least, f64::max);
    let percent = |share: f64| format!("{:.0}", 100.0 * share);
    Some(if least < TOO_FEW {
        let (output, run) = (&worst.output, &worst.run);
        let few = known().filter(|(_, within)| *within < TOO_FEW).count();
        let others = if few > 1 { format!(" ({few} outputs are below {} %)", percent(TOO_FEW)) } else { String::new() };
        format!(
            "Predicted less well than the errors say: of {output} in run {run} {} % lie within the 95 % band of measurements{others}.",
            percent(least)
        )
    } else if percent(least) == percent(most) {
        format!(
            "Predicted as well as the errors say: {} % of what was measured lie within the 95 % bands.",
            percent(least)
        )
    } else {
        format!(
            "Predicted as well as the errors say: {} to {} % of what was measured lie within the 95 % bands.",
            percent(least),
            percent(most)
        )
    })
}

/// How wide the 95 % bands of each output are, and how much of what was measured lies within them.
pub fn band_table(bands: &[BandCoverage]) -> String {
    let heads = ["95 % bands", "run", "of the response", "of a measurement", "measured within"];
    let mut table = plain(&heads);
    for b in bands {
        let half = |v: Option<f64>| v.map_or("-".into(), |v| format!("± {}", digits(v, 3)));
        let within = b.within.map_or("-".into(), |share| format!("{:.1} %", 100.0 * share));
        table.add_row([b.output.clone(), b.run.clone(), half(b.response), half(b.measurement), within]);
    }
    (2..5).for_each(|column| aligned_right(&mut table, column));
    trimmed(&table)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_verdict_on_bands_names_the_worst_output() {
        let band = |output: &str, within: Option<f64>| BandCoverage {
            output: output.into(),
            run: "late".into(),
            response: Some(0.1),
            measurement: Some(0.2),
            within,
        };
        assert_eq!(band_verdict(&[band("y", None)]), None);
        let said = band_verdict(&[band("y", Some(0.93)), band("z", Some(0.97))]).unwrap();
        assert!(said.contains("93 to 97 %"), "{said}");
        let said = band_verdict(&[band("y", Some(0.93)), band("z", Some(0.31)), band("w", Some(0.8))]).unwrap();
        assert!(said.contains("of z in run late 31 %") && said.contains("(2 outputs are below 85 %)"), "{said}");
    }

    #[test]
    fn validated_and_fitted_runs_stand_below_each_other() {
        let row = |run: &str, p: f64| -> OutputDocument {
            let text = format!(
                r#"{{"name": "y", "run": "{run}", "unit": null, "rms": 0.5, "mean": 0.0, "r2": 0.75, "tic": null, "compared": 9,
                "tic_parts": {{"bias": 0.25, "variance": 0.25, "covariance": 0.5}}, "whiteness": {{"interval": 1.0, "autocorrelation": [],
                "bounds": [], "outside": 0, "ljung_box": 1.0, "degrees": 1, "p_value": {p}, "durbin_watson": null, "runs": null}}}}"#
            );
            fdm_results::documents::from_text(&text).unwrap()
        };
        let text = validation_table(&[], &[row("a", 0.5), row("b", 1e-9)]);
        let lines: Vec<&str> = text.lines().map(str::trim).collect();
        assert!(lines[1].starts_with("fitted  a    y") && lines[1].ends_with("white (p 0.50)"), "{text}");
        assert!(lines[2].contains("0.7500") && lines[2].ends_with("coloured (p 1e-9)"), "{text}");
        assert_eq!(validation_table(&[], &[]).lines().count(), 1);
    }
}
