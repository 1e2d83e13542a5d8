//! How operations and numbers are written, and a program as statements.
//!
//! Names and doc strings of users as identifiers, strings and comments of other languages.

use crate::op::{Form, Op};
use crate::schedule::{Instruction, Operand, Program};
use std::collections::BTreeSet;

/// A language's way to write numbers, operations and definitions.
pub trait Notation {
    /// A number that comes back with the same bits (NaN as any NaN).
    fn number(&self, value: f64) -> String;

    /// The call of a function; `name` is that of [`crate::math`].
    fn call(&self, name: &str, operands: &[String]) -> String;

    /// The definition of value `k`.
    fn define(&self, k: usize, expression: &str) -> String;

    /// An operation on operands that need no brackets.
    fn apply(&self, op: Op, operands: &[String]) -> String {
        let name = match (op, operands) {
            (Op::Add | Op::Sub | Op::Mul | Op::Div, [a, b, ..]) => return format!("{a} {} {b}", op.row().name),
            (Op::Neg, [a, ..]) => return format!("-{a}"),
            _ => function(op),
        };
        self.call(name, &operands[..op.row().arity])
    }
}

/// The function of [`crate::math`] that computes an operation; empty for what every language has a sign for.
pub(super) fn function(op: Op) -> &'static str {
    match op {
        Op::Add | Op::Sub | Op::Mul | Op::Div | Op::Neg => "",
        Op::Pow => "pow",
        Op::Less => "less",
        Op::LessEqual => "less_equal",
        Op::Equal => "equal",
        Op::Select => "select",
        _ if op.is_external() => op.row().name,
        _ => {
            debug_assert_eq!(op.row().form, Form::Function, "{} has no name", op.row().name);
            op.row().name
        }
    }
}

/// A program as one definition for each instruction; values are `v0`, `v1`, ..., and `place` says where everything else that
/// is read stands.
pub fn statements(
    notation: &dyn Notation,
    program: &Program,
    instructions: std::ops::Range<usize>,
    place: &dyn Fn(Operand) -> String,
) -> Vec<String> {
    let line = |k: usize| {
        let Instruction { op, args } = program.instructions[k];
        if let Some((function, operands)) = program.call(k) {
            // for readers: nothing that is compiled calls foreign code
            let operands: Vec<String> = operands.iter().map(|o| operand(notation, program, *o, place)).collect();
            return notation.define(k, &notation.call(&format!("{function:?}"), &operands));
        }
        let operands = args.map(|o| operand(notation, program, o, place));
        notation.define(k, &notation.apply(op, &operands))
    };
    instructions.map(line).collect()
}

/// What is read, as text.
pub(super) fn operand(
    notation: &dyn Notation,
    program: &Program,
    operand: Operand,
    place: &dyn Fn(Operand) -> String,
) -> String {
    match operand {
        Operand::Constant(k) => notation.number(program.constants[k as usize]),
        other => place(other),
    }
}

/// Rust; functions stand in the modules named.
#[derive(Debug, Clone, Copy)]
pub struct RustNotation<'a> {
    /// Path in front of the elementary functions, `::` included.
    pub elementary: &'a str,
    /// Path in front of minimum, maximum, sign, absolute value, choices.
    pub exact: &'a str,
}

impl Notation for RustNotation<'_> {
    fn number(&self, value: f64) -> String {
        if value.is_finite() { format!("{value:?}") } else { format!("f64::from_bits({:#x})", value.to_bits()) }
    }

    fn call(&self, name: &str, operands: &[String]) -> String {
        let path = if is_exact(name) { self.exact } else { self.elementary };
        format!("{path}{name}({})", operands.join(", "))
    }

    fn define(&self, k: usize, expression: &str) -> String {
        format!("let v{k} = {expression};")
    }
}

/// C99; `own` stands in front of minimum, maximum, sign and choices, `fdm_` in front of elementary functions.
#[derive(Debug, Clone, Copy)]
pub(super) struct CNotation<'a> {
    pub(super) own: &'a str,
}

impl Notation for CNotation<'_> {
    fn number(&self, value: f64) -> String {
        match value {
            v if v.is_nan() => "(HUGE_VAL - HUGE_VAL)".into(),
            f64::INFINITY => "HUGE_VAL".into(),
            f64::NEG_INFINITY => "(-HUGE_VAL)".into(),
            v if v.is_sign_negative() => format!("({v:?})"),
            v => format!("{v:?}"),
        }
    }

    fn call(&self, name: &str, operands: &[String]) -> String {
        let operands = operands.join(", ");
        match name {
            "abs" => format!("fabs({operands})"),
            _ if is_exact(name) => format!("{}{name}({operands})", self.own),
            _ => format!("fdm_{name}({operands})"),
        }
    }

    fn define(&self, k: usize, expression: &str) -> String {
        format!("const double v{k} = {expression};")
    }
}

/// Whether a function is defined by comparisons and signs alone, so that it is written out.
pub(super) fn is_exact(name: &str) -> bool {
    matches!(name, "abs" | "sign" | "min" | "max" | "less" | "less_equal" | "equal" | "select")
}

/// A name of ASCII letters, digits and `_` that begins with a letter: other characters become `_`.
pub(super) fn plain(name: &str) -> String {
    let mut plain: String = name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    while plain.len() > 1 && plain.ends_with('_') {
        plain.pop();
    }
    if !plain.starts_with(|c: char| c.is_ascii_alphabetic()) {
        plain.insert(0, 'm');
    }
    plain
}

/// Names that differ in what [`plain`] drops get a number behind them; in capitals when asked for.
pub(super) fn distinct<'a>(names: impl IntoIterator<Item = &'a str>, capitals: bool) -> Vec<String> {
    let mut taken: BTreeSet<String> = BTreeSet::new();
    let one = |name: &str| {
        let name = if capitals { plain(name).to_uppercase() } else { plain(name) };
        let numbered = (2..).map(|k| format!("{name}_{k}"));
        let free = std::iter::once(name.clone()).chain(numbered).find(|n| !taken.contains(n)).unwrap_or(name);
        taken.insert(free.clone());
        free
    };
    names.into_iter().map(one).collect()
}

/// Text inside a C comment or behind `//`: one line, and nothing that opens or ends a comment.
pub(super) fn comment(text: &str) -> String {
    let line: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    line.replace("*/", "* /").replace("/*", "/ *")
}

/// A C string: ASCII, everything else as octal bytes of UTF-8; no trigraphs.
pub(super) fn c_string(text: &str) -> String {
    let byte = |b: u8| match b {
        b'"' | b'\\' | b'?' => format!("\\{}", b as char),
        b' '..=b'~' => (b as char).to_string(),
        other => format!("\\{other:03o}"),
    };
    format!("\"{}\"", text.bytes().map(byte).collect::<String>())
}

/// A Rust string.
pub(super) fn rust_string(text: &str) -> String {
    format!("{text:?}")
}
