//! What makes two fits the same: the same program, model, data and options give the same bits.
//!
//! SHA-256 of what a result was made from.
//!
//! Which program this is: the fingerprint of the file that holds its machine code.
//!
//! Whether two models say the same, whatever their layout, comments and start values.

use super::disk::reason;
use fdm_grammar::graph::{Leaf, Names, Signal, show};
use fdm_grammar::model::{Origin, Quantity};
use fdm_grammar::op::ExprId;
use fdm_system::model::Model;
use fdm_system::record::Run;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use sha2::{Digest, Sha256};
use std::path::PathBuf;
use std::sync::OnceLock;
use std::{fmt, fs};

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

/// SHA-256 as 64 hexadecimal digits.
pub fn fingerprint(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// SHA-256 of the file that this code was loaded from: the program, or the library that another program has loaded.
///
/// # Errors
/// A sentence, where the file cannot be read.
pub fn program_fingerprint() -> Result<&'static str, String> {
    static FOUND: OnceLock<Result<String, String>> = OnceLock::new();
    let read = || {
        let file = file()?;
        let bytes = fs::read(&file).map_err(|e| format!("{}: {}", file.display(), reason(&e)))?;
        Ok(fingerprint(&bytes))
    };
    FOUND.get_or_init(read).as_deref().map_err(Clone::clone)
}

fn file() -> Result<PathBuf, String> {
    if let Some(library) = mapped() {
        return Ok(library);
    }
    std::env::current_exe().map_err(|e| format!("the file of this program: {}", reason(&e)))
}

/// The file behind the memory in which this function stands, where it is not the program itself (proc(5): `maps`).
fn mapped() -> Option<PathBuf> {
    let here = mapped as fn() -> Option<PathBuf> as usize;
    let maps = fs::read_to_string("/proc/self/maps").ok()?;
    let place = maps.lines().find(|line| {
        let range = line.split(' ').next().and_then(|range| range.split_once('-'));
        let number = |text: &str| usize::from_str_radix(text, 16).ok();
        range.is_some_and(|(from, to)| number(from).is_some_and(|f| f <= here) && number(to).is_some_and(|t| here < t))
    })?;
    let path = PathBuf::from(place.splitn(6, ' ').nth(5)?.trim_start());
    // the program itself can be read under this name even when its file was replaced meanwhile
    let own = PathBuf::from("/proc/self/exe");
    let is_program = fs::read_link(&own).is_ok_and(|program| program == path);
    Some(if is_program { own } else { path })
}

/// What a model says about one name.
struct Saying {
    /// The name with its role.
    what: String,
    /// What makes it that.
    text: String,
}

/// What differs between a model `then` and a model `now`, one sentence each; none when the same parameters give the same
/// response, about the same trim. Start values, bounds, docs and layout do not matter.
pub fn differences(then: &Model, now: &Model) -> Vec<String> {
    if then.source().same_texts(now.source()) {
        return Vec::new();
    }
    let (a, b) = (sayings(then), sayings(now));
    let mut found = Vec::new();
    for old in &a {
        match b.iter().find(|new| new.what == old.what) {
            None => found.push(format!("{} is missing", old.what)),
            Some(new) if new.text != old.text => {
                found.push(format!("{} is {} and was {}", old.what, short(&new.text), short(&old.text)));
            }
            Some(_) => {}
        }
    }
    let new = b.iter().filter(|new| !a.iter().any(|old| old.what == new.what));
    found.extend(new.map(|new| format!("{} is new", new.what)));
    found
}

fn sayings(model: &Model) -> Vec<Saying> {
    let m = model.definition();
    let mut all = vec![Saying { what: "the unit of time".into(), text: m.time.to_string() }];
    let unit = |q: &Quantity| q.unit.as_ref().map_or(String::from("without a unit"), |u| format!("in {u}"));
    let mut add = |what: String, text: String| all.push(Saying { what, text });
    let shown = |e: ExprId| show(&m.graph, e, m);
    for input in &m.inputs {
        add(format!("the input `{}`", input.quantity.name), unit(&input.quantity));
    }
    for p in &m.params {
        let kind = if p.per_run { "per run" } else { "shared" };
        // whether an initial value is free is seen at its state
        if p.origin == Origin::Declared {
            add(format!("the parameter `{}`", p.quantity.name), format!("{kind}, {}", unit(&p.quantity)));
        }
    }
    for s in &m.states {
        let name = &s.quantity.name;
        add(format!("the state `{name}`"), unit(&s.quantity));
        add(format!("`der({name})`"), format!("`{}`", shown(s.rate)));
        add(format!("the initial value of `{name}`"), format!("`{}`", shown(s.initial)));
    }
    for o in &m.outputs {
        add(format!("the output `{}`", o.quantity.name), format!("`{}`, {}", shown(o.expr), unit(&o.quantity)));
    }
    for (signal, value) in &m.trim {
        let name = m.leaf(match signal {
            Signal::State(k) => Leaf::State(*k),
            Signal::Input(k) => Leaf::Input(*k),
        });
        all.push(Saying { what: format!("the trim of `{name}`"), text: format!("`{}`", shown(*value)) });
    }
    all
}

fn short(text: &str) -> String {
    const LONGEST: usize = 120;
    if text.chars().count() <= LONGEST {
        return text.into();
    }
    text.chars().take(LONGEST).chain("...".chars()).collect()
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

#[cfg(test)]
mod fingerprint_tests {
    use super::*;

    #[test]
    fn digests_are_those_of_the_standard() {
        // FIPS 180-4, examples
        assert_eq!(fingerprint(b"abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
        assert_eq!(fingerprint(b""), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
    }
}

#[cfg(test)]
mod program_tests {
    use super::*;

    #[test]
    fn the_fingerprint_is_that_of_the_file_of_this_test() {
        let program = fs::read(std::env::current_exe().unwrap()).unwrap();
        assert_eq!(program_fingerprint(), Ok(fingerprint(&program).as_str()));
    }
}

#[cfg(test)]
mod comparison_tests {
    use super::*;

    const TEXT: &str =
        "model a { state x = free; input u; param k = 1 [1/s], c = 2 fixed; der(x) = u - k*x; output y = c*x; }";

    fn found(now: &str) -> Vec<String> {
        let [then, now] = [TEXT, now].map(|t| Model::from_text("a.fdm", t).unwrap());
        differences(&then, &now)
    }

    #[test]
    fn layout_and_start_values_do_not_matter() {
        assert!(found(&TEXT.replace("; ", ";\n  // said\n")).is_empty());
        assert!(found(&TEXT.replace("k = 1", "k = 7 in [0, 9]")).is_empty());
    }

    #[test]
    fn what_differs_is_named() {
        let said = found(&TEXT.replace("u - k*x", "u - k/x"));
        assert_eq!(said, ["`der(x)` is `u - k/x` and was `u - x*k`"]);
        assert_eq!(found(&TEXT.replace("= free", "= 0")).len(), 1);
        let said = found(&TEXT.replace("k = 1 [1/s]", "k = 1 per run [1/min]"));
        assert_eq!(said, ["the parameter `k` is per run, in 1/min and was shared, in 1/s"]);
        let said = found(&TEXT.replace("output y = c*x", "output z = c*x"));
        assert_eq!(said, ["the output `y` is missing", "the output `z` is new"]);
        let said = found(&TEXT.replace("output y", "trim { u = 2*k; } output y"));
        assert_eq!(said, ["the trim of `u` is new"]);
    }
}
