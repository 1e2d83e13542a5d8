//! Whether two models say the same, whatever their layout, comments and start values.

use fdm_grammar::graph::{Leaf, Names, Signal, show};
use fdm_grammar::model::{Origin, Quantity};
use fdm_grammar::op::ExprId;
use fdm_system::model::Model;

/// What a model says about one name.
struct Saying {
    /// The name with its role.
    what: String,
    /// What makes it that.
    text: String,
}

/// What differs between a model `then` and a model `now`, one sentence each; none when the same parameters give the same
/// response, about the same trim. Start values, bounds, docs and layout do not matter.
pub fn differences(then: &Model, now: &Model) -> Vec<String> {
    if then.source().same_texts(now.source()) {
        return Vec::new();
    }
    let (a, b) = (sayings(then), sayings(now));
    let mut found = Vec::new();
    for old in &a {
        match b.iter().find(|new| new.what == old.what) {
            None => found.push(format!("{} is missing", old.what)),
            Some(new) if new.text != old.text => {
                found.push(format!("{} is {} and was {}", old.what, short(&new.text), short(&old.text)));
            }
            Some(_) => {}
        }
    }
    let new = b.iter().filter(|new| !a.iter().any(|old| old.what == new.what));
    found.extend(new.map(|new| format!("{} is new", new.what)));
    found
}

fn sayings(model: &Model) -> Vec<Saying> {
    let m = model.definition();
    let mut all = vec![Saying { what: "the unit of time".into(), text: m.time.to_string() }];
    let unit = |q: &Quantity| q.unit.as_ref().map_or(String::from("without a unit"), |u| format!("in {u}"));
    let mut add = |what: String, text: String| all.push(Saying { what, text });
    let shown = |e: ExprId| show(&m.graph, e, m);
    for input in &m.inputs {
        add(format!("the input `{}`", input.quantity.name), unit(&input.quantity));
    }
    for p in &m.params {
        let kind = if p.per_run { "per run" } else { "shared" };
        // whether an initial value is free is seen at its state
        if p.origin == Origin::Declared {
            add(format!("the parameter `{}`", p.quantity.name), format!("{kind}, {}", unit(&p.quantity)));
        }
    }
    for s in &m.states {
        let name = &s.quantity.name;
        add(format!("the state `{name}`"), unit(&s.quantity));
        add(format!("`der({name})`"), format!("`{}`", shown(s.rate)));
        add(format!("the initial value of `{name}`"), format!("`{}`", shown(s.initial)));
    }
    for o in &m.outputs {
        add(format!("the output `{}`", o.quantity.name), format!("`{}`, {}", shown(o.expr), unit(&o.quantity)));
    }
    for (signal, value) in &m.trim {
        let name = m.leaf(match signal {
            Signal::State(k) => Leaf::State(*k),
            Signal::Input(k) => Leaf::Input(*k),
        });
        all.push(Saying { what: format!("the trim of `{name}`"), text: format!("`{}`", shown(*value)) });
    }
    all
}

fn short(text: &str) -> String {
    const LONGEST: usize = 120;
    if text.chars().count() <= LONGEST {
        return text.into();
    }
    text.chars().take(LONGEST).chain("...".chars()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str =
        "model a { state x = free; input u; param k = 1 [1/s], c = 2 fixed; der(x) = u - k*x; output y = c*x; }";

    fn found(now: &str) -> Vec<String> {
        let [then, now] = [TEXT, now].map(|t| Model::from_text("a.fdm", t).unwrap());
        differences(&then, &now)
    }

    #[test]
    fn layout_and_start_values_do_not_matter() {
        assert!(found(&TEXT.replace("; ", ";\n  // said\n")).is_empty());
        assert!(found(&TEXT.replace("k = 1", "k = 7 in [0, 9]")).is_empty());
    }

    #[test]
    fn what_differs_is_named() {
        let said = found(&TEXT.replace("u - k*x", "u - k/x"));
        assert_eq!(said, ["`der(x)` is `u - k/x` and was `u - x*k`"]);
        assert_eq!(found(&TEXT.replace("= free", "= 0")).len(), 1);
        let said = found(&TEXT.replace("k = 1 [1/s]", "k = 1 per run [1/min]"));
        assert_eq!(said, ["the parameter `k` is per run, in 1/min and was shared, in 1/s"]);
        let said = found(&TEXT.replace("output y = c*x", "output z = c*x"));
        assert_eq!(said, ["the output `y` is missing", "the output `z` is new"]);
        let said = found(&TEXT.replace("output y", "trim { u = 2*k; } output y"));
        assert_eq!(said, ["the trim of `u` is new"]);
    }
}
