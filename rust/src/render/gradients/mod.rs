//! Derivatives of single pixels in float64: by time, pose, lights and texels.

mod framed_lights;
pub(super) mod pixel_gradients;
mod slopes;
mod texel_gradients;
