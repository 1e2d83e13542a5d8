//! Nothing is lost: faults of the disk at the operations of every verb that writes, kills at random moments, results over what is
//! read, files of others in the places of results.

use std::fs;
use support::Desk;
use support::command::said;
use support::writing::{FORMS, Table};

/// Every verb that writes, at its operations on files: those of single files all, those of folders some, as the store's own tests
/// try all of them. `FDM_FAULTS=all` tries every one in every way, and `FDM_KILLS` says how many kills at random moments follow.
#[test]
fn a_fault_or_a_kill_at_any_moment_leaves_the_old_or_the_new_result() {
    let table = Table::new();
    let all = std::env::var("FDM_FAULTS").is_ok_and(|v| v == "all");
    let kinds = match all {
        true => &["nothing", "torn", "done", "dies:nothing", "dies:torn", "dies:done"][..],
        false => &["nothing", "dies:torn"],
    };
    let mut sum = 0;
    for (k, form) in FORMS.iter().enumerate() {
        let stride = match form.is_of_many() {
            true if form.is_slow && !all => 40,
            true if !all => 17,
            _ => 1,
        };
        let count: usize = kinds.iter().map(|kind| table.faults(k, kind, stride)).sum();
        println!("{:40} {count:5} faults", form.name);
        assert!(count > 1, "{}: {count}", form.name);
        sum += count;
    }
    println!("{sum} faults over {} verbs with their options, nothing lost", FORMS.len());
    let count = std::env::var("FDM_KILLS").map_or(10, |n| n.parse().unwrap());
    let killed = table.kills(count, 2026);
    println!("{} kills, nothing lost: {killed:?}", killed.values().sum::<usize>());
    assert!(killed.values().sum::<usize>() >= count / 2, "{killed:?}");
}

/// The studio is killed while it writes what was clicked.
#[cfg(unix)]
#[test]
fn a_studio_that_is_killed_loses_nothing_that_it_answered_for() {
    let count = std::env::var("FDM_KILLS").map_or(12, |n| n.parse().unwrap());
    let killed = support::studio::kills(count, 62);
    println!("{killed} of {count} kills while it was at work, nothing lost");
    assert!(killed >= count / 2, "{killed} kills while it was at work");
}

const MODEL: &str = "model gain { input u; use \"part.fdm\" as p; param a = 1; output y = a*u*p.one; }\n";
const PART: &str = "model part { param c = 1 fixed; let one = c; }\n";

fn desk() -> Desk {
    let rows: String =
        (0..21).map(|k| format!("{},{},{}\n", f64::from(k) / 10.0, 1 + k % 3, 2.1 * f64::from(1 + k % 3))).collect();
    let desk = Desk::with([("gain.fdm", MODEL), ("part.fdm", PART)]);
    desk.write("run.csv", format!("t [s],u,y\n{rows}"));
    fs::create_dir(desk.path("deep")).unwrap();
    desk
}

#[test]
fn nothing_is_written_over_what_is_read() {
    let desk = desk();
    let before = |name: &str| desk.text(name);
    let (model, part, run) = (before("gain.fdm"), before("part.fdm"), before("run.csv"));
    desk.good("fit gain.fdm --data run.csv -q --out base");
    fs::hard_link(desk.path("run.csv"), desk.path("hard.csv")).unwrap();
    #[cfg(unix)]
    std::os::unix::fs::symlink("run.csv", desk.path("soft.csv")).unwrap();
    let refused = |words: &str, options: [&str; 2]| {
        let said = desk.refused(words);
        assert!(options.iter().all(|o| said.contains(o)) && said.contains("written over"), "{words}: {said}");
    };
    let data = ["run.csv", "./run.csv", "deep/../run.csv", "hard.csv", "soft.csv"];
    for target in data.iter().filter(|name| desk.path(name).exists()) {
        refused(&format!("simulate gain.fdm --data run.csv -o {target}"), ["--output", "--data"]);
        for option in ["--plot", "--report"] {
            refused(&format!("fit gain.fdm --data run.csv {option} {target}"), [option, "--data"]);
            refused(&format!("study gain.fdm --data run.csv {option} {target}"), [option, "--data"]);
            refused(&format!("validate --from-result base --data run.csv {option} {target}"), [option, "--data"]);
        }
        for verb in ["profile", "spectra", "regress --recursive"] {
            let words = format!("{verb} gain.fdm --data run.csv --plot {target}");
            refused(
                &words.replace("regress --recursive gain.fdm", "regress gain.fdm --recursive"),
                ["--plot", "--data"],
            );
        }
        refused(&format!("regress gain.fdm --data run.csv --report {target}"), ["--report", "--data"]);
        for option in ["--write", "--report"] {
            refused(&format!("diagnose gain.fdm --data run.csv {option} {target}"), [option, "--data"]);
        }
    }
    // the model, a file that it uses, a result and the records that it was made from
    refused("export gain.fdm --to c -o ./gain.fdm", ["--output", "MODEL"]);
    refused("export gain.fdm --to c -o part.fdm", ["--output", "MODEL"]);
    refused("extend gain.fdm --effect input_delay(u) --write gain.fdm", ["--write", "MODEL"]);
    refused("report base -o base/result.json", ["--output", "DIR"]);
    refused("plot base --figure autocorrelation-1 -o base/manifest.json", ["--output", "DIR"]);
    refused("simulate --from-result base -o run.csv", ["--output", "--from-result"]);
    refused("validate --from-result base --data run.csv --out base", ["--out", "--from-result"]);
    refused("fit base/model.fdm --data run.csv --out base", ["--out", "MODEL"]);
    // and no two results to one place
    refused("fit gain.fdm --data run.csv --plot new.svg --report deep/../new.svg", ["--plot", "--report"]);
    refused("fit gain.fdm --data run.csv --out new --checkpoint ./new", ["--out", "--checkpoint"]);
    assert_eq!([before("gain.fdm"), before("part.fdm"), before("run.csv")], [model, part, run]);
    // what is not there, or is read by others only, is written
    desk.good("simulate gain.fdm --data run.csv -o deep/run.csv");
    desk.good("fit gain.fdm --data run.csv -q --plot /dev/null --report /dev/null");
}

#[test]
fn files_of_others_stay_where_results_go() {
    let desk = desk();
    fs::create_dir(desk.path("mine")).unwrap();
    desk.write("mine/thesis.txt", "all of it");
    let causes = "diagnose gain.fdm --data run.csv --max-effects 0 -q --out mine";
    for words in ["fit gain.fdm --data run.csv -q --out mine", "regress gain.fdm --data run.csv -q --out mine", causes]
    {
        desk.fdm(words);
        assert_eq!(desk.text("mine/thesis.txt"), "all of it", "{words}");
        assert!(desk.path("mine/manifest.json").exists(), "{words}");
    }
    // a model of the user's is no file of ours
    fs::create_dir(desk.path("work")).unwrap();
    fs::copy(desk.path("gain.fdm"), desk.path("work/model.fdm")).unwrap();
    for words in [causes.replace("mine", "work"), "fit gain.fdm --data run.csv -q --out work".into()] {
        let said = desk.refused(&words);
        assert!(said.contains("fdm did not write `model.fdm`") && said.contains("--force"), "{said}");
        assert_eq!(desk.text("work/model.fdm"), MODEL);
    }
    desk.good("fit gain.fdm --data run.csv -q --out work --force");
    // records that are made
    desk.write("work/run_1.csv", "my flight");
    let design = "design gain.fdm --noise y=1 --amplitude u=1 --duration 2 --dt 0.1 --runs 1 -q --records work";
    assert!(desk.refused(design).contains("run_1.csv: exists already"));
    assert_eq!(desk.text("work/run_1.csv"), "my flight");
    desk.good(&format!("{design} --force"));
    // pages
    desk.write("work/report.html", "<p>my own</p>");
    assert!(desk.refused("report work").contains("report.html: left alone: nothing in it says that fdm wrote it"));
    desk.write("work/fdm.1", "my own");
    assert!(desk.refused("man work").contains("fdm.1: exists already"));
    fs::remove_file(desk.path("work/report.html")).unwrap();
    for _ in 0..2 {
        desk.good("report work");
    }
}

/// Single files: what fdm wrote is replaced, other files only with `--force`, and nothing is computed before that is told.
#[test]
fn single_files_of_others_are_replaced_with_force_only() {
    let desk = desk();
    desk.good("fit gain.fdm --data run.csv -q --out base");
    let forms = [
        ("simulate gain.fdm --data run.csv -o @", "out.csv", true),
        ("fit gain.fdm --data run.csv -q --plot @", "fit.svg", true),
        ("fit gain.fdm --data run.csv -q --report @", "fit.html", true),
        ("profile gain.fdm --data run.csv -q --plot @", "profile.svg", true),
        ("report base -o @", "page.html", true),
        ("plot base --figure history-1-1 -o @", "figure.svg", true),
        ("plot base --figure history-1-1 --dark -o @", "dark.svg", true),
        ("plot base --figure history-1-1 -o @", "figure.png", true),
        ("export gain.fdm --to c -o @", "gain.c", true),
        ("export gain.fdm --to rust -o @", "gain.rs", true),
        // somebody may have written in it since
        ("extend gain.fdm --effect input_delay(u) --write @", "more.fdm", false),
    ];
    for (words, name, again) in forms {
        let words = words.replace('@', name);
        desk.write(name, "mine");
        let said = desk.refused(&words);
        assert!(said.contains(&format!("{name}: left alone")) && said.contains("--force"), "{words}: {said}");
        assert_eq!(desk.text(name), "mine", "{words}");
        desk.good(&format!("{words} --force"));
        match again {
            true => drop(desk.good(&words)),
            false => assert!(desk.refused(&words).contains("left alone"), "{words}"),
        }
        desk.write(name, "");
        desk.good(&words);
    }
    // a dash is standard output, where the result itself goes there
    for words in
        ["simulate gain.fdm --data run.csv -o -", "export gain.fdm --to c -o -", "plot base --figure history-1-1 -o -"]
    {
        assert!(!desk.good(words).is_empty(), "{words}");
    }
    for words in ["fit gain.fdm --data run.csv --plot -", "extend gain.fdm --effect input_delay(u) --write -"] {
        assert!(desk.refused(words).contains("give a file"), "{words}");
    }
    assert!(!desk.path("-").exists());
}

/// What cannot be written is told with its file, and exit code 1: the input was right.
#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_told_by_every_verb() {
    let desk = desk();
    desk.good("fit gain.fdm --data run.csv -q --out base");
    for words in [
        "simulate gain.fdm --data run.csv -o /dev/full",
        "report base -o /dev/full",
        "export gain.fdm --to c -o /dev/full",
        "fit gain.fdm --data run.csv -q --plot /dev/full",
    ] {
        let output = desk.fdm(words);
        assert_eq!(output.status.code(), Some(1), "{words}: {}", said(&output));
        assert!(said(&output).contains("/dev/full: the disk is full"), "{words}: {}", said(&output));
    }
}
