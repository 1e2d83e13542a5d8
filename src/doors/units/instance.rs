//! One instance of a unit with certain parameters, ready to be asked at any time for any states and inputs ([`Instance`]).

use crate::description::Description;
use crate::functions::{Functions, Raw, Refused};
use std::fmt;

/// Most rounds until the discrete states of a beginning rest.
const MOST_ROUNDS: usize = 100;

/// Why an instance gives no numbers.
pub(crate) enum Trouble {
    /// A function came to nothing.
    Refused(Refused),
    /// The unit wants its simulation to end.
    Terminated,
    /// Its discrete states find no rest.
    Restless,
    /// A time event would have happened before.
    TimeEvent { at: f64, time: f64 },
    /// An event indicator, counted from 0, has another sign than at the beginning.
    StateEvent { indicator: usize, time: f64 },
}

impl From<Refused> for Trouble {
    fn from(refused: Refused) -> Self {
        Self::Refused(refused)
    }
}

impl fmt::Display for Trouble {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const NONE: &str =
            "events of units are not followed: write what happens there in the model (`when`, `limit`, `if`)";
        match self {
            Self::Refused(refused) => write!(f, "{refused}"),
            Self::Terminated => f.write_str("it wants the simulation to end"),
            Self::Restless => write!(f, "its discrete states find no rest in {MOST_ROUNDS} rounds"),
            Self::TimeEvent { at, time } => {
                write!(f, "at time {time}, behind its time event at {at}: {NONE}")
            }
            Self::StateEvent { indicator, time } => write!(
                f,
                "at time {time} its event indicator {} has another sign than at its own beginning: {NONE}",
                indicator + 1
            ),
        }
    }
}

/// An instance in continuous-time mode.
pub(crate) struct Instance {
    raw: Raw<'static>,
    parameters: Vec<f64>,
    /// The states as the unit begins with them (n).
    pub(crate) initial: Vec<f64>,
    above: Vec<bool>,
    indicators: Vec<f64>,
    /// Its first time event.
    pub(crate) next_event: Option<f64>,
    /// Time, states and inputs that it has now; NaN where that is not known.
    now: Vec<f64>,
    /// When it was asked last.
    pub(crate) used: u64,
}

impl Instance {
    /// Makes one, which has no parameters yet.
    pub(crate) fn new(functions: &'static Functions, d: &Description, resources: &str) -> Result<Self, String> {
        Ok(Self {
            raw: functions.instantiate(d, resources)?,
            parameters: Vec::new(),
            initial: vec![f64::NAN; d.states.len()],
            above: vec![false; d.indicators],
            indicators: vec![0.0; d.indicators],
            next_event: None,
            now: vec![f64::NAN; 1 + d.states.len() + d.inputs.len()],
            used: 0,
        })
    }

    /// Whether it has these parameters, to the bit.
    pub(crate) fn has(&self, parameters: &[f64]) -> bool {
        !self.now.is_empty()
            && self.parameters.len() == parameters.len()
            && self.parameters.iter().zip(parameters).all(|(a, b)| a.to_bits() == b.to_bits())
    }

    /// Initialises it with parameters. Those that have their start values are left alone, as a unit may forbid to set some.
    pub(crate) fn begin(&mut self, d: &Description, parameters: &[f64], fresh: bool) -> Result<(), Trouble> {
        if !fresh {
            self.raw.reset()?;
        }
        self.parameters.clear();
        self.now.fill(f64::NAN);
        self.raw.set_up(d.start_time)?;
        let changed = d.parameters.iter().zip(parameters).filter(|(v, p)| v.start != Some(**p));
        let (references, values): (Vec<u32>, Vec<f64>) = changed.map(|(v, p)| (v.reference, *p)).unzip();
        self.raw.set(&references, &values)?;
        self.raw.enter(d.start_time)?;
        self.raw.leave()?;
        self.next_event = None;
        for round in 0.. {
            let updated = self.raw.update()?;
            if updated.terminate {
                return Err(Trouble::Terminated);
            }
            self.next_event = updated.next;
            if !updated.more {
                break;
            }
            if round == MOST_ROUNDS {
                return Err(Trouble::Restless);
            }
        }
        self.raw.run()?;
        self.raw.take_states(&mut self.initial)?;
        self.raw.indicators(&mut self.indicators)?;
        self.above.iter_mut().zip(&self.indicators).for_each(|(above, z)| *above = *z > 0.0);
        self.parameters.extend_from_slice(parameters);
        Ok(())
    }

    /// Gives it time, states and inputs.
    fn place(&mut self, d: &Description, at: &[f64]) -> Result<(), Trouble> {
        let n = d.states.len();
        if let Some(next) = self.next_event.filter(|next| at[0] >= *next) {
            return Err(Trouble::TimeEvent { at: next, time: at[0] });
        }
        let differs = |now: &[f64], at: &[f64]| now.iter().zip(at).any(|(a, b)| a.to_bits() != b.to_bits());
        if differs(&self.now[..1], &at[..1]) {
            self.now[0] = f64::NAN;
            self.raw.time(at[0])?;
        }
        if differs(&self.now[1..=n], &at[1..=n]) {
            self.now[1..=n].fill(f64::NAN);
            self.raw.put_states(&at[1..=n])?;
        }
        for (k, v) in d.inputs.iter().enumerate() {
            let k = 1 + n + k;
            if self.now[k].to_bits() != at[k].to_bits() {
                self.now[k] = f64::NAN;
                self.raw.set(&[v.reference], &at[k..=k])?;
            }
        }
        let length = self.now.len();
        self.now.copy_from_slice(&at[..length]);
        Ok(())
    }

    /// Rates, then outputs, at a time, with states and inputs.
    pub(crate) fn values(
        &mut self,
        d: &Description,
        outputs: &[u32],
        at: &[f64],
        out: &mut [f64],
    ) -> Result<(), Trouble> {
        self.place(d, at)?;
        let (rates, others) = out.split_at_mut(d.states.len());
        self.raw.rates(rates)?;
        self.raw.get(outputs, others)?;
        self.raw.indicators(&mut self.indicators)?;
        let turned = self.indicators.iter().zip(&self.above).position(|(z, above)| (*z > 0.0) != *above);
        match turned {
            Some(indicator) => Err(Trouble::StateEvent { indicator, time: at[0] }),
            None => Ok(()),
        }
    }

    /// Goes to a point as an integrator would, whose step ends there.
    pub(crate) fn step(&mut self, d: &Description, at: &[f64]) -> Result<(), Trouble> {
        self.place(d, at)?;
        Ok(self.raw.complete()?)
    }

    /// The derivatives of the unknowns by one variable.
    pub(crate) fn along(
        &mut self,
        d: &Description,
        unknowns: &[u32],
        known: u32,
        at: &[f64],
        out: &mut [f64],
    ) -> Result<(), Trouble> {
        self.place(d, at)?;
        Ok(self.raw.along(unknowns, known, out)?)
    }
}
