//! Models that fit the grammar: the tape and machine code give the same bits, and every partial is the one that a
//! complex step finds.
#![no_main]

use arbitrary::Unstructured;
use fdm::code::{Engine, Nominal, compile, verify};
use fdm::dynamics::{Dynamics, Point, Workspace};
use fdm_fuzz::{bits, numbers};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let Ok(model) = fdm_fuzz::Model::arbitrary(&mut Unstructured::new(data)) else { return };
    let text = model.text();
    let Some(compiled) = fdm_fuzz::compile(&text) else { return };
    let (tape, jit) = (compile(&compiled.schedule, Engine::Tape), compile(&compiled.schedule, Engine::Jit));
    let theta = compiled.model.start();
    for seed in 0..4 {
        assert_eq!(at_a_point(&*tape, &theta, seed), at_a_point(&*jit, &theta, seed), "{text}");
    }
    let verdict = verify(&compiled.model, &compiled.schedule, &Nominal::start(&compiled.model));
    // where something overflows on the way, infinity times nothing is NaN: everyone sees that, and `fdm check` tells it
    // and beyond that size a sine has no digits left, so that neither number means anything
    const LARGEST: f64 = 1e15;
    let wrong: Vec<_> = verdict
        .failures
        .iter()
        .filter(|f| !f.symbolic.is_nan() && f.symbolic.abs().min(f.numeric.abs()) < LARGEST)
        .collect();
    assert!(wrong.is_empty(), "{text}\n{wrong:?}");
});

/// Everything that an engine computes at a point, with one NaN.
fn at_a_point(dynamics: &dyn Dynamics, theta: &[f64], seed: u64) -> Vec<u64> {
    let layout = dynamics.layout();
    let mut work = Workspace::new(dynamics);
    let mut known = vec![0.0; layout.known];
    dynamics.prepare(theta, &mut known, &mut work);
    let mut number = numbers(seed);
    let x: Vec<f64> = (0..layout.states).map(|_| number()).collect();
    let drive: Vec<f64> = (0..layout.drive()).map(|_| number()).collect();
    let at = Point { t: number().abs(), x: &x, drive: &drive, known: &known };
    let mut all = known.clone();
    let mut rates = vec![0.0; layout.rate_slots()];
    dynamics.rates_and_partials(at, &mut rates, &mut work);
    let mut outputs = vec![0.0; layout.output_slots()];
    dynamics.outputs_and_partials(at, &mut outputs, &mut work);
    let mut inputs = vec![0.0; layout.input_slots()];
    dynamics.by_input(at, &mut inputs, &mut work);
    for part in [rates, outputs, inputs] {
        all.extend(part);
    }
    bits(&all)
}
