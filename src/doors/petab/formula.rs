//! Formulas of PEtab's tables: infix notation as in the PEtab specification (version 1).

use crate::expression::{DEEPEST, Expr, LONGEST, Sign, binary};

/// Reads a formula.
///
/// # Errors
/// One sentence that says what was expected and where.
pub(crate) fn formula(text: &str) -> Result<Expr, String> {
    let mut reader = Reader { text, at: 0, depth: 0, signs: 0 };
    let whole = reader.either()?;
    reader.skip();
    match reader.rest().chars().next() {
        None => Ok(whole),
        Some(c) => Err(format!("`{text}`: `{c}` is not expected at character {}", reader.character())),
    }
}

struct Reader<'a> {
    text: &'a str,
    at: usize,
    depth: usize,
    /// Signs so far: chains of them nest in the tree.
    signs: usize,
}

/// Comparisons, longer signs first.
const COMPARISONS: [(&str, Sign); 6] = [
    ("<=", Sign::AtMost),
    (">=", Sign::AtLeast),
    ("==", Sign::Equal),
    ("!=", Sign::Unequal),
    ("<", Sign::Less),
    (">", Sign::Greater),
];

impl<'a> Reader<'a> {
    fn rest(&self) -> &'a str {
        &self.text[self.at..]
    }

    fn character(&self) -> usize {
        self.text[..self.at].chars().count() + 1
    }

    fn skip(&mut self) {
        let rest = self.rest();
        self.at += rest.len() - rest.trim_start().len();
    }

    fn takes(&mut self, sign: &str) -> bool {
        self.skip();
        let found = self.rest().starts_with(sign);
        if found {
            self.at += sign.len();
            self.signs += 1;
        }
        found
    }

    fn wanted<T>(&self, what: &str) -> Result<T, String> {
        let found = match self.rest().chars().next() {
            Some(c) => format!("`{c}`"),
            None => "the end".into(),
        };
        Err(format!("`{}`: {what} is expected at character {}, {found} is there", self.text, self.character()))
    }

    fn either(&mut self) -> Result<Expr, String> {
        self.depth += 1;
        if self.depth > DEEPEST {
            return Err(format!("`{}` is nested deeper than {DEEPEST} levels", self.text));
        }
        let mut left = self.both()?;
        while self.takes("||") {
            left = binary(Sign::Or, left, self.both()?);
        }
        self.depth -= 1;
        Ok(left)
    }

    fn both(&mut self) -> Result<Expr, String> {
        let mut left = self.compared()?;
        while self.takes("&&") {
            left = binary(Sign::And, left, self.compared()?);
        }
        Ok(left)
    }

    fn compared(&mut self) -> Result<Expr, String> {
        let left = self.sum()?;
        for (text, sign) in COMPARISONS {
            if self.takes(text) {
                return Ok(binary(sign, left, self.sum()?));
            }
        }
        Ok(left)
    }

    fn sum(&mut self) -> Result<Expr, String> {
        let mut left = self.product()?;
        loop {
            if self.takes("+") {
                left = binary(Sign::Add, left, self.product()?);
            } else if self.takes("-") {
                left = binary(Sign::Subtract, left, self.product()?);
            } else {
                return Ok(left);
            }
        }
    }

    fn product(&mut self) -> Result<Expr, String> {
        let mut left = self.signed()?;
        loop {
            self.skip();
            if !self.rest().starts_with("**") && self.takes("*") {
                left = binary(Sign::Multiply, left, self.signed()?);
            } else if self.takes("/") {
                left = binary(Sign::Divide, left, self.signed()?);
            } else {
                return Ok(left);
            }
        }
    }

    fn signed(&mut self) -> Result<Expr, String> {
        // signs in a row do not nest
        let (mut minus, mut not) = (false, false);
        loop {
            self.skip();
            if self.takes("-") {
                minus = !minus;
            } else if !self.rest().starts_with("!=") && self.takes("!") {
                not = !not;
            } else if !self.takes("+") {
                break;
            }
        }
        let value = self.power()?;
        let value = if minus { Expr::Minus(Box::new(value)) } else { value };
        Ok(if not { Expr::Not(Box::new(value)) } else { value })
    }

    fn power(&mut self) -> Result<Expr, String> {
        let base = self.operand()?;
        if self.signs > LONGEST {
            return Err(format!("a formula of more than {LONGEST} signs is not read"));
        }
        if self.takes("**") || self.takes("^") {
            self.depth += 1;
            if self.depth > DEEPEST {
                return Err(format!("`{}` is nested deeper than {DEEPEST} levels", self.text));
            }
            let exponent = self.signed()?;
            self.depth -= 1;
            return Ok(binary(Sign::Power, base, exponent));
        }
        Ok(base)
    }

    fn operand(&mut self) -> Result<Expr, String> {
        if self.takes("(") {
            let inner = self.either()?;
            return if self.takes(")") { Ok(inner) } else { self.wanted("`)`") };
        }
        self.skip();
        let rest = self.rest();
        match rest.chars().next() {
            Some(c) if c.is_ascii_digit() || c == '.' => self.number(),
            Some(c) if c.is_alphabetic() || c == '_' => {
                let length = rest.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(rest.len());
                self.at += length;
                let word = &rest[..length];
                if self.takes("(") { self.call(word) } else { Ok(named(word)) }
            }
            _ => self.wanted("a number, a name or `(`"),
        }
    }

    fn number(&mut self) -> Result<Expr, String> {
        let bytes = self.rest().as_bytes();
        let digits = |from: usize| from + bytes[from..].iter().take_while(|b| b.is_ascii_digit()).count();
        let mut end = digits(0);
        if bytes.get(end) == Some(&b'.') {
            end = digits(end + 1);
        }
        if matches!(bytes.get(end), Some(b'e' | b'E')) {
            let signed = end + 1 + usize::from(matches!(bytes.get(end + 1), Some(b'+' | b'-')));
            let behind = digits(signed);
            end = if behind > signed { behind } else { end };
        }
        match self.rest()[..end].parse() {
            Ok(value) => {
                self.at += end;
                Ok(Expr::Number(value))
            }
            Err(_) => self.wanted("a number"),
        }
    }

    fn call(&mut self, function: &str) -> Result<Expr, String> {
        let mut list = Vec::new();
        if !self.takes(")") {
            loop {
                list.push(self.either()?);
                if self.takes(")") {
                    break;
                }
                if !self.takes(",") {
                    return self.wanted("`,` or `)`");
                }
            }
        }
        applied(function, list).map_err(|e| format!("`{}`: {e}", self.text))
    }
}

fn named(word: &str) -> Expr {
    match word {
        "time" => Expr::Time,
        "true" | "True" => Expr::True,
        "false" | "False" => Expr::False,
        "inf" => Expr::Number(f64::INFINITY),
        "pi" => Expr::Number(std::f64::consts::PI),
        name => Expr::Name(name.into()),
    }
}

/// A function of PEtab with its arguments.
fn applied(function: &str, mut list: Vec<Expr>) -> Result<Expr, String> {
    let given = list.len();
    let same =
        ["sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "exp", "log10", "sqrt", "abs", "sign"];
    if let Some(known) = same.iter().find(|f| **f == function) {
        return if given == 1 { Ok(Expr::Call(known, list)) } else { Err(count(function, 1, given)) };
    }
    let arc = [("arcsin", "asin"), ("arccos", "acos"), ("arctan", "atan"), ("ln", "log"), ("log", "log")];
    if let (Some((_, own)), 1) = (arc.iter().find(|(f, _)| *f == function), given) {
        return Ok(Expr::Call(own, list));
    }
    match (function, given) {
        ("log2", 1) => Ok(logarithm(list.remove(0), Expr::Number(2.0))),
        ("log", 2) => {
            let base = list.remove(1);
            Ok(logarithm(list.remove(0), base))
        }
        ("pow" | "power", 2) => {
            let exponent = list.remove(1);
            Ok(binary(Sign::Power, list.remove(0), exponent))
        }
        ("min" | "Min", 2..) => Ok(Expr::Call("min", list)),
        ("max" | "Max", 2..) => Ok(Expr::Call("max", list)),
        // PEtab and SBML: value, condition, value, condition, ..., otherwise
        ("piecewise" | "Piecewise", 3..) => Ok(piecewise(list)),
        _ => Err(format!("a function `{function}` of {given} arguments is not known")),
    }
}

/// A choice by its arguments in the order of MathML; without a last value it is 0.
pub(crate) fn piecewise(mut list: Vec<Expr>) -> Expr {
    let otherwise = if list.len() % 2 == 1 { list.pop() } else { None };
    let mut branches = Vec::new();
    let mut rest = list.into_iter();
    while let (Some(value), Some(condition)) = (rest.next(), rest.next()) {
        branches.push((value, condition));
    }
    let otherwise = otherwise.unwrap_or(Expr::Number(0.0));
    if branches.is_empty() { otherwise } else { Expr::If(branches, Box::new(otherwise)) }
}

/// A logarithm to any base.
pub(crate) fn logarithm(of: Expr, base: Expr) -> Expr {
    match base {
        Expr::Number(10.0) => Expr::Call("log10", vec![of]),
        base => binary(Sign::Divide, Expr::Call("log", vec![of]), Expr::Call("log", vec![base])),
    }
}

fn count(function: &str, wanted: usize, given: usize) -> String {
    format!("`{function}` takes {wanted} argument, {given} are given")
}

#[cfg(test)]
mod tests {
    use super::formula;

    #[test]
    fn mistakes_are_told_with_their_place() {
        let deep = "(".repeat(100_000);
        let cases = [
            ("a +", "a number, a name or `(` is expected at character 4, the end is there"),
            ("a b", "`b` is not expected at character 3"),
            ("f(a)", "a function `f` of 1 arguments is not known"),
            ("(a", "`)` is expected at character 3"),
            (".", "a number is expected at character 1"),
            ("exp(a, b)", "`exp` takes 1 argument, 2 are given"),
            (deep.as_str(), "nested deeper than"),
        ];
        for (text, said) in cases {
            let found = formula(text).err().unwrap_or_default();
            assert!(found.contains(said), "{text:.20}: {found:.200}");
        }
    }
}
