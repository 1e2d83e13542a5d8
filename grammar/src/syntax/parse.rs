//! The door to the grammar: the only file that sees pest and its rules. One header or one statement at a time.

use super::expected::Want;
use super::expression::Builder;
use super::tree::*;
use crate::diagnostic::{Code, Diagnostic};
use crate::number::held;
use crate::source::Span;
use pest::Parser;
use pest::error::{ErrorVariant, InputLocation};
use pest::iterators::{Pair, Pairs};

mod effect;
pub(super) use effect::{EffectHeader, effect_header, effect_statement};

#[allow(missing_docs, unreachable_pub)]
mod grammar {
    #[derive(pest_derive::Parser)]
    #[grammar = "../fdm.pest"]
    pub struct Grammar;
}
use grammar::{Grammar, Rule};

/// Whether a name can begin with this character.
pub(super) fn starts_name(c: char) -> bool {
    c == '_' || c.is_ascii_alphabetic() || !c.is_ascii() && pest::unicode::XID_START(c)
}

/// Whether a name can go on with this character.
pub(super) fn continues_name(c: char) -> bool {
    c == '_' || c.is_ascii_alphanumeric() || !c.is_ascii() && !is_middle_dot(c) && pest::unicode::XID_CONTINUE(c)
}

/// Signs of multiplication that Unicode counts among the letters.
fn is_middle_dot(c: char) -> bool {
    matches!(c, '\u{b7}' | '\u{387}')
}

/// Why the grammar did not take a text: the byte, and what it would have taken there.
#[derive(Debug)]
pub(super) struct Refusal {
    pub(super) offset: usize,
    pub(super) wants: Vec<Want>,
}

/// A name or string with the byte where the text read begins added to its place.
fn word(pair: &Pair<Rule>, offset: usize, quotes: usize) -> Name {
    let text = pair.as_str();
    Name { text: text[quotes..text.len() - quotes].into(), span: span(pair, offset) }
}

fn span(pair: &Pair<Rule>, offset: usize) -> Span {
    let span = pair.as_span();
    Span::new(offset + span.start(), offset + span.end())
}

/// Reads `model NAME "doc" {`, which begins at byte `offset` of the source.
pub(super) fn header(text: &str, offset: usize) -> Result<(Name, Option<Name>), Refusal> {
    let mut parts = read(Rule::header, text, offset)?.into_inner().skip(1);
    let name = parts
        .next()
        .map(|p| word(&p, offset, 0))
        .unwrap_or_else(|| Name { text: String::new(), span: Span::default() });
    let doc = parts.find(|p| p.as_rule() == Rule::doc).map(|p| word(&p, offset, 1));
    Ok((name, doc))
}

/// Reads one statement without its semicolon, which begins at byte `offset` of the source; its expressions go to the
/// builder. Findings are mistakes in a statement of the right form; without a statement there is at least one.
pub(super) fn statement(
    text: &str,
    offset: usize,
    builder: &mut Builder,
) -> Result<(Option<StatementKind>, Vec<Diagnostic>), Refusal> {
    let pair = read(Rule::statement, text, offset)?;
    let mut build = Build::new(text, offset, builder);
    let kind = pair.into_inner().next().and_then(|p| build.statement(p)).filter(|_| build.sound);
    Ok((kind, build.findings))
}

fn read(rule: Rule, text: &str, offset: usize) -> Result<Pair<'_, Rule>, Refusal> {
    let error = match Grammar::parse(rule, text) {
        Ok(mut pairs) => return pairs.next().ok_or(Refusal { offset, wants: Vec::new() }),
        Err(error) => error,
    };
    let (InputLocation::Pos(at) | InputLocation::Span((at, _))) = error.location;
    let wants = match &error.variant {
        ErrorVariant::ParsingError { positives, .. } => positives.iter().filter_map(|r| want(*r)).collect(),
        // pest stops by itself where the machine's stack runs out.
        ErrorVariant::CustomError { .. } => vec![Want::LessNesting],
    };
    Err(Refusal { offset: offset + at, wants })
}

/// What a rule that did not match would have been, in the words of messages.
fn want(rule: Rule) -> Option<Want> {
    Some(match rule {
        Rule::expression | Rule::number | Rule::sign | Rule::choice | Rule::group | Rule::value | Rule::belief => {
            Want::Expression
        }
        Rule::vector | Rule::element | Rule::reference => Want::Expression,
        Rule::point | Rule::points => Want::Point,
        Rule::name
        | Rule::declaration
        | Rule::deviation
        | Rule::intensity
        | Rule::setting
        | Rule::bond
        | Rule::target => Want::Name,
        Rule::connection | Rule::method | Rule::argument => Want::Name,
        Rule::file | Rule::word_from => Want::From,
        Rule::word_by | Rule::word_order => Want::Order,
        Rule::infix | Rule::arguments => Want::Infix,
        Rule::doc => Want::Doc,
        Rule::word_as => Want::As,
        Rule::colon => Want::Colon,
        Rule::open | Rule::connections => Want::Open,
        Rule::bounds | Rule::word_in | Rule::fixed | Rule::per_run | Rule::word_per | Rule::by_log | Rule::positive => {
            Want::Attribute
        }
        Rule::unit => Want::Unit,
        Rule::word_run | Rule::word_group => Want::Run,
        Rule::per_group | Rule::hold | Rule::wrap | Rule::word_wrap => Want::Attribute,
        Rule::period => Want::Expression,
        Rule::equals => Want::Equals,
        Rule::tilde => Want::Tilde,
        Rule::comma => Want::Comma,
        Rule::close => Want::Close,
        Rule::bracket => Want::Bracket,
        Rule::close_bracket => Want::CloseBracket,
        Rule::brace => Want::Brace,
        Rule::word_at => Want::At,
        Rule::close_brace => Want::CloseBrace,
        Rule::semicolon => Want::Semicolon,
        Rule::word_then => Want::Then,
        Rule::word_else => Want::Else,
        Rule::word_model => Want::Model,
        Rule::EOI => Want::End,
        Rule::statement | Rule::declare | Rule::equation | Rule::time | Rule::role => Want::Statement,
        Rule::species | Rule::factor | Rule::side | Rule::portion | Rule::reaction | Rule::nothing => Want::Name,
        Rule::arrow => Want::Arrow,
        Rule::reactions
        | Rule::prior
        | Rule::process
        | Rule::noise
        | Rule::trim
        | Rule::tie
        | Rule::table
        | Rule::smooth
        | Rule::requirement
        | Rule::scheduled
        | Rule::limit
        | Rule::when
        | Rule::use_model => Want::Statement,
        Rule::effect_own | Rule::tunable | Rule::add | Rule::replace | Rule::rate_noise => Want::EffectStatement,
        Rule::slot => Want::Slot,
        Rule::slot_kind => Want::Kind,
        Rule::place => Want::Place,
        Rule::word_with => Want::With,
        Rule::plus_equals => Want::PlusEquals,
        _ => return None,
    })
}

/// Turns the pairs of one statement into the types of the tree.
struct Build<'a> {
    text: &'a str,
    offset: usize,
    builder: &'a mut Builder,
    findings: Vec<Diagnostic>,
    /// Whether the statement can be kept.
    sound: bool,
}

impl<'a> Build<'a> {
    /// Reads a text that begins at byte `offset` of the source; expressions go to the builder.
    fn new(text: &'a str, offset: usize, builder: &'a mut Builder) -> Self {
        Self { text, offset, builder, findings: Vec::new(), sound: true }
    }

    fn statement(&mut self, pair: Pair<Rule>) -> Option<StatementKind> {
        let rule = pair.as_rule();
        let mut parts = pair.into_inner();
        Some(match rule {
            Rule::declare => {
                let keyword = parts.next()?;
                let role = Role::ALL.into_iter().find(|r| r.keyword() == keyword.as_str())?;
                let names = parts.filter(|p| p.as_rule() == Rule::declaration);
                StatementKind::Declare(role, names.filter_map(|p| self.declaration(p)).collect())
            }
            Rule::time => StatementKind::Time(word(&parts.nth(1)?, self.offset, 1)),
            Rule::prior => {
                let beliefs = parts.filter(|p| p.as_rule() == Rule::belief);
                StatementKind::Prior(beliefs.filter_map(|p| self.belief(p)).collect())
            }
            Rule::noise => {
                let deviations = parts.filter(|p| p.as_rule() == Rule::deviation);
                StatementKind::Noise(deviations.filter_map(|p| self.named(p)).collect())
            }
            Rule::process => {
                let intensities = parts.filter(|p| p.as_rule() == Rule::intensity);
                StatementKind::Process(intensities.filter_map(|p| self.intensity(p)).collect())
            }
            Rule::trim => {
                let settings = parts.filter(|p| p.as_rule() == Rule::setting);
                StatementKind::Trim(settings.filter_map(|p| self.named(p)).collect())
            }
            Rule::tie => {
                let bonds = parts.filter(|p| p.as_rule() == Rule::bond);
                StatementKind::Tie(bonds.filter_map(|p| self.named(p)).collect())
            }
            Rule::table => StatementKind::Table(self.table(parts)?),
            Rule::scheduled => StatementKind::Table(self.scheduled(parts)?),
            Rule::smooth => StatementKind::Smooth(self.smooth(parts)?),
            Rule::requirement => {
                let names = parts.filter(|p| p.as_rule() == Rule::declaration);
                StatementKind::Requirement(names.filter_map(|p| self.declaration(p)).collect())
            }
            Rule::limit => {
                let limited = parts.filter(|p| p.as_rule() == Rule::limited);
                StatementKind::Limit(limited.filter_map(|p| self.limited(p)).collect())
            }
            Rule::when => {
                let (mut condition, mut resets) = (None, Vec::new());
                for part in parts {
                    match part.as_rule() {
                        Rule::expression => condition = Some(self.expression(part)?),
                        Rule::setting => resets.extend(self.named(part)),
                        _ => {}
                    }
                }
                StatementKind::When(When { condition: condition?, resets })
            }
            Rule::use_model => StatementKind::Use(self.submodel(parts)?),
            Rule::reactions => {
                let (mut volume, mut list) = (None, Vec::new());
                for part in parts {
                    match part.as_rule() {
                        Rule::expression => volume = Some(self.expression(part)?),
                        Rule::reaction => list.extend(self.reaction(part)),
                        _ => {}
                    }
                }
                StatementKind::Reactions(volume, list)
            }
            _ => {
                let left = self.expression(parts.next()?)?;
                StatementKind::Equation(left, self.expression(parts.nth(1)?)?)
            }
        })
    }

    /// `A + 2*B -> C : k*A*B`, `X <-> Y : kf*X, kr*Y`
    fn reaction(&mut self, pair: Pair<Rule>) -> Option<Reaction> {
        let whole = span(&pair, self.offset);
        let (mut sides, mut rates) = (Vec::new(), Vec::new());
        let (mut is_open, mut arrow) = (false, None);
        for part in pair.into_inner() {
            match part.as_rule() {
                Rule::side => {
                    let mut side = Vec::new();
                    for portion in part.into_inner().flat_map(Pair::into_inner) {
                        match portion.as_rule() {
                            Rule::species => side.extend(self.species(portion)),
                            _ => is_open = true,
                        }
                    }
                    sides.push(side);
                }
                Rule::arrow => arrow = Some((part.as_str() == "<->", span(&part, self.offset))),
                Rule::expression => rates.push(self.expression(part)?),
                _ => {}
            }
        }
        let (reversible, at) = arrow?;
        if reversible != (rates.len() == 2) {
            let (sign, said) =
                if reversible { ("<->", "two rates, forwards and backwards") } else { ("->", "one rate") };
            let message = format!("a reaction with `{sign}` has {said}");
            let hint = "`A -> B : k*A;`, `A <-> B : kf*A, kr*B;`";
            self.findings.push(Diagnostic::new(Code::BadReaction, at, message).hint(hint));
            self.sound = false;
        }
        let right = sides.pop()?;
        let mut rates = rates.into_iter();
        Some(Reaction {
            left: sides.pop()?,
            right,
            is_open,
            forward: rates.next()?,
            reverse: rates.next(),
            span: whole,
        })
    }

    /// `2*B`, `n*B`
    fn species(&mut self, pair: Pair<Rule>) -> Option<Species> {
        let (mut name, mut count, mut factor) = (None, 1.0, None);
        for part in pair.into_inner() {
            let place = span(&part, self.offset);
            match part.as_rule() {
                Rule::number => {
                    count = self.number(part.as_str(), place);
                    if count == 0.0 {
                        let message = "a species takes part in a reaction by a number above zero";
                        let hint = "`0` by itself is what is not modelled";
                        self.findings.push(Diagnostic::new(Code::BadReaction, place, message).hint(hint));
                        self.sound = false;
                    }
                }
                Rule::factor => factor = Some(word(&part, self.offset, 0)),
                Rule::target => name = Some(word(&part, self.offset, 0)),
                _ => {}
            }
        }
        let mut name = name?;
        name.text.retain(|c| !c.is_whitespace());
        Some(Species { name, count, factor })
    }

    /// `a ~ normal(mean, deviation)`
    fn belief(&mut self, pair: Pair<Rule>) -> Option<(ExprRef, ExprRef)> {
        let mut parts = pair.into_inner();
        let subject = self.expression(parts.next()?)?;
        Some((subject, self.expression(parts.nth(1)?)?))
    }

    /// `y = deviation`, `u = value`; an index is written without spaces.
    fn named(&mut self, pair: Pair<Rule>) -> Option<(Name, ExprRef)> {
        let mut parts = pair.into_inner();
        let mut name = word(&parts.next()?, self.offset, 0);
        name.text.retain(|c| !c.is_whitespace());
        Some((name, self.expression(parts.nth(1)?)?))
    }

    /// `der(x) = intensity`: the name is that of the state.
    fn intensity(&mut self, pair: Pair<Rule>) -> Option<(Name, ExprRef)> {
        let mut parts = pair.into_inner().filter(|p| matches!(p.as_rule(), Rule::target | Rule::expression));
        let mut name = word(&parts.next()?, self.offset, 0);
        name.text.retain(|c| !c.is_whitespace());
        Some((name, self.expression(parts.next()?)?))
    }

    /// `alpha [rad]`
    fn argument(&self, pair: Pair<Rule>) -> Option<Argument> {
        let mut parts = pair.into_inner();
        let name = word(&parts.next()?, self.offset, 0);
        Some(Argument { name, unit: parts.next().map(|u| word(&u, self.offset, 1)) })
    }

    /// What follows the word `table`.
    fn table(&mut self, parts: Pairs<Rule>) -> Option<Table> {
        let mut names = Vec::new();
        let (mut doc, mut unit, mut method) = (None, None, None);
        let (mut arguments, mut entries, mut file) = (Vec::new(), Vec::new(), None);
        for part in parts {
            let place = span(&part, self.offset);
            match part.as_rule() {
                Rule::name => names.push(word(&part, self.offset, 0)),
                Rule::argument => arguments.push(self.argument(part)?),
                Rule::unit => self.once(&mut unit, word(&part, self.offset, 1), (Rule::unit, place), &names),
                Rule::doc => self.once(&mut doc, word(&part, self.offset, 1), (Rule::doc, place), &names),
                Rule::method => method = Some(word(&part, self.offset, 0)),
                Rule::points => {
                    let pairs = part.into_inner().filter(|p| p.as_rule() == Rule::point);
                    entries = pairs.filter_map(|p| self.entry(p)).collect();
                }
                Rule::file => {
                    let mut parts = part.into_inner().skip(1);
                    let path = word(&parts.next()?, self.offset, 1);
                    file = Some(Nodes::File(path, parts.next().map(|p| span(&p, self.offset))));
                }
                _ => {}
            }
        }
        let name = names.into_iter().next()?;
        let nodes = match file {
            Some(file) => file,
            None => self.nodes(&name, &arguments, entries)?,
        };
        Some(Table { name, arguments, doc, unit, method: method?, nodes, scheduled: false, bounds: None })
    }

    /// `param Mq(V) "pitch damping" [1/s] in [-10, 0] = cubic -1.5 at [20, 40, 60]`
    fn scheduled(&mut self, parts: Pairs<Rule>) -> Option<Table> {
        let mut names = Vec::new();
        let (mut doc, mut unit, mut method, mut bounds, mut start) = (None, None, None, None, None);
        let (mut arguments, mut axes) = (Vec::new(), Vec::new());
        for part in parts {
            let place = span(&part, self.offset);
            match part.as_rule() {
                Rule::name => names.push(word(&part, self.offset, 0)),
                Rule::argument => arguments.push(self.argument(part)?),
                Rule::unit => self.once(&mut unit, word(&part, self.offset, 1), (Rule::unit, place), &names),
                Rule::doc => self.once(&mut doc, word(&part, self.offset, 1), (Rule::doc, place), &names),
                Rule::bounds => bounds = self.bounds(part, place),
                Rule::interpolant => method = Some(word(&part, self.offset, 0)),
                Rule::expression => start = Some((self.expression(part)?, place)),
                Rule::places => axes.push(self.expression(part.into_inner().next()?)?),
                _ => {}
            }
        }
        let (name, (start, begun)) = (names.into_iter().next()?, start?);
        if axes.len() != arguments.len() {
            let message = format!("`{}` depends on {} and has nodes along {}", name.text, arguments.len(), axes.len());
            let hint = "a list of nodes for each, in their order: `param k(V, h) = 1 at [20, 40], [0, 1000];`";
            self.findings.push(Diagnostic::new(Code::BadTable, name.span, message).hint(hint));
            self.sound = false;
        }
        let own = Axis { name: name.clone(), free: Some(begun), values: Some(start) };
        let along = |(a, e): (&Argument, ExprRef)| Axis { name: a.name.clone(), free: None, values: Some(e) };
        let nodes = Nodes::Written(arguments.iter().zip(axes).map(along).chain([own]).collect());
        let method = method.unwrap_or_else(|| Name { text: "linear".into(), span: name.span });
        Some(Table { name, arguments, doc, unit, method, nodes, scheduled: true, bounds })
    }

    /// What stands between the braces of a table: points of a curve, or axes and values of a grid. A grid is what several arguments have, and
    /// what gives its values behind the table's own name.
    fn nodes(&mut self, table: &Name, arguments: &[Argument], entries: Vec<Entry>) -> Option<Nodes> {
        let named = |e: &Entry| matches!(self.builder.expr(e.key), Expr::Name(name) if *name == table.text);
        if arguments.len() == 1 && !entries.iter().any(named) {
            let mut points = Vec::new();
            for Entry { key, free, value } in entries {
                if let Some(free) = free {
                    let message = "`free` stands for all values of a table";
                    let hint = format!("`{{ {}: [...], {}: free }}`", arguments[0].name.text, table.text);
                    self.findings.push(Diagnostic::new(Code::BadTable, free, message).hint(hint));
                    self.sound = false;
                }
                points.extend(value.map(|value| (key, value)));
            }
            return Some(Nodes::Points(points));
        }
        let mut axes = Vec::new();
        for Entry { key, free, value: values } in entries {
            let span = self.builder.span(key);
            let Expr::Name(text) = self.builder.expr(key).clone() else {
                let message = format!(
                    "the table `{}` has {} arguments, and this is not the name of one",
                    table.text,
                    arguments.len()
                );
                let axis = |a: &Argument| format!("{}: [...]", a.name.text);
                let list: Vec<String> = arguments.iter().map(axis).collect();
                let hint = format!("`{{ {}, {}: [[...]] }}`", list.join(", "), table.text);
                self.findings.push(Diagnostic::new(Code::BadTable, span, message).hint(hint));
                self.sound = false;
                return None;
            };
            // it names an argument, not a quantity
            self.builder.expressions[key.0 as usize].0 = Expr::Number(0.0);
            axes.push(Axis { name: Name { text, span }, free, values });
        }
        Some(Nodes::Written(axes))
    }

    /// `x: y`, `alpha: [0, 1]`, `CL: free`
    fn entry(&mut self, pair: Pair<Rule>) -> Option<Entry> {
        let mut parts = pair.into_inner().filter(|p| matches!(p.as_rule(), Rule::expression | Rule::free));
        let key = self.expression(parts.next()?)?;
        let (mut free, mut value) = (None, None);
        for part in parts {
            match part.as_rule() {
                Rule::free => free = Some(span(&part, self.offset)),
                _ => value = Some(self.expression(part)?),
            }
        }
        Some(Entry { key, free, value })
    }

    /// `smooth CL by order 2`
    fn smooth(&mut self, parts: Pairs<Rule>) -> Option<Smooth> {
        let (mut table, mut order) = (None, None);
        for part in parts {
            match part.as_rule() {
                Rule::name => table = Some(word(&part, self.offset, 0)),
                Rule::number => {
                    let place = span(&part, self.offset);
                    let value = part.as_str().parse::<u32>().ok().filter(|n| (1..=3).contains(n));
                    if value.is_none() {
                        let message = "the order of differences is 1, 2 or 3";
                        let hint = "order 2 draws towards straight lines, order 1 towards a constant";
                        self.findings.push(Diagnostic::new(Code::BadTable, place, message).hint(hint));
                        self.sound = false;
                    }
                    order = Some((value.unwrap_or(2), place));
                }
                _ => {}
            }
        }
        let (order, order_span) = order?;
        Some(Smooth { table: table?, order, order_span })
    }

    /// `x in [a, b] smooth w`
    fn limited(&mut self, pair: Pair<Rule>) -> Option<Limited> {
        let (mut state, mut bounds, mut smooth) = (None, None, None);
        for part in pair.into_inner() {
            let place = span(&part, self.offset);
            match part.as_rule() {
                Rule::target => {
                    let mut name = word(&part, self.offset, 0);
                    name.text.retain(|c| !c.is_whitespace());
                    state = Some(name);
                }
                Rule::bounds => bounds = self.bounds(part, place),
                Rule::expression => smooth = Some(self.expression(part)?),
                _ => {}
            }
        }
        Some(Limited { state: state?, bounds: bounds?, smooth })
    }

    /// Takes an attribute of a table, or tells that it stands there twice.
    fn once(&mut self, place: &mut Option<Name>, new: Name, (rule, second): (Rule, Span), names: &[Name]) {
        match place {
            Some(first) => {
                let name = names.first().map_or("", |n| &n.text);
                self.findings.push(repeated(rule, name, second, first.span));
            }
            None => *place = Some(new),
        }
    }

    /// What follows the word `use`.
    fn submodel(&mut self, parts: Pairs<Rule>) -> Option<Use> {
        let (mut path, mut alias, mut foreign) = (None, None, false);
        let mut connections = Vec::new();
        for part in parts {
            match part.as_rule() {
                Rule::word_fmu => foreign = true,
                Rule::doc => path = Some(word(&part, self.offset, 1)),
                Rule::name if path.is_none() => path = Some(word(&part, self.offset, 0)),
                Rule::name => alias = Some(word(&part, self.offset, 0)),
                Rule::connections => {
                    let pairs = part.into_inner().filter(|p| p.as_rule() == Rule::connection);
                    connections = pairs.filter_map(|p| self.named(p)).collect();
                }
                _ => {}
            }
        }
        Some(Use { path: path?, alias: alias?, connections, foreign })
    }

    fn declaration(&mut self, pair: Pair<Rule>) -> Option<Declaration> {
        let all = span(&pair, self.offset);
        let mut parts = pair.into_inner();
        let mut d = Declaration::new(word(&parts.next()?, self.offset, 0), all);
        let mut seen: Vec<(Rule, Span)> = Vec::new();
        for part in parts {
            let (rule, place) = (part.as_rule(), span(&part, self.offset));
            if rule == Rule::unit && shape(&word(&part, self.offset, 1)).is_some() {
                self.unit_or_shape(&part, &mut d);
                continue;
            }
            if let Some((_, first)) = seen.iter().find(|(r, _)| *r == rule) {
                self.findings.push(repeated(rule, &d.name.text, place, *first));
                continue;
            }
            seen.push((rule, place));
            match rule {
                Rule::doc => d.doc = Some(word(&part, self.offset, 1)),
                Rule::unit => self.unit_or_shape(&part, &mut d),
                Rule::value => d.value = self.value(part),
                Rule::bounds => d.bounds = self.bounds(part, place),
                Rule::fixed => d.fixed = Some(place),
                Rule::by_log => d.log = Some(place),
                Rule::hold => d.hold = Some(Hold { held: part.as_str() == "held", span: place }),
                Rule::per_group => {
                    let name = part.into_inner().find(|p| p.as_rule() == Rule::name);
                    d.group = name.map(|name| word(&name, self.offset, 0));
                }
                Rule::wrap => d.wrap = wrap(part, place),
                _ => d.per_run = Some(place),
            }
        }
        Some(d)
    }

    /// `[m]` is a unit, `[3]` and `[2, 2]` are shapes, `[1]` says that the quantity is a pure number; `a = 1 [0, 5]`
    /// lacks the word `in`.
    fn unit_or_shape(&mut self, pair: &Pair<Rule>, d: &mut Declaration) {
        let unit = word(pair, self.offset, 1);
        let shape = shape(&unit);
        // what is no size in front of the value is none behind it, where a tree is written again
        if is_pair_of_numbers(&unit.text) && (d.value.is_some() || shape.is_none()) {
            let message = "this looks like bounds without the word `in`";
            let hint = format!("bounds are written `in [{}]`, units `[m/s]`", unit.text.trim());
            self.findings.push(Diagnostic::new(Code::WrongAttribute, unit.span, message).hint(hint));
            return;
        }
        let Some(shape) = shape else {
            d.unit = Some(unit);
            return;
        };
        if d.value.is_some() || d.unit.is_some() || d.shape.is_some() {
            let message = format!("the size of `{}` does not stand behind its name", d.name.text);
            let hint = format!("`{}[{}]`; a pure number has the unit `[1]`", d.name.text, unit.text.trim());
            self.findings.push(Diagnostic::new(Code::WrongAttribute, unit.span, message).hint(hint));
            self.sound = false;
        } else {
            d.shape = Some(shape);
        }
    }

    fn value(&mut self, pair: Pair<Rule>) -> Option<Value> {
        let part = pair.into_inner().nth(1)?;
        match part.as_rule() {
            Rule::free => Some(Value::Free(span(&part, self.offset))),
            _ => self.expression(part).map(Value::Expr),
        }
    }

    fn bounds(&mut self, pair: Pair<Rule>, span: Span) -> Option<Bounds> {
        let mut limits = pair.into_inner().filter(|p| p.as_rule() == Rule::expression);
        let lower = self.expression(limits.next()?)?;
        let upper = self.expression(limits.next()?)?;
        Some(Bounds { lower, upper, span })
    }

    /// Walks over the beginnings and ends of the rules in an expression, in the order of the text: nothing recurses.
    fn expression(&mut self, pair: Pair<Rule>) -> Option<ExprRef> {
        let mut starts = Vec::new();
        for token in pair.tokens() {
            match token {
                pest::Token::Start { rule, pos } => {
                    starts.push(pos.pos());
                    match rule {
                        Rule::expression => self.builder.begin(),
                        Rule::arguments => self.builder.begin_call(),
                        Rule::choice => self.builder.begin_choice(),
                        Rule::vector => self.builder.begin_vector(self.offset + pos.pos()),
                        _ => {}
                    }
                }
                pest::Token::End { rule, pos } => {
                    let start = starts.pop()?;
                    self.end(rule, start, pos.pos());
                }
            }
        }
        for sign in std::mem::take(&mut self.builder.chained) {
            let message = "a comparison of a comparison has no meaning";
            let hint = "join comparisons with `and`: `a < b and b < c`";
            self.findings.push(Diagnostic::new(Code::Unexpected, sign, message).hint(hint));
            self.sound = false;
        }
        self.builder.take()
    }

    /// A rule of an expression ends.
    fn end(&mut self, rule: Rule, start: usize, end: usize) {
        let text = &self.text[start..end];
        let span = Span::new(self.offset + start, self.offset + end);
        match rule {
            Rule::expression => self.builder.end(),
            Rule::number => {
                let value = self.number(text, span);
                self.builder.operand(Expr::Number(value), span);
            }
            Rule::reference => self.builder.operand(Expr::Name(text.into()), span),
            Rule::element => {
                let element = self.element(text, span);
                self.builder.operand(element, span);
            }
            Rule::sign => self.builder.sign(unary(text), span),
            Rule::infix => self.builder.infix(binary(text), span),
            Rule::group => self.builder.group(span),
            Rule::word_if => self.builder.word_if(span.start as usize),
            Rule::arguments | Rule::choice | Rule::vector => self.builder.end_frame(span.end as usize),
            _ => {}
        }
    }

    /// `x[2]`, `A[1, 2:3]`
    fn element(&mut self, text: &str, span: Span) -> Expr {
        let (name, index) = text.split_once('[').unwrap_or((text, "]"));
        let mut count = |digits: &str| {
            digits.trim().parse::<u32>().unwrap_or_else(|_| {
                let message = format!("the index {} is too large", super::expected::shown(digits.trim()));
                self.findings.push(Diagnostic::new(Code::BadNumber, span, message));
                self.sound = false;
                0
            })
        };
        let slices = index.trim_end_matches(']').split(',').map(|part| match part.split_once(':') {
            None => Slice::At(count(part)),
            Some((first, last)) if first.trim().is_empty() && last.trim().is_empty() => Slice::All,
            Some((first, last)) => Slice::Range(count(first), count(last)),
        });
        let slices = slices.collect();
        let start = span.start as usize;
        Expr::Element(Name { text: name.into(), span: Span::new(start, start + name.len()) }, slices)
    }

    fn number(&mut self, text: &str, span: Span) -> f64 {
        held(text).unwrap_or_else(|unheld| {
            let message = format!("the number `{}` {unheld}", super::expected::shown(text));
            self.findings.push(Diagnostic::new(Code::BadNumber, span, message).hint(unheld.hint()));
            self.sound = false;
            f64::NAN
        })
    }
}

/// One entry between the braces of a table.
struct Entry {
    key: ExprRef,
    free: Option<Span>,
    value: Option<ExprRef>,
}

/// The size in brackets behind a name; `[1]` is the unit of pure numbers.
fn shape(text: &Name) -> Option<Shape> {
    let size = |part: &str| {
        let digits = part.trim();
        let whole = !digits.is_empty() && digits.bytes().all(|b| b.is_ascii_digit());
        // what is too large for a number is too large for the limit of vectors, too
        whole.then(|| digits.parse().unwrap_or(u32::MAX))
    };
    if text.text.trim() == "1" {
        return None;
    }
    let mut sizes = text.text.split(',').map(size);
    let (rows, columns) = (sizes.next()??, sizes.next());
    let shape = Shape { rows, columns: columns.flatten(), span: text.span };
    (sizes.next().is_none() && columns.is_some() == shape.columns.is_some()).then_some(shape)
}

fn is_pair_of_numbers(text: &str) -> bool {
    text.split(',').count() == 2 && text.split(',').all(|part| part.trim().parse::<f64>().is_ok())
}

/// An attribute that a declaration has already.
fn repeated(rule: Rule, name: &str, second: Span, first: Span) -> Diagnostic {
    let what = match rule {
        Rule::doc => "a second doc string",
        Rule::unit => "a second unit",
        Rule::value => "a second value",
        Rule::bounds => "bounds twice",
        Rule::fixed => "`fixed` twice",
        Rule::by_log => "`log` twice",
        Rule::hold => "`held` or `linear` twice",
        Rule::per_group => "`per group` twice",
        Rule::wrap => "`wrap` twice",
        Rule::effect_class => "a second class",
        Rule::positive => "`positive` twice",
        _ => "`per run` twice",
    };
    Diagnostic::new(Code::WrongAttribute, second, format!("`{name}` has {what}"))
        .label(first, "the first is here")
        .hint("leave one of them out")
}

/// The period behind `wrap`.
fn wrap(pair: Pair<Rule>, span: Span) -> Option<Wrap> {
    let text = pair.into_inner().find(|p| p.as_rule() == Rule::period)?.as_str().to_string();
    let period = match text.split_once('*') {
        Some((times, _)) => times.trim().parse::<f64>().ok()? * std::f64::consts::PI,
        None => text.trim().parse().ok()?,
    };
    Some(Wrap { period, text, span })
}

fn unary(text: &str) -> UnarySign {
    match text {
        "-" => UnarySign::Minus,
        "+" => UnarySign::Plus,
        _ => UnarySign::Not,
    }
}

fn binary(text: &str) -> BinarySign {
    match text {
        "+" => BinarySign::Add,
        "-" => BinarySign::Subtract,
        "*" => BinarySign::Multiply,
        "/" => BinarySign::Divide,
        "^" => BinarySign::Power,
        "<" => BinarySign::Less,
        "<=" => BinarySign::LessEqual,
        ">" => BinarySign::Greater,
        ">=" => BinarySign::GreaterEqual,
        "==" => BinarySign::Equal,
        "!=" => BinarySign::NotEqual,
        "and" => BinarySign::And,
        _ => BinarySign::Or,
    }
}
