//! Kinematics between the channels of a record: attitude and rates, velocities and accelerations, positions and their derivatives, by the names
//! of the field. No parameter of a model stands in them, so that they tell signs, units, axes, delays and zeros where a model cannot.
//!
//! An equation `y' = f` is compared in its weak form: with windows that vanish at both ends, `-integral of w' y = integral of w f` (Shinbrot
//! 1957; Preisig and Rippin 1993). Nothing is differentiated, nothing drifts, and windows that overlap by half are nearly independent.

use crate::edit::{Channels, Edit, edited_record, lagged, time_factor};
use crate::finding::{Fault, Finding};
use crate::independent::{independent_samples, variance};
use crate::record::{Channel, Record};
use crate::repair::Repair;
use fdm_system::record::frame::{ACCELERATIONS, ANGLES, BODY_VELOCITY, POSITION, RATES, VELOCITY, plain};
use std::f64::consts::{PI, TAU};

/// What a channel measures, in radians, metres and seconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Quantity {
    Phi,
    Theta,
    Psi,
    P,
    Q,
    R,
    Ax,
    Ay,
    Az,
    U,
    V,
    W,
    Speed,
    Alpha,
    Beta,
    Height,
    Climb,
    X,
    Y,
    Z,
    Vn,
    Ve,
    Vd,
    // made of others, never measured
    Ahead,
    Right,
    Sinking,
    Rest,
}

const QUANTITIES: usize = 27;

use Quantity as K;

/// Names of what is measured, and what its unit measures: an angle, a rate, an acceleration, a speed or a length.
const NAMES: [(K, Unit, &[&str]); 23] = [
    (K::Phi, Unit::Angle, ANGLES[0]),
    (K::Theta, Unit::Angle, ANGLES[1]),
    (K::Psi, Unit::Angle, ANGLES[2]),
    (K::P, Unit::Rate, RATES[0]),
    (K::Q, Unit::Rate, RATES[1]),
    (K::R, Unit::Rate, RATES[2]),
    (K::Ax, Unit::Acceleration, ACCELERATIONS[0]),
    (K::Ay, Unit::Acceleration, ACCELERATIONS[1]),
    (K::Az, Unit::Acceleration, ACCELERATIONS[2]),
    (K::U, Unit::Speed, BODY_VELOCITY[0]),
    (K::V, Unit::Speed, BODY_VELOCITY[1]),
    (K::W, Unit::Speed, BODY_VELOCITY[2]),
    (K::Speed, Unit::Speed, &["v", "tas", "vtas", "v_tas", "airspeed", "speed"]),
    (K::Alpha, Unit::Angle, &["alpha", "aoa", "incidence"]),
    (K::Beta, Unit::Angle, &["beta", "aos", "sideslip"]),
    (K::Height, Unit::Length, &["h", "alt", "altitude", "height"]),
    (K::Climb, Unit::Speed, &["hdot", "h_dot", "climb", "climb_rate", "vs", "roc"]),
    (K::X, Unit::Length, POSITION[0]),
    (K::Y, Unit::Length, POSITION[1]),
    (K::Z, Unit::Length, POSITION[2]),
    (K::Vn, Unit::Speed, VELOCITY[0]),
    (K::Ve, Unit::Speed, VELOCITY[1]),
    (K::Vd, Unit::Speed, VELOCITY[2]),
];

/// What a unit measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Unit {
    Angle,
    Rate,
    Acceleration,
    Speed,
    Length,
}

impl Unit {
    /// Factor to radians, metres and seconds; none where the unit measures something else.
    fn factor(self, unit: &str) -> Option<f64> {
        const FOOT: f64 = 0.3048;
        const KNOT: f64 = 1852.0 / 3600.0;
        Some(match (self, unit) {
            (Self::Angle, "rad") | (Self::Rate, "rad/s") | (Self::Length, "m") | (Self::Speed, "m/s") => 1.0,
            (Self::Acceleration, "m/s^2" | "m/s2" | "m/s²") => 1.0,
            (Self::Angle, "deg" | "°") | (Self::Rate, "deg/s" | "°/s" | "dps") => PI / 180.0,
            (Self::Acceleration, "g" | "g0") => 9.806_65,
            (Self::Acceleration, "ft/s^2") | (Self::Speed, "ft/s") | (Self::Length, "ft") => FOOT,
            (Self::Speed, "kt" | "kn" | "kts" | "knot" | "knots") => KNOT,
            (Self::Speed, "km/h") => 1.0 / 3.6,
            (Self::Length, "km") => 1e3,
            _ => return None,
        })
    }
}

/// `y' = f(..)`, with what has to be measured. Of what else stands in it and was not measured, 0 is taken.
struct Form {
    left: K,
    needs: &'static [K],
    right: fn(&Instant) -> f64,
    constant: Constant,
}

/// What is added to the right side of a form.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Constant {
    /// Nothing.
    None,
    /// Any constant: a current, the wind.
    Free,
    /// The zero of an accelerometer, to a tenth of gravity; where a trim was subtracted, gravity itself. So gravity tells which way is up.
    Zero,
    /// Any constant, in a form `y = f` that holds for vehicles only that thrust or lift along their z axis carries.
    Carried,
}

/// The quantities at one instant; 0 where nothing was measured.
struct Instant([f64; QUANTITIES]);

impl Instant {
    fn of(&self, quantity: K) -> f64 {
        self.0[quantity as usize]
    }

    /// Yaw rate in the horizontal plane, without the cosine of pitch.
    fn turning(&self) -> f64 {
        self.of(K::Q) * self.of(K::Phi).sin() + self.of(K::R) * self.of(K::Phi).cos()
    }

    /// A vector of the vehicle in axes ahead, to the right and down.
    fn levelled(&self, [x, y, z]: [K; 3]) -> [f64; 3] {
        let ((s, c), (st, ct)) = (self.of(K::Phi).sin_cos(), self.of(K::Theta).sin_cos());
        let (x, y, z) = (self.of(x), self.of(y), self.of(z));
        let below = s * y + c * z;
        [ct * x + st * below, c * y - s * z, ct * below - st * x]
    }

    /// A vector of the vehicle over the earth.
    fn over_earth(&self, vector: [K; 3]) -> [f64; 3] {
        let ([ahead, right, down], (s, c)) = (self.levelled(vector), self.of(K::Psi).sin_cos());
        [c * ahead - s * right, s * ahead + c * right, down]
    }
}

const FORCE: [K; 3] = [K::Ax, K::Ay, K::Az];

const GRAVITY: f64 = 9.806_65;

/// Rigid-body kinematics over a flat earth (Stevens, Lewis and Johnson 2016, table 2.5-1).
const FORMS: [Form; 15] = [
    Form {
        left: K::Phi,
        needs: &[K::P],
        right: |t| t.of(K::P) + t.of(K::Theta).tan() * t.turning(),
        constant: Constant::None,
    },
    Form {
        left: K::Theta,
        needs: &[K::Q],
        right: |t| t.of(K::Q) * t.of(K::Phi).cos() - t.of(K::R) * t.of(K::Phi).sin(),
        constant: Constant::None,
    },
    Form { left: K::Psi, needs: &[K::R], right: |t| t.turning() / t.of(K::Theta).cos(), constant: Constant::None },
    Form {
        left: K::U,
        needs: &[K::Ax, K::Theta],
        right: |t| t.of(K::Ax) - GRAVITY * t.of(K::Theta).sin() + t.of(K::R) * t.of(K::V) - t.of(K::Q) * t.of(K::W),
        constant: Constant::Zero,
    },
    Form {
        left: K::V,
        needs: &[K::Ay, K::Phi, K::R, K::U],
        right: |t| {
            t.of(K::Ay) + GRAVITY * t.of(K::Phi).sin() * t.of(K::Theta).cos() - t.of(K::R) * t.of(K::U)
                + t.of(K::P) * t.of(K::W)
        },
        constant: Constant::Zero,
    },
    Form {
        left: K::W,
        needs: &[K::Az, K::Theta, K::Q, K::U],
        right: |t| {
            t.of(K::Az) + GRAVITY * t.of(K::Phi).cos() * t.of(K::Theta).cos() + t.of(K::Q) * t.of(K::U)
                - t.of(K::P) * t.of(K::V)
        },
        constant: Constant::Zero,
    },
    Form { left: K::Height, needs: &[K::Climb], right: |t| t.of(K::Climb), constant: Constant::None },
    Form {
        left: K::X,
        needs: &[K::U, K::Psi],
        right: |t| t.of(K::U) * t.of(K::Psi).cos() - t.of(K::V) * t.of(K::Psi).sin(),
        constant: Constant::Free,
    },
    Form {
        left: K::Y,
        needs: &[K::U, K::Psi],
        right: |t| t.of(K::U) * t.of(K::Psi).sin() + t.of(K::V) * t.of(K::Psi).cos(),
        constant: Constant::Free,
    },
    Form {
        left: K::Vn,
        needs: &[K::Ax, K::Ay, K::Az, K::Phi, K::Theta, K::Psi],
        right: |t| t.over_earth(FORCE)[0],
        constant: Constant::Zero,
    },
    Form {
        left: K::Ve,
        needs: &[K::Ax, K::Ay, K::Az, K::Phi, K::Theta, K::Psi],
        right: |t| t.over_earth(FORCE)[1],
        constant: Constant::Zero,
    },
    Form {
        left: K::Vd,
        needs: &[K::Az, K::Phi, K::Theta],
        right: |t| t.levelled(FORCE)[2] + GRAVITY,
        constant: Constant::Zero,
    },
    // nobody climbs or falls for long
    Form {
        left: K::Rest,
        needs: &[K::Az, K::Phi, K::Theta],
        right: |t| t.levelled(FORCE)[2] + GRAVITY,
        constant: Constant::Zero,
    },
    // accelerations in the axes of the heading: what thrust or lift along z makes of the tilt
    Form {
        left: K::Ahead,
        needs: &[K::Theta, K::Psi],
        right: |t| -(GRAVITY - t.of(K::Sinking)) * t.of(K::Theta).tan(),
        constant: Constant::Carried,
    },
    Form {
        left: K::Right,
        needs: &[K::Phi, K::Psi],
        right: |t| (GRAVITY - t.of(K::Sinking)) * t.of(K::Phi).tan() / t.of(K::Theta).cos(),
        constant: Constant::Carried,
    },
];

/// One equation of the records: its form, or a channel and the one that is called its derivative.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Equation {
    Form(usize),
    /// Places of the channel and of its derivative.
    Derivative(usize, usize),
}

/// What an equation leaves of a record.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Balance {
    /// Sum of squares of what is left over that of the left side; NaN where there is nothing to compare.
    pub unexplained: f64,
    /// Independent windows.
    pub independent: f64,
    /// What the gain costs, in nats.
    pub cost: f64,
    /// The factor by which the right side is multiplied.
    pub gain: f64,
    /// Between which the factor lies whichever side the noise is on (Frisch 1934), with four standard errors; NaN where it is not known.
    pub between: [f64; 2],
}

/// The equations that hold between the channels of records.
#[derive(Debug, Clone, Default)]
pub struct Kinematics {
    /// Place of each quantity among the channels, and the factor to radians, metres and seconds.
    places: [Option<(usize, f64)>; QUANTITIES],
    equations: Vec<Equation>,
    /// Intervals of a window.
    window: usize,
}

/// Deviation of the logarithm of a gain: sensors are calibrated to a fifth, and attitude filters lag.
const GAIN: f64 = 0.2;

impl Kinematics {
    /// Of records with the same channels. Channels of angles that state no unit are all in radians or all in degrees, rates likewise: as the
    /// equations hold best.
    pub fn of(records: &[Record], channels: &Channels) -> Self {
        let Some(first) = records.first().filter(|_| records.iter().all(|r| r.clocked)) else { return Self::default() };
        let mut places = [None; QUANTITIES];
        for (quantity, kind, names) in NAMES {
            // a state estimate and its sensor may both be there; the measured one stands first in the list of names
            let found = names.iter().find_map(|name| {
                let called = |c: &Channel| plain(&c.name) == *name;
                let factor = |c: &Channel| c.unit.as_deref().map_or(Some(1.0), |u| kind.factor(u));
                first.channels.iter().enumerate().find_map(|(k, c)| Some((k, factor(c).filter(|_| called(c))?)))
            });
            // `v` is a speed where `u` is not measured
            let taken = quantity == K::Speed && places[K::V as usize].is_some();
            let lone = quantity == K::V && !first.channels.iter().any(|c| plain(&c.name) == "u");
            places[quantity as usize] = found.filter(|_| !taken && !lone);
        }
        let mut own = Self { places, equations: Vec::new(), window: 0 };
        let has = |q: K| own.places[q as usize].is_some() || own.derived(q);
        let fits = |f: &Form| has(f.left) && f.needs.iter().all(|q| has(*q));
        let forms = (0..FORMS.len()).filter(|k| fits(&FORMS[*k])).map(Equation::Form).collect();
        own.equations = forms;
        own.add_velocities();
        own.add_derivatives(&first.channels);
        if own.equations.is_empty() {
            return own;
        }
        own.window = own.best_window(records, channels);
        own.interpret(records, channels)
    }

    /// Without the equations that hold only about: they tell frames, and neither sizes nor what a model tells better.
    #[must_use]
    pub fn exact(mut self) -> Self {
        self.equations.retain(|e| !matches!(e, Equation::Form(k) if FORMS[*k].constant == Constant::Carried));
        self
    }

    /// Whether there is anything to compare.
    pub fn is_empty(&self) -> bool {
        self.equations.is_empty()
    }

    /// Whether a channel (by its place) stands in one of the equations.
    pub fn reads(&self, place: usize) -> bool {
        let needed = |form: &Form| {
            let read = |q: K| self.places[q as usize].is_some_and(|(k, _)| k == place);
            let aerodynamic = [K::Speed, K::Alpha, K::Beta].iter().any(|q| read(*q));
            let over_earth = [K::X, K::Y, K::Z, K::Vn, K::Ve, K::Vd].iter().any(|q| read(*q));
            let constant = form.constant != Constant::None;
            read(form.left) || form.needs.iter().any(|q| read(*q)) || (aerodynamic || over_earth) && constant
        };
        self.equations.iter().any(|e| match *e {
            Equation::Form(k) => needed(&FORMS[k]),
            Equation::Derivative(y, x) => y == place || x == place,
        })
    }

    /// What is made of other channels, where it was not measured itself: velocities along body axes from speed and flow angles, those over the
    /// earth from positions or from velocities along body axes.
    fn derived(&self, quantity: K) -> bool {
        let has = |q: K| self.places[q as usize].is_some();
        let all = |list: &[K]| list.iter().all(|q| has(*q));
        let forces = FORCE.iter().any(|q| has(*q));
        // velocities along body axes have equations of their own beside accelerometers
        let flown = || !forces && all(&[K::U, K::V, K::W, K::Phi, K::Theta, K::Psi]);
        match quantity {
            K::U => has(K::Speed),
            K::V => has(K::Speed) && has(K::Beta),
            K::W => has(K::Speed) && has(K::Alpha),
            K::Vn => has(K::X) || flown(),
            K::Ve => has(K::Y) || flown(),
            K::Vd => has(K::Z) || has(K::Climb) || has(K::Height) || flown(),
            K::Ahead | K::Right => {
                let moves = |q: K| has(q) || self.derived(q);
                !forces && moves(K::Vn) && moves(K::Ve)
            }
            K::Rest => !has(K::Vd) && !self.derived(K::Vd),
            _ => false,
        }
    }

    /// Positions beside velocities over the earth that were measured too.
    fn add_velocities(&mut self) {
        for pair in [[K::X, K::Vn], [K::Y, K::Ve], [K::Z, K::Vd]] {
            if let [Some((y, _)), Some((x, _))] = pair.map(|q| self.places[q as usize]) {
                self.equations.push(Equation::Derivative(y, x));
            }
        }
    }

    /// Channels that are called the derivative of another one: `x_dot`, `xdot`, `dx`, `xd`, `x_rate`.
    fn add_derivatives(&mut self, all: &[Channel]) {
        let known: Vec<usize> = self.equations.iter().filter_map(|e| self.left_place(*e)).collect();
        for (y, channel) in all.iter().enumerate().filter(|(k, _)| !known.contains(k)) {
            let name = plain(&channel.name);
            let called = [format!("{name}_dot"), format!("{name}dot"), format!("d{name}"), format!("{name}d")];
            let rate = format!("{name}_rate");
            let is = |c: &Channel| {
                let own = plain(&c.name);
                called.contains(&own) || own == rate
            };
            if let Some(x) = all.iter().position(|c| is(c) && fits_derivative(channel, c)) {
                self.equations.push(Equation::Derivative(y, x));
            }
        }
    }

    /// Whether a channel stands on the left side of an equation, or is what the right side needs.
    fn has(&self, equation: Equation, place: usize) -> bool {
        let needed = match equation {
            Equation::Form(k) => {
                FORMS[k].needs.iter().any(|q| self.places[*q as usize].is_some_and(|(p, _)| p == place))
            }
            Equation::Derivative(_, x) => x == place,
        };
        needed || self.left_place(equation) == Some(place)
    }

    fn left_place(&self, equation: Equation) -> Option<usize> {
        match equation {
            Equation::Form(k) => self.places[FORMS[k].left as usize].map(|(place, _)| place),
            Equation::Derivative(y, _) => Some(y),
        }
    }

    /// The window in which left and right sides are likest: shorter ones differentiate noise, longer ones forget what moves.
    fn best_window(&self, records: &[Record], channels: &Channels) -> usize {
        let shortest = records.iter().map(|r| r.time.len()).min().unwrap_or(0);
        let windows = (3..9).map(|k| 1usize << k).filter(|w| *w == 8 || 30 * w <= shortest);
        let likeness = |window: usize| {
            let own = Self { window, ..self.clone() };
            let sides = own.sides(records, channels, &[]);
            sides.iter().map(|s| -(1.0 - s.correlation().powi(2)).max(1e-9).ln()).sum::<f64>()
        };
        windows.map(|w| (w, likeness(w))).max_by(|a, b| a.1.total_cmp(&b.1)).map_or(8, |(w, _)| w)
    }

    /// Radians or degrees of what states no unit: those of what does, and where nobody does, as the equations hold best. So one channel that is in
    /// another unit than all others is a fault, and no matter of choice.
    fn interpret(mut self, records: &[Record], channels: &Channels) -> Self {
        let first = &records[0].channels;
        let angular = [K::Phi, K::Theta, K::Psi, K::Alpha, K::Beta, K::P, K::Q, K::R];
        let there = angular.into_iter().filter_map(|q| Some((q, self.places[q as usize]?)));
        let (silent, stated): (Vec<_>, Vec<_>) = there.partition(|(_, (k, _))| first[*k].unit.is_none());
        let all: Vec<K> = silent.into_iter().map(|(q, _)| q).collect();
        let factors: Vec<f64> = stated.into_iter().map(|(_, (_, factor))| factor).collect();
        if let Some(common) = factors.first().filter(|f| factors.iter().all(|g| g == *f)) {
            for q in all {
                if let Some(place) = &mut self.places[q as usize] {
                    place.1 = *common;
                }
            }
            return self;
        }
        if all.is_empty() {
            return self;
        }
        let mut degrees = self.clone();
        for q in all {
            if let Some(place) = &mut degrees.places[q as usize] {
                place.1 = PI / 180.0;
            }
        }
        let worth = |k: &Self| -> f64 {
            let balances = k.balances(records, channels, &[]);
            balances
                .iter()
                .filter(|b| b.unexplained.is_finite())
                .map(|b| -0.5 * b.independent * b.unexplained.ln() - b.cost)
                .sum()
        };
        if worth(&degrees) > worth(&self) { degrees } else { self }
    }

    /// What each equation leaves of the records as the edits make them.
    pub fn balances(&self, records: &[Record], channels: &Channels, edits: &[Edit]) -> Vec<Balance> {
        let sides = self.sides(records, channels, edits);
        let balance = |(sides, equation): (&Sides, &Equation)| {
            let mut balance = sides.balance();
            balance.unexplained /= self.left_of_noise(*equation, records, channels, edits);
            balance
        };
        sides.iter().zip(&self.equations).map(balance).collect()
    }

    /// The part of the variance of white noise that a filter edit leaves of an equation's windows, on the side without the channel.
    fn left_of_noise(&self, equation: Equation, records: &[Record], channels: &Channels, edits: &[Edit]) -> f64 {
        let filter = |e: &Edit| if let Edit::Filter(slot, lag) = *e { Some((channels.place(slot), lag)) } else { None };
        let Some(((place, lag), record)) = edits.iter().find_map(filter).zip(records.first()) else { return 1.0 };
        if !self.has(equation, place) {
            return 1.0;
        }
        let (window, n) = (self.window, record.time.len());
        let interval = time_factor(edits) * (record.time[n - 1] - record.time[0]) / (n - 1) as f64;
        let times: Vec<f64> = (0..3 * window).map(|k| k as f64 * interval).collect();
        let part = |derived: bool| {
            let weight = |k: usize| match k as f64 / window as f64 {
                s if s > 1.0 => 0.0,
                s if derived => (TAU * s).sin(),
                s => (PI * s).sin().powi(2),
            };
            let weights: Vec<f64> = (0..3 * window).map(weight).collect();
            let squares = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>();
            squares(&lagged(&times, &weights, lag, false)) / squares(&weights)
        };
        part(self.left_place(equation) != Some(place))
    }

    /// Remarks about factors between a channel and its derivative that are more than a tenth away from 1: a filter, a factor or the sampling
    /// interval, none of which the equations tell from another.
    pub fn remarks(&self, records: &[Record], channels: &Channels, edits: &[Edit]) -> Vec<Finding> {
        const LARGE: f64 = 0.1;
        let balances = self.balances(records, channels, edits);
        let off = |b: &Balance| b.between[0] > 1.0 + LARGE || b.between[1] < 1.0 / (1.0 + LARGE);
        let alike = |a: &Balance, b: &Balance| a.between[0] < b.between[1] && b.between[0] < a.between[1];
        let name = |place: usize| records[0].channels[place].name.clone();
        let told = |(equation, balance): (&Equation, &Balance)| {
            if !off(balance) {
                return None;
            }
            let (y, x) = match *equation {
                Equation::Form(k) if FORMS[k].constant == Constant::None => {
                    (self.left_place(*equation)?, self.places[FORMS[k].needs[0] as usize]?.0)
                }
                Equation::Form(_) => return None,
                Equation::Derivative(y, x) => (y, x),
            };
            let [low, high] = balance.between;
            let same = balances.iter().filter(|b| off(b) && alike(b, balance)).count();
            // a factor that may be none has no logarithm
            let middle = if low > 0.0 { (low * high).sqrt() } else { 0.5 * (low + high) };
            let mut what = format!(
                "`{}` changes by {middle:.3} ({low:.3} to {high:.3}) times what `{}` says: a scale factor or a filter of either, or samples \
                 that are not as far apart as their times",
                name(y),
                name(x)
            );
            if same > 1 {
                what.push_str(&format!("; so do {same} of {} such pairs", balances.len()));
            }
            let run = if let [record] = records { record.run.as_str() } else { "all" };
            let mut remark = Finding::by_chance(run, &name(x), Fault::Scale, 1.0, what).remark();
            remark.channels.push(name(y));
            Some(remark.repaired_by(Repair::words(
                "compare the calibration and the filters of both sensors before either is fitted",
            )))
        };
        self.equations.iter().zip(&balances).filter_map(told).collect()
    }

    /// Without the equations that these columns break: those of a model's own response, whose delays and scale factors are meant.
    pub fn held_by(mut self, response: &[Record], measured: &[bool], channels: &Channels) -> Self {
        const BROKEN: f64 = 0.1;
        let balances = self.balances(response, channels, &[]);
        let whole = |e: &Equation| match *e {
            Equation::Form(k) => {
                let form = &FORMS[k];
                let answered = |q: &K| self.places[*q as usize].is_none_or(|(place, _)| !measured[place]);
                answered(&form.left) && form.needs.iter().all(answered)
            }
            Equation::Derivative(y, x) => !measured[y] && !measured[x],
        };
        let kept = self.equations.iter().zip(&balances).filter(|(e, b)| !whole(e) || b.unexplained <= BROKEN);
        self.equations = kept.map(|(e, _)| *e).collect();
        self
    }

    fn sides(&self, records: &[Record], channels: &Channels, edits: &[Edit]) -> Vec<Sides> {
        let mut all: Vec<Sides> = self.equations.iter().map(|e| Sides::new(*e)).collect();
        for record in records.iter().filter(|r| r.time.len() > self.window) {
            let edited = edited_record(record, channels, edits, &[]);
            // what does not have the filtered channel in it stays as it is: products are not what a lag leaves of them
            let filtered = edits.iter().find_map(|e| if let Edit::Filter(slot, _) = e { Some(*slot) } else { None });
            let others: Vec<Edit> = edits.iter().filter(|e| !matches!(e, Edit::Filter(..))).copied().collect();
            let unfiltered = filtered.map(|slot| (channels.place(slot), edited_record(record, channels, &others, &[])));
            let both = [
                Some(self.quantities(&edited.time, &edited.columns)),
                unfiltered.as_ref().map(|(_, r)| self.quantities(&r.time, &r.columns)),
            ];
            for (sides, equation) in all.iter_mut().zip(&self.equations) {
                let (edited, columns) = match (&unfiltered, &both) {
                    (Some((place, plain)), [_, Some(columns)]) if !self.has(*equation, *place) => (plain, columns),
                    (_, [Some(columns), _]) => (&edited, columns),
                    _ => continue,
                };
                let n = edited.time.len();
                let (left, right): (Vec<f64>, Vec<f64>) = match *equation {
                    Equation::Form(k) => {
                        let form = &FORMS[k];
                        let left = &columns[form.left as usize];
                        let angle = matches!(form.left, K::Phi | K::Theta | K::Psi);
                        let left = if angle { unwrapped(left) } else { left.clone() };
                        (left, instants(columns, n).map(|t| (form.right)(&t)).collect())
                    }
                    Equation::Derivative(y, x) => {
                        let factor = ratio(&records[0].channels[y], &records[0].channels[x]);
                        (edited.columns[y].to_vec(), edited.columns[x].iter().map(|v| factor * v).collect())
                    }
                };
                sides.add(&edited.time, &left, &right, self.window);
            }
        }
        all
    }

    /// Each quantity as a column in radians, metres and seconds; empty where it is not measured.
    fn quantities(&self, time: &[f64], columns: &[std::borrow::Cow<'_, [f64]>]) -> Vec<Vec<f64>> {
        let column = |place: &Option<(usize, f64)>| match place {
            Some((k, factor)) => columns[*k].iter().map(|v| factor * v).collect(),
            None => Vec::new(),
        };
        let mut all: Vec<Vec<f64>> = self.places.iter().map(column).collect();
        for (q, part) in [K::U, K::V, K::W].into_iter().zip(0..3) {
            if self.places[q as usize].is_some() || !self.derived(q) {
                continue;
            }
            let at = |q: K, s: usize| all[q as usize].get(s).copied().unwrap_or(0.0);
            let n = all[K::Speed as usize].len();
            let values = (0..n).map(|s| {
                let (speed, alpha, beta) = (at(K::Speed, s), at(K::Alpha, s), at(K::Beta, s));
                speed * [alpha.cos() * beta.cos(), beta.sin(), alpha.sin() * beta.cos()][part]
            });
            let values: Vec<f64> = values.collect();
            all[q as usize] = values;
        }
        let rate = |values: &[f64]| differences(time, values);
        let made = |q: K| self.places[q as usize].is_none() && self.derived(q);
        for (part, (q, position)) in [(K::Vn, K::X), (K::Ve, K::Y), (K::Vd, K::Z)].into_iter().enumerate() {
            if !made(q) {
                continue;
            }
            let upwards = |values: Vec<f64>| values.iter().map(|v| -v).collect();
            let measured = |q: K| self.places[q as usize].is_some();
            all[q as usize] = match q {
                _ if measured(position) => rate(&all[position as usize]),
                K::Vd if measured(K::Climb) => upwards(all[K::Climb as usize].clone()),
                K::Vd if measured(K::Height) => upwards(rate(&all[K::Height as usize])),
                _ => instants(&all, time.len()).map(|t| t.over_earth([K::U, K::V, K::W])[part]).collect(),
            };
        }
        if made(K::Ahead) {
            let [north, east, down] = [K::Vn, K::Ve, K::Vd].map(|q| rate(&all[q as usize]));
            let turned = |((psi, n), e): ((&f64, &f64), &f64)| {
                let (s, c) = psi.sin_cos();
                (c * n + s * e, c * e - s * n)
            };
            let (ahead, right) = all[K::Psi as usize].iter().zip(&north).zip(&east).map(turned).unzip();
            for (q, values) in [(K::Ahead, ahead), (K::Right, right), (K::Sinking, down)] {
                all[q as usize] = values;
            }
        }
        if self.derived(K::Rest) {
            all[K::Rest as usize] = vec![0.0; time.len()];
        }
        all
    }
}

/// Whether the units allow that one channel is the derivative of the other by time in seconds.
fn fits_derivative(channel: &Channel, rate: &Channel) -> bool {
    match (channel.unit.as_deref(), rate.unit.as_deref()) {
        (Some(unit), Some(derived)) => {
            let kinds = [(Unit::Angle, Unit::Rate), (Unit::Length, Unit::Speed), (Unit::Speed, Unit::Acceleration)];
            derived == format!("{unit}/s")
                || kinds.iter().any(|(a, b)| a.factor(unit).is_some() && b.factor(derived).is_some())
        }
        _ => true,
    }
}

/// Factor that turns the derivative into units of the channel.
fn ratio(channel: &Channel, rate: &Channel) -> f64 {
    let (Some(unit), Some(derived)) = (channel.unit.as_deref(), rate.unit.as_deref()) else { return 1.0 };
    let kinds = [(Unit::Angle, Unit::Rate), (Unit::Length, Unit::Speed), (Unit::Speed, Unit::Acceleration)];
    kinds.iter().find_map(|(a, b)| Some(b.factor(derived)? / a.factor(unit)?)).unwrap_or(1.0)
}

/// Quantities at each of n instants.
fn instants(columns: &[Vec<f64>], n: usize) -> impl Iterator<Item = Instant> + '_ {
    let at = |s: usize| Instant(std::array::from_fn(|q| columns[q].get(s).copied().unwrap_or(0.0)));
    (0..n).map(at)
}

/// Differences between the neighbours of each sample (N), over the time between them; nothing of nothing.
fn differences(time: &[f64], values: &[f64]) -> Vec<f64> {
    let n = values.len();
    let of = |k: usize| {
        let (a, b) = (k.saturating_sub(1), (k + 1).min(n - 1));
        (values[b] - values[a]) / (time[b] - time[a])
    };
    (0..n).map(of).collect()
}

/// Without jumps by a whole turn.
fn unwrapped(values: &[f64]) -> Vec<f64> {
    let mut turns = 0.0;
    let mut before = f64::NAN;
    let step = |v: &f64| {
        if (v - before).abs() > 0.8 * TAU && (v - before).abs() < 1.2 * TAU {
            turns -= TAU * (v - before).signum();
        }
        if v.is_finite() {
            before = *v;
        }
        v + turns
    };
    values.iter().map(step).collect()
}

/// Both sides of an equation in each window.
struct Sides {
    constant: Constant,
    left: Vec<f64>,
    right: Vec<f64>,
}

impl Sides {
    fn new(equation: Equation) -> Self {
        let constant = if let Equation::Form(k) = equation { FORMS[k].constant } else { Constant::None };
        Self { constant, left: Vec::new(), right: Vec::new() }
    }

    /// Windows of a record that overlap by half. Those with gaps in them, or a pause, are left out.
    fn add(&mut self, time: &[f64], left: &[f64], right: &[f64], window: usize) {
        let usual = (time[time.len() - 1] - time[0]) / (time.len() - 1) as f64 * window as f64;
        for begin in (0..time.len() - window).step_by(window / 2) {
            let end = begin + window;
            let span = time[end] - time[begin];
            if !(span > 0.0 && span < 2.0 * usual) {
                continue;
            }
            let (mut y, mut x) = (0.0, 0.0);
            for k in begin..=end {
                // the trapezoidal rule on times as they are; the window vanishes at both ends
                let weight = 0.5 * (time[(k + 1).min(end)] - time[k.saturating_sub(1).max(begin)]);
                let s = (time[k] - time[begin]) / span;
                let whole = weight * (PI * s).sin().powi(2);
                y += match self.constant {
                    Constant::Carried => whole * left[k],
                    _ => -weight * (PI / span) * (TAU * s).sin() * left[k],
                };
                x += whole * right[k];
            }
            if y.is_finite() && x.is_finite() {
                self.left.push(2.0 * y / span);
                self.right.push(2.0 * x / span);
            }
        }
    }

    /// Sums of squares and products of left and right sides, about the means where a constant is free.
    fn sums(&self) -> (f64, f64, f64, [f64; 2]) {
        let n = self.left.len().max(1) as f64;
        let mean = |v: &[f64]| if self.constant == Constant::None { 0.0 } else { v.iter().sum::<f64>() / n };
        let (my, mx) = (mean(&self.left), mean(&self.right));
        let pairs = self.left.iter().zip(&self.right).map(|(y, x)| (y - my, x - mx));
        let sums = pairs.fold((0.0, 0.0, 0.0), |(yy, xy, xx), (y, x)| (yy + y * y, xy + x * y, xx + x * x));
        (sums.0, sums.1, sums.2, [my, mx])
    }

    fn correlation(&self) -> f64 {
        let (yy, xy, xx, _) = self.sums();
        if yy > 0.0 && xx > 0.0 { xy / (yy * xx).sqrt() } else { 0.0 }
    }

    fn balance(&self) -> Balance {
        /// Of a deviation, beyond which a gain is another unit.
        const WIDEST: f64 = 4.0;
        const FEWEST: usize = 8;
        /// Part that is left of an equation that holds.
        const HOLDS: f64 = 0.5;
        let (yy, xy, xx, means) = self.sums();
        let cost = self.cost_of_constant(means);
        let nothing = Balance { unexplained: f64::NAN, independent: 0.0, cost, gain: 1.0, between: [f64::NAN; 2] };
        if self.left.len() < FEWEST || yy <= 0.0 || variance(self.left.iter().copied()) <= 0.0 {
            return nothing;
        }
        let left = |gain: f64| (yy - 2.0 * gain * xy + gain * gain * xx).max(1e-12 * yy);
        let residuals = |gain: f64| -> Vec<f64> {
            let pairs = self.left.iter().zip(&self.right);
            pairs.map(|(y, x)| (y - means[0]) - gain * (x - means[1])).collect()
        };
        // least squares within the widest gain; the cost of the gain moves it towards 1, by the independent windows
        let bound = (GAIN * WIDEST).exp();
        let free = if xx > 0.0 { (xy / xx).clamp(1.0 / bound, bound) } else { 1.0 };
        let independent = independent_samples(&residuals(free));
        let cost = |gain: f64| 0.5 * (gain.ln() / GAIN).powi(2);
        let value = |gain: f64| 0.5 * independent * left(gain).ln() + cost(gain);
        let steps = 64;
        let at = |k: i32| bound.powf(f64::from(k) / f64::from(steps));
        let gain = (-steps..=steps).map(at).min_by(|a, b| value(*a).total_cmp(&value(*b))).unwrap_or(1.0);
        let error = if xx > 0.0 { (left(xy / xx) / xx / independent.max(1.0)).sqrt() } else { f64::INFINITY };
        let between = if xy > 0.0 { [xy / xx - 4.0 * error, yy / xy + 4.0 * error] } else { [f64::NAN; 2] };
        let unexplained = left(gain) / yy;
        if self.constant == Constant::Carried && unexplained > HOLDS {
            // a car, a ship: its tilt says nothing
            return Balance { unexplained: 1.0, ..nothing };
        }
        let cost = cost(gain) + self.cost_of_constant([means[0], gain * means[1]]);
        Balance { unexplained, independent, cost, gain, between }
    }

    /// What the constant costs between the means of both sides, in nats.
    fn cost_of_constant(&self, [left, right]: [f64; 2]) -> f64 {
        /// Deviation of zeros of accelerometers and of the angles at which they are mounted: a tenth of gravity, in m/s^2.
        const ZERO: f64 = 0.1 * GRAVITY;
        /// Of records, with a trim subtracted.
        const TRIMMED: f64 = 0.2;
        if self.constant != Constant::Zero || self.left.is_empty() {
            return 0.0;
        }
        let of = |distance: f64| -0.5 * (distance / ZERO).powi(2);
        let (zero, trimmed) =
            (of(left - right) + (1.0 - TRIMMED).ln(), of((left - right).abs() - GRAVITY) + TRIMMED.ln());
        -zero.max(trimmed)
    }
}
