//! Lamps as glossy surfaces see them: triangles that emit, and points on them by a pattern.
//!
//! Light of a lamp reaches a glossy surface in two ways: along the lobe's own directions, and along directions to points
//! on the lamps. Both are weighted by the balance heuristic (Veach and Guibas 1995), so that neither a small lamp nor a
//! sharp lobe is missed.
//!
//! What must not break: the density of points is the one that they are chosen by.

use crate::render::geometry::vector::{Vector, cross, dot, sub};

/// A triangle that emits.
#[derive(Clone, Copy, Debug)]
struct Lamp {
    triangle: u32,
    /// Of all choices, the fraction that falls on it or on lamps before it.
    until: f64,
}

/// The lamps of a scene.
#[derive(Clone, Debug, Default)]
pub(crate) struct Lamps {
    lamps: Vec<Lamp>,
    /// Of each triangle, how densely points lie on it: a fraction of all points per square metre.
    densities: Vec<f64>,
}

impl Lamps {
    /// Takes the triangles that emit, by their luma; the more light one emits, the more points lie on it.
    pub(crate) fn new(corners: &[[Vector; 3]], luma: impl Fn(usize) -> f64) -> Self {
        let power = |number: usize| luma(number) * area(&corners[number]);
        let emitting: Vec<usize> = (0..corners.len()).filter(|&number| power(number) > 0.0).collect();
        let all: f64 = emitting.iter().map(|&number| power(number)).sum();
        let (mut lamps, mut before) = (vec![], 0.0);
        let mut densities = vec![0.0; if emitting.is_empty() { 0 } else { corners.len() }];
        for number in emitting {
            let fraction = power(number) / all;
            before += fraction;
            densities[number] = fraction / area(&corners[number]);
            #[allow(clippy::cast_possible_truncation, reason = "a scene has fewer than 2^30 triangles")]
            lamps.push(Lamp { triangle: number as u32, until: before });
        }
        Self { lamps, densities }
    }

    /// Returns whether there are none.
    pub(crate) fn is_empty(&self) -> bool {
        self.lamps.is_empty()
    }

    /// Returns how densely points lie on a triangle, per square metre.
    pub(crate) fn density(&self, triangle: u32) -> f64 {
        self.densities.get(triangle as usize).copied().unwrap_or(0.0)
    }

    /// Returns the lamp's triangle and the point on it, in its frame, for a point of the unit square.
    pub(crate) fn point(&self, corners: &[[Vector; 3]], [x, y]: [f64; 2]) -> (u32, Vector) {
        let at = self.lamps.partition_point(|lamp| lamp.until <= x).min(self.lamps.len() - 1);
        let lamp = self.lamps[at];
        let first = if at == 0 { 0.0 } else { self.lamps[at - 1].until };
        let within = ((x - first) / (lamp.until - first)).clamp(0.0, 1.0);
        let root = within.sqrt();
        let [a, b, c] = corners[lamp.triangle as usize];
        let weights = [1.0 - root, root * (1.0 - y), root * y];
        (lamp.triangle, std::array::from_fn(|i| weights[0] * a[i] + weights[1] * b[i] + weights[2] * c[i]))
    }
}

fn area(corners: &[Vector; 3]) -> f64 {
    let normal = cross(sub(corners[1], corners[0]), sub(corners[2], corners[0]));
    0.5 * dot(normal, normal).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points lie evenly on each lamp, and as many on each as it emits light.
    #[test]
    fn points_follow_light() {
        let corners = [
            [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]],
            [[9.0, 9.0, 9.0], [9.0, 8.0, 9.0], [9.0, 8.0, 8.0]],
            [[5.0, 0.0, 0.0], [6.0, 0.0, 0.0], [5.0, 1.0, 0.0]],
        ];
        let lamps = Lamps::new(&corners, |number| [1.0, 0.0, 12.0][number]);
        // A quarter of the light comes from 2 square metres, the rest from a half.
        assert_eq!([0, 1, 2].map(|number| lamps.density(number)), [0.25 / 2.0, 0.0, 0.75 / 0.5]);
        let (mut counts, mut mean, mut squared) = ([0u32; 3], [0.0; 2], [0.0; 2]);
        let side = 64u32;
        for number in 0..side * side {
            let square = [number / side, number % side].map(|at| (f64::from(at) + 0.5) / f64::from(side));
            let (triangle, point) = lamps.point(&corners, square);
            counts[triangle as usize] += 1;
            if triangle == 0 {
                for axis in 0..2 {
                    mean[axis] += point[axis];
                    squared[axis] += point[axis] * point[axis];
                }
            }
        }
        assert_eq!(counts, [side * side / 4, 0, 3 * side * side / 4]);
        let count = f64::from(counts[0]);
        assert!(mean.iter().all(|x| (x / count - 2.0 / 3.0).abs() < 0.01), "{mean:?}");
        assert!(squared.iter().all(|x| (x / count - 2.0 / 3.0).abs() < 0.02), "{squared:?}");
        assert!(Lamps::new(&corners, |_| 0.0).is_empty());
    }
}
