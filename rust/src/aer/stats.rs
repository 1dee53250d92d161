//! Counters of everything in a stream that a camera does not send, by kind.
//!
//! Names and descriptions are written once, in the macro call below. Python's dictionary of the counters is made from
//! it.
//!
//! What must not break: the docstring of `Decoder.stats` lists the same names, and a test compares them.

/// Defines the counters once, for the fields and for their names.
macro_rules! counters {
    ($($(#[doc = $doc:literal])+ $name:ident,)+) => {
        /// How often a stream was not what a camera sends, by kind.
        ///
        /// None of it stops the decoder. A stream that arrives whole leaves all at zero.
        #[derive(Clone, Debug, Default, PartialEq, Eq)]
        pub struct Stats {
            $($(#[doc = $doc])+ pub $name: u64,)+
        }

        impl Stats {
            /// Returns the counters by name.
            pub fn iter(&self) -> impl Iterator<Item = (&'static str, u64)> {
                [$((stringify!($name), self.$name)),+].into_iter()
            }
        }
    };
}

counters! {
    /// Words that mean nothing, the reserved 0x0000 among them: ignored.
    unknown_words,
    /// Timestamps and wraps that do not go forward (equal, backward, or after a lost wrap): obeyed.
    times_not_increasing,
    /// Rows and columns outside of the array: dropped.
    addresses_out_of_range,
    /// Columns before any row: dropped.
    columns_without_row,
    /// Inertial samples dropped at their end: too short, too long, or without a scale.
    imu_malformed,
    /// Inertial samples dropped because their end never came: another began, or the clock was reset or overflowed.
    imu_unended,
    /// Bytes, scales and ends of inertial samples where none had begun, a second end among them: ignored.
    imu_stray_words,
    /// Scales that came again within a sample, which then begins anew.
    imu_repeated_scales,
    /// Words of a frame (samples, marks, region, exposure) where none had begun: ignored.
    frame_stray_words,
    /// Samples that their column lacked at its end: the pixels read 0 there.
    samples_missing,
    /// Samples beyond their column's last row or the region's last column: ignored.
    samples_extra,
    /// Exposure words beyond the third of a frame: ignored.
    exposure_words_extra,
    /// Frames that lacked an exposure mark: its time is then that of the mark before it.
    exposure_marks_missing,
    /// Frames dropped because a read did not see every column once.
    frames_wrong_columns,
    /// Frames dropped because their region is none of the sensor's, or did not come whole and once before the samples.
    frames_bad_region,
    /// Frames dropped because their end never came: another began, or the clock was reset or overflowed.
    frames_unended,
}
