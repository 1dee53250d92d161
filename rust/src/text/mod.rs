//! events.txt, the text of the public Event-Camera Dataset: one line `timestamp x y polarity` an event.
//!
//! The timestamp is in seconds with nine decimals, polarity 0 or 1 (Mueggler et al., IJRR 2017, section 4). Text and
//! microseconds are converted in integers alone, so that no time is rounded.

mod reader;
mod writer;

pub use reader::read_events_text;
pub use writer::EventTextWriter;
