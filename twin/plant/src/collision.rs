//! Contact of the robot's body with the room.

use crate::{Pose2, Room};

/// A contact of the body with an obstacle at more than [`COLLISION_MM_S`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Collision {
    /// Seconds since the start of the run.
    pub time_s: f64,
    /// Where the robot was.
    pub pose: Pose2,
    /// Its speed at the contact, mm/s.
    pub speed_mm_s: f64,
}

/// A slower contact is a touch, not a collision, mm/s.
pub const COLLISION_MM_S: f64 = 20.0;

/// A contact ends at this clearance, mm.
const CONTACT_ENDS_MM: f64 = 5.0;

/// Detects contact, and records each lasting contact once.
#[derive(Clone, Debug, Default)]
pub(crate) struct CollisionDetector {
    /// Travel for which the room need not be queried again: the last clearance.
    free_mm: f64,
    in_contact: bool,
    pub(crate) collisions: Vec<Collision>,
}

impl CollisionDetector {
    /// Whether a body of this radius, moving from `from` to `to` in `dt_s` seconds until `time_s`,
    /// penetrates an obstacle (further).
    pub(crate) fn blocks(
        &mut self,
        room: &Room,
        radius_mm: f64,
        from: &Pose2,
        to: &Pose2,
        dt_s: f64,
        time_s: f64,
    ) -> bool {
        self.free_mm -= from.distance_mm(to);
        if self.free_mm > 0.0 {
            return false;
        }
        let clearance = room.clearance_mm(to.position());
        self.free_mm = clearance - radius_mm;
        if self.free_mm >= 0.0 {
            self.in_contact &= self.free_mm < CONTACT_ENDS_MM;
            return false;
        }
        if clearance > room.clearance_mm(from.position()) {
            return false; // backing out
        }
        if !self.in_contact {
            self.in_contact = true;
            let speed_mm_s = from.distance_mm(to) / dt_s;
            if speed_mm_s > COLLISION_MM_S {
                self.collisions.push(Collision {
                    time_s,
                    pose: *from,
                    speed_mm_s,
                });
            }
        }
        true
    }

    /// The body was moved other than by its wheels: queries the room at the next motion.
    pub(crate) fn invalidate(&mut self) {
        self.free_mm = 0.0;
    }
}
