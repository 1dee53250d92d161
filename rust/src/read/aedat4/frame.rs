//! Packets of one frame each.

use super::records::{broken, buffer};

/// Weights of red, green and blue in an intensity (ITU-R BT.601).
const WEIGHTS: [f64; 3] = [0.299, 0.587, 0.114];

/// An intensity image with its times in microseconds since 1970.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Aedat4Frame {
    /// When the camera began with it.
    pub t_start: i64,
    /// When the exposure began.
    pub t_exposure_start: i64,
    /// When the exposure ended.
    pub t_exposure_end: i64,
    /// When its last sample was read.
    pub t_end: i64,
    /// First column of the sensor.
    pub x: u16,
    /// First row.
    pub y: u16,
    /// Columns.
    pub width: u16,
    /// Rows.
    pub height: u16,
    /// Intensities of 16 bits, row by row; of 8 bits the upper ones, of colours the weighted sum.
    pub pixels: Vec<u16>,
}

pub(super) fn frame(bytes: &[u8]) -> Result<Aedat4Frame, String> {
    let buffer = buffer(bytes, "FRME")?;
    let root = buffer.root().ok_or_else(|| broken("FRME"))?;
    let read = || -> Option<_> {
        let time = |index| buffer.number(root, index, i64::from_le_bytes, 0);
        let side = |index| buffer.number(root, index, i16::from_le_bytes, 0);
        let values = match buffer.field(root, 10) {
            Some(offset) => buffer.vector(offset, 1)?,
            None => &[],
        };
        let times = [time(0)?, time(1)?, time(2)?, time(3)?, time(4)?, time(11)?];
        let form = buffer.number(root, 5, i8::from_le_bytes, 0)?;
        Some((times, form, [side(6)?, side(7)?, side(8)?, side(9)?], values))
    };
    let ([t, start, end, exposed, covered, exposure], form, sides, values) = read().ok_or_else(|| broken("FRME"))?;
    // A type of OpenCV: in its low bits the depth, above it the number of channels less one.
    let (depth, channels) = (form & 7, (form >> 3) + 1);
    let (Some(bytes), Ok(channels @ (1 | 3 | 4))) = (
        match depth {
            0 => Some(1),
            2 => Some(2),
            _ => None,
        },
        usize::try_from(channels),
    ) else {
        return Err(format!("frames must have 8 or 16 bits in 1, 3 or 4 channels, found OpenCV's type {form}"));
    };
    let [width, height, x, y] = sides.map(|side| u16::try_from(side).ok());
    let (Some(width @ 1..), Some(height @ 1..), Some(x), Some(y), true) =
        (width, height, x, y, fits(sides, channels * bytes, values))
    else {
        let [width, height, x, y] = sides;
        return Err(format!(
            "{} bytes do not make {width} x {height} pixels of type {form} at ({x}, {y})",
            values.len()
        ));
    };
    let samples: Vec<u16> = if bytes == 2 {
        values.as_chunks().0.iter().map(|&sample| u16::from_le_bytes(sample)).collect()
    } else {
        values.iter().map(|&sample| u16::from(sample) << 8).collect()
    };
    let pixels = if channels == 1 { samples } else { samples.chunks_exact(channels).map(grey).collect() };
    // Newer files have the exposure's start and its length alone.
    let or = |time: i64, other: i64| if time == 0 { other } else { time };
    let t_exposure_start = or(exposed, t);
    let t_exposure_end = if covered == 0 {
        let end = t_exposure_start.checked_add(exposure);
        end.ok_or_else(|| format!("an exposure of {exposure} us from {t_exposure_start} us on has no end"))?
    } else {
        covered
    };
    let (t_start, t_end) = (or(start, t_exposure_start), or(end, t_exposure_end));
    Ok(Aedat4Frame { t_start, t_exposure_start, t_exposure_end, t_end, x, y, width, height, pixels })
}

fn fits([width, height, ..]: [i16; 4], pixel: usize, values: &[u8]) -> bool {
    let [width, height] = [width, height].map(|side| usize::try_from(side).unwrap_or(0));
    width * height * pixel == values.len()
}

/// Returns the intensity of a pixel whose colours come as blue, green, red.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a mean of 16 bits")]
fn grey(pixel: &[u16]) -> u16 {
    let [blue, green, red] = [0, 1, 2].map(|channel| f64::from(pixel[channel]));
    (WEIGHTS[0] * red + WEIGHTS[1] * green + WEIGHTS[2] * blue).round_ties_even() as u16
}
