//! Luma over a short time: when edges pass rays, and the luma of those pixels meanwhile.

pub(super) mod edge_tracks;
pub(super) mod edges;
mod smooth_motion;
pub(super) mod tracks;
