//! What holds for every stream: whatever comes, in whatever pieces; and that decoding undoes encoding.

use davis_rs::Event;
use davis_rs::aer::{
    Chip, Decoded, Decoder, Device, Encoder, Frame, ImuGroups, ImuReading, ImuType, Region, Stats, Trigger, TriggerKind,
};
use proptest::collection::vec;
use proptest::prelude::*;

/// Cameras in each orientation of their frames, some of them tiny.
fn devices() -> impl Strategy<Value = Device> {
    let chips = prop::sample::select(vec![Chip::Davis240C, Chip::Davis346B, Chip::Davis128]);
    (chips, 0u8..8, any::<[bool; 3]>(), any::<bool>()).prop_map(|(chip, bits, imu_flips, small)| {
        let mut device = Device::new(chip);
        (device.aps_swapped, device.aps_flip_x, device.aps_flip_y) = (bits & 4 != 0, bits & 2 != 0, bits & 1 != 0);
        device.imu_flips = imu_flips;
        device.imu_type = ImuType::Mpu9250;
        if small {
            (device.dvs_columns, device.dvs_rows, device.aps_columns, device.aps_rows) = (1, 1, 3, 2);
        }
        device
    })
}

/// Times that go forward by nothing, little, a wrap, many wraps, or past the drivers' overflow.
fn times(count: usize) -> impl Strategy<Value = Vec<i64>> {
    let steps =
        prop_oneof![4 => Just(0), 8 => 1i64..50, 2 => 32_700i64..32_800, 1 => 0i64..1 << 28, 1 => 0i64..1 << 33];
    vec(steps, 0..=count).prop_map(|steps| {
        let sum = |t: &mut i64, step| {
            *t += step;
            Some(*t)
        };
        steps.into_iter().scan(0, sum).collect()
    })
}

fn events(device: &Device) -> impl Strategy<Value = Vec<Event>> + use<> {
    let size = device.size();
    // Few rows, so that columns share them.
    let place = (0..size.width, 0..size.height.min(3), any::<bool>());
    (times(150), vec(place, 150))
        .prop_map(|(times, places)| times.iter().zip(places).map(|(&t, (x, y, on))| Event::new(t, x, y, on)).collect())
}

fn readings() -> impl Strategy<Value = Vec<ImuReading>> {
    let values = (any::<[i16; 3]>(), any::<[i16; 3]>(), any::<i16>(), 1u8..8, 0u8..4, 0u8..4);
    (times(5), vec(values, 5)).prop_map(|(times, values)| {
        let reading = |(&t, (accel, gyro, temperature, groups, accel_range, gyro_range))| {
            let groups = ImuGroups(groups);
            let mut reading = ImuReading::new(t, groups, accel_range, gyro_range);
            reading.accel = if groups.accel() { accel } else { [0; 3] };
            reading.gyro = if groups.gyro() { gyro } else { [0; 3] };
            reading.temperature = if groups.temperature() { temperature } else { 0 };
            reading
        };
        times.iter().zip(values).map(reading).collect()
    })
}

/// Frames of parts of the sensor, with intensities that the camera can send, none across the drivers' overflow.
fn frames(device: &Device) -> impl Strategy<Value = Vec<Frame>> + use<> {
    let (size, double) = (device.frame_size(), device.chip == Chip::Davis240C);
    let span = |n: u16| (0..n, 1..8u16).prop_map(move |(start, length)| (start, length.min(n - start)));
    let shape = (span(size.width), span(size.height), any::<bool>(), 0u32..1 << 30, any::<u64>());
    (times(12), vec(shape, 3)).prop_map(move |(times, shapes)| {
        let frame = |(times, ((x, width), (y, height), global_shutter, exposure_cycles, seed)): (&[i64; 4], _)| {
            let [t_start, t_exposure_start, t_exposure_end, t_end] = times.map(|t| t.max(times[3] >> 31 << 31));
            let region = Region { x, y, width, height };
            let mut mixed: u64 = seed;
            let level = |_| {
                mixed = mixed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                let level = u16::try_from(mixed >> 54).unwrap();
                if double && level != 1023 { level & !1 } else { level }
            };
            let pixels = (0..region.pixels()).map(level).map(|level| level << 6).collect();
            Frame { t_start, t_exposure_start, t_exposure_end, t_end, region, global_shutter, exposure_cycles, pixels }
        };
        times.as_chunks().0.iter().zip(shapes).map(frame).collect()
    })
}

fn triggers() -> impl Strategy<Value = Vec<Trigger>> {
    let kinds = prop::sample::select(vec![2, 3, 4, 16, 17]);
    (0usize..3, times(5), vec(kinds, 5)).prop_map(|(resets, times, kinds)| {
        let resets = (0..resets).map(|_| Trigger::new(0, TriggerKind::TimestampReset));
        let edges = times.iter().zip(kinds).map(|(&t, kind)| Trigger::new(t, TriggerKind::of(kind).unwrap()));
        resets.chain(edges).collect()
    })
}

/// A camera, and what it sees.
fn scenes() -> impl Strategy<Value = (Device, Decoded)> {
    devices().prop_flat_map(|device| {
        let parts = (events(&device), readings(), frames(&device), triggers());
        (Just(device), parts)
            .prop_map(|(device, (events, imu, frames, triggers))| (device, Decoded { events, imu, frames, triggers }))
    })
}

fn encode(device: &Device, scene: &Decoded) -> Vec<u8> {
    Encoder::new(device.clone()).unwrap().encode(scene).unwrap()
}

fn decode<'a>(device: &Device, pieces: impl IntoIterator<Item = &'a [u8]>) -> (Decoded, Stats) {
    let mut decoder = Decoder::new(device.clone()).unwrap();
    let mut output = Decoded::default();
    for piece in pieces {
        decoder.push(piece, &mut output);
    }
    (output, decoder.stats().clone())
}

/// What can happen to a word on its way.
#[derive(Clone, Debug)]
enum Fault {
    Drop,
    Double,
    Swap,
    Flip(u16),
    Insert(u16),
}

fn faults() -> impl Strategy<Value = Vec<(prop::sample::Index, Fault)>> {
    let fault = prop_oneof![
        Just(Fault::Drop),
        Just(Fault::Double),
        Just(Fault::Swap),
        (0u32..16).prop_map(|bit| Fault::Flip(1 << bit)),
        any::<u16>().prop_map(Fault::Insert),
        // Marks and region words, which random numbers seldom are.
        (0u16..20).prop_map(Fault::Insert),
        (0x5100u16..0x5400).prop_map(Fault::Insert),
    ];
    vec((any::<prop::sample::Index>(), fault), 0..40)
}

fn spoil(bytes: &[u8], faults: &[(prop::sample::Index, Fault)]) -> Vec<u8> {
    let mut words: Vec<[u8; 2]> = bytes.as_chunks().0.to_vec();
    for (index, fault) in faults {
        if words.is_empty() {
            break;
        }
        let place = index.index(words.len());
        match fault {
            Fault::Drop => drop(words.remove(place)),
            Fault::Double => words.insert(place, words[place]),
            Fault::Swap => {
                let next = (place + 1) % words.len();
                words.swap(place, next);
            }
            Fault::Flip(bit) => words[place] = (u16::from_le_bytes(words[place]) ^ bit).to_le_bytes(),
            Fault::Insert(word) => words.insert(place, word.to_le_bytes()),
        }
    }
    words.concat()
}

/// Any pieces decode as the whole does, and nothing comes out that is not paid for in words.
fn check(device: &Device, bytes: &[u8], cuts: &[prop::sample::Index]) -> Result<(), TestCaseError> {
    let whole = decode(device, [bytes]);
    let mut places: Vec<usize> = cuts.iter().map(|cut| cut.index(bytes.len() + 1)).collect();
    places.extend([0, bytes.len()]);
    places.sort_unstable();
    prop_assert_eq!(&decode(device, places.windows(2).map(|ends| &bytes[ends[0]..ends[1]])), &whole);
    prop_assert_eq!(&decode(device, bytes.chunks(1)), &whole);

    let (words, decoded) = (bytes.len() / 2, &whole.0);
    prop_assert!(decoded.events.len() + decoded.triggers.len() + 2 * decoded.imu.len() <= words);
    // Each column of a frame ends twice, whatever samples it lacks.
    let most_rows = usize::from(device.aps_rows.max(device.aps_columns));
    prop_assert!(2 * decoded.frames.iter().map(|frame| frame.pixels.len()).sum::<usize>() <= words * most_rows);
    let size = device.size();
    prop_assert!(decoded.events.iter().all(|event| event.x < size.width && event.y < size.height));
    Ok(())
}

proptest! {
    #[test]
    fn decoding_undoes_encoding((device, scene) in scenes()) {
        prop_assert_eq!(decode(&device, [&encode(&device, &scene)[..]]), (scene, Stats::default()));
    }

    #[test]
    fn packets_encode_as_one((device, scene) in scenes(), cut in 0i64..1 << 20) {
        let whole = encode(&device, &scene);
        let frame = scene.frames.iter().map(|frame| frame.t_end).max().unwrap_or(0);
        let cut = cut.max(frame);
        let (events, events_after) = scene.events.split_at(scene.events.partition_point(|event| event.t <= cut));
        let (imu, imu_after) = scene.imu.split_at(scene.imu.partition_point(|reading| reading.t <= cut));
        let (triggers, triggers_after) = scene.triggers.split_at(scene.triggers.partition_point(|trigger| trigger.t <= cut));
        let mut encoder = Encoder::new(device).unwrap();
        let first = Decoded { events: events.to_vec(), imu: imu.to_vec(), frames: scene.frames, triggers: triggers.to_vec() };
        let then = Decoded { events: events_after.to_vec(), imu: imu_after.to_vec(), frames: vec![], triggers: triggers_after.to_vec() };
        let parts = [encoder.encode(&first).unwrap(), encoder.encode(&then).unwrap()];
        prop_assert_eq!(parts.concat(), whole);
    }

    #[test]
    fn spoilt_streams_decode_alike_in_any_pieces(
        (device, scene) in scenes(),
        faults in faults(),
        cuts in vec(any::<prop::sample::Index>(), 0..8),
    ) {
        check(&device, &spoil(&encode(&device, &scene), &faults), &cuts)?;
    }

    #[test]
    fn random_bytes_decode_alike_in_any_pieces(
        device in devices(),
        bytes in vec(any::<u8>(), 0..2000),
        cuts in vec(any::<prop::sample::Index>(), 0..8),
    ) {
        check(&device, &bytes, &cuts)?;
    }
}

/// A camera sends a time once, wraps in one word, and a row once for its columns.
#[test]
fn words_are_as_the_cameras_logic_sends_them() {
    let events = [(1, 0, 0), (1, 2, 0), (1, 1, 1), (32_767, 1, 1), (32_768, 1, 1), (98_305, 1, 1)];
    let events = events.map(|(t, x, y)| Event::new(t, x, y, x == 2)).to_vec();
    let bytes = encode(&Device::new(Chip::Davis240C), &Decoded { events, ..Decoded::default() });
    let words: Vec<u16> = bytes.as_chunks().0.iter().map(|word| u16::from_le_bytes(*word)).collect();
    let expected = [
        &[0x8001, 0x1000, 0x2000, 0x3002, 0x1001, 0x2001][..],
        &[0xFFFF, 0x1001, 0x2001],
        &[0x7001, 0x1001, 0x2001],
        &[0x7002, 0x8001, 0x1001, 0x2001],
    ];
    assert_eq!(words, expected.concat());
}

/// What does not fit the camera, or comes too late, is refused with its index, and leaves no trace.
#[test]
fn what_cannot_be_sent_is_refused() {
    let device = Device::new(Chip::Davis240C);
    let event = |t, x, y| Event::new(t, x, y, true);
    let of_events = |events: &[Event]| Decoded { events: events.to_vec(), ..Decoded::default() };
    let full = Region { x: 0, y: 0, width: 240, height: 180 };
    let frame = |times: [i64; 4], region: Region, pixels| {
        let [t_start, t_exposure_start, t_exposure_end, t_end] = times;
        let pixels = vec![0; pixels];
        let frame = Frame {
            t_start,
            t_exposure_start,
            t_exposure_end,
            t_end,
            region,
            global_shutter: true,
            exposure_cycles: 0,
            pixels,
        };
        Decoded { frames: vec![frame], ..Decoded::default() }
    };
    let imu =
        |groups, range| Decoded { imu: vec![ImuReading::new(9, ImuGroups(groups), range, 0)], ..Decoded::default() };
    let reset = |t| Decoded { triggers: vec![Trigger::new(t, TriggerKind::TimestampReset)], ..Decoded::default() };
    let mut polarity = event(9, 0, 0);
    polarity.p = 2;
    let mut encoder = Encoder::new(device.clone()).unwrap();
    let first = encoder.encode(&of_events(&[event(5, 1, 1)])).unwrap();
    for (packet, rule) in [
        (of_events(&[event(9, 0, 0), event(8, 0, 0)]), "event 1 is at 8 us, after 9 us"),
        (of_events(&[event(4, 0, 0)]), "event 0 is at 4 us, after 5 us"),
        (of_events(&[event(9, 240, 0)]), "event 0: (240, 0) lies outside of 240 x 180"),
        (of_events(&[event(9, 0, 180)]), "event 0: (0, 180)"),
        (of_events(&[event(1 << 48, 0, 0)]), "2^48"),
        (of_events(&[polarity]), "event 0: polarity must be 0 or 1, got 2"),
        (frame([9, 8, 9, 9], full, 43_200), "must not decrease"),
        (frame([9; 4], full, 43_199), "frame 0: it has 43199 pixels"),
        (frame([9; 4], Region { x: 1, ..full }, 43_200), "frame 0: its region"),
        (frame([9; 4], Region { width: 0, ..full }, 0), "frame 0: its region"),
        (imu(0, 0), "IMU sample 0: groups"),
        (imu(8, 0), "IMU sample 0: groups"),
        (imu(7, 4), "IMU sample 0: ranges"),
        (reset(6), "trigger 0: a reset of the clock must come first and at 0"),
    ] {
        let error = encoder.encode(&packet).unwrap_err().to_string();
        assert!(error.contains(rule), "{error}");
    }
    let then = encoder.encode(&of_events(&[event(5, 2, 1)])).unwrap();
    assert_eq!([first, then].concat(), encode(&device, &of_events(&[event(5, 1, 1), event(5, 2, 1)])));
}
