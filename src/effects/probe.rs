//! An effect on a plain model that has what it attaches to: whether it compiles there, vanishes and does something.

use super::candidate::{Candidate, Choice};
use super::definition::{Effect, Kind};
use super::null::Null;
use super::scales::{Nominal, rounded};
use super::subject::Subject;
use fdm_grammar::compile;
use fdm_grammar::diagnostic::{Code, Diagnostic};
use fdm_grammar::source::Source;
use fdm_grammar::syntax::SlotKind;
use std::fmt::Write;
use std::sync::Arc;

/// Applies an effect, for every kind that its slots can be.
pub(super) fn check(effect: &Effect) -> Result<(), Diagnostic> {
    if effect.kind() == Kind::Variance {
        return Ok(());
    }
    let most = effect.tree().slots.iter().map(|s| s.kinds.len()).max().unwrap_or(1);
    for k in 0..most {
        let kinds = effect.tree().slots.iter().map(|s| s.kinds[k.min(s.kinds.len() - 1)]).collect();
        on(effect, kinds)?;
    }
    Ok(())
}

fn on(effect: &Effect, kinds: Vec<SlotKind>) -> Result<(), Diagnostic> {
    let place = effect.tree().name.span;
    let fault = |code: Code, message: String| Diagnostic::new(code, place, message);
    let source = Source::new("plain model", text(effect, &kinds));
    let plain = |findings: Vec<Diagnostic>| {
        let first = findings.into_iter().find(Diagnostic::is_error);
        let (message, hint) = first.map_or((String::new(), None), |f| (f.message, f.hint));
        let found = fault(Code::Misfit, format!("the effect `{}` makes no model: {message}", effect.name()));
        match hint {
            Some(hint) => found.hint(hint),
            None => found,
        }
    };
    let base = compile(&source).map_err(plain)?;
    let subject = Subject::new(&source, &base.model).map_err(plain)?;
    let targets = effect.tree().slots.iter().map(|s| s.name.text.clone()).collect();
    let candidate = Candidate::new(Arc::new(effect.clone()), targets, kinds);
    let extension = candidate.apply(&subject, &Nominal, &Choice::new())?;
    let extended = extension.compile().map_err(plain)?;
    let name = effect.name();
    match extension.null(&extended.model) {
        Null::Identity | Null::Limit => Ok(()),
        Null::Nothing => {
            Err(fault(Code::NoRewrite, format!("the effect `{name}` changes nothing, whatever its values are")))
        }
        Null::Unclear => {
            Err(fault(Code::NotVanishing, format!("the effect `{name}` has no finite values at its null values"))
                .hint("a null may be infinite, such as that of a limit: `param L = inf try ...;`"))
        }
        Null::Differs { place, base, extended } => {
            // the plain model's own names mean nothing to a reader
            let place = match place.strip_prefix("of_") {
                Some(slot) => format!("what is computed from `{slot}`"),
                None => format!("`{place}`"),
            };
            let (base, extended) = (rounded(base), rounded(extended));
            let nulls: Vec<String> = extension
                .params()
                .iter()
                .filter(|p| !p.nuisance)
                .map(|p| format!("{} = {}", p.local, p.null))
                .collect();
            let nulls = nulls.join(", ");
            let message = format!(
                "the effect `{name}` does not vanish at {nulls}: {place} is {extended} there, and {base} without it"
            );
            Err(fault(Code::NotVanishing, message)
                .hint("give the value at which it leaves the model as it is, or multiply what is added by a param that is null"))
        }
    }
}

/// A model without units in which every slot is something of its own, seen by an output.
fn text(effect: &Effect, kinds: &[SlotKind]) -> String {
    let mut text = String::from("model plain {\n");
    let slots = || effect.tree().slots.iter().map(|s| &s.name.text).zip(kinds);
    for (name, kind) in slots() {
        let _ = match kind {
            SlotKind::Input => writeln!(text, "  input {name};\n  output of_{name} = 1.5*{name};"),
            SlotKind::State => {
                writeln!(
                    text,
                    "  param p_{name} = 0.7;\n  state {name};\n  der({name}) = 0.3 - p_{name}*{name};\n  output of_{name} = {name};"
                )
            }
            SlotKind::Output => {
                writeln!(
                    text,
                    "  state s_{name};\n  param p_{name} = 0.6;\n  der(s_{name}) = 0.2 - p_{name}*s_{name};\n  output {name} = 2*s_{name};"
                )
            }
            SlotKind::Param => writeln!(text, "  param {name} = 1.3;\n  output of_{name} = {name};"),
        };
    }
    text + "}\n"
}
