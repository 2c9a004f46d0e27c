//! A robot in a guarded mode, and the Pi's end of its link.

use fw_core::eeprom::{Config, Image};
use fw_core::types::Velocity;
use fw_core::wire::{Command, MAX_FRAME, Order, PiLink, PoseCode, Report};
use twin::Options;

use crate::reference::pose_codes;
use crate::test_board::Rig;

/// Both ends of the link.
pub struct LinkedRobot {
    /// The robot.
    pub rig: Rig,
    pi: PiLink,
    /// The last reply's.
    pub last: Report,
}

/// Of mm/s and degrees/s.
#[allow(clippy::cast_possible_truncation, reason = "as saturates")]
pub fn velocity(forward: f64, yaw_rate: f64) -> Velocity {
    Velocity {
        forward: (forward * 1000.0) as i32,
        yaw_rate: (yaw_rate / 360.0 * 4_294_967_296.0) as i32,
    }
}

impl LinkedRobot {
    /// READY with this EEPROM.
    pub fn new(image: &Image, options: Options) -> Self {
        let config = Config::decode(image).expect("accepted");
        let eeprom = Some(image.0.to_vec());
        Self {
            rig: Rig::ready(Options { eeprom, ..options }),
            pi: PiLink::new(config.link_setup()),
            last: Report::default(),
        }
    }

    /// One frame, whose reply must be whole.
    #[track_caller]
    pub fn exchange(&mut self, command: &Command) -> Report {
        let mut frame = [0; MAX_FRAME];
        let len = self.pi.send(command, &mut frame);
        let reply = self.rig.frame(&frame[..len]);
        self.last = self.pi.receive(&reply).expect("a valid reply");
        self.last
    }

    /// So many frames at 40 Hz.
    pub fn drive(&mut self, command: &Command, frames: u32) -> Vec<Report> {
        let exchange = |_| {
            let report = self.exchange(command);
            self.rig.run_us(25_000 - 60);
            report
        };
        (0..frames).map(exchange).collect()
    }

    /// Stands for so many milliseconds, with a frame at the begin and at the end.
    pub fn stand(&mut self, ms: u32) {
        self.drive(&Command::default(), ms / 25 + 1);
    }

    /// Towards x and y, millimetres, and a heading, degrees, for so many milliseconds.
    pub fn go(&mut self, (x, y, degrees): (f64, f64, f64), ms: u32) {
        let (x, y, rotation) = pose_codes(x, y, degrees);
        let command = Command {
            expected: PoseCode { x, y, rotation },
            apply: true,
            order: Order::Resume,
            ..Command::default()
        };
        self.drive(&command, ms / 25 + 1);
    }

    /// Error of the reported pose at rest: millimetres and degrees.
    pub fn pose_error(&mut self) -> (f64, f64) {
        for _ in 0..40 {
            self.stand(100);
            if self.rig.max_wheel_deg_s() < 0.05 {
                break;
            }
        }
        self.rig.run_us(30_000);
        self.exchange(&Command::default());
        let PoseCode { x, y, rotation } = self.exchange(&Command::default()).pose;
        let truth = self.rig.pose();
        let degrees = f64::from(rotation) / 32768.0 * 360.0 - truth.heading_rad.to_degrees();
        let [x, y] = [x, y].map(|um| f64::from(um) / 1000.0);
        let degrees = (degrees + 180.0).rem_euclid(360.0) - 180.0;
        ((x - truth.x_mm).hypot(y - truth.y_mm), degrees.abs())
    }
}
