//! Linear functions over the image, and their bounds over a part of it.
//!
//! A tile is decided at its corners instead of at each ray. This is exact because roundings are monotonic: the value at
//! the right corner bounds what every ray in the tile would compute.
//!
//! What must not break: the order of operations, a x + (b y + c), the same for bounds and for rays, and never fused.

/// A part of the image in undistorted coordinates: the x and y of ray directions (x, y, 1) in camera axes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rect {
    pub(crate) low: [f32; 2],
    pub(crate) high: [f32; 2],
}

impl Rect {
    /// What holds nothing yet.
    pub(crate) const NONE: Self = Self { low: [f32::INFINITY; 2], high: [f32::NEG_INFINITY; 2] };

    pub(crate) fn add(&mut self, x: f32, y: f32) {
        self.low = [self.low[0].min(x), self.low[1].min(y)];
        self.high = [self.high[0].max(x), self.high[1].max(y)];
    }

    /// Returns the part that lies in another one; where none does, what of that is next to it.
    pub(crate) fn within(&self, other: &Self) -> Self {
        let inside = |at: [f32; 2]| std::array::from_fn(|i| at[i].max(other.low[i]).min(other.high[i]));
        Self { low: inside(self.low), high: inside(self.high) }
    }

    /// Returns what holds some points, `LANES` of which are looked at together; their number is a multiple of it.
    pub(crate) fn around<const LANES: usize>(x: &[f32], y: &[f32]) -> Self {
        let [(left, right), (top, bottom)] = [x, y].map(|values| {
            let (mut low, mut high) = ([f32::INFINITY; LANES], [f32::NEG_INFINITY; LANES]);
            for values in values.chunks_exact(LANES) {
                for lane in 0..LANES {
                    low[lane] = if values[lane] < low[lane] { values[lane] } else { low[lane] };
                    high[lane] = if values[lane] > high[lane] { values[lane] } else { high[lane] };
                }
            }
            (low.into_iter().fold(f32::INFINITY, f32::min), high.into_iter().fold(f32::NEG_INFINITY, f32::max))
        });
        Self { low: [left, top], high: [right, bottom] }
    }

    pub(crate) fn corners(&self) -> [[f32; 2]; 4] {
        let (low, high) = (self.low, self.high);
        [low, [high[0], low[1]], [low[0], high[1]], high]
    }
}

/// a x + (b y + c), in that order.
///
/// Each rounding is monotonic, so the value at the right corner of a [`Rect`] bounds the values at all points in it as
/// they are computed, not only as they ought to be: a part of the image may be decided upon at its corners, and every
/// ray in it would have decided the same.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Linear(pub(crate) [f32; 3]);

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Linear {
    #[inline(always)]
    pub(crate) fn at(self, x: f32, y: f32) -> f32 {
        self.0[0] * x + (self.0[1] * y + self.0[2])
    }

    #[inline(always)]
    pub(crate) fn highest(self, rect: &Rect) -> f32 {
        let [a, b, _] = self.0;
        self.at(if a > 0.0 { rect.high[0] } else { rect.low[0] }, if b > 0.0 { rect.high[1] } else { rect.low[1] })
    }

    #[inline(always)]
    pub(crate) fn lowest(self, rect: &Rect) -> f32 {
        let [a, b, _] = self.0;
        self.at(if a > 0.0 { rect.low[0] } else { rect.high[0] }, if b > 0.0 { rect.low[1] } else { rect.high[1] })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// No point of a rectangle lies outside of the bounds, not by one rounding.
        #[test]
        fn corners_bound_every_point(
            c in prop::array::uniform3(-1e3f32..1e3), x in prop::array::uniform2(-2f32..2.0),
            y in prop::array::uniform2(-2f32..2.0), s in 0f32..=1.0, t in 0f32..=1.0,
        ) {
            let mut rect = Rect::NONE;
            rect.add(x[0], y[0]);
            rect.add(x[1], y[1]);
            let inside = |low: f32, high: f32, s: f32| (low + (high - low) * s).clamp(low, high);
            let value = Linear(c).at(inside(rect.low[0], rect.high[0], s), inside(rect.low[1], rect.high[1], t));
            prop_assert!(Linear(c).lowest(&rect) <= value && value <= Linear(c).highest(&rect));
        }
    }
}
