//! Commands in README, guide and reference are understood; those of the guide are run, page by page and in order.

use rayon::prelude::*;
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::{Duration, Instant};
use support::{Desk, files, repository};

/// For one line, in a build without optimisation on a busy machine.
const PATIENCE: Duration = Duration::from_secs(240);

/// The arguments of a line as a shell would split it, up to what only a shell understands.
fn split(line: &str) -> Vec<String> {
    let (mut words, mut word, mut quote) = (Vec::new(), None::<String>, None);
    for c in line.chars() {
        match (quote, c) {
            (Some(open), c) if c == open => quote = None,
            (Some(_), c) => word.get_or_insert_default().push(c),
            (None, '\'' | '"') => {
                quote = Some(c);
                word.get_or_insert_default();
            }
            (None, '|' | '>' | '&' | ';') => break,
            (None, '#') if word.is_none() => break,
            (None, c) if c.is_whitespace() => words.extend(word.take()),
            (None, c) => word.get_or_insert_default().push(c),
        }
    }
    words.extend(word);
    words
}

/// Lines of the shell that run `fdm`, with their numbers: the words behind the program's name.
fn commands(page: &Path) -> Vec<(usize, String, Vec<String>)> {
    let text = fs::read_to_string(page).unwrap();
    let (mut found, mut open, mut lines) = (Vec::new(), false, text.lines().enumerate());
    while let Some((k, line)) = lines.next() {
        if line.trim_start().starts_with("```") {
            open = !open && line.trim_start().starts_with("```sh");
            continue;
        }
        let mut whole = line.trim().trim_start_matches("$ ").to_string();
        while open && whole.ends_with('\\') {
            whole.pop();
            whole.push_str(lines.next().map_or("", |(_, next)| next.trim()));
        }
        let programs = ["fdm ", "cargo run --release -- ", "target/release/fdm "];
        let words = programs.iter().find_map(|program| whole.strip_prefix(program)).filter(|_| open);
        if let Some(words) = words.map(split) {
            found.push((k + 1, whole, words));
        }
    }
    found
}

fn pages(folders: &[&str]) -> Vec<PathBuf> {
    let there = folders.iter().filter(|folder| repository().join(folder).is_dir());
    there.flat_map(|folder| files(folder, "md")).collect()
}

#[test]
fn every_command_is_understood() {
    let mut wrong = Vec::new();
    let mut count = 0;
    for page in pages(&["docs/guide", "docs/reference"]).into_iter().chain([repository().join("README.md")]) {
        for (line, _, words) in commands(&page) {
            count += 1;
            let all = ["fdm".to_string()].into_iter().chain(words).map(OsString::from);
            if let Err(e) = fdm_cli::understood(all) {
                wrong.push(format!("{}:{line}: {e}", page.display()));
            }
        }
    }
    assert!(count > 0, "no commands were found");
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap().map(Result::unwrap) {
        let target = to.join(entry.file_name());
        if entry.path().is_dir() {
            copy(&entry.path(), &target);
        } else {
            fs::copy(entry.path(), target).unwrap();
        }
    }
}

/// Runs the commands of a page, and says what did not go as a reader would expect.
fn run(page: &Path, slow: &[String]) -> Vec<String> {
    let desk = Desk::new();
    copy(&repository().join("models"), &desk.path("models"));
    fs::create_dir_all(desk.path("target/guide")).unwrap();
    let (mut wrong, mut missing) = (Vec::new(), Vec::new());
    for (line, text, words) in commands(page) {
        let waits = matches!(words.first().map(String::as_str), Some("serve" | "lsp"));
        let made = || words.iter().filter(|word| word.starts_with("target/") && !desk.path(word).exists());
        let lacks = made().any(|file| missing.contains(file));
        if waits || lacks || cfg!(debug_assertions) && slow.iter().any(|s| text.starts_with(s)) {
            missing.extend(made().cloned().collect::<Vec<_>>());
            continue;
        }
        let begun = Instant::now();
        let said = fs::File::create(desk.path("said")).unwrap();
        let mut command = desk.command_of(&words);
        let mut child = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(said).spawn().unwrap();
        let end = loop {
            match child.try_wait().unwrap() {
                Some(status) => break status.code(),
                None if begun.elapsed() > PATIENCE => {
                    child.kill().and_then(|()| child.wait()).unwrap();
                    break None;
                }
                None => std::thread::sleep(Duration::from_millis(20)),
            }
        };
        println!("{:6.1} s  {text}", begun.elapsed().as_secs_f64());
        // 1: computed and printed, and not as good as it should be, which a page may show
        if !matches!(end, Some(0 | 1)) {
            wrong.push(format!("{}:{line}: {text}: {end:?}\n{}", page.display(), desk.text("said")));
        }
    }
    wrong
}

#[test]
fn the_commands_of_the_guide_run() {
    let list = fs::read_to_string(repository().join("tests/house/slow_commands.txt")).unwrap();
    let slow: Vec<String> = list.lines().filter(|l| !l.starts_with('#') && !l.is_empty()).map(str::to_string).collect();
    let pages = pages(&["docs/guide"]);
    for line in &slow {
        let there = pages.iter().flat_map(|page| commands(page)).any(|(_, text, _)| text.starts_with(line));
        assert!(there, "slow_commands.txt has a line that no page has: {line}");
    }
    let wrong: Vec<String> = pages.par_iter().flat_map(|page| run(page, &slow)).collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn lines_are_split_as_a_shell_does() {
    assert_eq!(split("extend m.fdm --effect 'a(b, c)' > out  # all"), ["extend", "m.fdm", "--effect", "a(b, c)"]);
    assert_eq!(split("plot result#1 \"\" | less"), ["plot", "result#1", ""]);
}
