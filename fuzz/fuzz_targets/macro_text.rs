//! Tokens of `model! { ... }` to text and back to places, then the way of every text.
#![no_main]

use libfuzzer_sys::fuzz_target;
use std::str::FromStr;

#[path = "../../macros/src/text.rs"]
#[allow(dead_code)]
mod text;

fuzz_target!(|written: &str| {
    let Ok(tokens) = proc_macro2::TokenStream::from_str(written) else { return };
    let Ok(model) = text::ModelText::new(tokens) else { return };
    let source = fdm_grammar::Source::new("model!", model.text.clone());
    let findings = match fdm_grammar::compile(&source) {
        Ok(compiled) => compiled.warnings,
        Err(findings) => findings,
    };
    fdm_fuzz::look_at(&source, &findings);
    for finding in findings {
        model.tokens(finding.span);
    }
});
