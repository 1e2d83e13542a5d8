//! Combinations of parameters that the data do not determine, in words.

use super::quadratic::Inverse;
use serde::Serialize;

/// Part of a parameter in an undetermined direction above which the parameter is not determined.
const PART: f64 = 1e-4;

/// Most parameters of a direction for which what is determined is told too.
const FEW: usize = 4;

/// A direction along which parameters can move without changing the response.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Direction {
    /// Names (with the run where needed) and how far each moves, the largest relative move first; in the parameters'
    /// units, the first being 1.
    pub moves: Vec<(String, f64)>,
    /// The same in words.
    pub sentence: String,
}

/// For each chosen unknown whether it is determined, and the directions in which those move that are not.
/// `name` tells what an unknown is called.
pub(super) fn undetermined(
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
        moves.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()).then(a.0.cmp(&b.0)));
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

fn idle(name: String) -> Direction {
    let sentence = format!("`{name}` has no influence on what was compared");
    Direction { moves: vec![(name, 1.0)], sentence }
}

/// `kept` are the combinations that are determined; empty when there are too many to be told.
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

/// A basis of a space with as many zeros as elimination with full pivoting makes, so that each direction names few.
struct Basis {
    vectors: Vec<Vec<f64>>,
    /// For each vector the entry that is zero in all others.
    pivots: Vec<usize>,
}

impl Basis {
    fn new(mut vectors: Vec<Vec<f64>>) -> Self {
        let mut pivots = Vec::with_capacity(vectors.len());
        for i in 0..vectors.len() {
            let rest = vectors[i..].iter().enumerate();
            let entries = rest.flat_map(|(r, v)| v.iter().enumerate().map(move |(c, x)| (i + r, c, x.abs())));
            let Some((row, column, _)) = entries.reduce(|a, b| if b.2 > a.2 { b } else { a }) else { break };
            vectors.swap(i, row);
            let pivot = vectors[i].clone();
            for (_, v) in vectors.iter_mut().enumerate().filter(|(k, _)| *k != i) {
                let factor = v[column] / pivot[column];
                v.iter_mut().zip(&pivot).for_each(|(x, p)| *x -= factor * p);
                v[column] = 0.0;
            }
            pivots.push(column);
        }
        for v in &mut vectors {
            let norm = v.iter().map(|x| x * x).sum::<f64>().sqrt();
            v.iter_mut().for_each(|x| *x /= norm);
        }
        Self { vectors, pivots }
    }
}
