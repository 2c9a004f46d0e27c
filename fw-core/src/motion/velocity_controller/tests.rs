//! One wheel: feed-forward, deviation and the integral of friction.

use super::*;
use crate::eeprom::{config_with, fields, first_board};
use crate::motion::tests::duty;
use crate::types::Millimetres;
use fixed::types::I32F32;

/// The left wheel with these gains, percent per mm a tick and percent per mm.
fn wheel(p: f64, i: f64) -> WheelSpeed {
    let gain = |value| Gain::new(I32F32::from_num(value)).unwrap();
    let gains = Gains {
        p: gain(p),
        i: gain(i),
        ..Gains::default()
    };
    WheelSpeed::new(first_board().left(), &gains)
}

/// µm/s, and 2⁻³² turns a second.
fn velocity(forward: i32, yaw_rate: i32) -> Velocity {
    Velocity { forward, yaw_rate }
}

/// The obstacle stop before its first echo; driven by velocity or not.
fn obstacle(config: &Config, by_velocity: bool) -> ObstacleLimit {
    ObstacleLimit::new(config.obstacle_stop(), by_velocity)
}

const MM: f64 = 65_536.0;

#[test]
fn wheel_output_is_feed_forward_and_filtered_deviation() {
    let (mut wheel, mut random) = (wheel(0.5, 0.0), fastrand::Rng::with_seed(1));
    let per_speed = f64::from(wheel.feed_forward) / MM;
    let (mut first, mut second, mut deviation) = (0.0, 0.0, 0.0);
    let (mut required, mut measured) = (0, 0);
    for tick in 0..2000 {
        if tick % 20 == 0 {
            required = random.i32(-5 << 16..5 << 16);
            measured = random.i32(-5 << 16..5 << 16);
        }
        let speed = f64::from(required);
        let drive = 4.0 * (speed - first) + second;
        first += (speed - first) / 8.0;
        second += (first - second) / 8.0;
        deviation += (second - f64::from(measured) - deviation) / 4.0;
        let expected = (drive * per_speed + deviation * 0.5).clamp(-200.0 * MM, 200.0 * MM);
        let off = f64::from(wheel.step(required, measured)) - expected;
        assert!(off.abs() < 0.02 * MM, "{tick}: {off}");
    }
}

#[test]
fn integral_of_friction_changes_sign_with_the_direction() {
    // The same without gains: their difference is the correction.
    let (mut learning, mut plain) = (wheel(0.0, 0.1), wheel(0.0, 0.0));
    let mut correction = |required: f64, measured: f64| {
        let (required, measured) = ((required * MM) as i32, (measured * MM) as i32);
        let output = learning.step(required, measured) - plain.step(required, measured);
        f64::from(output) / MM
    };
    let learnt = (0..100).map(|_| correction(0.5, 0.0)).last().unwrap();
    assert!(learnt > 2.0, "{learnt}");
    let back = correction(-0.1, 0.5);
    assert!((back + learnt).abs() < 0.1, "{back} {learnt}");
    // Zero keeps the direction.
    let still = correction(0.0, 0.5);
    assert!((still + learnt).abs() < 0.3, "{still}");
}

// Requirement: WIRE-velocity-5
#[test]
fn blocked_wheels_saturate_and_rest_forgets_what_they_taught() {
    let config = first_board();
    let mut obstacle = obstacle(&config, true);
    let far = Millimetres(I32F32::lit("2500"));
    let (ahead, still) = (velocity(200_000, 0), Delta::rolled(0, 0));
    let rolling = Delta {
        travel: I16F16::lit("2"),
        ..still
    };
    let mut step = |controller: &mut VelocityController, commanded, delta| {
        obstacle.on_range(0, Some(far));
        obstacle.step(delta);
        controller.step(commanded, &obstacle, delta)
    };
    let fresh = VelocityController::new(&config);
    let mut blocked = fresh.clone();
    for (delta, clipped) in [(&rolling, false), (&still, true)] {
        for _ in 0..1000 {
            let _ = step(&mut blocked, ahead, delta);
        }
        assert_eq!(blocked.clipped(), clipped);
    }
    let mut halted = blocked.clone();
    halted.stand();
    let mut brakes = || step(&mut blocked, Velocity::default(), &still) == MotorCommands::BRAKE;
    let is_braked = (0..1000).any(|_| brakes());
    assert!(is_braked);
    for mut rested in [halted, blocked] {
        let mut fresh = fresh.clone();
        for tick in 0..100 {
            let commands = [&mut rested, &mut fresh].map(|one| step(one, ahead, &still));
            assert_eq!(commands[0], commands[1], "{tick}");
        }
    }
}

// Requirement: WIRE-velocity-5
#[test]
fn braking_robot_pushed_back_gives_up_speed_before_its_turn() {
    let config = first_board();
    let obstacle = obstacle(&config, false);
    let mut controller = VelocityController::new(&config);
    let turn = velocity(60_000, 50_000_000);
    let rolling = |mm| Delta {
        travel: I16F16::from_num(mm),
        turn: turn.yaw_rate / 100,
        ..Delta::default()
    };
    for _ in 0..200 {
        let _ = controller.step(turn, &obstacle, &rolling(0.6));
    }
    assert_eq!(controller.applied(), turn);
    let _ = controller.step(velocity(0, turn.yaw_rate), &obstacle, &rolling(-9.0));
    let Velocity { forward, yaw_rate } = controller.applied();
    // 4 mm/s are a tick's deceleration.
    assert!(
        yaw_rate == turn.yaw_rate && forward < 50_000,
        "{forward} {yaw_rate}"
    );
}

#[test]
fn speeds_beyond_their_type_are_the_fastest() {
    let mut wheel = wheel(0.5, 0.0);
    for _ in 0..100 {
        let _ = wheel.step(1 << 14, 1 << 14);
    }
    let before = wheel.step(1 << 14, 1 << 14);
    assert!(wheel.step(1 << 14, i32::MIN) > before);
    assert_eq!(towards(i32::MIN, i32::MAX, 5), i32::MIN + 5);
    assert_eq!(towards(i32::MAX, i32::MIN, 5), i32::MAX - 5);
}

// Requirement: WIRE-velocity-5
#[test]
fn pushed_robot_saturates_in_its_first_tick() {
    let config = first_board();
    for (travel, turn) in [(i32::MAX, i32::MAX), (i32::MAX, i32::MIN)] {
        let pushed = Delta {
            travel: I16F16::from_bits(travel),
            turn,
            ..Delta::default()
        };
        let mut controller = VelocityController::new(&config);
        let commands = controller.step(velocity(4_000, 0), &obstacle(&config, true), &pushed);
        let duties = [commands.left, commands.right].map(duty);
        assert!(duties.iter().all(|&duty| duty < 0), "{duties:?}");
        assert!(controller.clipped());
    }
}

// Requirement: WIRE-velocity-3
#[test]
fn speed_and_yaw_rate_are_cut_either_way() {
    let config = config_with(&[
        (fields::MAX_SPEED, 100),
        (fields::MAX_YAW_RATE, 0x1000),
        (fields::BLIND_SPEED, 2_000),
        (fields::REVERSE_SPEED, 2_000),
    ]);
    let obstacle = obstacle(&config, false);
    let ramp = VelocityRamp::new(config.velocity_limits());
    let (forward, yaw_rate) = (100_000, 1 << 28);
    for (speed, turn) in [(1, 1), (1, -1), (-1, 1), (-1, -1)] {
        let most = velocity(forward * speed, yaw_rate * turn);
        let beyond = velocity(most.forward + speed, most.yaw_rate + turn);
        let followed = ramp.step(most, beyond, &obstacle);
        assert_eq!((followed.target, followed.velocity), (most, most));
        assert!(followed.clipped && !ramp.step(most, most, &obstacle).clipped);
    }
}

/// Without dead zones, wheels of 200 and 100 mm/s, 40 mm/s a tick, hardly any gains.
fn unequal() -> Config {
    config_with(&[
        (fields::DEAD_ZONE_LEFT, 0),
        (fields::DEAD_ZONE_RIGHT, 0),
        (fields::FULL_SPEED_LEFT, 200),
        (fields::FULL_SPEED_RIGHT, 100),
        (fields::MAX_SPEED, 2_000),
        (fields::BLIND_SPEED, 2_000),
        (fields::REVERSE_SPEED, 2_000),
        (fields::ACCELERATION, 4_000),
        (fields::FORWARD_P, 0.001_f64.to_bits()),
        (fields::FORWARD_D, 0.001_f64.to_bits()),
    ])
}

// Requirement: WIRE-velocity-5
#[test]
fn saturated_wheel_slows_both_and_the_ramp() {
    let config = unequal();
    let obstacle = obstacle(&config, false);
    for direction in [1, -1] {
        let mut controller = VelocityController::new(&config);
        let fast = velocity(2_000_000 * direction, 0);
        let commands = controller.step(fast, &obstacle, &Delta::default());
        // Four times 40 mm/s take 80 and 160 %: 60 mm/s too much for the right wheel.
        for (command, percent) in [(commands.left, 50.0), (commands.right, 100.0)] {
            let found = f64::from(duty(command) * direction) / 100.0;
            assert!((found - percent).abs() < 0.1, "{found} % of {percent} %");
        }
        assert!((controller.applied().forward * direction - 25_000).abs() < 100);
    }
    // So is a turn.
    let mut turning = VelocityController::new(&config);
    turning.ramp.yaw_step = i32::MAX;
    turning.ramp.max_yaw_rate = i32::MAX;
    let yaw_rate = 1 << 29;
    let _ = turning.step(velocity(0, yaw_rate), &obstacle, &Delta::default());
    let track_mm = f64::from(config.track().0) / 1000.0;
    let way_mm_s = f64::from(yaw_rate) / 4_294_967_296.0 * std::f64::consts::PI * track_mm;
    let applied = f64::from(turning.applied().yaw_rate) / f64::from(yaw_rate) * way_mm_s;
    assert!((applied - 25.0).abs() < 0.1, "{applied} of {way_mm_s} mm/s");
}

/// The weaker wheel saturates backwards while the robot drives forwards, or the other way round: less forward
/// speed would not help it.
// Requirement: WIRE-velocity-5
#[test]
fn turn_that_saturates_against_the_forward_speed_is_slowed() {
    let config = unequal();
    let obstacle = obstacle(&config, false);
    for direction in [1, -1] {
        let mut controller = VelocityController::new(&config);
        controller.ramp.yaw_step = i32::MAX;
        controller.ramp.max_yaw_rate = i32::MAX;
        let command = velocity(10_000 * direction, -(1 << 29) * direction);
        let _ = controller.step(command, &obstacle, &Delta::default());
        let Velocity { forward, yaw_rate } = controller.applied();
        assert_eq!(forward, command.forward);
        let kept = f64::from(yaw_rate) / f64::from(command.yaw_rate);
        assert!(0.1 < kept && kept < 0.9, "{kept}");
    }
}

#[test]
fn yaw_rate_is_the_wheels_way_round_the_middle() {
    let config = unequal();
    let obstacle = obstacle(&config, true);
    let mut controller = VelocityController::new(&config);
    for _ in 0..300 {
        let _ = controller.step(velocity(0, 1 << 27), &obstacle, &Delta::default());
    }
    // A 32nd of a turn in a second.
    let way_mm = std::f64::consts::PI * f64::from(config.track().0) / 1000.0 / 3200.0;
    for (wheel, sign) in [(&controller.left, -1.0), (&controller.right, 1.0)] {
        let off = f64::from(wheel.lag[1]) / MM * sign - way_mm;
        assert!(off.abs() < 0.001 * way_mm + 1e-3, "{off} of {way_mm}");
    }
}

#[test]
fn wheel_slower_than_10_mm_s_is_slow() {
    let mut wheel = wheel(0.0, 0.0);
    for (second, slow) in [
        (6_552, true),
        (-6_552, true),
        (6_553, false),
        (-6_553, false),
    ] {
        wheel.lag = [0, second];
        assert_eq!(wheel.is_slow(), slow, "{second}");
    }
}

// Requirement: WIRE-velocity-6
#[test]
fn brake_waits_for_both_wheels() {
    let config = first_board();
    let obstacle = obstacle(&config, true);
    for (left, right) in [(0, 1 << 16), (1 << 16, 0)] {
        let mut controller = VelocityController::new(&config);
        (controller.left.lag, controller.right.lag) = ([left; 2], [right; 2]);
        let commands = controller.step(Velocity::default(), &obstacle, &Delta::default());
        assert_ne!(commands, MotorCommands::BRAKE, "{left} {right}");
    }
}

#[test]
fn wheels_shed_their_windup_as_the_forward_regulator() {
    use crate::eeprom::fields::{FORWARD_ANTI_WINDUP, ROTATION_ANTI_WINDUP};
    let of = |field, value: f64| {
        let config = config_with(&[(field, value.to_bits())]);
        std::format!("{:?}", VelocityController::new(&config).left)
    };
    for (field, counts) in [(FORWARD_ANTI_WINDUP, true), (ROTATION_ANTI_WINDUP, false)] {
        assert_eq!(of(field, 0.0) != of(field, 1.0), counts, "{}", field.name());
    }
}
