//! The pictures of docs/reference/page.md: pages in a browser, light and dark, on a desk and on a phone, and as they are printed.
//!
//! Needs Chromium and writes docs/pictures; `cargo test -p fdm-tests --test pages pictures -- --ignored` makes them anew. Whole pages, to be looked
//! at, also without a math font, are written to `target/pages` by `cargo test -p fdm-tests --test pages looked_at -- --ignored`.
#![cfg(unix)]

use crate::kinds::{PAGES, made};
use crate::pixels::Pixels;
use crate::window::{PAPERS, seen};
use std::fs;

/// Name, width and height of the window, and pixels of the picture for each of its own.
const WINDOWS: [(&str, u32, u32, f32); 2] = [("desktop", 1280, 1900, 0.5), ("phone", 390, 1300, 0.7)];
/// A sheet of A4 between its margins.
const SHEET: (u32, u32, f32) = (718, 1040, 0.6);
/// A window in which a whole diagnosis has room.
const WHOLE: (u32, u32, f32) = (1280, 9000, 0.5);
/// Bytes of all pictures together.
const MOST: u64 = 3_000_000;

#[test]
#[ignore = "needs Chromium, and writes docs/pictures"]
fn pages_are_seen_light_and_dark_on_a_desk_on_a_phone_and_on_paper() {
    let here = support::repository();
    let desk = made();
    let mut sum = 0;
    let mut drawn = |file: String, picture: &Pixels, paper: [u8; 3]| {
        // on a sheet, whose margins the printer makes, a title begins in the left corner
        assert_eq!(picture.at(picture.width - 2, 1), paper, "{file}");
        let inked = picture.all().filter(|p| *p != paper).count();
        let share = inked as f32 / (picture.width * picture.height) as f32;
        assert!(share > 0.03, "{file}: {share} of it is not paper");
        let file = here.join(format!("docs/pictures/{file}.png"));
        picture.write(&file);
        sum += fs::metadata(&file).unwrap().len();
    };
    for (name, _) in PAGES {
        for (window, width, height, scale) in WINDOWS {
            for (theme, paper) in PAPERS {
                let picture = seen(&desk, name, theme, (width, height, scale));
                drawn(format!("{name}_{window}_{theme}"), &picture, paper);
            }
        }
        // what is for paper only, on a screen as wide as the sheet
        let page = desk.text(&format!("{name}.html"));
        assert_eq!(page.matches("@media print").count(), 1);
        desk.write("sheet.html", page.replace("@media print", "@media all"));
        drawn(format!("{name}_print"), &seen(&desk, "sheet", "light", SHEET), PAPERS[0].1);
    }
    let (light, paper) = PAPERS[0];
    let whole = seen(&desk, "diagnosis", light, WHOLE).to_the_end(paper);
    drawn("diagnosis_whole".into(), &whole, paper);
    assert!(sum < MOST, "{sum} bytes");
}

/// Windows in which whole pages have room, and the pixels of a picture for each of its own: on a desk, a phone, a sheet.
const LOOKED_AT: [(&str, (u32, u32, f32)); 3] =
    [("desktop", (1280, 12_000, 0.7)), ("phone", (390, 14_000, 0.8)), ("sheet", (718, 12_000, 0.9))];

#[test]
#[ignore = "needs Chromium, and writes target/pages"]
fn whole_pages_to_be_looked_at() {
    let folder = support::repository().join("target/pages");
    fs::create_dir_all(&folder).unwrap();
    let desk = made();
    for (name, _) in PAGES {
        let page = desk.text(&format!("{name}.html"));
        desk.write("sheet.html", page.replace("@media print", "@media all"));
        let fonts = page.split_once(".equations math {").unwrap().1.split_once("font-family: ").unwrap().1;
        let fonts = fonts.split_once("\"fdm mathematics\"").unwrap().0;
        desk.write("without.html", page.replace(fonts, ""));
        let drawn = |of: &str, (theme, paper), window: &str, size| {
            let file = folder.join(format!("{name}_{window}_{theme}.png"));
            seen(&desk, of, theme, size).to_the_end(paper).write(&file);
        };
        let [(_, desktop), (_, phone), (_, sheet)] = LOOKED_AT;
        for paper in PAPERS {
            drawn(name, paper, "desktop", desktop);
            drawn(name, paper, "phone", phone);
        }
        drawn("sheet", PAPERS[0], "sheet", sheet);
        drawn("without", PAPERS[0], "without_math_font", desktop);
    }
    println!("{}", folder.display());
}
