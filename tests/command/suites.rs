//! What the command prints, as files: every `--help`, every stage of `show` for ten models, every code explained, every model checked.

use fdm_grammar::Code;
use rayon::prelude::*;
use support::command::{at_home, printed, said};
use support::{Suite, files, repository};

const STAGES: [&str; 7] = ["syntax", "model", "graph", "derivatives", "schedule", "code", "linear"];
/// Short models that have between them what the language has: delays, blocks, submodels, noise, stiffness, trims, units.
const MODELS: [&str; 10] = [
    "delays/model",
    "gas_oil/model",
    "goodman_ship/model",
    "hover/controller",
    "pendulum_free_swing/coulomb",
    "robertson/model",
    "second_order_delay/model",
    "ship_roll_decay/model",
    "turbulence/model",
    "vstol/model",
];

/// The verbs, those below another with both names: `job plan`.
fn verbs() -> Vec<String> {
    let command = fdm_cli::command();
    let both = command.get_subcommands().flat_map(|verb| {
        let below = verb.get_subcommands().map(|sub| format!("{} {}", verb.get_name(), sub.get_name()));
        std::iter::once(verb.get_name().to_string()).chain(below)
    });
    both.collect()
}

/// What `--help` or `-h` prints where the terminal has so many columns.
fn help(words: &str, option: &str, columns: usize) -> String {
    let output = at_home(words).arg(option).env("COLUMNS", columns.to_string()).output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{words:?}: {}", said(&output));
    printed(&output)
}

#[test]
fn every_help() {
    let mut suite = Suite::new("help");
    suite.check("fdm.txt", &help("", "--help", 100));
    let verbs = verbs();
    assert!(verbs.len() > 35, "{verbs:?}");
    let all: Vec<(String, String)> =
        verbs.into_par_iter().map(|verb| (help(&verb, "--help", 100), verb.replace(' ', "_"))).collect();
    for (text, verb) in all {
        suite.check(&format!("{verb}.txt"), &text);
    }
    suite.finish();
}

/// Every page of help, at the widths that terminals have.
#[test]
fn no_help_is_wider_than_the_terminal() {
    let pages: Vec<String> = verbs().into_iter().chain([String::new()]).collect();
    let wide: Vec<String> = pages
        .into_par_iter()
        .flat_map_iter(|verb| {
            let each = [("--help", 80), ("-h", 80), ("--help", 120), ("-h", 120)].into_iter();
            each.flat_map(move |(option, columns)| {
                let text = help(&verb, option, columns);
                let wide = |line: &&str| line.chars().count() > columns;
                let told: Vec<String> =
                    text.lines().filter(wide).map(|line| format!("{verb} {option}, {columns}: {line}")).collect();
                told
            })
        })
        .collect();
    assert!(wide.is_empty(), "{}", wide.join("\n"));
}

/// The options that people use, and no more.
#[test]
fn the_short_help_is_short() {
    for verb in ["fit", "diagnose", "doctor", "simulate", "study", "validate", "regress"] {
        let options = |option: &str| {
            let text = help(verb, option, 100);
            text.lines().filter(|line| line.trim_start().starts_with('-')).count()
        };
        let (short, all) = (options("-h"), options("--help"));
        assert!(short <= 25 && short < all, "{verb}: {short} of {all}");
    }
}

#[test]
fn every_code_explained() {
    let mut suite = Suite::new("explain");
    let pages: Vec<String> = Code::ALL.par_iter().map(|code| session(&format!("explain {}", code.text()))).collect();
    suite.check("all.txt", &pages.concat());
    suite.finish();
}

/// What machine code depends on: it is compared where this is the same.
fn processor() -> String {
    #[cfg(target_arch = "x86_64")]
    {
        let has = [
            ("avx", is_x86_feature_detected!("avx")),
            ("avx2", is_x86_feature_detected!("avx2")),
            ("fma", is_x86_feature_detected!("fma")),
            ("bmi2", is_x86_feature_detected!("bmi2")),
            ("avx512", is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512vl")),
        ];
        let names: Vec<&str> = has.iter().filter(|(_, there)| *there).map(|(name, _)| *name).collect();
        format!("x86_64 {}", names.join(" "))
    }
    #[cfg(not(target_arch = "x86_64"))]
    String::from(std::env::consts::ARCH)
}

/// Without the addresses of this process: numbers of nine to twelve digits, where constants have sixteen.
fn without_addresses(code: &str) -> String {
    let mut parts = code.split("$0x");
    let mut text = parts.next().unwrap_or_default().to_string();
    for part in parts {
        let digits = part.chars().take_while(char::is_ascii_hexdigit).count();
        let rest =
            if (9..=12).contains(&digits) { format!("$ADDRESS{}", &part[digits..]) } else { format!("$0x{part}") };
        text.push_str(&rest);
    }
    text
}

/// What was typed, what was printed and said, and the exit code where it is not 0.
fn session(words: &str) -> String {
    let output = at_home(words).output().unwrap();
    let end = output.status.code().filter(|code| *code != 0).map(|code| format!("exit code {code}\n"));
    format!("$ fdm {words}\n{}{}{}\n", printed(&output), said(&output), end.unwrap_or_default())
}

fn shown(model: &str, stage: &str, json: bool) -> String {
    session(&format!("show models/{model}.fdm --stage {stage}{}", if json { " --json" } else { "" }))
}

#[test]
fn every_stage_of_ten_models() {
    let mut suite = Suite::new("show");
    let pages: Vec<(String, String, String)> = MODELS
        .par_iter()
        .map(|model| {
            let of = |json: bool| {
                let stages = STAGES.iter().filter(|stage| **stage != "code");
                stages.map(|stage| shown(model, stage, json)).collect::<String>()
            };
            // the same text stands in the JSON of this stage
            (of(false), of(true), without_addresses(&shown(model, "code", false)))
        })
        .collect();
    for (model, (text, json, code)) in MODELS.iter().zip(pages) {
        let name = model.replace('/', "_");
        suite.check(&format!("{name}.txt"), &text);
        suite.check(&format!("{name}.json.txt"), &json);
        let (file, machine) = (format!("{name}.code.txt"), processor());
        let expected = suite.expected(&file);
        let there = expected.lines().next().unwrap_or_default();
        let same = there.is_empty() || there == machine || std::env::var_os("FDM_BLESS").is_some();
        let got = if same { format!("{machine}\n{code}") } else { expected };
        suite.check(&file, &got);
    }
    suite.finish();
}

#[test]
fn every_model_checked() {
    let mut suite = Suite::new("check");
    let all = files("models", "fdm");
    assert!(all.len() > 60, "{} models", all.len());
    let told: Vec<String> = all
        .par_iter()
        .map(|file| session(&format!("check {}", file.strip_prefix(repository()).unwrap().display())))
        .map(|text| {
            // the declarations are those of the model's text; the last digits of differences are the machine's
            let worth = |line: &&str| !line.starts_with(' ');
            let lines = text.lines().filter(worth).map(|l| l.split(", largest relative").next().unwrap_or_default());
            lines.map(|l| format!("{l}\n")).collect()
        })
        .collect();
    suite.check("models.txt", &told.concat());
    suite.finish();
}
