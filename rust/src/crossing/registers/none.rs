//! [`Registers`] of processors for which there are none.

use super::lines::{Happened, Lines, Progress, Setting};
use super::notes::{Notes, TileSamples};
use crate::crossing::record::Narrow;

/// There are none.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Registers {}

/// Nothing is asked of samples.
pub(crate) trait Compress {}

impl<S> Compress for S {}

impl Registers {
    pub(crate) fn find() -> Option<Self> {
        None
    }

    pub(crate) fn collect<S>(self, _: &TileSamples<'_, S>, _: Notes<'_, S>) -> usize {
        match self {}
    }

    pub(crate) fn carry_out(self, _: &Lines<'_>, _: Setting, _: &mut [Narrow], _: Happened<'_>) -> Progress {
        match self {}
    }
}
