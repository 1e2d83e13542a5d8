//! Stiff problems whose solutions are published to many digits: Mazzia & Magherini, Test Set for Initial Value Problem Solvers,
//! release 2.4 (2008); Hairer & Wanner II, IV.10. Tolerances are what steps chosen for 1e-8 of an output's range give.

use super::tests::{model, run};
use crate::simulate::{Scheme, Simulator, choose_steps_by};

/// Ends of the run against published digits, each as a part of the output's range; and how many steps were taken.
fn check(text: &str, times: &[f64], published: &[f64], most: usize, tolerance: f64) {
    let model = model(text);
    let q = model.layout().outputs;
    let run = run(times.to_vec(), q);
    let theta = model.definition().start();
    let chosen = choose_steps_by(model.dynamics(), &run, &theta, Some(Scheme::Radau)).expect("suited");
    assert!(chosen.error <= 1e-8 && chosen.steps.total(times.len()) <= most, "{} {:e}", chosen.steps, chosen.error);
    let mut y = vec![0.0; times.len() * q];
    let mut simulator = Simulator::new(model.dynamics(), &run, chosen.steps.clone()).expect("suited");
    simulator.simulate(&theta, &mut y).expect("finite");
    for (o, want) in published.iter().enumerate() {
        let column = || y.iter().skip(o).step_by(q).copied();
        let range = column().fold(f64::NEG_INFINITY, f64::max) - column().fold(f64::INFINITY, f64::min);
        let got = y[(times.len() - 1) * q + o];
        let error = (got - want).abs() / range.max(want.abs());
        assert!(error < tolerance, "output {o}: {got:e} {want:e}, {error:.1e} with {}", chosen.steps);
    }
}

#[test]
fn hires() {
    let text = "model hires {
        state a = 1, b, c, d, e, f, g, h = 0.0057;
        der(a) = -1.71*a + 0.43*b + 8.32*c + 0.0007; der(b) = 1.71*a - 8.75*b; der(c) = -10.03*c + 0.43*d + 0.035*e;
        der(d) = 8.32*b + 1.71*c - 1.12*d; der(e) = -1.745*e + 0.43*f + 0.43*g;
        der(f) = -280*f*h + 0.69*d + 1.71*e - 0.43*f + 0.69*g; der(g) = 280*f*h - 1.81*g; der(h) = -280*f*h + 1.81*g;
        output oa = a; output ob = b; output oc = c; output od = d; output oe = e; output of = f; output og = g; output oh = h; }";
    let published = [
        0.737_131_257_332_566_8e-3,
        0.144_248_572_631_618_5e-3,
        0.588_872_974_096_757_5e-4,
        0.117_565_134_328_314_9e-2,
        0.238_635_619_883_133_1e-2,
        0.623_896_825_274_279_6e-2,
        0.284_999_839_518_576_9e-2,
        0.285_000_160_481_423_1e-2,
    ];
    check(text, &[0.0, 321.8122], &published, 400, 1e-7);
}

#[test]
fn van_der_pol() {
    let text = "model van_der_pol {
        state y = 2, z; der(y) = z; der(z) = ((1 - y^2)*z - y)/1e-6; output oy = y; output oz = z; }";
    check(text, &[0.0, 0.5, 1.0, 1.5, 2.0], &[1.706_167_732_170_483, -0.892_809_701_024_797_5], 2000, 1e-6);
}

#[test]
fn oregonator() {
    let text = "model oregonator {
        state x = 1, y = 2, z = 3;
        der(x) = 77.27*(y + x*(1 - 8.375e-6*x - y)); der(y) = (z - (1 + x)*y)/77.27; der(z) = 0.161*(x - z);
        output ox = x; output oy = y; output oz = z; }";
    let published = [0.100_081_487_031_852_3e1, 0.122_817_852_154_991_7e4, 0.132_055_494_284_670_6e3];
    check(text, &[0.0, 90.0, 180.0, 270.0, 360.0], &published, 2500, 1e-6);
}

#[test]
fn robertson_to_the_end() {
    let text = "model robertson {
        state a = 1, b, c;
        der(a) = -0.04*a + 1e4*b*c; der(b) = 0.04*a - 1e4*b*c - 3e7*b^2; der(c) = 3e7*b^2;
        output la = log(a); output lb = log(b + 1e-30); output oc = c; }";
    let published = [0.208_334_014_970_125_5e-7_f64.ln(), 0.833_336_077_033_471_3e-13_f64.ln(), 0.999_999_979_166_505];
    check(text, &[0.0, 1.0, 1e3, 1e6, 1e9, 1e11], &published, 1000, 1e-6);
}
