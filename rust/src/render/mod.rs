//! The renderer: linear luma of diffuse triangles under direct or baked light, as a camera's rays see them.
//!
//! ```text
//! view -> bins: which triangles each tile of the image may see
//!      -> visibility: which of them each of its rays hits first
//!      -> shade: depth, texture, light and shadow of the rays of one triangle
//!      -> tile: the mean of each pixel's rays
//! ```
//!
//! Work is shared by many rays wherever that does not change a bit: triangles are set up once per view, tiles are
//! decided at their corners ([`linear`]), and the rays of one triangle are shaded together ([`sorted`], [`lanes`]).
//!
//! - Input: [`scene`] holds what is rendered, [`hierarchy`] finds its triangles, [`pixel_rays`] are the camera's rays,
//!   [`view`] is where the camera is and how it moves.
//! - Light: [`lights`], [`beam`], [`light_map`], [`sky`] and [`texture`].
//! - Shadows: [`shadows`] finds what lies between a [`patch`] and a light, as [`cone`]s, and [`cast`] the rays that see
//!   hidden points.
//! - Output: [`renderer`] is what the user sees, [`samples`] are single pixels.
//! - Over time: [`edges`] finds when edges pass rays, [`tracks`] the luma meanwhile, [`edge_tracks`] the pixels
//!   concerned, and [`smooth_motion`] the motion.
//! - Derivatives of single pixels in float64: [`gradients`] ([`first_hit`], [`slopes`], [`framed_lights`]) and
//!   [`texel_gradients`].
//!
//! What must not break: the same view gives the same bits in any batch, on any number of threads and on every
//! processor.

#![allow(clippy::many_single_char_names, reason = "coordinates and corners have such names")]
#![allow(clippy::needless_range_loop, reason = "loops over the lanes of several arrays become vector code")]
#![allow(clippy::float_cmp, reason = "ties are exact")]

mod beam;
mod bins;
mod cast;
mod cone;
mod edge_tracks;
mod edges;
mod first_hit;
mod framed_lights;
mod gradients;
mod hierarchy;
mod lanes;
mod light_map;
mod lights;
mod linear;
mod patch;
mod pixel_rays;
mod renderer;
mod samples;
mod scene;
mod shade;
mod shadows;
mod sky;
mod slopes;
mod smooth_motion;
mod sorted;
mod texel_gradients;
mod texture;
mod tile;
mod tracks;
mod vector;
mod view;
mod visibility;

pub use beam::Beam;
pub use edge_tracks::{EdgeTracks, TrackSettings};
#[cfg(feature = "python")]
pub use gradients::{BEFORE_LIGHTS, RayHit};
pub use light_map::{Emission, LightMapTables};
pub use pixel_rays::PixelRays;
pub use renderer::Renderer;
pub use scene::{Light, LightKind, Scene, SceneTables};
pub use sky::Sky;
pub use view::{Pose, View};
