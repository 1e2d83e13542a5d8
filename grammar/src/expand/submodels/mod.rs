//! `use "file" as name(x = ...);`: the other model's statements in the place of the `use`, its names behind `name.`
//!
//! **In** a tree with `use`, and the texts of a source. **Out** one without. A file is read, expanded and checked by itself
//! once, however often it is used, so that its mistakes are told once and in its own words. **Never** reads files.
//! **Start** at [`Submodels::inline`].

mod part;

use super::Budget;
use super::{files, library, tables};
use crate::diagnostic::{Code, Diagnostic};
use crate::expand::reactions::reactions;
use crate::source::{Source, Span};
use crate::syntax::{Expr, Name, Role, StatementKind, SyntaxTree, Use, parse_used};
use crate::unit::Unit;
use part::Connections;
use part::Part;
use std::collections::HashMap;
use std::rc::Rc;

/// Files that use each other, one inside the other.
pub const MOST_LEVELS: usize = 16;

/// What a model by itself has to say about its mistakes.
pub(super) type Judge<'a> = dyn Fn(&SyntaxTree) -> Vec<Diagnostic> + 'a;

/// The files that are used, each read once.
pub(super) struct Submodels<'a> {
    source: &'a Source,
    judge: &'a Judge<'a>,
    /// By the place of the text in the source; `None` when its mistakes have been told.
    known: HashMap<usize, Option<Rc<Part>>>,
    /// The texts that are being read, the model's own first.
    open: Vec<usize>,
    findings: Vec<Diagnostic>,
}

impl<'a> Submodels<'a> {
    pub(super) fn new(source: &'a Source, judge: &'a Judge<'a>) -> Self {
        Self { source, judge, known: HashMap::new(), open: vec![0], findings: Vec::new() }
    }

    /// What was wrong.
    pub(super) fn finish(self) -> Vec<Diagnostic> {
        self.findings
    }

    /// Writes the statements of all submodels into a tree.
    pub(super) fn inline(&mut self, tree: SyntaxTree, budget: &mut Budget) -> SyntaxTree {
        if !tree.statements.iter().any(|s| matches!(s.kind, StatementKind::Use(_))) {
            return tree;
        }
        let mut names = Taken::new(&tree);
        let time = time_of(&tree);
        let SyntaxTree { name, doc, statements, expressions, suspended } = tree;
        let mut whole = SyntaxTree { name, doc, statements: Vec::new(), expressions, suspended };
        for statement in statements {
            let StatementKind::Use(submodel) = &statement.kind else {
                whole.statements.push(statement);
                continue;
            };
            if !self.is_free(&mut names, &submodel.alias) {
                whole.suspended.push(submodel.alias.text.clone());
                continue;
            }
            let part = self.part(submodel, budget);
            let written = part.is_some_and(|part| {
                self.same_time(submodel, &part, time.as_ref())
                    && self.write(submodel, &part, &mut names, &mut whole, budget)
            });
            if !written {
                whole.suspended.push(submodel.alias.text.clone());
            }
        }
        whole.suspended.sort_unstable();
        whole.suspended.dedup();
        self.bare_aliases(&mut whole, &names);
        whole
    }

    fn tell(&mut self, code: Code, span: Span, message: String, hint: impl Into<String>) {
        self.findings.push(Diagnostic::new(code, span, message).hint(hint));
    }

    /// Whether nothing else has the name.
    fn is_free(&mut self, names: &mut Taken, alias: &Name) -> bool {
        let Some((_, first)) = names.declared.get(&alias.text).copied() else {
            names.aliases.insert(alias.text.clone(), alias.span);
            names.declared.insert(alias.text.clone(), (None, alias.span));
            return true;
        };
        let message = format!("`{}` is declared a second time", alias.text);
        let finding = Diagnostic::new(Code::DeclaredTwice, alias.span, message).label(first, "first declared here");
        self.findings.push(finding.hint("choose another name behind `as`"));
        false
    }

    /// The model of the file.
    fn part(&mut self, submodel: &Use, budget: &mut Budget) -> Option<Rc<Part>> {
        let span = submodel.path.span;
        let from = self.source.text_at(span.start).name();
        let name = files::name_of(from, &submodel.path);
        if files::is_unit(&name) != submodel.foreign {
            let (message, hint) = match submodel.foreign {
                false => (
                    format!("`{name}` is a functional mock-up unit, which runs code of its own"),
                    format!("write `use fmu \"{}\" as {}`", submodel.path.text, submodel.alias.text),
                ),
                true => (
                    format!("`{name}` is no functional mock-up unit: their names end in `.fmu`"),
                    format!(
                        "write `use \"{}\" as {}`, if it is the text of a model",
                        submodel.path.text, submodel.alias.text
                    ),
                ),
            };
            self.tell(Code::NoFile, span, message, hint);
            return None;
        }
        let Some(text) = files::find(self.source, &name) else {
            let missing = self.source.missing().iter().find(|m| m.name == name);
            let reason = missing.map_or("no files are read here", |m| m.reason.as_str());
            let message = format!("the submodel `{name}` cannot be read: {reason}");
            let relative = || "paths are relative to the file that says `use`".to_string();
            let hint = if library::is_named(&name) { library::hint() } else { relative() };
            self.tell(Code::NoFile, span, message, hint);
            return None;
        };
        if let Some(known) = self.known.get(&text) {
            return known.clone();
        }
        if let Some(at) = self.open.iter().position(|k| *k == text) {
            let chain = self.open[at..].iter().chain([&text]).map(|k| self.source.texts()[*k].name());
            let message = format!("files use each other in a circle: {}", chain.collect::<Vec<_>>().join(" -> "));
            self.tell(Code::Cycle, span, message, "a model cannot be a part of itself");
            return None;
        }
        if self.open.len() > MOST_LEVELS {
            let message = format!("files use each other more than {MOST_LEVELS} levels deep, which is the limit");
            self.tell(Code::TooDeep, span, message, "use the innermost files from fewer levels");
            self.known.insert(text, None);
            return None;
        }
        self.open.push(text);
        let part = self.read(text, budget).map(Rc::new);
        self.open.pop();
        self.known.insert(text, part.clone());
        part
    }

    /// Reads a file, with the files that it uses itself, and checks it.
    fn read(&mut self, text: usize, budget: &mut Budget) -> Option<Part> {
        let (tree, mut findings) = parse_used(&self.source.texts()[text]);
        let tree = tree.map(|mut tree| {
            reactions(&mut tree, &mut findings);
            tables::read(self.source, &mut tree, &mut findings);
            tree
        });
        let told = self.findings.len();
        self.findings.extend(findings);
        let tree = self.inline(tree?, budget);
        if self.findings.len() == told {
            // what is measured of a part is for the whole to say
            let mistakes = (self.judge)(&tree).into_iter().filter(|f| f.is_error() && f.code != Code::NoOutput);
            self.findings.extend(mistakes);
        }
        (self.findings.len() == told).then(|| Part::new(tree))
    }

    /// A part that knows time must count it as the whole does.
    fn same_time(&mut self, submodel: &Use, part: &Part, whole: Option<&Name>) -> bool {
        let unit = |name: Option<&Name>| name.map_or(Some(Unit::second()), |n| Unit::parse(&n.text).ok());
        let of_part = time_of(&part.tree);
        let (Some(own), Some(outer)) = (unit(of_part.as_ref()), unit(whole)) else { return true };
        if own.same_size(&outer) || !part.moves() {
            return true;
        }
        let message = format!("the submodel `{}` counts time in {own}, this model in {outer}", submodel.alias.text);
        let finding = Diagnostic::new(Code::UnitMismatch, submodel.path.span, message);
        let finding = of_part.iter().fold(finding, |f, unit| f.label(unit.span, "the time of the submodel"));
        self.findings.push(finding.hint(format!("write `time [{own}];` here, or the submodel in {outer}")));
        false
    }

    /// Writes the statements of a part behind those of the whole.
    fn write(
        &mut self,
        submodel: &Use,
        part: &Part,
        names: &mut Taken,
        whole: &mut SyntaxTree,
        budget: &mut Budget,
    ) -> bool {
        let (nodes, bytes) = part.size(&submodel.alias.text);
        if !budget.spend(nodes, bytes) {
            self.findings.extend(budget.finding(submodel.path.span));
            return false;
        }
        let connections = Connections::read(submodel, part, &mut self.findings);
        let consts = |name: &str| matches!(names.declared.get(name), Some((Some(Role::Const), _)));
        part.write(&submodel.alias.text, &connections, &consts, whole);
        for (name, role) in part.consts() {
            names.declared.insert(format!("{}.{name}", submodel.alias.text), (Some(role), submodel.alias.span));
        }
        true
    }

    /// Tells where the name of a submodel stands for itself.
    fn bare_aliases(&mut self, tree: &mut SyntaxTree, names: &Taken) {
        for (expr, span) in &mut tree.expressions {
            let Expr::Name(name) = expr else { continue };
            if names.aliases.contains_key(name) {
                let message = format!("`{name}` is a submodel, not a quantity");
                let finding = Diagnostic::new(Code::WrongName, *span, message);
                self.findings.push(finding.hint(format!("its names are `{name}.x`")));
                *expr = super::broken();
            }
        }
    }
}

/// The names of a model and where they are declared.
struct Taken {
    declared: HashMap<String, (Option<Role>, Span)>,
    aliases: HashMap<String, Span>,
}

impl Taken {
    fn new(tree: &SyntaxTree) -> Self {
        let mut declared = HashMap::new();
        for statement in &tree.statements {
            match &statement.kind {
                StatementKind::Declare(role, list) => {
                    declared.extend(list.iter().map(|d| (d.name.text.clone(), (Some(*role), d.name.span))));
                }
                StatementKind::Table(table) => {
                    declared.insert(table.name.text.clone(), (None, table.name.span));
                }
                _ => {}
            }
        }
        Self { declared, aliases: HashMap::new() }
    }
}

fn time_of(tree: &SyntaxTree) -> Option<Name> {
    tree.statements.iter().find_map(|s| if let StatementKind::Time(unit) = &s.kind { Some(unit.clone()) } else { None })
}
