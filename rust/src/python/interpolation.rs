//! The names by which Python calls the ways to interpolate.

use crate::crossing::Interpolation;
use crate::error::{Error, Result};

/// Returns the interpolation of a name.
pub(super) fn of_name(name: &str) -> Result<Interpolation> {
    match name {
        "linear" => Ok(Interpolation::Linear),
        "hermite" => Ok(Interpolation::Hermite),
        _ => Err(Error::Argument(format!("interpolation must be 'linear' or 'hermite', got {name:?}"))),
    }
}

/// Returns the name of an interpolation.
pub(super) fn name(interpolation: Interpolation) -> &'static str {
    match interpolation {
        Interpolation::Linear => "linear",
        Interpolation::Hermite => "hermite",
    }
}
