//! Problems of PEtab, read by `fdm import` without a hand: the collection of benchmark problems (log-likelihood at the nominal parameters, and
//! fits from many starts) and the test suite of version 1.
//!
//! Both (BSD 3-Clause) are read from copies, which are no part of this project:
//!
//! `FDM_PETAB=.../Benchmark-Models FDM_PETAB_SUITE=.../cases/v1.0.0/sbml cargo test --release --manifest-path studies/Cargo.toml --test studies petab:: -- --ignored --nocapture`

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::time::Instant;
use support::command::Desk;

/// Problems with the log-likelihood that AMICI's tests hold for the nominal parameters.
const PUBLISHED: [(&str, f64); 18] = [
    ("Bachmann_MSB2011", 418.405_733_4),
    ("Beer_MolBioSystems2014", 58_622.914_563_1),
    ("Boehm_JProteomeRes2014", -138.221_996_9),
    ("Borghans_BiophysChem1997", 83.323_719_1),
    ("Brannmark_JBC2010", -141.889_113_8),
    ("Bruno_JExpBot2016", 46.688_177_0),
    ("Chen_MSB2009", -115_700.119_263),
    ("Crauste_CellSystems2017", -190.965_219_0),
    ("Elowitz_Nature2000", 63.202_799_9),
    ("Fiedler_BMCSystBiol2016", 58.583_901_6),
    ("Fujita_SciSignal2010", 53.083_777_4),
    ("Isensee_JCB2018", -3_949.375_966_5),
    ("Lucarelli_CellSystems2018", -1_681.605_987_9),
    ("Schwen_PONE2014", -943.999_298_9),
    ("Smith_BMCSystBiol2013", -888_198.436_541),
    ("Sneyd_PNAS2002", 319.791_778_2),
    ("Weber_BMC2015", -296.201_792_3),
    ("Zheng_PNAS2012", 278.333_532_7),
];

fn folder(variable: &str) -> PathBuf {
    std::env::var_os(variable).unwrap_or_else(|| panic!("{variable}: a copy is needed")).into()
}

/// The YAML file of a problem: of several, the first that is not one of tests.
fn description(folder: &Path) -> Option<PathBuf> {
    let mut all: Vec<PathBuf> = std::fs::read_dir(folder).ok()?.filter_map(|e| Some(e.ok()?.path())).collect();
    all.sort();
    let named = |p: &PathBuf| p.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    all.into_iter().find(|p| {
        p.extension().is_some_and(|e| e == "yaml") && !["_test", "_solution"].iter().any(|part| named(p).contains(part))
    })
}

/// A problem in a folder of its own, and what is added to its log-likelihood; otherwise why it was not read.
fn imported(yaml: &Path) -> Result<(Desk, f64), String> {
    let desk = Desk::new();
    let found = desk.fdm(&format!("import {} -o p", yaml.display()));
    if !found.status.success() {
        return Err(String::from_utf8_lossy(&found.stderr).trim().to_string());
    }
    let added = desk
        .text("p/IMPORT.md")
        .split_once("Add ")
        .map_or(0.0, |(_, rest)| rest.split_whitespace().next().and_then(|n| n.parse().ok()).unwrap_or(f64::NAN));
    Ok((desk, added))
}

/// The result of a fit in the folder of the problem.
fn fitted(desk: &Desk, words: &str) -> Option<Value> {
    let mut command = desk.command(&format!("fit --json -q --threads 1 {words}"));
    let found = command.current_dir(desk.path("p")).output().ok()?;
    serde_json::from_slice(&found.stdout).ok()
}

#[test]
#[ignore = "a study"]
fn likelihoods() {
    let collection = folder("FDM_PETAB");
    println!("{:<36} {:>18} {:>18} {:>9} {:>8}", "problem", "log-likelihood", "published", "apart", "s");
    let mut names: Vec<String> = std::fs::read_dir(&collection)
        .unwrap()
        .map(|e| e.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    for name in names {
        let Some(yaml) = description(&collection.join(&name)) else { continue };
        match imported(&yaml) {
            Err(said) => println!("{name:<36} {}", said.lines().next().unwrap_or_default()),
            Ok((desk, added)) => {
                let begun = Instant::now();
                let found = fitted(&desk, "--iterations 0");
                let found = found.and_then(|f| f["log_likelihood"].as_f64()).map_or(f64::NAN, |l| l + added);
                let published = PUBLISHED.iter().find(|(n, _)| *n == name).map_or(f64::NAN, |(_, l)| *l);
                let (apart, seconds) = (found - published, begun.elapsed().as_secs_f64());
                println!("{name:<36} {found:>18.6} {published:>18.6} {apart:>9.1e} {seconds:>8.2}");
            }
        }
    }
}

#[test]
#[ignore = "a study"]
fn suite() {
    let cases = folder("FDM_PETAB_SUITE");
    let mut names: Vec<PathBuf> = std::fs::read_dir(&cases).unwrap().map(|e| e.unwrap().path()).collect();
    names.retain(|p| p.is_dir());
    names.sort();
    for case in names {
        let Some(yaml) = description(&case) else { continue };
        let number = case.file_name().unwrap().to_string_lossy().into_owned();
        let solution = std::fs::read_to_string(case.join(format!("_{number}_solution.yaml"))).unwrap();
        let value = |key: &str| {
            let line = solution.lines().find_map(|l| l.strip_prefix(key)).unwrap();
            line.trim_start_matches(':').trim().parse::<f64>().unwrap()
        };
        let found = imported(&yaml).map(|(desk, added)| {
            fitted(&desk, "--iterations 0").and_then(|f| f["log_likelihood"].as_f64()).map_or(f64::NAN, |l| l + added)
        });
        match found {
            Ok(found) => {
                let passed = (found - value("llh")).abs() <= value("tol_llh");
                println!("{number} {} {found:.6} for {:.6}", if passed { "passed" } else { "failed" }, value("llh"));
            }
            Err(said) => println!("{number} refused: {said}"),
        }
    }
}

#[test]
#[ignore = "a study"]
fn starts() {
    let collection = folder("FDM_PETAB");
    for (name, count) in [("Crauste_CellSystems2017", 9), ("Boehm_JProteomeRes2014", 10)] {
        let (desk, added) = imported(&description(&collection.join(name)).unwrap()).unwrap();
        let seeds = std::env::var("FDM_SEEDS").ok().and_then(|s| s.parse().ok()).unwrap_or(3);
        for seed in 0..seeds {
            // the given start does not count: it stands at the nominal values
            let found = fitted(&desk, &format!("--starts {} --seed {seed} --iterations 400", count + 1)).unwrap();
            let starts = found["starts"].as_array().unwrap();
            let reached = starts.iter().skip(1).filter(|s| s["minimum"] == 1).count();
            let best = found["log_likelihood"].as_f64().unwrap_or(f64::NAN) + added;
            println!(
                "{name}, seed {seed}: {reached} of {count} starts reached the best minimum, log-likelihood {best:.6}"
            );
            starts.iter().for_each(|s| println!("   {s}"));
        }
    }
}
