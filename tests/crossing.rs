//! The crossing engine through its public interface, against integer arithmetic.

use std::num::NonZeroI128;

use davis_rs::{
    CrossingEngine, CrossingParameters, Error, Event, Frame, Result, SensorSize, Threshold, log_intensity, reconstruct,
};
use proptest::prelude::*;

/// Log intensities and thresholds of the oracle are whole numbers of this unit, which float64 holds exactly.
const UNIT: f64 = 1.0 / 1_048_576.0;

fn to_float(units: i64) -> f64 {
    f64::from(i32::try_from(units).expect("small")) * UNIT
}

fn engine(size: SensorSize, on: f64, off: f64, threads: usize) -> CrossingEngine {
    let (contrast_threshold, contrast_threshold_off) = (Threshold::Uniform(on), Threshold::Uniform(off));
    let parameters = CrossingParameters { contrast_threshold, contrast_threshold_off, ..Default::default() };
    CrossingEngine::new(size, parameters, Some(threads)).expect("valid parameters")
}

fn push(engine: &mut CrossingEngine, t_us: i64, luma: &[f32]) -> Result<Vec<Event>> {
    let mut events = Vec::new();
    engine.push(Frame::new(t_us, luma), &mut events).map(|()| events)
}

fn push_log(engine: &mut CrossingEngine, t_us: i64, log_intensity: &[f64]) -> Result<Vec<Event>> {
    let mut events = Vec::new();
    engine.push_log(Frame::new(t_us, log_intensity), &mut events).map(|()| events)
}

/// Smallest integer at or above `a / b`.
fn ceil_div(a: i128, b: NonZeroI128) -> i128 {
    let (quotient, remainder) = (a / b.get(), a % b.get());
    if remainder != 0 && (remainder > 0) == (b.get() > 0) { quotient + 1 } else { quotient }
}

/// The contract for one pixel in whole units: (t, on) of every event.
fn oracle(samples: &[(i64, i64)], on: i64, off: i64) -> Vec<(i64, bool)> {
    let mut events = Vec::new();
    let mut reference = samples[0].1;
    for pair in samples.windows(2) {
        let [(t_a, a), (t_b, b)] = [pair[0], pair[1]];
        loop {
            if b >= reference + on {
                reference += on;
            } else if b <= reference - off {
                reference -= off;
            } else {
                break;
            }
            let rise = NonZeroI128::new(i128::from(b - a)).expect("a level was reached, so the signal moved");
            let tick = ceil_div(i128::from(reference - a) * i128::from(t_b - t_a), rise);
            events.push((t_a + i64::try_from(tick).expect("within the interval"), b > a));
        }
    }
    events
}

/// A signal as (time, log intensity in units), with returns to its first value and steps of whole thresholds.
fn signal(on: i64) -> impl Strategy<Value = Vec<(i64, i64)>> {
    let step = prop_oneof![-4_000_000..4_000_000i64, (-3..=3i64).prop_map(move |n| n * on), -2..=2i64];
    let gap = prop_oneof![1..10i64, 1..1_000_000i64, Just(1 << 50)];
    (0..2_000_000_000i64, -1_000_000..1_000_000i64, prop::collection::vec((gap, step), 1..12)).prop_map(
        |(t, first, moves)| {
            let mut samples = vec![(t, first)];
            for (gap, step) in moves {
                let t = samples[samples.len() - 1].0 + gap;
                samples.push((t, first + step));
            }
            samples
        },
    )
}

proptest! {
    #[test]
    fn events_are_those_of_integer_arithmetic(
        (on, off, samples) in (20_000..2_000_000i64, 20_000..2_000_000i64, any::<bool>())
            .prop_flat_map(|(on, off, equal)| (Just(on), Just(if equal { on } else { off }), signal(on))),
    ) {
        let size = SensorSize { width: 1, height: 1 };
        let mut engine = engine(size, to_float(on), to_float(off), 1);
        let mut events = Vec::new();
        for &(t, units) in &samples {
            events.extend(push_log(&mut engine, t, &[to_float(units)]).unwrap());
        }
        let expected: Vec<Event> =
            oracle(&samples, on, off).into_iter().map(|(t, on)| Event::new(t, 0, 0, on)).collect();
        prop_assert_eq!(&events, &expected);
        let rebuilt =
            reconstruct(&events, &[to_float(samples[0].1)], size, i64::MAX, engine.parameters(), 0).unwrap();
        prop_assert_eq!(rebuilt, engine.reference());
    }
}

const SIZE: SensorSize = SensorSize { width: 150, height: 61 };

/// Frames of a moving texture, larger than what one thread takes at a time.
fn frames() -> Vec<Vec<f32>> {
    (0..5u16)
        .map(|frame| {
            let wave = |x: u16, y: u16| {
                let (x, y, t) = (f32::from(x), f32::from(y), f32::from(frame));
                (1.5 * (0.31 * x + 0.8 * t).sin() + (0.17 * y - 0.5 * t).cos()).exp()
            };
            (0..SIZE.height).flat_map(|y| (0..SIZE.width).map(move |x| wave(x, y))).collect()
        })
        .collect()
}

#[test]
fn events_do_not_depend_on_threads_and_are_sorted() {
    let run = |threads| -> Vec<Vec<Event>> {
        let mut engine = engine(SIZE, 0.1, 0.12, threads);
        (0..).step_by(1_000).zip(frames()).map(|(t, luma)| push(&mut engine, t, &luma).unwrap()).collect()
    };
    let packets = run(1);
    assert!(packets[0].is_empty());
    assert!(packets.iter().map(Vec::len).sum::<usize>() > 50_000);
    for packet in &packets {
        assert!(packet.is_sorted_by_key(|event| (event.t, event.y, event.x)));
    }
    assert_eq!(run(2), packets);
    assert_eq!(run(7), packets);
}

#[test]
fn push_is_push_log_of_log_intensity() {
    let (mut by_luma, mut by_log) = (engine(SIZE, 0.15, 0.15, 2), engine(SIZE, 0.15, 0.15, 2));
    for (t, luma) in (0..).zip(frames()) {
        let logs: Vec<f64> = luma.iter().map(|&y| log_intensity(y, 1e-3)).collect();
        assert_eq!(push(&mut by_luma, t, &luma).unwrap(), push_log(&mut by_log, t, &logs).unwrap());
    }
    assert_eq!(by_luma.reference(), by_log.reference());
    assert_eq!(by_luma.last_event_us(), by_log.last_event_us());
}

#[test]
fn a_refused_frame_changes_nothing() {
    let (mut engine, mut untroubled) = (engine(SIZE, 0.15, 0.15, 2), engine(SIZE, 0.15, 0.15, 2));
    for (t, luma) in (10..).step_by(10).zip(frames()) {
        for bad in [f32::NAN, f32::INFINITY, -1.0] {
            let mut spoiled = luma.clone();
            spoiled[3 * 150 + 7] = bad;
            match push(&mut engine, t, &spoiled) {
                Err(Error::Argument(message)) => {
                    assert!(message.contains("(x, y) = (7, 3)"), "{message}");
                    assert!(message.contains(&format!("t = {t} us")), "{message}");
                }
                other => panic!("{other:?}"),
            }
        }
        assert!(matches!(push(&mut engine, t, &luma[1..]), Err(Error::Argument(_))));
        assert!(matches!(push(&mut engine, -1, &luma), Err(Error::Argument(_))));
        if let Some(last) = engine.t_us() {
            assert!(matches!(push(&mut engine, last, &luma), Err(Error::Order(_))));
        }
        assert_eq!(engine.t_us(), untroubled.t_us());
        assert_eq!(push(&mut engine, t, &luma).unwrap(), push(&mut untroubled, t, &luma).unwrap());
    }
    assert_eq!(engine.last_event_us(), untroubled.last_event_us());
}

#[test]
fn a_new_engine_has_no_time_no_reference_and_no_events() {
    let engine = engine(SIZE, 0.15, 0.15, 1);
    assert_eq!(engine.size(), SIZE);
    assert_eq!(engine.t_us(), None);
    assert!(engine.reference().iter().all(|r| r.is_nan()));
    assert!(engine.last_event_us().iter().all(|&t| t == -1));
    assert_eq!(engine.reference().len(), SIZE.pixels());
}

/// The first frame has no events, also where the vector comes with some of another run's.
#[test]
fn what_was_in_the_vector_is_replaced() {
    let mut events = vec![Event::new(1, 0, 0, true)];
    let mut engine = engine(SensorSize { width: 1, height: 1 }, 0.5, 0.5, 1);
    engine.push_log(Frame::new(0, &[0.0]), &mut events).expect("a valid frame");
    assert!(events.is_empty());
}

/// Pushes signals of several pixels, each a sample (log intensity in units) at each of these times, and compares events,
/// counters and times of last events with integer arithmetic. Before each push, a frame that is refused at its last pixel
/// must change nothing; and an engine of the stored state must go on alike.
fn compare_with_integers(times: &[i64], signals: &[Vec<i64>], c: i64, threads: usize) {
    let size = SensorSize { width: u16::try_from(signals.len()).expect("few"), height: 1 };
    let mut engine = engine(size, to_float(c), to_float(c), threads);
    let events_of = |pixel: usize| {
        let samples: Vec<(i64, i64)> = times.iter().copied().zip(signals[pixel].iter().copied()).collect();
        oracle(&samples, c, c)
    };
    let expected: Vec<Vec<(i64, bool)>> = (0..signals.len()).map(events_of).collect();
    let mut start = -1;
    for (k, &t) in times.iter().enumerate() {
        let logs: Vec<f64> = signals.iter().map(|signal| to_float(signal[k])).collect();
        let mut spoiled = logs.clone();
        spoiled[signals.len() - 1] = 747.0;
        let before = engine.state();
        push_log(&mut engine, t, &spoiled).unwrap_err();
        assert_eq!(engine.state(), before, "at {t} us");
        let mut restored = CrossingEngine::from_state(&before, Some(threads)).unwrap();
        let events = push_log(&mut engine, t, &logs).unwrap();
        assert_eq!(push_log(&mut restored, t, &logs).unwrap(), events, "at {t} us");
        assert_eq!(restored.state(), engine.state(), "at {t} us");
        let mut all: Vec<Event> = vec![];
        for (x, pixel) in (0..size.width).zip(&expected) {
            let of_now = pixel.iter().filter(|(at, _)| start < *at && *at <= t);
            all.extend(of_now.map(|&(at, on)| Event::new(at, x, 0, on)));
        }
        all.sort_by_key(|event| event.t);
        assert_eq!(events, all, "at {t} us");
        let last = |pixel: &Vec<(i64, bool)>| pixel.iter().map(|(at, _)| *at).filter(|at| *at <= t).max().unwrap_or(-1);
        assert_eq!(engine.last_event_us(), expected.iter().map(last).collect::<Vec<i64>>(), "at {t} us");
        start = t;
    }
}

/// A pixel may have more than 65,535 events of a polarity: what is one more comes alone, among others, and in others.
#[test]
fn counters_go_on_beyond_16_bits() {
    const C: i64 = 1024;
    // Up and down by 8,000 levels: 64,000 events of each polarity. Then level by level, or far beyond at once.
    let far: Vec<i64> = (0..17).map(|k| [0, 8000][k % 2]).collect();
    let after = |steps: &dyn Fn(i64) -> i64| -> Vec<i64> {
        far.iter().map(|levels| levels * C).chain((1..=1600).map(steps)).collect()
    };
    let signals = [
        after(&|k| k * C + 100),        // ON events alone
        after(&|k| -k * C - 100),       // OFF events alone
        after(&|k| (k % 2) * 1700 * C), // both, many at once
        after(&|_| 0),                  // none
    ];
    let shortened: Vec<Vec<i64>> =
        signals.iter().map(|signal| signal[..17].iter().chain(&signal[1540..]).copied().collect()).collect();
    let times: Vec<i64> = (0..).step_by(1000).take(shortened[0].len()).map(|t| t + 5).collect();
    for threads in [1, 2] {
        compare_with_integers(&times, &shortened, C, threads);
    }
    // One by one, from 64,000 to beyond 65,535.
    let slow: Vec<Vec<i64>> = signals[..2].to_vec();
    let times: Vec<i64> = (0..).step_by(1000).take(slow[0].len()).collect();
    let size = SensorSize { width: 2, height: 1 };
    let mut engine = engine(size, to_float(C), to_float(C), 1);
    let mut counted = [0u32; 2];
    for (k, &t) in times.iter().enumerate() {
        let events = push_log(&mut engine, t, &[to_float(slow[0][k]), to_float(slow[1][k])]).unwrap();
        for event in events {
            counted[usize::from(event.x)] += u32::from(event.p == u8::from(event.x == 0));
        }
    }
    assert_eq!([engine.state().on[0], engine.state().off[1]], counted);
    assert_eq!(counted, [65_600, 65_600]);
}

/// Times of last events are kept for longer than 2^32 us, which are 71.6 minutes.
#[test]
fn runs_go_on_beyond_72_minutes() {
    // Up and down over one level, clearly.
    let one_event = |k: usize| [-40_000, 150_000][k % 2];
    let minutes: Vec<i64> = vec![0, 1, 30, 59, 70, 71, 72, 73, 90, 143, 144, 300];
    for first in [0, 1, 1 << 40] {
        let times: Vec<i64> = minutes.iter().map(|minute| first + minute * 60_000_000).collect();
        let quiet = |k: usize| if k < 3 { 0 } else { 1 << 20 };
        let signals = [
            (0..times.len()).map(|k| [0, 300_000][k % 2]).collect(),
            (0..times.len()).map(one_event).collect(),
            (0..times.len()).map(quiet).collect(),
            vec![5; times.len()],
        ];
        compare_with_integers(&times, &signals, 100_000, 1);
    }
    // Frame by frame across the end of 32 bits: of one event each, or of one and several.
    let end = 1 << 32;
    let times: Vec<i64> = (0..end - 3).step_by(1 << 30).chain((end - 3..end + 13).step_by(2)).collect();
    let one_each: Vec<i64> = (0..times.len()).map(one_event).collect();
    let several = (0..times.len()).map(|k| [0, 350_000][k % 2]).collect();
    compare_with_integers(&times, &[one_each.clone(), vec![0; times.len()]], 100_000, 1);
    compare_with_integers(&times, &[one_each, several], 100_000, 2);
}

/// Intervals of 2^31 us and more have stamps that no key holds.
#[test]
fn intervals_may_be_longer_than_half_an_hour() {
    for gap in [(1 << 31) - 1, 1 << 31, (1 << 31) + 1, (1 << 32) - 1, 1 << 32, 1 << 50] {
        let times: Vec<i64> = [3, 1003, 1003 + gap, 2003 + gap, 2003 + 2 * gap].to_vec();
        let signals = [
            vec![0, 150_000, 900_000, 100_000, 1_000_000],
            vec![0, 0, 0, 0, 0],
            vec![50_000, 10_000, -140_000, 220_000, 150_000],
            vec![0, 90_000, 100_000, 100_001, -3],
        ];
        for threads in [1, 2] {
            compare_with_integers(&times, &signals, 100_000, threads);
        }
    }
}
