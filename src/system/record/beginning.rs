//! Where a run begins: the instant that is the model's time 0. It is the first sample, unless it is said (`--begin 0`); then what lies between the two is
//! simulated and not compared.

use super::channel::{Source, stated, uses_time};
use super::error::{Fault, Problem};
use super::note::Note;
use super::options::ReadOptions;
use super::read::Summary;
use super::run::Run;
use fdm_grammar::Model;
use fdm_grammar::graph::{Graph, Leaf, Signal};
use fdm_grammar::model::Origin;
use fdm_grammar::op::ExprId;

/// What stands in front of the first sample that is compared.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Lead {
    /// Where the run begins, as it stands in the file; none where that is the first sample.
    pub(crate) begin: Option<f64>,
    /// Whether no row of the file stands there, so that the run gets one.
    extra: bool,
    /// Rows of the file that drive the model and are not compared.
    driven: usize,
}

/// Lengths of a record beyond which a beginning in front of it cannot be meant: what changes by a hundredth within the record, about the least that is seen
/// there, has decayed to `exp(-0.01*1000) = 5e-5` by then. Clocks that count from 1970 or from when a logger was switched on are further off.
const FARTHEST: f64 = 1000.0;

/// How many lengths of a record (rising times) a beginning lies in front of it, where that is too many.
pub(super) fn too_far(time: &[f64], begin: f64) -> Option<f64> {
    let (first, last) = (*time.first()?, *time.last()?);
    // a single sample has no length
    let times = (first - begin) / (last - first);
    (last > first && times > FARTHEST).then_some(times)
}

/// What stands in front of the first of these samples (times as in the file, at least one) that is compared.
///
/// # Errors
/// A beginning that is no number, behind the first sample, too far in front of it, or of a model that knows no time.
pub(crate) fn lead(time: &[f64], options: &ReadOptions, timed: bool) -> Result<Lead, Vec<Problem>> {
    let Some(begin) = options.beginning() else { return Ok(Lead { begin: None, extra: false, driven: 0 }) };
    let first = time.first().copied().unwrap_or(f64::NAN);
    if !timed {
        return Err(vec![Fault::BeginUntimed.anywhere().hint("leave it out")]);
    }
    if !begin.is_finite() || begin > first {
        let fault = Fault::BeginBehind { begin: begin.to_string(), first: first.to_string() };
        return Err(vec![fault.anywhere().hint(format!("--from {begin} cuts the record there"))]);
    }
    if let Some(times) = too_far(time, begin) {
        let (begin, times) = (begin.to_string(), format!("{times:.0}"));
        let fault = Fault::BeginFar { begin, first: first.to_string(), times };
        let hint = format!("where the clock's own 0 means nothing, leave it out or write --begin {first}");
        return Err(vec![fault.anywhere().hint(hint)]);
    }
    let from = options.from.unwrap_or(f64::NEG_INFINITY);
    Ok(Lead { begin: Some(begin), extra: begin < first, driven: time.iter().take_while(|t| **t < from).count() })
}

impl Lead {
    /// Of a run from memory, whose times (N) count from its beginning already.
    pub(crate) fn of_run(time: &[f64], begin: Option<f64>) -> Self {
        Self { begin, extra: begin.is_some() && time.first().is_some_and(|first| *first > 0.0), driven: 0 }
    }

    /// Rows in front of the first one of the file.
    pub(crate) fn before(&self) -> usize {
        usize::from(self.extra)
    }

    /// All rows that are not compared.
    pub(crate) fn rows(&self) -> usize {
        self.before() + self.driven
    }

    /// Puts the beginning in front of the rows of a run, where it needs one: inputs (N by m) as in the first row, nothing measured (N by q).
    pub(crate) fn put_in_front(
        &self,
        time: &mut Vec<f64>,
        (inputs, m): (&mut Vec<f64>, usize),
        (measured, q): (&mut Vec<f64>, usize),
    ) {
        if self.extra {
            time.insert(0, 0.0);
            let first = inputs[..m].to_vec();
            inputs.splice(..0, first);
            measured.splice(..0, std::iter::repeat_n(f64::NAN, q));
        }
    }

    /// Takes the measured values of its rows out of the comparison.
    pub(crate) fn uncompared(&self, run: &mut Run) {
        let q = run.output_gaps.len();
        run.measured[..self.rows() * q].fill(f64::NAN);
    }

    /// What is said of it; `first` is the time of the first row of the file that is used.
    pub(crate) fn note(&self, first: f64, time: Option<&Source>, driven: bool) -> Option<Note> {
        let begin = self.begin.filter(|_| self.rows() > 0)?;
        let unit = time.and_then(|source| source.unit.clone()).unwrap_or_default();
        let kept = self.extra && driven;
        Some(Note::Begins { begin, first, unit, kept, rows: self.driven })
    }
}

/// The first time of a record, where nobody said where the run begins, and the record's own 0 may be meant: it lies in the record, or in front of it
/// by no more than the record lasts. Clocks that count from 1970, from midnight or from when a logger was switched on are further off as a rule, and
/// their 0 means nothing.
pub(crate) fn in_question(time: &[f64], source: Option<&Source>, options: &ReadOptions) -> Option<f64> {
    let (first, last) = (*time.first()?, *time.last()?);
    let said = options.beginning().is_some() || options.from.is_some();
    let counts = source.is_some_and(|source| !source.clock);
    let near = first > 0.0 && first <= last - first || first < 0.0 && last > 0.0;
    (counts && !said && near).then_some(first)
}

/// What is said where a record may begin at another instant than its first row: that row is at another time than the record's 0, and it makes a
/// difference to the model which of the two is its time 0. It makes none where initial values are free or taken from the first sample, and where the
/// model rests at those that are stated.
pub fn questioned(model: &Model, run: &Run, summary: &Summary) -> Option<Note> {
    let first = summary.question?;
    let unit = summary.sources.iter().find(|s| s.channel == "t").and_then(|s| s.unit.clone()).unwrap_or_default();
    let states = stated(model);
    let explicit = uses_time(model);
    let moves = !states.is_empty() && !rests(model, run);
    let names = |k: &usize| model.states[*k].quantity.name.clone();
    let states: Vec<String> = if moves { states.iter().map(names).collect() } else { Vec::new() };
    (moves || explicit).then_some(Note::FirstRow { first, unit, states, explicit })
}

/// Whether the model stays where it is at its initial values, as long as inputs have their first values. With values of its own in every run nobody
/// knows.
fn rests(model: &Model, run: &Run) -> bool {
    let own = model.params.iter().any(|p| p.per_run && !p.fixed);
    let input = |k: u32| run.inputs.get(k as usize).copied().unwrap_or(f64::NAN);
    let param = |k: u32| match model.params[k as usize].origin {
        Origin::FirstSample(of) => input(of),
        _ => model.params[k as usize].value,
    };
    let by_params = |graph: &Graph, e: ExprId| {
        graph.evaluate(e, |leaf| if let Leaf::Param(k) = leaf { param(k) } else { f64::NAN })
    };
    let initial: Vec<f64> = model.states.iter().map(|s| by_params(&model.graph, s.initial)).collect();
    let signal = |signal: Signal| match signal {
        Signal::State(k) => initial[k as usize],
        Signal::Input(k) => input(k),
    };
    let rate = |e: ExprId| {
        model.graph.evaluate(e, |leaf| match leaf {
            Leaf::Time => 0.0,
            Leaf::State(k) => initial[k as usize],
            Leaf::Input(k) => input(k),
            Leaf::Param(k) => param(k),
            Leaf::Delayed(k) => signal(model.graph.delayed()[k as usize].signal),
        })
    };
    !own && model.states.iter().all(|s| rate(s.rate) == 0.0)
}
