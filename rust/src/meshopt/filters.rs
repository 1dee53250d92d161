//! What attributes go through after they are decoded. Steps are rounded to float32, so that each machine has the same
//! numbers.

use crate::error::{Error, Result};

/// A filter of `KHR_meshopt_compression`; `EXT_meshopt_compression` has all but the last.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshoptFilter {
    /// Elements are as they are.
    None,
    /// Unit vectors of two octahedral coordinates and what stands for 1; the fourth number stays.
    Octahedral,
    /// Unit quaternions of three components, and what stands for 1 with the number of the largest component.
    Quaternion,
    /// Floats of 8 bits of exponent and 24 bits of mantissa.
    Exponential,
    /// Colours of luma and two differences, with the opacity's highest bit above all others.
    Colour,
}

impl MeshoptFilter {
    /// Refuses elements of another size than the filter has.
    pub(super) fn check(self, stride: usize) -> Result<()> {
        let (name, strides) = match self {
            Self::Octahedral if !matches!(stride, 4 | 8) => ("OCTAHEDRAL", "4 or 8"),
            Self::Quaternion if stride != 8 => ("QUATERNION", "8"),
            Self::Colour if !matches!(stride, 4 | 8) => ("COLOR", "4 or 8"),
            _ => return Ok(()),
        };
        Err(Error::Argument(format!("the filter {name} needs a stride of {strides} bytes, got {stride}")))
    }

    /// Changes elements in place.
    pub(super) fn apply(self, elements: &mut [u8], stride: usize) {
        match self {
            Self::None => {}
            Self::Octahedral if stride == 4 => {
                for element in elements.as_chunks_mut::<4>().0 {
                    let [x, y, unit, _] = element.map(|byte| f32::from(byte.cast_signed()));
                    for (byte, value) in element.iter_mut().zip(vector([x, y, unit], f32::from(i8::MAX))) {
                        *byte = to_i8(value).cast_unsigned();
                    }
                }
            }
            Self::Octahedral => each_of_shorts(elements, |[x, y, unit, fourth]| {
                let [x, y, z] = vector([x, y, unit].map(f32::from), f32::from(i16::MAX)).map(to_i16);
                [x, y, z, fourth]
            }),
            Self::Quaternion => each_of_shorts(elements, quaternion),
            Self::Exponential => {
                for number in elements.as_chunks_mut::<4>().0 {
                    let given = i32::from_le_bytes(*number);
                    *number = to_float(given << 8 >> 8, given >> 24).to_le_bytes();
                }
            }
            Self::Colour if stride == 4 => {
                for element in elements.as_chunks_mut::<4>().0 {
                    let [luma, orange, green, opacity] = *element;
                    let [orange, green] = [orange, green].map(|byte| i32::from(byte.cast_signed()));
                    *element = colour(i32::from(luma), orange, green, opacity.into(), 255.0).map(to_u8);
                }
            }
            Self::Colour => each_of_shorts(elements, |[luma, orange, green, opacity]| {
                let [luma, opacity] = [luma, opacity].map(i16::cast_unsigned);
                colour(luma.into(), orange.into(), green.into(), opacity.into(), 65535.0)
                    .map(|value| to_u16(value).cast_signed())
            }),
        }
    }
}

/// Changes elements of four numbers of 16 bits.
fn each_of_shorts(elements: &mut [u8], change: impl Fn([i16; 4]) -> [i16; 4]) {
    for element in elements.as_chunks_mut::<8>().0 {
        let given = element.as_chunks::<2>().0;
        let changed = change([0, 1, 2, 3].map(|at| i16::from_le_bytes(given[at]))).map(i16::to_le_bytes);
        element.copy_from_slice(changed.as_flattened());
    }
}

/// Returns the vector that two octahedral coordinates and what stands for 1 mean, `one` long.
fn vector([x, y, unit]: [f32; 3], one: f32) -> [f32; 3] {
    let unit = if unit == 0.0 { 1.0 } else { unit };
    let (x, y) = (x / unit, y / unit);
    let z = 1.0 - (x.abs() + y.abs());
    let folded = z.min(0.0);
    let vector = [x - folded.copysign(x), y - folded.copysign(y), z];
    let [xx, yy, zz] = vector.map(|value| value * value);
    let length = (xx + yy + zz).sqrt();
    let length = if length == 0.0 { 1.0 } else { length };
    vector.map(|value| (value / length * one).round_ties_even())
}

/// Returns the quaternion of which the largest component was left out.
fn quaternion([x, y, z, unit]: [i16; 4]) -> [i16; 4] {
    let one = f32::from(unit | 3);
    let small = [x, y, z].map(|value| f32::from(value) / one * std::f32::consts::FRAC_1_SQRT_2);
    let [xx, yy, zz] = small.map(|value| value * value);
    let largest = (1.0 - (xx + yy + zz)).max(0.0).sqrt();
    let [x, y, z, w] = [small[0], small[1], small[2], largest].map(|value| to_i16((value * 32767.0).round_ties_even()));
    match unit & 3 {
        0 => [w, x, y, z],
        1 => [z, w, x, y],
        2 => [y, z, w, x],
        _ => [x, y, z, w],
    }
}

/// Returns red, green, blue and opacity, `one` being the brightest.
#[allow(clippy::cast_precision_loss, reason = "of 18 bits at most")]
fn colour(luma: i32, orange: i32, green: i32, opacity: u32, one: f32) -> [f32; 4] {
    // All numbers have as many bits as the opacity, of which the highest is set and says so.
    let most = ((1u32 << (u32::BITS - opacity.leading_zeros())) - 1).max(1);
    let opacity = opacity & most >> 1;
    let scale = one / most as f32;
    let rgb = [luma + orange - green, luma + green, luma - orange - green].map(|value| value as f32);
    [rgb[0], rgb[1], rgb[2], (opacity << 1 | opacity & 1) as f32].map(|value| (value * scale).round())
}

/// Returns mantissa x 2^exponent, for 24 and 8 bits of them: exact, or infinite.
#[allow(clippy::cast_possible_truncation, reason = "infinite where it is too large")]
fn to_float(mantissa: i32, exponent: i32) -> f32 {
    (f64::from(mantissa) * 2f64.powi(exponent)) as f32
}

#[allow(clippy::cast_possible_truncation, reason = "clipped")]
fn to_i16(value: f32) -> i16 {
    value as i16
}

#[allow(clippy::cast_possible_truncation, reason = "clipped")]
fn to_i8(value: f32) -> i8 {
    value as i8
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clipped")]
fn to_u16(value: f32) -> u16 {
    value as u16
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clipped")]
fn to_u8(value: f32) -> u8 {
    value as u8
}
