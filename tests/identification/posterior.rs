//! The sampler against reference posteriors of posteriordb (Magnusson et al.): lynx and hare, and a compartment with elimination by Michaelis and Menten.

use fdm::Model;
use fdm::estimate::Halt;
use fdm::posterior::{Given, Posterior, Samples, Sampling, sample};
use fdm::record::{ReadOptions, Run};
use fdm::simulate::{StepOptions, choose_steps};
use support::{model, repository};

fn drawn(model: &Model, runs: Vec<Run>, target: f64) -> Samples {
    let theta = model.definition().start();
    let steps = runs
        .iter()
        .map(|run| choose_steps(model.dynamics(), run, &theta, &StepOptions::default()).unwrap().steps)
        .collect();
    let noise = vec![(f64::NAN, false); model.layout().outputs];
    let theta = vec![theta; runs.len()];
    let posterior = Posterior::new(Given { model, runs, steps, theta, noise }).unwrap();
    let sampling = Sampling { chains: 4, draws: 500, warmup: 300, seed: 1, target, most_depth: 10 };
    sample(&posterior, &sampling, &Halt::default()).unwrap()
}

#[test]
fn lynx_and_hare_have_the_posterior_of_posteriordb() {
    let text = std::fs::read_to_string(repository().join("models/lynx_hare/model.fdm")).unwrap();
    // the noise as the reference has it: log-normal around e^-1, and the initial values as they are counted
    let end = text.rfind('}').unwrap();
    let noise = "param s1 = -1.4, s2 = -1.4; prior s1 ~ normal(-1, 1), s2 ~ normal(-1, 1); noise log_hare = exp(s1), log_lynx = exp(s2);
        param hares = exp(hare0), lynxes = exp(lynx0), sigma1 = exp(s1), sigma2 = exp(s2); }";
    let model = model(&format!("{}{noise}", &text[..end]));
    let (run, _) = model.read_run(repository().join("models/lynx_hare/run.csv"), &ReadOptions::default()).unwrap();
    // near the mode: the reference does not say where it began
    let mut params = model.definition().params.clone();
    for (name, value) in
        [("alpha", 0.54), ("beta", 0.027), ("gamma", 0.8), ("delta", 0.024), ("hare0", 3.52), ("lynx0", 1.77)]
    {
        params[model.definition().param(name).unwrap()].value = value;
    }
    let model = model.with_params(params);
    let samples = drawn(&model, vec![run], 0.8);
    let reference = std::fs::read_to_string(repository().join("models/lynx_hare/reference_posterior.csv")).unwrap();
    let names = ["alpha", "beta", "gamma", "delta", "hares", "lynxes", "sigma1", "sigma2"];
    let found = samples.parameters();
    for (name, line) in names.iter().zip(reference.lines().skip(1)) {
        let row: Vec<f64> = line.split(',').skip(1).map(|v| v.parse().unwrap()).collect();
        let p = found.iter().find(|p| p.name == *name).unwrap();
        // both means have a Monte Carlo error; the reference is of 10 000 draws that are nearly independent
        let error = p.error_of_mean.unwrap().hypot(row[1] / 100.0);
        assert!((p.mean - row[0]).abs() < 4.0 * error, "{name}: {} +- {error}, not {}", p.mean, row[0]);
        assert!((p.deviation / row[1] - 1.0).abs() < 0.12, "{name}: deviation {}, not {}", p.deviation, row[1]);
        assert!(p.r_hat.unwrap() < 1.01 && p.bulk.unwrap() > 300.0 && p.tail.unwrap() > 300.0, "{p:?}");
    }
    assert!(samples.chains(10).iter().all(|c| c.divergent == 0));
}

#[test]
fn a_compartment_with_cauchy_priors_has_the_posterior_of_posteriordb() {
    // half-Cauchy variates are ratios of half-normal ones; what the oral dose leaves in the gut is exp(-k_a t)
    let model = model(
        "model one_comp { time [h]; state C; const D = 30, V = 2;
        param a1 = 1 in [0, inf], a2 = 1 in [0, inf], m1 = 1 in [0, inf], m2 = 1 in [0, inf], v1 = 1 in [0, inf], v2 = 1 in [0, inf];
        param s1 = 0.3 in [0, inf], s2 = 1.5 in [0, inf];
        prior a1 ~ normal(0, 1), a2 ~ normal(0, 1), m1 ~ normal(0, 1), m2 ~ normal(0, 1), v1 ~ normal(0, 1), v2 ~ normal(0, 1);
        prior s1 ~ normal(0, 1), s2 ~ normal(0, 1);
        param k_a = a1/a2, K_m = m1/m2, V_m = v1/v2, sigma = s1/s2;
        der(C) = exp(-k_a*t)*D*k_a/V - V_m/V*C/(K_m + C);
        output log_C = log(C + 1e-12); noise log_C = sigma; }",
    );
    let measured = [
        5.708_122_648_652_15,
        7.101_260_750_720_86,
        8.385_206_784_266_51,
        9.790_082_498_833_81,
        13.439_040_923_924_5,
        11.447_898_759_770_2,
        11.212_428_269_683_7,
        11.426_921_768_257_7,
        12.243_285_943_840_1,
        13.820_180_410_893_8,
        13.840_867_074_604_2,
        11.422_291_744_251,
        10.503_194_308_184_3,
        11.912_145_224_296_5,
        14.084_998_078_131_2,
        10.550_514_552_391_7,
        10.190_553_935_187_7,
        12.223_227_259_082_1,
        11.729_065_304_782_1,
        12.271_939_653_599_6,
    ];
    let time: Vec<f64> = (0..=20).map(|k| 0.5 * f64::from(k)).collect();
    let y: Vec<f64> = std::iter::once(f64::NAN).chain(measured.iter().map(|c: &f64| c.ln())).collect();
    let run = model.run("r").times(time).samples("log_C", y).build().unwrap();
    let samples = drawn(&model, vec![run], 0.95);
    let found = samples.parameters();
    let of = |name: &str| found.iter().find(|p| p.name == name).unwrap();
    // mean and deviation of the reference; K_m has a tail whose mean no ten thousand draws settle
    for (name, mean, deviation) in
        [("k_a", 0.761_013, 0.077_900), ("V_m", 0.981_821, 0.563_288), ("sigma", 0.128_835, 0.023_401)]
    {
        let p = of(name);
        let error = p.error_of_mean.unwrap().hypot(deviation / 60.0);
        assert!((p.mean - mean).abs() < 4.0 * error, "{name}: {} +- {error}, not {mean}", p.mean);
    }
    assert!(of("k_a").r_hat.unwrap() < 1.03 && of("K_m").median < of("K_m").mean, "{:?}", of("K_m"));
}
