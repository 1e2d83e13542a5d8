//! The words that the language uses itself: one table for the scanner, the checker and the hints.

/// What a word of the language is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WordUse {
    /// Begins a statement: `model`, `time`, `prior`, `noise`, `trim`, `tie`, `table`, `use`, `reactions` and the kinds of declarations.
    Statement,
    /// Begins a statement that the language describes and this version does not compile.
    Planned,
    /// Stands behind a declared name: `in`, `fixed`, `per run`, `free`.
    Attribute,
    /// Stands in expressions: `if`, `then`, `else`, `and`, `or`, `not`.
    Expression,
    /// A value that is always there: `t`, `pi`, `inf`. Can be read, not declared.
    Value,
}

macro_rules! words {
    ($($word:literal $purpose:ident;)*) => {
        /// Every reserved word with its use.
        pub const WORDS: &[(&str, WordUse)] = &[$(($word, WordUse::$purpose),)*];

        /// The use of a reserved word; `None` for a word that users may declare.
        pub fn word_use(word: &str) -> Option<WordUse> {
            match word { $($word => Some(WordUse::$purpose),)* _ => None }
        }
    };
}

words! {
    "model"  Statement;
    "input"  Statement;
    "state"  Statement;
    "param"  Statement;
    "const"  Statement;
    "let"    Statement;
    "output" Statement;
    "time"   Statement;
    "prior"  Statement;
    "noise"  Statement;
    "trim"   Statement;
    "tie"    Statement;
    "table"  Statement;
    "use"    Statement;
    "reactions" Statement;
    "effect" Planned;
    "in"     Attribute;
    "fixed"  Attribute;
    "per"    Attribute;
    "run"    Attribute;
    "free"   Attribute;
    "if"     Expression;
    "then"   Expression;
    "else"   Expression;
    "and"    Expression;
    "or"     Expression;
    "not"    Expression;
    "t"      Value;
    "pi"     Value;
    "inf"    Value;
}

/// The reserved words with one of these uses, in the order of the table.
pub fn words_for(uses: &[WordUse]) -> impl Iterator<Item = &'static str> {
    WORDS.iter().filter(|(_, purpose)| uses.contains(purpose)).map(|(word, _)| *word)
}

/// Whether the word is part of the grammar and therefore never a name.
pub(super) fn is_keyword(word: &str) -> bool {
    !matches!(word_use(word), None | Some(WordUse::Value))
}
