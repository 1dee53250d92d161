//! What a pixel keeps for its events: its level, and when its last event was.
//!
//! Only pixels that may have an event touch their record, so all of it lies in one line of the cache. [`Narrow`] is 16
//! bytes, and what nearly every run needs. [`Wide`] is 24 bytes, for counters beyond 65,535 and for runs beyond 71
//! minutes. An engine begins with narrow records and changes to wide ones, once, when a value does not fit.
//!
//! What must not break: a record that cannot hold a value says so. Nothing wraps around.

use super::level::Level;

/// No event yet.
pub(crate) const NEVER: i64 = -1;

/// What a pixel keeps for its events.
pub(crate) trait Record: Copy + Default + Send + Sync {
    /// What an event changes.
    type Old: Copy + Default + Send + Sync;

    /// A record; None where it cannot hold that. `zero_us` is before all events.
    fn new(level: Level, last_event_us: i64, zero_us: i64) -> Option<Self>;

    fn level(self) -> Level;

    /// The time of the last event in microseconds, or [`NEVER`].
    fn last_event_us(self, zero_us: i64) -> i64;

    /// What the next event will change, of the record of a pixel, whose word is this.
    fn old(records: &[Self], pixel: u32, word: u64) -> Self::Old;

    fn restore(&mut self, old: Self::Old);

    /// `B` of the level.
    fn base(self) -> f64;

    /// What the vector code needs besides: the counters, and all that [`Self::stepped`] changes.
    fn word(self) -> u64;

    /// The ON and OFF events of a word.
    fn counters(word: u64) -> (f64, f64);

    /// These records, and room for what events change of them, if they are narrow.
    fn narrow<'a>(records: &'a mut [Self], old: &'a mut [Self::Old]) -> Option<(&'a mut [Narrow], &'a mut [u64])>;

    /// Can no other event of this polarity be counted?
    fn is_full(word: u64, on: bool) -> bool;

    /// The word after an event, `since` microseconds after the zero of times.
    fn stepped(word: u64, on: bool, since: i64) -> u64;

    /// Takes the word after an event at `t_us`; or its own word again, where there `is` none.
    fn take(&mut self, word: u64, is: bool, t_us: i64);
}

/// A record of 16 bytes.
#[derive(Clone, Copy, Default)]
#[repr(C, align(16))]
pub(crate) struct Narrow {
    base: f64,
    /// From the lowest bit: 16 bits of ON events, 16 bits of OFF events, and 32 bits of the time of the last event since
    /// `zero_us`; 0 = none yet.
    word: u64,
}

const BITS: u32 = 16;
pub(crate) const COUNTER: u64 = u16::MAX as u64;

impl Narrow {
    /// Changes its word.
    #[inline]
    pub(crate) fn set_word(&mut self, word: u64) {
        self.word = word;
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Record for Narrow {
    type Old = u64;

    fn new(level: Level, last_event_us: i64, zero_us: i64) -> Option<Self> {
        let (on, off) = (u16::try_from(level.on).ok()?, u16::try_from(level.off).ok()?);
        let since = match last_event_us {
            NEVER => 0,
            t_us => u32::try_from(t_us.checked_sub(zero_us)?).ok().filter(|&since| since > 0 && t_us >= 0)?,
        };
        Some(Self { base: level.base, word: u64::from(on) | u64::from(off) << BITS | u64::from(since) << (2 * BITS) })
    }

    #[inline]
    #[allow(clippy::cast_possible_truncation, reason = "masked")]
    fn level(self) -> Level {
        Level { base: self.base, on: (self.word & COUNTER) as u32, off: (self.word >> BITS & COUNTER) as u32 }
    }

    fn last_event_us(self, zero_us: i64) -> i64 {
        match self.word >> (2 * BITS) {
            0 => NEVER,
            since => zero_us + since.cast_signed(),
        }
    }

    fn narrow<'a>(records: &'a mut [Self], old: &'a mut [u64]) -> Option<(&'a mut [Self], &'a mut [u64])> {
        Some((records, old))
    }

    /// Without a look at the record.
    #[inline(always)]
    fn old(_: &[Self], _: u32, word: u64) -> u64 {
        word
    }

    fn restore(&mut self, old: u64) {
        self.word = old;
    }

    #[inline(always)]
    fn base(self) -> f64 {
        self.base
    }

    #[inline(always)]
    fn word(self) -> u64 {
        self.word
    }

    #[inline(always)]
    #[allow(clippy::cast_possible_truncation, reason = "masked")]
    fn counters(word: u64) -> (f64, f64) {
        (f64::from((word & COUNTER) as u16), f64::from((word >> BITS & COUNTER) as u16))
    }

    #[inline(always)]
    fn is_full(word: u64, on: bool) -> bool {
        let counter = if on { word } else { word >> BITS };
        counter & COUNTER == COUNTER
    }

    /// The time is taken to fit: a push sees to that before it begins.
    #[inline(always)]
    fn stepped(word: u64, on: bool, since: i64) -> u64 {
        let counters = (word + if on { 1 } else { 1 << BITS }) & ((1 << (2 * BITS)) - 1);
        counters | since.cast_unsigned() << (2 * BITS)
    }

    #[inline(always)]
    fn take(&mut self, word: u64, _: bool, _: i64) {
        self.set_word(word);
    }
}

/// A record that holds all that there may be.
#[derive(Clone, Copy, Default)]
pub(crate) struct Wide {
    base: f64,
    /// From the lowest bit: 32 bits of ON events and 32 bits of OFF events.
    word: u64,
    last_event_us: i64,
}

impl Wide {
    pub(crate) fn of(level: Level, last_event_us: i64) -> Self {
        Self { base: level.base, word: u64::from(level.on) | u64::from(level.off) << 32, last_event_us }
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Record for Wide {
    type Old = (u64, i64);

    fn new(level: Level, last_event_us: i64, _: i64) -> Option<Self> {
        Some(Self::of(level, last_event_us))
    }

    #[allow(clippy::cast_possible_truncation, reason = "split")]
    fn level(self) -> Level {
        Level { base: self.base, on: self.word as u32, off: (self.word >> 32) as u32 }
    }

    fn last_event_us(self, _: i64) -> i64 {
        self.last_event_us
    }

    fn narrow<'a>(_: &'a mut [Self], _: &'a mut [(u64, i64)]) -> Option<(&'a mut [Narrow], &'a mut [u64])> {
        None
    }

    #[inline(always)]
    fn old(records: &[Self], pixel: u32, word: u64) -> (u64, i64) {
        (word, records[pixel as usize].last_event_us)
    }

    fn restore(&mut self, old: (u64, i64)) {
        (self.word, self.last_event_us) = old;
    }

    #[inline(always)]
    fn base(self) -> f64 {
        self.base
    }

    #[inline(always)]
    fn word(self) -> u64 {
        self.word
    }

    #[inline(always)]
    #[allow(clippy::cast_possible_truncation, reason = "split")]
    fn counters(word: u64) -> (f64, f64) {
        (f64::from(word as u32), f64::from((word >> 32) as u32))
    }

    /// Counters have room: the engine sees to that.
    #[inline(always)]
    fn is_full(_: u64, _: bool) -> bool {
        false
    }

    #[inline(always)]
    fn stepped(word: u64, on: bool, _: i64) -> u64 {
        word + if on { 1 } else { 1 << 32 }
    }

    #[inline(always)]
    fn take(&mut self, word: u64, is: bool, t_us: i64) {
        self.word = word;
        self.last_event_us = if is { t_us } else { self.last_event_us };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LEVEL: Level = Level { base: 0.25, on: 7, off: 9 };

    fn narrow(on: u32, off: u32, last_event_us: i64, zero_us: i64) -> Option<Narrow> {
        Narrow::new(Level { on, off, ..LEVEL }, last_event_us, zero_us)
    }

    #[test]
    fn records_give_back_what_they_hold() {
        for (on, off, t_us, zero_us) in [(7, 9, NEVER, 0), (0, 65_535, 12, 11), (65_535, 0, 0, -1), (1, 2, 1 << 32, 1)]
        {
            let record = narrow(on, off, t_us, zero_us).unwrap();
            assert_eq!(record.level(), Level { on, off, ..LEVEL });
            assert_eq!(record.last_event_us(zero_us), t_us);
            let record = Wide::of(record.level(), t_us);
            assert_eq!((record.level(), record.last_event_us(zero_us)), (Level { on, off, ..LEVEL }, t_us));
        }
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        assert!(narrow(65_536, 0, NEVER, 0).is_none());
        assert!(narrow(0, 65_536, NEVER, 0).is_none());
        // At and before the clock's zero, at its end, and times that no event has.
        for (t_us, zero_us) in [(5, 5), (4, 5), (1 << 32, 0), (i64::MAX, -1), (-2, -9), (i64::MIN, 0)] {
            assert!(narrow(0, 0, t_us, zero_us).is_none(), "{t_us} {zero_us}");
        }
    }

    #[test]
    fn events_are_counted_and_taken_back() {
        fn count<R: Record>(mut record: R) {
            let before = R::old(&[record], 0, record.word());
            for (on, t_us) in [(true, 500), (false, 600), (false, 700)] {
                record.take(R::stepped(record.word(), on, t_us - 100), true, t_us);
            }
            assert_eq!(record.level(), Level { on: 8, off: 11, ..LEVEL });
            assert_eq!((record.base(), R::counters(record.word())), (LEVEL.base, (8.0, 11.0)));
            assert_eq!(record.last_event_us(100), 700);
            record.take(record.word(), false, 800);
            assert_eq!((record.level().off, record.last_event_us(100)), (11, 700));
            record.restore(before);
            assert_eq!((record.level(), record.last_event_us(100)), (LEVEL, NEVER));
        }
        count(narrow(7, 9, NEVER, 100).unwrap());
        count(Wide::of(LEVEL, NEVER));
    }

    #[test]
    fn narrow_counters_tell_when_they_are_full() {
        for (on, off) in [(65_534, 65_535), (65_535, 65_534), (65_534, 65_534), (65_535, 65_535)] {
            let word = narrow(on, off, 9, 0).unwrap().word();
            assert_eq!(Narrow::is_full(word, true), on == 65_535);
            assert_eq!(Narrow::is_full(word, false), off == 65_535);
        }
        let last = Narrow::stepped(narrow(65_534, 65_534, 9, 0).unwrap().word(), true, u32::MAX.into());
        assert_eq!(Narrow::counters(last), (65_535.0, 65_534.0));
    }
}
