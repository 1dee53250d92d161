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

/// Rays of one triangle that are shaded together: where it fills a tile, and elsewhere.
const MANY: usize = PIXELS;
const FEW: usize = LANES;

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
    let all = *wanted == [true; PIXELS];
    of.bins.of_tile(of.rays, tile, &mut scratch.list);
    let TileScratch { list, nearest, shadow, order, starts, luma, rate } = scratch;
    luma.clear();
    luma.resize(x.len(), of.background.0);
    rate.clear();
    rate.resize(if RATE { x.len() } else { 0 }, of.background.1);
    if let ([only], true) = (list.as_slice(), all)
        && only.covers
    {
        let shader = prepared(of, tile, only, shadow);
        for (at, (x, y)) in x.as_chunks::<MANY>().0.iter().zip(y.as_chunks::<MANY>().0).enumerate() {
            let (one, one_rate) = if shader.dark {
                ([0.0; MANY], [0.0; MANY])
            } else {
                shader.luma::<MANY, RATE>(x, y, shadow)
            };
            luma[at * MANY..][..MANY].copy_from_slice(&one);
            if RATE {
                rate[at * MANY..][..MANY].copy_from_slice(&one_rate);
            }
        }
    } else if !list.is_empty() {
        nearest.find(of.bins, list, (x, y), of.rays.blocks(tile), wanted_blocks(wanted));
        by_triangle(&nearest.place, list.len(), wanted, order, starts);
        for (number, entry) in list.iter().enumerate() {
            let own = &order[starts[number] as usize..starts[number + 1] as usize];
            if own.is_empty() {
                continue;
            }
            let shader = prepared(of, tile, entry, shadow);
            for rays in own.chunks(FEW) {
                // What is missing to a whole vector is filled up with the last ray.
                let ray = |i: usize| rays[i.min(rays.len() - 1)] as usize;
                let (x, y) = (std::array::from_fn(|i| x[ray(i)]), std::array::from_fn(|i| y[ray(i)]));
                let (one, one_rate) = if shader.dark {
                    ([0.0; FEW], [0.0; FEW])
                } else {
                    shader.luma::<FEW, RATE>(&x, &y, shadow)
                };
                for (i, &ray) in rays.iter().enumerate() {
                    luma[ray as usize] = one[i];
                    if RATE {
                        rate[ray as usize] = one_rate[i];
                    }
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
fn prepared<'a>(of: &TileView<'a>, tile: usize, entry: &Entry, shadow: &mut Shadow) -> Shader<'a> {
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

/// Sorts the wanted rays by the triangle that they see; those of triangle i then begin at `starts[i]`.
#[allow(clippy::cast_possible_truncation, reason = "a tile has fewer than 2^32 rays")]
fn by_triangle(
    places: &[u32],
    triangles: usize,
    wanted: &[bool; PIXELS],
    order: &mut Vec<u32>,
    starts: &mut Vec<u32>,
) {
    let all = *wanted == [true; PIXELS];
    let length = places.len() / BLOCKS;
    let is_wanted = |block: usize, ray: usize| all || wanted[block * LANES + ray % LANES];
    starts.clear();
    starts.resize(triangles + 2, 0);
    let mut count = 0;
    for (block, places) in places.chunks_exact(length).enumerate() {
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
    for (block, places) in places.chunks_exact(length).enumerate() {
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

/// Of a tile's rays the inverse depth of what they see, in `scratch.nearest`, and what it is: a function of the triangle's
/// number in the scene.
pub(super) fn nearest(
    bins: &Bins,
    rays: &PixelRays,
    tile: usize,
    scratch: &mut TileScratch,
    mut each: impl FnMut(usize, f32, Option<u32>),
) {
    bins.of_tile(rays, tile, &mut scratch.list);
    scratch.nearest.find(bins, &scratch.list, rays.of_tile(tile), rays.blocks(tile), [true; BLOCKS]);
    for (ray, (&place, &inverse)) in scratch.nearest.place.iter().zip(&scratch.nearest.inverse_depth).enumerate() {
        let seen = (place != NOTHING).then(|| bins.seen[scratch.list[place as usize].seen as usize].triangle);
        each(ray, inverse, seen);
    }
}
