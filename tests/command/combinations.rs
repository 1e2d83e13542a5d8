//! Methods, domains and optimizers that can be combined all run.

use std::fs;
use std::process::Output;
use tempfile::TempDir;

const MODEL: &str = "model motion {
  input u;
  state x = 0, v = 0;
  param k = 3 [1/s^2], d = 0.5 [1/s], b = 1.5;
  der(x) = v;
  der(v) = -k*x - d*v + b*u;
  output x_m = x, v_m = v;
}
";

/// A folder with a model and a run.
struct Desk(TempDir);

impl Desk {
    fn new() -> Self {
        let desk = Self(tempfile::tempdir().unwrap());
        let text = MODEL.replace(" [1/s^2]", "").replace(" [1/s]", "");
        desk.file("model.fdm", &text);
        let inputs: Vec<f64> = (0..241).map(|k| input(0.1 * f64::from(k))).collect();
        let rows = |cells: &dyn Fn(usize) -> String| {
            let rows = (0..inputs.len()).map(|k| format!("{},{}\n", 0.1 * k as f64, cells(k)));
            rows.collect::<String>()
        };
        desk.file("input.csv", &format!("t,u\n{}", rows(&|k| inputs[k].to_string())));
        let outputs = desk.good("simulate model.fdm --data input.csv --set k=4 --set d=0.8 --set b=2");
        let outputs: Vec<Vec<f64>> =
            outputs.lines().skip(1).map(|l| l.split(',').map(|c| c.parse().unwrap()).collect()).collect();
        let mut random = 0x2545_F491_4F6C_DD1D_u64;
        let mut noise = || {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            0.02 * ((random >> 11) as f64 / (1u64 << 53) as f64 - 0.5)
        };
        let noisy: Vec<String> = (0..inputs.len())
            .map(|k| format!("{},{},{}", inputs[k], outputs[k][1] + noise(), outputs[k][2] + noise()))
            .collect();
        desk.file("one.csv", &format!("t,u,x_m,v_m\n{}", rows(&|k| noisy[k].clone())));
        desk
    }

    fn file(&self, name: &str, text: &str) {
        fs::write(self.0.path().join(name), text).unwrap();
    }

    fn fdm(&self, words: &str) -> Output {
        support::fdm().args(words.split_whitespace()).current_dir(self.0.path()).output().unwrap()
    }

    fn good(&self, words: &str) -> String {
        let output = self.fdm(words);
        assert_eq!(output.status.code(), Some(0), "{words}: {}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    }
}

/// Steps of 3, 2, 1 and 1 units of time, again and again.
fn input(t: f64) -> f64 {
    match t % 10.0 {
        t if t < 3.0 || (5.0..6.0).contains(&t) => 1.0,
        t if t < 7.0 => -1.0,
        _ => 0.0,
    }
}

#[test]
fn methods_domains_and_optimizers_that_can_be_combined_run() {
    let desk = Desk::new();
    let fitted = |options: &str| {
        let result = desk.good(&format!("fit model.fdm --data one.csv {options} --json -q"));
        let result: serde_json::Value = serde_json::from_str(&result).unwrap();
        let parameters = result["parameters"].as_array().unwrap();
        parameters.iter().find(|p| p["name"] == "k").unwrap()["value"].as_f64().unwrap()
    };
    for options in [
        "--optimizer gauss-newton",
        "--optimizer nelder-mead",
        "--optimizer lbfgs",
        "--domain frequency",
        "--domain frequency --optimizer nelder-mead",
        "--domain frequency --optimizer lbfgs",
        "--domain frequency --start-values model",
        "--domain frequency --nonlinear measured-regressors",
        "--start-values equation-error --optimizer lbfgs",
    ] {
        let k = fitted(options);
        assert!((k - 4.0).abs() < 0.1, "{options}: {k}");
    }
    assert!((fitted("--domain frequency --optimizer lbfgs") - fitted("--domain frequency")).abs() < 1e-6);
    // without a sweep the responses are rough; what matters here is that all three end
    for optimizer in ["gauss-newton", "nelder-mead", "lbfgs"] {
        assert!(fitted(&format!("--method frequency-response --optimizer {optimizer}")).is_finite());
    }
    // equation error is what `fdm regress` does
    for (fit, regress) in [("", ""), ("--domain frequency --band 0.1:1.5", "--band 0.1:1.5")] {
        let fit = desk.good(&format!("fit model.fdm --data one.csv --method equation-error {fit} --json -q"));
        assert_eq!(fit, desk.good(&format!("regress model.fdm --data one.csv {regress} --json -q")));
    }
}
