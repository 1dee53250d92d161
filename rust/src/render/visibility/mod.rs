//! Which triangle a ray hits first: for the rays of a tile together, for single rays in float64, and for rays of any
//! direction; from which triangles rays hit nothing; and how far the nearest triangle is.

pub(super) mod beam;
pub(super) mod bins;
pub(super) mod distance;
pub(super) mod first_hit;
pub(super) mod nearest;
mod ray_cells;
pub(super) mod ray_tracer;
mod set_up;
pub(super) mod sorted;
pub(super) mod unoccluded;
