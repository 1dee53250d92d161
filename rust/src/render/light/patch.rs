//! Patches: boxes around the points that a part of the image sees of one or several triangles.
//!
//! Shadows are searched for once per patch instead of once per ray.
//!
//! What must not break: the box contains each point as its ray finds it in float32, so it is larger by all roundings.

use super::lights::Surroundings;
use crate::render::geometry::linear::Rect;
use crate::render::geometry::vector::{Bounds, Vector, add, largest, sub};
use crate::render::geometry::view::{Pose, View};
use crate::render::visibility::bins::Seen;

/// What roundings of an inverse depth amount to, by the sum of its parts.
const ROUNDING: f64 = 4e-7;

/// A box around what is seen of some triangles of one frame, in its coordinates: it holds each point as its rays find
/// it in float32.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Patch {
    pub(crate) frame: usize,
    pub(crate) bounds: Bounds,
    /// How large a part of the image is there, square metres.
    size: f64,
}

impl Patch {
    /// Returns the patch of one triangle.
    pub(crate) fn new(surroundings: &Surroundings, seen: &Seen, rect: &Rect) -> Self {
        let Surroundings { scene, view, .. } = *surroundings;
        let frame = scene.surfaces[seen.triangle as usize].frame as usize;
        let pose = &view.poses[frame];
        let corners = &scene.corners[seen.triangle as usize];
        let whole = Bounds::of(corners);
        let (mut nearest, mut off) = (f64::INFINITY, 0.0f64);
        let mut points = [[0.0; 3]; 4];
        for (point, [x, y]) in points.iter_mut().zip(rect.corners()) {
            let inverse = f64::from(seen.inverse_depth.at(x, y));
            if inverse <= 0.0 {
                let bounds = whole.grown(off_by_the_farthest(seen, rect, pose, corners) + 1e-6 * reach(&whole));
                return Self { frame, bounds, size: 0.0 };
            }
            let depth = 1.0 / inverse;
            let ray = [f64::from(x) * depth, f64::from(y) * depth, depth];
            *point = add(pose.vector(ray), pose.position);
            nearest = nearest.min(depth);
            off = off.max(ROUNDING * magnitude(seen, x, y) * depth * largest(ray));
        }
        let seen = Bounds::of(&points);
        // Rounding may part them by a little where they touch.
        let slack = off + 1e-6 * (reach(&whole) + reach(&seen));
        let both = seen.grown(slack).within(&whole.grown(slack));
        let bounds = if (0..3).all(|i| both.low[i] <= both.high[i]) { both } else { whole.grown(slack) };
        let [width, height] = [0, 1].map(|axis| f64::from(rect.high[axis] - rect.low[axis]) * nearest);
        Self { frame, bounds, size: width * height }
    }

    /// Returns this and another patch as one, where that is not much larger than the two.
    pub(crate) fn with(&self, other: &Self) -> Option<Self> {
        let bounds = self.bounds.with(&other.bounds);
        let larger = bounds.half_area() > self.bounds.half_area() + other.bounds.half_area() + self.size;
        (self.frame == other.frame && !larger).then_some(Self { bounds, ..*self })
    }

    /// Returns its corners in camera axes.
    pub(crate) fn corners(&self, view: &View) -> [Vector; 8] {
        let pose = &view.poses[self.frame];
        self.bounds.corners().map(|corner| pose.turned(sub(corner, pose.position)))
    }
}

/// Returns the largest coordinate.
fn reach(bounds: &Bounds) -> f64 {
    largest(bounds.low).max(largest(bounds.high))
}

/// Returns the sum of the magnitudes of what an inverse depth is the sum of: a ray's depth is rounded with them.
fn magnitude(seen: &Seen, x: f32, y: f32) -> f64 {
    let [a, b, c] = seen.inverse_depth.0;
    f64::from((a * x).abs() + (b * y).abs() + c.abs())
}

/// Returns how far off a point may be that a part of the image sees of a triangle, where the part reaches to the
/// horizon of the triangle's plane: as far as if all of it were as far away as the farthest corner.
fn off_by_the_farthest(seen: &Seen, rect: &Rect, pose: &Pose, corners: &[Vector; 3]) -> f64 {
    let depth = corners.iter().fold(0.0f64, |most, &corner| most.max(pose.turned(sub(corner, pose.position))[2]));
    rect.corners().iter().fold(0.0, |most: f64, &[x, y]| {
        let ray = [f64::from(x) * depth, f64::from(y) * depth, depth];
        most.max(ROUNDING * magnitude(seen, x, y) * depth * largest(ray))
    })
}

#[cfg(test)]
mod tests {
    use super::super::shadows::ToFrame;
    use super::*;
    use crate::render::geometry::vector::cross;
    use crate::render::scene::{Scene, SceneTables};
    use crate::render::visibility::bins::Bins;
    use proptest::prelude::*;

    /// Looks along a heading, and down by a pitch.
    fn looking([heading, pitch]: [f64; 2]) -> [[f64; 3]; 3] {
        let forward = [heading.cos() * pitch.cos(), heading.sin() * pitch.cos(), -pitch.sin()];
        let right = [heading.sin(), -heading.cos(), 0.0];
        let down = cross(forward, right);
        std::array::from_fn(|i| [right[i], down[i], forward[i]])
    }

    /// Returns a scene of one triangle, which lies level at a height.
    fn level(corners: [[f64; 2]; 3], height: f64) -> Scene {
        let corners = corners.map(|[x, y]| [x, y, height]);
        let tables = SceneTables {
            corners: vec![corners].into(),
            planes: vec![[0.0, 0.0, 1.0, -height]].into(),
            u_maps: vec![[0.0; 4]].into(),
            v_maps: vec![[0.0; 4]].into(),
            textures: vec![0],
            two_sided: vec![true],
            frames: vec![0],
            frame_count: 1,
            layouts: vec![[0, 1, 1, 0]],
            texels: vec![vec![0.5; 9].into()],
            end: 0.999,
            ..SceneTables::default()
        };
        Scene::new(&tables).unwrap()
    }

    proptest! {
        /// A level triangle's box has no thickness but for roundings, so that a point which is off by more lies
        /// outside. Near the horizon, at the triangle's corners and from far, points are off by most.
        #[test]
        #[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
        #[allow(clippy::cast_precision_loss, reason = "small numbers")]
        fn every_place_lies_in_its_patch(
            corners in prop::array::uniform3(prop::array::uniform2(-3.0..3.0)), stretch in prop::sample::select(vec![1.0, 100.0]),
            aside in prop::sample::select(vec![0.0, 200.0]),
            height in -2.0..2.0, heading in 0.0..6.3, pitch in prop::sample::select(vec![0.01, 0.1, 0.7]),
            away in prop::sample::select(vec![0.7, 3.0, 3000.0]), scale in prop::sample::select(vec![1e-3, 1.0, 1e4]),
            left in -0.4f32..0.2, below in prop::sample::select(vec![-0.02, 1e-3, 0.01, 0.1, 0.5]),
            size in prop::sample::select(vec![0.01f32, 0.1, 0.5]),
        ) {
            let corners = corners.map(|[x, y]| [scale * (stretch * x + aside), scale * stretch * y]);
            let scene = level(corners, scale * height);
            let rotation = looking([heading, pitch]);
            // The camera looks at the middle of the triangle.
            let middle: [f64; 2] = [0, 1].map(|axis| corners.iter().map(|corner| corner[axis]).sum::<f64>() / 3.0);
            let middle = [middle[0], middle[1], scale * height];
            let position = std::array::from_fn(|i| middle[i] - scale * away * rotation[i][2]);
            let pose = Pose { position, rotation, velocity: [0.0; 3], angular_rate: [0.0; 3] };
            let view = View { poses: vec![pose], factors: vec![] };
            // Below the horizon, or with it inside; from far around the triangle.
            let at = if away > 100.0 { [-0.5 * size; 2] } else { [left, (below - pitch.tan()) as f32] };
            let mut rect = Rect::NONE;
            rect.add(at[0], at[1]);
            rect.add(at[0] + size, at[1] + size);
            let mut bins = Bins::default();
            bins.fill_rect(&scene, &view, &rect);
            let mut rays: Vec<[f32; 2]> =
                (0..64).map(|i| [at[0] + size * ((i / 8) as f32 / 7.0), at[1] + size * ((i % 8) as f32 / 7.0)]).collect();
            rays.extend(rect.corners());
            for corner in &scene.corners[0] {
                let [x, y, z] = pose.turned(sub(*corner, position));
                let [x, y] = [(x / z) as f32, (y / z) as f32];
                let near = |x: f32| [x.next_down().next_down(), x.next_down(), x, x.next_up(), x.next_up().next_up()];
                rays.extend(near(x).iter().flat_map(|&x| near(y).map(|y| [x, y])));
            }
            let surroundings = Surroundings { scene: &scene, view: &view, lights: &[], still: &vec![], moving: &[] };
            let to_frame = ToFrame::new(&pose);
            for seen in &bins.seen {
                let patch = Patch::new(&surroundings, seen, &rect).bounds;
                for &[x, y] in &rays {
                    let within = (rect.low[0]..=rect.high[0]).contains(&x) && (rect.low[1]..=rect.high[1]).contains(&y);
                    let inverse = seen.inverse_depth.at(x, y);
                    if !within || inverse <= 0.0 || seen.edges.iter().any(|edge| edge.at(x, y) < 0.0) {
                        continue;
                    }
                    let depth = 1.0 / inverse;
                    let point = to_frame.point(x * depth, y * depth, depth).map(f64::from);
                    let inside = (0..3).all(|i| patch.low[i] <= point[i] && point[i] <= patch.high[i]);
                    prop_assert!(inside, "{point:?} in {patch:?}");
                }
            }
        }
    }
}
