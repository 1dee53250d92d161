//! Events spread over planes in time, each shared by the two planes around it.

use super::cell::misplaced;
use crate::error::{Error, Result};
use crate::event::{Event, SensorSize};

/// The planes of a grid in time.
#[derive(Clone, Copy, Debug)]
pub struct TimeBins {
    /// When the first plane is.
    pub start_us: i64,
    /// The end of the window.
    pub stop_us: i64,
    /// Whether an event at `stop_us` counts: that of a window which ends at its last event.
    pub include_stop: bool,
    /// The number of planes.
    pub count: usize,
    /// Whether the last plane is at the window's end (Zhu et al.) or one step before it.
    pub endpoint: bool,
}

/// Splats each event linearly into the two nearest time bins. `measure` gives its weight from the event and its time in
/// the window (0 at the start, 1 at the end). There are `bins.count` planes for each of `groups` groups; `group` says
/// which one an event belongs to.
///
/// Events outside of the window count nowhere: those of start <= t < stop lie in it, and with `include_stop` those at the
/// stop as well. Such a window may be an instant: all its events are then in the first plane.
pub(super) fn spread(
    events: &[Event],
    size: SensorSize,
    bins: TimeBins,
    groups: usize,
    group: impl Fn(&Event) -> usize,
    measure: impl Fn(&Event, f64) -> f64,
) -> Result<Vec<f64>> {
    let TimeBins { start_us, stop_us, include_stop, count, endpoint } = bins;
    if count == 0 || stop_us < start_us {
        return Err(Error::Argument(format!(
            "a grid in time needs at least 1 bin and a window that does not end before it starts: got {count} bins in \
             {start_us}..{stop_us} us"
        )));
    }
    let pixels = size.pixels();
    // What would fall past the last plane of a group falls into two more, which are cut out again: no test per event.
    let length = count.checked_add(2).and_then(|n| n.checked_mul(pixels)).and_then(|n| n.checked_mul(groups));
    let mut grid = vec![
        0.0;
        length.filter(|&n| n <= isize::MAX as usize / 8).ok_or_else(|| {
            Error::Argument(format!("{count} bins of {} x {} do not fit into memory", size.width, size.height))
        })?
    ];
    #[allow(clippy::cast_precision_loss, reason = "times are shorter than 2^53 us, or the fraction is rounded")]
    let (steps, span) =
        ((if endpoint { count - 1 } else { count }) as f64, ((stop_us.abs_diff(start_us)).max(1)) as f64);
    for (index, event) in events.iter().enumerate() {
        if event.t < start_us || event.t > stop_us || (event.t == stop_us && !include_stop) {
            continue;
        }
        if event.x >= size.width || event.y >= size.height || event.p > 1 {
            return Err(misplaced(index, event, size));
        }
        #[allow(clippy::cast_precision_loss, reason = "as above")]
        let since = event.t.abs_diff(start_us) as f64;
        let position = steps * since / span;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 <= position <= count")]
        let plane = position as usize;
        #[allow(clippy::cast_precision_loss, reason = "a number of planes")]
        let late = position - plane as f64;
        let value = measure(event, since / span);
        let cell = (group(event) * (count + 2) + plane) * pixels + event.pixel(size);
        grid[cell] += value * (1.0 - late);
        grid[cell + pixels] += value * late;
    }
    for end in (1..=groups).rev().map(|group| group * (count + 2) * pixels) {
        grid.drain(end - 2 * pixels..end);
    }
    Ok(grid)
}
