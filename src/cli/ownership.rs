//! Whether fdm wrote what stands where a single file is to be written: other files are not replaced without `--force`.

use crate::failure::Failure;
use clap::Args;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Pages, drawings and generated code tell of themselves within so many bytes.
const BEGINNING: u64 = 1 << 12;

/// What is said of the replacement of files, by verbs that write single files only.
#[derive(Debug, Args)]
#[command(next_help_heading = "Result")]
pub(crate) struct Overwriting {
    /// Replace a file that fdm did not write
    #[arg(long, hide_short_help = true)]
    pub(crate) force: bool,
}

/// What a single file holds, which says how a file of fdm is told from others.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// A page for a browser, by its generator.
    Page,
    /// A drawing as SVG, by its beginning, or as PNG, by its chunk `Software`.
    Drawing,
    /// A file for another tool, by its stamp or by the sentence at its head.
    Export,
    /// A model, which nothing tells from one that somebody has changed since.
    Model,
    /// A table, by its header, which is known only when the model is.
    Table,
}

impl Kind {
    /// Whether the beginning of a file is of this kind and of fdm.
    pub(crate) fn is_of_ours(self, beginning: &[u8]) -> bool {
        let text = String::from_utf8_lossy(beginning);
        match self {
            Self::Page => text.contains("<meta name=\"generator\" content=\"fdm "),
            Self::Drawing => is_drawing(&text) || is_picture(beginning),
            Self::Export => text.contains("Written by fdm ") || text.contains("fdm model sha256:"),
            Self::Model | Self::Table => false,
        }
    }
}

/// The drawings of [`fdm_report`].
fn is_drawing(text: &str) -> bool {
    text.starts_with("<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=") && text.contains("<style>.paper {")
}

/// Those among them that are pictures.
fn is_picture(bytes: &[u8]) -> bool {
    let said = b"tEXtSoftware\0fdm";
    bytes.starts_with(b"\x89PNG") && bytes.windows(said.len()).any(|part| part == said)
}

/// Refuses to write a file of this kind over one that fdm did not write.
///
/// # Errors
/// What stands there, and what helps.
pub(crate) fn refuse_foreign(path: &Path, kind: Kind) -> Result<(), String> {
    refuse_unless(path, |beginning| kind.is_of_ours(beginning))
}

/// Refuses to write a table over a file that does not begin with the header of that table.
///
/// # Errors
/// What stands there, and what helps.
pub(crate) fn refuse_other_tables(path: &Path, header: &[u8]) -> Result<(), Failure> {
    refuse_unless(path, |beginning| beginning.starts_with(header)).map_err(|e| Failure::input([e]))
}

fn refuse_unless(path: &Path, is_of_ours: impl Fn(&[u8]) -> bool) -> Result<(), String> {
    // what does not stand there, is a device, or is empty cannot be lost
    if !std::fs::metadata(path).is_ok_and(|about| about.is_file() && about.len() > 0) {
        return Ok(());
    }
    let mut beginning = Vec::new();
    let read = File::open(path).and_then(|file| file.take(BEGINNING).read_to_end(&mut beginning));
    if read.is_ok() && is_of_ours(&beginning) {
        return Ok(());
    }
    Err(format!(
        "{}: left alone: nothing in it says that fdm wrote it; give another place, or replace it with --force",
        path.display()
    ))
}
