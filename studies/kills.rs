//! Every verb that writes: a fault of the disk at every operation on files, in every way, and 10,000 kills at random moments
//! (`FDM_KILLS` says how many). Every place holds the old result or the new one, equal to the bit to that of an unbroken run, and
//! files of others are what they were.
//! `cargo test --release --manifest-path studies/Cargo.toml --test studies kills:: -- --ignored --nocapture`

use support::writing::{FORMS, Table};

/// The studio, killed at 200 random moments of clicks that write.
#[test]
#[ignore = "long: minutes"]
fn a_studio_that_is_killed_loses_nothing_that_it_answered_for() {
    println!("{} of 200 kills while it was at work: nothing lost", support::studio::kills(200, 2026));
}

#[test]
#[ignore = "long: thousands of faults and ten thousand kills"]
fn faults_and_kills_of_every_verb_lose_nothing() {
    let table = Table::new();
    let mut sum = 0;
    println!("{:42} faults", "verb and options");
    for (k, form) in FORMS.iter().enumerate() {
        let kinds = ["nothing", "torn", "done", "dies:nothing", "dies:torn", "dies:done"];
        let count: usize = kinds.iter().map(|kind| table.faults(k, kind, 1)).sum();
        println!("{:42} {count:6}", form.name);
        sum += count;
    }
    println!("{:42} {sum:6}", "together");
    let count = std::env::var("FDM_KILLS").map_or(10_000, |n| n.parse().unwrap());
    let killed = table.kills(count, 2026);
    println!("{:42}  kills", "verb and options");
    killed.iter().for_each(|(name, count)| println!("{name:42} {count:6}"));
    println!("{:42} {:6}", "together", killed.values().sum::<usize>());
}
