//! Events as images, the hot part of it: counts, last times, voxel grids and spike tensors.
//!
//! Each is one pass over the events, without threads, so that the same events give the same bits everywhere. Which
//! image is made of them is decided in Python (`davis_rs.represent`).

mod cell;
mod counts;
mod latest;
mod spike_tensor;
mod time_bins;
mod voxel;

pub use counts::count_events;
pub use latest::latest_times;
pub use spike_tensor::{Measurement, spike_tensor};
pub use time_bins::TimeBins;
pub use voxel::voxel_grid;
