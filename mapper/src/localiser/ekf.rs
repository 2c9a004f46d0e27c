//! Extended Kalman filter of the pose and of the calibration.
//!
//! The gyroscope's increments turn the heading, the encoders' move the position. Where both are
//! present, the difference of their turns is a measurement of the calibration: at rest of the
//! gyroscope's bias, driving straight of the wheels' difference, turning of the scales.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use super::calibration::{CalibrationEstimate, MotionNoise};
use crate::Pose2;

/// Number of states.
const N: usize = WALLS + DIRECTIONS;
/// Position of the states; 0 to 2 are x, y (mm) and the heading (rad).
const TRAVEL: usize = 3;
const DIFFERENCE: usize = 4;
const TURN: usize = 5;
const SCALE: usize = 6;
const BIAS: usize = 7;
/// The first of the known directions of walls, modulo a right angle, rad, and their number.
const WALLS: usize = 8;
const DIRECTIONS: usize = 4;

/// What the odometry and the gyroscope report between two observations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Increment {
    pub time_s: f64,
    pub forward_mm: f64,
    pub turn_rad: f64,
    pub gyro_rad: Option<f64>,
}

/// Time over which the turns of encoders and gyroscope are compared, s.
const COMPARISON_S: f64 = 0.5;
/// Quantisation of the encoders' turn over that time, rad: half a count per wheel.
const TURN_STEP_RAD: f64 = 3e-4;
/// What varies of the gyroscope's lag, s.
const LAG_JITTER_S: f64 = 0.005;
/// A difference beyond this many deviations is slip and says nothing about the calibration.
const SLIP_GATE: f64 = 4.0;
/// Error of the bias that the core takes off at every rest, rad/s: 0.05 °/s over 64 samples.
const RESET_BIAS_RAD_S: f64 = 1.1e-4;

/// Deviation of a wall's direction by one stretch, rad: 0.8° to 1.2° against the truth of generated rooms.
const WALL_RAD: f64 = 0.021;
/// Beyond this many deviations, a wall has not the direction that is nearest to its own.
const WALL_GATE: f64 = 3.0;
/// A wall this far from every known direction, rad, has one of its own; nearer, it might be one of them.
const OWN_RAD: f64 = 0.12;
/// A direction is as hard to forget as this many walls.
const MOST_VOTES: u32 = 10;

/// Sums since the last comparison of the turns.
#[derive(Clone, Copy, Debug, Default)]
struct Comparison {
    time_s: f64,
    forward_mm: f64,
    turn_rad: f64,
    gyro_rad: f64,
    variance: f64,
    /// The rate of turn when they began, rad/s.
    began_rad_s: f64,
}

#[derive(Clone, Debug)]
pub(super) struct Ekf {
    noise: MotionNoise,
    state: SVector<f64, N>,
    covariance: SMatrix<f64, N, N>,
    comparison: Comparison,
    /// The rate of turn in the last frame, rad/s.
    rate_rad_s: f64,
    /// Walls that agreed with each direction less those that agreed with none; 0 is no direction.
    votes: [u32; DIRECTIONS],
    /// Walls that agreed with each direction since it is known.
    walls: [u32; DIRECTIONS],
}

impl Ekf {
    pub fn new(noise: MotionNoise, pose: &Pose2, pose_covariance: &Matrix3<f64>) -> Self {
        let mut state = SVector::<f64, N>::zeros();
        let pose = Vector3::new(pose.x_mm, pose.y_mm, pose.heading_rad);
        state.fixed_rows_mut::<3>(0).copy_from(&pose);
        let mut covariance = SMatrix::<f64, N, N>::zeros();
        covariance
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(pose_covariance);
        for (nth, deviation) in noise.calibration.iter().enumerate() {
            covariance[(TRAVEL + nth, TRAVEL + nth)] = deviation * deviation;
        }
        Self {
            noise,
            state,
            covariance,
            comparison: Comparison::default(),
            rate_rad_s: 0.0,
            votes: [0; DIRECTIONS],
            walls: [0; DIRECTIONS],
        }
    }

    pub fn pose(&self) -> Pose2 {
        Pose2::new(self.state[0], self.state[1], self.state[2])
    }

    /// The direction that most walls of the room have, modulo a right angle, rad, once a wall was seen.
    pub fn walls_rad(&self) -> Option<f64> {
        let most = self.directions().max_by_key(|&nth| self.walls[nth])?;
        Some(self.state[WALLS + most])
    }

    /// The known directions.
    fn directions(&self) -> impl Iterator<Item = usize> + '_ {
        (0..DIRECTIONS).filter(|&nth| self.votes[nth] > 0)
    }

    pub fn pose_covariance(&self) -> Matrix3<f64> {
        self.covariance.fixed_view::<3, 3>(0, 0).into()
    }

    pub fn calibration(&self) -> CalibrationEstimate {
        let value = |nth: usize| (self.state[nth], self.covariance[(nth, nth)].sqrt());
        let scale = |nth: usize| (1.0 + value(nth).0, value(nth).1);
        let (travel, turn) = (value(TRAVEL), value(TURN));
        let track_deviation = libm::hypot(travel.1, turn.1);
        CalibrationEstimate {
            travel_scale: scale(TRAVEL),
            wheel_ratio: scale(DIFFERENCE),
            track_scale: ((1.0 + travel.0) / (1.0 + turn.0), track_deviation),
            gyro_scale: scale(SCALE),
            gyro_bias_rad_s: value(BIAS),
        }
    }

    /// Predicts, and returns the motion in the frame of the pose before.
    pub fn advance(&mut self, by: &Increment) -> Pose2 {
        let by = &self.without_lag(by);
        let Self { noise, state, .. } = *self;
        let half_turn = by.turn_rad.abs() * noise.track_mm / 2.0;
        // The sum of what both wheels rolled.
        let rolled = 2.0 * by.forward_mm.abs().max(half_turn);
        let wheel = noise.wheel * noise.wheel * rolled;
        let encoder_variance = wheel / (noise.track_mm * noise.track_mm);
        let gyro_variance = noise.gyro_walk * noise.gyro_walk * by.time_s;

        let travel = by.forward_mm * (1.0 + state[TRAVEL]);
        let mut turn_row = SMatrix::<f64, 1, N>::zeros();
        let (turn, turn_variance) = if let Some(gyro) = by.gyro_rad {
            let rate_free = gyro - state[BIAS] * by.time_s;
            turn_row[SCALE] = rate_free;
            turn_row[BIAS] = -by.time_s * (1.0 + state[SCALE]);
            (rate_free * (1.0 + state[SCALE]), gyro_variance)
        } else {
            turn_row[TURN] = by.turn_rad;
            turn_row[DIFFERENCE] = by.forward_mm / noise.track_mm;
            let turn = by.turn_rad * (1.0 + state[TURN]);
            (
                turn + state[DIFFERENCE] * turn_row[DIFFERENCE],
                encoder_variance,
            )
        };
        let motion = Pose2::default().advance_arc(
            travel - turn * noise.track_mm / 2.0,
            travel + turn * noise.track_mm / 2.0,
            noise.track_mm,
        );
        let (sin, cos) = libm::sincos(state[2] + turn / 2.0);
        let (dx, dy) = (travel * cos, travel * sin);
        let mut jacobian = SMatrix::<f64, N, N>::identity();
        jacobian
            .fixed_view_mut::<1, N>(2, 0)
            .zip_apply(&turn_row, |cell, by| *cell += by);
        jacobian[(0, 2)] = -dy;
        jacobian[(1, 2)] = dx;
        for nth in TRAVEL..N {
            jacobian[(0, nth)] = -dy / 2.0 * turn_row[nth];
            jacobian[(1, nth)] = dx / 2.0 * turn_row[nth];
        }
        jacobian[(0, TRAVEL)] += by.forward_mm * cos;
        jacobian[(1, TRAVEL)] += by.forward_mm * sin;
        let next = self.pose().compose(&motion);
        let next = Vector3::new(next.x_mm, next.y_mm, next.heading_rad);
        self.state.fixed_rows_mut::<3>(0).copy_from(&next);
        self.covariance = jacobian * self.covariance * jacobian.transpose();
        let slip = noise.slip * noise.slip * by.forward_mm.abs();
        let along = wheel / 4.0;
        self.covariance[(0, 0)] += along * cos * cos + slip;
        self.covariance[(1, 1)] += along * sin * sin + slip;
        self.covariance[(0, 1)] += along * sin * cos;
        self.covariance[(1, 0)] += along * sin * cos;
        self.covariance[(2, 2)] += turn_variance;
        for nth in TRAVEL..BIAS {
            self.covariance[(nth, nth)] += noise.scale_walk * noise.scale_walk * by.time_s;
        }
        self.covariance[(BIAS, BIAS)] += noise.bias_walk * noise.bias_walk * by.time_s;
        self.compare_turns(by, encoder_variance + gyro_variance);
        motion
    }

    /// The increment with the turn that the gyroscope's angle has yet to report.
    fn without_lag(&mut self, by: &Increment) -> Increment {
        let rate_rad_s = by.gyro_rad.unwrap_or(by.turn_rad) / by.time_s.max(1e-3);
        let more_rad_s = rate_rad_s - std::mem::replace(&mut self.rate_rad_s, rate_rad_s);
        let late_rad = self.noise.gyro_lag_s * more_rad_s;
        Increment {
            gyro_rad: by.gyro_rad.map(|gyro_rad| gyro_rad + late_rad),
            ..*by
        }
    }

    fn compare_turns(&mut self, by: &Increment, variance: f64) {
        let Some(gyro_rad) = by.gyro_rad else {
            self.comparison = Comparison::default();
            return;
        };
        let sums = &mut self.comparison;
        sums.time_s += by.time_s;
        sums.forward_mm += by.forward_mm;
        sums.turn_rad += by.turn_rad;
        sums.gyro_rad += gyro_rad;
        sums.variance += variance;
        if sums.time_s < COMPARISON_S {
            return;
        }
        let next = Comparison {
            began_rad_s: self.rate_rad_s,
            ..Comparison::default()
        };
        let sums = std::mem::replace(sums, next);
        let at_rest = sums.forward_mm == 0.0 && sums.turn_rad == 0.0;
        if at_rest {
            self.covariance[(BIAS, BIAS)] += RESET_BIAS_RAD_S * RESET_BIAS_RAD_S;
        }
        let quantisation = if at_rest { 0.0 } else { TURN_STEP_RAD };
        let bias_free = sums.gyro_rad - self.state[BIAS] * sums.time_s;
        let scale = 1.0 + self.state[SCALE];
        let mut row = SMatrix::<f64, 1, N>::zeros();
        row[TURN] = sums.turn_rad;
        row[DIFFERENCE] = sums.forward_mm / self.noise.track_mm;
        row[SCALE] = -bias_free;
        row[BIAS] = sums.time_s * scale;
        let expected = sums.turn_rad * (1.0 + self.state[TURN])
            + self.state[DIFFERENCE] * row[DIFFERENCE]
            - bias_free * scale;
        let lag_rad = LAG_JITTER_S * (self.rate_rad_s - sums.began_rad_s);
        let variance = sums.variance + quantisation * quantisation + lag_rad * lag_rad;
        self.measure(&row, -expected, variance, SLIP_GATE);
    }

    /// Takes the direction of a wall's normal in the robot's frame, rad. A wall parallel or at right angles to
    /// those of a known direction corrects the heading. The directions that many walls have are kept (heavy hitters
    /// of Misra and Gries).
    pub fn observe_wall(&mut self, normal_rad: f64) {
        let direction = self.state[2] + normal_rad;
        let known = self.directions().map(|nth| {
            let off = self.state[WALLS + nth] - direction;
            (nth, off - FRAC_PI_2 * (off / FRAC_PI_2).round())
        });
        let nearest = known.min_by(|(_, one), (_, other)| one.abs().total_cmp(&other.abs()));
        if let Some((nth, off)) = nearest.filter(|(_, off)| off.abs() < OWN_RAD) {
            let mut row = SMatrix::<f64, 1, N>::zeros();
            row[2] = 1.0;
            row[WALLS + nth] = -1.0;
            let before = (row * self.covariance * row.transpose())[0];
            let total = before + WALL_RAD * WALL_RAD;
            let deviations = off.abs() / total.sqrt();
            if deviations < WALL_GATE {
                // Beyond one deviation it counts less in proportion (Huber): a wall slightly askew, seen again
                // and again, is no scatter.
                let variance = total * deviations.max(1.0) - before;
                self.measure(&row, off, variance, f64::INFINITY);
                self.votes[nth] = (self.votes[nth] + 1).min(MOST_VOTES);
                self.walls[nth] += 1;
            }
        } else if let Some(free) = self.votes.iter().position(|&votes| votes == 0) {
            (self.votes[free], self.walls[free]) = (1, 1);
            self.add_direction(WALLS + free, direction);
        } else {
            self.votes = self.votes.map(|votes| votes - 1);
        }
    }

    /// This state is a wall's direction, known as well as the heading that it was seen from.
    fn add_direction(&mut self, nth: usize, direction_rad: f64) {
        self.state[nth] = direction_rad;
        let mut cross = self.covariance.column(2).clone_owned();
        cross[nth] = cross[2] + WALL_RAD * WALL_RAD;
        self.covariance.set_column(nth, &cross);
        self.covariance.set_row(nth, &cross.transpose());
    }

    /// Updates by one scalar measurement with this row, innovation and variance, unless the innovation is
    /// beyond `gate` deviations.
    fn measure(&mut self, row: &SMatrix<f64, 1, N>, innovation: f64, variance: f64, gate: f64) {
        let cross = self.covariance * row.transpose();
        let total = (row * cross)[0] + variance;
        if innovation * innovation > gate * gate * total {
            return;
        }
        let gain = cross / total;
        self.state += gain * innovation;
        self.covariance -= gain * cross.transpose();
        self.symmetrise();
    }

    /// Puts the pose elsewhere, without regard to the past.
    pub fn relocate(&mut self, mean: &Vector3<f64>, covariance: &Matrix3<f64>) {
        self.state.fixed_rows_mut::<3>(0).copy_from(mean);
        for nth in (0..3).chain(WALLS..N) {
            self.covariance.row_mut(nth).fill(0.0);
            self.covariance.column_mut(nth).fill(0.0);
        }
        self.covariance
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(covariance);
        self.votes = [0; DIRECTIONS];
    }

    /// Replaces the pose's mean and covariance; the calibration follows by its correlation.
    pub fn replace_pose(&mut self, mean: &Vector3<f64>, covariance: &Matrix3<f64>) {
        let prior = self.pose_covariance();
        let Some(inverse) = prior.try_inverse() else {
            return;
        };
        let gain = self.covariance.fixed_view::<N, 3>(0, 0) * inverse;
        let offset = mean - self.state.fixed_rows::<3>(0);
        self.state += gain * offset;
        self.covariance -= gain * (prior - covariance) * gain.transpose();
        self.symmetrise();
    }

    fn symmetrise(&mut self) {
        self.covariance = (self.covariance + self.covariance.transpose()) * 0.5;
    }
}

#[cfg(test)]
mod tests;
