//! Rooms from a seed: a flat of two to four rooms with doors and furniture.

mod furniture;

use furniture::{FOOTPRINT_MM, Piece};
use geometry::{Point, Segment};

use super::Room;
use super::reachable::{CELL_MM, ClearanceGrid, REACHABLE_MM};
use crate::{Pose2, Rng};

/// Area of the floor, m².
const AREA_M2: (f64, f64) = (12.5, 39.5);
/// Width of a door, mm.
const DOOR_MM: (f64, f64) = (700.0, 900.0);
/// Thickness of an inner wall, mm.
const WALL_MM: f64 = 100.0;
/// Shortest side of a room, mm.
const SIDE_MM: f64 = 1700.0;
/// Least distance of a door's edge from a corner, mm.
const DOOR_CORNER_MM: f64 = 200.0;
/// Half of the narrowest passage that matters, mm.
const PASSAGE_MM: f64 = 225.0;
/// Floor this near to floor with wide passages is no passage of its own, cells.
const POCKET_CELLS: usize = 6;
/// Least clearance at the start, mm.
const START_MM: f64 = 350.0;
/// Least share of a room's area with wide passages.
const OPEN_SHARE: f64 = 0.2;
/// Floor for each piece of furniture, mm².
const FURNITURE_MM2: (f64, f64) = (2.5e6, 4.5e6);
const ATTEMPTS: usize = 20;

/// A room of this seed: 12 to 40 m², two to four rooms joined by doors of 700 to 900 mm, furniture with
/// and without legs, in many a slanted wall, something soft, sills and a carpet. No passage that
/// matters is below 450 mm. The robot starts somewhere in it, under any heading; there is no tour.
pub fn generate(seed: u64) -> Room {
    let mut rng = Rng::stream(seed, 0x0100);
    loop {
        if let Some(room) = Flat::build(&mut rng) {
            return room;
        }
    }
}

/// A rectangle along the axes: lower left and upper right corner.
#[derive(Clone, Copy, Debug)]
struct Rect {
    low: Point,
    high: Point,
}

impl Rect {
    fn size(&self) -> (f64, f64) {
        let Point { x_mm, y_mm } = self.high - self.low;
        (x_mm, y_mm)
    }

    fn area(&self) -> f64 {
        let (width, depth) = self.size();
        width * depth
    }

    fn contains(&self, point: Point) -> bool {
        let within = |at: f64, low: f64, high: f64| (low..=high).contains(&at);
        within(point.x_mm, self.low.x_mm, self.high.x_mm)
            && within(point.y_mm, self.low.y_mm, self.high.y_mm)
    }

    fn point(&self, rng: &mut Rng) -> Point {
        let (width, depth) = self.size();
        self.low + Point::new(width * rng.unit(), depth * rng.unit())
    }

    /// One of its sides, seen from inside: a pose on it that faces inwards, and its length.
    fn side(&self, rng: &mut Rng) -> (Pose2, f64) {
        let (width, depth) = self.size();
        let (Point { x_mm: x1, y_mm: y1 }, Point { x_mm: x2, y_mm: y2 }) = (self.low, self.high);
        let (x, y) = (f64::midpoint(x1, x2), f64::midpoint(y1, y2));
        let quarter = std::f64::consts::FRAC_PI_2;
        match rng.below(4) {
            0 => (Pose2::new(x1, y, 0.0), depth),
            1 => (Pose2::new(x2, y, 2.0 * quarter), depth),
            2 => (Pose2::new(x, y1, quarter), width),
            _ => (Pose2::new(x, y2, -quarter), width),
        }
    }
}

fn between(rng: &mut Rng, (low, high): (f64, f64)) -> f64 {
    low + (high - low) * rng.unit()
}

fn chance(rng: &mut Rng, probability: f64) -> bool {
    rng.unit() < probability
}

/// A flat under construction.
struct Flat<'a> {
    rng: &'a mut Rng,
    room: Room,
    rooms: Vec<Rect>,
    /// The middles of the doors.
    doors: Vec<Segment>,
}

impl<'a> Flat<'a> {
    /// A flat, unless the walls drawn do not work out.
    fn build(rng: &'a mut Rng) -> Option<Room> {
        let area = between(rng, AREA_M2);
        let width = (area * between(rng, (1.0, 1.8))).sqrt() * 1000.0;
        let corner = Point::new(width, area * 1e6 / width);
        let outer = Rect {
            low: Point::default(),
            high: corner,
        };
        let mut flat = Self {
            rng,
            room: Room::default(),
            rooms: vec![outer],
            doors: Vec::new(),
        };
        flat.outer_walls(corner);
        let most = (area / 5.5).clamp(2.0, 4.0);
        while flat.rooms.len() < 2 || flat.more_rooms(most) {
            if !(0..ATTEMPTS).any(|_| flat.split()) {
                break;
            }
        }
        let mut grid = ClearanceGrid::new(&flat.room);
        flat.choose_start(&grid)?;
        let mut open = flat.open_floor(&grid)?;
        if flat.rooms.len() < 2 {
            return None;
        }
        for rect in flat.rooms.clone() {
            let mut unfurnished = rect.area();
            while unfurnished > 0.0 {
                flat.furnish(&rect, &mut grid, &mut open);
                unfurnished -= between(flat.rng, FURNITURE_MM2);
            }
        }
        flat.lay_sills();
        Some(flat.room)
    }

    #[allow(clippy::cast_precision_loss)] // at most four
    fn more_rooms(&mut self, most: f64) -> bool {
        (self.rooms.len() as f64) < most.floor() && chance(self.rng, 0.75)
    }

    /// The outer walls: a rectangle, one of its walls slanted or some of its corners cut off.
    fn outer_walls(&mut self, size: Point) {
        let (w, d) = (size.x_mm, size.y_mm);
        let mut corners = [(0.0, 0.0), (w, 0.0), (w, d), (0.0, d)].map(|(x, y)| Point::new(x, y));
        let mut cuts = [0.0; 4];
        if chance(self.rng, 0.4) {
            let inwards = between(self.rng, (0.05, 0.15));
            corners[2].y_mm -= inwards * d;
        }
        for cut in &mut cuts {
            if chance(self.rng, 0.2) {
                *cut = between(self.rng, (350.0, 800.0));
            }
        }
        let mut outline = Vec::new();
        for (nth, &corner) in corners.iter().enumerate() {
            for other in [corners[(nth + 3) % 4], corners[(nth + 1) % 4]] {
                outline.push(corner.lerp(other, cuts[nth] / corner.distance_mm(other)));
            }
        }
        for nth in 0..outline.len() {
            let wall = Segment::new(outline[nth], outline[(nth + 1) % outline.len()]);
            let wall = (wall.length_mm() > 1.0).then_some(wall);
            self.room.segments.extend(wall);
        }
    }

    /// Divides the largest room by a wall with a door; whether it could.
    fn split(&mut self) -> bool {
        let by_area = |a: &&Rect, b: &&Rect| a.area().total_cmp(&b.area());
        let Some(rect) = self.rooms.iter().max_by(by_area).copied() else {
            return false;
        };
        // Along the frame's y, or the same with x and y swapped.
        let swapped = rect.size().0 < rect.size().1;
        let swap = |p: Point| {
            if swapped {
                Point::new(p.y_mm, p.x_mm)
            } else {
                p
            }
        };
        let (low, high) = (swap(rect.low), swap(rect.high));
        let share = between(self.rng, (0.36, 0.64));
        let at = low.x_mm + share * (high.x_mm - low.x_mm);
        let half = WALL_MM / 2.0;
        if (at - half - low.x_mm).min(high.x_mm - at - half) < SIDE_MM {
            return false;
        }
        let in_door = |door: &Segment| {
            let (a, b) = (swap(door.from), swap(door.to));
            let beside = a.y_mm > low.y_mm - 2.0 * WALL_MM && a.y_mm < high.y_mm + 2.0 * WALL_MM;
            let keep = half + DOOR_CORNER_MM;
            beside && at > a.x_mm.min(b.x_mm) - keep && at < a.x_mm.max(b.x_mm) + keep
        };
        if self.doors.iter().any(in_door) {
            return false;
        }
        let door = between(self.rng, DOOR_MM);
        let reach = (low.y_mm + DOOR_CORNER_MM, high.y_mm - DOOR_CORNER_MM - door);
        let from = between(self.rng, reach);
        for (start, end) in [(low.y_mm, from), (from + door, high.y_mm)] {
            let centre = swap(Point::new(at, f64::midpoint(start, end)));
            let size = swap(Point::new(WALL_MM, end - start));
            let room = std::mem::take(&mut self.room);
            self.room = room.with_box(&Pose2::at(centre, 0.0), size.x_mm, size.y_mm);
        }
        let ends = [from, from + door].map(|y| swap(Point::new(at, y)));
        self.doors.push(Segment::new(ends[0], ends[1]));
        self.rooms.retain(|other| other.low != rect.low);
        for (x1, x2) in [(low.x_mm, at - half), (at + half, high.x_mm)] {
            self.rooms.push(Rect {
                low: swap(Point::new(x1, low.y_mm)),
                high: swap(Point::new(x2, high.y_mm)),
            });
        }
        true
    }

    fn choose_start(&mut self, grid: &ClearanceGrid) -> Option<()> {
        for _ in 0..ATTEMPTS {
            let nth = self.rng.below(self.rooms.len());
            let at = self.rooms[nth].point(self.rng);
            let clear = grid.index(at).map(|index| grid.clearance_mm(index));
            if clear.is_some_and(|clear| clear >= START_MM + CELL_MM) {
                let heading = self.rng.within(std::f64::consts::PI);
                self.room.start = Pose2::at(at, heading);
                return Some(());
            }
        }
        None
    }

    /// The floor with wide passages, unless a room is closed or a narrow passage leads on.
    fn open_floor(&self, grid: &ClearanceGrid) -> Option<Vec<bool>> {
        let start = self.room.start.position();
        if grid.clearance_mm(grid.index(start)?) < START_MM {
            return None;
        }
        let open = grid.flood(start, PASSAGE_MM);
        let mut near = open.clone();
        for _ in 0..POCKET_CELLS {
            near = grid.grown(&near);
        }
        let floor = grid.flood(start, REACHABLE_MM);
        let mut cells = floor.iter().zip(&near);
        let pocket = cells.any(|(&floor, &near)| floor && !near);
        let cell_mm2 = CELL_MM * CELL_MM;
        let roomy = |rect: &Rect| {
            let inside = |index: &usize| open[*index] && rect.contains(grid.middle(*index));
            #[allow(clippy::cast_precision_loss)] // thousands of cells
            let cells = (0..open.len()).filter(inside).count() as f64;
            cells * cell_mm2 > OPEN_SHARE * rect.area()
        };
        (!pocket && self.rooms.iter().all(roomy)).then_some(open)
    }

    /// Puts a piece of furniture into a room, where it overlaps nothing and leaves every passage wide.
    fn furnish(&mut self, rect: &Rect, grid: &mut ClearanceGrid, open: &mut Vec<bool>) {
        for _ in 0..ATTEMPTS {
            let piece = Piece::draw(self.rng, rect);
            let is_open = |&point: &Point| grid.index(point).is_some_and(|index| open[index]);
            let inside = |&point: &Point| rect.contains(point);
            let free = |&point: &Point| self.room.clearance_mm(point) >= FOOTPRINT_MM;
            let surfaces = &piece.surfaces;
            if !surfaces.straight().all(|side| inside(&side.from))
                || !piece.on_open_floor.iter().all(is_open)
                || !piece.footprint.iter().all(free)
            {
                continue;
            }
            let mut furnished = grid.clone();
            furnished.add(surfaces);
            let Some(left) = self.open_floor(&furnished) else {
                continue;
            };
            // It takes the floor around itself, and cuts nothing off.
            let lost = |index: &usize| open[*index] && !left[*index];
            let beside =
                |index| surfaces.clearance_mm(grid.middle(index)) < PASSAGE_MM + 4.0 * CELL_MM;
            if (0..open.len()).filter(lost).all(beside) {
                self.room.segments.extend(&surfaces.segments);
                self.room.soft.extend(&surfaces.soft);
                self.room.circles.extend(&surfaces.circles);
                (*grid, *open) = (furnished, left);
                return;
            }
        }
    }

    /// A sill under some doors, and a carpet.
    fn lay_sills(&mut self) {
        for door in self.doors.clone() {
            if chance(self.rng, 0.5) {
                self.room.sills.push(door);
            }
        }
        if chance(self.rng, 0.5) {
            let nth = self.rng.below(self.rooms.len());
            let rect = self.rooms[nth];
            let ((width, depth), share) = (rect.size(), between(self.rng, (0.3, 0.6)));
            let centre = rect.low.lerp(rect.high, 0.5);
            let centre = Pose2::at(centre, 0.0);
            let carpet = Room::default().with_box(&centre, width * share, depth * share);
            self.room.sills.extend(carpet.segments);
        }
    }
}

#[cfg(test)]
mod tests;
