//! A case: the records that the tool sees, and the truth that it does not.

use crate::chance::Chance;
use crate::experiment::{self, MANOEUVRES};
use crate::hidden::{INSIDE, OUTSIDE, Part, Place, Structure, disturbed, menu, sites};
use crate::noise::Noise;
use crate::oracle::{Biases, Fitted, Oracle, Projection, dot, free, response};
use crate::plan::{Hides, Spec};
use crate::plant::{Drives, gust, with_gust};
use crate::scales::Known;
use crate::sizing::size_for;
use fdm::Model;
use fdm::effect::{Candidate, Subject};
use fdm::record::Run;
use serde_json::{Value, json};
use std::path::Path;

/// Gains in log-likelihood between which effects are drawn.
pub(crate) const BINS: [(f64, f64); 4] = [(5.0, 15.0), (15.0, 50.0), (50.0, 300.0), (300.0, 2000.0)];

/// What is true of a case.
pub(crate) struct Truth {
    pub(crate) places: Vec<Place>,
    pub(crate) sites: Vec<(Part, String)>,
    pub(crate) text: String,
    pub(crate) numbers: Vec<(String, f64)>,
    /// Gain of the true structure on the runs that are fitted, and on the one that is not.
    pub(crate) gain: f64,
    pub(crate) gain_validation: f64,
    /// What each effect adds to the others.
    pub(crate) parts: Vec<f64>,
    /// Effects of the catalogue that come as near to the truth as these nats, over all manoeuvres without noise.
    pub(crate) rivals: Vec<(Place, f64)>,
}

/// A case that has been made.
pub(crate) struct Case {
    pub(crate) spec: Spec,
    pub(crate) base: Model,
    pub(crate) noise: Noise,
    pub(crate) biases: Biases,
    pub(crate) known: Known,
    /// The three manoeuvres with noise.
    pub(crate) runs: Vec<Run>,
    /// The base model fitted in the true metric.
    pub(crate) fitted: Fitted,
    pub(crate) truth: Truth,
}

/// What is fixed before a truth is drawn.
struct Ground {
    spec: Spec,
    base: Model,
    theta: Vec<f64>,
    excitation: [Vec<f64>; 3],
    open: Vec<Run>,
    known: Known,
    noise: Noise,
    biases: Biases,
    /// Noise of each manoeuvre.
    drawn: Vec<Vec<f64>>,
    /// Spread of each output of the base model.
    spread: Vec<f64>,
}

/// What a disturbance adds to the output that hears it second most, at least, over the noise there (both root mean squares).
const HEARD: f64 = 0.5;

/// Truths that are tried before a case is given up.
const TRIES: usize = 40;

impl Case {
    /// The case of a specification, the same whenever it is made.
    ///
    /// # Panics
    /// When no truth of the wanted kind can be made in this family.
    pub(crate) fn new(spec: Spec) -> Self {
        let mut chance = Chance::new(&spec.name());
        let ground = Ground::new(spec, &mut chance);
        for attempt in 0..TRIES {
            let made = match spec.hides {
                Hides::Nothing => ground.nothing(),
                Hides::Effect | Hides::Loop => ground.effect(attempt, 1, &mut chance),
                Hides::Outside => ground.effect(attempt, 1, &mut chance),
                Hides::Pair => ground.effect(attempt, 2, &mut chance),
                Hides::Gust => ground.gusty(&mut chance),
            };
            if let Some((runs, fitted, truth)) = made {
                let Ground { base, noise, biases, known, .. } = ground;
                return Self { spec, base, noise, biases, known, runs, fitted, truth };
            }
        }
        panic!("{}: no truth was found", spec.name());
    }

    /// The case in which one effect of the catalogue, written `effect(target)`, is hidden, with about this gain.
    pub(crate) fn hiding(spec: Spec, written: &str, gain: f64) -> Self {
        let ground = Ground::new(spec, &mut Chance::new(&spec.name()));
        let subject = Subject::new(ground.base.source(), ground.base.definition()).expect("a text that compiles");
        let places = INSIDE.places(&subject);
        let candidate = places.find(written).unwrap_or_else(|| panic!("{written} does not fit"));
        let mut own = Chance::new(written);
        let made = Structure::bare(&ground.base, &ground.theta).with(candidate, &ground.known, &mut own);
        let made =
            made.and_then(|s| ground.realised(&s, std::slice::from_ref(&s), vec![ground.size(&s, gain)?], &[gain]));
        let (runs, fitted, truth) = made.unwrap_or_else(|| panic!("{written} cannot gain {gain}"));
        let Ground { base, noise, biases, known, .. } = ground;
        Self { spec, base, noise, biases, known, runs, fitted, truth }
    }

    pub(crate) fn oracle(&self) -> Oracle<'_> {
        Oracle { noise: &self.noise, biases: &self.biases }
    }

    /// Everything as files: what the tool sees, and `truth.json`.
    pub(crate) fn write(&self, folder: &Path) {
        std::fs::create_dir_all(folder).expect("a folder that can be made");
        std::fs::write(folder.join("model.fdm"), self.spec.family.text).expect("a folder that can be written to");
        let unit = self.base.definition().time.to_string();
        for run in &self.runs {
            experiment::write_run(&folder.join(format!("{}.csv", run.name)), &self.base, run, &unit);
        }
        let text = serde_json::to_string_pretty(&self.json()).expect("numbers and words");
        std::fs::write(folder.join("truth.json"), text + "\n").expect("a folder that can be written to");
    }

    fn json(&self) -> Value {
        let place = |p: &Place| json!({"effect": p.effect, "targets": p.targets});
        let t = &self.truth;
        json!({
            "case": self.spec.name(),
            "family": self.spec.family.name,
            "hides": self.spec.hides.name(),
            "colour": self.spec.colour.name(),
            "level": self.spec.level,
            "sigma": self.noise.sigma,
            "effects": t.places.iter().map(place).collect::<Vec<_>>(),
            "sites": t.sites.iter().map(|(part, name)| json!([format!("{part:?}").to_lowercase(), name])).collect::<Vec<_>>(),
            "numbers": t.numbers.iter().map(|(n, v)| json!([n, v])).collect::<Vec<_>>(),
            "gain": t.gain,
            "gain_validation": t.gain_validation,
            "parts": t.parts,
            "rivals": t.rivals.iter().map(|(p, d)| json!([p.to_string(), d])).collect::<Vec<_>>(),
            "text": t.text,
        })
    }
}

impl Ground {
    fn new(spec: Spec, chance: &mut Chance) -> Self {
        let family = spec.family;
        let base = Model::from_text("model.fdm", family.text).expect("a family that compiles");
        // the truth's numbers are not the model's start values
        let params = &base.definition().params;
        let theta: Vec<f64> = params
            .iter()
            .map(|p| (p.value * (0.1 * chance.normal().clamp(-2.0, 2.0)).exp()).clamp(p.lower, p.upper))
            .collect();
        let excitation = experiment::excitation(family, chance);
        let run = |(name, moved): (&&str, &Vec<f64>)| {
            experiment::run(&base, name, family.step, experiment::inputs(family, moved))
        };
        let open: Vec<Run> = MANOEUVRES.iter().zip(&excitation).map(run).collect();
        let known = Known::new(family, &base, &theta, &open[..2]);
        let responses: Vec<Vec<f64>> =
            open[..2].iter().map(|r| response(&base, r, &theta).expect("the base model responds")).collect();
        let q = base.layout().outputs;
        let spread: Vec<f64> = (0..q).map(|c| deviation(&responses, q, c)).collect();
        let sigma = spread.iter().map(|s| spec.level * s).collect();
        let noise = Noise::new(spec.colour, sigma, family.samples, chance);
        let biases = Biases::new(&noise, family.samples);
        let drawn = (0..3).map(|_| noise.draw(family.samples, chance)).collect();
        Self { spec, base, theta, excitation, open, known, noise, biases, drawn, spread }
    }

    fn oracle(&self) -> Oracle<'_> {
        Oracle { noise: &self.noise, biases: &self.biases }
    }

    fn drives(&self) -> Drives<'_> {
        match self.spec.hides {
            Hides::Loop => {
                Drives::Closed { family: self.spec.family, excitation: &self.excitation, noise: &self.drawn }
            }
            _ => Drives::Open(self.open.clone()),
        }
    }

    fn noisy(&self, clean: Vec<Run>) -> Vec<Run> {
        let add = |(mut run, noise): (Run, &Vec<f64>)| {
            run.measured.iter_mut().zip(noise).for_each(|(y, n)| *y += n);
            run
        };
        clean.into_iter().zip(&self.drawn).map(add).collect()
    }

    fn nothing(&self) -> Option<(Vec<Run>, Fitted, Truth)> {
        let runs = self.noisy(self.drives().clean(&self.base, &self.theta)?);
        let fitted = self.oracle().fit(&self.base, &runs[..2], &self.theta)?;
        let truth = Truth {
            places: Vec::new(),
            sites: Vec::new(),
            text: self.base.source().text().into(),
            numbers: Vec::new(),
            gain: 0.0,
            gain_validation: 0.0,
            parts: Vec::new(),
            rivals: Vec::new(),
        };
        Some((runs, fitted, truth))
    }

    /// One effect or several of the catalogue, or one from outside of it, with sizes that give the gains that were drawn.
    fn effect(&self, attempt: usize, count: usize, chance: &mut Chance) -> Option<(Vec<Run>, Fitted, Truth)> {
        let outside = self.spec.hides == Hides::Outside;
        let menu = menu(self.spec.family, &self.base, if outside { &OUTSIDE } else { &INSIDE });
        let kinds: Vec<&Vec<Candidate>> = menu.values().collect();
        // every name has its turn, at a place that is drawn; after some failures the next name
        let Spec { family, hides, colour, level, .. } = self.spec;
        let offset = Chance::new(&format!("{} {hides:?} {colour:?} {level}", family.name)).below(1000);
        let mut chosen: Vec<&Candidate> = Vec::new();
        for k in 0..count {
            let turn = if k == 0 { self.spec.number + attempt / 5 + offset } else { chance.below(kinds.len()) };
            let places = kinds[turn % kinds.len()];
            chosen.push(&places[chance.below(places.len())]);
        }
        if count == 2 && Place::of(chosen[0]) == Place::of(chosen[1]) {
            return None;
        }
        let bins = if outside || count > 1 { &BINS[1..] } else { &BINS[..] };
        let (low, high) = bins[chance.below(bins.len())];
        let targets: Vec<f64> = chosen.iter().map(|_| chance.log_between(low, high)).collect();
        let alone = |c: &Candidate| {
            let mut own = Chance::new(&format!("{} {} {c}", self.spec.name(), attempt));
            (Structure::bare(&self.base, &self.theta).with(c, &self.known, &mut own), own)
        };
        let singles: Option<Vec<Structure>> = chosen.iter().map(|c| alone(c).0).collect();
        let singles = singles?;
        let mut sizes = Vec::new();
        for (single, target) in singles.iter().zip(&targets) {
            sizes.push(self.size(single, *target)?);
        }
        let whole = match count {
            1 => singles[0].clone(),
            _ => {
                let mut own = Chance::new(&format!("{} {} {}", self.spec.name(), attempt, chosen[1]));
                singles[0].with(chosen[1], &self.known, &mut own)?
            }
        };
        self.realised(&whole, &singles, sizes, &targets)
    }

    /// The size for a gain, as the projected difference of noise-free responses predicts it.
    fn size(&self, structure: &Structure, target: f64) -> Option<f64> {
        let (oracle, drives) = (self.oracle(), self.drives());
        let plain = drives.clean(&self.base, &self.theta)?;
        let columns = free(&self.base);
        let (_, jacobian) = oracle.linearised(&self.base, &plain[..2], &self.theta, &columns)?;
        let projection = Projection::new(&jacobian);
        let gain = |size: f64| {
            let theta = structure.theta(&[size])?;
            let clean = drives.clean(&structure.model, &theta)?;
            self.is_mild(&clean[..2])?;
            let difference = projection.apply(oracle.residual(&self.base, &clean[..2], &self.theta)?);
            Some(0.5 * dot(&difference, &difference))
        };
        size_for(target, structure.typical[0], gain)
    }

    /// Whether the base model's outputs are still of the size of the truth's.
    fn is_mild(&self, clean: &[Run]) -> Option<()> {
        let q = self.spread.len();
        let square = |c: usize| {
            let (mut sum, mut n) = (0.0, 0.0);
            for run in clean {
                let base = response(&self.base, run, &self.theta)?;
                for (a, b) in run.measured.iter().zip(&base).skip(c).step_by(q) {
                    sum += (a - b) * (a - b);
                    n += 1.0;
                }
            }
            Some((sum / n).sqrt())
        };
        (0..q).all(|c| square(c).is_some_and(|s| s < 1.5 * self.spread[c])).then_some(())
    }

    /// Fits everything to the noisy data; sizes are mended until the realised gain is in the range that was drawn.
    fn realised(
        &self,
        whole: &Structure,
        singles: &[Structure],
        mut sizes: Vec<f64>,
        targets: &[f64],
    ) -> Option<(Vec<Run>, Fitted, Truth)> {
        let (oracle, drives) = (self.oracle(), self.drives());
        let wanted: f64 = targets.iter().sum();
        for _ in 0..4 {
            let theta = whole.theta(&sizes)?;
            let runs = self.noisy(drives.clean(&whole.model, &theta)?);
            let (train, held) = runs.split_at(2);
            let base = oracle.fit(&self.base, train, &self.theta)?;
            let best = oracle.fit(&whole.model, train, &theta)?;
            let gain = 0.5 * (base.cost - best.cost);
            let ratio: f64 = gain / wanted;
            if singles.len() == 1 && !(0.75..1.33).contains(&ratio) {
                let factor = ratio.max(0.02).sqrt().clamp(0.3, 3.0);
                sizes.iter_mut().for_each(|s| *s /= factor);
                continue;
            }
            let parts = self.parts(whole, singles, &sizes, train, &best)?;
            if parts.iter().any(|p| *p < 10.0) && singles.len() > 1 {
                return None;
            }
            let before = oracle.cost(&self.base, held, &base.theta);
            let gain_validation = 0.5 * (before - oracle.cost(&whole.model, held, &best.theta));
            let clean = drives.clean(&whole.model, &theta)?;
            let rivals = crate::twins::rivals(&self.base, &self.known, &oracle, whole, &clean, &base.theta);
            if self.spec.hides == Hides::Outside && !rivals.is_empty() {
                // the catalogue has it under another name
                return None;
            }
            let truth = Truth {
                places: whole.places.clone(),
                sites: whole.places.iter().flat_map(|p| sites(p, &self.base)).collect(),
                text: whole.model.source().text().into(),
                numbers: whole.own(&theta, &self.base),
                gain,
                gain_validation,
                parts,
                rivals,
            };
            return Some((runs, base, truth));
        }
        None
    }

    /// What each effect adds to the others.
    fn parts(
        &self,
        whole: &Structure,
        singles: &[Structure],
        sizes: &[f64],
        train: &[Run],
        best: &Fitted,
    ) -> Option<Vec<f64>> {
        if whole.places.len() == 1 {
            return Some(Vec::new());
        }
        // the first is what is lost when only the second is there
        let without = |k: usize| {
            let other = &singles[1 - k];
            let fitted = self.oracle().fit(&other.model, train, &other.theta(&[sizes[1 - k]])?)?;
            Some(0.5 * (fitted.cost - best.cost))
        };
        (0..2).map(without).collect()
    }

    /// A random force in one equation.
    fn gusty(&self, chance: &mut Chance) -> Option<(Vec<Run>, Fitted, Truth)> {
        let states = disturbed(&self.base);
        let state = &states[chance.below(states.len())];
        let text = with_gust(self.base.source().text(), state);
        let model = Model::from_text("gust", &text).ok()?;
        let mut theta = model.definition().start();
        for (p, v) in self.base.definition().params.iter().zip(&self.theta) {
            theta[model.definition().param(&p.quantity.name)?] = *v;
        }
        let family = self.spec.family;
        let memory = chance.log_between(2.0, family.samples as f64 / 30.0);
        let ratio = chance.log_between(1.5, 8.0);
        let forces: Vec<Vec<f64>> = (0..3).map(|_| gust(family.samples, memory, chance)).collect();
        let at = |size: f64| -> Option<Vec<Run>> {
            let pushed = |(run, force): (&Run, &Vec<f64>)| {
                let m = run.held.len();
                let row = |t: usize| {
                    std::iter::once(size * force[t]).chain(run.inputs[t * m..(t + 1) * m].to_vec()).collect::<Vec<_>>()
                };
                let driven = experiment::run(&model, &run.name, family.step, (0..run.len()).flat_map(row).collect());
                Some(Run { measured: response(&model, &driven, &theta)?, ..run.clone() })
            };
            self.open.iter().zip(&forces).map(pushed).collect()
        };
        let size = size_for(ratio * ratio, 1e-3, |size| self.heard(&at(size)?)?.last().copied())?;
        // seen by one sensor only, it is that sensor's coloured noise
        let second = self.heard(&at(size)?)?.into_iter().rev().nth(1)?;
        if second < HEARD * HEARD {
            return None;
        }
        let runs = self.noisy(at(size)?);
        let fitted = self.oracle().fit(&self.base, &runs[..2], &self.theta)?;
        let truth = Truth {
            places: vec![Place { effect: "process_noise".into(), targets: vec![state.clone()] }],
            sites: vec![(Part::Equation, state.clone())],
            text,
            numbers: vec![("size".into(), size), ("memory".into(), memory), ("ratio".into(), ratio)],
            gain: 0.0,
            gain_validation: 0.0,
            parts: Vec::new(),
            rivals: Vec::new(),
        };
        Some((runs, fitted, truth))
    }

    /// Mean squares of what is added to each output on the fitted runs, over the variance of its noise; rising.
    fn heard(&self, clean: &[Run]) -> Option<Vec<f64>> {
        let q = self.spread.len();
        let mut squares = vec![0.0; q];
        let mut samples = 0.0;
        for run in &clean[..2] {
            let base = response(&self.base, run, &self.theta)?;
            for (k, (a, b)) in run.measured.iter().zip(&base).enumerate() {
                squares[k % q] += ((a - b) / self.noise.sigma[k % q]).powi(2);
            }
            samples += (base.len() / q) as f64;
        }
        squares.iter_mut().for_each(|s| *s /= samples);
        squares.sort_by(f64::total_cmp);
        Some(squares)
    }
}

/// Standard deviation of an output over runs.
fn deviation(responses: &[Vec<f64>], q: usize, c: usize) -> f64 {
    let all: Vec<f64> = responses.iter().flat_map(|y| y.iter().skip(c).step_by(q).copied()).collect();
    let mean = all.iter().sum::<f64>() / all.len() as f64;
    (all.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / all.len() as f64).sqrt()
}
