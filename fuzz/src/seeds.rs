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
        ("ktx2", bodies::ktx2, own_images()),
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
    // Groups of one, two and four bits with bytes in place of the largest, and one of bytes; the first byte says which.
    let (kinds, ones, twos) = (&[0xe4][..], &[0x10, 0x80, 9, 8][..], &[0x1b, 0, 0, 0xff, 9, 8, 7, 6, 5][..]);
    let (fours, bytes) = (&[0x1f, 0xf0, 0, 0, 0, 0, 0, 1, 77, 78][..], &[3; 16][..]);
    let plane = [kinds, twos, fours, bytes].concat();
    let attributes = |mode: u8| [&[mode, 20, 4, 0xa0], &plane.repeat(8)[..], &[5; 32]].concat();
    // The newer version: each byte of an element is stored by shorter or longer groups, not at all, or whole.
    let planes = [kinds, ones, twos, fours, kinds, ones, twos, fours, bytes, &[6; 60]].concat();
    let block = [kinds, kinds, &planes, &planes].concat();
    let newer = |mode: u8| [&[mode, 20, 4, 0xa1], &block[..], &[0; 14], &[5; 8], &[1, 0x52]].concat();
    let table = [0, 0x76, 0x87, 0x56, 0x67, 0x78, 0xa9, 0x86, 0x65, 0x89, 0x68, 0x98, 1, 0x69, 0, 0];
    let codes = [0xf0, 0, 0x11, 0x2d, 0x3e, 0x0f, 0xfe, 0xff];
    let triangles = [&[5, 8, 2, 0xe1][..], &codes, &[6, 0xff, 4, 0x85, 1, 0, 2], &table].concat();
    let indices = [&[6, 2, 1, 0xd1][..], &[4, 8, 7, 0x91, 2, 3, 6, 0, 0, 0, 0]].concat();
    let views = [0, 1, 2, 3].map(attributes).into_iter().chain([0, 3, 4].map(newer));
    views.chain([triangles, indices]).collect()
}

/// Images of 10 x 12 texels in KTX2 files, which are only read: blocks of Basis Universal, and plain bytes.
fn own_images() -> Vec<Vec<u8>> {
    // What the blocks of ETC1S share (two colours, two patterns, their codes), and those of colours and of opacity.
    let shared = hex(concat!(
        "020002003b000000090000004c00000000000000000000000000000003000000030000000300000020400500000002000000",
        "0000000080001500000008000000000000000002540000002000000000000000000250010000000008000000e04330fc0404",
        "0000002027272707004105800000000000020000000000000000000000000000000000000000000000000000000000000000",
        "0a001500000000000008800050010000000000800004001500000000000008200000",
    ));
    let level = hex("189735188d06");
    // Blocks of one colour each.
    let blocks: Vec<u8> = (0..9u128).flat_map(|block| (0x17 | (0xff40_80c0 + block) << 5).to_le_bytes()).collect();
    let packed = zstd::bulk::compress(&blocks, 1).expect("memory");
    let texels: Vec<u8> = (0..=255).cycle().take(3 * 120).collect();
    let metadata = b"\x10\0\0\0KTXswizzle\0bgr1\0\x12\0\0\0KTXorientation\0lu\0\0\0";
    vec![
        image([0, 163, 1], &[0, 15], &[], &shared, &level, 0),
        image([0, 166, 0], &[3], &[], &[], &blocks, blocks.len()),
        image([0, 166, 2], &[5], &[], &[], &packed, blocks.len()),
        image([29, 1, 0], &[0, 1, 2], metadata, &[], &texels, texels.len()),
    ]
}

/// A KTX2 file of one level, by its format of Vulkan, colour model and scheme of compression.
fn image(
    [format, model, scheme]: [u32; 3],
    channels: &[u8],
    metadata: &[u8],
    shared: &[u8],
    level: &[u8],
    unpacked: usize,
) -> Vec<u8> {
    let samples = channels.iter().flat_map(|&channel| [[0, 0, 7, channel], [0; 4], [0; 4], [255; 4]]);
    let samples: Vec<u8> = samples.flatten().collect();
    #[allow(clippy::cast_possible_truncation, reason = "small")]
    let (described, said) = (28 + samples.len() as u32, metadata.len() as u32);
    let after = (104 + described + said) as usize;
    let head = [format, 1, 10, 12, 0, 0, 1, 1, scheme, 104, described, 104 + described, said];
    let places = [after, shared.len(), after + shared.len(), level.len(), unpacked].map(|place| place as u64);
    let descriptor = [described, 0, 2 | (described - 4) << 16, model | 1 << 8 | 2 << 16, 0x0303, 0, 0];
    let words = |words: &[u32]| words.iter().flat_map(|word| word.to_le_bytes()).collect::<Vec<u8>>();
    let index: Vec<u8> = places.iter().flat_map(|place| place.to_le_bytes()).collect();
    let magic = b"\xabKTX 20\xbb\r\n\x1a\n";
    [magic, &words(&head)[..], &index, &words(&descriptor), &samples, metadata, shared, level].concat()
}

fn hex(digits: &str) -> Vec<u8> {
    let digit = |at: usize| u8::from_str_radix(&digits[at..at + 2], 16).expect("two digits");
    (0..digits.len()).step_by(2).map(digit).collect()
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
