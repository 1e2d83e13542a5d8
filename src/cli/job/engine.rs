//! Engines that start programs on many machines, and the scripts by which they start the shards of a plan.

use clap::ValueEnum;
use std::path::Path;

/// An engine.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Engine {
    /// GNU parallel, on one machine or over ssh
    Parallel,
    /// Slurm: an array of jobs that may be preempted and queued again
    Slurm,
    /// HyperQueue: an array of tasks, on one machine or inside jobs of Slurm and PBS
    Hq,
    /// Dask, from Python
    Dask,
    /// Ray, from Python
    Ray,
    /// MPI: every rank a shard
    Mpi,
    /// Kubernetes: an Indexed Job
    K8s,
}

impl Engine {
    /// Tells a script of ours from others.
    pub(super) const MARK: &str = "Written by fdm job plan";

    /// The ending of its script.
    pub(super) fn ending(self) -> &'static str {
        match self {
            Self::Parallel => "parallel.sh",
            Self::Slurm => "slurm.sh",
            Self::Hq => "hq.sh",
            Self::Dask => "dask.py",
            Self::Ray => "ray.py",
            Self::Mpi => "mpi.sh",
            Self::K8s => "k8s.yaml",
        }
    }

    fn template(self) -> &'static str {
        match self {
            Self::Parallel => include_str!("engines/parallel.sh"),
            Self::Slurm => include_str!("engines/slurm.sh"),
            Self::Hq => include_str!("engines/hq.sh"),
            Self::Dask => include_str!("engines/dask.py"),
            Self::Ray => include_str!("engines/ray.py"),
            Self::Mpi => include_str!("engines/mpi.sh"),
            Self::K8s => include_str!("engines/k8s.yaml"),
        }
    }

    /// The script that starts so many shards of a plan, each again when it was lost, and says how they are merged.
    pub(super) fn script(self, plan: &Path, shards: u32) -> String {
        let name = plan.file_stem().unwrap_or_default().to_string_lossy();
        let folder = plan.parent().unwrap_or(Path::new("/")).display().to_string();
        let file = plan.file_name().unwrap_or_default().to_string_lossy().into_owned();
        // names of Kubernetes are words of small letters (RFC 1123)
        let label: String =
            name.chars().map(|c| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '-' }).collect();
        let quoted = |text: &str| match self {
            Self::Dask | Self::Ray | Self::K8s => serde_json::to_string(text).unwrap_or_default(),
            _ => format!("'{}'", text.replace('\'', "'\\''")),
        };
        let values = [
            ("MARK", Self::MARK.to_string()),
            ("FOLDER", quoted(&folder)),
            ("PLAN", quoted(&file)),
            ("OUT", quoted(&format!("{name}.tasks"))),
            ("NAME", label.trim_matches('-').to_string()),
            ("SHARDS", shards.to_string()),
        ];
        // in one go: a folder may be called `@PLAN@`, and what were put in for that would stand outside of its quotes
        let (mut script, mut rest) = (String::new(), self.template());
        while let Some((before, after)) = rest.split_once('@') {
            script.push_str(before);
            let mark = after.split('@').next().unwrap_or_default();
            match values.iter().find(|(name, _)| *name == mark) {
                Some((_, value)) => script.push_str(value),
                None => script.extend(["@", mark]),
            }
            let taken = mark.len() + usize::from(values.iter().any(|(name, _)| *name == mark));
            rest = &after[taken..];
        }
        script.push_str(rest);
        script
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_script_names_the_plan_and_leaves_nothing_open() {
        for engine in Engine::value_variants() {
            let script = engine.script(Path::new("/desk of/it's/Two runs.plan"), 12);
            assert!(
                script.contains(Engine::MARK) && script.contains("Two runs.plan") && script.contains("12"),
                "{script}"
            );
            let marks = ["@MARK@", "@FOLDER@", "@PLAN@", "@OUT@", "@NAME@", "@SHARDS@", "@LAST@"];
            assert!(marks.iter().all(|mark| !script.contains(mark)), "{script}");
        }
        assert!(Engine::K8s.script(Path::new("/a/Two runs.plan"), 2).contains("name: two-runs"));
        assert!(Engine::Slurm.script(Path::new("/it's/a.plan"), 2).contains("cd '/it'\\''s'"));
        for engine in Engine::value_variants() {
            let script = engine.script(Path::new("/@PLAN@/; touch x; @OUT@.plan"), 2);
            assert!(script.contains("/@PLAN@") && script.contains("; touch x; @OUT@.plan"), "{script}");
        }
        assert!(Engine::Parallel.script(Path::new("/a/a.plan"), 2).contains("parallel --quote"));
    }
}
