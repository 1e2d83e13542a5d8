//! A model ready for use: its text, what the text means, and the code that computes it.
//!
//! **In** the text of a model, from a file, a string or `model!`. **Out** [`Model`], or a [`ModelError`] with every
//! mistake of the text. **Never** data, and never an output of its own: warnings are handed on.
//! **Start** at [`Model::from_file`].

use crate::code::Engine;
use crate::dynamics::{Dynamics, Layout};
use crate::record::{ReadOptions, RecordError, Run, RunBuilder, Summary, channels, read as read_record};
use fdm_grammar::carried::{Carried, CarriedTerm, NotCarried};
use fdm_grammar::diagnostic::nearest;
use fdm_grammar::model::{Param, Unshown};
use fdm_grammar::{Code, Compiled, Diagnostic, Groups, Schedule, Source, Span};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Larger files are surely not models.
const MOST_BYTES: u64 = 64 << 20;

/// A unit brings libraries and data.
#[cfg(feature = "units")]
const MOST_UNIT_BYTES: u64 = 1 << 30;

/// A checked and compiled model; clones share the compiled code.
#[derive(Clone)]
pub struct Model {
    source: Source,
    compiled: Arc<Compiled>,
    dynamics: Arc<dyn Dynamics>,
}

/// Why there is no model.
#[derive(Debug, Clone, thiserror::Error)]
pub enum ModelError {
    /// The file could not be read.
    #[error("{}: {reason}", path.display())]
    Unreadable {
        /// The file as the user named it.
        path: PathBuf,
        /// What the operating system said, or which limit was passed.
        reason: String,
    },
    /// The text has mistakes. Displayed as one line for each.
    #[error("{}", lines(text, diagnostics))]
    Invalid {
        /// The text and its name.
        text: Source,
        /// Every finding, in the order of the text; at least one is an error.
        diagnostics: Vec<Diagnostic>,
    },
}

fn lines(source: &Source, diagnostics: &[Diagnostic]) -> String {
    diagnostics.iter().map(|d| d.line(source)).collect::<Vec<_>>().join("\n")
}

/// A param whose tie was to be switched off has none.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{name}` is not tied{}", self.hint())]
pub struct NotTied {
    /// As typed.
    pub name: String,
    /// The tied param that may be meant.
    pub nearest: Option<String>,
    /// All that are tied.
    pub tied: Vec<String>,
}

impl NotTied {
    fn hint(&self) -> String {
        match (&self.nearest, &self.tied[..]) {
            (Some(near), _) => format!("; did you mean `{near}`?"),
            (None, []) => ": the model has no ties".into(),
            (None, tied) => {
                format!("; tied are {}", tied.iter().map(|t| format!("`{t}`")).collect::<Vec<_>>().join(", "))
            }
        }
    }
}

impl Model {
    /// Reads and compiles a `.fdm` file and the files that it uses.
    ///
    /// # Errors
    /// [`ModelError::Unreadable`] when there is no such file, it is a directory, a device or larger than 64 MiB;
    /// [`ModelError::Invalid`] with all mistakes when it is not UTF-8 text or not a model.
    pub fn from_file(path: impl AsRef<Path>) -> Result<Self, ModelError> {
        let whole = read_source(path.as_ref())?;
        let text = whole.text().strip_prefix('\u{feff}').unwrap_or(whole.text());
        let mut source = Source::new(whole.name(), text);
        Self::gather_files(&mut source);
        Self::from_source(source)
    }

    /// Reads the files that a model uses from disk; names are relative to the folder of the file that says `use`.
    pub fn gather_files(source: &mut Source) {
        fdm_grammar::gather(source, &mut |name| {
            if fdm_grammar::expand::is_unit(name) {
                return read_unit(name);
            }
            let bytes = read(Path::new(name), MOST_BYTES).map_err(|e| reason(&e))?;
            let text = String::from_utf8(bytes).map_err(|_| "it is not UTF-8 text")?;
            Ok(text.strip_prefix('\u{feff}').map_or_else(|| text.clone(), String::from))
        });
    }

    /// Compiles the text of a model that uses no files but parts of the library; `name` is what messages call it.
    ///
    /// # Errors
    /// [`ModelError::Invalid`] with every mistake of the text.
    pub fn from_text(name: impl Into<String>, text: impl Into<String>) -> Result<Self, ModelError> {
        let mut source = Source::new(name, text);
        fdm_grammar::gather(&mut source, &mut |_| Err("no files are read here".into()));
        Self::from_source(source)
    }

    /// Compiles the text of a model with the texts of the files that it uses, in the order in which
    /// [`Source::texts`] has them behind the model's own.
    ///
    /// # Errors
    /// [`ModelError::Invalid`] with every mistake of the texts.
    pub fn from_texts(name: impl Into<String>, text: impl Into<String>, used: &[String]) -> Result<Self, ModelError> {
        Self::from_source(with_used(Source::new(name, text), used, None))
    }

    /// Compiles the texts of a model that came from a file which may still be there: a functional mock-up unit is not
    /// kept, and is looked for beside it.
    ///
    /// # Errors
    /// [`ModelError::Invalid`] with every mistake of the texts.
    pub fn from_kept(
        name: impl Into<String>,
        text: impl Into<String>,
        used: &[String],
        origin: &Path,
    ) -> Result<Self, ModelError> {
        Self::from_source(with_used(Source::new(name, text), used, Some(origin)))
    }

    /// Compiles a source with the files that it uses ([`Self::gather_files`]).
    ///
    /// # Errors
    /// [`ModelError::Invalid`] with every mistake of the texts.
    pub fn from_source(source: Source) -> Result<Self, ModelError> {
        let compiled = fdm_grammar::compile(&source);
        Self::compiled(source, compiled)
    }

    /// A source and what the compiler said of it, or of a tree that stands for it.
    ///
    /// # Errors
    /// [`ModelError::Invalid`] with the findings.
    pub fn compiled(source: Source, compiled: Result<Compiled, Vec<Diagnostic>>) -> Result<Self, ModelError> {
        match compiled {
            Ok(compiled) => {
                let dynamics = crate::code::compile(&compiled.schedule, Engine::default()).into();
                Ok(Self { source, compiled: Arc::new(compiled), dynamics })
            }
            Err(diagnostics) => Err(ModelError::Invalid { text: source, diagnostics }),
        }
    }

    /// The model whose code `model!` wrote; `build` makes it from the layout of the text.
    ///
    /// # Panics
    /// When the text does not compile. `model!` has compiled the same text, so this is a fault of fdm.
    #[doc(hidden)]
    pub fn with_code(name: &str, text: &str, used: &[&str], build: fn(Layout) -> Box<dyn Dynamics>) -> Self {
        let source = with_used(Source::new(name, text), used, None);
        let compiled = match fdm_grammar::compile(&source) {
            Ok(compiled) => compiled,
            Err(diagnostics) => panic!(
                "this text was compiled by model! and is refused now, which is a fault of fdm:\n{}",
                lines(&source, &diagnostics)
            ),
        };
        // its steps are not cut at kinks: the functions that these are found by are not generated
        let dynamics = build(Layout { kinks: 0, ..compiled.schedule.layout.clone() }).into();
        Self { source, compiled: Arc::new(compiled), dynamics }
    }

    /// This model with other values, bounds and attributes of its parameters. Where other parameters are fixed
    /// now, the derivatives are made anew (as machine code, for `model!` too).
    ///
    /// # Panics
    /// When the parameters are not those of this model.
    pub fn with_params(&self, params: Vec<Param>) -> Self {
        let old = &self.compiled.model.params;
        let same = |(a, b): (&Param, &Param)| a.quantity.name == b.quantity.name;
        assert!(params.len() == old.len() && params.iter().zip(old).all(same), "the parameters of another model");
        let numbers = |p: &Param| [p.value, p.lower, p.upper].map(f64::to_bits);
        let equal = |(a, b): (&Param, &Param)| {
            numbers(a) == numbers(b) && (a.fixed, a.per_run, a.prior) == (b.fixed, b.per_run, b.prior)
        };
        if params.iter().zip(old).all(equal) {
            return self.clone();
        }
        let refixed = params.iter().zip(old).any(|(a, b)| a.fixed != b.fixed);
        let mut compiled = (*self.compiled).clone();
        compiled.model.params = params;
        let mut dynamics = self.dynamics.clone();
        if refixed {
            compiled.schedule = Schedule::new(&mut compiled.model);
            dynamics = crate::code::compile(&compiled.schedule, Engine::default()).into();
        }
        Self { source: self.source.clone(), compiled: Arc::new(compiled), dynamics }
    }

    /// This model with ties switched off: the named params, or all that are tied where a name is `all`, are estimated
    /// by themselves from their declared values. Compiled anew (as machine code, for `model!` too), from the parameters
    /// as they were declared.
    ///
    /// # Errors
    /// [`NotTied`] with the first name that is not that of a tied param.
    pub fn untied(&self, names: &[String]) -> Result<Self, NotTied> {
        let tied: Vec<&str> = self.compiled.loose.iter().flat_map(|m| m.tied_names()).collect();
        let all = names.iter().any(|name| name == "all");
        if let Some(name) = names.iter().find(|name| *name != "all" && !tied.contains(&name.as_str())) {
            let nearest = nearest(name, tied.iter().copied()).map(String::from);
            return Err(NotTied { name: name.clone(), nearest, tied: tied.into_iter().map(String::from).collect() });
        }
        let Some(loose) = self.compiled.loose.as_ref().filter(|_| !names.is_empty()) else { return Ok(self.clone()) };
        let open: Vec<&str> = if all { tied } else { names.iter().map(String::as_str).collect() };
        let mut altered = self.altered(loose.tied(&open));
        let warnings = self.compiled.warnings.clone();
        if let Some(compiled) = Arc::get_mut(&mut altered.compiled) {
            (compiled.loose, compiled.warnings) = (Some(loose.clone()), warnings);
        }
        Ok(altered)
    }

    /// The model for runs of these groups: a param that is declared `per group` has a value in each of them, `k[A]` and `k[B]`.
    /// Compiled anew (as machine code, for `model!` too), from the parameters as they were declared.
    ///
    /// # Errors
    /// [`ModelError::Invalid`] where the text does not hold with them, such as a tie of such a param.
    pub fn grouped(&self, groups: Groups) -> Result<Self, ModelError> {
        if groups == *self.source.groups() {
            return Ok(self.clone());
        }
        Self::from_source(self.source.clone().with_groups(groups))
    }

    /// The groupings that params of the model are shared within, each once.
    pub fn groupings(&self) -> Vec<&str> {
        let mut names: Vec<&str> = self.source.groups().keys().map(String::as_str).collect();
        for name in self.definition().params.iter().filter_map(|p| p.group.as_deref()) {
            if !names.contains(&name) {
                names.push(name);
            }
        }
        names
    }

    /// Names of the params whose ties are switched off.
    pub fn open_ties(&self) -> Vec<String> {
        let names = self.compiled.loose.iter().flat_map(|m| m.tied_names());
        names.filter(|name| self.definition().param(name).is_some()).map(String::from).collect()
    }

    /// A model of other equations under this one's text, compiled anew: what a strategy fits on the way to this model.
    pub fn altered(&self, definition: fdm_grammar::Model) -> Self {
        self.altered_by(definition, Engine::default())
    }

    /// A model of other equations under this one's text, for programs that run a few times only.
    pub fn sketched(&self, definition: fdm_grammar::Model) -> Self {
        self.altered_by(definition, Engine::Tape)
    }

    fn altered_by(&self, mut definition: fdm_grammar::Model, engine: Engine) -> Self {
        let schedule = Schedule::new(&mut definition);
        let dynamics = crate::code::compile(&schedule, engine).into();
        let compiled = Arc::new(Compiled { model: definition, loose: None, schedule, warnings: Vec::new() });
        Self { source: self.source.clone(), compiled, dynamics }
    }

    /// The model with measured records in the place of the chosen states (by index) on the right sides of its equations
    /// (see [`fdm_grammar::Model::substituted`]), compiled anew. Its runs are completed by
    /// [`Run::with_measured`](crate::record::Run::with_measured).
    ///
    /// # Errors
    /// [`Unshown`] with the states that no output shows.
    ///
    /// # Panics
    /// When an index is not that of a state.
    pub fn substituted(&self, states: &[usize]) -> Result<Self, Unshown> {
        Ok(self.altered(self.compiled.model.substituted(states)?))
    }

    /// The model with its nonlinear terms as known inputs (see [`fdm_grammar::Model::carried`]), compiled anew, and which
    /// these are. Its runs are completed by [`Run::with_measured`](crate::record::Run::with_measured).
    ///
    /// # Errors
    /// [`NotCarried`] with every term that can not be computed from records.
    pub fn carried(&self) -> Result<(Self, Vec<CarriedTerm>), NotCarried> {
        let Carried { model, terms } = self.compiled.model.carried()?;
        Ok(if terms.is_empty() { (self.clone(), terms) } else { (self.altered(model), terms) })
    }

    /// A run of this model from samples in memory, to be filled by channel: times and samples of inputs and outputs.
    pub fn run(&self, name: impl Into<String>) -> RunBuilder<'_> {
        RunBuilder::new(self.definition(), name)
    }

    /// A run of this model from a CSV file, and what was found in it.
    ///
    /// # Errors
    /// [`RecordError`] with everything that is wrong with the file: line, column, what was found, what was expected.
    pub fn read_run(&self, path: impl AsRef<Path>, options: &ReadOptions) -> Result<(Run, Summary), RecordError> {
        read_record(path.as_ref(), &channels(self.definition()), options)
    }

    /// The model's own name.
    pub fn name(&self) -> &str {
        &self.compiled.model.name
    }

    /// The text and the name under which messages show it.
    pub fn source(&self) -> &Source {
        &self.source
    }

    /// What the text says: names, units, values, bounds, equations.
    pub fn definition(&self) -> &fdm_grammar::Model {
        &self.compiled.model
    }

    /// The straight-line programs.
    pub fn schedule(&self) -> &Schedule {
        &self.compiled.schedule
    }

    /// Sizes, patterns and positions.
    pub fn layout(&self) -> &Layout {
        &self.compiled.schedule.layout
    }

    /// The compiled code.
    pub fn dynamics(&self) -> &dyn Dynamics {
        &*self.dynamics
    }

    /// Whether foreign code has a part in the model (`use fmu "engine.fmu" as eng(...)`): no generated source and no other tool can
    /// compute it.
    pub fn holds_foreign_code(&self) -> bool {
        let s = &self.compiled.schedule;
        [&s.prepare, &s.rates, &s.outputs, &s.events].into_iter().any(|program| !program.calls.is_empty())
    }

    /// Findings that did not stop the compilation.
    pub fn warnings(&self) -> &[Diagnostic] {
        &self.compiled.warnings
    }
}

impl std::fmt::Debug for Model {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Model").field("name", &self.name()).field("source", &self.source.name()).finish_non_exhaustive()
    }
}

/// Reads the text of a model, with the byte order mark that it may begin with.
///
/// # Errors
/// [`ModelError::Unreadable`] as [`Model::from_file`]; [`ModelError::Invalid`] when it is not UTF-8 text.
pub fn read_source(path: &Path) -> Result<Source, ModelError> {
    let bytes = read(path, MOST_BYTES).map_err(|e| ModelError::Unreadable { path: path.into(), reason: reason(&e) })?;
    let name = path.display().to_string();
    String::from_utf8(bytes).map(|text| Source::new(&name, text)).map_err(|error| not_text(name, error))
}

/// Adds texts in the order in which they are asked for, which is always the same.
fn with_used(mut source: Source, used: &[impl AsRef<str>], origin: Option<&Path>) -> Source {
    let mut used = used.iter();
    let folder = Path::new(source.name()).parent().unwrap_or(Path::new("")).to_path_buf();
    let beside = origin.map(|path| path.parent().unwrap_or(Path::new("")));
    fdm_grammar::gather_kept(&mut source, &mut |name| {
        let text = used.next().map(|text| text.as_ref().to_string()).ok_or("its text was not kept")?;
        if fdm_grammar::expand::is_unit(name) {
            let there = beside.zip(Path::new(name).strip_prefix(&folder).ok()).map(|(beside, own)| beside.join(own));
            remember_unit(&[Some(PathBuf::from(name)), there].into_iter().flatten().collect::<Vec<_>>(), &text)?;
        }
        Ok(text)
    });
    source
}

/// The text that stands for a unit, whose functions are known from then on.
#[cfg(feature = "units")]
fn read_unit(name: &str) -> Result<String, String> {
    /// File, length, time of the last change, and the text that it gave last: editors compile with every key.
    type Read = (String, u64, std::time::SystemTime, String);
    static LAST: std::sync::Mutex<Vec<Read>> = std::sync::Mutex::new(Vec::new());
    let stamp = std::fs::metadata(name).and_then(|m| Ok((m.len(), m.modified()?))).ok();
    let mut last = LAST.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    if let Some(known) = last.iter().find(|known| known.0 == name && Some((known.1, known.2)) == stamp) {
        return Ok(known.3.clone());
    }
    let bytes = read(Path::new(name), MOST_UNIT_BYTES).map_err(|e| reason(&e))?;
    let text = fdm_units::read(name, &bytes).map_err(|e| e.to_string())?;
    last.retain(|known| known.0 != name);
    last.extend(stamp.map(|(length, changed)| (name.to_string(), length, changed, text.clone())));
    Ok(text)
}

/// Makes the functions known that a kept text calls: the unit itself is not kept, and must be where it was.
#[cfg(feature = "units")]
fn remember_unit(places: &[PathBuf], text: &str) -> Result<(), String> {
    let (mut said, mut other) = (String::new(), None);
    for place in places {
        if fdm_units::is_known(text) {
            break;
        }
        match read_unit(&place.display().to_string()) {
            Ok(_) => other = Some(format!("{} is another unit than when this was written", place.display())),
            Err(reason) => said = format!("a unit is not kept with a result, and at {} {reason}", place.display()),
        }
    }
    if fdm_units::is_known(text) { Ok(()) } else { Err(other.unwrap_or(said)) }
}

#[cfg(not(feature = "units"))]
fn read_unit(_: &str) -> Result<String, String> {
    Err("fdm was built without the feature `units`".into())
}

#[cfg(not(feature = "units"))]
fn remember_unit(_: &[PathBuf], _: &str) -> Result<(), String> {
    read_unit("").map(drop)
}

fn reason(error: &std::io::Error) -> String {
    match error.kind() {
        std::io::ErrorKind::NotFound => "there is no such file".into(),
        _ => error.to_string(),
    }
}

fn read(path: &Path, most: u64) -> std::io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    fdm_readers::open_input(path)?.take(most + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > most {
        return Err(std::io::Error::other(format!("is larger than the limit of {} MiB", most >> 20)));
    }
    Ok(bytes)
}

/// The mistake of a file that is not UTF-8, at its first such byte.
fn not_text(name: String, error: std::string::FromUtf8Error) -> ModelError {
    let at = error.utf8_error().valid_up_to();
    let bytes = error.as_bytes();
    let hint = match bytes {
        [0xff, 0xfe, ..] | [0xfe, 0xff, ..] => "it begins like UTF-16; save it with the encoding UTF-8",
        _ if bytes.contains(&0) => "it holds binary data; is it a model?",
        _ => "save it with the encoding UTF-8",
    };
    let byte = bytes.get(at).copied().unwrap_or_default();
    // up to `at` the text is the file's own, so the place is right
    let source = Source::new(name, String::from_utf8_lossy(bytes));
    let span = Span::new(at, at + char::REPLACEMENT_CHARACTER.len_utf8());
    let message = format!("this is not UTF-8 text: byte {byte:#04x} stands where a character should begin");
    ModelError::Invalid { text: source, diagnostics: vec![Diagnostic::new(Code::NotText, span, message).hint(hint)] }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(bytes: &[u8]) -> String {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("a.fdm");
        std::fs::write(&path, bytes).expect("file");
        let error = Model::from_file(&path).expect_err("not a model");
        error.to_string().replace(&folder.path().display().to_string(), "")
    }

    #[test]
    fn bytes_that_are_not_text_have_a_place() {
        let said = refused(b"model a {\n  state \xe4;\n}");
        assert!(said.starts_with("/a.fdm:2:9: error[E0106]: this is not UTF-8 text: byte 0xe4"), "{said}");
        assert!(refused(b"\xff\xfem\0o\0").contains("UTF-16"));
        assert!(refused(b"\x7fELF\x02\0\xff").contains("binary"));
    }

    #[test]
    fn used_files_are_read_from_the_folder_of_the_file_that_uses_them() {
        let folder = tempfile::tempdir().expect("folder");
        let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).expect("file");
        std::fs::create_dir(folder.path().join("parts")).expect("folder");
        write("m.fdm", "model m { use \"parts/a.fdm\" as a; use \"parts/none.fdm\" as n; output y = a.y; }");
        write("parts/a.fdm", "\u{feff}model a { use \"../b.fdm\" as b; let y = 2*b.y; }");
        write("b.fdm", "model b { param k = 1; let y = k; }");
        let path = folder.path().join("m.fdm");
        let said = Model::from_file(&path).expect_err("a file is missing").to_string();
        assert!(
            said.contains("m.fdm:1:39: error[E0801]") && said.ends_with("relative to the file that says `use`"),
            "{said}"
        );
        write("parts/none.fdm", "model n { let z = 1; }");
        let model = Model::from_file(&path).expect("a model");
        assert_eq!(model.definition().params[0].quantity.name, "a.b.k");
        let texts: Vec<String> = model.source().texts()[1..].iter().map(|t| t.text().to_string()).collect();
        let again = Model::from_texts("other/m.fdm", model.source().text(), &texts).expect("the same model");
        assert!(again.source().same_texts(model.source()));
        write("b.fdm", "model b { param k = 2; let y = k; }");
        assert!(!Model::from_file(&path).expect("a model").source().same_texts(model.source()));
    }

    #[test]
    fn missing_files_and_directories_are_told_by_name() {
        let folder = tempfile::tempdir().expect("folder");
        let said = |path: &Path| Model::from_file(path).expect_err("unreadable").to_string();
        assert!(said(folder.path()).ends_with(": is a directory, not a file"));
        assert!(said(&folder.path().join("none.fdm")).contains("none.fdm: "));
    }

    #[test]
    fn files_beyond_the_limit_are_refused_before_they_are_read_whole() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("large.fdm");
        std::fs::File::create(&path).and_then(|f| f.set_len(1 << 40)).expect("sparse file");
        let said = Model::from_file(&path).expect_err("too large").to_string();
        assert!(said.contains("limit of 64 MiB"), "{said}");
    }
}
