//! What registers take and leave where lines are decided.

#![cfg_attr(not(target_arch = "x86_64"), allow(dead_code, reason = "there are no registers"))]

use crate::crossing::band_events::{Grid, Key};
use crate::crossing::steps::Steps;

/// Lines that are carried out at a time.
pub(crate) const LANES: usize = 8;

/// Candidates whose log intensity follows straight lines. Each array has [`LANES`] more than there are, of which only the
/// pixels must be valid ones.
pub(crate) struct Lines<'a> {
    pub(crate) count: usize,
    /// By their numbers in the band.
    pub(crate) pixel: &'a [u32],
    /// Log intensity at the interval's start and end.
    pub(crate) from: &'a [f64],
    pub(crate) to: &'a [f64],
    pub(crate) steps: Steps<&'a [f64]>,
}

/// The interval and the place of these lines.
#[derive(Clone, Copy)]
pub(crate) struct Setting {
    /// Fewer than those of a long interval.
    pub(crate) ticks: f64,
    /// From the zero of the records' times to the interval's start.
    pub(crate) since: i64,
    pub(crate) grid: Grid,
}

/// Where what happens goes: references after the interval, one of each line; events, and what they changed of their
/// records. All have room for [`LANES`] more than there are lines.
pub(crate) struct Happened<'a> {
    pub(crate) after: &'a mut [f64],
    pub(crate) keys: &'a mut [Key],
    pub(crate) old: &'a mut [u64],
}

/// How far [`Registers::carry_out`] came.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Progress {
    /// Lines that are done. The next one, if there is one, is for the exact rule.
    pub(crate) lines: usize,
    pub(crate) events: usize,
    /// One of the next lines has a record that cannot count its event, so all records have to become wide.
    pub(crate) is_full: bool,
}
