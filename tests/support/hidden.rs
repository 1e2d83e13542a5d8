//! Linear systems with something hidden, and their records.

use crate::Normal;
use fdm::diagnose::{Diagnosis, DiagnosisError, DiagnosisOptions, Domain, diagnose};
use fdm::effect::Catalogue;
use fdm::record::Run;
use fdm::simulate::Simulator;
use fdm::{Model, Work};
use fdm_grammar::Source;

/// A system: its text with places for what is hidden.
pub struct System {
    pub name: &'static str,
    text: &'static str,
    /// What stands at each place in the model that is diagnosed.
    plain: &'static [(&'static str, &'static str)],
    /// (place, what stands there in truth, effects that may be named, parameter, value).
    pub hidden: &'static [Hidden],
}

pub struct Hidden {
    place: &'static str,
    truth: &'static str,
    /// The effect.
    pub effect: &'static str,
    /// The size of its first parameter.
    pub value: f64,
}

pub const SYSTEMS: &[System] = &[
    System {
        name: "short period",
        text: "model aeroplane { input de; state alpha, q; param Za = -0.9, Zd = -0.12, Ma = -5, Mq = -1.4, Md = -7;
            der(alpha) = q + Za*alpha + Zd*DE; der(q) = COUPLED + Mq*q + Md*DE;
            output alpha_m = alpha, q_m = RATE; }",
        plain: &[("DE", "de"), ("COUPLED", "Ma*alpha"), ("RATE", "q")],
        hidden: &[
            Hidden { place: "DE", truth: "delay(de, 0.11)", effect: "input_delay(de)", value: 0.11 },
            Hidden { place: "RATE", truth: "delay(q, 0.06)", effect: "output_delay(q_m)", value: 0.06 },
            Hidden { place: "RATE", truth: "0.9*q", effect: "output_scale(q_m)", value: -0.1 },
        ],
    },
    System {
        name: "lagged plant",
        text: "model plant { input u; state x, v; param k = 2, c = 0.8, b = 1.5; STATE
            der(x) = v; der(v) = -k*x - c*v + b*DRIVE; output x_m = x, v_m = v; }",
        plain: &[("DRIVE", "u"), ("STATE", "")],
        hidden: &[
            Hidden { place: "DRIVE", truth: "delay(u, 0.25)", effect: "input_delay(u)", value: 0.25 },
            Hidden { place: "DRIVE", truth: "lag(u, 0.4)", effect: "actuator_lag(u)", value: 0.4 },
        ],
    },
    System {
        name: "roll and yaw",
        text: "model lateral { input da, dr; state p, r, beta; param Lp = -2.5, Lda = 4, Lb = -6, Nr = -0.6, Nb = 3, Ndr = -2, Yb = -0.3;
            der(p) = Lp*p + Lb*beta + Lda*da ROLL; der(r) = Nr*r + Nb*beta + Ndr*dr YAW; der(beta) = Yb*beta - r;
            output p_m = p, r_m = r, beta_m = beta; }",
        plain: &[("ROLL", ""), ("YAW", "")],
        hidden: &[
            Hidden { place: "ROLL", truth: "+ 1.1*r", effect: "missing_coupling(p, r)", value: 1.1 },
            Hidden { place: "YAW", truth: "- 0.35*da", effect: "missing_control(r, da)", value: -0.35 },
            Hidden { place: "YAW", truth: "- 0.12*p", effect: "missing_coupling(r, p)", value: -0.12 },
        ],
    },
];

/// Linear effects, few enough for quick tests.
pub const SOME: &str = "
effect input_delay(i: input) \"delay\" { param tau = 0 in [0, duration/4] try step, 3*step, 8*step; replace i with delay(i, tau); }
effect actuator_lag(i: input) \"lag\" { param T = 0 in [step/4, duration/4] try 2*step, 6*step; state lagged = start(i);
    der(lagged) = (i - lagged)/T; replace i with lagged; }
effect output_scale(y: output) \"scale\" { param k = 0; replace y with (1 + k)*y; }
effect missing_coupling(x: state, z: state) unless depends(der(x), z) or known(der(x)) \"coupling\" { param c = 0; add der(x) += c*z; }
effect missing_control(x: state, i: input) unless depends(der(x), i) or known(der(x)) \"control\" { param b = 0; add der(x) += b*i; }
";

pub fn some() -> Catalogue {
    let (catalogue, findings) = Catalogue::read(&Source::new("some.fdm", SOME));
    assert!(findings.is_empty(), "{findings:?}");
    catalogue
}

impl System {
    /// The model that is diagnosed.
    pub fn model(&self) -> Model {
        self.with(None)
    }

    fn with(&self, hidden: Option<&Hidden>) -> Model {
        let mut text = self.text.to_string();
        for (place, plain) in self.plain {
            let there = hidden.filter(|h| h.place == *place).map_or(*plain, |h| h.truth);
            text = text.replace(place, there);
        }
        Model::from_text("system.fdm", text).unwrap()
    }

    /// Records of the truth with noise of a part of each output's deviation.
    pub fn records(&self, hidden: Option<&Hidden>, runs: usize, part: f64, pink: bool, seed: u64) -> Vec<Run> {
        let truth = self.with(hidden);
        (0..runs).map(|r| record(&truth, r, part, pink, seed)).collect()
    }
}

/// A manoeuvre from rest to rest: steps one after the other in each input, of another rhythm in each run.
pub fn manoeuvre(t: f64, input: usize, run: usize) -> f64 {
    let pace = 1.0 + 0.23 * run as f64;
    let at = (t - 1.0 - 2.0 * input as f64) * pace;
    let steps = [(0.0, 1.0), (1.5, -1.0), (2.5, 1.0), (3.0, -1.0), (3.5, 0.0), (8.0, 0.7), (9.1, -0.7), (10.4, 0.0)];
    steps.iter().rev().find(|(from, _)| at >= *from).map_or(0.0, |(_, v)| *v)
}

fn record(truth: &Model, r: usize, part: f64, pink: bool, seed: u64) -> Run {
    let (m, q) = (truth.layout().inputs, truth.layout().outputs);
    let (n, dt) = (400, 0.05);
    let time: Vec<f64> = (0..n).map(|k| dt * k as f64).collect();
    let mut run = Run {
        name: format!("run {}", r + 1),
        inputs: time.iter().flat_map(|t| (0..m).map(move |i| manoeuvre(*t, i, r))).collect(),
        measured: vec![0.0; n * q],
        time,
        held: vec![false; m],
        input_gaps: vec![0; m],
        stated: Vec::new(),
        output_gaps: vec![0; q],
    };
    let mut y = vec![0.0; n * q];
    Simulator::new(truth.dynamics(), &run, 4).unwrap().simulate(&truth.definition().start(), &mut y).unwrap();
    run.measured = noisy(&y, q, part, pink, &mut Normal(seed * 1000 + r as u64));
    run
}

/// White noise, or such of which most falls as one over the frequency.
pub fn noisy(y: &[f64], q: usize, part: f64, pink: bool, normal: &mut Normal) -> Vec<f64> {
    let n = y.len() / q;
    let mut noisy = y.to_vec();
    for o in 0..q {
        let column: Vec<f64> = y.iter().skip(o).step_by(q).copied().collect();
        let mean = column.iter().sum::<f64>() / n as f64;
        let size = part * (column.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n as f64).sqrt();
        // first-order processes an octave or two apart are one over the frequency together
        let mut slow: Vec<(f64, f64)> = (0..6).map(|k| (1.0 - 0.5 * 0.3_f64.powi(k), normal.next())).collect();
        for k in 0..n {
            let mut sum = 0.0;
            for (memory, state) in &mut slow {
                *state = *memory * *state + (1.0 - *memory * *memory).sqrt() * normal.next();
                sum += *state / 6.0_f64.sqrt();
            }
            let e = if pink { 0.7_f64.sqrt() * sum + 0.3_f64.sqrt() * normal.next() } else { normal.next() };
            noisy[k * q + o] += size * e;
        }
    }
    noisy
}

pub fn frequency() -> Domain {
    Domain::Frequency(Box::default())
}

/// The diagnosis of a model in a domain.
pub fn diagnosed(
    model: &Model,
    runs: &[Run],
    held: &[Run],
    catalogue: &Catalogue,
    domain: Domain,
) -> Result<Diagnosis, DiagnosisError> {
    diagnose(
        model,
        runs,
        held,
        catalogue,
        &DiagnosisOptions { domain, ..DiagnosisOptions::default() },
        &Work::default(),
    )
}

const HOVER: &str = include_str!("../../models/helicopter_benchmark/model.fdm");

/// The helicopter in hover.
pub fn hover() -> Model {
    Model::from_text("hover.fdm", HOVER).unwrap()
}

/// Records of it under an attitude loop, as the pilot and the loop move the controls together; longitudinal control reaches the rotor late.
pub fn hover_records(runs: usize, part: f64) -> Vec<Run> {
    let controls = ["lon + 2*theta - 0.1*u", "lat + 2*phi", "thr", "dir"];
    let mut text = HOVER.replace("/tau)*lon", &format!("/tau)*delay({}, 0.04)", controls[0]));
    text = text.replace("/tau)*lat", &format!("/tau)*({})", controls[1]));
    let outputs = "p_m [rad/s] = p, q_m [rad/s] = q, r_m [rad/s] = r;\n  output Omega_m [rad/s] = Omega;";
    assert!(text.contains(outputs));
    let shown: Vec<String> = controls.iter().enumerate().map(|(k, c)| format!("c{k} = {c}")).collect();
    text = text.replace(outputs, &format!("{outputs}\n  output {};", shown.join(", ")));
    let truth = Model::from_text("closed.fdm", without_units(&text)).unwrap();
    let (n, dt, m, q) = (600, 0.02, 4, 9);
    let one = |r: usize| {
        let time: Vec<f64> = (0..n).map(|k| dt * k as f64).collect();
        let line =
            |t: f64, i: usize, h: usize| ((0.9 + 1.3 * (4 * h + i) as f64) * t + (h * h + 2 * i + 5 * r) as f64).sin();
        let inputs = time.iter().flat_map(|t| (0..m).map(move |i| 0.1 * (0..6).map(|h| line(*t, i, h)).sum::<f64>()));
        let mut run = Run {
            name: format!("hover {}", r + 1),
            inputs: inputs.collect(),
            measured: vec![0.0; n * (q + m)],
            time,
            held: vec![false; m],
            input_gaps: vec![0; m],
            stated: Vec::new(),
            output_gaps: vec![0; q + m],
        };
        let mut y = vec![0.0; n * (q + m)];
        Simulator::new(truth.dynamics(), &run, 4).unwrap().simulate(&truth.definition().start(), &mut y).unwrap();
        run.inputs = y.chunks(q + m).flat_map(|row| row[q..].to_vec()).collect();
        let measured: Vec<f64> = y.chunks(q + m).flat_map(|row| row[..q].to_vec()).collect();
        run.measured = noisy(&measured, q, part, false, &mut Normal(77 + r as u64));
        run.output_gaps = vec![0; q];
        run
    };
    (0..runs).map(one).collect()
}

/// Units in brackets taken out, but not bounds.
fn without_units(text: &str) -> String {
    let mut out = String::new();
    let mut rest = text;
    while let Some(at) = rest.find(" [") {
        let (before, behind) = rest.split_at(at);
        out.push_str(before);
        let end = behind.find(']').unwrap() + 1;
        if before.ends_with(" in") {
            out.push_str(&behind[..end]);
        }
        rest = &behind[end..];
    }
    out.push_str(rest);
    out
}
