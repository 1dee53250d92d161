//! The engine that users see: it checks a frame, runs the pixels over it and sorts the events.
//!
//! What can be wrong with a frame is checked before any state changes, with two exceptions: the memory for events, whose
//! number is not known before ([`super::buffer`]), and bad values in a frame of ideal pixels, which are found while these
//! run, because reading the frame twice would cost time. A push that stops for one of these is undone. So a refused frame
//! leaves the engine as it was.
//!
//! Pixels are kept in one of three forms: for luma, for log intensity, and under effects. The first frame decides
//! which. Ideal pixels fed with luma need no logarithm for samples within reach of their mark.
//!
//! What must not break:
//! - Checks come before changes, or changes are undone.
//! - The same input gives the same bytes on any number of threads.

use rayon::ThreadPool;
use rayon::prelude::*;

use super::band::Interval;
use super::buffer::{Allowance, MOST_EVENTS, Stop, out_of_memory, refuse};
use super::core::{Core, Pixels, Push};
use super::effects::{EffectCore, Effects, ThresholdMismatch, mismatched};
use super::frame::Frame;
use super::level::Level;
use super::parameters::{CrossingParameters, Interpolation};
use super::record::NEVER;
use super::sample::Sample;
use crate::error::{Error, Result};
use crate::event::{Event, SensorSize};
use crate::order::TimeSort;
use crate::readout::Readout;
use crate::threads::Threads;

/// Values that one thread checks at a time.
const CHECKED_AT_A_TIME: usize = 1 << 16;

/// Fewer, and waking a thread costs more than it saves.
const PIXELS_PER_THREAD: usize = 1 << 17;

/// More threads than any sensor has work for.
pub const MOST_THREADS: usize = 1024;

/// Turns luma frames into events, by the crossing rule of an ideal event-camera pixel, or under [`Effects`].
///
/// Each pixel holds a reference `R = B + n_on C_on - n_off C_off` with integer counters, `B` being the log intensity of
/// the first frame, less a phase where [`super::StartPhase`] asks for one. Between two frames log intensity is
/// interpolated; an ON event falls each time it reaches `R + C_on`, an OFF event each time it reaches `R - C_off`,
/// stamped with the first microsecond tick at or after the crossing. With linear interpolation every decision is exact
/// for the given float64 log intensity.
///
/// A pixel may have 2^32 - 1 events of each polarity; the push that might exceed that is refused.
pub struct CrossingEngine {
    pub(super) size: SensorSize,
    pub(super) parameters: CrossingParameters,
    /// Of all pixels: to look for it at every frame would take as long as a quiet frame.
    least_threshold: f64,
    pub(super) effects: Effects,
    pub(super) seed: u64,
    /// None for one thread, which then is the caller's.
    threads: Option<Threads>,
    pub(super) t_us: Option<i64>,
    pub(super) samples: Samples,
    /// No counter of any pixel is larger.
    pub(super) largest_counter: u64,
    sort: TimeSort,
    /// A push that would make more is refused.
    most_events: u64,
    pub(super) readout: Option<Readout>,
}

/// The pixels, by what they are fed with; under effects, they say it by name.
pub(super) enum Samples {
    None,
    Luma(Core<f32>),
    Log(Core<f64>),
    Effects(Box<EffectCore>, &'static str),
}

/// A kind of sample, and where its pixels are kept.
pub(super) trait Feed: Sample {
    /// What it is, for people.
    const NAME: &'static str;

    fn core(samples: &mut Samples) -> Option<&mut Core<Self>>;

    fn wrap(core: Core<Self>) -> Samples;

    /// The pixels, if they are fed with this.
    fn pixels(samples: &mut Samples) -> Option<&mut dyn Pixels<Self>> {
        match samples {
            Samples::Effects(core, name) => (*name == Self::NAME).then_some(&mut **core),
            samples => Self::core(samples).map(|core| core as _),
        }
    }
}

impl Feed for f32 {
    const NAME: &'static str = "luma";

    fn core(samples: &mut Samples) -> Option<&mut Core<Self>> {
        if let Samples::Luma(core) = samples { Some(core) } else { None }
    }

    fn wrap(core: Core<Self>) -> Samples {
        Samples::Luma(core)
    }
}

impl Feed for f64 {
    const NAME: &'static str = "log intensity";

    fn core(samples: &mut Samples) -> Option<&mut Core<Self>> {
        if let Samples::Log(core) = samples { Some(core) } else { None }
    }

    fn wrap(core: Core<Self>) -> Samples {
        Samples::Log(core)
    }
}

impl CrossingEngine {
    /// An engine for a sensor; `threads = None` takes as many as pay on it, at most one a core.
    ///
    /// # Errors
    /// [`Error::Argument`] for a parameter out of range or an empty sensor.
    pub fn new(size: SensorSize, parameters: CrossingParameters, threads: Option<usize>) -> Result<Self> {
        Self::with_effects(size, parameters, &Effects::default(), 0, threads)
    }

    /// [`Self::new`] for a sensor that is not ideal. The same seed draws the same thresholds and the same noise.
    ///
    /// # Errors
    /// The same as for [`Self::new`], and [`Error::Argument`] for effects out of range.
    pub fn with_effects(
        size: SensorSize,
        parameters: CrossingParameters,
        effects: &Effects,
        seed: u64,
        threads: Option<usize>,
    ) -> Result<Self> {
        if size.pixels() == 0 {
            return Err(Error::Argument(format!(
                "the sensor must have at least one pixel, got {} x {}",
                size.width, size.height
            )));
        }
        effects.check()?;
        parameters.check(size)?;
        let parameters = mismatched(parameters, effects.threshold_mismatch, seed, size);
        parameters.check(size)?;
        let effects = Effects { threshold_mismatch: ThresholdMismatch::NONE, ..effects.clone() };
        if let Some(threads) = threads.filter(|threads| !(1..=MOST_THREADS).contains(threads)) {
            return Err(Error::Argument(format!("threads must lie in 1..{MOST_THREADS}, got {threads}")));
        }
        let cores = || std::thread::available_parallelism().map_or(1, usize::from);
        let threads = threads.unwrap_or_else(|| (size.pixels() / PIXELS_PER_THREAD).clamp(1, cores()));
        let readout = effects.readout.filter(|bus| !bus.is_neutral());
        Ok(Self {
            size,
            least_threshold: parameters.least_threshold(),
            parameters,
            readout: readout.map(|bus| Readout::new(size, bus, seed, effects.refractory_period_us)),
            effects,
            seed,
            threads: (threads > 1).then(|| Threads::start(threads)).transpose()?,
            t_us: None,
            samples: Samples::None,
            largest_counter: 0,
            sort: TimeSort::default(),
            most_events: MOST_EVENTS,
        })
    }

    /// The size of the sensor.
    #[must_use]
    pub fn size(&self) -> SensorSize {
        self.size
    }

    /// The thresholds, one for each pixel where they differ.
    #[must_use]
    pub fn parameters(&self) -> &CrossingParameters {
        &self.parameters
    }

    /// The effects that act beyond the thresholds, into which a mismatch was drawn.
    #[must_use]
    pub fn effects(&self) -> &Effects {
        &self.effects
    }

    /// The time of the last frame in microseconds, if there was one.
    #[must_use]
    pub fn t_us(&self) -> Option<i64> {
        self.t_us
    }

    /// Takes a frame of linear luma; puts the events since the frame before it into `events`.
    ///
    /// # Errors
    /// A frame of the wrong size, luma that is NaN, infinite or negative ([`Error::Argument`] with time and pixel), a
    /// time that is not after the last one ([`Error::Order`]), rates where there should be none or the reverse, sparse
    /// samples outside of the interval or before the first frame; more than 2^27 events in one push, or more than
    /// there is memory for ([`Error::Memory`]). The state is then as it was.
    pub fn push(&mut self, frame: Frame<'_, f32>, events: &mut Vec<Event>) -> Result<()> {
        self.take(frame, events)
    }

    /// [`Self::push`] of log intensity itself.
    ///
    /// # Errors
    /// The same as for [`Self::push`]. Log intensity must lie within +-746, the logarithms of all positive finite floats.
    pub fn push_log(&mut self, frame: Frame<'_, f64>, events: &mut Vec<Event>) -> Result<()> {
        self.take(frame, events)
    }

    /// The events that a readout still holds: requested by the last frame, stamped after it. None without a readout.
    pub fn flush(&mut self) -> Vec<Event> {
        self.readout.as_mut().map(Readout::flush).unwrap_or_default()
    }

    /// The number of events that the readout has dropped.
    #[must_use]
    pub fn dropped_events(&self) -> u64 {
        self.readout.as_ref().map_or(0, Readout::dropped)
    }

    /// How often a pixel reached a level before the readout had carried its last event and its reset was over.
    #[must_use]
    pub fn missed_events(&self) -> u64 {
        self.readout.as_ref().map_or(0, Readout::missed)
    }

    /// The reference `R` of each pixel in log intensity, row by row; NaN before the first frame, and where a refractory
    /// pixel is held. Under a limited bandwidth it is to be compared with the last low-pass's output.
    #[must_use]
    pub fn reference(&self) -> Vec<f64> {
        let value = |(i, level): (usize, Level)| level.exact(self.parameters.thresholds(i)).value();
        let values = |levels: Vec<Level>| levels.into_iter().enumerate().map(value).collect();
        match &self.samples {
            Samples::None => vec![f64::NAN; self.size.pixels()],
            Samples::Luma(core) => values(core.levels()),
            Samples::Log(core) => values(core.levels()),
            Samples::Effects(core, _) => core.reference(self.t_us.unwrap_or_default(), &self.parameters),
        }
    }

    /// The surface of active events: the time of each pixel's last event in microseconds, row by row; -1 = none yet.
    #[must_use]
    pub fn last_event_us(&self) -> Vec<i64> {
        match &self.samples {
            Samples::None => vec![NEVER; self.size.pixels()],
            Samples::Luma(core) => core.last_event_us(),
            Samples::Log(core) => core.last_event_us(),
            Samples::Effects(core, _) => core.last_event_us(),
        }
    }

    pub(super) fn take<S: Feed>(&mut self, frame: Frame<'_, S>, events: &mut Vec<Event>) -> Result<()> {
        let pool = self.threads.as_ref().map(Threads::pool).transpose()?;
        let pool = pool.as_deref();
        let at = self.check_frame(&frame)?;
        // Ideal pixels find bad values themselves.
        if S::core(&mut self.samples).is_none() {
            self.check_values(frame.samples, frame.t_us, pool)?;
        }
        if let Err(error) = self.check_interval(&frame, at) {
            S::check(frame.samples, self.size, frame.t_us)?;
            return Err(error);
        }
        let push = Push { frame, at, size: self.size, p: &self.parameters, pool };
        if let Some(pixels) = S::pixels(&mut self.samples) {
            run(pixels, &push, self.most_events, &mut self.sort, events)?;
        } else if self.t_us.is_none() {
            self.samples = if self.effects.change_the_pixel() {
                let core = EffectCore::new(&frame, self.size, push.p, &self.effects, self.seed, push.pool);
                Samples::Effects(Box::new(core), S::NAME)
            } else {
                S::wrap(Core::new(&frame, push.p, self.seed, push.pool))
            };
            events.clear();
        } else {
            return Err(Error::Argument(format!(
                "the first frame of this engine was of another kind: it cannot take {} now",
                S::NAME
            )));
        }
        if let Some(readout) = &mut self.readout {
            readout.pass(events, frame.t_us);
        }
        self.t_us = Some(frame.t_us);
        Ok(())
    }

    pub(super) fn levels(&self) -> Vec<Level> {
        match &self.samples {
            Samples::None => vec![],
            Samples::Luma(core) => core.levels(),
            Samples::Log(core) => core.levels(),
            Samples::Effects(core, _) => core.references().copied().collect(),
        }
    }

    pub(super) fn count_largest(&self) -> u64 {
        self.levels().into_iter().map(|level| level.on.max(level.off)).max().unwrap_or(0).into()
    }

    /// What can be wrong with a frame's shape and time. Returns the interval that it ends.
    fn check_frame<S: Sample>(&self, frame: &Frame<'_, S>) -> Result<Interval> {
        let Frame { t_us, samples, rate, .. } = *frame;
        let pixels = self.size.pixels();
        for (name, length) in [("a frame", Some(samples.len())), ("a rate of change", rate.map(<[S]>::len))] {
            if length.is_some_and(|length| length != pixels) {
                return Err(Error::Argument(format!(
                    "{name} must have {} x {} = {pixels} pixels, got {}",
                    self.size.width,
                    self.size.height,
                    length.unwrap_or_default()
                )));
            }
        }
        match (self.parameters.interpolation, rate) {
            (Interpolation::Hermite, None) => {
                return Err(Error::Argument("Hermite interpolation needs the rate of change with every frame".into()));
            }
            (Interpolation::Linear, Some(_)) => {
                return Err(Error::Argument("a rate of change was given, but interpolation is linear".into()));
            }
            _ => {}
        }
        if t_us < 0 {
            return Err(Error::Argument(format!("the time of a frame must be >= 0 us, got {t_us} us")));
        }
        let start_us = self.t_us.unwrap_or(t_us - 1);
        if t_us <= start_us {
            return Err(Error::Order(format!(
                "the time of a frame must be after the last one ({start_us} us), got {t_us} us"
            )));
        }
        let ticks = t_us - start_us;
        if ticks >= 1 << 53 {
            return Err(Error::Argument(format!(
                "two frames must be less than 2^53 us apart, got {start_us} us and {t_us} us"
            )));
        }
        Ok(Interval { start_us, ticks })
    }

    /// Refuses bad values.
    fn check_values<S: Sample>(&self, samples: &[S], t_us: i64, pool: Option<&ThreadPool>) -> Result<()> {
        let valid = match pool {
            None => S::all_valid(samples),
            Some(pool) => pool.install(|| samples.par_chunks(CHECKED_AT_A_TIME).all(S::all_valid)),
        };
        if valid { Ok(()) } else { S::check(samples, self.size, t_us) }
    }

    /// What can be wrong with what happens in the interval that a frame ends.
    fn check_interval<S: Sample>(&mut self, frame: &Frame<'_, S>, at: Interval) -> Result<()> {
        let sparse = frame.sparse;
        if !sparse.is_empty() {
            if self.t_us.is_none() {
                return Err(Error::Argument(
                    "the first frame can have no sparse samples: nothing lies before it".into(),
                ));
            }
            sparse.check(self.size, at.start_us, frame.t_us)?;
        }
        if self.t_us.is_some() {
            #[allow(clippy::cast_precision_loss, reason = "below 2^53")]
            self.effects.shot_noise.check_interval(at.ticks as f64)?;
        }
        self.check_counters(sparse.most_of_a_pixel(), at.ticks)
    }

    /// Counters must not overflow; whether one could is estimated from above, and counted only when it comes near.
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss,
        reason = "an estimate"
    )]
    fn check_counters(&mut self, sparse: usize, ticks: i64) -> Result<()> {
        // Log intensity spans less than 1500; a Hermite curve goes there and back, and so may each sparse sample.
        let ways = 2.0 + sparse as f64;
        let leaked = self.effects.leak.most_hz() * 1e-6 * ticks as f64;
        let most = (ways * 1500.0 / self.least_threshold + leaked) as u64 + 2;
        if self.largest_counter + most > u32::MAX.into() {
            self.largest_counter = self.count_largest();
            if self.largest_counter + most > u32::MAX.into() {
                return Err(Error::Argument(format!(
                    "a pixel has had {} events of one polarity; another interval could exceed the 2^32 - 1 that it can count",
                    self.largest_counter
                )));
            }
        }
        self.largest_counter += most;
        Ok(())
    }
}

/// Runs pixels over a frame and sorts their events: within the usual allowance, or else after these have been counted.
fn run<S: Sample>(
    pixels: &mut dyn Pixels<S>,
    push: &Push<'_, S>,
    most: u64,
    sort: &mut TimeSort,
    events: &mut Vec<Event>,
) -> Result<()> {
    let bad_value = || {
        let refused = S::check(push.frame.samples, push.size, push.frame.t_us);
        refused.and_then(|()| Err(Error::Argument(S::RULE.into())))
    };
    match attempt(pixels, push, most, Allowance::Usual, sort, events) {
        Ok(()) => return Ok(()),
        Err(Stop::BadValue) => return bad_value(),
        Err(Stop::Full | Stop::Narrow) => {}
    }
    if !S::all_valid(push.frame.samples) {
        return bad_value(); // one that comes after what was too much
    }
    let count = pixels.count(push);
    let (pixel_count, least, t_us) = (push.size.pixels(), push.p.least_threshold(), push.frame.t_us);
    if count > most {
        return Err(refuse(count, most, pixel_count, least, t_us));
    }
    attempt(pixels, push, most, Allowance::Counted, sort, events)
        .map_err(|_| out_of_memory(count, pixel_count, least, t_us))
}

/// Runs pixels over a frame and sorts their events; where that cannot be done, nothing is changed.
fn attempt<S: Sample>(
    pixels: &mut dyn Pixels<S>,
    push: &Push<'_, S>,
    most: u64,
    allowance: Allowance,
    sort: &mut TimeSort,
    events: &mut Vec<Event>,
) -> std::result::Result<(), Stop> {
    let made = pixels.advance(push, allowance).and_then(|()| {
        if pixels.event_count() > most && matches!(allowance, Allowance::Usual) {
            return Err(Stop::Full);
        }
        pixels.sort(push, sort, events).map_err(|_| Stop::Full)
    });
    match made {
        Ok(()) => pixels.settle(push),
        Err(_) => pixels.undo(push),
    }
    made
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::crossing::effects::{HotPixels, Leak, PhotoreceptorBandwidth, ShotNoise};
    use crate::crossing::frame::SparseSamples;
    use crate::crossing::parameters::Threshold;
    use crate::readout::ReadoutParameters;

    const SIZE: SensorSize = SensorSize { width: 70, height: 40 };

    fn effects() -> Effects {
        Effects {
            photoreceptor_bandwidth: PhotoreceptorBandwidth { hz: 300.0, source_follower_hz: 1e4 },
            refractory_period_us: 20.0,
            leak: Leak { rate_hz: 0.3, double_luma: 0.5, ..Effects::default().leak },
            shot_noise: ShotNoise { rms: 0.1, floor: 0.02, half_luma: 0.5, bandwidth_hz: 50.0 },
            hot_pixels: HotPixels { fraction: 0.1, rate_hz: 200.0, rate_spread: 0.5, least_cv: 0.05, most_cv: 0.5 },
            readout: Some(ReadoutParameters {
                events_per_s: 1e6,
                row_us: 0.5,
                latency_us: 1.0,
                jitter_us: 1.0,
                drop_after_us: None,
                by_columns: false,
            }),
            ..Effects::default()
        }
    }

    fn engine(effects: &Effects, interpolation: Interpolation, threads: usize) -> CrossingEngine {
        let parameters = CrossingParameters {
            contrast_threshold: Threshold::Uniform(0.05),
            contrast_threshold_off: Threshold::Uniform(0.07),
            interpolation,
            ..CrossingParameters::default()
        };
        CrossingEngine::with_effects(SIZE, parameters, effects, 3, Some(threads)).unwrap()
    }

    #[allow(clippy::cast_precision_loss, reason = "small")]
    fn frame(k: u32) -> Vec<f32> {
        (0..SIZE.pixels()).map(|i| 0.5 + 0.4 * (0.013 * i as f32 + 0.9 * k as f32).sin()).collect()
    }

    #[allow(clippy::cast_precision_loss, reason = "small")]
    fn rates(k: u32) -> Vec<f32> {
        (0..SIZE.pixels()).map(|i| 36.0 * (0.013 * i as f32 + 0.9 * k as f32).cos()).collect()
    }

    /// A push that makes too many events is refused with their number, and changes nothing: neither the state nor what
    /// comes after, with or without effects, on one thread or several. Builds without optimization try fewer of these.
    #[test]
    #[allow(clippy::cast_possible_truncation, reason = "small")]
    fn too_many_events_are_refused_and_change_nothing() {
        let (none, all) = (Effects::default(), effects());
        let (linear, cubic) = ((Interpolation::Linear, 1), (Interpolation::Hermite, 3));
        let cases = [(&none, linear), (&all, cubic), (&none, cubic), (&all, linear)];
        for (effects, (interpolation, threads)) in cases.into_iter().take(if cfg!(debug_assertions) { 2 } else { 4 }) {
            let (mut tried, mut spared) =
                (engine(effects, interpolation, threads), engine(effects, interpolation, threads));
            let pixel: Vec<u32> = (0..SIZE.pixels() as u32).step_by(3).collect();
            let (mut got, mut expected) = (vec![], vec![]);
            for k in 0..if cfg!(debug_assertions) { 3 } else { 6u32 } {
                let (samples, rates, t_us) = (frame(k), rates(k), i64::from(k) * 10_000);
                let (times, between) = (vec![t_us - 4000; pixel.len()], vec![0.3f32; pixel.len()]);
                let mut frame = Frame::new(t_us, &samples[..]);
                frame.rate = (interpolation == Interpolation::Hermite).then_some(&rates[..]);
                if k > 1 {
                    frame.sparse = SparseSamples { pixel: &pixel, t_us: &times, samples: &between };
                }
                spared.push(frame, &mut expected).unwrap();
                if k > 0 {
                    let before = tried.state();
                    tried.most_events = 100;
                    let error = tried.push(frame, &mut got).unwrap_err().to_string();
                    assert!(error.contains("2800 pixels") && error.contains("0.05"), "{error}");
                    assert_eq!(tried.state(), before, "{effects:?} {interpolation:?} frame {k}");
                    tried.most_events = MOST_EVENTS;
                }
                tried.push(frame, &mut got).unwrap();
                assert_eq!(got, expected, "{effects:?} {interpolation:?} frame {k}");
                assert_eq!(tried.state(), spared.state());
                assert_eq!(tried.last_event_us(), spared.last_event_us());
                assert!(k == 0 || got.len() > 1000, "the test wants events");
            }
        }
    }

    /// The count that a refusal tells is that of the events, but for one or two a pixel.
    #[test]
    fn the_count_is_near_the_events_made() {
        for interpolation in [Interpolation::Linear, Interpolation::Hermite] {
            let mut engine = engine(&Effects::default(), interpolation, 1);
            let mut events = vec![];
            for k in 0..5u32 {
                let (samples, rates) = (frame(k), rates(k));
                let mut frame = Frame::new(i64::from(k) * 10_000, &samples[..]);
                frame.rate = (interpolation == Interpolation::Hermite).then_some(&rates[..]);
                let counted = (k > 0).then(|| {
                    let at = Interval { start_us: i64::from(k - 1) * 10_000, ticks: 10_000 };
                    let push = Push { frame, at, size: SIZE, p: &engine.parameters, pool: None };
                    f32::pixels(&mut engine.samples).unwrap().count(&push)
                });
                engine.push(frame, &mut events).unwrap();
                if let Some(counted) = counted {
                    assert!(counted.abs_diff(events.len() as u64) <= 2, "{counted} {}", events.len());
                }
            }
        }
    }

    /// A frame with a bad value is refused for that value, whatever else is wrong with it: sparse samples, or more events
    /// than the usual allowance before the value is met.
    #[test]
    fn bad_values_are_told_before_what_else_is_wrong() {
        let parameters =
            CrossingParameters { contrast_threshold: Threshold::Uniform(1e-5), ..CrossingParameters::default() };
        let mut engine = CrossingEngine::new(SIZE, parameters, Some(1)).unwrap();
        let mut events = vec![];
        engine.push_log(Frame::new(0, &vec![0.0; SIZE.pixels()]), &mut events).unwrap();
        let before = engine.state();
        let mut spoiled = vec![0.5; SIZE.pixels()];
        spoiled[SIZE.pixels() - 1] = f64::NAN;
        let mut frame = Frame::new(1000, &spoiled[..]);
        for sparse in [
            SparseSamples { pixel: &[], t_us: &[], samples: &[] },
            SparseSamples { pixel: &[3], t_us: &[2000], samples: &[0.0] },
        ] {
            frame.sparse = sparse;
            let error = engine.push_log(frame, &mut events).unwrap_err().to_string();
            assert!(error.contains("(x, y) = (69, 39)") && error.contains("NaN"), "{error}");
            assert_eq!(engine.state(), before);
        }
    }

    #[test]
    fn threads_have_a_limit() {
        for threads in [0, MOST_THREADS + 1, usize::MAX] {
            let error = CrossingEngine::new(SIZE, CrossingParameters::default(), Some(threads)).err().unwrap();
            assert!(error.to_string().contains("threads must lie in 1..1024"), "{error}");
        }
    }
}
