//! T9: the servo of the swept rangefinder. Nothing turns while nobody talks to the robot, and no reading is
//! taken before the servo stands where the reading's bearing says.

use fw_core::sensing::{Rangefinders, ServoScan};

use crate::eeprom::accepted::AcceptedConfig;
use crate::property::Seen;
use fw_core::types::{Micros, RangefinderId};

/// Ticks that are told one by one whether somebody talks to the robot; after each word, all alike.
const WORD: u32 = 16;
/// A servo of 60° in 0.15 s turns so far in a microsecond, turn × 2⁻³²; 10 ms are 4°.
const PACE: i64 = (1 << 32) / 900_000;

/// A servo as slow as the plan allows for: it turns towards its last pulse, as long as pulses come.
struct Servo {
    /// Turn × 2⁻³² from the middle of its travel.
    at: i64,
    told: i64,
    travel: i64,
}

impl Servo {
    fn turn(&mut self, us: i64) {
        let way = us * PACE;
        self.at += (self.told - self.at).clamp(-way, way);
    }

    fn tick(&mut self, pulse: Option<u16>) {
        // What a pulse says is known when it is over.
        let width = pulse.map_or(0, i64::from);
        self.turn(width);
        if let Some(width) = pulse {
            self.told = (i64::from(width) - 1500) * self.travel / 1000;
        }
        self.turn(10_000 - width);
    }
}

/// Any accepted configuration with a servo, wherever it stands at first, whenever somebody talks to the robot
/// or a fault stops it: a pulse is 1.0 to 2.0 ms long, comes 20 ms after the last and only while somebody
/// talks; and whenever the front sensor is triggered the servo stands within 0.1° of the bearing that goes
/// with the reading.
pub fn servo_stands_where_the_reading_says(config: AcceptedConfig, stands: u16, live: u64) -> Seen {
    let AcceptedConfig(mut config) = config;
    config.platform.servo = true;
    let platform = &config.platform;
    let sweeps = config.mode == fw_core::wire::Mode::GuardedSweep;
    let travel = match platform.servo_travel {
        0 => 0x8000,
        travel => travel,
    };
    let signed = if platform.servo_reversed { -1 } else { 1 } * (i64::from(travel) << 16);
    let mut servo = Servo {
        at: signed * (i64::from(stands) - 0x8000) / 0x10000,
        told: 0,
        travel: signed,
    };
    servo.told = servo.at;
    let mut sweep = ServoScan::new(platform, sweeps);
    let mut all = Rangefinders::new(1);
    let (mut triggers, mut last_pulse, mut last_bearing, mut repeated) = (0, None, None, false);
    for tick in 0..64 * WORD {
        let live = live >> (tick / WORD) & 1 != 0;
        let pulse = sweep.tick(live);
        if let Some(width) = pulse {
            assert!(live && (1000..=2000).contains(&width));
            assert!(last_pulse.is_none_or(|last| tick - last >= 2));
            last_pulse = Some(tick);
        } else if !live {
            last_pulse = None;
            // Without pulses it has no force: somebody turned it.
            if sweep.is_off() {
                servo.at = -servo.at;
                servo.told = servo.at;
                last_bearing = None;
            }
        }
        let now = Micros(tick * 10_000);
        if all.tick(now, sweep.settled_bearing()) == Some(RangefinderId::Front) {
            sweep.triggered();
            all.echo(RangefinderId::Front, now.after(500), now.after(9_500));
            let bearing = all.reading(RangefinderId::Front).bearing;
            let said = bearing.wrapping_sub(platform.bearings[0]);
            let said = i16::from_ne_bytes(said.to_ne_bytes());
            // Half a turn is half a turn either way.
            let off = ((i64::from(said) << 16) - servo.at).unsigned_abs() % (1 << 32);
            assert!(off.min((1 << 32) - off) < (1 << 32) / 3600);
            assert!(sweeps || said == 0);
            repeated |= last_bearing == Some(bearing);
            last_bearing = Some(bearing);
            triggers += 1;
        }
        servo.tick(pulse);
    }
    // A travel of nothing at all has one bearing only.
    assert!(!sweeps || !repeated || travel < 1000);
    Seen::NOTHING
        .case(0, sweeps && triggers > 100)
        .case(1, !sweeps && triggers > 0)
        .case(2, live == 0 && triggers == 0)
        .case(3, sweeps && triggers > 0 && live != u64::MAX)
}

/// Robots with a servo that differ in all that the servo's plan looks at.
#[cfg(test)]
fn figures() -> impl Iterator<Item = fw_core::eeprom::Config> {
    use fw_core::wire::Mode::{GuardedNormal, GuardedSweep};
    (0..12_u16).map(|which| {
        let mut config = fw_core::eeprom::first_board();
        config.mode = [GuardedSweep, GuardedNormal][usize::from(which & 1)];
        config.platform.servo_reversed = which & 2 != 0;
        config.platform.servo_travel = [0, 0x2000, 0x8000][usize::from(which / 4)];
        config
    })
}

crate::properties! {
    property T9 servo_stands_where_the_reading_says(config: AcceptedConfig, stands: u16, live: u64) {
        cases ["swept to and fro", "parked", "nobody talks to it", "interrupted"];
        needs [accepted_configuration_is_bounded];
        stepped figures().flat_map(|config| {
            [0, 1, 0x8000, 0xFFFF].into_iter().flat_map(move |stands| {
                let config = config.clone();
                [u64::MAX, 0, 0xFFFF_0000_0FFF_FF0F]
                    .map(move |live| (AcceptedConfig(config.clone()), stands, live))
            })
        });
        sampled 20_000;
    }
}
