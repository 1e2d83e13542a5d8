//! What a user is told about a mistake in a model: a code, a place, one sentence, a hint.
//!
//! **In** facts found by the parser and the checker. **Out** [`Diagnostic`], [`Code`] (THE table of codes).
//! **Never** renders: colours and carets belong to the command line, tokens to the macro.
//! **Start** at [`Diagnostic`].

use crate::source::{Source, Span};

/// Whether the model can be used in spite of the finding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// The model can not be compiled.
    Error,
    /// The model is compiled; the user should look.
    Warning,
}

macro_rules! codes {
    ($($name:ident $code:literal $title:literal;)*) => {
        /// The kinds of mistakes, each with a stable code that documentation and tests refer to.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub enum Code { $(#[doc = $title] $name,)* }

        impl Code {
            /// Every code, in the order of the table.
            pub const ALL: &'static [Code] = &[$(Code::$name,)*];

            /// The code as it is printed: `E` errors, `W` warnings, grouped by hundreds.
            pub fn text(self) -> &'static str {
                match self { $(Code::$name => $code,)* }
            }

            /// What this code stands for, in a few words.
            pub fn title(self) -> &'static str {
                match self { $(Code::$name => $title,)* }
            }

            /// The page about this code, as Markdown.
            pub(crate) fn markdown(self) -> &'static str {
                match self { $(Code::$name => include_str!(concat!("../explain/", $code, ".md")),)* }
            }
        }
    };
}

codes! {
    // text
    Unexpected      "E0101" "text that does not fit the grammar";
    TooDeep         "E0102" "nested deeper than the limit";
    TooLarge        "E0103" "a text, or its derivatives, larger than the limit";
    Unterminated    "E0104" "a string or bracket that is not closed";
    BadNumber       "E0105" "a number that cannot be represented";
    NotText         "E0106" "a file that is not UTF-8 text";
    // names
    UnknownName     "E0201" "a name that is not declared";
    DeclaredTwice   "E0202" "a name declared more than once";
    ReservedName    "E0203" "a name that the language uses itself";
    UnknownFunction "E0204" "a function that does not exist";
    ArgumentCount   "E0205" "a function called with the wrong number of arguments";
    Cycle           "E0206" "definitions that refer to each other in a circle";
    WrongName       "E0207" "a name of another kind than is needed there";
    // declarations
    MissingValue    "E0301" "a declaration without the value it needs";
    NeedlessValue   "E0302" "a declaration with a value it cannot have";
    BadBounds       "E0303" "bounds that are empty, reversed or not constant";
    OutsideBounds   "E0304" "a start value outside its bounds";
    NotConstant     "E0305" "a value that must not depend on time, states or inputs";
    WrongAttribute  "E0306" "an attribute that does not belong to this kind of declaration";
    // equations
    MissingEquation "E0401" "a state without an equation";
    TwoEquations    "E0402" "a state with more than one equation";
    NotADerivative  "E0403" "an equation whose left side is not der(state)";
    NoOutput        "E0404" "a model without outputs";
    Unsupported     "E0405" "something the language describes and this version does not compile yet";
    BadDelay        "E0406" "a delay that is negative or changes during the run";
    NotFinite       "E0407" "a value that is not finite";
    SingularRates   "E0408" "equations that do not determine the derivatives in them";
    NonlinearRate   "E0409" "an equation that is not linear in a derivative";
    BadTable        "E0410" "a table whose points are too few, not in order, or do not fit its axes";
    BadBlock        "E0411" "a block that cannot be built of states";
    BadReaction     "E0412" "reactions that make matter, or cannot be read as balances";
    // kinds of values
    WantedCondition "E0501" "a number where a condition is needed";
    WantedNumber    "E0502" "a condition where a number is needed";
    // units
    UnknownUnit     "E0601" "a unit that is not known";
    UnitMismatch    "E0602" "quantities of different units added, compared or equated";
    UnitArgument    "E0603" "a function applied to a quantity of the wrong unit";
    UnitExponent    "E0604" "an exponent that has a unit, or varies over a base that has one";
    // submodels, vectors and matrices
    NoFile          "E0801" "a submodel or a table whose file cannot be read";
    NotConnected    "E0802" "an input of a submodel that nothing is connected to";
    WrongShape      "E0803" "vectors and matrices whose shapes do not fit";
    OutsideShape    "E0804" "an index outside a vector or matrix";
    // effects
    NullMissing     "E0901" "a param of an effect without a null value, or nothing to try";
    NotVanishing    "E0902" "an effect that does not vanish at its null values";
    NoRewrite       "E0903" "an effect that changes nothing, or the same thing twice";
    Misfit          "E0904" "an effect that cannot be applied";
    // warnings
    UnitUnknown     "W0701" "an equation whose units cannot be checked";
    Unused          "W0702" "a declaration that nothing uses";
    NoInfluence     "W0703" "a parameter that no output depends on";
    OwnRecord       "W0704" "an output that contains its own record";
}

impl Code {
    /// Errors begin with `E`, warnings with `W`.
    pub fn severity(self) -> Severity {
        if self.text().starts_with('E') { Severity::Error } else { Severity::Warning }
    }
}

/// A second place that explains the first ("first declared here").
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Label {
    /// Where.
    pub span: Span,
    /// What is to be seen there.
    pub text: String,
}

/// One finding about a model's text.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Diagnostic {
    /// What kind of mistake.
    pub code: Code,
    /// Where it is.
    pub span: Span,
    /// One sentence in the user's words, without a full stop.
    pub message: String,
    /// Further places.
    pub labels: Vec<Label>,
    /// What would mend it; the nearest name or form.
    pub hint: Option<String>,
}

impl Diagnostic {
    /// A finding without labels and hint.
    pub fn new(code: Code, span: Span, message: impl Into<String>) -> Self {
        Self { code, span, message: message.into(), labels: Vec::new(), hint: None }
    }

    /// Adds what would mend it.
    #[must_use]
    pub fn hint(mut self, hint: impl Into<String>) -> Self {
        self.hint = Some(hint.into());
        self
    }

    /// Adds a second place.
    #[must_use]
    pub fn label(mut self, span: Span, text: impl Into<String>) -> Self {
        self.labels.push(Label { span, text: text.into() });
        self
    }

    /// The finding as it is told where everything stands `by` bytes later.
    #[must_use]
    pub fn moved(mut self, by: u32) -> Self {
        self.span = self.span.moved(by);
        self.labels.iter_mut().for_each(|l| l.span = l.span.moved(by));
        self
    }

    /// Errors stop the compilation, warnings do not.
    pub fn is_error(&self) -> bool {
        self.code.severity() == Severity::Error
    }

    /// One line: `name:line:column: error[E0201]: message; hint`.
    pub fn line(&self, source: &Source) -> String {
        let at = source.position(self.span.start);
        let kind = if self.is_error() { "error" } else { "warning" };
        let hint = self.hint.as_ref().map_or(String::new(), |h| format!("; {h}"));
        let code = self.code.text();
        let name = source.text_at(self.span.start).name();
        format!("{name}:{}:{}: {kind}[{code}]: {}{hint}", at.line, at.column, self.message)
    }
}

/// The candidate that is nearest to `name` as typed, when one is near enough to be meant.
pub fn nearest<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let lower = name.to_lowercase();
    // a third of the letters may differ; a single letter that differs is another name
    let near = |distance: usize, length: usize| distance <= ((length + 1) / 3).max(1) && distance < length;
    candidates
        .into_iter()
        .map(|c| (strsim::damerau_levenshtein(&lower, &c.to_lowercase()), c))
        .filter(|(distance, c)| near(*distance, name.chars().count().max(c.chars().count())))
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, c)| c)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_are_unique() {
        let mut texts: Vec<_> = Code::ALL.iter().map(|c| c.text()).collect();
        texts.sort_unstable();
        texts.dedup();
        assert_eq!(texts.len(), Code::ALL.len());
    }

    #[test]
    fn nearest_finds_slips_and_refuses_strangers() {
        assert_eq!(nearest("alhpa", ["beta", "alpha"]), Some("alpha"));
        assert_eq!(nearest("xyz", ["beta", "alpha"]), None);
        assert_eq!((nearest("Q", ["r", "q"]), nearest("w", ["u"])), (Some("q"), None));
        assert_eq!((nearest("TT", ["T"]), nearest("bias_alpha", ["Z_alpha"])), (Some("T"), None));
    }
}
