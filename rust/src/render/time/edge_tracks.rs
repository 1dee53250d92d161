//! Edge tracks: finds the pixels that edges of the geometry pass, and their luma during that time.
//!
//! Samples at a fixed spacing miss what passes between them. The instants at which edges pass are known from the
//! geometry ([`super::edges`]), so a few rendered instants and these jumps give luma at all times between
//! ([`super::tracks`]).
//!
//! What must not break: pixels whose luma neither edges nor rates explain are reported, so that the caller can render
//! them more finely.

use rayon::prelude::*;

use super::edges::{Edges, Pass};
use super::smooth_motion::SmoothMotion;
use super::tracks::{INSTANTS, InnerSample, Piece, Pixel, RaySample, Span, Tolerated};
use crate::error::{Error, Result};
use crate::render::geometry::pixel_rays::PixelRays;
use crate::render::geometry::view::View;
use crate::render::renderer::{Renderer, check_length};

/// What [`Renderer::edge_tracks`] is to do.
#[derive(Clone, Copy, Debug)]
pub struct TrackSettings {
    /// How many pixels away, in x or y, the farthest one lies whose luma a pixel takes.
    pub reach: usize,
    /// Change of log luma that is tolerated.
    pub tolerated: f32,
    /// The dark level, in luma.
    pub log_eps: f32,
}

/// Luma of the pixels that edges pass, through one span of time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EdgeTracks {
    /// The pixels whose luma jumps, row by row, and those that take luma from them; increasing.
    pub pixels: Vec<u32>,
    /// Those that do what neither edges nor their rates tell.
    pub unknown: Vec<u32>,
    /// Samples by pixel and time: which pixel.
    pub sample_pixel: Vec<u32>,
    /// When, microseconds.
    pub sample_t_us: Vec<i64>,
    /// Luma; between two samples it changes evenly.
    pub sample_luma: Vec<f32>,
    /// How many pixels were rendered for it, one at several instants counted so often.
    pub rendered: usize,
}

const FIRST: usize = 0;
const MIDDLE: usize = INSTANTS / 2;
const LAST: usize = INSTANTS - 1;
const BETWEEN: [usize; 2] = [INSTANTS / 4, INSTANTS / 2 + INSTANTS / 4];

impl Renderer {
    /// Luma of the pixels that edges pass in each of some spans of time, each seen at five instants: its ends, its middle,
    /// and about half way between. The camera must not go far in a span.
    ///
    /// With a reach, the pixels that others take luma from are tracked too, with samples at the span's ends.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for views of another scene, another number of views than of instants, or instants that do not
    /// increase.
    pub fn edge_tracks(
        &self,
        rays: &PixelRays,
        views: &[View],
        t_us: &[i64],
        settings: TrackSettings,
    ) -> Result<Vec<EdgeTracks>> {
        let views = &self.centred(views)?;
        check_length(views.len(), t_us.len())?;
        let (spans, rest) = t_us.as_chunks::<INSTANTS>();
        if !rest.is_empty() || !spans.iter().all(|span| span.is_sorted_by(|a, b| a < b)) {
            return Err(Error::Argument(format!("spans have {INSTANTS} increasing instants each, got {t_us:?}")));
        }
        let edges = self.edges.get_or_init(|| Edges::of_scene(&self.scene));
        self.install(|| {
            let of_spans = views.par_chunks(INSTANTS).zip(spans);
            let tracked = of_spans.map(|(views, t_us)| {
                let seen = SeenSpan::new(self, rays, views, edges, Span { t_us: *t_us });
                seen.tracks(settings)
            });
            tracked.collect()
        })
    }
}

/// Nothing yet.
const NONE: u32 = u32::MAX;

/// What is known of one pixel in a span.
#[derive(Clone, Copy)]
struct Known {
    /// Where those that pass its rays begin and end.
    passes: [u32; 2],
    /// Where its rays begin at each instant at which they were rendered.
    firsts: [u32; INSTANTS],
    /// The number of its halves.
    halves: u32,
    /// Where its inner samples begin and end.
    inner_samples: [u32; 2],
}

/// What is known of a span.
struct SeenSpan<'a> {
    renderer: &'a Renderer,
    rays: &'a PixelRays,
    views: Vec<View>,
    motion: SmoothMotion<'a>,
    span: Span,
    passes: Vec<Pass>,
    known: Vec<Known>,
    ray_samples: Vec<RaySample>,
    halves: Vec<[Piece; 2]>,
    inner_samples: Vec<InnerSample>,
}

#[allow(clippy::cast_possible_truncation, reason = "there are fewer rays and pixels than 2^32")]
impl<'a> SeenSpan<'a> {
    fn new(renderer: &'a Renderer, rays: &'a PixelRays, views: &'a [View], edges: &Edges, span: Span) -> Self {
        let passes = edges.passes(rays, [&views[FIRST], &views[MIDDLE], &views[LAST]], span.middle());
        let mut known = vec![
            Known { passes: [0; 2], firsts: [NONE; INSTANTS], halves: NONE, inner_samples: [0; 2] };
            rays.pixels()
        ];
        let mut first = 0;
        for of_pixel in passes.chunk_by(|a, b| a.pixel == b.pixel) {
            let end = first + of_pixel.len() as u32;
            known[of_pixel[0].pixel as usize].passes = [first, end];
            first = end;
        }
        let motion = SmoothMotion::new([&views[FIRST], &views[MIDDLE], &views[LAST]], span);
        let views =
            views.iter().enumerate().map(|(i, view)| motion.with_rates(view.clone(), span.fraction(i))).collect();
        Self {
            renderer,
            rays,
            views,
            motion,
            span,
            passes,
            known,
            ray_samples: vec![],
            halves: vec![],
            inner_samples: vec![],
        }
    }

    fn tracks(mut self, settings: TrackSettings) -> EdgeTracks {
        let (span, tolerated) = (self.span, Tolerated { log: settings.tolerated, log_eps: settings.log_eps });
        let mut passed: Vec<u32> =
            (0..self.known.len() as u32).filter(|&pixel| self.known[pixel as usize].passes[1] > 0).collect();
        self.look_at(&passed);
        // Hidden edges pass too.
        passed.retain(|&pixel| self.halves_of(pixel).iter().any(Piece::is_passed));
        let pixels = self.grown(&passed, settings.reach);
        let tracked = self.grown(&pixels, settings.reach);
        self.look_at(&tracked);
        let wants_more = |&pixel: &u32| self.pixel(pixel).wants_more(self.halves_of(pixel), &span, tolerated);
        let more: Vec<u32> = tracked.iter().copied().filter(wants_more).collect();
        self.see(&more, &BETWEEN);
        for &pixel in &more {
            self.look_between(pixel);
        }
        let mut tracks = EdgeTracks { pixels, ..EdgeTracks::default() };
        let (mut samples, mut unknown) = (vec![], vec![]);
        for number in tracked {
            let pixel = self.pixel(number);
            samples.clear();
            if settings.reach > 0 {
                samples.push((span.t_us[FIRST], pixel.luma(FIRST)));
            }
            let quarters = pixel.quarters(&span);
            let pieces = quarters.as_ref().map_or(self.halves_of(number).as_slice(), <[Piece; 4]>::as_slice);
            if pixel.samples(pieces, &span, tolerated, &mut samples) {
                unknown.push(number);
            }
            if settings.reach > 0 {
                samples.push((span.t_us[LAST], pixel.luma(LAST)));
            }
            tracks.sample_pixel.extend(std::iter::repeat_n(number, samples.len()));
            tracks.sample_t_us.extend(samples.iter().map(|sample| sample.0));
            tracks.sample_luma.extend(samples.iter().map(|sample| sample.1));
        }
        tracks.rendered = self.ray_samples.len() / self.rays.rays() + self.inner_samples.len();
        tracks.unknown = self.grown(&unknown, settings.reach);
        tracks.unknown.retain(|pixel| tracks.pixels.binary_search(pixel).is_ok());
        tracks
    }

    /// Renders pixels at the ends and in the middle, and finds what they do in both halves.
    fn look_at(&mut self, pixels: &[u32]) {
        self.see(pixels, &[FIRST, MIDDLE, LAST]);
        for &number in pixels {
            if self.known[number as usize].halves == NONE {
                self.known[number as usize].halves = self.halves.len() as u32;
                let halves = self.pixel(number).halves(&self.span);
                self.halves.push(halves);
            }
        }
    }

    fn halves_of(&self, number: u32) -> &[Piece; 2] {
        &self.halves[self.known[number as usize].halves as usize]
    }

    /// Renders the rays of pixels at some instants, where that was not done.
    fn see(&mut self, pixels: &[u32], instants: &[usize]) {
        for &instant in instants {
            let unseen = |pixel: &u32| self.known[*pixel as usize].firsts[instant] == NONE;
            let new: Vec<u32> = pixels.iter().copied().filter(unseen).collect();
            if new.is_empty() {
                continue;
            }
            let mut first = self.ray_samples.len();
            for number in self.renderer.ray_samples(self.rays, &self.views[instant], &new, &mut self.ray_samples) {
                self.known[new[number] as usize].firsts[instant] = first as u32;
                first += self.rays.rays();
            }
        }
    }

    /// Looks at the rays of a pixel between edges that pass them.
    fn look_between(&mut self, number: u32) {
        let Some(quarters) = self.pixel(number).quarters(&self.span) else { return };
        let first = self.inner_samples.len();
        for (ray, fraction) in quarters.iter().flat_map(|piece| piece.unseen.iter().copied()) {
            let mut ray_samples = vec![];
            let _ = self.renderer.ray_samples(self.rays, &self.motion.at(fraction), &[number], &mut ray_samples);
            self.inner_samples.push(InnerSample { ray, fraction, ray_sample: ray_samples[ray as usize] });
        }
        self.inner_samples[first..].sort_unstable_by(|a, b| a.ray.cmp(&b.ray).then(a.fraction.total_cmp(&b.fraction)));
        self.known[number as usize].inner_samples = [first as u32, self.inner_samples.len() as u32];
    }

    fn pixel(&self, number: u32) -> Pixel<'_> {
        let Known { passes, firsts, inner_samples, .. } = self.known[number as usize];
        let rays = self.rays.rays();
        Pixel {
            ray_samples: firsts
                .map(|first| (first != NONE).then(|| &self.ray_samples[first as usize..first as usize + rays])),
            passes: &self.passes[passes[0] as usize..passes[1] as usize],
            inner_samples: &self.inner_samples[inner_samples[0] as usize..inner_samples[1] as usize],
        }
    }

    /// Pixels and all that lie within reach of them, increasing.
    fn grown(&self, pixels: &[u32], reach: usize) -> Vec<u32> {
        if reach == 0 {
            return pixels.to_vec();
        }
        let (width, height) = (self.rays.width(), self.rays.height());
        let mut near = vec![false; width * height];
        for &pixel in pixels {
            let (column, row) = (pixel as usize % width, pixel as usize / width);
            let columns = column.saturating_sub(reach)..(column + reach + 1).min(width);
            for row in row.saturating_sub(reach)..(row + reach + 1).min(height) {
                near[row * width..][columns.clone()].fill(true);
            }
        }
        let near_pixels = near.iter().enumerate().filter(|(_, near)| **near);
        near_pixels.map(|(pixel, _)| pixel as u32).collect()
    }
}
