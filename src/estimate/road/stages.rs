//! The estimations of one attempt in their order, each with its last state: an attempt that is repeated with them goes
//! through those that had ended at once and goes on in the last.

use super::ledger::Ledger;
use crate::estimate::progress::{Iteration, Observer, UnknownName};
use std::ops::ControlFlow;

/// An observer that remembers the states, keeps them, and hands them out again.
pub(in crate::estimate) struct Stages<'a> {
    observer: &'a mut dyn Observer,
    ledger: &'a Ledger<'a>,
    name: String,
    /// The last state of each estimation; empty where the start values could not be used.
    states: Vec<Vec<u8>>,
    /// Estimations begun.
    begun: usize,
    /// Whether states are wanted though nothing is kept.
    remember: bool,
}

impl<'a> Stages<'a> {
    /// Goes on from `states`; keeps under `name`.
    pub(in crate::estimate) fn new(
        observer: &'a mut dyn Observer,
        ledger: &'a Ledger<'a>,
        name: String,
        states: Vec<Vec<u8>>,
    ) -> Self {
        Self { observer, ledger, name, states, begun: 0, remember: false }
    }

    /// The same, for [`Self::into_states`].
    pub(in crate::estimate) fn remembering(self) -> Self {
        Self { remember: true, ..self }
    }

    pub(in crate::estimate) fn into_states(self) -> Vec<Vec<u8>> {
        self.states
    }
}

impl Observer for Stages<'_> {
    fn iteration(&mut self, iteration: &Iteration) -> ControlFlow<()> {
        self.observer.iteration(iteration)
    }

    fn begin(&mut self, names: &dyn Fn() -> Vec<UnknownName>) {
        self.observer.begin(names);
    }

    fn values(&mut self, values: &[f64]) {
        self.observer.values(values);
    }

    fn resume(&mut self) -> Option<Vec<u8>> {
        let state = self.states.get(self.begun).filter(|s| !s.is_empty()).cloned();
        self.begun += 1;
        state
    }

    fn state(&mut self, bytes: &dyn Fn() -> Vec<u8>) {
        if !(self.remember || self.ledger.is_open()) {
            return;
        }
        let Some(now) = self.begun.checked_sub(1) else { return };
        self.states.resize(now, Vec::new());
        self.states.push(bytes());
        self.ledger.put(&self.name, None, &self.states);
    }
}
