//! The common path: compares new samples with their pixel's bounds, stores them, and notes those that are out of
//! bounds.
//!
//! Most samples of a frame end here, so this is written for memory speed. It runs in vector code over tiles of [`TILE`]
//! pixels. A block of 64 pixels with no sample out of bounds is skipped at once. In other blocks, places are written by
//! a table of bit positions, without a branch.
//!
//! With rates of change, a pixel is also noted where the rates at both ends differ in sign, because its curve may leave
//! the bounds in between. Pixels with sparse samples are always noted.
//!
//! What must not break:
//! - No sample at or beyond a bound is passed over. Noting one too many costs only time.
//! - Places come in raster order, because events must leave a band in that order.

use multiversion::multiversion;

use super::sample::Sample;

/// Pixels scanned at a time.
pub(crate) const TILE: usize = 1024;

/// Pixels that are skipped together when none of them is out of bounds.
const BLOCK: usize = 64;

/// Places are written in groups of this many.
const GROUP: usize = 8;

/// Samples out of bounds, of one or more tiles: their place in the band's share, and the samples before and now, of which
/// log intensity is computed next.
pub(crate) struct Found<S> {
    pub(crate) count: usize,
    pub(crate) place: Vec<u32>,
    pub(crate) from: Vec<S>,
    pub(crate) to: Vec<S>,
    /// Places in a tile.
    in_tile: Vec<u16>,
}

/// Candidates are decided once there are this many: enough to fill vectors, few enough for the first-level cache.
const BATCH: usize = 256;

/// The most candidates that there can be before they are decided: a batch less one, and all of another tile.
pub(crate) const MOST_FOUND: usize = BATCH - 1 + TILE;

impl<S: Sample> Found<S> {
    pub(crate) fn new() -> Self {
        let samples = || vec![S::default(); MOST_FOUND];
        Self { count: 0, place: vec![0; MOST_FOUND], from: samples(), to: samples(), in_tile: vec![0; TILE] }
    }

    pub(crate) fn is_full(&self) -> bool {
        self.count >= BATCH
    }

    /// Compares a tile's new samples with their bounds, stores them as the `next` last ones, and notes those that left.
    ///
    /// The tile begins at `start` of the share. `rates` are the rates of change at the interval's start and end, where
    /// they are known: an extremum between makes a pixel worth a look wherever its samples lie. `also` are places that
    /// are noted whatever their samples.
    #[allow(clippy::cast_possible_truncation, reason = "no sensor has 2^32 pixels")]
    pub(crate) fn scan(
        &mut self,
        start: usize,
        new: &[S],
        (last, next): (&[S], &mut [S]),
        bounds: (&[S], &[S]),
        rates: Option<(&[S], &[S])>,
        also: impl ExactSizeIterator<Item = usize>,
    ) {
        let mut count = match rates {
            None => out_of_bounds(new, bounds.0, bounds.1, &mut self.in_tile),
            Some(rates) => out_of_bounds_or_sign_change(new, bounds, rates, &mut self.in_tile),
        };
        if also.len() > 0 {
            count = add(&mut self.in_tile, count, also);
        }
        let found = self.count..self.count + count;
        let (place, from, to) =
            (&mut self.place[found.clone()], &mut self.from[found.clone()], &mut self.to[found.clone()]);
        for (((&i, place), from), to) in self.in_tile[..count].iter().zip(place).zip(from).zip(to) {
            *place = start as u32 + u32::from(i);
            *from = last[usize::from(i)];
            *to = new[usize::from(i)];
        }
        self.count = found.end;
        next.copy_from_slice(new);
    }
}

/// The places of samples at or beyond their bounds, in order; returns how many.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
#[allow(clippy::needless_bitwise_bool, reason = "a lazy operator is a branch, which vectors cannot take")]
fn out_of_bounds<S: Sample>(new: &[S], low: &[S], high: &[S], places: &mut [u16]) -> usize {
    places_where(new.len(), places, |start, n| {
        let (new, low, high) = (&new[start..start + n], &low[start..start + n], &high[start..start + n]);
        move |i| (new[i] >= high[i]) | (new[i] <= low[i])
    })
}

/// [`out_of_bounds`], and the places where the rates of change at the ends differ in sign.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
#[allow(clippy::needless_bitwise_bool, reason = "a lazy operator is a branch, which vectors cannot take")]
fn out_of_bounds_or_sign_change<S: Sample>(
    new: &[S],
    bounds: (&[S], &[S]),
    rates: (&[S], &[S]),
    places: &mut [u16],
) -> usize {
    places_where(new.len(), places, |start, n| {
        let (new, low, high) = (&new[start..start + n], &bounds.0[start..start + n], &bounds.1[start..start + n]);
        let (from, to) = (&rates.0[start..start + n], &rates.1[start..start + n]);
        move |i| (new[i] >= high[i]) | (new[i] <= low[i]) | S::signs_differ(from[i], to[i])
    })
}

/// The places in 0..n where something is true, in order; returns how many.
///
/// `of(start, n)` tells it for the n places from `start` on: of whole blocks, whose length the compiler knows.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
#[allow(clippy::cast_possible_truncation, reason = "places lie below TILE")]
fn places_where<F: Fn(usize) -> bool>(n: usize, places: &mut [u16], of: impl Fn(usize, usize) -> F) -> usize {
    let mut count = 0;
    let whole = n - n % BLOCK;
    for start in (0..whole).step_by(BLOCK) {
        let is = of(start, BLOCK);
        if (0..BLOCK).fold(0, |any, i| any | u32::from(is(i))) == 0 {
            continue;
        }
        let mut found = [0u8; BLOCK];
        for (i, found) in found.iter_mut().enumerate() {
            *found = u8::from(is(i));
        }
        for (group, found) in found.chunks_exact(GROUP).enumerate() {
            // Eight bytes of 0 or 1 to eight bits: each lands in the top byte at a place of its own.
            let bytes = u64::from_le_bytes(found.try_into().unwrap_or_default());
            let bits = (bytes.wrapping_mul(0x0102_0408_1020_4080) >> 56) as usize;
            let first = (start + group * GROUP) as u16;
            // All eight are written, those that left kept: no branch to mispredict.
            let (places, (positions, kept)) = (&mut places[count..count + GROUP], &POSITIONS[bits]);
            for (place, position) in places.iter_mut().zip(positions) {
                *place = first + position;
            }
            count += *kept as usize;
        }
    }
    let is = of(whole, n - whole);
    for i in whole..n {
        places[count] = i as u16;
        count += usize::from(is(i - whole));
    }
    count
}

/// Adds places (each may come several times, or be there) to the first `count`, in order; returns how many there are.
#[allow(clippy::cast_possible_truncation, reason = "places lie below TILE")]
fn add(places: &mut [u16], count: usize, also: impl Iterator<Item = usize>) -> usize {
    let mut noted = [false; TILE];
    for place in places[..count].iter().map(|&place| usize::from(place)).chain(also) {
        noted[place] = true;
    }
    let all = noted.iter().enumerate().filter(|(_, noted)| **noted).map(|(place, _)| place as u16);
    places.iter_mut().zip(all).map(|(to, place)| *to = place).count()
}

/// The positions of the set bits of each byte, in order, and their number.
static POSITIONS: [([u16; GROUP], u32); 256] = {
    let mut table = [([0; GROUP], 0); 256];
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
