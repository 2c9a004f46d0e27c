//! Which surfaces of a room are visible from the space the robot can reach.

use std::f64::consts::TAU;

use geometry::{Point, Segment};

use super::Room;
use crate::Pose2;

/// Cell of the flood fill, mm. Gaps narrower than about this are closed.
const CELL_MM: f64 = 25.0;
/// How far in front of a surface its free space is looked for, mm.
const AHEAD_MM: f64 = 45.0;
/// Length of the pieces in which surfaces are judged, mm.
const PIECE_MM: f64 = 20.0;

impl Room {
    /// The surfaces that face the space reachable from `start`, as straight pieces of at most
    /// 20 mm: what a perfect map shows. What furniture hides, the inside of boxes and the walls
    /// behind them, is left out.
    #[must_use]
    pub fn visible_surfaces(&self) -> Vec<Segment> {
        let free = FreeSpace::flood(self);
        let round = self.circles.iter().flat_map(|circle| {
            let pieces = ceil_count(circle.radius_mm * TAU / PIECE_MM).max(8);
            let point = move |index: u32| {
                let heading_rad = TAU * f64::from(index) / f64::from(pieces);
                Pose2 {
                    x_mm: circle.centre.x_mm,
                    y_mm: circle.centre.y_mm,
                    heading_rad,
                }
                .point_at(circle.radius_mm, 0.0)
            };
            (0..pieces).map(move |index| Segment::new(point(index), point(index + 1)))
        });
        self.straight()
            .flat_map(|segment| segment.pieces(PIECE_MM))
            .chain(round)
            .filter(|piece| free.faces(piece))
            .collect()
    }
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // lengths of rooms
fn ceil_count(value: f64) -> u32 {
    value.ceil() as u32
}

/// The cells that can be reached from the start.
struct FreeSpace {
    origin: Point,
    columns: usize,
    reached: Vec<bool>,
}

impl FreeSpace {
    #[allow(clippy::cast_precision_loss)] // cell numbers
    fn flood(room: &Room) -> Self {
        let (low, high) = room.bounds();
        let origin = Point::new(low.x_mm - 3.0 * CELL_MM, low.y_mm - 3.0 * CELL_MM);
        let columns = ceil_count((high.x_mm - origin.x_mm) / CELL_MM) as usize + 3;
        let rows = ceil_count((high.y_mm - origin.y_mm) / CELL_MM) as usize + 3;
        let mut space = Self {
            origin,
            columns,
            reached: vec![false; columns * rows],
        };
        let mut todo: Vec<usize> = space.index(room.start.position()).into_iter().collect();
        let mut seen = vec![false; columns * rows];
        while let Some(index) = todo.pop() {
            if std::mem::replace(&mut seen[index], true) {
                continue;
            }
            let (column, row) = (index % columns, index / columns);
            let middle = Point::new(
                origin.x_mm + (column as f64 + 0.5) * CELL_MM,
                origin.y_mm + (row as f64 + 0.5) * CELL_MM,
            );
            // Half a cell's diagonal: no step between open cells crosses a surface.
            if room.clearance_mm(middle) < CELL_MM * 0.72 {
                continue;
            }
            space.reached[index] = true;
            todo.extend((column > 0).then(|| index - 1));
            todo.extend((column + 1 < columns).then_some(index + 1));
            todo.extend((row > 0).then(|| index - columns));
            todo.extend((row + 1 < rows).then_some(index + columns));
        }
        space
    }

    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // checked
    fn index(&self, point: Point) -> Option<usize> {
        let column = (point.x_mm - self.origin.x_mm) / CELL_MM;
        let row = (point.y_mm - self.origin.y_mm) / CELL_MM;
        if column < 0.0 || row < 0.0 || column as usize >= self.columns {
            return None;
        }
        let index = row as usize * self.columns + column as usize;
        (index < self.reached.len()).then_some(index)
    }

    fn faces(&self, piece: &Segment) -> bool {
        let middle = piece.from.lerp(piece.to, 0.5);
        let (dx, dy) = (
            piece.to.x_mm - piece.from.x_mm,
            piece.to.y_mm - piece.from.y_mm,
        );
        let along = Pose2::new(middle.x_mm, middle.y_mm, dy.atan2(dx));
        // Also a little to the side: in a corner the fill stays away from the other wall.
        [0.0, AHEAD_MM, -AHEAD_MM].into_iter().any(|aside| {
            [AHEAD_MM, -AHEAD_MM].into_iter().any(|ahead| {
                let index = self.index(along.point_at(aside, ahead));
                index.is_some_and(|index| self.reached[index])
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn visible_length_counts_what_faces_reachable_space() {
        // Of a box against a wall, 400 mm of wall are hidden, its front and sides come on top; the
        // pieces in the corners are uncertain.
        for (obstacle, expected, tolerance) in [
            ("", 6000.0, 1e-6),
            ("box 1000 100 400 200", 6400.0, 100.0),
            ("circle 3000 500 100", 6000.0, 1e-6),
        ] {
            let text = format!("wall 0 0 2000 0 2000 1000 0 1000 0 0\n{obstacle}\nstart 500 500 0");
            let visible = Room::parse(&text).unwrap().visible_surfaces();
            let length: f64 = visible.iter().map(Segment::length_mm).sum();
            assert!(
                (length - expected).abs() < tolerance,
                "{obstacle}: {length}"
            );
        }
    }
}
