//! What a file was made from: one number for the texts of a model and the values of its parameters ([`Stamp`]).
//!
//! A model as stand-alone C or Rust, with its stamp.

use fdm_grammar::emit::{EmitError, Language, stand_alone};
use fdm_system::Model;
use sha2::{Digest, Sha256};
use std::fmt;

/// SHA-256 of a model's texts, and of the names and values of its parameters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stamp([u8; 32]);

/// In front of the digits, in every file.
const HEAD: &str = "fdm model sha256:";

impl Stamp {
    /// Of a model with the values that its parameters have.
    pub fn of(model: &Model) -> Self {
        let mut digest = Sha256::new();
        let mut add = |bytes: &[u8]| {
            digest.update((bytes.len() as u64).to_le_bytes());
            digest.update(bytes);
        };
        for text in model.source().texts() {
            add(text.text().as_bytes());
        }
        for param in model.definition().params.iter().filter(|p| !p.is_recorded()) {
            add(param.quantity.name.as_bytes());
            add(&param.value.to_bits().to_le_bytes());
        }
        Self(digest.finalize().into())
    }

    /// The first stamp in a text.
    pub fn find(text: &str) -> Option<Self> {
        let digits = text.split(HEAD).nth(1)?.get(..64)?;
        let mut bytes = [0; 32];
        for (k, byte) in bytes.iter_mut().enumerate() {
            *byte = u8::from_str_radix(digits.get(2 * k..2 * k + 2)?, 16).ok()?;
        }
        Some(Self(bytes))
    }

    /// As a GUID of an FMU: its first half.
    pub fn guid(&self) -> String {
        let hex: String = self.0[..16].iter().map(|b| format!("{b:02x}")).collect();
        let part = |from: usize, to: usize| &hex[from..to];
        format!("{{{}-{}-{}-{}-{}}}", part(0, 8), part(8, 12), part(12, 16), part(16, 20), part(20, 32))
    }
}

impl fmt::Display for Stamp {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(HEAD)?;
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

/// The source file of a model; its last line is the stamp, a comment in both languages.
///
/// # Errors
/// [`EmitError`] as [`stand_alone`].
pub fn source(model: &Model, language: &Language) -> Result<String, EmitError> {
    let text = stand_alone(model.definition(), model.schedule(), language)?;
    Ok(format!("{text}\n/* {} */\n", Stamp::of(model)))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn a_stamp_is_found_again_and_knows_text_and_values() {
        let model = |text: &str| Model::from_text("a.fdm", text).unwrap();
        let one = model("model a { param k = 1; output y = k; }");
        let stamp = Stamp::of(&one);
        assert_eq!(Stamp::find(&format!("/* {stamp} */")), Some(stamp));
        assert_eq!(Stamp::find("fdm model sha256:12"), None);
        let mut params = one.definition().params.clone();
        params[0].value = 2.0;
        assert_ne!(Stamp::of(&one.with_params(params)), stamp);
        assert_ne!(Stamp::of(&model("model a { param k = 1; output y = k;  }")), stamp);
        assert_eq!(stamp.guid().len(), 38);
    }
}
