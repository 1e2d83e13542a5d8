//! The tables of a PEtab problem, with the place of every cell for messages.
//!
//! Problems of PEtab version 2, as the tables of version 1 that say the same; conditions that begin in the middle of an experiment become events.
//!
//! There conditions stand in long form, experiments say when each begins, placeholders have names of their own, and there are no scales
//! (PEtab 2.0: <https://petab.readthedocs.io/en/latest/v2/documentation_data_format.html>).

use crate::formula::formula;
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

/// Tables of version 2.
pub(crate) struct Tables {
    pub(crate) parameters: Vec<Row>,
    pub(crate) conditions: Vec<Row>,
    pub(crate) experiments: Vec<Row>,
    pub(crate) observables: Vec<Row>,
    pub(crate) measurements: Vec<Row>,
    pub(crate) mapping: Vec<Row>,
}

/// A time, and what is set then: name and formula.
pub(crate) type Setting = (f64, Vec<(String, Row)>);

/// Values that names get at a time in the middle of an experiment.
#[derive(Debug, Clone)]
pub(crate) struct Change {
    /// By the experiment's name.
    pub(crate) by_experiment: BTreeMap<String, Setting>,
}

/// A stretch of an experiment.
struct Period<'a> {
    time: f64,
    /// What is set when it begins: name and row of the table of conditions.
    sets: Vec<(String, &'a Row)>,
}

/// The name of what is simulated without an experiment.
const PLAIN: &str = "simulation";

/// The tables as those of version 1, in which a row of the conditions is an experiment, or what holds before it; beside the name of the SBML file
/// and its text.
///
/// # Errors
/// Every row that cannot be read, or says what is not read.
pub(crate) fn unified(tables: &Tables, (sbml_file, sbml): (String, String)) -> Result<Problem, Vec<String>> {
    let mut wrong = Vec::new();
    let aliases = aliases(&tables.mapping);
    let known = |text: &str| renamed(text, &aliases);
    let mut experiments: Vec<(String, Vec<Period<'_>>)> = Vec::new();
    for row in &tables.experiments {
        if let Err(e) = period(row, &tables.conditions, &known, &mut experiments) {
            wrong.push(e);
        }
    }
    if tables.measurements.iter().any(|m| m.get("experimentId").is_none()) {
        experiments.push((PLAIN.into(), Vec::new()));
    }
    let mut overridden: Vec<String> = Vec::new();
    let mut conditions = Vec::new();
    let mut changes: Vec<Change> = Vec::new();
    for (name, periods) in &mut experiments {
        periods.sort_by(|a, b| a.time.total_cmp(&b.time));
        let (before, during): (Vec<&Period<'_>>, Vec<&Period<'_>>) =
            periods.iter().partition(|p| p.time == f64::NEG_INFINITY);
        let mut rest = during.into_iter();
        let begins = rest.next();
        if let Some(time) = begins.map(|p| p.time).filter(|time| *time != 0.0) {
            wrong.push(format!("the experiment `{name}` begins at {time}; experiments that begin at 0 are read"));
        }
        let mut wide = |id: String, sets: &[(String, &Row)], conditions: &mut Vec<Row>| {
            let mut cells = vec![("conditionId".to_string(), id)];
            for (target, row) in sets {
                if !overridden.contains(target) {
                    overridden.push(target.clone());
                }
                cells.push((target.clone(), known(row.get("targetValue").unwrap_or_default())));
            }
            let place = sets.first().map(|(_, row)| *row);
            conditions.push(Row::made(place, cells));
        };
        if let Some(before) = before.first() {
            wide(format!("{name}{BEFORE}"), &before.sets, &mut conditions);
        }
        wide(name.clone(), begins.map_or(&[][..], |p| &p.sets[..]), &mut conditions);
        for (k, period) in rest.enumerate() {
            if changes.len() == k {
                changes.push(Change { by_experiment: BTreeMap::new() });
            }
            let cell = |(target, row): &(String, &Row)| {
                let value = known(row.get("targetValue").unwrap_or_default());
                (target.clone(), Row::made(Some(row), vec![("targetValue".into(), value)]))
            };
            let sets = period.sets.iter().map(cell).collect();
            changes[k].by_experiment.insert(name.clone(), (period.time, sets));
        }
    }
    let has_before: Vec<&str> = (experiments.iter())
        .filter(|(_, periods)| periods.iter().any(|p| p.time == f64::NEG_INFINITY))
        .map(|(name, _)| name.as_str())
        .collect();
    let measurements = tables.measurements.iter().map(|row| {
        let experiment = row.get("experimentId").unwrap_or(PLAIN).to_string();
        let before = has_before.contains(&experiment.as_str()).then(|| format!("{experiment}{BEFORE}"));
        let mut cells = vec![("simulationConditionId".to_string(), experiment)];
        cells.extend(before.map(|b| ("preequilibrationConditionId".to_string(), b)));
        for column in ["observableParameters", "noiseParameters"] {
            cells.extend(row.get(column).map(|text| (column.to_string(), known(text))));
        }
        row.with(cells)
    });
    let measurements = measurements.collect();
    let parameters = tables.parameters.iter().map(|row| parameter(row, &known)).collect();
    let mut observables = Vec::new();
    for row in &tables.observables {
        match observable(row, &known) {
            Ok(row) => observables.push(row),
            Err(e) => wrong.push(e),
        }
    }
    if !wrong.is_empty() {
        return Err(wrong);
    }
    Ok(Problem {
        sbml_file,
        sbml,
        parameters,
        conditions,
        observables,
        measurements,
        overridden,
        changes,
        persists: true,
    })
}

/// Behind the name of an experiment: what holds before it.
const BEFORE: &str = "_before";

/// Adds a row of the table of experiments to its experiment.
fn period<'a>(
    row: &'a Row,
    conditions: &'a [Row],
    known: &dyn Fn(&str) -> String,
    experiments: &mut Vec<(String, Vec<Period<'a>>)>,
) -> Result<(), String> {
    let (name, time) = (row.need("experimentId")?, row.number("time")?);
    let mut sets = Vec::new();
    if let Some(id) = row.get("conditionId") {
        let own: Vec<&Row> = conditions.iter().filter(|c| c.get("conditionId") == Some(id)).collect();
        if own.is_empty() {
            return Err(row.says("conditionId", &format!("there is no condition `{id}`")));
        }
        for condition in own {
            condition.need("targetValue")?;
            condition.is_value("targetValue")?;
            sets.push((known(condition.need("targetId")?), condition));
        }
    }
    let at = match experiments.iter().position(|(own, _)| own == name) {
        Some(at) => at,
        None => {
            experiments.push((name.into(), Vec::new()));
            experiments.len() - 1
        }
    };
    let periods = &mut experiments[at].1;
    match periods.iter_mut().find(|p| p.time == time) {
        Some(same) => same.sets.append(&mut sets),
        None => periods.push(Period { time, sets }),
    }
    Ok(())
}

/// Names of the problem that mean others of the model.
fn aliases(mapping: &[Row]) -> BTreeMap<String, String> {
    let pair = |row: &Row| Some((row.get("petabEntityId")?.to_string(), row.get("modelEntityId")?.to_string()));
    mapping.iter().filter_map(pair).filter(|(own, other)| own != other).collect()
}

/// A formula in the names of the model.
fn renamed(text: &str, aliases: &BTreeMap<String, String>) -> String {
    if aliases.is_empty() {
        return text.into();
    }
    let is_part = |c: char| c.is_alphanumeric() || c == '_';
    let (mut out, mut word) = (String::new(), String::new());
    for c in text.chars().chain(std::iter::once('\0')) {
        if is_part(c) {
            word.push(c);
            continue;
        }
        out.push_str(aliases.get(&word).unwrap_or(&word));
        word.clear();
        if c != '\0' {
            out.push(c);
        }
    }
    out
}

/// A parameter: what is estimated, and a normal prior; there is no scale.
fn parameter(row: &Row, known: &dyn Fn(&str) -> String) -> Row {
    let mut cells = vec![("parameterScale".to_string(), "lin".to_string())];
    cells.extend(row.get("parameterId").map(|id| ("parameterId".into(), known(id))));
    if let Some(kind) = row.get("priorDistribution") {
        let kind = if kind == "normal" { "parameterScaleNormal" } else { kind };
        cells.push(("objectivePriorType".into(), kind.into()));
        cells.push(("objectivePriorParameters".into(), row.get("priorParameters").unwrap_or_default().into()));
    }
    row.with(cells)
}

/// An observable: placeholders by their numbers, and the scale that its noise means.
fn observable(row: &Row, known: &dyn Fn(&str) -> String) -> Result<Row, String> {
    let id = row.need("observableId")?;
    let mut by = BTreeMap::new();
    for (column, kind) in [("observablePlaceholders", "observableParameter"), ("noisePlaceholders", "noiseParameter")] {
        let names = row.get(column).unwrap_or_default().split(';').map(str::trim).filter(|p| !p.is_empty());
        by.extend(names.enumerate().map(|(k, name)| (name.to_string(), format!("{kind}{}_{id}", k + 1))));
    }
    let mut cells = Vec::new();
    for column in ["observableFormula", "noiseFormula"] {
        cells.extend(row.get(column).map(|text| (column.to_string(), known(&renamed(text, &by)))));
    }
    let scale = match row.get("noiseDistribution").unwrap_or("normal") {
        "log-normal" => {
            cells.push(("noiseDistribution".into(), "normal".into()));
            "log"
        }
        _ => "lin",
    };
    cells.push(("observableTransformation".into(), scale.into()));
    Ok(row.with(cells))
}

/// Just before a time: what is measured there is measured behind the change.
pub(crate) fn just_before(time: f64) -> f64 {
    const PART: f64 = 1e-12;
    time - PART * time.abs().max(f64::MIN_POSITIVE)
}

/// A time that no experiment reaches.
pub(crate) const NEVER: f64 = 1e300;
