//! Malformed streams, word by word: what is made of each, and how it is counted.

use davis_rs::Event;
use davis_rs::aer::{Chip, Decoded, Decoder, Device, Frame, Region, Stats, TriggerKind};

/// Marks.
const RESET: u16 = 1;
const IMU_START: u16 = 5;
const IMU_END: u16 = 7;
const FRAME_START: u16 = 8;
const FRAME_END: u16 = 10;
const RESET_COLUMN: u16 = 11;
const SIGNAL_COLUMN: u16 = 12;
const COLUMN_END: u16 = 13;
const EXPOSURE_START: u16 = 14;
const EXPOSURE_END: u16 = 15;

/// A time of 100 us, row 5, column 7 ON.
const EVENT: [u16; 3] = [0x8064, 0x1005, 0x3007];

/// What a DAVIS346 makes of words (its samples do not count double), pushed whole and byte by byte.
fn decode(words: &[u16]) -> (Decoded, Stats) {
    let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
    let of_pieces = |size| {
        let mut decoder = Decoder::new(Device::new(Chip::Davis346B)).unwrap();
        let mut output = Decoded::default();
        for piece in bytes.chunks(size) {
            decoder.push(piece, &mut output);
        }
        (output, decoder.stats().clone())
    };
    assert_eq!(of_pieces(1), of_pieces(usize::MAX));
    of_pieces(usize::MAX)
}

/// The event of [`EVENT`] in an image that is swapped on the wire.
fn event(t: i64) -> Event {
    Event::new(t, 5, 7, true)
}

/// Counts, all others being zero.
fn counted(count: impl FnOnce(&mut Stats)) -> Stats {
    let mut stats = Stats::default();
    count(&mut stats);
    stats
}

/// A sample of all groups: a scale, and bytes 0, 1, ..
fn sample(bytes: u16) -> Vec<u16> {
    [vec![IMU_START, 0x53E5], (0..bytes).map(|i| 0x5000 | i & 0xFF).collect(), vec![IMU_END]].concat()
}

/// A read of a frame of two columns of three samples on the wire.
fn read(start: u16, level: u16) -> Vec<u16> {
    (0..2).flat_map(|column| [vec![start], vec![0x4000 | (level + column); 3], vec![COLUMN_END]].concat()).collect()
}

/// The region x 10..13, y 20..22.
const REGION: [u16; 8] = [0x5100, 0x520A, 0x5100, 0x5214, 0x5100, 0x520C, 0x5100, 0x5215];

/// A frame of that region, in parts, so that a test can spoil one.
fn frame() -> [Vec<u16>; 6] {
    [
        vec![0x8001, FRAME_START, 0x6001, 0x6002, 0x6003],
        REGION.to_vec(),
        read(RESET_COLUMN, 600),
        vec![0x8002, EXPOSURE_START, 0x8003, EXPOSURE_END],
        read(SIGNAL_COLUMN, 500),
        vec![0x8004, FRAME_END],
    ]
}

/// Decodes a spoilt frame, and checks that a good one after it is not harmed.
fn decode_spoilt(words: &[Vec<u16>]) -> (Vec<Frame>, Stats) {
    let (mut decoded, mut stats) = decode(&[words.concat(), frame().concat()].concat());
    assert_eq!(decoded.frames.pop().map(|frame| frame.pixels), Some(vec![100 << 6; 6]));
    // The good one begins at an earlier time again.
    stats.times_not_increasing = 0;
    (decoded.frames, stats)
}

#[test]
fn a_good_frame_is_whole() {
    let (decoded, stats) = decode(&frame().concat());
    let expected = Frame {
        t_start: 1,
        t_exposure_start: 2,
        t_exposure_end: 3,
        t_end: 4,
        region: Region { x: 10, y: 20, width: 3, height: 2 },
        global_shutter: true,
        exposure_cycles: 1 | 2 << 10 | 3 << 20,
        pixels: vec![100 << 6; 6],
    };
    assert_eq!((decoded.frames, stats), (vec![expected], Stats::default()));
}

#[test]
fn a_row_alone_is_replaced() {
    let (decoded, stats) = decode(&[0x8064, 0x1001, 0x1005, 0x3007]);
    assert_eq!((decoded.events, stats), (vec![event(100)], Stats::default()));
}

#[test]
fn a_column_before_any_row_is_dropped() {
    let (decoded, stats) = decode(&[0x8064, 0x3007, 0x2007, 0x1005, 0x3007]);
    assert_eq!((decoded.events, stats), (vec![event(100)], counted(|s| s.columns_without_row = 2)));
}

#[test]
fn addresses_out_of_range_are_dropped() {
    // 346 rows and 260 columns on the wire; the latched row stays.
    let (decoded, stats) = decode(&[&EVENT[..], &[0x115A, 0x2104, 0x3FFF, 0x3007]].concat());
    assert_eq!((decoded.events, stats), (vec![event(100); 2], counted(|s| s.addresses_out_of_range = 3)));
}

#[test]
fn times_that_do_not_go_forward_are_obeyed() {
    let (decoded, stats) = decode(&[&EVENT[..], &[0x8064, 0x3007, 0x8032, 0x3007, 0x7000, 0x3007]].concat());
    let events = vec![event(100), event(100), event(50), event(0)];
    assert_eq!((decoded.events, stats), (events, counted(|s| s.times_not_increasing = 3)));
}

#[test]
fn a_lost_wrap_is_a_time_that_goes_back() {
    let (decoded, stats) = decode(&[&EVENT[..], &[0x7001, 0x8001, 0x3007, 0xFFFF, 0x8001, 0x3007]].concat());
    let events = vec![event(100), event(32_769), event(32_769)];
    assert_eq!((decoded.events, stats), (events, counted(|s| s.times_not_increasing = 1)));
}

#[test]
fn an_odd_byte_waits_for_the_next_piece() {
    let bytes: Vec<u8> = EVENT.iter().flat_map(|word| word.to_le_bytes()).collect();
    let mut decoder = Decoder::new(Device::new(Chip::Davis346B)).unwrap();
    let mut output = Decoded::default();
    decoder.push(&bytes[..5], &mut output);
    decoder.push(&[], &mut output);
    assert_eq!(output.events, []);
    decoder.push(&bytes[5..], &mut output);
    assert_eq!(output.events, [event(100)]);
}

#[test]
fn unknown_words_are_ignored() {
    let unknown = [0x0000, 0x0006, 0x0012, 0x0FFF, 0x5400, 0x5FFF, 0x6400, 0x6FFF];
    let (decoded, stats) = decode(&[&unknown[..], &EVENT].concat());
    assert_eq!((decoded.events, stats), (vec![event(100)], counted(|s| s.unknown_words = 8)));
}

#[test]
fn samples_too_short_too_long_or_without_a_scale_are_dropped() {
    let without_scale: Vec<u16> = sample(14).into_iter().filter(|word| *word != 0x53E5).collect();
    let without_groups: Vec<u16> =
        sample(0).into_iter().map(|word| if word == 0x53E5 { 0x5305 } else { word }).collect();
    for bad in [sample(13), sample(15), sample(300), sample(0), without_scale, without_groups] {
        let (decoded, stats) = decode(&[bad, sample(14)].concat());
        assert_eq!((decoded.imu.len(), stats), (1, counted(|s| s.imu_malformed = 1)));
    }
}

#[test]
fn words_of_samples_that_never_began_are_ignored() {
    let (decoded, stats) = decode(&[&sample(14)[1..], &sample(14)].concat());
    assert_eq!((decoded.imu.len(), stats), (1, counted(|s| s.imu_stray_words = 16)));
}

#[test]
fn a_second_end_of_a_sample_is_ignored() {
    let (decoded, stats) = decode(&[&sample(14)[..], &[IMU_END], &sample(14)].concat());
    assert_eq!((decoded.imu.len(), stats), (2, counted(|s| s.imu_stray_words = 1)));
}

#[test]
fn a_sample_without_an_end_is_dropped_by_the_next() {
    let (decoded, stats) = decode(&[&sample(14)[..16], &sample(14)].concat());
    assert_eq!((decoded.imu.len(), stats), (1, counted(|s| s.imu_unended = 1)));
}

#[test]
fn a_scale_that_comes_again_begins_anew() {
    let (decoded, stats) = decode(&[&sample(14)[..5], &sample(14)[1..]].concat());
    assert_eq!((decoded.imu.len(), stats), (1, counted(|s| s.imu_repeated_scales = 1)));
}

#[test]
fn words_of_frames_that_never_began_are_ignored() {
    let stray = [0x4123, COLUMN_END, RESET_COLUMN, SIGNAL_COLUMN, EXPOSURE_START, EXPOSURE_END, FRAME_END, 0x6001];
    let (frames, stats) = decode_spoilt(&[stray.to_vec(), REGION.to_vec()]);
    assert_eq!((frames, stats), (vec![], counted(|s| s.frame_stray_words = 16)));
}

#[test]
fn a_missing_sample_shifts_its_column() {
    let mut words = frame();
    // The second of the first column's three: that column is a row of the swapped image.
    words[4].remove(2);
    words[4][1] = 0x41EA;
    let (frames, stats) = decode_spoilt(&words);
    assert_eq!(frames[0].pixels, [110, 100, 1023, 100, 100, 100].map(|level| level << 6));
    assert_eq!(stats, counted(|s| s.samples_missing = 1));
}

#[test]
fn an_extra_sample_is_ignored() {
    let mut words = frame();
    words[4].insert(1, 0x41EA);
    let (frames, stats) = decode_spoilt(&words);
    assert_eq!(frames[0].pixels, [110, 100, 100, 100, 100, 100].map(|level| level << 6));
    assert_eq!(stats, counted(|s| s.samples_extra = 1));
}

#[test]
fn a_frame_without_a_column_end_is_dropped() {
    for part in [2, 4] {
        let mut words = frame();
        let place = words[part].iter().position(|word| *word == COLUMN_END).unwrap();
        words[part].remove(place);
        let (frames, stats) = decode_spoilt(&words);
        assert_eq!((frames.len(), stats.frames_wrong_columns), (0, 1));
    }
}

#[test]
fn a_frame_without_a_signal_columns_start_is_dropped() {
    let mut words = frame();
    words[4].remove(0);
    let (frames, stats) = decode_spoilt(&words);
    assert_eq!((frames.len(), stats.frames_wrong_columns), (0, 1));
}

/// As in the vendor's library: the column's end still counts, since the read is still the same.
#[test]
fn a_lost_start_between_columns_of_a_read_costs_that_column() {
    let mut words = frame();
    words[4].remove(5);
    let (frames, stats) = decode_spoilt(&words);
    assert_eq!(frames[0].pixels, [100, 100, 100, 1023, 1023, 1023].map(|level| level << 6));
    assert_eq!(stats, counted(|s| (s.samples_extra, s.samples_missing) = (3, 3)));
}

#[test]
fn a_frame_without_an_end_is_dropped_by_the_next() {
    let (frames, stats) = decode_spoilt(&frame()[..5]);
    assert_eq!((frames, stats), (vec![], counted(|s| s.frames_unended = 1)));
}

#[test]
fn a_frame_whose_region_is_none_of_the_sensors_is_dropped() {
    let backward = [0x5100, 0x520C, 0x5100, 0x5214, 0x5100, 0x520A, 0x5100, 0x5215];
    let beyond = [0x5100, 0x520A, 0x5100, 0x5214, 0x5101, 0x525A, 0x5100, 0x5215];
    let below = [0x5100, 0x520A, 0x5100, 0x5214, 0x5100, 0x520C, 0x5101, 0x5204];
    let largest = [0x51FF, 0x52FF, 0x52FF, 0x52FF, 0x52FF];
    for region in [&backward[..], &beyond, &below, &largest, &[], &REGION[..6]] {
        let mut words = frame();
        words[1] = region.to_vec();
        let (frames, stats) = decode_spoilt(&words);
        assert_eq!((frames, stats), (vec![], counted(|s| s.frames_bad_region = 1)), "{region:x?}");
    }
}

#[test]
fn stray_region_words_within_a_frame_drop_it() {
    for part in 2..5 {
        for stray in [0x5100, 0x5200] {
            let mut words = frame();
            words[part].insert(1, stray);
            let (frames, stats) = decode_spoilt(&words);
            assert_eq!((frames, stats), (vec![], counted(|s| s.frames_bad_region = 1)), "{stray:x} in part {part}");
        }
    }
}

#[test]
fn more_than_three_exposure_words_are_ignored() {
    let mut words = frame();
    words[0].extend([0x63FF; 5]);
    let (frames, stats) = decode_spoilt(&words);
    assert_eq!(frames[0].exposure_cycles, 1 | 2 << 10 | 3 << 20);
    assert_eq!(stats, counted(|s| s.exposure_words_extra = 5));
}

#[test]
fn a_missing_exposure_mark_is_the_one_before() {
    for (place, times) in [(1, (1, 3)), (3, (2, 2))] {
        let mut words = frame();
        words[3].remove(place);
        let (frames, stats) = decode_spoilt(&words);
        assert_eq!((frames[0].t_exposure_start, frames[0].t_exposure_end), times);
        assert_eq!(stats, counted(|s| s.exposure_marks_missing = 1));
    }
}

#[test]
fn a_reset_of_the_clock_drops_what_is_open() {
    let words = [&frame()[..3].concat(), &sample(14)[..8], &[RESET], &EVENT, &frame()[4].clone(), &[IMU_END]].concat();
    let (decoded, stats) = decode(&words);
    assert_eq!((decoded.events, decoded.frames, decoded.imu), (vec![event(100)], vec![], vec![]));
    assert_eq!(decoded.triggers.iter().map(|t| (t.t, t.kind)).collect::<Vec<_>>(), [(0, TriggerKind::TimestampReset)]);
    let expected = counted(|s| {
        (s.frames_unended, s.imu_unended) = (1, 1);
        (s.frame_stray_words, s.imu_stray_words) = (10, 1);
    });
    assert_eq!(stats, expected);
}

/// Where the drivers' 31 bits overflow, events keep their time; frames and samples wait for their next start.
#[test]
fn the_overflow_of_31_bits_is_none() {
    let words = [
        &[0x1005, 0x7FFF, 0x7FFF, 0x7FFF, 0x7FFF, 0x7FFF, 0x7FFF, 0x7FFF, 0x7FFF][..],
        &[0x7FFF; 8],
        &frame()[..3].concat(),
        &[0x8064, 0x3007, 0x7010, 0x3007, 0x8064, 0x3007],
        &frame()[4].clone(),
    ]
    .concat();
    let (decoded, stats) = decode(&words);
    let base = (16 * 4095) << 15;
    assert_eq!(decoded.events, [base + 100, 1 << 31, (1 << 31) + 100].map(event));
    let expected = counted(|s| (s.frames_unended, s.frame_stray_words) = (1, 10));
    assert_eq!((decoded.frames.len(), stats), (0, expected));
}
