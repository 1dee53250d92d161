//! The decoder against streams with what the vendor's library (libcaer 3.3.15) made of them.

use std::fs;
use std::path::PathBuf;

use davis_rs::Event;
use davis_rs::aer::{Chip, Decoded, Decoder, Device, STANDARD_GRAVITY, TriggerKind};

/// Where the streams lie; without them there is nothing to compare with.
fn streams() -> Option<PathBuf> {
    let folders =
        [concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/aer"), concat!(env!("CARGO_MANIFEST_DIR"), "/shared/aer")];
    let found = folders.into_iter().map(PathBuf::from).find(|folder| folder.is_dir());
    if found.is_none() {
        eprintln!("no reference streams in ../shared/aer: not compared");
    }
    found
}

fn decode(device: &Device, bytes: &[u8], chunk: usize) -> (Decoded, Decoder) {
    let mut decoder = Decoder::new(device.clone()).unwrap();
    let mut decoded = Decoded::default();
    for piece in bytes.chunks(chunk) {
        decoder.push(piece, &mut decoded);
    }
    (decoded, decoder)
}

/// Rows of one kind: what follows the letter.
fn rows<'a>(csv: &'a str, kind: &str) -> Vec<&'a str> {
    csv.lines().filter_map(|line| line.split_once(',').filter(|(k, _)| *k == kind).map(|(_, row)| row)).collect()
}

fn event(row: &str) -> Event {
    let [t, x, y, p] = numbers(row)[..] else { panic!("{row}") };
    Event::new(t, x.try_into().unwrap(), y.try_into().unwrap(), p == 1)
}

fn numbers(row: &str) -> Vec<i64> {
    row.split(',').map(|field| field.parse().unwrap()).collect()
}

/// The library's number of a trigger.
fn special(kind: TriggerKind) -> i64 {
    match kind {
        TriggerKind::TimestampReset => 1,
        TriggerKind::InputRising => 2,
        TriggerKind::InputFalling => 3,
        TriggerKind::InputPulse => 4,
        TriggerKind::GeneratorRising => 12,
        TriggerKind::GeneratorFalling => 13,
    }
}

fn compare(name: &str, csv: &str, decoded: &Decoded, decoder: &Decoder) {
    let device = decoder.device();
    let expected: Vec<Event> = rows(csv, "P").into_iter().map(event).collect();
    for (i, (a, b)) in decoded.events.iter().zip(&expected).enumerate() {
        if a != b {
            println!("{name}: event {i} {a:?} {b:?}");
            break;
        }
    }
    println!("{name}: {} events, {} expected, {:?}", decoded.events.len(), expected.len(), decoder.stats());

    let triggers: Vec<_> =
        rows(csv, "S").into_iter().map(numbers).filter(|s| matches!(s[1], 1..=4 | 12 | 13)).collect();
    println!("{} triggers, {} expected", decoded.triggers.len(), triggers.len());
    for (trigger, row) in decoded.triggers.iter().zip(&triggers) {
        let t = if row[1] == 1 { 0 } else { row[0] };
        if (trigger.t, special(trigger.kind)) != (t, row[1]) {
            println!("{trigger:?} {row:?}")
        }
    }

    let imu = rows(csv, "I");
    println!("{} imu {} expected", decoded.imu.len(), imu.len());
    for (reading, row) in decoded.imu.iter().zip(imu) {
        println!("{row} {:?}", reading.sample(device.imu_type));
    }
    let frames = rows(csv, "F");
    println!("{} frames {} expected", decoded.frames.len(), frames.len());
    for (frame, row) in decoded.frames.iter().zip(frames) {
        let (head, pixels) = row.rsplit_once(',').unwrap();
        let pixels: Vec<u16> = pixels.split(' ').map(|p| p.parse().unwrap()).collect();
        println!(
            "{head} {} {} {} {} {:?} differing {}",
            frame.t_start,
            frame.t_exposure_start,
            frame.t_exposure_end,
            frame.t_end,
            frame.region,
            pixels.iter().zip(&frame.pixels).filter(|(a, b)| a != b).count()
        );
        let _ = STANDARD_GRAVITY;
    }
}

#[test]
fn streams_decode_as_the_vendors_library_decodes_them() {
    let Some(folder) = streams() else { return };
    let mut names: Vec<_> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|e| e == "bin"))
        .collect();
    names.sort();
    for path in names {
        let name = path.file_stem().unwrap().to_str().unwrap();
        let chip = Chip::from_name(name.split('-').next().unwrap()).unwrap();
        let device = Device::new(chip);
        let csv = fs::read_to_string(path.with_extension("csv")).unwrap();
        let bytes = fs::read(&path).unwrap();
        let (decoded, decoder) = decode(&device, &bytes, usize::MAX);
        compare(name, &csv, &decoded, &decoder);
    }
}
