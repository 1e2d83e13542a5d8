//! Places in UTF-16 units.

use super::place::Lines;
use lsp_types::Position;

#[test]
fn columns_count_utf16_units() {
    let text = "a𝛼β\r\nc\rd\n";
    let lines = Lines::new(text);
    let position = |offset| {
        let p = lines.position(text, offset);
        (p.line, p.character)
    };
    assert_eq!([0, 1, 5, 7].map(position), [(0, 0), (0, 1), (0, 3), (0, 4)]);
    assert_eq!([9, 10, 11, 12, 13, 99].map(position), [(1, 0), (1, 1), (2, 0), (2, 1), (3, 0), (3, 0)]);
    let offset = |line, character| lines.offset(text, Position::new(line, character));
    assert_eq!([offset(0, 0), offset(0, 1), offset(0, 3), offset(0, 4), offset(0, 9)], [0, 1, 5, 7, 7]);
    // inside a pair of surrogates: behind it
    assert_eq!((offset(0, 2), offset(1, 7), offset(2, 0), offset(9, 9)), (5, 10, 11, 13));
}
