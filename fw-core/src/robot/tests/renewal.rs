//! What a tick renews only where its input changed is at any time what would come of working it all
//! out afresh.

use super::*;
use crate::log::tests::transmitted;
use crate::sensing::rangefinder::Echo;
use proptest::prelude::*;
use proptest::strategy::ValueTree;
use proptest::test_runner::TestRunner;

#[derive(Clone, Copy, Debug)]
enum Event {
    /// Counts that the wheels rolled, and what the ADC says.
    Tick(i8, i8, [u16; 2]),
    /// Microseconds from the trigger to the rise, and from there to the fall.
    Echo(RangefinderId, u32, u32),
    Frame,
    Temperature(u16),
}

fn event() -> impl Strategy<Value = Event> {
    let which = prop::sample::select(&RangefinderId::ALL[..]);
    // Distances, nothing within range, and what no object makes.
    let width = prop_oneof![117..15_000_u32, Just(38_000), 0..117_u32, Just(1 << 21)];
    let step = prop_oneof![Just(0_i8), any::<i8>()];
    // A battery that lives: one that is cut off ends all sweeping.
    let words = [3400..3600_u16, 3500..3700];
    prop_oneof![
        12 => (step.clone(), step, words).prop_map(|(l, r, w)| Event::Tick(l, r, w)),
        4 => (which, 0..3_200_u32, width).prop_map(|(which, d, w)| Event::Echo(which, d, w)),
        2 => Just(Event::Frame),
        1 => (0..4096_u16).prop_map(Event::Temperature),
    ]
}

/// The reply that is due, with nothing kept from before.
fn expected_report(robot: &Robot) -> Report {
    Report {
        pose: PoseCode::from_pose(&robot.odometry.pose()),
        measurement: robot.measurement(),
        ranges: RangefinderId::ALL
            .map(|which| DistanceCode::from_distance(robot.rangefinders.distance(which))),
        bearing: robot.rangefinders.reading(RangefinderId::Front).bearing,
        ..robot.report
    }
}

/// What becomes of a robot in `mode`: how many distances and lines about silent sensors it gave.
fn check(mode: Mode, events: &[Event]) -> (usize, usize) {
    let mut bench = Bench::new(mode);
    let mut triggered = [bench.sample.now; 3];
    let mut silent = [false; 3];
    let (mut distances, mut lines) = (0, 0);
    for event in events {
        match *event {
            Event::Tick(left, right, words) => {
                bench.roll(left.into(), right.into());
                bench.words = words;
                if let Some(which) = bench.tick().trigger {
                    triggered[which as usize] = bench.sample.now;
                }
                let text = transmitted(&mut bench.log);
                for (which, silent) in RangefinderId::ALL.into_iter().zip(&mut silent) {
                    let row = bench.robot.stats(which).consecutive_misses;
                    // Three in a row make one silent, an answer ends it.
                    let due = if *silent { row == 0 } else { row >= 3 };
                    let line = std::format!("{} rangefinder", which.name());
                    assert_eq!(text.contains(&line), due, "{line}: {text}");
                    *silent ^= due;
                    lines += usize::from(due);
                }
            }
            Event::Echo(which, delay, width) => {
                let rise = triggered[which as usize].after(delay);
                bench.robot.on_echo(which, rise, rise.after(width));
                let echo = bench.robot.rangefinders.reading(which).echo;
                distances += usize::from(matches!(echo, Echo::Distance(_)));
            }
            // Driven for long by wheels that do as they like it would stop for good.
            Event::Frame => drop(bench.frame(&Command {
                apply: mode == Mode::Normal,
                ..go(300)
            })),
            Event::Temperature(word) => bench.robot.on_temperature(word, 1501, &mut bench.log),
        }
        let expected = expected_report(&bench.robot);
        assert_eq!(bench.robot.report, expected, "after {event:?}");
        let volts = bench.robot.battery.voltages().iter();
        let codes = volts.map(|&volts| CellCode::from_volts(0, volts).voltage);
        assert!(codes.eq(bench.robot.voltages[..2].iter().copied()));
    }
    (distances, lines)
}

// Requirement: DOC-2.1-4, WIRE-spi-6, WIRE-log-9
#[test]
fn report_matches_state_after_any_events() {
    for mode in [Mode::Normal, Mode::GuardedSweep, Mode::GuardedTuneMove] {
        let (mut distances, mut lines) = (0, 0);
        let mut runner = TestRunner::deterministic();
        for _ in 0..64 {
            let events = prop::collection::vec(event(), 400).new_tree(&mut runner);
            let (new_distances, new_lines) = check(mode, &events.expect("events").current());
            distances += new_distances;
            lines += new_lines;
        }
        assert!(distances > 100 && lines > 30, "{distances} {lines}");
    }
}
