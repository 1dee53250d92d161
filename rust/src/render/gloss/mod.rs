//! Glossy surfaces: metal, plastic, varnish, glass and what is half opaque, without noise.
//!
//! ```text
//! a ray that sees a glossy triangle -> tracer: the lights in closed form, and rays along the pattern of its pixel
//!                                   -> finish: how the surface reflects them
//! ```
//!
//! - [`tables`]: which triangles are glossy, and all of the scene in colour.
//! - [`tracer`]: follows the paths; [`pattern`] says along which directions and to which points of the [`lamps`], whose points
//!   are dealt out to [`lamp_groups`].
//! - [`adaptive`]: how many of a pixel's rays are shaded.
//! - [`finish`]: reflectance. [`microfacets`]: of rough surfaces. [`coat`]: a second lobe above the first. [`sheen`]: that of cloth.
//!   [`flatness`]: light that goes below a surface.
//!   [`emissive`]: what surfaces emit by a texture. [`lookup`]: textures
//!   and light maps at single points.
//! - [`sky_levels`]: the environment map, from fine to coarse.
//! - [`number`]: float64 with or without its rate, so that luma and rates are one computation.
//!
//! Rays are followed one by one in float64, in scenes that have such surfaces, for as many of the rays that see them as a
//! pixel needs. All else is shaded in [`light`](super::light) as before.
//!
//! What must not break: scenes of diffuse surfaces have the same bits, in the same time, as without all this.

pub(super) mod adaptive;
pub(super) mod coat;
pub(super) mod emissive;
pub(super) mod finish;
mod flatness;
pub(super) mod frame_axes;
pub(crate) mod lamp_groups;
mod lamps;
pub(super) mod lookup;
pub(super) mod microfacets;
pub(super) mod number;
pub(super) mod pattern;
pub(super) mod sheen;
mod sky_levels;
pub(super) mod tables;
pub(super) mod tracer;

#[cfg(test)]
#[allow(
    clippy::cast_precision_loss,
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    reason = "small numbers"
)]
mod tests;
