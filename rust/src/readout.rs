//! The readout bus (the effect `readout`): events wait for a shared bus, which reads them out row by row.
//!
//! A pixel that fires only requests its row. The bus grants one row after the other and carries a limited number of
//! events a second, so a burst of events leaves late and with few distinct stamps. (The frames of the active pixels
//! have a readout of their own, which is in `aer::frame_assembler`.) On some chips, such as the DAVIS346, rows of the
//! bus are columns of the image; here a line is a row of the bus.
//!
//! A pixel's reset waits for the bus: from its request until its event is read out, and for the refractory period after
//! that, it cannot make another one. What reaches a level meanwhile is no event, and is counted as missed.
//!
//! What must not break: every event leaves once or is counted as dropped or missed, stamps never decrease, events leave
//! burst by burst, and the result does not depend on how the stream is split into calls.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};

use crate::error::{Error, Result};
use crate::event::{Event, SensorSize};
use crate::random::{Draw, Purpose};

/// The parameters of a row-wise arbiter (address-event representation).
///
/// Pixels ask for their row. The bus grants the row whose oldest request came first, and reads all of its requests in
/// one burst: one stamp, the row's address, then a column a turn, upwards. Requests come in whole microseconds; when
/// within its own a row asks is drawn. A stamp is the last whole microsecond before its time, as of a clock that runs by
/// itself. Source: Brandli, Berner, Yang, Liu and Delbruck, "A 240 x 180 130 dB 3 us latency global shutter
/// spatiotemporal vision sensor", IEEE JSSC 49(10), 2014 (word-serial burst mode).
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
    /// Whether rows of the bus are columns of the image.
    pub by_columns: bool,
}

impl ReadoutParameters {
    /// Returns whether events leave as they come.
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

/// The furthest that stamps can lie ahead of the last frame: latency, jitter and a whole row at one event a second are
/// less.
const LONGEST_AHEAD_US: i64 = 1 << 50;

/// What a readout still holds, as plain data to be stored.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReadoutState {
    /// The time of the first frame.
    pub started_us: i64,
    /// Requests that were not granted yet, in the order of their coming.
    pub waiting: Vec<Event>,
    /// Events that were read, with stamps that lie ahead.
    pub stamped: Vec<Event>,
    /// When the bus falls free: whole microseconds, and a fraction of the next.
    pub free_us: i64,
    /// See `free_us`.
    pub free_share: f64,
    /// The last stamp given.
    pub last_stamp_us: i64,
    /// Bursts so far.
    pub bursts: u64,
    /// Events dropped so far.
    pub dropped: u64,
    /// Events missed so far.
    pub missed: u64,
    /// When each pixel can ask again, row by row; [`i64::MAX`] while its event waits.
    pub ready_us: Vec<i64>,
}

/// Of a pixel whose event waits: when it can ask again is not known.
const WAITING: i64 = i64::MAX;

/// The bus, with the events that wait for it.
pub(crate) struct Readout {
    size: SensorSize,
    parameters: ReadoutParameters,
    seed: u64,
    /// Microseconds from a pixel's stamp to its next request, at least.
    reset_us: i64,
    /// The time of the first frame: draws are named by the time since then.
    started_us: Option<i64>,
    ready_us: Vec<i64>,
    lines: Vec<VecDeque<Event>>,
    /// Lines with requests, by their oldest one: (whole microseconds, bits of the fraction, line). Positive floats have
    /// the order of their bits.
    requests: BinaryHeap<Reverse<(i64, u64, u16)>>,
    stamped: VecDeque<Event>,
    free_us: i64,
    free_share: f64,
    last_stamp_us: i64,
    bursts: u64,
    dropped: u64,
    missed: u64,
}

impl Readout {
    /// Returns a bus that nothing waits for, of pixels that are held in reset for `refractory_us`.
    #[allow(clippy::cast_possible_truncation, reason = "periods are at most 1e15 us")]
    pub(crate) fn new(size: SensorSize, parameters: ReadoutParameters, seed: u64, refractory_us: f64) -> Self {
        Self {
            size,
            parameters,
            seed,
            reset_us: refractory_us.max(1.0).ceil() as i64,
            started_us: None,
            ready_us: vec![0; size.pixels()],
            lines: vec![VecDeque::new(); usize::from(if parameters.by_columns { size.width } else { size.height })],
            requests: BinaryHeap::new(),
            stamped: VecDeque::new(),
            free_us: 0,
            free_share: 0.0,
            last_stamp_us: 0,
            bursts: 0,
            dropped: 0,
            missed: 0,
        }
    }

    /// Takes up a state at `t_us`, where nothing has waited yet.
    pub(crate) fn restore(&mut self, state: &ReadoutState, t_us: i64) -> Result<()> {
        let size = self.size;
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
        if !(0..=t_us).contains(&state.started_us) {
            return rule("must have begun by then");
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
        let ready = |us: &i64| *us == WAITING || (0..=latest_us.saturating_add(self.reset_us)).contains(us);
        if state.ready_us.len() != size.pixels() || !state.ready_us.iter().all(ready) {
            return rule("must have a time near then for each pixel, at which it can ask again");
        }
        let waits = |event: &Event| state.ready_us[event.pixel(size)] == WAITING;
        let waiting = state.ready_us.iter().filter(|us| **us == WAITING).count();
        if waiting != state.waiting.len() || !state.waiting.iter().all(waits) {
            return rule("must have one waiting event of each pixel that waits");
        }
        self.started_us = Some(state.started_us);
        self.ready_us.clone_from(&state.ready_us);
        self.stamped = state.stamped.iter().copied().collect();
        (self.free_us, self.free_share, self.last_stamp_us) = (state.free_us, state.free_share, state.last_stamp_us);
        (self.bursts, self.dropped, self.missed) = (state.bursts, state.dropped, state.missed);
        state.waiting.iter().for_each(|&event| self.request(event));
        Ok(())
    }

    pub(crate) fn dropped(&self) -> u64 {
        self.dropped
    }

    pub(crate) fn missed(&self) -> u64 {
        self.missed
    }

    pub(crate) fn state(&self) -> ReadoutState {
        let mut waiting: Vec<Event> = self.lines.iter().flatten().copied().collect();
        waiting.sort_by_key(|event| event.t);
        ReadoutState {
            started_us: self.started_us.unwrap_or(0),
            waiting,
            stamped: self.stamped.iter().copied().collect(),
            free_us: self.free_us,
            free_share: self.free_share,
            last_stamp_us: self.last_stamp_us,
            bursts: self.bursts,
            dropped: self.dropped,
            missed: self.missed,
            ready_us: self.ready_us.clone(),
        }
    }

    /// Takes the events until `until_us`, and turns them into those that have left by then.
    ///
    /// `events` are sorted by time before, and after in the order of the bus; no later call gives stamps up to
    /// `until_us`. The first call is that of the first frame, which has none.
    pub(crate) fn pass(&mut self, events: &mut Vec<Event>, until_us: i64) {
        self.started_us.get_or_insert(until_us);
        for &event in events.iter() {
            self.grant(event.t - 1); // which decides whether its pixel can ask
            self.ask(event);
        }
        events.clear();
        self.grant(until_us);
        let leaving = self.stamped.partition_point(|event| event.t <= until_us);
        events.extend(self.stamped.drain(..leaving));
    }

    /// Returns everything that is left.
    pub(crate) fn flush(&mut self) -> Vec<Event> {
        self.grant(i64::MAX);
        self.stamped.drain(..).collect()
    }

    /// Takes an event whose pixel can ask; one of another pixel is missed.
    fn ask(&mut self, event: Event) {
        let ready_us = &mut self.ready_us[event.pixel(self.size)];
        if event.t < *ready_us {
            self.missed += 1;
            return;
        }
        *ready_us = WAITING;
        self.request(event);
    }

    fn request(&mut self, event: Event) {
        let line = if self.parameters.by_columns { event.x } else { event.y };
        let queue = &mut self.lines[usize::from(line)];
        queue.push_back(event);
        if queue.len() == 1 {
            self.ask_for(line, event.t);
        }
    }

    /// Asks for a line in a microsecond.
    fn ask_for(&mut self, line: u16, t_us: i64) {
        let share = within(self.seed, line, t_us - self.started_us.unwrap_or(0));
        self.requests.push(Reverse((t_us, share.to_bits(), line)));
    }

    /// Reads out all lines that are granted until a time.
    #[allow(clippy::cast_precision_loss, reason = "waits and bursts are far below 2^53")]
    #[allow(clippy::cast_possible_truncation, reason = "waits and bursts are far below 2^53")]
    fn grant(&mut self, until_us: i64) {
        let us_per_event = 1e6 / self.parameters.events_per_s;
        let started_us = self.started_us.unwrap_or(0);
        while let Some(&Reverse((asked_us, asked_share, line))) = self.requests.peek() {
            // Whole microseconds apart from their fraction: a float of both loses the fraction in a long time.
            let (asked, free) = ((asked_us, f64::from_bits(asked_share)), (self.free_us, self.free_share));
            let (now_us, fraction) = if asked > free { asked } else { free };
            if now_us > until_us {
                return;
            }
            self.requests.pop();
            let queue = &mut self.lines[usize::from(line)];
            let waiting = queue.partition_point(|event| event.t <= now_us);
            let share = |event: &Event| within(self.seed, line, event.t - started_us);
            let waited_us = |event: &Event| (now_us - event.t) as f64 + fraction - share(event);
            let late =
                self.parameters.drop_after_us.map_or(0, |us| queue.partition_point(|event| waited_us(event) > us));
            for event in queue.drain(..late) {
                self.ready_us[event.pixel(self.size)] = now_us.saturating_add(self.reset_us);
            }
            self.dropped += late as u64;
            let burst = waiting - late;
            if burst > 0 {
                let delay_us = fraction + delay(&self.parameters, self.seed, line, self.bursts);
                let stamp_us = (now_us + delay_us.floor() as i64).max(self.last_stamp_us);
                let first = self.stamped.len();
                for event in queue.drain(..burst) {
                    self.ready_us[event.pixel(self.size)] = stamp_us.saturating_add(self.reset_us);
                    self.stamped.push_back(event.at(stamp_us));
                }
                let by_columns = self.parameters.by_columns;
                self.stamped.make_contiguous()[first..].sort_by_key(|e| if by_columns { e.y } else { e.x });
                self.last_stamp_us = stamp_us;
                self.bursts += 1;
                let free = fraction + self.parameters.row_us + burst as f64 * us_per_event;
                (self.free_us, self.free_share) = (now_us + free.floor() as i64, free.fract());
            }
            if let Some(t_us) = queue.front().map(|next| next.t) {
                self.ask_for(line, t_us);
            }
        }
    }
}

/// Returns when within a microsecond a line asks, 0..1. `since_us` is the time since the first frame.
#[allow(clippy::cast_sign_loss, reason = "any number names a draw")]
fn within(seed: u64, line: u16, since_us: i64) -> f64 {
    Draw::at(seed, Purpose::ReadoutRequest, line.into(), since_us as u64).uniform()
}

/// Returns the time from a burst's grant to its stamp, in microseconds. It is never negative, whatever the jitter is.
fn delay(p: &ReadoutParameters, seed: u64, line: u16, burst: u64) -> f64 {
    let jitter_us = if p.jitter_us > 0.0 {
        p.jitter_us * Draw::at(seed, Purpose::ReadoutJitter, line.into(), burst).normal()
    } else {
        0.0
    };
    (p.latency_us + jitter_us).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SIZE: SensorSize = SensorSize { width: 16, height: 8 };
    const BUS: ReadoutParameters = ReadoutParameters {
        events_per_s: 1e6,
        row_us: 0.0,
        latency_us: 0.0,
        jitter_us: 0.0,
        drop_after_us: None,
        by_columns: false,
    };

    fn readout(parameters: ReadoutParameters) -> Readout {
        begun(Readout::new(SIZE, parameters, 1, 0.0))
    }

    /// A bus that has seen the first frame, at 0.
    fn begun(mut bus: Readout) -> Readout {
        bus.pass(&mut vec![], 0);
        bus
    }

    fn requests() -> impl Strategy<Value = Vec<Event>> {
        // Half of them of a few pixels, which ask again and again.
        let pixel = prop_oneof![(0u16..8, 0u16..16), (2u16..4, 5u16..7)];
        prop::collection::vec((0i64..300, pixel, any::<bool>()), 0..200).prop_map(|events| {
            let mut events: Vec<Event> = events.into_iter().map(|(t, (y, x), on)| Event::new(t, x, y, on)).collect();
            events.sort_by_key(raster);
            events
        })
    }

    /// The order in which events come.
    fn raster(event: &Event) -> (i64, u16, u16) {
        (event.t, event.y, event.x)
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

    /// The same events with x and y exchanged, on a bus by columns: the same stamps, and the same order.
    #[test]
    fn a_column_is_a_row_of_a_bus_by_columns() {
        const SQUARE: SensorSize = SensorSize { width: 16, height: 16 };
        let bus = |by_columns| begun(Readout::new(SQUARE, ReadoutParameters { by_columns, ..BUS }, 1, 0.0));
        let events: Vec<Event> =
            (0..200u16).map(|i| Event::new(i64::from(i / 9), i * 5 % 16, i * 3 % 16, true)).collect();
        let mut by_rows = events.clone();
        by_rows.sort_by_key(raster);
        let turned = |event: &Event| Event::new(event.t, event.y, event.x, event.p == 1);
        let mut by_columns: Vec<Event> = events.iter().map(turned).collect();
        by_columns.sort_by_key(raster);
        bus(false).pass(&mut by_rows, 1000);
        bus(true).pass(&mut by_columns, 1000);
        assert_eq!(by_rows.iter().map(turned).collect::<Vec<_>>(), by_columns);
    }

    proptest! {
        #[test]
        fn every_event_leaves_once_in_order_or_is_missed(requests in requests(), rate in 1e4f64..1e8, row_us in 0.0f64..20.0, latency_us in 0.0f64..50.0, jitter_us in 0.0f64..20.0, by_columns: bool, refractory_us in 0.0f64..9.0, cut in 0i64..300) {
            let parameters = ReadoutParameters { events_per_s: rate, row_us, latency_us, jitter_us, drop_after_us: None, by_columns };
            let readout = || begun(Readout::new(SIZE, parameters, 1, refractory_us));
            let mut whole = requests.clone();
            let mut bus = readout();
            bus.pass(&mut whole, 300);
            prop_assert!(whole.iter().all(|event| event.t <= 300));
            whole.extend(bus.flush());
            prop_assert!(whole.is_sorted_by_key(|event| event.t));
            prop_assert_eq!(requests.len() as u64, whole.len() as u64 + bus.missed());
            // Of each pixel: the first request that comes when it can ask, and then the first after its reset.
            #[allow(clippy::cast_possible_truncation, reason = "small")]
            let reset_us = refractory_us.max(1.0).ceil() as i64;
            let pixels: std::collections::BTreeSet<_> = requests.iter().map(|event| (event.x, event.y)).collect();
            for pixel in pixels {
                let own = |events: &[Event]| events.iter().filter(|event| (event.x, event.y) == pixel).copied().collect::<Vec<_>>();
                let (mut came, mut ready_us) = (own(&requests).into_iter(), 0);
                for left in own(&whole) {
                    let asked = came.find(|event| event.t >= ready_us).unwrap();
                    prop_assert!(asked.p == left.p && asked.t <= left.t);
                    ready_us = left.t + reset_us;
                }
                prop_assert!(came.all(|event| event.t < ready_us));
            }
            // Any cut of the stream, with the state stored and restored there, gives the same.
            let (early, late) = requests.split_at(requests.partition_point(|event| event.t <= cut));
            let mut bus = readout();
            let mut parts = early.to_vec();
            bus.pass(&mut parts, cut);
            let state = bus.state();
            let mut bus = readout();
            bus.restore(&state, cut).unwrap();
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
            // From any stamp on: a burst has its stamp before it is carried, so one row's worth goes on top, and a
            // microsecond of rounding.
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
            prop_assert_eq!(events.len() as u64 + bus.dropped() + bus.missed(), requests.len() as u64);
        }
    }

    #[test]
    fn a_neutral_bus_delays_nothing() {
        let mut bus = readout(ReadoutParameters { events_per_s: f64::INFINITY, ..BUS });
        let came: Vec<Event> = (0..100u16).map(|i| Event::new(i64::from(i / 7), i % 16, i % 8, i % 3 == 0)).collect();
        let mut came = came;
        came.sort_by_key(raster);
        let mut left = came.clone();
        bus.pass(&mut left, 100);
        left.sort_by_key(raster); // the bus is without an order of rows
        assert_eq!(left, came);
    }
}
