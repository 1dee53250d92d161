//! Tracks: luma over a short time of a pixel that edges pass.
//!
//! A pixel's luma is the mean of its rays. Between two instants most rays see one surface, and change evenly. Those
//! that an edge passes jump, at an instant that the geometry gives ([`super::edges`]). So the rays at a few rendered
//! instants, and the instants of the jumps, give luma at all times between.
//!
//! What must not break: a pixel that these do not explain is not guessed, but reported.

use super::edges::Pass;

/// What one ray sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct RaySample {
    pub(crate) luma: f32,
    /// Its rate per second, along the surface.
    pub(crate) rate: f32,
    /// The triangle's number in the scene; [`crate::render::visibility::nearest::NOTHING`] where there is none.
    pub(crate) triangle: u32,
    /// 1 / z; 0 where there is nothing.
    pub(crate) inverse_depth: f32,
}

/// Of how many instants of each span the rays of pixels are rendered, at the most.
pub(crate) const INSTANTS: usize = 5;

/// How closely an edge must lie to the nearer of two surfaces, as a fraction of inverse depth, to belong to it.
const OWN: f64 = 0.02;

/// Error of even change that is left where its middle becomes a sample: a quarter of the bend for a smooth pixel.
const REMAINS: f32 = 1.0 / 3.0;

/// How far a ray's luma is taken to run along the line that its rate tells, as a fraction of what it was seen to be. Where a
/// texture is fine a rate holds for a short way only, and a line would leave what any texture has.
const BELIEVED: f64 = 0.25;

/// A microsecond, in seconds.
const TICK_S: f64 = 1e-6;

/// Jumps of less than this fraction of what is tolerated, together, are drawn out over the time around them.
const SIGNIFICANT: f32 = 0.1;

/// What one ray does between two instants.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Course {
    Even,
    /// It jumps at this fraction of the span.
    Jump(f64),
    /// Edges pass it so often that it may be either, or more.
    Unknown,
}

impl Course {
    /// What edges that pass make of a ray that sees this before and that after them.
    fn of(before: &RaySample, after: &RaySample, passes: impl Iterator<Item = Pass> + Clone) -> Self {
        let depths = [before, after].map(|ray_sample| f64::from(ray_sample.inverse_depth));
        let (nearer, farther) = (depths[0].max(depths[1]), depths[0].min(depths[1]));
        if before.triangle == after.triangle {
            // What passes in front of a surface comes and goes.
            let in_front = passes.filter(|pass| pass.inverse_depth >= nearer * (1.0 - OWN));
            return if in_front.count() < 2 { Self::Even } else { Self::Unknown };
        }
        let mut own = passes.clone().filter(|pass| (pass.inverse_depth - nearer).abs() <= OWN * nearer);
        let visible = passes.filter(|pass| pass.inverse_depth >= farther * (1.0 - OWN)).count();
        match (own.next(), own.next()) {
            (Some(pass), None) if visible == 1 => Self::Jump(pass.fraction),
            (None, _) if visible == 0 => Self::Even, // a crease, or a seam
            _ => Self::Unknown,
        }
    }
}

/// What a ray sees between two edges that pass it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct InnerSample {
    pub(crate) ray: u32,
    /// When, from 0 to 1 of the span.
    pub(crate) fraction: f64,
    pub(crate) ray_sample: RaySample,
}

/// A pixel in one span.
#[derive(Debug)]
pub(crate) struct Pixel<'a> {
    /// Its rays at the instants that were rendered, none where they were not; the first, middle and last always are.
    pub(crate) ray_samples: [Option<&'a [RaySample]>; INSTANTS],
    /// By ray and time; shares are those of the whole span.
    pub(crate) passes: &'a [Pass],
    /// By ray and time.
    pub(crate) inner_samples: &'a [InnerSample],
}

/// When the instants are.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Span {
    /// Microseconds.
    pub(crate) t_us: [i64; INSTANTS],
}

impl Span {
    /// The fraction of an instant.
    pub(crate) fn fraction(&self, instant: usize) -> f64 {
        #[allow(clippy::cast_precision_loss, reason = "spans are short")]
        let [at, length] =
            [self.t_us[instant] - self.t_us[0], self.t_us[INSTANTS - 1] - self.t_us[0]].map(|t| t as f64);
        at / length
    }

    /// The fraction of the middle.
    pub(crate) fn middle(&self) -> f64 {
        self.fraction(INSTANTS / 2)
    }

    /// A fraction in microseconds.
    fn at_us(&self, fraction: f64) -> f64 {
        #[allow(clippy::cast_precision_loss, reason = "microseconds are exact up to 2^53")]
        let [start, length] = [self.t_us[0], self.t_us[INSTANTS - 1] - self.t_us[0]].map(|t| t as f64);
        start + fraction * length
    }

    /// The first microsecond at which what happens at a fraction of the span has happened.
    fn after(&self, fraction: f64) -> i64 {
        #[allow(clippy::cast_precision_loss, clippy::cast_possible_truncation, reason = "spans are short")]
        let ticks = (fraction * (self.t_us[INSTANTS - 1] - self.t_us[0]) as f64).ceil() as i64;
        self.t_us[0] + ticks
    }
}

/// Change of log luma that is tolerated, and the dark level.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Tolerated {
    pub(crate) log: f32,
    pub(crate) log_eps: f32,
}

impl Tolerated {
    fn luma(self, luma: f32) -> f32 {
        self.log * (luma + self.log_eps)
    }
}

/// A sample of a pixel.
pub(crate) type Sample = (i64, f32);

/// What a pixel does between two of the instants.
#[derive(Debug)]
pub(crate) struct Piece {
    ends: [usize; 2],
    /// Change of the rays that do not jump.
    even: f64,
    /// The rays that jump, by time.
    jumps: Vec<Jump>,
    /// Rays that edges pass so often that it is not known what they see between these, and when to look.
    pub(crate) unseen: Vec<(u32, f64)>,
    /// How far rays that do not jump go beyond what their rates at both ends tell, into a shadow or over fine texture; and
    /// how far those that jump would go along a rate that is not believed.
    doubt: f64,
}

impl Piece {
    /// Whether any ray jumps in it, or may have done.
    pub(crate) fn is_passed(&self) -> bool {
        !self.unseen.is_empty() || !self.jumps.is_empty()
    }

    /// Adds what a ray does between two shares of the span at which it was seen, and which at most one edge comes between.
    fn add_seen(
        &mut self,
        (first, before): (f64, &RaySample),
        (last, after): (f64, &RaySample),
        passes: &[Pass],
        span: &Span,
        rays: f64,
    ) {
        let within = passes.iter().copied().filter(|pass| first < pass.fraction && pass.fraction <= last);
        let seen_us = [first, last].map(|fraction| span.at_us(fraction));
        let change = (f64::from(after.luma) - f64::from(before.luma)) / rays;
        let jump = match Course::of(before, after, within.clone()) {
            Course::Jump(fraction) => Some(fraction),
            Course::Unknown if before.triangle != after.triangle => within.map(|pass| pass.fraction).next(),
            Course::Unknown | Course::Even => None,
        };
        let even = Jump { seen_us, after_us: i64::MAX, change, rates: [change / (seen_us[1] - seen_us[0]); 2] };
        self.jumps.push(jump.map_or(even, |fraction| {
            let at_us = span.at_us(fraction);
            let mut rate = |ray_sample: &RaySample, over_us: f64| {
                let rate = f64::from(ray_sample.rate) * TICK_S / rays;
                let drift = (rate * over_us).abs();
                if drift <= BELIEVED * f64::from(ray_sample.luma) / rays {
                    return rate;
                }
                self.doubt += drift;
                0.0
            };
            let rates = [rate(before, at_us - seen_us[0]), rate(after, seen_us[1] - at_us)];
            Jump { seen_us, after_us: span.after(fraction), change, rates }
        }));
    }
}

/// The first of a list for which a condition holds, which are taken from it.
fn taken<'a, T>(rest: &mut &'a [T], condition: impl Fn(&T) -> bool) -> &'a [T] {
    let count = rest.iter().take_while(|item| condition(item)).count();
    let (first, others) = rest.split_at(count);
    *rest = others;
    first
}

/// A ray that jumps between two times at which it was seen, its luma as a fraction of its pixel's.
#[derive(Clone, Copy, Debug)]
struct Jump {
    seen_us: [f64; 2],
    /// The first microsecond at which it has jumped.
    after_us: i64,
    change: f64,
    /// Change per microsecond before and after.
    rates: [f64; 2],
}

impl Jump {
    /// How far its luma has changed since it was seen first.
    fn at(&self, t_us: i64) -> f64 {
        let [first_us, last_us] = self.seen_us;
        #[allow(clippy::cast_precision_loss, reason = "microseconds are exact up to 2^53")]
        let at_us = (t_us as f64).clamp(first_us, last_us);
        if t_us < self.after_us {
            self.rates[0] * (at_us - first_us)
        } else {
            self.change - self.rates[1] * (last_us - at_us)
        }
    }
}

impl Pixel<'_> {
    fn ray_samples(&self, instant: usize) -> &[RaySample] {
        self.ray_samples[instant].unwrap_or_default()
    }

    /// Luma at an instant that was rendered: the same additions as in a frame.
    pub(crate) fn luma(&self, instant: usize) -> f32 {
        let ray_samples = self.ray_samples(instant);
        #[allow(clippy::cast_precision_loss, reason = "there are at most 1024 rays a pixel")]
        let rays = ray_samples.len() as f32;
        ray_samples.iter().fold(0.0, |sum, ray_sample| sum + ray_sample.luma) / rays
    }

    fn piece(&self, ends: [usize; 2], span: &Span) -> Piece {
        let [first, last] = ends.map(|instant| span.fraction(instant));
        let [before, after] = ends.map(|instant| self.ray_samples(instant));
        #[allow(clippy::cast_precision_loss, reason = "there are at most 1024 rays a pixel, and spans are short")]
        let (rays, length_us) = (before.len() as f64, (span.t_us[ends[1]] - span.t_us[ends[0]]) as f64);
        let mut piece = Piece { ends, even: 0.0, jumps: vec![], unseen: vec![], doubt: 0.0 };
        let (mut passes, mut inner_samples) = (self.passes, self.inner_samples);
        for (ray, (before, after)) in (0..).zip(before.iter().zip(after)) {
            let own_passes = taken(&mut passes, |pass| pass.ray == ray);
            let own_samples = taken(&mut inner_samples, |inner| inner.ray == ray);
            let within = |fraction: f64| first < fraction && fraction <= last;
            let mut from = (first, before);
            for inner in own_samples.iter().filter(|inner| within(inner.fraction)) {
                piece.add_seen(from, (inner.fraction, &inner.ray_sample), own_passes, span, rays);
                from = (inner.fraction, &inner.ray_sample);
            }
            if from.0 > first {
                piece.add_seen(from, (last, after), own_passes, span, rays);
                continue;
            }
            let change = (f64::from(after.luma) - f64::from(before.luma)) / rays;
            let passes = own_passes.iter().copied().filter(|pass| within(pass.fraction));
            match if own_passes.is_empty() { Course::Even } else { Course::of(before, after, passes.clone()) } {
                Course::Even => {
                    let told = [before, after].map(|ray_sample| f64::from(ray_sample.rate) * TICK_S / rays * length_us);
                    piece.even += change;
                    piece.doubt += (change - told[0].max(told[1])).max(told[0].min(told[1]) - change).max(0.0);
                }
                Course::Jump(_) => piece.add_seen(from, (last, after), own_passes, span, rays),
                Course::Unknown => {
                    let farther = f64::from(before.inverse_depth.min(after.inverse_depth));
                    let mut earlier: Option<f64> = None;
                    let seen = piece.unseen.len();
                    for pass in passes.filter(|pass| pass.inverse_depth >= farther * (1.0 - OWN)) {
                        // What lasts for less than a microsecond need not be looked at.
                        if let Some(fraction) = earlier
                            && span.after(fraction) < span.after(pass.fraction)
                        {
                            piece.unseen.push((ray, f64::midpoint(fraction, pass.fraction)));
                        }
                        earlier = Some(pass.fraction);
                    }
                    if piece.unseen.len() == seen {
                        piece.add_seen(from, (last, after), own_passes, span, rays);
                    }
                }
            }
        }
        piece.jumps.sort_unstable_by_key(|jump| jump.after_us);
        piece
    }

    /// What it does before and after the middle.
    pub(crate) fn halves(&self, span: &Span) -> [Piece; 2] {
        [[0, INSTANTS / 2], [INSTANTS / 2, INSTANTS - 1]].map(|ends| self.piece(ends, span))
    }

    /// What it does between all of the instants, where all were rendered.
    pub(crate) fn quarters(&self, span: &Span) -> Option<[Piece; INSTANTS - 1]> {
        let rendered = self.ray_samples.iter().all(Option::is_some);
        rendered.then(|| std::array::from_fn(|first| self.piece([first, first + 1], span)))
    }

    /// Whether it is to be rendered half way between the instants that always are, too.
    pub(crate) fn wants_more(&self, halves: &[Piece; 2], span: &Span, tolerated: Tolerated) -> bool {
        let tolerated = tolerated.luma(self.luma(INSTANTS / 2));
        if halves.iter().any(|piece| !piece.unseen.is_empty() || piece.doubt > f64::from(tolerated)) {
            return true;
        }
        // Half of the difference of both changes is how far the middle lies off the line.
        let fraction = span.middle();
        #[allow(clippy::cast_possible_truncation, reason = "an estimate")]
        let bend = ((1.0 - fraction) * halves[0].even - fraction * halves[1].even).abs() as f32;
        REMAINS * bend > tolerated
    }

    /// Samples between the span's ends, increasing in time, between which luma changes evenly; and whether its rays do
    /// what neither edges nor their rates tell. The pieces are all of the span.
    pub(crate) fn samples(
        &self,
        pieces: &[Piece],
        span: &Span,
        tolerated: Tolerated,
        sampled: &mut Vec<Sample>,
    ) -> bool {
        let mut unknown = false;
        for piece in pieces {
            unknown |= piece.doubt > f64::from(tolerated.luma(self.luma(piece.ends[1])));
            self.samples_of(piece, span, tolerated, sampled);
            if piece.ends[1] != INSTANTS - 1 {
                sampled.push((span.t_us[piece.ends[1]], self.luma(piece.ends[1])));
            }
        }
        unknown
    }

    fn samples_of(&self, piece: &Piece, span: &Span, tolerated: Tolerated, sampled: &mut Vec<Sample>) {
        let ends = piece.ends.map(|instant| span.t_us[instant]);
        let luma = self.luma(piece.ends[0]);
        #[allow(clippy::cast_precision_loss, reason = "spans are short")]
        let at = |t_us: i64| {
            let fraction = (t_us - ends[0]) as f64 / (ends[1] - ends[0]) as f64;
            let jumped: f64 = piece.jumps.iter().map(|jump| jump.at(t_us)).sum();
            f64::from(luma) + fraction * piece.even + jumped
        };
        let significant = f64::from(SIGNIFICANT * tolerated.luma(luma));
        let (mut last_us, mut left_out) = (ends[0], 0.0);
        for jumps in piece.jumps.chunk_by(|a, b| a.after_us == b.after_us) {
            let after_us = jumps[0].after_us;
            let [before, after] = [at(after_us - 1), at(after_us)];
            left_out += (after - before).abs();
            if left_out > significant {
                left_out = 0.0;
                for (t_us, luma) in [(after_us - 1, before), (after_us, after)] {
                    if t_us > last_us && t_us < ends[1] {
                        #[allow(clippy::cast_possible_truncation, reason = "luma is float32")]
                        sampled.push((t_us, luma.max(0.0) as f32));
                        last_us = t_us;
                    }
                }
            }
        }
    }
}

#[cfg(test)]
#[allow(clippy::cast_precision_loss, reason = "small numbers")]
mod tests {
    use super::*;
    use crate::render::visibility::nearest::NOTHING;

    const SPAN: Span = Span { t_us: [1000, 1010, 1020, 1030, 1040] };
    const TOLERATED: Tolerated = Tolerated { log: 1e-3, log_eps: 1e-3 };

    fn ray_sample(luma: f32, triangle: u32) -> RaySample {
        RaySample {
            luma,
            rate: 0.0,
            triangle,
            inverse_depth: if triangle == NOTHING { 0.0 } else { 1.0 / (1.0 + triangle as f32) },
        }
    }

    fn pass(ray: u32, fraction: f64, inverse_depth: f64) -> Pass {
        Pass { pixel: 0, ray, fraction, inverse_depth }
    }

    fn samples(ray_samples: [Option<&[RaySample]>; INSTANTS], passes: &[Pass]) -> (Vec<Sample>, bool, bool) {
        samples_with(ray_samples, passes, &[])
    }

    fn samples_with(
        ray_samples: [Option<&[RaySample]>; INSTANTS],
        passes: &[Pass],
        inner_samples: &[InnerSample],
    ) -> (Vec<Sample>, bool, bool) {
        let pixel = Pixel { ray_samples, passes, inner_samples };
        let mut sampled = vec![];
        let halves = pixel.halves(&SPAN);
        let quarters = pixel.quarters(&SPAN);
        let pieces = quarters.as_ref().map_or(halves.as_slice(), <[Piece; 4]>::as_slice);
        let unknown = pixel.samples(pieces, &SPAN, TOLERATED, &mut sampled);
        (sampled, unknown, pixel.wants_more(&halves, &SPAN, TOLERATED))
    }

    #[test]
    fn a_ray_that_an_edge_passes_jumps() {
        let near = [ray_sample(1.0, 0), ray_sample(0.5, 1)];
        let after = [ray_sample(0.5, 1), ray_sample(0.5, 1)];
        let (sampled, unknown, more) =
            samples([Some(&near), None, Some(&after), None, Some(&after)], &[pass(0, 0.3, 1.0), pass(1, 0.9, 0.2)]);
        assert_eq!(sampled, [(1011, 0.75), (1012, 0.5), (1020, 0.5)]);
        assert!(!unknown && !more);
    }

    #[test]
    fn even_change_is_a_line_and_bends_ask_for_more() {
        let ramp: Vec<[RaySample; 1]> =
            [0.25, 0.5, 0.75, 2.0].map(|luma| [RaySample { rate: 0.25 / 20e-6, ..ray_sample(luma, 0) }]).to_vec();
        let (sampled, unknown, more) = samples([Some(&ramp[0]), None, Some(&ramp[1]), None, Some(&ramp[2])], &[]);
        assert_eq!((sampled, unknown, more), (vec![(1020, 0.5)], false, false));
        let (_, _, more) = samples([Some(&ramp[0]), None, Some(&ramp[1]), None, Some(&ramp[3])], &[]);
        assert!(more);
    }

    #[test]
    fn what_comes_and_goes_between_two_instants_is_looked_at() {
        let wall = [ray_sample(1.0, 1)];
        let passes = [pass(0, 0.55, 1.0), pass(0, 0.6, 1.0)];
        let walls = [Some(wall.as_slice()); INSTANTS];
        let (_, _, more) = samples([walls[0], None, walls[2], None, walls[4]], &passes);
        assert!(more);
        let pixel = Pixel { ray_samples: walls, passes: &passes, inner_samples: &[] };
        let unseen = pixel.quarters(&SPAN).unwrap().map(|piece| piece.unseen);
        assert_eq!(unseen, [vec![], vec![], vec![(0, f64::midpoint(0.55, 0.6))], vec![]]);
        let inner_samples = [InnerSample { ray: 0, fraction: 0.575, ray_sample: ray_sample(0.0, 0) }];
        let (sampled, unknown, more) = samples_with(walls, &passes, &inner_samples);
        assert_eq!(
            sampled,
            [(1010, 1.0), (1020, 1.0), (1021, 1.0), (1022, 0.0), (1023, 0.0), (1024, 1.0), (1030, 1.0)]
        );
        assert!(!unknown && !more);
        // What lasts for less than a microsecond is passed over.
        let short = [pass(0, 0.551, 1.0), pass(0, 0.552, 1.0)];
        let (sampled, _, more) = samples([walls[0], None, walls[2], None, walls[4]], &short);
        assert_eq!((sampled, more), (vec![(1020, 1.0)], false));
        // Seen on its way, it is known.
        let wire = [ray_sample(0.0, 0)];
        let apart = [pass(0, 0.55, 1.0), pass(0, 0.8, 1.0)];
        let (sampled, unknown, _) = samples([Some(&wall), Some(&wall), Some(&wall), Some(&wire), Some(&wall)], &apart);
        assert!(!unknown);
        assert_eq!(
            sampled,
            [(1010, 1.0), (1020, 1.0), (1021, 1.0), (1022, 0.0), (1030, 0.0), (1031, 0.0), (1032, 1.0)]
        );
        // Behind the wall nothing is seen of it.
        let behind = [pass(0, 0.55, 0.1), pass(0, 0.6, 0.1)];
        let (sampled, unknown, more) = samples([Some(&wall), None, Some(&wall), None, Some(&wall)], &behind);
        assert_eq!((sampled, unknown, more), (vec![(1020, 1.0)], false, false));
    }

    /// Whose edge it is, and whether others are seen, is told by depth, to 2 %.
    #[test]
    fn an_edge_belongs_to_the_surface_at_its_depth() {
        let (near, far) = ([ray_sample(1.0, 0)], [ray_sample(0.5, 1)]);
        let of = |passes: &[Pass]| samples([Some(&near), None, Some(&far), None, Some(&far)], passes);
        let behind = of(&[pass(0, 0.1, 1.0), pass(0, 0.3, 0.45)]);
        assert_eq!(behind, (vec![(1003, 1.0), (1004, 0.5), (1020, 0.5)], false, false));
        let (_, _, more) = of(&[pass(0, 0.1, 1.0), pass(0, 0.3, 0.7)]);
        assert!(more, "something else comes between");
    }

    #[test]
    fn a_bend_that_rates_tell_asks_for_more() {
        let curve: Vec<[RaySample; 1]> = [(0.25, 0.0), (0.35, 0.25), (0.75, 0.5)]
            .map(|(luma, change)| [RaySample { rate: change / 20e-6, ..ray_sample(luma, 0) }])
            .to_vec();
        let (_, unknown, more) = samples([Some(&curve[0]), None, Some(&curve[1]), None, Some(&curve[2])], &[]);
        assert!(more && !unknown);
    }

    /// Where it comes onto a fine texture, its rate there tells nothing of what it saw before.
    #[test]
    fn a_ray_that_jumps_goes_no_way_that_is_not_believed() {
        let before = [ray_sample(1.0, 0)];
        for (rate, believed) in [(0.1 / 12e-6, true), (1.0 / 12e-6, false), (-1.0 / 12e-6, false)] {
            let (after, last) = ([RaySample { rate, ..ray_sample(0.5, 1) }], [ray_sample(0.5, 1)]);
            let (sampled, unknown, more) =
                samples([Some(&before), None, Some(&after), None, Some(&last)], &[pass(0, 0.2, 1.0)]);
            assert_eq!((unknown, more), (!believed, !believed));
            let jumped = if believed { 0.4 } else { 0.5 };
            assert!((sampled[1].1 - jumped).abs() < 1e-6 && sampled[1].0 == 1008, "{sampled:?}");
        }
    }

    #[test]
    fn steps_in_one_microsecond_are_one() {
        let before = [ray_sample(1.0, 0), ray_sample(1.0, 0)];
        let after = [ray_sample(0.0, 1), ray_sample(0.0, 1)];
        let passes = [pass(0, 0.51, 1.0), pass(1, 0.52, 1.0)];
        let (sampled, _, _) = samples([Some(&before), None, Some(&before), None, Some(&after)], &passes);
        assert_eq!(sampled, [(1020, 1.0), (1021, 0.0)]);
    }
}
