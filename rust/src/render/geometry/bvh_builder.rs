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
use super::vector::Bounds;

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
            Some(parts) => {
                let [left, right] = parts.members(&range);
                members[largest] = left;
                members.insert(largest + 1, right);
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
        Some(parts) => Child::Nodes(subtree(parts.members(&member.range).into(), items, spare, alone)),
    }]
}

fn around(items: &[Item]) -> Bounds {
    items.iter().fold(Bounds::NONE, |all, item| all.with(&item.bounds))
}

/// The two children of a node: how many items the first has, and what each lies in.
struct Parts {
    count: usize,
    bounds: [Bounds; 2],
}

impl Parts {
    /// Returns the children of a node with these items.
    fn members(&self, range: &Range<usize>) -> [Member; 2] {
        let (middle, [left, right]) = (range.start + self.count, self.bounds);
        let new = |bounds, range| Member { bounds, range, is_leaf: false };
        [new(left, range.start..middle), new(right, middle..range.end)]
    }
}

/// Orders items so that those of the first child come first; None for a leaf.
///
/// The cut is the one with the least expected cost by the surface area heuristic.
///
/// Source: Wald, On fast construction of SAH-based bounding volume hierarchies, 2007.
fn split(around: &Bounds, items: &mut [Item], spare: &mut [Item]) -> Option<Parts> {
    if items.len() <= 1 {
        return None;
    }
    let Cut { bins, bin, bounds } = best_cut(around, items)?;
    let (mut left, mut right) = (0, 0);
    for at in 0..items.len() {
        let item = items[at];
        if bins.of(&item.bounds) < bin {
            items[left] = item;
            left += 1;
        } else {
            spare[right] = item;
            right += 1;
        }
    }
    items[left..].copy_from_slice(&spare[..right]);
    Some(Parts { count: left, bounds })
}

/// The bins along an axis, all of one width, in which the centres of items lie.
#[derive(Clone, Copy)]
struct Bins {
    axis: usize,
    low: f64,
    length: f64,
}

impl Bins {
    #[inline]
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a fraction of CUTS")]
    fn of(&self, bounds: &Bounds) -> usize {
        let fraction = (middle(bounds, self.axis) - self.low) / self.length;
        // Processors have no conversion to 64 bits without a sign.
        ((fraction * CUTS as f64) as i32 as usize).min(CUTS - 1)
    }
}

/// Returns the middle of a box along an axis. An item's ends are so small that their sum is finite.
#[inline]
fn middle(bounds: &Bounds, axis: usize) -> f64 {
    (bounds.low[axis] + bounds.high[axis]) * 0.5
}

/// The ends of a box: the low ones, and the high ones with the other sign, so that of each the least counts.
#[derive(Clone, Copy)]
struct Ends([f64; 6]);

impl Ends {
    const NONE: Self = Self([f64::INFINITY; 6]);

    #[inline]
    fn of(bounds: &Bounds) -> Self {
        let ([a, b, c], [x, y, z]) = (bounds.low, bounds.high);
        Self([a, b, c, -x, -y, -z])
    }

    #[inline]
    fn take_in(&mut self, other: &Self) {
        for i in 0..6 {
            self.0[i] = if other.0[i] < self.0[i] { other.0[i] } else { self.0[i] };
        }
    }

    fn bounds(&self) -> Bounds {
        let [a, b, c, x, y, z] = self.0;
        Bounds { low: [a, b, c], high: [-x, -y, -z] }
    }
}

/// Where to cut: the bins, the first of them that belongs to the second child, and what both children lie in.
struct Cut {
    bins: Bins,
    bin: usize,
    bounds: [Bounds; 2],
}

/// Finds where to cut; None for a leaf.
fn best_cut(around: &Bounds, items: &[Item]) -> Option<Cut> {
    let mut centres = Ends::NONE;
    for item in items {
        let [x, y, z] = [0, 1, 2].map(|axis| middle(&item.bounds, axis));
        centres.take_in(&Ends([x, y, z, -x, -y, -z]));
    }
    let centres = centres.bounds();
    let axes = [0, 1, 2].map(|axis| {
        let (low, length) = (centres.low[axis], centres.high[axis] - centres.low[axis]);
        Bins { axis, low, length }
    });
    let mut binned = [[(0usize, Ends::NONE); CUTS]; 3];
    for item in items {
        let ends = Ends::of(&item.bounds);
        for (bins, binned) in axes.iter().zip(&mut binned) {
            if bins.length > 0.0 {
                let (count, all) = &mut binned[bins.of(&item.bounds)];
                *count += 1;
                all.take_in(&ends);
            }
        }
    }
    let mut best: Option<(f64, Cut)> = None;
    for (bins, binned) in axes.iter().zip(&binned).filter(|(bins, _)| bins.length > 0.0) {
        // A cut after an empty bin parts the items as the one before it does.
        let mut right = [(0usize, Ends::NONE); CUTS];
        let mut sum = (0, Ends::NONE);
        for (right, (count, all)) in right.iter_mut().zip(binned).rev() {
            if *count > 0 {
                sum.0 += count;
                sum.1.take_in(all);
            }
            *right = sum;
        }
        let mut left = (0, Ends::NONE);
        for bin in 1..CUTS {
            let (count, all) = &binned[bin - 1];
            if *count == 0 || right[bin].0 == 0 {
                continue;
            }
            left.0 += count;
            left.1.take_in(all);
            let bounds = [left.1.bounds(), right[bin].1.bounds()];
            let cost = bounds[0].half_area() * left.0 as f64 + bounds[1].half_area() * right[bin].0 as f64;
            if best.as_ref().is_none_or(|(least, _)| cost < *least) {
                best = Some((cost, Cut { bins: *bins, bin, bounds }));
            }
        }
    }
    let (cost, cut) = best?;
    let leaf = items.len() as f64 * around.half_area();
    if items.len() <= LEAF && cost + 2.0 * VISIT * around.half_area() >= leaf {
        return None;
    }
    Some(cut)
}
