//! `fdm modes`: eigenvalues of a model, linear or linearised at its trim.

use crate::failure::{Ending, Failure, OrFailure, as_json, ended, print, print_lines};
use crate::load::ModelOrResult;
use clap::Args;
pub(crate) use fdm_lab::requirement::with_estimates;
use fdm_report::modes_table;
use fdm_results::documents::{ModesDocument, ResultDocument};
use fdm_results::store::ResultFolder;
use fdm_system::Model;
use fdm_system::linear::{LinearModel, ModeErrors, Modes, Trim, Values};

/// What `fdm modes` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    model: ModelOrResult,
    /// Run of the result whose per-run parameters are used, if it has several and the modes depend on them
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

pub(crate) fn run(arguments: &Arguments) -> Ending {
    let (model, found) = arguments.subject()?;
    let (trim, modes) = modes(&model)?;
    let covariance = found.and_then(|found| found.folder.result().covariance(&model, &found.run));
    let errors = covariance.map_or(Vec::new(), |covariance| errors(&model, &modes, &covariance));
    let document = ModesDocument::of(&model, &trim, &modes, &errors);
    ended(match arguments.json {
        true => print_lines(&as_json(&document)?),
        false => print(&modes_table(&document)),
    })
}

impl Arguments {
    /// The model with the values that its parameters are to have.
    fn subject(&self) -> Result<(Model, Option<Found>), Failure> {
        let (model, folder) = self.model.load()?;
        let Some(folder) = folder else { return Ok((self.model.changed(&model)?, None)) };
        let run = self.run(&folder, &model)?;
        let theta = folder.theta(&model, &run, self.like.as_deref()).or_failure()?;
        let model = with_estimates(&model, &theta, folder.result().covariance(&model, &run).as_deref());
        Ok((self.model.changed(&model)?, Some(Found { folder: Box::new(folder), run })))
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
pub(crate) fn modes(model: &Model) -> Result<(Trim, Modes), Failure> {
    let theta = model.definition().start();
    let mut linear = LinearModel::new(model).or_failure()?;
    let mut values = Values::default();
    linear.evaluate(&theta, &mut values).or_failure()?;
    let modes = Modes::new(linear.structure(), &values).or_failure()?;
    Ok((linear.trim(&theta), modes))
}

fn errors(model: &Model, modes: &Modes, covariance: &[f64]) -> Vec<Option<ModeErrors>> {
    let p = model.definition().params.len();
    modes.modes.iter().map(|mode| mode.errors(|i, j| covariance[i * p + j])).collect()
}

/// States of the largest model whose modes are part of every result; larger ones are asked for.
const MOST_STATES: usize = 40;

/// The modes of a model as it was found, as part of its result; none where it has no states. Where they are left out the reason is
/// said.
pub(crate) fn of_result(model: &Model, result: &ResultDocument, runs: &[String]) -> Option<ModesDocument> {
    let states = model.layout().states;
    let run = runs.first().filter(|_| states > 0)?;
    if states > MOST_STATES {
        return Some(ModesDocument::without(format!(
            "the model has {states} states, more than {MOST_STATES}: `fdm modes --from-result DIR` shows its modes"
        )));
    }
    if runs.len() > 1 && own_parameters_move_rates(model).unwrap_or(true) {
        let why = "every run has its own modes: `fdm modes --from-result DIR --like RUN` shows them";
        return Some(ModesDocument::without(why));
    }
    let covariance = result.covariance(model, run);
    let found = with_estimates(model, &result.theta(model, run), covariance.as_deref());
    Some(match modes(&found) {
        Ok((trim, modes)) => {
            let errors = covariance.map_or(Vec::new(), |covariance| errors(&found, &modes, &covariance));
            ModesDocument::of(&found, &trim, &modes, &errors)
        }
        Err(Failure::Input(reasons)) => ModesDocument::without(reasons.join("; ")),
        Err(_) => ModesDocument::without("the model cannot be linearised"),
    })
}

/// Whether a parameter of single runs has a part in the linear model's rates.
pub(crate) fn own_parameters_move_rates(model: &Model) -> Result<bool, Failure> {
    let linear = LinearModel::new(model).or_failure()?;
    let s = linear.structure();
    let of_rates = |k: &u32| (s.terms[*k as usize].row as usize) < s.states;
    let moved = s.slopes.iter().filter(|l| of_rates(&l.term)).map(|l| l.param);
    let mut moved = moved.chain(s.tau_slopes.iter().map(|l| l.param));
    Ok(moved.any(|p| model.definition().params[p as usize].per_run))
}
