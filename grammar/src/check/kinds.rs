//! Numbers and conditions are different things; constants, parameters and what varies come from different places.

use super::functions::Function;
use super::order::{Block, Blocks, Owner};
use super::scope::{Meaning, Scope};
use super::stated::{Known, Part};
use crate::diagnostic::{Code, Diagnostic};
use crate::syntax::{BinarySign, Expr, ExprRef, Role, UnarySign, Value};

/// On what an expression depends at most.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Level {
    /// Numbers and consts.
    Constant,
    /// Parameters.
    Param,
    /// Time, states, inputs.
    Varying,
}

/// What is known of a node, or of what a name stands for.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fact {
    /// On what it depends.
    pub(super) level: Level,
    /// A condition, not a number.
    pub(super) condition: bool,
    /// Contains a mistake that has been told.
    pub(super) broken: bool,
}

/// What is known of all nodes and names.
pub(super) struct Kinds {
    /// By node of the text.
    pub(super) nodes: Vec<Fact>,
    /// By symbol: what its name stands for in expressions.
    pub(super) symbols: Vec<Fact>,
    /// By symbol: a parameter that is defined by others.
    pub(super) derived: Vec<bool>,
}

const NUMBER: Fact = Fact { level: Level::Constant, condition: false, broken: false };
const BROKEN: Fact = Fact { broken: true, ..NUMBER };

impl Kinds {
    /// Finds the kind and the level of every node, block by block.
    pub(super) fn new(
        scope: &Scope<'_>,
        blocks: &Blocks,
        meanings: &[Meaning],
        circular: &[bool],
        known: &[Known],
        findings: &mut Vec<Diagnostic>,
    ) -> Self {
        let symbols = scope.symbols.iter().zip(circular).map(|(symbol, circular)| {
            let broken = *circular;
            match symbol.role {
                Role::Input | Role::State => Fact { level: Level::Varying, ..NUMBER },
                Role::Param => Fact { level: Level::Param, broken, ..NUMBER },
                Role::Known => Fact { level: Level::Param, ..NUMBER },
                Role::Table => Fact { broken, ..NUMBER },
                _ => Fact { broken: broken || !matches!(symbol.declaration.value, Some(Value::Expr(_))), ..NUMBER },
            }
        });
        let mut kinds = Self {
            nodes: vec![NUMBER; scope.tree.expressions.len()],
            symbols: symbols.collect(),
            derived: vec![false; scope.symbols.len()],
        };
        for block in &blocks.list {
            let mut judge = Judge { scope, owner: block.owner, meanings, kinds: &mut kinds, findings };
            for e in blocks.nodes(block) {
                let fact = judge.node(*e);
                judge.kinds.nodes[e.0 as usize] = fact;
            }
            let condition = matches!(block.owner, Owner::Known(k) if matches!(known[k].part, Part::Condition(_)));
            let hint = if condition { Hint::Condition } else { Hint::Number };
            let wanted = judge.want(block.root, condition, hint);
            if let Some(most) = kinds.finish(scope, block, known, wanted) {
                findings.push(too_variable(scope, blocks, block, meanings, &kinds, known, most));
            }
        }
        kinds
    }

    /// The fact of a node.
    pub(super) fn of(&self, e: ExprRef) -> Fact {
        self.nodes[e.0 as usize]
    }

    /// Compares what a block depends on with what its owner allows, and says what its name stands for.
    /// The most that is allowed, when it depends on more.
    fn finish(&mut self, scope: &Scope<'_>, block: &Block, known: &[Known], sound: bool) -> Option<Level> {
        let root = &mut self.nodes[block.root.0 as usize];
        root.broken |= !sound;
        let most = match block.owner {
            Owner::Value(s) => match scope.symbols[s].role {
                Role::Const => Level::Constant,
                Role::Param | Role::State => Level::Param,
                _ => Level::Varying,
            },
            Owner::Known(k) if matches!(known[k].part, Part::Trim | Part::Intensity) => Level::Param,
            Owner::Known(k) if known[k].part == Part::Noise || known[k].part.is_of_event() => Level::Varying,
            Owner::Ordinate(_) | Owner::Tie(_) | Owner::Limit(_) => Level::Param,
            Owner::Abscissa(..) | Owner::Lower(_) | Owner::Upper(_) | Owner::Known(_) => Level::Constant,
            Owner::Left(_) | Owner::Right(_) | Owner::Like(_) | Owner::Want(..) => Level::Varying,
        };
        let exceeded = !root.broken && root.level > most;
        root.broken |= exceeded;
        let root = self.nodes[block.root.0 as usize];
        if let Owner::Abscissa(s, _) | Owner::Ordinate(s) = block.owner {
            let table = &mut self.symbols[s];
            (table.level, table.broken) = (table.level.max(root.level), table.broken || root.broken);
        }
        if let Owner::Value(s) = block.owner {
            match scope.symbols[s].role {
                Role::Param => self.derived[s] = !root.broken && root.level == Level::Param,
                Role::Let | Role::Output | Role::Const => {
                    self.symbols[s] = Fact { broken: self.symbols[s].broken || root.broken, ..root };
                }
                Role::State | Role::Input | Role::Known | Role::Table => {}
            }
        }
        exceeded.then_some(most)
    }

    /// The level of a name or of `t`.
    fn level(&self, meaning: Meaning) -> Level {
        match meaning {
            Meaning::Symbol(s) | Meaning::Table(s) => self.symbols[s].level,
            Meaning::Time | Meaning::Record(_) => Level::Varying,
            _ => Level::Constant,
        }
    }
}

/// What a complaint about the wrong kind suggests.
#[derive(Clone, Copy, PartialEq)]
enum Hint {
    Number,
    Chain,
    Condition,
}

struct Judge<'a, 'b> {
    scope: &'b Scope<'a>,
    owner: Owner,
    meanings: &'b [Meaning],
    kinds: &'b mut Kinds,
    findings: &'b mut Vec<Diagnostic>,
}

impl Judge<'_, '_> {
    fn node(&mut self, e: ExprRef) -> Fact {
        let meaning = self.meanings[e.0 as usize];
        match self.scope.tree.expr(e) {
            Expr::Number(_) => NUMBER,
            Expr::Name(_) => match meaning {
                Meaning::Symbol(s) => self.kinds.symbols[s],
                Meaning::Broken => BROKEN,
                _ => Fact { level: self.kinds.level(meaning), ..NUMBER },
            },
            Expr::Unary(UnarySign::Not, a) => self.joined(&[*a], true, true, Hint::Condition),
            Expr::Unary(_, a) => self.joined(&[*a], false, false, Hint::Number),
            Expr::Binary(sign, a, b, _) => match sign {
                BinarySign::And | BinarySign::Or => self.joined(&[*a, *b], true, true, Hint::Condition),
                sign if is_comparison(*sign) => self.joined(&[*a, *b], false, true, Hint::Chain),
                _ => self.joined(&[*a, *b], false, false, Hint::Number),
            },
            Expr::If(c, a, b) => {
                let choice = self.joined(&[*c], true, true, Hint::Condition);
                let branches = self.joined(&[*a, *b], false, false, Hint::Number);
                Fact { level: choice.level.max(branches.level), broken: choice.broken || branches.broken, ..NUMBER }
            }
            Expr::Call(_, arguments) => {
                let mut fact = self.joined(arguments, false, false, Hint::Number);
                fact.level = fact.level.max(self.kinds.level(meaning));
                fact.broken |= match meaning {
                    Meaning::Broken => true,
                    Meaning::Table(s) => self.kinds.symbols[s].broken,
                    _ => false,
                };
                if meaning == Meaning::Function(Function::Der) {
                    fact.level = Level::Varying;
                }
                if meaning == Meaning::Function(Function::Initial) {
                    fact.level = fact.level.min(Level::Param);
                    fact.broken |= !self.begins_a_state(e);
                }
                if meaning == Meaning::Function(Function::Delay) && !fact.broken {
                    fact.broken = !self.steady_delay(arguments[1]);
                }
                fact
            }
            Expr::Vector(_) | Expr::Element(..) => BROKEN,
        }
    }

    /// The fact of an operation whose operands must all be conditions, or all numbers.
    fn joined(&mut self, operands: &[ExprRef], conditions: bool, condition: bool, hint: Hint) -> Fact {
        let mut fact = Fact { condition, ..NUMBER };
        for operand in operands {
            let sound = self.want(*operand, conditions, hint);
            let operand = self.kinds.of(*operand);
            fact.level = fact.level.max(operand.level);
            fact.broken |= operand.broken || !sound;
        }
        fact
    }

    /// Tells when an operand is of the wrong kind.
    fn want(&mut self, e: ExprRef, condition: bool, hint: Hint) -> bool {
        let fact = self.kinds.of(e);
        if fact.broken || fact.condition == condition {
            return true;
        }
        let span = self.scope.tree.span(e);
        let comparison = matches!(self.scope.tree.expr(e), Expr::Binary(sign, ..) if is_comparison(*sign));
        self.findings.push(match hint {
            Hint::Condition => {
                Diagnostic::new(Code::WantedCondition, span, "a condition is needed here, this is a number")
                    .hint("compare it with something, such as `x > 0`")
            }
            Hint::Chain if comparison => {
                Diagnostic::new(Code::WantedNumber, span, "a number is needed here, this is a condition")
                    .hint("write `a < b and b < c` instead of `a < b < c`")
            }
            _ => Diagnostic::new(Code::WantedNumber, span, "a number is needed here, this is a condition")
                .hint("`if condition then 1 else 0` makes it a number"),
        });
        false
    }

    /// `initial(x)` is known when a run begins, which is where states need it.
    fn begins_a_state(&mut self, e: ExprRef) -> bool {
        let fits = matches!(self.owner, Owner::Value(s) if self.scope.symbols[s].role == Role::State);
        if !fits {
            let message = "`initial(...)` stands in the initial value of a state only";
            let finding = Diagnostic::new(Code::Unsupported, self.scope.tree.span(e), message);
            self.findings.push(finding.hint("hold it in a state: `state x0 = initial(x); der(x0) = 0;`"));
        }
        fits
    }

    fn steady_delay(&mut self, tau: ExprRef) -> bool {
        let steady = self.kinds.of(tau).level <= Level::Param;
        if !steady {
            let finding =
                Diagnostic::new(Code::BadDelay, self.scope.tree.span(tau), "a delay must not change during the run");
            self.findings.push(finding.hint("it may depend on params, consts and numbers only"));
        }
        steady
    }
}

fn is_comparison(sign: BinarySign) -> bool {
    use BinarySign::*;
    matches!(sign, Less | LessEqual | Greater | GreaterEqual | Equal | NotEqual)
}

/// The complaint about a value that depends on what it must not depend on, shown at the name that does it.
fn too_variable(
    scope: &Scope<'_>,
    blocks: &Blocks,
    block: &Block,
    meanings: &[Meaning],
    kinds: &Kinds,
    known: &[Known],
    most: Level,
) -> Diagnostic {
    let mut culprits = blocks.nodes(block).iter().filter(|e| kinds.level(meanings[e.0 as usize]) > most);
    let culprit = culprits.next().copied().unwrap_or(block.root);
    let what = match meanings[culprit.0 as usize] {
        Meaning::Symbol(s) => format!("the {} `{}`", scope.symbols[s].role.keyword(), scope.symbols[s].name()),
        Meaning::Record(s) => format!("the record of `{}`", scope.symbols[s].name()),
        _ => "the time `t`".to_string(),
    };
    let span = scope.tree.span(culprit);
    match block.owner {
        Owner::Lower(s) | Owner::Upper(s) => {
            let message = format!("the bounds of `{}` cannot depend on {what}", scope.symbols[s].name());
            Diagnostic::new(Code::BadBounds, span, message).hint("bounds are made of numbers and consts")
        }
        Owner::Value(s) => {
            let symbol = &scope.symbols[s];
            let (subject, hint) = match symbol.role {
                Role::Const => ("the const", format!("`let {} = ...;` may depend on anything", symbol.name())),
                Role::Param => ("the param", format!("`let {} = ...;` may depend on anything", symbol.name())),
                _ => (
                    "the initial value of",
                    format!("it may depend on params; `state {} = free` estimates it", symbol.name()),
                ),
            };
            let message = format!("{subject} `{}` cannot depend on {what}", symbol.name());
            Diagnostic::new(Code::NotConstant, span, message).hint(hint)
        }
        Owner::Tie(s) => {
            let message = format!("what the param `{}` is tied to cannot depend on {what}", scope.symbols[s].name());
            Diagnostic::new(Code::NotConstant, span, message).hint("a tie is made of params, consts and numbers")
        }
        Owner::Abscissa(s, _) | Owner::Ordinate(s) => {
            let ordinate = matches!(block.owner, Owner::Ordinate(_));
            let name = scope.symbols[s].name();
            let (part, hint) = match ordinate {
                true => ("ordinates", "they are made of numbers, consts and params"),
                false => ("abscissae", "they are made of numbers and consts; ordinates may be params"),
            };
            let message = format!("the {part} of the table `{name}` cannot depend on {what}");
            Diagnostic::new(Code::NotConstant, span, message).hint(hint)
        }
        Owner::Known(k) | Owner::Limit(k) => {
            let message = format!("{} cannot depend on {what}", known[k].words(scope));
            let hint = match most {
                Level::Constant => "it is made of numbers and consts",
                _ if known[k].part == Part::Intensity || known[k].part.is_limit() => {
                    "it is made of numbers, consts and params"
                }
                _ => "it is made of numbers, consts and params; what is not given is found from the equations",
            };
            Diagnostic::new(Code::NotConstant, span, message).hint(hint)
        }
        Owner::Left(_) | Owner::Right(_) | Owner::Like(_) | Owner::Want(..) => {
            Diagnostic::new(Code::NotConstant, span, format!("this cannot depend on {what}"))
        }
    }
}
