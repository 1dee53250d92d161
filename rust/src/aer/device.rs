//! What decoder and encoder have to know of a camera: chip, sizes, orientation, inertial sensor, converter clock.
//!
//! Fields are in the terms of the camera's registers, so that a live camera's registers can be copied unchanged.
//! Numbers in parentheses are (module, parameter) of the camera's configuration.
//!
//! What must not break: on chips with x and y swapped on the wire, columns and rows are those of the wire. Only
//! [`Device::size`] and [`Device::frame_size`] are in terms of the image.

use super::imu::ImuType;
use crate::error::{Error, Result};
use crate::event::SensorSize;

/// Addresses have 12 bits.
const MAX_ADDRESSES: u16 = 1 << 12;

/// The chips whose stream is understood.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "the names are the vendor's")]
pub enum Chip {
    Davis240A,
    Davis240B,
    Davis240C,
    Davis128,
    Davis346A,
    Davis346B,
    Davis346C,
    Davis640,
}

impl Chip {
    const ALL: [(Self, &'static str, u32); 8] = [
        (Self::Davis240A, "DAVIS240A", 0),
        (Self::Davis240B, "DAVIS240B", 1),
        (Self::Davis240C, "DAVIS240C", 2),
        (Self::Davis128, "DAVIS128", 3),
        (Self::Davis346A, "DAVIS346A", 4),
        (Self::Davis346B, "DAVIS346B", 5),
        (Self::Davis346C, "DAVIS346C", 9),
        (Self::Davis640, "DAVIS640", 6),
    ];

    /// Returns the chip of a name such as `DAVIS240C`.
    ///
    /// # Errors
    /// [`Error::Argument`] for any other name.
    pub fn from_name(name: &str) -> Result<Self> {
        Self::ALL.iter().find(|(_, of, _)| *of == name).map(|(chip, ..)| *chip).ok_or_else(|| {
            let names = Self::ALL.map(|(_, name, _)| name).join(", ");
            Error::Argument(format!("a chip must be one of {names}; got {name:?}"))
        })
    }

    /// Returns the chip of the number that the camera gives (module 6, parameter 1).
    ///
    /// # Errors
    /// [`Error::Argument`] for the numbers of other chips.
    pub fn from_id(id: u32) -> Result<Self> {
        Self::ALL.iter().find(|(_, _, of)| *of == id).map(|(chip, ..)| *chip).ok_or_else(|| {
            Error::Argument(format!("chip identifier {id} is not one whose stream is understood (0 to 6 and 9 are)"))
        })
    }

    /// Returns the vendor's name.
    #[must_use]
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(chip, ..)| *chip == self).map_or("", |(_, name, _)| name)
    }
}

/// Sizes and orientation of a camera, in the terms of its registers.
///
/// On some chips x and y are swapped on the wire: columns there are then rows of the image.
#[derive(Clone, Debug, PartialEq)]
#[allow(clippy::struct_excessive_bools, reason = "one for each bit of the registers")]
pub struct Device {
    /// The chip.
    pub chip: Chip,
    /// Columns of events on the wire (1, 0).
    pub dvs_columns: u16,
    /// Rows of events on the wire (1, 1).
    pub dvs_rows: u16,
    /// Whether events have x and y swapped on the wire (1, 2, bit 2).
    pub dvs_swapped: bool,
    /// Columns of frames on the wire (2, 0).
    pub aps_columns: u16,
    /// Rows of frames on the wire (2, 1).
    pub aps_rows: u16,
    /// Whether frames have x and y swapped on the wire (2, 2, bit 2).
    pub aps_swapped: bool,
    /// Whether a frame's columns come from the last to the first (2, 2, bit 1).
    pub aps_flip_x: bool,
    /// Whether a column's samples come from the last to the first (2, 2, bit 0).
    pub aps_flip_y: bool,
    /// The inertial sensor (3, 0).
    pub imu_type: ImuType,
    /// Which of its axes x, y, z are to be negated (3, 1, bits 2, 1, 0).
    pub imu_flips: [bool; 3],
    /// Clock of the frame's converter in MHz, in which the exposure is counted (6, 4, corrected by 6, 6).
    pub adc_mhz: f64,
}

impl Device {
    /// Returns a camera with this chip as it is by default.
    #[must_use]
    pub fn new(chip: Chip) -> Self {
        let (columns, rows, swapped) = match chip {
            Chip::Davis240A | Chip::Davis240B | Chip::Davis240C => (240, 180, false),
            Chip::Davis346A | Chip::Davis346B | Chip::Davis346C => (260, 346, true),
            Chip::Davis128 => (128, 128, false),
            Chip::Davis640 => (640, 480, false),
        };
        Self {
            chip,
            dvs_columns: columns,
            dvs_rows: rows,
            dvs_swapped: swapped,
            aps_columns: columns,
            aps_rows: rows,
            aps_swapped: swapped,
            aps_flip_x: false,
            aps_flip_y: false,
            imu_type: ImuType::Mpu6050,
            imu_flips: [false; 3],
            adc_mhz: 30.0,
        }
    }

    /// Returns the size of the image that events fall on.
    #[must_use]
    pub fn size(&self) -> SensorSize {
        oriented(self.dvs_columns, self.dvs_rows, self.dvs_swapped)
    }

    /// Returns the size of a full frame.
    #[must_use]
    pub fn frame_size(&self) -> SensorSize {
        oriented(self.aps_columns, self.aps_rows, self.aps_swapped)
    }

    /// Returns whether samples of the converter count double: on these chips its reference voltages leave it half of
    /// its range.
    pub(super) fn samples_count_double(&self) -> bool {
        matches!(self.chip, Chip::Davis240A | Chip::Davis240B | Chip::Davis240C)
    }

    /// Refuses sizes that 12-bit addresses cannot reach, and a clock that is not positive.
    ///
    /// # Errors
    /// [`Error::Argument`] naming the register.
    pub(crate) fn check(&self) -> Result<()> {
        for (name, n) in [
            ("dvs_columns", self.dvs_columns),
            ("dvs_rows", self.dvs_rows),
            ("aps_columns", self.aps_columns),
            ("aps_rows", self.aps_rows),
        ] {
            if n == 0 || n > MAX_ADDRESSES {
                return Err(Error::Argument(format!("{name} must lie in 1..{MAX_ADDRESSES}, got {n}")));
            }
        }
        if !(self.adc_mhz.is_finite() && self.adc_mhz > 0.0) {
            return Err(Error::Argument(format!("adc_mhz must be positive, got {}", self.adc_mhz)));
        }
        Ok(())
    }
}

fn oriented(columns: u16, rows: u16, swapped: bool) -> SensorSize {
    if swapped { SensorSize { width: rows, height: columns } } else { SensorSize { width: columns, height: rows } }
}
