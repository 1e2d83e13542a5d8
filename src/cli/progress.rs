//! Shows that work is going on: a live line on a terminal, a line for each iteration elsewhere, nothing when asked to be quiet.
//! An interrupt ends a fit after the iteration in hand, and what was reached is printed.

use crate::failure::remark;
use crate::live::Shared;
use fdm::estimate::{Iteration, Observer, StartSummary, UnknownName};
use fdm::report::sparkline;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::IsTerminal;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Watches an estimation.
pub(crate) struct Progress {
    bar: ProgressBar,
    lines: bool,
    /// The costs so far, where they are to be watched.
    costs: Option<Vec<f64>>,
    /// Where others read how far it is.
    course: Option<Shared>,
    interrupted: Arc<AtomicBool>,
}

impl Progress {
    /// Of work of which nothing can be kept before its end: an interrupt ends the program at once.
    pub(crate) fn of_a_whole(quiet: bool) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let target = if quiet || !terminal { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
        let bar = ProgressBar::with_draw_target(None, target);
        if let Ok(style) = ProgressStyle::with_template("{spinner} {msg} [{elapsed}]") {
            bar.set_style(style);
        }
        bar.enable_steady_tick(std::time::Duration::from_millis(100));
        Self {
            bar,
            lines: !quiet && !terminal,
            costs: None,
            course: None,
            interrupted: Arc::new(AtomicBool::new(false)),
        }
    }

    /// Live on a terminal; `quiet` says nothing at all. An interrupt ends the work after the iteration in hand.
    pub(crate) fn new(quiet: bool) -> Self {
        let progress = Self::of_a_whole(quiet);
        let interrupted = &progress.interrupted;
        for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
            // a second one ends the program at once; where handlers cannot be had the first does
            let _ = signal_hook::flag::register_conditional_default(signal, Arc::clone(interrupted));
            let _ = signal_hook::flag::register(signal, Arc::clone(interrupted));
        }
        progress
    }

    /// Shows how the cost falls.
    pub(crate) fn watching(mut self, wanted: bool) -> Self {
        self.costs = wanted.then(Vec::new);
        self
    }

    /// Writes down how far it is for others.
    pub(crate) fn told(&mut self, course: Shared) {
        self.course = Some(course);
    }

    /// Says what is being done.
    pub(crate) fn say(&self, text: &str) {
        if let Some(course) = &self.course {
            course.lock().doing = text.to_string();
        }
        self.bar.set_message(text.to_string());
        if self.lines {
            remark(format_args!("{text}"));
        }
    }

    fn flow(&self) -> ControlFlow<()> {
        if self.interrupted.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    /// Set by an interrupt, for work that is not an estimation.
    pub(crate) fn interrupted(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.interrupted)
    }

    /// Ends the live line.
    pub(crate) fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

impl Observer for Progress {
    fn begin(&mut self, names: &dyn Fn() -> Vec<UnknownName>) {
        if let Some(course) = &self.course {
            course.lock().names = names();
        }
    }

    fn values(&mut self, values: &[f64]) {
        if let Some(course) = &self.course {
            course.lock().values = values.to_vec();
        }
    }

    fn iteration(&mut self, iteration: &Iteration) -> ControlFlow<()> {
        if let Some(course) = &self.course {
            let mut course = course.lock();
            // another estimation begins
            if iteration.number == 0 {
                course.history.clear();
            }
            course.history.push(*iteration);
        }
        let Iteration { number, cost, step, refused, .. } = iteration;
        let tried = if *refused > 0 { format!(", {refused} refused") } else { String::new() };
        if *number == 0 {
            self.costs.iter_mut().for_each(Vec::clear);
        }
        let fallen = self.costs.as_mut().map_or(String::new(), |costs| {
            costs.push(*cost);
            format!("   {}", sparkline(costs))
        });
        self.say(&format!(
            "iteration {number:3}   cost {cost:.9e}   largest step {step:.2e} standard errors{tried}{fallen}"
        ));
        self.flow()
    }

    fn start_iteration(&mut self, number: usize, iteration: &Iteration) -> ControlFlow<()> {
        // lines are for those that have ended: many at once would drown them
        let Iteration { number: correction, cost, .. } = iteration;
        self.bar.set_message(format!("start {number}, iteration {correction}, cost {cost:.9e}"));
        self.flow()
    }

    fn start_ended(&mut self, start: &StartSummary, ended: usize, count: usize) -> ControlFlow<()> {
        if let Some(course) = &self.course {
            let mut course = course.lock();
            course.starts.0.push(start.clone());
            course.starts.1 = count;
        }
        let cost = start.cost.map_or(String::from("failed"), |c| format!("cost {c:.9e}"));
        self.say(&format!("{ended} of {count} starts ended   start {}: {cost}, {}", start.number, start.message));
        self.flow()
    }
}

/// How many of several things have ended and how long the rest will take, on a terminal only.
pub(crate) fn counted(count: usize, what: &str) -> ProgressBar {
    let terminal = std::io::stderr().is_terminal() && count > 1;
    let target = if terminal { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
    let bar = ProgressBar::with_draw_target(Some(count as u64), target);
    if let Ok(style) = ProgressStyle::with_template(&format!(
        "{{spinner}} {{pos}} of {{len}} {what} [{{elapsed}}, {{eta}} left] {{msg}}"
    )) {
        bar.set_style(style);
    }
    bar.enable_steady_tick(std::time::Duration::from_millis(200));
    bar
}
