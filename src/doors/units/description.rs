//! What a unit says of itself: `modelDescription.xml` ([`Description`]).

use crate::archive::{DESCRIPTION, Files, UnitError, Version, library_name};
use fdm_readers::refuse_endless_xml;
use roxmltree::{Document, Node, ParsingOptions};
use std::collections::HashMap;

/// A real variable of a unit.
#[derive(Debug, Clone, PartialEq)]
pub struct Variable {
    /// As the unit calls it.
    pub name: String,
    /// What the unit says of it; may be empty.
    pub doc: String,
    /// Its unit of measurement, as written.
    pub unit: Option<String>,
    /// How functions of the standard call it.
    pub reference: u32,
    /// Its value at the start, where one is given.
    pub start: Option<f64>,
    /// Its usual size, where one is given.
    pub nominal: Option<f64>,
    /// Admissible values; infinite where there is no bound.
    pub bounds: (f64, f64),
}

/// A continuous state.
#[derive(Debug, Clone, PartialEq)]
pub struct State {
    /// The state.
    pub variable: Variable,
    /// Its derivative's reference.
    pub rate: u32,
    /// Whether the start is given (`initial="exact"`) and not computed.
    pub exact: bool,
}

/// What a rate or an output depends on.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Dependence {
    /// Time.
    pub time: bool,
    /// Each state (n).
    pub states: Vec<bool>,
    /// Each input (m).
    pub inputs: Vec<bool>,
}

/// What a unit says of itself.
#[derive(Debug, Clone, PartialEq)]
pub struct Description {
    /// Of the standard.
    pub version: Version,
    /// Its model's name.
    pub name: String,
    /// What it says of its model; may be empty.
    pub doc: String,
    /// What made it; may be empty.
    pub tool: String,
    /// What an instance is made with.
    pub token: String,
    /// The name of its library.
    pub identifier: String,
    /// Where its library stands in the archive.
    pub library: String,
    /// Whether it has derivatives along directions.
    pub directional: bool,
    /// Its states.
    pub states: Vec<State>,
    /// Its inputs.
    pub inputs: Vec<Variable>,
    /// Its parameters.
    pub parameters: Vec<Variable>,
    /// Its outputs that are no states.
    pub outputs: Vec<Variable>,
    /// What the rates depend on, then the outputs.
    pub dependences: Vec<Dependence>,
    /// Event indicators.
    pub indicators: usize,
    /// When its usual experiment begins.
    pub start_time: f64,
    /// What it counts time in, where that is said.
    pub time_unit: Option<String>,
}

/// The description of a unit, and the files that its code needs: its library and its resources.
pub(crate) fn of(files: Files) -> Result<(Description, Files), UnitError> {
    let unsuited = |said: String| Err(UnitError::Unsuited(said));
    let Some((_, xml)) = files.iter().find(|(name, _)| name == DESCRIPTION) else {
        return unsuited(format!("it is no functional mock-up unit: the archive holds no {DESCRIPTION}"));
    };
    let Ok(text) = std::str::from_utf8(xml) else {
        return unsuited(format!("its {DESCRIPTION} is not UTF-8 text"));
    };
    let description = parsed(text)?;
    let others = || {
        let mut folders: Vec<&str> =
            files.iter().filter_map(|(name, _)| name.strip_prefix("binaries/")?.split('/').next()).collect();
        folders.sort_unstable();
        folders.dedup();
        folders.join(", ")
    };
    if !files.iter().any(|(name, _)| *name == description.library) {
        let there = match others() {
            none if none.is_empty() => "it holds source only, or nothing that runs".into(),
            folders => format!("it holds libraries for {folders}"),
        };
        return unsuited(format!("the unit has no library for this machine (`{}`): {there}", description.library));
    }
    let library = description.library.clone();
    let needed = |name: &str| name == library || name.starts_with("resources/") || name.starts_with(folder(&library));
    Ok((description, files.into_iter().filter(|(name, _)| needed(name)).collect()))
}

/// A library may need others beside it.
fn folder(library: &str) -> &str {
    library.rfind('/').map_or(library, |end| &library[..=end])
}

/// A variable with what the standard says of its kind.
struct Listed<'a> {
    variable: Variable,
    causality: &'a str,
    variability: &'a str,
    initial: &'a str,
    /// The state whose derivative it is: its place among the variables (2.0), its reference (3.0).
    derivative: Option<u32>,
    is_real: bool,
    is_array: bool,
}

fn parsed(text: &str) -> Result<Description, UnitError> {
    refuse_endless_xml(text.as_bytes()).map_err(|e| UnitError::Unsuited(format!("in its {DESCRIPTION} {e}")))?;
    // most elements and texts of a description: each takes some hundred bytes of memory, of which all stay below 2
    // GiB
    let options = ParsingOptions { nodes_limit: 20_000_000, ..ParsingOptions::default() };
    let document = Document::parse_with_options(text, options)?;
    let root = document.root_element();
    let unsuited = |said: String| Err(UnitError::Unsuited(said));
    let version = match root.attribute("fmiVersion").unwrap_or_default() {
        two if two.starts_with("2.") => Version::Two,
        three if three.starts_with("3.") => Version::Three,
        other => return unsuited(format!("the unit is of FMI {other}; 2.0 and 3.0 are known")),
    };
    let child = |name: &str| root.children().find(|n| n.has_tag_name(name));
    let Some(exchange) = child("ModelExchange") else {
        return unsuited(
            "the unit is for co-simulation only, with a solver of its own, and has no rates of states to give; export it for model exchange"
                .into(),
        );
    };
    let flag = |node: Node<'_, '_>, name: &str| matches!(node.attribute(name), Some("true" | "1"));
    if flag(exchange, "needsExecutionTool") {
        return unsuited("the unit needs the tool that made it (`needsExecutionTool`)".into());
    }
    if flag(exchange, "canBeInstantiatedOnlyOncePerProcess") {
        return unsuited(
            "the unit allows one instance in a process; derivatives and threads need several (`canBeInstantiatedOnlyOncePerProcess`)".into(),
        );
    }
    let types = types(root);
    let list = child("ModelVariables").map_or_else(Vec::new, |node| {
        node.children().filter(Node::is_element).map(|node| listed(node, version, &types)).collect::<Vec<_>>()
    });
    let identifier = exchange.attribute("modelIdentifier").unwrap_or_default().to_string();
    if identifier.is_empty() || identifier.contains(['/', '\\', '.']) {
        return unsuited(format!("the name of the unit's library, `{identifier}`, is none"));
    }
    let token = if version == Version::Two { "guid" } else { "instantiationToken" };
    let mut description = Description {
        version,
        name: root.attribute("modelName").unwrap_or(&identifier).to_string(),
        doc: root.attribute("description").unwrap_or_default().to_string(),
        tool: root.attribute("generationTool").unwrap_or_default().to_string(),
        token: root.attribute(token).unwrap_or_default().to_string(),
        library: library_name(version, &identifier),
        identifier,
        directional: flag(exchange, "providesDirectionalDerivative")
            || flag(exchange, "providesDirectionalDerivatives"),
        states: Vec::new(),
        inputs: Vec::new(),
        parameters: Vec::new(),
        outputs: Vec::new(),
        dependences: Vec::new(),
        indicators: 0,
        time_unit: list.iter().find(|v| v.causality == "independent").and_then(|v| v.variable.unit.clone()),
        start_time: child("DefaultExperiment")
            .and_then(|node| node.attribute("startTime"))
            .and_then(number)
            .unwrap_or(0.0),
    };
    let structure = Structure::read(child("ModelStructure"), version);
    description.indicators = match version {
        Version::Two => root.attribute("numberOfEventIndicators").and_then(|n| n.trim().parse().ok()).unwrap_or(0),
        Version::Three => structure.indicators,
    };
    description.fill(&list, &structure, version)?;
    Ok(description)
}

impl Description {
    fn fill(&mut self, list: &[Listed<'_>], structure: &Structure, version: Version) -> Result<(), UnitError> {
        let unsuited = |said: String| Err(UnitError::Unsuited(said));
        // what the structure calls a variable
        let by_name: HashMap<u32, usize> = list
            .iter()
            .enumerate()
            .map(|(k, v)| (if version == Version::Two { k as u32 + 1 } else { v.variable.reference }, k))
            .collect();
        let find = |called: &u32| by_name.get(called).map(|k| (*k, &list[*k]));
        let mut of_state: HashMap<usize, usize> = HashMap::new();
        for (called, _) in &structure.rates {
            let state = find(called).and_then(|(_, rate)| Some((rate, find(&rate.derivative?)?)));
            let Some((rate, (place, state))) = state else {
                return unsuited(format!(
                    "the unit's description is wrong: variable {called} is the derivative of no state"
                ));
            };
            if state.is_array || !state.is_real || !rate.is_real {
                return unsuited(format!(
                    "state `{}` of the unit is an array, or no number of 64 bits",
                    state.variable.name
                ));
            }
            of_state.insert(place, self.states.len());
            let exact = state.variable.start.is_some() && matches!(state.initial, "exact" | "");
            self.states.push(State { variable: state.variable.clone(), rate: rate.variable.reference, exact });
        }
        let mut of_input: HashMap<usize, usize> = HashMap::new();
        for (k, v) in list.iter().enumerate().filter(|(_, v)| v.is_real) {
            match v.causality {
                "input" if v.is_array => {
                    return unsuited(format!("input `{}` of the unit is an array", v.variable.name));
                }
                // others keep their values: they may move at events only
                "input" if v.variability == "continuous" => {
                    of_input.insert(k, self.inputs.len());
                    self.inputs.push(v.variable.clone());
                }
                "parameter" if !v.is_array && v.variable.start.is_some() => self.parameters.push(v.variable.clone()),
                _ => {}
            }
        }
        let clock = list.iter().position(|v| v.causality == "independent");
        let dependence = |on: &Option<Vec<u32>>| {
            let (n, m) = (self.states.len(), self.inputs.len());
            let all = |time| Dependence { time, states: vec![true; n], inputs: vec![true; m] };
            let Some(on) = on else { return all(true) };
            // where time is no variable, it cannot be told that something depends on it
            let mut found = Dependence { time: clock.is_none(), states: vec![false; n], inputs: vec![false; m] };
            for called in on {
                match find(called) {
                    Some((k, _)) if Some(k) == clock => found.time = true,
                    Some((k, _)) if of_state.contains_key(&k) => found.states[of_state[&k]] = true,
                    Some((k, _)) if of_input.contains_key(&k) => found.inputs[of_input[&k]] = true,
                    Some((_, v)) if v.causality.ends_with("arameter") || v.variability == "constant" => {}
                    Some((_, v)) if v.causality == "input" => {}
                    // something in between, which may depend on anything
                    _ => return all(true),
                }
            }
            found
        };
        self.dependences = structure.rates.iter().map(|(_, on)| dependence(on)).collect();
        let mut outputs = Vec::new();
        for (called, on) in &structure.outputs {
            let Some((k, v)) = find(called) else { continue };
            if v.is_real && !v.is_array && !of_state.contains_key(&k) {
                outputs.push(v.variable.clone());
                self.dependences.push(dependence(on));
            }
        }
        self.outputs = outputs;
        Ok(())
    }

    /// Whether time is an argument of any function.
    pub(crate) fn moves(&self) -> bool {
        self.dependences.iter().any(|d| d.time)
    }
}

/// Units and sizes of named types.
type Types<'a> = HashMap<&'a str, (Option<&'a str>, Option<f64>)>;

fn types<'a>(root: Node<'a, '_>) -> Types<'a> {
    let definitions = root.children().find(|n| n.has_tag_name("TypeDefinitions"));
    let mut types = Types::new();
    for node in definitions.into_iter().flat_map(|d| d.children()).filter(Node::is_element) {
        // in 2.0 a simple type holds an element with the attributes of reals
        let inner = if node.has_tag_name("SimpleType") { node.children().find(Node::is_element) } else { Some(node) };
        if let (Some(name), Some(inner)) = (node.attribute("name"), inner) {
            types.insert(name, (inner.attribute("unit"), inner.attribute("nominal").and_then(number)));
        }
    }
    types
}

fn listed<'a>(node: Node<'a, '_>, version: Version, types: &Types<'a>) -> Listed<'a> {
    let inner = match version {
        Version::Two => node.children().find(Node::is_element).unwrap_or(node),
        Version::Three => node,
    };
    let of_type = inner.attribute("declaredType").and_then(|name| types.get(name)).copied().unwrap_or_default();
    let attribute = |name: &str| inner.attribute(name).and_then(number);
    let whole = |node: Node<'_, '_>, name: &str| node.attribute(name).and_then(|n| n.trim().parse().ok());
    let variable = Variable {
        name: node.attribute("name").unwrap_or_default().to_string(),
        doc: node.attribute("description").unwrap_or_default().to_string(),
        unit: inner.attribute("unit").or(of_type.0).map(str::to_string),
        reference: whole(node, "valueReference").unwrap_or(u32::MAX),
        start: attribute("start"),
        nominal: attribute("nominal").or(of_type.1),
        bounds: (attribute("min").unwrap_or(f64::NEG_INFINITY), attribute("max").unwrap_or(f64::INFINITY)),
    };
    Listed {
        variable,
        causality: node.attribute("causality").unwrap_or("local"),
        variability: node.attribute("variability").unwrap_or("continuous"),
        initial: node.attribute("initial").unwrap_or_default(),
        derivative: whole(inner, "derivative"),
        is_real: inner.has_tag_name(if version == Version::Two { "Real" } else { "Float64" }),
        is_array: node.children().any(|n| n.has_tag_name("Dimension")),
    }
}

/// Finite numbers only.
fn number(text: &str) -> Option<f64> {
    text.trim().parse().ok().filter(|v: &f64| v.is_finite())
}

/// Which variables are outputs and rates, and on what they say that they depend.
struct Structure {
    outputs: Vec<(u32, Option<Vec<u32>>)>,
    rates: Vec<(u32, Option<Vec<u32>>)>,
    indicators: usize,
}

impl Structure {
    fn read(node: Option<Node<'_, '_>>, version: Version) -> Self {
        let mut found = Self { outputs: Vec::new(), rates: Vec::new(), indicators: 0 };
        let Some(node) = node else { return found };
        let unknown = |node: Node<'_, '_>, name: &str| {
            let on = node.attribute("dependencies");
            let on = on.map(|list| list.split_whitespace().map(|n| n.parse().unwrap_or(u32::MAX)).collect());
            Some((node.attribute(name)?.trim().parse().ok()?, on))
        };
        let elements =
            |node: Node<'_, '_>| node.children().filter(Node::is_element).map(|n| n.id()).collect::<Vec<_>>();
        let at = |id| node.document().get_node(id);
        for part in elements(node).into_iter().filter_map(at) {
            let inner = || elements(part).into_iter().filter_map(at).filter_map(|n| unknown(n, "index"));
            match (version, part.tag_name().name()) {
                (Version::Two, "Outputs") => found.outputs.extend(inner()),
                (Version::Two, "Derivatives") => found.rates.extend(inner()),
                (Version::Three, "Output") => found.outputs.extend(unknown(part, "valueReference")),
                (Version::Three, "ContinuousStateDerivative") => found.rates.extend(unknown(part, "valueReference")),
                (Version::Three, "EventIndicator") => found.indicators += 1,
                _ => {}
            }
        }
        found
    }
}
