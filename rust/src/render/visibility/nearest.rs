//! Visibility: finds the triangle that each of a tile's rays hits first.
//!
//! A block of rays is decided at its corners where possible, and ray by ray where not. Long lists are looked at from
//! front to back, so that a block is soon closed.
//!
//! What must not break: the nearest triangle wins, and of equally near ones the first in the tile's list, on every
//! path.

use super::bins::{Bins, Cover, Entry, Seen};
use crate::render::geometry::linear::Rect;
use crate::render::geometry::pixel_rays::{BLOCKS, LANES, RayBlocks};

/// No triangle.
pub(crate) const NOTHING: u32 = u32::MAX;

/// Lists longer than this are ordered from front to back.
const LONG: usize = 8;

/// Where a tile has more triangles than this, they are ordered once for all of its blocks.
const MANY: usize = 24;

/// A block is checked for being closed after this many triangles.
const BETWEEN: usize = 4;

/// The nearest triangle of each ray: its index in the tile's list, and its inverse depth there, 0 for nothing.
#[derive(Debug, Default)]
pub(crate) struct Nearest {
    pub(crate) index: Vec<u32>,
    pub(crate) inverse_depth: Vec<f32>,
    /// Of blocks whose rays all see the same triangle, as their corners tell, its index; else [`NOTHING`]. Its rays are
    /// left to who wants to know more of them.
    pub(crate) only: [u32; BLOCKS],
    /// How many blocks the rays lie in, and how many there are in each.
    pub(crate) blocks: usize,
    pub(crate) length: usize,
    /// Of the other blocks, how many rays see each triangle of the list.
    pub(crate) counts: Vec<[u32; BLOCKS]>,
    /// Of blocks of tiles with many triangles, the rays sorted by what they see; empty for the other blocks.
    sorted: [Vec<u32>; BLOCKS],
    /// Where those of each triangle end there.
    ends: Vec<[u32; BLOCKS]>,
    list: Vec<Candidate>,
    /// All candidates of a tile, from front to back.
    front: Vec<Candidate>,
}

#[derive(Clone, Copy, Debug)]
struct Candidate {
    index: u32,
    covers: bool,
    nearest: f32,
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Nearest {
    /// Finds them for rays that lie in some blocks, the same number in each.
    #[inline(always)]
    pub(crate) fn find(&mut self, bins: &Bins, list: &[Entry], ray_blocks: &RayBlocks) {
        let RayBlocks { x, y, around, blocks } = *ray_blocks;
        self.blocks = blocks.len();
        self.length = x.len() / blocks.len();
        self.only = [NOTHING; BLOCKS];
        self.counts.clear();
        self.counts.resize(list.len(), [0; BLOCKS]);
        if let [Entry { covers: true, .. }] = list {
            self.only[..blocks.len()].fill(0);
            return;
        }
        self.see_nothing(x.len());
        let length = self.length;
        if list.len() > MANY {
            self.order(bins, list, around);
        }
        for (block, rect) in blocks.iter().enumerate() {
            let rays = block * length..(block + 1) * length;
            let (x, y) = (&x[rays.clone()], &y[rays]);
            if list.len() > MANY {
                self.find_among_many(bins, list, (x, y), block, rect);
            } else {
                self.find_among_few(bins, list, (x, y), block, rect);
            }
        }
    }

    /// Makes ready for so many rays, none of which has seen anything yet.
    fn see_nothing(&mut self, rays: usize) {
        self.index.clear();
        self.index.resize(rays, NOTHING);
        self.inverse_depth.clear();
        self.inverse_depth.resize(rays, 0.0);
        self.sorted.iter_mut().for_each(Vec::clear);
    }

    /// Makes ready for rays that lie in some blocks, where others find what they see.
    pub(super) fn begin(&mut self, ray_blocks: &RayBlocks) {
        self.blocks = ray_blocks.blocks.len();
        self.length = ray_blocks.x.len() / ray_blocks.blocks.len();
        self.only = [NOTHING; BLOCKS];
        self.see_nothing(ray_blocks.x.len());
    }

    /// Sorts rays whose indices in a list of triangles were found by others.
    pub(super) fn end(&mut self, list: usize) {
        self.counts.clear();
        self.counts.resize(list, [0; BLOCKS]);
        self.ends.clear();
        self.ends.resize(list, [0; BLOCKS]);
        for block in 0..self.blocks {
            self.sort(block, self.length);
        }
    }

    #[inline(always)]
    fn find_among_few(&mut self, bins: &Bins, list: &[Entry], (x, y): (&[f32], &[f32]), block: usize, rect: &Rect) {
        self.candidates(bins, list, rect);
        if let [only] = self.list.as_slice()
            && only.covers
        {
            self.only[block] = only.index;
            return;
        }
        let rays = block * x.len()..(block + 1) * x.len();
        let mut out = (&mut self.index[rays.clone()], &mut self.inverse_depth[rays]);
        if self.list.len() > LONG {
            // Stable, so that of equal ones the first found comes first.
            self.list.sort_by(|a, b| b.nearest.total_cmp(&a.nearest));
        }
        for (at, candidate) in self.list.iter().enumerate() {
            // From front to back: what is closed need not be looked behind.
            if self.list.len() > LONG && at % BETWEEN == 0 && least(out.1) > candidate.nearest {
                break;
            }
            nearer(&bins.seen[list[candidate.index as usize].seen as usize], *candidate, x, y, &mut out);
        }
        for candidate in &self.list {
            self.counts[candidate.index as usize][block] = count(out.0, candidate.index);
        }
    }

    /// Orders a tile's triangles from front to back.
    fn order(&mut self, bins: &Bins, list: &[Entry], tile: &Rect) {
        self.front.clear();
        self.front.extend((0..).zip(list).map(|(index, entry)| {
            let nearest = bins.seen[entry.seen as usize].nearest_in(tile);
            Candidate { index, covers: entry.covers, nearest }
        }));
        self.front.sort_unstable_by(|a, b| b.nearest.total_cmp(&a.nearest));
        self.ends.clear();
        self.ends.resize(list.len(), [0; BLOCKS]);
    }

    /// Looks at a block's triangles one by one, from front to back, until it is closed.
    #[inline(always)]
    fn find_among_many(&mut self, bins: &Bins, list: &[Entry], (x, y): (&[f32], &[f32]), block: usize, rect: &Rect) {
        let rays = block * x.len()..(block + 1) * x.len();
        let mut out = (&mut self.index[rays.clone()], &mut self.inverse_depth[rays]);
        // The inverse depth behind which nothing is seen, as it was known last.
        let (mut closed, mut looked_at) = (0.0, 0);
        for candidate in &self.front {
            if closed > candidate.nearest {
                break;
            }
            let seen = &bins.seen[list[candidate.index as usize].seen as usize];
            if closed > 0.0 && seen.nearest_in(rect) < closed {
                continue;
            }
            let covers = candidate.covers
                || match seen.covers(rect) {
                    Cover::Nothing => continue,
                    Cover::Part => false,
                    Cover::Everything => true,
                };
            nearer(seen, Candidate { covers, ..*candidate }, x, y, &mut out);
            looked_at += 1;
            if covers || looked_at % BETWEEN == 0 {
                closed = least(out.1);
            }
        }
        self.sort(block, x.len());
    }

    /// Sorts a block's rays by what they see.
    #[allow(clippy::cast_possible_truncation, reason = "a tile has fewer than 2^32 rays")]
    fn sort(&mut self, block: usize, length: usize) {
        let first = block * length;
        let indices = &self.index[first..first + length];
        for &index in indices.iter().filter(|&&index| index != NOTHING) {
            self.counts[index as usize][block] += 1;
        }
        if indices[0] != NOTHING && self.counts[indices[0] as usize][block] as usize == length {
            self.only[block] = indices[0];
            self.counts[indices[0] as usize][block] = 0;
            self.index[first..first + length].fill(NOTHING);
            return;
        }
        let mut end = 0;
        for (ends, counts) in self.ends.iter_mut().zip(&self.counts) {
            // The beginning, which moves to the end as the rays come in.
            ends[block] = end;
            end += counts[block];
        }
        let sorted = &mut self.sorted[block];
        sorted.resize(end as usize, 0);
        for (ray, &index) in indices.iter().enumerate().filter(|(_, index)| **index != NOTHING) {
            let at = &mut self.ends[index as usize][block];
            sorted[*at as usize] = (first + ray) as u32;
            *at += 1;
        }
    }

    /// Returns the numbers of the rays of a block that see a triangle, where they are known.
    pub(crate) fn sorted(&self, block: usize, index: u32) -> Option<&[u32]> {
        let sorted = &self.sorted[block];
        let end = (!sorted.is_empty()).then(|| self.ends[index as usize][block])?;
        sorted.get((end - self.counts[index as usize][block]) as usize..end as usize)
    }

    /// Finds what of a tile's list a block may see.
    fn candidates(&mut self, bins: &Bins, list: &[Entry], rect: &Rect) {
        self.list.clear();
        let mut hidden = 0f32;
        for (index, entry) in (0..).zip(list) {
            let seen = &bins.seen[entry.seen as usize];
            let covers = entry.covers
                || match seen.covers(rect) {
                    Cover::Nothing => continue,
                    Cover::Part => false,
                    Cover::Everything => true,
                };
            if covers {
                hidden = hidden.max(seen.inverse_depth.lowest(rect));
            }
            self.list.push(Candidate { index, covers, nearest: seen.nearest_in(rect) });
        }
        self.list.retain(|candidate| candidate.nearest >= hidden);
    }
}

/// Returns how many rays see a triangle.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn count(indices: &[u32], index: u32) -> u32 {
    indices.iter().map(|&member| u32::from(member == index)).sum()
}

/// Returns the least of some inverse depths, whose number is a multiple of [`LANES`].
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
pub(super) fn least(values: &[f32]) -> f32 {
    let mut lanes = [f32::INFINITY; LANES];
    for chunk in values.chunks_exact(LANES) {
        for i in 0..LANES {
            lanes[i] = if chunk[i] < lanes[i] { chunk[i] } else { lanes[i] };
        }
    }
    lanes.iter().fold(f32::INFINITY, |a, &b| a.min(b))
}

/// Lets a triangle be seen by the rays that meet it before what they saw so far. Where two lie at the same depth, that
/// stays which has the lower index in the list.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
#[allow(clippy::needless_bitwise_bool, reason = "a lazy operator is a branch, which vectors cannot take")]
fn nearer(seen: &Seen, candidate: Candidate, x: &[f32], y: &[f32], out: &mut (&mut [u32], &mut [f32])) {
    let index = candidate.index;
    let rays = x.chunks_exact(LANES).zip(y.chunks_exact(LANES));
    let lanes = out.0.chunks_exact_mut(LANES).zip(out.1.chunks_exact_mut(LANES));
    let [a, b, c] = seen.edges;
    if candidate.covers {
        for ((x, y), (indices, nearest)) in rays.zip(lanes) {
            for i in 0..LANES {
                let inverse = seen.inverse_depth.at(x[i], y[i]);
                let takes = (inverse > nearest[i]) | ((inverse == nearest[i]) & (index < indices[i]));
                nearest[i] = if takes { inverse } else { nearest[i] };
                indices[i] = if takes { index } else { indices[i] };
            }
        }
        return;
    }
    for ((x, y), (indices, nearest)) in rays.zip(lanes) {
        for i in 0..LANES {
            let inverse = seen.inverse_depth.at(x[i], y[i]);
            let meets = (a.at(x[i], y[i]) >= 0.0) & (b.at(x[i], y[i]) >= 0.0) & (c.at(x[i], y[i]) >= 0.0);
            let before = (inverse > nearest[i]) | ((inverse == nearest[i]) & (inverse > 0.0) & (index < indices[i]));
            let takes = meets & before;
            nearest[i] = if takes { inverse } else { nearest[i] };
            indices[i] = if takes { index } else { indices[i] };
        }
    }
}
