//! What a format can hold, and the check that every packet passes before anything of it is written.

use crate::error::{Error, Result};
use crate::event::Event;

/// What a stream may hold: pixels of its sensor, and times as its format can write them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// The latest time, in microseconds; the earliest is 0.
    pub latest_us: i64,
    /// Columns: x lies below.
    pub width: u32,
    /// Rows: y lies below.
    pub height: u32,
}

impl Limits {
    /// All that an [`Event`] can hold from time 0.
    pub const NONE: Self = Self { latest_us: i64::MAX, width: 1 << 16, height: 1 << 16 };

    /// Returns these limits for a sensor of a size, or of as much of it as they allow.
    #[must_use]
    pub fn for_sensor(self, width: u32, height: u32) -> Self {
        Self { width: width.min(self.width), height: height.min(self.height), ..self }
    }

    /// Checks a packet that follows an event at `after_us` (0 at the beginning).
    ///
    /// # Errors
    /// [`Error::Order`] or [`Error::Argument`] with index, value and rule of the first event that breaks one.
    pub fn check(&self, events: &[Event], after_us: i64) -> Result<()> {
        let mut last_us = after_us;
        let mut good = true;
        // Without a branch an event; which one it was is asked only if there was one.
        for event in events {
            good &= event.t >= last_us
                && u32::from(event.x) < self.width
                && u32::from(event.y) < self.height
                && event.p <= 1;
            last_us = event.t;
        }
        if good && last_us <= self.latest_us { Ok(()) } else { Err(self.first_fault(events, after_us)) }
    }

    #[cold]
    fn first_fault(&self, events: &[Event], after_us: i64) -> Error {
        let mut last_us = after_us;
        for (index, &Event { t, x, y, p, .. }) in events.iter().enumerate() {
            if t < last_us {
                return Error::Order(format!(
                    "event times must not decrease and start at 0 or later: event {index} of the packet is at {t} us, \
                     after {last_us} us"
                ));
            }
            last_us = t;
            let rule = if t > self.latest_us {
                format!(
                    "times must be at most {} us in this format: event {index} of the packet is at {t} us",
                    self.latest_us
                )
            } else if u32::from(x) >= self.width {
                format!("x must be below the sensor's width {}: event {index} of the packet has {x}", self.width)
            } else if u32::from(y) >= self.height {
                format!("y must be below the sensor's height {}: event {index} of the packet has {y}", self.height)
            } else if p > 1 {
                format!("polarity must be 0 or 1: event {index} of the packet has {p}")
            } else {
                continue;
            };
            return Error::Argument(rule);
        }
        unreachable!("a fault was seen")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_rule_is_named_with_index_and_value() {
        let limits = Limits { latest_us: 100, width: 240, height: 180 };
        let good = Event::new(100, 239, 179, true);
        let mut grey = good;
        grey.p = 2;
        for (event, rule) in [
            (
                Event::new(6, 0, 0, true),
                "must not decrease and start at 0 or later: event 1 of the packet is at 6 us, after 7 us",
            ),
            (Event::new(101, 0, 0, true), "at most 100 us in this format: event 1 of the packet is at 101 us"),
            (Event::new(7, 240, 0, true), "below the sensor's width 240: event 1 of the packet has 240"),
            (Event::new(7, 0, 180, true), "below the sensor's height 180: event 1 of the packet has 180"),
            (grey, "polarity must be 0 or 1: event 1 of the packet has 2"),
        ] {
            let error = limits.check(&[Event::new(7, 0, 0, false), event], 7).unwrap_err().to_string();
            assert!(error.contains(rule), "{error}");
        }
        assert!(limits.check(&[good, good], 100).is_ok());
        assert!(limits.check(&[Event::new(-1, 0, 0, true)], 0).is_err());
    }
}
