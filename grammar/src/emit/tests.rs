//! What can be seen of generated text without a compiler; `tests/language/generated_code.rs` compiles it and compares bits.

use super::entry::Pieces;
use super::notation::CNotation;
use super::notation::{c_string, comment, distinct, plain};
use super::*;
use crate::op::{Form, Op, ROWS};
use crate::schedule::{Instruction, Operand, Placed, Program};
use crate::{Source, compile};

const RUST: RustNotation<'static> = RustNotation { elementary: "e::", exact: "" };
const C: CNotation<'static> = CNotation { own: "m_" };

#[test]
fn numbers_come_back_with_the_same_bits() {
    let numbers = [0.1, 1e-300, 5e-324, f64::MAX, 1.0, 2.0f64.powi(70), -0.0, -1.5, f64::NEG_INFINITY, f64::NAN];
    for number in numbers {
        let text = RUST.number(number);
        let back = match text.strip_prefix("f64::from_bits(0x") {
            Some(bits) => f64::from_bits(u64::from_str_radix(bits.trim_end_matches(')'), 16).expect("bits")),
            None => text.parse().expect("number"),
        };
        assert_eq!(back.to_bits(), number.to_bits(), "{text}");
        if number.is_finite() {
            let text = C.number(number);
            let digits = text.trim_matches(['(', ')']);
            assert!(digits.contains(['.', 'e']), "{text} would be a whole number");
            assert_eq!(digits.parse::<f64>().expect("number").to_bits(), number.to_bits(), "{text}");
        }
    }
    assert_eq!((C.number(f64::NEG_INFINITY).as_str(), C.number(-2.0).as_str()), ("(-HUGE_VAL)", "(-2.0)"));
}

#[test]
fn every_operation_is_written_in_both_languages() {
    let operands = ["a", "b", "c"].map(String::from);
    for row in ROWS.iter().filter(|row| row.form != Form::External) {
        let (rust, c) = (RUST.apply(row.op, &operands), C.apply(row.op, &operands));
        for text in [&rust, &c] {
            let all = operands[..row.arity].iter().all(|o| text.contains(o.as_str()));
            assert!(all && !text.starts_with('('), "{}: {text}", row.name);
        }
    }
    assert_eq!(RUST.apply(Op::Pow, &operands), "e::pow(a, b)");
    assert_eq!(C.apply(Op::Pow, &operands), "fdm_pow(a, b)");
    assert_eq!((C.apply(Op::Abs, &operands), C.apply(Op::Min, &operands)), ("fabs(a)".into(), "m_min(a, b)".into()));
}

#[test]
fn names_and_texts_of_users_do_no_harm() {
    assert_eq!((plain("x(0)").as_str(), plain("α").as_str(), plain("_q").as_str()), ("x_0", "m_", "m_q"));
    assert_eq!(distinct(["x(0)", "x_0", "ä", "ö"], true), ["X_0", "X_0_2", "M_", "M__2"]);
    assert_eq!(c_string("a\"\\?ä\n"), r#""a\"\\\?\303\244\012""#);
    assert_eq!(comment("a */ b /* c\nd"), "a * / b / * c d");
}

/// A chain in which every value is read by the next and by a last sum.
fn program(length: u32) -> Program {
    use Operand::{State, Value};
    let instruction = |k: u32| match k {
        0 => Instruction { op: Op::Sin, args: [State(0); 3] },
        k => Instruction { op: Op::Add, args: [Value(k - 1), Value(k / 2), Value(k - 1)] },
    };
    let results = [(0, Value(length - 1)), (1, Value(0)), (2, State(1))];
    let results = results.map(|(slot, operand)| Placed { slot, operand }).to_vec();
    Program {
        constants: Vec::new(),
        calls: Vec::new(),
        instructions: (0..length).map(instruction).collect(),
        results,
        width: 3,
    }
}

/// Runs pieces as a compiler would: values of other pieces are seen through the places alone.
fn run(program: &Program, longest: usize) -> Vec<f64> {
    let pieces = Pieces::of(program, longest).expect("short");
    let (mut w, mut out) = (vec![f64::NAN; pieces.places as usize], vec![f64::NAN; program.width]);
    for piece in &pieces.pieces {
        assert!(piece.instructions.len() + piece.results.len() <= longest.clamp(2, 1000) + program.results.len());
        let first = piece.instructions.start;
        let mut values: Vec<f64> = Vec::new();
        let see = |o: Operand, values: &[f64], w: &[f64]| match o {
            Operand::Value(k) if (k as usize) >= first && piece.instructions.contains(&(k as usize)) => {
                values[k as usize - first]
            }
            Operand::Value(k) => w[pieces.waits[k as usize].expect("a place") as usize],
            Operand::State(k) => 0.3 + f64::from(k),
            other => panic!("{other:?}"),
        };
        for k in piece.instructions.clone() {
            let Instruction { op, args } = program.instructions[k];
            let [a, b, c] = args.map(|o| see(o, &values, &w));
            values.push((op.row().value)(a, b, c));
            if let Some(place) = pieces.waits[k] {
                w[place as usize] = values[k - first];
            }
        }
        for r in &piece.results {
            out[r.slot as usize] = see(r.operand, &values, &w);
        }
    }
    out
}

#[test]
fn pieces_compute_what_the_whole_computes() {
    let program = program(500);
    let whole = run(&program, usize::MAX);
    assert!(whole.iter().all(|v| v.is_finite()));
    for longest in [1, 2, 3, 7, 100, 502, 503] {
        assert_eq!(run(&program, longest), whole, "{longest}");
    }
}

#[test]
fn what_no_stack_holds_is_refused() {
    use Operand::{State, Value};
    let count = 200_000;
    let first = (0..count).map(|_| Instruction { op: Op::Sin, args: [State(0); 3] });
    let second = (0..count).rev().map(|k| Instruction { op: Op::Cos, args: [Value(k); 3] });
    let program = Program { instructions: first.chain(second).collect(), ..Program::default() };
    let refused = Pieces::of(&program, 1000).expect_err("too long");
    assert!(refused.places > 190_000 && refused.to_string().contains("more than the 65536"), "{refused}");
}

#[test]
fn a_file_names_everything_and_needs_only_what_it_calls() {
    let text = "model m \"a thing\" { input u [m]; state x \"place\" [m] = free; param k = 2 in [0, 5] [1/s]; \
                der(x) = k*(u - x); output y [m] = delay(max(x, u), 1); }";
    let compiled = compile(&Source::new("m.fdm", text)).expect("a model");
    let c = stand_alone(&compiled.model, &compiled.schedule, &Language::C).expect("short");
    for wanted in [
        " * m: a thing\n",
        " *   der(x) = k*(u - x)\n",
        "m_STATE_X = 0 /* x [m]: place */",
        "m_PARAM_X_0 = 0, /* x(0) [m]",
        "static double m_max(double a, double b)",
        "const double m_param_upper[2] = {HUGE_VAL, 5.0};",
    ] {
        assert!(c.contains(wanted), "{wanted}\n{c}");
    }
    assert!(!c.contains("#define fdm_") && !c.contains("m_min"));
    for (elementary, wanted) in [(Elementary::Std, false), (Elementary::Path("libm".into()), false)] {
        let rust = stand_alone(&compiled.model, &compiled.schedule, &Language::Rust(elementary)).expect("short");
        assert_eq!(rust.contains("elementary::"), wanted);
        assert!(rust.contains("pub mod state {\n    /// x [m]: place\n    pub const X: usize = 0;"), "{rust}");
    }
}
