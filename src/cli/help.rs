//! `fdm explain`: the pages of the codes that messages have.

use crate::failure::{Ending, Failure, did_you_mean, ended, print};
use clap::Args;
use fdm_grammar::Code;
use fdm_grammar::explain::{code, page};

/// What `fdm explain` takes.
#[derive(Debug, Args)]
pub(crate) struct Explain {
    /// Codes as messages show them, such as E0201; all are listed when none is given
    #[arg(value_name = "CODE")]
    codes: Vec<String>,
}

pub(crate) fn explain(arguments: &Explain) -> Ending {
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
        codes => codes.iter().map(|c| page(*c)).collect::<Vec<_>>().join("\n"),
    };
    ended(print(&text))
}

fn list() -> String {
    let lines: String = Code::ALL.iter().map(|c| format!("{}  {}\n", c.text(), c.title())).collect();
    lines + "\n`fdm explain CODE` shows an example of each, and the example corrected\n"
}

fn refusal(text: &str) -> String {
    let near = did_you_mean(text, Code::ALL.iter().map(|c| c.text()));
    format!("`{text}` is not the code of a message{near} (`fdm explain` lists them all)")
}
