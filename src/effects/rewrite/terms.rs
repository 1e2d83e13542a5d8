//! `add` and `replace` lines to edits of the equations, outputs and uses that they change.

use super::Rewrite;
use crate::edit::Line;
use crate::subject::{Balance, BalanceEquation, Element, vector_of};
use fdm_grammar::diagnostic::Diagnostic;
use fdm_grammar::source::Span;
use fdm_grammar::syntax::{BinarySign, EffectLine, Expr, ExprRef, Role, SlotKind, SyntaxTree, Value};

impl<'a> Rewrite<'a> {
    /// How often a name, or the rate of a state, stands in the lines of the effect.
    pub(super) fn mentions(&self, wanted: &str, rate: bool) -> usize {
        let pool = self.pool();
        let mut count = 0;
        let mut open: Vec<ExprRef> = Vec::new();
        for (line, _) in &self.effect.tree().lines {
            match line {
                EffectLine::Equation(_, e) | EffectLine::Add(_, e) | EffectLine::Replace(_, e) => open.push(*e),
                EffectLine::Own(Role::Let, list) => open.extend(list.iter().filter_map(|d| match d.value {
                    Some(Value::Expr(e)) => Some(e),
                    _ => None,
                })),
                _ => {}
            }
        }
        while let Some(e) = open.pop() {
            match pool.expr(e) {
                Expr::Name(name) => count += usize::from(!rate && name == wanted),
                Expr::Call(call, arguments) if call.text == "der" => {
                    let own = matches!(pool.expr(arguments[0]), Expr::Name(n) if n == wanted);
                    count += usize::from(rate && own);
                }
                expr => expr.each_operand(|o| open.push(o)),
            }
        }
        count
    }

    /// `add` and `replace` lines to edits, replaced uses first: they move along with the equations they stand in.
    pub(super) fn changes(&mut self) -> Result<(), Diagnostic> {
        let effect = self.effect;
        let kinds = self.candidate.kinds();
        let is_output = |slot: &str| effect.slot(slot).is_some_and(|k| kinds[k] == SlotKind::Output);
        let lines = &effect.tree().lines;
        for (line, _) in lines {
            if let EffectLine::Replace(name, with) = line
                && !is_output(&name.text)
            {
                self.replace_uses(&name.text, *with)?;
            }
        }
        for slot in &effect.tree().slots {
            let slot = &slot.name.text;
            let added = lines.iter().find_map(|(l, _)| match l {
                EffectLine::Add(place, e) if place.derivative && place.name.text == *slot => Some(*e),
                _ => None,
            });
            if added.is_some() || self.mentions(slot, true) > 0 {
                self.rate(slot, added)?;
            }
        }
        for slot in &effect.tree().slots {
            let slot = &slot.name.text;
            let added = lines.iter().find_map(|(l, _)| match l {
                EffectLine::Add(place, e) if !place.derivative && place.name.text == *slot => Some(*e),
                _ => None,
            });
            let replaced = lines.iter().find_map(|(l, _)| match l {
                EffectLine::Replace(name, e) if name.text == *slot && is_output(slot) => Some(*e),
                _ => None,
            });
            if added.is_some() || replaced.is_some() {
                self.output(slot, added, replaced)?;
            }
        }
        Ok(())
    }

    /// Every use of an input, a state or a param becomes an expression.
    pub(super) fn replace_uses(&mut self, slot: &str, with: ExprRef) -> Result<(), Diagnostic> {
        let target = self.bound[slot].clone();
        let state = self.subject.balance(&target).is_some();
        let uses = self.subject.uses(&target, state.then_some(target.as_str()));
        if uses.is_empty() {
            return Err(self.misfit(format!("nothing uses `{target}`")));
        }
        let text = self.print(with);
        if let Some(element) = self.subject.element(&target) {
            let Element { vector, length, .. } = element;
            let name = self.taken.give(&format!("{vector}_{}", self.effect.name()));
            let value = element.in_vector(&text, |k| format!("{vector}[{}]", k + 1));
            self.declared.push(name.clone());
            self.lines.push((Line::Declare(Role::Let), format!("let {name}[{length}] = {value};")));
            uses.into_iter().for_each(|(span, _)| self.editor.replace(span.range(), name.clone()));
            return Ok(());
        }
        let short = matches!(self.pool().expr(with), Expr::Name(_) | Expr::Number(_) | Expr::Call(..));
        let name = match self.pool().expr(with) {
            Expr::Name(_) => text,
            _ if uses.len() == 1 && short => text,
            _ if uses.len() == 1 => format!("({text})"),
            _ => {
                let name = self.taken.give(&format!("{target}_{}", self.effect.name()));
                self.declared.push(name.clone());
                self.lines.push((Line::Declare(Role::Let), format!("let {name} = {text};")));
                name
            }
        };
        for (span, _) in uses {
            self.editor.replace(span.range(), name.clone());
        }
        Ok(())
    }

    /// A term is added to the equation of a state, or what stands there gets a name.
    pub(super) fn rate(&mut self, slot: &str, added: Option<ExprRef>) -> Result<(), Diagnostic> {
        let target = self.bound[slot].clone();
        let BalanceEquation { side, statement, is_plain, is_turned } = match self.subject.balance(&target) {
            Some(Balance::Equation(equation)) => equation,
            Some(Balance::Reactions(statement)) => {
                self.rate_of_species(slot, statement, added);
                return Ok(());
            }
            None => return Err(self.misfit(format!("`{target}` has no equation of its own"))),
        };
        let value = self.editor.value(statement, side);
        // a derivative in a balance of forces keeps its name
        if self.mentions(slot, true) == 0 || !is_plain {
            if let Some(added) = added {
                self.append(slot, (side, value), added, is_turned);
            }
            return Ok(());
        }
        let element = self.subject.element(&target);
        let of = vector_of(&target);
        let name = self.taken.give(&format!("{of}_rate"));
        self.declared.push(name.clone());
        let (size, own) = match element {
            Some(Element { length, index, .. }) => (format!("[{length}]"), format!("{name}[{}]", index + 1)),
            None => (String::new(), name.clone()),
        };
        self.names.insert(format!("der({slot})"), own);
        let start = statement.start as usize;
        self.editor.replace(start..value.start, format!("let {name}{size} = "));
        let term = added.map_or(String::new(), |e| self.term(slot, e, false));
        self.editor.insert_behind(statement, &format!("der({of}) = {name}{term};"));
        Ok(())
    }

    /// The balance of a species gets an equation of its own behind the reactions.
    fn rate_of_species(&mut self, slot: &str, reactions: Span, added: Option<ExprRef>) {
        let target = self.bound[slot].clone();
        let mut made = format!("reaction({target})");
        if self.mentions(slot, true) > 0 {
            let name = self.taken.give(&format!("{target}_rate"));
            self.declared.push(name.clone());
            self.names.insert(format!("der({slot})"), name.clone());
            self.editor.insert_behind(reactions, &format!("let {name} = {made};"));
            made = name;
        }
        let term = added.map_or(String::new(), |e| self.term(slot, e, false));
        self.editor.insert_behind(reactions, &format!("der({target}) = {made}{term};"));
    }

    /// ` + c*x` or ` - c*x` behind a value of what a slot stands for.
    pub(super) fn append(
        &mut self,
        slot: &str,
        (root, value): (ExprRef, std::ops::Range<usize>),
        added: ExprRef,
        is_turned: bool,
    ) {
        let term = self.term(slot, added, is_turned);
        // an `if` without brackets would take the term into its last branch
        if matches!(self.subject.tree.expr(root), Expr::If(..)) {
            self.editor.replace(value.start..value.start, "(");
            self.editor.replace(value.end..value.end, format!("){term}"));
        } else {
            self.editor.replace(value.end..value.end, term);
        }
    }

    /// What is added, with its sign, or subtracted; for an element of a vector, a vector that is zero beside it.
    pub(super) fn term(&self, slot: &str, added: ExprRef, is_turned: bool) -> String {
        let text = self.print(added);
        if let Some(element) = self.subject.element(&self.bound[slot]) {
            let vector = element.in_vector(&text, |_| "0".into());
            return format!(" {} {vector}", if is_turned { '-' } else { '+' });
        }
        let (choice, sum) = match self.pool().expr(added) {
            Expr::If(..) => (true, false),
            Expr::Binary(sign, ..) => (false, matches!(sign, BinarySign::Add | BinarySign::Subtract)),
            _ => (false, false),
        };
        let [plus, minus] = if is_turned { ['-', '+'] } else { ['+', '-'] };
        match text.strip_prefix('-') {
            Some(rest) if !sum && !choice => format!(" {minus} {rest}"),
            None if !(choice || sum && is_turned) => format!(" {plus} {text}"),
            _ => format!(" {plus} ({text})"),
        }
    }

    /// The expression of an output is changed; where it is needed more than once it gets a name.
    pub(super) fn output(
        &mut self,
        slot: &str,
        added: Option<ExprRef>,
        replaced: Option<ExprRef>,
    ) -> Result<(), Diagnostic> {
        let target = self.bound[slot].clone();
        let of = vector_of(&target);
        let Some((_, declaration, statement)) = self.subject.declaration(of) else {
            return Err(self.misfit(format!("`{target}` is not declared in this text")));
        };
        let Some(Value::Expr(root)) = declaration.value else {
            return Err(self.misfit(format!("`{target}` has no expression")));
        };
        let value = self.editor.value(statement, root);
        let mentions = self.mentions(slot, false);
        if let (Some(added), 0) = (added, mentions) {
            self.append(slot, (root, value), added, false);
            return Ok(());
        }
        if let Some(element) = self.subject.element(&target) {
            let name = self.taken.give(&format!("{of}_true"));
            self.declared.push(name.clone());
            let old = self.editor.take(&value);
            self.lines.push((Line::Declare(Role::Let), format!("let {name}[{}] = {old};", element.length)));
            self.names.insert(slot.into(), format!("{name}[{}]", element.index + 1));
            let new = match (replaced, added) {
                (Some(e), _) => element.in_vector(&self.print(e), |k| format!("{name}[{}]", k + 1)),
                (None, Some(e)) => format!("{name}{}", self.term(slot, e, false)),
                (None, None) => return Ok(()),
            };
            self.editor.replace(value, new);
            return Ok(());
        }
        let alone = replaced.is_some_and(|e| mentions == 1 && within(self.pool(), e, slot));
        let old = self.editor.take(&value);
        if alone {
            let argument = replaced.is_some_and(|e| is_argument(self.pool(), e, slot));
            let simple = matches!(self.subject.tree.expr(root), Expr::Name(_) | Expr::Call(..) | Expr::Number(_));
            self.names.insert(slot.into(), if simple || argument { old } else { format!("({old})") });
        } else if mentions > 0 {
            let name = if matches!(self.subject.tree.expr(root), Expr::Name(_)) {
                old
            } else {
                let name = self.taken.give(&format!("{target}_true"));
                self.declared.push(name.clone());
                self.lines.push((Line::Declare(Role::Let), format!("let {name} = {old};")));
                name
            };
            self.names.insert(slot.into(), name);
        }
        let new = match (replaced, added) {
            (Some(e), _) => self.print(e),
            (None, Some(e)) => format!("{}{}", self.names[slot], self.term(slot, e, false)),
            (None, None) => return Ok(()),
        };
        self.editor.replace(value, new);
        if alone {
            self.names.insert(slot.into(), target);
        }
        Ok(())
    }
}

fn within(pool: &SyntaxTree, root: ExprRef, name: &str) -> bool {
    let mut open = vec![root];
    while let Some(e) = open.pop() {
        if matches!(pool.expr(e), Expr::Name(n) if n == name) {
            return true;
        }
        pool.expr(e).each_operand(|o| open.push(o));
    }
    false
}

/// Whether a name stands alone as an argument, where it needs no brackets.
fn is_argument(pool: &SyntaxTree, root: ExprRef, name: &str) -> bool {
    let is = |e: &ExprRef| matches!(pool.expr(*e), Expr::Name(n) if n == name);
    let mut open = vec![root];
    while let Some(e) = open.pop() {
        match pool.expr(e) {
            Expr::Call(_, arguments) if arguments.iter().any(is) => return true,
            expr => expr.each_operand(|o| open.push(o)),
        }
    }
    false
}
