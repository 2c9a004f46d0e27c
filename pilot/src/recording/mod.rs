//! Recordings: MCAP files with ROS 2 messages, streamed while driving. What a killed run leaves is read up
//! to its cut.

#[allow(missing_docs, reason = "the fields are those of ROS 2's definitions")]
mod messages;
mod reader;
mod records;

pub use reader::{check_extent, load, parse};

use crate::mapping::RangeSample;
use byteorder::LittleEndian;
use host_link::error::Error;
use host_link::file::{Kind, OutputFile};
use host_link::snapshot::Snapshot;
use mapper::{Cell, Grid};
use mcap::records::MessageHeader;
use mcap::{McapResult, WriteOptions, Writer};
use messages::{
    BatteryState, DiagnosticArray, DiagnosticStatus, Header, Imu, KeyValue, MapMetaData, Message,
    OccupancyGrid, PoseStamped, Quaternion, Range, TfMessage, Time, Transform, TransformStamped,
    Xyz,
};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, IntoInnerError};
use std::path::{Path, PathBuf};

/// A kill loses at most this much, microseconds.
const FLUSH_US: u64 = 500_000;
/// Time between two messages of battery, faults and link, microseconds.
const SLOW_US: u64 = 1_000_000;

const RANGES: [&str; 3] = ["/range/front", "/range/right", "/range/left"];
const RANGE_FRAMES: [&str; 3] = ["range_front", "range_right", "range_left"];
const POSE: &str = "/pose";
const TF: &str = "/tf";
const IMU: &str = "/imu";

/// Writes a recording.
// Requirement: WIRE-program-5
pub struct Recorder {
    path: PathBuf,
    writer: Writer<BufWriter<File>>,
    /// Sequence number and id of each topic's channel.
    channels: BTreeMap<&'static str, (u16, u32)>,
    flushed_us: u64,
    slow_us: Option<u64>,
}

impl Recorder {
    /// Begins the file.
    ///
    /// # Errors
    /// [`Error::Unwritable`].
    pub fn create(path: &Path) -> Result<Self, Error> {
        let file = BufWriter::new(OutputFile::create(path, Kind::Recording)?.publish()?);
        let options = WriteOptions::new()
            .compression(None)
            .profile("ros2")
            .library("robot");
        let mut recorder = Self {
            path: path.into(),
            writer: options
                .create(file)
                .map_err(|cause| Error::unwritable(path, &cause))?,
            channels: BTreeMap::new(),
            flushed_us: 0,
            slow_us: None,
        };
        recorder.flush()?;
        Ok(recorder)
    }

    /// Adds a report.
    ///
    /// # Errors
    /// [`Error::Unwritable`].
    pub fn add(&mut self, sample: &RangeSample) -> Result<(), Error> {
        let (us, pose) = (sample.time_us, sample.pose);
        for ((topic, frame), range) in RANGES.into_iter().zip(RANGE_FRAMES).zip(sample.ranges_mm) {
            #[allow(clippy::cast_possible_truncation)] // metres
            let range = range.map_or(f32::INFINITY, |mm| (mm / 1000.0) as f32);
            let message = Range {
                header: header(us, frame),
                radiation_type: 0,
                field_of_view: 0.26,
                min_range: 0.02,
                max_range: 2.5,
                range,
            };
            self.write(topic, us, &message)?;
        }
        if let Some(gyro) = sample.gyro_deg {
            let mut unknown = [0.0; 9];
            unknown[0] = -1.0;
            let message = Imu {
                header: header(us, "base_link"),
                orientation: Quaternion::of_degrees(gyro),
                angular_velocity_covariance: unknown,
                linear_acceleration_covariance: unknown,
                ..Imu::default()
            };
            self.write(IMU, us, &message)?;
        }
        let (x, y) = (pose.x_mm / 1000.0, pose.y_mm / 1000.0);
        let position = Xyz { x, y, z: 0.0 };
        let orientation = Quaternion::of_degrees(pose.rotation_deg);
        let transform = |parent: &str, child: &str, translation, rotation| TransformStamped {
            header: header(us, parent),
            child_frame_id: child.into(),
            transform: Transform {
                translation,
                rotation,
            },
        };
        let mut transforms = vec![transform("odom", "base_link", position, orientation)];
        if let Some(bearing) = sample.bearing_deg {
            let rotation = Quaternion::of_degrees(bearing);
            transforms.push(transform(
                "base_link",
                RANGE_FRAMES[0],
                Xyz::default(),
                rotation,
            ));
        }
        self.write(TF, us, &TfMessage { transforms })?;
        // The reader takes a report as complete with its pose.
        let message = PoseStamped {
            header: header(us, "odom"),
            pose: messages::Pose {
                position,
                orientation,
            },
        };
        self.write(POSE, us, &message)?;
        if us.saturating_sub(self.flushed_us) >= FLUSH_US {
            self.flushed_us = us;
            self.flush()?;
        }
        Ok(())
    }

    /// Adds what a snapshot has beside its report, once a second.
    ///
    /// # Errors
    /// [`Error::Unwritable`].
    pub fn add_state(&mut self, snapshot: &Snapshot) -> Result<(), Error> {
        let us = snapshot.time_us;
        if self
            .slow_us
            .is_some_and(|last| us.saturating_sub(last) < SLOW_US)
        {
            return Ok(());
        }
        self.slow_us = Some(us);
        #[allow(clippy::cast_possible_truncation)] // volts
        let cells: Vec<f32> = snapshot
            .cells_v
            .iter()
            .map(|v| v.map_or(f32::NAN, |v| v as f32))
            .collect();
        let none = f32::NAN;
        let battery = BatteryState {
            header: header(us, "base_link"),
            voltage: cells.iter().sum(),
            temperature: none,
            current: none,
            charge: none,
            capacity: none,
            design_capacity: none,
            percentage: none,
            // Lithium polymer.
            power_supply_technology: 3,
            present: true,
            cell_voltage: cells,
            ..BatteryState::default()
        };
        self.write("/battery_state", us, &battery)?;
        let value = |key: &str, value: String| KeyValue {
            key: key.into(),
            value,
        };
        let link = &snapshot.link;
        let faults = snapshot.faults.join(", ");
        let status = DiagnosticStatus {
            level: if faults.is_empty() { 0 } else { 2 },
            name: "robot".into(),
            message: if faults.is_empty() {
                snapshot.state.unwrap_or("").to_string()
            } else {
                faults
            },
            hardware_id: "stm32f411".into(),
            values: vec![
                value("mode", snapshot.mode.to_string()),
                value("frames", link.frames.to_string()),
                value("rejected", link.rejected.to_string()),
                value("worst_gap_us", link.worst_gap_us.to_string()),
            ],
        };
        let message = DiagnosticArray {
            header: header(us, ""),
            status: vec![status],
        };
        self.write("/diagnostics", us, &message)
    }

    /// Adds the map and ends the file with its index.
    ///
    /// # Errors
    /// [`Error::Unwritable`].
    pub fn finish(mut self, us: u64, grid: &Grid) -> Result<(), Error> {
        let origin = grid.origin();
        #[allow(clippy::cast_possible_truncation)] // some thousand cells of some millimetres
        let info = MapMetaData {
            map_load_time: time(us),
            resolution: (grid.cell_mm() / 1000.0) as f32,
            width: u32::try_from(grid.columns()).unwrap_or(u32::MAX),
            height: u32::try_from(grid.rows()).unwrap_or(u32::MAX),
            origin: messages::Pose {
                position: Xyz {
                    x: origin.x_mm / 1000.0,
                    y: origin.y_mm / 1000.0,
                    z: 0.0,
                },
                orientation: Quaternion::of_degrees(0.0),
            },
        };
        let cells = grid
            .cells()
            .map(|(column, row)| match grid.cell(column, row) {
                Cell::Occupied => 100,
                Cell::Free => 0,
                Cell::Unknown => -1,
            });
        let message = OccupancyGrid {
            header: header(us, "odom"),
            info,
            data: cells.collect(),
        };
        self.write("/map", us, &message)?;
        let finished = self.writer.finish();
        finished.map_err(|cause| Error::unwritable(&self.path, &cause))?;
        let file = self.writer.into_inner().into_inner();
        let synced = file
            .map_err(IntoInnerError::into_error)
            .and_then(|file| file.sync_all());
        synced.map_err(|cause| Error::unwritable(&self.path, &cause))
    }

    fn write<M: Message>(
        &mut self,
        topic: &'static str,
        us: u64,
        message: &M,
    ) -> Result<(), Error> {
        let written = self.try_write(topic, us, message);
        written.map_err(|cause| Error::unwritable(&self.path, &cause))
    }

    fn try_write<M: Message>(
        &mut self,
        topic: &'static str,
        us: u64,
        message: &M,
    ) -> McapResult<()> {
        if !self.channels.contains_key(topic) {
            let schema = self
                .writer
                .add_schema(M::NAME, "ros2msg", M::DEFINITION.as_bytes())?;
            let channel = self
                .writer
                .add_channel(schema, topic, "cdr", &BTreeMap::new())?;
            self.channels.insert(topic, (channel, 0));
        }
        let Some((channel_id, sequence)) = self.channels.get_mut(topic) else {
            return Ok(());
        };
        // CDR, little-endian.
        let mut data = vec![0, 1, 0, 0];
        data.extend(cdr_encoding::to_vec::<M, LittleEndian>(message).unwrap_or_default());
        *sequence += 1;
        let header = MessageHeader {
            channel_id: *channel_id,
            sequence: *sequence,
            log_time: us * 1000,
            publish_time: us * 1000,
        };
        self.writer.write_to_known_channel(&header, &data)
    }

    fn flush(&mut self) -> Result<(), Error> {
        self.writer
            .flush()
            .map_err(|cause| Error::unwritable(&self.path, &cause))
    }
}

fn time(us: u64) -> Time {
    Time {
        sec: i32::try_from(us / 1_000_000).unwrap_or(i32::MAX),
        nanosec: u32::try_from(us % 1_000_000 * 1000).unwrap_or_default(),
    }
}

fn header(us: u64, frame: &str) -> Header {
    Header {
        stamp: time(us),
        frame_id: frame.into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use host_link::pose::Pose;

    fn samples() -> Vec<RangeSample> {
        let sample = |n: u32| RangeSample {
            time_us: u64::from(n) * 25_000,
            pose: Pose::new(f64::from(n) * 1.5, -2.0, f64::from(n) % 170.0),
            ranges_mm: [Some(1234.5), None, Some(80.0)],
            bearing_deg: n.is_multiple_of(2).then(|| f64::from(n % 60) - 30.0),
            gyro_deg: (n > 3).then(|| f64::from(n) * 20.0),
        };
        (0..200).map(sample).collect()
    }

    fn recorded(name: &str, finish: bool) -> Vec<u8> {
        let path = std::env::temp_dir().join(format!("robot-{name}-{}.mcap", std::process::id()));
        let mut recorder = Recorder::create(&path).unwrap();
        for sample in samples() {
            recorder.add(&sample).unwrap();
        }
        if finish {
            recorder.finish(5_000_000, &Grid::new(25.0)).unwrap();
        } else {
            // As a kill: nothing that is buffered reaches the file.
            std::mem::forget(recorder);
        }
        let bytes = std::fs::read(&path).unwrap();
        std::fs::remove_file(path).unwrap();
        bytes
    }

    #[track_caller]
    fn assert_begins(read: &[RangeSample], least: usize) {
        assert!(read.len() >= least, "{} of {least}", read.len());
        for (read, expected) in read.iter().zip(samples()) {
            assert_eq!(read.time_us, expected.time_us);
            let close = |a: f64, b: f64| (a - b).abs() < 1e-3;
            assert!(
                close(read.pose.x_mm, expected.pose.x_mm)
                    && close(read.pose.rotation_deg, expected.pose.rotation_deg)
            );
            assert_eq!(
                read.ranges_mm.map(|mm| mm.map(f64::round)),
                expected.ranges_mm.map(|mm| mm.map(f64::round))
            );
            for (read, expected) in [
                (read.bearing_deg, expected.bearing_deg),
                (read.gyro_deg, expected.gyro_deg),
            ] {
                assert_eq!(
                    read.is_some(),
                    expected.is_some(),
                    "{}",
                    expected.unwrap_or_default()
                );
                // The gyroscope's whole turns before its first angle are not recorded.
                let turns = read.zip(expected).map_or(0.0, |(a, b)| (a - b) / 360.0);
                assert!(close(turns, turns.round()), "{read:?} {expected:?}");
            }
        }
    }

    // Requirement: WIRE-program-5
    #[test]
    fn recording_reads_back_and_up_to_any_cut() {
        let whole = recorded("whole", true);
        assert_begins(&parse(&whole).unwrap(), 200);
        for len in (0..whole.len()).step_by(977) {
            if let Ok(read) = parse(&whole[..len]) {
                assert_begins(&read, 0);
            }
        }
        assert!(
            parse(b"time_us,x_mm\n")
                .unwrap_err()
                .contains("no recording")
        );
    }

    // Requirement: WIRE-program-5
    #[test]
    fn killed_recording_lacks_at_most_half_a_second() {
        assert_begins(&parse(&recorded("killed", false)).unwrap(), 200 - 20);
    }
}
