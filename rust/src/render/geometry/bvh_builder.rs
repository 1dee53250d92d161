//! Builds a BVH over triangles by the surface area heuristic, on all threads.
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

use super::bvh_node::{Boxes, Node, WIDTH, index};
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

/// Triangles that follow each other in the order of the tree: a node of the binary tree that wide nodes are made of.
#[derive(Clone, Debug)]
struct Member {
    bounds: Bounds,
    range: Range<usize>,
    /// Whether it is known to have no children.
    is_leaf: bool,
}

/// Wide nodes of a subtree, the topmost first; `first` counts from the first of these.
pub(super) type Nodes = Vec<Node>;

/// Builds the tree, on the threads of this pool where they may be used, and puts the items into its order. Returns the
/// nodes, and what all items lie in.
///
/// There must be items.
pub(super) fn build(items: &mut [Item], parallel: bool) -> (Nodes, Bounds) {
    let mut spare = items.to_vec();
    let all = Member { bounds: around(items), range: 0..items.len(), is_leaf: false };
    let bounds = all.bounds;
    (subtree(vec![all], items, &mut spare, if parallel { ALONE } else { usize::MAX }), bounds)
}

/// Builds the wide node over some members, and all below it. `items` are those of the members, `spare` is a buffer for
/// as many. Nodes of fewer than `alone` items are built by one thread.
///
/// The member with the largest surface is split until there are [`WIDTH`]. Only then is it known what lies below, so
/// the binary tree never is in memory as a whole.
fn subtree(mut members: Vec<Member>, items: &mut [Item], spare: &mut [Item], alone: usize) -> Nodes {
    let start = members[0].range.start;
    while members.len() < WIDTH {
        let open = members.iter().enumerate().filter(|(_, member)| !member.is_leaf);
        let area = |(_, member): &(usize, &Member)| member.bounds.half_area();
        let Some((largest, member)) = open.max_by(|a, b| area(a).total_cmp(&area(b))) else { break };
        let (range, own) = (member.range.clone(), member.range.start - start..member.range.end - start);
        match split(&member.bounds, &mut items[own.clone()], &mut spare[own.clone()]) {
            None => members[largest].is_leaf = true,
            Some(count) => {
                let middle = range.start + count;
                let (left, right) = items[own].split_at(count);
                let new = |range: Range<usize>, items: &[Item]| Member { bounds: around(items), range, is_leaf: false };
                members[largest] = new(range.start..middle, left);
                members.insert(largest + 1, new(middle..range.end, right));
            }
        }
    }
    let boxes = Boxes { low: [[f32::INFINITY; WIDTH]; 3], high: [[f32::NEG_INFINITY; WIDTH]; 3] };
    let mut node = Node { boxes, first: [0; WIDTH], count: [0; WIDTH], used: members.len() };
    for (lane, member) in members.iter().enumerate() {
        node.boxes.put(lane, &member.bounds);
    }
    let mut nodes = vec![node];
    for (lane, child) in children(&members, items, spare, alone).into_iter().enumerate() {
        let first = index(nodes.len());
        match child {
            Child::Leaf(range) => {
                (nodes[0].first[lane], nodes[0].count[lane]) = (index(range.start), index(range.len()));
            }
            Child::Nodes(child) => {
                nodes[0].first[lane] = first;
                nodes.extend(child.into_iter().map(|mut node| {
                    for lane in 0..node.used {
                        node.first[lane] += if node.count[lane] == 0 { first } else { 0 };
                    }
                    node
                }));
            }
        }
    }
    nodes
}

/// What lies below a member of a wide node.
enum Child {
    Leaf(Range<usize>),
    Nodes(Nodes),
}

/// Builds what lies below the members of a wide node.
fn children(members: &[Member], items: &mut [Item], spare: &mut [Item], alone: usize) -> Vec<Child> {
    let [member] = members else {
        let middle = members.len() / 2;
        let (first, second) = members.split_at(middle);
        let (count, cut) = (items.len(), second[0].range.start - first[0].range.start);
        let ((left, right), (left_spare, right_spare)) = (items.split_at_mut(cut), spare.split_at_mut(cut));
        let mut left = || children(first, left, left_spare, alone);
        let mut right = || children(second, right, right_spare, alone);
        let (mut all, right) = if count >= alone { rayon::join(left, right) } else { (left(), right()) };
        all.extend(right);
        return all;
    };
    if member.is_leaf {
        return vec![Child::Leaf(member.range.clone())];
    }
    vec![match split(&member.bounds, items, spare) {
        None => Child::Leaf(member.range.clone()),
        Some(count) => {
            let (start, end) = (member.range.start, member.range.end);
            let (left, right) = items.split_at(count);
            let left = Member { bounds: around(left), range: start..start + count, is_leaf: false };
            let right = Member { bounds: around(right), range: start + count..end, is_leaf: false };
            Child::Nodes(subtree(vec![left, right], items, spare, alone))
        }
    }]
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
