//! A tile of a view: joins visibility, shading and shadows to the luma of its pixels.
//!
//! It is compiled for several processor levels (`multiversion`), so everything that must be vector code is inlined
//! here.
//!
//! What must not break: a pixel's rays are added in the lattice's order, the same for frames and for single pixels
//! ([`mean`], [`pixel_mean`]).

use multiversion::multiversion;

use super::geometry::pixel_rays::{BLOCKS, LANES, PIXELS, PixelRays, RayBlocks, TileRays};
use super::geometry::vector::single;
use super::gloss::adaptive::{GlossyRay, Whole, parts, shade_part};
use super::gloss::number::{Number, Rated};
use super::gloss::pattern::Pattern;
use super::gloss::tracer::{Tracer, TracerScratch};
use super::lanes::{Lanes, MOST};
use super::light::cast::Caster;
use super::light::lights::Surroundings;
use super::light::patch::Patch;
use super::light::shader::{Shader, Shaders};
use super::lines::curved::{Curved, CurvedDepth};
use super::lines::envelope::Envelopes;
use super::lines::pattern::{LineEnds, LinePattern};
use super::lines::shadows::{HiddenLengths, TileTaps};
use super::lines::taps::Taps;
use super::lines::warp::{LinearDepth, Straight, Warp};
use super::samples::Pixels;
use super::tile_hits::TileHits;
use super::visibility::beam::Beam;
use super::visibility::bins::{Bins, Entry, Seen};
use super::visibility::nearest::{NOTHING, Nearest};
use super::visibility::sorted::{Picked, Portion, Sorted};

/// What all tiles of a view share.
pub(crate) struct TileView<'a> {
    pub(crate) rays: &'a PixelRays,
    pub(crate) lit: Surroundings<'a>,
    /// Luma of what is not hit, and its rate.
    pub(crate) background: (f32, f32),
    pub(crate) bins: &'a Bins,
    pub(crate) ways: Ways,
    /// Of a pixel's rays on glossy surfaces; None where all are diffuse.
    pub(crate) pattern: Option<Pattern>,
}

/// In which way tiles are done. It changes the time, and no bit.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ways {
    /// Whether each tile finds its triangles by a [`Beam`]; the bins are not filled then.
    pub(crate) beams: bool,
    /// Shadows on more triangles of a tile than this are found by rays.
    pub(crate) receivers: usize,
}

/// Room for a tile's work.
#[derive(Debug, Default)]
pub(crate) struct TileScratch {
    list: Vec<Entry>,
    rays: TileRays,
    beam: Beam,
    pub(crate) nearest: Nearest,
    taps: Taps,
    straight: Envelopes<LinearDepth>,
    curved: Envelopes<CurvedDepth>,
    hidden_lengths: HiddenLengths,
    ends: LineEnds,
    shading: Shading,
}

/// Room for shading, and its results.
#[derive(Debug, Default)]
struct Shading {
    caster: Caster,
    sorted: Vec<Sorted>,
    visible: Vec<u32>,
    /// Numbers among those that are visible, in the order in which they are shaded.
    turns: Vec<u32>,
    occluded: Vec<u32>,
    picked: Picked,
    luma: Vec<f32>,
    rate: Vec<f32>,
    glossy: Vec<GlossyRay>,
    tracer: TracerScratch,
}

/// In which order rays lie.
#[derive(Clone, Copy, Debug)]
enum Order {
    /// Of each block the first rays of its pixels, then the second ones, and so on.
    Blocks,
    /// All rays of a pixel, then those of the next.
    Pixels,
}

/// Pixels of a tile, by block and lane.
#[derive(Debug)]
pub(crate) struct TileImage {
    pub(crate) luma: [f32; PIXELS],
    pub(crate) rate: [f32; PIXELS],
}

impl TileImage {
    pub(crate) const BLACK: Self = Self { luma: [0.0; PIXELS], rate: [0.0; PIXELS] };
}

/// Computes luma of a tile's pixels. A pixel's rays are added up in the lattice's order, each with the bits that it has
/// alone.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
pub(crate) fn luma<'a, const RATE: bool>(
    tile_view: &TileView<'a>,
    tile: usize,
    scratch: &mut TileScratch,
    shaders: &mut Shaders<'a>,
    image: &mut TileImage,
) {
    let mut buffer = std::mem::take(&mut scratch.rays);
    let ray_blocks = tile_view.rays.of_tile(tile, &mut buffer);
    if tile_view.ways.beams {
        let mut beam = std::mem::take(&mut scratch.beam);
        beam.find(tile_view.lit.scene, tile_view.lit.view, &ray_blocks, &mut scratch.nearest, &mut scratch.list);
        let TileScratch { list, nearest, shading, .. } = scratch;
        shade::<RATE, _>(tile_view, (&beam.seen, list), (&ray_blocks, Order::Blocks), nearest, shading, shaders);
        scratch.beam = beam;
    } else {
        find(tile_view.bins, tile, &ray_blocks, scratch);
        let TileScratch { list, nearest, shading, .. } = scratch;
        shade::<RATE, _>(
            tile_view,
            (&tile_view.bins.seen, list),
            (&ray_blocks, Order::Blocks),
            nearest,
            shading,
            shaders,
        );
    }
    scratch.rays = buffer;
    image.luma = mean(&scratch.shading.luma);
    if RATE {
        image.rate = mean(&scratch.shading.rate);
    }
}

/// Computes luma of single pixels, with the bits that they have in their tiles; `number` is the tile's in the view's
/// bins.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
pub(crate) fn samples(
    tile_view: &TileView,
    number: usize,
    pixels: &Pixels,
    scratch: &mut TileScratch,
    values: &mut Vec<f32>,
) {
    let ray_blocks = pixels.ray_blocks();
    find(tile_view.bins, number, &ray_blocks, scratch);
    let TileScratch { list, nearest, shading, .. } = scratch;
    let seen = (tile_view.bins.seen.as_slice(), list.as_slice());
    shade::<false, _>(tile_view, seen, (&ray_blocks, Order::Pixels), nearest, shading, &mut Shaders::default());
    values.extend(shading.luma.chunks_exact(tile_view.rays.rays()).take(pixels.count()).map(pixel_mean));
}

/// Computes luma of a tile's pixels by the lines that pass through them: of their area, not of single rays. The rays of
/// `tile_view` are corners of the pixels.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
pub(crate) fn lines<'a>(
    tile_view: &TileView<'a>,
    pattern: &LinePattern,
    tile: usize,
    scratch: &mut TileScratch,
    shaders: &mut Shaders<'a>,
    image: &mut TileImage,
) {
    image.luma = of_lines(tile_view, (pattern, &pattern.ends, true), (tile, tile), scratch, shaders);
}

/// Computes luma of single pixels of a tile as [`lines`] does, by the lines that pass them: the bits that it has there.
/// `number` is the tile's in the bins, and `pixels` are bits, by block and lane. Other pixels have no meaning.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
pub(crate) fn line_samples(
    tile_view: &TileView,
    pattern: &LinePattern,
    (number, tile): (usize, usize),
    pixels: u64,
    scratch: &mut TileScratch,
) -> [f32; PIXELS] {
    let mut ends = std::mem::take(&mut scratch.ends);
    pattern.choose(pixels, &mut ends);
    let luma = of_lines(tile_view, (pattern, &ends, false), (number, tile), scratch, &mut Shaders::default());
    scratch.ends = ends;
    luma
}

/// Computes luma of pixels by lines with these ends, which may be `all` of the pattern.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn of_lines<'a>(
    tile_view: &TileView<'a>,
    lines: (&LinePattern, &LineEnds, bool),
    (number, tile): (usize, usize),
    scratch: &mut TileScratch,
    shaders: &mut Shaders<'a>,
) -> [f32; PIXELS] {
    let TileScratch { list, taps, straight, curved, hidden_lengths, shading, .. } = scratch;
    let around = tile_view.rays.tile(tile);
    tile_view.bins.of_tile(number, around, list);
    if tile_view.rays.is_grid() {
        let warp = Straight { rect: around, pitch: tile_view.rays.pitch() };
        by_taps(tile_view, lines, (&warp, straight), list, (taps, hidden_lengths, shading), shaders);
    } else {
        let warp = Curved::new(around, tile_view.rays.curve(tile), lines.0.slope);
        by_taps(tile_view, lines, (&warp, curved), list, (taps, hidden_lengths, shading), shaders);
    }
    taps.add_up(lines.0, &shading.luma)
}

/// Finds taps and shades them.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn by_taps<'a, TileWarp: Warp>(
    tile_view: &TileView<'a>,
    lines: (&LinePattern, &LineEnds, bool),
    (warp, envelopes): (&TileWarp, &mut Envelopes<TileWarp::Depth>),
    list: &[Entry],
    (taps, scratch, shading): (&mut Taps, &mut HiddenLengths, &mut Shading),
    shaders: &mut Shaders<'a>,
) {
    taps.find(lines, (tile_view.bins, list), warp, envelopes);
    let around = warp.rect();
    let ray_blocks = RayBlocks { x: &taps.x, y: &taps.y, around, blocks: std::slice::from_ref(around) };
    let mut hits = TileTaps { taps, pattern: lines.0, warp, scratch };
    shade::<false, _>(
        tile_view,
        (&tile_view.bins.seen, list),
        (&ray_blocks, Order::Pixels),
        &mut hits,
        shading,
        shaders,
    );
}

/// Gives what each ray of single pixels hits, one pixel after the other: 1 / z and the triangle's number in the scene, or
/// None.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
pub(crate) fn hits(
    tile_view: &TileView,
    number: usize,
    pixels: &Pixels,
    scratch: &mut TileScratch,
    mut give: impl FnMut(Option<(f32, u32)>),
) {
    let ray_blocks = pixels.ray_blocks();
    find(tile_view.bins, number, &ray_blocks, scratch);
    let TileScratch { list, nearest, .. } = scratch;
    for ray in 0..pixels.count() * tile_view.rays.rays() {
        let index = match nearest.only[0] {
            _ if list.is_empty() => NOTHING,
            NOTHING => nearest.index[ray],
            only => only,
        };
        give((index != NOTHING).then(|| {
            let Seen { triangle, inverse_depth, .. } = tile_view.bins.seen[list[index as usize].seen as usize];
            (inverse_depth.at(ray_blocks.x[ray], ray_blocks.y[ray]), triangle)
        }));
    }
}

/// Finds what the rays of a tile see by bins; `number` is the tile's in them.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn find(bins: &Bins, number: usize, ray_blocks: &RayBlocks, scratch: &mut TileScratch) {
    bins.of_tile(number, ray_blocks.around, &mut scratch.list);
    if !scratch.list.is_empty() {
        scratch.nearest.find(bins, &scratch.list, ray_blocks);
    }
}

/// Computes luma of rays, and its rate. `all` are the triangles of the tile's list; `shaders` are those of the
/// tile before, and then those of this one.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn shade<'a, const RATE: bool, Hits: TileHits>(
    tile_view: &TileView<'a>,
    (all, list): (&[Seen], &[Entry]),
    (ray_blocks, order): (&RayBlocks, Order),
    hits: &mut Hits,
    shading: &mut Shading,
    shaders: &mut Shaders<'a>,
) {
    let RayBlocks { x, y, around, .. } = *ray_blocks;
    let Shading { caster, sorted, visible, turns, occluded, picked, luma, rate, glossy, tracer } = shading;
    luma.clear();
    luma.resize(x.len(), tile_view.background.0);
    rate.clear();
    rate.resize(if RATE { x.len() } else { 0 }, tile_view.background.1);
    let seen = |index: u32| &all[list[index as usize].seen as usize];
    visible.clear();
    if !list.is_empty() {
        visible.extend((0..).take(list.len()).filter(|&index| hits.sees(index)));
    }
    tile_view.lit.scene.prefetch_glossy(visible.iter().map(|&index| seen(index).triangle));
    // What is glossy is shaded ray by ray, pixel by pixel.
    let all_visible = visible.len();
    visible.retain(|&index| !tile_view.lit.scene.is_glossy(seen(index).triangle));
    let any_glossy = visible.len() < all_visible;
    add_sky::<RATE>(tile_view, (x, y), |ray| list.is_empty() || hits.hit(ray).is_none(), (luma, rate));
    shaders.set_up(&tile_view.lit, visible.iter().map(|&index| seen(index)));
    // Where nothing that stands still throws a shadow, only bodies are looked through for some that do.
    let open = take_turns(shaders, turns, occluded);
    let (mut one, mut one_rate) = (Lanes::ZERO, Lanes::ZERO);
    let mut at = 0;
    while at < turns.len() {
        let first = at;
        let (group, from) = if at < open { (0..open, 1) } else { (open..turns.len(), 0) };
        let shadows = tile_view.lit.scene.has_shadows_from(from);
        let by_rays = shadows && group.len() > tile_view.ways.receivers;
        let of = |at: usize| (&shaders[turns[at] as usize], visible[turns[at] as usize]);
        if !shadows {
            at = group.end;
            caster.shadow.begin(&tile_view.lit, from);
        } else if by_rays {
            at = group.end;
            caster.shadow.by_rays(&tile_view.lit, from, |light| group.clone().any(|at| of(at).0.lit_by(light)));
        } else {
            // Neighbours in space follow each other in the list: what shadows them is searched for together.
            at += 1;
            let index = of(first).1;
            let own = if Hits::ALONE { &hits.around(index) } else { around };
            let mut patch = Patch::new(&tile_view.lit, seen(index), own);
            while !Hits::ALONE && at < group.end {
                let other = Patch::new(&tile_view.lit, seen(of(at).1), around);
                let Some(both) = patch.with(&other) else { break };
                patch = both;
                at += 1;
            }
            let falls = |light: usize| (first..at).any(|at| of(at).0.lit_by(light));
            let alone = (at == first + 1).then_some(seen(index).triangle);
            caster.shadow.search(&tile_view.lit, (&patch, from), alone, falls);
        }
        let run = first..at;
        sorted.resize_with(run.len().max(sorted.len()), Sorted::default);
        for (sorted, at) in sorted.iter_mut().zip(run.clone()) {
            hits.sort(of(at).1, !by_rays, sorted);
        }
        if caster.shadow.falls() {
            caster.clear();
            let by_lines =
                !by_rays && run.clone().all(|at| hits.cast(&tile_view.lit, caster, seen(of(at).1), of(at).1));
            if !by_lines {
                for (sorted, at) in sorted.iter().zip(run.clone()) {
                    caster.fall_on(&tile_view.lit, seen(of(at).1), &sorted.scattered);
                }
                caster.cast(&tile_view.lit, x, y);
            }
        }
        for (number, ((shader, index), sorted)) in run.map(of).zip(&*sorted).enumerate() {
            for row in &sorted.rows {
                shaded::<RATE>(shader, &row.rays(x, y, picked), caster, number, (&mut one, &mut one_rate));
                row.put(&one, hits.indices(), index, luma);
                if RATE {
                    row.put(&one_rate, hits.indices(), index, rate);
                }
            }
            for numbers in sorted.scattered.chunks(MOST) {
                let portion = Portion::picked(numbers, x, y, picked);
                shaded::<RATE>(shader, &portion, caster, number, (&mut one, &mut one_rate));
                for (i, &ray) in numbers.iter().enumerate() {
                    luma[ray as usize] = one[i];
                    if RATE {
                        rate[ray as usize] = one_rate[i];
                    }
                }
            }
        }
    }
    if any_glossy {
        let (per_block, per_pixel) = (x.len() / ray_blocks.blocks.len(), tile_view.rays.rays());
        let at = |pixel: usize, number: usize| match order {
            Order::Blocks => pixel / LANES * per_block + number * LANES + pixel % LANES,
            Order::Pixels => pixel * per_pixel + number,
        };
        let triangle = |ray: usize| hits.hit(ray).map(|index| seen(index).triangle);
        let rays = GlossyRays { pixels: x.len() / per_pixel, at, triangle, x, y };
        if RATE {
            gloss::<Rated>(tile_view, &rays, (glossy, tracer), (luma, rate));
        } else {
            gloss::<f64>(tile_view, &rays, (glossy, tracer), (luma, rate));
        }
    }
}

/// Rays of some pixels, of which some see glossy triangles.
struct GlossyRays<'a, At, Triangle> {
    pixels: usize,
    /// Gives the number among all rays of a pixel's ray, from their numbers.
    at: At,
    /// Gives what that sees.
    triangle: Triangle,
    x: &'a [f32],
    y: &'a [f32],
}

/// Puts the numbers of shaders in order, those first from which nothing that stands still hides a light; returns how many
/// these are. `occluded` is room for the others.
fn take_turns(shaders: &[Shader], turns: &mut Vec<u32>, occluded: &mut Vec<u32>) -> usize {
    turns.clear();
    for (at, shader) in (0..).zip(shaders) {
        if shader.is_unoccluded() { turns.push(at) } else { occluded.push(at) }
    }
    let open = turns.len();
    turns.append(occluded);
    open
}

/// Adds luma of the sky, and its rate, to rays that see it.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn add_sky<const RATE: bool>(
    tile_view: &TileView,
    (x, y): (&[f32], &[f32]),
    sees_it: impl Fn(usize) -> bool,
    (luma, rate): (&mut [f32], &mut [f32]),
) {
    let Some(sky) = &tile_view.lit.scene.sky else { return };
    let (pose, [factor, factor_rate]) = (&tile_view.lit.view.poses[0], tile_view.lit.view.factors[sky.light as usize]);
    for ray in (0..x.len()).filter(|&ray| sees_it(ray)) {
        let (one, one_rate) = sky.luma(pose, x[ray], y[ray]);
        luma[ray] += single([factor])[0] * one;
        if RATE {
            rate[ray] += single([factor])[0] * one_rate + single([factor_rate])[0] * one;
        }
    }
}

/// Computes luma, and its rate, of those rays that see glossy triangles. That of the others is known.
#[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
fn gloss<N: Number>(
    tile_view: &TileView,
    rays: &GlossyRays<impl Fn(usize, usize) -> usize, impl Fn(usize) -> Option<u32>>,
    (glossy, scratch): (&mut Vec<GlossyRay>, &mut TracerScratch),
    (luma, rate): (&mut [f32], &mut [f32]),
) {
    let (Some(gloss), Some(pattern)) = (&tile_view.lit.scene.gloss, &tile_view.pattern) else { return };
    let mut tracer = Tracer { lit: &tile_view.lit, gloss, pattern, scratch };
    let mut values: Vec<N> = vec![];
    for pixel in 0..rays.pixels {
        glossy.clear();
        let mut others = 0.0;
        for &number in pattern.turns() {
            let at = (rays.at)(pixel, number);
            match (rays.triangle)(at).and_then(|triangle| Some((triangle, gloss.finish_number(triangle)?))) {
                Some((triangle, finish)) => glossy.push(GlossyRay { at, number, triangle, finish }),
                None => others += f64::from(luma[at]),
            }
        }
        let whole = Whole { rays: tile_view.rays.rays(), first: pattern.first(), others };
        for part in parts(glossy) {
            shade_part(part.len(), whole, &mut values, |ray| {
                let GlossyRay { at, number, triangle, .. } = part[ray];
                tracer.luma(triangle, [rays.x[at], rays.y[at]].map(f64::from), number)
            });
            for (ray, value) in part.iter().zip(&values) {
                luma[ray.at] = value.value() as f32;
                if N::RATED {
                    rate[ray.at] = value.rate() as f32;
                }
            }
        }
    }
}

#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn shaded<const RATE: bool>(
    shader: &Shader,
    portion: &Portion,
    caster: &Caster,
    receiver: usize,
    out: (&mut Lanes, &mut Lanes),
) {
    match portion {
        _ if shader.dark => (*out.0, *out.1) = (Lanes::ZERO, Lanes::ZERO),
        Portion::Full(rays) => shader.luma::<RATE, true>(rays, caster, receiver, out),
        Portion::Fewer(rays) => shader.luma::<RATE, false>(rays, caster, receiver, out),
    }
}

/// Returns the mean of each pixel's rays.
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

/// Returns the mean of one pixel's rays: the same additions as [`mean`]'s.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
#[allow(clippy::cast_precision_loss, reason = "there are at most 1024 rays a pixel")]
fn pixel_mean(rays: &[f32]) -> f32 {
    rays.iter().fold(0.0, |sum, ray| sum + ray) / rays.len() as f32
}

/// Hands on for each of a tile's rays the inverse depth of what it sees, and the number of this triangle in the scene.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
pub(super) fn nearest<Each: FnMut(usize, f32, u32)>(
    tile_view: &TileView,
    tile: usize,
    scratch: &mut TileScratch,
    mut each: Each,
) {
    let ray_blocks = tile_view.rays.of_tile(tile, &mut scratch.rays);
    let TileScratch { list, nearest, beam, .. } = scratch;
    let all = if tile_view.ways.beams {
        beam.find(tile_view.lit.scene, tile_view.lit.view, &ray_blocks, nearest, list);
        &beam.seen
    } else {
        tile_view.bins.of_tile(tile, ray_blocks.around, list);
        nearest.find(tile_view.bins, list, &ray_blocks);
        &tile_view.bins.seen
    };
    let (x, y) = (ray_blocks.x, ray_blocks.y);
    let seen = |index: u32| &all[list[index as usize].seen as usize];
    let per_block = x.len() / BLOCKS;
    for ray in 0..x.len() {
        let only = nearest.only[ray / per_block];
        if only != NOTHING {
            each(ray, seen(only).inverse_depth.at(x[ray], y[ray]), seen(only).triangle);
        } else if nearest.index[ray] != NOTHING {
            each(ray, nearest.inverse_depth[ray], seen(nearest.index[ray]).triangle);
        }
    }
}
