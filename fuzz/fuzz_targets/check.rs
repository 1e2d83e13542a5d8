//! Any text: compiled, or refused for a reason that stands in it.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    fdm_fuzz::compile(text);
});
