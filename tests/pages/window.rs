//! A page as it is seen in a browser.

use crate::browser::browser;
use crate::pixels::Pixels;
use std::fs;
use std::process::Command;
use support::Desk;

/// The colour of the page.
pub(crate) const PAPERS: [(&str, [u8; 3]); 2] = [("light", [255, 255, 255]), ("dark", [0x14, 0x17, 0x1a])];
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
pub(crate) fn seen(desk: &Desk, page: &str, theme: &str, (width, height, scale): (u32, u32, f32)) -> Pixels {
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
