//! Stiff models are fitted: Robertson's kinetics from poor starts, without noise and with it.

use fdm::Model;
use fdm::estimate::{Changes, Fit, FitOptions, Work, fit};
use fdm::record::{ReadOptions, Run, channels, read};
use fdm::simulate::Scheme;

const TRUE: [(&str, f64); 3] = [("k1", 0.04), ("k2", 3e7), ("k3", 1e4)];

fn robertson() -> (Model, Run) {
    let folder = support::repository().join("models/robertson");
    let model = Model::from_file(folder.join("model.fdm")).unwrap();
    let options = ReadOptions { every: 1, require_outputs: true, ..ReadOptions::default() };
    let (run, _) = read(&folder.join("run.csv"), &channels(model.definition()), &options).unwrap();
    (model, run)
}

fn fitted(model: &Model, run: &Run, start: [f64; 3]) -> Fit {
    let set = TRUE.iter().zip(start).map(|((name, _), value)| ((*name).to_string(), value)).collect();
    let options = FitOptions { changes: Changes { set, ..Changes::default() }, ..FitOptions::default() };
    fit(model, std::slice::from_ref(run), &options, &Work::default()).unwrap()
}

#[test]
fn robertson_is_found_without_noise() {
    let (model, run) = robertson();
    for start in [[0.4, 1e6, 300.0], [1.0, 1e5, 100.0], [0.01, 3e8, 1e3], [0.004, 3e8, 1e5]] {
        let found = fitted(&model, &run, start);
        assert!(found.estimate.is_good(), "{start:?}: {}", found.estimate.termination);
        assert_eq!(found.integration[0].steps.scheme(), Scheme::Radau);
        assert!(found.integration[0].error <= 1e-7, "{:?}", found.integration);
        for (name, value) in TRUE {
            let got = found.estimate.parameter(name, None).unwrap().value;
            assert!((got / value - 1.0).abs() < 1e-6, "{start:?}: {name} {got}");
        }
    }
}

/// 2 % of each share's largest value.
#[test]
fn robertson_is_found_within_its_errors() {
    let (model, mut run) = robertson();
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    let mut uniform = move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        ((state >> 11) as f64 + 0.5) / (1_u64 << 53) as f64
    };
    let size = |o: usize| run.measured.iter().skip(o).step_by(3).fold(0.0_f64, |m, y| m.max(y.abs()));
    let sizes = [size(0), size(1), size(2)];
    for (k, y) in run.measured.iter_mut().enumerate() {
        let normal = (-2.0 * uniform().ln()).sqrt() * (std::f64::consts::TAU * uniform()).cos();
        *y += 0.02 * sizes[k % 3] * normal;
    }
    let found = fitted(&model, &run, [0.2, 1e7, 2e3]);
    assert!(found.estimate.is_good(), "{}", found.estimate.termination);
    for (name, value) in TRUE {
        let p = found.estimate.parameter(name, None).unwrap();
        let (error, off) = (p.standard_error.unwrap(), (p.value - value).abs());
        assert!(off < 3.0 * error && error < 0.1 * value, "{name}: {} +- {error}", p.value);
    }
}
