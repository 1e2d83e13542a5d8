//! `fdm fmt` as a user types it: the models of the project are laid out, broken files stay as they are.

use std::fs;
use std::io::Write;
use std::process::{Command, Output, Stdio};

fn fmt() -> Command {
    let mut command = support::fdm();
    command.arg("fmt");
    command
}

fn run(command: &mut Command, input: &str) -> Output {
    let command = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().expect("fdm runs");
    child.stdin.take().expect("its input").write_all(input.as_bytes()).expect("it reads");
    child.wait_with_output().expect("it ends")
}

fn said(output: &[u8]) -> String {
    String::from_utf8_lossy(output).into_owned()
}

const SCATTERED: &str = "model a{output y=x;param x=1;}// end";
const LAID_OUT: &str = "model a {\n  output y = x;\n  param x = 1;\n}  // end\n";

#[test]
fn the_models_are_laid_out() {
    let models = support::repository().join("models");
    let output = run(fmt().arg("--check").arg(models), "");
    assert!(output.status.success(), "`fdm fmt models` would change\n{}{}", said(&output.stdout), said(&output.stderr));
}

#[test]
fn files_are_changed_where_they_stand_and_only_those_that_need_it() {
    let folder = tempfile::tempdir().expect("folder");
    let inner = folder.path().join("inner");
    fs::create_dir(&inner).expect("folder");
    let (first, second) = (folder.path().join("a.fdm"), inner.join("b.fdm"));
    let (other, broken) = (inner.join("c.txt"), inner.join("d.fdm"));
    fs::write(&first, LAID_OUT).expect("file");
    fs::write(&second, SCATTERED).expect("file");
    fs::write(&other, SCATTERED).expect("file");
    fs::write(&broken, "model a{output y=;}").expect("file");

    let output = run(fmt().arg("--check").arg(folder.path()), "");
    assert_eq!(said(&output.stdout), format!("{}\n", second.display()));
    assert_eq!(fs::read_to_string(&second).expect("text"), SCATTERED, "a check changes nothing");

    let output = run(fmt().arg(folder.path()), "");
    assert_eq!(output.status.code(), Some(2));
    assert!(said(&output.stderr).contains("E0101"), "{}", said(&output.stderr));
    assert_eq!(fs::read_to_string(&second).expect("text"), LAID_OUT, "the others are laid out");
    assert_eq!(fs::read_to_string(&other).expect("text"), SCATTERED);
    assert_eq!(fs::read_to_string(&broken).expect("text"), "model a{output y=;}");

    let output = run(fmt().arg("--check").args([&first, &second]), "");
    assert_eq!((output.status.code(), said(&output.stdout)), (Some(0), String::new()));
}

#[test]
fn standard_input_is_printed_and_checked() {
    let output = run(fmt().arg("--stdin"), SCATTERED);
    assert_eq!((output.status.code(), said(&output.stdout).as_str()), (Some(0), LAID_OUT));
    assert_eq!(run(fmt().args(["--stdin", "--check"]), SCATTERED).status.code(), Some(1));
    assert_eq!(run(fmt().args(["--stdin", "--check"]), LAID_OUT).status.code(), Some(0));
    let output = run(fmt().arg("--stdin"), "model a { output = 1; }");
    assert_eq!((output.status.code(), said(&output.stdout).as_str()), (Some(2), ""));
    assert!(said(&output.stderr).contains("standard input:1:"), "{}", said(&output.stderr));
    assert_eq!(run(fmt().arg("none.fdm"), "").status.code(), Some(2));
}
