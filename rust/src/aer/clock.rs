//! The camera's time, unwrapped.

use super::stats::Stats;
use super::word::{LOW_12, LOW_15, WRAP};

/// One wrap is 2^15 us.
pub(super) const WRAP_BITS: u32 = 15;

/// The drivers' time overflows after 2^31 us.
const EPOCH_BITS: u32 = 31;

/// Here the clock stands still: 292,000 years, so that no stream makes it overflow.
const LAST_BASE: i64 = i64::MAX - LOW_15 as i64;

/// The largest wrap there is.
const LARGEST_WRAP: i64 = (LOW_12 as i64) << WRAP_BITS;

/// The time that words bring: of a base that wraps move on, and 15 bits that timestamps bring.
///
/// The camera's drivers count in 31 bits and an overflow; here both are one number of 64 bits.
#[derive(Clone, Copy, Default)]
pub(super) struct Clock {
    pub(super) base: i64,
    pub(super) now: i64,
}

impl Clock {
    pub(super) fn timestamp(&mut self, word: u16, stats: &mut Stats) {
        self.set(self.base + i64::from(word & LOW_15), stats);
    }

    /// Carries a wrap out, and tells whether the drivers' 31 bits overflowed by it.
    pub(super) fn wrap(&mut self, word: u16, stats: &mut Stats) -> bool {
        let epoch = self.epoch();
        self.base = self.base.saturating_add(i64::from(word & LOW_12) << WRAP_BITS).min(LAST_BASE);
        self.set(self.base, stats);
        self.epoch() != epoch
    }

    /// How often the drivers' 31 bits overflowed.
    fn epoch(&self) -> i64 {
        self.base >> EPOCH_BITS
    }

    /// Whether so many words, wraps all of them, go by without reaching the last base.
    pub(super) fn has_room_for(&self, words: usize) -> bool {
        i64::try_from(words).is_ok_and(|words| self.base < LAST_BASE.saturating_sub(words.saturating_mul(LARGEST_WRAP)))
    }

    /// Whether the drivers' 31 bits overflow by the wraps among these words.
    pub(super) fn overflows_within(&self, words: &[u16]) -> bool {
        let is_wrap = |word: u16| word.wrapping_sub(WRAP) <= LOW_12;
        let wraps = words.iter().map(|&word| if is_wrap(word) { i64::from(word & LOW_12) } else { 0 }).sum::<i64>();
        (self.base + (wraps << WRAP_BITS)) >> EPOCH_BITS != self.epoch()
    }

    fn set(&mut self, t: i64, stats: &mut Stats) {
        stats.times_not_increasing += u64::from(t <= self.now);
        self.now = t;
    }
}
