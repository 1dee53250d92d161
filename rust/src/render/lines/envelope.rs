//! What lines see: the nearest triangle along each of them, from edge to edge.
//!
//! On a line a triangle is an interval, and its inverse depth is linear there. Triangles are let in from front to back;
//! where two of them pass through each other, the line is cut. Intervals are found for all lines of a tile together, in
//! vector code.
//!
//! What must not break: triangles are let in by nearness and then by their numbers in the scene, because roundings at
//! cuts depend on the order. Two triangles with a common edge have the same bits there, so that no gap is seen.

use std::ops::Range;

use super::pattern::LinePattern;
use crate::render::geometry::linear::{Linear, Rect};
use crate::render::geometry::pixel_rays::LANES;
use crate::render::visibility::bins::{Entry, Seen};

/// Shorter intervals are left to their neighbours, pixels.
pub(super) const LEAST: f32 = 2e-5;

/// Inverse depths below this fraction of a tile's largest one lie at the horizon.
const HORIZON: f64 = 1e-9;

/// Functions that change by less than this fraction along a line are taken as constant there.
const PARALLEL: f64 = 1e-12;

/// After so many triangles it is looked for what lies behind all that lines see.
const BETWEEN: usize = 8;

/// What a line sees between two columns: the number of a candidate, from front to back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Segment {
    pub(super) left: f32,
    pub(super) right: f32,
    pub(super) candidate: u32,
}

/// A linear function in a tile's pixels: per column, per row, at the corner.
#[derive(Clone, Copy, Debug)]
pub(super) struct InTile(pub(super) [f64; 3]);

/// Inverse depth in a tile's pixels: per column along a line, per row at column 0, and there at row 0.
#[derive(Clone, Copy, Debug)]
struct Depth([f32; 3]);

/// A triangle that a tile may see.
#[derive(Clone, Copy, Debug)]
pub(super) struct Candidate {
    /// In the tile's list.
    pub(super) index: u32,
    number: u32,
    nearest: f32,
    covers: bool,
}

/// Where each line of a pattern lies within what linear functions allow: columns.
#[derive(Debug, Default)]
pub(super) struct Intervals {
    pub(super) from: Vec<f32>,
    pub(super) to: Vec<f32>,
    /// The lists of [`LANES`] lines that are looked at.
    pub(super) lists: Range<usize>,
}

/// What all lines of a tile see.
#[derive(Debug, Default)]
pub(super) struct Envelopes {
    pub(super) candidates: Vec<Candidate>,
    /// Of each line, from left to right.
    pub(super) segments: Vec<Vec<Segment>>,
    spare: Vec<Segment>,
    depths: Vec<Depth>,
    /// Of each line the inverse depth behind which nothing is seen.
    hidden: Vec<f32>,
    intervals: Intervals,
    /// The index of a triangle that covers the tile behind all that was let in; None for nothing.
    pub(super) behind: Option<u32>,
}

impl InTile {
    /// Returns a function in a tile that begins at a corner, of pixels with a pitch.
    pub(super) fn new(function: [f64; 3], tile_rect: &Rect, pitch: [f64; 2]) -> Self {
        let [a, b, c] = function;
        let [x, y] = tile_rect.low.map(f64::from);
        Self([a * pitch[0], b * pitch[1], a * x + (b * y + c)])
    }

    fn of_linear(function: Linear, tile_rect: &Rect, pitch: [f64; 2]) -> Self {
        Self::new(function.0.map(f64::from), tile_rect, pitch)
    }
}

impl Depth {
    #[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
    fn new(InTile([a, b, c]): InTile, slope: f32) -> Self {
        Self([a + b * f64::from(slope), b, c].map(|value| value as f32))
    }

    fn at(&self, column: f32, height: f32) -> f32 {
        self.0[0] * column + (self.0[1] * height + self.0[2])
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Intervals {
    /// Begins with all of each line, of some lists of lines.
    #[inline(always)]
    pub(super) fn begin(&mut self, pattern: &LinePattern, lists: Range<usize>) {
        let lines = lists.start * LANES..lists.end * LANES;
        self.from.resize(pattern.lefts.len(), 0.0);
        self.to.resize(pattern.rights.len(), 0.0);
        self.from[lines.clone()].copy_from_slice(&pattern.lefts[lines.clone()]);
        self.to[lines.clone()].copy_from_slice(&pattern.rights[lines]);
        self.lists = lists;
    }

    /// Takes away where a function is negative.
    #[inline(always)]
    #[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
    pub(super) fn clip(&mut self, InTile([a, b, c]): InTile, pattern: &LinePattern) {
        let along = a + b * f64::from(pattern.slope);
        let lines = self.lists.start * LANES..self.lists.end * LANES;
        let heights = pattern.heights[lines.clone()].chunks_exact(LANES);
        let (from, to) = (&mut self.from[lines.clone()], &mut self.to[lines]);
        if along.abs() <= PARALLEL * (a.abs() + b.abs() + c.abs()) {
            let (by, offset) = (b as f32, c as f32);
            for (to, heights) in to.chunks_exact_mut(LANES).zip(heights) {
                for i in 0..LANES {
                    to[i] = if by * heights[i] + offset < 0.0 { -1.0 } else { to[i] };
                }
            }
            return;
        }
        let (by, offset) = ((-b / along) as f32, (-c / along) as f32);
        if along > 0.0 {
            for (from, heights) in from.chunks_exact_mut(LANES).zip(heights) {
                for i in 0..LANES {
                    let column = by * heights[i] + offset;
                    from[i] = if column > from[i] { column } else { from[i] };
                }
            }
        } else {
            for (to, heights) in to.chunks_exact_mut(LANES).zip(heights) {
                for i in 0..LANES {
                    let column = by * heights[i] + offset;
                    to[i] = if column < to[i] { column } else { to[i] };
                }
            }
        }
    }

    /// Returns whether any of some lines has a length.
    #[inline(always)]
    pub(super) fn any(&self, list: usize) -> bool {
        let (from, to) = (&self.from[list * LANES..][..LANES], &self.to[list * LANES..][..LANES]);
        let mut any = [0u32; LANES];
        for i in 0..LANES {
            any[i] = u32::from(to[i] - from[i] > LEAST);
        }
        any.iter().fold(0, |all, one| all | one) != 0
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Envelopes {
    /// Finds what the lines of a tile see of a list of triangles; `tile_rect` begins at the tile's corner.
    #[inline(always)]
    pub(super) fn find(
        &mut self,
        pattern: &LinePattern,
        (seen, list): (&[Seen], &[Entry]),
        tile_rect: &Rect,
        pitch: [f64; 2],
    ) {
        self.order(seen, list, tile_rect);
        self.segments.resize_with(self.segments.len().max(pattern.heights.len()), Vec::new);
        self.segments.iter_mut().for_each(Vec::clear);
        self.hidden.clear();
        self.hidden.resize(pattern.heights.len(), 0.0);
        self.depths.clear();
        self.behind = None;
        // What was let in is nowhere farther than this.
        let mut farthest = f32::INFINITY;
        let many = self.candidates.len() > BETWEEN;
        for number in 0..self.candidates.len() {
            let Candidate { index, nearest, covers, .. } = self.candidates[number];
            if many && number % BETWEEN == 0 && self.closed(pattern) > nearest {
                break;
            }
            let triangle = &seen[list[index as usize].seen as usize];
            let is_behind = triangle.inverse_depth.highest(tile_rect) <= farthest;
            let lowest = triangle.inverse_depth.lowest(tile_rect);
            let is_last = self.candidates.get(number + 1).is_none_or(|next| next.nearest <= lowest);
            if covers && is_behind && is_last {
                self.behind = Some(index);
                break;
            }
            farthest = farthest.min(lowest);
            let inverse_depth = InTile::of_linear(triangle.inverse_depth, tile_rect, pitch);
            self.depths.push(Depth::new(inverse_depth, pattern.slope));
            self.intervals.begin(pattern, 0..pattern.lists());
            if !covers {
                for edge in triangle.edges {
                    self.intervals.clip(InTile::of_linear(edge, tile_rect, pitch), pattern);
                }
                if lowest <= 0.0 {
                    let [a, b, c] = inverse_depth.0;
                    let horizon = InTile([a, b, c - HORIZON * (a.abs() + b.abs() + c.abs())]);
                    self.intervals.clip(horizon, pattern);
                }
            }
            self.let_in(number, nearest, is_behind, pattern);
        }
    }

    fn order(&mut self, seen: &[Seen], list: &[Entry], tile_rect: &Rect) {
        self.candidates.clear();
        self.candidates.extend((0..).zip(list).map(|(index, entry)| {
            let triangle = &seen[entry.seen as usize];
            let (nearest, number) = (triangle.nearest_in(tile_rect), triangle.triangle);
            Candidate { index, number, nearest, covers: entry.covers }
        }));
        self.candidates.sort_unstable_by(|a, b| b.nearest.total_cmp(&a.nearest).then(a.number.cmp(&b.number)));
    }

    /// Lets a candidate be seen in its intervals.
    #[inline(always)]
    #[allow(clippy::cast_possible_truncation, reason = "a tile has fewer than 2^32 triangles")]
    fn let_in(&mut self, number: usize, nearest: f32, is_behind: bool, pattern: &LinePattern) {
        let Self { segments, spare, depths, hidden, intervals, .. } = self;
        for list in 0..pattern.lists() {
            if !intervals.any(list) {
                continue;
            }
            for line in list * LANES..(list + 1) * LANES {
                let (left, right) = (intervals.from[line], intervals.to[line]);
                if right - left > LEAST && nearest >= hidden[line] {
                    let new = Segment { left, right, candidate: number as u32 };
                    let of_line = &mut segments[line];
                    if of_line.is_empty() {
                        of_line.push(new);
                    } else if insert(of_line, spare, (depths, pattern.heights[line]), new, is_behind) {
                        std::mem::swap(of_line, spare);
                    }
                }
            }
        }
    }

    /// Finds the inverse depth behind which each line sees nothing; returns the least of them.
    fn closed(&mut self, pattern: &LinePattern) -> f32 {
        let mut least = f32::INFINITY;
        for (line, (&left, &right)) in pattern.lefts.iter().zip(&pattern.rights).enumerate() {
            if right > left {
                self.hidden[line] = closed(&self.segments[line], &self.depths, pattern.heights[line], (left, right));
                least = least.min(self.hidden[line]);
            }
        }
        least
    }
}

/// Adds a segment where it is not too short; one that continues the last one is joined to it.
fn put(segments: &mut Vec<Segment>, left: f32, right: f32, candidate: u32) {
    if right - left <= LEAST {
        return;
    }
    match segments.last_mut() {
        Some(last) if last.candidate == candidate && left - last.right <= LEAST => last.right = right,
        Some(last) if left - last.right <= LEAST => {
            let left = last.right;
            segments.push(Segment { left, right, candidate });
        }
        _ => segments.push(Segment { left, right, candidate }),
    }
}

/// Lets a triangle be seen where it is nearer than what was seen so far; says whether that changes anything. One that is
/// known to be behind all of that is seen in gaps alone.
fn insert(
    old: &[Segment],
    out: &mut Vec<Segment>,
    (depths, height): (&[Depth], f32),
    new: Segment,
    is_behind: bool,
) -> bool {
    out.clear();
    let depth = depths[new.candidate as usize];
    let (mut at, mut changed) = (new.left, false);
    for segment in old {
        if at < segment.left && at < new.right {
            let end = segment.left.min(new.right);
            changed |= end - at > LEAST;
            put(out, at, end, new.candidate);
        }
        at = at.max(segment.right);
        let (left, right) = (segment.left.max(new.left), segment.right.min(new.right));
        if is_behind || right - left <= LEAST {
            put(out, segment.left, segment.right, segment.candidate);
            continue;
        }
        let before = depths[segment.candidate as usize];
        let first = depth.at(left, height) - before.at(left, height);
        let last = depth.at(right, height) - before.at(right, height);
        if first <= 0.0 && last <= 0.0 {
            put(out, segment.left, segment.right, segment.candidate);
            continue;
        }
        changed = true;
        let cut = left + (right - left) * (first / (first - last));
        let (from, to) = match (first > 0.0, last > 0.0) {
            (true, true) => (left, right),
            (true, false) => (left, cut),
            _ => (cut, right),
        };
        put(out, segment.left, from, segment.candidate);
        put(out, from, to, new.candidate);
        put(out, to, segment.right, segment.candidate);
    }
    if at < new.right {
        changed |= new.right - at > LEAST;
        put(out, at, new.right, new.candidate);
    }
    changed
}

/// Returns the inverse depth behind which nothing is seen on a line.
fn closed(segments: &[Segment], depths: &[Depth], height: f32, (left, right): (f32, f32)) -> f32 {
    let (mut at, mut least) = (left, f32::INFINITY);
    for segment in segments {
        if segment.left - at > LEAST {
            return 0.0;
        }
        at = segment.right;
        let depth = &depths[segment.candidate as usize];
        least = least.min(depth.at(segment.left, height)).min(depth.at(segment.right, height));
    }
    if right - at > LEAST { 0.0 } else { least }
}
