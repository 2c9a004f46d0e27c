//! Velocity controller: from a forward speed and a yaw rate to the motor commands.
//!
//! 1. The command is cut to the configured limits, followed with the configured accelerations, and cut
//!    to what the obstacle stop allows, which no acceleration delays.
//! 2. Each wheel follows its share by feed-forward and PI. The feed-forward inverts the motor, two lags
//!    of 160 ms, for a response of two lags of 80 ms; the PI corrects the deviation from that response.
//!    Its gains are the forward PID's: percent per millimetre of lag is the integral gain of a speed,
//!    percent per millimetre a sample its proportional one. What the integral learns of friction and
//!    gain changes its sign with the direction.
//! 3. Where a wheel saturates, both are slowed by what does not fit: forward is reduced and the yaw rate
//!    kept, as long as less forward speed helps the wheel. The followed velocity is reduced with it, so
//!    that nothing winds up.
//!
//! Zero is braked once the wheels are about to stand; every integral then starts at zero.

use fixed::types::I16F16;

use super::mixer::Mixer;
use super::obstacle_limit::ObstacleLimit;
use super::pid::Pid;
use super::pose_controller::stiction::LowPass;
use super::trig::upper;
use crate::divide::div_rem;
use crate::eeprom::{self, Config, Gain, Gains, VelocityLimits};
use crate::types::{Delta, MotorCommands, Velocity};

/// Ticks per second.
const TICKS: u32 = 100;
/// µm/s in 2⁻¹⁶ mm a tick, Q32 of 2⁻¹: 2¹⁶ / 10⁵.
const PER_MICROMETRE: i32 = 1_407_374_884;
/// π, Q29.
const PI: u64 = 1_686_629_713;
/// The response's two lags: 2³ ticks each.
const LAG_SHIFT: u32 = 3;
/// Largest output of a wheel's PI, percent.
const PI_LIMIT: I16F16 = I16F16::lit("100");
/// Largest output of a wheel's feed-forward and PI, 2⁻¹⁶ %: twice full duty, and any sum of them fits.
const MAX_OUTPUT: i64 = 200 << 16;
/// Largest speed that a saturated wheel is slowed by, 2⁻¹⁶ mm a tick: 100 m/s.
const MAX_EXCESS: i64 = 1 << 26;
/// Speed below which a wheel that is to stand is braked, 2⁻¹⁶ mm a tick: 10 mm/s.
const SLOW: i32 = (1 << 16) / 10;

/// Feed-forward and PI of one wheel.
#[derive(Clone, Debug)]
struct WheelSpeed {
    pi: Pid,
    /// Largest output, 2⁻¹⁶ %.
    headroom: i32,
    /// Output per speed, % per mm a tick, and its inverse, Q16.
    feed_forward: i32,
    speed_per_output: i32,
    /// The required speed behind one and two lags, 2⁻¹⁶ mm a tick.
    lag: [i32; 2],
    deviation: LowPass,
    backward: bool,
}

impl WheelSpeed {
    // Start-up only: one copy in flash.
    #[inline(never)]
    fn new(wheel: &eeprom::Wheel, gains: &Gains) -> Self {
        let dead_zone = i32::from(wheel.dead_zone.hundredths());
        // Hundredths of a percent per mm/s are percent per mm a tick.
        let (full_duty, full_speed) = (10_000 - dead_zone, i32::from(wheel.full_speed_mm_s));
        Self {
            pi: Pid::new(gains, PI_LIMIT).integrating_all(),
            headroom: (i32::from(wheel.limit.hundredths()) - dead_zone) * (1 << 16) / 100,
            feed_forward: (full_duty << 16) / full_speed.max(1),
            speed_per_output: (full_speed << 16) / full_duty.max(1),
            lag: [0; 2],
            deviation: LowPass::default(),
            backward: false,
        }
    }

    /// Output, 2⁻¹⁶ %, for a required and a measured speed, 2⁻¹⁶ mm a tick, within ±2²⁶ and any.
    #[inline(never)]
    fn step(&mut self, required: i32, measured: i32) -> i32 {
        let [first, second] = &mut self.lag;
        let drive = 4 * (required - *first) + *second;
        *first += (required - *first) >> LAG_SHIFT;
        *second += (*first - *second) >> LAG_SHIFT;
        let deviation = second.saturating_sub(measured);
        let deviation = self.deviation.step(I16F16::from_bits(deviation));
        if required != 0 {
            self.backward = required < 0;
        }
        let correction = if self.backward {
            -self.pi.step(-deviation, I16F16::ZERO)
        } else {
            self.pi.step(deviation, I16F16::ZERO)
        };
        let output = (i64::from(drive) * i64::from(self.feed_forward)) >> 16;
        (output + i64::from(correction.to_bits())).clamp(-MAX_OUTPUT, MAX_OUTPUT) as i32
    }

    /// Speed that does not fit into the duty, 2⁻¹⁶ mm a tick.
    // Requirement: WIRE-velocity-5
    #[inline(never)]
    fn excess(&self, output: i32) -> i32 {
        let excess = output - output.max(-self.headroom).min(self.headroom);
        let excess = (i64::from(excess) * i64::from(self.speed_per_output)) >> 16;
        excess.clamp(-MAX_EXCESS, MAX_EXCESS) as i32
    }

    /// An output for a speed that is lower by `excess`.
    #[inline(never)]
    fn slowed(&self, output: i32, excess: i32) -> i32 {
        let less = (i64::from(excess) * i64::from(self.feed_forward)) >> 16;
        output.saturating_sub(less.clamp(-2 * MAX_OUTPUT, 2 * MAX_OUTPUT) as i32)
    }

    fn is_slow(&self) -> bool {
        self.lag[1].abs() < SLOW
    }

    #[inline(never)]
    fn reset(&mut self) {
        self.pi.reset();
        self.lag = [0; 2];
        self.deviation = LowPass::default();
    }
}

/// Limits of a commanded velocity and of its change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VelocityRamp {
    /// µm/s, not negative.
    pub max_speed: i32,
    /// 2⁻³² turns/s, not negative.
    pub max_yaw_rate: i32,
    /// Change a tick, µm/s, not negative.
    pub speed_step: i32,
    /// Change a tick, 2⁻³² turns/s, not negative.
    pub yaw_step: i32,
}

/// One tick of a [`VelocityRamp`].
#[derive(Clone, Copy, Debug)]
pub struct Followed {
    /// The command within the limits of speed and yaw rate.
    pub target: Velocity,
    /// The target's forward speed within the obstacle stop's limit.
    pub free: i32,
    /// Nearer to it by a tick's change.
    pub velocity: Velocity,
    /// A limit of speed, yaw rate or acceleration reduced the command.
    pub clipped: bool,
}

impl VelocityRamp {
    /// Of the configured limits.
    // Requirement: WIRE-velocity-3
    pub fn new(limits: &VelocityLimits) -> Self {
        Self {
            max_speed: i32::from(limits.speed_mm_s) * 1000,
            max_yaw_rate: limits.yaw_rate.min(i32::MAX as u32) as i32,
            speed_step: i32::from(limits.acceleration_mm_s2) * 10,
            yaw_step: (limits.yaw_acceleration / TICKS) as i32,
        }
    }

    /// From `before` one tick towards `commanded`.
    // Requirement: WIRE-velocity-3, WIRE-velocity-6, WIRE-obstacle-1
    #[allow(clippy::inline_always, reason = "a part of the controller's step")]
    #[inline(always)]
    pub fn step(
        &self,
        before: Velocity,
        commanded: Velocity,
        obstacle: &ObstacleLimit,
    ) -> Followed {
        let speed = commanded.forward.max(-self.max_speed).min(self.max_speed);
        let yaw_rate = commanded
            .yaw_rate
            .max(-self.max_yaw_rate)
            .min(self.max_yaw_rate);
        let free = obstacle.limit(speed);
        let forward = obstacle.limit(towards(before.forward, free, self.speed_step));
        let turning = towards(before.yaw_rate, yaw_rate, self.yaw_step);
        Followed {
            target: Velocity {
                forward: speed,
                yaw_rate,
            },
            free,
            velocity: Velocity {
                forward,
                yaw_rate: turning,
            },
            clipped: speed != commanded.forward || forward != free || turning != commanded.yaw_rate,
        }
    }
}

/// What a tick leaves to the next one, besides the PIs and the mixer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct VelocityState {
    /// The velocity that the wheels follow, within all limits.
    pub applied: Velocity,
    /// The left and the right wheel's required speed behind one and two lags, 2⁻¹⁶ mm a tick.
    pub lags: [[i32; 2]; 2],
    /// Their speeds' deviations from it, millimetres a tick.
    pub deviations: [LowPass; 2],
    /// They were last to run backwards.
    pub backward: [bool; 2],
}

/// The velocity controller.
#[derive(Clone, Debug)]
pub struct VelocityController {
    ramp: VelocityRamp,
    /// Half the difference of the wheels' ways per turn of the robot, 2⁻¹⁶ mm.
    half_track_turn: i32,
    /// Quarter of the yaw rate that a wheel's speed makes, 2⁻³² turns/s per 2⁻¹⁶ mm a tick.
    yaw_per_speed: i32,
    left: WheelSpeed,
    right: WheelSpeed,
    mixer: Mixer,
    /// The velocity that the wheels follow, within all limits.
    applied: Velocity,
    clipped: bool,
    held_back: bool,
}

impl VelocityController {
    /// At rest.
    pub fn new(config: &Config) -> Self {
        let forward = config.forward();
        let half = |gain: Gain| Gain::new(gain.value() >> 1_u32).unwrap_or_default();
        let gains = Gains {
            p: half(forward.d),
            i: half(forward.p),
            d: Gain::default(),
            anti_windup: forward.anti_windup,
        };
        let left = WheelSpeed::new(config.left(), &gains);
        let right = WheelSpeed::new(config.right(), &gains);
        let half_track_turn = (div_rem(u64::from(config.track().0) * PI, 1000).0 >> 13) as i32;
        Self {
            ramp: VelocityRamp::new(config.velocity_limits()),
            half_track_turn,
            yaw_per_speed: div_rem(
                u64::from(TICKS / 4) << 32,
                half_track_turn.unsigned_abs().into(),
            )
            .0 as i32,
            left,
            right,
            mixer: Mixer::new(config),
            applied: Velocity::default(),
            clipped: false,
            held_back: false,
        }
    }

    /// One tick towards `commanded`, after [`ObstacleLimit::step`]; `delta` is the motion since the last.
    // Requirement: WIRE-velocity-4, WIRE-velocity-6
    #[must_use]
    pub fn step(
        &mut self,
        commanded: Velocity,
        obstacle: &ObstacleLimit,
        delta: &Delta,
    ) -> MotorCommands {
        let before = self.applied.forward;
        let Followed {
            target,
            free,
            velocity,
            clipped,
        } = self.ramp.step(self.applied, commanded, obstacle);
        let Velocity {
            forward: speed,
            yaw_rate,
        } = target;
        let Velocity {
            forward,
            yaw_rate: turning,
        } = velocity;
        self.held_back = free != speed;
        self.clipped = clipped;
        self.applied = velocity;
        // Slowed by the obstacle stop, the wheels follow with one of the two lags.
        let slowing = (forward - before).min(0);
        let driven = if free < speed && forward > 0 {
            (forward + (slowing << LAG_SHIFT)).max(0)
        } else {
            forward
        };
        let still = (forward | free | turning | yaw_rate) == 0;
        if still && self.left.is_slow() && self.right.is_slow() {
            self.left.reset();
            self.right.reset();
            return MotorCommands::BRAKE;
        }
        // 2⁻¹⁶ mm a tick; at most 20 mm and 32 mm.
        let driven = upper(driven << 1, PER_MICROMETRE);
        let rotation = upper(turning, self.half_track_turn) / TICKS as i32;
        let (travel, turn) = (
            delta.travel.to_bits(),
            upper(delta.turn, self.half_track_turn),
        );
        let left = self
            .left
            .step(driven - rotation, travel.saturating_sub(turn));
        let right = self
            .right
            .step(driven + rotation, travel.saturating_add(turn));
        let excess = larger(self.left.excess(left), self.right.excess(right));
        if excess == 0 {
            return self.mixer.each(left, right);
        }
        self.clipped = true;
        // The feed-forward is four times a change of the required speed.
        if (excess > 0) == (forward > 0) && forward != 0 {
            let less = (i64::from(excess.abs()) * 25_000) >> 16;
            let Velocity { forward, .. } = &mut self.applied;
            *forward = towards(*forward, 0, less as i32);
            let (left, right) = (
                self.left.slowed(left, excess),
                self.right.slowed(right, excess),
            );
            self.mixer.each(left, right)
        } else {
            let less = i64::from(excess.abs()) * i64::from(self.yaw_per_speed);
            let Velocity { yaw_rate, .. } = &mut self.applied;
            *yaw_rate = towards(*yaw_rate, 0, less.min(i32::MAX.into()) as i32);
            self.mixer.each(left, right)
        }
    }

    /// Not driven by [`Self::step`] any more: it starts from rest next time.
    pub fn stand(&mut self) {
        self.left.reset();
        self.right.reset();
        self.applied = Velocity::default();
        (self.clipped, self.held_back) = (false, false);
    }

    /// The velocity that the wheels follow, within all limits.
    pub const fn applied(&self) -> Velocity {
        self.applied
    }

    /// As after ticks that left this state.
    #[must_use]
    pub const fn with_state(mut self, state: VelocityState) -> Self {
        self.applied = state.applied;
        [self.left.lag, self.right.lag] = state.lags;
        [self.left.deviation, self.right.deviation] = state.deviations;
        [self.left.backward, self.right.backward] = state.backward;
        self
    }

    /// What the last tick left.
    pub const fn state(&self) -> VelocityState {
        let (left, right) = (&self.left, &self.right);
        VelocityState {
            applied: self.applied,
            lags: [left.lag, right.lag],
            deviations: [left.deviation, right.deviation],
            backward: [left.backward, right.backward],
        }
    }

    /// Whether the obstacle stop reduced the last command.
    #[must_use]
    pub const fn held_back(&self) -> bool {
        self.held_back
    }

    /// Whether a limit of speed, yaw rate, acceleration or duty reduced the last command.
    pub const fn clipped(&self) -> bool {
        self.clipped
    }
}

/// The one of larger size.
const fn larger(a: i32, b: i32) -> i32 {
    if a.unsigned_abs() > b.unsigned_abs() {
        a
    } else {
        b
    }
}

/// `from` one `step`, not negative, towards `to`.
// Requirement: WIRE-velocity-5
#[inline(never)]
pub fn towards(from: i32, to: i32, step: i32) -> i32 {
    from.saturating_add(to.saturating_sub(from).max(-step).min(step))
}

#[cfg(test)]
mod tests;
