//! Pose controller: from the pose and the target to the motor commands.
//!
//! | phase | control |
//! |---|---|
//! | approach | The rotation PID turns the nose to the target, the forward PID drives. Forward output begins with the bearing within `HEADING_GATE` and grows as it closes. In reverse where that means less turning, up to `MAX_REVERSE`: the rangefinders look ahead. |
//! | final approach | From `FINAL_APPROACH` on the heading is held, because the bearing would swing; the forward PID drives either way, within `FINAL_HEADING_GATE`. Ends slow and about to stop within half the position tolerance. |
//! | final rotation | The rotation PID turns to the target's heading, the forward PID holds the position. Brakes as soon as the robot would come to rest within the position tolerance and ¾ of the heading tolerance. Beyond twice the position tolerance: approach again. |
//! | hold | Within both tolerances and at rest for 50 ms: braked. A disturbance beyond 1⅝ position tolerances or 1⅗ heading tolerances restarts. |
//!
//! An attempt that ends outside the tolerances widens them by a half, once, so that a robot that cannot do better does
//! not hunt. The obstacle stop bounds the distance that the forward PID receives to the one at which it drives with the
//! allowed speed, and clears its integral. From the final approach on the rotation PID's derivative acts on the deviation
//! from a planned turn rate: heavily damped gains would else creep through the last 20°.

pub mod state;
pub mod stiction;
mod tracking_error;

use fixed::types::I16F16;

use super::ObstacleLimit;
use super::mixer::Mixer;
use super::pid::Pid;
use super::trig::upper;
use crate::divide::div_rem;
use crate::eeprom::{Config, Wheel};
use crate::types::{Delta, Duty, MotorCommands, Pose, Turns};
use state::{Phase, PoseState};
use stiction::RateProfile;
use tracking_error::{FRACTION_BITS, TrackingError};

/// 1 mm in the unit of [`TrackingError`].
const MM: i32 = 1 << FRACTION_BITS;
/// 1°, 2⁻³² turns.
const DEGREE: i32 = 11_930_465;
/// 2⁻³² turns.
const HALF_TURN: i64 = 1 << 31;
/// Largest heading error with forward output during the approach.
const HEADING_GATE: i32 = 30 * DEGREE;
/// The same during the final approach.
const FINAL_HEADING_GATE: i32 = 8 * DEGREE;
/// Distance at which the final approach begins.
const FINAL_APPROACH: i32 = 40 * MM;
/// Largest distance to a target that is approached in reverse.
const MAX_REVERSE: i32 = 1500 * MM;
/// Largest longitudinal error that the forward PID receives.
const MAX_ERROR: i32 = 10_000 * MM;
/// Largest speed at the end of the final approach, millimetres a tick.
const SLOW: I16F16 = I16F16::lit("0.2");
/// Ticks of the present speed that a braked wheel rolls on; the shorted motors' time constant is 40 ms.
const BRAKING_TICKS: i32 = 4;
/// Ticks at rest within the tolerances that make an arrival.
const SETTLING_TICKS: u8 = 5;
/// Smallest tolerances that the encoders resolve: 1 mm and 0.2°.
const MIN_POSITION_TOLERANCE: i32 = MM;
const MIN_HEADING_TOLERANCE: i32 = DEGREE / 5;
/// Largest output of each PID, percent; rotation has priority, forward gets the rest.
const FORWARD_LIMIT: I16F16 = I16F16::lit("100");
const ROTATION_LIMIT: I16F16 = I16F16::lit("50");

/// The pose controller.
#[derive(Clone, Debug)]
pub struct PoseController {
    forward: Pid,
    rotation: Pid,
    state: PoseState,
    mixer: Mixer,
    /// Unit of [`TrackingError`].
    position_tolerance: i32,
    /// 2⁻³² turns.
    heading_tolerance: i32,
    target: Pose,
    /// Pose of the last evaluation of the target.
    last_pose: Pose,
    /// Heading that [`Self::tune_move`] holds while active.
    tuning_heading: Option<Turns>,
    /// Distance at which the forward PID drives with 1 mm/s, 2⁻¹⁶ mm.
    distance_per_speed: i32,
    /// Range of the distance that the forward PID receives.
    allowed: (I16F16, I16F16),
    held_back: bool,
}

impl PoseController {
    /// Braked, without a target.
    pub fn new(config: &Config) -> Self {
        let heading_tolerance = (config.rotation_tolerance().0 as i32).max(MIN_HEADING_TOLERANCE);
        // Requirement: WIRE-platform-11
        let position_tolerance = ((config.position_tolerance().0 << FRACTION_BITS) / 1000) as i32;
        Self {
            forward: Pid::new(config.forward(), FORWARD_LIMIT),
            rotation: Pid::new(config.rotation(), ROTATION_LIMIT),
            state: PoseState::default(),
            mixer: Mixer::new(config),
            position_tolerance: position_tolerance.max(MIN_POSITION_TOLERANCE),
            heading_tolerance,
            target: Pose::default(),
            last_pose: Pose::default(),
            tuning_heading: None,
            distance_per_speed: distance_per_speed(config),
            allowed: (I16F16::MIN, I16F16::MAX),
            held_back: false,
        }
    }

    /// As after ticks towards `target` that left this state.
    #[must_use]
    pub const fn with_state(mut self, state: PoseState, target: Pose) -> Self {
        (self.state, self.target) = (state, target);
        self
    }

    /// What the last tick left.
    pub const fn state(&self) -> &PoseState {
        &self.state
    }

    /// The obstacle stop's limits from the next [`Self::drive`] on; without a call there are none.
    // Requirement: WIRE-obstacle-5
    pub fn limit_speed(&mut self, obstacle: &ObstacleLimit) {
        let distance = |speed: i32| {
            // mm/s, 2⁻⁶: 2³⁸ / 1000.
            let speed = upper(speed, 274_877_906);
            let bits = (i64::from(speed) * i64::from(self.distance_per_speed)) >> 6;
            I16F16::from_bits(bits.min(i32::MAX.into()) as i32)
        };
        let (back, ahead) = (obstacle.max_reverse(), obstacle.max_forward());
        self.allowed = (-distance(back), distance(ahead));
    }

    /// Whether the obstacle stop reduced the forward drive of the last tick.
    pub const fn held_back(&self) -> bool {
        self.held_back
    }

    /// Drives to `target` from now on. The same target again has no effect.
    pub fn set_target(&mut self, target: Pose) {
        if matches!(self.state.phase, Phase::Idle) {
            self.reset_pids();
        } else if target == self.target {
            return;
        }
        self.target = target;
        self.start();
    }

    /// Discards the target: brakes until the next one.
    pub fn halt(&mut self) {
        self.state.phase = Phase::Idle;
        self.tuning_heading = None;
        self.held_back = false;
        self.mixer.stop_learning();
    }

    /// Whether the robot holds the target's pose; false without a target.
    pub fn arrived(&self) -> bool {
        matches!(self.state.phase, Phase::Hold)
    }

    /// Whether there is a target that is not reached yet.
    pub fn moving(&self) -> bool {
        !matches!(self.state.phase, Phase::Idle | Phase::Hold)
    }

    fn start(&mut self) {
        self.state.widened = false;
        self.state.settled_ticks = 0;
        self.state.planned_turn = RateProfile::default();
        self.state.phase = Phase::FinalRotation;
    }

    fn reset_pids(&mut self) {
        self.forward.reset();
        self.rotation.reset();
    }

    /// One tick: `pose` and `delta` are the odometry's after this tick's counters.
    // Requirement: DOC-5.2.1-1, DOC-6.0.2-2
    #[must_use]
    pub fn drive(&mut self, pose: &Pose, delta: &Delta) -> MotorCommands {
        self.mixer.observe(delta);
        self.tuning_heading = None;
        self.held_back = false;
        let speed = self.state.speed.step(delta.travel);
        let turn_rate = self.state.turn_rate.step(degrees(delta.turn));
        if matches!(self.state.phase, Phase::Idle) || self.arrived() && *pose == self.last_pose {
            // With an unchanged pose the evaluation would not change.
            return self.mixer.brake();
        }
        self.last_pose = *pose;
        let error = TrackingError::new(pose, &self.target);
        let scale = 2 + i32::from(self.state.widened);
        let position_tolerance = (self.position_tolerance * scale) >> 1;
        let heading_tolerance = self.heading_tolerance.saturating_mul(scale) / 2;
        self.update_phase(&error, pose, delta, position_tolerance, heading_tolerance);
        let (distance, turn) = match self.state.phase {
            Phase::Idle | Phase::Hold => return self.mixer.brake(),
            Phase::Approach { reverse } => {
                let bearing = error.bearing(reverse);
                (gated(HEADING_GATE, bearing, error.longitudinal), bearing)
            }
            Phase::FinalApproach { heading } => {
                let turn = heading.from_nearest(pose.heading);
                (gated(FINAL_HEADING_GATE, turn, error.longitudinal), turn)
            }
            Phase::FinalRotation => {
                if error.stops_within(delta, position_tolerance, heading_tolerance / 4 * 3) {
                    return self.mixer.brake();
                }
                (error.longitudinal, error.heading)
            }
        };
        let moved = delta.left != 0 || delta.right != 0;
        let misaligned = turn.saturating_abs() > heading_tolerance / 2;
        let (wanted, turn) = (millimetres(distance), degrees(turn));
        let distance = wanted.max(self.allowed.0).min(self.allowed.1);
        if distance != wanted {
            self.held_back = true;
            self.forward.reset();
        }
        let boosted = matches!(self.state.phase, Phase::FinalApproach { .. }) && !self.held_back;
        let forward = self.forward.step(distance, speed)
            + self.state.forward_boost.step(distance, boosted, moved);
        let approaching = matches!(self.state.phase, Phase::Approach { .. });
        let aim = if approaching { I16F16::ZERO } else { turn };
        let planned = self.state.planned_turn.step(aim);
        let rotation = self.rotation.step(turn, turn_rate - planned)
            + self.state.rotation_boost.step(turn, misaligned, moved);
        self.mixer.mix(forward, rotation)
    }

    fn update_phase(
        &mut self,
        error: &TrackingError,
        pose: &Pose,
        delta: &Delta,
        position_tolerance: i32,
        heading_tolerance: i32,
    ) {
        match self.state.phase {
            Phase::Idle => {}
            Phase::Approach { reverse } => {
                if error.within(FINAL_APPROACH) {
                    self.state.phase = Self::final_approach(error, pose, reverse);
                }
            }
            Phase::FinalApproach { heading } => {
                let turn = heading.from_nearest(pose.heading).saturating_abs();
                let slow = delta.travel.saturating_abs() <= SLOW;
                let remaining = error.after_braking(delta).saturating_abs();
                let present = error.longitudinal.saturating_abs() >> 1;
                if turn < FINAL_HEADING_GATE
                    && slow
                    && remaining.max(present) <= position_tolerance >> 1
                {
                    self.forward.reset();
                    self.state.phase = Phase::FinalRotation;
                }
            }
            Phase::FinalRotation => {
                let resting = delta.left.saturating_abs() <= 1 && delta.right.saturating_abs() <= 1;
                let aligned = error.heading.saturating_abs() <= heading_tolerance;
                if !error.within(self.position_tolerance * 2) {
                    self.approach(error, pose);
                } else if aligned && resting {
                    self.state.settled_ticks += 1;
                    if self.state.settled_ticks >= SETTLING_TICKS {
                        if error.within(position_tolerance) {
                            self.state.phase = Phase::Hold;
                            self.reset_pids();
                        } else {
                            self.state.widened = true;
                            self.approach(error, pose);
                        }
                    }
                } else {
                    self.state.settled_ticks = 0;
                }
            }
            Phase::Hold => {
                let turned = error.heading.saturating_abs() > heading_tolerance / 5 * 8;
                let limit =
                    position_tolerance + (position_tolerance >> 1) + (position_tolerance >> 3);
                if turned || !error.within(limit) {
                    self.start();
                }
            }
        }
    }

    /// Chooses nose or tail first, the nose where no speed in reverse is allowed.
    fn approach(&mut self, error: &TrackingError, pose: &Pose) {
        self.state.settled_ticks = 0;
        // In reverse either turn is half a turn less the nose's: less in all where these sum to more.
        let nose = error.bearing(false);
        let turns = i64::from(nose).abs() + i64::from(error.heading.wrapping_sub(nose)).abs();
        let may_reverse = self.allowed.0 < I16F16::ZERO;
        let reverse = may_reverse && error.within(MAX_REVERSE) && turns > HALF_TURN;
        self.state.phase = if error.within(FINAL_APPROACH) {
            Self::final_approach(error, pose, reverse)
        } else {
            Phase::Approach { reverse }
        };
    }

    /// Holds the bearing of this moment.
    fn final_approach(error: &TrackingError, pose: &Pose, reverse: bool) -> Phase {
        let bearing = error.bearing(reverse) as u32;
        let heading = Turns(pose.heading.0.wrapping_add(bearing));
        Phase::FinalApproach { heading }
    }

    /// Rotation tuning (document, 5.2.2): `duty` on the right motor, its opposite on the left, no PID
    /// and no compensation. Zero brakes.
    // Requirement: DOC-5.2.2-1, WIRE-modes-3
    #[must_use]
    pub fn tune_rotate(&mut self, duty: Duty) -> MotorCommands {
        self.halt();
        if duty == Duty::ZERO {
            return self.mixer.brake();
        }
        let duty = i32::from(duty.hundredths());
        self.mixer.raw(-duty, duty)
    }

    /// Movement tuning (document, 5.2.3): `duty` on both motors, and the rotation PID holds the
    /// heading at which it began. Zero brakes and discards the heading.
    // Requirement: DOC-5.2.3-1, WIRE-modes-4
    #[must_use]
    pub fn tune_move(&mut self, duty: Duty, pose: &Pose, delta: &Delta) -> MotorCommands {
        self.state.phase = Phase::Idle;
        if duty == Duty::ZERO {
            self.tuning_heading = None;
            return self.mixer.brake();
        }
        if self.tuning_heading.is_none() {
            self.rotation.reset();
        }
        let heading = *self.tuning_heading.get_or_insert(pose.heading);
        let error = degrees(heading.from_nearest(pose.heading));
        let turn_rate = self.state.turn_rate.step(degrees(delta.turn));
        let rotation = self.rotation.step(error, turn_rate);
        let rotation = (rotation.to_bits() * 25) >> 14;
        let duty = i32::from(duty.hundredths());
        self.mixer.raw(duty - rotation, duty + rotation)
    }
}

/// The distance at which the forward PID holds 1 mm/s, rather less, 2⁻¹⁶ mm: P of it is D of the speed
/// and half of what the stronger motor needs for it.
fn distance_per_speed(config: &Config) -> i32 {
    let gains = config.forward();
    let need = half_need(config.left()).min(half_need(config.right()));
    let damping = gains.d.value().to_bits().unsigned_abs() + need;
    // A hundredth of a tick's way, 2⁻¹⁶.
    let p = gains.p.value().to_bits().unsigned_abs() * 100;
    div_rem(damping << 16, p).0.min(1 << 24) as i32
}

/// Half the duty that a wheel needs for 1 mm a tick, 2⁻³² %.
#[inline(never)]
fn half_need(wheel: &Wheel) -> u64 {
    let full_duty = 10_000 - u64::from(wheel.dead_zone.hundredths().unsigned_abs());
    div_rem(full_duty << 31, wheel.full_speed_mm_s.into()).0
}

/// `distance`, cut to ±[`MAX_ERROR`], times 1 − |`heading_error`| / `gate`; 0 beyond the gate.
// One copy in flash.
#[inline(never)]
fn gated(gate: i32, heading_error: i32, distance: i32) -> i32 {
    // Both below 2¹⁶, so the quotient of one 32-bit division is the factor in Q16.
    let open = ((gate - heading_error.saturating_abs()).max(0) >> 13) as u32;
    let factor = ((open << 16) / (gate >> 13).max(1) as u32) as i32;
    ((i64::from(distance.clamp(-MAX_ERROR, MAX_ERROR)) * i64::from(factor)) >> 16) as i32
}

fn millimetres(distance: i32) -> I16F16 {
    I16F16::from_bits(distance.clamp(-MAX_ERROR, MAX_ERROR) << (16 - FRACTION_BITS))
}

fn degrees(turns: i32) -> I16F16 {
    I16F16::from_bits(((i64::from(turns) * 360) >> 16) as i32)
}

#[cfg(test)]
mod tests;
