//! The room the robot drives in: walls, furniture, a start pose and a tour.

mod format;
mod shape;
mod visible;

pub use format::{ParseError, Problem};
pub use shape::{Circle, Hit, Segment};

use crate::Pose;

/// A room in its own frame (the world frame), mm and radians.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Room {
    /// Straight surfaces: walls, and the sides of boxes.
    pub segments: Vec<Segment>,
    /// Round obstacles.
    pub circles: Vec<Circle>,
    /// Where the robot is put down.
    pub start: Pose,
    /// The tour: poses to drive to, one after the other.
    pub tour: Vec<Pose>,
}

/// The text of the default room, an example of the format.
pub const DEFAULT_ROOM: &str = include_str!("../../rooms/two-rooms.room");

impl Room {
    /// Two rooms of together 6 m by 4 m, joined by a doorway of 0.9 m, with furniture and a pillar,
    /// and a tour of more than 25 m along their walls. It starts at the origin heading along x, so
    /// that odometry reset at the start speaks of the same frame.
    ///
    /// # Panics
    /// Never: the text is part of the program and a test reads it.
    #[must_use]
    pub fn two_rooms() -> Self {
        Self::parse(DEFAULT_ROOM).expect("the default room is well-formed")
    }

    /// Adds a wall between two points.
    #[must_use]
    pub fn with_wall(mut self, x1: f64, y1: f64, x2: f64, y2: f64) -> Self {
        self.segments.push(Segment::new(x1, y1, x2, y2));
        self
    }

    /// Adds a box of `width` along its own x and `depth` along its own y, centred on (`x`, `y`) and
    /// turned by `angle` radians.
    #[must_use]
    pub fn with_box(mut self, x: f64, y: f64, width: f64, depth: f64, angle: f64) -> Self {
        let centre = Pose::new(x, y, angle);
        let (w, d) = (width / 2.0, depth / 2.0);
        let corners = [
            centre.point(w, d),
            centre.point(-w, d),
            centre.point(-w, -d),
            centre.point(w, -d),
        ];
        for (from, to) in corners.iter().zip(corners.iter().cycle().skip(1)) {
            self.segments.push(Segment::new(from.0, from.1, to.0, to.1));
        }
        self
    }

    /// Adds a pillar.
    #[must_use]
    pub fn with_circle(mut self, x: f64, y: f64, radius: f64) -> Self {
        self.circles.push(Circle { x, y, radius });
        self
    }

    /// The first surface that the ray from (`x`, `y`) in direction `heading` (radians) meets.
    #[must_use]
    pub fn cast(&self, x: f64, y: f64, heading: f64) -> Option<Hit> {
        let (uy, ux) = heading.sin_cos();
        let straight = self.segments.iter().filter_map(|s| s.hit(x, y, ux, uy));
        let round = self.circles.iter().filter_map(|c| c.hit(x, y, ux, uy));
        straight
            .chain(round)
            .min_by(|a, b| a.distance.total_cmp(&b.distance))
    }

    /// Distance from a point to the nearest surface, mm; infinite in an empty room.
    #[must_use]
    pub fn clearance(&self, x: f64, y: f64) -> f64 {
        let straight = self.segments.iter().map(|s| s.distance(x, y));
        let round = self.circles.iter().map(|c| c.distance(x, y));
        straight.chain(round).fold(f64::INFINITY, f64::min)
    }

    /// Smallest and largest x and y of all surfaces: (`x_min`, `y_min`, `x_max`, `y_max`), mm. All
    /// zero in an empty room.
    #[must_use]
    pub fn bounds(&self) -> (f64, f64, f64, f64) {
        let straight = self
            .segments
            .iter()
            .flat_map(|s| [(s.x1, s.y1), (s.x2, s.y2)]);
        let round = self.circles.iter().flat_map(|c| {
            [
                (c.x - c.radius, c.y - c.radius),
                (c.x + c.radius, c.y + c.radius),
            ]
        });
        straight
            .chain(round)
            .fold(None, |bounds: Option<(f64, f64, f64, f64)>, (x, y)| {
                let (x0, y0, x1, y1) = bounds.unwrap_or((x, y, x, y));
                Some((x0.min(x), y0.min(y), x1.max(x), y1.max(y)))
            })
            .unwrap_or_default()
    }

    /// The same room in the frame of its start: the start is the origin, heading along x. That is
    /// the frame of an odometry that was reset there, and of the map it makes.
    #[must_use]
    pub fn seen_from_start(&self) -> Self {
        let origin = self.start;
        let point = |x, y| {
            let seen = Pose::new(x, y, 0.0).seen_from(&origin);
            (seen.x_mm, seen.y_mm)
        };
        let straight = self.segments.iter().map(|s| {
            let ((x1, y1), (x2, y2)) = (point(s.x1, s.y1), point(s.x2, s.y2));
            Segment::new(x1, y1, x2, y2)
        });
        let round = self.circles.iter().map(|c| {
            let (x, y) = point(c.x, c.y);
            Circle {
                x,
                y,
                radius: c.radius,
            }
        });
        Self {
            segments: straight.collect(),
            circles: round.collect(),
            start: Pose::default(),
            tour: self.tour.iter().map(|way| way.seen_from(&origin)).collect(),
        }
    }

    /// Length of the tour from the start through every way-point on straight lines, mm.
    #[must_use]
    pub fn tour_length(&self) -> f64 {
        let mut at = self.start;
        let mut length = 0.0;
        for way in &self.tour {
            length += (way.x_mm - at.x_mm).hypot(way.y_mm - at.y_mm);
            at = *way;
        }
        length
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_rooms_tour_is_long_and_keeps_clear_of_everything() {
        let room = Room::two_rooms();
        assert_eq!(room.start, Pose::default());
        assert!(room.tour_length() >= 25_000.0, "{}", room.tour_length());
        let mut at = room.start;
        for way in &room.tour {
            for step in 0..=200 {
                let part = f64::from(step) / 200.0;
                let x = at.x_mm + part * (way.x_mm - at.x_mm);
                let y = at.y_mm + part * (way.y_mm - at.y_mm);
                // 100 mm of robot and 150 mm to spare.
                assert!(
                    room.clearance(x, y) > 250.0,
                    "{x} {y}: {}",
                    room.clearance(x, y)
                );
            }
            at = *way;
        }
    }

    #[test]
    fn seen_from_its_start_a_room_looks_the_same_to_the_robot() {
        let text = "wall 0 0 900 0 900 700\ncircle 300 500 50\nstart 400 200 90\nway 400 300 180";
        let room = Room::parse(text).unwrap();
        let own = room.seen_from_start();
        assert_eq!(own.start, Pose::default());
        assert!((own.tour[0].x_mm - 100.0).abs() < 1e-9 && own.tour[0].y_mm.abs() < 1e-9);
        for turn in 0..36 {
            let bearing = f64::from(turn) / 6.0;
            let there = room.cast(400.0, 200.0, room.start.heading_rad + bearing);
            let here = own.cast(0.0, 0.0, bearing);
            let distance = |hit: Option<Hit>| hit.map_or(-1.0, |hit| hit.distance);
            assert!((distance(there) - distance(here)).abs() < 1e-6);
        }
    }

    #[test]
    fn a_cast_ray_meets_the_nearest_of_all_surfaces() {
        let room = Room::default()
            .with_wall(500.0, -500.0, 500.0, 500.0)
            .with_box(300.0, 0.0, 100.0, 200.0, 0.0)
            .with_circle(150.0, 0.0, 10.0);
        assert!((room.cast(0.0, 0.0, 0.0).unwrap().distance - 140.0).abs() < 1e-9);
        assert!((room.cast(0.0, 50.0, 0.0).unwrap().distance - 250.0).abs() < 1e-9);
        assert!((room.cast(0.0, 150.0, 0.0).unwrap().distance - 500.0).abs() < 1e-9);
        assert_eq!(room.cast(0.0, 0.0, 3.0), None);
        assert!((room.clearance(150.0, 30.0) - 20.0).abs() < 1e-9);
        assert_eq!(room.bounds(), (140.0, -500.0, 500.0, 500.0));
    }
}
