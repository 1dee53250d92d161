//! Tiles behind a lens with distortion: lines are curves in undistorted coordinates, and linear functions there are cubic
//! along them.
//!
//! Mostly a function has one sign change on each line of a tile. Then this is found for many lines together by Newton's
//! method, from where the slope in the tile's middle leads; where slopes differ much, from the zero of a quadratic in the
//! cubic's place. A function that may have two sign changes on a line is looked at line by line.
//!
//! What must not break: all is odd in the function, so that its negative has the same bits with the other sign.

use super::intervals::Intervals;
use super::pattern::LinePattern;
use super::warp::{Height, LineDepth, SURE, TileFunction, Warp};
use crate::render::geometry::curve::{Cubic, TERMS, TileCurve};
use crate::render::geometry::linear::Rect;
use crate::render::geometry::pixel_rays::{LANES, TILE};

/// From a tile's middle to its ends, pixels.
#[allow(clippy::cast_precision_loss, reason = "a small number")]
const HALF: f32 = TILE as f32 / 2.0;

/// Functions are looked at so far from the tile's middle: Newton's step may begin a little beyond its ends.
const REACH: f32 = HALF + 1.0;

/// If slopes differ by less than this fraction, two steps by the slope in the tile's middle come so near to a sign change
/// that one of Newton's method finds it to 1e-4 pixels.
const EVEN: f64 = 0.1;

/// On columns up to [`HALF`] from the middle, u^3 is nearest to this times u.
const CUBE: f32 = 0.75 * HALF * HALF;

/// A sign change is known to so many pixels, in so many steps.
const CLOSE: f32 = 1e-5;
const STEPS: usize = 20;

/// A tile behind a lens with distortion.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Curved<'a> {
    rect: &'a Rect,
    curve: &'a TileCurve,
    /// The curve by column and height of lines in the tile's middle.
    along: TileCurve,
}

/// A function of columns from a tile's middle, and of heights of lines there.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CurvedFunction(Cubic);

/// The same in float32.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct CurvedDepth {
    terms: [f32; TERMS],
    /// What is added to a line's height at column 0.
    middle: f32,
}

/// A cubic of columns from the tile's middle, on one line.
#[derive(Clone, Copy, Debug)]
struct OnLine([f32; 4]);

impl<'a> Curved<'a> {
    /// Returns a tile in which lines have a slope.
    pub(crate) fn new(rect: &'a Rect, curve: &'a TileCurve, slope: f32) -> Self {
        let along = TileCurve(curve.0.map(|cubic| cubic.along(f64::from(slope))));
        Self { rect, curve, along }
    }
}

/// Returns what is added to lines' heights at column 0 for those in a tile's middle, from there.
fn to_middle(pattern: &LinePattern) -> f32 {
    HALF * pattern.slope - HALF
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl Warp for Curved<'_> {
    type Function = CurvedFunction;
    type Depth = CurvedDepth;

    fn rect(&self) -> &Rect {
        self.rect
    }

    #[inline(always)]
    fn function(&self, [a, b, c]: [f64; 3]) -> CurvedFunction {
        let [x, y] = &self.along.0;
        let mut terms = std::array::from_fn(|i| a * x.0[i] + b * y.0[i]);
        terms[0] += c;
        CurvedFunction(Cubic(terms))
    }

    #[inline(always)]
    fn undistort(&self, from: (&[f32], &[f32]), to: (&mut [f32], &mut [f32])) {
        let [to_x, to_y] = self.curve.0.map(|cubic| single(&cubic));
        let (low, high) = (self.rect.low, self.rect.high);
        for ((column, row), (x, y)) in from.0.iter().zip(from.1).zip(to.0.iter_mut().zip(to.1)) {
            let (column, row) = (column - HALF, row - HALF);
            *x = within(on_line(&to_x, row).at(column), low[0], high[0]);
            *y = within(on_line(&to_y, row).at(column), low[1], high[1]);
        }
    }

    fn height(&self, pattern: &LinePattern) -> Height {
        let (slope, half) = (f64::from(pattern.slope), f64::from(HALF));
        let [x, y] = self.curve.0.map(|cubic| cubic.0);
        let [x_off, y_off] = self.curve.0.map(|cubic| cubic.bend(half));
        // Columns and rows from the tile's middle by the linear terms alone: the inverse of [x4 x1, y4 y1].
        let determinant = x[4] * y[1] - x[1] * y[4];
        let per_x = (-slope * y[1] - y[4]) / determinant;
        let per_y = (slope * x[1] + x[4]) / determinant;
        let middle = half - half * slope;
        Height {
            function: [per_x, per_y, middle - (per_x * x[0] + per_y * y[0])],
            off: per_x.abs() * x_off + per_y.abs() * y_off,
        }
    }

    #[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
    fn around(&self, part: &Rect) -> Rect {
        let size = [0, 1].map(|axis| f64::from(part.high[axis]) - f64::from(part.low[axis]));
        let corners = part.corners().map(|corner| corner.map(|at| f64::from(at - HALF)));
        let [x, y] = self.curve.0.map(|cubic| {
            let bulge = cubic.bulge(size, f64::from(HALF));
            let values = corners.map(|[column, row]| cubic.at(column, row));
            let low = values.iter().copied().fold(f64::INFINITY, f64::min);
            [low - bulge, values.iter().copied().fold(f64::NEG_INFINITY, f64::max) + bulge].map(|value| value as f32)
        });
        let (low, high) = (self.rect.low, self.rect.high);
        let [x, y] = [x.map(|x| within(x, low[0], high[0])), y.map(|y| within(y, low[1], high[1]))];
        Rect { low: [x[0], y[0]], high: [x[1], y[1]] }
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl TileFunction for CurvedFunction {
    type Depth = CurvedDepth;

    fn lowered(self, fraction: f64) -> Self {
        let mut terms = self.0.0;
        terms[0] -= fraction * terms.iter().map(|term| term.abs()).sum::<f64>();
        Self(Cubic(terms))
    }

    #[inline(always)]
    fn sign(&self, pattern: &LinePattern) -> f64 {
        let [f00, f01, f02, f03, f10, f11, f12, f20, f21, f30] = self.0.0;
        let (slope, half) = (f64::from(pattern.slope), f64::from(HALF));
        let height = half * (1.0 + slope);
        // Heights lie at rows - slope x columns.
        let linear = half * ((f10 - slope * f01).abs() + f01.abs());
        let constant = height * height * (f02.abs() + height * f03.abs());
        let change = linear
            + constant
            + half * height * (f11.abs() + height * f12.abs())
            + half * half * (f20.abs() + height * f21.abs() + half * f30.abs());
        if f00.abs() > change * (1.0 + SURE) { f00.signum() } else { 0.0 }
    }

    #[inline(always)]
    fn clip(self, intervals: &mut Intervals, pattern: &LinePattern) {
        let terms = single(&self.0);
        let to_middle = to_middle(pattern);
        let lines = intervals.lines();
        let Some((rises, change)) = self.rises(f64::from(pattern.slope)) else {
            for line in lines {
                let on_line = on_line(&terms, pattern.heights[line] + to_middle);
                let [first, second] = on_line.negative(-HALF, HALF);
                for [left, right] in [first, second].map(|out| out.map(|column| column + HALF)) {
                    if right > left {
                        // Nothing may be left between a negative end and the tile's.
                        intervals.take_out(line, [left, right]);
                    }
                }
            }
            return;
        };
        let heights = pattern.heights[lines.clone()].chunks_exact(LANES);
        let ends = if rises { &mut intervals.from[lines] } else { &mut intervals.to[lines] };
        let sign = if rises { 1.0 } else { -1.0 };
        if change < EVEN {
            let per_slope = 1.0 / terms[4];
            for (ends, heights) in ends.chunks_exact_mut(LANES).zip(heights) {
                for i in 0..LANES {
                    let line = on_line(&terms, heights[i] + to_middle);
                    let first = within(-line.0[0] * per_slope, -REACH, REACH);
                    let near = within(first - line.at(first) * per_slope, -REACH, REACH);
                    ends[i] = further(line.next(near) + HALF, ends[i], rises);
                }
            }
            return;
        }
        for (ends, heights) in ends.chunks_exact_mut(LANES).zip(heights) {
            for i in 0..LANES {
                let line = on_line(&terms, heights[i] + to_middle);
                let OnLine([a, b, c, d]) = line;
                let linear = b + CUBE * d;
                let under = linear * linear - 4.0 * a * c;
                let root = if under > 0.0 { under } else { 0.0 }.sqrt();
                let near = within(-2.0 * a / (linear + sign * root), -REACH, REACH);
                ends[i] = further(line.next(near) + HALF, ends[i], rises);
            }
        }
    }

    #[inline(always)]
    fn depth(self, pattern: &LinePattern) -> CurvedDepth {
        CurvedDepth { terms: single(&self.0), middle: to_middle(pattern) }
    }
}

impl CurvedFunction {
    /// Returns whether it rises on all lines of a tile, or falls on all of them (false), and by which fraction its slope
    /// there may differ from that in the middle; None where it may do both.
    fn rises(&self, slope: f64) -> Option<(bool, f64)> {
        let [_, _, _, _, f10, f11, f12, f20, f21, f30] = self.0.0;
        let reach = f64::from(REACH);
        let height = reach * (1.0 + slope);
        let changes = height * (f11.abs() + height * f12.abs())
            + 2.0 * reach * (f20.abs() + height * f21.abs())
            + 3.0 * reach * reach * f30.abs();
        (f10.abs() > changes).then(|| (f10 > 0.0, changes / f10.abs()))
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl LineDepth for CurvedDepth {
    #[inline(always)]
    fn nearer(&self, other: &Self, height: f32, (left, right): (f32, f32)) -> Option<[[f32; 2]; 2]> {
        let between = std::array::from_fn(|i| other.terms[i] - self.terms[i]);
        let nearer = on_line(&between, height + self.middle).negative(left - HALF, right - HALF);
        let [first, second] = nearer.map(|columns| columns.map(|column| within(column + HALF, left, right)));
        let second = if second[1] > second[0] { second } else { [first[1]; 2] };
        (second[1] > first[0]).then_some([first, second])
    }

    #[inline(always)]
    fn least(&self, height: f32, (left, right): (f32, f32)) -> f32 {
        let line = on_line(&self.terms, height + self.middle);
        let OnLine([_, _, c, d]) = line;
        let width = right - left;
        let bulge = width * width * 0.25 * (c.abs() + 3.0 * HALF * d.abs());
        line.at(left - HALF).min(line.at(right - HALF)) - bulge
    }
}

#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
impl OnLine {
    #[inline(always)]
    fn at(&self, column: f32) -> f32 {
        let [a, b, c, d] = self.0;
        a + column * (b + column * (c + column * d))
    }

    /// Returns the column that a step of Newton's method leads to.
    #[inline(always)]
    fn next(&self, column: f32) -> f32 {
        let [_, b, c, d] = self.0;
        column - self.at(column) / (b + column * (2.0 * c + column * 3.0 * d))
    }

    /// Returns where it is negative between two columns: up to two intervals from left to right; those that are not
    /// there have no length.
    fn negative(&self, left: f32, right: f32) -> [[f32; 2]; 2] {
        let [_, b, c, d] = self.0;
        let turn = -0.5 * (b + CUBE * d) / c;
        let turn = if turn > left && turn < right { turn } else { left };
        let [first, middle, last] = [left, turn, right].map(|column| self.at(column) < 0.0);
        let nothing = [right; 2];
        match (first, middle, last) {
            (false, false, false) => [nothing; 2],
            (true, true, true) => [[left, right], nothing],
            (true, false, false) => [[left, self.change(left, turn)], nothing],
            (true, true, false) => [[left, self.change(turn, right)], nothing],
            (false, false, true) => [[self.change(turn, right), right], nothing],
            (false, true, true) => [[self.change(left, turn), right], nothing],
            (false, true, false) => [[self.change(left, turn), self.change(turn, right)], nothing],
            (true, false, true) => [[left, self.change(left, turn)], [self.change(turn, right), right]],
        }
    }

    /// Returns the column between two of them at which the sign changes, by Newton's method; where that leads out of
    /// what is known, by halves.
    fn change(&self, mut left: f32, mut right: f32) -> f32 {
        let is_negative = self.at(left) < 0.0;
        let mut column = 0.5 * (left + right);
        for _ in 0..STEPS {
            *if (self.at(column) < 0.0) == is_negative { &mut left } else { &mut right } = column;
            let next = self.next(column);
            if (next - column).abs() < CLOSE {
                return within(next, left, right);
            }
            column = if next > left && next < right { next } else { 0.5 * (left + right) };
        }
        column
    }
}

/// Returns the larger of two columns, or the smaller one.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn further(column: f32, end: f32, larger: bool) -> f32 {
    let is_further = if larger { column > end } else { column < end };
    if is_further { column } else { end }
}

/// Returns a cubic of column and height on a line.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn on_line(terms: &[f32; TERMS], height: f32) -> OnLine {
    let [f00, f01, f02, f03, f10, f11, f12, f20, f21, f30] = *terms;
    OnLine([
        f00 + height * (f01 + height * (f02 + height * f03)),
        f10 + height * (f11 + height * f12),
        f20 + height * f21,
        f30,
    ])
}

#[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
fn single(cubic: &Cubic) -> [f32; TERMS] {
    cubic.0.map(|term| term as f32)
}

#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn within(value: f32, low: f32, high: f32) -> f32 {
    let value = if value < high { value } else { high };
    if value > low { value } else { low }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::geometry::pixel_rays::PixelRays;

    const SIZE: [usize; 2] = [70, 53];

    /// The focal length and the principal point, in pixels: the image is a part of one that is larger.
    const FOCAL: f64 = 200.0;
    const MIDDLE: [f64; 2] = [-15.0, -5.0];

    const K1: f64 = -0.4;

    /// Returns the undistorted ray of a point of the image, by Newton's method.
    fn ray(point: [f64; 2]) -> [f64; 2] {
        let at: [f64; 2] = std::array::from_fn(|axis| (point[axis] - MIDDLE[axis]) / FOCAL);
        let distorted = at[0].hypot(at[1]);
        let mut radius = distorted;
        for _ in 0..6 {
            radius -= (radius * (1.0 + K1 * radius * radius) - distorted) / (1.0 + 3.0 * K1 * radius * radius);
        }
        at.map(|at| if distorted > 0.0 { at * radius / distorted } else { 0.0 })
    }

    #[allow(clippy::cast_possible_truncation, reason = "float64 is rounded to float32")]
    #[allow(clippy::cast_precision_loss, reason = "small numbers")]
    fn corners() -> PixelRays {
        let mut table = vec![];
        for [right, down] in [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]] {
            for pixel in 0..SIZE[0] * SIZE[1] {
                let at = ray([(pixel % SIZE[0]) as f64 + right, (pixel / SIZE[0]) as f64 + down]);
                table.extend(at.map(|at| at as f32));
            }
        }
        PixelRays::new(SIZE[0], SIZE[1], 4, &table).unwrap()
    }

    /// A pseudorandom number from -1 to 1.
    #[allow(clippy::cast_precision_loss, reason = "fewer bits than float64 has")]
    fn number(seed: &mut u64) -> f64 {
        *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*seed >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    /// A function that is zero at a point, at an angle there; `along` makes it nearly that of lines.
    fn function(seed: &mut u64, at: [f64; 2], slope: f64, along: bool) -> [f64; 3] {
        let [[x, y], [next_x, next_y]] = [at, [at[0] + 1e-3, at[1] + 1e-3 * slope]].map(ray);
        let angle = if along { (next_x - x).atan2(y - next_y) + 0.008 * number(seed) } else { 3.2 * number(seed) };
        let [a, b] = [angle.cos(), angle.sin()];
        let sign = number(seed).signum();
        [sign * a, sign * b, -sign * (a * x + b * y)]
    }

    /// Hands on for each tile and some functions: the tile, and of points on lines in the image the line, the column and
    /// how far from the function's zeros they are, in pixels.
    #[allow(clippy::cast_precision_loss, reason = "small numbers")]
    fn each_function(
        pattern: &LinePattern,
        mut work: impl FnMut(&Curved, &CurvedFunction, &dyn Fn(usize, f32) -> f64),
    ) {
        let (all, mut seed) = (corners(), 5);
        for tile in (0..all.tiles()).step_by(4) {
            let (column, row) = all.pixel(tile, 0);
            let corner = [column as f64, row as f64];
            let warp = Curved::new(all.tile(tile), all.curve(tile), pattern.slope);
            for number in 0..8 {
                let line = pattern.heights[10 + 8 * number];
                let column = 2.5 + 2.0 * self::number(&mut seed);
                let at = [corner[0] + column, corner[1] + f64::from(line) + f64::from(pattern.slope) * column];
                let linear = function(&mut seed, at, f64::from(pattern.slope), number % 2 == 0);
                let value = |at: [f64; 2]| {
                    let [x, y] = ray(at);
                    linear[0] * x + linear[1] * y + linear[2]
                };
                work(&warp, &warp.function(linear), &|line, column| {
                    let row = f64::from(pattern.heights[line] + pattern.slope * column);
                    let at = [corner[0] + f64::from(column), corner[1] + row];
                    if (0..2).any(|axis| at[axis] > SIZE[axis] as f64) {
                        return f64::NAN;
                    }
                    let across = 0.5 * (value([at[0] + 1.0, at[1]]) - value([at[0] - 1.0, at[1]]));
                    let down = 0.5 * (value([at[0], at[1] + 1.0]) - value([at[0], at[1] - 1.0]));
                    value(at) / across.hypot(down)
                });
            }
        }
    }

    /// Points of lines are kept where a function is positive by more than 1e-3 pixels, and none where it is negative by
    /// so much; also where a line crosses its zeros twice.
    #[test]
    #[allow(clippy::cast_precision_loss, reason = "small numbers")]
    fn edges_are_where_the_lens_has_them() {
        let pattern = LinePattern::new(8).unwrap();
        let mut intervals = Intervals::default();
        let (mut ends, mut holes) = (0, 0);
        each_function(&pattern, |_, function, distance| {
            intervals.begin(&pattern.ends, pattern.ends.lists.clone());
            function.clip(&mut intervals, &pattern);
            for (line, left, right) in pattern.ends.each() {
                let mut kept = vec![];
                intervals.each(line, |from, to| kept.push([from, to]));
                holes += usize::from(kept.len() == 2);
                for &end in kept.as_flattened().iter().filter(|&&end| end > left && end < right) {
                    let away = distance(line, end);
                    assert!(away.is_nan() || away.abs() < 1e-3, "{line} {end}: {away}");
                    ends += 1;
                }
                for column in (0..20).map(|i| left + (right - left) * (i as f32 + 0.5) / 20.0) {
                    let away = distance(line, column);
                    if away.abs() > 1e-3 {
                        let is_kept = kept.iter().any(|[from, to]| (from..=to).contains(&&column));
                        assert_eq!(is_kept, away > 0.0, "{line} {column}: {away}");
                    }
                }
            }
        });
        assert!(ends > 1000 && holes > 3, "{ends} {holes}");
    }

    /// What one function allows, its negative does not, to the bit: no gap is seen at a common edge.
    #[test]
    fn a_common_edge_has_no_gap() {
        let pattern = LinePattern::new(8).unwrap();
        let [mut one, mut other] = [Intervals::default(), Intervals::default()];
        each_function(&pattern, |_, function, _| {
            let negative = CurvedFunction(Cubic(function.0.0.map(|term| -term)));
            for (intervals, function) in [(&mut one, *function), (&mut other, negative)] {
                intervals.begin(&pattern.ends, pattern.ends.lists.clone());
                function.clip(intervals, &pattern);
            }
            for line in 0..pattern.ends.lefts.len() {
                let mut ends = vec![];
                one.each(line, |from, to| ends.push([from, to]));
                other.each(line, |from, to| ends.push([from, to]));
                ends.sort_by(|a, b| a[0].total_cmp(&b[0]));
                let length = pattern.ends.rights[line] - pattern.ends.lefts[line];
                let all: f32 = ends.iter().map(|[from, to]| to - from).sum();
                // Only what is too short may lack.
                assert!(length < 0.0 || (all - length).abs() < 1e-4, "{line}: {ends:?}");
                assert!(ends.windows(2).all(|two| two[1][0] >= two[0][1]), "{line}: {ends:?}");
            }
        });
    }

    /// One depth is nearer than another exactly where their difference is positive, and none is below the least.
    #[test]
    #[allow(clippy::cast_precision_loss, reason = "small numbers")]
    fn depths_part_where_the_lens_has_it() {
        let pattern = LinePattern::new(8).unwrap();
        let (mut twice, mut constant) = (0, [0.0; TERMS]);
        constant[0] = 1.0;
        let plain = CurvedFunction(Cubic(constant)).depth(&pattern);
        each_function(&pattern, |_, function, distance| {
            let mut terms = function.0.0;
            terms[0] += 1.0;
            let depth = CurvedFunction(Cubic(terms)).depth(&pattern);
            for (line, left, right) in pattern.ends.each().filter(|(_, left, right)| right - left > 1.0) {
                let between = (left + 0.2, right - 0.3);
                let height = pattern.heights[line];
                let nearer = depth.nearer(&plain, height, between);
                twice += usize::from(nearer.is_some_and(|[_, second]| second[1] > second[0]));
                let mut lowest = f32::INFINITY;
                for column in (0..20).map(|i| between.0 + (between.1 - between.0) * (i as f32 + 0.5) / 20.0) {
                    let away = distance(line, column);
                    if away.abs() > 2e-3 {
                        let inside =
                            nearer.is_some_and(|all| all.iter().any(|[from, to]| (from..=to).contains(&&column)));
                        assert_eq!(inside, away > 0.0, "{line} {column}: {away}");
                    }
                    lowest = lowest.min(on_line(&depth.terms, height + depth.middle).at(column - HALF));
                }
                let least = depth.least(height, between);
                assert!(least <= lowest && least > lowest - 0.02, "{line}: {least} {lowest}");
            }
        });
        assert!(twice > 3, "{twice}");
    }

    /// A part of a tile is in the lists of all lines that pass it; a small one is in few of them.
    #[test]
    #[allow(clippy::cast_precision_loss, reason = "small numbers")]
    fn a_part_has_its_lines() {
        let (all, pattern) = (corners(), LinePattern::new(8).unwrap());
        for tile in 0..all.tiles() {
            let warp = Curved::new(all.tile(tile), all.curve(tile), pattern.slope);
            let (height, (first_column, first_row)) = (warp.height(&pattern), all.pixel(tile, 0));
            for (line, left, right) in pattern.ends.each() {
                for column in (0..5).map(|i| left + (right - left) * (i as f32 / 4.0)) {
                    let row = pattern.heights[line] + pattern.slope * column;
                    let at = [first_column as f32 + column, first_row as f32 + row];
                    if (0..2).any(|axis| at[axis] > SIZE[axis] as f32) {
                        continue;
                    }
                    let (mut x, mut y) = ([0.0], [0.0]);
                    warp.undistort((&[column], &[row]), (&mut x, &mut y));
                    let part = Rect { low: [x[0], y[0]], high: [x[0], y[0]] };
                    let lists = height.lists(&part, &pattern, &pattern.ends);
                    assert!(lists.contains(&(line / LANES)) && lists.len() < 4, "{tile} {line} {column}: {lists:?}");
                }
            }
        }
    }

    /// Taps are where the lens has them, and in what their tile lies in; so is all of a part of a tile.
    #[test]
    #[allow(clippy::cast_precision_loss, reason = "small numbers")]
    fn taps_are_where_the_lens_has_them() {
        let all = corners();
        for tile in 0..all.tiles() {
            let (column, row) = all.pixel(tile, 0);
            let rect = all.tile(tile);
            let warp = Curved::new(rect, all.curve(tile), 0.375);
            let (columns, rows): (Vec<f32>, Vec<f32>) =
                (0..400).map(|i| ((i % 20) as f32 * 0.4 + 0.2, (i / 20) as f32 * 0.4 + 0.2)).unzip();
            let places: Vec<[f32; 2]> = columns.iter().zip(&rows).map(|(&x, &y)| [x, y]).collect();
            let (mut x, mut y) = (vec![0.0; 400], vec![0.0; 400]);
            warp.undistort((&columns, &rows), (&mut x, &mut y));
            let part = Rect { low: [1.9, 3.0], high: [5.1, 7.5] };
            let around = warp.around(&part);
            // Behind a lens that bends the other way it is as large, on the other side.
            let mirrored = TileCurve(warp.curve.0.map(|cubic| Cubic(cubic.0.map(|term| -term))));
            let mirrored_rect = Rect { low: rect.high.map(|at| -at), high: rect.low.map(|at| -at) };
            let other = Curved::new(&mirrored_rect, &mirrored, 0.375).around(&part);
            assert_eq!((other.low, other.high), (around.high.map(|at| -at), around.low.map(|at| -at)));
            for (i, place) in places.iter().enumerate() {
                let at = [column as f64 + f64::from(place[0]), row as f64 + f64::from(place[1])];
                if (0..2).any(|axis| at[axis] > SIZE[axis] as f64) {
                    continue;
                }
                let seen = [f64::from(x[i]), f64::from(y[i])];
                let scale = FOCAL * (1.0 + K1 * (seen[0] * seen[0] + seen[1] * seen[1]));
                let wrong: [f64; 2] = std::array::from_fn(|axis| seen[axis] * scale + MIDDLE[axis] - at[axis]);
                assert!(wrong.iter().all(|wrong| wrong.abs() < 1e-3), "{tile} {place:?}: {wrong:?}");
                let holds = |rect: &Rect| {
                    (rect.low[0]..=rect.high[0]).contains(&x[i]) && (rect.low[1]..=rect.high[1]).contains(&y[i])
                };
                assert!(holds(rect));
                let in_part = (0..2).all(|axis| (part.low[axis]..=part.high[axis]).contains(&place[axis]));
                assert!(!in_part || holds(&around));
            }
            let size = [0, 1].map(|axis| f64::from(around.high[axis] - around.low[axis]) * FOCAL);
            assert!(size[0] < 3.2 * 2.5 && size[1] < 4.5 * 2.5, "{size:?}");
        }
    }

    #[test]
    fn a_lowered_function_is_lower() {
        let mut terms = [0.0; TERMS];
        (terms[0], terms[4], terms[9]) = (2.0, -3.0, 1.0);
        assert_eq!(CurvedFunction(Cubic(terms)).lowered(0.5).0.0[0], 2.0 - 0.5 * 6.0);
    }
}
