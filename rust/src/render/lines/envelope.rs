//! What lines see: the nearest triangle along each of them, from edge to edge, and the taps where it is shaded.
//!
//! On a line a triangle is an interval, and its inverse depth is linear there. Triangles are let in from front to back;
//! where two of them pass through each other, the line is cut.
//!
//! What must not break: triangles are let in by nearness and then by their numbers in the scene, because roundings at
//! cuts depend on the order.

use super::pattern::{Line, LinePattern};
use crate::render::geometry::linear::{Linear, Rect};
use crate::render::geometry::pixel_rays::LANES;
use crate::render::visibility::bins::{Entry, Seen};
use crate::render::visibility::nearest::NOTHING;

/// Shorter parts are left to their neighbours, pixels.
const LEAST: f32 = 2e-5;

/// Inverse depths below this fraction of a tile's largest one lie at the horizon.
const HORIZON: f64 = 1e-9;

/// What a line sees between two columns: an index in the tile's list, or [`NOTHING`].
#[derive(Clone, Copy, Debug, PartialEq)]
struct Segment {
    left: f32,
    right: f32,
    index: u32,
}

/// A linear function in a tile's pixels: per column, per row, at the corner.
#[derive(Clone, Copy, Debug)]
struct InTile([f64; 3]);

impl InTile {
    fn new(function: Linear, part: &Rect, pitch: [f64; 2]) -> Self {
        let [a, b, c] = function.0.map(f64::from);
        let [x, y] = part.low.map(f64::from);
        Self([a * pitch[0], b * pitch[1], a * x + (b * y + c)])
    }

    /// Returns it along a line: per column, and at column 0.
    #[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
    fn along(&self, slope: f32, height: f32) -> [f32; 2] {
        let [a, b, c] = self.0;
        [(a + b * f64::from(slope)) as f32, (b * f64::from(height) + c) as f32]
    }
}

/// A triangle that a tile may see.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    index: u32,
    number: u32,
    nearest: f32,
    covers: bool,
    edges: [InTile; 3],
    inverse_depth: InTile,
}

/// Finds what the lines of a tile see, and where it is shaded: taps, by their index in the tile's list, with the pixel
/// and the area that each counts for.
#[derive(Debug, Default)]
pub(crate) struct Taps {
    pub(crate) x: Vec<f32>,
    pub(crate) y: Vec<f32>,
    pub(crate) index: Vec<u32>,
    pub(crate) weight: Vec<f32>,
    pub(crate) pixel: Vec<u32>,
    candidates: Vec<Candidate>,
    segments: Vec<Segment>,
    spare: Vec<Segment>,
    depths: Vec<[f32; 2]>,
}

impl Taps {
    /// Finds the taps of a tile whose pixels have a pitch, in undistorted coordinates; `part` begins at their corner.
    pub(crate) fn find(
        &mut self,
        pattern: &LinePattern,
        (seen, list): (&[Seen], &[Entry]),
        part: &Rect,
        pitch: [f64; 2],
    ) {
        for values in [&mut self.x, &mut self.y, &mut self.weight] {
            values.clear();
        }
        self.index.clear();
        self.pixel.clear();
        self.order(seen, list, part, pitch);
        self.depths.resize(list.len(), [0.0; 2]);
        for line in &pattern.lines {
            self.see(line, pattern.slope);
            self.tap(line, pattern, part, pitch);
        }
        // Whole lanes: taps of no weight at the last one's position.
        if let (Some(&x), Some(&y), Some(&index)) = (self.x.last(), self.y.last(), self.index.last()) {
            let count = self.x.len().next_multiple_of(LANES);
            self.x.resize(count, x);
            self.y.resize(count, y);
            self.index.resize(count, index);
            self.weight.resize(count, 0.0);
            self.pixel.resize(count, 0);
        }
    }

    fn order(&mut self, seen: &[Seen], list: &[Entry], part: &Rect, pitch: [f64; 2]) {
        self.candidates.clear();
        self.candidates.extend((0..).zip(list).map(|(index, entry)| {
            let triangle = &seen[entry.seen as usize];
            let edges = triangle.edges.map(|edge| InTile::new(edge, part, pitch));
            let inverse_depth = InTile::new(triangle.inverse_depth, part, pitch);
            let (nearest, number) = (triangle.nearest_in(part), triangle.triangle);
            Candidate { index, number, nearest, covers: entry.covers, edges, inverse_depth }
        }));
        self.candidates.sort_unstable_by(|a, b| b.nearest.total_cmp(&a.nearest).then(a.number.cmp(&b.number)));
    }

    /// Finds what one line sees.
    fn see(&mut self, line: &Line, slope: f32) {
        let (Some(first), Some(last)) = (line.pieces.first(), line.pieces.last()) else { return };
        let whole = (first.left, last.right);
        self.segments.clear();
        let mut hidden = 0.0;
        for candidate in &self.candidates {
            if candidate.nearest < hidden {
                break;
            }
            let Some((left, right)) = candidate.on(line.height, slope, whole) else { continue };
            self.depths[candidate.index as usize] = candidate.inverse_depth.along(slope, line.height);
            let new = Segment { left, right, index: candidate.index };
            if insert(&self.segments, &mut self.spare, &self.depths, new) {
                std::mem::swap(&mut self.segments, &mut self.spare);
                hidden = closed(&self.segments, &self.depths, whole);
            }
        }
    }

    /// Adds the taps of what a line sees.
    #[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
    fn tap(&mut self, line: &Line, pattern: &LinePattern, part: &Rect, pitch: [f64; 2]) {
        let mut at = 0;
        for piece in &line.pieces {
            let mut left = piece.left;
            while left < piece.right {
                while at < self.segments.len() && self.segments[at].right <= left {
                    at += 1;
                }
                let (right, index) = match self.segments.get(at) {
                    Some(segment) if segment.left <= left => (segment.right.min(piece.right), segment.index),
                    Some(segment) => (segment.left.min(piece.right), NOTHING),
                    None => (piece.right, NOTHING),
                };
                let column = left + piece.phase * (right - left);
                let row = line.height + pattern.slope * column;
                let x = (f64::from(part.low[0]) + f64::from(column) * pitch[0]) as f32;
                let y = (f64::from(part.low[1]) + f64::from(row) * pitch[1]) as f32;
                self.x.push(x.clamp(part.low[0], part.high[0]));
                self.y.push(y.clamp(part.low[1], part.high[1]));
                self.index.push(index);
                self.weight.push(pattern.weight * (right - left));
                self.pixel.push(piece.pixel);
                left = right;
            }
        }
    }
}

impl Candidate {
    /// Returns where it is on a line, between two columns.
    fn on(&self, height: f32, slope: f32, whole: (f32, f32)) -> Option<(f32, f32)> {
        if self.covers {
            return Some(whole);
        }
        let (mut left, mut right) = whole;
        let [a, b, c] = self.inverse_depth.0;
        let horizon = InTile([a, b, c - HORIZON * (a.abs() + b.abs() + c.abs())]);
        for function in self.edges.iter().chain([&horizon]) {
            let [slope, offset] = function.along(slope, height);
            let at = -offset / slope;
            if slope > 0.0 {
                left = if at > left { at } else { left };
            } else if slope < 0.0 {
                right = if at < right { at } else { right };
            } else if offset < 0.0 {
                return None;
            }
        }
        (right - left > LEAST).then_some((left, right))
    }
}

/// Adds a segment where it is not too short; one that continues the last one is joined to it.
fn put(segments: &mut Vec<Segment>, left: f32, right: f32, index: u32) {
    if right - left <= LEAST {
        return;
    }
    match segments.last_mut() {
        Some(last) if last.index == index && left - last.right <= LEAST => last.right = right,
        Some(last) if left - last.right <= LEAST => {
            let left = last.right;
            segments.push(Segment { left, right, index });
        }
        _ => segments.push(Segment { left, right, index }),
    }
}

/// Lets a triangle be seen where it is nearer than what was seen so far; says whether that changes anything.
fn insert(old: &[Segment], out: &mut Vec<Segment>, depths: &[[f32; 2]], new: Segment) -> bool {
    out.clear();
    let depth = |index: u32, at: f32| depths[index as usize][0] * at + depths[index as usize][1];
    let (mut at, mut changed) = (new.left, false);
    for segment in old {
        if at < segment.left && at < new.right {
            let end = segment.left.min(new.right);
            changed |= end - at > LEAST;
            put(out, at, end, new.index);
        }
        at = at.max(segment.right);
        let (left, right) = (segment.left.max(new.left), segment.right.min(new.right));
        if right - left <= LEAST {
            put(out, segment.left, segment.right, segment.index);
            continue;
        }
        let first = depth(new.index, left) - depth(segment.index, left);
        let last = depth(new.index, right) - depth(segment.index, right);
        if first <= 0.0 && last <= 0.0 {
            put(out, segment.left, segment.right, segment.index);
            continue;
        }
        changed = true;
        let cut = left + (right - left) * (first / (first - last));
        let (from, to) = match (first > 0.0, last > 0.0) {
            (true, true) => (left, right),
            (true, false) => (left, cut),
            _ => (cut, right),
        };
        put(out, segment.left, from, segment.index);
        put(out, from, to, new.index);
        put(out, to, segment.right, segment.index);
    }
    if at < new.right {
        changed |= new.right - at > LEAST;
        put(out, at, new.right, new.index);
    }
    changed
}

/// Returns the inverse depth behind which nothing is seen on a line.
fn closed(segments: &[Segment], depths: &[[f32; 2]], (left, right): (f32, f32)) -> f32 {
    let (mut at, mut least) = (left, f32::INFINITY);
    for segment in segments {
        if segment.left - at > LEAST {
            return 0.0;
        }
        at = segment.right;
        let [slope, offset] = depths[segment.index as usize];
        least = least.min(slope * segment.left + offset).min(slope * segment.right + offset);
    }
    if right - at > LEAST { 0.0 } else { least }
}
