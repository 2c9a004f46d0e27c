//! T17, every order of poses, targets, stops and tuning: the phases of the core's own pose controller.
//!
//! Domain: two targets; every tick any of the [`POSES`] around them, rolling or at rest, whatever the motors did.
//! A state is the phase and what decides on it, and whether an integral is not zero: its value, filters and
//! identified gains decide on no phase.
//!
//! `cargo test -p proofs --test phases_model -- --nocapture` shows the way to each broken invariant.

mod common;

use common::ByText;
use fixed::types::{I16F16, I32F32};
use fw_core::motion::PoseController;
use fw_core::motion::pose_controller::{state::Phase, stiction::RateProfile};
use fw_core::types::{Delta, Duty, Millimetres, MotorCommand, MotorCommands, Pose, Turns};
use proofs::eeprom::accepted::AcceptedConfig;
use proofs::search::{Model, assert_broken, assert_holds};

/// Millimetres ahead and eighths of a turn: at, beside, near and far from the first of them; the tolerances are
/// 3 mm and 0.5°, and half as much again once they are widened.
const POSES: [(i32, u32); 9] = [
    (0, 0),
    (0, 2),
    (4, 0),
    (20, 0),
    (20, 4),
    (500, 0),
    (500, 2),
    (504, 0),
    (2, 0),
];
/// The poses that are targets.
const TARGETS: [usize; 2] = [0, 5];
/// Ticks at rest that make an arrival.
const SETTLING: u8 = 5;

fn pose(which: usize) -> Pose {
    let (x, eighths) = POSES[which];
    Pose {
        x: Millimetres(I32F32::from_num(x)),
        heading: Turns(eighths << 29),
        ..Pose::default()
    }
}

#[derive(Clone, Copy, Debug)]
enum Event {
    /// A tick at a pose, and whether the robot rolls.
    Drive(usize, bool),
    Target(usize),
    Halt,
    /// A tick of tuning the rotation or the movement, with a duty or none.
    Tune(bool, bool),
}

/// The caller, right or broken on purpose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Caller {
    Right,
    /// Does not stop.
    Deaf,
    /// Keeps the first target.
    Stubborn,
    /// Reports a rolling robot as one at rest.
    Numb,
    /// Reports the target's heading.
    Blind,
}

/// What must be.
#[derive(Clone, Copy, Debug)]
struct Facts {
    target: Option<usize>,
    /// The pose that was looked at last.
    last: usize,
    /// Ticks at rest beside the target with its heading.
    still: u8,
}

type State = ByText<(PoseController, Facts)>;

fn known(controller: PoseController, facts: Facts) -> State {
    let state = controller.state();
    let integrates = pids(&controller) != pids(&fresh());
    let (phase, widened, settled) = (state.phase, state.widened, state.settled_ticks);
    let text = format!("{phase:?} {widened} {settled} {integrates} {facts:?}");
    ByText {
        value: (controller, facts),
        text,
    }
}

/// The PIDs' part of a controller's text.
fn pids(controller: &PoseController) -> String {
    let text = format!("{controller:?}");
    text.split(", state: ")
        .next()
        .unwrap_or_default()
        .to_owned()
}

fn fresh() -> PoseController {
    PoseController::new(
        &AcceptedConfig::FIRST_BOARD
            .config()
            .expect("it is accepted"),
    )
}

/// Whether a tick may lead from a phase to another.
fn follows(before: Phase, after: Phase) -> bool {
    use Phase::{Approach, FinalApproach, FinalRotation, Hold, Idle};
    match (before, after) {
        (Idle, Idle) | (Hold, Hold | FinalRotation) | (FinalRotation, _) => after != Idle,
        (Approach { reverse: was }, Approach { reverse: is }) => was == is,
        (FinalApproach { heading: was }, FinalApproach { heading: is }) => was == is,
        (Approach { .. }, FinalApproach { .. }) | (FinalApproach { .. }, FinalRotation) => true,
        _ => false,
    }
}

impl Caller {
    fn drive(
        self,
        controller: &mut PoseController,
        facts: &mut Facts,
        at: usize,
        rolls: bool,
    ) -> Result<(), String> {
        let before = *controller.state();
        let mut seen = pose(at);
        if self == Self::Blind {
            seen.heading = pose(TARGETS[0]).heading;
        }
        let mut delta = Delta::default();
        if rolls && self != Self::Numb {
            delta = Delta::rolled(5, 5);
            delta.travel = I16F16::ONE / 2;
        }
        let commands = controller.drive(&seen, &delta);
        let after = controller.state().phase;
        let brakes = commands == MotorCommands::BRAKE;
        let runs = |command| matches!(command, MotorCommand::Run(_));
        if !(brakes || runs(commands.left) && runs(commands.right)) {
            return Err(format!("{commands:?}: one brakes and one runs"));
        }
        let Some(target) = facts.target else {
            return if brakes && after == Phase::Idle {
                Ok(())
            } else {
                Err("it turns without a target".into())
            };
        };
        let (x, heading) = POSES[at];
        let apart = (x - POSES[target].0).abs();
        let beside = apart < 6 && heading == POSES[target].1;
        facts.still = if beside && !rolls {
            (facts.still + 1).min(SETTLING)
        } else {
            0
        };
        if before.phase != Phase::Hold || at != facts.last {
            facts.last = at;
        }
        if !follows(before.phase, after) {
            return Err(format!("{after:?} after {:?}", before.phase));
        }
        if after != Phase::Hold {
            return Ok(());
        }
        let arrives = before.phase != Phase::Hold;
        if arrives && (facts.still < SETTLING || apart > 3 && !before.widened) {
            return Err("it holds another pose than its target's, or not at rest".into());
        }
        if !brakes || !controller.arrived() || controller.moving() {
            return Err("it holds and does not brake".into());
        }
        Ok(())
    }
}

impl Model for Caller {
    type State = State;
    type Event = Event;

    fn starts(&self) -> Vec<State> {
        let facts = Facts {
            target: None,
            last: 0,
            still: 0,
        };
        vec![known(fresh(), facts)]
    }

    fn events(&self, _: &State) -> Vec<Event> {
        let mut events = vec![Event::Halt];
        events.extend(TARGETS.map(Event::Target));
        for flag in [false, true] {
            events.extend((0..POSES.len()).map(|at| Event::Drive(at, flag)));
            events.extend([false, true].map(|duty| Event::Tune(flag, duty)));
        }
        events
    }

    fn step(&self, state: &State, &event: &Event) -> Result<State, String> {
        let (mut controller, mut facts) = state.value.clone();
        let before = *controller.state();
        match event {
            Event::Drive(at, rolls) => self.drive(&mut controller, &mut facts, at, rolls)?,
            Event::Target(target) => {
                let given = match (self, facts.target) {
                    (Self::Stubborn, Some(first)) => first,
                    _ => target,
                };
                controller.set_target(pose(given));
                let now = *controller.state();
                if facts.target == Some(target) {
                    if now != before {
                        return Err("the same target again has an effect".into());
                    }
                } else if now.phase != Phase::FinalRotation
                    || now.widened
                    || now.settled_ticks != 0
                    || now.planned_turn != RateProfile::default()
                    || !controller.moving()
                {
                    return Err("a new target does not start from the first phase".into());
                } else if facts.target.is_none() && pids(&controller) != pids(&fresh()) {
                    return Err("an integral outlives a stop".into());
                }
                facts.target = Some(target);
            }
            Event::Halt if *self == Self::Deaf => facts.target = None,
            Event::Halt => {
                controller.halt();
                facts.target = None;
            }
            Event::Tune(moves, runs) => {
                let duty = Duty::saturating(i32::from(runs) * 5_000);
                let commands = if moves {
                    controller.tune_move(duty, &pose(0), &Delta::default())
                } else {
                    controller.tune_rotate(duty)
                };
                if (commands == MotorCommands::BRAKE) == runs {
                    return Err(format!("{commands:?} to tune with {duty:?}"));
                }
                facts.target = None;
            }
        }
        let state = controller.state();
        if (state.phase == Phase::Idle) != facts.target.is_none() {
            return Err(format!("{:?} with target {:?}", state.phase, facts.target));
        }
        Ok(known(controller, facts))
    }
}

// Requirement: DOC-5.2.1-1
#[test]
fn phases_hold_in_every_order() {
    assert_holds(&Caller::Right, 1_200);
}

#[test]
fn broken_caller_of_the_controller_is_found() {
    assert_broken(&[
        (Caller::Deaf, "with target None"),
        (Caller::Stubborn, "does not start from the first phase"),
        (Caller::Numb, "or not at rest"),
        (Caller::Blind, "another pose"),
    ]);
}
