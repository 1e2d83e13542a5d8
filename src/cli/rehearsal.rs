//! `fdm reproduce --repeats`: experiments again and again with other noise, and whether what is printed beside their estimates holds.

use crate::failure::{Failure, NUMBERS, print, remark};
use crate::progress::Progress;
use crate::repetition::{Patience, Repetition};
use fdm::Model;
use fdm::experiment::Experiment;
use fdm::store::{Identity, reason};
use fdm::study::{Colour, Study, System, Watch, series};
use std::path::PathBuf;
use std::process::ExitCode;

/// What is to be repeated.
pub(crate) struct Wanted<'a> {
    pub(crate) count: usize,
    pub(crate) thin: bool,
    pub(crate) repetition: &'a Repetition,
}

/// What decides the numbers of the repeats, but not how many there are.
#[derive(Debug)]
#[expect(dead_code, reason = "printed")]
struct Studied {
    experiment: Experiment,
    thin: bool,
    noise_colour: Option<Colour>,
    seed: u64,
}

/// Repeats experiments one after the other, and prints what `told` makes of them.
pub(crate) fn rehearsed(
    experiments: &[Experiment],
    wanted: &Wanted<'_>,
    told: &dyn Fn(&[Study]) -> String,
) -> Result<ExitCode, Failure> {
    let colours = match wanted.repetition.colours() {
        none if none.is_empty() => vec![None],
        some if some.contains(&Colour::Fitted) => {
            return Err(Failure::input([
                "--noise-colour fitted belongs to `fdm study`: the noise of an experiment is what its file says; white, lag and pink are other colours of it",
            ]));
        }
        some => some.into_iter().map(Some).collect(),
    };
    let interrupted = Progress::new(true).interrupted();
    let (mut studies, mut whole, mut wrong) = (Vec::new(), true, Vec::new());
    for experiment in experiments {
        for colour in &colours {
            let name = &experiment.name;
            let patience = Patience::new(name, wanted.count, false, interrupted.clone());
            if !patience.goes_on() {
                whole = false;
                continue;
            }
            match one(experiment, *colour, wanted, &patience) {
                Ok(Some((study, kept))) => {
                    whole &= kept && study.is_whole() && study.converged > 0;
                    studies.push(study);
                }
                Ok(None) if experiments.len() > 1 => {}
                Ok(None) => wrong.push(format!(
                    "{name}: no step estimates from records with noise what a truth knows, and none fits measured records in the time domain"
                )),
                Err(Failure::Input(reasons)) => wrong.extend(reasons),
                Err(other) => return Err(other),
            }
        }
    }
    let printed = studies.is_empty() || print(&told(&studies));
    if !wrong.is_empty() {
        return Err(Failure::Input(wrong));
    }
    Ok(if whole && printed { ExitCode::SUCCESS } else { ExitCode::from(NUMBERS) })
}

/// The study of one experiment, and whether its repeats were kept; none when there is nothing to repeat.
fn one(
    experiment: &Experiment,
    colour: Option<Colour>,
    wanted: &Wanted<'_>,
    patience: &Patience,
) -> Result<Option<(Study, bool)>, Failure> {
    let seed = wanted.repetition.seed;
    // where the folder lies decides nothing
    let described = Experiment { folder: PathBuf::new(), ..experiment.clone() };
    let studied = Studied { experiment: described, thin: wanted.thin, noise_colour: colour, seed };
    let identity = Identity::of_texts(&texts(experiment)?, &studied);
    let tint = colour.map_or("described".into(), |c| format!("{c:?}").to_lowercase());
    let folder = format!("{}-{tint}", experiment.name);
    let system = System::new(experiment, (colour, seed), wanted.thin).map_err(|e| Failure::input([e]))?;
    for said in system.left_out() {
        remark(format_args!("note: {}: left out: {said}", experiment.name));
    }
    if system.subjects().is_empty() {
        return Ok(None);
    }
    let kept = wanted.repetition.keeping.open_within(&folder, &identity, false)?;
    let repeats = series(wanted.count, kept.keeper(), patience, &|k| system.once(k, patience));
    patience.finish();
    let study = Study::of(&experiment.name, (colour, seed), system.subjects(), &repeats);
    Ok(Some((study, kept.close())))
}

/// Everything in the folder of an experiment that decides its numbers; models with the files that they use.
fn texts(experiment: &Experiment) -> Result<Vec<(String, Vec<u8>)>, Failure> {
    let unreadable = |e: std::io::Error| Failure::input([format!("{}: {}", experiment.folder.display(), reason(&e))]);
    let mut files: Vec<PathBuf> =
        std::fs::read_dir(&experiment.folder).map_err(unreadable)?.flatten().map(|e| e.path()).collect();
    files.sort();
    let mut texts = Vec::new();
    for file in files {
        let name = file.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
        match file.extension().and_then(|e| e.to_str()) {
            Some("csv") => texts.push((name, std::fs::read(&file).map_err(unreadable)?)),
            Some("fdm") => {
                let mut source = fdm::read_source(&file)?;
                Model::gather_files(&mut source);
                let all: Vec<&str> = source.texts().iter().map(|t| t.text()).collect();
                texts.push((name, all.join("\0").into_bytes()));
            }
            _ => {}
        }
    }
    Ok(texts)
}
