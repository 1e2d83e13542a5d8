//! The No-U-Turn sampler (Hoffman and Gelman, J. Mach. Learn. Res. 15, 2014) with multinomial weights, biased progressive sampling and the generalised
//! criterion of Betancourt (arXiv:1701.02434, 2017), as Stan has it: also between the halves of a trajectory.
//!
//! The metric is the identity: whoever asks gives a density in coordinates in which it is about that of independent unit normals, and changes these
//! during the warm-up ([`super::coordinates`]). All points of a trajectory lie in one arena, so that no step allocates.

use fdm_numeric::random::Stream;

/// A density that is known up to a factor.
pub(super) trait Density {
    /// Its logarithm at z (n), and the gradient of that (n). Minus infinity where it vanishes or cannot be computed.
    fn evaluate(&mut self, z: &[f64], gradient: &mut [f64]) -> f64;
}

/// Energy above that of the beginning at which a trajectory is given up as divergent.
const DIVERGENT: f64 = 1000.0;

/// How one transition went.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Transition {
    /// Mean probability with which the points of the trajectory would have been accepted (Metropolis).
    pub(super) accepted: f64,
    /// Steps.
    pub(super) steps: u32,
    /// Doublings.
    pub(super) depth: u32,
    /// Whether the energy ran away.
    pub(super) divergent: bool,
    /// Logarithm of the density at the new point.
    pub(super) log_density: f64,
    /// Energy at the new point.
    pub(super) energy: f64,
}

/// A point of phase space.
#[derive(Debug, Clone, Default)]
struct Point {
    z: Vec<f64>,
    gradient: Vec<f64>,
    momentum: Vec<f64>,
    log_density: f64,
}

impl Point {
    fn new(n: usize) -> Self {
        Self { z: vec![0.0; n], gradient: vec![0.0; n], momentum: vec![0.0; n], log_density: f64::NEG_INFINITY }
    }

    fn energy(&self) -> f64 {
        0.5 * self.momentum.iter().map(|p| p * p).sum::<f64>() - self.log_density
    }

    fn copy(&mut self, other: &Self) {
        self.z.copy_from_slice(&other.z);
        self.gradient.copy_from_slice(&other.gradient);
        self.momentum.copy_from_slice(&other.momentum);
        self.log_density = other.log_density;
    }
}

/// What a subtree keeps: its ends' momenta, the sum of all, and the point that was chosen.
#[derive(Debug, Clone, Default)]
struct Tree {
    /// Momentum at the beginning, in the direction of time of the subtree.
    begin: Vec<f64>,
    end: Vec<f64>,
    sum: Vec<f64>,
    chosen: Point,
    log_weight: f64,
}

impl Tree {
    fn new(n: usize) -> Self {
        let zeros = || vec![0.0; n];
        Self { begin: zeros(), end: zeros(), sum: zeros(), chosen: Point::new(n), log_weight: f64::NEG_INFINITY }
    }
}

/// The sampler with its memory.
pub(super) struct Nuts {
    /// Where the chain is.
    point: Point,
    /// Length of a step.
    pub(super) step: f64,
    most_depth: u32,
    forward: Point,
    backward: Point,
    /// Momenta at the inner and outer ends of both halves, and their sums.
    trees: Vec<Tree>,
    whole: Tree,
    work: Vec<f64>,
}

/// What the leaves of a trajectory add up.
struct Account {
    begin: f64,
    accepted: f64,
    steps: u32,
    divergent: bool,
}

impl Nuts {
    /// A chain of n unknowns.
    pub(super) fn new(n: usize, most_depth: u32) -> Self {
        Self {
            point: Point::new(n),
            step: 1.0,
            most_depth,
            forward: Point::new(n),
            backward: Point::new(n),
            trees: (0..2 * most_depth as usize + 2).map(|_| Tree::new(n)).collect(),
            whole: Tree::new(n),
            work: vec![0.0; n],
        }
    }

    /// Where the chain is.
    pub(super) fn position(&self) -> &[f64] {
        &self.point.z
    }

    /// Puts the chain to a place; says whether the density is positive there.
    pub(super) fn put(&mut self, z: &[f64], density: &mut dyn Density) -> bool {
        self.point.z.copy_from_slice(z);
        self.point.log_density = density.evaluate(z, &mut self.point.gradient);
        self.point.log_density.is_finite() && self.point.gradient.iter().all(|g| g.is_finite())
    }

    /// A step with which the first of a trajectory is accepted with about the probability 0.8 (algorithm 4 of Hoffman and Gelman, as Stan has it).
    pub(super) fn find_step(&mut self, density: &mut dyn Density, stream: &mut Stream) {
        let mut direction = 0.0;
        for _ in 0..60 {
            self.forward.copy(&self.point);
            self.forward.momentum.iter_mut().for_each(|p| *p = stream.normal());
            let before = self.forward.energy();
            leap(&mut self.forward, self.step, density);
            let gain = before - self.forward.energy();
            let good = gain.is_finite() && gain > 0.8f64.ln();
            let wanted = if good { 1.0 } else { -1.0 };
            if direction == 0.0 {
                direction = wanted;
            } else if direction != wanted {
                return;
            }
            self.step *= 2f64.powf(direction);
        }
    }

    /// One transition.
    pub(super) fn transit(&mut self, density: &mut dyn Density, stream: &mut Stream) -> Transition {
        self.point.momentum.iter_mut().for_each(|p| *p = stream.normal());
        let mut account = Account { begin: self.point.energy(), accepted: 0.0, steps: 0, divergent: false };
        self.forward.copy(&self.point);
        self.backward.copy(&self.point);
        self.whole.log_weight = 0.0;
        self.whole.chosen.copy(&self.point);
        self.whole.sum.copy_from_slice(&self.point.momentum);
        // momenta at the ends of the whole trajectory, backward and forward
        self.whole.begin.copy_from_slice(&self.point.momentum);
        self.whole.end.copy_from_slice(&self.point.momentum);
        let mut depth = 0;
        while depth < self.most_depth {
            let forward = stream.uniform() < 0.5;
            let mut trees = std::mem::take(&mut self.trees);
            let (new, rest) = trees.split_at_mut(1);
            let new = &mut new[0];
            let end = if forward { &mut self.forward } else { &mut self.backward };
            let sign = if forward { 1.0 } else { -1.0 };
            let sound =
                grow(depth, end, (sign * self.step, density), (stream, &mut account), new, rest, &mut self.work);
            if sound {
                depth += 1;
                // biased progressive sampling: the new half is preferred
                let gain = new.log_weight - self.whole.log_weight;
                if gain >= 0.0 || stream.uniform() < gain.exp() {
                    self.whole.chosen.copy(&new.chosen);
                }
            }
            let mut goes_on = sound;
            if sound {
                // the inner end of the old part, and the ends of the new one; `begin` of the new one touches the old
                let old_inner = if forward { &self.whole.end } else { &self.whole.begin };
                let old_outer = if forward { &self.whole.begin } else { &self.whole.end };
                sum_of(&mut self.work, &self.whole.sum, &new.sum);
                goes_on &= straight(&self.work, old_outer, &new.end);
                sum_of(&mut self.work, &self.whole.sum, &new.begin);
                goes_on &= straight(&self.work, old_outer, &new.begin);
                sum_of(&mut self.work, &new.sum, old_inner);
                goes_on &= straight(&self.work, old_inner, &new.end);
                self.whole.log_weight = log_sum(self.whole.log_weight, new.log_weight);
                self.whole.sum.iter_mut().zip(&new.sum).for_each(|(a, b)| *a += b);
                let outer = if forward { &mut self.whole.end } else { &mut self.whole.begin };
                outer.copy_from_slice(&new.end);
            }
            self.trees = trees;
            if !goes_on {
                break;
            }
        }
        self.point.copy(&self.whole.chosen);
        Transition {
            accepted: if account.steps > 0 { account.accepted / f64::from(account.steps) } else { 0.0 },
            steps: account.steps,
            depth,
            divergent: account.divergent,
            log_density: self.point.log_density,
            energy: self.point.energy(),
        }
    }
}

/// Grows a subtree of 2^depth points from `end` on; false where it turned back or diverged. `trees` is memory for what is inside.
fn grow(
    depth: u32,
    end: &mut Point,
    (step, density): (f64, &mut dyn Density),
    (stream, account): (&mut Stream, &mut Account),
    into: &mut Tree,
    trees: &mut [Tree],
    work: &mut [f64],
) -> bool {
    if depth == 0 {
        leap(end, step, density);
        account.steps += 1;
        let energy = end.energy();
        let loss = if energy.is_nan() { f64::INFINITY } else { energy - account.begin };
        account.divergent |= loss > DIVERGENT;
        account.accepted += if loss > 0.0 { (-loss).exp() } else { 1.0 };
        into.log_weight = -loss;
        into.chosen.copy(end);
        into.sum.copy_from_slice(&end.momentum);
        into.begin.copy_from_slice(&end.momentum);
        into.end.copy_from_slice(&end.momentum);
        return loss <= DIVERGENT;
    }
    let (own, rest) = trees.split_at_mut(1);
    let second = &mut own[0];
    if !grow(depth - 1, end, (step, &mut *density), (&mut *stream, &mut *account), into, rest, work) {
        return false;
    }
    if !grow(depth - 1, end, (step, &mut *density), (&mut *stream, &mut *account), second, rest, work) {
        return false;
    }
    let all = log_sum(into.log_weight, second.log_weight);
    if stream.uniform() < (second.log_weight - all).exp() {
        into.chosen.copy(&second.chosen);
    }
    into.log_weight = all;
    sum_of(work, &into.sum, &second.sum);
    let mut sound = straight(work, &into.begin, &second.end);
    sum_of(work, &into.sum, &second.begin);
    sound &= straight(work, &into.begin, &second.begin);
    sum_of(work, &second.sum, &into.end);
    sound &= straight(work, &into.end, &second.end);
    into.sum.iter_mut().zip(&second.sum).for_each(|(a, b)| *a += b);
    into.end.copy_from_slice(&second.end);
    sound
}

/// Whether a trajectory with this sum of momenta still moves away at both of its ends.
fn straight(sum: &[f64], begin: &[f64], end: &[f64]) -> bool {
    let dot = |a: &[f64]| a.iter().zip(sum).map(|(a, s)| a * s).sum::<f64>();
    dot(begin) > 0.0 && dot(end) > 0.0
}

fn sum_of(into: &mut [f64], a: &[f64], b: &[f64]) {
    into.iter_mut().zip(a.iter().zip(b)).for_each(|(s, (a, b))| *s = a + b);
}

/// ln(e^a + e^b)
fn log_sum(a: f64, b: f64) -> f64 {
    let (high, low) = (a.max(b), a.min(b));
    if low == f64::NEG_INFINITY { high } else { high + (low - high).exp().ln_1p() }
}

/// A leapfrog step.
fn leap(point: &mut Point, step: f64, density: &mut dyn Density) {
    let half = 0.5 * step;
    point.momentum.iter_mut().zip(&point.gradient).for_each(|(p, g)| *p += half * g);
    point.z.iter_mut().zip(&point.momentum).for_each(|(z, p)| *z += step * p);
    point.log_density = density.evaluate(&point.z, &mut point.gradient);
    if !point.log_density.is_finite() {
        point.log_density = f64::NEG_INFINITY;
        point.gradient.fill(0.0);
    }
    point.momentum.iter_mut().zip(&point.gradient).for_each(|(p, g)| *p += half * g);
}

/// Dual averaging of the step (section 3.2 of Hoffman and Gelman).
#[derive(Debug, Clone)]
pub(super) struct StepSearch {
    target: f64,
    centre: f64,
    count: f64,
    error: f64,
    average: f64,
}

impl StepSearch {
    pub(super) fn new(step: f64, target: f64) -> Self {
        Self { target, centre: (10.0 * step).ln(), count: 0.0, error: 0.0, average: 0.0 }
    }

    /// The next step, after one with this mean acceptance.
    pub(super) fn learn(&mut self, accepted: f64) -> f64 {
        const SHRINKAGE: f64 = 0.05;
        const DELAY: f64 = 10.0;
        const FADING: f64 = 0.75;
        self.count += 1.0;
        let share = 1.0 / (self.count + DELAY);
        self.error = (1.0 - share) * self.error + share * (self.target - accepted);
        let log = self.centre - self.error * self.count.sqrt() / SHRINKAGE;
        let weight = self.count.powf(-FADING);
        self.average = weight * log + (1.0 - weight) * self.average;
        log.exp()
    }

    /// The step that was learnt.
    pub(super) fn step(&self) -> f64 {
        self.average.exp()
    }
}
