//! The certified nonlinear regressions of NIST StRD: every problem from both starts, with the tool's default options.

use fdm::Model;
use fdm::estimate::{Changes, Fit, FitOptions, Work, fit};
use fdm::record::{ReadOptions, channels, read};
use std::path::PathBuf;

/// Digits to which the certified values are known.
const CERTIFIED: f64 = 11.0;

/// A parameter of a problem.
#[derive(Debug, Clone)]
struct Certified {
    name: String,
    starts: [f64; 2],
    value: f64,
    deviation: f64,
}

/// A problem: its parameters, and the certified standard deviation of the residuals.
#[derive(Debug, Clone)]
struct Problem {
    name: String,
    level: String,
    parameters: Vec<Certified>,
    deviation: f64,
}

fn folder() -> PathBuf {
    support::repository().join("models/nist_strd")
}

fn problems() -> Vec<Problem> {
    let table = std::fs::read_to_string(folder().join("certified.csv")).unwrap();
    let mut problems: Vec<Problem> = Vec::new();
    for row in table.lines().skip(1) {
        let cells: Vec<&str> = row.split(',').collect();
        let number = |k: usize| cells[k].parse::<f64>().unwrap();
        if problems.last().is_none_or(|p| p.name != cells[0]) {
            let (name, level) = (cells[0].to_string(), cells[5].split(' ').next().unwrap().to_string());
            problems.push(Problem { name, level, parameters: Vec::new(), deviation: number(4) });
        }
        let parameter = Certified {
            name: cells[6].into(),
            starts: [number(7), number(8)],
            value: number(9),
            deviation: number(10),
        };
        problems.last_mut().unwrap().parameters.push(parameter);
    }
    problems
}

impl Problem {
    fn fit(&self, start: usize) -> Fit {
        let model = Model::from_file(folder().join(format!("{}.fdm", self.name))).unwrap();
        let record = folder().join(format!("{}.csv", self.name));
        let (run, _) = read(&record, &channels(model.definition()), &ReadOptions::default()).unwrap();
        let set = self.parameters.iter().map(|p| (p.name.clone(), p.starts[start])).collect();
        let options = FitOptions { changes: Changes { set, ..Changes::default() }, ..FitOptions::default() };
        fit(&model, &[run], &options, &Work::default()).unwrap()
    }

    /// Least log relative error over the parameters, between 0 and 11.
    fn digits(&self, fit: &Fit) -> f64 {
        let digits = |p: &Certified| {
            let got = fit.estimate.parameter(&p.name, None).unwrap().value;
            digits(got, p.value).min(CERTIFIED)
        };
        self.parameters.iter().map(digits).fold(CERTIFIED, f64::min)
    }

    /// The same of the standard errors and the residual deviation.
    fn digits_of_errors(&self, fit: &Fit) -> f64 {
        let error = |p: &Certified| fit.estimate.parameter(&p.name, None).unwrap().standard_error;
        let all = self.parameters.iter().map(|p| error(p).map_or(0.0, |s| digits(s, p.deviation)));
        let deviation = digits(fit.estimate.noise.as_ref().map_or(f64::NAN, |r| r.at(0, 0).sqrt()), self.deviation);
        all.chain([deviation]).fold(CERTIFIED, f64::min)
    }

    /// Digits of the residuals that are left when each is the difference of two rounded numbers.
    fn digits_of_residuals(&self, fit: &Fit) -> f64 {
        let largest = fit.estimate.runs[0].response.iter().fold(0.0_f64, |m, y| m.max(y.abs()));
        -(4.0 * f64::EPSILON * largest / self.deviation).log10()
    }
}

fn digits(got: f64, want: f64) -> f64 {
    let error = ((got - want) / want).abs();
    if error.is_nan() { 0.0 } else { -error.max(1e-300).log10() }.max(0.0)
}

#[test]
fn every_problem_from_both_starts() {
    let (mut sum, mut runs, mut failures) = (0.0, 0, Vec::new());
    println!("problem  start level   digits  of errors  corrections  evaluations  end");
    for problem in problems() {
        for start in 0..2 {
            let fit = problem.fit(start);
            let (e, digits, errors) = (&fit.estimate, problem.digits(&fit), problem.digits_of_errors(&fit));
            let refused: usize = e.history.iter().map(|i| i.refused).sum();
            println!(
                "{:9} {}    {:7} {digits:5.1}  {errors:8.1}  {:6} ({refused:3})  {:5} {:5}  {}{}",
                problem.name,
                start + 1,
                problem.level,
                e.iterations,
                e.evaluations.0,
                e.evaluations.1,
                e.termination,
                e.fallbacks.iter().map(|r| format!(", {r}")).collect::<String>()
            );
            (sum, runs) = (sum + digits, runs + 1);
            if !e.is_good() || digits < 6.0 || errors < problem.digits_of_residuals(&fit).min(6.0) {
                failures.push(format!(
                    "{} from start {}: {digits:.1} {errors:.1} {}",
                    problem.name,
                    start + 1,
                    e.termination
                ));
            }
        }
    }
    println!("average log relative error over {runs} fits: {:.2}", sum / runs as f64);
    assert_eq!(runs, 54);
    assert!(failures.is_empty(), "{failures:#?}");
    assert!(sum / runs as f64 >= 10.5, "{}", sum / runs as f64);
}
