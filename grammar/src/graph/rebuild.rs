//! Expressions built anew in another graph, with other leaves where that is wanted.

use super::{Graph, Leaf, Node, Signal};
use crate::op::{Build, ExprId};

/// What a leaf refers to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reference {
    /// Anything at its own time; never a delayed signal.
    Now(Leaf),
    /// A signal at an earlier time; the delay is an expression of the new graph.
    Earlier(Signal, ExprId),
}

impl Graph {
    /// A reference as it is.
    pub fn reference(&mut self, reference: Reference) -> ExprId {
        match reference {
            Reference::Now(leaf) => self.leaf(leaf),
            Reference::Earlier(signal, tau) => self.delay(signal, tau),
        }
    }

    /// The expressions `roots` of this graph built anew in `into`, where `reference` says what becomes of each leaf.
    /// Delays that no root needs are left behind.
    pub fn rebuild(
        &self,
        roots: &[ExprId],
        into: &mut Graph,
        mut reference: impl FnMut(&mut Graph, Reference) -> ExprId,
    ) -> Vec<ExprId> {
        let mut moved = vec![ExprId::NONE; self.nodes.len()];
        for e in self.reachable(roots.iter().copied().chain(self.delays_of(roots))) {
            moved[e.index()] = match self.node(e) {
                Node::Constant(bits) => into.number(f64::from_bits(bits)),
                Node::Leaf(Leaf::Delayed(k)) => {
                    let delayed = self.delayed[k as usize];
                    reference(into, Reference::Earlier(delayed.signal, moved[delayed.tau.index()]))
                }
                Node::Leaf(leaf) => reference(into, Reference::Now(leaf)),
                Node::Apply(op, args) => {
                    let args = args.map(|a| moved.get(a.index()).copied().unwrap_or(a));
                    into.apply(op, &args[..op.row().arity])
                }
            };
        }
        roots.iter().map(|r| moved[r.index()]).collect()
    }

    /// The delays of the delayed signals that `roots` need, one for each signal.
    pub fn delays_of(&self, roots: &[ExprId]) -> Vec<ExprId> {
        let tau = |e: ExprId| match self.node(e) {
            Node::Leaf(Leaf::Delayed(k)) => Some(self.delayed[k as usize].tau),
            _ => None,
        };
        self.reachable(roots.iter().copied()).into_iter().filter_map(tau).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::op::Op;

    #[test]
    fn leaves_are_replaced_also_where_they_are_delayed() {
        let mut old = Graph::default();
        let (x, tau, unused) = (old.leaf(Leaf::State(0)), old.leaf(Leaf::Param(0)), old.leaf(Leaf::Param(1)));
        let (late, _) = (old.delay(Signal::State(0), tau), old.delay(Signal::State(1), unused));
        let sum = old.apply(Op::Add, &[x, late]);
        let mut new = Graph::default();
        let moved = old.rebuild(&[sum], &mut new, |g, reference| match reference {
            Reference::Now(Leaf::State(0)) => g.leaf(Leaf::Input(7)),
            Reference::Earlier(Signal::State(0), tau) => g.delay(Signal::Input(7), tau),
            other => g.reference(other),
        });
        assert_eq!(new.delayed().iter().map(|d| d.signal).collect::<Vec<_>>(), [Signal::Input(7)]);
        let value = new.evaluate(moved[0], |leaf| match leaf {
            Leaf::Input(7) => 2.0,
            Leaf::Delayed(0) => 5.0,
            other => panic!("{other:?}"),
        });
        assert_eq!(value, 7.0);
    }
}
