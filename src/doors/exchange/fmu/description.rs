//! The file `modelDescription.xml`: variables with units and start values, and which depends on which.

use super::instance::TOLERANCE;
use super::resources::Contents;
use super::variables::{Kind, Variable, Variables};
use crate::Stamp;
use crate::xml::lines;
use fdm_grammar::Unit;
use fdm_grammar::graph::Leaf;
use fdm_grammar::op::ExprId;
use fdm_system::Model;
use fdm_units::Version;
use maud::{Markup, html};
use std::collections::BTreeSet;

/// The name of a unit's library: that of its model, as C may write it.
pub(super) fn identifier(model: &Model) -> String {
    let plain: String = model.name().chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    if plain.starts_with(|c: char| c.is_ascii_alphabetic()) { plain } else { format!("m{plain}") }
}

/// The description of a unit.
pub(super) fn description(contents: &Contents<'_>, stamp: &Stamp) -> String {
    let variables = Variables::of(contents.model);
    let structure = Structure::of(contents.model, &variables);
    let about = About { contents, stamp, variables: &variables, structure: &structure };
    let body = match contents.version {
        Version::Two => about.two(),
        Version::Three => about.three(),
    };
    format!("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<!-- {stamp} -->\n{}\n", lines(&body.into_string()))
}

/// A number as XML writes it.
fn number(value: f64) -> String {
    format!("{value:?}")
}

/// What the standard says of a kind of variable: causality, variability, and how its value begins.
fn words(variable: &Variable) -> (&'static str, &'static str, Option<&'static str>) {
    match variable.kind {
        Kind::Time => ("independent", "continuous", None),
        Kind::Parameter(_) | Kind::Known(_) if variable.initial => ("parameter", "fixed", Some("exact")),
        Kind::Parameter(_) | Kind::Known(_) => ("parameter", "tunable", Some("exact")),
        Kind::Input(_) => ("input", "continuous", None),
        Kind::Output(_) => ("output", "continuous", Some("calculated")),
        Kind::Derived(_) => ("calculatedParameter", "tunable", Some("calculated")),
        Kind::State(_) | Kind::Rate(_) | Kind::Indicator(_) => ("local", "continuous", Some("calculated")),
    }
}

/// On which variables others depend, by value references.
struct Structure {
    /// Of each output, and of each derivative of a state.
    outputs: Vec<BTreeSet<u32>>,
    rates: Vec<BTreeSet<u32>>,
}

impl Structure {
    fn of(model: &Model, variables: &Variables) -> Self {
        let (definition, layout) = (model.definition(), model.layout());
        let p = &layout.patterns;
        let moves = definition.graph.depends(|leaf| matches!(leaf, Leaf::Time | Leaf::Delayed(_)));
        let of = |count: usize, expr: &dyn Fn(usize) -> ExprId, patterns: [&fdm_grammar::Pattern; 3]| {
            let mut found = vec![BTreeSet::new(); count];
            let [by_state, by_input, by_delayed] = patterns;
            let mut add = |row: usize, reference: Option<u32>| found[row].extend(reference);
            by_state.entries().for_each(|(_, i, j)| add(i, variables.of_kind(Kind::State(j))));
            by_input.entries().for_each(|(_, i, j)| add(i, variables.of_kind(Kind::Input(j))));
            // a delay may be 0, and the past goes on with time
            by_delayed.entries().for_each(|(_, i, j)| add(i, variables.of_signal(layout.delayed[j])));
            (0..count).filter(|k| moves[expr(*k).index()]).for_each(|k| add(k, variables.of_kind(Kind::Time)));
            found
        };
        Self {
            outputs: of(
                layout.outputs,
                &|k| definition.outputs[k].expr,
                [&p.outputs_by_state, &p.outputs_by_input, &p.outputs_by_delayed],
            ),
            rates: of(
                layout.states,
                &|k| definition.states[k].rate,
                [&p.rates_by_state, &p.rates_by_input, &p.rates_by_delayed],
            ),
        }
    }
}

/// Everything that is described.
struct About<'a> {
    contents: &'a Contents<'a>,
    stamp: &'a Stamp,
    variables: &'a Variables,
    structure: &'a Structure,
}

impl About<'_> {
    fn tool(&self) -> String {
        format!("fdm {}", env!("CARGO_PKG_VERSION"))
    }

    /// What is said of a variable.
    fn doc(&self, variable: &Variable) -> Option<String> {
        let error = self.contents.errors.get(&variable.name).filter(|e| e.is_finite());
        let error = error.map(|e| format!("standard error {e:.3e}"));
        let parts: Vec<String> =
            Some(variable.doc.clone()).filter(|d| !d.is_empty()).into_iter().chain(error).collect();
        // what XML has no place for
        let text: String = parts.join("; ").chars().filter(|c| !c.is_control()).collect();
        Some(text).filter(|t| !t.is_empty())
    }

    /// The units, each once.
    fn units(&self) -> Vec<&Unit> {
        let mut seen = BTreeSet::new();
        let units = self.variables.list.iter().filter_map(|v| v.unit.as_ref());
        units.filter(|unit| seen.insert(unit.text())).collect()
    }

    fn unit_definitions(&self) -> Markup {
        let exponent = |unit: &Unit, k: usize| Some(unit.dimension[k]).filter(|e| *e != 0);
        let units = self.units();
        html! {
            @if !units.is_empty() {
                UnitDefinitions {
                    @for unit in units {
                        Unit name=(unit.text()) {
                            BaseUnit kg=[exponent(unit, 1)] m=[exponent(unit, 0)] s=[exponent(unit, 2)] A=[exponent(unit, 3)]
                                K=[exponent(unit, 4)] mol=[exponent(unit, 5)] cd=[exponent(unit, 6)]
                                factor=(number(unit.factor)) offset=(number(unit.offset)) {}
                        }
                    }
                }
            }
        }
    }

    fn bound(value: f64) -> Option<String> {
        value.is_finite().then(|| number(value))
    }

    /// The state of a rate.
    fn of_rate(&self, variable: &Variable) -> Option<u32> {
        match variable.kind {
            Kind::Rate(k) => self.variables.of_kind(Kind::State(k)),
            _ => None,
        }
    }

    /// Variables of which the standard wants to know what they depend on at the beginning.
    fn unknown_at_first(&self) -> impl Iterator<Item = u32> {
        let wanted =
            |v: &Variable| matches!(v.kind, Kind::State(_) | Kind::Rate(_) | Kind::Output(_) | Kind::Derived(_));
        self.variables.list.iter().enumerate().filter(move |(_, v)| wanted(v)).map(|(k, _)| k as u32)
    }

    fn reference(&self, kind: Kind) -> u32 {
        self.variables.of_kind(kind).unwrap_or_default()
    }

    fn indicators(&self) -> usize {
        2 * self.contents.model.layout().limited.len()
    }

    /// References as the version numbers variables.
    fn listed(&self, references: &BTreeSet<u32>, first: u32) -> String {
        references.iter().map(|r| (r + first).to_string()).collect::<Vec<_>>().join(" ")
    }

    fn two(&self) -> Markup {
        let model = self.contents.model;
        let (name, definition) = (identifier(model), model.definition());
        let doc =
            Some(definition.doc.chars().filter(|c| !c.is_control()).collect::<String>()).filter(|d| !d.is_empty());
        html! {
            fmiModelDescription fmiVersion="2.0" modelName=(model.name()) guid=(self.stamp.guid()) description=[doc]
                generationTool=(self.tool()) variableNamingConvention="flat" numberOfEventIndicators=(self.indicators()) {
                ModelExchange modelIdentifier=(name) canGetAndSetFMUstate="true" canSerializeFMUstate="true"
                    providesDirectionalDerivative="true" {}
                CoSimulation modelIdentifier=(name) canHandleVariableCommunicationStepSize="true" canInterpolateInputs="true"
                    maxOutputDerivativeOrder="0" canGetAndSetFMUstate="true" canSerializeFMUstate="true"
                    providesDirectionalDerivative="true" {}
                (self.unit_definitions())
                LogCategories { Category name="logStatusError" description="Why a call came to nothing" {} }
                DefaultExperiment startTime="0.0" tolerance=(number(TOLERANCE)) {}
                ModelVariables {
                    @for (k, v) in self.variables.list.iter().enumerate() {
                        @let (causality, variability, initial) = words(v);
                        ScalarVariable name=(v.name) valueReference=(k) description=[self.doc(v)] causality=(causality)
                            variability=(variability) initial=[initial] {
                            Real unit=[v.unit.as_ref().map(Unit::text)] min=[Self::bound(v.bounds.0)] max=[Self::bound(v.bounds.1)]
                                start=[v.start.map(number)] derivative=[self.of_rate(v).map(|r| r + 1)] {}
                        }
                    }
                }
                ModelStructure {
                    @if !self.structure.outputs.is_empty() {
                        Outputs {
                            @for (k, on) in self.structure.outputs.iter().enumerate() {
                                Unknown index=(self.reference(Kind::Output(k)) + 1) dependencies=(self.listed(on, 1)) {}
                            }
                        }
                    }
                    @if !self.structure.rates.is_empty() {
                        Derivatives {
                            @for (k, on) in self.structure.rates.iter().enumerate() {
                                Unknown index=(self.reference(Kind::Rate(k)) + 1) dependencies=(self.listed(on, 1)) {}
                            }
                        }
                    }
                    @if self.unknown_at_first().next().is_some() {
                        InitialUnknowns {
                            @for reference in self.unknown_at_first() {
                                Unknown index=(reference + 1) {}
                            }
                        }
                    }
                }
            }
        }
    }

    fn three(&self) -> Markup {
        let model = self.contents.model;
        let (name, definition) = (identifier(model), model.definition());
        let doc =
            Some(definition.doc.chars().filter(|c| !c.is_control()).collect::<String>()).filter(|d| !d.is_empty());
        html! {
            fmiModelDescription fmiVersion="3.0" modelName=(model.name()) instantiationToken=(self.stamp.guid()) description=[doc]
                generationTool=(self.tool()) variableNamingConvention="flat" {
                ModelExchange modelIdentifier=(name) canGetAndSetFMUState="true" canSerializeFMUState="true"
                    providesDirectionalDerivatives="true" providesAdjointDerivatives="true" needsCompletedIntegratorStep="true" {}
                CoSimulation modelIdentifier=(name) canGetAndSetFMUState="true" canSerializeFMUState="true"
                    providesDirectionalDerivatives="true" providesAdjointDerivatives="true"
                    canHandleVariableCommunicationStepSize="true" {}
                (self.unit_definitions())
                LogCategories { Category name="logStatusError" description="Why a call came to nothing" {} }
                DefaultExperiment startTime="0.0" tolerance=(number(TOLERANCE)) {}
                ModelVariables {
                    @for (k, v) in self.variables.list.iter().enumerate() {
                        @let (causality, variability, initial) = words(v);
                        Float64 name=(v.name) valueReference=(k) description=[self.doc(v)] causality=(causality)
                            variability=(variability) initial=[initial] unit=[v.unit.as_ref().map(Unit::text)]
                            min=[Self::bound(v.bounds.0)] max=[Self::bound(v.bounds.1)] start=[v.start.map(number)]
                            derivative=[self.of_rate(v)] {}
                    }
                }
                ModelStructure {
                    @for (k, on) in self.structure.outputs.iter().enumerate() {
                        Output valueReference=(self.reference(Kind::Output(k))) dependencies=(self.listed(on, 0)) {}
                    }
                    @for (k, on) in self.structure.rates.iter().enumerate() {
                        ContinuousStateDerivative valueReference=(self.reference(Kind::Rate(k))) dependencies=(self.listed(on, 0)) {}
                    }
                    @for reference in self.unknown_at_first() {
                        InitialUnknown valueReference=(reference) {}
                    }
                    @for k in 0..self.indicators() {
                        EventIndicator valueReference=(self.reference(Kind::Indicator(k))) {}
                    }
                }
            }
        }
    }
}
