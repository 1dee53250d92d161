//! The program whose instructions `instructions.py` counts: a decoder that takes a stream of one kind a number of times,
//! in transfers as a camera's reader hands them over.

use davis_rs::Event;
use davis_rs::aer::{Chip, Decoded, Decoder, Device, Encoder, Frame, Region};

fn main() {
    let mut arguments = std::env::args().skip(1);
    let kind = arguments.next().expect("a kind, as instructions.py lists them");
    let repetitions: i64 = arguments.next().and_then(|n| n.parse().ok()).expect("how many times");
    let mut state = 1u64;
    let mut below = |limit: u64| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        u16::try_from((limit * (state >> 32)) >> 32).expect("small limits")
    };
    let (rows, most, gap) = match kind.as_str() {
        "decode-dense" => (5000, 6, 8),
        "decode-sparse" => (10_000, 1, 20_000),
        _ => (1000, 6, 20),
    };
    let mut packet = Decoded::default();
    let mut t = 0;
    for _ in 0..rows {
        t += 1 + i64::from(below(2 * gap));
        let (y, columns) = (below(180), 1 + below(most));
        packet.events.extend((0..columns).map(|_| Event::new(t, below(240), y, below(2) == 1)));
    }
    if kind == "decode-frames" {
        let region = Region { x: 0, y: 0, width: 240, height: 180 };
        packet.frames.push(Frame {
            t_start: 1000,
            t_exposure_start: 2000,
            t_exposure_end: 7000,
            t_end: 12_000,
            region,
            global_shutter: true,
            exposure_cycles: 150_000,
            pixels: (0..region.pixels()).map(|_| below(512) << 7).collect(),
        });
    }
    let device = Device::new(Chip::Davis240C);
    let stream = Encoder::new(device.clone()).expect("a chip").encode(&packet).expect("valid");
    let (mut decoder, mut decoded, mut count) = (Decoder::new(device).expect("a chip"), Decoded::default(), 0);
    for _ in 0..=repetitions {
        for piece in stream.chunks(1 << 14) {
            decoded.clear();
            decoder.push(piece, &mut decoded);
            count += decoded.events.len();
        }
    }
    println!("{count} events");
}
