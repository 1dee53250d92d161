//! The rays of a camera's pixels, stored by tiles of the image.
//!
//! Rays are stored in the order in which they are processed: tile by tile, block by block, lattice ray by lattice ray.
//! They are undistorted coordinates, so the renderer knows nothing of lenses.
//!
//! What must not break: the order. A pixel's luma is added up in it, so another order changes bits.

use super::linear::Rect;
use crate::error::{Error, Result};

/// Side of a tile in pixels.
pub(super) const TILE: usize = 8;
/// Side of a block: a tile has two by two.
pub(super) const BLOCK: usize = 4;
pub(super) const BLOCKS: usize = (TILE / BLOCK) * (TILE / BLOCK);
/// Pixels of a block, which take their rays side by side.
pub(super) const LANES: usize = BLOCK * BLOCK;
/// Pixels of a tile.
pub(super) const PIXELS: usize = TILE * TILE;

const MOST_RAYS: usize = 1024;

/// Numbers whose first lies at the beginning of a line of the cache.
#[derive(Debug)]
struct Aligned {
    all: Vec<f32>,
    /// How many are left out at the beginning.
    skipped: usize,
}

impl Aligned {
    const LINE: usize = 64;

    fn with_capacity(count: usize) -> Self {
        let mut all: Vec<f32> = Vec::with_capacity(count + Self::LINE / size_of::<f32>());
        let skipped = all.as_ptr().align_offset(Self::LINE).min(Self::LINE / size_of::<f32>());
        all.resize(skipped, 0.0);
        Self { all, skipped }
    }

    fn values(&self) -> &[f32] {
        &self.all[self.skipped..]
    }
}

/// Rays that are worked on together, in blocks that follow each other and have the same number of them.
#[derive(Clone, Copy, Debug)]
pub(super) struct Part<'a> {
    pub(super) x: &'a [f32],
    pub(super) y: &'a [f32],
    /// All of them lie in it.
    pub(super) around: &'a Rect,
    /// What each block's rays lie in; [`BLOCKS`] at most.
    pub(super) blocks: &'a [Rect],
}

/// Coordinates of columns or rows of tiles.
#[derive(Debug)]
struct Reach {
    /// The lowest in each of them or any later one.
    low: Vec<f32>,
    /// The highest in each of them or any earlier one.
    high: Vec<f32>,
}

impl Reach {
    fn new(count: usize) -> Self {
        Self { low: vec![f32::INFINITY; count], high: vec![f32::NEG_INFINITY; count] }
    }
}

/// The lattice rays of all pixels as undistorted image coordinates, whatever the lens.
///
/// A tile's rays follow each other block by block; in a block ray by ray of the lattice, each for all of its pixels.
/// Where a tile reaches beyond the image, the pixel at its edge stands for those that are not there.
#[derive(Debug)]
pub struct PixelRays {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) rays: usize,
    pub(super) columns: usize,
    pub(super) rows: usize,
    x: Aligned,
    y: Aligned,
    tiles: Vec<Rect>,
    blocks: Vec<Rect>,
    pub(super) all: Rect,
    /// Of tiles' columns and rows.
    reach: [Reach; 2],
}

impl PixelRays {
    /// The rays of a sensor, from a table of (x, y) by lattice ray and pixel, row by row.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for a size out of 1..65535, another number of entries, or one that is not finite.
    pub fn new(width: usize, height: usize, rays: usize, table: &[f32]) -> Result<Self> {
        let side = 1..=65535;
        if !side.contains(&width) || !side.contains(&height) || !(1..=MOST_RAYS).contains(&rays) {
            return Err(Error::Argument(format!(
                "a sensor has 1..65535 pixels a side and 1..{MOST_RAYS} rays a pixel, got {width} x {height}, {rays}"
            )));
        }
        if table.len() != width * height * rays * 2 || !table.iter().all(|v| v.is_finite()) {
            return Err(Error::Argument(format!(
                "{width} x {height} pixels of {rays} rays need {} finite numbers, got {}",
                width * height * rays * 2,
                table.len()
            )));
        }
        let (columns, rows) = (width.div_ceil(TILE), height.div_ceil(TILE));
        let tiles = columns * rows;
        let mut new = Self {
            width,
            height,
            rays,
            columns,
            rows,
            x: Aligned::with_capacity(tiles * PIXELS * rays),
            y: Aligned::with_capacity(tiles * PIXELS * rays),
            tiles: vec![Rect::NONE; tiles],
            blocks: vec![Rect::NONE; tiles * BLOCKS],
            all: Rect::NONE,
            reach: [Reach::new(columns), Reach::new(rows)],
        };
        for tile in 0..tiles {
            for block in 0..BLOCKS {
                for ray in 0..rays {
                    for lane in 0..LANES {
                        let (column, row) = new.pixel(tile, block * LANES + lane);
                        let pixel = row.min(height - 1) * width + column.min(width - 1);
                        let at = (ray * width * height + pixel) * 2;
                        new.push(tile, block, table[at], table[at + 1]);
                    }
                }
            }
        }
        for Reach { low, high } in &mut new.reach {
            for i in 1..high.len() {
                high[i] = high[i].max(high[i - 1]);
            }
            for i in (1..low.len()).rev() {
                low[i - 1] = low[i - 1].min(low[i]);
            }
        }
        Ok(new)
    }

    /// Columns of the sensor.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows of the sensor.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// Rays of each pixel.
    #[must_use]
    pub fn rays(&self) -> usize {
        self.rays
    }

    /// Pixels of the sensor.
    #[must_use]
    pub fn pixels(&self) -> usize {
        self.width * self.height
    }

    fn push(&mut self, tile: usize, block: usize, x: f32, y: f32) {
        self.x.all.push(x);
        self.y.all.push(y);
        self.tiles[tile].add(x, y);
        self.blocks[tile * BLOCKS + block].add(x, y);
        self.all.add(x, y);
        for (axis, at, value) in [(0, tile % self.columns, x), (1, tile / self.columns, y)] {
            let Reach { low, high } = &mut self.reach[axis];
            (low[at], high[at]) = (low[at].min(value), high[at].max(value));
        }
    }

    /// Column and row of a tile's pixel, by block and lane; they may lie beyond the image.
    pub(super) fn pixel(&self, tile: usize, place: usize) -> (usize, usize) {
        let (block, lane) = (place / LANES, place % LANES);
        let per_row = TILE / BLOCK;
        (
            tile % self.columns * TILE + block % per_row * BLOCK + lane % BLOCK,
            tile / self.columns * TILE + block / per_row * BLOCK + lane / BLOCK,
        )
    }

    /// The tile of a pixel, and the pixel's place in it.
    pub(super) fn tile_of(&self, pixel: usize) -> (usize, usize) {
        let (column, row) = (pixel % self.width, pixel / self.width);
        let block = row % TILE / BLOCK * (TILE / BLOCK) + column % TILE / BLOCK;
        (row / TILE * self.columns + column / TILE, block * LANES + row % BLOCK * BLOCK + column % BLOCK)
    }

    /// A tile's rays.
    pub(super) fn of_tile(&self, tile: usize) -> Part<'_> {
        let range = tile * PIXELS * self.rays..(tile + 1) * PIXELS * self.rays;
        Part {
            x: &self.x.values()[range.clone()],
            y: &self.y.values()[range],
            around: self.tile(tile),
            blocks: &self.blocks[tile * BLOCKS..][..BLOCKS],
        }
    }

    /// Copies the rays of a pixel of a tile, in the lattice's order.
    pub(super) fn copy_pixel(&self, tile: usize, place: usize, x: &mut [f32], y: &mut [f32]) {
        let first = (tile * PIXELS + place / LANES * LANES) * self.rays + place % LANES;
        for (values, copy) in [(self.x.values(), x), (self.y.values(), y)] {
            for (to, from) in copy.iter_mut().zip(values[first..].iter().step_by(LANES)) {
                *to = *from;
            }
        }
    }

    pub(super) fn tiles(&self) -> usize {
        self.columns * self.rows
    }

    pub(super) fn tile(&self, tile: usize) -> &Rect {
        &self.tiles[tile]
    }

    /// The columns (axis 0) or rows (1) of tiles that may reach into low..high.
    pub(super) fn reaching(&self, axis: usize, low: f32, high: f32) -> std::ops::Range<usize> {
        // Both ascend. Some ten numbers are counted sooner than halved, because nothing has to be guessed.
        let Reach { low: lowest, high: highest } = &self.reach[axis];
        let first = highest.iter().map(|&x| usize::from(x < low)).sum();
        first..lowest.iter().map(|&x| usize::from(x <= high)).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[allow(clippy::cast_precision_loss, reason = "small numbers")]
    fn every_pixel_has_its_rays() {
        let (width, height, rays) = (13, 10, 3);
        let table: Vec<f32> = (0..width * height * rays * 2).map(|i| i as f32).collect();
        let all = PixelRays::new(width, height, rays, &table).unwrap();
        for pixel in 0..width * height {
            let (tile, place) = all.tile_of(pixel);
            assert_eq!(all.pixel(tile, place), (pixel % width, pixel / width));
            for ray in 0..rays {
                let at = place / LANES * LANES * rays + ray * LANES + place % LANES;
                let (x, y) = (all.of_tile(tile).x[at], all.of_tile(tile).y[at]);
                assert_eq!([x, y], table[(ray * width * height + pixel) * 2..][..2]);
                let (mut own_x, mut own_y) = (vec![0.0; all.rays], vec![0.0; all.rays]);
                all.copy_pixel(tile, place, &mut own_x, &mut own_y);
                assert_eq!((own_x[ray], own_y[ray]), (x, y));
                for part in [all.tile(tile), &all.of_tile(tile).blocks[place / LANES], &all.all] {
                    assert!(part.low[0] <= x && x <= part.high[0] && part.low[1] <= y && y <= part.high[1]);
                }
                assert!(all.reaching(0, x, x).contains(&(tile % all.columns)));
                assert!(all.reaching(1, y, y).contains(&(tile / all.columns)));
            }
        }
        assert!(PixelRays::new(width, height, rays, &table[1..]).is_err());
        assert!(PixelRays::new(0, height, rays, &[]).is_err());
        assert!(PixelRays::new(1, 1, 1, &[f32::NAN, 0.0]).is_err());
    }
}
