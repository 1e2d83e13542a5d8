//! Which node stands where: an index over an array of nodes that holds their numbers only, four bytes for each.

use super::Node;
use std::hash::{BuildHasher, RandomState};

/// Open addressing with linear probing; the hash is keyed, so that no text can make the probes long.
#[derive(Debug, Clone, Default)]
pub(super) struct Memo {
    /// Numbers of nodes or [`FREE`]; a power of two, at most half of them taken.
    slots: Vec<u32>,
    hasher: RandomState,
}

const FREE: u32 = u32::MAX;
const SMALLEST: usize = 64;

impl Memo {
    /// The place of a node in `nodes`, where it is put when it is new.
    pub(super) fn place(&mut self, nodes: &mut Vec<Node>, node: Node) -> u32 {
        if self.slots.len() < 2 * (nodes.len() + 1) {
            self.grow(nodes);
        }
        let slot = self.slot(nodes, &node);
        if self.slots[slot] == FREE {
            self.slots[slot] = nodes.len() as u32;
            nodes.push(node);
        }
        self.slots[slot]
    }

    /// The slot of a node, or the free one where it belongs.
    fn slot(&self, nodes: &[Node], node: &Node) -> usize {
        let mask = self.slots.len() - 1;
        let mut slot = self.hasher.hash_one(node) as usize & mask;
        while self.slots[slot] != FREE && nodes[self.slots[slot] as usize] != *node {
            slot = (slot + 1) & mask;
        }
        slot
    }

    #[cold]
    fn grow(&mut self, nodes: &[Node]) {
        let size = (4 * nodes.len()).next_power_of_two().max(SMALLEST);
        self.slots = vec![FREE; size];
        let mask = size - 1;
        for (k, node) in nodes.iter().enumerate() {
            // the nodes differ: the first free slot is theirs
            let mut slot = self.hasher.hash_one(node) as usize & mask;
            while self.slots[slot] != FREE {
                slot = (slot + 1) & mask;
            }
            self.slots[slot] = k as u32;
        }
    }
}
