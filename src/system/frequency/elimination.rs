//! Symbolic elimination of (j w - A): pivots on the diagonal, block by block of states that influence each other, in an order that fills
//! least; structural zeros are left out.

use super::expression::{Expressions, Scalar, Value};

/// The eliminated matrix as expressions.
#[derive(Clone)]
pub(super) struct Elimination {
    size: usize,
    /// States in the order of elimination, and the block of each.
    order: Vec<usize>,
    block: Vec<usize>,
    /// Inside blocks, as it was when its pivot was reached; between blocks as it was given.
    entries: Vec<Option<Value>>,
    /// One over the pivots.
    inverse: Vec<Option<Value>>,
}

impl Elimination {
    /// Eliminates the matrix (n by n, row-major), whose diagonal is full; `diagonal` are the real constants on it.
    pub(super) fn new(g: &mut Expressions, mut entries: Vec<Option<Value>>, diagonal: &[Scalar]) -> Self {
        let size = diagonal.len();
        let depends = (0..size).map(|i| (0..size).filter(|j| *j != i && entries[i * size + j].is_some()).collect());
        let blocks = blocks(&depends.collect());
        let (mut inverse, mut block) = (vec![None; size], vec![0; size]);
        for (b, states) in blocks.iter().enumerate() {
            states.iter().for_each(|k| block[*k] = b);
            for (position, &k) in states.iter().enumerate() {
                let Some(pivot) = entries[k * size + k] else { continue };
                let reciprocal = g.pivot(pivot, diagonal[k]);
                inverse[k] = Some(reciprocal);
                let left = &states[position + 1..];
                for &j in left {
                    let Some(across) = entries[k * size + j] else { continue };
                    let across = g.product(reciprocal, across);
                    for &i in left {
                        let Some(down) = entries[i * size + k] else { continue };
                        let product = g.product(down, across);
                        let product = g.negative(product);
                        let jw = false;
                        let sum: Vec<Value> = entries[i * size + j].into_iter().chain([product]).collect();
                        entries[i * size + j] = flattened(g, jw, &sum);
                    }
                }
            }
        }
        Self { size, order: blocks.concat(), block, entries, inverse }
    }

    /// x of (j w - A) x = b.
    pub(super) fn solve(&self, g: &mut Expressions, right: &[Option<Value>]) -> Vec<Option<Value>> {
        let n = self.size;
        let mut x: Vec<Option<Value>> = vec![None; n];
        // what stands on the right once the pivots before are eliminated
        let mut reduced: Vec<Option<Value>> = vec![None; n];
        let mut from = 0;
        while from < n {
            let to = from + self.order[from..].iter().take_while(|k| self.same(**k, self.order[from])).count();
            for at in from..to {
                let k = self.order[at];
                let mut sum: Vec<Value> = right[k].into_iter().collect();
                for &j in &self.order[..from] {
                    self.subtract(g, (k, j), x[j], &mut sum);
                }
                for &j in &self.order[from..at] {
                    let step = self.times_inverse(g, j, reduced[j]);
                    self.subtract(g, (k, j), step, &mut sum);
                }
                reduced[k] = g.sum(false, &sum);
            }
            for at in (from..to).rev() {
                let k = self.order[at];
                let mut sum: Vec<Value> = reduced[k].into_iter().collect();
                for &j in &self.order[at + 1..to] {
                    self.subtract(g, (k, j), x[j], &mut sum);
                }
                let sum = g.sum(false, &sum);
                x[k] = self.times_inverse(g, k, sum);
            }
            from = to;
        }
        x
    }

    /// w of w (j w - A) = c, a row of C (j w - A)^-1.
    pub(super) fn solve_left(&self, g: &mut Expressions, row: &[Option<Value>]) -> Vec<Option<Value>> {
        let n = self.size;
        let mut w: Vec<Option<Value>> = vec![None; n];
        let mut reduced: Vec<Option<Value>> = vec![None; n];
        let mut to = n;
        while to > 0 {
            let last = self.order[to - 1];
            let from = to - self.order[..to].iter().rev().take_while(|k| self.same(**k, last)).count();
            for at in from..to {
                let k = self.order[at];
                let mut sum: Vec<Value> = row[k].into_iter().collect();
                for &i in &self.order[to..] {
                    self.subtract(g, (i, k), w[i], &mut sum);
                }
                for &i in &self.order[from..at] {
                    let step = self.times_inverse(g, i, reduced[i]);
                    self.subtract(g, (i, k), step, &mut sum);
                }
                reduced[k] = g.sum(false, &sum);
            }
            for at in (from..to).rev() {
                let k = self.order[at];
                let mut sum: Vec<Value> = reduced[k].into_iter().collect();
                for &i in &self.order[at + 1..to] {
                    self.subtract(g, (i, k), w[i], &mut sum);
                }
                let sum = g.sum(false, &sum);
                w[k] = self.times_inverse(g, k, sum);
            }
            to = from;
        }
        w
    }

    fn same(&self, a: usize, b: usize) -> bool {
        self.block[a] == self.block[b]
    }

    fn times_inverse(&self, g: &mut Expressions, k: usize, value: Option<Value>) -> Option<Value> {
        let (inverse, value) = (self.inverse[k]?, value?);
        Some(g.product(inverse, value))
    }

    fn subtract(&self, g: &mut Expressions, (i, j): (usize, usize), value: Option<Value>, sum: &mut Vec<Value>) {
        let (Some(entry), Some(value)) = (self.entries[i * self.size + j], value) else { return };
        let product = g.product(entry, value);
        sum.push(g.negative(product));
    }
}

/// The sum of values of which the first may be a sum itself (an entry that was changed before): one sum of all.
fn flattened(g: &mut Expressions, jw: bool, values: &[Value]) -> Option<Value> {
    use super::expression::Expression;
    if let [Value { factor: Scalar::ONE, node: Some(node) }, rest @ ..] = values
        && let Expression::Sum { jw: inner, constant, terms } = &g.nodes[*node as usize]
    {
        let (inner, constant) = (*inner, *constant);
        let mut all: Vec<Value> = terms.iter().map(|(f, n)| Value { factor: *f, node: Some(*n) }).collect();
        all.push(Value { factor: constant, node: None });
        all.extend_from_slice(rest);
        return g.sum(jw || inner, &all);
    }
    g.sum(jw, values)
}

/// Which states each state's rate depends on, itself left out.
pub(super) type Influences = Vec<Vec<usize>>;

/// Blocks of states that influence each other, each behind those that it depends on, in the order in which they are
/// eliminated.
pub(super) fn blocks(depends: &Influences) -> Vec<Vec<usize>> {
    let mut blocks = components(depends);
    for block in &mut blocks {
        *block = pivots(depends, block);
    }
    blocks
}

/// Strongly connected components (Tarjan 1972, without recursion), each behind those that it depends on.
fn components(depends: &Influences) -> Vec<Vec<usize>> {
    const NEW: usize = usize::MAX;
    let n = depends.len();
    let (mut index, mut low, mut on_stack) = (vec![NEW; n], vec![0; n], vec![false; n]);
    let (mut stack, mut path, mut found, mut count) = (Vec::new(), Vec::new(), Vec::new(), 0);
    for root in 0..n {
        if index[root] != NEW {
            continue;
        }
        path.push((root, 0));
        while let Some((node, next)) = path.pop() {
            if next == 0 {
                (index[node], low[node], on_stack[node]) = (count, count, true);
                count += 1;
                stack.push(node);
            } else {
                low[node] = low[node].min(low[depends[node][next - 1]]);
            }
            let mut next = next;
            let mut deeper = None;
            while let Some(&other) = depends[node].get(next) {
                next += 1;
                if index[other] == NEW {
                    deeper = Some(other);
                    break;
                }
                if on_stack[other] {
                    low[node] = low[node].min(index[other]);
                }
            }
            if let Some(other) = deeper {
                path.push((node, next));
                path.push((other, 0));
                continue;
            }
            if low[node] == index[node] {
                let at = stack.iter().rposition(|s| *s == node).unwrap_or(0);
                let mut component = stack.split_off(at);
                component.iter().for_each(|s| on_stack[*s] = false);
                component.sort_unstable();
                found.push(component);
            }
        }
    }
    found
}

/// Diagonal pivots of a block in the order of least fill (Markowitz 1957); of equals the first.
fn pivots(depends: &Influences, block: &[usize]) -> Vec<usize> {
    let size = block.len();
    let mut full = vec![false; size * size];
    for (i, state) in block.iter().enumerate() {
        for other in &depends[*state] {
            if let Ok(j) = block.binary_search(other) {
                full[i * size + j] = i != j;
            }
        }
    }
    let (mut left, mut order): (Vec<usize>, Vec<usize>) = ((0..size).collect(), Vec::with_capacity(size));
    while !left.is_empty() {
        let cost = |k: usize| {
            let row = left.iter().filter(|j| full[k * size + **j]).count();
            row * left.iter().filter(|i| full[**i * size + k]).count()
        };
        let Some(pivot) = left.iter().copied().min_by_key(|k| cost(*k)) else { break };
        left.retain(|k| *k != pivot);
        for i in left.iter().filter(|i| full[**i * size + pivot]).copied().collect::<Vec<_>>() {
            for j in left.iter().filter(|j| **j != i) {
                full[i * size + j] |= full[pivot * size + j];
            }
        }
        order.push(block[pivot]);
    }
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn loops_are_blocks_behind_what_drives_them() {
        // 0 <-> 3 driven by 2, which is driven by 1; 4 is driven by the loop
        let depends = vec![vec![3], vec![], vec![1], vec![0, 2], vec![0, 3]];
        assert_eq!(blocks(&depends), [vec![1], vec![2], vec![0, 3], vec![4]]);
        assert!(blocks(&Vec::new()).is_empty());
    }

    #[test]
    fn the_hub_of_a_star_is_eliminated_last() {
        let depends = vec![vec![1, 2, 3], vec![0], vec![0], vec![0]];
        assert_eq!(blocks(&depends), [vec![1, 2, 0, 3]].map(|b| b.to_vec()));
    }

    #[test]
    fn a_long_chain_needs_no_deep_stack() {
        let n = 3000;
        let depends: Influences = (0..n).map(|i| if i + 1 < n { vec![i + 1] } else { vec![] }).collect();
        let found = blocks(&depends);
        assert_eq!((found.len(), found[0][0], found[n - 1][0]), (n, n - 1, 0));
    }
}
