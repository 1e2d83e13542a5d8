//! Shows that work is going on: a live line on a terminal, a line for each iteration elsewhere, nothing when asked to be quiet.

use fdm::estimate::{Iteration, Observer};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::IsTerminal;
use std::ops::ControlFlow;

/// Watches an estimation.
pub(crate) struct Progress {
    bar: ProgressBar,
    lines: bool,
}

impl Progress {
    /// Live on a terminal; `quiet` says nothing at all.
    pub(crate) fn new(quiet: bool) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let target = if quiet || !terminal { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
        let bar = ProgressBar::with_draw_target(None, target);
        if let Ok(style) = ProgressStyle::with_template("{spinner} {msg} [{elapsed}]") {
            bar.set_style(style);
        }
        bar.enable_steady_tick(std::time::Duration::from_millis(100));
        Self { bar, lines: !quiet && !terminal }
    }

    /// Says what is being done.
    #[allow(clippy::print_stderr, reason = "this is where the command line speaks")]
    pub(crate) fn say(&self, text: &str) {
        self.bar.set_message(text.to_string());
        if self.lines {
            eprintln!("{text}");
        }
    }

    /// Ends the live line.
    pub(crate) fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

impl Observer for Progress {
    fn iteration(&mut self, iteration: &Iteration) -> ControlFlow<()> {
        let Iteration { number, cost, step, refused, .. } = iteration;
        let tried = if *refused > 0 { format!(", {refused} refused") } else { String::new() };
        self.say(&format!("iteration {number:3}   cost {cost:.9e}   largest step {step:.2e} standard errors{tried}"));
        ControlFlow::Continue(())
    }
}
