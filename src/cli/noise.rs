//! What was typed about the measurement noise.

use crate::failure::Failure;
use crate::subject::assignment;
use fdm::Model;
use fdm::estimate::Noise;

/// The words behind `--noise`, each of them `diagonal`, `full` or `OUTPUT=DEVIATION`.
pub(crate) fn noise(words: &[String], model: &Model) -> Result<Noise, Failure> {
    let outputs = &model.definition().outputs;
    let (mut given, mut kind) = (vec![None; outputs.len()], None);
    let mut wrong = Vec::new();
    for word in words {
        match word.as_str() {
            "diagonal" | "full" => {
                let wanted = if word == "full" { Noise::Full } else { Noise::Diagonal };
                if kind.replace(wanted.clone()).is_some_and(|other| other != wanted) {
                    wrong.push("--noise diagonal and --noise full exclude each other".into());
                }
            }
            _ => match assignment(word) {
                Ok((name, deviation)) => match outputs.iter().position(|o| o.quantity.name == name) {
                    Some(k) => given[k] = Some(deviation),
                    None => {
                        let names = outputs.iter().map(|o| o.quantity.name.as_str());
                        let hint = fdm_grammar::diagnostic::nearest(&name, names);
                        let hint = hint.map_or(String::new(), |h| format!("; did you mean `{h}`?"));
                        wrong.push(format!("--noise {word}: the model has no output `{name}`{hint}"));
                    }
                },
                Err(e) => wrong.push(format!("--noise {word}: {e}, `diagonal` or `full`")),
            },
        }
    }
    let any = given.iter().any(Option::is_some);
    let declared = outputs.iter().any(|o| o.noise.is_some());
    if any && kind == Some(Noise::Full) {
        wrong.push("--noise full estimates the whole covariance: deviations cannot be given beside it".into());
    }
    if !wrong.is_empty() {
        return Err(Failure::Input(wrong));
    }
    if kind.is_none() {
        given.iter_mut().zip(outputs).for_each(|(given, output)| *given = given.or(output.noise));
    }
    Ok(match kind {
        Some(Noise::Full) => Noise::Full,
        _ if any || declared => Noise::Given(given),
        _ => Noise::Diagonal,
    })
}
