//! Figures of the robot's motion: what is assumed of them, and what is learned.

/// Noise of the motion, and how well the robot is calibrated at the start. Deviations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionNoise {
    /// Distance between the wheels as configured, mm.
    pub track_mm: f64,
    /// Error of one wheel's travel, mm per √mm.
    pub wheel: f64,
    /// Error of the position that neither sensor sees (slip on sills and carpets), mm per √mm.
    pub slip: f64,
    /// How much later the gyroscope's angle is than the encoders', s.
    pub gyro_lag_s: f64,
    /// Angular random walk of the gyroscope, rad per √s.
    pub gyro_walk: f64,
    /// Random walk of its bias, rad/s per √s.
    pub bias_walk: f64,
    /// Random walk of the four scales, relative per √s: what was learned ages.
    pub scale_walk: f64,
    /// Initial error of the travel's scale, of the wheels' ratio, of the turn's scale (track), of
    /// the gyroscope's scale: relative; and of its bias, rad/s.
    pub calibration: [f64; 5],
}

impl Default for MotionNoise {
    /// The first board on a floor with texture; an MPU6050 with its first bias taken off.
    fn default() -> Self {
        Self {
            track_mm: 125.0,
            // 0.15 mm per √(100 mm)
            wheel: 0.015,
            // 3 mm per √m: a sill of up to 10 mm every few metres
            slip: 0.1,
            // A tick from the reading to the angle, measured on the virtual board.
            gyro_lag_s: 0.0095,
            gyro_walk: 0.01f64.to_radians(),
            // 0.02 °/s per minute
            bias_walk: 0.003f64.to_radians(),
            // 0.1 % in an hour: 6 K of an MPU6050 (2 % from 25 to 85 °C), or of tyres
            scale_walk: 1.7e-5,
            calibration: [0.003, 0.004, 0.005, 0.007, 0.02f64.to_radians()],
        }
    }
}

/// Estimated calibration with deviations in the second place of each pair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CalibrationEstimate {
    /// True travel divided by the reported one (mean of both wheels).
    pub travel_scale: (f64, f64),
    /// True ratio of the right wheel's diameter to the left one's, divided by the configured ratio.
    pub wheel_ratio: (f64, f64),
    /// True track divided by the configured one.
    pub track_scale: (f64, f64),
    /// True turn divided by the gyroscope's.
    pub gyro_scale: (f64, f64),
    /// Rate that the gyroscope's angle still drifts with, rad/s.
    pub gyro_bias_rad_s: (f64, f64),
}
