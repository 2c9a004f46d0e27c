//! The loop of localiser and plan over a session, on a robot without firmware in an imperfect world.

use fw_core::eeprom::{Config, Field, Image, fields};
use fw_core::types::Faults;
use fw_core::wire::{Command, DistanceCode, GyroCode, Mode, Order, PoseCode, Report, State};
use host_link::board_io::{BoardIo, Interrupt};
use host_link::error::Error;
use host_link::mock_board::{Shared, mock_board};
use host_link::session::{CommandRequest, RATE_HZ, Session, VelocityRequest};
use mapper::{Grid, Localiser, Point, Pose2, PoseEstimate, ros};
use navigator::{Action, Explorer, GoTo, Outcome, Status, StopReason, Velocity};
use pilot::drive;
use pilot::exploring::{self, Drive, Localisation, Plan, PlanRunner};
use pilot::mapping::{BODY_MM, RangeSample};
use plant::kinematic::{KinematicRobot, VelocityInput};
use plant::{Imperfections, Room};
use std::cell::RefCell;
use std::f64::consts::TAU;
use std::ops::ControlFlow;
use std::rc::Rc;
use std::time::{Duration, Instant};

/// A room of 2.4 m by 1.8 m with a box in a corner, for the robot that starts in its middle.
fn room() -> Room {
    Room::default()
        .with_wall(-1200.0, -900.0, 1200.0, -900.0)
        .with_wall(1200.0, -900.0, 1200.0, 900.0)
        .with_wall(1200.0, 900.0, -1200.0, 900.0)
        .with_wall(-1200.0, 900.0, -1200.0, -900.0)
        .with_box(&Pose2::new(950.0, 700.0, 0.0), 500.0, 400.0)
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // within the wire's ranges
fn report_of(robot: &KinematicRobot, report: &mut Report) {
    let sample = robot.sample();
    let turn = sample.odometry.heading_rad.rem_euclid(TAU) / TAU;
    report.pose = PoseCode {
        x: (sample.odometry.x_mm * 1000.0) as i32,
        y: (sample.odometry.y_mm * 1000.0) as i32,
        rotation: (turn * 32_768.0) as u16 & 0x7FFF,
    };
    let gyro = sample.gyro_rad.map(|rad| (rad / TAU * 16_777_216.0) as i32);
    report.gyro = gyro.map_or(GyroCode::NONE, GyroCode);
    report.ranges = sample.ranges_mm.map(|range| {
        let code = range.map(|mm| (mm * 65_535.0 / 2500.0) as u16);
        code.map_or(DistanceCode::NONE, DistanceCode)
    });
    report.bearing = (sample.front_bearing_rad / TAU * 65_536.0) as i32 as u16;
    report.obstacle_limited = sample.obstacle_limited;
}

/// A board whose robot drives in the room from `start`. `trouble` may change each command's report, and
/// gets the number of the frame.
fn rig(
    start: Pose2,
    mut trouble: impl FnMut(usize, &Command, &mut Report, &Interrupt) + 'static,
) -> (Rc<RefCell<KinematicRobot>>, Shared, BoardIo) {
    let robot = KinematicRobot::new(room(), start, Imperfections::default(), 3);
    let robot = Rc::new(RefCell::new(robot));
    let image = Image::FIRST_BOARD.with(fields::MODE, Mode::GuardedVelocity.code().into());
    let (board, io) = mock_board(&image, None);
    let (driven, interrupt, mut frames) = (Rc::clone(&robot), io.interrupt.clone(), 0);
    board.borrow_mut().on_command = Some(Box::new(move |command, report| {
        frames += 1;
        trouble(frames, command, report, &interrupt);
        let stands = matches!(report.state, State::Stopped | State::Faulted);
        let share = if stands { 0.0 } else { 1.0 };
        let velocity = VelocityInput {
            forward_mm_s: share * f64::from(command.velocity.forward) / 1000.0,
            yaw_rate_rad_s: share * f64::from(command.velocity.yaw_rate) / 4_294_967_296.0 * TAU,
            sweep_half_width_rad: f64::from(command.sweep) / 65_536.0 * TAU,
        };
        driven.borrow_mut().step(0.025, velocity);
        report_of(&driven.borrow(), report);
    }));
    (robot, board, io)
}

/// Explores the room.
fn explore(io: &mut BoardIo) -> (Result<Drive, Error>, Localisation) {
    let mut session = Session::open(io, RATE_HZ, 100).unwrap();
    let config = session.config();
    let mut localisation = Localisation::new(config, BODY_MM, 25.0);
    let mut plan = Explorer::new(exploring::navigator_config(config, BODY_MM).unwrap());
    let driven = exploring::drive(&mut session, &mut localisation, &mut plan, |_| {
        ControlFlow::Continue(())
    });
    (driven, localisation)
}

fn ends_with_stop(board: &Shared) -> bool {
    let board = board.borrow();
    let mut last = board.commands.iter().rev().take(10);
    last.all(|command| command.order == Order::Stop)
}

#[test]
fn room_is_explored_in_spite_of_stall_and_lost_link() {
    let (robot, board, mut io) = rig(room().start, |frame, command, report, _| {
        let latched = match frame {
            1500 => (State::Faulted, Faults::LEFT_STALLED),
            2500 => (State::Stopped, Faults::LINK_LOST),
            _ if command.order == Order::Resume => {
                (State::Ready, report.faults.difference(command.clear_faults))
            }
            _ => (report.state, report.faults),
        };
        (report.state, report.faults) = latched;
    });
    let (driven, localisation) = explore(&mut io);
    let driven = driven.unwrap();
    assert_eq!((driven.outcome, driven.stops), (Outcome::Complete, 2));
    assert!(ends_with_stop(&board));
    let robot = robot.borrow();
    assert!(robot.collisions().is_empty(), "{:?}", robot.collisions());
    let (path, truth) = (localisation.path.last().unwrap(), robot.true_pose());
    let off_mm = path.distance_mm(&truth);
    assert!(off_mm < 60.0, "{path:?} is {truth:?}: {off_mm}");
    let coverage = mapper::evaluation::coverage(
        localisation.localiser.grid(),
        &room().reachable_floor(),
        &Pose2::default(),
    );
    assert!(coverage > 0.95, "{coverage}");
}

/// A plan that drives on, but thinks for long before one of its frames.
struct Slow(u32);

const SLOW_FRAME: u32 = 5;

impl Plan for Slow {
    fn step(&mut self, _: &Grid, _: &Status) -> Action {
        self.0 += 1;
        if self.0 == SLOW_FRAME {
            std::thread::sleep(Duration::from_millis(400));
        } else if self.0 == 2 * SLOW_FRAME {
            return Action::Done(Outcome::Complete);
        }
        Action::Drive(Velocity {
            forward_mm_s: 50.0,
            ..Velocity::default()
        })
    }
}

#[test]
fn frames_go_on_while_a_plan_takes_longer_than_the_deadline() {
    let (_, board, mut io) = rig(room().start, |_, _, _, _| ());
    let opened = Session::open(&mut io, RATE_HZ, 100).unwrap();
    let (config, begun) = (opened.config().clone(), Instant::now());
    io.clock = Box::new(move || u64::try_from(begun.elapsed().as_micros()).unwrap());
    io.delay = Box::new(|us| std::thread::sleep(Duration::from_micros(us.into())));
    let mut localisation = Localisation::new(&config, BODY_MM, 25.0);
    let mut session = Session::with_config(&mut io, config, RATE_HZ);
    let driven = exploring::drive(&mut session, &mut localisation, &mut Slow(0), |_| {
        ControlFlow::Continue(())
    });
    assert_eq!(driven.unwrap().outcome, Outcome::Complete);
    let speed = |command: &Command| command.velocity.forward;
    let speeds: Vec<_> = board.borrow().commands.iter().map(speed).collect();
    // On with the last velocity, at rest, and on with the plan's.
    let parts: Vec<_> = speeds.chunk_by(|a, b| a == b).collect();
    let [.., before, rest, after, _stop] = &parts[..] else {
        panic!("{speeds:?}");
    };
    assert_eq!((before[0], rest[0], after[0]), (50_000, 0, 50_000));
    assert!(before.len() > 4 && rest.len() >= 4, "{speeds:?}");

    let sleep = || std::thread::sleep(Duration::from_millis(300));
    let velocity = Some(VelocityRequest {
        forward_mm_s: 50.0,
        yaw_rate_deg_s: 20.0,
        ..VelocityRequest::default()
    });
    let sent = board.borrow().commands.len();
    drive::meanwhile(&mut session, velocity, sleep, |_| Ok(())).unwrap();
    // Four frames are 0.1 s.
    let rests = |command: &Command| command.velocity == fw_core::types::Velocity::default();
    let commands = board.borrow_mut().commands.split_off(sent);
    assert!(commands.iter().skip(4).all(rests) && commands.last().is_some_and(rests));
    let ended = drive::meanwhile(&mut session, None, sleep, |_| Err(Error::Interrupted));
    assert_eq!(ended, Err(Error::Interrupted));
    assert!(ends_with_stop(&board));
}

#[test]
fn interrupt_empty_battery_and_restart_stop_the_robot() {
    let (_, board, mut io) = rig(room().start, |frame, _, _, interrupt| {
        if frame == 300 {
            interrupt.raise();
        }
    });
    let (driven, _) = explore(&mut io);
    assert!(matches!(driven, Err(Error::Interrupted)), "{driven:?}");
    assert!(ends_with_stop(&board));
    for (state, faults) in [
        (State::Faulted, Faults::BATTERY_CUTOFF),
        (State::Stopped, Faults::RESTARTED),
    ] {
        let (_, board, mut io) = rig(room().start, move |frame, _, report, _| {
            if frame == 300 {
                (report.state, report.faults) = (state, faults);
            }
        });
        let (driven, _) = explore(&mut io);
        let error = driven.unwrap_err();
        assert_eq!(
            error == Error::Restarted,
            faults == Faults::RESTARTED,
            "{error:?}"
        );
        assert!(ends_with_stop(&board));
    }
}

#[test]
fn saved_map_leads_to_a_point_from_an_unknown_start() {
    let (_, _, mut io) = rig(room().start, |_, _, _, _| ());
    let (driven, explored) = explore(&mut io);
    driven.unwrap();
    let grid = explored.localiser.grid();
    let grid = ros::read(&ros::yaml(grid, "map.pgm"), &ros::pgm(grid)).unwrap();
    // From 48 of 51 starts, drawn at random on two maps, the search finds the robot; from the others it gives none.
    let (robot, _, mut io) = rig(Pose2::new(312.0, 19.0, -0.9), |_, _, _, _| ());
    let mut session = Session::open(&mut io, RATE_HZ, 100).unwrap();
    let config = session.config();
    let settings = exploring::localiser_config(config, BODY_MM, grid.cell_mm());
    let mut localiser = Localiser::on_map(settings, grid, None);
    exploring::locate(&mut session, &mut localiser, BODY_MM, |_| ()).unwrap();
    assert!(localiser.is_located());
    // The way of the search is known by dead reckoning.
    assert!(localiser.estimate().covariance[1][1] > 400.0);
    let (config, target) = (session.config(), Point::new(600.0, -400.0));
    let mut localisation = Localisation::with(localiser, config, BODY_MM, 25.0);
    let mut plan = GoTo::new(
        exploring::navigator_config(config, BODY_MM).unwrap(),
        target,
    );
    let driven = exploring::drive(&mut session, &mut localisation, &mut plan, |_| {
        ControlFlow::Continue(())
    });
    assert_eq!(driven.unwrap().outcome, Outcome::Complete);
    let end = robot.borrow().true_pose();
    let off_mm = end.position().distance_mm(target);
    assert!(off_mm < 150.0, "{end:?} is {off_mm} mm from {target:?}");
    assert!(robot.borrow().collisions().is_empty());
}

/// Returns the same action for every frame until it is recalled, and records the status of each.
struct FixedPlan(Action, Vec<Status>);

impl Plan for FixedPlan {
    fn step(&mut self, _: &Grid, status: &Status) -> Action {
        self.1.push(*status);
        self.0
    }

    fn recall(&mut self) {
        self.0 = Action::Drive(Velocity::default());
    }
}

/// The requests of a runner after reports at these seconds, and the stops in the plan's status.
fn run(
    action: Action,
    reports: &[(f64, State, Faults)],
) -> (Result<Vec<CommandRequest>, Error>, Vec<Option<StopReason>>) {
    let (mut runner, mut plan) = (PlanRunner::new(500_000), FixedPlan(action, Vec::new()));
    let estimate = PoseEstimate::default();
    let grid = Grid::new(25.0);
    let step = |&(time_s, state, faults): &(f64, State, Faults)| {
        let time_us = Duration::from_secs_f64(time_s).as_micros();
        let sample = RangeSample {
            time_us: time_us.try_into().unwrap(),
            ..RangeSample::default()
        };
        let report = Report {
            state,
            faults,
            ..Report::default()
        };
        let next = runner.step(&mut plan, &grid, estimate, &sample, &report)?;
        let status = plan.1.last().expect("a step");
        assert!((status.time_s - (time_s - 0.5)).abs() < 1e-6);
        Ok(next.continue_value().expect("the plan goes on"))
    };
    let asked = reports.iter().map(step).collect();
    let stops = plan.1.iter().map(|status| status.stop).collect();
    (asked, stops)
}

#[test]
fn plan_gets_each_stop_and_its_action_clears_it() {
    let quarter_turn = Velocity {
        forward_mm_s: 100.0,
        yaw_rate_rad_s: TAU / 4.0,
        sweep_half_width_rad: TAU / 8.0,
    };
    let latched = Faults::SLIP.union(Faults::FRAME_REJECTED);
    let slip = |time_s| (time_s, State::Moving, latched);
    // At once, with the clearing on its way, at once again, soon, after a while, and soon after that.
    let reports = [1.0, 1.15, 1.2, 1.5, 9.0, 9.5].map(slip);
    let (asked, stops) = run(Action::Drive(quarter_turn), &reports);
    let lasting = Some(StopReason::Slip);
    assert_eq!(stops, [None, None, None, lasting, None, lasting]);
    for request in asked.unwrap() {
        let velocity = request.velocity.unwrap();
        let (yaw, sweep) = (velocity.yaw_rate_deg_s, velocity.sweep_half_width_deg);
        assert!((yaw - 90.0).abs() < 1e-9 && (sweep - 45.0).abs() < 1e-9);
        let cleared = (request.order, request.clear_faults);
        assert_eq!(cleared, (Order::None, Faults::SLIP));
    }
    let reports = [Faults::NONE, Faults::BATTERY_LOW].map(|faults| (1.0, State::Moving, faults));
    let (asked, _) = run(Action::Drive(quarter_turn), &reports);
    let asked = asked
        .unwrap()
        .into_iter()
        .map(|request| request.velocity.unwrap().forward_mm_s);
    assert!(
        asked.eq([100.0, 0.0]),
        "an explorer goes home with a low battery"
    );
    for (state, fault, expected) in [
        (State::Faulted, Faults::LEFT_STALLED, StopReason::Stall),
        (State::Faulted, Faults::RIGHT_STALLED, StopReason::Stall),
        (State::Faulted, Faults::LEFT_REVERSED, StopReason::Stall),
        (State::Faulted, Faults::RIGHT_REVERSED, StopReason::Stall),
        (State::Faulted, Faults::ENCODER_JUMP, StopReason::Stall),
        (State::Stopped, Faults::LINK_LOST, StopReason::Link),
    ] {
        let (asked, stops) = run(Action::Resume, &[(1.0, state, fault)]);
        assert_eq!(stops, [Some(expected)], "{fault:?}");
        let request = asked.unwrap()[0];
        let expected = (Order::Resume, fault);
        assert_eq!((request.order, request.clear_faults), expected);
    }
    let cutoff = [(1.0, State::Faulted, Faults::BATTERY_CUTOFF)];
    let (asked, stops) = run(Action::Resume, &cutoff);
    assert!(matches!(asked, Err(Error::Fault { .. })) && stops.is_empty());
}

#[test]
fn exploring_keeps_to_what_the_configuration_can_do() {
    let config = |values: &[(&'static Field, u64)]| {
        let with = |image: Image, &(field, value): &(_, u64)| image.with(field, value);
        let image = Image::FIRST_BOARD.with(fields::MODE, Mode::GuardedVelocity.code().into());
        Config::decode(&values.iter().fold(image, with)).unwrap()
    };
    let plan = |values: &[_]| exploring::navigator_config(&config(values), BODY_MM);
    let swept = plan(&[(fields::SERVO, 1), (fields::MAX_SPEED, 90)]);
    let blind = plan(&[(fields::RANGEFINDERS, 0)]);
    assert!(matches!(blind, Err(Error::Rejected(_, why)) if why.starts_with("rangefinders = 0")));
    let wide = [200_000, 200_001].map(|track| plan(&[(fields::TRACK, track)]));
    assert!(wide[0].is_ok() && matches!(&wide[1], Err(Error::Usage(_))));
    let (plan, swept) = (plan(&[]).unwrap(), swept.unwrap());
    let defaults = navigator::Config::default();
    assert_eq!(
        (plan.cruise_mm_s, plan.sweep_half_width_rad),
        (defaults.cruise_mm_s, 0.0)
    );
    assert!((swept.cruise_mm_s - 90.0).abs() < 1e-9);
    assert!((swept.sweep_half_width_rad.to_degrees() - 60.0).abs() < 1e-9);
    let two = [(fields::BEARING_RIGHT, 0xE000), (fields::RANGEFINDERS, 2)];
    let [_, eighth, none] = exploring::localiser_config(&config(&two), BODY_MM, 25.0).mounts;
    assert!((eighth.unwrap().bearing_rad + TAU / 8.0).abs() < 1e-4 && none.is_none());
    let normal = Config::decode(&Image::FIRST_BOARD).unwrap();
    let normal = exploring::navigator_config(&normal, BODY_MM);
    assert!(matches!(normal, Err(Error::WrongMode(..))), "{normal:?}");
}

#[test]
fn report_is_observed_in_seconds_and_radians() {
    let observed = exploring::observation(&RangeSample {
        time_us: 2_500_000,
        gyro_deg: Some(180.0),
        bearing_deg: Some(-90.0),
        ..RangeSample::default()
    });
    let quarters = [observed.gyro_rad, observed.front_bearing_rad]
        .map(Option::unwrap)
        .map(|rad| rad / TAU * 4.0);
    assert_eq!((observed.time_s, quarters), (2.5, [2.0, -1.0]));
}
