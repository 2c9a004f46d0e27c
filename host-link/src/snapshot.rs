//! The latest of everything the robot reported, in physical units: what `monitor` shows.

use crate::log::LogLine;
use crate::pose::Pose;
use crate::statistics::{LinkStatistics, StmStatistics};
use fw_core::eeprom::Config;
use fw_core::types::{Faults, RangefinderId};
use fw_core::wire::{DistanceCode, Field, GyroCode, Mode, Report, State};
use serde::{Deserialize, Deserializer, Serialize};

/// A name out of a table of this program.
type Name = &'static str;

/// Full scale of a distance code, millimetres (document, 5.1.4).
const FULL_SCALE_MM: f64 = 2500.0;

/// The latest of everything. Fields the mode does not carry stay empty.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Snapshot {
    /// Microseconds on the board's clock, of the latest valid frame.
    pub time_us: u64,
    /// The mode's name.
    #[serde(deserialize_with = "mode_name")]
    pub mode: Name,
    /// The reported pose.
    pub pose: Option<Pose>,
    /// Tuning modes: rotation in degrees or displacement in millimetres.
    pub measurement: Option<f64>,
    /// Volts of each cell; none until its turn has come.
    pub cells_v: Vec<Option<f64>>,
    /// Millimetres front, right, left; none = out of range, no echo, or not measured yet.
    pub ranges_mm: [Option<f64>; 3],
    /// Sweep and velocity mode: the bearing at which the first range was measured, degrees counter-clockwise from
    /// straight ahead, −180 to 180.
    pub bearing_deg: Option<f64>,
    /// Velocity mode: the gyroscope's angle since the STM's reset or its own last loss, turns,
    /// counter-clockwise; none without a gyroscope or before its first bias.
    pub gyro_turns: Option<f64>,
    /// Guarded modes: the obstacle stop limits the speed.
    pub obstacle_limited: bool,
    /// Guarded modes: the commanded velocity was beyond a limit.
    pub clipped: bool,
    /// Guarded modes.
    #[serde(deserialize_with = "state_name")]
    pub state: Option<Name>,
    /// Guarded modes: names of the latched faults.
    #[serde(deserialize_with = "known_faults")]
    pub faults: Vec<&'static str>,
    /// The link's counters at this end.
    pub link: LinkStatistics,
    /// The counters of the STM's end; none without its log.
    pub stm: Option<StmStatistics>,
    /// Rangefinders that have not answered, front, right, left, as the log says: what they report looks like nothing
    /// in reach.
    #[serde(default)]
    pub silent: [bool; 3],
    /// The latest gyro code, and the codes since the first without their wrap.
    #[serde(skip)]
    gyro: Option<(i32, i64)>,
    /// The STM has restarted since the last [`crate::session::Session::take_restart`]: its pose returned to zero.
    #[serde(skip)]
    pub restarted: bool,
    #[serde(skip)]
    kind: Mode,
    /// Of the faster wheel at full duty, mm/s.
    #[serde(skip)]
    full_speed_mm_s: f64,
}

/// A pose that is so much farther, mm, or more turned, degrees, than the robot can drive and turn meanwhile, is
/// that of an STM that was reset.
const JUMP: (f64, f64) = (150.0, 90.0);

impl Snapshot {
    /// Nothing reported yet.
    pub fn new(config: &Config) -> Self {
        let [left, right] = [config.left(), config.right()];
        Self {
            mode: config.mode().name(),
            cells_v: vec![None; config.cells().into()],
            kind: config.mode(),
            full_speed_mm_s: f64::from(left.full_speed_mm_s.max(right.full_speed_mm_s)),
            ..Self::default()
        }
    }

    /// Takes over one report.
    pub fn update(&mut self, now_us: u64, report: &Report, statistics: LinkStatistics) {
        let before = self.pose.map(|pose| (self.time_us, pose));
        self.time_us = now_us;
        self.link = statistics;
        if self.kind.has(Field::Position) || self.kind.has(Field::Velocity) {
            self.pose = Some(Pose::from_code(report.pose));
            self.restarted |= before.is_some_and(|(us, pose)| self.has_jumped_since(us, pose));
            self.ranges_mm = report.ranges.map(distance_mm);
        } else {
            self.measurement = Some(f64::from_bits(report.measurement.0));
        }
        if self.kind.has(Field::Bearing) {
            let turn = f64::from(report.bearing.cast_signed()) / 65_536.0;
            self.bearing_deg = Some(turn * 360.0);
        }
        if let Some(cell) = self.cells_v.get_mut(usize::from(report.cell.cell)) {
            *cell = Some(f64::from(report.cell.voltage) / 200.0);
        }
        if self.kind.has(Field::Status) {
            let faults = fault_names(report.faults);
            let [is_latched, was_latched] =
                [&faults, &self.faults].map(|faults| faults.contains(&"restarted"));
            self.restarted |= self.state.is_some() && is_latched && !was_latched;
            self.state = Some(report.state.name());
            self.faults = faults;
            (self.obstacle_limited, self.clipped) = (report.obstacle_limited, report.clipped);
        }
        if self.restarted {
            self.silent = [false; 3];
        }
        self.gyro_turns = (report.gyro != GyroCode::NONE).then(|| self.unwrap_gyro(report.gyro.0));
    }

    /// Takes over a line of the STM's log.
    pub fn take_line(&mut self, line: LogLine) {
        match line {
            LogLine::Link(counters) => self.stm = Some(counters),
            LogLine::Rangefinder { which, silent } => self.silent[which as usize] = silent,
            _ => {}
        }
    }

    /// Whether the pose is farther from this earlier one than the robot can have driven or turned.
    #[allow(clippy::cast_precision_loss)] // exact below 285 years
    pub fn has_jumped_since(&self, then_us: u64, then: Pose) -> bool {
        let seconds = self.time_us.saturating_sub(then_us) as f64 / 1e6;
        self.pose.is_some_and(|now| {
            then.distance_mm(now) > JUMP.0 + self.full_speed_mm_s * seconds
                || then.rotation_to_deg(now).abs() > JUMP.1 + 360.0 * seconds
        })
    }

    /// Turns of a gyro code that wraps at ±128 turns.
    #[allow(clippy::cast_precision_loss)] // exact below 2^29 turns
    fn unwrap_gyro(&mut self, code: i32) -> f64 {
        let (last, whole) = self.gyro.unwrap_or((code, code.into()));
        let whole = whole + i64::from(code.wrapping_sub(last));
        self.gyro = Some((code, whole));
        whole as f64 / 16_777_216.0
    }
}

/// Millimetres, none for 0xFFFF.
pub fn distance_mm(code: DistanceCode) -> Option<f64> {
    (code != DistanceCode::NONE).then(|| f64::from(code.0) * (FULL_SCALE_MM / 65_535.0))
}

/// The names of the latched faults.
pub fn fault_names(faults: Faults) -> Vec<&'static str> {
    faults.iter().map(|fault| fault.name).collect()
}

/// The names of the rangefinders that are silent, see [`Snapshot::silent`].
pub fn silent_names(silent: [bool; 3]) -> impl Iterator<Item = &'static str> {
    let all = RangefinderId::ALL.into_iter().zip(silent);
    all.filter(|one| one.1).map(|one| one.0.name())
}

/// The name in this program's table.
fn known(names: impl IntoIterator<Item = Name>, name: &str) -> Name {
    let mut names = names.into_iter();
    names.find(|known| *known == name).unwrap_or("unknown")
}

fn mode_name<'de, D: Deserializer<'de>>(value: D) -> Result<Name, D::Error> {
    let name = String::deserialize(value)?;
    Ok(known(Mode::ALL.iter().map(|mode| mode.name()), &name))
}

fn state_name<'de, D: Deserializer<'de>>(value: D) -> Result<Option<Name>, D::Error> {
    let name = Option::<String>::deserialize(value)?;
    let states = (0..=u8::MAX).filter_map(State::from_code).map(State::name);
    Ok(name.map(|name| known(states, &name)))
}

/// The faults that this program knows.
fn known_faults<'de, D: Deserializer<'de>>(value: D) -> Result<Vec<&'static str>, D::Error> {
    let names = Vec::<String>::deserialize(value)?;
    let known = Faults::TABLE.iter().map(|fault| fault.name);
    let found = known.filter(|known| names.iter().any(|name| name == known));
    Ok(found.collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use fw_core::binary64::Binary64;
    use fw_core::eeprom::{Image, fields};

    /// Of Guarded Velocity, before a report.
    fn before() -> Snapshot {
        let mode = Mode::GuardedVelocity.code().into();
        Snapshot::new(&Config::decode(&Image::FIRST_BOARD.with(fields::MODE, mode)).unwrap())
    }

    #[test]
    fn snapshot_as_json_reads_back() {
        let mut snapshot = before();
        snapshot.full_speed_mm_s = 0.0;
        let report = Report {
            state: State::Faulted,
            faults: Faults::SLIP | Faults::LEFT_STALLED,
            pose: Pose::new(1.0, -2.0, 90.0).code(),
            bearing: 0xC000,
            cell: fw_core::wire::CellCode {
                cell: 1,
                voltage: 740,
            },
            ranges: [13_107, 0xFFFF, 0].map(DistanceCode),
            obstacle_limited: true,
            ..Report::default()
        };
        let link = LinkStatistics {
            frames: 3,
            ..LinkStatistics::default()
        };
        snapshot.update(7, &report, link);
        assert_eq!((snapshot.time_us, snapshot.link), (7, link));
        assert_eq!(snapshot.pose, Some(Pose::new(1.0, -2.0, 90.0)));
        assert_eq!(snapshot.bearing_deg, Some(-90.0));
        assert_eq!(snapshot.cells_v, [None, Some(3.7)]);
        let ranges_mm = snapshot.ranges_mm.map(|mm| mm.map(f64::round));
        assert_eq!(ranges_mm, [Some(500.0), None, Some(0.0)]);
        assert_eq!(snapshot.faults, ["left-stalled", "slip"]);
        assert_eq!(snapshot.state, Some("faulted"));
        assert!(snapshot.obstacle_limited && !snapshot.clipped);
        snapshot.kind = Mode::default();
        snapshot.faults = fault_names(Faults::ALL_BITS);
        for state in (0..=u8::MAX).filter_map(State::from_code) {
            snapshot.state = Some(state.name());
            let json = serde_json::to_string(&snapshot).unwrap();
            assert_eq!(serde_json::from_str::<Snapshot>(&json).unwrap(), snapshot);
        }
        // The latest distances and state replace those of before.
        snapshot.kind = Mode::GuardedTuneMove;
        let measurement = Binary64(12.5_f64.to_bits());
        let measured = Report {
            measurement,
            ..report
        };
        snapshot.update(8, &measured, link);
        assert_eq!(snapshot.measurement, Some(12.5));
        snapshot.kind = Mode::GuardedVelocity;
        snapshot.update(8, &Report::default(), link);
        assert_eq!(snapshot.ranges_mm, [None; 3]);
        assert_eq!(snapshot.state, Some("booting"));
        assert!(snapshot.faults.is_empty());
        // Names of a newer program.
        (snapshot.mode, snapshot.state) = ("newer", Some("newer"));
        snapshot.faults = vec!["newer", "slip"];
        let json = serde_json::to_string(&snapshot).unwrap();
        let read: Snapshot = serde_json::from_str(&json).unwrap();
        assert_eq!((read.mode, read.state), ("unknown", Some("unknown")));
        assert_eq!(read.faults, ["slip"]);
    }

    #[test]
    fn restart_shows_by_its_fault_or_the_pose() {
        let (restarted, none) = (Faults::RESTARTED, Faults::NONE);
        for (us, [x, deg], faults, is_restart) in [
            (0, [150.0, 0.0], [none, none], false),
            (0, [0.0, -90.0], [none, none], false),
            (25_000, [150.0, 0.0], [none, none], false),
            (25_000, [155.0, 0.0], [none, none], true),
            (1_000_000, [300.0, 0.0], [none, none], false),
            (25_000, [0.0, -90.0], [none, none], false),
            (25_000, [0.0, 120.0], [none, none], true),
            (25_000, [0.0, 0.0], [none, restarted], true),
            (25_000, [0.0, 0.0], [restarted, restarted], false),
        ] {
            let mut snapshot = before();
            let (front, left) = (RangefinderId::Front, RangefinderId::Left);
            for (which, silent) in [(front, true), (left, true), (front, false)] {
                snapshot.take_line(LogLine::Rangefinder { which, silent });
            }
            assert_eq!(snapshot.silent, [false, false, true]);
            let second = (us, Pose::new(x, 0.0, deg));
            for ((us, pose), faults) in [(0, Pose::default()), second].into_iter().zip(faults) {
                let report = Report {
                    pose: pose.code(),
                    faults,
                    ..Report::default()
                };
                snapshot.update(us, &report, LinkStatistics::default());
            }
            assert_eq!(snapshot.restarted, is_restart, "{x} mm, {deg}°, {faults:?}");
            // What the log of a new start does not repeat is over.
            assert_eq!(snapshot.silent[2], !is_restart);
        }
    }

    // Requirement: WIRE-gyro-1
    #[test]
    fn gyro_angle_is_unwrapped_and_survives_a_gap() {
        let mut snapshot = before();
        let quarter = i32::MAX / 512;
        for (code, turns) in [
            (None, None),
            (Some(0), Some(0.0)),
            (Some(-quarter), Some(-0.25)),
            (Some(i32::MIN + 1), Some(-128.0)),
            (None, None),
            (Some(i32::MAX - 4 * quarter), Some(-129.0)),
        ] {
            let gyro = code.map_or(GyroCode::NONE, GyroCode);
            let report = Report {
                gyro,
                ..Report::default()
            };
            snapshot.update(0, &report, LinkStatistics::default());
            let close = |(a, b): (f64, f64)| (a - b).abs() < 1e-6;
            assert_eq!(snapshot.gyro_turns.is_some(), turns.is_some());
            assert!(snapshot.gyro_turns.zip(turns).is_none_or(close), "{code:?}");
        }
        assert!(snapshot.pose.is_some() && snapshot.bearing_deg.is_some());
    }
}
