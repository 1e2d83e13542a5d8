//! `fdm new`: a first model with comments, and records made up from it to try things out.

use crate::failure::{Ending, Failure, Unwritten, aside, at, ended, print};
use crate::project;
use clap::{Args, ValueEnum};
use fdm_grammar::format::format;
use fdm_numeric::random::SplitMix;
use fdm_report::visible;
use fdm_results::store::{admits, make_folder, write_new_file};
use fdm_session::from_record::{Column as FromColumn, looked_at};
use fdm_session::tables::{column, csv};
use fdm_system::Model;
use fdm_system::record::Run;
use fdm_system::simulate::{Simulator, StepOptions, choose_steps};
use std::path::{Path, PathBuf};

/// What `fdm new` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// A folder for a model, two records, a map of their channels, a project file; or NAME.fdm for a model and a record beside it
    #[arg(value_name = "NAME|NAME.fdm")]
    target: PathBuf,
    /// What kind of model
    #[arg(long, value_name = "KIND", default_value = "second-order")]
    kind: Kind,
    /// A record that the model is made for: its columns become inputs and outputs
    #[arg(long, value_name = "RUN", conflicts_with = "kind")]
    from: Option<PathBuf>,
}

/// The models that there are to begin with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Kind {
    /// A vehicle's response to its stick, with a delayed sensor
    SecondOrder,
    /// Two reactions, one after the other
    Kinetics,
    /// Short-period motion of an aircraft, with its derivatives
    ShortPeriod,
    /// Lateral motion of an aircraft, with its derivatives
    Lateral,
    /// Aircraft in six degrees of freedom
    #[value(name = "aircraft-6dof")]
    Aircraft6dof,
    /// Helicopter near hover, with a rotor that flaps
    HelicopterHover,
    /// One axis of a quadrotor: lag of the motors, delay
    QuadrotorAxis,
    /// Ship by the method of the Maneuvering Modeling Group
    ShipMmg,
    /// Yaw of a ship by its rudder
    Nomoto,
    /// A ship that rolls out
    RollDecay,
    /// Motor with a gear and friction
    Servo,
    /// Stirred tank with one reaction and its heat
    Cstr,
    /// Batch reactor with its heat
    Batch,
    /// Heated body and its sensor
    Thermal,
}

/// How a record is made up: what was true, how it was driven, how exact the gauges were.
struct Recipe {
    template: &'static str,
    truth: &'static [(&'static str, f64)],
    /// One for each input.
    drives: Vec<Drive>,
    samples: usize,
    interval: f64,
    /// One for each output.
    noise: &'static [f64],
}

/// An input: what it is at rest, and the manoeuvre around that.
struct Drive {
    rest: f64,
    size: f64,
    shape: Shape,
}

/// The form of a manoeuvre, by its beginning and its unit of time.
#[derive(Clone, Copy)]
enum Shape {
    Held,
    /// What flight testers fly: up for three units of time, down for two, up and down for one each.
    Steps(f64, f64),
    /// Up for one unit, down for one.
    Doublet(f64, f64),
    /// Up and down for a unit each, on and on.
    Square(f64, f64),
}

impl Shape {
    fn at(self, t: f64) -> f64 {
        let (begin, unit) = match self {
            Self::Held => return 0.0,
            Self::Steps(begin, unit) | Self::Doublet(begin, unit) | Self::Square(begin, unit) => (begin, unit),
        };
        let t = (t - begin) / unit;
        match self {
            _ if t < 0.0 => 0.0,
            Self::Square(..) => 1.0 - 2.0 * (t.floor() % 2.0),
            Self::Doublet(..) if t < 2.0 => 1.0 - 2.0 * t.floor(),
            Self::Steps(..) if t < 3.0 || (5.0..6.0).contains(&t) => 1.0,
            Self::Steps(..) if t < 7.0 => -1.0,
            _ => 0.0,
        }
    }
}

const fn held(rest: f64) -> Drive {
    Drive { rest, size: 0.0, shape: Shape::Held }
}

const fn moved(rest: f64, size: f64, shape: Shape) -> Drive {
    Drive { rest, size, shape }
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
                drives: vec![moved(0.0, 5.0, Shape::Steps(1.0, 1.0))],
                samples: 401,
                interval: 0.05,
                noise: &[0.05, 0.15],
            },
            Self::Kinetics => Recipe {
                template: include_str!("templates/kinetics.fdm"),
                truth: &[("A0", 1.24), ("k1", 0.31), ("k2", 0.074)],
                drives: vec![],
                samples: 31,
                interval: 1.0,
                noise: &[0.01, 0.01],
            },
            Self::ShortPeriod => Recipe {
                template: include_str!("templates/short_period.fdm"),
                truth: &[("Za", -1.32), ("Ze", -0.14), ("Ma", -6.1), ("Mq", -2.05), ("Me", -11.4)],
                drives: vec![moved(0.0, 0.05, Shape::Steps(0.5, 0.5))],
                samples: 401,
                interval: 0.025,
                noise: &[0.002, 0.01],
            },
            Self::Lateral => Recipe {
                template: include_str!("templates/lateral.fdm"),
                truth: &[
                    ("Yb", -0.25),
                    ("Lb", -7.5),
                    ("Lp", -2.6),
                    ("Lr", 0.7),
                    ("La", -6.4),
                    ("Nb", 2.9),
                    ("Np", -0.12),
                    ("Nr", -0.38),
                    ("Nd", -2.7),
                ],
                drives: vec![moved(0.0, 0.05, Shape::Steps(8.0, 0.5)), moved(0.0, 0.05, Shape::Doublet(1.0, 1.0))],
                samples: 401,
                interval: 0.05,
                noise: &[0.002, 0.002, 0.002, 0.02],
            },
            Self::Aircraft6dof => Recipe {
                template: include_str!("templates/aircraft_6dof.fdm"),
                // Beard, McLain (2012): Small Unmanned Aircraft, appendix E
                truth: &[
                    ("body.V[1](0)", 25.0),
                    ("body.V[3](0)", 1.0),
                    ("body.theta(0)", 0.04),
                    ("aero.CLa", 3.45),
                    ("aero.CLde", 0.36),
                    ("aero.CD0", 0.043),
                    ("aero.Cm0", 0.0135),
                    ("aero.Cma", -0.38),
                    ("aero.Cmq", -3.6),
                    ("aero.Cmde", -0.5),
                    ("aero.CYb", -0.98),
                    ("aero.CYdr", 0.17),
                    ("aero.Clb", -0.12),
                    ("aero.Clp", -0.26),
                    ("aero.Clr", 0.14),
                    ("aero.Clda", 0.08),
                    ("aero.Cldr", 0.0105),
                    ("aero.Cnb", 0.25),
                    ("aero.Cnp", -0.022),
                    ("aero.Cnr", -0.35),
                    ("aero.Cnda", -0.006),
                    ("aero.Cndr", -0.032),
                ],
                drives: vec![
                    moved(0.0, 0.05, Shape::Steps(0.5, 0.3)),
                    moved(0.0, 0.03, Shape::Doublet(4.0, 0.5)),
                    moved(0.0, 0.1, Shape::Doublet(7.0, 0.6)),
                    held(13.0),
                ],
                samples: 301,
                interval: 0.04,
                noise: &[0.005, 0.005, 0.005, 0.003, 0.003, 0.2, 0.005, 0.005, 0.05, 0.05],
            },
            Self::HelicopterHover => Recipe {
                template: include_str!("templates/helicopter_hover.fdm"),
                truth: &[
                    ("heli.tau", 0.14),
                    ("heli.Lb", 240.0),
                    ("heli.Ma", 110.0),
                    ("heli.Blat", 0.9),
                    ("heli.Alon", 0.85),
                ],
                drives: vec![moved(0.0, 0.01, Shape::Doublet(0.5, 0.4)), moved(0.0, 0.01, Shape::Doublet(2.5, 0.5))],
                samples: 251,
                interval: 0.02,
                noise: &[0.005, 0.005, 0.002, 0.002, 0.02, 0.02],
            },
            Self::QuadrotorAxis => Recipe {
                template: include_str!("templates/quadrotor_axis.fdm"),
                truth: &[("tau", 0.06), ("late", 0.02), ("K", 75.0), ("Lp", -1.2), ("bias", 0.02)],
                drives: vec![moved(0.0, 0.05, Shape::Steps(0.2, 0.15))],
                samples: 301,
                interval: 0.01,
                noise: &[0.01, 0.005],
            },
            Self::ShipMmg => Recipe {
                template: include_str!("templates/ship_mmg.fdm"),
                truth: &[
                    ("ship.u(0)", 7.97),
                    ("ship.Yv", -0.30),
                    ("ship.Yr", 0.079),
                    ("ship.Nv", -0.128),
                    ("ship.Nr", -0.052),
                    ("ship.Nvvr", -0.25),
                    ("ship.Xvv", -0.044),
                    ("ship.R0", 0.0235),
                ],
                drives: vec![moved(0.0, 20.0, Shape::Square(20.0, 110.0)), held(1.78)],
                samples: 401,
                interval: 2.0,
                noise: &[0.02, 0.02, 0.005, 0.1],
            },
            Self::Nomoto => Recipe {
                template: include_str!("templates/nomoto.fdm"),
                truth: &[("ship.K", 0.13), ("ship.T", 34.0), ("a", 2.0e3), ("ship.psi(0)", 3.0)],
                drives: vec![moved(0.0, 20.0, Shape::Square(20.0, 60.0))],
                samples: 301,
                interval: 1.0,
                noise: &[0.02, 0.1],
            },
            Self::RollDecay => Recipe {
                template: include_str!("templates/roll_decay.fdm"),
                truth: &[
                    ("ship.phi(0)", 0.4),
                    ("ship.d1", 0.012),
                    ("ship.d2", 0.08),
                    ("ship.omega0", 0.62),
                    ("ship.k3", -0.12),
                ],
                drives: vec![],
                samples: 401,
                interval: 0.25,
                noise: &[0.05],
            },
            Self::Servo => Recipe {
                template: include_str!("templates/servo.fdm"),
                truth: &[("drive.k", 0.042), ("drive.J", 0.021), ("drive.b", 0.006), ("drive.c", 0.11)],
                drives: vec![moved(0.0, 6.0, Shape::Square(0.2, 0.7))],
                samples: 401,
                interval: 0.01,
                noise: &[0.02, 0.05, 0.005],
            },
            Self::Cstr => Recipe {
                template: include_str!("templates/cstr.fdm"),
                truth: &[
                    ("A(0)", 0.75),
                    ("T(0)", 335.0),
                    ("k350", 1.1),
                    ("E", 7.1e4),
                    ("rise", 72.0),
                    ("cooling", 1.7),
                ],
                drives: vec![moved(0.8, 0.2, Shape::Square(4.0, 6.0)), moved(330.0, 6.0, Shape::Steps(2.0, 3.0))],
                samples: 201,
                interval: 0.15,
                noise: &[0.004, 0.15],
            },
            Self::Batch => Recipe {
                template: include_str!("templates/batch.fdm"),
                truth: &[
                    ("tank.A(0)", 1.0),
                    ("tank.T(0)", 312.0),
                    ("tank.k_ref", 1.6e-3),
                    ("tank.E", 6.4e4),
                    ("UA", 2.2e-3),
                    ("warming", 18.0),
                ],
                drives: vec![moved(330.0, 8.0, Shape::Steps(100.0, 250.0))],
                samples: 201,
                interval: 12.0,
                noise: &[0.005, 0.15],
            },
            Self::Thermal => Recipe {
                template: include_str!("templates/thermal.fdm"),
                truth: &[
                    ("body.T(0)", 295.0),
                    ("sensor(0)", 295.0),
                    ("body.C", 14.0),
                    ("body.UA", 0.085),
                    ("tau", 16.0),
                ],
                drives: vec![moved(2.0, 2.0, Shape::Square(20.0, 150.0)), held(294.0)],
                samples: 301,
                interval: 3.0,
                noise: &[0.1],
            },
        }
    }
}

pub(crate) fn run(arguments: &Arguments) -> Ending {
    let (path, recipe) = (&arguments.target, arguments.kind.recipe());
    if let Some(record) = &arguments.from {
        return of_record(path, record);
    }
    let (files, next) = match path.extension().map(|e| e.to_string_lossy().into_owned()) {
        Some(ending) if ending == "fdm" => recipe.alone(path)?,
        Some(ending) => {
            let what = "the name of a model ends with .fdm, that of a folder with nothing";
            return Err(Failure::input([format!("{}: {what}, not with .{ending}", path.display())]));
        }
        None => recipe.project(path, arguments.kind)?,
    };
    let there: Vec<&Path> = files.iter().map(|f| f.path.as_path()).filter(|p| p.symlink_metadata().is_ok()).collect();
    if !there.is_empty() {
        let said = there.iter().map(|p| format!("{}: exists already, and is not overwritten", p.display()));
        return Err(Failure::Input(said.collect()));
    }
    if path.extension().is_none() {
        make_folder(path).map_err(|e| Unwritten(at(path, &e)))?;
    }
    for file in &files {
        admits(&file.path).map_err(|e| Failure::at(&file.path, &e))?;
    }
    for file in &files {
        written(&file.path, &file.bytes)?;
    }
    ended(print(&next))
}

/// Writes a model for a record, and says what was taken for what, and the command that fits it.
fn of_record(path: &Path, record: &Path) -> Ending {
    if path.extension().is_none_or(|e| e != "fdm") {
        return Err(Failure::input([format!("{}: beside --from, the name of a model ends with .fdm", path.display())]));
    }
    if path.symlink_metadata().is_ok() {
        return Err(Failure::input([format!("{}: exists already, and is not overwritten", path.display())]));
    }
    let looked = looked_at(record)?;
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let name: String = stem.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    let from = record.display().to_string();
    let text = looked.model(&name, &from).or_else(|_| looked.model(&format!("model_{name}"), &from))?;
    let shown = |columns: &[FromColumn]| -> String {
        let one = |c: &FromColumn| {
            let unit = c.unit.as_ref().map(|u| format!(" [{u}]")).unwrap_or_default();
            let held = if c.held { ", held between samples" } else { "" };
            let title = if c.title == c.name { String::new() } else { format!(", column `{}`", c.title) };
            format!("{}{unit}{title}{held}", c.name)
        };
        if columns.is_empty() { "none".into() } else { columns.iter().map(one).collect::<Vec<_>>().join("; ") }
    };
    let (samples, interval) = looked.sampling();
    looked.notes.iter().for_each(|note| aside(format_args!("note: {}", visible(note))));
    let mut said = format!("{}, for {from}: {samples} samples, {interval:.3e} s apart\n", path.display());
    said += &format!("  inputs   {}\n  outputs  {}\n", shown(&looked.inputs), shown(&looked.outputs));
    if !looked.left_out.is_empty() {
        said += &format!("  left out {}\n", looked.left_out.join(", "));
    }
    let renamed = looked.inputs.iter().chain(&looked.outputs).filter(|c| c.title != c.name);
    let maps: String = renamed.map(|c| format!(" --map {}", word(&format!("{}={}", c.name, c.title)))).collect();
    let (model, run) = (word(&path.display().to_string()), word(&from));
    said += &format!("\n  fdm fit {model} {run}{maps}\n");
    write_new_file(path, text.as_bytes()).map_err(|e| Unwritten(at(path, &e)))?;
    ended(print(&visible(&said)))
}

/// A word of a command.
fn word(text: &str) -> String {
    let plain = |c: char| c.is_alphanumeric() || "=/._-:\\".contains(c);
    if text.chars().all(plain) { text.into() } else { format!("\"{text}\"") }
}

/// A file that is to be written.
struct New {
    path: PathBuf,
    bytes: Vec<u8>,
}

impl Recipe {
    /// A model and a record beside it, and what is said of them.
    fn alone(&self, path: &Path) -> Result<(Vec<New>, String), Failure> {
        let record = path.with_extension("csv");
        let (model_path, record_path) = (word(&path.display().to_string()), word(&record.display().to_string()));
        let text = self.template.replace("{{model}}", &model_path).replace("{{record}}", &record_path);
        let (text, model) = named(&text, path, path)?;
        let table = self.record(&model, Made { factor: 1.0, seed: 1 })?;
        let next = format!(
            "{model_path} and a made-up record, {record_path}\n\n  fdm check {model_path}\n  fdm simulate {model_path} {record_path}\n  fdm fit {model_path} {record_path}\n"
        );
        Ok((vec![New { path: path.into(), bytes: text.into_bytes() }, New { path: record, bytes: table }], next))
    }

    /// A folder with a model, a record that it is fitted to, one that it predicts, a map of the channels, a project file.
    fn project(&self, folder: &Path, kind: Kind) -> Result<(Vec<New>, String), Failure> {
        let text = self.template.replace("{{model}}", "model.fdm").replace("{{record}}", "run.csv");
        let (text, model) = named(&text, folder, &folder.join("model.fdm"))?;
        let definition = model.definition();
        let about = if definition.doc.is_empty() { &definition.name } else { &definition.doc };
        let mut map = format!(
            "# Which column holds which channel, and its unit: change it to your records.\nabout = {about:?}\n"
        );
        for quantity in
            definition.inputs.iter().map(|i| &i.quantity).chain(definition.outputs.iter().map(|o| &o.quantity))
        {
            let unit = quantity.unit.as_ref().map(|u| format!("unit = \"{u}\"\n")).unwrap_or_default();
            map += &format!("\n[channel.{0}]\nfrom = \"{0}\"\n{unit}", quantity.name);
        }
        let project =
            "model = \"model.fdm\"\ndata = [\"run.csv\"]\nvalidation = [\"validation.csv\"]\nmap = \"map.toml\"\n";
        let kind = kind.to_possible_value().map(|v| v.get_name().to_string()).unwrap_or_default();
        let steps = "\
fdm check                  # every mistake of the model, every derivative
fdm doctor                 # what is wrong with the records
fdm fit --out result       # the estimates; `fdm report result` writes the page
fdm validate result        # how it predicts validation.csv
fdm diagnose               # what the model gets wrong
";
        let readme = format!(
            "# {about}\n\nWritten by `fdm new {} --kind {kind}`. The records are made up: put yours in their place, and its columns into `map.toml`. `fdm.toml` names model, records and map.\n\n```sh\n{steps}```\n",
            folder.file_name().unwrap_or_default().to_string_lossy(),
        );
        let next = format!("{}\n\n  cd {0}\n  fdm fit\n", folder.display());
        let records = [
            ("run.csv", self.record(&model, Made { factor: 1.0, seed: 1 })?),
            ("validation.csv", self.record(&model, Made { factor: -0.8, seed: 2 })?),
        ];
        let texts = [("model.fdm", text), ("map.toml", map), (project::NAME, project.into()), ("README.md", readme)];
        let texts = texts.into_iter().map(|(name, text)| (name, text.into_bytes()));
        let files = texts.chain(records).map(|(name, bytes)| New { path: folder.join(name), bytes });
        Ok((files.collect(), next))
    }
}

/// The text with the model's own name: that of the file or folder, when it can be one.
fn named(text: &str, after: &Path, path: &Path) -> Result<(String, Model), Failure> {
    let stem = after.file_stem().unwrap_or_default().to_string_lossy();
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

/// A record among several of one recipe: how large its manoeuvre is, and its noise.
#[derive(Clone, Copy)]
struct Made {
    factor: f64,
    seed: u64,
}

impl Recipe {
    /// The table of a made-up record.
    fn record(&self, model: &Model, made: Made) -> Result<Vec<u8>, Failure> {
        let (layout, definition) = (model.layout(), model.definition());
        let mut theta = definition.start();
        for (name, value) in self.truth {
            definition.param(name).into_iter().for_each(|k| theta[k] = *value);
        }
        let time: Vec<f64> = (0..self.samples).map(|k| k as f64 * self.interval).collect();
        let driven: Vec<Vec<f64>> = (self.drives.iter())
            .map(|d| time.iter().map(|t| rounded(d.rest + made.factor * d.size * d.shape.at(*t))).collect())
            .collect();
        let (m, q) = (layout.inputs, layout.outputs);
        let run = Run {
            name: "made up".into(),
            inputs: (0..self.samples).flat_map(|k| driven.iter().map(move |u| u[k])).collect(),
            held: vec![false; m],
            measured: vec![f64::NAN; self.samples * q],
            input_gaps: vec![0; m],
            stated: Vec::new(),
            output_gaps: vec![0; q],
            time,
        }
        .with_moves_held();
        let unsuited = |e| Failure::input([format!("the made-up record: {e}")]);
        let steps = choose_steps(model.dynamics(), &run, &theta, &StepOptions::default()).map_err(unsuited)?.steps;
        let mut y = vec![f64::NAN; self.samples * q];
        let simulated = Simulator::new(model.dynamics(), &run, steps).map_err(unsuited)?.simulate(&theta, &mut y);
        simulated.map_err(|d| Failure::input([format!("the made-up record diverges at {}", d.time)]))?;
        let mut random = SplitMix(made.seed);
        y.iter_mut().enumerate().for_each(|(k, y)| *y = rounded(*y + self.noise[k % q] * random.sum_of_twelve()));
        let mut columns =
            vec![("t".to_string(), Some(definition.time.to_string()), run.time.iter().map(|t| rounded(*t)).collect())];
        let unit = |q: &fdm_grammar::model::Quantity| q.unit.as_ref().map(ToString::to_string);
        columns
            .extend(definition.inputs.iter().zip(driven).map(|(i, u)| (i.quantity.name.clone(), unit(&i.quantity), u)));
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
