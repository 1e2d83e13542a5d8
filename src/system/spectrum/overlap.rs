//! How coefficients of one noise go together at frequencies that are closer than one cycle in the record.
//!
//! Of white noise of unit variance `E[x(w) x(v)*] = rho(w - v)/N` and `E[x(w) x(v)] = rho(w + v)/N` with the kernel of Dirichlet,
//! `rho(d) = 1/N sum_k exp(-j d k dt)`: on the record's own grid each coefficient goes with itself alone, elsewhere neighbours repeat each other.

use fdm_numeric::fourier::ComplexFft;
use num_complex::Complex64;
use std::f64::consts::TAU;

/// Largest |rho| between different frequencies that counts as none.
const APART: f64 = 1e-6;
/// Part of a cycle by which frequencies that are one cycle apart may miss it.
const ROUNDED: f64 = 1e-6;
/// Most frequencies at unequal distances.
const MOST_UNEVEN: usize = 4096;

/// How many independent frequencies these (M, rising, in radians per unit of time) are worth in a record of this duration: closer than one cycle
/// in the record they repeat each other.
pub fn independent(omega: &[f64], duration: f64) -> f64 {
    let span = |pair: &[f64]| match (pair[1] - pair[0]) * duration / TAU {
        apart if apart > 1.0 - ROUNDED => 1.0,
        apart => apart,
    };
    omega.first().map_or(0.0, |_| 1.0) + omega.windows(2).map(span).sum::<f64>()
}

/// Sums over neighbouring frequencies, `sum_l rho(w_k - w_l) g_l + rho(w_k + w_l) g_l*`.
#[derive(Debug)]
pub struct Overlap {
    omega: Vec<f64>,
    samples: usize,
    dt: f64,
    kind: Kind,
}

#[derive(Debug)]
enum Kind {
    /// Nothing overlaps.
    Apart,
    /// Equal distances: both sums are convolutions.
    Even(Box<Convolution>),
    Uneven,
}

impl Overlap {
    /// Frequencies (M, rising, in radians per unit of time) of a record of `samples` samples, `dt` apart. None where there are
    /// more than 4096 of them at unequal distances.
    pub fn new(omega: &[f64], samples: usize, dt: f64) -> Option<Self> {
        let mut overlap = Self { omega: omega.to_vec(), samples, dt, kind: Kind::Uneven };
        let Some((first, last)) = omega.first().zip(omega.last()) else {
            overlap.kind = Kind::Apart;
            return Some(overlap);
        };
        let step = (last - first) / (omega.len().max(2) - 1) as f64;
        let even = omega.iter().enumerate().all(|(k, w)| (first + step * k as f64 - w).abs() <= 1e-9 * last);
        let own = |w: f64| {
            let cycles = w * samples as f64 * dt / TAU;
            (cycles - cycles.round()).abs() <= APART && cycles.round() >= 1.0
        };
        if omega.iter().all(|w| own(*w)) {
            overlap.kind = Kind::Apart;
        } else if even {
            overlap.kind = Kind::Even(Box::new(Convolution::new(omega.len(), |d, sum| {
                overlap.kernel(step * d as f64 + if sum { 2.0 * first } else { 0.0 })
            })));
        } else if omega.len() > MOST_UNEVEN {
            return None;
        }
        Some(overlap)
    }

    /// Whether every coefficient goes with itself alone.
    pub fn is_none(&self) -> bool {
        matches!(self.kind, Kind::Apart)
    }

    /// rho at a distance.
    fn kernel(&self, distance: f64) -> Complex64 {
        let (n, angle) = (self.samples as f64, 0.5 * distance * self.dt);
        let below = n * angle.sin();
        let size = if below.abs() < 1e-12 * n { (n * angle).cos() / angle.cos() } else { (n * angle).sin() / below };
        Complex64::cis(-(n - 1.0) * angle) * size
    }

    /// The sums for one plane `g` (M), written to `out` (M).
    pub fn gather(&mut self, g: &[Complex64], out: &mut [Complex64]) {
        match &mut self.kind {
            Kind::Apart => out.copy_from_slice(g),
            Kind::Even(convolution) => convolution.apply(g, out),
            Kind::Uneven => {
                for (k, to) in out.iter_mut().enumerate() {
                    let w = self.omega[k];
                    let of = |(l, g): (usize, &Complex64)| {
                        let v = self.omega[l];
                        self.kernel(w - v) * g + self.kernel(w + v) * g.conj()
                    };
                    *to = g.iter().enumerate().map(of).sum();
                }
            }
        }
    }
}

/// Both sums by fast transforms.
#[derive(Debug)]
struct Convolution {
    fft: ComplexFft,
    /// Transforms of rho(w_k - w_l) by k - l, and of rho(w_k + w_l) by k + l.
    difference: Vec<Complex64>,
    sum: Vec<Complex64>,
    memory: [Vec<Complex64>; 2],
}

impl Convolution {
    /// `kernel(d, false)` is rho of d steps, `kernel(d, true)` of d steps more than twice the first frequency.
    fn new(count: usize, kernel: impl Fn(i64, bool) -> Complex64) -> Self {
        let length = (4 * count).next_power_of_two();
        let mut fft = ComplexFft::new(length);
        let (mut difference, mut sum) = (vec![Complex64::ZERO; length], vec![Complex64::ZERO; length]);
        for d in 0..count as i64 {
            difference[d as usize] = kernel(d, false);
            difference[(length as i64 - d) as usize % length] = kernel(-d, false);
        }
        (0..2 * count - 1).for_each(|d| sum[d] = kernel(d as i64, true));
        fft.forward(&mut difference);
        fft.forward(&mut sum);
        let scale = 1.0 / length as f64;
        difference.iter_mut().chain(&mut sum).for_each(|v| *v *= scale);
        let memory = [vec![Complex64::ZERO; length], vec![Complex64::ZERO; length]];
        Self { fft, difference, sum, memory }
    }

    fn apply(&mut self, g: &[Complex64], out: &mut [Complex64]) {
        let (count, length) = (g.len(), self.difference.len());
        let [plain, mirrored] = &mut self.memory;
        plain.fill(Complex64::ZERO);
        mirrored.fill(Complex64::ZERO);
        for (l, g) in g.iter().enumerate() {
            plain[l] = *g;
            // k + l = k - (-l)
            mirrored[(length - l) % length] = g.conj();
        }
        self.fft.forward(plain);
        self.fft.forward(mirrored);
        plain.iter_mut().zip(mirrored).zip(&self.difference).zip(&self.sum).for_each(|(((p, m), d), s)| {
            *p = *p * d + *m * s;
        });
        self.fft.backward(plain);
        out.copy_from_slice(&plain[..count]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn directly(omega: &[f64], samples: usize, dt: f64, g: &[Complex64]) -> Vec<Complex64> {
        let rho = |d: f64| {
            let terms = (0..samples).map(|k| Complex64::cis(-d * k as f64 * dt));
            terms.sum::<Complex64>() / samples as f64
        };
        let sum = |w: &f64| omega.iter().zip(g).map(|(v, g)| rho(w - v) * g + rho(w + v) * g.conj()).sum();
        omega.iter().map(sum).collect()
    }

    #[test]
    fn sums_are_those_of_the_definition() {
        let (samples, dt) = (97, 0.13);
        let own = TAU / (samples as f64 * dt);
        let combs: [Vec<f64>; 4] = [
            (1..20).map(|k| own * f64::from(k)).collect(),
            (0..23).map(|k| 0.31 + 0.17 * f64::from(k)).collect(),
            (0..9).map(|k| 0.5 + 0.3 * f64::from(k * k)).collect(),
            vec![1.234],
        ];
        for omega in combs {
            let g: Vec<Complex64> =
                (0..omega.len()).map(|k| Complex64::new((k as f64).sin(), (1.7 * k as f64).cos())).collect();
            let mut overlap = Overlap::new(&omega, samples, dt).expect("few frequencies");
            let mut out = vec![Complex64::ZERO; g.len()];
            overlap.gather(&g, &mut out);
            for (got, want) in out.iter().zip(directly(&omega, samples, dt, &g)) {
                assert!((got - want).norm() < 1e-11, "{got} {want}");
            }
        }
    }
}
