//! The tables of a PEtab problem, with the place of every cell for messages.

use crate::formula::formula;
use crate::version_two::{Change, Tables, unified};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What the YAML file of a problem says.
#[derive(Debug, Deserialize)]
struct Description {
    format_version: Version,
    parameter_file: Option<Several>,
    #[serde(default)]
    problems: Vec<Files>,
    /// From here on of version 2.
    #[serde(default)]
    model_files: BTreeMap<String, ModelFile>,
    #[serde(default)]
    parameter_files: Vec<String>,
    #[serde(default)]
    condition_files: Vec<String>,
    #[serde(default)]
    experiment_files: Vec<String>,
    #[serde(default)]
    observable_files: Vec<String>,
    #[serde(default)]
    measurement_files: Vec<String>,
    #[serde(default)]
    mapping_files: Vec<String>,
}

/// A model of a problem of version 2.
#[derive(Debug, Deserialize)]
struct ModelFile {
    location: String,
    language: String,
}

#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum Version {
    Number(f64),
    Text(String),
}

#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum Several {
    One(String),
    Many(Vec<String>),
}

/// The files of one problem.
#[derive(Debug, Deserialize)]
struct Files {
    #[serde(default)]
    sbml_files: Vec<String>,
    #[serde(default)]
    condition_files: Vec<String>,
    #[serde(default)]
    observable_files: Vec<String>,
    #[serde(default)]
    measurement_files: Vec<String>,
}

/// Everything that a problem consists of, as it is read.
#[derive(Debug)]
pub(crate) struct Problem {
    pub(crate) sbml_file: String,
    pub(crate) sbml: String,
    pub(crate) parameters: Vec<Row>,
    pub(crate) conditions: Vec<Row>,
    pub(crate) observables: Vec<Row>,
    pub(crate) measurements: Vec<Row>,
    /// Columns of the table of conditions beside its own.
    pub(crate) overridden: Vec<String>,
    /// What changes in the middle of experiments: the first changes of all, the second ones, ... (version 2).
    pub(crate) changes: Vec<Change>,
    /// Whether a value that was set before the experiment stays where nothing new is set (version 2).
    pub(crate) persists: bool,
}

/// A row of a table.
#[derive(Debug, Clone)]
pub(crate) struct Row {
    file: std::rc::Rc<str>,
    line: u64,
    columns: std::rc::Rc<[String]>,
    cells: Vec<String>,
}

impl Row {
    /// A cell that is not empty.
    pub(crate) fn get(&self, column: &str) -> Option<&str> {
        let k = self.columns.iter().position(|c| c == column)?;
        self.cells.get(k).map(|c| c.trim()).filter(|c| !c.is_empty())
    }

    /// A cell that must be there.
    ///
    /// # Errors
    /// Where it is not.
    pub(crate) fn need(&self, column: &str) -> Result<&str, String> {
        self.get(column).ok_or_else(|| self.says(column, "a value is needed"))
    }

    /// A number that must be there.
    ///
    /// # Errors
    /// Where it is missing or no number.
    pub(crate) fn number(&self, column: &str) -> Result<f64, String> {
        let text = self.need(column)?;
        number(text).ok_or_else(|| self.says(column, &format!("`{text}` is not a number")))
    }

    /// That a cell is a number or a formula, where it is not empty.
    ///
    /// # Errors
    /// What a formula would need, and where.
    pub(crate) fn is_value(&self, column: &str) -> Result<(), String> {
        match self.get(column).filter(|text| number(text).is_none()) {
            Some(text) => formula(text).map(drop).map_err(|e| self.says(column, &e)),
            None => Ok(()),
        }
    }

    /// A row of these cells that stands where another does.
    pub(crate) fn made(place: Option<&Self>, cells: Vec<(String, String)>) -> Self {
        let (file, line) = place.map_or_else(|| (std::rc::Rc::from(""), 0), |row| (row.file.clone(), row.line));
        let (columns, cells): (Vec<String>, Vec<String>) = cells.into_iter().unzip();
        Self { file, line, columns: columns.into(), cells }
    }

    /// This row with other cells, or with further ones.
    pub(crate) fn with(&self, cells: Vec<(String, String)>) -> Self {
        let mut all: Vec<(String, String)> = cells;
        for (column, cell) in self.columns.iter().zip(&self.cells) {
            if !all.iter().any(|(own, _)| own == column) {
                all.push((column.clone(), cell.clone()));
            }
        }
        Self::made(Some(self), all)
    }

    /// What is to be said of a cell, with its place.
    pub(crate) fn says(&self, column: &str, what: &str) -> String {
        format!("{}, line {}, column {column}: {what}", self.file, self.line)
    }
}

/// A number as PEtab's tables write it.
pub(crate) fn number(text: &str) -> Option<f64> {
    match text.to_ascii_lowercase().as_str() {
        "inf" | "+inf" | "infinity" => Some(f64::INFINITY),
        "-inf" | "-infinity" => Some(f64::NEG_INFINITY),
        "nan" => None,
        _ => text.parse().ok(),
    }
}

/// What the reader of YAML says, without a word that whoever prints it says too.
fn plain(said: &str) -> &str {
    said.strip_prefix("error: ").unwrap_or(said)
}

fn read(path: &Path) -> Result<String, String> {
    let bytes = fdm_results::store::read_input(path).map_err(|e| format!("{}: {e}", path.display()))?;
    String::from_utf8(bytes).map_err(|_| format!("{}: it is not UTF-8 text", path.display()))
}

/// Rows of several files with the columns that must be there; further columns of the files are `rest`.
fn table(folder: &Path, files: &[String], needed: &[&str], rest: &mut Vec<String>) -> Result<Vec<Row>, Vec<String>> {
    let (mut rows, mut wrong) = (Vec::new(), Vec::new());
    for file in files {
        let text = match read(&folder.join(file)) {
            Ok(text) => text,
            Err(e) => {
                wrong.push(e);
                continue;
            }
        };
        let name: std::rc::Rc<str> = file.as_str().into();
        let mut reader = csv::ReaderBuilder::new().delimiter(b'\t').flexible(true).from_reader(text.as_bytes());
        let titles: Vec<String> = match reader.headers() {
            Ok(titles) => titles.iter().map(|t| t.trim_start_matches('\u{feff}').trim().to_string()).collect(),
            Err(e) => {
                wrong.push(format!("{file}: {e}"));
                continue;
            }
        };
        let missing: Vec<String> =
            needed.iter().filter(|n| !titles.iter().any(|t| t == *n)).map(|n| format!("`{n}`")).collect();
        if !missing.is_empty() {
            wrong.push(format!("{file}: there is no column {}", missing.join(", no column ")));
            continue;
        }
        rest.extend(titles.iter().filter(|t| !rest.contains(t) && !t.is_empty()).cloned().collect::<Vec<_>>());
        let columns: std::rc::Rc<[String]> = titles.into();
        for record in reader.records() {
            match record {
                Ok(record) => {
                    let line = record.position().map_or(0, csv::Position::line);
                    let cells: Vec<String> = record.iter().map(String::from).collect();
                    if cells.iter().any(|c| !c.trim().is_empty()) {
                        rows.push(Row { file: name.clone(), line, columns: columns.clone(), cells });
                    }
                }
                Err(e) => wrong.push(format!("{file}: {e}")),
            }
        }
    }
    if wrong.is_empty() { Ok(rows) } else { Err(wrong) }
}

impl Problem {
    /// Reads the files that a YAML file names.
    ///
    /// # Errors
    /// Every file, column or statement that is missing, broken, or not read.
    pub(crate) fn read(yaml: &Path) -> Result<Self, Vec<String>> {
        let one = |e: String| vec![e];
        let text = read(yaml).map_err(one)?;
        let description: Description = serde_saphyr::from_str(&text)
            .map_err(|e| vec![format!("{}: {}", yaml.display(), plain(&e.to_string()))])?;
        let version = match &description.format_version {
            Version::Number(n) => n.to_string(),
            Version::Text(text) => text.clone(),
        };
        match version.split('.').next() {
            Some("1") => {}
            Some("2") => return Self::second(yaml, &description),
            _ => {
                let what = "is not read; versions 1 and 2 are";
                return Err(vec![format!("{}: format_version {version} {what}", yaml.display())]);
            }
        }
        let [files] = &description.problems[..] else {
            let found = description.problems.len();
            return Err(vec![format!("{}: {found} problems stand in it; one is read at a time", yaml.display())]);
        };
        let [sbml_file] = &files.sbml_files[..] else {
            let found = files.sbml_files.len();
            return Err(vec![format!("{}: one SBML file is read, {found} are named", yaml.display())]);
        };
        let parameter_files = match description.parameter_file {
            Some(Several::One(file)) => vec![file],
            Some(Several::Many(files)) => files,
            None => return Err(vec![format!("{}: `parameter_file` is missing", yaml.display())]),
        };
        let folder: PathBuf = yaml.parent().unwrap_or(Path::new("")).into();
        let (mut none, mut overridden) = (Vec::new(), Vec::new());
        let mut wrong = Vec::new();
        let mut rows = |files: &[String], needed: &[&str], rest: &mut Vec<String>| {
            table(&folder, files, needed, rest).unwrap_or_else(|e| {
                wrong.extend(e);
                Vec::new()
            })
        };
        let parameters = rows(&parameter_files, &["parameterId"], &mut none);
        let conditions = rows(&files.condition_files, &["conditionId"], &mut overridden);
        let observables = rows(&files.observable_files, &["observableId", "observableFormula"], &mut none);
        let needed = ["observableId", "simulationConditionId", "measurement", "time"];
        let measurements = rows(&files.measurement_files, &needed, &mut none);
        overridden.retain(|c| c != "conditionId" && c != "conditionName");
        let values = conditions.iter().flat_map(|row| overridden.iter().map(|column| row.is_value(column)));
        wrong.extend(values.filter_map(Result::err));
        let sbml = read(&folder.join(sbml_file)).map_err(|e| wrong.push(e)).unwrap_or_default();
        if !wrong.is_empty() {
            return Err(wrong);
        }
        Ok(Self {
            sbml_file: sbml_file.clone(),
            sbml,
            parameters,
            conditions,
            observables,
            measurements,
            overridden,
            changes: Vec::new(),
            persists: false,
        })
    }

    /// The files of a problem of version 2.
    fn second(yaml: &Path, description: &Description) -> Result<Self, Vec<String>> {
        let mut models = description.model_files.values();
        let (Some(model), None) = (models.next(), models.next()) else {
            let found = description.model_files.len();
            return Err(vec![format!("{}: one model is read, {found} are named", yaml.display())]);
        };
        if model.language != "sbml" {
            let what = format!("a model in the language `{}` is not read; SBML is", model.language);
            return Err(vec![format!("{}: {what}", yaml.display())]);
        }
        let folder: PathBuf = yaml.parent().unwrap_or(Path::new("")).into();
        let mut wrong = Vec::new();
        let mut rows = |files: &[String], needed: &[&str]| {
            table(&folder, files, needed, &mut Vec::new()).unwrap_or_else(|e| {
                wrong.extend(e);
                Vec::new()
            })
        };
        let tables = Tables {
            parameters: rows(&description.parameter_files, &["parameterId"]),
            conditions: rows(&description.condition_files, &["conditionId", "targetId", "targetValue"]),
            experiments: rows(&description.experiment_files, &["experimentId", "time", "conditionId"]),
            observables: rows(&description.observable_files, &["observableId", "observableFormula"]),
            measurements: rows(&description.measurement_files, &["observableId", "measurement", "time"]),
            mapping: rows(&description.mapping_files, &["petabEntityId", "modelEntityId"]),
        };
        let sbml = read(&folder.join(&model.location)).map_err(|e| wrong.push(e)).unwrap_or_default();
        if !wrong.is_empty() {
            return Err(wrong);
        }
        unified(&tables, (model.location.clone(), sbml))
    }
}
