//! What makes two fits the same: the same program, model, data and options give the same bits.

use super::fingerprint::fingerprint;
use crate::model::Model;
use crate::record::Run;
use serde::{Deserialize, Serialize};
use std::fmt;

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
    pub fn of(model: &Model, runs: &[Run], options: &impl fmt::Debug) -> Self {
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
        parts.extend(lines(options));
        Self { parts }
    }

    /// The names of the options, whatever they hold: those of one kind of estimation.
    pub fn options(&self) -> Vec<String> {
        let mut names: Vec<String> = Vec::new();
        for name in self.parts.iter().filter_map(|(part, _)| part.strip_prefix("option ")) {
            let name = name.split(',').next().unwrap_or_default().to_string();
            if !names.contains(&name) {
                names.push(name);
            }
        }
        names
    }

    /// The identity of work on several texts, by name, with this program.
    pub fn of_texts(texts: &[(String, Vec<u8>)], options: &impl fmt::Debug) -> Self {
        let mut parts = vec![("version of fdm".into(), env!("CARGO_PKG_VERSION").into())];
        parts.extend(texts.iter().map(|(name, bytes)| (format!("file `{name}`"), fingerprint(bytes))));
        parts.extend(lines(options));
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
        compared.filter(|d| d.then != d.now).collect()
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

/// Options as they print themselves, one part for each line: an option that is added later is covered without being
/// named here.
fn lines(options: &impl fmt::Debug) -> Vec<(String, String)> {
    let text = format!("{options:#?}");
    let mut path: Vec<(String, usize)> = Vec::new();
    let mut parts = Vec::new();
    for line in text.lines() {
        let line = line.trim().trim_end_matches(',');
        if line.starts_with(['}', ']', ')']) {
            path.pop();
            continue;
        }
        // the number of an entry tells entries of one list apart
        let number = path.last_mut().map_or(0, |(_, n)| std::mem::replace(n, *n + 1));
        let (name, value) = line.split_once(": ").map_or((None, line), |(name, value)| (Some(name), value));
        let name = name.map_or_else(|| format!("{}", number + 1), |n| n.replace('_', " "));
        if value.ends_with(['{', '[', '(']) {
            path.push((name, 0));
            continue;
        }
        let place: Vec<&str> = path.iter().skip(1).map(|(n, _)| n.as_str()).chain([name.as_str()]).collect();
        parts.push((format!("option {}", place.join(", ")), value.to_string()));
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::{Changes, FitOptions, Noise, Options};

    fn run(name: &str, last: f64) -> Run {
        Run {
            name: name.into(),
            time: vec![0.0, 1.0],
            inputs: Vec::new(),
            held: Vec::new(),
            measured: vec![1.0, last],
            input_gaps: Vec::new(),
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
        assert_eq!(said(&of(&then), &of(&now)), ["option options, noise: Diagonal there, Full here"]);
        now = FitOptions { per_interval: Some(4), ..then.clone() };
        assert!(!of(&then).differences(&of(&now)).is_empty());
    }
}
