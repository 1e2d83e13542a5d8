//! The machine code that runs inside integrations.

use super::Shown;
use fdm_results::documents::stages::{CodeStage, ProgramCode, StageDocument};
use fdm_system::Model;
use fdm_system::code::listing;

pub(super) fn code(model: &Model) -> Result<Shown, String> {
    let listed = listing(model.schedule()).map_err(|e| format!("there is no machine code here: {e}"))?;
    let (mut text, mut list) = (String::new(), Vec::new());
    for (name, code) in listed {
        let lines = code.as_ref().map_or(0, |c| c.lines().count());
        let body = code.clone().unwrap_or_else(|| "  too long for a compiler: interpreted\n".into());
        text += &format!("{name}: {lines} lines\n{}\n\n", body.trim_end());
        list.push(ProgramCode { code, program: name.into() });
    }
    text += "prepare and by_input are interpreted; what a step of the integrator runs are rates or rates_and_partials, four times in one\n";
    let stage = CodeStage { model: model.name().into(), programs: list };
    Ok(Shown { text, document: StageDocument::Code(stage) })
}
