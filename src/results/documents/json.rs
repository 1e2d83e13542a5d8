//! Documents as JSON text, and back.
//!
//! Keys stand in the order of the alphabet, so that equal documents have equal texts whatever the order of their fields. JSON has no
//! word for what is not finite: such a number is written as null, and null is read as not a number wherever a number must stand.

use serde::de::value::{MapAccessDeserializer, MapDeserializer, SeqDeserializer, StringDeserializer};
use serde::de::{DeserializeOwned, Deserializer, IntoDeserializer, Visitor};
use serde::{Deserialize, Serialize, forward_to_deserialize_any};
use serde_json::{Error, Value};

/// The text of a document, in one line that ends like one.
///
/// # Errors
/// None for the documents of this package, whose keys are texts.
pub fn to_text(document: &impl Serialize) -> Result<String, Error> {
    Ok(format!("{}\n", serde_json::to_value(document)?))
}

/// Reads what [`to_text`] wrote. Keys that this version does not know are passed over.
///
/// # Errors
/// [`Error`] where the text is not JSON, or is another document.
pub fn from_text<T: DeserializeOwned>(text: &str) -> Result<T, Error> {
    T::deserialize(Node(serde_json::from_str(text)?))
}

/// For a key that some kinds of results do not have at all and that others have as null: there, whatever it holds.
pub(super) fn present<'de, D: Deserializer<'de>, T: Deserialize<'de>>(from: D) -> Result<Option<Option<T>>, D::Error> {
    Option::deserialize(from).map(Some)
}

/// A value in which null is a number too.
struct Node(Value);

impl<'de> IntoDeserializer<'de, Error> for Node {
    type Deserializer = Self;

    fn into_deserializer(self) -> Self {
        self
    }
}

impl<'de> Deserializer<'de> for Node {
    type Error = Error;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        match self.0 {
            Value::Array(list) => {
                let mut items = SeqDeserializer::new(list.into_iter().map(Node));
                let value = visitor.visit_seq(&mut items)?;
                items.end()?;
                Ok(value)
            }
            Value::Object(map) => visitor.visit_map(MapDeserializer::new(map.into_iter().map(|(k, v)| (k, Node(v))))),
            plain => plain.deserialize_any(visitor),
        }
    }

    fn deserialize_f64<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        match self.0 {
            Value::Null => visitor.visit_f64(f64::NAN),
            _ => self.deserialize_any(visitor),
        }
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        match self.0 {
            Value::Null => visitor.visit_none(),
            _ => visitor.visit_some(self),
        }
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        name: &'static str,
        variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Error> {
        match self.0 {
            Value::String(word) => StringDeserializer::new(word).deserialize_enum(name, variants, visitor),
            Value::Object(map) => {
                let entries = MapDeserializer::new(map.into_iter().map(|(k, v)| (k, Node(v))));
                visitor.visit_enum(MapAccessDeserializer::new(entries))
            }
            other => other.deserialize_enum(name, variants, visitor),
        }
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(self, _: &'static str, visitor: V) -> Result<V::Value, Error> {
        visitor.visit_newtype_struct(self)
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 char str string bytes byte_buf unit unit_struct seq tuple
        tuple_struct map struct identifier ignored_any
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    #[derive(Debug, PartialEq, Serialize, Deserialize)]
    #[serde(rename_all = "snake_case")]
    enum Kind {
        Plain,
        Of(f64),
        Pair { b: usize, a: Option<f64> },
    }

    #[test]
    fn what_is_not_finite_comes_back_as_no_number() {
        let text = to_text(&(f64::INFINITY, 0.1, [Some(1.0), None])).unwrap();
        assert_eq!(text, "[null,0.1,[1.0,null]]\n");
        let (first, second, rest): (f64, f64, [Option<f64>; 2]) = from_text(&text).unwrap();
        assert!(first.is_nan() && second == 0.1 && rest == [Some(1.0), None]);
        assert_eq!(to_text(&(first, second, rest)).unwrap(), text);
    }

    #[test]
    fn words_and_nested_kinds_come_back() {
        let all = [Kind::Plain, Kind::Of(2.0), Kind::Pair { b: 1, a: None }];
        let text = to_text(&all).unwrap();
        assert_eq!(text, "[\"plain\",{\"of\":2.0},{\"pair\":{\"a\":null,\"b\":1}}]\n");
        assert_eq!(from_text::<[Kind; 3]>(&text).unwrap(), all);
        let map: BTreeMap<String, usize> = from_text("{\"b\": 1, \"a\": 2}").unwrap();
        assert_eq!(to_text(&map).unwrap(), "{\"a\":2,\"b\":1}\n");
        assert!(from_text::<Kind>("{\"of\": 1} x").is_err() && from_text::<Kind>("\"other\"").is_err());
    }
}
