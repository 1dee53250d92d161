//! The renderer that users see: luma, single pixels, depths and triangles of many views, on threads.
//!
//! It checks arguments, sets up each view and gives tiles to threads.
//!
//! What must not break: a pixel depends only on its view and its rays, not on other views, other pixels, threads or the
//! processor. Arguments are checked before work begins.

use std::sync::Mutex;

use rayon::prelude::*;

use super::geometry::pixel_rays::{BLOCK, PIXELS, PixelRays, TILE};
use super::geometry::view::View;
use super::gloss::pattern::Pattern;
use super::light::cone::FrameCones;
use super::light::lights::{SeenLight, Surroundings, background, seen_lights};
use super::light::shader::Shaders;
use super::light::shadows::{moving_cones, still_cones};
use super::lines::pattern::LinePattern;
use super::samples::{self, Pixels, Sample, in_one_spot};
use super::scene::Scene;
use super::tile::{self, TileImage, TileScratch, TileView, Ways};
use super::visibility::bins::Bins;
use super::visibility::distance::nearest_distance;
use super::visibility::first_hit::depths_in;
use super::visibility::nearest::NOTHING;
use crate::error::{Error, Result};
use crate::threads::{SHARED, Threads};

/// The triangle index of a miss.
pub const NO_TRIANGLE: u32 = NOTHING;

/// Renders a scene through any camera's rays.
///
/// A pixel depends on its view and its rays alone: not on the other views or pixels, the threads or the processor.
#[derive(Debug)]
pub struct Renderer {
    pub(crate) scene: Scene,
    still: FrameCones,
    threads: Option<Threads>,
    view_buffers: Spares<ViewBuffers>,
    scratch: Spares<TileScratch>,
    pixels: Spares<Pixels>,
    ways: Ways,
}

/// How many views are done band by band together, at most, and how many triangles they may have in all.
const MOST_TOGETHER: usize = 8;
const MOST_TRIANGLES_TOGETHER: usize = 1 << 15;

/// Scenes of so many triangles are looked through by each tile from front to back. Smaller ones have triangles that
/// cover many rays: to set up each once for all tiles of a view takes less time.
const SMALL: usize = 1 << 16;

/// In scenes of so many triangles, tiles that see more than [`MANY_RECEIVERS`] of them find shadows by rays: what may
/// hide all of these would be a long list.
const MANY: usize = 1 << 13;
const MANY_RECEIVERS: usize = 8;

/// How many views a thread takes at a time where single pixels are wanted.
const VIEWS_OF_SAMPLES: usize = 16;

/// What is made ready for a view before its tiles.
#[derive(Debug, Default)]
struct ViewBuffers {
    bins: Bins,
    cones: Vec<FrameCones>,
}

/// Rooms for work, used again and again: never more than there were threads at once.
#[derive(Debug, Default)]
struct Spares<T>(Mutex<Vec<T>>);

impl<T: Default> Spares<T> {
    fn take(&self) -> T {
        self.0.lock().map(|mut spares| spares.pop()).unwrap_or_default().unwrap_or_default()
    }

    fn give(&self, buffers: T) {
        if let Ok(mut spares) = self.0.lock() {
            spares.push(buffers);
        }
    }
}

impl Renderer {
    /// Returns a renderer of a scene, on its own threads where their number is given.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for 0 threads, or for more than the system allows.
    pub fn new(scene: Scene, threads: Option<usize>) -> Result<Self> {
        let threads = threads.map(Threads::start).transpose()?;
        let still = still_cones(&scene);
        let (view_buffers, scratch, pixels) = (Spares::default(), Spares::default(), Spares::default());
        let receivers = if scene.triangles() >= MANY { MANY_RECEIVERS } else { usize::MAX };
        let ways = Ways { beams: scene.triangles() >= SMALL, receivers };
        Ok(Self { scene, still, threads, view_buffers, scratch, pixels, ways })
    }

    /// Returns the scene.
    #[must_use]
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Returns how many threads of its own it has; none where it takes all that there are.
    #[must_use]
    pub fn threads(&self) -> Option<usize> {
        self.threads.as_ref().and_then(Threads::count)
    }

    /// Renders luma of frames, row by row, one view after the other; and its rate per second where a buffer for it is
    /// given.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for views of another scene, or a buffer of another length.
    pub fn luma(&self, rays: &PixelRays, views: &[View], luma: &mut [f32], rate: Option<&mut [f32]>) -> Result<()> {
        let views = &self.centred(views)?;
        check_length(views.len() * rays.pixels(), luma.len())?;
        match rate {
            None => self.each_tile(
                self.ways,
                rays,
                views,
                bands(rays, luma),
                |tile_view, tile, (scratch, shaders), image, band| {
                    tile::luma::<false>(tile_view, tile, scratch, shaders, image);
                    put(rays, tile, &image.luma, band);
                },
            ),
            Some(rate) => {
                check_length(luma.len(), rate.len())?;
                let both = bands(rays, luma).into_iter().zip(bands(rays, rate)).collect();
                self.each_tile(
                    self.ways,
                    rays,
                    views,
                    both,
                    |tile_view, tile, (scratch, shaders), image, (luma, rate)| {
                        tile::luma::<true>(tile_view, tile, scratch, shaders, image);
                        put(rays, tile, &image.luma, luma);
                        put(rays, tile, &image.rate, rate);
                    },
                )
            }
        }
    }

    /// Renders luma of single pixels: `pixels` are numbers of a view and of a pixel in it, row by row.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for views of another scene, pixels or views that are not there, or a buffer of another
    /// length.
    pub fn samples(&self, rays: &PixelRays, views: &[View], pixels: &[(u32, u32)], luma: &mut [f32]) -> Result<()> {
        self.each_pixel(rays, views, pixels, luma, |view, samples, values| {
            self.each_of(rays, view, samples, |tile_view, tile, some, scratch| {
                tile::samples(tile_view, tile, some, scratch, values);
            });
        })
    }

    /// Renders luma of frames as [`Self::luma`] does, by the lines that pass through each pixel. `corners` has the rays of
    /// pixels' corners: by columns and rows two a pixel, the upper left and the lower right one; else all four, row by row.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] as for [`Self::luma`], or for other rays.
    pub fn line_luma(
        &self,
        corners: &PixelRays,
        pattern: &LinePattern,
        views: &[View],
        luma: &mut [f32],
    ) -> Result<()> {
        check_corners(corners)?;
        self.check_diffuse("lines through pixels")?;
        let views = &self.centred(views)?;
        check_length(views.len() * corners.pixels(), luma.len())?;
        self.each_tile(Ways { beams: false, ..self.ways }, corners, views, bands(corners, luma), {
            |tile_view, tile, (scratch, shaders), image, band| {
                tile::lines(tile_view, pattern, tile, scratch, shaders, image);
                put(corners, tile, &image.luma, band);
            }
        })
    }

    /// Renders luma of single pixels as [`Self::samples`] does, by lines as in [`Self::line_luma`]: the same bits.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] as for [`Self::samples`], or for other rays.
    pub fn line_samples(
        &self,
        corners: &PixelRays,
        pattern: &LinePattern,
        views: &[View],
        pixels: &[(u32, u32)],
        luma: &mut [f32],
    ) -> Result<()> {
        check_corners(corners)?;
        self.check_diffuse("lines through pixels")?;
        self.each_pixel(corners, views, pixels, luma, |view, samples, values| {
            let lights = seen_lights(&self.scene, view);
            let (mut buffers, mut scratch) = (self.view_buffers.take(), self.scratch.take());
            let ViewBuffers { bins, cones } = &mut buffers;
            // Samples are sorted by tile.
            let single = samples[0].tile == samples[samples.len() - 1].tile;
            if single {
                bins.fill_rect(&self.scene, view, corners.tile(samples[0].tile));
            } else {
                bins.fill(&self.scene, view, corners, Some(&tiles_of(corners, samples)));
            }
            let tile_view = self.tile_view(corners, view, &lights, bins, cones);
            for some in samples.chunk_by(|a, b| a.tile == b.tile) {
                let tile = some[0].tile;
                let number = if single { 0 } else { tile };
                let pixels = some.iter().fold(0, |pixels, sample| pixels | 1 << sample.in_tile);
                let luma = tile::line_samples(&tile_view, pattern, (number, tile), pixels, &mut scratch);
                values.extend(some.iter().map(|sample| luma[sample.in_tile]));
            }
            self.view_buffers.give(buffers);
            self.scratch.give(scratch);
        })
    }

    /// Returns what single rays hit: of each pixel, a view and a pixel in it as in [`Self::samples`], the depth and the
    /// triangle as in [`Self::depth`].
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] as for [`Self::samples`], or for another number of rays a pixel than one.
    pub fn hits(&self, rays: &PixelRays, views: &[View], pixels: &[(u32, u32)], hits: &mut [(f32, u32)]) -> Result<()> {
        check_one_ray(rays)?;
        self.each_pixel(rays, views, pixels, hits, |view, samples, values| {
            self.each_of(rays, view, samples, |tile_view, tile, some, scratch| {
                tile::hits(tile_view, tile, some, scratch, |hit| {
                    values.push(match hit {
                        None => (f32::INFINITY, NO_TRIANGLE),
                        Some((inverse, triangle)) => (1.0 / inverse, self.scene.surfaces[triangle as usize].number),
                    });
                });
            });
        })
    }

    /// Does single pixels view by view, and puts what is found in the order of the pixels.
    fn each_pixel<T: Copy + Send>(
        &self,
        rays: &PixelRays,
        views: &[View],
        pixels: &[(u32, u32)],
        values: &mut [T],
        work: impl Fn(&View, &[Sample], &mut Vec<T>) + Sync,
    ) -> Result<()> {
        let views = &self.centred(views)?;
        check_length(pixels.len(), values.len())?;
        let size = rays.width * rays.height;
        if let Some((view, pixel)) = pixels.iter().find(|(v, p)| *v as usize >= views.len() || *p as usize >= size) {
            return Err(Error::Argument(if *view as usize >= views.len() {
                format!("view {view} is outside of the {} views", views.len())
            } else {
                format!("pixel {pixel} is outside of the view's {size}")
            }));
        }
        let order = samples::sorted(rays, views.len(), pixels);
        let of_views: Vec<&[Sample]> = order.chunk_by(|a, b| a.view == b.view).collect();
        let in_order: Vec<Vec<T>> = self.install(|| {
            let of_thread = of_views.par_chunks(VIEWS_OF_SAMPLES).map(|some| {
                let mut values = vec![];
                for samples in some {
                    work(&views[samples[0].view as usize], samples, &mut values);
                }
                values
            });
            of_thread.collect()
        })?;
        for (sample, value) in order.iter().zip(in_order.iter().flatten()) {
            values[sample.index] = *value;
        }
        Ok(())
    }

    /// Finds for each ray, of one a pixel: its depth, inf where it hits nothing; and the number in its tables of the
    /// triangle that it hits, `NO_TRIANGLE` for none.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] as for [`Self::luma`], or for another number of rays a pixel than one.
    pub fn depth(&self, rays: &PixelRays, views: &[View], depth: &mut [f32], triangles: &mut [u32]) -> Result<()> {
        let views = &self.centred(views)?;
        check_length(views.len() * rays.pixels(), depth.len())?;
        check_length(depth.len(), triangles.len())?;
        check_one_ray(rays)?;
        let both = bands(rays, depth).into_iter().zip(bands(rays, triangles)).collect();
        self.each_tile(self.ways, rays, views, both, |tile_view, tile, (scratch, _), _, (depth, triangles)| {
            let (mut depths, mut hit) = ([f32::INFINITY; PIXELS], [NO_TRIANGLE; PIXELS]);
            tile::nearest(tile_view, tile, scratch, |ray, inverse, triangle| {
                depths[ray] = 1.0 / inverse;
                hit[ray] = self.scene.surfaces[triangle as usize].number;
            });
            put(rays, tile, &depths, depth);
            put(rays, tile, &hit, triangles);
        })
    }

    /// Returns the least and the largest depth of triangles in parts of the image, whatever hides them, for each view; NaN
    /// where the camera surely sees none. A part is the lowest and the highest x and y of rays (x, y, 1) in camera axes.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for views as for [`Self::luma`].
    pub fn depths_in_parts(&self, parts: &[[[f64; 2]; 2]], views: &[View]) -> Result<Vec<[f64; 2]>> {
        let views = &self.centred(views)?;
        self.install(|| {
            let of_view = |view| {
                parts.par_iter().map_init(Vec::new, move |stack, part| {
                    depths_in(&self.scene, view, part, stack).unwrap_or([f64::NAN; 2])
                })
            };
            views.par_iter().flat_map(of_view).collect()
        })
    }

    /// Returns how far the nearest triangle of the world's frame is from a point, in any direction: metres, infinite
    /// where there is none.
    #[must_use]
    pub fn nearest_distance(&self, point: [f64; 3]) -> f64 {
        nearest_distance(&self.scene, point)
    }

    /// Refuses a scene with glossy surfaces, for what knows diffuse ones alone.
    pub(crate) fn check_diffuse(&self, what: &str) -> Result<()> {
        if self.scene.gloss.is_none() {
            return Ok(());
        }
        Err(Error::Argument(format!(
            "{what} need a scene of diffuse surfaces, and this one has glossy ones: --matte (matte=True) takes their \
             diffuse colours alone"
        )))
    }

    /// Refuses a scene with glossy surfaces or normal textures, for what knows neither.
    pub(crate) fn check_plain(&self, what: &str) -> Result<()> {
        if self.scene.normal_textures.is_empty() {
            return self.check_diffuse(what);
        }
        Err(Error::Argument(format!(
            "{what} need a scene without normal textures, and this one has some: --matte (matte=True) leaves them out"
        )))
    }

    pub(crate) fn centred(&self, views: &[View]) -> Result<Vec<View>> {
        let (frames, lights) = (self.scene.frames(), self.scene.lights());
        match views.iter().find(|view| view.poses.len() != frames || view.factors.len() != lights) {
            None => Ok(views.iter().map(|view| self.scene.centred(view)).collect()),
            Some(view) => Err(Error::Argument(format!(
                "a view of this scene has {frames} poses and {lights} lights, got {} and {}",
                view.poses.len(),
                view.factors.len()
            ))),
        }
    }

    /// Does work on the renderer's threads, or else on those that all share.
    pub(crate) fn install<R: Send>(&self, work: impl FnOnce() -> R + Send) -> Result<R> {
        Ok(self.threads.as_ref().unwrap_or(&SHARED).pool()?.install(work))
    }

    /// Does all tiles of all views, given the bands of their frames: several views side by side, or where they are few
    /// each on all threads.
    fn each_tile<T: Send>(
        &self,
        ways: Ways,
        rays: &PixelRays,
        views: &[View],
        mut bands: Vec<T>,
        work: impl for<'v> Fn(&TileView<'v>, usize, (&mut TileScratch, &mut Shaders<'v>), &mut TileImage, &mut T)
        + Sync
        + Send,
    ) -> Result<()> {
        let do_band = |tile_view: &TileView, row: usize, scratch: &mut TileScratch, band: &mut T| {
            let (mut image, mut shaders) = (TileImage::BLACK, Shaders::default());
            for column in 0..rays.columns {
                work(tile_view, row * rays.columns + column, (scratch, &mut shaders), &mut image, band);
            }
        };
        let do_views = |views: &[View], bands: &mut [T]| {
            let mut scratch = self.scratch.take();
            self.with_views(ways, rays, views, |tile_views| {
                for row in 0..rays.rows {
                    for (view, tile_view) in tile_views.iter().enumerate() {
                        do_band(tile_view, row, &mut scratch, &mut bands[view * rays.rows + row]);
                    }
                }
            });
            self.scratch.give(scratch);
        };
        if self.threads() == Some(1) {
            // The caller's own: to hand a small image to another thread and to wait for it may take longer than to do it.
            let together = self.together();
            for (views, bands) in views.chunks(together).zip(bands.chunks_mut(together * rays.rows)) {
                do_views(views, bands);
            }
            return Ok(());
        }
        self.install(|| {
            let threads = rayon::current_num_threads();
            if views.len() < 4 * threads && threads > 1 {
                for (view, bands) in views.iter().zip(bands.chunks_mut(rays.rows)) {
                    self.with_views(ways, rays, std::slice::from_ref(view), |tile_views| {
                        bands.par_iter_mut().enumerate().for_each(|(row, band)| {
                            let mut scratch = self.scratch.take();
                            do_band(&tile_views[0], row, &mut scratch, band);
                            self.scratch.give(scratch);
                        });
                    });
                }
                return;
            }
            // Two chunks a thread at least: one that is slowed down by others then leaves some of its views to the
            // rest.
            let together = self.together().min(views.len().div_ceil(2 * threads)).max(1);
            views
                .par_chunks(together)
                .zip(bands.par_chunks_mut(together * rays.rows))
                .for_each(|(views, bands)| do_views(views, bands));
        })
    }

    /// Returns of how many views one thread does a band before it goes on to the next. They see nearly the same there,
    /// so that its rays and texels are still in the caches; but what was made ready for each must be there too.
    fn together(&self) -> usize {
        (MOST_TRIANGLES_TOGETHER / self.scene.triangles().max(1)).clamp(1, MOST_TOGETHER)
    }

    /// Makes views ready.
    fn with_views(&self, ways: Ways, rays: &PixelRays, views: &[View], work: impl FnOnce(&[TileView])) {
        let lights: Vec<_> = views.iter().map(|view| seen_lights(&self.scene, view)).collect();
        let mut view_buffers: Vec<ViewBuffers> = views.iter().map(|_| self.view_buffers.take()).collect();
        let ready: Vec<TileView> = views
            .iter()
            .zip(&lights)
            .zip(&mut view_buffers)
            .map(|((view, lights), ViewBuffers { bins, cones })| {
                if !ways.beams {
                    bins.fill(&self.scene, view, rays, None);
                }
                TileView { ways, ..self.tile_view(rays, view, lights, bins, cones) }
            })
            .collect();
        work(&ready);
        drop(ready);
        for buffers in view_buffers {
            self.view_buffers.give(buffers);
        }
    }

    /// Makes a view ready whose bins are filled.
    fn tile_view<'a>(
        &'a self,
        rays: &'a PixelRays,
        view: &'a View,
        lights: &'a [SeenLight],
        bins: &'a Bins,
        cones: &'a mut Vec<FrameCones>,
    ) -> TileView<'a> {
        moving_cones(&self.scene, view, lights, cones);
        let lit = Surroundings { scene: &self.scene, view, lights, still: &self.still, moving: cones };
        TileView {
            rays,
            lit,
            background: background(&self.scene, view),
            bins,
            ways: Ways { beams: false, ..self.ways },
            pattern: self.scene.gloss.as_ref().map(|_| Pattern::new(rays.rays())),
        }
    }

    /// Does the tiles that hold pixels of one view, sorted by tile; a tile's pixels are gathered.
    fn each_of(
        &self,
        rays: &PixelRays,
        view: &View,
        samples: &[Sample],
        mut work: impl FnMut(&TileView, usize, &Pixels, &mut TileScratch),
    ) {
        let lights = seen_lights(&self.scene, view);
        let (mut buffers, mut scratch, mut pixels) =
            (self.view_buffers.take(), self.scratch.take(), self.pixels.take());
        let ViewBuffers { bins, cones } = &mut buffers;
        if in_one_spot(rays, samples) {
            pixels.gather(rays, samples);
            bins.fill_rect(&self.scene, view, pixels.around());
            let tile_view = self.tile_view(rays, view, &lights, bins, cones);
            work(&tile_view, 0, &pixels, &mut scratch);
        } else {
            bins.fill(&self.scene, view, rays, Some(&tiles_of(rays, samples)));
            let tile_view = self.tile_view(rays, view, &lights, bins, cones);
            for tile in samples.chunk_by(|a, b| a.tile == b.tile) {
                pixels.gather(rays, tile);
                work(&tile_view, tile[0].tile, &pixels, &mut scratch);
            }
        }
        self.view_buffers.give(buffers);
        self.scratch.give(scratch);
        self.pixels.give(pixels);
    }
}

/// Returns the bands of frames that lie one after the other: rows of tiles.
fn bands<'a, T>(rays: &PixelRays, frames: &'a mut [T]) -> Vec<&'a mut [T]> {
    frames.chunks_mut(rays.pixels()).flat_map(|frame| frame.chunks_mut(rays.width * TILE)).collect()
}

/// Marks the tiles that samples lie in.
fn tiles_of(rays: &PixelRays, samples: &[Sample]) -> Vec<bool> {
    let mut marked = vec![false; rays.tiles()];
    for sample in samples {
        marked[sample.tile] = true;
    }
    marked
}

fn check_one_ray(rays: &PixelRays) -> Result<()> {
    if rays.rays == 1 {
        return Ok(());
    }
    Err(Error::Argument(format!("triangle hits need exactly one ray a pixel, got {}", rays.rays)))
}

fn check_corners(rays: &PixelRays) -> Result<()> {
    if rays.are_corners() {
        return Ok(());
    }
    Err(Error::Argument(format!(
        "lines need the corners of pixels, {} a pixel, got {} rays",
        if rays.is_grid() { "a grid of 2" } else { "4 rays" },
        rays.rays
    )))
}

/// Puts a tile's pixels where they belong in its band of rows.
fn put<T: Copy>(rays: &PixelRays, tile: usize, pixels: &[T; PIXELS], band: &mut [T]) {
    let top = tile / rays.columns * TILE;
    for (at, some) in pixels.chunks_exact(BLOCK).enumerate() {
        // Rows of a block, which lie side by side in the image too.
        let (column, row) = rays.pixel(tile, at * BLOCK);
        if row < rays.height && column < rays.width {
            let count = BLOCK.min(rays.width - column);
            let first = (row - top) * rays.width + column;
            band[first..first + count].copy_from_slice(&some[..count]);
        }
    }
}

pub(crate) fn check_length(expected: usize, got: usize) -> Result<()> {
    if expected == got {
        Ok(())
    } else {
        Err(Error::Argument(format!("a buffer must have length {expected}, got {got}")))
    }
}

#[cfg(test)]
#[allow(clippy::cast_precision_loss, clippy::cast_possible_truncation, reason = "small numbers")]
mod tests {
    use super::super::geometry::vector::sub;
    use super::super::{Emission, Light, LightKind, Pose, SceneTables};
    use super::*;

    /// Numbers in -1..1 that are the same everywhere.
    struct Numbers(u64);

    impl Numbers {
        fn next(&mut self) -> f64 {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (self.0 >> 40) as f64 / f64::from(1 << 23) - 1.0
        }

        fn vector(&mut self, scale: f64) -> [f64; 3] {
            std::array::from_fn(|_| scale * self.next())
        }
    }

    /// Returns a wall, and before it many triangles: every second one moves, every third one is smooth.
    fn tables(numbers: &mut Numbers, count: usize) -> SceneTables<'static> {
        let mut tables = SceneTables {
            frame_count: 2,
            layouts: vec![[0, 3, 2, 0], [20, 1, 1, 1], [29, 2, 2, 2]],
            texels: (0..2).map(|_| (0..45).map(|_| numbers.next().abs() as f32).collect()).collect(),
            lights: vec![
                Light {
                    kind: LightKind::Point([1.0, -2.0, -1.0]),
                    group: 0,
                    strength: 9.0,
                    background: 0.0,
                    beam: None,
                    slide: None,
                },
                Light {
                    kind: LightKind::Directional([0.0, 0.6, 0.8]),
                    group: 1,
                    strength: 2.0,
                    background: 0.0,
                    beam: None,
                    slide: None,
                },
                Light { kind: LightKind::Constant, group: 0, strength: 0.1, background: 0.5, beam: None, slide: None },
            ],
            shadows: true,
            step: 1000.0 / f64::from(1 << 24),
            end: 0.999,
            ..SceneTables::default()
        };
        for i in 0..count {
            let middle: [f64; 3] = numbers.vector(1.0);
            let corners: [[f64; 3]; 3] = std::array::from_fn(|k| {
                let away: [f64; 3] = numbers.vector(0.25);
                match i {
                    0 => [[-9.0, -9.0, 3.0], [9.0, -9.0, 3.0], [0.0, 18.0, 3.0]][k],
                    _ => std::array::from_fn(|j| middle[j] + away[j]),
                }
            });
            let [a, b, c] = corners;
            let [u, v]: [[f64; 3]; 2] = [std::array::from_fn(|j| b[j] - a[j]), std::array::from_fn(|j| c[j] - a[j])];
            let n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
            let length = (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt();
            let n = n.map(|x| x / length);
            tables.planes.to_mut().push([n[0], n[1], n[2], -(n[0] * a[0] + n[1] * a[1] + n[2] * a[2])]);
            tables.corners.to_mut().push(corners);
            let mut map = || -> [f64; 4] { std::array::from_fn(|_| numbers.next()) };
            tables.u_maps.to_mut().push(map());
            tables.v_maps.to_mut().push(map());
            let bent = if i % 3 == 2 { 0.3 } else { 0.0 };
            tables.normal_maps.to_mut().push([0, 1, 2].map(|k| [bent * map()[0], 0.0, bent * map()[1], n[k]]));
            tables.textures.push((i % 3) as u32);
            tables.two_sided.push(i % 5 != 0);
            tables.frames.push((i % 2) as u32);
        }
        tables
    }

    /// A surface is seen from any height above it, and one metre is as good as another.
    #[test]
    fn a_wall_one_metre_away_is_seen() {
        let rays = PixelRays::new(1, 1, 1, &[0.0, 0.0]).unwrap();
        let renderer = Renderer::new(Scene::new(&tables(&mut Numbers(1), 1)).unwrap(), Some(1)).unwrap();
        for (z, forward) in [(2.0, 1.0), (4.0, -1.0)] {
            let rotation = [[forward, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, forward]];
            let position = [0.0, 0.0, z];
            let pose = Pose { position, rotation, velocity: [0.0; 3], angular_rate: [0.0; 3] };
            let view = View { poses: vec![pose; 2], factors: vec![[1.0, 0.0]; 3] };
            let (mut depth, mut owner) = ([0.0], [7]);
            renderer.depth(&rays, &[view], &mut depth, &mut owner).unwrap();
            assert_eq!((depth, owner), ([1.0], [0]));
        }
    }

    /// Shadow rays begin and end on their way.
    #[test]
    fn shadow_rays_out_of_range_are_refused() {
        let good = tables(&mut Numbers(1), 3);
        for (step, end) in [(-1e-9, 0.999), (f64::NAN, 0.999), (0.0, 0.0), (0.0, 1.0), (0.0, 1.5)] {
            assert!(Scene::new(&SceneTables { step, end, ..good.clone() }).is_err());
        }
        assert!(Scene::new(&good).is_ok());
    }

    /// FNV-1a of the bits.
    fn hash(values: &[f32]) -> u64 {
        let bytes = values.iter().flat_map(|value| value.to_le_bytes());
        bytes.fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
    }

    /// Luma and rates of few and of many triangles a tile have the bits that they had on another processor: they were
    /// found in a build without vector code, and each processor runs the best level that it has. Who changes the order
    /// of operations makes other bits, and must then make the counts of events in docs/ again.
    #[test]
    fn bits_are_those_of_other_processors() {
        let (width, height, rays) = (45, 27, 5);
        let table: Vec<f32> = (0..rays)
            .flat_map(|ray| (0..width * height).map(move |pixel| (ray, pixel % width, pixel / width)))
            .flat_map(|(ray, x, y)| {
                let at = |place: usize, shift: usize| (place as f32 + (ray * shift % 5) as f32 * 0.2) / 20.0 - 1.0;
                [at(x, 1), at(y, 2)]
            })
            .collect();
        let rays = PixelRays::new(width, height, rays, &table).unwrap();
        let mut numbers = Numbers(1);
        let mut hashes = vec![];
        for count in [7, 60, 1500] {
            let renderer = Renderer::new(Scene::new(&tables(&mut numbers, count)).unwrap(), Some(1)).unwrap();
            let turned = [[0.8, 0.0, 0.6], [0.0, 1.0, 0.0], [-0.6, 0.0, 0.8]];
            let level = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
            let mut pose = |rotation, position| Pose {
                position,
                rotation,
                velocity: numbers.vector(1.0),
                angular_rate: numbers.vector(1.0),
            };
            let poses = vec![pose(level, [0.0, 0.0, -2.0]), pose(turned, [-1.5, 0.1, -1.5])];
            let views = [View { poses, factors: vec![[1.0, 0.3], [0.7, 0.0], [1.0, -0.2]] }];
            let (mut luma, mut rate) = (vec![0.0; width * height], vec![0.0; width * height]);
            renderer.luma(&rays, &views, &mut luma, Some(&mut rate)).unwrap();
            assert!(luma.iter().chain(&rate).all(|value| value.is_finite()));
            hashes.push([hash(&luma), hash(&rate)]);
            let pixels: Vec<(u32, u32)> = (0..luma.len() as u32).step_by(7).map(|pixel| (0, pixel)).collect();
            let mut samples = vec![0.0; pixels.len()];
            renderer.samples(&rays, &views, &pixels, &mut samples).unwrap();
            assert!(
                pixels.iter().zip(&samples).all(|((_, pixel), one)| one.to_bits() == luma[*pixel as usize].to_bits())
            );
        }
        let seen = [
            [2_295_827_215_713_717_958, 16_356_271_566_255_267_865],
            [2_526_312_197_078_857_623, 9_892_543_023_334_712_240],
            [17_854_218_977_312_245_001, 17_650_990_199_588_181_821],
        ];
        assert_eq!(hashes, seen);
    }

    /// Adds what is hard to a scene: the same triangle twice, in both orders; triangles that share edges and corners
    /// which rays pass through exactly; needles; what is seen from its side; what is huge, and what has no size or is
    /// not finite.
    fn add_hard_triangles(tables: &mut SceneTables, numbers: &mut Numbers) {
        let mut hard: Vec<[[f64; 3]; 3]> = vec![];
        for i in 0..8 {
            let corner = |k: usize| {
                let angle = std::f64::consts::FRAC_PI_4 * ((i + k) % 8) as f64;
                [0.5 * angle.cos().round(), 0.5 * angle.sin().round(), 1.5]
            };
            hard.push([[0.0, 0.0, 1.5], corner(0), corner(1)]);
        }
        for _ in 0..20 {
            let [a, b, c] = [numbers.vector(1.0), numbers.vector(1.0), numbers.vector(1.0)];
            let between = |t: f64| [0, 1, 2].map(|k| a[k] + t * (b[k] - a[k]) + 1e-6 * c[k]);
            hard.extend([[a, b, c], [c, b, a], [b, c, a], [a, b, between(0.4)], [a, a, b], [a, a, a]]);
            hard.push([a, b, [c[0], f64::NAN, c[2]]]);
            hard.push([a.map(|x| 1e6 * x), b.map(|x| 1e6 * x), c]);
            // In the plane of the camera's place, and far behind it.
            hard.push([[0.0, 0.0, -2.0], [1.0, 1.0, a[0]], [2.0, 2.0, a[1]]]);
            hard.push([[a[0], a[1], -9.0], b, c]);
        }
        for (i, corners) in hard.into_iter().enumerate() {
            add(tables, corners, (i / 3 % 2) as u32);
        }
    }

    /// Adds a slanted wall, whose box is nearer than what lies just before it.
    fn add_slanted_wall(tables: &mut SceneTables, numbers: &mut Numbers) {
        add(tables, [[-30.0, -30.0, -6.0], [30.0, -30.0, 12.0], [0.0, 60.0, 3.0]], 0);
        for _ in 0..300 {
            let [x, y, _] = numbers.vector(1.0);
            let before = |x: f64, y: f64| [x, y, 2.999 + 0.3 * x];
            add(tables, [before(x, y), before(x + 0.1, y), before(x, y + 0.1)], 0);
        }
    }

    fn add(tables: &mut SceneTables, corners: [[f64; 3]; 3], frame: u32) {
        let [a, b, c] = corners;
        let [u, v]: [[f64; 3]; 2] = [std::array::from_fn(|j| b[j] - a[j]), std::array::from_fn(|j| c[j] - a[j])];
        let n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        let length = (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt();
        let n = if length > 0.0 { n.map(|x| x / length) } else { [0.0; 3] };
        tables.planes.to_mut().push([n[0], n[1], n[2], -(n[0] * a[0] + n[1] * a[1] + n[2] * a[2])]);
        tables.corners.to_mut().push(corners);
        tables.u_maps.to_mut().push([0.1, 0.2, 0.3, 0.4]);
        tables.v_maps.to_mut().push([0.4, 0.3, 0.2, 0.1]);
        tables.normal_maps.to_mut().push([0, 1, 2].map(|k| [0.0, 0.0, 0.0, n[k]]));
        tables.textures.push(0);
        tables.two_sided.push(true);
        tables.frames.push(frame);
    }

    /// No way to do a tile changes a bit of luma, rates, depths or triangles. Builds without optimization try fewer.
    #[test]
    fn every_way_sees_the_same() {
        let (width, height) = (45, 27);
        let mut numbers = Numbers(3);
        let tried = if cfg!(debug_assertions) { 4 } else { 6 };
        for (count, rays) in [(0, 5), (1, 1), (7, 8), (300, 9), (1500, 5), (20_000, 5)].into_iter().take(tried) {
            let rays: [PixelRays; 2] = [rays, 1].map(|rays| {
                let table: Vec<f32> = (0..rays)
                    .flat_map(|ray| (0..width * height).map(move |pixel| (ray, pixel % width, pixel / width)))
                    .flat_map(|(ray, x, y)| {
                        let at =
                            |place: usize, shift: usize| (place as f32 + (ray * shift % 5) as f32 * 0.2) / 20.0 - 1.0;
                        [at(x, 1), at(y, 2)]
                    })
                    .collect();
                PixelRays::new(width, height, rays, &table).unwrap()
            });
            let mut tables = tables(&mut numbers, count);
            match count {
                1 => add_slanted_wall(&mut tables, &mut numbers),
                20_000 => {}
                _ => add_hard_triangles(&mut tables, &mut numbers),
            }
            let mut renderer = Renderer::new(Scene::new(&tables).unwrap(), Some(1)).unwrap();
            let level = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
            let turned = [[0.8, 0.0, 0.6], [0.0, 1.0, 0.0], [-0.6, 0.0, 0.8]];
            let views: Vec<View> = [(level, [0.0, 0.0, -2.0]), (turned, [-1.5, 0.1, -1.5]), (level, [0.1, 0.2, 0.3])]
                .into_iter()
                .map(|(rotation, position)| {
                    let pose = Pose { position, rotation, velocity: [0.3; 3], angular_rate: [0.2; 3] };
                    let other = Pose { position: numbers.vector(1.0), ..pose };
                    View { poses: vec![pose, other], factors: vec![[1.0, 0.3], [0.7, 0.0], [1.0, -0.2]] }
                })
                .collect();
            let size = width * height * views.len();
            let mut see = |beams: bool, receivers: usize| {
                renderer.ways = Ways { beams, receivers };
                let (mut luma, mut rate, mut depth) = (vec![0f32; size], vec![0f32; size], vec![0f32; size]);
                let mut triangles = vec![0; size];
                renderer.luma(&rays[0], &views, &mut luma, Some(&mut rate)).unwrap();
                renderer.depth(&rays[1], &views, &mut depth, &mut triangles).unwrap();
                let bits = |values: Vec<f32>| values.into_iter().map(f32::to_bits).collect::<Vec<_>>();
                (triangles, bits(depth), bits(luma), bits(rate))
            };
            let seen = see(false, usize::MAX);
            let ways = [(true, 48), (false, 0), (true, usize::MAX), (true, 0)];
            for (beams, receivers) in ways.into_iter().take(if cfg!(debug_assertions) { 2 } else { 4 }) {
                let other = see(beams, receivers);
                assert!(seen.0 == other.0, "triangles of {count} by {beams} and {receivers}");
                assert!(seen == other, "luma of {count} by {beams} and {receivers}");
            }
        }
    }

    /// Returns rays of a sensor, by their positions in a pixel.
    fn grid(width: usize, height: usize, positions: &[[f32; 2]]) -> PixelRays {
        let along = |count: usize, axis: usize| -> Vec<f32> {
            let of_ray = |at: &[f32; 2]| {
                let at = at[axis];
                (0..count).map(move |i| (i as f32 + at) / 10.0 - 1.0)
            };
            positions.iter().flat_map(of_ray).collect()
        };
        PixelRays::grid(width, height, positions.len(), &along(width, 0), &along(height, 1)).unwrap()
    }

    fn line_views(numbers: &mut Numbers) -> Vec<View> {
        let turned = [[0.8, 0.0, 0.6], [0.0, 1.0, 0.0], [-0.6, 0.0, 0.8]];
        let level = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        [(level, [0.0, 0.0, -2.0]), (turned, [-1.5, 0.1, -1.5]), (level, [0.1, 0.2, 0.3])]
            .into_iter()
            .map(|(rotation, position)| {
                let pose = Pose { position, rotation, velocity: [0.3; 3], angular_rate: [0.2; 3] };
                let other = Pose { position: numbers.vector(1.0), ..pose };
                View { poses: vec![pose, other], factors: vec![[1.0, 0.3], [0.7, 0.0], [1.0, -0.2]] }
            })
            .collect()
    }

    /// What rays meet in a part of the image is at one of its depths, and hardly a part that none meets has any.
    #[test]
    fn depths_in_parts_are_those_of_rays() {
        let (width, height, side) = (36, 20, 4);
        let (columns, rows) = (width / side, height / side);
        let at = |x: usize| x as f64 / 10.0 - 1.0;
        let parts: Vec<_> = (0..columns * rows)
            .map(|part| [0, 1].map(|end| [part % columns, part / columns].map(|place| at((place + end) * side))))
            .collect();
        let (mut empty, mut unmet, mut close, mut met) = (0, 0, 0, 0);
        for (seed, count) in [(1, 1), (3, 5), (4, 10)].into_iter().chain((5..15).map(|seed| (seed, 2))) {
            let mut numbers = Numbers(seed);
            let mut tables = SceneTables { shadows: false, ..tables(&mut numbers, count) };
            // Of two triangles, the wall is hidden.
            tables.hidden = (0..count).map(|i| i % 5 == usize::from(count != 2)).collect();
            tables.culled = (0..count).map(|i| i % 5 == 2).collect();
            let renderer = Renderer::new(Scene::new(&tables).unwrap(), Some(1)).unwrap();
            for view in line_views(&mut numbers) {
                let views = std::slice::from_ref(&view);
                let mut of_rays = vec![[f64::INFINITY, 0.0]; parts.len()];
                for place in (0..16).map(|i| [(i % 4) as f32 / 4.0 + 0.1, (i / 4) as f32 / 4.0 + 0.1]) {
                    let (mut depth, mut triangles) = (vec![0f32; width * height], vec![0u32; width * height]);
                    renderer.depth(&grid(width, height, &[place]), views, &mut depth, &mut triangles).unwrap();
                    for (pixel, depth) in depth.iter().enumerate().filter(|(_, depth)| depth.is_finite()) {
                        let [least, most] = &mut of_rays[pixel / width / side * columns + pixel % width / side];
                        (*least, *most) = (least.min(f64::from(*depth)), most.max(f64::from(*depth)));
                    }
                }
                for ([near, far], [least, most]) in
                    renderer.depths_in_parts(&parts, views).unwrap().into_iter().zip(of_rays)
                {
                    if count == 2 && !near.is_nan() {
                        let pose = &view.poses[tables.frames[1] as usize];
                        let depths = tables.corners[1].map(|corner| pose.turned(sub(corner, pose.position))[2]);
                        assert!(near >= depths.into_iter().fold(f64::INFINITY, f64::min) - 1e-9);
                        assert!(far <= depths.into_iter().fold(0.0, f64::max) + 1e-9);
                    }
                    if most > 0.0 {
                        assert!(near <= least * 1.000_01 && far >= most * 0.999_99, "{near} {far} {least} {most}");
                        met += 1;
                        close += usize::from(near > 0.95 * least && far < 1.05 * most);
                    } else {
                        empty += usize::from(near.is_nan() && far.is_nan());
                        unmet += usize::from(!near.is_nan());
                    }
                }
            }
        }
        assert!(empty > 100 && unmet < empty / 5 && close > met * 9 / 10, "{empty} {unmet} {close} of {met}");
    }

    /// A triangle that is hidden from cameras, or whose back is culled, is as good as gone for them, the latter for a camera
    /// behind it, whichever way it is looked for.
    #[test]
    fn what_a_camera_does_not_see_is_not_there() {
        let (width, height, lines) = (37, 21, LinePattern::new(8).unwrap());
        let (rays, middles) = (grid(width, height, &[[0.1, 0.6], [0.6, 0.1]]), grid(width, height, &[[0.5; 2]]));
        let corners = grid(width, height, &[[0.0, 0.0], [1.0, 1.0]]);
        let pixels = width * height;
        for (seed, count, beams) in [(1, 5, true), (2, 60, false), (3, 60, true), (4, 2_000, false), (5, 2_000, true)] {
            let mut numbers = Numbers(seed);
            let mut whole = SceneTables { shadows: false, ..tables(&mut numbers, count) };
            whole.culled = (0..count).map(|i| i > 0 && numbers.next() > -0.5).collect();
            whole.hidden = (0..count).map(|i| i > 0 && numbers.next() > 0.5).collect();
            for view in line_views(&mut numbers) {
                let mut left = SceneTables { culled: vec![], hidden: vec![], ..whole.clone() };
                let behind = |i: usize| {
                    let ([x, y, z], plane) = (view.poses[whole.frames[i] as usize].position, whole.planes[i]);
                    plane[0] * x + plane[1] * y + plane[2] * z + plane[3] < 0.0
                };
                // Off the image, where no ray meets it.
                for i in (0..count).filter(|&i| whole.hidden[i] || whole.culled[i] && behind(i)) {
                    left.corners.to_mut()[i] = [[0.0; 3]; 3];
                }
                let seen = [&whole, &left].map(|tables| {
                    let mut renderer = Renderer::new(Scene::new(tables).unwrap(), Some(1)).unwrap();
                    let views = std::slice::from_ref(&view);
                    let (mut luma, mut by_lines) = (vec![0f32; pixels], vec![0f32; pixels]);
                    let (mut depth, mut numbers) = (vec![0f32; pixels], vec![0u32; pixels]);
                    renderer.line_luma(&corners, &lines, views, &mut by_lines).unwrap();
                    renderer.ways.beams = beams;
                    renderer.luma(&rays, views, &mut luma, None).unwrap();
                    renderer.depth(&middles, views, &mut depth, &mut numbers).unwrap();
                    (luma, by_lines, depth, numbers)
                });
                let [(luma, by_lines, depth, numbers), gone] = &seen;
                assert_eq!((luma, depth, numbers), (&gone.0, &gone.2, &gone.3));
                assert!(by_lines.iter().zip(&gone.1).all(|(a, b)| (a - b).abs() <= 1e-5 * a.abs().max(1.0)));
            }
        }
    }

    /// Luma by lines is that of 987 rays, with the edges of triangles and of their shadows, on a body that moves too; also
    /// behind a lens with distortion.
    #[test]
    fn lines_are_the_area() {
        let (width, height) = (21, 13);
        let lattice: Vec<[f32; 2]> =
            (0..987).map(|ray| [(ray as f32 + 0.5) / 987.0, ((ray * 610 % 987) as f32 + 0.5) / 987.0]).collect();
        let straight = (grid(width, height, &lattice), grid(width, height, &[[0.0, 0.0], [1.0, 1.0]]));
        let four = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];
        let curved = (bent(width, height, &lattice), bent(width, height, &four));
        for ((rays, corners), count, shadows, most, typical) in [
            (&straight, 1, false, 0.5, 0.02),
            (&straight, 3, true, 0.15, 0.0005),
            (&straight, 40, false, 0.5, 0.02),
            (&straight, 40, true, 0.5, 0.02),
            (&curved, 3, true, 0.15, 0.0005),
        ] {
            let mut numbers = Numbers(11);
            let mut tables = SceneTables { shadows, ..tables(&mut numbers, count) };
            if count == 1 {
                add_slanted_wall(&mut tables, &mut numbers);
            }
            let renderer = Renderer::new(Scene::new(&tables).unwrap(), Some(1)).unwrap();
            let views = line_views(&mut numbers);
            let size = width * height * views.len();
            let (mut truth, mut luma) = (vec![0f32; size], vec![0f32; size]);
            renderer.luma(rays, &views, &mut truth, None).unwrap();
            renderer.line_luma(corners, &LinePattern::new(16).unwrap(), &views, &mut luma).unwrap();
            let mean = truth.iter().sum::<f32>() / size as f32;
            let mut wrong: Vec<f32> = truth.iter().zip(&luma).map(|(a, b)| (a - b).abs() / mean).collect();
            wrong.sort_unstable_by(f32::total_cmp);
            let (largest, usual) = (wrong[size - 1], wrong[size * 9 / 10]);
            assert!(largest < most && usual < typical, "{count} {shadows}: {largest} {usual}");
            let pixels: Vec<(u32, u32)> = (0..60).map(|i| (i % 3, i * 37 % (width * height) as u32)).collect();
            let mut single = vec![0f32; pixels.len()];
            renderer.line_samples(corners, &LinePattern::new(16).unwrap(), &views, &pixels, &mut single).unwrap();
            let in_frame = pixels.iter().map(|&(view, pixel)| luma[view as usize * width * height + pixel as usize]);
            assert!(single.iter().copied().eq(in_frame.clone()));
            // One at a time: triangles are looked for in its tile alone.
            for (pixel, expected) in pixels.iter().zip(in_frame) {
                let mut alone = [0f32];
                let pixel = std::slice::from_ref(pixel);
                renderer.line_samples(corners, &LinePattern::new(16).unwrap(), &views, pixel, &mut alone).unwrap();
                assert_eq!(alone[0], expected);
            }
        }
    }

    /// Returns rays of a sensor behind a lens with distortion, by their positions in a pixel.
    fn bent(width: usize, height: usize, positions: &[[f32; 2]]) -> PixelRays {
        let mut table = vec![];
        for at in positions {
            for pixel in 0..width * height {
                let [x, y] = [pixel % width, pixel / width].map(|i| i as f32 / 10.0 - 1.0);
                let (x, y) = (x + at[0] / 10.0, y + at[1] / 10.0);
                let scale = 1.0 - 0.05 * (x * x + y * y);
                table.extend([x * scale, y * scale]);
            }
        }
        PixelRays::new(width, height, positions.len(), &table).unwrap()
    }

    /// Luma by lines has the same bits on every processor: these.
    #[test]
    fn lines_have_the_same_bits_everywhere() {
        let (width, height) = (37, 21);
        let straight = grid(width, height, &[[0.0, 0.0], [1.0, 1.0]]);
        let curved = bent(width, height, &[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]);
        let mut numbers = Numbers(3);
        let mut tables = tables(&mut numbers, 90);
        add_hard_triangles(&mut tables, &mut numbers);
        let renderer = Renderer::new(Scene::new(&tables).unwrap(), Some(1)).unwrap();
        let views = line_views(&mut numbers);
        let hashes = [(&straight, 4), (&straight, 8), (&straight, 16), (&curved, 8)].map(|(corners, lines)| {
            let mut luma = vec![0f32; width * height * views.len()];
            renderer.line_luma(corners, &LinePattern::new(lines).unwrap(), &views, &mut luma).unwrap();
            assert!(luma.iter().all(|value| value.is_finite()) && luma.iter().any(|&value| value > 0.0));
            // Single pixels have the bits of the frame, however many others are looked at.
            for step in [1, 7, 43] {
                let numbers = (0..luma.len()).step_by(step);
                let pixels: Vec<(u32, u32)> = numbers
                    .clone()
                    .map(|at| ((at / (width * height)) as u32, (at % (width * height)) as u32))
                    .collect();
                let mut single = vec![0f32; pixels.len()];
                renderer
                    .line_samples(corners, &LinePattern::new(lines).unwrap(), &views, &pixels, &mut single)
                    .unwrap();
                assert!(single.iter().zip(numbers).all(|(value, at)| *value == luma[at]));
            }
            // FNV-1a.
            luma.iter()
                .flat_map(|value| value.to_bits().to_le_bytes())
                .fold(0xcbf2_9ce4_8422_2325u64, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
        });
        assert_eq!(
            hashes.map(|hash| format!("{hash:016x}")),
            ["6b825c6111343541", "e54a2a44d2fffdb0", "96ccee866b60461f", "f6bde6739b9028a7"]
        );
    }

    /// Triangles that emit light do so alone: in frames, where a tile takes over what the one before made ready, as in
    /// single pixels, where it does not. What is remembered of their ways to lights changes nothing.
    #[test]
    fn triangles_have_nothing_of_others() {
        let (width, height) = (45, 27);
        let rays = grid(width, height, &[[0.3, 0.2], [0.7, 0.8]]);
        let mut numbers = Numbers(6);
        for count in [9, 60, 1500] {
            let mut tables = tables(&mut numbers, count);
            tables.emissions =
                (0..count).map(|i| (i % 4 == 1).then_some(Emission { light: 2, luma: 0.3 + i as f64 })).collect();
            let renderer = Renderer::new(Scene::new(&tables).unwrap(), Some(1)).unwrap();
            let mut forgetful = Renderer::new(Scene::new(&tables).unwrap(), Some(1)).unwrap();
            forgetful.scene.unoccluded.forget();
            let views = line_views(&mut numbers);
            let size = width * height * views.len();
            let (mut luma, mut traced, mut single) = (vec![0f32; size], vec![0f32; size], vec![0f32; size]);
            renderer.luma(&rays, &views, &mut luma, None).unwrap();
            forgetful.luma(&rays, &views, &mut traced, None).unwrap();
            let pixel = |at: usize| ((at / (width * height)) as u32, (at % (width * height)) as u32);
            renderer.samples(&rays, &views, &(0..size).map(pixel).collect::<Vec<_>>(), &mut single).unwrap();
            assert_eq!(luma, single);
            assert_eq!(luma, traced);
            assert!(luma.iter().any(|&value| value > 1.0));
        }
    }

    /// What single rays hit is what they hit in a frame, where there is nothing as well.
    #[test]
    fn single_rays_hit_what_frames_show() {
        let (width, height) = (29, 19);
        let rays = grid(width, height, &[[0.5, 0.5]]);
        let mut numbers = Numbers(4);
        for count in [0, 2, 30] {
            let renderer = Renderer::new(Scene::new(&tables(&mut numbers, count)).unwrap(), Some(1)).unwrap();
            let views = line_views(&mut numbers);
            let size = width * height * views.len();
            let (mut depth, mut triangles) = (vec![0f32; size], vec![0; size]);
            renderer.depth(&rays, &views, &mut depth, &mut triangles).unwrap();
            for step in [1, 5, 97] {
                let at: Vec<usize> = (0..size).step_by(step).collect();
                let pixels: Vec<(u32, u32)> =
                    at.iter().map(|at| ((at / (width * height)) as u32, (at % (width * height)) as u32)).collect();
                let mut hits = vec![(0.0, 0); pixels.len()];
                renderer.hits(&rays, &views, &pixels, &mut hits).unwrap();
                assert!(hits.iter().zip(&at).all(|(&hit, &at)| hit == (depth[at], triangles[at])));
            }
        }
    }

    /// What rays see is what they meet first in float64, whichever way: no ray passes a triangle that it meets well
    /// inside, and none sees what it does not meet. Corners and edges of a fan lie on rays exactly.
    #[test]
    fn rays_see_what_they_meet_first() {
        let (width, height) = (33, 33);
        let table: Vec<f32> = (0..width * height)
            .flat_map(|pixel| [pixel % width, pixel / width].map(|at| at as f32 / 16.0 - 1.0))
            .collect();
        let rays = PixelRays::new(width, height, 1, &table).unwrap();
        let mut numbers = Numbers(5);
        for count in [0, 1, 40, 700] {
            let mut tables = tables(&mut numbers, count);
            add_hard_triangles(&mut tables, &mut numbers);
            let mut renderer = Renderer::new(Scene::new(&tables).unwrap(), Some(1)).unwrap();
            let rotation = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
            // The same in both frames, so that nothing has to be turned.
            let pose = Pose { position: [0.0; 3], rotation, velocity: [0.0; 3], angular_rate: [0.0; 3] };
            let view = View { poses: vec![pose; 2], factors: vec![[1.0, 0.0]; 3] };
            for beams in [false, true] {
                renderer.ways.beams = beams;
                let (mut depth, mut triangle) = (vec![0f32; rays.pixels()], vec![0; rays.pixels()]);
                renderer.depth(&rays, std::slice::from_ref(&view), &mut depth, &mut triangle).unwrap();
                for (pixel, ray) in table.chunks_exact(2).enumerate() {
                    let ray = [f64::from(ray[0]), f64::from(ray[1]), 1.0];
                    let met = |i: usize| met(&tables.corners[i], ray);
                    let first = (0..tables.corners.len())
                        .filter_map(|i| met(i).filter(|met| met.inside > 1e-5 && met.slant > 1e-3))
                        .fold(f64::INFINITY, |least, met| least.min(met.depth));
                    let seen = f64::from(depth[pixel]);
                    assert!(seen <= first * (1.0 + 1e-4), "{beams} {count}: {ray:?} sees {seen}, not {first}");
                    if triangle[pixel] != NO_TRIANGLE {
                        let met = met(triangle[pixel] as usize).unwrap();
                        assert!(met.inside > -1e-5, "{beams} {count}: {ray:?} passes {}", triangle[pixel]);
                        assert!(met.slant < 1e-3 || (met.depth / seen - 1.0).abs() < 1e-4, "{seen} is {}", met.depth);
                    }
                }
            }
        }
    }

    /// Where a ray from the origin meets a triangle's plane: its depth, the sine of the angle to the plane, and how far
    /// inside of the triangle that is, in units of its image, negative outside.
    struct Met {
        depth: f64,
        slant: f64,
        inside: f64,
    }

    /// None behind the origin, or for a triangle that is not one.
    fn met(corners: &[[f64; 3]; 3], ray: [f64; 3]) -> Option<Met> {
        use super::super::geometry::vector::{cross, dot, scale, sub};
        let [a, b, c] = *corners;
        let normal = cross(sub(b, a), sub(c, a));
        let along = dot(normal, ray);
        let depth = dot(normal, a) / along;
        if !(depth > 0.0 && depth.is_finite()) {
            return None;
        }
        let side = dot(a, cross(b, c)).signum();
        let inside = [cross(b, c), cross(c, a), cross(a, b)].map(|edge| {
            let edge = scale(edge, side);
            dot(edge, ray) / (edge[0] * edge[0] + edge[1] * edge[1]).sqrt().max(1e-300)
        });
        let slant = along.abs() / (dot(normal, normal) * dot(ray, ray)).sqrt();
        Some(Met { depth, slant, inside: inside.into_iter().fold(f64::INFINITY, f64::min) })
    }
}
