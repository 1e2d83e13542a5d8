//! W7: an aircraft in six degrees of freedom with a quaternion: 13 states, all of them measured, 40 parameters, 10,000 samples of one step.
//!
//! There is no hand-written limit; the derivatives are compared with central differences of the response.

use crate::clock::{Row, median_of_runs};
use fdm::Model;
use fdm::record::Run;
use fdm::simulate::{Block, Simulator};

const SAMPLES: usize = 10_000;
const STEP: f64 = 0.005;
const MODEL: &str = "
model aircraft {
          input de, da, dr, th;
          state pn = 0, pe = 0, pd = -100, e0 = 1, e1 = 0, e2 = 0, e3 = 0, u = 20, v = 0, w = 0.9, p = 0, q = 0, r = 0;
          param cx0 = -0.03, cxa = 0.2, cxaa = 2.0, cxq = 0.5, cxe = 0.02, cxbb = -0.1, ct = 0.05, cy0 = 0.002, cyb = -0.5, cyp = -0.05;
          param cyr = 0.2, cya = 0.03, cyd = 0.15, cz0 = -0.2, cza = -4.5, czaa = -0.6, czq = -4.0, cze = -0.4, cl0 = 0.0005, clb = -0.08;
          param clp = -0.5, clr = 0.1, cla = 0.15, cld = 0.01, cm0 = 0.036, cma = -0.8, cmaa = -0.5, cmq = -12.0, cme = -1.0, cmt = 0.004;
          param cn0 = 0.0003, cnb = 0.09, cnp = -0.03, cnr = -0.12, cna = -0.01, cnd = -0.07, ix = 0.3, iy = 0.4, iz = 0.6, ixz = 0.03;
          let V = sqrt(u^2 + v^2 + w^2);
          let al = atan(w/u);
          let be = v/V;
          let qs = 0.5*1.225*0.5*V^2;
          let ph = 2*p/(2*V);
          let qh = 0.25*q/(2*V);
          let rh = 2*r/(2*V);
          let CX = cx0 + cxa*al + cxaa*al^2 + cxq*qh + cxe*de + cxbb*be^2 + ct*th;
          let CY = cy0 + cyb*be + cyp*ph + cyr*rh + cya*da + cyd*dr;
          let CZ = cz0 + cza*al + czaa*al^2 + czq*qh + cze*de;
          let L = 2*qs*(cl0 + clb*be + clp*ph + clr*rh + cla*da + cld*dr);
          let M = 0.25*qs*(cm0 + cma*al + cmaa*al^2 + cmq*qh + cme*de + cmt*th);
          let N = 2*qs*(cn0 + cnb*be + cnp*ph + cnr*rh + cna*da + cnd*dr);
          let en = 1 - e0^2 - e1^2 - e2^2 - e3^2;
          let hx = L + (iy - iz)*q*r + ixz*p*q;
          let hz = N + (ix - iy)*p*q - ixz*q*r;
          let id = ix*iz - ixz^2;
          der(pn) = (e0^2 + e1^2 - e2^2 - e3^2)*u + 2*(e1*e2 - e0*e3)*v + 2*(e1*e3 + e0*e2)*w;
          der(pe) = 2*(e1*e2 + e0*e3)*u + (e0^2 - e1^2 + e2^2 - e3^2)*v + 2*(e2*e3 - e0*e1)*w;
          der(pd) = 2*(e1*e3 - e0*e2)*u + 2*(e2*e3 + e0*e1)*v + (e0^2 - e1^2 - e2^2 + e3^2)*w;
          der(e0) = -0.5*(e1*p + e2*q + e3*r) + en*e0;
          der(e1) = 0.5*(e0*p + e2*r - e3*q) + en*e1;
          der(e2) = 0.5*(e0*q + e3*p - e1*r) + en*e2;
          der(e3) = 0.5*(e0*r + e1*q - e2*p) + en*e3;
          der(u) = r*v - q*w + 2*(e1*e3 - e0*e2)*9.81 + qs*CX/5;
          der(v) = p*w - r*u + 2*(e2*e3 + e0*e1)*9.81 + qs*CY/5;
          der(w) = q*u - p*v + (e0^2 - e1^2 - e2^2 + e3^2)*9.81 + qs*CZ/5;
          der(p) = (iz*hx + ixz*hz)/id;
          der(q) = (M + (iz - ix)*p*r - ixz*(p^2 - r^2))/iy;
          der(r) = (ixz*hx + ix*hz)/id;
          output pn_m = pn, pe_m = pe, pd_m = pd, e0_m = e0, e1_m = e1, e2_m = e2, e3_m = e3, u_m = u, v_m = v, w_m = w, p_m = p, q_m = q, r_m = r;
        }";

/// Elevator, ailerons, rudder (rad) and throttle at a time in seconds.
fn controls(t: f64) -> [f64; 4] {
    let swept = |a: f64, f: f64, b: f64, g: f64| a * (f * t).sin() + b * (g * t).sin();
    [
        swept(0.03, 0.9, 0.02, 3.1),
        swept(0.02, 1.3, 0.01, 2.7),
        swept(0.03, 0.7, 0.02, 2.2),
        0.5 + swept(0.1, 0.2, 0.0, 0.0),
    ]
}

/// A: response and sensitivities.
pub(crate) fn run(limit: &[Row]) {
    let model = Model::from_text("aircraft.fdm", MODEL).expect("the model compiles");
    let outputs = model.layout().outputs;
    let run = Run {
        name: "aircraft".into(),
        time: (0..SAMPLES).map(|k| STEP * k as f64).collect(),
        inputs: (0..SAMPLES).flat_map(|k| controls(STEP * k as f64)).collect(),
        held: vec![false; 4],
        measured: vec![f64::NAN; SAMPLES * outputs],
        input_gaps: vec![0; 4],
        stated: Vec::new(),
        output_gaps: vec![0; outputs],
    };
    let theta = model.definition().start();
    let columns: Vec<usize> = (0..theta.len()).collect();
    let mut simulator = Simulator::new(model.dynamics(), &run, 1).expect("nothing is held and delayed");
    let stride = columns.len().next_multiple_of(8);
    let mut y = vec![0.0; SAMPLES * outputs];
    let mut jacobian = vec![0.0; y.len() * stride];
    simulator.sensitivities(&theta, &columns, &mut y, &mut jacobian).expect("the flight stays finite");
    println!("w7       {} parameters; at the end {:.12e}, by cma {:.12e}", theta.len(), y[y.len() - 6], {
        let column = model.definition().param("cma").expect("the model declares it");
        jacobian[(y.len() - 6) * stride + column]
    });
    let mut off = |column: usize| {
        let step = 1e-6 * theta[column].abs();
        let mut moved = |sign: f64| {
            let (mut theta, mut y) = (theta.clone(), vec![0.0; SAMPLES * outputs]);
            theta[column] += sign * step;
            simulator.simulate(&theta, &mut y).expect("the flight stays finite");
            y
        };
        let numeric: Vec<f64> = moved(1.0).iter().zip(moved(-1.0)).map(|(a, b)| (a - b) / (2.0 * step)).collect();
        let exact = jacobian.iter().skip(column).step_by(stride);
        let size = numeric.iter().fold(0.0_f64, |size, d| size.max(d.abs()));
        numeric.iter().zip(exact).fold(0.0_f64, |worst, (a, b)| worst.max((a - b).abs())) / size
    };
    let difference = columns.iter().map(|column| off(*column)).fold(0.0, f64::max);
    let seconds = median_of_runs(|| {
        let mut sink = |block: Block<'_>| _ = std::hint::black_box(block.rows);
        simulator.stream(std::hint::black_box(&theta), &columns, &mut sink).expect("the flight stays finite");
    });
    let row = |what: &str, seconds: f64| {
        let (workload, tool, what) = ("w7".into(), "fdm (.fdm, machine code)".into(), what.into());
        Row { workload, tool, what, seconds, difference: Some(difference) }
    };
    row("A residual+jacobian", seconds).print(limit);
    let seconds = median_of_runs(|| {
        simulator.simulate(std::hint::black_box(&theta), &mut y).expect("the flight stays finite");
    });
    row("simulation only", seconds).print(limit);
}
