//! Any text as a tour: way-points within the accepted range, or faults within the text's lines.
#![no_main]

use host_link::pose::MAX_COORDINATE_MM;
use libfuzzer_sys::fuzz_target;
use pilot::waypoints::{MAX_ROTATION_DEG, parse};
use std::path::Path;

fuzz_target!(|text: &str| match parse(text) {
    Ok(tour) => {
        assert!(!tour.is_empty());
        for pose in tour {
            assert!(pose.x_mm.abs().max(pose.y_mm.abs()) <= MAX_COORDINATE_MM);
            assert!(pose.rotation_deg.abs() <= MAX_ROTATION_DEG);
        }
    }
    Err(faults) => {
        assert!(!faults.is_empty());
        let lines = text.lines().count();
        for fault in faults {
            assert!(fault.line.is_none_or(|line| (1..=lines).contains(&line)));
            assert!(fault.describe(Path::new("tour")).starts_with("tour"));
        }
    }
});
