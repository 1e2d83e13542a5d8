//! What was meant by a statement that the grammar refused: signs and words of other languages, slips, missing parts.

use super::expected::{Expected, TYPES, Want, shown};
use super::scan::Kind;
use super::words::{WordUse, word_use};
use crate::diagnostic::nearest;

impl Expected<'_> {
    /// What would mend it.
    pub(super) fn hint(&self) -> Option<String> {
        let (word, before) =
            (self.word(self.at), if self.at > self.statement.start { self.word(self.at - 1) } else { "" });
        self.knowledge()
            .or_else(|| self.decimal_comma())
            .or_else(|| self.prime(word, before))
            .or_else(|| self.foreign(word, before).map(String::from))
            .or_else(|| self.misspelt_word(word))
            .or_else(|| self.unfinished(word))
            .or_else(|| self.neighbours(word, before))
    }

    /// `1,5` where the comma, or what follows it, cannot stand.
    fn decimal_comma(&self) -> Option<String> {
        let comma = if self.word(self.at) == "," { self.at } else { self.at.checked_sub(1)? };
        let number = |at: usize| self.kind(at) == Some(Kind::Number);
        let between = comma > 0 && self.word(comma) == "," && number(comma - 1) && number(comma + 1);
        (between && !self.wants(Want::CloseBracket)).then(|| {
            let (whole, fraction) = (shown(self.word(comma - 1)), shown(self.word(comma + 1)));
            format!("a decimal fraction is written with a point: `{whole}.{fraction}`")
        })
    }

    /// `x'`
    fn prime(&self, word: &str, before: &str) -> Option<String> {
        let named = self.at > self.statement.start && self.kind(self.at - 1) == Some(Kind::Name);
        let name = if named { shown(before) } else { "x".into() };
        (word == "'").then(|| format!("a derivative is written `der({name})`"))
    }

    /// Whether the token stands inside brackets.
    fn in_brackets(&self) -> bool {
        let open = |at: &usize| self.kind(*at) == Some(Kind::Open);
        let close = |at: &usize| self.kind(*at) == Some(Kind::Close);
        let before = || self.statement.start..self.at;
        before().filter(open).count() > before().filter(close).count()
    }

    /// Signs and forms of other languages.
    fn foreign(&self, word: &str, before: &str) -> Option<&'static str> {
        Some(match word {
            ":=" => "equations and values are written with a single `=`",
            "**" | ".^" => "a power is written with `^`",
            ".*" => "a product is written with `*`",
            "./" => "a quotient is written with `/`",
            "&&" | "&" => "write `and`",
            "||" | "|" => "write `or`",
            "!" => "write `not`",
            "~=" | "<>" => "write `!=`",
            "~" if self.wants(Want::Expression) => "write `not`",
            "=<" => "write `<=`",
            "=>" => "write `>=`",
            "+=" | "-=" | "*=" | "/=" => "an equation is written `left = right`",
            ")" if self.wants(Want::End) => "no `(` is open here",
            "~" => {
                "what is measured is written `output y = ...`, what is known before `prior a ~ normal(mean, deviation)`"
            }
            "elseif" | "elsif" | "elif" if self.wants(Want::Else) => "write `else if`",
            "end" | "endif" if self.wants(Want::Infix) => "a choice ends by itself: `if c then a else b`",
            _ if before == "der" => "a derivative is written `der(x)`",
            "=" if self.wants(Want::Then) || self.wants(Want::Close) => "a comparison is written with `==`",
            "." => "a part of a submodel is written without spaces: `act.y`",
            "time" => "the time since the run began is `t`",
            "{" if self.wants(Want::Expression) => "expressions are grouped with `(` and `)`",
            _ => return None,
        })
    }

    /// `fixd`, `esle`, and words of the language used as quantities.
    fn misspelt_word(&self, word: &str) -> Option<String> {
        if self.at >= self.statement.end {
            return None;
        }
        match self.kind(self.at)? {
            Kind::Name => {
                let mut candidates = Vec::new();
                let mut add = |want, words: &[&'static str]| {
                    if self.wants(want) {
                        candidates.extend_from_slice(words);
                    }
                };
                add(Want::Attribute, &["fixed", "per run", "per", "in"]);
                add(Want::Run, &["run"]);
                add(Want::Then, &["then"]);
                add(Want::Else, &["else"]);
                add(Want::Infix, &["and", "or"]);
                nearest(word, candidates).map(|meant| format!("did you mean `{meant}`?"))
            }
            Kind::Keyword if self.wants(Want::Expression) => {
                let quantity = !matches!(word_use(word), Some(WordUse::Expression | WordUse::Value) | None);
                quantity.then(|| format!("`{word}` is a word of the language; give the quantity another name"))
            }
            _ => None,
        }
    }

    /// `prior a = ...`, `noise y;`, `trim u = 1;`
    fn knowledge(&self) -> Option<String> {
        let (wanted, form) = match self.word(self.statement.start) {
            "prior" => (Want::Tilde, "a prior is written `prior a ~ normal(mean, deviation)`"),
            "noise" if self.word(self.statement.start + 1) == "der" => {
                (Want::Equals, "noise in an equation is written `noise der(x) = intensity`")
            }
            "noise" => (Want::Equals, "known noise is written `noise y = deviation`"),
            "tie" => (Want::Equals, "a tie is written `tie a = b`"),
            "reactions" if self.wants(Want::Arrow) => (Want::Arrow, "a reaction is written `A + 2*B -> C : rate;`"),
            "reactions" if self.wants(Want::Colon) => {
                (Want::Colon, "behind a reaction stands its rate: `A + 2*B -> C : k*A*B;`")
            }
            "table" if self.wants(Want::Colon) => (Want::Colon, "a point is written `x: y`"),
            "table" => (Want::Open, "a table is written `table NAME(x) = linear { x1: y1, x2: y2 }`"),
            "param" => (Want::At, "a param that depends on others is written `param k(V) = 1 at [0, 10, 20]`"),
            "smooth" => (Want::Order, "smoothness is written `smooth TABLE by order 2`"),
            "requirement" => {
                (Want::Equals, "a requirement is written `requirement name = expression in [lower, upper]`")
            }
            "limit" if self.wants(Want::Attribute) => {
                (Want::Attribute, "a limit is written `limit x in [lower, upper]`")
            }
            "when" if self.wants(Want::Equals) => {
                (Want::Equals, "an event is written `when x > limit { v = -0.5*v; }`")
            }
            "when" => (Want::Brace, "an event is written `when x > limit { v = -0.5*v; }`"),
            "use" => (Want::As, "a submodel is used by `use \"file.fdm\" as name(input = expression)`"),
            "trim" if self.wants(Want::Equals) => (Want::Equals, "a trim is written `trim { x = value; u = value; }`"),
            "trim" => (Want::Brace, "a trim is written `trim { x = value; u = value; }`"),
            _ => return None,
        };
        self.wants(wanted).then(|| form.into())
    }

    /// Forms that lack a part.
    fn unfinished(&self, word: &str) -> Option<String> {
        let hint = if self.wants(Want::Then) || self.wants(Want::Else) {
            "a choice is written `if c then a else b`"
        } else if self.wants(Want::Bracket) && !self.wants(Want::Expression)
            || self.wants(Want::CloseBracket)
            || self.wants == [Want::Infix, Want::Comma]
        {
            "bounds are written `in [lower, upper]`"
        } else if self.wants(Want::Run) {
            "a value for each run is marked `per run`"
        } else if self.wants(Want::Brace) && matches!(word, "-" | "." | ":") {
            "a name consists of letters, digits and `_`"
        } else if self.wants(Want::Equals) && !self.wants(Want::Attribute) && self.at == self.statement.end {
            "an equation is written `der(x) = ...;`"
        } else {
            return None;
        };
        Some(hint.into())
    }

    /// Two things side by side with nothing between them.
    fn neighbours(&self, word: &str, before: &str) -> Option<String> {
        if self.at >= self.statement.end || self.at == self.statement.start {
            return None;
        }
        let (kind, previous) = (self.kind(self.at)?, self.kind(self.at - 1)?);
        if self.wants(Want::Attribute) && previous == Kind::Name && self.last_declared() == Some(self.at - 1) {
            return self.behind_name(kind, word, before);
        }
        if kind == Kind::Unit && self.wants(Want::Infix) {
            return Some(self.unit_in_expression(word));
        }
        if kind == Kind::Text && self.wants(Want::Infix) {
            return Some("doc strings stand in declarations".into());
        }
        let operand = |k| matches!(k, Kind::Number | Kind::Name | Kind::Close);
        let pair = operand(previous) && before != "]" && (matches!(kind, Kind::Number | Kind::Name) || word == "(");
        (pair && self.wants(Want::Infix)).then(|| {
            let comma = self.wants(Want::Comma) && self.in_brackets();
            let argument = if comma { "arguments are separated by `,`; " } else { "" };
            let left = if before == ")" { "(...)".into() } else { shown(before) };
            let right = if word == "(" { "(...)".into() } else { shown(word) };
            let call =
                if previous == Kind::Name && !comma { format!(", a call `{left}({right})`") } else { String::new() };
            format!("{argument}a product is written `{left}*{right}`{call}")
        })
    }

    /// `param x 3`, `param x -3`, `param L-p`, `input real u`.
    fn behind_name(&self, kind: Kind, word: &str, before: &str) -> Option<String> {
        let (name, next) = (shown(before), self.word(self.at + 1));
        if TYPES.contains(&before.to_lowercase().as_str()) {
            let keyword = self.word(self.statement.start);
            let name = if kind == Kind::Name { shown(word) } else { "NAME".into() };
            return Some(format!("a quantity has no type: `{keyword} {name}`"));
        }
        let sign = matches!(word, "+" | "-");
        if sign && self.kind(self.at + 1) == Some(Kind::Name) {
            return Some(format!("a name consists of letters, digits and `_`: `{name}_{}`", shown(next)));
        }
        let value = matches!(kind, Kind::Number | Kind::Name) || word == "(" || sign;
        let rest = if sign { shown(next) } else { String::new() };
        value.then(|| format!("a value is written `{name} = {}{rest}`", shown(word)))
    }

    /// `b = 2 [m]`, `y[3]`.
    fn unit_in_expression(&self, unit: &str) -> String {
        let first = self.statement.start;
        if unit.bytes().all(|b| b.is_ascii_digit() || b"[], ".contains(&b)) {
            return "an index stands directly behind a name: `x[2]`".into();
        }
        if self.word(first + 1) == "=" {
            return format!("`param {} = ...;` or `const` declares a quantity with a unit", shown(self.word(first)));
        }
        "units stand in declarations only".into()
    }
}
