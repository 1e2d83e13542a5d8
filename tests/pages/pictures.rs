//! The pictures of docs/reference/page.md: pages in a browser, light and dark, on a desk and on a phone, and as they are printed.
//!
//! Needs Chromium and writes docs/pictures; `cargo test -p fdm-tests --test pages pictures -- --ignored` makes them anew.
#![cfg(unix)]

use crate::browser::browser;
use crate::kinds::{PAGES, made};
use crate::pixels::Pixels;
use std::fs;
use std::process::Command;
use support::Desk;

/// Name, width and height of the window, and pixels of the picture for each of its own.
const WINDOWS: [(&str, u32, u32, f32); 2] = [("desktop", 1280, 1900, 0.5), ("phone", 390, 1300, 0.7)];
/// A sheet of A4 between its margins.
const SHEET: (u32, u32, f32) = (718, 1040, 0.6);
/// The colour of the page.
const PAPERS: [(&str, [u8; 3]); 2] = [("light", [255, 255, 255]), ("dark", [0x14, 0x17, 0x1a])];
/// Bytes of all pictures together.
const MOST: u64 = 3_000_000;
/// The page in a window that no browser makes so narrow. This document is loaded, and seen, when the figures in view are drawn.
const HARNESS: &str = "<!doctype html><meta charset=\"utf-8\"><style>body { margin: 0; } iframe { border: 0; display: block; }</style>
<iframe id=\"page\" src=\"PAGE.html\" width=\"WIDTH\" height=\"HEIGHT\"></iframe><iframe id=\"hold\" hidden></iframe>
<script>
const hold = document.getElementById(\"hold\").contentDocument;
hold.open();
const frame = document.getElementById(\"page\");
frame.addEventListener(\"load\", async () => {
  const page = frame.contentDocument;
  page.documentElement.dataset.theme = \"THEME\";
  const seen = () => [...page.querySelectorAll(\"figure.plot svg\")].filter((s) => s.getBoundingClientRect().top < HEIGHT && s.checkVisibility());
  for (let k = 0; k < 200 && seen().some((s) => s.dataset.low === undefined); k++) await new Promise((done) => setTimeout(done, 50));
  await new Promise((done) => setTimeout(done, 300));
  hold.close();
});
</script>";

/// The page as it is seen, so many pixels for each of its own.
fn seen(desk: &Desk, page: &str, theme: &str, (width, height, scale): (u32, u32, f32)) -> Pixels {
    let text = HARNESS
        .replace("PAGE", page)
        .replace("THEME", theme)
        .replace("WIDTH", &width.to_string())
        .replace("HEIGHT", &height.to_string());
    let (harness, picture) = (desk.path("harness.html"), desk.path("seen.png"));
    fs::write(&harness, text).unwrap();
    let profile = tempfile::tempdir().unwrap();
    let output = Command::new(browser())
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--allow-file-access-from-files", "--hide-scrollbars"])
        .arg("--timeout=60000")
        .arg(format!("--force-device-scale-factor={scale}"))
        .arg(format!("--window-size={},{}", width.max(700), height + 200))
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .arg(format!("--screenshot={}", picture.display()))
        .arg(format!("file://{}", harness.display()))
        .output()
        .unwrap();
    assert!(picture.is_file(), "{}", String::from_utf8_lossy(&output.stderr));
    let side = |v: u32| (v as f32 * scale) as usize;
    Pixels::read(&picture).cut(side(width), side(height))
}

#[test]
#[ignore = "needs Chromium, and writes docs/pictures"]
fn pages_are_seen_light_and_dark_on_a_desk_on_a_phone_and_on_paper() {
    let here = support::repository();
    let desk = made();
    let mut sum = 0;
    let mut drawn = |file: String, picture: &Pixels, paper: [u8; 3]| {
        assert_eq!(picture.at(1, 1), paper, "{file}");
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
    assert!(sum < MOST, "{sum} bytes");
}
