//! T9: the scan servo. No pulses without a live link, and no trigger before the servo is at the reading's
//! bearing.

use fw_core::sensing::{Rangefinders, ServoScan};

use crate::eeprom::accepted::AcceptedConfig;
use crate::property::Seen;
use fw_core::eeprom::fields::SERVO;
use fw_core::types::{Micros, RangefinderId};

/// Ticks per bit of `live`.
const TICKS_PER_BIT: u32 = 16;
/// Speed of a servo of 60° in 0.15 s, 2⁻³² turns/µs; 10 ms are 4°.
const SPEED: i64 = (1 << 32) / 900_000;

/// A servo as slow as the scan allows for; it turns towards its last pulse.
struct Servo {
    /// 2⁻³² turns from the centre of its travel.
    at: i64,
    target: i64,
    travel: i64,
}

impl Servo {
    fn turn(&mut self, us: i64) {
        let way = us * SPEED;
        self.at += (self.target - self.at).clamp(-way, way);
    }

    fn tick(&mut self, pulse: Option<u16>) {
        // A pulse takes effect at its end.
        let width = pulse.map_or(0, i64::from);
        self.turn(width);
        if let Some(width) = pulse {
            self.target = (i64::from(width) - 1500) * self.travel / 1000;
        }
        self.turn(10_000 - width);
    }
}

/// For any accepted configuration with a servo, any initial position and interruptions of the link: pulses
/// are 1.0 to 2.0 ms long, 20 ms apart and only sent on a live link; at every trigger the servo is
/// within 0.1° of the reading's bearing.
pub fn servo_is_at_the_bearing_of_the_reading(
    values: AcceptedConfig,
    start: u16,
    live: u64,
) -> Seen {
    given!(let Some(config) = values.with(SERVO, 1).config());
    let scans = config.mode() == fw_core::wire::Mode::GuardedSweep;
    let front = config.bearing(RangefinderId::Front).0;
    let fw_core::eeprom::Servo { travel, reversed } = config.servo().expect("it has one");
    let signed = if reversed { -1 } else { 1 } * i64::from(travel.0);
    let mut servo = Servo {
        at: signed * (i64::from(start) - 0x8000) / 0x10000,
        target: 0,
        travel: signed,
    };
    servo.target = servo.at;
    let mut scan = ServoScan::new(&config, scans);
    let mut all = Rangefinders::new(1);
    let (mut triggers, mut last_pulse, mut last_bearing, mut repeated) = (0, None, None, false);
    for tick in 0..64 * TICKS_PER_BIT {
        let live = live >> (tick / TICKS_PER_BIT) & 1 != 0;
        let pulse = scan.tick(live);
        if let Some(width) = pulse {
            assert!(live && (1000..=2000).contains(&width));
            assert!(last_pulse.is_none_or(|last| tick - last >= 2));
            last_pulse = Some(tick);
        } else if !live {
            last_pulse = None;
            // Without pulses it may be turned by force.
            if scan.is_off() {
                servo.at = -servo.at;
                servo.target = servo.at;
                last_bearing = None;
            }
        }
        let now = Micros(tick * 10_000);
        if all.tick(now, scan.settled_bearing(), false) == Some(RangefinderId::Front) {
            scan.triggered();
            all.echo(RangefinderId::Front, now.after(500), now.after(9_500));
            let bearing = all.reading(RangefinderId::Front).bearing;
            let turns = (u32::from(bearing) << 16).wrapping_sub(front);
            let bearing_off = 0_i32.wrapping_add_unsigned(turns);
            // Half a turn is half a turn either way.
            let off = (i64::from(bearing_off) - servo.at).unsigned_abs() % (1 << 32);
            assert!(off.min((1 << 32) - off) < (1 << 32) / 3600);
            assert!(scans || bearing_off == 0);
            repeated |= last_bearing == Some(bearing);
            last_bearing = Some(bearing);
            triggers += 1;
        }
        servo.tick(pulse);
    }
    // A tiny travel has one bearing only.
    assert!(!scans || !repeated || travel.0 >> 16 < 1000);
    Seen::NOTHING
        .case(0, scans && triggers > 100)
        .case(1, !scans && triggers > 0)
        .case(2, live == 0 && triggers == 0)
        .case(3, scans && triggers > 0 && live != u64::MAX)
}

/// Configurations that differ in every parameter of the scan.
#[cfg(test)]
fn configurations() -> impl Iterator<Item = AcceptedConfig> {
    use fw_core::eeprom::fields::{MODE, SERVO_REVERSED, SERVO_TRAVEL};
    use fw_core::wire::Mode::{GuardedNormal, GuardedSweep};
    (0..12_u8).map(|which| {
        let mode = [GuardedSweep, GuardedNormal][usize::from(which & 1)];
        AcceptedConfig::FIRST_BOARD
            .with(MODE, mode.code().into())
            .with(SERVO_REVERSED, (which >> 1 & 1).into())
            .with(SERVO_TRAVEL, [0, 0x2000, 0x8000][usize::from(which / 4)])
    })
}

crate::properties! {
    property T9 servo_is_at_the_bearing_of_the_reading(values: AcceptedConfig, start: u16, live: u64) {
        cases ["scanned", "parked", "never live", "interrupted"];
        needs [accepted_configuration_is_bounded];
        stepped configurations().flat_map(|values| {
            [0, 1, 0x8000, 0xFFFF].into_iter().flat_map(move |start| {
                [u64::MAX, 0, 0xFFFF_0000_0FFF_FF0F].map(move |live| (values, start, live))
            })
        });
        sampled 20_000;
    }
}
