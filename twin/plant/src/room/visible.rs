//! Which surfaces a robot in the room can possibly see.

use super::{Room, Segment};

/// Cell of the flood fill, mm. Gaps narrower than about this are closed.
const CELL: f64 = 25.0;
/// How far in front of a surface its free space is looked for, mm.
const AHEAD: f64 = 45.0;
/// Length of the pieces that surfaces are judged in, mm.
const PIECE: f64 = 20.0;

impl Room {
    /// The surfaces that face the space which can be reached from `start`, as straight pieces of at
    /// most 20 mm (mm). What furniture hides, the inside of boxes and walls behind them, is left
    /// out: a perfect map shows exactly these.
    #[must_use]
    pub fn visible_surfaces(&self) -> Vec<Segment> {
        let free = FreeSpace::flood(self);
        let round = self.circles.iter().flat_map(|circle| {
            let pieces = ceil_count(circle.radius * std::f64::consts::TAU / PIECE).max(8);
            let point = move |index: u32| {
                let angle = std::f64::consts::TAU * f64::from(index) / f64::from(pieces);
                (
                    circle.x + circle.radius * angle.cos(),
                    circle.y + circle.radius * angle.sin(),
                )
            };
            (0..pieces).map(move |index| {
                let ((x1, y1), (x2, y2)) = (point(index), point(index + 1));
                Segment::new(x1, y1, x2, y2)
            })
        });
        let straight = self.segments.iter().flat_map(|segment| {
            let pieces = ceil_count(segment.length() / PIECE).max(1);
            (0..pieces).map(move |index| {
                let (x1, y1) = segment.at(f64::from(index) / f64::from(pieces));
                let (x2, y2) = segment.at(f64::from(index + 1) / f64::from(pieces));
                Segment::new(x1, y1, x2, y2)
            })
        });
        straight
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
    x0: f64,
    y0: f64,
    columns: usize,
    reached: Vec<bool>,
}

impl FreeSpace {
    #[allow(clippy::cast_precision_loss)] // cell numbers
    fn flood(room: &Room) -> Self {
        let (x_min, y_min, x_max, y_max) = room.bounds();
        let (x0, y0) = (x_min - 3.0 * CELL, y_min - 3.0 * CELL);
        let columns = ceil_count((x_max - x0) / CELL) as usize + 3;
        let rows = ceil_count((y_max - y0) / CELL) as usize + 3;
        let mut space = Self {
            x0,
            y0,
            columns,
            reached: vec![false; columns * rows],
        };
        let mut todo: Vec<usize> = space
            .index(room.start.x_mm, room.start.y_mm)
            .into_iter()
            .collect();
        let mut seen = vec![false; columns * rows];
        while let Some(index) = todo.pop() {
            if std::mem::replace(&mut seen[index], true) {
                continue;
            }
            let (column, row) = (index % columns, index / columns);
            let x = x0 + (column as f64 + 0.5) * CELL;
            let y = y0 + (row as f64 + 0.5) * CELL;
            // Half a cell's diagonal: no step between open cells crosses a surface.
            if room.clearance(x, y) < CELL * 0.72 {
                continue;
            }
            space.reached[index] = true;
            if column > 0 {
                todo.push(index - 1);
            }
            if column + 1 < columns {
                todo.push(index + 1);
            }
            if row > 0 {
                todo.push(index - columns);
            }
            if row + 1 < rows {
                todo.push(index + columns);
            }
        }
        space
    }

    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // checked
    fn index(&self, x: f64, y: f64) -> Option<usize> {
        let (column, row) = ((x - self.x0) / CELL, (y - self.y0) / CELL);
        if column < 0.0 || row < 0.0 || column as usize >= self.columns {
            return None;
        }
        let index = row as usize * self.columns + column as usize;
        (index < self.reached.len()).then_some(index)
    }

    fn faces(&self, piece: &Segment) -> bool {
        let length = piece.length();
        let (ux, uy) = (
            (piece.x2 - piece.x1) / length,
            (piece.y2 - piece.y1) / length,
        );
        let (x, y) = piece.at(0.5);
        // Also a little to the side: in a corner the fill stays away from the other wall.
        [0.0, AHEAD, -AHEAD].into_iter().any(|along| {
            [AHEAD, -AHEAD].into_iter().any(|ahead| {
                let (px, py) = (x + along * ux - ahead * uy, y + along * uy + ahead * ux);
                self.index(px, py).is_some_and(|index| self.reached[index])
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn length(pieces: &[Segment]) -> f64 {
        pieces.iter().map(Segment::length).sum()
    }

    #[test]
    fn an_empty_room_shows_all_its_walls() {
        let room = Room::parse("wall 0 0 2000 0 2000 1000 0 1000 0 0\nstart 500 500 0").unwrap();
        assert!((length(&room.visible_surfaces()) - 6000.0).abs() < 1e-6);
    }

    #[test]
    fn a_cupboard_hides_its_back_and_the_wall_behind_it() {
        let text = "wall 0 0 2000 0 2000 1000 0 1000 0 0\nbox 1000 100 400 200\nstart 500 500 0";
        let seen = length(&Room::parse(text).unwrap().visible_surfaces());
        // 400 mm of wall go, front and two sides come; the pieces in the corners are uncertain.
        assert!((seen - 6400.0).abs() < 100.0, "{seen}");
    }

    #[test]
    fn what_is_outside_the_walls_is_not_seen() {
        let text = "wall 0 0 2000 0 2000 1000 0 1000 0 0\ncircle 3000 500 100\nstart 500 500 0";
        let seen = length(&Room::parse(text).unwrap().visible_surfaces());
        assert!((seen - 6000.0).abs() < 1e-6);
    }
}
