//! The pictures of docs/reference/page.md: pages in a browser, light and dark, on a desk and on a phone.
//!
//! Needs Chromium and writes docs/pictures; `cargo test -p fdm-tests --test pages pictures -- --ignored` makes them anew.
#![cfg(unix)]

use crate::browser::browser;
use crate::pixels::Pixels;
use std::fs;
use std::process::Command;
use support::Desk;

/// Results that pages are made from.
const RESULTS: [&str; 1] = ["fit models/lynx_hare/model.fdm --data models/lynx_hare/run.csv --out lynx"];
/// Name, and the command that makes the page.
const PAGES: [(&str, &str); 5] = [
    ("posterior", "sample lynx --chains 4 --draws 500 --warmup 300"),
    ("profile", "profile models/lynx_hare/model.fdm --data models/lynx_hare/run.csv"),
    ("fit", "fit models/trex550/coupled.fdm --data models/trex550/first_half.csv"),
    (
        "diagnosis",
        "diagnose models/ship_roll_decay/linear.fdm --data models/ship_roll_decay/run.csv --every 8 --only cubic_stiffness --only quadratic_damping",
    ),
    (
        "study",
        "study models/ship_roll_decay/model.fdm --data models/ship_roll_decay/run.csv --every 16 --repeats 100 --noise-colour fitted",
    ),
];
/// Name, width and height of the window, and pixels of the picture for each of its own.
const WINDOWS: [(&str, u32, u32, f32); 2] = [("desktop", 1280, 1900, 0.6), ("phone", 390, 1500, 0.8)];
/// The colour of the page.
const PAPERS: [(&str, [u8; 3]); 2] = [("light", [255, 255, 255]), ("dark", [0x14, 0x17, 0x1a])];
/// Bytes of all pictures together.
const MOST: u64 = 2_500_000;
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
fn pages_are_seen_light_and_dark_on_a_desk_and_on_a_phone() {
    let here = support::repository();
    let desk = Desk::new();
    // names of files on the pages are those of the documentation
    std::os::unix::fs::symlink(here.join("models"), desk.path("models")).unwrap();
    let run = |words: &str, more: &[&str]| {
        let mut command = support::fdm();
        let output = command.args(words.split(' ')).arg("-q").args(more).current_dir(desk.folder()).output().unwrap();
        assert!(matches!(output.status.code(), Some(0 | 1)), "{words}: {}", String::from_utf8_lossy(&output.stderr));
    };
    RESULTS.iter().for_each(|words| run(words, &[]));
    let mut sum = 0;
    for (name, words) in PAGES {
        run(words, &["--report", &format!("{name}.html")]);
        for (window, width, height, scale) in WINDOWS {
            for (theme, paper) in PAPERS {
                let picture = seen(&desk, name, theme, (width, height, scale));
                assert_eq!(picture.at(1, 1), paper, "{name} {window} {theme}");
                let inked = picture.all().filter(|p| *p != paper).count();
                let share = inked as f32 / (picture.width * picture.height) as f32;
                assert!(share > 0.05, "{name} {window} {theme}: {share} of it is not paper");
                let file = here.join(format!("docs/pictures/{name}_{window}_{theme}.png"));
                picture.write(&file);
                sum += fs::metadata(&file).unwrap().len();
            }
        }
    }
    assert!(sum < MOST, "{sum} bytes");
}
