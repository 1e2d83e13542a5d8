//! Every complex partial of the response at frequencies, on every model of the repository that has a linear model: by parameters, delays,
//! and end values, on the grid and off it, with nonlinear terms carried in, against central differences at random parameters.

use fdm::Model;
use fdm::estimate::{Changes, changed};
use fdm::frequency::{EndTerms, FrequencyResponse, Plans};
use fdm::linear::{LinearModel, Values};
use fdm::spectrum::Spectrum;
use num_complex::Complex64;
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::path::PathBuf;
use std::sync::Arc;
use support::Normal;

/// Frequencies of a spectrum.
const COUNT: usize = 7;
/// Points at which a model is checked.
const POINTS: usize = 3;

/// A record's spectrum of which nothing but the sizes means anything; `stretch` 1 lies on its grid.
fn spectrum(inputs: usize, outputs: usize, stretch: f64, normal: &mut Normal) -> Spectrum {
    let (samples, dt) = (200, 0.05);
    let mut plane = |channels: usize| -> Vec<Complex64> {
        (0..channels * COUNT).map(|_| Complex64::new(normal.next(), normal.next())).collect()
    };
    let own = TAU / (samples as f64 * dt);
    Spectrum {
        name: "any".into(),
        omega: (0..COUNT).map(|k| own * stretch * (1 + 3 * k) as f64).collect(),
        dt,
        samples,
        inputs: plane(inputs),
        input_power: vec![1.0; inputs],
        sampled_inputs: plane(inputs),
        outputs: plane(outputs),
        input_ends: [vec![0.3; inputs], vec![-0.7; inputs]],
        output_ends: [vec![0.2; outputs], vec![0.9; outputs]],
        ..Spectrum::default()
    }
}

/// Parameters near the start, inside their bounds.
fn near(model: &Model, normal: &mut Normal) -> Vec<f64> {
    let inside = |(p, value): (&fdm_grammar::model::Param, f64)| {
        let size = if value == 0.0 { 0.1 } else { 0.05 * value.abs() };
        let room = 1e-3 * value.abs().max(1e-3);
        (value + size * normal.next()).clamp(p.lower + room, p.upper - room)
    };
    let definition = model.definition();
    definition.params.iter().zip(definition.start()).map(inside).collect()
}

/// Steps of differences, as shares of the parameter.
const STEPS: [f64; 2] = [2e-4, 4e-5];

struct Subject {
    linear: LinearModel,
    values: Values,
    response: FrequencyResponse,
    params: usize,
    y: Vec<f64>,
}

impl Subject {
    /// None where the model cannot be linearised there.
    fn new(model: &Model, theta: &[f64], ends: &EndTerms, spectrum: &Spectrum) -> Option<Self> {
        let mut linear = LinearModel::new(model).ok()?;
        let mut values = Values::default();
        linear.evaluate(theta, &mut values).ok()?;
        let structure = linear.structure().clone();
        let response = FrequencyResponse::new(&structure, &values, spectrum, ends, &Arc::new(Plans::default())).ok()?;
        let y = vec![0.0; 2 * COUNT * structure.outputs];
        Some(Self { params: structure.params, linear, values, response, y })
    }

    /// Outputs where `theta` are the parameters, and behind them the end values.
    fn outputs(&mut self, theta: &[f64]) -> Option<Vec<f64>> {
        self.linear.evaluate(&theta[..self.params], &mut self.values).ok()?;
        self.response.simulate(&self.values, &theta[self.params..], &mut self.y).ok()?;
        Some(self.y.clone()).filter(|y| y.iter().all(|v| v.is_finite()))
    }

    /// Derivatives, output by output, by all columns.
    fn partials(&mut self, theta: &[f64]) -> Option<Vec<f64>> {
        // a controller may have no parameter at all
        let stride = theta.len().next_multiple_of(8).max(8);
        let mut jacobian = vec![0.0; self.y.len() * stride];
        self.linear.evaluate(&theta[..self.params], &mut self.values).ok()?;
        let columns: Vec<usize> = (0..theta.len()).collect();
        let (ends, y) = (&theta[self.params..], &mut self.y);
        let sink = &mut |block: fdm::simulate::Block<'_>| block.copy_to(y, &mut jacobian, stride);
        self.response.sensitivities(&self.values, ends, &columns, sink).ok()?;
        Some(jacobian.chunks(stride).flat_map(|row| row[..theta.len()].to_vec()).collect())
    }

    /// The same by one unknown, by differences of fourth order; with their rounding.
    fn differences(&mut self, theta: &[f64], column: usize, share: f64) -> Option<(Vec<f64>, f64)> {
        let h = share * theta[column].abs().max(1e-2);
        let mut at = |steps: f64| {
            let mut moved = theta.to_vec();
            moved[column] += steps * h;
            self.outputs(&moved)
        };
        let (far, near) = ((at(2.0)?, at(-2.0)?), (at(1.0)?, at(-1.0)?));
        let largest = near.0.iter().fold(0.0, |a: f64, y| a.max(y.abs()));
        let of = |k: usize| (8.0 * (near.0[k] - near.1[k]) - (far.0[k] - far.1[k])) / (12.0 * h);
        Some(((0..near.0.len()).map(of).collect(), 1e-12 * largest / h))
    }
}

/// How many partials agree; none where the model has no response.
fn checked(name: &str, model: &Model, ends: &EndTerms, stretch: f64, normal: &mut Normal) -> Option<usize> {
    let structure = LinearModel::new(model).ok()?.structure().clone();
    let spectrum = spectrum(structure.inputs, structure.outputs, stretch, normal);
    let mut count = 0;
    for _ in 0..POINTS {
        let mut theta = near(model, normal);
        let Some(mut subject) = Subject::new(model, &theta, ends, &spectrum) else { continue };
        let unknown = subject.response.end_columns().len();
        theta.extend((0..unknown).map(|_| normal.next()));
        let Some(partials) = subject.partials(&theta) else { continue };
        for column in 0..theta.len() {
            let exact: Vec<f64> = partials.iter().skip(column).step_by(theta.len()).copied().collect();
            let mut worst = None;
            for share in STEPS {
                let Some((differences, rounding)) = subject.differences(&theta, column, share) else { continue };
                let size = differences.iter().fold(0.0, |a: f64, d| a.max(d.abs()));
                let off = |(exact, difference): (&f64, &f64)| (exact - difference).abs() / (1e-6 * size + rounding);
                let off = exact.iter().zip(&differences).map(off).fold(0.0, f64::max);
                worst = Some(worst.unwrap_or(f64::INFINITY).min(off));
                // beside a resonance that damping hardly widens, only short steps see a straight line
                if off <= 1.0 {
                    break;
                }
            }
            let Some(worst) = worst else { continue };
            assert!(worst <= 1.0, "{name}, column {column} of {}: {worst} times what is allowed", theta.len());
            count += exact.len();
        }
    }
    Some(count).filter(|count| *count > 0)
}

/// All models of the repository, in order.
fn models() -> BTreeMap<String, PathBuf> {
    let folders = std::fs::read_dir(support::repository().join("models"))
        .unwrap()
        .map(|f| f.unwrap().path())
        .filter(|f| f.is_dir());
    let files = folders.flat_map(|f| std::fs::read_dir(f).unwrap().map(|f| f.unwrap().path()));
    let models = files.filter(|f| f.extension().is_some_and(|e| e == "fdm"));
    let name = |file: &PathBuf| file.strip_prefix(support::repository()).unwrap().to_string_lossy().into_owned();
    models.map(|file| (name(&file), file)).collect()
}

/// With all parameters free: there are no derivatives by fixed ones.
fn freed(model: &Model) -> Model {
    let fixed = model.definition().params.iter().filter(|p| p.fixed && !p.is_recorded());
    let free = fixed.map(|p| p.quantity.name.clone()).collect();
    changed(model, &Changes { free, ..Changes::default() }).unwrap()
}

#[test]
fn every_partial_of_every_model() {
    let mut normal = Normal(5);
    let (mut found, mut without) = (BTreeMap::new(), Vec::new());
    for (name, path) in models() {
        let model = freed(&Model::from_file(&path).unwrap());
        let carried = model.carried().ok().filter(|(_, terms)| !terms.is_empty()).map(|(model, _)| model);
        let ways = [Some((name.clone(), model)), carried.map(|model| (format!("{name}, carried"), model))];
        for (name, model) in ways.into_iter().flatten() {
            let mut sum = 0;
            for (ends, stretch) in [(EndTerms::Unknown, 1.0), (EndTerms::Unknown, 1.07), (EndTerms::Known, 1.03)] {
                sum += checked(&name, &model, &ends, stretch, &mut normal).unwrap_or(0);
            }
            if sum > 0 {
                found.insert(name, sum);
            } else {
                without.push(name);
            }
        }
    }
    let all: usize = found.values().sum();
    println!("{all} partials of {} linear models; without one: {}", found.len(), without.join(", "));
    for name in ["miniature_helicopter/model", "hfb320/two_channels", "puma/model", "bo105/model", "delays/model"] {
        assert!(found.contains_key(&format!("models/{name}.fdm")), "{name}: {without:?}");
    }
    assert!(found.keys().any(|name| name.ends_with("carried")) && found.len() > 20);
}

/// The transform of the derivative of an input is `j w` times the input's own with its own end values: nothing is lost between samples.
#[test]
fn the_derivative_of_an_input_in_the_frequency_domain() {
    use fdm::spectrum::{Frequencies, SpectrumOptions};
    let text = "model m { input u; state x; param a = 1; der(x) = a*der(u) - x; output y = x; }";
    let model = Model::from_text("m.fdm", text).unwrap();
    let mut normal = Normal(3);
    let n = 203;
    let run = fdm::record::Run {
        name: "r".into(),
        time: (0..n).map(|k| 0.04 * f64::from(k)).collect(),
        inputs: (0..n).map(|_| 5.0 + normal.next()).collect(),
        held: vec![false],
        measured: (0..n).map(|_| normal.next()).collect(),
        input_gaps: vec![0],
        stated: Vec::new(),
        output_gaps: vec![0],
    };
    let run = run.with_measured(model.definition()).unwrap();
    let off_grid = Frequencies::Band { lowest: 0.2, highest: 12.0, spacing: Some(0.037) };
    for choice in [Frequencies::Grid { lowest: None, highest: None }, off_grid] {
        let s = Spectrum::of(&run, &choice, &SpectrumOptions::default()).unwrap();
        let (count, [before, behind]) = (s.omega.len(), &s.input_ends);
        for (k, w) in s.omega.iter().enumerate() {
            let [first, last] = s.end_factors(k);
            let want = Complex64::new(0.0, *w) * s.inputs[k] + last * behind[0] - first * before[0];
            let off = (s.inputs[count + k] - want).norm();
            assert!(off < 1e-12 * (1.0 + w), "{w}: {off:e}");
        }
    }
}
