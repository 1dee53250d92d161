//! The crossing engine on moving textures, compared with what memory alone would cost: pixels a second, and ratios.

use std::hint::black_box;
use std::time::{Duration, Instant};

use criterion::{Criterion, Throughput, criterion_group};
use davis_rs::{CrossingEngine, CrossingParameters, Event, Frame, SensorSize};

mod common;
use common::{FRAMES, sequence, spread};

const SMALL: SensorSize = SensorSize { width: 240, height: 180 };
const LARGE: SensorSize = SensorSize { width: 1280, height: 720 };

/// Passes over a sequence in the table, of each case in turn; the medians are shown.
const ROUNDS: usize = 9;

/// Something that is done to every frame of a sequence; returns the time that `FRAMES` frames take, and their events.
struct Case<'a> {
    name: String,
    size: SensorSize,
    pass: Box<dyn FnMut() -> (Duration, usize) + 'a>,
}

/// The engine. Each pass begins with references spread over a threshold around the signal, as in the midst of a run.
fn engine<'a>(name: &str, size: SensorSize, frames: &'a [Vec<f32>], threads: usize) -> Case<'a> {
    let first = spread(&frames[0]);
    let pass = move || {
        let mut engine = CrossingEngine::new(size, CrossingParameters::default(), Some(threads)).expect("valid");
        let mut events = Vec::<Event>::new();
        let mut push = |t_us, luma: &[f32]| {
            engine.push(Frame::new(t_us, luma), &mut events).expect("valid");
            black_box(&events).len()
        };
        push(0, &first);
        push(1000, &frames[0]);
        let start = Instant::now();
        let count = (2000..).step_by(1000).zip(&frames[1..]).map(|(t_us, luma)| push(t_us, luma)).sum();
        (start.elapsed(), count)
    };
    Case { name: name.into(), size, pass: Box::new(pass) }
}

/// What the common path cannot do without: read the frame and the marks, and store the frame, in one of two places in turn.
fn bare_pass(size: SensorSize, frames: &[Vec<f32>]) -> Case<'_> {
    let marks = vec![1e9f32; size.pixels()];
    let (mut last, mut next) = (vec![0.0f32; size.pixels()], vec![0.0f32; size.pixels()]);
    let pass = move || {
        let start = Instant::now();
        for new in &frames[1..] {
            let mut left = 0;
            for ((next, new), mark) in next.iter_mut().zip(new).zip(black_box(&marks)) {
                left |= u32::from(new >= mark);
                *next = *new;
            }
            std::mem::swap(&mut last, &mut next);
            black_box((&last, left));
        }
        (start.elapsed(), 0)
    };
    Case { name: "bare pass over the same bytes".into(), size, pass: Box::new(pass) }
}

/// Copies 16 bytes a pixel, half read and half written: the most that `threads` threads can do.
fn copy<'a>(name: &str, size: SensorSize, threads: usize) -> Case<'a> {
    let from = vec![1u64; size.pixels()];
    let mut to = vec![0u64; size.pixels()];
    let part = size.pixels().div_ceil(threads);
    let pass = move || {
        let start = Instant::now();
        std::thread::scope(|scope| {
            for (to, from) in to.chunks_mut(part).zip(from.chunks(part)) {
                scope.spawn(move || {
                    for _ in 0..FRAMES {
                        to.copy_from_slice(black_box(from));
                        black_box(&*to);
                    }
                });
            }
        });
        (start.elapsed(), 0)
    };
    Case { name: name.into(), size, pass: Box::new(pass) }
}

/// The sequences of one sensor size.
struct Sequences {
    size: SensorSize,
    dense: Vec<Vec<f32>>,
    quiet: Vec<Vec<f32>>,
    still: Vec<Vec<f32>>,
}

impl Sequences {
    fn new(size: SensorSize) -> Self {
        Self { size, dense: sequence(size, 1.0 / 3.0), quiet: sequence(size, 0.02), still: sequence(size, 0.0) }
    }

    fn cases(&self) -> Vec<Case<'_>> {
        vec![
            engine("dense: 1/3 px a frame", self.size, &self.dense, 1),
            engine("dense, two threads", self.size, &self.dense, 2),
            engine("quiet: 0.02 px a frame", self.size, &self.quiet, 1),
            engine("static", self.size, &self.still, 1),
            bare_pass(self.size, &self.still),
            copy("copying 16 bytes a pixel, two threads", self.size, 2),
            copy("copying 16 bytes a pixel", self.size, 1),
        ]
    }
}

fn crossing(c: &mut Criterion) {
    for (name, size) in [("240 x 180", SMALL), ("1280 x 720", LARGE)] {
        let sequences = Sequences::new(size);
        let mut group = c.benchmark_group(name);
        group.throughput(Throughput::Elements(size.pixels() as u64)).sample_size(20);
        for Case { name, mut pass, .. } in sequences.cases() {
            group.bench_function(&name, |b| {
                #[allow(clippy::cast_precision_loss, reason = "few frames")]
                b.iter_custom(|frames| {
                    let passes = frames.div_ceil(FRAMES.into());
                    let total: Duration = (0..passes).map(|_| pass().0).sum();
                    total.mul_f64(frames as f64 / (passes * u64::from(FRAMES)) as f64)
                });
            });
        }
        group.finish();
    }
}

/// All cases in turn, `ROUNDS` times, so that whatever else the machine does falls on all alike.
#[allow(clippy::cast_precision_loss, reason = "for people")]
fn table() {
    let all = [SMALL, LARGE].map(Sequences::new);
    let mut cases: Vec<Case<'_>> = all.iter().flat_map(Sequences::cases).collect();
    let mut seconds = vec![vec![]; cases.len()];
    let mut events = vec![0; cases.len()];
    for _ in 0..ROUNDS {
        for (i, case) in cases.iter_mut().enumerate() {
            let (time, count) = (case.pass)();
            seconds[i].push(time.as_secs_f64());
            events[i] = count;
        }
    }
    println!(
        "| sensor | case | events a pixel a frame | Mpixel/s | times the bare pass's time | share of copy bandwidth |"
    );
    println!("|---|---|---|---|---|---|");
    let per_size = cases.len() / 2;
    for (i, case) in cases.iter().enumerate() {
        let pixels = f64::from(FRAMES) * case.size.pixels() as f64;
        let median = |i: usize| {
            let mut times = seconds[i].clone();
            times.sort_by(f64::total_cmp);
            times[ROUNDS / 2]
        };
        let last = i - i % per_size + per_size - 1;
        let (bare, copied) = (median(last - 2), median(last));
        println!(
            "| {} x {} | {} | {:.3} | {:.0} | {:.2} | {:.0} % |",
            case.size.width,
            case.size.height,
            case.name,
            events[i] as f64 / pixels,
            pixels / median(i) / 1e6,
            median(i) / bare,
            100.0 * copied / median(i)
        );
    }
}

criterion_group!(benches, crossing);

fn main() {
    benches();
    Criterion::default().configure_from_args().final_summary();
    table();
}
