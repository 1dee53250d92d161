//! Line samples: a pixel's integral over its area without jumps.
//!
//! Parallel lines, a little tilted, pass through the image. Along each of them the nearest triangle is found exactly,
//! from edge to edge ([`envelope`]); what a pixel's cell ([`pattern`]) sees of a triangle is shaded at one tap, whose
//! weight is the length that is seen ([`taps`]). So luma moves evenly while an edge passes, where a mean over rays jumps.
//!
//! Taps take the place of rays in [`tile`](super::tile): lights, textures and sky are the same code. Edges of shadows are
//! found on lines too ([`shadows`]): a tap has the fraction of a light that reaches its length, which moves evenly.
//!
//! How a tile lies in undistorted coordinates is one trait ([`warp`]). Without distortion lines are straight there. Behind a
//! lens with distortion they are curves ([`curved`]): what is linear in undistorted coordinates is cubic along a line.
//! Lines are straight on the sensor in both cases, so areas of pixels need no correction.
//!
//! What must not break: a pixel's taps depend on its view alone. A tile is always done as a whole, and its triangles are
//! looked at in one order.

pub(super) mod curved;
pub(super) mod envelope;
mod intervals;
pub(super) mod pattern;
pub(super) mod shadows;
pub(super) mod taps;
pub(super) mod warp;
