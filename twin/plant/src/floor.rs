//! What the floor adds to the wheels' travel: texture, sills and carpet edges.

use geometry::{Point, Segment};

use crate::imperfections::stream;
use crate::{Imperfections, Pose2, Rng, Room, Sides, Sill};

/// Travel over which a wheel rolls off a sill, mm: half of its diameter.
const SILL_WAY_MM: f64 = 40.0;
/// Travel that the noise's figure refers to, mm.
const NOISE_WAY_MM: f64 = 100.0;

/// The floor under one robot.
#[derive(Clone, Debug)]
pub(crate) struct Floor {
    noise_mm: f64,
    sill: Option<Sill>,
    rng: Rng,
    /// The sills being crossed: travel left of each, and the travel it adds per millimetre.
    crossings: Vec<(f64, Sides<f64>)>,
}

impl Floor {
    pub(crate) fn new(imperfections: &Imperfections, seed: u64) -> Self {
        Self {
            noise_mm: imperfections.travel_noise_mm.unwrap_or(0.0),
            sill: imperfections.sill,
            rng: Rng::stream(seed, stream::FLOOR),
            crossings: Vec::new(),
        }
    }

    /// What wheels that would roll `nominal` millimetres on a perfect floor truly roll.
    pub(crate) fn travel(&mut self, nominal: Sides<f64>) -> Sides<f64> {
        let mut travel = nominal;
        if self.noise_mm > 0.0 {
            travel = travel.map(|mm| {
                let sigma = self.noise_mm * (mm.abs() / NOISE_WAY_MM).sqrt();
                mm + sigma * self.rng.normal()
            });
        }
        let way = f64::midpoint(nominal.left, nominal.right).abs();
        for (left, per_mm) in &mut self.crossings {
            let part = way.min(*left);
            *left -= part;
            travel = travel.zip(*per_mm).map(|(mm, per_mm)| mm + part * per_mm);
        }
        self.crossings.retain(|&(left, _)| left > 0.0);
        travel
    }

    /// The middle of the axle has moved: begins the crossing of the sills in between.
    pub(crate) fn cross(&mut self, room: &Room, from: &Pose2, to: &Pose2, track_mm: f64) {
        let Some(Sill { yaw_deg, slip_mm }) = self.sill else {
            return;
        };
        let way = Segment::new(from.position(), to.position());
        for _ in room.sills.iter().filter(|sill| crosses(&way, sill)) {
            let kick = self.rng.within(yaw_deg.to_radians()) * track_mm / 2.0;
            let slip = slip_mm * self.rng.unit();
            let forward = to.relative_to(from).x_mm.signum();
            let added = Sides::new(-kick - forward * slip, kick - forward * slip);
            let per_mm = added.map(|mm| mm / SILL_WAY_MM);
            self.crossings.push((SILL_WAY_MM, per_mm));
        }
    }
}

/// Whether two segments cross; the end of `way` does not count, its start does.
fn crosses(way: &Segment, sill: &Segment) -> bool {
    let side = |line: &Segment, point: Point| (line.to - line.from).cross(point - line.from) >= 0.0;
    side(sill, way.from) != side(sill, way.to) && side(way, sill.from) != side(way, sill.to)
}

#[cfg(test)]
mod tests;
