//! T7: what the motors are told keeps each wheel's limit, whatever the mixer has learned.

#[cfg(kani)]
use fw_core::eeprom::first_board;
use fw_core::eeprom::Platform;
use fw_core::motion::mixer::Mixer;

use fixed::types::I16F16;

use crate::eeprom::accepted::AcceptedConfig;
use crate::input::{Input, Source};
use crate::property::Seen;
use fw_core::types::{Delta, MotorCommand, MotorCommands};

/// How a mixer came to know its wheels: it drove straight on, and each rolled so many counts a tick.
#[derive(Clone, Copy, Debug)]
pub struct Driven {
    /// For so long.
    pub ticks: u8,
    /// Told so much, 2⁻¹⁶ %.
    pub forward: i32,
    /// Counts a tick.
    pub left: i16,
    /// Counts a tick.
    pub right: i16,
}

impl Driven {
    /// Just switched on.
    #[cfg(kani)]
    const NOT: Self = Self {
        ticks: 0,
        forward: 0,
        left: 0,
        right: 0,
    };

    /// At three quarters of full drive, just until what was learned counts for the first time.
    #[cfg(kani)]
    const fn far_enough(left: i16, right: i16) -> Self {
        Self {
            ticks: 22,
            forward: 75 << 16,
            left,
            right,
        }
    }

    fn mixer(&self, platform: &Platform) -> Mixer {
        let mut mixer = Mixer::new(platform);
        let delta = Delta {
            left: self.left.into(),
            right: self.right.into(),
            ..Delta::default()
        };
        for _ in 0..self.ticks {
            let _ = mixer.mix(I16F16::from_bits(self.forward), I16F16::ZERO);
            mixer.observe(&delta);
        }
        mixer
    }
}

/// A platform that keeps what an accepted one does, and its mixer, driven so.
fn driven_on(config: AcceptedConfig, driven: Driven) -> Option<(Platform, Mixer)> {
    let platform = config.bounded()?.platform;
    Some((platform, driven.mixer(&platform)))
}

impl Input for Driven {
    fn draw(source: &mut impl Source) -> Self {
        // Counts that a wheel makes as often as any.
        let counts = |source: &mut _| {
            let any = i16::draw(source);
            if bool::draw(source) {
                any >> 8
            } else {
                any
            }
        };
        Self {
            ticks: Input::draw(source),
            forward: i32::draw(source) >> (u8::draw(source) % 16),
            left: counts(source),
            right: counts(source),
        }
    }
}

/// The duty of a motor that runs, forward positive, hundredths of a percent.
fn forward_duty(drive: MotorCommand, reversed: bool) -> i32 {
    let MotorCommand::Run(duty) = drive else {
        panic!("a motor that was given an output does not run: {drive:?}");
    };
    let duty = i32::from(duty.hundredths());
    if reversed {
        -duty
    } else {
        duty
    }
}

/// Both of them.
fn duties(wheels: MotorCommands, platform: &Platform) -> [i32; 2] {
    [
        forward_duty(wheels.left, platform.motor_left_reversed),
        forward_duty(wheels.right, platform.motor_right_reversed),
    ]
}

/// The limits of page 0x03, hundredths of a percent.
fn limits(platform: &Platform) -> [i32; 2] {
    [platform.limit_left.into(), platform.limit_right.into()]
}

/// A share is a quarter at least and 1 at most, and the weaker wheel's is 1.
fn shares_are_in_range(mixer: &Mixer) -> bool {
    let (left, right) = mixer.gain_balance();
    left.min(right) >= I16F16::ONE / 4 && left.max(right) == I16F16::ONE
}

/// No output, however large, is a duty beyond its wheel's limit, whatever has been learned of the
/// wheels, and that is a share in its range; no output at all is a duty of zero.
// Requirement: WIRE-eeprom-6
pub fn duty_keeps_its_wheels_limit(
    config: AcceptedConfig,
    driven: Driven,
    forward: i32,
    rotation: i32,
) -> Seen {
    let Some((platform, mut mixer)) = driven_on(config, driven) else {
        return Seen::NOTHING;
    };
    assert!(shares_are_in_range(&mixer));
    let wheels = mixer.mix(I16F16::from_bits(forward), I16F16::from_bits(rotation));
    let duties = duties(wheels, &platform);
    let [left, right] = limits(&platform);
    assert!(duties[0].abs() <= left && duties[1].abs() <= right);
    if forward == 0 && rotation == 0 {
        assert!(duties[0] == 0 && duties[1] == 0);
    }
    Seen::NOTHING
        .case(0, duties[0].abs() == left || duties[1].abs() == right)
        .case(1, duties[0] > 0 && duties[1] < 0)
        .case(2, forward == 0 && rotation == 0)
}

/// The constant duties of the tuning modes are held within each wheel's limit and are else what the Pi
/// asked for: nothing is added for the dead zone, nothing that was learned counts.
// Requirement: DOC-5.2.2-1, WIRE-eeprom-6
pub fn raw_duty_is_what_was_asked(
    config: AcceptedConfig,
    driven: Driven,
    left: i32,
    right: i32,
) -> Seen {
    let Some((platform, mut mixer)) = driven_on(config, driven) else {
        return Seen::NOTHING;
    };
    let duties = duties(mixer.raw(left, right), &platform);
    for ((asked, limit), duty) in [left, right].into_iter().zip(limits(&platform)).zip(duties) {
        assert!(duty == asked.clamp(-limit, limit));
    }
    assert!(mixer.brake() == MotorCommands::BRAKE);
    Seen::NOTHING
        .case(0, duties[0] == left && duties[1] == right)
        .case(1, duties[0] != left)
        .case(2, duties[1] != right)
}

/// More output is never less duty, in the dead zone and across it; an output that a wheel's share
/// leaves 1 % of has passed the dead zone.
pub fn compensation_is_monotone(
    config: AcceptedConfig,
    driven: Driven,
    less: i32,
    more: i32,
) -> Seen {
    if less > more {
        return Seen::NOTHING;
    }
    let Some((platform, mixer)) = driven_on(config, driven) else {
        return Seen::NOTHING;
    };
    let straight = |output: i32| {
        let wheels = mixer.clone().mix(I16F16::from_bits(output), I16F16::ZERO);
        duties(wheels, &platform)
    };
    let (low, high) = (straight(less), straight(more));
    assert!(low[0] <= high[0] && low[1] <= high[1]);
    let dead_zones = [
        i32::from(platform.dead_zone_left),
        i32::from(platform.dead_zone_right),
    ];
    // A wheel's share is a quarter at least, and both must have the room.
    let roomy = limits(&platform)
        .into_iter()
        .zip(dead_zones)
        .all(|(limit, dead_zone)| limit - dead_zone >= 400);
    let moves = roomy && more >= 4 << 16;
    if moves {
        assert!(high[0] >= dead_zones[0] && high[1] >= dead_zones[1]);
    }
    Seen::NOTHING
        .case(0, moves && high[0] < 9_000)
        .case(1, low[0] < 0 && high[0] > 0)
        .case(2, low[0] > 0 && low[0] < high[0])
}

/// Rotation goes first: the robot turns as it should wherever the wheels can follow that at all, and
/// forward gets what they have left, in the same proportion on both. On a platform without dead
/// zones, where duties show the outputs; to 0.03 %.
pub fn rotation_goes_first(
    config: AcceptedConfig,
    driven: Driven,
    forward: i32,
    rotation: i32,
) -> Seen {
    let AcceptedConfig(mut config) = config;
    (
        config.platform.dead_zone_left,
        config.platform.dead_zone_right,
    ) = (0, 0);
    let Some((platform, mut mixer)) = driven_on(AcceptedConfig(config), driven) else {
        return Seen::NOTHING;
    };
    let (left_share, right_share) = mixer.gain_balance();
    let shares = [left_share.to_bits(), right_share.to_bits()].map(i64::from);
    let wheels = mixer.mix(I16F16::from_bits(forward), I16F16::from_bits(rotation));
    let [left, right] = duties(wheels, &platform);
    // Twice hundredths of a percent, from here on.
    let output = |duty: i32, share: i64| (i64::from(duty) << 17) / share;
    let (left, right) = (output(left, shares[0]), output(right, shares[1]));
    let (ahead, turn) = ((left + right) >> 1, (right - left) >> 1);
    let reach = limits(&platform)
        .into_iter()
        .zip(shares)
        .map(|(limit, share)| output(limit, share))
        .fold(2 * 10_000, i64::min);
    let twice = |percent: i32| (i64::from(percent) * 200) >> 16;
    let wanted_turn = twice(rotation).clamp(-reach, reach);
    let room = reach - wanted_turn.abs();
    let wanted_ahead = twice(forward).clamp(-room, room);
    assert!((turn - wanted_turn).abs() <= 6 && (ahead - wanted_ahead).abs() <= 6);
    Seen::NOTHING
        .case(0, twice(forward).abs() > room && room > 100)
        .case(1, twice(rotation).abs() > reach)
        .case(
            2,
            wanted_ahead == twice(forward) && wanted_turn == twice(rotation),
        )
}

/// Whatever the wheels did while whatever they were told: nothing overflows, a share is a quarter at
/// least and 1 at most, and the weaker wheel's is 1.
pub fn shares_keep_their_range(config: AcceptedConfig, script: [u8; 64]) -> Seen {
    let mut mixer = Mixer::new(&config.0.platform);
    let mut learned = false;
    for event in script.chunks_exact(4) {
        let [kind, output, left, right] = [event[0], event[1], event[2], event[3]];
        // Up to what 16-bit and 32-bit counters can show, and some time of each.
        let large = |byte: u8| (i32::from(byte) - 128) << (kind % 25);
        let percent = I16F16::from_bits((i32::from(output) - 128) << 16);
        let delta = Delta {
            left: large(left),
            right: large(right),
            ..Delta::default()
        };
        for tick in 0..kind {
            let turn = if tick % 8 == 7 { percent } else { I16F16::ZERO };
            let _ = mixer.mix(percent, turn);
            mixer.observe(&delta);
        }
        if kind % 16 == 0 {
            let _ = mixer.brake();
        }
        assert!(shares_are_in_range(&mixer));
        let (left, right) = mixer.gain_balance();
        learned |= left != right;
    }
    let (left, right) = mixer.gain_balance();
    Seen::NOTHING
        .case(0, learned)
        .case(1, left < I16F16::ONE)
        .case(2, right < I16F16::ONE)
}

/// The first board's dead zones and any limits.
#[cfg(kani)]
fn of_any_limits() -> AcceptedConfig {
    let mut config = first_board();
    config.platform.limit_left = crate::input::any();
    config.platform.limit_right = crate::input::any();
    AcceptedConfig(config)
}

crate::properties! {
    property T7 duty_keeps_its_wheels_limit(
        config: AcceptedConfig, driven: Driven, forward: i32, rotation: i32
    ) {
        cases ["at a limit", "on the spot", "nothing asked"];
        needs [accepted_configuration_is_bounded, shares_keep_their_range];
        kani any_limits [unwind(4)] = (of_any_limits(), Driven::NOT, any(), any());
        kani any_shares [unwind(24)] =
            (AcceptedConfig(first_board()), Driven::far_enough(any(), any()), any(), any());
        sampled 100_000;
    }
    property T7 raw_duty_is_what_was_asked(
        config: AcceptedConfig, driven: Driven, left: i32, right: i32
    ) {
        cases ["exact", "the left one at its limit", "the right one at its limit"];
        needs [accepted_configuration_is_bounded];
        kani any_platform [unwind(4)] =
            (AcceptedConfig::of_any_platform(), Driven::NOT, any(), any());
        sampled 100_000;
    }
    property T7 compensation_is_monotone(
        config: AcceptedConfig, driven: Driven, less: i32, more: i32
    ) {
        cases ["past the dead zone", "across zero", "forwards"];
        needs [accepted_configuration_is_bounded, shares_keep_their_range];
        kani unlearned [unwind(4)] =
            (AcceptedConfig(first_board()), Driven::NOT, any(), any());
        sampled 100_000;
    }
    property T7 rotation_goes_first(
        config: AcceptedConfig, driven: Driven, forward: i32, rotation: i32
    ) {
        cases ["forward gave way", "even the rotation is cut", "both fit"];
        needs [accepted_configuration_is_bounded, shares_keep_their_range];
        sampled 100_000;
    }
    property T7 shares_keep_their_range(config: AcceptedConfig, script: [u8; 64]) {
        cases ["they differed", "the left wheel is stronger", "the right wheel is stronger"];
        needs [accepted_configuration_is_bounded];
        sampled 20_000;
    }
}
