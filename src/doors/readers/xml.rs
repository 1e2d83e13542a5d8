//! XML that a parser can read in time: parsers compare each attribute with all before it in its element.

/// Most attributes of one element. Formats that are read here have some twenty; up to so many the comparisons cost less than the reading.
pub const MOST_ATTRIBUTES: usize = 256;

/// Refuses XML with an element of more than [`MOST_ATTRIBUTES`], before it is parsed; anything else that is wrong is left to the parser.
///
/// # Errors
/// A sentence about the first such element, to stand behind a name.
pub fn refuse_endless_xml(xml: &[u8]) -> Result<(), String> {
    let mut at = 0;
    while let Some(begin) = position(xml, at, b"<") {
        let rest = &xml[begin..];
        // what looks like attributes there is none
        let closed = [(&b"<!--"[..], &b"-->"[..]), (b"<![CDATA[", b"]]>"), (b"<?", b"?>")];
        at = match closed.iter().find(|(open, _)| rest.starts_with(open)) {
            Some((open, close)) => position(xml, begin + open.len(), close).map_or(xml.len(), |end| end + close.len()),
            None => behind_element(xml, begin + 1)?,
        };
    }
    Ok(())
}

fn position(xml: &[u8], from: usize, wanted: &[u8]) -> Option<usize> {
    xml.get(from..)?.windows(wanted.len()).position(|part| part == wanted).map(|at| from + at)
}

/// The place behind the tag that begins before `from`.
fn behind_element(xml: &[u8], from: usize) -> Result<usize, String> {
    let (mut quote, mut attributes) = (None, 0);
    for (k, byte) in xml.iter().enumerate().skip(from) {
        match (byte, quote) {
            (b'>', None) => return Ok(k + 1),
            (b'"' | b'\'', None) => quote = Some(byte),
            (b'=', None) => {
                attributes += 1;
                if attributes > MOST_ATTRIBUTES {
                    return Err(format!("an element has more than {MOST_ATTRIBUTES} attributes"));
                }
            }
            (end, Some(begun)) if end == begun => quote = None,
            _ => {}
        }
    }
    Ok(xml.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn elements_of_endless_attributes_are_refused() {
        let many: String = (0..200_000).map(|k| format!(" a{k}='1'")).collect();
        for before in ["", "<!-- it's -->", "<![CDATA[ ' ]]>", "<?xml version='1.0'?>", "<b c='>\"'/>"] {
            let refused = refuse_endless_xml(format!("{before}<a{many}/>").as_bytes());
            assert!(refused.is_err_and(|said| said.contains("256 attributes")), "{before}");
        }
        let usual: String = (0..2_000).map(|k| format!("<b k='{k}' text='a = b > c'/>it's")).collect();
        let signs = "=".repeat(400);
        for good in
            [format!("<a>{usual} x = 1</a>"), format!("<!-- {signs} --><a t=\"{signs}\">{signs}</a>"), "<a".into()]
        {
            assert_eq!(refuse_endless_xml(good.as_bytes()), Ok(()));
        }
    }
}
