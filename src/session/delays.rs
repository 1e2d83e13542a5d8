//! Delays that a map leaves free: the model with a param for each, as an effect in its text. What is fitted is what is written.

use fdm_effects::{Catalogue, Choice, Nominal, Subject};
use fdm_grammar::{Diagnostic, Source};
use fdm_readers::{FreeDelay, RecordMap};
use fdm_system::{Model, ModelError};
use std::collections::BTreeMap;

/// A record that is late by `tau` shows an output as it was `tau` ago, and an input as it will be `tau` from now.
fn effect(is_input: bool, free: FreeDelay) -> String {
    let FreeDelay { lower, upper, per_run } = free;
    let own = if per_run { " per run" } else { "" };
    if is_input {
        let (lower, upper) = (-upper, -lower);
        format!(
            "effect late(i: input) \"{{i}} is recorded late: minus the delay\" {{
               param tau = 0 in [{lower:?}, {upper:?}]{own};
               let delayed = delay(i, tau);
               replace i with delayed;
             }}"
        )
    } else {
        format!(
            "effect late(y: output) \"{{y}} is recorded late\" {{
               param tau = 0 in [{lower:?}, {upper:?}]{own};
               replace y with delay(y, tau);
             }}"
        )
    }
}

/// Why a delay cannot be left free.
pub(crate) enum DelayError {
    /// A text that does not compile.
    Model(Box<ModelError>),
    /// What is wrong with the maps, or with a channel.
    Maps(Vec<String>),
}

/// The model with a param for every delay that the maps leave free, and a sentence for each.
///
/// # Errors
/// Maps that differ in what they leave free, and channels that cannot be delayed.
pub(crate) fn with_free_delays(model: &Model, maps: &[&RecordMap]) -> Result<(Model, Vec<String>), DelayError> {
    let mut wanted: BTreeMap<&str, FreeDelay> = BTreeMap::new();
    let (inputs, outputs) = (&model.definition().inputs, &model.definition().outputs);
    let is_input = |name: &str| inputs.iter().any(|i| i.quantity.name == name);
    for map in maps {
        for (name, channel) in &map.channel {
            if let Some(free) = channel.free_delay {
                wanted.insert(name, free);
            }
        }
    }
    wanted.retain(|name, _| is_input(name) || outputs.iter().any(|o| o.quantity.name == *name));
    let mut wrong = Vec::new();
    for (name, free) in &wanted {
        if maps.iter().any(|map| map.channel.get(*name).is_none_or(|c| c.free_delay != Some(*free))) {
            wrong.push(format!(
                "channel.{name}.free_delay: the maps of all runs must leave the same delay free; give it in each, with the same bounds"
            ));
        }
    }
    if !wrong.is_empty() {
        return Err(DelayError::Maps(wrong));
    }
    let mut model = model.clone();
    let mut said = Vec::new();
    for (name, free) in wanted {
        let source = Source::new("map", effect(is_input(name), free));
        let (catalogue, findings) = Catalogue::read(&source);
        let invalid = |text: &Source, diagnostics| {
            DelayError::Model(Box::new(ModelError::Invalid { text: text.clone(), diagnostics }))
        };
        if findings.iter().any(Diagnostic::is_error) {
            return Err(invalid(&source, findings));
        }
        let at = Subject::new(model.source(), model.definition()).map_err(|f| invalid(model.source(), f))?;
        let places = catalogue.places(&at);
        let told = |what: &str| DelayError::Maps(vec![format!("channel.{name}.free_delay: {what}")]);
        let candidate = places.find(&format!("late({name})"));
        let candidate = candidate.ok_or_else(|| told("the model has no place for a delay there"))?;
        let extension = candidate.apply(&at, &Nominal, &Choice::new()).map_err(|d| told(&d.message))?;
        let extended = Model::from_source(extension.source().clone().with_groups(model.source().groups().clone()));
        model = extended.map_err(|e| match e {
            ModelError::Invalid { ref diagnostics, .. } => {
                told(&diagnostics.first().map_or_else(|| e.to_string(), |d| d.message.clone()))
            }
            e => told(&e.to_string()),
        })?;
        let params: Vec<&str> = extension.params().iter().map(|p| p.name.as_str()).collect();
        let of = if is_input(name) { "minus the delay" } else { "the delay" };
        said.push(format!("note: `{}` is {of} of `{name}`, which the map leaves free", params.join("`, `")));
    }
    Ok((model, said))
}
