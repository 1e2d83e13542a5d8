//! The page of a result in a browser: figures that zoom and tell values, no mistakes, no requests, whatever names say.
//!
//! Needs Chromium and is left out by `cargo test`; `cargo test -p fdm-tests --test pages -- --ignored` runs it.

use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};
use support::Desk;
use support::command::said;

const HARNESS: &str = include_str!("harness.html");
const MODEL: &str = "model hostile \"</script><script>window.hacked = 1</script> & <b>bold</b>\" {
  input u \"<img src=x onerror=hacked()>\";
  state x \"<svg onload=hacked()>\" = free;
  param k = 1 in [0, 50] [1/s] \"' onmouseover='hacked()\", g = 1 in [-10, 10];
  param bias = 0 per run;
  der(x) = -k*x + g*u;
  output y \"it is 5 > 3 & 2 < 4\" = x + bias;
}
";

/// The browser, or a sentence that says how to get one.
pub(crate) fn browser() -> PathBuf {
    let named = std::env::var_os("FDM_CHROMIUM").map(PathBuf::from);
    let names = ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable"];
    let places = std::env::var_os("PATH").map(|p| std::env::split_paths(&p).collect::<Vec<_>>()).unwrap_or_default();
    let mut all = places.iter().flat_map(|p| names.iter().map(|n| p.join(n)));
    named.or_else(|| all.find(|p| p.is_file())).expect(
        "these tests need Chromium: `apt-get install -y --no-install-recommends chromium`, or the path of a browser of that family in FDM_CHROMIUM",
    )
}

/// Runs the program; 1 is a good end too, where numbers were to go wrong.
fn fdm(desk: &Desk, words: &[&str]) {
    let output = desk.command_of(words).output().unwrap();
    assert!(matches!(output.status.code(), Some(0 | 1)), "{words:?}: {}", said(&output));
}

/// What the steps say of `report.html`, and what the browser complained of.
fn look(desk: &Desk, size: (u32, u32), steps: &str) -> (Value, String) {
    look_at(desk, "report", size, steps)
}

/// The same of another page.
fn look_at(desk: &Desk, page: &str, size: (u32, u32), steps: &str) -> (Value, String) {
    let text = HARNESS.replace("report.html", &format!("{page}.html"));
    let text =
        text.replace("WIDTH", &size.0.to_string()).replace("HEIGHT", &size.1.to_string()).replace("STEPS", steps);
    desk.write("harness.html", text);
    let profile = tempfile::tempdir().unwrap();
    let output = Command::new(browser())
        .args([
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--allow-file-access-from-files",
            "--enable-logging=stderr",
        ])
        .args(["--timeout=60000", "--dump-dom"])
        .arg(format!("--window-size={},{}", size.0.max(500), size.1 + 50))
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .arg(format!("file://{}", desk.path("harness.html").display()))
        .output()
        .unwrap();
    let dom = String::from_utf8_lossy(&output.stdout).into_owned();
    let said = dom.split("<pre id=\"verdict\">").nth(1).and_then(|t| t.split("</pre>").next()).unwrap_or_default();
    let said = said.replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&");
    let errors = String::from_utf8_lossy(&output.stderr);
    let console: Vec<&str> = errors.lines().filter(|l| l.contains("CONSOLE")).collect();
    let value = serde_json::from_str(&said).unwrap_or_else(|_| panic!("no verdict in {dom:.2000}\n{errors:.2000}"));
    (value, console.join("\n"))
}

/// x' = -2 x + 3 u with a square wave, exactly, and a ripple.
fn record(samples: u32) -> String {
    let (k, g, dt) = (2.0_f64, 3.0, 0.02);
    let mut x: f64 = 0.7;
    let mut rows = String::from("t [s],u,y\n");
    for n in 0..samples {
        let u = if (0.041 * f64::from(n)).sin() > 0.0 { 1.0 } else { -1.0 };
        let ripple = 0.02 * (f64::from(n) * f64::from(n) * 0.7).sin();
        rows.push_str(&format!("{:.2},{u},{:.6}\n", dt * f64::from(n), x + 0.3 + ripple));
        x = (x - g / k * u) * (-k * dt).exp() + g / k * u;
    }
    rows
}

/// A fit of a model whose words try to break out of the page, to a record whose name does.
fn hostile(samples: u32) -> Desk {
    let desk = Desk::new();
    desk.write("model.fdm", MODEL);
    let name = "<script>hacked()\n\"'&lt;.csv";
    desk.write(name, record(samples));
    fdm(&desk, &["fit", "model.fdm", "--data", name, "--zoh", "u", "-q", "--report", "report.html", "--out", "result"]);
    desk
}

/// What no page may do.
const HARM: &str = "return {
  hacked: view.hacked ?? null,
  scripts: page.querySelectorAll('script:not([type])').length,
  images: page.querySelectorAll('img, iframe, object, embed').length,
  handlers: [...page.querySelectorAll('*')].filter((e) => [...e.attributes].some((a) => a.name.startsWith('on'))).length,
  requests: view.performance.getEntriesByType('resource').map((e) => e.name).filter((n) => !n.startsWith('data:')),
  title: page.title, heads: [...page.querySelectorAll('summary')].map((s) => s.textContent), doc: page.querySelector('header .doc').textContent,
};";

#[test]
#[ignore = "needs Chromium"]
fn whatever_names_say_is_text_and_nothing_is_asked_of_a_network() {
    let desk = hostile(400);
    let (found, console) = look(&desk, (1280, 900), HARM);
    assert_eq!(console, "", "the browser complained");
    assert_eq!((&found["hacked"], &found["requests"]), (&Value::Null, &json!([])), "{found}");
    assert_eq!((&found["scripts"], &found["images"], &found["handlers"]), (&json!(1), &json!(0), &json!(0)), "{found}");
    assert!(found["doc"].as_str().unwrap().contains("<script>window.hacked = 1</script>"), "{found}");
    let heads = found["heads"].as_array().unwrap();
    assert!(heads.iter().any(|h| h.as_str().unwrap().contains("<script>hacked()\n\"'&lt;")), "{found}");
}

#[test]
#[ignore = "needs Chromium"]
fn dragging_zooms_all_axes_of_a_run_and_a_double_click_resets() {
    let (found, console) = look(&hostile(400),
        (1280, 900),
        "const svg = await drawn(page.querySelector('#history-1-1 svg'));
         const axis = (s) => [Number(s.dataset.low), Number(s.dataset.high), [...s.querySelectorAll('text.tick')].map((t) => t.textContent).join(' ')];
         const other = await drawn(page.querySelector('#inputs-1 svg'));
         const before = axis(svg);
         act(svg, 'pointerdown', 0.3, 0.3); act(svg, 'pointermove', 0.4, 0.3); act(svg, 'pointermove', 0.5, 0.3); act(svg, 'pointerup', 0.5, 0.3);
         const dragged = axis(svg), linked = axis(other);
         act(svg, 'wheel', 0.4, 0.3, { ctrlKey: true, deltaY: -200 });
         const wheeled = axis(svg);
         act(svg, 'wheel', 0.4, 0.3, { deltaY: -200 });
         const scrolled = axis(svg);
         act(svg, 'dblclick', 0.4, 0.3);
         return { before, dragged, linked, wheeled, scrolled, after: axis(svg) };",
    );
    assert_eq!(console, "");
    let range = |key: &str| (found[key][0].as_f64().unwrap(), found[key][1].as_f64().unwrap());
    assert_eq!(range("before"), (0.0, 7.98));
    let (low, high) = range("dragged");
    assert!(low > 1.0 && high < 5.0 && high - low > 1.0, "{found}");
    assert_ne!(found["before"][2], found["dragged"][2], "the labels of the axis change with it");
    assert_eq!(range("linked"), (low, high));
    let (a, b) = range("wheeled");
    assert!(a > low && b < high, "{found}");
    assert_eq!(range("scrolled"), (a, b), "the wheel alone moves the page, not the axis");
    assert_eq!(found["after"], found["before"]);
}

#[test]
#[ignore = "needs Chromium"]
fn the_crosshair_tells_the_values_of_the_data() {
    let desk = hostile(400);
    let (found, console) = look(
        &desk,
        (1280, 900),
        "const holder = page.querySelector('#history-1-1'), svg = holder.querySelector('svg');
         await drawn(svg);
         const data = JSON.parse(holder.querySelector('script').textContent);
         const read = () => holder.querySelector('output').textContent;
         const told = [];
         for (const x of [0.1, 0.37, 0.5, 0.81, 0.999]) { act(svg, 'pointermove', x, 0.4); told.push(read()); }
         act(svg, 'keydown', 0, 0, { key: 'ArrowLeft' });
         return { told, left: read(), data };",
    );
    assert_eq!(console, "");
    let data = &found["data"];
    let expected = |k: usize| {
        let marks = data["panels"].as_array().unwrap().iter().flat_map(|p| p["marks"].as_array().unwrap());
        let shown = |v: &Value| v.as_f64().unwrap().to_string();
        let values = marks.map(|m| format!("{} = {}", m["name"].as_str().unwrap(), shown(&m["values"][k])));
        std::iter::once(format!("time = {}", shown(&data["at"][k]))).chain(values).collect::<Vec<_>>().join("   ")
    };
    let all: Vec<String> = (0..400).map(expected).collect();
    let places: Vec<usize> = found["told"]
        .as_array()
        .unwrap()
        .iter()
        .map(|told| all.iter().position(|e| told == e.as_str()).unwrap_or_else(|| panic!("{told} is no sample")))
        .collect();
    assert!(places.windows(2).all(|w| w[0] < w[1]) && places[4] == 399, "{places:?}");
    assert_eq!(found["left"], all[398].as_str());
    // and the block of data has what the result's table has
    let file = fs::read_dir(desk.path("result")).unwrap().flatten().map(|e| e.path());
    let table = file
        .filter(|p| p.extension().is_some_and(|e| e == "csv"))
        .map(|p| fs::read_to_string(p).unwrap())
        .next()
        .unwrap();
    for (k, row) in table.lines().skip(1).enumerate() {
        let cells: Vec<f64> = row.split(',').map(|c| c.parse().unwrap()).collect();
        let marks = [
            &data["at"][k],
            &data["panels"][0]["marks"][0]["values"][k],
            &data["panels"][0]["marks"][1]["values"][k],
            &data["panels"][1]["marks"][0]["values"][k],
        ];
        for (cell, shown) in [cells[0], cells[2], cells[3], cells[4]].iter().zip(marks) {
            assert!((cell - shown.as_f64().unwrap()).abs() <= 1e-7 * cell.abs(), "row {k}: {cell} {shown}");
        }
    }
}

/// The time in which the browser opens a file, the least of three, in the clock on the wall.
fn opened(file: &Path) -> Duration {
    let once = || {
        let profile = tempfile::tempdir().unwrap();
        let began = Instant::now();
        let output = Command::new(browser())
            .args(["--headless", "--no-sandbox", "--disable-gpu", "--dump-dom"])
            .arg(format!("--user-data-dir={}", profile.path().display()))
            .arg(format!("file://{}", file.display()))
            .output()
            .unwrap();
        assert!(!output.stdout.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
        began.elapsed()
    };
    (0..3).map(|_| once()).min().unwrap()
}

#[test]
#[ignore = "needs Chromium"]
fn a_hundred_thousand_samples_open_in_less_than_a_second() {
    let desk = hostile(100_000);
    desk.write("empty.html", "<!doctype html><title>empty</title>");
    let text = desk.text("report.html");
    let data: usize =
        text.split("<script type=\"application/json\">").skip(1).map(|t| t.find("</script>").unwrap()).sum();
    let (empty, whole) = (opened(&desk.path("empty.html")), opened(&desk.path("report.html")));
    println!(
        "page of {} bytes, {data} of them data; the browser opens it in {whole:.2?}, an empty one in {empty:.2?}",
        text.len()
    );
    assert!(whole.saturating_sub(empty) < Duration::from_secs(1), "{whole:?} with, {empty:?} without");
    assert!(text.len() - data < 2_000_000, "{} bytes without data", text.len() - data);
    assert!(data < 2_000_000, "{data} bytes of data");
}

#[test]
#[ignore = "needs Chromium"]
fn nothing_sticks_out_of_a_phone() {
    let desk = hostile(400);
    let (found, console) = look(
        &desk,
        (390, 844),
        "await wait(300);
         const wide = [...page.querySelectorAll('body *')].filter((e) => !e.closest('.scroll, .equations, pre, svg')
           && e.getBoundingClientRect().right > view.innerWidth + 1);
         return { width: page.documentElement.scrollWidth, wide: wide.map((e) => e.outerHTML.slice(0, 200)) };",
    );
    assert_eq!(console, "");
    // a scroll bar takes its part of the width
    assert!(found["width"].as_u64().unwrap() <= 390 && found["wide"] == json!([]), "{found}");
}

#[test]
#[ignore = "needs Chromium"]
fn a_folder_and_a_fit_give_the_same_page() {
    let desk = hostile(400);
    fdm(&desk, &["report", "result", "-o", "again.html"]);
    assert_eq!(fs::read(desk.path("report.html")).unwrap(), fs::read(desk.path("again.html")).unwrap());
}

/// What stands outside of its own box that scrolls, on a page that is as wide as a phone.
const WIDE: &str = "await wait(300);
  const wide = [...page.querySelectorAll('body *')].filter((e) => !e.closest('.scroll, .equations, pre, svg')
    && e.getBoundingClientRect().right > view.innerWidth + 1);
  const lines = [...page.querySelectorAll('.equations > div')];
  return { width: page.documentElement.scrollWidth, wide: wide.map((e) => e.outerHTML.slice(0, 200)),
    box: page.querySelector('.equations').getBoundingClientRect().right,
    longest: Math.max(...lines.map((e) => e.scrollWidth)), heights: lines.map((e) => e.getBoundingClientRect().height) };";

#[test]
#[ignore = "needs Chromium"]
fn long_equations_stay_in_their_box() {
    let desk = Desk::new();
    let sum = "k*x/(1 + x^2) + ".repeat(12);
    let product = "(1 + k*x)*".repeat(30);
    let model = format!(
        "model long {{ input u; state x = free, z = 0; param k = 1 in [0, 50], g = 1; der(x) = {sum}g*u - 13*k*x;\n\
         der(z) = -z + 0*{product}u; output y = x + 0*z; }}"
    );
    desk.write("model.fdm", model);
    desk.write("run.csv", record(200));
    fdm(&desk, &["fit", "model.fdm", "--data", "run.csv", "--zoh", "u", "-q", "--report", "report.html"]);
    let (found, console) = look(&desk, (390, 844), WIDE);
    assert_eq!(console, "");
    assert!(found["width"].as_u64().unwrap() <= 390 && found["wide"] == json!([]), "{found}");
    assert!(found["box"].as_f64().unwrap() <= 390.0, "{found}");
    // the sum goes on in further lines, the product scrolls
    assert!(found["heights"][0].as_f64().unwrap() > 100.0 && found["longest"].as_f64().unwrap() > 500.0, "{found}");
}

/// Where formulas have their parts: how far each index reaches below its letter, and how far both parts of each fraction keep apart, in parts of a
/// line; whether each root covers what is below it.
const PLACED: &str = "await page.fonts.ready; await wait(300);
  const box = (e) => e.getBoundingClientRect();
  const line = parseFloat(view.getComputedStyle(page.querySelector('.equations math')).fontSize);
  return {
    indices: [...page.querySelectorAll('.equations msub')].map((e) => (box(e.children[1]).bottom - box(e.children[0]).bottom) / line),
    fractions: [...page.querySelectorAll('.equations mfrac')].map((e) => (box(e.children[1]).top - box(e.children[0]).bottom) / line),
    roots: [...page.querySelectorAll('.equations msqrt')].map((e) => (box(e.children[0]).top - box(e).top) / line),
  };";

/// A math font, where the machine has one, and letters about the page's own table: what browsers do without any is seen by leaving that out too.
#[test]
#[ignore = "needs Chromium"]
fn formulas_are_placed_right_with_a_math_font_and_without() {
    let desk = Desk::new();
    let model = "model set { input u; state x = free; param k_x = 1 in [0, 50], g = 1; \
                 let root = sqrt(1 + x^2/(1 + g)); der(x) = -k_x*x/(1 + 0*root) + g*u; output y = x; }";
    desk.write("model.fdm", model);
    desk.write("run.csv", record(200));
    fdm(&desk, &["fit", "model.fdm", "--data", "run.csv", "--zoh", "u", "-q", "--report", "report.html"]);
    let page = desk.text("report.html");
    let own = "\"fdm mathematics\", serif;";
    let named = page.split_once(".equations math {").and_then(|(_, rest)| rest.split_once(own)).unwrap().0;
    let fonts = named.split_once("font-family: ").unwrap().1;
    desk.write("without.html", page.replace(&format!("{fonts}{own}"), own));
    desk.write("nothing.html", page.replace(&format!("{fonts}{own}"), "serif;"));
    let placed = |name: &str| {
        let (found, console) = look_at(&desk, name, (1280, 900), PLACED);
        assert_eq!(console, "");
        let of = |key: &str| found[key].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect::<Vec<f64>>();
        let (indices, fractions, roots) = (of("indices"), of("fractions"), of("roots"));
        println!("{name}: indices {indices:.2?}, fractions {fractions:.2?}, roots {roots:.2?}");
        assert!(!indices.is_empty() && fractions.len() == 2 && roots.len() == 1, "{found}");
        let below = indices.iter().all(|v| (0.05..0.6).contains(v));
        below && fractions.iter().all(|v| *v > 0.02) && roots.iter().all(|v| *v > 0.05)
    };
    assert!(placed("report") && placed("without"));
    println!("without the page's own table: {}", placed("nothing"));
}

#[test]
#[ignore = "needs Chromium"]
fn a_study_with_its_figures_fits_on_a_phone_and_tells_names() {
    let desk = Desk::new();
    desk.write("model.fdm", MODEL);
    desk.write("run.csv", record(200));
    fdm(
        &desk,
        &["study", "model.fdm", "--data", "run.csv", "--zoh", "u", "--repeats", "50", "-q", "--report", "report.html"],
    );
    let (found, console) = look(&desk, (390, 844), WIDE);
    assert_eq!(console, "");
    assert!(found["width"].as_u64().unwrap() <= 390 && found["wide"] == json!([]), "{found}");
    let (found, console) = look(
        &desk,
        (1280, 900),
        "const told = [];
         for (const id of ['coverage-1', 'estimates-1']) {
           const holder = page.querySelector('#' + id), svg = await drawn(holder.querySelector('svg'));
           act(svg, 'pointermove', 0.5, 0.3);
           told.push(holder.querySelector('output').textContent);
         }
         const columns = page.querySelector('#estimates-1 path.columns').getBBox();
         return { told, columns: columns.width };",
    );
    assert_eq!(console, "");
    let told = |k: usize| found["told"][k].as_str().unwrap();
    assert!(told(0).starts_with("k, ") && (told(0).contains("corrected = ") || told(0).contains("Rao = ")), "{found}");
    assert!(told(1).contains("estimates = ") && told(1).contains("normal = "), "{found}");
    assert!(found["columns"].as_f64().unwrap() > 200.0, "{found}");
}

/// What every page must be: figures that the keyboard reaches and that say what they are, tables whose heads are heads, no request, nothing wider than the
/// window; and what the crosshair of the first figure tells at a key.
const CALM: &str = "await wait(300);
  const figures = [...page.querySelectorAll('figure.plot svg')];
  const named = (e) => (e.getAttribute('aria-label') ?? e.querySelector('title')?.textContent ?? '').length > 0;
  const told = [];
  if (figures.length > 0) {
    const svg = await drawn(figures.find((f) => f.checkVisibility()) ?? figures[0]);
    svg.focus();
    act(svg, 'keydown', 0, 0, { key: 'ArrowLeft' });
    told.push(page.activeElement === svg, svg.closest('figure').querySelector('output').textContent);
  }
  const levels = [...page.querySelectorAll('h1, h2, h3, h4')].map((h) => Number(h.tagName[1]));
  const wide = [...page.querySelectorAll('body *')].filter((e) => !e.closest('.scroll, .equations, pre, svg')
    && e.getBoundingClientRect().right > view.innerWidth + 1);
  const links = [...page.querySelectorAll('a[href^=\"#\"]')].map((a) => a.getAttribute('href').slice(1)).filter((id) => !page.getElementById(id));
  const ids = [...page.querySelectorAll('[id]')].map((e) => e.id);
  const swatches = (legend) => [...legend.querySelectorAll('.swatch')].map((s) => s.className);
  const alike = [...page.querySelectorAll('.legend')].filter((l) => new Set(swatches(l)).size < swatches(l).length);
  const cut = [...page.querySelectorAll('.scroll:not(.canvas) > table:not(.map)')].filter((t) => t.scrollWidth > t.parentElement.clientWidth + 1);
  const sizes = [...page.querySelectorAll('.canvas svg text.tick')].filter((t) => t.checkVisibility()).map((t) => {
    const svg = t.ownerSVGElement;
    return Math.round(10 * parseFloat(view.getComputedStyle(t).fontSize) * svg.getBoundingClientRect().width / svg.viewBox.baseVal.width) / 10;
  });
  const units = [...page.querySelectorAll('td, .caption, .says, text.label')].map((e) => e.textContent).filter((t) => /\\[1\\]|\\w\\^\\d/.test(t));
  return {
    alike: alike.map((l) => l.textContent), cut: cut.map((t) => t.textContent.slice(0, 80)), sizes: [...new Set(sizes)], units,
    language: page.documentElement.lang, title: page.title, heads: page.querySelectorAll('h1').length, mains: page.querySelectorAll('main').length,
    jumps: levels.filter((l, k) => k > 0 && l > levels[k - 1] + 1).length,
    figures: figures.length, unnamed: figures.filter((f) => !named(f) || f.getAttribute('role') !== 'img').map((f) => f.outerHTML.slice(0, 200)),
    unreached: figures.filter((f) => f.tabIndex !== 0).length,
    heads_without: [...page.querySelectorAll('table')].filter((t) => t.querySelectorAll('th').length === 0).length,
    status: page.querySelectorAll('[role=status]').length,
    requests: view.performance.getEntriesByType('resource').map((e) => e.name).filter((n) => !n.startsWith('data:')),
    told, links, twice: ids.filter((id, k) => ids.indexOf(id) !== k), width: page.documentElement.scrollWidth, wide: wide.map((e) => e.outerHTML.slice(0, 200)),
  };";

/// Sheets of paper that a page is printed on.
fn sheets(desk: &Desk, page: &str) -> usize {
    let profile = tempfile::tempdir().unwrap();
    let file = desk.path("printed.pdf");
    let output = Command::new(browser())
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--timeout=60000"])
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .arg(format!("--print-to-pdf={}", file.display()))
        .arg(format!("file://{}", desk.path(&format!("{page}.html")).display()))
        .output()
        .unwrap();
    let pdf = fs::read(&file).unwrap_or_else(|_| panic!("{}", String::from_utf8_lossy(&output.stderr)));
    fs::remove_file(&file).unwrap();
    let text = String::from_utf8_lossy(&pdf);
    text.split("/Type /Page").skip(1).filter(|rest| !rest.starts_with('s')).count()
}

#[cfg(unix)]
#[test]
#[ignore = "needs Chromium"]
fn every_kind_of_page_is_calm_reached_by_keys_and_printed_on_few_sheets() {
    let desk = crate::kinds::made();
    let mut wrong = Vec::new();
    for (name, _) in crate::kinds::PAGES {
        for size in [(1280, 900), (390, 844)] {
            let (found, console) = look_at(&desk, name, size, CALM);
            let mut check = |good: bool, what: &str| {
                if !good {
                    wrong.push(format!("{name} {}: {what}: {found}", size.0));
                }
            };
            check(console.is_empty(), &console);
            check(found["failed"].is_null(), "the steps failed");
            check(
                found["language"] == "en" && found["title"].as_str().is_some_and(|t| !t.is_empty()),
                "language, title",
            );
            check(found["heads"] == 1 && found["mains"] == 1 && found["status"] == 1 && found["jumps"] == 0, "outline");
            check(found["unnamed"] == json!([]) && found["unreached"] == 0, "figures");
            check(found["figures"] == 0 || (found["told"][0] == true && found["told"][1] != ""), "keys");
            check(
                found["heads_without"] == 0 && found["links"] == json!([]) && found["twice"] == json!([]),
                "tables, links",
            );
            check(found["requests"] == json!([]), "requests");
            check(found["alike"] == json!([]), "swatches of one look");
            check(found["units"] == json!([]), "units");
            let sizes = found["sizes"].as_array().map_or(0, Vec::len);
            check(sizes <= 1, "labels of several sizes");
            check(size.0 < 1000 || found["cut"] == json!([]), "tables wider than their box");
            check(found["width"].as_u64().is_some_and(|w| w <= size.0.into()) && found["wide"] == json!([]), "width");
        }
        let (sheets, bytes) = (sheets(&desk, name), fs::metadata(desk.path(&format!("{name}.html"))).unwrap().len());
        println!("{name}: {sheets} sheets, {bytes} bytes");
        if !(1..=12).contains(&sheets) || bytes >= 4_000_000 {
            wrong.push(format!("{name}: {sheets} sheets, {bytes} bytes"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
