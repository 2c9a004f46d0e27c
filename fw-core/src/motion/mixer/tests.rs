//! What the mixer learns of the motors, and what it must not learn from.

use super::*;
use crate::eeprom::first_board;

fn percent(value: f64) -> I16F16 {
    I16F16::from_num(value)
}

/// Motors without a dead zone.
fn mixer() -> Mixer {
    let mut platform = first_board().platform;
    (platform.dead_zone_left, platform.dead_zone_right) = (0, 0);
    Mixer::new(&platform)
}

/// Drives for so many ticks while the wheels roll these counts in each; the shares after every tick.
fn drive(
    mixer: &mut Mixer,
    (forward, rotation): (f64, f64),
    (left, right): (i32, i32),
    ticks: usize,
) -> std::vec::Vec<(I16F16, I16F16)> {
    let rolled = Delta {
        left,
        right,
        ..Delta::default()
    };
    let tick = |_| {
        let _ = mixer.mix(percent(forward), percent(rotation));
        mixer.observe(&rolled);
        mixer.shares()
    };
    (0..ticks).map(tick).collect()
}

fn alike() -> (I16F16, I16F16) {
    (percent(1.0), percent(1.0))
}

#[test]
fn the_stronger_wheel_is_scaled_down_to_the_weaker_and_to_a_quarter_at_most() {
    for (counts, shares) in [
        ((40, 20), (0.5, 1.0)),
        ((20, 40), (1.0, 0.5)),
        ((100, 10), (0.25, 1.0)),
        ((10, 100), (1.0, 0.25)),
        // A wheel that is not seen to turn at all.
        ((40, 0), (0.25, 1.0)),
    ] {
        let mut mixer = mixer();
        // As the weaker's share keeps its duty, its counts stay in proportion to it.
        let _ = drive(&mut mixer, (20.0, 0.0), counts, 60);
        let mut other = mixer.clone();
        let _ = drive(&mut other, (20.0, 0.0), counts, 16);
        for learned in [mixer.shares(), other.shares()] {
            let (left, right) = (learned.0.to_num::<f64>(), learned.1.to_num::<f64>());
            assert!(left <= 1.0 && right <= 1.0 && left.max(right) > 0.99);
            assert!(left >= 0.25 && right >= 0.25, "{left} {right}");
            assert_eq!(left < right, shares.0 < shares.1, "{counts:?}");
        }
    }
}

#[test]
fn a_share_is_what_the_other_wheel_does_for_the_same_duty_in_parts_of_its_own() {
    let mut mixer = mixer();
    // The first that is learned is learned at equal duties.
    let learned = drive(&mut mixer, (20.0, 0.0), (40, 20), 200);
    let first = learned.iter().find(|&&shares| shares != alike());
    let (left, right) = first.expect("it learns within two seconds");
    assert!((left.to_num::<f64>() - 0.5).abs() < 1e-3, "{left}");
    assert_eq!(*right, percent(1.0));
    let mut mixer = self::mixer();
    let learned = drive(&mut mixer, (20.0, 0.0), (1000, 1), 200);
    let first = learned.iter().find(|&&shares| shares != alike());
    assert_eq!(first, Some(&(percent(0.25), percent(1.0))));
}

#[test]
fn a_wheel_that_is_hardly_driven_teaches_nothing() {
    // 6 % are enough. Backwards, for the lags reach a negative duty to the last bit.
    for (forward, rotation, learns) in [
        (-6.0, 0.0, true),
        (-5.99, 0.0, false),
        (5.0, 0.0, false),
        // One of them is not enough.
        (6.5, 2.0, false),
        (6.5, -2.0, false),
        (0.0, 5.0, false),
        (0.0, 20.0, true),
        (20.0, 10.0, true),
    ] {
        let way = |percent: f64| if percent < 0.0 { -1 } else { 1 };
        let counts = (40 * way(forward - rotation), 20 * way(forward + rotation));
        let learned = drive(&mut mixer(), (forward, rotation), counts, 1000);
        let last = learned.last().copied();
        assert_eq!(last != Some(alike()), learns, "{forward} % {rotation} %");
    }
}

#[test]
fn the_shares_change_every_sixteenth_tick() {
    let learned = drive(&mut mixer(), (20.0, 0.0), (40, 20), 500);
    let changes = learned.windows(2).enumerate();
    let changes = changes.filter(|(_, shares)| shares[0] != shares[1]);
    let changes: std::vec::Vec<usize> = changes.map(|(tick, _)| tick).collect();
    assert!(changes.len() > 3, "{changes:?}");
    for two in changes.windows(2) {
        assert_eq!((two[1] - two[0]) % 16, 0, "{changes:?}");
    }
}

#[test]
fn wheels_that_are_braked_or_driven_past_the_mixer_teach_nothing() {
    let past: [fn(&mut Mixer); 2] = [
        |mixer| {
            let _ = mixer.brake();
        },
        |mixer| {
            let _ = mixer.raw(5000, -5000);
        },
    ];
    for past in past {
        let mut mixer = mixer();
        let _ = drive(&mut mixer, (20.0, 0.0), (30, 30), 200);
        let before = mixer.shares();
        // The lags take a while to forget.
        for tick in 0..500 {
            past(&mut mixer);
            let counts = if tick < 100 { (30, 30) } else { (40, 20) };
            mixer.observe(&Delta {
                left: counts.0,
                right: counts.1,
                ..Delta::default()
            });
        }
        let after = mixer.shares();
        assert!((before.0 - after.0).abs() < percent(0.1), "{after:?}");
        assert!((before.1 - after.1).abs() < percent(0.1), "{after:?}");
    }
}

#[test]
fn a_duty_is_the_nearest_hundredth() {
    for (forward, hundredths) in [
        (10.004, 1000),
        (10.006, 1001),
        (-10.004, -1000),
        (-10.006, -1001),
    ] {
        let wheels = mixer().mix(percent(forward), percent(0.0));
        let run = MotorCommand::Run(Duty::saturating(hundredths));
        let platform = first_board().platform;
        assert!(!platform.motor_left_reversed || !platform.motor_right_reversed);
        let straight = if platform.motor_left_reversed {
            wheels.right
        } else {
            wheels.left
        };
        assert_eq!(straight, run, "{forward}");
    }
}
