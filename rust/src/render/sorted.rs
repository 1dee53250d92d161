//! Which of a tile's rays see one triangle, in portions that are shaded together.

use std::ops::Range;

use super::lanes::{Lanes, MOST, Rays, STEP};
use super::pixel_rays::BLOCKS;
use super::visibility::Nearest;

/// Rays that lie side by side.
#[derive(Clone, Debug)]
pub(super) struct Row {
    pub(super) range: Range<usize>,
    /// Whether all of them see the triangle; else some of them do.
    pub(super) all: bool,
}

/// The rays that see a triangle.
#[derive(Debug, Default)]
pub(super) struct Sorted {
    /// [`MOST`] each, or fewer.
    pub(super) rows: Vec<Row>,
    /// Numbers of the others, where few of a block see it.
    pub(super) scattered: Vec<u32>,
}

impl Sorted {
    /// Finds those of the triangle at a place in the tile's list.
    pub(super) fn of_triangle(&mut self, nearest: &Nearest, place: u32) {
        self.rows.clear();
        self.scattered.clear();
        let length = nearest.place.len() / BLOCKS;
        let mut block = 0;
        while block < BLOCKS {
            let first = block * length;
            let all = nearest.only[block] == place;
            block += 1;
            if all {
                while block < BLOCKS && nearest.only[block] == place {
                    block += 1;
                }
                self.add_rows(first..block * length, true);
                continue;
            }
            let count = nearest.counts[place as usize][block - 1] as usize;
            // To shade a ray for nothing takes less time than to pick one out and put it back.
            if count * 5 >= length * 2 {
                self.add_rows(first..block * length, false);
            } else if count > 0
                && let Some(known) = nearest.sorted(block - 1, place)
            {
                self.scattered.extend_from_slice(known);
            } else if count > 0 {
                self.pick(&nearest.place[first..block * length], first, place);
            }
        }
    }

    fn add_rows(&mut self, range: Range<usize>, all: bool) {
        let firsts = range.clone().step_by(MOST);
        self.rows.extend(firsts.map(|first| Row { range: first..range.end.min(first + MOST), all }));
    }

    /// Adds the numbers of some rays that see the triangle, without a branch for each.
    #[allow(clippy::cast_possible_truncation, reason = "a tile has fewer than 2^32 rays")]
    fn pick(&mut self, places: &[u32], first: usize, place: u32) {
        let mut count = self.scattered.len();
        self.scattered.resize(count + places.len(), 0);
        for (ray, &one) in places.iter().enumerate() {
            self.scattered[count] = (first + ray) as u32;
            count += usize::from(one == place);
        }
        self.scattered.truncate(count);
    }
}

/// Rays to be shaded: all at once, or fewer.
pub(super) enum Portion {
    Full(Rays<true>),
    Fewer(Rays<false>),
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Row {
    #[inline(always)]
    pub(super) fn rays(&self, x: &[f32], y: &[f32]) -> Portion {
        let (x, y) = (&x[self.range.clone()], &y[self.range.clone()]);
        if let (Some(x), Some(y)) = (x.first_chunk(), y.first_chunk()) {
            return Portion::Full(Rays { count: MOST, picked: None, x: Lanes::of(x), y: Lanes::of(y) });
        }
        let count = x.len().next_multiple_of(STEP).min(MOST);
        let mut rays = Rays { count, picked: None, x: Lanes::ZERO, y: Lanes::ZERO };
        rays.x[..x.len()].copy_from_slice(x);
        rays.y[..y.len()].copy_from_slice(y);
        Portion::Fewer(rays)
    }

    /// Puts values where they belong: those of the rays that see the triangle, by the triangles that all see.
    #[inline(always)]
    pub(super) fn put(&self, values: &Lanes, nearest: &Nearest, place: u32, out: &mut [f32]) {
        let out = &mut out[self.range.clone()];
        if self.all {
            out.copy_from_slice(&values[..out.len()]);
            return;
        }
        for ((out, &seen), &value) in out.iter_mut().zip(&nearest.place[self.range.clone()]).zip(values.iter()) {
            *out = if seen == place { value } else { *out };
        }
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Portion {
    /// Up to [`MOST`] rays by their numbers; the last one stands for what is missing.
    #[inline(always)]
    pub(super) fn picked(numbers: &[u32], x: &[f32], y: &[f32]) -> Self {
        let mut padded = [numbers.last().copied().unwrap_or_default(); MOST];
        padded[..numbers.len()].copy_from_slice(numbers);
        let count = numbers.len().next_multiple_of(STEP).min(MOST);
        let (x, y) = (gathered(x, &padded, count), gathered(y, &padded, count));
        let picked = Some(padded);
        if count == MOST { Self::Full(Rays { count, picked, x, y }) } else { Self::Fewer(Rays { count, picked, x, y }) }
    }
}

#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
pub(super) fn gathered(values: &[f32], numbers: &[u32; MOST], count: usize) -> Lanes {
    // Nothing refers to this, so values may be gathered while it is written.
    let mut found = Lanes::ZERO;
    for i in 0..count.min(MOST) {
        // What is not there cannot be asked for; said so, this becomes a gather without branches.
        let number = numbers[i] as usize;
        found[i] = if number < values.len() { values[number] } else { 0.0 };
    }
    let mut lanes = Lanes::ZERO;
    for i in 0..count.min(MOST) {
        lanes[i] = found[i];
    }
    lanes
}
