//! Noises of several colours, alone and shared between outputs.

use fdm_numeric::fourier::ComplexFft;
use fdm_numeric::random::Stream;
use num_complex::Complex;

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Colour {
    White,
    /// 70 % of the power in 1/f, the rest white.
    Pink,
    /// First order Gauss-Markov, nine tenths of it kept from sample to sample.
    Markov,
    /// A resonance.
    Resonant,
    /// Six tenths of the power of every output are the same white noise.
    Common,
    /// The first two outputs share 1/f noise that each has passed through a lag of its own; white noise beside it.
    Gust,
}

impl Colour {
    pub(super) const ALONE: [Self; 4] = [Self::White, Self::Pink, Self::Markov, Self::Resonant];
    pub(super) const SHARED: [Self; 2] = [Self::Common, Self::Gust];

    /// Noise of unit variance for every output.
    pub(super) fn noise(self, samples: usize, channels: usize, normal: &mut Stream) -> Vec<Vec<f64>> {
        match self {
            Self::White => (0..channels).map(|_| white(samples, normal)).collect(),
            Self::Pink => (0..channels).map(|_| mixed(0.7, &pink(samples, normal), normal)).collect(),
            Self::Markov => (0..channels).map(|_| markov(samples, normal)).collect(),
            Self::Resonant => (0..channels).map(|_| resonant(samples, normal)).collect(),
            Self::Common => {
                let shared = white(samples, normal);
                (0..channels).map(|_| mixed(0.6, &shared, normal)).collect()
            }
            Self::Gust => {
                let shared = pink(samples, normal);
                let of = |c: usize| if c < 2 { lagged(&shared, [1.0, 8.0][c]) } else { white(samples, normal) };
                let parts: Vec<Vec<f64>> = (0..channels).map(of).collect();
                parts.iter().map(|part| mixed(0.7, part, normal)).collect()
            }
        }
    }
}

fn white(samples: usize, normal: &mut Stream) -> Vec<f64> {
    (0..samples).map(|_| normal.normal_of_pair()).collect()
}

/// A share of the power from one noise, the rest white.
fn mixed(share: f64, noise: &[f64], normal: &mut Stream) -> Vec<f64> {
    noise.iter().map(|e| share.sqrt() * e + (1.0 - share).sqrt() * normal.normal_of_pair()).collect()
}

/// Through a lag of so many samples, and to unit variance again.
fn lagged(noise: &[f64], lag: f64) -> Vec<f64> {
    let mut level = noise[0];
    let mut out: Vec<f64> = noise
        .iter()
        .map(|e| {
            level += (e - level) / (1.0 + lag);
            level
        })
        .collect();
    let mean = out.iter().sum::<f64>() / out.len() as f64;
    let size = (out.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / out.len() as f64).sqrt();
    out.iter_mut().for_each(|v| *v /= size);
    out
}

fn markov(samples: usize, normal: &mut Stream) -> Vec<f64> {
    let mut last = normal.normal_of_pair();
    let mut next = || {
        last = 0.9 * last + 0.19_f64.sqrt() * normal.normal_of_pair();
        last
    };
    (0..samples).map(|_| next()).collect()
}

fn resonant(samples: usize, normal: &mut Stream) -> Vec<f64> {
    let (mut a, mut b) = (0.0, 0.0);
    let mut next = || {
        let e = 1.6 * a - 0.85 * b + normal.normal_of_pair();
        (b, a) = (a, e);
        e / 4.2
    };
    for _ in 0..50 {
        next();
    }
    (0..samples).map(|_| next()).collect()
}

/// 1/f noise of unit variance, cut out of a longer record.
fn pink(samples: usize, normal: &mut Stream) -> Vec<f64> {
    let long = 4 * samples;
    let mut bins: Vec<Complex<f64>> = (0..long)
        .map(|k| {
            let f = k.min(long - k).max(1) as f64;
            Complex::new(normal.normal_of_pair(), normal.normal_of_pair()) / f.sqrt()
        })
        .collect();
    bins[0] = Complex::default();
    ComplexFft::new(long).forward(&mut bins);
    let part: Vec<f64> = bins[samples..2 * samples].iter().map(|c| c.re).collect();
    let size = (bins.iter().map(|c| c.re * c.re).sum::<f64>() / long as f64).sqrt();
    part.into_iter().map(|v| v / size).collect()
}
