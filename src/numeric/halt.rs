//! When work ends before it is done: by an interrupt, when the time that was given is over, or when its caller says so.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// Why work ends before it is done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stop {
    /// Somebody asked for the end.
    Interrupt,
    /// The time that was given is over.
    TimeLimit,
    /// The iterations that were given are used up.
    Iterations,
}

/// What a caller answers when work asks whether it is to end.
type Asked = dyn Fn() -> Option<Stop> + Send + Sync;

/// Tells work that it is to end; its clones end together. The default one never does by itself.
#[derive(Clone, Default)]
pub struct Halt {
    interrupted: Arc<AtomicBool>,
    deadline: Option<Instant>,
    /// Whether anything was told that the time is over.
    over: Arc<AtomicBool>,
    asked: Option<Arc<Asked>>,
}

impl Halt {
    /// Ends work when `asked` gives a reason; work asks often, and from many threads.
    pub fn asking(asked: impl Fn() -> Option<Stop> + Send + Sync + 'static) -> Self {
        Self { asked: Some(Arc::new(asked)), ..Self::default() }
    }

    /// Ends work at this time too.
    #[must_use]
    pub fn at(self, deadline: Option<Instant>) -> Self {
        Self { deadline, ..self }
    }

    /// Ends together with this one, but what it ends has not run out of time (see [`Self::ran_out_of_time`]): for what a result can
    /// do without.
    #[must_use]
    pub fn aside(&self) -> Self {
        Self { over: Arc::default(), ..self.clone() }
    }

    /// Ends work when this is set, by a signal for one.
    pub fn flag(&self) -> &Arc<AtomicBool> {
        &self.interrupted
    }

    /// Asks for the end.
    pub fn interrupt(&self) {
        self.interrupted.store(true, Ordering::Relaxed);
    }

    /// Whether somebody asked for the end.
    pub fn is_interrupted(&self) -> bool {
        self.interrupted.load(Ordering::Relaxed)
    }

    /// Why work is to end; none while it may go on.
    pub fn stop(&self) -> Option<Stop> {
        if self.is_interrupted() {
            return Some(Stop::Interrupt);
        }
        if self.deadline.is_some_and(|deadline| Instant::now() >= deadline) {
            self.over.store(true, Ordering::Relaxed);
            return Some(Stop::TimeLimit);
        }
        self.asked.as_ref().and_then(|asked| asked())
    }

    /// Whether work may go on.
    pub fn goes_on(&self) -> bool {
        self.stop().is_none()
    }

    /// Whether work was ended by the time limit.
    pub fn ran_out_of_time(&self) -> bool {
        self.over.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn work_ends_when_the_time_is_over_and_only_then() {
        let halt = Halt::default().at(Instant::now().checked_add(Duration::from_secs(1000)));
        assert!(halt.goes_on() && !halt.ran_out_of_time());
        let halt = Halt::default().at(Some(Instant::now()));
        // nothing was ended as long as nothing has asked
        assert!(!halt.ran_out_of_time());
        assert_eq!(halt.aside().stop(), Some(Stop::TimeLimit));
        assert!(!halt.ran_out_of_time());
        assert_eq!(halt.stop(), Some(Stop::TimeLimit));
        assert!(halt.clone().ran_out_of_time());
        halt.interrupt();
        assert_eq!(halt.stop(), Some(Stop::Interrupt));
        assert_eq!(Halt::asking(|| Some(Stop::Iterations)).stop(), Some(Stop::Iterations));
    }
}
