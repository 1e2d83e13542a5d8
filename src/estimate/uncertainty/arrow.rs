//! Symmetric matrices of unknowns that some belong to one run alone: zero between the unknowns of different runs, so that these are eliminated run by
//! run, and only what all share is left (Schur complement).

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Which unknowns (n) are shared, and which belong to one run alone.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Blocks {
    shared: Vec<usize>,
    own: Vec<Vec<usize>>,
}

impl Blocks {
    /// Of runs with their unknowns, beside a matrix (n by n): where that couples the unknowns of different runs there is but one block.
    pub(super) fn new(runs: &[Vec<usize>], beside: &DMatrix<f64>) -> Self {
        let n = beside.nrows();
        let mut owner: Vec<Option<usize>> = vec![None; n];
        let mut uses = vec![0; n];
        for (r, places) in runs.iter().enumerate() {
            for place in places {
                uses[*place] += 1;
                owner[*place] = Some(r);
            }
        }
        // what no run has is shared, as far as anybody knows
        let owner: Vec<Option<usize>> = owner.into_iter().zip(uses).map(|(o, uses)| o.filter(|_| uses == 1)).collect();
        let apart = |i: usize, j: usize| matches!((owner[i], owner[j]), (Some(a), Some(b)) if a != b);
        if (0..n).any(|i| (0..i).any(|j| apart(i, j) && beside[(i, j)] != 0.0)) {
            return Self::one(n);
        }
        let of = |who: Option<usize>| (0..n).filter(|i| owner[*i] == who).collect();
        Self { shared: of(None), own: (0..runs.len()).map(|r| of(Some(r))).collect() }
    }

    /// All in one.
    pub(super) fn one(n: usize) -> Self {
        Self { shared: Vec::new(), own: vec![(0..n).collect()] }
    }

    /// Number of unknowns n.
    pub(super) fn len(&self) -> usize {
        self.shared.len() + self.own.iter().map(Vec::len).sum::<usize>()
    }

    /// A vector (n) by blocks.
    pub(super) fn parts(&self, vector: &DVector<f64>) -> Parts {
        let pick = |places: &Vec<usize>| DVector::from_iterator(places.len(), places.iter().map(|i| vector[*i]));
        Parts { shared: pick(&self.shared), own: self.own.iter().map(pick).collect() }
    }
}

/// A vector by blocks.
#[derive(Debug, Clone)]
pub(super) struct Parts {
    shared: DVector<f64>,
    own: Vec<DVector<f64>>,
}

impl Parts {
    /// Adds another over a divisor.
    pub(super) fn add_over(&mut self, divisor: f64, other: &Self) {
        for (to, from) in std::iter::once((&mut self.shared, &other.shared)).chain(self.own.iter_mut().zip(&other.own))
        {
            to.iter_mut().zip(from.iter()).for_each(|(to, from)| *to += from / divisor);
        }
    }

    /// The scalar product.
    pub(super) fn dot(&self, other: &Self) -> f64 {
        self.own.iter().zip(&other.own).map(|(a, b)| a.dot(b)).sum::<f64>() + self.shared.dot(&other.shared)
    }
}

/// A symmetric matrix by blocks.
#[derive(Debug, Clone)]
pub(super) struct Arrow {
    shared: DMatrix<f64>,
    /// Own by shared, for each run.
    coupling: Vec<DMatrix<f64>>,
    own: Vec<DMatrix<f64>>,
}

impl Arrow {
    /// The blocks of a matrix (n by n) that is zero elsewhere.
    pub(super) fn of(blocks: &Blocks, matrix: &DMatrix<f64>) -> Self {
        let pick = |rows: &[usize], columns: &[usize]| {
            DMatrix::from_fn(rows.len(), columns.len(), |i, j| matrix[(rows[i], columns[j])])
        };
        Self {
            shared: pick(&blocks.shared, &blocks.shared),
            coupling: blocks.own.iter().map(|own| pick(own, &blocks.shared)).collect(),
            own: blocks.own.iter().map(|own| pick(own, own)).collect(),
        }
    }

    fn blocks(&self) -> impl Iterator<Item = &DMatrix<f64>> {
        std::iter::once(&self.shared).chain(&self.coupling).chain(&self.own)
    }

    /// Adds another over a divisor.
    pub(super) fn add_over(&mut self, divisor: f64, other: &Self) {
        let blocks = std::iter::once(&mut self.shared).chain(&mut self.coupling).chain(&mut self.own);
        for (to, from) in blocks.zip(other.blocks()) {
            to.iter_mut().zip(from.iter()).for_each(|(to, from)| *to += from / divisor);
        }
    }

    /// Raises the diagonal by a part of its largest number.
    pub(super) fn raise(&mut self, part: f64) {
        let square = || std::iter::once(&self.shared).chain(&self.own);
        let largest = square().flat_map(|m| (0..m.nrows()).map(|i| m[(i, i)].abs())).fold(0.0, f64::max);
        for m in std::iter::once(&mut self.shared).chain(&mut self.own) {
            (0..m.nrows()).for_each(|i| m[(i, i)] += part * largest);
        }
    }

    /// `x' A x`.
    pub(super) fn square(&self, x: &Parts) -> f64 {
        let mut sum = x.shared.dot(&(&self.shared * &x.shared));
        for ((own, coupling), x_own) in self.own.iter().zip(&self.coupling).zip(&x.own) {
            sum += x_own.dot(&(own * x_own)) + 2.0 * x_own.dot(&(coupling * &x.shared));
        }
        sum
    }

    /// The sum of the products of all entries: the trace of the product.
    pub(super) fn dot(&self, other: &Self) -> f64 {
        let pairs = |a: &[DMatrix<f64>], b: &[DMatrix<f64>]| a.iter().zip(b).map(|(a, b)| a.dot(b)).sum::<f64>();
        pairs(&self.own, &other.own) + self.shared.dot(&other.shared) + 2.0 * pairs(&self.coupling, &other.coupling)
    }

    /// Its factors; none where it is not positive definite.
    pub(super) fn factor(self) -> Option<Factors> {
        let own: Vec<Cholesky<f64, Dyn>> = self.own.into_iter().map(Cholesky::new).collect::<Option<_>>()?;
        let gains: Vec<DMatrix<f64>> = own.iter().zip(&self.coupling).map(|(own, c)| own.solve(c)).collect();
        let mut rest = self.shared;
        self.coupling.iter().zip(&gains).for_each(|(c, gain)| rest.gemm_tr(-1.0, c, gain, 1.0));
        Some(Factors { own, gains, rest: Cholesky::new(rest)? })
    }
}

/// Factors of a matrix by blocks.
pub(super) struct Factors {
    own: Vec<Cholesky<f64, Dyn>>,
    /// What the own unknowns follow the shared ones by (own by shared).
    gains: Vec<DMatrix<f64>>,
    /// Of what is left of the shared block.
    rest: Cholesky<f64, Dyn>,
}

impl Factors {
    /// Logarithm of the determinant.
    pub(super) fn logarithm(&self) -> f64 {
        let of = |c: &Cholesky<f64, Dyn>| c.l_dirty().diagonal().iter().map(|d| 2.0 * d.ln()).sum::<f64>();
        self.own.iter().map(of).sum::<f64>() + of(&self.rest)
    }

    /// Solves for a vector.
    pub(super) fn solve(&self, vector: &Parts) -> Parts {
        let mut shared = vector.shared.clone();
        self.gains.iter().zip(&vector.own).for_each(|(gain, own)| shared.gemv_tr(-1.0, gain, own, 1.0));
        let shared = self.rest.solve(&shared);
        let mut own = Vec::with_capacity(self.own.len());
        for ((factor, gain), v) in self.own.iter().zip(&self.gains).zip(&vector.own) {
            let mut x = factor.solve(v);
            x.gemv(-1.0, gain, &shared, 1.0);
            own.push(x);
        }
        Parts { shared, own }
    }

    /// The blocks of the inverse.
    pub(super) fn inverse(&self) -> Arrow {
        let shared = self.rest.inverse();
        let coupling: Vec<DMatrix<f64>> = self.gains.iter().map(|gain| -(gain * &shared)).collect();
        let mut own = Vec::with_capacity(self.own.len());
        for ((factor, gain), coupling) in self.own.iter().zip(&self.gains).zip(&coupling) {
            own.push(factor.inverse() - coupling * gain.transpose());
        }
        Arrow { shared, coupling, own }
    }
}
