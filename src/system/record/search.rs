//! The search for the columns of a file that hold a model's channels, and for the conversion of their units.

use super::channel::{Channel, Channels, Demand, Plan, Role, Source};
use super::error::{Fault, Names, Problem, excerpt};
use super::heading::Heading;
use super::note::Note;
use super::options::ReadOptions;
use super::table::Table;
use super::times;
use fdm_grammar::Unit;
use fdm_grammar::diagnostic::nearest;
use fdm_grammar::unit::Spelled;

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
        let unit = times::unit_of(self.table, column).unit;
        let own = unit.as_deref().and_then(|u| Unit::spelled(u).ok());
        let (scale, offset) = own.map_or(Some((1.0, 0.0)), |own| own.unit.conversion(&self.channels.time))?;
        Some(Source { column, unit, scale, offset, logarithm: false, clock: self.table.is_clock(column) })
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
        self.time_of(found)
    }

    /// The times of a column, in the unit that was given for it or that the file tells.
    fn time_of(&mut self, found: Found) -> Option<Source> {
        let (column, own) = (found.column, &self.table.columns[found.column]);
        let title = excerpt(&own.heading.title);
        let told = times::unit_of(self.table, column);
        let clock = self.table.is_clock(column);
        let unit = if clock { told.unit.clone() } else { found.unit.or_else(|| told.unit.clone()) };
        if clock || unit == told.unit {
            self.notes.extend(told.note);
        }
        let fault = match () {
            () if own.question == Some(super::clock::Question::Order) => {
                let hint = format!("say --map \"t={title} [dd/mm/yyyy]\" or --map \"t={title} [mm/dd/yyyy]\"");
                Some((Fault::DayOrMonth(title.clone()), hint))
            }
            () if unit.is_some() || !self.channels.timed => None,
            () if times::counts(own) => {
                let hint =
                    format!("say --rate N, in samples per second, or --map \"t={title} [s]\" where it is the time");
                Some((Fault::Counter(title.clone()), hint))
            }
            () => times::doubtful(own).map(|step| {
                let hint = format!("say which: --map \"t={title} [ms]\", [us] or [ns]; or [s]");
                (Fault::DoubtfulUnit { column: title.clone(), step: step.to_string() }, hint)
            }),
        };
        if let Some((fault, hint)) = fault {
            self.problems.push(self.table.in_header(fault).hint(hint));
            return None;
        }
        let channel = Channel::new("t", Some(self.channels.time.clone()));
        self.source(Role::Time, &channel, Found { unit, ..Found::plain(column) })
            .map(|source| Source { clock, ..source })
    }

    /// The column that holds the time by its name, its unit or its cells.
    fn time_column(&self) -> Result<Option<usize>, Problem> {
        times::found(self.table, &may_be_time(self.channels, self.options))
    }

    fn is_time_unit(&self, unit: &str) -> bool {
        Unit::spelled(unit).is_ok_and(|u| u.unit.conversion(&self.channels.time).is_some())
    }

    fn missing_time(&mut self) {
        let titles = self.table.titles();
        let table = self.table;
        // a column that is called so and holds something else
        let text = times::called_so(table).find_map(|k| Some((k, table.columns[k].texts().next()?)));
        if let Some((k, (row, text))) = text {
            let hint = "times are numbers without separated thousands, dates as 2026-05-01T12:34:56.7, or clock times as 12:34:56.7";
            let fault = Fault::NotANumber(excerpt(text)).at(table.line(row)).column(&table.columns[k].heading.title);
            self.problems.push(Problem { place: table.place, ..fault.hint(hint) });
            return;
        }
        let may_be = may_be_time(self.channels, self.options);
        let free = |k: &usize| may_be(&table.columns[*k].heading);
        let of_unit = |k: &usize| table.columns[*k].heading.unit.as_deref().is_some_and(|u| self.is_time_unit(u));
        let called = times::called_times(table).into_iter().map(|(_, k)| k).find(free);
        let likely = called.or_else(|| (0..table.columns.len()).filter(free).find(of_unit));
        let counter = || table.columns.iter().find(|c| times::counts(c));
        let hint = match (likely.map(|k| (k, excerpt(&table.columns[k].heading.title))), counter()) {
            (Some((k, title)), _) => {
                // advice that is followed must not be wrong by a thousand
                let unit = if times::unit_of(table, k).unit.is_some() { "" } else { " [UNIT]" };
                let which = if unit.is_empty() { "" } else { ", with s, ms, us, .. for UNIT" };
                format!("if `{title}` holds the time, say --map \"t={title}{unit}\"{which}")
            }
            (None, Some(column)) => {
                format!("`{}` counts rows: say --rate N, in samples per second", excerpt(&column.heading.title))
            }
            (None, None) => {
                "say --map \"t=COLUMN [s]\", or --rate N, in samples per second, where no column holds the time".into()
            }
        };
        let fault = Fault::Missing { role: Role::Time, channel: "t".into(), columns: titles };
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
        let time =
            self.time_column().ok().flatten().is_some_and(|k| self.table.columns[k].heading.title == heading.title);
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
        if let Some(column) = self.unique(|h| h.alias.as_deref() == Some(name))? {
            return Ok(Some(column));
        }
        if let Some(column) = self.unique(|h| is_pure(&h.name, name))? {
            return Ok(Some(column));
        }
        let lower = name.to_lowercase();
        let found =
            self.unique(|h| (h.name.to_lowercase() == lower || h.title.to_lowercase() == lower) && !taken(h))?;
        let number = || name.strip_prefix('#')?.parse::<usize>().ok()?.checked_sub(1);
        Ok(found.or_else(|| number().filter(|k| *k < self.table.columns.len())))
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
        let found = match as_typed {
            Ok(None) if given.name != text.trim() => {
                self.column(&given.name).map(|c| c.map(|column| Found { unit: given.unit, ..Found::plain(column) }))
            }
            other => other.map(|c| c.map(Found::plain)),
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
        let mut found = self.table.headings().enumerate().filter(|(_, h)| !h.title.is_empty() && wanted(h));
        let first = found.next();
        let count = 1 + found.count();
        match first {
            Some((_, h)) if count > 1 => {
                let problem = self.table.in_header(Fault::Ambiguous { name: excerpt(&h.name), count });
                Err(problem
                    .hint("say --map CHANNEL=TITLE with a title that only one of them has, or --map CHANNEL=#N with the number of its column"))
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
        let headings = || self.table.headings().filter(|h| !h.title.is_empty() && h.name.len() <= 100 && may_be(h));
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
        let heading = &self.table.columns[column].heading;
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
        let title = heading.title.clone();
        let known = match Unit::spelled(from) {
            // a sign of two meanings, of which the first is no such quantity
            Ok(known) if !known.unit.same_dimension(to) => Unit::meant(from, to).unwrap_or(known),
            Ok(known) => known,
            Err(error) => match Unit::meant(from, to) {
                Some(known) => known,
                None => {
                    let plain = || {
                        format!(
                            "say --map \"{name}={} [UNIT]\", with a unit as in `m/s^2`, `deg/s` or `1`",
                            excerpt(&heading.name)
                        )
                    };
                    let hint = error.nearest.map_or_else(plain, |near| format!("did you mean `{near}`?"));
                    let fault = Fault::UnknownUnit { unit: excerpt(from), role, channel: name, expected };
                    self.problems.push(self.table.in_header(fault).column(&title).hint(hint));
                    return None;
                }
            },
        };
        let Some((scale, offset)) = known.unit.conversion(to) else {
            // a model of pure numbers has no opinion on units
            let plain =
                || format!("say --map \"{name}={} [1]\" to take its numbers as they are", excerpt(&heading.name));
            let hint = (expected == "1").then(plain);
            let fault = Fault::Incompatible { found: excerpt(from), expected, role, channel: name };
            self.problems.push(self.table.in_header(fault).column(&title).maybe_hint(hint));
            return None;
        };
        self.notes.extend(spelled(&known, (&title, from), channel, to));
        Some(Source { scale, offset, ..same })
    }

    /// The logarithm of a column in the unit that was given with it, or in its own where there is none to choose.
    fn logarithm(&mut self, role: Role, channel: &Channel, found: Found) -> Option<Source> {
        let heading = self.table.columns[found.column].heading.clone();
        let title = heading.title;
        let name = channel.name.clone();
        let own = heading.unit.filter(|u| Unit::spelled(u).map_or(true, |u| !u.unit.is_one()));
        if let Some(unit) = channel.unit.as_ref().filter(|u| !u.is_one()) {
            let fault = Fault::LogarithmOfUnit { role, channel: name, unit: unit.text().to_string() };
            self.problems.push(self.table.in_header(fault).column(&title));
            return None;
        }
        match (own, found.unit) {
            (Some(own), None) => {
                let bare = &heading.name;
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
                let wanted = match Unit::spelled(&unit) {
                    Ok(wanted) => wanted.unit,
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

/// What is said of a unit that is read as another spelling, and of turns that one of two units does not name.
fn spelled(known: &Spelled, (title, from): (&str, &str), channel: &Channel, to: &Unit) -> Option<Note> {
    let turns =
        |text: &str| text.split(|c: char| !c.is_alphabetic()).any(|w| ["rad", "deg", "rev", "rpm"].contains(&w));
    let taken_for = known.taken_for.clone().unwrap_or_else(|| from.to_string());
    let rate = Unit::one().quotient(&Unit::second()).is_some_and(|rate| rate.same_dimension(to));
    let counts = rate && !turns(&taken_for) && turns(to.text());
    let or_else = counts.then(|| {
        let name = &Heading::new(title).name;
        format!("where turns are meant, and not radians, say --map \"{}={name} [rpm]\"", channel.name)
    });
    let told = known.taken_for.is_some() || counts;
    told.then(|| Note::Spelled { column: title.into(), unit: from.into(), taken_for, or_else })
}

/// Whether a column may hold the time: it is no channel, and no `--map` names it for one.
pub(crate) fn may_be_time<'a>(channels: &'a Channels, options: &'a ReadOptions) -> impl Fn(&Heading) -> bool + 'a {
    move |heading| {
        let is = |text: &str| text == heading.title || text == heading.name || Heading::new(text).name == heading.name;
        let mapped = options.map.iter().any(|(channel, column)| !channels.means_time(channel) && is(column));
        !mapped && !channels.names().any(|name| name == heading.name)
    }
}

/// The column that `--map` names for the time, where it names one alone; words for a format behind it (`t=Time [dd/mm/yyyy]`) say how its dates are read.
pub(crate) fn named_time(table: &mut Table, channels: &Channels, options: &ReadOptions) -> Option<usize> {
    let (_, text) = options.map.iter().find(|(channel, _)| channels.means_time(channel))?;
    let given = Heading::new(text);
    let mut found = table.headings().enumerate().filter(|(_, h)| h.is(text.trim()) || h.is(&given.name));
    let column = found.next().map(|(column, _)| column).filter(|_| found.next().is_none())?;
    drop(found);
    given.format.iter().for_each(|format| table.columns[column].in_format(format));
    Some(column)
}
