//! Several runs at once: patterns behind one `--data`, or a table with one row a run (`--runs runs.csv`): its file, name, role, part,
//! beginning, map, the values that it brings (`known T0 per run;`) and the groups that it belongs to (`param k per group aircraft;`).

use crate::failure::{Failure, did_you_mean};
use crate::value::{map_file, number};
use fdm_grammar::{Groups, Unit};
use fdm_system::Model;
use fdm_system::record::{Known, ReadOptions};
use std::path::{Path, PathBuf};

/// What a run is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// It is fitted.
    Fit,
    /// It is predicted.
    Validation,
}

/// A file to be read, and how.
#[derive(Debug, Clone)]
pub struct RecordFile {
    /// Where it is.
    pub path: PathBuf,
    /// Name of the run, where the file's is not meant.
    pub name: Option<String>,
    /// What the run is for.
    pub role: Role,
    /// How it is read.
    pub options: ReadOptions,
}

/// The files behind `--data`, patterns (`flights/*.csv`) written out in the order of the alphabet. A file that a pattern finds once more is
/// used once.
///
/// # Errors
/// [`Failure`]
pub fn expanded(data: &[PathBuf]) -> Result<Vec<PathBuf>, Failure> {
    let (mut files, mut wrong) = (Vec::new(), Vec::new());
    for path in data {
        let text = path.to_string_lossy();
        if !text.contains(['*', '?', '[']) || path.exists() {
            if text.ends_with(".fdm") {
                wrong.push(format!("--data {text}: this is a model, not a record; give the model in front of --data"));
            }
            files.push(path.clone());
            continue;
        }
        let found = match glob::glob(&text) {
            Ok(found) => found,
            Err(e) => {
                wrong.push(format!("--data {text}: this is no pattern: {e}"));
                continue;
            }
        };
        let mut any = false;
        for file in found {
            match file {
                Ok(file) if file.is_dir() => {}
                Ok(file) => {
                    any = true;
                    if !files.contains(&file) {
                        files.push(file);
                    }
                }
                Err(e) => wrong.push(format!("--data {text}: {e}")),
            }
        }
        if !any {
            wrong.push(format!("--data {text}: no file has such a name (from {})", here()));
        }
    }
    if wrong.is_empty() { Ok(files) } else { Err(Failure::Input(wrong)) }
}

fn here() -> String {
    std::env::current_dir().map_or_else(|_| "here".into(), |folder| folder.display().to_string())
}

/// One row of the table.
struct Row {
    line: u64,
    /// The cells, by column; empty ones are none.
    cells: Vec<Option<String>>,
}

/// A table of runs as it is written.
pub struct RunTable {
    file: PathBuf,
    titles: Vec<String>,
    rows: Vec<Row>,
}

/// Columns that every table may have.
const OWN: [&str; 7] = ["file", "run", "role", "map", "from", "to", "begin"];

impl RunTable {
    /// Reads a table: cells separated as its header is, by `,`, `;` or tabs; lines that begin with `#` are comments.
    ///
    /// # Errors
    /// [`Failure`]
    pub fn read(file: &Path) -> Result<Self, Failure> {
        let shown = file.display();
        let text = fdm_results::store::read_input_text(file)
            .map_err(|e| Failure::input([format!("--runs {shown}: {}", fdm_results::store::reason(&e))]))?;
        let text = text.trim_start_matches('\u{feff}');
        let header = text.lines().find(|l| !l.trim().is_empty() && !l.starts_with('#')).unwrap_or_default();
        let delimiter = *[b';', b'\t', b','].iter().find(|d| header.as_bytes().contains(d)).unwrap_or(&b',');
        let mut reader = csv::ReaderBuilder::new();
        reader.delimiter(delimiter).comment(Some(b'#')).trim(csv::Trim::All);
        let mut reader = reader.from_reader(text.as_bytes());
        let told = |e: csv::Error| Failure::input([format!("--runs {shown}: {e}")]);
        let titles: Vec<String> = reader.headers().map_err(told)?.iter().map(String::from).collect();
        let mut rows = Vec::new();
        for record in reader.records() {
            let record = record.map_err(told)?;
            let line = record.position().map_or(0, csv::Position::line);
            let cells = record.iter().map(|c| Some(c.to_string()).filter(|c| !c.is_empty())).collect();
            rows.push(Row { line, cells });
        }
        let said = |what: &str| Err(Failure::input([format!("--runs {shown}: {what}")]));
        if !titles.iter().any(|t| t == "file") {
            return said(
                "there is no column `file`; the first line holds the names of the columns: file, run, role, map, from, to, begin, and values and groups of the model",
            );
        }
        if let Some(twice) = titles.iter().enumerate().find(|(k, t)| titles[..*k].contains(t)).map(|(_, t)| t) {
            return said(&format!("the column `{twice}` stands there twice"));
        }
        if rows.is_empty() {
            return said("there is no run below the header");
        }
        Ok(Self { file: file.into(), titles, rows })
    }

    fn cell<'r>(&self, row: &'r Row, title: &str) -> Option<&'r str> {
        let column = self.titles.iter().position(|t| t == title)?;
        row.cells.get(column)?.as_deref()
    }

    fn role(&self, row: &Row) -> Result<Role, String> {
        match self.cell(row, "role") {
            None | Some("fit") => Ok(Role::Fit),
            Some("validation") => Ok(Role::Validation),
            Some(other) => Err(format!("role `{other}`: expected `fit` or `validation`")),
        }
    }

    /// The groups of the fitted runs (of all where none is fitted), in the order of the table.
    pub fn groups(&self, model: &Model) -> Groups {
        let fitted = |row: &&Row| self.role(row) == Ok(Role::Fit);
        let any = self.rows.iter().any(|r| fitted(&r));
        let mut groups = Groups::new();
        for grouping in model.groupings() {
            for row in self.rows.iter().filter(|r| !any || fitted(r)) {
                let Some(group) = self.cell(row, grouping) else { continue };
                let known = groups.entry(grouping.to_string()).or_default();
                if !known.iter().any(|g| g == group) {
                    known.push(group.to_string());
                }
            }
        }
        groups
    }

    /// Where the files of the runs are.
    ///
    /// # Errors
    /// [`Failure`]
    pub fn paths(&self) -> Result<Vec<PathBuf>, Failure> {
        let of_row = |row: &Row| {
            let empty = || format!("--runs {}: line {}: the cell `file` is empty", self.file.display(), row.line);
            self.cell(row, "file").map(|file| self.place(file)).ok_or_else(empty)
        };
        let (found, wrong): (Vec<_>, Vec<_>) = self.rows.iter().map(of_row).partition(Result::is_ok);
        let wrong: Vec<String> = wrong.into_iter().filter_map(Result::err).collect();
        if wrong.is_empty() { Ok(found.into_iter().flatten().collect()) } else { Err(Failure::Input(wrong)) }
    }

    /// All files that the rows name, records and maps, whether they are there or not.
    pub fn reads(&self) -> Vec<PathBuf> {
        let of_row = |row: &Row| {
            let record = self.cell(row, "file").map(|file| self.place(file));
            record.into_iter().chain(self.cell(row, "map").map(|map| self.place_of_map(map))).collect::<Vec<_>>()
        };
        self.rows.iter().flat_map(of_row).collect()
    }

    /// Where a map is that a row names: beside the table, or as it is.
    fn place_of_map(&self, map: &str) -> PathBuf {
        let beside = self.place(map);
        if beside.exists() { beside } else { map.into() }
    }

    /// Where a file is that a row names.
    fn place(&self, file: &str) -> PathBuf {
        if file == "-" { file.into() } else { self.file.parent().unwrap_or(Path::new("")).join(file) }
    }

    /// The files of the runs, with `options` where a row says nothing else.
    ///
    /// # Errors
    /// [`Failure`]
    pub fn files(&self, model: &Model, options: &ReadOptions) -> Result<Vec<RecordFile>, Failure> {
        let (known, groupings) = (known(model), model.groupings());
        let (mut wrong, mut files): (Vec<String>, Vec<RecordFile>) = (Vec::new(), Vec::new());
        let shown = self.file.display();
        let mut values = Vec::new();
        for (k, title) in self.titles.iter().enumerate().filter(|(_, t)| !OWN.contains(&t.as_str())) {
            let (name, unit) = heading(title);
            if known.iter().any(|(n, _)| n == name) {
                if let Some(unit) = unit.filter(|u| Unit::parse(u).is_err()) {
                    wrong.push(format!("--runs {shown}: column `{title}`: `{unit}` is not a unit that is known"));
                }
                values.push((k, name.to_string(), unit.map(String::from)));
            } else if !groupings.contains(&name) {
                let there: Vec<&str> =
                    known.iter().map(|(n, _)| n.as_str()).chain(groupings.iter().copied()).chain(OWN).collect();
                let hint = did_you_mean(name, there.iter().copied());
                wrong.push(format!(
                    "--runs {shown}: column `{title}`: the model has neither `known {name}` nor params `per group {name}`{hint}; the columns may be {}",
                    there.join(", ")
                ));
            }
        }
        for row in &self.rows {
            let at = format!("--runs {shown}: line {}", row.line);
            let mut own = options.clone();
            let Some(file) = self.cell(row, "file") else {
                wrong.push(format!("{at}: the cell `file` is empty"));
                continue;
            };
            let role = self.role(row).unwrap_or_else(|said| {
                wrong.push(format!("{at}: {said}"));
                Role::Fit
            });
            for (column, name, unit) in &values {
                match row.cells.get(*column).and_then(Option::as_deref).map(number) {
                    Some(Ok(value)) => {
                        own.known.retain(|k| k.name != *name);
                        own.known.push(Known { name: name.clone(), unit: unit.clone(), value });
                    }
                    Some(Err(e)) => wrong.push(format!("{at}: `{name}`: {e}")),
                    // then the record may hold it
                    None => {}
                }
            }
            for grouping in &groupings {
                match self.cell(row, grouping) {
                    Some(group) if is_name(group) => drop(own.groups.insert(grouping.to_string(), group.into())),
                    Some(group) => wrong.push(format!(
                        "{at}: `{group}` is no name of a group: letters, digits, `_`, `-`, `.` and spaces make one, 40 at most"
                    )),
                    None => {}
                }
            }
            for (title, bound) in [("from", &mut own.from), ("to", &mut own.to), ("begin", &mut own.begin)] {
                match self.cell(row, title).map(number) {
                    Some(Ok(value)) => *bound = Some(value),
                    Some(Err(e)) => wrong.push(format!("{at}: `{title}`: {e}")),
                    None => {}
                }
            }
            if let Some(map) = self.cell(row, "map") {
                match map_file(&self.place_of_map(map).to_string_lossy()) {
                    Ok(map) => own.map_file = Some(map),
                    Err(e) => wrong.push(format!("{at}: map `{map}`: {e}")),
                }
            }
            let path = self.place(file);
            let name = self.cell(row, "run").map(String::from);
            if let (Some(name), true) = (&name, files.iter().any(|f| f.name == name)) {
                wrong.push(format!("{at}: the run `{name}` stands in the table already"));
            }
            files.push(RecordFile { path, name, role, options: own });
        }
        if wrong.is_empty() { Ok(files) } else { Err(Failure::Input(wrong)) }
    }
}

/// Names and units of the values that runs of a model bring.
fn known(model: &Model) -> Vec<(String, Option<String>)> {
    let inputs = model.definition().inputs.iter().filter(|i| i.known && i.membership.is_none());
    inputs.map(|i| (i.quantity.name.clone(), i.quantity.unit.as_ref().map(ToString::to_string))).collect()
}

/// `T0 [K]`: name and unit.
fn heading(title: &str) -> (&str, Option<&str>) {
    match title.strip_suffix(']').and_then(|t| t.split_once('[')) {
        Some((name, unit)) => (name.trim(), Some(unit.trim())),
        None => (title, None),
    }
}

/// What a group may be called.
fn is_name(group: &str) -> bool {
    let of_name = |c: char| c.is_alphanumeric() || matches!(c, '_' | '-' | '.' | ' ');
    group.chars().count() <= 40 && group.chars().all(of_name)
}

/// `NAME=VALUE`, `NAME=VALUE UNIT`
pub fn known_value(text: &str) -> Result<Known, String> {
    let (name, amount) = text.split_once('=').ok_or("expected NAME=VALUE, such as T0=293 or `T0=20 degC`")?;
    let amount = amount.trim();
    let (value, unit) = amount.split_once(char::is_whitespace).map_or((amount, None), |(v, u)| (v, Some(u.trim())));
    if let Some(unit) = unit.filter(|u| Unit::parse(u).is_err()) {
        return Err(format!("`{unit}` is not a unit that is known"));
    }
    Ok(Known { name: name.trim().into(), unit: unit.map(String::from), value: number(value)? })
}

/// `GROUPING=GROUP`
pub fn group(text: &str) -> Result<(String, String), String> {
    let (grouping, group) = text.split_once('=').ok_or("expected GROUPING=GROUP, such as aircraft=A")?;
    let group = group.trim();
    if group.is_empty() || !is_name(group) {
        return Err(format!("`{group}` is no name of a group"));
    }
    Ok((grouping.trim().into(), group.into()))
}

/// `COLUMN`, `OUTPUT=COLUMN`
pub fn mask(text: &str) -> Result<fdm_system::record::SampleMask, String> {
    let (output, column) = text.split_once('=').map_or((None, text), |(o, c)| (Some(o.trim().to_string()), c));
    let column = column.trim().to_string();
    if column.is_empty() {
        Err("expected COLUMN or OUTPUT=COLUMN".into())
    } else {
        Ok(fdm_system::record::SampleMask { output, column })
    }
}
