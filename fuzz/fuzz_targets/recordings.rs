//! Any bytes as a recording: refused, or finite reports in their order; a cut never adds one.
#![no_main]

use libfuzzer_sys::fuzz_target;
use pilot::recording::parse;

fuzz_target!(|data: &[u8]| {
    let Ok((_, samples)) = parse(data) else {
        return;
    };
    for sample in &samples {
        let finite = [sample.pose.x_mm, sample.pose.y_mm, sample.pose.rotation_deg];
        let sensors = sample
            .ranges_mm
            .into_iter()
            .chain([sample.bearing_deg, sample.gyro_deg]);
        assert!(sensors.flatten().chain(finite).all(f64::is_finite));
    }
    if let Ok((_, cut)) = parse(&data[..data.len() / 2]) {
        assert!(cut.len() <= samples.len() && samples.starts_with(&cut));
    }
});
