//! Why equations cannot be solved for their derivatives, in words.

use super::equations::no_equation;
use super::rates::Solver;
use super::substitution::Obstacle;
use crate::diagnostic::{Code, Diagnostic};
use crate::source::Span;

/// Equations and derivatives that a message shows.
const MOST_SHOWN: usize = 8;

impl Solver<'_, '_> {
    /// Equations that are more than the derivatives in them.
    pub(super) fn too_many(&self, k: usize, equations: &[usize], rates: &[usize]) -> Diagnostic {
        let span = self.place(k);
        let (message, code) = match rates {
            [] => ("no derivative is left in this equation".to_string(), Code::SingularRates),
            [rate] => {
                (format!("{} equations determine {}", equations.len(), self.derivative(*rate)), Code::TwoEquations)
            }
            _ => {
                let names = self.list(rates);
                let counts = format!("{} equations determine {} derivatives", equations.len(), rates.len());
                (format!("{counts}: {names}"), Code::SingularRates)
            }
        };
        let finding = Diagnostic::new(code, span, message);
        self.labelled(finding, equations, span).hint("as many equations as derivatives are needed: remove one")
    }

    /// Derivatives that are more than the equations for them.
    pub(super) fn too_few(&self, rate: usize, equations: &[usize], rates: &[usize]) -> Diagnostic {
        if equations.is_empty() {
            return no_equation(self.scope, self.states[rate]);
        }
        let name = &self.scope.symbols[self.states[rate]].declaration.name;
        let (equation, verb) =
            if equations.len() == 1 { ("equation", "determines") } else { ("equations", "determine") };
        let counts = format!("{} {equation} {verb} {} derivatives", equations.len(), rates.len());
        let finding = Diagnostic::new(Code::SingularRates, name.span, format!("{counts}: {}", self.list(rates)));
        self.labelled(finding, equations, name.span).hint("one equation is needed for each state")
    }

    fn labelled(&self, mut finding: Diagnostic, equations: &[usize], but: Span) -> Diagnostic {
        for place in equations.iter().map(|k| self.place(*k)).filter(|place| *place != but).take(MOST_SHOWN) {
            finding = finding.label(place, "one of these equations");
        }
        finding
    }

    fn derivative(&self, rate: usize) -> String {
        format!("`der({})`", self.scope.symbols[self.states[rate]].name())
    }

    fn list(&self, rates: &[usize]) -> String {
        let mut names: Vec<String> = rates.iter().take(MOST_SHOWN).map(|r| self.derivative(*r)).collect();
        if rates.len() > MOST_SHOWN {
            names.push("...".into());
        }
        names.join(", ")
    }

    /// A set that is too large to be solved.
    pub(super) fn too_large(&self, group: &[usize], unknown: &[usize], limit: &str) -> Diagnostic {
        let span = self.place(group[0]);
        let message = format!("{} equations are coupled by {}, and {limit}", group.len(), self.list(unknown));
        let finding = Diagnostic::new(Code::TooLarge, span, message);
        finding.hint("solve some of them by hand, so that `der(x) = ...;` holds no derivative on its right side")
    }

    /// A state with a limit whose derivative is coupled with others.
    pub(super) fn limited(&self, group: &[usize], state: usize) -> Diagnostic {
        let name = self.scope.symbols[self.states[state]].name();
        let span = self.place(group[0]);
        let message = format!("`{name}` has a limit, but its derivative is not given by an equation of its own");
        let finding = self.labelled(Diagnostic::new(Code::SingularRates, span, message), group, span);
        finding.hint(format!("write `der({name}) = ...;` without other derivatives that depend on it"))
    }

    /// A set whose determinant is zero; `rows` are those that are left of it.
    pub(super) fn singular(&self, group: &[usize], rows: &[usize], states: &[usize], when: &str) -> Diagnostic {
        let left: Vec<usize> = rows.iter().filter_map(|r| group.get(*r).copied()).collect();
        let k = left.first().or(group.first()).copied().unwrap_or(0);
        let span = self.place(k);
        let message = match group {
            [_] => format!("{} is multiplied with zero in its equation{when}", self.list(states)),
            _ => format!(
                "the equations for {} do not determine them{when}: their determinant is zero",
                self.list(states)
            ),
        };
        let finding = self.labelled(Diagnostic::new(Code::SingularRates, span, message), group, span);
        finding.hint(if when.is_empty() {
            "an equation is a multiple of others"
        } else {
            "choose other start values of params and states"
        })
    }

    /// Where an equation begins.
    pub(super) fn place(&self, k: usize) -> Span {
        self.scope.tree.span(self.equations[k].left)
    }

    /// What stands in an expression.
    pub(super) fn obstacle(&self, obstacle: Obstacle, span: Span, group: &[usize]) -> Diagnostic {
        match obstacle {
            Obstacle::Nonlinear(states) => {
                let message = format!("this equation is not linear in {}", self.list(&states));
                let finding = self.labelled(Diagnostic::new(Code::NonlinearRate, span, message), group, span);
                finding.hint(
                    "derivatives that are solved for stand in sums, each times or divided by what holds none of them",
                )
            }
            Obstacle::Earlier(state) => {
                let name = self.derivative(state);
                let message = format!("{name} depends on derivatives at earlier times, which depend on {name}");
                let finding = Diagnostic::new(Code::Unsupported, span, message);
                finding.hint("such an equation (a neutral delay equation) cannot be simulated; delay states instead")
            }
            Obstacle::Delays => {
                let message = "the delays of this equation stand for too many delayed signals";
                Diagnostic::new(Code::TooLarge, span, message).hint("delay states instead of derivatives")
            }
            Obstacle::TooLong => {
                let message = "the sums of derivatives in these equations are too long";
                Diagnostic::new(Code::TooLarge, span, message).hint("solve some of the equations by hand")
            }
        }
    }
}
