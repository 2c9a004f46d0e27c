//! T5 and T6: the MPU6050 driver and the corrections of the heading.

use fw_core::eeprom::fields::{GYRO, MODE};
use fw_core::log::Log;
use fw_core::motion::Odometry;
use fw_core::robot::{Robot, TickInput};
use fw_core::sensing::gyro::{Event, GyroFusion, MAX_BIAS, hundredths};
use fw_core::sensing::mpu6050::{BusRequest, BusResult, GyroReading, Mpu6050};
use fw_core::wire::Mode;

use crate::eeprom::accepted::AcceptedConfig;
use crate::input::{Input, Source};
use crate::property::Seen;
use fw_core::types::{Delta, Faults, HeadingCorrection};

impl Input for BusResult {
    fn draw(source: &mut impl Source) -> Self {
        match source.bits8() % 8 {
            0 => Self::Done,
            1 => Self::Nack,
            2 => Self::Timeout,
            // Identity, settings, a rate.
            3 => Self::Bytes([0x68, source.bits8()]),
            4 => Self::Bytes([3, 8]),
            _ => Self::Bytes(source.bits16().to_be_bytes()),
        }
    }
}

/// A sequence of inputs.
#[derive(Clone, Copy, Debug)]
pub struct Sequence<T, const N: usize>([T; N]);

impl<T: Input, const N: usize> Input for Sequence<T, N> {
    fn draw(source: &mut impl Source) -> Self {
        Self(core::array::from_fn(|_| T::draw(source)))
    }
}

/// Inputs of a tick.
#[derive(Clone, Copy, Debug)]
pub struct Tick {
    reading: Option<i16>,
    turn: i32,
    left: i32,
    right: i16,
}

impl Input for Tick {
    fn draw(source: &mut impl Source) -> Self {
        let shape = source.bits8();
        let (turn, left) = <(i32, i32)>::draw(source);
        let (right, raw) = <(i16, i16)>::draw(source);
        let still = shape & 1 == 0;
        Self {
            reading: (shape & 0x30 != 0).then_some(raw),
            turn: if still { 0 } else { turn },
            left: if still { 0 } else { left },
            right: if still { 0 } else { right },
        }
    }
}

fn step(gyro: &mut GyroFusion, tick: Tick) -> (HeadingCorrection, Option<Event>) {
    let delta = Delta {
        turn: tick.turn,
        ..Delta::rolled(tick.left, tick.right.into())
    };
    gyro.step(tick.reading, &delta, tick.turn)
}

fn bounded(gyro: &GyroFusion) {
    if let Some(bias) = gyro.bias() {
        assert!(bias.abs() <= MAX_BIAS << 8);
        assert!(hundredths(bias).abs() <= 4_000);
    }
}

/// In the first ticks no readings, turns or counts overflow anything, and there is no correction without a
/// bias.
pub fn any_readings_are_safe(ticks: Sequence<Tick, 3>) -> Seen {
    let mut gyro = GyroFusion::new();
    let mut seen = Seen::NOTHING;
    for tick in ticks.0 {
        let (correction, event) = step(&mut gyro, tick);
        assert!(gyro.bias().is_none() && event.is_none());
        assert!(correction == HeadingCorrection::default());
        seen = seen
            .case(0, tick.reading.is_none())
            .case(1, tick.reading == Some(i16::MIN))
            .case(2, tick.turn == i32::MIN);
    }
    seen
}

/// After a rest with any bias, and where `verified` after a verification, for any inputs: no overflow, the
/// bias is bounded, there is no correction while the gyroscope is not trusted, and the end of a slip
/// reports the sum of its corrections.
pub fn any_readings_after_a_rest_are_safe(
    bias: i16,
    verified: bool,
    repeat: u8,
    ticks: Sequence<Tick, 8>,
) -> Seen {
    let mut gyro = GyroFusion::new();
    let rest = Tick {
        reading: Some(bias),
        turn: 0,
        left: 0,
        right: 0,
    };
    for _ in 0..84 {
        let _ = step(&mut gyro, rest);
    }
    let known = i32::from(bias).abs() <= MAX_BIAS;
    assert!(gyro.bias().is_some() == known);
    if verified && known {
        // 1° a tick by both: 6550 LSB are 100 °/s.
        let turn = Tick {
            reading: Some(bias + 6550),
            turn: 11_930_465,
            left: -10,
            right: 10,
        };
        let events = (0..11).filter_map(|_| step(&mut gyro, turn).1).count();
        assert!(events == 1);
    }
    let verified = verified && known;
    let mut added = 0_i64;
    let mut seen = seen!(!known, bias.saturating_abs() > 2_500 && verified);
    let mut trusted = verified;
    for tick in ticks.0 {
        for _ in 0..=repeat % 64 {
            let was_slipping = gyro.is_slipping();
            let (correction, event) = step(&mut gyro, tick);
            bounded(&gyro);
            assert!(trusted || correction == HeadingCorrection::default());
            if was_slipping || gyro.is_slipping() {
                seen = seen.case(2, true);
            } else {
                assert!(correction == HeadingCorrection::default());
            }
            added = added.wrapping_add(correction.heading.into());
            match event {
                Some(Event::SlipEnded(total)) => {
                    // Modulo a turn, as headings are.
                    assert!(total as i32 == added as i32);
                    seen = seen.case(3, true);
                    added = 0;
                }
                Some(Event::SlipTimedOut) => {
                    trusted = false;
                    added = 0;
                    seen = seen.case(4, true);
                }
                Some(Event::Trusted) => trusted = true,
                _ => {}
            }
        }
    }
    seen
}

/// Answers of a working part.
fn good(request: BusRequest) -> BusResult {
    match request {
        BusRequest::Read { register: 0x75, .. } => BusResult::Bytes([0x68, 0]),
        BusRequest::Read { register: 0x1A, .. } => BusResult::Bytes([3, 8]),
        BusRequest::Read { .. } => BusResult::Bytes([0, 1]),
        _ => BusResult::Done,
    }
}

/// From any stage of the set-up, for any results of the bus: every tick has a request, only registers of
/// the set-up are written, and a rate comes only from two bytes read.
pub fn mpu6050_driver_is_total(
    good_ticks: u8,
    results: Sequence<BusResult, 16>,
    repeat: u8,
) -> Seen {
    let mut mpu = Mpu6050::new();
    let mut seen = Seen::NOTHING;
    let mut request = BusRequest::Idle;
    for _ in 0..good_ticks % 64 {
        (request, _) = mpu.step(good(request));
    }
    for result in results.0 {
        for _ in 0..=repeat % 32 {
            let (request, reading) = mpu.step(result);
            match request {
                BusRequest::Write { register, .. } => {
                    assert!(matches!(register, 0x19..=0x1B | 0x6B));
                    seen = seen.case(0, true);
                }
                BusRequest::Read { register, count } => {
                    assert!(matches!((register, count), (0x75, 1) | (0x1A | 0x47, 2)));
                }
                BusRequest::DriveLines { .. } => seen = seen.case(1, true),
                BusRequest::Idle | BusRequest::ReleaseLines => {}
            }
            match reading {
                GyroReading::Rate(raw) => {
                    assert!(result == BusResult::Bytes(raw.to_be_bytes()));
                    seen = seen.case(2, true);
                }
                GyroReading::Lost(_) => seen = seen.case(3, true),
                GyroReading::None => {}
            }
        }
    }
    seen
}

/// A robot whose gyroscope never answers has to the last bit the pose of one without a gyroscope, and the
/// latter never requests the bus.
pub fn pose_without_gyro_is_the_encoders(
    values: AcceptedConfig,
    result: BusResult,
    steps: [(u8, u8); 24],
) -> Seen {
    if matches!(result, BusResult::Bytes(_)) {
        return Seen::NOTHING.case(0, true);
    }
    let plain = values.with(MODE, Mode::GuardedNormal.code().into());
    given!(let Some(fitted) = plain.with(GYRO, 1).config());
    given!(let Some(plain) = plain.with(GYRO, 0).config());
    let mut sample = TickInput::default();
    let mut log = Log::new();
    let mut alone = Robot::new(&plain, sample);
    let mut with = Robot::new(&fitted, sample);
    for (left, right) in steps {
        for _ in 0..4 {
            sample.now = sample.now.after(10_000);
            sample.left = sample.left.wrapping_add_signed(i32::from(left) - 128);
            sample.right = sample.right.wrapping_add_signed(i16::from(right) - 128);
            assert!(alone.on_gyro(result, &mut log) == BusRequest::Idle);
            let _ = with.on_gyro(result, &mut log);
            let outputs = alone.on_tick(sample, &[], &mut log);
            assert!(outputs == with.on_tick(sample, &[], &mut log));
            assert!(alone.pose() == with.pose());
            assert!(!with.faults().intersects(Faults::SLIP));
            assert!(!alone.faults().intersects(Faults::GYRO_LOST));
        }
    }
    Seen::NOTHING
        .case(1, with.faults().intersects(Faults::GYRO_LOST))
        .case(2, with.pose() != first_pose())
}

fn first_pose() -> fw_core::types::Pose {
    let config = AcceptedConfig::FIRST_BOARD.config().expect("accepted");
    Robot::new(&config, TickInput::default()).pose()
}

/// No correction of any tick overflows; it is added to the heading to the last bit, and moves the position
/// only if a wheel rolled.
pub fn any_correction_is_safe(
    values: AcceptedConfig,
    before: (u32, u16),
    counters: (u32, u16),
    heading: u32,
    tick: u32,
) -> Seen {
    given!(let Some(config) = values.config());
    let mut odometry = Odometry::new(&config, 0, 0);
    let _ = odometry.step(before.0, before.1);
    let delta = odometry.step(counters.0, counters.1);
    let was = odometry.pose();
    let correction = HeadingCorrection {
        heading: heading as i32,
        tick: tick as i32,
    };
    odometry.apply_slip(correction, &delta);
    let is = odometry.pose();
    assert!(is.heading.0 == was.heading.0.wrapping_add(heading));
    let moved = is.x != was.x || is.y != was.y;
    assert!(!moved || delta.left != 0 || delta.right != 0);
    seen!(moved, !moved && correction.tick != 0)
}

crate::properties! {
    theorem T5 any_readings_are_safe(ticks: Sequence<Tick, 3>) {
        cases ["no reading", "the end of the range", "half a turn in a tick"];
        kani proof [unwind(33)];
        sampled 100_000;
    }
    property T5 any_readings_after_a_rest_are_safe(
        bias: i16, verified: bool, repeat: u8, ticks: Sequence<Tick, 8>
    ) {
        cases [
            "an implausible bias", "a large bias", "a slip", "a slip that ended",
            "a slip that timed out"
        ];
        sampled 100_000;
    }
    property T5 mpu6050_driver_is_total(good_ticks: u8, results: Sequence<BusResult, 16>, repeat: u8) {
        cases ["set up", "the bus was freed", "a rate", "lost"];
        // From the last three settings through their verification to the first rates.
        kani settling [unwind(30)] = (28, any(), 0);
        sampled 100_000;
    }
    property T6 pose_without_gyro_is_the_encoders(
        values: AcceptedConfig, result: BusResult, steps: [(u8, u8); 24]
    ) {
        cases ["it answered", "its absence is a fault", "the robot moved"];
        needs [accepted_configuration_is_bounded];
        sampled 20_000;
    }
    property T5 any_correction_is_safe(
        values: AcceptedConfig, before: (u32, u16), counters: (u32, u16), heading: u32, tick: u32
    ) {
        cases ["a wheel slipped", "no wheel rolled"];
        needs [accepted_configuration_is_bounded];
        sampled 100_000;
    }
}
