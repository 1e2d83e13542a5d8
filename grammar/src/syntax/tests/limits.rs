//! Long, deep and random texts end in a tree or a finding, quickly and on a small stack.

use super::super::{SyntaxTree, parse_recovering};
use crate::diagnostic::{Code, Diagnostic};
use crate::source::Source;
use crate::stopwatch::timed;
use std::time::Duration;

fn read(right: &str) -> (Option<SyntaxTree>, Vec<Diagnostic>) {
    parse_recovering(&Source::new("m", format!("model m {{\nder(x) = {right};\n}}")))
}

/// Runs on a thread with the stack that Rust gives to threads.
fn on_small_stack<T: Send + 'static>(run: impl FnOnce() -> T + Send + 'static) -> T {
    std::thread::Builder::new().stack_size(2 << 20).spawn(run).unwrap().join().unwrap()
}

/// Forms that nest one level with each repetition.
const NESTS: [(&str, &str); 6] = [
    ("(", ")"),
    ("f(", ")"),
    ("-(1 + ", ")"),
    ("2^f(1, ", ", 3)"),
    ("if a then 1 else 1 + ", ""),
    ("if a then ", " else 1"),
];

fn nested((open, close): (&str, &str), levels: usize) -> String {
    format!("{}x{}", open.repeat(levels), close.repeat(levels))
}

#[test]
fn all_levels_up_to_the_limit_are_read_on_a_small_stack() {
    for nest in NESTS {
        let (tree, found) = on_small_stack(move || read(&nested(nest, 256)));
        assert_eq!((tree.unwrap().statements.len(), found), (1, vec![]), "{nest:?}");
        let (tree, found) = on_small_stack(move || read(&nested(nest, 257)));
        assert_eq!((tree.unwrap().statements.len(), found.len(), found[0].code), (0, 1, Code::TooDeep), "{nest:?}");
    }
    let alternating = format!("{}x < 1{}", "if (".repeat(128), ") then 1 else 2".repeat(128));
    assert_eq!(on_small_stack(move || read(&alternating)).1, vec![]);
}

#[test]
fn deep_nesting_is_told_once_at_the_bracket_that_exceeds_the_limit() {
    for levels in [257, 5_000, 200_000] {
        for text in [nested(NESTS[0], levels), "(".repeat(levels)] {
            let ((_, found), took) = on_small_stack(move || timed(|| read(&text)));
            assert!(took < Duration::from_secs(2), "{levels} levels took {took:?}");
            assert_eq!((found.len(), found[0].code), (1, Code::TooDeep));
            assert!(found[0].message.contains("256"), "{}", found[0].message);
            assert_eq!(found[0].span.start as usize, "model m {\nder(x) = ".len() + 256);
        }
    }
}

#[test]
fn long_chains_take_no_stack_and_linear_time() {
    let n = 200_000;
    let cases = |n: usize| {
        [
            (vec!["x"; n].join(" + "), 2 * n - 1),
            (format!("{}x", "-".repeat(n)), n + 1),
            (vec!["x"; n].join("^"), 2 * n - 1),
            (format!("f({})", vec!["x"; n].join(",")), n + 1),
            (format!("{}c", "if a then b else ".repeat(n / 4)), n / 4 * 3 + 1),
            (vec!["a < b"; n / 4].join(" and "), n - 1),
        ]
    };
    let took = |(text, expressions): &(String, usize)| {
        let ((tree, found), took) = on_small_stack({
            let text = text.clone();
            move || timed(|| read(&text))
        });
        assert_eq!(found, vec![]);
        assert_eq!(tree.unwrap().expressions.len(), expressions + 2);
        took
    };
    for (short, long) in cases(n / 8).iter().zip(&cases(n)) {
        let (few, many) = (took(short), took(long));
        // eight times as much takes eight times as long; a quadratic algorithm 64 times
        assert!(many < 24 * few + Duration::from_millis(100), "{few:?}, then {many:?} for {}...", &long.0[..20]);
    }
}

#[test]
fn much_that_is_wrong_takes_linear_time() {
    let n = 100_000;
    let cases = [
        "@ ",
        "der(x) = a b;",
        "a\n",
        "{",
        "{;",
        "}",
        "(;",
        "\"",
        "trim {",
        "[",
        "param\n",
        "model\n",
        "x = [",
        "if ",
        "\"\" ",
        "1.2.3",
    ];
    for piece in cases {
        let read = |n: usize| {
            let source = Source::new("m", format!("model m {{ {}", piece.repeat(n)));
            timed(|| parse_recovering(&source))
        };
        let ((_, few), short) = read(n / 8);
        let ((_, many), long) = read(n);
        assert!((1..=21).contains(&few.len()) && (1..=21).contains(&many.len()), "{piece}");
        // eight times as much takes eight times as long; a quadratic algorithm 64 times
        assert!(long < 24 * short + Duration::from_millis(100), "{short:?}, then {long:?} for {piece}");
    }
}

#[test]
fn texts_beyond_the_limits_are_refused_at_once() {
    let bytes = parse_recovering(&Source::new("m", " ".repeat((64 << 20) + 1))).1;
    assert_eq!((bytes.len(), bytes[0].code), (1, Code::TooLarge));
    assert!(bytes[0].message.contains("67108864"), "{}", bytes[0].message);
}

/// xorshift64*: the same numbers in every run.
struct Random(u64);

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 33) as usize % n.max(1)
    }
}

/// Whatever is read, spans lie in the text and findings stay few; without findings there is a tree.
fn examine(text: &str) {
    let source = Source::new("m", text);
    let (tree, found) = parse_recovering(&source);
    assert!(found.len() <= 21 && (tree.is_some() || !found.is_empty()), "{text:?}");
    let inside = |s: crate::Span| s.start <= s.end && text.get(s.range()).is_some();
    assert!(found.iter().all(|f| inside(f.span) && f.is_error() && !f.message.is_empty()), "{found:?} in {text:?}");
    let Some(tree) = tree else { return };
    assert!(tree.statements.iter().all(|s| inside(s.span)), "{text:?}");
    assert!(tree.expressions.iter().all(|(_, s)| inside(*s) && s.start < s.end), "{text:?}");
}

#[test]
fn random_bytes_never_panic() {
    let mut random = Random(1);
    for _ in 0..3_000 {
        let length = random.below(200);
        let bytes: Vec<u8> = (0..length).map(|_| random.below(256) as u8).collect();
        examine(&String::from_utf8_lossy(&bytes));
        let ascii: String = bytes.iter().map(|b| (b % 96 + 31) as char).collect();
        examine(&format!("model m {{ {ascii} }}"));
    }
}

#[test]
fn random_words_never_panic() {
    const WORDS: [&str; 63] = [
        "model ",
        "m ",
        "{",
        "}",
        "{",
        "}",
        ";",
        ";",
        ";",
        "\n",
        "\n",
        "state ",
        "param ",
        "let ",
        "output ",
        "input ",
        "time ",
        "prior ",
        "noise ",
        "~ ",
        "x ",
        "y ",
        "der(x) = ",
        "der",
        "(",
        ")",
        "(",
        ")",
        "[",
        "]",
        "[m]",
        ",",
        "=",
        "==",
        ":=",
        "+",
        "-",
        "*",
        "**",
        "^",
        "<",
        "if ",
        "then ",
        "else ",
        "else if ",
        "and ",
        "not ",
        "1",
        "2.5",
        "1e400 ",
        "\"doc\"",
        "\"",
        "in ",
        "fixed ",
        "per ",
        "run ",
        "free ",
        "trim {",
        "use ",
        "/*",
        "*/",
        "é",
        "²",
    ];
    let mut random = Random(2);
    for _ in 0..6_000 {
        let length = random.below(40);
        let text: String = (0..length).map(|_| WORDS[random.below(WORDS.len())]).collect();
        examine(&text);
        examine(&format!("model m {{ {text}"));
    }
}

#[test]
fn mutations_of_a_model_never_panic() {
    let chars: Vec<char> = super::PITCH.chars().collect();
    let mut random = Random(3);
    for _ in 0..1_500 {
        let mut text = chars.clone();
        for _ in 0..1 + random.below(4) {
            if text.is_empty() {
                break;
            }
            let at = random.below(text.len());
            match random.below(4) {
                0 => drop(text.remove(at)),
                1 => text.insert(at, chars[random.below(chars.len())]),
                2 => text[at] = char::from_u32(random.below(0x3000) as u32).unwrap_or('x'),
                _ => text.truncate(at.max(1)),
            }
        }
        examine(&text.into_iter().collect::<String>());
    }
}
