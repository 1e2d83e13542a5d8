//! An experiment repeated: records that are made get other noise and their truth is known; measured ones are replaced by what the fit says
//! of them, with noise as it found it.

use super::bootstrap::Bootstrap;
use super::bootstrap::of_experiment;
use crate::experiment::{Experiment, ExperimentError, Rehearsal, StageAnswer, measured_stages};
use fdm_estimate::{Halt, Work, fit};
use fdm_results::documents::study::{Colour, Figure, Repeat, Subject};

/// An experiment that can be repeated.
pub struct System {
    seed: u64,
    rehearsal: Option<Rehearsal>,
    /// Subjects of the rehearsal stand first.
    rehearsed: usize,
    fits: Vec<(String, Bootstrap)>,
    subjects: Vec<Subject>,
    left_out: Vec<String>,
}

impl System {
    /// Of an experiment; without long steps when `thin`.
    ///
    /// # Errors
    /// [`ExperimentError`], where the description does not fit its models and records.
    pub fn new(
        experiment: &Experiment,
        (colour, seed): (Option<Colour>, u64),
        thin: bool,
    ) -> Result<Self, ExperimentError> {
        let mut system =
            Self { seed, rehearsal: None, rehearsed: 0, fits: Vec::new(), subjects: Vec::new(), left_out: Vec::new() };
        let at = colour.map(|c| move |dt: f64| of_experiment(c, dt).unwrap_or_default());
        let at = at.as_ref().map(|c| c as &dyn Fn(f64) -> crate::experiment::Colour);
        system.rehearsal = Rehearsal::new(experiment, at, thin);
        if let Some(rehearsal) = &system.rehearsal {
            // repeats that are looked at for the parameters that a step estimates; it may go astray in some
            for k in 0..5 {
                let answers = rehearsal.once(&name(seed, k))?;
                let found: Vec<Subject> = answers.iter().flat_map(subjects).collect();
                if found.len() > system.subjects.len() {
                    system.subjects = found;
                }
                if answers.iter().all(|a| a.astray.is_none()) {
                    break;
                }
            }
        }
        system.rehearsed = system.subjects.len();
        for stage in measured_stages(experiment, thin)? {
            let ready = fit(&stage.model, &stage.runs, &stage.options, &Work::default())
                .map_err(|e| e.to_string())
                .and_then(|first| {
                    let noise = (colour.unwrap_or_default(), seed);
                    Bootstrap::new(&first, &stage.runs, &stage.options, noise).map_err(|e| e.to_string())
                });
            match ready {
                Ok(bootstrap) => {
                    let own = bootstrap.subjects().iter().map(|s| Subject { step: stage.step.clone(), ..s.clone() });
                    system.subjects.extend(own);
                    system.fits.push((stage.step, bootstrap));
                }
                Err(reason) => system.left_out.push(format!("{}: {reason}", stage.step)),
            }
        }
        Ok(system)
    }

    /// The parameters that are studied; none when there is nothing to repeat.
    pub fn subjects(&self) -> &[Subject] {
        &self.subjects
    }

    /// Steps that cannot be repeated, and why.
    pub fn left_out(&self) -> &[String] {
        &self.left_out
    }

    /// The repeat of this number; none when it was interrupted.
    pub fn once(&self, number: u64, halt: &Halt) -> Option<Repeat> {
        let mut repeat = match &self.rehearsal {
            None => Repeat { astray: Vec::new(), figures: Vec::new(), requirements: Vec::new() },
            Some(rehearsal) => match rehearsal.once(&name(self.seed, number)) {
                Ok(answers) => beside(&answers, &self.subjects[..self.rehearsed]),
                Err(e) => Repeat::gone(e, self.rehearsed),
            },
        };
        for (step, bootstrap) in &self.fits {
            let own = bootstrap.once(number, halt)?;
            repeat.astray.extend(own.astray.into_iter().map(|(_, reason)| (step.clone(), reason)));
            repeat.figures.extend(own.figures);
        }
        Some(repeat)
    }
}

/// What the noise of a repeat is called.
fn name(seed: u64, number: u64) -> String {
    format!("repeat {number} of {seed}")
}

fn subjects(answer: &StageAnswer) -> Vec<Subject> {
    let one = |(p, truth): &(fdm_estimate::ParameterEstimate, f64)| Subject {
        step: answer.step.clone(),
        name: p.name.clone(),
        run: p.run.clone(),
        unit: p.unit.clone(),
        truth: *truth,
    };
    answer.parameters.iter().map(one).collect()
}

fn beside(answers: &[StageAnswer], subjects: &[Subject]) -> Repeat {
    let gone = |a: &StageAnswer| Some((a.step.clone(), a.astray.clone()?));
    let of = |s: &Subject| {
        let answer = answers.iter().find(|a| a.step == s.step && a.astray.is_none())?;
        let mut own = answer.parameters.iter().map(|(p, _)| p);
        own.find(|p| p.name == s.name && p.run == s.run).map(Figure::of)
    };
    Repeat {
        astray: answers.iter().filter_map(gone).collect(),
        figures: subjects.iter().map(|s| of(s).unwrap_or(Figure::NONE)).collect(),
        requirements: Vec::new(),
    }
}
