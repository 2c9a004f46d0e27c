//! The room the robot drives in: walls, furniture, a start pose and a tour.

mod format;
mod generate;
mod reachable;
mod visible;

pub use format::{ParseError, Problem};
pub use generate::generate;

use geometry::{Circle, Point, RayHit, Segment};

use crate::Pose2;

/// A room in its own frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Room {
    /// Straight hard surfaces: walls, and the sides of boxes.
    pub segments: Vec<Segment>,
    /// Straight soft surfaces, which absorb most of an echo: curtains, and the sides of sofas.
    pub soft: Vec<Segment>,
    /// Door sills and carpet edges: the robot drives over them, a rangefinder does not see them.
    pub sills: Vec<Segment>,
    /// Round obstacles.
    pub circles: Vec<Circle>,
    /// Where the robot starts.
    pub start: Pose2,
    /// The tour: poses to drive to, in order.
    pub tour: Vec<Pose2>,
}

impl Room {
    /// Two rooms of together 6 m by 4 m, joined by a doorway of 0.9 m, with furniture and a pillar,
    /// and a tour of more than 25 m along their walls. It starts at the origin heading along x, so
    /// the frame of an odometry reset at the start is the room's own.
    ///
    /// # Panics
    /// Never: a test reads the text.
    pub fn two_rooms() -> Self {
        let text = include_str!("../../rooms/two-rooms.room");
        Self::parse(text).expect("the default room is well-formed")
    }

    /// Adds a wall between two points, mm.
    #[must_use]
    pub fn with_wall(mut self, x1: f64, y1: f64, x2: f64, y2: f64) -> Self {
        let wall = Segment::new(Point::new(x1, y1), Point::new(x2, y2));
        self.segments.push(wall);
        self
    }

    /// Adds a box of `width` along the x and `depth` along the y of its `centre`, mm.
    #[must_use]
    pub fn with_box(mut self, centre: &Pose2, width: f64, depth: f64) -> Self {
        let corners = [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)]
            .map(|(x, y)| centre.point_at(x * width / 2.0, y * depth / 2.0));
        let sides = (0..4).map(|nth| Segment::new(corners[nth], corners[(nth + 1) % 4]));
        self.segments.extend(sides);
        self
    }

    /// Adds a pillar.
    #[must_use]
    pub fn with_circle(mut self, centre: Point, radius_mm: f64) -> Self {
        self.circles.push(Circle { centre, radius_mm });
        self
    }

    /// Every straight surface, hard ones first.
    pub fn straight(&self) -> impl Iterator<Item = &Segment> {
        self.segments.iter().chain(&self.soft)
    }

    /// The first surface on the ray from `from` along its heading.
    pub fn cast(&self, from: &Pose2) -> Option<RayHit> {
        let (origin, direction) = (from.position(), from.direction());
        let straight = self.straight().map(|s| s.ray_hit(origin, direction));
        let round = self.circles.iter().map(|c| c.ray_hit(origin, direction));
        straight
            .chain(round)
            .flatten()
            .min_by(|a, b| a.distance_mm.total_cmp(&b.distance_mm))
    }

    /// Distance from a point to the nearest surface, mm; infinite in an empty room.
    pub fn clearance_mm(&self, point: Point) -> f64 {
        let straight = self.straight().map(|s| s.distance_mm(point));
        let round = self.circles.iter().map(|c| c.distance_mm(point));
        straight.chain(round).fold(f64::INFINITY, f64::min)
    }

    /// Corners of the bounding box of all surfaces: smallest and largest x and y. Both zero in an
    /// empty room.
    pub fn bounds(&self) -> (Point, Point) {
        let straight = self.straight().flat_map(|s| [s.from, s.to]);
        let round = self.circles.iter().flat_map(|c| {
            let corner = Point::new(c.radius_mm, c.radius_mm);
            [c.centre - corner, c.centre + corner]
        });
        Point::bounds(straight.chain(round)).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn default_tour_is_clear_of_obstacles() {
        let room = Room::two_rooms();
        assert_eq!(room.start, Pose2::default());
        let mut at = room.start.position();
        for goal in &room.tour {
            for step in 0..=200 {
                let point = at.lerp(goal.position(), f64::from(step) / 200.0);
                // 100 mm of robot and 150 mm to spare.
                assert!(room.clearance_mm(point) > 250.0, "{point:?}");
            }
            at = goal.position();
        }
    }

    #[test]
    fn cast_ray_meets_nearest_of_all_surfaces() {
        let room = Room::default()
            .with_wall(500.0, -500.0, 500.0, 500.0)
            .with_box(&Pose2::new(300.0, 0.0, 0.0), 100.0, 200.0)
            .with_circle(Point::new(150.0, 0.0), 10.0);
        for (y, expected) in [(0.0, 140.0), (50.0, 250.0), (150.0, 500.0)] {
            let hit = room.cast(&Pose2::new(0.0, y, 0.0)).unwrap();
            assert!((hit.distance_mm - expected).abs() < 1e-9);
        }
        assert_eq!(room.cast(&Pose2::new(0.0, 0.0, 3.0)), None);
        assert!((room.clearance_mm(Point::new(150.0, 30.0)) - 20.0).abs() < 1e-9);
        let bounds = (Point::new(140.0, -500.0), Point::new(500.0, 500.0));
        assert_eq!(room.bounds(), bounds);
    }
}
