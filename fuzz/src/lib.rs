//! Fuzz targets of `davis_rs`; see README.md.

pub mod bodies;
pub mod seeds;
