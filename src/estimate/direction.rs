//! Combinations of parameters that the data do not determine, in words.

use super::quadratic::Inverse;
use serde::Serialize;

/// Part of a parameter in an undetermined direction above which the parameter is not determined.
const PART: f64 = 1e-4;

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
    for vector in echelon(inverse.null.clone()) {
        let mut moves: Vec<(usize, f64)> = vector.into_iter().enumerate().filter(|(_, v)| v.abs() > PART).collect();
        moves.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()).then(a.0.cmp(&b.0)));
        let physical = |(k, v): &(usize, f64)| v / scale[inverse.chosen[*k]];
        let Some(first) = moves.first().map(physical) else { continue };
        let moves = moves.iter().map(|m| (name(inverse.chosen[m.0]), physical(m) / first)).collect();
        directions.push(describe(moves));
    }
    (determined, directions)
}

fn idle(name: String) -> Direction {
    let sentence = format!("`{name}` has no influence on what was compared");
    Direction { moves: vec![(name, 1.0)], sentence }
}

fn describe(moves: Vec<(String, f64)>) -> Direction {
    let sentence = match &moves[..] {
        [(a, _)] => format!("`{a}` is not determined by what was compared"),
        [(a, _), (b, move_b)] => {
            // a + c b stays while a moves by 1 and b by move_b
            let c = -1.0 / move_b;
            let (sign, size) = if c < 0.0 { ('-', -c) } else { ('+', c) };
            let factor = if (size - 1.0).abs() < 1e-6 { String::new() } else { format!("{} ", short(size)) };
            format!("only `{a}` {sign} {factor}`{b}` is determined, not `{a}` and `{b}` apart")
        }
        many => {
            let list = |text: fn(&(String, f64)) -> String| many.iter().map(text).collect::<Vec<_>>();
            let names = list(|(n, _)| format!("`{n}`")).join(", ");
            let ratio = list(|(_, m)| short(*m)).join(" : ");
            format!("{names} are not determined apart: moving them as {ratio} changes nothing that was compared")
        }
    };
    Direction { moves, sentence }
}

/// Four digits, without needless zeros.
fn short(value: f64) -> String {
    let text = format!("{value:.3e}");
    let rounded: f64 = text.parse().unwrap_or(value);
    if (1e-3..1e5).contains(&rounded.abs()) { format!("{rounded}") } else { format!("{rounded:e}") }
}

/// The same space with as many zeros as elimination with full pivoting makes, so that each direction names few.
fn echelon(mut basis: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
    for i in 0..basis.len() {
        let entries = basis[i..]
            .iter()
            .enumerate()
            .flat_map(|(r, v)| v.iter().enumerate().map(move |(c, x)| (i + r, c, x.abs())));
        let Some((row, column, _)) = entries.reduce(|a, b| if b.2 > a.2 { b } else { a }) else { break };
        basis.swap(i, row);
        let pivot = basis[i].clone();
        for (_, v) in basis.iter_mut().enumerate().filter(|(k, _)| *k != i) {
            let factor = v[column] / pivot[column];
            v.iter_mut().zip(&pivot).for_each(|(x, p)| *x -= factor * p);
            v[column] = 0.0;
        }
    }
    for v in &mut basis {
        let norm = v.iter().map(|x| x * x).sum::<f64>().sqrt();
        v.iter_mut().for_each(|x| *x /= norm);
    }
    basis
}
