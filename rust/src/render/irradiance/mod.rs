//! Irradiance at places on surfaces, by rays: what is baked into light maps.
//!
//! ```text
//! lattice: points in the unit square, shifted from place to place
//!      -> emitters: light of lamps, the sky, and of small lights, towards a place
//!      -> sampler: the mean over the rays of each place; light that bounces is gathered, or traced along paths
//! ```
//!
//! - [`surfaces`]: what a ray hits: its reflectance, and the light that falls on it, if that is known.
//! - [`sampler`]: what Python calls.
//!
//! What must not break: the light at a place is a function of the scene, the place and the numbers of its samples. It
//! has the same bits on every processor, on any number of threads, and in any batch of places.

mod emitters;
mod lattice;
mod sampler;
mod surfaces;

pub use emitters::{AreaLamp, EnvironmentMap, GroupLight, SharpLight, SkyLight};
pub use sampler::{IrradianceSampler, PathRule, Place};
pub use surfaces::{ReflectedLight, SurfaceTables};
