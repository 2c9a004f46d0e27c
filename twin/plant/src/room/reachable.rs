//! The floor that the robot can reach, on a grid.

use geometry::Point;

use super::Room;

/// Width of a cell, mm.
pub const CELL_MM: f64 = 25.0;
/// Clearance that the middle of the axle needs to count as reachable, mm: the first board's body of
/// 100 mm and 50 mm around it.
pub const REACHABLE_MM: f64 = 150.0;
/// Cells around the room's bounds.
const MARGIN: f64 = 3.0;

/// Cells of a rectangle around a room.
#[derive(Clone, Debug)]
pub(super) struct ClearanceGrid {
    origin: Point,
    columns: usize,
    /// Distance of each cell's middle to the nearest surface, mm, row by row.
    clearance: Vec<f64>,
}

impl ClearanceGrid {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // lengths of rooms
    pub(super) fn new(room: &Room) -> Self {
        let (low, high) = room.bounds();
        let margin = MARGIN * CELL_MM;
        let origin = low - Point::new(margin, margin);
        let cells = |from: f64, to: f64| ((to + margin - from) / CELL_MM).ceil() as usize;
        let columns = cells(origin.x_mm, high.x_mm);
        let rows = cells(origin.y_mm, high.y_mm);
        let mut grid = Self {
            origin,
            columns,
            clearance: vec![f64::INFINITY; columns * rows],
        };
        grid.add(room);
        grid
    }

    /// More surfaces.
    pub(super) fn add(&mut self, surfaces: &Room) {
        for index in 0..self.clearance.len() {
            let clearance = surfaces.clearance_mm(self.middle(index));
            self.clearance[index] = self.clearance[index].min(clearance);
        }
    }

    #[allow(clippy::cast_precision_loss)] // cell numbers
    pub(super) fn middle(&self, index: usize) -> Point {
        let (column, row) = (index % self.columns, index / self.columns);
        self.origin + Point::new(column as f64 + 0.5, row as f64 + 0.5) * CELL_MM
    }

    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // checked
    pub(super) fn index(&self, point: Point) -> Option<usize> {
        let Point { x_mm, y_mm } = point - self.origin;
        let (column, row) = (x_mm / CELL_MM, y_mm / CELL_MM);
        if column < 0.0 || row < 0.0 || column as usize >= self.columns {
            return None;
        }
        let index = row as usize * self.columns + column as usize;
        (index < self.clearance.len()).then_some(index)
    }

    pub(super) fn clearance_mm(&self, index: usize) -> f64 {
        self.clearance[index]
    }

    /// `cells` and their neighbours.
    pub(super) fn grown(&self, cells: &[bool]) -> Vec<bool> {
        let grown = |index| cells[index] || self.beside(index).any(|next| cells[next]);
        (0..cells.len()).map(grown).collect()
    }

    /// The cells at a cell's sides. The margin around the room keeps a side step from wrapping into the
    /// next row, unless the room is open; there the next row's end is as free.
    fn beside(&self, index: usize) -> impl Iterator<Item = usize> {
        let steps = [1, self.columns].map(|step| [index.checked_sub(step), Some(index + step)]);
        let inside = |index: &usize| *index < self.clearance.len();
        steps.into_iter().flatten().flatten().filter(inside)
    }

    /// Which cells can be reached from `start` with this clearance all the way, over cells' sides. At
    /// least half a cell's diagonal is needed, so that no step crosses a surface.
    pub(super) fn flood(&self, start: Point, clearance_mm: f64) -> Vec<bool> {
        let needed = clearance_mm.max(CELL_MM * 0.72);
        let mut reached = vec![false; self.clearance.len()];
        let mut todo: Vec<usize> = self.index(start).into_iter().collect();
        while let Some(index) = todo.pop() {
            if reached[index] || self.clearance[index] < needed {
                continue;
            }
            reached[index] = true;
            todo.extend(self.beside(index));
        }
        reached
    }
}

impl Room {
    /// The reachable floor: the middles of the 25 mm cells in which the middle of the robot's axle can
    /// come to stand from the start with 50 mm around its body. Empty where the start is too narrow.
    pub fn reachable_floor(&self) -> Vec<Point> {
        let grid = ClearanceGrid::new(self);
        let reached = grid.flood(self.start.position(), REACHABLE_MM);
        let cells = reached.iter().enumerate().filter(|(_, reached)| **reached);
        cells.map(|(index, _)| grid.middle(index)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reachable_floor_keeps_body_and_margin_from_walls() {
        // Two halves of 950 mm by 1000 mm; a door of 290 mm is too narrow, one of 310 mm is not.
        for (door_mm, expected) in [(290.0, 0.65 * 0.7), (350.0, 0.65 * 0.7 * 2.0 + 0.4 * 0.05)] {
            let text = format!(
                "wall 0 0 2000 0 2000 1000 0 1000 0 0\nbox 1000 {} 100 {}\nstart 500 500 0",
                (1000.0 - door_mm) / 2.0,
                1000.0 - door_mm
            );
            let room = Room::parse(&text).unwrap();
            let floor = room.reachable_floor();
            let nearest = |p: &Point| room.clearance_mm(*p);
            assert!(floor.iter().map(nearest).fold(f64::MAX, f64::min) >= REACHABLE_MM);
            #[allow(clippy::cast_precision_loss)]
            let area = floor.len() as f64 * (CELL_MM / 1000.0).powi(2);
            assert!((area - expected).abs() < 0.06, "{door_mm}: {area}");
        }
        let narrow = Room::parse("wall 0 0 200 0 200 200 0 200 0 0\nstart 100 100 0").unwrap();
        assert!(narrow.reachable_floor().is_empty());
    }
}
