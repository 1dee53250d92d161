//! Good inputs of every target, from which mutation starts.

use std::io::Cursor;

use davis_rs::aer::{Chip, Decoded, Device, Encoder, Frame, Region};
use davis_rs::{Aedat4Encoder, Compression, Encode, Event, EventWriter, Evt2Encoder, Evt3Encoder, Limits, TextEncoder};

/// A target's name, what it does with an input, and good inputs.
pub type Target = (&'static str, fn(&[u8]), Vec<Vec<u8>>);

/// All targets.
#[must_use]
pub fn targets() -> Vec<Target> {
    use super::bodies;
    let aedat4 = [Compression::None, Compression::Lz4, Compression::Zstd(1)];
    let aedat4 = aedat4.into_iter().map(|compression| file(Aedat4Encoder::new(240, 180, compression, 5)));
    vec![
        ("aer", bodies::aer, vec![camera(0, Chip::Davis240C), camera(1, Chip::Davis346B)]),
        ("text", bodies::text, vec![file(TextEncoder::new(Limits::NONE).with_size_line()), own_text()]),
        ("evt2", bodies::evt2, vec![file(Evt2Encoder::new(240, 180))]),
        ("evt21", bodies::evt21, vec![own_evt21("little"), own_evt21("legacy")]),
        ("evt3", bodies::evt3, vec![file(Evt3Encoder::new(240, 180))]),
        ("aedat4", bodies::aedat4, aedat4.collect()),
        ("meshopt", bodies::meshopt, own_views()),
        ("state", bodies::state, (0..=255).step_by(5).map(changes).collect()),
    ]
}

fn events() -> Vec<Event> {
    // Single ones, and rows of neighbours at one time, which EVT 3.0 writes as vectors.
    let single = (0..60u16).map(|i| Event::new(i64::from(i) * 37, i * 3, 2 * i, i % 3 == 0));
    let row = (0..40u16).map(|i| Event::new(2500, 60 + i, 9, true));
    single.chain(row).collect()
}

/// EVT 2.1, which is only read: a time, then rows of events.
fn own_evt21(endianness: &str) -> Vec<u8> {
    let header = format!("% evt 2.1\n% format EVT21;endianness={endianness};width=240;height=180\n% end\n");
    let rows = (0..20u64).map(|i| (i % 2) << 60 | i << 54 | (3 * i) << 43 | (2 * i) << 32 | (0x8000_0401 >> i));
    let words = std::iter::once(8 << 60 | 5 << 32).chain(rows);
    let words = words.map(|word| if endianness == "legacy" { word.rotate_left(32) } else { word });
    [vec![20], header.into_bytes(), words.flat_map(u64::to_le_bytes).collect()].concat()
}

fn file(encoder: impl Encode + 'static) -> Vec<u8> {
    let mut writer = EventWriter::new(Cursor::new(vec![]), encoder).expect("memory");
    for packet in events().chunks(30) {
        writer.write(packet).expect("good events");
    }
    let bytes = writer.finish_with_contents().expect("memory").into_inner();
    [vec![20], bytes].concat()
}

fn own_text() -> Vec<u8> {
    b"\x03240 180\n0.000001 1 2 0\r\n 0.5 239 179 1 \n12.123456000 0 0 1\n1e3 0 0 0".to_vec()
}

/// Compressed buffer views, which are only read: with each kind of group, triangle and index.
fn own_views() -> Vec<Vec<u8>> {
    // Four groups: of zeros, of two and of four bits with bytes in place of the largest, and of bytes.
    let groups = [&[0xe4, 0x1b, 0, 0, 0xff, 9, 8, 7, 6, 5][..], &[0x1f, 0xf0, 0, 0, 0, 0, 0, 1, 77, 78], &[3; 16]];
    let plane = groups.concat();
    let attributes = |mode: u8| [&[mode, 20, 4, 0xa0], &plane.repeat(8)[..], &[5; 32]].concat();
    let table = [0, 0x76, 0x87, 0x56, 0x67, 0x78, 0xa9, 0x86, 0x65, 0x89, 0x68, 0x98, 1, 0x69, 0, 0];
    let codes = [0xf0, 0, 0x11, 0x2d, 0x3e, 0x0f, 0xfe, 0xff];
    let triangles = [&[4, 8, 2, 0xe1][..], &codes, &[6, 0xff, 4, 0x85, 1, 0, 2], &table].concat();
    let indices = [&[5, 2, 1, 0xd1][..], &[4, 8, 7, 0x91, 2, 3, 6, 0, 0, 0, 0]].concat();
    [0, 1, 2, 3].map(attributes).into_iter().chain([triangles, indices]).collect()
}

fn camera(number: u8, chip: Chip) -> Vec<u8> {
    let device = Device::new(chip);
    let region = Region { x: 3, y: 4, width: 5, height: 6 };
    let frame = Frame {
        t_start: 100,
        t_exposure_start: 200,
        t_exposure_end: 700,
        t_end: 900,
        region,
        global_shutter: true,
        exposure_cycles: 15_000,
        pixels: (0..30u16).map(|i| (i * 16) << 6).collect(),
    };
    let scene = Decoded { events: events(), frames: vec![frame], ..Decoded::default() };
    let bytes = Encoder::new(device).expect("a known chip").encode(&scene).expect("a good scene");
    [vec![number, 6], bytes].concat()
}

/// A few changes of values that states have.
fn changes(choice: u8) -> Vec<u8> {
    let change = |field: u8, place: u8, value: [u8; 8]| [vec![field, place], value.to_vec()].concat();
    [
        vec![choice],
        change(5, 1, 0.7f64.to_le_bytes()),
        change(6, 2, 3i64.to_le_bytes()),
        change(14, 3, 12.5f64.to_le_bytes()),
        change(15, 0, 100.0f64.to_le_bytes()),
        change(8, 4, 1500i64.to_le_bytes()),
    ]
    .concat()
}
