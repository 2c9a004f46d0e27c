//! Inverse sensor model of an ultrasonic rangefinder: the evidence of one reading for the cells in
//! its cone.
//!
//! The sensor reports the nearest return of its cone. So
//! - everything in the cone that is clearly nearer is free, with a weight that falls towards the
//!   rim, where a surface may reflect the sound away, and with distance;
//! - the reflector lies on the arc at that distance: more likely near the axis, and more likely
//!   where the map is not yet free, which keeps arcs from smearing corners and doorways;
//! - no echo is weak evidence of free space in the nearer part: soft, oblique or small objects
//!   return nothing.

use crate::{Grid, Point, Pose2};

/// The beam and the weights of the evidence (log-odds).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SonarModel {
    /// Half the opening angle, radians.
    pub half_angle_rad: f64,
    /// Evidence of "free" per reading on the axis near the sensor.
    pub free: f32,
    /// Evidence of "occupied" per reading at the likeliest cell of the arc, near the sensor.
    pub occupied: f32,
    /// Half the thickness of the arc, mm, at range 0 …
    pub arc_mm: f64,
    /// … and how it grows with the range, mm per mm.
    pub arc_per_mm: f64,
    /// Range at which a reading's evidence has fallen to half, mm.
    pub half_weight_mm: f64,
    /// Range that a missing echo frees, mm, at a fifth of the evidence.
    pub silent_mm: f64,
}

impl Default for SonarModel {
    /// The US-015's cone of ±15°; the weights were chosen on simulated drives.
    fn default() -> Self {
        Self {
            half_angle_rad: 15f64.to_radians(),
            free: 0.8,
            occupied: 1.2,
            arc_mm: 15.0,
            arc_per_mm: 0.005,
            half_weight_mm: 1200.0,
            silent_mm: 1000.0,
        }
    }
}

impl SonarModel {
    /// Enters an echo at `range` mm, received by a sensor at `sensor`.
    pub fn enter_echo(&self, grid: &mut Grid, sensor: &Pose2, range: f64) {
        let arc = self.arc_mm + self.arc_per_mm * range;
        self.sweep(grid, sensor, range + arc, |distance| {
            if distance < range - 1.5 * arc {
                Evidence::Free(1.0)
            } else if (distance - range).abs() <= arc {
                Evidence::Arc
            } else {
                Evidence::None
            }
        });
    }

    /// Enters a reading without an echo.
    pub fn enter_silence(&self, grid: &mut Grid, sensor: &Pose2) {
        self.sweep(grid, sensor, self.silent_mm, |_| Evidence::Free(0.2));
    }

    fn sweep(&self, grid: &mut Grid, sensor: &Pose2, reach: f64, judge: impl Fn(f64) -> Evidence) {
        let (columns, rows) = self.cover(grid, sensor, reach);
        let axis = sensor.direction();
        let (sin, cos) = libm::sincos(self.half_angle_rad);
        let mut arc = Vec::new();
        let mut likeliest = 0f32;
        for row in rows {
            for column in columns.clone() {
                let way = grid.middle(column, row) - sensor.position();
                let seen = Point::new(axis.dot(way), axis.cross(way));
                // Most cells of the rectangle are more than a micrometre beside the cone: they need no angle.
                if seen.y_mm.abs() * cos - seen.x_mm * sin > 1e-3 || seen.x_mm > reach {
                    continue;
                }
                let off_axis = seen.angle_rad() / self.half_angle_rad;
                let distance = seen.length_mm();
                if off_axis.abs() > 1.0 || distance > reach {
                    continue;
                }
                match judge(distance) {
                    Evidence::None => {}
                    Evidence::Free(share) => {
                        let weight = (1.0 - off_axis * off_axis).powi(2) * self.fading(distance);
                        grid.add(column, row, -self.free * share * narrow(weight));
                    }
                    Evidence::Arc => {
                        let beam = libm::exp(-2.0 * off_axis * off_axis);
                        let likely = narrow(beam) * grid.probability(column, row);
                        likeliest = likeliest.max(likely);
                        arc.push((column, row, likely, distance));
                    }
                }
            }
        }
        for (column, row, likely, distance) in arc {
            let share = likely / likeliest;
            let weight = self.occupied * share * share * narrow(self.fading(distance));
            grid.add(column, row, weight);
        }
    }

    fn fading(&self, distance: f64) -> f64 {
        1.0 / (1.0 + (distance / self.half_weight_mm).powi(2))
    }

    /// The cells of the rectangle around the cone.
    fn cover(
        &self,
        grid: &mut Grid,
        sensor: &Pose2,
        reach: f64,
    ) -> (std::ops::Range<usize>, std::ops::Range<usize>) {
        let ends = [-1.0, -0.5, 0.0, 0.5, 1.0].map(|share| {
            let heading_rad = sensor.heading_rad + share * self.half_angle_rad;
            // A little more than the reach covers the arc's bulge between these five points.
            sensor.facing(heading_rad).point_at(1.02 * reach, 0.0)
        });
        let corners = Point::bounds(ends.into_iter().chain([sensor.position()]));
        let (low, high) = corners.unwrap_or_default();
        grid.cover(low.x_mm..high.x_mm, low.y_mm..high.y_mm)
    }
}

enum Evidence {
    None,
    Free(f32),
    Arc,
}

#[allow(clippy::cast_possible_truncation)] // weights
fn narrow(weight: f64) -> f32 {
    weight as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Cell;

    fn cell(grid: &Grid, x_mm: f64, y_mm: f64) -> Cell {
        grid.cell_at(Point::new(x_mm, y_mm))
    }

    #[test]
    fn echoes_free_cone_and_occupy_arc() {
        let (mut grid, model) = (Grid::new(25.0), SonarModel::default());
        for _ in 0..10 {
            model.enter_echo(&mut grid, &Pose2::default(), 1000.0);
        }
        for (x, y, expected) in [
            (500.0, 0.0, Cell::Free),
            (1000.0, 0.0, Cell::Occupied),
            (1100.0, 0.0, Cell::Unknown),
            (500.0, 300.0, Cell::Unknown),
            (-100.0, 0.0, Cell::Unknown),
        ] {
            assert_eq!(cell(&grid, x, y), expected, "{x} {y}");
        }
        let arc = [240.0, -240.0].map(|y_mm| grid.log_odds_at(Point::new(970.0, y_mm)));
        assert!(arc[0] > 0.0 && (arc[0] - arc[1]).abs() < 1e-3, "{arc:?}");
    }

    #[test]
    fn arc_avoids_cells_known_free() {
        let (mut grid, model) = (Grid::new(25.0), SonarModel::default());
        // Seen from the side, the axis is free; the echo comes from the arc's upper part.
        let aside = Pose2::new(1000.0, -600.0, std::f64::consts::FRAC_PI_2);
        for _ in 0..10 {
            model.enter_echo(&mut grid, &aside, 720.0);
        }
        for _ in 0..10 {
            model.enter_echo(&mut grid, &Pose2::default(), 1000.0);
        }
        assert_ne!(cell(&grid, 1000.0, 0.0), Cell::Occupied);
        assert_eq!(cell(&grid, 990.0, 120.0), Cell::Occupied);
    }

    #[test]
    fn silence_frees_nearer_part_and_occupies_nothing() {
        let (mut grid, model) = (Grid::new(25.0), SonarModel::default());
        model.enter_silence(&mut grid, &Pose2::default());
        assert_eq!(cell(&grid, 300.0, 0.0), Cell::Unknown);
        for _ in 0..60 {
            model.enter_silence(&mut grid, &Pose2::default());
        }
        assert_eq!(cell(&grid, 300.0, 0.0), Cell::Free);
        assert_eq!(cell(&grid, 1600.0, 0.0), Cell::Unknown);
        assert!(grid.cells().all(|(c, r)| grid.cell(c, r) != Cell::Occupied));
    }
}
