//! What makes two fits the same: the same program, model, data and options give the same bits.

use super::fingerprint::fingerprint;
use fdm_system::model::Model;
use fdm_system::record::Run;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::fmt;

/// What the name of an option begins with.
const OPTION: &str = "option ";
/// The fingerprint of all options.
const OPTIONS: &str = "options";

/// Everything that the bits of a fit depend on, by name.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Identity {
    parts: Vec<(String, String)>,
}

/// Something that differs between two fits.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Difference {
    /// What it is.
    pub part: String,
    /// What it was.
    pub then: Option<String>,
    /// What it is now.
    pub now: Option<String>,
}

impl Identity {
    /// The identity of a fit with this program.
    pub fn of(model: &Model, runs: &[Run], options: &impl Serialize) -> Self {
        let mut parts = vec![
            ("version of fdm".into(), env!("CARGO_PKG_VERSION").into()),
            ("model".into(), fingerprint(&texts(model))),
            ("number of runs".into(), runs.len().to_string()),
        ];
        let untied = model.open_ties();
        if !untied.is_empty() {
            parts.push(("params without their ties".into(), untied.join(", ")));
        }
        parts.extend(runs.iter().map(|run| (format!("data of run `{}`", run.name), contents(run))));
        parts.extend(chosen(options));
        Self { parts }
    }

    /// SHA-256 of the model's text; none where it is of several texts.
    pub fn model(&self) -> Option<&str> {
        self.parts.iter().find(|(part, _)| part == "model").map(|(_, value)| value.as_str())
    }

    /// The names of the options, whatever they hold: those of one kind of estimation.
    pub fn options(&self) -> Vec<String> {
        let mut names: Vec<String> = Vec::new();
        for name in self.parts.iter().filter_map(|(part, _)| part.strip_prefix(OPTION)) {
            let name = name.split(',').next().unwrap_or_default().to_string();
            if !names.contains(&name) {
                names.push(name);
            }
        }
        names
    }

    /// The identity of work on several texts, by name, with this program.
    pub fn of_texts(texts: &[(String, Vec<u8>)], options: &impl Serialize) -> Self {
        let mut parts = vec![("version of fdm".into(), env!("CARGO_PKG_VERSION").into())];
        parts.extend(texts.iter().map(|(name, bytes)| (format!("file `{name}`"), fingerprint(bytes))));
        parts.extend(chosen(options));
        Self { parts }
    }

    /// What is not the same in `now`.
    pub fn differences(&self, now: &Self) -> Vec<Difference> {
        let value = |of: &Self, part: &str| of.parts.iter().find(|(p, _)| p == part).map(|(_, v)| v.clone());
        let mut names: Vec<&String> = Vec::new();
        for (name, _) in self.parts.iter().chain(&now.parts) {
            if !names.contains(&name) {
                names.push(name);
            }
        }
        let compared = names.into_iter().map(|name| Difference {
            part: name.clone(),
            then: value(self, name),
            now: value(now, name),
        });
        let mut found: Vec<Difference> = compared.filter(|d| d.then != d.now).collect();
        // the fingerprint of all options has nothing to add to one that is named
        if found.iter().any(|d| d.part.starts_with(OPTION)) {
            found.retain(|d| d.part != OPTIONS);
        }
        found
    }
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const LONG: usize = 40;
        let part = &self.part;
        match (&self.then, &self.now) {
            (Some(then), Some(now)) if then.len() <= LONG && now.len() <= LONG => {
                write!(f, "{part}: {then} there, {now} here")
            }
            (Some(_), Some(_)) => write!(f, "another {part}"),
            (Some(_), None) => write!(f, "{part}: there, but not here"),
            (None, _) => write!(f, "{part}: here, but not there"),
        }
    }
}

/// The text of a model; with the files that it uses, each behind its length.
fn texts(model: &Model) -> Vec<u8> {
    let mut bytes = model.source().text().as_bytes().to_vec();
    for used in &model.source().texts()[1..] {
        bytes.extend_from_slice(&(used.text().len() as u64).to_le_bytes());
        bytes.extend_from_slice(used.text().as_bytes());
    }
    bytes
}

/// Every number of a run, to the bit.
fn contents(run: &Run) -> String {
    let mut bytes = Vec::new();
    for values in [&run.time, &run.inputs, &run.measured] {
        bytes.extend_from_slice(&(values.len() as u64).to_le_bytes());
        bytes.extend(values.iter().flat_map(|v| v.to_bits().to_le_bytes()));
    }
    bytes.extend(run.held.iter().map(|held| u8::from(*held)));
    fingerprint(&bytes)
}

/// The fingerprint of all options by their values, to the bit, and each of them by its name for people: an option that is added later
/// is covered without being named here.
fn chosen(options: &impl Serialize) -> Vec<(String, String)> {
    // options are plain values, which always have bytes and a JSON form
    let bytes = postcard::to_stdvec(options).unwrap_or_default();
    let mut parts = vec![(OPTIONS.to_string(), fingerprint(&bytes))];
    named(&serde_json::to_value(options).unwrap_or_default(), &mut Vec::new(), &mut parts);
    parts
}

/// Every value of a document with the names that lead to it; entries of lists have their numbers.
fn named(value: &Value, path: &mut Vec<String>, parts: &mut Vec<(String, String)>) {
    let mut inside = |name: String, value: &Value| {
        path.push(name);
        named(value, path, parts);
        path.pop();
    };
    match value {
        Value::Object(map) if !map.is_empty() => map.iter().for_each(|(k, v)| inside(k.replace('_', " "), v)),
        Value::Array(list) if !list.is_empty() => {
            list.iter().enumerate().for_each(|(k, v)| inside((k + 1).to_string(), v));
        }
        Value::String(text) => parts.push((format!("{OPTION}{}", path.join(", ")), text.clone())),
        other => parts.push((format!("{OPTION}{}", path.join(", ")), other.to_string())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fdm_estimate::{Changes, FitOptions, Noise, Options};

    fn run(name: &str, last: f64) -> Run {
        Run {
            name: name.into(),
            time: vec![0.0, 1.0],
            inputs: Vec::new(),
            held: Vec::new(),
            measured: vec![1.0, last],
            input_gaps: Vec::new(),
            stated: Vec::new(),
            output_gaps: vec![0],
        }
    }

    fn said(then: &Identity, now: &Identity) -> Vec<String> {
        then.differences(now).iter().map(ToString::to_string).collect()
    }

    #[test]
    fn what_differs_is_named() {
        let text = "model a { param k = 1; output y = k; }";
        let model = Model::from_text("a.fdm", text).unwrap();
        let other = Model::from_text("a.fdm", text.replace("= 1", "= 2")).unwrap();
        let options = FitOptions::default();
        let then = Identity::of(&model, &[run("one", 2.0)], &options);
        assert_eq!(said(&then, &Identity::of(&model, &[run("one", 2.0)], &options)), Vec::<String>::new());
        assert_eq!(said(&then, &Identity::of(&other, &[run("one", 2.0)], &options)), ["another model"]);
        let bits = f64::from_bits(2.0f64.to_bits() + 1);
        assert_eq!(said(&then, &Identity::of(&model, &[run("one", bits)], &options)), ["another data of run `one`"]);
        let two = Identity::of(&model, &[run("one", 2.0), run("two", 2.0)], &options);
        assert_eq!(said(&then, &two), ["number of runs: 1 there, 2 here", "data of run `two`: here, but not there"]);
    }

    #[test]
    fn used_files_belong_to_the_model() {
        let model = |k: f64| {
            let used = [format!("model b {{ param k = {k}; let y = k; }}")];
            Model::from_texts("m.fdm", "model m { use \"b.fdm\" as b; output y = b.y; }", &used).unwrap()
        };
        let options = FitOptions::default();
        let [one, two] = [1.0, 2.0].map(|k| Identity::of(&model(k), &[], &options));
        assert_eq!(said(&one, &Identity::of(&model(1.0), &[], &options)), Vec::<String>::new());
        assert_eq!(said(&one, &two), ["another model"]);
    }

    #[test]
    fn every_option_counts_and_is_called_by_its_name() {
        let model = Model::from_text("a.fdm", "model a { param k = 1; output y = k; }").unwrap();
        let of = |options: &FitOptions| Identity::of(&model, &[], options);
        let then = FitOptions {
            changes: Changes { set: vec![("k".into(), 1.0), ("l: [".into(), 0.1)], ..Changes::default() },
            ..FitOptions::default()
        };
        let mut now = then.clone();
        now.options.iterations = 50;
        assert_eq!(said(&of(&then), &of(&now)), ["option options, iterations: 100 there, 50 here"]);
        now = FitOptions { changes: then.changes.clone(), ..FitOptions::default() };
        now.changes.set[1].1 = 0.1f64.next_up();
        assert_eq!(of(&then).differences(&of(&now)).len(), 1);
        now = FitOptions { options: Options { noise: Noise::Full, ..Options::default() }, ..then.clone() };
        assert_eq!(said(&of(&then), &of(&now)), ["option options, noise: diagonal there, full here"]);
        now = FitOptions { per_interval: Some(4), ..then.clone() };
        assert!(!of(&then).differences(&of(&now)).is_empty());
    }
}
