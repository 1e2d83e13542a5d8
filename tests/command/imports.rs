//! `fdm import`: problems of PEtab and models of SBML become folders in which `fdm fit` finds everything. Log-likelihoods are compared with
//! solutions in closed form.

use serde_json::Value;
use std::fmt::Write as _;
use support::command::{Desk, said};
use support::repository;

/// What a problem consists of; tables with commas in the place of tabs.
#[derive(Clone, Copy)]
struct Problem<'a> {
    sbml: &'a str,
    conditions: &'a str,
    observables: &'a str,
    measurements: &'a str,
    parameters: &'a str,
}

const YAML: &str = "format_version: 1
parameter_file: parameters.tsv
problems:
- sbml_files: [model.xml]
  condition_files: [conditions.tsv]
  observable_files: [observables.tsv]
  measurement_files: [measurements.tsv]
";

/// MathML of a small prefix notation: `* k A`, `+ (* k A) B`; words are names, numbers are numbers.
fn mathml(text: &str) -> String {
    fn part(words: &mut std::iter::Peekable<std::vec::IntoIter<String>>, out: &mut String) {
        let word = words.next().unwrap();
        match word.as_str() {
            "(" => {
                let operator = words.next().unwrap();
                write!(out, "<apply><{operator}/>").unwrap();
                while words.peek().unwrap() != ")" {
                    part(words, out);
                }
                words.next();
                out.push_str("</apply>");
            }
            "time" => out.push_str("<csymbol definitionURL=\"http://www.sbml.org/sbml/symbols/time\">t</csymbol>"),
            w if w.starts_with(|c: char| c.is_ascii_digit()) => write!(out, "<cn>{w}</cn>").unwrap(),
            w => write!(out, "<ci>{w}</ci>").unwrap(),
        }
    }
    let spaced = text.replace('(', " ( ").replace(')', " ) ");
    let words: Vec<String> = spaced.split_whitespace().map(String::from).collect();
    let mut out = String::new();
    part(&mut words.into_iter().peekable(), &mut out);
    format!("<math xmlns=\"http://www.w3.org/1998/Math/MathML\">{out}</math>")
}

fn species(id: &str, compartment: &str, concentration: f64) -> String {
    format!(
        "<species id=\"{id}\" compartment=\"{compartment}\" initialConcentration=\"{concentration}\" hasOnlySubstanceUnits=\"false\"/>"
    )
}

fn reaction(id: &str, from: &str, to: &str, law: &str) -> String {
    let side = |list: &str, id: &str| match id {
        "" => String::new(),
        id => format!("<{list}><speciesReference species=\"{id}\" stoichiometry=\"1\"/></{list}>"),
    };
    let sides = side("listOfReactants", from) + &side("listOfProducts", to);
    format!("<reaction id=\"{id}\">{sides}<kineticLaw>{}</kineticLaw></reaction>", mathml(law))
}

/// A model of lists: what is empty is left out.
fn sbml(parts: &[(&str, String)]) -> String {
    let lists: String =
        parts.iter().map(|(list, content)| format!("<listOf{list}>\n{content}\n</listOf{list}>\n")).collect();
    format!(
        "<sbml xmlns=\"http://www.sbml.org/sbml/level3/version1/core\" level=\"3\" version=\"1\"><model id=\"m\">\n{lists}</model></sbml>"
    )
}

/// A turns into B at k1, B into A at k2, in a vessel of two litres.
fn conversion() -> String {
    sbml(&[
        ("Compartments", "<compartment id=\"V\" size=\"2\"/>".into()),
        ("Species", species("A", "V", 1.0) + &species("B", "V", 0.0)),
        ("Parameters", "<parameter id=\"k1\" value=\"0.1\"/><parameter id=\"k2\" value=\"0.1\"/>".into()),
        ("Reactions", reaction("f", "A", "B", "(times V k1 A)") + &reaction("b", "B", "A", "(times V k2 B)")),
    ])
}

/// B at a time, from A and B at time 0.
fn converted((a, b): (f64, f64), (k1, k2): (f64, f64), t: f64) -> f64 {
    let end = (a + b) * k1 / (k1 + k2);
    end + (b - end) * (-(k1 + k2) * t).exp()
}

const RATES: &str = "parameterId,parameterScale,lowerBound,upperBound,nominalValue,estimate
k1,log10,1e-3,1e3,0.8,1
k2,log10,1e-3,1e3,0.6,1
";

fn normal(residual: f64, deviation: f64) -> f64 {
    -0.5 * (residual / deviation).powi(2) - deviation.ln() - 0.5 * std::f64::consts::TAU.ln()
}

/// A desk with the problem, imported into `p`; the log-likelihood of PEtab at the nominal values.
fn imported(problem: Problem<'_>) -> (Desk, f64) {
    let desk = written(problem);
    desk.good("import problem.yaml -o p");
    let likelihood = likelihood(&desk);
    (desk, likelihood)
}

fn written(problem: Problem<'_>) -> Desk {
    let desk = Desk::with([("problem.yaml", YAML)]);
    desk.write("model.xml", problem.sbml);
    let tables = [
        ("conditions.tsv", problem.conditions),
        ("observables.tsv", problem.observables),
        ("measurements.tsv", problem.measurements),
        ("parameters.tsv", problem.parameters),
    ];
    tables.iter().for_each(|(file, text)| {
        desk.write(file, text.replace(',', "\t"));
    });
    desk
}

fn likelihood(desk: &Desk) -> f64 {
    let words = desk.text("p/fdm.toml");
    let held: Vec<&str> = words.split('"').skip(1).step_by(2).skip(2).collect();
    let held: String = held.iter().map(|name| format!(" --zoh {name}")).collect();
    let found = desk.fdm(&format!("fit p/model.fdm --runs p/runs.csv --iterations 0 --json -q{held}"));
    let found: Value = serde_json::from_slice(&found.stdout).unwrap_or_else(|_| panic!("{found:?}"));
    let added = desk
        .text("p/IMPORT.md")
        .split_once("Add ")
        .map_or(0.0, |(_, rest)| rest.split_whitespace().next().unwrap().parse::<f64>().unwrap());
    found["log_likelihood"].as_f64().unwrap_or_else(|| panic!("{found}")) + added
}

#[track_caller]
fn near(found: f64, wanted: f64) {
    assert!((found - wanted).abs() < 1e-5 * (1.0 + wanted.abs()), "{found} for {wanted}");
}

#[test]
fn the_problem_that_is_shipped_is_read_and_fitted() {
    let desk = Desk::new();
    let place = repository().join("models/petab/conversion/conversion.yaml");
    desk.good(&format!("import {} -o p", place.display()));
    let text = desk.text("p/model.fdm");
    for line in [
        "A -> B : k1*A;",
        "B -> A : k2*B;",
        "known A_0 per run",
        "output a_m \"titration\" = log(max(A, 1e-300));",
        "noise  a_m = 0.1;",
    ] {
        let spaced = |text: &str| text.split_whitespace().collect::<String>();
        assert!(spaced(&text).contains(&spaced(line)), "{line} in\n{text}");
    }
    let found = desk.json("fit p/model.fdm --runs p/runs.csv --json -q");
    // with these the numbers were made up
    for (name, true_value) in [("k1", 0.8), ("k2", 0.3), ("gain", 4.0), ("sigma", 0.05)] {
        let all = found["parameters"].as_array().unwrap();
        let found = all.iter().find(|p| p["name"] == name).unwrap();
        let [value, error] = ["value", "standard_error"].map(|key| found[key].as_f64().unwrap());
        assert!((value - true_value).abs() < 4.0 * error, "{name}: {value} +- {error}");
    }
    let said = desk.refused(&format!("import {} -o p", place.display()));
    assert!(said.contains("exists already"), "{said}");
}

#[test]
fn conditions_overrides_and_repetitions_have_the_likelihood_of_petab() {
    let (desk, found) = imported(Problem {
        sbml: &conversion(),
        conditions: "conditionId,A,offset\nlow,1,0.5\nhigh,a_high,shift\n",
        observables: "observableId,observableFormula,observableTransformation,noiseFormula
y,offset + observableParameter1_y*B,log10,noiseParameter1_y
A,A + B,lin,0.1 + noiseParameter1_A*A
",
        measurements: "observableId,simulationConditionId,time,measurement,observableParameters,noiseParameters
y,low,1,0.9,gain,0.1
y,low,1,1.1,gain,0.2
y,high,2,3.5,7,0.2
A,high,2,4.2,,rel
A,high,0,3.9,,rel
",
        parameters: &format!(
            "{RATES}gain,lin,0,10,1.5,1\nshift,lin,-1,1,0.25,0\na_high,log10,0.1,10,4,1\nrel,lin,0,1,0.05,1\n"
        ),
    });
    let rates = (0.8, 0.6);
    let on_log = |measured: f64, y: f64, s: f64| {
        normal(measured.log10() - y.log10(), s) - (measured * std::f64::consts::LN_10).ln()
    };
    let low = 0.5 + 1.5 * converted((1.0, 0.0), rates, 1.0);
    let high = 0.25 + 7.0 * converted((4.0, 0.0), rates, 2.0);
    let s = |t: f64| 0.1 + 0.05 * (4.0 - converted((4.0, 0.0), rates, t));
    let wanted = on_log(0.9, low, 0.1)
        + on_log(1.1, low, 0.2)
        + on_log(3.5, high, 0.2)
        + normal(4.2 - 4.0, s(2.0))
        + normal(3.9 - 4.0, s(0.0));
    near(found, wanted);
    let report = desk.text("p/IMPORT.md");
    assert_eq!(desk.names("p/runs").len(), 3, "the second number at one time is a repetition: {report}");
}

#[test]
fn a_steady_state_before_the_experiment_and_a_new_value_at_its_beginning() {
    // B is set to 2 when the experiment begins, A is what it was; in the other one both are kept
    let (_, found) = imported(Problem {
        sbml: &conversion(),
        conditions: "conditionId,k1,A,B\nbefore,0.3,3,0\nset,0.8,nan,2\nkept,0.8,nan,nan\n",
        observables: "observableId,observableFormula,noiseFormula\ny,B,0.1\n",
        measurements: "observableId,preequilibrationConditionId,simulationConditionId,time,measurement
y,before,set,0,2.1
y,before,set,1.5,2
y,before,kept,0,0.9
y,before,kept,1.5,1.7
y,,kept,1.5,0.5
",
        parameters: "parameterId,parameterScale,lowerBound,upperBound,nominalValue,estimate\nk2,log10,1e-3,1e3,0.6,1\n",
    });
    let rates = (0.8, 0.6);
    // at rest A = 2, B = 1
    let wanted = normal(0.1, 0.1)
        + normal(2.0 - converted((2.0, 2.0), rates, 1.5), 0.1)
        + normal(0.1, 0.1)
        + normal(1.7 - converted((2.0, 1.0), rates, 1.5), 0.1)
        + normal(0.5 - converted((1.0, 0.0), rates, 1.5), 0.1);
    near(found, wanted);
}

#[test]
fn time_switches_where_the_problem_says() {
    // a feed of 2 per litre from the time t_on of the condition until 3, and a second one that waits for a parameter
    let feed = "<piecewise><piece><cn>2</cn><apply><and/><apply><geq/>TIME<ci>t_on</ci></apply><apply><lt/>TIME<cn>3</cn></apply></apply></piece><otherwise><cn>0</cn></otherwise></piecewise>";
    let time = "<csymbol definitionURL=\"http://www.sbml.org/sbml/symbols/time\">t</csymbol>";
    let rule = format!(
        "<assignmentRule variable=\"feed\"><math xmlns=\"http://www.w3.org/1998/Math/MathML\">{}</math></assignmentRule>",
        feed.replace("TIME", time)
    );
    let fed = sbml(&[
        ("Compartments", "<compartment id=\"V\" size=\"1\"/>".into()),
        ("Species", species("A", "V", 0.0)),
        ("Parameters", "<parameter id=\"k\" value=\"0.1\"/><parameter id=\"t_on\" value=\"1\"/><parameter id=\"feed\" constant=\"false\"/>".into()),
        ("Rules", rule),
        ("Reactions", reaction("in", "", "A", "(times V feed)") + &reaction("out", "A", "", "(times V k A)")),
    ]);
    let (desk, found) = imported(Problem {
        sbml: &fed,
        conditions: "conditionId,t_on\nearly,0.7\nlate,2.2\n",
        observables: "observableId,observableFormula,noiseFormula\ny,A,0.1\n",
        measurements: "observableId,simulationConditionId,time,measurement\ny,early,5,1\ny,late,5,0.5\ny,late,2.2,0\n",
        parameters: "parameterId,parameterScale,lowerBound,upperBound,nominalValue,estimate\nk,lin,0,10,0.4,1\n",
    });
    let fed = |on: f64, t: f64| 2.0 / 0.4 * (1.0 - (-0.4 * (3.0 - on)).exp()) * (-0.4 * (t - 3.0)).exp();
    near(found, normal(1.0 - fed(0.7, 5.0), 0.1) + normal(0.5 - fed(2.2, 5.0), 0.1) + normal(0.0, 0.1));
    assert!(desk.text("p/runs/early.csv").contains("\n0.7,"), "a sample stands at the switch");
}

#[test]
fn compartments_amounts_and_functions_mean_what_sbml_says() {
    // A leaves a litre for half a litre, law by a function; C counts amounts; X is a word of the language's own
    let function = "<functionDefinition id=\"law\"><math xmlns=\"http://www.w3.org/1998/Math/MathML\"><lambda><bvar><ci>a</ci></bvar><bvar><ci>b</ci></bvar><apply><times/><ci>a</ci><ci>b</ci></apply></lambda></math></functionDefinition>";
    let amount = "<species id=\"C\" compartment=\"W\" initialAmount=\"3\" hasOnlySubstanceUnits=\"true\"/>";
    let called = "<reaction id=\"go\"><listOfReactants><speciesReference species=\"A\" stoichiometry=\"1\"/></listOfReactants><listOfProducts><speciesReference species=\"in\" stoichiometry=\"2\"/></listOfProducts><kineticLaw><math xmlns=\"http://www.w3.org/1998/Math/MathML\"><apply><ci>law</ci><ci>k</ci><ci>A</ci></apply></math></kineticLaw></reaction>";
    let model = sbml(&[
        ("FunctionDefinitions", function.into()),
        ("Compartments", "<compartment id=\"V\" size=\"1\"/><compartment id=\"W\" size=\"0.5\"/>".into()),
        ("Species", species("A", "V", 2.0) + &species("in", "W", 1.0) + amount),
        ("Parameters", "<parameter id=\"k\" value=\"0.4\"/>".into()),
        ("Reactions", called.to_string() + &reaction("decay", "C", "", "(times k C)")),
    ]);
    let (desk, found) = imported(Problem {
        sbml: &model,
        conditions: "conditionId\nonly\n",
        observables: "observableId,observableFormula,noiseFormula\ny,in,0.1\nz,C,0.1\n",
        measurements: "observableId,simulationConditionId,time,measurement\ny,only,2,5\nz,only,2,1.3\n",
        parameters: "parameterId,parameterScale,lowerBound,upperBound,nominalValue,estimate\nk,lin,0,10,0.4,1\n",
    });
    let left = (-0.8f64).exp();
    let wanted = normal(5.0 - (1.0 + 2.0 * 2.0 * (1.0 - left) / 0.5), 0.1) + normal(1.3 - 3.0 * left, 0.1);
    near(found, wanted);
    assert!(desk.text("p/IMPORT.md").contains("| `in` | `in_` |"));
}

#[test]
fn an_sbml_model_alone_is_read() {
    let desk = Desk::new();
    desk.write("m.xml", conversion());
    desk.good("import m.xml -o m");
    desk.good("check m/model.fdm");
    assert_eq!(desk.names("m"), ["IMPORT.md", "model.fdm"]);
}

#[test]
fn what_is_not_there_is_refused_in_words() {
    let good = Problem {
        sbml: &conversion(),
        conditions: "conditionId\nc\n",
        observables: "observableId,observableFormula,noiseFormula\ny,B,0.1\n",
        measurements: "observableId,simulationConditionId,time,measurement\ny,c,1,1\n",
        parameters: RATES,
    };
    imported(good);
    let event = conversion().replace("</model>", "<listOfEvents><event id=\"dose\"/></listOfEvents></model>");
    let floor = conversion().replace("<ci>k1</ci>", "<apply><floor/><ci>k1</ci></apply>");
    let deep = format!("{}{}", "<a>".repeat(50_000), "</a>".repeat(50_000));
    let unknown = conversion().replace("<ci>k1</ci>", "<ci>k7</ci>");
    let cases = [
        (Problem { sbml: &event, ..good }, "event `dose`: it has no trigger"),
        (Problem { sbml: &floor, ..good }, "reaction `f`: `floor` of 1 operands has no counterpart"),
        (Problem { sbml: &unknown, ..good }, "`k7`, which `reactions` needs, has no value"),
        (Problem { sbml: "<sbml", ..good }, "model.xml: it is not XML"),
        (Problem { sbml: &deep, ..good }, "model.xml: it is not"),
        (Problem { conditions: "condition\nc\n", ..good }, "conditions.tsv: there is no column `conditionId`"),
        (
            Problem { conditions: "conditionId,k1\nc,B +\n", ..good },
            "conditions.tsv, line 2, column k1: `B +`: a number, a name or `(` is expected at character 4",
        ),
        (
            Problem { conditions: "conditionId\nd\n", ..good },
            "measurements.tsv, line 2, column simulationConditionId: there is no condition `c`",
        ),
        (
            Problem {
                observables: "observableId,observableFormula,noiseFormula,noiseDistribution\ny,B,0.1,laplace\n",
                ..good
            },
            "observables.tsv, line 2, column noiseDistribution: noise of the distribution `laplace` is not estimated",
        ),
        (
            Problem { observables: "observableId,observableFormula,noiseFormula\ny,B +,0.1\n", ..good },
            "observables.tsv, line 2, column observableFormula: `B +`: a number, a name or `(` is expected at character 4",
        ),
        (
            Problem {
                observables: "observableId,observableFormula,noiseFormula\ny,observableParameter1_y*B,0.1\n",
                ..good
            },
            "column observableParameters: 1 values are needed for its observable, 0 are given",
        ),
        (
            Problem { measurements: "observableId,simulationConditionId,time,measurement\ny,c,-1,1\n", ..good },
            "measurements.tsv, line 2, column time: a time must be 0 or later",
        ),
        (
            Problem {
                parameters: "parameterId,parameterScale,lowerBound,upperBound,nominalValue,estimate\nk1,log2,1,2,1,1\n",
                ..good
            },
            "parameters.tsv, line 2, column parameterScale: `log2` is not known",
        ),
    ];
    for (problem, said) in cases {
        let desk = written(problem);
        let found = desk.refused("import problem.yaml -o p");
        assert!(found.contains(said), "{said}\nin\n{found}");
        assert!(!desk.path("p").exists());
    }
    let desk = written(good);
    desk.write("problem.yaml", YAML.replace("format_version: 1", "format_version: 3.0.0"));
    assert!(
        desk.refused("import problem.yaml -o p").contains("format_version 3.0.0 is not read; versions 1 and 2 are")
    );
    desk.write("problem.yaml", "[");
    desk.refused("import problem.yaml -o p");
    assert!(desk.refused("import nothing.txt -o p").contains("a PEtab problem ends with .yaml"));
}

/// A ball of SBML: an event turns its speed round.
#[test]
fn events_of_sbml_become_events() {
    let rule = |id: &str, math: &str| format!("<rateRule variable=\"{id}\">{}</rateRule>", mathml(math));
    let parameter = |id: &str, value: &str| format!("<parameter id=\"{id}\" value=\"{value}\" constant=\"false\"/>");
    let trigger = format!("<trigger initialValue=\"true\" persistent=\"true\">{}</trigger>", mathml("(lt x 0)"));
    let sets = |id: &str, math: &str| format!("<eventAssignment variable=\"{id}\">{}</eventAssignment>", mathml(math));
    let event = format!(
        "<event id=\"bounce\" useValuesFromTriggerTime=\"true\">{trigger}<listOfEventAssignments>{}{}</listOfEventAssignments></event>",
        sets("v", "(minus (times e v))"),
        sets("count", "(plus count 1)")
    );
    let parameters = [("x", "2"), ("v", "0"), ("count", "0"), ("e", "0.8"), ("g", "9.81")];
    let parameters: String = parameters.iter().map(|(id, value)| parameter(id, value)).collect();
    let text = sbml(&[
        ("Parameters", parameters),
        ("Rules", rule("x", "v") + &rule("v", "(minus g)")),
        ("Events", event.clone()),
    ]);
    let desk = Desk::with([("ball.xml", text.clone())]);
    desk.good("import ball.xml -o p");
    let model = desk.text("p/model.fdm");
    assert!(model.contains("when x < 0 { v = -(e*v); count = count + 1; }"), "{model}");
    assert!(model.contains("der(count) = 0;"), "{model}");
    desk.write("times.csv", "time\n0\n1\n1.5\n");
    let table = desk.good("simulate p/model.fdm --data times.csv");
    let last: Vec<f64> = table.lines().last().unwrap().split(',').map(|c| c.parse().unwrap()).collect();
    let (hit, v) = ((4.0_f64 / 9.81).sqrt(), 0.8 * (4.0_f64 * 9.81).sqrt());
    let since = 1.5 - hit;
    assert!((last[1] - (v * since - 0.5 * 9.81 * since * since)).abs() < 1e-8 && last[3] == 1.0, "{table}");
    // what is not read
    let delayed =
        text.replace("<listOfEventAssignments>", &format!("<delay>{}</delay><listOfEventAssignments>", mathml("1")));
    desk.write("late.xml", delayed);
    assert!(desk.refused("import late.xml -o q").contains("after a delay is not read"));
    desk.write("early.xml", text.replace("initialValue=\"true\"", "initialValue=\"false\""));
    assert!(desk.refused("import early.xml -o q").contains("counts as false"));
}

/// A model with its records, which is written as a problem and read again.
#[derive(Clone)]
struct There<'a> {
    model: &'a str,
    /// Of each run its name, what stands in the table of runs behind it, and its record.
    runs: Vec<(&'a str, &'a str, String)>,
    /// Header of that table behind `file,run`.
    brought: &'a str,
    /// Options of the fit.
    options: &'a str,
}

/// Draws between -0.5 and 0.5.
type Draws<'a> = dyn FnMut() -> f64 + 'a;

/// Numbers of a record: `of` makes a row out of a time and draws of a noise.
fn recorded(header: &str, interval: f64, of: &mut dyn FnMut(f64, &mut Draws<'_>) -> Vec<f64>) -> String {
    let mut state = 11_u32;
    let mut noise = move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(state) / f64::from(u32::MAX) - 0.5
    };
    let mut text = format!("time,{header}\n");
    for k in 0..40 {
        let t = interval * f64::from(k);
        let row: Vec<String> =
            of(t, &mut noise).iter().map(|v| if v.is_nan() { String::new() } else { format!("{v:?}") }).collect();
        writeln!(text, "{t:?},{}", row.join(",")).unwrap();
    }
    text
}

/// Log-likelihood of the model as it was judged, and of the problem that was written and read again.
fn there_and_back(there: &There<'_>) -> [f64; 2] {
    let desk = Desk::with([("model.fdm", there.model)]);
    let mut table = format!("file,run{}\n", there.brought);
    for (name, brought, record) in &there.runs {
        desk.write(&format!("{name}.csv"), record);
        writeln!(table, "{name}.csv,{name}{brought}").unwrap();
    }
    desk.write("runs.csv", table);
    let judged = |done: &std::process::Output| -> f64 {
        let result: Value = serde_json::from_slice(&done.stdout).unwrap_or_else(|_| panic!("{}", said(done)));
        result["log_likelihood"].as_f64().unwrap_or_else(|| panic!("{result}"))
    };
    let exact = "--integration-accuracy 1e-11 --json -q";
    let before = judged(&desk.fdm(&format!("fit model.fdm --runs runs.csv {} {exact} --out r", there.options)));
    desk.good("export --from-result r --to petab -o problem");
    assert!(desk.refused("export --from-result r --to petab -o problem").contains("problem"));
    let yaml = desk.names("problem").into_iter().find(|name| name.ends_with(".yaml")).unwrap();
    desk.good(&format!("import problem/{yaml} -o back"));
    let again = desk.command(&format!("fit --iterations 0 {exact}")).current_dir(desk.path("back")).output().unwrap();
    [before, judged(&again)]
}

/// Noise that is open, a number, an expression; values that runs bring or have of their own; inputs of steps and of slopes; a log scale, priors,
/// free initial values; events; a fit that has converged, and values where none has begun.
#[test]
fn problems_that_are_written_have_the_likelihood_of_their_result() {
    let tank = recorded("u,xm,zm", 0.1, &mut |t, noise| {
        let u = if t < 1.45 { 1.1 } else { 0.2 };
        vec![u, 1.0 - (-t).exp() + 0.03 * noise(), 0.3 * t / (1.0 + t) + 0.2 + 0.02 * noise()]
    });
    let other = recorded("u,xm,zm", 0.1, &mut |t, noise| {
        let u = if t < 0.95 { 0.4 } else { 0.7 };
        vec![
            u,
            0.8 - 0.5 * (-t).exp() + 0.03 * noise(),
            if t > 3.0 { f64::NAN } else { 0.2 + 0.05 * t + 0.02 * noise() },
        ]
    });
    let tanks = There {
        model: "model tank {
            input u; known T0 per run; state x = free; state z = z0;
            param k = 0.5 in [0.01, 10] log, g = 0.3 in [0, 2], z0 = 0.2, b = 0 per run; prior g ~ normal(0.3, 0.2);
            der(x) = u - k*x*sqrt(x^2 + 0.1) + 0.05*sin(t)*T0; der(z) = g*x - z;
            output xm = x + b, zm = sqrt(z^2 + 0.01); noise zm = 0.02 + 0.05*abs(z); }",
        runs: vec![("one", ",0.4", tank), ("two", ",0.6", other)],
        brought: ",T0",
        options: "--zoh u --iterations 0",
    };
    let ball = There {
        model: "model ball {
            state h = 1, v = 0; param g = 9.6 in [5, 15], c = 0.72 in [0.1, 1];
            der(h) = v; der(v) = -g - 0.1*v;
            when h < 0 { v = -c*v; }
            output hm = h, vm = v; }",
        runs: vec![(
            "drop",
            "",
            recorded("hm,vm", 0.025, &mut |t, noise| {
                // one bounce at sqrt(2/9.81)
                let (hit, v) = (0.4515, 4.429);
                let since = t - hit;
                let (h, w) = if t < hit {
                    (1.0 - 4.905 * t * t, -9.81 * t)
                } else {
                    (0.75 * v * since - 4.905 * since * since, 0.75 * v - 9.81 * since)
                };
                vec![h + 0.02 * noise(), w + 0.1 * noise()]
            }),
        )],
        brought: "",
        options: "--iterations 0",
    };
    let spring = There {
        model: "model spring {
            input f; state x = 0, v = 0; param k = 4 in [1, 10], d = 0.5 in [0, 3], m = 1 fixed;
            der(x) = v; der(v) = (f - k*x - d*v - 0.2*max(v, -5)*x + 0.1*sign(f)*min(x, 1))/m;
            output xm = x, am = atan(v) + hypot(x, 1); noise xm = 0.02; }",
        runs: vec![(
            "push",
            "",
            recorded("f,xm,am", 0.1, &mut |t, noise| {
                let f = 0.1 + (2.0 * t).min(1.0) - (t - 2.0).clamp(0.0, 0.5);
                vec![f, 0.2 * (1.0 - (-t).exp() * (2.0 * t).cos()) + 0.02 * noise(), 1.1 + 0.1 * noise()]
            }),
        )],
        brought: "",
        options: "--iterations 0",
    };
    let decay = There {
        model: "model decay {
            state a = a0, b = 0; param a0 = 2 in [0.1, 10] log, k1 = 0.8 in [0.01, 10] log, k2 = 0.3 in [0.01, 10] log, s = 0.05 in [0.001, 1] log;
            der(a) = -k1*a; der(b) = k1*a - k2*b;
            output am = log(a + 0.01), bm = b; noise bm = s*(0.2 + b); }",
        runs: vec![(
            "batch",
            "",
            recorded("am,bm", 0.15, &mut |t, noise| {
                let (a, b) = (2.2 * (-0.9 * t).exp(), 2.2 * 0.9 / 0.5 * ((-0.4 * t).exp() - (-0.9 * t).exp()));
                vec![(a + 0.01).ln() + 0.05 * noise(), b + 0.1 * noise() * (0.2 + b)]
            }),
        )],
        brought: "",
        options: "--iterations 0",
    };
    let fitted = There {
        model: &decay.model.replace(" noise bm = s*(0.2 + b);", "").replace(", s = 0.05 in [0.001, 1] log", ""),
        options: "",
        ..decay.clone()
    };
    for (name, there) in
        [("tanks", tanks), ("ball", ball), ("spring", spring), ("decay", decay), ("fitted decay", fitted)]
    {
        let [before, after] = there_and_back(&there);
        println!("{name}: {before} and {after}");
        assert!((before - after).abs() < 1e-6, "{name}: {before} {after}");
    }
}

#[test]
fn what_has_no_place_in_a_problem_is_said() {
    let desk = Desk::with([
        (
            "late.fdm",
            "model late { input u; state x = 0; param tau = 0.1 in [0, 1]; der(x) = delay(u, tau) - x; output xm = x; }",
        ),
        ("run.csv", "time,u,xm\n0,0,0\n1,1,0.2\n2,1,0.5\n3,1,0.6\n"),
    ]);
    desk.fdm("fit late.fdm --data run.csv --iterations 1 --out late");
    assert!(desk.refused("export --from-result late --to petab -o q").contains("delays `u`"));
    assert!(desk.refused("export late.fdm --to petab -o q").contains("--from-result"));
    assert!(desk.refused("export --from-result late --to petab").contains("-o DIR"));
    desk.write(
        "plain.fdm",
        "model plain { input u; state x = 0; param k = 1; der(x) = u - k*x; output xm = x, ym = 2*x; }",
    );
    let both = recorded("u,xm,ym", 0.2, &mut |t, noise| {
        vec![1.0, 1.0 - (-t).exp() + 0.05 * noise(), 2.0 - 2.0 * (-t).exp() + 0.1 * noise()]
    });
    desk.write("both.csv", both);
    desk.fdm("fit plain.fdm --data both.csv --iterations 1 --noise full --out full");
    assert!(desk.refused("export --from-result full --to petab -o q").contains("correlated"));
    desk.fdm("fit plain.fdm --data both.csv --loss huber --out huber");
    assert!(desk.refused("export --from-result huber --to petab -o q").contains("--loss"));
    assert!(!desk.path("q").exists());
}

/// Version 2: conditions in long form, an experiment whose values change in its middle, placeholders, log-normal noise.
#[test]
fn a_problem_of_version_two_is_read() {
    let yaml = "format_version: 2.0.0
model_files: {m: {location: model.xml, language: sbml}}
parameter_files: [parameters.tsv]
condition_files: [conditions.tsv]
experiment_files: [experiments.tsv]
observable_files: [observables.tsv]
measurement_files: [measurements.tsv]
";
    let decay = sbml(&[
        ("Parameters", "<parameter id=\"k\" value=\"1\"/><parameter id=\"f\" value=\"1\"/><parameter id=\"A\" value=\"1\" constant=\"false\"/>".into()),
        ("Rules", format!("<rateRule variable=\"A\">{}</rateRule>", mathml("(minus (times f (times k A)))"))),
    ]);
    let tabs = |text: &str| text.replace(',', "\t");
    let desk = Desk::with([
        ("p.yaml", yaml.to_string()),
        ("model.xml", decay),
        (
            "parameters.tsv",
            tabs(
                "parameterId,lowerBound,upperBound,nominalValue,estimate\nk,0,10,0.5,true\nk_b,0,10,0.7,true\ns,0.01,1,0.1,true\ndose,0,10,2,false\n",
            ),
        ),
        (
            "conditions.tsv",
            tabs("conditionId,targetId,targetValue\nfirst,A,2*dose\nfirst,f,k_b/2\nmore,A,A + dose\nmore,f,3\n"),
        ),
        ("experiments.tsv", tabs("experimentId,time,conditionId\nplain,0,first\nchanged,0,first\nchanged,1.5,more\n")),
        (
            "observables.tsv",
            tabs(
                "observableId,observableFormula,noiseFormula,noiseDistribution,observablePlaceholders,noisePlaceholders\na,scale*A,sd,log-normal,scale,sd\n",
            ),
        ),
        (
            "measurements.tsv",
            tabs(
                "observableId,experimentId,time,measurement,observableParameters,noiseParameters\na,plain,1,3.1,1,s\na,plain,2,2.4,1,s\na,changed,1.5,5,1,s\na,changed,2,2,1.1,s\n",
            ),
        ),
    ]);
    desk.good("import p.yaml -o p");
    // the closed form; a sample at the change shows what stands behind it
    let (rate, jump) = (0.35 * 0.5_f64, 4.0 * (-0.35 * 0.5 * 1.5_f64).exp() + 2.0);
    let predicted = [4.0 * (-rate).exp(), 4.0 * (-2.0 * rate).exp(), jump, 1.1 * jump * (-1.5 * 0.5_f64).exp()];
    let log_likelihood: f64 = [3.1_f64, 2.4, 5.0, 2.0]
        .iter()
        .zip(predicted)
        .map(|(m, p)| -0.5 * ((m.ln() - p.ln()) / 0.1).powi(2) - (0.1 * m * (2.0 * std::f64::consts::PI).sqrt()).ln())
        .sum();
    near(likelihood(&desk), log_likelihood);
    desk.write("experiments.tsv", tabs("experimentId,time,conditionId\nplain,3,first\nchanged,0,none\n"));
    let said = desk.refused("import p.yaml -o q");
    assert!(said.contains("begins at 3") && said.contains("no condition `none`"), "{said}");
    desk.write("p.yaml", "format_version: 2.0.0\nmodel_files: {m: [a\n");
    let said = desk.refused("import p.yaml -o q");
    assert_eq!(said.matches("error:").count(), 1, "{said}");
}
