//! Packets of many small records: events, inertial samples, triggers.

use super::flatbuffer::{Flatbuffer, Table};
use crate::event::Event;

/// An inertial sample in the file's units.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Aedat4Imu {
    /// Microseconds since 1970.
    pub t: i64,
    /// Degrees Celsius.
    pub temperature: f32,
    /// Acceleration along x, y, z in g.
    pub accel: [f32; 3],
    /// Rotation about x, y, z in degrees a second.
    pub gyro: [f32; 3],
}

/// Something that happened at a connector, or to the camera's clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Aedat4Trigger {
    /// Microseconds since 1970.
    pub t: i64,
    /// What happened, in the format's numbers: 0 reset of the clock, 1 the input rose, 2 fell, 3 pulsed, 4 the
    /// generator rose, 5 fell; others tell of frames.
    pub kind: i8,
}

/// Returns the flatbuffer at the beginning of a packet, of which it names the kind.
pub(super) fn buffer<'a>(bytes: &'a [u8], identifier: &str) -> Result<Flatbuffer<'a>, String> {
    let buffer = Flatbuffer::with_size(bytes)
        .ok_or_else(|| format!("a packet of {} bytes must hold a flatbuffer, and ends before it does", bytes.len()))?;
    if buffer.identifier() != Some(identifier.as_bytes()) {
        return Err(broken(identifier));
    }
    Ok(buffer)
}

pub(super) fn broken(identifier: &str) -> String {
    format!("a packet must be an {identifier} flatbuffer whose parts lie within it")
}

pub(super) fn events(bytes: &[u8], out: &mut Vec<Event>) -> Result<(), String> {
    let buffer = buffer(bytes, "EVTS")?;
    let records = || -> Option<&[[u8; 16]]> {
        let Some(elements) = buffer.field(buffer.root()?, 0) else { return Some(&[]) };
        Some(buffer.vector(elements, 16)?.as_chunks().0)
    };
    let records = records().ok_or_else(|| broken("EVTS"))?;
    out.reserve(records.len());
    for record in records {
        let [t @ .., _, _, _, _, _, _, _, _] = record;
        let [.., x0, x1, y0, y1, p, _, _, _] = *record;
        let (x, y) = (u16::from_le_bytes([x0, x1]), u16::from_le_bytes([y0, y1]));
        out.push(Event::new(i64::from_le_bytes(*t), x, y, p != 0));
    }
    Ok(())
}

pub(super) fn imu(bytes: &[u8], limit: usize, out: &mut Vec<Aedat4Imu>) -> Result<(), String> {
    let buffer = buffer(bytes, "IMUS")?;
    each(buffer, "IMUS", limit, out, |table| {
        let value = |index| buffer.number(table, index, f32::from_le_bytes, 0.0);
        Some(Aedat4Imu {
            t: buffer.number(table, 0, i64::from_le_bytes, 0)?,
            temperature: value(1)?,
            accel: [value(2)?, value(3)?, value(4)?],
            gyro: [value(5)?, value(6)?, value(7)?],
        })
    })
}

pub(super) fn triggers(bytes: &[u8], limit: usize, out: &mut Vec<Aedat4Trigger>) -> Result<(), String> {
    let buffer = buffer(bytes, "TRIG")?;
    each(buffer, "TRIG", limit, out, |table| {
        Some(Aedat4Trigger {
            t: buffer.number(table, 0, i64::from_le_bytes, 0)?,
            kind: buffer.number(table, 1, i8::from_le_bytes, 0)?,
        })
    })
}

/// Appends a record for each table of the root's vector. Tables may lie on top of each other, so that what they become
/// is limited, too.
fn each<T>(
    buffer: Flatbuffer<'_>,
    identifier: &str,
    limit: usize,
    out: &mut Vec<T>,
    record: impl Fn(Table) -> Option<T>,
) -> Result<(), String> {
    let root = buffer.root().ok_or_else(|| broken(identifier))?;
    let Some(elements) = buffer.field(root, 0) else { return Ok(()) };
    let tables = buffer.tables(elements).ok_or_else(|| broken(identifier))?;
    if tables.len().saturating_mul(size_of::<T>()) > limit {
        return Err(super::unpack::above(limit));
    }
    out.reserve(tables.len());
    for table in tables {
        out.push(table.and_then(&record).ok_or_else(|| broken(identifier))?);
    }
    Ok(())
}
