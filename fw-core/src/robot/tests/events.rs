//! What the registers tell beside ticks and frames.

use super::*;
use crate::log::tests::transmitted;
use crate::sensing::rangefinder::Echo;

// Requirement: WIRE-spi-3, WIRE-fault-2
#[test]
fn lost_frames_are_counted_logged_and_a_fault() {
    let mut bench = Bench::new(Mode::GuardedNormal);
    bench.frame(&Command::default());
    bench.robot.on_lost_frames(3, &mut bench.log);
    bench.robot.on_lost_frames(2, &mut bench.log);
    let counters = bench.robot.counters();
    assert_eq!((counters.overrun, counters.accepted), (5, 1));
    assert_eq!(counters.frames(), 6);
    assert_eq!(bench.robot.faults(), Faults::FRAME_REJECTED);
    let lines = "W00000: 3 frames lost: not read in time\n\
                 W00001: 2 frames lost: not read in time\n";
    assert_eq!(bench.log(), lines);
    let report = bench.frame(&Command::default());
    assert_eq!(report.faults, Faults::FRAME_REJECTED, "in the report");
}

// Requirement: WIRE-fault-2, WIRE-sequence-6
#[test]
fn repeated_frame_is_a_fault_and_does_not_feed_the_deadline() {
    let mut bench = Bench::new(Mode::GuardedNormal);
    let mut frame = [0; MAX_FRAME];
    let len = bench.pi.send(&go(1000), &mut frame);
    for tick in 0..25 {
        bench.receive(&frame[..len], 0);
        let rejected = bench.robot.faults() == Faults::FRAME_REJECTED;
        assert_eq!(rejected, tick > 0);
        assert_eq!(runs(bench.tick()), tick < 24, "{tick}");
    }
    assert!(bench.robot.faults().intersects(Faults::LINK_LOST));
}

#[test]
fn fault_is_latched_and_logged_once() {
    for bit in 0..16 {
        let mut bench = Bench::new(Mode::GuardedNormal);
        let lines_of = |log: &Log| log.pending().split(|&byte| byte == b'\n').count();
        let mut log = Log::<1024>::new();
        event_log::log_faults(Faults::from_bits(1 << bit), &mut log);
        let lines = lines_of(&log);
        for _ in 0..3 {
            bench.raise(Faults::from_bits(1 << bit));
            assert_eq!(bench.robot.faults(), Faults::from_bits(1 << bit));
            assert_eq!(lines_of(&bench.log), lines, "{bit}");
        }
        // All others beside it: each is logged, this one not again.
        bench.raise(Faults::ALL_BITS);
        assert_eq!(bench.robot.faults(), Faults::ALL_BITS);
        event_log::log_faults(Faults::from_bits(!(1 << bit)), &mut log);
        assert_eq!(lines_of(&bench.log), lines_of(&log), "{bit}");
    }
}

/// Though every frame clears the fault and resumes.
// Requirement: WIRE-fault-14
#[test]
fn low_supply_brakes_every_tick_that_finds_it() {
    let mut bench = Bench::new(Mode::GuardedTuneRotate);
    let go = with_order(Order::Resume, clearing(Faults::SUPPLY_LOW, tune(50.0)));
    for (supply_low, wheels) in [(false, true), (true, false), (true, false), (false, true)] {
        bench.sample.supply_low = supply_low;
        bench.frame(&go);
        assert_eq!(runs(bench.tick()), wheels);
        assert_eq!(bench.robot.faults() == Faults::SUPPLY_LOW, supply_low);
    }
}

#[test]
fn latched_fault_raised_again_changes_nothing() {
    let mut bench = Bench::new(Mode::GuardedNormal);
    bench.raise(Faults::ENCODER_JUMP);
    bench.frame(&with_order(Order::Resume, Command::default()));
    let before = bench.robot.supervisor;
    assert!(!before.halted(), "until the tick that finds the fault");
    for again in [Faults::NONE, Faults::ENCODER_JUMP] {
        bench.raise(again);
        assert_eq!(bench.robot.supervisor, before);
    }
}

// Requirement: WIRE-fault-10
#[test]
fn dropped_log_lines_latch_fault_until_cleared() {
    let mut bench = Bench::new(Mode::GuardedNormal);
    for dropped in [1, 2, 7] {
        bench.tick();
        assert!(bench.robot.faults().is_empty());
        let before = bench.log.dropped();
        // Each is of nine bytes, and there is room for some hundred.
        for _ in 0..200 {
            if bench.log.dropped() - before < dropped {
                bench.log.line(Level::Info, |_| ());
            }
        }
        for _ in 0..3 {
            bench.tick();
            assert_eq!(bench.robot.faults(), Faults::LOG_DROPPED);
        }
        let _ = transmitted(&mut bench.log);
        bench.frame(&clearing(Faults::ALL_BITS, Command::default()));
    }
}

/// What the front rangefinder says of an echo of 10 ms.
fn of_ten_milliseconds(bench: &mut Bench) -> f64 {
    assert!((0..10).any(|_| bench.tick().trigger == Some(RangefinderId::Front)));
    bench.echo(RangefinderId::Front, 10_000);
    match bench.robot.rangefinders.reading(RangefinderId::Front).echo {
        Echo::Distance(distance) => distance.0.to_num(),
        echo => panic!("{echo:?}"),
    }
}

#[test]
fn chip_temperature_sets_speed_of_sound() {
    let mut bench = Bench::with(Mode::Normal, &[(fields::RANGEFINDERS, 1)]);
    let near = |a: f64, b: f64| (a - b).abs() < 0.01;
    // At 343 m/s.
    let assumed = 1715.0;
    assert!(near(of_ten_milliseconds(&mut bench), assumed));
    // The factory's words are missing.
    bench.robot.on_temperature(962, 1501, &mut bench.log);
    assert!(near(of_ten_milliseconds(&mut bench), assumed));
    bench.robot.calibrate(Calibration {
        reference: 1501,
        cold: 959,
        hot: 1207,
    });
    // 3 words of 248 above 30 °C, which are 80 K; the chip is 2.5 K warmer than the air.
    bench.robot.on_temperature(962, 1501, &mut bench.log);
    let air = 30.0 + 3.0 * 80.0 / 248.0 - 2.5;
    let warm = (331.3 + 0.606 * air) * 10.0 / 2.0;
    let measured = of_ten_milliseconds(&mut bench);
    assert!(near(measured, warm), "{measured} {warm}");
    bench.robot.on_temperature(0, 1501, &mut bench.log);
    assert!(near(of_ten_milliseconds(&mut bench), assumed));
    let lines_of = |text: &str| bench.log().matches(text).count();
    assert_eq!(lines_of(": no temperature: sound at 343 m/s\n"), 2);
    assert_eq!(lines_of(": air at 28 deg C\n"), 1);
}

// Requirement: WIRE-log-3
#[test]
fn link_line_comes_every_hundredth_tick() {
    let mut bench = Bench::new(Mode::Normal);
    bench.frame(&Command::default());
    let mut lines = std::vec::Vec::new();
    for tick in 1..=302 {
        if tick % 10 == 0 {
            bench.frame(&Command::default());
        }
        bench.log = Log::new();
        bench.tick();
        if bench.log().contains(": L ") {
            lines.push(tick);
        }
    }
    // The first tick says that it is ready.
    assert_eq!(lines, [2, 102, 202, 302]);
}

// Requirement: WIRE-log-3
#[test]
fn gap_in_the_link_line_is_between_accepted_frames() {
    let mut bench = Bench::new(Mode::Normal);
    let mut lines = 0;
    for tick in 0..250 {
        match tick % 10 {
            0 => drop(bench.frame(&Command::default())),
            5 => bench.receive(&[0], 0),
            _ => {}
        }
        bench.log = Log::new();
        bench.tick();
        if tick > 50 && bench.log().contains(": L ") {
            assert!(bench.log().contains(" 100000 100000 - key "));
            lines += 1;
        }
    }
    assert_eq!(lines, 2);
}

// Requirement: WIRE-platform-12
#[test]
fn pose_line_period_delays_link_line() {
    let mut bench = Bench::with(Mode::Normal, &[(fields::LOG_PERIOD, 20)]);
    let mut links = 0;
    for tick in 1..=400 {
        if tick % 10 == 0 {
            bench.frame(&Command::default());
        }
        bench.roll(10, 10);
        bench.log = Log::new();
        bench.tick();
        let pose = bench.log().contains(": pose ");
        assert_eq!(pose, tick % 2 == 0, "{tick}");
        let link = bench.log().contains(": L ");
        assert!(!link || bench.log().lines().count() == 1, "{tick}");
        assert!(!link || bench.log().ends_with(" 100000 100000 -\n"));
        links += u32::from(link);
    }
    // Once a second from the first frame on.
    assert_eq!(links, 3);
    // 4000 counts of 80 mm · π / 3840.
    assert!(bench.log().ends_with(": pose 261.799 0.000 mm, 0.00 deg\n"));
}
