//! Mode 0x20: the servo turned by real pulses, every reading with the bearing it was taken at, and the map
//! that comes of it.

use fw_core::eeprom::{first_board, Config};
use fw_core::wire::{Command, Mode, PiLink, Report, Setup, MAX_FRAME};
use host_link::settings::Settings;
use host_link::snapshot::distance_mm;
use mapper::Point;
use pilot::mapping::{mapper_config, Mapping, RangeSample};
use robot_tests::test_board::Rig;
use twin::board_model::Ping;
use twin::plant::Params;
use twin::{Board, Options};

fn config(change: impl FnOnce(&mut Config)) -> Config {
    let mut config = first_board();
    config.mode = Mode::GuardedSweep;
    config.platform.servo = true;
    change(&mut config);
    config
}

/// A robot in the sweep mode and the Pi's end of its link.
struct Swept {
    rig: Rig,
    pi: PiLink,
    config: Config,
}

impl Swept {
    fn new(config: Config, params: Params) -> Self {
        let settings = Settings {
            config: config.clone(),
            platform_page: true,
        };
        let rig = Rig::new(Options {
            eeprom: Some(settings.image().to_vec()),
            params,
            ..Options::default()
        });
        assert!(rig.await_ready(), "{}", rig.log());
        rig.board.run_us(20_000);
        Self {
            rig,
            pi: PiLink::new(Setup::from(&config)),
            config,
        }
    }

    /// Frames at 40 Hz for `us`: what each reply said, and when it went out.
    fn frames(&mut self, us: u64) -> Vec<(u64, Report)> {
        let ends = self.rig.board.now_us() + us;
        let mut all = Vec::new();
        while self.rig.board.now_us() < ends {
            let mut frame = [0; MAX_FRAME];
            let len = self.pi.send(&Command::default(), &mut frame);
            let at = self.rig.board.now_ns();
            let back = self.rig.frame(&frame[..len]);
            all.push((at, self.pi.receive(&back).expect("a valid reply")));
            self.rig.board.run_us(25_000 - 60);
        }
        all
    }
}

fn degrees(bearing: u16) -> f64 {
    f64::from(bearing.cast_signed()) * 360.0 / 65_536.0
}

/// The reports without the repeats of one reading.
fn readings(reports: &[(u64, Report)]) -> Vec<(u64, Report)> {
    let mut new = Vec::new();
    let mut last = (0, fw_core::wire::DistanceCode::NONE);
    for &(at, report) in reports {
        let reading = (report.bearing, report.ranges[0]);
        if reading != last {
            last = reading;
            new.push((at, report));
        }
    }
    new
}

/// No noise and no outliers: what is left is the robot's own error.
fn exact() -> Params {
    let mut params = Params::default();
    params.rangefinder.noise_mm = 0.0;
    params.rangefinder.noise_per_mm = 0.0;
    params.rangefinder.outlier = 0.0;
    params
}

/// Every reading is of the ping before it: its bearing where the servo really was, its range what was
/// really there.
fn each_reading_is_its_pings(pings: &[Ping], readings: &[(u64, Report)], front_deg: f64) {
    let mut pings = pings.iter();
    for (at, report) in readings {
        let bearing = degrees(report.bearing);
        let told = distance_mm(report.ranges[0]);
        // In order: none twice, and none left out.
        let ping = pings.next().expect("a ping for every reading");
        assert!(ping.at_ns < *at, "{bearing}");
        let true_bearing = ping.bearing_rad.to_degrees();
        assert!(
            (true_bearing - bearing).abs() < 0.7,
            "told {bearing}, stood at {true_bearing} (front {front_deg})"
        );
        match (told, ping.range_mm.filter(|&mm| mm < 2499.0)) {
            (Some(told), Some(truth)) => {
                // A per cent for the chip's idea of the air, and a step of the emulated clock.
                let off = (told - truth).abs();
                assert!(off <= 2.0 + truth / 100.0, "{bearing}: {told} for {truth}");
            }
            (None, Some(truth)) => assert!(truth > 2475.0, "{bearing}: nothing for {truth}"),
            (Some(told), None) => assert!(told > 2475.0, "{bearing}: {told} for nothing"),
            (None, None) => {}
        }
    }
}

// Requirement: WIRE-bearing-2, WIRE-bearing-3, WIRE-bearing-4, WIRE-bearing-5
#[test]
fn every_reading_has_the_bearing_it_was_taken_at_to_and_fro_and_none_is_lost_or_doubled() {
    let mut swept = Swept::new(config(|_| {}), exact());
    // Five seconds are two sweeps to and fro.
    let reports = swept.frames(5_600_000);
    let first = reports[0].1;
    assert_eq!((first.bearing, distance_mm(first.ranges[0])), (0, None));
    let readings = readings(&reports);
    let pings = swept.rig.board.pings();
    assert!(pings.iter().all(|ping| ping.sensor == 0));
    assert!(readings.len() >= 80, "{}", readings.len());
    assert!(
        pings.len() - readings.len() <= 1,
        "the last may be under way"
    );
    each_reading_is_its_pings(&pings, &readings, 0.0);
    let bearings: Vec<f64> = readings.iter().map(|(_, r)| degrees(r.bearing)).collect();
    let turns = bearings
        .windows(3)
        .filter(|w| (w[1] - w[0]) * (w[2] - w[1]) < 0.0);
    assert!(turns.count() >= 4, "to and fro: {bearings:?}");
    let ends = (-90.0, 90.0);
    assert!(bearings.iter().any(|b| (b - ends.0).abs() < 0.2));
    assert!(bearings.iter().any(|b| (b - ends.1).abs() < 0.2));
    // As fast as the part allows: 60 ms from burst to burst.
    for pair in pings.windows(2) {
        let apart = pair[1].at_ns - pair[0].at_ns;
        assert!((59_900_000..=60_100_000).contains(&apart), "{apart} ns");
    }
    assert!(
        readings
            .iter()
            .filter(|(_, r)| distance_mm(r.ranges[0]).is_some())
            .count()
            > 40
    );
    swept.rig.assert_modelled();
}

// Requirement: WIRE-platform-6
#[test]
fn a_servo_that_turns_the_other_way_and_less_far_is_told_right() {
    let mut params = exact();
    params.servo.travel_rad = -std::f64::consts::FRAC_PI_2;
    params.mounts[0].bearing_rad = 30f64.to_radians();
    let mut swept = Swept::new(
        config(|config| {
            config.platform.servo_reversed = true;
            config.platform.servo_travel = 0x4000;
            config.platform.bearings[0] = 0x1555;
        }),
        params,
    );
    let reports = swept.frames(2_500_000);
    let readings = readings(&reports);
    assert!(readings.len() >= 30);
    each_reading_is_its_pings(&swept.rig.board.pings(), &readings, 30.0);
}

#[test]
fn a_lazy_servo_shows_that_the_tests_would_see_a_trigger_that_comes_too_early() {
    let mut params = exact();
    // Half as fast as the plan allows for.
    params.servo.slew_rad_s /= 2.0;
    let mut swept = Swept::new(config(|_| {}), params);
    let reports = swept.frames(2_500_000);
    let readings = readings(&reports);
    let pings = swept.rig.board.pings();
    let worst = pings
        .iter()
        .zip(&readings)
        .map(|(ping, (_, r))| (ping.bearing_rad.to_degrees() - degrees(r.bearing)).abs())
        .fold(0.0, f64::max);
    assert!(worst > 1.0, "{worst}");
}

// Requirement: WIRE-servo-1, WIRE-servo-2
#[test]
fn the_servo_rests_before_the_first_frame_and_after_the_last() {
    let mut swept = Swept::new(config(|_| {}), exact());
    let angle = |board: &Board| board.world(|world| world.servo().angle_rad().to_degrees());
    swept.rig.board.run_us(700_000);
    assert!(angle(&swept.rig.board).abs() < 1e-9);
    assert!(swept.rig.board.pings().is_empty());
    swept.frames(1_000_000);
    let pings = swept.rig.board.pings().len();
    assert!(pings > 3);
    // The stop deadline's 250 ms, and what was under way.
    swept.rig.board.run_us(350_000);
    let (stands, pings) = (angle(&swept.rig.board), swept.rig.board.pings().len());
    swept.rig.board.run_us(2_000_000);
    assert!((angle(&swept.rig.board) - stands).abs() < 1e-9);
    assert_eq!(swept.rig.board.pings().len(), pings);
    // Turned by hand meanwhile: what is told after that is still true.
    swept.rig.board.world(|world| world.servo_mut().force(1.2));
    let reports = swept.frames(1_500_000);
    let fresh = readings(&reports[24..]);
    let after = swept.rig.board.pings();
    assert!(after.len() > pings + 8);
    for (at, report) in fresh {
        let ping = after.iter().rfind(|ping| ping.at_ns + 500_000 < at);
        let ping = ping.expect("a ping before every reading");
        let off = ping.bearing_rad.to_degrees() - degrees(report.bearing);
        let of_the_one_before = off.abs() > 5.0 && off.abs() < 11.0;
        assert!(off.abs() < 0.7 || of_the_one_before, "{off}");
    }
}

// Requirement: WIRE-servo-3
#[test]
fn in_any_other_mode_a_servo_looks_straight_ahead_before_anything_is_measured() {
    let settings = Settings {
        config: config(|config| config.mode = Mode::Normal),
        platform_page: true,
    };
    let rig = Rig::booted(Some(settings.image().to_vec()));
    assert!(rig.board.is_ready(), "{}", rig.log());
    rig.board.world(|world| world.servo_mut().force(-1.5));
    let frame = robot_tests::reference::normal_frame(0, 0, 0, false);
    let _ = rig.keep_sending(&frame, 450_000);
    assert!(rig.board.pings().is_empty(), "not before it stands");
    let _ = rig.keep_sending(&frame, 1_000_000);
    let pings = rig.board.pings();
    assert!(pings.len() > 30, "{}", pings.len());
    for ping in pings.iter().filter(|ping| ping.sensor == 0) {
        assert!(ping.bearing_rad.to_degrees().abs() < 0.7);
    }
}

// Requirement: DOC-1-2, DOC-2.2-3
#[test]
fn the_sweep_draws_the_room_around_the_robot() {
    let mut swept = Swept::new(config(|_| {}), Params::default());
    let mut survey = Mapping::new(mapper_config(&swept.config, 25.0));
    let config = swept.config.clone();
    for (at, report) in swept.frames(12_000_000) {
        let mut snapshot = host_link::snapshot::Snapshot::new(&config);
        snapshot.update(
            at / 1000,
            &report,
            host_link::statistics::LinkStatistics::default(),
        );
        survey.add(&RangeSample::of(&snapshot).expect("a mode with poses"));
    }
    let counters = survey.mapper().counters();
    // 12 s of 16.7 readings a second; repeats are told apart.
    assert!(counters.echoes > 90, "{counters:?}");
    assert!(
        counters.echoes + counters.silences + counters.outliers < 200,
        "{counters:?}"
    );
    // The first board's start looks along +x of its own frame: what was seen must be where walls are.
    let room = swept.rig.board.world(|world| world.room().clone());
    let grid = survey.mapper().grid();
    let (mut right, mut wrong, mut ahead) = (0, 0, [0; 3]);
    for row in 0..grid.rows() {
        for column in 0..grid.columns() {
            if grid.probability(column, row) < 0.7 {
                continue;
            }
            let Point { x_mm: x, y_mm: y } = grid.middle(column, row);
            // Within the cone's half width of a wall: an arc is drawn where only a point of it is.
            let near = room.clearance_mm(room.start.point_at(x, y));
            let allowed = 60.0 + 0.27 * x.hypot(y);
            if near <= allowed {
                right += 1;
            } else {
                wrong += 1;
            }
            let side = y.atan2(x).to_degrees();
            if side < -30.0 {
                ahead[0] += 1;
            } else if side > 30.0 {
                ahead[2] += 1;
            } else {
                ahead[1] += 1;
            }
        }
    }
    assert!(
        right > 60 && wrong * 20 <= right,
        "{right} right, {wrong} wrong"
    );
    assert!(
        ahead.iter().all(|&cells| cells > 5),
        "right, ahead, left: {ahead:?}"
    );
}
