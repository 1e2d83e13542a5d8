//! What the linker leaves out of the program where it is rustc's own: functions that are equal to the byte, and tables for unwinding, as a
//! panic ends it. A seventh of it, at no cost of time.
#![allow(clippy::print_stdout, reason = "this is how Cargo is told")]

use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

/// Tables that nothing reads without unwinding.
const DISCARDED: &str =
    "SECTIONS { /DISCARD/ : { *(.eh_frame) *(.eh_frame_hdr) *(.gcc_except_table*) } } INSERT AFTER .text;\n";

fn main() {
    println!("cargo::rerun-if-changed=src/build.rs");
    let of = |name: &str| env::var(name).unwrap_or_default();
    // elsewhere, or where the user has chosen one, the linker may not know these options; other profiles unwind
    let target = of("TARGET");
    let chosen = env::var_os("RUSTC_LINKER").is_some() || of("CARGO_ENCODED_RUSTFLAGS").contains("link");
    if of("PROFILE") != "release" || target != "x86_64-unknown-linux-gnu" || chosen || !has_lld(&target) {
        return;
    }
    let script = PathBuf::from(of("OUT_DIR")).join("discarded.ld");
    if fs::write(&script, DISCARDED).is_ok() {
        println!("cargo::rustc-link-arg-bins=-Wl,--icf=all,--no-eh-frame-hdr,-T,{}", script.display());
    }
}

fn has_lld(target: &str) -> bool {
    let told = Command::new(env::var("RUSTC").unwrap_or("rustc".into())).args(["--print", "sysroot"]).output();
    let root = told.ok().and_then(|told| String::from_utf8(told.stdout).ok()).unwrap_or_default();
    Path::new(root.trim()).join("lib/rustlib").join(target).join("bin/gcc-ld/ld.lld").is_file()
}
