//! What pointers from C point at, once they are neither NULL nor misaligned. That there is such a thing is the caller's promise.

use crate::error::CogmintError;

/// Whether a pointer may be one to a `T`.
fn check<T>(pointer: *const T) -> Result<(), CogmintError> {
    if pointer.is_null() {
        Err(CogmintError::NullPointer)
    } else if !pointer.is_aligned() {
        Err(CogmintError::Alignment)
    } else {
        Ok(())
    }
}

/// A value of C's, to be read.
///
/// # Safety
/// Where it is neither NULL nor misaligned, it points at a `T` that nobody writes to during `'a`.
pub unsafe fn shared<'a, T>(pointer: *const T) -> Result<&'a T, CogmintError> {
    check(pointer)?;
    // SAFETY: not NULL and aligned; the rest is the caller's promise.
    Ok(unsafe { &*pointer })
}

/// A value of C's, to be changed.
///
/// # Safety
/// Where it is neither NULL nor misaligned, it points at a `T` that nobody else uses during `'a`.
pub unsafe fn exclusive<'a, T>(pointer: *mut T) -> Result<&'a mut T, CogmintError> {
    check(pointer)?;
    // SAFETY: not NULL and aligned; the rest is the caller's promise.
    Ok(unsafe { &mut *pointer })
}

/// Writes a value of C's, whatever was there before.
///
/// # Safety
/// Where it is neither NULL nor misaligned, a `T` may be written there.
pub unsafe fn put<T: Copy>(pointer: *mut T, value: T) -> Result<(), CogmintError> {
    check(pointer)?;
    // SAFETY: not NULL and aligned; the rest is the caller's promise.
    unsafe { pointer.write(value) };
    Ok(())
}

/// So many values of C's, to be read; with none of them, the pointer may be NULL.
///
/// # Safety
/// Where it is neither NULL nor misaligned, it points at so many `T` that nobody writes to during `'a`.
pub unsafe fn slice<'a, T>(pointer: *const T, count: usize) -> Result<&'a [T], CogmintError> {
    if count == 0 {
        return Ok(&[]);
    }
    check(pointer)?;
    check_count::<T>(count)?;
    // SAFETY: not NULL, aligned and no larger than an object may be; the rest is the caller's promise.
    Ok(unsafe { core::slice::from_raw_parts(pointer, count) })
}

/// The same, to be changed.
///
/// # Safety
/// Where it is neither NULL nor misaligned, it points at so many `T` that nobody else uses during `'a`.
pub unsafe fn slice_mut<'a, T>(pointer: *mut T, count: usize) -> Result<&'a mut [T], CogmintError> {
    if count == 0 {
        return Ok(&mut []);
    }
    check(pointer)?;
    check_count::<T>(count)?;
    // SAFETY: not NULL, aligned and no larger than an object may be; the rest is the caller's promise.
    Ok(unsafe { core::slice::from_raw_parts_mut(pointer, count) })
}

fn check_count<T>(count: usize) -> Result<(), CogmintError> {
    let bytes = count.checked_mul(size_of::<T>());
    if bytes.is_some_and(|bytes| isize::try_from(bytes).is_ok()) { Ok(()) } else { Err(CogmintError::Count) }
}
