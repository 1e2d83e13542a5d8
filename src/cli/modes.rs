//! `fdm modes`: eigenvalues of a model, linear or linearised at its trim.

use crate::failure::{Failure, NUMBERS, print};
use crate::reading::{Reading, open};
use crate::subject::{assignment, load_model};
use clap::Args;
use fdm::Model;
use fdm::estimate::Changes;
use fdm::linear::{LinearModel, ModeErrors, Modes, Trim, Values};
use fdm::report::{modes_json, modes_table};
use fdm::store::{ResultFolder, estimates};
use serde_json::{Value, json};
use std::path::PathBuf;
use std::process::ExitCode;

/// What `fdm modes` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Model file (.fdm); a result holds its own, and this must be the same
    #[arg(value_name = "MODEL", required_unless_present = "from_result")]
    model: Option<PathBuf>,
    /// Other value of a parameter
    #[arg(long = "set", value_name = "NAME=VALUE", value_parser = assignment, help_heading = "Parameters")]
    set: Vec<(String, f64)>,
    /// Take model and parameters from a result folder that `fdm fit --out` wrote; eigenvalues then have standard errors
    #[arg(long, value_name = "DIR", help_heading = "Parameters")]
    from_result: Option<PathBuf>,
    /// Run of the result whose own parameters are used, when it has several and they matter
    #[arg(long, value_name = "RUN", requires = "from_result", help_heading = "Parameters")]
    like: Option<String>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// Parameters as they were found, with their covariance.
struct Found {
    folder: Box<ResultFolder>,
    run: String,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let (model, found) = arguments.subject()?;
    let (trim, modes) = modes(&model)?;
    // regressions have no covariance of all parameters
    let found = found.filter(|found| found.folder.result()["covariance"].is_object());
    let covariance = found.map(|found| found.folder.covariance(&model, &found.run));
    let errors = covariance.map_or(Vec::new(), |covariance| errors(&model, &modes, &covariance));
    let text = match arguments.json {
        true => format!("{}\n", modes_json(&model, &trim, &modes, &errors)),
        false => modes_table(&model, &trim, &modes, &errors),
    };
    Ok(if print(&text) { ExitCode::SUCCESS } else { ExitCode::from(NUMBERS) })
}

impl Arguments {
    /// The model with the values that its parameters are to have.
    fn subject(&self) -> Result<(Model, Option<Found>), Failure> {
        let (model, found) = match (&self.from_result, &self.model) {
            (Some(folder), model) => {
                let Reading { folder, model } = open(folder, model.as_deref())?;
                let run = self.run(&folder, &model)?;
                (model, Some(Found { folder: Box::new(folder), run }))
            }
            (None, Some(model)) => (load_model(model)?, None),
            (None, None) => return Err(Failure::input(["a model or a result is needed"])),
        };
        let model = match &found {
            None => model,
            Some(Found { folder, run }) => {
                let theta = folder.theta(&model, run, self.like.as_deref()).map_err(|e| Failure::input([e]))?;
                with_estimates(&model, &theta, &folder.covariance(&model, run))
            }
        };
        let mut params = model.definition().params.clone();
        let changes = Changes { set: self.set.clone(), ..Changes::default() };
        changes.apply(&mut params).map_err(Failure::input)?;
        Ok((model.with_params(params), found))
    }

    /// The run whose own parameters are used: the one that was chosen; the first when the linear model depends on none of them.
    fn run(&self, folder: &ResultFolder, model: &Model) -> Result<String, Failure> {
        let first = folder.runs().into_iter().next().unwrap_or_default();
        if self.like.is_some() || folder.runs().len() < 2 {
            return Ok(self.like.clone().unwrap_or(first));
        }
        let own = own_parameters_move_rates(model)?;
        // a name that no run has: the folder says that one must be chosen
        Ok(if own { String::new() } else { first })
    }
}

/// Where a model is linearised at the values of its parameters, and its modes there.
fn modes(model: &Model) -> Result<(Trim, Modes), Failure> {
    let theta = model.definition().start();
    let mut linear = LinearModel::new(model).map_err(|e| Failure::input([e]))?;
    let mut values = Values::default();
    linear.evaluate(&theta, &mut values).map_err(|e| Failure::input([e]))?;
    let modes = Modes::new(linear.structure(), &values).map_err(|e| Failure::input([e]))?;
    Ok((linear.trim(&theta), modes))
}

fn errors(model: &Model, modes: &Modes, covariance: &[f64]) -> Vec<Option<ModeErrors>> {
    let p = model.definition().params.len();
    modes.modes.iter().map(|mode| mode.errors(|i, j| covariance[i * p + j])).collect()
}

/// States of the largest model whose modes are part of every result; larger ones are asked for.
const MOST_STATES: usize = 40;

/// The modes of a model as it was found, as part of its result; null where it has no states. Where they are left out the reason is
/// said.
pub(crate) fn of_result(model: &Model, result: &Value, runs: &[String]) -> Value {
    let states = model.layout().states;
    let Some(run) = runs.first().filter(|_| states > 0) else { return Value::Null };
    let left_out = |why: String| json!({ "modes": [], "left_out": why });
    if states > MOST_STATES {
        return left_out(format!(
            "the model has {states} states, and those of more than {MOST_STATES} are for `fdm modes --from-result DIR`"
        ));
    }
    if runs.len() > 1 && own_parameters_move_rates(model).unwrap_or(true) {
        return left_out("every run has modes of its own, which `fdm modes --from-result DIR --like RUN` tells".into());
    }
    let (theta, covariance) = estimates(model, result, run);
    let found = with_estimates(model, &theta, &covariance);
    match modes(&found) {
        Ok((trim, modes)) => {
            // regressions have no covariance of all parameters
            let known = result["covariance"].is_object();
            let errors = if known { errors(&found, &modes, &covariance) } else { Vec::new() };
            modes_json(&found, &trim, &modes, &errors)
        }
        Err(Failure::Input(reasons)) => left_out(reasons.join("; ")),
        Err(_) => left_out("the model cannot be linearised".into()),
    }
}

/// The model with values as they were found.
fn with_estimates(model: &Model, theta: &[f64], covariance: &[f64]) -> Model {
    let mut params = model.definition().params.clone();
    for (k, param) in params.iter_mut().enumerate() {
        param.value = theta[k];
        // what the fit estimated has derivatives, whatever the model's text says of it
        param.fixed &= covariance[k * theta.len() + k] == 0.0;
    }
    model.with_params(params)
}

/// Whether a parameter of single runs has a part in the linear model's rates.
fn own_parameters_move_rates(model: &Model) -> Result<bool, Failure> {
    let linear = LinearModel::new(model).map_err(|e| Failure::input([e]))?;
    let s = linear.structure();
    let of_rates = |k: &u32| (s.terms[*k as usize].row as usize) < s.states;
    let moved = s.slopes.iter().filter(|l| of_rates(&l.term)).map(|l| l.param);
    let mut moved = moved.chain(s.tau_slopes.iter().map(|l| l.param));
    Ok(moved.any(|p| model.definition().params[p as usize].per_run))
}
