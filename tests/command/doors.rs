//! What comes with a folder from elsewhere, and files that have no end: refused with a word that helps.

use fdm_exchange::fmu::{Contents, Version, write};
use std::collections::BTreeMap;
use std::fs;
use support::command::Desk;

const GAIN: &str = "model gain {\n  input u;\n  param a = 1;\n  output y = a*u;\n}\n";

fn desk() -> Desk {
    let desk = Desk::new();
    desk.write("gain.fdm", GAIN);
    let rows: String =
        (0..21).map(|k| format!("{},{},{}\n", f64::from(k) / 10.0, 1 + k % 3, 2 * (1 + k % 3))).collect();
    desk.write("run.csv", format!("t [s],u,y\n{rows}"));
    desk
}

#[test]
fn a_project_file_forces_nothing_and_writes_in_its_folder_only() {
    let desk = desk();
    let elsewhere = Desk::new();
    let beyond = elsewhere.write("notes.html", "<meta name=\"generator\" content=\"fdm 1\">");
    let fit = "fit gain.fdm --data run.csv -q";
    for (options, said) in [
        ("force = true", "only typed"),
        ("allow-units = true", "options.allow-units"),
        (&*format!("report = \"{}\"", beyond.display()), "lies outside"),
        ("report = \"../page.html\"", "lies outside"),
        ("out = \"deep/../../result\"", "lies outside"),
        ("out = \"/tmp/fdm-result\"", "lies outside"),
    ] {
        desk.write("fdm.toml", format!("[options]\n{options}\n"));
        let found = desk.refused(fit);
        assert!(found.contains("fdm.toml") && found.contains(said), "{options}: {found}");
        desk.good(&format!("{fit} --no-project"));
    }
    assert!(fs::read_to_string(&beyond).unwrap().starts_with("<meta"));
    desk.write("fdm.toml", "[options]\nreport = \"page.html\"\nout = \"results/first\"\n");
    desk.good(fit);
    assert!(desk.path("page.html").is_file() && desk.path("results/first").is_dir());
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(&beyond, desk.path("link.html")).unwrap();
        desk.write("fdm.toml", "[options]\nreport = \"link.html\"\n");
        assert!(desk.refused(fit).contains("lies outside"));
    }
    // what is typed is the user's own word
    desk.good(&format!("{fit} --report {}", elsewhere.path("typed.html").display()));
}

#[cfg(unix)]
#[test]
fn devices_are_refused_before_they_are_read() {
    let desk = desk();
    for words in ["check /dev/zero", "fit /dev/zero --data run.csv", "fit gain.fdm --data /dev/zero"] {
        let begun = std::time::Instant::now();
        let said = desk.refused(words);
        assert!(said.contains("device") || said.contains("neither a file nor a pipe"), "{words}: {said}");
        assert!(begun.elapsed().as_secs() < 5, "{words}");
    }
}

#[test]
fn a_job_forces_nothing_and_writes_in_its_folder_only() {
    let desk = desk();
    for (option, said) in [
        ("force = true", "only typed"),
        ("out = '/tmp/fdm-job'", "lies outside"),
        ("report = '../a.html'", "lies outside"),
    ] {
        desk.write(
            "job.toml",
            format!("command = 'fit'\nmodel = 'gain.fdm'\ndata = 'run.csv'\nstarts = 3\n{option}\n"),
        );
        let found = desk.refused("job plan job.toml -q --untimed");
        assert!(found.contains(said), "{option}: {found}");
    }
}

/// Only the superuser can give a file away.
#[cfg(unix)]
#[test]
fn a_project_file_of_another_user_is_left_alone() {
    let desk = desk();
    let file = desk.write("fdm.toml", "model = \"gain.fdm\"\ndata = \"run.csv\"\n");
    if std::os::unix::fs::chown(&file, Some(54_321), None).is_err() {
        return;
    }
    fs::create_dir(desk.path("below")).unwrap();
    for folder in ["", "below"] {
        let at = |word: &str| {
            let mut command = support::command::fdm();
            command
                .args(["fit", "-q"])
                .args(word.split_whitespace())
                .current_dir(desk.path(folder))
                .env_remove("SUDO_UID");
            command
        };
        let found = support::command::refused(&mut at(""));
        assert!(
            found.contains("user 54321") && found.contains("--no-project") && found.contains("FDM_SAFE_FOLDERS"),
            "{found}"
        );
        assert!(support::command::refused(&mut at("--no-project")).contains("no model"));
        support::command::good(at("").env("FDM_SAFE_FOLDERS", desk.path("")));
        if rustix::process::geteuid().is_root() {
            support::command::good(at("").env("SUDO_UID", "54321"));
        }
    }
}

#[cfg(unix)]
#[test]
fn devices_are_refused_wherever_a_file_is_named() {
    let desk = desk();
    for words in [
        "fit gain.fdm --runs /dev/urandom -q",
        "fit gain.fdm --data run.csv --map-file /dev/zero -q",
        "diagnose gain.fdm --data run.csv --effects /dev/zero -q",
        "job plan /dev/zero",
        "job run /dev/zero --out tasks",
        "verify /dev/zero --against gain.fdm",
    ] {
        let found = desk.refused(words);
        assert!(found.contains("a device"), "{words}: {found}");
    }
    std::os::unix::fs::symlink("/dev/zero", desk.path("fdm.toml")).unwrap();
    assert!(desk.refused("fit -q").contains("a device"));
    fs::remove_file(desk.path("fdm.toml")).unwrap();
    desk.write("fdm.toml", "map = \"/dev/zero\"\n");
    assert!(desk.refused("fit gain.fdm --data run.csv -q").contains("a device"));
    fs::remove_file(desk.path("fdm.toml")).unwrap();
    fs::create_dir(desk.path("ship")).unwrap();
    std::os::unix::fs::symlink("/dev/zero", desk.path("ship/experiment.toml")).unwrap();
    assert!(desk.refused("reproduce ./ship").contains("no experiment"));
}

/// A parser that compares each attribute with all before it would take minutes.
#[test]
fn xml_of_endless_attributes_is_refused() {
    let desk = desk();
    let many: String = (0..200_000).map(|k| format!(" a{k}='1'")).collect();
    desk.write("a.xml", format!("<sbml level='3'{many}><model/></sbml>"));
    let found = desk.refused("import a.xml --out new");
    assert!(found.contains("256 attributes"), "{found}");
}

/// A desk with a model that has a unit, which `fdm.toml`, a job and an experiment name.
fn desk_with_unit() -> Desk {
    let desk = desk();
    let part =
        fdm::Model::from_text("lag.fdm", "model lag { input u; state x; der(x) = u - x; output y = x; }").unwrap();
    let test = std::env::current_exe().unwrap();
    let name = format!("{}fdm_fmu{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX);
    let library = fs::read(test.parent().unwrap().join(name)).unwrap();
    let contents = Contents { model: &part, version: Version::Two, library: &library, errors: &BTreeMap::new() };
    desk.write("lag.fmu", write(&contents).unwrap());
    desk.write("unit.fdm", "model m { input u; param k = 1; use fmu \"lag.fmu\" as lag(u = u); output y = k*lag.y; }");
    desk
}

#[test]
fn machine_code_in_a_model_that_only_a_file_names_wants_a_word() {
    let desk = desk_with_unit();
    desk.good("simulate unit.fdm --data run.csv");
    desk.write("fdm.toml", "model = \"unit.fdm\"\ndata = \"run.csv\"\n");
    let found = desk.refused("simulate");
    assert!(found.contains("fdm.toml names it") && found.contains("--allow-units"), "{found}");
    let typed = desk.good("simulate unit.fdm");
    assert_eq!(desk.good("simulate --allow-units"), typed);
    // the file does not say the word itself
    desk.write("fdm.toml", "model = \"unit.fdm\"\ndata = \"run.csv\"\n[options]\nallow-units = true\n");
    desk.refused("simulate");
    fs::remove_file(desk.path("fdm.toml")).unwrap();
    desk.write("job.toml", "command = 'fit'\nmodel = 'unit.fdm'\ndata = 'run.csv'\nstarts = 3\n");
    assert!(desk.refused("job plan job.toml -q --untimed").contains("--allow-units"));
    desk.good("job plan job.toml -q --untimed --allow-units");
    assert!(!desk.fdm("job run job.plan --out tasks -q").status.success());
    desk.good("job run job.plan --out tasks -q --allow-units");
    desk.write(
        "experiment.toml",
        "title = \"t\"\nsource = \"s\"\n[[record]]\nname = \"r\"\nfile = \"run.csv\"\n[[step]]\nname = \"a\"\nmodel = \"unit.fdm\"\n",
    );
    let found = desk.refused("reproduce .");
    assert!(found.contains("lag.fmu") && found.contains("--allow-units"), "{found}");
}

#[test]
fn a_record_without_a_model_is_judged_by_its_map() {
    const G: f64 = 9.806_65;
    let mut state = 1u64;
    // uniform within one of both sides, the same everywhere
    let mut noise = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    };
    let mut text = String::from("t [s],phi [deg],theta [deg],psi [deg],ax [m/s^2],ay [m/s^2],az [m/s^2]\n");
    for k in 0..600 {
        let t = 0.05 * f64::from(k);
        let (phi, theta, psi) = (0.3 * (0.9 * t).sin(), 0.2 * (0.6 * t).sin() + 0.05, 0.4 * (0.3 * t).sin());
        let force = [G * theta.sin(), -G * theta.cos() * phi.sin(), -G * theta.cos() * phi.cos()];
        let degrees = |v: f64| v.to_degrees();
        // east-north-up and forward-left-up
        let row = [degrees(phi), degrees(-theta), 90.0 - degrees(psi), force[0], -force[1], -force[2]];
        let cells: Vec<String> = row.iter().map(|v| format!("{:.5}", v + 0.05 * noise())).collect();
        text.push_str(&format!("{t:.2},{}\n", cells.join(",")));
    }
    let desk = Desk::with([("flown.csv", text)]);
    let findings = |found: &serde_json::Value| {
        let all = found["findings"].as_array().unwrap().clone();
        all.into_iter().filter(|f| f["severity"] == "finding").collect::<Vec<_>>()
    };
    let found = findings(&desk.json("doctor flown.csv --fix own.toml --json -q"));
    assert_eq!(found[0]["repair"]["line"], "frame = \"enu-flu\"", "{found:?}");
    let again = desk.json("doctor flown.csv --map-file own.toml --json -q");
    assert!(findings(&again).is_empty(), "{again}");
    assert!(again["records"].to_string().contains("are turned from"), "{again}");
    desk.write("slip.toml", desk.text("own.toml").replace("from = \"az\"", "from = \"azz\""));
    let said = desk.refused("doctor flown.csv --map-file slip.toml -q");
    assert!(said.contains("channel.az.from = \"azz\"") && said.contains("its columns are t [s], phi, "), "{said}");
}
