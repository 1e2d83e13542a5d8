//! Which files a model uses, submodels and tables: names relative to the file that says `use`, and texts gathered before anything is compiled.

use super::library;
use crate::source::{Source, Text};
use crate::syntax::{Name, Nodes, StatementKind, Table, parse_used};
use std::path::{Component, Path, PathBuf};

/// Most files that a model and the files it uses may use.
pub const MOST_FILES: usize = 256;

/// Adds every file that the model uses, and those that these use, to its source. `read` is given the name of a file, which
/// is relative where that of the model is, and returns its text or the reason why there is none; parts of the library come
/// from the program. What is wrong is told when the source is compiled.
pub fn gather(source: &mut Source, read: &mut dyn FnMut(&str) -> Result<String, String>) {
    gather_kept(source, &mut |name| library::of(name).map_or_else(|| read(name), |part| part.map(str::to_string)));
}

/// Adds every file that the model uses, and those that these use, from texts that were kept: `read` is asked for parts
/// of the library too, which may have been others then.
pub fn gather_kept(source: &mut Source, read: &mut dyn FnMut(&str) -> Result<String, String>) {
    let mut next = 0;
    while let Some(text) = source.texts().get(next) {
        next += 1;
        for (name, path) in used(text) {
            let known = find(source, &name).is_some() || source.missing().iter().any(|m| m.name == name);
            if known {
                continue;
            }
            if source.texts().len() + source.missing().len() > MOST_FILES {
                source.lacks(name, format!("a model uses at most {MOST_FILES} files"));
                return;
            }
            match read(&name) {
                Ok(text) => {
                    if !source.append(name.as_str(), text, path.span) {
                        let most = Source::MOST_BYTES >> 20;
                        source.lacks(name, format!("the files of a model hold at most {most} MiB together"));
                    }
                }
                Err(reason) => source.lacks(name, reason),
            }
        }
    }
}

/// Names of the files that a text uses.
fn used(text: &Text) -> Vec<(String, Name)> {
    // most models use none, and reading a text takes time
    if !text.text().contains("use") && !text.text().contains("from") {
        return Vec::new();
    }
    let statements = parse_used(text).0.map_or(Vec::new(), |tree| tree.statements);
    let paths = statements.into_iter().filter_map(|s| match s.kind {
        StatementKind::Use(submodel) => Some(submodel.path),
        StatementKind::Table(Table { nodes: Nodes::File(path, _), .. }) => Some(path),
        _ => None,
    });
    paths.map(|path| (name_of(text.name(), &path), path)).collect()
}

/// The name of a used file: its path as written, from the folder of the file that uses it. `use actuator` is the file
/// `actuator.fdm`. A part of the library has one name everywhere.
pub(super) fn name_of(from: &str, path: &Name) -> String {
    if library::is_named(&path.text) {
        return path.text.clone();
    }
    let folder = Path::new(from).parent().unwrap_or(Path::new(""));
    // a path in quotes is longer in the text than between them
    let bare = path.span.range().len() == path.text.len();
    let file = if bare { format!("{}.fdm", path.text) } else { path.text.clone() };
    plain(&folder.join(file))
}

/// Whether a used file is a functional mock-up unit; its text is then what stands for it.
pub fn is_unit(name: &str) -> bool {
    Path::new(name).extension().is_some_and(|ending| ending.eq_ignore_ascii_case("fmu"))
}

/// The text of that name.
pub(super) fn find(source: &Source, name: &str) -> Option<usize> {
    source.find(name).or_else(|| (plain(Path::new(source.name())) == name).then_some(0))
}

/// A path without `.` and without the `..` that lead back out of a folder it names.
fn plain(path: &Path) -> String {
    let mut parts = PathBuf::new();
    for part in path.components() {
        match (part, parts.components().next_back()) {
            (Component::CurDir, _) => {}
            (Component::ParentDir, Some(Component::Normal(_))) => drop(parts.pop()),
            _ => parts.push(part),
        }
    }
    parts.display().to_string()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::Span;

    #[test]
    fn names_are_relative_to_the_file_that_uses_them() {
        let name = |text: &str, quotes: usize| Name { text: text.into(), span: Span::new(0, text.len() + quotes) };
        assert_eq!(name_of("models/a/m.fdm", &name("../b/./c.fdm", 2)), "models/b/c.fdm");
        assert_eq!(name_of("m.fdm", &name("../c.fdm", 2)), "../c.fdm");
        assert_eq!(name_of("../m.fdm", &name("../c.fdm", 2)), "../../c.fdm");
        assert_eq!(name_of("model!", &name("actuator", 0)), "actuator.fdm");
    }

    #[test]
    fn every_file_is_read_once() {
        let mut source = Source::new("./a.fdm", "model a { use \"b.fdm\" as b; use \"none.fdm\" as n; }");
        let mut asked = Vec::new();
        gather(&mut source, &mut |name| {
            asked.push(name.to_string());
            let text = "model b { use \"a.fdm\" as a; use \"b.fdm\" as b; use \"none.fdm\" as n; }";
            if name == "b.fdm" { Ok(text.into()) } else { Err("no".into()) }
        });
        assert_eq!(asked, ["b.fdm", "none.fdm"]);
        assert_eq!((source.texts().len(), source.missing().len()), (2, 1));
    }
}
