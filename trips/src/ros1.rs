//! The encoding of ROS 1 messages: fields one after the other, little-endian, without padding; strings and sequences after
//! the number of their elements.
//!
//! The messages that are read have the same fields in ROS 1 and 2, but for one: a header begins with a sequence number,
//! which is stepped over here. Nothing is reserved on the word of a message: lengths are held against the bytes there are.

use std::fmt;

use serde::de::{DeserializeSeed, Deserializer, SeqAccess, Visitor};
use serde::{Deserialize, forward_to_deserialize_any};

use crate::record::Fields;

/// The name of the structure that begins with a sequence number.
const HEADER: &str = "Header";

/// Reads a message from the front of its bytes; `None` if they end before its last field does.
pub(crate) fn from_bytes<'a, T: Deserialize<'a>>(data: &'a [u8]) -> Option<T> {
    T::deserialize(&mut Wire(Fields(data))).ok()
}

struct Wire<'a>(Fields<'a>);

/// The bytes ended too early, or a type was asked for that no message here has.
#[derive(Debug)]
struct Ended;

impl fmt::Display for Ended {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the message ends before its last field does")
    }
}

impl std::error::Error for Ended {}

impl serde::de::Error for Ended {
    fn custom<T: fmt::Display>(_: T) -> Self {
        Ended
    }
}

macro_rules! numbers {
    ($($method:ident $visit:ident $number:ty),*) => {$(
        fn $method<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Ended> {
            visitor.$visit(<$number>::from_le_bytes(self.0.array().ok_or(Ended)?))
        }
    )*};
}

impl<'de> Deserializer<'de> for &mut Wire<'de> {
    type Error = Ended;

    numbers!(
        deserialize_u8 visit_u8 u8,
        deserialize_u32 visit_u32 u32,
        deserialize_i32 visit_i32 i32,
        deserialize_f32 visit_f32 f32,
        deserialize_f64 visit_f64 f64
    );

    fn deserialize_bytes<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Ended> {
        visitor.visit_borrowed_bytes(self.0.prefixed().ok_or(Ended)?)
    }

    fn deserialize_seq<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Ended> {
        let n_elements = self.0.u32().ok_or(Ended)? as usize;
        // No element takes less than a byte.
        if n_elements > self.0.0.len() {
            return Err(Ended);
        }
        visitor.visit_seq(Elements { wire: self, n_left: n_elements })
    }

    fn deserialize_tuple<V: Visitor<'de>>(self, len: usize, visitor: V) -> Result<V::Value, Ended> {
        visitor.visit_seq(Elements { wire: self, n_left: len })
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        name: &'static str,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Ended> {
        if name == HEADER {
            let _sequence = self.0.u32().ok_or(Ended)?;
        }
        visitor.visit_seq(Elements { wire: self, n_left: fields.len() })
    }

    fn deserialize_any<V: Visitor<'de>>(self, _: V) -> Result<V::Value, Ended> {
        Err(Ended)
    }

    forward_to_deserialize_any! {
        bool i8 i16 i64 i128 u16 u64 u128 char str string byte_buf option unit unit_struct newtype_struct tuple_struct map
        enum identifier ignored_any
    }
}

/// Elements of a sequence, or fields of a structure.
struct Elements<'w, 'a> {
    wire: &'w mut Wire<'a>,
    n_left: usize,
}

impl<'a> SeqAccess<'a> for Elements<'_, 'a> {
    type Error = Ended;

    fn next_element_seed<T: DeserializeSeed<'a>>(&mut self, seed: T) -> Result<Option<T::Value>, Ended> {
        if self.n_left == 0 {
            return Ok(None);
        }
        self.n_left -= 1;
        seed.deserialize(&mut *self.wire).map(Some)
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.n_left)
    }
}
