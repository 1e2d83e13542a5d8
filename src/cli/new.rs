//! `fdm new`: a first model with comments, and a record made up from it to try things out.

use crate::deliver::{column, csv};
use crate::failure::{Ending, Failure, Unwritten, at, ended, print};
use clap::{Args, ValueEnum};
use fdm_grammar::format::format;
use fdm_numeric::random::SplitMix;
use fdm_results::store::{admits, write_new_file};
use fdm_system::Model;
use fdm_system::record::Run;
use fdm_system::simulate::{Simulator, choose_steps};
use std::path::{Path, PathBuf};

/// What `fdm new` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// File of the model, with the ending .fdm; a record with the ending .csv is written beside it
    #[arg(value_name = "NAME.fdm")]
    file: PathBuf,
    /// What kind of model
    #[arg(long, value_name = "KIND", default_value = "second-order")]
    kind: Kind,
}

/// The models that there are to begin with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Kind {
    /// A vehicle's response to its stick, with a delayed sensor
    SecondOrder,
    /// Two reactions, one after the other
    Kinetics,
    /// Short-period motion of an aircraft, with its derivatives
    Linear,
}

/// How a record is made up: what was true, how it was driven, how exact the gauges were.
struct Recipe {
    template: &'static str,
    truth: &'static [(&'static str, f64)],
    input: fn(f64) -> f64,
    samples: usize,
    interval: f64,
    noise: &'static [f64],
}

impl Kind {
    fn recipe(self) -> Recipe {
        match self {
            Self::SecondOrder => Recipe {
                template: include_str!("templates/second_order.fdm"),
                truth: &[
                    ("theta(0)", 0.4),
                    ("omega", 2.6),
                    ("zeta", 0.35),
                    ("gain", 1.3),
                    ("tau", 0.12),
                    ("bias", 0.3),
                ],
                input: |t| 5.0 * steps(t - 1.0),
                samples: 401,
                interval: 0.05,
                noise: &[0.05, 0.15],
            },
            Self::Kinetics => Recipe {
                template: include_str!("templates/kinetics.fdm"),
                truth: &[("A0", 1.24), ("k1", 0.31), ("k2", 0.074)],
                input: |_| 0.0,
                samples: 31,
                interval: 1.0,
                noise: &[0.01, 0.01],
            },
            Self::Linear => Recipe {
                template: include_str!("templates/linear.fdm"),
                truth: &[("Za", -1.32), ("Ze", -0.14), ("Ma", -6.1), ("Mq", -2.05), ("Me", -11.4)],
                input: |t| 0.05 * steps(2.0 * (t - 0.5)),
                samples: 401,
                interval: 0.025,
                noise: &[0.002, 0.01],
            },
        }
    }
}

/// The input that flight testers fly: up for three units of time, down for two, up and down for one each.
fn steps(t: f64) -> f64 {
    match t {
        t if (0.0..3.0).contains(&t) || (5.0..6.0).contains(&t) => 1.0,
        t if (3.0..5.0).contains(&t) || (6.0..7.0).contains(&t) => -1.0,
        _ => 0.0,
    }
}

pub(crate) fn run(arguments: &Arguments) -> Ending {
    let path = &arguments.file;
    if path.extension().is_none_or(|e| e != "fdm") {
        return Err(Failure::input([format!("{}: the name of a model ends with .fdm", path.display())]));
    }
    let record = path.with_extension("csv");
    let there: Vec<&Path> =
        [path.as_path(), record.as_path()].into_iter().filter(|p| p.symlink_metadata().is_ok()).collect();
    if !there.is_empty() {
        let said = there.iter().map(|p| format!("{}: exists already, and is not overwritten", p.display()));
        return Err(Failure::Input(said.collect()));
    }
    for place in [path, &record] {
        admits(place).map_err(|e| Failure::at(place, &e))?;
    }
    let recipe = arguments.kind.recipe();
    let quoted = |p: &Path| {
        let text = p.display().to_string();
        if text.contains(' ') { format!("\"{text}\"") } else { text }
    };
    let (model_path, record_path) = (quoted(path), quoted(&record));
    let text = recipe.template.replace("{{model}}", &model_path).replace("{{record}}", &record_path);
    let (text, model) = named(&text, path)?;
    let table = recipe.record(&model)?;
    written(path, text.as_bytes())?;
    written(&record, &table)?;
    let next = format!(
        "{model_path} and a made-up record, {record_path}\n\n  fdm check {model_path}\n  fdm simulate {model_path} --data {record_path}\n  fdm fit {model_path} --data {record_path}\n"
    );
    ended(print(&next))
}

/// The text with the model's own name: that of the file, when it can be one.
fn named(text: &str, path: &Path) -> Result<(String, Model), Failure> {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let name: String = stem.chars().map(|c| if c.is_alphanumeric() { c } else { '_' }).collect();
    let file = path.display().to_string();
    let attempts = [name.clone(), format!("model_{name}"), "first".into()].map(|n| text.replace("{{name}}", &n));
    let mut last = None;
    for text in attempts {
        match Model::from_text(file.clone(), text.clone()) {
            Ok(model) => return Ok((format(model.source()).unwrap_or(text), model)),
            Err(e) => last = Some(e),
        }
    }
    Err(last.map_or_else(|| Failure::input(["no model was written"]), Failure::from))
}

impl Recipe {
    /// The table of a made-up record.
    fn record(&self, model: &Model) -> Result<Vec<u8>, Failure> {
        let (layout, definition) = (model.layout(), model.definition());
        let mut theta = definition.start();
        for (name, value) in self.truth {
            definition.param(name).into_iter().for_each(|k| theta[k] = *value);
        }
        let time: Vec<f64> = (0..self.samples).map(|k| k as f64 * self.interval).collect();
        let driven: Vec<f64> = time.iter().map(|t| (self.input)(*t)).collect();
        let (m, q) = (layout.inputs, layout.outputs);
        let run = Run {
            name: "made up".into(),
            inputs: driven.iter().flat_map(|u| std::iter::repeat_n(*u, m)).collect(),
            held: vec![false; m],
            measured: vec![f64::NAN; self.samples * q],
            input_gaps: vec![0; m],
            output_gaps: vec![0; q],
            time,
        };
        let unsuited = |e| Failure::input([format!("the made-up record: {e}")]);
        let steps = choose_steps(model.dynamics(), &run, &theta).map_err(unsuited)?.steps;
        let mut y = vec![f64::NAN; self.samples * q];
        let simulated = Simulator::new(model.dynamics(), &run, steps).map_err(unsuited)?.simulate(&theta, &mut y);
        simulated.map_err(|d| Failure::input([format!("the made-up record diverges at {}", d.time)]))?;
        let mut random = SplitMix(1);
        y.iter_mut().enumerate().for_each(|(k, y)| *y = rounded(*y + self.noise[k % q] * random.sum_of_twelve()));
        let mut columns =
            vec![("t".to_string(), Some(definition.time.to_string()), run.time.iter().map(|t| rounded(*t)).collect())];
        let unit = |q: &fdm_grammar::model::Quantity| q.unit.as_ref().map(ToString::to_string);
        columns.extend(definition.inputs.iter().map(|i| (i.quantity.name.clone(), unit(&i.quantity), driven.clone())));
        let channel = |(o, out): (usize, &fdm_grammar::model::Output)| {
            (out.quantity.name.clone(), unit(&out.quantity), column(&y, o, q))
        };
        columns.extend(definition.outputs.iter().enumerate().map(channel));
        Ok(csv(&columns))
    }
}

/// What a gauge writes: five decimals.
fn rounded(value: f64) -> f64 {
    (value * 1e5).round() / 1e5
}

/// Writes a file that is not there.
fn written(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    write_new_file(path, bytes).map_err(|e| Unwritten(at(path, &e)).into())
}
