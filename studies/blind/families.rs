//! Families of systems: the model that a user would bring, the numbers of the truth, and how it is excited.

/// How an input is moved.
#[derive(Clone, Copy)]
pub(crate) struct Drive {
    pub(crate) name: &'static str,
    /// Value at the beginning of every run.
    pub(crate) trim: f64,
    /// Largest deviation from it.
    pub(crate) amplitude: f64,
    /// Lowest and highest frequency, in cycles per unit of time.
    pub(crate) band: (f64, f64),
}

/// A controller around the plant: these lines take the place of the declaration of `input`.
#[derive(Clone, Copy)]
pub(crate) struct Loop {
    pub(crate) input: &'static str,
    /// They read `reference`, outputs, and `noise_NAME` of the outputs they name in `felt`; they define `let INPUT`.
    pub(crate) lines: &'static str,
    pub(crate) felt: &'static [&'static str],
    /// The reference is one of the input, beside what the controller does; otherwise of the first output that is felt.
    pub(crate) of_input: bool,
    /// Largest deviation of the reference.
    pub(crate) amplitude: f64,
}

/// A system with its experiment.
#[derive(Clone, Copy)]
pub(crate) struct Family {
    pub(crate) name: &'static str,
    /// The model as it is given to the tool; its start values are not the truth's.
    pub(crate) text: &'static str,
    /// Sampling interval and samples of a run, in the model's unit of time.
    pub(crate) step: f64,
    pub(crate) samples: usize,
    pub(crate) drives: &'static [Drive],
    /// Every run is a multisine; otherwise the first is a row of steps (3-2-1-1).
    pub(crate) multisines: bool,
    pub(crate) control: Option<Loop>,
    /// Effects of the catalogue that make no sense here, and are never the truth.
    pub(crate) senseless: &'static [&'static str],
    /// States where friction and hysteresis can act.
    pub(crate) rates: &'static [&'static str],
    /// Never run while anything is tuned; only when asked for by FDM_BLIND_APART.
    pub(crate) apart: bool,
}

impl Family {
    pub(crate) fn named(name: &str) -> &'static Self {
        FAMILIES.iter().find(|f| f.name == name).unwrap_or_else(|| panic!("no family is called {name}"))
    }

    pub(crate) fn outputs(&self) -> usize {
        self.text.lines().filter(|l| l.trim_start().starts_with("output ")).count()
    }

    pub(crate) fn duration(&self) -> f64 {
        self.step * (self.samples - 1) as f64
    }
}

const fn drive(name: &'static str, trim: f64, amplitude: f64, band: (f64, f64)) -> Drive {
    Drive { name, trim, amplitude, band }
}

/// Friction makes no sense for a level, a temperature or a concentration.
const NO_FRICTION: &[&str] = &["coulomb_friction", "quadratic_damping"];

/// For the time that a diagnosis takes: three runs of 2,000 samples, eight states, about a hundred candidates.
pub(crate) const CHAIN: Family = Family {
    name: "chain",
    text: include_str!("families/chain.fdm"),
    step: 0.02,
    samples: 2000,
    drives: &[drive("u", 0.0, 2.0, (0.05, 2.0))],
    multisines: false,
    control: None,
    senseless: &[],
    rates: &["v"],
    apart: false,
};

pub(crate) const FAMILIES: &[Family] = &[
    Family {
        name: "aeroplane",
        text: include_str!("families/aeroplane.fdm"),
        step: 0.04,
        samples: 500,
        drives: &[drive("de", 0.0, 0.05, (0.08, 2.0))],
        multisines: false,
        control: Some(Loop {
            input: "de",
            lines: "const P = 0.25 [s], I = 0.3 [1], fade = 0.2 [1/s];\n  let rate = q_m + noise_q_m;\n  state held [rad];\n  \
                    der(held) = I*rate - fade*held;\n  let de = reference + P*rate + held;",
            felt: &["q_m"],
            of_input: true,
            amplitude: 0.05,
        }),
        senseless: &[],
        rates: &["q"],
        apart: false,
    },
    Family {
        name: "ship",
        text: include_str!("families/ship.fdm"),
        step: 1.0,
        samples: 400,
        drives: &[drive("rudder", 0.0, 0.35, (0.006, 0.08)), drive("n", 2.0, 0.6, (0.004, 0.03))],
        multisines: false,
        control: None,
        senseless: &[],
        rates: &["v", "r"],
        apart: false,
    },
    Family {
        name: "helicopter",
        text: include_str!("families/helicopter.fdm"),
        step: 0.08,
        samples: 600,
        drives: &[
            drive("col", 0.0, 1.0, (0.05, 1.0)),
            drive("lat", 0.0, 1.0, (0.06, 1.5)),
            drive("lon", 0.0, 1.0, (0.06, 1.2)),
            drive("ped", 0.0, 1.0, (0.05, 1.2)),
        ],
        multisines: true,
        control: None,
        senseless: &[],
        rates: &["p", "q", "r", "w"],
        apart: false,
    },
    Family {
        name: "motor",
        text: include_str!("families/motor.fdm"),
        step: 0.005,
        samples: 600,
        drives: &[drive("volts", 0.0, 12.0, (0.5, 30.0))],
        multisines: false,
        control: Some(Loop {
            input: "volts",
            lines: "state pushed [rad];\n  let missing = reference - speed - noise_speed;\n  der(pushed) = missing;\n  \
                    const P = 0.1 [V*s/rad], I = 0.5 [V/rad];\n  let volts = P*missing + I*pushed;",
            felt: &["speed"],
            of_input: false,
            amplitude: 60.0,
        }),
        senseless: &[],
        rates: &["omega"],
        apart: false,
    },
    Family {
        name: "tanks",
        text: include_str!("families/tanks.fdm"),
        step: 10.0,
        samples: 400,
        drives: &[drive("pump", 1.0, 0.35, (0.0006, 0.01)), drive("valve", 1.0, 0.25, (0.0006, 0.008))],
        multisines: false,
        control: None,
        senseless: NO_FRICTION,
        rates: &[],
        apart: false,
    },
    Family {
        name: "kinetics",
        text: include_str!("families/kinetics.fdm"),
        step: 1.0,
        samples: 400,
        drives: &[drive("flow", 0.1, 0.05, (0.005, 0.06)), drive("temp", 350.0, 12.0, (0.004, 0.05))],
        multisines: false,
        control: None,
        senseless: NO_FRICTION,
        rates: &[],
        apart: false,
    },
    Family {
        name: "thermal",
        text: include_str!("families/thermal.fdm"),
        step: 5.0,
        samples: 500,
        drives: &[drive("heater", 0.0, 40.0, (0.0005, 0.01))],
        multisines: false,
        control: Some(Loop {
            input: "heater",
            lines: "state pushed [K*s];\n  let missing = reference - sensor - noise_sensor;\n  der(pushed) = missing;\n  \
                    const P = 0.8 [1/K], I = 0.006 [1/(K*s)];\n  let heater = P*missing + I*pushed;",
            felt: &["sensor"],
            of_input: false,
            amplitude: 15.0,
        }),
        senseless: NO_FRICTION,
        rates: &[],
        apart: false,
    },
    Family {
        name: "pendulum",
        text: include_str!("families/pendulum.fdm"),
        step: 0.03,
        samples: 600,
        drives: &[drive("torque", 0.0, 15.0, (0.1, 3.0))],
        multisines: false,
        control: Some(Loop {
            input: "torque",
            lines: "const P = 6 [1/(s^2*rad)], D = 0.8 [1/(s*rad)];\n  \
                    let torque = reference - P*(angle + noise_angle) - D*(rate + noise_rate);",
            felt: &["angle", "rate"],
            of_input: true,
            amplitude: 15.0,
        }),
        senseless: &[],
        rates: &["omega"],
        apart: false,
    },
    Family {
        name: "hydrofoil",
        text: include_str!("families/hydrofoil.fdm"),
        step: 0.05,
        samples: 500,
        drives: &[drive("front", 0.0, 0.1, (0.1, 2.0)), drive("rear", 0.0, 0.08, (0.1, 2.0))],
        multisines: false,
        control: None,
        senseless: &[],
        rates: &["w", "q"],
        apart: true,
    },
    Family {
        name: "quadrotor",
        text: include_str!("families/quadrotor.fdm"),
        step: 0.02,
        samples: 600,
        drives: &[drive("command", 0.0, 0.2, (0.2, 5.0))],
        multisines: false,
        control: None,
        senseless: &[],
        rates: &["p"],
        apart: true,
    },
    Family {
        name: "two_masses",
        text: include_str!("families/two_masses.fdm"),
        step: 0.01,
        samples: 600,
        drives: &[drive("torque", 0.0, 2.0, (0.3, 12.0))],
        multisines: false,
        control: None,
        senseless: &[],
        rates: &["motor", "load"],
        apart: true,
    },
];
