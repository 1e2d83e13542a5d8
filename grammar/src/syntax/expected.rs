//! One statement that the grammar refused, in the user's words: what should stand there, what does, what was meant.
//!
//! What was meant by a statement that the grammar refused: signs and words of other languages, slips, missing parts.

use super::scan::{Kind, Token};
use super::scan::{WordUse, word_use, words_for};
use crate::diagnostic::{Code, Diagnostic, nearest};
use crate::source::Span;
use std::ops::Range;

/// What other languages write before a declared name.
pub(super) const TYPES: [&str; 8] = ["real", "float", "double", "int", "integer", "number", "vector", "var"];

/// Something that the grammar would have taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Want {
    Statement,
    Model,
    Expression,
    Name,
    Run,
    Equals,
    Tilde,
    As,
    From,
    Order,
    At,
    Open,
    Colon,
    Arrow,
    Point,
    Bracket,
    Then,
    Else,
    Unit,
    Comma,
    Close,
    CloseBracket,
    Brace,
    CloseBrace,
    Semicolon,
    End,
    Infix,
    Doc,
    Attribute,
    LessNesting,
    EffectStatement,
    Slot,
    Kind,
    Place,
    With,
    PlusEquals,
}

impl Want {
    /// In messages; things that may but need not stand somewhere are not named.
    fn words(self) -> Option<&'static str> {
        Some(match self {
            Self::Statement | Self::Expression => "an expression",
            Self::Model => "`model`",
            Self::Name => "a name",
            Self::Run => "`run`",
            Self::Equals => "`=`",
            Self::Tilde => "`~`",
            Self::Bracket => "`[`",
            Self::As => "`as`",
            Self::From => "`from`",
            Self::Order => "`by order`",
            Self::At => "`at`",
            Self::Open => "`(`",
            Self::Colon => "`:`",
            Self::Arrow => "`->` or `<->`",
            Self::Point => "a point `x: y`",
            Self::Then => "`then`",
            Self::Else => "`else`",
            Self::Unit => "a unit such as `[s]`",
            Self::Comma => "`,`",
            Self::Close => "`)`",
            Self::CloseBracket => "`]`",
            Self::Brace => "`{`",
            Self::CloseBrace => "`}`",
            Self::End | Self::Semicolon => "`;`",
            Self::EffectStatement => "a statement of an effect",
            Self::Slot => "what it attaches to, such as `x: state`",
            Self::Kind => "`input`, `state`, `output` or `param`",
            Self::Place => "`der(x)` or the name of an output",
            Self::With => "`with`",
            Self::PlusEquals => "`+=`",
            Self::Infix | Self::Doc | Self::Attribute | Self::LessNesting => return None,
        })
    }
}

/// A piece of the text in a message: short, and without characters that cannot be seen.
pub(super) fn shown(text: &str) -> String {
    let mut short = String::new();
    for c in text.chars().take(40) {
        match c {
            // Controls, joiners and marks that turn the direction of writing.
            _ if c.is_control() => short.extend(c.escape_default()),
            '\u{200b}'..='\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2060}'..='\u{206f}' | '\u{feff}' => {
                short.extend(c.escape_default());
            }
            _ => short.push(c),
        }
    }
    if text.chars().nth(40).is_some() { short + "..." } else { short }
}

/// A statement, the token that the grammar refused, and what it would have taken instead.
pub(super) struct Expected<'a> {
    pub(super) text: &'a str,
    pub(super) tokens: &'a [Token],
    /// The tokens of the statement, without its semicolon.
    pub(super) statement: Range<usize>,
    /// Whether a semicolon (or, after a header, a brace) follows it.
    pub(super) closed: bool,
    /// The token; the end of the statement when it stops too early.
    pub(super) at: usize,
    pub(super) wants: &'a [Want],
}

impl Expected<'_> {
    /// The finding with its hint.
    pub(super) fn finding(&self) -> Diagnostic {
        let special = self.foreign_statement().or_else(|| self.misspelt_statement()).or_else(|| self.double_equals());
        if let Some(found) = special.or_else(|| self.trailing_comma()).or_else(|| self.reserved_name()) {
            return found;
        }
        if self.wants(Want::LessNesting) {
            let message = "nested more deeply than the stack of this thread allows";
            return Diagnostic::new(Code::TooDeep, self.span(), message);
        }
        let expected = self.expected();
        let after = if expected == "`;`" { format!(" after {}", self.subject()) } else { String::new() };
        let message = format!("expected {expected}{after}, found {}", self.found());
        let found = Diagnostic::new(Code::Unexpected, self.span(), message);
        match self.hint() {
            Some(hint) => found.hint(hint),
            None => found,
        }
    }

    /// What the statement is about: "the declaration of `x`".
    pub(super) fn subject(&self) -> String {
        let first = self.statement.start;
        let name = |at: usize| shown(self.word(at));
        match self.word(first) {
            "der" => format!("the equation of `{}`", name(first + 2)),
            "time" => "the unit of time".into(),
            "prior" => format!("the prior of `{}`", name(self.last_declared().unwrap_or(first + 1))),
            "noise" => format!("the noise of `{}`", name(self.last_declared().unwrap_or(first + 1))),
            "tie" => format!("the tie of `{}`", name(self.last_declared().unwrap_or(first + 1))),
            "table" => format!("the table `{}`", name(first + 1)),
            "requirement" => format!("the requirement `{}`", name(self.last_declared().unwrap_or(first + 1))),
            "use" => format!("the use of {}", name(first + 1)),
            "effect" => format!("the effect `{}`", name(first + 1)),
            "nuisance" => format!("the declaration of `{}`", name(first + 1)),
            "add" | "replace" if self.word(first + 1) != "=" => format!("`{}`", name(first)),
            "trim" => format!("the trim of `{}`", name(self.last_set().unwrap_or(first + 2))),
            _ if self.word(first + 1) == "=" => format!("the equation of `{}`", name(first)),
            "input" | "state" | "param" | "const" | "let" | "output" => match self.last_declared() {
                Some(at) => format!("the declaration of `{}`", name(at)),
                None => format!("`{}`", name(first)),
            },
            _ => "the equation".into(),
        }
    }

    /// The name whose declaration the token is in: the last one before it that begins a declaration.
    pub(super) fn last_declared(&self) -> Option<usize> {
        let mut depth = 0_usize;
        let mut last = None;
        for at in self.statement.start + 1..self.at.min(self.statement.end) {
            match self.tokens[at].kind {
                Kind::Open => depth += 1,
                Kind::Close => depth = depth.saturating_sub(1),
                Kind::Name if depth == 0 && (at == self.statement.start + 1 || self.word(at - 1) == ",") => {
                    last = Some(at);
                }
                _ => {}
            }
        }
        last
    }

    /// The name in a `trim` whose value the token is in.
    fn last_set(&self) -> Option<usize> {
        let begins = |at: &usize| self.kind(*at) == Some(Kind::Name) && matches!(self.word(*at - 1), "{" | ";");
        (self.statement.start + 1..self.at.min(self.statement.end)).rev().find(begins)
    }

    /// The text of a token; empty behind the last.
    pub(super) fn word(&self, at: usize) -> &str {
        self.tokens.get(at).map_or("", |t| t.text(self.text))
    }

    pub(super) fn kind(&self, at: usize) -> Option<Kind> {
        self.tokens.get(at).map(|t| t.kind)
    }

    /// Where the finding is shown: at the token, or behind the last one when the statement stops too early.
    fn span(&self) -> Span {
        match self.tokens.get(self.at) {
            Some(token) if self.at < self.statement.end || self.closed => token.span,
            _ => {
                let end = self.tokens[self.at.min(self.tokens.len()) - 1].span.end as usize;
                Span::new(end, end)
            }
        }
    }

    pub(super) fn wants(&self, want: Want) -> bool {
        self.wants.contains(&want)
    }

    fn expected(&self) -> String {
        if self.wants(Want::Expression) || self.wants(Want::Statement) {
            return "an expression".into();
        }
        let mut wants = self.wants.to_vec();
        if wants.contains(&Want::Attribute) {
            // Behind a declared name much may stand; what is wrong is that the declaration does not end.
            wants.retain(|w| matches!(w, Want::End));
        }
        wants.sort_unstable();
        wants.dedup();
        let words: Vec<_> = wants.iter().filter_map(|w| w.words()).collect();
        match words.split_last() {
            Some((last, [])) => (*last).into(),
            Some((last, others)) => format!("{} or {last}", others.join(", ")),
            None => "something else".into(),
        }
    }

    fn found(&self) -> String {
        match self.tokens.get(self.at) {
            None => "the end of the text".into(),
            Some(token) => format!("`{}`", shown(token.text(self.text))),
        }
    }

    /// `equation`, `end Tank;`: words that structure a model elsewhere.
    fn foreign_statement(&self) -> Option<Diagnostic> {
        let word = self.word(self.statement.start);
        if self.at != self.statement.start + 1 || self.word(self.at) == "=" {
            return None;
        }
        let hint = match word {
            "equation" | "equations" | "algorithm" | "begin" | "parameters" | "transformed" | "data" => {
                "there are no sections: declarations and equations stand in any order"
            }
            "end" | "endmodel" => "a model ends with `}`",
            "function" | "def" => "an expression is given a name with `let`",
            "import" | "include" => "a model is one text",
            _ => return None,
        };
        let message = format!("no statement begins with `{word}`");
        Some(Diagnostic::new(Code::Unexpected, self.tokens[self.statement.start].span, message).hint(hint))
    }

    /// `stat x;`, `parameter k = 3;`
    fn misspelt_statement(&self) -> Option<Diagnostic> {
        let (first, second) = (self.statement.start, self.statement.start + 1);
        if self.at > second || self.kind(first) != Some(Kind::Name) {
            return None;
        }
        if !matches!(self.kind(second), Some(Kind::Name | Kind::Keyword | Kind::Text | Kind::Open | Kind::Semicolon)) {
            return None;
        }
        let word = self.word(first);
        let meant = match word.to_lowercase().as_str() {
            "parameter" | "parameters" => "param",
            "constant" | "constants" => "const",
            "variable" => "state",
            // what has a number is a parameter rather than something that moves
            lower if TYPES.contains(&lower) && self.word(second + 1) == "=" => "param",
            lower if TYPES.contains(&lower) => "state",
            "der" => return None,
            _ => {
                let words = words_for(&[WordUse::Statement, WordUse::Planned]);
                match nearest(word, words.chain(["parameter", "constant"]))? {
                    "parameter" => "param",
                    "constant" => "const",
                    near => near,
                }
            }
        };
        let message = format!("no statement begins with `{}`", shown(word));
        let found = Diagnostic::new(Code::Unexpected, self.tokens[first].span, message);
        Some(found.hint(format!("did you mean `{meant}`?")))
    }

    /// `der(x) == ...` is read as a comparison that nothing is equated to.
    fn double_equals(&self) -> Option<Diagnostic> {
        let at = if self.word(self.at) == "==" { self.at } else { self.lone_comparison()? };
        self.wants(Want::Equals).then(|| {
            Diagnostic::new(Code::Unexpected, self.tokens[at].span, "expected `=`, found `==`")
                .hint("equations and values are written with a single `=`; `==` compares")
        })
    }

    fn lone_comparison(&self) -> Option<usize> {
        let mut comparisons = self.statement.clone().filter(|k| self.word(*k) == "==");
        comparisons.next().filter(|_| self.at == self.statement.end)
    }

    /// `state x, y,` where the next statement begins.
    fn trailing_comma(&self) -> Option<Diagnostic> {
        let comma = self.at.checked_sub(1).filter(|at| self.word(*at) == "," && *at > self.statement.start)?;
        (self.at == self.statement.end && !self.closed && self.wants(Want::Name) && !self.wants(Want::Expression)).then(
            || {
                let message = format!("expected `;` after {}, found `,`", self.subject());
                Diagnostic::new(Code::Unexpected, self.tokens[comma].span, message)
                    .hint("behind `,` another name is declared")
            },
        )
    }

    /// `state in;`
    fn reserved_name(&self) -> Option<Diagnostic> {
        let here = self.at < self.statement.end && self.kind(self.at) == Some(Kind::Keyword);
        (here && self.wants(Want::Name) && !self.wants(Want::Expression)).then(|| {
            let message = format!("`{}` is a word of the language and cannot be a name", self.word(self.at));
            Diagnostic::new(Code::ReservedName, self.tokens[self.at].span, message).hint("choose another name")
        })
    }
}

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
