//! The stages of a model as `fdm show --json` prints them. Fields stand in the order of the alphabet, as they always were printed.

use serde::Serialize;
use std::collections::BTreeMap;

/// One stage.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum StageDocument {
    /// The tree of the text; none where there is none.
    Syntax(Option<SyntaxStage>),
    /// What every name is, and the equations.
    Names(NamesStage),
    /// The nodes that the equations share.
    Graph(GraphStage),
    /// Every partial that is not zero.
    Derivatives(DerivativesStage),
    /// The programs.
    Schedule(ScheduleStage),
    /// The machine code.
    Code(CodeStage),
    /// The linear model at the trim.
    Linear(Box<LinearStage>),
}

/// A text, statement by statement.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SyntaxStage {
    /// Name of the model.
    pub model: String,
    /// Its statements in normal form.
    pub statements: Vec<StatementText>,
}

/// A statement.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StatementText {
    /// Where it begins, from 1.
    pub line: usize,
    /// In normal form.
    pub text: String,
}

/// Names and equations.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct NamesStage {
    /// After everything was put in its place.
    pub equations: Vec<EquationText>,
    /// Name of the model.
    pub model: String,
    /// Everything that has a name.
    pub names: Vec<DeclaredName>,
    /// Unit of time.
    pub time: String,
}

/// An equation.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct EquationText {
    /// What it gives.
    pub left: String,
    /// By what.
    pub right: String,
}

/// What a name is.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DeclaredName {
    /// Bounds, ties, noise.
    pub attributes: String,
    /// Its meaning.
    pub doc: String,
    /// The name.
    pub name: String,
    /// `input`, `state`, `param`, ...
    pub role: String,
    /// Its unit.
    pub unit: Option<String>,
    /// Its value, where it has one.
    pub value: Option<f64>,
}

/// The graph.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GraphStage {
    /// Where each equation ends.
    pub equations: Vec<EquationNode>,
    /// In topological order, numbered from 0.
    pub nodes: Vec<GraphNode>,
}

/// An equation and its node.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct EquationNode {
    /// The equation.
    pub name: String,
    /// Number of its node.
    pub node: usize,
}

/// A node.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GraphNode {
    /// An operation, a leaf or a number.
    pub is: String,
    /// Numbers of its operands.
    pub of: Vec<usize>,
}

/// Partials.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DerivativesStage {
    /// Name of the model.
    pub model: String,
    /// Partials that are not zero.
    pub partials: Vec<PartialText>,
}

/// A partial.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PartialText {
    /// By what.
    pub by: String,
    /// Of what.
    pub equation: String,
    /// As an expression.
    pub partial: String,
}

/// Programs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ScheduleStage {
    /// Name of the model.
    pub model: String,
    /// In the order in which they run.
    pub programs: Vec<ProgramText>,
}

/// A program.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ProgramText {
    /// One line each.
    pub operations: Vec<String>,
    /// Its name.
    pub program: String,
    /// What becomes of the values.
    pub results: Vec<String>,
}

/// Machine code.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CodeStage {
    /// Name of the model.
    pub model: String,
    /// In the order in which they run.
    pub programs: Vec<ProgramCode>,
}

/// The machine code of a program.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ProgramCode {
    /// None for a program that is too long to be compiled.
    pub code: Option<String>,
    /// Its name.
    pub program: String,
}

/// The linear model: `x' = A x + B u`, `y = C x + D u`, and what multiplies delayed signals.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[allow(missing_docs, reason = "matrices by their names")]
pub struct LinearStage {
    #[serde(rename = "A")]
    pub a: CoefficientMatrix,
    #[serde(rename = "A_delayed")]
    pub a_delayed: CoefficientMatrix,
    #[serde(rename = "B")]
    pub b: CoefficientMatrix,
    #[serde(rename = "C")]
    pub c: CoefficientMatrix,
    #[serde(rename = "C_delayed")]
    pub c_delayed: CoefficientMatrix,
    #[serde(rename = "D")]
    pub d: CoefficientMatrix,
    /// Name of the model.
    pub model: String,
    /// States and inputs at the trim.
    pub trim: BTreeMap<String, f64>,
}

/// A matrix by its entries that are not zero everywhere.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct CoefficientMatrix {
    /// Names of the columns.
    pub columns: Vec<String>,
    /// The entries.
    pub entries: Vec<Coefficient>,
    /// Names of the rows.
    pub rows: Vec<String>,
}

/// An entry of a matrix.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Coefficient {
    /// Its column.
    pub column: String,
    /// In the parameters.
    pub expression: String,
    /// Its row.
    pub row: String,
    /// At the start values.
    pub value: f64,
}
