//! CPU time of this process, medians, and rows of results.

use rustix::time::{ClockId, clock_gettime};

/// Seconds of CPU charged to this process.
pub(crate) fn cpu_seconds() -> f64 {
    let t = clock_gettime(ClockId::ProcessCPUTime);
    t.tv_sec as f64 + 1e-9 * t.tv_nsec as f64
}

/// Keeps this process and its children on one core; says which.
pub(crate) fn pin() -> String {
    let mut cores = rustix::thread::CpuSet::new();
    cores.set(0);
    match rustix::thread::sched_setaffinity(None, &cores) {
        Ok(()) => "core 0".into(),
        Err(e) => format!("not pinned: {e}"),
    }
}

/// Median over at least seven runs and at least a second, after one run to warm up.
pub(crate) fn median_of_runs(mut f: impl FnMut()) -> f64 {
    f();
    let (start, mut times) = (std::time::Instant::now(), Vec::new());
    while times.len() < 7 || (start.elapsed().as_secs_f64() < 1.0 && times.len() < 20_000) {
        let before = cpu_seconds();
        f();
        times.push(cpu_seconds() - before);
    }
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

/// Median wall time over at least a second, after one run to warm up.
pub(crate) fn wall_of_runs(mut f: impl FnMut()) -> f64 {
    f();
    let (start, mut times) = (std::time::Instant::now(), Vec::new());
    while times.len() < 7 || start.elapsed().as_secs_f64() < 1.0 {
        let before = std::time::Instant::now();
        f();
        times.push(before.elapsed().as_secs_f64());
    }
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

/// One measured figure.
pub(crate) struct Row {
    /// Workload, as in docs/notebook/decisions.md.
    pub(crate) workload: String,
    /// Who ran it.
    pub(crate) tool: String,
    /// Which unit of work.
    pub(crate) what: String,
    /// Median.
    pub(crate) seconds: f64,
    /// Largest relative difference from the reference, the cost reached for fits; `None` without reference data.
    pub(crate) difference: Option<f64>,
}

impl Row {
    /// A row of the peers' JSON lines.
    pub(crate) fn parse(line: &str) -> Option<Self> {
        let value: serde_json::Value = serde_json::from_str(line).ok()?;
        let text = |key: &str| value.get(key)?.as_str().map(String::from);
        Some(Self {
            workload: text("workload")?,
            tool: text("tool")?,
            what: text("what")?,
            seconds: value.get("median_s")?.as_f64()?,
            difference: value.get("value")?.as_f64(),
        })
    }

    /// Prints the row and its ratio to the same unit among `limit`.
    pub(crate) fn print(&self, limit: &[Self]) {
        let same = limit.iter().find(|l| l.workload == self.workload && unit(&l.what) == unit(&self.what));
        let ratio = same.map_or(String::from("      -"), |l| format!("{:7.2}", self.seconds / l.seconds));
        let difference = match self.difference {
            None => "no reference".into(),
            Some(cost) if self.what.starts_with('B') => format!("cost {cost:.9}"),
            Some(d) => format!("difference {d:.1e}"),
        };
        println!(
            "{:8} {:60} {:28} {:12.1} us  x limit {ratio}  {difference}",
            self.workload,
            self.tool,
            self.what,
            1e6 * self.seconds,
        );
    }
}

/// The unit of work without what a tool adds in brackets.
fn unit(what: &str) -> &str {
    match what.split(" (").next().unwrap_or(what) {
        "B ML fit" => "B fit",
        unit => unit,
    }
}
