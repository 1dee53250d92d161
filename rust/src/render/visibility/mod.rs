//! Which triangle a ray hits first: for the rays of a tile together, and for single rays in float64.

pub(super) mod beam;
pub(super) mod bins;
pub(super) mod first_hit;
pub(super) mod nearest;
mod set_up;
pub(super) mod sorted;
