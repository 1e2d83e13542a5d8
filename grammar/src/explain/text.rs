//! Pages of `E01..`: the text itself.

use super::{Example, Page};

pub(super) const UNEXPECTED: Page = Page {
    meaning: "At this place the grammar expects something else. The message names what was expected and what was found;
often it is a semicolon, a bracket or a comma that is missing just before.",
    broken: Example::Text(
        "model cooling {
  state T = 90
  param k = 0.1;
  der(T) = -k*T;
  output T_m = T;
}",
    ),
    corrected: "model cooling {
  state T = 90;
  param k = 0.1;
  der(T) = -k*T;
  output T_m = T;
}",
    why: "every statement ends with `;`, so that one broken statement does not hide the mistakes behind it.",
};

pub(super) const TOO_DEEP: Page = Page {
    meaning: "Brackets, choices and signs stand inside each other in more than 256 levels.",
    broken: Example::Made { told: "an expression inside 300 pairs of brackets: ((((...x...))))", make: deep },
    corrected: "model levels {
  state x = 1;
  let inner = x^2 + 1;
  let outer = (inner + 1)^2;
  der(x) = -outer;
  output y = x;
}",
    why: "no text may exhaust the memory of who reads it. Give names to inner expressions with `let`; names cost
nothing, each is computed once.",
};

fn deep() -> Vec<u8> {
    format!("model m {{ state x = 1; der(x) = {}x{}; output y = x; }}", "(".repeat(300), ")".repeat(300)).into_bytes()
}

pub(super) const TOO_LARGE: Page = Page {
    meaning: "The text is longer than 64 MiB, or has more than two million words, numbers and signs.",
    broken: Example::Made { told: "two million and one terms: x + x + x + ...", make: large },
    corrected: "model sum {
  state x = 1;
  der(x) = -2000001*x;
  output y = x;
}",
    why: "time and memory of a compilation are in proportion to the text, and these are the most that are given.
Measured data do not belong into a model: they are recorded inputs.",
};

fn large() -> Vec<u8> {
    format!("model m {{ state x = 1; der(x) = {}x; output y = x; }}", "x + ".repeat(2_000_000)).into_bytes()
}

pub(super) const UNTERMINATED: Page = Page {
    meaning: "A string, a comment or a bracket is opened and not closed before the text, or what it belongs to, ends.",
    broken: Example::Text(
        "model cooling {
  state T = 90;
  param k = 0.1;
  der(T) = -k*(T - 20;
  output T_m = T;
}",
    ),
    corrected: "model cooling {
  state T = 90;
  param k = 0.1;
  der(T) = -k*(T - 20);
  output T_m = T;
}",
    why: "what an open bracket swallows would be told as mistakes that nobody made; so brackets are paired first.",
};

pub(super) const BAD_NUMBER: Page = Page {
    meaning: "A number is written in a form that has no value: an exponent without digits, a value beyond 1.8e308, or one that is so near zero (below 2.2e-308) that its digits are lost.",
    broken: Example::Text(
        "model cooling {
  state T = 90;
  param k = 1e;
  der(T) = -k*T;
  output T_m = T;
}",
    ),
    corrected: "model cooling {
  state T = 90;
  param k = 1e-1;
  der(T) = -k*T;
  output T_m = T;
}",
    why: "a number that silently became 1, zero or infinite would spoil a fit without a word.",
};

pub(super) const NOT_TEXT: Page = Page {
    meaning: "The file holds bytes that are not UTF-8 text: another encoding, or not a text at all.",
    broken: Example::Made { told: "a file saved as Latin-1 with an accented letter in a doc string", make: latin },
    corrected: "model cooling \"Abk\u{fc}hlung\" {
  state T = 90;
  param k = 0.1;
  der(T) = -k*T;
  output T_m = T;
}",
    why: "names and doc strings may use all letters of Unicode; UTF-8 is the one encoding that every editor writes.",
};

fn latin() -> Vec<u8> {
    b"model cooling \"Abk\xfchlung\" { state T = 90; der(T) = -T; output y = T; }".to_vec()
}
