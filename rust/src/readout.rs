//! The readout bus (the effect `readout`): events wait for a shared bus, which reads them out row by row.
//!
//! A pixel that fires only requests its row. The bus grants one row after the other and carries a limited number of events
//! a second, so a burst of events leaves late and with few distinct stamps. (The frames of the active pixels have a readout of
//! their own, which is in `aer::frame_assembler`.)
//!
//! What must not break: every event leaves once or is counted as dropped, stamps never decrease, and the result does not
//! depend on how the stream is split into calls.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};

use crate::error::{Error, Result};
use crate::event::{Event, SensorSize};
use crate::random::{Draw, Purpose};

/// The parameters of a row-wise arbiter (address-event representation).
///
/// Pixels ask for their row. The bus grants the row whose oldest request came first, and reads all of its requests in
/// one burst: one stamp, the row's address, then a column a turn. Source: Brandli, Berner, Yang, Liu and Delbruck, "A 240 x 180 130 dB 3 us
/// latency global shutter spatiotemporal vision sensor", IEEE JSSC 49(10), 2014 (word-serial burst mode).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReadoutParameters {
    /// Events that the bus carries in a second, > 0; infinite for any number at once.
    pub events_per_s: f64,
    /// What a row's address costs on top, in microseconds, >= 0.
    pub row_us: f64,
    /// From the grant of a row to its stamp, in microseconds, >= 0.
    pub latency_us: f64,
    /// Standard deviation of a stamp's normal jitter in microseconds, >= 0; never earlier than its grant or the stamp
    /// before it.
    pub jitter_us: f64,
    /// An event that has waited longer than this when its row is granted is dropped, and counted; None drops none.
    pub drop_after_us: Option<f64>,
}

impl ReadoutParameters {
    /// Whether events leave as they come.
    #[must_use]
    pub fn is_neutral(&self) -> bool {
        self.events_per_s.is_infinite() && self.row_us == 0.0 && self.latency_us == 0.0 && self.jitter_us == 0.0
    }

    pub(crate) fn check(&self) -> Result<()> {
        let rule = |name: &str, allowed: &str, value: f64| {
            Err(Error::Argument(format!("readout: {name} must {allowed}, got {value}")))
        };
        if self.events_per_s.is_nan() || self.events_per_s < 1.0 {
            return rule("events_per_s", "be at least 1 per second", self.events_per_s);
        }
        let waits = [
            ("row_us", Some(self.row_us)),
            ("latency_us", Some(self.latency_us)),
            ("jitter_us", Some(self.jitter_us)),
            ("drop_after_us", self.drop_after_us),
        ];
        for (name, value) in waits {
            if let Some(value) = value.filter(|value| !(0.0..=1e9).contains(value)) {
                return rule(name, "lie in 0..1e9 us", value);
            }
        }
        Ok(())
    }
}

/// The furthest that stamps can lie ahead of the last frame: latency, jitter and a whole row at one event a second are less.
const LONGEST_AHEAD_US: i64 = 1 << 50;

/// What a readout still holds, as plain data to be stored.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReadoutState {
    /// Requests that were not granted yet, in the order of their coming.
    pub waiting: Vec<Event>,
    /// Events that were read, with stamps that lie ahead.
    pub stamped: Vec<Event>,
    /// When the bus falls free: whole microseconds, and a share of the next.
    pub free_us: i64,
    /// See `free_us`.
    pub free_share: f64,
    /// The last stamp given.
    pub last_stamp_us: i64,
    /// Bursts so far.
    pub bursts: u64,
    /// Events dropped so far.
    pub dropped: u64,
}

/// The bus, with the events that wait for it.
pub(crate) struct Readout {
    parameters: ReadoutParameters,
    seed: u64,
    rows: Vec<VecDeque<Event>>,
    /// Rows with requests, by their oldest one: (time, row).
    requests: BinaryHeap<Reverse<(i64, u16)>>,
    stamped: VecDeque<Event>,
    free_us: i64,
    free_share: f64,
    last_stamp_us: i64,
    bursts: u64,
    dropped: u64,
}

impl Readout {
    /// A bus that nothing waits for.
    pub(crate) fn new(size: SensorSize, parameters: ReadoutParameters, seed: u64) -> Self {
        Self::of(size, parameters, seed, &ReadoutState::default())
    }

    /// The same bus where a state at `t_us` left it.
    pub(crate) fn restored(&self, size: SensorSize, state: &ReadoutState, t_us: i64) -> Result<Self> {
        let rule = |what: &str| Err(Error::Argument(format!("the readout of a state at {t_us} us {what}")));
        let mut all = state.waiting.iter().chain(&state.stamped);
        if all.any(|event| event.x >= size.width || event.y >= size.height || event.p > 1) {
            return rule("must hold events of the sensor");
        }
        let sorted = |events: &[Event]| events.is_sorted_by_key(|event| event.t);
        if !sorted(&state.waiting) || !sorted(&state.stamped) {
            return rule("must hold events in order of time");
        }
        if state.waiting.iter().any(|event| !(0..=t_us).contains(&event.t)) {
            return rule("must have waiting events until then");
        }
        let latest_us = t_us.saturating_add(LONGEST_AHEAD_US);
        let ahead = |us: i64| t_us < us && us <= latest_us;
        if state.stamped.iter().any(|event| !ahead(event.t)) {
            return rule("must have stamps after that");
        }
        let times = [state.free_us, state.last_stamp_us];
        if times.iter().any(|us| !(0..=latest_us).contains(us)) || !(0.0..1.0).contains(&state.free_share) {
            return rule("must have times of the bus near then");
        }
        Ok(Self::of(size, self.parameters, self.seed, state))
    }

    fn of(size: SensorSize, parameters: ReadoutParameters, seed: u64, state: &ReadoutState) -> Self {
        let mut readout = Self {
            parameters,
            seed,
            rows: vec![VecDeque::new(); usize::from(size.height)],
            requests: BinaryHeap::new(),
            stamped: state.stamped.iter().copied().collect(),
            free_us: state.free_us,
            free_share: state.free_share,
            last_stamp_us: state.last_stamp_us,
            bursts: state.bursts,
            dropped: state.dropped,
        };
        readout.ask(&state.waiting);
        readout
    }

    pub(crate) fn dropped(&self) -> u64 {
        self.dropped
    }

    pub(crate) fn state(&self) -> ReadoutState {
        let mut waiting: Vec<Event> = self.rows.iter().flatten().copied().collect();
        waiting.sort_by_key(|event| event.t);
        ReadoutState {
            waiting,
            stamped: self.stamped.iter().copied().collect(),
            free_us: self.free_us,
            free_share: self.free_share,
            last_stamp_us: self.last_stamp_us,
            bursts: self.bursts,
            dropped: self.dropped,
        }
    }

    /// Takes the events until `until_us`, and turns them into those that have left by then.
    ///
    /// `events` are sorted by (t, y, x, order), before and after; no later call gives stamps up to `until_us`.
    pub(crate) fn pass(&mut self, events: &mut Vec<Event>, until_us: i64) {
        self.ask(events);
        events.clear();
        self.grant(until_us);
        let leaving = self.stamped.partition_point(|event| event.t <= until_us);
        events.extend(self.stamped.drain(..leaving));
        in_order(events);
    }

    /// Everything that is left.
    pub(crate) fn flush(&mut self) -> Vec<Event> {
        self.grant(i64::MAX);
        let mut events: Vec<Event> = self.stamped.drain(..).collect();
        in_order(&mut events);
        events
    }

    fn ask(&mut self, events: &[Event]) {
        for event in events {
            let row = &mut self.rows[usize::from(event.y)];
            if row.is_empty() {
                self.requests.push(Reverse((event.t, event.y)));
            }
            row.push_back(*event);
        }
    }

    /// Reads out all rows that are granted until a time.
    #[allow(clippy::cast_precision_loss, reason = "waits and bursts are far below 2^53")]
    #[allow(clippy::cast_possible_truncation, reason = "waits and bursts are far below 2^53")]
    fn grant(&mut self, until_us: i64) {
        let us_per_event = 1e6 / self.parameters.events_per_s;
        while let Some(&Reverse((first_us, row))) = self.requests.peek() {
            // Whole microseconds apart from their share: a float of both loses the share in a long time.
            let (now_us, share) =
                if first_us > self.free_us { (first_us, 0.0) } else { (self.free_us, self.free_share) };
            if now_us > until_us || (now_us == until_us && share > 0.0) {
                return;
            }
            self.requests.pop();
            let queue = &mut self.rows[usize::from(row)];
            let waiting = queue.partition_point(|event| event.t <= now_us);
            let longest_us = self.parameters.drop_after_us.unwrap_or(f64::INFINITY);
            let late = queue.partition_point(|event| (now_us - event.t) as f64 + share > longest_us);
            queue.drain(..late);
            self.dropped += late as u64;
            let burst = waiting - late;
            if burst > 0 {
                let delay_us = share + delay(&self.parameters, self.seed, row, self.bursts);
                let stamp_us = (now_us + delay_us.ceil() as i64).max(self.last_stamp_us);
                let first = self.stamped.len();
                self.stamped.extend(queue.drain(..burst).map(|event| event.at(stamp_us)));
                self.stamped.make_contiguous()[first..].sort_by_key(|event| event.x);
                self.last_stamp_us = stamp_us;
                self.bursts += 1;
                let free = share + self.parameters.row_us + burst as f64 * us_per_event;
                (self.free_us, self.free_share) = (now_us + free.floor() as i64, free.fract());
            }
            if let Some(next) = queue.front() {
                self.requests.push(Reverse((next.t, row)));
            }
        }
    }
}

/// The time from a burst's grant to its stamp, in microseconds. It is never negative, whatever the jitter is.
fn delay(p: &ReadoutParameters, seed: u64, row: u16, burst: u64) -> f64 {
    let jitter_us = if p.jitter_us > 0.0 {
        p.jitter_us * Draw::at(seed, Purpose::ReadoutJitter, row.into(), burst).normal()
    } else {
        0.0
    };
    (p.latency_us + jitter_us).max(0.0)
}

/// Sorts by time; bursts of the same stamp in raster order.
fn in_order(events: &mut [Event]) {
    events.sort_by_key(|event| (event.t, event.y, event.x));
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SIZE: SensorSize = SensorSize { width: 16, height: 8 };
    const BUS: ReadoutParameters =
        ReadoutParameters { events_per_s: 1e6, row_us: 0.0, latency_us: 0.0, jitter_us: 0.0, drop_after_us: None };

    fn readout(parameters: ReadoutParameters) -> Readout {
        Readout::new(SIZE, parameters, 1)
    }

    fn requests() -> impl Strategy<Value = Vec<Event>> {
        prop::collection::vec((0i64..300, 0u16..8, 0u16..16, any::<bool>()), 0..200).prop_map(|events| {
            let mut events: Vec<Event> = events.into_iter().map(|(t, y, x, on)| Event::new(t, x, y, on)).collect();
            in_order(&mut events);
            events
        })
    }

    #[test]
    fn a_row_is_read_in_one_burst_of_one_stamp() {
        let mut bus = readout(BUS);
        // While row 3 is read (2 us), row 5 asks and row 3 asks again.
        let mut events = vec![
            Event::new(10, 4, 3, true),
            Event::new(10, 7, 3, false),
            Event::new(11, 0, 5, true),
            Event::new(11, 1, 3, true),
        ];
        bus.pass(&mut events, 100);
        let got: Vec<_> = events.iter().map(|e| (e.t, e.y, e.x)).collect();
        assert_eq!(got, [(10, 3, 4), (10, 3, 7), (12, 3, 1), (13, 5, 0)]);
    }

    proptest! {
        #[test]
        fn every_event_leaves_once_in_order_and_not_before_it_came(requests in requests(), rate in 1e4f64..1e8, row_us in 0.0f64..20.0, latency_us in 0.0f64..50.0, jitter_us in 0.0f64..20.0, cut in 0i64..300) {
            let parameters = ReadoutParameters { events_per_s: rate, row_us, latency_us, jitter_us, drop_after_us: None };
            let mut whole = requests.clone();
            let mut bus = readout(parameters);
            bus.pass(&mut whole, 300);
            prop_assert!(whole.iter().all(|event| event.t <= 300));
            whole.extend(bus.flush());
            prop_assert!(whole.is_sorted_by_key(|event| (event.t, event.y, event.x)));
            let by_pixel = |events: &[Event]| {
                let mut events = events.to_vec();
                events.sort_by_key(|event| (event.y, event.x));
                events
            };
            let (before, after) = (by_pixel(&requests), by_pixel(&whole));
            prop_assert_eq!(before.len(), after.len());
            for (came, left) in before.iter().zip(&after) {
                prop_assert_eq!((came.x, came.y, came.p), (left.x, left.y, left.p));
                prop_assert!(left.t >= came.t);
            }
            // Any cut of the stream, with the state stored and restored there, gives the same.
            let (early, late) = requests.split_at(requests.partition_point(|event| event.t <= cut));
            let mut bus = readout(parameters);
            let mut parts = early.to_vec();
            bus.pass(&mut parts, cut);
            let mut bus = bus.restored(SIZE, &bus.state(), cut).unwrap();
            let mut rest = late.to_vec();
            bus.pass(&mut rest, 300);
            parts.extend(rest);
            parts.extend(bus.flush());
            prop_assert_eq!(parts, whole);
        }

        #[test]
        fn no_more_leave_than_the_bus_carries(requests in requests(), rate in 1e4f64..1e7) {
            let mut bus = readout(ReadoutParameters { events_per_s: rate, ..BUS });
            let mut events = requests.clone();
            bus.pass(&mut events, 300);
            events.extend(bus.flush());
            // From any stamp on: a burst has its stamp before it is carried, so one row's worth goes on top, and a microsecond of rounding.
            for (i, first) in events.iter().enumerate() {
                for (n, last) in (0u32..).zip(&events[i..]) {
                    let us = f64::from(u32::try_from(last.t - first.t).unwrap());
                    let burst = events.iter().filter(|e| e.t == last.t).count();
                    let allowed = (us + 1.0) * rate * 1e-6 + f64::from(u32::try_from(burst).unwrap()) + 1.0;
                    prop_assert!(f64::from(n) <= allowed, "{n} events in {us} us");
                }
            }
        }

        #[test]
        fn no_more_bursts_leave_than_rows_can_be_addressed(requests in requests(), row_us in 0.1f64..20.0) {
            let mut bus = readout(ReadoutParameters { events_per_s: f64::INFINITY, row_us, ..BUS });
            let mut events = requests.clone();
            bus.pass(&mut events, 300);
            events.extend(bus.flush());
            // Rows of one stamp that lie within one window; a stamp is rounded up.
            let mut bursts: Vec<(i64, u16)> = events.iter().map(|e| (e.t, e.y)).collect();
            bursts.dedup();
            for (i, first) in bursts.iter().enumerate() {
                for (n, last) in (0u32..).zip(&bursts[i..]) {
                    let us = f64::from(u32::try_from(last.0 - first.0).unwrap());
                    prop_assert!(f64::from(n) * row_us <= us + 1.0, "{n} bursts in {us} us");
                }
            }
        }

        #[test]
        fn what_waits_too_long_is_dropped_and_counted(requests in requests(), wait in 0.0f64..100.0) {
            let mut bus = readout(ReadoutParameters { events_per_s: 1e5, drop_after_us: Some(wait), ..BUS });
            let mut events = requests.clone();
            bus.pass(&mut events, 300);
            events.extend(bus.flush());
            prop_assert_eq!(events.len() as u64 + bus.dropped(), requests.len() as u64);
        }
    }

    #[test]
    fn a_neutral_bus_changes_nothing() {
        let mut bus = readout(ReadoutParameters { events_per_s: f64::INFINITY, ..BUS });
        let came: Vec<Event> = (0..100u16).map(|i| Event::new(i64::from(i / 7), i % 16, i % 8, i % 3 == 0)).collect();
        let mut came = came;
        in_order(&mut came);
        let mut left = came.clone();
        bus.pass(&mut left, 100);
        assert_eq!(left, came);
    }
}
