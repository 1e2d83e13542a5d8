//! Shows that work is going on: a live line on a terminal, a line every five seconds at most elsewhere, nothing when asked to be quiet.
//! An interrupt ends a fit after the iteration in hand, and what was reached is printed.

use crate::failure::remark;
use crate::halt::{TimeLimit, in_time_or};
use crate::progress_file::{Course, CourseWriter};
use fdm_estimate::{Halt, Iteration, Observer, StartSummary, UnknownName, Work};
use fdm_lab::study::Repeat;
use fdm_report::{sparkline, visible};
use fdm_system::Model;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::IsTerminal;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// A live line on standard error, where that is a terminal and `shown`.
fn bar(length: Option<u64>, shown: bool, template: &str, tick: u64) -> ProgressBar {
    let shown = shown && std::io::stderr().is_terminal();
    let target = if shown { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
    let bar = ProgressBar::with_draw_target(length, target);
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style);
    }
    bar.enable_steady_tick(Duration::from_millis(tick));
    bar
}

/// Least time between two lines that take the place of the live one.
const PAUSE: Duration = Duration::from_secs(5);

/// When a line was told last.
struct Pace(Option<Instant>);

impl Pace {
    fn admits(&mut self, now: Instant) -> bool {
        let admitted = self.0.is_none_or(|last| now.duration_since(last) >= PAUSE);
        if admitted {
            self.0 = Some(now);
        }
        admitted
    }
}

/// Says how far the work is, unless something was said a moment ago.
fn line(text: std::fmt::Arguments<'_>) {
    static PACE: Mutex<Pace> = Mutex::new(Pace(None));
    if PACE.lock().unwrap_or_else(PoisonError::into_inner).admits(Instant::now()) {
        remark(text);
    }
}

/// Whether lines take the place of the live one.
fn in_lines(quiet: bool) -> bool {
    !quiet && !std::io::stderr().is_terminal()
}

/// How many of several things have ended and how long the rest will take, on a terminal only.
pub(crate) fn counted(count: usize, what: &str) -> ProgressBar {
    let template = format!("{{spinner}} {{pos}} of {{len}} {what} [{{elapsed}}, {{eta}} left] {{msg}}");
    bar(Some(count as u64), count > 1, &template, 200)
}

/// Follows work.
pub(crate) struct Progress {
    bar: ProgressBar,
    lines: bool,
    /// The costs so far, where they are to be watched.
    costs: Option<Mutex<Vec<f64>>>,
    /// Where others read how far it is.
    course: Option<Course>,
    halt: Halt,
    /// Whether nothing at all is to be said.
    silent: bool,
}

impl Progress {
    /// Live on a terminal; `quiet` says nothing at all. An interrupt ends the work after what is in hand.
    pub(crate) fn new(quiet: bool) -> Self {
        let bar = bar(None, !quiet, "{spinner} {msg} [{elapsed}]", 100);
        let progress =
            Self { bar, lines: in_lines(quiet), costs: None, course: None, halt: Halt::default(), silent: false };
        let interrupted = progress.halt.flag();
        for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
            // a second one ends the program at once; where handlers cannot be had the first does
            let _ = signal_hook::flag::register_conditional_default(signal, Arc::clone(interrupted));
            let _ = signal_hook::flag::register(signal, Arc::clone(interrupted));
        }
        progress
    }

    /// Shows nothing; writes down how far it is, and ends the work when `halt` says so.
    pub(crate) fn hidden(halt: Halt, course: Course) -> Self {
        let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::hidden());
        Self { bar, lines: false, costs: None, course: Some(course), halt, silent: true }
    }

    /// Ends the work when the time is over, too.
    pub(crate) fn within(mut self, limit: &TimeLimit) -> Self {
        self.halt = self.halt.at(limit.deadline());
        self
    }

    /// Shows how the cost falls.
    pub(crate) fn watching(mut self, wanted: bool) -> Self {
        self.costs = wanted.then(Mutex::default);
        self
    }

    /// Writes down beside these folders how far the work on a model is; nothing where there are none.
    pub(crate) fn follow(&mut self, folders: Vec<PathBuf>, model: &Model) -> (CourseWriter, Course) {
        let course = Course::default();
        if !folders.is_empty() {
            self.course = Some(course.clone());
        }
        (CourseWriter::begin(folders, model, course.clone()), course)
    }

    /// Says what is being done.
    pub(crate) fn say(&self, text: &str) {
        if let Some(course) = &self.course {
            course.lock().doing = text.to_string();
        }
        self.bar.set_message(visible(text).into_owned());
        if self.lines {
            line(format_args!("{text}"));
        }
    }

    /// Work that is followed here.
    pub(crate) fn work(&self) -> Work<'_> {
        Work::until(&self.halt).telling(self)
    }

    /// When to end.
    pub(crate) fn halt(&self) -> &Halt {
        &self.halt
    }

    /// Ends the live line.
    pub(crate) fn finish(&self) {
        self.bar.finish_and_clear();
    }

    /// Says so where the time limit has ended the work; says whether it has not.
    pub(crate) fn in_time(&self) -> bool {
        self.in_time_or("the result is the best so far")
    }

    /// As [`Self::in_time`], with what there is to be said of the result.
    pub(crate) fn in_time_or(&self, result: &str) -> bool {
        if self.silent { !self.halt.ran_out_of_time() } else { in_time_or(&self.halt, result) }
    }
}

impl Observer for Progress {
    fn begin(&self, names: &dyn Fn() -> Vec<UnknownName>) {
        if let Some(course) = &self.course {
            course.lock().names = names();
        }
    }

    fn doing(&self, what: &str) {
        if let Some(course) = &self.course {
            course.lock().doing = what.to_string();
        }
        self.bar.set_message(what.to_string());
    }

    fn stage(&self, what: &str) {
        self.say(what);
    }

    fn values(&self, values: &[f64]) {
        if let Some(course) = &self.course {
            course.lock().values = values.to_vec();
        }
    }

    fn iteration(&self, iteration: &Iteration) {
        if let Some(course) = &self.course {
            let mut course = course.lock();
            // another estimation begins
            if iteration.number == 0 {
                course.history.clear();
            }
            course.history.push(*iteration);
        }
        let Iteration { number, cost, step, refused, .. } = iteration;
        let tried = if *refused > 0 { format!(", {refused} rejected") } else { String::new() };
        let fallen = self.costs.as_ref().map_or(String::new(), |costs| {
            let mut costs = costs.lock().unwrap_or_else(PoisonError::into_inner);
            if *number == 0 {
                costs.clear();
            }
            costs.push(*cost);
            format!("   {}", sparkline(&costs))
        });
        self.say(&format!(
            "iteration {number:3}   cost {cost:.9e}   largest step {step:.2e} standard errors{tried}{fallen}"
        ));
    }

    fn start_iteration(&self, number: usize, iteration: &Iteration) {
        // lines are for those that have ended: many at once would drown them
        let Iteration { number: of_start, cost, .. } = iteration;
        self.bar.set_message(format!("start {number}, iteration {of_start}, cost {cost:.9e}"));
    }

    fn start_ended(&self, start: &StartSummary, ended: usize, count: usize) {
        if let Some(course) = &self.course {
            let mut course = course.lock();
            course.starts.0.push(start.clone());
            course.starts.1 = count;
        }
        let cost = start.cost.map_or(String::from("failed"), |c| format!("cost {c:.9e}"));
        self.say(&format!("{ended} of {count} starts ended   start {}: {cost}, {}", start.number, start.message));
    }
}

/// Watches the repeats of a Monte Carlo study: a bar with the time that is left on a terminal, a line now and then elsewhere. An
/// interrupt gives up the repeats at work.
pub(crate) struct RepeatProgress {
    bar: ProgressBar,
    lines: bool,
    count: usize,
    so_far: Option<RepeatsSoFar>,
    halt: Halt,
}

/// The repeats that have ended, for others to read while the rest is at work.
#[derive(Clone)]
pub(crate) struct RepeatsSoFar(Arc<Mutex<Ended>>);

struct Ended {
    repeats: Vec<Option<Repeat>>,
    /// Those that were there when the first of this program ended, and when that was.
    first: Option<(usize, Instant)>,
}

impl RepeatsSoFar {
    fn lock(&self) -> MutexGuard<'_, Ended> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// How many there are, and of how many.
    pub(crate) fn counts(&self) -> (usize, usize) {
        let ended = self.lock();
        (ended.repeats.iter().flatten().count(), ended.repeats.len())
    }

    /// All of them by number, and the seconds that the others will take as far as can be told.
    pub(crate) fn read(&self) -> (Vec<Option<Repeat>>, Option<f64>) {
        let ended = self.lock();
        let done = ended.repeats.iter().flatten().count();
        let left = ended.first.filter(|(before, _)| done > *before).map(|(before, since)| {
            (ended.repeats.len() - done) as f64 * since.elapsed().as_secs_f64() / (done - before) as f64
        });
        (ended.repeats.clone(), left)
    }
}

impl RepeatProgress {
    /// Of so many repeats of something that has a name, or none.
    pub(crate) fn new(name: &str, count: usize, quiet: bool, halt: Halt) -> Self {
        let template = "{spinner} {msg} {bar:30} {pos} of {len} repeats [{elapsed}, {eta} left]";
        let bar = bar(Some(count as u64), !quiet, template, 200).with_message(visible(name).into_owned());
        Self { bar, lines: in_lines(quiet), count, so_far: None, halt }
    }

    /// Keeps what came of every repeat for others to read.
    pub(crate) fn remembering(&mut self) -> RepeatsSoFar {
        let so_far = RepeatsSoFar(Arc::new(Mutex::new(Ended { repeats: vec![None; self.count], first: None })));
        self.so_far = Some(so_far.clone());
        so_far
    }

    /// Work that is followed here.
    pub(crate) fn work(&self) -> Work<'_> {
        Work::until(&self.halt).telling(self)
    }

    /// What came of one of them, by its number.
    pub(crate) fn came(&self, number: u64, repeat: &Repeat) {
        if let Some(so_far) = &self.so_far
            && let Some(place) = so_far.lock().repeats.get_mut(number as usize)
        {
            *place = Some(repeat.clone());
        }
    }

    /// Ends the live line.
    pub(crate) fn finish(&self) {
        self.bar.finish_and_clear();
    }

    fn prefix(&self) -> String {
        let name = self.bar.message();
        if name.is_empty() { name } else { format!("{name}: ") }
    }
}

impl Observer for RepeatProgress {
    fn parts_ended(&self, done: usize) {
        if let Some(so_far) = &self.so_far {
            so_far.lock().first.get_or_insert((done, Instant::now()));
        }
        self.bar.set_position(done as u64);
        let tenth = (self.count / 10).max(1);
        if self.lines && done > 0 && done.is_multiple_of(tenth) {
            line(format_args!("{}{done} of {} repeats", self.prefix(), self.count));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pipe_hears_a_line_in_five_seconds() {
        let (begun, mut pace) = (Instant::now(), Pace(None));
        let told = |k: &u64| pace.admits(begun + Duration::from_millis(20 * k));
        assert_eq!((0..700).filter(told).count(), 3, "in 14 seconds");
    }
}
