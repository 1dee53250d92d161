//! Lanes: fixed-length arrays of values, one for each ray, for rays that are processed together.
//!
//! The compiler makes vector code of loops over arrays of a known length.
//!
//! What must not break: arrays are aligned to cache lines, and loops run over multiples of [`STEP`].

use std::ops::{Deref, DerefMut};

/// The most lanes. Arrays have this fixed length and loops run over the lanes in use, so that they become vector code.
pub(crate) const MOST: usize = 64;

/// How many values make up the widest vector: arrays are worked on in multiples of it.
pub(crate) const STEP: usize = 16;

/// A value of each ray, where vectors lie in one line of the cache each.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub(crate) struct Lanes([f32; MOST]);

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Lanes {
    pub(crate) const ZERO: Self = Self([0.0; MOST]);

    #[inline(always)]
    pub(crate) fn all(value: f32) -> Self {
        Self([value; MOST])
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Deref for Lanes {
    type Target = [f32; MOST];

    #[inline(always)]
    fn deref(&self) -> &[f32; MOST] {
        &self.0
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl DerefMut for Lanes {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut [f32; MOST] {
        &mut self.0
    }
}

/// As [`Lanes`], of pairs.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub(crate) struct Pairs([u64; MOST]);

impl Pairs {
    pub(crate) const ZERO: Self = Self([0; MOST]);
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Deref for Pairs {
    type Target = [u64; MOST];

    #[inline(always)]
    fn deref(&self) -> &[u64; MOST] {
        &self.0
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl DerefMut for Pairs {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut [u64; MOST] {
        &mut self.0
    }
}

/// Rays of one triangle by their undistorted coordinates: [`MOST`] where `FULL`, else any multiple of [`STEP`].
#[derive(Debug)]
pub(crate) struct Rays<'a, const FULL: bool> {
    pub(crate) count: usize,
    /// Their numbers in the tile, where they do not lie side by side.
    pub(crate) picked: Option<&'a [u32; MOST]>,
    /// The first one's number in the tile, where they lie side by side.
    pub(crate) first: usize,
    pub(crate) x: &'a [f32; MOST],
    pub(crate) y: &'a [f32; MOST],
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl<const FULL: bool> Rays<'_, FULL> {
    /// Returns how many there are; where that is known to the compiler, it writes each array once.
    #[inline(always)]
    pub(crate) fn count(&self) -> usize {
        if FULL { MOST } else { self.count.min(MOST) }
    }
}
