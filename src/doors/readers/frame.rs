//! Frames: in which axes the vectors of a record stand, and what turns them into north-east-down and forward-right-down.

use serde::{Deserialize, Serialize};
use std::fmt;

/// Axes over the earth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum World {
    /// North, east, down.
    Ned,
    /// East, north, up.
    Enu,
    /// North, west, up.
    Nwu,
}

/// Axes of the vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Body {
    /// Forward, right, down.
    Frd,
    /// Forward, left, up.
    Flu,
}

/// Frames of a record. Its attitude is that of the body axes over the world axes where z points the same way in both. In a mixed pair it is
/// that of a vehicle as flown: right wing down, nose up and clockwise from north are positive.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Frame {
    /// Of positions and velocities over the earth.
    pub world: World,
    /// Of velocities, rates and accelerations along the axes of the vehicle.
    pub body: Body,
}

/// What a vector is, which says the axes that it stands in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    OverEarth,
    AlongBody,
    Angles,
    Quaternion,
}

/// Names of the components of a vector, the first of each list together, then the second.
pub type Names = [&'static [&'static str]];

/// Position over the earth.
pub const POSITION: [&[&str]; 3] = [
    &["x", "north", "pos_n", "x_e", "pos_x"],
    &["y", "east", "pos_e", "y_e", "pos_y"],
    &["z", "down", "pos_d", "z_e", "pos_z"],
];
/// Velocity over the earth.
pub const VELOCITY: [&[&str]; 3] = [
    &["vx", "vn", "v_n", "vel_n", "vel_x"],
    &["vy", "ve", "v_e", "vel_e", "vel_y"],
    &["vz", "vd", "v_d", "vel_d", "vel_z"],
];
/// Velocity along body axes.
pub const BODY_VELOCITY: [&[&str]; 3] = [&["u"], &["v"], &["w"]];
/// Roll, pitch and yaw.
pub const ANGLES: [&[&str]; 3] = [
    &["phi", "roll", "bank", "roll_angle", "bank_angle"],
    &["theta", "pitch", "", "pitch_angle"],
    &["psi", "yaw", "heading", "yaw_angle", "compass"],
];
/// Rates about body axes.
pub const RATES: [&[&str]; 3] = [
    &["p", "phi_dot", "phidot", "roll_rate", "rollrate", "dphi", "gyro_x", "gyrx", "wx"],
    &["q", "theta_dot", "thetadot", "pitch_rate", "pitchrate", "dtheta", "gyro_y", "gyry", "wy"],
    &["r", "psi_dot", "psidot", "yaw_rate", "yawrate", "dpsi", "gyro_z", "gyrz", "wz", "gyro"],
];
/// Specific forces along body axes; a load factor along z counts upwards and is none of them.
pub const ACCELERATIONS: [&[&str]; 3] = [
    &["ax", "acc_x", "accx", "nx", "accel_x"],
    &["ay", "acc_y", "accy", "ny", "accel_y"],
    &["az", "acc_z", "accz", "", "accel_z"],
];
/// Attitude, the scalar first.
const QUATERNION: [&[&str]; 4] =
    [&["q0", "qw", "q_w"], &["q1", "qx", "q_x"], &["q2", "qy", "q_y"], &["q3", "qz", "q_z"]];

const VECTORS: [(Kind, &Names); 7] = [
    (Kind::OverEarth, &POSITION),
    (Kind::OverEarth, &VELOCITY),
    (Kind::AlongBody, &BODY_VELOCITY),
    (Kind::AlongBody, &RATES),
    (Kind::AlongBody, &ACCELERATIONS),
    (Kind::Angles, &ANGLES),
    (Kind::Quaternion, &QUATERNION),
];

/// A channel in the axes that are meant: the sum of channels with their factors, and a part of a whole turn.
#[derive(Debug, Clone, PartialEq)]
pub struct Turned {
    /// Place of the channel.
    pub channel: usize,
    /// What it is made of: places and factors.
    pub of: Vec<(usize, f64)>,
    /// What is added, in whole turns of an angle.
    pub turns: f64,
}

/// A component that a turn needs and that is not there.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("frame = \"{frame}\" makes `{channel}` of `{wanted}`, and no channel of that name is there; add it to the map")]
pub struct NoComponent {
    frame: Frame,
    /// The channel that cannot be made.
    pub channel: String,
    wanted: String,
}

/// A name as the field writes it: small letters, without what says that it was measured or in which unit.
pub fn plain(name: &str) -> String {
    let mut name = name.to_ascii_lowercase();
    const ENDINGS: [&str; 10] = ["_measured", "_meas", "_m", "_deg", "_rad", "_degs", "_rads", "_dps", "_mps", "_ft"];
    while let Some(short) = ENDINGS.iter().find_map(|e| name.strip_suffix(e)).filter(|s| !s.is_empty()) {
        name = short.to_string();
    }
    name
}

/// A whole turn in the unit of an angle. Numbers without a unit are degrees where they do not fit into a turn of radians.
pub fn whole_turn(unit: Option<&str>, values: &[f64]) -> f64 {
    let large = || values.iter().any(|v| v.abs() > std::f64::consts::TAU);
    match unit {
        Some("deg" | "°" | "degrees") => 360.0,
        None if large() => 360.0,
        _ => std::f64::consts::TAU,
    }
}

impl Frame {
    /// All pairs but that which is meant, the usual one first.
    pub const TURNED: [Self; 5] = [
        Self { world: World::Enu, body: Body::Flu },
        Self { world: World::Nwu, body: Body::Flu },
        Self { world: World::Ned, body: Body::Flu },
        Self { world: World::Enu, body: Body::Frd },
        Self { world: World::Nwu, body: Body::Frd },
    ];

    /// What the axes are, in words.
    pub fn words(self) -> String {
        let world = match self.world {
            World::Ned => "north-east-down",
            World::Enu => "east-north-up",
            World::Nwu => "north-west-up",
        };
        let body = match self.body {
            Body::Frd => "forward-right-down",
            Body::Flu => "forward-left-up",
        };
        format!("{world} and {body}")
    }

    /// Whether all components of a vector are among channels with these names.
    pub fn has_vector(names: &[&str]) -> bool {
        let short: Vec<String> = names.iter().map(|n| plain(n)).collect();
        let there = |list: &&[&str]| short.iter().any(|n| list.contains(&n.as_str()));
        VECTORS.iter().any(|(_, vector)| vector.iter().all(&there))
    }

    /// How channels are made of channels with these names, where they change; and what lacks a component.
    pub fn turned(self, names: &[&str]) -> (Vec<Turned>, Vec<NoComponent>) {
        let (mut all, mut lacking) = (Vec::new(), Vec::new());
        let short: Vec<String> = names.iter().map(|n| plain(n)).collect();
        for (kind, vector) in VECTORS {
            let rows = self.rows(kind);
            for (k, name) in names.iter().enumerate() {
                // `v` alone is a speed
                let speed = short[k] == "v" && !short.iter().any(|n| n == "u");
                let own = (0..vector.len()).find_map(|c| Some((c, vector[c].iter().position(|n| *n == short[k])?)));
                let Some((component, spelling)) = own.filter(|_| !speed) else { continue };
                let ending = &name[short[k].len()..];
                let row = &rows[component];
                let mut turned = Turned { channel: k, of: Vec::new(), turns: row.1 };
                for (c, factor) in row.0.iter().enumerate().filter(|(_, f)| **f != 0.0) {
                    let wanted = vector[c].get(spelling).copied().unwrap_or_default();
                    let is = |j: &usize| short[*j] == wanted && &names[*j][short[*j].len()..] == ending;
                    match (0..names.len()).find(is) {
                        Some(j) => turned.of.push((j, *factor)),
                        None => lacking.push(NoComponent {
                            frame: self,
                            channel: (*name).into(),
                            wanted: format!("{wanted}{ending}"),
                        }),
                    }
                }
                if turned.of != [(k, 1.0)] {
                    all.push(turned);
                }
            }
        }
        (all, lacking)
    }

    /// Of each component, the factors of all, and a part of a whole turn.
    fn rows(self, kind: Kind) -> Vec<(Vec<f64>, f64)> {
        let (n, o) = (-1.0, 0.0);
        let plain = |rows: [[f64; 3]; 3]| rows.into_iter().map(|r| (r.to_vec(), 0.0)).collect();
        let unchanged = [[1.0, o, o], [o, 1.0, o], [o, o, 1.0]];
        // half a turn about the first axis
        let over = [[1.0, o, o], [o, n, o], [o, o, n]];
        let both = self.body == Body::Flu && self.world != World::Ned;
        let east = self.world == World::Enu;
        match kind {
            Kind::OverEarth => plain(match self.world {
                World::Ned => unchanged,
                World::Enu => [[o, 1.0, o], [1.0, o, o], [o, o, n]],
                World::Nwu => over,
            }),
            Kind::AlongBody => plain(if self.body == Body::Flu { over } else { unchanged }),
            Kind::Angles if both => {
                let mut rows: Vec<(Vec<f64>, f64)> = plain(over);
                rows[2].1 = if east { 0.25 } else { 0.0 };
                rows
            }
            Kind::Angles => plain(unchanged),
            Kind::Quaternion => {
                // the product of half turns about the diagonal north-east, of the attitude, and about forward; or of two about x
                let h = std::f64::consts::FRAC_1_SQRT_2;
                let rows = match (both, east) {
                    (false, _) => [[1.0, o, o, o], [o, 1.0, o, o], [o, o, 1.0, o], [o, o, o, 1.0]],
                    (true, false) => [[1.0, o, o, o], [o, 1.0, o, o], [o, o, n, o], [o, o, o, n]],
                    (true, true) => [[h, o, o, h], [o, h, h, o], [o, h, -h, o], [h, o, o, -h]],
                };
                rows.into_iter().map(|r| (r.to_vec(), 0.0)).collect()
            }
        }
    }
}

impl fmt::Display for Frame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let world = match self.world {
            World::Ned => "ned",
            World::Enu => "enu",
            World::Nwu => "nwu",
        };
        let body = if self.body == Body::Frd { "frd" } else { "flu" };
        write!(f, "{world}-{body}")
    }
}

impl TryFrom<String> for Frame {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        let all = || Self::TURNED.into_iter().chain([Self { world: World::Ned, body: Body::Frd }]);
        let names: Vec<String> = all().map(|f| f.to_string()).collect();
        all().find(|f| f.to_string() == text).ok_or_else(|| format!("frame = {text:?}: expected {}", names.join(", ")))
    }
}

impl From<Frame> for String {
    fn from(frame: Frame) -> Self {
        frame.to_string()
    }
}
