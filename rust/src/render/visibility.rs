//! Which of a tile's triangles each of its rays meets first.

use super::bins::{Bins, Cover, Entry, Seen};
use super::linear::Rect;
use super::pixel_rays::{BLOCKS, LANES, Part};

/// No triangle.
pub(super) const NOTHING: u32 = u32::MAX;

/// Lists longer than this are ordered from front to back.
const LONG: usize = 8;

/// The nearest triangle of each ray: its place in the tile's list, and its inverse depth there, 0 for nothing.
#[derive(Debug, Default)]
pub(super) struct Nearest {
    pub(super) place: Vec<u32>,
    pub(super) inverse_depth: Vec<f32>,
    /// Of blocks whose rays all see the same triangle, as their corners tell, its place; else [`NOTHING`]. Its rays are
    /// left to who wants to know more of them.
    pub(super) only: [u32; BLOCKS],
    /// How many blocks the rays lie in.
    pub(super) blocks: usize,
    /// Of the other blocks, how many rays see each triangle of the list.
    pub(super) counts: Vec<[u32; BLOCKS]>,
    list: Vec<Candidate>,
}

#[derive(Clone, Copy, Debug)]
struct Candidate {
    place: u32,
    covers: bool,
    nearest: f32,
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Nearest {
    /// Finds them for rays that lie in some blocks, the same number in each.
    #[inline(always)]
    pub(super) fn find(&mut self, bins: &Bins, list: &[Entry], part: &Part) {
        let Part { x, y, blocks, .. } = *part;
        self.blocks = blocks.len();
        self.only = [NOTHING; BLOCKS];
        self.counts.clear();
        self.counts.resize(list.len(), [0; BLOCKS]);
        self.place.clear();
        self.place.resize(x.len(), NOTHING);
        self.inverse_depth.clear();
        self.inverse_depth.resize(x.len(), 0.0);
        let length = x.len() / blocks.len();
        for (block, part) in blocks.iter().enumerate() {
            self.candidates(bins, list, part);
            if let [one] = self.list.as_slice()
                && one.covers
            {
                self.only[block] = one.place;
                continue;
            }
            let rays = block * length..(block + 1) * length;
            let mut out = (&mut self.place[rays.clone()], &mut self.inverse_depth[rays.clone()]);
            if self.list.len() > LONG {
                // Stable, so that of equal ones the first found comes first.
                self.list.sort_by(|a, b| b.nearest.total_cmp(&a.nearest));
            }
            for (at, candidate) in self.list.iter().enumerate() {
                // From front to back: what is closed need not be looked behind.
                if self.list.len() > LONG && at % 4 == 0 && least(out.1) > candidate.nearest {
                    break;
                }
                let seen = &bins.seen[list[candidate.place as usize].seen as usize];
                nearer(seen, *candidate, &x[rays.clone()], &y[rays.clone()], &mut out);
            }
            for candidate in &self.list {
                self.counts[candidate.place as usize][block] = count(out.0, candidate.place);
            }
        }
    }

    /// Whether any ray sees the triangle at a place in the list.
    pub(super) fn sees(&self, place: u32) -> bool {
        self.only.contains(&place) || self.counts[place as usize] != [0; BLOCKS]
    }

    /// What of a tile's list a block may see.
    fn candidates(&mut self, bins: &Bins, list: &[Entry], part: &Rect) {
        self.list.clear();
        let mut hidden = 0f32;
        for (place, entry) in (0..).zip(list) {
            let seen = &bins.seen[entry.seen as usize];
            let covers = entry.covers
                || match seen.covers(part) {
                    Cover::Nothing => continue,
                    Cover::Part => false,
                    Cover::Everything => true,
                };
            if covers {
                hidden = hidden.max(seen.inverse_depth.lowest(part));
            }
            self.list.push(Candidate { place, covers, nearest: seen.nearest_in(part) });
        }
        self.list.retain(|candidate| candidate.nearest >= hidden);
    }
}

/// How many rays see a triangle.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn count(places: &[u32], place: u32) -> u32 {
    places.iter().map(|&one| u32::from(one == place)).sum()
}

/// The least of some inverse depths.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn least(values: &[f32]) -> f32 {
    let mut lanes = [f32::INFINITY; LANES];
    for chunk in values.chunks_exact(LANES) {
        for i in 0..LANES {
            lanes[i] = if chunk[i] < lanes[i] { chunk[i] } else { lanes[i] };
        }
    }
    lanes.iter().fold(f32::INFINITY, |a, &b| a.min(b))
}

/// Lets a triangle be seen by the rays that meet it before what they saw so far. Where two lie at the same depth, that
/// stays which has the lower place in the list.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
#[allow(clippy::needless_bitwise_bool, reason = "a lazy operator is a branch, which vectors cannot take")]
fn nearer(seen: &Seen, candidate: Candidate, x: &[f32], y: &[f32], out: &mut (&mut [u32], &mut [f32])) {
    let place = candidate.place;
    let rays = x.chunks_exact(LANES).zip(y.chunks_exact(LANES));
    let found = out.0.chunks_exact_mut(LANES).zip(out.1.chunks_exact_mut(LANES));
    let [a, b, c] = seen.edges;
    if candidate.covers {
        for ((x, y), (places, nearest)) in rays.zip(found) {
            for i in 0..LANES {
                let inverse = seen.inverse_depth.at(x[i], y[i]);
                let takes = (inverse > nearest[i]) | ((inverse == nearest[i]) & (place < places[i]));
                nearest[i] = if takes { inverse } else { nearest[i] };
                places[i] = if takes { place } else { places[i] };
            }
        }
        return;
    }
    for ((x, y), (places, nearest)) in rays.zip(found) {
        for i in 0..LANES {
            let inverse = seen.inverse_depth.at(x[i], y[i]);
            let meets = (a.at(x[i], y[i]) >= 0.0) & (b.at(x[i], y[i]) >= 0.0) & (c.at(x[i], y[i]) >= 0.0);
            let before = (inverse > nearest[i]) | ((inverse == nearest[i]) & (inverse > 0.0) & (place < places[i]));
            let takes = meets & before;
            nearest[i] = if takes { inverse } else { nearest[i] };
            places[i] = if takes { place } else { places[i] };
        }
    }
}
