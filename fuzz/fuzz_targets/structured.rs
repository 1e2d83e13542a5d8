//! Texts that fit the grammar: compiled, or refused for a reason that stands in it.
#![no_main]

use arbitrary::Unstructured;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let Ok(model) = fdm_fuzz::Model::arbitrary(&mut Unstructured::new(data)) else { return };
    fdm_fuzz::compile(&model.text());
});
