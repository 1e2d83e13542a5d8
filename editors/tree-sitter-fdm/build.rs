//! Grammar to parser to machine code.

use std::path::Path;
use std::{env, fs};
use tree_sitter_generate::{OptLevel, PARSER_HEADER, generate_parser_for_grammar};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    println!("cargo:rerun-if-changed=src/grammar.json");
    let grammar = fs::read_to_string("src/grammar.json")?;
    let (_, parser) = generate_parser_for_grammar(&grammar, None, OptLevel::default(), &mut Vec::new())?;
    let folder = env::var("OUT_DIR")?;
    let folder = Path::new(&folder);
    fs::create_dir_all(folder.join("tree_sitter"))?;
    fs::write(folder.join("tree_sitter/parser.h"), PARSER_HEADER)?;
    fs::write(folder.join("parser.c"), parser)?;
    cc::Build::new()
        .include(folder)
        .file(folder.join("parser.c"))
        .warnings(false)
        .std("c11")
        .try_compile("tree-sitter-fdm")?;
    Ok(())
}
