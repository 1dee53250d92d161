//! The camera's stream: words a second, compared with a copy of as many bytes as are read and written.

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

/// A stream, decoded in pieces as a reader would, or whole as a file would; and a copy of as many bytes.
struct Pass {
    stream: Vec<u8>,
    piece: usize,
    decoded: Decoded,
    /// Events of the whole stream.
    events: usize,
    from: Vec<u8>,
    to: Vec<u8>,
}

impl Pass {
    fn new(stream: Vec<u8>, piece: usize) -> Self {
        let mut pass = Self { stream, piece, decoded: Decoded::default(), events: 0, from: vec![], to: vec![] };
        pass.events = pass.decode();
        // Half of the bytes are read by a copy, half are written.
        let half = pass.bytes() / 2 / pass.stream.len().div_ceil(piece);
        (pass.from, pass.to) = (vec![1; half], vec![0; half]);
        pass
    }

    fn words(&self) -> usize {
        self.stream.len() / 2
    }

    /// Bytes read, and bytes of events written.
    fn bytes(&self) -> usize {
        self.stream.len() + self.events * size_of::<Event>()
    }

    fn decode(&mut self) -> usize {
        let mut decoder = Decoder::new(Device::new(Chip::Davis240C)).expect("a chip");
        let pieces = black_box(&self.stream).chunks(self.piece);
        pieces
            .map(|piece| {
                self.decoded.clear();
                decoder.push(piece, &mut self.decoded);
                self.decoded.events.len()
            })
            .sum()
    }

    /// Copies as many bytes as decoding moves, in as many pieces.
    fn copy(&mut self) {
        for _ in self.stream.chunks(self.piece) {
            black_box(&mut self.to).copy_from_slice(black_box(&self.from));
        }
    }
}

/// The streams in transfers, and a dense one that is long, at once: out of the caches.
fn passes() -> impl Iterator<Item = (&'static str, Pass)> {
    let in_transfers = streams().map(|(name, stream)| (name, Pass::new(stream, TRANSFER)));
    let long = encode(&Decoded { events: rows(2_000_000, 6, 8), ..Decoded::default() });
    in_transfers.into_iter().chain([("dense, 120 MB", Pass::new(long, usize::MAX))])
}

fn aer(c: &mut Criterion) {
    let mut group = c.benchmark_group("aer");
    group.sample_size(30);
    for (name, mut pass) in passes() {
        group.throughput(Throughput::Elements(pass.words() as u64));
        group.bench_function(format!("decode {name}"), |b| b.iter(|| pass.decode()));
        group.throughput(Throughput::Bytes(pass.bytes() as u64));
        group.bench_function(format!("memcpy {name}"), |b| b.iter(|| pass.copy()));
    }
    group.finish();
}

/// Median time of a pass in seconds.
fn median(times: &mut [f64]) -> f64 {
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

/// Medians of both, taken in turns, and their ratio: what holds on any machine.
fn ratios(_: &mut Criterion) {
    println!("{:>16} {:>9} {:>6} {:>12} {:>12} {:>6}", "", "Mwords/s", "Mev/s", "decode GB/s", "memcpy GB/s", "ratio");
    for (name, mut pass) in passes() {
        let (mut decoding, mut copying) = (vec![], vec![]);
        for _ in 0..51 {
            let start = Instant::now();
            pass.decode();
            decoding.push(start.elapsed().as_secs_f64());
            let start = Instant::now();
            pass.copy();
            copying.push(start.elapsed().as_secs_f64());
        }
        let (decoding, copying) = (median(&mut decoding), median(&mut copying));
        #[allow(clippy::cast_precision_loss, reason = "far below 2^53")]
        let [words, events, bytes] = [pass.words(), pass.events, pass.bytes()].map(|n| n as f64);
        println!(
            "{name:>16} {:>9.0} {:>6.0} {:>12.1} {:>12.1} {:>6.2}",
            words / decoding / 1e6,
            events / decoding / 1e6,
            bytes / decoding / 1e9,
            bytes / copying / 1e9,
            copying / decoding
        );
    }
}

criterion_group!(benches, aer, ratios);
criterion_main!(benches);
