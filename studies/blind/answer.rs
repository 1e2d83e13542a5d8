//! What the tool said: its JSON, read as the contract of the command has it.

use crate::hidden::Place;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// A cause that was named.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Named {
    pub(crate) place: Place,
    /// Its parameters by their names in the extended model.
    pub(crate) parameters: Vec<(String, f64)>,
    /// What cannot be told from it, itself included.
    pub(crate) group: Vec<Place>,
}

/// An answer of the tool.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Answer {
    pub(crate) verdict: String,
    pub(crate) p: f64,
    pub(crate) causes: Vec<Named>,
    /// Kinds (`input`, `equation`) and names of places where an unknown force enters, the likeliest first.
    pub(crate) sites: Vec<(String, String)>,
    /// It said that what it named does not explain everything.
    pub(crate) unexplained: bool,
}

const VERDICTS: [&str; 5] = ["effect_found", "disturbance", "law", "unknown_cause", "no_effect_found"];

impl Answer {
    /// Reads what was printed.
    pub(crate) fn read(text: &str) -> Result<Self, String> {
        let json: Value = serde_json::from_str(text).map_err(|e| format!("no JSON: {e}"))?;
        let verdict = json["verdict"].as_str().unwrap_or_default().to_string();
        if !VERDICTS.contains(&verdict.as_str()) {
            return Err(format!("the verdict `{verdict}`"));
        }
        let explanations = json["explanations"].as_array().ok_or("no explanations")?;
        let nothing = explanations.iter().find(|e| e["verdict"] == "no_effect_found");
        let p = nothing.and_then(|e| e["probability"].as_f64()).filter(|p| (0.0..=1.0).contains(p));
        let p = p.ok_or("no probability of nothing in [0, 1]")?;
        let causes = json["causes"].as_array().ok_or("no causes")?;
        let causes = causes.iter().map(Named::read).collect::<Result<_, _>>()?;
        json["lack_of_fit"].as_array().ok_or("no lack_of_fit")?;
        let unnamed = json["unnamed"].as_array().ok_or("no unnamed")?;
        let sites = unnamed.iter().filter_map(site).collect();
        let unexplained = unnamed.iter().any(|u| u["evidence"].as_f64().is_some_and(|e| e > 0.0));
        Ok(Self { verdict, p, causes, sites, unexplained })
    }
}

fn site(value: &Value) -> Option<(String, String)> {
    Some((value["kind"].as_str()?.to_string(), value["name"].as_str()?.to_string()))
}

impl Named {
    fn read(value: &Value) -> Result<Self, String> {
        let place = place(value)?;
        let parameters = match &value["parameters"] {
            Value::Array(list) => {
                list.iter().filter_map(|p| Some((p["name"].as_str()?.to_string(), p["value"].as_f64()?))).collect()
            }
            Value::Object(map) => map.iter().filter_map(|(n, v)| Some((n.clone(), v.as_f64()?))).collect(),
            _ => return Err("a cause without parameters".into()),
        };
        let mut group: Vec<Place> = match &value["group"] {
            Value::Array(list) => list.iter().map(self::place).collect::<Result<_, _>>()?,
            _ => return Err("a cause without its group".into()),
        };
        if !group.contains(&place) {
            group.insert(0, place.clone());
        }
        Ok(Self { place, parameters, group })
    }
}

fn place(value: &Value) -> Result<Place, String> {
    let effect = value["effect"].as_str().ok_or("a cause without effect")?.to_string();
    let targets = value["targets"].as_array().ok_or("a cause without targets")?;
    let targets = targets.iter().map(|t| t.as_str().map(String::from)).collect::<Option<Vec<_>>>();
    Ok(Place { effect, targets: targets.ok_or("a target that is no name")? })
}

/// The tool that is judged: this build's, or another's by FDM_BLIND_TOOL.
pub(crate) fn tool() -> PathBuf {
    std::env::var_os("FDM_BLIND_TOOL").map_or_else(|| support::fdm().get_program().into(), PathBuf::from)
}

/// Runs the tool on the records of a folder; its answer, or why there is none, and the seconds that it took.
pub(crate) fn ask(folder: &Path, limit: Duration) -> (Result<Answer, String>, f64) {
    let begun = Instant::now();
    let printed = folder.join("answer.json");
    let words = folder.join("words.txt");
    let file = |path: &Path| std::fs::File::create(path).expect("a folder that can be written to");
    let mut command = Command::new(tool());
    command.args(["diagnose", "model.fdm", "--data", "run1.csv", "--data", "run2.csv"]);
    command.args(["--validation", "holdout.csv", "--json"]).current_dir(folder);
    if let Ok(threads) = std::env::var("FDM_BLIND_TOOL_THREADS") {
        command.env("RAYON_NUM_THREADS", threads);
    }
    command.stdin(Stdio::null()).stdout(file(&printed)).stderr(file(&words));
    let mut child = match command.spawn() {
        Ok(child) => child,
        Err(e) => return (Err(format!("the tool does not start: {e}")), 0.0),
    };
    let status = loop {
        match child.try_wait() {
            Ok(Some(status)) => break Ok(status),
            Ok(None) if begun.elapsed() > limit => {
                // it has had its time
                let _ = child.kill().and_then(|()| child.wait());
                break Err(format!("no answer within {} s", limit.as_secs()));
            }
            Ok(None) => std::thread::sleep(Duration::from_millis(10)),
            Err(e) => break Err(e.to_string()),
        }
    };
    let seconds = begun.elapsed().as_secs_f64();
    let text = std::fs::read_to_string(&printed).unwrap_or_default();
    let answer = status.and_then(|status| {
        let words = std::fs::read_to_string(&words).unwrap_or_default();
        let error = words.lines().find(|l| l.starts_with("error") || l.contains("panicked")).or(words.lines().last());
        if status.success() || !text.is_empty() {
            Answer::read(&text)
        } else {
            Err(format!("{status}: {}", error.unwrap_or_default()))
        }
    });
    (answer, seconds)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_contract_is_read_and_what_breaks_it_refused() {
        let text = r#"{"verdict": "effect_found", "explanations": [{"verdict": "no_effect_found", "probability": 0.001}], "causes": [{"effect": "input_delay", "targets": ["de"],
            "parameters": [{"name": "tau_de", "value": 0.2}], "loss": 20.0, "probability": 0.9,
            "group": [{"effect": "actuator_lag", "targets": ["de"]}],
            "separating_experiment": null}], "lack_of_fit": [], "unnamed": [], "extended_model": null}"#;
        let answer = Answer::read(text).unwrap();
        assert_eq!(answer.causes[0].place.to_string(), "input_delay(de)");
        assert_eq!((answer.causes[0].group.len(), answer.causes[0].parameters[0].1), (2, 0.2));
        for (from, to) in
            [("effect_found", "perhaps"), ("0.001}]", "2}]"), ("\"lack_of_fit\"", "\"x\"")]
        {
            assert!(Answer::read(&text.replacen(from, to, 1)).is_err(), "{to}");
        }
    }
}
