//! Furniture at a wall, on legs, or free in a room.

use geometry::Point;

use super::{PASSAGE_MM, Rect, between, chance};
use crate::room::reachable::CELL_MM;
use crate::{Pose2, Rng, Room};

/// How far furniture may stick into other furniture unnoticed, mm.
pub(super) const FOOTPRINT_MM: f64 = 30.0;

/// A piece of furniture.
pub(super) struct Piece {
    pub(super) surfaces: Room,
    /// Points inside of it that must be clear of other surfaces.
    pub(super) footprint: Vec<Point>,
    /// Points that must lie on open floor.
    pub(super) on_open_floor: Vec<Point>,
}

impl Piece {
    /// Any piece somewhere in a rectangular room.
    pub(super) fn draw(rng: &mut Rng, rect: &Rect) -> Self {
        let side = rect.side(rng);
        let straight = Pose2::at(rect.point(rng), 0.0);
        let turned = straight.facing(rng.within(std::f64::consts::PI));
        match rng.below(8) {
            // Cupboards and shelves.
            0..=2 => {
                let (depth, width) = (between(rng, (250.0, 600.0)), between(rng, (400.0, 1200.0)));
                Self::at_wall(rng, side, depth, width)
            }
            // A sofa.
            3 => {
                let (depth, width) = (between(rng, (600.0, 900.0)), between(rng, (900.0, 1900.0)));
                Self::at_wall(rng, side, depth, width).softened()
            }
            // A curtain.
            4 => {
                let width = between(rng, (600.0, 1600.0));
                Self::at_wall(rng, side, 2.0 * FOOTPRINT_MM, width).softened()
            }
            // A table to drive under.
            5 => {
                let (width, depth) = (between(rng, (600.0, 1200.0)), between(rng, (550.0, 800.0)));
                Self::legs(&straight, width, depth, between(rng, (15.0, 30.0)))
            }
            // A stool with legs too close for the robot.
            6 => {
                let side = between(rng, (200.0, 260.0));
                Self::legs(&turned, side, side, between(rng, (10.0, 15.0)))
            }
            // A crate, or a pillar.
            _ if chance(rng, 0.6) => {
                let (width, depth) = (between(rng, (250.0, 600.0)), between(rng, (250.0, 500.0)));
                Self::block(&turned, width, depth, vec![turned.position()])
            }
            _ => Self::legs(&turned, 0.0, 0.0, between(rng, (60.0, 200.0))),
        }
    }

    /// A box of `depth` along its centre's heading.
    fn block(centre: &Pose2, depth: f64, width: f64, on_open_floor: Vec<Point>) -> Self {
        let inner = |size: f64| (size / 2.0 - FOOTPRINT_MM).max(0.0);
        let (rows, columns) = (inner(depth), inner(width));
        let shares = || (-8..=8).map(|nth| f64::from(nth) / 8.0);
        let row = |x: f64| shares().map(move |y| centre.point_at(x * rows, y * columns));
        Self {
            surfaces: Room::default().with_box(centre, depth, width),
            footprint: shares().flat_map(row).collect(),
            on_open_floor,
        }
    }

    /// A box with its back to a wall, somewhere along it.
    fn at_wall(rng: &mut Rng, (wall, length): (Pose2, f64), depth: f64, width: f64) -> Self {
        let width = width.min(length);
        let along = rng.within((length - width) / 2.0);
        let centre = wall.point_at(depth / 2.0, along);
        let before = wall.point_at(depth + PASSAGE_MM + CELL_MM, along);
        let centre = Pose2::at(centre, wall.heading_rad);
        Self::block(&centre, depth, width, vec![before])
    }

    /// Four legs at the corners of a rectangle, or a pillar where it has no size.
    fn legs(centre: &Pose2, width: f64, depth: f64, radius_mm: f64) -> Self {
        let corners = [(0.5, 0.5), (-0.5, 0.5), (-0.5, -0.5), (0.5, -0.5)];
        let count = if width > 0.0 { 4 } else { 1 };
        let legs = corners[..count].iter();
        let legs = legs.map(|(x, y)| centre.point_at(x * width, y * depth));
        let on_open_floor: Vec<Point> = legs.collect();
        let stand = |room: Room, leg: &Point| room.with_circle(*leg, radius_mm);
        Self {
            surfaces: on_open_floor.iter().fold(Room::default(), stand),
            footprint: Vec::new(),
            on_open_floor,
        }
    }

    fn softened(mut self) -> Self {
        self.surfaces.soft.append(&mut self.surfaces.segments);
        self
    }
}
