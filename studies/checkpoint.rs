//! A checkpointed multi-start, killed at 20 random moments one after the other; a table of the moments, and the comparison
//! of the final bits. `cargo test --release --manifest-path studies/Cargo.toml --test studies checkpoint:: -- --ignored --nocapture`

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{RngCore, SeedableRng};
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

const MODEL: &str = "model bend \"two rates that are hard to tell apart\" {
  state a = 3, b = 0;
  param k1 = 0.5 in [0.01, 10] [1/s], k2 = 0.1 in [0.01, 10] [1/s], c = 0 in [-1, 1];
  der(a) = -k1*a;
  der(b) = k1*a - k2*b/(1 + b^2);
  output y = b + c;
}
";

const KILLS: usize = 20;

fn command(folder: &Path, words: &str) -> Command {
    let mut command = support::fdm();
    command.args(words.split_whitespace()).current_dir(folder);
    command
}

fn write(folder: &Path) {
    fs::write(folder.join("model.fdm"), MODEL).unwrap();
    let mut rows = String::from("t [s],y\n");
    for n in 0..4000 {
        let t = 0.0025 * f64::from(n);
        let y = 3.0 * ((-0.3 * t).exp() - (-1.2 * t).exp()) + 0.02 * f64::from(n * n).sin();
        rows.push_str(&format!("{t},{y}\n"));
    }
    fs::write(folder.join("run.csv"), rows).unwrap();
}

/// Files of the checkpoint, and how many of them are finished starts or iterations in progress.
fn census(folder: &Path) -> usize {
    fs::read_dir(folder).map_or(0, |entries| {
        let names = entries.flatten().map(|e| e.file_name().to_string_lossy().into_owned());
        names.filter(|n| n.starts_with("start-") && n.ends_with(".1")).count()
    })
}

#[test]
#[ignore = "long: kills a fit at 20 random moments"]
fn twenty_kills_at_random_moments_and_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let desk = folder.path();
    write(desk);
    let steps = if cfg!(debug_assertions) { 4 } else { 60 };
    let fit = format!("fit model.fdm --data run.csv --json -q --steps {steps} --starts 24 --seed 11");
    let begun = Instant::now();
    let whole = command(desk, &fit).output().unwrap();
    let lasts = begun.elapsed();
    println!("without an interruption: {lasts:.2?}, {} bytes of JSON", whole.stdout.len());
    println!("{:>4} {:>12} {:>8} {:>15}", "kill", "after [s]", "alive", "starts on disk");
    let mut random = ChaCha8Rng::seed_from_u64(2024);
    let kept = format!("{fit} --checkpoint kept");
    let (mut kills, mut tries) = (0, 0);
    while kills < KILLS && tries < 10 * KILLS {
        tries += 1;
        let mut child = command(desk, &kept).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        // short stretches, so that twenty of them fit into one fit
        let moment = lasts.mul_f64(0.09 * random.next_u32() as f64 / u32::MAX as f64) + Duration::from_millis(2);
        std::thread::sleep(moment);
        let alive = child.try_wait().unwrap().is_none();
        child.kill().unwrap();
        child.wait().unwrap();
        kills += usize::from(alive);
        println!("{kills:>4} {:>12.4} {alive:>8} {:>15}", moment.as_secs_f64(), census(&desk.join("kept")));
        if !alive {
            // it had ended: from the beginning again
            fs::remove_dir_all(desk.join("kept")).unwrap();
        }
    }
    let begun = Instant::now();
    let after = command(desk, &kept).output().unwrap();
    println!("the last one to the end: {:.2?}", begun.elapsed());
    let same = after.stdout == whole.stdout && after.status.code() == whole.status.code();
    println!("{kills} kills, final bits the same: {same}");
    assert!(same && kills == KILLS);
}
