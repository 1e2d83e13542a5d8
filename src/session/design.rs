//! `fdm design`: optimal design of the next runs, whose manoeuvres, or levels and sampling times, reduce the standard errors most.

use crate::answer::{Answer, NamedFile};
use crate::campaign::{RecordFile, Role, expanded};
use crate::conduct::Conduct;
use crate::failure::{Failure, did_you_mean};
use crate::halt::TimeLimit;
use crate::load::ModelOrResult;
use crate::noise::noise;
use crate::records::{Selection, read_runs};
use crate::tables::column;
use crate::value::number;
use clap::Args;
use fdm_estimate::{Noise, Status, initial_guess};
use fdm_grammar::model::Quantity;
use fdm_lab::design::{
    Asked, DesignSpace, Experiment, Factor, Place, Question, Rivals, Separation, Step, between as distinction,
    design as design_runs, experiments as plan_experiments, sheet, table,
};
use fdm_lab::experiment::Amount;
use fdm_report::page::{design_page, experiments_page};
use fdm_report::{Drawn, Planned, Words, design_table, distinction_table, experiments_table};
use fdm_results::store::ResultFolder;
use fdm_system::Model;
use fdm_system::record::Run;
use std::path::PathBuf;

/// What the next runs are designed with.
#[derive(Debug, Args)]
#[command(mut_arg("model", |m| m.required_unless_present_any(["from_result", "between"])))]
pub struct Options {
    /// The model or the result.
    #[command(flatten)]
    pub model: ModelOrResult,
    /// Separate two models (files or result folders, `A,B`): the manoeuvres after which the odds for the true one are highest, whichever
    /// it is, once the other has adapted its parameters
    #[arg(long, value_name = "A,B", value_delimiter = ',', num_args = 1.., conflicts_with_all = ["model", "from_result"], help_heading = "The next run")]
    pub between: Vec<PathBuf>,
    /// Earlier runs, or patterns; may be given several times
    #[arg(long = "data", value_name = "RUN", help_heading = "Data", num_args = 1.., group = "recorded")]
    data: Vec<PathBuf>,
    #[command(flatten)]
    selection: Selection,
    /// Largest amplitude of an input, in its unit or one of its own (`--amplitude 'elevator=2 deg'`) [default: as in the earlier
    /// runs]
    #[arg(long = "amplitude", value_name = "INPUT=AMPLITUDE", value_parser = amount, help_heading = "The next run")]
    amplitudes: Vec<(String, Amount)>,
    /// Value of an input at rest (trim) [default: as the first run begins, or 0]
    #[arg(long = "rest", value_name = "INPUT=VALUE", value_parser = amount, help_heading = "The next run")]
    rest: Vec<(String, Amount)>,
    /// Fastest motion of an input, in its unit per unit of time; steps become ramps
    #[arg(long = "rate-limit", value_name = "INPUT=RATE", value_parser = rate, help_heading = "The next run")]
    rates: Vec<(String, f64)>,
    /// How far an output may move from where the run begins, by the model; manoeuvres are made smaller until it does not
    #[arg(long = "limit", value_name = "OUTPUT=VALUE", value_parser = amount, help_heading = "The next run")]
    limits: Vec<(String, Amount)>,
    /// Plan experiments, not manoeuvres: the range of a condition or of an initial amount, in its unit or one of its own
    /// (`--level T0=290..350`, `--level 'A0=0.1..2 mol/l'`); a `known` value, an input that is held, or a `per run` parameter
    #[arg(long = "level", value_name = "NAME=LOW..HIGH", value_parser = range, conflicts_with_all = ["between", "amplitudes", "rates"],
          help_heading = "The next run")]
    levels: Vec<(String, [Amount; 2])>,
    /// Plan experiments: how many samples are taken of each, at the best of the times that lie `--dt` apart [default: all]
    #[arg(long, value_name = "N", conflicts_with_all = ["between", "amplitudes", "rates"], help_heading = "The next run",
          value_parser = clap::value_parser!(u16).range(1..))]
    samples: Option<u16>,
    /// Length of the next run, in the model's unit of time [default: that of the first run]
    #[arg(long, value_parser = number, value_name = "TIME", allow_negative_numbers = true, help_heading = "The next run")]
    duration: Option<f64>,
    /// Time between its samples [default: that of the first run; of experiments, a hundredth of the length]
    #[arg(long, value_parser = number, value_name = "TIME", allow_negative_numbers = true, help_heading = "The next run")]
    dt: Option<f64>,
    /// Standard deviation of the noise of an output [default: what the result found, or the model declares]
    #[arg(long, value_name = "OUTPUT=DEVIATION", help_heading = "The next run")]
    noise: Vec<String>,
    /// Number of runs to plan, one after the other
    #[arg(long, value_name = "N", default_value_t = 2, allow_negative_numbers = true, help_heading = "The next run",
          value_parser = clap::value_parser!(u8).range(1..=50))]
    pub runs: u8,
    /// Write the inputs of the planned runs to this folder, as CSV
    #[arg(long, value_name = "DIR", help_heading = "Result")]
    pub records: Option<PathBuf>,
    /// Replace other files of the same names in that folder, and a page that fdm did not write
    #[arg(long, help_heading = "Result")]
    pub force: bool,
    /// How long it may work.
    #[command(flatten)]
    pub limit: TimeLimit,
}

impl Options {
    /// The files of the earlier runs.
    fn files(&self) -> Result<Vec<RecordFile>, Failure> {
        let options = self.selection.options(false);
        let one = |path| RecordFile { path, name: None, role: Role::Fit, options: options.clone() };
        Ok(expanded(&self.data)?.into_iter().map(one).collect())
    }
}

/// Designs the next runs of the model or of the result that is named, or those that separate two; the inputs of the planned runs are files, and
/// so is their page, `page.html`, where it is wanted.
///
/// # Errors
/// [`Failure`]
pub fn answer(asked: &Options, conduct: &mut Conduct) -> Result<Answer, Failure> {
    if !asked.between.is_empty() {
        return between(asked, conduct);
    }
    let (model, folder) = asked.model.load()?;
    let model = asked.model.changed(&model)?;
    let runs = read_runs(&asked.files()?, &model, &[], conduct.quiet)?;
    design(asked, (&model, folder.as_ref()), runs, conduct)
}

/// Designs the next runs of a model, behind these; a result gives parameters and noise.
///
/// # Errors
/// [`Failure`]
pub fn design(
    asked: &Options,
    (model, folder): (&Model, Option<&ResultFolder>),
    runs: Vec<Run>,
    conduct: &mut Conduct,
) -> Result<Answer, Failure> {
    let question = asked.question(model, folder, runs)?;
    if asked.plans_experiments() {
        return experiments(asked, question, conduct);
    }
    conduct.progress.say(&Words::of(model.source()).told("comparing manoeuvres"));
    let found = design_runs(&question, conduct.progress.halt()).map_err(Failure::Input)?;
    let one = |(k, step): (usize, &Step)| table(&question, &step.manoeuvre, &run_name(k));
    let tables: Vec<_> = found.steps.iter().enumerate().filter_map(one).collect();
    let mut files: Vec<NamedFile> = tables.iter().map(|table| (table.file(), table.bytes())).collect();
    if conduct.wanted.files {
        let planned: Vec<Planned> = tables.into_iter().map(|table| (table.name, table.columns)).collect();
        files.push(("page.html".into(), design_page(&found, model, &planned).into_bytes()));
    }
    let answer = Answer::of(design_table(&found, model), &found, conduct.wanted)?;
    Ok(conduct.ended(Answer { files, ..answer }))
}

/// `--level`, `--samples`
fn experiments(asked: &Options, question: Question<'_>, conduct: &mut Conduct) -> Result<Answer, Failure> {
    let model = question.model;
    let space = DesignSpace { factors: asked.factors(model)?, samples: asked.samples.map(usize::from), question };
    conduct.progress.say("choosing levels and sampling times");
    let (found, courses) = plan_experiments(&space, conduct.progress.halt()).map_err(Failure::Input)?;
    let one = |(k, planned): (usize, &Experiment)| sheet(&space, planned, &run_name(k));
    let tables = found.experiments.iter().enumerate().map(one);
    let mut files: Vec<NamedFile> = tables.map(|table| (table.file(), table.bytes())).collect();
    if conduct.wanted.files {
        let drawn: Vec<Drawn> = courses.into_iter().map(|course| (course.time, course.response)).collect();
        files.push(("page.html".into(), experiments_page(&found, model, &drawn).into_bytes()));
    }
    let answer = Answer::of(experiments_table(&found, model), &found, conduct.wanted)?;
    Ok(conduct.ended(Answer { files, ..answer }))
}

/// `--between A,B`
fn between(asked: &Options, conduct: &mut Conduct) -> Result<Answer, Failure> {
    let [first, second] = &asked.between[..] else {
        return Err(Failure::input(["--between takes two models or results: `--between linear.fdm,extended.fdm`"]));
    };
    let mut loaded = Vec::new();
    for path in [first, second] {
        let own = asked.model.of(path);
        let (model, folder) = own.load()?;
        let model = own.changed(&model)?;
        loaded.push((folder.as_ref().map_or_else(|| model.clone(), |f| as_estimated(&model, f)), folder));
    }
    let mut questions = Vec::new();
    for (model, folder) in &loaded {
        let runs = read_runs(&asked.files()?, model, &[], conduct.quiet)?;
        questions.push(asked.question(model, folder.as_ref(), runs)?);
    }
    let (Some(second), Some(first)) = (questions.pop(), questions.pop()) else { return Ok(Answer::default()) };
    let rivals = Rivals { first, second };
    conduct.progress.say(&Words::of(rivals.first.model.source()).told("comparing manoeuvres"));
    let mut found = distinction(&rivals, conduct.progress.halt()).map_err(Failure::Input)?;
    if found.models[0] == found.models[1] {
        found.models = [&asked.between[0], &asked.between[1]].map(|path| {
            let name = if path.is_dir() { path.file_name() } else { path.file_stem() };
            name.map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned())
        });
    }
    let one = |(k, step): (usize, &Separation)| {
        table(&rivals.first, &step.manoeuvre, &run_name(k)).map(|table| (table.file(), table.bytes()))
    };
    let files: Vec<NamedFile> = found.steps.iter().enumerate().filter_map(one).collect();
    let answer = Answer::of(distinction_table(&found, rivals.first.model), &found, conduct.wanted)?;
    Ok(conduct.ended(Answer { files, ..answer }))
}

/// The model with fixed what its result had fixed: that is what makes it another one.
fn as_estimated(model: &Model, folder: &ResultFolder) -> Model {
    let fixed: Vec<&str> =
        folder.parameters().iter().filter(|p| p.status == Status::Fixed).map(|p| p.name.as_str()).collect();
    let mut params = model.definition().params.clone();
    params.iter_mut().filter(|p| fixed.contains(&p.quantity.name.as_str())).for_each(|p| p.fixed = true);
    model.with_params(params)
}

/// The name of the k-th run that is planned.
pub fn run_name(k: usize) -> String {
    format!("run_{}", k + 1)
}

impl Options {
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
            if self.model.set.iter().any(|(typed, _)| typed == name) {
                *value = param.value;
            } else if let Some(found) = found.filter(|_| param.per_run == run.is_some() || !param.per_run) {
                *value = found.value;
            }
        }
        theta
    }

    fn plans_experiments(&self) -> bool {
        !self.levels.is_empty() || self.samples.is_some()
    }

    /// What experiments may be set to.
    fn factors(&self, model: &Model) -> Result<Vec<Factor>, Failure> {
        let definition = model.definition();
        let inputs = definition.inputs.iter().enumerate().filter(|(_, i)| i.is_declared());
        let inputs = inputs.map(|(k, i)| (Place::Input(k), &i.quantity));
        let own = definition.params.iter().enumerate().filter(|(_, p)| p.per_run && !p.fixed);
        let known: Vec<(Place, &Quantity)> = inputs.chain(own.map(|(k, p)| (Place::Param(k), &p.quantity))).collect();
        let one = |(name, ends): &(String, [Amount; 2])| {
            let found = known.iter().find(|(_, q)| q.name == *name || q.name == format!("{name}(0)"));
            let Some((place, quantity)) = found else {
                let state = definition.states.iter().any(|s| s.quantity.name == *name);
                let near = did_you_mean(name, known.iter().map(|(_, q)| q.name.as_str()));
                return Err(Failure::input([if state {
                    format!(
                        "`{name}` begins at what the model says; let each run bring it: `known {name}_0 per run; state {name} = {name}_0;`, and plan `{name}_0`"
                    )
                } else {
                    format!(
                        "--level {name}: the model has no known value, input or `per run` parameter of this name{near}"
                    )
                }]));
            };
            let [from, to] = [&ends[0], &ends[1]].map(|end| within(end, quantity, "--level"));
            let unit = quantity.unit.as_ref().map(ToString::to_string);
            Ok(Factor { name: name.clone(), unit, place: *place, range: [from?, to?] })
        };
        self.levels.iter().map(one).collect()
    }

    fn question<'m>(
        &self,
        model: &'m Model,
        folder: Option<&ResultFolder>,
        runs: Vec<Run>,
    ) -> Result<Question<'m>, Failure> {
        let inputs = &model.definition().inputs;
        let m = inputs.len();
        let first = runs.first();
        let said = |name: &str| {
            self.rest.iter().any(|(n, _)| n == name) || self.levels.iter().any(|(n, _)| n == name) || first.is_some()
        };
        let brought = inputs.iter().filter(|i| i.known && !said(&i.quantity.name)).map(|i| &i.quantity.name);
        let missing: Vec<String> = brought
            .map(|name| format!("nothing says what `{name}` is in the next runs: --rest {name}=VALUE, or --level {name}=LOW..HIGH to plan it"))
            .collect();
        if !missing.is_empty() {
            return Err(Failure::Input(missing));
        }
        let mut rest: Vec<f64> = (0..m).map(|k| first.and_then(|r| r.inputs.get(k).copied()).unwrap_or(0.0)).collect();
        for (k, value) in placed(model, "--rest", &self.rest)? {
            rest[k] = value;
        }
        let moved = |k: usize| {
            let values = runs.iter().flat_map(|run| column(&run.inputs, k, m));
            Some(values.map(|v| (v - rest[k]).abs()).fold(0.0, f64::max)).filter(|h| h.is_finite() && *h > 0.0)
        };
        let mut amplitudes: Vec<Option<f64>> = (0..m).map(|k| if inputs[k].known { None } else { moved(k) }).collect();
        if !self.amplitudes.is_empty() {
            amplitudes.fill(None);
        }
        for (k, value) in placed(model, "--amplitude", &self.amplitudes)? {
            if inputs[k].known {
                let name = &inputs[k].quantity.name;
                return Err(Failure::input([format!(
                    "`{name}` is the same in all samples of a run: plan it with --level {name}=LOW..HIGH"
                )]));
            }
            amplitudes[k] = Some(value);
        }
        let mut rates = vec![None; m];
        for (name, rate) in &self.rates {
            let place = model.definition().inputs.iter().position(|i| i.quantity.name == *name);
            rates[place.ok_or_else(|| Failure::input([Asked::unknown(model, name)]))?] = Some(*rate);
        }
        let limits = self.limits(model)?;
        let last = |run: &Run| run.time.last().copied().filter(|t| *t > 0.0);
        let duration = self.duration.or(first.and_then(last));
        let apart = |run: &Run| Some(last(run)? / (run.len().max(2) - 1) as f64);
        let hundredth = duration.filter(|_| self.plans_experiments()).map(|length| length / 100.0);
        let dt = self.dt.or(hundredth).or(first.and_then(apart));
        let (Some(duration), Some(dt)) = (duration, dt) else {
            return Err(Failure::input([
                "give the length and the sampling interval of the next run with --duration and --dt, or a run with --data",
            ]));
        };
        let deviations = self.deviations(model, folder)?;
        let shared_theta = self.theta(model, folder, None);
        let known = runs.into_iter().map(|run| {
            let mut own = self.theta(model, folder, Some(&run));
            // what runs share is one number
            let shared = model.definition().params.iter().zip(&shared_theta).enumerate();
            shared.filter(|(_, (p, _))| !p.per_run).for_each(|(k, (_, value))| own[k] = *value);
            (run, own)
        });
        let known: Vec<(Run, Vec<f64>)> = known.collect();
        // the next run begins as the first one did
        let theta = known.first().map_or(shared_theta, |(_, own)| own.clone());
        Ok(Question {
            model,
            theta,
            deviations,
            known,
            rest,
            heights: amplitudes,
            rates,
            limits,
            duration,
            dt,
            runs: self.runs.into(),
        })
    }

    /// How far outputs may move (q), in their units.
    fn limits(&self, model: &Model) -> Result<Vec<Option<f64>>, Failure> {
        let outputs = &model.definition().outputs;
        let mut limits = vec![None; outputs.len()];
        for (name, amount) in &self.limits {
            let place = outputs.iter().position(|o| o.quantity.name == *name).ok_or_else(|| {
                let near = did_you_mean(name, outputs.iter().map(|o| o.quantity.name.as_str()));
                Failure::input([format!("the model has no output `{name}`{near}")])
            })?;
            limits[place] = Some(within(amount, &outputs[place].quantity, "--limit")?);
        }
        Ok(limits)
    }

    /// As typed, as the result found them, as the model declares them.
    fn deviations(&self, model: &Model, folder: Option<&ResultFolder>) -> Result<Vec<f64>, Failure> {
        let outputs = &model.definition().outputs;
        let typed = match noise(&self.noise, model)? {
            Noise::Given(given) => given,
            _ => vec![None; outputs.len()],
        };
        let found = folder.and_then(|f| f.result().fit()?.noise_covariance.as_ref());
        let of = |k: usize| {
            let found = found.and_then(|rows| rows.get(k)?.get(k).copied()).filter(|v| v.is_finite()).map(f64::sqrt);
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
        found.push((k, within(amount, &inputs[k].quantity, option)?));
    }
    Ok(found)
}

/// An amount in the unit of a quantity.
fn within(amount: &Amount, of: &Quantity, option: &str) -> Result<f64, Failure> {
    amount.within(of.unit.as_ref()).ok_or_else(|| {
        let unit = of.unit.as_ref().map_or(String::from("no unit"), ToString::to_string);
        Failure::input([format!("{option} {}: its unit does not fit that of the model ({unit})", of.name)])
    })
}

/// `INPUT=RATE`
fn rate(text: &str) -> Result<(String, f64), String> {
    let (name, rate) = text.split_once('=').ok_or("expected INPUT=RATE")?;
    Ok((name.trim().to_string(), number(rate.trim())?))
}

/// `NAME=LOW..HIGH`, possibly with a unit.
fn range(text: &str) -> Result<(String, [Amount; 2]), String> {
    let (name, ends) = text.split_once('=').ok_or("expected NAME=LOW..HIGH")?;
    let (low, high) = ends.split_once("..").ok_or("expected NAME=LOW..HIGH")?;
    let high: Amount = high.trim().parse()?;
    let low: Amount = low.trim().parse()?;
    // a unit behind both holds for both
    let low = Amount { unit: low.unit.or_else(|| high.unit.clone()), ..low };
    Ok((name.trim().to_string(), [low, high]))
}

/// `INPUT=VALUE`, possibly with a unit.
fn amount(text: &str) -> Result<(String, Amount), String> {
    let (name, amount) = text.split_once('=').ok_or("expected INPUT=VALUE")?;
    Ok((name.trim().to_string(), amount.trim().parse()?))
}
