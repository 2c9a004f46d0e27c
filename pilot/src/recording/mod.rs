//! Recordings: MCAP files with ROS 2 messages, streamed while driving. What a killed run leaves is read up
//! to its cut.

mod reader;
mod records;

pub use reader::{load, parse};

use crate::mapping::{RangeSample, sensor_poses};
use crate::ros_messages::{
    BatteryState, DiagnosticArray, Header, Imu, Message, OccupancyGrid, PoseStamped, Quaternion,
    RANGE_FRAMES, Range, Text, TfMessage, TransformStamped,
};
use byteorder::LittleEndian;
use fw_core::wire::Field;
use host_link::board_io::BoardIo;
use host_link::eeprom;
use host_link::error::Error;
use host_link::file::{Kind, OutputFile};
use host_link::pose::Pose;
use host_link::settings::{self, Settings};
use host_link::snapshot::Snapshot;
use mapper::Grid;
use mcap::records::MessageHeader;
use mcap::{McapError, WriteOptions, Writer};
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::fs::File;
use std::io::{BufWriter, IntoInnerError};
use std::path::{Path, PathBuf};

/// A kill loses at most this much, microseconds.
const FLUSH_US: u64 = 500_000;
/// Time between two messages of battery, faults and link, microseconds.
const SLOW_US: u64 = 1_000_000;

const RANGES: [&str; 3] = ["/range/front", "/range/right", "/range/left"];
/// What the EEPROM held, as the settings file writes it.
const SETTINGS: &str = "/settings";
const POSE: &str = "/pose";
const TF: &str = "/tf";
const IMU: &str = "/imu";

/// Writes a recording.
// Requirement: WIRE-program-5
pub struct Recorder {
    path: PathBuf,
    writer: Writer<BufWriter<File>>,
    /// Id and last sequence number of each topic's channel.
    channels: BTreeMap<&'static str, (u16, u32)>,
    front: Option<Pose>,
    flushed_us: u64,
    slow_us: Option<u64>,
    /// The first failure of [`Self::record`].
    outcome: Result<(), Error>,
}

impl Recorder {
    /// Begins the recording of a robot.
    ///
    /// # Errors
    /// [`Error::Unwritable`]; those of [`eeprom::read`] and [`Settings::from_image`].
    pub fn of(io: &mut BoardIo, path: &Path, body_mm: f64) -> Result<Self, Error> {
        let settings = Settings::from_image(&eeprom::read(io)?)?;
        Self::create(path, &settings, body_mm, (io.clock)())
    }

    /// Begins the file, with the settings. They are written before it is seen at its path.
    ///
    /// # Errors
    /// [`Error::Unwritable`].
    pub fn create(path: &Path, settings: &Settings, body_mm: f64, us: u64) -> Result<Self, Error> {
        let file = OutputFile::create(path, Kind::Recording)?;
        let sensors = sensor_poses(settings.config(), body_mm);
        let options = WriteOptions::new().compression(None);
        let options = options.profile("ros2").library("robot");
        let mut recorder = Self {
            path: path.into(),
            writer: options
                .create(BufWriter::new(file.handle()?))
                .map_err(|cause| unwritable(path, cause))?,
            channels: BTreeMap::new(),
            front: sensors[0],
            flushed_us: 0,
            slow_us: None,
            outcome: Ok(()),
        };
        let data = settings::render(settings);
        recorder.write(SETTINGS, us, &Text { data })?;
        let sweeps = settings.config().mode().has(Field::Bearing);
        let fixed = RANGE_FRAMES.iter().zip(sensors).skip(sweeps.into());
        let transforms = fixed
            .filter_map(|(frame, at)| Some(TransformStamped::of(us, "base_link", frame, at?)))
            .collect();
        recorder.write("/tf_static", us, &TfMessage { transforms })?;
        recorder.flush()?;
        file.publish()?;
        Ok(recorder)
    }

    /// Adds a report and its snapshot's state. After a failure the drive goes on without; [`Self::finish`] has it.
    pub fn record(&mut self, sample: &RangeSample, snapshot: &Snapshot) {
        if self.outcome.is_ok() {
            let added = self.add(sample);
            self.outcome = added.and_then(|()| self.add_state(snapshot));
        }
    }

    /// Adds a report.
    ///
    /// # Errors
    /// [`Error::Unwritable`].
    pub fn add(&mut self, sample: &RangeSample) -> Result<(), Error> {
        let (us, pose) = (sample.time_us, sample.pose);
        for ((topic, frame), range) in RANGES.into_iter().zip(RANGE_FRAMES).zip(sample.ranges_mm) {
            self.write(topic, us, &Range::of(us, frame, range))?;
        }
        if let Some(gyro) = sample.gyro_deg {
            let mut unknown = [0.0; 9];
            unknown[0] = -1.0;
            let message = Imu {
                header: Header::of(us, "base_link"),
                orientation: Quaternion::of_degrees(gyro),
                angular_velocity_covariance: unknown,
                linear_acceleration_covariance: unknown,
                ..Imu::default()
            };
            self.write(IMU, us, &message)?;
        }
        let mut transforms = vec![TransformStamped::of(us, "odom", "base_link", pose)];
        if let Some((bearing, mut front)) = sample.bearing_deg.zip(self.front) {
            front.rotation_deg = bearing;
            let frame = RANGE_FRAMES[0];
            transforms.push(TransformStamped::of(us, "base_link", frame, front));
        }
        self.write(TF, us, &TfMessage { transforms })?;
        // The reader takes a report as complete with its pose.
        let message = PoseStamped {
            header: Header::of(us, "odom"),
            pose: pose.into(),
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
        let is_early = |last| us.saturating_sub(last) < SLOW_US;
        if self.slow_us.is_some_and(is_early) {
            return Ok(());
        }
        self.slow_us = Some(us);
        self.write("/battery_state", us, &BatteryState::of(us, snapshot))?;
        self.write("/diagnostics", us, &DiagnosticArray::of(us, snapshot))
    }

    /// Adds the map, with the origin of the reported poses in it, and ends the file with its index.
    ///
    /// # Errors
    /// [`Error::Unwritable`]; the first failure of [`Self::record`].
    pub fn finish(mut self, us: u64, grid: &Grid, odom: Pose) -> Result<(), Error> {
        let outcome = std::mem::replace(&mut self.outcome, Ok(()));
        outcome.and(self.end(us, grid, odom))
    }

    fn end(mut self, us: u64, grid: &Grid, odom: Pose) -> Result<(), Error> {
        let transforms = vec![TransformStamped::of(us, "map", "odom", odom)];
        self.write("/tf_static", us, &TfMessage { transforms })?;
        let message = OccupancyGrid::of(us, grid);
        self.write("/map", us, &message)?;
        let finished = self.writer.finish();
        finished.map_err(|cause| unwritable(&self.path, cause))?;
        let file = self.writer.into_inner().into_inner();
        let synced = file
            .map_err(IntoInnerError::into_error)
            .and_then(|file| file.sync_all());
        synced.map_err(|cause| unwritable(&self.path, cause.into()))
    }

    fn write<M: Message>(
        &mut self,
        topic: &'static str,
        us: u64,
        message: &M,
    ) -> Result<(), Error> {
        let mut write = || {
            let (channel_id, sequence) = match self.channels.entry(topic) {
                Entry::Occupied(known) => known.into_mut(),
                Entry::Vacant(new) => {
                    let (writer, definition) = (&mut self.writer, M::definition());
                    let schema = writer.add_schema(M::NAME, "ros2msg", definition.as_bytes())?;
                    let channel = writer.add_channel(schema, topic, "cdr", &BTreeMap::new())?;
                    new.insert((channel, 0))
                }
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
        };
        write().map_err(|cause| unwritable(&self.path, cause))
    }

    fn flush(&mut self) -> Result<(), Error> {
        let flushed = self.writer.flush();
        flushed.map_err(|cause| unwritable(&self.path, cause))
    }
}

/// The recording at `path` has ended.
fn unwritable(path: &Path, cause: McapError) -> Error {
    let cause = match cause {
        McapError::Io(cause) => cause.to_string(),
        cause => cause.to_string(),
    };
    let advice = "make room there or record to another disk, and repeat the drive";
    Error::unwritable(path, &format!("{cause}; {advice}"))
}

#[cfg(test)]
mod tests;
