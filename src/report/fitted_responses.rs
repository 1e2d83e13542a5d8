//! A fit of frequency responses: what every pair costs, how well the parameters are known by it, and each response beside the model's.

use super::fit::{Detail, closed, remark_lines};
use super::response::unwrapped;
use super::section::{Cell, Part, Rows, Section};
use super::spectral::{first_values, in_time, trimmed_at};
use crate::page::figure::{Figure, Look, Mark, Panel, Shape};
use crate::page::number::{shown, unit_of_frequency};
use crate::parameters;
use fdm_estimate::{PairFit, ResponseFit, Sensitivity};
use fdm_results::documents::{FrequencyResponses, Pair, digits, estimate_remarks};

/// Cost up to which a model is good.
const GOOD: f64 = 100.0;
/// Cost up to which it is as good as the data.
const AS_DATA: f64 = 50.0;
/// Percent up to which a bound and an insensitivity are good.
const BOUND: f64 = 20.0;
const INSENSITIVE: f64 = 10.0;
/// Decibels of a relative error of one: 20/ln 10.
const DECIBELS: f64 = 8.685_889_638;
/// Degrees of a radian.
const DEGREES: f64 = 57.295_779_513;

/// Parameters with standard errors, bounds and insensitivities, what every pair costs, and how well time histories are matched.
pub fn fitted_response_table(fit: &ResponseFit, detail: Detail) -> String {
    let found = FrequencyResponses::of(fit);
    let left_out: usize = fit.pairs.iter().map(|p| p.left_out).sum();
    let left_out = (left_out > 0)
        .then(|| format!("{left_out} points with a coherence below {} were left out", fit.least_coherence));
    let incoherent = fit.incoherent.iter().map(|(output, input)| {
        format!("{output}/{input} is nowhere coherent and was left out; sweeps that move {input} more would show it")
    });
    // outputs here are decibels and degrees, about which the rest is said above
    let remarks = remark_lines(&estimate_remarks(&fit.estimate), detail);
    let last = left_out.into_iter().chain(incoherent).map(Part::Line).chain(remarks).collect();
    let section = Section::new("fit", "Fit")
        .line(band(fit))
        .lines(trimmed_at(&fit.model, fit.trim.as_ref()))
        .lines(first_values(&fit.starting_values))
        .with(parameters::table(&fit.parameters(), detail.intervals))
        .with_all((!found.sensitivities.is_empty()).then(|| sensitivities(&found.sensitivities)))
        .with_all((!found.pairs.is_empty()).then(|| costs(&found)));
    closed(section, last, detail.words) + &in_time(fit.finish.as_ref(), fit.unfinished.as_ref())
}

/// Costs, responses and sensitivities.
pub(crate) fn parts(found: &FrequencyResponses, figures: Vec<Figure>) -> Vec<Part> {
    let least = digits(found.least_coherence, 2);
    let note = format!(
        "A cost up to {GOOD} is good, and up to {AS_DATA} as good as the data. Bars are two random errors, as the coherence tells them; frequencies \
         with a coherence below {least} are left out."
    );
    let mut parts = vec![costs(found).into(), Part::Note(note), Part::Pair(figures)];
    if !found.sensitivities.is_empty() {
        parts.extend([Part::Heading("Bounds and insensitivities".into()), sensitivities(&found.sensitivities).into()]);
    }
    parts
}

/// What was compared.
fn band(fit: &ResponseFit) -> String {
    let points: usize = fit.pairs.iter().map(|p| p.omega.len()).sum();
    let (time, (low, high)) = (&fit.model.definition().time, fit.band());
    let unit = unit_of_frequency(&time.to_string());
    let lengths: Vec<String> = fit.segments.iter().map(|l| digits(*l, 3)).collect();
    let mut text = format!("frequency responses from segments of {} {time}", lengths.join(", "));
    if points > 0 {
        let ends = format!("{} to {} {unit}", digits(low, 4), digits(high, 4));
        text.push_str(&format!("; {} pairs, {points} points, {ends}", fit.pairs.len()));
    }
    text
}

fn verdict(cost: f64) -> &'static str {
    match cost {
        c if c <= AS_DATA => "as good as the data",
        c if c <= GOOD => "good",
        _ => "does not match",
    }
}

/// A row of the table of costs.
struct Cost {
    name: String,
    /// Frequencies, those that were left out, and the range of the coherence.
    of_pair: [String; 3],
    cost: f64,
}

/// What every pair costs, and all together.
fn costs(found: &FrequencyResponses) -> Rows<Cost> {
    let pair = |p: &Pair| {
        let least = p.coherence.iter().copied().fold(1.0, f64::min);
        let range = format!("{least:.2} to {:.2}", p.coherence.iter().copied().fold(0.0, f64::max));
        let of_pair = [p.frequency.len().to_string(), p.left_out.to_string(), range];
        Cost { name: format!("{}/{}", p.output, p.input), of_pair, cost: p.cost }
    };
    let average = found.cost.map(|cost| Cost { name: "average".into(), of_pair: Default::default(), cost });
    let mut table = Rows::over(found.pairs.iter().map(pair).chain(average));
    table.name("response", |c| c.name.clone());
    table.number("frequencies", |c| c.of_pair[0].clone());
    table.number("left out", |c| c.of_pair[1].clone());
    table.span("coherence", |c| c.of_pair[2].clone());
    table.number("cost", |c| digits(c.cost, 3));
    table.words("", |c| verdict(c.cost));
    table
}

fn sensitivities(all: &[Sensitivity]) -> Rows<&Sensitivity> {
    let marked = |v: f64, limit: f64| Cell::warned(digits(v, 3), v > limit);
    let mut table = Rows::over(all);
    table.name("parameter", |s| s.parameter.clone());
    table.number("2 x Cramer-Rao %", |s| marked(s.cramer_rao, BOUND));
    table.number("insensitivity %", |s| marked(s.insensitivity, INSENSITIVE));
    table
}

/// Magnitude, phase and coherence of a pair.
pub(crate) fn figure(k: usize, p: &Pair, unit: &str) -> Figure {
    let panel = |label: &str, (values, modelled): (&Vec<f64>, &Vec<f64>), size: f64| {
        let edge =
            |sign: f64| values.iter().zip(&p.error).map(|(v, e)| v + sign * 2.0 * size * e).collect::<Vec<f64>>();
        let bars = Mark::between("", Look::Measured, Shape::Bars, edge(-1.0), edge(1.0));
        let dots = Mark::dots("measured", Look::Measured, values.clone());
        let model = Mark::line("model", Look::Model, modelled.clone());
        Panel::new(label, 130, vec![bars, model, dots])
    };
    let coherence = Mark::line("coherence", Look::Input, p.coherence.clone());
    let (degrees, model_degrees) = continued(p);
    Figure::new(
        format!("response-{}", k + 1),
        format!("{}/{}: cost {}", p.output, p.input, shown(p.cost, 3)),
        format!("frequency [{unit}]"),
        p.frequency.clone(),
    )
    .in_group("responses")
    .with(panel("magnitude [dB]", (&p.decibels, &p.model_decibels), DECIBELS))
    .with(panel("phase [deg]", (&degrees, &model_degrees), DEGREES))
    .with(Panel::new("coherence", 70, vec![coherence]))
    .logarithmic()
    .half()
}

/// Measured degrees without jumps of a whole turn, and those of the model nearest to them.
fn continued(p: &Pair) -> (Vec<f64>, Vec<f64>) {
    let smooth = unwrapped(p.degrees.iter().copied().zip(p.coherence.iter().copied()));
    let nearest = |(v, to): (&f64, &f64)| v + 360.0 * ((to - v) / 360.0).round();
    let own = p.model_degrees.iter().zip(&smooth).map(nearest).collect();
    (smooth, own)
}

/// A pair as columns: frequency, measured and modelled decibels and degrees, coherence.
pub fn fitted_response_columns(pair: &PairFit) -> Vec<(&'static str, Vec<f64>)> {
    let pair = Pair::from(pair);
    vec![
        ("frequency", pair.frequency),
        ("decibels", pair.decibels),
        ("degrees", pair.degrees),
        ("decibels_model", pair.model_decibels),
        ("degrees_model", pair.model_degrees),
        ("coherence", pair.coherence),
        ("error", pair.error),
    ]
}
