//! Events as images, the hot part of it: counts, last times and voxel grids.
//!
//! Each is one pass over the events, without threads, so that the same events give the same bits everywhere. Which
//! image is made of them is decided in Python (`davis_rs.represent`).

mod cell;
mod counts;
mod latest;
mod voxel;

pub use counts::count_events;
pub use latest::latest_times;
pub use voxel::{TimeBins, voxel_grid};
