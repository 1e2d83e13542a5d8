//! Records of the experiments: one file for each experiment and repetition, the table of runs, the project file.

use crate::experiments::Channel;
use crate::experiments::{Experiment, Measured, Measurement};
use crate::expression::Names;
use crate::expression::number;
use std::collections::BTreeMap;
use std::fmt::Write;

/// A file below the folder of the import.
#[derive(Debug, Clone)]
pub struct File {
    /// Path, relative to that folder.
    pub path: String,
    /// Text.
    pub text: String,
}

/// An input that is 0 until a time that each experiment has, and 1 from then on.
#[derive(Debug)]
pub(crate) struct Switch {
    pub(crate) name: String,
    pub(crate) about: String,
    /// For each experiment.
    pub(crate) times: Vec<f64>,
}

/// How long a steady state is waited for, in lengths of the longest experiment.
const PATIENCE: f64 = 1e5;
/// The first sample of that wait, in the same lengths; each further interval is twice as long.
const FIRST: f64 = 1e-6;

/// What the records are made of.
pub(crate) struct Records<'a> {
    pub(crate) names: &'a Names,
    pub(crate) measured: &'a Measured,
    pub(crate) channels: &'a [Channel],
    pub(crate) switches: &'a [Switch],
    /// How long the run before an experiment is.
    pub(crate) lead: Option<f64>,
}

/// Latest measured time.
fn length(measured: &Measured) -> f64 {
    let last = measured.measurements.iter().map(|m| m.time).filter(|t| t.is_finite()).fold(0.0, f64::max);
    if last > 0.0 { last } else { 1.0 }
}

/// How long the run before an experiment is.
pub(crate) fn lead(measured: &Measured) -> f64 {
    PATIENCE * length(measured)
}

/// Ever longer intervals, whose steps are then as long as they may be: from 0 to `end`.
fn doubling(end: f64, first: f64) -> impl Iterator<Item = f64> {
    std::iter::successors(Some(first), |t| Some(2.0 * t))
        .take_while(move |t| *t < 0.9 * end)
        .chain(std::iter::once(end))
}

/// A column that drives the model.
enum Column<'a> {
    Channel(&'a Channel),
    Switch(&'a Switch),
    /// What measurements of an output bring: output, place.
    Brought(&'a str, usize, usize),
}

impl Column<'_> {
    fn name(&self) -> &str {
        match self {
            Self::Channel(c) => &c.name,
            Self::Switch(s) => &s.name,
            Self::Brought(name, ..) => name,
        }
    }
}

impl Records<'_> {
    fn columns(&self, used: &dyn Fn(&str) -> bool) -> Vec<Column<'_>> {
        let channels = self.channels.iter().filter(|c| c.is_input()).map(Column::Channel);
        let switches = self.switches.iter().map(Column::Switch);
        let outputs = self.measured.outputs.iter().enumerate();
        let brought = outputs
            .flat_map(|(o, out)| out.columns.iter().enumerate().map(move |(k, name)| Column::Brought(name, o, k)));
        channels.chain(switches).chain(brought).filter(|c| used(c.name())).collect()
    }

    /// All records.
    pub(crate) fn files(&self, used: &dyn Fn(&str) -> bool) -> Vec<(usize, File)> {
        let columns = self.columns(used);
        let mut files = Vec::new();
        let mut taken: Vec<String> = Vec::new();
        for (e, experiment) in self.measured.experiments.iter().enumerate() {
            for (repetition, rows) in self.repetitions(e).into_iter().enumerate() {
                let plain: String = experiment
                    .name
                    .chars()
                    .map(|c| if c.is_alphanumeric() || "_-.".contains(c) { c } else { '_' })
                    .collect();
                let mut stem = if repetition == 0 { plain.clone() } else { format!("{plain}_{}", repetition + 1) };
                while taken.contains(&stem) {
                    stem.push('_');
                }
                taken.push(stem.clone());
                let text = self.record((e, experiment), &rows, &columns);
                files.push((e, File { path: format!("runs/{stem}.csv"), text }));
            }
        }
        files
    }

    /// Measurements of an experiment by repetition and time: each number of an output at a time that is there already belongs to the next one.
    fn repetitions(&self, experiment: usize) -> Vec<BTreeMap<u64, Vec<&Measurement>>> {
        let mut all: Vec<BTreeMap<u64, Vec<&Measurement>>> = Vec::new();
        let mut seen: BTreeMap<(usize, u64), usize> = BTreeMap::new();
        for m in self.measured.measurements.iter().filter(|m| m.experiment == experiment) {
            // times are not negative: their bits have their order; -0 is 0
            let time = (m.time + 0.0).to_bits();
            let repetition = seen.entry((m.output, time)).or_default();
            if all.len() == *repetition {
                all.push(BTreeMap::new());
            }
            all[*repetition].entry(time).or_default().push(m);
            *repetition += 1;
        }
        all
    }

    fn record(
        &self,
        (e, experiment): (usize, &Experiment),
        rows: &BTreeMap<u64, Vec<&Measurement>>,
        columns: &[Column<'_>],
    ) -> String {
        let length = length(self.measured);
        let finite = |bits: &u64| Some(f64::from_bits(*bits)).filter(|t| t.is_finite());
        let last = rows.keys().filter_map(finite).fold(0.0, f64::max);
        let settles = rows.keys().any(|bits| finite(bits).is_none());
        let mut times: Vec<f64> = rows.keys().filter_map(finite).chain([0.0]).collect();
        if let (Some(lead), true) = (self.lead, experiment.before.is_some()) {
            times.extend(std::iter::once(-lead).chain(doubling(lead, FIRST * length).map(|t| t - lead)));
        }
        let end = last + PATIENCE * length;
        if settles {
            times.extend(doubling(PATIENCE * length, FIRST * length).map(|t| t + last));
        }
        if times.iter().all(|t| *t == 0.0) {
            // a record of one time alone has no interval
            times.push(length);
        }
        let until = times.iter().copied().fold(0.0, f64::max);
        let switched = columns.iter().filter_map(|c| match c {
            Column::Switch(s) => s.times.get(e).copied(),
            _ => None,
        });
        times.extend(switched.filter(|t| *t > 0.0 && *t < until));
        times.sort_by(f64::total_cmp);
        times.dedup();
        let measured: Vec<usize> =
            (0..self.measured.outputs.len()).filter(|o| rows.values().flatten().any(|m| m.output == *o)).collect();
        let mut text = String::from("time");
        columns.iter().for_each(|c| {
            let _ = write!(text, ",{}", self.names.called(c.name()));
        });
        measured.iter().for_each(|o| {
            let _ = write!(text, ",{}", self.measured.outputs[*o].name);
        });
        text.push('\n');
        for time in times {
            let here: Vec<&&Measurement> = match settles && time == end {
                true => rows.get(&f64::INFINITY.to_bits()).into_iter().flatten().collect(),
                false => rows.get(&(time + 0.0).to_bits()).into_iter().flatten().filter(|_| time >= 0.0).collect(),
            };
            text.push_str(&number(time));
            for column in columns {
                let value = match column {
                    Column::Channel(c) => c.values[e][usize::from(time >= 0.0)],
                    Column::Switch(s) => f64::from(u8::from(time >= s.times[e])),
                    Column::Brought(_, output, k) => {
                        here.iter().find(|m| m.output == *output).map_or(1.0, |m| m.brings[*k])
                    }
                };
                let _ = write!(text, ",{}", number(value));
            }
            for output in &measured {
                text.push(',');
                if let Some(m) = here.iter().find(|m| m.output == *output) {
                    text.push_str(&number(m.value));
                }
            }
            text.push('\n');
        }
        text
    }

    /// The table of runs.
    pub(crate) fn table(
        &self,
        files: &[(usize, File)],
        used: &dyn Fn(&str) -> bool,
        lead: Option<(&str, f64)>,
    ) -> String {
        let known: Vec<&Channel> = self.channels.iter().filter(|c| !c.is_input() && used(&c.name)).collect();
        let mut text = String::from("file,run");
        known.iter().map(|c| self.names.called(&c.name)).chain(lead.map(|(name, _)| name)).for_each(|name| {
            let _ = write!(text, ",{name}");
        });
        text.push('\n');
        for (e, file) in files {
            let run = file.path.trim_start_matches("runs/").trim_end_matches(".csv");
            let _ = write!(text, "{},{run}", file.path);
            known.iter().for_each(|c| {
                let _ = write!(text, ",{}", number(c.values[*e][1]));
            });
            if let Some((_, lead)) = lead {
                let own = self.measured.experiments[*e].before.map_or(0.0, |_| lead);
                let _ = write!(text, ",{}", number(own));
            }
            text.push('\n');
        }
        text
    }

    /// The project file: model, runs, and which inputs keep their values until the next sample.
    pub(crate) fn project(&self, used: &dyn Fn(&str) -> bool) -> String {
        let held: Vec<String> =
            self.columns(used).iter().map(|c| format!("\"{}\"", self.names.called(c.name()))).collect();
        let mut text = String::from("model = \"model.fdm\"\nruns = \"runs.csv\"\n");
        if !held.is_empty() {
            let _ = write!(text, "\n[options]\nzoh = [{}]\n", held.join(", "));
        }
        text
    }
}
