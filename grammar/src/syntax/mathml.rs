//! A tree as typeset mathematics: MathML, which browsers read. Names are set as their authors speak them: `omega_n` is a Greek letter with an
//! index, `M_q` and `d1` have indices, `der(x)` is a letter with a dot.

use super::expression::{CHOICE, OPERAND, strength, strength_of, strength_of_sign};
use super::tree::*;
use crate::source::Source;

/// Sets the expressions of one tree.
#[derive(Debug, Clone, Copy)]
pub struct Typesetter<'a> {
    tree: &'a SyntaxTree,
    source: &'a Source,
}

/// What is still to be written, last first.
enum Part {
    Text(&'static str),
    /// An expression that needs parentheses when it binds less strongly than this.
    Expr(ExprRef, u8),
}

/// Greek letters by their names; `omicron` is an o.
const GREEK: [(&str, &str); 36] = [
    ("alpha", "α"),
    ("beta", "β"),
    ("gamma", "γ"),
    ("delta", "δ"),
    ("epsilon", "ε"),
    ("eps", "ε"),
    ("zeta", "ζ"),
    ("eta", "η"),
    ("theta", "θ"),
    ("iota", "ι"),
    ("kappa", "κ"),
    ("lambda", "λ"),
    ("mu", "μ"),
    ("nu", "ν"),
    ("xi", "ξ"),
    ("pi", "π"),
    ("rho", "ρ"),
    ("sigma", "σ"),
    ("tau", "τ"),
    ("upsilon", "υ"),
    ("phi", "φ"),
    ("chi", "χ"),
    ("psi", "ψ"),
    ("omega", "ω"),
    ("Gamma", "Γ"),
    ("Delta", "Δ"),
    ("Theta", "Θ"),
    ("Lambda", "Λ"),
    ("Xi", "Ξ"),
    ("Pi", "Π"),
    ("Sigma", "Σ"),
    ("Phi", "Φ"),
    ("Psi", "Ψ"),
    ("Omega", "Ω"),
    ("lam", "λ"),
    ("om", "ω"),
];

impl<'a> Typesetter<'a> {
    /// Numbers are set as they stand in the source.
    pub fn new(tree: &'a SyntaxTree, source: &'a Source) -> Self {
        Self { tree, source }
    }

    /// `left = right` between `math` tags.
    pub fn equation(&self, left: ExprRef, right: ExprRef) -> String {
        display(&format!("{}<mo>=</mo>{}", self.expression(left), self.expression(right)))
    }

    /// `name = right` between `math` tags.
    pub fn definition(&self, name: &str, right: ExprRef) -> String {
        display(&format!("{}<mo>=</mo>{}", typeset_name(name), self.expression(right)))
    }

    /// One expression; does not recurse.
    pub fn expression(&self, e: ExprRef) -> String {
        let mut out = String::new();
        let mut parts = vec![Part::Expr(e, CHOICE)];
        while let Some(part) = parts.pop() {
            match part {
                Part::Text(text) => out.push_str(text),
                Part::Expr(e, least) => {
                    if self.strength(e) < least {
                        let (open, close) = self.parentheses(e);
                        out.push_str(open);
                        parts.push(Part::Text(close));
                    }
                    self.open(e, &mut out, &mut parts);
                }
            }
        }
        out
    }

    fn strength(&self, e: ExprRef) -> u8 {
        match self.tree.expr(e) {
            // a number with a power of ten is a product
            Expr::Number(value) if !value.is_sign_negative() && self.written(e).contains(['e', 'E']) => {
                strength_of(BinarySign::Multiply)
            }
            _ => strength(self.tree, e),
        }
    }

    /// Parentheses grow with a fraction between them, and with nothing else: browsers stretch them by the line's own height.
    fn parentheses(&self, e: ExprRef) -> (&'static str, &'static str) {
        match self.tree.expr(e) {
            Expr::Binary(BinarySign::Divide, ..) => ("<mrow><mo>(</mo>", "<mo>)</mo></mrow>"),
            _ => ("<mrow><mo stretchy=\"false\">(</mo>", "<mo stretchy=\"false\">)</mo></mrow>"),
        }
    }

    /// A number as it stands in the text, or in its shortest form.
    fn written(&self, e: ExprRef) -> String {
        let Expr::Number(value) = self.tree.expr(e) else { return String::new() };
        let written = self.source.slice(self.tree.span(e));
        if written.parse() == Ok(*value) { written.to_string() } else { value.to_string() }
    }

    /// Writes the beginning of an expression and leaves the rest to `parts`.
    fn open(&self, e: ExprRef, out: &mut String, parts: &mut Vec<Part>) {
        match self.tree.expr(e) {
            Expr::Number(_) => out.push_str(&number(&self.written(e))),
            Expr::Name(name) => out.push_str(&typeset_name(name)),
            Expr::Unary(sign, a) => {
                out.push_str(match sign {
                    UnarySign::Minus => "<mo>−</mo>",
                    UnarySign::Plus => "<mo>+</mo>",
                    UnarySign::Not => "<mo>¬</mo>",
                });
                parts.push(Part::Expr(*a, strength_of_sign(*sign)));
            }
            Expr::Binary(sign, a, b, _) => self.binary(*sign, *a, *b, out, parts),
            Expr::Call(name, arguments) => match (name.text.as_str(), arguments.first().map(|a| self.tree.expr(*a))) {
                // the dot stands above the letter, not above its indices
                ("der", Some(Expr::Name(state))) => {
                    let dotted =
                        |letter: String| format!("<mover accent=\"true\">{letter}<mo class=\"dot\">˙</mo></mover>");
                    out.push_str(&with_indices(state, dotted));
                }
                (name, _) => self.call(name, arguments, out, parts),
            },
            Expr::If(c, a, b) => {
                out.push_str("<mrow><mo>{</mo><mtable columnalign=\"left\"><mtr><mtd>");
                parts.extend([
                    Part::Text("</mtd><mtd><mtext>otherwise</mtext></mtd></mtr></mtable></mrow>"),
                    Part::Expr(*b, CHOICE),
                    Part::Text("</mtd></mtr><mtr><mtd>"),
                    Part::Expr(*c, CHOICE),
                    Part::Text("</mtd><mtd><mtext>if </mtext>"),
                    Part::Expr(*a, CHOICE),
                ]);
            }
            Expr::Vector(elements) => self.vector(elements, out, parts),
            Expr::Element(name, slices) => {
                let index: Vec<String> = slices.iter().map(index).collect();
                out.push_str(&format!(
                    "<msub>{}<mrow>{}</mrow></msub>",
                    typeset_name(&name.text),
                    index.join("<mo>,</mo>")
                ));
            }
        }
    }

    fn binary(&self, sign: BinarySign, a: ExprRef, b: ExprRef, out: &mut String, parts: &mut Vec<Part>) {
        let own = strength_of(sign);
        match sign {
            BinarySign::Divide => {
                out.push_str("<mfrac><mrow>");
                parts.extend([
                    Part::Text("</mrow></mfrac>"),
                    Part::Expr(b, CHOICE),
                    Part::Text("</mrow><mrow>"),
                    Part::Expr(a, CHOICE),
                ]);
            }
            BinarySign::Power => {
                out.push_str("<msup><mrow>");
                parts.extend([
                    Part::Text("</mrow></msup>"),
                    Part::Expr(b, CHOICE),
                    Part::Text("</mrow><mrow>"),
                    Part::Expr(a, OPERAND),
                ]);
            }
            BinarySign::Multiply => {
                // a number behind another factor would read as one with it
                let numeric = matches!(self.leftmost(b), Expr::Number(_));
                let sign = if numeric { "<mo>·</mo>" } else { "<mo>\u{2062}</mo><mspace width=\"0.15em\"></mspace>" };
                let right =
                    if matches!(self.tree.expr(b), Expr::Binary(BinarySign::Divide, ..)) { own } else { own + 1 };
                parts.extend([Part::Expr(b, right), Part::Text(sign), Part::Expr(a, own)]);
            }
            _ => {
                let [left, right] =
                    if own == strength_of(BinarySign::Less) { [own + 1, own + 1] } else { [own, own + 1] };
                parts.extend([Part::Expr(b, right), Part::Text(shown(sign)), Part::Expr(a, left)]);
            }
        }
    }

    /// What an expression begins with when it is set.
    fn leftmost(&self, mut e: ExprRef) -> &Expr {
        loop {
            match self.tree.expr(e) {
                Expr::Binary(BinarySign::Multiply | BinarySign::Power, a, ..) => e = *a,
                other => return other,
            }
        }
    }

    fn call(&self, name: &str, arguments: &[ExprRef], out: &mut String, parts: &mut Vec<Part>) {
        let (open, between, close) = match (name, arguments.len()) {
            ("der", 1) => ("<mover accent=\"true\"><mrow>", "", "</mrow><mo class=\"dot\">˙</mo></mover>"),
            ("sqrt", 1) => ("<msqrt>", "", "</msqrt>"),
            ("abs", 1) => ("<mrow><mo>|</mo>", "", "<mo>|</mo></mrow>"),
            ("exp", 1) => ("<msup><mi>e</mi><mrow>", "", "</mrow></msup>"),
            ("delay", 2) => (
                "<mrow>",
                "<mrow><mo stretchy=\"false\">(</mo><mi>t</mi><mo>−</mo>",
                "<mo stretchy=\"false\">)</mo></mrow></mrow>",
            ),
            _ => {
                out.push_str(&format!("<mrow>{}", typeset_name(name)));
                ("<mo stretchy=\"false\">(</mo>", "<mo>,</mo>", "<mo stretchy=\"false\">)</mo></mrow>")
            }
        };
        out.push_str(open);
        parts.push(Part::Text(close));
        let least = match name {
            // what is late, and by what, stand beside a parenthesis and a sign
            "delay" => [OPERAND, strength_of(BinarySign::Add) + 1],
            _ => [CHOICE, CHOICE],
        };
        for (k, e) in arguments.iter().enumerate().rev() {
            parts.push(Part::Expr(*e, least[k.min(1)]));
            if k > 0 {
                parts.push(Part::Text(between));
            }
        }
    }

    /// A column, or the rows of a matrix.
    fn vector(&self, elements: &[ExprRef], out: &mut String, parts: &mut Vec<Part>) {
        out.push_str("<mrow><mo>[</mo><mtable><mtr><mtd>");
        parts.push(Part::Text("</mtd></mtr></mtable><mo>]</mo></mrow>"));
        for (k, e) in elements.iter().enumerate().rev() {
            match self.tree.expr(*e) {
                Expr::Vector(row) => {
                    for (j, cell) in row.iter().enumerate().rev() {
                        parts.push(Part::Expr(*cell, CHOICE));
                        parts.extend((j > 0).then_some(Part::Text("</mtd><mtd>")));
                    }
                }
                _ => parts.push(Part::Expr(*e, CHOICE)),
            }
            parts.extend((k > 0).then_some(Part::Text("</mtd></mtr><mtr><mtd>")));
        }
    }
}

fn display(inside: &str) -> String {
    format!("<math xmlns=\"http://www.w3.org/1998/Math/MathML\" displaystyle=\"true\"><mrow>{inside}</mrow></math>")
}

/// A name: Greek letters, indices behind `_` and behind a first letter or a Greek name that digits follow; dots lead into submodels.
pub fn typeset_name(name: &str) -> String {
    with_indices(name, |letter| letter)
}

/// A name with its indices, and something done to what has them.
fn with_indices(name: &str, dressed: impl Fn(String) -> String) -> String {
    let mut parts = name.split(['_', '.']);
    let first = parts.next().unwrap_or_default();
    let letters = first.trim_end_matches(|c: char| c.is_ascii_digit());
    let (base, digits) = if letters.is_empty() { (first, "") } else { first.split_at(letters.len()) };
    let mut below: Vec<String> = Vec::new();
    if !digits.is_empty() {
        below.push(format!("<mn>{digits}</mn>"));
    }
    below.extend(parts.filter(|p| !p.is_empty()).map(|p| match p.chars().all(|c| c.is_ascii_digit()) {
        true => format!("<mn>{p}</mn>"),
        false => word(p),
    }));
    match below.is_empty() {
        true => dressed(word(base)),
        false => format!("<msub>{}<mrow>{}</mrow></msub>", dressed(word(base)), below.join("<mo>,</mo>")),
    }
}

fn word(text: &str) -> String {
    let greek = GREEK.iter().find(|(name, _)| *name == text).map(|(_, letter)| *letter);
    let escaped = text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
    format!("<mi>{}</mi>", greek.unwrap_or(&escaped))
}

/// `1e-3` is a power of ten.
fn number(text: &str) -> String {
    let plain = |t: &str| match t.strip_prefix('-') {
        Some(rest) => format!("<mo>−</mo><mn>{rest}</mn>"),
        None => format!("<mn>{}</mn>", t.trim_start_matches('+')),
    };
    match text.split_once(['e', 'E']) {
        None => plain(text),
        Some((mantissa, exponent)) => format!(
            "<mrow>{}<mo>·</mo><msup><mn>10</mn><mrow>{}</mrow></msup></mrow>",
            plain(mantissa),
            plain(exponent)
        ),
    }
}

fn index(slice: &Slice) -> String {
    match slice {
        Slice::At(k) => format!("<mn>{k}</mn>"),
        Slice::Range(a, b) => format!("<mn>{a}</mn><mo>:</mo><mn>{b}</mn>"),
        Slice::All => "<mo>:</mo>".into(),
    }
}

fn shown(sign: BinarySign) -> &'static str {
    use BinarySign::*;
    match sign {
        Add => "<mo>+</mo>",
        Subtract => "<mo>−</mo>",
        Less => "<mo>&lt;</mo>",
        LessEqual => "<mo>≤</mo>",
        Greater => "<mo>&gt;</mo>",
        GreaterEqual => "<mo>≥</mo>",
        Equal => "<mo>=</mo>",
        NotEqual => "<mo>≠</mo>",
        And => "<mo>∧</mo>",
        Or => "<mo>∨</mo>",
        Multiply | Divide | Power => "",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::syntax::parse;

    /// Without the tags that only hold things together.
    fn set(text: &str) -> String {
        let source =
            Source::new("a.fdm", format!("model a {{ state x, y; der(x) = {text}; der(y) = 0; output o = x; }}"));
        let tree = parse(&source).expect("reads");
        let right = tree.statements.iter().find_map(|s| match s.kind {
            StatementKind::Equation(_, right) => Some(right),
            _ => None,
        });
        let set = Typesetter::new(&tree, &source).expression(right.expect("an equation"));
        [
            "<mrow>",
            "</mrow>",
            "<mspace width=\"0.15em\"></mspace>",
            "<mi>",
            "</mi>",
            "<mn>",
            "</mn>",
            "<mo>",
            "</mo>",
            "<mo stretchy=\"false\">",
        ]
        .iter()
        .fold(set, |text, tag| text.replace(tag, ""))
        .replace('\u{2062}', "*")
    }

    #[test]
    fn fractions_powers_and_roots_need_no_parentheses_but_their_bases_do() {
        assert_eq!(set("(x + 1)/(2*y)"), "<mfrac>x+12*y</mfrac>");
        assert_eq!(set("(x + 1)^(y - 2)"), "<msup>(x+1)y−2</msup>");
        assert_eq!(set("(x/y)^2"), "<msup>(<mfrac>xy</mfrac>)2</msup>");
        assert_eq!(set("sqrt(x + y)*abs(x)"), "<msqrt>x+y</msqrt>*|x|");
        assert_eq!(set("x - (y - 1)*2"), "x−(y−1)·2");
        // the sign binds before the fraction, as in the text
        assert_eq!(set("exp(-x/y)"), "<msup>e<mfrac>−xy</mfrac></msup>");
        assert_eq!(set("x*1e-3"), "x·(1·<msup>10−3</msup>)");
    }

    #[test]
    fn names_are_letters_with_indices() {
        let plain = |name| typeset_name(name).replace("<mrow>", "").replace("</mrow>", "");
        assert_eq!(plain("omega_n"), "<msub><mi>ω</mi><mi>n</mi></msub>");
        assert_eq!(plain("M_alpha"), "<msub><mi>M</mi><mi>α</mi></msub>");
        assert_eq!(plain("d1"), "<msub><mi>d</mi><mn>1</mn></msub>");
        assert_eq!(plain("act.y_2"), "<msub><mi>act</mi><mi>y</mi><mo>,</mo><mn>2</mn></msub>");
        assert_eq!(plain("Lp"), "<mi>Lp</mi>");
        assert_eq!(plain("_"), "<mi></mi>");
    }

    #[test]
    fn delays_choices_and_comparisons_are_set() {
        assert_eq!(set("delay(x + y, 0.1)"), "(x+y)(t−0.1)");
        assert_eq!(set("delay(x, 0.1 + y)"), "x(t−(0.1+y))");
        assert!(set("if x < 1 then x else y").contains("<mtext>if </mtext>x&lt;1"));
    }

    #[test]
    fn a_dot_stands_above_the_letter() {
        let source = Source::new("a.fdm", "model a { state x_1 = 0; der(x_1) = 1; output o = x_1; }");
        let tree = parse(&source).expect("reads");
        let StatementKind::Equation(left, right) = tree.statements[1].kind else { panic!("an equation") };
        let set = Typesetter::new(&tree, &source).equation(left, right);
        let dotted =
            "<msub><mover accent=\"true\"><mi>x</mi><mo class=\"dot\">˙</mo></mover><mrow><mn>1</mn></mrow></msub>";
        assert!(set.contains(dotted) && set.starts_with("<math "), "{set}");
    }

    #[test]
    fn a_long_sum_costs_no_stack() {
        let text = vec!["x"; 50_000].join(" + ");
        assert_eq!(set(&text).matches('+').count(), 49_999);
    }
}
