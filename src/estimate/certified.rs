//! Certified nonlinear regressions: NIST Statistical Reference Datasets (public domain).

use super::specimen::{Closed, Sample, param, problem};
use super::{Noise, Options, ProblemRun, estimate};

/// Fits y(x) from a start and compares values, standard errors and residual deviation with certified ones.
fn check(sample: Sample, data: &[(f64, f64)], start: &[f64], certified: &[(f64, f64)], deviation: f64) {
    let x = data.iter().map(|d| d.1).collect();
    let measured = data.iter().map(|d| d.0).collect();
    let response = Box::new(Closed { x, q: 1, sample });
    let run = ProblemRun { name: "r".into(), response, measured, start: Vec::new() };
    let params = start.iter().enumerate().map(|(k, b)| param(&format!("b{}", k + 1), *b)).collect();
    let fit =
        estimate(&mut problem(params, vec![run]), &Options { noise: Noise::Diagonal, ..Options::default() }, &mut ())
            .expect("a possible problem");
    assert!(fit.is_good(), "{} {:?}", fit.termination, fit.parameters);
    for (p, (value, error)) in fit.parameters.iter().zip(certified) {
        assert!((p.value / value - 1.0).abs() < 1e-9, "{} from {start:?}: {} {value}", p.name, p.value);
        let got = p.standard_error.expect("determined");
        assert!((got / error - 1.0).abs() < 1e-8, "{} from {start:?}: {got} {error}", p.name);
    }
    let got = fit.noise.expect("estimated").at(0, 0).sqrt();
    assert!((got / deviation - 1.0).abs() < 1e-9, "{got} {deviation}");
}

/// y = b1 (1 - exp(-b2 x))
const RISE: Sample = |x, theta, y, d| {
    let e = (-theta[1] * x).exp();
    y[0] = theta[0] * (1.0 - e);
    d.copy_from_slice(&[1.0 - e, theta[0] * x * e]);
};

#[test]
fn misra1a() {
    let data = [
        (10.07, 77.6),
        (14.73, 114.9),
        (17.94, 141.1),
        (23.93, 190.8),
        (29.61, 239.9),
        (35.18, 289.0),
        (40.02, 332.8),
        (44.82, 378.4),
        (50.76, 434.8),
        (55.05, 477.3),
        (61.01, 536.8),
        (66.40, 593.1),
        (75.47, 689.1),
        (81.78, 760.0),
    ];
    let certified = [(2.3894212918e2, 2.7070075241), (5.5015643181e-4, 7.2668688436e-6)];
    for start in [[500.0, 0.0001], [250.0, 0.0005]] {
        check(RISE, &data, &start, &certified, 1.0187876330e-1);
    }
}

/// From the first start a straight step leads to where the exponential has died out; only a bent one comes back.
#[test]
fn boxbod() {
    let data = [(109.0, 1.0), (149.0, 2.0), (149.0, 3.0), (191.0, 5.0), (213.0, 7.0), (224.0, 10.0)];
    let certified = [(2.1380940889e2, 1.2354515176e1), (5.4723748542e-1, 1.0455993237e-1)];
    for start in [[1.0, 1.0], [100.0, 0.75]] {
        check(RISE, &data, &start, &certified, 1.7088072423e1);
    }
}

/// y = b1 x^b2
#[test]
fn danwood() {
    let power: Sample = |x, theta, y, d| {
        let p = x.powf(theta[1]);
        y[0] = theta[0] * p;
        d.copy_from_slice(&[p, theta[0] * p * x.ln()]);
    };
    let data = [(2.138, 1.309), (3.421, 1.471), (3.597, 1.490), (4.340, 1.565), (4.882, 1.611), (5.660, 1.680)];
    let certified = [(7.6886226176e-1, 1.8281973860e-2), (3.8604055871, 5.1726610913e-2)];
    for start in [[1.0, 5.0], [0.7, 4.0]] {
        check(power, &data, &start, &certified, 3.2853114039e-2);
    }
}

/// A rational function with a hard first start: y = b1 (x^2 + b2 x) / (x^2 + b3 x + b4).
#[test]
fn mgh09() {
    let rational: Sample = |x, theta, y, d| {
        let (above, below) = (x * x + theta[1] * x, x * x + theta[2] * x + theta[3]);
        y[0] = theta[0] * above / below;
        let down = -y[0] / below;
        d.copy_from_slice(&[above / below, theta[0] * x / below, down * x, down]);
    };
    let data = [
        (1.957000e-1, 4.0),
        (1.947000e-1, 2.0),
        (1.735000e-1, 1.0),
        (1.600000e-1, 0.5),
        (8.440000e-2, 0.25),
        (6.270000e-2, 0.167),
        (4.560000e-2, 0.125),
        (3.420000e-2, 0.1),
        (3.230000e-2, 0.0833),
        (2.350000e-2, 0.0714),
        (2.460000e-2, 0.0625),
    ];
    let certified = [
        (1.9280693458e-1, 1.1435312227e-2),
        (1.9128232873e-1, 1.9633220911e-1),
        (1.2305650693e-1, 8.0842031232e-2),
        (1.3606233068e-1, 9.0025542308e-2),
    ];
    for start in [[25.0, 39.0, 41.5, 39.0], [0.25, 0.39, 0.415, 0.39]] {
        check(rational, &data, &start, &certified, 6.6279236551e-3);
    }
}
