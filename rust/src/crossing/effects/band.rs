//! A band of rows under effects: the state of its pixels, and how a frame passes through them.
//!
//! Each tile of pixels is first marked in vector code ([`super::scan`]): a pixel is marked if it may have an event, or
//! if shot noise may reach a level, a hold ends or a hot pixel fires in the interval. Only marked pixels are followed in time
//! ([`super::timeline`]), because that is many times slower. What a pixel was before is kept, so that a push of too
//! many events can be undone.
//!
//! What must not break:
//! - A pixel that is not marked has no event and changes no state but its signals.
//! - Waits are counted from the last frame, not from the start of the run. So they keep their digits, however long a
//!   run is.
//! - [`Band::undo`] restores everything that [`Band::advance`] changes.

use super::chords::{Chords, Start, number_of_chords};
use super::hot_pixels::Arrivals;
use super::input::{Input, LowPass};
use super::leak::{LeakJitter, Leaks};
use super::near_noise::NearNoise;
use super::noise_path::{NoisePath, ShotNoisePath};
use super::scan::{
    FilterStep, TwoOutputs, TwoSteps, low_pass, mark_out_of_bounds, mark_sign_changes, mark_start_out_of_bounds,
    mark_turns, two_low_passes, within_reach,
};
use super::sensor::Sensor;
use super::timeline::{FREE, Pixel, WHOLE, bounds};
use crate::crossing::band::Interval;
use crate::crossing::buffer::{Allowance, Buffer, Full};
use crate::crossing::core::Push;
use crate::crossing::frame::SparseSamples;
use crate::crossing::level::{Level, Thresholds};
use crate::crossing::line::Line;
use crate::crossing::parameters::CrossingParameters;
use crate::crossing::record::NEVER;
use crate::crossing::sample::Sample;
use crate::crossing::scan::TILE;
use crate::crossing::start_phase::StartPhase;
use crate::event::Event;

/// A band's part of a frame, and the interval that it ends.
pub(super) struct BandFrame<'a, S> {
    pub(super) new: &'a [S],
    pub(super) rates: Option<&'a [S]>,
    pub(super) sparse: SparseSamples<'a, S>,
    pub(super) at: Interval,
}

/// The state of a band's pixels. What belongs to an effect that is off is empty.
pub(super) struct Band {
    pub(super) first_pixel: usize,
    /// The last frame's, in raster order.
    pub(super) events: Buffer<Event>,
    /// Log intensity, and its change per second, at the last frame.
    pub(super) logs: Vec<f64>,
    pub(super) slopes: Vec<f64>,
    pub(super) references: Vec<Level>,
    pub(super) last_event_us: Vec<i64>,
    /// What leaves the photoreceptor, where a source follower filters that.
    pub(super) photoreceptor: Vec<f64>,
    /// What leaves the last low-pass.
    pub(super) filtered: Vec<f64>,
    /// Microseconds from the last frame until the pixel is released.
    pub(super) held_us: Vec<f64>,
    pub(super) noise: Vec<NoisePath>,
    pub(super) hot: Vec<(u32, Arrivals)>,
    pub(super) leaks: Leaks,
    /// What a comparator sees strictly between has reached no level.
    pub(super) low: Vec<f64>,
    pub(super) high: Vec<f64>,
    pub(super) tile: Tile,
    pub(super) near: NearNoise,
    /// What the frame brings, until the push is done.
    next: Signals,
    /// Pixels that were run over the frame, as they were before.
    before: Vec<Before>,
    /// Noise that was followed over the frame, likewise, by pixel.
    noise_before: Vec<(u32, NoisePath)>,
}

/// All pixels' signals at a frame.
struct Signals {
    logs: Vec<f64>,
    slopes: Vec<f64>,
    photoreceptor: Vec<f64>,
    filtered: Vec<f64>,
}

/// A pixel's state, but for its signals.
struct Before {
    pixel: u32,
    reference: Level,
    last_event_us: i64,
    held_us: f64,
    hot: Option<Arrivals>,
    leak_error: f64,
}

/// What a tile's pixels come to at a frame.
pub(super) struct Tile {
    pub(super) logs: Vec<f64>,
    pub(super) slopes: Vec<f64>,
    decay: Vec<f64>,
    photoreceptor: Vec<f64>,
    filtered: Vec<f64>,
    /// Derivatives of two low-passes at the interval's end, by the share of the interval.
    photoreceptor_slope: Vec<f64>,
    filtered_slope: Vec<f64>,
    seen: Vec<f64>,
    /// How far references have leaked at both ends of the interval.
    pub(super) leaked: Vec<f64>,
    pub(super) will_leak: Vec<f64>,
    /// How far shot noise may be from zero, and what leaves it within bounds.
    reach: Vec<f64>,
    low: Vec<f64>,
    high: Vec<f64>,
    marked: Vec<bool>,
    /// Pixels of which nothing is known but that noise may reach a level.
    pub(super) near: Vec<bool>,
    /// Pixels of which the state, and the noise, of before the frame are kept.
    kept: Vec<bool>,
    noise_kept: Vec<bool>,
    chords: Chords,
    /// Log intensity of one pixel's sparse samples.
    sparse: Vec<f64>,
}

impl Tile {
    fn new() -> Self {
        let [logs, slopes, decay, seen, leaked, will_leak] = std::array::from_fn(|_| vec![0.0; TILE]);
        let [photoreceptor, filtered, photoreceptor_slope, filtered_slope] = std::array::from_fn(|_| vec![0.0; TILE]);
        let [reach, low, high] = std::array::from_fn(|_| vec![0.0; TILE]);
        Self {
            logs,
            slopes,
            decay,
            photoreceptor,
            filtered,
            photoreceptor_slope,
            filtered_slope,
            seen,
            leaked,
            will_leak,
            reach,
            low,
            high,
            marked: vec![false; TILE],
            near: vec![false; TILE],
            kept: vec![false; TILE],
            noise_kept: vec![false; TILE],
            chords: Chords::default(),
            sparse: vec![],
        }
    }
}

impl Band {
    /// Pixels at their first log intensity.
    #[allow(clippy::cast_possible_truncation, reason = "no sensor has 2^32 pixels")]
    pub(super) fn new(
        first_pixel: usize,
        logs: &[f64],
        slopes: &[f64],
        p: &CrossingParameters,
        sensor: &Sensor,
    ) -> Self {
        let (n, effects) = (logs.len(), &sensor.effects);
        let number = |i: usize| (first_pixel + i) as u32;
        let thresholds = |i: usize| p.thresholds(first_pixel + i);
        let (mut noise, mut references) = (vec![], vec![]);
        for (i, &log) in logs.iter().enumerate() {
            let first = |seen| p.first_reference(seen, first_pixel + i, sensor.seed);
            let Some(law) = &sensor.shot else {
                references.push(first(log));
                continue;
            };
            let (path, reference) = if p.start_phase == StartPhase::Zero {
                (NoisePath::new(law, number(i), log), first(log))
            } else {
                let first = |noise: f64| first(log + noise).value(thresholds(i));
                let (path, base) = NoisePath::run_before(law, number(i), log, thresholds(i), first);
                (path, Level { base, on: 0, off: 0 })
            };
            noise.push(path);
            references.push(reference);
        }
        let hot = sensor.hot.iter().flat_map(|noise| {
            let chosen = (0..n).filter(|&i| noise.chosen(number(i)));
            chosen.map(|i| (i as u32, noise.first(number(i))))
        });
        let settled = |on: bool| if on { logs.to_vec() } else { vec![] };
        let (photoreceptor, filtered) = (settled(effects.filters_twice()), settled(effects.filters()));
        let mut band = Self {
            first_pixel,
            events: Buffer::default(),
            logs: logs.to_vec(),
            slopes: slopes.to_vec(),
            next: Signals {
                logs: logs.to_vec(),
                slopes: slopes.to_vec(),
                photoreceptor: photoreceptor.clone(),
                filtered: filtered.clone(),
            },
            before: vec![],
            noise_before: vec![],
            near: NearNoise::default(),
            references,
            last_event_us: vec![NEVER; n],
            photoreceptor,
            filtered,
            held_us: if effects.refractory_period_us > 0.0 { vec![FREE; n] } else { vec![] },
            noise,
            hot: hot.collect(),
            leaks: Leaks::new(
                effects.leak,
                sensor.seed,
                effects.filters(),
                first_pixel,
                &(0..n).map(thresholds).collect::<Vec<_>>(),
            ),
            low: vec![0.0; n],
            high: vec![0.0; n],
            tile: Tile::new(),
        };
        band.reset_bounds(p);
        band
    }

    /// Returns the band's part of a frame.
    pub(super) fn part_of<'a, S: Sample>(&self, push: &Push<'a, S>) -> BandFrame<'a, S> {
        let (frame, at) = (&push.frame, push.at);
        let pixels = self.first_pixel..self.first_pixel + self.logs.len();
        let sparse = frame.sparse.of(pixels.start, pixels.end);
        BandFrame { new: &frame.samples[pixels.clone()], rates: frame.rate.map(|rates| &rates[pixels]), sparse, at }
    }

    pub(super) fn reset_bounds(&mut self, p: &CrossingParameters) {
        for i in 0..self.logs.len() {
            self.set_bounds(i, p.thresholds(self.first_pixel + i));
        }
    }

    fn set_bounds(&mut self, i: usize, c: Thresholds) {
        let held = self.held_us.get(i).is_some_and(|&held| held > FREE);
        let free = bounds(self.references[i], c);
        (self.low[i], self.high[i]) = if held { (f64::NEG_INFINITY, f64::INFINITY) } else { free };
    }

    /// Runs the band's pixels over a frame, within an allowance of events: then [`Self::settle`], or [`Self::undo`].
    pub(super) fn advance<S: Sample>(
        &mut self,
        frame: &BandFrame<'_, S>,
        p: &CrossingParameters,
        sensor: &Sensor,
        allowance: Allowance,
    ) -> Result<(), Full> {
        self.events.begin(allowance, frame.new.len());
        self.before.clear();
        self.noise_before.clear();
        for start in (0..frame.new.len()).step_by(TILE) {
            let end = (start + TILE).min(frame.new.len());
            self.tile.kept.fill(false);
            self.tile.noise_kept.fill(false);
            self.see(start, end, frame, p, sensor);
            self.mark(start, end, frame, sensor);
            let made = self.events.made().len();
            for i in start..end {
                if self.tile.marked[i - start] {
                    self.run((i, i - start), frame, p, sensor, WHOLE)?;
                }
            }
            self.follow_near((start, end), frame, p, sensor)?;
            if sensor.shot.is_some() {
                in_raster_order(self.events.made_after(made));
            }
            self.next.logs[start..end].copy_from_slice(&self.tile.logs[..end - start]);
            keep(&mut self.next.photoreceptor, start, end, &self.tile.photoreceptor);
            keep(&mut self.next.filtered, start, end, &self.tile.filtered);
            keep(&mut self.next.slopes, start, end, &self.tile.slopes);
        }
        Ok(())
    }

    /// Keeps what [`Self::advance`] has found over an interval of `ticks` ticks.
    #[allow(clippy::cast_precision_loss, reason = "intervals are shorter than 2^53 us")]
    pub(super) fn settle(&mut self, ticks: i64) {
        std::mem::swap(&mut self.logs, &mut self.next.logs);
        std::mem::swap(&mut self.slopes, &mut self.next.slopes);
        std::mem::swap(&mut self.photoreceptor, &mut self.next.photoreceptor);
        std::mem::swap(&mut self.filtered, &mut self.next.filtered);
        self.leaks.settle();
        // All waits are from the last frame on; a float minus an integer below it is exact.
        let ticks = ticks as f64;
        self.held_us.iter_mut().for_each(|held| *held -= ticks);
        self.hot.iter_mut().for_each(|hot| hot.1.wait_us -= ticks);
    }

    /// Keeps a pixel's noise as it was before the frame. Only once, because a frame may be thousands of cells long.
    #[allow(clippy::cast_possible_truncation, reason = "no sensor has 2^32 pixels")]
    pub(super) fn keep_noise(&mut self, i: usize, in_tile: usize) {
        if let Some(&path) = self.noise.get(i)
            && !std::mem::replace(&mut self.tile.noise_kept[in_tile], true)
        {
            self.noise_before.push((i as u32, path));
        }
    }

    /// Goes back to before [`Self::advance`].
    #[cold]
    pub(super) fn undo(&mut self, p: &CrossingParameters) {
        self.events.clear();
        for before in std::mem::take(&mut self.before) {
            let i = before.pixel as usize;
            self.references[i] = before.reference;
            self.last_event_us[i] = before.last_event_us;
            if let Some(held_us) = self.held_us.get_mut(i) {
                *held_us = before.held_us;
            }
            if let (Some(index), Some(stored)) = (self.hot_place(i), before.hot) {
                self.hot[index].1 = stored;
            }
            if let Some(error) = self.leaks.error.get_mut(i) {
                *error = before.leak_error;
            }
            self.set_bounds(i, p.thresholds(self.first_pixel + i));
        }
        for (pixel, path) in std::mem::take(&mut self.noise_before) {
            self.noise[pixel as usize] = path;
        }
    }

    /// Where a pixel's hot noise is kept, if it is hot.
    #[allow(clippy::cast_possible_truncation, reason = "no sensor has 2^32 pixels")]
    pub(super) fn hot_place(&self, i: usize) -> Option<usize> {
        self.hot.binary_search_by_key(&(i as u32), |hot| hot.0).ok()
    }

    /// Computes what the pixels of a tile come to at the frame.
    #[allow(clippy::cast_precision_loss, reason = "intervals are shorter than 2^53 us")]
    fn see<S: Sample>(
        &mut self,
        start: usize,
        end: usize,
        frame: &BandFrame<'_, S>,
        p: &CrossingParameters,
        sensor: &Sensor,
    ) {
        let (n, tile, at) = (end - start, &mut self.tile, frame.at);
        tile.chords.begin(at.ticks);
        S::logs(&frame.new[start..end], p.log_eps, &mut tile.logs[..n]);
        if let Some(rates) = frame.rates {
            let samples = frame.new[start..end].iter().zip(&rates[start..end]);
            let slopes = samples.map(|(sample, &rate)| sample.log_rate(rate, p.log_eps));
            tile.slopes.iter_mut().zip(slopes).for_each(|(to, slope)| *to = slope);
        }
        if let Some(before) = self.filtered.get(start..end) {
            let (bandwidth, ticks) = (sensor.effects.photoreceptor_bandwidth, at.ticks as f64);
            let input = (&self.logs[start..end], &tile.logs[..n]);
            let (decay, output) = (&mut tile.decay[..n], &mut tile.filtered[..n]);
            if let Some(first) = self.photoreceptor.get(start..end) {
                let outputs = TwoOutputs {
                    first: &mut tile.photoreceptor[..n],
                    second: output,
                    first_slope: &mut tile.photoreceptor_slope[..n],
                    second_slope: &mut tile.filtered_slope[..n],
                };
                two_low_passes(bandwidth, ticks, (first, before), input, decay, outputs);
            } else {
                low_pass(bandwidth, ticks, before, input, (decay, output));
            }
            if frame.rates.is_some() {
                self.see_chords(start, end, frame, sensor);
            }
            let tile = &mut self.tile;
            tile.seen[..n].copy_from_slice(&tile.filtered[..n]);
        } else {
            tile.seen[..n].copy_from_slice(&tile.logs[..n]);
        }
        let tile = &mut self.tile;
        if !self.leaks.dark.is_empty() {
            let (elapsed_us, ticks) = (sensor.elapsed(at.start_us), at.ticks as f64);
            for k in 0..n {
                let drift = self.leaks.drift(start + k, elapsed_us, (self.logs[start + k], tile.logs[k]));
                (tile.leaked[k], tile.will_leak[k]) = (drift.at(0.0), drift.at(ticks));
                tile.seen[k] += tile.will_leak[k];
                self.leaks.note(start + k, &drift, ticks);
            }
        }
    }

    /// Computes what the low-passes of a tile come to where their input is so bent that it is taken as chords.
    ///
    /// Sparse samples of a pixel have straight lines between them, so it needs none.
    #[allow(clippy::cast_precision_loss, reason = "intervals are shorter than 2^53 us")]
    #[allow(clippy::cast_possible_truncation, reason = "no sensor has 2^32 pixels")]
    fn see_chords<S: Sample>(&mut self, start: usize, end: usize, frame: &BandFrame<'_, S>, sensor: &Sensor) {
        let (tile, first, ticks) = (&mut self.tile, self.first_pixel + start, frame.at.ticks);
        let sparse = frame.sparse.of(first, self.first_pixel + end).pixel;
        let seconds = ticks as f64 * 1e-6;
        for i in 0..end - start {
            let line = Line { from: self.logs[start + i], to: tile.logs[i], ticks };
            let slopes = (self.slopes[start + i] * seconds, tile.slopes[i] * seconds);
            let chords = number_of_chords(slopes, line.to - line.from, sensor.tolerance, ticks);
            if chords > 1 && sparse.binary_search(&((first + i) as u32)).is_err() {
                tile.chords.add(i, line, slopes, chords);
            }
        }
        let photoreceptor = self.photoreceptor.get(start..end).unwrap_or_default();
        let before = Start { photoreceptor, filtered: &self.filtered[start..end] };
        tile.chords.filter(sensor.effects.photoreceptor_bandwidth, &before);
        for (i, node) in tile.chords.ends() {
            (tile.photoreceptor[i], tile.filtered[i]) = (node.photoreceptor, node.filtered);
        }
    }

    /// Marks the pixels of a tile to which something may have happened.
    #[allow(clippy::cast_precision_loss, reason = "intervals are shorter than 2^53 us")]
    fn mark<S: Sample>(&mut self, start: usize, end: usize, frame: &BandFrame<'_, S>, sensor: &Sensor) {
        let (n, tile, ticks) = (end - start, &mut self.tile, frame.at.ticks as f64);
        let from = &self.logs[start..end];
        let (mut bounds, marked) = ((&self.low[start..end], &self.high[start..end]), &mut tile.marked[..n]);
        if let Some(noise) = &sensor.shot {
            noise.reach(from, &tile.logs[..n], &mut tile.reach[..n]);
            within_reach(bounds, &tile.reach[..n], (&mut tile.low[..n], &mut tile.high[..n]));
            bounds = (&tile.low[..n], &tile.high[..n]);
            let before = self.filtered.get(start..end).unwrap_or(from);
            mark_out_of_bounds(&tile.seen, bounds, &mut tile.near[..n]);
            mark_start_out_of_bounds(before, &tile.leaked[..n], bounds, &mut tile.near[..n]);
            marked.fill(false);
        } else {
            mark_out_of_bounds(&tile.seen, bounds, marked);
        }
        if let Some(before) = self.filtered.get(start..end) {
            let (to, leaked) = (&*tile.logs, (&*tile.leaked, &*tile.will_leak));
            if let Some(first) = self.photoreceptor.get(start..end) {
                let steps = TwoSteps {
                    from,
                    to,
                    first,
                    second: before,
                    first_decay: &tile.decay,
                    second_decay: sensor.effects.photoreceptor_bandwidth.follower_decay(ticks),
                    first_slope: &tile.photoreceptor_slope,
                    second_slope: &tile.filtered_slope,
                };
                mark_turns(&steps, leaked, bounds, marked);
            } else {
                let filter_step = FilterStep { from, to, before, output: &tile.filtered, decay: &tile.decay };
                mark_sign_changes(&filter_step, leaked, bounds, marked);
            }
        }
        if frame.rates.is_some() && self.filtered.is_empty() {
            let seconds = ticks * 1e-6;
            for (i, marked) in marked.iter_mut().enumerate() {
                let slopes = (self.slopes[start + i] * seconds, tile.slopes[i] * seconds);
                let leaked = if self.leaks.dark.is_empty() { 0.0 } else { tile.will_leak[i] - tile.leaked[i] };
                *marked |= (slopes.0 + leaked) * (slopes.1 + leaked) < 0.0;
            }
        }
        for (i, (least, most)) in tile.chords.extents() {
            marked[i] |=
                tile.near[i] || most + tile.will_leak[i] >= bounds.1[i] || least + tile.leaked[i] <= bounds.0[i];
        }
        for (marked, &held) in marked.iter_mut().zip(self.held_us.get(start..end).unwrap_or_default()) {
            *marked |= held > FREE && held <= ticks;
        }
        let hot = self.hot.partition_point(|hot| (hot.0 as usize) < start);
        for (i, arrivals) in self.hot[hot..].iter().take_while(|hot| (hot.0 as usize) < end) {
            marked[*i as usize - start] |= arrivals.wait_us <= ticks;
        }
        for &pixel in frame.sparse.of(self.first_pixel + start, self.first_pixel + end).pixel {
            marked[pixel as usize - self.first_pixel - start] = true;
        }
        if sensor.shot.is_some() {
            tile.near.iter_mut().zip(&*marked).for_each(|(near, marked)| *near &= !marked);
        }
    }

    /// Runs one pixel, by its place in the band and in the tile, over a window of the frame, along all that it sees there.
    #[allow(clippy::cast_possible_truncation, reason = "no sensor has 2^32 pixels")]
    #[allow(clippy::cast_precision_loss, reason = "intervals are shorter than 2^53 us")]
    pub(super) fn run<S: Sample>(
        &mut self,
        (i, in_tile): (usize, usize),
        frame: &BandFrame<'_, S>,
        p: &CrossingParameters,
        sensor: &Sensor,
        window_us: (f64, f64),
    ) -> Result<(), Full> {
        let (index, at) = (self.first_pixel + i, frame.at);
        let thresholds = p.thresholds(index);
        if sensor.shot.is_none() {
            let log = (self.tile.logs[in_tile], self.tile.slopes[in_tile]);
            let (crossings, arrivals) = self.expected(i, log, frame, p, sensor);
            // Ten standard deviations of a Poisson process, and a few where it hardly happens. For more, memory is taken then.
            let arrivals = if arrivals > 0.0 { arrivals + 10.0 * arrivals.sqrt() + 20.0 } else { 0.0 };
            #[allow(clippy::cast_sign_loss, reason = "both >= 0")]
            self.events.reserve(((crossings + arrivals) as usize).saturating_add(4))?;
        }
        let hot = self.hot_place(i);
        if !std::mem::replace(&mut self.tile.kept[in_tile], true) {
            self.before.push(Before {
                pixel: i as u32,
                reference: self.references[i],
                last_event_us: self.last_event_us[i],
                held_us: self.held_us.get(i).copied().unwrap_or(FREE),
                hot: hot.map(|index| self.hot[index].1),
                leak_error: self.leaks.error.get(i).copied().unwrap_or_default(),
            });
        }
        self.keep_noise(i, in_tile);
        // How many events noise makes cannot be told beforehand: memory is taken for each.
        let (has_shot_noise, (x, y)) = (sensor.shot.is_some(), sensor.size.xy(index));
        let last_us = self.last_event_us[i];
        let (events, last_event_us) = (&mut self.events, &mut self.last_event_us[i]);
        let mut full = Ok(());
        let emit = |tick, on| {
            if has_shot_noise && full.is_ok() {
                full = events.reserve(1);
            }
            if full.is_err() {
                return;
            }
            events.push(Event::new(at.start_us + tick, x, y, on));
            *last_event_us = at.start_us + tick;
        };
        let mut free = FREE;
        let drift = self.leaks.drift(i, sensor.elapsed(at.start_us), (self.logs[i], self.tile.logs[in_tile]));
        let leak_jitter = self.leaks.error.get_mut(i).map(|error| LeakJitter {
            fraction: sensor.effects.leak.jitter,
            seed: sensor.seed,
            rate: drift.rate(),
            elapsed_us: at.start_us - sensor.started_us,
            last_us: last_us.max(sensor.started_us) - sensor.started_us,
            error,
        });
        let mut pixel = Pixel {
            number: index as u32,
            c: thresholds,
            reference: &mut self.references[i],
            held_until_us: self.held_us.get_mut(i).unwrap_or(&mut free),
            refractory_us: sensor.effects.refractory_period_us,
            window_us,
            leak_jitter,
            shot_noise: sensor.shot.as_ref().zip(self.noise.get_mut(i)).map(|(law, path)| ShotNoisePath {
                law,
                pixel: index as u32,
                path,
                elapsed_us: sensor.elapsed(at.start_us),
                reach: self.tile.reach[in_tile],
                last: None,
            }),
            hot: hot.and_then(|hot| sensor.hot.zip(self.hot.get_mut(hot).map(|hot| &mut hot.1))),
        };
        let input = Input { drift, from: self.logs[i], to: self.tile.logs[in_tile], ticks: at.ticks };
        let bandwidth = sensor.effects.photoreceptor_bandwidth;
        let sparse = frame.sparse.of(index, index + 1);
        if let Some(nodes) = self.tile.chords.nodes(in_tile) {
            input.follow_chords(&mut pixel, nodes, (bandwidth, !self.photoreceptor.is_empty()), emit);
        } else if frame.rates.is_some() && sparse.is_empty() && self.filtered.is_empty() {
            let seconds = at.ticks as f64 * 1e-6;
            let slopes = (self.slopes[i] * seconds, self.tile.slopes[in_tile] * seconds);
            input.follow_cubic(&mut pixel, slopes, emit);
        } else {
            let low_pass = self.filtered.get(i).map(|&before| {
                self.tile.filtered[in_tile] = before;
                let photoreceptor = self.photoreceptor.get(i).map(|&before| {
                    self.tile.photoreceptor[in_tile] = before;
                    &mut self.tile.photoreceptor[in_tile]
                });
                LowPass { bandwidth, photoreceptor, output: &mut self.tile.filtered[in_tile] }
            });
            self.tile.sparse.resize(sparse.samples.len(), 0.0);
            S::logs(sparse.samples, p.log_eps, &mut self.tile.sparse);
            let ticks = sparse.t_us.iter().map(|t_us| t_us - at.start_us);
            input.follow_lines(&mut pixel, ticks.zip(self.tile.sparse.iter().copied()), low_pass, emit);
        }
        self.set_bounds(i, thresholds);
        full
    }
}

/// Puts events in the order of pixels; those of a pixel stay in theirs.
fn in_raster_order(events: &mut [Event]) {
    let key = |event: &Event| (event.y, event.x);
    if !events.is_sorted_by_key(key) {
        events.sort_by_key(key);
    }
}

/// Keeps a tile's values, of an effect that is on.
fn keep(values: &mut [f64], start: usize, end: usize, tile: &[f64]) {
    if let Some(values) = values.get_mut(start..end) {
        values.copy_from_slice(&tile[..end - start]);
    }
}
