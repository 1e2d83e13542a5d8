//! From SBML and tables to the statements of a model: which names are states, which are known in each experiment, which follow from others.

use crate::Import;
use crate::events::Event;
use crate::experiments::{Channel, Phases, cell, cells, written};
use crate::experiments::{Experiment, Measured, Scale, measured, switch};
use crate::expression::Names;
use crate::expression::{Expr, Sign, binary, name, times};
use crate::records::{Records, Switch, lead};
use crate::sbml::{Constant, Reaction, Sbml, Species};
use crate::tables::{NEVER, Setting, just_before};
use crate::tables::{Problem, Row};
use crate::writing;
use std::collections::{BTreeMap, BTreeSet};

/// What a name of the model is.
#[derive(Debug)]
pub(crate) enum Definition {
    /// `const`.
    Number(f64),
    /// `let`.
    Let(Expr),
    /// `param`.
    Param(Param),
}

/// A parameter of the table.
#[derive(Debug)]
pub(crate) struct Param {
    pub(crate) value: f64,
    /// Bounds, where it is estimated.
    pub(crate) bounds: Option<(f64, f64)>,
    pub(crate) scale: Scale,
    /// Mean and deviation of a normal prior, on its scale.
    pub(crate) prior: Option<(f64, f64)>,
    pub(crate) title: Option<String>,
}

/// A state and how it changes.
#[derive(Debug)]
pub(crate) struct State {
    pub(crate) id: String,
    pub(crate) initial: Expr,
    /// Its equation; none where the reactions give it.
    pub(crate) rate: Option<Expr>,
    /// The reactions are a part of its equation.
    pub(crate) reacts: bool,
    pub(crate) title: Option<String>,
}

/// A line of `reactions`.
#[derive(Debug)]
pub(crate) struct Line {
    pub(crate) left: Vec<(String, f64)>,
    pub(crate) right: Vec<(String, f64)>,
    pub(crate) rate: Expr,
}

/// A model in the words of the problem.
#[derive(Debug, Default)]
pub(crate) struct Statements {
    pub(crate) title: String,
    /// In the order of the text.
    pub(crate) definitions: Vec<(String, Definition)>,
    pub(crate) channels: Vec<Channel>,
    pub(crate) switches: Vec<Switch>,
    pub(crate) states: Vec<State>,
    pub(crate) lines: Vec<Line>,
    /// Conditions, and the states that get new values when they become true.
    pub(crate) events: Vec<(Expr, Vec<(String, Expr)>)>,
    /// What is an output where nothing was measured.
    pub(crate) shown: Vec<String>,
    pub(crate) remarks: Vec<String>,
    pub(crate) titles: BTreeMap<String, String>,
}

/// A problem becomes a model and its records.
pub(crate) fn problem(problem: &Problem, stem: &str) -> Result<Import, Vec<String>> {
    let of_file = |e: Vec<String>| e.into_iter().map(|e| format!("{}: {e}", problem.sbml_file)).collect::<Vec<_>>();
    let given = problem.parameters.iter().filter_map(|row| row.get("parameterId"));
    let changed = problem.changes.iter().flat_map(|c| c.by_experiment.values()).flat_map(|(_, sets)| sets);
    let given = given.chain(problem.overridden.iter().map(String::as_str)).chain(changed.map(|(id, _)| id.as_str()));
    let sbml = Sbml::read(&problem.sbml, &given.collect()).map_err(of_file);
    let mut names = Names::default();
    if let Ok(sbml) = &sbml {
        sbml.ids().for_each(|id| names.keep(id));
    }
    let known: BTreeSet<String> = sbml.iter().flat_map(Sbml::ids).map(String::from).collect();
    let outside = problem
        .parameters
        .iter()
        .filter_map(|row| row.get("parameterId"))
        .chain(problem.overridden.iter().map(String::as_str));
    let mut further = BTreeSet::new();
    outside.filter(|id| !known.contains(*id)).for_each(|id| {
        if further.insert(id) {
            names.keep(id);
        }
    });
    let is_taken = |id: &str| known.contains(id) || further.contains(id);
    let measured = measured(problem, &is_taken, &mut |wanted| names.fresh(wanted));
    let (mut sbml, measured) = match (sbml, measured) {
        (Ok(sbml), Ok(measured)) => (sbml, measured),
        (sbml, measured) => return Err(sbml.err().into_iter().chain(measured.err()).flatten().collect()),
    };
    if !sbml.events.is_empty() && measured.experiments.iter().any(|e| e.before.is_some()) {
        return Err(vec![format!("{}: events beside a pre-equilibration are not read", problem.sbml_file)]);
    }
    let channels = changes(problem, &measured, &mut sbml, &mut names)?;
    let mut builder = Builder::new(&sbml, Some(problem), measured, names);
    builder.statements.channels = channels;
    builder.import(stem)
}

/// What changes in the middle of experiments becomes events at times that each run brings.
fn changes(
    problem: &Problem,
    measured: &Measured,
    sbml: &mut Sbml,
    names: &mut Names,
) -> Result<Vec<Channel>, Vec<String>> {
    let mut channels = Vec::new();
    for change in &problem.changes {
        let of: Vec<Option<&Setting>> = (measured.experiments.iter())
            .map(|e| change.by_experiment.get(problem.conditions.get(e.condition)?.get("conditionId")?))
            .collect();
        let mut targets: Vec<&String> = Vec::new();
        for (target, _) in of.iter().flatten().flat_map(|(_, sets)| sets) {
            if !targets.contains(&target) {
                targets.push(target);
            }
        }
        if targets.is_empty() {
            continue;
        }
        let own = names.fresh("time_of_change");
        let at = |change: &Option<&Setting>| change.map_or(NEVER, |(time, _)| just_before(*time));
        let values = of.iter().map(|change| [at(change); 2]).collect();
        let about = "when values change in the middle of the experiment".into();
        channels.push(Channel { name: own.clone(), about, values });
        let mut assigned = Vec::new();
        for target in targets {
            let formula = |change: &Option<&Setting>| -> Option<Expr> {
                let (_, sets) = (*change)?;
                let set = sets.iter().find(|(own, _)| own == target);
                Some(set.and_then(|(_, row)| cell(row, "targetValue")).unwrap_or_else(|| name(target)))
            };
            // where the event never happens its value is of no consequence
            let Some(any) = of.iter().find_map(formula) else { continue };
            let values: Phases<Expr> = of
                .iter()
                .map(|change| formula(change).unwrap_or_else(|| any.clone()))
                .map(|e| [e.clone(), e])
                .collect();
            let (e, channel) = written(&format!("{target}_new"), &values, &mut |wanted| names.fresh(wanted));
            channels.extend(channel);
            assigned.push((target.clone(), e));
        }
        sbml.events.push(Event { trigger: binary(Sign::AtLeast, Expr::Time, name(&own)), assigned, from_start: false });
    }
    Ok(channels)
}

/// An SBML model alone becomes a model whose outputs are its states.
pub(crate) fn model(text: &str, file: &str, stem: &str) -> Result<Import, Vec<String>> {
    let sbml = Sbml::read(text, &BTreeSet::new())
        .map_err(|e| e.into_iter().map(|e| format!("{file}: {e}")).collect::<Vec<_>>())?;
    let mut names = Names::default();
    sbml.ids().for_each(|id| names.keep(id));
    Builder::new(&sbml, None, Measured::default(), names).import(stem)
}

struct Builder<'a> {
    sbml: &'a Sbml,
    problem: Option<&'a Problem>,
    measured: Measured,
    names: Names,
    statements: Statements,
    wrong: Vec<String>,
    /// States that get a new value when the experiment begins, with the names that they have for it.
    reset: Vec<Reset>,
    /// Species whose compartment changes its size, with the states that are their amounts.
    counted: BTreeMap<String, String>,
}

/// How a state is set when the experiment begins: it is the sum of what it was before (or its new value) and of its change since.
#[derive(Debug, Clone)]
struct Reset {
    id: String,
    /// The state until time 0, which stays what it was then.
    before: String,
    /// Its change from time 0.
    change: String,
    /// Input: whether what was before counts.
    kept: String,
    /// Its value at the beginning, and its new value.
    value: Expr,
}

impl<'a> Builder<'a> {
    fn new(sbml: &'a Sbml, problem: Option<&'a Problem>, measured: Measured, names: Names) -> Self {
        let (statements, wrong, reset, counted) = Default::default();
        Self { sbml, problem, measured, names, statements, wrong, reset, counted }
    }

    fn import(mut self, stem: &str) -> Result<Import, Vec<String>> {
        self.build()?;
        self.finish(stem)
    }

    fn build(&mut self) -> Result<(), Vec<String>> {
        let sbml = self.sbml;
        self.statements.title = if sbml.name.is_empty() { sbml.id.clone() } else { sbml.name.clone() };
        self.statements.titles = sbml.titles.clone();
        self.params();
        let states = self.state_ids();
        self.refuse_overrides();
        self.constants(&states);
        let mut initials: Vec<(String, Expr)> = states.iter().map(|id| (id.clone(), self.initial(id))).collect();
        self.begin(&mut initials);
        for (id, e) in &sbml.assigned {
            self.define(id, Definition::Let(e.clone()));
        }
        self.balances(&states, &initials);
        self.events(&initials);
        self.switches();
        self.shown();
        if self.wrong.is_empty() { Ok(()) } else { Err(std::mem::take(&mut self.wrong)) }
    }

    /// What a model without measurements shows: its states, and what follows from them; where nothing changes, everything.
    fn shown(&mut self) {
        let species = self.sbml.species.iter().map(|s| s.id.as_str());
        let follows: BTreeSet<&str> = self.sbml.assigned.iter().map(|(id, _)| id.as_str()).chain(species).collect();
        let Statements { states, definitions, shown, .. } = &mut self.statements;
        if self.problem.is_some() {
            return;
        }
        let is_let = |d: &Definition| matches!(d, Definition::Let(_));
        shown.extend(states.iter().map(|s| s.id.clone()));
        shown.extend(
            definitions.iter().filter(|(id, d)| is_let(d) && follows.contains(id.as_str())).map(|(id, _)| id.clone()),
        );
        if shown.is_empty() {
            shown.extend(definitions.iter().map(|(id, _)| id.clone()));
        }
    }

    fn define(&mut self, id: &str, definition: Definition) {
        self.statements.definitions.push((id.into(), definition));
    }

    fn param_row(&self, id: &str) -> Option<&Row> {
        self.problem?.parameters.iter().find(|row| row.get("parameterId") == Some(id))
    }

    /// Parameters of the table.
    fn params(&mut self) {
        let problem = self.problem;
        for row in problem.iter().flat_map(|p| &p.parameters) {
            match param(row, &mut self.statements.remarks) {
                Ok((id, param)) => self.define(&id, Definition::Param(param)),
                Err(e) => self.wrong.push(e),
            }
        }
    }

    fn is_assigned(&self, id: &str) -> bool {
        self.sbml.assigned.iter().any(|(a, _)| a == id)
    }

    /// Whether a rule, an initial assignment or a table says what it is.
    fn is_set(&self, id: &str) -> bool {
        let by_table = |p: &Problem| p.overridden.iter().any(|c| c == id);
        self.is_assigned(id)
            || self.sbml.initial.contains_key(id)
            || self.param_row(id).is_some()
            || self.problem.is_some_and(by_table)
    }

    fn rate(&self, id: &str) -> Option<&Expr> {
        self.sbml.rates.iter().find(|(r, _)| r == id).map(|(_, e)| e)
    }

    /// Names with a derivative, in the order of the file.
    fn state_ids(&self) -> Vec<String> {
        let reacts: BTreeSet<&str> = (self.sbml.reactions.iter())
            .flat_map(|r| r.reactants.iter().chain(&r.products))
            .map(|(id, _)| id.as_str())
            .collect();
        let set = |id: &str| self.sbml.events.iter().flat_map(|e| &e.assigned).any(|(own, _)| own == id);
        let is_state = |id: &str, is_held: bool| {
            self.rate(id).is_some() || (reacts.contains(id) && !is_held || set(id)) && !self.is_assigned(id)
        };
        let species = self.sbml.species.iter().filter(|s| is_state(&s.id, s.is_held)).map(|s| s.id.clone());
        let others = self.sbml.parameters.iter().chain(&self.sbml.compartments);
        species.chain(others.filter(|p| is_state(&p.id, true)).map(|p| p.id.clone())).collect()
    }

    /// Columns of the table of conditions that mean nothing here.
    fn refuse_overrides(&mut self) {
        let Some(problem) = self.problem else { return };
        for column in &problem.overridden {
            if self.is_assigned(column) {
                self.wrong
                    .push(format!("the table of conditions sets `{column}`, which follows from a rule at all times"));
            }
        }
    }

    fn cells(&self, id: &str) -> Option<Phases<Option<Expr>>> {
        let problem = self.problem?;
        let used = problem.overridden.iter().any(|c| c == id);
        used.then(|| cells(&problem.conditions, &self.measured.experiments, id))
    }

    /// Everything that does not change by itself: parameters, compartments, species that nothing changes, and what only tables name.
    fn constants(&mut self, states: &[String]) {
        let sbml = self.sbml;
        let bare = sbml.compartments.iter().filter(|c| c.value.is_none() && !self.is_set(&c.id));
        let told = |c: &Constant| format!("the compartment `{}` has no size in the model: it is 1", c.id);
        let mut remarks: Vec<String> = bare.map(told).collect();
        let compartments = sbml.compartments.iter().map(|c| (c.id.clone(), c.value.or(Some(1.0))));
        let parameters = sbml.parameters.iter().map(|p| (p.id.clone(), p.value));
        let changes = |id: &str| states.iter().any(|s| s == id) || self.is_assigned(id);
        let mut all: Vec<(String, Option<Expr>)> = Vec::new();
        for (id, value) in compartments.chain(parameters).filter(|(id, _)| !changes(id)) {
            let value = sbml.initial.get(&id).map(|e| self.at_beginning(e.clone(), states)).or(value.map(Expr::Number));
            all.push((id, value));
        }
        let still: Vec<&Species> = sbml.species.iter().filter(|s| !changes(&s.id)).collect();
        for species in still {
            if !species.is_amount && self.volume_varies(&species.compartment) {
                self.diluted(species, states);
                continue;
            }
            let value = self.species_initial(species).map(|e| self.at_beginning(e, states));
            let is_set = self.problem.is_some_and(|p| p.overridden.contains(&species.id));
            let value = value.or_else(|| {
                if !is_set {
                    let what = format!("`{}` has no initial value in the model: it is 0", species.id);
                    remarks.push(what);
                }
                Some(Expr::Number(0.0))
            });
            all.push((species.id.clone(), value));
        }
        let known: BTreeSet<&str> = sbml.ids().collect();
        for column in self.problem.iter().flat_map(|p| &p.overridden).filter(|c| !known.contains(c.as_str())) {
            all.push((column.clone(), None));
        }
        for (id, default) in all {
            self.constant(&id, default);
        }
        self.statements.remarks.extend(remarks);
    }

    /// A species that nothing makes or takes, in a compartment that changes its size.
    fn diluted(&mut self, species: &Species, states: &[String]) {
        let own = self.names.fresh(&format!("{}_amount", species.id));
        let size = name(&species.compartment);
        if self.cells(&species.id).is_some() {
            self.wrong
                .push(format!("the table of conditions sets `{}`, whose compartment changes its size", species.id));
        }
        let initial = self.species_initial(species).unwrap_or(Expr::Number(0.0));
        let amount = self.at_beginning(binary(Sign::Multiply, initial, size.clone()), states);
        self.at_rest(&own, amount);
        self.define(&species.id, Definition::Let(binary(Sign::Divide, name(&own), size)));
    }

    /// `e` when the simulation begins, where it changes later.
    fn at_beginning(&self, e: Expr, states: &[String]) -> Expr {
        if self.changes(&e, states, 0) { Expr::Call("initial", vec![e]) } else { e }
    }

    /// Whether an expression changes in time; of what is nested deep it is believed.
    fn changes(&self, e: &Expr, states: &[String], depth: usize) -> bool {
        let name_changes = |id: &&str| {
            if states.iter().any(|s| s == id) || self.is_assigned(id) || depth > 16 {
                return true;
            }
            let input = self.statements.channels.iter().any(|c| c.name == *id && c.is_input());
            let definition = self.statements.definitions.iter().find(|(d, _)| d == id);
            input || matches!(definition, Some((_, Definition::Let(e))) if self.changes(e, states, depth + 1))
        };
        e.has_time() || e.names().iter().any(name_changes)
    }

    /// A name with one value in each experiment.
    fn constant(&mut self, id: &str, default: Option<Expr>) {
        // the table of parameters goes before the model
        let is_param = self.param_row(id).is_some();
        let Some(cells) = self.cells(id) else {
            match default {
                _ if is_param => {}
                Some(Expr::Number(v)) => {
                    self.define(id, Definition::Number(v));
                }
                // what is known of the beginning alone is a state at rest
                Some(e @ Expr::Call("initial", _)) => self.at_rest(id, e),
                Some(e) => self.define(id, Definition::Let(e)),
                // an error only where something needs it
                None => {}
            }
            return;
        };
        if is_param {
            self.wrong.push(format!(
                "`{id}` stands in the table of parameters and in that of conditions: one value is meant"
            ));
            return;
        }
        let mut lacking = false;
        let mut value = |cell: Option<Expr>| {
            cell.or_else(|| default.clone()).unwrap_or_else(|| {
                lacking = true;
                Expr::Number(0.0)
            })
        };
        // what was set before the experiment stays, in version 2
        let persists = self.problem.is_some_and(|p| p.persists);
        let kept = |before: &Option<Expr>, during| if persists { Option::or(during, before.clone()) } else { during };
        let cells = cells.into_iter().map(|[before, during]| [before.clone(), kept(&before, during)]);
        let values: Phases<Expr> = cells.map(|[before, during]| [value(before), value(during)]).collect();
        if lacking {
            self.wrong.push(format!("`{id}` has no value in some condition, and none in the model"));
            return;
        }
        // the column itself has the name
        let names = &mut self.names;
        let mut column = |wanted: &str| if wanted == id { id.to_string() } else { names.fresh(wanted) };
        let (e, channel) = written(id, &values, &mut column);
        match (e, channel) {
            (Expr::Number(v), None) => {
                self.define(id, Definition::Number(v));
            }
            (e, channel) => {
                let direct = channel.as_ref().is_some_and(|c| e == name(&c.name));
                self.statements.channels.extend(channel);
                if !direct {
                    self.define(id, Definition::Let(e));
                }
            }
        }
    }

    fn at_rest(&mut self, id: &str, initial: Expr) {
        let title = self.sbml.titles.get(id).cloned();
        let rate = Some(Expr::Number(0.0));
        self.statements.states.push(State { id: id.into(), initial, rate, reacts: false, title });
    }

    /// Events that happen when the simulation begins: their values in the place of initial ones, where their conditions hold then.
    fn begin(&self, initials: &mut [(String, Expr)]) {
        let before: BTreeMap<String, Expr> = initials.iter().cloned().collect();
        for event in self.sbml.events.iter().filter(|e| e.from_start) {
            let condition = self.at_zero(&event.trigger, &before, 0);
            for (id, value) in &event.assigned {
                if let Some((_, initial)) = initials.iter_mut().find(|(own, _)| own == id) {
                    let value = self.at_zero(value, &before, 0);
                    *initial = match condition.truth() {
                        Some(true) => value,
                        Some(false) => continue,
                        None => Expr::If(vec![(value, condition.clone())], Box::new(initial.clone())),
                    };
                }
            }
        }
    }

    /// `e` when the simulation begins, with values for some names.
    fn at_zero(&self, e: &Expr, by: &BTreeMap<String, Expr>, depth: usize) -> Expr {
        e.clone().map(&mut |part| match &part {
            Expr::Time => Expr::Number(0.0),
            Expr::Name(id) => match (by.get(id), self.sbml.assigned.iter().find(|(own, _)| own == id)) {
                (Some(value), _) => value.clone(),
                (None, Some((_, rule))) if depth < 16 => self.at_zero(rule, by, depth + 1),
                _ => part,
            },
            _ => part,
        })
    }

    /// What SBML says of the value of a species at the beginning, as its name means it.
    fn species_initial(&self, species: &Species) -> Option<Expr> {
        if let Some(e) = self.sbml.initial.get(&species.id) {
            return Some(e.clone());
        }
        let size = || name(&species.compartment);
        match (species.is_amount, species.amount, species.concentration) {
            (true, Some(amount), _) => Some(Expr::Number(amount)),
            (false, _, Some(concentration)) => Some(Expr::Number(concentration)),
            (true, None, Some(c)) => Some(binary(Sign::Multiply, Expr::Number(c), size())),
            (false, Some(0.0), None) => Some(Expr::Number(0.0)),
            (false, Some(a), None) => Some(match self.volume(&species.compartment) {
                Some(v) => Expr::Number(a / v),
                None => binary(Sign::Divide, Expr::Number(a), size()),
            }),
            (_, None, None) => None,
        }
    }

    /// The size of a compartment, where SBML gives one number and nothing else speaks of it.
    fn volume(&self, id: &str) -> Option<f64> {
        let plain = !self.is_assigned(id)
            && !self.sbml.events.iter().flat_map(|e| &e.assigned).any(|(own, _)| own == id)
            && self.rate(id).is_none()
            && !self.sbml.initial.contains_key(id)
            && self.param_row(id).is_none()
            && self.problem.is_none_or(|p| !p.overridden.iter().any(|c| c == id));
        let compartment = self.sbml.compartments.iter().find(|c| c.id == id).filter(|_| plain)?;
        Some(compartment.value.unwrap_or(1.0))
    }

    fn volume_varies(&self, id: &str) -> bool {
        self.is_assigned(id) || self.rate(id).is_some() || self.sbml.resized.contains(id)
    }

    /// The initial value of a state; a new value at the beginning of an experiment is noted.
    fn initial(&mut self, id: &str) -> Expr {
        let sbml = self.sbml;
        let default = match sbml.species.iter().find(|s| s.id == id) {
            Some(species) => self.species_initial(species),
            None => {
                let value = sbml.parameters.iter().chain(&sbml.compartments).find(|p| p.id == id).and_then(|p| p.value);
                sbml.initial.get(id).cloned().or(value.map(Expr::Number))
            }
        };
        // a parameter of the table that has a rate begins at its value
        let default = if self.param_row(id).is_some() {
            self.wrong
                .push(format!("`{id}` is a parameter of the table and has a rate in the model: one of them is meant"));
            default
        } else {
            default
        };
        let default = default.unwrap_or_else(|| {
            self.statements.remarks.push(format!("`{id}` has no initial value in the model: it begins at 0"));
            Expr::Number(0.0)
        });
        let Some(cells) = self.cells(id) else { return default };
        let experiments = self.measured.experiments.clone();
        let sets: Vec<bool> =
            cells.iter().zip(&experiments).map(|([_, during], e)| e.before.is_some() && during.is_some()).collect();
        let or_default = |cell: &Option<Expr>| cell.clone().unwrap_or_else(|| default.clone());
        let values: Phases<Expr> = (cells.iter().zip(&sets))
            .map(|([before, during], set)| [or_default(before), or_default(if *set { during } else { before })])
            .collect();
        let names = &mut self.names;
        let (e, channel) = written(&format!("{id}_0"), &values, &mut |wanted| names.fresh(wanted));
        let value = match channel {
            Some(channel) => {
                let is_input = channel.is_input();
                let direct = e == name(&channel.name);
                self.statements.channels.push(channel);
                let value = if direct {
                    e
                } else {
                    let own = self.names.fresh(&format!("{id}_0"));
                    self.define(&own, Definition::Let(e));
                    name(&own)
                };
                if is_input && !sets.contains(&true) {
                    self.wrong.push(format!("`{id}` changes its initial value within an experiment"));
                }
                value
            }
            None => e,
        };
        if sets.contains(&true) {
            let names = &mut self.names;
            let reset = Reset {
                id: id.into(),
                before: names.fresh(&format!("{id}_before")),
                change: names.fresh(&format!("{id}_change")),
                kept: names.fresh(&format!("{id}_kept")),
                value: value.clone(),
            };
            let kept = |set: &bool| if *set { [1.0, 0.0] } else { [1.0, 1.0] };
            let about = format!("1 while {id} is what it was before the experiment");
            self.statements.channels.push(Channel {
                name: reset.kept.clone(),
                about,
                values: sets.iter().map(kept).collect(),
            });
            self.reset.push(reset);
        }
        value
    }

    /// What an event sets as a state: of a concentration in a compartment that changes its size the amount, by the size just before (semantic test
    /// suite, 01779).
    fn set(&self, id: &str, value: &Expr) -> (String, Expr) {
        match (self.counted.get(id), self.sbml.species.iter().find(|s| s.id == id)) {
            (Some(amount), Some(species)) => (amount.clone(), times(value.clone(), name(&species.compartment))),
            _ => (id.into(), value.clone()),
        }
    }

    /// Whether a comparison holds from one time on, whatever the model does.
    fn is_clock(&self, e: &Expr) -> bool {
        let later = matches!(e, Expr::Binary(Sign::AtLeast, a, _) if **a == Expr::Time);
        later && !e.names().iter().any(|id| self.statements.states.iter().any(|s| s.id == *id) || self.is_assigned(id))
    }

    /// The first `>=` or `<=` of a condition whose sides are equal when the simulation begins, where they are numbers then.
    fn holds_exactly(&self, condition: &Expr, initials: &[(String, Expr)]) -> Option<Expr> {
        let before: BTreeMap<String, Expr> = initials.iter().cloned().collect();
        let at_zero = |e: &Expr| {
            // initial values that name others
            let first = self.at_zero(e, &before, 0);
            self.known(&self.at_zero(&first, &before, 0), 0, 0)
        };
        let mut found = None;
        condition.walk(&mut |part| {
            if let Expr::Binary(Sign::AtLeast | Sign::AtMost, a, b) = part
                && let (Some(a), Some(b)) = (at_zero(a), at_zero(b))
                && a == b
            {
                found = found.take().or(Some(part.clone()));
            }
        });
        found
    }

    /// What events make of the states.
    fn events(&mut self, initials: &[(String, Expr)]) {
        let sbml = self.sbml;
        for event in &sbml.events {
            for (id, _) in &event.assigned {
                let why = if self.is_assigned(id) {
                    "follows from a rule at all times"
                } else if self.counted.contains_key(id) && self.problem.is_some() {
                    "is a concentration in a compartment whose size another event sets, which PEtab and SBML mean differently: set an amount"
                } else if self.reset.iter().any(|r| r.id == *id) {
                    "gets a new value after pre-equilibration, which is not read together with events"
                } else {
                    continue;
                };
                self.wrong.push(format!("an event sets `{id}`, which {why}"));
            }
            match self.holds_exactly(&event.trigger, initials) {
                Some(part) if part == event.trigger && self.is_clock(&part) => {
                    let said = "holds from the beginning on, so that it never becomes true: it is left out";
                    self.statements.remarks.push(format!("the event `{}` {said}", part.text("time")));
                    continue;
                }
                Some(part) => {
                    let said = "are equal at the beginning, where nothing tells on which side it starts: begin apart from it, or write it without `=`";
                    self.wrong.push(format!("an event: the sides of `{}` {said}", part.text("time")));
                }
                None => {}
            }
            let assigned = event.assigned.iter().map(|(id, value)| self.set(id, value)).collect();
            self.statements.events.push((event.trigger.clone(), assigned));
        }
    }

    /// What reactions and rules make of the states.
    fn balances(&mut self, states: &[String], initials: &[(String, Expr)]) {
        let sbml = self.sbml;
        let mut counted: BTreeMap<String, String> = BTreeMap::new();
        let by_volume = |s: &&Species| states.contains(&s.id) && !s.is_amount && self.rate(&s.id).is_none();
        let by_volume: Vec<&Species> = sbml.species.iter().filter(by_volume).collect();
        for s in by_volume {
            if self.volume_varies(&s.compartment) {
                counted.insert(s.id.clone(), self.names.fresh(&format!("{}_amount", s.id)));
            } else if self.statements.channels.iter().any(|c| c.is_input() && c.name == s.compartment) {
                self.wrong.push(format!("the size of `{}` changes when an experiment begins", s.compartment));
            }
        }
        self.counted.clone_from(&counted);
        let referred = self.referred();
        let mut outside: BTreeMap<&str, Vec<(Expr, &str)>> = BTreeMap::new();
        let set = |id: &str| sbml.events.iter().flat_map(|e| &e.assigned).any(|(own, _)| own == id);
        let held = |id: &str| sbml.species.iter().any(|s| s.id == id && s.is_held);
        let free = |id: &str| states.iter().any(|s| s == id) && self.rate(id).is_none() && !held(id);
        let mut inside: BTreeSet<&str> = BTreeSet::new();
        let (mut flows, mut lines) = (Vec::new(), Vec::new());
        for reaction in &sbml.reactions {
            let net = net(reaction, &free);
            // what reactions do not change would be changed by the line
            let rests = |id: &str| self.statements.states.iter().any(|s| s.id == id);
            let kept = reaction
                .reactants
                .iter()
                .chain(&reaction.products)
                .any(|(id, _)| rests(id) || states.contains(id) && !free(id));
            match self.line(reaction, &net, &counted) {
                Some(line) if !referred.contains(&reaction.id) && !kept => {
                    inside.extend(net.iter().map(|(id, _)| *id));
                    // what it takes and gives back stands in the line too
                    let all = reaction.reactants.iter().chain(&reaction.products).map(|(id, _)| id.as_str());
                    inside.extend(all.filter(|id| set(id)));
                    lines.push(line);
                }
                _ => {
                    flows.push((reaction.id.clone(), reaction.law.clone()));
                    net.into_iter().for_each(|(id, count)| outside.entry(id).or_default().push((count, &reaction.id)));
                }
            }
        }
        self.statements.lines = lines;
        flows.into_iter().for_each(|(id, law)| self.define(&id, Definition::Let(law)));
        for (id, initial) in initials {
            let species = sbml.species.iter().find(|s| s.id == *id);
            let rate = match self.rate(id) {
                Some(rate) => Some(rate.clone()),
                None => outside.get(id.as_str()).map(|terms| {
                    let total = sum(terms);
                    let divided =
                        species.filter(|s| !s.is_amount && !counted.contains_key(id)).map(|s| s.compartment.as_str());
                    match divided {
                        Some(c) if self.volume(c) != Some(1.0) => binary(Sign::Divide, total, name(c)),
                        _ => total,
                    }
                }),
            };
            let reacts = inside.contains(id.as_str());
            // what only events change is at rest between them
            let rate = rate.or_else(|| (set(id) && !reacts).then_some(Expr::Number(0.0)));
            if rate.is_none() && !reacts {
                // its reactions make as much as they take
                self.define(id, Definition::Let(self.at_beginning(initial.clone(), states)));
                continue;
            }
            let title = sbml.titles.get(id).cloned();
            if let Some(reset) = self.reset.iter().find(|r| r.id == *id).cloned() {
                self.reset_state(&reset, rate, title);
                continue;
            }
            let begins = |e: Expr| self.at_beginning(e, states);
            match (counted.get(id), species) {
                (Some(amount), Some(s)) => {
                    let initial = begins(binary(Sign::Multiply, initial.clone(), name(&s.compartment)));
                    let concentration = binary(Sign::Divide, name(amount), name(&s.compartment));
                    self.statements.states.push(State { id: amount.clone(), initial, rate, reacts, title });
                    self.define(id, Definition::Let(concentration));
                }
                _ => {
                    let initial = begins(initial.clone());
                    self.statements.states.push(State { id: id.clone(), initial, rate, reacts, title });
                }
            }
        }
    }

    /// A state that gets a new value: what it was before, and its change since.
    fn reset_state(&mut self, reset: &Reset, rate: Option<Expr>, title: Option<String>) {
        let Some(rate) = rate else { return };
        let own = self.names.fresh(&format!("{}_rate", reset.id));
        self.define(&own, Definition::Let(rate));
        let before = self.before();
        let is_before = binary(Sign::Greater, name(&before), Expr::Number(0.5));
        let only = |first: bool| {
            let (rate, nothing) = (name(&own), Expr::Number(0.0));
            let (then, otherwise) = if first { (rate, nothing) } else { (nothing, rate) };
            Some(Expr::If(vec![(then, is_before.clone())], Box::new(otherwise)))
        };
        let initial = Expr::Call("initial", vec![reset.value.clone()]);
        let (first, second) = (only(true), only(false));
        let states = &mut self.statements.states;
        states.push(State { id: reset.before.clone(), initial, rate: first, reacts: false, title });
        states.push(State {
            id: reset.change.clone(),
            initial: Expr::Number(0.0),
            rate: second,
            reacts: false,
            title: None,
        });
        let kept = binary(Sign::Greater, name(&reset.kept), Expr::Number(0.5));
        let base = Expr::If(vec![(name(&reset.before), kept)], Box::new(reset.value.clone()));
        self.define(&reset.id, Definition::Let(binary(Sign::Add, base, name(&reset.change))));
    }

    /// The input that is 1 until the experiment begins.
    fn before(&mut self) -> String {
        let about = "1 before the experiment begins";
        if let Some(channel) = self.statements.channels.iter().find(|c| c.about == about) {
            return channel.name.clone();
        }
        let own = self.names.fresh("before");
        let values = self.measured.experiments.iter().map(|e| [f64::from(u8::from(e.before.is_some())), 0.0]).collect();
        self.statements.channels.push(Channel { name: own.clone(), about: about.into(), values });
        own
    }

    /// Reactions that formulas name: their rates.
    fn referred(&self) -> BTreeSet<String> {
        let ids: BTreeSet<&str> = self.sbml.reactions.iter().map(|r| r.id.as_str()).collect();
        let formulas = self.sbml.assigned.iter().chain(&self.sbml.rates).map(|(_, e)| e);
        let formulas = formulas.chain(self.sbml.reactions.iter().map(|r| &r.law)).chain(self.sbml.initial.values());
        let events = self.sbml.events.iter();
        let formulas = formulas.chain(events.flat_map(|e| e.assigned.iter().map(|(_, e)| e).chain([&e.trigger])));
        let sides = self.sbml.reactions.iter().flat_map(|r| r.reactants.iter().chain(&r.products));
        let formulas = formulas.chain(sides.map(|(_, count)| count));
        let formulas = formulas.chain(self.measured.outputs.iter().flat_map(|o| [&o.formula, &o.noise]));
        formulas.flat_map(Expr::names).filter(|n| ids.contains(n)).map(String::from).collect()
    }

    /// A reaction as a line of `reactions`, where its rate means the same for all that react.
    fn line(&self, reaction: &Reaction, net: &[(&str, Expr)], counted: &BTreeMap<String, String>) -> Option<Line> {
        let species = |id: &str| self.sbml.species.iter().find(|s| s.id == id);
        let all: Vec<&Species> = net.iter().filter_map(|(id, _)| species(id)).collect();
        let is_reset = |id: &str| self.reset.iter().any(|r| r.id == id);
        if all.is_empty() || all.len() != net.len() || net.iter().any(|(id, _)| is_reset(id)) {
            return None;
        }
        let is_amount = |s: &Species| s.is_amount || counted.contains_key(&s.id);
        let first = all[0];
        if all.iter().any(|s| is_amount(s) != is_amount(first) || !is_amount(s) && s.compartment != first.compartment) {
            return None;
        }
        let side = |list: &[(String, Expr)]| -> Option<Vec<(String, f64)>> {
            let each = list.iter().map(|(id, count)| match count {
                Expr::Number(n) if n.is_finite() && *n > 0.0 => Some((counted.get(id).unwrap_or(id).clone(), *n)),
                _ => None,
            });
            each.collect()
        };
        let (left, right) = (side(&reaction.reactants)?, side(&reaction.products)?);
        let rate = if is_amount(first) {
            reaction.law.clone()
        } else {
            let volume = &first.compartment;
            match (reaction.law.without_factor(volume), self.volume(volume)) {
                (Some(rate), _) => rate,
                (None, Some(1.0)) => reaction.law.clone(),
                (None, _) => binary(Sign::Divide, reaction.law.clone(), name(volume)),
            }
        };
        Some(Line { left, right, rate })
    }

    /// Comparisons of time with what is known in each experiment become inputs, so that no step of the integration crosses a switch.
    fn switches(&mut self) {
        let mut known: Vec<(Expr, Phases<f64>)> = Vec::new();
        let mut open = BTreeSet::new();
        let experiments = self.measured.experiments.len();
        if experiments == 0 {
            return;
        }
        let statements = &self.statements;
        let value = |e: &Expr| -> Option<Vec<[f64; 2]>> {
            (0..experiments).map(|k| self.known(e, k, 0).map(|v| [v, v])).collect()
        };
        let mut look = |e: &Expr| {
            e.walk(&mut |part| {
                if let Some((at, _)) = switch(part) {
                    if known.iter().any(|(e, _)| *e == at) {
                        return;
                    }
                    match value(&at) {
                        Some(values) => known.push((at, values)),
                        None => {
                            open.insert(at.text("t"));
                        }
                    }
                }
            });
        };
        for (_, definition) in &statements.definitions {
            if let Definition::Let(e) = definition {
                look(e);
            }
        }
        statements.states.iter().filter_map(|s| s.rate.as_ref()).for_each(&mut look);
        statements.lines.iter().for_each(|l| look(&l.rate));
        self.measured.outputs.iter().for_each(|o| {
            look(&o.formula);
            look(&o.noise);
        });
        for at in open {
            let what =
                format!("the switch at the time {at} is not known beforehand: steps of the integration cross it");
            self.statements.remarks.push(what);
        }
        let mut flags: Vec<(Expr, String)> = Vec::new();
        for (at, values) in known {
            let text = at.text("t");
            let words: Vec<&str> = text.split(|c: char| !c.is_ascii_alphanumeric()).filter(|w| !w.is_empty()).collect();
            let own = self.names.fresh(&format!("from_{}", words.join("_")));
            let times = values.iter().map(|[_, during]| *during).collect();
            self.statements.switches.push(Switch {
                name: own.clone(),
                about: format!("1 from the time {text} on"),
                times,
            });
            flags.push((at, own));
        }
        let flagged = |e: Expr| {
            e.map(&mut |part| match switch(&part) {
                Some((at, later)) => match flags.iter().find(|(e, _)| *e == at) {
                    Some((_, flag)) => {
                        binary(if later { Sign::Greater } else { Sign::Less }, name(flag), Expr::Number(0.5))
                    }
                    None => part,
                },
                None => part,
            })
        };
        for (_, definition) in &mut self.statements.definitions {
            if let Definition::Let(e) = definition {
                *e = flagged(e.clone());
            }
        }
        for state in &mut self.statements.states {
            state.rate = state.rate.take().map(flagged);
        }
        for line in &mut self.statements.lines {
            line.rate = flagged(line.rate.clone());
        }
        for output in &mut self.measured.outputs {
            output.formula = flagged(output.formula.clone());
            output.noise = flagged(output.noise.clone());
        }
    }

    /// The value of an expression in an experiment, where nothing that is estimated or changes stands in it.
    fn known(&self, e: &Expr, experiment: usize, depth: usize) -> Option<f64> {
        let of = |id: &str| -> Option<f64> {
            if let Some(channel) = self.statements.channels.iter().find(|c| c.name == id) {
                return channel.values.get(experiment).map(|[_, during]| *during);
            }
            let (_, definition) = self.statements.definitions.iter().find(|(d, _)| d == id)?;
            match definition {
                Definition::Number(v) => Some(*v),
                Definition::Param(p) if p.bounds.is_none() => Some(p.value),
                Definition::Let(e) if depth < 16 => self.known(e, experiment, depth + 1),
                _ => None,
            }
        };
        match e {
            // a choice among values
            Expr::If(branches, otherwise) => {
                for (value, condition) in branches {
                    let Expr::Binary(Sign::Equal, a, b) = condition else { return None };
                    if a.value(&of)? == b.value(&of)? {
                        return self.known(value, experiment, depth + 1);
                    }
                }
                self.known(otherwise, experiment, depth + 1)
            }
            e => e.value(&of),
        }
    }

    fn finish(mut self, stem: &str) -> Result<Import, Vec<String>> {
        let experiments: &[Experiment] = &self.measured.experiments;
        let lead = experiments.iter().any(|e| e.before.is_some()).then(|| lead(&self.measured));
        let horizon = lead.map(|lead| (self.names.fresh("lead"), lead));
        let time = if horizon.is_some() { self.names.fresh("time_of_experiment") } else { "t".into() };
        let records = Records {
            names: &self.names,
            measured: &self.measured,
            channels: &self.statements.channels,
            switches: &self.statements.switches,
            lead,
        };
        let text = writing::Text {
            statements: &self.statements,
            measured: &self.measured,
            names: &self.names,
            stem,
            horizon: horizon.as_ref().map(|(n, _)| n.as_str()),
            time: &time,
        };
        let written = text.model()?;
        let report = text.report(self.problem, &written, &records);
        let used = |name: &str| written.used.contains(name);
        let files = records.files(&used);
        let table = records.table(
            &files[..],
            &used,
            horizon.as_ref().map(|(n, lead)| (n.as_str(), *lead)).filter(|(n, _)| used(n)),
        );
        let project = records.project(&used);
        let mut remarks = self.statements.remarks.clone();
        remarks.extend(written.remarks.iter().cloned());
        Ok(Import {
            model: written.text,
            runs: files.into_iter().map(|(_, f)| f).collect(),
            table,
            project,
            report,
            remarks,
            constant: self.measured.constant,
        })
    }
}

/// How many of each state that is free a reaction makes.
fn net<'a>(reaction: &'a Reaction, free: &dyn Fn(&str) -> bool) -> Vec<(&'a str, Expr)> {
    let mut net: Vec<(&str, Expr)> = Vec::new();
    for (list, sign) in [(&reaction.reactants, Sign::Subtract), (&reaction.products, Sign::Add)] {
        for (id, count) in list.iter().filter(|(id, _)| free(id)) {
            let place = net.iter().position(|(n, _)| n == id).unwrap_or_else(|| {
                net.push((id, Expr::Number(0.0)));
                net.len() - 1
            });
            let total = std::mem::replace(&mut net[place].1, Expr::Number(0.0));
            net[place].1 = match (total, count, sign) {
                (Expr::Number(a), Expr::Number(b), Sign::Subtract) => Expr::Number(a - b),
                (Expr::Number(a), Expr::Number(b), _) => Expr::Number(a + b),
                (Expr::Number(0.0), count, Sign::Subtract) => Expr::Minus(Box::new(count.clone())),
                (Expr::Number(0.0), count, _) => count.clone(),
                (total, count, sign) => binary(sign, total, count.clone()),
            };
        }
    }
    net.retain(|(_, count)| *count != Expr::Number(0.0));
    net
}

/// `-v1 + 2*v2`.
fn sum(terms: &[(Expr, &str)]) -> Expr {
    let mut total: Option<Expr> = None;
    for (count, reaction) in terms {
        let (adds, size) = match count {
            Expr::Number(n) => (*n > 0.0, Expr::Number(n.abs())),
            Expr::Minus(e) => (false, (**e).clone()),
            e => (true, e.clone()),
        };
        let term = times(size, name(reaction));
        total = Some(match (total, adds) {
            (None, true) => term,
            (None, false) => Expr::Minus(Box::new(term)),
            (Some(before), true) => binary(Sign::Add, before, term),
            (Some(before), false) => binary(Sign::Subtract, before, term),
        });
    }
    total.unwrap_or(Expr::Number(0.0))
}

/// A row of the table of parameters.
fn param(row: &Row, remarks: &mut Vec<String>) -> Result<(String, Param), String> {
    let id = row.need("parameterId")?.to_string();
    let text = row.get("parameterScale").unwrap_or("lin");
    let scale = Scale::find(text)
        .ok_or_else(|| row.says("parameterScale", &format!("`{text}` is not known: lin, log, log10 are")))?;
    let title = row.get("parameterName").filter(|t| *t != id).map(String::from);
    let estimated = match row.get("estimate") {
        Some("0" | "0.0" | "false") => false,
        Some("1" | "1.0" | "true") => true,
        _ => return Err(row.says("estimate", "0 or 1 is needed")),
    };
    if !estimated {
        let value = row.number("nominalValue")?;
        return Ok((id, Param { value, bounds: None, scale, prior: None, title }));
    }
    let (lower, upper) = (row.number("lowerBound")?, row.number("upperBound")?);
    if lower >= upper {
        return Err(row.says("lowerBound", &format!("the bounds {lower} and {upper} leave nothing between them")));
    }
    if scale != Scale::Linear && lower < 0.0 {
        return Err(row.says("lowerBound", &format!("{lower} has no logarithm, which parameterScale asks for")));
    }
    let value = match row.get("nominalValue") {
        Some(_) => row.number("nominalValue")?,
        None if scale == Scale::Linear => 0.5 * (lower + upper),
        None => (lower.max(f64::MIN_POSITIVE) * upper).sqrt(),
    };
    let inside = value.clamp(lower, upper);
    if inside != value {
        remarks.push(row.says("nominalValue", &format!("{value} is outside the bounds; the model starts at {inside}")));
    }
    let prior = prior(row, scale, remarks)?;
    Ok((id, Param { value: inside, bounds: Some((lower, upper)), scale, prior, title }))
}

/// A prior that the language has; others are left out, and a remark says so.
fn prior(row: &Row, scale: Scale, remarks: &mut Vec<String>) -> Result<Option<(f64, f64)>, String> {
    let Some(kind) = row.get("objectivePriorType") else { return Ok(None) };
    let numbers: Vec<f64> = (row.get("objectivePriorParameters").unwrap_or_default().split(';'))
        .filter_map(|p| crate::tables::number(p.trim()))
        .collect();
    let is_normal = kind == "parameterScaleNormal" || kind == "normal" && scale == Scale::Linear;
    match (is_normal, &numbers[..]) {
        (true, [mean, deviation]) if *deviation > 0.0 => Ok(Some((*mean, *deviation))),
        (true, _) => Err(row.says("objectivePriorParameters", "a mean and a deviation above 0 are needed: `0;0.3`")),
        (false, _) if kind == "parameterScaleUniform" || kind == "uniform" => {
            remarks.push(row.says("objectivePriorType", "a uniform prior is left out; the bounds hold"));
            Ok(None)
        }
        (false, _) => {
            remarks.push(row.says(
                "objectivePriorType",
                &format!("the prior `{kind}` is left out; priors are normal on the parameter's scale"),
            ));
            Ok(None)
        }
    }
}
