//! MathML of SBML, read into expressions.

use crate::expression::{DEEPEST, Expr, LONGEST, Sign, binary};
use crate::formula::{logarithm, piecewise};
use roxmltree::Node;

/// Avogadro's number as SBML fixes it, that of CODATA 2006 (level 3 version 1, section 3.4.6).
const AVOGADRO: f64 = 6.022_141_79e23;

/// Reads the `math` element below an element, or what stands in it; `None` where there is none.
///
/// # Errors
/// One sentence about what the language has not.
pub(crate) fn math(parent: Node<'_, '_>) -> Result<Option<Expr>, String> {
    let Some(math) = parent.children().find(|n| n.tag_name().name() == "math") else { return Ok(None) };
    match elements(math).next() {
        Some(first) => Reader { read: 0 }.expression(first, 0).map(Some),
        None => Err("an empty `math` says nothing".into()),
    }
}

/// Parameters and body of the `lambda` of a function definition.
///
/// # Errors
/// As [`math`].
pub(crate) fn lambda(parent: Node<'_, '_>) -> Result<(Vec<String>, Expr), String> {
    let lambda = parent.descendants().find(|n| n.tag_name().name() == "lambda").ok_or("there is no `lambda` in it")?;
    let (mut arguments, mut body) = (Vec::new(), None);
    for part in elements(lambda) {
        if part.tag_name().name() == "bvar" {
            arguments.push(elements(part).next().map(text).unwrap_or_default());
        } else {
            body = Some(Reader { read: 0 }.expression(part, 0)?);
        }
    }
    Ok((arguments, body.ok_or("its `lambda` has no body")?))
}

fn elements<'a, 'b>(node: Node<'a, 'b>) -> impl Iterator<Item = Node<'a, 'b>> {
    node.children().filter(Node::is_element)
}

fn text(node: Node<'_, '_>) -> String {
    node.text().unwrap_or_default().trim().to_string()
}

struct Reader {
    read: usize,
}

impl Reader {
    fn expression(&mut self, node: Node<'_, '_>, depth: usize) -> Result<Expr, String> {
        self.read += 1;
        if depth > DEEPEST || self.read > LONGEST {
            return Err(format!("mathematics of more than {DEEPEST} levels or {LONGEST} parts are not read"));
        }
        match node.tag_name().name() {
            "cn" => number(node).map(Expr::Number),
            "ci" => Ok(Expr::Name(text(node))),
            "csymbol" => match node.attribute("definitionURL").unwrap_or_default().rsplit('/').next() {
                Some("time") => Ok(Expr::Time),
                Some("avogadro") => Ok(Expr::Number(AVOGADRO)),
                other => Err(format!("the symbol `{}` is not known", other.unwrap_or_default())),
            },
            "true" => Ok(Expr::True),
            "false" => Ok(Expr::False),
            "pi" => Ok(Expr::Number(std::f64::consts::PI)),
            "exponentiale" => Ok(Expr::Number(std::f64::consts::E)),
            "infinity" => Ok(Expr::Number(f64::INFINITY)),
            "piecewise" => {
                let mut list = Vec::new();
                for part in elements(node) {
                    for inner in elements(part) {
                        list.push(self.expression(inner, depth + 1)?);
                    }
                }
                Ok(piecewise(list))
            }
            "apply" => self.apply(node, depth),
            "semantics" | "math" => match elements(node).next() {
                Some(inner) => self.expression(inner, depth + 1),
                None => Err("an empty element says nothing".into()),
            },
            other => Err(format!("`{other}` of MathML is not known")),
        }
    }

    fn apply(&mut self, node: Node<'_, '_>, depth: usize) -> Result<Expr, String> {
        let mut parts = elements(node);
        let Some(operator) = parts.next() else { return Err("an empty `apply` says nothing".into()) };
        let (mut list, mut degree, mut base) = (Vec::new(), None, None);
        for part in parts {
            let qualifier = match part.tag_name().name() {
                "degree" => &mut degree,
                "logbase" => &mut base,
                _ => {
                    list.push(self.expression(part, depth + 1)?);
                    continue;
                }
            };
            let inner = elements(part).next().ok_or("an empty qualifier says nothing")?;
            *qualifier = Some(self.expression(inner, depth + 1)?);
        }
        let name = operator.tag_name().name();
        if name == "apply" && list.is_empty() {
            // brackets
            return self.expression(operator, depth + 1);
        }
        if name == "ci" {
            return Ok(Expr::Apply(text(operator), list));
        }
        if name == "csymbol" {
            let symbol = operator.attribute("definitionURL").unwrap_or_default().rsplit('/').next().unwrap_or_default();
            return match (symbol, list.len()) {
                ("delay", 2) => Ok(Expr::Call("delay", list)),
                ("rateOf", 1) => Ok(Expr::Call("der", list)),
                _ => Err(format!("the symbol `{symbol}` is not known")),
            };
        }
        let given = list.len();
        operation(name, list, degree, base)
            .ok_or_else(|| format!("`{name}` of {given} operands has no counterpart in the language"))
    }
}

fn chain(sign: Sign, list: Vec<Expr>) -> Option<Expr> {
    list.into_iter().reduce(|a, b| binary(sign, a, b))
}

/// `a < b < c` is `a < b and b < c`.
fn compared(sign: Sign, list: &[Expr]) -> Option<Expr> {
    chain(Sign::And, list.windows(2).map(|w| binary(sign, w[0].clone(), w[1].clone())).collect())
}

fn operation(name: &str, mut list: Vec<Expr>, degree: Option<Expr>, base: Option<Expr>) -> Option<Expr> {
    let one = || Expr::Number(1.0);
    let same = [
        ("sin", "sin"),
        ("cos", "cos"),
        ("tan", "tan"),
        ("arcsin", "asin"),
        ("arccos", "acos"),
        ("arctan", "atan"),
        ("sinh", "sinh"),
        ("cosh", "cosh"),
        ("tanh", "tanh"),
        ("exp", "exp"),
        ("ln", "log"),
        ("abs", "abs"),
    ];
    if let (Some((_, own)), 1) = (same.iter().find(|(n, _)| *n == name), list.len()) {
        return Some(Expr::Call(own, list));
    }
    let inverse =
        [("sec", "cos"), ("csc", "sin"), ("cot", "tan"), ("sech", "cosh"), ("csch", "sinh"), ("coth", "tanh")];
    if let (Some((_, own)), 1) = (inverse.iter().find(|(n, _)| *n == name), list.len()) {
        return Some(binary(Sign::Divide, one(), Expr::Call(own, list)));
    }
    let arc = [("arcsec", "acos"), ("arccsc", "asin"), ("arccot", "atan")];
    if let (Some((_, own)), 1) = (arc.iter().find(|(n, _)| *n == name), list.len()) {
        return Some(Expr::Call(own, vec![binary(Sign::Divide, one(), list.remove(0))]));
    }
    let area = [("arccsch", "arcsinh"), ("arcsech", "arccosh"), ("arccoth", "arctanh")];
    if let (Some((_, own)), 1) = (area.iter().find(|(n, _)| *n == name), list.len()) {
        return operation(own, vec![binary(Sign::Divide, one(), list.remove(0))], None, None);
    }
    match (name, list.len()) {
        ("arcsinh", 1) => Some(area_function(list.remove(0), Sign::Add)),
        ("arccosh", 1) => Some(area_function(list.remove(0), Sign::Subtract)),
        ("arctanh", 1) => {
            let x = list.remove(0);
            let part = |sign| binary(sign, Expr::Number(1.0), x.clone());
            let of = Expr::Call("log", vec![binary(Sign::Divide, part(Sign::Add), part(Sign::Subtract))]);
            Some(binary(Sign::Multiply, Expr::Number(0.5), of))
        }
        ("plus", 0) => Some(Expr::Number(0.0)),
        ("times", 0) => Some(one()),
        ("plus", _) => chain(Sign::Add, list),
        ("times", _) => chain(Sign::Multiply, list),
        ("minus", 1) => Some(Expr::Minus(Box::new(list.remove(0)))),
        ("minus", 2) => chain(Sign::Subtract, list),
        ("divide", 2) => chain(Sign::Divide, list),
        ("power", 2) => chain(Sign::Power, list),
        ("root", 1) => match degree {
            None | Some(Expr::Number(2.0)) => Some(Expr::Call("sqrt", list)),
            Some(degree) => Some(binary(Sign::Power, list.remove(0), binary(Sign::Divide, one(), degree))),
        },
        ("log", 1) => Some(logarithm(list.remove(0), base.unwrap_or(Expr::Number(10.0)))),
        ("min", 1) | ("max", 1) => list.pop(),
        ("min", 2..) => Some(Expr::Call("min", list)),
        ("max", 2..) => Some(Expr::Call("max", list)),
        ("and", 1..) => chain(Sign::And, list),
        ("or", 1..) => chain(Sign::Or, list),
        ("and", 0) => Some(Expr::True),
        ("or", 0) => Some(Expr::False),
        ("not", 1) => Some(Expr::Not(Box::new(list.remove(0)))),
        ("xor", 0) => Some(Expr::False),
        ("xor", _) => list.into_iter().reduce(|a, b| {
            let not = |e: &Expr| Expr::Not(Box::new(e.clone()));
            let (first, second) = (binary(Sign::And, a.clone(), not(&b)), binary(Sign::And, not(&a), b));
            binary(Sign::Or, first, second)
        }),
        ("implies", 2) => Some(binary(Sign::Or, Expr::Not(Box::new(list.remove(0))), list.remove(0))),
        ("lt", 2..) => compared(Sign::Less, &list),
        ("leq", 2..) => compared(Sign::AtMost, &list),
        ("gt", 2..) => compared(Sign::Greater, &list),
        ("geq", 2..) => compared(Sign::AtLeast, &list),
        ("eq", 2..) => compared(Sign::Equal, &list),
        ("neq", 2) => compared(Sign::Unequal, &list),
        _ => None,
    }
}

/// `log(x + sqrt(x^2 + 1))`, or with `- 1`.
fn area_function(x: Expr, sign: Sign) -> Expr {
    let square = binary(Sign::Power, x.clone(), Expr::Number(2.0));
    let root = Expr::Call("sqrt", vec![binary(sign, square, Expr::Number(1.0))]);
    Expr::Call("log", vec![binary(Sign::Add, x, root)])
}

/// A number: plain, with an exponent, or a ratio.
fn number(node: Node<'_, '_>) -> Result<f64, String> {
    let parts: Vec<&str> =
        node.children().filter_map(|n| n.is_text().then(|| n.text()).flatten()).map(str::trim).collect();
    let read = |text: &str| text.parse::<f64>().map_err(|_| format!("`{text}` is not a number"));
    match (node.attribute("type"), &parts[..]) {
        (Some("e-notation"), [mantissa, exponent]) => read(&format!("{mantissa}e{exponent}")),
        (Some("rational"), [above, below]) => Ok(read(above)? / read(below)?),
        (_, [plain]) => read(plain),
        _ => Err("a `cn` without a number".into()),
    }
}
