//! The robot's body against the room.

use crate::{Pose, Room};

/// The robot ran into something.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Collision {
    /// When, seconds since the world began.
    pub time_s: f64,
    /// Where the robot was.
    pub pose: Pose,
}

/// A touch ends when the body is this far from everything, mm.
const TOUCH_ENDS_MM: f64 = 5.0;

/// Watches the body's distance from everything.
#[derive(Clone, Debug, Default)]
pub(crate) struct Contact {
    /// Travel for which the room need not be asked again: the body was this far from everything.
    free_mm: f64,
    touching: bool,
    collisions: u32,
    first: Option<Collision>,
}

impl Contact {
    /// Whether a body of this radius, moving from `from` to `to`, goes (deeper) into something.
    pub(crate) fn blocks(
        &mut self,
        room: &Room,
        radius_mm: f64,
        from: &Pose,
        to: &Pose,
        time_s: f64,
    ) -> bool {
        self.free_mm -= (to.x_mm - from.x_mm).hypot(to.y_mm - from.y_mm);
        if self.free_mm > 0.0 {
            return false;
        }
        let clearance = room.clearance(to.x_mm, to.y_mm);
        self.free_mm = clearance - radius_mm;
        if self.free_mm >= 0.0 {
            self.touching &= self.free_mm < TOUCH_ENDS_MM;
            return false;
        }
        if clearance > room.clearance(from.x_mm, from.y_mm) {
            return false; // it is backing out
        }
        if !self.touching {
            self.touching = true;
            self.collisions += 1;
            self.first.get_or_insert(Collision {
                time_s,
                pose: *from,
            });
        }
        true
    }

    /// Something else moved the body: look again at the next motion.
    pub(crate) fn moved_by_force(&mut self) {
        self.free_mm = 0.0;
    }

    pub(crate) fn collisions(&self) -> u32 {
        self.collisions
    }

    pub(crate) fn first(&self) -> Option<Collision> {
        self.first
    }
}
