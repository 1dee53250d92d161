//! The names by which Python calls the start phases.

use crate::crossing::StartPhase;
use crate::error::{Error, Result};

/// Returns the start phase of a name.
pub(super) fn of_name(name: &str) -> Result<StartPhase> {
    match name {
        "zero" => Ok(StartPhase::Zero),
        "stationary" => Ok(StartPhase::Stationary),
        _ => Err(Error::Argument(format!("start_phase must be 'zero' or 'stationary', got {name:?}"))),
    }
}

/// Returns the name of a start phase.
pub(super) fn name(start_phase: StartPhase) -> &'static str {
    match start_phase {
        StartPhase::Zero => "zero",
        StartPhase::Stationary => "stationary",
    }
}
