//! Time that the processor gives to a thread: what else the machine does takes nothing off the patience of a test.

use rustix::time::{ClockId, clock_gettime};
use std::time::Duration;

/// What a piece of work gives, and the processor time that this thread spends on it.
pub(crate) fn timed<T>(work: impl FnOnce() -> T) -> (T, Duration) {
    let now = || {
        let time = clock_gettime(ClockId::ThreadCPUTime);
        Duration::new(time.tv_sec.unsigned_abs(), u32::try_from(time.tv_nsec).unwrap_or(0))
    };
    let start = now();
    let result = work();
    (result, now().saturating_sub(start))
}
