//! `fdm serve`: the page of a result in a browser of this machine, also while a fit or a study works on it.

use crate::failure::{Ending, aside, ended, print_lines, remark};
use fdm_report::page::{Subject, page};
use fdm_results::store::{ProgressFile, fingerprint, manifest_text, whole_files};
use std::fs;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// Work tells of itself every second or so; after this time without a word it is said that it does not.
const SILENCE: f64 = 20.0;
/// Holds the page in a frame and asks every second whether it has changed. A page of work that goes on is changed where it stands, so
/// that whoever reads in it stays at his place.
const WATCH: &str = "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">
<title>fdm serve</title><link rel=\"icon\" href=\"data:,\">
<style>html, body { margin: 0; height: 100%; } iframe { border: 0; width: 100%; height: 100%; display: block; }</style>
<iframe id=\"page\" src=\"/page\" title=\"the result\"></iframe>
<script>
let known = null;
const inside = () => document.getElementById(\"page\");
const changed = async () => {
  const page = new DOMParser().parseFromString(await (await fetch(\"/page\")).text(), \"text/html\");
  const shown = inside().contentDocument;
  for (const part of [\"header .verdict\", \"nav\", \"main\"]) shown.querySelector(part).replaceWith(shown.adoptNode(page.querySelector(part)));
};
setInterval(async () => {
  try {
    const now = await (await fetch(\"/state\")).text();
    if (known !== null && now !== known) {
      if (known.startsWith(\"work \") && now.startsWith(\"work \")) await changed();
      else inside().contentWindow.location.reload();
    }
    known = now;
  } catch { document.title = \"fdm serve has ended\"; }
}, 1000);
</script></html>
";

/// Shows the result in a folder until the program ends.
pub(crate) fn serve(folder: PathBuf, port: u16) -> Ending {
    let pages = fdm_studio::Pages::bind(port)?;
    print_lines(&format!("{}\n", pages.address()));
    if !folder.is_dir() {
        remark(format_args!("note: {} does not exist yet; the page waits for it", folder.display()));
    }
    aside(format_args!("serving {}; Ctrl-C ends it", folder.display()));
    pages.run(move |path| match path {
        "" => Some(("text/html", WATCH.to_string())),
        "page" => Some(("text/html", shown(&folder))),
        "state" => Some(("text/plain", state(&folder))),
        _ => None,
    });
    ended(true)
}

/// What is told of work that goes on, with the seconds since then where they are too many. What a program that died left behind
/// says nothing where a result stands.
fn work(folder: &Path) -> Option<(String, Option<f64>)> {
    let file = ProgressFile::of(folder);
    let text = file.read()?;
    let told = fs::metadata(file.path()).and_then(|m| m.modified()).ok()?;
    let age = SystemTime::now().duration_since(told).map_or(0.0, |d| d.as_secs_f64());
    let silent = (age > SILENCE).then_some(age);
    (silent.is_none() || manifest_text(folder).is_none()).then_some((text, silent))
}

/// The page, or why there is none yet.
fn shown(folder: &Path) -> String {
    // what cannot be read is of another version of the program, whose result will tell
    let at_work = work(folder).and_then(|(text, silent)| Subject::from_progress(&text, silent).ok());
    let subject = at_work.map_or_else(
        || {
            let files = whole_files(folder).map_err(|e| e.to_string());
            files.and_then(|files| Subject::from_files(&files).map_err(|e| e.to_string()))
        },
        Ok,
    );
    match subject {
        Ok(subject) => page(&subject),
        Err(why) => {
            let why = why.replace('&', "&amp;").replace('<', "&lt;");
            format!("<!doctype html><meta charset=\"utf-8\"><title>no result yet</title><p>No result yet: {why}</p>\n")
        }
    }
}

/// Changes when the page does.
fn state(folder: &Path) -> String {
    match work(folder) {
        Some((text, None)) => format!("work {}", fingerprint(text.as_bytes())),
        // the seconds go on
        Some((_, Some(silent))) => format!("silent {silent:.0}"),
        None => manifest_text(folder).map_or_else(|| "none".into(), |text| fingerprint(text.as_bytes())),
    }
}
