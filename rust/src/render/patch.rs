//! Patches: boxes around what a part of the image shows of some triangles.

use super::bins::Seen;
use super::lights::Surroundings;
use super::linear::Rect;
use super::vector::{Bounds, Vector, add, largest, sub};
use super::view::View;

/// What roundings of an inverse depth amount to, by the sum of its parts.
const ROUNDING: f64 = 4e-7;

/// A box around what is seen of some triangles of one frame, in its coordinates.
#[derive(Clone, Copy, Debug)]
pub(super) struct Patch {
    pub(super) frame: usize,
    pub(super) bounds: Bounds,
    /// How large a part of the image is there, square metres.
    size: f64,
}

impl Patch {
    /// Of one triangle.
    pub(super) fn new(of: &Surroundings, seen: &Seen, part: &Rect) -> Self {
        let Surroundings { scene, view, .. } = *of;
        let frame = scene.surfaces[seen.triangle as usize].frame as usize;
        let pose = &view.poses[frame];
        let whole = Bounds::of(&scene.corners[seen.triangle as usize]);
        let (mut nearest, mut off) = (f64::INFINITY, 0.0f64);
        let mut points = [[0.0; 3]; 4];
        for (point, [x, y]) in points.iter_mut().zip(part.corners()) {
            let inverse = f64::from(seen.inverse_depth.at(x, y));
            if inverse <= 0.0 {
                return Self { frame, bounds: whole, size: 0.0 };
            }
            let depth = 1.0 / inverse;
            let ray = [f64::from(x) * depth, f64::from(y) * depth, depth];
            *point = add(pose.vector(ray), pose.position);
            nearest = nearest.min(depth);
            // A ray's depth is rounded with the parts that its inverse is the sum of.
            let [a, b, c] = seen.inverse_depth.0;
            let parts = f64::from((a * x).abs() + (b * y).abs() + c.abs());
            off = off.max(ROUNDING * parts * depth * largest(ray));
        }
        let seen = Bounds::of(&points);
        // Rounding may part them by a little where they touch.
        let slack =
            off + 1e-6 * (largest(whole.low).max(largest(whole.high)) + largest(seen.low).max(largest(seen.high)));
        let both = seen.grown(slack).within(&whole.grown(slack));
        let bounds = if (0..3).all(|i| both.low[i] <= both.high[i]) { both } else { whole.grown(slack) };
        let [width, height] = [0, 1].map(|axis| f64::from(part.high[axis] - part.low[axis]) * nearest);
        Self { frame, bounds, size: width * height }
    }

    /// This and another patch as one, where that is not much larger than the two.
    pub(super) fn with(&self, other: &Self) -> Option<Self> {
        let bounds = self.bounds.with(&other.bounds);
        let larger = bounds.half_area() > self.bounds.half_area() + other.bounds.half_area() + self.size;
        (self.frame == other.frame && !larger).then_some(Self { bounds, ..*self })
    }

    /// Its corners in camera axes.
    pub(super) fn corners(&self, view: &View) -> [Vector; 8] {
        let pose = &view.poses[self.frame];
        self.bounds.corners().map(|corner| pose.turned(sub(corner, pose.position)))
    }
}
