//! Echoes of smooth surfaces: at 40 kHz (8.6 mm) they mirror sound instead of scattering it.
//!
//! | what | answers | strength |
//! |---|---|---|
//! | wall, box side | from its point nearest to the sensor inside the cone, while the beam's axis and the ray to that point are within 20° of the normal, falling to nothing at 30° | 1 |
//! | concave corner of 60 to 120° | in a wide angle: it sends sound back where it came from | 0.9 |
//! | edge, free end, other corner | in a wide angle, by diffraction | 0.2 |
//! | pillar, leg | from its point nearest to the sensor | √(R / (R + r)), spreading by curvature |
//! | soft surface | as a wall, up to 1 m | 1 |
//! | double bounce | a ray of the cone that one hard wall mirrors onto a surface, there and back on the same path, where nothing answers directly | half of the second surface's |
//!
//! The beam weighs this: 1 on the axis to 0.4 at the cone's rim, 0 at 4/3 of it, then a side lobe of
//! 0.1 (−20 dB) up to twice the rim. An echo needs 0.05, and 0.4 · (r / 4 m)² more with the distance;
//! its strength fades by 15 % from burst to burst. Shape and figures are typical of such parts
//! (Kuc and Siegel, "Physically based simulation model for acoustic sensor robot navigation", 1987;
//! Leonard and Durrant-Whyte, "Directed sonar sensing for mobile robot navigation", 1992).

mod surfaces;

use geometry::{Circle, Point, Segment};

use crate::{Imperfections, Pose2, RangefinderParams, Rng, Room};
use surfaces::{Corner, JOINT_MM, Surfaces, Wall, curvature_loss};

const SECOND_STRENGTH: f64 = 0.5;
/// Farthest echo of a soft surface, mm.
const SOFT_RANGE_MM: f64 = 1000.0;
/// Deviation of an echo's strength from burst to burst.
const FADING: f64 = 0.15;
/// Rays of the double bounce on each side of the axis.
const BOUNCE_RAYS: i32 = 2;

/// The rangefinder in its room.
#[derive(Clone, Debug)]
pub(crate) struct Sonar {
    beam: RangefinderParams,
    /// The room's reflecting parts, where they do not merely scatter.
    surfaces: Option<Surfaces>,
}

impl Sonar {
    pub(crate) fn new(beam: RangefinderParams, room: &Room, world: &Imperfections) -> Self {
        let mirrors = world.incidence || world.double_bounce || world.soft_surfaces;
        let surfaces = mirrors.then(|| Surfaces::new(room, world));
        Self { beam, surfaces }
    }

    /// Distance of the answering point, mm, without noise; `None` without an echo.
    pub(crate) fn nearest_return(&self, room: &Room, sensor: &Pose2) -> Option<f64> {
        self.faded_return(room, sensor, 1.0)
    }

    /// One measurement, mm; `None` without an echo.
    pub(crate) fn measure(&self, room: &Room, sensor: &Pose2, rng: &mut Rng) -> Option<f64> {
        let gain = match self.surfaces {
            Some(_) => 1.0 + FADING * rng.normal(),
            None => 1.0,
        };
        self.beam
            .measure(self.faded_return(room, sensor, gain), rng)
    }

    fn faded_return(&self, room: &Room, sensor: &Pose2, gain: f64) -> Option<f64> {
        let Some(surfaces) = &self.surfaces else {
            return self.beam.nearest_return(room, sensor);
        };
        let burst = Burst {
            beam: &self.beam,
            surfaces,
            sensor,
            gain,
        };
        let found = burst.direct().or_else(|| burst.double_bounce());
        found.map(|distance| distance.max(self.beam.nearest_mm))
    }
}

/// One burst of a sensor.
struct Burst<'a> {
    beam: &'a RangefinderParams,
    surfaces: &'a Surfaces,
    sensor: &'a Pose2,
    gain: f64,
}

impl Burst<'_> {
    /// The beam's weight off its axis.
    fn lobes(&self, aside_rad: f64) -> f64 {
        let rim = aside_rad.abs() / self.beam.half_angle_rad;
        if rim <= 1.0 {
            1.0 - 0.6 * rim * rim
        } else if rim <= 4.0 / 3.0 {
            0.4 * (4.0 - 3.0 * rim)
        } else if rim <= 2.0 {
            0.1 * libm::sin((rim - 4.0 / 3.0) * 1.5 * std::f64::consts::PI)
        } else {
            0.0
        }
    }

    fn is_heard(&self, strength: f64, distance_mm: f64, soft: bool) -> bool {
        let far = distance_mm / self.beam.farthest_mm;
        let in_range =
            distance_mm <= self.beam.farthest_mm && (!soft || distance_mm <= SOFT_RANGE_MM);
        in_range && strength * self.gain >= 0.05 + 0.4 * far * far
    }

    /// Distance of the nearest point that answers directly.
    fn direct(&self) -> Option<f64> {
        let surfaces = self.surfaces;
        let walls = surfaces.walls.iter().filter_map(|w| self.wall_point(w));
        let corners = surfaces.corners.iter().filter_map(|c| self.corner_point(c));
        let round = surfaces.circles.iter().filter_map(|c| self.round_point(c));
        let mut points: Vec<(f64, Point)> = walls.chain(corners).chain(round).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        let from = self.sensor.position();
        let mut visible = points.iter().filter(|(_, p)| surfaces.is_visible(from, *p));
        visible.next().map(|&(distance, _)| distance)
    }

    /// `point` in the sensor's frame: ahead and to the left.
    fn seen(&self, point: Point) -> Point {
        let (way, axis) = (point - self.sensor.position(), self.sensor.direction());
        Point::new(way.dot(axis), axis.cross(way))
    }

    fn wall_point(&self, wall: &Wall) -> Option<(f64, Point)> {
        let Segment { from, to } = wall.segment;
        let (a, b) = (self.seen(from), self.seen(to));
        let along = b - a;
        let length = along.length_mm();
        let axis_incidence = libm::acos((along.y_mm / length).abs().min(1.0));
        if axis_incidence >= self.surfaces.incidence.1 {
            return None;
        }
        // The part of the wall inside the cone: between both of its rims.
        let (sin, cos) = libm::sincos(self.beam.half_angle_rad);
        let (mut start, mut end) = (0.0_f64, 1.0_f64);
        for rim in [Point::new(sin, cos), Point::new(sin, -cos)] {
            let (at, slope) = (a.dot(rim), along.dot(rim));
            if slope.abs() < 1e-12 {
                if at < 0.0 {
                    return None;
                }
            } else if slope > 0.0 {
                start = start.max(-at / slope);
            } else {
                end = end.min(-at / slope);
            }
        }
        if start > end {
            return None;
        }
        let share = (-a.dot(along) / (length * length)).clamp(start, end);
        let point = a.lerp(b, share);
        let distance = point.length_mm();
        let incidence = (along.cross(point) / (length * distance)).abs();
        let incidence = libm::acos(incidence.min(1.0));
        let mirrored = self.surfaces.mirrored(incidence.max(axis_incidence));
        let strength = mirrored * self.lobes(point.angle_rad());
        let heard = self.is_heard(strength, distance, wall.soft);
        heard.then(|| (distance, from.lerp(to, share)))
    }

    fn corner_point(&self, corner: &Corner) -> Option<(f64, Point)> {
        let seen = self.seen(corner.at);
        let lobe = self.lobes(seen.angle_rad());
        if lobe <= 0.0 {
            return None;
        }
        let towards = self.sensor.position() - corner.at;
        let distance = seen.length_mm();
        let strength = lobe * corner.strength(towards);
        let heard = self.is_heard(strength, distance, corner.soft);
        heard.then_some((distance, corner.at))
    }

    fn round_point(&self, circle: &Circle) -> Option<(f64, Point)> {
        let seen = self.seen(circle.centre);
        let rim = self.beam.half_angle_rad;
        let aside = seen.angle_rad().clamp(-rim, rim);
        let (sin, cos) = libm::sincos(aside);
        let (centre, radius_mm) = (seen, circle.radius_mm);
        let local = Circle { centre, radius_mm };
        let hit = local.ray_hit(Point::default(), Point::new(cos, sin))?;
        let incidence = libm::acos(hit.cos_incidence.min(1.0));
        let mirrored = self.surfaces.mirrored(incidence);
        let loss = curvature_loss(circle.radius_mm, hit.distance_mm);
        let heard = self.is_heard(mirrored * loss * self.lobes(aside), hit.distance_mm, false);
        let (ahead, left) = (hit.distance_mm * cos, hit.distance_mm * sin);
        heard.then(|| (hit.distance_mm, self.sensor.point_at(ahead, left)))
    }

    /// Length of the shortest mirrored path, one way.
    fn double_bounce(&self) -> Option<f64> {
        if !self.surfaces.double_bounce {
            return None;
        }
        let rays = (-BOUNCE_RAYS..=BOUNCE_RAYS).filter_map(|nth| {
            let share = f64::from(nth) / f64::from(BOUNCE_RAYS);
            let aside = share * self.beam.half_angle_rad;
            let ray = self.sensor.facing(self.sensor.heading_rad + aside);
            let direction = ray.direction();
            let mirror = self.surfaces.cast(ray.position(), direction, 0.0)?;
            let along = mirror.along.filter(|_| !mirror.soft)?;
            let from = ray.point_at(mirror.distance_mm, 0.0);
            let mirrored = along * (2.0 * direction.dot(along)) - direction;
            let second = self.surfaces.cast(from, mirrored, JOINT_MM)?;
            let path = mirror.distance_mm + second.distance_mm;
            let strength = SECOND_STRENGTH
                * second.strength
                * self.surfaces.mirrored(second.incidence_rad)
                * self.lobes(aside);
            let heard = self.is_heard(strength, path, second.soft);
            heard.then_some(path)
        });
        rays.min_by(f64::total_cmp)
    }
}

#[cfg(test)]
mod tests;
