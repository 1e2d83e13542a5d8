//! The page of a result: `fdm report` writes it, `fdm plot` draws one of its figures, `fdm serve` shows it to a browser on this
//! machine, also while a fit or a study works on it.

use crate::deliver::write;
use crate::failure::{Ending, Failure, OrFailure, aside, did_you_mean, ended, print, print_data, print_lines, remark};
use crate::ownership::{Kind, Overwriting, refuse_foreign};
use clap::Args;
use fdm_report::page::{Paper, Subject, drawings, page};
use fdm_results::store::{ProgressFile, fingerprint, manifest_text, reason, whole_files};
use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

/// What `fdm report` takes.
#[derive(Debug, Args)]
pub(crate) struct Report {
    /// Result folder that `--out` wrote
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// File to write; `-` for standard output [default: report.html in the folder]
    #[arg(short, long, value_name = "FILE.html")]
    output: Option<PathBuf>,
    #[command(flatten)]
    overwriting: Overwriting,
}

/// The result in a folder.
fn subject(folder: &Path) -> Result<Subject, Failure> {
    Subject::from_files(&whole_files(folder).or_failure()?).or_failure()
}

pub(crate) fn report(arguments: &Report) -> Ending {
    let text = page(&subject(&arguments.folder)?);
    let place = arguments.output.clone().unwrap_or_else(|| arguments.folder.join("report.html"));
    if place == Path::new("-") {
        return ended(print_data(&text));
    }
    // a place that was typed has been looked at
    if arguments.output.is_none() && !arguments.overwriting.force {
        refuse_foreign(&place, Kind::Page).or_failure()?;
    }
    write(&place, text)?;
    ended(print_lines(&format!("{}\n", place.display())))
}

/// What `fdm plot` takes.
#[derive(Debug, Args)]
pub(crate) struct Plot {
    /// Result folder that `--out` wrote
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// Name of the figure [default: list the names]
    #[arg(long, value_name = "NAME")]
    figure: Option<String>,
    /// File to write, SVG or PNG by its name; `-` for SVG to standard output [default: SVG to standard output]
    #[arg(short, long, value_name = "FILE.svg|FILE.png", requires = "figure")]
    output: Option<PathBuf>,
    /// Width of a PNG in pixels [default: twice that of the drawing]
    #[arg(long, value_name = "N", requires = "output", allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(16..=10_000))]
    width: Option<u32>,
    /// Dark colours
    #[arg(long, requires = "figure")]
    dark: bool,
    #[command(flatten)]
    overwriting: Overwriting,
}

pub(crate) fn plot(arguments: &Plot) -> Ending {
    let all = drawings(&subject(&arguments.folder)?);
    let Some(name) = &arguments.figure else {
        let longest = all.iter().map(|d| d.name().len()).max().unwrap_or(0);
        let list: String = all.iter().map(|d| format!("{:longest$}  {}\n", d.name(), d.caption())).collect();
        return ended(print(&list));
    };
    let Some(found) = all.iter().find(|d| d.name() == name.as_str()) else {
        let near = did_you_mean(name, all.iter().map(|d| d.name()));
        return Err(Failure::input([format!("the result has no figure `{name}`{near} (`fdm plot DIR` lists them)")]));
    };
    let paper = if arguments.dark { Paper::Dark } else { Paper::Light };
    let Some(path) = arguments.output.as_deref().filter(|path| *path != Path::new("-")) else {
        return ended(print_data(&found.svg(paper)));
    };
    let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    let bytes = match ending.as_deref() {
        #[cfg(feature = "png")]
        Some("png") => {
            found.png(paper, arguments.width.unwrap_or_else(|| 2 * found.width())).map_err(|e| e.to_string())
        }
        #[cfg(not(feature = "png"))]
        Some("png") => Err("this build of fdm writes figures as SVG only: give a name that ends in .svg, or build it with `--features png`".into()),
        Some("svg") if arguments.width.is_some() => {
            return Err(Failure::input([
                "--width belongs to PNG: an SVG has no pixels; leave it out, or give a name that ends in .png",
            ]));
        }
        Some("svg") => Ok(found.svg(paper).into_bytes()),
        _ => {
            let said =
                format!("{}: figures are written as SVG or PNG; give a name that ends in .svg or .png", path.display());
            return Err(Failure::input([said]));
        }
    };
    let bytes: Result<Vec<u8>, String> = bytes;
    write(path, bytes.or_failure()?)?;
    ended(true)
}

/// What `fdm serve` takes.
#[derive(Debug, Args)]
pub(crate) struct Serve {
    /// Result folder that `--out` writes; it need not exist yet
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// Port on this machine [default: any that is free]
    #[arg(long, value_name = "N", default_value_t = 0, allow_negative_numbers = true)]
    port: u16,
}

/// A request of more bytes than this is none of a browser's.
const MOST_BYTES: u64 = 16 << 10;
/// Whoever says nothing for so long is not waited for.
const TIMEOUT: Duration = Duration::from_secs(5);
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

pub(crate) fn serve(arguments: &Serve) -> Ending {
    let refused = |e| Failure::input([format!("port {} of this machine: {}", arguments.port, reason(&e))]);
    // nobody but this machine is listened to
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, arguments.port)).map_err(refused)?;
    let address = listener.local_addr().map_err(refused)?;
    print_lines(&format!("http://{address}/\n"));
    if !arguments.folder.is_dir() {
        remark(format_args!("note: {} does not exist yet; the page waits for it", arguments.folder.display()));
    }
    aside(format_args!("serving {}; Ctrl-C ends it", arguments.folder.display()));
    for stream in listener.incoming().flatten() {
        let (folder, own) = (arguments.folder.clone(), address.to_string());
        // a browser that goes away in the middle is no matter
        std::thread::spawn(move || _ = answer(stream, &folder, &own));
    }
    ended(true)
}

fn answer(mut stream: TcpStream, folder: &Path, own: &str) -> std::io::Result<()> {
    stream.set_read_timeout(Some(TIMEOUT))?;
    stream.set_write_timeout(Some(TIMEOUT))?;
    let mut lines = BufReader::new((&stream).take(MOST_BYTES)).lines();
    let request = lines.next().unwrap_or(Ok(String::new()))?;
    let mut host = String::new();
    for line in lines {
        let line = line?;
        if line.is_empty() {
            break;
        }
        if let Some((name, value)) = line.split_once(':').filter(|(name, _)| name.eq_ignore_ascii_case("host")) {
            host = if name.is_empty() { String::new() } else { value.trim().to_string() };
        }
    }
    let port = own.rsplit(':').next().unwrap_or_default();
    // a page from elsewhere that leads its own name to this machine asks under that name
    let ours = host == own || host == format!("localhost:{port}");
    let (status, kind, body) = match request.split(' ').collect::<Vec<_>>()[..] {
        ["GET", _, _] if !ours => ("403 Forbidden", "text/plain", "this page is for this machine only\n".into()),
        ["GET", "/", _] => ("200 OK", "text/html", WATCH.to_string()),
        ["GET", "/page", _] => ("200 OK", "text/html", shown(folder)),
        ["GET", "/state", _] => ("200 OK", "text/plain", state(folder)),
        ["GET", _, _] => ("404 Not Found", "text/plain", "there is nothing here\n".into()),
        _ => ("405 Method Not Allowed", "text/plain", "only GET is supported\n".into()),
    };
    let head = format!(
        "HTTP/1.1 {status}\r\nContent-Type: {kind}; charset=utf-8\r\nContent-Length: {}\r\nCache-Control: no-store\r\nX-Content-Type-Options: nosniff\r\nConnection: close\r\n\r\n",
        body.len()
    );
    stream.write_all(head.as_bytes())?;
    stream.write_all(body.as_bytes())
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
