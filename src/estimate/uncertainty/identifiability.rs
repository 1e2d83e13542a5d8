//! Combinations of parameters that are not identifiable: the null space of the scaled information (Belsley, Kuh and Welsch 1980), in words.
//!
//! Unknowns that the data do not determine, and those that are held for it.

use fdm_numeric::quadratic::Inverse;
use serde::{Deserialize, Serialize};

/// Part of a parameter in an undetermined direction above which the parameter is not determined.
pub(super) const PART: f64 = 1e-4;

/// Parts that differ by less, relative to the larger one, are equal but for rounding.
const ALIKE: f64 = 1e-6;

/// Most parameters of a direction for which what is determined is reported too.
const FEW: usize = 4;

/// A direction along which parameters can move without changing the response.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Direction {
    /// Names (with the run where needed) and how far each moves, the largest relative move first; in the parameters'
    /// units, the first being 1.
    pub moves: Vec<(String, f64)>,
    /// The direction in words.
    pub sentence: String,
}

impl Direction {
    /// Of a parameter that was held, since nothing determines it.
    pub(crate) fn of_held(name: String) -> Self {
        let sentence = format!("`{name}` is not determined by what was compared, and was held where it stands");
        Self { moves: vec![(name, 1.0)], sentence }
    }
}

/// For each chosen unknown whether it is determined, and the directions in which those move that are not.
/// `name` gives the name of an unknown.
pub(crate) fn undetermined(
    scale: &[f64],
    inside: &[bool],
    inverse: &Inverse,
    name: impl Fn(usize) -> String,
) -> (Vec<bool>, Vec<Direction>) {
    let part = |k: usize| inverse.null.iter().map(|v| v[k] * v[k]).sum::<f64>().sqrt();
    let determined = (0..inverse.chosen.len()).map(|k| part(k) <= PART).collect();
    let mut directions: Vec<Direction> =
        (0..scale.len()).filter(|j| scale[*j] == 0.0 && inside[*j]).map(|j| idle(name(j))).collect();
    let basis = Basis::new(inverse.null.clone());
    for (vector, pivot) in basis.vectors.iter().zip(&basis.pivots) {
        let mut moves: Vec<(usize, f64)> = vector.iter().copied().enumerate().filter(|(_, v)| v.abs() > PART).collect();
        largest_first(&mut moves);
        let physical = |k: usize, v: f64| v / scale[inverse.chosen[k]];
        let called = |k: usize| name(inverse.chosen[k]);
        let Some(first) = moves.first().map(|(k, v)| physical(*k, *v)) else { continue };
        // what stays while the pivots of all directions move: each other parameter with its share of the pivots
        let kept = moves.iter().filter(|(k, _)| k != pivot && moves.len() <= FEW).map(|(k, _)| {
            let others = basis.vectors.iter().zip(&basis.pivots).filter(|(v, _)| v[*k].abs() > PART);
            let share = |(v, p): (&Vec<f64>, &usize)| (called(*p), -physical(*k, v[*k]) / physical(*p, v[*p]));
            combination(&called(*k), others.map(share))
        });
        let kept = kept.collect();
        let moves = moves.iter().map(|(k, v)| (called(*k), physical(*k, *v) / first)).collect();
        directions.push(describe(moves, kept));
    }
    (determined, directions)
}

/// How far an unknown may plausibly be from where it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Reach {
    /// By about this much: its bounds say so.
    Known(f64),
    /// By about as much as it was at its start, or is now.
    Started { start: f64, value: f64 },
    /// Nothing tells its size but its value.
    Guessed(f64),
}

/// A standard error this many times as far as an unknown may plausibly be is no error but the lack of information.
const BEYOND: f64 = 1e6;
/// A standard error this many times a value is the lack of information where nothing tells how far that unknown may
/// plausibly be.
const FAR_BEYOND: f64 = 1e10;

impl Reach {
    pub(crate) fn new(value: f64, start: f64, (lower, upper): (f64, f64)) -> Self {
        let width = upper - lower;
        match () {
            () if width.is_finite() => Self::Known(width.max(value.abs())),
            () if start != 0.0 => Self::Started { start: start.abs(), value: value.abs() },
            () => Self::Guessed(value.abs().max(1.0)),
        }
    }

    /// Whether a standard error tells nothing.
    fn is_exceeded(self, error: f64) -> bool {
        let most = match self {
            Self::Known(reach) => BEYOND * reach,
            // a value that cannot be told from zero tells no size: it may have run away together with its error
            Self::Started { start, value } if value <= 2.0 * error => BEYOND * start,
            Self::Started { start, value } => BEYOND * start.max(value),
            Self::Guessed(reach) => FAR_BEYOND * reach,
        };
        error > most
    }
}

/// Takes back that an unknown is determined whose error is beyond all that it may be: its sensitivities are as good as zero,
/// though no combination of unknowns is exactly without effect.
pub(crate) fn faint(
    scale: &[f64],
    inverse: &Inverse,
    reach: impl Fn(usize) -> Reach,
    determined: &mut [bool],
    directions: &mut Vec<Direction>,
    name: impl Fn(usize) -> String,
) {
    let size = inverse.chosen.len();
    for (k, j) in inverse.chosen.iter().copied().enumerate() {
        let error = inverse.values[k * size + k].max(0.0).sqrt() / scale[j];
        if determined[k] && reach(j).is_exceeded(error) {
            determined[k] = false;
            directions.push(describe(vec![(name(j), 1.0)], Vec::new()));
        }
    }
}

fn idle(name: String) -> Direction {
    let sentence = format!("`{name}` has no influence on what was compared");
    Direction { moves: vec![(name, 1.0)], sentence }
}

/// `kept` are the combinations that are determined; empty when there are too many to be listed.
fn describe(moves: Vec<(String, f64)>, kept: Vec<String>) -> Direction {
    let sentence = match (&moves[..], &kept[..]) {
        ([(a, _)], _) => format!("`{a}` is not determined by what was compared"),
        ([(a, _), (b, _)], [sum]) => {
            let (a, b) = if sum.starts_with(&format!("`{b}`")) { (b, a) } else { (a, b) };
            format!("only {sum} is determined, not `{a}` and `{b}` apart")
        }
        (many, kept) => {
            let list = |text: fn(&(String, f64)) -> String| many.iter().map(text).collect::<Vec<_>>();
            let names = list(|(n, _)| format!("`{n}`")).join(", ");
            let ratio = list(|(_, m)| short(*m)).join(" : ");
            let rest = if kept.is_empty() { String::new() } else { format!("; only {} are", kept.join(" and ")) };
            format!("{names} are not determined apart{rest} (moving them as {ratio} changes nothing that was compared)")
        }
    };
    Direction { moves, sentence }
}

/// A sum in words: "`a` + 2.5 `b`".
fn combination(first: &str, others: impl Iterator<Item = (String, f64)>) -> String {
    let mut text = format!("`{first}`");
    for (name, factor) in others {
        let sign = if factor < 0.0 { '-' } else { '+' };
        let size = factor.abs();
        let size = if (size - 1.0).abs() < 1e-6 { String::new() } else { format!("{} ", short(size)) };
        text.push_str(&format!(" {sign} {size}`{name}`"));
    }
    text
}

/// Four digits, without needless zeros.
fn short(value: f64) -> String {
    let text = format!("{value:.3e}");
    let rounded: f64 = text.parse().unwrap_or(value);
    if (1e-3..1e5).contains(&rounded.abs()) { format!("{rounded}") } else { format!("{rounded:e}") }
}

/// Sorts by size; what is equal but for rounding keeps the order of the unknowns, so that the words do not depend on it.
fn largest_first(moves: &mut [(usize, f64)]) {
    moves.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
    for alike in moves.chunk_by_mut(|a, b| a.1.abs() - b.1.abs() <= ALIKE * a.1.abs()) {
        alike.sort_by_key(|(k, _)| *k);
    }
}

/// A basis of a space in which each vector has an entry that is zero in all others, so that each direction names few.
/// It depends on the space alone, not on the vectors by which the space was given.
struct Basis {
    vectors: Vec<Vec<f64>>,
    /// For each vector the entry that is zero in all others.
    pivots: Vec<usize>,
}

impl Basis {
    /// Takes orthonormal vectors.
    fn new(mut vectors: Vec<Vec<f64>>) -> Self {
        let pivots = leading(&vectors);
        for (i, column) in pivots.iter().copied().enumerate() {
            let rest = (i..vectors.len())
                .reduce(|a, b| if vectors[b][column].abs() > vectors[a][column].abs() { b } else { a });
            let Some(row) = rest else { break };
            vectors.swap(i, row);
            let pivot = vectors[i].clone();
            for (_, v) in vectors.iter_mut().enumerate().filter(|(k, _)| *k != i) {
                let factor = v[column] / pivot[column];
                v.iter_mut().zip(&pivot).for_each(|(x, p)| *x -= factor * p);
                v[column] = 0.0;
            }
        }
        for v in &mut vectors {
            let norm = v.iter().map(|x| x * x).sum::<f64>().sqrt();
            v.iter_mut().for_each(|x| *x /= norm);
        }
        Self { vectors, pivots }
    }
}

/// The entries that determine a point of the space best, one for each orthonormal vector: the diagonal pivots of the space's
/// projector, the first of those that are alike.
fn leading(vectors: &[Vec<f64>]) -> Vec<usize> {
    let mut rest = vectors.to_vec();
    let mut pivots = Vec::with_capacity(vectors.len());
    for _ in vectors {
        let size = |c: usize| rest.iter().map(|v| v[c] * v[c]).sum::<f64>();
        let sizes: Vec<f64> = (0..rest.first().map_or(0, Vec::len)).map(size).collect();
        let largest = sizes.iter().copied().fold(0.0, f64::max);
        let Some(column) = sizes.iter().position(|s| largest > 0.0 && *s >= (1.0 - ALIKE) * largest) else { break };
        // leaves of every row what is orthogonal to the pivot's own direction in the space
        let along: Vec<f64> = rest.iter().map(|v| v[column] / sizes[column].sqrt()).collect();
        let entries = (0..sizes.len()).map(|c| rest.iter().zip(&along).map(|(v, a)| a * v[c]).sum());
        let direction: Vec<f64> = entries.collect();
        for (v, a) in rest.iter_mut().zip(&along) {
            v.iter_mut().zip(&direction).for_each(|(x, d)| *x -= a * d);
        }
        pivots.push(column);
    }
    pivots
}

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_beyond_all_that_an_unknown_may_be_tell_nothing() {
        let open = (f64::NEG_INFINITY, f64::INFINITY);
        let (known, bounded) = (Reach::new(1.2, 1.0, open), Reach::new(0.5, 0.0, (0.0, 2.0)));
        let guessed = Reach::new(1e-9, 0.0, open);
        assert_eq!(
            (known, bounded, guessed),
            (Reach::Started { start: 1.0, value: 1.2 }, Reach::Known(2.0), Reach::Guessed(1.0))
        );
        // one that ran away with its error, and one that is far from its start and known
        let [lost, far] = [3.6e13, 9e13].map(|value| Reach::new(value, 1.0, open));
        assert!(lost.is_exceeded(4.4e13) && !far.is_exceeded(4.4e13));
        // informations of 1e-30, and an offset that began at zero and ended far below its error
        let (scale, reaches) = ([1e-15, 1e-15, 1e3, 1e-15], [known, bounded, guessed, guessed]);
        let values = (0..16).map(|k| f64::from(u8::from(k % 5 == 0))).collect();
        let inverse = Inverse { chosen: vec![0, 1, 2, 3], values, ..Inverse::default() };
        let (mut determined, mut directions) = (vec![true; 4], Vec::new());
        let name = |j: usize| "abcd"[j..=j].to_string();
        faint(&scale, &inverse, |j| reaches[j], &mut determined, &mut directions, name);
        assert_eq!(determined, [false, false, true, false]);
        assert_eq!(directions[0].sentence, "`a` is not determined by what was compared");
    }

    #[test]
    fn the_words_depend_on_the_space_alone() {
        // a and b move against each other, c against d and e, whose parts are alike
        let (s, t) = (0.5f64.sqrt(), 3f64.sqrt().recip());
        let (one, two) = ([s, -s, 0.0, 0.0, 0.0], [0.0, 0.0, t, -t, -t]);
        let said = |angle: f64, tilt: f64| {
            let turned = |a: f64, b: f64| one.iter().zip(&two).map(|(x, y)| a * x + b * y).collect::<Vec<f64>>();
            let (sin, cos) = angle.sin_cos();
            let mut null = vec![turned(cos, sin), turned(-sin, cos)];
            null.iter_mut().for_each(|v| (v[0], v[3]) = (v[0] * (1.0 + tilt), v[3] * (1.0 - tilt)));
            let inverse = Inverse { chosen: (0..5).collect(), null, ..Inverse::default() };
            let (_, directions) = undetermined(&[1.0; 5], &[true; 5], &inverse, |k| "abcde"[k..=k].to_string());
            directions.into_iter().map(|d| d.sentence).collect::<Vec<_>>()
        };
        let first = said(0.0, 0.0);
        assert_eq!(first.len(), 2);
        assert!(first[0].contains("only `b` + `a` is determined"), "{first:?}");
        assert!(first[1].contains("`c`, `d`, `e`") && first[1].contains("`d` + `c` and `e` + `c`"), "{first:?}");
        for k in 1..40 {
            assert_eq!(said(0.17 * f64::from(k), 1e-14 * f64::from(k % 5 - 2)), first, "turned {k} times");
        }
    }
}
