//! Which surfaces of a room the rangefinders can see from the floor that the robot can reach.

use std::f64::consts::TAU;

use geometry::Segment;

use super::Room;
use super::reachable::{CELL_MM, ClearanceGrid, REACHABLE_MM};
use crate::Pose2;

/// Length of the pieces in which surfaces are judged, mm.
const PIECE_MM: f64 = 20.0;
/// Angles to the surface's normal from which it counts as visible, degrees.
const ANGLES_DEG: [f64; 5] = [0.0, 12.5, -12.5, 25.0, -25.0];
/// Range of the rangefinders, and on soft surfaces, mm; the sensors sit up to 80 mm off the axle.
const RANGE_MM: f64 = 2500.0;
const SOFT_RANGE_MM: f64 = 1000.0;
/// A piece is looked at from this far in front, mm.
const AHEAD_MM: f64 = 1.0;

impl Room {
    /// The surfaces that are visible from the reachable floor, as straight pieces of at most 20 mm: what
    /// a perfect map shows. Visible is what lies within range of a reachable cell, in sight, and within
    /// 25° of its normal.
    pub fn visible_surfaces(&self) -> Vec<Segment> {
        let grid = ClearanceGrid::new(self);
        let reached = grid.flood(self.start.position(), REACHABLE_MM);
        let sees = |from: &Pose2, range_mm: f64| {
            let hit = self.cast(from).map_or(f64::INFINITY, |hit| hit.distance_mm);
            let mut distance = REACHABLE_MM - CELL_MM;
            while distance < hit.min(range_mm) {
                let at = grid.index(from.point_at(distance, 0.0));
                if at.is_some_and(|index| reached[index]) {
                    return true;
                }
                distance += CELL_MM;
            }
            false
        };
        let faces = |piece: &Segment, sides: &[f64], range_mm: f64| {
            let middle = piece.from.lerp(piece.to, 0.5);
            let along = (piece.to - piece.from).angle_rad();
            sides.iter().any(|side| {
                let normal = along + side * TAU / 4.0;
                let ahead = Pose2::at(middle, normal).point_at(AHEAD_MM, 0.0);
                ANGLES_DEG.iter().any(|angle| {
                    let heading = normal + angle.to_radians();
                    sees(&Pose2::at(ahead, heading), range_mm)
                })
            })
        };
        let straight = |surfaces: &[Segment], range_mm: f64| {
            let pieces = surfaces.iter().flat_map(|surface| surface.pieces(PIECE_MM));
            let visible = pieces.filter(|piece| faces(piece, &[1.0, -1.0], range_mm));
            visible.collect::<Vec<Segment>>()
        };
        let mut visible = straight(&self.segments, RANGE_MM);
        visible.extend(straight(&self.soft, SOFT_RANGE_MM));
        for circle in &self.circles {
            let count = ceil_count(circle.radius_mm * TAU / PIECE_MM).max(8);
            let point = |nth: u32| {
                let heading = TAU * f64::from(nth) / f64::from(count);
                Pose2::at(circle.centre, heading).point_at(circle.radius_mm, 0.0)
            };
            let pieces = (0..count).map(|nth| Segment::new(point(nth), point(nth + 1)));
            // Counter-clockwise: the outside is to the right.
            visible.extend(pieces.filter(|piece| faces(piece, &[-1.0], RANGE_MM)));
        }
        visible
    }
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // lengths of rooms
fn ceil_count(value: f64) -> u32 {
    value.ceil() as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    const WALLS: &str = "wall 0 0 3000 0 3000 2000 0 2000 0 0\nstart 500 500 0\n";

    fn visible_mm(obstacle: &str) -> f64 {
        let room = Room::parse(&format!("{WALLS}{obstacle}")).unwrap();
        room.visible_surfaces().iter().map(Segment::length_mm).sum()
    }

    #[test]
    fn visible_length_counts_what_faces_reachable_floor() {
        // All walls. Of a box against a wall, 400 mm of wall are hidden, its front and sides come on
        // top. A pillar adds its circumference; the pieces in the corners are uncertain.
        for (obstacle, expected) in [
            ("", 10_000.0),
            ("box 1500 100 400 200", 10_400.0),
            ("circle 1500 1000 100", 10_628.0),
            // Closed off: the room beyond is not reached.
            ("wall 2000 0 2000 2000", 8_000.0),
            // The door is too narrow to pass, yet the far wall is seen through it.
            ("wall 2000 0 2000 900\nwall 2000 1100 2000 2000", 9_050.0),
        ] {
            let length = visible_mm(obstacle);
            assert!((length - expected).abs() < 200.0, "{obstacle}: {length}");
        }
    }

    #[test]
    fn far_and_oblique_surfaces_are_not_visible() {
        // The end of a niche too narrow to enter, 200 mm wide: seen up to the range, less if soft.
        let niche = |end: &str| {
            let walls = "wall 1000 0 0 0 0 2000 1000 2000 1000 1100\nwall 1000 0 1000 900";
            let text = format!("{walls}\nwall 1000 1100 9000 1100\nwall 1000 900 9000 900\n{end}");
            let room = Room::parse(&format!("{text}\nstart 500 1000 0")).unwrap();
            let surfaces = room.visible_surfaces();
            let at_end = |s: &&Segment| s.from.x_mm > 1500.0;
            let lengths = surfaces.iter().filter(at_end).map(Segment::length_mm);
            lengths.sum::<f64>()
        };
        let far = |x: f64| format!("wall {x} 900 {x} 1100");
        assert!((niche(&far(3200.0)) - 200.0).abs() < 45.0);
        assert!(niche(&far(3600.0)) < 1.0, "beyond the range");
        assert!(niche(&format!("soft {}", far(1700.0))) > 150.0);
        assert!(niche(&format!("soft {}", far(2000.0))) < 1.0, "soft");
        assert!(niche("wall 2000 900 2200 1100") < 1.0, "45 degrees");
    }
}
