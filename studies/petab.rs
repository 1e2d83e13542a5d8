//! Problems of the PEtab benchmark collection: the log-likelihood at the published parameters, and fits from many starts.
//!
//! The collection's tables (measurements, conditions, parameters; BSD 3-Clause) are read from a copy of it, which is not part of this project:
//!
//! `FDM_PETAB=.../Benchmark-Models cargo test --release --manifest-path studies/Cargo.toml --test studies petab:: -- --ignored --nocapture`

use fdm::Model;
use fdm::estimate::{Changes, FitOptions, MultiStart, Noise, Options, fit};
use fdm::record::Run;
use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;

/// One row of a table, by the names of its columns.
type Row = BTreeMap<String, String>;

/// What is particular about one problem.
struct Benchmark {
    /// Its name in the collection, and of its model here.
    names: (&'static str, &'static str),
    /// Log-likelihood at the parameters of the collection, as the collection's tools print it.
    published: f64,
    /// The output of a measurement, when that is not the observable.
    output: fn(&Row) -> String,
    /// The input by name, under a condition (a row of the table of conditions) and at a time; negative ones come before the experiment.
    input: fn(&str, &Row, f64) -> f64,
    /// Column of the deviation of each measured number, as an input of the model.
    deviation: Option<fn(&str) -> String>,
    /// Deviation of an output by the parameters.
    noise: fn(&str, &dyn Fn(&str) -> f64) -> f64,
    /// How long the run before the experiment is, which leads to a steady state.
    before: f64,
}

fn number(row: &Row, column: &str) -> f64 {
    row[column].parse().unwrap_or_else(|_| panic!("{column}: {}", row[column]))
}

fn observable(row: &Row) -> String {
    row["observableId"].clone()
}

const PLAIN: Benchmark = Benchmark {
    names: ("", ""),
    published: 0.0,
    output: observable,
    input: |name, condition, _| number(condition, name),
    deviation: None,
    noise: |_, _| f64::NAN,
    before: 0.0,
};

/// All problems that have a model here.
fn benchmarks() -> Vec<Benchmark> {
    vec![
        Benchmark {
            names: ("Crauste_CellSystems2017", "crauste"),
            published: -190.965_217,
            deviation: Some(|output| {
                let cells = ["Naive", "EarlyEffector", "LateEffector", "Memory"];
                let inputs = ["sd_naive", "sd_early", "sd_late", "sd_memory"];
                let k = cells.iter().position(|c| output == format!("observable_{c}")).unwrap();
                inputs[k].into()
            }),
            ..PLAIN
        },
        Benchmark {
            names: ("Boehm_JProteomeRes2014", "boehm"),
            published: -138.221_997,
            noise: |output, parameter| parameter(&format!("sd_{output}")),
            ..PLAIN
        },
        Benchmark {
            names: ("Bruno_JExpBot2016", "bruno"),
            published: 46.688_177,
            input: |name, condition, _| f64::from(condition["conditionId"].ends_with(&name.replace("assay", "data"))),
            deviation: Some(|output| format!("sd_{}", &output[1..])),
            ..PLAIN
        },
        Benchmark {
            names: ("Sneyd_PNAS2002", "sneyd"),
            published: 319.791_778,
            noise: |_, parameter| parameter("sigma"),
            ..PLAIN
        },
        Benchmark {
            names: ("Fiedler_BMCSystBiol2016", "fiedler"),
            published: 58.583_902,
            // s_pErk_20140430_gel1: the scale of one protein on one gel
            output: |row| row["observableParameters"].trim_start_matches("s_").into(),
            noise: |output, parameter| {
                let protein = output.split('_').next().unwrap();
                parameter(&format!("s_{output}")) * parameter(&format!("sigma_{protein}"))
            },
            ..PLAIN
        },
        Benchmark {
            names: ("Weber_BMC2015", "weber"),
            published: -296.201_792,
            input: |name, condition, time| match name {
                "PdBu" | "kb_NB142_70" => {
                    let given = time >= 0.0 && time >= number(condition, &format!("{name}_time"));
                    if given { number(condition, &format!("{name}_dose")) } else { 0.0 }
                }
                flag => f64::from(time >= 0.0) * number(condition, flag),
            },
            noise: |output, parameter| parameter(&format!("std_{output}")),
            before: 2e5,
            ..PLAIN
        },
        Benchmark {
            names: ("Zheng_PNAS2012", "zheng"),
            published: 278.333_533,
            input: |_, _, time| f64::from(time < 0.0),
            noise: |_, parameter| parameter("sigma"),
            before: 2e3,
            ..PLAIN
        },
    ]
}

/// A problem with the collection's tables.
struct Problem {
    model: Model,
    runs: Vec<Run>,
    /// Published value of each parameter.
    values: Vec<(String, f64)>,
    noise: Noise,
    /// What is added to the log-likelihood where measured numbers are divided by their deviations.
    constant: f64,
}

fn table(problem: &str, name: &str) -> Vec<Row> {
    let folder = std::env::var("FDM_PETAB").expect("FDM_PETAB: the folder Benchmark-Models of the collection");
    let file = PathBuf::from(folder).join(problem).join(format!("{name}_{problem}.tsv"));
    let text = fs::read_to_string(&file).unwrap_or_else(|e| panic!("{}: {e}", file.display()));
    let mut lines = text.lines();
    let columns: Vec<&str> = lines.next().unwrap().split('\t').collect();
    let row =
        |line: &str| columns.iter().map(|c| c.trim().to_string()).zip(line.split('\t').map(String::from)).collect();
    lines.filter(|line| !line.trim().is_empty()).map(row).collect()
}

impl Problem {
    fn read(benchmark: &Benchmark) -> Self {
        let (name, own) = benchmark.names;
        let model = support::shipped(&format!("petab/{own}.fdm"));
        let definition = model.definition();
        let place = |output: &str| definition.outputs.iter().position(|o| o.quantity.name == output).unwrap();
        let conditions = table(name, "experimentalCondition");
        // measurements that are repeated at one time go into runs of their own
        let mut runs: BTreeMap<(String, usize), BTreeMap<u64, Vec<(usize, f64, f64)>>> = BTreeMap::new();
        let mut seen: BTreeMap<(String, String, u64), usize> = BTreeMap::new();
        let mut constant = 0.0;
        for row in table(name, "measurementData") {
            let (output, condition) = ((benchmark.output)(&row), row["simulationConditionId"].clone());
            let time = number(&row, "time").to_bits();
            let repeat = seen.entry((condition.clone(), output.clone(), time)).or_default();
            let deviation = if benchmark.deviation.is_some() { number(&row, "noiseParameters") } else { 1.0 };
            constant -= deviation.ln();
            let entry = (place(&output), number(&row, "measurement") / deviation, deviation);
            runs.entry((condition, *repeat)).or_default().entry(time).or_default().push(entry);
            *repeat += 1;
        }
        let run = |((id, repeat), cells): ((String, usize), BTreeMap<u64, Vec<(usize, f64, f64)>>)| {
            let condition = conditions.iter().find(|c| c["conditionId"] == id).unwrap();
            Self::run(benchmark, &model, condition, (format!("{id}_{}", repeat + 1), cells))
        };
        let runs = runs.into_iter().map(run).collect();
        let rows = table(name, "parameters");
        let values: Vec<_> = rows.iter().map(|r| (r["parameterId"].clone(), number(r, "nominalValue"))).collect();
        let value = |name: &str| values.iter().find(|(n, _)| n == name).unwrap_or_else(|| panic!("{name}")).1;
        let deviations = definition.outputs.iter().map(|o| match o.noise {
            Some(known) => Some(known),
            None => Some((benchmark.noise)(&o.quantity.name, &value)),
        });
        let noise = Noise::Given(deviations.collect());
        Self { runs, noise, constant, values, model: model.clone() }
    }

    fn run(
        benchmark: &Benchmark,
        model: &Model,
        condition: &Row,
        (name, cells): (String, BTreeMap<u64, Vec<(usize, f64, f64)>>),
    ) -> Run {
        let definition = model.definition();
        let (m, q) = (definition.inputs.len(), definition.outputs.len());
        let mut time: Vec<f64> = cells.keys().map(|t| f64::from_bits(*t)).collect();
        time.push(0.0);
        // ever longer intervals of the run before the experiment, whose steps are then as long as they may be
        let mut early = 1e-6;
        while benchmark.before > 0.0 && early < 0.9 * benchmark.before {
            time.push(early - benchmark.before);
            early *= 2.0;
        }
        if benchmark.before > 0.0 {
            time.push(-benchmark.before);
        }
        time.sort_by(f64::total_cmp);
        time.dedup();
        let (mut inputs, mut measured) = (vec![1.0; time.len() * m], vec![f64::NAN; time.len() * q]);
        for (k, t) in time.iter().enumerate() {
            for (j, input) in definition.inputs.iter().enumerate() {
                if !input.quantity.name.starts_with("sd_") {
                    inputs[k * m + j] = (benchmark.input)(&input.quantity.name, condition, *t);
                }
            }
            for (output, value, deviation) in cells.get(&t.to_bits()).into_iter().flatten() {
                measured[k * q + output] = *value;
                if let Some(column) = benchmark.deviation {
                    let column = column(&definition.outputs[*output].quantity.name);
                    let j = definition.inputs.iter().position(|i| i.quantity.name == column).unwrap();
                    inputs[k * m + j] = *deviation;
                }
            }
        }
        let time = time.into_iter().map(|t| t + benchmark.before).collect();
        let held = vec![true; m];
        Run { name, time, inputs, held, measured, input_gaps: vec![0; m], output_gaps: vec![0; q] }
    }

    fn at_published(&self) -> Changes {
        let known = |(name, _): &&(String, f64)| self.model.definition().param(name).is_some();
        let inside = |(name, value): &(String, f64)| {
            let p = &self.model.definition().params[self.model.definition().param(name).unwrap()];
            (name.clone(), value.clamp(p.lower, p.upper))
        };
        Changes { set: self.values.iter().filter(known).map(inside).collect(), ..Changes::default() }
    }
}

#[test]
#[ignore = "a study"]
fn likelihoods() {
    println!("{:<26} {:>6} {:>16} {:>16} {:>10}", "problem", "points", "log-likelihood", "published", "apart");
    for benchmark in benchmarks() {
        let problem = Problem::read(&benchmark);
        let options = Options { noise: problem.noise.clone(), iterations: 0, colour: false, ..Options::default() };
        let options = FitOptions { options, changes: problem.at_published(), bare: true, ..FitOptions::default() };
        let options = FitOptions { continuation: fdm::estimate::Continuation::Never, ..options };
        let found = fit(&problem.model, &problem.runs, &options, &mut ()).unwrap();
        let points = problem.runs.iter().flat_map(|r| &r.measured).filter(|z| !z.is_nan()).count();
        let likelihood = found.estimate.log_likelihood.map_or(f64::NAN, |l| l + problem.constant);
        let apart = likelihood - benchmark.published;
        println!(
            "{:<26} {points:>6} {likelihood:>16.6} {:>16.6} {apart:>10.1e}",
            benchmark.names.0, benchmark.published
        );
    }
}

#[test]
#[ignore = "a study"]
fn starts() {
    for (name, count) in [("crauste", 9), ("boehm", 10)] {
        let benchmark = benchmarks().into_iter().find(|b| b.names.1 == name).unwrap();
        let problem = Problem::read(&benchmark);
        let seeds = std::env::var("FDM_SEEDS").ok().and_then(|s| s.parse().ok()).unwrap_or(3);
        for seed in 0..seeds {
            // the given start does not count: it stands near the published values
            let starts = MultiStart { count: count + 1, seed };
            let options = Options { iterations: 400, ..Options::default() };
            let options = FitOptions { starts, options, ..FitOptions::default() };
            let found = fit(&problem.model, &problem.runs, &options, &mut ()).unwrap();
            let reached = found.starts.iter().filter(|s| s.number > 1 && s.minimum == Some(1)).count();
            let best = found.estimate.log_likelihood.map_or(f64::NAN, |l| l + problem.constant);
            println!(
                "{name}, seed {seed}: {reached} of {count} starts reached the best minimum, log-likelihood {best:.6}"
            );
            for s in &found.starts {
                println!("   {:>3} {:>16.8?} {:>3?} {}", s.number, s.cost, s.minimum, s.message);
            }
        }
    }
}
