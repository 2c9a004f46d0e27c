//! From the pose and the target to the motors: turn towards it, drive, turn to the final rotation,
//! hold.
//!
//! - **Approach.** The rotation PID turns the nose to the target, the forward PID drives; forward
//!   begins once the nose is within 30° and grows as it comes round, so the robot does not stop
//!   between turning and driving. Backwards where that means less turning, but not farther than
//!   1.5 m: the rangefinders look ahead and to the sides.
//! - **Close.** From 40 mm on the bearing is not followed any more, it would swing round: the robot
//!   keeps the bearing as it was there, and drives along it, either way; with the nose within 8° of
//!   it. Done when that is so, slower than 20 mm/s and about to stop within half the tolerance.
//! - **Final.** The rotation PID turns to the target's rotation, the forward PID holds the place. Both
//!   motors brake as soon as the robot would come to rest within the tolerance of the place and
//!   three quarters of the rotation's. Farther off than twice its tolerance it drives there anew.
//! - **Hold.** Within both tolerances and at rest for 50 ms: both motors brake. A push beyond 1⅝
//!   times the tolerance of the place, or 1⅗ times the rotation's, starts again. A try that ends
//!   outside the tolerances widens them by a half, once, so that a robot that cannot do better does
//!   not hunt for ever.
//!
//! From 40 mm on the rotation PID's derivative counts from a planned turn, not from rest: what it
//! opposes is turning faster or slower than planned. Gains that are heavily damped, as the first
//! board's are, would else creep through the last 20° for two seconds.

mod stiction;
mod tracking_error;

use fixed::types::I16F16;

use super::mixer::Mixer;
use super::pid::Pid;
use crate::eeprom::Config;
use crate::types::{Delta, Duty, MotorCommands, Pose, Turns};
use stiction::{Nudge, Plan, Rate};
use tracking_error::{View, UNIT};

/// 1 mm as the view measures it.
const MM: i32 = 1 << UNIT;
/// 1°, 2⁻³² turns.
const DEGREE: i32 = 11_930_465;
/// 2⁻³² turns.
const HALF_TURN: i64 = 1 << 31;
/// Bearing within which driving begins.
const CONE: i32 = 30 * DEGREE;
/// The same on the last bit.
const NARROW: i32 = 8 * DEGREE;
/// Distance from which on the heading stands still.
const CLOSE: i32 = 40 * MM;
/// Distance up to which the robot may back into its target.
const BACK: i32 = 1500 * MM;
/// What counts as slow, millimetres a tick.
const SLOW: I16F16 = I16F16::lit("0.2");
/// Ticks of the present speed that a braked wheel still rolls; the shorted motors' lag is 40 ms.
const BRAKING: i32 = 4;
/// Ticks within the tolerances and at rest that make an arrival.
const SETTLED: u8 = 5;
/// Smallest tolerances that the encoders can tell: 1 mm and 0.2°.
const FINEST_POSITION: i32 = MM;
const FINEST_ROTATION: i32 = DEGREE / 5;
/// Largest output of each PID, percent. The first board's were ±50 each because it added them; here
/// rotation goes first and forward takes what is left of the wheels' reach.
const FORWARD_LIMIT: I16F16 = I16F16::lit("100");
const ROTATION_LIMIT: I16F16 = I16F16::lit("50");

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// No target: braked.
    Idle,
    /// To the target, nose first or `backwards`.
    Approach { backwards: bool },
    /// The last bit, heading kept.
    Close { heading: Turns },
    /// On the spot to the final rotation.
    Final,
    /// There: braked.
    Hold,
}

/// The pose controller.
#[derive(Clone, Debug)]
pub struct PoseController {
    forward: Pid,
    rotation: Pid,
    speed: Rate,
    spin: Rate,
    turning: Plan,
    ahead: Nudge,
    around: Nudge,
    mixer: Mixer,
    /// [`UNIT`]s.
    position_tolerance: i32,
    /// 2⁻³² turns.
    rotation_tolerance: i32,
    target: Pose,
    /// Where the robot was when it last looked at the target.
    seen: Pose,
    phase: Phase,
    tries: u8,
    settled: u8,
    /// The angle that [`Self::tune_move`] holds, while it does.
    held: Option<Turns>,
}

impl PoseController {
    /// Braked, without a target.
    #[must_use]
    pub fn new(config: &Config) -> Self {
        let platform = &config.platform;
        let rotation_tolerance =
            (i32::from(platform.rotation_tolerance.min(0x2000)) << 16).max(FINEST_ROTATION);
        // Requirement: WIRE-platform-11
        let position_tolerance = (i32::from(platform.position_tolerance) << UNIT) / 1000;
        Self {
            forward: Pid::new(&config.forward, FORWARD_LIMIT),
            rotation: Pid::new(&config.rotation, ROTATION_LIMIT),
            speed: Rate::default(),
            spin: Rate::default(),
            turning: Plan::default(),
            ahead: Nudge::default(),
            around: Nudge::default(),
            mixer: Mixer::new(platform),
            position_tolerance: position_tolerance.max(FINEST_POSITION),
            rotation_tolerance,
            target: Pose::default(),
            seen: Pose::default(),
            phase: Phase::Idle,
            tries: 0,
            settled: 0,
            held: None,
        }
    }

    /// Drive to `target` from now on. The same target again changes nothing.
    pub fn set_target(&mut self, target: Pose) {
        if self.phase == Phase::Idle {
            self.forward.reset();
            self.rotation.reset();
        } else if target == self.target {
            return;
        }
        self.target = target;
        self.start();
    }

    /// Forget the target: brake until the next one.
    pub fn halt(&mut self) {
        self.phase = Phase::Idle;
        self.held = None;
        self.mixer.stand();
    }

    /// Whether the robot is where it should be and holds there; false without a target.
    #[must_use]
    pub fn arrived(&self) -> bool {
        self.phase == Phase::Hold
    }

    /// Whether there is a target that the robot is not at yet.
    #[must_use]
    pub fn moving(&self) -> bool {
        !matches!(self.phase, Phase::Idle | Phase::Hold)
    }

    fn start(&mut self) {
        self.tries = 0;
        self.settled = 0;
        self.turning = Plan::default();
        self.phase = Phase::Final;
    }

    /// One tick: `pose` and `delta` are the odometry's after this tick's counters.
    // Requirement: DOC-5.2.1-1, DOC-6.0.2-2
    #[must_use]
    pub fn drive(&mut self, pose: &Pose, delta: &Delta) -> MotorCommands {
        self.mixer.observe(delta);
        self.held = None;
        let speed = self.speed.step(delta.travel);
        let spin = self.spin.step(degrees(delta.turn));
        if self.phase == Phase::Idle {
            return self.mixer.brake();
        }
        if self.phase == Phase::Hold && *pose == self.seen {
            // Seen from the same place as in the last tick the target asks for the same.
            return self.mixer.brake();
        }
        self.seen = *pose;
        let view = View::new(pose, &self.target);
        let slack = 2 + i32::from(self.tries);
        let near = (self.position_tolerance * slack) >> 1;
        let straight = self.rotation_tolerance.saturating_mul(slack) / 2;
        self.advance(&view, pose, delta, near, straight);
        if self.phase == Phase::Final && view.stops(delta, near, straight / 4 * 3) {
            return self.mixer.brake();
        }
        let (ahead, turn) = match self.phase {
            Phase::Idle | Phase::Hold => return self.mixer.brake(),
            Phase::Approach { backwards } => {
                let bearing = view.bearing(backwards);
                (through(CONE, bearing, view.along), bearing)
            }
            Phase::Close { heading } => {
                let turn = heading.from_nearest(pose.heading);
                (through(NARROW, turn, view.along), turn)
            }
            Phase::Final => (view.along, view.rotation),
        };
        let moved = delta.left != 0 || delta.right != 0;
        let off = turn.saturating_abs() > straight / 2;
        let (ahead, turn) = (millimetres(ahead), degrees(turn));
        let short = matches!(self.phase, Phase::Close { .. });
        let forward = self.forward.step(ahead, speed) + self.ahead.step(ahead, short, moved);
        let far = matches!(self.phase, Phase::Approach { .. });
        let planned = self.turning.step(if far { I16F16::ZERO } else { turn });
        let rotation =
            self.rotation.step(turn, spin - planned) + self.around.step(turn, off, moved);
        self.mixer.mix(forward, rotation)
    }

    /// Which phase this tick is in.
    fn advance(&mut self, view: &View, pose: &Pose, delta: &Delta, near: i32, straight: i32) {
        let resting = delta.left.saturating_abs() <= 1 && delta.right.saturating_abs() <= 1;
        let aligned = view.rotation.saturating_abs() <= straight;
        match self.phase {
            Phase::Idle => {}
            Phase::Approach { backwards } => {
                if view.within(CLOSE) {
                    self.phase = Self::close(view, pose, backwards);
                }
            }
            Phase::Close { heading } => {
                let aimed = heading.from_nearest(pose.heading).saturating_abs() < NARROW;
                let slow = delta.travel.saturating_abs() <= SLOW;
                let there = view
                    .left_ahead(delta)
                    .saturating_abs()
                    .max(view.along.saturating_abs() >> 1)
                    <= near >> 1;
                if aimed && slow && there {
                    self.forward.reset();
                    self.phase = Phase::Final;
                }
            }
            Phase::Final => {
                if !view.within(self.position_tolerance * 2) {
                    self.approach(view, pose);
                } else if aligned && resting {
                    self.settled += 1;
                    if self.settled >= SETTLED {
                        self.settled = 0;
                        if view.within(near) {
                            self.phase = Phase::Hold;
                            self.forward.reset();
                            self.rotation.reset();
                        } else {
                            self.tries = 1;
                            self.approach(view, pose);
                        }
                    }
                } else {
                    self.settled = 0;
                }
            }
            Phase::Hold => {
                let turned = view.rotation.saturating_abs() > straight / 5 * 8;
                if turned || !view.within(near + (near >> 1) + (near >> 3)) {
                    self.start();
                }
            }
        }
    }

    /// Chooses the way to go.
    fn approach(&mut self, view: &View, pose: &Pose) {
        // Tail first either turn is what the nose's lacks to half a turn: less together, where these
        // come to more than that.
        let nose = view.bearing(false);
        let turns = i64::from(nose).abs() + i64::from(view.rotation.wrapping_sub(nose)).abs();
        let backwards = view.within(BACK) && turns > HALF_TURN;
        self.phase = if view.within(CLOSE) {
            Self::close(view, pose, backwards)
        } else {
            Phase::Approach { backwards }
        };
    }

    /// The last bit: the bearing as it is now, for good.
    fn close(view: &View, pose: &Pose, backwards: bool) -> Phase {
        let bearing = view.bearing(backwards) as u32;
        Phase::Close {
            heading: Turns(pose.heading.0.wrapping_add(bearing)),
        }
    }

    /// Tuning the rotation (document, 5.2.2): `duty` on the right motor, its opposite on the left,
    /// no PID and no compensation. Zero brakes.
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

    /// Tuning the movement (document, 5.2.3): `duty` on both motors, and the rotation PID holds the
    /// angle at which this began. Zero brakes and forgets the angle.
    // Requirement: DOC-5.2.3-1, WIRE-modes-4
    #[must_use]
    pub fn tune_move(&mut self, duty: Duty, pose: &Pose, delta: &Delta) -> MotorCommands {
        self.phase = Phase::Idle;
        if duty == Duty::ZERO {
            self.held = None;
            return self.mixer.brake();
        }
        if self.held.is_none() {
            self.rotation.reset();
        }
        let held = *self.held.get_or_insert(pose.heading);
        let error = degrees(held.from_nearest(pose.heading));
        let spin = self.spin.step(degrees(delta.turn));
        let rotation = self.rotation.step(error, spin);
        let rotation = (rotation.to_bits() * 25) >> 14;
        let duty = i32::from(duty.hundredths());
        self.mixer.raw(duty - rotation, duty + rotation)
    }

    /// What the mixer learned of the wheels.
    #[must_use]
    pub const fn mixer(&self) -> &Mixer {
        &self.mixer
    }
}

/// How much of `along` to drive with the nose `off` by so much: all at 0, nothing from `cone` on.
fn through(cone: i32, off: i32, along: i32) -> i32 {
    // Both below 2¹⁶, so the quotient of one 32-bit division is the share in Q16.
    let open = ((cone - off.saturating_abs()).max(0) >> 13) as u32;
    let whole = (cone >> 13).max(1) as u32;
    let share = ((open << 16) / whole) as i32;
    ((i64::from(along.clamp(-FAR, FAR)) * i64::from(share)) >> 16) as i32
}

/// Further than this is as far.
const FAR: i32 = 10_000 * MM;

fn millimetres(value: i32) -> I16F16 {
    I16F16::from_bits(value.clamp(-FAR, FAR) << (16 - UNIT))
}

fn degrees(turns: i32) -> I16F16 {
    I16F16::from_bits(((i64::from(turns) * 360) >> 16) as i32)
}

#[cfg(test)]
mod tests;
