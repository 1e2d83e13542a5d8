//! `fdm simulate`: the model's response over recorded inputs.

use crate::bands::{beyond_visited, edges, of_coloured_noise, of_simulation};
use crate::campaign::{RecordFile, Role};
use crate::failure::{Failure, OrFailure};
use crate::load::ModelOrResult;
use crate::options::Integration;
use crate::records::{RunList, Selection, read_runs};
use crate::tables::{column, csv};
use crate::value::positive;
use clap::Args;
use fdm_estimate::{FitOptions, Work, initial_guess, initial_values};
use fdm_lab::posterior::Bands;
use fdm_results::documents::{ChannelDocument, Diverged, ResponseDocument};
use fdm_results::store::{DataFile, Manifest, ResultError, ResultFolder};
use fdm_system::Model;
use fdm_system::record::{ReadOptions, Run};
use fdm_system::simulate::{
    Accuracy, Divergence, Simulator, StepOptions, Steps, UNSOUND, Unsuited, WorstError, choose_steps,
    integration_error, worst_errors,
};
use std::path::{Path, PathBuf};

/// What a simulation works with.
#[derive(Debug, Args)]
pub struct Options {
    /// The model or the result.
    #[command(flatten)]
    pub model: ModelOrResult,
    /// Run of the result whose per-run parameters are used
    ///
    /// Biases and initial states [default: those of the run with the same name, or of the only one].
    #[arg(long, value_name = "RUN", requires = "from_result", help_heading = "Parameters")]
    like: Option<String>,
    /// Recorded runs, as those behind the model
    ///
    /// CSV with a header `name [unit], ...`, or patterns; may be given several times [default: those of the result].
    #[arg(long = "data", value_name = "RUN", required_unless_present_any = ["from_result", "runs"], help_heading = "Data", num_args = 1.., group = "recorded")]
    data: Vec<PathBuf>,
    #[command(flatten)]
    list: RunList,
    #[command(flatten)]
    selection: Selection,
    /// Estimate what is the run's own (free initial values, biases) from the first samples of its measured outputs, in the model's unit
    /// of time [default: initial values from the first sample of outputs that show them]
    #[arg(long, value_name = "TIME", value_parser = positive, allow_negative_numbers = true, help_heading = "Data", hide_short_help = true)]
    initial_from: Option<f64>,
    /// How runs are integrated.
    #[command(flatten)]
    pub integration: Integration,
    /// 95 % bands beside every output
    ///
    /// Of the response by the errors of the parameters (`y_low`, `y_high`), and of a measurement by these and the noise
    /// (`y_measured_low`, `y_measured_high`).
    #[arg(long, requires = "from_result", help_heading = "Result")]
    bands: bool,
}

/// What is simulated.
pub struct Subject {
    /// The model with the values that were typed.
    pub model: Model,
    /// The result, when one was named.
    pub folder: Option<ResultFolder>,
    /// The runs.
    pub runs: Vec<Run>,
}

/// One run's response.
pub struct Response<'a> {
    /// The run.
    pub run: &'a Run,
    /// How it is integrated.
    pub accuracy: Accuracy,
    /// All parameters.
    theta: Vec<f64>,
    /// Outputs (N by q); NaN behind a divergence.
    pub y: Vec<f64>,
    divergence: Option<Divergence>,
    /// Of what is predicted, where they were asked for.
    bands: Option<Bands>,
    /// Where the integration error is above 1e-3 of an output's range, the worst output first.
    wrong: Vec<WorstError>,
}

impl Response<'_> {
    /// What makes them less certain than they look.
    pub fn doubts(&self, model: &Model, folder: Option<&ResultFolder>) -> Vec<String> {
        let Some(folder) = folder.filter(|_| self.divergence.is_none()) else { return Vec::new() };
        let mut doubts = beyond_visited(folder, model, (self.run, &self.theta), &self.accuracy.steps);
        doubts.extend(self.bands.as_ref().and_then(|_| of_coloured_noise(folder)));
        doubts
    }

    /// What makes the numbers wrong.
    pub fn faults(&self, model: &Model) -> Vec<String> {
        let name = &self.run.name;
        let diverges = self.divergence.map(|d| {
            if let Some(event) = d.event {
                return format!("run `{name}` ends at time {}: {event}", d.time);
            }
            let state = d.state.map_or(String::from("an output"), |s| {
                format!("state `{}`", model.definition().states[s].quantity.name)
            });
            format!("run `{name}` diverges: {state} is not finite at time {}", d.time)
        });
        let wrong =
            self.wrong.first().map(|worst| format!("run `{name}` is not integrated: {}", said(model, self.run, worst)));
        diverges.into_iter().chain(wrong).collect()
    }
}

impl Options {
    /// The model, the result when one was named, and the runs.
    ///
    /// # Errors
    /// [`Failure`]
    pub fn subject(&self) -> Result<Subject, Failure> {
        let (model, folder) = self.model.load()?;
        let model = if folder.is_none() { self.list.grouped(&model, &self.selection)? } else { model };
        let model = self.model.changed(&model)?;
        let files = self.files(&model)?;
        let runs = match &folder {
            Some(folder) if files.is_empty() => fitted_runs(folder, self.like.as_deref(), &model)?,
            _ => read_runs(&files, &model, &[], true)?,
        };
        Ok(Subject { model, folder, runs })
    }

    /// The files that are named.
    fn files(&self, model: &Model) -> Result<Vec<RecordFile>, Failure> {
        let options = ReadOptions { any_size: true, ..self.selection.options(false) };
        self.list.files((&self.data, Role::Fit), &options, model)
    }

    /// The steps of the fit, for a record that it was made from: the response is then the same to the bit.
    fn fitted_steps(&self, run: &str, folder: Option<&ResultFolder>) -> Option<Accuracy> {
        let folder = folder?;
        let manifest = folder.manifest();
        let fitted = manifest.data.iter().find(|d| d.run == run)?;
        let reading = fitted.reading.as_ref().unwrap_or(&manifest.reading);
        let same_record = self.data.is_empty() && !self.list.is_given()
            || self.selection.options(true) == *reading
                && self.data.iter().any(|file| DataFile::new(run, file).is_same(fitted));
        folder.integration(run).filter(|_| same_record && self.like.as_deref().is_none_or(|l| l == run))
    }
}

/// The files that a result was made from, unless they have changed since.
///
/// # Errors
/// [`Failure`]
pub fn fitted_runs(folder: &ResultFolder, like: Option<&str>, model: &Model) -> Result<Vec<Run>, Failure> {
    let manifest = folder.manifest();
    let wanted: Vec<&DataFile> = manifest.data.iter().filter(|d| like.is_none_or(|l| d.run == l)).collect();
    if let (Some(like), true) = (like, wanted.is_empty()) {
        return Err(Failure::input([ResultError::NoRun { run: like.into(), fitted: folder.runs() }]));
    }
    let changed = |path: &Path, run: &str| {
        format!("{}: changed or removed since run `{run}` was fitted; give the record with --data", path.display())
    };
    let files = unchanged(manifest, &wanted, Role::Fit, &changed)?;
    let mut runs = read_runs(&files, model, &[], true)?;
    // as the fit called them, where files share a name
    runs.iter_mut().zip(&wanted).for_each(|(run, data)| run.name.clone_from(&data.run));
    Ok(runs)
}

/// Files that a result was made from, for runs of this role; `changed` says that one is no longer as it was.
///
/// # Errors
/// [`Failure::Input`]
pub fn unchanged(
    manifest: &Manifest,
    wanted: &[&DataFile],
    role: Role,
    changed: &dyn Fn(&Path, &str) -> String,
) -> Result<Vec<RecordFile>, Failure> {
    let (mut files, mut wrong) = (Vec::new(), Vec::new());
    for data in wanted {
        let path = PathBuf::from(data.path.as_ref().unwrap_or(&data.file));
        if DataFile::new(&data.run, &path).is_same(data) {
            let reading = data.reading.as_ref().unwrap_or(&manifest.reading).clone();
            let options = ReadOptions { require_outputs: false, any_size: true, ..reading };
            files.push(RecordFile { path, name: Some(data.run.clone()), role, options });
        } else {
            wrong.push(changed(&path, &data.run));
        }
    }
    if wrong.is_empty() { Ok(files) } else { Err(Failure::Input(wrong)) }
}

/// All parameters of a run.
fn theta(model: &Model, run: &Run, folder: Option<&ResultFolder>, asked: &Options) -> Result<Vec<f64>, Failure> {
    let mut theta = match folder {
        None => initial_guess(&model.definition().params, model.dynamics(), run),
        Some(folder) => folder.theta(model, &run.name, asked.like.as_deref()).or_failure()?,
    };
    if let Some(length) = asked.initial_from {
        let mut params = model.definition().params.clone();
        params.iter_mut().zip(&theta).for_each(|(param, value)| param.value = *value);
        let options = asked.integration.among(FitOptions::default());
        let runs = std::slice::from_ref(run);
        let own = initial_values(&model.with_params(params), runs, length, &options, &Work::default()).or_failure()?;
        own.into_iter().for_each(|values| theta = values);
    }
    for (value, param) in theta.iter_mut().zip(&model.definition().params) {
        if asked.model.set.iter().any(|(name, _)| *name == param.quantity.name) {
            *value = param.value;
        }
    }
    Ok(theta)
}

/// A run whose response is asked for at other values again and again. Its steps are chosen once, at the first values, so that each response
/// takes one simulation.
pub struct Repeated<'a> {
    model: &'a Model,
    accuracy: Accuracy,
    /// All parameters, as they were first.
    theta: Vec<f64>,
    simulator: Simulator<'a>,
    samples: usize,
}

impl<'a> Repeated<'a> {
    /// Chooses the steps, and makes the simulator.
    ///
    /// # Errors
    /// [`Failure::Input`]
    pub fn new(
        model: &'a Model,
        run: &'a Run,
        folder: Option<&ResultFolder>,
        asked: &Options,
    ) -> Result<Self, Failure> {
        let theta = theta(model, run, folder, asked)?;
        let unsuited = |e| unsuited(run, e);
        let scheme = asked.integration.integrator;
        let accuracy = match (asked.integration.per_interval(), asked.fitted_steps(&run.name, folder), scheme) {
            (Some(steps), ..) => Accuracy { steps: Steps::equal(scheme.unwrap_or_default(), steps), error: f64::NAN },
            (None, Some(fitted), None) => fitted,
            _ => {
                let accuracy = asked.integration.integration_accuracy;
                let options = StepOptions { scheme, once: accuracy.is_none(), ..StepOptions::default() };
                choose_steps(model.dynamics(), run, &theta, &options.to(accuracy)).map_err(unsuited)?
            }
        };
        let mut simulator = Simulator::new(model.dynamics(), run, accuracy.steps.clone()).map_err(unsuited)?;
        simulator.suits(&theta).map_err(unsuited)?;
        Ok(Self { model, accuracy, theta, simulator, samples: run.len() })
    }

    /// All parameters, as they were first.
    pub fn theta(&self) -> &[f64] {
        &self.theta
    }

    /// Outputs (N by q) where these parameters have other values.
    ///
    /// # Errors
    /// [`Divergence`]; rows behind it are NaN.
    pub fn respond(&mut self, set: &[(String, f64)], y: &mut Vec<f64>) -> Result<(), Divergence> {
        let mut theta = self.theta.clone();
        for (value, param) in theta.iter_mut().zip(&self.model.definition().params) {
            if let Some((_, other)) = set.iter().find(|(name, _)| *name == param.quantity.name) {
                *value = *other;
            }
        }
        y.clear();
        y.resize(self.samples * self.model.layout().outputs, f64::NAN);
        self.simulator.simulate(&theta, y)
    }
}

fn unsuited(run: &Run, e: Unsuited) -> Failure {
    Failure::input([format!("run `{}`: {e}", run.name)])
}

/// The response of a run, at the parameters of the model or of a result.
///
/// # Errors
/// [`Failure::Input`]
pub fn respond<'a>(
    model: &Model,
    run: &'a Run,
    folder: Option<&ResultFolder>,
    asked: &Options,
) -> Result<Response<'a>, Failure> {
    let (dynamics, unsuited) = (model.dynamics(), |e| unsuited(run, e));
    let mut repeated = Repeated::new(model, run, folder, asked)?;
    let mut y = Vec::new();
    let divergence = repeated.respond(&[], &mut y).err();
    let Repeated { mut accuracy, theta, .. } = repeated;
    if accuracy.error.is_nan() && divergence.is_none() {
        accuracy.error = integration_error(dynamics, run, &theta, accuracy.steps.clone()).map_err(unsuited)?;
    }
    let wrong = match accuracy.error > UNSOUND && divergence.is_none() {
        true => worst_errors(dynamics, run, &theta, &accuracy.steps, UNSOUND).map_err(unsuited)?,
        false => Vec::new(),
    };
    let bands = match folder.filter(|_| asked.bands && divergence.is_none()) {
        Some(folder) => {
            let like = asked.like.clone().or_else(|| folder.runs().into_iter().find(|r| *r == run.name));
            let like = like.or_else(|| folder.runs().into_iter().next()).unwrap_or_default();
            let found = of_simulation(model, folder, (run, &like), &theta, accuracy.steps.clone());
            Some(found.map_err(|e| Failure::input([format!("run `{}`: {e}", run.name)]))?)
        }
        None => None,
    };
    Ok(Response { run, accuracy, theta, y, divergence, bands, wrong })
}

/// Where a response is worst, and what may help.
fn said(model: &Model, run: &Run, worst: &WorstError) -> String {
    let definition = model.definition();
    let output = &definition.outputs[worst.output].quantity.name;
    let state = worst
        .state
        .map_or(String::new(), |s| format!(", where state `{}` is farthest off", definition.states[s].quantity.name));
    if worst.part.is_infinite() {
        return format!(
            "with half of the steps the response is not finite at time {}{state}; give another method (--integrator), or a shorter record",
            run.time[worst.sample]
        );
    }
    format!(
        "the error is {:.0e} of the range of `{output}` at time {}{state}; take more steps (--steps), another method \
         (--integrator), or samples that are closer",
        worst.part, run.time[worst.sample]
    )
}

/// Time and outputs under their names and units, bands behind them.
fn columns(model: &Model, response: &Response<'_>) -> Vec<(String, Option<String>, Vec<f64>)> {
    let mut columns = table_of(model, &response.run.time, &response.y);
    let outputs = &model.definition().outputs;
    for (o, output) in outputs.iter().enumerate() {
        let Some(bands) = &response.bands else { break };
        let unit = output.quantity.unit.as_ref().map(ToString::to_string);
        let edges = edges(bands, &output.quantity.name, &response.y, o, outputs.len());
        columns.extend(edges.into_iter().map(|(name, values)| (name, unit.clone(), values)));
    }
    columns
}

/// A response as a table.
pub fn table(model: &Model, response: &Response<'_>) -> Vec<u8> {
    csv(&columns(model, response))
}

/// The first line of the table.
pub fn header(model: &Model) -> Vec<u8> {
    csv(&table_of(model, &[], &[]))
}

/// Times and outputs (N by q) under their names and units.
fn table_of(model: &Model, time: &[f64], y: &[f64]) -> Vec<(String, Option<String>, Vec<f64>)> {
    let definition = model.definition();
    let q = definition.outputs.len();
    let time = ("t".to_string(), Some(definition.time.to_string()), time.to_vec());
    let output = |(o, output): (usize, &fdm_grammar::model::Output)| {
        let unit = output.quantity.unit.as_ref().map(ToString::to_string);
        (output.quantity.name.clone(), unit, column(y, o, q))
    };
    std::iter::once(time).chain(definition.outputs.iter().enumerate().map(output)).collect()
}

/// A response for programs.
pub fn document(model: &Model, response: &Response<'_>) -> ResponseDocument {
    let finite = |v: &f64| v.is_finite().then_some(*v);
    let channel = |(name, unit, values): (String, Option<String>, Vec<f64>)| ChannelDocument {
        name,
        unit,
        values: values.iter().map(finite).collect(),
    };
    ResponseDocument {
        run: response.run.name.clone(),
        channels: columns(model, response).into_iter().map(channel).collect(),
        integrator: response.accuracy.steps.scheme().to_string(),
        steps: response.accuracy.steps.total(response.run.len()),
        steps_per_interval: response.accuracy.steps.most(),
        integration_error: finite(&response.accuracy.error),
        divergence: response.divergence.map(|d| Diverged {
            time: d.time,
            sample: d.sample,
            state: d.state.map(|s| model.definition().states[s].quantity.name.clone()),
        }),
    }
}
