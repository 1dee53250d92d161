//! What lines see: the nearest triangle along each of them, from edge to edge.
//!
//! On a line a triangle is an interval, and its inverse depth is linear there, or nearly so behind a lens with distortion
//! ([`warp`](super::warp)). Triangles are let in from front to back; where two of them pass through each other, the line
//! is cut.
//!
//! What must not break: triangles are let in by nearness and then by their numbers in the scene, because roundings at
//! cuts depend on the order. Two triangles with a common edge have the same bits there, so that no gap is seen.

use super::intervals::{Intervals, LEAST};
use super::pattern::{LineEnds, LinePattern};
use super::warp::{LineDepth, TileFunction, Warp};
use crate::render::geometry::linear::{Linear, Rect};
use crate::render::geometry::pixel_rays::LANES;
use crate::render::visibility::bins::{Entry, Seen};

/// Inverse depths below this fraction of a tile's largest one lie at the horizon.
const HORIZON: f64 = 1e-9;

/// After so many triangles it is looked for what lies behind all that lines see.
const BETWEEN: usize = 8;

/// What a line sees between two columns: the number of a candidate, from front to back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Segment {
    pub(super) left: f32,
    pub(super) right: f32,
    pub(super) candidate: u32,
}

/// A triangle that a tile may see.
#[derive(Clone, Copy, Debug)]
pub(super) struct Candidate {
    /// In the tile's list.
    pub(super) index: u32,
    number: u32,
    nearest: f32,
    covers: bool,
}

/// What all lines of a tile see.
#[derive(Debug, Default)]
pub(crate) struct Envelopes<Depth> {
    pub(super) candidates: Vec<Candidate>,
    /// Of each line, from left to right.
    pub(super) segments: Vec<Vec<Segment>>,
    spare: Vec<Segment>,
    depths: Vec<Depth>,
    /// Of each line the inverse depth behind which nothing is seen, and whether it sees something else since that was
    /// found.
    hidden: Vec<f32>,
    changed: Vec<bool>,
    intervals: Intervals,
    /// The index of a triangle that covers the tile behind all that was let in; None for nothing.
    pub(super) behind: Option<u32>,
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl<Depth: LineDepth> Envelopes<Depth> {
    /// Finds what lines of a tile see of a list of triangles.
    #[inline(always)]
    pub(super) fn find<TileWarp: Warp<Depth = Depth>>(
        &mut self,
        (pattern, ends): (&LinePattern, &LineEnds),
        (seen, list): (&[Seen], &[Entry]),
        warp: &TileWarp,
    ) {
        let tile_rect = warp.rect();
        self.order(seen, list, tile_rect);
        self.segments.resize_with(self.segments.len().max(pattern.heights.len()), Vec::new);
        self.segments.iter_mut().for_each(Vec::clear);
        self.hidden.clear();
        self.hidden.resize(pattern.heights.len(), 0.0);
        self.changed.clear();
        self.changed.resize(pattern.heights.len(), true);
        self.depths.clear();
        self.behind = None;
        // What was let in is nowhere farther than this.
        let mut farthest = f32::INFINITY;
        let many = self.candidates.len() > BETWEEN;
        for number in 0..self.candidates.len() {
            let Candidate { index, nearest, covers, .. } = self.candidates[number];
            if many && number % BETWEEN == 0 && self.closed(pattern, ends) > nearest {
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
            let in_tile = |Linear(function): Linear| warp.function(function.map(f64::from));
            let inverse_depth = in_tile(triangle.inverse_depth);
            self.depths.push(inverse_depth.depth(pattern));
            self.intervals.begin(ends, ends.lists.clone());
            if !covers {
                for edge in triangle.edges {
                    let edge = in_tile(edge);
                    if edge.sign(pattern) <= 0.0 {
                        edge.clip(&mut self.intervals, pattern);
                    }
                }
                if lowest <= 0.0 {
                    inverse_depth.lowered(HORIZON).clip(&mut self.intervals, pattern);
                }
            }
            self.let_in(number, nearest, is_behind, (pattern, ends));
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
    fn let_in(&mut self, number: usize, nearest: f32, is_behind: bool, (pattern, ends): (&LinePattern, &LineEnds)) {
        let Self { segments, spare, depths, hidden, changed, intervals, .. } = self;
        for list in ends.lists.clone() {
            if !intervals.any(list) {
                continue;
            }
            for line in list * LANES..(list + 1) * LANES {
                if nearest < hidden[line] {
                    continue;
                }
                intervals.each(line, |left, right| {
                    let new = Segment { left, right, candidate: number as u32 };
                    let of_line = &mut segments[line];
                    let depths = (depths.as_slice(), pattern.heights[line]);
                    if of_line.is_empty() {
                        of_line.push(new);
                    } else if is_seen(of_line, depths, new, is_behind) {
                        insert(of_line, spare, depths, new, is_behind);
                        std::mem::swap(of_line, spare);
                    } else {
                        return;
                    }
                    changed[line] = true;
                });
            }
        }
    }

    /// Finds the inverse depth behind which each line sees nothing; returns the least of them.
    fn closed(&mut self, pattern: &LinePattern, ends: &LineEnds) -> f32 {
        let mut least = f32::INFINITY;
        for (line, left, right) in ends.each() {
            if std::mem::take(&mut self.changed[line]) {
                self.hidden[line] = closed(&self.segments[line], &self.depths, pattern.heights[line], (left, right));
            }
            least = least.min(self.hidden[line]);
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

/// Returns whether a triangle is nearer anywhere than what was seen so far. One that is known to be behind all of that is
/// seen in gaps alone.
fn is_seen<Depth: LineDepth>(
    old: &[Segment],
    (depths, height): (&[Depth], f32),
    new: Segment,
    is_behind: bool,
) -> bool {
    let depth = &depths[new.candidate as usize];
    let mut at = new.left;
    for segment in old {
        if segment.left.min(new.right) - at > LEAST {
            return true;
        }
        if segment.left >= new.right {
            return false;
        }
        at = at.max(segment.right);
        let (left, right) = (segment.left.max(new.left), segment.right.min(new.right));
        if !is_behind
            && right - left > LEAST
            && depth.nearer(&depths[segment.candidate as usize], height, (left, right)).is_some()
        {
            return true;
        }
    }
    new.right - at > LEAST
}

/// Lets a triangle be seen where it is nearer than what was seen so far, as [`is_seen`] has found that it is somewhere.
fn insert<Depth: LineDepth>(
    old: &[Segment],
    out: &mut Vec<Segment>,
    (depths, height): (&[Depth], f32),
    new: Segment,
    is_behind: bool,
) {
    out.clear();
    let depth = depths[new.candidate as usize];
    let mut at = new.left;
    for segment in old {
        if at < segment.left && at < new.right {
            put(out, at, segment.left.min(new.right), new.candidate);
        }
        at = at.max(segment.right);
        let (left, right) = (segment.left.max(new.left), segment.right.min(new.right));
        if is_behind || right - left <= LEAST {
            put(out, segment.left, segment.right, segment.candidate);
            continue;
        }
        let nearer = depth.nearer(&depths[segment.candidate as usize], height, (left, right));
        let Some(nearer) = nearer else {
            put(out, segment.left, segment.right, segment.candidate);
            continue;
        };
        let mut done = segment.left;
        for [from, to] in nearer {
            put(out, done, from, segment.candidate);
            put(out, from, to, new.candidate);
            done = to;
        }
        put(out, done, segment.right, segment.candidate);
    }
    if at < new.right {
        put(out, at, new.right, new.candidate);
    }
}

/// Returns the inverse depth behind which nothing is seen on a line.
fn closed<Depth: LineDepth>(segments: &[Segment], depths: &[Depth], height: f32, (left, right): (f32, f32)) -> f32 {
    let (mut at, mut least) = (left, f32::INFINITY);
    for segment in segments {
        if segment.left - at > LEAST {
            return 0.0;
        }
        at = segment.right;
        let depth = &depths[segment.candidate as usize];
        least = least.min(depth.least(height, (segment.left, segment.right)));
    }
    if right - at > LEAST { 0.0 } else { least }
}
