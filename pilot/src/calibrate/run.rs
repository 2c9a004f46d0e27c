//! The drives. They go from pose to pose as [`drive`](host_link::drive) does, and end with the robot stopped
//! on every path; here the way is recorded, and a robot that leaves it is stopped.

use super::wheel_geometry::Geometry;
use super::wheel_path::Path;
use host_link::board_io::Wires;
use host_link::drive::{follow, Terms};
use host_link::error::Error;
use host_link::pose::Place;
use host_link::session::Session;

/// How far from the straight line between two corners the robot may believe itself, millimetres.
const STRAY_MM: f64 = 150.0;

/// Frames in a row without a valid reply that end a run: a fifth of a second at 40 Hz, less than the
/// robot's own stop deadline.
const DEAF_FRAMES: u32 = 8;

/// Shortest and longest way of a drive or of a square's side, millimetres.
pub const WAYS_MM: (f64, f64) = (300.0, 5000.0);

/// A straight drive, seen from where the robot stands.
#[must_use]
pub fn straight(length_mm: f64) -> Vec<Place> {
    vec![place(length_mm, 0.0, 0.0)]
}

/// A square to the right (clockwise) or to the left, turning on the spot at its corners, and back to
/// the rotation of the start.
#[must_use]
pub fn square(side_mm: f64, clockwise: bool) -> Vec<Place> {
    let (l, s) = (side_mm, if clockwise { -1.0 } else { 1.0 });
    vec![
        place(l, 0.0, s * 90.0),
        place(l, s * l, 180.0),
        place(0.0, s * l, s * -90.0),
        place(0.0, 0.0, 0.0),
    ]
}

const fn place(x_mm: f64, y_mm: f64, rotation_deg: f64) -> Place {
    Place {
        x_mm,
        y_mm,
        rotation_deg,
    }
}

/// Drives `way`, which is seen from where the robot stands, and returns the path. `reached` is told how
/// many of its places are done.
///
/// # Errors
/// [`Error::Usage`] for ways that are too short or too long; those of [`host_link::drive::go_to`];
/// [`Error::Silent`] after a fifth of a second without a valid reply; [`Error::Calibration`] if the
/// robot leaves its way. On each of them, and on a panic, it is stopped first.
pub fn run<W: Wires>(
    session: &mut Session<'_, W>,
    way: &[Place],
    terms: &Terms,
    mut reached: impl FnMut(usize),
) -> Result<Path, Error> {
    session.resume()?;
    let start = session.snapshot().pose.ok_or(Error::WrongMode {
        mode: session.config().mode.name(),
        wanted: "position to drive to",
    })?;
    let mut path = Path::new(Geometry::of(session.config()));
    path.take(start);
    let mut from = start;
    for (index, there) in way.iter().enumerate() {
        let target = there.placed_at(start);
        let mut deaf = 0;
        follow(session, target, terms, |session, report| {
            let Some(pose) = report.and(session.snapshot().pose) else {
                deaf += 1;
                return if deaf >= DEAF_FRAMES {
                    Err(session.silence())
                } else {
                    Ok(())
                };
            };
            deaf = 0;
            path.take(pose);
            let stray = beside(from, target, pose);
            if stray > STRAY_MM {
                return Err(Error::Calibration(format!(
                    "the robot is {stray:.0} mm beside its way; accepted are {STRAY_MM:.0} mm"
                )));
            }
            Ok(())
        })?;
        from = target;
        reached(index + 1);
    }
    if !path.moved() {
        return Err(Error::Calibration("nothing moved".into()));
    }
    Ok(path)
}

/// Distance of `pose` from the straight line between two places, millimetres.
fn beside(from: Place, to: Place, pose: Place) -> f64 {
    let (dx, dy) = (to.x_mm - from.x_mm, to.y_mm - from.y_mm);
    let (px, py) = (pose.x_mm - from.x_mm, pose.y_mm - from.y_mm);
    let along = ((px * dx + py * dy) / (dx * dx + dy * dy).max(1e-9)).clamp(0.0, 1.0);
    (px - along * dx).hypot(py - along * dy)
}

/// # Errors
/// [`Error::Usage`] names the way and what is accepted.
pub fn check(what: &str, mm: f64) -> Result<(), Error> {
    let (low, high) = WAYS_MM;
    if (low..=high).contains(&mm) {
        return Ok(());
    }
    Err(Error::Usage(format!(
        "{what} {mm} mm: accepted is {low} to {high}"
    )))
}
