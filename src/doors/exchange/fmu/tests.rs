//! Units at work beside the simulation of fdm, and their derivatives beside differences.

#![allow(clippy::unwrap_used)]
#![allow(clippy::print_stdout, reason = "figures are to be seen")]

use super::{Instance, Kind, Refused, Snapshot};
use fdm_system::Model;
use fdm_system::record::Run;
use fdm_system::simulate::{Simulator, StepOptions, choose_steps};

fn model(text: &str) -> Model {
    Model::from_text("m.fdm", text).unwrap()
}

/// A record of inputs at these times; inputs are linear between them, or held.
fn record(model: &Model, time: &[f64], held: bool, input: impl Fn(f64, usize) -> f64) -> Run {
    let layout = model.layout();
    Run {
        name: "a".into(),
        time: time.to_vec(),
        inputs: time.iter().flat_map(|t| (0..layout.inputs).map(|k| input(*t, k)).collect::<Vec<_>>()).collect(),
        held: vec![held; layout.inputs],
        measured: vec![0.0; time.len() * layout.outputs],
        input_gaps: vec![0; layout.inputs],
        stated: Vec::new(),
        output_gaps: vec![0; layout.outputs],
    }
}

/// What fdm's own simulation gives (N by q), as exact as it can.
fn simulated(model: &Model, run: &Run) -> Vec<f64> {
    let theta = model.definition().start();
    let steps = choose_steps(model.dynamics(), run, &theta, &StepOptions::default().to(Some(1e-12))).unwrap();
    assert!(steps.error < 1e-9, "{}", steps.error);
    let mut y = vec![0.0; run.len() * model.layout().outputs];
    Simulator::new(model.dynamics(), run, steps.steps).unwrap().simulate(&theta, &mut y).unwrap();
    y
}

/// Reference of a kind of variable.
fn of(instance: &Instance, kind: Kind) -> u32 {
    instance.variables().of_kind(kind).unwrap()
}

/// An instance at the beginning of a run.
fn begun(model: &Model, run: &Run, start: f64, tolerance: f64) -> Instance {
    let mut instance = Instance::new(model);
    instance.set_up(start, Some(tolerance));
    for k in 0..model.layout().inputs {
        let known = model.definition().inputs[k].known;
        let input = of(&instance, if known { Kind::Known(k) } else { Kind::Input(k) });
        instance.set(input, run.inputs[k]).unwrap();
    }
    instance.begin().unwrap();
    instance
}

/// The step from sample k to the next, as a simulator takes it.
fn step(instance: &mut Instance, run: &Run, k: usize, start: f64) {
    let m = run.held.len();
    let h = run.time[k + 1] - run.time[k];
    for i in 0..m {
        let (a, b) = (run.inputs[k * m + i], run.inputs[(k + 1) * m + i]);
        let Some(input) = instance.variables().of_kind(Kind::Input(i)) else { continue };
        instance.set(input, a).unwrap();
        if !run.held[i] {
            instance.set_slope(input, (b - a) / h).unwrap();
        }
    }
    let at = instance.time();
    assert!((at - start - run.time[k]).abs() < 1e-9);
    instance.step(at, h).unwrap();
    for i in (0..m).filter(|i| run.held[*i]) {
        let Some(input) = instance.variables().of_kind(Kind::Input(i)) else { continue };
        instance.set(input, run.inputs[(k + 1) * m + i]).unwrap();
    }
}

/// Co-simulated outputs (N by q).
fn stepped(model: &Model, run: &Run, start: f64, tolerance: f64) -> Vec<f64> {
    let mut instance = begun(model, run, start, tolerance);
    let mut y = instance.outputs().unwrap().to_vec();
    for k in 0..run.len() - 1 {
        step(&mut instance, run, k, start);
        y.extend_from_slice(instance.outputs().unwrap());
    }
    y
}

/// Largest difference, each output beside its largest value.
fn apart(a: &[f64], b: &[f64], q: usize) -> f64 {
    let of = |k: usize| {
        let size = b.iter().skip(k).step_by(q).fold(1e-300_f64, |s, v| s.max(v.abs()));
        a.iter().zip(b).skip(k).step_by(q).map(|(a, b)| (a - b).abs() / size).fold(0.0, f64::max)
    };
    (0..q).map(of).fold(0.0, f64::max)
}

const DRIVEN: &str = "model driven { input u; param k = 9; state x = 0.4; state v = initial(u); der(x) = v; \
                      der(v) = u - k*sin(x) - 0.2*v*abs(v) + 0.1*sin(t); output angle = x; output rate = v + 0.1*u; }";
const STIFF: &str = "model kinetics { state a = 1; state b = 0; state c = 0; param k = 0.04, l = 3e7, m = 1e4; \
                     der(a) = -k*a + m*b*c; der(b) = k*a - m*b*c - l*b^2; der(c) = l*b^2; output y = a; output z = c; }";
const LATE: &str = "model late { input u; param tau = 0.37 fixed, lag = 0.21 fixed; state x = 0.5; state w = 0; \
                    der(x) = -1.3*delay(x, tau) + delay(u, lag); der(w) = delay(x, lag)*x - 0.5*w; \
                    output y = x; output z = w + delay(u, tau) + delay(x, lag); }";
const STOPPED: &str = "model stopped { input u; state x = 0; state y = 0; limit x in [-0.5, 0.8]; der(x) = u; \
                       der(y) = x - 0.3*y; output a = x; output b = y; }";

#[test]
fn responses_are_those_of_fdm() {
    let even: Vec<f64> = (0..81).map(|k| 0.05 * f64::from(k)).collect();
    let uneven: Vec<f64> = (0..60).map(|k| 0.1 * f64::from(k) + 0.02 * f64::from(k % 3)).collect();
    let decades: Vec<f64> =
        std::iter::once(0.0).chain((0..13).map(|k| 10.0_f64.powf(f64::from(k) / 2.0 - 2.0))).collect();
    let wave = |t: f64, _: usize| (1.7 * t).sin() + 0.4;
    let cases: [(&str, &str, &[f64], bool, f64); 7] = [
        ("driven", DRIVEN, &even, false, 1e-9),
        ("driven, held", DRIVEN, &uneven, true, 1e-9),
        ("stiff", STIFF, &decades, true, 1e-9),
        ("late", LATE, &even, false, 1e-9),
        ("late, held", LATE, &even, true, 1e-9),
        ("stopped, held", STOPPED, &even, true, 1e-6),
        ("stopped", STOPPED, &even, false, 1e-6),
    ];
    for (name, text, time, held, least) in cases {
        let model = model(text);
        let run = record(&model, time, held, wave);
        let found = stepped(&model, &run, 0.0, 1e-12);
        let off = apart(&found, &simulated_or_fine(&model, &run), model.layout().outputs);
        println!("{name}: {off:.1e}");
        assert!(off < least, "{name}: {off:e}");
    }
}

/// fdm's own simulation; where kinks leave it coarse, with many steps.
fn simulated_or_fine(model: &Model, run: &Run) -> Vec<f64> {
    let layout = model.layout();
    if layout.delayed.is_empty() && layout.limited.is_empty() {
        return simulated(model, run);
    }
    let mut y = vec![0.0; run.len() * layout.outputs];
    let theta = model.definition().start();
    Simulator::new(model.dynamics(), run, 512).unwrap().simulate(&theta, &mut y).unwrap();
    y
}

/// Closed form: a relay that was switched on at 0 is seen late by a first-order lag, whatever the steps.
#[test]
fn a_late_jump_is_seen_when_it_comes() {
    let model =
        model("model lag { input u; param tau = 0.33; state x = 0; der(x) = delay(u, tau) - x; output y = x; }");
    let mut instance = Instance::new(&model);
    instance.set_up(0.0, Some(1e-12));
    instance.begin().unwrap();
    let input = of(&instance, Kind::Input(0));
    let output = of(&instance, Kind::Output(0));
    for k in 0..40 {
        let t = 0.1 * f64::from(k);
        instance.set(input, 1.0).unwrap();
        instance.step(instance.time(), 0.1).unwrap();
        let exact = if t + 0.1 > 0.33 { 1.0 - (-(t + 0.1 - 0.33)).exp() } else { 0.0 };
        assert!((instance.get(output).unwrap() - exact).abs() < 1e-10, "{t}");
    }
}

/// Closed form: an integrator that rests at its limit until its input changes its sign in the middle of a step.
#[test]
fn a_limit_is_left_when_the_rate_turns() {
    let model = model("model m { input u; state x = 0; limit x in [-1, 0.3]; der(x) = u; output y = x; }");
    let mut instance = Instance::new(&model);
    let input = of(&instance, Kind::Input(0));
    instance.set(input, 1.0).unwrap();
    instance.begin().unwrap();
    for (h, exact) in [(1.05, 0.3 - 0.5 * 0.05 * 0.05), (0.95, 0.3 - 0.5)] {
        instance.set(input, 1.0 - instance.time()).unwrap();
        instance.set_slope(input, -1.0).unwrap();
        instance.step(instance.time(), h).unwrap();
        let x = instance.state_values()[0];
        assert!((x - exact).abs() < 1e-7, "{x} and {exact}");
    }
}

#[test]
fn a_run_may_begin_at_any_time_and_answers_are_the_same() {
    let model = model(DRIVEN);
    let time: Vec<f64> = (0..41).map(|k| 0.0625 * f64::from(k)).collect();
    let run = record(&model, &time, false, |t, _| t.cos());
    let off = apart(&stepped(&model, &run, 64.0, 1e-10), &stepped(&model, &run, 0.0, 1e-10), 2);
    assert!(off < 1e-9, "{off:e}");
}

/// States of the middle of a run, as values and as bytes, lead to the same bits.
#[test]
fn a_restored_state_goes_on_with_the_same_bits() {
    for text in [DRIVEN, STIFF, LATE, STOPPED] {
        let model = model(text);
        let time: Vec<f64> = (0..60).map(|k| 0.1 * f64::from(k)).collect();
        let run = record(&model, &time, true, |t, _| (3.0 * t).sin());
        let mut instance = begun(&model, &run, 0.0, 1e-8);
        (0..25).for_each(|k| step(&mut instance, &run, k, 0.0));
        let kept = instance.snapshot();
        let go_on = |instance: &mut Instance| -> Vec<u64> {
            (25..59)
                .flat_map(|k| {
                    step(instance, &run, k, 0.0);
                    instance.outputs().unwrap().iter().map(|y| y.to_bits()).collect::<Vec<_>>()
                })
                .collect()
        };
        let first = go_on(&mut instance);
        instance.restore(&kept).unwrap();
        assert_eq!(go_on(&mut instance), first);
        let bytes = kept.bytes().unwrap();
        let mut other = Instance::new(&model);
        other.restore(&Snapshot::from_bytes(&bytes).unwrap()).unwrap();
        assert_eq!(go_on(&mut other), first);
        // a part of them, or those of another unit, are refused
        for cut in [0, 1, bytes.len() / 2, bytes.len() - 1] {
            assert!(Snapshot::from_bytes(&bytes[..cut]).is_err_and(|e| e == Refused::NoState));
        }
        let stranger = super::tests::model("model o { state x = 1; der(x) = -x; output y = x; }");
        assert_eq!(Instance::new(&stranger).restore(&kept), Err(Refused::NoState));
    }
}

/// All derivatives that there are, by central differences of the unit's own values.
#[test]
fn derivatives_are_those_of_differences() {
    for (text, beginning) in
        [(DRIVEN, false), (DRIVEN, true), (LATE, false), (LATE, true), (STOPPED, false), (STIFF, false)]
    {
        let model = model(text);
        let time: Vec<f64> = (0..12).map(|k| 0.1 * f64::from(k)).collect();
        let run = record(&model, &time, false, |t, _| 0.5 + (2.0 * t).cos());
        let mut instance = match beginning {
            true => {
                let mut instance = Instance::new(&model);
                instance.set_up(0.0, None);
                (0..model.layout().inputs).for_each(|k| {
                    let input = of(&instance, Kind::Input(k));
                    instance.set(input, 0.3).unwrap();
                });
                instance
            }
            false => {
                let mut instance = begun(&model, &run, 0.0, 1e-10);
                (0..11).for_each(|k| step(&mut instance, &run, k, 0.0));
                instance
            }
        };
        let all: Vec<(u32, Kind)> =
            instance.variables().list.iter().enumerate().map(|(k, v)| (k as u32, v.kind)).collect();
        let wanted =
            |f: &dyn Fn(Kind) -> bool| all.iter().filter(|(_, kind)| f(*kind)).map(|(k, _)| *k).collect::<Vec<_>>();
        let unknowns = wanted(&|kind| {
            matches!(kind, Kind::Rate(_) | Kind::Output(_) | Kind::Indicator(_))
                || beginning && matches!(kind, Kind::State(_))
        });
        let knowns = wanted(&|kind| {
            matches!(kind, Kind::Parameter(_) | Kind::Input(_)) || !beginning && matches!(kind, Kind::State(_))
        });
        assert!(!unknowns.is_empty() && !knowns.is_empty());
        let mut nonzero = 0;
        let mut matrix = Vec::new();
        for known in &knowns {
            let mut exact = vec![0.0; unknowns.len()];
            instance.directional(&unknowns, &[*known], &[1.0], &mut exact).unwrap();
            let at = instance.get(*known).unwrap();
            let h = 1e-6 * at.abs().max(1e-3);
            let mut side = |value: f64| -> Vec<f64> {
                instance.set(*known, value).unwrap();
                unknowns.iter().map(|u| instance.get(*u).unwrap()).collect()
            };
            let (low, high) = (side(at - h), side(at + h));
            instance.set(*known, at).unwrap();
            for (k, exact) in exact.iter().enumerate() {
                let difference = (high[k] - low[k]) / (2.0 * h);
                // what rounding of the values leaves in their difference
                let rounding = 1e-15 * high[k].abs() / h;
                assert!(
                    (difference - exact).abs() <= 1e-7 * exact.abs().max(difference.abs()).max(1e-2) + 10.0 * rounding,
                    "{}, beginning {beginning}: {:?} by {:?}: {exact} and {difference}",
                    model.name(),
                    all[unknowns[k] as usize].1,
                    all[*known as usize].1
                );
                nonzero += usize::from(*exact != 0.0);
            }
            matrix.push(exact);
        }
        assert!(nonzero > 1, "{nonzero}");
        let seed: Vec<f64> = (0..unknowns.len()).map(|k| 0.3 + k as f64).collect();
        let mut adjoint = vec![0.0; knowns.len()];
        instance.adjoint(&unknowns, &knowns, &seed, &mut adjoint).unwrap();
        for (adjoint, column) in adjoint.iter().zip(&matrix) {
            let sum: f64 = column.iter().zip(&seed).map(|(a, b)| a * b).sum();
            assert!((adjoint - sum).abs() <= 1e-12 * sum.abs().max(1e-12));
        }
    }
}

/// Model exchange as a simulator does it, by steps of Runge and Kutta; events are located by halving.
fn exchanged(model: &Model, input: impl Fn(f64) -> f64, end: f64, h: f64) -> Vec<f64> {
    let mut instance = Instance::new(model);
    instance.set_up(0.0, None);
    let u = of(&instance, Kind::Input(0));
    instance.set(u, input(0.0)).unwrap();
    instance.begin().unwrap();
    let mut next = instance.update().unwrap().next;
    instance.enter_continuous().unwrap();
    let n = instance.states();
    let advance = |instance: &mut Instance, h: f64| {
        let (t, x) = (instance.time(), instance.state_values().to_vec());
        let mut rates = |at: f64, x: &[f64]| {
            instance.set_time(at);
            instance.set(u, input(at)).unwrap();
            instance.set_states(x).unwrap();
            instance.rates().unwrap().to_vec()
        };
        let moved = |by: f64, k: &[f64]| -> Vec<f64> { x.iter().zip(k).map(|(x, k)| x + by * k).collect() };
        let k1 = rates(t, &x);
        let k2 = rates(t + 0.5 * h, &moved(0.5 * h, &k1));
        let k3 = rates(t + 0.5 * h, &moved(0.5 * h, &k2));
        let k4 = rates(t + h, &moved(h, &k3));
        let end: Vec<f64> = (0..n).map(|i| x[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i])).collect();
        instance.set_time(t + h);
        instance.set(u, input(t + h)).unwrap();
        instance.set_states(&end).unwrap();
    };
    let signs = |instance: &mut Instance| {
        let mut z = vec![0.0; instance.indicators()];
        instance.all_indicators(&mut z).unwrap();
        z.iter().map(|z| *z > 0.0).collect::<Vec<_>>()
    };
    let mut y = instance.outputs().unwrap().to_vec();
    for k in 0..(end / h).round() as usize {
        let stop = h * (k + 1) as f64;
        while instance.time() < stop - 1e-12 {
            let t = instance.time();
            let until = match next {
                Some(event) if event > t + 1e-12 && event < stop => event,
                _ => stop,
            };
            let before = (signs(&mut instance), instance.snapshot());
            advance(&mut instance, until - t);
            let mut event = next == Some(until);
            if signs(&mut instance) != before.0 {
                let (mut low, mut high) = (0.0, until - t);
                while high - low > 1e-13 {
                    let middle = 0.5 * (low + high);
                    instance.restore(&before.1).unwrap();
                    advance(&mut instance, middle);
                    if signs(&mut instance) == before.0 { low = middle } else { high = middle }
                }
                instance.restore(&before.1).unwrap();
                advance(&mut instance, high);
                event = true;
            }
            instance.completed_step().unwrap();
            if event {
                instance.enter_event().unwrap();
                next = instance.update().unwrap().next;
                instance.enter_continuous().unwrap();
            }
        }
        y.extend_from_slice(instance.outputs().unwrap());
    }
    y
}

#[test]
fn model_exchange_gives_the_same_responses() {
    let wave = |t: f64| (1.7 * t).sin() + 0.4;
    let cases = [("driven", DRIVEN, 1e-5), ("late", LATE, 1e-4), ("stopped", STOPPED, 1e-4)];
    for (name, text, least) in cases {
        let model = model(text);
        let fine: Vec<f64> = (0..4001).map(|k| 0.001 * f64::from(k)).collect();
        let run = record(&model, &fine, false, |t, _| wave(t));
        let q = model.layout().outputs;
        let mut y = vec![0.0; run.len() * q];
        let theta = model.definition().start();
        Simulator::new(model.dynamics(), &run, 1).unwrap().simulate(&theta, &mut y).unwrap();
        let sampled: Vec<f64> = (0..401).flat_map(|k| y[10 * k * q..][..q].to_vec()).collect();
        let off = apart(&exchanged(&model, wave, 4.0, 0.01), &sampled, q);
        println!("{name}: {off:.1e}");
        assert!(off < least, "{name}: {off:e}");
    }
}

#[test]
fn what_cannot_be_done_is_said() {
    let model = model(
        "model m { input u; known T per run; param k = 1, tau = 0.1 in [0, 9]; state x = free; \
                       der(x) = k*u + T - delay(x, tau); output y = x; }",
    );
    let mut instance = Instance::new(&model);
    let of = |kind| of(&Instance::new(&model), kind);
    let said = |e: Refused| e.to_string();
    assert!(said(instance.set(of(Kind::Output(0)), 1.0).unwrap_err()).contains("`y` is computed by the unit"));
    assert!(said(instance.set(99, 1.0).unwrap_err()).contains("99"));
    assert!(said(instance.set(of(Kind::Input(0)), f64::NAN).unwrap_err()).contains("`u` is set to NaN"));
    instance.set(of(Kind::Known(1)), 2.0).unwrap();
    instance.begin().unwrap();
    assert!(said(instance.set(of(Kind::Known(1)), 1.0).unwrap_err()).contains("at the beginning"));
    assert_eq!(instance.get(of(Kind::Rate(0))), Ok(2.0));
    assert!(said(instance.step(5.0, 1.0).unwrap_err()).contains("begins at 5"));
    for _ in 0..20 {
        instance.step(instance.time(), 0.1).unwrap();
    }
    let tau = model.definition().param("tau").unwrap();
    instance.set(of(Kind::Parameter(tau)), 1.0).unwrap();
    assert!(said(instance.step(instance.time(), 0.1).unwrap_err()).contains("so much of the past was not kept"));
    instance.set(of(Kind::Parameter(tau)), 0.0).unwrap();
    assert!(said(instance.step(instance.time(), 0.1).unwrap_err()).contains("co-simulation needs a longer one"));
    instance.set(of(Kind::Parameter(tau)), -1.0).unwrap();
    assert!(said(instance.step(instance.time(), 0.1).unwrap_err()).contains("cannot look ahead"));
    let mut lost = Instance::new(&super::tests::model("model e { state x = 1; der(x) = x^2; output y = x; }"));
    lost.begin().unwrap();
    let refused = lost.step(0.0, 2.0).unwrap_err();
    assert!(matches!(refused, Refused::Diverged { .. } | Refused::NoStep { .. }), "{refused}");
    assert!(lost.time() > 0.99 && lost.time() < 1.0 + 1e-9, "{}", lost.time());
}
