//! Recordings that are read back: whole, cut, and of a full disk.

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
        silent: [false; 3],
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
        let finished = recorder.finish(5_000_000, &Grid::new(25.0), Pose::default());
        finished.unwrap();
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
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cut.mcap");
    for (len, is_cut) in [(whole.len(), false), (whole.len() - 1, true)] {
        std::fs::write(&path, &whole[..len]).unwrap();
        let (_, read, cut) = load(&path).unwrap();
        assert_eq!((read.len(), cut.is_some()), (200, is_cut));
        assert!(cut.is_none_or(|cut| cut.contains("its first 200 reports")));
    }
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

#[test]
fn full_disk_is_named_with_its_file_and_advice() {
    let folder = tempfile::tempdir().unwrap();
    let mut recorder = create(&folder.path().join("drive.mcap"));
    let full = File::options().write(true).open("/dev/full").unwrap();
    recorder.writer = WriteOptions::new().create(BufWriter::new(full)).unwrap();
    recorder.channels.clear();
    let mut samples = samples().into_iter();
    let full = samples.find_map(|sample| recorder.add(&sample).err());
    let text = full.unwrap().to_string();
    for expected in ["drive.mcap: No space", "another disk"] {
        assert!(text.contains(expected), "{text}");
    }
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
    let finished = recorder.finish(0, &Grid::new(25.0), Pose::default());
    finished.unwrap();
    let refused = load(&path).unwrap_err().to_string();
    assert!(refused.contains("no report of a pose"), "{refused}");
}
