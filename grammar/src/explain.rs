//! One page for each code of a message: what it means, a model that has the mistake, one without it, and why.
//!
//! **In** a [`Code`]. **Out** its page, from Markdown beside this package (`explain/E0201.md`). **Never** a code without a page: the table of
//! codes names each, and the tests compile every example. **Start** at [`page`].

use crate::diagnostic::Code;

/// What is to be known about a kind of mistake: paragraphs and examples of a file of Markdown.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
struct Page<'p> {
    /// What the message means, then why the language has this rule.
    paragraphs: Vec<&'p str>,
    /// Text between fences, and what is written beside the first: `fdm broken`, `fdm`, `fdm FILE` for what the others use, `text` for
    /// what is too long to be shown, or no text at all.
    examples: Vec<(&'p str, &'p str)>,
}

impl<'p> Page<'p> {
    fn of(code: Code) -> Page<'static> {
        Page::read(code.markdown())
    }

    fn read(markdown: &'p str) -> Self {
        let mut page = Self::default();
        for (k, part) in markdown.split("```").enumerate() {
            match part.split_once('\n').filter(|_| k % 2 == 1) {
                Some((kind, text)) => page.examples.push((kind, text)),
                None => page.paragraphs.extend(part.split("\n\n").map(str::trim).filter(|p| !p.is_empty())),
            }
        }
        page
    }
}

/// The page of a code as it is printed: code and title, meaning, examples, why.
pub fn page(code: Code) -> String {
    let Page { paragraphs, examples } = Page::of(code);
    let mut out = format!("{}: {}\n", code.text(), code.title());
    let (meaning, why) = paragraphs.split_at(1);
    meaning.iter().for_each(|p| out += &format!("\n{p}\n"));
    for (kind, text) in examples {
        let heading = match kind.strip_prefix("fdm") {
            Some("") => "The same without:".into(),
            Some(file) if file.ends_with(".fdm") => format!("The file{file}:"),
            _ => "A model with it:".into(),
        };
        let indented: String = text.lines().map(|l| format!("    {l}\n")).collect();
        out += &format!("\n{heading}\n\n{indented}");
    }
    why.iter().for_each(|p| out += &format!("\n{p}\n"));
    out
}

/// The code with this text, whatever its case.
pub fn code(text: &str) -> Option<Code> {
    Code::ALL.iter().copied().find(|c| c.text().eq_ignore_ascii_case(text.trim()))
}

#[cfg(test)]
mod tests {
    use super::code as named;
    use super::*;
    use crate::expand::gather;
    use crate::{Diagnostic, Source, compile};

    /// What is too long to be shown.
    fn made(code: Code) -> String {
        match code {
            Code::TooDeep => {
                let (open, close) = ("(".repeat(300), ")".repeat(300));
                format!("model m {{ state x = 1; der(x) = {open}x{close}; output y = x; }}")
            }
            Code::TooLarge => {
                format!("model m {{ state x = 1; der(x) = {}x; output y = x; }}", "x + ".repeat(2_000_000))
            }
            Code::Unsupported => {
                let mut text = String::from("model echo { input u; state x = 1; param tau = 0.5; let e0 = u;");
                for k in 0..12 {
                    let term = |n: usize| format!("delay(e{k}, {}*tau)", n * 3usize.pow(k));
                    text += &format!("let e{} = {} + {} + {};", k + 1, term(1), term(2), term(3));
                }
                text + "der(x) = e12 - x; output y = x; }"
            }
            _ => panic!("{} has no example", code.text()),
        }
    }

    fn findings(text: &str, page: &Page<'_>) -> Vec<Diagnostic> {
        let mut source = Source::new("page.fdm", text);
        gather(&mut source, &mut |name| {
            let file = page.examples.iter().find(|(kind, _)| kind.strip_prefix("fdm ") == Some(name));
            file.map(|(_, text)| (*text).into()).ok_or_else(|| "there is no such file".into())
        });
        match compile(&source) {
            Ok(compiled) => compiled.warnings,
            Err(findings) => findings,
        }
    }

    #[test]
    fn examples_have_the_mistake_and_no_other_and_their_corrections_none() {
        for code in Code::ALL {
            let page = Page::of(*code);
            let told = |text: &str| {
                let found = findings(text, &page);
                found.iter().map(|d| (d.code.text(), d.message.clone())).collect::<Vec<_>>()
            };
            let example = |of: &str| page.examples.iter().find(|(kind, _)| *kind == of).map(|(_, text)| *text);
            let corrected = example("fdm").unwrap_or_else(|| panic!("{}: no corrected example", code.text()));
            // these are read by the package of effects, which tests them
            if corrected.starts_with("effect") {
                continue;
            }
            let good = told(corrected);
            assert!(good.is_empty(), "{}: the corrected example: {good:?}", code.text());
            // what is no text never reaches the compiler
            if *code == Code::NotText {
                continue;
            }
            let found = match example("fdm broken") {
                Some(text) => told(text),
                None => told(&made(*code)),
            };
            assert!(!found.is_empty(), "{}: the broken example is good", code.text());
            assert!(found.iter().all(|(c, _)| *c == code.text()), "{}: {found:?}", code.text());
        }
    }

    #[test]
    fn pages_are_sentences_of_bounded_width() {
        for code in Code::ALL {
            let page = Page::of(*code);
            assert_eq!(page.paragraphs.len(), 2, "{}", code.text());
            for text in page.paragraphs {
                assert!(text.ends_with(['.', ')']) && text.len() > 40, "{}: {text}", code.text());
            }
            let printed = super::page(*code);
            let longest = printed.lines().map(|l| l.chars().count()).max().unwrap_or(0);
            assert!(longest <= 100, "{}: a line of {longest} characters", code.text());
        }
        assert_eq!((named("e0201"), named("F012")), (Some(Code::UnknownName), None));
    }
}
