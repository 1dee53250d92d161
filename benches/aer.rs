//! The camera's stream: words a second, beside a copy of as many bytes as are read and written.

use std::hint::black_box;
use std::time::Instant;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use davis_rs::Event;
use davis_rs::aer::{Chip, Decoded, Decoder, Device, Encoder, Frame, Region};

/// What a reader hands over at a time.
const TRANSFER: usize = 1 << 17;

/// Numbers that look random, the same in every run.
struct Mixer(u64);

impl Mixer {
    /// The next one below `limit`.
    #[allow(clippy::cast_possible_truncation, reason = "below the limit")]
    fn below(&mut self, limit: u16) -> u16 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((u64::from(limit) * (self.0 >> 32)) >> 32) as u16
    }
}

/// Rows of 1..=`most` columns, each at a time of its own, `gap` microseconds apart on average.
fn rows(count: usize, most: u16, gap: u16) -> Vec<Event> {
    let (mut mixer, mut t, mut events) = (Mixer(1), 0, Vec::new());
    for _ in 0..count {
        t += 1 + i64::from(mixer.below(2 * gap - 1));
        let (y, columns) = (mixer.below(180), 1 + mixer.below(most));
        events.extend((0..columns).map(|_| Event::new(t, mixer.below(240), y, mixer.below(2) == 1)));
    }
    events
}

/// Full frames, 30 ms apart, each read within 10 ms.
fn frames(count: i64) -> Vec<Frame> {
    let mut mixer = Mixer(2);
    let mut pixels = || (0..240 * 180).map(|_| mixer.below(512) << 7).collect();
    (0..count)
        .map(|i| Frame {
            t_start: 30_000 * i,
            t_exposure_start: 30_000 * i + 5_000,
            t_exposure_end: 30_000 * i + 10_000,
            t_end: 30_000 * i + 15_000,
            region: Region { x: 0, y: 0, width: 240, height: 180 },
            global_shutter: true,
            exposure_cycles: 150_000,
            pixels: pixels(),
        })
        .collect()
}

fn encode(packet: &Decoded) -> Vec<u8> {
    Encoder::new(Device::new(Chip::Davis240C)).expect("a chip").encode(packet).expect("valid")
}

/// The streams, of some two million words each.
fn streams() -> [(&'static str, Vec<u8>); 3] {
    let dense = rows(400_000, 6, 8);
    let sparse = rows(650_000, 1, 20_000);
    let among_frames: Vec<Event> = rows(30_000, 6, 20).into_iter().filter(|event| event.t < 660_000).collect();
    let heavy = Decoded { events: among_frames, frames: frames(22), ..Decoded::default() };
    [
        ("dense", encode(&Decoded { events: dense, ..Decoded::default() })),
        ("APS-heavy", encode(&heavy)),
        ("sparse", encode(&Decoded { events: sparse, ..Decoded::default() })),
    ]
}

/// Decodes in transfers, as a reader would; returns the bytes that were written.
fn decode(stream: &[u8], decoded: &mut Decoded) -> usize {
    let mut decoder = Decoder::new(Device::new(Chip::Davis240C)).expect("a chip");
    let mut written = 0;
    for transfer in stream.chunks(TRANSFER) {
        decoded.clear();
        decoder.push(transfer, decoded);
        written += size_of_val(&decoded.events[..]);
    }
    written
}

/// Copies as many bytes as decoding a transfer reads and writes, half of them each, as often.
fn copy(from: &[u8], to: &mut [u8], transfers: usize) {
    for _ in 0..transfers {
        black_box(&mut *to).copy_from_slice(black_box(from));
    }
}

fn aer(c: &mut Criterion) {
    let mut group = c.benchmark_group("aer");
    group.sample_size(30);
    for (name, stream) in streams() {
        let mut decoded = Decoded::default();
        let moved = stream.len() + decode(&stream, &mut decoded);
        let transfers = stream.len().div_ceil(TRANSFER);
        group.throughput(Throughput::Elements(stream.len() as u64 / 2));
        group.bench_function(format!("decode {name}"), |b| b.iter(|| decode(black_box(&stream), &mut decoded)));
        let (from, mut to) = (vec![1; moved / 2 / transfers], vec![0; moved / 2 / transfers]);
        group.throughput(Throughput::Bytes(moved as u64));
        group.bench_function(format!("memcpy {name}"), |b| b.iter(|| copy(&from, &mut to, transfers)));
    }
    group.finish();
}

/// Medians of both, taken in turns, and their ratio: what holds on any machine.
fn ratios(_: &mut Criterion) {
    if std::env::args().any(|argument| argument == "--profile-time") {
        return;
    }
    println!("{:>10} {:>10} {:>8} {:>12} {:>12} {:>6}", "", "Mwords/s", "Mev/s", "decode GB/s", "memcpy GB/s", "ratio");
    for (name, stream) in streams() {
        let mut decoded = Decoded::default();
        let written = decode(&stream, &mut decoded);
        let moved = stream.len() + written;
        let transfers = stream.len().div_ceil(TRANSFER);
        let (from, mut to) = (vec![1; moved / 2 / transfers], vec![0; moved / 2 / transfers]);
        let (mut decoding, mut copying) = (Vec::new(), Vec::new());
        for _ in 0..101 {
            let start = Instant::now();
            black_box(decode(black_box(&stream), &mut decoded));
            decoding.push(start.elapsed().as_secs_f64());
            let start = Instant::now();
            copy(&from, &mut to, transfers);
            copying.push(start.elapsed().as_secs_f64());
        }
        decoding.sort_by(f64::total_cmp);
        copying.sort_by(f64::total_cmp);
        #[allow(clippy::cast_precision_loss, reason = "far below 2^53")]
        let (words, events, moved) = (stream.len() as f64 / 2.0, written as f64 / 16.0, moved as f64);
        let (decoding, copying) = (decoding[50], copying[50]);
        println!(
            "{name:>10} {:>10.0} {:>8.0} {:>12.1} {:>12.1} {:>6.2}",
            words / decoding / 1e6,
            events / decoding / 1e6,
            moved / decoding / 1e9,
            moved / copying / 1e9,
            copying / decoding
        );
    }
}

criterion_group!(benches, aer, ratios);
criterion_main!(benches);
