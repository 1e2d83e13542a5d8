//! What a run brings beside the samples of its file: values that are the same in all samples (`known T0 per run;`), the group that it belongs to,
//! columns that say which samples are compared, and angles that wrap.

use super::channel::{Channel, Channels, Demand, Role};
use super::error::{Fault, Names, Problem, excerpt};
use super::note::Note;
use super::options::ReadOptions;
use super::read::{ChannelSource, Summary};
use super::run::Run;
use fdm_grammar::Unit;
use fdm_grammar::diagnostic::nearest;
use fdm_grammar::model::Membership;

/// The channels that are columns of a file, and what stands beside them.
pub(crate) struct Asked {
    /// The channels to be read: values that are given are left out, columns of masks are outputs behind the others.
    pub(crate) channels: Channels,
    /// Inputs (by index among the model's) with the value that was given.
    given: Vec<(usize, f64)>,
    /// For each mask the output behind the model's own ones that is its column.
    masks: Vec<usize>,
}

/// Tells columns from what is given.
///
/// # Errors
/// Values, groups and masks that do not fit the model.
pub(crate) fn asked(channels: &Channels, options: &ReadOptions) -> Result<Asked, Vec<Problem>> {
    let mut problems = Vec::new();
    let given = given(channels, options, &mut problems);
    let mut reduced = channels.clone();
    let left_out = |k: &usize| given.iter().any(|(g, _)| g == k);
    let kept: Vec<usize> = (0..channels.inputs.len()).filter(|k| !left_out(k)).collect();
    reduced.inputs = kept.iter().map(|k| channels.inputs[*k].clone()).collect();
    for slope in &mut reduced.slopes {
        // hidden inputs keep their places behind the declared ones
        let (of, declared) = (slope.of as usize, channels.inputs.len());
        let place = kept.iter().position(|k| *k == of).unwrap_or(of.saturating_sub(declared - kept.len()));
        slope.of = place as u32;
    }
    let mut masks = Vec::new();
    for mask in &options.masks {
        if let Some(output) = mask.output.as_ref().filter(|o| !channels.outputs.iter().any(|c| c.name == **o)) {
            let outputs = || channels.outputs.iter().map(|c| c.name.as_str());
            let hint = nearest(output, outputs()).map(|n| format!("did you mean `{n}`?"));
            let (option, output) = ("--mask", output.clone());
            problems.push(
                Fault::UnknownOutput { option, output, outputs: Names::new(outputs()) }.anywhere().maybe_hint(hint),
            );
            continue;
        }
        let behind = reduced.outputs.iter().skip(channels.outputs.len()).position(|c| c.name == mask.column);
        masks.push(behind.map_or(reduced.outputs.len(), |k| k + channels.outputs.len()));
        if behind.is_none() {
            reduced.outputs.push(Channel::new(mask.column.clone(), None));
        }
    }
    if problems.is_empty() { Ok(Asked { channels: reduced, given, masks }) } else { Err(problems) }
}

fn given(channels: &Channels, options: &ReadOptions, problems: &mut Vec<Problem>) -> Vec<(usize, f64)> {
    let known = || channels.inputs.iter().enumerate().filter(|(_, c)| c.known);
    let plain = || known().filter(|(_, c)| c.membership.is_none());
    for value in &options.known {
        if !plain().any(|(_, c)| c.name == value.name) {
            let names = || plain().map(|(_, c)| c.name.as_str());
            let hint = nearest(&value.name, names()).map(|n| format!("did you mean `{n}`?"));
            let there = Names::new(names());
            problems.push(Fault::UnknownKnown { name: value.name.clone(), there }.anywhere().maybe_hint(hint));
        }
    }
    let mut given = Vec::new();
    for (k, channel) in known() {
        let found = match &channel.membership {
            Some(of) => member(channels, options, of),
            None => match value(channel, options) {
                Some(found) => found,
                None => continue,
            },
        };
        match found {
            Ok(value) => given.push((k, value)),
            Err(problem) if problems.contains(&problem) => {}
            Err(problem) => problems.push(problem),
        }
    }
    given
}

/// Whether the run is of this group.
fn member(channels: &Channels, options: &ReadOptions, of: &Membership) -> Result<f64, Problem> {
    let Membership { grouping, group } = of;
    let beside = channels.inputs.iter().filter_map(|c| c.membership.as_ref()).filter(|m| m.grouping == *grouping);
    let known: Vec<String> = beside.map(|m| m.group.clone()).collect();
    let groups = || Names::new(known.iter().map(String::as_str));
    let grouping = grouping.clone();
    match options.groups.get(&grouping) {
        Some(own) if known.contains(own) => Ok(if own == group { 1.0 } else { 0.0 }),
        Some(own) => {
            let hint = nearest(own, known.iter().map(String::as_str)).map(|n| format!("did you mean `{n}`?"));
            let fault = Fault::UnknownGroup { grouping, group: excerpt(own), groups: groups() };
            Err(fault.anywhere().maybe_hint(hint))
        }
        None => {
            let hint = format!("say --group {grouping}={}, or give it in a column `{grouping}` of --runs", known[0]);
            Err(Fault::NoGroup { grouping, groups: groups() }.anywhere().hint(hint))
        }
    }
}

/// The value that was given for a channel, in its unit.
fn value(channel: &Channel, options: &ReadOptions) -> Option<Result<f64, Problem>> {
    let given = options.known.iter().find(|k| k.name == channel.name)?;
    let name = given.name.clone();
    if !given.value.is_finite() {
        return Some(Err(Fault::KnownValue { name, value: given.value.to_string() }.anywhere()));
    }
    let (Some(unit), Some(own)) = (&given.unit, &channel.unit) else { return Some(Ok(given.value)) };
    let conversion = Unit::parse(unit).ok().and_then(|u| u.conversion(own));
    Some(
        conversion
            .map(|(scale, offset)| given.value * scale + offset)
            .ok_or_else(|| Fault::KnownUnit { name, unit: excerpt(unit), expected: own.text().to_string() }.anywhere()),
    )
}

impl Asked {
    /// What is asked of the columns, those of masks among them.
    pub(crate) fn demands(&self, mut demands: Vec<Demand>) -> Vec<Demand> {
        demands.resize(self.channels.outputs.len(), Demand::Needed);
        demands
    }

    /// The run that the model wants, from the one that was read.
    pub(crate) fn completed(&self, whole: &Channels, options: &ReadOptions, run: Run, summary: &mut Summary) -> Run {
        let q = whole.outputs.len();
        let of_mask = |name: &str| self.channels.outputs[q..].iter().any(|c| c.name == name);
        let constant = |name: &str| {
            whole.inputs.iter().any(|c| c.known && c.name == name)
                || of_mask(name) && !whole.outputs.iter().any(|c| c.name == name)
        };
        summary.notes.retain(|n| !matches!(n, Note::Constant { channel, .. } if constant(channel)));
        let times = usize::from(summary.sources.first().is_some_and(|s| s.role == Role::Time));
        summary.sources.truncate(times + self.channels.inputs.len() + q);
        let run = if self.masks.is_empty() { run } else { self.masked(whole, options, run, summary) };
        if self.given.is_empty() { run } else { self.widened(whole, run, &mut summary.sources) }
    }

    fn masked(&self, whole: &Channels, options: &ReadOptions, mut run: Run, summary: &mut Summary) -> Run {
        let (width, q) = (run.output_gaps.len(), whole.outputs.len());
        for (mask, column) in options.masks.iter().zip(&self.masks) {
            for (o, output) in whole.outputs.iter().enumerate() {
                if mask.output.as_ref().is_some_and(|name| *name != output.name) {
                    continue;
                }
                let mut samples = 0;
                let rows = run.measured.chunks_exact_mut(width).zip(&run.time);
                for (row, time) in rows.filter(|(row, _)| row[*column] == 0.0 || row[*column].is_nan()) {
                    samples += usize::from(!row[o].is_nan());
                    row[o] = f64::NAN;
                    summary.censored.retain(|c| (c.output, c.time) != (o, *time));
                }
                if samples > 0 {
                    run.output_gaps[o] += samples;
                    summary.notes.push(Note::Masked {
                        output: output.name.clone(),
                        column: mask.column.clone(),
                        samples,
                    });
                }
            }
        }
        let (inputs, outputs): (Vec<usize>, Vec<usize>) = ((0..run.held.len()).collect(), (0..q).collect());
        run.with_channels(&inputs, &outputs)
    }

    /// With the values that were given, as inputs that never change.
    fn widened(&self, whole: &Channels, run: Run, sources: &mut Vec<ChannelSource>) -> Run {
        let (narrow, n) = (run.held.len(), run.len());
        let width = narrow + self.given.len();
        let place = |k: usize| self.given.iter().find(|(g, _)| *g == k).map(|(_, value)| *value);
        let mut run = run;
        let mut inputs = Vec::with_capacity(n * width);
        for sample in 0..n {
            let mut own = run.inputs[sample * narrow..(sample + 1) * narrow].iter();
            inputs.extend((0..width).map(|k| place(k).or_else(|| own.next().copied()).unwrap_or(f64::NAN)));
        }
        run.inputs = inputs;
        for (k, _) in &self.given {
            run.held.insert(*k, false);
            run.stated.insert(*k, true);
            run.input_gaps.insert(*k, 0);
            let before = usize::from(sources.first().is_some_and(|s| s.role == Role::Time));
            let channel = whole.inputs[*k].name.clone();
            let unit = whole.inputs[*k].unit.as_ref().map(ToString::to_string);
            let source = ChannelSource {
                role: Role::Input,
                channel,
                column: None,
                unit,
                scale: 1.0,
                offset: 0.0,
                logarithm: false,
                gaps: 0,
            };
            sources.insert((before + k).min(sources.len()), source);
        }
        run
    }
}

/// Values that the run brings do not change within it.
///
/// # Errors
/// The first that does.
pub(crate) fn same_in_all(run: &Run, channels: &Channels) -> Result<(), Problem> {
    let width = run.held.len();
    for (k, channel) in channels.inputs.iter().enumerate().filter(|(_, c)| c.known) {
        let mut values = run.inputs.iter().skip(k).step_by(width);
        let Some(first) = values.next() else { continue };
        if let Some(other) = values.find(|v| *v != first) {
            let fault = Fault::KnownChanges(channel.name.clone(), first.to_string(), other.to_string());
            return Err(fault.anywhere().hint(format!("declare it as `input {}` where it changes", channel.name)));
        }
    }
    Ok(())
}

/// Takes the jumps of angles out of measured outputs (N by q): a sample and the one before it are the short way apart.
pub(crate) fn unwrapped(measured: &mut [f64], outputs: &[Channel], notes: &mut Vec<Note>) {
    let q = outputs.len();
    for (o, channel) in outputs.iter().enumerate() {
        let Some(period) = channel.wrap else { continue };
        let mut values: Vec<f64> = measured.iter().skip(o).step_by(q).copied().collect();
        let jumps = fdm_readers::unwrap(&mut values, period);
        if jumps > 0 {
            measured.iter_mut().skip(o).step_by(q).zip(values).for_each(|(z, v)| *z = v);
            notes.push(Note::Unwrapped { output: channel.name.clone(), period, jumps });
        }
    }
}
