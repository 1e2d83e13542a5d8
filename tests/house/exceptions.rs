//! Falling lists: how often a rule is broken today. More is refused; less must be written down, so that it stays.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::fs;

/// What breaks a rule: by subject how often, and where.
#[derive(Default)]
pub(crate) struct Found(BTreeMap<String, Vec<String>>);

impl Found {
    pub(crate) fn add(&mut self, subject: &str, place: impl Into<String>) {
        self.0.entry(subject.to_string()).or_default().push(place.into());
    }

    /// Compares with the list of a rule, `exceptions/<rule>.txt`: lines of a number and a subject.
    pub(crate) fn held_to(&self, rule: &str, meaning: &str) {
        let path = support::repository().join(format!("tests/house/exceptions/{rule}.txt"));
        let text = fs::read_to_string(&path).unwrap_or_default();
        let rows = text.lines().filter(|l| !l.starts_with('#')).map(|l| l.trim().split_once(' ').unwrap());
        let listed: BTreeMap<&str, usize> = rows.map(|(count, subject)| (subject, count.parse().unwrap())).collect();
        let mut grown = String::new();
        for (subject, places) in &self.0 {
            let allowed = listed.get(subject.as_str()).copied().unwrap_or(0);
            if places.len() > allowed {
                writeln!(grown, "{subject}: {} where {allowed} are listed\n  {}", places.len(), places.join("\n  "))
                    .unwrap();
            }
        }
        // a list that is not there yet is begun
        assert!(grown.is_empty() || !path.exists(), "{meaning}\n{grown}");
        let count = |subject: &str| self.0.get(subject).map_or(0, Vec::len);
        let fallen: Vec<&str> = listed.iter().filter(|(s, n)| count(s) < **n).map(|(s, _)| *s).collect();
        if std::env::var_os("FDM_BLESS").is_some() {
            let mut new = format!("# {meaning} Exceptions, which only fall:\n");
            self.0.iter().for_each(|(subject, places)| writeln!(new, "{} {subject}", places.len()).unwrap());
            fs::write(&path, new).unwrap();
            return;
        }
        assert!(
            fallen.is_empty() && path.exists(),
            "fewer exceptions than {} lists: {}; `FDM_BLESS=1 cargo test -p fdm-tests --test house` writes it down",
            path.display(),
            fallen.join(", ")
        );
    }
}
