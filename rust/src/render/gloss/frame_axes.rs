//! Takes points and vectors from camera axes to those of a frame and back, with their rates.

use super::number::{Number, Triple, add, constant, cross, dot, rated, values};
use crate::render::geometry::view::Pose;

/// Returns an affine map at a point.
pub(crate) fn at_map<N: Number>(map: &[f64; 4], point: Triple<N>) -> N {
    dot(constant([map[0], map[1], map[2]]), point) + N::constant(map[3])
}

/// Returns a vector of camera axes in a frame.
pub(crate) fn into_frame<N: Number>(pose: &Pose, vector: Triple<N>) -> Triple<N> {
    let turning = if N::RATED { pose.vector(cross(pose.angular_rate, values(vector))) } else { [0.0; 3] };
    let rows = &pose.rotation;
    let along = [dot(constant(rows[0]), vector), dot(constant(rows[1]), vector), dot(constant(rows[2]), vector)];
    if N::RATED { add(along, rated([0.0; 3], turning)) } else { along }
}

/// Returns a point of camera axes in a frame.
pub(crate) fn point_in_frame<N: Number>(pose: &Pose, point: Triple<N>) -> Triple<N> {
    add(into_frame(pose, point), rated(pose.position, pose.velocity))
}

/// Returns a vector of a frame in camera axes.
pub(crate) fn from_frame<N: Number>(pose: &Pose, vector: Triple<N>) -> Triple<N> {
    let rows = &pose.rotation;
    let [x, y, z] = vector;
    let turned = [
        x.scaled(rows[0][0]) + y.scaled(rows[1][0]) + z.scaled(rows[2][0]),
        x.scaled(rows[0][1]) + y.scaled(rows[1][1]) + z.scaled(rows[2][1]),
        x.scaled(rows[0][2]) + y.scaled(rows[1][2]) + z.scaled(rows[2][2]),
    ];
    if N::RATED { add(turned, rated([0.0; 3], pose.turning(values(turned)))) } else { turned }
}
