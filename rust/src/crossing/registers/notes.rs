//! What registers take and leave where a tile's samples are noted.

#![cfg_attr(not(target_arch = "x86_64"), allow(dead_code, reason = "there are no registers"))]

/// Samples that are collected at a time.
pub(crate) const GROUP: usize = 16;

/// What a tile's notes are made of: pixels counted from `start`, their samples before and now.
pub(crate) struct TileSamples<'a, S> {
    /// 1 for each pixel that is noted, else 0.
    pub(crate) noted: &'a [u8],
    pub(crate) start: u32,
    pub(crate) last: &'a [S],
    pub(crate) new: &'a [S],
}

/// Where notes go: each array has room for all pixels of the tile, and for [`GROUP`] more.
pub(crate) struct Notes<'a, S> {
    pub(crate) pixel: &'a mut [u32],
    pub(crate) from: &'a mut [S],
    pub(crate) to: &'a mut [S],
}
