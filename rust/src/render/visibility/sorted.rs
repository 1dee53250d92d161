//! Sorts a tile's rays by the triangle that they see, into portions that are shaded together.
//!
//! Rays that are side by side are used in place. Scattered ones are gathered, because shading needs full vectors.
//!
//! What must not break: each ray is shaded exactly once, with the bits that it has alone.

use std::ops::Range;

use super::nearest::Nearest;
use crate::render::lanes::{Lanes, MOST, Rays, STEP};

/// Rays that lie side by side.
#[derive(Clone, Debug)]
pub(crate) struct Row {
    pub(crate) range: Range<usize>,
    /// Whether all of them see the triangle; else some of them do.
    pub(crate) all: bool,
}

/// The rays that see a triangle.
#[derive(Debug, Default)]
pub(crate) struct Sorted {
    /// [`MOST`] each, or fewer.
    pub(crate) rows: Vec<Row>,
    /// Numbers of the others, where few of a block see it.
    pub(crate) scattered: Vec<u32>,
}

impl Sorted {
    /// Finds those of the triangle at an index in the tile's list; without `rows` all of them are scattered.
    #[allow(clippy::cast_possible_truncation, reason = "a tile has fewer than 2^32 rays")]
    pub(crate) fn of_triangle(&mut self, nearest: &Nearest, index: u32, rows: bool) {
        self.rows.clear();
        self.scattered.clear();
        let length = nearest.length;
        let mut block = 0;
        while block < nearest.blocks {
            let first = block * length;
            let all = nearest.only[block] == index;
            block += 1;
            if all && !rows {
                self.scattered.extend(first as u32..(block * length) as u32);
                continue;
            }
            if all {
                while block < nearest.blocks && nearest.only[block] == index {
                    block += 1;
                }
                self.add_rows(first..block * length, true);
                continue;
            }
            let count = nearest.counts[index as usize][block - 1] as usize;
            // To shade a ray for nothing takes less time than to pick one out and put it back.
            if rows && count * 5 >= length * 2 {
                self.add_rows(first..block * length, false);
            } else if count > 0
                && let Some(known) = nearest.sorted(block - 1, index)
            {
                self.scattered.extend_from_slice(known);
            } else if count > 0 {
                self.pick(&nearest.index[first..block * length], first, index);
            }
        }
    }

    /// Takes rays that lie side by side; without `rows` all of them are scattered.
    #[allow(clippy::cast_possible_truncation, reason = "a tile has fewer than 2^32 rays")]
    pub(crate) fn of_range(&mut self, range: Range<usize>, rows: bool) {
        self.rows.clear();
        self.scattered.clear();
        if rows {
            self.add_rows(range, true);
        } else {
            self.scattered.extend(range.start as u32..range.end as u32);
        }
    }

    fn add_rows(&mut self, range: Range<usize>, all: bool) {
        let firsts = range.clone().step_by(MOST);
        self.rows.extend(firsts.map(|first| Row { range: first..range.end.min(first + MOST), all }));
    }

    /// Adds the numbers of some rays that see the triangle, without a branch for each.
    #[allow(clippy::cast_possible_truncation, reason = "a tile has fewer than 2^32 rays")]
    fn pick(&mut self, indices: &[u32], first: usize, index: u32) {
        let mut count = self.scattered.len();
        self.scattered.resize(count + indices.len(), 0);
        for (ray, &member) in indices.iter().enumerate() {
            self.scattered[count] = (first + ray) as u32;
            count += usize::from(member == index);
        }
        self.scattered.truncate(count);
    }
}

/// Rays to be shaded: all at once, or fewer.
pub(crate) enum Portion<'a> {
    Full(Rays<'a, true>),
    Fewer(Rays<'a, false>),
}

/// A buffer for rays that do not lie side by side.
#[derive(Debug)]
pub(crate) struct Picked {
    numbers: [u32; MOST],
    x: Lanes,
    y: Lanes,
}

impl Default for Picked {
    fn default() -> Self {
        Self { numbers: [0; MOST], x: Lanes::ZERO, y: Lanes::ZERO }
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Row {
    #[inline(always)]
    pub(crate) fn rays<'a>(&self, x: &'a [f32], y: &'a [f32], buffer: &'a mut Picked) -> Portion<'a> {
        let count = self.range.len().next_multiple_of(STEP).min(MOST);
        // Of rays that follow those of the row nothing is worked out.
        let (x, y) = (&x[self.range.start..], &y[self.range.start..]);
        if let (Some(x), Some(y)) = (x.first_chunk(), y.first_chunk()) {
            return Portion::new(count, None, self.range.start, x, y);
        }
        buffer.x[..x.len()].copy_from_slice(x);
        buffer.y[..y.len()].copy_from_slice(y);
        Portion::new(count, None, self.range.start, &buffer.x, &buffer.y)
    }

    /// Puts values where they belong: those of the rays that see the triangle, by the triangles that all see.
    #[inline(always)]
    pub(crate) fn put(&self, values: &Lanes, indices: &[u32], index: u32, out: &mut [f32]) {
        let out = &mut out[self.range.clone()];
        if self.all {
            match out.first_chunk_mut() {
                Some(out) => *out = **values,
                None => out.copy_from_slice(&values[..out.len()]),
            }
            return;
        }
        for ((out, &seen), &value) in out.iter_mut().zip(&indices[self.range.clone()]).zip(values.iter()) {
            *out = if seen == index { value } else { *out };
        }
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl<'a> Portion<'a> {
    #[inline(always)]
    fn new(
        count: usize,
        picked: Option<&'a [u32; MOST]>,
        first: usize,
        x: &'a [f32; MOST],
        y: &'a [f32; MOST],
    ) -> Self {
        if count == MOST {
            Self::Full(Rays { count, picked, first, x, y })
        } else {
            Self::Fewer(Rays { count, picked, first, x, y })
        }
    }

    /// Gathers up to [`MOST`] rays by their numbers; the last one stands for what is missing.
    #[inline(always)]
    pub(crate) fn picked(numbers: &[u32], x: &[f32], y: &[f32], buffer: &'a mut Picked) -> Self {
        let Picked { numbers: padded, x: some_x, y: some_y } = buffer;
        *padded = [numbers.last().copied().unwrap_or_default(); MOST];
        padded[..numbers.len()].copy_from_slice(numbers);
        let count = numbers.len().next_multiple_of(STEP).min(MOST);
        (*some_x, *some_y) = (gathered(x, padded, count), gathered(y, padded, count));
        Self::new(count, Some(padded), 0, some_x, some_y)
    }
}

#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
pub(crate) fn gathered(values: &[f32], numbers: &[u32; MOST], count: usize) -> Lanes {
    // Nothing refers to this, so values may be gathered while it is written.
    let mut values_seen = Lanes::ZERO;
    for i in 0..count.min(MOST) {
        // What is not there cannot be asked for; said so, this becomes a gather without branches.
        let number = numbers[i] as usize;
        values_seen[i] = if number < values.len() { values[number] } else { 0.0 };
    }
    let mut lanes = Lanes::ZERO;
    for i in 0..count.min(MOST) {
        lanes[i] = values_seen[i];
    }
    lanes
}
