//! Model and parameters of a result that was written before.

use crate::failure::Failure;
use fdm::Model;
use fdm::record::Run;
use fdm::store::{DataFile, ResultFolder, differences};
use std::path::{Path, PathBuf};

/// A result that was read back, and its model.
pub(crate) struct Reading {
    pub(crate) folder: ResultFolder,
    pub(crate) model: Model,
}

/// Opens a result; a model that is given beside it must be the same.
pub(crate) fn open(folder: &Path, beside: Option<&Path>) -> Result<Reading, Failure> {
    let folder = ResultFolder::open(folder).map_err(|e| Failure::input([e]))?;
    let model = folder.model()?;
    if let Some(path) = beside {
        let other = Model::from_file(path)?;
        let other = other.untied(&model.open_ties()).unwrap_or(other);
        let differences = differences(&model, &other);
        if !differences.is_empty() {
            return Err(Failure::Input(vec![another(path, &folder, &differences)]));
        }
    }
    Ok(Reading { folder, model })
}

/// The runs that a result was fitted to.
pub(crate) fn were_fitted(folder: &ResultFolder, runs: &[Run], files: &[PathBuf]) -> Vec<String> {
    let files = runs.iter().zip(files).map(|(run, file)| DataFile::new(&run.name, file));
    let fitted = |file: &DataFile| folder.manifest().data.iter().any(|own| own.is_same(file));
    files.filter(fitted).map(|file| file.run).collect()
}

fn another(path: &Path, folder: &ResultFolder, differences: &[String]) -> String {
    const SHOWN: usize = 8;
    let place = folder.folder().display();
    let mut text = format!("{} is not the model of the result in {place}:", path.display());
    differences.iter().take(SHOWN).for_each(|d| text.push_str(&format!("\n  {d}")));
    if differences.len() > SHOWN {
        text.push_str(&format!("\n  and {} more", differences.len() - SHOWN));
    }
    text
}
