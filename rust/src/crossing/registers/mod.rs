//! The same work as that of the plain loops of [`super::scan`] and [`super::candidates`], in registers of AVX-512.
//!
//! A compiler cannot make plain loops use two things that this processor level has: it moves the lanes that count to the
//! front of a register, and it holds a comparison's result in a mask. So [`Registers::collect`] writes what a tile notes,
//! and [`Registers::carry_out`] takes eight straight lines from their records to their events, without arrays between.
//! Frames with many events take four fifths of the time.
//!
//! [`avx512`](self::instructions) is the one file with instructions of a processor, apart from [`crate::prefetch`]. What
//! it does not do (other processors, cubics, wide records), the plain loops do.
//!
//! What must not break:
//! - Every number is computed by the operations of the plain loops, in their order. So the results are the same bits.
//! - The plain loops stay, because other processors need them, and because tests hold these instructions against them.

#[cfg_attr(target_arch = "x86_64", path = "avx512.rs")]
#[cfg_attr(not(target_arch = "x86_64"), path = "none.rs")]
mod instructions;
mod lines;
mod notes;

pub(crate) use instructions::{Compress, Registers};
pub(crate) use lines::{Happened, LANES, Lines, Progress, Setting};
pub(crate) use notes::{GROUP, Notes, TileSamples};
