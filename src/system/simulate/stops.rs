//! States with hard limits: at the end of every step they are taken back into them, with the sensitivity of the limit.
//!
//! The rates see such a state inside its limits (`fdm_grammar`), so that a step which reaches a limit ends exactly there, and the
//! discrete response is a continuous function of the parameters whose derivative this is. A kink inside a step would cost
//! an error of second order in its length, once for each time that a limit is reached or left: explicit steps are cut there (`cuts.rs`).

use crate::dynamics::{Dynamics, Layout};

/// Which limited states were taken back at the ends of the last steps; allocates once.
#[derive(Debug, Clone, Default)]
pub(super) struct Stops {
    /// Of the last two steps: state, and row of its limit. The states may run one step ahead of their sensitivities.
    held: [Vec<(usize, usize)>; 2],
    /// By row of a limit: position of its derivative in `known`, and lane.
    terms: Vec<Vec<(usize, usize)>>,
    lanes: usize,
    /// Whether the model has limited states: asked in every step.
    any: bool,
}

impl Stops {
    pub(super) fn new(layout: &Layout) -> Self {
        let (stage, first) = (&layout.stage, layout.limits_by_param.start);
        let lane = |j: usize| stage.lane.get(j).copied().flatten().map(|lane| lane as usize);
        let pattern = &layout.patterns.limits_by_param;
        let row = |r: usize| pattern.row(r).filter_map(|(k, j)| Some((first + k, lane(j)?))).collect();
        Self {
            held: std::array::from_fn(|_| Vec::with_capacity(layout.limited.len())),
            terms: (0..layout.limits.len()).map(row).collect(),
            lanes: stage.lanes,
            any: !layout.limited.is_empty(),
        }
    }

    /// Takes the states at the end of step k back into their limits.
    #[inline(always)]
    pub(super) fn hold(&mut self, k: usize, dynamics: &dyn Dynamics, known: &[f64], x: &mut [f64]) {
        if self.any {
            let held = &mut self.held[k % 2];
            held.clear();
            take_back(dynamics.layout(), known, x, |state, row| held.push((state, row)));
        }
    }

    /// The sensitivities (n by lanes) of the states that were held at the end of step k become those of their limits.
    #[inline(always)]
    pub(super) fn follow(&self, k: usize, known: &[f64], s: &mut [f64]) {
        if !self.any {
            return;
        }
        for (state, row) in &self.held[k % 2] {
            let lanes = &mut s[state * self.lanes..][..self.lanes];
            lanes.fill(0.0);
            self.terms[*row].iter().for_each(|(from, lane)| lanes[*lane] = known[*from]);
        }
    }
}

/// Takes states (n) back into their limits, and says which by state and row of the limit; `known` is what `prepare` computed.
#[inline(always)]
pub fn take_back(layout: &Layout, known: &[f64], x: &mut [f64], mut held: impl FnMut(usize, usize)) {
    for (k, state) in layout.limited.iter().enumerate() {
        let (at, row) = (*state as usize, 2 * k);
        let [lower, upper] = [0, 1].map(|side| known[layout.limits.start + row + side]);
        // what is not a number stays that, and is told
        if x[at] < lower {
            x[at] = lower;
            held(at, row);
        } else if x[at] > upper {
            x[at] = upper;
            held(at, row + 1);
        }
    }
}

/// Whether a state (by index, with its value and rate) stands at a limit and its rate pushes outwards: its derivative is zero.
pub fn rests(layout: &Layout, known: &[f64], state: usize, x: f64, rate: f64) -> bool {
    let Some(k) = layout.limited.iter().position(|s| *s as usize == state) else { return false };
    let [lower, upper] = [0, 1].map(|side| known[layout.limits.start + 2 * k + side]);
    x <= lower && rate < 0.0 || x >= upper && rate > 0.0
}
