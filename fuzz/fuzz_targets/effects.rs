//! Any text as a catalogue of effects: read, or refused for reasons that stand in it.
#![no_main]

use fdm_grammar::Source;
use fdm_effects::Catalogue;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    let source = Source::new("fuzz.fdm", text);
    let (_, findings) = Catalogue::read(&source);
    fdm_fuzz::look_at(&source, &findings);
});
