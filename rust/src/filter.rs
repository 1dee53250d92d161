//! Filters of event streams: which events pass, by what happened near them before.
//!
//! An [`EventFilter`] keeps the last times of all pixels, so a stream can be given packet by packet.
//!
//! What must not break: the result does not depend on the cut into packets. A packet with an event that is refused
//! changes nothing.

use crate::error::{Error, Result};
use crate::event::{Event, SensorSize};

/// What lets an event pass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FilterRule {
    /// One of the eight pixels around had an event a short time before: noise is alone, edges are not.
    ///
    /// Source: Delbruck, "Frame-free dynamic digital vision", Symposium on Secure-Life Electronics, 2008.
    BackgroundActivity {
        /// How long before, in microseconds, at most.
        window_us: i64,
        /// How many of the eight must have had one.
        neighbours: u8,
    },
    /// The pixel's last event that passed lies so many microseconds back, or more.
    Refractory {
        /// In microseconds.
        period_us: i64,
    },
    /// The pixel does not flicker: it has not turned from OFF to ON several times in a row at even intervals.
    ///
    /// Source: Metavision SDK, anti-flicker filter of event-based sensors (its parameters, not its code).
    Flicker {
        /// The shortest and the longest period that is flicker, in microseconds.
        shortest_us: i64,
        /// See `shortest_us`.
        longest_us: i64,
        /// By how much two periods in a row may differ, in microseconds.
        tolerance_us: i64,
        /// After so many even periods a pixel flickers.
        periods: u8,
    },
}

/// What is kept of a pixel. Which fields a rule uses, it alone decides.
#[derive(Clone, Copy)]
struct Pixel {
    /// The last event (background activity), the last that passed (refractory), or the last turn to ON (flicker).
    last_us: i64,
    period_us: i64,
    /// Even periods in a row.
    even: u8,
    on: bool,
}

/// Longer ago than any period.
const NEVER: i64 = i64::MIN;
const FRESH: Pixel = Pixel { last_us: NEVER, period_us: 0, even: 0, on: true };

/// Tells which events of a stream pass a [`FilterRule`].
pub struct EventFilter {
    size: SensorSize,
    rule: FilterRule,
    pixels: Vec<Pixel>,
    last_us: i64,
}

impl EventFilter {
    /// Returns a filter that has seen nothing.
    #[must_use]
    pub fn new(size: SensorSize, rule: FilterRule) -> Self {
        Self { size, rule, pixels: vec![FRESH; size.pixels()], last_us: NEVER }
    }

    /// Returns for each event whether it passes.
    ///
    /// # Errors
    /// [`Error::Argument`] for an event outside of the sensor or of another polarity than 0 and 1, [`Error::Order`]
    /// for times that go back; then nothing is changed.
    pub fn passes(&mut self, events: &[Event]) -> Result<Vec<bool>> {
        let mut last_us = self.last_us;
        for (index, event) in events.iter().enumerate() {
            if event.x >= self.size.width || event.y >= self.size.height || event.p > 1 {
                return Err(Error::Argument(format!(
                    "events must lie on the {} x {} sensor with polarity 0 or 1: event {index} is at ({}, {}) with {}",
                    self.size.width, self.size.height, event.x, event.y, event.p
                )));
            }
            if event.t < last_us {
                return Err(Error::Order(format!(
                    "times of events must not go back: event {index} is at {} us, after {last_us} us",
                    event.t
                )));
            }
            last_us = event.t;
        }
        self.last_us = last_us;
        Ok(events.iter().map(|event| self.pass(event)).collect())
    }

    fn pass(&mut self, event: &Event) -> bool {
        let index = event.pixel(self.size);
        let since = |last_us: i64| event.t.saturating_sub(last_us);
        match self.rule {
            FilterRule::BackgroundActivity { window_us, neighbours } => {
                let near = self.around(event).filter(|&pixel| since(self.pixels[pixel].last_us) <= window_us);
                let passes = near.take(neighbours.into()).count() == usize::from(neighbours);
                self.pixels[index].last_us = event.t;
                passes
            }
            FilterRule::Refractory { period_us } => {
                let pixel = &mut self.pixels[index];
                let passes = since(pixel.last_us) >= period_us;
                if passes {
                    pixel.last_us = event.t;
                }
                passes
            }
            FilterRule::Flicker { shortest_us, longest_us, tolerance_us, periods } => {
                let pixel = &mut self.pixels[index];
                let on = event.p == 1;
                if since(pixel.last_us) > longest_us {
                    (pixel.even, pixel.period_us) = (0, 0);
                }
                if on && !pixel.on {
                    let period_us = since(pixel.last_us);
                    let in_range = (shortest_us..=longest_us).contains(&period_us);
                    let alike = pixel.even == 0 || (period_us - pixel.period_us).abs() <= tolerance_us;
                    pixel.even = match (in_range, alike) {
                        (true, true) => pixel.even.saturating_add(1),
                        (true, false) => 1,
                        (false, _) => 0,
                    };
                    (pixel.last_us, pixel.period_us) = (event.t, period_us);
                }
                pixel.on = on;
                pixel.even < periods
            }
        }
    }

    /// Returns the pixels around that of an event, which are on the sensor.
    fn around(&self, event: &Event) -> impl Iterator<Item = usize> + use<> {
        let (width, height) = (usize::from(self.size.width), usize::from(self.size.height));
        let (x, y) = (usize::from(event.x), usize::from(event.y));
        let rows = y.saturating_sub(1)..(y + 2).min(height);
        let columns = x.saturating_sub(1)..(x + 2).min(width);
        rows.flat_map(move |row| columns.clone().map(move |column| (row, column)))
            .filter(move |&pixel| pixel != (y, x))
            .map(move |(row, column)| row * width + column)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SIZE: SensorSize = SensorSize { width: 5, height: 4 };

    fn passes(rule: FilterRule, events: &[Event]) -> Vec<bool> {
        EventFilter::new(SIZE, rule).passes(events).unwrap()
    }

    fn streams() -> impl Strategy<Value = Vec<Event>> {
        prop::collection::vec((0i64..40, 0u16..5, 0u16..4, any::<bool>()), 0..80).prop_map(|mut raw| {
            raw.sort_by_key(|event| event.0);
            raw.into_iter().map(|(t, x, y, on)| Event::new(t, x, y, on)).collect()
        })
    }

    #[test]
    fn an_edge_passes_and_noise_does_not() {
        let rule = FilterRule::BackgroundActivity { window_us: 10, neighbours: 1 };
        let at = |t, x, y| Event::new(t, x, y, true);
        let events = [at(0, 0, 0), at(10, 1, 1), at(21, 0, 0), at(22, 4, 3), at(23, 4, 3), at(24, 0, 3), at(25, 4, 0)];
        assert_eq!(passes(rule, &events), [false, true, false, false, false, false, false]);
    }

    #[test]
    fn a_pixel_rests_from_what_passed() {
        let rule = FilterRule::Refractory { period_us: 10 };
        let events = [0, 9, 10, 19, 20, 31].map(|t| Event::new(t, 1, 1, t % 2 == 0));
        assert_eq!(passes(rule, &events), [true, false, true, false, true, true]);
    }

    #[test]
    fn even_turns_are_flicker_until_they_end() {
        let rule = FilterRule::Flicker { shortest_us: 8, longest_us: 12, tolerance_us: 1, periods: 2 };
        let turn = |t| [Event::new(t - 5, 0, 0, false), Event::new(t, 0, 0, true)];
        let ons = |times: &[i64]| -> Vec<bool> {
            let events: Vec<Event> = times.iter().flat_map(|&t| turn(t)).collect();
            passes(rule, &events).into_iter().skip(1).step_by(2).collect()
        };
        assert_eq!(ons(&[10, 20, 30, 40]), [true, true, false, false]);
        assert_eq!(ons(&[10, 20, 31, 41]), [true, true, false, false]);
        assert_eq!(ons(&[10, 18, 30, 42, 54]), [true, true, true, false, false]); // uneven, then even
        assert_eq!(ons(&[10, 17, 24, 31]), [true; 4]); // too fast
        assert_eq!(ons(&[10, 23, 36, 49]), [true; 4]); // too slow
        assert_eq!(ons(&[10, 20, 30, 60, 70]), [true, true, false, true, true]); // it has stopped
        // What lies outside of the range is no period to go on from.
        let wide = FilterRule::Flicker { shortest_us: 8, longest_us: 12, tolerance_us: 5, periods: 2 };
        let events: Vec<Event> = [10, 17, 27, 37].into_iter().flat_map(turn).collect();
        assert_eq!(passes(wide, &events), [true, true, true, true, true, true, true, false]);
        // It is over once a turn is late, before the next one comes.
        let events: Vec<Event> = [10, 20, 30, 50].into_iter().flat_map(turn).collect();
        assert_eq!(passes(rule, &events), [true, true, true, true, true, false, true, true]);
        // Events of one polarity have no period.
        let events = [10, 20, 30, 40].map(|t| Event::new(t, 0, 0, true));
        assert_eq!(passes(rule, &events), [true; 4]);
    }

    #[test]
    fn what_is_refused_changes_nothing() {
        let mut filter = EventFilter::new(SIZE, FilterRule::Refractory { period_us: 10 });
        let outside = [Event::new(1, 0, 0, true), Event::new(2, 5, 0, true)];
        assert!(matches!(filter.passes(&outside), Err(Error::Argument(_))));
        assert!(matches!(filter.passes(&[Event::new(1, 0, 4, true)]), Err(Error::Argument(_))));
        assert_eq!(filter.passes(&[Event::new(5, 0, 0, true)]).unwrap(), [true]);
        assert!(matches!(filter.passes(&[Event::new(4, 0, 0, true)]), Err(Error::Order(_))));
        assert_eq!(filter.passes(&[Event::new(5, 1, 0, true)]).unwrap(), [true]);
    }

    proptest! {
        #[test]
        fn background_activity_is_its_rule(events in streams(), window_us in 0i64..12, neighbours in 1u8..4) {
            let passed = passes(FilterRule::BackgroundActivity { window_us, neighbours }, &events);
            for (n, event) in events.iter().enumerate() {
                let near: std::collections::BTreeSet<_> = events[..n].iter().filter(|other| {
                    let (dx, dy) = (other.x.abs_diff(event.x), other.y.abs_diff(event.y));
                    dx.max(dy) == 1 && event.t - other.t <= window_us
                }).map(|other| (other.x, other.y)).collect();
                prop_assert_eq!(passed[n], near.len() >= usize::from(neighbours));
            }
        }

        #[test]
        fn any_cut_gives_the_same(events in streams(), cut in 0usize..80) {
            for rule in [
                FilterRule::BackgroundActivity { window_us: 5, neighbours: 2 },
                FilterRule::Refractory { period_us: 7 },
                FilterRule::Flicker { shortest_us: 2, longest_us: 20, tolerance_us: 5, periods: 2 },
            ] {
                let whole = passes(rule, &events);
                let (early, late) = events.split_at(cut.min(events.len()));
                let mut filter = EventFilter::new(SIZE, rule);
                let parts = [filter.passes(early).unwrap(), filter.passes(late).unwrap()].concat();
                prop_assert_eq!(parts, whole);
            }
        }
    }
}
