//! How a tile lies in undistorted coordinates, and what functions that are linear there are on its lines.
//!
//! Without distortion such functions are linear in columns and rows too ([`Straight`]); behind a lens with distortion they
//! are cubic ([`curved`](super::curved)).
//!
//! What must not break: a function and its negative allow exactly what the other does not, to the bit, so that no gap is
//! seen between two triangles with a common edge.

use std::ops::Range;

use super::intervals::Intervals;
use super::pattern::{LineEnds, LinePattern};
use crate::render::geometry::linear::Rect;
use crate::render::geometry::pixel_rays::{LANES, TILE};

/// A function has one sign in a tile if its least magnitude there is above this fraction of its parts.
pub(super) const SURE: f64 = 1e-5;

/// Functions that change by less than this fraction along a line are taken as constant there.
const PARALLEL: f64 = 1e-12;

/// How a tile lies in undistorted coordinates.
pub(crate) trait Warp {
    type Function: TileFunction<Depth = Self::Depth>;
    type Depth: LineDepth;

    /// Returns what the tile lies in.
    fn rect(&self) -> &Rect;

    /// Returns a function of undistorted coordinates in the tile's pixels: per x, per y, and where both are 0.
    fn function(&self, function: [f64; 3]) -> Self::Function;

    /// Finds undistorted coordinates of columns and rows of the tile.
    fn undistort(&self, from: (&[f32], &[f32]), to: (&mut [f32], &mut [f32]));

    /// Returns which line of a pattern passes through a place.
    fn height(&self, pattern: &LinePattern) -> Height;

    /// Returns what a part of the tile lies in, by its least and largest columns and rows.
    fn around(&self, part: &Rect) -> Rect;
}

/// The height of the line that passes through a place of a tile: a function of undistorted coordinates (per x, per y, and
/// where both are 0), and what it is off by at most.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Height {
    pub(super) function: [f64; 3],
    pub(super) off: f64,
}

impl Height {
    /// Returns the lists of lines that hold all those which pass a part of the tile, of those that are looked at.
    #[inline]
    pub(super) fn lists(&self, part: &Rect, pattern: &LinePattern, ends: &LineEnds) -> Range<usize> {
        let [a, b, c] = self.function;
        let ([left, top], [right, bottom]) = (part.low.map(f64::from), part.high.map(f64::from));
        let (across, down) = ([a * left, a * right], [b * top, b * bottom]);
        let low = across[0].min(across[1]) + down[0].min(down[1]) + c - self.off;
        let high = across[0].max(across[1]) + down[0].max(down[1]) + c + self.off;
        let (start, end) = pattern.lists_between(low, high);
        let start = start.max(ends.lists.start);
        start..end.min(ends.lists.end).max(start)
    }
}

/// A function in a tile's pixels.
pub(crate) trait TileFunction: Copy {
    type Depth: LineDepth;

    /// Returns it less a fraction of the sum of its parts.
    fn lowered(self, fraction: f64) -> Self;

    /// Returns the sign that it has in all of the tile, 1 or -1; 0 where it may have both. Where it has one, roundings do
    /// not matter.
    fn sign(&self, pattern: &LinePattern) -> f64;

    /// Takes away from lines where it is negative.
    fn clip(self, intervals: &mut Intervals, pattern: &LinePattern);

    /// Returns it for single places on lines, as an inverse depth.
    fn depth(self, pattern: &LinePattern) -> Self::Depth;
}

/// Inverse depth on lines, which have heights at column 0.
pub(crate) trait LineDepth: Copy {
    /// Returns where this is nearer than another one, between two columns: up to two intervals from left to right, of
    /// which the second one may have no length. None for nowhere.
    fn nearer(&self, other: &Self, height: f32, between: (f32, f32)) -> Option<[[f32; 2]; 2]>;

    /// Returns what no inverse depth between two columns is below.
    fn least(&self, height: f32, between: (f32, f32)) -> f32;
}

/// A tile without distortion, in which pixels have a pitch; the rectangle begins at the tile's corner.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Straight<'a> {
    pub(crate) rect: &'a Rect,
    pub(crate) pitch: [f64; 2],
}

/// A linear function in a tile's pixels: per column, per row, at the corner.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Linear([f64; 3]);

/// Inverse depth in a tile's pixels: per column along a line, per row at column 0, and there at row 0.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct LinearDepth(pub(super) [f32; 3]);

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Warp for Straight<'_> {
    type Function = Linear;
    type Depth = LinearDepth;

    fn rect(&self) -> &Rect {
        self.rect
    }

    #[inline(always)]
    fn function(&self, [a, b, c]: [f64; 3]) -> Linear {
        let [x, y] = self.rect.low.map(f64::from);
        Linear([a * self.pitch[0], b * self.pitch[1], a * x + (b * y + c)])
    }

    #[inline(always)]
    fn undistort(&self, from: (&[f32], &[f32]), to: (&mut [f32], &mut [f32])) {
        for (axis, (from, to)) in [(from.0, to.0), (from.1, to.1)].into_iter().enumerate() {
            for (&at, coordinate) in from.iter().zip(to) {
                *coordinate = self.coordinate(at, axis);
            }
        }
    }

    fn height(&self, pattern: &LinePattern) -> Height {
        let (slope, [x, y]) = (f64::from(pattern.slope), self.rect.low.map(f64::from));
        let [per_x, per_y] = [-slope / self.pitch[0], 1.0 / self.pitch[1]];
        Height { function: [per_x, per_y, -(per_x * x + per_y * y)], off: 0.0 }
    }

    fn around(&self, part: &Rect) -> Rect {
        let [low, high] = [part.low, part.high].map(|[x, y]| [self.coordinate(x, 0), self.coordinate(y, 1)]);
        Rect { low, high }
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Straight<'_> {
    #[inline(always)]
    #[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
    fn coordinate(&self, at: f32, axis: usize) -> f32 {
        let (low, high) = (self.rect.low[axis], self.rect.high[axis]);
        let coordinate = low + at * self.pitch[axis] as f32;
        if coordinate < high { coordinate } else { high }
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl TileFunction for Linear {
    type Depth = LinearDepth;

    fn lowered(self, fraction: f64) -> Self {
        let [a, b, c] = self.0;
        Self([a, b, c - fraction * (a.abs() + b.abs() + c.abs())])
    }

    #[inline(always)]
    #[allow(clippy::cast_precision_loss, reason = "a small number")]
    fn sign(&self, _: &LinePattern) -> f64 {
        let [a, b, c] = self.0;
        let half = TILE as f64 / 2.0;
        let (middle, change) = (half * (a + b) + c, half * (a.abs() + b.abs()));
        if middle.abs() > change + SURE * (change + c.abs()) { middle.signum() } else { 0.0 }
    }

    #[inline(always)]
    #[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
    fn clip(self, intervals: &mut Intervals, pattern: &LinePattern) {
        let [a, b, c] = self.0;
        let along = a + b * f64::from(pattern.slope);
        let lines = intervals.lines();
        let heights = pattern.heights[lines.clone()].chunks_exact(LANES);
        let (from, to) = (&mut intervals.from[lines.clone()], &mut intervals.to[lines]);
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

    #[inline(always)]
    #[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
    fn depth(self, pattern: &LinePattern) -> LinearDepth {
        let [a, b, c] = self.0;
        LinearDepth([a + b * f64::from(pattern.slope), b, c].map(|value| value as f32))
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl LinearDepth {
    #[inline(always)]
    fn at(&self, column: f32, height: f32) -> f32 {
        self.0[0] * column + (self.0[1] * height + self.0[2])
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl LineDepth for LinearDepth {
    #[inline(always)]
    fn nearer(&self, other: &Self, height: f32, (left, right): (f32, f32)) -> Option<[[f32; 2]; 2]> {
        let first = self.at(left, height) - other.at(left, height);
        let last = self.at(right, height) - other.at(right, height);
        if first <= 0.0 && last <= 0.0 {
            return None;
        }
        let cut = left + (right - left) * (first / (first - last));
        let nearer = match (first > 0.0, last > 0.0) {
            (true, true) => [left, right],
            (true, false) => [left, cut],
            _ => [cut, right],
        };
        Some([nearer, [nearer[1]; 2]])
    }

    #[inline(always)]
    fn least(&self, height: f32, (left, right): (f32, f32)) -> f32 {
        self.at(left, height).min(self.at(right, height))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A part of a tile is in the lists of all lines that pass it; a small one is in few of them.
    #[test]
    #[allow(clippy::cast_precision_loss, clippy::cast_possible_truncation, reason = "small numbers")]
    fn a_part_has_its_lines() {
        let pattern = LinePattern::new(16).unwrap();
        let (pitch, corner) = ([0.004, 0.005], [-0.4, 0.3]);
        let high = [0, 1].map(|axis| (corner[axis] + pitch[axis] * TILE as f64) as f32);
        let rect = Rect { low: corner.map(|at| at as f32), high };
        let warp = Straight { rect: &rect, pitch };
        let height = warp.height(&pattern);
        for (line, left, right) in pattern.ends.each() {
            for column in (0..9).map(|i| left + (right - left) * (i as f32 / 8.0)) {
                let row = pattern.heights[line] + pattern.slope * column;
                let place = [warp.coordinate(column, 0), warp.coordinate(row, 1)];
                let part = Rect { low: place, high: place };
                let lists = height.lists(&part, &pattern, &pattern.ends);
                assert!(lists.contains(&(line / LANES)) && lists.len() <= 2, "{line} {column}: {lists:?}");
                let all = height.lists(&rect, &pattern, &pattern.ends);
                assert_eq!(all, pattern.ends.lists);
            }
        }
    }

    /// What is not a number leaves nothing out, and what lies beyond the lines has none.
    #[test]
    fn heights_may_be_anything() {
        let pattern = LinePattern::new(8).unwrap();
        let all = (0, pattern.heights.len() / LANES);
        assert_eq!(pattern.lists_between(f64::NAN, f64::NAN), all);
        assert_eq!(pattern.lists_between(f64::NEG_INFINITY, f64::INFINITY), all);
        for (low, high) in [(50.0, 60.0), (-60.0, -50.0)] {
            let (start, end) = pattern.lists_between(low, high);
            assert!(start >= end, "{start} {end}");
        }
    }
}
