//! Which cases there are: families, kinds of truths, colours and levels of noise, numbers.

use crate::families::{FAMILIES, Family};
use crate::noise::Colour;

/// What is hidden.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Hides {
    Nothing,
    Effect,
    Pair,
    Gust,
    Outside,
    /// An effect, with a controller around the plant.
    Loop,
}

impl Hides {
    pub(crate) const ALL: [Self; 6] = [Self::Nothing, Self::Effect, Self::Pair, Self::Gust, Self::Outside, Self::Loop];

    pub(crate) fn name(self) -> &'static str {
        ["nothing", "effect", "pair", "gust", "outside", "loop"][self as usize]
    }

    pub(crate) fn named(name: &str) -> Self {
        Self::ALL.into_iter().find(|k| k.name() == name).unwrap_or_else(|| panic!("nothing is hidden as {name}"))
    }
}

/// A case before it is made; its name is its seed.
#[derive(Clone, Copy)]
pub(crate) struct Spec {
    pub(crate) family: &'static Family,
    pub(crate) hides: Hides,
    pub(crate) colour: Colour,
    /// Noise over what an output does, both root mean squares.
    pub(crate) level: f64,
    pub(crate) number: usize,
}

impl Spec {
    pub(crate) fn name(&self) -> String {
        let percent = (100.0 * self.level).round();
        let (family, hides, colour) = (self.family.name, self.hides.name(), self.colour.name());
        format!("{family}-{hides}-{colour}-{percent}-{:04}", self.number)
    }
}

/// What is asked for by the environment.
pub(crate) struct Plan {
    pub(crate) families: Vec<&'static Family>,
    pub(crate) hides: Vec<Hides>,
    pub(crate) colours: Vec<Colour>,
    pub(crate) levels: Vec<f64>,
    /// Cases with an effect for each family, colour and level.
    pub(crate) effects: usize,
    /// Cases without, the same.
    pub(crate) nulls: usize,
    /// Pairs, disturbances, causes outside and closed loops, of each.
    pub(crate) others: usize,
}

impl Plan {
    /// FDM_BLIND_FAMILIES, _HIDES, _COLOURS, _LEVELS (lists), _CASES, _NULLS, _OTHERS (numbers), and _APART=1 for the families
    /// that are kept apart, and no others.
    pub(crate) fn of_environment() -> Self {
        let apart = std::env::var("FDM_BLIND_APART").is_ok_and(|v| v == "1");
        let all: Vec<&Family> = FAMILIES.iter().filter(|f| f.apart == apart).collect();
        let chosen = |names: Vec<String>| -> Vec<&'static Family> {
            let families: Vec<&'static Family> = names.iter().map(|n| Family::named(n)).collect();
            let kept = families.iter().find(|f| f.apart != apart);
            assert!(kept.is_none(), "{} is kept apart: FDM_BLIND_APART=1 runs it", kept.map_or("", |f| f.name));
            families
        };
        Self {
            families: list("FDM_BLIND_FAMILIES").map_or(all, chosen),
            hides: list("FDM_BLIND_HIDES").map_or(Hides::ALL.to_vec(), |l| l.iter().map(|n| Hides::named(n)).collect()),
            colours: list("FDM_BLIND_COLOURS")
                .map_or(Colour::ALL.to_vec(), |l| l.iter().map(|n| Colour::named(n)).collect()),
            levels: list("FDM_BLIND_LEVELS")
                .map_or(vec![0.02, 0.08], |l| l.iter().map(|v| v.parse::<f64>().expect("a level")).collect()),
            effects: number("FDM_BLIND_CASES", 12),
            nulls: number("FDM_BLIND_NULLS", 25),
            others: number("FDM_BLIND_OTHERS", 3),
        }
    }

    /// All cases: one number of every family, kind, colour and level before the next, so that what ends early has
    /// seen some of everything.
    pub(crate) fn specs(&self) -> Vec<Spec> {
        let mut specs = Vec::new();
        for number in 0..self.effects.max(self.nulls).max(self.others) {
            for hides in &self.hides {
                let count = match hides {
                    Hides::Nothing => self.nulls,
                    Hides::Effect => self.effects,
                    _ => self.others,
                };
                if number >= count {
                    continue;
                }
                for colour in &self.colours {
                    for level in &self.levels {
                        let suited = |f: &&&'static Family| match hides {
                            Hides::Loop => f.control.is_some(),
                            // seen by one sensor only, a force is coloured noise
                            Hides::Gust => f.outputs() > 1,
                            _ => true,
                        };
                        for family in self.families.iter().filter(suited) {
                            specs.push(Spec { family, hides: *hides, colour: *colour, level: *level, number });
                        }
                    }
                }
            }
        }
        specs
    }
}

fn list(name: &str) -> Option<Vec<String>> {
    let value = std::env::var(name).ok().filter(|v| !v.is_empty())?;
    Some(value.split(',').map(|v| v.trim().to_string()).collect())
}

/// A whole number of the environment.
pub(crate) fn number(name: &str, otherwise: usize) -> usize {
    std::env::var(name).ok().filter(|v| !v.is_empty()).map_or(otherwise, |v| v.parse().expect("a whole number"))
}
