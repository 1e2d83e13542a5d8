//! `fdm sample`: draws from the posterior of a result by the No-U-Turn sampler.

use crate::answer::Answer;
use crate::conduct::Conduct;
use crate::failure::{Failure, OrFailure, as_json};
use crate::halt::TimeLimit;
use crate::simulate::fitted_runs;
use clap::Args;
use fdm_estimate::{Noise, Status};
use fdm_lab::posterior::{CorrectedErrors, Given, Posterior, SampleError, Samples, Sampling, sample};
use fdm_report::page::sample_page;
use fdm_report::sample_text;
use fdm_results::documents::FitDocument;
use fdm_results::documents::sample::{ArvizDocument, SampleDocument, SampledParameter};
use fdm_results::store::ResultFolder;
use fdm_system::Model;
use fdm_system::record::Run;
use fdm_system::simulate::{StepOptions, choose_steps};
use std::path::PathBuf;

/// Draws at which responses are predicted.
const PREDICTED: usize = 400;

/// What draws are made with.
#[derive(Debug, Args)]
pub struct Options {
    /// Result folder that `fdm fit --out` wrote
    #[arg(value_name = "RESULT")]
    pub result: PathBuf,
    /// Chains, each from its own place
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = 4, value_parser = clap::value_parser!(u16).range(1..=64), help_heading = "Sampling")]
    chains: u16,
    /// Draws of each chain that are kept
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = 1000, value_parser = clap::value_parser!(u32).range(4..=1_000_000), help_heading = "Sampling")]
    draws: u32,
    /// Transitions before them, in which step and metric are adapted
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = 500, value_parser = clap::value_parser!(u32).range(0..=1_000_000), help_heading = "Sampling")]
    warmup: u32,
    /// Seed of all chains
    #[arg(long, value_name = "SEED", allow_negative_numbers = true, default_value_t = 1, help_heading = "Sampling")]
    seed: u64,
    /// Mean acceptance that the step is adapted to, between 0 and 1; nearer to 1 where trajectories diverge
    #[arg(long, value_name = "P", allow_negative_numbers = true, default_value_t = 0.8, value_parser = share, help_heading = "Sampling")]
    target: f64,
    /// Most doublings of a trajectory
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=20), help_heading = "Sampling")]
    max_depth: u32,
    /// Take residuals for white, as the likelihood does, though the fit found them coloured
    #[arg(long, help_heading = "Sampling")]
    white: bool,
    /// Posterior predictive bands of every run, in the JSON
    #[arg(long, help_heading = "Result")]
    bands: bool,
    /// How long it may work.
    #[command(flatten)]
    pub limit: TimeLimit,
}

/// A share strictly between 0 and 1.
fn share(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| format!("`{text}` is not a number"))?;
    if value > 0.0 && value < 1.0 { Ok(value) } else { Err("it must lie between 0 and 1".into()) }
}

/// Draws, and what they say.
struct Drawn {
    document: SampleDocument,
    draws: ArvizDocument,
}

/// Draws from the posterior of a result, over these runs or over those that it was fitted to. All draws are the file `draws.json`, in the form that ArviZ
/// reads; the page is `page.html`, and has predictive bands where a drawing is wanted.
///
/// # Errors
/// [`Failure`]
pub fn draw(
    asked: &Options,
    folder: &ResultFolder,
    runs: Option<Vec<Run>>,
    conduct: &mut Conduct,
) -> Result<Answer, Failure> {
    let drawn = asked.draw(folder, runs, conduct);
    conduct.progress.finish();
    // told in any case
    let in_time = conduct.progress.in_time();
    let Drawn { document, draws } = drawn?;
    let mut files = Vec::new();
    if conduct.wanted.files {
        files.push(("draws.json".to_string(), as_json(&draws)?.into_bytes()));
        files.push(("page.html".to_string(), sample_page(&document, &draws).into_bytes()));
    }
    let (remarks, good) = (document.remarks.clone(), in_time && document.is_good());
    // bands only where they were asked for
    let bands = if asked.bands { document.bands.clone() } else { Vec::new() };
    let answer = Answer::of(sample_text(&document), &SampleDocument { bands, ..document }, conduct.wanted)?;
    Ok(Answer { remarks, files, good, ..answer })
}

impl Options {
    fn sampling(&self) -> Sampling {
        Sampling {
            chains: self.chains.into(),
            draws: self.draws as usize,
            warmup: self.warmup as usize,
            seed: self.seed,
            target: self.target,
            most_depth: self.max_depth,
        }
    }

    /// Draws from the posterior of a result, over these runs or over those that it was fitted to.
    fn draw(&self, folder: &ResultFolder, runs: Option<Vec<Run>>, conduct: &Conduct) -> Result<Drawn, Failure> {
        let progress = &conduct.progress;
        let model = found(folder)?;
        let runs = runs.map_or_else(|| fitted_runs(folder, None, &model), Ok)?;
        let (posterior, mut remarks) = posterior(folder, &model, runs, self.white)?;
        let sampling = self.sampling();
        progress.say(&format!("sampling {} unknowns with {} chains", posterior.unknowns(), sampling.chains));
        let samples = match sample(&posterior, &sampling, progress.halt()) {
            Ok(samples) => samples,
            Err(e @ SampleError::NotFinite) => return Err(Failure::Numbers(e.to_string())),
            Err(e) => return Err(Failure::input([e])),
        };
        let drawn = samples.chains.first().map_or(0, |c| c.values.len());
        if drawn < 4 {
            return Err(Failure::Numbers("it was stopped before there were draws".into()));
        }
        let bands = match self.bands || conduct.wanted.plot {
            true => samples.predict(&posterior, PREDICTED, sampling.seed).or_failure()?,
            false => Vec::new(),
        };
        let parameters = samples.parameters();
        remarks.extend(judged(&samples, &parameters, &sampling));
        let document = SampleDocument {
            model: model.name().into(),
            result: folder.folder().display().to_string(),
            draws: drawn,
            warmup: sampling.warmup,
            seed: sampling.seed,
            parameters,
            chains: samples.chains(sampling.most_depth),
            widened: posterior.widened(),
            bands,
            remarks,
        };
        Ok(Drawn { document, draws: arviz(&model, &posterior, &samples) })
    }
}

/// The model of a result: what the fit estimated is free, what it held is not.
fn found(folder: &ResultFolder) -> Result<Model, Failure> {
    let model = folder.model()?;
    let mut params = model.definition().params.clone();
    for param in params.iter_mut().filter(|p| !p.is_recorded()) {
        let own = folder.parameters().iter().find(|k| k.name == param.quantity.name);
        if let Some(kept) = own {
            param.fixed = kept.status == Status::Fixed;
            param.value = kept.value;
        }
    }
    Ok(model.with_params(params))
}

/// The posterior of a result over its runs, and what is to be said of it; `white` leaves the likelihood as it is.
fn posterior(
    folder: &ResultFolder,
    model: &Model,
    runs: Vec<Run>,
    white: bool,
) -> Result<(Posterior, Vec<String>), Failure> {
    let definition = model.definition();
    let Some(fit) = folder.result().fit() else {
        return Err(Failure::input(["regressions have no posterior; fit the model by output error"]));
    };
    if let Some(limited) = fit.outputs_in_time().iter().find(|o| o.censored > 0) {
        return Err(Failure::input([format!(
            "`{}` has samples below a limit, whose likelihood is not drawn from; `fdm profile` has the intervals of such a fit",
            limited.name
        )]));
    }
    let mut remarks = Vec::new();
    if definition.states.iter().any(|s| s.noise.is_some()) {
        remarks.push("note: process noise is left out, as by output error".to_string());
    }
    let noise = &folder.manifest().noise;
    if *noise == Noise::Full {
        remarks.push("note: the noises of the outputs are taken for independent".to_string());
    }
    let known = |k: usize| if let Noise::Given(given) = noise { given.get(k).copied().flatten() } else { None };
    let estimated = fit.noise_covariance.as_ref();
    let deviation = |k: usize| estimated.and_then(|c| c.get(k)?.get(k).copied()).map_or(1.0, f64::sqrt);
    let noise = (0..definition.outputs.len()).map(|k| known(k).map_or((deviation(k), false), |d| (d, true))).collect();
    let mut theta = Vec::new();
    let mut steps = Vec::new();
    for run in &runs {
        let own = folder.theta(model, &run.name, None).or_failure()?;
        steps.push(match folder.integration(&run.name) {
            Some(accuracy) => accuracy.steps,
            None => {
                let unsuited = |e| Failure::input([format!("run `{}`: {e}", run.name)]);
                choose_steps(model.dynamics(), run, &own, &StepOptions::default()).map_err(unsuited)?.steps
            }
        });
        theta.push(own);
    }
    let mut posterior = Posterior::new(Given { model, runs, steps, theta, noise }).or_failure()?;
    if let Some(errors) = CorrectedErrors::of(fit).filter(|_| !white) {
        posterior = posterior.corrected(&errors).or_failure()?;
    }
    remarks.extend(of_residuals(fit, posterior.widened()));
    Ok((posterior, remarks))
}

/// What residuals that are no white noise of one size mean for the draws.
fn of_residuals(fit: &FitDocument, widened: Option<[f64; 2]>) -> Option<String> {
    let coloured = fit.noise_colour.iter().filter(|c| !c.is_white()).map(|c| &c.output);
    let varying = fit.outputs_in_time().iter().filter(|o| o.noise_variation.is_some()).map(|o| &o.name);
    let mut names: Vec<&String> = coloured.chain(varying).collect();
    names.sort_unstable();
    names.dedup();
    if names.is_empty() {
        return None;
    }
    let names: Vec<String> = names.iter().map(|name| format!("`{name}`")).collect();
    let names = names.join(", ");
    Some(match widened {
        Some([least, most]) => format!(
            "note: residuals of {names} are no white noise of one size: the likelihood is widened to the corrected errors of the fit, \
             {least:.2} to {most:.2} times; --white leaves it as it is"
        ),
        None => format!(
            "note: residuals of {names} are no white noise of one size, and draws take them for that: deviations and bands may be too \
             narrow; trust the corrected errors of the fit"
        ),
    })
}

/// What speaks against the draws.
fn judged(samples: &Samples, parameters: &[SampledParameter], sampling: &Sampling) -> Vec<String> {
    const AGREE: f64 = 1.01;
    const LEAST: f64 = 100.0;
    let mut said = Vec::new();
    if !samples.whole {
        said.push("the draws are fewer than asked for: it was stopped".to_string());
    }
    let chains = samples.chains(sampling.most_depth);
    let divergent: usize = chains.iter().map(|c| c.divergent).sum();
    if divergent > 0 {
        said.push(format!(
            "{divergent} trajectories diverged: where the posterior is narrow draws are missing; raise --target, or give priors"
        ));
    }
    let deepest: usize = chains.iter().map(|c| c.deepest).sum();
    if deepest > 0 {
        said.push(format!("{deepest} trajectories were as long as --max-depth allows; the draws are right, and dear"));
    }
    let called = |p: &SampledParameter| match &p.run {
        Some(run) => format!("{} of {run}", p.name),
        None => p.name.clone(),
    };
    let apart: Vec<String> = parameters
        .iter()
        .filter(|p| p.r_hat.is_none_or(|r| r > AGREE))
        .map(|p| format!("{} ({:.3})", called(p), p.r_hat.unwrap_or(f64::NAN)))
        .collect();
    if !apart.is_empty() {
        said.push(format!(
            "the chains do not agree (R-hat above {AGREE}): {}; draw longer, or give priors",
            apart.join(", ")
        ));
    }
    let least = LEAST * sampling.chains as f64;
    let few: Vec<String> =
        parameters.iter().filter(|p| p.bulk.into_iter().chain(p.tail).any(|n| n < least)).map(called).collect();
    if !few.is_empty() {
        said.push(format!("fewer than {least:.0} effective draws: {}; draw longer", few.join(", ")));
    }
    said
}

/// All draws under their names.
fn arviz(model: &Model, posterior: &Posterior, samples: &Samples) -> ArvizDocument {
    let name = |name: &str, run: Option<&str>| run.map_or_else(|| name.to_string(), |run| format!("{name}[{run}]"));
    let mut document = ArvizDocument::default();
    for (k, sampled) in samples.names.iter().enumerate() {
        document.posterior.insert(name(&sampled.name, sampled.run.as_deref()), samples.of(k));
    }
    document.sample_stats.extend(samples.stats().into_iter().map(|(name, values)| (name.to_string(), values)));
    let outputs = &model.definition().outputs;
    for run in posterior.runs() {
        for (o, output) in outputs.iter().enumerate().filter(|(o, _)| run.measures(*o)) {
            let values = run.measured.iter().skip(o).step_by(outputs.len());
            let own = Some(run.name.as_str()).filter(|_| posterior.runs().len() > 1);
            let values = values.map(|v| v.is_finite().then_some(*v)).collect();
            document.observed_data.insert(name(&output.quantity.name, own), values);
        }
    }
    document
}
