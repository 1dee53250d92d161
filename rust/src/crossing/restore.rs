//! Stores an engine's state, and makes an engine from a stored state.
//!
//! What must not break: a restored engine gives the same events as the one that was stored. A stored state may come
//! from anywhere, so each entry is checked before it is used.

use super::engine::{CrossingEngine, Feed, Samples};
use super::frame::Frame;
use super::parameters::Interpolation;
use super::sample::Sample;
use super::start_phase::StartPhase;
use super::state::EngineState;
use crate::error::{Error, Result};
use crate::readout::Readout;

impl CrossingEngine {
    /// The state, to be stored.
    #[must_use]
    pub fn state(&self) -> EngineState {
        let levels = self.levels();
        let (luma, log_intensity, rate) = match &self.samples {
            Samples::None => (vec![], vec![], vec![]),
            Samples::Luma(core) => (core.last().to_vec(), vec![], core.rates().iter().map(|&r| r.into()).collect()),
            Samples::Log(core) => (vec![], core.last().to_vec(), core.rates().to_vec()),
            Samples::Effects(core, _) => {
                let (logs, slopes) = core.logs();
                (vec![], logs, slopes)
            }
        };
        let under_effects = if let Samples::Effects(core, name) = &self.samples { Some((core, *name)) } else { None };
        EngineState {
            size: self.size,
            parameters: self.parameters.clone(),
            effects: self.effects.clone(),
            seed: self.seed,
            t_us: self.t_us,
            luma,
            log_intensity,
            takes_luma: under_effects.is_some_and(|(_, name)| name == <f32 as Feed>::NAME),
            rate,
            base: levels.iter().map(|level| level.base).collect(),
            on: levels.iter().map(|level| level.on).collect(),
            off: levels.iter().map(|level| level.off).collect(),
            last_event_us: if levels.is_empty() { vec![] } else { self.last_event_us() },
            effect_state: under_effects.map(|(core, _)| core.state()),
            readout: self.readout.as_ref().map(Readout::state),
        }
    }

    /// An engine that goes on from a stored state as the one it was taken from would have.
    ///
    /// # Errors
    /// [`Error::Argument`] for a state that no engine can be in.
    pub fn from_state(state: &EngineState, threads: Option<usize>) -> Result<Self> {
        let mut engine = Self::with_effects(state.size, state.parameters.clone(), &state.effects, state.seed, threads)?;
        let Some(t_us) = state.t_us else { return Ok(engine) };
        let hermite = state.parameters.interpolation == Interpolation::Hermite;
        let lengths = [state.base.len(), state.on.len(), state.off.len(), state.last_event_us.len()];
        if lengths.iter().any(|&n| n != state.size.pixels()) {
            return Err(Error::Argument(format!(
                "a state of {} pixels must have as many values of base, on, off and last_event_us, got {lengths:?}",
                state.size.pixels()
            )));
        }
        // Behind a leak references lie wherever it has led them, under noise and at the start a threshold or two away.
        let wanders = state.effects.leak.is_on()
            || state.effects.shot_noise.is_on()
            || state.parameters.start_phase == StartPhase::Stationary;
        if !(if wanders { state.base.iter().all(|base| base.is_finite()) } else { f64::all_valid(&state.base) }) {
            let rule = if wanders { "be finite" } else { "lie within +-746" };
            return Err(Error::Argument(format!("the base of a state must {rule} in all pixels")));
        }
        let rate: Vec<f32>;
        if state.luma.is_empty() {
            let frame = Frame::new(t_us, &state.log_intensity[..]);
            engine.take(Frame { rate: hermite.then_some(&state.rate), ..frame }, &mut Vec::new())?;
        } else {
            #[allow(clippy::cast_possible_truncation, reason = "stored from float32")]
            {
                rate = state.rate.iter().map(|&r| r as f32).collect();
            }
            let frame = Frame::new(t_us, &state.luma[..]);
            engine.take(Frame { rate: hermite.then_some(&rate), ..frame }, &mut Vec::new())?;
        }
        match &mut engine.samples {
            Samples::None => {}
            Samples::Luma(_) | Samples::Log(_) if state.effect_state.is_some() => {
                return Err(Error::Argument("a state of ideal pixels must have no state of effects".into()));
            }
            Samples::Luma(core) => core.restore(state),
            Samples::Log(core) => core.restore(state),
            Samples::Effects(core, name) => {
                let Some(effects) = &state.effect_state else {
                    return Err(Error::Argument(
                        "a state of pixels under effects must have the state of their effects".into(),
                    ));
                };
                core.restore(state, effects)?;
                *name = if state.takes_luma { <f32 as Feed>::NAME } else { <f64 as Feed>::NAME };
            }
        }
        match (&mut engine.readout, &state.readout) {
            (None, None) => {}
            (Some(readout), Some(stored)) => readout.restore(stored, t_us)?,
            _ => {
                return Err(Error::Argument(
                    "a state must have a readout if its effects have one, and only then".into(),
                ));
            }
        }
        engine.largest_counter = engine.count_largest();
        Ok(engine)
    }
}
