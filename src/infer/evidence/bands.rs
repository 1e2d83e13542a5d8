//! Bands of frequency: noise is taken as of one power in each, so that sums over the bins of a band are all that is ever needed.

/// Bins at the low end that stand alone, where the spectra of slow noise are steep.
const ALONE: usize = 8;
/// Width of a band beside its lower edge: a tenth of an octave loses nothing of a resonance of damping 0.02 but its height.
const WIDTH: f64 = 1.13;
/// Where the mean of a record stands among its bins: as if it were the bin of this number. A spectrum that is continued to there gives the
/// mean's variance: that of the first bin where the noise is white, 8 times as much for 1/f noise.
pub(crate) const MEAN: f64 = 0.125;

/// Bands by the frequency of a bin in that of the first bin of the longest record, common to all runs and outputs.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Bands {
    /// Upper edges, rising.
    edges: Vec<f64>,
}

impl Bands {
    /// Bands up to the highest frequency of the longest record, which has so many bins.
    pub(crate) fn new(bins: usize) -> Self {
        let mut edges = vec![0.25];
        edges.extend((1..=ALONE).map(|k| k as f64 + 0.5));
        while let Some(last) = edges.last().copied().filter(|last| *last < bins as f64) {
            edges.push((last * WIDTH).max(last + 1.0));
        }
        Self { edges }
    }

    /// How many there are.
    pub(crate) fn count(&self) -> usize {
        self.edges.len()
    }

    /// The band of a frequency; the last one holds all that are higher.
    pub(crate) fn of(&self, frequency: f64) -> usize {
        self.edges.partition_point(|edge| *edge <= frequency).min(self.edges.len() - 1)
    }
}

/// The bins of one output over all runs, counted in bands.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct BandCounts {
    /// Bins in each band.
    pub(crate) bins: Vec<f64>,
    /// Mean (geometric) frequency of the bins of each band, in that of the first bin of the longest record; the middle of an empty one.
    pub(crate) frequency: Vec<f64>,
}

impl BandCounts {
    /// Of the frequencies of all bins of an output, in that of the first bin of the longest record.
    pub(crate) fn of(bands: &Bands, frequencies: impl Iterator<Item = f64>) -> Self {
        let (mut bins, mut logs) = (vec![0.0; bands.count()], vec![0.0; bands.count()]);
        for frequency in frequencies {
            let band = bands.of(frequency);
            bins[band] += 1.0;
            logs[band] += frequency.max(MEAN).ln();
        }
        let edge = |band: usize| bands.edges[band];
        let middle = |band: usize| if band == 0 { MEAN } else { (edge(band - 1) * edge(band)).sqrt() };
        let mean =
            |(band, (log, count)): (usize, (f64, &f64))| if *count > 0.0 { (log / count).exp() } else { middle(band) };
        let frequency = logs.into_iter().zip(&bins).enumerate().map(mean).collect();
        Self { bins, frequency }
    }

    /// All bins.
    pub(crate) fn total(&self) -> f64 {
        self.bins.iter().sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slow_bins_stand_alone_and_every_bin_has_one_band() {
        let bands = Bands::new(1000);
        let of: Vec<usize> = (0..1000).map(|k| bands.of(f64::from(k))).collect();
        assert_eq!(of[..9], [0, 1, 2, 3, 4, 5, 6, 7, 8]);
        assert!(of.windows(2).all(|w| w[1] == w[0] || w[1] == w[0] + 1));
        assert!((35..=55).contains(&bands.count()), "{}", bands.count());
        let counts = BandCounts::of(&bands, (0..1000).map(f64::from));
        assert_eq!(counts.total(), 1000.0);
        assert!((counts.frequency[0] - MEAN).abs() < 1e-12 && counts.frequency.windows(2).all(|w| w[0] < w[1]));
    }
}
