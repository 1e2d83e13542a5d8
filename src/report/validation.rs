//! How a model does on runs that it was not fitted to, beside those that it was: its errors, when and at which frequencies, and its bands.

use super::section::{Part, Rows, Section};
use crate::text;
use fdm_estimate::residuals::{Baseline, OutputQuality, TicParts, Whiteness};
use fdm_infer::{Band, LackOfFit, Window};
use fdm_results::documents::{BandCoverage, OutputDocument, Validation, digits, fixed, p_value};

/// Below this part within its 95 % band a measurement is not predicted as well as the fit says.
const TOO_FEW: f64 = 0.85;
/// Parts of a run whose errors stand beside each other.
const PARTS: usize = 5;

/// Tables of a validation; `time` is the unit of time.
pub fn validation_text(found: &Validation, baselines: &[Baseline], time: &str) -> String {
    text::sections(&[section(found, Some(baselines), time)])
}

/// What is said of a validation, with what no model at all would miss by where that is at hand.
pub(crate) fn section(found: &Validation, baselines: Option<&[Baseline]>, time: &str) -> Section {
    let bands = (!found.bands.is_empty()).then(|| bands(&found.bands));
    let errors = &found.lack_of_fit;
    let when =
        (!errors.is_empty()).then(|| [by_time(errors, time).into(), by_frequency(errors, time).into(), Part::Gap]);
    Section::new("validation", "Validation data")
        .with_all(band_verdict(&found.bands).map(|said| Part::Line(said).on_page()))
        .with(outputs(&found.outputs, &found.fitted_outputs))
        .with_all(baselines.map(without_a_model))
        .with_all(bands)
        .with_all(when.into_iter().flatten())
        .with_all(errors.iter().flat_map(|m| &m.sentences).map(|said| Part::Line(said.clone())))
}

/// The error of each prediction beside what no model at all would miss by.
pub fn baseline_table(baselines: &[Baseline]) -> String {
    text::table(without_a_model(baselines))
}

fn without_a_model(baselines: &[Baseline]) -> Rows<&Baseline> {
    let mut table = Rows::over(baselines);
    table.words("without a model", |b| b.output.clone());
    table.words("run", |b| b.run.clone());
    table.number("RMS of residual", |b| digits(b.rms, 4));
    table.number("last value held", |b| digits(b.last_value, 4));
    table.number("straight line", |b| digits(b.straight_line, 4));
    table
}

/// One row for each output of each run: those that are validated first, then those of the fit.
fn outputs(validated: &[OutputQuality], fitted: &[OutputDocument]) -> Rows<(&'static str, OutputDocument)> {
    let own = validated.iter().map(|q| ("validated", OutputDocument::from(q)));
    let part = |o: &OutputDocument, of: fn(TicParts) -> f64| fixed(o.tic_parts.map(of), 2);
    let mut table = Rows::over(own.chain(fitted.iter().map(|o| ("fitted", o.clone()))));
    table.words("", |(role, _)| *role);
    table.words("run", |(_, o)| o.run.clone());
    table.name("output", |(_, o)| o.name.clone());
    table.number("RMS of residual", |(_, o)| {
        o.rms.filter(|v| v.is_finite()).map_or(String::from("-"), |v| digits(v, 4))
    });
    table.number("R^2", |(_, o)| fixed(o.r2, 4));
    table.number("TIC", |(_, o)| fixed(o.tic, 4));
    table.number("of it bias", |(_, o)| part(o, |p| p.bias));
    table.number("variance", |(_, o)| part(o, |p| p.variance));
    table.number("covariance", |(_, o)| part(o, |p| p.covariance));
    table.words("residuals", |(_, o)| colour(o.white()));
    table
}

/// The root mean square of the error in each fifth of each run: whether a prediction runs away, and when.
fn by_time<'a>(errors: &'a [LackOfFit], time: &str) -> Rows<(&'a LackOfFit, &'a [Window])> {
    let runs = errors.iter().flat_map(|m| m.windows.chunk_by(|a, b| a.run == b.run).map(move |own| (m, own)));
    let mut table = Rows::over(runs);
    table.words("RMS of residual", |(m, _)| m.output.clone());
    table.words("run", |(_, own)| own[0].run.clone());
    for k in 0..PARTS {
        let title = if k == 0 { "fifth 1".to_string() } else { (k + 1).to_string() };
        table.number(&title, |(m, own)| {
            let part = &own[k * own.len() / PARTS..(k + 1) * own.len() / PARTS];
            let (share, samples) = part.iter().fold((0.0, 0.0), |(e, n), w| (e + w.share, n + w.samples));
            if samples > 0.0 { digits(m.rms * f64::sqrt(share / samples), 3) } else { "-".into() }
        });
    }
    table.number(&format!("ends at [{time}]"), |(_, own)| own.last().map_or(String::new(), |w| digits(w.to, 4)));
    table
}

/// The error by frequency, in octaves: its size, that of noise as strong as in the upper frequencies, and how much of the record is
/// explained there.
fn by_frequency<'a>(errors: &'a [LackOfFit], time: &str) -> Rows<(&'a LackOfFit, &'a Band)> {
    let per = if time == "s" { "Hz".to_string() } else { format!("1/{time}") };
    let mut table = Rows::over(errors.iter().flat_map(|m| m.bands.iter().map(move |band| (m, band))));
    table.words("output", |(m, _)| m.output.clone());
    table.number(&format!("from [{per}]"), |(_, band)| digits(band.low, 3));
    table.number("to", |(_, band)| digits(band.high, 3));
    table.number("RMS of residual", |(m, band)| digits(m.rms * band.share.sqrt(), 3));
    table.number("noise alone", |(m, band)| digits(m.rms * band.noise.sqrt(), 3));
    table.number("of the record explained", |(_, band)| match band.explained {
        None => "-".into(),
        // what is far worse than no model needs no digits
        Some(part) if part < -9.99 => "< -999 %".into(),
        Some(part) => format!("{:.0} %", 100.0 * part),
    });
    table
}

/// What the portmanteau test says.
fn colour(white: Option<&Whiteness>) -> String {
    match white.filter(|w| w.p_value.is_finite()) {
        None => "not tested".into(),
        Some(w) => format!("{} ({})", if w.is_white() { "white" } else { "coloured" }, p_value(w.p_value)),
    }
}

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
fn bands(bands: &[BandCoverage]) -> Rows<&BandCoverage> {
    let half = |v: Option<f64>| v.map_or("-".into(), |v| format!("± {}", digits(v, 3)));
    let mut table = Rows::over(bands);
    table.name("95 % bands", |b| b.output.clone());
    table.words("run", |b| b.run.clone());
    table.number("of the response", |b| half(b.response));
    table.number("of a measurement", |b| half(b.measurement));
    table.number("measured within", |b| b.within.map_or("-".into(), |share| format!("{:.1} %", 100.0 * share)));
    table
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
        let text = text::table(outputs(&[], &[row("a", 0.5), row("b", 1e-9)]));
        let lines: Vec<&str> = text.lines().map(str::trim).collect();
        assert!(lines[1].starts_with("fitted  a    y") && lines[1].ends_with("white (p = 0.500)"), "{text}");
        assert!(lines[2].contains("0.7500") && lines[2].ends_with("coloured (p = 1e-9)"), "{text}");
        assert_eq!(text::table(outputs(&[], &[])).lines().count(), 1);
    }
}
