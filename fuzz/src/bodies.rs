//! What every input is put through: shared by the fuzz targets and by `tests/fuzz_bodies.rs`.
//!
//! No input may panic. What comes out must not depend on how the input is cut into pieces, and there must not be more of
//! it than the input can hold.

use std::io::Read;

use davis_rs::aer::{Chip, Decoded, Decoder, Device};
use davis_rs::{
    Aedat4Decoder, CrossingEngine, CrossingParameters, Decode, Effects, EngineState, Event, EventReader, Evt2Decoder,
    Evt3Decoder, Evt21Decoder, Frame, HotPixels, Interpolation, Ktx2, Leak, MeshoptFilter, MeshoptMode,
    PhotoreceptorBandwidth, ReadoutParameters, SensorSize, ShotNoise, StartPhase, TextDecoder, Threshold,
    decode_meshopt,
};

/// The stream of a camera: the first byte says which, the second one where it is cut.
pub fn aer(data: &[u8]) {
    const CHIPS: [Chip; 4] = [Chip::Davis240C, Chip::Davis346B, Chip::Davis128, Chip::Davis640];
    let [chip, cut, stream @ ..] = data else { return };
    let device = Device::new(CHIPS[usize::from(*chip) % CHIPS.len()]);
    let size = device.size();
    let decode = |piece: usize| {
        let (mut decoder, mut output) = (Decoder::new(device.clone()).expect("a known chip"), Decoded::default());
        stream.chunks(piece).for_each(|piece| decoder.push(piece, &mut output));
        (output, decoder.stats().clone())
    };
    let (output, stats) = decode(usize::MAX);
    assert!((&output, &stats) == (&decode(1 + usize::from(*cut)).0, &decode(1 + usize::from(*cut)).1), "pieces differ");
    assert!(output.events.len() <= stream.len() / 2, "more events than words");
    assert!(output.events.iter().all(|event| event.x < size.width && event.y < size.height && event.p <= 1));
    assert!(output.frames.len() <= stream.len() / 2, "more frames than words");
    assert!(output.frames.iter().all(|frame| frame.pixels.len() == frame.region.pixels()));
}

/// events.txt; the first byte says where it is cut, here and for the formats below.
pub fn text(data: &[u8]) {
    let events = file(data, TextDecoder::new);
    // The shortest line: "0.0 0 0 0\n", of which the last one may lack its end.
    assert!(10 * events.len() <= data.len() + 10, "more events than lines");
    assert!(events.is_sorted_by_key(|event| event.t));
}

/// EVT 2.0.
pub fn evt2(data: &[u8]) {
    assert!(4 * file(data, Evt2Decoder::new).len() <= data.len(), "more events than words");
}

/// EVT 2.1.
pub fn evt21(data: &[u8]) {
    // A word of eight bytes makes 32 events.
    assert!(file(data, Evt21Decoder::new).len() <= 4 * data.len(), "more events than words hold");
}

/// EVT 3.0.
pub fn evt3(data: &[u8]) {
    // A vector word makes 12 events of two bytes.
    assert!(file(data, Evt3Decoder::new).len() <= 6 * data.len(), "more events than words hold");
}

/// AEDAT 4.0.
pub fn aedat4(data: &[u8]) {
    file(data, Aedat4Decoder::default);
}

/// A compressed buffer view of a glTF file; the first bytes say what it holds, how many elements, and their size.
pub fn meshopt(data: &[u8]) {
    const MODES: [MeshoptMode; 7] = [
        MeshoptMode::Attributes(MeshoptFilter::None),
        MeshoptMode::Attributes(MeshoptFilter::Octahedral),
        MeshoptMode::Attributes(MeshoptFilter::Quaternion),
        MeshoptMode::Attributes(MeshoptFilter::Exponential),
        MeshoptMode::Attributes(MeshoptFilter::Colour),
        MeshoptMode::Triangles,
        MeshoptMode::Indices,
    ];
    let [mode, count, stride, view @ ..] = data else { return };
    let mode = MODES[usize::from(*mode) % MODES.len()];
    let (count, stride) = (3 * usize::from(*count), 2 * usize::from(*stride));
    let Ok(elements) = decode_meshopt(view, mode, count, stride) else { return };
    assert_eq!(elements.len(), count * stride);
    // Two bits say that 256 bytes are those of the element before.
    assert!(elements.len() <= 1024 * view.len(), "more elements than blocks hold");
    let tail = match mode {
        MeshoptMode::Attributes(_) if view[0] == 0xa1 => (stride + stride / 4).max(24),
        MeshoptMode::Attributes(_) => stride.max(32),
        MeshoptMode::Triangles => 16,
        MeshoptMode::Indices => 4,
    };
    let mut longer = view.to_vec();
    longer.insert(view.len() - tail, 0);
    assert!(decode_meshopt(&longer, mode, count, stride).is_err(), "a byte is left over");
}

/// A KTX2 file, of an image that is not too large to be decoded many times.
pub fn ktx2(data: &[u8]) {
    let Ok(file) = Ktx2::read(data) else { return };
    let (width, height) = file.size();
    let texels = u64::from(width) * u64::from(height);
    if texels > 1 << 20 {
        return;
    }
    let Ok(rgba) = file.rgba() else { return };
    assert_eq!(rgba.len() as u64, 4 * texels);
}

/// Reads a file whole, and cut in two: both must give the same events, or the same error.
fn file<D: Decode + 'static>(data: &[u8], decoder: impl Fn() -> D) -> Vec<Event> {
    let [cut, file @ ..] = data else { return vec![] };
    let (a, b) = file.split_at((usize::from(*cut) * 7).min(file.len()));
    let read = |source: Box<dyn Read + '_>| {
        let mut events = vec![];
        let error = EventReader::new(source, decoder()).read(usize::MAX, &mut events).err();
        (error.map(|error| error.to_string()), events)
    };
    let (error, events) = read(Box::new(file));
    let (cut_error, cut_events) = read(Box::new(a.chain(b)));
    assert_eq!(error, cut_error, "pieces differ");
    if error.is_none() {
        assert!(events == cut_events, "pieces differ");
    }
    events
}

const SIZE: SensorSize = SensorSize { width: 3, height: 2 };
const PIXELS: usize = 6;
const INTERVAL_US: i64 = 1000;

/// A state that an engine might have stored, with damage: taken up, it goes on without harm, or it is refused.
///
/// The first byte chooses the engine; then each ten bytes are a change: field, place, and eight bytes of value.
pub fn state(data: &[u8]) {
    let [choice, changes @ ..] = data else { return };
    let mut state = stored(*choice);
    for change in changes.as_chunks::<10>().0.iter().take(64) {
        damage(&mut state, change);
    }
    let luma = *choice & 1 == 0;
    if calls_for_many_events(&state) {
        return;
    }
    let Ok(mut engine) = CrossingEngine::from_state(&state, Some(1)) else { return };
    assert_eq!(engine.size(), state.size);
    let Some(start_us) = engine.t_us() else { return };
    for k in 1..3 {
        let Some(t_us) = start_us.checked_add(k * INTERVAL_US) else { return };
        let before = engine.state();
        match push(&mut engine, luma, t_us, k) {
            // What a readout still held may be stamped later than its coming.
            Ok(events) if state.readout.is_none() => {
                assert!(events.iter().all(|event| t_us - INTERVAL_US < event.t && event.t <= t_us));
                assert!(events.is_sorted_by_key(|event| (event.t, event.y, event.x)));
            }
            Ok(_) => {}
            Err(_) => assert!(same(&engine.state(), &before), "a refused frame has changed the state"),
        }
    }
    // What it has come to is a state again.
    let now = engine.state();
    let again = CrossingEngine::from_state(&now, Some(1)).expect("an engine's own state");
    assert!(same(&again.state(), &now), "a state is not what it was stored as");
}

/// Whether a state calls for so many events that making them takes seconds, as it should: its thresholds are fine, or its
/// references far from what its pixels see.
fn calls_for_many_events(state: &EngineState) -> bool {
    let parameters = &state.parameters;
    let at = |threshold: &Threshold, i: usize| match threshold {
        Threshold::Uniform(c) => *c,
        Threshold::PerPixel(values) => values.get(i).copied().unwrap_or(1.0),
    };
    let far = (0..state.base.len().min(state.on.len()).min(state.off.len())).any(|i| {
        let (on, off) = (at(&parameters.contrast_threshold, i), at(&parameters.contrast_threshold_off, i));
        let reference = state.base[i] + f64::from(state.on[i]) * on - f64::from(state.off[i]) * off;
        on.min(off) < 0.05 || reference.abs() > 1e3
    });
    // References that have leaked for hours are far from a state that has not.
    far || state.effects.leak.rate_hz > 0.0 && state.t_us.is_some_and(|t_us| t_us > 10_000_000_000)
}

/// Equal, NaN being equal to itself.
fn same(a: &EngineState, b: &EngineState) -> bool {
    format!("{a:?}") == format!("{b:?}")
}

/// The state of an engine that has seen three frames.
fn stored(choice: u8) -> EngineState {
    let bit = |n: u8| choice >> n & 1 == 1;
    let effects = Effects {
        photoreceptor_bandwidth: PhotoreceptorBandwidth {
            hz: if bit(2) { 300.0 } else { f64::INFINITY },
            source_follower_hz: if bit(3) { 200.0 } else { f64::INFINITY },
        },
        refractory_period_us: if bit(3) { 50.0 } else { 0.0 },
        leak: Leak {
            rate_hz: if bit(4) { 0.5 } else { 0.0 },
            spread: 0.2,
            jitter: 0.1,
            double_luma: 1.0,
            ..Effects::default().leak
        },
        shot_noise: ShotNoise { rms: if bit(5) { 0.03 } else { 0.0 }, floor: 0.0, half_luma: 1.0, bandwidth_hz: 1e4 },
        hot_pixels: HotPixels {
            fraction: if bit(6) { 0.5 } else { 0.0 },
            rate_hz: 1000.0,
            rate_spread: 0.5,
            least_cv: 0.05,
            most_cv: 0.5,
        },
        readout: bit(7).then_some(ReadoutParameters {
            events_per_s: 1e6,
            row_us: 0.5,
            latency_us: 1.0,
            jitter_us: 1.0,
            drop_after_us: None,
            by_columns: bit(1),
        }),
        ..Effects::default()
    };
    let parameters = CrossingParameters {
        contrast_threshold: Threshold::Uniform(0.1),
        contrast_threshold_off: Threshold::PerPixel(vec![0.1, 0.2, 0.3, 0.1, 0.2, 0.3]),
        interpolation: if bit(1) { Interpolation::Hermite } else { Interpolation::Linear },
        start_phase: if bit(2) { StartPhase::Stationary } else { StartPhase::Zero },
        ..CrossingParameters::default()
    };
    let mut engine = CrossingEngine::with_effects(SIZE, parameters, &effects, 1, Some(1)).expect("in range");
    for k in 0..3 {
        push(&mut engine, !bit(0), k * INTERVAL_US, k).expect("a good frame");
    }
    engine.state()
}

fn push(engine: &mut CrossingEngine, luma: bool, t_us: i64, k: i64) -> davis_rs::Result<Vec<Event>> {
    let hermite = engine.parameters().interpolation == Interpolation::Hermite;
    let mut events = vec![];
    #[allow(clippy::cast_precision_loss, reason = "small")]
    let value = |i: usize| 0.5 + 0.4 * (k as f32 + i as f32).sin();
    let (samples, rates) = (std::array::from_fn::<_, PIXELS, _>(value), [100.0f32; PIXELS]);
    if luma {
        let mut frame = Frame::new(t_us, &samples[..]);
        frame.rate = hermite.then_some(&rates[..]);
        engine.push(frame, &mut events)?;
    } else {
        let (samples, rates) = (samples.map(f64::from), rates.map(f64::from));
        let mut frame = Frame::new(t_us, &samples[..]);
        frame.rate = hermite.then_some(&rates[..]);
        engine.push_log(frame, &mut events)?;
    }
    Ok(events)
}

/// Sets a value; now and then there is one more, or one less.
fn set<T>(values: &mut Vec<T>, place: u8, value: T) {
    match usize::from(place) {
        255 => values.push(value),
        254 => drop(values.pop()),
        _ if values.is_empty() => {}
        place => {
            let n = values.len();
            values[place % n] = value;
        }
    }
}

/// One change of a state.
fn damage(state: &mut EngineState, [field, place, value @ ..]: &[u8; 10]) {
    let (bits, float) = (i64::from_le_bytes(*value), f64::from_le_bytes(*value));
    let effects = state.effect_state.as_mut();
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "any bits will do")]
    match (field % 24, effects) {
        (0, _) => state.t_us = (*place < 250).then_some(bits),
        (1, _) => set(&mut state.luma, *place, float as f32),
        (2, _) => set(&mut state.log_intensity, *place, float),
        (3, _) => state.takes_luma = !state.takes_luma,
        (4, _) => set(&mut state.rate, *place, float),
        (5, _) => set(&mut state.base, *place, float),
        (6, _) => set(&mut state.on, *place, bits as u32),
        (7, _) => set(&mut state.off, *place, bits as u32),
        (8, _) => set(&mut state.last_event_us, *place, bits),
        (9, _) => state.seed = bits as u64,
        (10, _) => state.parameters.log_eps = float,
        (11, _) => state.parameters.contrast_threshold = Threshold::Uniform(float),
        (12, Some(effects)) => effects.started_us = bits,
        (13, Some(effects)) => set(&mut effects.filtered, *place, float),
        (14, Some(effects)) => set(&mut effects.held_us, *place, float),
        (15, Some(effects)) => set(&mut effects.noise_filtered, *place, float),
        (16, Some(effects)) => set(&mut effects.noise_cell, *place, bits),
        (17, Some(effects)) => set(&mut effects.hot_wait_us, *place, float),
        (18, Some(effects)) => set(&mut effects.hot_index, *place, bits as u64),
        (19, _) => state.effect_state = None,
        (20 | 21, _) => {
            let event = Event::new(bits >> 16, u16::from(*place) % 4, bits as u16 % 3, bits & 4 == 0);
            if let Some(readout) = &mut state.readout {
                let events = if field % 24 == 20 { &mut readout.waiting } else { &mut readout.stamped };
                set(events, *place, event);
            }
        }
        (22, _) => {
            if let Some(readout) = &mut state.readout {
                match place % 8 {
                    0 => readout.free_us = bits,
                    1 => readout.free_share = float,
                    2 => readout.last_stamp_us = bits,
                    3 => readout.bursts = bits as u64,
                    4 => readout.dropped = bits as u64,
                    5 => readout.missed = bits as u64,
                    6 => readout.started_us = bits,
                    _ => set(&mut readout.ready_us, place / 8, bits),
                }
            }
        }
        (23, _) => state.size = SensorSize { width: bits as u16 % 5, height: u16::from(*place) % 4 },
        _ => {}
    }
}
