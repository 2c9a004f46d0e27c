//! The client protocol: one JSON object a line, or a web socket's text message.
//!
//! A client begins with `{"do":"hello","version":1,"name":"…"}`, over a network with the token; each
//! request gets one reply.

use super::board::Call;
pub use super::failure::Failure;
use host_link::pose::{MAX_COORDINATE_MM, Pose};
use host_link::snapshot::Snapshot;
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

/// Version of the protocol.
pub const VERSION: u32 = 1;
/// Longest line in either direction, bytes.
pub const MAX_LINE: usize = 16 * 1024;
/// Longest name of a client, characters.
const MAX_NAME: usize = 40;
/// Shortest and longest lease of the drive, ms.
pub const LEASE_MS: RangeInclusive<u32> = 100..=5000;
/// Lease of a client that asks for none, ms.
pub const DEFAULT_LEASE_MS: u32 = 1000;
/// Largest speed, mm/s, and yaw rate, degrees/s; the configuration limits them further.
const MAX_VELOCITY: (f64, f64) = (1000.0, 180.0);

/// What a client asks for.
// Requirement: SERVE-client-1
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "do", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Request {
    /// The first message.
    Hello {
        /// [`VERSION`].
        version: u32,
        /// How other clients see this one.
        name: String,
        /// Over a network: the content of the token's file.
        #[serde(default)]
        token: String,
    },
    /// The latest frame, once.
    Status,
    /// Every n-th frame, the log and the map from now on.
    Watch {
        /// 1 to 400; 1 without it.
        #[serde(default = "one")]
        every: u32,
    },
    /// Guarded Velocity: a velocity until the lease ends.
    Drive {
        /// mm/s, −1000 to 1000.
        forward_mm_s: f64,
        /// Degrees/s counter-clockwise, −180 to 180.
        yaw_rate_deg_s: f64,
        /// See [`LEASE_MS`].
        #[serde(default = "default_lease")]
        lease_ms: u32,
    },
    /// Drives to a pose of the robot's own frame, or in Guarded Velocity, without a rotation, to a point of the
    /// map around what it shows. The lease must be kept.
    Goto {
        /// Millimetres.
        x_mm: f64,
        /// Millimetres.
        y_mm: f64,
        /// Degrees.
        rotation_deg: Option<f64>,
        /// See [`LEASE_MS`].
        #[serde(default = "default_lease")]
        lease_ms: u32,
    },
    /// Guarded Velocity: explores. The lease must be kept.
    Explore {
        /// See [`LEASE_MS`].
        #[serde(default = "default_lease")]
        lease_ms: u32,
    },
    /// Keeps the lease.
    Keep,
    /// Stops the robot, whichever client drives it.
    Stop,
    /// Clears the latched faults; the robot stays where it is.
    ClearFaults,
    /// Begins a new map where the robot stands; refused while it drives by the map.
    NewMap,
    /// Over the Unix socket: hands the robot's lines and buses to this client, until it returns them,
    /// disconnects or is stopped.
    Borrow,
    /// A call of a line or a bus of the borrowed robot, answered by `board`.
    Board {
        /// The call.
        call: Call,
    },
    /// Returns the borrowed robot.
    Return,
}

const fn one() -> u32 {
    1
}

const fn default_lease() -> u32 {
    DEFAULT_LEASE_MS
}

impl Request {
    /// Parses a line.
    ///
    /// # Errors
    /// What is wrong, for any bytes that are no request within its ranges.
    pub fn parse(line: &[u8]) -> Result<Self, String> {
        if line.len() > MAX_LINE {
            return Err(format!("a line has at most {MAX_LINE} bytes"));
        }
        let request: Self = serde_json::from_slice(line)
            .map_err(|cause| Self::wrong_type(line).unwrap_or_default() + &cause.to_string())?;
        request.check()?;
        Ok(request)
    }

    /// The field whose value is of another type; serde's error of it has no name.
    fn wrong_type(line: &[u8]) -> Option<String> {
        let all: serde_json::Map<_, _> = serde_json::from_slice(line).ok()?;
        let is_wrong = |field: &&String| {
            let mut alone = all.clone();
            alone.retain(|name, _| name == "do" || name == *field);
            let parsed: Result<Self, _> = serde_json::from_value(alone.into());
            parsed.is_err_and(|cause| cause.to_string().starts_with("invalid"))
        };
        Some(format!("{}: ", all.keys().find(is_wrong)?))
    }

    // Requirement: SERVE-client-1
    fn check(&self) -> Result<(), String> {
        match self {
            Self::Hello { version, name, .. } => {
                let known = f64::from(VERSION);
                within("version", *version, known..=known)?;
                let printable = !name.chars().any(char::is_control);
                if !(1..=MAX_NAME).contains(&name.chars().count()) || !printable {
                    return Err(format!(
                        "name: accepted are 1 to {MAX_NAME} printable characters"
                    ));
                }
            }
            Self::Watch { every } => within("every", *every, 1.0..=400.0)?,
            Self::Drive {
                forward_mm_s,
                yaw_rate_deg_s,
                lease_ms,
            } => {
                let (speed, yaw) = MAX_VELOCITY;
                within("forward_mm_s", *forward_mm_s, -speed..=speed)?;
                within("yaw_rate_deg_s", *yaw_rate_deg_s, -yaw..=yaw)?;
                lease(*lease_ms)?;
            }
            Self::Goto {
                x_mm,
                y_mm,
                rotation_deg,
                lease_ms,
            } => {
                within("x_mm", *x_mm, -MAX_COORDINATE_MM..=MAX_COORDINATE_MM)?;
                within("y_mm", *y_mm, -MAX_COORDINATE_MM..=MAX_COORDINATE_MM)?;
                let rotation = rotation_deg.unwrap_or_default();
                within("rotation_deg", rotation, -36e3..=36e3)?;
                lease(*lease_ms)?;
            }
            Self::Explore { lease_ms } => lease(*lease_ms)?,
            Self::Board { call } => call.check()?,
            _ => {}
        }
        Ok(())
    }
}

fn lease(ms: u32) -> Result<(), String> {
    let range = f64::from(*LEASE_MS.start())..=f64::from(*LEASE_MS.end());
    within("lease_ms", ms, range)
}

pub(crate) fn within(
    field: &str,
    value: impl Into<f64>,
    accepted: RangeInclusive<f64>,
) -> Result<(), String> {
    let (value, least, most) = (value.into(), accepted.start(), accepted.end());
    if accepted.contains(&value) {
        return Ok(());
    }
    Err(format!("{field} = {value}: accepted is {least} to {most}"))
}

/// What drives the robot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Activity {
    /// Nothing.
    #[default]
    Idle,
    /// A client's velocity.
    Drive,
    /// The way to a pose or to a point of the map.
    Goto,
    /// The explorer.
    Explore,
    /// A command that has borrowed the robot.
    Command,
}

/// Where the robot is in the map's frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// Millimetres and degrees.
    #[serde(flatten)]
    pub pose: Pose,
    /// Standard deviation of the position, mm.
    pub deviation_mm: f64,
}

/// Everything about the robot after a frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Frame {
    /// What the robot reported.
    pub robot: Snapshot,
    /// None in a mode without a pose.
    pub estimate: Option<Estimate>,
    /// What drives it …
    pub activity: Activity,
    /// … and the client that does.
    pub driver: Option<String>,
    /// The explorer's targets left.
    pub targets: usize,
    /// What to check; empty when all is well.
    pub advice: Vec<String>,
    /// Why the robot cannot be reached, if so.
    pub error: Option<String>,
    /// Clients, this one included.
    pub clients: usize,
    /// Where the rangefinders are on the robot, and look: front, right, left; none where none is fitted.
    pub rangefinders: [Option<Pose>; 3],
    /// `STM_READY`'s configuration: time without a frame after which the motors brake, ms.
    pub stop_deadline_ms: u16,
}

/// 32 × 32 cells of the map.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Tile {
    /// Number of the tile along x; tile 0 begins at the origin.
    pub column: i32,
    /// Number of the tile along y.
    pub row: i32,
    /// Row by row from the lower left: `#` occupied, `.` free, blank unknown.
    pub cells: String,
}

/// What a client gets.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "kebab-case")]
pub enum Message {
    /// The answer to a request; `hello`'s has the version.
    Reply {
        /// [`VERSION`].
        version: u32,
        /// Why the request was refused, if it was.
        error: Option<Failure>,
    },
    /// The robot after a frame.
    Frame(Box<Frame>),
    /// A line of the STM's log.
    Log {
        /// Without its end.
        line: String,
    },
    /// A new map: the tiles so far belong to an old one.
    Map {
        /// Width of a cell, mm.
        cell_mm: f64,
    },
    /// Tiles that changed.
    Tiles {
        /// At most eight.
        tiles: Vec<Tile>,
    },
    /// The answer to a call of a line or a bus.
    Board {
        /// What was read.
        bytes: Vec<u8>,
        /// Level, or microseconds on the board's clock.
        number: u64,
        /// Why the driver failed, if it did.
        error: Option<String>,
    },
    /// This client's motion has ended.
    Done {
        /// What it was.
        activity: Activity,
        /// Why it did not end as planned, if so.
        error: Option<Failure>,
        /// Seconds on the board's clock.
        seconds: f64,
    },
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    // Requirement: SERVE-client-1
    #[test]
    fn request_outside_its_range_is_refused_by_field() {
        for row in [
            r#"forward_mm_s of drive","forward_mm_s":1001,"yaw_rate_deg_s":0"#,
            r#"yaw_rate_deg_s of drive","forward_mm_s":0,"yaw_rate_deg_s":-181"#,
            r#"lease_ms of drive","forward_mm_s":0,"yaw_rate_deg_s":0,"lease_ms":99"#,
            r#"lease_ms of explore","lease_ms":5001"#,
            r#"x_mm of goto","x_mm":1e10,"y_mm":0"#,
            r#"y_mm of goto","x_mm":0,"y_mm":-1e10"#,
            r#"delay of board","call":{"delay":50001}"#,
            r#"i2c of board","call":{"i2c":[80,[],2049]}"#,
            r#"every of watch","every":0"#,
            r#"version of hello","version":2,"name":"a""#,
            r#"name of hello","version":1,"name":"""#,
            r#"now of explore","now":1"#,
            r#"jump of jump""#,
            r#"yaw_rate_deg_s: invalid of drive","forward_mm_s":0,"yaw_rate_deg_s":"0""#,
            r#"x_mm: invalid of goto","x_mm":null"#,
            r#"lease_ms: invalid of explore","lease_ms":-1"#,
            r#"call: invalid of board","call":{"delay":"1"}"#,
            "EOF of ",
        ] {
            let (field, line) = row.split_once(" of ").unwrap();
            let line = format!(r#"{{"do":"{line}}}"#);
            let error = Request::parse(line.as_bytes()).unwrap_err();
            assert!(error.contains(field), "{line}: {error}");
        }
    }

    // Requirement: SERVE-client-1
    #[test]
    fn request_at_an_end_of_its_range_is_taken_as_it_is() {
        let parse = |line: &str| Request::parse(line.as_bytes());
        for (lease, lease_ms) in [
            ("", 1000),
            (r#","lease_ms":100"#, 100),
            (r#","lease_ms":5000"#, 5000),
        ] {
            let drive = Request::Drive {
                forward_mm_s: 1000.0,
                yaw_rate_deg_s: -180.0,
                lease_ms,
            };
            let line = r#"{"do":"drive","forward_mm_s":1000,"yaw_rate_deg_s":-180"#;
            assert_eq!(parse(&format!("{line}{lease}}}")), Ok(drive));
            let explore = Request::Explore { lease_ms };
            assert_eq!(parse(&format!(r#"{{"do":"explore"{lease}}}"#)), Ok(explore));
        }
        for (count, accepted) in [(40, true), (41, false)] {
            let name = "n".repeat(count);
            let hello = parse(&format!(r#"{{"do":"hello","version":1,"name":"{name}"}}"#));
            assert_eq!(hello.is_ok(), accepted);
            let watch = parse(&format!(r#"{{"do":"watch","every":{}}}"#, count + 360));
            assert_eq!(watch.is_ok(), accepted);
        }
    }

    proptest! {
        // Requirement: SERVE-client-1
        #[test]
        fn request_of_any_bytes_is_checked_or_refused(
            bytes in prop_oneof![
                proptest::collection::vec(any::<u8>(), 0..200),
                r#"\{"do":"(drive|goto|watch|hello|stop)"(,"(x_mm|every|name|lease_ms|forward_mm_s|yaw_rate_deg_s)":-?[0-9]{1,5}){0,4}\}"#
                    .prop_map(String::into_bytes),
            ]
        ) {
            if let Ok(request) = Request::parse(&bytes) {
                let line = serde_json::to_vec(&request).unwrap();
                prop_assert_eq!(Request::parse(&line), Ok(request));
            }
        }
    }
}
