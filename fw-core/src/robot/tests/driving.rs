//! A driving robot applies its controller's commands, towards the target that the Pi applied last.

use super::*;
use crate::motion::PoseController;

/// A robot with ideal wheels, beside a controller with the same input.
struct Course {
    bench: Bench,
    controller: PoseController,
    obstacle: ObstacleLimit,
    ticks: u32,
}

impl Course {
    fn new() -> Self {
        Self {
            bench: Bench::new(Mode::Normal),
            controller: PoseController::new(&first_board()),
            obstacle: ObstacleLimit::new(first_board().obstacle_stop(), false),
            ticks: 0,
        }
    }

    /// A tick: the motor commands.
    fn tick(&mut self) -> [MotorCommand; 2] {
        self.ticks += 1;
        let motors = motors(self.bench.tick());
        // 50 counts a tick at full duty.
        let [left, right] = motors.map(|command| duty(command) / 200);
        self.bench.roll(left.into(), right);
        motors
    }

    /// What the controller says in the tick that was.
    fn expected(&mut self) -> [MotorCommand; 2] {
        let robot = &self.bench.robot;
        self.obstacle.step(&robot.delta);
        self.controller.limit_speed(&self.obstacle);
        let wheels = self.controller.drive(&robot.pose(), &robot.delta);
        [wheels.left, wheels.right]
    }

    /// So many ticks with a frame every fifth, in which nothing but the controller decides.
    fn follow(&mut self, command: &Command, ticks: u32) {
        for tick in 0..ticks {
            if tick % 5 == 0 {
                self.bench.frame(command);
            }
            assert_eq!(self.tick(), self.expected(), "tick {}", self.ticks);
        }
    }
}

// Requirement: DOC-5.1.1-4, WIRE-modes-2, DOC-2.1-2
#[test]
fn motors_follow_last_applied_target() {
    let mut course = Course::new();
    for target in [go(200), go(-100)] {
        course.controller.set_target(target.expected.to_pose());
        course.follow(&target, 40);
        assert_eq!(course.bench.robot.state(), State::Moving);
        // Another one that is not applied is not driven to.
        let apply = false;
        course.follow(&Command { apply, ..go(5000) }, 20);
    }
}

#[test]
fn target_at_own_pose_is_held() {
    let mut course = Course::new();
    course.bench.frame(&Command::default());
    assert_eq!(course.tick(), COAST, "not applied");
    course.controller.set_target(Pose::default());
    // Braked once it has arrived, not rolling freely.
    course.follow(&go(0), 20);
    assert_eq!(course.tick(), BRAKE);
    assert_eq!(course.bench.robot.state(), State::Ready);
}

#[test]
fn drive_after_stop_begins_from_rest() {
    let mut course = Course::new();
    let target = go(500);
    course.controller.set_target(target.expected.to_pose());
    course.follow(&target, 40);
    // Five ticks have passed since the last frame; the 25th is 250 ms after it.
    for tick in 5..60 {
        let commands = course.tick();
        if tick < 24 {
            assert_eq!(commands, course.expected());
        } else {
            assert_eq!(commands, BRAKE);
            course.controller.halt();
        }
    }
    course.controller.set_target(target.expected.to_pose());
    course.follow(&target, 40);
}

#[test]
fn other_heading_at_the_same_place_is_another_target() {
    let mut course = Course::new();
    course.controller.set_target(Pose::default());
    course.follow(&go(0), 10);
    let mut turn = go(0);
    turn.expected.rotation = 0x2000;
    course.controller.set_target(turn.expected.to_pose());
    course.follow(&turn, 10);
    assert_eq!(course.bench.robot.state(), State::Moving);
}

/// The latched faults, without the one of the log, which this test does not drain.
fn faults(bench: &Bench) -> Faults {
    bench.robot.faults().difference(Faults::LOG_DROPPED)
}

/// Ticks until the robot, of which the wheels roll so, gives up its target.
fn given_up_after(bench: &mut Bench, command: &Command, roll: impl Fn(u32) -> (i32, i16)) -> u32 {
    let mut ticks = 0;
    while bench.robot.state() != State::Faulted {
        bench.log = Log::new();
        // Repeated, the target has no more time.
        let running = runs(bench.drive(command));
        let moves = bench.robot.state() == State::Moving;
        assert!(ticks < 6000 && running == moves, "tick {ticks}");
        let (left, right) = roll(ticks);
        bench.roll(left, right);
        ticks += 1;
    }
    assert_eq!(faults(bench), Faults::NOT_ARRIVED);
    assert!(bench.log().contains(": not arrived in time\n"));
    ticks
}

// Requirement: WIRE-fault-15, WIRE-status-5
#[test]
fn target_that_is_not_reached_in_time_is_given_up() {
    for mode in [Mode::Normal, Mode::GuardedNormal] {
        let mut bench = Bench::new(mode);
        // 13 mm/s: enough for the drive monitor, too slow for a metre and the 55 s that it may take.
        assert_eq!(given_up_after(&mut bench, &go(1000), |_| (2, 2)), 5477);
        for target in [1000, 500] {
            assert_eq!(motors(bench.drive(&go(target))), BRAKE);
        }
        if mode == Mode::GuardedNormal {
            let clear = clearing(Faults::NOT_ARRIVED, go(1000));
            let outputs = bench.drive(&clear);
            assert_eq!(motors(outputs), BRAKE, "cleared, it is stopped");
            let outputs = bench.drive(&with_order(Order::Resume, go(1000)));
            assert!(runs(outputs) && faults(&bench).is_empty());
            // One frame clears and orders.
            for order in [Order::Stop, Order::Resume] {
                bench.raise(Faults::NOT_ARRIVED);
                let outputs = bench.drive(&with_order(order, clear));
                assert_eq!(runs(outputs), order == Order::Resume);
                assert!(faults(&bench).is_empty(), "{order:?}");
            }
        }
    }
}

/// A metre to the left of where it stands, and a metre again before the first is reached.
// Requirement: WIRE-fault-15
#[test]
fn new_target_has_the_time_of_its_own_way() {
    let mut bench = Bench::new(Mode::Normal);
    for (left, right, ticks) in [(50, 50, 153), (-50, 50, 30)] {
        for _ in 0..ticks {
            bench.roll(left, right);
            bench.tick();
        }
    }
    let ahead = |bench: &Bench| {
        let PoseCode { x, y, rotation } = bench.robot.report.pose;
        let y = y + 1_000_000;
        let mut target = go(0);
        target.expected = PoseCode { x, y, rotation };
        target
    };
    let first = ahead(&bench);
    for _ in 0..5000 {
        bench.drive(&first);
        bench.roll(2, 2);
    }
    let second = ahead(&bench);
    assert_eq!(given_up_after(&mut bench, &second, |_| (2, 2)), 5477);
}

// Requirement: WIRE-fault-15
#[test]
fn target_held_from_time_to_time_is_not_given_up() {
    let mut bench = Bench::new(Mode::Normal);
    bench.frame(&go(0));
    // For two minutes pushed back by 13 mm again and again, from where the motors return.
    let mut pushes = 0;
    for _ in 0..12_000 {
        if runs(bench.drive(&go(0))) {
            bench.roll(1, 1);
        } else if bench.robot.state() == State::Ready {
            pushes += 1;
            bench.roll(-200, -200);
        }
    }
    assert_eq!(faults(&bench), Faults::NONE);
    assert!(pushes > 50, "{pushes}");
}

/// The obstacle stop's 100 mm/s are just a quarter of the full speed; or it allows nothing, but the robot
/// turns where it stands, by 46° in 10 s.
// Requirement: WIRE-fault-15
#[test]
fn time_runs_while_the_obstacle_stop_does_not_hold_back() {
    let fast = [
        (fields::FULL_SPEED_LEFT, 400),
        (fields::FULL_SPEED_RIGHT, 400),
        (fields::REVERSE_SPEED, 100),
    ];
    let mut bench = Bench::with(Mode::Normal, &fast);
    assert_eq!(given_up_after(&mut bench, &go(1000), |_| (2, 2)), 2499);
    let mut bench = Bench::with(Mode::Normal, &[(fields::BLIND_SPEED, 0)]);
    let mut turn = go(0);
    turn.expected.rotation = 0x4000;
    let slowly = |tick| if tick % 3 == 0 { (0, 0) } else { (-1, 1) };
    assert_eq!(given_up_after(&mut bench, &turn, slowly), 2492);
}

/// The obstacle stop holds the robot back for longer than it may take.
// Requirement: WIRE-fault-15
#[test]
fn time_does_not_run_before_an_obstacle() {
    let mut bench = Bench::with(Mode::Normal, &[(fields::BLIND_SPEED, 0)]);
    for _ in 0..12_000 {
        bench.drive(&go(1000));
    }
    assert_eq!(bench.robot.state(), State::Moving);
    assert_eq!(faults(&bench), Faults::NONE);
}
