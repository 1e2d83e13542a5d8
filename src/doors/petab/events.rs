//! Events of SBML: conditions, what they set, and in which order at one instant.
//!
//! The language sets one event after the other at one instant; SBML takes the values from before all of them, unless an event says otherwise, and
//! lets priorities order them (SBML level 3 version 2, section 4.11.6). Events of one condition therefore become one here, or are refused.

use crate::expression::{Expr, Sign};
use crate::mathml::math;
use crate::sbml::{Functions, child, is, line, list, written_out};
use roxmltree::Node;
use std::collections::BTreeSet;

/// Names that get new values when a condition becomes true.
#[derive(Debug)]
pub(crate) struct Event {
    pub(crate) trigger: Expr,
    pub(crate) assigned: Vec<(String, Expr)>,
    /// It happens when the simulation begins, where its condition holds then.
    pub(crate) from_start: bool,
}

/// An event as it stands in the file.
struct Read {
    event: Event,
    /// What it is called in messages.
    called: String,
    /// The greater one is first.
    priority: Option<Expr>,
    /// It happens although another one at its instant makes its condition false again.
    is_persistent: bool,
    /// Its values are those from before all events of its instant.
    by_trigger: bool,
}

/// All events of a model.
pub(crate) fn events(model: Node<'_, '_>, functions: &Functions, wrong: &mut Vec<String>) -> Vec<Event> {
    let mut groups: Vec<Vec<Read>> = Vec::new();
    for node in list(model, "listOfEvents", "event") {
        let id = node.attribute("id").map(|id| format!(" `{id}`")).unwrap_or_default();
        let called = format!("line {}: event{id}", line(node));
        match event(node, functions, &called) {
            Ok(Some(read)) => {
                match groups.iter_mut().find(|g| alike(&g[0].event.trigger) == alike(&read.event.trigger)) {
                    Some(group) => group.push(read),
                    None => groups.push(vec![read]),
                }
            }
            // without a formula its condition never holds
            Ok(None) => {}
            Err(e) => wrong.push(format!("{called}: {e}")),
        }
    }
    let watched: Vec<BTreeSet<String>> =
        (groups.iter()).map(|g| g[0].event.trigger.names().into_iter().map(String::from).collect()).collect();
    let mut merged = Vec::new();
    for (k, group) in groups.into_iter().enumerate() {
        let others = || watched.iter().enumerate().filter(|(other, _)| *other != k).flat_map(|(_, names)| names);
        match one(group, &watched[k], &|id| others().any(|name| name == id)) {
            Ok(one) => merged.push(one),
            Err(e) => wrong.push(e),
        }
    }
    for (k, event) in merged.iter().enumerate().filter(|(_, e)| e.from_start) {
        let sets = |id: &String| event.assigned.iter().any(|(own, _)| own == id);
        if watched.len() == merged.len() && (0..merged.len()).any(|other| other != k && watched[other].iter().any(sets))
        {
            wrong.push("an event at the very beginning (initialValue=\"false\") sets what the condition of another one names: that is not read".into());
        }
    }
    merged
}

/// `>` and `>=` are one event.
fn alike(trigger: &Expr) -> Expr {
    trigger.clone().map(&mut |e| match e {
        Expr::Binary(Sign::AtLeast, a, b) => Expr::Binary(Sign::Greater, a, b),
        Expr::Binary(Sign::AtMost, a, b) => Expr::Binary(Sign::Less, a, b),
        other => other,
    })
}

/// Events of one condition as one; `others` says whether the condition of another event names something.
fn one(mut group: Vec<Read>, watched: &BTreeSet<String>, others: &dyn Fn(&str) -> bool) -> Result<Event, String> {
    let numbers: Option<Vec<f64>> =
        group.iter().map(|r| r.priority.as_ref().and_then(|p| p.value(&|_| None))).collect();
    let is_ordered = numbers.is_some_and(|mut all| {
        all.sort_by(f64::total_cmp);
        all.windows(2).all(|w| w[0] != w[1])
    });
    if is_ordered {
        let of = |r: &Read| r.priority.as_ref().and_then(|p| p.value(&|_| None)).unwrap_or_default();
        group.sort_by(|a, b| of(b).total_cmp(&of(a)));
    }
    let mut all = group.into_iter();
    let Some(Read { mut event, .. }) = all.next() else { return Err("an event without a condition".into()) };
    for next in all {
        let refused =
            |why: String| Err(format!("{}: it happens at the instant of another one, and {why}", next.called));
        if !next.is_persistent && event.assigned.iter().any(|(id, _)| watched.contains(id)) {
            return refused("is not persistent, while that one changes its condition: that is not read".into());
        }
        if next.event.from_start != event.from_start {
            return refused("only one of them counts as false before the beginning: that is not read".into());
        }
        for (id, value) in &next.event.assigned {
            let named = || event.assigned.iter().find(|(own, _)| value.names().contains(own.as_str()));
            if let Some((named, _)) = named().filter(|_| !next.by_trigger) {
                return refused(format!(
                    "takes `{named}` from behind it (useValuesFromTriggerTime=\"false\"): put both into one event"
                ));
            }
            match event.assigned.iter_mut().find(|(own, _)| own == id) {
                Some(_) if !is_ordered => {
                    return refused(format!("both set `{id}`: give them priorities that are different numbers"));
                }
                Some(_) if others(id) => {
                    return refused(format!(
                        "both set `{id}`, which the condition of a third one names: that is not read"
                    ));
                }
                // the last one counts
                Some((_, own)) => own.clone_from(value),
                None => event.assigned.push((id.clone(), value.clone())),
            }
        }
    }
    Ok(event)
}

/// An event that happens at once; none where its condition has no formula.
fn event(node: Node<'_, '_>, functions: &Functions, called: &str) -> Result<Option<Read>, String> {
    if child(node, "delay").is_some() {
        return Err("what happens after a delay is not read: let it set `due = time + delay`, and another event the values when `time > due`".into());
    }
    let trigger = child(node, "trigger").ok_or("it has no trigger")?;
    let formula = |node: Node<'_, '_>| -> Result<Option<Expr>, String> {
        math(node)?.map(|found| written_out(found, functions, 0)).transpose()
    };
    let mut assigned = Vec::new();
    for a in list(node, "listOfEventAssignments", "eventAssignment") {
        let variable = a.attribute("variable").ok_or("an assignment without a variable")?;
        assigned.extend(formula(a)?.map(|e| (variable.to_string(), e)));
    }
    let Some(condition) = formula(trigger)?.filter(|_| !assigned.is_empty()) else { return Ok(None) };
    let priority = child(node, "priority").map(formula).transpose()?.flatten();
    let from_start = trigger.attribute("initialValue").is_some_and(|_| !is(trigger, "initialValue"));
    Ok(Some(Read {
        event: Event { trigger: condition, assigned, from_start },
        called: called.into(),
        priority,
        is_persistent: trigger.attribute("persistent").is_none_or(|_| is(trigger, "persistent")),
        by_trigger: node.attribute("useValuesFromTriggerTime").is_none_or(|_| is(node, "useValuesFromTriggerTime")),
    }))
}
