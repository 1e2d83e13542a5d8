//! Nothing is built here. With a script Cargo names the build folder (`OUT_DIR`), in which the library of units stands after `cargo install`.
#![allow(clippy::print_stdout, reason = "this is how Cargo is told")]

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
}
