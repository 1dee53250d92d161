//! A band of rows: runs its pixels through the scan, the candidates and the exact rule.
//!
//! A thread takes one band at a time. A band keeps its buffers from frame to frame, because allocating them for each
//! frame would cost more than a quiet frame does. Candidates are decided in batches that fit into the first-level
//! cache.
//!
//! Pixels with sparse samples always take the exact rule, because no single curve describes their interval.
//!
//! What must not break:
//! - Events leave in raster order and, within a pixel, in the order of crossing. The sort by time is stable and relies
//!   on it.
//! - Whenever a pixel's reference moves, its mark is set again. A mark that is out of date would hide events.
//! - Candidates are checked before they are decided, because bad values have no log intensity.
//! - Times of last events are written to the state one frame late. Until then the events themselves hold them, so that
//!   a push can be undone.

use super::candidates::Candidates;
use super::cubic::Cubic;
use super::decision::Verdict;
use super::frame::SparseSamples;
use super::level::Level;
use super::line::Line;
use super::marks::{MarkingPart, mark};
use super::parameters::CrossingParameters;
use super::pixel::follow;
use super::prefetch::prefetch;
use super::room::{Allowance, Full, Room, Stop, most_events};
use super::sample::Sample;
use super::scan::{Found, MOST_FOUND, TILE, Tile};
use crate::event::{Event, SensorSize};

/// The interval that a frame ends.
#[derive(Clone, Copy)]
pub(crate) struct Interval {
    pub(crate) start_us: i64,
    pub(crate) ticks: i64,
}

/// A band's share of the engine's state and of the new frame.
pub(crate) struct Share<'a, S> {
    pub(crate) first_pixel: usize,
    pub(crate) references: &'a mut [Level],
    pub(crate) last_event_us: &'a mut [i64],
    pub(crate) last: &'a [S],
    /// Takes the new frame, and becomes `last` once the push is done.
    pub(crate) next: &'a mut [S],
    pub(crate) marks: &'a mut [f32],
    pub(crate) marking: MarkingPart<'a>,
    pub(crate) new: &'a [S],
    /// Rates of change at the interval's start and end.
    pub(crate) rates: Option<(&'a [S], &'a [S])>,
    /// Sparse samples of these pixels, numbered as in the sensor.
    pub(crate) sparse: SparseSamples<'a, S>,
}

impl<'a, S: Sample> Share<'a, S> {
    /// The sparse samples of the pixel at a place of the share.
    fn sparse_of(&self, place: u32) -> SparseSamples<'a, S> {
        let pixel = self.first_pixel + place as usize;
        self.sparse.of(pixel, pixel + 1)
    }
}

/// Memory that a band keeps from frame to frame.
pub(crate) struct Band<S> {
    /// The events of the last frame, in raster order.
    pub(crate) events: Room,
    found: Found<S>,
    candidates: Candidates<S>,
    /// Room for the events of candidates that are clear.
    clear: Vec<Event>,
    /// Log intensity of a pixel's sparse samples.
    logs: Vec<f64>,
}

impl<S: Sample> Band<S> {
    pub(crate) fn new(p: &CrossingParameters) -> Self {
        Self {
            events: Room::default(),
            found: Found::new(),
            candidates: Candidates::new(p),
            clear: vec![Event::default(); MOST_FOUND],
            logs: Vec::new(),
        }
    }

    /// Takes the frame's share: finds the events and moves the state on.
    pub(crate) fn advance(
        &mut self,
        mut share: Share<'_, S>,
        at: Interval,
        size: SensorSize,
        p: &CrossingParameters,
        allowance: Allowance,
    ) -> Result<(), Stop> {
        for event in self.events.events() {
            share.last_event_us[event.pixel(size) - share.first_pixel] = event.t;
        }
        self.events.begin(allowance, share.new.len());
        self.found.count = 0;
        for start in (0..share.new.len()).step_by(TILE) {
            let end = (start + TILE).min(share.new.len());
            let sparse = share.sparse.of(share.first_pixel + start, share.first_pixel + end).pixel;
            let also = sparse.iter().map(|&pixel| pixel as usize - share.first_pixel - start);
            let tile = Tile {
                start,
                new: &share.new[start..end],
                last: &share.last[start..end],
                next: &mut share.next[start..end],
                marks: &share.marks[start..end],
                marking: share.marking.of(start..end),
                rates: share.rates.map(|(from, to)| (&from[start..end], &to[start..end])),
            };
            prefetch(&share.new[end..(end + TILE).min(share.new.len())]);
            self.found.scan(tile, also);
            if self.found.is_full() {
                self.decide(&mut share, at, size, p)?;
            }
        }
        self.decide(&mut share, at, size, p)
    }

    /// Decides what was found, makes its events, and moves its pixels and marks on.
    fn decide(
        &mut self,
        share: &mut Share<'_, S>,
        at: Interval,
        size: SensorSize,
        p: &CrossingParameters,
    ) -> Result<(), Stop> {
        if !S::all_valid(&self.found.to[..self.found.count]) {
            return Err(Stop::BadValue);
        }
        self.candidates.take_logs(&self.found, p.log_eps);
        self.candidates.decide(&self.found, share.references, share.rates, share.first_pixel, at.ticks, p);
        self.candidates.mark(&self.found, share.marking.ground);
        if !share.sparse.is_empty() {
            for (verdict, &place) in self.candidates.verdict.iter_mut().zip(&self.found.place[..self.found.count]) {
                if !share.sparse_of(place).is_empty() {
                    *verdict = Verdict::Unclear; // no single curve tells
                }
            }
        }
        self.carry_out(share, at, size, p)?;
        self.found.count = 0;
        Ok(())
    }

    fn carry_out(
        &mut self,
        share: &mut Share<'_, S>,
        at: Interval,
        size: SensorSize,
        p: &CrossingParameters,
    ) -> Result<(), Full> {
        let width = usize::from(size.width);
        let (mut row_start, mut y, mut made) = (0, 0, 0);
        for j in 0..self.found.count {
            let in_share = self.found.place[j] as usize;
            let index = share.first_pixel + in_share;
            // Places go up, so the row is followed instead of divided for.
            if index >= row_start + width {
                (row_start, y) = (index - index % width, index / width);
            }
            #[allow(clippy::cast_possible_truncation, reason = "within the sensor's u16 sides")]
            let (x, y) = ((index - row_start) as u16, y as u16);
            let on = match self.candidates.verdict[j] {
                Verdict::Nothing => continue,
                Verdict::Unclear => {
                    self.events.extend(&self.clear[..made])?;
                    made = 0;
                    self.follow(share, j, (x, y), at, p)?;
                    continue;
                }
                verdict => verdict == Verdict::On,
            };
            let reference = &mut share.references[in_share];
            *if on { &mut reference.on } else { &mut reference.off } += 1;
            share.marks[in_share] = self.candidates.marks[j];
            // A place in an array is cheaper than a push.
            self.clear[made] = Event::new(at.start_us + self.candidates.tick[j], x, y, on);
            made += 1;
        }
        self.events.extend(&self.clear[..made])
    }

    /// Runs one candidate through the interval exactly.
    #[cold]
    fn follow(
        &mut self,
        share: &mut Share<'_, S>,
        candidate: usize,
        (x, y): (u16, u16),
        at: Interval,
        p: &CrossingParameters,
    ) -> Result<(), Full> {
        let in_share = self.found.place[candidate] as usize;
        let sparse = share.sparse_of(self.found.place[candidate]);
        let c = p.thresholds(share.first_pixel + in_share);
        let reference = &mut share.references[in_share];
        let events = &mut self.events;
        let line = Line { from: self.candidates.from[candidate], to: self.candidates.to[candidate], ticks: at.ticks };
        let mut run = |reference: &mut Level, line: &Line, start_us| {
            events.reserve(most_events(*reference, line, c))?;
            Ok(follow(reference, line, start_us, c, |t_us, on| events.push(Event::new(t_us, x, y, on))))
        };
        let moved = match share.rates {
            _ if !sparse.is_empty() => {
                self.logs.resize(sparse.samples.len(), 0.0);
                S::logs(sparse.samples, p.log_eps, &mut self.logs);
                let (mut from, mut start_us, mut moved) = (line.from, at.start_us, false);
                let end = (at.start_us + at.ticks, line.to);
                for (t_us, to) in sparse.t_us.iter().copied().zip(self.logs.iter().copied()).chain([end]) {
                    moved |= run(reference, &Line { from, to, ticks: t_us - start_us }, start_us)?;
                    (from, start_us) = (to, t_us);
                }
                moved
            }
            None => run(reference, &line, at.start_us)?,
            Some(_) => {
                let (from, to) = (self.candidates.slope_from[candidate], self.candidates.slope_to[candidate]);
                let curve = Cubic::new(line, from, to);
                events.reserve(most_events(*reference, &curve, c))?;
                follow(reference, &curve, at.start_us, c, |t_us, on| events.push(Event::new(t_us, x, y, on)))
            }
        };
        if moved {
            share.marks[in_share] = mark::<S>(*reference, c, share.marking.ground);
        }
        Ok(())
    }
}
