//! Reaction kinetics of the COPS collection and a predator with its prey: published figures, from poor starts.

use fdm::Model;
use fdm::estimate::{Changes, Fit, FitOptions, Work, fit};
use fdm::record::{ReadOptions, Run, channels, read};
use fdm::simulate::Simulator;
use std::path::PathBuf;

fn folder(system: &str) -> PathBuf {
    support::repository().join("models").join(system)
}

fn load(system: &str) -> (Model, Run) {
    let model = Model::from_file(folder(system).join("model.fdm")).unwrap();
    let (run, _) =
        read(&folder(system).join("run.csv"), &channels(model.definition()), &ReadOptions::default()).unwrap();
    (model, run)
}

fn squares(fit: &Fit) -> f64 {
    fit.estimate.runs.iter().flat_map(|r| &r.residuals).filter(|v| !v.is_nan()).map(|v| v * v).sum()
}

/// Starts: as the model says, all parameters times a factor, every other one up and down by ten.
fn starts(model: &Model) -> Vec<(String, Vec<(String, f64)>)> {
    let params = || model.definition().params.iter().map(|p| (p.quantity.name.clone(), p.value));
    let mut starts = Vec::new();
    for factor in [1.0, 10.0, 0.1, 100.0, 0.01] {
        starts.push((format!("times {factor}"), params().map(|(n, v)| (n, v * factor)).collect()));
    }
    for up in [0, 1] {
        let factor = |k: usize| if k % 2 == up { 10.0 } else { 0.1 };
        let mixed = params().enumerate().map(|(k, (n, v))| (n, v * factor(k))).collect();
        starts.push((format!("mixed, {up}"), mixed));
    }
    starts
}

/// Fits from all starts and prints a table; every sum of squares must satisfy `reached`.
fn from_poor_starts(system: &str, reached: impl Fn(f64) -> bool) -> Vec<Fit> {
    let (model, run) = load(system);
    let (mut fits, mut failures) = (Vec::new(), Vec::new());
    println!("{system}\nstart         sum of squares    corrections  evaluations  end");
    for (name, set) in starts(&model) {
        let options = FitOptions { changes: Changes { set, ..Changes::default() }, ..FitOptions::default() };
        let fit = fit(&model, std::slice::from_ref(&run), &options, &Work::default()).unwrap();
        let (e, sum) = (&fit.estimate, squares(&fit));
        let fallbacks: String = e.fallbacks.iter().map(|a| format!(", {a}")).collect();
        println!(
            "{name:12}  {sum:.10e}  {:11}  {:5} {:5}  {}{fallbacks}",
            e.iterations, e.evaluations.0, e.evaluations.1, e.termination
        );
        if !e.termination.is_good() || !reached(sum) {
            failures.push(format!("{system} from {name}: {sum:.10e}, {}", e.termination));
        }
        fits.push(fit);
    }
    assert!(failures.is_empty(), "{failures:#?}");
    fits
}

fn to_seven_digits(got: f64, want: f64) -> bool {
    (got / want - 1.0).abs() < 1e-7
}

fn values(fit: &Fit) -> Vec<f64> {
    fit.estimate.parameters.iter().map(|p| p.value).collect()
}

#[test]
fn pinene() {
    let fits = from_poor_starts("pinene", |sum| to_seven_digits(sum, 19.872_166_94));
    for (got, want) in values(&fits[0]).iter().zip([5.92585e-5, 2.96340e-5, 2.04729e-5, 27.44669e-5, 3.99791e-5]) {
        assert!((got / want - 1.0).abs() < 1e-4, "{got} {want}");
    }
}

#[test]
fn gas_oil() {
    let fits = from_poor_starts("gas_oil", |sum| to_seven_digits(sum, 5.236_595_8e-3));
    for (got, want) in values(&fits[0]).iter().zip([11.84674, 8.34452, 1.00144]) {
        assert!((got / want - 1.0).abs() < 1e-5, "{got} {want}");
    }
}

#[test]
fn methanol() {
    from_poor_starts("methanol", |sum| sum <= 9.0224e-3);
}

/// Batches that begin with different amounts of B tell how many of it one A takes.
#[test]
fn a_stoichiometric_coefficient_is_recovered() {
    let text = "model couples {
        known B0 per run [mol/l]; state A [mol/l] = 1, B [mol/l] = B0, C [mol/l];
        param k = 0.2 in [0, 10] [l/(mol*min)], n = 1 in [0.1, 5] [1];
        time [min];
        reactions { A + n*B -> C : k*A*B; }
        output A_m [mol/l] = A, B_m [mol/l] = B, C_m [mol/l] = C;
        noise A_m = 0.005, B_m = 0.005, C_m = 0.005; }";
    let model = support::model(text);
    let mut normal = support::Normal(5);
    let mut batch = |b0: f64| {
        let time: Vec<f64> = (0..25).map(|k| 0.5 * f64::from(k)).collect();
        let mut run = Run {
            name: format!("{b0}"),
            inputs: vec![b0; time.len()],
            held: vec![true],
            measured: vec![0.0; 3 * time.len()],
            input_gaps: vec![0],
            stated: Vec::new(),
            output_gaps: vec![0; 3],
            time,
        };
        let mut truth = model.definition().start();
        for (name, value) in [("k", 0.35), ("n", 1.6)] {
            truth[model.definition().param(name).unwrap()] = value;
        }
        let mut y = run.measured.clone();
        Simulator::new(model.dynamics(), &run, 8).unwrap().simulate(&truth, &mut y).unwrap();
        run.measured = y.iter().map(|y| y + 0.005 * normal.next()).collect();
        run
    };
    let runs = [batch(1.0), batch(2.0), batch(4.0)];
    let options = FitOptions::default().with_declared_noise(&model);
    let fit = fit(&model, &runs, &options, &Work::default()).unwrap();
    for (name, value) in [("k", 0.35), ("n", 1.6)] {
        let p = fit.estimate.parameter(name, None).unwrap();
        let error = p.standard_error.unwrap();
        assert!((p.value - value).abs() < 3.0 * error && error < 0.02 * value, "{name}: {} ± {error}", p.value);
    }
}

#[test]
fn lynx_and_hare_within_the_reference_posterior() {
    let (model, run) = load("lynx_hare");
    let fit = fit(&model, &[run], &FitOptions::default(), &Work::default()).unwrap();
    assert!(fit.estimate.is_good() && fit.estimate.determined_by_prior.is_empty(), "{}", fit.estimate.termination);
    let table = std::fs::read_to_string(folder("lynx_hare").join("reference_posterior.csv")).unwrap();
    let reference = |name: &str| {
        let row = table.lines().find(|l| l.starts_with(name)).unwrap();
        let cells: Vec<f64> = row.split(',').skip(1).map(|c| c.parse().unwrap()).collect();
        (cells[0], cells[1])
    };
    println!("              estimate  error     posterior mean  deviation");
    let check = |name: &str, value: f64, error: f64| {
        let (mean, deviation) = reference(name);
        println!("{name:12}  {value:.5}   {error:.5}   {mean:.5}         {deviation:.5}");
        assert!((value - mean).abs() < deviation, "{name}: {value} {mean}");
        assert!((0.7..1.3).contains(&(error / deviation)), "{name}: {error} {deviation}");
    };
    let rates = [("alpha", "theta[1]"), ("beta", "theta[2]"), ("gamma", "theta[3]"), ("delta", "theta[4]")];
    for (ours, theirs) in rates {
        let p = fit.estimate.parameter(ours, None).unwrap();
        check(theirs, p.value, p.standard_error.unwrap());
    }
    for (ours, theirs) in [("hare0", "z_init[1]"), ("lynx0", "z_init[2]")] {
        let p = fit.estimate.parameter(ours, None).unwrap();
        // from the logarithm to the number
        check(theirs, p.value.exp(), p.value.exp() * p.standard_error.unwrap());
    }
    let noise = fit.estimate.noise.unwrap();
    for (k, name) in ["sigma[1]", "sigma[2]"].into_iter().enumerate() {
        let (mean, deviation) = reference(name);
        assert!((noise.at(k, k).sqrt() - mean).abs() < deviation, "{name}");
    }
}
