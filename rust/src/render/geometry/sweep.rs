//! Sweeps: all that the points of a triangle pass on their way to a light, or along any of some directions.
//!
//! A sweep is convex. Something lies outside of it if a plane parts the two, so planes are tried: the separating axis
//! theorem, with the axes that the sides and edges of both have.
//!
//! What must not break: what lies in the sweep is never said to lie outside, but for what only touches it: neighbours of
//! the triangle share edges and corners with it.

use super::bvh::{Boxes, Region, WIDTH};
use super::vector::{Vector, cross, dot, sub};

/// What of a distance is rounding, by the size of what it is the distance of.
const ROUNDING: f64 = 1e-12;

/// Where the points of a sweep go.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Towards<'a> {
    /// To a point.
    Point(Vector),
    /// Along all directions between these, without end: the corners of a spherical polygon in their order, or one.
    Directions(&'a [Vector]),
}

/// All that the points of a triangle pass.
#[derive(Debug)]
pub(crate) struct Sweep<'a> {
    /// Its first corner. All else is relative to it.
    origin: Vector,
    corners: [Vector; 3],
    edges: [Vector; 3],
    towards: Towards<'a>,
    /// The largest distance of a corner, or of the point, from the origin.
    size: f64,
    /// Planes through its sides, all of it before them: their normals, not of unit length, and where along them they lie,
    /// less what is rounding.
    planes: Vec<(Vector, f64)>,
    /// Boxes are compared with so many of them: more would take longer than to look at what they hold.
    of_boxes: usize,
}

impl<'a> Sweep<'a> {
    pub(crate) fn new(corners: &[Vector; 3], towards: Towards<'a>) -> Self {
        let origin = corners[0];
        let corners = corners.map(|corner| sub(corner, origin));
        let edges = [sub(corners[1], corners[0]), sub(corners[2], corners[1]), sub(corners[0], corners[2])];
        let towards = match towards {
            Towards::Point(point) => Towards::Point(sub(point, origin)),
            along @ Towards::Directions(_) => along,
        };
        let end = if let Towards::Point(point) = towards { point } else { [0.0; 3] };
        let size = corners.iter().chain([&end]).fold(0.0f64, |most, &corner| most.max(length(corner)));
        let mut sweep = Self { origin, corners, edges, towards, size, planes: Vec::with_capacity(8), of_boxes: 0 };
        sweep.add_plane(cross(edges[0], edges[1]));
        match towards {
            Towards::Point(point) => {
                for k in 0..3 {
                    sweep.add_plane(cross(edges[k], sub(point, corners[k])));
                }
                sweep.of_boxes = sweep.planes.len();
            }
            Towards::Directions(directions) => {
                let count = directions.len();
                for i in (0..count).filter(|_| count > 1) {
                    sweep.add_plane(cross(directions[i], directions[(i + 1) % count]));
                }
                let between = sweep.planes.len();
                for &way in directions {
                    for edge in edges {
                        sweep.add_plane(cross(edge, way));
                    }
                }
                sweep.of_boxes = if count > 1 { between } else { sweep.planes.len() };
            }
        }
        sweep
    }

    /// Adds the planes across an axis that have all of it before them.
    fn add_plane(&mut self, axis: Vector) {
        let slack = ROUNDING * length(axis) * self.size;
        for axis in [axis, axis.map(|x| -x)] {
            if let Some(least) = self.least(axis).filter(|_| slack > 0.0) {
                self.planes.push((axis, least + slack));
            }
        }
    }

    /// Returns how far along an axis all of it lies at least; None where it has no end there.
    fn least(&self, axis: Vector) -> Option<f64> {
        let [a, b, c] = self.corners.map(|corner| dot(axis, corner));
        let least = a.min(b).min(c);
        match self.towards {
            Towards::Point(point) => Some(least.min(dot(axis, point))),
            Towards::Directions(directions) => directions.iter().all(|&way| dot(axis, way) >= 0.0).then_some(least),
        }
    }

    /// Returns whether a triangle lies outside, or only touches the sweep; false also where that is not certain.
    pub(crate) fn misses(&self, other: &[Vector; 3]) -> bool {
        let other = other.map(|corner| sub(corner, self.origin));
        let most = |axis: Vector| {
            let [a, b, c] = other.map(|corner| dot(axis, corner));
            a.max(b).max(c)
        };
        if self.planes.iter().any(|&(axis, least)| most(axis) <= least) {
            return true;
        }
        let size = other.iter().fold(self.size, |most, &corner| most.max(length(corner)));
        let parts = |axis: Vector| {
            let slack = ROUNDING * length(axis) * size;
            let before = |axis: Vector| self.least(axis).is_some_and(|least| most(axis) <= least + slack);
            slack > 0.0 && (before(axis) || before(axis.map(|x| -x)))
        };
        let edges = [sub(other[1], other[0]), sub(other[2], other[1]), sub(other[0], other[2])];
        let across = |way: Vector| edges.iter().any(|&edge| parts(cross(edge, way)));
        parts(cross(edges[0], edges[1]))
            || match self.towards {
                Towards::Point(point) => self.corners.iter().any(|&corner| across(sub(point, corner))),
                Towards::Directions(directions) => directions.iter().any(|&way| across(way)),
            }
            || self.edges.iter().any(|&edge| across(edge))
    }
}

fn length(vector: Vector) -> f64 {
    dot(vector, vector).sqrt()
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Region for Sweep<'_> {
    #[inline(always)]
    fn meets(&self, boxes: &Boxes) -> [bool; WIDTH] {
        let mut meets = [true; WIDTH];
        for (axis, least) in &self.planes[..self.of_boxes] {
            let before = boxes.reach_before(axis, &self.origin, *least);
            for i in 0..WIDTH {
                meets[i] &= before[i];
            }
        }
        meets
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::render::geometry::vector::{Bounds, add, scale};
    use proptest::prelude::*;

    fn vector(size: f64) -> impl Strategy<Value = Vector> {
        prop::array::uniform3(-size..size)
    }

    /// Returns where a segment, or a ray where `end` is infinite, passes through a triangle by more than rounding.
    pub(crate) fn passes(from: Vector, way: Vector, end: f64, [a, b, c]: &[Vector; 3]) -> Option<Vector> {
        let normal = cross(sub(*b, *a), sub(*c, *a));
        let at = dot(normal, sub(*a, from)) / dot(normal, way);
        let point = add(from, scale(way, at));
        let sides = [(a, b), (b, c), (c, a)].map(|(from, to)| dot(cross(sub(*to, *from), sub(point, *from)), normal));
        let inside = sides.iter().all(|&side| side > 1e-9 * dot(normal, normal));
        (at > 1e-9 && at < end - 1e-9 && inside).then_some(point)
    }

    /// A node all of whose boxes are one.
    fn boxes_of(bounds: &Bounds) -> Boxes {
        let mut boxes = Boxes { low: [[0.0; WIDTH]; 3], high: [[0.0; WIDTH]; 3] };
        for lane in 0..WIDTH {
            boxes.put(lane, bounds);
        }
        boxes
    }

    /// Returns a point of a triangle for one of the unit square.
    pub(crate) fn point_of([a, b, c]: &[Vector; 3], [u, v]: [f64; 2]) -> Vector {
        let [u, v] = if u + v > 1.0 { [1.0 - u, 1.0 - v] } else { [u, v] };
        add(*a, add(scale(sub(*b, *a), u), scale(sub(*c, *a), v)))
    }

    /// Of its ends more than others: there ways run along a sweep's own edges.
    fn fraction() -> impl Strategy<Value = f64> {
        prop_oneof![2 => 0f64..1.0, 1 => prop::sample::select(vec![0.0, 1.0])]
    }

    /// A polygon of directions around one.
    fn polygon(middle: Vector, size: f64) -> Vec<Vector> {
        let aside = cross(middle, if middle[0].abs() < 0.9 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] });
        let up = cross(middle, aside);
        [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
            .map(|[x, y]| add(middle, add(scale(aside, x * size), scale(up, y * size))))
            .to_vec()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]

        /// What any of many ways from the triangle passes through does not lie outside, and the box around it is met.
        /// Others share an edge or a corner with the triangle, lie in its plane, or are flat along an axis.
        #[test]
        fn what_is_passed_through_is_not_missed(
            corners in prop::array::uniform3(vector(1.0)), other in prop::array::uniform3(vector(2.0)),
            shared in 0usize..4, flat in any::<bool>(), target in vector(3.0), size in 0.01f64..0.5,
            samples in prop::collection::vec((prop::array::uniform2(fraction()), prop::array::uniform2(fraction())), 64),
        ) {
            let mut other = other;
            other[..shared.min(2)].copy_from_slice(&corners[..shared.min(2)]);
            if flat {
                let [a, b, _] = other;
                other[2] = [other[2][0], other[2][1], a[2] + (b[2] - a[2]) * 0.5];
            }
            let directions = polygon(target, size);
            let single = [target];
            for towards in [Towards::Point(target), Towards::Directions(&directions), Towards::Directions(&single)] {
                let sweep = Sweep::new(&corners, towards);
                for &(at, along) in &samples {
                    let from = point_of(&corners, at);
                    let point = match towards {
                        Towards::Point(point) => passes(from, sub(point, from), 1.0, &other),
                        Towards::Directions([only]) => passes(from, *only, f64::INFINITY, &other),
                        Towards::Directions(directions) => {
                            let [a, b] = [0, 1].map(|k| {
                                add(scale(directions[k], 1.0 - along[0]), scale(directions[3 - k], along[0]))
                            });
                            let way = add(scale(a, 1.0 - along[1]), scale(b, along[1]));
                            passes(from, way, f64::INFINITY, &other)
                        }
                    };
                    if let Some(point) = point {
                        prop_assert!(!sweep.misses(&other), "{towards:?}");
                        for bounds in [Bounds::of(&other), Bounds::of(&[point])] {
                            prop_assert_eq!(sweep.meets(&boxes_of(&bounds)), [true; WIDTH]);
                        }
                    }
                }
            }
        }
    }

    /// Neighbours only touch the way to a light that both sides face, on ridges and in valleys; what stands in it does not.
    #[test]
    fn neighbours_are_missed() {
        let triangle = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let light = [0.3, 0.3, 5.0];
        let up = polygon([0.0, 0.0, 1.0], 0.2);
        for towards in [Towards::Point(light), Towards::Directions(&[[0.1, 0.1, 1.0]]), Towards::Directions(&up)] {
            let sweep = Sweep::new(&triangle, towards);
            for height in [-0.7, 0.0, 0.7] {
                assert!(sweep.misses(&[triangle[1], triangle[0], [0.5, -1.0, height]]), "{towards:?} {height}");
                assert!(
                    sweep.misses(&[triangle[0], [-0.5, -0.3, height], [0.2, -0.7, height]]),
                    "{towards:?} {height}"
                );
            }
            // A screen before it, one behind it, one that cuts through, and a wall on its edge that leans over it.
            let screen = |z: f64| [[-5.0, -5.0, z], [5.0, -5.0, z], [0.0, 8.0, z]];
            assert!(!sweep.misses(&screen(2.0)) && sweep.misses(&screen(-0.1)));
            assert!(!sweep.misses(&[[0.2, 0.2, -1.0], [0.3, 0.2, -1.0], [0.2, 0.2, 1.0]]));
            assert!(!sweep.misses(&[triangle[0], triangle[1], [0.5, 0.9, 0.5]]));
        }
        // What lies beyond a light is not in its way; far along a direction everything is.
        let beyond = [[-5.0, -5.0, 6.0], [5.0, -5.0, 6.0], [0.0, 8.0, 6.0]];
        assert!(Sweep::new(&triangle, Towards::Point(light)).misses(&beyond));
        assert!(!Sweep::new(&triangle, Towards::Directions(&up)).misses(&beyond));
        // Of directions to both sides of its plane nothing is certain but what lies behind all of them.
        let along = polygon([1.0, 0.0, 0.0], 0.2);
        let sweep = Sweep::new(&triangle, Towards::Directions(&along));
        assert!(sweep.misses(&[[-3.0, 0.0, 0.0], [-2.0, 1.0, 0.0], [-2.0, 0.0, 1.0]]));
        assert!(!sweep.misses(&[[3.0, -1.0, -1.0], [3.0, 1.0, -1.0], [3.0, 0.0, 1.0]]));
    }

    /// Each of these is parted from the way by planes across one axis alone: its own normal, or one across two edges.
    #[test]
    fn each_axis_counts() {
        let triangle = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let light = [0.3, 0.3, 5.0];
        let sweep = Sweep::new(&triangle, Towards::Point(light));
        // Large, close to a corner, and across the ways that leave it to either side.
        let by = |x: f64| [[x - 9.0, -9.0, -9.0], [x + 9.0, 9.0, -9.0], [x, 0.0, 20.0]];
        assert!(sweep.misses(&by(1.02)) && !sweep.misses(&by(0.98)));
        // Close to an edge: across it, and its plane cuts what lies behind the edge.
        let leaning = |[at, edge, outward]: [Vector; 3], by: f64| {
            let (across, at) = (cross(edge, outward), add(at, scale(outward, by)));
            [add(at, scale(across, 0.5)), sub(at, scale(across, 0.5)), add(at, add(scale(outward, 3.0), edge))]
        };
        let way = scale(sub(light, triangle[1]), 0.2);
        let of_way = [add(triangle[1], scale(way, 2.0)), way, [1.0, -0.4, 0.16]];
        let of_edge = [[0.5, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, -1.0, -1.0]];
        for place in [of_way, of_edge] {
            assert!(sweep.misses(&leaning(place, 0.01)) && !sweep.misses(&leaning(place, -0.01)), "{place:?}");
        }
    }

    /// Boxes to any side of the ways are not met, those on them are; however far away the light is, neighbours are missed.
    #[test]
    fn boxes_aside_are_not_met() {
        let triangle = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let up = polygon([0.0, 0.0, 1.0], 0.2);
        for towards in
            [Towards::Point([0.3, 0.3, 5.0]), Towards::Directions(&[[0.0, 0.0, 1.0]]), Towards::Directions(&up)]
        {
            let sweep = Sweep::new(&triangle, towards);
            let met = |at: Vector| sweep.meets(&boxes_of(&Bounds { low: at, high: add(at, [0.1; 3]) }));
            assert_eq!(met([0.3, 0.3, 3.0]), [true; WIDTH]);
            for aside in [[-2.0, 0.3, 3.0], [2.5, 0.3, 3.0], [0.3, -2.0, 3.0], [0.3, 2.5, 3.0], [0.3, 0.3, -0.5]] {
                assert_eq!(met(aside), [false; WIDTH], "{towards:?} {aside:?}");
            }
        }
        let far = [[3.17, 1.93, 0.21], [3.2, 1.9, 0.2], [3.1, 1.88, 0.23]];
        let sweep = Sweep::new(&far, Towards::Point([1e5, 2e5, 3e7]));
        assert!((0..3).all(|k| sweep.misses(&[
            far[k],
            far[(k + 1) % 3],
            sub(add(far[k], far[(k + 1) % 3]), far[(k + 2) % 3])
        ])));
    }

    /// From a triangle without an area nothing is certain in its plane.
    #[test]
    fn a_flat_triangle_is_no_reason_to_miss() {
        let flat = [[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]];
        let other = [[1.0, -1.0, 1.0], [1.0, 1.0, 1.0], [1.5, 0.0, 1.0]];
        assert!(!Sweep::new(&flat, Towards::Directions(&[[0.0, 0.0, 1.0]])).misses(&other));
        assert!(!Sweep::new(&flat, Towards::Point([1.2, 0.0, 3.0])).misses(&other));
    }
}
