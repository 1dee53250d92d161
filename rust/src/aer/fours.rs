//! Words taken four at a time, as one number of 64 bits, so that one finds those before it by shifting.

use super::block::BLOCK;

/// The bit that tells a value from none, where payloads leave room for it.
pub(super) const TOP: u16 = 0x8000;
pub(super) const TOPS: u64 = in_each(TOP);

/// Words are taken four at a time, as one number.
pub(super) const FOURS: usize = BLOCK / 4;

/// The same in each of four.
pub(super) const fn in_each(value: u16) -> u64 {
    0x0001_0001_0001_0001 * value as u64
}

/// All bits of those whose top bit is set.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its caller's vector code")]
pub(super) fn whole(fours: u64) -> u64 {
    let tops = fours & TOPS;
    (tops - (tops >> 15)) | tops
}

/// The top bit of those of whose upper four bits any is set; the other bits mean nothing.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its caller's vector code")]
pub(super) fn any_of_upper_four(fours: u64) -> u64 {
    fours | fours << 1 | fours << 2 | fours << 3
}

/// Puts the last value before it in the place of each that is none (0; values have their top bits set).
///
/// `before` holds before the first. Returns what holds before each four, in all of four, and the last value.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its caller's vector code")]
#[allow(clippy::cast_possible_truncation, reason = "one of four")]
pub(super) fn hold(values: &mut [u64; FOURS], before: u16) -> ([u64; FOURS], u16) {
    for four in values.iter_mut() {
        *four |= *four << 16 & !whole(*four);
        *four |= *four << 32 & !whole(*four);
    }
    let (mut held, mut last) = ([0; FOURS], before);
    for (four, held) in values.iter().zip(&mut held) {
        *held = in_each(last);
        let own = (four >> 48) as u16;
        last = if own < TOP { last } else { own };
    }
    for (four, held) in values.iter_mut().zip(&held) {
        *four |= held & !whole(*four);
    }
    (held, last)
}

/// Four by four, one by one.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its caller's vector code")]
#[allow(clippy::cast_possible_truncation, reason = "one of four")]
pub(super) fn apart(fours: &[u64; FOURS]) -> [u16; BLOCK] {
    let mut ones = [0; BLOCK];
    for (four, ones) in fours.iter().zip(ones.as_chunks_mut::<4>().0) {
        *ones = [*four as u16, (four >> 16) as u16, (four >> 32) as u16, (four >> 48) as u16];
    }
    ones
}
