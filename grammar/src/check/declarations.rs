//! What may stand behind a declared name: which attributes each kind takes, and whether their values make sense.

use super::expressions::{Expressions, Indices};
use super::kinds::Kinds;
use super::scope::{Scope, Symbol, SymbolId};
use crate::diagnostic::{Code, Diagnostic};
use crate::graph::{Leaf, Node, Signal};
use crate::source::Span;
use crate::syntax::{Bounds, ExprRef, Role, Value};

/// Tells values that are missing or needless, and attributes that do not belong to the kind.
pub(super) fn attributes(scope: &Scope<'_>, findings: &mut Vec<Diagnostic>) {
    for symbol in &scope.symbols {
        value(symbol, findings);
        let d = symbol.declaration;
        if let Some(bounds) = d.bounds.filter(|_| symbol.role != Role::Param) {
            findings.push(wrong(symbol, bounds.span, "bounds", bounds_hint(symbol)));
        }
        if let Some(span) = d.fixed.filter(|_| symbol.role != Role::Param) {
            findings.push(wrong(symbol, span, "`fixed`", "only params are estimated, everything else is fixed"));
        }
        if let Some(span) = d.per_run.filter(|_| !matches!(symbol.role, Role::Param | Role::Known)) {
            findings.push(wrong(symbol, span, "`per run`", per_run_hint(symbol)));
        }
        if let Some(group) = d.group.as_ref().filter(|_| symbol.role != Role::Param) {
            let hint = "only params are shared within a group of runs";
            findings.push(wrong(symbol, group.span, "`per group`", hint));
        }
        if let Some(wrap) = d.wrap.as_ref().filter(|_| symbol.role != Role::Output) {
            findings.push(wrong(symbol, wrap.span, "`wrap`", "only outputs are compared, and so may wrap"));
        } else if let Some(wrap) = d.wrap.as_ref().filter(|w| !(w.period.is_finite() && w.period > 0.0)) {
            let message = format!("`{}` wraps at {}, which is no period", symbol.name(), wrap.text);
            let finding = Diagnostic::new(Code::WrongAttribute, wrap.span, message);
            findings.push(finding.hint("a period is above zero: `wrap 360` in degrees, `wrap 2*pi` in radians"));
        }
        if let Some(hold) = d.hold.filter(|_| symbol.role != Role::Input) {
            let word = if hold.held { "`held`" } else { "`linear`" };
            findings.push(wrong(symbol, hold.span, word, "only inputs go between samples, held or in straight lines"));
        }
        if let Some(span) = d.log.filter(|_| symbol.role != Role::Param) {
            findings.push(wrong(symbol, span, "`log`", "only params are estimated by their logarithms"));
        }
        if let (Some(fixed), Some(per_run), Role::Param) = (d.fixed, d.per_run, symbol.role) {
            let message = format!("`{}` cannot be fixed and have a value of its own in each run", symbol.name());
            let finding = Diagnostic::new(Code::WrongAttribute, fixed.max(per_run), message);
            findings.push(finding.hint("remove `fixed` or `per run`"));
        }
        if let (Some(group), Some(other), Role::Param) = (&d.group, d.fixed.or(d.per_run), symbol.role) {
            let (name, other_word) = (symbol.name(), if d.fixed.is_some() { "fixed" } else { "per run" });
            let message = format!("`{name}` cannot be `{other_word}` and `per group {}`", group.text);
            let finding = Diagnostic::new(Code::WrongAttribute, group.span.max(other), message);
            findings.push(finding.hint(format!("remove `{other_word}` or `per group {}`", group.text)));
        }
    }
}

fn wrong(symbol: &Symbol<'_>, span: Span, what: &str, hint: impl Into<String>) -> Diagnostic {
    let message = format!("{what} cannot be given for {} `{}`", article(symbol.role), symbol.name());
    Diagnostic::new(Code::WrongAttribute, span, message).hint(hint)
}

fn article(role: Role) -> &'static str {
    match role {
        Role::Input => "the input",
        Role::Known => "the known",
        Role::State => "the state",
        Role::Param => "the param",
        Role::Const => "the const",
        Role::Let => "the let",
        Role::Output => "the output",
        Role::Table => "the table",
    }
}

fn bounds_hint(symbol: &Symbol<'_>) -> String {
    match symbol.role {
        Role::State => {
            let name = symbol.name();
            format!("bound its initial value: `param {name}0 = 0 in [lower, upper]; state {name} = {name}0;`")
        }
        _ => "only params have bounds".into(),
    }
}

fn per_run_hint(symbol: &Symbol<'_>) -> String {
    match symbol.role {
        Role::State => format!("`state {} = free;` estimates the initial value in each run", symbol.name()),
        _ => "only params have a value of their own in each run".into(),
    }
}

fn value(symbol: &Symbol<'_>, findings: &mut Vec<Diagnostic>) {
    let (name, span) = (symbol.name(), symbol.declaration.name.span);
    let missing = |what: &str, hint: String| {
        let message = format!("{} `{name}` has no {what}", article(symbol.role));
        Diagnostic::new(Code::MissingValue, span, message).hint(hint)
    };
    findings.push(match (symbol.role, symbol.declaration.value) {
        (Role::State | Role::Table, _)
        | (Role::Param | Role::Const | Role::Let | Role::Output, Some(Value::Expr(_))) => return,
        (Role::Input | Role::Known, None) => return,
        (Role::Input | Role::Known, Some(Value::Expr(_))) => {
            let message = format!("{} `{name}` cannot have a value: it is read from the record", article(symbol.role));
            let finding = Diagnostic::new(Code::NeedlessValue, span, message);
            finding.hint(format!(
                "`const {name} = ...;` for a constant, `let {name} = ...;` for a signal that is computed"
            ))
        }
        (Role::Param, Some(Value::Free(free))) => wrong(
            symbol,
            free,
            "`free`",
            format!("a param is free unless it is fixed; `param {name} = 1;` gives its start value"),
        ),
        (_, Some(Value::Free(free))) => wrong(symbol, free, "`free`", "it is for initial values: `state x = free;`"),
        (Role::Param, None) => {
            missing("start value", format!("`param {name} = 1;` gives the value from which the estimation starts"))
        }
        (Role::Output, None) => missing("expression", format!("`output {name} = ...;` says what is measured")),
        (role, None) => missing("value", format!("`{} {name} = ...;`", role.keyword())),
    });
}

/// Start value and bounds of a parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Range {
    pub(super) value: f64,
    pub(super) lower: f64,
    pub(super) upper: f64,
}

/// The start values and bounds of all params (by symbol), checked against each other and against their use as delays.
pub(super) fn ranges(
    scope: &Scope<'_>,
    kinds: &Kinds,
    indices: &Indices,
    expressions: &Expressions,
    findings: &mut Vec<Diagnostic>,
) -> Vec<Range> {
    let unknown = Range { value: f64::NAN, lower: f64::NEG_INFINITY, upper: f64::INFINITY };
    let mut ranges = vec![unknown; scope.symbols.len()];
    for (s, symbol) in scope.valid().filter(|(_, symbol)| symbol.role == Role::Param) {
        if kinds.derived[s] {
            derived_attributes(symbol, findings);
            continue;
        }
        let constant = |e: ExprRef| if kinds.of(e).broken { None } else { expressions.constant(e) };
        if let Some(Value::Expr(root)) = symbol.declaration.value {
            ranges[s].value = constant(root).unwrap_or(f64::NAN);
        }
        if let Some(bounds) = symbol.declaration.bounds
            && let (Some(lower), Some(upper)) = (constant(bounds.lower), constant(bounds.upper))
        {
            bounded(scope, symbol, bounds, lower, upper, &mut ranges[s], findings);
        }
        if let Some(log) = symbol.declaration.log {
            positive(scope, symbol, log, &mut ranges[s], findings);
        }
    }
    delays(scope, kinds, indices, expressions, &mut ranges, findings);
    ranges
}

fn derived_attributes(symbol: &Symbol<'_>, findings: &mut Vec<Diagnostic>) {
    let d = symbol.declaration;
    let name = symbol.name();
    let spans = [
        (d.bounds.map(|b| b.span), "bounds"),
        (d.fixed, "`fixed`"),
        (d.per_run, "`per run`"),
        (d.group.as_ref().map(|g| g.span), "`per group`"),
        (d.log, "`log`"),
    ];
    for (span, what) in spans {
        if let Some(span) = span {
            let message = format!("{what} cannot be given for `{name}`, which other params define");
            let finding = Diagnostic::new(Code::WrongAttribute, span, message);
            findings.push(finding.hint("give it for the params in the definition, or make the start value a number"));
        }
    }
}

fn bounded(
    scope: &Scope<'_>,
    symbol: &Symbol<'_>,
    bounds: Bounds,
    lower: f64,
    upper: f64,
    range: &mut Range,
    findings: &mut Vec<Diagnostic>,
) {
    let name = symbol.name();
    let ordered = lower < upper;
    if !ordered {
        let message = format!("the bounds [{lower}, {upper}] of `{name}` leave no room");
        let finding = Diagnostic::new(Code::BadBounds, bounds.span, message);
        findings.push(match lower.partial_cmp(&upper) {
            Some(std::cmp::Ordering::Greater) => finding.hint(format!("`in [{upper}, {lower}]`")),
            Some(_) => finding.hint(format!("`param {name} = {lower} fixed` for a known value")),
            None => finding.hint("bounds are numbers"),
        });
        return;
    }
    (range.lower, range.upper) = (lower, upper);
    if range.value < lower || range.value > upper {
        let place = match symbol.declaration.value {
            Some(Value::Expr(root)) => scope.tree.span(root),
            _ => symbol.declaration.name.span,
        };
        let message = format!("`{name}` starts at {}, outside its bounds [{lower}, {upper}]", range.value);
        let finding = Diagnostic::new(Code::OutsideBounds, place, message);
        findings.push(finding.label(bounds.span, "the bounds").hint("start inside the bounds or widen them"));
    }
}

/// A param that is estimated by its logarithm is above 0, and so are its bounds; a lower one of 0 is never reached.
fn positive(scope: &Scope<'_>, symbol: &Symbol<'_>, log: Span, range: &mut Range, findings: &mut Vec<Diagnostic>) {
    let name = symbol.name();
    if let Some(bounds) = symbol.declaration.bounds
        && (range.lower < 0.0 || range.upper <= 0.0)
    {
        let (lower, upper) = (range.lower, range.upper);
        let message = format!("`{name}` is estimated by its logarithm, its bounds [{lower}, {upper}] are not positive");
        let finding = Diagnostic::new(Code::BadBounds, bounds.span, message).label(log, "by its logarithm");
        let upper = if upper > 0.0 { upper.to_string() } else { "upper".into() };
        findings.push(finding.hint(format!("`in [lower, {upper}] log` with `lower` above 0, or no `log`")));
    } else if range.value <= 0.0 {
        let place = match symbol.declaration.value {
            Some(Value::Expr(root)) => scope.tree.span(root),
            _ => symbol.declaration.name.span,
        };
        let message = format!("`{name}` is estimated by its logarithm and cannot start at {}", range.value);
        let finding = Diagnostic::new(Code::OutsideBounds, place, message).label(log, "by its logarithm");
        findings.push(finding.hint("start above 0, or remove `log`"));
    }
    range.lower = range.lower.max(0.0);
}

/// A param that is a delay cannot go below zero.
fn delays(
    scope: &Scope<'_>,
    kinds: &Kinds,
    indices: &Indices,
    expressions: &Expressions,
    ranges: &mut [Range],
    findings: &mut Vec<Diagnostic>,
) {
    let mut by_index: Vec<(u32, SymbolId)> = Vec::new();
    for (s, symbol) in scope.valid() {
        if symbol.role == Role::Param && !kinds.derived[s] {
            by_index.push((indices.of[s], s));
        }
    }
    // the future of a record is known, that of a state is not
    let graph = &expressions.graph;
    let of_states = graph.delayed().iter().filter(|d| matches!(d.signal, Signal::State(_))).map(|d| d.tau);
    let of_states = graph.reachable(of_states);
    let mut told = vec![false; scope.symbols.len()];
    for call in &expressions.delays {
        let tau = expressions.of(call.tau);
        let Node::Leaf(Leaf::Param(k)) = graph.node(tau) else { continue };
        let symbol = by_index.binary_search_by_key(&k, |(index, _)| *index).ok().map(|at| by_index[at].1);
        if let Some(s) = symbol
            && !std::mem::replace(&mut told[s], true)
        {
            let recorded = of_states.binary_search(&tau).is_err();
            delay_param(scope, s, (scope.tree.span(call.tau), recorded), &mut ranges[s], findings);
        }
    }
}

/// A delay of records alone may be negative where its bounds say so: the recorder was late.
fn delay_param(
    scope: &Scope<'_>,
    s: SymbolId,
    (used, recorded): (Span, bool),
    range: &mut Range,
    findings: &mut Vec<Diagnostic>,
) {
    let symbol = &scope.symbols[s];
    let name = symbol.name();
    if let Some(bounds) = symbol.declaration.bounds
        && range.lower < 0.0
    {
        if recorded && range.lower.is_finite() {
            return;
        }
        let message = if recorded {
            format!("`{name}` is a delay, and its lower bound is not finite")
        } else {
            format!("`{name}` delays a state and cannot be negative, its lower bound is {}", range.lower)
        };
        let upper = range.upper;
        let upper = if upper > 0.0 && upper.is_finite() { upper.to_string() } else { "upper".into() };
        let finding = Diagnostic::new(Code::BadDelay, bounds.span, message).label(used, "used as a delay here");
        findings.push(finding.hint(format!("`in [0, {upper}]`")));
    } else if range.value < 0.0 {
        let message = format!("`{name}` is a delay and cannot be negative, it starts at {}", range.value);
        let finding = Diagnostic::new(Code::BadDelay, symbol.declaration.name.span, message);
        findings.push(finding.label(used, "used as a delay here").hint("start at 0 or above"));
    }
    range.lower = range.lower.max(0.0);
}
