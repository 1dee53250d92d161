//! Groups of lamps that lie apart, and their parts, whose fronts look about the same way.
//!
//! What must not break: every lamp is in one part, and what is said of how a part's light falls on a place is no less
//! than that of any of its lamps.

use std::ops::Range;

use crate::render::geometry::vector::{Bounds, Vector, add, cross, dot, scale, sub};

/// Groups are parted until there are so many.
const MANY_GROUPS: usize = 16;

/// Room between lamps counts if it is wider than this, relative to their group.
const LEAST_GAP: f64 = 1e-6;

/// Parts are parted until there are so many.
const MANY_PARTS: usize = 96;

/// Fronts look about the same way if their cosine to the mean is at least this.
const SAME_WAY: f64 = 0.75;

/// A triangle that emits.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lamp {
    pub(crate) triangle: u32,
    /// The frame that its corners are in.
    pub(crate) frame: u32,
    /// The number of its light.
    pub(crate) light: u32,
    /// Of its front.
    pub(crate) normal: Vector,
    pub(crate) luma: f64,
}

/// Lamps of one frame and one light that lie next to each other.
#[derive(Clone, Debug)]
pub(crate) struct Group {
    pub(crate) frame: u32,
    pub(crate) light: u32,
    sphere: Sphere,
    /// Their numbers.
    pub(crate) parts: Range<usize>,
}

/// Lamps of a group whose fronts look about the same way.
#[derive(Clone, Debug)]
pub(crate) struct Part {
    sphere: Sphere,
    fronts: Cone,
    /// Luma times area, of all of them.
    pub(crate) power: f64,
    /// Their numbers.
    pub(crate) lamps: Range<usize>,
}

/// Lamps, sorted so that those of a part lie side by side, as parts of a group do.
#[derive(Clone, Debug, Default)]
pub(crate) struct GroupedLamps {
    pub(crate) lamps: Vec<Lamp>,
    pub(crate) parts: Vec<Part>,
    pub(crate) groups: Vec<Group>,
}

/// A sphere around lamps.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Sphere {
    centre: Vector,
    radius: f64,
}

/// A cone around normals: its axis, and its angle by cosine and sine.
#[derive(Clone, Copy, Debug)]
struct Cone {
    axis: Vector,
    angle: [f64; 2],
}

impl Lamp {
    /// Returns luma times area.
    pub(crate) fn power(&self, corners: &[[Vector; 3]]) -> f64 {
        self.luma * area(&corners[self.triangle as usize])
    }

    /// Returns its least and its largest coordinate along an axis.
    fn reach(&self, corners: &[[Vector; 3]], axis: usize) -> [f64; 2] {
        let [a, b, c] = corners[self.triangle as usize].map(|corner| corner[axis]);
        [a.min(b).min(c), a.max(b).max(c)]
    }
}

impl GroupedLamps {
    /// Groups those lamps that emit anything.
    pub(crate) fn new(corners: &[[Vector; 3]], lamps: impl IntoIterator<Item = Lamp>) -> Self {
        let mut lamps: Vec<Lamp> = lamps.into_iter().filter(|lamp| lamp.power(corners) > 0.0).collect();
        lamps.sort_by_key(|lamp| (lamp.frame, lamp.light, lamp.triangle));
        let mut ends = vec![0];
        for own in lamps.chunk_by(|a, b| (a.frame, a.light) == (b.frame, b.light)) {
            ends.push(ends[ends.len() - 1] + own.len());
        }
        let groups: Vec<_> = ends.windows(2).map(|ends| ends[0]..ends[1]).collect();
        let apart = parted(corners, &mut lamps, groups, (MANY_GROUPS, widest_gap));
        let parts = parted(corners, &mut lamps, apart.clone(), (MANY_PARTS, unlike));
        let (mut groups, mut first) = (vec![], 0);
        for members in apart {
            let count = parts[first..].iter().take_while(|part| part.end <= members.end).count();
            let own = &lamps[members];
            let sphere = Sphere::around(corners, own);
            groups.push(Group { frame: own[0].frame, light: own[0].light, sphere, parts: first..first + count });
            first += count;
        }
        let parts = parts.into_iter().map(|members| Part::new(corners, &lamps, members)).collect();
        Self { lamps, parts, groups }
    }
}

impl Group {
    /// Returns, for a place, a direction to the group: of those to its sphere, the one nearest to a wanted direction. All
    /// are in the group's frame.
    pub(crate) fn towards(&self, place: Vector, wanted: Vector) -> Vector {
        let Some((middle, [cosine, sine], _)) = self.sphere.seen(place) else { return wanted };
        let between = dot(middle, wanted);
        let across = sub(wanted, scale(middle, between));
        let apart = dot(across, across).sqrt();
        if between >= cosine {
            wanted
        } else if apart > 0.0 {
            add(scale(middle, cosine), scale(across, sine / apart))
        } else {
            middle
        }
    }
}

impl Part {
    fn new(corners: &[[Vector; 3]], lamps: &[Lamp], members: Range<usize>) -> Self {
        let own = &lamps[members.clone()];
        let power = power_of(corners, own);
        Self { sphere: Sphere::around(corners, own), fronts: Cone::around(corners, own), power, lamps: members }
    }

    /// Returns how much light of the part falls on a place at most, on a square metre that faces it.
    pub(crate) fn irradiance(&self, place: Vector) -> f64 {
        let Some((middle, radius, squared)) = self.sphere.seen(place) else {
            let squared = self.sphere.radius * self.sphere.radius;
            return if squared > 0.0 { self.power / squared } else { 0.0 };
        };
        let cosine = -dot(self.fronts.axis, middle);
        let facing = less([cosine, (1.0 - cosine * cosine).max(0.0).sqrt()], radius);
        self.power * less(facing, self.fronts.angle)[0].max(0.0) / squared
    }
}

impl Sphere {
    fn around(corners: &[[Vector; 3]], lamps: &[Lamp]) -> Self {
        let own = || lamps.iter().map(|lamp| &corners[lamp.triangle as usize]);
        let centre = own().fold(Bounds::NONE, |bounds, corners| bounds.with(&Bounds::of(corners))).centre();
        let squared = own().flatten().map(|&corner| sub(corner, centre)).map(|way| dot(way, way)).fold(0.0, f64::max);
        Self { centre, radius: squared.sqrt() }
    }

    /// Returns the direction to its centre, how far apart from that directions to it are at most, as cosine and sine, and
    /// its distance squared; None from within.
    fn seen(&self, place: Vector) -> Option<(Vector, [f64; 2], f64)> {
        let way = sub(self.centre, place);
        let squared = dot(way, way);
        if squared <= self.radius * self.radius {
            return None;
        }
        let sine = (self.radius / squared.sqrt()).min(1.0);
        Some((scale(way, 1.0 / squared.sqrt()), [(1.0 - sine * sine).sqrt(), sine], squared))
    }
}

impl Cone {
    fn around(corners: &[[Vector; 3]], lamps: &[Lamp]) -> Self {
        let sum = lamps.iter().map(|lamp| scale(lamp.normal, lamp.power(corners))).fold([0.0; 3], add);
        let length = dot(sum, sum).sqrt();
        if length <= 0.0 {
            return Self { axis: [0.0, 0.0, 1.0], angle: [-1.0, 0.0] };
        }
        let axis = scale(sum, 1.0 / length);
        let cosine = lamps.iter().map(|lamp| dot(axis, lamp.normal)).fold(1.0, f64::min).max(-1.0);
        Self { axis, angle: [cosine, (1.0 - cosine * cosine).sqrt()] }
    }
}

/// Returns an angle less another, or 0 where that is larger; angles of 0 to 180 degrees are given by cosine and sine.
fn less([cosine, sine]: [f64; 2], [of_cosine, of_sine]: [f64; 2]) -> [f64; 2] {
    if cosine >= of_cosine {
        return [1.0, 0.0];
    }
    [cosine * of_cosine + sine * of_sine, sine * of_cosine - cosine * of_sine]
}

/// A way to part lamps.
struct Cut {
    /// The first of those that come after it, sorted by it.
    after: usize,
    /// The larger, the sooner.
    weight: f64,
    key: Key,
}

/// What lamps are sorted by: their least coordinate along an axis, or that of their normal.
#[derive(Clone, Copy)]
enum Key {
    Place(usize),
    Normal(usize),
}

/// Parts ranges of lamps in two, those of the largest weight first, until there are so many or none can be parted.
fn parted(
    corners: &[[Vector; 3]],
    lamps: &mut [Lamp],
    ranges: Vec<Range<usize>>,
    (many, cut): (usize, impl Fn(&[[Vector; 3]], &[Lamp]) -> Option<Cut>),
) -> Vec<Range<usize>> {
    let mut known: Vec<_> = ranges.into_iter().map(|range| (cut(corners, &lamps[range.clone()]), range)).collect();
    while known.len() < many {
        let cuts = known.iter().enumerate().filter_map(|(at, (cut, _))| Some((at, cut.as_ref()?)));
        let Some((at, &Cut { after, key, .. })) = cuts.max_by(|(_, a), (_, b)| a.weight.total_cmp(&b.weight)) else {
            break;
        };
        let Range { start, end } = known[at].1;
        let value = |lamp: &Lamp| match key {
            Key::Place(axis) => lamp.reach(corners, axis)[0],
            Key::Normal(axis) => lamp.normal[axis],
        };
        lamps[start..end].sort_by(|a, b| value(a).total_cmp(&value(b)));
        let both = [start..start + after, start + after..end];
        known.splice(at..=at, both.map(|range| (cut(corners, &lamps[range.clone()]), range)));
    }
    known.into_iter().map(|(_, range)| range).collect()
}

/// Returns the widest room between lamps; None where there is none.
fn widest_gap(corners: &[[Vector; 3]], lamps: &[Lamp]) -> Option<Cut> {
    let (mut widest, mut width, power) = (None, 0.0, power_of(corners, lamps));
    for axis in 0..3 {
        let mut reaches: Vec<[f64; 2]> = lamps.iter().map(|lamp| lamp.reach(corners, axis)).collect();
        reaches.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let end_of_all = reaches.iter().map(|reach| reach[1]).fold(f64::NEG_INFINITY, f64::max);
        let least = LEAST_GAP * (end_of_all - reaches[0][0]);
        let mut end = reaches[0][1];
        for (after, [low, high]) in reaches.into_iter().enumerate() {
            if low - end > least.max(width) {
                width = low - end;
                widest = Some(Cut { after, weight: width * power, key: Key::Place(axis) });
            }
            end = end.max(high);
        }
    }
    widest
}

/// Parts lamps whose fronts look different ways; None where they do not.
fn unlike(corners: &[[Vector; 3]], lamps: &[Lamp]) -> Option<Cut> {
    let cosine = Cone::around(corners, lamps).angle[0];
    if cosine >= SAME_WAY {
        return None;
    }
    let Bounds { low, high } = lamps.iter().fold(Bounds::NONE, |bounds, lamp| bounds.with(&Bounds::of(&[lamp.normal])));
    let axis = (0..3).max_by(|&a, &b| (high[a] - low[a]).total_cmp(&(high[b] - low[b])))?;
    let middle = f64::midpoint(low[axis], high[axis]);
    let after = lamps.iter().filter(|lamp| lamp.normal[axis] < middle).count();
    let weight = (1.0 - cosine) * power_of(corners, lamps);
    (after > 0).then_some(Cut { after, weight, key: Key::Normal(axis) })
}

fn power_of(corners: &[[Vector; 3]], lamps: &[Lamp]) -> f64 {
    lamps.iter().map(|lamp| lamp.power(corners)).sum()
}

/// Returns the area of a triangle.
pub(crate) fn area([a, b, c]: &[Vector; 3]) -> f64 {
    let normal = cross(sub(*b, *a), sub(*c, *a));
    0.5 * dot(normal, normal).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::geometry::vector::largest;

    fn lamp(triangle: u32, normal: Vector) -> Lamp {
        Lamp { triangle, frame: 0, light: 0, normal, luma: 1.0 }
    }

    const UP: Vector = [0.0, 0.0, 1.0];

    /// Lamps are parted where there is room, and by body and light.
    #[test]
    fn groups_lie_apart() {
        let at = |x: f64, y: f64| [[x, y, 0.0], [x + 1.0, y, 0.0], [x, y + 1.0, 0.0]];
        // Two in a row that touch, one to the side of them, one of another body, one of another light, and a dark one.
        let corners = [at(0.0, 0.0), at(1.0, 0.0), at(0.5, 3.0), at(0.0, 0.0), at(1.0, 0.0), at(5.0, 5.0)];
        let own = |triangle, frame, light| Lamp { frame, light, ..lamp(triangle, UP) };
        let dark = Lamp { luma: 0.0, ..lamp(5, UP) };
        let lamps = [own(3, 1, 0), own(4, 0, 1), dark, own(2, 0, 0), own(0, 0, 0), own(1, 0, 0)];
        let made = GroupedLamps::new(&corners, lamps);
        let members = |group: &Group| -> Vec<u32> {
            let lamps = made.parts[group.parts.clone()].iter().flat_map(|part| &made.lamps[part.lamps.clone()]);
            lamps.map(|lamp| lamp.triangle).collect()
        };
        let groups: Vec<_> = made.groups.iter().map(|group| (group.frame, group.light, members(group))).collect();
        assert_eq!(groups, [(0, 0, vec![0, 1]), (0, 0, vec![2]), (0, 1, vec![4]), (1, 0, vec![3])]);
        let many: Vec<_> = (0..100).map(|i| at(2.0 * f64::from(i), 0.0)).collect();
        let made = GroupedLamps::new(&many, (0..100).map(|triangle| lamp(triangle, UP)));
        assert_eq!(made.groups.len(), MANY_GROUPS);
        assert_eq!(made.parts.iter().map(|part| part.power).sum::<f64>(), 50.0);
    }

    /// The widest room is parted first, and there is none within what lies next to a large lamp.
    #[test]
    fn what_lies_far_apart_is_parted_first() {
        let at = |x: f64, size: f64| [[x, 0.0, 0.0], [x + size, 0.0, 0.0], [x, size, 0.0]];
        let row: Vec<_> = (0..40).map(|i| at(1.1 * f64::from(i), 1.0)).chain([at(-50.0, 1.0)]).collect();
        let made = GroupedLamps::new(&row, (0..41).map(|triangle| lamp(triangle, UP)));
        assert_eq!(made.groups.len(), MANY_GROUPS);
        let alone = made.parts.iter().any(|part| made.lamps[part.lamps.clone()].iter().all(|lamp| lamp.triangle == 40));
        assert!(alone, "{:?}", made.parts);
        let beside = [at(0.0, 10.0), at(1.0, 1.0), at(8.0, 1.0)];
        assert_eq!(GroupedLamps::new(&beside, (0..3).map(|triangle| lamp(triangle, UP))).groups.len(), 1);
    }

    /// Returns the triangles of a sphere around the origin, with normals that look outwards.
    fn ball(radius: f64, side: u32) -> (Vec<[Vector; 3]>, Vec<Lamp>) {
        let at = |i: u32, j: u32| {
            let [polar, azimuth] =
                [(i, 1.0), (j, 2.0)].map(|(k, turns)| std::f64::consts::PI * turns * f64::from(k) / f64::from(side));
            [radius * polar.sin() * azimuth.cos(), radius * polar.sin() * azimuth.sin(), radius * polar.cos()]
        };
        let (mut corners, mut lamps) = (vec![], vec![]);
        for (i, j) in (0..side).flat_map(|i| (0..side).map(move |j| (i, j))) {
            for triangle in [[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]] {
                let middle = add(add(triangle[0], triangle[1]), triangle[2]);
                #[allow(clippy::cast_possible_truncation, reason = "a small number")]
                lamps.push(lamp(corners.len() as u32, scale(middle, 1.0 / dot(middle, middle).sqrt())));
                corners.push(triangle);
            }
        }
        (corners, lamps)
    }

    /// Fronts of a part look about the same way. Its light is no less than that of its lamps, and together the parts that
    /// are seen send about as much as a ball does.
    #[test]
    fn parts_of_a_ball_are_seen_from_their_side() {
        let (corners, lamps) = ball(0.5, 24);
        let made = GroupedLamps::new(&corners, lamps);
        assert_eq!(made.groups.len(), 1);
        assert!((8..60).contains(&made.parts.len()), "{}", made.parts.len());
        let mut count = 0;
        for part in &made.parts {
            assert!(part.fronts.angle[0] >= SAME_WAY);
            assert_eq!(part.lamps.start, count);
            count = part.lamps.end;
        }
        assert_eq!(count, made.lamps.len());
        for place in [[3.0, 0.0, 0.0], [-0.4, 0.9, 0.2], [0.0, 0.0, -0.7]] {
            let mut sum = 0.0;
            for part in &made.parts {
                let most = part.irradiance(place);
                let mut all = 0.0;
                for lamp in &made.lamps[part.lamps.clone()] {
                    let [a, b, c] = corners[lamp.triangle as usize];
                    let way = sub(scale(add(add(a, b), c), 1.0 / 3.0), place);
                    let cosine = (-dot(lamp.normal, way) / dot(way, way).sqrt()).max(0.0);
                    all += lamp.power(&corners) * cosine / dot(way, way);
                }
                // Parts near the place are nearer than their centre.
                assert!(most >= 0.5 * all && (all == 0.0) >= (most == 0.0), "{place:?}: {most} {all}");
                sum += most;
            }
            let squared = dot(place, place);
            let exact = std::f64::consts::PI * 0.25 / squared;
            assert!(sum > 0.9 * exact && sum < 4.0 * exact, "{place:?}: {sum} {exact}");
        }
    }

    /// A direction to a group leads to its sphere, as near to the wanted one as any that does.
    #[test]
    fn directions_lead_to_the_group() {
        let corners = [[[-1.0, -1.0, 5.0], [1.0, -1.0, 5.0], [1.0, 1.0, 5.0]]];
        let down = lamp(0, [0.0, 0.0, -1.0]);
        let made = GroupedLamps::new(&corners, [down]);
        let ([group], [part]) = (&made.groups[..], &made.parts[..]) else { panic!() };
        assert_eq!(group.sphere, Sphere { centre: [0.0, 0.0, 5.0], radius: 2.0f64.sqrt() });
        let near = [0.0, 0.1, 0.99f64.sqrt()];
        assert_eq!(group.towards([0.0; 3], near), near);
        assert!((part.irradiance([0.0; 3]) - 2.0 / 25.0).abs() < 1e-12);
        let towards = group.towards([0.0; 3], [0.0, 0.6, 0.8]);
        let sine = 2.0f64.sqrt() / 5.0;
        let expected = [0.0, sine, (1.0 - sine * sine).sqrt()];
        assert!(largest(sub(towards, expected)) < 1e-12, "{towards:?}");
        // Away from it, any direction is as near.
        let away = group.towards([0.0; 3], [0.0, 0.0, -1.0]);
        assert!(largest(sub(away, [0.0, 0.0, 1.0])) < 1e-12, "{away:?}");
        // Behind it there is no light; to the side of it, as much as it may be turned by within its sphere.
        assert!(part.irradiance([0.0, 0.0, 11.0]) < 1e-12);
        let aside = part.irradiance([8.0, 0.0, 5.0]);
        assert!((aside - 2.0 * 2.0f64.sqrt() / 8.0 / 64.0).abs() < 1e-12, "{aside}");
        // Fronts that look a little to that side send more there.
        let tilted = [0.6, -0.6].map(|x| lamp(u32::from(x < 0.0), [x, 0.0, -0.8]));
        let tilted = GroupedLamps::new(&[corners[0]; 2], tilted);
        let (aside, radius) = (tilted.parts[0].irradiance([8.0, 0.0, 5.0]), 2.0f64.sqrt() / 8.0);
        let expected = 4.0 / 64.0 * (radius * 0.8 + (1.0 - radius * radius).sqrt() * 0.6);
        assert!((aside - expected).abs() < 1e-12, "{aside} {expected}");
        // Within the sphere, any direction leads to it.
        assert_eq!(group.towards([0.0, 0.0, 4.0], [1.0, 0.0, 0.0]), [1.0, 0.0, 0.0]);
        assert!((part.irradiance([0.0, 0.0, 4.0]) - 1.0).abs() < 1e-12);
        // Back to back they are two parts, of which one is seen from each side.
        let both = GroupedLamps::new(&[corners[0]; 2], [down, lamp(1, UP)]);
        let sides = [[0.0, 0.0, 11.0], [0.0, 0.0, -1.0]]
            .map(|place| both.parts.iter().map(|part| part.irradiance(place)).filter(|&light| light > 0.0).count());
        assert_eq!((both.groups.len(), both.parts.len(), sides), (1, 2, [1, 1]));
    }
}
