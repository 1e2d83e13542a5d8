//! The files that a model in a Rust program uses: their paths begin at the folder of its `Cargo.toml`.

use fdm_grammar::{Source, Span};
use std::path::PathBuf;

/// Reads the files that a model uses.
pub(crate) fn gather(source: &mut Source) {
    let folder = PathBuf::from(std::env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default());
    fdm_grammar::gather(source, &mut |name| {
        if fdm_grammar::expand::is_unit(name) {
            return Err("`model!` writes what it compiles into the program, and a unit brings code of its own; read the model by \
                `Model::from_file`"
                .into());
        }
        std::fs::read_to_string(folder.join(name)).map_err(|e| match e.kind() {
            std::io::ErrorKind::NotFound => "there is no such file in the folder of Cargo.toml".into(),
            _ => e.to_string(),
        })
    });
}

/// The place in the model itself that a place in a used file comes from: the `use` that names the file.
pub(crate) fn own(source: &Source, mut span: Span) -> Span {
    // a file is used by one that stands before it
    while let Some(used) = source.text_at(span.start).used_at() {
        span = used;
    }
    span
}
