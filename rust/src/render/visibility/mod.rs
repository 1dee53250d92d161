//! Which triangle a ray hits first: for the rays of a tile together, and for single rays in float64.

pub(super) mod beam;
pub(super) mod bins;
pub(super) mod first_hit;
mod leaf;
pub(super) mod nearest;
pub(super) mod sorted;
