//! The text of the model, and the report beside it.

use crate::experiments::{Measured, Scale};
use crate::expression::Names;
use crate::expression::{Expr, Sign, binary, name, number};
use crate::records::Records;
use crate::tables::Problem;
use crate::translation::{Definition, Line, Param, State, Statements};
use fdm_grammar::{Code, Source, examine, format::format};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

/// What the text is made of.
pub(crate) struct Text<'a> {
    pub(crate) statements: &'a Statements,
    pub(crate) measured: &'a Measured,
    pub(crate) names: &'a Names,
    /// Name of the file that was read.
    pub(crate) stem: &'a str,
    /// The value of each run that says how long it waits before the experiment.
    pub(crate) horizon: Option<&'a str>,
    /// How the time of the experiment is written.
    pub(crate) time: &'a str,
}

/// A text that the language understands.
pub(crate) struct Written {
    pub(crate) text: String,
    /// Names that something needs.
    pub(crate) used: BTreeSet<String>,
    pub(crate) remarks: Vec<String>,
}

/// How reactions are written: as they stand; each with `0` for what is not modelled, where matter is not kept.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Balance {
    Closed,
    Open,
}

impl Text<'_> {
    /// The model.
    ///
    /// # Errors
    /// What the language does not understand of it.
    pub(crate) fn model(&self) -> Result<Written, Vec<String>> {
        let used = self.used()?;
        let mut remarks = Vec::new();
        let mut text = self.composed(&used, Balance::Closed);
        let mut checked = examine(&Source::new("model.fdm", text.clone()));
        if checked.as_ref().is_err_and(|all| all.iter().any(|d| d.code == Code::BadReaction)) {
            remarks.push(
                "the reactions do not keep masses: `0` stands for what takes part and is not modelled".to_string(),
            );
            text = self.composed(&used, Balance::Open);
            checked = examine(&Source::new("model.fdm", text.clone()));
        }
        let source = Source::new("model.fdm", text.clone());
        match checked {
            Ok(_) => Ok(Written { text: format(&source).unwrap_or(text), used, remarks }),
            Err(all) => {
                let told = all.iter().filter(|d| d.is_error()).take(20).map(|d| {
                    let at = source.position(d.span.start);
                    let line = source.line(at.line).trim();
                    let line: String = line.chars().take(160).collect();
                    format!("the model that was written is not understood: {}: {} ({line})", d.code.text(), d.message)
                });
                Err(told.collect())
            }
        }
    }

    /// Every name that equations, outputs and noises need, and what those need.
    fn used(&self) -> Result<BTreeSet<String>, Vec<String>> {
        let statements = self.statements;
        let by_name: BTreeMap<&str, &Definition> =
            statements.definitions.iter().map(|(n, d)| (n.as_str(), d)).collect();
        let mut all: BTreeSet<&str> = statements.channels.iter().map(|c| c.name.as_str()).collect();
        all.extend(by_name.keys());
        all.extend(statements.switches.iter().map(|s| s.name.as_str()));
        all.extend(statements.states.iter().map(|s| s.id.as_str()));
        all.extend(self.measured.outputs.iter().flat_map(|o| o.columns.iter().map(String::as_str)));
        let mut open: Vec<(&str, &str)> = Vec::new();
        let mut timed = false;
        let mut ask = |e: &'_ Expr| timed |= e.has_time();
        let mut roots: Vec<(&str, &Expr)> = Vec::new();
        for state in &statements.states {
            roots.push((&state.id, &state.initial));
            roots.extend(state.rate.as_ref().map(|r| (state.id.as_str(), r)));
        }
        roots.extend(
            self.measured.outputs.iter().flat_map(|o| [(o.name.as_str(), &o.formula), (o.name.as_str(), &o.noise)]),
        );
        for (condition, sets) in &statements.events {
            roots.push(("when", condition));
            roots.extend(sets.iter().map(|(id, e)| (id.as_str(), e)));
        }
        for line in &statements.lines {
            roots.push(("reactions", &line.rate));
            open.extend(line.left.iter().chain(&line.right).map(|(n, _)| (n.as_str(), "reactions")));
        }
        for (of, e) in &roots {
            ask(e);
            open.extend(e.names().into_iter().map(|n| (n, *of)));
        }
        let (mut used, mut missing) = (BTreeSet::new(), BTreeMap::new());
        open.extend(statements.shown.iter().map(|id| (id.as_str(), "output")));
        // what is read alone is changed by hand: everything stays that can
        let alone = self.measured.outputs.is_empty();
        let mut spare = by_name.keys().filter(|_| alone);
        let mut first = true;
        loop {
            let (mut found, mut lacks) = (BTreeSet::new(), BTreeMap::new());
            while let Some((id, of)) = open.pop() {
                if !all.contains(id) {
                    lacks.entry(id.to_string()).or_insert(of.to_string());
                    continue;
                }
                if used.contains(id) || !found.insert(id.to_string()) {
                    continue;
                }
                if let Some(Definition::Let(e)) = by_name.get(id) {
                    ask(e);
                    open.extend(e.names().into_iter().map(|n| (n, id)));
                }
            }
            if first || lacks.is_empty() {
                used.append(&mut found);
            }
            if first {
                missing = lacks;
            }
            first = false;
            match spare.next() {
                Some(id) => open.push((id, id)),
                None => break,
            }
        }
        if let (Some(horizon), true) = (self.horizon, timed) {
            used.insert(horizon.into());
        }
        let told = |(id, of): (&String, &String)| format!("`{id}`, which `{of}` needs, has no value");
        if missing.is_empty() { Ok(used) } else { Err(missing.iter().map(told).collect()) }
    }

    /// A number in the names of the model.
    fn show(&self, e: &Expr) -> String {
        self.written(e.clone().into_number())
    }

    /// An expression in the names of the model.
    fn written(&self, e: Expr) -> String {
        let renamed = self.names.renamed.iter().map(|(id, own)| (id.clone(), name(own))).collect();
        let follows = |id: &str| {
            self.statements.states.iter().any(|s| s.id == id)
                || self.statements.definitions.iter().any(|(own, d)| own == id && matches!(d, Definition::Let(_)))
        };
        // a derivative of what does not change
        let moving = e.map(&mut |part| match &part {
            Expr::Call("der", list) if matches!(&list[..], [Expr::Name(id)] if !follows(id)) => Expr::Number(0.0),
            _ => part,
        });
        moving.with(&renamed).text(self.time)
    }

    fn called<'b>(&'b self, id: &'b str) -> &'b str {
        self.names.called(id)
    }

    fn composed(&self, used: &BTreeSet<String>, balance: Balance) -> String {
        let statements = self.statements;
        let mut out = String::new();
        let plain: String = self.stem.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
        let begins =
            plain.starts_with(|c: char| c.is_ascii_alphabetic()) && fdm_grammar::check::reserved(&plain).is_none();
        let own = if begins { plain } else { format!("model_{plain}") };
        let _ = writeln!(out, "model {own} {}{{", doc(&statements.title));
        for channel in statements.channels.iter().filter(|c| used.contains(&c.name)) {
            let (role, tail) = if channel.is_input() { ("input", "") } else { ("known", " per run") };
            let _ = writeln!(out, "  {role} {}{tail} {};", self.called(&channel.name), doc(&channel.about));
        }
        for switch in statements.switches.iter().filter(|s| used.contains(&s.name)) {
            let _ = writeln!(out, "  input {} {};", switch.name, doc(&switch.about));
        }
        for (output, column) in self.measured.outputs.iter().flat_map(|o| o.columns.iter().map(move |c| (o, c))) {
            if used.contains(column) {
                let _ = writeln!(
                    out,
                    "  input {column} {};",
                    doc(&format!("given with each measurement of {}", output.observable))
                );
            }
        }
        if let Some(horizon) = self.horizon.filter(|h| used.contains(*h)) {
            let _ = writeln!(out, "  known {horizon} per run \"how long the run before the experiment is\";");
            let _ = writeln!(out, "  let {} = max(t - {horizon}, 0);", self.time);
        }
        let wanted = || statements.definitions.iter().filter(|(id, _)| used.contains(id));
        for (id, definition) in wanted() {
            if let Definition::Number(v) = definition {
                let _ = writeln!(out, "  const {} = {}{};", self.called(id), number(*v), self.title(id));
            }
        }
        for (id, definition) in wanted() {
            if let Definition::Param(param) = definition {
                self.param(&mut out, self.called(id), param);
            }
        }
        for (id, definition) in wanted() {
            if let Definition::Let(e) = definition {
                let _ = writeln!(out, "  let {} = {};", self.called(id), self.show(e));
            }
        }
        out.push('\n');
        for state in &statements.states {
            let title = state.title.as_ref().map(|t| format!(" {}", doc(t).trim_end())).unwrap_or_default();
            let initial = if state.initial == Expr::Number(0.0) {
                String::new()
            } else {
                format!(" = {}", self.show(&state.initial))
            };
            let _ = writeln!(out, "  state {}{title}{initial};", self.called(&state.id));
        }
        if !statements.lines.is_empty() {
            out.push_str("  reactions {\n");
            for line in &statements.lines {
                self.line(&mut out, line, balance);
            }
            out.push_str("  }\n");
        }
        for state in &statements.states {
            self.equation(&mut out, state);
        }
        for (condition, sets) in &statements.events {
            let each = sets.iter().map(|(id, e)| format!("{} = {};", self.called(id), self.show(e)));
            let _ = writeln!(
                out,
                "  when {} {{ {} }}",
                self.written(condition.clone().into_condition()),
                each.collect::<Vec<_>>().join(" ")
            );
        }
        out.push('\n');
        self.outputs(&mut out);
        out.push_str("}\n");
        out
    }

    fn title(&self, id: &str) -> String {
        self.statements.titles.get(id).map(|t| format!(" {}", doc(t).trim_end())).unwrap_or_default()
    }

    fn param(&self, out: &mut String, own: &str, param: &Param) {
        let title = param.title.as_ref().map(|t| format!(" {}", doc(t).trim_end())).unwrap_or_default();
        let Some((lower, upper)) = param.bounds else {
            let _ = writeln!(out, "  param {own} = {} fixed{title};", number(param.value));
            return;
        };
        let function = param.scale.function();
        match (param.prior, function) {
            // the prior is normal on the scale, and so is what is estimated
            (Some((mean, deviation)), Some(function)) => {
                let scaled = format!("{function}_{own}");
                let [value, lower, upper] = [param.value, lower, upper].map(|v| number(param.scale.of(v)));
                let back = if param.scale == Scale::Log10 { format!("10^{scaled}") } else { format!("exp({scaled})") };
                let _ = writeln!(out, "  param {scaled} = {value} in [{lower}, {upper}];");
                let _ = writeln!(out, "  prior {scaled} ~ normal({}, {});", number(mean), number(deviation));
                let _ = writeln!(out, "  param {own} = {back}{title};");
            }
            (prior, _) => {
                let log = if param.scale == Scale::Linear { "" } else { " log" };
                let _ = writeln!(
                    out,
                    "  param {own} = {} in [{}, {}]{log}{title};",
                    number(param.value),
                    number(lower),
                    number(upper)
                );
                if let Some((mean, deviation)) = prior {
                    let _ = writeln!(out, "  prior {own} ~ normal({}, {});", number(mean), number(deviation));
                }
            }
        }
    }

    fn line(&self, out: &mut String, line: &Line, balance: Balance) {
        let side = |list: &[(String, f64)], open: bool| {
            let zero = (list.is_empty() || open).then(|| "0".to_string());
            let each = list.iter().map(|(id, n)| match n {
                1.0 => self.called(id).to_string(),
                n => format!("{}*{}", number(*n), self.called(id)),
            });
            zero.into_iter().chain(each).collect::<Vec<_>>().join(" + ")
        };
        let closed = !line.left.is_empty() && !line.right.is_empty();
        let (left, right) = (side(&line.left, closed && balance == Balance::Open), side(&line.right, false));
        let _ = writeln!(out, "    {left} -> {right} : {};", self.show(&line.rate));
    }

    fn equation(&self, out: &mut String, state: &State) {
        let id = self.called(&state.id);
        let Some(rate) = &state.rate else { return };
        if !state.reacts {
            let _ = writeln!(out, "  der({id}) = {};", self.show(rate));
            return;
        }
        let whole = binary(Sign::Add, Expr::Call("reaction", vec![name(&state.id)]), rate.clone());
        let _ = writeln!(out, "  der({id}) = {};", self.show(&whole));
    }

    fn outputs(&self, out: &mut String) {
        for output in &self.measured.outputs {
            let title = output.title.as_ref().filter(|t| **t != output.observable);
            let title = title.map(|t| format!(" {}", doc(t).trim_end())).unwrap_or_default();
            let _ = writeln!(out, "  output {}{title} = {};", output.name, self.show(&output.formula));
        }
        for output in &self.measured.outputs {
            let _ = writeln!(out, "  noise {} = {};", output.name, self.show(&output.noise));
        }
        if self.measured.outputs.is_empty() {
            let mut names = Names::default();
            let all = self.statements.states.iter().map(|s| &s.id);
            let all = all.chain(self.statements.definitions.iter().map(|(id, _)| id));
            all.for_each(|id| names.keep(self.called(id)));
            for id in self.statements.shown.iter().map(|id| self.called(id)) {
                let _ = writeln!(out, "  output {} = {id};", names.fresh(&format!("{id}_m")));
            }
        }
    }

    /// What was read, renamed and left out.
    pub(crate) fn report(&self, problem: Option<&Problem>, written: &Written, records: &Records<'_>) -> String {
        let mut out = String::new();
        let _ = writeln!(out, "# {}\n", self.stem);
        let (measured, statements) = (self.measured, self.statements);
        let _ = writeln!(out, "Made by `fdm import`. Here `fdm fit` takes model, runs and options from `fdm.toml`.\n");
        out.push_str("| what | number |\n|---|---|\n");
        let rows = [
            ("states", statements.states.len()),
            ("experiments", measured.experiments.len()),
            ("outputs", measured.outputs.len()),
            ("measured numbers", measured.measurements.len()),
        ];
        rows.iter().for_each(|(what, n)| {
            let _ = writeln!(out, "| {what} | {n} |");
        });
        out.push('\n');
        if measured.outputs.iter().any(|o| o.scale != Scale::Linear) {
            let _ = writeln!(
                out,
                "Outputs of observables with `observableTransformation` are logarithms, and so are their columns. Add {} to the log-likelihood that `fdm fit` prints for that of PEtab.\n",
                number(measured.constant)
            );
        }
        if let Some(lead) = records.lead {
            let _ = writeln!(
                out,
                "Experiments after a pre-equilibration begin with a run of {} units of time under the conditions before; time 0 is where the experiment begins.\n",
                number(lead)
            );
        }
        if measured.measurements.iter().any(|m| m.time.is_infinite()) {
            out.push_str("Numbers that were measured in the steady state stand at the last time of their record, which is late.\n\n");
        }
        if !self.names.renamed.is_empty() {
            out.push_str("## Renamed\n\n| in the problem | in the model |\n|---|---|\n");
            self.names.renamed.iter().for_each(|(id, own)| {
                let _ = writeln!(out, "| `{id}` | `{own}` |");
            });
            out.push('\n');
        }
        let mut left: Vec<String> = statements.remarks.iter().chain(&written.remarks).cloned().collect();
        let unused = statements
            .definitions
            .iter()
            .filter(|(id, d)| matches!(d, Definition::Param(_)) && !written.used.contains(id));
        left.extend(unused.map(|(id, _)| format!("parameter `{id}`: nothing that was measured depends on it")));
        if problem.is_some_and(|p| p.parameters.iter().any(|r| r.get("initializationPriorType").is_some())) {
            left.push("initializationPriorType: random starts are drawn within the bounds".into());
        }
        if !left.is_empty() {
            out.push_str("## Left out, and to be known\n\n");
            left.iter().for_each(|l| {
                let _ = writeln!(out, "* {l}");
            });
        }
        out
    }
}

/// A doc string with a space behind it; nothing where there is nothing to say.
fn doc(text: &str) -> String {
    let plain: String = text
        .chars()
        .map(|c| {
            if c == '"' {
                '\''
            } else if c.is_control() {
                ' '
            } else {
                c
            }
        })
        .collect();
    if plain.trim().is_empty() { String::new() } else { format!("\"{}\" ", plain.trim()) }
}
