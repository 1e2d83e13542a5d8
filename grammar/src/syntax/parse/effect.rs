//! Pairs of the grammar to the types of an effect.

use super::{Build, Refusal, Rule, read, repeated, span, word};
use crate::diagnostic::{Code, Diagnostic, nearest};
use crate::syntax::catalogue::*;
use crate::syntax::expression::Builder;
use crate::syntax::tree::*;
use pest::iterators::{Pair, Pairs};

/// What stands between the word `effect` and its brace.
pub(in crate::syntax) struct EffectHeader {
    pub(in crate::syntax) name: Name,
    pub(in crate::syntax) slots: Vec<Slot>,
    pub(in crate::syntax) conditions: Vec<Condition>,
    pub(in crate::syntax) class: Class,
    pub(in crate::syntax) fields: Vec<Field>,
    pub(in crate::syntax) doc: Option<Name>,
}

/// Reads `effect NAME(slots) conditions as class "doc" {`, which begins at byte `offset` of the source.
pub(in crate::syntax) fn effect_header(
    text: &str,
    offset: usize,
    builder: &mut Builder,
) -> Result<(Option<EffectHeader>, Vec<Diagnostic>), Refusal> {
    let pair = read(Rule::effect_header, text, offset)?;
    let mut build = Build::new(text, offset, builder);
    let header = build.effect_header(pair.into_inner()).filter(|_| build.sound);
    Ok((header, build.findings))
}

/// Reads one statement of an effect without its semicolon.
pub(in crate::syntax) fn effect_statement(
    text: &str,
    offset: usize,
    builder: &mut Builder,
) -> Result<(Option<EffectLine>, Vec<Diagnostic>), Refusal> {
    let pair = read(Rule::effect_statement, text, offset)?;
    let mut build = Build::new(text, offset, builder);
    let line = pair.into_inner().next().and_then(|p| build.effect_line(p)).filter(|_| build.sound);
    Ok((line, build.findings))
}

impl Build<'_> {
    fn effect_header(&mut self, parts: Pairs<Rule>) -> Option<EffectHeader> {
        let (mut name, mut doc, mut class) = (None, None, None);
        let (mut slots, mut conditions, mut fields) = (Vec::new(), Vec::new(), Vec::new());
        for part in parts {
            let place = span(&part, self.offset);
            match part.as_rule() {
                Rule::name => name = Some(word(&part, self.offset, 0)),
                Rule::slot => slots.extend(self.slot(part)),
                Rule::condition => conditions.extend(self.condition(part)),
                Rule::effect_class => {
                    let names: Vec<Name> = name.iter().cloned().collect();
                    for written in part.into_inner().filter(|p| p.as_rule() == Rule::name) {
                        self.once(&mut class, word(&written, self.offset, 0), (Rule::effect_class, place), &names);
                    }
                }
                Rule::effect_fields => {
                    for written in part.into_inner().filter(|p| p.as_rule() == Rule::name) {
                        fields.extend(self.field(&word(&written, self.offset, 0)));
                    }
                }
                Rule::doc => {
                    let names: Vec<Name> = name.iter().cloned().collect();
                    self.once(&mut doc, word(&part, self.offset, 1), (Rule::doc, place), &names);
                }
                _ => {}
            }
        }
        let class = class.map_or(Some(Class::default()), |written| self.class(&written));
        Some(EffectHeader { name: name?, slots, conditions, class: class?, fields, doc })
    }

    /// `as stand_in`
    fn class(&mut self, written: &Name) -> Option<Class> {
        let found = Class::ALL.into_iter().find(|c| c.word() == written.text);
        if found.is_none() {
            self.no_such_word(written, "class of effects", &Class::ALL.map(Class::word));
        }
        found
    }

    /// `for ship`
    fn field(&mut self, written: &Name) -> Option<Field> {
        let found = Field::ALL.into_iter().find(|f| f.word() == written.text);
        if found.is_none() {
            self.no_such_word(written, "field", &Field::ALL.map(Field::word));
        }
        found
    }

    fn no_such_word(&mut self, written: &Name, what: &str, words: &[&str]) {
        let message = format!("`{}` is no {what}", written.text);
        let hint = match nearest(&written.text, words.iter().copied()) {
            Some(near) => format!("did you mean `{near}`?"),
            None => match words.split_last() {
                Some((last, others)) => format!("`{}` or `{last}`", others.join("`, `")),
                None => String::new(),
            },
        };
        self.findings.push(Diagnostic::new(Code::WrongName, written.span, message).hint(hint));
        self.sound = false;
    }

    /// `x: state | input`
    fn slot(&mut self, pair: Pair<Rule>) -> Option<Slot> {
        let mut name = None;
        let mut kinds = Vec::new();
        for part in pair.into_inner() {
            match part.as_rule() {
                Rule::name => name = Some(word(&part, self.offset, 0)),
                Rule::slot_kind => {
                    let written = word(&part, self.offset, 0);
                    match SlotKind::ALL.into_iter().find(|k| k.word() == written.text) {
                        Some(kind) if !kinds.contains(&kind) => kinds.push(kind),
                        Some(_) => {}
                        None => {
                            self.findings.push(unknown_kind(&written));
                            self.sound = false;
                        }
                    }
                }
                _ => {}
            }
        }
        Some(Slot { name: name?, kinds })
    }

    fn condition(&mut self, pair: Pair<Rule>) -> Option<Condition> {
        let mut parts = pair.into_inner();
        let unless = parts.next()?.as_str() == "unless";
        Some(Condition { unless, test: self.expression(parts.next()?)? })
    }

    fn effect_line(&mut self, pair: Pair<Rule>) -> Option<EffectLine> {
        let rule = pair.as_rule();
        let mut parts = pair.into_inner();
        Some(match rule {
            Rule::tunable => EffectLine::Tunable(self.tunable(parts)?),
            Rule::effect_own => {
                let keyword = parts.next()?;
                let role = Role::ALL.into_iter().find(|r| r.keyword() == keyword.as_str())?;
                let names = parts.filter(|p| p.as_rule() == Rule::declaration);
                EffectLine::Own(role, names.filter_map(|p| self.declaration(p)).collect())
            }
            Rule::add => {
                let place = self.place(parts.nth(1)?)?;
                EffectLine::Add(place, self.expression(parts.nth(1)?)?)
            }
            Rule::replace => {
                let name = word(&parts.nth(1)?, self.offset, 0);
                EffectLine::Replace(name, self.expression(parts.nth(1)?)?)
            }
            Rule::rate_noise => {
                let place = self.place(parts.nth(1)?)?;
                EffectLine::Noise(place, self.expression(parts.nth(1)?)?)
            }
            _ => {
                let left = self.expression(parts.next()?)?;
                EffectLine::Equation(left, self.expression(parts.nth(1)?)?)
            }
        })
    }

    fn place(&mut self, pair: Pair<Rule>) -> Option<Place> {
        let derivative = pair.clone().into_inner().any(|p| p.as_rule() == Rule::word_der);
        let name = pair.into_inner().find(|p| p.as_rule() == Rule::name)?;
        Some(Place { derivative, name: word(&name, self.offset, 0) })
    }

    fn tunable(&mut self, mut parts: Pairs<Rule>) -> Option<Tunable> {
        let nuisance = parts.next()?.as_str() == "nuisance";
        let name = parts.next()?;
        let all = span(&name, self.offset);
        let mut d = Declaration::new(word(&name, self.offset, 0), all);
        let (mut trials, mut positive) = (Vec::new(), false);
        let mut seen: Vec<(Rule, crate::source::Span)> = Vec::new();
        for part in parts {
            let (rule, place) = (part.as_rule(), span(&part, self.offset));
            d.span = d.span.to(place);
            if let Some((_, first)) = seen.iter().find(|(r, _)| *r == rule) {
                self.findings.push(repeated(rule, &d.name.text, place, *first));
                continue;
            }
            seen.push((rule, place));
            match rule {
                Rule::doc => d.doc = Some(word(&part, self.offset, 1)),
                Rule::unit => d.unit = Some(word(&part, self.offset, 1)),
                Rule::value => d.value = self.value(part),
                Rule::bounds => d.bounds = self.bounds(part, place),
                Rule::fixed => d.fixed = Some(place),
                Rule::positive => positive = true,
                Rule::trials => {
                    let list = part.into_inner().filter(|p| p.as_rule() == Rule::expression);
                    trials = list.filter_map(|p| self.expression(p)).collect();
                }
                _ => d.per_run = Some(place),
            }
        }
        Some(Tunable { nuisance, declaration: d, trials, positive })
    }
}

fn unknown_kind(written: &Name) -> Diagnostic {
    let message = format!("`{}` is nothing that an effect can be attached to", written.text);
    let hint = match nearest(&written.text, SlotKind::ALL.map(SlotKind::word)) {
        Some(near) => format!("did you mean `{near}`?"),
        None if matches!(written.text.as_str(), "equation" | "eq" | "rate") => {
            "an equation is attached to by its state: `x: state`, and written `der(x)` in the effect".into()
        }
        None => "`input`, `state`, `output` or `param`".into(),
    };
    Diagnostic::new(Code::WrongName, written.span, message).hint(hint)
}
