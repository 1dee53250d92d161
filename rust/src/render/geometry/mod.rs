//! Vectors, linear functions over the image, boxes around triangles, and a camera's views and rays.

pub(super) mod bvh;
mod bvh_builder;
mod bvh_node;
pub(super) mod curve;
pub(super) mod linear;
pub(super) mod pixel_rays;
pub(super) mod sweep;
pub(super) mod vector;
pub(super) mod view;
