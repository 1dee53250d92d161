//! A hierarchy of boxes over triangles, so that most of them need not be looked at.

#![allow(clippy::cast_precision_loss, reason = "scenes have fewer than 2^31 triangles")]

use std::ops::Range;

use super::vector::Bounds;

/// Triangles in a leaf, at most; unless they all lie at one place.
const LEAF: usize = 4;

/// Candidates for a cut along an axis.
const CUTS: usize = 12;

/// What a visit to a node costs, in tests of a triangle.
const VISIT: f64 = 0.5;

#[derive(Clone, Debug)]
struct Node {
    bounds: Bounds,
    /// The first of two children that lie side by side, or of a leaf's triangles.
    first: u32,
    /// Of a leaf its triangles, else 0.
    count: u32,
}

/// Boxes in boxes. Triangles are numbered in its order: those of a leaf, and of any node, follow each other.
#[derive(Debug, Default)]
pub(super) struct Hierarchy {
    nodes: Vec<Node>,
}

impl Hierarchy {
    /// The hierarchy of triangles with these bounds, and in its order their old numbers.
    pub(super) fn new(bounds: &[Bounds]) -> (Self, Vec<u32>) {
        let mut order: Vec<u32> = (0..index(bounds.len())).collect();
        let mut hierarchy = Self { nodes: Vec::with_capacity(bounds.len()) };
        if bounds.is_empty() {
            return (hierarchy, order);
        }
        let node = |range: &Range<usize>, order: &[u32]| {
            let bounds = order[range.clone()].iter().fold(Bounds::NONE, |all, &i| all.with(&bounds[i as usize]));
            Node { bounds, first: index(range.start), count: index(range.len()) }
        };
        hierarchy.nodes.push(node(&(0..order.len()), &order));
        let mut open = vec![(0, 0..order.len())];
        while let Some((at, range)) = open.pop() {
            let Some(middle) = split(&hierarchy.nodes[at].bounds, bounds, &mut order[range.clone()]) else { continue };
            let first = hierarchy.nodes.len();
            for child in [range.start..range.start + middle, range.start + middle..range.end] {
                hierarchy.nodes.push(node(&child, &order));
                open.push((hierarchy.nodes.len() - 1, child));
            }
            hierarchy.nodes[at] = Node { bounds: hierarchy.nodes[at].bounds, first: index(first), count: 0 };
        }
        (hierarchy, order)
    }

    /// Calls `leaf` with the triangles of every leaf whose box, and those around it, pass `meets`, until it says that
    /// this is enough by `false`.
    pub(super) fn visit(
        &self,
        stack: &mut Vec<u32>,
        mut meets: impl FnMut(&Bounds) -> bool,
        mut leaf: impl FnMut(Range<usize>) -> bool,
    ) {
        stack.clear();
        if !self.nodes.is_empty() {
            stack.push(0);
        }
        while let Some(at) = stack.pop() {
            let node = &self.nodes[at as usize];
            if !meets(&node.bounds) {
                continue;
            }
            let first = node.first as usize;
            if node.count == 0 {
                stack.extend([node.first + 1, node.first]);
            } else if !leaf(first..first + node.count as usize) {
                return;
            }
        }
    }
}

#[allow(clippy::cast_possible_truncation, reason = "scenes have fewer than 2^31 triangles")]
fn index(n: usize) -> u32 {
    n as u32
}

/// Orders triangles so that those before the returned place are one child, the rest the other; None for a leaf.
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

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of CUTS")]
fn bin(bounds: &Bounds, centres: &Bounds, axis: usize) -> usize {
    let share = (bounds.centre()[axis] - centres.low[axis]) / (centres.high[axis] - centres.low[axis]);
    ((share * CUTS as f64) as usize).min(CUTS - 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Every triangle is in one leaf, in its box; a visit finds all that meet a place.
        #[test]
        fn a_visit_finds_what_is_there(
            places in prop::collection::vec((prop::array::uniform3(-3i8..4), prop::array::uniform3(0u8..3)), 0..60),
            probe in prop::array::uniform3(-4i8..5),
        ) {
            let bounds: Vec<Bounds> = places
                .iter()
                .map(|(low, size)| Bounds {
                    low: low.map(f64::from),
                    high: std::array::from_fn(|i| f64::from(low[i]) + f64::from(size[i])),
                })
                .collect();
            let (hierarchy, order) = Hierarchy::new(&bounds);
            let mut sorted = order.clone();
            sorted.sort_unstable();
            prop_assert_eq!(sorted, (0..index(bounds.len())).collect::<Vec<_>>());
            let probe = probe.map(f64::from);
            let holds = |b: &Bounds| (0..3).all(|i| b.low[i] <= probe[i] && probe[i] <= b.high[i]);
            let mut found = vec![];
            hierarchy.visit(&mut vec![], holds, |range| {
                found.extend(order[range].iter().copied().filter(|&i| holds(&bounds[i as usize])));
                true
            });
            found.sort_unstable();
            let expected: Vec<u32> = (0..index(bounds.len())).filter(|&i| holds(&bounds[i as usize])).collect();
            prop_assert_eq!(found, expected);
        }
    }
}
