//! What one reading of an ultrasonic rangefinder says about the cells in its cone.
//!
//! The sensor reports the nearest return of its cone. So
//! - everything in the cone that is clearly nearer is free: surest on the axis, less towards the
//!   rim, where a surface that reflects the sound away is more easily missed, and less with
//!   distance;
//! - somewhere on the arc at that distance is the thing that returned the echo: more likely near
//!   the axis, and more likely where the map does not know the arc to be free already. That last
//!   weight is what keeps the arcs from smearing corners and doorways;
//! - no echo at all is weak evidence of free space, and of the nearer part only: soft, oblique or
//!   small things return nothing.

use crate::{Grid, Pose};

/// The beam and the weights of the evidence (log-odds).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cone {
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
    /// What a missing echo frees, mm, at a fifth of the evidence.
    pub silent_mm: f64,
}

impl Default for Cone {
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

impl Cone {
    /// Enters one echo from `range` mm, heard by a sensor at `sensor`.
    pub fn echo(&self, grid: &mut Grid, sensor: &Pose, range: f64) {
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
    pub fn silence(&self, grid: &mut Grid, sensor: &Pose) {
        self.sweep(grid, sensor, self.silent_mm, |_| Evidence::Free(0.2));
    }

    fn sweep(&self, grid: &mut Grid, sensor: &Pose, reach: f64, judge: impl Fn(f64) -> Evidence) {
        let (columns, rows) = self.cover(grid, sensor, reach);
        let (sin, cos) = sensor.heading_rad.sin_cos();
        let mut arc = Vec::new();
        let mut likeliest = 0f32;
        for row in rows {
            for column in columns.clone() {
                let (x, y) = grid.middle_mm(column, row);
                let (dx, dy) = (x - sensor.x_mm, y - sensor.y_mm);
                let (ahead, aside) = (dx * cos + dy * sin, dy * cos - dx * sin);
                let off_axis = aside.atan2(ahead) / self.half_angle_rad;
                let distance = ahead.hypot(aside);
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
                        let beam = (-2.0 * off_axis * off_axis).exp();
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
        sensor: &Pose,
        reach: f64,
    ) -> (std::ops::Range<usize>, std::ops::Range<usize>) {
        let (mut x0, mut x1) = (sensor.x_mm, sensor.x_mm);
        let (mut y0, mut y1) = (sensor.y_mm, sensor.y_mm);
        for part in [-1.0, -0.5, 0.0, 0.5, 1.0] {
            let (sin, cos) = (sensor.heading_rad + part * self.half_angle_rad).sin_cos();
            // A little more than the reach covers the arc's bulge between these five points.
            let (x, y) = (
                sensor.x_mm + 1.02 * reach * cos,
                sensor.y_mm + 1.02 * reach * sin,
            );
            (x0, x1) = (x0.min(x), x1.max(x));
            (y0, y1) = (y0.min(y), y1.max(y));
        }
        grid.cover(x0..x1, y0..y1)
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

    fn cell(grid: &mut Grid, x: f64, y: f64) -> Cell {
        let (columns, rows) = grid.cover(x..x, y..y);
        grid.cell(columns.start, rows.start)
    }

    #[test]
    fn echoes_free_the_cone_and_occupy_the_arc() {
        let (mut grid, cone) = (Grid::new(25.0), Cone::default());
        for _ in 0..10 {
            cone.echo(&mut grid, &Pose::default(), 1000.0);
        }
        assert_eq!(cell(&mut grid, 500.0, 0.0), Cell::Free);
        assert_eq!(cell(&mut grid, 1000.0, 0.0), Cell::Occupied);
        assert_eq!(cell(&mut grid, 1100.0, 0.0), Cell::Unknown);
        assert_eq!(cell(&mut grid, 500.0, 300.0), Cell::Unknown);
        assert_eq!(cell(&mut grid, -100.0, 0.0), Cell::Unknown);
    }

    #[test]
    fn an_arc_prefers_the_cells_that_are_not_known_free() {
        let (mut grid, cone) = (Grid::new(25.0), Cone::default());
        // Seen from the side, the axis is free; the echo must come from the arc's upper part.
        for _ in 0..10 {
            cone.echo(
                &mut grid,
                &Pose::new(1000.0, -600.0, std::f64::consts::FRAC_PI_2),
                720.0,
            );
        }
        for _ in 0..10 {
            cone.echo(&mut grid, &Pose::default(), 1000.0);
        }
        assert_ne!(cell(&mut grid, 1000.0, 0.0), Cell::Occupied);
        assert_eq!(cell(&mut grid, 990.0, 120.0), Cell::Occupied);
    }

    #[test]
    fn silence_frees_only_the_nearer_part_and_occupies_nothing() {
        let (mut grid, cone) = (Grid::new(25.0), Cone::default());
        cone.silence(&mut grid, &Pose::default());
        assert_eq!(cell(&mut grid, 300.0, 0.0), Cell::Unknown);
        for _ in 0..60 {
            cone.silence(&mut grid, &Pose::default());
        }
        assert_eq!(cell(&mut grid, 300.0, 0.0), Cell::Free);
        assert_eq!(cell(&mut grid, 1600.0, 0.0), Cell::Unknown);
        let occupied = grid
            .cells()
            .filter(|&(c, r)| grid.cell(c, r) == Cell::Occupied)
            .count();
        assert_eq!(occupied, 0);
    }
}
