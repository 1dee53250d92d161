//! Lamps as glossy surfaces see them: triangles that emit, and points on them by a pattern.
//!
//! Light of a lamp reaches a glossy surface in two ways: along the lobe's own directions, and along directions to points
//! on the lamps. Both are weighted by the balance heuristic (Veach and Guibas 1995), so that neither a small lamp nor a
//! sharp lobe is missed.
//!
//! A place on a surface deals its points out to the parts of all lamps by how much of their light it may reflect: a
//! strong lamp somewhere else, and backs of lamps, would take nearly all of them otherwise. Within a part, points are
//! dealt out by light alone.
//!
//! What must not break: the density of points is the one that they are chosen by.

use super::lamp_groups::{Group, GroupedLamps, Lamp, Part, area};
use crate::render::geometry::vector::Vector;

/// Of all of a place's points, the fraction that falls on each part or on parts before it; empty for a single part.
#[derive(Clone, Debug)]
pub(crate) struct Shares(Vec<f64>);

/// The lamps of a scene.
#[derive(Clone, Debug, Default)]
pub(crate) struct Lamps {
    groups: Vec<Group>,
    parts: Vec<Part>,
    /// Those of a part are side by side.
    triangles: Vec<u32>,
    /// Of all points on a triangle's part, the fraction that falls on it or on those before it.
    until: Vec<f64>,
    /// Of each triangle of the scene: its part, and how densely the points of that lie on it, as a fraction per square
    /// metre.
    densities: Vec<(u32, f64)>,
}

impl Lamps {
    /// Takes the triangles that emit; the more light one emits, the more of its part's points lie on it.
    pub(crate) fn new(corners: &[[Vector; 3]], lamps: impl IntoIterator<Item = Lamp>) -> Self {
        let GroupedLamps { lamps, parts, groups } = GroupedLamps::new(corners, lamps);
        let mut densities = vec![(0, 0.0); if lamps.is_empty() { 0 } else { corners.len() }];
        let mut until = vec![];
        for (part, number) in parts.iter().zip(0..) {
            let mut before = 0.0;
            for lamp in &lamps[part.lamps.clone()] {
                let fraction = lamp.power(corners) / part.power;
                before += fraction;
                until.push(before);
                densities[lamp.triangle as usize] = (number, fraction / area(&corners[lamp.triangle as usize]));
            }
        }
        Self { groups, parts, triangles: lamps.iter().map(|lamp| lamp.triangle).collect(), until, densities }
    }

    /// Returns whether there are none.
    pub(crate) fn is_empty(&self) -> bool {
        self.parts.is_empty()
    }

    /// Returns the shares of the parts of all lamps by the light that a place may reflect of each; None where that is none
    /// at all. `reflected` gives the place in a group's frame, and the fraction of the group's light there that it
    /// reflects.
    pub(crate) fn shares(&self, reflected: impl Fn(&Group) -> (Vector, f64)) -> Option<Shares> {
        if self.parts.len() == 1 {
            return Some(Shares(vec![]));
        }
        let mut sum = 0.0;
        let mut until: Vec<f64> = Vec::with_capacity(self.parts.len());
        for group in &self.groups {
            let (place, fraction) = reflected(group);
            for part in &self.parts[group.parts.clone()] {
                sum += if fraction > 0.0 { fraction * part.irradiance(place) } else { 0.0 };
                until.push(sum);
            }
        }
        for until in &mut until {
            *until /= sum;
        }
        (sum > 0.0).then_some(Shares(until))
    }

    /// Returns how densely points lie on a triangle, per square metre.
    pub(crate) fn density(&self, triangle: u32, shares: &Shares) -> f64 {
        match self.densities.get(triangle as usize) {
            Some(&(part, density)) if density > 0.0 => density * shares.of(part as usize).1,
            _ => 0.0,
        }
    }

    /// Returns the lamp's triangle and the point on it, in its frame, for a point of the unit square.
    pub(crate) fn point(&self, corners: &[[Vector; 3]], [x, y]: [f64; 2], shares: &Shares) -> (u32, Vector) {
        let part = shares.0.partition_point(|&until| until <= x).min(self.parts.len() - 1);
        let (before, share) = shares.of(part);
        let x = ((x - before) / share).clamp(0.0, 1.0);
        let own = self.parts[part].lamps.clone();
        let at = (own.start + self.until[own.clone()].partition_point(|&until| until <= x)).min(own.end - 1);
        let first = if at == own.start { 0.0 } else { self.until[at - 1] };
        let within = ((x - first) / (self.until[at] - first)).clamp(0.0, 1.0);
        let root = within.sqrt();
        let triangle = self.triangles[at];
        let [a, b, c] = corners[triangle as usize];
        let weights = [1.0 - root, root * (1.0 - y), root * y];
        (triangle, std::array::from_fn(|i| weights[0] * a[i] + weights[1] * b[i] + weights[2] * c[i]))
    }
}

impl Shares {
    /// Returns the fraction of points before a part, and its own.
    fn of(&self, part: usize) -> (f64, f64) {
        let before = if part == 0 { 0.0 } else { self.0[part - 1] };
        (before, self.0.get(part).map_or(1.0, |until| until - before))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lamp(triangle: u32, luma: f64) -> Lamp {
        Lamp { triangle, frame: 0, light: 0, normal: [0.0, 0.0, 1.0], luma }
    }

    /// Points lie evenly on each lamp, and as many on each as its part has and it emits light of that.
    #[test]
    fn points_follow_light() {
        // The first two that emit touch each other, the last is far from them.
        let corners = [
            [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]],
            [[9.0, 9.0, 9.0], [9.0, 8.0, 9.0], [9.0, 8.0, 8.0]],
            [[1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [1.0, 1.0, 0.0]],
            [[5.0, 0.0, 0.0], [6.0, 0.0, 0.0], [5.0, 1.0, 0.0]],
        ];
        let lamps = Lamps::new(&corners, [lamp(0, 1.0), lamp(1, 0.0), lamp(2, 12.0), lamp(3, 7.0)]);
        assert_eq!(lamps.parts.iter().map(|part| part.power).collect::<Vec<_>>(), [8.0, 3.5]);
        // Of the first part a quarter of the light comes from 2 square metres, the rest from a half.
        for (near, far) in [(0.5, 0.5), (0.25, 0.75), (1.0, 0.0)] {
            let place = [3.0, 1.0, 40.0];
            let [of_near, of_far] = [0, 1].map(|part| lamps.parts[part].irradiance(place));
            let reflected = |group: &Group| if group.parts.start == 0 { near / of_near } else { far / of_far };
            let shares = lamps.shares(|group| (place, reflected(group))).unwrap();
            let densities = [0, 1, 2, 3].map(|number| lamps.density(number, &shares));
            let expected = [near * 0.25 / 2.0, 0.0, near * 0.75 / 0.5, far / 0.5];
            assert!(densities.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{densities:?}");
            let (mut counts, mut mean, mut squared, mut beside) = ([0u32; 4], [0.0; 2], [0.0; 2], 0.0);
            let side = 64u32;
            for number in 0..side * side {
                let square = [number / side, number % side].map(|at| (f64::from(at) + 0.5) / f64::from(side));
                let (triangle, point) = lamps.point(&corners, square, &shares);
                counts[triangle as usize] += 1;
                if triangle == 0 {
                    for axis in 0..2 {
                        mean[axis] += point[axis];
                        squared[axis] += point[axis] * point[axis];
                    }
                }
                beside += if triangle == 2 { point[0] - 1.0 } else { 0.0 };
            }
            let expected = [near * 0.25, 0.0, near * 0.75, far].map(|fraction| fraction * f64::from(side * side));
            assert_eq!(counts.map(f64::from), expected);
            let count = f64::from(counts[0]);
            assert!(mean.iter().all(|x| (x / count - 2.0 / 3.0).abs() < 0.02), "{mean:?}");
            let beside = beside / f64::from(counts[2]);
            assert!((beside - 1.0 / 3.0).abs() < 0.01, "{beside}");
            assert!(squared.iter().all(|x| (x / count - 2.0 / 3.0).abs() < 0.03), "{squared:?}");
        }
        assert!(lamps.shares(|_| ([0.0; 3], 0.0)).is_none());
        assert!(Lamps::new(&corners, [lamp(0, 0.0)]).is_empty());
    }
}
