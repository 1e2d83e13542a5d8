//! Any text: laid out without a change of meaning, and laid out again the same; or refused for a reason.
#![no_main]

use fdm_grammar::Source;
use fdm_grammar::format::format;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    let Ok(laid_out) = format(&Source::new("fuzz.fdm", text)) else { return };
    let again = format(&Source::new("again.fdm", laid_out.clone())).unwrap_or_else(|_| panic!("refused: {laid_out}"));
    assert_eq!(again, laid_out);
});
