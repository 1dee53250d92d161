//! A tile of a view: the one place where all that makes luma comes together, compiled for several processors.

use multiversion::multiversion;

use super::bins::{Bins, Entry};
use super::lights::SeenLight;
use super::pixel_rays::{BLOCKS, LANES, PIXELS, PixelRays};
use super::scene::Scene;
use super::shade::Shader;
use super::shadows::{Shadow, StillCones};
use super::view::View;
use super::visibility::{NOTHING, Nearest};

/// What all tiles of a view share.
pub(super) struct TileView<'a> {
    pub(super) scene: &'a Scene,
    pub(super) still: &'a StillCones,
    pub(super) rays: &'a PixelRays,
    pub(super) view: &'a View,
    pub(super) lights: Vec<SeenLight>,
    /// Luma of what is not hit, and its rate.
    pub(super) background: (f32, f32),
    pub(super) bins: &'a Bins,
}

/// Room for a tile's work.
#[derive(Debug, Default)]
pub(super) struct TileScratch {
    list: Vec<Entry>,
    pub(super) nearest: Nearest,
    shadow: Shadow,
    /// The rays by the triangle that they see.
    order: Vec<u32>,
    starts: Vec<u32>,
    luma: Vec<f32>,
    rate: Vec<f32>,
}

/// Pixels of a tile, by block and lane.
#[derive(Debug)]
pub(super) struct TileImage {
    pub(super) luma: [f32; PIXELS],
    pub(super) rate: [f32; PIXELS],
}

impl TileImage {
    pub(super) const BLACK: Self = Self { luma: [0.0; PIXELS], rate: [0.0; PIXELS] };
}

/// A pixel's rays are added up in the lattice's order, each with the bits that it has alone.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
pub(super) fn luma<const RATE: bool>(
    of: &TileView,
    tile: usize,
    wanted: &[bool; PIXELS],
    scratch: &mut TileScratch,
    image: &mut TileImage,
) {
    let (x, y) = of.rays.of_tile(tile);
    of.bins.of_tile(of.rays, tile, &mut scratch.list);
    let TileScratch { list, nearest, shadow, order, starts, luma, rate } = scratch;
    luma.clear();
    luma.resize(x.len(), of.background.0);
    rate.clear();
    rate.resize(if RATE { x.len() } else { 0 }, of.background.1);
    let all = *wanted == [true; PIXELS];
    if let ([only], true) = (list.as_slice(), all)
        && only.covers
    {
        let shader = prepared(of, tile, *only, shadow);
        for (at, (x, y)) in x.as_chunks::<TOGETHER>().0.iter().zip(y.as_chunks::<TOGETHER>().0).enumerate() {
            let (one, one_rate) = if shader.dark {
                ([0.0; TOGETHER], [0.0; TOGETHER])
            } else {
                shader.luma::<TOGETHER, RATE>(x, y, shadow)
            };
            luma[at * TOGETHER..][..TOGETHER].copy_from_slice(&one);
            if RATE {
                rate[at * TOGETHER..][..TOGETHER].copy_from_slice(&one_rate);
            }
        }
    } else if !list.is_empty() {
        nearest.find(of.bins, list, (x, y), of.rays.blocks(tile), wanted_blocks(wanted));
        by_triangle(nearest, list.len(), wanted, order, starts);
        for (number, entry) in list.iter().enumerate() {
            let scattered = &order[starts[number] as usize..starts[number + 1] as usize];
            if scattered.is_empty() && !nearest.only.iter().any(|only| *only == place(number)) {
                continue;
            }
            let shader = prepared(of, tile, *entry, shadow);
            for rays in Rays::that_see(place(number), &nearest.only, x.len() / BLOCKS, scattered) {
                let (one, one_rate) = if shader.dark {
                    ([0.0; TOGETHER], [0.0; TOGETHER])
                } else {
                    shader.luma::<TOGETHER, RATE>(&rays.of(x), &rays.of(y), shadow)
                };
                rays.put(&one, luma);
                if RATE {
                    rays.put(&one_rate, rate);
                }
            }
        }
    }
    image.luma = mean(luma);
    if RATE {
        image.rate = mean(rate);
    }
}

/// A tile's triangle, with its shadows made ready.
fn prepared<'a>(of: &TileView<'a>, tile: usize, entry: Entry, shadow: &mut Shadow) -> Shader<'a> {
    let seen = &of.bins.seen[entry.seen as usize];
    let shader = Shader::new(of.scene, of.view, &of.lights, seen);
    if !shader.dark {
        shadow.prepare(of.scene, of.still, of.view, &of.lights, shader.lights(), seen, of.rays.tile(tile));
    }
    shader
}

/// The blocks of which any pixel is wanted.
pub(super) fn wanted_blocks(wanted: &[bool; PIXELS]) -> [bool; BLOCKS] {
    std::array::from_fn(|block| wanted[block * LANES..][..LANES].contains(&true))
}

#[allow(clippy::cast_possible_truncation, reason = "a tile has fewer than 2^32 triangles")]
fn place(number: usize) -> u32 {
    number as u32
}

/// Rays that are shaded together: those of a tile are a multiple. With half as many the compiler writes the loops out, and
/// then finds no vectors in them.
const TOGETHER: usize = PIXELS;

/// Up to so many rays that see one triangle; what is missing is filled up with the last of them.
enum Rays<'a> {
    /// Some that lie side by side.
    Row { first: usize, count: usize },
    /// Some here and there.
    Scattered(&'a [u32]),
}

impl<'a> Rays<'a> {
    /// Those that see a triangle: all rays of the blocks that see nothing else, and some of the others.
    fn that_see(
        place: u32,
        only: &'a [u32; BLOCKS],
        per_block: usize,
        scattered: &'a [u32],
    ) -> impl Iterator<Item = Self> {
        let blocks = only.iter().enumerate().filter(move |(_, only)| **only == place);
        let rows = blocks.flat_map(move |(block, _)| {
            let end = (block + 1) * per_block;
            let firsts = (block * per_block..end).step_by(TOGETHER);
            firsts.map(move |first| Rays::Row { first, count: TOGETHER.min(end - first) })
        });
        rows.chain(scattered.chunks(TOGETHER).map(Rays::Scattered))
    }

    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
    fn of(&self, values: &[f32]) -> [f32; TOGETHER] {
        match self {
            Self::Row { first, count } => {
                let values = &values[*first..first + count];
                values.first_chunk().copied().unwrap_or_else(|| std::array::from_fn(|i| values[i.min(count - 1)]))
            }
            Self::Scattered(rays) => std::array::from_fn(|i| values[rays[i.min(rays.len() - 1)] as usize]),
        }
    }

    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
    fn put(&self, values: &[f32; TOGETHER], out: &mut [f32]) {
        match self {
            Self::Row { first, count } => out[*first..first + count].copy_from_slice(&values[..*count]),
            Self::Scattered(rays) => {
                for (&ray, &value) in rays.iter().zip(values) {
                    out[ray as usize] = value;
                }
            }
        }
    }
}

/// Sorts the wanted rays by the triangle that they see; those of triangle i then begin at `starts[i]`. Blocks in which
/// all see one are left out.
#[allow(clippy::cast_possible_truncation, reason = "a tile has fewer than 2^32 rays")]
fn by_triangle(
    nearest: &Nearest,
    triangles: usize,
    wanted: &[bool; PIXELS],
    order: &mut Vec<u32>,
    starts: &mut Vec<u32>,
) {
    let all = *wanted == [true; PIXELS];
    let length = nearest.place.len() / BLOCKS;
    let is_wanted = |block: usize, ray: usize| all || wanted[block * LANES + ray % LANES];
    let blocks = || nearest.place.chunks_exact(length).enumerate().filter(|(block, _)| nearest.only[*block] == NOTHING);
    starts.clear();
    starts.resize(triangles + 2, 0);
    let mut count = 0;
    for (block, places) in blocks() {
        for (ray, &place) in places.iter().enumerate() {
            if place != NOTHING && is_wanted(block, ray) {
                starts[place as usize + 2] += 1;
                count += 1;
            }
        }
    }
    for i in 0..triangles {
        starts[i + 2] += starts[i + 1];
    }
    order.clear();
    order.resize(count, 0);
    for (block, places) in blocks() {
        for (ray, &place) in places.iter().enumerate() {
            if place != NOTHING && is_wanted(block, ray) {
                let next = &mut starts[place as usize + 1];
                order[*next as usize] = (block * length + ray) as u32;
                *next += 1;
            }
        }
    }
}

/// The mean of each pixel's rays.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
#[allow(clippy::cast_precision_loss, reason = "there are at most 1024 rays a pixel")]
fn mean(values: &[f32]) -> [f32; PIXELS] {
    let mut means = [0f32; PIXELS];
    let length = values.len() / BLOCKS;
    let rays = (length / LANES) as f32;
    for (block, pixels) in values.chunks_exact(length).zip(means.chunks_exact_mut(LANES)) {
        for ray in block.chunks_exact(LANES) {
            for i in 0..LANES {
                pixels[i] += ray[i];
            }
        }
        for pixel in pixels {
            *pixel /= rays;
        }
    }
    means
}

/// For each of a tile's rays the inverse depth of what it sees, and the number of this triangle in the scene.
pub(super) fn nearest(
    bins: &Bins,
    rays: &PixelRays,
    tile: usize,
    scratch: &mut TileScratch,
    mut each: impl FnMut(usize, f32, u32),
) {
    bins.of_tile(rays, tile, &mut scratch.list);
    let (x, y) = rays.of_tile(tile);
    let nearest = &mut scratch.nearest;
    nearest.find(bins, &scratch.list, (x, y), rays.blocks(tile), [true; BLOCKS]);
    let seen = |place: u32| &bins.seen[scratch.list[place as usize].seen as usize];
    let per_block = x.len() / BLOCKS;
    for ray in 0..x.len() {
        let only = nearest.only[ray / per_block];
        if only != NOTHING {
            each(ray, seen(only).inverse_depth.at(x[ray], y[ray]), seen(only).triangle);
        } else if nearest.place[ray] != NOTHING {
            each(ray, nearest.inverse_depth[ray], seen(nearest.place[ray]).triangle);
        }
    }
}
