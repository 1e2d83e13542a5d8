//! What noise alone does to the best of many candidates.
//!
//! Two steps. If the noise's spectrum were known, scores would be normal with the covariance G of the directions: from
//! draws of it every candidate's statistic gets a chance of its own, so that a candidate with many sizes or with a strong
//! direction has no advantage over others (Westfall & Young 1993, min-P). The spectrum is not known: the least of these
//! chances is judged by what it is for residuals drawn from spectra as likely as the one that was found, with the fit
//! taken out and the spectrum estimated anew each time.
//!
//! Residuals of noise alone, many at once: drawn band by band, with the fit taken out, and their products with all that is
//! tried, in the metric of whatever noise each of them seems to have.

use super::bands::{Band, Bands};
use super::projection::Frame;
use super::pursuit::Pursuit;
use super::score::{Trial, equivalents};
use fdm_numeric::parallel;
use fdm_numeric::random::Stream;
use nalgebra::{DMatrix, DVector};
use std::ops::Range;

/// Draws of scores under a known spectrum.
const DRAWS: usize = 4000;
/// Batches that are drawn side by side.
const BATCHES: usize = 16;
/// Above this quantile of the draws a statistic's chance falls like that of chi-square with two degrees of freedom.
const TAIL: f64 = 0.99;

/// The sum of the squares of so many normal deviates (Wilson & Hilferty 1931 where there are many).
fn square_sum(normal: &mut Stream, count: usize) -> f64 {
    if count < 30 {
        return (0..count).map(|_| normal.normal_of_pair()).map(|z| z * z).sum();
    }
    let ninth = 2.0 / (9.0 * count as f64);
    count as f64 * (1.0 - ninth + normal.normal_of_pair() * ninth.sqrt()).powi(3)
}

/// What each candidate's statistic is worth under a known spectrum.
#[derive(Debug, Clone)]
pub(super) struct Marginals {
    /// Statistics of each candidate in all draws, falling.
    sorted: Vec<Vec<f64>>,
}

impl Marginals {
    /// Draws residuals that are white in the coordinates of the directions.
    pub(super) fn new(directions: &DMatrix<f64>, trials: &[Trial], candidates: usize) -> Self {
        // under a known spectrum statistics need no equivalent
        let known: Vec<Trial> = trials.iter().map(|t| Trial { freedom: f64::INFINITY, ..t.clone() }).collect();
        let back = directions.transpose();
        let gram = &back * directions;
        let draw = |batch: usize| {
            let mut normal = Stream::seeded(batch as u64);
            let z = &back * DMatrix::from_fn(directions.nrows(), DRAWS / BATCHES, |_, _| normal.normal_of_pair());
            let mut lists = vec![Vec::with_capacity(DRAWS / BATCHES); candidates];
            for column in z.column_iter() {
                let best = equivalents(&known, candidates, column.as_slice(), |i, j| gram[(i, j)]);
                lists.iter_mut().zip(best).for_each(|(list, best)| list.push(best));
            }
            lists
        };
        let batches: Vec<Vec<Vec<f64>>> = parallel::map(0..BATCHES, draw);
        let gathered = |candidate: usize| {
            let mut list: Vec<f64> = batches.iter().flat_map(|lists| &lists[candidate]).copied().collect();
            list.sort_by(|a, b| b.total_cmp(a));
            list
        };
        Self { sorted: parallel::map(0..candidates, gathered) }
    }

    /// The chance that noise alone gives a candidate this statistic or more.
    pub(super) fn chance(&self, candidate: usize, statistic: f64) -> f64 {
        let list = &self.sorted[candidate];
        let edge = ((1.0 - TAIL) * list.len() as f64) as usize;
        let high = list[edge];
        if statistic > high {
            return (1.0 - TAIL) * (-(statistic - high) / 2.0).exp();
        }
        let above = list.partition_point(|t| *t >= statistic);
        above.max(edge) as f64 / list.len() as f64
    }

    /// The statistic that noise alone exceeds with this chance.
    pub(super) fn quantile(&self, candidate: usize, chance: f64) -> f64 {
        let list = &self.sorted[candidate];
        let edge = ((1.0 - TAIL) * list.len() as f64) as usize;
        if chance < 1.0 - TAIL {
            return list[edge] - 2.0 * (chance / (1.0 - TAIL)).ln();
        }
        list[((chance * list.len() as f64) as usize).min(list.len() - 1)]
    }
}

/// Draws above a value by which its chance is counted; below, the tail is taken as exponential.
const COUNTED: usize = 10;
/// Share of the draws that the tail begins with.
const UPPER: f64 = 0.05;

/// The chance of a value at least this large among draws; where few are beyond it, by an exponential tail through the
/// largest of them.
pub(crate) fn exceedance(draws: &mut [f64], value: f64) -> f64 {
    draws.sort_by(|a, b| b.total_cmp(a));
    let count = draws.len() as f64;
    let above = draws.partition_point(|d| *d >= value);
    let tail = ((UPPER * count) as usize).max(COUNTED).min(draws.len().saturating_sub(1));
    if above >= COUNTED.min(tail) {
        return (above as f64 + 1.0) / (count + 1.0);
    }
    let edge = draws[tail];
    let mean = draws[..tail].iter().map(|d| d - edge).sum::<f64>() / tail as f64;
    let share = tail as f64 / count;
    let counted = (above as f64 + 1.0) / (count + 1.0);
    if mean > 0.0 { share * (-(value - edge).max(0.0) / mean).exp() } else { counted }
}

/// The value that so small a share of the draws (sorted, falling) exceeds, by the same tail.
pub(super) fn critical(draws: &[f64], share: f64) -> Option<f64> {
    let tail = ((UPPER * draws.len() as f64) as usize).max(COUNTED).min(draws.len().saturating_sub(1));
    let edge = draws.get(tail).filter(|_| tail > 0)?;
    let mean = draws[..tail].iter().map(|d| d - edge).sum::<f64>() / tail as f64;
    Some(edge + mean * (tail as f64 / draws.len() as f64 / share).ln().max(0.0))
}

/// Bands in coordinates of a frame.
#[derive(Debug, Clone)]
pub(super) struct NullDraws {
    /// R' of all bands, one beside the other (d by rows).
    roots: DMatrix<f64>,
    /// Each band's rows, and its bins beside them.
    rows: Vec<(Range<usize>, usize)>,
    /// Products in each band, a column for each: of absorbed coordinates (upper triangle), of these with directions, and of pairs.
    products: DMatrix<f64>,
    /// Pairs of directions of which products are needed: each with itself, then members of one trial.
    pairs: Pairs,
    /// Directions beside what is absorbed (d - absorbed by m).
    directions: DMatrix<f64>,
    absorbed: usize,
}

/// Where the products of two directions are.
#[derive(Debug, Clone)]
struct Pairs {
    list: Vec<(usize, usize)>,
    /// For each direction its partners with a higher number, and where they are.
    partners: Vec<Vec<(usize, usize)>>,
}

/// Residuals that were drawn.
pub(super) struct DrawnResiduals {
    /// Along the rows of all bands, a column for each residual.
    along: DMatrix<f64>,
    /// Sums of squares of everything else (bands by residuals).
    beside: DMatrix<f64>,
}

/// One residual beside the absorbed coordinates, by one noise.
pub(super) struct DrawnScores<'a> {
    /// Products with the directions.
    pub(super) z: Vec<f64>,
    /// L^-1 times the products of absorbed coordinates with directions.
    absorbed: DMatrix<f64>,
    /// Products of pairs.
    pairs: Vec<f64>,
    known: &'a Pairs,
}

impl Pairs {
    fn new(trials: &[Trial], directions: usize) -> Self {
        let mut list: Vec<(usize, usize)> = (0..directions).map(|k| (k, k)).collect();
        let mut partners = vec![Vec::new(); directions];
        for members in trials.iter().map(|t| &t.members) {
            for (n, a) in members.iter().enumerate() {
                for b in &members[..n] {
                    let (low, high) = (*a.min(b), *a.max(b));
                    partners[low].push((high, list.len()));
                    list.push((low, high));
                }
            }
        }
        Self { list, partners }
    }

    fn place(&self, i: usize, j: usize) -> Option<usize> {
        let (low, high) = (i.min(j), i.max(j));
        if i == j { Some(i) } else { self.partners[low].iter().find(|p| p.0 == high).map(|p| p.1) }
    }
}

impl NullDraws {
    pub(super) fn new(bands: &Bands, frame: &Frame, trials: &[Trial]) -> Self {
        let (dimension, absorbed, m) = (frame.axes.ncols(), frame.absorbed, frame.directions.ncols());
        let pairs = Pairs::new(trials, m);
        let mut columns: Vec<usize> = trials.iter().flat_map(|t| t.members.iter().copied()).collect();
        columns.sort_unstable();
        columns.dedup();
        let (roots, rows) = roots(bands, frame);
        let of = |rows: &Range<usize>| {
            let factor = roots.columns(rows.start, rows.len()).transpose();
            let own = factor.columns(0, absorbed);
            let seen = factor.columns(absorbed, dimension - absorbed) * frame.directions.select_columns(&columns);
            let mut products = Vec::with_capacity(absorbed * (absorbed + 1) / 2 + absorbed * m + pairs.list.len());
            let squares = own.transpose() * own;
            (0..absorbed).for_each(|j| products.extend(squares.view((0, j), (j + 1, 1)).iter()));
            let cross = own.transpose() * &seen;
            let place = |k: usize| columns.binary_search(&k).ok();
            for k in 0..m {
                match place(k) {
                    Some(k) => products.extend(cross.column(k).iter()),
                    None => products.extend(std::iter::repeat_n(0.0, absorbed)),
                }
            }
            let product = |(i, j): &(usize, usize)| match (place(*i), place(*j)) {
                (Some(i), Some(j)) => seen.column(i).dot(&seen.column(j)),
                _ => 0.0,
            };
            products.extend(pairs.list.iter().map(product));
            products
        };
        let each: Vec<Vec<f64>> = parallel::map(rows.iter(), of);
        let products = DMatrix::from_vec(each.first().map_or(0, Vec::len), each.len(), each.concat());
        let beside = |(rows, band): (Range<usize>, &Band)| {
            let others = band.count - rows.len();
            (rows, others)
        };
        let rows = rows.into_iter().zip(&bands.list).map(beside).collect();
        Self { roots, rows, products, pairs, directions: frame.directions.clone(), absorbed }
    }

    /// Energy of a direction in each band, in units of its noise.
    pub(super) fn energies(&self, direction: usize, density: &[f64]) -> Vec<f64> {
        let place = self.products.nrows() - self.pairs.list.len() + direction;
        self.products.row(place).iter().zip(density).map(|(own, density)| own / density).collect()
    }

    /// Standard normal residuals times deviations (of each band, for each residual).
    pub(super) fn drawn(&self, deviations: &[Vec<f64>], normals: &mut [Stream]) -> DrawnResiduals {
        let mut along = DMatrix::zeros(self.roots.ncols(), normals.len());
        let mut beside = DMatrix::zeros(self.rows.len(), normals.len());
        for (k, normal) in normals.iter_mut().enumerate() {
            let mut column = along.column_mut(k);
            for (band, (rows, others)) in self.rows.iter().enumerate() {
                let deviation = deviations[k][band];
                rows.clone().for_each(|row| column[row] = deviation * normal.normal_of_pair());
                beside[(band, k)] = deviation * deviation * square_sum(normal, *others);
            }
        }
        DrawnResiduals { along, beside }
    }

    /// Products of the axes with residuals, weighed by 1/S (bands; of each residual).
    pub(super) fn products<'a>(&self, drawn: &DrawnResiduals, density: impl Fn(usize) -> &'a [f64]) -> DMatrix<f64> {
        &self.roots * drawn.weighed(&self.rows, density)
    }

    /// Each residual by its own noise: from products of the axes with it, and weights 1/S (bands by residuals).
    pub(super) fn judged(&self, products: &DMatrix<f64>, weights: &DMatrix<f64>) -> Vec<Option<DrawnScores<'_>>> {
        let (absorbed, m) = (self.absorbed, self.directions.ncols());
        let beside = self.directions.transpose() * products.rows(absorbed, self.directions.nrows());
        let all = &self.products * weights;
        let one = |k: usize| {
            let own = all.column(k);
            let own = own.as_slice();
            let mut at = 0;
            let mut metric = DMatrix::zeros(absorbed, absorbed);
            for j in 0..absorbed {
                for i in 0..=j {
                    metric[(j, i)] = own[at];
                    at += 1;
                }
            }
            let factor = metric.cholesky()?.unpack();
            let mut cross = DMatrix::from_column_slice(absorbed, m, &own[at..at + absorbed * m]);
            factor.solve_lower_triangular_mut(&mut cross);
            let mut taken: DVector<f64> = products.view((0, k), (absorbed, 1)).column(0).into_owned();
            factor.solve_lower_triangular_mut(&mut taken);
            let z = (0..m).map(|d| beside[(d, k)] - cross.column(d).dot(&taken)).collect();
            Some(DrawnScores { z, absorbed: cross, pairs: own[at + absorbed * m..].to_vec(), known: &self.pairs })
        };
        (0..weights.ncols()).map(one).collect()
    }
}

impl DrawnResiduals {
    /// Along the rows of all bands, over S.
    fn weighed<'a>(&self, rows: &[(Range<usize>, usize)], density: impl Fn(usize) -> &'a [f64]) -> DMatrix<f64> {
        let mut weighed = self.along.clone();
        for (k, mut column) in weighed.column_iter_mut().enumerate() {
            for ((rows, _), density) in rows.iter().zip(density(k)) {
                rows.clone().for_each(|row| column[row] /= density);
            }
        }
        weighed
    }
}

/// What is taken out of drawn residuals before their noise is judged: what is fitted, and what each of them follows.
#[derive(Debug, Clone)]
pub(super) struct Extraction {
    /// R' of all bands in coordinates of a frame (d by rows), and each band's rows.
    roots: DMatrix<f64>,
    rows: Vec<Range<usize>>,
    /// S of each band, by which it is judged.
    density: Vec<f64>,
    absorbed: usize,
    /// Bins of each band that the fit leaves.
    freedom: Vec<f64>,
    pursuit: Pursuit,
}

/// What is left of drawn residuals.
pub(super) struct Left {
    /// Sums of squares in each band (bands by residuals).
    pub(super) squares: DMatrix<f64>,
    /// Bins of each band, for each residual.
    pub(super) freedom: Vec<Vec<f64>>,
}

impl Extraction {
    /// With the frame of a density.
    pub(super) fn new(bands: &Bands, frame: &Frame, density: Vec<f64>) -> Self {
        let (roots, rows) = roots(bands, frame);
        let taken = leverages(&roots.rows(0, frame.absorbed).into_owned(), &rows, &density);
        let freedom = bands.list.iter().zip(taken).map(|(band, taken)| band.count as f64 - taken).collect();
        let pursuit = frame.pursuit(bands.bins());
        Self { roots, rows, density, absorbed: frame.absorbed, freedom, pursuit }
    }

    /// What is left of residuals that were drawn in the same bands.
    pub(super) fn left(&self, drawn: &DrawnResiduals, drawing: &NullDraws) -> Left {
        let mut multiples = &self.roots * drawn.weighed(&drawing.rows, |_| &self.density);
        let beside = self.roots.nrows() - self.absorbed;
        let mut freedom = Vec::with_capacity(multiples.ncols());
        for mut column in multiples.column_iter_mut() {
            let mut rest = column.rows_mut(self.absorbed, beside);
            let own = rest.clone_owned();
            let followed = self.pursuit.of(&own);
            rest.copy_from(&(&followed * followed.tr_mul(&own)));
            let along = followed.transpose() * self.roots.rows(self.absorbed, beside);
            let taken = leverages(&along, &self.rows, &self.density);
            freedom.push(self.freedom.iter().zip(taken).map(|(bins, taken)| (bins - taken).max(0.0)).collect());
        }
        let along = &drawn.along - (multiples.transpose() * &self.roots).transpose();
        let of = |band: usize, k: usize| {
            let rows = &self.rows[band];
            along.view((rows.start, k), (rows.len(), 1)).norm_squared() + drawn.beside[(band, k)]
        };
        Left { squares: DMatrix::from_fn(self.rows.len(), drawn.beside.ncols(), of), freedom }
    }
}

/// R' of all bands in coordinates of a frame, one beside the other (d by rows), and which are each band's.
fn roots(bands: &Bands, frame: &Frame) -> (DMatrix<f64>, Vec<Range<usize>>) {
    let across = frame.axes.transpose();
    let (mut rows, mut first) = (Vec::with_capacity(bands.list.len()), 0);
    for band in &bands.list {
        rows.push(first..first + band.root.ncols());
        first += band.root.ncols();
    }
    let mut roots = DMatrix::zeros(across.nrows(), first);
    let (mut parts, mut left) = (Vec::with_capacity(rows.len()), roots.as_mut_slice());
    for band in &bands.list {
        let (own, others) = left.split_at_mut(across.nrows() * band.root.ncols());
        parts.push((band, own));
        left = others;
    }
    parallel::each(parts, |(band, own)| own.copy_from_slice((&across * &band.root).as_slice()));
    (roots, rows)
}

/// How many bins of each band orthonormal signals (k by rows) take out.
fn leverages(signals: &DMatrix<f64>, rows: &[Range<usize>], density: &[f64]) -> Vec<f64> {
    let of = |(rows, density): (&Range<usize>, &f64)| signals.columns(rows.start, rows.len()).norm_squared() / density;
    rows.iter().zip(density).map(of).collect()
}

impl DrawnScores<'_> {
    /// The product of two directions of one trial beside the absorbed coordinates.
    pub(super) fn product(&self, i: usize, j: usize) -> f64 {
        let whole = self.known.place(i, j).map_or(0.0, |place| self.pairs[place]);
        whole - self.absorbed.column(i).dot(&self.absorbed.column(j))
    }
}
