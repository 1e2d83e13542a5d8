//! Results of the folder: what each says, and what changed since the one before it.

use crate::folder::{Folder, Kind, Listed};
use fdm_report::page::{Subject, verdict};
use fdm_results::store::{ResultFolder, fingerprint, whole_files};
use fdm_session::effects::difference;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

/// The text of the model in a result.
pub(crate) const MODEL: &str = "model.fdm";

/// What is shown of a result in the history.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct Seen {
    path: String,
    stamp: String,
    kind: String,
    /// The verdict in a sentence.
    says: String,
    command: Vec<String>,
    /// The fingerprint of the model's text.
    text: Option<String>,
    parameters: Vec<Parameter>,
    /// Root mean square of the residuals of each output of each run, validation behind.
    errors: Vec<OutputError>,
}

#[derive(Debug, Clone, Serialize)]
struct Parameter {
    name: String,
    run: Option<String>,
    value: f64,
    error: Option<f64>,
    unit: Option<String>,
}

#[derive(Debug, Clone, Serialize)]
struct OutputError {
    output: String,
    run: String,
    rms: Option<f64>,
    unit: Option<String>,
    /// Of a run that was predicted, not fitted.
    validation: bool,
}

/// What changed from one result to another.
#[derive(Debug, Serialize)]
pub(crate) struct Changes {
    /// Of the model's text, as a difference of lines.
    model: String,
    /// Of records, options and program, in sentences.
    others: Vec<String>,
}

/// What was read before, by path.
#[derive(Default)]
pub(crate) struct Results(Mutex<BTreeMap<String, Seen>>);

impl Results {
    /// All results among the files, the newest first.
    pub(crate) fn seen(&self, folder: &Folder, files: &[Listed]) -> Vec<Seen> {
        let mut known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let results = files.iter().filter(|f| f.kind == Kind::Result);
        let mut all: Vec<Seen> = results
            .map(|file| match known.get(&file.path).filter(|own| own.stamp == file.stamp) {
                Some(own) => own.clone(),
                None => {
                    let own = read(&folder.result(&file.path), file);
                    known.insert(file.path.clone(), own.clone());
                    own
                }
            })
            .collect();
        let age = |seen: &Seen| seen.stamp.split('-').next().and_then(|t| t.parse::<u128>().ok()).unwrap_or_default();
        all.sort_by_key(|seen| std::cmp::Reverse(age(seen)));
        all
    }
}

fn read(place: &Path, file: &Listed) -> Seen {
    let empty = Seen {
        path: file.path.clone(),
        stamp: file.stamp.clone(),
        kind: "result".into(),
        says: String::new(),
        command: Vec::new(),
        text: None,
        parameters: Vec::new(),
        errors: Vec::new(),
    };
    let files = whole_files(place).map_err(|e| e.to_string());
    let text = files.iter().flatten().find(|(name, _)| name == MODEL).map(|(_, bytes)| fingerprint(bytes));
    let subject = files.and_then(|files| Subject::from_files(&files).map_err(|e| e.to_string()));
    let (kind, says) = match &subject {
        Ok(subject) => verdict(subject),
        Err(e) => ("unreadable", e.clone()),
    };
    let seen = Seen { kind: kind.into(), says, text, ..empty };
    let Ok(folder) = ResultFolder::open(place) else { return seen };
    let parameters = folder.parameters().iter().map(|p| Parameter {
        name: p.name.clone(),
        run: p.run.clone(),
        value: p.value,
        error: p.corrected_error.or(p.standard_error),
        unit: p.unit.clone(),
    });
    let predicted = folder.result().fit().and_then(|fit| fit.validation_runs.as_ref());
    let predicted = predicted.into_iter().flat_map(|runs| &runs.outputs).map(|q| (q, true));
    let errors = folder.quality().iter().map(|q| (q, false)).chain(predicted).map(|(q, validation)| OutputError {
        output: q.name.clone(),
        run: q.run.clone(),
        rms: q.rms,
        unit: q.unit.clone(),
        validation,
    });
    let command = folder.manifest().command.clone();
    Seen { command, parameters: parameters.collect(), errors: errors.collect(), ..seen }
}

/// What changed from one result to another.
pub(crate) fn changes(then: &Path, now: &Path) -> Result<Changes, String> {
    let open = |place: &Path| ResultFolder::open(place).map_err(|e| e.to_string());
    let text = |place: &Path| {
        let files = whole_files(place).map_err(|e| e.to_string())?;
        let own =
            files.iter().find(|(name, _)| name == MODEL).map(|(_, text)| String::from_utf8_lossy(text).into_owned());
        Ok::<_, String>(own.unwrap_or_default())
    };
    let (before, behind) = (open(then)?, open(now)?);
    let parts = before.manifest().identity.differences(&behind.manifest().identity);
    let others = parts.iter().filter(|d| d.part != "model").map(ToString::to_string).collect();
    Ok(Changes { model: difference(&text(then)?, &text(now)?, Path::new(MODEL)), others })
}
