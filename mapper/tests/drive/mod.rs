//! Drives the modelled robot along the default room's tour and gives the mapper what the wire would
//! carry: the pose of the wheels' counts, and ranges that are up to three measuring cycles old.

use mapper::{Config, Mapper, Pose, Segment};
use plant::{MotorInput, Params, Room, World};

/// What a drive leaves behind.
pub struct Drive {
    /// The map.
    pub mapper: Mapper,
    /// The believed path.
    pub believed: Vec<Pose>,
    /// The true path.
    pub truth: Vec<Pose>,
    /// The walls that can be seen.
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
    /// Duty for a wanted speed (mm/s), from the wheel's travel (mm).
    fn duty(&mut self, wanted: f64, travel: f64) -> f64 {
        let speed = (travel - self.last) * 1000.0 / CONTROL_MS as f64;
        self.last = travel;
        self.sum = (self.sum + 0.00008 * (wanted - speed)).clamp(-1.0, 1.0);
        (wanted / 250.0 + 0.15 * wanted.signum() + 0.002 * (wanted - speed) + self.sum)
            .clamp(-1.0, 1.0)
    }
}

/// Wanted wheel speeds towards a way-point, or `None` when there.
fn steer(pose: &Pose, way: &plant::Pose) -> Option<(f64, f64)> {
    let (dx, dy) = (way.x_mm - pose.x_mm, way.y_mm - pose.y_mm);
    let distance = dx.hypot(dy);
    if distance < 20.0 {
        return None;
    }
    let off = (dy.atan2(dx) - pose.heading_rad + std::f64::consts::PI)
        .rem_euclid(std::f64::consts::TAU)
        - std::f64::consts::PI;
    if off.abs() > 0.3 {
        let turn = ABOUT * off.signum();
        return Some((-turn, turn));
    }
    let (along, about) = (ALONG.min(distance + 30.0), 150.0 * off);
    Some((along - about, along + about))
}

/// Drives the whole tour of `room` with this robot and this chance.
pub fn tour(room: &Room, params: Params, seed: u64) -> Drive {
    let walls = room
        .visible_surfaces()
        .iter()
        .map(|s| Segment::new(s.x1, s.y1, s.x2, s.y2))
        .collect();
    let start = room.start;
    let mut world = World::new(params, room.clone(), start, seed);
    let mut mapper = Mapper::new(Config::default());
    let (mut believed, mut truth) = (Vec::new(), Vec::new());
    let mut wheels = (Wheel::default(), Wheel::default());
    let mut inputs = (MotorInput::COAST, MotorInput::COAST);
    let mut ranges = [None; 3];
    let mut odometry = start;
    let mut counts = (0, 0);
    let mut ways = room.tour.iter();
    let mut way = ways.next();
    let mut now = 0;
    while let (Some(target), true) = (way, now < 1_000_000) {
        world.step(0.001, inputs.0, inputs.1);
        now += 1;
        let per_count = 80.0 * std::f64::consts::PI / 3840.0;
        if now % CONTROL_MS == 0 {
            let new = world.wheel_counts();
            // The encoders count down going forward.
            let rolled = |a: i64, b: i64| (a - b) as f64 * per_count;
            odometry = odometry.rolled(rolled(counts.0, new.0), rolled(counts.1, new.1), 125.0);
            counts = new;
            let pose = own(&odometry);
            match steer(&pose, target) {
                Some((left, right)) => {
                    inputs.0 = MotorInput::run(wheels.0.duty(left, -new.0 as f64 * per_count));
                    inputs.1 = MotorInput::run(wheels.1.duty(right, -new.1 as f64 * per_count));
                }
                None => way = ways.next(),
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
            let pose = own(&odometry);
            mapper.observe(&pose, &ranges);
            believed.push(pose);
            truth.push(own(&world.pose()));
        }
    }
    assert!(
        way.is_none(),
        "the tour was not finished: {:?}",
        world.pose()
    );
    Drive {
        mapper,
        believed,
        truth,
        walls,
        world,
    }
}

fn own(pose: &plant::Pose) -> Pose {
    Pose::new(pose.x_mm, pose.y_mm, pose.heading_rad)
}
