//! `fdm simulate`: the model's response over recorded inputs.

use crate::failure::{Failure, NUMBERS, print, remark};
use crate::integrator::{Integration, integration};
use crate::reading::{Reading, open};
use crate::records::{Selection, load};
use crate::subject::{assignment, load_model};
use clap::Args;
use fdm::Model;
use fdm::estimate::{Changes, initial_guess};
use fdm::record::{Column, Dialect, ReadOptions, Run, Summary, write, write_to};
use fdm::simulate::{Accuracy, Divergence, Simulator, Steps, choose_steps_by};
use fdm::store::{DataFile, ResultError, ResultFolder};
use serde_json::json;
use std::path::PathBuf;
use std::process::ExitCode;

/// What `fdm simulate` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Model file (.fdm); a result holds its own, and this must be the same
    #[arg(value_name = "MODEL", required_unless_present = "from_result")]
    model: Option<PathBuf>,
    /// Other value of a parameter (free initial values are called `x(0)`)
    #[arg(long = "set", value_name = "NAME=VALUE", value_parser = assignment, help_heading = "Parameters")]
    set: Vec<(String, f64)>,
    /// Take model and parameters from a result folder that `fdm fit --out` wrote
    #[arg(long, value_name = "DIR", help_heading = "Parameters")]
    from_result: Option<PathBuf>,
    /// Run of the result whose own parameters (biases, initial states) are used, instead of those of the run with the same
    /// name or of the only one
    #[arg(long, value_name = "RUN", requires = "from_result", help_heading = "Parameters")]
    like: Option<String>,
    /// Recorded run (CSV with a header `name [unit], ...`); may be given several times; those of the result when it is left
    /// out
    #[arg(long = "data", value_name = "RUN", required_unless_present = "from_result", help_heading = "Data")]
    data: Vec<PathBuf>,
    #[command(flatten)]
    selection: Selection,
    #[command(flatten)]
    integration: Integration,
    /// Print JSON instead of CSV
    #[arg(long, conflicts_with = "output", help_heading = "Result")]
    json: bool,
    /// Write CSV to a file instead of to the terminal
    #[arg(short, long, value_name = "FILE", help_heading = "Result")]
    output: Option<PathBuf>,
}

/// One run's response.
struct Response<'a> {
    run: &'a Run,
    accuracy: Accuracy,
    /// Outputs (N by q); NaN behind a divergence.
    y: Vec<f64>,
    divergence: Option<Divergence>,
}

/// Where the parameters come from.
enum Values {
    /// The model, and for free initial states the data.
    Declared,
    /// A fit.
    Found(Box<ResultFolder>),
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let (model, values) = arguments.subject()?;
    let mut params = model.definition().params.clone();
    let changes = Changes { set: arguments.set.clone(), ..Changes::default() };
    changes.apply(&mut params).map_err(Failure::input)?;
    let model = model.with_params(params);
    let runs = arguments.runs(&model, &values)?;
    if runs.len() > 1 && !arguments.json {
        return Err(Failure::input([
            "several runs do not fit into one table: simulate them one by one, or use --json",
        ]));
    }
    let responses: Vec<Response<'_>> =
        runs.iter().map(|(run, _)| respond(&model, run, &values, arguments)).collect::<Result<_, _>>()?;
    let printed = match &responses[..] {
        _ if arguments.json => {
            print(&format!("{}\n", json!(responses.iter().map(|r| as_json(&model, r)).collect::<Vec<_>>())))
        }
        [response] => table(&model, response, arguments.output.as_ref())?,
        _ => true,
    };
    let mut code = if printed { ExitCode::SUCCESS } else { ExitCode::from(NUMBERS) };
    for response in &responses {
        let chosen = arguments.integration.is_open();
        if model.layout().states > 0 && !arguments.json {
            remark(format_args!("{}: {}", response.run.name, integration(&response.accuracy, chosen)));
        }
        if let Some(d) = response.divergence {
            let state = d.state.map_or(String::from("an output"), |s| {
                format!("state `{}`", model.definition().states[s].quantity.name)
            });
            remark(format_args!("run `{}` diverges: {state} is not finite at time {}", response.run.name, d.time));
            code = ExitCode::from(NUMBERS);
        }
    }
    Ok(code)
}

impl Arguments {
    fn subject(&self) -> Result<(Model, Values), Failure> {
        match (&self.from_result, &self.model) {
            (Some(folder), model) => {
                let Reading { folder, model } = open(folder, model.as_deref())?;
                Ok((model, Values::Found(Box::new(folder))))
            }
            (None, Some(model)) => Ok((load_model(model)?, Values::Declared)),
            (None, None) => Err(Failure::input(["a model or a result is needed"])),
        }
    }

    /// The runs that are given, or those that the result was fitted to.
    fn runs(&self, model: &Model, values: &Values) -> Result<Vec<(Run, Summary)>, Failure> {
        match values {
            Values::Found(folder) if self.data.is_empty() => fitted_runs(folder, self.like.as_deref(), model),
            _ => load(&self.data, &self.selection.options(false), model),
        }
    }

    /// The steps of the fit, for a record that it was made from: the response is then the same to the bit.
    fn fitted_steps(&self, run: &str, values: &Values) -> Option<Accuracy> {
        let Values::Found(folder) = values else { return None };
        let manifest = folder.manifest();
        let fitted = manifest.data.iter().find(|d| d.run == run)?;
        let same_record = self.data.is_empty()
            || self.selection.options(true) == manifest.reading
                && self.data.iter().any(|file| DataFile::new(run, file).is_same(fitted));
        folder.integration(run).filter(|_| same_record && self.like.as_deref().is_none_or(|l| l == run))
    }
}

/// The files that a result was made from, unless they have changed since.
fn fitted_runs(folder: &ResultFolder, like: Option<&str>, model: &Model) -> Result<Vec<(Run, Summary)>, Failure> {
    let manifest = folder.manifest();
    let wanted: Vec<&DataFile> = manifest.data.iter().filter(|d| like.is_none_or(|l| d.run == l)).collect();
    let (mut files, mut wrong) = (Vec::new(), Vec::new());
    for data in &wanted {
        let path = PathBuf::from(data.path.as_ref().unwrap_or(&data.file));
        if DataFile::new(&data.run, &path).is_same(data) {
            files.push(path);
        } else {
            let file = path.display();
            wrong.push(format!(
                "{file}: changed or gone since run `{}` was fitted; give the record with --data",
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
    let options = ReadOptions { require_outputs: false, ..manifest.reading.clone() };
    let mut runs = load(&files, &options, model)?;
    // as the fit called them, where files share a name
    runs.iter_mut().zip(&wanted).for_each(|((run, _), data)| run.name.clone_from(&data.run));
    Ok(runs)
}

/// All parameters of a run.
fn theta(model: &Model, run: &Run, values: &Values, arguments: &Arguments) -> Result<Vec<f64>, Failure> {
    let mut theta = match values {
        Values::Declared => initial_guess(&model.definition().params, model.dynamics(), run),
        Values::Found(folder) => {
            folder.theta(model, &run.name, arguments.like.as_deref()).map_err(|e| Failure::input([e]))?
        }
    };
    for (value, param) in theta.iter_mut().zip(&model.definition().params) {
        if arguments.set.iter().any(|(name, _)| *name == param.quantity.name) {
            *value = param.value;
        }
    }
    Ok(theta)
}

fn respond<'a>(model: &Model, run: &'a Run, values: &Values, arguments: &Arguments) -> Result<Response<'a>, Failure> {
    let theta = theta(model, run, values, arguments)?;
    let unsuited = |e| Failure::input([format!("run `{}`: {e}", run.name)]);
    let scheme = arguments.integration.scheme();
    let accuracy =
        match (arguments.integration.steps, arguments.fitted_steps(&run.name, values).filter(|_| scheme.is_none())) {
            (Some(steps), _) => {
                Accuracy { steps: Steps::equal(scheme.unwrap_or_default(), steps.get()), error: f64::NAN }
            }
            (None, Some(fitted)) => fitted,
            (None, None) => choose_steps_by(model.dynamics(), run, &theta, scheme).map_err(unsuited)?,
        };
    let mut simulator = Simulator::new(model.dynamics(), run, accuracy.steps.clone()).map_err(unsuited)?;
    simulator.suits(&theta).map_err(unsuited)?;
    let mut y = vec![f64::NAN; run.len() * model.layout().outputs];
    let divergence = simulator.simulate(&theta, &mut y).err();
    Ok(Response { run, accuracy, y, divergence })
}

/// Time and outputs under their names and units.
fn columns(model: &Model, response: &Response<'_>) -> Vec<(String, Option<String>, Vec<f64>)> {
    let definition = model.definition();
    let q = definition.outputs.len();
    let time = ("t".to_string(), Some(definition.time.to_string()), response.run.time.clone());
    let output = |(o, output): (usize, &fdm_grammar::model::Output)| {
        let unit = output.quantity.unit.as_ref().map(ToString::to_string);
        (output.quantity.name.clone(), unit, response.y.iter().skip(o).step_by(q).copied().collect())
    };
    std::iter::once(time).chain(definition.outputs.iter().enumerate().map(output)).collect()
}

/// Writes or prints the outputs; says whether all was printed.
fn table(model: &Model, response: &Response<'_>, file: Option<&PathBuf>) -> Result<bool, Failure> {
    let columns = columns(model, response);
    let columns: Vec<Column<'_>> =
        columns.iter().map(|(name, unit, values)| Column { name, unit: unit.as_deref(), values }).collect();
    match file {
        Some(path) => write(path, &columns).map(|()| true).map_err(|e| Failure::Records(vec![e])),
        None => {
            let mut text = Vec::new();
            write_to(&mut text, Dialect::default(), &columns).map_err(|e| Failure::input([e]))?;
            Ok(print(&String::from_utf8_lossy(&text)))
        }
    }
}

fn as_json(model: &Model, response: &Response<'_>) -> serde_json::Value {
    let finite = |v: &f64| v.is_finite().then_some(*v);
    let channels: Vec<serde_json::Value> = columns(model, response)
        .iter()
        .map(|(name, unit, values)| json!({ "name": name, "unit": unit, "values": values.iter().map(finite).collect::<Vec<_>>() }))
        .collect();
    json!({
        "run": response.run.name,
        "channels": channels,
        "integrator": response.accuracy.steps.scheme().to_string(),
        "steps": response.accuracy.steps.total(response.run.len()),
        "steps_per_interval": response.accuracy.steps.most(),
        "integration_error": finite(&response.accuracy.error),
        "divergence": response.divergence.map(|d| json!({
            "time": d.time,
            "sample": d.sample,
            "state": d.state.map(|s| &model.definition().states[s].quantity.name),
        })),
    })
}
