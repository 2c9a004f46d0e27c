//! The whole robot: any configuration that the EEPROM accepts, any events in any order. Nothing
//! panics, and after the stop deadline without a fresh frame nothing drives.
#![no_main]

use fw_core::eeprom::{check, first_board, FIELDS};
use fw_core::log::Log;
use fw_core::robot::{Drive, Rangefinder, Robot, Sample};
use fw_core::units::Micros;
use fw_core::wire::MAX_FRAME;
use libfuzzer_sys::fuzz_target;
use robot_fuzz::{frame, Bytes};

const SENSORS: [Rangefinder; 3] = [Rangefinder::Front, Rangefinder::Right, Rangefinder::Left];
/// A tick and what the clock of a tick may be late, in microseconds.
const SLACK: u32 = 20_000;

fuzz_target!(|data: &[u8]| {
    let mut bytes = Bytes::new(data);
    let mut config = first_board();
    for _ in 0..bytes.byte() % 8 {
        let field = usize::from(bytes.byte()) % FIELDS.len();
        FIELDS[field].set(&mut config, u64::from_le_bytes(bytes.array()));
    }
    if check(&config).is_err() {
        return;
    }
    let deadline = u32::from(config.platform.stop_deadline) * 1000;
    let mut now = Micros(u32::from_le_bytes(bytes.array()));
    let mut sample = Sample {
        now,
        ..Sample::default()
    };
    let mut log: Log = Log::new();
    let mut robot = Robot::new(&config, sample);
    let mut silent = 0_u32;
    let mut out = [0; MAX_FRAME];
    while bytes.more() {
        let choice = bytes.byte();
        match choice % 6 {
            0 | 1 => {
                now = now.after(10_000);
                silent = silent.saturating_add(10_000);
                let [left, right] = bytes.array::<2>();
                sample.now = now;
                sample.left = sample
                    .left
                    .wrapping_add_signed(i32::from(left.cast_signed()));
                sample.right = sample
                    .right
                    .wrapping_add_signed(i16::from(right.cast_signed()));
                let words: [u16; 8] = std::array::from_fn(|tap| u16::from(left) << (tap % 5));
                let outputs = robot.on_tick(sample, &words, &mut log);
                if silent > deadline.saturating_add(SLACK) {
                    for drive in [outputs.left, outputs.right] {
                        assert!(!matches!(drive, Drive::Run(_)), "driving without a frame");
                    }
                }
                robot.refresh_reply(&mut out);
            }
            2 => {
                let received = frame(&mut bytes, config.mode, config.key_from_pi);
                let accepted = robot.counters().accepted;
                robot.on_frame(&received, received.len(), now, &mut log);
                if robot.counters().accepted != accepted {
                    silent = 0;
                }
                robot.next_reply(&mut out);
            }
            3 => {
                let [rise, fall] = [bytes.array(), bytes.array()].map(u32::from_le_bytes);
                robot.on_echo(SENSORS[usize::from(choice) % 3], Micros(rise), Micros(fall));
            }
            4 => robot.on_lost_frames(u32::from(choice), &mut log),
            _ => log.sent(usize::from(choice)),
        }
    }
});
