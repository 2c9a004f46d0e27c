//! The server's map: its localiser, and the reports that it has not taken yet.

use crate::mapping::reported_pose;
use crate::serve::protocol::Estimate;
use mapper::{Localiser, Observation, PoseEstimate};
use std::panic::resume_unwind;
use std::thread::{JoinHandle, spawn};

#[derive(Default)]
pub(super) struct Map {
    /// None before the first report, and while another thread has it.
    pub localiser: Option<Localiser>,
    busy: Option<JoinHandle<Localiser>>,
    pub waiting: Vec<Observation>,
    /// The latest.
    pub estimate: Option<Estimate>,
}

impl Map {
    pub fn put(&mut self, localiser: Localiser) {
        let PoseEstimate { pose, covariance } = localiser.estimate();
        self.estimate = Some(Estimate {
            pose: reported_pose(&pose),
            deviation_mm: (covariance[0][0] + covariance[1][1]).sqrt(),
        });
        self.localiser = Some(localiser);
    }

    /// Takes the localiser back from a thread that is done, or that is waited for.
    pub fn collect(&mut self, wait: bool) {
        let done = self.busy.take_if(|busy| wait || busy.is_finished());
        match done.map(JoinHandle::join) {
            None => {}
            Some(Ok(localiser)) => self.put(localiser),
            Some(Err(panic)) => resume_unwind(panic),
        }
    }

    /// Gives the localiser and what waits for it to another thread.
    pub fn work_beside(&mut self) {
        if let Some(mut localiser) = self.localiser.take() {
            let waiting = std::mem::take(&mut self.waiting);
            self.busy = Some(spawn(move || {
                for one in &waiting {
                    localiser.observe(one);
                }
                localiser
            }));
        }
    }
}

#[test]
fn reports_that_wait_are_taken_in_order_on_another_thread() {
    let mut map = Map::default();
    map.put(Localiser::new(mapper::LocaliserConfig::default()));
    for nth in 0..50 {
        map.waiting.push(Observation {
            time_s: 0.025 * f64::from(nth),
            odometry: mapper::Pose2::new(4.0 * f64::from(nth), 0.0, 0.0),
            gyro_rad: None,
            ranges_mm: [None; 3],
            front_bearing_rad: None,
        });
        map.collect(false);
        map.work_beside();
    }
    map.collect(true);
    map.work_beside();
    map.collect(true);
    assert!(map.waiting.is_empty() && map.localiser.is_some());
    let Estimate { pose, deviation_mm } = map.estimate.unwrap();
    assert!((pose.x_mm - 196.0).abs() < 2.0, "{pose:?}");
    let [[x, ..], [_, y, _], _] = map.localiser.unwrap().estimate().covariance;
    assert!((deviation_mm.powi(2) - x - y).abs() < 1e-6, "{x} {y}");
}
