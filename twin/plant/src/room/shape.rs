//! The geometry a room is made of.

/// A straight surface, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// One end's x.
    pub x1: f64,
    /// One end's y.
    pub y1: f64,
    /// The other end's x.
    pub x2: f64,
    /// The other end's y.
    pub y2: f64,
}

/// A round obstacle, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Circle {
    /// Centre's x.
    pub x: f64,
    /// Centre's y.
    pub y: f64,
    /// Radius.
    pub radius: f64,
}

/// Where a ray meets a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance along the ray, mm.
    pub distance: f64,
    /// Cosine of the angle between the ray and the surface's normal: 1 = square on, 0 = grazing.
    pub cos_incidence: f64,
}

impl Segment {
    /// A segment from end to end.
    #[must_use]
    pub const fn new(x1: f64, y1: f64, x2: f64, y2: f64) -> Self {
        Self { x1, y1, x2, y2 }
    }

    /// Length, mm.
    #[must_use]
    pub fn length(&self) -> f64 {
        (self.x2 - self.x1).hypot(self.y2 - self.y1)
    }

    /// The point at `part` (0..=1) of the way.
    #[must_use]
    pub fn at(&self, part: f64) -> (f64, f64) {
        (
            self.x1 + part * (self.x2 - self.x1),
            self.y1 + part * (self.y2 - self.y1),
        )
    }

    /// Distance of a point to the nearest point of the segment, mm.
    #[must_use]
    pub fn distance(&self, x: f64, y: f64) -> f64 {
        let (dx, dy) = (self.x2 - self.x1, self.y2 - self.y1);
        let square = dx * dx + dy * dy;
        let along = (x - self.x1) * dx + (y - self.y1) * dy;
        let part = if square > 0.0 {
            (along / square).clamp(0.0, 1.0)
        } else {
            0.0
        };
        let (px, py) = self.at(part);
        (x - px).hypot(y - py)
    }

    /// Where the ray from (`x`, `y`) along the unit vector (`ux`, `uy`) meets the segment.
    #[must_use]
    pub fn hit(&self, x: f64, y: f64, ux: f64, uy: f64) -> Option<Hit> {
        let (dx, dy) = (self.x2 - self.x1, self.y2 - self.y1);
        let cross = ux * dy - uy * dx;
        if cross.abs() < 1e-9 {
            return None;
        }
        let (ox, oy) = (self.x1 - x, self.y1 - y);
        let distance = (ox * dy - oy * dx) / cross;
        let part = (ox * uy - oy * ux) / cross;
        ((0.0..=1.0).contains(&part) && distance >= 0.0).then(|| Hit {
            distance,
            cos_incidence: (cross / dx.hypot(dy)).abs(),
        })
    }
}

impl Circle {
    /// Distance of a point to the circle's line, mm; 0 inside.
    #[must_use]
    pub fn distance(&self, x: f64, y: f64) -> f64 {
        ((x - self.x).hypot(y - self.y) - self.radius).max(0.0)
    }

    /// Where the ray from (`x`, `y`) along the unit vector (`ux`, `uy`) meets the circle from
    /// outside.
    #[must_use]
    pub fn hit(&self, x: f64, y: f64, ux: f64, uy: f64) -> Option<Hit> {
        let (ox, oy) = (self.x - x, self.y - y);
        let ahead = ox * ux + oy * uy;
        let aside = ox * uy - oy * ux;
        let half_square = self.radius * self.radius - aside * aside;
        if half_square < 0.0 {
            return None;
        }
        let half = half_square.sqrt();
        let distance = ahead - half;
        (distance >= 0.0).then(|| Hit {
            distance,
            cos_incidence: half / self.radius,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ray_meets_a_wall_at_the_distance_and_angle_of_geometry() {
        let wall = Segment::new(100.0, -50.0, 100.0, 50.0);
        let hit = wall.hit(0.0, 0.0, 1.0, 0.0).unwrap();
        assert!((hit.distance - 100.0).abs() < 1e-9 && (hit.cos_incidence - 1.0).abs() < 1e-9);
        let (sin, cos) = 0.4f64.sin_cos();
        let hit = wall.hit(0.0, 0.0, cos, sin).unwrap();
        assert!(
            (hit.distance - 100.0 / cos).abs() < 1e-9 && (hit.cos_incidence - cos).abs() < 1e-9
        );
        assert_eq!(wall.hit(0.0, 0.0, -1.0, 0.0), None);
        assert_eq!(wall.hit(0.0, 60.0, 1.0, 0.0), None);
        assert_eq!(wall.hit(0.0, 0.0, 0.0, 1.0), None);
    }

    #[test]
    fn a_ray_meets_a_circle_on_its_near_side() {
        let pillar = Circle {
            x: 100.0,
            y: 0.0,
            radius: 20.0,
        };
        let hit = pillar.hit(0.0, 0.0, 1.0, 0.0).unwrap();
        assert!((hit.distance - 80.0).abs() < 1e-9 && (hit.cos_incidence - 1.0).abs() < 1e-9);
        assert_eq!(pillar.hit(0.0, 21.0, 1.0, 0.0), None);
        assert_eq!(pillar.hit(200.0, 0.0, 1.0, 0.0), None);
    }

    #[test]
    fn distances_are_to_the_nearest_point() {
        let wall = Segment::new(0.0, 0.0, 100.0, 0.0);
        assert!((wall.distance(50.0, -7.0) - 7.0).abs() < 1e-9);
        assert!((wall.distance(103.0, 4.0) - 5.0).abs() < 1e-9);
        let pillar = Circle {
            x: 0.0,
            y: 0.0,
            radius: 10.0,
        };
        assert!((pillar.distance(3.0, 40.0) - (1609f64.sqrt() - 10.0)).abs() < 1e-9);
        assert!(pillar.distance(1.0, 1.0) < 1e-9);
    }
}
