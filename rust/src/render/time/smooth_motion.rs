//! Smooth motion: how cameras, bodies and lights move through a short span, along parabolas through three views.
//!
//! Rates are those of the parabolas, not of the views. A span may begin or end at a corner of the motion, where a
//! view's own rate may belong to the other side.
//!
//! What must not break: at the three views, the motion goes through them.

use super::tracks::{INSTANTS, Span};
use crate::render::geometry::view::{Pose, View};

/// Parabolas through the views at a span's ends and in its middle.
///
/// Rates are those of the parabolas, because a span may begin or end where motion or light has a corner: there a view's
/// own rates may be those of the other side.
pub(crate) struct SmoothMotion<'a> {
    views: [&'a View; 3],
    middle: f64,
    length_s: f64,
}

impl<'a> SmoothMotion<'a> {
    pub(crate) fn new(views: [&'a View; 3], span: Span) -> Self {
        #[allow(clippy::cast_precision_loss, reason = "spans are short")]
        let length_s = (span.t_us[INSTANTS - 1] - span.t_us[0]) as f64 * 1e-6;
        Self { views, middle: span.middle(), length_s }
    }

    /// The view at a fraction of the span.
    pub(crate) fn at(&self, fraction: f64) -> View {
        let weights = self.weights(fraction);
        let mut view = self.views[1].clone();
        for (frame, pose) in view.poses.iter_mut().enumerate() {
            pose.position = std::array::from_fn(|i| self.mixed(weights, |view| view.poses[frame].position[i]));
            pose.rotation = self.rotation(weights, frame);
        }
        for (light, factor) in view.factors.iter_mut().enumerate() {
            factor[0] = self.mixed(weights, |view| view.factors[light][0]);
        }
        self.with_rates(view, fraction)
    }

    /// A view at a fraction of the span, with the rates that there are.
    pub(crate) fn with_rates(&self, mut view: View, fraction: f64) -> View {
        let weights = self.slopes(fraction);
        for (frame, pose) in view.poses.iter_mut().enumerate() {
            pose.velocity = std::array::from_fn(|i| self.mixed(weights, |view| view.poses[frame].position[i]));
            pose.angular_rate = angular_rate(pose, self.rotation(weights, frame));
        }
        for (light, factor) in view.factors.iter_mut().enumerate() {
            factor[1] = self.mixed(weights, |view| view.factors[light][0]);
        }
        view
    }

    fn rotation(&self, weights: [f64; 3], frame: usize) -> [[f64; 3]; 3] {
        std::array::from_fn(|row| {
            std::array::from_fn(|i| self.mixed(weights, |view| view.poses[frame].rotation[row][i]))
        })
    }

    fn mixed(&self, weights: [f64; 3], of: impl Fn(&View) -> f64) -> f64 {
        weights.iter().zip(self.views).map(|(weight, view)| weight * of(view)).sum()
    }

    fn weights(&self, fraction: f64) -> [f64; 3] {
        let middle = self.middle;
        [
            (fraction - middle) * (fraction - 1.0) / middle,
            fraction * (fraction - 1.0) / (middle * (middle - 1.0)),
            fraction * (fraction - middle) / (1.0 - middle),
        ]
    }

    /// What the weights change by in a second.
    fn slopes(&self, fraction: f64) -> [f64; 3] {
        let middle = self.middle;
        let in_share = [
            (2.0 * fraction - middle - 1.0) / middle,
            (2.0 * fraction - 1.0) / (middle * (middle - 1.0)),
            (2.0 * fraction - middle) / (1.0 - middle),
        ];
        in_share.map(|slope| slope / self.length_s)
    }
}

/// In camera axes, from how fast the rotation changes.
fn angular_rate(pose: &Pose, change: [[f64; 3]; 3]) -> [f64; 3] {
    let turning = |i: usize, k: usize| (0..3).map(|row| pose.rotation[row][i] * change[row][k]).sum::<f64>();
    [turning(2, 1), turning(0, 2), turning(1, 0)]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A camera that turns and flies along parabolas is where they say, with their rates, whatever its views say of these.
    #[test]
    fn rates_are_those_of_the_motion() {
        let span = Span { t_us: [0, 100, 190, 300, 400] };
        let at = |t_s: f64| {
            let (sine, cosine) = (30.0 * t_s).sin_cos();
            let pose = Pose {
                position: [3.0 * t_s, 1.0 - 500.0 * t_s * t_s, 0.2],
                rotation: [[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]],
                velocity: [3.0, -1000.0 * t_s, 0.0],
                angular_rate: [0.0, 0.0, 30.0],
            };
            View { poses: vec![pose], factors: vec![[1.0 + 70.0 * t_s, 70.0]] }
        };
        let mut views = [at(0.0), at(190e-6), at(400e-6)];
        views[2].poses[0].velocity = [9e9; 3];
        views[2].factors[0][1] = 1e12;
        let motion = SmoothMotion::new([&views[0], &views[1], &views[2]], span);
        for t_s in [0.0, 100e-6, 333e-6, 400e-6] {
            let (found, true_one) = (motion.at(t_s / 400e-6), at(t_s));
            let numbers = |view: &View| {
                let pose = &view.poses[0];
                let of_pose = [pose.position, pose.velocity, pose.angular_rate].concat();
                [of_pose, pose.rotation.concat(), view.factors[0].to_vec()].concat()
            };
            for (one, other) in numbers(&found).iter().zip(numbers(&true_one)) {
                assert!((one - other).abs() < 1e-3 * other.abs().max(1.0), "{t_s}: {one} is not {other}");
            }
            let near = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6);
            assert!(near(found.poses[0].position, true_one.poses[0].position));
            assert!(near(found.poses[0].rotation[0], true_one.poses[0].rotation[0]));
        }
    }
}
