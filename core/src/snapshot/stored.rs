//! How values are coded.

use super::{Reader, Sink, SnapshotError};
use heapless::Vec;
use nalgebra::SMatrix;

/// What can be written.
pub(crate) trait Written {
    /// Writes it.
    fn write(&self, to: &mut impl Sink);

    /// Writes several, one after the other.
    fn write_all(all: &[Self], to: &mut impl Sink)
    where
        Self: Sized,
    {
        all.iter().for_each(|value| value.write(to));
    }
}

/// State beside which what the tracker was told is kept.
pub(crate) trait Told {
    /// Writes that.
    fn write_told(&self, to: &mut impl Sink);
}

/// State that can be stored.
pub(crate) trait Stored: Written {
    /// Reads it where it is. On trial nothing changes.
    fn read(&mut self, from: &mut Reader<'_>) -> Result<(), SnapshotError>;
}

/// State of which lists and options have more or less.
pub(crate) trait Blank: Stored {
    /// A value to read into.
    fn blank() -> Self;
}

impl Written for u8 {
    fn write(&self, to: &mut impl Sink) {
        to.byte(*self);
    }

    fn write_all(all: &[Self], to: &mut impl Sink) {
        to.bytes(all);
    }
}

impl Written for u16 {
    fn write(&self, to: &mut impl Sink) {
        to.bytes(&self.to_le_bytes());
    }
}

impl Written for u32 {
    fn write(&self, to: &mut impl Sink) {
        to.word(*self);
    }
}

impl Written for u64 {
    fn write(&self, to: &mut impl Sink) {
        to.word(*self as u32);
        to.word((*self >> 32) as u32);
    }
}

impl Written for f32 {
    fn write(&self, to: &mut impl Sink) {
        to.float(*self);
    }

    fn write_all(all: &[Self], to: &mut impl Sink) {
        to.floats(all);
    }
}

macro_rules! numbers {
    ($($number:ty),*) => {$(
        impl Stored for $number {
            fn read(&mut self, from: &mut Reader<'_>) -> Result<(), SnapshotError> {
                let value = Self::from_le_bytes(from.take()?);
                if !from.is_trial() {
                    *self = value;
                }
                Ok(())
            }
        }

        impl Blank for $number {
            fn blank() -> Self {
                Self::default()
            }
        }
    )*};
}

numbers!(u8, u16, u32, u64, f32);

/// Four bytes, whatever the width of a pointer.
impl Written for usize {
    fn write(&self, to: &mut impl Sink) {
        (*self as u32).write(to);
    }
}

impl Stored for usize {
    fn read(&mut self, from: &mut Reader<'_>) -> Result<(), SnapshotError> {
        let value = u32::from_le_bytes(from.take()?);
        if !from.is_trial() {
            *self = value as usize;
        }
        Ok(())
    }
}

impl Blank for usize {
    fn blank() -> Self {
        0
    }
}

impl Written for bool {
    fn write(&self, to: &mut impl Sink) {
        to.byte(u8::from(*self));
    }
}

impl Stored for bool {
    fn read(&mut self, from: &mut Reader<'_>) -> Result<(), SnapshotError> {
        let [value] = from.take()?;
        if value > 1 {
            return Err(SnapshotError::Damaged);
        }
        if !from.is_trial() {
            *self = value == 1;
        }
        Ok(())
    }
}

impl Blank for bool {
    fn blank() -> Self {
        false
    }
}

impl<T: Written, const N: usize> Written for [T; N] {
    fn write(&self, to: &mut impl Sink) {
        T::write_all(self, to);
    }

    fn write_all(all: &[Self], to: &mut impl Sink) {
        T::write_all(all.as_flattened(), to);
    }
}

impl<T: Stored, const N: usize> Stored for [T; N] {
    fn read(&mut self, from: &mut Reader<'_>) -> Result<(), SnapshotError> {
        self.iter_mut().try_for_each(|value| value.read(from))
    }
}

impl<T: Blank, const N: usize> Blank for [T; N] {
    fn blank() -> Self {
        core::array::from_fn(|_| T::blank())
    }
}

impl<const ROWS: usize, const COLUMNS: usize> Written for SMatrix<f32, ROWS, COLUMNS> {
    fn write(&self, to: &mut impl Sink) {
        f32::write_all(self.as_slice(), to);
    }
}

impl<const ROWS: usize, const COLUMNS: usize> Stored for SMatrix<f32, ROWS, COLUMNS> {
    fn read(&mut self, from: &mut Reader<'_>) -> Result<(), SnapshotError> {
        self.iter_mut().try_for_each(|value| value.read(from))
    }
}

impl<const ROWS: usize, const COLUMNS: usize> Blank for SMatrix<f32, ROWS, COLUMNS> {
    fn blank() -> Self {
        Self::zeros()
    }
}

impl<T: Written> Written for Option<T> {
    fn write(&self, to: &mut impl Sink) {
        self.is_some().write(to);
        if let Some(value) = self {
            value.write(to);
        }
    }
}

impl<T: Blank> Stored for Option<T> {
    fn read(&mut self, from: &mut Reader<'_>) -> Result<(), SnapshotError> {
        match from.take()? {
            [0] if from.is_trial() => {}
            [0] => *self = None,
            [1] if from.is_trial() => T::blank().read(from)?,
            [1] => self.insert(T::blank()).read(from)?,
            _ => return Err(SnapshotError::Damaged),
        }
        Ok(())
    }
}

impl<T: Blank> Blank for Option<T> {
    fn blank() -> Self {
        None
    }
}

impl<T: Written, const N: usize> Written for Vec<T, N> {
    fn write(&self, to: &mut impl Sink) {
        if to.list(self.len(), N) && N > 0 {
            T::write_all(self, to);
        }
    }
}

impl<T: Blank, const N: usize> Stored for Vec<T, N> {
    fn read(&mut self, from: &mut Reader<'_>) -> Result<(), SnapshotError> {
        let count = usize::from(u16::from_le_bytes(from.take()?));
        if count > N {
            return Err(SnapshotError::Damaged);
        }
        if from.is_trial() {
            return (0..count).try_for_each(|_| T::blank().read(from));
        }
        self.truncate(count);
        while self.len() < count {
            // There is room.
            let _ = self.push(T::blank());
        }
        self.iter_mut().try_for_each(|value| value.read(from))
    }
}

impl<T: Blank, const N: usize> Blank for Vec<T, N> {
    fn blank() -> Self {
        Self::new()
    }
}

macro_rules! tuples {
    ($($name:ident)*) => {
        impl<$($name: Written),*> Written for ($($name,)*) {
            #[allow(non_snake_case)]
            fn write(&self, to: &mut impl Sink) {
                let ($($name,)*) = self;
                $($name.write(to);)*
            }
        }

        impl<$($name: Stored),*> Stored for ($($name,)*) {
            #[allow(non_snake_case)]
            fn read(&mut self, from: &mut Reader<'_>) -> Result<(), SnapshotError> {
                let ($($name,)*) = self;
                $($name.read(from)?;)*
                Ok(())
            }
        }

        impl<$($name: Blank),*> Blank for ($($name,)*) {
            fn blank() -> Self {
                ($($name::blank(),)*)
            }
        }
    };
}

tuples!(A B);
tuples!(A B C D);

/// Writes a struct by its fields, all of which are named, in this order.
macro_rules! written {
    ($type:ident $(<$(const $size:ident),*>)? { $($field:ident),* $(,)? } but { $($other:ident),* $(,)? }) => {
        impl $(<$(const $size: usize),*>)? $crate::snapshot::Written for $type $(<$($size),*>)? {
            fn write(&self, to: &mut impl $crate::snapshot::Sink) {
                let Self { $($field,)* $($other: _,)* } = self;
                $($crate::snapshot::Written::write($field, to);)*
            }
        }
    };
    ($type:ident $(<$(const $size:ident),*>)? { $($field:ident),* $(,)? }) => {
        $crate::snapshot::written!($type $(<$(const $size),*>)? { $($field),* } but {});
    };
}

/// [`written!`], and reads it. Fields after `told` are what the tracker was told; those after `made` are made of that, or last for a
/// cycle. With `blank` in front, lists may have more or less of it.
macro_rules! stored {
    (blank $type:ident $(<$(const $size:ident),*>)? { $($field:ident),* $(,)? }) => {
        $crate::snapshot::stored!($type $(<$(const $size),*>)? { $($field),* } told {});

        impl $(<$(const $size: usize),*>)? $crate::snapshot::Blank for $type $(<$($size),*>)? {
            fn blank() -> Self {
                Self { $($field: $crate::snapshot::Blank::blank()),* }
            }
        }
    };
    (
        $type:ident $(<$(const $size:ident),*>)? { $($field:ident),* $(,)? }
        told { $($told:ident),* $(,)? } $(made { $($made:ident),* $(,)? })?
    ) => {
        $crate::snapshot::written!($type $(<$(const $size),*>)? { $($field),* } but { $($told,)* $($($made),*)? });

        impl $(<$(const $size: usize),*>)? $crate::snapshot::Told for $type $(<$($size),*>)? {
            fn write_told(&self, to: &mut impl $crate::snapshot::Sink) {
                let Self { $($field: _,)* $($told,)* $($($made: _,)*)? } = self;
                $($crate::snapshot::Written::write($told, to);)*
                let _ = to;
            }
        }

        impl $(<$(const $size: usize),*>)? $crate::snapshot::Stored for $type $(<$($size),*>)? {
            fn read(
                &mut self,
                from: &mut $crate::snapshot::Reader<'_>,
            ) -> Result<(), $crate::snapshot::SnapshotError> {
                let Self { $($field,)* $($told: _,)* $($($made: _,)*)? } = self;
                $($crate::snapshot::Stored::read($field, from)?;)*
                Ok(())
            }
        }
    };
}

pub(crate) use {stored, written};
