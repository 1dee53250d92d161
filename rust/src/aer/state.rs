//! What the decoder knows between two words, apart from inertial samples.
//!
//! The decoder changes it word by word, [`super::fast_path`] and [`super::block`] many words at a time. It is a module
//! of its own so that these three need not import each other.
//!
//! What must not break: everything that plain words can change is here, because the fast path sees nothing else.

use super::addresses::Addresses;
use super::clock::Clock;
use super::frame_assembler::FrameAssembler;
use super::stats::Stats;

/// What timestamps, wraps, addresses and frame samples change, besides that they make events.
pub(super) struct State {
    pub(super) clock: Clock,
    pub(super) addresses: Addresses,
    pub(super) frames: FrameAssembler,
    pub(super) stats: Stats,
}
