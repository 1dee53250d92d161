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
use crate::render::visibility::bins::{Bins, Entry, Seen};

/// Inverse depths below this fraction of a tile's largest one lie at the horizon.
const HORIZON: f64 = 1e-9;

/// After so many triangles, or this fraction of those that were let in, it is looked for what lies behind all that lines
/// see.
const BETWEEN: usize = 8;
const BETWEEN_OF_MANY: usize = 8;

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
    /// Of what was let in, by number.
    depths: Vec<Depth>,
    ranges: Vec<DepthRange>,
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
        (bins, list): (&Bins, &[Entry]),
        warp: &TileWarp,
    ) {
        let tile_rect = warp.rect();
        let height = warp.height(pattern);
        self.order(&bins.seen, list, tile_rect);
        self.segments.resize_with(self.segments.len().max(pattern.heights.len()), Vec::new);
        self.segments.iter_mut().for_each(Vec::clear);
        self.hidden.clear();
        self.hidden.resize(pattern.heights.len(), 0.0);
        self.changed.clear();
        self.changed.resize(pattern.heights.len(), true);
        self.depths.clear();
        self.ranges.clear();
        self.behind = None;
        // What was let in is nowhere farther than this.
        let mut farthest = f32::INFINITY;
        let many = self.candidates.len() > BETWEEN;
        let mut next_look = 0;
        for number in 0..self.candidates.len() {
            let Candidate { index, nearest, covers, .. } = self.candidates[number];
            if many && number == next_look {
                if self.closed(pattern, ends) > nearest {
                    break;
                }
                next_look += BETWEEN.max(number / BETWEEN_OF_MANY);
            }
            let number_in_bins = list[index as usize].seen as usize;
            let (triangle, around) = (&bins.seen[number_in_bins], &bins.around[number_in_bins]);
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
            let part = around.within(tile_rect);
            self.ranges
                .push(DepthRange { lowest: triangle.inverse_depth.lowest(&part), highest: triangle.nearest_in(&part) });
            self.intervals.begin(ends, height.lists(around, pattern, ends));
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
        let Self { segments, spare, depths, ranges, hidden, changed, intervals, .. } = self;
        for list in intervals.lists.clone() {
            if !intervals.any(list) {
                continue;
            }
            for line in list * LANES..(list + 1) * LANES {
                if nearest < hidden[line] {
                    continue;
                }
                intervals.each(line, |left, right| {
                    let new = Segment { left, right, candidate: number as u32 };
                    let depths = Depths { functions: depths, ranges, height: pattern.heights[line] };
                    changed[line] |= let_in_line(&mut segments[line], spare, &depths, new, is_behind);
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

/// What no inverse depth of a triangle is below, and above, in a tile.
#[derive(Clone, Copy, Debug)]
struct DepthRange {
    lowest: f32,
    highest: f32,
}

/// Inverse depths on a line of what was let in, by number.
struct Depths<'a, Depth> {
    functions: &'a [Depth],
    ranges: &'a [DepthRange],
    height: f32,
}

impl<Depth: LineDepth> Depths<'_, Depth> {
    /// Returns where a triangle is nearer than another one that was let in before it, see [`LineDepth::nearer`].
    fn nearer(&self, new: u32, old: u32, between: (f32, f32)) -> Option<[[f32; 2]; 2]> {
        let (new, old) = (new as usize, old as usize);
        // Of many triangles most lie behind all of another one: that is known without looking at the line.
        if self.ranges[new].highest <= self.ranges[old].lowest {
            return None;
        }
        self.functions[new].nearer(&self.functions[old], self.height, between)
    }
}

/// Adds a segment where it is not too short; one that continues the last one is joined to it. To add segments of a list
/// once more changes nothing.
fn put(segments: &mut Vec<Segment>, left: f32, right: f32, candidate: u32) {
    let left = match segments.last_mut() {
        Some(last) if left - last.right <= LEAST => {
            if last.candidate == candidate && right - left > LEAST {
                last.right = right;
                return;
            }
            last.right
        }
        _ => left,
    };
    if right - left > LEAST {
        segments.push(Segment { left, right, candidate });
    }
}

/// Lets a triangle be seen on a line where it is nearer than what was seen so far; says whether it may be anywhere. Only
/// the segments that it meets are looked at, because a line of a fine mesh has very many.
fn let_in_line<Depth: LineDepth>(
    of_line: &mut Vec<Segment>,
    spare: &mut Vec<Segment>,
    depths: &Depths<Depth>,
    new: Segment,
    is_behind: bool,
) -> bool {
    let first = of_line.partition_point(|segment| segment.right <= new.left);
    let end = first + of_line[first..].partition_point(|segment| segment.left < new.right);
    if !is_seen(&of_line[first..end], depths, new, is_behind) {
        return false;
    }
    // The neighbours may be joined to it.
    let (first, end) = (first.saturating_sub(1), of_line.len().min(end + 1));
    insert(&of_line[first..end], spare, depths, new, is_behind);
    of_line.splice(first..end, spare.drain(..));
    true
}

/// Returns whether a triangle is nearer anywhere than what was seen so far. One that is known to be behind all of that is
/// seen in gaps alone.
fn is_seen<Depth: LineDepth>(old: &[Segment], depths: &Depths<Depth>, new: Segment, is_behind: bool) -> bool {
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
            && depths.nearer(new.candidate, segment.candidate, (left, right)).is_some()
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
    depths: &Depths<Depth>,
    new: Segment,
    is_behind: bool,
) {
    out.clear();
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
        let Some(nearer) = depths.nearer(new.candidate, segment.candidate, (left, right)) else {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::lines::warp::LinearDepth;
    use proptest::prelude::*;

    /// Columns are multiples of this, so that none but those of cuts are close to each other.
    const STEP: f32 = 1.0 / 32.0;

    /// What lies next to a triangle is joined to it on both sides, and what is too short goes.
    #[test]
    fn neighbours_are_joined() {
        let ranges = [DepthRange { lowest: 1.0, highest: 1.0 }; 3];
        let depths = &Depths { functions: &[LinearDepth([0.0, 0.0, 1.0]); 3], ranges: &ranges, height: 0.0 };
        let segment = |left: f32, right: f32, candidate: u32| Segment { left, right, candidate };
        let gap = 0.5 * LEAST;
        let mut of_line = vec![segment(0.0, 1.0 - gap, 0), segment(2.0 + gap, 3.0, 1)];
        assert!(let_in_line(&mut of_line, &mut vec![], depths, segment(1.0, 2.0, 2), false));
        assert_eq!(of_line, [segment(0.0, 1.0 - gap, 0), segment(1.0 - gap, 2.0, 2), segment(2.0, 3.0, 1)]);
        let mut of_line = vec![segment(0.0, 1.0, 0)];
        assert!(!let_in_line(&mut of_line, &mut vec![], depths, segment(1.0, 1.0 + gap, 2), false));
    }

    proptest! {
        /// A line sees the nearest triangle everywhere, however many there are and in whichever order they are let in; of
        /// those that are seen none is too short, and none is followed by itself.
        #[test]
        fn a_line_sees_the_nearest(
            triangles in prop::collection::vec((0u16..256, 1u16..40, 1u8..9, -3i8..4), 1..120), behind in any::<bool>(),
        ) {
            let depths: Vec<LinearDepth> =
                triangles.iter().map(|&(_, _, at, along)| LinearDepth([f32::from(along) * 0.1, 0.0, f32::from(at) + 9.0])).collect();
            let (mut of_line, mut spare) = (vec![], vec![]);
            let mut ends = vec![];
            let ranges: Vec<DepthRange> = triangles.iter().zip(&depths).map(|(&(left, length, ..), depth)| {
                let ends = [left, left + length].map(|column| depth.least(0.0, (f32::from(column) * STEP, f32::from(column) * STEP)));
                DepthRange { lowest: ends[0].min(ends[1]), highest: ends[0].max(ends[1]) }
            }).collect();
            let of = &Depths { functions: &depths, ranges: &ranges, height: 0.0 };
            for (candidate, &(left, length, ..)) in (0..).zip(&triangles) {
                let (left, right) = (f32::from(left) * STEP, f32::from(left + length) * STEP);
                let new = Segment { left, right, candidate };
                let before = of_line.clone();
                let seen = let_in_line(&mut of_line, &mut spare, of, new, behind);
                // What is nearer on too short a part changes nothing.
                prop_assert!(seen || of_line == before);
                ends.push([left, right]);
            }
            for two in of_line.windows(2) {
                prop_assert!(two[0].right <= two[1].left);
                prop_assert!(two[0].candidate != two[1].candidate || two[1].left - two[0].right > LEAST);
            }
            prop_assert!(of_line.iter().all(|segment| segment.right - segment.left > LEAST));
            let mut again = vec![];
            for segment in &of_line {
                put(&mut again, segment.left, segment.right, segment.candidate);
            }
            prop_assert_eq!(&again, &of_line);
            for column in (0..2 * 296u16).map(|i| (f32::from(i) + 0.5) * STEP / 2.0) {
                let here = |&candidate: &usize| (ends[candidate][0]..ends[candidate][1]).contains(&column);
                let all: Vec<usize> = (0..triangles.len()).filter(here).collect();
                let depth = |candidate: usize| depths[candidate].least(0.0, (column, column));
                let nearest = all.iter().map(|&candidate| depth(candidate)).fold(0.0, f32::max);
                let seen = of_line.iter().find(|segment| (segment.left..segment.right).contains(&column));
                match seen {
                    None => prop_assert!(all.is_empty()),
                    // What lies behind all others is seen in gaps alone.
                    Some(segment) if behind => prop_assert_eq!(segment.candidate as usize, all[0]),
                    Some(segment) => {
                        prop_assert!(here(&(segment.candidate as usize)));
                        prop_assert!(depth(segment.candidate as usize) > nearest - 1e-3);
                    }
                }
            }
        }
    }
}
