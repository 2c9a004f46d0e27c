//! What readings say about the cells of the occupancy grid.
//!
//! An echo whose bearing is known occupies a short piece of surface; one without a bearing only an
//! arc nearby, unless a known surface may have answered: arcs draw the ends of walls too long. The
//! cone in front of an echo is free as far as surfaces would have answered: a smooth surface that a
//! ray meets obliquely answers nothing, so such a ray neither clears it nor goes on behind it.

use std::f64::consts::{FRAC_PI_2, PI};

use geometry::wrap_angle;

use super::surface::{Beam, Element, Kind};
use super::surface_map::SurfaceMap;
use crate::{Grid, Point, Pose2};

/// Log-odds of one reading: free near the axis, free by silence, occupied.
const FREE: f32 = -0.35;
const SILENT: f32 = -0.06;
const OCCUPIED: f32 = 0.55;
/// The robot stood here.
const BODY: f32 = -1.0;
/// Radius of the body that is certainly free, mm.
const BODY_MM: f64 = 80.0;
/// Silence says something up to here, mm.
const SILENT_MM: f64 = 1000.0;
/// Without a bearing, echoes beyond this range occupy nothing, mm.
const ARC_MM: f64 = 700.0;
/// Half the arc that such an echo occupies, rad.
const ARC_RAD: f64 = 0.12;
/// A surface this much nearer or farther than such an echo explains it, mm.
const SAME_MM: f64 = 40.0;
/// A ray farther than this, rad, from the directions of the room's walls passes them unnoticed: it
/// clears with this share of its weight.
const OBLIQUE: (f64, f32) = (0.44, 0.3);
/// Step between rays, rad.
const RAY_RAD: f64 = 0.04;
/// A cell with more log-odds is a wall that hides what lies behind it …
const WALL: f32 = 1.5;
/// … and one with more than this stops rays that its surface would not answer.
const SURFACE: f32 = 0.3;
/// Space before the surface that is not cleared, mm.
const MARGIN_MM: f64 = 40.0;

/// The grid with the surfaces in it.
#[derive(Clone, Debug)]
pub(super) struct Evidence {
    pub grid: Grid,
    pub surfaces: SurfaceMap,
    /// One of the directions of the room's walls, rad, once known.
    pub walls_rad: Option<f64>,
}

impl Evidence {
    pub fn new(cell_mm: f64) -> Self {
        Self {
            grid: Grid::new(cell_mm),
            surfaces: SurfaceMap::default(),
            walls_rad: None,
        }
    }

    /// Whether a known surface that would not have answered lies between the sensor and the echo: a double bounce.
    /// One that would have is gone.
    pub fn is_behind_wall(&self, element: &Element, beam: &Beam) -> bool {
        let point = element.point(beam);
        let from = element.sensor.position();
        let heading_rad = (point - from).angle_rad();
        let reach = element.range_mm - 150.0;
        let mut away = 50.0;
        let mut hits = 0;
        while away < reach {
            let at = from.lerp(point, away / element.range_mm);
            if self.grid.log_odds_at(at) > WALL && self.is_oblique(at, heading_rad, beam) {
                hits += 1;
                if hits >= 2 {
                    return true;
                }
            }
            away += 20.0;
        }
        false
    }

    /// Enters an echo.
    pub fn enter_echo(&mut self, element: &Element, beam: &Beam) {
        let edge_mm = element.range_mm - MARGIN_MM;
        self.clear(&element.sensor, beam, edge_mm, FREE);
        if element.has_bearing() {
            let point = element.point(beam);
            self.surfaces
                .insert(point, element.towards_rad, element.kind);
            let surface = Pose2::new(point.x_mm, point.y_mm, element.towards_rad + PI / 2.0);
            self.grid.add_at(point, OCCUPIED);
            if element.kind != Kind::Edge {
                for along in [-20.0, 20.0] {
                    self.grid
                        .add_at(surface.point_at(along, 0.0), OCCUPIED / 2.0);
                }
            }
        } else if element.range_mm < ARC_MM && !self.is_explained(element, beam) {
            let step = 20.0 / element.range_mm.max(50.0);
            let mut off = -ARC_RAD;
            while off <= ARC_RAD {
                let towards = element.sensor.heading_rad + off;
                self.grid
                    .add_at(element.point_towards(beam, towards), OCCUPIED / 2.0);
                off += step;
            }
        }
    }

    /// Whether a known surface in the cone, or its edge, is as far away as this echo.
    fn is_explained(&self, element: &Element, beam: &Beam) -> bool {
        let (middle, range_mm) = (element.point(beam), element.range_mm);
        self.surfaces.near(middle, 0.3 * range_mm).any(|surfel| {
            let seen = Pose2::at(surfel.point, 0.0)
                .relative_to(&element.sensor)
                .position();
            (seen.length_mm() - range_mm).abs() < SAME_MM
                && seen.angle_rad().abs() < beam.half_angle_rad
        })
    }

    /// Enters a reading without an echo.
    pub fn enter_silence(&mut self, sensor: &Pose2, beam: &Beam) {
        self.clear(sensor, beam, SILENT_MM, SILENT);
    }

    /// The robot's body was here.
    pub fn enter_body(&mut self, pose: &Pose2) {
        let (x, y) = (pose.x_mm, pose.y_mm);
        let (columns, rows) = self
            .grid
            .cover(x - BODY_MM..x + BODY_MM, y - BODY_MM..y + BODY_MM);
        for row in rows {
            for column in columns.clone() {
                if self.grid.middle(column, row).distance_mm(pose.position()) < BODY_MM {
                    self.grid.add(column, row, BODY);
                }
            }
        }
    }

    /// Clears the cone up to `reach_mm`.
    fn clear(&mut self, sensor: &Pose2, beam: &Beam, reach_mm: f64, log_odds: f32) {
        let half = beam.half_angle_rad * 0.9;
        let step_mm = self.grid.cell_mm();
        let mut off = -half;
        while off <= half {
            let heading_rad = sensor.heading_rad + off;
            let ray = Pose2 {
                heading_rad,
                ..*sensor
            };
            #[allow(clippy::cast_possible_truncation)] // a weight
            let mut weight = log_odds * (1.0 - 0.7 * (off / half).powi(2)) as f32;
            if self.walls_rad.is_some_and(|walls_rad| {
                let quarters = (heading_rad - walls_rad) / FRAC_PI_2;
                (quarters - quarters.round()).abs() * FRAC_PI_2 > OBLIQUE.0
            }) {
                weight *= OBLIQUE.1;
            }
            off += RAY_RAD;
            let mut away = 0.0;
            while away < reach_mm {
                let point = ray.point_at(away, 0.0);
                away += step_mm;
                if self.grid.log_odds_at(point) > SURFACE
                    && self.is_oblique(point, heading_rad, beam)
                {
                    break;
                }
                // Neighbouring rays overlap near the sensor.
                #[allow(clippy::cast_possible_truncation)] // a weight
                let share = (away * RAY_RAD / step_mm).min(1.0) as f32;
                self.grid.add_at(point, weight * share);
            }
        }
    }

    /// Whether most of the surface known at `point` would not answer a ray along `heading_rad`.
    fn is_oblique(&self, point: Point, heading_rad: f64, beam: &Beam) -> bool {
        let answers =
            |facing: f64| wrap_angle(facing + PI - heading_rad).abs() < beam.incidence_rad - 0.1;
        let near = self.surfaces.near(point, self.grid.cell_mm());
        let votes = near.map(|s| {
            if s.edge || answers(s.facing_rad) {
                -s.weight
            } else {
                s.weight
            }
        });
        votes.sum::<f64>() > 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Cell;
    use nalgebra::Matrix3;

    const BEAM: Beam = Beam {
        half_angle_rad: PI / 12.0,
        incidence_rad: PI / 6.0,
    };

    fn echo(range_mm: f64, kind: Kind, spread_rad: f64) -> Element {
        let sensor = Pose2::default();
        Element {
            sensor,
            range_mm,
            kind,
            towards_rad: 0.0,
            spread_rad,
        }
    }

    fn evidence_of(elements: &[Element]) -> Evidence {
        let mut evidence = Evidence::new(25.0);
        evidence.surfaces.begin(&Pose2::default(), Matrix3::zeros());
        for element in elements {
            evidence.enter_echo(element, &BEAM);
        }
        evidence
    }

    fn occupied(evidence: &Evidence) -> Vec<Point> {
        evidence.grid.occupied().collect()
    }

    #[test]
    fn echo_with_bearing_occupies_its_point_and_frees_cone() {
        let evidence = evidence_of(&[echo(1000.0, Kind::Wall, 0.03); 12]);
        let found = occupied(&evidence);
        assert!(!found.is_empty());
        assert!(
            found
                .iter()
                .all(|p| p.distance_mm(Point::new(1000.0, 0.0)) < 50.0),
            "{found:?}"
        );
        for (x, y, cell) in [
            (500.0, 0.0, Cell::Free),
            (500.0, 80.0, Cell::Free),
            (500.0, 200.0, Cell::Unknown),
            (1100.0, 0.0, Cell::Unknown),
        ] {
            assert_eq!(evidence.grid.cell_at(Point::new(x, y)), cell, "{x} {y}");
        }
    }

    #[test]
    fn echo_without_bearing_occupies_arc_only_nearby() {
        let arc = evidence_of(&[echo(610.0, Kind::Unclear, 0.2); 6]).grid;
        for off_rad in [-0.1, 0.0, 0.1] {
            let at = Pose2::new(0.0, 0.0, off_rad).point_at(610.0, 0.0);
            assert_eq!(arc.cell_at(at), Cell::Occupied, "{off_rad}");
        }
        assert!(occupied(&evidence_of(&[echo(800.0, Kind::Unclear, 0.2); 6])).is_empty());
    }

    #[test]
    fn known_surface_stays_unless_it_would_have_answered() {
        for (facing_deg, expected) in [(180.0f64, Cell::Free), (130.0, Cell::Occupied)] {
            let mut evidence = evidence_of(&[]);
            let at = Point::new(510.0, 10.0);
            for _ in 0..5 {
                let towards = (facing_deg + 180.0).to_radians();
                evidence.surfaces.insert(at, towards, Kind::Wall);
                evidence.grid.add_at(at, OCCUPIED);
            }
            for _ in 0..20 {
                evidence.enter_echo(&echo(1500.0, Kind::Unclear, 0.2), &BEAM);
            }
            assert_eq!(evidence.grid.cell_at(at), expected, "{facing_deg}");
            // Behind a surface that mirrors the sound away nothing is seen.
            let behind = evidence.grid.cell_at(Point::new(900.0, 18.0));
            assert_eq!(behind == Cell::Free, expected == Cell::Free, "{facing_deg}");
        }
    }

    #[test]
    fn ray_oblique_to_walls_clears_little() {
        for (walls_deg, free) in [(0.0f64, true), (45.0, false)] {
            let mut evidence = evidence_of(&[]);
            evidence.walls_rad = Some(walls_deg.to_radians());
            for _ in 0..8 {
                evidence.enter_echo(&echo(1000.0, Kind::Unclear, 0.2), &BEAM);
            }
            let cell = evidence.grid.cell_at(Point::new(600.0, 8.0));
            assert_eq!(cell == Cell::Free, free, "{walls_deg}");
        }
    }

    #[test]
    fn silence_is_weak_evidence_up_to_one_metre() {
        let mut evidence = evidence_of(&[]);
        let at = |evidence: &Evidence, x| evidence.grid.cell_at(Point::new(x, 0.0));
        evidence.enter_silence(&Pose2::default(), &BEAM);
        assert_eq!(at(&evidence, 600.0), Cell::Unknown);
        for _ in 0..60 {
            evidence.enter_silence(&Pose2::default(), &BEAM);
        }
        assert_eq!(at(&evidence, 600.0), Cell::Free);
        assert_eq!(at(&evidence, 1200.0), Cell::Unknown);
        assert!(occupied(&evidence).is_empty());
    }

    #[test]
    fn edge_occupies_its_point_and_wall_a_stretch() {
        for (kind, y_mm) in [(Kind::Edge, &[12.5][..]), (Kind::Wall, &[-12.5, 12.5])] {
            let found = occupied(&evidence_of(&[echo(1010.0, kind, 0.03); 12]));
            let expected: Vec<_> = y_mm.iter().map(|&y_mm| Point::new(1012.5, y_mm)).collect();
            assert_eq!(found, expected);
        }
    }

    #[test]
    fn echo_without_bearing_of_a_known_surface_occupies_nothing() {
        // At its edge a surface answers from any direction.
        for (range_mm, bearing_rad, explained) in [
            (600.0, 0.0, true),
            (565.0, 0.24, true),
            (635.0, -0.24, true),
            (555.0, 0.0, false),
            (645.0, 0.0, false),
            (600.0, 0.28, false),
        ] {
            let mut evidence = evidence_of(&[]);
            let at = Pose2::new(0.0, 0.0, bearing_rad).point_at(range_mm, 0.0);
            evidence.surfaces.insert(at, bearing_rad + 1.2, Kind::Wall);
            for _ in 0..6 {
                evidence.enter_echo(&echo(600.0, Kind::Unclear, 0.2), &BEAM);
            }
            assert_eq!(occupied(&evidence).is_empty(), explained);
        }
    }

    #[test]
    fn echo_is_behind_an_oblique_wall_of_two_cells_well_before_it() {
        for (facing_deg, is_oblique) in [(130.0f64, true), (180.0, false)] {
            let mut evidence = evidence_of(&[]);
            let mut occupy = |x_mm| {
                let at = Point::new(x_mm, 1.0);
                let towards_rad = (facing_deg + 180.0).to_radians();
                evidence.surfaces.insert(at, towards_rad, Kind::Wall);
                evidence.grid.add_at(at, 4.0);
                [1000.0, 570.0].map(|range_mm| {
                    evidence.is_behind_wall(&echo(range_mm, Kind::Wall, 0.03), &BEAM)
                })
            };
            assert_eq!(occupy(410.0), [false, false]);
            assert_eq!(occupy(435.0), [is_oblique, false]);
        }
    }
}
