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

/// Times of a table, as `fdm simulate` takes them.
fn times(all: &[f64]) -> String {
    let rows: String = all.iter().map(|t| format!("{t:?}\n")).collect();
    format!("time\n{rows}")
}

/// A model of SBML alone, simulated: the columns that are asked for, each at all times.
#[track_caller]
fn responses<const N: usize>(model: &str, at: &[f64], columns: [&str; N]) -> [Vec<f64>; N] {
    let desk = Desk::with([("m.xml", model.to_string()), ("times.csv", times(at))]);
    desk.good("import m.xml -o m");
    let table = desk.good("simulate m/model.fdm --data times.csv");
    let mut rows = table.lines().map(|l| l.split(',').collect::<Vec<_>>());
    let header = rows.next().unwrap();
    let rows: Vec<Vec<&str>> = rows.collect();
    columns.map(|name| {
        let place = header.iter().position(|h| *h == name).unwrap_or_else(|| panic!("{name} in {table}"));
        rows.iter().map(|row| row[place].parse().unwrap()).collect()
    })
}

#[track_caller]
fn all_near(found: &[f64], wanted: impl IntoIterator<Item = f64>) {
    let wanted: Vec<f64> = wanted.into_iter().collect();
    assert_eq!(found.len(), wanted.len());
    for (f, w) in found.iter().zip(&wanted) {
        assert!((f - w).abs() < 1e-6 * (1.0 + w.abs()), "{found:?} for {wanted:?}");
    }
}

const AT: [f64; 5] = [0.0, 2.0, 4.0, 6.0, 8.0];

/// A clamped species, set from 1 to 3 by an event.
#[test]
fn a_boundary_species_that_an_event_sets_is_not_consumed() {
    let trigger = format!("<trigger initialValue=\"true\" persistent=\"true\">{}</trigger>", mathml("(gt time 4)"));
    let sets = format!("<eventAssignment variable=\"G\">{}</eventAssignment>", mathml("3"));
    let up = format!("<event id=\"up\">{trigger}<listOfEventAssignments>{sets}</listOfEventAssignments></event>");
    let clamped = species("G", "V", 1.0).replace("/>", " boundaryCondition=\"true\"/>");
    let model = sbml(&[
        ("Compartments", "<compartment id=\"V\" size=\"1\"/>".into()),
        ("Species", clamped + &species("P", "V", 0.0)),
        ("Parameters", "<parameter id=\"k\" value=\"0.5\"/>".into()),
        ("Reactions", reaction("r", "G", "P", "(times k G V)")),
        ("Events", up),
    ]);
    let [g, p] = responses(&model, &AT, ["G_m", "P_m"]);
    all_near(&g, [1.0, 1.0, 1.0, 3.0, 3.0]);
    all_near(&p, [0.0, 1.0, 2.0, 5.0, 8.0]);
}

/// A decays at 0.5 and makes P; what stands in `lists` says how much of it.
fn yielding(reference: &str, lists: &[(&str, String)]) -> String {
    let made = reaction("r", "A", "P", "(times k A V)")
        .replace("species=\"P\" stoichiometry=\"1\"", &format!("species=\"P\" {reference}"));
    let mut all = vec![
        ("Compartments", "<compartment id=\"V\" size=\"1\"/>".to_string()),
        ("Species", species("A", "V", 1.0) + &species("P", "V", 0.0)),
        ("Parameters", "<parameter id=\"k\" value=\"0.5\"/><parameter id=\"f\" value=\"4\"/>".into()),
    ];
    all.extend(lists.iter().cloned());
    all.push(("Reactions", made));
    sbml(&all)
}

#[test]
fn what_sets_a_stoichiometry_counts() {
    let set = |kind: &str, what: &str, math: &str| format!("<{kind} {what}=\"y\">{}</{kind}>", mathml(math));
    let decay = |t: f64| (-0.5 * t).exp();
    let y = "id=\"y\" stoichiometry=\"1\"";
    // the attribute where nothing sets it, though it has a name
    let [p] = responses(&yielding(y, &[]), &AT, ["P_m"]);
    all_near(&p, AT.map(|t| 1.0 - decay(t)));
    let begins = yielding(y, &[("InitialAssignments", set("initialAssignment", "symbol", "k"))]);
    let [p] = responses(&begins, &AT, ["P_m"]);
    all_near(&p, AT.map(|t| 0.5 * (1.0 - decay(t))));
    // P' = 2 A k A
    let ruled = yielding(y, &[("Rules", set("assignmentRule", "variable", "(times 2 A)"))]);
    let [p, shown] = responses(&ruled, &AT, ["P_m", "y_m"]);
    all_near(&p, AT.map(|t| 1.0 - decay(t).powi(2)));
    all_near(&shown, AT.map(|t| 2.0 * decay(t)));
    // y' = 1 from 1: P' = (1 + t) k A
    let grows = yielding(y, &[("Rules", set("rateRule", "variable", "1"))]);
    let [p] = responses(&grows, &AT, ["P_m"]);
    all_near(&p, AT.map(|t| 3.0 - (3.0 + t) * decay(t)));
    // from 1 to 3 behind 2
    let trigger = format!("<trigger>{}</trigger>", mathml("(gt time 2)"));
    let sets = format!("<listOfEventAssignments>{}</listOfEventAssignments>", set("eventAssignment", "variable", "3"));
    let jumps = yielding(y, &[("Events", format!("<event>{trigger}{sets}</event>"))]);
    let [p] = responses(&jumps, &AT, ["P_m"]);
    all_near(&p, AT.map(|t| 1.0 - decay(t.min(2.0)) + 3.0 * (decay(2.0) - decay(t.max(2.0)))));
    // a conversion factor of the model
    let converted = yielding(y, &[]).replace("<model id=\"m\"", "<model id=\"m\" conversionFactor=\"f\"");
    let [a, p] = responses(&converted, &AT, ["A_m", "P_m"]);
    all_near(&a, AT.map(|t| (-2.0 * t).exp()));
    all_near(&p, AT.map(|t| 1.0 - (-2.0 * t).exp()));
    // a formula of level 2
    let formula = format!("<stoichiometryMath>{}</stoichiometryMath></speciesReference>", mathml("(divide f 8)"));
    let inside = yielding("", &[])
        .replace("level3/version1/core", "level2/version4")
        .replace("level=\"3\" version=\"1\"", "level=\"2\" version=\"4\"");
    let inside = inside.replace("<speciesReference species=\"P\" />", "<speciesReference species=\"P\"/>");
    let inside =
        inside.replace("<speciesReference species=\"P\"/>", &format!("<speciesReference species=\"P\">{formula}"));
    let [p] = responses(&inside, &AT, ["P_m"]);
    all_near(&p, AT.map(|t| 0.5 * (1.0 - decay(t))));
    // level 3 means no number where none stands
    let desk = Desk::with([("m.xml", yielding("id=\"y\"", &[]))]);
    assert!(desk.refused("import m.xml -o m").contains("the stoichiometry of `P` has no value"));
}

/// Parameters with rates and events, and what they come to.
#[test]
fn events_at_the_beginning_and_at_one_instant() {
    let event = |attributes: &str, trigger: &str, priority: &str, sets: &[(&str, &str)]| {
        let sets: String = sets
            .iter()
            .map(|(id, math)| format!("<eventAssignment variable=\"{id}\">{}</eventAssignment>", mathml(math)))
            .collect();
        let priority = match priority {
            "" => String::new(),
            math => format!("<priority>{}</priority>", mathml(math)),
        };
        format!(
            "<event><trigger {attributes}>{}</trigger>{priority}<listOfEventAssignments>{sets}</listOfEventAssignments></event>",
            mathml(trigger)
        )
    };
    let model = |events: &str| {
        let rules = format!("<rateRule variable=\"x\">{}</rateRule>", mathml("1"));
        let parameter = |id: &str, v: f64| format!("<parameter id=\"{id}\" value=\"{v}\" constant=\"false\"/>");
        sbml(&[
            ("Parameters", parameter("x", 1.0) + &parameter("y", 2.0) + &parameter("z", 0.0)),
            ("Rules", rules),
            ("Events", events.into()),
        ])
    };
    let late = "initialValue=\"false\" persistent=\"true\"";
    let plain = "initialValue=\"true\" persistent=\"true\"";
    // true at the beginning: it happens where it counts as false before, and not otherwise
    for (attributes, x) in [(late, 6.0), (plain, 1.0)] {
        let text = model(&event(attributes, "(gt y x)", "", &[("x", "(plus x 5)")]));
        let [found] = responses(&text, &[0.0, 0.5], ["x_m"]);
        all_near(&found, [x, x + 0.5]);
    }
    // both at one instant: the values of before, the greater priority first and so the smaller one last
    let both = |first: &str, second: &str| {
        event(plain, "(geq x 3)", first, &[("y", "7"), ("z", "(plus y 1)")])
            + &event(plain, "(gt x 3)", second, &[("y", "(plus y 3)")])
    };
    for (first, second, y) in [("1", "2", 7.0), ("2", "1", 5.0)] {
        let [found, z] = responses(&model(&both(first, second)), &[0.0, 3.0], ["y_m", "z_m"]);
        all_near(&found, [2.0, y]);
        all_near(&z, [0.0, 3.0]);
    }
    let parted = event(plain, "(gt x 3)", "", &[("y", "7")]) + &event(plain, "(gt x 3)", "", &[("z", "(plus y 1)")]);
    let [z] = responses(&model(&parted), &[0.0, 3.0], ["z_m"]);
    all_near(&z, [0.0, 3.0]);
    // at the threshold when it begins; what never becomes true again is left out
    let clock = event(plain, "(geq time 0)", "", &[("y", "9")]);
    let [y] = responses(&model(&clock), &[0.0, 1.0], ["y_m"]);
    all_near(&y, [2.0, 2.0]);
    for (events, said) in [
        (both("", ""), "both set `y`: give them priorities"),
        (both("1", "y"), "both set `y`: give them priorities"),
        (both("1", "1"), "both set `y`: give them priorities"),
        (event(plain, "(geq x 1)", "", &[("y", "9")]), "are equal at the beginning"),
        (
            both("1", "2").replace("persistent=\"true\"", "persistent=\"false\"").replace("\"y\">", "\"x\">"),
            "is not persistent",
        ),
        (event(plain, "(gt x 3)", "", &[("nobody", "9")]), "`eventAssignment` of `nobody`: there is no"),
        (
            event(late, "(gt x 3)", "", &[("y", "9")]) + &event(plain, "(gt y 8)", "", &[("z", "9")]),
            "at the very beginning",
        ),
    ] {
        let desk = Desk::with([("m.xml", model(&events))]);
        let found = desk.refused("import m.xml -o m");
        assert!(found.contains(said), "{said} in {found}");
    }
}

/// What stands still in a vessel that grows, rates that are asked for, and what delays see before the beginning.
#[test]
fn dilution_rates_and_delays_mean_what_sbml_says() {
    let symbol = |name: &str, arguments: &str| {
        format!(
            "<math xmlns=\"http://www.w3.org/1998/Math/MathML\"><apply><csymbol definitionURL=\"http://www.sbml.org/sbml/symbols/{name}\">{name}</csymbol>{arguments}</apply></math>"
        )
    };
    let rule = |kind: &str, id: &str, math: &str| format!("<{kind} variable=\"{id}\">{math}</{kind}>");
    let parameter = |id: &str| format!("<parameter id=\"{id}\" constant=\"false\"/>");
    let later =
        symbol("delay", "<csymbol definitionURL=\"http://www.sbml.org/sbml/symbols/time\">t</csymbol><cn>3</cn>");
    let model = sbml(&[
        ("Compartments", "<compartment id=\"V\" size=\"2\" constant=\"false\"/>".into()),
        ("Species", species("S", "V", 3.0)),
        ("Parameters", parameter("speed") + &parameter("ago")),
        (
            "Rules",
            rule("rateRule", "V", &mathml("1"))
                + &rule("assignmentRule", "speed", &symbol("rateOf", "<ci>S</ci>"))
                + &rule("assignmentRule", "ago", &later),
        ),
    ]);
    let [s, speed, ago] = responses(&model, &AT, ["S_m", "speed_m", "ago_m"]);
    all_near(&s, AT.map(|t| 6.0 / (2.0 + t)));
    all_near(&speed, AT.map(|t| -6.0 / (2.0 + t).powi(2)));
    all_near(&ago, AT.map(|t| t - 3.0));
    // an event halves the vessel: amounts stay; then a concentration is set by what it is just before
    let event = |at: &str, id: &str, math: &str| {
        let trigger = mathml(&format!("(gt time {at})"));
        let sets = mathml(math);
        format!(
            "<event><trigger>{trigger}</trigger><listOfEventAssignments><eventAssignment variable=\"{id}\">{sets}</eventAssignment></listOfEventAssignments></event>"
        )
    };
    let halved = sbml(&[
        ("Compartments", "<compartment id=\"V\" size=\"2\" constant=\"false\"/>".into()),
        ("Species", species("S", "V", 3.0) + &species("B", "V", 1.0)),
        ("Parameters", "<parameter id=\"k\" value=\"0.5\"/>".into()),
        ("Reactions", reaction("r", "B", "", "(times k B V)")),
        ("Events", event("3", "V", "1") + &event("5", "B", "7")),
    ]);
    let [s, b] = responses(&halved, &AT, ["S_m", "B_m"]);
    all_near(&s, [3.0, 3.0, 6.0, 6.0, 6.0]);
    let decay = |t: f64| (-0.5 * t).exp();
    all_near(&b, [1.0, decay(2.0), 2.0 * decay(4.0), 7.0 * decay(1.0), 7.0 * decay(3.0)]);
    // a local parameter whose long name is taken already
    let law = format!(
        "<kineticLaw>{}<listOfLocalParameters><localParameter id=\"k\" value=\"0.5\"/></listOfLocalParameters></kineticLaw>",
        mathml("(times k A V)")
    );
    let own = format!(
        "<reaction id=\"r\"><listOfReactants><speciesReference species=\"A\" stoichiometry=\"1\"/></listOfReactants>{law}</reaction>"
    );
    let shadowed = sbml(&[
        ("Compartments", "<compartment id=\"V\" size=\"1\"/>".into()),
        ("Species", species("A", "V", 1.0)),
        ("Parameters", "<parameter id=\"k\" value=\"7\"/><parameter id=\"r_k\" value=\"9\"/>".into()),
        ("Reactions", own),
    ]);
    let [a] = responses(&shadowed, &AT, ["A_m"]);
    all_near(&a, AT.map(|t| (-0.5 * t).exp()));
    // what a language has that is no part of core
    let packaged = shadowed.replace(
        "<sbml ",
        "<sbml xmlns:comp=\"http://www.sbml.org/sbml/level3/version1/comp/version1\" comp:required=\"true\" ",
    );
    let strange = shadowed.replace("</model>", "<listOfWonders/></model>");
    let twice = shadowed.replace("<parameter id=\"k\"", "<parameter id=\"A\"");
    let algebraic =
        shadowed.replace("<listOfReactions>", "<listOfRules><algebraicRule/></listOfRules><listOfReactions>");
    for (text, said) in [
        (packaged, "comp/version1 changes what the model means"),
        (strange, "`listOfWonders` is not known"),
        (twice, "`A` is declared twice"),
        (algebraic, "solve it for one of its names"),
    ] {
        let desk = Desk::with([("m.xml", text)]);
        let found = desk.refused("import m.xml -o m");
        assert!(found.contains(said), "{said} in {found}");
    }
}

/// Whatever operation on files is the last: the folder is there whole or not at all.
#[test]
fn a_folder_of_an_import_is_whole_or_not_there() {
    let desk = Desk::new();
    let place = repository().join("models/petab/conversion/conversion.yaml");
    let words = |out: &str| format!("import {} -o {out}", place.display());
    desk.good(&words("whole"));
    desk.command("fit --iterations 0 -q --out ../r").current_dir(desk.path("whole")).output().unwrap();
    desk.good("export --from-result r --to petab -o written");
    for (whole, line) in [("whole", words("p")), ("written", "export --from-result r --to petab -o p".to_string())] {
        let tree = |folder: &str| -> Vec<String> {
            let names = desk.names(folder);
            let inner = |n: &String| match desk.path(&format!("{folder}/{n}")).is_dir() {
                true => desk.names(&format!("{folder}/{n}")),
                false => vec![desk.text(&format!("{folder}/{n}"))],
            };
            names.iter().flat_map(|n| [vec![n.clone()], inner(n)].concat()).collect()
        };
        let mut count = 0;
        for kind in ["dies:nothing", "dies:torn", "nothing"] {
            for n in 0.. {
                let failed = desk.command(&line).env("FDM_FAULT", format!("{kind}:{n}")).output().unwrap();
                if desk.path("p").exists() {
                    assert_eq!(tree("p"), tree(whole), "{line}: {kind} at operation {n}: {}", said(&failed));
                    std::fs::remove_dir_all(desk.path("p")).unwrap();
                }
                count += 1;
                if !said(&failed).contains("fault at operation") {
                    break;
                }
            }
        }
        assert!(count > 20, "{line}: {count}");
        desk.good(&line);
        std::fs::remove_dir_all(desk.path("p")).unwrap();
    }
    assert_eq!(desk.names(""), ["r", "whole", "written"], "nothing is left of what was interrupted");
}
