//! Models that fit the grammar: declarations with all their attributes, equations, knowledge, in any order, and now and
//! then a slip.

use crate::Expression;
use arbitrary::{Result, Unstructured};

const UNITS: [&str; 10] = ["", "", "", " [m]", " [1/s]", " [deg]", " [rad]", " [1]", " [m/s^2]", " [ft]"];

/// A model by its statements.
#[derive(Debug, Clone)]
pub struct Model {
    statements: Vec<String>,
}

impl Model {
    /// A model of two states, an input and two parameters, and what the bytes add.
    ///
    /// # Errors
    /// When the bytes end.
    pub fn arbitrary(u: &mut Unstructured<'_>) -> Result<Self> {
        let mut model = Self { statements: Vec::new() };
        let size = u.int_in_range(1..=24)?;
        for k in 1..=2 {
            let expression = model.right_side(u, size)?;
            model.say(format!("der(x{k}) = {expression};"));
            let start = *u.choose(&["", "", " = 1", " = free", " = a", " = a*b + 1"])?;
            let unit = *u.choose(&UNITS)?;
            model.say(format!("state x{k}{start}{unit};"));
        }
        let unit = *u.choose(&UNITS)?;
        model.say(format!("input u{unit};"));
        let bounds = *u.choose(&["", "", " in [0, 5]", " in [-inf, 9]", " fixed", " per run"])?;
        model.say(format!("param a = 1{bounds}, b = 0.5 in [0, 3];"));
        for k in 0..u.int_in_range(1..=3)? {
            let expression = model.right_side(u, size)?;
            model.say(format!("output y{k} = {expression};"));
        }
        for _ in 0..u.int_in_range(0..=4)? {
            let statement = model.further(u, size)?;
            model.say(statement);
        }
        let turn = u.choose_index(model.statements.len())?;
        model.statements.rotate_left(turn);
        Ok(model)
    }

    /// The text.
    pub fn text(&self) -> String {
        format!("model m {{\n{}\n}}\n", self.statements.join("\n"))
    }

    fn say(&mut self, statement: String) {
        self.statements.push(statement);
    }

    fn right_side(&self, u: &mut Unstructured<'_>, size: usize) -> Result<String> {
        let plain = Expression::arbitrary(u, size)?.text();
        Ok(match u.int_in_range(0..=11)? {
            0 => format!("delay({plain}, b)"),
            1 => format!("delay({plain}, 0.3) + x1"),
            2 => format!("measured(y0) + {plain}"),
            3 => format!("l1*{plain}"),
            4 => format!("lag({plain}, b)"),
            5 => format!("CL({plain})"),
            6 => format!("v[1] + {plain}"),
            7 => format!("der(u) + {plain}"),
            _ => plain,
        })
    }

    fn further(&self, u: &mut Unstructured<'_>, size: usize) -> Result<String> {
        let e = self.right_side(u, size)?;
        Ok(match u.int_in_range(0..=13)? {
            0 => format!("let l1 = {e};"),
            1 => format!("param c = {e};"),
            2 => "prior a ~ normal(1, 0.5), x1(0) ~ normal(0, 1);".into(),
            3 => "noise y0 = 0.1;".into(),
            4 => "trim { x1 = 0; u = a; }".into(),
            5 => "time [min];".into(),
            6 => "tie a = b;".into(),
            7 => format!("table CL(z) = {} {{ -1: 0, 0: a, 1: b, 2: {e} }};", u.choose(&["linear", "cubic", "pchip"])?),
            8 => "state v[3]; param A[3, 3] = [[a, 1, 0], [0, -1, 0], [0, 0, b]]; der(v) = A*v;".into(),
            9 => format!("let w[2] = [{e}, x1]; output z[2] = w*2;"),
            10 => "state p, q; a*der(p) + b*der(q) = x1; der(q) - 0.3*der(p) = x2;".into(),
            11 => format!("output f = tf({e}, [1, a], [1, 2, b]);"),
            12 => format!("const k = {e};"),
            _ => format!("output y9 = {e} [m];"),
        })
    }
}
