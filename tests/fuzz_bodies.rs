//! The fuzz targets' bodies on seeded mutants of good inputs: a short run of what `fuzz/` does at length.

#[path = "../fuzz/src/bodies.rs"]
#[allow(dead_code, missing_docs)]
mod bodies;
#[path = "../fuzz/src/seeds.rs"]
#[allow(missing_docs)]
mod seeds;

use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Mutants of each target; builds without optimization try fewer.
const MUTANTS: u64 = if cfg!(debug_assertions) { 300 } else { 1000 };

/// More than this, beyond what the process had before, is a finding.
const MOST_KIB: u64 = 200 << 10;

/// More processor time than this is a finding: two seconds.
const MOST_TICKS: u64 = 200;

/// Random numbers: Steele, Lea and Flood's `SplitMix64`, OOPSLA 2014.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    #[allow(clippy::cast_possible_truncation, reason = "below a usize")]
    fn below(&mut self, n: usize) -> usize {
        (self.next() % n.max(1) as u64) as usize
    }

    #[allow(clippy::cast_possible_truncation, reason = "a byte of it")]
    fn byte(&mut self) -> u8 {
        [0, 1, 0x7f, 0x80, 0xff, b'0', b'-', b'.', b'\n', self.next() as u8][self.below(10)]
    }
}

/// The input with up to eight changes: bits, bytes, words of ones or zeros, parts left out, doubled or swapped in.
fn mutant(random: &mut Random, seed: &[u8], other: &[u8]) -> Vec<u8> {
    let mut bytes = seed.to_vec();
    for _ in 0..=random.below(8) {
        let (at, length) = (random.below(bytes.len()), 1 + random.below(40));
        let end = (at + length).min(bytes.len());
        match random.below(8) {
            0 if !bytes.is_empty() => bytes[at] ^= 1 << random.below(8),
            1 if !bytes.is_empty() => bytes[at] = random.byte(),
            2 => bytes.insert(at, random.byte()),
            3 => drop(bytes.drain(at..end)),
            4 => {
                let part = bytes[at..end].to_vec();
                bytes.splice(at..at, part);
            }
            5 => bytes.truncate(at.max(2)),
            6 => {
                let (value, end) = (random.byte(), (at + 8).min(bytes.len()));
                bytes[at..end].fill(value);
            }
            _ => {
                let from = random.below(other.len());
                let part = other[from..(from + length).min(other.len())].to_vec();
                bytes.splice(at..end, part);
            }
        }
    }
    bytes
}

/// The most memory that this process has held, in KiB, since the last call; None where the system does not tell.
fn peak_kib() -> Option<u64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let peak = peak.trim().trim_end_matches(" kB").parse().ok()?;
    fs::write("/proc/self/clear_refs", "5").ok()?;
    Some(peak)
}

/// Processor time that this process has taken, in clock ticks (hundredths of a second); None where the system does not
/// tell. On a busy machine the time of a clock on the wall says little.
fn ticks() -> Option<u64> {
    let stat = fs::read_to_string("/proc/self/stat").ok()?;
    // After the name of the process, in brackets: its state, ten other fields, time in the program and in the system.
    let mut fields = stat.rsplit(')').next()?.split_whitespace().skip(11);
    let (own, of_system): (u64, u64) = (fields.next()?.parse().ok()?, fields.next()?.parse().ok()?);
    Some(own + of_system)
}

#[test]
fn no_mutant_panics_hangs_or_fills_memory() {
    for (name, body, seeds) in seeds::targets() {
        let mut random = Random(name.bytes().map(u64::from).sum());
        for seed in &seeds {
            body(seed);
        }
        println!("{name}: {MUTANTS} mutants of {} inputs", seeds.len());
        for number in 0..MUTANTS {
            let (seed, other) = (random.below(seeds.len()), random.below(seeds.len()));
            let input = mutant(&mut random, &seeds[seed], &seeds[other]);
            let (before, start) = (peak_kib(), ticks());
            let outcome = catch_unwind(AssertUnwindSafe(|| body(&input)));
            let (end, after) = (ticks(), peak_kib());
            assert!(outcome.is_ok(), "{name}, mutant {number}: it panics on {input:?}");
            if let (Some(start), Some(end)) = (start, end) {
                assert!(end < start + MOST_TICKS, "{name}, mutant {number}: {} ticks on {input:?}", end - start);
            }
            if let (Some(before), Some(after)) = (before, after) {
                assert!(after < before + MOST_KIB, "{name}, mutant {number}: {after} KiB on {input:?}");
            }
        }
    }
}
