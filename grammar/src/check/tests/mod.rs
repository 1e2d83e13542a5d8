//! The checker's behaviour, told from texts: what mistakes are told, and what models come out.

mod arrays;
mod blocks;
mod implicit;
mod limits;
mod mistakes;
mod models;
mod random;
mod submodels;
mod tables;
mod ties;
mod units;
mod written_out;

use crate::{Diagnostic, Model, Source, check::check, syntax::parse};

/// The model and its warnings, or all findings.
fn checked(text: &str) -> Result<(Model, Vec<Diagnostic>), Vec<Diagnostic>> {
    check(&parse(&Source::new("m", text)).unwrap_or_else(|e| panic!("{text}: {e:?}")))
}

/// Every finding as `line:column CODE message; hint`.
fn told(text: &str) -> Vec<String> {
    let source = Source::new("m", text);
    let findings = match checked(text) {
        Ok((_, warnings)) => warnings,
        Err(findings) => {
            assert!(findings.iter().any(Diagnostic::is_error), "{text}: no model and no error");
            findings
        }
    };
    let line =
        |f: &Diagnostic| f.line(&source).replacen("m:", "", 1).replace(": error[", " ").replace(": warning[", " ");
    findings.iter().map(|f| line(f).replacen("]: ", " ", 1)).collect()
}

/// A model of the statements, which must be good; warnings are allowed.
fn good(statements: &str) -> Model {
    match checked(&format!("model m {{ {statements} }}")) {
        Ok((model, _)) => model,
        Err(findings) => panic!("{statements}\n{findings:#?}"),
    }
}
