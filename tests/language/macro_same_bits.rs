//! The same model by file and by macro: tape, machine code and generated Rust give the same bits everywhere.

#![deny(warnings, clippy::all, clippy::pedantic)]

use fdm::Model;
use fdm::dynamics::{Dynamics, Point, Step, Workspace};

/// The same tokens as text and as Rust.
macro_rules! twice {
    ($($tokens:tt)*) => {
        (read(stringify!($($tokens)*)), fdm::model! { $($tokens)* })
    };
}

/// As a user would load it.
fn read(text: &str) -> Model {
    Model::from_text("text", text).unwrap_or_else(|mistakes| panic!("{mistakes}"))
}

const SHIP: &str = r#"
model ship "manoeuvring, nonlinear" {
  input  d "rudder" [rad];
  state  u "surge" [m/s] = 7.7,  v "sway" [m/s],  r "yaw rate" [rad/s];
  const  k = 5e-4, u0 = 7.7;
  param  C1 = -1.0e-2, C2 = -3.0, C3 = -1.5e-3, C4 = -1.0e-2, C5 = -0.35, C6 = 1.0e-3;
  param  C7 = -1.0e-2, C8 = -3.0e-4, C9 = -2.0e-2, C10 = -1.2e-4, C11 = -0.5;
  der(u) = -k*(u^2 - u0^2) + C1*v^2 + C2*r^2 + C3*u^2*d^2;
  der(v) = C4*u*v + C5*u*r + C6*u^2*d + C7*v*abs(v);
  der(r) = C8*u*v + C9*u*r + C10*u^2*d + C11*r*abs(r);
  output u_m [m/s] = u, v_m [m/s] = v, r_m [rad/s] = r;
}
"#;

fn ship() -> (Model, Model) {
    let written = fdm::model! {
        model ship "manoeuvring, nonlinear" {
          input  d "rudder" [rad];
          state  u "surge" [m/s] = 7.7,  v "sway" [m/s],  r "yaw rate" [rad/s];
          const  k = 5e-4, u0 = 7.7;   // speed
          param  C1 = -1.0e-2, C2 = -3.0, C3 = -1.5e-3, C4 = -1.0e-2, C5 = -0.35, C6 = 1.0e-3;
          param  C7 = -1.0e-2, C8 = -3.0e-4, C9 = -2.0e-2, C10 = -1.2e-4, C11 = -0.5;
          der(u) = -k*(u^2 - u0^2) + C1*v^2 + C2*r^2 + C3*u^2*d^2;
          der(v) = C4*u*v + C5*u*r + C6*u^2*d + C7*v*abs(v);
          der(r) = C8*u*v + C9*u*r + C10*u^2*d + C11*r*abs(r);
          output u_m [m/s] = u, v_m [m/s] = v, r_m [rad/s] = r;
        }
    };
    (read(SHIP), written)
}

fn functions() -> (Model, Model) {
    twice! {
        model functions {
            input a, b;
            state x, y = 0.5;
            param p = 0.3, q = 1.7 in [0.1, 10.0], n = 2.5;
            let z = if x < y and not (a >= b) then sin(p*x) + cos(q*y) else if x == y or a != b then tan(p*a) else -x;
            der(x) = z + min(x, q*a) - max(y, p*b) + abs(a)*sign(b) + tanh(q*x) + atan2(y, p + x^2);
            der(y) = exp(-q*x^2) + log(1 + q*y^2) + log10(2 + y^2) + sqrt(1 + x^2) + hypot(x, p*y) + sinh(0.1*x) + cosh(p*y);
            output one = abs(x)^n + q^y + (x^3 - 2*x^2)/q;
            output two = asin(tanh(p*x)) + acos(tanh(q*y)) + atan(p*y);
        }
    }
}

fn time_and_delays() -> (Model, Model) {
    twice! {
        model late {
            input u;
            state x = x0, y = free;
            param x0 = 0.2 per run, T = 0.8, tau = 0.1 in [0, 1], lag = 0.05, kept = 3.0 fixed;
            param b = 2*T + tau;
            let w = b^2 * exp(-T);
            der(x) = (delay(u, tau) - x)/T + sin(w*t)*kept;
            der(y) = x - b*y + delay(u*t, lag);
            output q_m = delay(x*y + u, lag), r = t*w + y;
        }
    }
}

fn delayed_states() -> (Model, Model) {
    twice! {
        model late_feedback {
            input u;
            state x = x0, y = free;
            param x0 = 0.2, k = 1.3, tau = 0.4 in [0, 2], lag = 0.1, kept = 0.7 fixed;
            let feedback = delay(x*y + u*t, tau);
            der(x) = -k*feedback + delay(x, tau + lag)^2;
            der(y) = sin(delay(feedback, lag)) - kept*y*delay(y, 0.25);
            output one = x, two = delay(y, tau)*x + u;
        }
    }
}

fn records() -> (Model, Model) {
    twice! {
        model driven {
            input u;
            state x = free, y;
            const s = 0.5;
            param k = 1.3, tau = 0.4 in [0, 2], kept = 0.7 fixed;
            prior k ~ normal(1.2, s/10), x(0) ~ normal(0, 2*s);
            noise one = 0.02, two = s;
            der(x) = -k*measured(x)*x + measured(two)^2 + u;
            der(y) = sin(delay(measured(one)*y, tau)) - kept*y;
            output one = x, two = delay(y, tau)*x + u;
        }
    }
}

fn derivatives() -> (Model, Model) {
    twice! {
        model coupled {
            input u, w;
            state p = 0.1, r, v = free;
            param ixx = 2.1, izz = 3.4, ixz = 0.3, k = 0.7, tau = 0.2 in [0, 1];
            ixx*der(p) - ixz*der(r) = delay(u + k*der(u), tau) - p*r;
            izz*der(r) - ixz*der(p) = sin(w) - r*abs(r);
            der(v*(1 + k*p^2)) = der(u*w) - v + der(measured(speed));
            output speed = v, ay = der(v) + k*der(r) - der(w), q = p;
        }
    }
}

fn stateless() -> (Model, Model) {
    twice! {
        model curve {
            input v, alpha;
            param c0 = 0.1, c1 = 5.0, k = 0.05;
            let cl = c0 + c1*alpha;
            output lift = cl*v^2, drag = (0.02 + k*cl^2)*v^2;
        }
    }
}

fn vectors() -> (Model, Model) {
    twice! {
        model matrices {
            input u[2], v;
            state x[3] = [0.1, 0, x3], w;
            param x3 = 0.2, k = 1.3, tau = 0.4 in [0, 2];
            param A[3, 3] = [[-1, k, 0], [0, -2*k, 0.5], [0.3, 0, -1.5]], B[3, 2] = [[1, 0], [0, 1], [0, 0]];
            noise y[1] = 0.1;
            let e[3] = (k + sin(t))*tanh(x) - cross(x, [v, u[1], k]);
            der(x) = A*x + B*delay(u, tau) + e/k;
            der(w) = dot(x, A[2,:]*v) + norm(x[1:2]) + det([[k, 1], [v, 2]]) - sum(x)*w;
            output y[2] = inverse([[k, v], [0.1, 2]])*x[2:3], z = if w > 0 then w else -w;
        }
    }
}

fn submodels() -> (Model, Model) {
    let text = "model parts { input u [deg]; param T = 0.3 [s], k = 1 [1];
                use \"language/parts/drive.fdm\" as act(command = k*u, T = T/2);
                output y [deg] = act.y, rate [deg] = act.first.z; }";
    let files = [include_str!("parts/drive.fdm").to_string(), include_str!("parts/actuator.fdm").to_string()];
    let read = Model::from_texts("text", text, &files).unwrap_or_else(|mistakes| panic!("{mistakes}"));
    let written = fdm::model! {
        model parts {
            input u [deg]; param T = 0.3 [s], k = 1 [1];
            use "language/parts/drive.fdm" as act(command = k*u, T = T/2);
            output y [deg] = act.y, rate [deg] = act.first.z;
        }
    };
    assert_eq!(written.source().texts().len(), 3);
    (read, written)
}

/// Numbers between -2 and 2 (splitmix64).
struct Noise(u64);

impl Noise {
    fn numbers(&mut self, count: usize) -> Vec<f64> {
        std::iter::repeat_with(|| self.next()).take(count).collect()
    }

    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        f64::from(u32::try_from((z ^ (z >> 31)) >> 32).expect("32 bits")) / f64::from(u32::MAX) * 4.0 - 2.0
    }
}

/// Bits in which every NaN is one: which NaN an operation returns, IEEE leaves open.
fn bits(numbers: &[f64]) -> Vec<u64> {
    numbers.iter().map(|x| if x.is_nan() { f64::NAN } else { *x }.to_bits()).collect()
}

/// Everything that a model computes from one set of numbers.
fn everything(dynamics: &dyn Dynamics, noise: &mut Noise) -> Vec<(&'static str, Vec<u64>)> {
    let layout = dynamics.layout().clone();
    let work = &mut Workspace::new(dynamics);
    let mut known = vec![0.0; layout.known];
    dynamics.prepare(&noise.numbers(layout.params), &mut known, work);
    let (x, drive) = (noise.numbers(layout.states), noise.numbers(3 * layout.drive()));
    let t = noise.next();
    let at = Point { t, x: &x, drive: &drive[..layout.drive()], known: &known };
    let step = Step { t, h: 0.1 + noise.next().abs(), x: &x, drive: &drive, known: &known };
    let mut all = vec![("prepare", bits(&known))];
    let mut add = |name, slots: usize, run: &mut dyn FnMut(&mut [f64], &mut Workspace)| {
        let mut out = vec![0.0; slots];
        run(&mut out, work);
        all.push((name, bits(&out)));
    };
    add("rates", layout.states, &mut |out, work| dynamics.rates(at, out, work));
    add("rates_and_partials", layout.rate_slots(), &mut |out, work| dynamics.rates_and_partials(at, out, work));
    add("outputs", layout.outputs, &mut |out, work| dynamics.outputs(at, out, work));
    add("outputs_and_partials", layout.output_slots(), &mut |out, work| dynamics.outputs_and_partials(at, out, work));
    add("by_input", layout.input_slots(), &mut |out, work| dynamics.by_input(at, out, work));
    add("step", layout.states, &mut |out, work| dynamics.step(step, out, work));
    let n = layout.states;
    add("step_with_partials", n + 4 * layout.rate_slots(), &mut |out, work| {
        let (next, stages) = out.split_at_mut(n);
        dynamics.step_with_partials(step, next, stages, work);
    });
    all
}

fn agree((read, written): (Model, Model)) {
    assert_eq!(read.schedule(), written.schedule(), "{}", read.name());
    let tape = fdm::code::Tape::new(read.schedule());
    let machine = fdm::code::compile(read.schedule(), fdm::code::Engine::Jit);
    for seed in 0..200 {
        let oracle = everything(&tape, &mut Noise(seed));
        for (by, dynamics) in [("machine code", &*machine), ("macro", written.dynamics())] {
            for (wanted, found) in oracle.iter().zip(everything(dynamics, &mut Noise(seed))) {
                assert_eq!(*wanted, found, "{} by {by}, seed {seed}", read.name());
            }
        }
    }
}

#[test]
fn ship_has_the_same_bits() {
    agree(ship());
}

#[test]
fn every_function_has_the_same_bits() {
    agree(functions());
}

#[test]
fn time_delays_and_derived_parameters_have_the_same_bits() {
    agree(time_and_delays());
}

#[test]
fn delayed_states_in_equations_have_the_same_bits() {
    let (read, written) = delayed_states();
    let found = fdm::code::verify(read.definition(), read.schedule(), &fdm::code::Nominal::start(read.definition()));
    assert!(found.passed(), "{found:?}");
    let delayed = read.layout().patterns.rates_by_delayed.len();
    assert!(delayed >= 6 && found.worst.is_none_or(|d| d.relative < 1e-12), "{delayed}");
    agree((read, written));
}

#[test]
fn records_and_priors_have_the_same_bits() {
    let (read, written) = records();
    for model in [&read, &written] {
        let definition = model.definition();
        let found = fdm::code::verify(definition, model.schedule(), &fdm::code::Nominal::start(definition));
        assert!(found.passed(), "{found:?}");
        let measured: Vec<_> = definition.inputs.iter().map(|i| i.measured).collect();
        assert_eq!(measured, [None, Some(0), Some(1)]);
        assert_eq!(definition.outputs.iter().map(|o| o.noise).collect::<Vec<_>>(), [Some(0.02), Some(0.5)]);
        let priors: Vec<_> = definition.params.iter().map(|p| p.prior.map(|p| (p.mean, p.deviation))).collect();
        assert_eq!(priors, [Some((0.0, 1.0)), Some((1.2, 0.05)), None, None]);
    }
    agree((read, written));
}

#[test]
fn derivatives_in_equations_have_the_same_bits() {
    let (read, written) = derivatives();
    let found = fdm::code::verify(read.definition(), read.schedule(), &fdm::code::Nominal::start(read.definition()));
    assert!(found.passed(), "{found:?}");
    let names: Vec<_> = read.definition().inputs.iter().map(|i| i.quantity.name.as_str()).collect();
    let hidden = ["measured(speed)", "der(u)", "der(w)", "der(measured(speed))"];
    assert!(hidden.iter().all(|name| names.contains(name)), "{names:?}");
    agree((read, written));
}

#[test]
fn a_model_without_states_has_the_same_bits() {
    agree(stateless());
}

#[test]
fn vectors_and_matrices_have_the_same_bits() {
    let (read, written) = vectors();
    let found = fdm::code::verify(read.definition(), read.schedule(), &fdm::code::Nominal::start(read.definition()));
    assert!(found.passed(), "{found:?}");
    agree((read, written));
}

#[test]
fn submodels_have_the_same_bits() {
    agree(submodels());
}

#[test]
fn the_numbers_of_the_test_are_numbers() {
    for (read, _) in
        [ship(), functions(), time_and_delays(), delayed_states(), records(), stateless(), vectors(), submodels()]
    {
        let tape = fdm::code::Tape::new(read.schedule());
        let nan = f64::NAN.to_bits();
        let finite = (0..50).filter(|seed| everything(&tape, &mut Noise(*seed)).iter().all(|(_, b)| !b.contains(&nan)));
        assert!(finite.count() > 10, "{}", read.name());
    }
}
