//! events.txt, written and read in memory: events a second.

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use davis_rs::{Event, EventReader, EventWriter, Limits, TextDecoder, TextEncoder};

/// A million events, a microsecond or none apart, spread over a DAVIS240.
fn events() -> Vec<Event> {
    (0..1_000_000u32)
        .map(|i| {
            let mixed = i.wrapping_mul(2_654_435_761);
            let (x, y) = ((mixed >> 8) % 240, (mixed >> 16) % 180);
            #[allow(clippy::cast_possible_truncation, reason = "below the sensor's sides")]
            Event::new(i64::from(i) * 3 / 4, x as u16, y as u16, mixed & 64 != 0)
        })
        .collect()
}

fn text(events: &[Event]) -> Vec<u8> {
    let sink = Vec::with_capacity(30 * events.len());
    let mut writer = EventWriter::new(sink, TextEncoder::new(Limits::NONE)).expect("memory");
    writer.write(events).expect("valid");
    writer.finish().expect("memory")
}

fn parsed(text: &[u8]) -> Vec<Event> {
    let mut events = Vec::new();
    EventReader::new(text, TextDecoder::new()).read(usize::MAX, &mut events).expect("valid");
    events
}

fn events_text(c: &mut Criterion) {
    let events = events();
    let written = text(&events);
    let mut group = c.benchmark_group("events.txt");
    group.throughput(Throughput::Elements(events.len() as u64));
    group.sample_size(20);
    group.bench_function("write", |b| b.iter(|| text(black_box(&events))));
    group.bench_function("read", |b| b.iter(|| parsed(black_box(&written))));
    group.finish();
}

criterion_group!(benches, events_text);
criterion_main!(benches);
