//! A page of every kind, of the models of this repository: what is looked at in a browser, and drawn for the documentation.

use std::process::Command;
use support::Desk;

/// Results that pages are made from.
const RESULTS: [&str; 3] = [
    "fit models/lynx_hare/model.fdm --data models/lynx_hare/run.csv --out lynx",
    "fit models/ship_roll_decay/linear.fdm --data models/ship_roll_decay/run.csv --every 8 --out linear",
    "fit models/ship_roll_decay/model.fdm --data models/ship_roll_decay/run.csv --every 8 --out cubic",
];
/// Name, and the command that makes the page.
pub(crate) const PAGES: [(&str, &str); 12] = [
    ("fit", "fit models/trex550/coupled.fdm --data models/trex550/first_half.csv"),
    (
        "diagnosis",
        "diagnose models/ship_roll_decay/linear.fdm --data models/ship_roll_decay/run.csv --every 8 --only cubic_stiffness --only quadratic_damping",
    ),
    (
        "study",
        "study models/ship_roll_decay/model.fdm --data models/ship_roll_decay/run.csv --every 16 --repeats 100 --noise-colour fitted",
    ),
    ("posterior", "sample lynx --chains 4 --draws 500 --warmup 300 --white"),
    (
        "calibration",
        "study models/gas_oil/model.fdm --data models/gas_oil/run.csv --calibration --repeats 100 --seed 4",
    ),
    ("profile", "profile models/lynx_hare/model.fdm --data models/lynx_hare/run.csv"),
    ("comparison", "compare linear cubic"),
    ("spectra", "spectra models/trex550/coupled.fdm --data models/trex550/first_half.csv"),
    ("doctor", "doctor models/trex550/coupled.fdm --data models/trex550/first_half.csv --no-estimated"),
    ("validation", "validate cubic --data models/ship_roll_decay/run.csv --every 16"),
    (
        "design",
        "design models/trex550/coupled.fdm --data models/trex550/first_half.csv --duration 10 --dt 0.1 --amplitude lat=0.3 --amplitude lon=0.3 --noise p_m=0.05 --noise q_m=0.05",
    ),
    ("regression", "regress models/trex550/coupled.fdm --data models/trex550/first_half.csv --fix skew --dependence"),
];

/// A desk with all of them, `NAME.html` each; names of files on the pages are those of the documentation.
pub(crate) fn made() -> Desk {
    let desk = Desk::new();
    std::os::unix::fs::symlink(support::repository().join("models"), desk.path("models")).unwrap();
    let run = |words: &str, more: &[&str]| {
        let mut command: Command = support::fdm();
        let output = command.args(words.split(' ')).arg("-q").args(more).current_dir(desk.folder()).output().unwrap();
        assert!(matches!(output.status.code(), Some(0 | 1)), "{words}: {}", String::from_utf8_lossy(&output.stderr));
    };
    RESULTS.iter().for_each(|words| run(words, &[]));
    PAGES.iter().for_each(|(name, words)| run(words, &["--report", &format!("{name}.html")]));
    desk
}
