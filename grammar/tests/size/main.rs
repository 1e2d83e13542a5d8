//! Nothing swells: what a model becomes grows with its text, counted in nodes and instructions, not in seconds.
#![allow(clippy::print_stdout, reason = "a study prints its figures")]

mod models;

use fdm_grammar::derive::Swollen;
use fdm_grammar::{Compiled, Schedule, Source, compile};
use models::{FAMILIES, Family};
use std::time::Instant;

fn compiled(text: &str) -> Compiled {
    compile(&Source::new("m.fdm", text)).unwrap_or_else(|e| panic!("{:?}", &e[..e.len().min(3)]))
}

/// Nodes of the graph, instructions of all programs.
fn size(compiled: &Compiled) -> (usize, usize) {
    let s = &compiled.schedule;
    let programs = [&s.prepare, &s.rates, &s.rates_and_partials, &s.outputs, &s.outputs_and_partials, &s.by_input];
    (compiled.model.graph.nodes().len(), programs.iter().map(|p| p.instructions.len()).sum())
}

/// What a model becomes when its text grows four times.
#[track_caller]
fn grows_with_its_text(name: &str, text: fn(usize) -> String, small: usize) {
    let [(nodes, instructions), (more, longer)] = [small, 4 * small].map(|n| size(&compiled(&text(n))));
    let proportional = |a: usize, b: usize| b <= 5 * a + 200;
    assert!(proportional(nodes, more), "{name}: from {nodes} to {more} nodes");
    assert!(proportional(instructions, longer), "{name}: from {instructions} to {longer} instructions");
    assert!(more < 20 * 4 * small, "{name}: {more} nodes for {}", 4 * small);
}

#[test]
fn nodes_and_instructions_grow_with_the_text() {
    for Family { name, text } in FAMILIES {
        grows_with_its_text(name, text, 150);
    }
    // ways that many parameters share
    grows_with_its_text("product", models::product, 400);
    grows_with_its_text("chain fed by parameters", |n| models::fed(n, n / 5), 500);
}

#[test]
fn ten_thousand_lets() {
    for k in [3, 4] {
        let Family { name, text } = &FAMILIES[k];
        let (nodes, instructions) = size(&compiled(&text(10_000)));
        assert!(nodes < 150_000 && instructions < 150_000, "{name}: {nodes} {instructions}");
    }
}

#[test]
fn five_hundred_states_and_two_thousand_parameters() {
    let made = compiled(&models::banded(500));
    assert_eq!((made.model.states.len(), made.model.params.len()), (500, 2_000));
    let patterns = &made.schedule.layout.patterns;
    assert_eq!((patterns.rates_by_state.len(), patterns.rates_by_param.len()), (1_500, 2_000));
    assert!(size(&made).1 < 20_000);
    let made = compiled(&models::full(120));
    assert_eq!(made.schedule.layout.patterns.rates_by_state.len(), 120 * 120);
    assert!(size(&made).0 < 60 * 120 && made.schedule.rates_and_partials.instructions.len() < 3 * 120 * 120);
}

/// Forward tangents choose, so that a chain of choices costs every parameter its whole length.
#[test]
fn what_swells_is_stopped() {
    let mut made = compiled(&models::clipped(100, 100));
    assert_eq!(Schedule::within(&mut made.model, 2_000).err(), Some(Swollen));
    assert!(Schedule::within(&mut made.model, 100_000).is_ok());
}

#[test]
#[ignore = "a study: release build"]
fn a_chain_of_twelve_million_choices_is_refused() {
    let text = models::clipped(12_000, 1_000);
    let findings = compile(&Source::new("m.fdm", text)).expect_err("twelve million choices");
    let told = &findings[0].message;
    assert!(findings.len() == 1 && told.contains("more than 4000000 operations"), "{findings:?}");
}

#[test]
#[ignore = "a study: release build"]
fn table() {
    let row = |name: &str, n: usize, text: &str| {
        let start = Instant::now();
        let made = compiled(text);
        let took = start.elapsed().as_secs_f64();
        let (nodes, instructions) = size(&made);
        println!("{name:42} {n:7} {:9} bytes {nodes:9} nodes {instructions:9} instructions {took:8.3} s", text.len());
    };
    for Family { name, text } in FAMILIES {
        for n in [1_000, 10_000] {
            row(name, n, &text(n));
        }
    }
    for n in [50, 100, 200, 500] {
        row("full", n, &models::full(n));
        row("product", 2 * n, &models::product(2 * n));
    }
    row("chain fed by 2,000 parameters", 10_000, &models::fed(10_000, 2_000));
    row("banded, 500 states, 2,000 parameters", 500, &models::banded(500));
}
