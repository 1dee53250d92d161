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

    /// What the next event will change.
    fn old(self) -> Self::Old;

    fn restore(&mut self, old: Self::Old);

    /// Takes an event. False where the record cannot hold it, and then is as it was.
    fn count(&mut self, on: bool, t_us: i64, zero_us: i64) -> bool;
}

/// A record of 16 bytes.
#[derive(Clone, Copy, Default)]
#[repr(align(16))]
pub(crate) struct Narrow {
    base: f64,
    /// From the lowest bit: 16 bits of ON events, 16 bits of OFF events, and 32 bits of the time of the last event since
    /// `zero_us`; 0 = none yet.
    word: u64,
}

const BITS: u32 = 16;
const COUNTER: u64 = u16::MAX as u64;

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

    #[inline]
    fn old(self) -> u64 {
        self.word
    }

    fn restore(&mut self, old: u64) {
        self.word = old;
    }

    /// The time is taken to fit: a push sees to that before it begins.
    #[inline]
    fn count(&mut self, on: bool, t_us: i64, zero_us: i64) -> bool {
        let shift = if on { 0 } else { BITS };
        let fits = self.word >> shift & COUNTER != COUNTER;
        let counters = (self.word + (1 << shift)) & (1 << (2 * BITS)) - 1;
        let since = (t_us - zero_us).cast_unsigned();
        self.word = if fits { counters | since << (2 * BITS) } else { self.word };
        fits
    }
}

/// A record that holds all that there may be.
#[derive(Clone, Copy, Default)]
pub(crate) struct Wide {
    base: f64,
    on: u32,
    off: u32,
    last_event_us: i64,
}

impl Wide {
    pub(crate) fn of(level: Level, last_event_us: i64) -> Self {
        Self { base: level.base, on: level.on, off: level.off, last_event_us }
    }
}

impl Record for Wide {
    type Old = (u32, u32, i64);

    fn new(level: Level, last_event_us: i64, _: i64) -> Option<Self> {
        Some(Self::of(level, last_event_us))
    }

    #[inline]
    fn level(self) -> Level {
        Level { base: self.base, on: self.on, off: self.off }
    }

    fn last_event_us(self, _: i64) -> i64 {
        self.last_event_us
    }

    #[inline]
    fn old(self) -> (u32, u32, i64) {
        (self.on, self.off, self.last_event_us)
    }

    fn restore(&mut self, old: (u32, u32, i64)) {
        (self.on, self.off, self.last_event_us) = old;
    }

    /// Counters have room: the engine sees to that.
    #[inline]
    fn count(&mut self, on: bool, t_us: i64, _: i64) -> bool {
        *if on { &mut self.on } else { &mut self.off } += 1;
        self.last_event_us = t_us;
        true
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
        for (on, off, t_us, zero_us) in [(7, 9, NEVER, 0), (0, 65_535, 12, 11), (65_535, 0, 0, -1), (1, 2, 1 << 32, 1)] {
            let record = narrow(on, off, t_us, zero_us).unwrap();
            assert_eq!(record.level(), Level { on, off, ..LEVEL });
            assert_eq!(record.last_event_us(zero_us), t_us);
            let record = Wide::new(record.level(), t_us, zero_us).unwrap();
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
            let before = record.old();
            assert!(record.count(true, 500, 100) && record.count(false, 600, 100) && record.count(false, 700, 100));
            assert_eq!(record.level(), Level { on: 8, off: 11, ..LEVEL });
            assert_eq!(record.last_event_us(100), 700);
            record.restore(before);
            assert_eq!((record.level(), record.last_event_us(100)), (LEVEL, NEVER));
        }
        count(narrow(7, 9, NEVER, 100).unwrap());
        count(Wide::new(LEVEL, NEVER, 100).unwrap());
    }

    #[test]
    fn a_full_counter_counts_no_further() {
        let mut record = narrow(65_534, 65_534, NEVER, 0).unwrap();
        assert!(record.count(true, 1, 0) && !record.count(true, 2, 0));
        assert!(record.count(false, 3, 0) && !record.count(false, 4, 0));
        assert_eq!(record.level(), Level { on: 65_535, off: 65_535, ..LEVEL });
        assert_eq!(record.last_event_us(0), 3);
    }
}
