//! The hot code of `davis_rs`, a simulator of the DAVIS event camera.
//!
//! ```text
//! luma frames -> crossing::CrossingEngine -> [Event] -> EventWriter -> events.txt, ...
//!   USB bytes -> aer::Decoder -------------> [Event]
//! events.txt, ... -> EventReader ----------> [Event]
//! ```
//!
//! Linear luma frames go in, one after the other; out come events stamped to the microsecond wherever the log
//! intensity of a pixel crosses one of its levels, sorted and independent of the number of threads. Everything meets
//! at [`Event`]. The Python bindings (feature `python`) are a thin layer on top and the only place that knows them.

pub mod aer;
mod blur;
mod columns;
mod crossing;
mod error;
mod event;
mod exact;
mod filter;
mod huge_pages;
mod ktx2;
mod log_intensity;
mod meshopt;
mod order;
mod prefetch;
mod random;
mod read;
mod readout;
mod render;
mod represent;
mod ros;
mod threads;
mod write;

#[cfg(feature = "python")]
mod python;

pub use blur::blur_3x3;
pub use columns::fill_events;
pub use crossing::{
    CrossingEngine, CrossingParameters, EffectState, Effects, EngineState, Frame, HotPixels, Interpolation, Leak,
    MOST_THREADS, PhotoreceptorBandwidth, ShotNoise, SparseSamples, StartPhase, Threshold, ThresholdMismatch,
    reconstruct,
};
pub use error::{Error, Result};
pub use event::{Event, SensorSize};
pub use filter::{EventFilter, FilterRule};
pub use ktx2::{Ktx2, Transfer as Ktx2Transfer};
pub use log_intensity::{log_intensity, log_intensity_frame};
pub use meshopt::{MeshoptFilter, MeshoptMode, decode_meshopt};
pub use read::{
    Aedat4Decoder, Aedat4Frame, Aedat4Imu, Aedat4Kind, Aedat4Piece, Aedat4Recording, Aedat4Trigger, Block, Decode,
    DecoderState, EventReader, Evt2Decoder, Evt3Decoder, Evt21Decoder, MAX_PACKET_BYTES, TextDecoder, decode_ecf,
};
pub use readout::{ReadoutParameters, ReadoutState};
pub use render::{
    AreaLamp, Beam, Channel, ColourImage, Emission, EnvironmentMap, GroupLight, IrradianceSampler, Light, LightKind,
    LightMapTables, PathRule, PixelRays, Pose, ReflectedLight, Renderer, Scene, SceneTables, SharpLight, Sky, SkyLight,
    SurfacePoint, SurfaceTables, TextureColours, VectorMapTables, View,
};
pub use represent::{Measurement, TimeBins, count_events, latest_times, spike_tensor, voxel_grid};
pub use ros::{EventMessage, LATEST_US as ROS_LATEST_US, pack_events, packed_size, unpack_events};
pub use write::{Aedat4Encoder, Compression, Encode, EventWriter, Evt2Encoder, Evt3Encoder, Limits, TextEncoder};
