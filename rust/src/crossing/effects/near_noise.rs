//! Follows the noise of pixels that stand near a level, many at a time, cell by cell, until it may reach that level.
//!
//! Most of these pixels have no event in a cell, and draws are made much faster many at a time. So all pixels of a
//! tile enter a cell together, and the first halvings are made together too. Only a pixel whose noise may still reach a
//! level then is run over that cell by itself ([`super::band::Band::run`]).
//!
//! What must not break:
//! - Draws and paths are those of [`super::noise_path`], to the last bit. What is taken to be out of reach here, that
//!   module finds no crossing in.
//! - Pixels make their events cell by cell. The band puts those of a tile in the order of pixels afterwards.

use super::band::{Band, BandFrame};
use super::noise_path::{NoisePath, Span};
use super::sensor::Sensor;
use super::shot_noise::{FAR, ShotNoiseLaw};
use super::timeline::FREE;
use crate::crossing::buffer::Full;
use crate::crossing::cubic::Cubic;
use crate::crossing::level::Thresholds;
use crate::crossing::line::Line;
use crate::crossing::parameters::CrossingParameters;
use crate::crossing::sample::Sample;

/// How often a cell is halved for many pixels at a time.
const HALVINGS: usize = 3;

/// The pixels of a tile that are near a level, and what is drawn for them. Kept for its memory.
#[derive(Default)]
pub(super) struct NearNoise {
    pixels: Vec<NearPixel>,
    /// Places in `pixels` of those that enter a cell, then of those that may reach a level in it.
    chosen: Vec<usize>,
    /// Parts of the cell in which noise may reach a level, by the place of their pixel, and their halves.
    spans: Vec<(usize, Span)>,
    halves: Vec<(usize, Span)>,
    draws: Draws,
}

/// Normal draws of pixels and instants.
#[derive(Default)]
struct Draws {
    pixels: Vec<u32>,
    nodes: Vec<u64>,
    first: Vec<f64>,
    second: Vec<f64>,
}

impl Draws {
    fn make(&mut self, law: &ShotNoiseLaw, named: impl Iterator<Item = (u32, u64)>) {
        self.pixels.clear();
        self.nodes.clear();
        for (pixel, node) in named {
            self.pixels.push(pixel);
            self.nodes.push(node);
        }
        self.first.resize(self.pixels.len(), 0.0);
        self.second.resize(self.pixels.len(), 0.0);
        law.many_draws((&self.pixels, &self.nodes), (&mut self.first, &mut self.second));
    }

    fn get(&self, k: usize) -> (f64, f64) {
        (self.first[k], self.second[k])
    }
}

/// A pixel near a level over an interval.
struct NearPixel {
    /// Its place in the band and in the tile, and its number.
    i: usize,
    in_tile: usize,
    number: u32,
    /// What comparators see at the interval's start without noise, at least and at most, and how that changes in a
    /// microsecond.
    least: f64,
    most: f64,
    slope: f64,
    /// Between these it has reached no level.
    low: f64,
    high: f64,
    /// The lesser of both thresholds.
    least_threshold: f64,
    held: bool,
}

impl NearPixel {
    /// Whether noise that comes down and up so far may reach a level within a window.
    fn within_reach(&self, (down, up): (f64, f64), window_us: (f64, f64)) -> bool {
        let change = (self.slope * window_us.0, self.slope * window_us.1);
        let (least, most) = (self.least + change.0.min(change.1), self.most + change.0.max(change.1));
        most + up >= self.high || least + down <= self.low
    }
}

impl Band {
    /// Follows the pixels of a tile that are near a level over a frame.
    pub(super) fn follow_near<S: Sample>(
        &mut self,
        tile: (usize, usize),
        frame: &BandFrame<'_, S>,
        p: &CrossingParameters,
        sensor: &Sensor,
    ) -> Result<(), Full> {
        let Some(law) = &sensor.shot else { return Ok(()) };
        let mut near = std::mem::take(&mut self.near);
        near.begin(self, tile, frame, p);
        let followed = if near.pixels.is_empty() { Ok(()) } else { near.follow(self, law, frame, p, sensor) };
        self.near = near;
        followed
    }

    /// ln(luma + `log_eps`) of a pixel at a time of the interval.
    #[allow(clippy::cast_precision_loss, reason = "intervals are shorter than 2^53 us")]
    fn log_light<S: Sample>(&self, i: usize, in_tile: usize, frame: &BandFrame<'_, S>, t_us: f64) -> f64 {
        let line = Line { from: self.logs[i], to: self.tile.logs[in_tile], ticks: frame.at.ticks };
        let (ticks, t_us) = (line.ticks as f64, t_us.max(0.0));
        if frame.rates.is_some() && self.filtered.is_empty() {
            let seconds = ticks * 1e-6;
            return Cubic::new(line, self.slopes[i] * seconds, self.tile.slopes[in_tile] * seconds).at(t_us / ticks);
        }
        line.from + (line.to - line.from) * (t_us / ticks)
    }

    /// What a pixel near a level sees over the interval.
    #[allow(clippy::cast_precision_loss, reason = "intervals are shorter than 2^53 us")]
    #[allow(clippy::cast_possible_truncation, reason = "no sensor has 2^32 pixels")]
    fn near_pixel<S: Sample>(
        &self,
        (i, in_tile): (usize, usize),
        frame: &BandFrame<'_, S>,
        c: Thresholds,
    ) -> NearPixel {
        let (from, to, ticks) = (self.logs[i], self.tile.logs[in_tile], frame.at.ticks as f64);
        let (leaked, will_leak) = (self.tile.leaked[in_tile], self.tile.will_leak[in_tile]);
        let (least, most) = if let Some(&before) = self.filtered.get(i) {
            let between = self.photoreceptor.get(i).copied().unwrap_or(before);
            (from.min(to).min(before).min(between), from.max(to).max(before).max(between))
        } else if frame.rates.is_some() {
            (from.min(to), from.max(to))
        } else {
            (from, from)
        };
        let straight = self.filtered.is_empty() && frame.rates.is_none();
        let change = will_leak - leaked + if straight { to - from } else { 0.0 };
        NearPixel {
            i,
            in_tile,
            number: (self.first_pixel + i) as u32,
            least: least + leaked,
            most: most + leaked,
            slope: change / ticks,
            low: self.low[i],
            high: self.high[i],
            least_threshold: c.on.min(c.off),
            held: false,
        }
    }
}

#[allow(clippy::cast_precision_loss, reason = "within 2^53 us")]
impl NearNoise {
    /// Takes up the pixels of a tile that are near a level.
    fn begin<S: Sample>(
        &mut self,
        band: &Band,
        (start, end): (usize, usize),
        frame: &BandFrame<'_, S>,
        p: &CrossingParameters,
    ) {
        self.pixels.clear();
        for in_tile in 0..end - start {
            if band.tile.near[in_tile] {
                let i = start + in_tile;
                let c = p.thresholds(band.first_pixel + i);
                self.pixels.push(band.near_pixel((i, in_tile), frame, c));
            }
        }
    }

    /// Takes them through the cells of the interval.
    #[allow(clippy::cast_possible_truncation, reason = "within 2^53 us")]
    fn follow<S: Sample>(
        &mut self,
        band: &mut Band,
        law: &ShotNoiseLaw,
        frame: &BandFrame<'_, S>,
        p: &CrossingParameters,
        sensor: &Sensor,
    ) -> Result<(), Full> {
        let (elapsed_us, ticks) = (sensor.elapsed(frame.at.start_us), frame.at.ticks as f64);
        for cell in (elapsed_us / law.cell_us).floor() as i64.. {
            let begins = cell as f64 * law.cell_us - elapsed_us;
            let window_us = (begins.max(0.0), (begins + law.cell_us).min(ticks));
            if window_us.1 <= window_us.0 {
                break;
            }
            self.enter(band, law, frame, (cell, begins));
            self.choose(band, law, window_us);
            for k in 0..self.chosen.len() {
                let pixel = &mut self.pixels[self.chosen[k]];
                band.run((pixel.i, pixel.in_tile), frame, p, sensor, window_us)?;
                pixel.held = band.held_us.get(pixel.i).is_some_and(|&held| held > FREE);
                (pixel.low, pixel.high) = (band.low[pixel.i], band.high[pixel.i]);
            }
        }
        Ok(())
    }

    /// Takes all pixels into a cell.
    fn enter<S: Sample>(
        &mut self,
        band: &mut Band,
        law: &ShotNoiseLaw,
        frame: &BandFrame<'_, S>,
        (cell, begins): (i64, f64),
    ) {
        // A pixel that is held takes its noise up again when that ends.
        let behind = |pixel: &NearPixel| !pixel.held && band.noise[pixel.i].cell < cell;
        self.chosen.clear();
        self.chosen.extend(self.pixels.iter().enumerate().filter(|(_, pixel)| behind(pixel)).map(|(k, _)| k));
        let ends = law.node(cell + 1, 0);
        self.draws.make(law, self.chosen.iter().map(|&k| (self.pixels[k].number, ends)));
        for (at, &k) in self.chosen.iter().enumerate() {
            let NearPixel { i, in_tile, number, .. } = self.pixels[k];
            let log_light = band.log_light(i, in_tile, frame, begins);
            band.keep_noise(i, in_tile);
            band.noise[i].enter(law, number, cell, log_light, self.draws.get(at));
        }
    }

    /// Chooses the pixels whose noise may reach a level in the cell that they are in.
    fn choose(&mut self, band: &Band, law: &ShotNoiseLaw, window_us: (f64, f64)) {
        self.chosen.clear();
        self.spans.clear();
        let range =
            |path: &NoisePath, span: &Span| law.poles_of(path.ratio).range(span.level, span.ends, path.sigma, FAR);
        for (k, pixel) in self.pixels.iter().enumerate() {
            let path = &band.noise[pixel.i];
            let span = path.span(1 << law.levels);
            if pixel.held {
                self.chosen.push(k);
            } else if pixel.within_reach(range(path, &span), window_us) {
                self.spans.push((k, span));
            }
        }
        for _ in 0..HALVINGS {
            if self.spans.is_empty() {
                break;
            }
            // What is smooth is halved no more: pixels look for a crossing there.
            self.spans.retain(|(k, span)| {
                let pixel = &self.pixels[*k];
                let smooth = span.level >= band.noise[pixel.i].smooth(law, pixel.least_threshold);
                if smooth {
                    self.chosen.push(*k);
                }
                !smooth
            });
            let named = |(k, span): &(usize, Span)| (self.pixels[*k].number, law.node(span.cell, span.middle()));
            self.draws.make(law, self.spans.iter().map(named));
            self.halves.clear();
            for (at, (k, span)) in self.spans.iter().enumerate() {
                let pixel = &self.pixels[*k];
                let path = &band.noise[pixel.i];
                let poles = law.poles_of(path.ratio);
                let middle = poles.middle(span.level, span.ends, path.sigma, self.draws.get(at));
                for half in [span.first_half(middle), span.second_half(middle)] {
                    if pixel.within_reach(range(path, &half), window_us) {
                        self.halves.push((*k, half));
                    }
                }
            }
            std::mem::swap(&mut self.spans, &mut self.halves);
        }
        self.chosen.extend(self.spans.iter().map(|(k, _)| k));
        self.chosen.sort_unstable();
        self.chosen.dedup();
    }
}
