//! Documents as JSON text, and back.
//!
//! Keys stand in the order of the alphabet, so that equal documents have equal texts whatever the order of their fields. JSON has no
//! word for what is not finite: such a number is written as null, and null is read as not a number wherever a number must stand.

use serde::de::value::MapAccessDeserializer;
use serde::de::{DeserializeOwned, DeserializeSeed, Deserializer, Error as _, IntoDeserializer, MapAccess, SeqAccess};
use serde::de::{Unexpected, Visitor};
use serde::{Deserialize, Serialize};
use serde_json::{Error, Map, Value};

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

/// A value in which null is a number too. What a reader asks for is looked for directly, not by way of all that JSON can hold:
/// hundreds of types are read, and each would have the code for everything.
struct Node(Value);

/// The items of a list.
struct Items(std::vec::IntoIter<Value>);

/// The keys and values of an object.
struct Fields {
    entries: serde_json::map::IntoIter,
    value: Option<Value>,
}

impl<'de> SeqAccess<'de> for Items {
    type Error = Error;

    fn next_element_seed<T: DeserializeSeed<'de>>(&mut self, seed: T) -> Result<Option<T::Value>, Error> {
        self.0.next().map(|value| seed.deserialize(Node(value))).transpose()
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.0.len())
    }
}

impl<'de> MapAccess<'de> for Fields {
    type Error = Error;

    fn next_key_seed<K: DeserializeSeed<'de>>(&mut self, seed: K) -> Result<Option<K::Value>, Error> {
        let Some((key, value)) = self.entries.next() else { return Ok(None) };
        self.value = Some(value);
        seed.deserialize(key.into_deserializer()).map(Some)
    }

    fn next_value_seed<V: DeserializeSeed<'de>>(&mut self, seed: V) -> Result<V::Value, Error> {
        let value = self.value.take().ok_or_else(|| Error::custom("a value without its key"))?;
        seed.deserialize(Node(value))
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.entries.len())
    }
}

impl Node {
    fn list<'de, V: Visitor<'de>>(list: Vec<Value>, visitor: V) -> Result<V::Value, Error> {
        let length = list.len();
        let mut items = Items(list.into_iter());
        let value = visitor.visit_seq(&mut items)?;
        if items.0.len() == 0 { Ok(value) } else { Err(Error::invalid_length(length, &"fewer items")) }
    }

    fn object<'de, V: Visitor<'de>>(map: Map<String, Value>, visitor: V) -> Result<V::Value, Error> {
        visitor.visit_map(Fields { entries: map.into_iter(), value: None })
    }

    /// What is neither list nor object.
    fn scalar<'de, V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        match self.0 {
            Value::Null => visitor.visit_unit(),
            Value::Bool(answer) => visitor.visit_bool(answer),
            Value::Number(number) => match (number.as_u64(), number.as_i64(), number.as_f64()) {
                (Some(number), ..) => visitor.visit_u64(number),
                (None, Some(number), _) => visitor.visit_i64(number),
                (None, None, number) => visitor.visit_f64(number.unwrap_or(f64::NAN)),
            },
            Value::String(text) => visitor.visit_string(text),
            Value::Array(_) => Err(Error::invalid_type(Unexpected::Seq, &visitor)),
            Value::Object(_) => Err(Error::invalid_type(Unexpected::Map, &visitor)),
        }
    }
}

/// Methods of a deserializer that look for one kind of value; `$Kind` is what JSON calls it.
macro_rules! only {
    ($Kind:ident, $read:ident: $($method:ident($($argument:ty),*))*) => {$(
        fn $method<V: Visitor<'de>>(self, $(_: $argument,)* visitor: V) -> Result<V::Value, Error> {
            match self.0 {
                Value::$Kind(value) => Self::$read(value, visitor),
                _ => self.scalar(visitor),
            }
        }
    )*};
    ($($method:ident)*) => {$(
        fn $method<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
            self.scalar(visitor)
        }
    )*};
}

impl<'de> Deserializer<'de> for Node {
    type Error = Error;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        match self.0 {
            Value::Array(list) => Self::list(list, visitor),
            Value::Object(map) => Self::object(map, visitor),
            _ => self.scalar(visitor),
        }
    }

    fn deserialize_f64<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        match self.0 {
            Value::Null => visitor.visit_f64(f64::NAN),
            _ => self.scalar(visitor),
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
        _: &'static str,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Error> {
        match self.0 {
            Value::String(word) => visitor.visit_enum(IntoDeserializer::<Error>::into_deserializer(word)),
            Value::Object(map) => {
                visitor.visit_enum(MapAccessDeserializer::new(Fields { entries: map.into_iter(), value: None }))
            }
            _ => self.scalar(visitor),
        }
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(self, _: &'static str, visitor: V) -> Result<V::Value, Error> {
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_ignored_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        visitor.visit_unit()
    }

    only! { Array, list: deserialize_seq() deserialize_tuple(usize) deserialize_tuple_struct(&'static str, usize) }
    only! { Object, object: deserialize_map() deserialize_struct(&'static str, &'static [&'static str]) }
    only! {
        deserialize_bool deserialize_i8 deserialize_i16 deserialize_i32 deserialize_i64 deserialize_i128
        deserialize_u8 deserialize_u16 deserialize_u32 deserialize_u64 deserialize_u128 deserialize_f32
        deserialize_char deserialize_str deserialize_string deserialize_bytes deserialize_byte_buf deserialize_unit
        deserialize_identifier
    }

    fn deserialize_unit_struct<V: Visitor<'de>>(self, _: &'static str, visitor: V) -> Result<V::Value, Error> {
        self.scalar(visitor)
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
        assert!(from_text::<Vec<f64>>("{}").is_err() && from_text::<(f64, f64)>("[1, 2, 3]").is_err());
        assert!(from_text::<String>("[]").is_err() && from_text::<f64>("\"1\"").is_err());
        assert!(from_text::<Kind>("{\"of\": 1} x").is_err() && from_text::<Kind>("\"other\"").is_err());
    }
}
