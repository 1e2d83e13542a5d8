//! What was before the beginning: delays that reach behind it, and rates that are asked for at it.
//!
//! A delay of the language sees the first value of its signal before the beginning. In SBML it sees what the formula was then (level 3 version 2,
//! section 3.4.6): the same where neither time nor an initial value that time gives is in it.

use crate::expression::{Expr, Sign, binary};
use crate::sbml::Sbml;
use std::collections::{BTreeMap, BTreeSet};

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
