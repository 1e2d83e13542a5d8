//! Text that does nothing to a terminal but appear on it: whatever a model, a record or a file is called.

use std::borrow::Cow;

/// The text with every character that would move the cursor, change colours or the direction of writing shown as `\u001b` and the
/// like. Ends of lines and tabs stay. In JSON these are escapes, so that its meaning stays.
pub fn visible(text: &str) -> Cow<'_, str> {
    if !text.chars().any(acts) {
        return text.into();
    }
    let mut shown = String::with_capacity(text.len());
    let mut characters = text.chars().peekable();
    while let Some(c) = characters.next() {
        let ends_line = c == '\r' && characters.peek() == Some(&'\n');
        match acts(c) && !ends_line {
            true => shown.push_str(&format!("\\u{:04x}", u32::from(c))),
            false => shown.push(c),
        }
    }
    shown.into()
}

/// Control characters of both sets (ISO 6429), separators of lines, and what changes the direction of writing (Unicode, UAX 9).
fn acts(c: char) -> bool {
    let turns = matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    c.is_control() && !matches!(c, '\n' | '\t') || turns || matches!(c, '\u{2028}' | '\u{2029}')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_acts_is_shown_and_the_rest_stays() {
        assert_eq!(visible("α = 3 °C\n\tend\r\n"), "α = 3 °C\n\tend\r\n");
        let hostile = "\u{1b}[2J \u{9b}8m \u{7} \u{202e}evil \r gone \u{8}\u{7f}\u{2028}";
        let shown = "\\u001b[2J \\u009b8m \\u0007 \\u202eevil \\u000d gone \\u0008\\u007f\\u2028";
        assert_eq!(visible(hostile), shown);
        assert!(matches!(visible("plain"), Cow::Borrowed("plain")));
    }
}
