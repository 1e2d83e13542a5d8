//! `fdm fit --method fd`: the same estimation on spectra.

use crate::delivery::Outcome;
use crate::failure::{Failure, NUMBERS};
use crate::fit::{Arguments as Fit, UNDETERMINED, title};
use crate::histories::as_file;
use crate::noise::noise;
use crate::progress::Progress;
use crate::records::{load, notes};
use clap::{Args, ValueEnum};
use fdm::Model;
use fdm::estimate::{
    Changes, Estimate, HiddenMode, Nonlinear, Options, SpectralFit, SpectralOptions, Unanswered, fit_spectra,
};
use fdm::frequency::EndTerms;
use fdm::record::Run;
use fdm::report::{
    TimeHistory, hidden_mode, history_table, prediction_table, spectral_json, spectral_table, spectrum_columns,
    time_json,
};
use fdm::spectrum::Frequencies;
use fdm::store::{Identity, Manifest};
use num_complex::Complex64;
use std::path::PathBuf;
use std::process::ExitCode;

/// Which lines of spectra, and what is done about their ends and about nonlinear terms.
#[derive(Debug, Args)]
pub(crate) struct Lines {
    /// Frequencies from LO to HI, in cycles per unit of time (Hz where that is the second) [default: what the inputs move]
    #[arg(long, value_name = "LO:HI", value_parser = band)]
    pub(crate) band: Option<(f64, f64)>,
    /// Distance of the frequencies, by zoom transform [default: each record's own frequencies, i/T]
    #[arg(long, value_name = "STEP", requires = "band", allow_negative_numbers = true)]
    pub(crate) df: Option<f64>,
    /// End terms: `known` from the record where outputs show the states, `free` in every run, or `none`
    /// [default: free]
    #[arg(long, value_name = "known|free|none", value_enum)]
    ends: Option<EndChoice>,
    /// Nonlinear models: nonlinear terms `carry` in as known inputs computed from records, or `linearise` at the trim
    /// [default: auto]
    #[arg(long, value_name = "auto|carry|linearise", value_enum)]
    nonlinear: Option<NonlinearChoice>,
    /// Begin with the model's own values, not with those of equation error
    #[arg(long)]
    own_values: bool,
}

/// What is particular to the frequency domain.
#[derive(Debug, Args)]
#[command(next_help_heading = "Frequency domain (--method fd, --method fr)")]
pub(crate) struct Spectral {
    #[command(flatten)]
    pub(crate) lines: Lines,
    /// Standard deviation of the noise of an input that was measured (roll rate or sideslip beside a model of the pitching motion): what it draws
    /// estimates by is taken off, and errors know it; may be given several times
    #[arg(long = "input-noise", value_name = "INPUT=SD", value_parser = deviation)]
    pub(crate) input_noise: Vec<(String, f64)>,
    /// Run that takes no part in the estimation and is predicted by its result; may be given several times
    #[arg(long, value_name = "RUN")]
    pub(crate) holdout: Vec<PathBuf>,
    /// With --method fr: lengths of the segments that are averaged, in the model's time [default: two, the second half as long as the first]
    #[arg(long, value_name = "L1,L2,..", value_delimiter = ',', allow_negative_numbers = true)]
    pub(crate) segments: Vec<f64>,
    /// With --method fr: a pair that is compared; may be given several times [default: all that the model connects]
    #[arg(long = "pair", value_name = "OUTPUT/INPUT", value_parser = pair)]
    pub(crate) pairs: Vec<(String, String)>,
    /// With --method fr: coherence below which a frequency does not count [default: 0.6]
    #[arg(long, value_name = "C", allow_negative_numbers = true)]
    pub(crate) coherence: Option<f64>,
}

/// `INPUT=SD`
fn deviation(text: &str) -> Result<(String, f64), String> {
    let (input, deviation) = text.split_once('=').ok_or("expected INPUT=SD, such as p=0.002")?;
    let number = deviation.trim().parse().map_err(|_| format!("`{deviation}` is not a number"))?;
    Ok((input.trim().to_string(), number))
}

/// `OUTPUT/INPUT`
fn pair(text: &str) -> Result<(String, String), String> {
    let (output, input) = text.split_once('/').ok_or("expected OUTPUT/INPUT")?;
    Ok((output.trim().to_string(), input.trim().to_string()))
}

#[derive(Debug, Clone, Copy, Default, ValueEnum)]
enum EndChoice {
    Known,
    #[default]
    Free,
    None,
}

#[derive(Debug, Clone, Copy, Default, ValueEnum)]
enum NonlinearChoice {
    /// Carried in where the records allow it, else linearised
    #[default]
    Auto,
    Carry,
    Linearise,
}

/// `LO:HI`
pub(crate) fn band(text: &str) -> Result<(f64, f64), String> {
    let (low, high) = text.split_once(':').ok_or("expected LO:HI, such as 0.1:3")?;
    let number = |part: &str| part.trim().parse().map_err(|_| format!("`{part}` is not a number"));
    Ok((number(low)?, number(high)?))
}

impl Lines {
    /// Options that were given.
    pub(crate) fn given(&self) -> Vec<&'static str> {
        let all = [(self.band.is_some(), "--band"), (self.df.is_some(), "--df")];
        let spectra = self.of_spectra();
        all.into_iter().filter(|(given, _)| *given).map(|(_, name)| name).chain(spectra).collect()
    }

    /// Those that a fit of frequency responses has no use for.
    fn of_spectra(&self) -> Vec<&'static str> {
        let all = [
            (self.ends.is_some(), "--ends"),
            (self.nonlinear.is_some(), "--nonlinear"),
            (self.own_values, "--own-values"),
        ];
        all.into_iter().filter(|(given, _)| *given).map(|(_, name)| name).collect()
    }

    pub(crate) fn frequencies(&self) -> Frequencies {
        match (self.band, self.df) {
            (Some((lowest, highest)), Some(df)) => Frequencies::Band { lowest, highest, spacing: Some(df) },
            (Some((low, high)), None) => Frequencies::Grid { lowest: Some(low), highest: Some(high) },
            (None, _) => Frequencies::Grid { lowest: None, highest: None },
        }
    }

    /// The options of a fit with these changes.
    pub(crate) fn options(&self, changes: Changes, options: Options) -> SpectralOptions {
        SpectralOptions {
            changes,
            options,
            frequencies: self.frequencies(),
            ends: match self.ends.unwrap_or_default() {
                EndChoice::Known => EndTerms::Known,
                EndChoice::Free => EndTerms::Unknown,
                EndChoice::None => EndTerms::Omitted,
            },
            nonlinear: match self.nonlinear.unwrap_or_default() {
                NonlinearChoice::Auto => Nonlinear::Auto,
                NonlinearChoice::Carry => Nonlinear::Carried,
                NonlinearChoice::Linearise => Nonlinear::Linearised,
            },
            input_noise: Vec::new(),
            regressed: !self.own_values,
            finish: true,
        }
    }
}

impl Spectral {
    /// Options that were given, of both ways in the frequency domain.
    pub(crate) fn of_both(&self) -> Vec<&'static str> {
        let all = [
            (self.lines.band.is_some(), "--band"),
            (self.lines.df.is_some(), "--df"),
            (!self.holdout.is_empty(), "--holdout"),
        ];
        all.into_iter().filter(|(given, _)| *given).map(|(_, name)| name).collect()
    }

    /// Those of spectra.
    pub(crate) fn of_spectra(&self) -> Vec<&'static str> {
        let noise = (!self.input_noise.is_empty()).then_some("--input-noise");
        self.lines.of_spectra().into_iter().chain(noise).collect()
    }

    /// Those of frequency responses.
    pub(crate) fn of_responses(&self) -> Vec<&'static str> {
        let all = [
            (!self.segments.is_empty(), "--segments"),
            (!self.pairs.is_empty(), "--pair"),
            (self.coherence.is_some(), "--coherence"),
        ];
        all.into_iter().filter(|(given, _)| *given).map(|(_, name)| name).collect()
    }

    /// Runs that take no part.
    pub(crate) fn held_out(&self, arguments: &Fit, model: &Model) -> Result<Vec<Run>, Failure> {
        let place = |path: &PathBuf| path.canonicalize().unwrap_or_else(|_| path.clone());
        let used: Vec<PathBuf> = arguments.records.data.iter().map(place).collect();
        if let Some(both) = self.holdout.iter().find(|path| used.contains(&place(path))) {
            let path = both.display();
            let said = format!(
                "{path} is both --data and --holdout: a run that was estimated from tells nothing new; hold out another one"
            );
            return Err(Failure::input([said]));
        }
        let runs = load(&self.holdout, &arguments.records.options(), model)?;
        Ok(runs.into_iter().map(|(run, _)| run).collect())
    }
}

/// Fits spectra as the arguments of `fdm fit` say.
pub(crate) fn run(arguments: &Fit) -> Result<ExitCode, Failure> {
    refuse_what_is_of_time(arguments)?;
    let mut progress = Progress::new(arguments.delivery.quiet);
    let model = arguments.subject.load()?;
    let records = arguments.records.load(&model, true)?;
    if !arguments.delivery.quiet {
        notes(&records);
    }
    let options = options(arguments, &model)?;
    let runs: Vec<Run> = records.into_iter().map(|(run, _)| run).collect();
    let held_out = arguments.spectral.held_out(arguments, &model)?;
    let prepared = arguments.delivery.prepare()?;
    let (_live, _) = prepared.live(&model, None, &mut progress);
    let result = fit_spectra(&model, &runs, &options, &mut progress);
    progress.finish();
    let fit = result.map_err(|e| Failure::input([e]))?;

    let (mut text, mut json) = (text(&fit, arguments), spectral_json(&fit));
    if !held_out.is_empty() && fit.estimate.termination.is_good() {
        let predicted = fit.predict(&held_out, &mut progress).map_err(|e| Failure::input([e]))?;
        text.push_str(&format!("\nruns that took no part\n{}", prediction_table(&predicted.quality)));
        json["holdout"] = time_json(&predicted);
    }
    let mut manifest = Manifest::new(&model, Identity::of(&model, &runs, &options), options.options.noise.clone());
    manifest.command = std::env::args().collect();
    if arguments.delivery.describes() {
        arguments.records.describe(&runs, &mut manifest);
    }
    let frequencies: Vec<Vec<f64>> =
        fit.spectra.iter().map(|s| s.omega.iter().map(|w| w / std::f64::consts::TAU).collect()).collect();
    let outcome = Outcome {
        model: &fit.model,
        fit: fit.finish.as_ref(),
        runs: &runs,
        spectra: panels(&fit, &frequencies),
        tables: tables(&fit),
        text,
        json,
        remarks: remarks(&fit.model, &fit.estimate, fit.unanswered.as_ref(), &fit.hidden),
        manifest,
    };
    let delivered = prepared.deliver(outcome);
    Ok(if fit.is_good() && delivered { ExitCode::SUCCESS } else { ExitCode::from(NUMBERS) })
}

/// Options that mean nothing to spectra are refused, not passed over.
pub(crate) fn refuse_what_is_of_time(arguments: &Fit) -> Result<(), Failure> {
    let mut given = arguments.strategies.given();
    given.extend((arguments.starts > 1).then_some("--starts"));
    given.extend(arguments.keeping.is_asked().then_some("--checkpoint"));
    given.extend(arguments.integration.given());
    if given.is_empty() {
        return Ok(());
    }
    let reason = |option: &str| format!("{option} belongs to the time domain; leave it out, or leave out `--method`");
    Err(Failure::input(given.into_iter().map(reason)))
}

fn options(arguments: &Fit, model: &Model) -> Result<SpectralOptions, Failure> {
    let changes = arguments.subject.changes(&arguments.estimated);
    let options = arguments.spectral.lines.options(changes, arguments.choice.options(noise(&arguments.noise, model)?));
    Ok(SpectralOptions { input_noise: arguments.spectral.input_noise.clone(), ..options })
}

fn text(fit: &SpectralFit, arguments: &Fit) -> String {
    let cost = fit.estimate.cost.map_or(String::new(), |c| format!(", cost {c:.9e}"));
    told(&fit.model, &fit.estimate, spectral_table(fit, arguments.intervals), arguments.history, &cost)
}

/// Title, tables, the iteration where that is wanted, and how it ended.
pub(crate) fn told(model: &Model, e: &Estimate, tables: String, history: bool, cost: &str) -> String {
    let mut text = format!("{}\n\n{tables}\n", title(model));
    if history {
        text.push_str(&format!("\n{}\n", history_table(&e.history)));
    }
    text.push_str(&format!("{} after {} corrections{cost}\n", e.termination, e.iterations));
    text
}

/// What is said behind a result in the frequency domain that is not good.
pub(crate) fn remarks(
    model: &Model,
    estimate: &Estimate,
    unanswered: Option<&Unanswered>,
    hidden: &[HiddenMode],
) -> Vec<String> {
    if let Some(why) = unanswered {
        return vec![why.to_string()];
    }
    if !estimate.termination.is_good() {
        return vec![estimate.termination.to_string()];
    }
    let undetermined = (!estimate.is_good()).then(|| UNDETERMINED.to_string());
    undetermined.into_iter().chain(hidden.iter().map(|mode| hidden_mode(model, mode))).collect()
}

/// Measured and modelled spectra as pictures: their magnitudes over frequency.
fn panels<'a>(fit: &SpectralFit, frequencies: &'a [Vec<f64>]) -> Vec<TimeHistory<'a>> {
    let definition = fit.model.definition();
    let mut panels = Vec::new();
    for (spectrum, time) in fit.spectra.iter().zip(frequencies) {
        for (o, output) in definition.outputs.iter().enumerate() {
            let (name, count) = (&output.quantity.name, time.len());
            let unit = output.quantity.unit.as_ref().map_or(String::new(), ToString::to_string);
            let size = |plane: &[Complex64]| plane[o * count..(o + 1) * count].iter().map(|v| v.norm()).collect();
            panels.push(TimeHistory {
                title: format!("{}: spectrum of {name} in {}", fit.model.name(), spectrum.run),
                time_label: format!("cycles per {}", definition.time),
                value_label: format!("|{name}| [{unit}]"),
                time,
                measured: size(&spectrum.measured),
                modelled: size(&spectrum.modelled),
            });
        }
    }
    panels
}

/// The spectra of every run as a table.
fn tables(fit: &SpectralFit) -> Vec<(String, Vec<u8>)> {
    let table = |run: usize| (format!("spectrum_{}.csv", run + 1), as_file(&spectrum_columns(fit, run)));
    (0..fit.spectra.len()).map(table).collect()
}
