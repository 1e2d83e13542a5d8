//! The ship of W1: rudder, run, parameters, and the reference data when they are at hand.

use fdm::{Model, record::Run};
use std::path::PathBuf;

const STEP: f64 = 0.1;
const COEFFICIENTS: [f64; 11] =
    [-1.0e-2, -3.0, -1.5e-3, -1.0e-2, -0.35, 1.0e-3, -1.0e-2, -3.0e-4, -2.0e-2, -1.2e-4, -0.5];
const INITIAL: [f64; 3] = [7.7, 0.0, 0.0];

/// The same model through the other door.
pub(crate) fn ship_macro() -> Model {
    fdm::model! {
        model manoeuvring_ship "surge, sway and yaw of a ship under rudder" {
          input rudder                  [rad];
          state u "surge speed"         [m/s]   = free;
          state v "sway speed"          [m/s]   = free;
          state r "yaw rate"            [rad/s] = free;

          const k  = 5e-4               [1/m];
          const u0 = 7.7                [m/s];

          param C1  = -1.0e-2           [1/m], C2  = -3.0 [m], C3  = -1.5e-3 [1/m];
          param C4  = -1.0e-2           [1/m], C5 = -0.35 [1], C6 = 1.0e-3 [1/m], C7 = -1.0e-2 [1/m];
          param C8  = -3.0e-4           [1/m^2], C9 = -2.0e-2 [1/m], C10 = -1.2e-4 [1/m^2], C11 = -0.5 [1];

          der(u) = -k*(u^2 - u0^2) + C1*v^2 + C2*r^2 + C3*u^2*rudder^2;
          der(v) = C4*u*v + C5*u*r + C6*u^2*rudder + C7*v*abs(v);
          der(r) = C8*u*v + C9*u*r + C10*u^2*rudder + C11*r*abs(r);

          output u_m [m/s] = u;
          output v_m [m/s] = v;
          output r_m [rad/s] = r;
        }
    }
}

/// The run of W1, or a hundred of them in one record.
pub(crate) struct Ship {
    /// Time and rudder; nothing is measured.
    pub(crate) run: Run,
}

impl Ship {
    /// 600 steps, or 60 000.
    pub(crate) fn new(hundredfold: bool) -> Self {
        let steps = if hundredfold { 60_000 } else { 600 };
        let inputs: Vec<f64> = (0..=steps)
            .map(|k| match hundredfold {
                false => rudder(k as f64 * STEP),
                true if k == steps => 0.0,
                true => {
                    let (block, within) = (k / 600, (k % 600) as f64 * STEP);
                    let sign = if block % 2 == 0 { 1.0 } else { -1.0 };
                    sign * rudder(within) * ((60.0 - within) / 2.0).clamp(0.0, 1.0)
                }
            })
            .collect();
        let n = inputs.len();
        Self {
            run: Run {
                name: "w1".into(),
                // exactly equal steps, as the reference has them
                time: (0..n).map(|k| k as f64 * STEP).collect(),
                inputs,
                held: vec![false],
                measured: vec![f64::NAN; 3 * n],
                input_gaps: vec![0],
                stated: Vec::new(),
                output_gaps: vec![0; 3],
            },
        }
    }

    /// Parameters in the model's order: the coefficients scaled, the initial values true.
    pub(crate) fn theta(&self, model: &Model, scale: f64) -> Vec<f64> {
        let mut theta = vec![0.0; model.layout().params];
        for (column, value) in
            self.columns(model).into_iter().zip(COEFFICIENTS.map(|c| scale * c).into_iter().chain(INITIAL))
        {
            theta[column] = value;
        }
        theta
    }

    /// C1..C11, u(0), v(0), r(0), as W1 orders them.
    pub(crate) fn columns(&self, model: &Model) -> Vec<usize> {
        let coefficients = (1..=11).map(|k| format!("C{k}"));
        let initial = ["u(0)", "v(0)", "r(0)"].map(String::from);
        let find = |name: String| model.definition().param(&name).expect("the model declares it");
        coefficients.chain(initial).map(find).collect()
    }
}

/// Radians at a time in seconds: 0 to +35 to -20 to +10 degrees at 5 degrees per second.
fn rudder(t: f64) -> f64 {
    let ramps = [(1.0, 5.0), (8.0, -5.0), (20.0, -5.0), (31.0, 5.0), (42.0, 5.0), (48.0, -5.0)];
    std::f64::consts::PI / 180.0 * ramps.iter().map(|(from, rate)| rate * (t - from).max(0.0)).sum::<f64>()
}

/// States and sensitivities computed by the peers' NumPy reference.
pub(crate) struct Reference {
    states: Vec<f64>,
    sensitivities: Vec<f64>,
    measured: Option<Vec<f64>>,
    deviations: Option<Vec<f64>>,
}

impl Reference {
    /// The reference of a workload, when the peers have been set up.
    pub(crate) fn load(tag: &str) -> Option<Self> {
        Some(Self {
            states: data(&format!("{tag}_xs"))?,
            sensitivities: data(&format!("{tag}_S"))?,
            measured: data(&format!("{tag}_z")),
            deviations: data(&format!("{tag}_sd")),
        })
    }

    /// The run with its noisy measurement.
    pub(crate) fn measured(&self, run: &Run) -> Option<Run> {
        Some(Run { measured: self.measured.clone()?, ..run.clone() })
    }

    /// Standard deviations of the measurement noise.
    pub(crate) fn deviations(&self) -> Option<Vec<Option<f64>>> {
        Some(self.deviations.as_ref()?.iter().copied().map(Some).collect())
    }

    /// Mean square of the weighted residuals, as the workload states it.
    pub(crate) fn cost(&self, residuals: &[f64]) -> Option<f64> {
        let deviations = self.deviations.as_ref()?;
        let squares = residuals.iter().enumerate().map(|(k, v)| (v / deviations[k % 3]).powi(2));
        Some(squares.sum::<f64>() / residuals.len() as f64)
    }

    /// Largest over columns of max |ours - reference| / max |reference|.
    pub(crate) fn difference(&self, y: &[f64], jacobian: &[f64], stride: usize) -> f64 {
        let packed: Vec<f64> = jacobian.chunks_exact(stride).flat_map(|row| row[..14].iter().copied()).collect();
        columnwise(y, &self.states, 3).max(columnwise(&packed, &self.sensitivities, 14))
    }
}

/// Numbers that the peers' reference has written.
pub(crate) fn data(name: &str) -> Option<Vec<f64>> {
    let home = std::env::var("HOME").unwrap_or_default();
    let folder = PathBuf::from(std::env::var("PEERS_DATA").unwrap_or(format!("{home}/peers-data")));
    let bytes = std::fs::read(folder.join(format!("{name}.bin"))).ok()?;
    Some(bytes.chunks_exact(8).filter_map(|b| Some(f64::from_le_bytes(b.try_into().ok()?))).collect())
}

/// Largest over columns of max |ours - reference| / max |reference|.
pub(crate) fn columnwise(a: &[f64], b: &[f64], columns: usize) -> f64 {
    assert_eq!(a.len(), b.len(), "the reference belongs to another workload");
    let (mut difference, mut size) = (vec![0.0_f64; columns], vec![0.0_f64; columns]);
    for (k, (a, b)) in a.iter().zip(b).enumerate() {
        difference[k % columns] = difference[k % columns].max((a - b).abs());
        size[k % columns] = size[k % columns].max(b.abs());
    }
    difference.iter().zip(&size).map(|(d, s)| if *s > 0.0 { d / s } else { *d }).fold(0.0, f64::max)
}
