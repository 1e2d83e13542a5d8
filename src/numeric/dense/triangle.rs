//! Householder reduction of tall matrices to a triangle, a block of rows at a time: rank is decided on J, never on J'J.

use crate::lanes::widest;

/// Order from which the widest registers are worth choosing.
const WIDE: usize = 64;
/// Squares of columns below this are zero: on the way to the smallest numbers a reflection loses its digits and overflows.
const NOTHING: f64 = 1e-280;

/// Reduces `block` (rows by width, row-major) into the upper triangle `triangle` (order by width), so that
/// triangle' triangle grows by block' block. The block is overwritten. Only the first `order` columns are meant;
/// lanes beyond them must be zero.
pub fn reduce(triangle: &mut [f64], order: usize, block: &mut [f64], width: usize, work: &mut Vec<f64>) {
    if order < WIDE {
        reflect(triangle, order, block, width, work);
    } else {
        widest(
            #[inline(always)]
            || reflect(triangle, order, block, width, work),
        );
    }
}

#[inline(always)]
fn reflect(triangle: &mut [f64], order: usize, block: &mut [f64], width: usize, work: &mut Vec<f64>) {
    let rows = block.len() / width;
    work.clear();
    work.resize(rows + width, 0.0);
    let (reflector, products) = work.split_at_mut(rows);
    for j in 0..order {
        let mut square = 0.0;
        for (b, v) in reflector.iter_mut().enumerate() {
            *v = block[b * width + j];
            square += *v * *v;
        }
        if square < NOTHING {
            continue;
        }
        let row = &mut triangle[j * width..(j + 1) * width];
        let alpha = row[j];
        let norm = (alpha * alpha + square).sqrt();
        let head = if alpha > 0.0 { alpha + norm } else { alpha - norm };
        let tau = 2.0 / (head * head + square);
        let products = &mut products[j..];
        for (p, t) in products.iter_mut().zip(&row[j..]) {
            *p = head * t;
        }
        for (b, v) in reflector.iter().enumerate() {
            for (p, x) in products.iter_mut().zip(&block[b * width + j..(b + 1) * width]) {
                *p += v * x;
            }
        }
        for (t, p) in row[j..].iter_mut().zip(&*products) {
            *t -= tau * head * p;
        }
        for (b, v) in reflector.iter().enumerate() {
            let factor = tau * v;
            for (x, p) in block[b * width + j..(b + 1) * width].iter_mut().zip(&*products) {
                *x -= factor * p;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_on_the_way_to_zero_count_as_zero() {
        for tiny in [1e-150, 1e-158, 1e-162, 5e-324] {
            let (mut triangle, mut work) = (vec![0.0; 2 * 8], Vec::new());
            for _ in 0..3 {
                let mut block: Vec<f64> =
                    (0..4).flat_map(|k| [1.0, tiny * f64::from(k), 0., 0., 0., 0., 0., 0.]).collect();
                reduce(&mut triangle, 2, &mut block, 8, &mut work);
            }
            assert!(triangle.iter().all(|v| v.is_finite()), "{tiny}: {triangle:?}");
            assert!((triangle[0].abs() - 12f64.sqrt()).abs() < 1e-14);
        }
    }

    #[test]
    fn products_are_kept_and_small_singular_values_survive() {
        // two columns that differ by 1e-10: J'J in double precision cannot tell them apart, the triangle can
        let rows: Vec<[f64; 3]> = (0..40)
            .map(|k| {
                let t = k as f64 / 40.0;
                [1.0 + t, 1.0 + t + 1e-10 * t * t, t.sin()]
            })
            .collect();
        let width = 8;
        let (mut triangle, mut work) = (vec![0.0; 3 * width], Vec::new());
        for part in rows.chunks(7) {
            let mut block = vec![0.0; part.len() * width];
            part.iter().enumerate().for_each(|(b, r)| block[b * width..b * width + 3].copy_from_slice(r));
            reduce(&mut triangle, 3, &mut block, width, &mut work);
        }
        for i in 0..3 {
            for j in 0..3 {
                let want: f64 = rows.iter().map(|r| r[i] * r[j]).sum();
                let got: f64 = (0..=i.min(j)).map(|k| triangle[k * width + i] * triangle[k * width + j]).sum();
                assert!((want - got).abs() < 1e-12 * want.abs(), "{i} {j}: {want} {got}");
            }
        }
        // the part of the second column that is orthogonal to the first
        let (a, d): (f64, f64) = rows.iter().fold((0.0, 0.0), |s, r| (s.0 + r[0] * r[0], s.1 + r[0] * (r[1] - r[0])));
        let want = rows.iter().map(|r| (r[1] - r[0] - d / a * r[0]).powi(2)).sum::<f64>().sqrt();
        assert!((triangle[width + 1].abs() / want - 1.0).abs() < 1e-4, "{} {want}", triangle[width + 1]);
    }
}
