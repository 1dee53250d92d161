//! A bounding volume hierarchy (BVH): finds the triangles in a region of space without testing all of them.
//!
//! A node has [`WIDTH`] boxes, because that many are tested together in vector code.
//!
//! What must not break: a triangle that touches the region is always found. One too many costs only time, so boxes are
//! rounded outward.

#![allow(clippy::cast_precision_loss, reason = "scenes have fewer than 2^31 triangles")]

use std::ops::Range;

use super::vector::{Bounds, largest};

/// Triangles in a leaf, at most; unless they all lie at one point.
const LEAF: usize = WIDTH;

/// Candidates for a split along an axis.
const CUTS: usize = 12;

/// Cost of visiting a node, in triangle tests.
const VISIT: f64 = 0.5;

/// Boxes side by side in a node, which are tested together.
pub(crate) const WIDTH: usize = 8;

/// Up to [`WIDTH`] boxes: their lowest and highest x, y and z.
#[derive(Clone, Debug)]
pub(crate) struct Boxes {
    pub(crate) low: [[f32; WIDTH]; 3],
    pub(crate) high: [[f32; WIDTH]; 3],
}

#[derive(Clone, Debug)]
struct Node {
    boxes: Boxes,
    /// The number of a box's node, or its first triangle.
    first: [u32; WIDTH],
    /// How many triangles it has; 0 where it has a node of its own.
    count: [u32; WIDTH],
    /// How many boxes there are.
    used: usize,
}

/// A part of space that boxes are tested for.
pub(crate) trait Region {
    /// Returns which boxes it may meet; those that do not touch it may be among them where they lie within float32's
    /// rounding.
    fn meets(&self, boxes: &Boxes) -> [bool; WIDTH];
}

/// A BVH with wide nodes. Triangles are numbered in its order: those of a leaf, and of any node, follow each other.
#[derive(Debug, Default)]
pub(crate) struct Bvh {
    nodes: Vec<Node>,
    /// No coordinate of its triangles is larger.
    pub(crate) reach: f64,
}

/// A node of the binary BVH, before it is collapsed into nodes of [`WIDTH`].
struct BinaryNode {
    bounds: Bounds,
    range: Range<usize>,
    /// The first of two that lie side by side; None for a leaf.
    first: Option<usize>,
}

impl Bvh {
    /// Builds the BVH of triangles with these bounds. Returns it, and the triangles' old indices in its order.
    pub(crate) fn new(bounds: &[Bounds]) -> (Self, Vec<u32>) {
        let mut order: Vec<u32> = (0..index(bounds.len())).collect();
        let mut bvh = Self::default();
        if bounds.is_empty() {
            return (bvh, order);
        }
        let node = |range: Range<usize>, order: &[u32]| {
            let bounds = order[range.clone()].iter().fold(Bounds::NONE, |all, &i| all.with(&bounds[i as usize]));
            BinaryNode { bounds, range, first: None }
        };
        let mut nodes = vec![node(0..order.len(), &order)];
        bvh.reach = largest(nodes[0].bounds.low).max(largest(nodes[0].bounds.high));
        let mut at = 0;
        while at < nodes.len() {
            let range = nodes[at].range.clone();
            if let Some(middle) = split(&nodes[at].bounds, bounds, &mut order[range.clone()]) {
                nodes[at].first = Some(nodes.len());
                nodes.push(node(range.start..range.start + middle, &order));
                nodes.push(node(range.start + middle..range.end, &order));
            }
            at += 1;
        }
        bvh.collapse(&nodes, vec![0]);
        (bvh, order)
    }

    /// Collapses the binary tree into a wide node, largest area first, and does the same below it. Returns the node's
    /// index.
    fn collapse(&mut self, nodes: &[BinaryNode], mut members: Vec<usize>) -> u32 {
        while members.len() < WIDTH {
            let open = (0..members.len()).filter(|&i| nodes[members[i]].first.is_some());
            let area = |i: usize| nodes[members[i]].bounds.half_area();
            let Some(largest) = open.max_by(|&i, &j| area(i).total_cmp(&area(j))) else { break };
            let first = nodes[members[largest]].first.unwrap_or_default();
            members[largest] = first;
            members.insert(largest + 1, first + 1);
        }
        let number = self.nodes.len();
        let boxes = Boxes { low: [[f32::INFINITY; WIDTH]; 3], high: [[f32::NEG_INFINITY; WIDTH]; 3] };
        self.nodes.push(Node { boxes, first: [0; WIDTH], count: [0; WIDTH], used: members.len() });
        for (lane, &member) in members.iter().enumerate() {
            let child = &nodes[member];
            let (first, count) = match child.first {
                Some(first) => (self.collapse(nodes, vec![first, first + 1]), 0),
                None => (index(child.range.start), index(child.range.len())),
            };
            let wide = &mut self.nodes[number];
            (wide.first[lane], wide.count[lane]) = (first, count);
            for axis in 0..3 {
                wide.boxes.low[axis][lane] = below(child.bounds.low[axis]);
                wide.boxes.high[axis][lane] = -below(-child.bounds.high[axis]);
            }
        }
        index(number)
    }

    /// Calls `leaf` with the triangles of every leaf whose box, and those around it, may meet the region, until it says
    /// that this is enough by `false`.
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
    pub(crate) fn visit(&self, stack: &mut Vec<u32>, region: &impl Region, mut leaf: impl FnMut(Range<usize>) -> bool) {
        stack.clear();
        if !self.nodes.is_empty() {
            stack.push(0);
        }
        while let Some(at) = stack.pop() {
            let node = &self.nodes[at as usize];
            let meets = region.meets(&node.boxes);
            for lane in (0..node.used).rev() {
                if !meets[lane] {
                    continue;
                }
                let first = node.first[lane];
                if node.count[lane] == 0 {
                    stack.push(first);
                } else if !leaf(first as usize..(first + node.count[lane]) as usize) {
                    return;
                }
            }
        }
    }
}

/// Returns the largest float32 at or below a number.
#[allow(clippy::cast_possible_truncation, reason = "what is rounded up is taken down again")]
pub(crate) fn below(x: f64) -> f32 {
    let single = x as f32;
    if f64::from(single) > x { single.next_down() } else { single }
}

#[allow(clippy::cast_possible_truncation, reason = "scenes have fewer than 2^31 triangles")]
fn index(n: usize) -> u32 {
    n as u32
}

/// Orders triangles so that those before the returned position are one child, the rest the other; None for a leaf.
///
/// The cut is the one with the least expected cost by the surface area heuristic.
///
/// Source: Wald, On fast construction of SAH-based bounding volume hierarchies, 2007.
fn split(around: &Bounds, bounds: &[Bounds], order: &mut [u32]) -> Option<usize> {
    if order.len() <= 1 {
        return None;
    }
    let centres = Bounds::of(&order.iter().map(|&i| bounds[i as usize].centre()).collect::<Vec<_>>());
    let whole = order.len() as f64;
    let mut best: Option<(f64, usize, usize)> = None;
    for axis in 0..3 {
        let extent = centres.high[axis] - centres.low[axis];
        if extent <= 0.0 {
            continue;
        }
        let mut bins = [(0usize, Bounds::NONE); CUTS];
        for &i in order.iter() {
            let (count, all) = &mut bins[bin(&bounds[i as usize], &centres, axis)];
            *count += 1;
            *all = all.with(&bounds[i as usize]);
        }
        let mut right = [(0usize, Bounds::NONE); CUTS];
        let mut sum = (0, Bounds::NONE);
        for (at, bin) in bins.iter().enumerate().rev() {
            sum = (sum.0 + bin.0, sum.1.with(&bin.1));
            right[at] = sum;
        }
        let mut left = (0, Bounds::NONE);
        for cut in 1..CUTS {
            left = (left.0 + bins[cut - 1].0, left.1.with(&bins[cut - 1].1));
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
    if order.len() <= LEAF && cost + 2.0 * VISIT * around.half_area() >= whole * around.half_area() {
        return None;
    }
    let mut left = Vec::with_capacity(order.len());
    let mut right = Vec::new();
    for &i in order.iter() {
        if bin(&bounds[i as usize], &centres, axis) < cut { left.push(i) } else { right.push(i) }
    }
    let middle = left.len();
    left.extend(right);
    order.copy_from_slice(&left);
    Some(middle)
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a fraction of CUTS")]
fn bin(bounds: &Bounds, centres: &Bounds, axis: usize) -> usize {
    let fraction = (bounds.centre()[axis] - centres.low[axis]) / (centres.high[axis] - centres.low[axis]);
    ((fraction * CUTS as f64) as usize).min(CUTS - 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    struct Probe([f64; 3]);

    impl Region for Probe {
        fn meets(&self, boxes: &Boxes) -> [bool; WIDTH] {
            let inside = |i: usize, low: f32, high: f32| f64::from(low) <= self.0[i] && self.0[i] <= f64::from(high);
            std::array::from_fn(|lane| (0..3).all(|i| inside(i, boxes.low[i][lane], boxes.high[i][lane])))
        }
    }

    proptest! {
        /// Every triangle is in one leaf, in its box; a visit finds all that contain a point.
        #[test]
        fn a_visit_finds_what_is_there(
            boxes in prop::collection::vec((prop::array::uniform3(-3i8..4), prop::array::uniform3(0u8..3)), 0..60),
            probe in prop::array::uniform3(-4i8..5),
        ) {
            let bounds: Vec<Bounds> = boxes
                .iter()
                .map(|(low, size)| Bounds {
                    low: low.map(f64::from),
                    high: std::array::from_fn(|i| f64::from(low[i]) + f64::from(size[i])),
                })
                .collect();
            let (bvh, order) = Bvh::new(&bounds);
            let mut sorted = order.clone();
            sorted.sort_unstable();
            prop_assert_eq!(sorted, (0..index(bounds.len())).collect::<Vec<_>>());
            let probe = probe.map(f64::from);
            let holds = |b: &Bounds| (0..3).all(|i| b.low[i] <= probe[i] && probe[i] <= b.high[i]);
            let mut found = vec![];
            bvh.visit(&mut vec![], &Probe(probe), |range| {
                found.extend(order[range].iter().copied().filter(|&i| holds(&bounds[i as usize])));
                true
            });
            found.sort_unstable();
            let expected: Vec<u32> = (0..index(bounds.len())).filter(|&i| holds(&bounds[i as usize])).collect();
            prop_assert_eq!(found, expected);
        }
    }
}
