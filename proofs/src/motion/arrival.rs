//! T17: the time in which a robot that drives to a target arrives or gives up.
//!
//! By induction: each tick of a motion uses up one of its ticks, and nothing but another motion, or the
//! obstacle stop, gives it any. So whatever the wheels do, a motion lasts no longer than its first tick allowed.

use fw_core::eeprom::Config;
use fw_core::motion::ArrivalTimer;

use crate::eeprom::accepted::AcceptedConfig;
use crate::property::Seen;

/// Ticks that the slower wheel's quarter of its full speed, or the reverse speed if any, takes for a way
/// along x and y and four tracks, and 10 s.
pub fn stated_ticks(config: &Config, (x, y): (u32, u32)) -> u64 {
    let slower = config
        .left()
        .full_speed_mm_s
        .min(config.right().full_speed_mm_s);
    let reverse = config.obstacle_stop().reverse_speed_mm_s;
    let slower = if reverse == 0 {
        slower
    } else {
        slower.min(4 * reverse)
    };
    let way = u64::from(x) + u64::from(y) + 4 * u64::from(config.track().0);
    1000 + way * 400 / (1000 * u64::from(slower))
}

/// Inductive step, from any state of the timer of any accepted configuration: a motion's first tick
/// allows at least 10 s, each other one uses up one unless it is held back, and once over it remains over.
/// Only the end of the motion resets it.
// Requirement: WIRE-fault-15
pub fn time_of_a_motion_runs_down(
    timer: ArrivalTimer,
    moving: bool,
    held_back: bool,
    way: (u32, u32),
) -> Seen {
    // 1 mm/s and 2 m: the configuration's limits.
    given!(timer.pace <= 26_843_545 && timer.turns <= 8_000_000);
    let mut after = timer;
    let over = after.step(moving, held_back, || way.into());
    let runs = u32::from(!held_back);
    match (moving, timer.left) {
        (false, _) => assert!(!over && after.left == 0),
        (true, 0) => assert!(!over && after.left >= 1000),
        (true, 1) => assert!(over && after.left == 1),
        (true, left) => assert!(after.left == left - runs && over == (after.left == 1)),
    }
    after.restart();
    assert!(after.left == 0 && after == ArrivalTimer { left: 0, ..timer });
    Seen::NOTHING
        .case(0, moving && timer.left == 0 && way.0 > 0)
        .case(1, moving && timer.left == 2 && over)
        .case(2, moving && timer.left > 1 && held_back)
        .case(3, !moving && timer.left > 0)
}

/// The time of any motion is the stated one, to a tick and 2⁻¹².
// Requirement: WIRE-fault-15
pub fn allowed_time_is_the_stated_one(values: AcceptedConfig, way: (u32, u32)) -> Seen {
    given!(let Some(config) = values.config());
    let mut timer = ArrivalTimer::new(&config);
    assert!(timer.pace <= 26_843_545 && timer.turns <= 8_000_000);
    assert!(!timer.step(true, false, || way.into()));
    let (stated, allowed) = (stated_ticks(&config, way), u64::from(timer.left));
    assert!(allowed <= stated && stated - allowed <= 1 + (stated >> 12));
    seen!(stated > 1 << 30, stated < 1100, way.0 < 100 && way.1 > 100)
}

crate::properties! {
    theorem T17 time_of_a_motion_runs_down(
        timer: ArrivalTimer, moving: bool, held_back: bool, way: (u32, u32)
    ) {
        cases ["it begins", "it is over", "it is held back", "it ended"];
        kani proof [unwind(4)];
        sampled 300_000;
    }
    property T17 allowed_time_is_the_stated_one(values: AcceptedConfig, way: (u32, u32)) {
        cases ["months", "eleven seconds", "almost straight along y"];
        needs [accepted_configuration_is_bounded];
        sampled 50_000;
    }
}
