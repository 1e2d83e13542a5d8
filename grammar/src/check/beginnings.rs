//! Blocks of the text to expressions, those of initial values that need others in the order of their needs.

use super::expressions::{Expressions, Indices};
use super::functions::Function;
use super::kinds::Kinds;
use super::order::{Block, Blocks, Owner};
use super::scope::{Meaning, Scope, SymbolId};
use crate::diagnostic::{Code, Diagnostic};
use crate::op::Build;
use crate::syntax::{Expr, Role};

/// What building needs to know.
pub(super) struct Builder<'a, 'b> {
    pub(super) scope: &'b Scope<'a>,
    pub(super) blocks: &'b Blocks,
    pub(super) meanings: &'b [Meaning],
    pub(super) kinds: &'b Kinds,
    pub(super) indices: &'b Indices,
    /// Whether a limit has been told.
    pub(super) too_many: bool,
    pub(super) findings: &'b mut Vec<Diagnostic>,
}

/// How far an initial value is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Progress {
    New,
    Open,
    Done,
}

impl Builder<'_, '_> {
    /// Builds all nodes of a block.
    pub(super) fn block(&mut self, expressions: &mut Expressions, block: &Block) {
        for e in self.blocks.nodes(block).iter().filter(|e| !self.kinds.of(**e).broken) {
            let built = match expressions.node(self.scope, *e, self.meanings, self.indices, self.findings) {
                Ok(built) => built,
                Err(finding) => {
                    if !std::mem::replace(&mut self.too_many, true) {
                        self.findings.push(finding);
                    }
                    expressions.graph.number(0.0)
                }
            };
            expressions.nodes[e.0 as usize] = built;
            expressions.watch(self.scope, block, *e);
        }
        if let Some(state) = self.state(block) {
            let broken = self.kinds.of(block.root).broken;
            let value = if broken { expressions.graph.number(0.0) } else { expressions.of(block.root) };
            expressions.beginnings[state as usize] = Some(value);
        }
    }

    /// The index of the state whose initial value a block is.
    fn state(&self, block: &Block) -> Option<u32> {
        match block.owner {
            Owner::Value(s) if self.scope.symbols[s].valid && self.scope.symbols[s].role == Role::State => {
                Some(self.indices.of[s])
            }
            _ => None,
        }
    }

    /// Whether a block is an initial value with `initial(.)` in it.
    pub(super) fn needs_beginnings(&self, block: &Block) -> bool {
        let initial = Meaning::Function(Function::Initial);
        let calls = || self.blocks.nodes(block).iter().any(|e| self.meanings[e.0 as usize] == initial);
        self.state(block).is_some() && calls() && !self.kinds.of(block.root).broken
    }

    /// Builds initial values, each behind those that it needs.
    pub(super) fn beginnings(&mut self, expressions: &mut Expressions, later: &[&Block]) {
        let mut of_state: Vec<Option<usize>> = vec![None; expressions.beginnings.len()];
        for (b, block) in later.iter().enumerate() {
            self.state(block).into_iter().for_each(|k| of_state[k as usize] = Some(b));
        }
        let mut progress = vec![Progress::New; later.len()];
        for b in 0..later.len() {
            let mut open = vec![b];
            while let Some(b) = open.last().copied() {
                let first = progress[b] == Progress::New;
                if progress[b] == Progress::Done {
                    open.pop();
                    continue;
                }
                progress[b] = Progress::Open;
                let missing = if first { self.missing(expressions, later[b]) } else { Vec::new() };
                let waiting: Vec<usize> = missing.iter().filter_map(|k| of_state[*k as usize]).collect();
                if let Some(again) = waiting.iter().find(|w| progress[**w] == Progress::Open) {
                    self.circle(later[*again]);
                    let zero = expressions.graph.number(0.0);
                    missing.iter().for_each(|k| expressions.beginnings[*k as usize] = Some(zero));
                } else {
                    open.extend(waiting.iter().filter(|w| progress[**w] == Progress::New));
                }
                if open.last() == Some(&b) {
                    self.block(expressions, later[b]);
                    progress[b] = Progress::Done;
                    open.pop();
                }
            }
        }
    }

    /// The states without which a block cannot be built. Their expressions are built on the way.
    fn missing(&mut self, expressions: &mut Expressions, block: &Block) -> Vec<u32> {
        let mut missing = Vec::new();
        for e in self.blocks.nodes(block) {
            if self.meanings[e.0 as usize] == Meaning::Function(Function::Initial)
                && let Expr::Call(_, arguments) = self.scope.tree.expr(*e)
            {
                let argument = expressions.of(arguments[0]);
                missing.extend(expressions.initials.missing(&expressions.graph, argument, &expressions.beginnings));
                continue;
            }
            if let Ok(built) = expressions.node(self.scope, *e, self.meanings, self.indices, &mut Vec::new()) {
                expressions.nodes[e.0 as usize] = built;
            }
        }
        missing.sort_unstable();
        missing.dedup();
        missing
    }

    fn circle(&mut self, block: &Block) {
        let Owner::Value(s) = block.owner else { return };
        let s: SymbolId = s;
        let symbol = &self.scope.symbols[s];
        let span = self.scope.tree.span(block.root);
        let finding = if symbol.declaration.made.is_some() {
            let message = "what this block has at rest depends on itself";
            let hint = "write one block of the circle as a `state` with an initial value and an equation of its own";
            Diagnostic::new(Code::Cycle, span, message).hint(hint)
        } else {
            let message = format!("the initial value of `{}` depends on itself", symbol.name());
            Diagnostic::new(Code::Cycle, span, message).hint("give one of the initial values a number or a param")
        };
        self.findings.push(finding);
    }
}
