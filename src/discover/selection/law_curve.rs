//! The curve of an unmodelled law in the model's text: a table with nodes as params, smooth, fitted as any other model.
//!
//! A law that no effect of the catalogue has is drawn over the one variable that says most of it. Written down it is a model that can be simulated: a
//! stand-in for physics that has no name yet. What a level or a slope of the curve does, the model may do by a constant and a coefficient of its own; there
//! the nodes at the ends are zero.

use super::extended_model::SignalScales;
use super::fitted_model::{FittedModel, records, shared_from};
use super::initial_fit::Thoroughness;
use super::runs::{DiagnosisOptions, Runs};
use super::written_model::{WrittenModel, at_values, written_model};
use crate::diagnosis::EffectAt;
use crate::disturbance::{CurvePoint, NonlinearityCurve, PlaceKind};
use fdm_effects::{Catalogue, Choice, NewParam, Subject};
use fdm_estimate::Work;
use fdm_grammar::Source;
use fdm_system::model::Model;
use nalgebra::{DMatrix, DVector, SymmetricEigen};

/// Pieces between nodes that are tried: as few as draw the curve.
const PIECES: [usize; 5] = [8, 12, 24, 48, 96];
/// What a spline through the nodes may be off (root mean square), in deviations of the curve or as a part of its size. The cost of a fit rises
/// with the square of their number: every node moves the whole curve.
const OFF: (f64, f64) = (0.5, 0.03);
/// Part of its own energy that a level or a slope of the curve must have beside the model's own parameters.
const DISTINCT: f64 = 1e-6;
/// Error of the model with its curve, in that of the model without, beyond which no fit is tried.
const HOPELESS: f64 = 2.0;
/// Eigenvalues below this part of the largest belong to nothing.
const ROUNDING: f64 = 1e-12;
/// Digits of an ordinate, and of an abscissa beyond those that tell nodes apart.
const DIGITS: usize = 5;
const BEYOND: i32 = 3;

/// A law's curve in the text of a model, fitted.
pub(super) struct LawModel {
    /// What it is called in results.
    pub(super) place: EffectAt,
    /// Nodes that are estimated.
    pub(super) parameters: usize,
    /// With its start values, before the plain fit.
    pub(super) current: FittedModel,
    pub(super) written: WrittenModel,
}

impl LawModel {
    /// What was fitted from, and what came of it.
    pub(super) fn fits(&self) -> (&FittedModel, &FittedModel) {
        (&self.current, &self.written.fitted)
    }
}

/// Which ends of a curve are zero.
#[derive(Debug, Clone, Copy, Default)]
struct Pinned {
    first: bool,
    last: bool,
}

/// A text with a table in it, and the names of its nodes.
struct Tabulated {
    model: Model,
    nodes: Vec<String>,
}

/// Writes a law's curve into a model at these values and fits it plainly; `naive` are the responses without it.
///
/// # Errors
/// Why it cannot be written or fitted, in words.
pub(super) fn law_model(
    first: &FittedModel,
    theta: &[Vec<f64>],
    law: &NonlinearityCurve,
    (runs, options, work): (Runs<'_>, &DiagnosisOptions, &Work<'_>),
) -> Result<LawModel, String> {
    let points = nodes(&law.curve.points);
    let free = Tabulated::new(first, runs, law, &points, Pinned::default())?;
    let pinned = made_up_for(&free.at(first, theta, runs)?, &free.nodes, runs)?;
    let tabulated = match pinned {
        Pinned { first: false, last: false } => free,
        _ => Tabulated::new(first, runs, law, &points, pinned)?,
    };
    let current = tabulated.at(first, theta, runs)?;
    // a curve that makes an equation unstable may keep a fit busy for minutes, and is no law
    let begun = at_values(&current, &current.theta, &first.response, runs);
    let begun = begun.ok_or("the model with its curve has no response")?.training.sqrt();
    if begun > HOPELESS {
        return Err(format!("with its curve the error is {begun:.1} times as large as without"));
    }
    let asked = (runs, options, work);
    let written = written_model(&current, &current.theta, &first.response, asked, Thoroughness::Once)?;
    let place =
        EffectAt { effect: "law_curve".into(), targets: vec![law.place.name.clone(), law.curve.variable.clone()] };
    Ok(LawModel { place, parameters: tabulated.nodes.len(), current, written })
}

/// As few points of a curve as a spline through them draws it.
fn nodes(points: &[CurvePoint]) -> Vec<CurvePoint> {
    let last = points.len().saturating_sub(1);
    let size = points.iter().map(|p| p.value * p.value).sum::<f64>();
    let draws = |pieces: &usize| {
        let each = last / pieces;
        let values: Vec<f64> = points.iter().step_by(each).map(|p| p.value).collect();
        let Some(moments) = moments(&values) else { return false };
        let off = |(k, p): (usize, &CurvePoint)| {
            let from = (k / each).min(pieces - 1);
            let (right, left) = ((k - from * each) as f64 / each as f64, 1.0 - (k - from * each) as f64 / each as f64);
            let line = left * values[from] + right * values[from + 1];
            let bent = (left.powi(3) - left) * moments[from] + (right.powi(3) - right) * moments[from + 1];
            let off = p.value - line - bent / 6.0;
            (off * off, (off / p.deviation).powi(2))
        };
        let all = points.iter().enumerate().map(off);
        let (square, relative) = all.fold((0.0, 0.0), |sum, own| (sum.0 + own.0, sum.1 + own.1));
        square <= OFF.1.powi(2) * size || relative <= OFF.0.powi(2) * points.len() as f64
    };
    let fits = || PIECES.into_iter().filter(|pieces| *pieces <= last && last.is_multiple_of(*pieces));
    let pieces = fits().find(draws).or_else(|| fits().next_back()).unwrap_or(last.max(1));
    points.iter().step_by((last / pieces).max(1)).copied().collect()
}

/// Second derivatives of a spline through values at distance one, not-a-knot at the ends as the language's tables are; none of fewer than
/// four.
fn moments(values: &[f64]) -> Option<DVector<f64>> {
    let size = values.len();
    let mut system = DMatrix::zeros(size, size);
    let mut right = DVector::zeros(size);
    for k in 1..size.checked_sub(1).filter(|_| size > 3)? {
        for (at, weight) in [(k - 1, 1.0), (k, 4.0), (k + 1, 1.0)] {
            system[(k, at)] = weight;
        }
        right[k] = 6.0 * (values[k - 1] - 2.0 * values[k] + values[k + 1]);
    }
    for (row, first) in [(0, 0), (size - 1, size - 3)] {
        (0..3).for_each(|k| system[(row, first + k)] = [1.0, -2.0, 1.0][k]);
    }
    system.lu().solve(&right)
}

impl Tabulated {
    fn new(
        first: &FittedModel,
        runs: Runs<'_>,
        law: &NonlinearityCurve,
        points: &[CurvePoint],
        pinned: Pinned,
    ) -> Result<Self, String> {
        let scales = SignalScales::new(first, runs);
        // the effect finds the equation and the units; its constant becomes a curve
        let effect = match law.place.kind {
            PlaceKind::Equation => "effect law(x: state) { param law = 0; add der(x) += law; }",
            PlaceKind::Input => "effect law(x: input) { param law = 0; let curved = x + law; replace x with curved; }",
            PlaceKind::Output => "effect law(x: output) { param law = 0; add x += law; }",
        };
        let (catalogue, _) = Catalogue::read(&Source::new("law", effect));
        let places = catalogue.places(&first.subject);
        let candidate = places
            .find(&format!("law({})", law.place.name))
            .ok_or_else(|| format!("no curve can be added at {}", law.place))?;
        let extension = candidate.apply(&first.subject, &scales, &Choice::new()).map_err(|d| d.message)?;
        let constant = extension.params().first().ok_or("the curve is lost in the text")?;
        let (text, nodes) = with_table(first, extension.text(), constant, law, points, pinned)?;
        let source = with_text(&first.subject, text);
        let model = Model::from_source(source).map_err(|e| format!("the text with the curve is refused: {e}"))?;
        Ok(Self { model, nodes })
    }

    /// The model at its start values, and at these of the model without the curve.
    fn at(&self, first: &FittedModel, theta: &[Vec<f64>], runs: Runs<'_>) -> Result<FittedModel, String> {
        let params = &self.model.definition().params;
        // what is free and fixed there is so here
        let known = |name: &str| first.model.definition().param(name);
        let params: Vec<_> = params
            .iter()
            .map(|p| match known(&p.quantity.name) {
                Some(k) => fdm_grammar::model::Param { origin: p.origin, ..first.params()[k].clone() },
                None => p.clone(),
            })
            .collect();
        let of = |own: &Vec<f64>| -> Vec<f64> {
            params.iter().map(|p| known(&p.quantity.name).map_or(p.value, |k| own[k])).collect()
        };
        let theta: Vec<Vec<f64>> = theta.iter().map(of).collect();
        let theta = shared_from(&params, &theta[0].clone(), &theta);
        FittedModel::new(self.model.with_params(params), runs, theta).map_err(|e| e.to_string())
    }
}

/// The text with a table in the place of a constant, and the names of the nodes that are estimated.
fn with_table(
    first: &FittedModel,
    text: &str,
    constant: &NewParam,
    law: &NonlinearityCurve,
    points: &[CurvePoint],
    pinned: Pinned,
) -> Result<(String, Vec<String>), String> {
    let lost = || "the curve is lost in the text".to_string();
    let name = &constant.name;
    let begin = text.find(&format!("param {name} = ")).ok_or_else(lost)?;
    let end = begin + text[begin..].find(';').ok_or_else(lost)? + 1;
    let definition = first.model.definition();
    let variable = &law.curve.variable;
    let quantities = definition.states.iter().map(|s| &s.quantity).chain(definition.inputs.iter().map(|i| &i.quantity));
    let unit = |unit: Option<&str>| unit.map_or(String::new(), |unit| format!(" [{unit}]"));
    let over = quantities.into_iter().find(|q| q.name == *variable).and_then(|q| q.unit.as_ref());
    let (over, own) = (unit(over.map(|u| u.text())), unit(constant.unit.as_ref().map(|u| u.text())));
    let argument: String = variable.chars().map(|c| if c.is_alphanumeric() { c } else { '_' }).collect();
    let (low, high) = (points[0], points[points.len() - 1]);
    let digits = digits_of_axis(&points.iter().map(|p| p.at).collect::<Vec<f64>>());
    // what the ends lack, the model's own constant and coefficient make up for
    let (level, slope) = match (pinned.first, pinned.last) {
        (false, false) => (0.0, 0.0),
        (true, false) => (low.value, 0.0),
        (false, true) => (0.0, high.value),
        (true, true) => (low.value, high.value - low.value),
    };
    let (mut table, mut params, mut nodes) = (Vec::new(), Vec::new(), Vec::new());
    for (k, point) in points.iter().enumerate() {
        let at = number(point.at, digits);
        if (k == 0 && pinned.first) || (k + 1 == points.len() && pinned.last) {
            table.push(format!("{at}: 0"));
            continue;
        }
        let node = format!("{name}_{}", k + 1);
        let value = point.value - level - slope * k as f64 / (points.len() - 1) as f64;
        params.push(format!("{node} = {}{own}", number(value, DIGITS)));
        table.push(format!("{at}: {node}"));
        nodes.push(node);
    }
    let place = &law.place;
    let indent: String = text[..begin].chars().rev().take_while(|c| *c == ' ').collect();
    let declared = format!(
        "param {};\n{indent}table {name}({argument}{over}) \"what {place} lacks, over {variable}\"{own} = cubic {{ {} }};\n{indent}smooth {name} by order 2;",
        params.join(", "),
        table.join(", "),
    );
    let called = format!("{name}({variable})");
    let text =
        format!("{}{declared}{}", called_by(&text[..begin], name, &called), called_by(&text[end..], name, &called));
    Ok((text, nodes))
}

/// Digits that tell even nodes apart, and a little more.
pub(super) fn digits_of_axis(at: &[f64]) -> usize {
    let (low, high) = (at.first().copied().unwrap_or(0.0), at.last().copied().unwrap_or(0.0));
    let step = (high - low) / at.len().saturating_sub(1).max(1) as f64;
    ((low.abs().max(high.abs()) / step).log10().ceil() as i32 + BEYOND).clamp(3, 15) as usize
}

/// A number in a text.
pub(super) fn number(v: f64, digits: usize) -> String {
    let short: f64 = format!("{v:.*e}", digits - 1).parse().unwrap_or(v);
    if short == 0.0 { "0".to_string() } else { short.to_string() }
}

/// A text in which a word stands as another.
fn called_by(text: &str, word: &str, other: &str) -> String {
    let part = |c: char| c.is_alphanumeric() || c == '_' || c == '.';
    let mut found = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(at) = rest.find(word) {
        let (before, behind) = (&rest[..at], &rest[at + word.len()..]);
        let whole = !before.chars().next_back().is_some_and(part) && !behind.chars().next().is_some_and(part);
        found.push_str(before);
        found.push_str(if whole { other } else { word });
        rest = behind;
    }
    found + rest
}

/// A text with the files that the model was compiled with.
pub(super) fn with_text(subject: &Subject, text: String) -> Source {
    let base = subject.source();
    let mut source = Source::new(base.name(), text).with_groups(base.groups().clone());
    fdm_grammar::gather(&mut source, &mut |name| {
        let text = base.find(name).map(|k| base.texts()[k].text().to_string());
        text.ok_or_else(|| "it was not there before".to_string())
    });
    source
}

/// Whether the model's own parameters make up for a level of the curve, and for a slope.
fn made_up_for(current: &FittedModel, nodes: &[String], runs: Runs<'_>) -> Result<Pinned, String> {
    let train = runs.train();
    let records = records(&current.model, train, &current.predictors[..train.len()], &current.theta)
        .map_err(|e| e.to_string())?;
    let (shared, _) = current.columns(runs);
    let node = |column: usize| {
        let name = shared.get(column).map(|k| &current.params()[*k].quantity.name)?;
        nodes.iter().position(|n| n == name)
    };
    let q = current.outputs();
    let columns = records.first().map_or(0, |r| r.fitted.len());
    let own: Vec<usize> = (0..columns).filter(|k| node(*k).is_none()).collect();
    let mut size = vec![0.0; q];
    for record in &records {
        let left = record.residual.iter().enumerate().filter(|(_, r)| !r.is_nan());
        left.for_each(|(k, r)| size[k % q] += r * r);
    }
    // base parameters, then level and slope, outputs by what the model leaves of them
    let width = own.len() + 2;
    let mut products = DMatrix::zeros(width, width);
    for record in &records {
        for at in (0..record.residual.len()).filter(|at| !record.residual[*at].is_nan()) {
            let weight = if size[at % q] > 0.0 { size[at % q].sqrt().recip() } else { 0.0 };
            let value = |k: usize| record.fitted[k].as_ref().map_or(0.0, |column| column[at]);
            let mut row = DVector::from_fn(width, |k, _| if k < own.len() { value(own[k]) } else { 0.0 });
            for (column, k) in (0..columns).filter_map(|column| Some((column, node(column)?))) {
                row[width - 2] += value(column);
                row[width - 1] += value(column) * k as f64;
            }
            products.ger(weight * weight, &row, &row, 1.0);
        }
    }
    let level = left_beside(&products, own.len(), width - 2) < DISTINCT;
    let slope = left_beside(&products, own.len() + 1, width - 1) < DISTINCT;
    Ok(Pinned { first: level, last: slope })
}

/// Part of a column's energy that is left beside the first ones, by their products.
fn left_beside(products: &DMatrix<f64>, first: usize, column: usize) -> f64 {
    let scale = products.diagonal().map(|v| if v > 0.0 { v.sqrt().recip() } else { 0.0 });
    let gram = DMatrix::from_fn(first, first, |i, j| scale[i] * products[(i, j)] * scale[j]);
    let cross = DVector::from_fn(first, |i, _| scale[i] * products[(i, column)] * scale[column]);
    let eigen = SymmetricEigen::new(gram);
    let largest = eigen.eigenvalues.iter().copied().fold(0.0, f64::max);
    let turned = eigen.eigenvectors.tr_mul(&cross);
    let taken = eigen.eigenvalues.iter().zip(turned.iter()).filter(|(l, _)| **l > ROUNDING * largest);
    if scale[column] > 0.0 { 1.0 - taken.map(|(l, c)| c * c / l).sum::<f64>() } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_word_is_called_where_it_is_whole() {
        let text = "der(h) = a*h + law_h; let laws = law_h2 + my_law_h + 2*law_h^2;";
        let called = "der(h) = a*h + law_h(u); let laws = law_h2 + my_law_h + 2*law_h(u)^2;";
        assert_eq!(called_by(text, "law_h", "law_h(u)"), called);
    }

    #[test]
    fn nodes_are_as_many_as_draw_the_curve() {
        let curve = |f: &dyn Fn(f64) -> f64| -> Vec<CurvePoint> {
            let of = |k: usize| CurvePoint { at: k as f64 / 96.0, value: f(k as f64 / 96.0), deviation: 0.01 };
            (0..97).map(of).collect()
        };
        let square = nodes(&curve(&|x| x * x));
        assert_eq!((square.len(), square[8].at), (9, 1.0));
        let cubic = moments(&[0.0, 1.0, 8.0, 27.0, 64.0]).unwrap();
        assert!((0..5_usize).all(|k| (cubic[k] - 6.0 * k as f64).abs() < 1e-9), "{cubic}");
        let waves = nodes(&curve(&|x| (30.0 * x).sin())).len();
        assert!((25..=49).contains(&waves), "{waves}");
        assert_eq!(nodes(&curve(&|x| (200.0 * x).sin())).len(), 97);
    }
}
