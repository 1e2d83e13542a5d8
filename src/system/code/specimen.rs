//! Models for tests: the ship of the workloads, and models that a deterministic generator makes up.

use fdm_grammar::graph::{Leaf, Signal};
use fdm_grammar::model::{Derived, Input, Model, Origin, Output, Param, Quantity, State};
use fdm_grammar::op::{Build, ExprId, Form, Op, ROWS};
use fdm_grammar::unit::Unit;

/// Marsaglia's xorshift with multiplication; the same numbers everywhere.
pub(super) struct Xorshift(pub(super) u64);

impl Xorshift {
    pub(super) fn bits(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_F491_4F6C_DD1D)
    }

    pub(super) fn below(&mut self, n: usize) -> usize {
        (self.bits() >> 33) as usize % n
    }

    /// Between -3 and 3, often a value where operations are special.
    pub(super) fn number(&mut self) -> f64 {
        match self.below(24) {
            0 => 0.0,
            1 => 1.0,
            2 => -1.0,
            3 => -0.0,
            4 => 1e300,
            5 => 1e-310,
            _ => self.ordinary(),
        }
    }

    /// Between -3 and 3.
    fn ordinary(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64 * 6.0 - 3.0
    }
}

pub(super) fn quantity(name: impl Into<String>) -> Quantity {
    Quantity { name: name.into(), doc: String::new(), unit: None }
}

pub(super) fn param(name: impl Into<String>, value: f64) -> Param {
    let (lower, upper) = (f64::NEG_INFINITY, f64::INFINITY);
    Param {
        quantity: quantity(name),
        origin: Origin::Declared,
        value,
        lower,
        upper,
        fixed: false,
        per_run: false,
        group: None,
        logarithmic: false,
        prior: None,
    }
}

/// A model without equations: `states` states that rest at zero.
pub(super) fn blank(states: usize, inputs: usize, params: &[f64]) -> Model {
    let mut model = Model {
        name: "specimen".into(),
        doc: String::new(),
        time: Unit::second(),
        inputs: (0..inputs).map(|k| Input::new(quantity(format!("u{k}")))).collect(),
        states: Vec::new(),
        params: params.iter().enumerate().map(|(k, value)| param(format!("p{k}"), *value)).collect(),
        derived: Vec::new(),
        ties: Vec::new(),
        outputs: Vec::new(),
        trim: Vec::new(),
        requirements: None,
        tables: Vec::new(),
        graph: Default::default(),
    };
    let zero = model.graph.number(0.0);
    model.states = (0..states)
        .map(|k| State {
            quantity: quantity(format!("x{k}")),
            rate: zero,
            initial: zero,
            noise: None,
            limits: None,
            resets: Vec::new(),
        })
        .collect();
    model
}

/// Workload W1: a ship with three states, the rudder and eleven parameters.
pub(super) fn ship() -> Model {
    let c = [-1.0e-2, -3.0, -1.5e-3, -1.0e-2, -0.35, 1.0e-3, -1.0e-2, -3.0e-4, -2.0e-2, -1.2e-4, -0.5];
    let mut model = blank(3, 1, &c);
    let g = &mut model.graph;
    let [u, v, r] = [0, 1, 2].map(|k| g.leaf(Leaf::State(k)));
    let d = g.leaf(Leaf::Input(0));
    let c: Vec<ExprId> = (0..11).map(|k| g.leaf(Leaf::Param(k))).collect();
    let product = |g: &mut fdm_grammar::graph::Graph, factors: &[ExprId]| {
        factors[1..].iter().fold(factors[0], |p, f| g.apply(Op::Mul, &[p, *f]))
    };
    let square = |g: &mut fdm_grammar::graph::Graph, x: ExprId| g.apply(Op::Mul, &[x, x]);
    let [uu, vv, rr, dd] = [u, v, r, d].map(|x| square(g, x));
    let [k, u0] = [-5e-4, 7.7].map(|x| g.number(x));
    let rest = square(g, u0);
    let over = g.apply(Op::Sub, &[uu, rest]);
    let [vs, rs] = [v, r].map(|x| {
        let size = g.apply(Op::Abs, &[x]);
        g.apply(Op::Mul, &[x, size])
    });
    let rows: [&[&[ExprId]]; 3] = [
        &[&[k, over], &[c[0], vv], &[c[1], rr], &[c[2], uu, dd]],
        &[&[c[3], u, v], &[c[4], u, r], &[c[5], uu, d], &[c[6], vs]],
        &[&[c[7], u, v], &[c[8], u, r], &[c[9], uu, d], &[c[10], rs]],
    ];
    let mut rates = Vec::new();
    for row in rows {
        let terms: Vec<ExprId> = row.iter().map(|factors| product(g, factors)).collect();
        rates.push(terms[1..].iter().fold(terms[0], |s, t| g.apply(Op::Add, &[s, *t])));
    }
    model.states.iter_mut().zip(rates).for_each(|(s, rate)| s.rate = rate);
    model.states[0].initial = u0;
    let outputs = [u, v, r].map(|x| Output::new(quantity("y"), x));
    model.outputs = outputs.into();
    model
}

/// A model made up from a seed: every operation, shared parts, nested choices, delays; on request values that are
/// infinite, denormal or at the edge of a domain.
pub(super) fn random(seed: u64, special: bool) -> Model {
    let mut random = Xorshift(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1);
    let (n, m, p) = (random.below(4), random.below(3), random.below(5));
    let number = if special { Xorshift::number } else { Xorshift::ordinary };
    let params: Vec<f64> = (0..p).map(|_| number(&mut random)).collect();
    let mut model = blank(n, m, &params);
    let g = &mut model.graph;
    let mut pool: Vec<ExprId> = (0..p as u32).map(|k| g.leaf(Leaf::Param(k))).collect();
    let constants: Vec<ExprId> = (0..3).map(|_| g.number(number(&mut random))).collect();
    pool.extend(constants);
    grow(g, &mut pool, 12, &mut random);
    let of_params = pool.clone();
    pool.push(g.leaf(Leaf::Time));
    pool.extend((0..n as u32).map(|k| g.leaf(Leaf::State(k))));
    pool.extend((0..m as u32).map(|k| g.leaf(Leaf::Input(k))));
    for k in 0..n.min(2) as u32 {
        let tau = of_params[random.below(of_params.len())];
        pool.push(g.delay(Signal::State(k), tau));
    }
    // some fit into registers, some do not
    let size = if seed % 16 == 5 { 600 } else { 60 };
    grow(g, &mut pool, size, &mut random);
    for state in &mut model.states {
        state.rate = pool[pool.len() - 1 - random.below(pool.len().min(20))];
        state.initial = of_params[random.below(of_params.len())];
    }
    for k in 0..random.below(4) {
        let expr = pool[pool.len() - 1 - random.below(pool.len().min(20))];
        model.outputs.push(Output::new(quantity(format!("y{k}")), expr));
    }
    if let Some(e) = of_params.last() {
        model.derived.push(Derived { quantity: quantity("d"), expr: *e, tied: false });
    }
    model
}

fn grow(g: &mut dyn Build, pool: &mut Vec<ExprId>, count: usize, random: &mut Xorshift) {
    for _ in 0..count {
        // foreign code has no graph that could be compared
        let count = ROWS.iter().filter(|row| row.form != Form::External).count();
        let row = &ROWS[random.below(count)];
        let mut args: Vec<ExprId> = (0..row.arity).map(|_| pool[random.below(pool.len())]).collect();
        if row.op == Op::Select {
            let relation = [Op::Less, Op::LessEqual, Op::Equal][random.below(3)];
            let sides = [0, 1].map(|_| pool[random.below(pool.len())]);
            args[0] = g.apply(relation, &sides);
        }
        pool.push(g.apply(row.op, &args));
    }
}
