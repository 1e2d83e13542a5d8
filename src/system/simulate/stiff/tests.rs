//! Order, stiffness and sensitivities of the implicit method.
//!
//! Stiff problems whose solutions are published to many digits: Mazzia & Magherini, Test Set for Initial Value Problem Solvers,
//! release 2.4 (2008); Hairer & Wanner II, IV.10. Tolerances are what steps chosen for 1e-8 of an output's range give.

use crate::Model;
use crate::record::Run;
use crate::simulate::{Scheme, Simulator, StepOptions, Steps, choose_steps};

/// A run without inputs.
pub(super) fn run(time: Vec<f64>, outputs: usize) -> Run {
    let measured = vec![f64::NAN; time.len() * outputs];
    let (inputs, held, input_gaps, output_gaps) = (Vec::new(), Vec::new(), Vec::new(), vec![0; outputs]);
    Run { name: "r".into(), time, inputs, held, measured, input_gaps, stated: Vec::new(), output_gaps }
}

pub(super) fn model(text: &str) -> Model {
    Model::from_text("test.fdm", text).unwrap_or_else(|e| panic!("{e}"))
}

/// The response with these steps at the model's start values.
fn response(model: &Model, run: &Run, steps: &Steps) -> Vec<f64> {
    let mut y = vec![0.0; run.len() * model.layout().outputs];
    let mut simulator = Simulator::new(model.dynamics(), run, steps.clone()).expect("suited");
    simulator.simulate(&model.definition().start(), &mut y).expect("finite");
    y
}

/// With a method of the user's choice.
fn by(scheme: Scheme) -> StepOptions<'static> {
    StepOptions { scheme: Some(scheme), ..StepOptions::default() }
}

/// The pendulum: smooth, not stiff, without a closed form.
#[test]
fn states_converge_with_order_five() {
    let pendulum = model(
        "model pendulum { param w = 2; state phi = 1.5, r; der(phi) = r; der(r) = -w^2*sin(phi); output y = phi; }",
    );
    let run = run(vec![0.0, 0.5, 1.0, 2.0, 3.0], 1);
    let at = |n| response(&pendulum, &run, &Steps::equal(Scheme::Radau, n));
    let best = at(256);
    let error = |n| at(n).iter().zip(&best).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    let (coarse, fine) = (error(8), error(16));
    let order = (coarse / fine).log2();
    assert!((4.8..5.4).contains(&order), "{order}: {coarse:e} {fine:e}");
}

const ROBERTSON: &str = "model robertson {
    param k1 = 0.04, k2 = 3e7, k3 = 1e4;
    state a = 1, b, c;
    der(a) = -k1*a + k3*b*c; der(b) = k1*a - k3*b*c - k2*b^2; der(c) = k2*b^2;
    output am = a; output bm = b; output cm = c; }";

/// States, then derivatives by the logarithm of k1, k2, k3 of each state, at 0.4, 4, ... 4e6. Computed with the
/// variational equations beside the states by SciPy 1.17 `solve_ivp`, methods Radau and BDF with rtol 1e-11 and atol 1e-15
/// of each size; both agree in all digits given.
const REFERENCE: [[f64; 12]; 8] = [
    [
        9.851721139e-1,
        3.386395379e-5,
        1.479402219e-2,
        -1.423810264e-2,
        -4.749529907e-4,
        9.542381429e-4,
        1.561017622e-5,
        -1.587012328e-5,
        -2.130961030e-6,
        1.422249246e-2,
        4.908231140e-4,
        -9.521071818e-4,
    ],
    [
        9.055186786e-1,
        2.240475688e-5,
        9.445891666e-2,
        -7.504328695e-2,
        -1.480031042e-2,
        2.961377129e-2,
        7.168722360e-6,
        -8.287865884e-6,
        -5.830460566e-6,
        7.503611822e-2,
        1.480859828e-2,
        -2.960794083e-2,
    ],
    [
        7.158270687e-1,
        9.185534765e-6,
        2.841637457e-1,
        -1.699023509e-1,
        -6.865065267e-2,
        1.373080797e-1,
        1.836478500e-6,
        -3.414178528e-6,
        -2.357192114e-6,
        1.699005144e-1,
        6.865406684e-2,
        -1.373057225e-1,
    ],
    [
        4.505186685e-1,
        3.222901442e-6,
        5.494781086e-1,
        -2.383349118e-1,
        -1.136901660e-1,
        2.273815362e-1,
        1.417078917e-7,
        -1.498445611e-6,
        -2.260138868e-7,
        2.383347701e-1,
        1.136916645e-1,
        -2.273813102e-1,
    ],
    [
        1.832022578e-1,
        8.942371254e-7,
        8.167968480e-1,
        -1.900028472e-1,
        -9.404440173e-2,
        1.880886159e-1,
        -2.397460685e-7,
        -5.627539832e-7,
        2.312687343e-7,
        1.900030870e-1,
        9.404496448e-2,
        -1.880888471e-1,
    ],
    [
        3.898337710e-2,
        1.621768317e-7,
        9.610164607e-1,
        -6.299886435e-2,
        -3.143752957e-2,
        6.287494083e-2,
        -1.104782546e-7,
        -1.361007377e-7,
        1.100241041e-7,
        6.299897483e-2,
        3.143766567e-2,
        -6.287505085e-2,
    ],
    [
        4.938274523e-3,
        1.984994089e-8,
        9.950617056e-1,
        -9.453349319e-3,
        -4.725145362e-3,
        9.450271943e-3,
        -1.833631425e-8,
        -1.908754434e-8,
        1.832507153e-8,
        9.453367655e-3,
        4.725164450e-3,
        -9.450290268e-3,
    ],
    [
        5.168096017e-4,
        2.068294492e-9,
        9.994831883e-1,
        -1.026628049e-3,
        -5.132911035e-4,
        1.026580155e-3,
        -2.042427366e-9,
        -2.055275574e-9,
        2.042248436e-9,
        1.026630091e-3,
        5.132931588e-4,
        -1.026582197e-3,
    ],
];

/// Steps chosen for states and outputs give sensitivities of the same quality.
#[test]
fn robertson_has_its_reference_sensitivities() {
    let robertson = model(ROBERTSON);
    let time = std::iter::once(0.0).chain((0..8).map(|k| 0.4 * 10.0_f64.powi(k))).collect();
    let run = run(time, 3);
    let theta = robertson.definition().start();
    let chosen = choose_steps(robertson.dynamics(), &run, &theta, &StepOptions::default()).expect("suited");
    assert_eq!(chosen.steps.scheme(), Scheme::Radau);
    assert!(chosen.error <= 1e-8, "{chosen:?}");
    let (mut y, mut jacobian) = (vec![0.0; 27], vec![0.0; 27 * 8]);
    let mut simulator = Simulator::new(robertson.dynamics(), &run, chosen.steps.clone()).expect("suited");
    simulator.sensitivities(&theta, &[0, 1, 2], &mut y, &mut jacobian).expect("finite");
    let mut worst = (0.0_f64, 0.0_f64);
    for (sample, row) in REFERENCE.iter().enumerate() {
        for state in 0..3 {
            let at = 3 * (sample + 1) + state;
            worst.0 = worst.0.max((y[at] / row[state] - 1.0).abs());
            for k in 0..3 {
                let (got, want) = (jacobian[at * 8 + k] * theta[k], row[3 + 3 * state + k]);
                worst.1 = worst.1.max((got / want - 1.0).abs());
            }
        }
    }
    assert!(worst.0 < 1e-6 && worst.1 < 1e-6, "{} {worst:?}", chosen.steps);
}

/// The linear problem of Prothero and Robinson: y = g(t) whatever the stiffness. The error at the end of stiff steps falls with the
/// stage order and more (Hairer & Wanner II, IV.15), states that are not stiff with order 5.
#[test]
fn order_is_kept_where_it_is_stiff() {
    let stiff = model(
        "model prothero_robinson { param fast = 1e6; state y = 0, slow = 1;
        der(y) = -fast*(y - sin(t)) + cos(t); der(slow) = -slow*cos(t) + y*0; output oy = y; output os = slow; }",
    );
    let run = run(vec![0.0, 1.0, 2.5], 2);
    let error = |n| {
        let y = response(&stiff, &run, &Steps::equal(Scheme::Radau, n));
        let worst = |o: usize, f: &dyn Fn(f64) -> f64| {
            (0..3).map(|k| (y[2 * k + o] - f(run.time[k])).abs()).fold(0.0, f64::max)
        };
        (worst(0, &f64::sin), worst(1, &|t| (-t.sin()).exp()))
    };
    let ((a, slow_a), (b, slow_b)) = (error(4), error(8));
    assert!(a < 1e-9 && a / b > 7.0, "{a:e} {b:e}");
    assert!((4.6..5.4).contains(&(slow_a / slow_b).log2()), "{slow_a:e} {slow_b:e}");
}

/// The derivative of the discrete response, on steps as they are chosen for a stiff model.
#[test]
fn sensitivities_are_derivatives_of_the_discrete_response() {
    let robertson = model(&ROBERTSON.replace("a = 1, b, c", "a = a0, b, c").replace("k1 =", "a0 = 1, k1 ="));
    let run = run(vec![0.0, 1e-4, 0.02, 0.5, 11.0, 300.0, 1e4], 3);
    let theta = robertson.definition().start();
    let steps = choose_steps(robertson.dynamics(), &run, &theta, &StepOptions::default()).expect("suited").steps;
    let (mut y, mut jacobian) = (vec![0.0; 21], vec![0.0; 21 * 8]);
    let mut simulator = Simulator::new(robertson.dynamics(), &run, steps).expect("suited");
    simulator.sensitivities(&theta, &[0, 1, 2, 3], &mut y, &mut jacobian).expect("finite");
    for column in 0..4 {
        let h = 2e-3 * theta[column];
        let mut at = |step: f64| {
            let (mut moved, mut y) = (theta.clone(), vec![0.0; 21]);
            moved[column] += step;
            simulator.simulate(&moved, &mut y).expect("finite");
            y
        };
        // central differences, extrapolated twice
        let d: Vec<Vec<f64>> = [h, h / 2.0, h / 4.0]
            .map(|h| {
                let (a, b) = (at(h), at(-h));
                a.iter().zip(&b).map(|(a, b)| (a - b) / (2.0 * h)).collect()
            })
            .into();
        for state in 0..3 {
            let scale = (0..7).map(|k| jacobian[(3 * k + state) * 8 + column].abs()).fold(0.0, f64::max);
            for k in 1..7 {
                let r = 3 * k + state;
                let (first, second) = ((4.0 * d[1][r] - d[0][r]) / 3.0, (4.0 * d[2][r] - d[1][r]) / 3.0);
                let best = (16.0 * second - first) / 15.0;
                let error = (best - jacobian[r * 8 + column]).abs() / scale;
                assert!(error < 1e-8, "parameter {column}, state {state}, sample {k}: {error:.1e}");
            }
        }
    }
}

/// A start from which the explicit method explodes with any number of steps that is tried, or is only slow.
#[test]
fn an_explicit_failure_is_rescued() {
    let fast = model("model fast { param k = 1e9; state x = 0; der(x) = -k*(x - cos(t)^3); output y = x; }");
    let run = run((0..20).map(|k| 0.1 * f64::from(k)).collect(), 1);
    let theta = fast.definition().start();
    let explicit = choose_steps(fast.dynamics(), &run, &theta, &by(Scheme::RungeKutta)).expect("suited");
    assert!(explicit.error > 1e-3);
    let chosen = choose_steps(fast.dynamics(), &run, &theta, &StepOptions::default()).expect("suited");
    assert!(chosen.steps.scheme() == Scheme::Radau && chosen.error <= 1e-8, "{chosen:?}");
}

/// What does not profit from implicit steps does not get them.
#[test]
fn smooth_models_stay_explicit() {
    let pendulum = model("model p { param w = 2; state a = 1.5, r; der(a) = r; der(r) = -w^2*sin(a); output y = a; }");
    let run = run((0..100).map(|k| 0.1 * f64::from(k)).collect(), 1);
    let chosen = choose_steps(pendulum.dynamics(), &run, &pendulum.definition().start(), &StepOptions::default())
        .expect("suited");
    assert!(chosen.steps.scheme() == Scheme::RungeKutta && chosen.error <= 1e-8, "{chosen:?}");
}

/// Samples spread over decades: explicit steps as many as each interval needs.
#[test]
fn decades_of_samples_get_as_many_explicit_steps_as_they_need() {
    let swing = model("model swing { param d = 0.1; state x = 1, v; der(x) = v; der(v) = -x - d*v; output y = x; }");
    let run = run(std::iter::once(0.0).chain((0..15).map(|k| 10.0_f64.powf(-2.0 + 0.25 * f64::from(k)))).collect(), 1);
    let theta = swing.definition().start();
    let chosen = choose_steps(swing.dynamics(), &run, &theta, &by(Scheme::RungeKutta)).expect("suited");
    assert!(chosen.error <= 1e-8 && chosen.steps.per_interval().is_none(), "{chosen:?}");
    // the longest interval alone wants 512
    assert!(chosen.steps.total(16) < 2000, "{}", chosen.steps);
}

/// Ends of the run against published digits, each as a part of the output's range; and how many steps were taken.
fn check(text: &str, times: &[f64], published: &[f64], most: usize, tolerance: f64) {
    let model = model(text);
    let q = model.layout().outputs;
    let run = run(times.to_vec(), q);
    let theta = model.definition().start();
    let chosen = choose_steps(model.dynamics(), &run, &theta, &by(Scheme::Radau)).expect("suited");
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
