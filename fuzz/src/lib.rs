//! What the targets share: models made from bytes, and what is asked of every finding.
//!
//! **In** bytes of the fuzzer. **Out** texts of models that fit the grammar and mean something as often as not.
//! **Never** files, but for a record's. **Start** at [`Model::text`].

mod expression;
mod model;

pub use expression::{Expression, LEAVES};
pub use model::Model;

use fdm_grammar::{Compiled, Diagnostic, Source};

/// Compiles a text and looks at everything that is said about it.
pub fn compile(text: &str) -> Option<Compiled> {
    let source = Source::new("fuzz.fdm", text);
    match fdm_grammar::compile(&source) {
        Ok(compiled) => {
            look_at(&source, &compiled.warnings);
            assert!(compiled.warnings.iter().all(|f| !f.is_error()), "an error beside a model");
            Some(compiled)
        }
        Err(findings) => {
            assert!(findings.iter().any(Diagnostic::is_error), "no model and no reason");
            look_at(&source, &findings);
            None
        }
    }
}

/// Every finding stands in the text, says something, and can be printed.
pub fn look_at(source: &Source, findings: &[Diagnostic]) {
    for finding in findings {
        let labels = finding.labels.iter().map(|l| (l.span, &l.text));
        for (span, said) in labels.chain([(finding.span, &finding.message)]) {
            let range = span.range();
            assert!(range.start <= range.end && range.end <= source.text().len(), "{finding:?}");
            assert!(source.text().get(range).is_some(), "a place inside a character: {finding:?}");
            assert!(!said.is_empty() && said.len() < 4000, "{finding:?}");
        }
        assert!(!finding.line(source).is_empty());
    }
}

/// Numbers between -3 and 3, others for every seed.
pub fn numbers(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    move || {
        state ^= state >> 12;
        state ^= state << 25;
        state ^= state >> 27;
        (state >> 11) as f64 / (1_u64 << 53) as f64 * 6.0 - 3.0
    }
}

/// Bits in which every NaN is one: which NaN an operation returns, IEEE leaves open.
pub fn bits(numbers: &[f64]) -> Vec<u64> {
    numbers.iter().map(|v| if v.is_nan() { f64::NAN } else { *v }.to_bits()).collect()
}
