//! Cholesky factors of small symmetric matrices, row-major.

/// Replaces the lower triangle of a symmetric matrix by its Cholesky factor; none when it is not positive definite.
pub(in crate::estimate) fn cholesky(a: &mut [f64], n: usize) -> Option<()> {
    for j in 0..n {
        for i in j..n {
            let (head, tail) = a.split_at(i * n);
            let above = if i == j { &tail[..j] } else { &head[j * n..j * n + j] };
            let sum: f64 = tail[..j].iter().zip(above).map(|(x, y)| x * y).sum();
            let rest = a[i * n + j] - sum;
            if i > j {
                a[i * n + j] = rest / a[j * n + j];
            } else if rest > 0.0 {
                a[j * n + j] = rest.sqrt();
            } else {
                return None;
            }
        }
    }
    Some(())
}

/// Solves L x = b in place.
pub(in crate::estimate) fn forward(factor: &[f64], n: usize, x: &mut [f64]) {
    for i in 0..n {
        let sum: f64 = factor[i * n..i * n + i].iter().zip(&*x).map(|(l, x)| l * x).sum();
        x[i] = (x[i] - sum) / factor[i * n + i];
    }
}

/// Solves L' x = b in place.
pub(in crate::estimate) fn backward(factor: &[f64], n: usize, x: &mut [f64]) {
    for i in (0..n).rev() {
        let sum: f64 = (i + 1..n).map(|k| factor[k * n + i] * x[k]).sum();
        x[i] = (x[i] - sum) / factor[i * n + i];
    }
}

/// The inverse of a symmetric matrix; none when it is not positive definite.
pub(in crate::estimate) fn inverse_of(matrix: &[f64], n: usize) -> Option<Vec<f64>> {
    let mut factor = matrix.to_vec();
    cholesky(&mut factor, n)?;
    let mut inverse = vec![0.0; n * n];
    for (j, column) in inverse.chunks_mut(n).enumerate() {
        column[j] = 1.0;
        forward(&factor, n, column);
        backward(&factor, n, column);
    }
    for i in 0..n {
        for j in 0..i {
            let mean = 0.5 * (inverse[i * n + j] + inverse[j * n + i]);
            (inverse[i * n + j], inverse[j * n + i]) = (mean, mean);
        }
    }
    Some(inverse)
}

/// Largest sum of magnitudes of a row.
pub(in crate::estimate) fn norm(matrix: &[f64], n: usize) -> f64 {
    matrix.chunks(n).map(|row| row.iter().map(|v| v.abs()).sum()).fold(0.0, f64::max)
}
