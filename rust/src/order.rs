//! The one order of a simulated stream: (t, y, x, order of crossing).

use std::collections::TryReserveError;
use std::hint::black_box;

use crate::event::Event;
use crate::huge_pages;

/// Times are sorted into buckets by this many leading bits. In a short interval, each tick has a bucket of its own.
const BUCKET_BITS: u32 = 12;

/// An event of an interval, in whatever form.
pub(crate) trait Stamped: Copy {
    /// Returns its time since the interval's start.
    fn tick(self, start_us: i64) -> i64;

    /// The bits of its position on the sensor.
    const ADDRESS: u64;

    /// Returns the event. `address` is [`Self::ADDRESS`], as a number that the compiler does not know: if it knew which
    /// bits are zero, it would store events byte by byte.
    fn event(self, start_us: i64, address: u64) -> Event;
}

impl Stamped for Event {
    const ADDRESS: u64 = 0;

    #[inline]
    fn tick(self, start_us: i64) -> i64 {
        self.t - start_us
    }

    #[inline]
    fn event(self, _: i64, _: u64) -> Event {
        self
    }
}

/// Sorts the events of an interval by time: stably, from raster order (y, x, order of crossing).
///
/// The result depends only on the events, not on the threads that made them. The memory for counting is kept.
#[derive(Default)]
pub(crate) struct TimeSort {
    starts: Vec<usize>,
}

impl TimeSort {
    /// Puts the events of `bands`, which together are in raster order and lie in `(start_us, start_us + ticks]`, into
    /// `sorted`; where memory does not suffice, nothing is changed.
    pub(crate) fn sort<'a, E: Stamped + 'a>(
        &mut self,
        bands: impl Iterator<Item = &'a [E]> + Clone,
        start_us: i64,
        ticks: i64,
        sorted: &mut Vec<Event>,
    ) -> Result<(), TryReserveError> {
        let total: usize = bands.clone().map(<[E]>::len).sum();
        sorted.try_reserve_exact(total.saturating_sub(sorted.len()))?;
        huge_pages::ask_for(sorted);
        // What is in there will be overwritten: no need to clear it.
        sorted.resize(total, Event::default());
        if total == 0 {
            return Ok(());
        }
        let shift = (i64::BITS - ticks.leading_zeros()).saturating_sub(BUCKET_BITS);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "BUCKET_BITS are left")]
        let bucket = |event: E| (event.tick(start_us) >> shift) as usize;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "BUCKET_BITS are left")]
        let buckets = (ticks >> shift) as usize + 1;
        self.starts.clear();
        self.starts.resize(buckets + 1, 0);
        // Loops of their own: a flat iterator costs more than what is done here.
        let starts = &mut self.starts[..=buckets];
        for band in bands.clone() {
            for &event in band {
                starts[bucket(event) + 1] += 1;
            }
        }
        for i in 1..self.starts.len() {
            self.starts[i] += self.starts[i - 1];
        }
        let address_bits = black_box(E::ADDRESS);
        let (starts, slots) = (&mut self.starts[..buckets], &mut sorted[..]);
        for band in bands {
            for &event in band {
                let next = &mut starts[bucket(event)];
                slots[*next] = event.event(start_us, address_bits);
                *next += 1;
            }
        }
        if shift > 0 {
            // Each bucket's start has moved on to its end.
            let mut rest = &mut sorted[..];
            let mut taken = 0;
            for &end in &self.starts[..buckets] {
                let (bucket, after) = rest.split_at_mut(end - taken);
                bucket.sort_by_key(|event| event.t);
                (rest, taken) = (after, end);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn it_is_a_stable_sort(times in prop::collection::vec(1i64..=100_000, 0..300), ticks in prop::sample::select(vec![100_000i64, 1 << 40]), cut in 0usize..300) {
            let events: Vec<Event> = times.iter().zip(0u16..).map(|(&t, i)| Event::new(7 + t, i, i, true)).collect();
            let (a, b) = events.split_at(cut.min(events.len()));
            let mut sorted = Vec::new();
            TimeSort::default().sort([a, b].into_iter(), 7, ticks, &mut sorted).unwrap();
            let mut expected = events.clone();
            expected.sort_by_key(|event| event.t);
            prop_assert_eq!(sorted, expected);
        }
    }
}
