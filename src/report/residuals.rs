//! The residuals: how large they are and what they consist of, and whether they are noise: their autocorrelation, their spectrum, their
//! distribution, and their correlation with every input, with bounds.

use super::section::{Cell, Part, Rows, Section};
use crate::page::figure::{Figure, Look, Mark, Panel, Shape};
use crate::page::number::{behind, probability, shown, unit_of_frequency};
use crate::page::subject::Subject;
use crate::text;
use fdm_estimate::residuals::{InputCorrelation, OutputQuality, TicParts, Whiteness};
use fdm_results::documents::{OFFSET, OutputDocument, digits, fixed};

/// Outputs whose figures stand open.
const OPEN: usize = 4;

/// One row for each output of each run: size of the residual, what it consists of, and where that was asked the p-value of its whiteness.
///
/// `bias`, `var` and `cov` are the parts of Theil's coefficient; `white p` is the probability of residuals as correlated as
/// these, were they white; `D-W` is the statistic of Durbin and Watson.
pub(crate) fn table(outputs: &[OutputDocument]) -> Rows<&OutputDocument> {
    let number = |v: Option<f64>, n: usize| v.map_or(String::from("-"), |v| digits(v, n));
    let part = |o: &OutputDocument, of: fn(TicParts) -> f64| fixed(o.tic_parts.map(of), 2);
    let mut table = Rows::over(outputs);
    table.name("output", |o| o.name.clone());
    table.words("run", |o| o.run.clone());
    table.number("RMS", |o| number(o.rms, 4));
    table.unit(|o| o.unit.clone()).on_page();
    table.number("mean", |o| number(o.mean, 2));
    table.number("R^2", |o| fixed(o.r2, 4));
    table.number("TIC", |o| fixed(o.tic, 4));
    table.number("bias", |o| Cell::coloured(part(o, |p| p.bias), o.tic_parts.is_some_and(|p| p.bias > OFFSET)));
    table.number("var", |o| part(o, |p| p.variance));
    table.number("cov", |o| part(o, |p| p.covariance));
    if outputs.iter().any(|o| o.whiteness.is_some()) {
        table.number("white p", |o| match o.white().map(|w| w.p_value) {
            None => "-".into(),
            Some(p) if p < 1e-3 => "<0.001".into(),
            Some(p) => format!("{p:.3}"),
        });
        table.number("D-W", |o| fixed(o.white().and_then(|w| w.durbin_watson), 2));
    }
    table.number("compared", |o| o.compared);
    if outputs.iter().any(|o| o.censored > 0) {
        table.number("below limit", |o| o.censored);
    }
    table
}

/// How well time histories are matched: size of the residual and Theil's coefficient of every output.
pub fn prediction_table(quality: &[OutputQuality]) -> String {
    let number = |v: Option<f64>, n: usize| v.map_or(String::new(), |v| digits(v, n));
    let mut table = Rows::over(quality.iter().map(|q| &q.fit));
    table.name("output", |o| o.name.clone());
    table.words("run", |o| o.run.clone());
    table.number("RMS", |o| number(o.rms, 4));
    table.number("R^2", |o| number(o.r2, 5));
    table.number("TIC", |o| number(o.tic, 3));
    text::table(table)
}

/// The residuals of the outputs in time.
pub(crate) fn section(subject: &Subject) -> Option<Section> {
    let (outputs, predicted, time) = (subject.outputs(), subject.predicted(), subject.time());
    let note = "bias, var and cov are the parts of the mean square residual (Theil): a good model leaves only cov. White residuals have a Durbin–Watson \
                statistic near 2 and a large p. Bands are two standard deviations, of spectra 95 %: at one of twenty lags, and in one of twenty bands, chance \
                leads beyond them. Errors of estimates hold for other distributions than the normal one too; outliers cost precision.";
    let predicted = (!predicted.is_empty()).then(|| {
        let held = "Not fitted. What all runs share is held; initial states and biases are each run's own.";
        [Part::Heading("Validation runs".into()), Part::Note(held.into()), table(predicted).into()]
    });
    let figures = outputs.iter().enumerate().filter_map(|(k, o)| {
        let (summary, figures) = (format!("{} in {}", o.name, o.run), figures_of(k, o, o.white()?, &time));
        Some(Part::Folded { summary, open: k < OPEN, class: "run", parts: vec![Part::Pair(figures)] })
    });
    (!outputs.is_empty()).then(|| {
        Section::new("residuals", "Residuals")
            .with(table(outputs))
            .with_all(predicted.into_iter().flatten())
            .note(note)
            .with_all(figures)
    })
}

/// All figures of residuals, output by output.
pub(crate) fn figures(subject: &Subject) -> Vec<Figure> {
    let time = subject.time();
    let tested = subject.outputs().iter().enumerate().filter_map(|(k, o)| Some((k, o, o.white()?)));
    tested.flat_map(|(k, o, white)| figures_of(k, o, white, &time)).collect()
}

fn figures_of(k: usize, output: &OutputDocument, white: &Whiteness, time: &str) -> Vec<Figure> {
    let inputs = output.inputs().iter().enumerate().map(|(i, input)| with_input(k, i, input, time));
    let own = [Some(autocorrelation(k, white, time)), spectrum(k, output, time), histogram(k, output)];
    own.into_iter().flatten().chain(inputs).collect()
}

fn autocorrelation(k: usize, white: &Whiteness, time: &str) -> Figure {
    let (values, interval) = (white.autocorrelation.clone(), white.interval);
    let caption = format!("autocorrelation of the residual; {} of {} lags outside", white.outside, values.len());
    Figure::new(
        format!("autocorrelation-{}", k + 1),
        caption,
        format!("lag [{time}]"),
        (1..=values.len()).map(|lag| lag as f64 * interval).collect(),
    )
    .with(correlation(values, &white.bounds))
    .half()
}

/// Where in frequency something is left.
fn spectrum(k: usize, output: &OutputDocument, time: &str) -> Option<Figure> {
    let found = output.spectrum.as_ref()?.as_ref()?;
    let (at, density) = (found.frequency.clone(), found.density.clone());
    let unit = unit_of_frequency(time);
    let id = format!("residual-spectrum-{}", k + 1);
    let marks = vec![
        Mark::between("of white noise", Look::Bound, Shape::Band, found.low.clone(), found.high.clone()),
        Mark::line("of the residual", Look::Residual, density.clone()),
        Mark::dots("", Look::Residual, density),
    ];
    Some(
        Figure::new(
            id,
            format!("spectrum of the residual; {} of {} bands outside", found.outside, at.len()),
            format!("frequency [{unit}]"),
            at,
        )
        .with(Panel::new("density over white", 150, marks).logarithmic())
        .logarithmic()
        .half(),
    )
}

/// How residuals are distributed.
fn histogram(k: usize, output: &OutputDocument) -> Option<Figure> {
    let found = output.distribution.as_ref()?.as_ref()?;
    let counts: Vec<f64> = found.counts.iter().map(|n| *n as f64).collect();
    let unit = behind(output.unit.as_deref());
    let id = format!("residual-histogram-{}", k + 1);
    let zeros = vec![0.0; counts.len()];
    let marks = vec![
        Mark::between("residuals", Look::Measured, Shape::Columns, zeros, counts),
        Mark::line("normal", Look::Model, found.expected.clone()),
    ];
    Some(
        Figure::new(
            id,
            format!(
                "distribution of the residual; {} beyond 3 σ, of a normal one {}",
                found.far.0,
                shown(found.far.1, 2)
            ),
            format!("deviation from the mean [σ = {}{unit}]", shown(found.deviation, 3)),
            found.edges.windows(2).map(|e| 0.5 * (e[0] + e[1])).collect(),
        )
        .with(Panel::new("residuals", 150, marks))
        .half(),
    )
}

fn with_input(k: usize, i: usize, input: &InputCorrelation, time: &str) -> Figure {
    let (name, values) = (&input.input, input.correlation.clone());
    let caption = format!(
        "with input {name}; {} of {} lags outside, chance of the largest {}",
        input.outside,
        values.len(),
        probability(input.p_value)
    );
    Figure::new(
        format!("with-input-{}-{}", k + 1, i + 1),
        caption,
        format!("time by which the residual follows {name} [{time}]"),
        input.lags.clone(),
    )
    .with(correlation(values, &input.bounds))
    .half()
}

fn correlation(values: Vec<f64>, bounds: &[f64]) -> Panel {
    let zeros = vec![0.0; values.len()];
    let band =
        Mark::between("by chance", Look::Bound, Shape::Band, bounds.iter().map(|b| -b).collect(), bounds.to_vec());
    let stems = Mark::between("correlation", Look::Residual, Shape::Stems, zeros, values);
    Panel::new("correlation", 150, vec![band, stems])
}
