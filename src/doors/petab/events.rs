//! Events of SBML: conditions, what they set, and in which order at one instant.
//!
//! The language sets one event after the other at one instant; SBML takes the values from before all of them, unless an event says otherwise, and
//! lets priorities order them (SBML level 3 version 2, section 4.11.6). Events of one condition therefore become one here, or are refused.
//!
//! What was before the beginning: delays that reach behind it, and rates that are asked for at it.
//!
//! A delay of the language sees the first value of its signal before the beginning. In SBML it sees what the formula was then (level 3 version 2,
//! section 3.4.6): the same where neither time nor an initial value that time gives is in it.

use crate::expression::{Expr, Sign, binary};
use crate::mathml::math;
use crate::sbml::{Functions, Sbml, child, is, line, list, written_out};
use roxmltree::Node;
use std::collections::{BTreeMap, BTreeSet};

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

/// Makes delays mean what they do in SBML.
///
/// # Errors
/// Sentences about those that cannot, and about initial values that are rates.
pub(crate) fn remember(sbml: &mut Sbml) -> Vec<String> {
    let mut wrong = Vec::new();
    let history = History::of(sbml);
    for (id, e) in &sbml.initial {
        if history.whole(e, 0).has_call("der") {
            wrong.push(format!(
                "the initial assignment of `{id}` names a rate (rateOf), which is not known at the beginning"
            ));
        }
    }
    for event in sbml.events.iter().filter(|e| e.from_start) {
        let mut all =
            std::iter::once(&event.trigger).chain(event.assigned.iter().map(|(_, e)| e)).map(|e| history.whole(e, 0));
        if all.any(|e| e.has_call("der") || e.has_call("delay")) {
            let said = "names a rate or a delay, which are not known at the beginning";
            wrong.push(format!("the event `{}` (initialValue=\"false\") {said}", event.trigger.text("time")));
        }
    }
    let mut each = |e: &mut Expr| {
        let own = std::mem::replace(e, Expr::True);
        *e = own.map(&mut |part| match &part {
            Expr::Call("delay", list) => match history.delayed(list) {
                Ok(None) => part,
                Ok(Some(other)) => other,
                Err(why) => {
                    wrong.push(format!("`{}`: {why}", part.text("time")));
                    part
                }
            },
            _ => part,
        });
    };
    sbml.assigned.iter_mut().chain(&mut sbml.rates).for_each(|(_, e)| each(e));
    sbml.initial.values_mut().for_each(&mut each);
    for event in &mut sbml.events {
        each(&mut event.trigger);
        event.assigned.iter_mut().for_each(|(_, e)| each(e));
    }
    for reaction in &mut sbml.reactions {
        each(&mut reaction.law);
        reaction.reactants.iter_mut().chain(&mut reaction.products).for_each(|(_, e)| each(e));
    }
    wrong
}

struct History {
    rules: BTreeMap<String, Expr>,
    /// What rates, reactions and events change.
    moving: BTreeSet<String>,
    /// What has an initial value that time is a part of.
    timed: BTreeSet<String>,
}

impl History {
    fn of(sbml: &Sbml) -> Self {
        let reacting = sbml.reactions.iter().flat_map(|r| r.reactants.iter().chain(&r.products));
        let set = sbml.events.iter().flat_map(|e| &e.assigned).chain(&sbml.rates);
        let moving = reacting.chain(set).map(|(id, _)| id.clone()).collect();
        let rules = sbml.assigned.iter().cloned().collect();
        let mut found = Self { rules, moving, timed: BTreeSet::new() };
        found.timed =
            (sbml.initial.iter()).filter(|(_, e)| found.whole(e, 0).has_time()).map(|(id, _)| id.clone()).collect();
        found
    }

    /// An expression without names that follow from others.
    fn whole(&self, e: &Expr, depth: usize) -> Expr {
        e.clone().map(&mut |part| match &part {
            Expr::Name(id) if depth < 16 => {
                self.rules.get(id).map_or_else(|| part.clone(), |e| self.whole(e, depth + 1))
            }
            _ => part,
        })
    }

    /// What stands in the place of a delay; none where it means what it does here.
    fn delayed(&self, list: &[Expr]) -> Result<Option<Expr>, String> {
        let [of, by] = list else { return Ok(None) };
        let whole = self.whole(of, 0);
        let names = whole.names();
        if whole.has_call("der") {
            return Err("a rate before the beginning is not known".into());
        }
        if names.iter().any(|id| self.timed.contains(*id)) {
            return Err("an initial assignment says what it was before the beginning, which is not read".into());
        }
        if !whole.has_time() {
            return Ok(None);
        }
        if names.iter().any(|id| self.moving.contains(*id)) {
            return Err("time stands in what is delayed: write it apart".into());
        }
        let earlier = binary(Sign::Subtract, Expr::Time, by.clone());
        Ok(Some(whole.map(&mut |part| if part == Expr::Time { earlier.clone() } else { part })))
    }
}
