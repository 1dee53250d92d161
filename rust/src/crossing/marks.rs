//! The marks of pixels: their references in the terms of their samples, and how far samples may lie from them.
//!
//! Reaches depend on the thresholds alone, so where all pixels have the same there is one, and a quiet pixel costs four
//! bytes of state besides its sample.
//!
//! What must not break: whenever a pixel's reference moves, its mark is set again. A mark that is out of date would hide
//! events.

use std::ops::Range;

use super::level::{Level, Thresholds};
use super::parameters::CrossingParameters;
use super::sample::{DarkLevel, Reach, Sample};

/// How far samples may lie from their marks.
pub(crate) enum Reaches {
    /// All pixels have the same thresholds.
    Same(Reach),
    /// Reaches up and down, one of each a pixel.
    Each(Vec<f32>, Vec<f32>),
}

/// How marks are made and compared: what depends on parameters alone.
pub(crate) struct Marking {
    reaches: Reaches,
    dark_level: DarkLevel,
}

/// [`Marking`] of some pixels.
#[derive(Clone, Copy)]
pub(crate) struct MarkingSlice<'a> {
    pub(crate) reaches: ReachesSlice<'a>,
    pub(crate) dark_level: DarkLevel,
}

/// [`Reaches`] of some pixels.
#[derive(Clone, Copy)]
pub(crate) enum ReachesSlice<'a> {
    Same(Reach),
    Each(&'a [f32], &'a [f32]),
}

impl Marking {
    pub(crate) fn new<S: Sample>(p: &CrossingParameters, pixels: usize) -> Self {
        let reach = |pixel| S::reach(p.thresholds(pixel));
        let reaches = if p.is_uniform() {
            Reaches::Same(reach(0))
        } else {
            let (up, down) = (0..pixels).map(reach).map(|reach| (reach.up, reach.down)).unzip();
            Reaches::Each(up, down)
        };
        let least_down = match &reaches {
            Reaches::Same(reach) => reach.down,
            Reaches::Each(_, down) => down.iter().copied().fold(f32::INFINITY, f32::min),
        };
        Self { reaches, dark_level: S::dark_level(p.log_eps, least_down) }
    }

    /// That of some pixels.
    pub(crate) fn of(&self, pixels: Range<usize>) -> MarkingSlice<'_> {
        let reaches = match &self.reaches {
            Reaches::Same(reach) => ReachesSlice::Same(*reach),
            Reaches::Each(up, down) => ReachesSlice::Each(&up[pixels.clone()], &down[pixels]),
        };
        MarkingSlice { reaches, dark_level: self.dark_level }
    }

    pub(crate) fn dark_level(&self) -> DarkLevel {
        self.dark_level
    }
}

impl MarkingSlice<'_> {
    /// That of some of these pixels.
    pub(crate) fn of(&self, pixels: Range<usize>) -> MarkingSlice<'_> {
        let reaches = match self.reaches {
            ReachesSlice::Same(reach) => ReachesSlice::Same(reach),
            ReachesSlice::Each(up, down) => ReachesSlice::Each(&up[pixels.clone()], &down[pixels]),
        };
        MarkingSlice { reaches, dark_level: self.dark_level }
    }
}

/// The mark of a reference.
pub(crate) fn mark<S: Sample>(reference: Level, c: Thresholds, dark_level: DarkLevel) -> f32 {
    let mut mark = [0.0];
    S::marks(&[reference.value(c)], dark_level, &mut mark);
    mark[0]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::crossing::parameters::Threshold;

    /// Without a dark level to speak of, no mark may be so small that the farthest reach of any pixel underflows.
    #[test]
    fn the_farthest_reach_down_limits_all_marks() {
        let p = |off: Vec<f64>| CrossingParameters {
            contrast_threshold_off: Threshold::PerPixel(off),
            log_eps: 1e-40,
            ..CrossingParameters::default()
        };
        let mark = |off: Vec<f64>| {
            let reference = Level { base: -60.0, on: 0, off: 0 };
            let c = Thresholds { on: 0.15, off: off[0] };
            mark::<f32>(reference, c, Marking::new::<f32>(&p(off), 2).dark_level())
        };
        assert!(mark(vec![1.0, 1.0]) > 0.0);
        assert!(mark(vec![1.0, 80.0]).is_nan() && mark(vec![80.0, 1.0]).is_nan());
    }
}
