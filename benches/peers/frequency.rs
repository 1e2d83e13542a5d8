//! W2f and W3f: the helicopter and the delayed second-order model in the frequency domain: responses and sensitivities,
//! normal equations, and whole fits.

use crate::clock::{Row, median_of_runs};
use crate::workload::{columnwise, data};
use fdm::Model;
use fdm::estimate::{
    DerivedQuantities, Estimate, Noise, NormalEquations, Options, PlanarResponse, Problem, ProblemRun, Response,
    RunResponse, TimeResponse, Work, estimate,
};
use fdm::frequency::{EndTerms, FrequencyResponse, Plans};
use fdm::linear::{LinearModel, Structure, Values};
use fdm::simulate::{Divergence, PlaneSink, Sink};
use fdm::spectrum::Spectrum;
use num_complex::Complex64;
use std::hint::black_box;
use std::sync::Arc;

/// The response of one run with the linear model that gives its coefficients.
struct Linear {
    model: LinearModel,
    values: Values,
    response: FrequencyResponse,
}

const NOT_FINITE: Divergence = Divergence { time: 0.0, state: None, sample: 0, event: None };

impl Linear {
    fn evaluated(&mut self, theta: &[f64]) -> Result<(), Divergence> {
        self.model.evaluate(theta, &mut self.values).map_err(|_| NOT_FINITE)
    }
}

impl Response for Linear {
    fn samples(&self) -> usize {
        2 * self.response.frequencies()
    }

    fn outputs(&self) -> usize {
        self.response.outputs()
    }

    fn simulate(&mut self, theta: &[f64], y: &mut [f64]) -> Result<(), Divergence> {
        self.evaluated(theta)?;
        self.response.simulate(&self.values, &[], y).map_err(|_| NOT_FINITE)
    }

    fn sensitivities(&mut self, theta: &[f64], columns: &[usize], sink: &mut Sink<'_>) -> Result<(), Divergence> {
        self.evaluated(theta)?;
        self.response.sensitivities(&self.values, &[], columns, sink).map_err(|_| NOT_FINITE)
    }

    fn planar(&mut self) -> Option<&mut dyn PlanarResponse> {
        Some(self)
    }
}

impl TimeResponse for Linear {}

impl PlanarResponse for Linear {
    fn planes(&mut self, theta: &[f64], columns: &[usize], sink: &mut PlaneSink<'_>) -> Result<(), Divergence> {
        self.evaluated(theta)?;
        self.response.planes(&self.values, &[], columns, sink).map_err(|_| NOT_FINITE)
    }
}

/// A workload of the peers' collection.
struct Workload {
    name: &'static str,
    model: Model,
    linear: LinearModel,
    structure: Arc<Structure>,
    /// The elimination, which belongs to the model as its linearisation does.
    plans: Arc<Plans>,
    spectra: Vec<(Spectrum, EndTerms)>,
    /// 5 % off the true parameters, as the reference has them.
    theta: Vec<f64>,
    reference: (Vec<f64>, Vec<f64>),
}

/// What a fit finds prepared, besides the compiled and linearised model.
#[derive(Clone, Copy)]
enum Prepared {
    Nothing,
    /// The symbolic elimination, which is the model's.
    Plans,
    /// The responses of all runs.
    Responses,
}

impl Prepared {
    const ALL: [Self; 3] = [Self::Nothing, Self::Plans, Self::Responses];
}

/// Complex numbers of one record, frequency by channel, as channel by frequency.
fn channels(numbers: &[f64], record: usize, count: usize, width: usize) -> Vec<Complex64> {
    let at = |k: usize, j: usize| 2 * ((record * count + k) * width + j);
    (0..width)
        .flat_map(|j| (0..count).map(move |k| (k, j)))
        .map(|(k, j)| at(k, j))
        .map(|i| Complex64::new(numbers[i], numbers[i + 1]))
        .collect()
}

impl Workload {
    fn load(name: &'static str, file: &str, tags: [&str; 7]) -> Option<Self> {
        let model = Model::from_file(file).expect("the model compiles");
        let linear = LinearModel::new(&model).expect("the model is linear");
        let structure = linear.structure().clone();
        let [f, u, z, e, p, y, j] = tags.map(data);
        let (f, u, z) = (f?, u?, z?);
        let (n, m, q, count) = (structure.states, structure.inputs, structure.outputs, f.len());
        let spectra = (0..u.len() / (2 * m * count)).map(|record| {
            let spectrum = Spectrum {
                name: format!("{record}"),
                omega: f.iter().map(|f| std::f64::consts::TAU * f).collect(),
                dt: 1.0,
                samples: 1,
                inputs: channels(&u, record, count, m),
                outputs: channels(&z, record, count, q),
                input_ends: [vec![0.0; m], vec![0.0; m]],
                output_ends: [vec![0.0; q], vec![0.0; q]],
                ..Spectrum::default()
            };
            let ends = match &e {
                Some(e) => EndTerms::Given(channels(e, record, count, n).iter().map(|e| -e).collect()),
                None => EndTerms::Omitted,
            };
            (spectrum, ends)
        });
        let spectra = spectra.collect();
        let plans = Arc::new(Plans::default());
        Some(Self { name, model, linear, structure, plans, spectra, theta: p?, reference: (y?, j?) })
    }

    fn responses(&self, plans: &Arc<Plans>) -> Vec<Linear> {
        let (mut model, mut values) = (self.linear.clone(), Values::default());
        model.evaluate(&self.theta, &mut values).expect("finite");
        let response = |(spectrum, ends): &(Spectrum, EndTerms)| {
            let response = FrequencyResponse::new(&self.structure, &values, spectrum, ends, plans).expect("suited");
            Linear { model: self.linear.clone(), values: values.clone(), response }
        };
        self.spectra.iter().map(response).collect()
    }

    fn problem(&self, start: f64, plans: &Arc<Plans>) -> Problem<'_> {
        let measured = |s: &Spectrum| -> Vec<f64> {
            let count = s.omega.len();
            let row = |k: usize, part: fn(&Complex64) -> f64| s.outputs.iter().skip(k).step_by(count).map(part);
            (0..count).flat_map(|k| row(k, |z| z.re).chain(row(k, |z| z.im))).collect()
        };
        let runs = self.responses(plans).into_iter().zip(&self.spectra).map(|(response, (spectrum, _))| ProblemRun {
            name: spectrum.name.clone(),
            response: RunResponse::in_time(response),
            measured: measured(spectrum),
            start: Vec::new(),
        });
        let derived = DerivedQuantities::of(self.model.definition(), self.model.dynamics());
        let mut problem = Problem::new(self.model.definition(), runs.collect(), derived);
        problem.params.iter_mut().for_each(|p| p.value *= start);
        problem
    }

    /// Outputs and Jacobian as the reference has them: frequency, output, column, part.
    fn evaluated(&self) -> (Vec<f64>, Vec<f64>) {
        let (q, p) = (self.structure.outputs, self.structure.params);
        let columns: Vec<usize> = (0..p).collect();
        let (mut all, mut packed) = (Vec::new(), Vec::new());
        for mut response in self.responses(&self.plans) {
            let stride = p.next_multiple_of(8);
            let samples = response.samples();
            let (mut y, mut jacobian) = (vec![0.0; samples * q], vec![0.0; samples * q * stride]);
            let mut sink = |block: fdm::simulate::Block<'_>| block.copy_to(&mut y, &mut jacobian, stride);
            response.sensitivities(&self.theta, &columns, &mut sink).expect("finite");
            for k in 0..samples / 2 {
                for o in 0..q {
                    let rows = [2 * k * q + o, (2 * k + 1) * q + o];
                    all.extend(rows.map(|r| y[r]));
                    (0..p).for_each(|c| packed.extend(rows.map(|r| jacobian[r * stride + c])));
                }
            }
        }
        (all, packed)
    }

    fn row(&self, what: &str, seconds: f64, difference: f64) -> Row {
        let (tool, what) = ("fdm (.fdm)".into(), what.into());
        Row { workload: self.name.into(), tool, what, seconds, difference: Some(difference) }
    }

    /// A: responses and sensitivities of all records in blocks of planes, from parameters to the last block.
    fn jacobian(&self) -> Row {
        let (y, jacobian) = self.evaluated();
        let (q, p) = (self.structure.outputs, self.structure.params);
        let off = columnwise(&jacobian, &self.reference.1, 2 * p).max(columnwise(&y, &self.reference.0, 2 * q));
        let columns: Vec<usize> = (0..p).collect();
        let mut responses = self.responses(&self.plans);
        let seconds = median_of_runs(|| {
            for response in &mut responses {
                let mut sink = |planes: fdm::simulate::Planes<'_>| _ = black_box(planes.derivatives);
                response.planes(black_box(&self.theta), &columns, &mut sink).expect("finite");
            }
        });
        self.row("A residual+jacobian (in blocks)", seconds, off)
    }

    /// A': the same folded into the normal equations.
    fn equations(&self) -> Row {
        let (q, p) = (self.structure.outputs, self.structure.params);
        let (y, jacobian) = (&self.reference.0, &self.reference.1);
        let measured: Vec<f64> = self
            .spectra
            .iter()
            .flat_map(|(s, _)| {
                let count = s.omega.len();
                (0..count).flat_map(move |k| s.outputs.iter().skip(k).step_by(count).flat_map(|z| [z.re, z.im]))
            })
            .collect();
        let deviations: Vec<f64> = (0..q)
            .map(|o| {
                let cells = (0..y.len()).filter(|i| i / 2 % q == o);
                (cells.map(|i| (measured[i] - y[i]).powi(2)).sum::<f64>() / (y.len() / q) as f64).sqrt()
            })
            .collect();
        let mut problem = self.problem(1.0, &self.plans);
        let mut equations = NormalEquations::new(&mut problem, &deviations);
        equations.evaluate(&self.theta).expect("finite");
        let (mut information, mut gradient) = (vec![0.0; p * p], vec![0.0; p]);
        for (cell, row) in jacobian.chunks_exact(2 * p).enumerate() {
            let weight = deviations[cell % q].powi(-2);
            for part in 0..2 {
                let residual = measured[2 * cell + part] - y[2 * cell + part];
                for i in 0..p {
                    gradient[i] += weight * row[2 * i + part] * residual;
                    (0..p).for_each(|j| information[i * p + j] += weight * row[2 * i + part] * row[2 * j + part]);
                }
            }
        }
        let size = gradient.iter().fold(0.0f64, |a, g| a.max(g.abs()));
        let off = equations.gradient().iter().zip(&gradient).map(|(a, b)| (a - b).abs() / size);
        let off = off.fold(columnwise(equations.information(), &information, p), f64::max);
        let seconds = median_of_runs(|| equations.evaluate(black_box(&self.theta)).expect("finite"));
        self.row("A' residual+jacobian+normal equations", seconds, off)
    }

    /// B: the whole fit, with what is prepared for it each time.
    fn fit(&self, noise: Noise, prepared: Prepared, cost: impl Fn(&Estimate) -> f64) -> Row {
        let options = Options { noise, tolerance: 1e-8, colour: false, ..Options::default() };
        let mut problem = self.problem(1.3, &self.plans);
        let mut solve = || {
            match prepared {
                Prepared::Nothing => problem = self.problem(1.3, &Arc::new(Plans::default())),
                Prepared::Plans => problem = self.problem(1.3, &self.plans),
                Prepared::Responses => {}
            }
            estimate(&mut problem, &options, &Work::default()).expect("the workload can be estimated")
        };
        let found = solve();
        assert!(found.is_good(), "{}", found.termination);
        let seconds = median_of_runs(|| _ = black_box(solve()));
        let what = match prepared {
            Prepared::Nothing => "B fit (elimination planned anew)",
            Prepared::Plans => "B fit",
            Prepared::Responses => "B fit (prepared once)",
        };
        self.row(what, seconds, cost(&found))
    }
}

/// W2f.
pub(crate) fn helicopter(limit: &[Row]) {
    for (name, tag) in [("w2f-581x1", "w2f581"), ("w2f-59x10", "w2f59")] {
        let tags = ["f", "U", "Z", "E", "p", "Y", "J"].map(|c| format!("{tag}_{c}"));
        let tags = tags.each_ref().map(String::as_str);
        let Some(workload) = Workload::load(name, "models/helicopter_benchmark/model.fdm", tags) else { continue };
        workload.jacobian().print(limit);
        workload.equations().print(limit);
        if tag == "w2f59" {
            // the variance of a complex coefficient is twice that of its parts
            let cost = |found: &Estimate| {
                let rows = || found.runs.iter().flat_map(|r| r.residuals.chunks_exact(9));
                let variance = |o: usize| 2.0 * rows().map(|r| r[o] * r[o]).sum::<f64>() / rows().count() as f64;
                (0..9).map(|o| variance(o).ln()).sum::<f64>()
            };
            for prepared in Prepared::ALL {
                workload.fit(Noise::Diagonal, prepared, cost).print(limit);
            }
        }
    }
}

/// W3f.
pub(crate) fn delay(limit: &[Row]) {
    let tags = ["w3_f", "w3_U", "w3_Z", "", "w3_p", "w3_Y", "w3_JF"];
    let Some(workload) = Workload::load("w3f", "models/second_order_delay/model.fdm", tags) else { return };
    workload.jacobian().print(limit);
    let cost = |found: &Estimate| found.runs[0].residuals.iter().map(|v| v * v).sum();
    for prepared in Prepared::ALL {
        workload.fit(Noise::Given(vec![Some(1.0)]), prepared, cost).print(limit);
    }
}
