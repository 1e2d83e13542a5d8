//! `fdm margins`: what a result is used for. Modes with their intervals, and the requirements of the model's text, each with the probability that it holds.

use crate::answer::{Answer, Wanted};
use crate::failure::{Failure, OrFailure, did_you_mean};
use crate::modes::{modes, own_parameters_move_rates};
use crate::value::assignment;
use clap::Args;
use fdm_estimate::quantile;
use fdm_grammar::model::Origin;
use fdm_grammar::syntax::{TokenKind, tokens};
use fdm_lab::requirement::{Draws, Known, assess, assess_result, freedom, with_estimates};
use fdm_report::margins_text;
use fdm_results::documents::ResultDocument;
use fdm_results::documents::requirement::{Assessment, MarginsDocument, ModeMargin};
use fdm_results::store::ResultFolder;
use fdm_system::Model;

/// Draws where nothing else is said.
const DRAWS: u32 = 1000;
/// Their seed.
pub(crate) const SEED: u64 = 1;

/// What is asked of a result.
#[derive(Debug, Args)]
pub struct Options {
    /// Requirement beside those of the model's text, as it would stand there: `NAME = EXPRESSION in [LOWER, UPPER]`
    #[arg(long = "requirement", value_name = "REQUIREMENT", help_heading = "Requirements")]
    requirements: Vec<String>,
    /// Run of the result whose per-run parameters are used, if it has several
    #[arg(long, value_name = "RUN", help_heading = "Parameters")]
    like: Option<String>,
    /// Value that a run brings to the model
    #[arg(long = "known", value_name = "NAME=VALUE", value_parser = assignment, help_heading = "Parameters")]
    known: Vec<(String, f64)>,
    /// Draws of the parameters, by which it is seen where a requirement is not linear in them; 0 for none
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = DRAWS, value_parser = clap::value_parser!(u32).range(0..=1_000_000), help_heading = "Intervals")]
    draws: u32,
    /// Seed of the draws
    #[arg(long, value_name = "SEED", allow_negative_numbers = true, default_value_t = SEED, help_heading = "Intervals")]
    seed: u64,
}

/// What a result is used for.
///
/// # Errors
/// [`Failure`]
pub fn answer(asked: &Options, folder: &ResultFolder, wanted: Wanted) -> Result<Answer, Failure> {
    let document = asked.margins(folder)?;
    let answer = Answer::of(margins_text(&document), &document, wanted)?;
    Ok(Answer { good: document.is_good(), ..answer })
}

impl Options {
    /// The margins of a result.
    fn margins(&self, folder: &ResultFolder) -> Result<MarginsDocument, Failure> {
        let model = with_requirements(folder, &self.requirements)?;
        let run = self.run(folder, &model)?;
        let covariance = folder.result().covariance(&model, &run);
        let Some(covariance) = covariance.filter(|c| c.iter().any(|v| *v != 0.0)) else {
            return Err(Failure::input(["the result has no covariance, so that nothing is known of its margins"]));
        };
        let theta = self.theta(folder, &model, &run)?;
        let model = with_estimates(&model, &theta, Some(&covariance));
        let freedom = freedom(folder.result(), &model, &run);
        let known = Known { theta: &theta, covariance: &covariance, freedom: &freedom };
        let draws = Draws { count: self.draws as usize, seed: self.seed };
        let requirements = assess(&model, known, draws).or_failure()?;
        let (modes, no_modes) = match model.layout().states {
            0 => (Vec::new(), None),
            _ => match of_modes(&model, &covariance, &freedom) {
                Ok(modes) => (modes, None),
                Err(Failure::Input(reasons)) => (Vec::new(), Some(reasons.join("; "))),
                Err(other) => return Err(other),
            },
        };
        Ok(MarginsDocument {
            model: model.name().into(),
            result: folder.folder().display().to_string(),
            run: Some(run).filter(|_| folder.runs().len() > 1),
            time: model.definition().time.to_string(),
            modes,
            no_modes,
            draws: self.draws as usize,
            seed: self.seed,
            requirements,
        })
    }

    /// The run whose own parameters are used: the one that was chosen; the only one; the first where no run has its own.
    fn run(&self, folder: &ResultFolder, model: &Model) -> Result<String, Failure> {
        let runs = folder.runs();
        let first = runs.first().cloned().unwrap_or_default();
        if let Some(like) = &self.like {
            let known = runs.iter().any(|r| r == like);
            let hint = did_you_mean(like, runs.iter().map(String::as_str));
            return if known {
                Ok(like.clone())
            } else {
                Err(Failure::input([format!("--like {like}: the result has no such run{hint}")]))
            };
        }
        let own = model
            .definition()
            .params
            .iter()
            .any(|p| p.per_run && !matches!(p.origin, Origin::FreeInitial(_)) && !p.is_recorded());
        if runs.len() < 2 || !own && !own_parameters_move_rates(model).unwrap_or(true) {
            return Ok(first);
        }
        // biases of outputs move what is measured of them: which run is meant must be said
        Err(Failure::input([format!(
            "the model has parameters of single runs: --like RUN says which are used; the runs are {}",
            runs.iter().map(|r| format!("`{r}`")).collect::<Vec<_>>().join(", ")
        )]))
    }

    /// The values of all parameters, those that runs bring among them.
    fn theta(&self, folder: &ResultFolder, model: &Model, run: &str) -> Result<Vec<f64>, Failure> {
        let mut theta = folder.theta(model, run, self.like.as_deref().or(Some(run))).or_failure()?;
        let definition = model.definition();
        let names: Vec<&str> = definition.inputs.iter().filter(|i| i.known).map(|i| i.quantity.name.as_str()).collect();
        let mut wrong = Vec::new();
        for (name, _) in self.known.iter().filter(|(name, _)| !names.contains(&name.as_str())) {
            let hint = did_you_mean(name, names.iter().copied());
            wrong.push(format!("--known {name}: the model has no such value{hint}"));
        }
        for (k, param) in definition.params.iter().enumerate() {
            let Origin::FirstSample(input) = param.origin else { continue };
            let input = &definition.inputs[input as usize];
            let given = self.known.iter().find(|(name, _)| *name == input.quantity.name).map(|(_, value)| *value);
            match (input.known, given) {
                (true, Some(value)) => theta[k] = value,
                (true, None) => {
                    let name = &input.quantity.name;
                    wrong.push(format!(
                        "each run brings `{name}` to the model: --known {name}=VALUE says what is asked for"
                    ));
                }
                (false, _) => theta[k] = 0.0,
            }
        }
        if wrong.is_empty() { Ok(theta) } else { Err(Failure::Input(wrong)) }
    }
}

/// The model of a result with further requirements in its text.
fn with_requirements(folder: &ResultFolder, requirements: &[String]) -> Result<Model, Failure> {
    let model = folder.model()?;
    if requirements.is_empty() {
        return Ok(model);
    }
    let texts = model.source().texts();
    let text = texts[0].text();
    let (words, _) = tokens(text);
    let last = words.iter().rfind(|t| t.kind == TokenKind::Close && t.text(text) == "}");
    let Some(end) = last.map(|t| t.span.start as usize) else { return Ok(model) };
    let mut longer = text[..end].trim_end().to_string();
    longer.push('\n');
    for requirement in requirements {
        let requirement = requirement.trim().trim_end_matches(';');
        let requirement = requirement.strip_prefix("requirement ").unwrap_or(requirement);
        longer.push_str(&format!("  requirement {requirement};\n"));
    }
    longer.push_str(&text[end..]);
    let used: Vec<String> = texts[1..].iter().map(|t| t.text().to_string()).collect();
    let manifest = folder.manifest();
    let whole = Model::from_texts(model.source().name(), longer, &used)?.grouped(manifest.groups.clone())?;
    Ok(whole.untied(&manifest.untied).unwrap_or(whole))
}

/// The requirements of a fit as part of its result.
pub fn of_result(model: &Model, result: &ResultDocument, runs: &[String]) -> Option<Vec<Assessment>> {
    assess_result(model, result, runs, Draws { count: DRAWS as usize, seed: SEED })
}

/// Modes with intervals; a pair is one.
fn of_modes(model: &Model, covariance: &[f64], freedom: &[Option<f64>]) -> Result<Vec<ModeMargin>, Failure> {
    let (_, modes) = modes(model)?;
    let p = model.definition().params.len();
    let mut list = Vec::new();
    for mode in modes.modes.iter().filter(|m| m.s.im >= 0.0) {
        let errors = mode.errors(|i, j| covariance[i * p + j]);
        let moving = mode.slopes.iter().flatten().zip(freedom).filter(|(d, _)| d.norm() > 0.0);
        let wide = quantile(moving.filter_map(|(_, f)| *f).reduce(f64::min));
        let around = |value: f64, error: Option<f64>| error.map(|e| [value - wide * e, value + wide * e]);
        let re = around(mode.s.re, errors.map(|e| e.re));
        // the time falls as the rate rises; a rate that may be zero leaves it open
        let time = |sign: f64| {
            re.map(|[low, high]| {
                let (near, far) = if sign < 0.0 { (-low, -high) } else { (high, low) };
                let of = |rate: f64| (rate > 0.0).then(|| std::f64::consts::LN_2 / rate);
                [of(near), of(far)]
            })
        };
        let states = mode.dominant().map(|k| model.definition().states[k].quantity.name.clone()).collect();
        list.push(ModeMargin {
            states,
            re: mode.s.re,
            im: mode.s.im,
            re_interval: re,
            frequency: mode.frequency(),
            frequency_interval: around(mode.frequency(), errors.map(|e| e.frequency)),
            damping: mode.damping(),
            damping_interval: mode.damping().and_then(|z| around(z, errors.map(|e| e.damping))),
            time_to_half: mode.time_to_half(),
            time_to_half_interval: mode.time_to_half().and_then(|_| time(-1.0)),
            time_to_double: mode.time_to_double(),
            time_to_double_interval: mode.time_to_double().and_then(|_| time(1.0)),
        });
    }
    Ok(list)
}
