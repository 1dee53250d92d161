//! Inertial samples (IMU): their raw and SI forms, and their assembly from bytes of the wire.
//!
//! A sample is up to seven 16-bit numbers, high byte first: acceleration, temperature and rotation. Each of these
//! groups may be absent. Raw counts ([`ImuReading`]) and SI units ([`ImuSample`]) are both available, because counts
//! are exact and can be sent again.
//!
//! What must not break:
//! - A sample of the wrong length or without a scale is dropped and counted, never guessed.
//! - A reading that is converted to SI units and back is the same reading.
//! - The layouts are those of Python's dtypes, which read these arrays in place.

use super::stats::Stats;

/// Standard gravity in m/s^2 (CGPM 1901).
pub const STANDARD_GRAVITY: f64 = 9.806_65;

/// The most bytes that a sample may have.
const MAX_BYTES: u8 = 14;

/// The inertial sensor of a camera; they differ in how temperature is counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImuType {
    /// `InvenSense` MPU-6050 and its family.
    Mpu6050,
    /// `InvenSense` MPU-9250.
    Mpu9250,
}

impl ImuType {
    /// Returns the sensor of the number that the camera gives (module 3, parameter 0): 2, or the 6050's family.
    #[must_use]
    pub fn of(number: u32) -> Self {
        if number == 2 { Self::Mpu9250 } else { Self::Mpu6050 }
    }

    /// Counts per degree, and the temperature at 0 counts.
    fn temperature(self) -> (f64, f64) {
        match self {
            Self::Mpu6050 => (340.0, 35.0),
            Self::Mpu9250 => (333.87, 21.0),
        }
    }
}

/// Which groups a sample holds: bits 4 acceleration, 2 rotation, 1 temperature.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImuGroups(pub u8);

impl ImuGroups {
    /// Acceleration, rotation and temperature.
    pub const ALL: Self = Self(7);

    /// Returns whether acceleration is there.
    #[must_use]
    pub const fn accel(self) -> bool {
        self.0 & 4 != 0
    }

    /// Returns whether rotation is there.
    #[must_use]
    pub const fn gyro(self) -> bool {
        self.0 & 2 != 0
    }

    /// Returns whether temperature is there.
    #[must_use]
    pub const fn temperature(self) -> bool {
        self.0 & 1 != 0
    }

    /// Returns the bytes that a sample then has.
    pub(super) fn bytes(self) -> u8 {
        6 * u8::from(self.accel()) + 2 * u8::from(self.temperature()) + 6 * u8::from(self.gyro())
    }
}

/// An inertial sample in counts of the sensor, in 32 bytes; groups that it lacks are 0.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImuReading {
    /// Microseconds; the time of its end.
    pub t: i64,
    /// Acceleration along x, y, z.
    pub accel: [i16; 3],
    /// Rotation about x, y, z.
    pub gyro: [i16; 3],
    /// Temperature.
    pub temperature: i16,
    /// The groups it holds.
    pub groups: ImuGroups,
    /// Full scale of acceleration, 0..3: 2, 4, 8, 16 g.
    pub accel_range: u8,
    /// Full scale of rotation, 0..3: 250, 500, 1000, 2000 deg/s.
    pub gyro_range: u8,
    /// Padding written out, so that equal readings are equal bytes.
    pub(crate) padding: [u8; 7],
}

/// An inertial sample in SI units; groups that it lacks are 0.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuSample {
    /// Microseconds; the time of its end.
    pub t: i64,
    /// Acceleration along x, y, z in m/s^2.
    pub accel: [f64; 3],
    /// Rotation about x, y, z in rad/s.
    pub gyro: [f64; 3],
    /// Temperature in degrees Celsius.
    pub temperature: f64,
}

/// Returns the m/s^2 of one count.
fn accel_unit(range: u8) -> f64 {
    f64::from(4u32 << (range & 3)) / 65_536.0 * STANDARD_GRAVITY
}

/// Returns the rad/s of one count.
fn gyro_unit(range: u8) -> f64 {
    (f64::from(500u32 << (range & 3)) / 65_536.0).to_radians()
}

/// Rounds to the nearest count; beyond the range it saturates.
#[allow(clippy::cast_possible_truncation, reason = "saturating is what a sensor does")]
fn counts(value: f64) -> i16 {
    value.round_ties_even() as i16
}

impl ImuReading {
    /// Returns a reading of these groups and ranges, all of it 0.
    #[must_use]
    pub fn new(t: i64, groups: ImuGroups, accel_range: u8, gyro_range: u8) -> Self {
        Self { t, accel: [0; 3], gyro: [0; 3], temperature: 0, groups, accel_range, gyro_range, padding: [0; 7] }
    }

    /// Returns the same in SI units.
    #[must_use]
    pub fn sample(&self, imu_type: ImuType) -> ImuSample {
        let scaled = |raw: [i16; 3], unit: f64| raw.map(|n| f64::from(n) * unit);
        let (per_degree, zero) = imu_type.temperature();
        ImuSample {
            t: self.t,
            accel: scaled(self.accel, accel_unit(self.accel_range)),
            gyro: scaled(self.gyro, gyro_unit(self.gyro_range)),
            temperature: if self.groups.temperature() { f64::from(self.temperature) / per_degree + zero } else { 0.0 },
        }
    }

    /// Returns the nearest reading of an SI sample, with all groups, in these ranges; what lies beyond them saturates.
    #[must_use]
    pub fn nearest(sample: &ImuSample, imu_type: ImuType, accel_range: u8, gyro_range: u8) -> Self {
        let (per_degree, zero) = imu_type.temperature();
        Self {
            accel: sample.accel.map(|a| counts(a / accel_unit(accel_range))),
            gyro: sample.gyro.map(|w| counts(w / gyro_unit(gyro_range))),
            temperature: counts((sample.temperature - zero) * per_degree),
            ..Self::new(sample.t, ImuGroups::ALL, accel_range, gyro_range)
        }
    }

    /// Negates axes in 16 bits. -32768 stays what it is, so that negating twice gives back every value.
    pub(super) fn flip(&mut self, axes: [bool; 3]) {
        for (axis, _) in axes.iter().enumerate().filter(|(_, flip)| **flip) {
            self.accel[axis] = self.accel[axis].wrapping_neg();
            self.gyro[axis] = self.gyro[axis].wrapping_neg();
        }
    }
}

/// Assembles one sample after the other.
#[derive(Default)]
pub(super) struct ImuAssembler {
    open: bool,
    /// What the scale word said, if it came.
    scale: Option<u8>,
    bytes: [u8; MAX_BYTES as usize],
    /// How many came; stops at one more than there may be.
    count: u8,
}

impl ImuAssembler {
    pub(super) fn start(&mut self, stats: &mut Stats) {
        self.abandon(stats);
        *self = Self { open: true, ..Self::default() };
    }

    /// Drops the open sample. Words are strays until the next start.
    pub(super) fn abandon(&mut self, stats: &mut Stats) {
        stats.imu_unended += u64::from(self.open);
        self.open = false;
    }

    pub(super) fn scale(&mut self, scale: u8, stats: &mut Stats) {
        if !self.open {
            stats.imu_stray_words += 1;
            return;
        }
        stats.imu_repeated_scales += u64::from(self.scale.is_some());
        (self.scale, self.count) = (Some(scale), 0);
    }

    pub(super) fn byte(&mut self, byte: u8, stats: &mut Stats) {
        if !self.open {
            stats.imu_stray_words += 1;
            return;
        }
        match self.bytes.get_mut(usize::from(self.count)) {
            Some(slot) => {
                *slot = byte;
                self.count += 1;
            }
            None => self.count = MAX_BYTES + 1,
        }
    }

    pub(super) fn end(&mut self, t: i64, flips: [bool; 3], stats: &mut Stats) -> Option<ImuReading> {
        if !self.open {
            stats.imu_stray_words += 1;
            return None;
        }
        self.open = false;
        let reading = self.scale.and_then(|scale| self.reading(t, scale));
        if reading.is_none() {
            stats.imu_malformed += 1;
        }
        reading.map(|mut reading| {
            reading.flip(flips);
            reading
        })
    }

    fn reading(&self, t: i64, scale: u8) -> Option<ImuReading> {
        let groups = ImuGroups(scale >> 5);
        if groups.0 == 0 || self.count != groups.bytes() {
            return None;
        }
        let mut words = self.bytes.as_chunks::<2>().0.iter().map(|&bytes| i16::from_be_bytes(bytes));
        let mut next = || words.next().unwrap_or_default();
        let mut reading = ImuReading::new(t, groups, scale >> 2 & 3, scale & 3);
        if groups.accel() {
            reading.accel = [next(), next(), next()];
        }
        if groups.temperature() {
            reading.temperature = next();
        }
        if groups.gyro() {
            reading.gyro = [next(), next(), next()];
        }
        Some(reading)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_become_si_units() {
        let mut reading = ImuReading::new(5, ImuGroups::ALL, 1, 2);
        (reading.accel, reading.gyro, reading.temperature) = ([8192, -8192, 0], [16384, 0, -16384], 340);
        let sample = reading.sample(ImuType::Mpu6050);
        let expected = [STANDARD_GRAVITY, -STANDARD_GRAVITY, 0.0];
        assert!(sample.accel.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12));
        assert!((sample.gyro[0] - 500f64.to_radians()).abs() < 1e-12 && sample.gyro[2] < 0.0);
        assert!((sample.temperature - 36.0).abs() < 1e-12);
        let other = reading.sample(ImuType::Mpu9250).temperature;
        assert!((other - (340.0 / 333.87 + 21.0)).abs() < 1e-12);
    }

    #[test]
    fn the_nearest_reading_of_a_sample_is_its_reading() {
        let mut reading = ImuReading::new(5, ImuGroups::ALL, 3, 0);
        (reading.accel, reading.gyro, reading.temperature) = ([1, -32768, 32767], [-3, 77, 12345], -999);
        for imu_type in [ImuType::Mpu6050, ImuType::Mpu9250] {
            assert_eq!(ImuReading::nearest(&reading.sample(imu_type), imu_type, 3, 0), reading);
        }
        let mut strong = reading.sample(ImuType::Mpu6050);
        strong.accel = [1e9, -1e9, f64::NAN];
        assert_eq!(ImuReading::nearest(&strong, ImuType::Mpu6050, 0, 0).accel, [32767, -32768, 0]);
    }

    #[test]
    fn flips_negate_in_16_bits() {
        let mut reading = ImuReading::new(0, ImuGroups::ALL, 0, 0);
        (reading.accel, reading.gyro) = ([-32768, 5, 6], [1, 2, 3]);
        reading.flip([true, false, true]);
        assert_eq!((reading.accel, reading.gyro), ([-32768, 5, -6], [-1, 2, -3]));
    }
}
