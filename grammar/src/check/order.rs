//! The expressions of a model as blocks, in an order in which every name is defined before it is used.

use super::equations::Equation;
use super::scope::{Meaning, Scope, SymbolId};
use super::stated::{Bond, Known};
use crate::diagnostic::{Code, Diagnostic};
pub(super) use crate::syntax::operands as each_operand;
use crate::syntax::{ExprRef, Role, Value};
use std::collections::{HashMap, HashSet, VecDeque};
use std::ops::Range;

/// What an expression is to the model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Owner {
    /// The value of a declaration.
    Value(SymbolId),
    /// The lower bound.
    Lower(SymbolId),
    /// The upper bound.
    Upper(SymbolId),
    /// An expression in the unit of a block's state.
    Like(SymbolId),
    /// An argument of a block, by its number among those of the name.
    Want(SymbolId, usize),
    /// What a param is tied to.
    Tie(SymbolId),
    /// The value of an argument of a table at a node, and which argument.
    Abscissa(SymbolId, usize),
    /// The value of a table at a node.
    Ordinate(SymbolId),
    /// The left side of an equation that is solved for derivatives, by index.
    Left(usize),
    /// The right side of an equation, by index.
    Right(usize),
    /// A value of a `prior`, `noise` or `trim`, by index.
    Known(usize),
    /// A limit of a state, by its index among what is known.
    Limit(usize),
}

/// One whole expression of the text.
#[derive(Debug, Clone)]
pub(super) struct Block {
    /// What it is for.
    pub(super) owner: Owner,
    /// Its outermost node.
    pub(super) root: ExprRef,
    range: Range<usize>,
}

/// All expressions of a model.
#[derive(Debug, Default)]
pub(super) struct Blocks {
    /// Nodes, block by block, operands before their users.
    pub(super) nodes: Vec<ExprRef>,
    /// First in the order of the text; [`sort`] makes it the order of definition.
    pub(super) list: Vec<Block>,
}

impl Blocks {
    /// Collects declarations, equations, and what is known.
    pub(super) fn new(scope: &Scope<'_>, equations: &[Equation], bonds: &[Bond], known: &[Known]) -> Self {
        let mut blocks = Self::default();
        let mut seen = vec![false; scope.tree.expressions.len()];
        let mut add = |owner, root| blocks.add(scope, &mut seen, owner, root);
        for (s, symbol) in scope.symbols.iter().enumerate() {
            if let (Some(Value::Expr(root)), true) = (symbol.declaration.value, symbol.role != Role::Input) {
                add(Owner::Value(s), root);
            }
            if let Some(bounds) = symbol.declaration.bounds {
                add(Owner::Lower(s), bounds.lower);
                add(Owner::Upper(s), bounds.upper);
            }
            if let Some(made) = &symbol.declaration.made {
                made.like.iter().for_each(|like| add(Owner::Like(s), *like));
                made.wants.iter().enumerate().for_each(|(k, want)| add(Owner::Want(s, k), want.argument));
            }
            let Some((axes, values)) = symbol.table.map(|t| t.nodes.grid()) else { continue };
            if let [axis] = &axes[..] {
                for (x, y) in axis.iter().zip(values) {
                    add(Owner::Abscissa(s, 0), *x);
                    add(Owner::Ordinate(s), y);
                }
                continue;
            }
            for (k, axis) in axes.iter().enumerate() {
                axis.iter().for_each(|x| add(Owner::Abscissa(s, k), *x));
            }
            values.into_iter().for_each(|y| add(Owner::Ordinate(s), y));
        }
        bonds.iter().for_each(|b| add(Owner::Tie(b.symbol), b.root));
        for (k, equation) in equations.iter().enumerate() {
            if equation.implicit {
                add(Owner::Left(k), equation.left);
            }
            add(Owner::Right(k), equation.right);
        }
        for (k, known) in known.iter().enumerate() {
            add(if known.part.is_limit() { Owner::Limit(k) } else { Owner::Known(k) }, known.root);
        }
        blocks
    }

    /// The nodes of a block, operands before their users.
    pub(super) fn nodes(&self, block: &Block) -> &[ExprRef] {
        &self.nodes[block.range.clone()]
    }

    fn add(&mut self, scope: &Scope<'_>, seen: &mut [bool], owner: Owner, root: ExprRef) {
        let start = self.nodes.len();
        let mut open = vec![root];
        while let Some(e) = open.pop() {
            if !std::mem::replace(&mut seen[e.0 as usize], true) {
                self.nodes.push(e);
                each_operand(scope.tree.expr(e), |operand| open.push(operand));
            }
        }
        self.nodes[start..].sort_unstable();
        self.list.push(Block { owner, root, range: start..self.nodes.len() });
    }
}

/// Brings the blocks into the order of definition and tells of circles; the result says for each symbol whether it
/// is part of one.
pub(super) fn sort(
    scope: &Scope<'_>,
    blocks: &mut Blocks,
    meanings: &[Meaning],
    findings: &mut Vec<Diagnostic>,
) -> Vec<bool> {
    let count = scope.symbols.len();
    let mut defined_by: Vec<Vec<usize>> = vec![Vec::new(); count];
    for (k, block) in blocks.list.iter().enumerate() {
        defines(scope, block.owner).into_iter().for_each(|s| defined_by[s].push(k));
    }
    let needs: Vec<Vec<SymbolId>> = (0..count)
        .map(|s| {
            let nodes = defined_by[s].iter().flat_map(|k| blocks.nodes(&blocks.list[*k]));
            let mentioned = nodes.filter_map(|e| match meanings[e.0 as usize] {
                Meaning::Symbol(d) | Meaning::Table(d) if !defined_by[d].is_empty() => Some(d),
                _ => None,
            });
            mentioned.collect()
        })
        .collect();
    let mut circular = vec![false; count];
    let mut order = Vec::with_capacity(blocks.list.len());
    for group in components(&needs) {
        if group.len() > 1 || needs[group[0]].contains(&group[0]) {
            group.iter().for_each(|s| circular[*s] = true);
            findings.push(circle(scope, &needs, &group, &defined_by));
        }
        order.extend(group.iter().flat_map(|s| &defined_by[*s]));
    }
    order.extend((0..blocks.list.len()).filter(|k| defines(scope, blocks.list[*k].owner).is_none()));
    blocks.list = order.iter().map(|k| blocks.list[*k].clone()).collect();
    circular
}

/// The name that stands for a block wherever it is mentioned.
fn defines(scope: &Scope<'_>, owner: Owner) -> Option<SymbolId> {
    match owner {
        Owner::Value(s) if !matches!(scope.symbols[s].role, Role::State | Role::Input) => Some(s),
        Owner::Tie(s) | Owner::Abscissa(s, _) | Owner::Ordinate(s) => Some(s),
        _ => None,
    }
}

/// Strongly connected components, what is needed first (Tarjan 1972, with a stack of its own).
pub(super) fn components(needs: &[Vec<SymbolId>]) -> Vec<Vec<SymbolId>> {
    const NEW: usize = usize::MAX;
    let mut index = vec![NEW; needs.len()];
    let mut low = vec![0; needs.len()];
    let mut on_path = vec![false; needs.len()];
    let (mut path, mut groups, mut next) = (Vec::new(), Vec::new(), 0);
    for start in 0..needs.len() {
        let mut calls = if index[start] == NEW { vec![(start, 0)] } else { Vec::new() };
        while let Some((v, edge)) = calls.pop() {
            if edge == 0 {
                (index[v], low[v]) = (next, next);
                next += 1;
                path.push(v);
                on_path[v] = true;
            } else {
                low[v] = low[v].min(low[needs[v][edge - 1]]);
            }
            let open = (edge..needs[v].len()).find(|k| {
                let w = needs[v][*k];
                if index[w] != NEW && on_path[w] {
                    low[v] = low[v].min(index[w]);
                }
                index[w] == NEW
            });
            if let Some(k) = open {
                calls.push((v, k + 1));
                calls.push((needs[v][k], 0));
            } else if low[v] == index[v] {
                let from = path.iter().rposition(|w| *w == v).unwrap_or(0);
                let group: Vec<_> = path.drain(from..).collect();
                group.iter().for_each(|w| on_path[*w] = false);
                groups.push(group);
            }
        }
    }
    groups
}

/// The shortest way from `first` back to itself inside its group.
fn shortest_circle(needs: &[Vec<SymbolId>], group: &[SymbolId], first: SymbolId) -> Vec<SymbolId> {
    let members: HashSet<SymbolId> = group.iter().copied().collect();
    let mut before: HashMap<SymbolId, SymbolId> = HashMap::new();
    let mut queue = VecDeque::from([first]);
    while let Some(v) = queue.pop_front() {
        for w in needs[v].iter().filter(|w| members.contains(w)) {
            if !before.contains_key(w) {
                before.insert(*w, v);
                queue.push_back(*w);
            }
        }
    }
    let mut names = vec![first];
    let mut at = first;
    while let Some(v) = before.get(&at) {
        names.push(*v);
        at = *v;
        if at == first {
            break;
        }
    }
    names.reverse();
    names
}

/// Names of a circle that a message shows.
const LONGEST_CIRCLE: usize = 12;

/// Describes the shortest circle through the member that is declared first.
fn circle(scope: &Scope<'_>, needs: &[Vec<SymbolId>], group: &[SymbolId], defined_by: &[Vec<usize>]) -> Diagnostic {
    let first = group.iter().copied().min().unwrap_or_default();
    let names = shortest_circle(needs, group, first);
    let name = |s: &SymbolId| format!("`{}`", scope.symbols[*s].name());
    let length = names.len() - 1;
    let chain = if names.len() <= LONGEST_CIRCLE {
        names.iter().map(name).collect::<Vec<_>>().join(" -> ")
    } else {
        let (head, tail) = (&names[..LONGEST_CIRCLE - 3], &names[length - 1..]);
        let text = |part: &[SymbolId]| part.iter().map(name).collect::<Vec<_>>().join(" -> ");
        format!("{} -> ... ({length} names) ... -> {}", text(head), text(tail))
    };
    let message = match length {
        1 => format!("`{}` is defined by itself", scope.symbols[first].name()),
        _ => format!("definitions refer to each other in a circle: {chain}"),
    };
    let mut finding = Diagnostic::new(Code::Cycle, scope.symbols[first].declaration.name.span, message);
    for s in names[1..length].iter().take(LONGEST_CIRCLE) {
        finding = finding.label(scope.symbols[*s].declaration.name.span, "part of the circle");
    }
    let all = |role: Role| names.iter().all(|s| scope.symbols[*s].role == role);
    let tied = names.iter().any(|s| defined_by[*s].len() > 1 && scope.symbols[*s].role == Role::Param);
    finding.hint(if tied {
        "remove one of the ties"
    } else if all(Role::Param) || all(Role::Const) {
        "give one of them a number"
    } else if length == 1 {
        "a definition holds at all times: give the new value a name of its own; what changes with time is a `state`"
    } else {
        "break it with a `state`, whose equation may refer to itself"
    })
}
