//! The folder of a project: its files, what `fdm.toml` says of them, and the borders that nothing read or written here crosses.
//!
//! Everything stays a plain file that the command line reads. What is written appears whole, and only over a text that the writer has seen.

use crate::http::{Refusal, Status};
use fdm_results::store::{
    ResultFolder, fingerprint, make_folder, read_input, read_input_text, write_file, write_new_file,
};
use serde::{Deserialize, Serialize};
use std::fs;
use std::ops::Range;
use std::path::{Component, Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::UNIX_EPOCH;
use toml::de::{DeTable, DeValue};

/// The project file.
pub(crate) const PROJECT: &str = "fdm.toml";
/// The folder of the results that are made here.
pub(crate) const RESULTS: &str = "results";
/// Folders of folders that are looked into.
const DEPTH: usize = 3;
/// Files that are listed: a folder with more is no project.
const MOST_FILES: usize = 2000;

/// The folder of a project.
pub(crate) struct Folder {
    /// As commands name it: empty for the working folder.
    named: PathBuf,
    /// Where it is, links followed.
    home: PathBuf,
    writing: Mutex<()>,
}

/// A file of the project.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Listed {
    /// Relative to the folder, its parts apart by `/`.
    pub(crate) path: String,
    pub(crate) kind: Kind,
    pub(crate) bytes: u64,
    /// Changes when the file does.
    pub(crate) stamp: String,
}

/// What a file is, by its name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Kind {
    Model,
    Record,
    /// A map of channels, or another file of settings.
    Settings,
    Page,
    /// A folder with a result.
    Result,
    Other,
}

/// What `fdm.toml` says.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub(crate) struct Project {
    pub(crate) model: Option<String>,
    pub(crate) data: Vec<String>,
    pub(crate) validation: Vec<String>,
    pub(crate) runs: Option<String>,
    pub(crate) map: Option<String>,
    /// Why it cannot be read.
    pub(crate) wrong: Option<String>,
}

/// A key of the project file that is set.
#[derive(Debug, Deserialize)]
pub(crate) struct Setting {
    /// `model`, `data`, `validation`, `runs` or `map`.
    key: String,
    /// One text, or the texts of a list; none takes the key out.
    values: Vec<String>,
}

/// A text, and what it was when its writer read it.
#[derive(Debug, Deserialize)]
pub(crate) struct Written {
    pub(crate) path: String,
    pub(crate) text: String,
    /// The fingerprint of the text that this one takes the place of; none where there is none yet.
    pub(crate) over: Option<String>,
}

/// A text and its fingerprint.
#[derive(Debug, Serialize)]
pub(crate) struct Text {
    pub(crate) text: String,
    pub(crate) fingerprint: String,
}

impl Setting {
    /// One text.
    pub(crate) fn of(key: &str, value: &str) -> Self {
        Self { key: key.into(), values: vec![value.into()] }
    }
}

impl Folder {
    /// Where it is.
    pub(crate) fn home(&self) -> &Path {
        &self.home
    }

    pub(crate) fn open(named: &Path) -> Result<Self, Refusal> {
        let there = if named.as_os_str().is_empty() { Path::new(".") } else { named };
        let home = there.canonicalize().map_err(|e| Refusal::from(fdm_session::Failure::at(there, &e)))?;
        if !home.is_dir() {
            return Err(Refusal::wrong(format!("{}: this is no folder", named.display())));
        }
        Ok(Self { named: named.to_path_buf(), home, writing: Mutex::new(()) })
    }

    /// Its name for people.
    pub(crate) fn name(&self) -> String {
        self.home.file_name().map_or_else(|| self.home.display().to_string(), |n| n.to_string_lossy().into_owned())
    }

    /// A file or folder in it, as commands name it; nothing hidden, and nothing outside, links followed.
    pub(crate) fn place(&self, path: &str) -> Result<PathBuf, Refusal> {
        let outside =
            || Refusal::new(Status::Forbidden, format!("{path}: only files of this folder are read and written"));
        let plain = |part: Component<'_>| match part {
            Component::Normal(name) => !name.to_string_lossy().starts_with('.'),
            _ => false,
        };
        if path.is_empty() || path.contains(['\\', ':', '\0']) || !Path::new(path).components().all(plain) {
            return Err(outside());
        }
        let mut there = self.home.join(path);
        // what does not stand there yet stands in a folder that does, or in one that is made in it
        while there.symlink_metadata().is_err() {
            there = there.parent().ok_or_else(outside)?.to_path_buf();
        }
        let lands = there.canonicalize().map_err(|_| outside())?;
        if lands.starts_with(&self.home) { Ok(self.named.join(path)) } else { Err(outside()) }
    }

    /// A result that was listed, as commands name it.
    pub(crate) fn result(&self, path: &str) -> PathBuf {
        self.named.join(path)
    }

    /// Words of a command that name nothing outside the folder.
    pub(crate) fn refuse_outside(&self, words: &[String]) -> Result<(), Refusal> {
        for word in words {
            let value = if word.starts_with('-') { word.split_once('=').map_or("", |(_, value)| value) } else { word };
            let path = Path::new(value);
            let up = value.split(['/', '\\']).any(|part| part == "..");
            let leaves = path.is_absolute() || up;
            if leaves || path.symlink_metadata().is_ok_and(|m| m.is_symlink()) {
                let said = format!(
                    "{word}: only files of this folder are read and written here; type the command in a terminal"
                );
                return Err(Refusal::new(Status::Forbidden, said));
            }
        }
        Ok(())
    }

    /// All files, in the order of the alphabet.
    pub(crate) fn files(&self) -> Vec<Listed> {
        let mut found = Vec::new();
        self.list(&self.home, "", DEPTH, &mut found);
        found.sort_by(|a, b| a.path.cmp(&b.path));
        found
    }

    fn list(&self, folder: &Path, before: &str, depth: usize, found: &mut Vec<Listed>) {
        let Ok(entries) = fs::read_dir(folder) else { return };
        for entry in entries.flatten() {
            let Ok(name) = entry.file_name().into_string() else { continue };
            let Ok(about) = entry.metadata() else { continue };
            if name.starts_with('.') || about.is_symlink() || found.len() >= MOST_FILES {
                continue;
            }
            let (path, there) = (format!("{before}{name}"), entry.path());
            let result = about.is_dir() && ResultFolder::stands_in(&there);
            if about.is_dir() && !result {
                if depth > 1 {
                    self.list(&there, &format!("{path}/"), depth - 1, found);
                }
                continue;
            }
            let kind = if result { Kind::Result } else { kind_of(&name) };
            let about = if result { fs::metadata(there.join("manifest.json")).unwrap_or(about) } else { about };
            let changed = about.modified().ok().and_then(|m| m.duration_since(UNIX_EPOCH).ok()).unwrap_or_default();
            found.push(Listed {
                path,
                kind,
                bytes: about.len(),
                stamp: format!("{}-{}", changed.as_nanos(), about.len()),
            });
        }
    }

    /// A text of the folder.
    pub(crate) fn text(&self, path: &str) -> Result<Text, Refusal> {
        let place = self.place(path)?;
        let text = read_input_text(&place).map_err(|e| missing(&place, &e))?;
        Ok(Text { fingerprint: fingerprint(text.as_bytes()), text })
    }

    /// Whoever writes is alone.
    fn alone(&self) -> MutexGuard<'_, ()> {
        self.writing.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Writes a text over the one that its writer has seen.
    pub(crate) fn write(&self, written: &Written) -> Result<String, Refusal> {
        if !matches!(kind_of(&written.path), Kind::Model | Kind::Settings) && !written.path.ends_with(".csv") {
            return Err(Refusal::new(
                Status::Forbidden,
                "models (.fdm), settings (.toml) and tables of runs (.csv) are written here",
            ));
        }
        let place = self.place(&written.path)?;
        let _alone = self.alone();
        let now = read_input(&place).ok().map(|bytes| fingerprint(&bytes));
        if now != written.over {
            let said = format!("{}: it was changed elsewhere meanwhile: nothing was written", written.path);
            return Err(Refusal::new(Status::Conflict, said));
        }
        write_file(&place, written.text.as_bytes())?;
        Ok(fingerprint(written.text.as_bytes()))
    }

    /// Adds a file where none stands yet.
    pub(crate) fn add(&self, path: &str, bytes: &[u8]) -> Result<(), Refusal> {
        if path.contains('/') || !matches!(kind_of(path), Kind::Record | Kind::Model | Kind::Settings) {
            return Err(Refusal::new(
                Status::Forbidden,
                format!("{path}: records, models (.fdm) and maps (.toml) are taken"),
            ));
        }
        let place = self.place(path)?;
        let _alone = self.alone();
        write_new_file(&place, bytes).map_err(|e| match e.kind() {
            std::io::ErrorKind::AlreadyExists => {
                Refusal::new(Status::Conflict, format!("{path}: a file of this name is there already"))
            }
            _ => Refusal::from(e),
        })
    }

    /// The first name `results/VERB-N` that is free.
    pub(crate) fn new_result(&self, verb: &str) -> Result<String, Refusal> {
        make_folder(&self.home.join(RESULTS))?;
        let names = (1..10_000).map(|k| format!("{RESULTS}/{verb}-{k}"));
        let free = |name: &String| self.home.join(name).symlink_metadata().is_err();
        names.into_iter().find(free).ok_or_else(|| Refusal::wrong("the folder of results is full"))
    }

    /// What `fdm.toml` says; nothing where there is none.
    pub(crate) fn project(&self) -> Project {
        let Ok(text) = read_input_text(&self.home.join(PROJECT)) else { return Project::default() };
        let table = match DeTable::parse(&text) {
            Ok(table) => table.into_inner(),
            Err(e) => return Project { wrong: Some(e.message().to_string()), ..Project::default() },
        };
        let texts = |key: &str| table.get(key).map(|value| texts(value.get_ref())).unwrap_or_default();
        let one = |key: &str| texts(key).into_iter().next();
        let (data, validation) = (texts("data"), texts("validation"));
        Project { model: one("model"), data, validation, runs: one("runs"), map: one("map"), wrong: None }
    }

    /// Sets a key of `fdm.toml`; all else in it stays as it is.
    pub(crate) fn set(&self, setting: &Setting) -> Result<(), Refusal> {
        let Setting { key, values } = setting;
        let list = match key.as_str() {
            "data" | "validation" => true,
            "model" | "runs" | "map" if values.len() <= 1 => false,
            _ => return Err(Refusal::wrong(format!("{key}: model, data, validation, runs and map are set here"))),
        };
        for value in values {
            self.place(value)?;
        }
        let _alone = self.alone();
        let place = self.home.join(PROJECT);
        let text = if place.symlink_metadata().is_ok() { read_input_text(&place)? } else { String::new() };
        // strings of JSON are strings of TOML
        let shown = serde_json::to_string(values).ok().filter(|_| list);
        let shown = shown.or_else(|| values.first().and_then(|v| serde_json::to_string(v).ok()));
        let new = changed(&text, key, shown.filter(|_| !values.is_empty()).as_deref())?;
        Ok(write_file(&place, new.as_bytes())?)
    }
}

/// What is wrong with a file that cannot be read.
fn missing(place: &Path, e: &std::io::Error) -> Refusal {
    let status = if e.kind() == std::io::ErrorKind::NotFound { Status::NotFound } else { Status::Wrong };
    Refusal::new(status, fdm_session::Failure::at(place, e).to_string())
}

fn kind_of(name: &str) -> Kind {
    let lower = name.to_lowercase();
    let plain = lower.strip_suffix(".gz").unwrap_or(&lower);
    match plain.rsplit_once('.').map_or("", |(_, ending)| ending) {
        "fdm" => Kind::Model,
        "csv" | "tsv" | "txt" | "dat" | "mat" | "xlsx" | "ulg" | "bin" | "log" | "npz" | "npy" | "json" | "h5"
        | "hdf5" | "parquet" => Kind::Record,
        "toml" => Kind::Settings,
        "html" => Kind::Page,
        _ => Kind::Other,
    }
}

fn texts(value: &DeValue<'_>) -> Vec<String> {
    match value {
        DeValue::String(text) => vec![text.to_string()],
        DeValue::Array(list) => list.iter().flat_map(|v| texts(v.get_ref())).collect(),
        _ => Vec::new(),
    }
}

/// A text of TOML with another value of a key at its top, or without the key.
fn changed(text: &str, key: &str, value: Option<&str>) -> Result<String, Refusal> {
    let unread = |e: toml::de::Error| Refusal::wrong(format!("{PROJECT}: {}", e.message()));
    let table = DeTable::parse(text).map_err(unread)?.into_inner();
    let found = table.iter().find(|(own, _)| own.get_ref() == key).map(|(own, value)| (own.span(), value.span()));
    let line_end = |at: usize| text[at..].find('\n').map_or(text.len(), |k| at + k + 1);
    let (Range { start, end }, new) = match (found, value) {
        (Some((_, span)), Some(value)) => (span, value.to_string()),
        (Some((own, span)), None) => (own.start..line_end(span.end), String::new()),
        (None, Some(value)) => {
            // keys of the top stand before all tables: behind the last of them
            let plain = table.iter().filter(|(_, v)| !matches!(v.get_ref(), DeValue::Table(_)));
            let at = plain.map(|(_, v)| line_end(v.span().end)).max().unwrap_or(0);
            let apart = if at > 0 && !text[..at].ends_with('\n') { "\n" } else { "" };
            (at..at, format!("{apart}{key} = {value}\n"))
        }
        (None, None) => return Ok(text.to_string()),
    };
    let new = format!("{}{new}{}", &text[..start], &text[end..]);
    DeTable::parse(&new).map_err(unread)?;
    Ok(new)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_of_the_project_changes_and_all_else_stays() {
        let text =
            "# a project\nmodel = \"a.fdm\" # first\ndata = [\"x.csv\",\n  \"y.csv\"]\n\n[options]\nzoh = [\"u\"]\n";
        let set = |key, value| changed(text, key, value).expect("a text");
        assert_eq!(set("model", Some("\"b.fdm\"")), text.replace("a.fdm", "b.fdm"));
        assert_eq!(set("data", None), "# a project\nmodel = \"a.fdm\" # first\n\n[options]\nzoh = [\"u\"]\n");
        assert!(set("map", Some("\"m.toml\"")).contains("\"y.csv\"]\nmap = \"m.toml\"\n\n[options]"));
        assert_eq!(changed("", "model", Some("\"a\"")).expect("a text"), "model = \"a\"\n");
        assert!(changed("[options", "model", None).is_err());
    }
}
