//! An array of plain numbers that may lie in memory owned by somebody else, such as a mapped file.

use std::marker::PhantomData;
use std::ops::Deref;

use bytemuck::Pod;
use bytes::Bytes;

/// Read-only numbers. Copies share their memory, and keep it alive.
#[derive(Clone)]
pub struct Array<T> {
    /// Aligned for `T` and a whole number of them long: checked when it was made.
    bytes: Bytes,
    numbers: PhantomData<T>,
}

/// Lends a vector of numbers as the bytes that it consists of.
struct AsBytes<T>(Vec<T>);

impl<T: Pod> AsRef<[u8]> for AsBytes<T> {
    fn as_ref(&self) -> &[u8] {
        bytemuck::cast_slice(&self.0)
    }
}

impl<T: Pod + Send> Array<T> {
    /// Reads `bytes` as numbers of the machine's byte order, without copying if they are aligned for `T`.
    ///
    /// Bytes beyond the last whole number are not part of the array.
    pub fn from_bytes(bytes: Bytes) -> Self {
        let whole = bytes.slice(..bytes.len() - bytes.len() % size_of::<T>());
        match bytemuck::try_cast_slice::<u8, T>(&whole) {
            Ok(_) => Self { bytes: whole, numbers: PhantomData },
            Err(_) => bytemuck::allocation::pod_collect_to_vec::<u8, T>(&whole).into(),
        }
    }

    /// The bytes that the numbers consist of.
    pub fn as_bytes(&self) -> &[u8] {
        &self.bytes
    }
}

impl<T: Pod + Send> From<Vec<T>> for Array<T> {
    fn from(numbers: Vec<T>) -> Self {
        Self { bytes: Bytes::from_owner(AsBytes(numbers)), numbers: PhantomData }
    }
}

impl<T: Pod> Deref for Array<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        bytemuck::cast_slice(&self.bytes)
    }
}

impl<T: Pod> std::fmt::Debug for Array<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "[{} × {}]", self.len(), std::any::type_name::<T>())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn aligned_bytes_are_shared_and_others_copied_with_equal_values() {
        let numbers = Array::from(vec![0x0102_0304_0506_0708_u64; 4]);
        let aligned = Array::<u16>::from_bytes(numbers.bytes.slice(..8));
        let odd = Array::<u16>::from_bytes(numbers.bytes.slice(1..9));
        assert_eq!(aligned.as_bytes().as_ptr(), numbers.as_bytes().as_ptr());
        assert_ne!(odd.as_bytes().as_ptr(), numbers.as_bytes()[1..].as_ptr());
        assert_eq!(aligned[0], 0x0708);
        assert_eq!(odd[0], 0x0607);
    }

    #[test]
    fn a_copy_outlives_the_array_it_was_made_from() {
        let first = Array::from(vec![1.5_f64, 2.5]);
        let copy = first.clone();
        drop(first);
        assert_eq!(&copy[..], [1.5, 2.5]);
    }
}
