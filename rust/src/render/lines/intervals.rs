//! Where the lines of a tile lie within what limits allow: an interval of each, and holes in a few of them.
//!
//! Intervals are found for all lines of a tile together, in vector code.

use std::ops::Range;

use super::pattern::LineEnds;
use crate::render::geometry::pixel_rays::LANES;

/// Shorter intervals are left to their neighbours, pixels.
pub(super) const LEAST: f32 = 2e-5;

/// Where each line of a pattern lies within what functions allow: columns.
#[derive(Debug, Default)]
pub(crate) struct Intervals {
    pub(super) from: Vec<f32>,
    pub(super) to: Vec<f32>,
    /// The lists of [`LANES`] lines that are looked at.
    pub(super) lists: Range<usize>,
    /// Of single lines what is taken out of their middle, from left to right.
    holes: Vec<(usize, [f32; 2])>,
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Intervals {
    /// Begins with all of each line, of some lists of lines.
    #[inline(always)]
    pub(super) fn begin(&mut self, ends: &LineEnds, lists: Range<usize>) {
        let lines = lists.start * LANES..lists.end * LANES;
        self.from.resize(ends.lefts.len(), 0.0);
        self.to.resize(ends.rights.len(), 0.0);
        self.from[lines.clone()].copy_from_slice(&ends.lefts[lines.clone()]);
        self.to[lines.clone()].copy_from_slice(&ends.rights[lines]);
        self.lists = lists;
        self.holes.clear();
    }

    /// Returns the lines that are looked at.
    #[inline(always)]
    pub(super) fn lines(&self) -> Range<usize> {
        self.lists.start * LANES..self.lists.end * LANES
    }

    /// Takes what lies between two columns out of a line.
    pub(super) fn take_out(&mut self, line: usize, [left, right]: [f32; 2]) {
        let (from, to) = (&mut self.from[line], &mut self.to[line]);
        if left <= *from {
            *from = from.max(right);
        } else if right >= *to {
            *to = to.min(left);
        } else {
            let at = self.holes.partition_point(|&(other, [other_left, _])| (other, other_left) < (line, left));
            self.holes.insert(at, (line, [left, right]));
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

    /// Calls `work` with what is left of a line, from left to right, but for what is too short.
    #[inline(always)]
    pub(super) fn each(&self, line: usize, mut work: impl FnMut(f32, f32)) {
        let (mut from, to) = (self.from[line], self.to[line]);
        if !self.holes.is_empty() {
            for &(_, [left, right]) in self.holes.iter().filter(|hole| hole.0 == line) {
                if left.min(to) - from > LEAST {
                    work(from, left.min(to));
                }
                from = from.max(right);
            }
        }
        if to - from > LEAST {
            work(from, to);
        }
    }
}
