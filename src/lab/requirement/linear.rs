//! Modes and frequency responses of a linear model, with their derivatives by every parameter.
//!
//! Margins are those of the loop that is closed by `u = -y`; bandwidth and phase delay are those of ADS-33E-PRF (US Army 2000, figure 5).

use super::measured::Measured;
use fdm_grammar::graph::Signal;
use fdm_grammar::requirement::{Observed, OfMode, OfResponse, Target};
use fdm_numeric::dense::Lu;
use fdm_numeric::dense::lu::Complex;
use fdm_system::linear::{Modes, Structure, Values};
use num_complex::Complex64;
use std::f64::consts::{LN_2, LN_10, PI};

/// A linear model at one vector of parameters.
pub(super) struct Linear<'a> {
    pub(super) structure: &'a Structure,
    pub(super) values: &'a Values,
    /// For each input the hidden ones that are its derivative.
    pub(super) slopes: &'a [(u32, u32)],
}

/// A frequency response with its derivatives.
struct Response {
    /// Its value.
    g: Complex64,
    /// By s.
    by_s: Complex64,
    /// By every parameter (p); empty where that was not asked for.
    by_theta: Vec<Complex64>,
}

/// What a signal of the linear model is: a state or input, and the factor of its delay.
struct Delayed {
    place: usize,
    factor: Complex64,
    tau: f64,
}

impl Linear<'_> {
    fn delayed(&self, signal: usize, s: Complex64) -> Delayed {
        let Structure { states: n, inputs: m, .. } = *self.structure;
        match signal.checked_sub(n + m) {
            Some(d) => {
                let tau = self.values.tau[d];
                let place = match self.structure.delayed[d] {
                    Signal::State(k) => k as usize,
                    Signal::Input(k) => n + k as usize,
                };
                Delayed { place, factor: (-s * tau).exp(), tau }
            }
            None => Delayed { place: signal, factor: Complex64::ONE, tau: 0.0 },
        }
    }

    /// The coefficient of a state or input in an equation, with its derivatives; delays count as none.
    pub(super) fn coefficient(&self, row: Target, column: u32) -> Measured {
        let (s, v) = (self.structure, self.values);
        let row = match row {
            Target::State(k) => k as usize,
            Target::Output(k) => s.states + k as usize,
        };
        let own = |term: usize| {
            let t = s.terms[term];
            t.row as usize == row && self.delayed(t.signal as usize, Complex64::ZERO).place == column as usize
        };
        let mut gradient = vec![0.0; s.params];
        let value = (0..s.terms.len()).filter(|t| own(*t)).map(|t| v.terms[t]).sum();
        for (slope, d) in s.slopes.iter().zip(&v.slopes).filter(|(slope, _)| own(slope.term as usize)) {
            gradient[slope.param as usize] += d;
        }
        Measured::of(value, gradient)
    }

    /// Of the mode in which a state has its greatest share; of a pair that of positive frequency.
    pub(super) fn mode(&self, modes: &Modes, state: u32, of: OfMode) -> Measured {
        let share =
            |m: &fdm_system::linear::Mode| m.states.iter().find(|(k, _)| *k == state as usize).map_or(0.0, |(_, s)| *s);
        let upper = modes.modes.iter().filter(|m| m.s.im >= 0.0);
        let Some(mode) = upper.reduce(|a, b| if share(b) > share(a) { b } else { a }) else {
            return Measured::missing("there is no such mode");
        };
        let (s, size) = (mode.s, mode.s.norm());
        let p = self.structure.params;
        let gradient = |of: &dyn Fn(Complex64) -> f64| match &mode.slopes {
            Some(slopes) => slopes.iter().map(|d| of(*d)).collect(),
            None => vec![f64::NAN; p],
        };
        let by_size = |d: Complex64| if size > 0.0 { (s.re * d.re + s.im * d.im) / size } else { d.norm() };
        match of {
            OfMode::Frequency => Measured::of(size, gradient(&by_size)),
            OfMode::Real => Measured::of(s.re, gradient(&|d| d.re)),
            OfMode::Damping if size == 0.0 => Measured::missing("the mode is at zero"),
            // on the real axis it is 1 or -1
            OfMode::Damping if s.im == 0.0 => Measured::of(-s.re / size, vec![0.0; p]),
            OfMode::Damping => Measured::of(0.0 - s.re / size, gradient(&|d| (s.re * by_size(d) / size - d.re) / size)),
            OfMode::TimeToHalf if s.re >= 0.0 => Measured::missing("the mode does not decay"),
            OfMode::TimeToDouble if s.re <= 0.0 => Measured::missing("the mode does not grow"),
            OfMode::TimeToHalf => Measured::of(LN_2 / -s.re, gradient(&|d| LN_2 / (s.re * s.re) * d.re)),
            OfMode::TimeToDouble => Measured::of(LN_2 / s.re, gradient(&|d| -LN_2 / (s.re * s.re) * d.re)),
        }
    }

    /// The response of a signal to an input at s; none at a pole.
    fn response(&self, signal: Observed, input: u32, s: Complex64, slopes: bool) -> Option<Response> {
        let (structure, values) = (self.structure, self.values);
        let n = structure.states;
        let sign = if signal.negative { -1.0 } else { 1.0 };
        // the input itself, and what is its derivative
        let driven = |place: usize| match place.checked_sub(n) {
            Some(k) if k == input as usize => Some((Complex64::ONE, Complex64::ZERO)),
            Some(k) if self.slopes.contains(&(k as u32, input)) => Some((s, Complex64::ONE)),
            _ => None,
        };
        let mut lu = Lu::<Complex>::new(n);
        let mut b = vec![Complex64::ZERO; n];
        let mut c = vec![Complex64::ZERO; n];
        let row = match signal.target {
            Target::State(k) => {
                c[k as usize] = Complex64::ONE;
                None
            }
            Target::Output(k) => Some(n + k as usize),
        };
        let needed = self.needed(signal.target);
        // an integral that the signal does not see has a pole at zero, and no part in it
        (0..n).for_each(|k| *lu.entry_mut(k, k) += if needed[k] { s } else { Complex64::ONE });
        let mut size = s.norm();
        let (mut g, mut by_s) = (Complex64::ZERO, Complex64::ZERO);
        for (term, value) in structure.terms.iter().zip(&values.terms) {
            let Delayed { place, factor, tau } = self.delayed(term.signal as usize, s);
            let (at, own) = (term.row as usize, *value * factor);
            if at < n && !needed[at] {
                continue;
            }
            if at < n {
                if place < n {
                    *lu.entry_mut(at, place) -= own;
                    size = size.max(own.norm());
                } else if let Some((z, _)) = driven(place) {
                    b[at] += own * z;
                }
            } else if Some(at) == row {
                if place < n {
                    c[place] += own;
                } else if let Some((z, dz)) = driven(place) {
                    g += own * z;
                    by_s += own * (dz - tau * z);
                }
            }
        }
        if n > 0 && !lu.factorise(1e-14 * size) {
            return None;
        }
        let mut x = b;
        lu.solve(&mut x);
        let mut w = c.clone();
        lu.solve_left(&mut w);
        g += c.iter().zip(&x).map(|(c, x)| c * x).sum::<Complex64>();
        by_s -= w.iter().zip(&x).map(|(w, x)| w * x).sum::<Complex64>();
        // what a coefficient does to the response
        let z = |place: usize| if place < n { Some((x[place], Complex64::ZERO)) } else { driven(place) };
        let left = |at: usize| {
            if at < n { Some(w[at]) } else { (Some(at) == row).then_some(Complex64::ONE) }
        };
        for (term, value) in structure.terms.iter().zip(&values.terms) {
            let Delayed { place, factor, tau } = self.delayed(term.signal as usize, s);
            let (Some(left), Some((z, dz))) = (left(term.row as usize), z(place)) else { continue };
            // those of an output by inputs stand above
            if term.row as usize >= n && place >= n {
                continue;
            }
            by_s += left * (*value * factor) * (dz - tau * z);
        }
        let mut by_theta = Vec::new();
        if slopes {
            by_theta = vec![Complex64::ZERO; structure.params];
            for (slope, d) in structure.slopes.iter().zip(&values.slopes) {
                let term = structure.terms[slope.term as usize];
                let Delayed { place, factor, .. } = self.delayed(term.signal as usize, s);
                let (Some(left), Some((z, _))) = (left(term.row as usize), z(place)) else { continue };
                by_theta[slope.param as usize] += sign * left * z * factor * *d;
            }
            let first = n + structure.inputs;
            for (slope, d) in structure.tau_slopes.iter().zip(&values.tau_slopes) {
                for (term, value) in structure.terms.iter().zip(&values.terms) {
                    if term.signal as usize != first + slope.delayed as usize {
                        continue;
                    }
                    let Delayed { place, factor, .. } = self.delayed(term.signal as usize, s);
                    let (Some(left), Some((z, _))) = (left(term.row as usize), z(place)) else { continue };
                    by_theta[slope.param as usize] += sign * left * z * factor * *value * -s * *d;
                }
            }
        }
        Some(Response { g: g * sign, by_s: by_s * sign, by_theta })
    }

    /// For each state whether a signal depends on it, directly or through others.
    fn needed(&self, target: Target) -> Vec<bool> {
        let n = self.structure.states;
        let mut needed = vec![false; n];
        let mut open = Vec::new();
        match target {
            Target::State(k) => {
                needed[k as usize] = true;
                open.push(k as usize);
            }
            Target::Output(k) => open.push(n + k as usize),
        }
        while let Some(row) = open.pop() {
            for term in self.structure.terms.iter().filter(|t| t.row as usize == row) {
                let place = self.delayed(term.signal as usize, Complex64::ZERO).place;
                if place < n && !std::mem::replace(&mut needed[place], true) {
                    open.push(place);
                }
            }
        }
        needed
    }

    /// What is asked of the response of a signal to an input; frequencies in rad per time.
    pub(super) fn of_response(&self, modes: Option<&Modes>, signal: Observed, input: u32, of: OfResponse) -> Measured {
        let at = |w: f64| self.response(signal, input, Complex64::new(0.0, w), true);
        match of {
            OfResponse::Steady => match at(0.0) {
                Some(r) if r.g.re.is_finite() => Measured::of(r.g.re, r.by_theta.iter().map(|d| d.re).collect()),
                _ => Measured::missing("there is no steady response to a constant input"),
            },
            OfResponse::Gain(w) => at(w).map_or_else(pole, |r| {
                let size = r.g.norm();
                Measured::of(size, r.by_theta.iter().map(|d| (r.g.conj() * d).re / size).collect())
            }),
            OfResponse::Phase(w) => at(w).map_or_else(pole, |r| {
                let slopes = r.by_theta.iter().map(|d| (d / r.g).im.to_degrees()).collect();
                Measured::of(r.g.arg().to_degrees(), slopes)
            }),
            _ => Scan { linear: self, signal, input }.of(self.range(modes), of),
        }
    }

    /// The frequencies in which a response is looked at: a hundredth of the slowest mode to a hundred times the quickest mode or delay.
    fn range(&self, modes: Option<&Modes>) -> (f64, f64) {
        let sizes = modes.into_iter().flat_map(|m| m.modes.iter().map(|m| m.s.norm()));
        let largest = sizes.clone().fold(0.0, f64::max);
        let quick = |tau: &&f64| **tau > 0.0;
        let delays = self.values.tau.iter().filter(quick).map(|tau| 1.0 / tau);
        let all: Vec<f64> = sizes.filter(|w| *w > 1e-9 * largest).chain(delays).collect();
        let low = all.iter().copied().fold(f64::INFINITY, f64::min);
        let high = all.iter().copied().fold(0.0, f64::max);
        if high > 0.0 { (0.01 * low, 100.0 * high) } else { (1e-3, 1e3) }
    }
}

fn pole() -> Measured {
    Measured::missing("the response has a pole at this frequency")
}

/// A response from low to high frequencies, its phase without jumps.
struct Scan<'a> {
    linear: &'a Linear<'a>,
    signal: Observed,
    input: u32,
}

/// A frequency of the scan.
#[derive(Debug, Clone, Copy)]
struct At {
    w: f64,
    g: Complex64,
    /// In rad, without jumps.
    phase: f64,
}

/// A frequency with its derivatives by all parameters, and the response there.
struct Root {
    w: f64,
    by_theta: Vec<f64>,
    response: Response,
}

impl Scan<'_> {
    /// Most frequencies of a scan.
    const MOST: usize = 50_000;

    fn at(&self, w: f64) -> Option<Complex64> {
        self.linear.response(self.signal, self.input, Complex64::new(0.0, w), false).map(|r| r.g)
    }

    /// Frequencies from low to high, so close that the phase changes little from one to the next, until it is far below -180 deg.
    fn walk(&self, (low, high): (f64, f64)) -> Vec<At> {
        const LONGEST: f64 = 0.04;
        const SHORTEST: f64 = 1e-6;
        let Some(g) = self.at(low) else { return Vec::new() };
        let mut phase = g.arg();
        // a double integrator begins at -180 deg
        if phase > PI - 0.1 {
            phase -= 2.0 * PI;
        }
        let mut list = vec![At { w: low, g, phase }];
        let (mut w, mut last, mut step) = (low, g, LONGEST);
        while w < high && list.len() < Self::MOST && phase > -3.5 * PI {
            let next = w * (step * LN_10).exp();
            let Some(g) = self.at(next).filter(|g| g.norm() > 0.0 && g.norm().is_finite()) else { break };
            let turn = (g / last).arg();
            if turn.abs() > 0.3 && step > SHORTEST {
                step *= 0.5;
                continue;
            }
            phase += turn;
            list.push(At { w: next, g, phase });
            (w, last) = (next, g);
            step = (step * 1.5).min(LONGEST);
        }
        list
    }

    /// Where a function of the response passes zero between two neighbours of the scan, by bisection.
    fn root(&self, from: At, to: At, of: impl Fn(At) -> f64) -> Option<f64> {
        let (mut a, mut b) = (from, to);
        let falling = of(a) > of(b);
        for _ in 0..200 {
            let w = (a.w * b.w).sqrt();
            if w <= a.w || w >= b.w {
                break;
            }
            let g = self.at(w)?;
            let middle = At { w, g, phase: a.phase + (g / a.g).arg() };
            if (of(middle) > 0.0) == falling { a = middle } else { b = middle }
        }
        Some(0.5 * (a.w + b.w))
    }

    fn response(&self, w: f64) -> Option<Response> {
        self.linear.response(self.signal, self.input, Complex64::new(0.0, w), true)
    }

    /// The first frequency at which the phase falls through a value.
    fn phase_falls(&self, list: &[At], to: f64) -> Option<Root> {
        let k = list.windows(2).position(|p| p[0].phase > to && p[1].phase <= to)?;
        let w = self.root(list[k], list[k + 1], |at| at.phase - to)?;
        let response = self.response(w)?;
        // d arg g = im(dg/g); by the frequency s = j w
        let rate = (response.by_s / response.g).re;
        let by_theta = response.by_theta.iter().map(|d| -(d / response.g).im / rate).collect();
        Some(Root { w, by_theta, response })
    }

    fn of(&self, range: (f64, f64), of: OfResponse) -> Measured {
        let list = self.walk(range);
        let Some(first) = list.first() else { return pole() };
        let begins = first.phase.to_degrees();
        let half = |list: &[At]| self.phase_falls(list, -PI);
        let never = |degrees: f64| match begins <= degrees {
            true => format!("the phase begins at {begins:.0} deg, below {degrees} deg: has the signal the right sign?"),
            false => format!("the phase does not reach {degrees} deg"),
        };
        match of {
            OfResponse::PhaseBandwidth => {
                self.phase_bandwidth(&list).unwrap_or_else(|| Measured::missing(never(-135.0)))
            }
            OfResponse::GainBandwidth => match half(&list) {
                Some(root) => self
                    .gain_bandwidth(&list, &root)
                    .unwrap_or_else(|| Measured::missing("the gain is nowhere 6 dB above that at -180 deg")),
                None => Measured::missing(never(-180.0)),
            },
            OfResponse::Bandwidth => {
                let Some(by_phase) = self.phase_bandwidth(&list) else { return Measured::missing(never(-135.0)) };
                let by_gain = half(&list).and_then(|root| self.gain_bandwidth(&list, &root));
                match by_gain {
                    Some(by_gain) if by_gain.value < by_phase.value => by_gain,
                    _ => by_phase,
                }
            }
            OfResponse::PhaseDelay => {
                let found = half(&list).and_then(|root| self.phase_delay(&list, &root));
                found.unwrap_or_else(|| Measured::missing(never(-180.0)))
            }
            OfResponse::GainMargin => match half(&list) {
                Some(root) => self.gain_margin(&root),
                None => Measured::missing(never(-180.0)),
            },
            OfResponse::Crossover | OfResponse::PhaseMargin => match self.crossover(&list) {
                Some((root, _)) if of == OfResponse::Crossover => Measured::of(root.w, root.by_theta),
                Some((root, phase)) => {
                    let rate = (root.response.by_s / root.response.g).re;
                    let slope =
                        |(k, d): (usize, &Complex64)| ((d / root.response.g).im + rate * root.by_theta[k]).to_degrees();
                    let slopes = root.response.by_theta.iter().enumerate().map(slope).collect();
                    Measured::of(180.0 + phase.to_degrees(), slopes)
                }
                None => Measured::missing("the gain is nowhere one"),
            },
            OfResponse::Gain(_) | OfResponse::Phase(_) | OfResponse::Steady => Measured::missing("it is no frequency"),
        }
    }

    fn phase_bandwidth(&self, list: &[At]) -> Option<Measured> {
        let root = self.phase_falls(list, -0.75 * PI)?;
        Some(Measured::of(root.w, root.by_theta))
    }

    /// The nearest frequency below that of -180 deg at which the gain is 6 dB above the gain there.
    fn gain_bandwidth(&self, list: &[At], half: &Root) -> Option<Measured> {
        let level = half.response.g.norm() * 10f64.powf(0.3);
        let below: Vec<At> = list.iter().copied().filter(|at| at.w < half.w).collect();
        let k = below.iter().rposition(|at| at.g.norm() >= level)?;
        let end = At { w: half.w, g: half.response.g, phase: -PI };
        let next = below.get(k + 1).copied().unwrap_or(end);
        let w = self.root(below[k], next, |at| at.g.norm() - level)?;
        let response = self.response(w)?;
        let (here, there) = (&response, &half.response);
        // ln|g| by the frequency and by parameters, here and at -180 deg
        let rate = -(here.by_s / here.g).im;
        let moved = -(there.by_s / there.g).im;
        let slope = |k: usize| {
            let level = (there.by_theta[k] / there.g).re + moved * half.by_theta[k];
            (level - (here.by_theta[k] / here.g).re) / rate
        };
        Some(Measured::of(w, (0..here.by_theta.len()).map(slope).collect()))
    }

    /// The phase at twice the frequency of -180 deg, in rad below -180 deg, over that frequency.
    fn phase_delay(&self, list: &[At], half: &Root) -> Option<Measured> {
        let w = 2.0 * half.w;
        let response = self.response(w)?;
        // the phase without jumps: from the nearest frequency of the scan
        let near = list.iter().take_while(|at| at.w <= w).last()?;
        let (mut from, mut phase) = (near.g, near.phase);
        for k in 1..=64 {
            let g = self.at(near.w + (w - near.w) * f64::from(k) / 64.0)?;
            phase += (g / from).arg();
            from = g;
        }
        let rate = (response.by_s / response.g).re;
        let value = (-PI - phase) / w;
        let slope = |(k, d): (usize, &Complex64)| {
            let by = 2.0 * half.by_theta[k];
            -((d / response.g).im + rate * by) / w - value / w * by
        };
        Some(Measured::of(value, response.by_theta.iter().enumerate().map(slope).collect()))
    }

    /// -20 log10 of the gain at -180 deg.
    fn gain_margin(&self, half: &Root) -> Measured {
        let Root { response, by_theta, .. } = half;
        let scale = 20.0 / LN_10;
        let rate = -(response.by_s / response.g).im;
        let slope = |(k, d): (usize, &Complex64)| -scale * ((d / response.g).re + rate * by_theta[k]);
        Measured::of(-scale * response.g.norm().ln(), response.by_theta.iter().enumerate().map(slope).collect())
    }

    /// The highest frequency of unit gain, and the phase there.
    fn crossover(&self, list: &[At]) -> Option<(Root, f64)> {
        let k = list.windows(2).rposition(|p| (p[0].g.norm() >= 1.0) != (p[1].g.norm() >= 1.0))?;
        let w = self.root(list[k], list[k + 1], |at| at.g.norm() - 1.0)?;
        let response = self.response(w)?;
        let phase = list[k].phase + (response.g / list[k].g).arg();
        let rate = -(response.by_s / response.g).im;
        let by_theta = response.by_theta.iter().map(|d| -(d / response.g).re / rate).collect();
        Some((Root { w, by_theta, response }, phase))
    }
}
