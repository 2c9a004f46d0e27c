//! Reads recordings.

use super::{IMU, POSE, RANGES, SETTINGS, TF, records};
use crate::mapping::RangeSample;
use crate::ros_messages::{
    Imu, PoseStamped, RANGE_FRAMES, Range, Text, TfMessage, TransformStamped,
};
use byteorder::LittleEndian;
use host_link::error::Error;
use host_link::file;
use host_link::pose::Pose;
use host_link::settings::Settings;
use mcap::MessageStream;
use serde::de::DeserializeOwned;
use std::path::Path;

/// Largest recording that is read, bytes: two hours.
const MAX_LEN: u64 = 1 << 28;
/// Largest settings that are read, bytes.
const MAX_SETTINGS: usize = 1 << 16;

/// Reads a recording's settings, without which they are the first board's, and its reports; of one that is cut
/// off or damaged what comes before that, and a sentence of it.
///
/// # Errors
/// [`Error::Unreadable`]; [`Error::Content`] for what is no recording, or has no report; those of
/// [`Settings::parse`].
pub fn load(path: &Path) -> Result<(Settings, Vec<RangeSample>, Option<String>), Error> {
    let bytes = file::read(path, MAX_LEN)?;
    let (text, samples) = parse(&bytes).map_err(|what| Error::content(path, None, what))?;
    if samples.is_empty() {
        return Err(Error::content(path, None, "it has no report of a pose"));
    }
    if text.as_ref().is_some_and(|text| text.len() > MAX_SETTINGS) {
        return Err(Error::content(path, None, "its settings exceed 64 KiB"));
    }
    let settings = text.map(|text| Settings::parse(&text, path));
    let settings = settings.unwrap_or_else(Settings::first_board)?;
    let cut = (!records::is_whole(&bytes)).then(|| {
        let (path, reports) = (path.display(), samples.len());
        format!("{path} is cut off or damaged; its first {reports} reports are used")
    });
    Ok((settings, samples, cut))
}

/// The settings file and the reports among a recording's bytes.
///
/// # Errors
/// What is wrong with its beginning.
pub fn parse(bytes: &[u8]) -> Result<(Option<String>, Vec<RangeSample>), String> {
    if !bytes.starts_with(b"\x89MCAP0\r\n") {
        return Err("no recording: it does not begin as MCAP does".into());
    }
    let records = records::sound(bytes);
    let stream =
        MessageStream::new_with_options(&records, mcap::read::Options::IgnoreEndMagic.into());
    let stream = stream.map_err(|cause| format!("no recording: {cause}"))?;
    let mut samples: Vec<RangeSample> = Vec::new();
    let (mut settings, mut pending) = (None, RangeSample::default());
    // A broken record is where the file was cut.
    for message in stream.map_while(Result::ok) {
        let Some(data) = message.data.get(4..) else {
            continue;
        };
        let topic = message.channel.topic.as_str();
        if let Some(index) = RANGES.iter().position(|range| *range == topic) {
            let range = decode::<Range>(data).map(|message| f64::from(message.range) * 1000.0);
            pending.ranges_mm[index] = range.filter(|mm| mm.is_finite());
        } else if topic == IMU {
            let last = samples.iter().rev().find_map(|sample| sample.gyro_deg);
            let degrees = decode::<Imu>(data).map(|message| message.orientation.degrees());
            pending.gyro_deg = degrees
                .filter(|degrees| degrees.is_finite())
                .map(|degrees| unwrap(degrees, last));
        } else if topic == SETTINGS {
            settings = decode(data).map(|Text { data }| data);
        } else if topic == TF {
            let transforms = decode::<TfMessage>(data).unwrap_or_default().transforms;
            let is_front = |one: &&TransformStamped| one.child_frame_id == RANGE_FRAMES[0];
            let front = transforms.iter().find(is_front);
            let degrees = front.map(|one| one.transform.rotation.degrees());
            pending.bearing_deg = degrees.filter(|degrees| degrees.is_finite());
        } else if topic == POSE {
            let Some(PoseStamped { pose, .. }) = decode(data) else {
                continue;
            };
            let degrees = pose.orientation.degrees();
            let pose = Pose::new(pose.position.x * 1000.0, pose.position.y * 1000.0, degrees);
            if pose.x_mm.is_finite() && pose.y_mm.is_finite() && degrees.is_finite() {
                samples.push(RangeSample {
                    time_us: message.log_time / 1000,
                    pose,
                    ..pending
                });
            }
            pending = RangeSample::default();
        }
    }
    Ok((settings, samples))
}

fn decode<T: DeserializeOwned>(data: &[u8]) -> Option<T> {
    let decoded = cdr_encoding::from_bytes::<T, LittleEndian>(data);
    Some(decoded.ok()?.0)
}

/// The angle nearest to the last one, degrees.
fn unwrap(degrees: f64, last: Option<f64>) -> f64 {
    let last = last.unwrap_or(degrees);
    last + (degrees - last + 180.0).rem_euclid(360.0) - 180.0
}
