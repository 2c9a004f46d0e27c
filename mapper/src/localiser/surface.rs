//! Oriented surface elements: the direction an echo came from, by the change of the range along
//! the way.
//!
//! The range is the distance to the nearest answering point of a cone; its derivative along the
//! sensor's way is the sine of the bearing of that point. Along a wall the range is linear in the
//! way, around an edge or a leg it is curved by 1/range. Leonard and Durrant-Whyte's regions of
//! constant depth are the case of a turning sensor.

use geometry::wrap_angle;

use crate::{Point, Pose2};

/// One measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Reading {
    /// The sensor's pose, its bearing included.
    pub sensor: Pose2,
    /// `None` without an echo.
    pub range_mm: Option<f64>,
}

/// What answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// A straight surface.
    Wall,
    /// An edge or a leg.
    Edge,
    /// Either; the bearing may be known or not.
    Unclear,
}

/// An echo with the direction that it came from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Element {
    pub sensor: Pose2,
    pub range_mm: f64,
    pub kind: Kind,
    /// Direction from the sensor to the surface along the surface's normal, rad.
    pub towards_rad: f64,
    /// Its deviation, rad.
    pub spread_rad: f64,
}

/// The beam as the fit sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Beam {
    /// Half the opening angle, rad.
    pub half_angle_rad: f64,
    /// Largest angle of incidence with an echo, rad.
    pub incidence_rad: f64,
}

/// Readings on each side that take part in a fit, and their largest distance in way, mm.
const ASIDE: usize = 10;
const ASIDE_MM: f64 = 130.0;
/// Angle of incidence of an echo: standard deviation without other knowledge, rad.
const PRIOR_RAD: f64 = 0.2;
/// A bearing with more than this deviation is not known, rad.
pub(super) const KNOWN_RAD: f64 = 0.12;
/// Step of the search for the bearing, rad.
const STEP_RAD: f64 = 0.02;
/// Half the difference of the squared residuals that decides between wall and edge.
const DECISIVE: f64 = 2.5;
/// Largest mean squared residual, in variances.
const MISFIT: f64 = 4.0;

/// Standard deviation of a range, mm, the errors of the dead reckoning within a fit included.
pub(super) fn range_deviation_mm(range_mm: f64) -> f64 {
    1.5 + 0.0015 * range_mm
}

impl Element {
    /// Whether the direction to the surface is known.
    pub fn has_bearing(&self) -> bool {
        self.spread_rad < KNOWN_RAD
    }

    /// The answering point, if the surface's normal is in direction `towards_rad`: the beam's rim
    /// where the normal is outside of it.
    pub fn point_towards(&self, beam: &Beam, towards_rad: f64) -> Point {
        let off = wrap_angle(towards_rad - self.sensor.heading_rad);
        let off = off.clamp(-beam.half_angle_rad, beam.half_angle_rad);
        let heading_rad = self.sensor.heading_rad + off;
        Pose2 {
            heading_rad,
            ..self.sensor
        }
        .point_at(self.range_mm, 0.0)
    }

    /// The answering point.
    pub fn point(&self, beam: &Beam) -> Point {
        self.point_towards(beam, self.towards_rad)
    }

    /// The same in the frame that `frame` is given in.
    pub fn moved(&self, frame: &Pose2) -> Self {
        Self {
            sensor: frame.compose(&self.sensor),
            towards_rad: self.towards_rad + frame.heading_rad,
            ..*self
        }
    }
}

/// The element of reading `at` of one sensor's successive readings. `None` for a reading that no
/// neighbour confirms.
pub(super) fn element(readings: &[Reading], at: usize, beam: &Beam) -> Option<Element> {
    let reading = readings[at];
    let range_mm = reading.range_mm?;
    let (before, behind) = readings.split_at(at);
    let back = neighbours(reading, before.iter().rev());
    let ahead = neighbours(reading, behind[1..].iter());
    let unclear = Element {
        sensor: reading.sensor,
        range_mm,
        kind: Kind::Unclear,
        towards_rad: reading.sensor.heading_rad,
        spread_rad: PRIOR_RAD,
    };
    for share in [1, 2] {
        let (back, ahead) = (back / share, ahead / share);
        if back + ahead < 4 {
            break;
        }
        if let Some(found) = fit(&readings[at - back..=at + ahead], &unclear, beam) {
            return Some(found);
        }
    }
    (back + ahead > 0).then_some(unclear)
}

/// How many successive readings continue this one: no distance changes faster than the way.
fn neighbours<'a>(from: Reading, readings: impl Iterator<Item = &'a Reading>) -> usize {
    let (mut last, mut way_mm, mut count) = (from, 0.0, 0);
    for next in readings.take(ASIDE) {
        let (Some(a), Some(b)) = (last.range_mm, next.range_mm) else {
            break;
        };
        let step = last.sensor.distance_mm(&next.sensor);
        way_mm += step;
        // Off the cone's rim the range is up to 1/cos 15° of the distance: it may change by 3.5 %
        // while the sensor turns.
        let turned = last.sensor.turn_to_rad(&next.sensor).abs();
        let allowed = step + 4.0 * range_deviation_mm(a) + 0.25 * a * turned.min(0.15);
        let seen_from = from.sensor.turn_to_rad(&next.sensor).abs();
        if way_mm > ASIDE_MM || (a - b).abs() > allowed || seen_from > 0.8 {
            break;
        }
        last = *next;
        count += 1;
    }
    count
}

/// Fits a wall and an edge to the readings of one surface.
fn fit(readings: &[Reading], unclear: &Element, beam: &Beam) -> Option<Element> {
    let count = f64::from(u32::try_from(readings.len()).unwrap_or(1));
    let axis = unclear.sensor.heading_rad;
    let off = |reading: &Reading| wrap_angle(reading.sensor.heading_rad - axis);
    let mean_off = readings.iter().map(off).sum::<f64>() / count;
    let deviation = range_deviation_mm(unclear.range_mm);
    let mut wall = Posterior::default();
    let mut edge = Posterior::default();
    let steps = (beam.incidence_rad / STEP_RAD).round();
    let mut aside = -steps;
    while aside <= steps {
        let bearing = mean_off + aside * STEP_RAD;
        aside += 1.0;
        let largest = readings
            .iter()
            .map(|r| (bearing - off(r)).abs())
            .fold(0.0, f64::max);
        if largest > beam.incidence_rad + 0.1 {
            continue;
        }
        let prior = ((bearing - mean_off) / PRIOR_RAD).powi(2);
        let direction = axis + bearing;
        let misfit = wall_misfit(readings, direction, beam) / (deviation * deviation);
        wall.add(bearing, misfit, prior);
        if largest <= beam.half_angle_rad + 0.1 {
            let misfit = edge_misfit(readings, unclear, direction) / (deviation * deviation);
            edge.add(bearing, misfit, prior);
        }
    }
    let (wall_cost, edge_cost) = (wall.best.0 / 2.0, edge.best.0 / 2.0);
    let (kind, posterior) = if wall_cost < edge_cost - DECISIVE {
        (Kind::Wall, wall)
    } else if edge_cost < wall_cost - DECISIVE {
        (Kind::Edge, edge)
    } else if wall_cost < edge_cost + DECISIVE / 2.0 {
        (Kind::Unclear, wall)
    } else {
        (Kind::Unclear, edge)
    };
    if posterior.best.1 > MISFIT * (count - 2.0) {
        return None;
    }
    let (bearing, spread) = posterior.moments();
    Some(Element {
        kind,
        towards_rad: axis + bearing,
        spread_rad: libm::hypot(spread, 0.02),
        ..*unclear
    })
}

/// Sum of the squared residuals of a wall whose normal is in this direction, mm².
fn wall_misfit(readings: &[Reading], direction: f64, beam: &Beam) -> f64 {
    let (sin, cos) = libm::sincos(direction);
    // The wall's distance from the origin along the direction, by each reading.
    scatter(readings.iter().map(|reading| {
        let off = wrap_angle(direction - reading.sensor.heading_rad).abs();
        let beyond = (off - beam.half_angle_rad).max(0.0);
        // Its cosine to 2e-4.
        let range = reading.range_mm.unwrap_or(0.0) * (1.0 - beyond * beyond / 2.0);
        range + reading.sensor.x_mm * cos + reading.sensor.y_mm * sin
    }))
}

/// Sum of the squared residuals of an edge in this direction from the middle reading, mm². A change
/// of its distance changes all ranges alike, to first order.
fn edge_misfit(readings: &[Reading], from: &Element, direction: f64) -> f64 {
    let heading_rad = direction;
    let edge = Pose2 {
        heading_rad,
        ..from.sensor
    }
    .point_at(from.range_mm, 0.0);
    scatter(readings.iter().map(|reading| {
        let (dx, dy) = (
            edge.x_mm - reading.sensor.x_mm,
            edge.y_mm - reading.sensor.y_mm,
        );
        reading.range_mm.unwrap_or(0.0) - (dx * dx + dy * dy).sqrt()
    }))
}

/// Sum of the squared differences from the mean.
fn scatter(values: impl Iterator<Item = f64> + Clone) -> f64 {
    let (sum, count) = values
        .clone()
        .fold((0.0, 0.0), |(s, n), v| (s + v, n + 1.0));
    values.map(|value| (value - sum / count).powi(2)).sum()
}

/// Costs over the bearing.
#[derive(Clone, Debug)]
struct Posterior {
    costs: Vec<(f64, f64)>,
    /// Smallest cost, and its misfit.
    best: (f64, f64),
}

impl Default for Posterior {
    fn default() -> Self {
        Self {
            costs: Vec::with_capacity(64),
            best: (f64::INFINITY, f64::INFINITY),
        }
    }
}

impl Posterior {
    fn add(&mut self, bearing: f64, misfit: f64, prior: f64) {
        self.costs.push((bearing, misfit + prior));
        if misfit + prior < self.best.0 {
            self.best = (misfit + prior, misfit);
        }
    }

    /// Mean and deviation of the bearing.
    fn moments(&self) -> (f64, f64) {
        let (mut weight, mut sum, mut square) = (0.0, 0.0, 0.0);
        for &(bearing, cost) in &self.costs {
            let share = libm::exp(-0.5 * (cost - self.best.0));
            weight += share;
            sum += share * bearing;
            square += share * bearing * bearing;
        }
        let mean = sum / weight;
        (mean, (square / weight - mean * mean).max(0.0).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::{Circle, Segment};
    use plant::Rng;
    use std::f64::consts::FRAC_PI_2;

    const BEAM: Beam = Beam {
        half_angle_rad: std::f64::consts::PI / 12.0,
        incidence_rad: std::f64::consts::FRAC_PI_6,
    };

    /// Readings to the left every 12 mm along x, by the distance that `range` gives.
    fn drive(range: impl Fn(&Pose2) -> Option<f64>) -> Vec<Reading> {
        let mut rng = Rng::new(1);
        (0..33)
            .map(|step| {
                let sensor = Pose2::new(12.0 * f64::from(step), 0.0, FRAC_PI_2);
                let noise = rng.normal();
                let range_mm = range(&sensor).map(|mm| mm + noise * (1.0 + 0.001 * mm));
                Reading { sensor, range_mm }
            })
            .collect()
    }

    #[test]
    fn slope_of_range_is_bearing_of_wall() {
        for (tilt_deg, distance_mm) in [(0.0f64, 500.0), (12.0, 900.0), (-27.0, 700.0)] {
            let (sin, cos) = tilt_deg.to_radians().sin_cos();
            let far =
                |side: f64| Point::new(side * 3000.0 * cos, distance_mm + side * 3000.0 * sin);
            let wall = Segment::new(far(-1.0), far(1.0));
            let beyond = (tilt_deg.to_radians().abs() - BEAM.half_angle_rad).max(0.0);
            let readings = drive(|at| Some(wall.distance_mm(at.position()) / beyond.cos()));
            let found = element(&readings, 16, &BEAM).unwrap();
            let off = (found.towards_rad - FRAC_PI_2).to_degrees() - tilt_deg;
            assert!(
                off.abs() < 3.0 && found.has_bearing() && found.spread_rad >= 0.02,
                "{tilt_deg} {found:?}"
            );
            assert_eq!(found.kind, Kind::Wall, "{tilt_deg}");
            let point = found.point(&BEAM);
            assert!(wall.distance_mm(point) < 8.0, "{found:?}");
            let frame = Pose2::new(10.0, 20.0, 2.0);
            let moved = found.moved(&frame).point(&BEAM);
            assert!(moved.distance_mm(frame.point_at(point.x_mm, point.y_mm)) < 1e-6);
        }
    }

    #[test]
    fn surface_rougher_than_the_ranges_has_no_bearing() {
        let zigzag = drive(|at| Some(500.0 + 8.0 * (FRAC_PI_2 * at.x_mm / 6.0).cos()));
        assert!(!element(&zigzag, 16, &BEAM).unwrap().has_bearing());
    }

    #[test]
    fn curvature_of_range_tells_legs_from_walls() {
        let leg = Circle {
            centre: Point::new(190.0, 500.0),
            radius_mm: 20.0,
        };
        let readings = drive(|at| Some(leg.distance_mm(at.position())));
        let found = element(&readings, 12, &BEAM).unwrap();
        assert_eq!(found.kind, Kind::Edge);
        assert!(leg.distance_mm(found.point(&BEAM)) < 15.0, "{found:?}");
    }

    #[test]
    fn driving_towards_wall_leaves_bearing_vague() {
        let mut readings = drive(|at| Some(900.0 - at.x_mm));
        for reading in &mut readings {
            reading.sensor.heading_rad = 0.0;
        }
        let found = element(&readings, 16, &BEAM).unwrap();
        assert!(
            found.spread_rad > 0.08 && found.kind == Kind::Unclear,
            "{found:?}"
        );
    }

    #[test]
    fn isolated_echo_is_dropped() {
        let readings = drive(|at| {
            Some(if (200.0..210.0).contains(&at.x_mm) {
                300.0
            } else {
                800.0
            })
        });
        let outlier = readings
            .iter()
            .position(|r| r.range_mm < Some(400.0))
            .unwrap();
        assert_eq!(element(&readings, outlier, &BEAM), None);
        let next = element(&readings, outlier + 1, &BEAM).unwrap();
        assert!(next.has_bearing() && next.kind != Kind::Edge, "{next:?}");
    }
}
