//! What reflects ultrasound in a room: walls, the corners they form, pillars.

use geometry::{Circle, Point, RayHit, Segment};

use crate::{Imperfections, Room};

/// Incidence up to which a smooth wall answers in full, and from which it does not.
const MIRROR_DEG: (f64, f64) = (20.0, 30.0);
/// The same of a rough one.
const ROUGH_DEG: (f64, f64) = (60.0, 75.0);
const CORNER_STRENGTH: f64 = 0.9;
const EDGE_STRENGTH: f64 = 0.2;
/// Sine of the opening of the sharpest corner that reflects back, and of the bluntest.
const CORNER_SINE: f64 = 0.866;
/// Two surfaces meet where they come this near, mm.
pub(super) const JOINT_MM: f64 = 1.0;
/// A surface this much nearer hides another, mm.
const HIDES_MM: f64 = 3.0;

#[derive(Clone, Copy, Debug)]
pub(super) struct Wall {
    pub(super) segment: Segment,
    pub(super) soft: bool,
}

/// Where surfaces meet or end.
#[derive(Clone, Debug)]
pub(super) struct Corner {
    pub(super) at: Point,
    /// Unit vectors along the surfaces.
    pub(super) arms: Vec<Point>,
    pub(super) soft: bool,
}

#[derive(Clone, Debug)]
pub(super) struct Surfaces {
    pub(super) walls: Vec<Wall>,
    pub(super) corners: Vec<Corner>,
    pub(super) circles: Vec<Circle>,
    /// Angles of incidence of a full echo and of none, radians.
    pub(super) incidence: (f64, f64),
    pub(super) double_bounce: bool,
}

/// What a ray meets.
pub(super) struct Hit {
    pub(super) distance_mm: f64,
    pub(super) incidence_rad: f64,
    /// Strength of an echo at normal incidence.
    pub(super) strength: f64,
    pub(super) soft: bool,
    /// Direction of the surface, unless it is round.
    pub(super) along: Option<Point>,
}

fn unit(a: Point) -> Point {
    let length = a.length_mm().max(1e-9);
    Point::new(a.x_mm / length, a.y_mm / length)
}

impl Surfaces {
    pub(super) fn new(room: &Room, world: &Imperfections) -> Self {
        let wall = |soft: bool| move |&segment: &Segment| Wall { segment, soft };
        let hard = room.segments.iter().map(wall(false));
        let walls: Vec<Wall> = hard
            .chain(room.soft.iter().map(wall(world.soft_surfaces)))
            .collect();
        let (full, none) = [ROUGH_DEG, MIRROR_DEG][usize::from(world.incidence)];
        Self {
            corners: corners(&walls),
            circles: room.circles.clone(),
            incidence: (full.to_radians(), none.to_radians()),
            double_bounce: world.double_bounce,
            walls,
        }
    }

    /// Strength of a smooth surface's echo at this incidence, 0..=1.
    pub(super) fn mirrored(&self, incidence_rad: f64) -> f64 {
        let (full, none) = self.incidence;
        ((none - incidence_rad) / (none - full)).clamp(0.0, 1.0)
    }

    /// The first surface on a ray, but none nearer than `nearest_mm`.
    pub(super) fn cast(&self, origin: Point, direction: Point, nearest_mm: f64) -> Option<Hit> {
        let straight = self.walls.iter().filter_map(|wall| {
            let hit = wall.segment.ray_hit(origin, direction)?;
            Some((hit, 1.0, wall.soft, Some(&wall.segment)))
        });
        let round = self.circles.iter().filter_map(|circle| {
            let hit = circle.ray_hit(origin, direction)?;
            let strength = curvature_loss(circle.radius_mm, hit.distance_mm);
            Some((hit, strength, false, None))
        });
        straight
            .chain(round)
            .filter(|(hit, ..)| hit.distance_mm >= nearest_mm)
            .min_by(|a, b| a.0.distance_mm.total_cmp(&b.0.distance_mm))
            .map(|(hit, strength, soft, segment)| Hit {
                distance_mm: hit.distance_mm,
                incidence_rad: libm::acos(hit.cos_incidence.clamp(-1.0, 1.0)),
                strength,
                soft,
                along: segment.map(|s| unit(s.to - s.from)),
            })
    }

    pub(super) fn is_visible(&self, from: Point, to: Point) -> bool {
        let direction = unit(to - from);
        let before = from.distance_mm(to) - HIDES_MM;
        let hides = |hit: Option<RayHit>| hit.is_some_and(|hit| hit.distance_mm < before);
        let mut straight = self.walls.iter();
        let mut round = self.circles.iter();
        !straight.any(|wall| hides(wall.segment.ray_hit(from, direction)))
            && !round.any(|circle| hides(circle.ray_hit(from, direction)))
    }
}

/// Strength of a round surface's echo against a flat one's.
pub(super) fn curvature_loss(radius_mm: f64, distance_mm: f64) -> f64 {
    (radius_mm / (radius_mm + distance_mm)).sqrt()
}

/// The walls' ends, each once, with the walls that start there or pass.
pub(super) fn corners(walls: &[Wall]) -> Vec<Corner> {
    let mut corners: Vec<Corner> = Vec::new();
    for end in walls.iter().flat_map(|w| [w.segment.from, w.segment.to]) {
        let mut known = corners.iter();
        if known.any(|known| known.at.distance_mm(end) < JOINT_MM) {
            continue;
        }
        let touches = |wall: &&Wall| wall.segment.distance_mm(end) < JOINT_MM;
        let mut arms = Vec::new();
        let mut soft = false;
        for wall in walls.iter().filter(touches) {
            soft |= wall.soft;
            let ends = [wall.segment.from, wall.segment.to].into_iter();
            let far = ends.filter(|far| far.distance_mm(end) >= JOINT_MM);
            arms.extend(far.map(|far| unit(far - end)));
        }
        // A straight wall in two pieces has no edge.
        if !matches!(arms[..], [a, b] if a.dot(b) < -0.95) {
            let at = end;
            corners.push(Corner { at, arms, soft });
        }
    }
    corners
}

impl Corner {
    /// Strength of its echo towards a sensor in this direction.
    pub(super) fn strength(&self, towards: Point) -> f64 {
        let faces = |a: Point, b: Point| {
            let sine = a.cross(b);
            let within = towards.cross(b) / sine > 0.0 && a.cross(towards) / sine > 0.0;
            sine.abs() >= CORNER_SINE && within
        };
        let mut pairs = self.arms.iter().enumerate();
        let concave = pairs.any(|(nth, &a)| self.arms[nth + 1..].iter().any(|&b| faces(a, b)));
        if concave {
            CORNER_STRENGTH
        } else {
            EDGE_STRENGTH
        }
    }
}
