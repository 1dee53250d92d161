//! Events from columns, as formats of columns hold them.

use crate::error::{Error, Result};
use crate::event::Event;

/// Fills `events` from a column for each of their fields, all of one length.
///
/// # Errors
/// [`Error::Argument`] if the lengths differ, or for the first polarity other than 0 or 1, with its index; some events
/// are then filled.
pub fn fill_events(events: &mut [Event], t: &[i64], x: &[u16], y: &[u16], p: &[u8]) -> Result<()> {
    let count = events.len();
    if [t.len(), x.len(), y.len(), p.len()] != [count; 4] {
        return Err(Error::Argument(format!(
            "columns of events must have one length, {count}: got t {}, x {}, y {}, p {}",
            t.len(),
            x.len(),
            y.len(),
            p.len()
        )));
    }
    for (index, ((((event, &t), &x), &y), &p)) in events.iter_mut().zip(t).zip(x).zip(y).zip(p).enumerate() {
        if p > 1 {
            return Err(Error::Argument(format!("polarity must be 0 or 1: event {index} has {p}")));
        }
        *event = Event::new(t, x, y, p == 1);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_become_events() {
        let mut events = [Event::default(); 2];
        fill_events(&mut events, &[5, 6], &[1, 2], &[3, 4], &[0, 1]).unwrap();
        assert_eq!(events, [Event::new(5, 1, 3, false), Event::new(6, 2, 4, true)]);
    }

    #[test]
    fn lengths_and_polarities_are_checked() {
        let mut events = [Event::default(); 2];
        let short = fill_events(&mut events, &[5, 6], &[1, 2], &[3], &[0, 1]);
        assert!(matches!(short, Err(Error::Argument(m)) if m.contains("y 1")));
        let wrong = fill_events(&mut events, &[5, 6], &[1, 2], &[3, 4], &[0, 2]);
        assert!(matches!(wrong, Err(Error::Argument(m)) if m.contains("event 1 has 2")));
    }
}
