//! The library: parts of vehicles and reactors that `use "std/NAME" as part(...)` takes from the program itself.

use crate::diagnostic::nearest;

/// What the path of a part of the library begins with.
const FOLDER: &str = "std/";

macro_rules! parts {
    ($($name:literal),* $(,)?) => {
        /// The parts, in the order of their names: name and text.
        const PARTS: &[(&str, &str)] = &[$(($name, include_str!(concat!("../../../models/std/", $name, ".fdm")))),*];
    };
}

parts![
    "actuator",
    "actuator_second_order",
    "aero_linear",
    "aero_stall",
    "air_data",
    "atmosphere_1976",
    "backlash",
    "batch_reactor",
    "cstr",
    "dryden",
    "engine",
    "helicopter_hover",
    "imu",
    "inertia",
    "inflow",
    "joint_friction",
    "propeller",
    "rigid_body_6dof",
    "rigid_body_earth",
    "rigid_body_euler",
    "roll_decay",
    "semibatch_reactor",
    "servo",
    "ship_abkowitz",
    "ship_mmg",
    "ship_nomoto",
    "thermal_lump",
];

/// Names and texts of all parts.
pub fn library() -> impl Iterator<Item = (&'static str, &'static str)> {
    PARTS.iter().copied()
}

/// Whether a path is that of a part of the library. A file in a folder `std` is named with its ending.
pub(super) fn is_named(path: &str) -> bool {
    path.strip_prefix(FOLDER).is_some_and(|name| !name.contains(['.', '/', '\\']))
}

/// What may be used instead of a part that is not there.
pub(super) fn hint() -> String {
    let names: Vec<&str> = PARTS.iter().map(|(name, _)| *name).collect();
    format!("the library holds {}", names.join(", "))
}

/// The text of a part, or why there is none; nothing for the names of files.
pub(super) fn of(path: &str) -> Option<Result<&'static str, String>> {
    if !is_named(path) {
        return None;
    }
    let name = &path[FOLDER.len()..];
    let part = PARTS.iter().find(|(n, _)| *n == name).map(|(_, text)| *text);
    Some(part.ok_or_else(|| {
        let near = nearest(name, PARTS.iter().map(|(n, _)| *n)).map(|n| format!("; `{FOLDER}{n}` is"));
        format!("it is no part of the library{}", near.unwrap_or_default())
    }))
}
