//! `fdm simulate`: the model's response over recorded inputs.

use crate::bands::{beyond_visited, edges, of_coloured_noise, of_simulation};
use crate::campaign::{RecordFile, Role};
use crate::deliver::{column, csv, write};
use crate::failure::{Ending, Failure, OrFailure, as_json, aside, ended, print_data, print_lines, remark};
use crate::load::{ModelOrResult, RunList, Selection, positive, read_runs, with_files};
use crate::options::Integration;
use crate::ownership::{Overwriting, refuse_other_tables};
use clap::Args;
use fdm_estimate::{FitOptions, Work, initial_guess, initial_values};
use fdm_lab::posterior::Bands;
use fdm_results::documents::{ChannelDocument, Diverged, ResponseDocument};
use fdm_results::store::{DataFile, ResultError, ResultFolder};
use fdm_system::Model;
use fdm_system::record::{ReadOptions, Run};
use fdm_system::simulate::{
    Accuracy, Divergence, Simulator, StepOptions, Steps, UNSOUND, WorstError, choose_steps, integration_error,
    worst_errors,
};
use std::path::{Path, PathBuf};

/// What `fdm simulate` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    pub(crate) model: ModelOrResult,
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
    #[command(flatten)]
    pub(crate) integration: Integration,
    /// 95 % bands beside every output
    ///
    /// Of the response by the errors of the parameters (`y_low`, `y_high`), and of a measurement by these and the noise
    /// (`y_measured_low`, `y_measured_high`).
    #[arg(long, requires = "from_result", help_heading = "Result")]
    bands: bool,
    /// Print JSON instead of CSV
    #[arg(long, conflicts_with = "output", help_heading = "Result")]
    json: bool,
    /// Write CSV to a file instead of to the terminal; `-` for standard output
    #[arg(short, long, value_name = "FILE", help_heading = "Result")]
    output: Option<PathBuf>,
    #[command(flatten)]
    overwriting: Overwriting,
}

/// One run's response.
pub(crate) struct Response<'a> {
    run: &'a Run,
    pub(crate) accuracy: Accuracy,
    /// All parameters.
    theta: Vec<f64>,
    /// Outputs (N by q); NaN behind a divergence.
    pub(crate) y: Vec<f64>,
    divergence: Option<Divergence>,
    /// Of what is predicted, where they were asked for.
    bands: Option<Bands>,
    /// Where the integration error is above 1e-3 of an output's range, the worst output first.
    wrong: Vec<WorstError>,
}

pub(crate) fn run(arguments: &Arguments) -> Ending {
    let (model, folder) = arguments.model.load()?;
    let model = if folder.is_none() { arguments.list.grouped(&model, &arguments.selection)? } else { model };
    let (model, folder) = (arguments.model.changed(&model)?, folder.as_ref());
    let files = arguments.files(&model)?;
    let runs = match folder {
        Some(folder) if files.is_empty() => fitted_runs(folder, arguments.like.as_deref(), &model)?,
        _ => read_runs(&files, &model, &[], true)?,
    };
    if runs.len() > 1 && !arguments.json {
        return Err(Failure::input([
            "several runs do not fit into one table: simulate them one by one, or use --json",
        ]));
    }
    let file = arguments.output.as_deref().filter(|path| *path != Path::new("-"));
    if let (Some(path), false) = (file, arguments.overwriting.force) {
        refuse_other_tables(path, &header(&model))?;
    }
    let responses: Vec<Response<'_>> =
        runs.iter().map(|run| respond(&model, run, folder, arguments)).collect::<Result<_, _>>()?;
    let mut good = match &responses[..] {
        _ if arguments.json => {
            print_lines(&as_json(&responses.iter().map(|r| document(&model, r)).collect::<Vec<_>>())?)
        }
        [response] => table(&model, response, file)?,
        _ => true,
    };
    for response in &responses {
        if model.layout().states > 0 && !arguments.json {
            aside(format_args!("{}: {}", response.run.name, arguments.integration.said(&response.accuracy)));
        }
        response.doubts(&model, folder).iter().for_each(|said| remark(format_args!("{said}")));
        for said in response.faults(&model) {
            remark(format_args!("{}", with_files(&said)));
            good = false;
        }
    }
    ended(good)
}

impl Response<'_> {
    /// What makes them less certain than they look.
    fn doubts(&self, model: &Model, folder: Option<&ResultFolder>) -> Vec<String> {
        let Some(folder) = folder.filter(|_| self.divergence.is_none()) else { return Vec::new() };
        let mut doubts = beyond_visited(folder, model, (self.run, &self.theta), &self.accuracy.steps);
        doubts.extend(self.bands.as_ref().and_then(|_| of_coloured_noise(folder)));
        doubts
    }

    /// What makes the numbers wrong.
    pub(crate) fn faults(&self, model: &Model) -> Vec<String> {
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

impl Arguments {
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
pub(crate) fn fitted_runs(folder: &ResultFolder, like: Option<&str>, model: &Model) -> Result<Vec<Run>, Failure> {
    let manifest = folder.manifest();
    let wanted: Vec<&DataFile> = manifest.data.iter().filter(|d| like.is_none_or(|l| d.run == l)).collect();
    let (mut files, mut wrong) = (Vec::new(), Vec::new());
    for data in &wanted {
        let path = PathBuf::from(data.path.as_ref().unwrap_or(&data.file));
        if DataFile::new(&data.run, &path).is_same(data) {
            let reading = data.reading.as_ref().unwrap_or(&manifest.reading).clone();
            let options = ReadOptions { require_outputs: false, any_size: true, ..reading };
            files.push(RecordFile { path, name: Some(data.run.clone()), role: Role::Fit, options });
        } else {
            let file = path.display();
            wrong.push(format!(
                "{file}: changed or removed since run `{}` was fitted; give the record with --data",
                data.run
            ));
        }
    }
    if let (Some(like), true) = (like, wanted.is_empty()) {
        return Err(Failure::input([ResultError::NoRun { run: like.into(), fitted: folder.runs() }]));
    }
    if !wrong.is_empty() {
        return Err(Failure::Input(wrong));
    }
    let mut runs = read_runs(&files, model, &[], true)?;
    // as the fit called them, where files share a name
    runs.iter_mut().zip(&wanted).for_each(|(run, data)| run.name.clone_from(&data.run));
    Ok(runs)
}

/// All parameters of a run.
fn theta(model: &Model, run: &Run, folder: Option<&ResultFolder>, arguments: &Arguments) -> Result<Vec<f64>, Failure> {
    let mut theta = match folder {
        None => initial_guess(&model.definition().params, model.dynamics(), run),
        Some(folder) => folder.theta(model, &run.name, arguments.like.as_deref()).or_failure()?,
    };
    if let Some(length) = arguments.initial_from {
        let mut params = model.definition().params.clone();
        params.iter_mut().zip(&theta).for_each(|(param, value)| param.value = *value);
        let options = arguments.integration.among(FitOptions::default());
        let runs = std::slice::from_ref(run);
        let own = initial_values(&model.with_params(params), runs, length, &options, &Work::default()).or_failure()?;
        own.into_iter().for_each(|values| theta = values);
    }
    for (value, param) in theta.iter_mut().zip(&model.definition().params) {
        if arguments.model.set.iter().any(|(name, _)| *name == param.quantity.name) {
            *value = param.value;
        }
    }
    Ok(theta)
}

pub(crate) fn respond<'a>(
    model: &Model,
    run: &'a Run,
    folder: Option<&ResultFolder>,
    arguments: &Arguments,
) -> Result<Response<'a>, Failure> {
    let theta = theta(model, run, folder, arguments)?;
    let unsuited = |e| Failure::input([format!("run `{}`: {e}", run.name)]);
    let scheme = arguments.integration.scheme();
    let dynamics = model.dynamics();
    let mut accuracy = match (arguments.integration.per_interval(), arguments.fitted_steps(&run.name, folder), scheme) {
        (Some(steps), ..) => Accuracy { steps: Steps::equal(scheme.unwrap_or_default(), steps), error: f64::NAN },
        (None, Some(fitted), None) => fitted,
        _ => {
            let accuracy = arguments.integration.accuracy();
            let options = StepOptions { scheme, once: accuracy.is_none(), ..StepOptions::default() };
            choose_steps(dynamics, run, &theta, &options.to(accuracy)).map_err(unsuited)?
        }
    };
    let mut simulator = Simulator::new(model.dynamics(), run, accuracy.steps.clone()).map_err(unsuited)?;
    simulator.suits(&theta).map_err(unsuited)?;
    let mut y = vec![f64::NAN; run.len() * model.layout().outputs];
    let divergence = simulator.simulate(&theta, &mut y).err();
    if accuracy.error.is_nan() && divergence.is_none() {
        accuracy.error = integration_error(dynamics, run, &theta, accuracy.steps.clone()).map_err(unsuited)?;
    }
    let wrong = match accuracy.error > UNSOUND && divergence.is_none() {
        true => worst_errors(dynamics, run, &theta, &accuracy.steps, UNSOUND).map_err(unsuited)?,
        false => Vec::new(),
    };
    let bands = match folder.filter(|_| arguments.bands && divergence.is_none()) {
        Some(folder) => {
            let like = arguments.like.clone().or_else(|| folder.runs().into_iter().find(|r| *r == run.name));
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

/// The first line of the table.
fn header(model: &Model) -> Vec<u8> {
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

/// Writes or prints the outputs; says whether all was printed.
fn table(model: &Model, response: &Response<'_>, file: Option<&Path>) -> Result<bool, Failure> {
    let table = csv(&columns(model, response));
    match file {
        Some(path) => Ok(write(path, table).map(|()| true)?),
        None => Ok(print_data(&String::from_utf8_lossy(&table))),
    }
}

fn document(model: &Model, response: &Response<'_>) -> ResponseDocument {
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
