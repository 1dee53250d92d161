//! Unwraps the camera's time to microseconds in 64 bits.
//!
//! A timestamp on the wire has 15 bits. A wrap word moves a base on by 2^15 us, times its payload. The time is the sum
//! of the two.
//!
//! A time that goes back is obeyed and counted, because the vendor's drivers do so. The drivers count in 31 bits and
//! drop an open frame or inertial sample when these overflow. [`Clock::advance`] tells when that happens, so that the
//! decoder can do the same.
//!
//! What must not break:
//! - Time never overflows, whatever a stream says: the base stops at [`LAST_BASE`].
//! - [`super::block`] repeats [`Clock::advance`] without its checks. [`Clock::has_room_for`] and
//!   [`Clock::overflows_within`] must therefore rule out every case in which these checks would act.

use super::stats::Stats;
use super::word::{LOW_12, LOW_15, TIMESTAMP, WRAP};

/// One wrap is 2^15 us.
pub(super) const WRAP_BITS: u32 = 15;

/// The drivers' time overflows after 2^31 us.
const EPOCH_BITS: u32 = 31;

/// The base stops here, after 146,000 years, so that no stream makes it overflow.
const LAST_BASE: i64 = (1 << 62) - (1 << WRAP_BITS);

/// The largest wrap there is.
const LARGEST_WRAP: i64 = (LOW_12 as i64) << WRAP_BITS;

/// The base that wraps have brought, and the time now, both in microseconds.
#[derive(Clone, Copy, Default)]
pub(super) struct Clock {
    pub(super) base: i64,
    pub(super) now: i64,
}

impl Clock {
    /// Takes a timestamp or a wrap. Returns whether the drivers' 31 bits overflowed by it.
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

    /// Returns how often the drivers' 31 bits have overflowed.
    fn epoch(&self) -> i64 {
        self.base >> EPOCH_BITS
    }

    /// Returns whether the base stays below its last value even if all of the next `words` words are the largest wraps.
    pub(super) fn has_room_for(&self, words: usize) -> bool {
        i64::try_from(words).is_ok_and(|words| self.base < LAST_BASE.saturating_sub(words.saturating_mul(LARGEST_WRAP)))
    }

    /// Returns whether the wraps among these words make the drivers' 31 bits overflow.
    pub(super) fn overflows_within(&self, words: &[[u8; 2]]) -> bool {
        let words = words.iter().map(|bytes| u16::from_le_bytes(*bytes));
        let wraps: i64 = words.filter(|word| word & !LOW_12 == WRAP).map(|word| i64::from(word & LOW_12)).sum();
        (self.base + (wraps << WRAP_BITS)) >> EPOCH_BITS != self.epoch()
    }
}
