//! The tables of a model as DAVE-ML 2.0 (AIAA S-119-2011): gridded tables with their functions, coefficients with units and uncertainty, and
//! check cases ([`tables`]).
//!
//! Functions of the file are linear between breakpoints and hold at the borders, as a `linear` table is. A `cubic` or `pchip` table is written
//! on a finer grid, so that it stays near its curve; what that costs is told, and stands in the tolerance of each check case.

use crate::Stamp;
use crate::xml::lines;
use fdm_grammar::Unit;
use fdm_grammar::model::{Origin, Table, TableNode};
use fdm_system::Model;
use fdm_system::code::Tape;
use fdm_system::dynamics::{Dynamics, Point, Workspace};
use maud::{Markup, html};
use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};

/// Why there is no file.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum NoTables {
    /// The model has no table.
    #[error(
        "the model has no `table`: DAVE-ML holds functions through points; for equations take --to fmu, c or jsbsim"
    )]
    None,
    /// A node is an expression.
    #[error("a node of the table `{0}` is an expression: write a number or a param of its own")]
    Expression(String),
    /// A value that is no number.
    #[error("the table `{0}` has a value that is not finite")]
    NotFinite(String),
    /// The curve between the nodes cannot be asked for.
    #[error("the table `{table}` by itself is no model: {said}")]
    Unasked {
        /// The table.
        table: String,
        /// What the compiler says.
        said: String,
    },
}

/// A file, and what its finer grids cost.
#[derive(Debug, Clone, PartialEq)]
pub struct Tables {
    /// The text.
    pub text: String,
    /// Tables that are not linear, and the largest difference between the curve and the straight lines of the file that was found, in the
    /// unit of the table.
    pub resampled: Vec<(String, f64)>,
}

/// Most crossings of a grid.
const MOST: usize = 20_000;
/// Check cases; the first are inside, the last is outside all ranges.
const SHOTS: usize = 8;

/// The file of a model's tables at the values of its parameters; `errors` are standard errors by the names of parameters.
///
/// # Errors
/// [`NoTables`].
pub fn tables(model: &Model, errors: &BTreeMap<String, f64>) -> Result<Tables, NoTables> {
    let definition = model.definition();
    if definition.tables.is_empty() {
        return Err(NoTables::None);
    }
    let grids: Vec<Grid<'_>> =
        definition.tables.iter().map(|table| Grid::new(model, table, errors)).collect::<Result<_, _>>()?;
    let names = Names::default();
    let inputs = Inputs::of(&definition.tables, &names);
    let outputs: Vec<String> = grids.iter().map(|g| names.fresh(&g.table.quantity.name)).collect();
    let nodes = |name: &str| {
        definition.tables.iter().any(|t| t.nodes.iter().any(|n| matches!(n, TableNode::Param(own) if own == name)))
    };
    let constants = definition.params.iter().filter(|p| !p.is_recorded() && !nodes(&p.quantity.name));
    let constants = constants.filter(|p| p.value.is_finite() && !matches!(p.origin, Origin::FreeInitial(_)));
    let said = format!("Written by fdm {}; {}", env!("CARGO_PKG_VERSION"), Stamp::of(model));
    let body = html! {
        DAVEfunc xmlns="http://daveml.org/2010/DAVEML" {
            fileHeader name=(model.name()) {
                author name="fdm" org="fdm" {}
                // the same model gives the same file, on any day
                creationDate date="1970-01-01" {}
                description { (description(&definition.doc)) }
            }
            @for input in &inputs.all { (input.variable()) }
            @for (grid, id) in grids.iter().zip(&outputs) {
                variableDef name=(grid.table.quantity.name) varID=(id) units=(units(grid.table.quantity.unit.as_ref())) {
                    (about(&grid.table.quantity.doc))
                    isOutput {}
                }
            }
            @for param in constants {
                @let quantity = &param.quantity;
                variableDef name=(quantity.name) varID=(names.fresh(&quantity.name)) units=(units(quantity.unit.as_ref())) initialValue=(number(param.value)) {
                    (about(&quantity.doc))
                    @if let Some(error) = errors.get(&quantity.name) {
                        (uncertainty(&html! { (number(*error)) }))
                    }
                }
            }
            @for (grid, id) in grids.iter().zip(&outputs) { (grid.breakpoints(id)) }
            @for (grid, id) in grids.iter().zip(&outputs) { (grid.definition(id)) }
            @for (t, (grid, id)) in grids.iter().zip(&outputs).enumerate() { (grid.function(id, inputs.of_table(t))) }
            (check_cases(&inputs, &grids))
        }
    };
    let head = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<!DOCTYPE DAVEfunc PUBLIC \"-//AIAA//DTD for Flight Dynamic Models - Functions \
                2.0//EN\" \"http://www.daveml.org/DTDs/2p0/DAVEfunc.dtd\">\n";
    let resampled = grids.iter().filter(|g| g.is_resampled()).map(|g| (g.table.quantity.name.clone(), g.deviation()));
    Ok(Tables {
        text: format!("{head}<!-- {said} -->\n{}\n", lines(&body.into_string())),
        resampled: resampled.collect(),
    })
}

/// What the tables are at a few places, for who reads the file to compare with.
fn check_cases(inputs: &Inputs<'_>, grids: &[Grid<'_>]) -> Markup {
    html! {
        checkData {
            @for shot in 0..SHOTS {
                @let values = inputs.values(grids, shot);
                staticShot name=(format!("case {}", shot + 1)) {
                    checkInputs {
                        @for (input, value) in inputs.all.iter().zip(&values) {
                            signal {
                                signalName { (input.name) }
                                signalUnits { (units(input.unit)) }
                                signalValue { (number(*value)) }
                            }
                        }
                    }
                    checkOutputs {
                        @for (t, grid) in grids.iter().enumerate() {
                            @let at: Vec<f64> = inputs.places[t].iter().map(|k| values[*k]).collect();
                            @let value = grid.curve(&at);
                            signal {
                                signalName { (grid.table.quantity.name) }
                                signalUnits { (units(grid.table.quantity.unit.as_ref())) }
                                signalValue { (number(value)) }
                                // part of a table's largest value that another way to interpolate may err
                                tol { (number((grid.linear(&at) - value).abs() + 1e-9 * grid.size())) }
                            }
                        }
                    }
                }
            }
        }
    }
}

fn number(value: f64) -> String {
    format!("{value:?}")
}

fn list(values: &[f64]) -> String {
    values.iter().map(|v| number(*v)).collect::<Vec<_>>().join(", ")
}

fn description(doc: &str) -> String {
    let doc = if doc.is_empty() { String::new() } else { format!("{doc}. ") };
    format!(
        "{doc}Functions of a model in the language of fdm. The date means nothing: the same model gives the same file."
    )
}

fn about(doc: &str) -> Markup {
    html! { @if !doc.is_empty() { description { (doc) } } }
}

/// A standard error.
fn uncertainty(value: &Markup) -> Markup {
    html! { uncertainty effect="additive" { normalPDF numSigmas="1" { bounds { (value) } } } }
}

/// A unit as the standard writes it: `m/s^2` is `m_s2`, and what has none is `nd`.
fn units(unit: Option<&Unit>) -> String {
    let text = unit.map_or("1", |u| u.text()).trim();
    if text == "1" || text.is_empty() {
        "nd".into()
    } else {
        text.replace('/', "_").replace(['^', '*', ' ', '(', ')'], "")
    }
}

/// Identifiers of the file, each once.
#[derive(Default)]
struct Names(RefCell<BTreeSet<String>>);

impl Names {
    fn fresh(&self, name: &str) -> String {
        let mut id: String = name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
        if !id.starts_with(|c: char| c.is_ascii_alphabetic()) {
            id.insert(0, 'v');
        }
        let mut taken = self.0.borrow_mut();
        while !taken.insert(id.clone()) {
            id.push('_');
        }
        id
    }
}

/// Arguments of the tables: those of one name and one unit are one variable.
struct Inputs<'a> {
    all: Vec<Input<'a>>,
    /// For each table the variables of its arguments.
    places: Vec<Vec<usize>>,
}

struct Input<'a> {
    name: String,
    id: String,
    unit: Option<&'a Unit>,
}

impl Input<'_> {
    fn variable(&self) -> Markup {
        html! { variableDef name=(self.name) varID=(self.id) units=(units(self.unit)) { isInput {} } }
    }
}

impl<'a> Inputs<'a> {
    fn of(tables: &'a [Table], names: &Names) -> Self {
        let mut all: Vec<(Input<'a>, &'a str)> = Vec::new();
        let mut places = Vec::new();
        for table in tables {
            let mut own: Vec<usize> = Vec::new();
            for argument in &table.arguments {
                let unit = argument.unit.as_ref();
                let same = |(i, name): &(Input<'_>, &str)| {
                    *name == argument.name && i.unit.map(Unit::text) == unit.map(Unit::text)
                };
                let place = all.iter().position(same).filter(|k| !own.contains(k)).unwrap_or_else(|| {
                    let id = names.fresh(&argument.name);
                    let taken = all.iter().any(|(i, _)| i.name == argument.name);
                    let name = if taken { id.clone() } else { argument.name.clone() };
                    all.push((Input { name, id, unit }, &argument.name));
                    all.len() - 1
                });
                own.push(place);
            }
            places.push(own);
        }
        Self { all: all.into_iter().map(|(input, _)| input).collect(), places }
    }

    fn of_table(&self, table: usize) -> impl Iterator<Item = &Input<'a>> {
        self.places[table].iter().map(|k| &self.all[*k])
    }

    /// Values of all inputs in a check case: parts of their ranges that are no simple fractions.
    fn values(&self, grids: &[Grid<'_>], shot: usize) -> Vec<f64> {
        let range = |k: usize| {
            let axes = grids.iter().zip(&self.places).flat_map(|(g, own)| g.axes.iter().zip(own));
            axes.filter(|(_, place)| **place == k).fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), (a, _)| {
                (low.min(a[0]), high.max(a[a.len() - 1]))
            })
        };
        let value = |k: usize| {
            let (low, high) = range(k);
            // an additive sequence of the golden ratio's kind, another one for each input
            let part = (0.31 + 0.618_033_988_749_895 * (shot + 1) as f64 * (1.0 + 0.37 * k as f64)).fract();
            let part = if shot + 1 == SHOTS { 1.1 } else { part };
            low + part * (high - low)
        };
        (0..self.all.len()).map(value).collect()
    }
}

/// A table on the grid of the file.
struct Grid<'a> {
    table: &'a Table,
    axes: Vec<Vec<f64>>,
    values: Vec<f64>,
    /// Standard errors of its nodes; none where the grid is finer.
    errors: Vec<f64>,
    tape: Tape,
}

impl<'a> Grid<'a> {
    fn new(model: &Model, table: &'a Table, errors: &BTreeMap<String, f64>) -> Result<Self, NoTables> {
        let name = || table.quantity.name.clone();
        let node = |node: &TableNode| match node {
            TableNode::Number(value) => Ok(*value),
            TableNode::Param(own) => model
                .definition()
                .param(own)
                .map(|k| model.definition().params[k].value)
                .ok_or_else(|| NoTables::Expression(name())),
            TableNode::Expression => Err(NoTables::Expression(name())),
        };
        let values: Vec<f64> = table.nodes.iter().map(node).collect::<Result<_, _>>()?;
        if !values.iter().all(|v| v.is_finite()) {
            return Err(NoTables::NotFinite(name()));
        }
        let text = alone(table, &values);
        let asked = Model::from_text("table.fdm", &text);
        let asked = asked.map_err(|e| NoTables::Unasked { table: name(), said: e.to_string() })?;
        let nodes: Vec<Vec<f64>> = table.arguments.iter().map(|a| a.axis.clone()).collect();
        let mut grid = Self { table, axes: nodes, values, errors: Vec::new(), tape: Tape::new(asked.schedule()) };
        if grid.is_resampled() {
            // parts of each interval of a table that is not linear, where the table stays below `MOST` crossings
            let parts = (1..=16).rev().find(|parts| grid.crossings(*parts) <= MOST).unwrap_or(1);
            grid.axes = grid.axes.iter().map(|axis| divided(axis, parts)).collect();
            grid.values = (0..grid.crossings(1)).map(|k| grid.curve(&grid.place(k))).collect();
        } else {
            let error = |node: &TableNode| match node {
                TableNode::Param(own) => errors.get(own).copied().unwrap_or(0.0),
                _ => 0.0,
            };
            grid.errors = table.nodes.iter().map(error).collect();
        }
        Ok(grid)
    }

    fn is_resampled(&self) -> bool {
        self.table.method != "linear"
    }

    /// Crossings where every interval is divided.
    fn crossings(&self, parts: usize) -> usize {
        self.axes.iter().map(|axis| (axis.len() - 1) * parts + 1).product()
    }

    /// Where a crossing is; those of the last argument stand next to each other.
    fn place(&self, k: usize) -> Vec<f64> {
        let (mut rest, mut place) = (k, Vec::with_capacity(self.axes.len()));
        for axis in self.axes.iter().rev() {
            place.push(axis[rest % axis.len()]);
            rest /= axis.len();
        }
        place.reverse();
        place
    }

    /// The table as fdm computes it.
    fn curve(&self, at: &[f64]) -> f64 {
        let mut work = Workspace::new(&self.tape);
        let layout = self.tape.layout();
        let (mut known, mut y) = (vec![0.0; layout.known], vec![0.0]);
        self.tape.prepare(&[], &mut known, &mut work);
        self.tape.outputs(Point { t: 0.0, x: &[], drive: at, known: &known }, &mut y, &mut work);
        y[0]
    }

    /// The function of the file: linear along every argument, and held at the borders.
    fn linear(&self, at: &[f64]) -> f64 {
        let (mut value, corners) = (0.0, 1usize << self.axes.len());
        for corner in 0..corners {
            let (mut index, mut weight) = (0, 1.0);
            for (k, (axis, x)) in self.axes.iter().zip(at).enumerate() {
                let x = x.clamp(axis[0], axis[axis.len() - 1]);
                let left = axis.partition_point(|a| *a <= x).clamp(1, axis.len() - 1) - 1;
                let part = (x - axis[left]) / (axis[left + 1] - axis[left]);
                let upper = (corner >> k) & 1;
                index = index * axis.len() + left + upper;
                weight *= if upper == 1 { part } else { 1.0 - part };
            }
            value += weight * self.values[index];
        }
        value
    }

    /// Largest value.
    fn size(&self) -> f64 {
        self.values.iter().fold(f64::MIN_POSITIVE, |most, v| most.max(v.abs()))
    }

    /// The largest difference of curve and file in the middle of all cells.
    fn deviation(&self) -> f64 {
        let middle = |k: usize| {
            let (mut rest, mut at) = (k, Vec::with_capacity(self.axes.len()));
            for axis in self.axes.iter().rev() {
                let cell = rest % (axis.len() - 1);
                at.push(0.5 * (axis[cell] + axis[cell + 1]));
                rest /= axis.len() - 1;
            }
            at.reverse();
            (self.curve(&at) - self.linear(&at)).abs()
        };
        (0..self.axes.iter().map(|axis| axis.len() - 1).product()).map(middle).fold(0.0, f64::max)
    }

    fn said(&self) -> String {
        if !self.is_resampled() {
            return "linear between breakpoints".into();
        }
        let deviation = self.deviation();
        format!(
            "a {} curve on a finer grid: straight lines between breakpoints err by {deviation:.1e} at most",
            self.table.method
        )
    }

    fn breakpoints(&self, id: &str) -> Markup {
        html! {
            @for (k, axis) in self.axes.iter().enumerate() {
                @let argument = &self.table.arguments[k];
                breakpointDef name=(format!("{} of {}", argument.name, self.table.quantity.name)) bpID=(format!("{id}_axis_{}", k + 1)) units=(units(argument.unit.as_ref())) {
                    bpVals { (list(axis)) }
                }
            }
        }
    }

    fn definition(&self, id: &str) -> Markup {
        html! {
            griddedTableDef name=(format!("{} of the model", self.table.quantity.name)) gtID=(format!("{id}_table")) units=(units(self.table.quantity.unit.as_ref())) {
                description { (self.said()) }
                breakpointRefs { @for k in 0..self.axes.len() { bpRef bpID=(format!("{id}_axis_{}", k + 1)) {} } }
                @if self.errors.iter().any(|e| *e > 0.0) {
                    (uncertainty(&html! { dataTable { (list(&self.errors)) } }))
                }
                dataTable { (list(&self.values)) }
            }
        }
    }

    fn function<'i>(&self, id: &str, inputs: impl Iterator<Item = &'i Input<'i>>) -> Markup {
        html! {
            function name=(format!("{} by its arguments", self.table.quantity.name)) {
                (about(&self.table.quantity.doc))
                @for (axis, input) in self.axes.iter().zip(inputs) {
                    independentVarRef varID=(input.id) min=(number(axis[0])) max=(number(axis[axis.len() - 1])) extrapolate="neither" interpolate="linear" {}
                }
                dependentVarRef varID=(id) {}
                functionDefn name=(format!("{id}_function")) { griddedTableRef gtID=(format!("{id}_table")) {} }
            }
        }
    }
}

/// Every interval in equal parts.
fn divided(axis: &[f64], parts: usize) -> Vec<f64> {
    let inner = |w: &[f64]| {
        let (from, to) = (w[0], w[1]);
        (0..parts)
            .map(move |k| if k == 0 { from } else { from + (to - from) * k as f64 / parts as f64 })
            .collect::<Vec<_>>()
    };
    axis.windows(2).flat_map(inner).chain(axis.last().copied()).collect()
}

/// A model of nothing but the table, with numbers at its nodes.
fn alone(table: &Table, values: &[f64]) -> String {
    let lengths = table.lengths();
    let named = |letter: &str| (0..lengths.len()).map(|k| format!("{letter}{k}")).collect::<Vec<_>>().join(", ");
    let axes = table.arguments.iter().enumerate().map(|(k, a)| format!("a{k}: [{}], ", list(&a.axis)));
    let mut rows: Vec<String> = values.iter().map(|v| number(*v)).collect();
    for length in lengths.iter().rev() {
        rows = rows.chunks(*length).map(|row| format!("[{}]", row.join(", "))).collect();
    }
    format!(
        "model alone {{ input {}; table F({}) = {} {{ {}F: {} }}; output y = F({}); }}",
        named("u"),
        named("a"),
        table.method,
        axes.collect::<String>(),
        rows.concat(),
        named("u")
    )
}
