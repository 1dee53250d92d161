//! The one order of a simulated stream: (t, y, x, order of crossing).

use crate::event::Event;

/// Sorts events that stand in raster order (y, x, order of crossing) by time.
///
/// The sort is stable, so that the raster order decides among equal times: the result depends on nothing but the
/// events, whatever threads made them.
pub(crate) fn sort_raster_by_time(events: &mut [Event]) {
    events.sort_by_key(|event| event.t);
}
