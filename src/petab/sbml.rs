//! SBML core, levels 2 and 3, as far as ordinary differential equations go: compartments, species, parameters, rules, initial assignments,
//! reactions, functions. What the language has not is refused in words ([`Sbml::read`]).

use crate::expression::{Expr, LONGEST};
use crate::mathml::{lambda, math};
use fdm_readers::refuse_endless_xml;
use roxmltree::{Document, Node, ParsingOptions};
use std::collections::BTreeMap;

/// A model as SBML says it.
#[derive(Debug, Default)]
pub(crate) struct Sbml {
    pub(crate) id: String,
    pub(crate) name: String,
    pub(crate) compartments: Vec<Constant>,
    pub(crate) species: Vec<Species>,
    pub(crate) parameters: Vec<Constant>,
    pub(crate) reactions: Vec<Reaction>,
    /// Names that follow from others at all times.
    pub(crate) assigned: Vec<(String, Expr)>,
    /// Names with a rate.
    pub(crate) rates: Vec<(String, Expr)>,
    /// Values when the simulation begins.
    pub(crate) initial: BTreeMap<String, Expr>,
    pub(crate) events: Vec<Event>,
    /// What a name is called by its authors.
    pub(crate) titles: BTreeMap<String, String>,
}

/// A compartment with its size, or a parameter with its value.
#[derive(Debug)]
pub(crate) struct Constant {
    pub(crate) id: String,
    pub(crate) value: Option<f64>,
}

#[derive(Debug)]
pub(crate) struct Species {
    pub(crate) id: String,
    pub(crate) compartment: String,
    pub(crate) amount: Option<f64>,
    pub(crate) concentration: Option<f64>,
    /// Its name in formulas is an amount, not a concentration.
    pub(crate) is_amount: bool,
    /// Reactions do not change it.
    pub(crate) is_held: bool,
}

#[derive(Debug)]
pub(crate) struct Reaction {
    pub(crate) id: String,
    pub(crate) reactants: Vec<(String, f64)>,
    pub(crate) products: Vec<(String, f64)>,
    /// Amount for each unit of time.
    pub(crate) law: Expr,
}

/// Names that get new values when a condition becomes true.
#[derive(Debug)]
pub(crate) struct Event {
    pub(crate) trigger: Expr,
    pub(crate) assigned: Vec<(String, Expr)>,
}

/// Reads lists of elements of one kind.
fn list<'a>(model: Node<'a, 'a>, list: &'static str, item: &'static str) -> impl Iterator<Item = Node<'a, 'a>> {
    let lists = model.children().filter(move |n| n.tag_name().name() == list);
    lists.flat_map(move |l| l.children().filter(move |n| n.tag_name().name() == item))
}

fn id(node: Node<'_, '_>) -> Result<String, String> {
    let line = node.document().text_pos_at(node.range().start).row;
    let found = node.attribute("id").or_else(|| node.attribute("name"));
    found.map(String::from).ok_or_else(|| format!("line {line}: `{}` has no id", node.tag_name().name()))
}

fn value(node: Node<'_, '_>, attribute: &str) -> Result<Option<f64>, String> {
    let Some(text) = node.attribute(attribute) else { return Ok(None) };
    let wrong = || format!("line {}: {attribute}=\"{text}\" is not a number", line(node));
    let value: f64 = match text.trim() {
        "INF" => f64::INFINITY,
        text => text.parse().map_err(|_| wrong())?,
    };
    Ok((!value.is_nan()).then_some(value))
}

fn line(node: Node<'_, '_>) -> u32 {
    node.document().text_pos_at(node.range().start).row
}

fn is(node: Node<'_, '_>, attribute: &str) -> bool {
    matches!(node.attribute(attribute), Some("true" | "1"))
}

impl Sbml {
    /// Reads the text of a file.
    ///
    /// # Errors
    /// Every part that is broken or has no counterpart, with its line.
    pub(crate) fn read(text: &str) -> Result<Self, Vec<String>> {
        refuse_endless_xml(text.as_bytes()).map_err(|e| vec![format!("it is not read: {e}")])?;
        let options = ParsingOptions { allow_dtd: false, nodes_limit: 20_000_000, ..ParsingOptions::default() };
        let document = Document::parse_with_options(text, options).map_err(|e| vec![format!("it is not XML: {e}")])?;
        let root = document.root_element();
        if root.tag_name().name() != "sbml" {
            return Err(vec![format!("it is not SBML: its first element is `{}`", root.tag_name().name())]);
        }
        let Some(model) = root.children().find(|n| n.tag_name().name() == "model") else {
            return Err(vec!["there is no `model` in it".into()]);
        };
        let (mut read, mut wrong) = (Self::default(), Vec::new());
        if root.attribute("level") == Some("1") {
            wrong.push("SBML of level 1 is not read; levels 2 and 3 are".into());
        }
        read.id = model.attribute("id").unwrap_or_default().into();
        read.name = model.attribute("name").unwrap_or_default().into();
        read.refuse(model, &mut wrong);
        let functions = functions(model, &mut wrong);
        read.declarations(model, &mut wrong);
        read.rules(model, &functions, &mut wrong);
        for node in list(model, "listOfEvents", "event") {
            match event(node, &functions) {
                Ok(event) => read.events.push(event),
                Err(e) => {
                    let id = node.attribute("id").map(|id| format!(" `{id}`")).unwrap_or_default();
                    wrong.push(format!("line {}: event{id}: {e}", line(node)));
                }
            }
        }
        for (id, _) in read.events.iter().flat_map(|e| &e.assigned) {
            let holds = |s: &Species| s.compartment == *id && !s.is_amount;
            if read.species.iter().any(holds) {
                wrong.push(format!(
                    "an event sets the size of `{id}`, in which concentrations would jump: that is not read"
                ));
            }
        }
        for node in list(model, "listOfReactions", "reaction") {
            match reaction(node, &functions) {
                Ok((reaction, local)) => {
                    read.reactions.push(reaction);
                    read.parameters.extend(local);
                }
                Err(e) => wrong.push(format!("line {}: {e}", line(node))),
            }
        }
        if wrong.is_empty() { Ok(read) } else { Err(wrong) }
    }

    /// Every name that can stand in a formula.
    pub(crate) fn ids(&self) -> impl Iterator<Item = &str> {
        let constants = self.compartments.iter().chain(&self.parameters).map(|c| c.id.as_str());
        let species = self.species.iter().map(|s| s.id.as_str());
        constants.chain(species).chain(self.reactions.iter().map(|r| r.id.as_str()))
    }

    /// What the language has not.
    fn refuse(&self, model: Node<'_, '_>, wrong: &mut Vec<String>) {
        let what = [
            ("algebraicRule", "an algebraic rule is an equation without a rate: solve it for one of its names"),
            ("stoichiometryMath", "the number of a species in a reaction must not be a formula"),
        ];
        for node in model.descendants().filter(Node::is_element) {
            if let Some((_, why)) = what.iter().find(|(name, _)| *name == node.tag_name().name()) {
                let id = node.attribute("id").map(|id| format!(" `{id}`")).unwrap_or_default();
                wrong.push(format!("line {}: {}{id}: {why}", line(node), node.tag_name().name()));
            }
            if node.attribute("conversionFactor").is_some() {
                wrong.push(format!("line {}: conversion factors are not read", line(node)));
            }
            if node.tag_name().name() == "reaction" && is(node, "fast") {
                wrong.push(format!("line {}: a fast reaction is an equilibrium, which is not read", line(node)));
            }
        }
    }

    fn declarations(&mut self, model: Node<'_, '_>, wrong: &mut Vec<String>) {
        let mut constant = |node: Node<'_, '_>, attribute: &str| -> Option<Constant> {
            match (id(node), value(node, attribute)) {
                (Ok(id), Ok(value)) => Some(Constant { id, value }),
                (id, value) => {
                    wrong.extend(id.err().into_iter().chain(value.err()));
                    None
                }
            }
        };
        for node in list(model, "listOfCompartments", "compartment") {
            self.compartments.extend(constant(node, "size"));
        }
        for node in list(model, "listOfParameters", "parameter") {
            self.parameters.extend(constant(node, "value"));
        }
        for node in list(model, "listOfSpecies", "species") {
            match species(node) {
                Ok(species) => self.species.push(species),
                Err(e) => wrong.push(e),
            }
        }
        let named = ["listOfCompartments", "listOfParameters", "listOfSpecies"];
        for node in model.children().filter(|n| named.contains(&n.tag_name().name())).flat_map(|l| l.children()) {
            if let (Some(id), Some(title)) = (node.attribute("id"), node.attribute("name"))
                && id != title
                && !title.trim().is_empty()
            {
                self.titles.insert(id.into(), title.trim().into());
            }
        }
    }

    fn rules(&mut self, model: Node<'_, '_>, functions: &Functions, wrong: &mut Vec<String>) {
        let mut formula = |node: Node<'_, '_>, of: &str| -> Option<(String, Expr)> {
            let found = math(node).and_then(|m| m.ok_or_else(|| "it has no formula".into()));
            match (node.attribute(of), found.and_then(|e| written_out(e, functions, 0))) {
                (Some(id), Ok(e)) => Some((id.into(), e)),
                (None, _) => {
                    wrong.push(format!("line {}: `{of}` is missing", line(node)));
                    None
                }
                (Some(id), Err(e)) => {
                    wrong.push(format!("line {}: `{id}`: {e}", line(node)));
                    None
                }
            }
        };
        for node in list(model, "listOfRules", "assignmentRule") {
            self.assigned.extend(formula(node, "variable"));
        }
        for node in list(model, "listOfRules", "rateRule") {
            self.rates.extend(formula(node, "variable"));
        }
        for node in list(model, "listOfInitialAssignments", "initialAssignment") {
            self.initial.extend(formula(node, "symbol"));
        }
    }
}

fn species(node: Node<'_, '_>) -> Result<Species, String> {
    let compartment =
        node.attribute("compartment").ok_or_else(|| format!("line {}: a species without a compartment", line(node)))?;
    Ok(Species {
        id: id(node)?,
        compartment: compartment.into(),
        amount: value(node, "initialAmount")?,
        concentration: value(node, "initialConcentration")?,
        is_amount: is(node, "hasOnlySubstanceUnits"),
        is_held: is(node, "boundaryCondition") || is(node, "constant"),
    })
}

/// An event that happens at once.
fn event(node: Node<'_, '_>, functions: &Functions) -> Result<Event, String> {
    let child = |name: &str| node.children().find(|n| n.tag_name().name() == name);
    for (name, why) in [
        ("delay", "what happens after a delay is not read"),
        ("priority", "an order by priority is not read; events at one instant happen in the order of the text"),
    ] {
        if child(name).is_some() {
            return Err(why.into());
        }
    }
    let trigger = child("trigger").ok_or("it has no trigger")?;
    if trigger.attribute("initialValue") == Some("false") {
        return Err("a trigger that counts as false before the simulation begins is not read".into());
    }
    let formula = |node: Node<'_, '_>| -> Result<Expr, String> {
        let found = math(node).and_then(|m| m.ok_or_else(|| "it has no formula".into()))?;
        written_out(found, functions, 0)
    };
    let assigned = list(node, "listOfEventAssignments", "eventAssignment").map(|a| -> Result<(String, Expr), String> {
        let variable = a.attribute("variable").ok_or("an assignment without a variable")?;
        Ok((variable.to_string(), formula(a)?))
    });
    let assigned = assigned.collect::<Result<Vec<_>, String>>()?;
    Ok(Event { trigger: formula(trigger)?, assigned })
}

/// A reaction, and the parameters that its law has for itself, under names of their own.
fn reaction(node: Node<'_, '_>, functions: &Functions) -> Result<(Reaction, Vec<Constant>), String> {
    let own = id(node)?;
    let side = |list_of: &'static str| -> Result<Vec<(String, f64)>, String> {
        let each = list(node, list_of, "speciesReference").map(|s| {
            let species = s.attribute("species").ok_or("a reactant without a species")?;
            Ok((species.to_string(), value(s, "stoichiometry")?.unwrap_or(1.0)))
        });
        each.collect()
    };
    let (reactants, products) = (side("listOfReactants")?, side("listOfProducts")?);
    let Some(law) = node.children().find(|n| n.tag_name().name() == "kineticLaw") else {
        return Err(format!("reaction `{own}` has no kinetic law"));
    };
    let found = math(law).and_then(|m| m.ok_or_else(|| "its kinetic law has no formula".into()));
    let found = found.map_err(|e| format!("reaction `{own}`: {e}"))?;
    let mut local = Vec::new();
    let mut renamed = BTreeMap::new();
    for (list_of, item) in [("listOfParameters", "parameter"), ("listOfLocalParameters", "localParameter")] {
        for parameter in list(law, list_of, item) {
            let id = id(parameter)?;
            let global = format!("{own}_{id}");
            renamed.insert(id, Expr::Name(global.clone()));
            local.push(Constant { id: global, value: value(parameter, "value")? });
        }
    }
    let law = written_out(found.with(&renamed), functions, 0).map_err(|e| format!("reaction `{own}`: {e}"))?;
    Ok((Reaction { id: own, reactants, products, law }, local))
}

type Functions = BTreeMap<String, (Vec<String>, Expr)>;

fn functions(model: Node<'_, '_>, wrong: &mut Vec<String>) -> Functions {
    let mut found = Functions::new();
    for node in list(model, "listOfFunctionDefinitions", "functionDefinition") {
        match id(node).and_then(|id| Ok((id, lambda(node)?))) {
            Ok((id, function)) => {
                found.insert(id, function);
            }
            Err(e) => wrong.push(format!("line {}: {e}", line(node))),
        }
    }
    found
}

/// The same with functions of the model's own replaced by what they are.
fn written_out(e: Expr, functions: &Functions, depth: usize) -> Result<Expr, String> {
    let mut calls = false;
    e.walk(&mut |part| calls |= matches!(part, Expr::Apply(..)));
    if !calls {
        return Ok(e);
    }
    if depth > 16 {
        return Err("its functions call each other too deep, or in a circle".into());
    }
    let mut wrong = None;
    let replaced = e.map(&mut |part| match part {
        Expr::Apply(name, list) => match functions.get(&name) {
            Some((arguments, body)) if arguments.len() == list.len() => {
                let by: BTreeMap<String, Expr> = arguments.iter().cloned().zip(list).collect();
                let result = body.clone().with(&by);
                let mut parts = 0_usize;
                result.walk(&mut |_| parts += 1);
                // functions of functions of functions double each time
                if parts > LONGEST {
                    wrong = Some("its functions grow too large".into());
                    return Expr::Number(0.0);
                }
                result
            }
            Some((arguments, _)) => {
                wrong = Some(format!("`{name}` takes {} arguments, {} are given", arguments.len(), list.len()));
                Expr::Number(0.0)
            }
            None => {
                wrong = Some(format!("there is no function `{name}`"));
                Expr::Number(0.0)
            }
        },
        other => other,
    });
    match wrong {
        Some(wrong) => Err(wrong),
        None => written_out(replaced, functions, depth + 1),
    }
}
