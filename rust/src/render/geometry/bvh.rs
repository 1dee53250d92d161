//! A bounding volume hierarchy (BVH): finds the triangles in a region of space without testing all of them.
//!
//! A node has [`WIDTH`] boxes, because that many are tested together in vector code.
//!
//! What must not break: a triangle that touches the region is always found. One too many costs only time, so boxes are
//! rounded outward.

use std::ops::Range;

use super::bvh_builder::{Item, build};
pub(crate) use super::bvh_node::{Boxes, Node, WIDTH, below, index};
use super::vector::{Bounds, Vector, dot, largest, scale, sub};
use crate::prefetch::prefetch;

/// A part of space that boxes are tested for.
pub(crate) trait Region {
    /// Returns which boxes it may meet; those that do not touch it may be among them where they lie within float32's
    /// rounding.
    fn meets(&self, boxes: &Boxes) -> [bool; WIDTH];
}

/// Triangles that are found by a visit: the range of their numbers, and their box, by its lane.
pub(crate) struct Leaf<'a> {
    pub(crate) triangles: Range<usize>,
    pub(crate) boxes: &'a Boxes,
    pub(crate) lane: usize,
}

/// A part of space that is looked through from front to back.
pub(crate) trait Ahead {
    /// Returns how near boxes may be, infinite for those that do not meet the region.
    fn nearness(&self, boxes: &Boxes) -> [f32; WIDTH];
}

/// What is done with triangles that are found from front to back; a trait, because closures may not be inlined always.
pub(crate) trait Leaves {
    /// Returns how far triangles may lie that are still looked for.
    fn farthest(&self) -> f32;

    /// Prepares for triangles that are waiting to be looked at.
    fn expect(&self, leaf: Range<usize>);

    /// Looks at the triangles of a leaf.
    fn look_at(&mut self, leaf: Range<usize>);
}

/// A box that is still to be looked into: how near it may be, and its node or triangles.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Waiting {
    distance: f32,
    first: u32,
    count: u32,
}

/// A BVH with wide nodes. Triangles are numbered in the order of a visit: those of a leaf follow each other.
#[derive(Debug, Default)]
pub(crate) struct Bvh {
    /// The root comes first; none where there are no triangles.
    pub(crate) nodes: Vec<Node>,
    /// No coordinate of its triangles is larger.
    pub(crate) reach: f64,
    /// A ball that holds all triangles: its middle and its radius, 0 where there are none.
    ball: (Vector, f64),
}

/// A ball is larger than it would have to be by this fraction of what it lies in, so that rounding leaves nothing out.
const ROUNDED: f64 = 1e-9;

impl Bvh {
    /// Builds the BVH of triangles with these bounds, on the threads of this pool where it is `parallel`. Returns it,
    /// and the triangles' old indices in its order.
    pub(crate) fn new(bounds: impl Iterator<Item = Bounds>, parallel: bool) -> (Self, Vec<u32>) {
        let mut items: Vec<Item> = (0..).zip(bounds).map(|(number, bounds)| Item { bounds, number }).collect();
        let mut bvh = Self::default();
        if items.is_empty() {
            return (bvh, vec![]);
        }
        let (nodes, around) = build(&mut items, parallel);
        bvh.nodes = nodes;
        bvh.set_around(&around);
        let order = bvh.number_by_visits();
        (bvh, order.into_iter().map(|at| items[at].number).collect())
    }

    /// Puts boxes around triangles that have moved, given the bounds of all in this BVH's order.
    pub(crate) fn refit(&mut self, bounds: &[Bounds]) {
        let mut around = vec![Bounds::NONE; self.nodes.len()];
        // The nodes below a node come after it.
        for at in (0..self.nodes.len()).rev() {
            let node = &mut self.nodes[at];
            for lane in 0..node.used {
                let (first, count) = (node.first[lane] as usize, node.count[lane] as usize);
                let below = match count {
                    0 => around[first],
                    _ => bounds[first..first + count].iter().fold(Bounds::NONE, |all, one| all.with(one)),
                };
                node.boxes.put(lane, &below);
                around[at] = around[at].with(&below);
            }
        }
        if let Some(all) = around.first() {
            self.set_around(all);
        }
    }

    fn set_around(&mut self, bounds: &Bounds) {
        self.reach = largest(bounds.low).max(largest(bounds.high));
        let half = scale(sub(bounds.high, bounds.low), 0.5);
        self.ball = (bounds.centre(), dot(half, half).sqrt() + ROUNDED * self.reach);
    }

    /// Returns whether a ray from an origin passes all triangles at a distance, so that none has to be looked at.
    pub(crate) fn is_missed(&self, origin: Vector, direction: Vector) -> bool {
        let ((middle, radius), length) = (self.ball, dot(direction, direction));
        let way = sub(middle, origin);
        let (along, away) = (dot(way, direction), dot(way, way));
        let aside = away * length - along * along;
        // Rounding errors are fractions of the terms, so of the way there.
        let least = (radius * radius + ROUNDED * away) * length;
        aside > least || (along < 0.0 && away > radius * radius)
    }

    /// Numbers triangles in the order in which a visit finds them; returns their indices in the builder's order.
    fn number_by_visits(&mut self) -> Vec<usize> {
        let mut order = vec![];
        let mut stack = vec![0];
        while let Some(at) = stack.pop() {
            let node = &mut self.nodes[at];
            for lane in (0..node.used).rev() {
                let first = node.first[lane] as usize;
                if node.count[lane] == 0 {
                    stack.push(first);
                } else {
                    node.first[lane] = index(order.len());
                    order.extend(first..first + node.count[lane] as usize);
                }
            }
        }
        order
    }

    /// Calls `look_at` with every leaf whose box, and those around it, may meet the region, until it says that this is
    /// enough by `false`.
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
    pub(crate) fn visit(&self, stack: &mut Vec<u32>, region: &impl Region, mut look_at: impl FnMut(Leaf) -> bool) {
        stack.clear();
        if !self.nodes.is_empty() {
            stack.push(0);
        }
        while let Some(at) = stack.pop() {
            let node = &self.nodes[at as usize];
            // As bits, so that what is not met costs nothing; boxes that are not there lie nowhere.
            let mut met = region.meets(&node.boxes).iter().rev().fold(0u32, |bits, &met| bits << 1 | u32::from(met));
            met &= (1 << node.used) - 1;
            while met != 0 {
                let lane = met.ilog2() as usize;
                met &= !(1 << lane);
                let first = node.first[lane];
                if node.count[lane] == 0 {
                    stack.push(first);
                } else {
                    let triangles = first as usize..(first + node.count[lane]) as usize;
                    if !look_at(Leaf { triangles, boxes: &node.boxes, lane }) {
                        return;
                    }
                }
            }
        }
    }

    /// Looks at the triangles of leaves whose boxes may meet the region, nearer boxes first.
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
    pub(crate) fn visit_from_front(&self, waiting: &mut Vec<Waiting>, region: &impl Ahead, leaves: &mut impl Leaves) {
        waiting.clear();
        if !self.nodes.is_empty() {
            waiting.push(Waiting { distance: f32::NEG_INFINITY, first: 0, count: 0 });
        }
        while let Some(next) = waiting.pop() {
            if next.distance > leaves.farthest() {
                continue;
            }
            if next.count > 0 {
                leaves.look_at(next.first as usize..(next.first + next.count) as usize);
                continue;
            }
            let node = &self.nodes[next.first as usize];
            let (distances, farthest) = (region.nearness(&node.boxes), leaves.farthest().min(f32::MAX));
            let begin = waiting.len();
            // As bits, so that what is not met, or too far away, costs nothing; boxes that are not there lie nowhere.
            let mut met = distances.iter().rev().fold(0u32, |bits, &near| bits << 1 | u32::from(near <= farthest));
            met &= (1 << node.used) - 1;
            while met != 0 {
                let lane = met.trailing_zeros() as usize;
                met &= met - 1;
                let new = Waiting { distance: distances[lane], first: node.first[lane], count: node.count[lane] };
                if new.count > 0 {
                    leaves.expect(new.first as usize..(new.first + new.count) as usize);
                } else {
                    let Boxes { low, high } = &self.nodes[new.first as usize].boxes;
                    prefetch(low);
                    prefetch(high);
                }
                // The nearest comes last, to be taken first.
                waiting.push(new);
                let mut at = waiting.len() - 1;
                while at > begin && waiting[at - 1].distance <= new.distance {
                    waiting[at] = waiting[at - 1];
                    at -= 1;
                }
                waiting[at] = new;
            }
        }
    }
}

#[cfg(test)]
#[allow(clippy::cast_possible_truncation, reason = "small numbers")]
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
            let (bvh, order) = Bvh::new(bounds.iter().copied(), false);
            let mut sorted = order.clone();
            sorted.sort_unstable();
            prop_assert_eq!(sorted, (0..index(bounds.len())).collect::<Vec<_>>());
            let probe = probe.map(f64::from);
            let holds = |b: &Bounds| (0..3).all(|i| b.low[i] <= probe[i] && probe[i] <= b.high[i]);
            let mut visited = vec![];
            bvh.visit(&mut vec![], &Probe(probe), |leaf| {
                visited.extend(order[leaf.triangles].iter().copied().filter(|&i| holds(&bounds[i as usize])));
                true
            });
            // What a visit finds first has the lower number.
            let indices: Vec<usize> = visited.iter().map(|item| order.iter().position(|i| i == item).unwrap()).collect();
            prop_assert!(indices.is_sorted());
            visited.sort_unstable();
            let expected: Vec<u32> = (0..index(bounds.len())).filter(|&i| holds(&bounds[i as usize])).collect();
            prop_assert_eq!(visited, expected);
            // From front to back, every box is looked into that is not farther than what is looked for.
            let mut ahead = Along { visited: vec![], farthest: probe[0] as f32 };
            bvh.visit_from_front(&mut vec![], &ahead.clone(), &mut ahead);
            let near: Vec<u32> = (0..index(bounds.len())).filter(|&i| bounds[i as usize].low[0] <= probe[0]).collect();
            let mut looked_at: Vec<u32> = ahead.visited.iter().map(|&i| order[i]).collect();
            looked_at.sort_unstable();
            looked_at.retain(|i| near.contains(i));
            prop_assert_eq!(looked_at, near);
        }
    }

    /// Boxes along x, the lowest first.
    #[derive(Clone)]
    struct Along {
        visited: Vec<usize>,
        farthest: f32,
    }

    impl Ahead for Along {
        fn nearness(&self, boxes: &Boxes) -> [f32; WIDTH] {
            boxes.low[0]
        }
    }

    impl Leaves for Along {
        fn farthest(&self) -> f32 {
            self.farthest
        }

        fn expect(&self, _: Range<usize>) {}

        fn look_at(&mut self, leaf: Range<usize>) {
            self.visited.extend(leaf);
        }
    }

    /// Nodes as text, which two BVHs can be compared by.
    fn text(bvh: &Bvh) -> String {
        format!("{:?}", bvh.nodes)
    }

    /// Threads change neither the tree nor the order, also where all triangles lie on each other, in a plane, or ever
    /// closer to a point, so that cuts take off few of them.
    #[test]
    fn threads_build_the_same_tree() {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
        let count = 20_000;
        let mut state = 1u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            f64::from((state >> 40) as u32) / f64::from(1 << 24)
        };
        let soup: Vec<[f64; 3]> = (0..count).map(|_| [random(), random(), random()]).collect();
        let kinds: [Box<dyn Fn(usize) -> [f64; 3] + Sync>; 4] = [
            Box::new(|i| soup[i]),
            Box::new(|_| [1.0; 3]),
            Box::new(|i| [soup[i][0], 2.0, soup[i][1]]),
            Box::new(|i| [0.9f64.powi(i32::try_from(i).unwrap()), 0.0, 0.0]),
        ];
        for middle in kinds {
            let bounds = || (0..count).map(|i| Bounds { low: middle(i), high: middle(i).map(|x| x + 0.01) });
            let (alone, order) = Bvh::new(bounds(), false);
            let (together, same) = pool.install(|| Bvh::new(bounds(), true));
            assert_eq!(order, same);
            assert_eq!(text(&alone), text(&together));
            let mut sorted = order;
            sorted.sort_unstable();
            assert_eq!(sorted, (0..index(count)).collect::<Vec<_>>());
        }
    }

    /// A tree that was fitted to what has moved holds it: in the boxes of its leaves, in those around them, and in its ball.
    #[test]
    fn a_refitted_tree_holds_what_has_moved() {
        let bounds: Vec<Bounds> = (0..300u32)
            .map(|i| {
                let low = [f64::from(i % 7), f64::from(i % 11), f64::from(i % 13)].map(|x| 0.1 * x);
                Bounds { low, high: low.map(|x| x + 0.05) }
            })
            .collect();
        let (mut bvh, order) = Bvh::new(bounds.iter().copied(), false);
        let moved = |at: &u32| {
            let Bounds { low, high } = bounds[*at as usize];
            let by = [10.0, f64::from(at % 5), -3.0];
            Bounds { low: std::array::from_fn(|i| low[i] + by[i]), high: std::array::from_fn(|i| high[i] + by[i]) }
        };
        let now: Vec<Bounds> = order.iter().map(moved).collect();
        assert!(bvh.is_missed([10.5, 1.0, -50.0], [0.0, 0.0, 1.0]));
        bvh.refit(&now);
        let holds = |boxes: &Boxes, lane: usize, inner: &Bounds| {
            (0..3).all(|i| {
                f64::from(boxes.low[i][lane]) <= inner.low[i] && f64::from(boxes.high[i][lane]) >= inner.high[i]
            })
        };
        let mut leaves = 0;
        for node in &bvh.nodes {
            for lane in 0..node.used {
                let (first, count) = (node.first[lane] as usize, node.count[lane] as usize);
                leaves += count;
                assert!(now[first..first + count * usize::from(count > 0)].iter().all(|one| holds(
                    &node.boxes,
                    lane,
                    one
                )));
                if count == 0 {
                    let below = &bvh.nodes[first];
                    let inner = |k: usize| Bounds {
                        low: [0, 1, 2].map(|i| f64::from(below.boxes.low[i][k])),
                        high: [0, 1, 2].map(|i| f64::from(below.boxes.high[i][k])),
                    };
                    assert!((0..below.used).all(|k| holds(&node.boxes, lane, &inner(k))));
                }
            }
        }
        assert_eq!(leaves, 300);
        let around = now.iter().fold(Bounds::NONE, |all, one| all.with(one));
        assert!((bvh.reach - around.high[0]).abs() < 1e-12);
        // Past a corner of the box, across its diagonal: just inside of the ball, and just outside.
        let (middle, corner) = (around.centre(), around.high);
        let across = [corner[1] - middle[1], middle[0] - corner[0], 0.0];
        for (reach, missed) in [(0.999, false), (1.001, true)] {
            let near: Vector = std::array::from_fn(|i| middle[i] + reach * (corner[i] - middle[i]));
            let origin = std::array::from_fn(|i| near[i] - 4.0 * across[i]);
            assert_eq!(bvh.is_missed(origin, across), missed);
        }
        for (x, missed) in [(10.5, false), (0.5, true)] {
            assert_eq!(bvh.is_missed([x, 1.0, -50.0], [0.0, 0.0, 1.0]), missed);
            assert!(bvh.is_missed([x, 1.0, -50.0], [0.0, 0.0, -1.0]));
        }
    }
}
