//! Pictures as pixels.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

/// Red, green and blue of every pixel, row by row.
pub(crate) struct Pixels {
    pub(crate) width: usize,
    pub(crate) height: usize,
    colours: Vec<[u8; 3]>,
}

impl Pixels {
    /// Of a PNG file with eight bits a channel.
    pub(crate) fn read(path: &Path) -> Self {
        let file = File::open(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        let mut reader = png::Decoder::new(BufReader::new(file)).read_info().unwrap();
        let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut bytes).unwrap();
        let channels = info.color_type.samples();
        assert!(channels >= 3 && info.bit_depth == png::BitDepth::Eight, "{:?}", info.color_type);
        let colours = bytes[..info.buffer_size()].chunks_exact(channels).map(|c| [c[0], c[1], c[2]]).collect();
        Self { width: info.width as usize, height: info.height as usize, colours }
    }

    pub(crate) fn at(&self, x: usize, y: usize) -> [u8; 3] {
        self.colours[y * self.width + x]
    }

    pub(crate) fn all(&self) -> impl Iterator<Item = [u8; 3]> {
        self.colours.iter().copied()
    }

    /// The upper left corner.
    pub(crate) fn cut(&self, width: usize, height: usize) -> Self {
        let rows = self.colours.chunks_exact(self.width).take(height);
        Self { width, height, colours: rows.flat_map(|row| row[..width].iter().copied()).collect() }
    }

    /// Without the paper below the last ink.
    pub(crate) fn to_the_end(&self, paper: [u8; 3]) -> Self {
        let rows = self.colours.chunks_exact(self.width);
        let last = rows.rev().position(|row| row.iter().any(|p| *p != paper)).unwrap_or(0);
        self.cut(self.width, self.height - last)
    }

    /// As a PNG file of the 256 colours that are seen most, each pixel the nearest of them.
    pub(crate) fn write(&self, path: &Path) {
        let mut seen: BTreeMap<[u8; 3], usize> = BTreeMap::new();
        self.colours.iter().for_each(|c| *seen.entry(*c).or_default() += 1);
        let mut palette: Vec<([u8; 3], usize)> = seen.iter().map(|(c, n)| (*c, *n)).collect();
        palette.sort_by_key(|(colour, count)| (std::cmp::Reverse(*count), *colour));
        palette.truncate(256);
        let off = |a: [u8; 3], b: [u8; 3]| a.iter().zip(b).map(|(a, b)| u32::from(a.abs_diff(b)).pow(2)).sum::<u32>();
        let nearest = |c: &[u8; 3]| (0..palette.len()).min_by_key(|k| off(palette[*k].0, *c)).unwrap_or(0) as u8;
        let places: BTreeMap<[u8; 3], u8> = seen.keys().map(|c| (*c, nearest(c))).collect();
        let mut encoder = png::Encoder::new(File::create(path).unwrap(), self.width as u32, self.height as u32);
        encoder.set_color(png::ColorType::Indexed);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_palette(palette.iter().flat_map(|(c, _)| *c).collect::<Vec<u8>>());
        encoder.set_compression(png::Compression::High);
        let bytes: Vec<u8> = self.colours.iter().map(|c| places[c]).collect();
        encoder.write_header().unwrap().write_image_data(&bytes).unwrap();
    }
}
