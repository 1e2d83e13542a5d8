//! Several effects that add terms in one place: what they may be together.
//!
//! A law that the catalogue does not have (hysteresis, a friction that falls with the speed, a product of three) is nearly the sum of two or
//! three that it has, so nearly that nothing is left which would tell of it. That they meet in one place is what can be told.

use super::elimination::Accepted;
use std::collections::BTreeMap;

/// A sentence for each equation or output to which more than one accepted effect adds a term.
pub(super) fn one_law(accepted: &[Accepted]) -> Vec<String> {
    let terms: Vec<(String, String)> =
        accepted.iter().filter_map(|a| Some((a.candidate.adds_to()?, a.cause.place.to_string()))).collect();
    said(&terms)
}

/// The same of places and what is added there.
fn said(terms: &[(String, String)]) -> Vec<String> {
    let mut places: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    terms.iter().for_each(|(place, effect)| places.entry(place).or_default().push(effect));
    let sentence = |(place, here): (&str, Vec<&str>)| {
        let here = here.join(" and ");
        format!("{here} add to {place}: together they may stand for one law that the catalogue does not have")
    };
    places.into_iter().filter(|(_, here)| here.len() > 1).map(sentence).collect()
}

#[cfg(test)]
mod tests {
    use super::said;

    #[test]
    fn effects_that_meet_are_told() {
        let term = |place: &str, effect: &str| (place.to_string(), effect.to_string());
        let mut terms = vec![term("der(v)", "drag"), term("der(u)", "friction"), term("y", "drift")];
        assert_eq!(said(&terms), Vec::<String>::new());
        terms.push(term("der(u)", "stiffness"));
        let told = said(&terms);
        assert!(told.len() == 1 && told[0].starts_with("friction and stiffness add to der(u)"), "{told:?}");
    }
}
