//! The model that a verb works on, with the changes that were typed.

use crate::failure::{Failure, tell};
use clap::Args;
use fdm::Model;
use fdm::estimate::Changes;
use std::path::{Path, PathBuf};

/// A model and what is to be different about its parameters.
#[derive(Debug, Args)]
pub(crate) struct Subject {
    /// Model file (.fdm)
    #[arg(value_name = "MODEL")]
    pub(crate) model: PathBuf,
    /// Other start value of a parameter (free initial values are called `x(0)`)
    #[arg(long = "set", value_name = "NAME=VALUE", value_parser = assignment, help_heading = "Parameters")]
    pub(crate) set: Vec<(String, f64)>,
    /// Switch off the tie of a parameter, so that it is estimated by itself; `all` for every tie
    #[arg(long, value_name = "NAME,...|all", value_delimiter = ',', help_heading = "Parameters")]
    pub(crate) untie: Vec<String>,
}

/// Which parameters are estimated, where that differs from the model's text.
#[derive(Debug, Default, Args)]
pub(crate) struct Estimated {
    /// Keep a parameter at its start value
    #[arg(long, value_name = "NAME", help_heading = "Parameters")]
    pub(crate) fix: Vec<String>,
    /// Estimate a parameter that the model declares `fixed`
    #[arg(long, value_name = "NAME", help_heading = "Parameters")]
    pub(crate) free: Vec<String>,
}

impl Subject {
    /// Reads and compiles the model; warnings go to standard error.
    pub(crate) fn load(&self) -> Result<Model, Failure> {
        load_model(&self.model)?.untied(&self.untie).map_err(|e| Failure::input([e]))
    }

    /// The changes of start values, together with names to fix and to free.
    pub(crate) fn changes(&self, estimated: &Estimated) -> Changes {
        Changes { set: self.set.clone(), fix: estimated.fix.clone(), free: estimated.free.clone() }
    }
}

/// Reads and compiles a model; warnings go to standard error.
pub(crate) fn load_model(file: &Path) -> Result<Model, Failure> {
    let model = Model::from_file(file)?;
    tell(model.source(), model.warnings());
    Ok(model)
}

/// `NAME=VALUE`
pub(crate) fn assignment(text: &str) -> Result<(String, f64), String> {
    let (name, value) = text.rsplit_once('=').ok_or("expected NAME=VALUE")?;
    let value = value.trim().parse().map_err(|_| format!("`{value}` is not a number"))?;
    Ok((name.trim().to_string(), value))
}
