//! What a series of repeats needs: seed, colour of the noise, a place to keep them, and somebody who watches.

use crate::failure::remark;
use crate::keeping::Keeping;
use clap::{Args, ValueEnum};
use fdm::study::{Colour, Watch};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::IsTerminal;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// What decides the noise of repeats.
#[derive(Debug, Args)]
#[command(next_help_heading = "Repeats")]
pub(crate) struct Repetition {
    /// Decides the noise of all repeats; the same seed gives the same ones
    #[arg(long, value_name = "S", default_value_t = 0, allow_negative_numbers = true)]
    pub(crate) seed: u64,
    /// Colour of the noise that the repeats get [default: white, for experiments as they describe it]
    #[arg(long, value_name = "COLOUR", value_enum, value_delimiter = ',')]
    noise_colour: Vec<Tint>,
    #[command(flatten)]
    pub(crate) keeping: Keeping,
}

/// Colours as they are typed.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum Tint {
    /// No sample knows of another
    White,
    /// As the residuals have it: the autoregression by which errors are corrected
    Fitted,
    /// Neighbouring samples correlate by 0.9
    Lag,
    /// Power falls as one over the frequency
    Pink,
}

impl Repetition {
    /// The colours that were asked for.
    pub(crate) fn colours(&self) -> Vec<Colour> {
        let colour = |tint: &Tint| match tint {
            Tint::White => Colour::White,
            Tint::Fitted => Colour::Fitted,
            Tint::Lag => Colour::Lag,
            Tint::Pink => Colour::Pink,
        };
        self.noise_colour.iter().map(colour).collect()
    }

    /// The options that were given.
    pub(crate) fn given(&self) -> Vec<&'static str> {
        let given = [
            ("--seed", self.seed != 0),
            ("--noise-colour", !self.noise_colour.is_empty()),
            ("--checkpoint", self.keeping.is_asked()),
        ];
        given.into_iter().filter(|(_, given)| *given).map(|(name, _)| name).collect()
    }
}

/// A bar with the time that is left on a terminal, a line now and then elsewhere. An interrupt gives up the repeats at work.
pub(crate) struct Patience {
    bar: ProgressBar,
    lines: bool,
    count: usize,
    interrupted: Arc<AtomicBool>,
}

impl Patience {
    pub(crate) fn new(name: &str, count: usize, quiet: bool, interrupted: Arc<AtomicBool>) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let target = if quiet || !terminal { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
        let bar = ProgressBar::with_draw_target(Some(count as u64), target).with_message(name.to_string());
        let template = "{spinner} {msg} {bar:30} {pos} of {len} repeats [{elapsed}, {eta} left]";
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style);
        }
        bar.enable_steady_tick(std::time::Duration::from_millis(200));
        Self { bar, lines: !quiet && !terminal, count, interrupted }
    }

    /// Ends the live line.
    pub(crate) fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

impl Watch for Patience {
    fn ended(&self, done: usize) {
        self.bar.set_position(done as u64);
        let tenth = (self.count / 10).max(1);
        if self.lines && done > 0 && done.is_multiple_of(tenth) {
            remark(format_args!("{}{done} of {} repeats", self.prefix(), self.count));
        }
    }

    fn goes_on(&self) -> bool {
        !self.interrupted.load(Ordering::Relaxed)
    }
}

impl Patience {
    fn prefix(&self) -> String {
        let name = self.bar.message();
        if name.is_empty() { name } else { format!("{name}: ") }
    }
}
