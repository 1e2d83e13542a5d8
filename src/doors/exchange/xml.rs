//! XML for people: a line for each element.

/// Breaks the lines of markup between elements; an element of nothing stays one.
pub(crate) fn lines(markup: &str) -> String {
    let (mut text, mut before) = (String::with_capacity(markup.len() + markup.len() / 16), "");
    for (k, part) in markup.split("><").enumerate() {
        let name = before.trim_start_matches('<').split([' ', '>']).next();
        let empty = part.strip_prefix('/').is_some_and(|end| end.split('>').next() == name && !before.contains('>'));
        text += if k == 0 {
            ""
        } else if empty {
            "><"
        } else {
            ">\n<"
        };
        text += part;
        before = part;
    }
    text
}

#[cfg(test)]
mod tests {
    #[test]
    fn what_is_empty_stays_empty() {
        let text = super::lines("<a><b k=\"1\"></b><c>1</c><d></d></a>");
        assert_eq!(text, "<a>\n<b k=\"1\"></b>\n<c>1</c>\n<d></d>\n</a>");
    }
}
