//! The tables of a PEtab problem (version 1), with the place of every cell for messages.

use serde::Deserialize;
use std::path::{Path, PathBuf};

/// What the YAML file of a problem says.
#[derive(Debug, Deserialize)]
struct Description {
    format_version: Version,
    parameter_file: Option<Several>,
    #[serde(default)]
    problems: Vec<Files>,
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

fn read(path: &Path) -> Result<String, String> {
    let bytes = std::fs::read(path).map_err(|e| format!("{}: {e}", path.display()))?;
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
        let description: Description =
            serde_saphyr::from_str(&text).map_err(|e| vec![format!("{}: {e}", yaml.display())])?;
        let version = match description.format_version {
            Version::Number(n) => n.to_string(),
            Version::Text(text) => text,
        };
        if version.split('.').next() != Some("1") {
            return Err(vec![format!("{}: format_version {version} is not read; version 1 is", yaml.display())]);
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
        let sbml = read(&folder.join(sbml_file)).map_err(|e| wrong.push(e)).unwrap_or_default();
        if !wrong.is_empty() {
            return Err(wrong);
        }
        Ok(Self { sbml_file: sbml_file.clone(), sbml, parameters, conditions, observables, measurements, overridden })
    }
}
