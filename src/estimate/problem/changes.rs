//! What a user changes about a model's parameters before an estimation: start values, fixing, freeing.

use fdm_grammar::diagnostic::nearest;
use fdm_grammar::model::Param;
use serde::Serialize;
use std::fmt;

/// Changes by name, applied in the order: set, fix, free.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Changes {
    /// New start values.
    pub set: Vec<(String, f64)>,
    /// Parameters that are not to be estimated.
    pub fix: Vec<String>,
    /// Parameters that are to be estimated although the model declares them `fixed`.
    pub free: Vec<String>,
}

impl Changes {
    /// Changes the parameters. Says whether one that was `fixed` is now free: the model's programs hold no partials
    /// by fixed parameters, so that its schedule must then be made anew.
    ///
    /// # Errors
    /// All mistakes at once; the parameters are then unchanged.
    pub fn apply(&self, params: &mut [Param]) -> Result<bool, Vec<ChangeError>> {
        let mut mistakes = Vec::new();
        let mut changed = params.to_vec();
        let find = |name: &String, mistakes: &mut Vec<ChangeError>| {
            let place = params.iter().position(|p| p.quantity.name == *name && !p.is_recorded());
            if place.is_none() {
                let known = params.iter().filter(|p| !p.is_recorded()).map(|p| p.quantity.name.as_str());
                let hint = nearest(name, known).map(String::from);
                mistakes.push(ChangeError::Unknown { name: name.clone(), nearest: hint });
            }
            place
        };
        for (name, value) in &self.set {
            let Some(k) = find(name, &mut mistakes) else { continue };
            let others = self.set.iter().filter(|(other, _)| other == name);
            if let Some((_, other)) = others.clone().next_back().filter(|(_, other)| other != value) {
                mistakes.push(ChangeError::SetTwice { name: name.clone(), values: [*value, *other] });
            }
            let (name, value) = (name.clone(), *value);
            let Param { lower, upper, .. } = changed[k];
            if !value.is_finite() {
                mistakes.push(ChangeError::NotFinite { name, value });
            } else if !(lower <= value && value <= upper) {
                mistakes.push(ChangeError::OutsideBounds { name, value, lower, upper });
            }
            changed[k].value = value;
        }
        for name in &self.fix {
            if let Some(k) = find(name, &mut mistakes) {
                changed[k].fixed = true;
            }
            if self.free.contains(name) {
                mistakes.push(ChangeError::FixedAndFree { name: name.clone() });
            }
        }
        let mut freed = false;
        for name in &self.free {
            if let Some(k) = find(name, &mut mistakes) {
                freed |= std::mem::replace(&mut changed[k].fixed, false);
            }
        }
        if !mistakes.is_empty() {
            return Err(mistakes);
        }
        params.clone_from_slice(&changed);
        Ok(freed)
    }
}

/// A change that cannot be made.
#[derive(Debug, Clone, PartialEq)]
#[allow(missing_docs, reason = "the message below each variant says what its fields are")]
pub enum ChangeError {
    Unknown { name: String, nearest: Option<String> },
    NotFinite { name: String, value: f64 },
    OutsideBounds { name: String, value: f64, lower: f64, upper: f64 },
    FixedAndFree { name: String },
    SetTwice { name: String, values: [f64; 2] },
}

impl fmt::Display for ChangeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown { name, nearest: Some(hint) } => {
                write!(f, "the model has no parameter `{name}`; did you mean `{hint}`?")
            }
            Self::Unknown { name, nearest: None } => write!(f, "the model has no parameter `{name}`"),
            Self::NotFinite { name, value } => write!(f, "`{name}` cannot start at {value}"),
            Self::OutsideBounds { name, value, lower, upper } => {
                write!(f, "`{name}` cannot start at {value}: its bounds are [{lower}, {upper}]")
            }
            Self::SetTwice { name, values: [one, other] } => {
                write!(f, "`{name}` is set to {one} and to {other}: give one value")
            }
            Self::FixedAndFree { name } => write!(f, "`{name}` is both to be fixed and to be free"),
        }
    }
}

impl std::error::Error for ChangeError {}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::specimen::param;

    #[test]
    fn changes_are_made_by_name_and_freeing_is_told() {
        let mut params = vec![param("a", 1.0), param("b", 2.0)];
        params[1].fixed = true;
        let set = Changes { set: vec![("a".into(), 3.0)], fix: vec!["a".into()], free: vec![] };
        assert_eq!(set.apply(&mut params), Ok(false));
        assert_eq!((params[0].value, params[0].fixed), (3.0, true));
        let free = Changes { free: vec!["b".into()], ..Changes::default() };
        assert_eq!(free.apply(&mut params), Ok(true));
        assert!(!params[1].fixed);
    }

    #[test]
    fn all_mistakes_are_told_at_once_and_nothing_is_changed() {
        let mut params = vec![param("alpha", 1.0)];
        params[0].upper = 2.0;
        let changes = Changes {
            set: vec![("alpha".into(), 5.0), ("alhpa".into(), 1.0)],
            fix: vec!["alpha".into()],
            free: vec!["alpha".into()],
        };
        let texts: Vec<String> =
            changes.apply(&mut params).expect_err("three mistakes").iter().map(ToString::to_string).collect();
        assert_eq!(texts.len(), 3);
        assert!(texts[1].contains("did you mean `alpha`"), "{texts:?}");
        assert_eq!((params[0].value, params[0].fixed), (1.0, false));
    }
}
