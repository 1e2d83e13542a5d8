//! `fdm simulate`: the model's response over recorded inputs.

use crate::failure::{Failure, NUMBERS, print};
use crate::integrator::{Integrator, integration};
use crate::records::Records;
use crate::subject::Subject;
use clap::Args;
use fdm::Model;
use fdm::estimate::initial_guess;
use fdm::record::{Column, Dialect, Run, write, write_to};
use fdm::simulate::{Accuracy, Divergence, Simulator, Steps, choose_steps_by};
use serde_json::json;
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::process::ExitCode;

/// What `fdm simulate` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    subject: Subject,
    #[command(flatten)]
    records: Records,
    /// Equal steps between samples, instead of as many as accuracy needs
    #[arg(long, value_name = "N")]
    steps: Option<NonZeroUsize>,
    /// How to integrate: `auto` takes the stiff method (Radau) where the explicit one would cost more
    #[arg(long, value_enum, default_value_t)]
    integrator: Integrator,
    /// Print JSON
    #[arg(long, conflicts_with = "output")]
    json: bool,
    /// Write CSV to a file instead of to the terminal
    #[arg(short, long, value_name = "FILE")]
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

#[allow(clippy::print_stderr, reason = "this is where the command line speaks")]
pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let model = arguments.subject.load()?;
    let mut params = model.definition().params.clone();
    arguments.subject.changes(&[], &[]).apply(&mut params).map_err(Failure::input)?;
    let model = model.with_params(params);
    let runs = arguments.records.load(&model, false)?;
    if runs.len() > 1 && !arguments.json {
        return Err(Failure::input([
            "several runs do not fit into one table: simulate them one by one, or use --json",
        ]));
    }
    let responses: Vec<Response<'_>> =
        runs.iter().map(|(run, _)| respond(&model, run, arguments)).collect::<Result<_, _>>()?;
    if arguments.json {
        print(&format!("{}\n", json!(responses.iter().map(|r| as_json(&model, r)).collect::<Vec<_>>())));
    } else if let [response] = &responses[..] {
        table(&model, response, arguments.output.as_ref())?;
    }
    let mut code = ExitCode::SUCCESS;
    for response in &responses {
        let chosen = arguments.steps.is_none() && arguments.integrator.scheme().is_none();
        if model.layout().states > 0 && !arguments.json {
            eprintln!("{}: {}", response.run.name, integration(&response.accuracy, chosen));
        }
        if let Some(d) = response.divergence {
            let state = d.state.map_or(String::from("an output"), |s| {
                format!("state `{}`", model.definition().states[s].quantity.name)
            });
            eprintln!("run `{}` diverges: {state} is not finite at time {}", response.run.name, d.time);
            code = ExitCode::from(NUMBERS);
        }
    }
    Ok(code)
}

fn respond<'a>(model: &Model, run: &'a Run, arguments: &Arguments) -> Result<Response<'a>, Failure> {
    let mut theta = initial_guess(&model.definition().params, model.dynamics(), run);
    for (value, param) in theta.iter_mut().zip(&model.definition().params) {
        if arguments.subject.set.iter().any(|(name, _)| *name == param.quantity.name) {
            *value = param.value;
        }
    }
    let unsuited = |e| Failure::input([format!("run `{}`: {e}", run.name)]);
    let scheme = arguments.integrator.scheme();
    let accuracy = match arguments.steps {
        Some(steps) => Accuracy { steps: Steps::equal(scheme.unwrap_or_default(), steps.get()), error: f64::NAN },
        None => choose_steps_by(model.dynamics(), run, &theta, scheme).map_err(unsuited)?,
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

fn table(model: &Model, response: &Response<'_>, file: Option<&PathBuf>) -> Result<(), Failure> {
    let columns = columns(model, response);
    let columns: Vec<Column<'_>> =
        columns.iter().map(|(name, unit, values)| Column { name, unit: unit.as_deref(), values }).collect();
    match file {
        Some(path) => write(path, &columns).map_err(|e| Failure::Records(vec![e])),
        None => {
            let mut text = Vec::new();
            write_to(&mut text, Dialect::default(), &columns).map_err(|e| Failure::input([e]))?;
            print(&String::from_utf8_lossy(&text));
            Ok(())
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
