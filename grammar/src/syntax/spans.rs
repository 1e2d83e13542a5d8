//! Every place that a tree holds.
//!
//! The text of a value with all brackets around it: the place of an expression leaves out those around the whole.

use super::scan::{Kind, scan};
use super::tree::*;
use crate::source::Span;

impl SyntaxTree {
    /// Visits every place.
    pub(super) fn each_span(&mut self, mut visit: impl FnMut(&mut Span)) {
        let visit = &mut visit;
        visit(&mut self.name.span);
        optional(&mut self.doc, visit);
        for statement in &mut self.statements {
            visit(&mut statement.span);
            of_statement(&mut statement.kind, visit);
        }
        for (expr, span) in &mut self.expressions {
            visit(span);
            match expr {
                Expr::Binary(.., sign) => visit(sign),
                Expr::Call(name, _) | Expr::Element(name, _) => visit(&mut name.span),
                Expr::Number(_) | Expr::Name(_) | Expr::Unary(..) | Expr::If(..) | Expr::Vector(_) => {}
            }
        }
    }
}

fn of_statement(kind: &mut StatementKind, visit: &mut impl FnMut(&mut Span)) {
    match kind {
        StatementKind::Declare(_, list) | StatementKind::Requirement(list) => {
            list.iter_mut().for_each(|d| of_declaration(d, visit))
        }
        StatementKind::Time(unit) => visit(&mut unit.span),
        StatementKind::Noise(list)
        | StatementKind::Process(list)
        | StatementKind::Trim(list)
        | StatementKind::Tie(list) => {
            list.iter_mut().for_each(|(name, _)| visit(&mut name.span));
        }
        StatementKind::Table(table) => {
            [&mut table.name, &mut table.method].into_iter().for_each(|n| visit(&mut n.span));
            for argument in &mut table.arguments {
                visit(&mut argument.name.span);
                optional(&mut argument.unit, visit);
            }
            match &mut table.nodes {
                Nodes::File(path, free) => {
                    visit(&mut path.span);
                    free.iter_mut().for_each(&mut *visit);
                }
                Nodes::Written(axes) => {
                    for axis in axes {
                        visit(&mut axis.name.span);
                        axis.free.iter_mut().for_each(&mut *visit);
                    }
                }
                Nodes::Points(_) | Nodes::Grid(..) => {}
            }
            table.bounds.iter_mut().for_each(|b| visit(&mut b.span));
            optional(&mut table.doc, visit);
            optional(&mut table.unit, visit);
        }
        StatementKind::Smooth(smooth) => {
            visit(&mut smooth.table.span);
            visit(&mut smooth.order_span);
        }
        StatementKind::Limit(list) => {
            for limited in list {
                visit(&mut limited.state.span);
                visit(&mut limited.bounds.span);
            }
        }
        StatementKind::When(event) => event.resets.iter_mut().for_each(|(name, _)| visit(&mut name.span)),
        StatementKind::Use(submodel) => {
            visit(&mut submodel.path.span);
            visit(&mut submodel.alias.span);
            submodel.connections.iter_mut().for_each(|(name, _)| visit(&mut name.span));
        }
        StatementKind::Reactions(_, list) => {
            for reaction in list {
                visit(&mut reaction.span);
                for species in reaction.left.iter_mut().chain(&mut reaction.right) {
                    visit(&mut species.name.span);
                    optional(&mut species.factor, visit);
                }
            }
        }
        StatementKind::Equation(..) | StatementKind::Prior(_) => {}
    }
}

fn of_declaration(d: &mut Declaration, visit: &mut impl FnMut(&mut Span)) {
    visit(&mut d.name.span);
    visit(&mut d.span);
    optional(&mut d.doc, visit);
    optional(&mut d.unit, visit);
    if let Some(Value::Free(span)) = &mut d.value {
        visit(span);
    }
    let rest = [d.shape.as_mut().map(|s| &mut s.span), d.bounds.as_mut().map(|b| &mut b.span)];
    optional(&mut d.group, visit);
    if let Some(wrap) = &mut d.wrap {
        visit(&mut wrap.span);
    }
    rest.into_iter()
        .chain([d.fixed.as_mut(), d.per_run.as_mut(), d.log.as_mut(), d.hold.as_mut().map(|h| &mut h.span)])
        .flatten()
        .for_each(visit);
}

fn optional(name: &mut Option<Name>, visit: &mut impl FnMut(&mut Span)) {
    if let Some(name) = name {
        visit(&mut name.span);
    }
}

/// From behind the `=` of a value to its last bracket; `value` is the place of its expression inside the statement.
pub fn value_extent(text: &str, statement: Span, value: Span) -> Span {
    let offset = statement.start as usize;
    let Some(Ok(tokens)) = text.get(statement.range()).map(|t| scan(t, usize::MAX)) else { return value };
    let (start, end) = (value.start as usize - offset, value.end as usize - offset);
    let statement = &text[statement.range()];
    let sign = tokens.iter().rposition(|t| t.text(statement) == "=" && t.span.end as usize <= start);
    let first = sign.map_or(0, |k| k + 1);
    let mut depth = 0_usize;
    for token in &tokens[first..] {
        match token.kind {
            Kind::Open => depth += 1,
            Kind::Close => depth = depth.saturating_sub(1),
            _ => {}
        }
        if depth == 0 && token.span.end as usize >= end {
            return Span::new(offset + tokens[first].span.start as usize, offset + token.span.end as usize);
        }
    }
    value
}
