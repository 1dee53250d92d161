//! The camera's time, unwrapped.

use super::stats::Stats;
use super::word::{LOW_12, LOW_15, TIMESTAMP, WRAP};

/// One wrap is 2^15 us.
pub(super) const WRAP_BITS: u32 = 15;

/// The drivers' time overflows after 2^31 us.
const EPOCH_BITS: u32 = 31;

/// Here the clock stands still, after 146,000 years: no stream makes it overflow.
const LAST_BASE: i64 = (1 << 62) - (1 << WRAP_BITS);

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
    /// Carries a timestamp or a wrap out, and tells whether the drivers' 31 bits overflowed by it.
    #[inline]
    pub(super) fn advance(&mut self, word: u16, stats: &mut Stats) -> bool {
        let epoch = self.epoch();
        let low = if word < TIMESTAMP {
            self.base = (self.base + (i64::from(word & LOW_12) << WRAP_BITS)).min(LAST_BASE);
            0
        } else {
            i64::from(word & LOW_15)
        };
        let t = self.base + low;
        stats.times_not_increasing += u64::from(t <= self.now);
        self.now = t;
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
    pub(super) fn overflows_within(&self, words: &[[u8; 2]]) -> bool {
        let words = words.iter().map(|bytes| u16::from_le_bytes(*bytes));
        let wraps: i64 = words.filter(|word| word & !LOW_12 == WRAP).map(|word| i64::from(word & LOW_12)).sum();
        (self.base + (wraps << WRAP_BITS)) >> EPOCH_BITS != self.epoch()
    }
}
