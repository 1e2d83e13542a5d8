//! Operands and signs in the order of the text to an array of expressions: the shunting-yard algorithm (Dijkstra
//! 1961), with its stacks on the heap, so that neither long chains nor nesting use the machine's stack.

use super::tree::{BinarySign, Expr, ExprRef, Name, SyntaxTree, UnarySign};
use crate::source::Span;

/// An `if` binds less strongly than any sign.
pub(super) const CHOICE: u8 = 0;
/// Names, numbers and calls.
pub(super) const OPERAND: u8 = 9;

/// How strongly an expression binds.
pub(super) fn strength(tree: &SyntaxTree, e: ExprRef) -> u8 {
    match tree.expr(e) {
        Expr::Unary(sign, _) => strength_of_sign(*sign),
        Expr::Binary(sign, ..) => strength_of(*sign),
        Expr::If(..) => CHOICE,
        // a negative number cannot be written, but can be made
        Expr::Number(value) if value.is_sign_negative() => strength_of_sign(UnarySign::Minus),
        _ => OPERAND,
    }
}

/// How strongly a sign binds; unary minus stands between `*` and `^`, so that `-x^2` is `-(x^2)`.
pub(super) fn strength_of(sign: BinarySign) -> u8 {
    use BinarySign::*;
    match sign {
        Or => 1,
        And => 2,
        Less | LessEqual | Greater | GreaterEqual | Equal | NotEqual => COMPARISON,
        Add | Subtract => 5,
        Multiply | Divide => 6,
        Power => 8,
    }
}

const COMPARISON: u8 = 4;

/// How strongly a sign before an operand binds.
pub(super) fn strength_of_sign(sign: UnarySign) -> u8 {
    if sign == UnarySign::Not { 3 } else { 7 }
}

/// A sign that waits for its right operand.
#[derive(Debug, Clone, Copy)]
enum Waiting {
    /// The beginning of the current expression; nothing before it is touched.
    Begin,
    Unary(UnarySign, Span),
    Binary(BinarySign, Span),
}

impl Waiting {
    fn strength(self) -> u8 {
        match self {
            Self::Begin => 0,
            Self::Unary(sign, _) => strength_of_sign(sign),
            Self::Binary(sign, _) => strength_of(sign),
        }
    }
}

/// A call, an `if` or a vector whose operands are being read.
#[derive(Debug)]
enum Frame {
    Call { function: Name, first_operand: usize },
    Choice { ifs: Vec<usize>, first_operand: usize },
    Vector { start: usize, first_operand: usize },
}

/// An expression and the text it covers, brackets included.
type Operand = (ExprRef, Span);

/// Builds expressions; operands stand in the array before the expressions that use them.
#[derive(Debug, Default)]
pub(super) struct Builder {
    /// The array of the tree.
    pub(super) expressions: Vec<(Expr, Span)>,
    /// Signs of comparisons of comparisons (`a < b < c`), which have no meaning.
    pub(super) chained: Vec<Span>,
    operands: Vec<Operand>,
    waiting: Vec<Waiting>,
    frames: Vec<Frame>,
}

impl Builder {
    /// Forgets half-read expressions and all expressions from `length` on.
    pub(super) fn cut(&mut self, length: usize) {
        self.expressions.truncate(length);
        self.operands.clear();
        self.waiting.clear();
        self.frames.clear();
        self.chained.clear();
    }

    /// An expression that was read.
    pub(super) fn expr(&self, e: ExprRef) -> &Expr {
        &self.expressions[e.0 as usize].0
    }

    /// Where it stands.
    pub(super) fn span(&self, e: ExprRef) -> Span {
        self.expressions[e.0 as usize].1
    }

    /// Takes the expression that was read last.
    pub(super) fn take(&mut self) -> Option<ExprRef> {
        self.operands.pop().map(|(e, _)| e)
    }

    /// An expression begins.
    pub(super) fn begin(&mut self) {
        self.waiting.push(Waiting::Begin);
    }

    /// An expression ends.
    pub(super) fn end(&mut self) {
        self.reduce(0);
        self.waiting.pop();
    }

    /// A number, a name or an element of a vector.
    pub(super) fn operand(&mut self, expr: Expr, span: Span) {
        self.push(expr, span);
    }

    /// A sign before an operand.
    pub(super) fn sign(&mut self, sign: UnarySign, span: Span) {
        self.waiting.push(Waiting::Unary(sign, span));
    }

    /// A sign between operands.
    pub(super) fn infix(&mut self, sign: BinarySign, span: Span) {
        let strength = strength_of(sign);
        // Powers associate to the right, everything else to the left.
        self.reduce(if sign == BinarySign::Power { strength } else { strength - 1 });
        if strength == COMPARISON && self.operands.last().is_some_and(|o| self.is_bare_comparison(*o)) {
            self.chained.push(span);
        }
        self.waiting.push(Waiting::Binary(sign, span));
    }

    /// A comparison without brackets around it.
    fn is_bare_comparison(&self, (expr, text): Operand) -> bool {
        let (expr, span) = &self.expressions[expr.0 as usize];
        *span == text && matches!(expr, Expr::Binary(sign, ..) if strength_of(*sign) == COMPARISON)
    }

    /// The brackets around the expression that was read last.
    pub(super) fn group(&mut self, span: Span) {
        if let Some(last) = self.operands.last_mut() {
            last.1 = span;
        }
    }

    /// The name read last is that of a function; its arguments follow.
    pub(super) fn begin_call(&mut self) {
        self.operands.pop();
        let (text, span) = match self.expressions.pop() {
            Some((Expr::Name(text), span)) => (text, span),
            _ => Default::default(),
        };
        self.frames.push(Frame::Call { function: Name { text, span }, first_operand: self.operands.len() });
    }

    /// An `if` begins.
    pub(super) fn begin_choice(&mut self) {
        self.frames.push(Frame::Choice { ifs: Vec::new(), first_operand: self.operands.len() });
    }

    /// The bracket of a vector, at a place.
    pub(super) fn begin_vector(&mut self, start: usize) {
        self.frames.push(Frame::Vector { start, first_operand: self.operands.len() });
    }

    /// The word `if`, first or behind `else`, at a place.
    pub(super) fn word_if(&mut self, start: usize) {
        if let Some(Frame::Choice { ifs, .. }) = self.frames.last_mut() {
            ifs.push(start);
        }
    }

    /// The call, the `if` or the vector that began last ends at `end`.
    pub(super) fn end_frame(&mut self, end: usize) {
        match self.frames.pop() {
            Some(Frame::Call { function, first_operand }) => {
                let arguments = self.operands.drain(first_operand..).map(|o| o.0).collect();
                let span = Span::new(function.span.start as usize, end);
                self.push(Expr::Call(function, arguments), span);
            }
            Some(Frame::Choice { ifs, first_operand }) => {
                let parts: Vec<_> = self.operands.drain(first_operand..).map(|o| o.0).collect();
                self.choice(&ifs, &parts, end);
            }
            Some(Frame::Vector { start, first_operand }) => {
                let elements = self.operands.drain(first_operand..).map(|o| o.0).collect();
                self.push(Expr::Vector(elements), Span::new(start, end));
            }
            None => {}
        }
    }

    /// `parts` are condition and value for each `if`, then the last value.
    fn choice(&mut self, ifs: &[usize], parts: &[ExprRef], end: usize) {
        let Some((last, pairs)) = parts.split_last() else { return };
        let mut otherwise = (*last, self.expressions[last.0 as usize].1);
        for (start, pair) in ifs.iter().zip(pairs.chunks_exact(2)).rev() {
            let span = Span::new(*start, end);
            self.expressions.push((Expr::If(pair[0], pair[1], otherwise.0), span));
            otherwise = (ExprRef(self.expressions.len() as u32 - 1), span);
        }
        self.operands.push(otherwise);
    }

    /// Applies all waiting signs of the current expression that bind more strongly than `strength`.
    fn reduce(&mut self, strength: u8) {
        while let Some(top) = self.waiting.last().copied().filter(|w| w.strength() > strength) {
            self.waiting.pop();
            let Some((right, right_text)) = self.operands.pop() else { return };
            match top {
                Waiting::Unary(sign, span) => self.push(Expr::Unary(sign, right), span.to(right_text)),
                Waiting::Binary(sign, sign_span) => {
                    let Some((left, left_text)) = self.operands.pop() else { return };
                    let span = left_text.to(right_text);
                    self.push(Expr::Binary(sign, left, right, sign_span), span);
                }
                Waiting::Begin => {}
            }
        }
    }

    fn push(&mut self, expr: Expr, span: Span) {
        self.expressions.push((expr, span));
        self.operands.push((ExprRef(self.expressions.len() as u32 - 1), span));
    }
}
