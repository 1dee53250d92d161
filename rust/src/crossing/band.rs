//! A band of rows: runs its pixels through the scan, the candidates and the exact rule.
//!
//! A thread takes one band at a time. A band keeps its buffers from frame to frame, because allocating them for each
//! frame would cost more than a quiet frame does. Candidates are decided in batches that fit into the first-level
//! cache.
//!
//! Pixels with sparse samples always take the exact rule, because no single curve describes their interval. So do all
//! pixels in intervals longer than half an hour.
//!
//! What must not break:
//! - Events leave in raster order and, within a pixel, in the order of crossing. The sort by time is stable and relies
//!   on it.
//! - Whenever a pixel's reference moves, its mark is set again. A mark that is out of date would hide events.
//! - Candidates are checked before they are decided, because bad values have no log intensity.

use std::ops::Range;

use super::band_events::{BandEvents, Grid};
use super::buffer::{Allowance, Stop, most_events};
use super::candidates::Candidates;
use super::cubic::Cubic;
use super::decision::Verdict;
use super::frame::SparseSamples;
use super::line::Line;
use super::marks::{MarkingSlice, mark};
use super::parameters::CrossingParameters;
use super::pixel::follow;
use super::record::Record;
use super::registers::{LANES, Registers, Setting};
use super::sample::Sample;
use super::scan::{NotedSamples, TILE, Tile};
use crate::event::SensorSize;
use crate::prefetch::prefetch;

/// Bytes by which the frame is fetched ahead of the scan.
const AHEAD: usize = 8192;

/// With more candidates in a tile, nothing is fetched ahead: their own work takes so long that the processor does it in
/// time by itself.
const DENSE: usize = TILE / 8;

/// The interval that a frame ends.
#[derive(Clone, Copy)]
pub(crate) struct Interval {
    pub(crate) start_us: i64,
    pub(crate) ticks: i64,
}

/// A band's slice of the engine's state and of the new frame.
pub(crate) struct BandSlice<'a, S, R: Record> {
    pub(crate) first_pixel: usize,
    pub(crate) records: &'a mut [R],
    /// The zero of the records' times.
    pub(crate) zero_us: i64,
    /// Takes the events.
    pub(crate) events: &'a mut BandEvents<R>,
    pub(crate) last: &'a [S],
    /// Takes the new frame, and becomes `last` once the push is done.
    pub(crate) next: &'a mut [S],
    pub(crate) marks: &'a mut [f32],
    pub(crate) marking: MarkingSlice<'a>,
    pub(crate) new: &'a [S],
    /// Rates of change at the interval's start and end.
    pub(crate) rates: Option<(&'a [S], &'a [S])>,
    /// Sparse samples of these pixels, numbered as in the sensor.
    pub(crate) sparse: SparseSamples<'a, S>,
}

impl<'a, S: Sample, R: Record> BandSlice<'a, S, R> {
    /// Returns the sparse samples of a pixel, by its number in the band.
    fn sparse_of(&self, in_band: u32) -> SparseSamples<'a, S> {
        let pixel = self.first_pixel + in_band as usize;
        self.sparse.of(pixel, pixel + 1)
    }
}

/// Memory that a band keeps from frame to frame.
pub(crate) struct Band<S> {
    samples: NotedSamples<S>,
    candidates: Candidates<S>,
    /// Used where they can be.
    registers: Option<Registers>,
    /// Log intensity of a pixel's sparse samples.
    logs: Vec<f64>,
}

impl<S: Sample> Band<S> {
    pub(crate) fn new(p: &CrossingParameters) -> Self {
        Self {
            samples: NotedSamples::new(),
            candidates: Candidates::new(p),
            registers: Registers::find(),
            logs: Vec::new(),
        }
    }

    /// Takes the frame's slice: finds the events and moves the state on.
    pub(crate) fn advance<R: Record>(
        &mut self,
        mut slice: BandSlice<'_, S, R>,
        at: Interval,
        size: SensorSize,
        p: &CrossingParameters,
        allowance: Allowance,
    ) -> Result<(), Stop> {
        slice.events.begin(allowance, slice.new.len(), at.ticks);
        self.samples.count = 0;
        let mut is_dense = false;
        for start in (0..slice.new.len()).step_by(TILE) {
            let end = (start + TILE).min(slice.new.len());
            let sparse = slice.sparse.of(slice.first_pixel + start, slice.first_pixel + end).pixel;
            let also = sparse.iter().map(|&pixel| pixel as usize - slice.first_pixel - start);
            let mut tile = Tile {
                start,
                new: &slice.new[start..end],
                last: &slice.last[start..end],
                next: &mut slice.next[start..end],
                marks: &slice.marks[start..end],
                marking: slice.marking.of(start..end),
                rates: slice.rates.map(|(from, to)| (&from[start..end], &to[start..end])),
            };
            if !is_dense {
                let ahead = |index: usize| (index + AHEAD / size_of::<S>()).min(slice.new.len());
                prefetch(&slice.new[ahead(start)..ahead(end)]);
                for rates in slice.rates.iter().flat_map(|(from, to)| [from, to]) {
                    prefetch(&rates[ahead(start)..ahead(end)]);
                }
            }
            let before = self.samples.count;
            self.samples.scan(&mut tile, also, self.registers);
            let noted = &self.samples.pixel[before..self.samples.count];
            is_dense = noted.len() > DENSE;
            if !is_dense {
                for &pixel in noted {
                    prefetch(&slice.records[pixel as usize..=pixel as usize]);
                }
            }
            if self.samples.is_full() {
                self.decide(&mut slice, at, size, p)?;
            }
        }
        self.decide(&mut slice, at, size, p)
    }

    /// Decides what was noted, makes its events, and moves its pixels and marks on.
    fn decide<R: Record>(
        &mut self,
        slice: &mut BandSlice<'_, S, R>,
        at: Interval,
        size: SensorSize,
        p: &CrossingParameters,
    ) -> Result<(), Stop> {
        let count = self.samples.count;
        if !S::all_valid(&self.samples.to[..count]) {
            return Err(Stop::BadValue);
        }
        let ([first, .., last] | [first @ last]) = self.samples.pixel[..count] else {
            return Ok(());
        };
        let grid = Grid::new(slice.first_pixel, size);
        let [first, end] = [first, last + 1].map(|in_band| slice.first_pixel + in_band as usize);
        let sparse = slice.sparse.of(first, end);
        self.candidates.take_inputs(&self.samples, slice.first_pixel, p);
        let registers =
            self.registers.filter(|_| sparse.is_empty() && slice.rates.is_none() && !slice.events.is_long());
        if let Some(registers) = registers
            && self.carry_out_in_registers(registers, slice, (at, grid), p)?
        {
            self.samples.count = 0;
            return Ok(());
        }
        self.candidates.decide(&self.samples, slice.records, slice.rates, at.ticks, p);
        if slice.events.is_long() {
            self.candidates.verdict[..count].fill(Verdict::Unclear);
        } else {
            // No single curve tells. All of them were noted, and come in the same order.
            let mut candidates = self.samples.pixel[..count].iter().zip(&mut self.candidates.verdict);
            for pixels in sparse.pixel.chunk_by(|previous, next| previous == next) {
                let in_band = pixels[0] as usize - slice.first_pixel;
                if let Some((_, verdict)) = candidates.find(|(pixel, _)| **pixel as usize == in_band) {
                    *verdict = Verdict::Unclear;
                }
            }
        }
        let since = at.start_us - slice.zero_us;
        let outcome = self.candidates.finish::<R>(&self.samples, grid, since, slice.marking.dark_level);
        if outcome.is_full {
            return Err(Stop::Narrow);
        }
        if outcome.unclear == 0 {
            self.carry_out(slice, 0..count, outcome.events, at)?;
        } else {
            let mut next = 0;
            while next < count {
                let verdicts = &self.candidates.verdict[next..count];
                let clear = verdicts.iter().take_while(|&&verdict| verdict != Verdict::Unclear);
                let (length, nothing) = clear.fold((0, 0), |(length, nothing), &verdict| {
                    (length + 1, nothing + usize::from(verdict == Verdict::Nothing))
                });
                self.carry_out(slice, next..next + length, length - nothing, at)?;
                next += length;
                if next < count {
                    self.follow(slice, next, grid, at, p)?;
                    next += 1;
                }
            }
        }
        self.samples.count = 0;
        Ok(())
    }

    /// Does the same in registers: false if records are wide, and nothing was done.
    fn carry_out_in_registers<R: Record>(
        &mut self,
        registers: Registers,
        slice: &mut BandSlice<'_, S, R>,
        (at, grid): (Interval, Grid),
        p: &CrossingParameters,
    ) -> Result<bool, Stop> {
        #[allow(clippy::cast_precision_loss, reason = "not long")]
        let setting = Setting { ticks: at.ticks as f64, since: at.start_us - slice.zero_us, grid };
        let count = self.samples.count;
        let mut next = 0;
        while next < count {
            let room = count - next + LANES;
            slice.events.reserve(room)?;
            let (keys, old) = slice.events.spare(room);
            let state = (&mut *slice.records, keys, old);
            let Some(progress) = self.candidates.carry_out(registers, &self.samples, next, setting, state) else {
                return Ok(false);
            };
            slice.events.take(progress.events);
            let done = next..next + progress.lines;
            let marks = self.candidates.take_marks(done.clone(), slice.marking.dark_level);
            let to = &mut *slice.marks;
            for (&pixel, &mark) in self.samples.pixel[done.clone()].iter().zip(marks) {
                to[pixel as usize] = mark;
            }
            if progress.is_full {
                return Err(Stop::Narrow);
            }
            next = done.end;
            if next < count {
                self.follow(slice, next, grid, at, p)?;
                next += 1;
            }
        }
        Ok(true)
    }

    /// Makes the events of these candidates, of which none is unclear.
    fn carry_out<R: Record>(
        &self,
        slice: &mut BandSlice<'_, S, R>,
        candidates: Range<usize>,
        events: usize,
        at: Interval,
    ) -> Result<(), Stop> {
        if candidates.is_empty() {
            return Ok(());
        }
        let decided = &self.candidates;
        let (pixels, verdicts) = (&self.samples.pixel[candidates.clone()], &decided.verdict[candidates.clone()]);
        let (keys, words) = (&decided.keys[candidates.clone()], &decided.words[candidates.clone()]);
        slice.events.reserve(candidates.len())?;
        let (event_keys, old) = slice.events.spare(candidates.len());
        if events == candidates.len() {
            event_keys.copy_from_slice(keys);
            for ((old, &word), &pixel) in old.iter_mut().zip(words).zip(pixels) {
                *old = R::old(slice.records, pixel, word);
            }
        } else {
            let mut count = 0;
            for ((&verdict, &key), (&word, &pixel)) in verdicts.iter().zip(keys).zip(words.iter().zip(pixels)) {
                // Written anyway, and kept where there is an event: no branch to mispredict.
                (event_keys[count], old[count]) = (key, R::old(slice.records, pixel, word));
                count += usize::from(verdict != Verdict::Nothing);
            }
        }
        slice.events.take(events);
        let after = decided.words_after[candidates.clone()].iter().zip(&decided.marks[candidates.clone()]);
        let verdicts = verdicts.iter().zip(&decided.tick[candidates]);
        // As many marks as records: one check of a pixel's number is enough for both.
        let records = &mut *slice.records;
        let marks = &mut slice.marks[..records.len()];
        for ((&pixel, (&word, &mark)), (&verdict, &tick)) in pixels.iter().zip(after).zip(verdicts) {
            let is = verdict != Verdict::Nothing;
            records[pixel as usize].take(word, is, at.start_us + tick);
            marks[pixel as usize] = mark;
        }
        Ok(())
    }

    /// Runs one candidate through the interval exactly.
    #[cold]
    fn follow<R: Record>(
        &mut self,
        slice: &mut BandSlice<'_, S, R>,
        candidate: usize,
        grid: Grid,
        at: Interval,
        p: &CrossingParameters,
    ) -> Result<(), Stop> {
        let in_band = self.samples.pixel[candidate] as usize;
        let address = grid.address(self.samples.pixel[candidate]);
        let sparse = slice.sparse_of(self.samples.pixel[candidate]);
        let c = p.thresholds(slice.first_pixel + in_band);
        let record = slice.records[in_band];
        let old = R::old(slice.records, self.samples.pixel[candidate], record.word());
        let mut reference = record.level();
        let mut last_event_us = record.last_event_us(slice.zero_us);
        let events = &mut *slice.events;
        let mut logs = [0.0; 2];
        S::logs(&[self.samples.from[candidate], self.samples.to[candidate]], p.log_eps, &mut logs);
        let line = Line { from: logs[0], to: logs[1], ticks: at.ticks };
        let mut emit = |events: &mut BandEvents<R>, t_us: i64, on| {
            events.push(at.start_us, t_us - at.start_us, address, on, old);
            last_event_us = t_us;
        };
        let moved = match slice.rates {
            _ if !sparse.is_empty() => {
                self.logs.resize(sparse.samples.len(), 0.0);
                S::logs(sparse.samples, p.log_eps, &mut self.logs);
                let (mut from, mut start_us, mut moved) = (line.from, at.start_us, false);
                let end = (at.start_us + at.ticks, line.to);
                for (t_us, to) in sparse.t_us.iter().copied().zip(self.logs.iter().copied()).chain([end]) {
                    let line = Line { from, to, ticks: t_us - start_us };
                    events.reserve(most_events(reference, &line, c))?;
                    moved |= follow(&mut reference, &line, start_us, c, |t_us, on| emit(events, t_us, on));
                    (from, start_us) = (to, t_us);
                }
                moved
            }
            None => {
                events.reserve(most_events(reference, &line, c))?;
                follow(&mut reference, &line, at.start_us, c, |t_us, on| emit(events, t_us, on))
            }
            Some(_) => {
                let (from, to) = (self.candidates.slope_from[candidate], self.candidates.slope_to[candidate]);
                let curve = Cubic::new(line, from, to);
                events.reserve(most_events(reference, &curve, c))?;
                follow(&mut reference, &curve, at.start_us, c, |t_us, on| emit(events, t_us, on))
            }
        };
        if moved {
            slice.records[in_band] = R::new(reference, last_event_us, slice.zero_us).ok_or(Stop::Narrow)?;
            slice.marks[in_band] = mark::<S>(reference, c, slice.marking.dark_level);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::crossing::band_events::Key;
    use crate::crossing::level::Level;
    use crate::crossing::marks::Marking;
    use crate::crossing::parameters::Threshold;
    use crate::crossing::record::{NEVER, Narrow};
    use proptest::prelude::*;

    /// What a band's pixels are after some frames, and what happened in the last one.
    #[derive(Debug, PartialEq)]
    struct After<S> {
        outcome: Result<(), Stop>,
        keys: Vec<Key>,
        old: Vec<u64>,
        levels: Vec<Level>,
        times: Vec<i64>,
        marks: Vec<u32>,
        last: Vec<S>,
    }

    const SIZE: SensorSize = SensorSize { width: 61, height: 40 };

    /// Runs pixels from `first_pixel` on over frames of log intensity that are a millisecond apart.
    fn after<S: Sample>(
        registers: Option<Registers>,
        sample: impl Fn(f64) -> S,
        frames: &[Vec<f64>],
        (first_pixel, counter): (usize, u32),
        p: &CrossingParameters,
    ) -> Vec<After<S>> {
        const ZERO_US: i64 = 7;
        let pixels = frames[0].len();
        let frame = |logs: &[f64]| logs.iter().map(|&log| sample(log)).collect::<Vec<_>>();
        let mut last = frame(&frames[0]);
        let (mut next, mut logs) = (last.clone(), vec![0.0; pixels]);
        S::logs(&last, p.log_eps, &mut logs);
        let marking = Marking::new::<S>(p, pixels);
        let mut marks = vec![0.0; pixels];
        S::marks(&logs, marking.dark_level(), &mut marks);
        let level = |(i, &base): (usize, &f64)| {
            let count = if i % 29 == 0 { counter } else { 0 };
            let c = p.thresholds(first_pixel + i);
            let base = base - f64::from(count) * (c.on - c.off);
            Narrow::new(Level { base, on: count, off: count }, NEVER, ZERO_US).unwrap()
        };
        let mut records: Vec<Narrow> = logs.iter().enumerate().map(level).collect();
        let mut band = Band::<S>::new(p);
        band.registers = registers;
        let mut events = BandEvents::default();
        let mut found = vec![];
        for (k, logs) in (1i64..).zip(&frames[1..]) {
            let slice = BandSlice {
                first_pixel,
                records: &mut records,
                zero_us: ZERO_US,
                events: &mut events,
                last: &last,
                next: &mut next,
                marks: &mut marks,
                marking: marking.of(0..pixels),
                new: &frame(logs),
                rates: None,
                sparse: SparseSamples { pixel: &[], t_us: &[], samples: &[] },
            };
            let at = Interval { start_us: 1000 * k, ticks: 1000 };
            let outcome = band.advance(slice, at, SIZE, p, Allowance::Usual);
            if outcome.is_ok() {
                std::mem::swap(&mut last, &mut next);
            } else {
                events.undo(&mut records, first_pixel, SIZE);
                marks.clear(); // a push computes them afresh then
            }
            found.push(After {
                outcome,
                keys: events.keys().to_vec(),
                old: events.old().to_vec(),
                levels: records.iter().map(|record| record.level()).collect(),
                times: records.iter().map(|record| record.last_event_us(ZERO_US)).collect(),
                marks: marks.iter().map(|mark| mark.to_bits()).collect(),
                last: last.clone(),
            });
            if outcome.is_err() {
                break;
            }
        }
        found
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(200))]

        /// All that both leave behind, bit by bit: quiet and dense tiles, several events of a pixel, counters that are full.
        #[test]
        fn registers_do_what_plain_loops_do(
            pixels in 1usize..1700, first_pixel in 0usize..700, seed: u64, step in prop::sample::select(vec![0.03, 0.3, 1.2, 4.0]),
            each: bool, counter in prop::sample::select(vec![0, 65_533, 65_535]), rests in 0u32..4, bad in 0u32..20,
        ) {
            let Some(registers) = Registers::find() else {
                return Ok(()); // there is nothing to compare
            };
            let mut state = seed;
            let mut random = || {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                u32::try_from(state >> 33).unwrap()
            };
            let threshold = |least: f64| {
                let each_pixel = || (0..2440).map(|i| least + 1e-3 * f64::from(i % 31)).collect();
                if each { Threshold::PerPixel(each_pixel()) } else { Threshold::Uniform(least) }
            };
            let p = CrossingParameters {
                contrast_threshold: threshold(0.2),
                contrast_threshold_off: threshold(0.3),
                ..CrossingParameters::default()
            };
            let mut logs: Vec<f64> = (0..pixels).map(|_| f64::from(random()) / f64::from(1 << 30) - 2.0).collect();
            let mut frames = vec![logs.clone()];
            for k in 0..4 {
                for (i, log) in logs.iter_mut().enumerate() {
                    // Stretches of pixels rest, and some come back to where they were.
                    let moves = random() % 4 >= rests.min(u32::try_from(i / 200).unwrap() % 4);
                    let way = (f64::from(random()) / f64::from(1 << 30) - 1.0) * step;
                    *log = if random() % 50 == 0 { frames[0][i] } else { *log + if moves { way } else { 0.0 } };
                }
                if bad == k {
                    logs[pixels / 2] = f64::NAN;
                }
                frames.push(logs.clone());
            }
            let of = (first_pixel, counter);
            prop_assert!(
                after(Some(registers), |log| log, &frames, of, &p) == after(None, |log| log, &frames, of, &p)
            );
            #[allow(clippy::cast_possible_truncation, reason = "luma is float32")]
            let luma = |log: f64| log.exp() as f32;
            prop_assert!(after(Some(registers), luma, &frames, of, &p) == after(None, luma, &frames, of, &p));
        }
    }
}
