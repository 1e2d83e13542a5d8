//! A resonance in the spectrum of a noise.
//!
//! With x the sine of half the phase from sample to sample over that at the resonance, D(z) = (1 - x^2)^2 + (2 z x)^2 is the square of a pair of
//! poles of damping z. 1/D(z) is autoregressive noise of order 2 (a mode that white noise shakes); D(w)/D(z) with w > z is the same through a
//! band pass, beside noise that goes on below and above it: 1 + (w^2 - z^2) (2 x)^2/D(z).

/// Damping ratios: those that are a resonance, and their logarithm's mean and deviation beforehand.
const LEAST: f64 = 0.002;
const MOST: f64 = 0.4;
const DAMPING: (f64, f64) = (-3.0, 1.0);
/// Mean and deviation beforehand of the logarithm of w over z.
const HEIGHT: (f64, f64) = (1.5, 1.0);
/// Damping ratios that a fit begins with, as parts of the width of the band that stands out.
const WIDTHS: [f64; 2] = [0.2, 0.7];
/// The largest change of a logarithm at once.
const STEP: f64 = 0.5;
/// Narrow bands on each side of the peak, as a part of its damping.
const NARROW: f64 = 0.5;
/// Half widths within which S bends too much for a wide band.
const REACH: f64 = 12.0;
/// Most numbers.
pub(super) const NUMBERS: usize = 3;

/// What it looks like away from its frequency.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Form {
    /// 1/D: it falls above its frequency.
    Poles,
    /// D(w)/D(z): it stands on what is beside it.
    Peak,
}

/// A resonance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Resonance {
    form: Form,
    /// Logarithms: of the sine of half the phase, of the damping ratio, of w over z.
    numbers: [f64; NUMBERS],
    /// Span of log f in which its frequency was looked for.
    span: f64,
    /// The Nyquist frequency.
    highest: f64,
}

/// A resonance by what its formula needs at every frequency.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shape {
    /// The inverse square of the sine of half the phase at the resonance.
    inverse: f64,
    /// (2 z)^2, and (2 w)^2 of a peak.
    poles: f64,
    zeros: Option<f64>,
}

impl Shape {
    /// Its logarithm at a place, and the derivatives of that by its numbers.
    pub(super) fn at(&self, place: f64) -> (f64, [f64; NUMBERS]) {
        let square = place * self.inverse;
        // D, and the derivatives of its logarithm by those of frequency and damping
        let of = |damping: f64| {
            let damped = damping * square;
            let value = ((1.0 - square).powi(2) + damped).max(f64::MIN_POSITIVE);
            (value, (4.0 * square * (1.0 - square) - 2.0 * damped) / value, 2.0 * damped / value)
        };
        let poles = of(self.poles);
        match self.zeros.map(of) {
            None => (-poles.0.ln(), [-poles.1, -poles.2, 0.0]),
            Some(zeros) => ((zeros.0 / poles.0).ln(), [zeros.1 - poles.1, zeros.2 - poles.2, zeros.2]),
        }
    }
}

/// The sine of half the phase from sample to sample.
fn half_phase(log_frequency: f64, highest: f64) -> f64 {
    (0.5 * std::f64::consts::PI * (log_frequency.exp() / highest).min(1.0)).sin()
}

impl Resonance {
    /// Where fits may begin, for a band (its ends in log f) that stands out of this span.
    pub(crate) fn starts((low, high): (f64, f64), form: Form, (span, highest): (f64, f64)) -> Vec<Self> {
        let frequency = half_phase(0.5 * (low + high), highest).ln();
        let of = |part: f64| {
            let damping = (part * (high - low)).clamp(0.01, 0.2).ln();
            Self { form, numbers: [frequency, damping, HEIGHT.0], span, highest }
        };
        WIDTHS.into_iter().map(of).collect()
    }

    /// That of a pair of poles, by 1 + a e^-iw + b e^-2iw; none where they are no resonance.
    pub(crate) fn of_poles((a, b): (f64, f64), form: Form, (span, highest): (f64, f64)) -> Option<Self> {
        // the square of its size is a polynomial q0 + q1 s + q2 s^2 of the square s of the sine of w/2
        let (q0, q1, q2) = ((1.0 + a + b).powi(2), -4.0 * (a + a * b + 4.0 * b), 16.0 * b);
        let square = (q0 / q2).sqrt();
        let damping = ((2.0 + q1 * square / q0) / 4.0).sqrt();
        // not a number where the poles are real
        let is_one = square < 1.0 && damping > LEAST && damping < MOST;
        is_one.then(|| Self { form, numbers: [0.5 * square.ln(), damping.ln(), HEIGHT.0], span, highest })
    }

    /// Numbers that it has.
    pub(crate) fn size(&self) -> usize {
        match self.form {
            Form::Poles => 2,
            Form::Peak => 3,
        }
    }

    /// Its logarithm at a frequency, and the derivatives of that by its numbers.
    pub(crate) fn at(&self, log_frequency: f64) -> (f64, [f64; NUMBERS]) {
        self.shape().at(Self::place(log_frequency, self.highest))
    }

    /// Where a frequency lies, whatever the resonance: the square of the sine of half the phase.
    pub(super) fn place(log_frequency: f64, highest: f64) -> f64 {
        half_phase(log_frequency, highest).powi(2)
    }

    /// What is the same at all frequencies.
    pub(super) fn shape(&self) -> Shape {
        let [frequency, damping, height] = self.numbers;
        let square = |log_damping: f64| 4.0 * (2.0 * log_damping).exp();
        let zeros = (self.form == Form::Peak).then(|| square(damping + height));
        Shape { inverse: (-2.0 * frequency).exp(), poles: square(damping), zeros }
    }

    /// Twice minus the logarithm of the prior density of its numbers.
    pub(crate) fn prior(&self) -> f64 {
        let of = |value: f64, (mean, deviation): (f64, f64)| ((value - mean) / deviation).powi(2);
        let height = if self.form == Form::Peak { of(self.numbers[2], HEIGHT) } else { 0.0 };
        of(self.numbers[1], DAMPING) + height
    }

    /// The derivative of that by each of its numbers, and the curvature.
    pub(super) fn prior_slopes(&self) -> [(f64, f64); NUMBERS] {
        let priors = [None, Some(DAMPING), (self.form == Form::Peak).then_some(HEIGHT)];
        std::array::from_fn(|k| {
            priors[k].map_or((0.0, 0.0), |(mean, deviation)| {
                (2.0 * (self.numbers[k] - mean) / deviation.powi(2), 2.0 * deviation.powi(-2))
            })
        })
    }

    /// This resonance in another form: of a peak that had none a height is expected.
    pub(super) fn in_form(self, form: Form) -> Self {
        Self { form, ..self }
    }

    /// With its numbers less these, as far as one step goes.
    pub(super) fn moved(&self, change: &[f64]) -> Self {
        let mut moved = *self;
        for (number, change) in moved.numbers.iter_mut().zip(change) {
            *number -= change.clamp(-STEP, STEP);
        }
        moved
    }

    /// Whether it is a resonance of a frequency between these (log f).
    pub(crate) fn is_one(&self, (low, high): (f64, f64)) -> bool {
        let [frequency, damping, height] = self.numbers;
        let within = frequency > half_phase(low, self.highest).ln() && frequency < half_phase(high, self.highest).ln();
        within && damping > LEAST.ln() && damping < MOST.ln() && (self.form == Form::Poles || height > 0.0)
    }

    /// What it costs where other numbers cost so much each: its frequency was one of as many as its band fits into the span.
    pub(crate) fn penalty(&self, each: f64) -> f64 {
        (self.span / self.damping()).ln().max(each) + each * (self.size() - 1) as f64
    }

    /// Its damping ratio.
    pub(crate) fn damping(&self) -> f64 {
        self.numbers[1].exp()
    }

    /// Widest band, as a ratio of its ends, over which S is nearly even at a frequency.
    pub(crate) fn even(&self, frequency: f64, otherwise: f64) -> f64 {
        let sine = half_phase(frequency.ln(), self.highest).ln();
        let damping = self.damping();
        if (sine - self.numbers[0]).abs() < REACH * damping { 1.0 + NARROW * damping } else { otherwise }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_are_those_of_differences() {
        for form in [Form::Poles, Form::Peak] {
            let one = Resonance { form, numbers: [-1.2, -2.6, 1.1], span: 4.0, highest: 10.0 };
            for log_frequency in [-1.0, 0.9, 1.05, 1.3, 2.2] {
                for k in 0..one.size() {
                    let moved = |step: f64| {
                        let mut moved = one;
                        moved.numbers[k] += step;
                        moved.at(log_frequency).0
                    };
                    let difference = (moved(1e-6) - moved(-1e-6)) / 2e-6;
                    let own = one.at(log_frequency).1[k];
                    assert!((own - difference).abs() < 1e-6 * own.abs().max(1.0), "{form:?} {k}: {own} {difference}");
                }
            }
        }
    }

    #[test]
    fn poles_are_those_of_autoregressive_noise() {
        // 1/|1 - 2 r cos(p) e^-iw + r^2 e^-2iw|^2, up to a factor
        let (radius, phase) = (0.95_f64, 0.6_f64);
        let spectrum = |w: f64| {
            let (a, b) = (-2.0 * radius * phase.cos(), radius * radius);
            let (re, im) = (1.0 + a * w.cos() + b * (2.0 * w).cos(), a * w.sin() + b * (2.0 * w).sin());
            -(re * re + im * im).ln()
        };
        let poles = (-2.0 * radius * phase.cos(), radius * radius);
        let one = Resonance::of_poles(poles, Form::Poles, (4.0, 0.5)).expect("a resonance");
        assert_eq!(Resonance::of_poles((-0.9, 0.2), Form::Poles, (4.0, 0.5)), None);
        let offset = spectrum(0.3) - one.at((0.3 / std::f64::consts::TAU).ln()).0;
        for w in [0.01, 0.2, 0.55, 0.6, 0.7, 1.5, 3.0] {
            let own = one.at((w / std::f64::consts::TAU).ln()).0 + offset;
            assert!((own - spectrum(w)).abs() < 1e-9, "{w}: {own} {}", spectrum(w));
        }
    }
}
