//! Any text as a room: everything within the accepted range, or a fault of one of its lines.
#![no_main]

use libfuzzer_sys::fuzz_target;
use plant::Room;

fuzz_target!(|text: &str| match Room::parse(text) {
    Ok(room) => {
        let (low, high) = room.bounds();
        // A turned box of the largest size at the farthest place.
        let far = [low.x_mm, low.y_mm, high.x_mm, high.y_mm];
        let is_near = |mm: f64| mm.abs() <= 300_000.0;
        let empty = room.segments.is_empty() && room.circles.is_empty();
        assert!(empty || far.into_iter().all(is_near), "{far:?}");
    }
    Err(error) => assert!((1..=text.lines().count()).contains(&error.line)),
});
