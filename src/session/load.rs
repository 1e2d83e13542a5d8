//! A model and the changes of its parameters, or a result that was written before.

use crate::campaign::RecordFile;
use crate::failure::{Failure, OrFailure};
use crate::foreign_code::refuse_foreign_code;
use crate::records::Records;
use crate::telling::tell;
use crate::value::assignment;
use clap::Args;
use fdm_estimate::Changes;
use fdm_results::store::{DataFile, ResultFolder, differences};
use fdm_system::Model;
use fdm_system::record::Run;
use std::path::{Path, PathBuf};

/// A model file and the changes of its parameters.
#[derive(Debug, Args)]
#[command(next_help_heading = "Parameters")]
pub struct ModelFile {
    /// Model file (.fdm)
    #[arg(value_name = "MODEL", help_heading = None)]
    pub model: PathBuf,
    /// Other start value of a parameter
    ///
    /// Free initial values are called `x(0)`.
    #[arg(long = "set", value_name = "NAME=VALUE", value_parser = assignment)]
    set: Vec<(String, f64)>,
    /// Switch off the tie of a parameter, so that it is estimated by itself; `all` for every tie
    #[arg(long, value_name = "NAME,...|all", value_delimiter = ',', hide_short_help = true)]
    untie: Vec<String>,
}

/// Which parameters are estimated, where that differs from the model's text.
#[derive(Debug, Default, Args)]
#[command(next_help_heading = "Parameters")]
pub struct Estimated {
    /// Keep a parameter at its start value
    #[arg(long, value_name = "NAME")]
    fix: Vec<String>,
    /// Estimate a parameter that the model declares `fixed`
    #[arg(long, value_name = "NAME")]
    free: Vec<String>,
}

impl Estimated {
    /// Names to fix and to free.
    pub fn changes(&self) -> Changes {
        Changes { set: Vec::new(), fix: self.fix.clone(), free: self.free.clone() }
    }
}

impl ModelFile {
    /// Reads and compiles the model; warnings go to standard error.
    ///
    /// # Errors
    /// [`Failure`]
    pub fn load(&self) -> Result<Model, Failure> {
        self.untied(&load_model(&self.model)?)
    }

    /// Reads and compiles the model for the groups of the runs, and with the delays that their maps leave free.
    pub(crate) fn load_for(&self, records: &Records) -> Result<Model, Failure> {
        let model = records.grouped(&load_model(&self.model)?)?;
        self.untied(&records.with_free_delays(&model)?)
    }

    /// A model with the ties switched off that were named.
    ///
    /// # Errors
    /// [`Failure`]
    pub fn untied(&self, model: &Model) -> Result<Model, Failure> {
        model.untied(&self.untie).or_failure()
    }

    /// The model with the values that were typed.
    ///
    /// # Errors
    /// [`Failure`]
    pub fn load_changed(&self, estimated: &Estimated) -> Result<Model, Failure> {
        with_changes(&self.load()?, &self.changes(estimated))
    }

    /// The changes of start values, together with names to fix and to free.
    pub fn changes(&self, estimated: &Estimated) -> Changes {
        Changes { set: self.set.clone(), ..estimated.changes() }
    }
}

/// A model, or a result that holds one with its estimates.
#[derive(Debug, Args)]
#[command(next_help_heading = "Parameters")]
pub struct ModelOrResult {
    /// Model file (.fdm); a result holds its own, and this must be the same
    #[arg(value_name = "MODEL", required_unless_present = "from_result", help_heading = None)]
    model: Option<PathBuf>,
    /// Other value of a parameter (free initial values are called `x(0)`)
    #[arg(long = "set", value_name = "NAME=VALUE", value_parser = assignment)]
    pub set: Vec<(String, f64)>,
    /// Switch off the tie of a parameter, so that it has a value of its own; `all` for every tie
    #[arg(
        long,
        value_name = "NAME,...|all",
        value_delimiter = ',',
        conflicts_with = "from_result",
        hide_short_help = true
    )]
    untie: Vec<String>,
    /// Take model and parameters from a result folder that `fdm fit --out` wrote
    #[arg(long, value_name = "DIR")]
    from_result: Option<PathBuf>,
}

impl ModelOrResult {
    /// The model, and the result when one was named; values that were typed are not in the model yet.
    ///
    /// # Errors
    /// [`Failure`]
    pub fn load(&self) -> Result<(Model, Option<ResultFolder>), Failure> {
        match (&self.from_result, &self.model) {
            (Some(folder), model) => {
                let (folder, model) = open_result(folder, model.as_deref())?;
                Ok((model, Some(folder)))
            }
            (None, Some(model)) => Ok((load_model(model)?.untied(&self.untie).or_failure()?, None)),
            (None, None) => Err(Failure::input(["a model or a result is needed"])),
        }
    }

    /// These arguments with another model or result in its place.
    pub fn of(&self, path: &Path) -> Self {
        Self::at(path, &self.set)
    }

    /// A model file, or the folder of a result, with other values.
    pub fn at(path: &Path, set: &[(String, f64)]) -> Self {
        let (model, from_result) = match path.is_dir() {
            true => (None, Some(path.to_path_buf())),
            false => (Some(path.to_path_buf()), None),
        };
        Self { model, from_result, set: set.to_vec(), untie: Vec::new() }
    }

    /// The model with the values that were typed.
    ///
    /// # Errors
    /// [`Failure`]
    pub fn changed(&self, model: &Model) -> Result<Model, Failure> {
        with_changes(model, &Changes { set: self.set.clone(), ..Changes::default() })
    }
}

/// Reads and compiles a model; warnings go to standard error.
pub(crate) fn load_model(file: &Path) -> Result<Model, Failure> {
    let model = Model::from_file(file)?;
    refuse_foreign_code(&model).or_failure()?;
    tell(model.source(), model.warnings());
    Ok(model)
}

/// A model with these changes of its parameters.
///
/// # Errors
/// [`Failure`]
pub fn with_changes(model: &Model, changes: &Changes) -> Result<Model, Failure> {
    let mut params = model.definition().params.clone();
    changes.apply(&mut params).map_err(Failure::input)?;
    Ok(model.with_params(params))
}

/// Opens a result and its model; a model that is given beside it must be the same.
///
/// # Errors
/// [`Failure`]
pub fn open_result(folder: &Path, beside: Option<&Path>) -> Result<(ResultFolder, Model), Failure> {
    let folder = ResultFolder::open(folder).or_failure()?;
    let model = folder.model()?;
    refuse_foreign_code(&model).or_failure()?;
    if let Some(path) = beside {
        let other = Model::from_file(path)?;
        let other = other.untied(&model.open_ties()).unwrap_or(other);
        let differences = differences(&model, &other);
        if !differences.is_empty() {
            return Err(Failure::Input(vec![another_model(path, &folder, &differences)]));
        }
    }
    Ok((folder, model))
}

fn another_model(path: &Path, folder: &ResultFolder, differences: &[String]) -> String {
    const SHOWN: usize = 8;
    let place = folder.folder().display();
    let mut text = format!("{} is not the model of the result in {place}:", path.display());
    differences.iter().take(SHOWN).for_each(|d| text.push_str(&format!("\n  {d}")));
    if differences.len() > SHOWN {
        text.push_str(&format!("\n  and {} more", differences.len() - SHOWN));
    }
    text
}

/// The runs that a result was fitted to.
pub fn fitted_before(folder: &ResultFolder, runs: &[Run], files: &[RecordFile]) -> Vec<String> {
    let files = runs.iter().zip(files).map(|(run, file)| DataFile::new(&run.name, &file.path));
    let fitted = |file: &DataFile| folder.manifest().data.iter().any(|own| own.is_same(file));
    files.filter(fitted).map(|file| file.run).collect()
}
