//! T7: motor commands keep each wheel's limit for every identified gain.

use fw_core::eeprom::Config;
use fw_core::eeprom::fields::{DEAD_ZONE_LEFT, DEAD_ZONE_RIGHT};
use fw_core::motion::mixer::Mixer;

use fixed::types::I16F16;

use crate::eeprom::accepted::AcceptedConfig;
use crate::property::Seen;
use fw_core::types::{Delta, MotorCommand, MotorCommands};

/// Counts per duty of the left and the right motor, as identified.
type Gains = (u32, u32);

/// The mixer of an accepted configuration with these gains, and that.
fn mixer_of(values: &AcceptedConfig, (left, right): Gains) -> Option<(Mixer, Config)> {
    let (accepted, config) = values.checked();
    accepted.then(|| (Mixer::new(&config).with_gains(left, right), config))
}

/// The duty of a motor that runs, forward positive, hundredths of a percent.
fn forward_duty(drive: MotorCommand, reversed: bool) -> i32 {
    let MotorCommand::Run(duty) = drive else {
        panic!("not driven: {drive:?}");
    };
    let duty = i32::from(duty.hundredths());
    if reversed { -duty } else { duty }
}

/// Both of them.
fn duties(commands: MotorCommands, config: &Config) -> [i32; 2] {
    [
        forward_duty(commands.left, config.left().motor_reversed),
        forward_duty(commands.right, config.right().motor_reversed),
    ]
}

/// The limits of page 0x03, hundredths of a percent.
fn limits(config: &Config) -> [i32; 2] {
    [config.left(), config.right()].map(|wheel| wheel.limit.hundredths().into())
}

/// Both factors are within ¼ ..= 1, and the weaker wheel's is 1.
fn gain_balance_is_in_range(mixer: &Mixer) -> bool {
    let (left, right) = mixer.gain_balance();
    left.min(right) >= I16F16::ONE / 4 && left.max(right) == I16F16::ONE
}

/// No output makes a duty beyond the wheel's limit, on any platform, for any identified gains; output 0 is
/// duty 0.
// Requirement: WIRE-eeprom-6
pub fn duty_keeps_its_wheels_limit(
    values: AcceptedConfig,
    gains: Gains,
    forward: i32,
    rotation: i32,
) -> Seen {
    given!(let Some((mut mixer, config)) = mixer_of(&values, gains));
    assert!(gain_balance_is_in_range(&mixer));
    let most = limits(&config);
    let within = |commands| {
        let duties = duties(commands, &config);
        assert!(duties[0].abs() <= most[0] && duties[1].abs() <= most[1]);
        assert!(forward != 0 || rotation != 0 || duties == [0; 2]);
        duties
    };
    let _ = within(mixer.mix(I16F16::from_bits(forward), I16F16::from_bits(rotation)));
    // The velocity controller asks for no more.
    let [left, right] = [forward, rotation].map(|output| output.clamp(-(600 << 16), 600 << 16));
    let duties = within(mixer.each(left, right));
    seen!(
        duties[0].abs() == most[0] || duties[1].abs() == most[1],
        duties[0] > 0 && duties[1] < 0,
        forward == 0 && rotation == 0
    )
}

/// Duties of the tuning modes are limited per wheel and else exact, without compensation.
// Requirement: DOC-5.2.2-1, WIRE-eeprom-6
pub fn raw_duty_is_exact_within_limits(
    values: AcceptedConfig,
    gains: Gains,
    left: i32,
    right: i32,
) -> Seen {
    given!(let Some((mut mixer, config)) = mixer_of(&values, gains));
    let duties = duties(mixer.raw(left, right), &config);
    for ((requested, limit), duty) in [left, right].into_iter().zip(limits(&config)).zip(duties) {
        assert!(duty == requested.clamp(-limit, limit));
    }
    assert!(mixer.brake() == MotorCommands::BRAKE);
    seen!(
        duties == [left, right],
        duties[0] != left,
        duties[1] != right
    )
}

/// The duty is monotone in the output, in the dead zone and across it; from 1 % of scaled output on it
/// exceeds the dead zone.
pub fn compensation_is_monotone(
    values: AcceptedConfig,
    gains: Gains,
    less: i32,
    more: i32,
) -> Seen {
    given!(less <= more);
    given!(let Some((mixer, config)) = mixer_of(&values, gains));
    let straight = |output: i32| {
        let commands = mixer.clone().mix(I16F16::from_bits(output), I16F16::ZERO);
        duties(commands, &config)
    };
    let (low, high) = (straight(less), straight(more));
    assert!(low[0] <= high[0] && low[1] <= high[1]);
    let dead_zones =
        [config.left(), config.right()].map(|wheel| i32::from(wheel.dead_zone.hundredths()));
    // A factor is at least a quarter, and both wheels need the headroom.
    let enough = limits(&config)
        .into_iter()
        .zip(dead_zones)
        .all(|(limit, dead_zone)| limit - dead_zone >= 400);
    let moves = enough && more >= 4 << 16;
    if moves {
        assert!(high[0] >= dead_zones[0] && high[1] >= dead_zones[1]);
    }
    seen!(
        moves && high[0] < 9_000,
        low[0] <= 0 && high[0] > 0,
        low[0] > 0 && low[0] < high[0]
    )
}

/// Rotation has priority: it is exact up to the largest output, and forward gets the headroom, in the same
/// proportion on both wheels. On a platform without dead zones, to 0.03 %.
pub fn rotation_has_priority(
    values: AcceptedConfig,
    gains: Gains,
    forward: i32,
    rotation: i32,
) -> Seen {
    let values = values.with(DEAD_ZONE_LEFT, 0).with(DEAD_ZONE_RIGHT, 0);
    given!(let Some((mut mixer, config)) = mixer_of(&values, gains));
    let (left_balance, right_balance) = mixer.gain_balance();
    let balance = [left_balance.to_bits(), right_balance.to_bits()].map(i64::from);
    let commands = mixer.mix(I16F16::from_bits(forward), I16F16::from_bits(rotation));
    let [left, right] = duties(commands, &config);
    // From here on in half hundredths of a percent.
    let output = |duty: i32, balance: i64| (i64::from(duty) << 17) / balance;
    let (left, right) = (output(left, balance[0]), output(right, balance[1]));
    let (ahead, turn) = ((left + right) >> 1, (right - left) >> 1);
    let max_output = limits(&config)
        .into_iter()
        .zip(balance)
        .map(|(limit, balance)| output(limit, balance))
        .fold(2 * 10_000, i64::min);
    let twice = |percent: i32| (i64::from(percent) * 200) >> 16;
    let expected_turn = twice(rotation).clamp(-max_output, max_output);
    let headroom = max_output - expected_turn.abs();
    let expected_ahead = twice(forward).clamp(-headroom, headroom);
    assert!((turn - expected_turn).abs() <= 6 && (ahead - expected_ahead).abs() <= 6);
    seen!(
        twice(forward).abs() > headroom && headroom > 100,
        twice(rotation).abs() > max_output,
        expected_ahead == twice(forward) && expected_turn == twice(rotation)
    )
}

/// For any outputs and motions no overflow, both factors within ¼ ..= 1, and the weaker wheel's is 1.
pub fn gain_balance_stays_in_range(values: AcceptedConfig, script: [u8; 64]) -> Seen {
    given!(let Some(config) = values.config());
    let mut mixer = Mixer::new(&config);
    let mut identified = false;
    for event in script.chunks_exact(4) {
        let [kind, output, left, right] = [event[0], event[1], event[2], event[3]];
        // Up to the range of the counters.
        let large = |byte: u8| (i32::from(byte) - 128) << (kind % 25);
        let percent = I16F16::from_bits((i32::from(output) - 128) << 16);
        let delta = Delta::rolled(large(left), large(right));
        for tick in 0..kind {
            let turn = if tick % 8 == 7 { percent } else { I16F16::ZERO };
            let _ = mixer.mix(percent, turn);
            mixer.observe(&delta);
        }
        if kind % 16 == 0 {
            let _ = mixer.brake();
        }
        assert!(gain_balance_is_in_range(&mixer));
        let (left, right) = mixer.gain_balance();
        identified |= left != right;
    }
    let (left, right) = mixer.gain_balance();
    seen!(identified, left < I16F16::ONE, right < I16F16::ONE)
}

/// Two outputs next to each other: that the duty is monotone in all follows.
#[cfg(kani)]
const fn neighbours(less: i32) -> (AcceptedConfig, Gains, i32, i32) {
    let more = less.saturating_add(1);
    (AcceptedConfig::FIRST_BOARD, (1, 1), less, more)
}

crate::properties! {
    property T7 duty_keeps_its_wheels_limit(
        values: AcceptedConfig, gains: Gains, forward: i32, rotation: i32
    ) {
        cases ["at a limit", "on the spot", "no output"];
        needs [accepted_configuration_is_bounded];
        kani any_limits [unwind(80)] = (
            AcceptedConfig::of_any(|field| matches!(field.address, 0x0320 | 0x0322)), (1, 1), any(), any()
        );
        kani any_dead_zones [unwind(80)] = (
            AcceptedConfig::of_any(|field| matches!(field.address, 0x031C | 0x031E)), (1, 1), any(), any()
        );
        sampled 100_000;
    }
    theorem T7 raw_duty_is_exact_within_limits(
        values: AcceptedConfig, gains: Gains, left: i32, right: i32
    ) {
        cases ["exact", "the left one at its limit", "the right one at its limit"];
        needs [accepted_configuration_is_bounded];
        kani any_platform [unwind(80)] = (AcceptedConfig::of_any_page(3), any(), any(), any());
        sampled 100_000;
    }
    property T7 compensation_is_monotone(
        values: AcceptedConfig, gains: Gains, less: i32, more: i32
    ) {
        cases ["past the dead zone", "across zero", "forwards"];
        needs [accepted_configuration_is_bounded, gain_balance_stays_in_range];
        kani unlearned [unwind(80)] = neighbours(any());
        sampled 100_000;
    }
    property T7 rotation_has_priority(
        values: AcceptedConfig, gains: Gains, forward: i32, rotation: i32
    ) {
        cases ["forward reduced", "rotation limited", "both fit"];
        needs [accepted_configuration_is_bounded, gain_balance_stays_in_range];
        sampled 100_000;
    }
    property T7 gain_balance_stays_in_range(values: AcceptedConfig, script: [u8; 64]) {
        cases ["they differed", "the left wheel is stronger", "the right wheel is stronger"];
        needs [accepted_configuration_is_bounded];
        sampled 20_000;
    }
}
