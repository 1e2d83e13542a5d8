//! Small models of every combination of what moves them, of subsystems, method, strategy and gaps: none ends in a panic, and a linear model's
//! response is that of the same equations stage by stage.

use fdm::equation_error::{RegressionOptions, regress};
use fdm::estimate::Continuation;
use fdm::record::Run;
use fdm::simulate::{Scheme, Simulator, Steps};
use fdm::{FitOptions, Model, Options, SpectralOptions, Work, fit, fit_filter, fit_spectra};
use support::{Normal, model};

/// How an input or a value of the run enters.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Entry {
    /// As a summand.
    Added,
    /// Declared and not used.
    Unused,
    /// There is none.
    None,
    /// A coefficient follows an input.
    Scheduled,
    /// A coefficient follows what the run brings (Arrhenius' law).
    Known,
}

const ENTRIES: [Entry; 5] = [Entry::Added, Entry::Unused, Entry::None, Entry::Scheduled, Entry::Known];

/// A model of so many subsystems, each a lag of its own; `text` may name the noise of equations.
fn text(entry: Entry, parts: usize, noise: bool) -> String {
    let declared = match entry {
        Entry::None => "",
        Entry::Known => "known T per run;",
        _ => "input u;",
    };
    let mut text = format!("model generated {{ {declared} param e = 0.4; ");
    for i in 0..parts {
        let rate = match entry {
            Entry::Scheduled => format!("k{i}*(1 + 0.2*u)"),
            Entry::Known => format!("k{i}*exp(e*(1 - 300/T))"),
            _ => format!("k{i}"),
        };
        let drive = if entry == Entry::Added && i == 0 { " + e*u" } else { "" };
        text += &format!("state x{i} = {}; param k{i} = 0.5; der(x{i}) = -{rate}*x{i}{drive}; ", 1 + i);
        text += &format!("output y{i} = x{i}{}; ", if i == 1 { " + 0.1*e" } else { "" });
        if noise {
            text += &format!("param s{i} = 0.1 in [1e-4, 1]; noise der(x{i}) = s{i}; ");
        }
    }
    if matches!(entry, Entry::Unused | Entry::None) {
        text = text.replace("output y0 = x0", "output y0 = x0 + 0*e");
    }
    text + "}"
}

/// The model at a temperature that its runs have, where it has one.
fn warm(text: &str) -> Model {
    let model = model(text);
    let mut params = model.definition().params.clone();
    params.iter_mut().filter(|p| p.quantity.name == "T").for_each(|p| p.value = 310.0);
    model.with_params(params)
}

/// Records that no such model explains, so that every way out is tried: a motion that grows, where the model's decay. Steps are long beside
/// the lags, so that there are more of them than samples.
fn records(model: &Model, runs: usize, gaps: bool) -> Vec<Run> {
    let (n, m, q) = (14, model.layout().inputs, model.layout().outputs);
    let of = |run: usize| {
        let mut normal = Normal(7 + run as u64);
        let time: Vec<f64> = (0..n).map(|k| 3.0 * k as f64).collect();
        let input = |k: usize| f64::from(u8::from(k % 5 > 2));
        let mut measured: Vec<f64> = (0..n * q).map(|k| 0.02 * k as f64 + 0.01 * normal.next()).collect();
        if gaps {
            measured.iter_mut().step_by(5).for_each(|z| *z = f64::NAN);
        }
        let output_gaps = (0..q).map(|o| measured.iter().skip(o).step_by(q).filter(|z| z.is_nan()).count()).collect();
        Run {
            name: format!("r{run}"),
            time,
            inputs: (0..n * m).map(input).collect(),
            held: vec![run == 1; m],
            measured,
            input_gaps: vec![0; m],
            stated: Vec::new(),
            output_gaps,
        }
    };
    (0..runs).map(of).collect()
}

/// All combinations of entry, subsystems, runs and gaps.
fn each(noise: bool, mut visit: impl FnMut(&Model, &[Run], &str)) {
    for entry in ENTRIES {
        for parts in [1, 2, 3] {
            for (runs, gaps) in [(1, false), (1, true), (2, true)] {
                let model = warm(&text(entry, parts, noise));
                let place = format!("{entry:?}, {parts} subsystems, {runs} runs, gaps: {gaps}");
                visit(&model, &records(&model, runs, gaps), &place);
            }
        }
    }
}

#[test]
fn no_combination_panics_by_output_error() {
    let strategies = [Continuation::Auto, Continuation::Never, Continuation::Shares(vec![0.3, 0.6])];
    each(false, |model, runs, place| {
        for continuation in &strategies {
            let options = Options { iterations: 12, total: Some(60), ..Options::default() };
            let options = FitOptions { options, continuation: continuation.clone(), ..FitOptions::default() };
            let said = fit(model, runs, &options, &Work::default()).map(|f| f.estimate.termination.to_string());
            let said = said.unwrap_or_else(|e| e.to_string());
            assert!(!said.is_empty(), "{place}");
        }
    });
}

#[test]
fn no_combination_panics_by_any_other_method() {
    each(false, |model, runs, place| {
        let spectral = fit_spectra(model, runs, &SpectralOptions::default(), &Work::default());
        let said = spectral.map(|f| f.estimate.termination.to_string()).unwrap_or_else(|e| e.to_string());
        assert!(!said.is_empty(), "{place}");
        let regressed = regress(model, runs, &RegressionOptions::default());
        assert!(regressed.map_or_else(|e| !e.to_string().is_empty(), |_| true), "{place}");
    });
    each(true, |model, runs, place| {
        let options = Options { iterations: 8, ..Options::default() };
        let filtered = fit_filter(model, runs, &FitOptions { options, ..FitOptions::default() }, &Work::default());
        let said = filtered.map(|f| f.fit.estimate.termination.to_string()).unwrap_or_else(|e| e.to_string());
        assert!(!said.is_empty(), "{place}");
    });
}

/// The equations with a summand that is nothing, and that nothing proves linear.
fn disguised(text: &str) -> Model {
    warm(&text.replacen("der(x0) = ", "der(x0) = 1e-300*x0*abs(x0) + ", 1))
}

#[test]
fn responses_are_those_of_the_same_equations_stage_by_stage() {
    let response = |model: &Model, run: &Run, steps: Steps| {
        let params = &model.definition().params;
        let columns: Vec<usize> = (0..params.len()).filter(|k| !params[*k].fixed).collect();
        let theta = model.definition().start();
        let mut simulator = Simulator::new(model.dynamics(), run, steps).unwrap();
        let cells = run.measured.len();
        let (mut alone, mut y) = (vec![0.0; cells], vec![0.0; cells]);
        let mut jacobian = vec![0.0; cells * columns.len().next_multiple_of(8)];
        simulator.simulate(&theta, &mut alone).unwrap();
        simulator.sensitivities(&theta, &columns, &mut y, &mut jacobian).unwrap();
        assert_eq!(alone, y, "with and without sensitivities the same bits");
        (y, jacobian)
    };
    let apart = |a: &[f64], b: &[f64]| {
        assert!(a.iter().chain(b).all(|v| v.is_finite()));
        a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    };
    // what a run brings has no value without its run
    for entry in ENTRIES.into_iter().filter(|entry| *entry != Entry::Known) {
        for parts in [1, 2, 3] {
            let plain = text(entry, parts, false);
            let (own, hidden) = (warm(&plain), disguised(&plain));
            // what a run brings is a coefficient like any other
            assert_eq!(own.layout().affine.rates, entry != Entry::Scheduled);
            for run in &records(&own, 2, true) {
                let want = response(&hidden, run, Steps::equal(Scheme::RungeKutta, 96));
                let mut all = vec![Steps::equal(Scheme::RungeKutta, 96)];
                if own.layout().affine.rates {
                    all.extend([1, 3].map(|per| Steps::equal(Scheme::ExactDiscretisation { subsystems: parts }, per)));
                }
                for steps in all {
                    let (y, jacobian) = response(&own, run, steps);
                    let (dy, dj) = (apart(&y, &want.0), apart(&jacobian, &want.1));
                    assert!(dy < 1e-8 && dj < 1e-8, "{entry:?}, {parts} subsystems: {dy:e} {dj:e}");
                }
            }
        }
    }
}
