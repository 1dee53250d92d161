//! The engine's state laid open, to be stored and taken up again.

use super::parameters::CrossingParameters;
use crate::event::SensorSize;

/// All that decides what an engine will do next. Row by row, one value a pixel; empty before the first frame.
#[derive(Clone, Debug, PartialEq)]
pub struct EngineState {
    /// The sensor.
    pub size: SensorSize,
    /// The parameters.
    pub parameters: CrossingParameters,
    /// The time of the last frame.
    pub t_us: Option<i64>,
    /// The last frame, of an engine that takes luma.
    pub luma: Vec<f32>,
    /// The last frame, of an engine that takes log intensity.
    pub log_intensity: Vec<f64>,
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
}
