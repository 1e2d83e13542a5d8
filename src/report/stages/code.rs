//! The machine code that runs inside integrations.

use super::Shown;
use fdm_system::Model;
use fdm_system::code::listing;
use serde_json::json;

pub(super) fn code(model: &Model) -> Result<Shown, String> {
    let listed = listing(model.schedule()).map_err(|e| format!("there is no machine code here: {e}"))?;
    let (mut text, mut list) = (String::new(), Vec::new());
    for (name, code) in listed {
        let lines = code.as_ref().map_or(0, |c| c.lines().count());
        let body = code.clone().unwrap_or_else(|| "  too long for a compiler: interpreted\n".into());
        text += &format!("{name}: {lines} lines\n{}\n\n", body.trim_end());
        list.push(json!({ "program": name, "code": code }));
    }
    text += "prepare and by_input are interpreted; what a step of the integrator runs are rates or rates_and_partials, four times in one\n";
    Ok(Shown { text, json: json!({ "model": model.name(), "programs": list }) })
}
