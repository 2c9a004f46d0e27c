//! What the sensors saw lately or at short distance, at once and without the map: the map enters
//! readings only after some decimetres of way.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

use geometry::{Point, Pose2, wrap_angle};
use mapper::{Cell, Grid};
use rustc_hash::FxHashSet;

use crate::{Config, Status, walls};

/// Raster of the surfaces seen closely and of the floor seen through, mm.
const SURFACE_MM: f64 = 100.0;
const FLOOR_MM: f64 = 50.0;
/// Smooth walls answer a beam within this of their normal, radians: only such a beam along one of
/// the walls' directions shows that floor is free …
const NORMAL_RAD: f64 = 0.25;
/// … up to this distance, mm, within this half angle, radians.
const FLOOR_REACH_MM: f64 = 800.0;
const FLOOR_HALF_RAD: f64 = 0.15;
/// A front or a side echo nearer than this comes from something in or beside the way, mm.
const NEAR_MM: [f64; 3] = [700.0, 500.0, 500.0];
/// Half the angle that it may come from, radians.
const CONE_RAD: f64 = 0.24;
/// A later reading within this of a point's direction that reaches this much farther refutes it.
const REFUTED: (f64, f64) = (0.15, 80.0);
/// The same for a close echo, which came from anywhere in its beam: one along its axis, radians.
const SAME_AXIS_RAD: f64 = 0.08;
/// Echoes are forgotten after this way, mm, a turn of one radian counting as 400 mm: then they are
/// in the map.
const MEMORY_MM: f64 = 700.0;
const TURN_MM: f64 = 400.0;
/// Occupied cells this near to an echo explain it: mm, and mm per mm of its range.
const EXPLAINED: (f64, f64) = (40.0, 0.1);
/// Beams within this of half-way between the walls' directions see slanted walls, radians …
const SLANT_RAD: f64 = 0.2;
/// … this far around the robot, mm; with a silent front sensor, which may face one, only this far.
const SLANT_REACH_MM: (f64, f64) = (500.0, 250.0);
/// Silence of the front sensor counts after this way, mm.
const SILENT_WAY_MM: f64 = 100.0;
/// The way straight ahead of the body, and what it is wider than the body to either side, mm.
const AHEAD_MM: (f64, f64) = (180.0, 35.0);
/// Echoes nearer than this stop the robot before its body reaches them, mm.
const CLOSE_MM: f64 = 350.0;
/// The plane of a close echo continues this far to either side, mm.
const PLANE_MM: f64 = 300.0;
/// Error of an echo's place, mm.
const ECHO_ERROR_MM: f64 = 10.0;
/// Silence is a new reading after this, s.
const SILENCE_S: f64 = 0.06;

/// A set of squares of the plane.
#[derive(Clone, Debug, Default)]
pub(crate) struct Squares {
    squares: FxHashSet<(i32, i32)>,
}

impl Squares {
    fn key(point: Point, raster_mm: f64) -> (i32, i32) {
        #[allow(clippy::cast_possible_truncation)] // within the grid
        let number = |mm: f64| (mm / raster_mm).floor() as i32;
        (number(point.x_mm), number(point.y_mm))
    }
}

/// The memory.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sight {
    surfaces: Squares,
    /// Passed by beams along the walls' direction, and across it.
    floor: [Squares; 2],
    /// Way at the echo, mm, and a place that it may have come from.
    echoes: Vec<(f64, Point)>,
    /// Way at every close echo, mm, and its place on the beam's axis with the beam's heading, whether the map has it
    /// or not.
    close: Vec<(f64, Pose2)>,
    /// Where the beams turned half-way between the walls' directions.
    looks: Vec<Point>,
    way_mm: f64,
    /// Way at the last front echo, mm.
    front_mm: f64,
    last: Option<Pose2>,
    /// Value and time of every sensor's last reading.
    readings: [(Option<f64>, f64); 3],
}

impl Sight {
    /// Takes a frame; `walls_rad` is one of the walls' directions. Returns whether something
    /// near appeared that is not in the map.
    pub fn observe(
        &mut self,
        status: &Status,
        config: &Config,
        grid: &Grid,
        walls_rad: f64,
    ) -> bool {
        let pose = status.estimate.pose;
        if let Some(last) = self.last.replace(pose) {
            self.way_mm += last.distance_mm(&pose) + TURN_MM * last.turn_to_rad(&pose).abs();
        }
        let nearest_rad = walls::nearest_rad(pose.heading_rad, walls_rad);
        let slant_rad = FRAC_PI_4 - (pose.heading_rad - nearest_rad).abs();
        if slant_rad < SLANT_RAD && !self.is_looked_at(pose.position(), 100.0) {
            self.looks.push(pose.position());
        }
        let since_mm = self.way_mm - MEMORY_MM;
        self.echoes.retain(|&(at_mm, _)| at_mm > since_mm);
        self.close.retain(|&(at_mm, _)| at_mm > since_mm);
        let mut appeared = false;
        for (nth, range_mm) in status.ranges_mm.into_iter().enumerate() {
            let Some(mut mount) = config.mounts[nth] else {
                continue;
            };
            let (last_mm, last_s) = self.readings[nth];
            #[allow(clippy::float_cmp)] // a repeat of the same measurement
            let repeat =
                last_mm == range_mm && (range_mm.is_some() || status.time_s - last_s < SILENCE_S);
            if repeat {
                continue;
            }
            self.readings[nth] = (range_mm, status.time_s);
            if nth == 0 {
                mount.bearing_rad = status.front_bearing_rad;
            }
            let sensor = mount.sensor_pose(&pose);
            self.see_floor(&sensor, range_mm, walls_rad);
            if let Some(range_mm) = range_mm {
                if nth == 0 {
                    self.front_mm = self.way_mm;
                }
                if range_mm <= config.closer_look_mm {
                    self.see_surface(&sensor, range_mm);
                }
                appeared |= self.see_near(&sensor, range_mm, NEAR_MM[nth], grid);
            }
        }
        appeared
    }

    /// Floor that a beam along one of the walls' directions passed.
    fn see_floor(&mut self, sensor: &Pose2, range_mm: Option<f64>, walls_rad: f64) {
        let nearest_rad = walls::nearest_rad(sensor.heading_rad, walls_rad);
        if (sensor.heading_rad - nearest_rad).abs() > NORMAL_RAD {
            return;
        }
        let across = walls::is_across(nearest_rad, walls_rad);
        let reach = range_mm.map_or(FLOOR_REACH_MM, |range| range.min(FLOOR_REACH_MM));
        let mut ahead = 0.0;
        while ahead < reach {
            let aside = ahead * FLOOR_HALF_RAD;
            for left in [-aside, 0.0, aside] {
                let key = Squares::key(sensor.point_at(ahead, left), FLOOR_MM);
                self.floor[usize::from(across)].squares.insert(key);
            }
            ahead += 0.8 * FLOOR_MM;
        }
    }

    /// A surface answered at a short distance.
    pub fn see_surface(&mut self, sensor: &Pose2, range_mm: f64) {
        for aside in [-0.2f64, 0.0, 0.2] {
            let (sin, cos) = libm::sincos(aside);
            let point = sensor.point_at(range_mm * cos, range_mm * sin);
            self.surfaces
                .squares
                .insert(Squares::key(point, SURFACE_MM));
        }
    }

    /// An echo refutes earlier ones nearer on its axis, and a near one is remembered unless the map
    /// has a surface there.
    pub fn see_near(&mut self, sensor: &Pose2, range_mm: f64, near_mm: f64, grid: &Grid) -> bool {
        let stands = |point: Point, within_rad: f64| {
            let local = Pose2::at(point, 0.0).relative_to(sensor).position();
            let off = wrap_angle(local.angle_rad()).abs();
            off > within_rad || local.length_mm() > range_mm - REFUTED.1
        };
        self.echoes.retain(|&(_, point)| stands(point, REFUTED.0));
        self.close
            .retain(|(_, beam)| stands(beam.position(), SAME_AXIS_RAD));
        if range_mm < CLOSE_MM {
            let place = sensor.point_at(range_mm, 0.0);
            self.close
                .push((self.way_mm, Pose2::at(place, sensor.heading_rad)));
        }
        if range_mm >= near_mm {
            return false;
        }
        let arc = [-1.0, -0.5, 0.0, 0.5, 1.0].map(|share: f64| {
            let (sin, cos) = libm::sincos(share * CONE_RAD);
            sensor.point_at(range_mm * cos, range_mm * sin)
        });
        let within_mm = EXPLAINED.0 + EXPLAINED.1 * range_mm;
        let explained = arc
            .iter()
            .any(|&point| is_occupied_near(grid, point, within_mm));
        if !explained {
            self.echoes.extend(arc.map(|point| (self.way_mm, point)));
        }
        !explained
    }

    /// Whether an echo came from about there at a short distance.
    pub fn is_seen_closely(&self, point: Point) -> bool {
        let (x, y) = Squares::key(point, SURFACE_MM);
        (-1..=1).any(|dx| (-1..=1).any(|dy| self.surfaces.squares.contains(&(x + dx, y + dy))))
    }

    fn is_looked_at(&self, point: Point, radius_mm: f64) -> bool {
        self.looks
            .iter()
            .any(|look| look.distance_mm(point) <= radius_mm)
    }

    /// How far from the place of a look slanted walls count as seen at present, mm.
    pub fn slant_reach_mm(&self) -> f64 {
        let silent = self.way_mm - self.front_mm > SILENT_WAY_MM;
        if silent {
            SLANT_REACH_MM.1
        } else {
            SLANT_REACH_MM.0
        }
    }

    /// Whether a slanted wall here would have been seen, as far as it extends to its normal through
    /// the place of a look.
    pub fn is_slant_seen(&self, point: Point) -> bool {
        self.is_looked_at(point, self.slant_reach_mm())
    }

    /// Whether beams along the walls' direction, and across it, passed this floor.
    pub fn seen_through(&self, point: Point) -> [bool; 2] {
        let key = Squares::key(point, FLOOR_MM);
        [0, 1].map(|across: usize| self.floor[across].squares.contains(&key))
    }

    /// Whether a robot of this clearance may touch at a point what an unexplained echo came from.
    pub fn doubts(&self, point: Point, clearance_mm: f64) -> bool {
        let within_mm = clearance_mm + EXPLAINED.0;
        self.unexplained()
            .any(|echo| echo.distance_mm(point) < within_mm)
    }

    /// Whether an unexplained echo came from the way straight ahead of the body.
    pub fn is_blocked(&self, pose: &Pose2, body_mm: f64) -> bool {
        let (ahead_mm, aside_mm) = (body_mm + AHEAD_MM.0, body_mm + AHEAD_MM.1);
        self.unexplained().any(|point| {
            let local = Pose2::new(point.x_mm, point.y_mm, 0.0).relative_to(pose);
            (0.0..ahead_mm).contains(&local.x_mm) && local.y_mm.abs() < aside_mm
        })
    }

    /// The nearest close echo on the way straight ahead of the body, and the way to the contact, mm.
    // Requirement: NAV-contact-1
    pub fn contact(&self, pose: &Pose2, body_mm: f64) -> Option<(f64, Point)> {
        let radius_mm = body_mm + ECHO_ERROR_MM;
        let way = |(_, beam): &(f64, Pose2)| {
            let local = beam.relative_to(pose);
            let half_chord = (radius_mm.powi(2) - local.y_mm.powi(2)).sqrt();
            let touches = local.x_mm > 0.0 && half_chord >= 0.0;
            touches.then_some((local.x_mm - half_chord, beam.position()))
        };
        let ways = self.close.iter().filter_map(way);
        ways.min_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// Whether the robot heads for the plane of a close echo that passes this near to its middle: most things
    /// stand along the walls, and continue.
    pub fn nears_plane(&self, pose: &Pose2, walls_rad: f64, radius_mm: f64) -> bool {
        self.close.iter().any(|(_, beam)| {
            let normal_rad = walls::nearest_rad(beam.heading_rad, walls_rad);
            let normal = Pose2::at(pose.position(), normal_rad);
            let echo = beam.relative_to(&normal).position();
            (0.0..radius_mm).contains(&echo.x_mm)
                && echo.y_mm.abs() < PLANE_MM
                && normal.turn_to_rad(pose).abs() < FRAC_PI_2
        })
    }

    /// Forgets the echoes that the map does not explain.
    pub fn forget_unexplained(&mut self) {
        self.echoes.clear();
    }

    /// Places from which echoes came that the map does not explain.
    pub fn unexplained(&self) -> impl Iterator<Item = Point> + '_ {
        self.echoes.iter().map(|&(_, point)| point)
    }
}

fn is_occupied_near(grid: &Grid, point: Point, within_mm: f64) -> bool {
    let cell_mm = grid.cell_mm();
    #[allow(clippy::cast_possible_truncation)] // a few
    let reach = (within_mm / cell_mm).floor().max(1.0) as i32;
    let offsets = || (-reach..=reach).map(|cells| f64::from(cells) * cell_mm);
    offsets().any(|x_mm| {
        offsets().any(|y_mm| grid.cell_at(point + Point::new(x_mm, y_mm)) == Cell::Occupied)
    })
}

#[cfg(test)]
mod tests;
