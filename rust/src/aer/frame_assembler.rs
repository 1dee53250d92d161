//! Assembles frames of the active pixels (APS) from the samples of their two reads.
//!
//! Each pixel is read twice, after its reset and after the exposure. The difference is its intensity (correlated double
//! sampling). A read goes column by column: a start mark, samples from the first row on, an end mark.
//!
//! Samples are gathered in the order of the wire. At the frame's end they are subtracted and put into the rows of the
//! image, in the chip's orientation. This is one pass over memory instead of a scattered write for each sample.
//!
//! What must not break:
//! - A malformed frame is dropped and counted. Samples that a column lacks read 0 and are counted.
//! - A frame comes out only if its region came whole, once and before the samples, and if both reads saw every column
//!   once.
//! - No word makes an index go out of range, and memory grows only with a region that lies on the sensor.

use super::device::Device;
use super::frame::{Frame, MIN_RESET, PIXEL_SHIFT, Region, WHITE};
use super::stats::Stats;
use super::word::{LOW_10, LOW_12};
use crate::event::SensorSize;

/// The number of ten-bit words that carry a frame's exposure.
pub(super) const EXPOSURE_WORDS: u32 = 3;

/// The two reads of a frame.
#[derive(Clone, Copy, Default)]
pub(super) enum Read {
    #[default]
    Reset,
    Signal,
}

/// The samples of one read, in the order of the wire.
#[derive(Default)]
struct ReadSamples {
    samples: Vec<u16>,
    /// Columns that ended.
    columns: usize,
    /// The row that comes next; it goes on counting after a column's end, until the next one's start.
    row: usize,
    /// Rows that are filled of the column that is to end next.
    filled: usize,
}

/// Assembles one frame after the other.
#[allow(clippy::struct_excessive_bools, reason = "the bits of the device's orientation")]
pub(super) struct FrameAssembler {
    size: SensorSize,
    swapped: bool,
    flip_x: bool,
    flip_y: bool,
    /// Whether samples count double (see [`Device::samples_count_double`]).
    double: bool,
    /// The frame that has begun, if any.
    open: Option<OpenFrame>,
    read: Read,
    reset: ReadSamples,
    signal: ReadSamples,
}

/// A frame that has begun and not ended.
struct OpenFrame {
    t: i64,
    global_shutter: bool,
    exposure_start: Option<i64>,
    exposure_end: Option<i64>,
    exposure_words: u32,
    exposure_cycles: u32,
    region_high: u16,
    /// Start column, start row, end column, end row, in terms of the image.
    bounds: [u16; 4],
    bounds_seen: usize,
    region: RegionState,
    /// Columns and rows of the region on the wire.
    columns: usize,
    rows: usize,
}

/// A region must come whole, once, before the samples.
#[derive(Clone, Copy)]
enum RegionState {
    Awaited,
    Good(Region),
    Bad,
}

impl FrameAssembler {
    pub(super) fn new(device: &Device) -> Self {
        Self {
            size: device.frame_size(),
            swapped: device.aps_swapped,
            flip_x: device.aps_flip_x,
            flip_y: device.aps_flip_y,
            double: device.samples_count_double(),
            open: None,
            read: Read::default(),
            reset: ReadSamples::default(),
            signal: ReadSamples::default(),
        }
    }

    pub(super) fn start(&mut self, t: i64, global_shutter: bool, stats: &mut Stats) {
        self.abandon(stats);
        self.read = Read::Reset;
        for reading in [&mut self.reset, &mut self.signal] {
            (reading.columns, reading.row, reading.filled) = (0, 0, 0);
        }
        self.open = Some(OpenFrame {
            t,
            global_shutter,
            exposure_start: None,
            exposure_end: None,
            exposure_words: 0,
            exposure_cycles: 0,
            region_high: 0,
            bounds: [0; 4],
            bounds_seen: 0,
            region: RegionState::Awaited,
            columns: 0,
            rows: 0,
        });
    }

    /// Drops the open frame. Words are strays until the next start.
    pub(super) fn abandon(&mut self, stats: &mut Stats) {
        stats.frames_unended += u64::from(self.open.take().is_some());
    }

    /// Returns the open frame; without one the word is counted as a stray.
    fn open_frame(&mut self, stats: &mut Stats) -> Option<&mut OpenFrame> {
        stats.frame_stray_words += u64::from(self.open.is_none());
        self.open.as_mut()
    }

    pub(super) fn exposure_start(&mut self, t: i64, stats: &mut Stats) {
        if let Some(open) = self.open_frame(stats) {
            open.exposure_start = Some(t);
        }
    }

    pub(super) fn exposure_end(&mut self, t: i64, stats: &mut Stats) {
        if let Some(open) = self.open_frame(stats) {
            open.exposure_end = Some(t);
        }
    }

    pub(super) fn exposure_word(&mut self, word: u16, stats: &mut Stats) {
        let Some(open) = self.open_frame(stats) else { return };
        if open.exposure_words == EXPOSURE_WORDS {
            stats.exposure_words_extra += 1;
            return;
        }
        open.exposure_cycles |= u32::from(word & LOW_10) << (10 * open.exposure_words);
        open.exposure_words += 1;
    }

    pub(super) fn region_high(&mut self, byte: u16, stats: &mut Stats) {
        let Some(open) = self.open_frame(stats) else { return };
        open.region_high = byte << 8;
        if !matches!(open.region, RegionState::Awaited) {
            open.region = RegionState::Bad;
        }
    }

    pub(super) fn region_low(&mut self, byte: u16, stats: &mut Stats) {
        let (size, swapped) = (self.size, self.swapped);
        let Some(open) = self.open_frame(stats) else { return };
        if !matches!(open.region, RegionState::Awaited) {
            open.region = RegionState::Bad;
            return;
        }
        open.bounds[open.bounds_seen] = open.region_high | byte;
        open.bounds_seen += 1;
        if open.bounds_seen < open.bounds.len() {
            return;
        }
        let [x, y, last_x, last_y] = open.bounds;
        if x > last_x || y > last_y || last_x >= size.width || last_y >= size.height {
            open.region = RegionState::Bad;
            return;
        }
        let region = Region { x, y, width: last_x - x + 1, height: last_y - y + 1 };
        let (width, height) = (usize::from(region.width), usize::from(region.height));
        (open.columns, open.rows) = if swapped { (height, width) } else { (width, height) };
        open.region = RegionState::Good(region);
        for reading in [&mut self.reset, &mut self.signal] {
            // Old samples need no clearing: each is overwritten before it is used.
            reading.samples.resize(region.pixels().max(reading.samples.len()), 0);
        }
    }

    pub(super) fn column_start(&mut self, read: Read, stats: &mut Stats) {
        if self.open_frame(stats).is_some() {
            self.close_region();
            self.read = read;
            self.current().row = 0;
        }
    }

    pub(super) fn column_end(&mut self, stats: &mut Stats) {
        if self.open_frame(stats).is_none() {
            return;
        }
        self.close_region();
        let Some((columns, rows)) = self.extent() else { return };
        let reading = self.current();
        if reading.columns < columns {
            let column = &mut reading.samples[reading.columns * rows..][..rows];
            stats.samples_missing += (rows - reading.filled) as u64;
            column[reading.filled..].fill(0);
        }
        reading.columns += 1;
        reading.filled = 0;
    }

    /// Returns whether samples would be of use now.
    pub(super) fn takes_samples(&mut self) -> bool {
        self.extent().is_some_and(|(columns, _)| self.current().columns < columns)
    }

    /// Takes consecutive samples, as words.
    pub(super) fn samples(&mut self, words: &[[u8; 2]], stats: &mut Stats) {
        if self.open.is_none() {
            stats.frame_stray_words += words.len() as u64;
            return;
        }
        self.close_region();
        let Some((columns, rows)) = self.extent() else { return };
        let reading = self.current();
        let left = if reading.columns < columns { rows - reading.row } else { 0 };
        let (words, extra) = words.split_at(left.min(words.len()));
        stats.samples_extra += extra.len() as u64;
        if !words.is_empty() {
            let target = &mut reading.samples[reading.columns * rows + reading.row..][..words.len()];
            for (sample, word) in target.iter_mut().zip(words) {
                *sample = u16::from_le_bytes(*word) & LOW_12;
            }
            reading.row += words.len();
            reading.filled = reading.filled.max(reading.row);
        }
    }

    pub(super) fn end(&mut self, t: i64, stats: &mut Stats) -> Option<Frame> {
        self.open_frame(stats)?;
        let open = self.open.take()?;
        let RegionState::Good(region) = open.region else {
            stats.frames_bad_region += 1;
            return None;
        };
        if self.reset.columns != open.columns || self.signal.columns != open.columns {
            stats.frames_wrong_columns += 1;
            return None;
        }
        if open.exposure_start.is_none() || open.exposure_end.is_none() {
            stats.exposure_marks_missing += 1;
        }
        let t_exposure_start = open.exposure_start.unwrap_or(open.t);
        Some(Frame {
            t_start: open.t,
            t_exposure_start,
            t_exposure_end: open.exposure_end.unwrap_or(t_exposure_start),
            t_end: t,
            region,
            global_shutter: open.global_shutter,
            exposure_cycles: open.exposure_cycles,
            pixels: self.pixels(region, open.rows),
        })
    }

    fn current(&mut self) -> &mut ReadSamples {
        match self.read {
            Read::Reset => &mut self.reset,
            Read::Signal => &mut self.signal,
        }
    }

    /// Returns columns and rows of the open frame on the wire, if its region is good.
    fn extent(&self) -> Option<(usize, usize)> {
        self.open.as_ref().filter(|open| matches!(open.region, RegionState::Good(_))).map(|b| (b.columns, b.rows))
    }

    /// Ends the region, because columns have begun: one that has not come whole comes too late.
    fn close_region(&mut self) {
        if let Some(open) = self.open.as_mut().filter(|open| matches!(open.region, RegionState::Awaited)) {
            open.region = RegionState::Bad;
        }
    }

    /// Returns the image of the two reads, row by row.
    fn pixels(&mut self, region: Region, rows: usize) -> Vec<u16> {
        let (reset, levels) = (&self.reset.samples[..region.pixels()], &mut self.signal.samples[..region.pixels()]);
        let shift = u32::from(self.double);
        for (level, reset) in levels.iter_mut().zip(reset) {
            *level = intensity(reset << shift, *level << shift) << PIXEL_SHIFT;
        }
        to_image_order(levels, rows, (self.swapped, self.flip_x, self.flip_y))
    }
}

/// Returns the intensity of a pixel, in 0..=1023, from its two samples.
fn intensity(reset: u16, signal: u16) -> u16 {
    if reset < MIN_RESET || signal == 0 { WHITE } else { reset.saturating_sub(signal).min(WHITE) }
}

/// Turns values in the order of the wire (columns of `rows` each) into the rows of the image.
fn to_image_order(values: &[u16], rows: usize, (swapped, flip_x, flip_y): (bool, bool, bool)) -> Vec<u16> {
    let columns = values.len() / rows;
    let mut image = Vec::with_capacity(values.len());
    if swapped {
        for column in 0..columns {
            let column = &values[rows * if flip_x { columns - 1 - column } else { column }..][..rows];
            if flip_y { image.extend(column.iter().rev()) } else { image.extend_from_slice(column) }
        }
    } else {
        for row in 0..rows {
            let row = values[if flip_y { rows - 1 - row } else { row }..].iter().step_by(rows);
            if flip_x { image.extend(row.rev()) } else { image.extend(row) }
        }
    }
    image
}

/// Returns the inverse of [`to_image_order`].
pub(super) fn to_wire_order(image: &[u16], rows: usize, (swapped, flip_x, flip_y): (bool, bool, bool)) -> Vec<u16> {
    if swapped {
        // Columns of the wire are rows of the image.
        to_image_order(image, rows, (true, flip_x, flip_y))
    } else {
        // A transposed image transposed again is the image; what was flipped along x is now flipped along y.
        to_image_order(image, image.len() / rows, (false, flip_y, flip_x))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intensity_is_the_difference_of_two_good_samples() {
        assert_eq!(intensity(600, 500), 100);
        assert_eq!(intensity(500, 600), 0);
        assert_eq!(intensity(4095, 1), 1023);
        assert_eq!(intensity(383, 300), 1023);
        assert_eq!(intensity(384, 300), 84);
        assert_eq!(intensity(700, 0), 1023);
    }

    #[test]
    fn every_orientation_puts_each_sample_at_its_place_and_back() {
        let (columns, rows) = (3, 2);
        let wire: Vec<u16> = (0..6).collect();
        for (bits, expected) in [
            (0, [0, 2, 4, 1, 3, 5]),
            (1, [1, 3, 5, 0, 2, 4]),
            (2, [4, 2, 0, 5, 3, 1]),
            (4, [0, 1, 2, 3, 4, 5]),
            (5, [1, 0, 3, 2, 5, 4]),
            (6, [4, 5, 2, 3, 0, 1]),
            (7, [5, 4, 3, 2, 1, 0]),
        ] {
            let orientation = (bits & 4 != 0, bits & 2 != 0, bits & 1 != 0);
            let image = to_image_order(&wire, rows, orientation);
            assert_eq!(image, expected, "orientation {bits} of {columns} columns");
            assert_eq!(to_wire_order(&image, rows, orientation), wire, "orientation {bits}");
        }
    }
}
