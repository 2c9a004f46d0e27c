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
use mcap::{McapResult, WriteOptions, Writer};
use std::collections::BTreeMap;
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
    /// Sequence number and id of each topic's channel.
    channels: BTreeMap<&'static str, (u16, u32)>,
    front: Option<Pose>,
    flushed_us: u64,
    slow_us: Option<u64>,
}

impl Recorder {
    /// Begins the recording of a robot.
    ///
    /// # Errors
    /// [`Error::Unwritable`]; those of [`eeprom::read`] and [`Settings::from_image`].
    pub fn of(io: &mut BoardIo, path: &Path, body_mm: f64) -> Result<Self, Error> {
        let settings = Settings::from_image(&eeprom::read(io)?)?;
        Self::create(path, &settings, body_mm, io.clock.micros())
    }

    /// Begins the file, with the settings. They are written before it is seen at its path.
    ///
    /// # Errors
    /// [`Error::Unwritable`].
    pub fn create(path: &Path, settings: &Settings, body_mm: f64, us: u64) -> Result<Self, Error> {
        let file = OutputFile::create(path, Kind::Recording)?;
        let sensors = sensor_poses(settings.config(), body_mm);
        let options = WriteOptions::new()
            .compression(None)
            .profile("ros2")
            .library("robot");
        let mut recorder = Self {
            path: path.into(),
            writer: options
                .create(BufWriter::new(file.handle()?))
                .map_err(|cause| Error::unwritable(path, &cause))?,
            channels: BTreeMap::new(),
            front: sensors[0],
            flushed_us: 0,
            slow_us: None,
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
        if self
            .slow_us
            .is_some_and(|last| us.saturating_sub(last) < SLOW_US)
        {
            return Ok(());
        }
        self.slow_us = Some(us);
        self.write("/battery_state", us, &BatteryState::of(us, snapshot))?;
        self.write("/diagnostics", us, &DiagnosticArray::of(us, snapshot))
    }

    /// Adds the map, with the origin of the reported poses in it, and ends the file with its index.
    ///
    /// # Errors
    /// [`Error::Unwritable`].
    pub fn finish(mut self, us: u64, grid: &Grid, odom: Pose) -> Result<(), Error> {
        let transforms = vec![TransformStamped::of(us, "map", "odom", odom)];
        self.write("/tf_static", us, &TfMessage { transforms })?;
        let message = OccupancyGrid::of(us, "map", grid);
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
        const { assert!(!M::DEFINITION.is_empty()) };
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mapping::BODY_MM;
    use fw_core::eeprom::{Config, Image};

    fn create(path: &Path) -> Recorder {
        Recorder::create(path, &Settings::sample().unwrap(), BODY_MM, 0).unwrap()
    }

    fn samples() -> Vec<RangeSample> {
        let sample = |n: u32| RangeSample {
            time_us: u64::from(n) * 25_000,
            pose: Pose::new(f64::from(n) * 1.5, -2.0, f64::from(n) % 170.0),
            ranges_mm: [Some(1234.5), None, Some(80.0)],
            bearing_deg: n.is_multiple_of(2).then(|| f64::from(n % 60) - 30.0),
            gyro_deg: (n > 3 && n != 50).then(|| f64::from(n) * 20.0),
        };
        (0..200).map(sample).collect()
    }

    fn nowhere() -> RangeSample {
        RangeSample {
            pose: Pose::new(f64::NAN, 0.0, 0.0),
            gyro_deg: Some(90.0),
            ..RangeSample::default()
        }
    }

    fn recorded(finish: bool) -> Vec<u8> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("drive.mcap");
        let mut recorder = create(&path);
        let mut snapshot = Snapshot::new(&Config::decode(&Image::FIRST_BOARD).unwrap());
        // It is left out, and its angle is no other's.
        recorder.add(&nowhere()).unwrap();
        for sample in samples() {
            recorder.add(&sample).unwrap();
            snapshot.time_us = sample.time_us;
            recorder.add_state(&snapshot).unwrap();
        }
        if finish {
            recorder
                .finish(5_000_000, &Grid::new(25.0), Pose::default())
                .unwrap();
        } else {
            // As a kill: nothing that is buffered reaches the file.
            std::mem::forget(recorder);
        }
        std::fs::read(&path).unwrap()
    }

    #[track_caller]
    fn assert_begins(read: &[RangeSample], least: usize) {
        assert!(read.len() >= least, "{} of {least}", read.len());
        for (read, expected) in read.iter().zip(samples()) {
            assert_eq!(read.time_us, expected.time_us);
            let close = |a: f64, b: f64| (a - b).abs() < 1e-3;
            assert!(read.pose.distance_mm(expected.pose) < 1e-3);
            assert!(close(read.pose.rotation_deg, expected.pose.rotation_deg));
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
        let whole = recorded(true);
        assert_begins(&parse(&whole).unwrap().1, 200);
        for len in (0..whole.len()).step_by(977) {
            if let Ok((_, read)) = parse(&whole[..len]) {
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
        assert_begins(&parse(&recorded(false)).unwrap().1, 200 - 20);
    }

    // Requirement: WIRE-program-1
    #[test]
    fn recording_has_its_header_whenever_it_is_seen() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("drive.mcap");
        drop(create(&path));
        std::thread::scope(|scope| {
            let writes = scope.spawn(|| (0..50).for_each(|_| drop(create(&path))));
            while !writes.is_finished() {
                let read = parse(&std::fs::read(&path).unwrap());
                assert!(matches!(read, Ok((Some(_), reports)) if reports.is_empty()));
            }
        });
    }

    #[test]
    fn topics_are_numbered_and_slow_ones_come_once_a_second() {
        let bytes = recorded(true);
        let mut topics: BTreeMap<String, Vec<(u32, u64)>> = BTreeMap::new();
        for message in mcap::MessageStream::new(&bytes).unwrap() {
            let message = message.unwrap();
            let messages = topics.entry(message.channel.topic.clone()).or_default();
            messages.push((message.sequence, message.log_time / 1_000_000));
            if message.channel.topic == TF {
                let tf = cdr_encoding::from_bytes::<TfMessage, LittleEndian>(&message.data[4..]);
                let tf = tf.unwrap().0.transforms;
                let parents = tf.iter().map(|one| one.header.frame_id.as_str());
                assert!(parents.eq(["odom", "base_link"].into_iter().take(tf.len())));
            }
        }
        for (topic, messages) in &topics {
            let numbers = messages.iter().map(|message| message.0);
            assert!(numbers.eq((1..).take(messages.len())), "{topic}");
        }
        // 200 reports in 5 s.
        for topic in ["/battery_state", "/diagnostics"] {
            let at_ms = topics[topic].iter().map(|message| message.1);
            assert!(at_ms.eq((0..5).map(|second| second * 1000)), "{topic}");
        }
        assert_eq!(topics[POSE].len(), 201);
        assert_eq!(topics["/map"], [(1, 5000)]);
    }

    #[test]
    fn gyroscope_goes_on_from_turn_to_turn() {
        let (settings, read) = parse(&recorded(true)).unwrap();
        let settings = Settings::parse(&settings.unwrap(), Path::new(""));
        assert_eq!(settings, Settings::sample());
        let gyro = |n: u8| read[usize::from(n)].gyro_deg.unwrap();
        for n in [5, 40, 199] {
            let turned = 20.0 * f64::from(n - 4);
            assert!((gyro(n) - gyro(4) - turned).abs() < 1e-3, "{n}");
        }
    }

    #[test]
    fn recording_without_a_pose_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("drive.mcap");
        let mut recorder = create(&path);
        recorder.add(&nowhere()).unwrap();
        recorder
            .finish(0, &Grid::new(25.0), Pose::default())
            .unwrap();
        let refused = load(&path).unwrap_err().to_string();
        assert!(refused.contains("no report of a pose"), "{refused}");
    }
}
