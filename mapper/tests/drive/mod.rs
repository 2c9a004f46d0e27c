//! Drives the modelled robot along the default room's tour and gives the mapper the fields of the
//! frames: the odometry's pose, and ranges up to three measuring cycles old.

use mapper::{Config, Mapper, Pose2, Segment};
use plant::{MotorInput, Params, Room, World};

/// The result of a drive.
pub struct Drive {
    /// The map.
    pub mapper: Mapper,
    /// The estimated path.
    pub estimate: Vec<Pose2>,
    /// The true path.
    pub truth: Vec<Pose2>,
    /// The visible walls.
    pub walls: Vec<Segment>,
    /// The world at the end.
    pub world: World,
}

/// Milliseconds of the control loop, of a frame, and of one rangefinder's turn.
const CONTROL_MS: u64 = 10;
const FRAME_MS: u64 = 25;
const TURN_MS: u64 = 60;
/// Speeds: along, mm/s, and about, mm/s of each wheel.
const ALONG: f64 = 140.0;
const ABOUT: f64 = 60.0;

/// One wheel's speed controller: proportional and integral.
#[derive(Default)]
struct Wheel {
    sum: f64,
    last: f64,
}

impl Wheel {
    /// Duty for a target speed (mm/s), from the wheel's travel (mm).
    fn duty(&mut self, target: f64, travel: f64) -> f64 {
        let speed = (travel - self.last) * 1000.0 / CONTROL_MS as f64;
        self.last = travel;
        self.sum = (self.sum + 0.00008 * (target - speed)).clamp(-1.0, 1.0);
        (target / 250.0 + 0.15 * target.signum() + 0.002 * (target - speed) + self.sum)
            .clamp(-1.0, 1.0)
    }
}

/// Wheel speeds (left, right) towards a goal, mm/s, or `None` when there.
fn steer(pose: &Pose2, goal: &Pose2) -> Option<(f64, f64)> {
    let distance = pose.distance_mm(goal);
    if distance < 20.0 {
        return None;
    }
    let towards = goal.relative_to(pose);
    let off = towards.y_mm.atan2(towards.x_mm);
    if off.abs() > 0.3 {
        let turn = ABOUT * off.signum();
        return Some((-turn, turn));
    }
    let (along, about) = (ALONG.min(distance + 30.0), 150.0 * off);
    Some((along - about, along + about))
}

/// Drives the whole tour of `room` with this robot and seed.
pub fn tour(room: &Room, params: Params, seed: u64) -> Drive {
    let walls = room.visible_surfaces();
    let start = room.start;
    let mut world = World::new(params, room.clone(), start, seed);
    let mut mapper = Mapper::new(Config::default());
    let (mut estimate, mut truth) = (Vec::new(), Vec::new());
    let mut wheels = (Wheel::default(), Wheel::default());
    let mut inputs = (MotorInput::COAST, MotorInput::COAST);
    let mut ranges = [None; 3];
    let mut odometry = start;
    let mut counts = plant::Sides::default();
    let mut goals = room.tour.iter();
    let mut goal = goals.next();
    let mut now = 0;
    while let (Some(target), true) = (goal, now < 1_000_000) {
        world.step(0.001, inputs.0, inputs.1);
        now += 1;
        let per_count = 80.0 * std::f64::consts::PI / 3840.0;
        if now % CONTROL_MS == 0 {
            let new = world.wheel_counts();
            // The encoders count down going forward.
            let travel = new.map(|count| -count as f64 * per_count);
            let rolled = new.zip(counts).map(|(b, a)| (a - b) as f64 * per_count);
            odometry = odometry.advance_arc(rolled.left, rolled.right, 125.0);
            counts = new;
            match steer(&odometry, target) {
                Some((left, right)) => {
                    inputs.0 = MotorInput::run(wheels.0.duty(left, travel.left));
                    inputs.1 = MotorInput::run(wheels.1.duty(right, travel.right));
                }
                None => goal = goals.next(),
            }
        }
        if now % TURN_MS == 0 {
            let sensor = (now / TURN_MS % 3) as usize;
            // The wire's coding: 65535 steps to 2500 mm, and nothing beyond.
            let code = world
                .range_mm(sensor)
                .map(|mm| (mm * 65535.0 / 2500.0).round());
            ranges[sensor] = code.filter(|c| *c < 65535.0).map(|c| c * 2500.0 / 65535.0);
        }
        if now % FRAME_MS == 0 {
            mapper.observe(&odometry, &ranges);
            estimate.push(odometry);
            truth.push(world.pose());
        }
    }
    assert!(
        goal.is_none(),
        "the tour was not finished: {:?}",
        world.pose()
    );
    Drive {
        mapper,
        estimate,
        truth,
        walls,
        world,
    }
}
