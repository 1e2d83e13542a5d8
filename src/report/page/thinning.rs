//! Fewer points for long records, without losing an extreme: of every part of the record, what is least and greatest of every line.

/// The samples of lines that are drawn.
pub(crate) struct Kept {
    indices: Vec<usize>,
    of: usize,
}

impl Kept {
    /// At most about `most` samples of lines of one length.
    pub(crate) fn new(lines: &[&[f64]], most: usize) -> Self {
        Self { indices: kept(lines, most), of: lines.first().map_or(0, |l| l.len()) }
    }

    /// Places of the samples, rising.
    pub(crate) fn indices(&self) -> &[usize] {
        &self.indices
    }

    /// What is drawn of a line.
    pub(crate) fn pick(&self, values: &[f64]) -> Vec<f64> {
        self.indices.iter().filter_map(|k| values.get(*k).copied()).collect()
    }

    /// How many samples there are, where not all are drawn.
    pub(crate) fn samples(&self) -> Option<usize> {
        (self.indices.len() < self.of).then_some(self.of)
    }
}

/// Indices of the samples that are drawn, rising; all where there are at most `most`. Lines are of one length; a value that is
/// not there is kept where its whole part is not there, so that gaps remain.
pub(crate) fn kept(lines: &[&[f64]], most: usize) -> Vec<usize> {
    let n = lines.first().map_or(0, |l| l.len());
    if n <= most {
        return (0..n).collect();
    }
    let parts = (most / (2 * lines.len()).max(1)).max(1);
    let mut indices = vec![0, n - 1];
    for part in 0..parts {
        let (from, to) = (part * n / parts, (part + 1) * n / parts);
        for line in lines {
            let present = || (from..to).filter(|k| line[*k].is_finite());
            let least = present().min_by(|a, b| line[*a].total_cmp(&line[*b]));
            let greatest = present().max_by(|a, b| line[*a].total_cmp(&line[*b]));
            match (least, greatest) {
                (Some(a), Some(b)) => indices.extend([a, b]),
                _ => indices.extend((from < to).then_some(from)),
            }
        }
    }
    indices.sort_unstable();
    indices.dedup();
    indices
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_extreme_of_every_line_survives_and_gaps_stay_gaps() {
        let mut a: Vec<f64> = (0..100_000).map(|k| (f64::from(k) * 0.01).sin()).collect();
        let mut b = vec![0.0; a.len()];
        (a[54_321], b[777]) = (9.0, -3.0);
        b[20_000..40_000].fill(f64::NAN);
        let kept = kept(&[&a, &b], 4000);
        assert!(kept.len() <= 4002 && kept.windows(2).all(|w| w[0] < w[1]));
        assert!(kept.contains(&54_321) && kept.contains(&777) && kept.contains(&99_999));
        assert!(kept.iter().any(|k| b[*k].is_nan()));
    }

    #[test]
    fn short_records_are_drawn_whole() {
        assert_eq!(kept(&[&[1.0, f64::NAN, 2.0]], 3), [0, 1, 2]);
        assert!(kept(&[], 3).is_empty());
        assert_eq!(kept(&[&[1.0; 9]], 1).first(), Some(&0));
    }
}
