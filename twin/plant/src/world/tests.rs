use super::*;

fn world(room: Room) -> World {
    World::new(Params::default(), room, Pose2::default(), 1)
}

fn drive(world: &mut World, millis: u32, left: f64, right: f64) {
    for _ in 0..millis {
        world.step(0.001, MotorInput::run(left), MotorInput::run(right));
    }
}

#[test]
fn encoders_count_down_as_far_as_wheels_roll_forward() {
    let mut world = world(Room::default());
    drive(&mut world, 2000, 0.75, 0.75);
    let Sides { left, right } = world.wheel_phase();
    assert!(left < -500.0 && right < left, "{left} {right}");
    let mm_per_count = 80.0 * std::f64::consts::PI / 3840.0;
    let turn = (left - right) * mm_per_count / 125.0;
    assert!((world.pose().heading_rad - turn).abs() < 1e-9);
    assert!((world.path_mm() + f64::midpoint(left, right) * mm_per_count).abs() < 0.01);
}

#[test]
fn run_is_reproducible_from_seed() {
    let run = |seed| {
        let room = Room::two_rooms();
        let mut world = World::new(Params::default(), room, Pose2::default(), seed);
        drive(&mut world, 1000, 0.6, 0.5);
        (world.pose(), [0, 1, 2].map(|sensor| world.echo_us(sensor)))
    };
    assert_eq!(run(5), run(5));
    assert_ne!(run(5).1, run(6).1);
}

#[test]
fn step_size_does_not_change_path() {
    let run = |steps: u32, dt| {
        let mut world = world(Room::default());
        for _ in 0..steps {
            world.step(dt, MotorInput::run(0.8), MotorInput::run(0.6));
        }
        world.pose()
    };
    let (fine, coarse) = (run(20_000, 0.0001), run(200, 0.01));
    assert!(fine.distance_mm(&coarse) < 1.0, "{fine:?} {coarse:?}");
}

#[test]
fn wall_stops_robot_and_encoders_and_counts_once() {
    let mut world = world(Room::default());
    drive(&mut world, 100, 1.0, 0.75);
    // The room changes while it drives.
    world.set_room(Room::default().with_wall(300.0, -900.0, 300.0, 900.0));
    drive(&mut world, 4000, 1.0, 0.75);
    assert_eq!(world.collisions().len(), 1);
    let clearance = world.room().clearance_mm(world.pose().position());
    assert!((99.0..101.0).contains(&clearance), "{clearance}");
    let counts = world.wheel_counts();
    drive(&mut world, 1000, 1.0, 0.75);
    assert_eq!(world.wheel_counts(), counts);
    drive(&mut world, 1000, -1.0, -0.75);
    assert!(world.pose().x_mm < 190.0, "it can back out");
    let collision = world.collisions()[0];
    assert!(collision.time_s < 4.0 && collision.speed_mm_s > 100.0);
}

#[test]
fn driving_sags_battery_voltage() {
    let mut world = world(Room::default());
    let volts = |world: &World| world.battery().taps()[1];
    drive(&mut world, 1, 0.0, 0.0);
    let rested = volts(&world);
    drive(&mut world, 50, 1.0, 1.0);
    assert!(volts(&world) < rested - 0.1);
    drive(&mut world, 10, 0.0, 0.0);
    assert!((volts(&world) - rested).abs() < 0.01);
}

#[test]
fn slip_push_and_twist_separate_robot_from_encoders() {
    let mut world = world(Room::default());
    world.faults.slip = Sides::new(1.0, 1.0);
    drive(&mut world, 1000, 0.75, 0.75);
    assert_eq!(world.pose(), Pose2::default());
    assert!(world.wheel_counts().left < -100);
    drive(&mut world, 1000, 0.0, 0.0);
    let counts = world.wheel_counts();
    world.push(&Pose2::new(10.0, -5.0, 0.1));
    assert_eq!(world.pose(), Pose2::new(10.0, -5.0, 0.1));
    world.faults.twist_deg_s = 90.0;
    drive(&mut world, 500, 0.0, 0.0);
    let turned = (world.pose().heading_rad - 0.1).to_degrees();
    assert!((turned - 45.0).abs() < 1e-6);
    assert_eq!(world.wheel_counts(), counts);
}

#[test]
fn external_wheel_rotation_moves_robot_and_encoders_alike() {
    let mut world = world(Room::default());
    world.hand_deg_s = Sides::new(-90.0, -90.0);
    for _ in 0..500 {
        world.step(0.001, MotorInput::BRAKE, MotorInput::BRAKE);
    }
    let Sides { left, right } = world.wheel_counts();
    assert!((479..=480).contains(&left) && left == right, "{left}");
    let rolled = 45.0 * 80.0 * std::f64::consts::PI / 360.0;
    assert!((world.pose().x_mm + rolled).abs() < 1e-6);
}

#[test]
fn faults_of_parts_act_on_their_part_alone() {
    let mut world = world(Room::two_rooms());
    world.faults.dead_encoder.left = true;
    world.faults.jammed.right = true;
    world.faults.missing_echo[crate::FRONT] = true;
    world.faults.stuck_mm[crate::LEFT] = Some(123.0);
    world.faults.cells_v = Some([0.0, 3.0]);
    drive(&mut world, 500, 0.75, 0.75);
    assert_eq!(world.wheel_counts(), Sides::default());
    assert!(world.pose().heading_rad < 0.0, "the left wheel still turns");
    assert!(world.cell_pins()[0] == 0.0 && world.cell_pins()[1] > 1.0);
    assert_eq!(world.range_mm(crate::FRONT), None);
    assert_eq!(world.range_mm(crate::LEFT), Some(123.0));
    assert!(world.range_mm(crate::RIGHT).is_some());
}
