//! Functions that foreign code computes: what a model knows of them, and where they are found.
//!
//! **In** [`External`]s, made known by whoever read the file that holds them. **Out** [`Function`]s by name and by number, and the lists of
//! arguments that calls of them have in a graph. **Never** loads anything: a model that calls such functions is compiled from what its
//! file says of them, and foreign code runs only where numbers are asked for. **Start** at [`register`].
//!
//! A call has as many arguments as the foreign code wants, and operations of a graph have three at most. So arguments are a chain:
//! `list(list(0, x), u)` is the list (x, u), and zeros in front of a list may be left out. The tangent of such a list is the list of
//! tangents, which is the direction of a derivative. Programs have no lists: there a call holds its arguments.

use crate::op::Op;
use std::sync::{Arc, PoisonError, RwLock};

/// Foreign code with several functions of the same arguments.
///
/// Equal arguments must give equal bits, whatever was asked before and on whichever thread. What cannot be computed is NaN, and
/// [`Self::complaint`] then says why.
pub trait External: Send + Sync {
    /// What messages call a function.
    fn name(&self, function: u32) -> String;

    /// How many functions there are.
    fn functions(&self) -> u32;

    /// How many arguments each of them has.
    fn arguments(&self) -> usize;

    /// Whether a function depends on an argument; only what is sure to be no dependence may be `false`.
    fn depends(&self, function: u32, argument: usize) -> bool;

    /// The value of a function.
    fn value(&self, function: u32, arguments: &[f64]) -> f64;

    /// The derivative of a function along a direction.
    fn slope(&self, function: u32, arguments: &[f64], direction: &[f64]) -> f64;

    /// The second derivative of a function along two directions.
    fn curvature(&self, function: u32, arguments: &[f64], directions: [&[f64]; 2]) -> f64;

    /// The derivative of a function by one argument from its values alone: what derivatives are checked with.
    fn difference(&self, function: u32, arguments: &[f64], argument: usize) -> f64;

    /// Loads what has to be loaded, and tries it.
    ///
    /// # Errors
    /// Why nothing can be computed.
    fn ready(&self) -> Result<(), String>;

    /// Why the last value that could not be computed could not.
    fn complaint(&self) -> Option<String>;
}

/// Most functions of one piece of foreign code; numbers of functions are multiples of it and the function's own number.
pub const MOST_FUNCTIONS: u32 = 1 << 16;

/// How names of functions begin: `fmu_KEY_3` is function 3 of what was registered as `KEY`.
pub const PREFIX: &str = "fmu_";

/// Everything that was made known to this process, in the order in which it was. Numbers of functions stand in graphs, so nothing
/// leaves.
static KNOWN: RwLock<Vec<(String, Arc<dyn External>)>> = RwLock::new(Vec::new());

/// Makes foreign code known under a key of ASCII letters and digits; what is known already stays, and is returned.
pub fn register(key: &str, make: impl FnOnce() -> Arc<dyn External>) -> Arc<dyn External> {
    let mut known = KNOWN.write().unwrap_or_else(PoisonError::into_inner);
    if let Some((_, external)) = known.iter().find(|(k, _)| k == key) {
        return external.clone();
    }
    let external = make();
    known.push((key.into(), external.clone()));
    external
}

/// Whether there is something under a key.
pub fn is_registered(key: &str) -> bool {
    KNOWN.read().unwrap_or_else(PoisonError::into_inner).iter().any(|(k, _)| k == key)
}

/// What foreign code of this process had to say of values that could not be computed.
pub fn complaints() -> Vec<String> {
    let known: Vec<Arc<dyn External>> =
        KNOWN.read().unwrap_or_else(PoisonError::into_inner).iter().map(|(_, code)| code.clone()).collect();
    known.iter().filter_map(|code| code.complaint()).collect()
}

/// A function of foreign code.
#[derive(Clone)]
pub struct Function {
    /// The code.
    pub code: Arc<dyn External>,
    /// Its number there.
    pub function: u32,
}

impl std::fmt::Debug for Function {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.code.name(self.function))
    }
}

impl Function {
    /// The function with this number.
    pub fn numbered(number: f64) -> Option<Self> {
        let number = if number >= 0.0 && number.fract() == 0.0 { number as u64 } else { return None };
        let known = KNOWN.read().unwrap_or_else(PoisonError::into_inner);
        let (_, code) = known.get((number / u64::from(MOST_FUNCTIONS)) as usize)?;
        let function = (number % u64::from(MOST_FUNCTIONS)) as u32;
        (function < code.functions()).then(|| Self { code: code.clone(), function })
    }

    /// The value, or the derivative that an operation stands for: its arguments, then the directions, each as long as the arguments.
    pub fn compute(&self, op: Op, operands: &[f64]) -> f64 {
        let n = self.code.arguments();
        match op {
            Op::External => self.code.value(self.function, operands),
            Op::ExternalSlope => self.code.slope(self.function, &operands[..n], &operands[n..]),
            _ => self.code.curvature(self.function, &operands[..n], [&operands[n..2 * n], &operands[2 * n..]]),
        }
    }
}

/// The number of the function with this name.
pub(crate) fn find(name: &str) -> Option<u32> {
    let (key, function) = name.strip_prefix(PREFIX)?.rsplit_once('_')?;
    let known = KNOWN.read().unwrap_or_else(PoisonError::into_inner);
    let place = known.iter().position(|(k, _)| k == key)?;
    let function = function.parse().ok().filter(|f| *f < known[place].1.functions().min(MOST_FUNCTIONS))?;
    (place as u32).checked_mul(MOST_FUNCTIONS)?.checked_add(function)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::derive::differentiate;
    use crate::graph::Leaf;
    use crate::op::ExprId;
    use crate::schedule::Operand;
    use crate::{Schedule, Source, compile};

    /// Function 0 is x y + p, function 1 is sin(y) t; arguments are (t, x, y, p).
    struct Product;

    impl External for Product {
        fn name(&self, function: u32) -> String {
            format!("product {function}")
        }
        fn functions(&self) -> u32 {
            2
        }
        fn arguments(&self) -> usize {
            4
        }
        fn depends(&self, function: u32, argument: usize) -> bool {
            [[false, true, true, true], [true, false, true, false]][function as usize][argument]
        }
        fn value(&self, function: u32, a: &[f64]) -> f64 {
            if function == 0 { a[1] * a[2] + a[3] } else { a[2].sin() * a[0] }
        }
        fn slope(&self, function: u32, a: &[f64], d: &[f64]) -> f64 {
            if function == 0 { d[1] * a[2] + a[1] * d[2] + d[3] } else { a[2].cos() * d[2] * a[0] + a[2].sin() * d[0] }
        }
        fn curvature(&self, function: u32, a: &[f64], [c, d]: [&[f64]; 2]) -> f64 {
            if function == 0 {
                d[1] * c[2] + c[1] * d[2]
            } else {
                -a[2].sin() * d[2] * c[2] * a[0] + a[2].cos() * (d[2] * c[0] + c[2] * d[0])
            }
        }
        fn difference(&self, _: u32, _: &[f64], _: usize) -> f64 {
            f64::NAN
        }
        fn ready(&self) -> Result<(), String> {
            Ok(())
        }
        fn complaint(&self) -> Option<String> {
            None
        }
    }

    fn model(text: &str) -> crate::Model {
        register("product", || Arc::new(Product));
        compile(&Source::new("m.fdm", text)).unwrap_or_else(|e| panic!("{e:?}")).model
    }

    const TEXT: &str = "model m { input u; state x = p^2, y = 1; param p = 0.7; \
        der(x) = 2*fmu_product_0(t, x, sin(y), p) - x; der(y) = u*fmu_product_1(t, x, y*p, p); output z = x + fmu_product_0(0, p, y, 3)^2; }";

    /// First derivatives of everything beside central differences, second ones along a state and a parameter.
    #[test]
    fn derivatives_of_calls_are_those_of_differences() {
        let mut m = model(TEXT);
        let d = differentiate(&mut m);
        assert_eq!(
            (d.rates.state.entries.len(), d.rates.param.entries.len(), d.outputs.state.entries.len()),
            (3, 2, 2)
        );
        let values = [0.3, 0.4, -0.2, 0.9, 0.7];
        let at = |values: [f64; 5]| {
            move |leaf| match leaf {
                Leaf::Time => values[0],
                Leaf::State(k) => values[1 + k as usize],
                Leaf::Input(_) => values[3],
                _ => values[4],
            }
        };
        let place = |leaf| match leaf {
            Leaf::Time => 0,
            Leaf::State(k) => 1 + k as usize,
            Leaf::Input(_) => 3,
            _ => 4,
        };
        let all = |m: &crate::Model| [m.states[0].rate, m.states[1].rate, m.outputs[0].expr];
        let first: Vec<ExprId> = all(&m).into_iter().collect();
        let mut roots = first.clone();
        for _ in 0..2 {
            let tangents = crate::derive::tangents(&mut m.graph, &roots, |_| true);
            let mut next = Vec::new();
            for (leaf, column) in tangents {
                for (root, tangent) in column {
                    let h = 1e-5;
                    let moved = |by: f64| {
                        let mut v = values;
                        v[place(leaf)] += by;
                        m.graph.evaluate(roots[root as usize], at(v))
                    };
                    let (difference, symbolic) =
                        ((moved(h) - moved(-h)) / (2.0 * h), m.graph.evaluate(tangent, at(values)));
                    assert!((difference - symbolic).abs() < 1e-8, "{leaf:?} {root}: {symbolic} {difference}");
                    next.push(tangent);
                }
            }
            assert!(next.len() > 6, "{}", next.len());
            roots = next;
        }
    }

    #[test]
    fn calls_of_programs_hold_their_arguments_and_parameters_are_prepared() {
        let mut m = model(TEXT);
        let schedule = Schedule::new(&mut m);
        let program = &schedule.rates;
        assert_eq!(program.calls.len(), 2);
        assert!(program.calls.iter().all(|c| c.operands.len() == 4));
        assert!(program.instructions.iter().all(|i| i.op != Op::List));
        assert!(program.calls[0].operands.contains(&Operand::State(0)));
        let prepared = schedule.prepare.instructions.iter().all(|i| !i.op.is_external() && i.op != Op::List);
        assert!(prepared, "{:?}", schedule.prepare);
    }

    #[test]
    fn a_function_of_nobody_is_none() {
        assert!(find("fmu_product_9").is_none() && find("fmu_none_0").is_none() && find("sin").is_none());
        assert!(Function::numbered(1e9).is_none() && Function::numbered(-1.0).is_none());
    }
}
