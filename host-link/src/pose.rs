//! Poses as the Pi computes with them: millimetres and degrees in f64, and the wire's codes.

use fw_core::wire::PoseCode;
use serde::{Deserialize, Serialize};

/// A pose on the Pi. The document gives the axes: x ahead, y to the left of where the robot stood
/// when it was switched on, rotation counter-clockwise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Pose {
    /// Millimetres.
    pub x_mm: f64,
    /// Millimetres.
    pub y_mm: f64,
    /// Degrees.
    pub rotation_deg: f64,
}

/// Largest coordinate the wire carries, millimetres.
pub const MAX_COORDINATE_MM: f64 = 2_147_483.647;

/// Codes per turn (document, 5.1.1: 15 bits).
const TURN_CODES: f64 = 32_768.0;

impl Pose {
    /// A pose from millimetres, millimetres and degrees.
    pub const fn new(x_mm: f64, y_mm: f64, rotation_deg: f64) -> Self {
        Self {
            x_mm,
            y_mm,
            rotation_deg,
        }
    }

    /// A pose from the wire.
    pub fn from_code(code: PoseCode) -> Self {
        Self {
            x_mm: f64::from(code.x) / 1000.0,
            y_mm: f64::from(code.y) / 1000.0,
            rotation_deg: f64::from(code.rotation) * (360.0 / TURN_CODES),
        }
    }

    /// The nearest code: coordinates saturate at ±[`MAX_COORDINATE_MM`], the rotation wraps, and what rounds
    /// to a full turn is 0.
    #[must_use]
    pub fn code(self) -> PoseCode {
        #[allow(clippy::cast_possible_truncation)] // `as` saturates
        let micrometres = |mm: f64| {
            // A tie goes up, as in the core: `round` takes a negative one down.
            let (code, floor) = (mm * 1000.0, (mm * 1000.0).floor());
            (floor + f64::from(u8::from(code - floor >= 0.5))) as i32
        };
        let turn = self.rotation_deg.rem_euclid(360.0) / 360.0;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // 0 ..= 0x8000
        let rotation = (turn * TURN_CODES).round() as u16 & 0x7FFF;
        PoseCode {
            x: micrometres(self.x_mm),
            y: micrometres(self.y_mm),
            rotation,
        }
    }

    /// This pose, given as seen from `origin`, in the frame that `origin` is in.
    #[must_use]
    pub fn in_frame_of(self, origin: Self) -> Self {
        let (sine, cosine) = origin.rotation_deg.to_radians().sin_cos();
        Self {
            x_mm: origin.x_mm + self.x_mm * cosine - self.y_mm * sine,
            y_mm: origin.y_mm + self.x_mm * sine + self.y_mm * cosine,
            rotation_deg: origin.rotation_deg + self.rotation_deg,
        }
    }

    /// Millimetres between the two, as the crow flies.
    #[must_use]
    pub fn distance_mm(self, other: Self) -> f64 {
        (self.x_mm - other.x_mm).hypot(self.y_mm - other.y_mm)
    }

    /// Degrees from `self`'s rotation to `other`'s, the shortest way, −180 to below 180.
    #[must_use]
    pub fn rotation_to_deg(self, other: Self) -> f64 {
        (other.rotation_deg - self.rotation_deg + 180.0).rem_euclid(360.0) - 180.0
    }
}

#[test]
fn pose_codes_round_saturate_and_wrap() {
    for (x_mm, y_mm, deg, x, y, rotation) in [
        (1.0, -2.5, 90.0, 1000, -2500, 0x2000),
        (1e12, -1e12, -90.0, i32::MAX, i32::MIN, 0x6000),
        // A tie goes up.
        (-0.0625 / 125.0, 0.0625 / 125.0, 0.0, 0, 1, 0),
        (0.0, 0.0, 359.999, 0, 0, 0),
        (0.0, 0.0, 1079.99, 0, 0, 0x7FFF),
    ] {
        let code = PoseCode { x, y, rotation };
        assert_eq!(Pose::new(x_mm, y_mm, deg).code(), code);
    }
}

#[test]
fn rotation_difference_takes_shortest_way() {
    let [ten, back] = [10.0, 350.0].map(|deg| Pose::new(0.0, 0.0, deg));
    assert!((back.rotation_to_deg(ten) - 20.0).abs() < 1e-9);
    assert!((ten.rotation_to_deg(back) + 20.0).abs() < 1e-9);
    let half = ten.rotation_to_deg(Pose::new(0.0, 0.0, 190.0));
    assert!((half + 180.0).abs() < 1e-9);
}

#[test]
fn pose_seen_from_origin_is_turned_and_shifted() {
    // Cosine 0.6, sine 0.8.
    let origin = Pose::new(100.0, 200.0, 4f64.atan2(3.0).to_degrees());
    let there = Pose::new(10.0, 5.0, 7.0).in_frame_of(origin);
    let expected = Pose::new(102.0, 211.0, origin.rotation_deg + 7.0);
    assert!(there.distance_mm(expected) < 1e-9 && there.rotation_to_deg(expected).abs() < 1e-9);
    assert!((expected.distance_mm(Pose::new(105.0, 207.0, 0.0)) - 5.0).abs() < 1e-9);
}
