//! SBML core, levels 2 and 3, as far as ordinary differential equations go: compartments, species, parameters, rules, initial assignments,
//! reactions, functions. What the language has not is refused in words ([`Sbml::read`]).

use crate::events::remember;
use crate::events::{Event, events};
use crate::expression::{Expr, LONGEST, times};
use crate::mathml::{lambda, math};
use fdm_readers::refuse_endless_xml;
use roxmltree::{Document, Node, ParsingOptions};
use std::collections::{BTreeMap, BTreeSet};

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
    /// Compartments whose sizes events set: amounts stay, concentrations jump.
    pub(crate) resized: BTreeSet<String>,
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
    /// The name of the number that turns what reactions make of it into its own unit.
    factor: Option<String>,
}

#[derive(Debug)]
pub(crate) struct Reaction {
    pub(crate) id: String,
    pub(crate) reactants: Vec<(String, Expr)>,
    pub(crate) products: Vec<(String, Expr)>,
    /// Amount for each unit of time.
    pub(crate) law: Expr,
}

/// Reads lists of elements of one kind.
pub(crate) fn list<'a>(
    model: Node<'a, 'a>,
    list: &'static str,
    item: &'static str,
) -> impl Iterator<Item = Node<'a, 'a>> {
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

pub(crate) fn line(node: Node<'_, '_>) -> u32 {
    node.document().text_pos_at(node.range().start).row
}

pub(crate) fn child<'a>(node: Node<'a, 'a>, name: &str) -> Option<Node<'a, 'a>> {
    node.children().find(|n| n.tag_name().name() == name)
}

fn is_third(node: Node<'_, '_>) -> bool {
    node.tag_name().namespace().is_some_and(|n| n.contains("level3"))
}

pub(crate) fn is(node: Node<'_, '_>, attribute: &str) -> bool {
    matches!(node.attribute(attribute), Some("true" | "1"))
}

/// Lists of a model that are read, or that do not change what it computes.
const LISTS: [&str; 14] = [
    "listOfFunctionDefinitions",
    "listOfUnitDefinitions",
    "listOfCompartmentTypes",
    "listOfSpeciesTypes",
    "listOfCompartments",
    "listOfSpecies",
    "listOfParameters",
    "listOfInitialAssignments",
    "listOfRules",
    "listOfConstraints",
    "listOfReactions",
    "listOfEvents",
    "annotation",
    "notes",
];

/// What the language has not, and what nobody here knows.
fn refuse(root: Node<'_, '_>, model: Node<'_, '_>, wrong: &mut Vec<String>) {
    for package in root.attributes().filter(|a| a.name() == "required" && a.namespace().is_some()) {
        if matches!(package.value(), "true" | "1") {
            let of = package.namespace().unwrap_or_default();
            wrong
                .push(format!("the package {of} changes what the model means, and is not read: write it in SBML core"));
        }
    }
    let core = root.tag_name().namespace();
    let strange =
        |n: &Node<'_, '_>| n.is_element() && n.tag_name().namespace() == core && !LISTS.contains(&n.tag_name().name());
    for node in model.children().filter(strange) {
        wrong.push(format!("line {}: `{}` is not known", line(node), node.tag_name().name()));
    }
    for node in model.descendants().filter(Node::is_element) {
        let id = node.attribute("id").map(|id| format!(" `{id}`")).unwrap_or_default();
        if node.tag_name().name() == "algebraicRule" {
            let why = "an algebraic rule is an equation without a rate: solve it for one of its names";
            wrong.push(format!("line {}: algebraicRule{id}: {why}", line(node)));
        }
        if node.tag_name().name() == "reaction" && is(node, "fast") {
            let why = "a fast reaction is an equilibrium, which is not read: give it a rate, or an assignment rule";
            wrong.push(format!("line {}: reaction{id}: {why}", line(node)));
        }
    }
}

/// Names that stand somewhere in a model: those that get a value, and all.
struct Mentioned<'a> {
    set: BTreeSet<&'a str>,
    all: BTreeSet<&'a str>,
    /// Identifiers of everything.
    taken: BTreeSet<&'a str>,
}

impl<'a> Mentioned<'a> {
    fn of(model: Node<'a, 'a>, outside: &BTreeSet<&'a str>) -> Self {
        let elements = || model.descendants().filter(Node::is_element);
        let targets = elements().flat_map(|n| [n.attribute("variable"), n.attribute("symbol")]).flatten();
        let set: BTreeSet<&str> = targets.chain(outside.iter().copied()).collect();
        let named = elements().filter(|n| n.tag_name().name() == "ci").filter_map(|n| n.text()).map(str::trim);
        let all = named.chain(set.iter().copied()).collect();
        Self { set, all, taken: elements().filter_map(|n| n.attribute("id")).collect() }
    }
}

impl Sbml {
    /// Reads the text of a file; `outside` are the names that tables give values to.
    ///
    /// # Errors
    /// Every part that is broken or has no counterpart, with its line.
    pub(crate) fn read(text: &str, outside: &BTreeSet<&str>) -> Result<Self, Vec<String>> {
        refuse_endless_xml(text.as_bytes()).map_err(|e| vec![format!("it is not read: {e}")])?;
        let options = ParsingOptions { allow_dtd: false, nodes_limit: 20_000_000, ..ParsingOptions::default() };
        let document = Document::parse_with_options(text, options).map_err(|e| vec![format!("it is not XML: {e}")])?;
        let root = document.root_element();
        if root.tag_name().name() != "sbml" {
            return Err(vec![format!("it is not SBML: its first element is `{}`", root.tag_name().name())]);
        }
        let Some(model) = child(root, "model") else {
            return Err(vec!["there is no `model` in it".into()]);
        };
        let (mut read, mut wrong) = (Self::default(), Vec::new());
        if root.attribute("level") == Some("1") {
            wrong.push("SBML of level 1 is not read; levels 2 and 3 are".into());
        }
        read.id = model.attribute("id").unwrap_or_default().into();
        read.name = model.attribute("name").unwrap_or_default().into();
        refuse(root, model, &mut wrong);
        let functions = functions(model, &mut wrong);
        read.declarations(model, &mut wrong);
        read.rules(model, &functions, &mut wrong);
        read.events = events(model, &functions, &mut wrong);
        let sizes = read.events.iter().flat_map(|e| &e.assigned).map(|(id, _)| id);
        read.resized = sizes.filter(|id| read.compartments.iter().any(|c| c.id == **id)).cloned().collect();
        for s in read.species.iter().filter(|s| !s.is_amount && read.resized.contains(&s.compartment)) {
            if read.rates.iter().any(|(id, _)| *id == s.id) {
                let (of, size) = (&s.id, &s.compartment);
                wrong.push(format!("an event sets the size of `{size}`, in which `{of}` has a rate rule for its concentration: give the rate of its amount (hasOnlySubstanceUnits)"));
            }
        }
        let names = Mentioned::of(model, outside);
        for node in list(model, "listOfReactions", "reaction") {
            if let Err(e) = read.reaction(node, &functions, &names) {
                wrong.push(format!("line {}: {e}", line(node)));
            }
        }
        read.targets(model, &mut wrong);
        wrong.extend(remember(&mut read));
        if wrong.is_empty() { Ok(read) } else { Err(wrong) }
    }

    /// Every name that can stand in a formula.
    pub(crate) fn ids(&self) -> impl Iterator<Item = &str> {
        let constants = self.compartments.iter().chain(&self.parameters).map(|c| c.id.as_str());
        let species = self.species.iter().map(|s| s.id.as_str());
        constants.chain(species).chain(self.reactions.iter().map(|r| r.id.as_str()))
    }

    /// Whatever a rule, an initial assignment or an event sets has to be something that is read, and nothing may stand there twice.
    fn targets(&self, model: Node<'_, '_>, wrong: &mut Vec<String>) {
        let mut known = BTreeSet::new();
        for id in self.ids() {
            if !known.insert(id) {
                wrong.push(format!("`{id}` is declared twice"));
            }
        }
        for node in model.descendants().filter(Node::is_element) {
            let what = match node.tag_name().name() {
                "initialAssignment" => "symbol",
                "assignmentRule" | "rateRule" | "eventAssignment" => "variable",
                _ => continue,
            };
            if let Some(id) = node.attribute(what).filter(|id| !known.contains(id)) {
                let said = "there is no compartment, species, parameter or species reference of this name";
                wrong.push(format!("line {}: `{}` of `{id}`: {said}", line(node), node.tag_name().name()));
            }
        }
    }

    /// A reaction, and the parameters that its law has for itself, under names of their own.
    fn reaction(&mut self, node: Node<'_, '_>, functions: &Functions, names: &Mentioned<'_>) -> Result<(), String> {
        let own = id(node)?;
        let of = |e: String| format!("reaction `{own}`: {e}");
        let (mut reactants, mut products) = (Vec::new(), Vec::new());
        for (list_of, side) in [("listOfReactants", &mut reactants), ("listOfProducts", &mut products)] {
            for s in list(node, list_of, "speciesReference") {
                let species = s.attribute("species").ok_or_else(|| of("a reactant without a species".into()))?;
                let own = s.attribute("id").filter(|id| names.all.contains(id));
                let count = stoichiometry(s, functions, own.is_some_and(|id| names.set.contains(id))).map_err(of)?;
                if let Some(id) = own.map(String::from) {
                    match (child(s, "stoichiometryMath"), &count) {
                        (Some(_), e) => {
                            self.assigned.push((id.clone(), e.clone()));
                            self.parameters.push(Constant { id, value: None });
                        }
                        (None, _) => self.parameters.push(Constant { id, value: value(s, "stoichiometry")? }),
                    }
                }
                let found = self.species.iter().find(|s| s.id == species);
                let found = found.ok_or_else(|| of(format!("there is no species `{species}`")))?;
                let factor = found.factor.clone().map_or(Expr::Number(1.0), Expr::Name);
                side.push((species.to_string(), times(count, factor)));
            }
        }
        let Some(law) = child(node, "kineticLaw") else { return Err(of("it has no kinetic law".into())) };
        let found = math(law).and_then(|m| m.ok_or_else(|| "its kinetic law has no formula".into())).map_err(of)?;
        let mut renamed = BTreeMap::new();
        for (list_of, item) in [("listOfParameters", "parameter"), ("listOfLocalParameters", "localParameter")] {
            for parameter in list(law, list_of, item) {
                let id = id(parameter)?;
                let mut global = format!("{own}_{id}");
                while names.taken.contains(global.as_str()) {
                    global.push('_');
                }
                renamed.insert(id, Expr::Name(global.clone()));
                self.parameters.push(Constant { id: global, value: value(parameter, "value")? });
            }
        }
        let law = written_out(found.with(&renamed), functions, 0).map_err(of)?;
        self.reactions.push(Reaction { id: own, reactants, products, law });
        Ok(())
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
            // level 2 means 1 where no size stands
            let given = |c: Constant| Constant { value: c.value.or((!is_third(node)).then_some(1.0)), ..c };
            self.compartments.extend(constant(node, "size").map(given));
        }
        for node in list(model, "listOfParameters", "parameter") {
            self.parameters.extend(constant(node, "value"));
        }
        let factor = model.attribute("conversionFactor").map(String::from);
        for node in list(model, "listOfSpecies", "species") {
            match species(node) {
                Ok(species) => self.species.push(Species { factor: species.factor.or(factor.clone()), ..species }),
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
            let found = math(node).and_then(|m| m.map(|e| written_out(e, functions, 0)).transpose());
            match (node.attribute(of), found) {
                // without a formula it says nothing (level 3 version 2)
                (Some(id), Ok(e)) => e.map(|e| (id.into(), e)),
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
        factor: node.attribute("conversionFactor").map(String::from),
    })
}

/// How many of a species a reaction makes or takes: a number, or the name of what says so.
fn stoichiometry(node: Node<'_, '_>, functions: &Functions, is_set: bool) -> Result<Expr, String> {
    let id = node.attribute("id");
    if let Some(formula) = child(node, "stoichiometryMath") {
        let found = math(formula)?.ok_or_else(|| format!("line {}: stoichiometryMath has no formula", line(node)))?;
        return written_out(found, functions, 0);
    }
    match (value(node, "stoichiometry")?, id) {
        (_, Some(id)) if is_set => Ok(Expr::Name(id.into())),
        (Some(number), _) => Ok(Expr::Number(number)),
        // level 3 has no number that is meant where none stands
        (None, _) if is_third(node) => {
            let of = node.attribute("species").unwrap_or_default();
            Err(format!("line {}: the stoichiometry of `{of}` has no value", line(node)))
        }
        (None, _) => Ok(Expr::Number(1.0)),
    }
}

pub(crate) type Functions = BTreeMap<String, (Vec<String>, Expr)>;

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

/// An expression with functions of the model's own replaced by what they are.
pub(crate) fn written_out(e: Expr, functions: &Functions, depth: usize) -> Result<Expr, String> {
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
