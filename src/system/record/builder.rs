//! Samples in memory become a [`Run`]: channels by name in any order, every mistake named at once.

use super::beginning::{Lead, too_far};
use super::channel::{Channel, Role, channels};
use super::derived::{self, Incomplete};
use super::error::{Names, excerpt};
use super::holds::Holds;
use super::known;
use super::read::since;
use super::run::Run;
use fdm_grammar::diagnostic::nearest;
use fdm_grammar::{Model, Unit};
use nalgebra::{Dyn, MatrixView, U1};
use rayon::iter::{IndexedParallelIterator, ParallelIterator};
use rayon::slice::ParallelSliceMut;
use std::borrow::Cow;
use std::fmt;

/// A run from samples in memory: times and one list of samples for each input and output of a model, by name.
///
/// Every list has N samples. Samples are in the model's units, or in the unit that is named with them. NaN marks a sample that is
/// missing: outputs are not compared there, inputs are bridged linearly. Begin with `Model::run`.
#[derive(Debug, Clone)]
#[must_use = "a builder makes no run before `build`"]
pub struct RunBuilder<'m> {
    model: &'m Model,
    name: String,
    times: Vec<Samples<'m>>,
    signals: Vec<Samples<'m>>,
    held: Vec<String>,
    linear: Vec<String>,
    known: Vec<(String, f64)>,
    begin: Option<f64>,
    unmeasured: bool,
}

/// A column (N) of a matrix where it is: samples with a step between them in memory.
pub type ColumnView<'s> = MatrixView<'s, f64, Dyn, U1, Dyn, Dyn>;

/// What was given under a name.
#[derive(Debug, Clone)]
struct Samples<'s> {
    name: String,
    unit: Option<String>,
    values: Values<'s>,
}

/// Samples of a channel, where they are.
#[derive(Debug, Clone)]
enum Values<'s> {
    Together(Cow<'s, [f64]>),
    Apart(ColumnView<'s>),
}

impl Values<'_> {
    fn len(&self) -> usize {
        match self {
            Self::Together(values) => values.len(),
            Self::Apart(view) => view.len(),
        }
    }

    fn borrowed(&self) -> Values<'_> {
        match self {
            Self::Together(values) => Values::Together(Cow::Borrowed(values)),
            Self::Apart(view) => Values::Apart(*view),
        }
    }

    /// Samples of this range, one behind the other.
    fn part(&self, from: usize, to: usize) -> Cow<'_, [f64]> {
        match self {
            Self::Together(values) => Cow::Borrowed(&values[from..to]),
            Self::Apart(view) => view.rows(from, to - from).iter().copied().collect(),
        }
    }

    /// The view, where it is one of at least so many samples.
    fn apart(&self, samples: usize) -> Option<ColumnView<'_>> {
        match self {
            Self::Apart(view) if view.len() >= samples => Some(*view),
            _ => None,
        }
    }

    fn together(&self) -> Cow<'_, [f64]> {
        self.part(0, self.len())
    }
}

impl<'m> RunBuilder<'m> {
    /// A run of this name, still without samples.
    pub fn new(model: &'m Model, name: impl Into<String>) -> Self {
        let (times, signals, held) = (Vec::new(), Vec::new(), Vec::new());
        Self {
            model,
            name: name.into(),
            times,
            signals,
            held,
            linear: Vec::new(),
            known: Vec::new(),
            begin: None,
            unmeasured: false,
        }
    }

    /// Times of the samples (N), rising, in the model's time unit. The run begins at the first of them.
    pub fn times(self, times: impl Into<Vec<f64>>) -> Self {
        self.given("t", None, times.into())
    }

    /// Times of the samples (N), rising, in another unit than the model's, such as `ms`.
    pub fn times_in(self, unit: &str, times: impl Into<Vec<f64>>) -> Self {
        self.given("t", Some(unit), times.into())
    }

    /// Samples of an input or output (N) in the model's unit. `t` and `time` are the times, unless the model has such a channel.
    pub fn samples(self, channel: &str, samples: impl Into<Vec<f64>>) -> Self {
        self.given(channel, None, samples.into())
    }

    /// Samples of an input or output (N) in another unit than the model's, such as `deg` for a channel in `rad`.
    pub fn samples_in(self, channel: &str, unit: &str, samples: impl Into<Vec<f64>>) -> Self {
        self.given(channel, Some(unit), samples.into())
    }

    /// Samples of a channel (N), or times, that stay where they are until the run is built; in a unit where one is
    /// named.
    pub fn samples_of(self, channel: &str, unit: Option<&str>, samples: &'m [f64]) -> Self {
        self.kept(channel, unit, Values::Together(samples.into()))
    }

    /// Samples of a channel (N), or times, as a column of a matrix that stays where it is until the run is built; in a
    /// unit where one is named.
    pub fn samples_of_column(self, channel: &str, unit: Option<&str>, samples: ColumnView<'m>) -> Self {
        self.kept(channel, unit, Values::Apart(samples))
    }

    /// Keeps an input between samples at the earlier one. Of what is neither held nor [`linear`](Self::linear) straight lines are assumed, and
    /// a fit asks the record.
    pub fn zero_order_hold(mut self, input: &str) -> Self {
        self.held.push(input.into());
        self
    }

    /// An input that is known to go in straight lines between samples.
    pub fn linear(mut self, input: &str) -> Self {
        self.linear.push(input.into());
        self
    }

    /// A value that the run brings (`known T0 per run;`), in the model's unit.
    pub fn known(mut self, name: &str, value: f64) -> Self {
        self.known.push((name.into(), value));
        self
    }

    /// Where the run begins, in the unit of its times: the instant that is the model's time 0, at the first sample or before it. Until the
    /// first sample inputs have its values, and nothing is compared.
    pub fn begin(mut self, time: f64) -> Self {
        self.begin = Some(time);
        self
    }

    /// The group that the run belongs to (`param k per group aircraft;`), for a model of such groups.
    pub fn group(mut self, grouping: &str, group: &str) -> Self {
        for input in &self.model.inputs {
            if let Some(of) = input.membership.as_ref().filter(|of| of.grouping == grouping) {
                self.known.push((input.quantity.name.clone(), if of.group == group { 1.0 } else { 0.0 }));
            }
        }
        self
    }

    /// Outputs without samples are not measured: a run to simulate.
    pub fn without_outputs(mut self) -> Self {
        self.unmeasured = true;
        self
    }

    fn given(self, name: &str, unit: Option<&str>, values: Vec<f64>) -> Self {
        self.kept(name, unit, Values::Together(values.into()))
    }

    fn kept(mut self, name: &str, unit: Option<&str>, values: Values<'m>) -> Self {
        let samples = Samples { name: name.into(), unit: unit.map(String::from), values };
        if channels(self.model).means_time(name) {
            self.times.push(samples)
        } else {
            self.signals.push(samples)
        }
        self
    }

    /// The run, with the inputs that the model computes from it.
    ///
    /// # Errors
    /// [`RunError`] with every mistake: channels that are missing, unknown or given twice, lists of other lengths, times that do not
    /// rise, samples that are not finite, units that do not fit.
    pub fn build(self) -> Result<Run, RunError> {
        let mut faults = self.names();
        let time = self.time(&mut faults);
        let wanted = channels(self.model);
        let n = time.len();
        let columns = |role: Role, channels: &[Channel]| -> (Vec<Values<'_>>, Vec<Vec<RunFault>>) {
            channels.iter().map(|channel| self.column(role, channel, n)).unzip()
        };
        let ((inputs, of_inputs), (outputs, of_outputs)) =
            (columns(Role::Input, &wanted.inputs), columns(Role::Output, &wanted.outputs));
        let (m, q) = (inputs.len(), outputs.len());
        let ((mut driven, census), (mut measured, compared)) = (rows(&inputs, n), rows(&outputs, n));
        let inputs = wanted.inputs.iter().zip(&census).zip(of_inputs).map(|of| (Role::Input, of));
        let outputs = wanted.outputs.iter().zip(&compared).zip(of_outputs).map(|of| (Role::Output, of));
        for (role, ((channel, census), others)) in inputs.chain(outputs) {
            faults.extend(self.number(role, channel, census, n));
            faults.extend(others);
        }
        if !faults.is_empty() {
            return Err(RunError { run: self.name, faults });
        }
        known::unwrapped(&mut measured, &wanted.outputs, &mut Vec::new());
        if !wanted.timed {
            derived::compare_not(&driven, m, &mut measured, q);
        }
        // as a file with these samples is read
        let Holds { held, stated, .. } = Holds::of(&wanted, (&self.held, &self.linear), &[], &driven);
        let bridged = |(k, of): (usize, &Census)| of.bridged(&time, &mut driven, (m, k), held[k]);
        let input_gaps = census.iter().enumerate().map(bridged).collect();
        let mut time = time;
        let lead = Lead::of_run(&time, self.begin);
        lead.put_in_front(&mut time, (&mut driven, m), (&mut measured, q));
        let run = Run {
            input_gaps,
            output_gaps: compared.iter().map(|of| of.missing).collect(),
            name: self.name.clone(),
            time,
            inputs: driven,
            held,
            stated,
            measured,
        };
        run.completed(self.model)
            .map_err(|reason| RunError { run: self.name, faults: vec![RunFault::Incomplete(reason)] })
    }

    /// Names that the model does not have, or that were given twice, or that cannot be held.
    fn names(&self) -> Vec<RunFault> {
        let wanted = channels(self.model);
        let known: Vec<&str> = wanted.names().collect();
        let mut faults = Vec::new();
        for (name, _) in self.known.iter().filter(|(name, _)| !wanted.inputs.iter().any(|c| c.known && c.name == *name))
        {
            let there: Vec<&str> = wanted.inputs.iter().filter(|c| c.known).map(|c| c.name.as_str()).collect();
            faults.push(RunFault::unknown(name, &there));
        }
        for (k, samples) in self.signals.iter().enumerate() {
            let name = &samples.name;
            if !known.contains(&name.as_str()) {
                faults.push(RunFault::unknown(name, &known));
            } else if self.signals[..k].iter().any(|earlier| earlier.name == *name) {
                faults.push(RunFault::Twice { channel: name.clone() });
            }
        }
        if self.times.len() > 1 {
            faults.push(RunFault::Twice { channel: "t".into() });
        }
        for name in self.held.iter().chain(&self.linear) {
            if wanted.inputs.iter().any(|c| c.name == *name) {
                continue;
            }
            let inputs: Vec<&str> = wanted.inputs.iter().map(|c| c.name.as_str()).collect();
            let output = wanted.outputs.iter().any(|c| c.name == *name);
            faults.push(if output {
                RunFault::HeldOutput { output: name.clone() }
            } else {
                RunFault::unknown(name, &inputs)
            });
        }
        faults
    }

    /// Times from 0 in the model's unit; counted samples where the model knows no time and none are given.
    fn time(&self, faults: &mut Vec<RunFault>) -> Vec<f64> {
        let wanted = channels(self.model);
        let Some(given) = self.times.first() else {
            let counted = self.signals.iter().map(|s| s.values.len()).max().unwrap_or_default();
            if wanted.timed {
                faults.push(RunFault::NoTimes);
            } else if counted == 0 {
                faults.push(RunFault::TooFew { found: counted, expected: wanted.samples });
            }
            return (0..counted).map(|k| k as f64).collect();
        };
        let times = &*given.values.together();
        let conversion = self.conversion(given, Some(&wanted.time), faults);
        if let Some(at) = times.iter().position(|t| !t.is_finite()) {
            faults.push(RunFault::NotFinite { channel: "t".into(), sample: at, value: times[at].to_string() });
        } else if let Some(at) = times.windows(2).position(|w| w[1] <= w[0]) {
            let (before, found) = (times[at].to_string(), times[at + 1].to_string());
            faults.push(RunFault::NotRising { sample: at + 1, before, found });
        } else if times.len() < wanted.samples {
            faults.push(RunFault::TooFew { found: times.len(), expected: wanted.samples });
        } else if let Some(begin) =
            self.begin.filter(|begin| times.first().is_some_and(|first| begin > first) || begin.is_nan())
        {
            faults.push(RunFault::BeginBehind { begin: begin.to_string(), first: times[0].to_string() });
        } else if let Some((begin, lengths)) = self.begin.and_then(|begin| Some((begin, too_far(times, begin)?))) {
            let first = times[0].to_string();
            faults.push(RunFault::BeginFar { begin: begin.to_string(), first, lengths: format!("{lengths:.0}") });
        } else if let Some(time) = conversion.and_then(|(scale, _)| {
            let origin = self.begin.or(times.first().copied())?;
            since(origin, times.to_vec(), scale)
        }) {
            return time;
        } else if conversion.is_some() {
            faults.push(RunFault::TimeResolution);
        }
        times.to_vec()
    }

    /// The samples of a channel in its unit, NaN for those of an output that is not measured; and what is wrong but for its numbers.
    fn column(&self, role: Role, channel: &Channel, n: usize) -> (Values<'_>, Vec<RunFault>) {
        let (name, mut faults) = (channel.name.clone(), Vec::new());
        if let Some((_, value)) = self.known.iter().find(|(known, _)| *known == name && channel.known) {
            return (Values::Together(vec![*value; n].into()), faults);
        }
        let Some(given) = self.signals.iter().find(|s| s.name == name) else {
            if role == Role::Input || !self.unmeasured {
                let known: Vec<String> = channels(self.model).names().map(String::from).collect();
                let spare = self.signals.iter().map(|s| s.name.as_str()).filter(|s| !known.iter().any(|k| k == s));
                let nearest = nearest(&name, spare).map(String::from);
                faults.push(RunFault::Missing { role, channel: name, nearest });
            }
            return (Values::Together(vec![f64::NAN; n].into()), faults);
        };
        let mut values = given.values.borrowed();
        // a list of another length says nothing of the others where the times are missing
        if values.len() != n {
            faults.push(RunFault::Length { channel: name, found: values.len(), expected: n });
        }
        if let Some((scale, offset)) = self.conversion(given, channel.unit.as_ref(), &mut faults)
            && (scale, offset) != (1.0, 0.0)
        {
            values = Values::Together(values.together().iter().map(|v| *v * scale + offset).collect());
        }
        (values, faults)
    }

    /// A channel that was given without a value, or with one that is infinite.
    fn number(&self, role: Role, channel: &Channel, census: &Census, n: usize) -> Option<RunFault> {
        let given = self.signals.iter().find(|s| s.name == channel.name).filter(|s| s.values.len() == n)?;
        let channel = channel.name.clone();
        if census.infinite {
            // where it is finite as given, it is not in the unit of the model
            let values = given.values.together();
            let at = values.iter().position(|v| v.is_infinite()).unwrap_or_default();
            return Some(RunFault::NotFinite { channel, sample: at, value: values[at].to_string() });
        }
        (census.missing == n && n > 0).then_some(RunFault::NoValues { role, channel })
    }

    /// Factor and offset from the unit that was named to that of the model; none where they do not fit.
    fn conversion(&self, given: &Samples<'_>, to: Option<&Unit>, faults: &mut Vec<RunFault>) -> Option<(f64, f64)> {
        let Some(named) = &given.unit else { return Some((1.0, 0.0)) };
        let (channel, unit) = (given.name.clone(), excerpt(named));
        let Ok(from) = Unit::parse(named) else {
            faults.push(RunFault::UnknownUnit { channel, unit });
            return None;
        };
        let Some(to) = to else {
            faults.push(RunFault::NoUnit { channel, unit });
            return None;
        };
        let conversion = from.conversion(to);
        if conversion.is_none() {
            faults.push(RunFault::OtherUnit { channel, unit, expected: to.text().to_string() });
        }
        conversion
    }
}

/// What there is in a column.
#[derive(Debug, Clone, Copy, Default)]
struct Census {
    /// Samples that are NaN.
    missing: usize,
    /// Whether one is infinite.
    infinite: bool,
}

impl Census {
    /// Gaps of input `k` of `m` in the rows, after they were bridged.
    fn bridged(&self, time: &[f64], rows: &mut [f64], (m, k): (usize, usize), held: bool) -> usize {
        if self.missing == 0 { 0 } else { derived::bridge(time, rows, m, k, held) }
    }
}

/// Columns of N numbers as rows, and what there is in each.
fn rows(columns: &[Values<'_>], n: usize) -> (Vec<f64>, Vec<Census>) {
    // what one thread takes at a time; half of the time of a large record is the system's, which hands out its memory
    const SHARE: usize = 1 << 14;
    let width = columns.len();
    let mut rows = vec![0.0; n * width];
    let counted = |(share, block): (usize, &mut [f64])| interleave(columns, share * SHARE, block);
    let shares: Vec<Vec<Census>> = if n <= SHARE {
        vec![counted((0, &mut rows))]
    } else {
        rows.par_chunks_mut((SHARE * width).max(1)).enumerate().map(counted).collect()
    };
    let mut found = vec![Census::default(); width];
    for share in shares {
        for (all, part) in found.iter_mut().zip(share) {
            all.missing += part.missing;
            all.infinite |= part.infinite;
        }
    }
    (rows, found)
}

/// The rows of a block, which begin at a sample of the columns, and what there is in them.
fn interleave(columns: &[Values<'_>], first: usize, block: &mut [f64]) -> Vec<Census> {
    // what stays in the cache
    const PART: usize = 256;
    let width = columns.len().max(1);
    let mut found = vec![Census::default(); columns.len()];
    let end = first + block.len() / width;
    // columns of one matrix, most likely: its rows are read as they lie
    if let Some(views) = columns.iter().map(|column| column.apart(end)).collect::<Option<Vec<_>>>() {
        for (row, at) in block.chunks_exact_mut(width).zip(first..) {
            for ((place, view), census) in row.iter_mut().zip(&views).zip(&mut found) {
                *place = view[at];
                census.missing += usize::from(place.is_nan());
                census.infinite |= place.is_infinite();
            }
        }
        return found;
    }
    for (part, block) in block.chunks_mut(PART * width).enumerate() {
        let count = block.len() / width;
        for (c, (column, census)) in columns.iter().zip(&mut found).enumerate() {
            let rows = block[c..].iter_mut().step_by(width);
            let from = column.len().min(first + part * PART);
            let values = column.part(from, column.len().min(from + count));
            // without a way out between, so that whole vectors are compared
            census.missing += values.iter().map(|v| usize::from(v.is_nan())).sum::<usize>();
            census.infinite |= values.iter().fold(false, |any, v| any | v.is_infinite());
            rows.zip(values.iter()).for_each(|(row, value)| *row = *value);
        }
    }
    found
}

/// Everything that is wrong with the samples of a run; at least one fault.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RunError {
    /// Name of the run.
    pub run: String,
    /// The faults, independent of each other.
    pub faults: Vec<RunFault>,
}

impl fmt::Display for RunError {
    /// One line for each fault.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (k, fault) in self.faults.iter().enumerate() {
            let newline = if k == 0 { "" } else { "\n" };
            write!(f, "{newline}run `{}`: {fault}", excerpt(&self.run))?;
        }
        Ok(())
    }
}

impl std::error::Error for RunError {}

fn or_nothing(nearest: &Option<String>) -> String {
    nearest.as_ref().map_or_else(String::new, |name| format!("; did you mean `{name}`?"))
}

/// One thing that is wrong with the samples of a run.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum RunFault {
    /// A model with states, delays or explicit time, and no times.
    #[error("no times, which a model with states, delays or `t` needs; give `times`")]
    NoTimes,
    /// A channel of the model without samples.
    #[error("no samples for the {role} `{channel}`{}", .nearest.as_ref().map_or_else(String::new, |name| format!("; is it what was given as `{name}`?")))]
    Missing {
        /// What the channel is to the model.
        role: Role,
        /// Its name.
        channel: String,
        /// The nearest name among those given that the model does not have.
        nearest: Option<String>,
    },
    /// Samples under a name that the model does not have.
    #[error("the model has no channel `{channel}`{}; its channels are {channels}", or_nothing(.nearest))]
    Unknown {
        /// As given.
        channel: String,
        /// The nearest name of the model.
        nearest: Option<String>,
        /// What there is.
        channels: Names,
    },
    /// Samples were given twice.
    #[error("samples of `{channel}` are given more than once")]
    Twice {
        /// Its name.
        channel: String,
    },
    /// Another number of samples than there are times.
    #[error("`{channel}` has {found} samples, expected {expected}, one for each time")]
    Length {
        /// Its name.
        channel: String,
        /// Samples given.
        found: usize,
        /// Times.
        expected: usize,
    },
    /// A sample without bound, or a time that is not a number.
    #[error("sample {sample} of `{channel}` is {value}, expected a finite number{}", if .channel == "t" { "" } else { " (NaN where one is missing)" })]
    NotFinite {
        /// Its name; `t` is the time.
        channel: String,
        /// From 0.
        sample: usize,
        /// As given.
        value: String,
    },
    /// Time that stands still or falls.
    #[error("the time of sample {sample} is {found} behind {before}, expected a later time")]
    NotRising {
        /// From 0.
        sample: usize,
        /// Time of the sample before.
        before: String,
        /// Its own time.
        found: String,
    },
    /// Times that cannot be told apart after conversion.
    #[error("the times cannot be told apart in double precision, expected steps that are not tiny against the record")]
    TimeResolution,
    /// Fewer samples than a simulation needs.
    #[error("{found} samples, expected at least {expected}")]
    TooFew {
        /// Samples given.
        found: usize,
        /// Samples needed.
        expected: usize,
    },
    /// A channel in which every sample is missing.
    #[error("every sample of the {role} `{channel}` is NaN")]
    NoValues {
        /// What the channel is to the model.
        role: Role,
        /// Its name.
        channel: String,
    },
    /// Only inputs are held between samples.
    #[error("`{output}` is an output; only inputs are held between samples")]
    HeldOutput {
        /// Its name.
        output: String,
    },
    /// A unit that cannot be understood.
    #[error("`{unit}`, the unit of `{channel}`, is not a unit that is known")]
    UnknownUnit {
        /// Its name.
        channel: String,
        /// As given.
        unit: String,
    },
    /// A unit for a channel that has none.
    #[error("`{channel}` is given in `{unit}`, and the model declares no unit for it")]
    NoUnit {
        /// Its name.
        channel: String,
        /// As given.
        unit: String,
    },
    /// A unit of another kind of quantity.
    #[error("`{channel}` is given in `{unit}`, which cannot be converted to `{expected}`")]
    OtherUnit {
        /// Its name.
        channel: String,
        /// As given.
        unit: String,
        /// The unit in the model.
        expected: String,
    },
    /// A beginning behind the first sample.
    #[error("the run begins at {begin}, behind its first sample at {first}")]
    BeginBehind {
        /// The beginning.
        begin: String,
        /// Time of the first sample.
        first: String,
    },
    /// A beginning further in front of the record than can be meant.
    #[error(
        "the run begins at {begin}, {lengths} times its length in front of its first sample at {first}: nothing of what begins there is left in it; \
         where the clock's own 0 means nothing, leave the beginning out"
    )]
    BeginFar {
        /// The beginning.
        begin: String,
        /// Time of the first sample.
        first: String,
        /// The distance over the length of the record, as text.
        lengths: String,
    },
    /// The run cannot drive the model.
    #[error(transparent)]
    Incomplete(#[from] Incomplete),
}

impl RunFault {
    fn unknown(name: &str, known: &[&str]) -> Self {
        let nearest = nearest(name, known.iter().copied()).map(String::from);
        Self::Unknown { channel: excerpt(name), nearest, channels: Names::new(known.iter().copied()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fdm_grammar::{Source, compile};

    fn model(text: &str) -> Model {
        compile(&Source::new("m.fdm", text)).expect("a model").model
    }

    fn roll() -> Model {
        model(
            "model m { input u [deg], w [rad/s^2]; state p [rad/s]; param d = 1 [1/s], c = 1 [1/s^2]; \
             der(p) = -d*p + c*deg2rad(u) + w; output y [rad/s] = p; output z [deg/s] = rad2deg(p); }",
        )
    }

    #[test]
    fn channels_come_in_any_order_and_any_unit_and_times_begin_at_zero() {
        let model = roll();
        let build = RunBuilder::new(&model, "a")
            .samples_in("z", "rad/s", [0.0, 1.0, f64::NAN])
            .samples("w", vec![5.0, 6.0, 7.0])
            .times_in("ms", [1000.0, 1500.0, 2500.0])
            .samples("u", [1.0, f64::NAN, 4.0])
            .zero_order_hold("w")
            .samples("y", [0.1, 0.2, 0.3]);
        let run = build.build().expect("a run");
        assert_eq!((run.name.as_str(), run.time.as_slice()), ("a", [0.0, 0.5, 1.5].as_slice()));
        assert_eq!(run.inputs, [1.0, 5.0, 2.0, 6.0, 4.0, 7.0]);
        assert_eq!((run.held, run.input_gaps, run.output_gaps), (vec![false, true], vec![1, 0], vec![0, 1]));
        assert_eq!(run.measured[..3], [0.1, 0.0, 0.2]);
        assert!((run.measured[3] - 180.0 / std::f64::consts::PI).abs() < 1e-12 && run.measured[5].is_nan());
    }

    #[test]
    fn every_mistake_is_named_at_once() {
        let model = roll();
        let error = RunBuilder::new(&model, "a")
            .times([0.0, 1.0, 1.0])
            .samples("uu", [1.0, 2.0, 3.0])
            .samples("w", [1.0, 2.0])
            .samples_in("y", "m", [0.0, f64::INFINITY, 1.0])
            .samples("z", [f64::NAN; 3])
            .samples("z", [0.0; 3])
            .zero_order_hold("y")
            .build()
            .expect_err("mistakes");
        let said = error.to_string();
        let expected = "\
run `a`: the model has no channel `uu`; did you mean `u`?; its channels are `u`, `w`, `y`, `z`
run `a`: samples of `z` are given more than once
run `a`: `y` is an output; only inputs are held between samples
run `a`: the time of sample 2 is 1 behind 1, expected a later time
run `a`: no samples for the input `u`; is it what was given as `uu`?
run `a`: `w` has 2 samples, expected 3, one for each time
run `a`: sample 1 of `y` is inf, expected a finite number (NaN where one is missing)
run `a`: `y` is given in `m`, which cannot be converted to `rad/s`
run `a`: every sample of the output `z` is NaN";
        assert_eq!(said, expected);
    }

    #[test]
    fn times_are_wanted_by_models_that_move_and_counted_for_others() {
        let still = model("model m { input u; param k = 1; output y = k*u; }");
        let run =
            RunBuilder::new(&still, "a").samples("u", [3.0, 4.0]).samples("y", [1.0, 2.0]).build().expect("a run");
        assert_eq!(run.time, [0.0, 1.0]);
        let moving = roll();
        let faults = |builder: RunBuilder<'_>| builder.without_outputs().build().expect_err("no run").faults;
        let driven = RunBuilder::new(&moving, "a").samples("u", [3.0, 4.0]).samples("w", [1.0, 2.0]);
        assert_eq!(faults(driven.clone()), [RunFault::NoTimes]);
        assert!(driven.clone().samples("time", [0.0, 1.0]).without_outputs().build().is_ok());
        assert!(faults(driven.times([0.0, f64::NAN]))[0].to_string().contains("sample 1 of `t` is NaN"));
    }

    #[test]
    fn outputs_that_drive_the_model_become_inputs() {
        let model = model("model m { param k = 1; input u; output a = u; output y = k*measured(a) + u; }");
        let build =
            |a: [f64; 2]| RunBuilder::new(&model, "r").samples("u", [1.0, 2.0]).samples("a", a).samples("y", [0.0; 2]);
        assert_eq!(build([7.0, 8.0]).build().expect("a run").inputs, [1.0, 7.0, 2.0, 8.0]);
        let bare = RunBuilder::new(&model, "r").samples("u", [1.0, 2.0]).without_outputs().build();
        assert!(matches!(bare.expect_err("no drive").faults[..], [RunFault::Incomplete(_)]));
    }
}
