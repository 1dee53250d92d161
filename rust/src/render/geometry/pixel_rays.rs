//! The rays of a camera's pixels, stored by tiles of the image.
//!
//! Rays are stored in the order in which they are processed: tile by tile, block by block, lattice ray by lattice ray.
//! They are undistorted coordinates, so the renderer knows nothing of lenses. Without distortion all pixels of a column
//! have the same x, and all of a row the same y. Then only these are stored, and a tile's rays are put together when it
//! is their turn, because the rays of a large sensor would not fit into memory.
//!
//! What must not break: the order. A pixel's luma is added up in it, so another order changes bits.

use std::sync::OnceLock;

use super::curve::TileCurve;
use super::linear::Rect;
use crate::error::{Error, Result};

/// Side of a tile in pixels.
pub(crate) const TILE: usize = 8;
/// Side of a block: a tile has two by two.
pub(crate) const BLOCK: usize = 4;
pub(crate) const BLOCKS: usize = (TILE / BLOCK) * (TILE / BLOCK);
/// Pixels of a block, which take their rays side by side.
pub(crate) const LANES: usize = BLOCK * BLOCK;
/// Pixels of a tile.
pub(crate) const PIXELS: usize = TILE * TILE;

const MOST_RAYS: usize = 1024;

/// Where the corners of a pixel lie, in the order of its rays.
const CORNERS: [[f64; 2]; 4] = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];

/// Numbers whose first lies at the beginning of a line of the cache.
#[derive(Debug, Default)]
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

    /// Resizes it to so many numbers, whose values are still to be given.
    fn resized(&mut self, count: usize) -> &mut [f32] {
        if self.values().len() != count {
            *self = Self::with_capacity(count);
            self.all.resize(self.skipped + count, 0.0);
        }
        &mut self.all[self.skipped..]
    }
}

/// Where the coordinates of rays are.
#[derive(Debug)]
enum Coordinates {
    /// Of each ray, in the order of tiles.
    Rays { x: Aligned, y: Aligned },
    /// By ray of the lattice, x of each column and y of each row, with those of tiles that reach beyond the image.
    Grid { x: Vec<f32>, y: Vec<f32> },
}

/// A buffer for the rays of a tile, where they have to be put together.
#[derive(Debug, Default)]
pub(crate) struct TileRays {
    x: Aligned,
    y: Aligned,
}

/// Rays that are worked on together, in blocks that follow each other and have the same number of them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RayBlocks<'a> {
    pub(crate) x: &'a [f32],
    pub(crate) y: &'a [f32],
    /// All of them lie in it.
    pub(crate) around: &'a Rect,
    /// What each block's rays lie in; [`BLOCKS`] at most.
    pub(crate) blocks: &'a [Rect],
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
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) rays: usize,
    pub(crate) columns: usize,
    pub(crate) rows: usize,
    coordinates: Coordinates,
    tiles: Vec<Rect>,
    blocks: Vec<Rect>,
    pub(crate) all: Rect,
    /// Of tiles' columns and rows.
    reach: [Reach; 2],
    /// Of each tile, where they are asked for.
    curves: OnceLock<Vec<TileCurve>>,
}

impl PixelRays {
    /// Returns the rays of a sensor, from a table of (x, y) by lattice ray and pixel, row by row.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for a size out of 1..65535, another number of entries, or one that is not finite.
    pub fn new(width: usize, height: usize, rays: usize, table: &[f32]) -> Result<Self> {
        Self::from_parts(width, height, rays, height, |_| Ok(table))
    }

    /// Returns the rays of a sensor, from tables as those of [`Self::new`], each of so many rows of the image; the last
    /// one may have fewer. `next` gives the table that begins with a row.
    ///
    /// # Errors
    ///
    /// As [`Self::new`], for a number of rows that is no multiple of a tile's, and what `next` returns.
    pub fn from_parts<Table: AsRef<[f32]>, Failure: From<Error>>(
        width: usize,
        height: usize,
        rays: usize,
        rows: usize,
        mut next: impl FnMut(usize) -> std::result::Result<Table, Failure>,
    ) -> std::result::Result<Self, Failure> {
        check_size(width, height, rays)?;
        if rows < height && (rows == 0 || !rows.is_multiple_of(TILE)) {
            return Err(Error::Argument(format!("a part must have a multiple of {TILE} rows, got {rows}")).into());
        }
        let empty = || Aligned::with_capacity(width.div_ceil(TILE) * height.div_ceil(TILE) * PIXELS * rays);
        let mut new = Self::empty(width, height, rays, Coordinates::Rays { x: empty(), y: empty() });
        for first in (0..height).step_by(rows) {
            let rows = rows.min(height - first);
            let table = next(first)?;
            let table = table.as_ref();
            check_numbers(&format!("{width} x {rows} pixels of {rays} rays"), width * rows * rays * 2, table)?;
            for tile in first / TILE * new.columns..(first + rows).div_ceil(TILE) * new.columns {
                for block in 0..BLOCKS {
                    for ray in 0..rays {
                        for lane in 0..LANES {
                            let (column, row) = new.pixel(tile, block * LANES + lane);
                            let pixel = (row.min(height - 1) - first) * width + column.min(width - 1);
                            let at = (ray * width * rows + pixel) * 2;
                            new.push(tile, block, table[at], table[at + 1]);
                        }
                    }
                }
            }
        }
        new.spread_reach();
        Ok(new)
    }

    /// Returns the rays of a sensor without distortion: by ray of the lattice, x of each column and y of each row.
    ///
    /// # Errors
    ///
    /// As [`Self::new`].
    pub fn grid(width: usize, height: usize, rays: usize, x: &[f32], y: &[f32]) -> Result<Self> {
        check_size(width, height, rays)?;
        check_numbers(&format!("{width} columns of {rays} rays"), width * rays, x)?;
        check_numbers(&format!("{height} rows of {rays} rays"), height * rays, y)?;
        let padded = |values: &[f32], count: usize| -> Vec<f32> {
            let of_ray = |ray: &[f32]| -> Vec<f32> {
                (0..count.next_multiple_of(TILE)).map(|i| ray[i.min(count - 1)]).collect()
            };
            values.chunks_exact(count).flat_map(of_ray).collect()
        };
        let (x, y) = (padded(x, width), padded(y, height));
        let mut new = Self::empty(width, height, rays, Coordinates::Grid { x: vec![], y: vec![] });
        // What the columns and rows of blocks lie in.
        let around = |values: &[f32], count: usize| -> Vec<[f32; 2]> {
            let mut intervals = vec![[f32::INFINITY, f32::NEG_INFINITY]; count.next_multiple_of(TILE) / BLOCK];
            for ray in values.chunks_exact(count.next_multiple_of(TILE)) {
                for ([low, high], values) in intervals.iter_mut().zip(ray.chunks_exact(BLOCK)) {
                    (*low, *high) = values.iter().fold((*low, *high), |(low, high), &v| (low.min(v), high.max(v)));
                }
            }
            intervals
        };
        let (across, down) = (around(&x, width), around(&y, height));
        for tile in 0..new.tiles.len() {
            for block in 0..BLOCKS {
                let (column, row) = new.pixel(tile, block * LANES);
                let ([left, right], [top, bottom]) = (across[column / BLOCK], down[row / BLOCK]);
                new.enclose(tile, block, left, top);
                new.enclose(tile, block, right, bottom);
            }
        }
        new.coordinates = Coordinates::Grid { x, y };
        new.spread_reach();
        Ok(new)
    }

    fn empty(width: usize, height: usize, rays: usize, coordinates: Coordinates) -> Self {
        let (columns, rows) = (width.div_ceil(TILE), height.div_ceil(TILE));
        let tiles = columns * rows;
        Self {
            width,
            height,
            rays,
            columns,
            rows,
            coordinates,
            tiles: vec![Rect::NONE; tiles],
            blocks: vec![Rect::NONE; tiles * BLOCKS],
            all: Rect::NONE,
            reach: [Reach::new(columns), Reach::new(rows)],
            curves: OnceLock::new(),
        }
    }

    /// Makes what each column and row of tiles reaches what it and all before or after it reach.
    fn spread_reach(&mut self) {
        for Reach { low, high } in &mut self.reach {
            for i in 1..high.len() {
                high[i] = high[i].max(high[i - 1]);
            }
            for i in (1..low.len()).rev() {
                low[i - 1] = low[i - 1].min(low[i]);
            }
        }
    }

    /// Returns the columns of the sensor.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Returns the rows of the sensor.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// Returns the rays of each pixel.
    #[must_use]
    pub fn rays(&self) -> usize {
        self.rays
    }

    /// Returns the number of pixels of the sensor.
    #[must_use]
    pub fn pixels(&self) -> usize {
        self.width * self.height
    }

    /// Returns the width and height of a pixel in undistorted coordinates, of rays through pixels' upper left and lower
    /// right corners on a sensor without distortion.
    pub(crate) fn pitch(&self) -> [f64; 2] {
        let size = [self.width, self.height];
        [0, 1].map(|axis| {
            #[allow(clippy::cast_precision_loss, reason = "a side has at most 65535 pixels")]
            let pixels = size[axis] as f64;
            (f64::from(self.all.high[axis]) - f64::from(self.all.low[axis])) / pixels
        })
    }

    /// Returns whether these are pixels' corners as lines take them: by columns and rows the upper left and the lower
    /// right one, see [`Self::pitch`], or all four of each pixel, see [`Self::curve`].
    pub(crate) fn are_corners(&self) -> bool {
        self.rays == if self.is_grid() { 2 } else { CORNERS.len() }
    }

    /// Returns whether they are given by columns and rows.
    pub(crate) fn is_grid(&self) -> bool {
        matches!(self.coordinates, Coordinates::Grid { .. })
    }

    /// Returns how a tile lies in undistorted coordinates, of rays through pixels' upper left, upper right, lower left
    /// and lower right corners.
    pub(crate) fn curve(&self, tile: usize) -> &TileCurve {
        &self.curves.get_or_init(|| (0..self.tiles()).map(|tile| self.fitted(tile)).collect())[tile]
    }

    /// Fits a tile's curve to the corners of the 8 x 8 pixels of the image that are nearest to it: at the image's right
    /// and lower end these begin before the tile, so that there are enough.
    #[allow(clippy::cast_precision_loss, reason = "small numbers")]
    fn fitted(&self, tile: usize) -> TileCurve {
        let corner = [tile % self.columns * TILE, tile / self.columns * TILE];
        let first = [corner[0].min(self.width.saturating_sub(TILE)), corner[1].min(self.height.saturating_sub(TILE))];
        let (end_column, end_row) = ((first[0] + TILE).min(self.width), (first[1] + TILE).min(self.height));
        let pixels = (first[1]..end_row).flat_map(|row| (first[0]..end_column).map(move |column| [column, row]));
        TileCurve::fit(pixels.flat_map(|[column, row]| {
            let (of, in_tile) = self.tile_of(row * self.width + column);
            let (mut x, mut y) = ([0.0; CORNERS.len()], [0.0; CORNERS.len()]);
            self.copy_pixel(of, in_tile, &mut x, &mut y);
            std::array::from_fn::<_, { CORNERS.len() }, _>(|i| {
                let from_middle =
                    |at: usize, axis: usize| at as f64 + CORNERS[i][axis] - corner[axis] as f64 - (TILE / 2) as f64;
                [from_middle(column, 0), from_middle(row, 1), f64::from(x[i]), f64::from(y[i])]
            })
        }))
    }

    fn push(&mut self, tile: usize, block: usize, x: f32, y: f32) {
        if let Coordinates::Rays { x: all_x, y: all_y } = &mut self.coordinates {
            all_x.all.push(x);
            all_y.all.push(y);
        }
        self.enclose(tile, block, x, y);
    }

    /// Takes a point into what a tile's block, and all around it, lie in.
    fn enclose(&mut self, tile: usize, block: usize, x: f32, y: f32) {
        self.tiles[tile].add(x, y);
        self.blocks[tile * BLOCKS + block].add(x, y);
        self.all.add(x, y);
        for (axis, at, value) in [(0, tile % self.columns, x), (1, tile / self.columns, y)] {
            let Reach { low, high } = &mut self.reach[axis];
            (low[at], high[at]) = (low[at].min(value), high[at].max(value));
        }
    }

    /// Returns column and row of a tile's pixel, by block and lane; they may lie beyond the image.
    pub(crate) fn pixel(&self, tile: usize, in_tile: usize) -> (usize, usize) {
        let (block, lane) = (in_tile / LANES, in_tile % LANES);
        let per_row = TILE / BLOCK;
        (
            tile % self.columns * TILE + block % per_row * BLOCK + lane % BLOCK,
            tile / self.columns * TILE + block / per_row * BLOCK + lane / BLOCK,
        )
    }

    /// Returns the tile of a pixel, and the pixel's index in it.
    pub(crate) fn tile_of(&self, pixel: usize) -> (usize, usize) {
        let (column, row) = (pixel % self.width, pixel / self.width);
        let block = row % TILE / BLOCK * (TILE / BLOCK) + column % TILE / BLOCK;
        (row / TILE * self.columns + column / TILE, block * LANES + row % BLOCK * BLOCK + column % BLOCK)
    }

    /// Returns a tile's rays, which may be put together in a buffer.
    pub(crate) fn of_tile<'a>(&'a self, tile: usize, buffer: &'a mut TileRays) -> RayBlocks<'a> {
        let count = PIXELS * self.rays;
        let (x, y) = match &self.coordinates {
            Coordinates::Rays { x, y } => {
                let range = tile * count..(tile + 1) * count;
                (&x.values()[range.clone()], &y.values()[range])
            }
            Coordinates::Grid { x, y } => {
                let (to_x, to_y) = (buffer.x.resized(count), buffer.y.resized(count));
                let mut groups = to_x.chunks_exact_mut(LANES).zip(to_y.chunks_exact_mut(LANES));
                for block in 0..BLOCKS {
                    let (column, row) = self.pixel(tile, block * LANES);
                    let of_rays = x.chunks_exact(self.columns * TILE).zip(y.chunks_exact(self.rows * TILE));
                    for ((x, y), (to_x, to_y)) in of_rays.zip(&mut groups) {
                        let (x, y) = (&x[column..column + BLOCK], &y[row..row + BLOCK]);
                        for (line, &y) in y.iter().enumerate() {
                            to_x[line * BLOCK..][..BLOCK].copy_from_slice(x);
                            to_y[line * BLOCK..][..BLOCK].fill(y);
                        }
                    }
                }
                (&*to_x, &*to_y)
            }
        };
        RayBlocks { x, y, around: self.tile(tile), blocks: &self.blocks[tile * BLOCKS..][..BLOCKS] }
    }

    /// Copies the rays of a pixel of a tile, in the lattice's order.
    pub(crate) fn copy_pixel(&self, tile: usize, in_tile: usize, x: &mut [f32], y: &mut [f32]) {
        match &self.coordinates {
            Coordinates::Rays { x: all_x, y: all_y } => {
                let first = (tile * PIXELS + in_tile / LANES * LANES) * self.rays + in_tile % LANES;
                for (values, copy) in [(all_x.values(), x), (all_y.values(), y)] {
                    for (to, from) in copy.iter_mut().zip(values[first..].iter().step_by(LANES)) {
                        *to = *from;
                    }
                }
            }
            Coordinates::Grid { x: all_x, y: all_y } => {
                let (column, row) = self.pixel(tile, in_tile);
                for (ray, (x, y)) in x.iter_mut().zip(y).enumerate() {
                    (*x, *y) = (all_x[ray * self.columns * TILE + column], all_y[ray * self.rows * TILE + row]);
                }
            }
        }
    }

    pub(crate) fn tiles(&self) -> usize {
        self.columns * self.rows
    }

    pub(crate) fn tile(&self, tile: usize) -> &Rect {
        &self.tiles[tile]
    }

    /// Returns the columns (axis 0) or rows (1) of tiles that may reach into low..high.
    pub(crate) fn reaching(&self, axis: usize, low: f32, high: f32) -> std::ops::Range<usize> {
        // Both ascend. Some ten numbers are counted sooner than halved, because nothing has to be guessed.
        let Reach { low: lowest, high: highest } = &self.reach[axis];
        let first = highest.iter().map(|&x| usize::from(x < low)).sum();
        first..lowest.iter().map(|&x| usize::from(x <= high)).sum()
    }
}

/// Refuses what is no sensor.
fn check_size(width: usize, height: usize, rays: usize) -> Result<()> {
    let side = 1..=65535;
    if side.contains(&width) && side.contains(&height) && (1..=MOST_RAYS).contains(&rays) {
        return Ok(());
    }
    Err(Error::Argument(format!(
        "a sensor has 1..65535 pixels a side and 1..{MOST_RAYS} rays a pixel, got {width} x {height}, {rays}"
    )))
}

/// Refuses another number of coordinates, and those that are not finite.
fn check_numbers(what: &str, count: usize, numbers: &[f32]) -> Result<()> {
    if numbers.len() == count && numbers.iter().all(|v| v.is_finite()) {
        return Ok(());
    }
    Err(Error::Argument(format!("{what} need {count} finite numbers, got {}", numbers.len())))
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
            let (tile, in_tile) = all.tile_of(pixel);
            assert_eq!(all.pixel(tile, in_tile), (pixel % width, pixel / width));
            for ray in 0..rays {
                let at = in_tile / LANES * LANES * rays + ray * LANES + in_tile % LANES;
                let mut buffer = TileRays::default();
                let ray_blocks = all.of_tile(tile, &mut buffer);
                let (x, y) = (ray_blocks.x[at], ray_blocks.y[at]);
                assert_eq!([x, y], table[(ray * width * height + pixel) * 2..][..2]);
                let (mut own_x, mut own_y) = (vec![0.0; all.rays], vec![0.0; all.rays]);
                all.copy_pixel(tile, in_tile, &mut own_x, &mut own_y);
                assert_eq!((own_x[ray], own_y[ray]), (x, y));
                for rect in [all.tile(tile), &ray_blocks.blocks[in_tile / LANES], &all.all] {
                    assert!(rect.low[0] <= x && x <= rect.high[0] && rect.low[1] <= y && y <= rect.high[1]);
                }
                assert!(all.reaching(0, x, x).contains(&(tile % all.columns)));
                assert!(all.reaching(1, y, y).contains(&(tile / all.columns)));
            }
        }
        assert!(PixelRays::new(width, height, rays, &table[1..]).is_err());
        assert!(PixelRays::new(0, height, rays, &[]).is_err());
        assert!(PixelRays::new(1, 1, 1, &[f32::NAN, 0.0]).is_err());
    }

    /// A sensor without distortion by columns and rows, by pixels, and by pixels in parts: all are the same to the bit.
    #[test]
    #[allow(clippy::cast_precision_loss, reason = "small numbers")]
    fn a_grid_is_the_table_that_it_stands_for() {
        let (width, height, rays) = (21, 18, 3);
        let x: Vec<f32> =
            (0..rays * width).map(|i| ((i % width) as f32 + 0.3 * (i / width) as f32 - 9.7) / 7.1).collect();
        let y: Vec<f32> = (0..rays * height).map(|i| ((i % height) as f32 - 0.2 * (i / height) as f32) / 6.9).collect();
        let rows_of = |first: usize, rows: usize| -> Vec<f32> {
            (0..rays * rows * width)
                .flat_map(|i| {
                    let (ray, row, column) = (i / width / rows, i / width % rows, i % width);
                    [x[ray * width + column], y[ray * height + first + row]]
                })
                .collect()
        };
        let grid = PixelRays::grid(width, height, rays, &x, &y).unwrap();
        let table = PixelRays::new(width, height, rays, &rows_of(0, height)).unwrap();
        let band = |first: usize| Ok::<_, Error>(rows_of(first, 8.min(height - first)));
        let from_tables = PixelRays::from_parts(width, height, rays, 8, band).unwrap();
        for other in [&table, &from_tables] {
            for tile in 0..grid.tiles() {
                let (mut buffer, mut other_buffer) = (TileRays::default(), TileRays::default());
                let (one, two) = (grid.of_tile(tile, &mut buffer), other.of_tile(tile, &mut other_buffer));
                assert_eq!((one.x, one.y), (two.x, two.y));
                assert_eq!(format!("{:?}{:?}", one.around, one.blocks), format!("{:?}{:?}", two.around, two.blocks));
                for in_tile in 0..PIXELS {
                    let (mut own, mut others) = ([[0.0; 3]; 2], [[0.0; 3]; 2]);
                    let ([x, y], [other_x, other_y]) = (&mut own, &mut others);
                    grid.copy_pixel(tile, in_tile, x, y);
                    other.copy_pixel(tile, in_tile, other_x, other_y);
                    assert_eq!(own, others);
                }
            }
            assert_eq!(format!("{:?}{:?}", grid.all, grid.reach), format!("{:?}{:?}", other.all, other.reach));
        }
        assert!(PixelRays::grid(width, height, rays, &x[1..], &y).is_err());
        assert!(PixelRays::from_parts(width, height, rays, 4, band).is_err());
    }
}
