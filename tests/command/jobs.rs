//! Jobs that many programs share: shards in any number and order, again and in part, killed and damaged; the result is that of the one
//! command, to the byte.

use serde_json::Value;
use std::fs;
use std::path::PathBuf;
use std::process::{Output, Stdio};
use std::time::Duration;
use support::Desk;
use support::command::{printed, said};

const DECAY: &str = "model decay { state x = free; param k = 0.5 in [0, 10] [1/s], c = 0.1;
    der(x) = -k*x; output y = x + c; }";
const BEND: &str = "model bend { state a = 3, b = 0;
  param k1 = 0.5 in [0.01, 10] [1/s], k2 = 0.1 in [0.01, 10] [1/s], c = 0 in [-1, 1];
  der(a) = -k1*a; der(b) = k1*a - k2*b/(1 + b^2); output y = b + c; }";

fn desk() -> Desk {
    let desk = Desk::with([("decay.fdm", DECAY), ("bend.fdm", BEND)]);
    for (name, rate) in [("one", 0.8), ("two", 0.6)] {
        let mut rows = String::from("t [s],y\n");
        for n in 0..60 {
            let (t, noise) = (0.1 * f64::from(n), 0.02 * (f64::from(n * n) * 0.7).sin());
            rows.push_str(&format!("{t},{}\n", 2.0 * (-rate * t).exp() + 0.2 + noise));
        }
        desk.write(&format!("{name}.csv"), rows);
    }
    desk
}

fn does(desk: &Desk, words: &str) -> Output {
    let output = desk.fdm(words);
    assert_eq!(output.status.code(), Some(0), "{words}: {}", said(&output));
    output
}

fn says(desk: &Desk, words: &str, code: i32, sentence: &str) {
    let output = desk.fdm(words);
    assert_eq!(output.status.code(), Some(code), "{words}: {}", said(&output));
    assert!(said(&output).contains(sentence), "{words}: {}", said(&output));
}

/// Files with results.
fn results(desk: &Desk, folder: &str) -> Vec<PathBuf> {
    let folder = desk.path(folder).join("results");
    let names = desk.names(folder.to_str().unwrap());
    // a program that was killed may leave one with a dot that it had not finished
    names.iter().filter(|name| name.ends_with(".results")).map(|name| folder.join(name)).collect()
}

const STUDY: &str = "command = 'study'\nmodel = 'decay.fdm'\ndata = ['one.csv']\nrepeats = 60\nseed = 4\njson = true\nquiet = true\nout = 'merged'\n";

#[test]
fn a_study_is_the_same_however_it_is_cut() {
    let desk = desk();
    let whole = does(&desk, "study decay.fdm --data one.csv --repeats 60 --seed 4 --json -q --out whole").stdout;
    let other = does(&desk, "study decay.fdm --data one.csv --repeats 60 --seed 4 --json -q --threads 1").stdout;
    assert_eq!(whole, other);
    desk.write("study.toml", STUDY);
    let text = printed(&does(&desk, "job plan study.toml -q"));
    for word in ["60 tasks", "60 repeats", "one task takes"] {
        assert!(text.contains(word), "{text}");
    }
    // from the last to the first, one of them twice at once
    let mut twice =
        desk.command("job run study.plan --shard 2/3 --out tasks -q").stderr(Stdio::null()).spawn().unwrap();
    for shard in ["3/3", "2/3", "1/3"] {
        does(&desk, &format!("job run study.plan --shard {shard} --out tasks -q"));
    }
    assert!(twice.wait().unwrap().success());
    assert_eq!(does(&desk, "job merge tasks").stdout, whole);
    for file in ["result.json", "study.json", "repeats.csv", "fit.txt"] {
        assert_eq!(fs::read(desk.path("whole").join(file)).unwrap(), fs::read(desk.path("merged").join(file)).unwrap());
    }
    // in part by one cutting, the rest by another
    for shard in ["1/7", "3/7", "2/2", "1/1"] {
        does(&desk, &format!("job run study.plan --shard {shard} --out mixed -q"));
    }
    assert_eq!(does(&desk, "job merge mixed").stdout, whole);
    // nothing is left to do: no file is added
    let before = results(&desk, "mixed");
    does(&desk, "job run study.plan --shard 4/9 --out mixed -q");
    assert_eq!(results(&desk, "mixed"), before);
    // more repeats go on from those that are there
    desk.write("study.toml", STUDY.replace("repeats = 60", "repeats = 70"));
    does(&desk, "job plan study.toml -q --untimed");
    says(&desk, "job run study.plan --out mixed", 0, "70 of 70 tasks");
    let whole = does(&desk, "study decay.fdm --data one.csv --repeats 70 --seed 4 --json -q").stdout;
    assert_eq!(does(&desk, "job merge mixed").stdout, whole);
}

#[test]
fn starts_and_profiles_are_the_same_however_they_are_cut() {
    let desk = desk();
    let jobs = [
        (
            "fit",
            "command = 'fit'\nmodel = 'bend.fdm'\ndata = ['one.csv', 'two.csv']\nstarts = 6\nseed = 3\njson = true\n",
            "fit bend.fdm --data one.csv --data two.csv --starts 6 --seed 3 --json -q",
        ),
        (
            "profile",
            "command = 'profile'\nmodel = 'decay.fdm'\ndata = 'one.csv'\nparameter = ['k', 'c']\njson = true\n",
            "profile decay.fdm --data one.csv --parameter k --parameter c --json -q",
        ),
    ];
    for (name, job, command) in jobs {
        let whole = desk.fdm(command);
        desk.write(&format!("{name}.toml"), job);
        does(&desk, &format!("job plan {name}.toml -q"));
        for shard in ["2/2", "1/2"] {
            does(&desk, &format!("job run {name}.plan --shard {shard} --out {name}.tasks -q"));
        }
        let merged = desk.fdm(&format!("job merge {name}.tasks --quiet"));
        assert_eq!(merged.status.code(), whole.status.code(), "{}", said(&merged));
        assert_eq!(printed(&merged), printed(&whole), "{name}");
    }
}

#[test]
fn the_repeats_of_an_experiment_are_the_same() {
    let desk = Desk::new();
    let models = support::repository().join("models");
    let command = format!("reproduce elovich --models {} --repeats 12 --noise-colour white --json", models.display());
    let whole = does(&desk, &command).stdout;
    let job = "command = 'reproduce'\nname = 'elovich'\nrepeats = 12\nnoise-colour = 'white'\njson = true\n";
    desk.write("job.toml", format!("{job}models = '{}'\n", models.display()));
    does(&desk, "job plan job.toml -q");
    for shard in ["3/3", "1/3", "2/3"] {
        does(&desk, &format!("job run job.plan --shard {shard} --out tasks -q"));
    }
    assert_eq!(does(&desk, "job merge tasks").stdout, whole);
}

/// Whole fits and diagnoses of several models and runs.
#[test]
fn a_batch_makes_the_folders_of_its_commands() {
    let desk = desk();
    desk.write(
        "all.toml",
        "command = 'fit'\nout = 'all'\nquiet = true\n[each]\nmodel = ['decay.fdm', 'bend.fdm']\ndata = ['*.csv']\n",
    );
    let told: Value = serde_json::from_slice(&does(&desk, "job plan all.toml -q --json").stdout).unwrap();
    assert_eq!(told["tasks"], 4);
    for shard in ["2/3", "3/3", "1/3"] {
        does(&desk, &format!("job run all.plan --shard {shard} --out tasks -q"));
    }
    let merged = desk.fdm("job merge tasks");
    assert!(merged.status.code().is_some_and(|code| code < 2), "{}", said(&merged));
    let text = printed(&merged);
    for (name, model, data) in [("one-decay", "decay", "one"), ("two-bend", "bend", "two")] {
        assert!(text.contains(&format!("{name}\n")), "{text}");
        let alone = desk.fdm(&format!("fit {model}.fdm --data {data}.csv --out alone-{name} -q"));
        assert!(text.contains(&printed(&alone)), "{text}");
        for file in ["result.json", "result.txt", "quality.json"] {
            let [one, other] =
                [format!("alone-{name}"), format!("all/{name}")].map(|f| desk.text(&format!("{f}/{file}")));
            assert_eq!(one, other, "{name}: {file}");
        }
    }
    desk.write(
        "why.toml",
        "command = 'diagnose'\nmodel = 'decay.fdm'\ndata = 'one.csv'\nmax-effects = 1\nout = 'why'\n",
    );
    does(&desk, "job plan why.toml -q --untimed");
    does(&desk, "job run why.plan --out why.tasks -q");
    let merged = desk.fdm("job merge why.tasks");
    let alone = desk.fdm("diagnose decay.fdm --data one.csv --max-effects 1 --out alone -q");
    assert_eq!((merged.status.code(), printed(&merged)), (alone.status.code(), printed(&alone)));
    assert_eq!(desk.text("why/diagnosis.json"), desk.text("alone/diagnosis.json"));
}

#[test]
fn killed_and_damaged_shards_lose_no_more_than_their_work() {
    let desk = desk();
    let whole = does(&desk, "study decay.fdm --data one.csv --repeats 800 --seed 4 --json -q").stdout;
    desk.write("study.toml", STUDY.replace("repeats = 60", "repeats = 800"));
    does(&desk, "job plan study.toml -q --untimed");
    let run = "job run study.plan --out tasks -q";
    let mut child = desk.command(run).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    for _ in 0..3000 {
        if desk.path("tasks/results").is_dir() && !results(&desk, "tasks").is_empty()
            || child.try_wait().unwrap().is_some()
        {
            break;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    let _ = child.kill();
    child.wait().unwrap();
    does(&desk, run);
    assert_eq!(does(&desk, "job merge tasks").stdout, whole);
    // torn, flipped, foreign: told, and done again
    let files = results(&desk, "tasks");
    let mut bytes = fs::read(&files[0]).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0x20;
    fs::write(&files[0], &bytes).unwrap();
    fs::write(desk.path("tasks/results/thesis.txt"), "all of it").unwrap();
    says(&desk, "job merge tasks", 1, "are missing: repeat");
    says(&desk, "job merge tasks", 1, "damaged: its content is not that of its name");
    let status: Value = serde_json::from_slice(&does(&desk, "job status tasks --json").stdout).unwrap();
    assert!(status["done"].as_u64().unwrap() < 800 && status["damaged"].as_array().unwrap().len() == 2, "{status}");
    says(&desk, run, 0, "thesis.txt: not a file of fdm");
    fs::write(&files[0], &fs::read(&files[0]).unwrap()[..40]).unwrap();
    does(&desk, run);
    assert_eq!(does(&desk, "job merge tasks").stdout, whole);
}

#[test]
fn other_plans_other_programs_and_other_work_are_refused() {
    let desk = desk();
    desk.write("study.toml", STUDY);
    does(&desk, "job plan study.toml -q --untimed");
    does(&desk, "job run study.plan --shard 1/2 --out tasks -q");
    says(&desk, "job merge tasks", 1, "30 of 60 tasks are missing: repeat 2, repeat 4");
    // another seed is another plan
    desk.write("study.toml", STUDY.replace("seed = 4", "seed = 5"));
    does(&desk, "job plan study.toml -q --untimed -o other.plan");
    says(&desk, "job run other.plan --out tasks", 2, "results of another plan");
    does(&desk, "job run other.plan --shard 2/2 --out other -q");
    for file in results(&desk, "other") {
        fs::copy(&file, desk.path("tasks/results").join(file.file_name().unwrap())).unwrap();
    }
    says(&desk, "job merge tasks", 2, "results of another plan; remove the file");
    for file in results(&desk, "other") {
        fs::remove_file(desk.path("tasks/results").join(file.file_name().unwrap())).unwrap();
    }
    does(&desk, "job run study.plan --shard 2/2 --out tasks -q");
    // a byte behind the end makes another program that does the same
    let copy = desk.path("fdm-copy");
    fs::copy(support::command::fdm().get_program(), &copy).unwrap();
    let mut bytes = fs::read(&copy).unwrap();
    bytes.push(0);
    fs::write(&copy, bytes).unwrap();
    let other = |words: &str| {
        std::process::Command::new(&copy).args(words.split_whitespace()).current_dir(desk.folder()).output().unwrap()
    };
    let refused = other("job run study.plan --out tasks");
    assert_eq!(refused.status.code(), Some(2), "{}", said(&refused));
    assert!(said(&refused).contains("another build of fdm"), "{}", said(&refused));
    assert!(said(&other("job merge tasks")).contains("another build of fdm"));
    // the data have changed since
    desk.write("one.csv", desk.text("one.csv").replacen("2.2", "2.3", 1));
    fs::remove_dir_all(desk.path("tasks/results")).unwrap();
    says(&desk, "job run study.plan --out tasks", 2, "not what was planned: another data of run `one`");
    desk.write("study.plan", desk.text("study.plan").replace("\"tasks\": 60", "\"tasks\": 6"));
    says(&desk, "job run study.plan --out tasks", 2, "changed or torn");
}

#[test]
fn a_job_that_cannot_be_done_is_told_before_it_is_shared() {
    let desk = desk();
    let plan = |job: &str, sentence: &str| {
        desk.write("job.toml", job);
        says(&desk, "job plan job.toml -q", 2, sentence);
        assert!(!desk.path("job.plan").exists());
    };
    plan("command = 'study'\nmodel = 'decay.fdm'\ndata = 'three.csv'\n", "three.csv");
    plan("command = 'study'\nmodel = 'decay.fdm'\ndata = 'one.csv'\nrepeats = 1\n", "--repeats");
    plan("command = 'study'\nmodel = 'decay.fdm'\ndata = 'one.csv'\nrepeat = 10\n", "did you mean `repeats`?");
    plan("command = 'simulate'\nmodel = 'decay.fdm'\n", "expected fit, study, profile, diagnose, reproduce");
    plan("command = 'fit'\nmodel = 'decay.fdm'\ndata = 'one.csv'\nmethod = 'equation-error'\n", "at once");
    desk.write("job.toml", STUDY);
    desk.write("job.plan", "my own");
    says(&desk, "job plan job.toml -q", 2, "--force");
    says(&desk, "job status tasks", 2, "no job is worked on here");
    fs::remove_file(desk.path("job.plan")).unwrap();
    does(&desk, "job plan job.toml -q --untimed");
    says(&desk, "job run job.plan --shard 3/2 --out tasks", 2, "expected I/N");
    says(&desk, "job run job.toml --out tasks", 2, "this is no plan");
    assert!(!desk.path("tasks").exists());
}

/// Every engine's script is written, and what it starts is understood under the variables that it sets.
#[test]
fn shards_are_those_of_the_engine() {
    let desk = desk();
    desk.write("study.toml", STUDY);
    for engine in ["parallel", "slurm", "hq", "dask", "ray", "mpi", "k8s"] {
        let text = printed(&does(&desk, &format!("job plan study.toml -q --untimed --shards 4 --for {engine}")));
        assert!(text.contains("script: "), "{text}");
    }
    let environments: [&[(&str, &str)]; 4] = [
        &[("SLURM_ARRAY_TASK_ID", "1"), ("SLURM_ARRAY_TASK_MIN", "1"), ("SLURM_ARRAY_TASK_MAX", "4")],
        &[("JOB_COMPLETION_INDEX", "1")],
        &[("HQ_TASK_ID", "3")],
        &[("PBS_ARRAY_INDEX", "4")],
    ];
    for (k, environment) in environments.iter().enumerate() {
        let mut command = desk.command("job run study.plan --shard auto/4 --out tasks");
        let output = command.envs(environment.iter().copied()).output().unwrap();
        assert!(said(&output).contains(&format!("15 of 15 tasks of shard {}/4", k + 1)), "{}", said(&output));
    }
    let mut command = desk.command("job run study.plan --shard auto --out tasks");
    let ranks = [("OMPI_COMM_WORLD_RANK", "1"), ("OMPI_COMM_WORLD_SIZE", "2")];
    let output = command.envs(ranks).output().unwrap();
    assert!(said(&output).contains("30 of 30 tasks of shard 2/2"), "{}", said(&output));
    says(&desk, "job run study.plan --shard auto --out tasks", 2, "no engine says");
    let text = printed(&does(&desk, "job status tasks --report page.html"));
    assert!(text.contains("60 of 60 tasks are done"), "{text}");
    assert!(desk.text("page.html").contains("Every task is done"));
}

/// An engine that ends a program, or a time limit: what was done is kept, and the exit code asks for another attempt.
#[cfg(unix)]
#[test]
fn a_shard_that_is_told_to_end_keeps_what_it_has() {
    let desk = desk();
    desk.write("study.toml", STUDY.replace("repeats = 60", "repeats = 1000000"));
    does(&desk, "job plan study.toml -q --untimed");
    let child = desk.command("job run study.plan --out tasks").stderr(Stdio::piped()).spawn().unwrap();
    let told = || desk.names("tasks").iter().any(|name| name.starts_with(".shard-") && name.ends_with(".progress"));
    for _ in 0..3000 {
        if desk.path("tasks/results").is_dir() && !results(&desk, "tasks").is_empty() && told() {
            break;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    let text = printed(&does(&desk, "job status tasks"));
    assert!(text.contains("at work"), "{text}");
    let pid = rustix::process::Pid::from_child(&child);
    rustix::process::kill_process(pid, rustix::process::Signal::TERM).unwrap();
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    let status: Value = serde_json::from_slice(&does(&desk, "job status tasks --json").stdout).unwrap();
    let done = status["done"].as_u64().unwrap();
    assert!(done > 0 && status["shards"].as_array().unwrap().is_empty(), "{status}");
    assert!(said(&output).contains(&format!("{done} of 1000000 tasks")), "{}", said(&output));
    says(&desk, "job run study.plan --out tasks --time-limit 1s", 1, "of 1000000 tasks");
}
