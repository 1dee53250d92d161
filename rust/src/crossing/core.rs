//! The pixels of a sensor as arrays, cut into bands for threads, and how a frame passes through them.
//!
//! What every frame touches lies in arrays of its own: samples and marks. What only an event touches is together in a
//! record. There are several bands for each thread, because some bands have many more events than others.
//!
//! A push works on copies where it can: the new frame goes into `next`. [`Pixels::settle`] then makes it the last one.
//! If the push stops before its end, [`Pixels::undo`] puts back what its events changed.
//!
//! What must not break:
//! - The cut into bands changes no event. Bands begin at whole tiles.
//! - After [`Pixels::undo`], the state is that before the push.

use std::collections::TryReserveError;

use rayon::prelude::*;

use super::band::{Band, BandSlice, Interval};
use super::band_events::{BandEvents, LONG};
use super::buffer::{Allowance, Stop, Tally};
use super::cubic::Cubic;
use super::frame::Frame;
use super::level::Level;
use super::line::Line;
use super::marks::Marking;
use super::parameters::CrossingParameters;
use super::record::{NEVER, Narrow, Record, Wide};
use super::sample::{DarkLevel, Sample};
use super::scan::TILE;
use super::state::EngineState;
use crate::event::{Event, SensorSize};
use crate::huge_pages;
use crate::order::TimeSort;

/// The pixels of a sensor: a push runs them over a frame, and then keeps what it found, or undoes it.
pub(crate) trait Pixels<S> {
    /// Runs every pixel over one checked frame, within an allowance of events: then [`Self::settle`], or [`Self::undo`].
    fn advance(&mut self, push: &Push<'_, S>, allowance: Allowance) -> Result<(), Stop>;

    /// The number of events of the last frame.
    fn event_count(&self) -> u64;

    /// Puts the events of the last frame into `events`, sorted by time.
    fn sort(&self, push: &Push<'_, S>, sort: &mut TimeSort, events: &mut Vec<Event>) -> Result<(), TryReserveError>;

    /// Keeps what [`Self::advance`] has found.
    fn settle(&mut self, push: &Push<'_, S>);

    /// Goes back to before [`Self::advance`].
    fn undo(&mut self, push: &Push<'_, S>);

    /// About how many events the frame makes.
    fn count(&self, push: &Push<'_, S>) -> u64;
}

/// A checked frame, and what else pixels need.
pub(crate) struct Push<'a, S> {
    pub(crate) frame: Frame<'a, S>,
    pub(crate) at: Interval,
    pub(crate) size: SensorSize,
    pub(crate) p: &'a CrossingParameters,
    pub(crate) pool: Option<&'a rayon::ThreadPool>,
}

/// State of 28 bytes a pixel for luma, 36 for log intensity (rates of change take 4 or 8 more).
pub(crate) struct Core<S> {
    last: Vec<S>,
    /// The frame that a push brings, until it is done and this becomes `last`.
    next: Vec<S>,
    marks: Vec<f32>,
    marking: Marking,
    /// Empty where interpolation is linear.
    rates: Vec<S>,
    records: Records,
    /// The zero of the records' times: before all events.
    zero_us: i64,
    bands: Vec<Band<S>>,
}

/// The records of all pixels.
enum Records {
    Narrow(Kept<Narrow>),
    Wide(Kept<Wide>),
}

/// The records of all pixels, and each band's events of the last frame.
struct Kept<R: Record> {
    records: Vec<R>,
    events: Vec<BandEvents<R>>,
}

impl<R: Record> Kept<R> {
    fn new(records: Vec<R>, bands: usize) -> Self {
        Self { records, events: (0..bands).map(|_| BandEvents::default()).collect() }
    }

    fn levels(&self) -> Vec<Level> {
        self.records.iter().map(|record| record.level()).collect()
    }

    /// The marks of all pixels, a tile at a time: an array of all levels would be as large as the records.
    fn marks<S: Sample>(&self, dark_level: DarkLevel, p: &CrossingParameters, marks: &mut [f32]) {
        let mut values = [0.0; TILE];
        for (tile, (records, marks)) in self.records.chunks(TILE).zip(marks.chunks_mut(TILE)).enumerate() {
            for (j, (value, record)) in values.iter_mut().zip(records).enumerate() {
                *value = record.level().value(p.thresholds(tile * TILE + j));
            }
            S::marks(&values[..records.len()], dark_level, marks);
        }
    }

    fn last_event_us(&self, zero_us: i64) -> Vec<i64> {
        self.records.iter().map(|record| record.last_event_us(zero_us)).collect()
    }

    fn event_count(&self) -> u64 {
        self.events.iter().map(|events| events.count() as u64).sum()
    }

    fn sort(&self, at: Interval, sort: &mut TimeSort, events: &mut Vec<Event>) -> Result<(), TryReserveError> {
        if at.ticks >= LONG {
            sort.sort(self.events.iter().map(BandEvents::long), at.start_us, at.ticks, events)
        } else {
            sort.sort(self.events.iter().map(BandEvents::keys), at.start_us, at.ticks, events)
        }
    }

    fn undo(&mut self, size: SensorSize) {
        let length = band_length(self.records.len(), self.events.len());
        for (i, (records, events)) in self.records.chunks_mut(length).zip(&mut self.events).enumerate() {
            events.undo(records, i * length, size);
        }
    }
}

/// Bands for each thread, so that one with many events does not keep the others waiting.
const BANDS_PER_THREAD: usize = 4;

/// How many pixels each of these bands has, but for the last ones.
fn band_length(pixels: usize, bands: usize) -> usize {
    pixels.div_ceil(bands).next_multiple_of(TILE)
}

impl<S: Sample> Core<S> {
    /// Takes the first frame, at which references begin.
    pub(crate) fn new(
        frame: &Frame<'_, S>,
        p: &CrossingParameters,
        seed: u64,
        pool: Option<&rayon::ThreadPool>,
    ) -> Self {
        let (first, zero_us) = (frame.samples, frame.t_us - 1);
        let mut buffer = vec![0.0; first.len()];
        S::take_logs(first, p.log_eps, &mut buffer);
        let logs = S::logs_of(first, &buffer);
        let bands = pool.map_or(1, |pool| BANDS_PER_THREAD * pool.current_num_threads());
        let levels = logs.iter().enumerate().map(|(i, &log)| p.first_reference(log, i, seed));
        let mut last = huge_pages::with_capacity(first.len());
        last.extend_from_slice(first);
        let mut core = Self {
            last,
            next: huge_pages::filled(S::default(), first.len()),
            marks: huge_pages::filled(0.0, first.len()),
            marking: Marking::new::<S>(p, first.len()),
            rates: frame.rate.map_or(vec![], <[S]>::to_vec),
            records: records(levels.map(|level| (level, NEVER)), zero_us, bands),
            zero_us,
            bands: (0..bands).map(|_| Band::new(p)).collect(),
        };
        core.reset_marks(p);
        core
    }

    /// Takes up stored counters and times, the last frame being that of the state.
    pub(crate) fn restore(&mut self, state: &EngineState) {
        let level = |i: usize| Level { base: state.base[i], on: state.on[i], off: state.off[i] };
        let stored = (0..state.base.len()).map(|i| (level(i), state.last_event_us[i]));
        let earliest = state.last_event_us.iter().copied().filter(|&t_us| t_us >= 0).min();
        self.zero_us = earliest.map_or(self.zero_us, |earliest| self.zero_us.min(earliest - 1));
        self.records = records(stored, self.zero_us, self.bands.len());
        self.reset_marks(&state.parameters);
    }

    pub(crate) fn last(&self) -> &[S] {
        &self.last
    }

    pub(crate) fn rates(&self) -> &[S] {
        &self.rates
    }

    pub(crate) fn levels(&self) -> Vec<Level> {
        match &self.records {
            Records::Narrow(kept) => kept.levels(),
            Records::Wide(kept) => kept.levels(),
        }
    }

    /// The time of each pixel's last event in microseconds, or [`NEVER`].
    pub(crate) fn last_event_us(&self) -> Vec<i64> {
        match &self.records {
            Records::Narrow(kept) => kept.last_event_us(self.zero_us),
            Records::Wide(kept) => kept.last_event_us(self.zero_us),
        }
    }

    /// Computes the marks of all pixels afresh.
    fn reset_marks(&mut self, p: &CrossingParameters) {
        let Self { marks, marking, records, .. } = self;
        match records {
            Records::Narrow(kept) => kept.marks::<S>(marking.dark_level(), p, marks),
            Records::Wide(kept) => kept.marks::<S>(marking.dark_level(), p, marks),
        }
    }

    /// Changes to records that hold all that there may be.
    #[cold]
    fn widen(&mut self) {
        let stored = self.levels().into_iter().zip(self.last_event_us());
        self.records = Records::Wide(wide(stored, self.bands.len()));
    }

    fn run(&mut self, push: &Push<'_, S>, allowance: Allowance) -> Result<(), Stop> {
        let Self { last, next, marks, marking, rates, records, zero_us, bands } = self;
        let pixels = Run { last, next, marks, marking, rates, zero_us: *zero_us, bands };
        match records {
            Records::Narrow(kept) => pixels.advance(kept, push, allowance),
            Records::Wide(kept) => pixels.advance(kept, push, allowance),
        }
    }
}

/// Records of these levels and times of last events: narrow ones if they hold them all.
fn records(stored: impl ExactSizeIterator<Item = (Level, i64)> + Clone, zero_us: i64, bands: usize) -> Records {
    let mut narrow = huge_pages::with_capacity(stored.len());
    for (level, last_event_us) in stored.clone() {
        let Some(record) = Narrow::new(level, last_event_us, zero_us) else {
            return Records::Wide(wide(stored, bands));
        };
        narrow.push(record);
    }
    Records::Narrow(Kept::new(narrow, bands))
}

fn wide(stored: impl Iterator<Item = (Level, i64)>, bands: usize) -> Kept<Wide> {
    Kept::new(stored.map(|(level, last_event_us)| Wide::of(level, last_event_us)).collect(), bands)
}

/// All but the records of a [`Core`] in a push.
struct Run<'a, S> {
    last: &'a [S],
    next: &'a mut [S],
    marks: &'a mut [f32],
    marking: &'a Marking,
    rates: &'a [S],
    zero_us: i64,
    bands: &'a mut [Band<S>],
}

impl<S: Sample> Run<'_, S> {
    fn advance<R: Record>(self, kept: &mut Kept<R>, push: &Push<'_, S>, allowance: Allowance) -> Result<(), Stop> {
        let Push { frame, at, size, p, pool } = *push;
        let Self { last, next, marks, marking, rates: before, zero_us, bands } = self;
        let Kept { records, events } = kept;
        let rates_at =
            |start: usize, n: usize| frame.rate.map(|now| (&before[start..start + n], &now[start..start + n]));
        let length = band_length(frame.samples.len(), bands.len());
        let run = |(i, (((records, events), marks), ((last, next), (new, band))))| {
            let (band, new): (&mut Band<S>, &[S]) = (band, new);
            let first_pixel = i * length;
            let pixels = first_pixel..first_pixel + new.len();
            let slice = BandSlice {
                first_pixel,
                records,
                zero_us,
                events,
                last,
                next,
                marks,
                marking: marking.of(pixels.clone()),
                new,
                rates: rates_at(first_pixel, new.len()),
                sparse: frame.sparse.of(pixels.start, pixels.end),
            };
            band.advance(slice, at, size, p, allowance)
        };
        // Every band begins, also where another one has stopped: what it holds is then of this frame.
        match pool {
            None => {
                let state = records.chunks_mut(length).zip(events).zip(marks.chunks_mut(length));
                let samples = last.chunks(length).zip(next.chunks_mut(length));
                let new = frame.samples.chunks(length).zip(bands);
                state.zip(samples.zip(new)).enumerate().map(run).fold(Ok(()), Stop::both)
            }
            Some(pool) => pool.install(|| {
                let state = records.par_chunks_mut(length).zip(events).zip(marks.par_chunks_mut(length));
                let samples = last.par_chunks(length).zip(next.par_chunks_mut(length));
                let new = frame.samples.par_chunks(length).zip(bands);
                state.zip(samples.zip(new)).enumerate().map(run).reduce(|| Ok(()), Stop::both)
            }),
        }
    }
}

impl<S: Sample> Pixels<S> for Core<S> {
    fn advance(&mut self, push: &Push<'_, S>, allowance: Allowance) -> Result<(), Stop> {
        let fits = push.at.ticks < LONG && push.frame.t_us.saturating_sub(self.zero_us) <= u32::MAX.into();
        if !fits && matches!(self.records, Records::Narrow(_)) {
            self.widen();
        }
        let outcome = self.run(push, allowance);
        if outcome != Err(Stop::Narrow) {
            return outcome;
        }
        self.undo(push);
        self.widen();
        self.run(push, allowance)
    }

    fn event_count(&self) -> u64 {
        match &self.records {
            Records::Narrow(kept) => kept.event_count(),
            Records::Wide(kept) => kept.event_count(),
        }
    }

    fn sort(&self, push: &Push<'_, S>, sort: &mut TimeSort, events: &mut Vec<Event>) -> Result<(), TryReserveError> {
        match &self.records {
            Records::Narrow(kept) => kept.sort(push.at, sort, events),
            Records::Wide(kept) => kept.sort(push.at, sort, events),
        }
    }

    fn settle(&mut self, push: &Push<'_, S>) {
        std::mem::swap(&mut self.last, &mut self.next);
        if let Some(now) = push.frame.rate {
            self.rates.copy_from_slice(now);
        }
    }

    #[cold]
    fn undo(&mut self, push: &Push<'_, S>) {
        match &mut self.records {
            Records::Narrow(kept) => kept.undo(push.size),
            Records::Wide(kept) => kept.undo(push.size),
        }
        self.reset_marks(push.p);
    }

    #[cold]
    fn count(&self, push: &Push<'_, S>) -> u64 {
        let Push { frame, at, p, .. } = *push;
        #[allow(clippy::cast_precision_loss, reason = "ticks < 2^53")]
        let seconds = at.ticks as f64 * 1e-6;
        let log = |sample: S| {
            let mut log = [0.0];
            S::logs(&[sample], p.log_eps, &mut log);
            log[0]
        };
        let count = |(i, reference): (usize, Level)| {
            let (from, to, c) = (self.last[i], frame.samples[i], p.thresholds(i));
            let (line, mut tally) = (Line { from: log(from), to: log(to), ticks: at.ticks }, Tally::new(reference, c));
            let sparse = frame.sparse.of(i, i + 1);
            match frame.rate {
                Some(rates) if sparse.is_empty() => {
                    let slope = |sample: S, rate| sample.log_rate(rate, p.log_eps) * seconds;
                    tally.follow(&Cubic::new(line, slope(from, self.rates[i]), slope(to, rates[i])), c);
                }
                _ => {
                    for &sample in sparse.samples {
                        tally.follow(&Line { to: log(sample), ..line }, c);
                    }
                    tally.follow(&line, c);
                }
            }
            tally.events()
        };
        self.levels().into_iter().enumerate().map(count).fold(0, u64::saturating_add)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::crossing::engine::CrossingEngine;

    const SIZE: SensorSize = SensorSize { width: 4, height: 1 };

    /// Does an engine that goes on from these times of last events and counters keep narrow records?
    fn is_narrow(last_event_us: [i64; 4], on: u32) -> bool {
        let parameters = CrossingParameters::default();
        let mut engine = CrossingEngine::new(SIZE, parameters.clone(), Some(1)).unwrap();
        let frame = Frame::new(5_000_000_000, &[0.0; 4][..]);
        engine.push_log(frame, &mut vec![]).unwrap();
        let state = EngineState { last_event_us: last_event_us.to_vec(), on: vec![0, 0, on, 0], ..engine.state() };
        let mut core = Core::new(&frame, &parameters, 0, None);
        core.restore(&state);
        assert_eq!((core.last_event_us(), core.levels()[2].on), (last_event_us.to_vec(), on));
        matches!(core.records, Records::Narrow(_))
    }

    /// What fits into narrow records stays in them: first events just before the last frame, or long ago.
    #[test]
    fn a_restored_engine_keeps_narrow_records_where_they_suffice() {
        assert!(is_narrow([NEVER; 4], 65_535));
        assert!(is_narrow([5_000_000_000, NEVER, 4_999_999_999, NEVER], 1));
        assert!(is_narrow([5_000_000_000, NEVER, 4_999_999_999, 5_000_000_000 - (1 << 32) + 2], 1));
        assert!(!is_narrow([5_000_000_000, NEVER, 4_999_999_999, 5_000_000_000 - (1 << 32)], 1));
        assert!(!is_narrow([0, NEVER, NEVER, 5_000_000_000], 1));
        assert!(!is_narrow([NEVER; 4], 65_536));
        // No engine says so; a state may.
        assert!(!is_narrow([NEVER, -7, NEVER, NEVER], 1));
    }
}
