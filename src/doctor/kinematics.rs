//! Rates beside the derivatives of angles, by their names, where no model says how they hang together.

use crate::finding::{Fault, Finding};
use crate::record::{Channel, Record};
use crate::repair::{Change, Repair};
use nalgebra::{DMatrix, DVector};
use std::f64::consts::PI;

/// Angle and its rate, as flight and ship logs call them.
const PAIRS: [(&[&str], &[&str]); 4] = [
    (&["phi", "roll", "bank"], &["p", "phi_dot", "phidot", "roll_rate", "rollrate", "dphi"]),
    (&["theta", "pitch"], &["q", "theta_dot", "thetadot", "pitch_rate", "pitchrate", "dtheta"]),
    (&["psi", "yaw", "heading"], &["r", "psi_dot", "psidot", "yaw_rate", "yawrate", "dpsi"]),
    (&["q1", "angle"], &["qd1", "q1_dot", "angle_dot", "omega"]),
];

fn named<'a>(record: &'a Record, names: &[&str]) -> Option<&'a Channel> {
    let plain = |name: &str| {
        let name = name.to_ascii_lowercase();
        let short =
            ["_m", "_meas", "_measured", "_deg", "_rad", "_degs", "_rads"].iter().find_map(|e| name.strip_suffix(e));
        short.map_or_else(|| name.clone(), str::to_string)
    };
    record.channels.iter().find(|c| names.contains(&plain(&c.name).as_str()))
}

/// Factor and sign of each rate beside its angle, and their delay. Stated units are taken into account.
pub(crate) fn examine(record: &Record, alpha: f64) -> Vec<Finding> {
    let pairs = PAIRS.iter().filter_map(|(angles, rates)| Some((named(record, angles)?, named(record, rates)?)));
    pairs.flat_map(|(angle, rate)| pair(record, angle, rate, alpha)).collect()
}

fn in_radians(channel: &Channel) -> f64 {
    match channel.unit.as_deref() {
        Some(u) if u.starts_with("deg") => PI / 180.0,
        _ => 1.0,
    }
}

/// `angle = a + b t + k * integral of rate - k tau rate`, by least squares.
fn pair(record: &Record, angle: &Channel, rate: &Channel, alpha: f64) -> Vec<Finding> {
    let (time, n) = (&record.time, record.time.len());
    if !record.clocked || n < 50 {
        return Vec::new();
    }
    let (to_angle, to_rate) = (in_radians(angle), in_radians(rate));
    let mut integral = 0.0;
    let mut rows: Vec<[f64; 5]> = Vec::with_capacity(n);
    for k in 0..n {
        if k > 0 {
            let mean = 0.5 * (rate.values[k] + rate.values[k - 1]) * to_rate;
            if mean.is_finite() {
                integral += mean * (time[k] - time[k - 1]);
            }
        }
        let (a, r) = (angle.values[k] * to_angle, rate.values[k] * to_rate);
        if a.is_finite() && r.is_finite() {
            rows.push([1.0, time[k] - time[0], integral, r, a]);
        }
    }
    let Some((c, deviation, explained)) = least_squares(&rows) else { return Vec::new() };
    let mut findings = Vec::new();
    let k = c[2];
    // most of the angle has to follow the rate, or the names mean something else
    if explained < 0.9 {
        return findings;
    }
    let candidates =
        [(PI / 180.0, "deg"), (180.0 / PI, "rad"), (-1.0, "-"), (-PI / 180.0, "-deg"), (-180.0 / PI, "-rad")];
    if let Some((factor, word)) = candidates.iter().find(|(f, _)| k / f > 0.8 && k / f < 1.25) {
        let what = match *word {
            "-" => format!("`{}` runs against `{}`: one of them has the wrong sign", rate.name, angle.name),
            _ => format!(
                "the integral of `{}` is {:.4} times `{}`: degrees and radians are mixed{}",
                rate.name,
                1.0 / k,
                angle.name,
                if *factor < 0.0 { ", and the sign differs" } else { "" }
            ),
        };
        let fault = if *word == "-" { Fault::Sign } else { Fault::Unit };
        let p = (1.0 - explained).powf(10.0).max(1e-40);
        let change = Change { factor: *factor, ..Change::default() };
        let mut finding = Finding::by_chance(&record.run, &rate.name, fault, p, what);
        finding.channels.push(angle.name.clone());
        findings.push(finding.repaired_by(Repair::map([(rate.name.clone(), change)])));
        return findings;
    }
    let delay = -c[3] / k;
    let step = (time[n - 1] - time[0]) / (n as f64 - 1.0);
    let z = (delay / (deviation[3] / k)).abs();
    let p = 2.0 * fdm_numeric::statistics::normal_tail(z);
    if delay.abs() > 1.5 * step && p < alpha && k > 0.8 && k < 1.25 && explained > 0.98 {
        let (late, early) = if delay > 0.0 { (angle, rate) } else { (rate, angle) };
        let what =
            format!("`{}` comes {:.4} later than `{}`, +- {:.4}", late.name, delay.abs(), early.name, deviation[3]);
        let change = Change { delay: delay.abs(), ..Change::default() };
        let finding = Finding::by_chance(&record.run, &late.name, Fault::Delay, p, what);
        findings.push(finding.repaired_by(Repair::map([(late.name.clone(), change)])));
    }
    findings
}

/// Coefficients of the first four columns for the fifth, their deviations for errors as coloured as the residuals are, and the part of the
/// fifth (beyond mean and trend) that is explained.
fn least_squares(rows: &[[f64; 5]]) -> Option<([f64; 4], [f64; 4], f64)> {
    let n = rows.len();
    if n < 20 {
        return None;
    }
    let columns = DMatrix::from_fn(n, 4, |i, j| rows[i][j]);
    let wanted = DVector::from_fn(n, |i, _| rows[i][4]);
    let qr = columns.clone().qr();
    let upper = qr.r();
    if (0..4).any(|j| upper[(j, j)].abs() <= 1e-9 * columns.column(j).norm()) {
        return None;
    }
    let inverse = upper.try_inverse()?;
    let mut turned = wanted.clone();
    qr.q_tr_mul(&mut turned);
    let found: DVector<f64> = &inverse * turned.rows(0, 4);
    let residual = wanted - columns * &found;
    let left = residual.norm_squared();
    // mean and trend are the first two directions
    let trend_left = turned.rows(2, n - 2).norm_squared();
    let explained = 1.0 - left / trend_left.max(f64::MIN_POSITIVE);
    let lag: f64 = residual.as_slice().windows(2).map(|w| w[0] * w[1]).sum::<f64>() / left.max(f64::MIN_POSITIVE);
    let colour = ((1.0 + lag.clamp(0.0, 0.99)) / (1.0 - lag.clamp(0.0, 0.99))).sqrt();
    let noise = (left / n as f64).sqrt() * colour;
    let deviation = std::array::from_fn(|i| noise * inverse.row(i).norm());
    Some((std::array::from_fn(|i| found[i]), deviation, explained))
}
