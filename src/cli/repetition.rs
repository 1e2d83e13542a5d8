//! What a series of repeats needs: seed, colour of the noise, a place to keep them, and somebody who watches.

use crate::failure::remark;
use crate::keeping::Keeping;
use clap::{Args, ValueEnum};
use fdm::study::{Colour, Repeat, Watch};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::IsTerminal;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

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
    so_far: Option<SoFar>,
    interrupted: Arc<AtomicBool>,
}

/// The repeats that have ended, for others to read while the rest is at work.
#[derive(Clone)]
pub(crate) struct SoFar(Arc<Mutex<Ended>>);

struct Ended {
    repeats: Vec<Option<Repeat>>,
    /// Those that were there when the first of this program ended, and when that was.
    first: Option<(usize, Instant)>,
}

impl SoFar {
    fn lock(&self) -> MutexGuard<'_, Ended> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
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
        Self { bar, lines: !quiet && !terminal, count, so_far: None, interrupted }
    }

    /// Keeps what came of every repeat for others to read.
    pub(crate) fn remembering(&mut self) -> SoFar {
        let so_far = SoFar(Arc::new(Mutex::new(Ended { repeats: vec![None; self.count], first: None })));
        self.so_far = Some(so_far.clone());
        so_far
    }

    /// Ends the live line.
    pub(crate) fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

impl Watch for Patience {
    fn came(&self, number: u64, repeat: &Repeat) {
        if let Some(so_far) = &self.so_far
            && let Some(place) = so_far.lock().repeats.get_mut(number as usize)
        {
            *place = Some(repeat.clone());
        }
    }

    fn ended(&self, done: usize) {
        if let Some(so_far) = &self.so_far {
            so_far.lock().first.get_or_insert((done, Instant::now()));
        }
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
