//! The order of the elimination: blocks of states that influence each other, and in a block pivots that fill least.

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
