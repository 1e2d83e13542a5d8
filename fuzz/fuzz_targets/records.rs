//! Any bytes as a record: read, or refused for a reason.
#![no_main]

use fdm::record::{ReadOptions, channels, read};
use fdm_grammar::Source;
use libfuzzer_sys::fuzz_target;
use std::cell::RefCell;
use std::io::{Seek, Write};

const MODEL: &str = "model m { input u [deg]; state x [m] = free; param a = 1 [m/s/deg], b = 1 [1/s];
    der(x) = a*u - b*x; output y [m] = x, z [m] = delay(x, 0.1); }";

thread_local! {
    static FILE: RefCell<tempfile::NamedTempFile> =
        RefCell::new(tempfile::NamedTempFile::new_in("/dev/shm").or_else(|_| tempfile::NamedTempFile::new()).expect("a file"));
    static MODEL_OF_RECORDS: fdm_grammar::Model =
        fdm_grammar::compile(&Source::new("m.fdm", MODEL)).expect("a model").model;
}

fuzz_target!(|input: (u8, &[u8])| {
    let (choice, data) = input;
    let options = ReadOptions {
        from: (choice & 1 != 0).then_some(0.5),
        every: 1 + usize::from(choice >> 1 & 3),
        hold: if choice & 8 != 0 { vec!["u".into()] } else { Vec::new() },
        require_outputs: choice & 16 != 0,
        without: Vec::new(),
        ..ReadOptions::default()
    };
    FILE.with_borrow_mut(|file| {
        file.as_file().set_len(0).expect("an empty file");
        file.rewind().expect("the beginning");
        file.write_all(data).expect("room for the record");
        MODEL_OF_RECORDS.with(|model| match read(file.path(), &channels(model), &options) {
            Ok((run, _)) => {
                assert!(run.time.windows(2).all(|t| t[0] < t[1]), "time goes on");
                assert!(run.time.iter().all(|t| t.is_finite()));
            }
            Err(error) => assert!(!error.to_string().is_empty()),
        });
    });
});
