//! The common path: compares new samples with their pixel's mark, stores them, and notes those that may have had an
//! event.
//!
//! Most samples of a frame end here, so this is written for memory speed. It runs in vector code over tiles of [`TILE`]
//! pixels. A block of 64 pixels with every sample within reach is skipped at once. In other blocks, indices are written by
//! a table of bit positions, without a branch.
//!
//! With rates of change, a pixel is also noted where the rates at both ends differ in sign, because its curve may leave
//! the reach in between. Pixels with sparse samples are always noted. So are bad values, which nothing else looks for.
//!
//! What must not break:
//! - No sample out of reach is passed over. Noting one too many costs only time.
//! - Indices come in raster order, because events must leave a band in that order.

use multiversion::multiversion;

use super::marks::{MarkingSlice, ReachesSlice};
use super::registers::{GROUP, Notes, Registers, TileSamples};
use super::sample::{DarkLevel, Reach, Sample};

/// Pixels scanned at a time.
pub(crate) const TILE: usize = 512;

/// Pixels that are skipped together where every sample is within reach.
const BLOCK: usize = 64;

/// Indices are written in groups of this many.
const INDICES: usize = 8;

/// Samples that were noted, of one or more tiles: their pixel, counted from the first one of the band's slice, and the
/// samples before and now, of which log intensity is computed next.
pub(crate) struct NotedSamples<S> {
    pub(crate) count: usize,
    /// Pixels of the band, also beyond those that are counted: registers take whole vectors of them.
    pub(crate) pixel: Vec<u32>,
    pub(crate) from: Vec<S>,
    pub(crate) to: Vec<S>,
    /// Indices in a tile.
    in_tile: Vec<u16>,
    /// 1 for each pixel of a tile that is noted, else 0.
    noted: Vec<u8>,
}

/// Candidates are decided once there are this many: enough to fill vectors, few enough for the first-level cache.
const BATCH: usize = 256;

/// More candidates than there can be before they are decided: a batch, and all of another tile. A multiple of all vectors,
/// and a register more.
pub(crate) const MOST_NOTED: usize = BATCH + TILE + GROUP;

/// A tile's samples, and what they are compared with.
pub(crate) struct Tile<'a, S> {
    /// Where it begins in the slice.
    pub(crate) start: usize,
    pub(crate) new: &'a [S],
    pub(crate) last: &'a [S],
    /// Takes the new samples.
    pub(crate) next: &'a mut [S],
    pub(crate) marks: &'a [f32],
    pub(crate) marking: MarkingSlice<'a>,
    /// Rates of change at the interval's start and end, where they are known: an extremum between makes a pixel worth a
    /// look wherever its samples lie.
    pub(crate) rates: Option<(&'a [S], &'a [S])>,
}

impl<S: Sample> NotedSamples<S> {
    pub(crate) fn new() -> Self {
        let samples = || vec![S::default(); MOST_NOTED];
        Self {
            count: 0,
            pixel: vec![0; MOST_NOTED],
            from: samples(),
            to: samples(),
            in_tile: vec![0; TILE],
            noted: vec![0; TILE],
        }
    }

    pub(crate) fn is_full(&self) -> bool {
        self.count >= BATCH
    }

    /// Compares a tile's new samples with their marks, stores them as the `next` last ones, and notes those out of reach.
    ///
    /// `also` are indices that are noted whatever their samples. `registers` are used if they are given.
    #[allow(clippy::cast_possible_truncation, reason = "no sensor has 2^32 pixels")]
    pub(crate) fn scan(
        &mut self,
        tile: &mut Tile<'_, S>,
        also: impl ExactSizeIterator<Item = usize>,
        registers: Option<Registers>,
    ) {
        let n = tile.new.len();
        let noted = &mut self.noted[..n];
        match tile.marking.reaches {
            ReachesSlice::Same(reach) => {
                note(tile.new, tile.marks, tile.next, reach, tile.marking.dark_level, noted);
            }
            ReachesSlice::Each(up, down) => {
                note_each(tile.new, tile.marks, tile.next, (up, down), tile.marking.dark_level, noted);
            }
        }
        if let Some(rates) = tile.rates {
            note_sign_changes(rates, noted);
        }
        for index in also {
            noted[index] = 1;
        }
        if let Some(registers) = registers {
            let tile = TileSamples { noted, start: tile.start as u32, last: tile.last, new: tile.new };
            let (pixel, from, to) =
                (&mut self.pixel[self.count..], &mut self.from[self.count..], &mut self.to[self.count..]);
            self.count += registers.collect(&tile, Notes { pixel, from, to });
            return;
        }
        let count = collect_indices(noted, &mut self.in_tile);
        let added = self.count..self.count + count;
        let (pixel, from, to) =
            (&mut self.pixel[added.clone()], &mut self.from[added.clone()], &mut self.to[added.clone()]);
        for (((&i, pixel), from), to) in self.in_tile[..count].iter().zip(pixel).zip(from).zip(to) {
            *pixel = tile.start as u32 + u32::from(i);
            *from = tile.last[usize::from(i)];
            *to = tile.new[usize::from(i)];
        }
        self.count = added.end;
    }
}

/// Stores the new samples, and notes (by a 1) those that are not within reach of their marks.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn note<S: Sample>(new: &[S], marks: &[f32], next: &mut [S], reach: Reach, dark_level: DarkLevel, noted: &mut [u8]) {
    let n = new.len();
    let (marks, next, noted) = (&marks[..n], &mut next[..n], &mut noted[..n]);
    for i in 0..n {
        next[i] = new[i];
        noted[i] = u8::from(!new[i].is_within(marks[i], reach, dark_level));
    }
}

/// [`note`], where every pixel has a reach of its own.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn note_each<S: Sample>(
    new: &[S],
    marks: &[f32],
    next: &mut [S],
    (up, down): (&[f32], &[f32]),
    dark_level: DarkLevel,
    noted: &mut [u8],
) {
    let n = new.len();
    let (marks, next, noted, up, down) = (&marks[..n], &mut next[..n], &mut noted[..n], &up[..n], &down[..n]);
    for i in 0..n {
        next[i] = new[i];
        noted[i] = u8::from(!new[i].is_within(marks[i], Reach { up: up[i], down: down[i] }, dark_level));
    }
}

/// Notes the pixels whose rates of change at the ends differ in sign.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn note_sign_changes<S: Sample>((from, to): (&[S], &[S]), noted: &mut [u8]) {
    let n = noted.len();
    let (from, to) = (&from[..n], &to[..n]);
    for i in 0..n {
        noted[i] |= u8::from(S::signs_differ(from[i], to[i]));
    }
}

/// Writes the indices that are noted, in order; returns how many.
#[allow(clippy::cast_possible_truncation, reason = "indices lie below TILE")]
fn collect_indices(noted: &[u8], indices: &mut [u16]) -> usize {
    let mut count = 0;
    let (blocks, rest) = noted.as_chunks::<BLOCK>();
    for (block, noted) in blocks.iter().enumerate() {
        let (groups, _) = noted.as_chunks::<INDICES>();
        if groups.iter().fold(0, |any, &group| any | u64::from_le_bytes(group)) == 0 {
            continue;
        }
        for (group, noted) in groups.iter().enumerate() {
            // Eight bytes of 0 or 1 to eight bits: each lands in the top byte at a position of its own.
            let bits = (u64::from_le_bytes(*noted).wrapping_mul(0x0102_0408_1020_4080) >> 56) as usize;
            let first = (block * BLOCK + group * INDICES) as u16;
            // All eight are written, those that were noted kept: no branch to mispredict.
            let (indices, (positions, kept)) = (&mut indices[count..count + INDICES], &POSITIONS[bits]);
            for (index, position) in indices.iter_mut().zip(positions) {
                *index = first + position;
            }
            count += *kept as usize;
        }
    }
    for (i, &noted) in rest.iter().enumerate() {
        indices[count] = (blocks.len() * BLOCK + i) as u16;
        count += usize::from(noted);
    }
    count
}

/// The positions of the set bits of each byte, in order, and their number.
static POSITIONS: [([u16; INDICES], u32); 256] = {
    let mut table = [([0; INDICES], 0); 256];
    let mut bits = 0;
    while bits < 256 {
        let (mut position, mut count) = (0, 0);
        while position < 8 {
            if bits >> position & 1 == 1 {
                table[bits].0[count] = position;
                count += 1;
            }
            position += 1;
        }
        table[bits].1 = bits.count_ones();
        bits += 1;
    }
    table
};
