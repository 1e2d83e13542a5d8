//! `measured(y)`: the record of an output in the place of what is simulated.

use super::scope::{Meaning, Scope, SymbolId};
use crate::diagnostic::{Code, Diagnostic};
use crate::model::Model;
use crate::source::Span;
use crate::syntax::{Expr, ExprRef, Role, Value};

/// Names that a hint lists.
const MOST_NAMES: usize = 4;

/// The output whose record `measured(argument)` is: the output itself, or the only one that is the named state.
pub(super) fn output(scope: &Scope<'_>, argument: ExprRef, span: Span) -> Result<SymbolId, Option<Diagnostic>> {
    let Expr::Name(name) = scope.tree.expr(argument) else {
        let message = "`measured` is the record of an output, taken by its name";
        let finding = Diagnostic::new(Code::WrongName, span, message);
        return Err(Some(finding.hint("`output y = ...;` names the expression, `measured(y)` is its record")));
    };
    // what is not declared has been told
    let symbol = scope.find(name).ok_or(None)?;
    let told = |message: String, hint: String| Some(Diagnostic::new(Code::WrongName, span, message).hint(hint));
    match scope.symbols[symbol].role {
        Role::Output => Ok(symbol),
        Role::State => match &showing(scope, symbol)[..] {
            [output] => Ok(*output),
            [] => {
                let message = format!("no output is the state `{name}` itself, so that its record is not known");
                Err(told(message, format!("name an output, or add `output {name}_m = {name};`")))
            }
            several => {
                let names: Vec<String> =
                    several.iter().take(MOST_NAMES).map(|s| format!("`{}`", scope.symbols[*s].name())).collect();
                let message = format!("the state `{name}` is measured by several outputs: {}", names.join(", "));
                Err(told(message, format!("name one: `measured({})`", scope.symbols[several[0]].name())))
            }
        },
        Role::Input => Err(told(format!("`{name}` is an input, which is recorded anyway"), format!("write `{name}`"))),
        role => {
            let message = format!("`{name}` is a {}; only outputs have a record", role.keyword());
            Err(told(message, "`measured(y)` is the record of the output `y`".into()))
        }
    }
}

/// The outputs that are a state and nothing else, also by way of `let`.
fn showing(scope: &Scope<'_>, state: SymbolId) -> Vec<SymbolId> {
    let outputs = scope.valid().filter(|(_, symbol)| symbol.role == Role::Output);
    outputs.map(|(s, _)| s).filter(|s| state_shown(scope, *s) == Some(state)).collect()
}

/// The state that an output is, when it is one and nothing else.
pub(super) fn state_shown(scope: &Scope<'_>, output: SymbolId) -> Option<SymbolId> {
    let mut at = output;
    // a circle of definitions has no end
    for _ in 0..=scope.symbols.len() {
        let Some(Value::Expr(root)) = scope.symbols[at].declaration.value else { return None };
        let Expr::Name(name) = scope.tree.expr(root) else { return None };
        at = scope.find(name)?;
        match scope.symbols[at].role {
            Role::State => return Some(at),
            Role::Let | Role::Output => {}
            _ => return None,
        }
    }
    None
}

/// The outputs of which the text takes the record, in the order of their declaration.
pub(super) fn taken(meanings: &[Meaning]) -> Vec<SymbolId> {
    let taken = meanings.iter().filter_map(|m| if let Meaning::Record(s) = m { Some(*s) } else { None });
    let mut outputs: Vec<SymbolId> = taken.collect();
    outputs.sort_unstable();
    outputs.dedup();
    outputs
}

/// Warns of outputs that their own record enters without delay: what is compared would be compared with itself.
pub(super) fn circular(scope: &Scope<'_>, model: &Model, findings: &mut Vec<Diagnostic>) {
    use crate::graph::Leaf;
    for (k, input) in model.inputs.iter().enumerate() {
        // the record itself, or its derivative
        let source = input.slope.map_or(input, |slope| &model.inputs[slope.of as usize]);
        let Some(output) = source.measured else { continue };
        let own = &model.outputs[output as usize];
        let leaf = Leaf::Input(k as u32);
        let nodes = model.graph.reachable([own.expr]);
        let enters = nodes.iter().any(|e| model.graph.node(*e) == crate::graph::Node::Leaf(leaf));
        if let Some(s) = scope.find(&own.quantity.name).filter(|_| enters) {
            let name = &scope.symbols[s].declaration.name;
            let message =
                format!("the output `{}` contains its own record, so that it is compared with itself", name.text);
            let finding = Diagnostic::new(Code::OwnRecord, name.span, message);
            findings.push(finding.hint("use the simulated value there, or the record of another output"));
        }
    }
}
