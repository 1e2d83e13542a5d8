//! What a truth needs to know of the responses: sizes of inputs, states and outputs of the base model at the true numbers.

use crate::experiment;
use crate::families::Family;
use crate::oracle::response;
use fdm::Model;
use fdm::effect::{Beginning, Scales};
use fdm::record::Run;
use std::collections::BTreeMap;

/// Signals by name, over all runs.
pub(crate) struct Known {
    step: f64,
    duration: f64,
    signals: BTreeMap<String, Signal>,
}

struct Signal {
    first: f64,
    /// Magnitudes about the middle, and of the rates, both rising.
    sizes: Vec<f64>,
    levels: Vec<f64>,
    speeds: Vec<f64>,
}

impl Known {
    /// From the runs' inputs and the model's response to them; states are seen through outputs that are added.
    pub(crate) fn new(family: &Family, base: &Model, theta: &[f64], runs: &[Run]) -> Self {
        let definition = base.definition();
        let states: Vec<&str> = definition.states.iter().map(|s| s.quantity.name.as_str()).collect();
        let end = base.source().text().rfind('}').expect("a model");
        let shown: String = states.iter().map(|s| format!("  output shown_{s} = {s};\n")).collect();
        let text = format!("{}{shown}}}\n", &base.source().text()[..end]);
        let all = Model::from_text("shown", text).expect("outputs that can be added");
        let (m, q) = (all.layout().inputs, all.layout().outputs);
        let mut names: Vec<String> = definition.inputs.iter().map(|i| i.quantity.name.clone()).collect();
        names.extend(definition.outputs.iter().map(|o| o.quantity.name.clone()));
        names.extend(states.iter().map(|s| String::from(*s)));
        let mut values: Vec<Vec<Vec<f64>>> = vec![Vec::new(); names.len()];
        for run in runs {
            let bare = experiment::run(&all, &run.name, family.step, run.inputs.clone());
            let y = response(&all, &bare, theta).expect("the base model responds");
            (0..m).for_each(|k| values[k].push(run.inputs.iter().skip(k).step_by(m).copied().collect()));
            (0..q).for_each(|k| values[m + k].push(y.iter().skip(k).step_by(q).copied().collect()));
        }
        let signals =
            names.into_iter().zip(&values).map(|(name, runs)| (name, Signal::new(runs, family.step))).collect();
        Self { step: family.step, duration: family.duration(), signals }
    }

    fn signal(&self, name: &str) -> &Signal {
        self.signals.get(name).unwrap_or_else(|| panic!("no signal is called {name}"))
    }
}

impl Signal {
    fn new(runs: &[Vec<f64>], step: f64) -> Self {
        let middle = {
            let mut all: Vec<f64> = runs.concat();
            all.sort_by(f64::total_cmp);
            all[all.len() / 2]
        };
        let mut sizes: Vec<f64> = runs.concat().iter().map(|v| (v - middle).abs()).collect();
        let mut speeds: Vec<f64> =
            runs.iter().flat_map(|r| r.windows(2).map(|w| (w[1] - w[0]).abs() / step).collect::<Vec<_>>()).collect();
        let mut levels: Vec<f64> = runs.concat();
        levels.sort_by(f64::total_cmp);
        sizes.sort_by(f64::total_cmp);
        speeds.sort_by(f64::total_cmp);
        Self { first: runs[0][0], sizes, levels, speeds }
    }
}

fn quantile(sorted: &[f64], q: f64) -> f64 {
    sorted[((sorted.len() - 1) as f64 * q).round() as usize]
}

impl Scales for Known {
    fn size(&self, signal: &str, q: f64) -> f64 {
        quantile(&self.signal(signal).sizes, q)
    }
    fn speed(&self, signal: &str, q: f64) -> f64 {
        quantile(&self.signal(signal).speeds, q)
    }
    fn level(&self, signal: &str, q: f64) -> f64 {
        quantile(&self.signal(signal).levels, q)
    }
    fn beginning(&self, signal: &str) -> Beginning {
        // every run begins at the same trim
        Beginning::Same(self.signal(signal).first)
    }
    fn step(&self) -> f64 {
        self.step
    }
    fn duration(&self) -> f64 {
        self.duration
    }
}
