//! What a page is about, read from the files of a result.

use super::table::Table;
use fdm_grammar::Source;
use fdm_grammar::syntax::{SyntaxTree, parse};
use serde_json::Value;

/// A result, ready to be shown.
#[derive(Debug)]
pub struct Subject {
    /// What it was made from.
    pub(super) manifest: Value,
    /// Everything that `--json` prints.
    pub(super) result: Value,
    /// The model's text.
    pub(super) source: Source,
    /// What the text says; none when this program no longer reads it.
    pub(super) tree: Option<SyntaxTree>,
    /// What a diagnosis came to, where it is one.
    pub(super) diagnosis: Option<Value>,
    /// The model with the accepted effects.
    pub(super) extended: Option<(Source, SyntaxTree)>,
    /// Time histories: name of the run, then time, inputs, and of every output measurement, response and residual; of a
    /// diagnosis, responses before and after.
    pub(super) runs: Vec<(String, Table)>,
    /// Estimates and errors of every repeat of a study.
    pub(super) repeats: Option<Table>,
    /// How far work is that goes on; none of a result.
    pub(super) progress: Option<Value>,
    /// Spectra: name of the run, then frequency, and of every output real and imaginary parts, measured and modelled.
    pub(super) spectra: Vec<(String, Table)>,
}

/// Why there is no page.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the result lacks `{file}`, or it cannot be read, and a page cannot be made without it")]
pub struct SubjectError {
    /// The file.
    pub file: String,
}

impl Subject {
    /// From the files of a result: names and contents, in any order.
    ///
    /// # Errors
    /// [`SubjectError`] when a file without which there is nothing to show is missing or is not what it should be.
    pub fn from_files(files: &[(String, Vec<u8>)]) -> Result<Self, SubjectError> {
        let content = |name: &str| {
            let found = files.iter().find(|(n, _)| n == name).map(|(_, content)| &content[..]);
            found.ok_or_else(|| SubjectError { file: name.into() })
        };
        let json = |name: &str| {
            serde_json::from_slice::<Value>(content(name)?).map_err(|_| SubjectError { file: name.into() })
        };
        let manifest = json("manifest.json")?;
        let model = String::from_utf8_lossy(content("model.fdm")?).into_owned();
        let source = Source::new(manifest["model_file"].as_str().unwrap_or("model.fdm"), model);
        let tree = parse(&source).ok();
        // a table for each run, by its number: names of files hold names of runs as far as file systems allow
        let tables = |begins: fn(usize) -> String| -> Vec<(String, Table)> {
            let of_run = |(k, run): (usize, String)| {
                let start = begins(k + 1);
                let (_, content) = files.iter().find(|(name, _)| name.starts_with(&start) && name.ends_with(".csv"))?;
                Some((run, Table::read(content)?))
            };
            named(&manifest).into_iter().enumerate().filter_map(of_run).collect()
        };
        let (runs, spectra) = (tables(|k| format!("run_{k}_")), tables(|k| format!("spectrum_{k}.")));
        let diagnosis = json("diagnosis.json").ok();
        let result = match &diagnosis {
            Some(_) => Value::Null,
            None => json("result.json")?,
        };
        let extended = content("extended.fdm").ok().and_then(|text| {
            let source = Source::new("extended.fdm", String::from_utf8_lossy(text));
            parse(&source).ok().map(|tree| (source, tree))
        });
        let repeats = content("repeats.csv").ok().and_then(Table::read);
        Ok(Self { result, diagnosis, extended, runs, repeats, progress: None, spectra, source, tree, manifest })
    }

    /// From what is told of work that goes on; `silent` are the seconds since it was told, where that is longer than it should be.
    ///
    /// # Errors
    /// [`SubjectError`] when the text is something else.
    pub fn from_progress(text: &str, silent: Option<f64>) -> Result<Self, SubjectError> {
        let wrong = || SubjectError { file: "progress".into() };
        let mut told: Value = serde_json::from_str(text).map_err(|_| wrong())?;
        if told["kind"] != "fdm progress" || told["format"] != 1 {
            return Err(wrong());
        }
        let manifest = told["manifest"].take();
        let model = told["model_text"].as_str().unwrap_or_default();
        let source = Source::new(manifest["model_file"].as_str().unwrap_or("model.fdm"), model);
        let tree = parse(&source).ok();
        let mut progress = told["progress"].take();
        progress["silent"] = silent.into();
        Ok(Self {
            result: told["result"].take(),
            diagnosis: None,
            extended: None,
            runs: Vec::new(),
            repeats: None,
            progress: Some(progress),
            spectra: Vec::new(),
            source,
            tree,
            manifest,
        })
    }

    /// The name of the model.
    pub(super) fn name(&self) -> &str {
        self.result["model"].as_str().or(self.manifest["model"].as_str()).unwrap_or("model")
    }

    /// The unit of time.
    pub(super) fn time(&self) -> String {
        let column = self.runs.first().and_then(|(_, table)| table.column("t"));
        column.and_then(|c| c.unit.clone()).unwrap_or_else(|| "s".into())
    }

    /// The entries of a list of the result.
    pub(super) fn list(&self, name: &str) -> &[Value] {
        list(&self.result[name])
    }
}

/// The entries of a list; none where there is no list.
pub(super) fn list(value: &Value) -> &[Value] {
    value.as_array().map_or(&[], |all| &all[..])
}

/// A name, and the run that it belongs to where there is one.
pub(super) fn called(value: &Value) -> String {
    let name = value["name"].as_str().unwrap_or_default();
    value["run"].as_str().map_or_else(|| name.to_string(), |run| format!("{name} ({run})"))
}

/// The numbers of a list; NaN for what is none.
pub(super) fn numbers(value: &Value) -> Vec<f64> {
    list(value).iter().map(|v| v.as_f64().unwrap_or(f64::NAN)).collect()
}

fn named(manifest: &Value) -> Vec<String> {
    list(&manifest["data"]).iter().map(|d| d["run"].as_str().unwrap_or_default().to_string()).collect()
}
