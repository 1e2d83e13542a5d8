//! The model exactly as written: statements, expressions, places. No meaning yet.
//!
//! Expressions live in one array in which children stand before their parents, so that no pass recurses and a sum
//! of 200,000 terms costs memory but no stack.

use crate::source::Span;

/// A word of the text with its place.
#[derive(Debug, Clone, PartialEq)]
pub struct Name {
    /// As written (strings without their quotes, units without their brackets).
    pub text: String,
    /// Where.
    pub span: Span,
}

/// Index of an expression in [`SyntaxTree::expressions`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ExprRef(pub u32);

/// What stands before a single operand.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum UnarySign {
    /// `-x`
    Minus,
    /// `+x`
    Plus,
    /// `not c`
    Not,
}

/// What stands between two operands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BinarySign {
    /// `+`
    Add,
    /// `-`
    Subtract,
    /// `*`
    Multiply,
    /// `/`
    Divide,
    /// `^`
    Power,
    /// `<`
    Less,
    /// `<=`
    LessEqual,
    /// `>`
    Greater,
    /// `>=`
    GreaterEqual,
    /// `==`
    Equal,
    /// `!=`
    NotEqual,
    /// `and`
    And,
    /// `or`
    Or,
}

/// One expression; its operands have smaller indices.
#[derive(Debug, Clone, PartialEq)]
pub enum Expr {
    /// A number.
    Number(f64),
    /// A name: declared in the model, or `t`, `pi`.
    Name(String),
    /// A sign before an operand.
    Unary(UnarySign, ExprRef),
    /// A sign between operands; `span` is that of the sign.
    Binary(BinarySign, ExprRef, ExprRef, Span),
    /// A function, `delay` and `der` among them.
    Call(Name, Vec<ExprRef>),
    /// `if condition then a else b`
    If(ExprRef, ExprRef, ExprRef),
    /// `[a, b, c]`: a vector; of vectors, the rows of a matrix
    Vector(Vec<ExprRef>),
    /// `x[2]`, `A[1, :]`: elements or parts of a declared vector or matrix, counted from 1
    Element(Name, Vec<Slice>),
}

/// One index: `2`, `1:3`, `:`; both ends belong to it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Slice {
    /// One element.
    At(u32),
    /// From one to another.
    Range(u32, u32),
    /// All.
    All,
}

/// The kinds of declarations.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Role {
    /// `input`
    Input,
    /// `known`: a value that each run brings
    Known,
    /// `state`
    State,
    /// `param`
    Param,
    /// `const`
    Const,
    /// `let`
    Let,
    /// `output`
    Output,
    /// `table`: a function through nodes, declared by a statement of its own
    Table,
}

impl Role {
    /// The kinds that stand before a list of declarations.
    pub const ALL: [Role; 7] =
        [Self::Input, Self::Known, Self::State, Self::Param, Self::Const, Self::Let, Self::Output];

    /// `an input`, `a state`.
    pub(crate) fn with_article(self) -> String {
        let article = if matches!(self, Self::Input | Self::Output) { "an" } else { "a" };
        format!("{article} {}", self.keyword())
    }

    /// The keyword.
    pub fn keyword(self) -> &'static str {
        match self {
            Self::Input => "input",
            Self::Known => "known",
            Self::State => "state",
            Self::Param => "param",
            Self::Const => "const",
            Self::Let => "let",
            Self::Output => "output",
            Self::Table => "table",
        }
    }
}

impl Expr {
    /// Visits the operands.
    pub fn each_operand(&self, mut visit: impl FnMut(ExprRef)) {
        match self {
            Expr::Number(_) | Expr::Name(_) | Expr::Element(..) => {}
            Expr::Unary(_, a) => visit(*a),
            Expr::Binary(_, a, b, _) => [*a, *b].into_iter().for_each(visit),
            Expr::If(c, a, b) => [*c, *a, *b].into_iter().for_each(visit),
            Expr::Call(_, arguments) | Expr::Vector(arguments) => arguments.iter().copied().for_each(visit),
        }
    }
}

/// What stands behind `=` in a declaration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Value {
    /// An expression.
    Expr(ExprRef),
    /// `free`: estimated per run (initial states only).
    Free(Span),
}

/// `in [lower, upper]`
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// Least value.
    pub lower: ExprRef,
    /// Greatest value.
    pub upper: ExprRef,
    /// From `in` to the closing bracket.
    pub span: Span,
}

/// The size of a declared vector (one column) or matrix.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shape {
    /// Length of a vector, rows of a matrix.
    pub rows: u32,
    /// `None` for a vector.
    pub columns: Option<u32>,
    /// The brackets.
    pub span: Span,
}

/// What a declaration that stands for a block says of its unit and of the block's arguments.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Made {
    /// An expression in the unit of a state.
    pub like: Option<ExprRef>,
    /// What the arguments of the block must be.
    pub wants: Vec<Want>,
}

/// What an argument of a block must be.
#[derive(Debug, Clone, PartialEq)]
pub struct Want {
    /// In messages: "the time constant of `lag`".
    pub what: String,
    /// The argument: a number or a name.
    pub argument: ExprRef,
    /// Its unit.
    pub unit: Asked,
    /// Its size where the estimation starts.
    pub size: Size,
}

/// The unit of an argument.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Asked {
    /// A time.
    Time,
    /// One over a time, or an angle in rad over a time.
    Rate,
    /// A pure number.
    Number,
    /// That of the other coefficients of the polynomial, by powers of time.
    Coefficient {
        /// The power that it stands before.
        power: u32,
        /// Which of the two polynomials.
        denominator: bool,
    },
}

/// The size of an argument at the start values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Size {
    /// Any.
    Any,
    /// Above zero.
    Positive,
    /// Not zero.
    NotZero,
}

/// One declared name with what was written about it, in whatever order.
#[derive(Debug, Clone, PartialEq)]
pub struct Declaration {
    /// The name.
    pub name: Name,
    /// `[3]`, `[2, 3]` behind the name: rows, or rows and columns.
    pub shape: Option<Shape>,
    /// `"doc string"`
    pub doc: Option<Name>,
    /// `[unit]`, as text between the brackets.
    pub unit: Option<Name>,
    /// `= value`
    pub value: Option<Value>,
    /// `in [lower, upper]`
    pub bounds: Option<Bounds>,
    /// `fixed`
    pub fixed: Option<Span>,
    /// `per run`
    pub per_run: Option<Span>,
    /// `per group aircraft`: the name of the groups
    pub group: Option<Name>,
    /// `wrap 360`: the period of an angle
    pub wrap: Option<Wrap>,
    /// `log`: estimated by its logarithm
    pub log: Option<Span>,
    /// `held` or `linear`: how an input goes between samples
    pub hold: Option<Hold>,
    /// Said of what no user wrote: a state or a `let` of a block.
    pub made: Option<Made>,
    /// Said of a value that no user wrote: whether a run belongs to a group.
    pub membership: Option<Membership>,
    /// The whole declaration.
    pub span: Span,
}

impl Declaration {
    /// A name about which nothing else is written.
    pub fn new(name: Name, span: Span) -> Self {
        Self {
            name,
            shape: None,
            doc: None,
            unit: None,
            value: None,
            bounds: None,
            fixed: None,
            per_run: None,
            group: None,
            wrap: None,
            log: None,
            hold: None,
            made: None,
            membership: None,
            span,
        }
    }
}

/// A group of runs: a value that stands for it is 1 in its runs and 0 in the others.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Membership {
    /// What the groups are called together, `aircraft`.
    pub grouping: String,
    /// The group, `A`.
    pub group: String,
}

/// `held`, `linear`: how an input goes between samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Hold {
    /// Whether it keeps its value until the next one; else it goes in straight lines.
    pub held: bool,
    /// The word.
    pub span: Span,
}

/// `wrap 360`, `wrap 2*pi`: values that differ by a multiple of the period are the same.
#[derive(Debug, Clone, PartialEq)]
pub struct Wrap {
    /// The period, in the unit of the output.
    pub period: f64,
    /// As it was written.
    pub text: String,
    /// The word and the period.
    pub span: Span,
}

/// `table CL(alpha [rad]) "lift" [1] = linear { -0.2: -0.9, 0: CL0, 0.3: 1.6 };`
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// The name by which it is called.
    pub name: Name,
    /// One to three.
    pub arguments: Vec<Argument>,
    /// `"doc string"`
    pub doc: Option<Name>,
    /// The unit of its values.
    pub unit: Option<Name>,
    /// The word behind `=`: how values between points are found.
    pub method: Name,
    /// Where its values are known.
    pub nodes: Nodes,
    /// `param Mq(V) = -1.5 at [20, 40];`: its name stands for its value at the quantities that its arguments are called after.
    pub scheduled: bool,
    /// Bounds of its free values.
    pub bounds: Option<Bounds>,
}

impl Table {
    /// What its nodes are called after: the table behind a scheduled parameter is `Mq(V)`, its nodes are `Mq[1]`, `Mq[2]`.
    pub fn stem(&self) -> &str {
        self.name.text.split('(').next().unwrap_or_default()
    }
}

/// An argument of a table.
#[derive(Debug, Clone, PartialEq)]
pub struct Argument {
    /// Its name, for readers and before its axis.
    pub name: Name,
    /// Its unit.
    pub unit: Option<Name>,
}

/// The nodes of a table: where its values are known, and what they are.
#[derive(Debug, Clone, PartialEq)]
pub enum Nodes {
    /// `{ -0.2: -0.9, 0: CL0 }`: abscissa and ordinate.
    Points(Vec<(ExprRef, ExprRef)>),
    /// `{ alpha: [0, 0.1], delta: [-1, 1], CL: [[a, b], [c, d]] }`: axes by their arguments, and the values at their crossings.
    Written(Vec<Axis>),
    /// `from "cl.csv"`, `from "cl.csv" free`
    File(Name, Option<Span>),
    /// Written out: an axis for each argument, and the values at all crossings, those of the last argument next to each other.
    Grid(Vec<Vec<ExprRef>>, Vec<ExprRef>),
}

/// `alpha: [0, 0.1]`, `CL: free`, `CL: free 0.3`
#[derive(Debug, Clone, PartialEq)]
pub struct Axis {
    /// The name of an argument, or of the table: then these are its values.
    pub name: Name,
    /// `free`: values to be estimated.
    pub free: Option<Span>,
    /// The values; where they are free, those where the estimation starts.
    pub values: Option<ExprRef>,
}

impl Nodes {
    /// Visits its expressions.
    pub fn each_root(&self, mut visit: impl FnMut(ExprRef)) {
        match self {
            Self::Points(points) => points.iter().for_each(|(x, y)| [*x, *y].into_iter().for_each(&mut visit)),
            Self::Written(axes) => axes.iter().filter_map(|a| a.values).for_each(visit),
            Self::File(..) => {}
            Self::Grid(axes, values) => axes.iter().flatten().chain(values).copied().for_each(visit),
        }
    }

    /// An axis for each argument, and the values at all crossings, those of the last argument next to each other; empty where they are not
    /// written out yet. Points are a grid of one axis.
    pub fn grid(&self) -> (Vec<Vec<ExprRef>>, Vec<ExprRef>) {
        match self {
            Self::Points(points) => {
                let (x, y) = points.iter().copied().unzip();
                (vec![x], y)
            }
            Self::Grid(axes, values) => (axes.clone(), values.clone()),
            Self::Written(_) | Self::File(..) => (Vec::new(), Vec::new()),
        }
    }

    /// These nodes made of other expressions.
    #[must_use]
    pub fn moved(&self, mut to: impl FnMut(ExprRef) -> ExprRef) -> Self {
        match self {
            Self::Points(points) => Self::Points(points.iter().map(|(x, y)| (to(*x), to(*y))).collect()),
            Self::Written(axes) => {
                Self::Written(axes.iter().map(|a| Axis { values: a.values.map(&mut to), ..a.clone() }).collect())
            }
            Self::File(path, free) => Self::File(path.clone(), *free),
            Self::Grid(axes, values) => {
                let axes = axes.iter().map(|axis| axis.iter().map(|e| to(*e)).collect()).collect();
                Self::Grid(axes, values.iter().map(|e| to(*e)).collect())
            }
        }
    }
}

/// `smooth CL by order 2;`
#[derive(Debug, Clone, PartialEq)]
pub struct Smooth {
    /// The table.
    pub table: Name,
    /// Which differences of its values are small.
    pub order: u32,
    /// Where the order stands.
    pub order_span: Span,
}

/// `x in [a, b] smooth w`: how far a state may go.
#[derive(Debug, Clone, PartialEq)]
pub struct Limited {
    /// The state, or elements of it.
    pub state: Name,
    /// Between which values.
    pub bounds: Bounds,
    /// The width over which its rate fades out before a limit.
    pub smooth: Option<ExprRef>,
}

impl Limited {
    /// All its expressions.
    pub fn roots(&self) -> impl Iterator<Item = ExprRef> + use<> {
        [self.bounds.lower, self.bounds.upper].into_iter().chain(self.smooth)
    }
}

/// `when x > limit { v = -0.5*v; }`: states that get new values as soon as a condition becomes true.
#[derive(Debug, Clone, PartialEq)]
pub struct When {
    /// The condition.
    pub condition: ExprRef,
    /// The states, and their values behind the event, made of what stands before it.
    pub resets: Vec<(Name, ExprRef)>,
}

/// `use "actuator.fdm" as act(x = dlon, T = T_act);`
#[derive(Debug, Clone, PartialEq)]
pub struct Use {
    /// The file of the submodel, as written between quotes.
    pub path: Name,
    /// Its name here: what it declares is `act.y`.
    pub alias: Name,
    /// What stands for its inputs and params.
    pub connections: Vec<(Name, ExprRef)>,
    /// Whether it is a functional mock-up unit: `use fmu "engine.fmu" as eng(...);`.
    pub foreign: bool,
}

/// `A + 2*B -> C : k*A*B;`, `X <-> Y : kf*X, kr*Y;`
#[derive(Debug, Clone, PartialEq)]
pub struct Reaction {
    /// What is consumed.
    pub left: Vec<Species>,
    /// What is made.
    pub right: Vec<Species>,
    /// Whether something takes part that is not modelled: `0` on a side.
    pub is_open: bool,
    /// The rate.
    pub forward: ExprRef,
    /// The rate backwards, of `<->`.
    pub reverse: Option<ExprRef>,
    /// The whole reaction.
    pub span: Span,
}

/// `2*B`, `n*B`: so many of a species.
#[derive(Debug, Clone, PartialEq)]
pub struct Species {
    /// Its name.
    pub name: Name,
    /// How many.
    pub count: f64,
    /// The param that tells how many, times the count.
    pub factor: Option<Name>,
}

/// One statement.
#[derive(Debug, Clone, PartialEq)]
pub enum StatementKind {
    /// `role name ..., name ...;`
    Declare(Role, Vec<Declaration>),
    /// `left = right;`, with `der(x)` on the left
    Equation(ExprRef, ExprRef),
    /// `time [unit];`: the unit of `t` and of the time in `der`; seconds when not given
    Time(Name),
    /// `prior a ~ normal(mean, deviation), ...;`: a param or `x(0)`, and a distribution
    Prior(Vec<(ExprRef, ExprRef)>),
    /// `noise y = deviation, ...;`
    Noise(Vec<(Name, ExprRef)>),
    /// `noise der(x) = intensity, ...;`: by state.
    Process(Vec<(Name, ExprRef)>),
    /// `trim { u = value; ... }`
    Trim(Vec<(Name, ExprRef)>),
    /// `tie Lq = Mp, a = 2*b;`: equalities between declared params that a study may switch off
    Tie(Vec<(Name, ExprRef)>),
    /// `table NAME(x) = method { x1: y1, ... };`
    Table(Table),
    /// `smooth CL by order 2;`
    Smooth(Smooth),
    /// `requirement name = expression in [lower, upper], ...;`
    Requirement(Vec<Declaration>),
    /// `limit x in [a, b] smooth w, ...;`
    Limit(Vec<Limited>),
    /// `when condition { x = value; ... }`
    When(When),
    /// `use "file" as name(a = b);`
    Use(Use),
    /// `reactions in V { ... }`: the volume of amounts, and the reactions
    Reactions(Option<ExprRef>, Vec<Reaction>),
}

/// Visits the whole expressions of a statement.
pub fn each_root(kind: &StatementKind, mut visit: impl FnMut(ExprRef)) {
    match kind {
        StatementKind::Declare(_, list) | StatementKind::Requirement(list) => {
            for d in list {
                if let Some(Value::Expr(e)) = d.value {
                    visit(e);
                }
                d.bounds.iter().for_each(|b| [b.lower, b.upper].into_iter().for_each(&mut visit));
                let made = d.made.iter().flat_map(|m| m.like.into_iter().chain(m.wants.iter().map(|w| w.argument)));
                made.for_each(&mut visit);
            }
        }
        StatementKind::Equation(a, b) => [*a, *b].into_iter().for_each(visit),
        StatementKind::Time(_) | StatementKind::Smooth(_) => {}
        StatementKind::Prior(pairs) => pairs.iter().for_each(|(a, b)| [*a, *b].into_iter().for_each(&mut visit)),
        StatementKind::Noise(list)
        | StatementKind::Process(list)
        | StatementKind::Trim(list)
        | StatementKind::Tie(list) => {
            list.iter().for_each(|(_, e)| visit(*e));
        }
        StatementKind::Table(table) => {
            table.nodes.each_root(&mut visit);
            table.bounds.iter().for_each(|b| [b.lower, b.upper].into_iter().for_each(&mut visit));
        }
        StatementKind::Limit(list) => list.iter().flat_map(Limited::roots).for_each(visit),
        StatementKind::When(event) => {
            visit(event.condition);
            event.resets.iter().for_each(|(_, e)| visit(*e));
        }
        StatementKind::Use(submodel) => submodel.connections.iter().for_each(|(_, e)| visit(*e)),
        StatementKind::Reactions(volume, list) => {
            volume.iter().for_each(|e| visit(*e));
            list.iter().for_each(|r| [Some(r.forward), r.reverse].into_iter().flatten().for_each(&mut visit));
        }
    }
}

/// A statement and its place, the semicolon included.
#[derive(Debug, Clone, PartialEq)]
pub struct Statement {
    /// What it says.
    pub kind: StatementKind,
    /// Where.
    pub span: Span,
}

/// A whole model as written.
#[derive(Debug, Clone, PartialEq)]
pub struct SyntaxTree {
    /// The model's name.
    pub name: Name,
    /// The model's doc string.
    pub doc: Option<Name>,
    /// Statements in the order of the text.
    pub statements: Vec<Statement>,
    /// All expressions, operands before the expressions that use them.
    pub expressions: Vec<(Expr, Span)>,
    /// Names mentioned in statements that could not be read: nothing more is told about them.
    pub suspended: Vec<String>,
}

impl SyntaxTree {
    /// The expression behind a reference.
    pub fn expr(&self, e: ExprRef) -> &Expr {
        &self.expressions[e.0 as usize].0
    }

    /// Where an expression stands.
    pub fn span(&self, e: ExprRef) -> Span {
        self.expressions[e.0 as usize].1
    }
}

/// Visits the operands of an expression.
pub fn operands(expr: &Expr, mut visit: impl FnMut(ExprRef)) {
    match expr {
        Expr::Number(_) | Expr::Name(_) | Expr::Element(..) => {}
        Expr::Unary(_, a) => visit(*a),
        Expr::Binary(_, a, b, _) => [*a, *b].into_iter().for_each(visit),
        Expr::If(c, a, b) => [*c, *a, *b].into_iter().for_each(visit),
        Expr::Call(_, arguments) | Expr::Vector(arguments) => arguments.iter().copied().for_each(visit),
    }
}
