//! Which equation is solved for which derivative, and which equations hang together.

use std::collections::VecDeque;

/// A largest set of pairs of equation and derivative, each in one pair at most.
pub struct Matching {
    /// By equation: the derivative.
    pub of_equation: Vec<Option<usize>>,
    /// By derivative: the equation.
    pub of_rate: Vec<Option<usize>>,
}

impl Matching {
    /// `incidence` says by equation which derivatives are in it; `preferred` pairs stay where nothing speaks against them.
    pub fn new(incidence: &[Vec<usize>], rates: usize, preferred: &[Option<usize>]) -> Self {
        let mut pairs = Self { of_equation: vec![None; incidence.len()], of_rate: vec![None; rates] };
        for (k, rate) in preferred.iter().enumerate() {
            if let Some(rate) = rate.filter(|r| pairs.of_rate[*r].is_none()) {
                pairs.join(k, rate);
            }
        }
        for (k, own) in incidence.iter().enumerate() {
            let free = own.iter().find(|r| pairs.of_rate[**r].is_none());
            if let (None, Some(rate)) = (pairs.of_equation[k], free) {
                pairs.join(k, *rate);
            }
        }
        for k in 0..incidence.len() {
            if pairs.of_equation[k].is_none() {
                pairs.augment(incidence, k);
            }
        }
        pairs
    }

    fn join(&mut self, equation: usize, rate: usize) {
        (self.of_equation[equation], self.of_rate[rate]) = (Some(rate), Some(equation));
    }

    /// Finds a derivative for an equation by changing others, along a shortest alternating path.
    fn augment(&mut self, incidence: &[Vec<usize>], from: usize) {
        let mut reached: Vec<Option<usize>> = vec![None; self.of_rate.len()];
        let mut queue = VecDeque::from([from]);
        while let Some(k) = queue.pop_front() {
            for rate in &incidence[k] {
                if reached[*rate].is_some() {
                    continue;
                }
                reached[*rate] = Some(k);
                let Some(next) = self.of_rate[*rate] else { return self.turn(&reached, from, *rate) };
                queue.push_back(next);
            }
        }
    }

    fn turn(&mut self, reached: &[Option<usize>], from: usize, mut rate: usize) {
        while let Some(equation) = reached[rate] {
            let before = self.of_equation[equation];
            self.join(equation, rate);
            match before.filter(|_| equation != from) {
                Some(next) => rate = next,
                None => return,
            }
        }
    }

    /// The equations that have too few derivatives among them because some have none left, of which one is given, and these
    /// derivatives (Dulmage and Mendelsohn 1958).
    pub(super) fn too_many(&self, incidence: &[Vec<usize>], equation: usize) -> (Vec<usize>, Vec<usize>) {
        let mut idle: Vec<Vec<usize>> = vec![Vec::new(); self.of_rate.len()];
        for k in (0..incidence.len()).filter(|k| self.of_equation[*k].is_none()) {
            incidence[k].iter().for_each(|rate| idle[*rate].push(k));
        }
        let (mut equations, mut rates) = (vec![equation], Vec::new());
        let mut seen = vec![false; self.of_rate.len()];
        let mut listed = vec![false; incidence.len()];
        listed[equation] = true;
        let mut next = 0;
        while next < equations.len() {
            for rate in &incidence[equations[next]] {
                if !std::mem::replace(&mut seen[*rate], true) {
                    rates.push(*rate);
                    let others = self.of_rate[*rate].iter().chain(&idle[*rate]);
                    equations.extend(others.filter(|k| !std::mem::replace(&mut listed[**k], true)));
                }
            }
            next += 1;
        }
        equations.sort_unstable();
        rates.sort_unstable();
        (equations, rates)
    }

    /// The derivatives that have too few equations because some have none, of which one is given, and these equations.
    pub(super) fn too_few(&self, incidence: &[Vec<usize>], rate: usize) -> (Vec<usize>, Vec<usize>) {
        let mut users: Vec<Vec<usize>> = vec![Vec::new(); self.of_rate.len()];
        incidence.iter().enumerate().for_each(|(k, own)| own.iter().for_each(|r| users[*r].push(k)));
        let (mut equations, mut rates) = (Vec::new(), vec![rate]);
        let mut seen = vec![false; incidence.len()];
        let mut listed = vec![false; self.of_rate.len()];
        listed[rate] = true;
        let mut next = 0;
        while next < rates.len() {
            for k in &users[rates[next]] {
                if std::mem::replace(&mut seen[*k], true) {
                    continue;
                }
                equations.push(*k);
                let idle = incidence[*k].iter().filter(|r| self.of_rate[**r].is_none());
                let others = idle.chain(&self.of_equation[*k]);
                rates.extend(others.filter(|r| !std::mem::replace(&mut listed[**r], true)));
            }
            next += 1;
        }
        equations.sort_unstable();
        rates.sort_unstable();
        (equations, rates)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_are_changed_until_every_equation_has_one() {
        let incidence = vec![vec![0], vec![0, 1], vec![1, 2]];
        let pairs = Matching::new(&incidence, 3, &[None, Some(0), Some(1)]);
        assert_eq!(pairs.of_equation, [Some(0), Some(1), Some(2)]);
        assert_eq!(pairs.of_rate, [Some(0), Some(1), Some(2)]);
    }

    #[test]
    fn what_has_none_names_those_that_stand_in_the_way() {
        let incidence = vec![vec![0, 1], vec![0, 1], vec![0, 1], vec![2, 3]];
        let pairs = Matching::new(&incidence, 4, &[None; 4]);
        let left = (0..4).find(|k| pairs.of_equation[*k].is_none()).unwrap();
        assert_eq!(pairs.too_many(&incidence, left), (vec![0, 1, 2], vec![0, 1]));
        let rate = (0..4).find(|r| pairs.of_rate[*r].is_none()).unwrap();
        assert_eq!(pairs.too_few(&incidence, rate), (vec![3], vec![2, 3]));
    }
}
