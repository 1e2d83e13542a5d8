//! Unknowns that the data do not determine, and those that are held for it.

/// An unknown that is not estimated, and where it stays.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Pin {
    /// Its place in the vector of unknowns.
    pub(crate) unknown: usize,
    /// Its value.
    pub(crate) value: f64,
}

/// An unknown that the data do not determine by itself, or that went to a bound.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Lost {
    /// Its place in the vector of unknowns.
    pub(crate) unknown: usize,
    /// Where it began.
    pub(crate) start: f64,
    /// Where it ended.
    pub(crate) value: f64,
    /// Whether its sensitivities are small, but not zero.
    pub(crate) shows: bool,
    /// Whether it is at a bound, and began inside.
    pub(crate) bound: bool,
}

impl Lost {
    /// Whether it is elsewhere than it began, or shows a little.
    pub(crate) fn moved(&self) -> bool {
        self.shows || self.value != self.start
    }

    /// Held at a value.
    pub(crate) fn at(&self, value: f64) -> Pin {
        Pin { unknown: self.unknown, value }
    }
}
