//! A drawing as pixels. The letters come with the program, so that a picture has the same bytes on every machine.

use epaint_default_fonts::{HACK_REGULAR, UBUNTU_LIGHT};
use resvg::tiny_skia::{Pixmap, Transform};
use resvg::usvg::{Options, Tree, fontdb};
use std::sync::Arc;

/// Most pixels of a side.
const MOST: f32 = 20_000.0;

/// Why there is no picture.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum RasterError {
    /// It would be larger than anybody looks at.
    #[error(
        "a picture {width} pixels wide would be {height} high, and no side may have more than {MOST}: give a smaller width"
    )]
    TooLarge {
        /// Pixels across.
        width: u32,
        /// Pixels down.
        height: u32,
    },
    /// The drawing could not be read or written.
    #[error("the picture cannot be drawn: {0}")]
    Undrawn(String),
}

/// PNG of an SVG, `width` pixels wide and as high as the drawing's shape asks.
///
/// # Errors
/// [`RasterError`].
pub(crate) fn png(svg: &str, width: u32) -> Result<Vec<u8>, RasterError> {
    let undrawn = |e: String| RasterError::Undrawn(e);
    let mut fonts = fontdb::Database::new();
    fonts.load_font_data(UBUNTU_LIGHT.to_vec());
    // signs that the first has not
    fonts.load_font_data(HACK_REGULAR.to_vec());
    fonts.set_sans_serif_family("Ubuntu");
    let options = Options { fontdb: Arc::new(fonts), font_family: "Ubuntu".into(), ..Options::default() };
    let tree = Tree::from_str(svg, &options).map_err(|e| undrawn(e.to_string()))?;
    let scale = width as f32 / tree.size().width();
    let height = (tree.size().height() * scale).round().max(1.0);
    if width as f32 > MOST || height > MOST {
        return Err(RasterError::TooLarge { width, height: height as u32 });
    }
    let mut pixels =
        Pixmap::new(width, height as u32).ok_or_else(|| undrawn("a picture needs at least one pixel".into()))?;
    resvg::render(&tree, Transform::from_scale(scale, scale), &mut pixels.as_mut());
    pixels.encode_png().map(signed).map_err(|e| undrawn(e.to_string()))
}

/// The picture with the chunk that names the program behind its head, by which the program finds later that it wrote the file.
fn signed(mut picture: Vec<u8>) -> Vec<u8> {
    /// Signature (8 bytes), and the chunk IHDR: length, name, 13 bytes, checksum.
    const HEAD: usize = 33;
    /// Length, name and keyword, text, checksum (PNG, third edition, 11.3.3.2).
    const SOFTWARE: [&[u8]; 4] = [b"\0\0\0\x0c", b"tEXtSoftware\0", b"fdm", &0x6b543193_u32.to_be_bytes()];
    if picture.len() >= HEAD {
        picture.splice(HEAD..HEAD, SOFTWARE.concat());
    }
    picture
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drawn(inside: &str) -> Pixmap {
        let svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 100 40\" width=\"100\" height=\"40\" font-family=\"sans-serif\"><rect width=\"100\" height=\"40\" fill=\"#fff\"/>{inside}</svg>"
        );
        Pixmap::decode_png(&png(&svg, 300).unwrap()).unwrap()
    }

    fn dark(pixels: &Pixmap) -> usize {
        pixels.pixels().iter().filter(|p| p.red() < 128).count()
    }

    #[test]
    fn letters_are_drawn_and_signs_of_both_fonts() {
        let empty = drawn("");
        assert_eq!((empty.width(), empty.height(), dark(&empty)), (300, 120, 0));
        // letters, Greek, signs of mathematics, an arrow that the first font lacks
        let text = |t: &str| dark(&drawn(&format!("<text x=\"5\" y=\"25\" font-size=\"20\">{t}</text>")));
        for sign in ["a", "α", "σ", "−", "±", "²", "°", "∠", "≤"] {
            assert!(text(sign) > 20, "{sign}: {}", text(sign));
        }
        assert!(text("Model") > 2 * text("i"));
        assert!(png("no drawing", 100).is_err());
        let tall =
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"1\" height=\"1000\"><path d=\"M0 0h1v1z\"/></svg>";
        assert_eq!(png(tall, 50), Err(RasterError::TooLarge { width: 50, height: 50_000 }));
    }
}
