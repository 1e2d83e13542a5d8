//! Problems of PEtab version 2, as the tables of version 1 that say the same; conditions that begin in the middle of an experiment become events.
//!
//! There conditions stand in long form, experiments say when each begins, placeholders have names of their own, and there are no scales
//! (PEtab 2.0: <https://petab.readthedocs.io/en/latest/v2/documentation_data_format.html>).

use crate::tables::{Problem, Row};
use std::collections::BTreeMap;

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
