//! A stand-in for localisation and mapping that makes no errors.

use geometry::Pose2;
use mapper::{Grid, Mount, PoseEstimate, SonarModel};
use plant::Room;
use plant::kinematic::SensorSample;

use crate::closed_loop::Mapping;

/// The true pose, and a map from it with the readings that the true room explains: what a perfect
/// localisation and rejection of multi-path echoes would give.
pub struct IdealMapper {
    grid: Grid,
    pose: Pose2,
    ranges_mm: [Option<f64>; 3],
}

impl IdealMapper {
    pub fn new(grid: Grid) -> Self {
        Self {
            grid,
            pose: Pose2::default(),
            ranges_mm: [None; 3],
        }
    }
}

impl Mapping for IdealMapper {
    fn estimate(&self) -> PoseEstimate {
        let covariance = [[100.0, 0.0, 0.0], [0.0, 100.0, 0.0], [0.0, 0.0, 1e-4]];
        PoseEstimate {
            pose: self.pose,
            covariance,
        }
    }

    fn grid(&self) -> &Grid {
        &self.grid
    }

    fn observe(&mut self, room: &Room, pose: &Pose2, sample: &SensorSample) {
        self.pose = *pose;
        let mut mounts = Mount::first_board();
        mounts[0].bearing_rad = sample.front_bearing_rad;
        for (nth, mount) in mounts.iter().enumerate() {
            let range = sample.ranges_mm[nth];
            let sensor = mount.sensor_pose(pose);
            let truth = room.cast(&sensor).map_or(4000.0, |hit| hit.distance_mm);
            let mut sonar = SonarModel {
                half_angle_rad: 0.12,
                ..SonarModel::default()
            };
            match range {
                Some(range) if Some(range) != self.ranges_mm[nth] => {
                    if (range - truth).abs() < 40.0 {
                        sonar.enter_echo(&mut self.grid, &sensor, truth);
                    } else {
                        sonar.silent_mm = range.min(truth) - 60.0;
                        sonar.enter_silence(&mut self.grid, &sensor);
                    }
                }
                None if sample.time_s > 0.2 => {
                    sonar.silent_mm = truth.min(800.0) - 60.0;
                    sonar.free = 0.3;
                    sonar.enter_silence(&mut self.grid, &sensor);
                }
                _ => {}
            }
            self.ranges_mm[nth] = range;
        }
    }
}
