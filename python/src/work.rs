//! Long work: the interpreter's lock is released, Ctrl-C is looked for, progress is told, and what has been reached is kept.

use crate::errors::lost;
use fdm::request::{Seen, Watch};
use pyo3::exceptions::{PyKeyboardInterrupt, PyRuntimeError, PyStopIteration};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::num::NonZeroUsize;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// How long the calling thread waits before it looks at signals again.
const PAUSE: Duration = Duration::from_millis(50);
/// Deep models are simplified on the stack.
const STACK: usize = 16 << 20;

/// The threads at work, of the process that made them: a child of a fork has none of its parent's.
struct Threads {
    process: u32,
    pool: Arc<ThreadPool>,
}

static THREADS: Mutex<Option<Threads>> = Mutex::new(None);

/// The threads of this process.
fn pool() -> PyResult<Arc<ThreadPool>> {
    let mut threads = THREADS.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(own) = threads.as_ref().filter(|t| t.process == std::process::id()) {
        return Ok(Arc::clone(&own.pool));
    }
    let own = made(None)?;
    // dropping the pool of a parent would wait for threads that are not there
    std::mem::forget(threads.replace(Threads { process: std::process::id(), pool: Arc::clone(&own) }));
    Ok(own)
}

fn made(count: Option<NonZeroUsize>) -> PyResult<Arc<ThreadPool>> {
    let builder = ThreadPoolBuilder::new().num_threads(count.map_or(0, NonZeroUsize::get)).stack_size(STACK);
    let pool = builder.thread_name(|k| format!("fdm-{k}")).build();
    pool.map(Arc::new).map_err(|e| PyRuntimeError::new_err(e.to_string()))
}

/// Number of threads of all work that begins from now on; no number bits depend on it.
#[pyfunction]
pub(crate) fn set_threads(count: Option<NonZeroUsize>) -> PyResult<()> {
    let own = made(count)?;
    let mut threads = THREADS.lock().unwrap_or_else(PoisonError::into_inner);
    let before = threads.replace(Threads { process: std::process::id(), pool: own });
    if before.as_ref().is_some_and(|t| t.process != std::process::id()) {
        std::mem::forget(before);
    }
    Ok(())
}

/// Number of threads.
#[pyfunction]
pub(crate) fn threads() -> PyResult<usize> {
    Ok(pool()?.current_num_threads())
}

/// Why work was stopped.
enum Stopped {
    /// By Ctrl-C.
    Interrupt,
    /// By the function that is told the progress, which raised this.
    Raised(PyErr),
}

/// Does work on other threads; says whether it was interrupted. A second Ctrl-C is not waited for: it is raised when the part in hand
/// has ended.
pub(crate) fn watched<T: Send>(
    py: Python<'_>,
    progress: Option<Py<PyAny>>,
    work: impl FnOnce(&Watch) -> T + Send,
) -> PyResult<(T, bool)> {
    let (pool, watch) = (pool()?, Watch::default());
    let (own, mut stopped) = (watch.clone(), None);
    let found = py.detach(|| {
        pool.in_place_scope(|scope| {
            let (sender, receiver) = channel();
            // nobody listens any more only after this one has been heard
            scope.spawn(move |_| _ = sender.send(work(&own)));
            loop {
                match receiver.recv_timeout(PAUSE) {
                    Ok(found) => return Some(found),
                    Err(RecvTimeoutError::Disconnected) => return None,
                    Err(RecvTimeoutError::Timeout) => {
                        Python::attach(|py| look(py, progress.as_ref(), &watch, &mut stopped))
                    }
                }
            }
        })
    });
    let found = found.ok_or_else(lost)?;
    match stopped {
        Some(Stopped::Raised(error)) => Err(error),
        stopped => Ok((found, stopped.is_some())),
    }
}

/// Looks for signals and tells the progress; either may stop the work.
fn look(py: Python<'_>, progress: Option<&Py<PyAny>>, watch: &Watch, stopped: &mut Option<Stopped>) {
    let signalled = py.check_signals();
    let told = match progress.filter(|_| stopped.is_none()) {
        Some(progress) => tell(py, progress, &watch.seen()),
        None => Ok(()),
    };
    let Err(error) = signalled.and(told) else { return };
    watch.stop();
    let quietly = error.is_instance_of::<PyKeyboardInterrupt>(py) || error.is_instance_of::<PyStopIteration>(py);
    *stopped = Some(if quietly && stopped.is_none() { Stopped::Interrupt } else { Stopped::Raised(error) });
}

/// Calls the function with what can be seen of the work.
fn tell(py: Python<'_>, progress: &Py<PyAny>, seen: &Seen) -> PyResult<()> {
    let dict = PyDict::new(py);
    dict.set_item("doing", &seen.doing)?;
    dict.set_item("iteration", seen.iteration.map(|i| i.number))?;
    dict.set_item("cost", seen.iteration.map(|i| i.cost))?;
    dict.set_item("step", seen.iteration.map(|i| i.step))?;
    dict.set_item("done", seen.counted.map(|(done, _)| done))?;
    dict.set_item("total", seen.counted.map(|(_, total)| total))?;
    let values = PyDict::new(py);
    for (name, value) in &seen.values {
        match &name.run {
            None => values.set_item(&name.name, value)?,
            Some(run) => values.set_item((&name.name, run), value)?,
        }
    }
    dict.set_item("values", values)?;
    progress.call1(py, (dict,)).map(|_| ())
}
