//! For studies: reads each file that is named and prints its name, what became of it (`whole`, `damaged` or `refused`), a digest of every field
//! and its bits, and what was said. `cargo run --release -p fdm-readers --example digest --features hdf5,parquet -- FILE..`
#![allow(clippy::print_stdout, reason = "a program for a terminal")]

use fdm_readers::{Log, ReadError, open_from};

/// FNV-1a of names and bits.
fn digest(log: &Log) -> u64 {
    let mut hash = 0xcbf2_9ce4_8422_2325_u64;
    let mut add = |bytes: &[u8]| {
        for byte in bytes {
            hash = (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
        }
    };
    for topic in &log.topics {
        add(topic.name.as_bytes());
        for field in &topic.fields {
            add(field.name.as_bytes());
            field.values.iter().for_each(|v| add(&v.to_bits().to_le_bytes()));
        }
    }
    hash
}

fn main() {
    for file in std::env::args().skip(1) {
        let Ok(mut source) = std::fs::File::open(&file) else {
            println!("{file}\tunreadable\t\t");
            continue;
        };
        match open_from(&mut source).unwrap_or_else(|| Err(ReadError::Unknown(String::new()))) {
            Ok(log) => {
                let state = if log.damage.is_empty() { "whole" } else { "damaged" };
                let said: Vec<String> = log.damage.iter().take(1).map(ToString::to_string).collect();
                println!("{file}\t{state}\t{:016x}\t{}", digest(&log), said.concat());
            }
            Err(e) => println!("{file}\trefused\t\t{e}"),
        }
    }
}
