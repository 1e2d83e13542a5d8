//! Options whose values are words: each with what it stands for, and what the help says of it.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};

/// Reads one of these words.
pub(crate) fn one_of<T: Clone + Send + Sync + 'static>(
    words: &'static [(&'static str, T, &'static str)],
) -> impl TypedValueParser<Value = T> {
    let known = words.iter().map(|(word, _, said)| PossibleValue::new(*word).help(*said));
    PossibleValuesParser::new(known).try_map(move |typed| {
        let found = words.iter().find(|(word, ..)| *word == typed);
        found.map(|(_, value, _)| value.clone()).ok_or("no such word")
    })
}

/// The word of a value.
pub(crate) fn word_of<T: PartialEq>(words: &[(&'static str, T, &'static str)], value: T) -> &'static str {
    words.iter().find(|(_, own, _)| *own == value).map_or("", |(word, ..)| word)
}
