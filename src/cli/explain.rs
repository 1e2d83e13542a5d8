//! `fdm explain`: the pages of the codes that messages have.

use crate::failure::{Failure, NUMBERS, print};
use clap::Args;
use fdm_grammar::Code;
use fdm_grammar::diagnostic::nearest;
use fdm_grammar::explain::{code, page};
use std::process::ExitCode;

/// What `fdm explain` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Codes as messages show them, such as E0201; all are listed when none is given
    #[arg(value_name = "CODE")]
    codes: Vec<String>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let (mut found, mut unknown) = (Vec::new(), Vec::new());
    for text in &arguments.codes {
        match code(text.trim_matches(['[', ']'])) {
            Some(code) => found.push(code),
            None => unknown.push(refusal(text)),
        }
    }
    if !unknown.is_empty() {
        return Err(Failure::Input(unknown));
    }
    let text = match &found[..] {
        [] => list(),
        codes => codes.iter().map(|c| page(*c).text(*c)).collect::<Vec<_>>().join("\n"),
    };
    Ok(if print(&text) { ExitCode::SUCCESS } else { ExitCode::from(NUMBERS) })
}

fn list() -> String {
    let lines: String = Code::ALL.iter().map(|c| format!("{}  {}\n", c.text(), c.title())).collect();
    lines + "\n`fdm explain CODE` shows an example of each and how it is mended\n"
}

fn refusal(text: &str) -> String {
    let near = nearest(text, Code::ALL.iter().map(|c| c.text()));
    let near = near.map_or(String::new(), |n| format!("did you mean {n}? "));
    format!("`{text}` is not a code of a message: {near}`fdm explain` lists them all")
}
