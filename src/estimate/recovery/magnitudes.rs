//! What is compared while starts are looked for that lie decades apart: magnitudes, `asinh(y / 2 s)` with a level s for each output, which are linear up to the
//! level and logarithms beyond it (Johnson 1949).
//!
//! Plain residuals see a response that has died away as one that is nearly right, and one that runs away as infinitely wrong: between the two there is no slope
//! to follow. Magnitudes are as far from what was measured on both sides, and grow by one for every factor of e.

use crate::problem::response::{Response, TimeResponse};
use fdm_system::record::Run;
use fdm_system::simulate::{Block, Divergence, Simulator, Sink};

/// The level of an output, as a part of the median of what was measured.
const LEVEL: f64 = 0.1;

/// The response of a model by its magnitudes.
pub(crate) struct Magnitudes<'a> {
    simulator: Simulator<'a>,
    levels: &'a [f64],
}

impl<'a> Magnitudes<'a> {
    /// Magnitudes over these levels (q).
    pub(crate) fn new(simulator: Simulator<'a>, levels: &'a [f64]) -> Self {
        Self { simulator, levels }
    }
}

/// The levels of all outputs (q) that suit what was measured in all runs.
pub(crate) fn levels(runs: &[Run], q: usize) -> Vec<f64> {
    let of = |o: usize| {
        let measured = runs.iter().flat_map(|run| run.measured.iter().skip(o).step_by(q));
        let mut sizes: Vec<f64> = measured.map(|z| z.abs()).filter(|z| *z > 0.0 && z.is_finite()).collect();
        let middle = sizes.len() / 2;
        if sizes.is_empty() { 1.0 } else { LEVEL * *sizes.select_nth_unstable_by(middle, f64::total_cmp).1 }
    };
    (0..q).map(of).collect()
}

/// The magnitudes of values, N by q.
pub(crate) fn of(values: &[f64], levels: &[f64]) -> Vec<f64> {
    values.iter().enumerate().map(|(k, y)| magnitude(*y, levels[k % levels.len()])).collect()
}

fn magnitude(y: f64, level: f64) -> f64 {
    (y / (2.0 * level)).asinh()
}

/// Its derivative by y.
fn slope(y: f64, level: f64) -> f64 {
    1.0 / y.hypot(2.0 * level)
}

impl Response for Magnitudes<'_> {
    fn samples(&self) -> usize {
        self.simulator.samples()
    }

    fn outputs(&self) -> usize {
        self.levels.len()
    }

    fn simulate(&mut self, theta: &[f64], y: &mut [f64]) -> Result<(), Divergence> {
        self.simulator.simulate(theta, y)?;
        y.iter_mut().enumerate().for_each(|(k, y)| *y = magnitude(*y, self.levels[k % self.levels.len()]));
        Ok(())
    }

    fn sensitivities(&mut self, theta: &[f64], columns: &[usize], sink: &mut Sink<'_>) -> Result<(), Divergence> {
        let levels = self.levels;
        self.simulator.stream(theta, columns, &mut |block| {
            for (row, y) in block.rows.chunks_exact_mut(block.layout.length).zip(block.y.chunks_exact(levels.len())) {
                for (place, (y, level)) in block.layout.outputs.iter().zip(y.iter().zip(levels)) {
                    let slope = slope(*y, *level);
                    row[place.start..][..place.columns.len()].iter_mut().for_each(|r| *r *= slope);
                }
            }
            let y = of(block.y, levels);
            sink(Block { y: &y, ..block });
        })
    }
}

impl TimeResponse for Magnitudes<'_> {
    fn time(&self) -> Option<&[f64]> {
        Some(&self.simulator.run().time)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fdm_system::model::Model;

    const DECAY: &str = "model decay {
        input u;
        state x = free, v = 0;
        param k = 0.7, g = 40, o = -3;
        der(x) = -k*x + u;
        der(v) = x - v^3;
        output y = g*x, z = v + o;
    }";

    #[test]
    fn slopes_of_magnitudes_are_their_central_differences() {
        let model = Model::from_text("decay.fdm", DECAY).unwrap();
        let time: Vec<f64> = (0..9).map(|k| 0.4 * f64::from(k)).collect();
        let inputs = time.iter().map(|t| (2.0 * t).sin()).collect();
        let (q, n) = (2, time.len());
        let run = Run {
            name: "r".into(),
            time,
            inputs,
            held: vec![false],
            measured: (0..q * n).map(|k| if k == 3 { f64::NAN } else { k as f64 - 4.0 }).collect(),
            input_gaps: vec![0],
            stated: Vec::new(),
            output_gaps: vec![0; q],
        };
        let levels = levels(std::slice::from_ref(&run), q);
        assert!(
            (levels[0] - 0.6).abs() < 1e-12 && (levels[1] - 0.7).abs() < 1e-12,
            "{levels:?}: of 2, 2, 4, 4, 6, .. and 1, 3, 3, 5, 7, .."
        );
        let mut response = Magnitudes::new(Simulator::new(model.dynamics(), &run, 3).unwrap(), &levels);
        let theta: Vec<f64> = model.definition().start().iter().map(|p| p + 0.3).collect();
        let columns: Vec<usize> = (0..theta.len()).collect();
        let mut exact = vec![0.0; n * q * theta.len()];
        let mut seen = vec![0.0; n * q];
        response
            .sensitivities(&theta, &columns, &mut |block| {
                for sample in 0..block.samples() {
                    for o in 0..q {
                        let at = (block.first + sample) * q + o;
                        seen[at] = block.y[sample * q + o];
                        let places = &block.layout.outputs[o].columns;
                        for (column, value) in places.iter().zip(block.row(sample, o)) {
                            exact[at * theta.len() + *column as usize] = *value;
                        }
                    }
                }
            })
            .unwrap();
        let mut plain = vec![0.0; n * q];
        response.simulate(&theta, &mut plain).unwrap();
        assert_eq!(plain, seen);
        for p in columns {
            let mut at = |change: f64| {
                let (mut moved, mut y) = (theta.clone(), vec![0.0; n * q]);
                moved[p] += change;
                response.simulate(&moved, &mut y).unwrap();
                y
            };
            let (up, down) = (at(1e-5), at(-1e-5));
            for k in 0..n * q {
                let difference = (up[k] - down[k]) / 2e-5;
                let slope = exact[k * theta.len() + p];
                assert!((difference - slope).abs() < 1e-7 * (1.0 + slope.abs()), "{p} {k}: {difference} {slope}");
            }
        }
    }
}
