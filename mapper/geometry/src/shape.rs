//! Segments and circles, and where rays meet them.

use crate::Point;

/// A straight line between two points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// One end.
    pub from: Point,
    /// The other end.
    pub to: Point,
}

/// A circle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Circle {
    /// Its centre.
    pub centre: Point,
    /// Its radius, mm.
    pub radius_mm: f64,
}

/// Where a ray meets a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayHit {
    /// Distance along the ray, mm.
    pub distance_mm: f64,
    /// Cosine of the angle of incidence: 1 along the surface's normal, 0 grazing.
    pub cos_incidence: f64,
}

impl Segment {
    /// A segment from end to end.
    pub const fn new(from: Point, to: Point) -> Self {
        Self { from, to }
    }

    /// Length, mm.
    pub fn length_mm(&self) -> f64 {
        self.from.distance_mm(self.to)
    }

    /// The segment cut into equal pieces of at most `longest_mm`.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // metres over millimetres
    pub fn pieces(&self, longest_mm: f64) -> impl Iterator<Item = Self> + use<> {
        let Self { from, to } = *self;
        let count = (self.length_mm() / longest_mm).ceil().max(1.0) as u32;
        let at = move |index: u32| from.lerp(to, f64::from(index) / f64::from(count));
        (0..count).map(move |index| Self::new(at(index), at(index + 1)))
    }

    /// Distance of a point to the nearest point of the segment, mm.
    pub fn distance_mm(&self, point: Point) -> f64 {
        let line = self.to - self.from;
        let share = line.dot(point - self.from) / line.dot(line).max(f64::MIN_POSITIVE);
        let share = share.clamp(0.0, 1.0);
        self.from.lerp(self.to, share).distance_mm(point)
    }

    /// Where the ray from `origin` along the unit vector `direction` meets the segment.
    pub fn ray_hit(&self, origin: Point, direction: Point) -> Option<RayHit> {
        let (line, way) = (self.to - self.from, self.from - origin);
        let cross = direction.cross(line);
        if cross.abs() < 1e-9 {
            return None;
        }
        let distance_mm = way.cross(line) / cross;
        let share = way.cross(direction) / cross;
        ((0.0..=1.0).contains(&share) && distance_mm >= 0.0).then(|| RayHit {
            distance_mm,
            cos_incidence: (cross / line.length_mm()).abs(),
        })
    }
}

impl Circle {
    /// Distance of a point to the circle's line, mm; 0 inside.
    pub fn distance_mm(&self, point: Point) -> f64 {
        (self.centre.distance_mm(point) - self.radius_mm).max(0.0)
    }

    /// Where the ray from `origin` along the unit vector `direction` meets the circle from outside.
    pub fn ray_hit(&self, origin: Point, direction: Point) -> Option<RayHit> {
        let way = self.centre - origin;
        let (ahead, aside) = (way.dot(direction), way.cross(direction));
        let half_square = self.radius_mm * self.radius_mm - aside * aside;
        if half_square < 0.0 {
            return None;
        }
        let half = half_square.sqrt();
        (ahead >= half).then(|| RayHit {
            distance_mm: ahead - half,
            cos_incidence: half / self.radius_mm,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ORIGIN: Point = Point::new(0.0, 0.0);

    fn assert_hit(hit: Option<RayHit>, distance_mm: f64, cos_incidence: f64) {
        let hit = hit.expect("a hit");
        assert!((hit.distance_mm - distance_mm).abs() < 1e-9, "{hit:?}");
        assert!((hit.cos_incidence - cos_incidence).abs() < 1e-9, "{hit:?}");
    }

    #[test]
    fn ray_meets_segment_at_distance_and_angle() {
        let wall = Segment::new(Point::new(100.0, -50.0), Point::new(100.0, 50.0));
        assert_hit(wall.ray_hit(ORIGIN, Point::new(1.0, 0.0)), 100.0, 1.0);
        let (sin, cos) = 0.4f64.sin_cos();
        assert_hit(wall.ray_hit(ORIGIN, Point::new(cos, sin)), 100.0 / cos, cos);
        let beside = Point::new(0.0, 60.0);
        for (origin, x, y) in [(ORIGIN, -1.0, 0.0), (ORIGIN, 0.0, 1.0), (beside, 1.0, 0.0)] {
            assert_eq!(wall.ray_hit(origin, Point::new(x, y)), None);
        }
    }

    #[test]
    fn ray_meets_circle_on_near_side() {
        let (centre, radius_mm) = (Point::new(100.0, 0.0), 20.0);
        let pillar = Circle { centre, radius_mm };
        let ahead = Point::new(1.0, 0.0);
        assert_hit(pillar.ray_hit(ORIGIN, ahead), 80.0, 1.0);
        assert_eq!(pillar.ray_hit(Point::new(0.0, 21.0), ahead), None);
        assert_eq!(pillar.ray_hit(Point::new(200.0, 0.0), ahead), None);
        assert!((pillar.distance_mm(Point::new(100.0, 45.0)) - 25.0).abs() < 1e-9);
        assert!(pillar.distance_mm(Point::new(101.0, 1.0)) < 1e-9);
    }

    #[test]
    fn distance_to_segment_is_to_nearest_point() {
        let wall = Segment::new(ORIGIN, Point::new(100.0, 0.0));
        assert!((wall.distance_mm(Point::new(50.0, -7.0)) - 7.0).abs() < 1e-9);
        assert!((wall.distance_mm(Point::new(103.0, 4.0)) - 5.0).abs() < 1e-9);
    }

    #[test]
    fn pieces_cover_segment_without_gaps() {
        let wall = Segment::new(ORIGIN, Point::new(95.0, 0.0));
        let pieces: Vec<Segment> = wall.pieces(10.0).collect();
        assert_eq!(pieces.len(), 10);
        assert!(pieces.windows(2).all(|two| two[0].to == two[1].from));
        assert_eq!((pieces[0].from, pieces[9].to), (wall.from, wall.to));
    }
}
