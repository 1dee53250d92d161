//! Builds a binary BVH over triangles by the surface area heuristic, on all threads.
//!
//! Triangles are kept as [`Item`]s that are moved into the order of the tree, so that every pass over a node's
//! triangles reads memory in sequence.
//!
//! Measured next to crates (two threads; a bumpy sphere and a soup; nanoseconds a ray on one thread, the sphere's rays
//! coherent; wheels are built for plain x86-64, so that is how the crates were compiled):
//!
//! | 10^6 triangles | build, s | MB | closest hit, ns | any hit, ns |
//! |---|---|---|---|---|
//! | `obvhs` 0.4.0, two wide, sphere / soup | 0.33 / 0.32 | 130 | 353 / 508 | 283 / 319 |
//! | `obvhs` 0.4.0, eight wide, sphere / soup | 0.45 / 0.55 | 25 | 434 / 974 | 332 / 427 |
//! | `bvh` 0.13.0 (every box that a ray meets), sphere / soup | 0.24 / 0.51 | 158 | 1690 / 20466 | - |
//!
//! `tinybvh-rs` compiles C++ with `-march=native`: a wheel of it stops on other processors. `obvhs` gives other bits
//! where it is compiled with fused operations, and knows rays only: the renderer asks for regions of space too. Its
//! tree would also have another order, by which it is decided which of two triangles in one plane is seen.
//!
//! What must not break: the tree and the order of its triangles depend on the triangles alone, not on threads.

#![allow(clippy::cast_precision_loss, reason = "scenes have fewer than 2^31 triangles")]

use std::ops::Range;

use super::vector::{Bounds, Vector};

/// Triangles in a leaf, at most; unless they all lie at one point.
const LEAF: usize = 8;

/// Candidates for a cut along an axis.
const CUTS: usize = 12;

/// What a visit to a node costs, in tests of a triangle.
const VISIT: f64 = 0.5;

/// Nodes of fewer triangles are built by one thread.
const ALONE: usize = 1 << 12;

/// A triangle's box, and its number.
#[derive(Clone, Copy, Debug)]
pub(super) struct Item {
    pub(super) bounds: Bounds,
    pub(super) number: u32,
}

/// A node of the binary tree.
pub(super) struct Node {
    pub(super) bounds: Bounds,
    /// The indices of its triangles in the order of the tree.
    pub(super) range: Range<usize>,
    /// None for a leaf.
    pub(super) children: Option<Box<[Node; 2]>>,
}

/// Builds the tree, on the threads of this pool where they may be used, and puts the items into its order.
pub(super) fn build(items: &mut [Item], parallel: bool) -> Node {
    let mut spare = items.to_vec();
    subtree(items, &mut spare, 0, if parallel { ALONE } else { usize::MAX })
}

/// Builds the tree over some items, which begin at an index in the order of all; `spare` is a buffer for as many. Nodes
/// of fewer than `alone` items are built by one thread.
fn subtree(items: &mut [Item], spare: &mut [Item], first: usize, alone: usize) -> Node {
    let bounds = around(items);
    let range = first..first + items.len();
    let children = split(&bounds, items, spare).map(|middle| {
        let (left, right) = items.split_at_mut(middle);
        let (left_spare, right_spare) = spare.split_at_mut(middle);
        let mut left = || subtree(left, left_spare, first, alone);
        let mut right = || subtree(right, right_spare, first + middle, alone);
        let (left, right) = if range.len() >= alone { rayon::join(left, right) } else { (left(), right()) };
        Box::new([left, right])
    });
    Node { bounds, range, children }
}

fn around(items: &[Item]) -> Bounds {
    items.iter().fold(Bounds::NONE, |all, item| all.with(&item.bounds))
}

/// Orders items so that those before the returned position are one child, the rest the other; None for a leaf.
///
/// The cut is the one with the least expected cost by the surface area heuristic.
///
/// Source: Wald, On fast construction of SAH-based bounding volume hierarchies, 2007.
fn split(around: &Bounds, items: &mut [Item], spare: &mut [Item]) -> Option<usize> {
    if items.len() <= 1 {
        return None;
    }
    let (axis, cut, centres) = best_cut(around, items)?;
    let (mut left, mut right) = (0, 0);
    for at in 0..items.len() {
        let item = items[at];
        if bin(item.bounds.centre(), &centres, axis) < cut {
            items[left] = item;
            left += 1;
        } else {
            spare[right] = item;
            right += 1;
        }
    }
    items[left..].copy_from_slice(&spare[..right]);
    Some(left)
}

/// Finds the axis and the bin at which to cut, and what the centres lie in; None for a leaf.
fn best_cut(around: &Bounds, items: &[Item]) -> Option<(usize, usize, Bounds)> {
    let centres = items.iter().fold(Bounds::NONE, |all, item| {
        let centre = item.bounds.centre();
        all.with(&Bounds { low: centre, high: centre })
    });
    let mut bins = [[(0usize, Bounds::NONE); CUTS]; 3];
    let open = [0, 1, 2].map(|axis| centres.high[axis] - centres.low[axis] > 0.0);
    for item in items {
        let centre = item.bounds.centre();
        for axis in 0..3 {
            if open[axis] {
                let (count, all) = &mut bins[axis][bin(centre, &centres, axis)];
                *count += 1;
                *all = all.with(&item.bounds);
            }
        }
    }
    let mut best: Option<(f64, usize, usize)> = None;
    for axis in (0..3).filter(|&axis| open[axis]) {
        let mut right = [(0usize, Bounds::NONE); CUTS];
        let mut sum = (0, Bounds::NONE);
        for (at, bin) in bins[axis].iter().enumerate().rev() {
            sum = (sum.0 + bin.0, sum.1.with(&bin.1));
            right[at] = sum;
        }
        let mut left = (0, Bounds::NONE);
        for cut in 1..CUTS {
            left = (left.0 + bins[axis][cut - 1].0, left.1.with(&bins[axis][cut - 1].1));
            if left.0 == 0 || right[cut].0 == 0 {
                continue;
            }
            let cost = left.1.half_area() * left.0 as f64 + right[cut].1.half_area() * right[cut].0 as f64;
            if best.is_none_or(|(least, ..)| cost < least) {
                best = Some((cost, axis, cut));
            }
        }
    }
    let (cost, axis, cut) = best?;
    let leaf = items.len() as f64 * around.half_area();
    if items.len() <= LEAF && cost + 2.0 * VISIT * around.half_area() >= leaf {
        return None;
    }
    Some((axis, cut, centres))
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a fraction of CUTS")]
fn bin(centre: Vector, centres: &Bounds, axis: usize) -> usize {
    let fraction = (centre[axis] - centres.low[axis]) / (centres.high[axis] - centres.low[axis]);
    ((fraction * CUTS as f64) as usize).min(CUTS - 1)
}
