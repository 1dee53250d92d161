//! Frames, single pixels, depths and owners of many views, on threads.

use std::sync::Mutex;

use rayon::prelude::*;

use super::bins::Bins;
use super::lights::{background, seen_lights};
use super::pixel_rays::{PIXELS, PixelRays, TILE};
use super::scene::Scene;
use super::shadows::StillCones;
use super::tile::{self, TileImage, TileScratch, TileView};
use super::view::View;
use crate::error::{Error, Result};

/// Renders a scene through any camera's rays.
///
/// A pixel depends on its view and its rays alone: not on the other views or pixels, the threads or the processor.
#[derive(Debug)]
pub struct Renderer {
    scene: Scene,
    still: StillCones,
    pool: Option<rayon::ThreadPool>,
    bins: Spares<Bins>,
    scratch: Spares<TileScratch>,
}

/// Rooms for work, used again and again: never more than there were threads at once.
#[derive(Debug, Default)]
struct Spares<T>(Mutex<Vec<T>>);

impl<T: Default> Spares<T> {
    fn with<R>(&self, work: impl FnOnce(&mut T) -> R) -> R {
        let spare = self.0.lock().map(|mut spares| spares.pop()).unwrap_or_default();
        let mut room = spare.unwrap_or_default();
        let result = work(&mut room);
        if let Ok(mut spares) = self.0.lock() {
            spares.push(room);
        }
        result
    }
}

impl Renderer {
    /// A renderer of a scene, on its own threads where their number is given.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for no threads, or where the system refuses so many.
    pub fn new(scene: Scene, threads: Option<usize>) -> Result<Self> {
        let pool = threads.map(new_pool).transpose()?;
        let still = StillCones::new(&scene);
        Ok(Self { scene, still, pool, bins: Spares::default(), scratch: Spares::default() })
    }

    /// The scene.
    #[must_use]
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// How many threads of its own it has; none where it takes all that there are.
    #[must_use]
    pub fn threads(&self) -> Option<usize> {
        self.pool.as_ref().map(rayon::ThreadPool::current_num_threads)
    }

    /// Luma of frames, row by row, one view after the other; and its rate per second where room for it is given.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for views of another scene, or room for other frames.
    pub fn luma(&self, rays: &PixelRays, views: &[View], luma: &mut [f32], rate: Option<&mut [f32]>) -> Result<()> {
        let views = &self.centred(views)?;
        let size = rays.width * rays.height;
        check_room(views.len() * size, luma.len())?;
        match rate {
            None => {
                self.each_view(views, luma.par_chunks_mut(size), |view, frame, threads| {
                    let bands = frame.par_chunks_mut(rays.width * TILE);
                    self.frame(rays, view, bands, threads, |of, tile, scratch, image, band| {
                        tile::luma::<false>(of, tile, &[true; PIXELS], scratch, image);
                        put(rays, tile, &image.luma, band);
                    });
                });
            }
            Some(rate) => {
                check_room(luma.len(), rate.len())?;
                let frames = luma.par_chunks_mut(size).zip(rate.par_chunks_mut(size));
                self.each_view(views, frames, |view, (luma, rate), threads| {
                    let band = rays.width * TILE;
                    let bands = luma.par_chunks_mut(band).zip(rate.par_chunks_mut(band));
                    self.frame(rays, view, bands, threads, |of, tile, scratch, image, band| {
                        tile::luma::<true>(of, tile, &[true; PIXELS], scratch, image);
                        put(rays, tile, &image.luma, band.0);
                        put(rays, tile, &image.rate, band.1);
                    });
                });
            }
        }
        Ok(())
    }

    /// Luma of single pixels: `pixels` are numbers of a view and of a pixel in it, row by row.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for views of another scene, pixels or views that are not there, or other room.
    pub fn samples(&self, rays: &PixelRays, views: &[View], pixels: &[(u32, u32)], luma: &mut [f32]) -> Result<()> {
        let views = &self.centred(views)?;
        check_room(pixels.len(), luma.len())?;
        let size = rays.width * rays.height;
        if let Some((view, pixel)) = pixels.iter().find(|(v, p)| *v as usize >= views.len() || *p as usize >= size) {
            return Err(Error::Argument(format!("pixel {pixel} of view {view}: there are {size} of {}", views.len())));
        }
        let mut order: Vec<Sample> = pixels
            .iter()
            .enumerate()
            .map(|(index, &(view, pixel))| {
                let (tile, place) = rays.tile_of(pixel as usize);
                Sample { view, tile, place, index }
            })
            .collect();
        order.sort_unstable();
        let of_views: Vec<&[Sample]> = order.chunk_by(|a, b| a.view == b.view).collect();
        let found: Vec<Vec<f32>> = self.install(|| {
            of_views
                .par_iter()
                .map(|samples| self.samples_of(rays, &views[samples[0].view as usize], samples))
                .collect()
        });
        for (sample, value) in order.iter().zip(found.iter().flatten()) {
            luma[sample.index] = *value;
        }
        Ok(())
    }

    /// Of each ray of one a pixel: its depth, inf where it hits nothing; and the frame (the body) of what it sees, 0
    /// where that stands still or is nothing.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] as for [`Self::luma`], or for another number of rays a pixel than one.
    pub fn depth(&self, rays: &PixelRays, views: &[View], depth: &mut [f32], owners: &mut [u32]) -> Result<()> {
        let views = &self.centred(views)?;
        let size = rays.width * rays.height;
        check_room(views.len() * size, depth.len())?;
        check_room(depth.len(), owners.len())?;
        if rays.rays != 1 {
            return Err(Error::Argument(format!("depth is that of one ray a pixel, got {}", rays.rays)));
        }
        let frames = depth.par_chunks_mut(size).zip(owners.par_chunks_mut(size));
        self.each_view(views, frames, |view, (depth, owners), threads| {
            let band = rays.width * TILE;
            let bands = depth.par_chunks_mut(band).zip(owners.par_chunks_mut(band));
            self.frame(rays, view, bands, threads, |of, tile, scratch, _, (depth, owners)| {
                let (mut depths, mut frames) = ([f32::INFINITY; PIXELS], [0; PIXELS]);
                tile::nearest(of.bins, rays, tile, scratch, |ray, inverse, triangle| {
                    depths[ray] = 1.0 / inverse;
                    frames[ray] = self.scene.surfaces[triangle as usize].frame;
                });
                put(rays, tile, &depths, depth);
                put(rays, tile, &frames, owners);
            });
        });
        Ok(())
    }

    fn centred(&self, views: &[View]) -> Result<Vec<View>> {
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

    fn install<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        match &self.pool {
            Some(pool) => pool.install(work),
            None => work(),
        }
    }

    /// Does views side by side, or where they are few each on all threads: the last argument says so.
    fn each_view<T: Send>(
        &self,
        views: &[View],
        frames: impl IndexedParallelIterator<Item = T>,
        work: impl Fn(&View, T, bool) + Sync + Send,
    ) {
        self.install(|| {
            let threads = rayon::current_num_threads();
            let alone = views.len() < 4 * threads && threads > 1;
            views.par_iter().zip(frames).for_each(|(view, frame)| work(view, frame, alone));
        });
    }

    /// Does all tiles of a view, band by band of the frame.
    fn frame<T: Send>(
        &self,
        rays: &PixelRays,
        view: &View,
        bands: impl IndexedParallelIterator<Item = T>,
        threads: bool,
        work: impl Fn(&TileView, usize, &mut TileScratch, &mut TileImage, &mut T) + Sync + Send,
    ) {
        self.bins.with(|bins| {
            bins.fill(&self.scene, view, rays, None);
            let of = self.tile_view(rays, view, bins);
            // In one piece where the other threads have views of their own.
            let least = if threads { 1 } else { rays.rows };
            bands.enumerate().with_min_len(least).for_each(|(row, mut band)| {
                self.scratch.with(|scratch| {
                    let mut image = TileImage::BLACK;
                    for column in 0..rays.columns {
                        work(&of, row * rays.columns + column, scratch, &mut image, &mut band);
                    }
                });
            });
        });
    }

    fn tile_view<'a>(&'a self, rays: &'a PixelRays, view: &'a View, bins: &'a Bins) -> TileView<'a> {
        TileView {
            scene: &self.scene,
            still: &self.still,
            rays,
            view,
            lights: seen_lights(&self.scene, view),
            background: background(&self.scene, view),
            bins,
        }
    }

    /// Luma of pixels of one view, sorted by tile.
    fn samples_of(&self, rays: &PixelRays, view: &View, samples: &[Sample]) -> Vec<f32> {
        self.bins.with(|bins| {
            let mut tiles = vec![false; rays.tiles()];
            for sample in samples {
                tiles[sample.tile] = true;
            }
            bins.fill(&self.scene, view, rays, Some(&tiles));
            let of = self.tile_view(rays, view, bins);
            let mut found = Vec::with_capacity(samples.len());
            self.scratch.with(|scratch| {
                let mut image = TileImage::BLACK;
                for tile in samples.chunk_by(|a, b| a.tile == b.tile) {
                    let mut wanted = [false; PIXELS];
                    for sample in tile {
                        wanted[sample.place] = true;
                    }
                    tile::luma::<false>(&of, tile[0].tile, &wanted, scratch, &mut image);
                    found.extend(tile.iter().map(|sample| image.luma[sample.place]));
                }
            });
            found
        })
    }
}

/// A single pixel: by view and tile first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Sample {
    view: u32,
    tile: usize,
    place: usize,
    index: usize,
}

/// Puts a tile's pixels where they belong in its band of rows.
fn put<T: Copy>(rays: &PixelRays, tile: usize, pixels: &[T; PIXELS], band: &mut [T]) {
    let top = tile / rays.columns * TILE;
    for (place, &pixel) in pixels.iter().enumerate() {
        let (column, row) = rays.pixel(tile, place);
        if column < rays.width && row < rays.height {
            band[(row - top) * rays.width + column] = pixel;
        }
    }
}

fn check_room(expected: usize, got: usize) -> Result<()> {
    if expected == got { Ok(()) } else { Err(Error::Argument(format!("there must be room for {expected}, got {got}"))) }
}

fn new_pool(threads: usize) -> Result<rayon::ThreadPool> {
    if threads == 0 {
        return Err(Error::Argument("threads must be at least 1, got 0".to_owned()));
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    pool.map_err(|error| Error::Argument(format!("{threads} threads could not be started: {error}")))
}
