//! The decoder against streams with what the vendor's library (libcaer 3.3.15) made of them.

use std::fs;
use std::path::PathBuf;

use davis_rs::Event;
use davis_rs::aer::{Chip, Decoded, Decoder, Device, Frame, ImuSample, STANDARD_GRAVITY, Trigger, TriggerKind};

/// The streams; none where they are not at hand.
fn streams() -> Vec<PathBuf> {
    let Ok(folder) = fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/aer")) else {
        eprintln!("no reference streams in ../shared/aer: nothing is compared");
        return Vec::new();
    };
    let files = folder.map(|entry| entry.unwrap().path());
    let mut streams: Vec<_> = files.filter(|path| path.extension().is_some_and(|e| e == "bin")).collect();
    streams.sort();
    assert_eq!(streams.len(), 8);
    streams
}

/// Rows of a kind: what follows its letter.
fn rows<'a>(csv: &'a str, kind: &str) -> impl Iterator<Item = &'a str> {
    csv.lines().filter_map(move |line| line.split_once(',').filter(|(of, _)| *of == kind).map(|(_, row)| row))
}

fn numbers(row: &str) -> Vec<i64> {
    row.split(',').map(|field| field.parse().unwrap()).collect()
}

fn event(row: &str) -> Event {
    let [t, x, y, p] = numbers(row)[..] else { panic!("{row}") };
    Event::new(t, x.try_into().unwrap(), y.try_into().unwrap(), p == 1)
}

/// The trigger of a special event; the library's own ones, of frames and of its overflow, are none.
fn trigger(row: &str) -> Option<Trigger> {
    let [t, kind, _] = numbers(row)[..] else { panic!("{row}") };
    Some(match kind {
        1 => Trigger::new(0, TriggerKind::TimestampReset),
        2 => Trigger::new(t, TriggerKind::InputRising),
        3 => Trigger::new(t, TriggerKind::InputFalling),
        4 => Trigger::new(t, TriggerKind::InputPulse),
        12 => Trigger::new(t, TriggerKind::GeneratorRising),
        13 => Trigger::new(t, TriggerKind::GeneratorFalling),
        _ => return None,
    })
}

/// Whether a sample is a row of g, deg/s and degrees Celsius, to the digits that are written.
fn is_sample(sample: &ImuSample, row: &str) -> bool {
    let fields: Vec<f64> = row.split(',').map(|field| field.parse().unwrap()).collect();
    let accel = sample.accel.map(|a| a / STANDARD_GRAVITY);
    let gyro = sample.gyro.map(f64::to_degrees);
    let values = accel.iter().chain(&gyro).chain([&sample.temperature]);
    let same_time = row.split_once(',').is_some_and(|(t, _)| t.parse() == Ok(sample.t));
    same_time && values.zip(&fields[1..]).all(|(a, b)| (a - b).abs() <= 1e-6 * b.abs().max(1.0))
}

fn is_frame(frame: &Frame, row: &str) -> bool {
    let (head, pixels) = row.rsplit_once(',').unwrap();
    let (head, _hash) = head.rsplit_once(',').unwrap();
    let region = frame.region;
    let times = [frame.t_start, frame.t_exposure_start, frame.t_exposure_end, frame.t_end];
    let place = [region.x, region.y, region.width, region.height, 1].map(i64::from);
    numbers(head) == [&times[..], &place].concat()
        && pixels.split(' ').map(|pixel| pixel.parse::<u16>().unwrap()).eq(frame.pixels.iter().copied())
}

/// Every stream decodes to what the library made of it, in pieces of any size.
#[test]
fn streams_decode_as_by_the_vendors_library() {
    for path in streams() {
        let name = path.file_stem().unwrap().to_str().unwrap();
        let device = Device::new(Chip::from_name(name.split('-').next().unwrap()).unwrap());
        let (bytes, csv) = (fs::read(&path).unwrap(), fs::read_to_string(path.with_extension("csv")).unwrap());
        for size in [1, 2, 3, 7, 4096, bytes.len()] {
            let mut decoder = Decoder::new(device.clone()).unwrap();
            let mut output = Decoded::default();
            for piece in bytes.chunks(size) {
                decoder.push(piece, &mut output);
            }
            let what = format!("{name} in pieces of {size}");
            assert!(rows(&csv, "P").map(event).eq(output.events), "events of {what}");
            assert!(rows(&csv, "S").filter_map(trigger).eq(output.triggers), "triggers of {what}");
            assert_eq!(rows(&csv, "I").count(), output.imu.len(), "inertial samples of {what}");
            for (reading, row) in output.imu.iter().zip(rows(&csv, "I")) {
                assert!(is_sample(&reading.sample(device.imu_type), row), "{reading:?} of {what}: {row}");
            }
            assert_eq!(rows(&csv, "F").count(), output.frames.len(), "frames of {what}");
            for (frame, row) in output.frames.iter().zip(rows(&csv, "F")) {
                assert!(is_frame(frame, row), "frame at {} of {what}", frame.t_start);
            }
            let oddities = decoder.stats().iter().map(|(_, count)| count).sum::<u64>();
            assert_eq!(oddities > 0, name.contains("mutate"), "{what}: {:?}", decoder.stats());
        }
    }
}
