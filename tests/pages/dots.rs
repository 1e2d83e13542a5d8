//! The dot of a derivative is seen: an equation without it reads wrong.

use crate::window::{PAPERS, seen};
use support::Desk;

const MODEL: &str = "model two { state phi = 0.2, V; der(phi) = V; der(V) = -phi; output y = phi; }";
/// Dots of the model.
const DOTS: usize = 2;
/// Pixels for each of the page's own.
const SCALE: usize = 2;
/// Width and height of the window, in the page's own pixels.
const WINDOW: (u32, u32, f32) = (900, 1600, SCALE as f32);

/// How far two colours are apart.
fn contrast(a: [u8; 3], b: [u8; 3]) -> u32 {
    a.iter().zip(b).map(|(a, b)| u32::from(a.abs_diff(b))).sum()
}

#[test]
#[ignore = "needs Chromium"]
fn a_derivative_has_a_dot_light_and_dark() {
    let desk = Desk::with([("two.fdm", MODEL.replace("phi = 0.2", "phi = free"))]);
    let rows: String = (0..200)
        .map(|k| (0.05 * f64::from(k), f64::from(k % 7)))
        .map(|(t, e)| format!("{t:.2},{:.6}\n", 0.2 * t.cos() + 1e-4 * e))
        .collect();
    desk.write("run.csv", format!("t [s],y\n{rows}"));
    desk.good("fit two.fdm --data run.csv -q --report page.html");
    let page = desk.text("page.html");
    assert_eq!(page.matches("<mo class=\"dot\">").count(), DOTS);
    desk.write("without.html", page.replace("</head>", "<style>mo.dot { visibility: hidden; }</style></head>"));
    for (theme, paper) in PAPERS {
        let with = seen(&desk, "page", theme, WINDOW);
        let without = seen(&desk, "without", theme, WINDOW);
        assert_eq!((with.width, with.height), (without.width, without.height));
        assert_eq!(with.at(1, 1), paper, "{theme}");
        // ink is what is furthest from the paper anywhere
        let ink = with.all().map(|p| contrast(p, paper)).max().unwrap();
        let places = || (0..with.height).flat_map(|y| (0..with.width).map(move |x| (x, y)));
        let dots: Vec<(usize, usize)> = places().filter(|(x, y)| with.at(*x, *y) != without.at(*x, *y)).collect();
        let strong = dots.iter().filter(|(x, y)| contrast(with.at(*x, *y), without.at(*x, *y)) > ink * 7 / 10).count();
        // a dot is 2.7 pixels across: 5.7 of area
        assert!(strong >= DOTS * 3 * SCALE * SCALE, "{theme}: {strong} pixels of ink in {} that differ", dots.len());
        // where the dot is, there is nothing else
        let alone = dots.iter().filter(|(x, y)| contrast(without.at(*x, *y), paper) < ink / 10).count();
        assert!(alone * 10 >= dots.len() * 9, "{theme}: {alone} of {} stand free of the letter", dots.len());
    }
}
