//! One page for each code of a message: what it means, a model that has the mistake, the same model without it, and why.
//!
//! **In** a [`Code`]. **Out** its [`Page`]. **Never** a code without a page: [`page`] names every one, and the tests compile
//! every example. **Start** at [`page`].

mod declarations;
mod effects;
mod equations;
mod made;
mod names;
mod parts;
mod text;
mod units;
mod warnings;

use crate::diagnostic::Code;

/// What is to be known about a kind of mistake.
#[derive(Debug, Clone, Copy)]
pub struct Page {
    /// What the message says, in other words.
    pub meaning: &'static str,
    /// A model with this mistake and no other.
    pub broken: Example,
    /// The model without the mistake.
    pub corrected: &'static str,
    /// Why the language has this rule.
    pub why: &'static str,
}

/// A text with a mistake.
#[derive(Debug, Clone, Copy)]
pub enum Example {
    /// As it would be typed.
    Text(&'static str),
    /// Too long to be shown, or no text at all.
    Made {
        /// What it is.
        told: &'static str,
        /// Writes it.
        make: fn() -> Vec<u8>,
    },
}

/// The page of a code.
pub fn page(code: Code) -> Page {
    match code {
        Code::Unexpected => text::UNEXPECTED,
        Code::TooDeep => text::TOO_DEEP,
        Code::TooLarge => text::TOO_LARGE,
        Code::Unterminated => text::UNTERMINATED,
        Code::BadNumber => text::BAD_NUMBER,
        Code::NotText => text::NOT_TEXT,
        Code::UnknownName => names::UNKNOWN_NAME,
        Code::DeclaredTwice => names::DECLARED_TWICE,
        Code::ReservedName => names::RESERVED_NAME,
        Code::UnknownFunction => names::UNKNOWN_FUNCTION,
        Code::ArgumentCount => names::ARGUMENT_COUNT,
        Code::Cycle => names::CYCLE,
        Code::WrongName => names::WRONG_NAME,
        Code::MissingValue => declarations::MISSING_VALUE,
        Code::NeedlessValue => declarations::NEEDLESS_VALUE,
        Code::BadBounds => declarations::BAD_BOUNDS,
        Code::OutsideBounds => declarations::OUTSIDE_BOUNDS,
        Code::NotConstant => declarations::NOT_CONSTANT,
        Code::WrongAttribute => declarations::WRONG_ATTRIBUTE,
        Code::MissingEquation => equations::MISSING_EQUATION,
        Code::TwoEquations => equations::TWO_EQUATIONS,
        Code::NotADerivative => equations::NOT_A_DERIVATIVE,
        Code::NoOutput => equations::NO_OUTPUT,
        Code::Unsupported => equations::UNSUPPORTED,
        Code::BadDelay => equations::BAD_DELAY,
        Code::NotFinite => equations::NOT_FINITE,
        Code::SingularRates => equations::SINGULAR_RATES,
        Code::NonlinearRate => equations::NONLINEAR_RATE,
        Code::NoFile => parts::NO_FILE,
        Code::NotConnected => parts::NOT_CONNECTED,
        Code::WrongShape => parts::WRONG_SHAPE,
        Code::OutsideShape => parts::OUTSIDE_SHAPE,
        Code::BadTable => made::BAD_TABLE,
        Code::BadBlock => made::BAD_BLOCK,
        Code::BadReaction => made::BAD_REACTION,
        Code::WantedCondition => equations::WANTED_CONDITION,
        Code::WantedNumber => equations::WANTED_NUMBER,
        Code::UnknownUnit => units::UNKNOWN_UNIT,
        Code::UnitMismatch => units::UNIT_MISMATCH,
        Code::UnitArgument => units::UNIT_ARGUMENT,
        Code::UnitExponent => units::UNIT_EXPONENT,
        Code::NullMissing => effects::NULL_MISSING,
        Code::NotVanishing => effects::NOT_VANISHING,
        Code::NoRewrite => effects::NO_REWRITE,
        Code::Misfit => effects::MISFIT,
        Code::UnitUnknown => warnings::UNIT_UNKNOWN,
        Code::Unused => warnings::UNUSED,
        Code::NoInfluence => warnings::NO_INFLUENCE,
        Code::OwnRecord => warnings::OWN_RECORD,
    }
}

/// The code with this text, whatever its case.
pub fn code(text: &str) -> Option<Code> {
    Code::ALL.iter().copied().find(|c| c.text().eq_ignore_ascii_case(text.trim()))
}

impl Page {
    /// As it is printed: code and title, meaning, both examples, why.
    pub fn text(&self, code: Code) -> String {
        let indented = |text: &str| text.lines().map(|l| format!("    {l}\n")).collect::<String>();
        let broken = match self.broken {
            Example::Text(text) => indented(text.trim_end()),
            Example::Made { told, .. } => format!("    {told}\n"),
        };
        let (file, lag) = parts::LAG_FILE;
        let used = self.corrected.contains(file);
        let used = if used { format!("The file {file}:\n\n{}\n", indented(lag)) } else { String::new() };
        format!(
            "{}: {}\n\n{}\n\nA model with it:\n\n{broken}\nThe same without:\n\n{}\n{used}{}\n",
            code.text(),
            code.title(),
            wrapped(self.meaning),
            indented(self.corrected.trim_end()),
            wrapped(&format!("Why: {}", self.why))
        )
    }
}

/// A paragraph in lines of a width that every terminal has.
fn wrapped(text: &str) -> String {
    const WIDTH: usize = 96;
    let (mut out, mut column) = (String::new(), 0);
    for word in text.split_whitespace() {
        let length = word.chars().count();
        let fits = column == 0 || column + 1 + length <= WIDTH;
        if column > 0 {
            out.push(if fits { ' ' } else { '\n' });
        }
        column = if fits && column > 0 { column + 1 + length } else { length };
        out.push_str(word);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::code as named;
    use super::*;
    use crate::effect::Catalogue;
    use crate::expand::gather;
    use crate::{Diagnostic, Source, compile};

    fn findings(text: &str) -> Vec<Diagnostic> {
        if text.starts_with("effect") {
            return Catalogue::read(&Source::new("page.fdm", text)).1;
        }
        let mut source = Source::new("page.fdm", text);
        gather(&mut source, &mut |name| {
            let (file, lag) = parts::LAG_FILE;
            if name == file { Ok(lag.into()) } else { Err("there is no such file".into()) }
        });
        match compile(&source) {
            Ok(compiled) => compiled.warnings,
            Err(findings) => findings,
        }
    }

    #[test]
    fn examples_have_the_mistake_and_no_other_and_their_corrections_none() {
        for code in Code::ALL {
            let page = page(*code);
            let told =
                |found: Vec<Diagnostic>| found.iter().map(|d| (d.code.text(), d.message.clone())).collect::<Vec<_>>();
            let good = told(findings(page.corrected));
            assert!(good.is_empty(), "{}: the corrected example: {good:?}", code.text());
            let broken = match page.broken {
                Example::Text(text) => text.as_bytes().to_vec(),
                Example::Made { make, .. } => make(),
            };
            // what is no text never reaches the compiler
            let Ok(broken) = String::from_utf8(broken) else {
                assert_eq!(*code, Code::NotText);
                continue;
            };
            let found = told(findings(&broken));
            assert!(!found.is_empty(), "{}: the broken example is good", code.text());
            assert!(found.iter().all(|(c, _)| *c == code.text()), "{}: {found:?}", code.text());
        }
    }

    #[test]
    fn pages_are_sentences_of_bounded_width() {
        for code in Code::ALL {
            let page = page(*code);
            for text in [page.meaning, page.why] {
                assert!(text.ends_with(['.', ')']) && text.len() > 40, "{}: {text}", code.text());
            }
            let printed = page.text(*code);
            let longest = printed.lines().map(|l| l.chars().count()).max().unwrap_or(0);
            assert!(longest <= 100, "{}: a line of {longest} characters", code.text());
        }
        assert_eq!((named("e0201"), named("F012")), (Some(Code::UnknownName), None));
    }
}
