//! How far the nearest triangle is from a point, in any direction.
//!
//! It bounds optical flow without an image: what is so far away cannot move faster in it.
//!
//! What must not break: no triangle is nearer than what is returned, but for float64's rounding. Boxes are rounded
//! outwards, so a distance to a box is never larger than that to what it holds.

use std::ops::Range;

use crate::render::geometry::bvh::{Ahead, Boxes, Leaves, WIDTH, below};
use crate::render::geometry::vector::{Vector, add, cross, dot, scale, sub};
use crate::render::scene::Scene;

/// Returns the distance from a point of the world to the nearest triangle that stands still in it, infinite where there
/// is none.
pub(crate) fn nearest_distance(scene: &Scene, point: Vector) -> f64 {
    let world = &scene.frames[0];
    let point = sub(point, world.centre);
    let mut looking = Looking { corners: &scene.corners[world.triangles.clone()], point, squared: f64::INFINITY };
    world.bvh.visit_from_front(&mut vec![], &Around(point), &mut looking);
    looking.squared.sqrt()
}

/// All of space, the nearer to a point the sooner.
struct Around(Vector);

impl Ahead for Around {
    fn nearness(&self, boxes: &Boxes) -> [f32; WIDTH] {
        std::array::from_fn(|lane| {
            let outside = |i: usize| {
                let (low, high) = (f64::from(boxes.low[i][lane]), f64::from(boxes.high[i][lane]));
                (low - self.0[i]).max(self.0[i] - high).max(0.0)
            };
            let away = [outside(0), outside(1), outside(2)];
            below(dot(away, away).sqrt())
        })
    }
}

/// The search for the nearest of a frame's triangles.
struct Looking<'a> {
    corners: &'a [[Vector; 3]],
    point: Vector,
    squared: f64,
}

impl Leaves for Looking<'_> {
    fn farthest(&self) -> f32 {
        -below(-self.squared.sqrt())
    }

    fn expect(&self, _: Range<usize>) {}

    fn look_at(&mut self, leaf: Range<usize>) {
        for corners in &self.corners[leaf] {
            self.squared = self.squared.min(to_triangle(self.point, corners));
        }
    }
}

/// A triangle that is narrower than this fraction of its distance is as good as its edges.
const NARROW: f64 = 1e-12;

/// Returns the squared distance from a point to a triangle.
fn to_triangle(point: Vector, corners: &[Vector; 3]) -> f64 {
    let [a, b, c] = corners.map(|corner| sub(corner, point));
    let edges = [sub(b, a), sub(c, b), sub(a, c)];
    let normal = cross(edges[0], edges[1]);
    let most = |vectors: [Vector; 3]| vectors.iter().fold(0.0f64, |most, one| most.max(dot(*one, *one)));
    // Of corners that lie in a line nothing but rounding is left in the normal.
    let is_wide = dot(normal, normal) > NARROW * NARROW * most(edges) * most([a, b, c]);
    let inside = |from, to| dot(cross(from, to), normal) >= 0.0;
    if is_wide && inside(a, b) && inside(b, c) && inside(c, a) {
        let aside = dot(a, normal);
        return aside * aside / dot(normal, normal);
    }
    to_segment(a, b).min(to_segment(b, c)).min(to_segment(c, a))
}

/// Returns the squared distance from the origin to a segment.
fn to_segment(from: Vector, to: Vector) -> f64 {
    let way = sub(to, from);
    let along = (-dot(from, way) / dot(way, way)).clamp(0.0, 1.0);
    let nearest = add(from, scale(way, along));
    dot(nearest, nearest)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::geometry::bvh::Bvh;
    use crate::render::geometry::vector::Bounds;
    use proptest::prelude::*;

    /// Points of a triangle, its corners and edges among them.
    fn points(corners: &[Vector; 3]) -> impl Iterator<Item = Vector> {
        let [a, b, c] = *corners;
        (0..=40u32).flat_map(move |i| {
            (0..=40 - i).map(move |j| {
                let (u, v) = (f64::from(i) / 40.0, f64::from(j) / 40.0);
                add(a, add(scale(sub(b, a), u), scale(sub(c, a), v)))
            })
        })
    }

    /// Face, edges and corners: distances worked out by hand.
    #[test]
    fn the_nearest_point_may_lie_anywhere_on_a_triangle() {
        let corners = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]];
        let cases = [
            ([1.0, 1.0, 3.0], 9.0),
            ([1.0, 1.0, -3.0], 9.0),
            ([2.0, -3.0, 4.0], 25.0),
            ([-3.0, 2.0, 4.0], 25.0),
            ([4.0, 4.0, 0.0], 8.0),
            ([-3.0, -4.0, 0.0], 25.0),
            ([7.0, -4.0, 0.0], 25.0),
            ([1.0, 1.0, 0.0], 0.0),
        ];
        for (point, squared) in cases {
            for turned in 0..3 {
                let corners = [corners[turned], corners[(turned + 1) % 3], corners[(turned + 2) % 3]];
                let flipped = [corners[0], corners[2], corners[1]];
                assert!((to_triangle(point, &corners) - squared).abs() < 1e-12, "{point:?}");
                assert!((to_triangle(point, &flipped) - squared).abs() < 1e-12, "{point:?}");
            }
        }
    }

    /// Three corners in a line, whose normal is what rounding leaves of it, are as far away as the line.
    #[test]
    fn corners_in_a_line_are_a_line() {
        let corners = [[-6.0, -5.0, 4.0], [-6.0, -7.0, 9.0], [-6.0, -3.0, -1.0]].map(|corner| scale(corner, 0.05));
        let point = [0.0, 0.05 * 3.968_312_624_730_841, 0.0];
        let [_, low, high] = corners.map(|corner| sub(corner, point));
        assert!((to_triangle(point, &corners) - to_segment(low, high)).abs() < 1e-12);
    }

    proptest! {
        /// No point of any triangle is nearer, and one is as near; through the BVH as triangle by triangle.
        #[test]
        fn nothing_is_nearer(
            triangles in prop::collection::vec(prop::array::uniform3(prop::array::uniform3(-9i8..10)), 1..40),
            point in prop::array::uniform3(-12.0f64..12.0),
            size in prop::sample::select(vec![0.05, 1.0]),
        ) {
            let corners: Vec<[Vector; 3]> = triangles.iter().map(|t| t.map(|p| p.map(|x| size * f64::from(x)))).collect();
            let point = scale(point, size);
            let alone = |t: &[Vector; 3]| to_triangle(point, t);
            let area = |[a, b, c]: &[Vector; 3]| { let n = cross(sub(*b, *a), sub(*c, *a)); dot(n, n) };
            let corners: Vec<_> = corners.into_iter().filter(|t| area(t) > 0.0).collect();
            let (bvh, order) = Bvh::new(corners.iter().map(|t| Bounds::of(t)), false);
            let sorted: Vec<_> = order.iter().map(|&i| corners[i as usize]).collect();
            let mut looking = Looking { corners: &sorted, point, squared: f64::INFINITY };
            bvh.visit_from_front(&mut vec![], &Around(point), &mut looking);
            let least = corners.iter().map(alone).fold(f64::INFINITY, f64::min);
            prop_assert_eq!(looking.squared, least);
            for triangle in &corners {
                let sampled = points(triangle).map(|p| { let d = sub(p, point); dot(d, d).sqrt() });
                let (sampled, exact) = (sampled.fold(f64::INFINITY, f64::min), alone(triangle).sqrt());
                prop_assert!(exact <= sampled + 1e-9);
                // Points lie a fortieth of the longest edge apart.
                prop_assert!(exact >= sampled - size);
            }
        }
    }
}
