//! The functions that users can call: those of the operation table and those that stand for several operations.

use crate::diagnostic::{Code, Diagnostic};
use crate::external;
use crate::op::{Form, Op, ROWS};
use crate::source::Span;
use crate::syntax::Name;

/// A function.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Function {
    /// A row of the operation table.
    Op(Op),
    /// `clip(x, lower, upper)`
    Clip,
    /// `deadzone(x, width)`
    Deadzone,
    /// `deg2rad(x)`
    DegToRad,
    /// `rad2deg(x)`
    RadToDeg,
    /// `delay(x, tau)`
    Delay,
    /// `der(x)`, the left side of an equation
    Der,
    /// `measured(y)`
    Measured,
    /// `initial(x)`: the value when a run begins
    Initial,
    /// A function of foreign code, by its number: only texts that are made for a unit call it.
    External(u32),
}

/// The functions that are no row of the operation table.
const COMPOSED: &[(&str, Function)] = &[
    ("clip", Function::Clip),
    ("deadzone", Function::Deadzone),
    ("deg2rad", Function::DegToRad),
    ("rad2deg", Function::RadToDeg),
    ("delay", Function::Delay),
    ("der", Function::Der),
    ("measured", Function::Measured),
    ("initial", Function::Initial),
];

/// Blocks, which have become states before: names for hints.
pub(super) const BLOCKS: &[&str] = &["lag", "leadlag", "washout", "second_order", "tf"];

/// What other languages call functions, and how this one writes them.
const FOREIGN: &[(&str, &str)] = &[
    ("ln", "log(x)"),
    ("pow", "x^y"),
    ("power", "x^y"),
    ("square", "x^2"),
    ("sqr", "x^2"),
    ("arcsin", "asin(x)"),
    ("arccos", "acos(x)"),
    ("arctan", "atan(x)"),
    ("arctan2", "atan2(y, x)"),
    ("sgn", "sign(x)"),
    ("fabs", "abs(x)"),
    ("sat", "clip(x, lower, upper)"),
    ("saturation", "clip(x, lower, upper)"),
    ("saturate", "clip(x, lower, upper)"),
    ("limit", "clip(x, lower, upper)"),
    ("clamp", "clip(x, lower, upper)"),
    ("radians", "deg2rad(x)"),
    ("degrees", "rad2deg(x)"),
    ("first_order", "lag(x, T)"),
    ("lowpass", "lag(x, T)"),
    ("highpass", "washout(x, T)"),
    ("transfer", "tf(x, [b1, b0], [1, a1, a0])"),
    ("transferfunction", "tf(x, [b1, b0], [1, a1, a0])"),
    ("heaviside", "if x > 0 then 1 else 0"),
    ("step", "if t > t0 then 1 else 0"),
    ("diff", "der(x) = ..."),
    ("ddt", "der(x) = ..."),
];

impl Function {
    /// The function with this name.
    pub(super) fn find(name: &str) -> Option<Self> {
        let composed = COMPOSED.iter().find(|(n, _)| *n == name).map(|(_, f)| *f);
        composed
            .or_else(|| Op::function(name).map(Function::Op))
            .or_else(|| external::find(name).map(Function::External))
    }

    /// Least number of arguments, and whether more are allowed.
    pub(super) fn arity(self) -> (usize, bool) {
        match self {
            Self::Op(op @ (Op::Min | Op::Max)) => (op.row().arity, true),
            Self::Op(op) => (op.row().arity, false),
            Self::Clip => (3, false),
            Self::Deadzone | Self::Delay => (2, false),
            Self::DegToRad | Self::RadToDeg | Self::Der | Self::Measured | Self::Initial => (1, false),
            Self::External(number) => {
                (external::Function::numbered(f64::from(number)).map_or(0, |f| f.code.arguments()), false)
            }
        }
    }

    /// How a call is written.
    pub(super) fn form(self, name: &str) -> String {
        let arguments = match self {
            Self::Op(Op::Atan2) => "y, x",
            Self::Op(Op::Min | Op::Max) => "a, b, ...",
            Self::Op(Op::Hypot) => "x, y",
            Self::Clip => "x, lower, upper",
            Self::Deadzone => "x, width",
            Self::Delay => "x, tau",
            Self::Measured => "y",
            Self::External(_) => "...",
            _ => "x",
        };
        format!("{name}({arguments})")
    }

    /// Every name, for hints.
    pub(super) fn names() -> impl Iterator<Item = &'static str> {
        let rows = ROWS.iter().filter(|r| r.form == Form::Function).map(|r| r.name);
        rows.chain(COMPOSED.iter().map(|(n, _)| *n))
    }
}

/// Every function that users can call, and how the call is written: `("atan2", "atan2(y, x)")`.
pub fn function_forms() -> impl Iterator<Item = (&'static str, String)> {
    Function::names().filter_map(|name| Some((name, Function::find(name)?.form(name))))
}

/// Least number of arguments of a function, whether more are allowed, and how a call is written.
pub fn function_form(name: &str) -> Option<(usize, bool, String)> {
    let Some(function) = Function::find(name) else {
        let arguments = match name {
            "lag" | "washout" => "x, T",
            "leadlag" => "x, T1, T2",
            "second_order" => "x, omega, zeta",
            "arrhenius" => "k_ref, E, T, T_ref",
            "reaction" => "A",
            _ => return None,
        };
        return Some((arguments.split(',').count(), false, format!("{name}({arguments})")));
    };
    let (least, more) = function.arity();
    Some((least, more, function.form(name)))
}

/// The names of all functions.
pub fn function_names() -> impl Iterator<Item = &'static str> {
    Function::names().chain(BLOCKS.iter().copied())
}

/// How this language writes what others call `name`.
pub(super) fn translation(name: &str) -> Option<&'static str> {
    let lower = name.to_lowercase();
    FOREIGN.iter().find(|(n, _)| *n == lower).map(|(_, own)| *own)
}

/// The complaint about a wrong number of arguments.
pub(super) fn argument_count(function: Function, name: &Name, given: usize, span: Span) -> Diagnostic {
    let (least, more) = function.arity();
    let wanted = match (least, more) {
        (1, false) => "1 argument".to_string(),
        (n, false) => format!("{n} arguments"),
        (n, true) => format!("{n} or more arguments"),
    };
    let message = format!("`{}` takes {wanted}, {given} given", name.text);
    Diagnostic::new(Code::ArgumentCount, span, message).hint(format!("`{}`", function.form(&name.text)))
}
