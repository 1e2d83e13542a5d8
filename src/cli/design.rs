//! `fdm design`: which input, moved how, would tell in the next run what the runs so far do not.

use crate::failure::{Failure, NUMBERS, print, remark};
use crate::noise::noise;
use crate::progress::Progress;
use crate::reading::{Reading, open};
use crate::records::{Selection, load, notes};
use crate::subject::{assignment, load_model};
use clap::Args;
use fdm::Model;
use fdm::design::{Asked, Design, Question, design};
use fdm::estimate::{Noise, initial_guess};
use fdm::experiment::Amount;
use fdm::record::Run;
use fdm::report::{design_json, design_table};
use fdm::store::ResultFolder;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// What `fdm design` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Model file (.fdm), with the parameters' values as far as they are known; a result has its own
    #[arg(value_name = "MODEL", required_unless_present = "from_result")]
    model: Option<PathBuf>,
    /// Result folder that `fdm fit --out` wrote: values and noise are those that it found
    #[arg(long, value_name = "DIR", help_heading = "Data")]
    from_result: Option<PathBuf>,
    /// Run that was made already; may be given several times
    #[arg(long = "data", value_name = "RUN", help_heading = "Data")]
    data: Vec<PathBuf>,
    #[command(flatten)]
    selection: Selection,
    /// Other value of a parameter
    #[arg(long = "set", value_name = "NAME=VALUE", value_parser = assignment, help_heading = "The next run")]
    set: Vec<(String, f64)>,
    /// How far an input may move, in its unit or one of its own (`--move 'elevator=2 deg'`) [default: as far as it moved in the
    /// runs that were made]
    #[arg(long = "move", value_name = "INPUT=HEIGHT", value_parser = height, help_heading = "The next run")]
    heights: Vec<(String, Amount)>,
    /// Where an input stands before it moves [default: as the first run begins, or 0]
    #[arg(long = "rest", value_name = "INPUT=VALUE", value_parser = height, help_heading = "The next run")]
    rest: Vec<(String, Amount)>,
    /// Length of the next run, in the model's unit of time [default: that of the first run]
    #[arg(long, value_name = "TIME", allow_negative_numbers = true, help_heading = "The next run")]
    duration: Option<f64>,
    /// Time between its samples [default: that of the first run]
    #[arg(long, value_name = "TIME", allow_negative_numbers = true, help_heading = "The next run")]
    dt: Option<f64>,
    /// Standard deviation of the noise of an output [default: what the result found, or the model declares]
    #[arg(long, value_name = "OUTPUT=DEVIATION", help_heading = "The next run")]
    noise: Vec<String>,
    /// How many runs to plan, one after the other
    #[arg(long, value_name = "N", default_value_t = 2, allow_negative_numbers = true, help_heading = "The next run",
          value_parser = clap::value_parser!(u8).range(1..=50))]
    runs: u8,
    /// Write the inputs of the planned runs to this folder, ready to be flown
    #[arg(long, value_name = "DIR", help_heading = "Result")]
    records: Option<PathBuf>,
    /// Print JSON instead of tables
    #[arg(long, help_heading = "Result")]
    json: bool,
    /// Say nothing while working
    #[arg(short, long, help_heading = "Result")]
    quiet: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let (model, folder) = arguments.subject()?;
    let records = load(&arguments.data, &arguments.selection.options(false), &model)?;
    if !arguments.quiet {
        notes(&records);
    }
    let runs: Vec<Run> = records.into_iter().map(|(run, _)| run).collect();
    let question = arguments.question(&model, folder.as_ref(), runs)?;
    let progress = Progress::of_a_whole(arguments.quiet);
    progress.say("asking every manoeuvre what it would tell");
    let found = design(&question);
    progress.finish();
    let found = found.map_err(Failure::Input)?;
    let text = match arguments.json {
        true => format!("{}\n", design_json(&found)),
        false => design_table(&found, &model),
    };
    let mut good = print(&text);
    if let Some(folder) = &arguments.records {
        good &= written(&question, &found, folder);
    }
    Ok(if good { ExitCode::SUCCESS } else { ExitCode::from(NUMBERS) })
}

impl Arguments {
    fn subject(&self) -> Result<(Model, Option<ResultFolder>), Failure> {
        let (model, folder) = match (&self.from_result, &self.model) {
            (Some(folder), model) => {
                let Reading { folder, model } = open(folder, model.as_deref())?;
                (model, Some(folder))
            }
            (None, Some(model)) => (load_model(model)?, None),
            (None, None) => return Err(Failure::input(["a model or a result is needed"])),
        };
        let mut params = model.definition().params.clone();
        let changes = fdm::estimate::Changes { set: self.set.clone(), ..Default::default() };
        changes.apply(&mut params).map_err(Failure::input)?;
        Ok((model.with_params(params), folder))
    }

    /// All parameters: as declared, as found, as typed.
    fn theta(&self, model: &Model, folder: Option<&ResultFolder>, run: Option<&Run>) -> Vec<f64> {
        let params = &model.definition().params;
        let mut theta = match run {
            Some(run) => initial_guess(params, model.dynamics(), run),
            None => params.iter().map(|p| p.value).collect(),
        };
        for (value, param) in theta.iter_mut().zip(params) {
            let name = &param.quantity.name;
            let of_run =
                |owner: &Option<String>| owner.as_deref() == run.filter(|_| param.per_run).map(|r| r.name.as_str());
            let found = folder.and_then(|f| f.parameters().iter().find(|k| k.name == *name && of_run(&k.run)));
            if self.set.iter().any(|(typed, _)| typed == name) {
                *value = param.value;
            } else if let Some(found) = found.filter(|_| param.per_run == run.is_some() || !param.per_run) {
                *value = found.value;
            }
        }
        theta
    }

    fn question<'m>(
        &self,
        model: &'m Model,
        folder: Option<&ResultFolder>,
        runs: Vec<Run>,
    ) -> Result<Question<'m>, Failure> {
        let m = model.definition().inputs.len();
        let column = |run: &Run, k: usize| run.inputs.iter().skip(k).step_by(m).copied().collect::<Vec<f64>>();
        let first = runs.first();
        let mut rest: Vec<f64> = (0..m).map(|k| first.and_then(|r| r.inputs.get(k).copied()).unwrap_or(0.0)).collect();
        for (k, value) in placed(model, "--rest", &self.rest)? {
            rest[k] = value;
        }
        let moved = |k: usize| {
            let values = runs.iter().flat_map(|run| column(run, k));
            Some(values.map(|v| (v - rest[k]).abs()).fold(0.0, f64::max)).filter(|h| h.is_finite() && *h > 0.0)
        };
        let mut heights: Vec<Option<f64>> = (0..m).map(moved).collect();
        if !self.heights.is_empty() {
            heights.fill(None);
        }
        for (k, value) in placed(model, "--move", &self.heights)? {
            heights[k] = Some(value);
        }
        let last = |run: &Run| run.time.last().copied().filter(|t| *t > 0.0);
        let duration = self.duration.or(first.and_then(last));
        let apart = |run: &Run| Some(last(run)? / (run.len().max(2) - 1) as f64);
        let dt = self.dt.or(first.and_then(apart));
        let (Some(duration), Some(dt)) = (duration, dt) else {
            return Err(Failure::input([
                "how long is the next run, and how often is it sampled? Say it with --duration and --dt, or give a run with --data",
            ]));
        };
        let deviations = self.deviations(model, folder)?;
        let theta = self.theta(model, folder, None);
        let known = runs.into_iter().map(|run| {
            let mut own = self.theta(model, folder, Some(&run));
            // what runs share is one number
            let shared = model.definition().params.iter().zip(&theta).enumerate();
            shared.filter(|(_, (p, _))| !p.per_run).for_each(|(k, (_, value))| own[k] = *value);
            (run, own)
        });
        let known = known.collect();
        Ok(Question { model, theta, deviations, known, rest, heights, duration, dt, runs: self.runs.into() })
    }

    /// As typed, as the result found them, as the model declares them.
    fn deviations(&self, model: &Model, folder: Option<&ResultFolder>) -> Result<Vec<f64>, Failure> {
        let outputs = &model.definition().outputs;
        let typed = match noise(&self.noise, model)? {
            Noise::Given(given) => given,
            _ => vec![None; outputs.len()],
        };
        let found = folder.map(|f| f.result()["noise_covariance"].clone());
        let of = |k: usize| {
            let found = found.as_ref().and_then(|rows| rows[k][k].as_f64()).map(f64::sqrt);
            let output = outputs[k].quantity.name.clone();
            let said = self.noise.iter().any(|word| word.starts_with(&format!("{output}=")));
            let value = if said { typed[k] } else { found.or(typed[k]) };
            value.ok_or(Asked::Noise { output })
        };
        let (mut deviations, mut wrong) = (Vec::new(), Vec::new());
        for found in (0..outputs.len()).map(of) {
            match found {
                Ok(value) => deviations.push(value),
                Err(e) => wrong.push(e),
            }
        }
        if wrong.is_empty() { Ok(deviations) } else { Err(Failure::input(wrong)) }
    }
}

/// Inputs by place, with values in their units.
fn placed(model: &Model, option: &str, given: &[(String, Amount)]) -> Result<Vec<(usize, f64)>, Failure> {
    let inputs = &model.definition().inputs;
    let mut found = Vec::new();
    for (name, amount) in given {
        let place = inputs.iter().position(|i| i.quantity.name == *name);
        let k = place.ok_or_else(|| Failure::input([Asked::unknown(model, name)]))?;
        let unit = inputs[k].quantity.unit.as_ref();
        let value = amount.within(unit).ok_or_else(|| {
            let unit = unit.map_or(String::from("no unit"), ToString::to_string);
            Failure::input([format!("{option} {name}: its unit does not fit that of the input ({unit})")])
        })?;
        found.push((k, value));
    }
    Ok(found)
}

/// `INPUT=HEIGHT`, possibly with a unit.
fn height(text: &str) -> Result<(String, Amount), String> {
    let (name, amount) = text.split_once('=').ok_or("expected INPUT=HEIGHT")?;
    Ok((name.trim().to_string(), amount.trim().parse()?))
}

/// Writes the planned runs; what cannot be written is told.
fn written(question: &Question<'_>, found: &Design, folder: &Path) -> bool {
    let place =
        std::fs::create_dir_all(folder).map_err(|e| format!("{}: {}", folder.display(), fdm::store::reason(&e)));
    let one = |(k, step): (usize, &fdm::design::Step)| {
        let table = step.manoeuvre.table(question, &format!("run_{}", k + 1));
        table.map_or(Ok(()), |t| t.write(folder).map(drop).map_err(|e| e.to_string()))
    };
    let failed = place.and_then(|()| found.steps.iter().enumerate().try_for_each(one));
    if let Err(e) = &failed {
        remark(format_args!("error: {e}; the result is what is printed"));
    }
    failed.is_ok()
}
