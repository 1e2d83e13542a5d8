//! The search for the columns of a file that hold a model's channels, and for the conversion of their units.

use super::channel::{Channel, Channels, Demand, Plan, Role, Source};
use super::error::{Fault, Names, Problem, excerpt};
use super::note::Note;
use super::options::ReadOptions;
use super::table::{Heading, Table};
use fdm_grammar::Unit;
use fdm_grammar::diagnostic::nearest;

/// Finds the columns of all channels.
///
/// A column is taken whose title or name (title without unit) is the channel's name or what `--map` says; failing
/// that, the only one that differs in upper and lower case alone. The time is in the column `t`, else `time` in any
/// case, else `T`. `--map channel=name [unit]` also gives the unit of a column that has none; `--map channel=log(name [unit])`
/// reads the natural logarithm of the column's numbers in that unit. `demands` are those on the outputs.
pub(crate) fn plan(
    table: &Table,
    channels: &Channels,
    options: &ReadOptions,
    demands: &[Demand],
    notes: &mut Vec<Note>,
) -> Result<Plan, Vec<Problem>> {
    let mut search = Search { table, channels, options, notes, problems: Vec::new() };
    search.check_map();
    let strict = search.is_time_wanted();
    let time = if strict { search.time() } else { search.optional_time() };
    let inputs: Vec<_> = channels.inputs.iter().map(|c| search.channel(Role::Input, c, Demand::Needed)).collect();
    let outputs = channels.outputs.iter().zip(demands);
    let outputs: Vec<_> = outputs.map(|(c, demand)| search.channel(Role::Output, c, *demand)).collect();
    let problems = search.problems;
    if problems.is_empty() {
        Ok(Plan { time, strict, inputs: inputs.into_iter().flatten().collect(), outputs })
    } else {
        Err(problems)
    }
}

struct Search<'a> {
    table: &'a Table,
    channels: &'a Channels,
    options: &'a ReadOptions,
    notes: &'a mut Vec<Note>,
    problems: Vec<Problem>,
}

/// A column, and what `--map` says of it.
struct Found {
    column: usize,
    unit: Option<String>,
    /// Whether its logarithm is meant; then `unit` is the one that the logarithm is taken in.
    logarithm: bool,
}

impl Found {
    fn plain(column: usize) -> Self {
        Self { column, unit: None, logarithm: false }
    }
}

impl Search<'_> {
    /// Every `--map` names a channel of the model, once.
    fn check_map(&mut self) {
        let channels = self.channels;
        for (k, (channel, _)) in self.options.map.iter().enumerate() {
            let time = self.channels.means_time(channel);
            if !time && !channels.names().any(|n| n == channel) {
                let hint = nearest(channel, channels.names()).map(|n| format!("did you mean `{n}`?"));
                let known = Names::new(std::iter::once("t").chain(channels.names()));
                let fault = Fault::UnknownChannel { option: "--map", channel: channel.clone(), channels: known };
                self.problems.push(fault.anywhere().maybe_hint(hint));
            }
            let same = |other: &str| other == channel || (time && self.channels.means_time(other));
            if self.options.map[..k].iter().any(|(other, _)| same(other)) {
                self.problems.push(Fault::MappedTwice(channel.clone()).anywhere());
            }
        }
    }

    fn mapped(&self, is_channel: impl Fn(&str) -> bool) -> Option<(&str, &str)> {
        self.options.map.iter().find(|(c, _)| is_channel(c)).map(|(c, column)| (c.as_str(), column.as_str()))
    }

    /// Whether the model or an option hangs on the time.
    fn is_time_wanted(&self) -> bool {
        let window = self.options.from.is_some() || self.options.to.is_some();
        self.channels.timed || window || self.mapped(|c| self.channels.means_time(c)).is_some()
    }

    /// The time column that a model may do without, as long as nothing about it is in doubt.
    fn optional_time(&self) -> Option<Source> {
        let column = self.time_column().ok().flatten()?;
        let unit = self.table.columns[column].unit.clone();
        let own = unit.as_deref().and_then(|u| Unit::parse(u).ok());
        let (scale, offset) = own.map_or(Some((1.0, 0.0)), |own| own.conversion(&self.channels.time))?;
        Some(Source { column, unit, scale, offset, logarithm: false, clock: false })
    }

    fn time(&mut self) -> Option<Source> {
        let mapped = self.mapped(|c| self.channels.means_time(c)).map(|(c, t)| (c.to_string(), t.to_string()));
        let found = match mapped {
            Some((channel, column)) => self.mapped_column(&channel, &column)?,
            None => match self.time_column() {
                Ok(Some(column)) => Found::plain(column),
                Ok(None) if !self.channels.timed => return None,
                Ok(None) => {
                    self.missing_time();
                    return None;
                }
                Err(problem) => {
                    self.problems.push(problem);
                    return None;
                }
            },
        };
        let channel = Channel::new("t", Some(self.channels.time.clone()));
        if self.table.is_clock(found.column) {
            let column = self.table.columns[found.column].title.clone();
            self.notes.push(Note::Clock { column });
            let seconds = Found { unit: Some("s".into()), ..found };
            return self.source(Role::Time, &channel, seconds).map(|source| Source { clock: true, ..source });
        }
        self.source(Role::Time, &channel, found)
    }

    /// The column that holds the time by its name.
    fn time_column(&self) -> Result<Option<usize>, Problem> {
        let of_channel = |name: &str| self.channels.all().any(|(_, c)| c.name == name);
        let mapped = |h: &Heading| self.options.map.iter().any(|(_, c)| *c == h.title || *c == h.name);
        let is_time =
            |h: &Heading| h.unit.as_deref().is_none_or(|u| self.is_time_unit(u)) && !of_channel(&h.name) && !mapped(h);
        let named = |wanted: &dyn Fn(&str) -> bool| self.unique(|h| wanted(&h.name) && is_time(h));
        for wanted in
            [&(|n: &str| n == "t") as &dyn Fn(&str) -> bool, &|n| n.eq_ignore_ascii_case("time"), &|n| n == "T"]
        {
            if let Some(column) = named(wanted)? {
                return Ok(Some(column));
            }
        }
        // dates and clock times can be nothing else
        let mut clocks = (0..self.table.columns.len()).filter(|k| self.table.is_clock(*k));
        Ok(match (clocks.next(), clocks.next()) {
            (Some(column), None) => Some(column).filter(|k| !mapped(&self.table.columns[*k])),
            _ => None,
        })
    }

    fn is_time_unit(&self, unit: &str) -> bool {
        Unit::parse(unit).is_ok_and(|u| u.conversion(&self.channels.time).is_some())
    }

    fn missing_time(&mut self) {
        let columns = self.table.titles();
        let like = |h: &&Heading| {
            let lower = h.name.to_lowercase();
            let named = ["t_", "t.", "time", "zeit", "temps"].into_iter().any(|p| lower.starts_with(p));
            named || h.unit.as_deref().is_some_and(|u| self.is_time_unit(u))
        };
        let likely = self.table.columns.iter().find(like).map(|h| excerpt(&h.title));
        let hint = match likely {
            Some(title) => format!("if `{title}` holds the time, say --map \"t={title}\""),
            None => "name the column `t` or `time`, or say --map t=COLUMN".into(),
        };
        let fault = Fault::Missing { role: Role::Time, channel: "t".into(), columns };
        self.problems.push(fault.anywhere().hint(hint));
    }

    fn channel(&mut self, role: Role, channel: &Channel, demand: Demand) -> Option<Source> {
        if demand == Demand::LeftOut {
            return None;
        }
        let mapped = self.mapped(|c| c == channel.name).map(|(_, column)| column.to_string());
        let found = match mapped {
            Some(column) => self.mapped_column(&channel.name, &column)?,
            None => match self.column(&channel.name) {
                Ok(Some(column)) => Found::plain(column),
                Ok(None) => {
                    let misspelt = || self.like(&channel.name, &|h| !self.is_taken(h));
                    match demand {
                        Demand::Needed => self.missing(role, channel),
                        Demand::IfMeasured => match misspelt() {
                            Some(title) => self.misspelt(channel, &title),
                            None => self.notes.push(Note::NotMeasured { output: channel.name.clone() }),
                        },
                        _ => self.notes.push(Note::NotMeasured { output: channel.name.clone() }),
                    }
                    return None;
                }
                Err(problem) => {
                    self.problems.push(problem);
                    return None;
                }
            },
        };
        self.source(role, channel, found)
    }

    /// Whether a column is the time, another channel, or what an option names.
    fn is_taken(&self, heading: &Heading) -> bool {
        let named = |name: &str| heading.name.eq_ignore_ascii_case(name) || heading.title.eq_ignore_ascii_case(name);
        let mapped = |text: &str| named(text) || named(&Heading::new(text).name);
        let time = self.time_column().ok().flatten().is_some_and(|k| self.table.columns[k].title == heading.title);
        time || self.channels.names().any(named) || self.options.map.iter().any(|(_, text)| mapped(text))
    }

    /// Other runs measure an output, and this one has a column that looks like it.
    fn misspelt(&mut self, channel: &Channel, title: &str) {
        let name = &channel.name;
        let hint = format!(
            "if it is meant, say --map \"{name}={title}\"; if `{name}` was not measured in this run, add an empty column `{name}`, \
             or leave it out of all runs with --without-output {name}"
        );
        let fault = Fault::Misspelt { output: name.clone(), column: title.into() };
        self.problems.push(fault.anywhere().hint(hint));
    }

    /// The column of that title or name.
    fn column(&self, name: &str) -> Result<Option<usize>, Problem> {
        let taken =
            |h: &Heading| self.channels.all().any(|(_, c)| c.name != name && (c.name == h.name || c.name == h.title));
        if let Some(column) = self.unique(|h| h.title == name)? {
            return Ok(Some(column));
        }
        if let Some(column) = self.unique(|h| h.name == name)? {
            return Ok(Some(column));
        }
        if let Some(column) = self.unique(|h| is_pure(&h.name, name))? {
            return Ok(Some(column));
        }
        let lower = name.to_lowercase();
        self.unique(|h| (h.name.to_lowercase() == lower || h.title.to_lowercase() == lower) && !taken(h))
    }

    /// The column that a `--map` names, and the unit that it gives.
    fn mapped_column(&mut self, channel: &str, text: &str) -> Option<Found> {
        let as_typed = self.column(text.trim());
        let inside = text.trim().strip_prefix("log(").and_then(|t| t.strip_suffix(')'));
        let inside = inside.filter(|_| matches!(as_typed, Ok(None)));
        if let Some(inside) = inside {
            return self.logarithmic_column(channel, inside);
        }
        let given = Heading::new(text);
        let found = match (as_typed, given.unit) {
            (Ok(None), Some(unit)) => {
                let named = self.column(&given.name);
                named.map(|c| c.map(|column| Found { unit: Some(unit), ..Found::plain(column) }))
            }
            (other, _) => other.map(|c| c.map(Found::plain)),
        };
        self.named_column(channel, text, &given.name, found)
    }

    /// The column whose logarithm a `--map` wants: brackets say the unit that it is taken in.
    fn logarithmic_column(&mut self, channel: &str, text: &str) -> Option<Found> {
        let given = Heading::new(text);
        let of = |unit: Option<String>| move |column| Found { column, unit, logarithm: true };
        let found = match (self.column(&given.name), self.column(text.trim())) {
            (Ok(None), whole) => whole.map(|c| c.map(of(None))),
            (named, _) => named.map(|c| c.map(of(given.unit))),
        };
        self.named_column(channel, text, &given.name, found)
    }

    /// What was found for a `--map`, or what is wrong with it.
    fn named_column(
        &mut self,
        channel: &str,
        text: &str,
        name: &str,
        found: Result<Option<Found>, Problem>,
    ) -> Option<Found> {
        match found {
            Ok(Some(found)) => return Some(found),
            Ok(None) => {
                let columns = self.table.titles();
                let hint = self.like(name, &|_| true).map(|title| format!("did you mean `{title}`?"));
                let fault = Fault::UnknownColumn { channel: channel.into(), column: excerpt(text), columns };
                self.problems.push(fault.anywhere().maybe_hint(hint));
            }
            Err(problem) => self.problems.push(problem),
        }
        None
    }

    /// The only column of a kind.
    fn unique(&self, wanted: impl Fn(&Heading) -> bool) -> Result<Option<usize>, Problem> {
        let mut found = self.table.columns.iter().enumerate().filter(|(_, h)| !h.title.is_empty() && wanted(h));
        let first = found.next();
        let count = 1 + found.count();
        match first {
            Some((_, h)) if count > 1 => {
                let problem = self.table.in_header(Fault::Ambiguous { name: excerpt(&h.name), count });
                Err(problem
                    .hint("rename the columns, or say --map CHANNEL=TITLE with a title that only one of them has"))
            }
            first => Ok(first.map(|(column, _)| column)),
        }
    }

    fn missing(&mut self, role: Role, channel: &Channel) {
        let name = &channel.name;
        let hint = match self.like(name, &|_| true) {
            Some(title) => format!("if `{title}` is meant, say --map \"{name}={title}\""),
            None => format!("name the column `{name}`, or say --map {name}=COLUMN"),
        };
        let drives = role == Role::Output && self.channels.drives(name);
        let hint = match role {
            Role::Output if drives => format!("`measured({name})` drives the model; {hint}"),
            _ if channel.known => {
                format!("say --known {name}=VALUE, or give it in a column `{name}` of --runs or of the record")
            }
            Role::Output => format!("{hint}; if it was not measured, say --without-output {name}"),
            _ => hint,
        };
        let fault = Fault::Missing { role, channel: name.clone(), columns: self.table.titles() };
        self.problems.push(fault.anywhere().hint(hint));
    }

    /// Title of the column, of those that may be meant, whose name is nearest, or begins with the name.
    fn like(&self, name: &str, may_be: &dyn Fn(&Heading) -> bool) -> Option<String> {
        // the distance costs the product of the lengths
        let headings = || self.table.columns.iter().filter(|h| !h.title.is_empty() && h.name.len() <= 100 && may_be(h));
        // names of one letter are all equally near
        let resembles = |other: &&str| other.to_lowercase().contains(|c| name.to_lowercase().contains(c));
        let near = nearest(name, headings().map(|h| h.name.as_str())).filter(resembles);
        let longer = || {
            let begins = |h: &&Heading| h.name.strip_prefix(name).is_some_and(|r| r.starts_with(['_', '.', ' ', '-']));
            headings().find(begins).map(|h| h.name.as_str())
        };
        let name = near.or_else(longer)?;
        headings().find(|h| h.name == name).map(|h| excerpt(&h.title))
    }

    /// The conversion from the column's unit to the channel's.
    fn source(&mut self, role: Role, channel: &Channel, found: Found) -> Option<Source> {
        if found.logarithm {
            return self.logarithm(role, channel, found);
        }
        let Found { column, unit: given, .. } = found;
        let heading = &self.table.columns[column];
        let pure = || is_pure(&heading.name, &channel.name).then(|| "1".to_string());
        let unit = given.or_else(|| heading.unit.clone()).or_else(pure);
        let same = Source { column, unit: unit.clone(), scale: 1.0, offset: 0.0, logarithm: false, clock: false };
        let (Some(from), Some(to)) = (&unit, &channel.unit) else {
            if unit.is_some() != channel.unit.is_some() {
                self.notes.push(Note::UnitAssumed {
                    role,
                    channel: channel.name.clone(),
                    column: heading.title.clone(),
                    unit: unit.or_else(|| channel.unit.as_ref().map(|u| u.text().to_string())).unwrap_or_default(),
                    stated_by_column: heading.unit.is_some() || channel.unit.is_none(),
                });
            }
            return Some(same);
        };
        let (name, expected) = (channel.name.clone(), to.text().to_string());
        let known = match Unit::parse(from) {
            Ok(known) => known,
            Err(error) => {
                let hint = error.nearest.map_or_else(
                    || {
                        format!(
                            "write it as in `m/s^2`, `deg/s` or `1`, after the name in brackets: `{name} [{expected}]`"
                        )
                    },
                    |near| format!("did you mean `{near}`?"),
                );
                let fault = Fault::UnknownUnit { unit: excerpt(from), role, channel: name, expected };
                self.problems.push(self.table.in_header(fault).column(&heading.title).hint(hint));
                return None;
            }
        };
        let Some((scale, offset)) = known.conversion(to) else {
            let fault = Fault::Incompatible { found: excerpt(from), expected, role, channel: name };
            self.problems.push(self.table.in_header(fault).column(&heading.title));
            return None;
        };
        Some(Source { scale, offset, ..same })
    }

    /// The logarithm of a column in the unit that was given with it, or in its own where there is none to choose.
    fn logarithm(&mut self, role: Role, channel: &Channel, found: Found) -> Option<Source> {
        let title = self.table.columns[found.column].title.clone();
        let name = channel.name.clone();
        let own =
            self.table.columns[found.column].unit.clone().filter(|u| Unit::parse(u).map_or(true, |u| !u.is_one()));
        if let Some(unit) = channel.unit.as_ref().filter(|u| !u.is_one()) {
            let fault = Fault::LogarithmOfUnit { role, channel: name, unit: unit.text().to_string() };
            self.problems.push(self.table.in_header(fault).column(&title));
            return None;
        }
        match (own, found.unit) {
            (Some(own), None) => {
                let bare = &self.table.columns[found.column].name;
                let hint = format!("say in which: --map \"{name}=log({bare} [{own}])\"");
                let fault = Fault::LogarithmInWhich { role, channel: name, unit: excerpt(&own) };
                self.problems.push(self.table.in_header(fault).column(&title).hint(hint));
                None
            }
            (None, unit) => {
                Some(Source { column: found.column, unit, scale: 1.0, offset: 0.0, logarithm: true, clock: false })
            }
            (Some(_), Some(unit)) => {
                // as a channel in that unit would be read
                let wanted = match Unit::parse(&unit) {
                    Ok(wanted) => wanted,
                    Err(error) => {
                        let hint = error.nearest.map(|near| format!("did you mean `{near}`?"));
                        let fault = Fault::UnitOfLogarithm { role, channel: name, unit: excerpt(&unit) };
                        self.problems.push(fault.anywhere().maybe_hint(hint));
                        return None;
                    }
                };
                let channel = Channel::new(name, Some(wanted));
                let plain = self.source(role, &channel, Found::plain(found.column))?;
                Some(Source { logarithm: true, ..plain })
            }
        }
    }
}

/// `n[1]` is also the title of a pure number `n`.
fn is_pure(title: &str, name: &str) -> bool {
    title.strip_suffix("[1]") == Some(name)
}
