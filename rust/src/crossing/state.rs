//! The engine's state as plain data, to be stored and restored.
//!
//! What must not break: it holds everything that decides which events come next. Python stores it with a version
//! number, so a change of its fields needs a new version.

use super::effects::Effects;
use super::parameters::CrossingParameters;
use crate::event::SensorSize;
use crate::readout::ReadoutState;

/// All that decides what an engine will do next. Row by row, one value a pixel; empty before the first frame.
#[derive(Clone, Debug, PartialEq)]
pub struct EngineState {
    /// The sensor.
    pub size: SensorSize,
    /// The parameters, thresholds as they were drawn.
    pub parameters: CrossingParameters,
    /// The effects that act beyond the thresholds.
    pub effects: Effects,
    /// The seed of all draws.
    pub seed: u64,
    /// The time of the last frame.
    pub t_us: Option<i64>,
    /// The last frame, of an engine that takes luma.
    pub luma: Vec<f32>,
    /// The last frame, of an engine that takes log intensity, or whose pixels are under effects.
    pub log_intensity: Vec<f64>,
    /// Whether `log_intensity` is that of luma, which the engine takes.
    pub takes_luma: bool,
    /// The last frame's rates of change per second, of an engine that interpolates by Hermite curves: of luma or of log
    /// intensity, whatever it takes.
    pub rate: Vec<f64>,
    /// `B`: log intensity where the pixel was memorised.
    pub base: Vec<f64>,
    /// `n_on`: ON events since.
    pub on: Vec<u32>,
    /// `n_off`: OFF events since.
    pub off: Vec<u32>,
    /// The time of the last event; -1 = none yet.
    pub last_event_us: Vec<i64>,
    /// What effects add, if the pixels are under effects.
    pub effect_state: Option<EffectState>,
    /// What the readout holds, where there is one.
    pub readout: Option<ReadoutState>,
}

/// What effects add to the state of pixels. What belongs to an effect that is off is empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EffectState {
    /// The time of the first frame.
    pub started_us: i64,
    /// What leaves the photoreceptors, where source followers filter that.
    pub photoreceptor: Vec<f64>,
    /// What leaves the last low-pass of each pixel.
    pub filtered: Vec<f64>,
    /// Microseconds from the last frame until the pixel is released; not finite where it is not held.
    pub held_us: Vec<f64>,
    /// The last cell of time in which shot noise was drawn, counted from the first frame.
    pub noise_cell: Vec<i64>,
    /// ln(luma + `log_eps`) at the cell's start.
    pub noise_log_light: Vec<f64>,
    /// Noise behind the photoreceptor at the cell's start, in log intensity.
    pub noise_photoreceptor: Vec<f64>,
    /// Noise behind the source follower there, which comparators see.
    pub noise_filtered: Vec<f64>,
    /// How far references have leaked by light, in log intensity.
    pub leaked: Vec<f64>,
    /// What the leak's jitter adds to a held pixel's reference at the end of its hold.
    pub leak_error: Vec<f64>,
    /// Microseconds from the last frame to the next event of each hot pixel, in raster order.
    pub hot_wait_us: Vec<f64>,
    /// The number of that event.
    pub hot_index: Vec<u64>,
}
