//! A band of rows: the pixels that one thread takes at a time.

use super::candidates::{Candidates, Verdict};
use super::cubic::Cubic;
use super::line::Line;
use super::parameters::CrossingParameters;
use super::pixel::Pixel;
use super::sample::{Around, Sample};
use super::scan::{Found, TILE, scan};
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
    pub(crate) pixels: &'a mut [Pixel],
    pub(crate) last: &'a mut [S],
    pub(crate) low: &'a mut [S],
    pub(crate) high: &'a mut [S],
    pub(crate) new: &'a [S],
    /// Rates of change at the interval's start and end.
    pub(crate) rates: Option<(&'a [S], &'a [S])>,
}

/// Memory that a band keeps from frame to frame.
pub(crate) struct Band<S> {
    /// The events of the last frame, in raster order.
    pub(crate) events: Vec<Event>,
    found: Found<S>,
    candidates: Candidates<S>,
}

impl<S: Sample> Band<S> {
    pub(crate) fn new() -> Self {
        Self { events: Vec::new(), found: Found::new(), candidates: Candidates::new() }
    }

    /// Takes the frame's share: finds the events and moves the state on.
    pub(crate) fn advance(&mut self, mut share: Share<'_, S>, at: Interval, size: SensorSize, p: &CrossingParameters) {
        self.events.clear();
        for start in (0..share.new.len()).step_by(TILE) {
            let end = (start + TILE).min(share.new.len());
            let rates = share.rates.map(|(from, to)| (&from[start..end], &to[start..end]));
            let bounds = (&share.low[start..end], &share.high[start..end]);
            scan(&share.new[start..end], &mut share.last[start..end], bounds, rates, &mut self.found);
            if self.found.count == 0 {
                continue;
            }
            self.candidates.take_logs(&self.found, p.log_eps);
            if share.rates.is_some() {
                self.candidates.verdict[..self.found.count].fill(Verdict::Unclear);
            } else {
                self.decide(&share, start, at, p);
            }
            self.carry_out(&mut share, start, at, size, p);
        }
    }

    /// Decides a tile's candidates over straight lines.
    fn decide(&mut self, share: &Share<'_, S>, tile: usize, at: Interval, p: &CrossingParameters) {
        for (j, &place) in self.found.place[..self.found.count].iter().enumerate() {
            let in_share = tile + usize::from(place);
            let c = p.thresholds(share.first_pixel + in_share);
            self.candidates.set(j, share.pixels[in_share].reference, c);
        }
        self.candidates.decide(self.found.count, at.ticks, p.log_eps);
    }

    /// Makes the events of a tile's candidates, and moves their pixels and bounds on.
    fn carry_out(
        &mut self,
        share: &mut Share<'_, S>,
        tile: usize,
        at: Interval,
        size: SensorSize,
        p: &CrossingParameters,
    ) {
        let width = usize::from(size.width);
        let (mut row_start, mut y) = (0, 0);
        for j in 0..self.found.count {
            let in_share = tile + usize::from(self.found.place[j]);
            let index = share.first_pixel + in_share;
            // Places go up, so the row is followed instead of divided for.
            if index >= row_start + width {
                (row_start, y) = (index - index % width, index / width);
            }
            #[allow(clippy::cast_possible_truncation, reason = "within the sensor's u16 sides")]
            let (x, y) = ((index - row_start) as u16, y as u16);
            let verdict = self.candidates.verdict[j];
            match verdict {
                Verdict::Nothing => {}
                Verdict::On | Verdict::Off => {
                    let on = verdict == Verdict::On;
                    let pixel = &mut share.pixels[in_share];
                    pixel.reference.on += u32::from(on);
                    pixel.reference.off += u32::from(!on);
                    let t_us = at.start_us + self.candidates.tick[j];
                    pixel.last_event_us = t_us;
                    share.low[in_share] = self.candidates.low[j];
                    share.high[in_share] = self.candidates.high[j];
                    self.events.push(Event::new(t_us, x, y, on));
                }
                Verdict::Unclear => self.follow(share, j, in_share, (x, y), at, p),
            }
        }
    }

    /// Runs one candidate through the interval exactly.
    #[cold]
    fn follow(
        &mut self,
        share: &mut Share<'_, S>,
        candidate: usize,
        in_share: usize,
        (x, y): (u16, u16),
        at: Interval,
        p: &CrossingParameters,
    ) {
        let c = p.thresholds(share.first_pixel + in_share);
        let pixel = &mut share.pixels[in_share];
        let events = &mut self.events;
        let emit = |t_us, on| events.push(Event::new(t_us, x, y, on));
        let line = Line { from: self.candidates.from[candidate], to: self.candidates.to[candidate], ticks: at.ticks };
        let moved = match share.rates {
            None => pixel.follow(&line, at.start_us, c, emit),
            Some(rates) => {
                #[allow(clippy::cast_precision_loss, reason = "ticks < 2^53")]
                let seconds = at.ticks as f64 * 1e-6;
                let slope = |sample: S, rate: S| sample.log_rate(rate, p.log_eps) * seconds;
                let from = slope(self.found.from[candidate], rates.0[in_share]);
                let to = slope(self.found.to[candidate], rates.1[in_share]);
                pixel.follow(&Cubic::new(line, from, to), at.start_us, c, emit)
            }
        };
        if moved {
            let levels = [pixel.reference.down().value(c), pixel.reference.up().value(c)];
            let bounds =
                Around { below: &mut share.low[in_share..=in_share], above: &mut share.high[in_share..=in_share] };
            S::bounds(Around { below: &levels[..1], above: &levels[1..] }, p.log_eps, bounds);
        }
    }
}
