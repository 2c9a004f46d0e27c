//! Localisation and mapping with three sparse rangefinders.
//!
//! The [`Localiser`] predicts its pose by gyroscope and encoders ([`ekf`]), turns ranges along
//! about 0.4 m of way into oriented surface elements ([`surface`]), matches each such stretch once
//! to the surfaces that it knows ([`matcher`], [`surface_map`]), corrects pose and calibration by
//! the result, and only then enters the stretch into the map ([`evidence`]).

mod calibration;
mod config;
mod ekf;
mod evidence;
mod global;
mod likelihood;
mod matcher;
mod surface;
mod surface_map;

use nalgebra::{Matrix3, Vector3};

pub use calibration::{CalibrationEstimate, MotionNoise};
pub use config::{LocaliserConfig, Observation};
pub use matcher::MatcherConfig;

use crate::{Grid, Pose2, PoseEstimate};
use ekf::{Ekf, Increment};
use evidence::Evidence;
use geometry::wrap_angle;
use global::{GlobalSearch, Outcome};
use surface::{Beam, Element, Kind, Reading, element};
use surface_map::SurfaceMap;

/// A rangefinder turning by this much covers new ground like 100 mm of way, rad.
const TURN_PER_100_MM: f64 = 0.25;
/// Way of a sensor, mm, or turn of its beam, rad, before its next reading is kept.
const SPACING: (f64, f64) = (5.0, 0.03);
/// Elements that show a wall's direction, and how well they agree (mean cosine of four times the
/// angle).
const FEWEST_OF_WALL: f64 = 10.0;
const AGREEMENT: f64 = 0.9;
/// Error of the dead reckoning during the search for the start: mm, mm, rad.
const LOCATED: [f64; 3] = [20.0, 20.0, 0.02];
/// Readings of earlier stretches that help to find bearings.
const CONTEXT: usize = 10;

/// The readings of one sensor.
#[derive(Clone, Debug, Default)]
struct Track {
    /// In the dead reckoning's frame, oldest first.
    readings: Vec<Reading>,
    /// How many of them belong to earlier stretches.
    old: usize,
    latest: Option<f64>,
    /// Time of the last value, s.
    time_s: f64,
}

/// Localisation and map.
#[derive(Clone, Debug)]
pub struct Localiser {
    config: LocaliserConfig,
    beam: Beam,
    ekf: Ekf,
    evidence: Evidence,
    last: Option<Observation>,
    /// The prediction without corrections: what readings of one stretch are relative to. With the
    /// motion of the last frame and its duration, s.
    dead_reckoning: Pose2,
    motion: (Pose2, f64),
    /// Way since the end of the last stretch, turns included, mm.
    way_mm: f64,
    trace: Vec<Pose2>,
    tracks: [Track; 3],
    /// While the start on a saved map is unknown.
    search: Option<GlobalSearch>,
}

impl Localiser {
    /// Starts with an empty map at its origin.
    pub fn new(config: LocaliserConfig) -> Self {
        let evidence = Evidence::new(config.cell_mm);
        let start = PoseEstimate {
            pose: Pose2::default(),
            covariance: [[0.0; 3]; 3],
        };
        Self::starting(config, evidence, &start)
    }

    /// Starts on a saved map. Without a start, the robot may stand anywhere on its free floor: until
    /// [`Localiser::is_located`], the estimate's covariance spans everywhere that it may be, and the
    /// map stays as it is. Driving some metres locates it.
    // Requirement: NAV-pose-2
    #[must_use]
    pub fn on_map(config: LocaliserConfig, grid: Grid, start: Option<PoseEstimate>) -> Self {
        let surfaces = SurfaceMap::from_grid(&grid);
        let search = start.is_none().then(|| GlobalSearch::new(&surfaces, &grid));
        let evidence = Evidence {
            grid,
            surfaces,
            walls_rad: None,
        };
        let mut localiser = Self::starting(config, evidence, &start.unwrap_or_default());
        localiser.search = search;
        if localiser.search.is_some() {
            localiser.search(Vec::new());
        }
        localiser
    }

    /// Whether the estimate is a place rather than a search.
    #[must_use]
    pub const fn is_located(&self) -> bool {
        self.search.is_none()
    }

    fn starting(config: LocaliserConfig, evidence: Evidence, start: &PoseEstimate) -> Self {
        let covariance = Matrix3::from_fn(|row, column| start.covariance[row][column]);
        let ekf = Ekf::new(config.motion, &start.pose, &covariance);
        let beam = Beam {
            half_angle_rad: config.half_angle_rad,
            incidence_rad: config.incidence_rad,
        };
        Self {
            config,
            beam,
            ekf,
            evidence,
            last: None,
            dead_reckoning: Pose2::default(),
            motion: (Pose2::default(), 1.0),
            way_mm: 0.0,
            trace: Vec::new(),
            tracks: Default::default(),
            search: None,
        }
    }

    /// Takes one frame's report. Give every report once, in order of time.
    // Requirement: DOC-1-2
    pub fn observe(&mut self, now: &Observation) {
        if let Some(last) = self.last.replace(*now) {
            self.advance(&last, now);
        }
        if !self.config.corrects {
            let pose = now.odometry;
            let pose = Vector3::new(pose.x_mm, pose.y_mm, pose.heading_rad);
            self.ekf.relocate(&pose, &Matrix3::zeros());
        }
        if self.way_mm >= self.config.stretch_mm {
            self.end_stretch();
        }
    }

    fn advance(&mut self, last: &Observation, now: &Observation) {
        let turn_rad = wrap_angle(now.odometry.heading_rad - last.odometry.heading_rad);
        let between = now.odometry.relative_to(&last.odometry);
        let (sin, cos) = libm::sincos(turn_rad / 2.0);
        let increment = Increment {
            time_s: now.time_s - last.time_s,
            forward_mm: between.x_mm * cos + between.y_mm * sin,
            turn_rad,
            gyro_rad: now
                .gyro_rad
                .zip(last.gyro_rad)
                .filter(|_| self.config.corrects)
                .map(|(now, last)| now - last),
        };
        let motion = self.ekf.advance(&increment);
        self.dead_reckoning = self.dead_reckoning.compose(&motion);
        self.motion = (motion, increment.time_s.max(1e-3));
        self.way_mm += motion.position().length_mm();
        self.way_mm += motion.heading_rad.abs() * 100.0 / TURN_PER_100_MM;
        let here = self.dead_reckoning;
        let is_far = |at: &Pose2| at.distance_mm(&here) > 25.0;
        if self.trace.last().is_none_or(is_far) {
            self.trace.push(here);
        }
        for sensor in 0..3 {
            self.take_range(sensor, now);
        }
    }

    /// Keeps a range if it is a new measurement.
    // Requirement: DOC-2.2-4
    fn take_range(&mut self, nth: usize, now: &Observation) {
        let Some(mut mount) = self.config.mounts[nth] else {
            return;
        };
        if let (0, Some(bearing_rad)) = (nth, now.front_bearing_rad) {
            mount.bearing_rad = bearing_rad;
        }
        let (motion, time_s) = self.motion;
        let back = -self.config.range_age_s / time_s;
        let then = Pose2::new(
            back * motion.x_mm,
            back * motion.y_mm,
            back * motion.heading_rad,
        );
        let sensor = mount.sensor_pose(&self.dead_reckoning.compose(&then));
        let (nearest, farthest) = self.config.limits_mm;
        let range_mm = now.ranges_mm[nth].filter(|range| *range < farthest);
        let track = &mut self.tracks[nth];
        // The same value is the same measurement, reported again.
        let repeat = match range_mm {
            #[allow(clippy::float_cmp)]
            Some(_) => track.latest == range_mm,
            None => now.time_s - track.time_s < 0.055,
        };
        if repeat || range_mm.is_some_and(|range| range < nearest) {
            return;
        }
        track.latest = range_mm;
        track.time_s = now.time_s;
        let near = track.readings.last().is_some_and(|last| {
            last.sensor.distance_mm(&sensor) < SPACING.0
                && last.sensor.turn_to_rad(&sensor).abs() < SPACING.1
        });
        if !near {
            track.readings.push(Reading { sensor, range_mm });
        }
    }

    /// Matches the readings since the last stretch to the map, then enters them.
    fn end_stretch(&mut self) {
        self.way_mm = 0.0;
        let mut elements: Vec<Element> = Vec::new();
        for track in &self.tracks {
            let new = track.old..track.readings.len();
            elements.extend(new.filter_map(|at| element(&track.readings, at, &self.beam)));
        }
        if self.search.is_some() {
            self.search(elements);
        } else {
            let to_robot = Pose2::default().relative_to(&self.dead_reckoning);
            for element in &mut elements {
                *element = element.moved(&to_robot);
            }
            if self.config.corrects {
                self.observe_walls(&elements);
                self.correct(&elements);
            }
            self.enter(&elements, &to_robot);
        }
        for track in &mut self.tracks {
            let surplus = track.readings.len().saturating_sub(CONTEXT);
            track.readings.drain(..surplus);
            track.old = track.readings.len();
        }
        self.trace.clear();
    }

    /// Searches the saved map for the robot, with these elements (dead reckoning's frame).
    fn search(&mut self, elements: Vec<Element>) {
        let Some(search) = &mut self.search else {
            return;
        };
        let stretch = (elements, std::mem::take(&mut self.trace));
        let map = (&self.evidence.surfaces, &self.evidence.grid);
        let config = &self.config.matcher;
        match search.advance(stretch, &self.dead_reckoning, map, (&self.beam, config)) {
            Outcome::Searching(mean, covariance) => self.ekf.relocate(&mean, &covariance),
            Outcome::Located(place) => {
                let slack = Vector3::from(LOCATED).component_mul(&Vector3::from(LOCATED));
                let covariance = place.covariance + Matrix3::from_diagonal(&slack);
                self.ekf.relocate(&place.mean, &covariance);
                self.search = None;
            }
        }
    }

    /// Corrects the heading by the mean direction of the walls in these elements, modulo a right
    /// angle.
    fn observe_walls(&mut self, elements: &[Element]) {
        let is_wall = |e: &&Element| e.kind == Kind::Wall && e.has_bearing();
        let walls = elements.iter().filter(is_wall);
        let (sin, cos, count) = walls.fold((0.0, 0.0, 0.0), |(sin, cos, count), wall| {
            let (s, c) = libm::sincos(4.0 * wall.towards_rad);
            (sin + s, cos + c, count + 1.0)
        });
        if count >= FEWEST_OF_WALL && libm::hypot(sin, cos) > AGREEMENT * count {
            self.ekf.observe_wall(libm::atan2(sin, cos) / 4.0);
        }
    }

    /// Corrects the pose by a match of these elements, given in the robot's frame.
    fn correct(&mut self, elements: &[Element]) {
        let pose = self.ekf.pose();
        let visible: Vec<Element> = elements
            .iter()
            .filter(|e| !self.evidence.is_behind_wall(&e.moved(&pose), &self.beam))
            .copied()
            .collect();
        let prior = (&pose, &self.ekf.pose_covariance());
        let surfaces = &self.evidence.surfaces;
        let found = matcher::find(surfaces, &visible, prior, &self.beam, &self.config.matcher);
        if let Some(found) = found.filter(|found| found.cost < 0.5 * likelihood::LIMIT) {
            self.ekf.replace_pose(&found.mean, &found.covariance);
        }
    }

    /// Enters the stretch into the map; the silent readings and the way with it.
    fn enter(&mut self, elements: &[Element], to_robot: &Pose2) {
        let pose = self.ekf.pose();
        let frame = pose.compose(to_robot);
        let covariance = self.ekf.pose_covariance();
        self.evidence.walls_rad = self.ekf.walls_rad();
        self.evidence.surfaces.begin(&pose, covariance);
        for element in elements.iter().map(|e| e.moved(&pose)) {
            if !self.evidence.is_behind_wall(&element, &self.beam) {
                self.evidence.enter_echo(&element, &self.beam);
            }
        }
        for track in &self.tracks {
            for reading in &track.readings[track.old..] {
                if reading.range_mm.is_none() {
                    self.evidence
                        .enter_silence(&frame.compose(&reading.sensor), &self.beam);
                }
            }
        }
        for at in &self.trace {
            self.evidence.enter_body(&frame.compose(at));
        }
    }

    /// The pose in the map's frame.
    // Requirement: NAV-pose-1
    pub fn estimate(&self) -> PoseEstimate {
        let covariance = self.ekf.pose_covariance();
        let rows = [0, 1, 2].map(|row| [0, 1, 2].map(|column| covariance[(row, column)]));
        PoseEstimate {
            pose: self.ekf.pose(),
            covariance: rows,
        }
    }

    /// The map so far.
    pub const fn grid(&self) -> &Grid {
        &self.evidence.grid
    }

    /// What was learned about wheels and gyroscope.
    pub fn calibration(&self) -> CalibrationEstimate {
        self.ekf.calibration()
    }
}

#[cfg(test)]
mod tests;
