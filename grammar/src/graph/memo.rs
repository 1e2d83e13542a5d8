//! Which node stands where: an index over an array of nodes that holds their numbers only.

use super::Node;
use hashbrown::hash_table::Entry;
use hashbrown::{DefaultHashBuilder, HashTable};
use std::hash::BuildHasher;

/// Numbers of nodes, found by the nodes' hashes. The hash is keyed by chance; nothing depends on its order.
#[derive(Debug, Clone, Default)]
pub(super) struct Memo {
    numbers: HashTable<u32>,
    hasher: DefaultHashBuilder,
}

impl Memo {
    /// The place of a node in `nodes`, where it is put when it is new.
    pub(super) fn place(&mut self, nodes: &mut Vec<Node>, node: Node) -> u32 {
        let hash = self.hasher.hash_one(node);
        let same = |number: &u32| nodes[*number as usize] == node;
        let again = |number: &u32| self.hasher.hash_one(nodes[*number as usize]);
        match self.numbers.entry(hash, same, again) {
            Entry::Occupied(entry) => *entry.get(),
            Entry::Vacant(entry) => {
                let number = nodes.len() as u32;
                entry.insert(number);
                nodes.push(node);
                number
            }
        }
    }
}
